"""Where the ball may be in each frame: what detectors find and linking chooses from."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class BallCandidates:
    """Some places a frame, best first; NaN where a frame has fewer, and in repeated frames."""

    pixels: Float[np.ndarray, "frames most 2"]
    """Centre of the ball (of its streak), px of the full picture."""
    sigma_px: Float[np.ndarray, "frames most"]
    """Standard deviation of each coordinate."""
    score: Float[np.ndarray, "frames most"]
    """Probability that it is the ball, 0 to 1."""
    streak_px: Float[np.ndarray, "frames most 2"]
    """Where it went while the shutter was open, px, its sign unknown; NaN where not seen."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the lengths."""
        for name in ("pixels", "sigma_px", "score", "streak_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        shape = self.score.shape
        for name, expected in (("pixels", (*shape, 2)), ("sigma_px", shape), ("streak_px", (*shape, 2))):
            if getattr(self, name).shape != expected:
                raise ValueError(f"ball candidates: {name}: expected {expected}, got {getattr(self, name).shape}")


@runtime_checkable
class CandidateFinder(Protocol):
    """Looks for the ball in pictures that come one by one; keeps no more of them than it needs."""

    def add(
        self,
        bgr: UInt8[np.ndarray, "height width 3"],
        *,
        is_duplicate: bool,
        here_from_previous: Float[np.ndarray, "3 3"] | None,
    ) -> None:
        """The next picture. `here_from_previous` takes pixels of the picture before to those of this one where the
        camera turned; None where it stood still. A repeat is not looked at.
        """
        ...

    def finish(self) -> BallCandidates:
        """What was found, one row for each picture that was added."""
        ...
