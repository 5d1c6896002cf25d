"""Frames of unequal numbers of sightings as one track."""

from collections.abc import Iterable

import numpy as np

from pgm_data.lift.line_fit import Sightings


def padded(rows: Iterable[Sightings], most: int) -> Sightings:
    """One track of the given frames' sightings, padded with rows of infinite sigma."""
    parts = list(rows)
    count = max([most, *(len(p.line) for p in parts)])

    def pad(values: np.ndarray, fill: float) -> np.ndarray:
        return np.concatenate([values, np.full((count - len(values), *values.shape[1:]), fill, dtype=values.dtype)])

    return Sightings(
        points_world=np.stack([pad(p.points_world, 0.0) for p in parts]),
        measured_px=np.stack([pad(p.measured_px, 0.0) for p in parts]),
        normals=np.stack([pad(p.normals, 0.0) for p in parts]),
        sigma_px=np.stack([pad(p.sigma_px, np.inf) for p in parts]),
        line=np.stack([pad(p.line, -1) for p in parts]),
        along=np.stack([pad(p.along, 0.0) for p in parts]),
        bias_px=np.stack([pad(p.bias_px, 0.0) for p in parts]),
    )
