"""Contact sheets of simulated scenes: random frames of many matches on one picture."""

from pathlib import Path

import cv2
import numpy as np

from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene
from pgm_data.simulate.clip import simulate_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import match_seed

COLUMNS, WIDTH, GAP = 2, 800, 6


def write_sheet(path: Path, scene: Scene, seed: int, *, size: tuple[int, int], fps: float, count: int = 10) -> None:
    """One random frame of each of `count` matches, side by side, as JPEG or PNG by the path's ending."""
    rng = np.random.default_rng(seed)
    pictures = [_random_frame(scene, match_seed(seed, i), rng, size, fps) for i in range(count)]
    tall = round(WIDTH * size[1] / size[0])
    small = [cv2.resize(p, (WIDTH, tall), interpolation=cv2.INTER_AREA) for p in pictures]
    rows = -(-count // COLUMNS)
    sheet = np.full((rows * (tall + GAP) - GAP, COLUMNS * (WIDTH + GAP) - GAP, 3), 255, np.uint8)
    for i, picture in enumerate(small):
        y, x = (i // COLUMNS) * (tall + GAP), (i % COLUMNS) * (WIDTH + GAP)
        sheet[y : y + tall, x : x + WIDTH] = picture
    done, data = cv2.imencode(path.suffix, sheet)
    if not done:
        raise ValueError(f"{path}: expected an ending that OpenCV can write, got {path.suffix!r}")
    with whole_file(path) as temporary:
        temporary.write_bytes(data.tobytes())


def _random_frame(scene: Scene, seed: int, rng: np.random.Generator, size: tuple[int, int], fps: float) -> np.ndarray:
    """A frame of a video of twenty seconds."""
    options = ClipOptions(frames=round(20 * fps), width=size[0], height=size[1], fps=fps)
    wanted = int(rng.integers(options.frames))
    for shot in simulate_shots(scene, options, seed):
        if shot.first_frame <= wanted < shot.first_frame + len(shot):
            return next(shot.pictures(wanted - shot.first_frame))
    raise AssertionError(f"frame {wanted} of {options.frames}")
