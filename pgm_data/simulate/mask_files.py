"""Masks and depth of a clip as two lossless videos beside its tables."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from pgm_data.dataset.files import whole_file
from pgm_data.simulate.shots import Masks

LABELS, DEPTH = "labels.mkv", "depth.mkv"
SAME_BYTES = {"fflags": "+bitexact"}
"""Matroska gives each file and each track a random number otherwise."""
DEPTH_UNIT_M = 0.002
"""Metres per step of the 16-bit depth; 0 stands for no depth, 65535 for 131.07 m and beyond."""


def write_masks(folder: Path, masks: Iterable[Masks], *, fps: float) -> None:
    """`labels.mkv` (8 bits: 1 + the object's place in the scene file) and `depth.mkv` (16 bits, steps of 2 mm), FFV1.

    Raises:
        ValueError: If there is no frame.
    """
    rate = Fraction(fps).limit_denominator(1001)
    with whole_file(folder / LABELS) as labels, whole_file(folder / DEPTH) as depth:
        with (
            av.open(f"file:{labels}", "w", format="matroska", options=SAME_BYTES) as first,
            av.open(f"file:{depth}", "w", format="matroska", options=SAME_BYTES) as second,
        ):
            outputs = None
            for mask in masks:
                planes = (mask.labels, steps_of_depth(mask.depth))
                if outputs is None:
                    outputs = tuple(
                        (container, _stream(container, plane, rate))
                        for container, plane in zip((first, second), planes, strict=True)
                    )
                for (container, stream), plane in zip(outputs, planes, strict=True):
                    container.mux(stream.encode(av.VideoFrame.from_ndarray(plane, format=_format(plane))))
            if outputs is None:
                raise ValueError(f"{folder / LABELS}: frames: expected at least one, got none")
            for container, stream in outputs:
                container.mux(stream.encode())


def steps_of_depth(depth: np.ndarray) -> np.ndarray:
    """Depth in metres (inf for none) as the 16-bit numbers of `depth.mkv`."""
    steps = np.minimum(np.maximum(np.rint(depth / DEPTH_UNIT_M), 1.0), 65535.0)
    return np.where(np.isfinite(depth), steps, 0.0).astype(np.uint16)


def _format(plane: np.ndarray) -> str:
    return "gray" if plane.dtype == np.uint8 else "gray16le"


def _stream(container, plane: np.ndarray, rate: Fraction) -> av.VideoStream:
    stream = container.add_stream("ffv1", rate=rate)
    stream.height, stream.width = plane.shape
    stream.pix_fmt = _format(plane)
    return stream
