"""Left and right of a body over time: a network that sees a back or crossing legs takes one for the other at times."""

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.detect.pose.model import mirrored

LEGS = ("hip", "knee", "ankle", "heel", "big_toe")
"""What changes sides together; the rest of the body is the other such part."""
LIMB_SPEED = 2.0
"""Rms speed of a player's points against the body's middle, body heights a second."""
LEAST_SCATTER = 0.015
"""Of the points from frame to frame, body heights, whatever the network says."""
OUTLIER = 4.0
"""Deviations beyond which a point says nothing more."""
INDEPENDENT = 3.0
"""Points of one part move together: all of them count as so many."""
STATES = np.array([[0, 0], [1, 1], [1, 0], [0, 1]])
"""Whether upper body and legs are swapped."""
SHARES = np.array([0.5, 0.25, 0.25])
"""Of the times that the network goes wrong, those in which all is swapped, the upper body alone, the legs alone."""
STAYS_WRONG = 0.6
"""Probability that a network that has it wrong has it wrong in the next frame too."""


def swapped_points(
    points_px: Float[np.ndarray, "frames points 2"],
    height_px: Float[np.ndarray, " frames"],
    time_s: Float[np.ndarray, " frames"],
    names: tuple[str, ...],
    *,
    chance: float,
) -> Bool[np.ndarray, "frames points"]:
    """Which points are the wrong way round, left for right, by the likeliest course of all frames together.

    Nothing moves but names: the partners' places are exchanged. Where the course fits both ways round, as of a body
    seen from its side, the network's word stands. Upper body and legs may be swapped one without the other.

    Args:
        points_px: NaN where not found.
        height_px: Of the body; what displacements are measured against.
        time_s: Capture times.
        names: Of the points.
        chance: Probability that the network goes wrong from one frame to the next; 0 swaps nothing.
    """
    partner = mirrored(names)
    swapped = np.zeros(points_px.shape[:2], dtype=bool)
    legs = np.array([name.endswith(LEGS) for name in names])
    paired = partner != np.arange(len(partner))
    parts = [np.flatnonzero(paired & ~legs), np.flatnonzero(paired & legs)]
    found = np.flatnonzero(np.isfinite(points_px[:, paired]).all(axis=-1).any(axis=-1))
    if chance <= 0 or len(found) < 2:
        return swapped
    points, middle = points_px[found], _middle(points_px[found])
    scale = 0.5 * (height_px[found][1:] + height_px[found][:-1])
    tolerance = scale * np.hypot(LEAST_SCATTER, LIMB_SPEED * np.diff(time_s[found]))
    step = np.zeros((len(found) - 1, len(STATES), len(STATES)))
    for part, places in enumerate(parts):
        kept, crossed = (
            _change(points[:, places] - middle[:, None], points[:, order] - middle[:, None], tolerance)
            for order in (places, partner[places])
        )
        changes = STATES[:, None, part] != STATES[None, :, part]
        step += np.where(changes, crossed[:, None, None], kept[:, None, None])
    turning, first = _network_turns(chance)
    states = STATES[_likeliest(step + turning, first)].astype(bool)
    for part, places in enumerate(parts):
        swapped[np.ix_(found, places)] = states[:, part, None]
    return swapped


def _middle(points: Float[np.ndarray, "frames points 2"]) -> Float[np.ndarray, "frames 2"]:
    """Mean of a frame's points: the body's own way through the picture says nothing about its sides."""
    known = np.isfinite(points).all(axis=-1, keepdims=True)
    return np.where(known, points, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def _change(
    points: Float[np.ndarray, "frames places 2"],
    other: Float[np.ndarray, "frames places 2"],
    tolerance: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, " steps"]:
    """How unlikely it is that each frame's points became the next frame's other points, in natural logarithms."""
    away = np.linalg.norm(other[1:] - points[:-1], axis=-1) / tolerance[:, None]
    both = np.isfinite(away)
    unlikely = 0.5 * np.minimum(np.where(both, away, 0.0), OUTLIER) ** 2
    return INDEPENDENT * unlikely.sum(axis=1) / np.maximum(both.sum(axis=1), 1)


def _network_turns(chance: float) -> tuple[Float[np.ndarray, "states states"], Float[np.ndarray, " states"]]:
    """How unlikely the network goes from one state to another, and starts in one, in natural logarithms."""
    turns = np.empty((len(STATES), len(STATES)))
    turns[0] = [1.0 - chance, *(chance * SHARES)]
    turns[1:, 0] = (1.0 - STAYS_WRONG) * (1.0 - chance)
    turns[1:, 1:] = (1.0 - STAYS_WRONG) * chance * SHARES
    turns[np.arange(1, len(STATES)), np.arange(1, len(STATES))] += STAYS_WRONG
    wrong = chance / (chance + 1.0 - STAYS_WRONG)
    return -np.log(turns), -np.log(np.array([1.0 - wrong, *(wrong * SHARES)]))


def _likeliest(
    step: Float[np.ndarray, "steps states states"], first: Float[np.ndarray, " states"]
) -> Int[np.ndarray, " frames"]:
    """The state of each frame on the course with the least cost (Viterbi)."""
    cost = first
    came = np.zeros((len(step) + 1, len(first)), dtype=np.int64)
    for frame, changes in enumerate(step, start=1):
        ways = cost[:, None] + changes
        came[frame] = np.argmin(ways, axis=0)
        cost = ways.min(axis=0)
    course = np.empty(len(came), dtype=np.int64)
    course[-1] = np.argmin(cost)
    for frame in range(len(step), 0, -1):
        course[frame - 1] = came[frame, course[frame]]
    return course
