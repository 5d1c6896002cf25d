"""Jobs of `pgm trade calibrate` on pictures without the court: every camera that is believed there is a false one.

A part of the pictures is real where real clips are given: other sports and close-ups, cut out, mirrored, darkened,
blurred and compressed; the rest is drawn. Every picture depends on the seed and its number alone.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from pgm_data.court import Court
from pgm_data.dataset.files import whole_file
from pgm_data.detect.court_network import CourtNetwork
from pgm_data.lift.clip_solve import LensOptions
from pgm_data.lift.plausible import TrustOptions
from pgm_data.scene import load_scene
from pgm_data.simulate.pictures.negative import draw_negative, draw_props
from pgm_data.stages.calibrate import EFFORTS, Effort, network_of
from pgm_data.stages.court_finder import CourtFinder
from pgm_data.stages.court_track import ShotTracker
from pgm_data.stages.shot_cameras import ShotCameras
from pgm_data.video import PictureFrame, open_video

OTHER_SPORTS = "other_sports"
"""Folder of real clips of other sports; a file's name begins with its sport."""
CLOSE_UPS = {"usopen_360p30_pan_cuts.mp4": 2340}
"""Clips of the scene that show close-ups from a frame on."""
REAL_SHARE = 0.6
"""Share of the pictures that is real where real clips are given."""
LARGEST_WIDTH = 1280


@dataclass(frozen=True, eq=False, kw_only=True)
class Source:
    """A stretch of a real video that does not show the court."""

    path: Path
    first_frame: int


def real_sources(real: Path, scene: str) -> list[Source]:
    """Where a folder of real clips shows no court of the scene: other sports, and close-ups of its own."""
    others = sorted((real / OTHER_SPORTS).glob("*.mp4"))
    found = [Source(path=path, first_frame=0) for path in others if not path.name.startswith(scene)]
    own = [(real / scene / name, first) for name, first in CLOSE_UPS.items()]
    return found + [Source(path=path, first_frame=first) for path, first in own if path.is_file()]


def look_for_court(arguments: dict, report: Callable[[dict], None]) -> dict:
    """Look for the court in one batch of pictures, with the effort of every preset; false cameras by preset."""
    cv2.setNumThreads(1)
    scene = load_scene(arguments["scene"])
    court = scene.court
    assert court is not None
    network = network_of(court, arguments["network"])
    sources = [Source(path=Path(path), first_frame=first) for path, first in arguments["sources"]]
    first, count, seed = arguments["first"], arguments["count"], arguments["seed"]
    pictures = _pictures(range(first, first + count), arguments["real"], sources, arguments)
    cameras: list[dict] = []
    seconds = dict.fromkeys(arguments["qualities"], 0.0)
    for done, (number, origin, picture) in enumerate(pictures):
        for quality in arguments["qualities"]:
            begun = time.monotonic()
            shot = cameras_of_picture(
                picture,
                court,
                network,
                effort=EFFORTS[quality],
                fixed_centre=scene.camera_position == "fixed",
                spool_folder=Path(arguments["scratch"]),
            )
            seconds[quality] += time.monotonic() - begun
            if shot.solved:
                name = f"{quality}_{number:05d}.png"
                _save(Path(arguments["out"]) / name, picture)
                cameras.append(
                    {
                        "preset": quality,
                        "picture": number,
                        "origin": origin,
                        "seed": seed,
                        "file": name,
                        "inliers": int(shot.inliers[0]),
                        "rms_px": float(shot.reprojection_px[0]),
                    }
                )
        report({"progress": done + 1, "total": count})
    real = sum(number < arguments["real"] for number in range(first, first + count))
    return {"pictures": count, "real": real, "false": cameras, "look_s": seconds}


def cameras_of_picture(
    picture: UInt8[np.ndarray, "height width 3"],
    court: Court,
    network: CourtNetwork | None,
    *,
    effort: Effort,
    fixed_centre: bool,
    spool_folder: Path | None,
) -> ShotCameras:
    """What the calibration makes of a video of this one picture."""
    size = (picture.shape[1], picture.shape[0])
    frame = PictureFrame(picture)
    finder = CourtFinder(court, network=network, size=size, marks={}, lines_every=effort.lines_every)
    tracker = ShotTracker(
        court=court,
        fixed_centre=fixed_centre,
        size=size,
        search=effort.search,
        trust=TrustOptions(),
        track=effort.track,
        lens=LensOptions(),
        find=finder,
        marks={},
        spool_folder=spool_folder,
    )
    finder.look_at(frame)
    tracker.add(video_frame=0, timestamp=0.0, is_duplicate=False, luma=frame.luma)
    return tracker.finish()


def changed(rng: np.random.Generator, picture: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "tall wide 3"]:
    """A part of the picture, perhaps mirrored, in other light, blurred and compressed, at another size."""
    height, width = picture.shape[:2]
    part = rng.uniform(0.4, 1.0)
    wide, tall = max(round(part * width), 32), max(round(part * height * rng.uniform(0.85, 1.0)), 32)
    x, y = int(rng.integers(0, width - wide + 1)), int(rng.integers(0, height - tall + 1))
    cut = picture[y : y + tall, x : x + wide]
    out_width = int(rng.choice([640, 854, LARGEST_WIDTH]))
    out_height = 2 * round(0.5 * out_width * tall / wide)
    how = cv2.INTER_AREA if out_width < wide else cv2.INTER_CUBIC
    cut = cv2.resize(cut, (out_width, out_height), interpolation=how)
    if rng.random() < 0.5:
        cut = cv2.flip(cut, 1)
    light = cut.astype(np.float32) * np.exp(rng.normal(0, 0.25)) + rng.normal(0, 12)
    if rng.random() < 0.35:
        light = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.5, 2.5)))
    cut = np.clip(light, 0, 255).astype(np.uint8)
    if rng.random() < 0.5:
        encoded = cv2.imencode(".jpg", cut, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 95))])[1]
        cut = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    return np.ascontiguousarray(cut)


def _pictures(numbers: range, real: int, sources: Sequence[Source], arguments: dict):
    """Number, origin and picture of each; the first `real` numbers of all are real ones."""
    seed, width, height = arguments["seed"], arguments["width"], arguments["height"]
    yield from _real_pictures([n for n in numbers if n < real], sources, seed)
    drawn = [n for n in numbers if n >= real]
    if drawn:
        props = draw_props(np.random.default_rng([seed, 21, drawn[0]]), load_scene(arguments["scene"]), width, height)
        for number in drawn:
            yield number, "drawn", draw_negative(np.random.default_rng([seed, 22, number]), width, height, props)


def _real_pictures(numbers: Sequence[int], sources: Sequence[Source], seed: int):
    for which, source in enumerate(sources):
        # One source after the other by number, so that each gives as many pictures.
        own = [n for n in numbers if n % len(sources) == which]
        if not own:
            continue
        rngs = {n: np.random.default_rng([seed, 20, n]) for n in own}
        with open_video(source.path) as reader:
            claimed = max((reader.info.claimed_frames or 0) - 1, source.first_frame + 1)
            wanted = {n: int(rng.integers(source.first_frame, claimed)) for n, rng in rngs.items()}
            last: UInt8[np.ndarray, "height width 3"] | None = None
            waiting = dict(wanted)
            for frame in reader:
                due = [n for n, at in waiting.items() if at == frame.video_frame]
                if due:
                    last = frame.bgr()
                for n in due:
                    del waiting[n]
                    assert last is not None
                    yield n, f"{source.path.name} frame {wanted[n]}", changed(rngs[n], last)
                if not waiting:
                    break
            if waiting:
                raise ValueError(f"{source.path}: expected frames up to {max(wanted.values())}, got fewer")


def _save(path: Path, picture: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
