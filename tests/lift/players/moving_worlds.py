"""A person whose movement is known, seen by a camera that is known: for tests of the registration."""

from dataclasses import dataclass

import numpy as np

from pgm_data.geometry.camera import Camera, project
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.lift.players.linkage import Linkage, Posture, linked, parameters, placed
from pgm_data.lift.players.stance import bounds, waiting
from pgm_data.lift.players.view import PlayerView
from pgm_data.skeleton import Skeleton, load_skeleton

UPRIGHT = rotation_from_rotvec(np.array([np.pi / 2, 0.0, 0.0]))


@dataclass(frozen=True, eq=False, kw_only=True)
class MovingWorld:
    """The truth, and what is seen of it."""

    linkage: Linkage
    posture: Posture
    camera: Camera
    times: np.ndarray
    planted: np.ndarray
    """Whether both feet stand."""
    joints: np.ndarray
    pixels: np.ndarray
    """Of the seen points, exact."""


def broadcast_camera(frames: int, *, focal: float = 3200.0, height: float = 9.0) -> Camera:
    """A camera 38 m before the court's centre that looks at it, 1920 x 1080."""
    centre = np.array([0.3, -38.0, height])
    ahead = -centre / np.linalg.norm(centre)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(ahead, right), ahead])
    K = np.array([[focal, 0.0, 959.5], [0.0, focal, 539.5], [0.0, 0.0, 1.0]])
    return Camera(
        K=np.repeat(K[None], frames, axis=0),
        distortion=np.zeros((frames, 4)),
        R_cam_from_world=np.repeat(R[None], frames, axis=0),
        t_cam_from_world=np.repeat((-R @ centre)[None], frames, axis=0),
    )


def jumping_world(
    *,
    skeleton: str = "smpl24",
    place: tuple[float, float] = (1.5, -10.0),
    frames: int = 60,
    fps: float = 25.0,
    jump_s: tuple[float, float] = (0.9, 1.4),
    scale: float = 1.03,
) -> MovingWorld:
    """Somebody who stands, swings the arms, jumps as a thrown body does, half a metre aside, and stands again."""
    figure: Skeleton = load_skeleton(skeleton)
    linkage = linked(figure, figure.keypoint_names, waiting(figure))
    times = 3.0 + np.arange(frames) / fps
    low, high = bounds(linkage)
    unknowns = linkage.basis.shape[-1]
    legs = np.array([_of_legs(linkage, unknown) for unknown in range(unknowns)])
    swing = np.sin(2.0 * (times - times[0])[:, None] + np.arange(unknowns))
    room = np.minimum(np.where(np.isfinite(high - low), np.minimum(high, -low), 0.5), 0.35).clip(0.0)
    angles = np.where(legs, 0.0, swing * room)
    up, down = times[0] + np.array(jump_s)
    share = np.clip((times - up) / (down - up), 0.0, 1.0)
    rise = 0.5 * 9.81 * (times - up) * (down - times) * ((times > up) & (times < down))
    posture = Posture(
        position=np.stack([place[0] + 0.5 * share, np.full(frames, place[1]), rise], axis=-1),
        rotation=np.repeat((rotation_from_rotvec(np.array([0.0, 0.0, 2.5])) @ UPRIGHT)[None], frames, axis=0),
        angles=angles,
        log_scale=float(np.log(scale)),
    )
    points = placed(linkage, posture, slopes=False)[0]
    still = points[:, linkage.seen :, 2] - rise[:, None]
    posture.position[:, 2] -= still.min()
    points = placed(linkage, posture, slopes=False)[0]
    camera = broadcast_camera(frames)
    return MovingWorld(
        linkage=linkage,
        posture=posture,
        camera=camera,
        times=times,
        planted=(times <= up + 1e-9) | (times >= down - 1e-9),
        joints=parameters(linkage, posture)[1],
        pixels=project(camera, points[:, : linkage.seen])[0],
    )


def _of_legs(linkage: Linkage, unknown: int) -> bool:
    """Whether the unknown moves a sole."""
    joints = np.flatnonzero(np.any(linkage.basis[..., unknown] != 0, axis=1))
    return bool(linkage.moves[linkage.seen :][:, joints].any())


def viewed(world: MovingWorld, *, noise_px: float = 2.0, seed: int = 0, points: bool = True) -> PlayerView:
    """The world as a detector of points and boxes would see it."""
    frames, count = world.pixels.shape[:2]
    rng = np.random.default_rng(seed)
    seen = world.pixels + noise_px * rng.normal(size=world.pixels.shape)
    if not points:
        seen = np.full_like(seen, np.nan)
    found = np.isfinite(seen).all(axis=-1)
    corners = [world.pixels.min(axis=1) - 8.0, world.pixels.max(axis=1) + 8.0]
    return PlayerView(
        camera=world.camera,
        has_camera=np.ones(frames, dtype=bool),
        times=world.times,
        is_duplicate=np.zeros(frames, dtype=bool),
        point_names=world.linkage.skeleton.keypoint_names,
        points_px=seen,
        sigma_px=np.where(found, max(noise_px, 0.3), np.nan),
        score=np.where(found, 0.9, np.nan),
        points_ray=np.full((frames, count, 3), np.nan),
        boxes_px=np.concatenate(corners, axis=1),
        ground_world=np.full((frames, 2), np.nan),
    )


def turned_by(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between rotations, radians."""
    return np.linalg.norm(rotvec_from_rotation(a @ np.swapaxes(b, -1, -2)), axis=-1)
