"""Lines on the ground that are not the court's own."""

from collections.abc import Sequence

import numpy as np

from pgm_data.court import Court
from pgm_data.simulate.pictures.shapes import line_rectangles


def foreign_lines(
    rng: np.random.Generator, courts: Sequence[Court], alpha: float
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Lines of other sports: courts of other scenes set down anywhere, or arcs, circles and long bars."""
    colour = rng.uniform(20, 250, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(190, 255))
    shapes: list[tuple[np.ndarray, np.ndarray, float]] = []
    kind = rng.random()
    if kind < 0.5:
        court = courts[int(rng.integers(len(courts)))]
        scale = rng.uniform(0.9, 1.4)
        angle = float(rng.choice([0.0, 0.5 * np.pi])) + (rng.normal(0, 0.1) if rng.random() < 0.2 else 0.0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = rng.normal(0, 3.0, 2) if rng.random() < 0.7 else np.zeros(2)
        for _, corners in line_rectangles(court):
            corners = corners.copy()
            corners[:, :2] = scale * corners[:, :2] @ turn.T + shift
            corners[:, 2] = 0.0
            shapes.append((corners, colour, alpha))
        return shapes
    for _ in range(int(rng.integers(1, 5))):
        half = rng.uniform(0.02, 0.06)
        if rng.random() < 0.5:
            radius, middle = rng.uniform(0.8, 7.0), rng.normal(0, 6.0, 2)
            turns = np.linspace(0, rng.uniform(1.5, 2 * np.pi), 24) + rng.uniform(0, 6)
            ring = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
            flat = np.concatenate([middle + (radius + half) * ring, (middle + (radius - half) * ring)[::-1]])
        else:
            start, angle = rng.normal(0, 8.0, 2), rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0, 0.02)
            along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            end = start + rng.uniform(3, 30) * along
            flat = np.array([start - half * across, end - half * across, end + half * across, start + half * across])
        shapes.append((np.concatenate([flat, np.zeros((len(flat), 1))], axis=1), colour, alpha))
    return shapes
