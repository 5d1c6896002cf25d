"""The models' part of a demo: a rally from words, a short training of the model that renders, and what it renders."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .console import print_error
from .demo_steps import DemoSteps
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.dataset.clip_camera import ClipCamera
    from pgm_data.stages.demo_report import RenderedVideo, TrainedModel
    from pgm_models.animation.model import AnimationModel

NOTHING_USABLE = 4
KEYFRAME_HZ = 8.3334
"""First stage of the rally, frames a second: at half of that a ball is not told of often enough."""
LOOKS = 3
"""At held-out pictures in a training."""
AIM_M, COURT_SHARE = (0.0, -2.0, 0.0), 0.55
"""Where the rally's camera looks, metres on a tennis court, and the near baseline's share of the picture's width."""
CLIP_SECONDS = 5.0
"""Of a clip that is rendered where no rally is."""


@dataclass(frozen=True, kw_only=True)
class DemoModels:
    """Which models, and where they work."""

    out: Path
    """Folder of the demo."""
    scene: str
    """Of its clips, by name or path."""
    animation: Path
    """Run, model file or shipped name of the animation model."""
    prompt: Path | None
    """Of the rally; None for the one that comes with pgm."""
    preset: Literal["nano", "tiny", "small"]
    """Size of the model that renders."""
    minutes: float
    """Of its training."""
    threads: int
    """CPU threads of the models."""

    @property
    def work(self) -> Path:
        """The annotated clips."""
        return self.out / "work"

    @property
    def rally(self) -> Path:
        """The played rally."""
        return self.out / "rally"

    @property
    def run(self) -> Path:
        """The run of the model that renders."""
        return self.out / "synthesis"


@dataclass(frozen=True, kw_only=True)
class Went:
    """How a step went."""

    code: int = 0
    """Exit code."""
    why: str = ""
    """Why what the step makes is not there; empty where it is."""


def play_rally(models: DemoModels, steps: DemoSteps) -> Went:
    """Play a rally of a prompt, seen from where the camera of the annotated match stands."""
    from shutil import copyfile

    from .animate import main as animate

    model, why = _animation(models)
    if model is None:
        return _said(f"no rally is played: {why}")
    if model.options.encoder == "minilm":
        from .weights import main as weights

        if steps.run("pgm weights", weights, ["text"]):
            return _said("no rally is played: without the weights above the model cannot read")
    prompt, camera = (models.out / "prompt" / f"{name}.json" for name in ("rally", "camera"))
    with prepare_output(prompt.parent, resume=False, overwrite=False), _given_prompt(models) as given:
        copyfile(given, prompt)
        _write_camera(models, camera)
    words = [
        "--scene",
        models.scene,
        "--prompt",
        prompt,
        "--camera",
        camera,
        "--threads",
        models.threads,
        "--keyframe-hz",
        KEYFRAME_HZ,
        "--out",
        models.rally,
    ]
    code = steps.run("pgm animate", animate, [models.animation, *words])
    return Went(code=code, why="no rally is played: pgm animate failed" if code else "")


def train_renderer(models: DemoModels, steps: DemoSteps) -> "tuple[Went, TrainedModel | None]":
    """Train the model that renders on the demo's dataset for some minutes."""
    if not models.minutes:
        return _said("no model that renders is trained: no minutes were given"), None
    from .train_synthesis import SynthesisTraining, train_synthesis_model

    options = SynthesisTraining(
        dataset=models.out / "dataset",
        out=models.run,
        preset=models.preset,
        minutes=models.minutes,
        checkpoint_minutes=models.minutes / LOOKS,
        threads=models.threads,
        overwrite=True,  # of what lies in a folder that is new but for its lock
    )
    words = [
        "--out",
        models.run,
        "--preset",
        options.preset,
        "--minutes",
        f"{options.minutes:g}",
        "--threads",
        options.threads,
    ]
    steps.note(["pgm-train", "synthesis", options.dataset, *words])
    with prepare_output(models.run, resume=False, overwrite=False):
        try:
            code = train_synthesis_model(options)
        except ValueError as error:
            print_error(str(error))
            return Went(code=NOTHING_USABLE, why=f"no model that renders is trained: {error}"), None
    if code:
        return Went(code=code, why="the training was interrupted"), None
    return Went(), _training(models)


def render_videos(models: DemoModels, steps: DemoSteps) -> "tuple[Went, tuple[RenderedVideo, ...]]":
    """Render the rally, or a clip where there is none, as its camera sees it and from a camera that goes round."""
    from pgm_data.stages.demo_report import RenderedVideo

    from .render import main as render

    played = sorted(path.parent for path in models.rally.glob("*/prompt.json"))
    source, frames = (played[0], "") if played else _clip(models.work)
    name, words = ("rally", "the rally") if played else ("clip", "the annotated match, for want of a rally,")
    folder, made = models.out / "rendered", []
    asked = [
        ("", (), "from where the camera of the match stands"),
        ("_orbit", ("--orbit",), "from a camera that goes round"),
    ]
    with prepare_output(folder, resume=False, overwrite=False):
        for suffix, view, caption in asked:
            path = folder / f"{name}{suffix}.mp4"
            cut = ("--frames", frames) if frames else ()
            threads = ("--threads", models.threads)
            code = steps.run("pgm render", render, [models.run, source, "--out", path, *view, *cut, *threads])
            if code:
                return Went(code=code, why="pgm render failed"), tuple(made)
            made.append(RenderedVideo(path=path, caption=f"{words} {caption}"))
    return Went(), tuple(made)


def _said(why: str) -> Went:
    """A step that had nothing to work with, which is no failure."""
    print(f"   {why}")
    return Went(why=why)


def _animation(models: DemoModels) -> "tuple[AnimationModel | None, str]":
    """The animation model; or None, and why there is none for these clips."""
    from importlib.resources import files

    from pgm_data.scene import load_scene
    from pgm_models.animation.model import SHIPPED, load_model

    name = str(models.animation)
    if name in SHIPPED and not models.animation.exists():
        if not files("pgm_models.animation").joinpath(f"weights/{name}.safetensors").is_file():
            return None, f"the weights of {name} are not in this copy of pgm; --animation takes another model"
    try:
        model = load_model(models.animation)
    except ValueError as error:
        return None, str(error)
    shown = load_scene(models.scene).name
    if model.layout.scene != shown:
        return None, f"the model {models.animation} plays {model.layout.scene}, and the video shows {shown}"
    return model, ""


@contextmanager
def _given_prompt(models: DemoModels) -> Iterator[Path]:
    """The prompt that is played, as a file while it is needed."""
    from importlib.resources import as_file, files

    if models.prompt is not None:
        yield models.prompt
        return
    with as_file(files("pgm_models.animation").joinpath("prompts/rally_from_words.json")) as path:
        yield path


def _longest(work: Path) -> "ClipCamera":
    """The cameras of the clip that has most of them."""
    from pgm_data.dataset.clip_camera import read_clip_camera

    clips = [read_clip_camera(path.parent) for path in sorted(work.glob("*/camera.parquet"))]
    return max(clips, key=lambda clip: int(clip.has_camera.sum()))


def _write_camera(models: DemoModels, path: Path) -> None:
    """Write a fixed camera where that of the longest clip stands: one that has both ends of the court in view.

    A match's camera follows play and need not see all of it; where there is no court, its widest view is taken.
    """
    import numpy as np

    from pgm_data.dataset.documents import read_document, write_document
    from pgm_data.scene import load_scene
    from pgm_data.simulate.views import court_scale, focal_for_span, framed_pose, track_of

    clip, court = _longest(models.work), load_scene(models.scene).court
    document = read_document(models.work / clip.clip_id / "clip.json", "clip")
    size = width, height = document["width"], document["height"]
    rows = np.flatnonzero(clip.has_camera)
    widest = int(rows[clip.camera.K[rows, 0, 0].argmin()])
    camera, row = clip.camera, widest
    if court is not None:
        centre, aim = camera.position_world[widest], court_scale(court) * np.array(AIM_M)
        middle = ((width - 1) / 2, (height - 1) / 2)
        pose = framed_pose(
            centre_world=centre,
            aim_world=aim,
            aim_px=middle,
            roll=0.0,
            focal_px=focal_for_span(court, centre, aim, COURT_SHARE, width),
            principal_px=middle,
            k=0.0,
        )
        camera, row = track_of([pose.view(size)]), 0
    parts = ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    seen = {name: getattr(camera, name)[row].ravel().tolist() for name in parts}
    write_document(path, "camera", {"width": width, "height": height, **seen})


def _clip(work: Path) -> tuple[Path, str]:
    """Folder of the longest clip, and the frames of it that are rendered, as `pgm render` takes them."""
    import numpy as np

    clip = _longest(work)
    first = int(np.flatnonzero(clip.has_camera)[0])
    end = int(np.searchsorted(clip.timestamp, clip.timestamp[first] + CLIP_SECONDS - 1e-6))
    return work / clip.clip_id, f"{first}:{end}"


def _training(models: DemoModels) -> "TrainedModel":
    """How the training went, from what it left in its run."""
    import numpy as np

    from pgm_data.stages.demo_report import TrainedModel
    from pgm_models.animation.training_plots import read_log
    from pgm_models.synthesis.training_pictures import SAMPLES_NAME
    from pgm_models.train import LOG_NAME

    trained, held_out = read_log(models.run / LOG_NAME)
    steps = int(trained["step"][-1])
    none = np.zeros(0)
    return TrainedModel(
        run=models.run,
        about=f"Preset {models.preset}, {models.minutes:g} minutes, {steps} steps.",
        seconds=trained["elapsed_s"],
        loss=trained["loss"],
        look_seconds=held_out.get("elapsed_s", none) if "psnr" in held_out else none,
        psnr=held_out.get("psnr", none),
        pictures=tuple(sorted((models.run / SAMPLES_NAME).glob("*.png"))),
    )
