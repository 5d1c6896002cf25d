"""Many flights of a ball fitted to a track at once, fast and approximately.

With the speed known, drag only scales the velocity, and Magnus lift is linear in the spin: a flight is then linear in
its start position, start velocity and spin, and so is the algebraic distance of a point from a pixel's ray. Each turn
of a fit takes speeds, depths and weights from the turn before and solves one small linear system a flight.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.ball import BallTrack
from pgm_data.geometry.camera import Camera, rays
from pgm_data.lift.ball.world import GRAVITY, BallWorld

TURNS = 6
STRAY_SHARE = 0.03
"""Share of frames that show something else than the ball."""
STRAY_COST = 8.0
"""What such a frame costs more than one on the path, nats."""
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
        """One of so many frames, as sharp as all of them together."""
        if every <= 1:
            return self
        kept = {name: getattr(self, name)[::every] for name in self.__dataclass_fields__}
        return Sights(**(kept | {"sigma_px": kept["sigma_px"] / np.sqrt(every)}))


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


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightGuess:
    """What is believed of each flight before a pixel is looked at: Gaussians, world metres and seconds."""

    start: Float[np.ndarray, "flights 3"]
    start_std: Float[np.ndarray, "flights 3"]
    end: Float[np.ndarray, "flights 3"]
    end_std: Float[np.ndarray, "flights 3"]
    velocity_std: Float[np.ndarray, "flights 3"]
    """Of the start velocity, about 0."""
    spin_std: Float[np.ndarray, " flights"]
    start_time_std: Float[np.ndarray, " flights"]
    """Where the start lies on the ground, the doubt of its time softens that with the vertical speed."""
    end_time_std: Float[np.ndarray, " flights"]
    start_on_ground: Bool[np.ndarray, " flights"]
    end_on_ground: Bool[np.ndarray, " flights"]


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightFits:
    """Flights fitted to a track; arrays one row a flight. States are position and velocity, m and m/s."""

    cost: Float[np.ndarray, " flights"]
    """Negative log evidence against frames that lie on the path exactly, nats; parsimony is part of it."""
    start: Float[np.ndarray, "flights 6"]
    start_cov: Float[np.ndarray, "flights 6 6"]
    end: Float[np.ndarray, "flights 6"]
    end_cov: Float[np.ndarray, "flights 6 6"]
    start_off: Float[np.ndarray, "flights 6"]
    """Start less its prior's mean."""
    start_prior_std: Float[np.ndarray, "flights 6"]
    spin: Float[np.ndarray, "flights 3"]
    path: Float[np.ndarray, "flights times 3"]
    """Positions at the start, the frames, the end; after the end they repeat it."""
    measured: Int[np.ndarray, " flights"]
    """Frames that lie between start and end."""
    strays: Float[np.ndarray, " flights"]
    """How many of them seem to show something else."""
    inside: Float[np.ndarray, " flights"]
    """Share of the cost that the frames make, nats, less the one a frame that is expected of a right fit."""


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


def _state_rows(motion: Motion, index: int) -> np.ndarray:
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


def fit_flights(
    sights: Sights,
    begins: Float[np.ndarray, " flights"],
    ends: Float[np.ndarray, " flights"],
    guess: FlightGuess,
    *,
    world: BallWorld,
    turns: int = TURNS,
) -> FlightFits:
    """The best flight between each pair of times (which differ), and what it costs."""
    flights = len(begins)
    first = np.searchsorted(sights.times, begins, side="left")
    count = np.searchsorted(sights.times, ends, side="right") - first
    index = first[:, None] + np.arange(max(int(count.max(initial=0)), 1))
    real = np.arange(index.shape[1]) < count[:, None]
    index = np.where(real, index, 0)
    inner = np.where(real, sights.times[index], ends[:, None])
    times = np.concatenate([begins[:, None], inner, ends[:, None]], axis=1)
    planes, offsets = sights.planes[index], sights.offsets[index]
    sharp = np.where(real, 1 / sights.sigma_px[index], 0.0)
    share = (times - begins[:, None]) / (ends - begins)[:, None]
    position = guess.start[:, None] + share[..., None] * (guess.end - guess.start)[:, None]
    velocity = np.repeat(((guess.end - guess.start) / (ends - begins)[:, None])[:, None], times.shape[1], axis=1)
    weight = np.ones_like(sharp)
    p = v = w = np.zeros((flights, 3))
    start_std, end_std = guess.start_std.copy(), guess.end_std.copy()
    axis, axis_offset = sights.axis[index], sights.axis_offset[index]
    normal = np.zeros((flights, 9, 9))
    motion = motion_along(times, velocity, world)
    square = np.zeros_like(sharp)
    prior = np.zeros((flights, 9))
    for turn in range(turns):
        motion = motion_along(times, velocity, world)
        depth = np.sum(axis * position[:, 1:-1], axis=-1) + axis_offset
        scale = sharp / np.maximum(depth, 0.1)
        reach, bend = motion.reach[:, 1:-1], motion.bend[:, 1:-1]
        scaled = planes * scale[..., None, None]
        rows = np.concatenate(
            [scaled, reach[..., None, None] * scaled, np.cross(bend[:, :, None], scaled)], axis=-1
        )
        wanted = -offsets * scale[..., None] + scaled[..., 2] * motion.fall[:, 1:-1, None]
        soft = np.sqrt(weight)[..., None]
        design = (rows * soft[..., None]).reshape(flights, 2 * sharp.shape[1], 9)
        target = (wanted * soft).reshape(flights, 2 * sharp.shape[1])
        start_std[:, 2] = np.where(
            guess.start_on_ground, np.hypot(guess.start_std[:, 2], guess.start_time_std * np.abs(velocity[:, 0, 2])), start_std[:, 2]
        )
        end_std[:, 2] = np.where(
            guess.end_on_ground, np.hypot(guess.end_std[:, 2], guess.end_time_std * np.abs(velocity[:, -1, 2])), end_std[:, 2]
        )
        prior = np.concatenate([start_std, guess.velocity_std, np.repeat(guess.spin_std[:, None], 3, axis=1)], axis=1)
        at_end = _state_rows(motion, -1)[:, :3] / end_std[..., None]
        end_wanted = (guess.end + np.stack([0 * begins, 0 * begins, motion.fall[:, -1]], axis=-1)) / end_std
        normal = np.swapaxes(design, 1, 2) @ design + np.swapaxes(at_end, 1, 2) @ at_end
        normal[:, np.arange(9), np.arange(9)] += prior**-2
        right = np.einsum("fri,fr->fi", design, target) + np.einsum("fri,fr->fi", at_end, end_wanted)
        right[:, :3] += guess.start / start_std**2
        found = np.linalg.solve(normal, right[..., None])[..., 0]
        p, v, w = found[:, :3], found[:, 3:6], found[:, 6:]
        position, velocity = motion.position(p, v, w), motion.velocity(v, w)
        square = np.sum((np.einsum("ftki,fi->ftk", rows, found) - wanted) ** 2, axis=-1)
        # Wide at first, so that a poor start loses no frames.
        width = 16.0 if turn < 1 else (4.0 if turn < 3 else 1.0)
        weight = 1 / (1 + np.exp(np.minimum(0.5 * square / width - STRAY_COST, 50.0)))
    return _fitted(
        _Solved(
            motion=motion, normal=normal, prior=prior, p=p, v=v, w=w, square=np.where(real, square, 0.0),
            position=position, velocity=velocity, start_std=start_std, end_std=end_std,
        ),
        guess,
        count,
        np.where(real, 1 - weight, 0.0).sum(axis=1),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Solved:
    """The last turn of a fit."""

    motion: Motion
    normal: np.ndarray
    prior: np.ndarray
    p: np.ndarray
    v: np.ndarray
    w: np.ndarray
    square: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    start_std: np.ndarray
    end_std: np.ndarray


def _fitted(solved: _Solved, guess: FlightGuess, count: np.ndarray, strays: np.ndarray) -> FlightFits:
    """Evidence and end states of the last turn."""
    cov = np.linalg.inv(solved.normal)
    inside = -np.logaddexp(np.log1p(-STRAY_SHARE) - 0.5 * solved.square, -STRAY_COST)
    inside = np.where(np.arange(inside.shape[1]) < count[:, None], inside - 1.0, 0.0).sum(axis=1)
    off = np.concatenate(
        [(solved.p - guess.start) / solved.start_std, solved.v / guess.velocity_std, solved.w / guess.spin_std[:, None]],
        axis=1,
    )
    at_end = (solved.position[:, -1] - guess.end) / solved.end_std
    log_volume = 0.5 * np.linalg.slogdet(solved.normal)[1] + np.log(solved.prior).sum(axis=1)
    cost = inside + 0.5 * np.sum(off**2, axis=1) + 0.5 * np.sum(at_end**2, axis=1) + log_volume
    first, last = _state_rows(solved.motion, 0), _state_rows(solved.motion, -1)
    return FlightFits(
        cost=np.where(np.isfinite(cost), cost, np.inf),
        start=np.concatenate([solved.p, solved.v], axis=1),
        start_cov=first @ cov @ np.swapaxes(first, 1, 2),
        end=np.concatenate([solved.position[:, -1], solved.velocity[:, -1]], axis=1),
        end_cov=last @ cov @ np.swapaxes(last, 1, 2),
        start_off=np.concatenate([solved.p - guess.start, solved.v], axis=1),
        start_prior_std=np.concatenate([solved.start_std, guess.velocity_std], axis=1),
        spin=solved.w,
        path=solved.position,
        measured=count,
        inside=inside,
        strays=strays,
    )
