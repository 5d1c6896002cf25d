"""The ball as detectors and people give it to the solvers: its track in the picture, and what happens to it.

`detect` and `convert` make these values, `lift` turns them into metres. Times are capture times: a repeated frame has
its source's and is no measurement of its own.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped

from pgm_data.geometry.arrays import frozen

EVENT_KINDS = ("hit", "bounce", "net", "first", "last")
"""`first` and `last`: the ball's first and last frame of a play."""
EVENT_SOURCES = ("human", "detected", "simulated")


@dataclass(frozen=True, eq=False, kw_only=True)
class BallTrack:
    """The ball in the picture, one row a frame.

    Raises:
        ValueError: If lengths differ, capture times fall, or a pixel is NaN in part or has no standard deviation.
    """

    times: Float[np.ndarray, " frames"]
    """Capture times, s; never falling."""
    is_duplicate: Bool[np.ndarray, " frames"]
    """Whether the picture repeats an earlier one; its row is then no measurement."""
    pixels: Float[np.ndarray, "frames 2"]
    """Centre of the ball (of its streak), px; NaN where it was not detected."""
    sigma_px: Float[np.ndarray, " frames"]
    """Standard deviation of each coordinate of the pixel; NaN where it was not detected."""
    score: Float[np.ndarray, " frames"]
    """Confidence 0 to 1; NaN where it was not detected."""
    streak_px: Float[np.ndarray, "frames 2"]
    """Where the ball went in the picture while the shutter was open, px, its sign unknown; NaN where not seen."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        rows = len(self.times)
        for name in ("times", "is_duplicate", "pixels", "sigma_px", "score", "streak_px"):
            values = getattr(self, name)
            object.__setattr__(self, name, frozen(values, bool if name == "is_duplicate" else np.float64))
            if len(values) != rows:
                raise ValueError(f"ball track: {name}: expected {rows} rows, got {len(values)}")
        if not np.isfinite(self.times).all() or (np.diff(self.times) < 0).any():
            raise ValueError("ball track: times: expected finite ones that never fall, got others")
        known = np.isfinite(self.pixels)
        if (known.any(axis=1) != known.all(axis=1)).any() or np.isinf(self.pixels).any():
            raise ValueError("ball track: pixels: expected both coordinates finite, or both NaN, got others")
        wrong = np.flatnonzero(known.all(axis=1) & ~((self.sigma_px > 0) & np.isfinite(self.sigma_px)))
        if len(wrong):
            got = self.sigma_px[wrong[0]]
            raise ValueError(f"ball track: sigma_px: frame {wrong[0]}: expected above 0, as it has a pixel, got {got}")

    @property
    def measured(self) -> Bool[np.ndarray, " frames"]:
        """Rows that are a measurement: the ball was detected, and the picture repeats no earlier one."""
        return np.asarray(np.isfinite(self.pixels).all(axis=1) & ~self.is_duplicate)


@dataclass(frozen=True, eq=False, kw_only=True)
class BallEvents:
    """What happens to the ball, in order of time.

    Raises:
        ValueError: If lengths differ, a kind or source is unknown, or times fall or are not finite.
    """

    times: Float[np.ndarray, " events"]
    """Capture times, s, not rounded to frames."""
    kinds: Shaped[np.ndarray, " events"]
    """Of `EVENT_KINDS`."""
    probability: Float[np.ndarray, " events"]
    """That it happened and is of this kind, 0 to 1; 1 where a person says so."""
    time_std: Float[np.ndarray, " events"]
    """Standard deviation of the time, s."""
    sources: Shaped[np.ndarray, " events"]
    """Of `EVENT_SOURCES`."""
    players: Shaped[np.ndarray, " events"]
    """Player object that hit, such as player0; empty where none did or it is not known."""
    ground_px: Float[np.ndarray, "events 2"]
    """Pixel of the ball's vertical projection on the ground at that time, by a person; NaN where not marked."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        rows = len(self.times)
        for name in ("times", "kinds", "probability", "time_std", "sources", "players", "ground_px"):
            if len(getattr(self, name)) != rows:
                raise ValueError(f"ball events: {name}: expected {rows} rows, got {len(getattr(self, name))}")
        for name in ("times", "probability", "time_std", "ground_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        for name, allowed in (("kinds", EVENT_KINDS), ("sources", EVENT_SOURCES)):
            stray = sorted(set(getattr(self, name)) - set(allowed))
            if stray:
                raise ValueError(f"ball events: {name}: expected one of {', '.join(allowed)}, got {stray[0]!r}")
        if not np.isfinite(self.times).all() or (np.diff(self.times) < 0).any():
            raise ValueError("ball events: times: expected finite ones that never fall, got others")

    def __len__(self) -> int:
        """Number of events."""
        return len(self.times)

    def take(self, index: np.ndarray) -> "BallEvents":
        """The events at those places, or where the mask is true."""
        return BallEvents(
            times=self.times[index],
            kinds=self.kinds[index],
            probability=self.probability[index],
            time_std=self.time_std[index],
            sources=self.sources[index],
            players=self.players[index],
            ground_px=self.ground_px[index],
        )


def no_events() -> BallEvents:
    """No event at all."""
    empty = np.zeros(0)
    words = np.zeros(0, dtype=object)
    return BallEvents(
        times=empty,
        kinds=words,
        probability=empty,
        time_std=empty,
        sources=words,
        players=words,
        ground_px=np.zeros((0, 2)),
    )
