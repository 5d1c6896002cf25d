"""How a ball in flight moves when its speed is about known, and the rays through which it is seen.

With the speed known, drag only scales the velocity, and Magnus lift is linear in the spin: a flight is then linear in
its start position, start velocity and spin, and so is the algebraic distance of a point from a pixel's ray.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.ball import BallTrack
from pgm_data.geometry.camera import Camera, rays
from pgm_data.lift.ball.world import GRAVITY, BallWorld

MOST_SPEED = 120.0
"""Faster balls are taken as this fast where drag is computed, m/s."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sights:
    """Rays of a track's measured frames as equations that the ball's position x solves: ``planes @ x + offsets = 0``.

    An equation over the depth ``axis @ x + axis_offset`` is the distance from the pixel, px.
    """

    times: Float[np.ndarray, " sights"]
    planes: Float[np.ndarray, "sights 2 3"]
    offsets: Float[np.ndarray, "sights 2"]
    axis: Float[np.ndarray, "sights 3"]
    axis_offset: Float[np.ndarray, " sights"]
    sigma_px: Float[np.ndarray, " sights"]
    centre: Float[np.ndarray, "sights 3"]
    """Centre of the camera, world metres."""
    direction: Float[np.ndarray, "sights 3"]
    """Of the ray, world."""
    frames: Int[np.ndarray, " sights"]
    """Frame of the track."""

    def __len__(self) -> int:
        """Number of measured frames."""
        return len(self.times)

    def thinned(self, every: int) -> "Sights":
        """One of so many frames."""
        if every <= 1:
            return self
        return Sights(**{name: getattr(self, name)[::every] for name in self.__dataclass_fields__})


def sights_of(track: BallTrack, camera: Camera) -> Sights:
    """Sights of the measured frames that have a camera and differ in time, in order of time."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        direction = rays(camera, track.pixels[:, None])[:, 0]
    known = track.measured & np.isfinite(direction).all(axis=1) & np.isfinite(camera.t_cam_from_world).all(axis=1)
    frames = np.flatnonzero(known)
    frames = frames[np.diff(track.times[frames], prepend=-np.inf) > 0]
    direction = direction[frames]
    R, t = camera.R_cam_from_world[frames], camera.t_cam_from_world[frames]
    seen = np.einsum("nij,nj->ni", R, direction)
    focal = camera.K[frames][:, [0, 1], [0, 1]]
    # Skew is left to the lens: planes along the camera's own x and y.
    planes = focal[..., None] * (R[:, :2] - (seen[:, :2] / seen[:, 2:])[..., None] * R[:, 2:])
    offsets = focal * (t[:, :2] - seen[:, :2] / seen[:, 2:] * t[:, 2:])
    return Sights(
        times=track.times[frames],
        planes=planes,
        offsets=offsets,
        axis=R[:, 2],
        axis_offset=t[:, 2],
        sigma_px=track.sigma_px[frames],
        centre=camera.position_world[frames],
        direction=direction,
        frames=frames,
    )


def velocity_scale(world: BallWorld) -> np.ndarray:
    """Standard deviation of a ball's velocity along x, y, z after a hit, m/s."""
    along = 2.0 * world.reach_half_size[1]
    return np.array([0.35 * along, along, 0.3 * along + 2.0])


def _sums(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integrals from the first time on, by trapezoids along axis 1."""
    parts = 0.5 * (values[:, 1:] + values[:, :-1]) * step.reshape(step.shape + (1,) * (values.ndim - 2))
    return np.concatenate([np.zeros_like(values[:, :1]), np.cumsum(parts, axis=1)], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """A flight, linear in start position p, start velocity v and spin w, at each time.

    ``position = p + reach v - fall z + w x bend``, and the velocity likewise with the other three.
    """

    reach: Float[np.ndarray, "flights times"]
    fall: Float[np.ndarray, "flights times"]
    bend: Float[np.ndarray, "flights times 3"]
    kept: Float[np.ndarray, "flights times"]
    fall_speed: Float[np.ndarray, "flights times"]
    bend_speed: Float[np.ndarray, "flights times 3"]

    def position(self, p: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Positions of flights with such starts, flights times 3."""
        at = p[:, None] + self.reach[..., None] * v[:, None] + np.cross(w[:, None], self.bend)
        at[..., 2] -= self.fall
        return at

    def velocity(self, v: np.ndarray, w: np.ndarray) -> np.ndarray:
        """Velocities, flights times 3."""
        at = self.kept[..., None] * v[:, None] + np.cross(w[:, None], self.bend_speed)
        at[..., 2] -= self.fall_speed
        return at


def motion_along(
    times: Float[np.ndarray, "flights times"], velocity: Float[np.ndarray, "flights times 3"], world: BallWorld
) -> Motion:
    """How a flight moves whose velocity is about this one."""
    step = np.diff(times, axis=1)
    speed = np.minimum(np.linalg.norm(velocity, axis=-1), MOST_SPEED)
    damping = np.minimum(_sums(world.drag_per_m.mean * speed, step), 40.0)
    kept = np.exp(-damping)
    fall_speed = GRAVITY * kept * _sums(1 / kept, step)
    # Lift: lift_per_m S / (1 + 2 S) |v| (w x v) / |w|, with S = radius |w| / |v|, the denominator at the prior's spin.
    share = world.lift_per_m * world.radius_m / (1 + 2 * world.radius_m * world.spin_std / np.maximum(speed, 1.0))
    bend_speed = kept[..., None] * _sums((share / kept)[..., None] * velocity, step)
    return Motion(
        reach=_sums(kept, step),
        fall=_sums(fall_speed, step),
        bend=_sums(bend_speed, step),
        kept=kept,
        fall_speed=fall_speed,
        bend_speed=bend_speed,
    )


def _turned(vectors: np.ndarray) -> np.ndarray:
    """Matrices M with ``M @ w = w x vector``."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, z, -y], -1), np.stack([-z, o, x], -1), np.stack([y, -x, o], -1)], axis=-2)


def state_rows(motion: Motion, index: int) -> np.ndarray:
    """Position and velocity at a time as a linear map of start position, start velocity and spin: flights 6 9."""
    flights = len(motion.reach)
    rows = np.zeros((flights, 6, 9))
    one = np.eye(3)
    rows[:, :3, :3] = one
    rows[:, :3, 3:6] = motion.reach[:, index, None, None] * one
    rows[:, 3:, 3:6] = motion.kept[:, index, None, None] * one
    rows[:, :3, 6:] = _turned(motion.bend[:, index])
    rows[:, 3:, 6:] = _turned(motion.bend_speed[:, index])
    return rows


def solved(normal: Float[np.ndarray, "*batch n n"], right: Float[np.ndarray, "*batch n"]) -> np.ndarray:
    """Solutions of positive definite systems whose unknowns may differ much in scale."""
    scale, even = _evened(normal)
    return np.linalg.solve(even, (right / scale)[..., None])[..., 0] / scale


def inverted(normal: Float[np.ndarray, "*batch n n"]) -> np.ndarray:
    """Inverses of such matrices."""
    scale, even = _evened(normal)
    return np.linalg.inv(even) / (scale[..., :, None] * scale[..., None, :])


def _evened(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scales of the unknowns, and the matrices with ones on the diagonal and a trace more."""
    scale = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    even = normal / (scale[..., :, None] * scale[..., None, :])
    return scale, even + 1e-11 * np.eye(normal.shape[-1])
