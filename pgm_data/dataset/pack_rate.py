"""The frame rate of a dataset, and whether all of its clips keep it."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

TOLERANCE_S = 1e-4
"""How far LeRobot lets a frame's time be from its number over the rate."""
UNKNOWN_RATE = 1.0
"""Written where no clip has two frames, since the layout wants a number."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Frames per second of a dataset."""

    frames_per_second: float
    """That of most frames."""
    constant: bool
    """Whether every frame of every clip is within 0.1 ms of it."""


class RateCount:
    """Gathers the rates of clips."""

    def __init__(self) -> None:
        self._frames: Counter[float] = Counter()
        self._steady = True

    def add(self, timestamps: Float[np.ndarray, " frames"]) -> float:
        """Take in a clip's presentation times; its own rate, NaN of a single frame."""
        if len(timestamps) < 2:
            return float("nan")
        steps = np.arange(len(timestamps))
        rate = common_rate((len(timestamps) - 1) / float(timestamps[-1] - timestamps[0]))
        self._steady &= bool(np.abs(timestamps - timestamps[0] - steps / rate).max() <= TOLERANCE_S)
        self._frames[rate] += len(timestamps)
        return rate

    def rate(self) -> Rate:
        """Of all clips so far."""
        if not self._frames:
            return Rate(frames_per_second=UNKNOWN_RATE, constant=False)
        most = max(sorted(self._frames), key=self._frames.__getitem__)
        return Rate(frames_per_second=most, constant=self._steady and len(self._frames) == 1)


def common_rate(rate: float) -> float:
    """The rate that was meant: a whole number, or one over 1.001, where it is within 0.02 % of it."""
    whole = max(round(rate), 1)
    ntsc = max(round(rate * 1.001), 1) / 1.001
    near = min((whole, ntsc), key=lambda candidate: abs(candidate - rate))
    return float(near) if abs(near - rate) <= 2e-4 * rate else round(rate, 6)
