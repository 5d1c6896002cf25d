"""The known points of a court in one picture, by the network that `pgm-train court` trained.

The picture is shrunk or enlarged to fit the network's input and centred in it on black ("letterbox"); points are
read from its heat maps below the size of a cell and carried back exactly. Pixel centres are at integers throughout.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.onnx_file import network_file as network_file_of
from pgm_data.detect.onnx_file import open_network
from pgm_data.geometry.arrays import frozen

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

INPUT_SIZE = (512, 288)
"""Width and height of the network's input, pixels."""
STRIDE = 4
"""Input pixels per cell of a heat map."""
REACH = 3
"""Cells on each side of the highest one that belong to a peak: three standard deviations of a trained peak."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Letterbox:
    """Where a picture lies in the network's input.

    Raises:
        ValueError: If the picture is empty.
    """

    picture_size: tuple[int, int]
    """Width and height of the picture, pixels."""
    input_size: tuple[int, int] = INPUT_SIZE
    """Width and height of the network's input, pixels."""

    def __post_init__(self) -> None:
        """Check the sizes."""
        if min(self.picture_size) < 1:
            raise ValueError(f"picture: expected at least one pixel, got {self.picture_size[0]}x{self.picture_size[1]}")

    @property
    def inner_size(self) -> tuple[int, int]:
        """Width and height of the picture inside the input, whole pixels."""
        (width, height), (wide, high) = self.picture_size, self.input_size
        scale = min(wide / width, high / height)
        return max(1, round(width * scale)), max(1, round(height * scale))

    @property
    def corner(self) -> tuple[int, int]:
        """Column and row of the input where the picture's top-left pixel lies."""
        (wide, high), (width, height) = self.input_size, self.inner_size
        return (wide - width) // 2, (high - height) // 2

    @property
    def scale(self) -> Float[np.ndarray, " 2"]:
        """Input pixels per picture pixel along x and y."""
        return np.array(self.inner_size, dtype=float) / np.array(self.picture_size, dtype=float)

    def input_from_picture(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Input pixels of picture pixels; half a pixel lies between a pixel's centre and its edge."""
        return (pixels + 0.5) * self.scale - 0.5 + np.array(self.corner, dtype=float)

    def picture_from_input(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Picture pixels of input pixels: the inverse of `input_from_picture`."""
        return (pixels - np.array(self.corner, dtype=float) + 0.5) / self.scale - 0.5

    def fill(self, bgr: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "rows columns 3"]:
        """The input: the picture resized and centred on black, colours in the order given."""
        (wide, high), (width, height), (left, top) = self.input_size, self.inner_size, self.corner
        shrinks = width < bgr.shape[1] or height < bgr.shape[0]
        small = cv2.resize(bgr, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        filled = np.zeros((high, wide, 3), np.uint8)
        filled[top : top + height, left : left + width] = small
        return filled


def read_peaks(
    maps: Float[np.ndarray, "points rows columns"], absent: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
    """Cell coordinates (x, y) of each point's peak, and the probability that the point lies there.

    Each point's cells and its absence are the logits of one distribution. The place is the mean over the cells
    round the highest one, the score their share of the whole.
    """
    points, rows, columns = maps.shape
    flat = maps.reshape(points, -1)
    top = np.maximum(flat.max(axis=1), absent)
    cells = np.exp(flat - top[:, None]).reshape(maps.shape)
    whole = cells.sum(axis=(1, 2)) + np.exp(absent - top)
    row, column = np.divmod(flat.argmax(axis=1), columns)
    padded = np.pad(cells, ((0, 0), (REACH, REACH), (REACH, REACH)))
    near = np.arange(2 * REACH + 1)
    peak = padded[
        np.arange(points)[:, None, None], (row[:, None] + near)[:, :, None], (column[:, None] + near)[:, None, :]
    ]
    mass = peak.sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        x = column + (peak.sum(axis=1) @ (near - REACH)) / mass
        y = row + (peak.sum(axis=2) @ (near - REACH)) / mass
    return np.stack([x, y], axis=1).astype(float), (mass / whole).astype(float)


def input_from_cell(cells: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Input pixels of cell coordinates: the centre of cell 0 lies between pixels 1 and 2."""
    return (cells + 0.5) * STRIDE - 0.5


def cell_from_input(pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
    """Cell coordinates of input pixels: the inverse of `input_from_cell`."""
    return (pixels + 0.5) / STRIDE - 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtPoints:
    """What the network saw in one picture."""

    names: tuple[str, ...]
    """The court's points, on the ground and above it."""
    pixels: Float[np.ndarray, "points 2"]
    """Where they are, picture pixels; NaN where the score is under the network's `least_score`."""
    scores: Float[np.ndarray, " points"]
    """Probability that the point is in the picture and within about 10 input pixels of there."""
    line_share: float
    """Share of the picture's area that looks painted with this court's lines."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("pixels", "scores"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


class CourtNetwork:
    """A loaded network; `detect` may be called from several threads."""

    def __init__(self, session: "InferenceSession", names: tuple[str, ...], least_score: float) -> None:
        """Use `load`."""
        self._session = session
        self.names = names
        """The points it finds, in order."""
        self.least_score = least_score
        """Score under which a point's pixel is given as NaN."""

    @classmethod
    def load(
        cls,
        path: Path | None,
        *,
        network_file: str,
        names: tuple[str, ...] | None = None,
        threads: int = 1,
        least_score: float = 0.05,
    ) -> "CourtNetwork":
        """The network in that file, or the one of that file name that ships with the package.

        `names` are the points that the caller's court has; None takes whatever the file finds.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is not a court network, or finds other points than the court has.
        """
        with network_file_of(path, shipped=network_file, what="court network") as file:
            return cls._open(file, names, threads, least_score)

    @classmethod
    def _open(cls, path: Path, names: tuple[str, ...] | None, threads: int, least_score: float) -> "CourtNetwork":
        session = open_network(path, threads=threads, what="court network")
        about = session.get_modelmeta().custom_metadata_map
        shape = [i.shape[1:] for i in session.get_inputs()]
        wanted = [[3, INPUT_SIZE[1], INPUT_SIZE[0]]]
        if "points" not in about or shape != wanted:
            raise ValueError(
                f"court network {path}: expected point names in its metadata and an input of {wanted[0]}, "
                f"found metadata {sorted(about)} and inputs {shape}"
            )
        found = tuple(json.loads(about["points"]))
        if names is not None and found != tuple(names):
            raise ValueError(f"court network {path}: expected the points {tuple(names)}, found {found}")
        return cls(session, found, least_score)

    def logits(self, pictures: Float[np.ndarray, "1 3 rows columns"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The network's own answer to one input: points per cell, their absence, painted line per cell."""
        points, absent, line = self._session.run(["points", "absent", "line"], {"picture": pictures})
        return np.asarray(points), np.asarray(absent), np.asarray(line)

    def detect(self, bgr: UInt8[np.ndarray, "height width 3"]) -> CourtPoints:
        """The court's points in a picture of any size."""
        letterbox = Letterbox(picture_size=(bgr.shape[1], bgr.shape[0]))
        picture = input_planes(letterbox.fill(bgr))
        maps, absent, line = (a[0] for a in self.logits(picture[None]))
        cells, scores = read_peaks(maps, absent)
        pixels = letterbox.picture_from_input(input_from_cell(cells))
        pixels[scores < self.least_score] = np.nan
        inner = letterbox.inner_size[0] * letterbox.inner_size[1] / STRIDE**2
        return CourtPoints(
            names=self.names, pixels=pixels, scores=scores, line_share=min(1.0, float((line > 0).sum() / inner))
        )


def input_planes(bgr: UInt8[np.ndarray, "*batch rows columns 3"]) -> np.ndarray:
    """The network's input from pictures of its size: float32 planes red, green, blue in 0..1."""
    planes = np.moveaxis(bgr[..., ::-1], -1, -3)
    return np.ascontiguousarray(planes, dtype=np.float32) / np.float32(255)
