"""Benches, parasols, coolers and clocks beside a court, where nobody runs."""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.pictures.people import by_distance, crate
from pgm_data.simulate.pictures.shapes import Polygons, polygons

Box = tuple[np.ndarray, np.ndarray]


def draw_furniture(
    rng: np.random.Generator,
    walls: tuple[float, float],
    seat: Float[np.ndarray, " 3"] | None,
    centre_world: Float[np.ndarray, " 3"],
    thrown: Float[np.ndarray, " 2"],
) -> tuple[Polygons, Polygons, list[Box]]:
    """Shapes beyond the net and before it, and what stands on the ground as boxes (lower corner, size), metres.

    `walls`: half width and half length between the hoardings; `seat`: of the umpire, whose side the players' benches
    share; `thrown`: the ground vector by which the light throws one metre of height.
    """
    wall_x, wall_y = walls
    beyond: list[tuple[float, Polygons]] = []
    before: list[tuple[float, Polygons]] = []
    boxes: list[Box] = []

    def put(low: np.ndarray, size: np.ndarray, colour: np.ndarray, *, falls: bool = True) -> None:
        middle = low + 0.5 * size
        shapes = crate(low, size, colour, centre_world, thrown)
        (beyond if middle[1] > 0 else before).append((float(np.linalg.norm(middle - centre_world)), shapes))
        if falls:
            boxes.append((low, size))

    side = float(rng.choice([-1.0, 1.0]) if seat is None else np.sign(seat[0]))
    wood = _cloth(rng)
    parasol = _cloth(rng) if rng.random() < 0.45 else None
    x = side * (wall_x - rng.uniform(0.7, 0.9))
    for end in (-1.0, 1.0):
        y = end * rng.uniform(2.4, 3.2)
        put(np.array([x - 0.25, y - 0.8, 0.0]), np.array([0.5, 1.6, 0.45]), wood)
        put(np.array([x + side * 0.2 - 0.03, y - 0.8, 0.45]), np.array([0.06, 1.6, 0.4]), wood, falls=False)
        if rng.random() < 0.8:  # a racket bag on the ground
            at = np.array([x - side * 0.55 - 0.16, y + end * rng.uniform(-0.5, 0.5) - 0.4, 0.0])
            put(at, np.array([0.32, 0.8, 0.3]), _cloth(rng))
        if rng.random() < 0.7:
            put(np.array([x - 0.25, y + end * 1.1 - 0.25, 0.0]), np.array([0.5, 0.5, 0.6]), _cloth(rng))
        if parasol is not None:
            shapes = _parasol(np.array([x, y, 0.0]), parasol, centre_world)
            (beyond if end > 0 else before).append((float(np.linalg.norm([x, y, 2.0] - centre_world)) - 0.8, shapes))
            boxes.append((np.array([x - 0.8, y - 0.8, 2.1]), np.array([1.6, 1.6, 0.2])))
    if rng.random() < 0.6:  # clocks or boxes of towels in the far corners
        colour, tall = _cloth(rng), float(rng.uniform(0.5, 1.1))
        for end in (-1.0, 1.0):
            low = np.array([end * (wall_x - 1.0) - 0.4, wall_y - 0.6, 0.0])
            put(low, np.array([0.8, 0.4, tall]), colour)
    return by_distance(beyond), by_distance(before), boxes


def _cloth(rng: np.random.Generator) -> np.ndarray:
    grey = rng.uniform(25, 205)
    return np.clip(grey + rng.uniform(0.0, 0.5) * (rng.uniform(0, 255, 3) - grey), 10, 215)


def _parasol(foot: np.ndarray, colour: np.ndarray, centre_world: np.ndarray) -> Polygons:
    """A pole and eight panels under a top."""
    pole = 0.03 * np.array([1.0, 0.0, 0.0])
    top, rim = foot + np.array([0.0, 0.0, 2.6]), foot + np.array([0.0, 0.0, 2.15])
    turns = np.linspace(0.0, 2.0 * np.pi, 9)
    ring = rim + 1.1 * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=-1)
    panels = []
    for i in range(8):
        middle = 0.5 * (ring[i] + ring[i + 1])
        shade = 0.8 + 0.2 * float(np.cos(turns[i] - 0.7)) + 0.06 * (-1.0) ** i
        away = float(np.linalg.norm(middle - centre_world))
        panels.append((away, (np.array([top, ring[i], ring[i + 1]]), np.minimum(shade * colour, 235.0), 1.0)))
    panels.sort(key=lambda panel: -panel[0])
    shaft = np.array([foot - pole, foot + pole, top + pole, top - pole])
    return polygons([(shaft, np.full(3, 90.0), 1.0), *(shape for _, shape in panels)])
