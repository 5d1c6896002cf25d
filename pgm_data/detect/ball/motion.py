"""Where something small moved: candidates for the ball from a picture and two others around it, without a network.

EVIDENCE is what a picture shows at a pixel that neither of the two others shows there, in grey levels: a flying ball
leaves its whole streak in it, what stands still leaves nothing.
"""

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.ball.candidates import BallCandidates
from pgm_data.detect.ball.motion_blobs import BlobOptions, best_blobs

USUAL_HEIGHT = 720
"""Height of the pictures that lengths in pixels are stated for."""
TALL_HEIGHT = 1440
"""Pictures at least this high are looked at in a smaller copy."""
STRIP_ROWS = 64
"""Rows of a picture compared at a time."""
MOST_STRIDE = 12
"""Most pictures between one and those that it is compared with."""


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """How moving balls are looked for."""

    apart_s: float = 0.04
    """Time between a picture and those it is compared with, s: long enough for a slow ball to leave its place."""
    most: int = 6
    """Candidates a frame."""
    blobs: BlobOptions = BlobOptions()
    """What in the evidence may be a ball."""


class MotionFinder:
    """Looks for the ball by its motion. Holds a few pictures, however long the video."""

    def __init__(self, *, fps: float, options: MotionOptions | None = None) -> None:
        """Begin a clip.

        Args:
            fps: Distinct pictures a second.
            options: How.

        Raises:
            ValueError: If the rate is not above 0.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise ValueError(f"motion finder: fps: expected above 0, got {fps}")
        self._options = options or MotionOptions()
        self._stride = int(np.clip(round(self._options.apart_s * fps), 1, MOST_STRIDE))
        self._pictures: deque[_Picture] = deque(maxlen=2 * self._stride + 1)
        self._since = np.eye(3)
        self._distinct = 0
        self._rows: list[np.ndarray] = []

    def add(
        self,
        bgr: UInt8[np.ndarray, "height width 3"],
        *,
        is_duplicate: bool,
        here_from_previous: Float[np.ndarray, "3 3"] | None,
    ) -> None:
        """The next picture, which is kept a while and must not change; a repeat is not looked at."""
        if here_from_previous is not None:
            self._since = here_from_previous @ self._since
        self._rows.append(np.full((self._options.most, ROW), np.nan))
        if is_duplicate:
            return
        shrink = max(1, bgr.shape[0] // USUAL_HEIGHT) if bgr.shape[0] >= TALL_HEIGHT else 1
        if self._pictures and self._pictures[-1].full_size != bgr.shape[:2]:
            raise ValueError(f"motion finder: frame {len(self._rows) - 1}: expected one size, got {bgr.shape[:2]}")
        self._pictures.append(
            _Picture(
                row=len(self._rows) - 1,
                bgr=bgr if shrink == 1 else _shrunk(bgr, shrink),
                full_size=(bgr.shape[0], bgr.shape[1]),
                shrink=shrink,
                here_from_previous=_of_shrunk(self._since, shrink),
            )
        )
        self._since = np.eye(3)
        self._distinct += 1
        if self._distinct == 2 * self._stride + 1:  # The first ones have only later ones to be compared with.
            for at in range(self._stride):
                self._look(at, at + self._stride, 2 * self._stride)
        if self._distinct >= 2 * self._stride + 1:
            self._look(self._stride, 0, 2 * self._stride)

    def finish(self) -> BallCandidates:
        """What was found, one row for each picture that was added."""
        held = len(self._pictures)
        if self._distinct >= 2 * self._stride + 1:
            for at in range(self._stride + 1, held):
                self._look(at, 0, at - self._stride)
        elif held >= 3:  # A clip shorter than the stride asks for.
            for at in range(held):
                first, second = (0, held - 1) if 0 < at < held - 1 else (1, held - 1) if at == 0 else (0, held - 2)
                self._look(at, first, second)
        self._pictures.clear()
        rows = np.array(self._rows).reshape(len(self._rows), self._options.most, ROW)
        return BallCandidates(
            pixels=rows[:, :, 0:2], sigma_px=rows[:, :, 2], score=rows[:, :, 3], streak_px=rows[:, :, 4:6]
        )

    def _look(self, at: int, first: int, second: int) -> None:
        """Find the ball in one of the pictures held, by two others."""
        picture = self._pictures[at]
        others = [self._seen_from(at, other) for other in (first, second)]
        evidence = evidence_of(picture.bgr, others[0], others[1])
        change = picture.bgr, others[0], others[1]
        unit = picture.bgr.shape[0] / USUAL_HEIGHT
        found = best_blobs(evidence, change, unit=unit, most=self._options.most, options=self._options.blobs)
        shrink = picture.shrink
        row = self._rows[picture.row]
        row[: len(found.score), 0:2] = (found.pixels + 0.5) * shrink - 0.5
        row[: len(found.score), 2] = found.sigma_px * shrink
        row[: len(found.score), 3] = found.score
        row[: len(found.score), 4:6] = found.streak_px * shrink

    def _seen_from(self, at: int, other: int) -> UInt8[np.ndarray, "height width 3"]:
        """Another picture held, as the camera of this one would show it; this one's own pixels where it ends."""
        at_from_other = np.eye(3)
        for between in range(min(at, other) + 1, max(at, other) + 1):
            at_from_other = self._pictures[between].here_from_previous @ at_from_other
        if other > at:
            at_from_other = np.linalg.inv(at_from_other)
        here, there = self._pictures[at].bgr, self._pictures[other].bgr
        if np.allclose(at_from_other / at_from_other[2, 2], np.eye(3), rtol=0, atol=1e-9):
            return there
        return cv2.warpPerspective(
            there,
            at_from_other,
            (here.shape[1], here.shape[0]),
            dst=here.copy(),
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )


ROW = 6
"""Numbers that are kept of a candidate: pixel, sigma, score, streak."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Picture:
    """A picture held."""

    row: int
    bgr: np.ndarray
    full_size: tuple[int, int]
    shrink: int
    here_from_previous: np.ndarray
    """Pixels of the distinct picture before, in those of this one."""


def evidence_of(
    bgr: UInt8[np.ndarray, "height width 3"],
    before: UInt8[np.ndarray, "height width 3"],
    after: UInt8[np.ndarray, "height width 3"],
) -> UInt8[np.ndarray, "height width"]:
    """By how much each pixel differs from both others in the same sense, averaged over the colours, grey levels."""
    evidence = np.empty(bgr.shape[:2], np.uint8)
    for top in range(0, len(bgr), STRIP_ROWS):  # In strips that stay in the processor's cache.
        rows = slice(top, top + STRIP_ROWS)
        brighter = cv2.subtract(bgr[rows], cv2.max(before[rows], after[rows]))
        darker = cv2.subtract(cv2.min(before[rows], after[rows]), bgr[rows])
        cv2.cvtColor(cv2.add(brighter, darker), cv2.COLOR_BGR2GRAY, dst=evidence[rows])
    return evidence


def _shrunk(bgr: np.ndarray, by: int) -> np.ndarray:
    height, width = bgr.shape[0] // by, bgr.shape[1] // by
    return cv2.resize(bgr[: height * by, : width * by], (width, height), interpolation=cv2.INTER_AREA)


def _of_shrunk(homography: np.ndarray, by: int) -> np.ndarray:
    """The homography between the shrunk pictures."""
    if by == 1:
        return homography
    full_from_small = np.array([[by, 0, (by - 1) / 2], [0, by, (by - 1) / 2], [0, 0, 1.0]])
    return np.linalg.inv(full_from_small) @ homography @ full_from_small
