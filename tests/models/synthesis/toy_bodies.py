"""Cameras, poses and bodies whose grids hold something uneven, for tests."""

import numpy as np
import torch

from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.skeleton import Skeleton, load_skeleton
from pgm_models.synthesis.bodies import Body, BodyGrids
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.skinning import Poses, Skinning, distance_to_limbs, grid_places, limbs_of, poses_of

UPRIGHT = np.array([np.pi / 2, 0.0, 0.0])
"""Axis-angle that stands a skeleton, whose y points up, on the ground of a world whose z does."""


def drawn(*sizes: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    """Standard normal numbers."""
    return torch.randn(*sizes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def looking(
    position: list[float],
    target: list[float],
    focal: float = 300.0,
    size: tuple[int, int] = (64, 48),
    roll: float = 0.0,
) -> Camera:
    """A camera there that looks at the target."""
    forward = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.99 else [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    R = rotation_from_rotvec(np.array([0.0, 0.0, roll])) @ np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ np.array(position))


def rays_towards(
    origins: np.ndarray, targets: np.ndarray, frame: int | np.ndarray = 0, *, spread: float = 1e-3
) -> Rays:
    """Rays that do not belong to one camera, one a row; pixels `spread` radians wide."""
    direction = (targets - origins) / np.linalg.norm(targets - origins, axis=1, keepdims=True)
    across = np.cross(direction, [0.3, 0.5, 0.81])
    across *= spread / np.linalg.norm(across, axis=1, keepdims=True)
    parts = [origins, direction, across, np.cross(direction, across)]
    origin, direction, across, down = (torch.from_numpy(np.array(part, dtype=np.float32)) for part in parts)
    frames = torch.from_numpy(np.array(np.broadcast_to(frame, len(origins)), dtype=np.int64))
    return Rays(origin=origin, direction=direction, across=across, down=down, frame=frames)


def bent(skeleton: Skeleton, frames: int, *, seed: int = 0, size: float = 1.0, bend: float = 0.5) -> Poses:
    """Bodies of that size, their joints bent at random, standing about the origin and turned about."""
    rng = np.random.default_rng(seed)
    rotations = rng.normal(scale=bend, size=(frames, len(skeleton.parents), 3))
    turns = rotation_from_rotvec(np.stack([np.zeros(frames), np.zeros(frames), rng.uniform(-3, 3, frames)], axis=1))
    from pgm_data.geometry.rigid import rotvec_from_rotation

    rotations[:, 0] = rotvec_from_rotation(turns @ rotation_from_rotvec(UPRIGHT))
    translations = np.broadcast_to(skeleton.rest_translations, rotations.shape) * size
    translations[:, 0] = rng.normal(scale=0.5, size=(frames, 3)) + [0.0, 0.0, 1.0]
    return poses_of(skeleton, rotations, translations)


def uneven_weights(skinning: Skinning, *, seed: int = 0) -> torch.Tensor:
    """Weights of a skinning as if it had learned some, with its support."""
    logits = skinning.prior.clamp(min=-1e4) + 0.7 * drawn(*skinning.prior.shape, seed=seed)
    return torch.softmax(logits, dim=1)[:, : skinning.joints] * skinning.support


def lumpy_grids(body: Body, *, seed: int = 0, thick: float = 0.12) -> BodyGrids:
    """Grids with density near the limbs and exactly none elsewhere, all else at random."""
    skinning = body.skinning
    cells = grid_places(skinning.low.numpy(), skinning.high.numpy(), body.size)
    distance = distance_to_limbs(cells, limbs_of(skinning.skeleton)[1]).min(axis=1)
    raw = torch.where(torch.as_tensor(distance < thick), -3.0 + drawn(len(cells), seed=seed), -30.0)
    return BodyGrids(
        density=raw[:, None],
        values=drawn(len(cells), body.grown.channels - 1, seed=seed + 1),
        weights=uneven_weights(skinning, seed=seed + 2),
    )


def small_body(name: str, *, cells: int = 12, features: int = 5, seed: int = 0) -> Body:
    """A body of the skeleton of that name, untrained and without gradients."""
    torch.manual_seed(seed)
    return Body(load_skeleton(name), (cells, cells, cells), features, width=8, seed=seed).requires_grad_(False)
