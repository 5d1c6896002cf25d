"""People in a picture of what is new: boxes of the right size, where the ground is, filled as people fill them."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.detect.players.ground_map import GroundMap

PLACE_WEIGHTS = np.array([-4.0, 3.0, 4.0, 3.0, -3.0, -1.0, -2.0, -3.0])
"""Log odds of a person by the features of a place: a constant, how full the parts are."""
PERSON_WEIGHTS = np.array([-1.0, 5.5, 2.5, 1.5, -5.0, -1.0, 0.0, -0.5, -5.0])
"""The same of a box: also the square of the logarithm of its height over that of a standing person."""
LEAST_ODDS = -3.0
"""Log odds of the place under which nobody is looked for."""
ALIKE = 1.0
"""Log odds by which two places are hardly different."""
LEAST_TRUNK = 0.15
"""Least share of a trunk that must be new."""
LEAST_AREA = 0.04
"""Least area that must be new about a person, in squares of his height; a body that shows all of itself has 0.15."""
SHADOW_ROWS = 0.12
"""Height up to which a shadow on the ground may join the feet, in heights of a person."""
STRIDE = 0.1
"""How far feet may lie outside of all of the body above, in heights of a person."""
TRUNK = (-0.17, 0.17, -0.8, -0.3)
PARTS = (
    (-0.17, 0.17, -1.0, -0.62),
    (-0.17, 0.17, -0.62, -0.33),
    (-0.24, 0.24, -0.33, 0.0),
    (-0.52, -0.28, -1.0, 0.0),
    (0.28, 0.52, -1.0, 0.0),
    (-0.2, 0.2, -1.3, -1.08),
    (-0.3, 0.3, 0.05, 0.22),
)
"""Parts of and around a standing person, in his heights from between his feet, x right and y down: head and shoulders,
trunk, legs; left of him, right of him, above, below."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """A box that is filled as a person fills it."""

    box: Float[np.ndarray, " 4"]
    """x0, y0, x1, y1, px; may reach below the picture."""
    feet: tuple[float, float]
    """Between the feet, roughly, px."""
    height: float
    """How tall a standing person would be there, px."""
    features: Float[np.ndarray, " features"]
    """What he is judged by: weighed by `PERSON_WEIGHTS`."""


def people_in(mask: UInt8[np.ndarray, "high wide"], places: GroundMap, most: int) -> list[Evidence]:
    """Perhaps people in one picture, the clearest first; at most as many as asked for."""
    mask = mask.copy()
    sums = cv2.integral(mask)
    kept = np.flatnonzero(_filled(sums, places, TRUNK, mask.shape) > LEAST_TRUNK)
    places = GroundMap(x=places.x[kept], y=places.y[kept], height=places.height[kept])
    features = _features(sums, places, mask.shape)
    odds = features @ PLACE_WEIGHTS
    people: list[Evidence] = []
    for _ in range(most):
        if not len(odds):
            break
        best = int(np.argmax(odds))
        if odds[best] < LEAST_ODDS:
            break
        best = _largest_alike(places, odds, best)
        feet, tall = (float(places.x[best]), float(places.y[best])), float(places.height[best])
        box = _refined(mask, feet, tall)
        if box is not None:
            judged = np.append(features[best], np.log((box[3] - box[1]) / tall) ** 2)
            people.append(Evidence(box=box, feet=feet, height=tall, features=judged))
        wiped = _own_part(box, feet, tall)
        _wipe(mask, wiped)
        near = np.flatnonzero(_touches(places, wiped))
        some = GroundMap(x=places.x[near], y=places.y[near], height=places.height[near])
        sums = cv2.integral(mask)
        features[near] = _features(sums, some, mask.shape)
        left = _filled(sums, some, TRUNK, mask.shape) > LEAST_TRUNK
        odds[near] = np.where(left, features[near] @ PLACE_WEIGHTS, -np.inf)
        odds[(places.y == places.y[best]) & (places.x == places.x[best])] = -np.inf
    return [_below_others(person, people) for person in people]


def _largest_alike(places: GroundMap, odds: Float[np.ndarray, " places"], best: int) -> int:
    """The place nearest to the camera that is hardly worse than the best one and shares its trunk.

    A camera no higher than people sees hips and knees as feet of a smaller one who stands further away.
    """
    aside, below = np.abs(places.x - places.x[best]), places.y - places.y[best]
    tall = places.height[best]
    alike = (odds > odds[best] - ALIKE) & (aside < 0.15 * tall) & (below >= 0) & (below < 0.6 * tall)
    return int(np.flatnonzero(alike)[np.argmax(places.y[alike])])


def _touches(places: GroundMap, box: Float[np.ndarray, " 4"]) -> Bool[np.ndarray, " places"]:
    """Whether a place is judged by what lies in the box."""
    x, y, height = places.x, places.y, places.height
    return (
        (x + 0.55 * height >= box[0] - 1)
        & (x - 0.55 * height <= box[2] + 1)
        & (y + 0.25 * height >= box[1] - 1)
        & (y - 1.35 * height <= box[3] + 1)
    )


def _own_part(box: Float[np.ndarray, " 4"] | None, feet: tuple[float, float], height: float) -> Float[np.ndarray, " 4"]:
    """What of a person's box hides nobody else: as tall as he is, whatever joins him above."""
    if box is None:
        return _standing(feet, height)
    return np.array([box[0], max(box[1], box[3] - 1.05 * height), box[2], box[3]])


def _below_others(person: Evidence, people: list[Evidence]) -> Evidence:
    """The person, with the top of his box no higher than he stands if somebody behind him has his feet in it."""
    x0, y0, x1, y1 = person.box
    top = y1 - 1.05 * person.height
    behind = [
        other
        for other in people
        if y0 < top and x0 < other.feet[0] < x1 and y0 < other.feet[1] < y1 - 0.15 * person.height
    ]
    return replace(person, box=np.array([x0, max(y0, top), x1, y1])) if behind else person


def _filled(
    sums: Int[np.ndarray, "rows columns"],
    places: GroundMap,
    part: tuple[float, float, float, float],
    shape: tuple[int, ...],
) -> Float[np.ndarray, " places"]:
    """Share of a part of or around a person at each place that is new, of what the picture shows of it."""

    def edge(at: np.ndarray, side: float, most: int) -> np.ndarray:
        moved = at + places.height * side + 0.5
        return np.minimum(np.maximum(moved, 0.0, out=moved), most, out=moved).astype(np.intp)

    x0, x1 = edge(places.x, part[0], shape[1]), edge(places.x, part[1], shape[1])
    y0, y1 = edge(places.y, part[2], shape[0]), edge(places.y, part[3], shape[0])
    area = (x1 - x0) * (y1 - y0)
    flat, wide = sums.ravel(), sums.shape[1]
    y0 *= wide
    y1 *= wide
    return (flat[y1 + x1] - flat[y0 + x1] - flat[y1 + x0] + flat[y0 + x0]) / np.maximum(area, 1)


def _features(
    sums: Int[np.ndarray, "rows columns"], places: GroundMap, shape: tuple[int, ...]
) -> Float[np.ndarray, "places features"]:
    """What a place is judged by: a constant, how full the parts are; of both sides the fuller one first."""
    head, trunk, legs, left, right, above, below = (_filled(sums, places, part, shape) for part in PARTS)
    sides = np.maximum(left, right), np.minimum(left, right)
    return np.stack([np.ones(len(head)), head, trunk, legs, *sides, above, below], axis=1)


def _standing(feet: tuple[float, float], height: float) -> Float[np.ndarray, " 4"]:
    x, y = feet
    return np.array([x - 0.22 * height, y - height, x + 0.22 * height, y])


def _wipe(mask: UInt8[np.ndarray, "high wide"], box: Float[np.ndarray, " 4"]) -> None:
    x0, y0, x1, y1 = np.round(box).astype(int)
    mask[max(y0, 0) : max(y1 + 1, 0), max(x0, 0) : max(x1 + 1, 0)] = 0


def _refined(
    mask: UInt8[np.ndarray, "high wide"], feet: tuple[float, float], height: float
) -> Float[np.ndarray, " 4"] | None:
    """The box around what is new about a person, px; None where that is too little of a person."""
    (x, y), (high, wide) = feet, mask.shape
    left, right = (int(np.clip(round(x + side * 0.6 * height), 0, wide)) for side in (-1, 1))
    top, bottom = int(np.clip(round(y - 1.3 * height), 0, high)), int(np.clip(round(y + 0.4 * height), 0, high))
    window = mask[top:bottom, left:right]
    if min(window.shape) < 3:
        return None
    joined = cv2.dilate(window, np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(joined, connectivity=8)
    labels = np.where(window > 0, labels, 0)
    core = labels[
        max(0, int(round(y - height)) - top) : max(0, int(round(y)) - top),
        max(0, int(round(x - 0.24 * height)) - left) : max(0, int(round(x + 0.24 * height)) - left),
    ]
    area = np.bincount(labels.ravel(), minlength=count)
    inside = np.bincount(core.ravel(), minlength=count)
    own = (inside > 0.3 * area) & (inside >= 3)
    own[0] = False
    mine = own[labels]
    # Legs may reach below the place that was found, but not further than anybody is tall.
    first = int(np.argmax(mine.any(axis=1)))
    mine[max(round(y + 0.1 * height) - top, round(first + 1.15 * height)) :] = False
    total = int(mine.sum())
    if total < LEAST_AREA * height**2 * min(1.0, (bottom - top) / (1.45 * height) + 0.3) or total < 8:
        return None
    # A shadow lies at the feet, so how wide he is is told above them.
    lowest = int(np.flatnonzero(mine.any(axis=1))[-1])
    feet_rows = max(0, round(lowest - SHADOW_ROWS * height))
    above = mine[:feet_rows] if mine[:feet_rows].sum() > 0.5 * total else mine
    body, whole = _ends(above.sum(axis=0), 0.015 * total), _ends(mine.sum(axis=0), 0.015 * total)
    stride = round(STRIDE * height)
    x0, x1 = max(whole[0], body[0] - stride), min(whole[1], body[1] + stride)
    mine = mine[:, x0 : x1 + 1]
    y0, y1 = _ends(mine.sum(axis=1), 0.006 * total)
    box = np.array([left + x0 - 0.5, top + y0 - 0.5, left + x1 + 0.5, top + y1 + 0.5])
    if box[3] >= high - 1:  # Cut by the lower edge: as tall as he would be.
        box[3] = max(box[3], box[1] + 0.95 * height)
    return box


def _ends(counts: Int[np.ndarray, " lines"], least: float) -> tuple[int, int]:
    """The first and the last line but for `least` pixels beyond each."""
    sums = np.cumsum(counts)
    return int(np.searchsorted(sums, least, side="right")), int(np.searchsorted(sums, sums[-1] - least, side="left"))
