"""Stances of feet in motion that is noisy: when a foot is meant to stand, and where its sole rests meanwhile."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.players.contact import ContactLaw, contact_probability

SLOW_SHARE = 0.25
"""Share of the time in which a foot is taken to be slow: how slow says how fast a standing foot may seem."""
SPEEDS = (0.25, 2.0)
"""Least and most that a standing foot may seem to move, standard deviation of each component, m/s."""
FURTHEST_M = 0.25
"""Most that a standing foot may seem to move between frames."""
ERRING_M = 0.02
"""Error of heights of motion that is not to be trusted with what touches the ground."""
LONG_STEP_M = 0.5
"""A foot that gets further than this from frame to frame does not stand in both."""
STILL_M = 0.02
"""Frames at the ends of a stance that are further than this from its place are not of it."""
SMOOTHED_S = 0.1
"""Most to either side over which places are averaged before speeds are taken."""
LOWEST_M = 0.01
"""Height difference over which the points of a sole share in its speed."""


@dataclass(frozen=True, kw_only=True)
class Stance:
    """A foot that stands."""

    foot: int
    """0 left, 1 right."""
    first: int
    """Frame."""
    last: int
    """Frame, inclusive."""

    @property
    def frames(self) -> slice:
        """Of the stance."""
        return slice(self.first, self.last + 1)


@dataclass(frozen=True, kw_only=True)
class StanceOptions:
    """What counts as a stance."""

    stays_s: float = 0.15
    """Mean time that a foot stands, or swings."""
    share: float = 0.55
    """Of the time that feet stand."""
    doubtful_share: float = 0.3
    """More than that of motion whose heights err, in which stances are hard to see."""
    gap_s: float = 0.05
    """Shorter breaks in a stance are closed where the foot returns to where it was, seconds."""
    drift_m: float = 0.45
    """A stance that strays further in all is taken as several steps, however much heights err."""
    steady_drift_m: float = 0.08
    """The same of motion whose heights do not err."""
    step_s: float = 0.08
    """Time between those."""


def height_error(
    soles: Float[np.ndarray, "feet frames points 3"], times: Float[np.ndarray, " frames"], floor_z: float
) -> float:
    """How far heights of soles over the ground err, metres.

    What is below it must be an error; and where no foot is ever slow, heights are not to be trusted either.
    """
    below = np.minimum(soles[..., 2].min(axis=-1) - floor_z, 0.0)
    seen = float(np.sqrt(np.mean(below**2)))
    if len(times) < 2:
        return seen
    slow = min(_slow(_velocity(foot[..., :2], np.full(foot.shape[:2], 1 / foot.shape[1]), times)) for foot in soles)
    return max(seen, ERRING_M * float(np.clip(slow / SPEEDS[0] - 1.0, 0.0, 1.0)))


def _slow(velocity: Float[np.ndarray, "intervals 2"]) -> float:
    """Speed in the slower part of the time, m/s."""
    return float(np.quantile(np.linalg.norm(velocity, axis=1), SLOW_SHARE)) if len(velocity) else 0.0


def stances(
    soles: Float[np.ndarray, "frames points 3"],
    times: Float[np.ndarray, " frames"],
    floor_z: float,
    error_m: float,
    options: StanceOptions,
    foot: int,
) -> list[Stance]:
    """The stances of one foot.

    Low and slow against the rest of its motion: the slower quarter of the time says how much a standing foot seems to
    move, soles below the ground how far heights err; a hidden Markov model of two states then tells them apart.

    Args:
        soles: Points of the sole, world metres.
        times: s, rising.
        floor_z: Height of the ground.
        error_m: Of heights.
        options: What counts.
        foot: Its number.
    """
    height = soles[..., 2].min(axis=1) - floor_z
    weight = np.exp(-(soles[..., 2] - soles[..., 2].min(axis=1, keepdims=True)) / (LOWEST_M + error_m))
    velocity = _velocity(soles[..., :2], weight / weight.sum(axis=1, keepdims=True), times)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    planted = float(np.clip(_slow(velocity), SPEEDS[0], max(SPEEDS[0], min(SPEEDS[1], FURTHEST_M / step))))
    fast = float(np.sqrt(np.mean(velocity**2))) if len(velocity) else 0.0
    law = ContactLaw(
        planted_height_m=float(np.hypot(0.012, 1.5 * error_m)),
        free_height_m=0.15 + error_m,
        planted_speed=planted,
        free_speed=max(1.5, 1.5 * fast, 1.5 * planted),
        stays_s=options.stays_s,
        planted=options.share + options.doubtful_share * min(1.0, error_m / ERRING_M),
    )
    stands = contact_probability(
        law,
        height=np.where(height < 0, 0.0, height),
        height_var=np.zeros(len(times)),
        velocity=velocity,
        velocity_cov=np.zeros((len(velocity), 2, 2)),
        times=times,
    )
    level = soles[..., :2].mean(axis=1)
    drift = min(options.drift_m, options.steady_drift_m + 6 * error_m)
    level = averaged(level, 1) if error_m > options.steady_drift_m / 8 else level
    found = _closed(runs(stands > 0.5), level, times, drift, options)
    gap = int(options.step_s / step + 0.5)
    least = 2 if step < options.step_s else 1
    pieces = [piece for run in found for piece in _steps(run, level, drift, gap, least)]
    near = STILL_M + 6 * error_m
    pieces = [_trimmed(piece, level, height, near) for piece in pieces]
    return [Stance(foot=foot, first=first, last=last) for first, last in pieces]


def kept_up(standing: Sequence[Stance], lost: Bool[np.ndarray, "frames feet"]) -> tuple[list[Stance], list[Stance]]:
    """Stances without their lost frames, the longest stretch of each; and what of them is given up."""
    kept, dropped = [], []
    for stance in standing:
        bad = np.flatnonzero(lost[stance.frames, stance.foot]) + stance.first
        if not len(bad):
            kept.append(stance)
            continue
        edges = np.concatenate([[stance.first - 1], bad, [stance.last + 1]])
        longest = int(np.argmax(np.diff(edges)))
        first, last = int(edges[longest]) + 1, int(edges[longest + 1]) - 1
        if first <= last:
            kept.append(replace(stance, first=first, last=last))
        ends = [(stance.first, first - 1), (last + 1, stance.last)] if first <= last else [(stance.first, stance.last)]
        dropped += [replace(stance, first=a, last=b) for a, b in ends if a <= b]
    return kept, dropped


def runs(flags: Bool[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """First and last frame of each unbroken stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def averaged(values: Float[np.ndarray, "frames n"], half: int) -> Float[np.ndarray, "frames n"]:
    """Means over so many frames to either side, as many as there are on both at the ends."""
    if half == 0 or len(values) < 3:
        return values
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    index = np.arange(len(values))
    reach = np.minimum(half, np.minimum(index, len(values) - 1 - index))
    return (sums[index + reach + 1] - sums[index - reach]) / (2 * reach + 1)[:, None]


def _velocity(
    level: Float[np.ndarray, "frames points 2"],
    weight: Float[np.ndarray, "frames points"],
    times: Float[np.ndarray, " frames"],
) -> Float[np.ndarray, "intervals 2"]:
    """Of the lowest points of a sole, m/s; smoothed no more than it takes until slow phases are slow."""
    frames, points, _ = level.shape
    if frames < 2:
        return np.zeros((0, 2))
    step = np.diff(times)
    most = int(SMOOTHED_S / float(np.median(step)) + 1e-6)
    shares = 0.5 * (weight[1:] + weight[:-1])
    velocity = np.zeros((frames - 1, 2))
    for half in range(most + 1):
        placed = averaged(level.reshape(frames, -1), half).reshape(frames, points, 2)
        velocity = (shares[..., None] * np.diff(placed, axis=0)).sum(axis=1) / step[:, None]
        if _slow(velocity) < SPEEDS[0]:
            break
    return velocity


def _closed(
    found: list[tuple[int, int]], level: np.ndarray, times: np.ndarray, drift: float, options: StanceOptions
) -> list[tuple[int, int]]:
    """Stances whose breaks are too short to be a swing, joined."""
    joined: list[tuple[int, int]] = []
    for first, last in found:
        if joined:
            before = joined[-1]
            short = times[first] - times[before[1]] <= options.gap_s + 1.5 * float(np.median(np.diff(times)))
            near = np.linalg.norm(level[first] - level[before[1]]) < drift
            if short and near and first - before[1] <= 3:
                joined[-1] = (before[0], last)
                continue
        joined.append((first, last))
    return joined


def _trimmed(
    piece: tuple[int, int], level: Float[np.ndarray, "frames 2"], height: Float[np.ndarray, " frames"], near: float
) -> tuple[int, int]:
    """The stance without frames at its ends in which the foot is still on its way, or off already."""
    rows = slice(piece[0], piece[1] + 1)
    off = np.hypot(np.linalg.norm(level[rows] - np.median(level[rows], axis=0), axis=1), np.maximum(height[rows], 0.0))
    there = np.flatnonzero(off <= near)
    return (piece[0] + int(there[0]), piece[0] + int(there[-1])) if len(there) else piece


def _steps(
    run: tuple[int, int], level: Float[np.ndarray, "frames 2"], drift: float, gap: int, least: int
) -> list[tuple[int, int]]:
    """The stance, or several with so many frames between them where it strays too far: cut where that fits best."""
    first, last = run
    own = level[first : last + 1]
    count = len(own)
    if count < 2 or np.linalg.norm(own.max(axis=0) - own.min(axis=0)) <= drift:
        return [run]
    sums = np.cumsum(own, axis=0)[:-1]
    before = np.arange(1, count)[:, None]
    apart = sums / before - (sums[-1] + own[-1] - sums) / (count - before)
    cut = first + 1 + int(np.argmax((before * (count - before))[:, 0] * (apart**2).sum(axis=1)))
    # At low rates a step takes less than the time between frames, unless it is a long one.
    gap = gap or int(np.linalg.norm(level[cut] - level[cut - 1]) > LONG_STEP_M)
    left, right = (first, cut - 1 - gap // 2), (cut + (gap - gap // 2), last)
    return [
        piece
        for side in (left, right)
        if side[1] - side[0] + 1 >= least
        for piece in _steps(side, level, drift, gap, least)
    ]
