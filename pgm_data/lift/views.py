"""Frames condensed into distinct views, so that a still camera's hundred frames do not count a hundred times.

What keeps a line from its place (crooked paint, a profile's bias) is the same in every frame of a still camera, while
noise is fresh. So frames that look the same way are averaged: their residuals, each against its own frame's camera,
give one sighting per stretch of line, with the noise of a mean.
"""

import numpy as np
from jaxtyping import Float, Int

from pgm_data.lift.clip_pad import padded
from pgm_data.lift.court_camera import CourtCamera, project
from pgm_data.lift.line_fit import Fit, Sightings

BINS = 16
"""Stretches per line."""


def group_views(
    cameras: CourtCamera, points_world: Float[np.ndarray, "points 3"], *, apart_px: float, most: int
) -> list[Int[np.ndarray, " _"]]:
    """Frames grouped by where they look: within a group no point of the court moves by more than `apart_px`.

    When that makes more groups than `most`, groups spread evenly over the clip are kept.
    """
    pixels = np.nan_to_num(
        project(cameras, np.broadcast_to(points_world, (len(cameras.focal_px), *points_world.shape)))
    )
    groups: list[list[int]] = []
    references: list[np.ndarray] = []
    for frame, view in enumerate(pixels):
        if references:
            distance = np.abs(np.stack(references) - view).max(axis=(1, 2))
            nearest = int(distance.argmin())
            if distance[nearest] <= apart_px:
                groups[nearest].append(frame)
                continue
        references.append(view)
        groups.append([frame])
    chosen = np.unique(np.linspace(0, len(groups) - 1, min(most, len(groups))).round().astype(int))
    return [np.array(groups[g]) for g in chosen]


def condense(fit: Fit, sightings: Sightings, groups: list[Int[np.ndarray, " _"]]) -> tuple[CourtCamera, Sightings]:
    """One camera and one set of averaged sightings per group of frames.

    Args:
        fit: Every frame's own fit.
        sightings: Every frame's sightings.
        groups: Frames that look the same way.
    """
    first = np.array([g[len(g) // 2] for g in groups])
    references = fit.camera[first]
    return references, padded([_averaged(fit, sightings, g, references[i]) for i, g in enumerate(groups)], 1)


def _averaged(fit: Fit, sightings: Sightings, group: np.ndarray, reference: CourtCamera) -> Sightings:
    good = fit.inlier[group]
    lines = sightings.line[group][good]
    keys = np.where(
        lines >= 0,
        lines * BINS + np.clip(((sightings.along[group][good] + 1) / 2 * BINS).astype(int), 0, BINS - 1),
        # Points count one by one: each frame's marks stay what they are.
        -1 - np.arange(good.sum()),
    )
    unique, inverse = np.unique(keys, return_inverse=True)
    count = np.bincount(inverse)

    def mean(values: np.ndarray) -> np.ndarray:
        columns = values.reshape(len(values), int(np.prod(values.shape[1:])))
        sums = np.stack([np.bincount(inverse, column) for column in columns.T], axis=1)
        return (sums / count[:, None]).reshape(len(unique), *values.shape[1:])

    frame = np.nonzero(good)[0]
    r = fit.residual_px[group][good]
    sigma = sightings.sigma_px[group][good]
    normals = mean(sightings.normals[group][good])
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    world = mean(sightings.points_world[group][good])
    residual = mean(r)
    spread = np.sqrt(np.maximum(mean(r**2) - residual**2, 0))
    # Rows of one frame's stretch share their error; frames are independent.
    frames = np.array([len(np.unique(frame[inverse == k])) for k in range(len(unique))])
    fresh = np.maximum(np.minimum(spread, mean(sigma) * 2), mean(sigma) / 2) / np.sqrt(frames)
    pixels = project(reference, world)
    return Sightings(
        points_world=world,
        measured_px=pixels - normals * residual[:, None],
        normals=normals,
        sigma_px=fresh,
        line=np.where(unique >= 0, unique // BINS, -1),
        along=mean(sightings.along[group][good]),
        bias_px=mean(sightings.bias_px[group][good]),
    )
