"""`pgm simulate`: videos of courts with their exact truth."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .console import Progress, UsageError, check_ranges, option_error, print_error

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_data.simulate.clip_options import ClipOptions
    from pgm_data.simulate.mix import MixOptions
    from pgm_data.stages.jobs import JobEvent
    from pgm_data.stages.simulate_run import SimulateWork

SOME_FAILED, NOTHING_USABLE = 3, 4
WIDEST = 4
"""A camera that shows a court is not found for pictures much wider or taller."""
COURT_IDLE = ("masks", "shutter", "wind", "surface")
"""Options that change nothing where nobody plays."""
BLOCKS_IDLE = ("motion", "duplicates", "shutter", "wind", "surface")
"""Options that change nothing about walks among blocks."""
MATCH_OPTIONS = ("pictures", "masks", "motion", "duplicates", "shutter", "wind", "surface", "worlds")
"""Options that change nothing about a mix."""


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Videos with their exact truth: matches, or a mix of single pictures to train networks on.

    Writes OUT/videos/*.mp4, the work folder OUT/work, and OUT/dataset. Give --matches or --mix.
    Exit codes: 0 all well; 3 a video failed, and the others are there; 4 all failed, or the disk is full.
    """

    out: Path
    """Folder to write into; it must be new or empty, or one of --resume and --overwrite be given."""
    scene: str = "tennis"
    """Scene by name or path. Tennis is played and blocks are walked about, with all their truth; of other courts the
    cameras alone are true."""
    matches: int = 0
    """Videos of matches; of blocks, of walks."""
    minutes: float = 1.0
    """Length of each match."""
    mix: int = 0
    """Pictures of a training mix, each of another world; 1,000 to a video."""
    seed: int = 0
    """What is drawn depends on this and the options alone."""
    pictures: Literal["none", "draft", "full"] = "full"
    """Of matches: none writes the truth alone; full paints even thin lines with their exact centres."""
    masks: bool = False
    """Of matches: which object each pixel shows and how far it is, as labels.mkv and depth.mkv beside the tables."""
    dataset: bool = True
    """Of matches: pack the truth into OUT/dataset as well."""
    resolution: str = ""
    """Width x height in pixels; unless given 1280x720, 1024x576 for blocks, 640x360 for a mix."""
    fps: float | None = None
    """Frames per second; unless given 25, 20 for blocks."""
    motion: Literal["any", "still", "drift", "follow"] = "any"
    """Camera of matches: standing still, drifting by some pixels, following play, or by lot."""
    duplicates: bool = False
    """Repeat every sixth frame, as a rate conversion does."""
    closeups: bool = True
    """Cut to close-ups, replays and the crowd between plays."""
    shutter: float | None = None
    """Exposure as a share of the time between pictures, 0 to 1; by lot unless given."""
    wind: tuple[float, float] | None = None
    """Wind along x and y, m/s; calm unless given."""
    surface: Literal["any", "hard", "clay", "grass"] = "any"
    """Of a tennis court."""
    worlds: int = 0
    """Different worlds of blocks, each with its light and sky, that the walks take turns in: video number v (from 0)
    shows world v mod this. Unless given every video has its own world."""
    jobs: int = 0
    """Videos drawn at a time; 0 for one a processor core."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    import tyro

    options = tyro.cli(SimulateOptions, args=argv, prog="pgm simulate")
    return _simulate(options, _work(options))


def picture_size(resolution: str, default: tuple[int, int]) -> tuple[int, int]:
    """(width, height) of a text such as 1280x720; the default for an empty one."""
    if not resolution:
        return default
    words = resolution.lower().split("x")
    if len(words) != 2 or not all(word.isdigit() for word in words):
        raise option_error("--resolution", expected="WIDTHxHEIGHT such as 1280x720", got=repr(resolution))
    width, height = (int(word) for word in words)
    if not (64 <= width <= 7680 and 36 <= height <= 4320):
        raise option_error("--resolution", expected="64x36 to 7680x4320", got=resolution)
    if max(width / height, height / width) > WIDEST:
        raise option_error("--resolution", expected=f"no side over {WIDEST} times the other", got=resolution)
    if width % 2 or height % 2:
        raise option_error("--resolution", expected="even numbers, as h264 has them", got=resolution)
    return width, height


def _work(options: SimulateOptions) -> "SimulateWork":
    """What is asked for, checked."""
    from pgm_data.simulate.folders import MatchFiles
    from pgm_data.stages.simulate_run import SimulateWork

    if options.matches < 0 or options.mix < 0:
        raise option_error("--matches, --mix", expected="no negative number", got=f"{options.matches}, {options.mix}")
    if (options.matches > 0) == (options.mix > 0):
        raise option_error("--matches, --mix", expected="one of them above 0", got=f"{options.matches}, {options.mix}")
    check_ranges(
        ("--matches", options.matches, 0, 1000),
        ("--mix", options.mix, 0, 10_000_000),
        ("--fps", 25.0 if options.fps is None else options.fps, 1.0, 240.0),
        ("--seed", options.seed, 0, 2**63 - 1),
        ("--jobs", options.jobs, 0, 1024),
        ("--worlds", options.worlds, 0, 1000),
    )
    scene = _scene(options.scene)
    mix = _mix(options, scene) if options.mix else None
    return SimulateWork(
        out=options.out,
        scene=options.scene,
        videos=mix or _clip(options, scene),
        count=mix.videos if mix else options.matches,
        files=MatchFiles(pictures=options.pictures, masks=options.masks),
        dataset=options.dataset and not options.mix,
        seed=options.seed,
        worlds=options.worlds,
    )


def _mix(options: SimulateOptions, scene: "Scene") -> "MixOptions":
    from pgm_data.simulate.mix import MixOptions

    _refuse_idle(options, MATCH_OPTIONS, "--matches with it", "--mix")
    if scene.court is None:
        raise option_error("--mix", expected="a scene with a court", got=f"{scene.name}, which has no court to draw")
    width, height = picture_size(options.resolution, (640, 360))
    return MixOptions(pictures=options.mix, width=width, height=height, fps=options.fps or 25.0)


def _clip(options: SimulateOptions, scene: "Scene") -> "ClipOptions":
    from pgm_data.simulate.clip import is_played
    from pgm_data.simulate.clip_options import ClipOptions

    if scene.court is None:
        _refuse_idle(options, BLOCKS_IDLE, "a scene with a court", scene.name)
    else:
        _refuse_idle(options, ("worlds",), "the scene blocks", scene.name)
        if not is_played(scene):
            _refuse_idle(options, COURT_IDLE, "tennis with its two players and its ball", f"the scene {options.scene}")
    fps = options.fps or (20.0 if scene.court is None else 25.0)
    if not 0.0 < options.minutes <= 600.0 or round(options.minutes * 60 * fps) < 1:
        raise option_error("--minutes", expected="above 0, at least one frame, up to 600", got=options.minutes)
    if options.shutter is not None and not 0.0 <= options.shutter <= 1.0:
        raise option_error("--shutter", expected="0 to 1", got=options.shutter)
    if options.wind is not None and not all(abs(speed) <= 60.0 for speed in options.wind):
        raise option_error("--wind", expected="-60 to 60 m/s", got=options.wind)
    width, height = picture_size(options.resolution, (1024, 576) if scene.court is None else (1280, 720))
    return ClipOptions(
        frames=round(options.minutes * 60 * fps),
        width=width,
        height=height,
        fps=fps,
        motion=options.motion,
        duplicates=options.duplicates,
        closeups=options.closeups,
        quality="draft" if options.pictures == "draft" else "full",
        shutter=options.shutter,
        wind_ms=options.wind,
        surface=None if options.surface == "any" else options.surface,
    )


def _refuse_idle(options: SimulateOptions, names: tuple[str, ...], expected: str, got: str) -> None:
    """Refuse options that are given and would change nothing."""
    for name in names:
        if getattr(options, name) != getattr(SimulateOptions, name):
            raise option_error(f"--{name}", expected=expected, got=got)


def _scene(name: str) -> "Scene":
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(name)
    except (ValueError, OSError) as error:
        raise option_error("--scene", expected="a scene", got=error) from error
    if scene.court is None and scene.name != "blocks":
        raise option_error("--scene", expected="blocks or a scene with a court", got=f"{name}, which has no court")
    return scene


def _simulate(options: SimulateOptions, work: "SimulateWork") -> int:
    from datetime import UTC, datetime

    from pgm_data.provenance import run_document
    from pgm_data.stages.simulate_run import OtherVideos, simulate_work

    from .output import prepare_output

    started = datetime.now(UTC)
    progress = Progress(total=work.count, interval_s=5.0)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        with prepare_output(options.out, resume=options.resume, overwrite=options.overwrite):
            summary = simulate_work(
                work,
                workers=min(work.count, options.jobs or cores),
                resume=options.resume,
                tell=lambda event: _tell(progress, event),
                run_document=lambda inputs: run_document(
                    command="pgm simulate", options=options, started=started, inputs=inputs
                ),
            )
    except OtherVideos as error:
        raise UsageError(str(error)) from error
    finally:
        progress.close()
    for outcome in summary.failed:
        print_error(f"{outcome.name}: {outcome.reason}")
    return 0 if not summary.failed else SOME_FAILED if len(summary.failed) < work.count else NOTHING_USABLE


def _tell(progress: Progress, event: "JobEvent") -> None:
    if event.kind == "progress" and event.detail is not None:
        progress.update(event.name, event.share, f"frame {event.detail['progress']} of {event.detail['total']}")
    elif event.kind == "done":
        progress.finish(event.name, f"{event.name}: done")
    elif event.kind == "skipped":
        progress.finish(event.name, f"{event.name}: done before")
    elif event.kind == "failed":
        progress.finish(event.name, f"{event.name}: failed")
