"""The ball's candidates in each frame, by the network that `pgm-train ball` trained.

The network sees a frame, the one before and the one after. Pictures wider than it was trained on are shrunk; their
edges are repeated until the size is one that it takes. Pixel centres are at integers throughout.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.ball.candidates import BallCandidates
from pgm_data.detect.ball.streaks import streaks_at
from pgm_data.detect.onnx_file import network_file, open_network

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

BALL_NETWORK = "ball.onnx"
"""File name of the network that ships with the package."""
STRIDE = 4
"""Input pixels per cell of the answers."""
MULTIPLE = 16
"""Of which the input's width and height are multiples."""
CHANNELS = ("ball", "right", "down", "log_sigma")
"""Of the answers: logit of a ball; its place from the cell's centre and the logarithm of its standard deviation, cells.
"""
APART = 2
"""Cells on each side of a candidate in which no weaker one counts."""
MOVED_PX = 0.2
"""A neighbouring frame that lies this close to the frame in every corner is taken as it is, input pixels."""


@dataclass(frozen=True, kw_only=True)
class BallNetworkOptions:
    """How pictures are shown to the network and how many candidates are kept."""

    widest: int = 1280
    """Pictures wider than this are shrunk to it, pixels; the ball is 3 to 6 pixels wide at 1280."""
    most: int = 4
    """Candidates a frame."""
    least_score: float = 0.01
    """Candidates under this probability are left out."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallInput:
    """How a picture becomes the network's input.

    Raises:
        ValueError: If the picture is empty.
    """

    picture_size: tuple[int, int]
    """Width and height of the picture, pixels."""
    widest: int
    """Pictures wider than this are shrunk to it, pixels."""

    def __post_init__(self) -> None:
        """Check the size."""
        if min(self.picture_size) < 1:
            raise ValueError(f"picture: expected at least one pixel, got {self.picture_size[0]}x{self.picture_size[1]}")

    @property
    def inner_size(self) -> tuple[int, int]:
        """Width and height of the picture inside the input, whole pixels."""
        width, height = self.picture_size
        share = min(1.0, self.widest / width)
        return max(1, round(width * share)), max(1, round(height * share))

    @property
    def input_size(self) -> tuple[int, int]:
        """Width and height of the input: multiples of `MULTIPLE`."""
        width, height = self.inner_size
        return -(-width // MULTIPLE) * MULTIPLE, -(-height // MULTIPLE) * MULTIPLE

    @property
    def scale(self) -> Float[np.ndarray, " 2"]:
        """Input pixels per picture pixel along x and y."""
        return np.array(self.inner_size, dtype=float) / np.array(self.picture_size, dtype=float)

    def picture_from_input(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Picture pixels of input pixels; half a pixel lies between a pixel's centre and its edge."""
        return (pixels + 0.5) / self.scale - 0.5

    def input_from_picture(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Input pixels of picture pixels: the inverse of `picture_from_input`."""
        return (pixels + 0.5) * self.scale - 0.5

    def carried(self, map_px: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
        """A map of picture pixels as one of input pixels."""
        forth = np.diag([*self.scale, 1.0])
        forth[:2, 2] = 0.5 * self.scale - 0.5
        return forth @ map_px @ np.linalg.inv(forth)

    def planes(self, bgr: UInt8[np.ndarray, "height width 3"]) -> "Planes":
        """The input's share of one picture."""
        size, (wide, high) = self.inner_size, self.input_size
        if size != self.picture_size:
            bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        if size != (wide, high):
            bgr = np.asarray(
                cv2.copyMakeBorder(bgr, 0, high - size[1], 0, wide - size[0], cv2.BORDER_REPLICATE), dtype=np.uint8
            )
        return picture_planes(bgr)


@dataclass(frozen=True, eq=False, kw_only=True)
class Planes:
    """A picture as brightness and colour."""

    grey: UInt8[np.ndarray, "height width"]
    """Brightness Y, ITU-R BT.601, 16 to 235."""
    colour: UInt8[np.ndarray, "2 half_height half_width"]
    """Colour differences U and V, 128 where grey."""


def picture_planes(bgr: UInt8[np.ndarray, "height width 3"]) -> Planes:
    """Brightness and colour of a picture whose height is a multiple of 4 and whose width is even."""
    height, width = bgr.shape[:2]
    yuv = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420), dtype=np.uint8)
    return Planes(grey=yuv[:height], colour=yuv[height:].reshape(2, height // 2, width // 2))


def aligned(
    grey: UInt8[np.ndarray, "height width"],
    here_from_there: Float[np.ndarray, "3 3"] | None,
    here: UInt8[np.ndarray, "height width"],
) -> UInt8[np.ndarray, "height width"]:
    """A neighbour's brightness moved onto this frame's; where it shows nothing, this frame's own."""
    if here_from_there is None:
        return grey
    rows, columns = grey.shape
    corners = np.array([[0, 0, 1], [columns, 0, 1], [columns, rows, 1], [0, rows, 1]], dtype=float)
    moved = corners @ here_from_there.T
    if (moved[:, 2] <= 0).any():
        return here  # it looks elsewhere altogether
    if np.abs(moved[:, :2] / moved[:, 2:] - corners[:, :2]).max() < MOVED_PX:
        return grey
    seen = here.copy()
    cv2.warpPerspective(
        grey, here_from_there, (columns, rows), dst=seen, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
    )
    return seen


@dataclass(frozen=True, eq=False, kw_only=True)
class Peaks:
    """The strongest places of one frame, best first, input pixels."""

    logits: Float[np.ndarray, " most"]
    """Of a ball; NaN where there are fewer peaks than asked for."""
    pixels: Float[np.ndarray, "most 2"]
    sigma_px: Float[np.ndarray, " most"]


def read_peaks(answers: Float[np.ndarray, "channels rows columns"], most: int) -> Peaks:
    """The places where a ball is most likely, no two within `APART` cells along both axes."""
    ball = np.ascontiguousarray(answers[0], dtype=np.float32)
    size = 2 * APART + 1
    highest = np.asarray(cv2.dilate(ball, np.ones((size, size), np.uint8)))
    rows, columns = np.nonzero(ball >= highest)
    logits = ball[rows, columns]
    order = np.argsort(-logits, kind="stable")
    kept: list[int] = []
    for i in order:  # on a plateau all cells are peaks: the first stands for those near it
        near = [j for j in kept if abs(rows[i] - rows[j]) <= APART and abs(columns[i] - columns[j]) <= APART]
        if not near:
            kept.append(int(i))
        if len(kept) == most:
            break
    said = answers[:, rows[kept], columns[kept]].astype(float)
    cells = np.stack([columns[kept] + said[1], rows[kept] + said[2]], axis=1)
    peaks = Peaks(
        logits=np.full(most, np.nan),
        pixels=np.full((most, 2), np.nan),
        sigma_px=np.full(most, np.nan),
    )
    count = len(kept)
    peaks.logits[:count] = said[0]
    peaks.pixels[:count] = (cells + 0.5) * STRIDE - 0.5
    peaks.sigma_px[:count] = STRIDE * np.exp(said[3])
    return peaks


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a network's own words are worth, measured on pictures it was not trained on."""

    slope: float = 1.0
    """Of the logit of the true probability over the network's logit."""
    shift: float = 0.0
    """The logit of the true probability where the network's is 0."""
    sigma: float = 1.0
    """True standard deviation over the stated one."""

    def probability(self, logits: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Of a ball, from the network's logits."""
        return np.asarray(1 / (1 + np.exp(-np.clip(self.slope * logits + self.shift, -60, 60))))


class BallNetwork:
    """A loaded network."""

    def __init__(self, session: "InferenceSession", calibration: Calibration) -> None:
        """Use `load`."""
        self._session = session
        self.calibration = calibration
        """From the file."""

    @classmethod
    def load(cls, path: Path | None = None, *, threads: int = 2) -> "BallNetwork":
        """The network in that file, or the one that ships with the package.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is not a ball network.
        """
        with network_file(path, shipped=BALL_NETWORK, what="ball network") as file:
            session = open_network(file, threads=threads, what="ball network")
            about = session.get_modelmeta().custom_metadata_map
            inputs = [i.name for i in session.get_inputs()]
            if "ball_channels" not in about or "calibration" not in about or inputs != ["grey", "colour"]:
                raise ValueError(
                    f"ball network {file}: expected ball_channels and calibration in its metadata and the inputs grey "
                    f"and colour, found metadata {sorted(about)} and inputs {inputs}"
                )
            channels = tuple(json.loads(about["ball_channels"]))
            if channels != CHANNELS:
                raise ValueError(f"ball network {file}: expected the answers {CHANNELS}, found {channels}")
            return cls(session, Calibration(**json.loads(about["calibration"])))

    def answers(
        self,
        grey: UInt8[np.ndarray, "1 3 height width"],
        colour: UInt8[np.ndarray, "1 2 half_height half_width"],
    ) -> Float[np.ndarray, "1 channels rows columns"]:
        """The network's own answers (`CHANNELS`), from brightness before, in and after the frame, and its colour."""
        (answers,) = self._session.run(["answers"], {"grey": grey, "colour": colour})
        return np.asarray(answers)


class NetworkFinder:
    """Candidates of a ball by a network, frame by frame; a `CandidateFinder`.

    A frame is looked at when the next one comes. The first one has only the frame after it, the last one only the
    frame before it.
    """

    def __init__(self, network: BallNetwork, options: BallNetworkOptions | None = None) -> None:
        """Nothing seen yet."""
        self._network = network
        self._options = options or BallNetworkOptions()
        self._input: BallInput | None = None
        self._before: UInt8[np.ndarray, "rows columns"] | None = None
        self._now: Planes | None = None
        self._now_from_before: np.ndarray | None = None
        self._turned: np.ndarray | None = None
        self._now_index = -1
        self._rows: list[tuple[Peaks, np.ndarray] | None] = []

    def add(
        self,
        bgr: UInt8[np.ndarray, "height width 3"],
        *,
        is_duplicate: bool,
        here_from_previous: Float[np.ndarray, "3 3"] | None,
    ) -> None:
        """The next picture; see `CandidateFinder`.

        Raises:
            ValueError: If it has another size than the first.
        """
        size = (bgr.shape[1], bgr.shape[0])
        if self._input is None:
            self._input = BallInput(picture_size=size, widest=self._options.widest)
        if size != self._input.picture_size:
            raise ValueError(
                f"frame {len(self._rows)}: expected a picture of {self._input.picture_size[0]}x"
                f"{self._input.picture_size[1]} as before, got {size[0]}x{size[1]}"
            )
        self._rows.append(None)
        if here_from_previous is not None:
            turn = self._input.carried(here_from_previous)
            self._turned = turn if self._turned is None else turn @ self._turned
        if is_duplicate:
            return
        planes = self._input.planes(bgr)
        if self._now is not None:
            back = None if self._turned is None else np.linalg.inv(self._turned)
            self._look(aligned(planes.grey, back, self._now.grey))
            self._before = self._now.grey
        self._now, self._now_index = planes, len(self._rows) - 1
        self._now_from_before, self._turned = self._turned, None

    def finish(self) -> BallCandidates:
        """What was found, one row for each picture that was added."""
        if self._now is not None:
            self._look(None)
            self._now = None
        most, count = self._options.most, len(self._rows)
        pixels, streaks = np.full((count, most, 2), np.nan), np.full((count, most, 2), np.nan)
        sigma, score = np.full((count, most), np.nan), np.full((count, most), np.nan)
        for row, seen in enumerate(self._rows):
            if seen is None or self._input is None:
                continue
            peaks, streak = seen
            said = self._network.calibration.probability(peaks.logits)
            kept = np.where(said >= self._options.least_score, 1.0, np.nan)
            pixels[row] = self._input.picture_from_input(peaks.pixels) * kept[:, None]
            streaks[row] = streak / self._input.scale * kept[:, None]
            sigma[row] = self._network.calibration.sigma * peaks.sigma_px / self._input.scale.mean() * kept
            score[row] = said * kept
        return BallCandidates(pixels=pixels, sigma_px=sigma, score=score, streak_px=streaks)

    def _look(self, after: np.ndarray | None) -> None:
        """Find candidates in the frame that was waiting, its neighbour after it given as it lies on it."""
        now = self._now
        assert now is not None, "only called while a frame waits"
        before = self._before
        if before is not None:
            before = aligned(before, self._now_from_before, now.grey)
        if before is None:
            before = now.grey if after is None else after
        if after is None:
            after = before
        grey = np.stack([before, now.grey, after])
        answers = self._network.answers(grey[None], np.ascontiguousarray(now.colour)[None])
        peaks = read_peaks(answers[0], self._options.most)
        self._rows[self._now_index] = (peaks, streaks_at(grey, peaks.pixels))
