"""`pgm simulate`: videos of courts with their exact truth."""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .console import Progress, option_error

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_data.simulate.folders import Written


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Videos with their exact truth: matches, or a mix of single pictures to train networks on.

    Writes OUT/videos/*.mp4 and the work folder OUT/work. Give --matches or --mix.
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
    """Wind along x and y, m/s; a light one by lot unless given."""
    surface: Literal["any", "hard", "clay", "grass"] = "any"
    """Of a tennis court."""
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
    count, draw = _checked(options)
    return _write(options, count, draw)


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
    if width % 2 or height % 2:
        raise option_error("--resolution", expected="even numbers, as h264 has them", got=resolution)
    return width, height


def _checked(options: SimulateOptions) -> tuple[int, Callable[[int], "Written"]]:
    """How many videos, and what draws and writes the one of a number."""
    from functools import partial

    if (options.matches > 0) == (options.mix > 0):
        raise option_error("--matches, --mix", expected="one of them above 0", got=f"{options.matches}, {options.mix}")
    if options.matches < 0 or options.mix < 0:
        raise option_error("--matches, --mix", expected="no negative number", got=f"{options.matches}, {options.mix}")
    if options.matches > 1000:
        raise option_error("--matches", expected="1 to 1000", got=options.matches)
    if options.fps is not None and not 1.0 <= options.fps <= 240.0:
        raise option_error("--fps", expected="1 to 240", got=options.fps)
    if options.seed < 0:
        raise option_error("--seed", expected="0 or more", got=options.seed)
    if options.jobs < 0:
        raise option_error("--jobs", expected="0 or more", got=options.jobs)
    scene = _scene(options.scene)
    if options.mix:
        from pgm_data.simulate.mix import MixOptions

        width, height = picture_size(options.resolution, (640, 360))
        if options.duplicates:
            raise option_error("--duplicates", expected="--matches with it", got="--mix")
        if scene.court is None:
            raise option_error(
                "--mix", expected="a scene with a court", got=f"{scene.name}, which has no court to draw"
            )
        if options.mix > 10_000_000:
            raise option_error("--mix", expected="1 to 10000000", got=options.mix)
        mix = MixOptions(pictures=options.mix, width=width, height=height, fps=options.fps or 25.0)
        return mix.videos, partial(_mix_video, options, scene, mix)

    from pgm_data.simulate.clip_options import ClipOptions

    fps = options.fps or (20.0 if scene.court is None else 25.0)
    if not 0.0 < options.minutes <= 600.0 or round(options.minutes * 60 * fps) < 1:
        raise option_error("--minutes", expected="above 0, at least one frame, up to 600", got=options.minutes)
    if options.shutter is not None and not 0.0 <= options.shutter <= 1.0:
        raise option_error("--shutter", expected="0 to 1", got=options.shutter)
    if options.wind is not None and not all(abs(speed) <= 60.0 for speed in options.wind):
        raise option_error("--wind", expected="-60 to 60 m/s", got=options.wind)
    width, height = picture_size(options.resolution, (1024, 576) if scene.court is None else (1280, 720))
    clip = ClipOptions(
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
    return options.matches, partial(_match, options, scene, clip)


def _scene(name: str) -> "Scene":
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(name)
    except ValueError as error:
        raise option_error("--scene", expected="a scene", got=error) from error
    if scene.court is None and scene.name != "blocks":
        raise option_error("--scene", expected="blocks or a scene with a court", got=f"{name}, which has no court")
    return scene


def _mix_video(options: SimulateOptions, scene: "Scene", mix, video: int) -> "Written":
    from pgm_data.simulate.folders import write_mix_video

    _one_thread()
    return write_mix_video(options.out, scene, mix, seed=options.seed, video=video, keep=options.resume)


def _match(options: SimulateOptions, scene: "Scene", clip, match: int) -> "Written":
    from pgm_data.simulate.folders import MatchFiles, write_match

    _one_thread()
    files = MatchFiles(pictures=options.pictures, masks=options.masks, keep=options.resume)
    return write_match(options.out, scene, clip, files, seed=options.seed, match=match)


def _one_thread() -> None:
    import cv2

    cv2.setNumThreads(1)


def _write(options: SimulateOptions, count: int, draw: Callable[[int], "Written"]) -> int:
    from datetime import UTC, datetime

    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import run_document
    from pgm_data.simulate.folders import write_shots

    from .output import prepare_output

    started = datetime.now(UTC)
    with prepare_output(options.out, resume=options.resume, overwrite=options.overwrite):
        progress = Progress(total=count)
        written = []
        try:
            for video in _drawn(options, count, draw):
                written.append(video)
                name = video.video.removeprefix("../")
                progress.finish(name, f"{name}: {len(video.clip_of)} frames")
        finally:
            progress.close()
        written.sort(key=lambda video: video.video)
        write_shots(options.out, _scene(options.scene), written)
        inputs = [
            {"path": video.video, "state": "done", "reason": "", "clips": video.clips, "seconds": None}
            for video in written
        ]
        document = run_document(command="pgm simulate", options=options, started=started, inputs=inputs)
        write_document(options.out / "work" / "run.json", "run", document)
        if options.dataset and not options.mix:
            from pgm_data.simulate.folders import pack_truth

            pack_truth(options.out, _scene(options.scene), videos=options.pictures != "none")
    return 0


def _drawn(options: SimulateOptions, count: int, draw: Callable[[int], "Written"]) -> Iterator["Written"]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    jobs = min(count, options.jobs or cores)
    if jobs <= 1:
        yield from map(draw, range(count))
        return
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(draw, number) for number in range(count)]
        try:
            for done in as_completed(waiting):
                yield done.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
