"""Flights of whole plays fitted together: they meet at their contacts, whose times are free."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Shaped

from pgm_data.lift.ball.contact_motion import Motion, Sights, inverted, motion_along, solved, state_rows, velocity_scale
from pgm_data.lift.ball.world import BallWorld

TURNS = 8
STRAY_COST = 8.0
"""What a frame that shows something else costs more than one on the path, nats."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaySketch:
    """Flights to be fitted together, in order of time; arrays one row a flight."""

    begins: Float[np.ndarray, " flights"]
    """Capture times, s."""
    ends: Float[np.ndarray, " flights"]
    kinds: Shaped[np.ndarray, " flights"]
    """Kind of the contact at which the flight begins; of `hit`, `bounce`, `net`, `first`."""
    joined: Bool[np.ndarray, " flights"]
    """Whether it begins where the one before ends."""
    time_std: Float[np.ndarray, " flights"]
    """Of the time at which it begins, s."""
    state: Float[np.ndarray, "flights 9"]
    """A guess of position, velocity and spin at the start."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayFlights:
    """Flights fitted together; arrays one row a flight."""

    begins: Float[np.ndarray, " flights"]
    begin_std: Float[np.ndarray, " flights"]
    """Standard deviation of the time, s."""
    ends: Float[np.ndarray, " flights"]
    state: Float[np.ndarray, "flights 9"]
    """Position, velocity and spin just after the start: m, m/s, rad/s."""
    state_cov: Float[np.ndarray, "flights 9 9"]
    end_state: Float[np.ndarray, "flights 6"]
    residual: Float[np.ndarray, " flights"]
    """Rms distance of the frames that belong to the path, in their standard deviations; NaN where there are none."""
    misfit: Float[np.ndarray, " flights"]
    """Share of its frames that lie farther off than three standard deviations."""

    def take(self, index: np.ndarray) -> "PlayFlights":
        """The flights at those places."""
        return PlayFlights(**{name: getattr(self, name)[index] for name in self.__dataclass_fields__})


def fit_plays(sights: Sights, sketch: PlaySketch, *, world: BallWorld, step: float) -> PlayFlights:
    """Flights and contact times that explain the frames best."""
    count = len(sketch.begins)
    begins, ends = sketch.begins.copy(), sketch.ends.copy()
    asked = sketch.begins
    state = sketch.state.copy()
    joined = np.flatnonzero(sketch.joined)
    normal = np.eye(10 * count)
    times = np.stack([begins, ends], axis=1)
    motion = motion_along(times, np.repeat(state[:, None, 3:6], 2, axis=1), world)
    square, real = np.zeros((count, 1)), np.zeros((count, 1), dtype=bool)
    for turn in range(TURNS):
        first = np.searchsorted(sights.times, begins, side="left")
        frames = np.searchsorted(sights.times, ends, side="left") - first
        frames = np.where(np.append(sketch.joined[1:], False), frames, frames + 1)
        frames = np.clip(frames, 0, len(sights) - first)
        index = first[:, None] + np.arange(max(int(frames.max(initial=0)), 1))
        real = np.arange(index.shape[1]) < frames[:, None]
        index = np.where(real, index, 0)
        new_times = np.concatenate(
            [begins[:, None], np.where(real, sights.times[index], ends[:, None]), ends[:, None]], 1
        )
        new_times = np.minimum(new_times, np.maximum(ends, begins)[:, None])
        velocity = _resampled(times, motion.velocity(state[:, 3:6], state[:, 6:]), new_times)
        times = new_times
        motion = motion_along(times, velocity, world)
        velocity = motion.velocity(state[:, 3:6], state[:, 6:])
        position = motion.position(state[:, :3], state[:, 3:6], state[:, 6:])
        depth = np.sum(sights.axis[index] * position[:, 1:-1], axis=-1) + sights.axis_offset[index]
        scale = np.where(real, 1 / sights.sigma_px[index], 0.0) / np.maximum(depth, 0.1)
        scaled = sights.planes[index] * scale[..., None, None]
        rows = np.concatenate(
            [
                scaled,
                motion.reach[:, 1:-1, None, None] * scaled,
                np.cross(motion.bend[:, 1:-1, None], scaled),
                -np.einsum("ftki,fti->ftk", scaled, velocity[:, 1:-1])[..., None],
            ],
            axis=-1,
        )
        wanted = -sights.offsets[index] * scale[..., None] + scaled[..., 2] * motion.fall[:, 1:-1, None]
        now = np.concatenate([state, np.zeros((count, 1))], axis=1)
        square = np.sum((np.einsum("ftki,fi->ftk", rows, now) - wanted) ** 2, axis=-1)
        width = 9.0 if turn < 2 else (4.0 if turn < 4 else 1.0)
        weight = np.where(real, 1 / (1 + np.exp(np.minimum(0.5 * square / width - STRAY_COST, 50.0))), 0.0)
        soft = np.sqrt(weight)[..., None]
        design = (rows * soft[..., None]).reshape(count, 2 * index.shape[1], 10)
        blocks = np.swapaxes(design, 1, 2) @ design
        right = np.einsum("fri,fr->fi", design, (wanted * soft).reshape(count, 2 * index.shape[1]))
        _add_priors(blocks, right, sketch, begins, asked, world, velocity)
        normal, right = _with_junctions(blocks, right, joined, sketch, motion, velocity, world)
        found = solved(normal, right).reshape(count, 10)
        state = found[:, :9]
        shift = np.where(sketch.joined, np.clip(found[:, 9], -1.5 * step, 1.5 * step), 0.0)
        moved = begins + shift
        # Contacts keep their order.
        low = np.concatenate([[-np.inf], begins[:-1]]) + 0.2 * step
        high = ends - 0.2 * step
        begins = np.where(sketch.joined, np.clip(moved, low, np.maximum(high, low)), begins)
        ends[joined - 1] = begins[joined]
    cov = inverted(normal)
    cov = cov.reshape(count, 10, count, 10)[np.arange(count), :, np.arange(count)]
    kept = real & (square < 2 * STRAY_COST)
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = np.sqrt(np.where(kept, square, 0.0).sum(axis=1) / kept.sum(axis=1))
    position = motion.position(state[:, :3], state[:, 3:6], state[:, 6:])
    velocity = motion.velocity(state[:, 3:6], state[:, 6:])
    return PlayFlights(
        begins=begins,
        begin_std=np.where(sketch.joined, np.sqrt(np.maximum(cov[:, 9, 9], 0.0)), sketch.time_std),
        ends=ends,
        state=state,
        state_cov=cov[:, :9, :9],
        end_state=np.concatenate([position[:, -1], velocity[:, -1]], axis=1),
        residual=residual,
        misfit=(real & (square > 9.0 + 2.0)).sum(axis=1) / np.maximum(real.sum(axis=1), 1),
    )


def _resampled(times: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values of each row at other times of it."""
    if times.shape == wanted.shape and np.array_equal(times, wanted):
        return values
    count = times.shape[1]
    at = (times[:, :, None] < wanted[:, None]).sum(axis=1)
    at = np.clip(at, 1, count - 1)
    low = np.take_along_axis(times, at - 1, 1)
    width = np.take_along_axis(times, at, 1) - low
    share = np.clip(np.where(width > 0, (wanted - low) / np.where(width > 0, width, 1.0), 1.0), 0.0, 1.0)[..., None]
    before = np.take_along_axis(values, (at - 1)[..., None], 1)
    after = np.take_along_axis(values, at[..., None], 1)
    return before + share * (after - before)


def _add_priors(
    blocks: np.ndarray,
    right: np.ndarray,
    sketch: PlaySketch,
    begins: np.ndarray,
    asked: np.ndarray,
    world: BallWorld,
    velocity: np.ndarray,
) -> None:
    """Add to the flights' systems what is believed of start, velocity, spin and time."""
    count = len(begins)
    reach = world.reach_half_size
    bounce = sketch.kinds == "bounce"
    mean = np.zeros((count, 10))
    std = np.empty((count, 10))
    mean[:, 2] = np.where(bounce, world.radius_m, world.hit_height.mean)
    std[:, 0], std[:, 1] = 0.6 * reach[0], 0.7 * reach[1]
    std[:, 2] = np.where(bounce, 0.2 * world.radius_m, 1.4 * world.hit_height.std)
    std[:, :2] = np.where(bounce[:, None], np.array(reach), std[:, :2])
    net = sketch.kinds == "net"
    std[:, 1] = np.where(net, 0.1, std[:, 1])
    std[:, 3:6] = velocity_scale(world)
    std[:, 6:9] = np.where(bounce, 1.5, 1.0)[:, None] * max(world.spin_std, 1.0)
    std[:, 9] = np.where(sketch.joined, sketch.time_std, 1e-6)
    mean[:, 9] = asked - begins
    diagonal = np.arange(10)
    blocks[:, diagonal, diagonal] += std**-2
    right += mean / std**2


def _with_junctions(
    blocks: np.ndarray,
    right: np.ndarray,
    joined: np.ndarray,
    sketch: PlaySketch,
    motion: Motion,
    velocity: np.ndarray,
    world: BallWorld,
) -> tuple[np.ndarray, np.ndarray]:
    """The whole system: flights meet, and bounces keep their law."""
    count = len(blocks)
    normal = np.zeros((count, 10, count, 10))
    normal[np.arange(count), :, np.arange(count)] = blocks
    right = right.copy()
    if len(joined):
        before = joined - 1
        last = state_rows(motion, -1)[before]
        speed = velocity[before, -1]
        rows = np.zeros((len(joined), 6, 20))
        wanted = np.zeros((len(joined), 6))
        tight = 0.2 * world.radius_m
        rows[:, :3, :9] = last[:, :3]
        rows[:, :3, 9] = -speed
        rows[:, :3, 10:13] = -np.eye(3)
        rows[:, :3, 19] = speed
        wanted[:, 2] = motion.fall[before, -1]
        rows[:, :3] /= tight
        wanted[:, :3] /= tight
        law, spread = _bounce_law(speed, world)
        held = np.where((sketch.kinds[joined] == "bounce")[:, None], 1 / spread, 0.0)
        rows[:, 3:, :9] = law[..., None] * last[:, 3:] * held[..., None]
        rows[:, 3:, 13:16] = -np.eye(3) * held[..., None]
        wanted[:, 5] = law[:, 2] * motion.fall_speed[before, -1] * held[:, 2]
        square = np.swapaxes(rows, 1, 2) @ rows
        side = np.einsum("jri,jr->ji", rows, wanted)
        normal[before, :, before] += square[:, :10, :10]
        normal[joined, :, joined] += square[:, 10:, 10:]
        normal[before, :, joined] += square[:, :10, 10:]
        normal[joined, :, before] += square[:, 10:, :10]
        right[before] += side[:, :10]
        right[joined] += side[:, 10:]
    return normal.reshape(10 * count, 10 * count), right.ravel()


def _bounce_law(speed: np.ndarray, world: BallWorld) -> tuple[np.ndarray, np.ndarray]:
    """What a bounce does to each component of the velocity, and the standard deviation of what comes out."""
    e, mu = world.restitution, world.friction
    back, doubt = (e.mean, e.std) if e is not None else (0.5, 0.5)
    down = np.maximum(np.abs(speed[:, 2]), 0.05)
    flat = np.linalg.norm(speed[:, :2], axis=1)
    loss = (0.5 * mu.mean if mu is not None else 0.2) * (1 + back) * down
    kept = 1 - np.minimum(loss / np.maximum(flat, 1e-3), 0.5)
    sideways = 0.6 * loss + 0.06 * flat + 0.1
    law = np.stack([kept, kept, np.full(len(kept), -back)], axis=1)
    return law, np.stack([sideways, sideways, (doubt + 0.05) * down + 0.1], axis=1)
