"""Where the player of one shot is at every time: stretches of one kind of motion, joined without gaps."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.simulate.blocks.moves import Arc

StretchKind = Literal["stand", "turn", "walk", "sprint", "jump", "fall", "climb_up", "climb_down"]
KINDS: tuple[StretchKind, ...] = ("stand", "turn", "walk", "sprint", "jump", "fall", "climb_up", "climb_down")
TICK_S = 0.01
"""Spacing of the knots between which headings are interpolated."""
HEADING_SPREAD_S = 0.06
"""Headings are smoothed by a bell of this width."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Stretch:
    """One piece of a course."""

    kind: StretchKind
    times: Float[np.ndarray, " knots"]
    """Seconds of the shot, rising."""
    points: Float[np.ndarray, "knots 3"]
    """Middle of the soles, world metres."""
    grounded: Bool[np.ndarray, " knots"]
    """Whether the player walks or stands, and is not in the air or on a ladder."""
    headings: Float[np.ndarray, " knots"]
    """Where the player turns, radians as `rotations.facing`."""
    arc: Arc | None = None
    """Of jumps and falls; exact between the knots."""
    goal: int = -1
    """Index of the element that the player is on the way to; -1 where there is none."""
    lands_on: int = -1
    """Of jumps, falls and climbs: the element that it ends on."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """A whole shot's motion, to be read at any time from 0 to its end."""

    stretches: tuple[Stretch, ...]
    starts: Float[np.ndarray, " stretches"]
    knot_times: Float[np.ndarray, " knots"]
    knot_points: Float[np.ndarray, "knots 3"]
    knot_grounded: Float[np.ndarray, " knots"]
    tick_headings: Float[np.ndarray, " ticks"]
    """Smoothed and unwrapped, every `TICK_S` from 0."""

    @property
    def end(self) -> float:
        """Seconds."""
        return float(self.knot_times[-1])

    def stretch_at(self, times: Float[np.ndarray, " times"]) -> Int[np.ndarray, " times"]:
        """Index of the stretch that holds each time."""
        return np.clip(np.searchsorted(self.starts, times, side="right") - 1, 0, len(self.stretches) - 1)

    def feet_at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times 3"]:
        """Middle of the soles, world metres: exact in the air, linear between knots about a centimetre apart else."""
        feet = np.column_stack([np.interp(times, self.knot_times, self.knot_points[:, axis]) for axis in range(3)])
        index = self.stretch_at(times)
        for number in np.unique(index):
            stretch = self.stretches[number]
            if stretch.arc is not None:
                inside = index == number
                feet[inside] = stretch.arc.at(np.minimum(times[inside] - stretch.times[0], stretch.arc.duration))
        return feet

    def heading_at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
        """Where the body looks, radians as `rotations.facing`, unwrapped."""
        return np.interp(times, TICK_S * np.arange(len(self.tick_headings)), self.tick_headings)

    def grounded_at(self, times: Float[np.ndarray, " times"]) -> Bool[np.ndarray, " times"]:
        """Whether the player stands, turns or walks, and is not in the air or on a ladder."""
        before = np.clip(np.searchsorted(self.knot_times, times, side="right") - 1, 0, len(self.knot_times) - 1)
        after = np.minimum(before + (times > self.knot_times[before]), len(self.knot_times) - 1)
        return (self.knot_grounded[before] > 0.5) & (self.knot_grounded[after] > 0.5)

    def kind_at(self, times: Float[np.ndarray, " times"]) -> Int[np.ndarray, " times"]:
        """Index into `KINDS` of the motion at each time."""
        return np.array([KINDS.index(s.kind) for s in self.stretches])[self.stretch_at(times)]


def joined(stretches: list[Stretch]) -> Course:
    """The course of stretches that follow one another."""
    times = np.concatenate([s.times for s in stretches])
    headings = np.concatenate([s.headings for s in stretches])
    ticks = np.arange(0.0, float(times[-1]) + TICK_S, TICK_S)
    # Whole turns that a stretch makes on purpose stay; between stretches the shorter way round is taken.
    rough = np.interp(ticks, times, np.unwrap(headings))
    return Course(
        stretches=tuple(stretches),
        starts=np.array([s.times[0] for s in stretches]),
        knot_times=times,
        knot_points=np.vstack([s.points for s in stretches]),
        knot_grounded=np.concatenate([s.grounded for s in stretches]).astype(float),
        tick_headings=smooth(rough, HEADING_SPREAD_S / TICK_S),
    )


def smooth(values: Float[np.ndarray, " values"], spread: float) -> Float[np.ndarray, " values"]:
    """Weighted running mean under a bell whose standard deviation is so many steps; the ends are held."""
    reach = int(np.ceil(3 * spread))
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / spread) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), bell / bell.sum(), mode="valid")
