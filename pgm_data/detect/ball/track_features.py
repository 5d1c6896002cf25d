"""What the network of contacts is shown of a ball's track: even steps of time, the picture's own unit of length.

A track of any frame rate is laid on steps of `STEP_S`. Lengths are in half diagonals of the picture, so that its
size does not matter.
"""

import numpy as np
from jaxtyping import Bool, Float

STEP_S = 0.02
"""Time between steps, s."""
FEATURES = 9
"""Numbers per step; see `step_features`."""
HOLE_S = 1.0
"""Where the nearest measurement is further away than this, s, nothing is known of the ball."""
BEND_STEPS = 3
"""Steps before and after a place whose mean velocities are compared."""
FASTEST = 6.0
"""Largest velocity shown, half diagonals per second; false jumps are faster."""


def half_diagonal(size: tuple[int, int]) -> float:
    """Half the diagonal of a picture of that width and height, px: the unit of length.

    Raises:
        ValueError: If the picture is empty.
    """
    if min(size) < 1:
        raise ValueError(f"size: expected at least one pixel, got {size[0]}x{size[1]}")
    return float(np.hypot(size[0], size[1]) / 2)


def stretches(times: Float[np.ndarray, " samples"], longest_hole_s: float) -> list[slice]:
    """Runs of measurements, in order, with no hole longer than that between two of them."""
    if not len(times):
        return []
    borders = np.flatnonzero(np.diff(times) > longest_hole_s) + 1
    edges = [0, *borders.tolist(), len(times)]
    return [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def step_features(
    times: Float[np.ndarray, " samples"],
    pixels: Float[np.ndarray, "samples 2"],
    *,
    size: tuple[int, int],
    start_s: float,
    steps: int,
) -> Float[np.ndarray, "features steps"]:
    """What is seen at each step from `start_s` on: `FEATURES` numbers, 0 where nothing is known.

    Measurements of one step are averaged; between them the track is drawn straight. Rows: place x, y from the
    picture's centre; velocity x, y; change of velocity x, y from the steps before to those after; whether a
    measurement lies in the step; time since the last measurement and until the next, 0 to 1 s.

    Args:
        times: Of the measurements, s, never falling; those outside the steps are not looked at.
        pixels: All finite.
        size: Width and height of the picture, px.
        start_s: Time of the middle of the first step.
        steps: How many.
    """
    features = np.zeros((FEATURES, steps))
    index = np.floor((times - start_s) / STEP_S + 0.5)
    inside = (index >= 0) & (index < steps)
    if not inside.any():
        return features
    index = index[inside].astype(int)
    here = np.bincount(index, minlength=steps)
    occupied = np.flatnonzero(here)
    share = here[occupied]
    at = np.bincount(index, times[inside], steps)[occupied] / share
    places = np.clip((pixels[inside] - (np.array(size, dtype=float) - 1) / 2) / half_diagonal(size), -1.0, 1.0)
    seen = np.stack([np.bincount(index, places[:, i], steps)[occupied] / share for i in (0, 1)])
    middle = start_s + STEP_S * np.arange(steps)
    place = np.stack([np.interp(middle, at, row) for row in seen])
    since, until = _holes(middle, at, here > 0)
    known = (since <= HOLE_S) | (until <= HOLE_S)
    features[0:2] = place * known
    features[2:4] = _velocity(place, 1, 1) * known
    features[4:6] = (_velocity(place, 0, BEND_STEPS) - _velocity(place, BEND_STEPS, 0)) * known
    features[6] = here > 0
    features[7:9] = np.minimum(since, HOLE_S), np.minimum(until, HOLE_S)
    return features


def _holes(
    middle: Float[np.ndarray, " steps"], at: Float[np.ndarray, " seen"], here: Bool[np.ndarray, " steps"]
) -> tuple[np.ndarray, np.ndarray]:
    """Time since the last measurement and until the next, infinite where there is none; 0 in a step that has one."""
    padded = np.concatenate([[-np.inf], at, [np.inf]])
    after = np.searchsorted(at, middle) + 1
    since = np.where(here, 0.0, middle - padded[after - 1])
    until = np.where(here, 0.0, padded[after] - middle)
    return since, until


def _velocity(place: np.ndarray, before: int, after: int) -> np.ndarray:
    """Mean velocity from so many steps before each place to so many after, clipped; the ends are held."""
    padded = np.pad(place, ((0, 0), (before, after)), mode="edge")
    steps = place.shape[1]
    moved = padded[:, before + after : before + after + steps] - padded[:, :steps]
    return np.clip(moved / ((before + after) * STEP_S), -FASTEST, FASTEST)
