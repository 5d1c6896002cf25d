"""Left and right told apart again where a network took one for the other."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.lift.players.linkage import Linkage
from pgm_data.lift.players.sight import Sight

_MARGIN = 8.0
"""By how much less a pair must cost the other way about: an odd likelihood of 1 in 3,000."""


def relabelled(
    linkage: Linkage,
    sight: Sight,
    points_world: Float[np.ndarray, "frames points 3"],
    pairs: Int[np.ndarray, "pairs 2"],
    *,
    freedom: float,
) -> Sight:
    """The sight with those left and right points exchanged that then agree far better with the fit.

    Args:
        linkage: Whose points they are.
        sight: What was seen.
        points_world: The fit's points.
        pairs: Left and right points of the same name.
        freedom: Of the Student distribution of a point.
    """
    if not len(pairs):
        return sight
    a, b = pairs.T
    cam = points_world[:, : linkage.seen] @ np.swapaxes(sight.R_cam_from_world, 1, 2) + sight.t_cam_from_world[:, None]
    xy = cam[..., :2] / np.maximum(cam[..., 2:], 0.1)

    def cost(model: np.ndarray, seen: np.ndarray) -> np.ndarray:
        square = np.sum((xy[:, model] - sight.xy[:, seen]) ** 2, axis=-1) / sight.sigma[:, seen] ** 2
        return np.where(sight.seen[:, seen], 0.5 * (freedom + 2) * np.log1p(square / freedom), 0.0)

    swap = cost(a, a) + cost(b, b) > cost(a, b) + cost(b, a) + _MARGIN
    return exchanged(sight, pairs, swap)


def exchanged(sight: Sight, pairs: Int[np.ndarray, "pairs 2"], swap: Bool[np.ndarray, "frames pairs"]) -> Sight:
    """The sight with left and right of some pairs in some frames exchanged."""
    a, b = pairs.T
    order = np.tile(np.arange(sight.seen.shape[1]), (len(sight.seen), 1))
    order[:, a] = np.where(swap, b, a)
    order[:, b] = np.where(swap, a, b)
    return replace(
        sight,
        xy=np.take_along_axis(sight.xy, order[..., None], axis=1),
        sigma=np.take_along_axis(sight.sigma, order, axis=1),
        seen=np.take_along_axis(sight.seen, order, axis=1),
    )
