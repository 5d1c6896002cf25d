"""Pictures of a player as rays: what the fit measures, free of lens and pixels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.camera import rays
from pgm_data.geometry.distortion import undistort
from pgm_data.lift.players.linkage import Linkage
from pgm_data.lift.players.view import PlayerView


@dataclass(frozen=True, eq=False, kw_only=True)
class Sight:
    """Measurements of the frames of one segment; where nothing is seen, numbers are finite and of no meaning."""

    times: Float[np.ndarray, " frames"]
    """Capture times, s, strictly rising."""
    R_cam_from_world: Float[np.ndarray, "frames 3 3"]
    t_cam_from_world: Float[np.ndarray, "frames 3"]
    seen: Bool[np.ndarray, "frames points"]
    xy: Float[np.ndarray, "frames points 2"]
    """Undistorted normalised image coordinates."""
    sigma: Float[np.ndarray, "frames points"]
    """Standard deviation of each of them."""
    limbs: Int[np.ndarray, "limbs 2"]
    """Pairs of points whose direction a network may know."""
    limb_known: Bool[np.ndarray, "frames limbs"]
    limb_world: Float[np.ndarray, "frames limbs 3"]
    """Unit vectors in the world from the first to the second point."""


def limb_pairs(linkage: Linkage, point_names: tuple[str, ...]) -> Int[np.ndarray, "limbs 2"]:
    """Pairs of seen points: each and the nearest one above it on its limb, and left and right ones of one name."""
    moves = linkage.moves[: linkage.seen]
    depth = moves.sum(axis=1)
    pairs = []
    for point in range(linkage.seen):
        above = [
            other
            for other in range(linkage.seen)
            if other != point and depth[other] < depth[point] and not np.any(moves[other] & ~moves[point])
        ]
        if above:
            most = max(depth[other] for other in above)
            # Of several, such as hips for a shoulder, the one of its side, else any.
            same = [other for other in above if depth[other] == most]
            side = point_names[point].split("_")[0]
            mine = [other for other in same if point_names[other].split("_")[0] == side]
            pairs.append(((mine or same)[0], point))
    for left, right in mirror_pairs(point_names):
        pairs.append((left, right))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def mirror_pairs(point_names: tuple[str, ...]) -> list[tuple[int, int]]:
    """Places of points that are called alike but for left and right."""
    out = []
    for index, name in enumerate(point_names):
        for left, right in (("left_", "right_"), ("L_", "R_")):
            other = right + name[len(left) :]
            if name.startswith(left) and other in point_names:
                out.append((index, point_names.index(other)))
    return out


def sight_of(
    view: PlayerView, frames: Int[np.ndarray, " frames"], *, pixel_std: float, limbs: Int[np.ndarray, "limbs 2"]
) -> Sight:
    """What some frames of a view measure."""
    camera = view.camera[frames]
    there = view.has_camera[frames]
    K, R, t = (
        np.where(there.reshape(-1, *[1] * (array.ndim - 1)), array, safe)
        for array, safe in (
            (camera.K, np.eye(3)),
            (camera.R_cam_from_world, np.eye(3)),
            (camera.t_cam_from_world, np.zeros(3)),
        )
    )
    distortion = np.where(there[:, None], camera.distortion, 0.0)
    offset = view.points_px[frames] - K[:, None, :2, 2]
    xy = undistort(offset @ np.linalg.inv(np.swapaxes(K[:, :2, :2], -1, -2)), distortion)
    focal = np.sqrt(K[:, 0, 0] * K[:, 1, 1])[:, None]
    sigma = np.sqrt(view.sigma_px[frames] ** 2 + pixel_std**2) / focal
    seen = there[:, None] & np.isfinite(xy).all(axis=-1) & np.isfinite(sigma)
    directions = _limb_directions(view, frames, limbs)
    known = there[:, None] & np.isfinite(directions).all(axis=-1)
    return Sight(
        times=view.times[frames],
        R_cam_from_world=R,
        t_cam_from_world=t,
        seen=seen,
        xy=np.where(seen[..., None], xy, 0.0),
        sigma=np.where(seen, sigma, 1.0),
        limbs=limbs,
        limb_known=known,
        limb_world=np.where(known[..., None], directions, 0.0),
    )


def world_from_ray(view: PlayerView, frames: Int[np.ndarray, " frames"]) -> Float[np.ndarray, "frames 3 3"]:
    """Axes of the camera that looks at the middle of each box without roll against the real one; NaN without a box."""
    middle = 0.5 * (view.boxes_px[frames, :2] + view.boxes_px[frames, 2:])
    camera = view.camera[frames]
    ahead = rays(camera, middle[:, None])[:, 0]
    down = camera.R_cam_from_world[:, 1]
    right = np.cross(down, ahead)
    right = right / np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(ahead, right), ahead], axis=-1)


def _limb_directions(view: PlayerView, frames: np.ndarray, limbs: np.ndarray) -> np.ndarray:
    shape = view.points_ray[frames]
    if not len(limbs) or not np.isfinite(shape).any():
        return np.full((len(frames), len(limbs), 3), np.nan)
    way = shape[:, limbs[:, 1]] - shape[:, limbs[:, 0]]
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    way = way / np.where(length > 1e-6, length, np.nan)
    return way @ np.swapaxes(world_from_ray(view, frames), -1, -2)
