"""Candidates that complete a track: in frames between those of the track, where its parabolas from both sides lead."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.detect.ball.link_lattice import Lattice
from pgm_data.detect.ball.link_tracklets import MotionModel, parabolas

SUPPORT = 4
"""Candidates of the track, before or after the frame, through which the parabola goes."""


@dataclass(frozen=True, kw_only=True)
class FillModel:
    """When a candidate completes the track."""

    reach_s: float = 0.12
    """Furthest in time from a candidate of the track, s; the neighbouring picture is always reached."""
    least_worth: float = 0.0
    """Least log likelihood ratio, the share of the score included."""
    gate: float = 3.0
    """Furthest from where the parabola leads, standard deviations."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Filled:
    """Candidates that complete the track."""

    picture: Int[np.ndarray, " added"]
    slot: Int[np.ndarray, " added"]
    owner: Int[np.ndarray, " added"]
    """Flight that each joins."""
    worth: Float[np.ndarray, " added"]
    """Log likelihood ratio of the ball to something else."""


def filled(
    lattice: Lattice,
    picture: Int[np.ndarray, " nodes"],
    slot: Int[np.ndarray, " nodes"],
    owner: Int[np.ndarray, " nodes"],
    height: float,
    motion: MotionModel,
    model: FillModel,
) -> Filled:
    """The best candidate of each picture without one that lies where the track leads.

    Args:
        lattice: The candidates.
        picture: Pictures in which the track has one, going up.
        slot: Which.
        owner: Flight of each.
        height: Of the picture, px.
        motion: How the ball moves.
        model: What completes the track.
    """
    empty = np.setdiff1d(np.arange(len(lattice.times)), picture)
    slots = lattice.has.shape[1]
    if not len(picture) or not len(empty) or not slots:
        none = np.zeros(0, dtype=np.int64)
        return Filled(picture=none, slot=none, owner=none, worth=np.zeros(0))
    after = np.searchsorted(picture, empty)
    best = np.full((len(empty), slots), -np.inf)
    joined = np.zeros((len(empty), slots), dtype=np.int64)
    for side in (-1, 1):
        index = after[:, None] + (np.arange(SUPPORT) if side > 0 else -1 - np.arange(SUPPORT))
        inside = (index >= 0) & (index < len(picture))
        index = np.clip(index, 0, len(picture) - 1)
        nearest = index[:, :1]
        away = np.abs(lattice.times[picture[nearest]] - lattice.times[empty][:, None])
        reached = (away <= model.reach_s) | (np.abs(picture[nearest] - empty[:, None]) == 1)
        inside &= (owner[index] == owner[nearest]) & reached
        can = inside.sum(axis=1) >= 2
        origin = lattice.points[picture[nearest[:, 0]], slot[nearest[:, 0]]]
        fit = parabolas(
            (lattice.times[picture[index]] - lattice.times[empty][:, None]),
            lattice.points[picture[index], slot[index]] - origin[:, None],
            np.where(inside, 1 / lattice.variance[picture[index], slot[index]], 0.0),
            unit=lattice.frame_s,
            height=height,
            model=motion,
        )
        spread = fit.variance[:, None] + lattice.variance[empty]
        off = lattice.points[empty] - (origin + fit.place)[:, None]
        chi2 = (off**2).sum(axis=2) / spread
        worth = -chi2 / 2 - np.log(2 * np.pi * spread) - lattice.log_clutter[empty]
        worth = worth + motion.score_share * lattice.log_odds[empty]
        fits = lattice.has[empty] & can[:, None] & (chi2 <= model.gate**2)
        better = fits & (worth > best)
        best = np.where(better, worth, best)
        joined = np.where(better, owner[nearest], joined)
    chosen = best.argmax(axis=1)
    worth = best[np.arange(len(empty)), chosen]
    good = worth >= model.least_worth
    owner_of = joined[np.arange(len(empty)), chosen]
    return Filled(picture=empty[good], slot=chosen[good], owner=owner_of[good], worth=worth[good])
