"""`pgm demo`: a video annotated and packed, models that play and render, and one page that shows it all."""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .console import UsageError, option_error, table_text
from .output import STATE

if TYPE_CHECKING:
    from pgm_data.stages.demo_report import Comparison, RenderedVideo, TrainedModel

    from .demo_steps import DemoSteps

OURS = ("simulated", "work", "dataset", "prompt", "rally", "synthesis", "rendered")
"""What a demo writes, each an output folder with its state inside; its page, and nothing else there, is ours too."""


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """From a video to a rally that nobody played: annotate a match, train on it, and render what words say.

    Draws a short match, or takes a video of yours, finds cameras, players, ball and words, packs and checks them,
    compares them with the truth, plays a rally from words, trains a model that renders, and renders the rally. Ends
    with one page, OUT/report.html, that shows all of it.
    """

    video: Path | None = None
    """A video of yours instead of a simulated match; there is no truth to compare it with."""
    scene: str = "tennis"
    """Scene of that video, by name or path."""
    out: Path = Path("demo")
    """Folder to write into; what an earlier demo wrote there is replaced."""
    seconds: float = 10.0
    """Length of the simulated match."""
    seed: int = 70
    """What is drawn depends on it; this one cuts to a close-up near the end."""
    animation: Path = Path("tennis_small")
    """What plays the rally: a run of pgm-train animation, a model file, or the name of a model that ships with pgm."""
    prompt: Path | None = None
    """Prompt of the rally; one that ships with pgm unless given."""
    synthesis_preset: Literal["nano", "tiny", "small"] = "tiny"
    """Size of the model that is trained to render."""
    synthesis_minutes: float = 3.0
    """Minutes of its training; 0 to train and render nothing."""
    threads: int = 2
    """CPU threads of the models; as many as there are cores that nothing else keeps busy."""


def main(argv: list[str]) -> int:
    """Run the demo; its exit code."""
    import tyro

    options = tyro.cli(DemoOptions, args=argv, prog="pgm demo")
    _check(options)
    _clear(options.out)
    from .demo_steps import DemoSteps

    steps = DemoSteps()
    simulated, work, dataset = (options.out / name for name in ("simulated", "work", "dataset"))
    if options.video is None:
        match = f"{options.seconds:g} s of a match with a turning, zooming camera, repeated frames and cuts"
        with steps.step(1, f"drawing {match}"):
            code = _simulate(options, simulated, steps)
        if code:
            return code
        source, scene, told = simulated / "videos", "tennis", f"Drawn: {match}; seed {options.seed}."
    else:
        source, scene, told = options.video, options.scene, f"{options.video}, scene {options.scene}"
    with steps.step(2, f"calibrating {source}"):
        from .calibrate import main as calibrate

        code = steps.run("pgm calibrate", calibrate, [source, "--out", work, "--scene", scene])
    if code not in (0, 3):
        return code
    if any(work.glob("*/camera.parquet")):
        stages = _annotated(work, scene, steps)
        if stages not in (0, 3, 4):
            return stages
        with steps.step(6, "packing a dataset"):
            from .pack import main as pack

            code = steps.run("pgm pack", pack, [work, "--out", dataset]) or code
    with steps.step(7, "checking what was written"):
        from .check import main as check

        checked = steps.run("pgm check", check, [path for path in (work, dataset) if path.exists()])
    compared: Sequence[Comparison] = ()
    if options.video is None:
        with steps.step(8, "comparing with the truth, which nothing above has seen"):
            from .demo_truth import compared_with_truth

            compared = compared_with_truth(simulated, work)
            for comparison in compared:
                print(table_text((comparison.title, ""), comparison.rows))
    modelled = _modelled(options, scene, steps)
    _write_page(options.out, told, compared, modelled, steps)
    return modelled.code or checked or code


def _check(options: DemoOptions) -> None:
    """Refuse options that cannot be, before anything is deleted or drawn."""
    for name, path in (("--video", options.video), ("--prompt", options.prompt)):
        if path is not None and not path.is_file():
            raise option_error(name, expected="a file", got=f"{path}, which is none")
    if not 1 <= options.seconds <= 600:
        raise option_error("--seconds", expected="1 to 600", got=options.seconds)
    if not 1 <= options.threads <= 1024:
        raise option_error("--threads", expected="1 to 1024", got=options.threads)
    if not 0 <= options.synthesis_minutes <= 600:
        raise option_error("--synthesis-minutes", expected="0 to 600", got=options.synthesis_minutes)


def _annotated(work: Path, scene: str, steps: "DemoSteps") -> int:
    """Players, ball and words, as far as the scene has them; the first exit code that ends the demo, else 0."""
    from pgm_data.scene import load_scene

    declared = load_scene(scene)
    if declared.players:
        with steps.step(3, "players: fetching the pose weights where they are missing, then skeletons on the court"):
            from .players import main as players
            from .weights import main as weights

            if steps.run("pgm weights", weights, ["pose"]):
                print("   without them players are placed by their boxes alone")
            code = steps.run("pgm players", players, [work])
        if code not in (0, 3, 4):
            return code
    if declared.ball is not None and declared.court is not None:
        with steps.step(4, "placing the ball in metres"):
            from .ball3d import main as ball3d

            # A video of yours may have no ball in flight, and still has its cameras.
            code = steps.run("pgm ball3d", ball3d, [work])
        if code not in (0, 3, 4):
            return code
    if declared.players:
        with steps.step(5, "saying what each player does"):
            from .caption import main as caption

            return steps.run("pgm caption", caption, [work])
    return 0


@dataclass(frozen=True, kw_only=True)
class _Modelled:
    """What models made of a dataset."""

    code: int = 0
    """The first exit code of theirs that is not 0, else 0."""
    trained: "TrainedModel | None" = None
    rendered: "tuple[RenderedVideo, ...]" = ()
    missing: Mapping[str, str] = field(default_factory=dict)
    """Why there is none of `rally`, `trained`, `rendered`."""


def _modelled(options: DemoOptions, scene: str, steps: "DemoSteps") -> _Modelled:
    """Play a rally, train the model that renders and render, where there is a dataset."""
    if not (options.out / "dataset").exists():
        return _Modelled(missing=dict.fromkeys(("rally", "trained", "rendered"), "there is no dataset to learn from"))
    from .demo_models import DemoModels, Went, play_rally, render_videos, train_renderer

    models = DemoModels(
        out=options.out,
        scene=scene,
        animation=options.animation,
        prompt=options.prompt,
        preset=options.synthesis_preset,
        minutes=options.synthesis_minutes,
        threads=options.threads,
    )
    with steps.step(9, f"a rally from words, by the animation model {options.animation}"):
        rally = play_rally(models, steps)
    with steps.step(10, f"training a model that renders, preset {models.preset}, for {models.minutes:g} minutes"):
        training, trained = train_renderer(models, steps)
    rendering, rendered = Went(why=training.why), ()
    if trained is not None:
        with steps.step(11, "rendering"):
            rendering, rendered = render_videos(models, steps)
    went = {"rally": rally, "trained": training, "rendered": rendering}
    return _Modelled(
        code=next((each.code for each in went.values() if each.code), 0),
        trained=trained,
        rendered=rendered,
        missing={name: each.why for name, each in went.items() if each.why},
    )


def _write_page(
    out: Path, source: str, compared: "Sequence[Comparison]", modelled: _Modelled, steps: "DemoSteps"
) -> None:
    """Write the page, and say where it is."""
    from pgm_data.stages.demo_report import DemoReport, write_demo_report

    page = write_demo_report(
        DemoReport(
            out=out,
            source=source,
            steps=tuple(steps.done),
            compared=tuple(compared),
            trained=modelled.trained,
            rendered=modelled.rendered,
            missing=modelled.missing,
        )
    )
    print(f"all of it took {sum(step.seconds for step in steps.done) / 60:.1f} minutes")
    for path in sorted((out / "work").glob("*/overlay.mp4"))[:1]:
        print(f"the annotated video: {path}")
    print(f"12. all of it on one page: open {page}")


def _clear(out: Path) -> None:
    """Make room for a new demo where an earlier one was; anything else is left alone."""
    from pgm_data.stages.demo_report import PAGE_NAME

    if not out.exists():
        return
    entries = sorted(out.iterdir()) if out.is_dir() else [out]
    strangers = [p.name for p in entries if not _is_ours(p)]
    if strangers:
        raise UsageError(f"--out: expected a new folder or an earlier demo's, got {out} with {strangers[0]} in it")
    for name in OURS:
        if (out / name).exists():
            shutil.rmtree(out / name)
    (out / PAGE_NAME).unlink(missing_ok=True)


def _is_ours(path: Path) -> bool:
    """Whether a demo wrote it."""
    from pgm_data.stages.demo_report import PAGE_NAME, is_demo_report

    return is_demo_report(path) if path.name == PAGE_NAME else path.name in OURS and (path / STATE).is_dir()


def _simulate(options: DemoOptions, out: Path, steps: "DemoSteps") -> int:
    from .simulate import main as simulate

    minutes = f"{options.seconds / 60:.6f}"
    look = ("--motion", "follow", "--duplicates", "--closeups")
    match = ("--matches", "1", "--minutes", minutes, "--seed", options.seed)
    return steps.run("pgm simulate", simulate, ["--out", out, *match, *look])
