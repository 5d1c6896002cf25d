"""Cameras that turn and zoom over a court: projection with analytic derivatives.

A camera here is a rotation, a focal length, a centre, and one radial lens term kept in the form that
stays constant under zoom: ``radial`` acts on the radius over the picture's half diagonal, so OpenCV's
k1 of a frame is ``radial * (focal / half_diagonal)^2``.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec

ROTATION, FOCAL, CENTRE, RADIAL, PRINCIPAL = slice(0, 3), slice(3, 4), slice(4, 7), slice(7, 8), slice(8, 10)
"""Columns of the derivatives: left-multiplied rotation vector (rad), log focal, centre (m), radial, principal (px)."""
PARAMETERS = 10


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtCamera:
    """One camera, or a track of them along leading axes."""

    R_cam_from_world: Float[np.ndarray, "*batch 3 3"]
    focal_px: Float[np.ndarray, "*batch"]
    position_world: Float[np.ndarray, "*batch 3"]
    """Camera centre, metres."""
    radial: Float[np.ndarray, "*batch"]
    """Radial lens term over the half diagonal, dimensionless; positive for pincushion."""
    principal_px: Float[np.ndarray, "*batch 2"]
    half_diagonal_px: float

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("R_cam_from_world", "focal_px", "position_world", "radial", "principal_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __getitem__(self, index) -> "CourtCamera":
        """The camera or cameras at the given leading index."""
        return replace(
            self,
            R_cam_from_world=self.R_cam_from_world[index],
            focal_px=np.asarray(self.focal_px[index]),
            position_world=self.position_world[index],
            radial=np.asarray(self.radial[index]),
            principal_px=self.principal_px[index],
        )

    def as_camera(self) -> Camera:
        """The same camera in the contract's terms (K, OpenCV distortion, R, t)."""
        K = np.zeros((*self.focal_px.shape, 3, 3))
        K[..., 0, 0] = K[..., 1, 1] = self.focal_px
        K[..., :2, 2] = self.principal_px
        K[..., 2, 2] = 1.0
        distortion = np.zeros((*self.focal_px.shape, 4))
        distortion[..., 0] = self.radial * (self.focal_px / self.half_diagonal_px) ** 2
        t = -(self.R_cam_from_world @ self.position_world[..., None])[..., 0]
        # A frame without a camera is NaN as a whole.
        absent = np.isnan(self.focal_px)
        K[absent], distortion[absent] = np.nan, np.nan
        return Camera(K=K, distortion=distortion, R_cam_from_world=self.R_cam_from_world, t_cam_from_world=t)


def step(camera: CourtCamera, delta: Float[np.ndarray, "*batch 10"]) -> CourtCamera:
    """The camera moved by a step in the columns' order."""
    return replace(
        camera,
        R_cam_from_world=rotation_from_rotvec(delta[..., ROTATION]) @ camera.R_cam_from_world,
        focal_px=np.asarray(camera.focal_px * np.exp(delta[..., 3])),
        position_world=camera.position_world + delta[..., CENTRE],
        radial=np.asarray(camera.radial + delta[..., 7]),
        principal_px=camera.principal_px + delta[..., PRINCIPAL],
    )


def project(
    camera: CourtCamera, points_world: Float[np.ndarray, "*batch points 3"]
) -> Float[np.ndarray, "*batch points 2"]:
    """Pixels of world points; NaN behind the camera or past the fold of the lens."""
    pixels, _ = _project(camera, points_world, with_jacobian=False)
    return pixels


def project_with_jacobian(
    camera: CourtCamera, points_world: Float[np.ndarray, "*batch points 3"]
) -> tuple[Float[np.ndarray, "*batch points 2"], Float[np.ndarray, "*batch points 2 10"]]:
    """Pixels of world points and their derivatives by the ten parameters, in the columns' order."""
    pixels, jacobian = _project(camera, points_world, with_jacobian=True)
    assert jacobian is not None
    return pixels, jacobian


def _project(
    camera: CourtCamera, points_world: np.ndarray, *, with_jacobian: bool
) -> tuple[np.ndarray, np.ndarray | None]:
    R = camera.R_cam_from_world
    cam = (points_world - camera.position_world[..., None, :]) @ np.swapaxes(R, -1, -2)
    z = np.where(cam[..., 2] > 1e-9, cam[..., 2], np.nan)
    u, v = cam[..., 0] / z, cam[..., 1] / z
    f = camera.focal_px[..., None]
    zoom = (f / camera.half_diagonal_px) ** 2
    k1 = camera.radial[..., None] * zoom
    s = u * u + v * v
    s = np.where(1 + 3 * k1 * s > 0, s, np.nan)
    radial = 1 + k1 * s
    pixels = np.stack([f * u * radial, f * v * radial], axis=-1) + camera.principal_px[..., None, :]
    if not with_jacobian:
        return pixels, None
    # Pixel by (u, v): radial * I + 2 k1 (u, v)(u, v)^T; (u, v) by the camera point; the point by each parameter.
    duv = np.empty((*u.shape, 2, 2))
    duv[..., 0, 0] = f * (radial + 2 * k1 * u * u)
    duv[..., 1, 1] = f * (radial + 2 * k1 * v * v)
    duv[..., 0, 1] = duv[..., 1, 0] = f * 2 * k1 * u * v
    dcam = np.zeros((*u.shape, 2, 3))
    dcam[..., 0, 0] = dcam[..., 1, 1] = 1 / z
    dcam[..., 0, 2], dcam[..., 1, 2] = -u / z, -v / z
    by_cam = duv @ dcam
    J = np.zeros((*u.shape, 2, PARAMETERS))
    # A left-multiplied small rotation w moves the camera point by w x p, so row a gives (p x a).
    J[..., ROTATION] = np.cross(cam[..., None, :], by_cam)
    J[..., 0, 3], J[..., 1, 3] = f * u * (1 + 3 * k1 * s), f * v * (1 + 3 * k1 * s)
    J[..., CENTRE] = -by_cam @ R[..., None, :, :]
    J[..., 0, 7], J[..., 1, 7] = f * u * zoom * s, f * v * zoom * s
    J[..., 0, 8] = J[..., 1, 9] = 1.0
    return pixels, J
