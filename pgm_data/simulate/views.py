"""Where broadcast cameras stand, how they are framed, and how they follow play."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.simulate.camera import CameraTrack, k1_of_half_diagonal, pixels_of, rotation_of, rotation_towards

TENNIS_HALF_LENGTH_M = 11.835


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """One camera. Raises ValueError if the court's near end is behind it."""

    K: Float[np.ndarray, "3 3"]
    k1: float
    R_cam_from_world: Float[np.ndarray, "3 3"]
    centre_world: Float[np.ndarray, " 3"]

    @property
    def t_cam_from_world(self) -> np.ndarray:
        """Translation, metres."""
        return -self.R_cam_from_world @ self.centre_world


def track_of(views: list[View | None]) -> CameraTrack:
    """The track of frames with these cameras, NaN where there is none."""
    lost = np.full(3, np.nan)
    return CameraTrack(
        K=np.array([np.full((3, 3), np.nan) if v is None else v.K for v in views]).reshape(-1, 3, 3),
        distortion=np.array([np.full(4, np.nan) if v is None else [v.k1, 0.0, 0.0, 0.0] for v in views]).reshape(-1, 4),
        R_cam_from_world=np.array(
            [np.full((3, 3), np.nan) if v is None else v.R_cam_from_world for v in views]
        ).reshape(-1, 3, 3),
        t_cam_from_world=np.array([lost if v is None else v.t_cam_from_world for v in views]).reshape(-1, 3),
    )


def court_scale(court: Court) -> float:
    """This court's length over a tennis court's."""
    return float(np.abs(court.points_world[:, 1]).max()) / TENNIS_HALF_LENGTH_M


@dataclass(frozen=True, eq=False, kw_only=True)
class Pose:
    """A camera by the numbers that its operator turns."""

    centre_world: Float[np.ndarray, " 3"]
    """Metres."""
    heading: float
    """Radians to the right of the y axis."""
    tilt: float
    """Radians above level."""
    roll: float
    """Radians, clockwise."""
    focal_px: float
    principal_px: tuple[float, float]
    k: float
    """Radial term over the picture's half diagonal."""

    def view(self, size: tuple[int, int]) -> View:
        """The camera of pictures of this size (width, height)."""
        cx, cy = self.principal_px
        return View(
            K=np.array([[self.focal_px, 0.0, cx], [0.0, self.focal_px, cy], [0.0, 0.0, 1.0]]),
            k1=k1_of_half_diagonal(self.k, self.focal_px, *size),
            R_cam_from_world=rotation_of(self.heading, self.tilt, self.roll),
            centre_world=np.asarray(self.centre_world, dtype=float),
        )


def framed_pose(
    *,
    centre_world: np.ndarray,
    aim_world: np.ndarray,
    aim_px: tuple[float, float],
    roll: float,
    focal_px: float,
    principal_px: tuple[float, float],
    k: float,
) -> Pose:
    """The camera at a centre that sees `aim_world` near `aim_px`."""
    direction = aim_world - centre_world
    pan = np.arctan2(aim_px[0] - principal_px[0], focal_px)
    tilt = np.arctan2(direction[2], np.hypot(direction[0], direction[1]))
    tilt += np.arctan2(aim_px[1] - principal_px[1], focal_px)
    return Pose(
        centre_world=np.asarray(centre_world, dtype=float),
        heading=float(np.arctan2(direction[0], direction[1]) - pan),
        tilt=float(np.clip(tilt, -1.45, 1.45)),
        roll=roll,
        focal_px=focal_px,
        principal_px=principal_px,
        k=k,
    )


def focal_for_span(court: Court, centre_world: np.ndarray, aim_world: np.ndarray, share: float, width: int) -> float:
    """Focal length at which the near end of the court spans `share` of the picture's width, pixels."""
    points = court.points_world
    near = points[np.isclose(points[:, 1], points[:, 1].min())]
    forward = (aim_world - centre_world) / np.linalg.norm(aim_world - centre_world)
    R = rotation_towards(forward, 0.0)
    cam = (near - centre_world) @ R.T
    depth = np.maximum(cam[:, 2], 0.5 * np.linalg.norm(cam, axis=1))
    across = cam[:, 0] / depth
    return share * width / max(float(across.max() - across.min()), 1e-6)


def broadcast_pose(rng: np.random.Generator, court: Court, size: tuple[int, int], *, cropped: bool = False) -> Pose:
    """The main camera of a match: behind the near end, high, on the long axis; most crossings are seen."""
    scale = court_scale(court)
    while True:
        centre = scale * np.array([rng.normal(0, 0.4), -rng.uniform(29.0, 53.0), rng.uniform(6.0, 14.0)])
        if rng.random() < 0.15:
            centre[0] = scale * rng.uniform(-1.5, 1.5)
        aim = scale * np.array([rng.normal(0, 0.6), rng.uniform(-4.5, 1.5), 0.0])
        pose = _framed(rng, court, size, centre, aim, rng.uniform(0.55, 0.95), cropped)
        if points_in_picture(court, pose.view(size), size) >= 0.7 * len(court.points_world):
            return pose


def any_view(rng: np.random.Generator, court: Court, size: tuple[int, int]) -> View:
    """A camera for training pictures: mostly broadcast, else low, high, off the axis, oblique or zoomed in."""
    scale = court_scale(court)
    kind = rng.random()
    cropped = rng.random() < 0.1
    if kind < 0.55:
        return broadcast_pose(rng, court, size, cropped=cropped).view(size)
    centre = np.array([rng.normal(0, 1.0), -rng.uniform(20.0, 55.0), rng.uniform(5.0, 16.0)])
    aim = np.array([rng.normal(0, 1.5), rng.uniform(-6.0, 4.0), 0.0])
    share = rng.uniform(0.45, 1.1)
    if kind < 0.67:  # off the axis
        centre[0] = rng.uniform(-7.0, 7.0)
        aim[0] = rng.uniform(-3.0, 3.0)
    elif kind < 0.75:  # low
        centre = np.array([rng.uniform(-4, 4), -rng.uniform(14.0, 34.0), rng.uniform(1.6, 5.0)])
        share = rng.uniform(0.5, 1.3)
    elif kind < 0.82:  # high
        centre[1:] = -rng.uniform(14.0, 45.0), rng.uniform(14.0, 32.0)
        share = rng.uniform(0.3, 0.9)
    elif kind < 0.93:  # only part of the court
        share = rng.uniform(1.1, 2.2)
        aim = np.array([rng.uniform(-6, 6), rng.uniform(-12, 12), 0.0])
    else:  # oblique
        angle, reach = rng.uniform(-1.2, 1.2), rng.uniform(18.0, 45.0)
        centre = np.array([reach * np.sin(angle), -reach * np.cos(angle), rng.uniform(2.5, 16.0)])
        share = rng.uniform(0.4, 1.1)
    return _framed(rng, court, size, scale * centre, scale * aim, share, cropped).view(size)


def _framed(rng, court, size, centre, aim, share, cropped) -> Pose:
    width, height = size
    focal = float(np.clip(focal_for_span(court, centre, aim, share, width), 0.45 * width, 6.0 * width))
    principal = [(width - 1) / 2.0, (height - 1) / 2.0]
    if cropped:
        principal[0] += rng.uniform(-0.12, 0.12) * width
        principal[1] += rng.uniform(-0.15, 0.15) * height
    k = rng.uniform(0.0, 0.05) if rng.random() < 0.9 else 0.0
    return framed_pose(
        centre_world=centre,
        aim_world=aim,
        aim_px=((width - 1) / 2.0 + rng.normal(0, 0.02) * width, rng.uniform(0.46, 0.62) * height),
        roll=float(np.radians(np.clip(rng.normal(0, 0.35), -0.7, 0.7))),
        focal_px=focal,
        principal_px=(principal[0], principal[1]),
        k=k,
    )


def points_in_picture(court: Court, view: View, size: tuple[int, int]) -> int:
    """How many of the court's crossings this camera sees inside its picture."""
    px = pixels_of(court.points_world, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    inside = (px > -0.5).all(axis=-1) & (px[:, 0] < size[0] - 0.5) & (px[:, 1] < size[1] - 0.5)
    return int(inside.sum())
