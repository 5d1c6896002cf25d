"""How a camera that is off moves what stands on the ground."""

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.camera import Camera, meet_plane, project
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.camera_doubt import CameraDoubt

_STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-4, 1e-5, 1e-5, 1e-5])


def doubted_cov(
    camera: Camera, doubt: CameraDoubt, places: Float[np.ndarray, "frames 3"], frames: Int[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames 3 3"]:
    """Covariance of bodies at the given places that comes from the camera alone, m^2.

    Each error of the camera moves a body as its ray moves on the level plane through it; the camera's jitter from
    frame to frame, which all points of a frame share, does too.
    """
    cov = np.zeros((len(frames), 3, 3))
    if not len(frames):
        return cov
    own = camera[frames]
    pixels, there = project(own, places[:, None])
    if doubt.pixel_std > 0:
        base = _at_height(own, pixels, places[:, 2])
        for axis in np.eye(2):
            shift = _at_height(own, pixels + doubt.pixel_std * axis, places[:, 2]) - base
            cov += shift[:, :, None] * shift[:, None, :]
    for other in _off_by_one_std(own, doubt, places):
        shift = _at_height(other, pixels, places[:, 2]) - places
        cov += shift[:, :, None] * shift[:, None, :]
    return np.where((there[:, 0] & np.isfinite(cov).all(axis=(1, 2)))[:, None, None], cov, 0.0)


def build_cov(
    camera: Camera, places: Float[np.ndarray, "frames 3"], frames: Int[np.ndarray, " frames"], *, height_std: float
) -> Float[np.ndarray, "frames 3 3"]:
    """Covariance of bodies that comes from a build unlike the skeleton's, m^2.

    Who stands higher or lower on his feet than the skeleton does by some centimetres is placed along the line of
    sight to where the picture is right again: far, where the view is low.
    """
    away = places - camera[frames].position_world
    away = away / np.linalg.norm(away, axis=-1, keepdims=True)
    shift = height_std * away / np.maximum(np.abs(away[:, 2:]), 0.05)
    return shift[:, :, None] * shift[:, None, :]


def _at_height(camera: Camera, pixels: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Where each frame's pixel meets its own level."""
    lifted = Camera(
        K=camera.K,
        distortion=camera.distortion,
        R_cam_from_world=camera.R_cam_from_world,
        t_cam_from_world=camera.t_cam_from_world + camera.R_cam_from_world[..., 2] * heights[:, None],
    )
    met = meet_plane(lifted, pixels)[:, 0]
    met[:, 2] += heights
    return met


def _off_by_one_std(camera: Camera, doubt: CameraDoubt, places: np.ndarray) -> list[Camera]:
    """The cameras one standard deviation off in each direction of their error.

    A camera is calibrated on the ground: whatever its centre is off by, its rotation and focal length make up for it
    there as well as they can.
    """
    values, axes = np.linalg.eigh(doubt.position_cov)
    moves = [np.sqrt(value) * axes[:, i] for i, value in enumerate(values) if value > 1e-12]
    usable = np.flatnonzero(np.isfinite(camera.K[..., 0, 0]))
    if not len(usable) or (not moves and doubt.focal_std_share <= 0):
        return []
    one = camera[int(usable[len(usable) // 2])]
    half = np.maximum(np.abs(places[:, :2]).max(axis=0), 3.0)
    x, y = np.meshgrid(half[0] * np.array([-1.0, 0.0, 1.0]), half[1] * np.array([-1.0, 0.0, 1.0]))
    ground = np.stack([x.ravel(), y.ravel(), np.zeros(9)], axis=-1)
    base, there = project(one, ground)
    if there.sum() < 4:
        return []
    columns = []
    for i, step in enumerate(_STEPS):
        moved, _ = project(_off(one, step * np.eye(7)[i]), ground)
        columns.append(((moved - base) / step)[there].ravel())
    J = np.nan_to_num(np.stack(columns, axis=1))
    errors, explained = [], 0.0
    for move in moves:
        rest, *_ = np.linalg.lstsq(J[:, 3:], -J[:, :3] @ move, rcond=None)
        explained += rest[0] ** 2
        errors.append(np.concatenate([move, rest]))
    left = doubt.focal_std_share**2 - explained
    if left > 1e-12:
        turn, *_ = np.linalg.lstsq(J[:, 4:], -J[:, 3] * np.sqrt(left), rcond=None)
        errors.append(np.concatenate([np.zeros(3), [np.sqrt(left)], turn]))
    return [_off(camera, error) for error in errors]


def _off(camera: Camera, error: np.ndarray) -> Camera:
    """The camera with its centre moved (m), its focal length longer by a share, and itself turned (radians)."""
    R = rotation_from_rotvec(error[4:]) @ camera.R_cam_from_world
    K = camera.K.copy()
    K[..., :2, :2] *= 1 + error[3]
    return Camera(
        K=K,
        distortion=camera.distortion,
        R_cam_from_world=R,
        t_cam_from_world=-(R @ (camera.position_world + error[:3])[..., None])[..., 0],
    )
