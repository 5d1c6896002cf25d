"""Lines of sight: the ray that a pixel stands for, and how many pixels a world point lies beside it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera, project, rays
from pgm_data.lift.camera_doubt import CameraDoubt

NEAREST_M = 0.1
"""Points no farther than this along the ray count as lying there: what is behind the camera is far off, not wrapped."""
TILT = 1e-5
"""Angle over which the picture's scale is taken."""
ACROSS = 100.0
"""Weight of the distance from the plane parallel to the net over that beside it, for rays at right angles to it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sights:
    """Rays, and the picture's scale about them; NaN where there is no such ray."""

    origin: Float[np.ndarray, "rays 3"]
    """Camera centre, world, m."""
    direction: Float[np.ndarray, "rays 3"]
    """Unit length, world."""
    across: Float[np.ndarray, "rays 2 3"]
    """Two unit directions at right angles to it and to one another: level, and downwards."""
    px_per_rad: Float[np.ndarray, "rays 2 2"]
    """Pixels (x, y) for each radian of `across`."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("origin", "direction", "across", "px_per_rad"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def known(self) -> Bool[np.ndarray, " rays"]:
        """Where there is a ray."""
        return np.asarray(np.isfinite(self.px_per_rad).all(axis=(1, 2)) & np.isfinite(self.direction).all(axis=1))

    def take(self, index: np.ndarray) -> "Sights":
        """The rays at those places, or where the mask is true."""
        return Sights(
            origin=self.origin[index],
            direction=self.direction[index],
            across=self.across[index],
            px_per_rad=self.px_per_rad[index],
        )

    def beside(self, points: Float[np.ndarray, "... rays 3"]) -> Float[np.ndarray, "... rays 2"]:
        """How far the points' pixels lie from those of the rays, px."""
        offset = points - self.origin
        depth = np.maximum((offset * self.direction).sum(axis=-1), NEAREST_M)
        angles = (self.across * offset[..., None, :]).sum(axis=-1) / depth[..., None]
        return (self.px_per_rad * angles[..., None, :]).sum(axis=-1)

    def pull(self) -> Float[np.ndarray, "rays 3 3"]:
        """P of `point = origin + P @ (guess - origin)`: the ray's point for a guess of where the ball is.

        Where the ray crosses planes parallel to the net well, it is the point in the guess's own; where it runs along
        them, the nearest point.
        """
        weighted = self.direction.copy()
        weighted[:, 1] *= 1 + ACROSS * self.direction[:, 1] ** 2
        size = (weighted * self.direction).sum(axis=-1)
        return self.direction[:, :, None] * weighted[:, None, :] / size[:, None, None]

    def at_height(self, height: Float[np.ndarray, " rays"] | float) -> Float[np.ndarray, "rays 3"]:
        """Where the rays meet the level plane; NaN where they never do."""
        with np.errstate(all="ignore"):
            far = (height - self.origin[:, 2]) / self.direction[:, 2]
            far = np.where((far > 0) & np.isfinite(far), far, np.nan)
            return self.origin + far[:, None] * self.direction

    def at_net(self) -> Float[np.ndarray, "rays 3"]:
        """Where the rays meet the plane y = 0; NaN where they never do."""
        with np.errstate(all="ignore"):
            far = -self.origin[:, 1] / self.direction[:, 1]
            far = np.where((far > 0) & np.isfinite(far), far, np.nan)
            return self.origin + far[:, None] * self.direction


def no_sights(count: int) -> Sights:
    """So many rays that there are not."""
    return Sights(
        origin=np.full((count, 3), np.nan),
        direction=np.full((count, 3), np.nan),
        across=np.full((count, 2, 3), np.nan),
        px_per_rad=np.full((count, 2, 2), np.nan),
    )


def sights_at(camera: Camera, frames: Int[np.ndarray, " rays"], pixels: Float[np.ndarray, "rays 2"]) -> Sights:
    """The rays of pixels in frames of a camera track; NaN where the frame has no camera or the pixel no ray."""
    cameras = camera[frames]
    direction = rays(cameras, pixels[:, None])[:, 0]
    level = np.stack([direction[:, 1], -direction[:, 0], np.zeros(len(frames))], axis=-1)
    upright = np.hypot(direction[:, 0], direction[:, 1]) < 1e-6
    level[upright] = [1.0, 0.0, 0.0]
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    across = np.stack([level, np.cross(direction, level)], axis=1)
    origin = cameras.position_world
    probes = origin[:, None] + 10.0 * (direction[:, None] + TILT * np.concatenate([across, -across], axis=1))
    seen = project(cameras, probes)[0]
    return Sights(
        origin=origin,
        direction=direction,
        across=across,
        px_per_rad=np.swapaxes(seen[:, :2] - seen[:, 2:], 1, 2) / (2 * TILT),
    )


def doubted(sights: Sights, doubt: CameraDoubt) -> list[Sights]:
    """The rays as they would be with the camera one standard deviation off, in each independent way.

    A camera is calibrated on its court: one with another centre sees the court's centre at the same pixel and scale,
    so that its turn and most of its focal length come with its place.
    """
    ways = []
    root = _root(doubt.position_cov)
    away = -sights.origin
    depth = np.linalg.norm(away, axis=-1, keepdims=True)
    ahead = away / depth
    offset = sights.direction / (sights.direction * ahead).sum(axis=-1, keepdims=True) - ahead
    for shift in root.T[np.abs(root).max(axis=0) > 0]:
        new_away = away - shift
        new_depth = np.linalg.norm(new_away, axis=-1, keepdims=True)
        new_ahead = new_away / new_depth
        turned = offset - (offset * (new_ahead - ahead)).sum(axis=-1, keepdims=True) * ahead
        ways.append(_redirected(sights, sights.origin + shift, new_ahead + turned * depth / new_depth))
    typical = np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
    by_place = float(np.sqrt(max(np.trace(doubt.position_cov), 0.0)) / typical)
    rest = float(np.sqrt(max(doubt.focal_std_share**2 - by_place**2, 0.0)))
    if doubt.focal_std_share > 0:
        ways.append(_redirected(sights, sights.origin, ahead + offset / (1 + rest)))
    return ways


def _redirected(sights: Sights, origin: np.ndarray, direction: np.ndarray) -> Sights:
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    across = sights.across - (sights.across @ direction[:, :, None]) * direction[:, None, :]
    return replace(sights, origin=origin, direction=direction, across=across)


def _root(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))
