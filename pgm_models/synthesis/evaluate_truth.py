"""Which object each pixel truly shows: the labels that `pgm simulate --masks` writes beside a clip's tables."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from pgm_data.simulate.mask_files import DEPTH, DEPTH_UNIT_M, LABELS

HALF = 0.5
"""A pixel is an object's where the object covers at least so much of it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TruePixels:
    """What each pixel of one frame shows, at the size of the tables."""

    labels: UInt8[np.ndarray, "height width"]
    """1 + the object's place in the scene; 0 where none is."""
    depth: Float[np.ndarray, "height width"]
    """Camera z, metres; inf where nothing is."""

    def mask(self, thing: int, size: tuple[int, int]) -> Bool[np.ndarray, "..."]:
        """Where an object, by its number, is seen in pictures of that width and height."""
        import cv2

        own = self.labels == 1 + thing
        if own.shape == (size[1], size[0]):
            return own
        return cv2.resize(own.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= HALF


def true_pixels(folder: Path, frames: Sequence[int]) -> Iterator[TruePixels]:
    """What those frames of a clip show, in that order, which must rise; read once from the start, one at a time.

    Args:
        folder: The clip's, with `labels.mkv` and `depth.mkv`.
        frames: Numbers in the clip.

    Raises:
        ValueError: If a file is not there or holds fewer frames, or numbers do not rise; names file and frame.
    """
    wanted = list(frames)
    if any(later <= earlier for earlier, later in zip(wanted, wanted[1:], strict=False)):
        raise ValueError(f"{folder}: frames: expected numbers that rise, got {wanted[:8]}")
    labels, depth = (_planes(folder / name, wanted) for name in (LABELS, DEPTH))
    for own, steps in zip(labels, depth, strict=True):
        yield TruePixels(labels=own, depth=np.where(steps > 0, DEPTH_UNIT_M * steps.astype(np.float64), np.inf))


def _planes(path: Path, frames: Sequence[int]) -> Iterator[np.ndarray]:
    """Those frames of a video of one plane."""
    import av

    if not path.is_file():
        raise ValueError(f"truth: expected {path}, as pgm simulate --masks writes it, got nothing there")
    left = iter(frames)
    wanted = next(left, None)
    with av.open(f"file:{path}") as container:
        for number, frame in enumerate(container.decode(video=0)):
            if wanted is None:
                return
            if number == wanted:
                yield frame.to_ndarray()
                wanted = next(left, None)
    if wanted is not None:
        raise ValueError(f"truth: {path}: expected frame {wanted}, got a video that ends before it")
