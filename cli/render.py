"""`pgm render RUN SOURCE --out video.mp4`: a clip's states as video, from any view, in any clothes."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import Progress, UsageError, check_ranges, option_error
from .models import loaded
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_models.synthesis.insertions import Insertion
    from pgm_models.synthesis.model import SynthesisModel
    from pgm_models.synthesis.render_layers import Filmer
    from pgm_models.synthesis.render_run import RenderOutcome, RenderPlan
    from pgm_models.synthesis.render_source import RenderClip, RenderSource
    from pgm_models.synthesis.render_styles import Styles

MOST_PIXELS = 7680 * 4320
"""Of a picture."""
SUFFIXES = (".mp4", ".mkv", ".mov")


@dataclass(frozen=True, kw_only=True)
class RenderCommand:
    """Render a clip of a dataset or of a work folder, as pgm animate, pgm simulate and the pipeline write them.

    The states and the camera are the clip's, the looks those of its own pictures; any of these can be another. Frames
    that are finished when the command is interrupted are kept in a folder beside the video, and --resume goes on.
    """

    run: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN")]
    """Run of pgm-train synthesis, or a model file."""
    source: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SOURCE")]
    """Packed dataset, work folder, or a clip's folder of one."""
    out: Path
    """Video to write: .mp4, .mkv or .mov; NAME.run.json beside it tells how it was made."""
    clip: str = ""
    """Clip of the source; may be left out where there is but one."""
    video: str = ""
    """Match or video of the source that the clip is of."""
    videos: Path | None = None
    """Folder of the source videos, where they are no longer where they were."""
    camera: Path | None = None
    """Camera path file: width, height and keys, each with time, position and look_at; see schemas/camera_path.json."""
    orbit: bool = False
    """A camera that goes round the play."""
    dolly: bool = False
    """A camera that rides past the play."""
    turn_deg_s: float = 12.0
    """How fast the orbit turns, degrees a second."""
    radius_m: float | None = None
    """How far the orbit is from the middle of the play, metres; unless given, so far that all of it is seen."""
    elevation_deg: float = 25.0
    """How high the orbit is as seen from there, degrees."""
    dolly_s: float = 8.0
    """How long the ride takes, seconds."""
    style: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[OBJECT=]FROM ...")] = ()
    """Looks of all objects or of one: FROM is a match that the model learned from, a clip of the source, or FOLDER or
    FOLDER:CLIP of a dataset or work folder with videos. Unless given, as in the clip's own pictures."""
    without: tuple[str, ...] = ()
    """Objects of the scene that are left out."""
    insert: Annotated[tuple[str, ...], tyro.conf.arg(metavar="MESH ...")] = ()
    """Meshes put into the scene: PLAYER=right_wrist for a racket in that hand, FILE@PLAYER:JOINT or FILE@X,Y,Z for an
    OBJ, STL or PLY file in metres, with #rrggbb after it for its colour."""
    frames: Annotated[str, tyro.conf.arg(metavar="A:B")] = ""
    """Frames A to B - 1 of the clip; all unless given."""
    resolution: Annotated[str, tyro.conf.arg(metavar="WxH")] = ""
    """Size of the pictures; unless given, as large as those that the model learned from."""
    fps: float = 0.0
    """Frames that the video shows in a second; the clip's own rate unless given."""
    quality: Literal["draft", "standard"] = "standard"
    """draft leaves out the network that turns rendered features into the final picture."""
    crf: int = 18
    """Quality of the video file, 0 (lossless, large) to 51."""
    depth: bool = False
    """Write the depth beside the video, NAME.depth.mkv: 16 bits, steps of 2 mm, 0 for none."""
    masks: bool = False
    """Write which object each pixel shows, NAME.labels.mkv: 1 + the object's place in the scene file, 0 for none."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    threads: int = 0
    """CPU threads; 0 for as many as PyTorch takes."""
    resume: bool = False
    """Go on with the frames that an interrupted run left."""
    overwrite: bool = False
    """Replace the video that is there, and delete frames that an interrupted run left."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(RenderCommand, args=argv, prog="pgm render")
    size = _check(command)
    import torch

    if command.threads:
        torch.set_num_threads(command.threads)
    from pgm_models.synthesis.model import load_model

    model = loaded(load_model, command.run, command.device)
    source = _source(command, model)
    clip = _clip(command, model, source, size)
    return _render(command, model, source, clip)


def _check(command: RenderCommand) -> tuple[int, int] | None:
    """Refuse options that cannot be, before anything is loaded; the size of the pictures where it is given."""
    if command.out.suffix.lower() not in SUFFIXES:
        raise option_error("--out", expected=f"a file ending in {', '.join(SUFFIXES)}", got=command.out)
    if command.out.is_dir():
        raise option_error("--out", expected="a video file", got=f"the folder {command.out}")
    check_ranges(
        ("--fps", command.fps or 1.0, 0.01, 1000.0),
        ("--crf", command.crf, 0, 51),
        ("--turn-deg-s", command.turn_deg_s, -3600.0, 3600.0),
        ("--radius-m", 1.0 if command.radius_m is None else command.radius_m, 1e-3, 1e6),
        ("--elevation-deg", command.elevation_deg, -89.0, 89.0),
        ("--dolly-s", command.dolly_s, 0.01, 1e6),
        ("--threads", command.threads, 0, 1024),
    )
    cameras = [
        option
        for option, given in (("--camera", command.camera), ("--orbit", command.orbit), ("--dolly", command.dolly))
        if given
    ]
    if len(cameras) > 1:
        raise UsageError(f"{', '.join(cameras)}: expected one of them, got {len(cameras)}")
    if not command.resolution:
        return None
    found = re.fullmatch(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})", command.resolution)
    if found is None or int(found[1]) * int(found[2]) > MOST_PIXELS:
        expected = f"WxH, such as 1024x576, of at most {MOST_PIXELS} pixels"
        raise option_error("--resolution", expected=expected, got=command.resolution)
    return int(found[1]), int(found[2])


def _source(command: RenderCommand, model: "SynthesisModel") -> "RenderSource":
    from pgm_models.synthesis.render_source import find_clip, scene_name

    if command.videos is not None and not command.videos.is_dir():
        raise option_error("--videos", expected="a folder", got=command.videos)
    try:
        source = find_clip(command.source, clip=command.clip, video=command.video, videos=command.videos)
        scene = scene_name(source)
    except ValueError as error:
        option = "--" if str(error).startswith(("clip:", "video:")) else "SOURCE: "
        raise UsageError(f"{option}{error}") from error
    if scene != model.scene.name:
        raise option_error("SOURCE", expected=f"a clip of {model.scene.name}, as RUN is", got=f"one of {scene}")
    return source


def _clip(
    command: RenderCommand, model: "SynthesisModel", source: "RenderSource", size: tuple[int, int] | None
) -> "RenderClip":
    """The clip as the wanted camera sees it."""
    from pgm_models.synthesis.render_cameras import dolly_cameras, orbit_cameras, path_cameras
    from pgm_models.synthesis.render_source import picture_size, read_clip

    cameras, shape = None, (source.clip.width, source.clip.height)
    if command.camera is not None:
        try:
            cameras, shape = path_cameras(command.camera)
        except ValueError as error:
            raise UsageError(f"--camera: {error}") from error
    size = size or picture_size(shape, model.options.picture)
    if command.orbit:
        cameras = orbit_cameras(
            model.scene,
            size,
            turn_deg_s=command.turn_deg_s,
            radius_m=command.radius_m,
            elevation_deg=command.elevation_deg,
        )
    elif command.dolly:
        cameras = dolly_cameras(model.scene, size, command.dolly_s)
    try:
        return read_clip(source, model.scene, size, cameras)
    except ValueError as error:
        raise UsageError(f"SOURCE: {error}") from error


def _frames(command: RenderCommand, clip: "RenderClip") -> range:
    if not command.frames:
        return range(len(clip))
    found = re.fullmatch(r"(\d{0,9}):(\d{0,9})", command.frames)
    first, end = (int(text) if text else None for text in found.groups()) if found else (None, None)
    frames = range(first or 0, len(clip) if end is None else end)
    if found is None or not frames or frames.stop > len(clip):
        raise option_error("--frames", expected=f"A:B within 0:{len(clip)} of {clip.name}", got=command.frames)
    return frames


def _render(command: RenderCommand, model: "SynthesisModel", source: "RenderSource", clip: "RenderClip") -> int:
    import shutil
    from datetime import UTC, datetime

    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import plain, run_document
    from pgm_models.synthesis.render_run import OtherFrames, RenderPlan, begin_parts, beside, render_clip

    started = datetime.now(UTC)
    plan = RenderPlan(
        out=command.out,
        parts=command.out.with_name(f"{command.out.name}.parts"),
        frames=_frames(command, clip),
        fps=command.fps or clip.rate,
        crf=command.crf,
        depth=command.depth,
        masks=command.masks,
    )
    asked = _asked(command, model, clip)
    told = beside(plan.out, "run.json")
    there = [path for path in (*plan.files(), told) if path.exists()]
    if there and not command.overwrite:
        if command.resume and _made_before(told, asked, plan):
            print(f"{command.out}: done before")
            return 0
        raise option_error("--out", expected="a new file, or --overwrite", got=f"{there[0]}, which is there")
    filmer, inserted, styles = _filmer(command, model, source, clip)
    plan.out.parent.mkdir(parents=True, exist_ok=True)
    progress = Progress(total=1, interval_s=5.0)

    def show(done: int, speed: float) -> None:
        words = f"frame {done} of {len(plan.frames)}" + (f", {speed:.2f} frames/s" if speed else "")
        progress.update(plan.out.name, done / len(plan.frames), words)

    try:
        with prepare_output(plan.parts, resume=command.resume, overwrite=command.overwrite):
            begin_parts(plan.parts, asked)
            outcome = render_clip(clip, filmer, plan, show, inserted=inserted)
    except OtherFrames as error:
        raise UsageError(f"--resume: {error}; --overwrite begins again") from error
    finally:
        progress.close()
    missing = _missing(clip, plan)
    told_options = {
        "render": plain(command),
        "asked": asked,
        "video": _video(plan),
        "styles": list(styles.words),
        "missing": clip.missing(plan.frames),
        "rendered": outcome.rendered,
        "samples": outcome.samples,
    }
    inputs = [
        {
            "path": source.path,
            "state": "done",
            "reason": "; ".join(missing),
            "clips": [clip.name],
            "seconds": outcome.seconds,
        }
    ]
    document = run_document(command="pgm render", options=told_options, started=started, inputs=inputs)
    write_document(told, "run", document)
    shutil.rmtree(plan.parts)
    _report(clip, plan, outcome, [*styles.words, *missing])
    return 0


def _report(clip: "RenderClip", plan: "RenderPlan", outcome: "RenderOutcome", lines: "list[str]") -> None:
    width, height = clip.size
    speed = f"{outcome.rendered / outcome.seconds:.2f} frames/s" if outcome.rendered else "nothing to render"
    print(f"{plan.out}: {len(plan.frames)} frames of {width}x{height}, {plan.fps:.3g} a second; {speed}")
    for path in outcome.written[1:]:
        print(path)
    for line in lines:
        print(line)


def _missing(clip: "RenderClip", plan: "RenderPlan") -> list[str]:
    """What is not there in some of the frames, a line each."""
    total = len(plan.frames)
    return [
        f"{name}: none in {count} of {total} frames, which are {'black' if name == 'camera' else 'without it'}"
        for name, count in clip.missing(plan.frames).items()
    ]


def _video(plan: "RenderPlan") -> dict[str, object]:
    """What the video depends on beside its frames."""
    return {"frames": [plan.frames.start, plan.frames.stop], "fps": plan.fps, "crf": plan.crf}


def _made_before(told: Path, asked: dict[str, object], plan: "RenderPlan") -> bool:
    """Whether the video that is there is the one that is asked for."""
    from pgm_data.dataset.documents import read_document

    if not all(path.is_file() for path in (told, *plan.files())):
        return False
    try:
        options = read_document(told, "run")["options"]
    except ValueError:
        return False  # not ours
    return options.get("asked") == asked and options.get("video") == _video(plan)


def _filmer(
    command: RenderCommand, model: "SynthesisModel", source: "RenderSource", clip: "RenderClip"
) -> "tuple[Filmer, list[Insertion], Styles]":
    from pgm_models.synthesis.insertion_texts import inserted_of
    from pgm_models.synthesis.render_layers import Filmer
    from pgm_models.synthesis.render_styles import chosen_styles, style_words

    things = [thing.name for thing in model.scene.objects]
    strange = [name for name in command.without if name not in things]
    if strange:
        raise option_error("--without", expected=f"objects among {', '.join(things)}", got=strange[0])
    try:
        inserted = [inserted_of(text, model.scene) for text in command.insert]
    except (ValueError, OSError) as error:
        raise UsageError(f"--insert: {error}") from error
    try:
        words = style_words(command.style, things)
        styles = chosen_styles(model, source, words, videos=command.videos)
    except ValueError as error:
        raise UsageError(f"--style: {error}") from error
    filmer = Filmer(model, styles.codes, clip.size, quality=command.quality, without=command.without)
    return filmer, inserted, styles


def _asked(command: RenderCommand, model: "SynthesisModel", clip: "RenderClip") -> dict[str, object]:
    """What the pictures of frames depend on, in words that a resumed run finds again."""
    from pgm_data import __version__
    from pgm_models.synthesis.model import model_digest

    return {
        "clip": clip.name,
        "pictures": f"{clip.size[0]}x{clip.size[1]}",
        "quality": command.quality,
        "style": list(command.style),
        "without": sorted(command.without),
        "insert": list(command.insert),
        "depth_or_masks": command.depth or command.masks,
        "model_sha256": model_digest(model),
        "states_sha256": clip.digest(),
        "version": __version__,
    }
