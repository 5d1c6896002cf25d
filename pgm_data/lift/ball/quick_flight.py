"""Many flights of a ball fitted to a track at once, fast and approximately.

Each turn of a fit takes speeds, depths and weights from the turn before and solves one small linear system a flight.
`quick_flights` gives the start states of flights between known events, for solvers that need a first guess.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.ball.contact_chain import STRAY_COST, PlaySketch, fit_plays
from pgm_data.lift.ball.contact_motion import (
    Motion,
    Sights,
    inverted,
    motion_along,
    sights_of,
    solved,
    state_rows,
    velocity_scale,
)
from pgm_data.lift.ball.world import BallWorld

TURNS = 6
STRAY_SHARE = 0.03
"""Share of frames that show something else than the ball."""


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


def flight_guess(
    *,
    begin_on_ground: Bool[np.ndarray, " flights"],
    end_on_ground: Bool[np.ndarray, " flights"],
    begin_time_std: Float[np.ndarray, " flights"],
    end_time_std: Float[np.ndarray, " flights"],
    world: BallWorld,
) -> FlightGuess:
    """What is believed of flights that begin and end on the ground or where players reach."""
    reach = np.array(world.reach_half_size)
    free = np.array([0.0, 0.0, world.hit_height.mean])
    free_std = np.array([0.6 * reach[0], 0.7 * reach[1], 1.4 * world.hit_height.std])
    low = np.array([0.0, 0.0, world.radius_m])
    low_std = np.array([reach[0], reach[1], 0.02 + 0.3 * world.radius_m])
    at_begin, at_end = begin_on_ground[:, None], end_on_ground[:, None]
    return FlightGuess(
        start=np.where(at_begin, low, free),
        start_std=np.where(at_begin, low_std, free_std),
        end=np.where(at_end, low, free),
        end_std=np.where(at_end, low_std, free_std),
        velocity_std=np.repeat(velocity_scale(world)[None], len(begin_on_ground), axis=0),
        spin_std=np.where(begin_on_ground, 1.5, 1.0) * max(world.spin_std, 1.0),
        start_time_std=begin_time_std,
        end_time_std=end_time_std,
        start_on_ground=begin_on_ground,
        end_on_ground=end_on_ground,
    )


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
        rows = np.concatenate([scaled, reach[..., None, None] * scaled, np.cross(bend[:, :, None], scaled)], axis=-1)
        wanted = -offsets * scale[..., None] + scaled[..., 2] * motion.fall[:, 1:-1, None]
        soft = np.sqrt(weight)[..., None]
        design = (rows * soft[..., None]).reshape(flights, 2 * sharp.shape[1], 9)
        target = (wanted * soft).reshape(flights, 2 * sharp.shape[1])
        start_std[:, 2] = np.where(
            guess.start_on_ground,
            np.hypot(guess.start_std[:, 2], guess.start_time_std * np.abs(velocity[:, 0, 2])),
            start_std[:, 2],
        )
        end_std[:, 2] = np.where(
            guess.end_on_ground,
            np.hypot(guess.end_std[:, 2], guess.end_time_std * np.abs(velocity[:, -1, 2])),
            end_std[:, 2],
        )
        prior = np.concatenate([start_std, guess.velocity_std, np.repeat(guess.spin_std[:, None], 3, axis=1)], axis=1)
        at_end = state_rows(motion, -1)[:, :3] / end_std[..., None]
        end_wanted = (guess.end + np.stack([0 * begins, 0 * begins, motion.fall[:, -1]], axis=-1)) / end_std
        normal = np.swapaxes(design, 1, 2) @ design + np.swapaxes(at_end, 1, 2) @ at_end
        normal[:, np.arange(9), np.arange(9)] += prior**-2
        right = np.einsum("fri,fr->fi", design, target) + np.einsum("fri,fr->fi", at_end, end_wanted)
        right[:, :3] += guess.start / start_std**2
        found = solved(normal, right)
        p, v, w = found[:, :3], found[:, 3:6], found[:, 6:]
        position, velocity = motion.position(p, v, w), motion.velocity(v, w)
        square = np.sum((np.einsum("ftki,fi->ftk", rows, found) - wanted) ** 2, axis=-1)
        # Wide at first, so that a poor start loses no frames.
        width = 16.0 if turn < 1 else (4.0 if turn < 3 else 1.0)
        weight = 1 / (1 + np.exp(np.minimum(0.5 * square / width - STRAY_COST, 50.0)))
    return _fitted(
        _LastTurn(
            motion=motion,
            normal=normal,
            prior=prior,
            p=p,
            v=v,
            w=w,
            square=np.where(real, square, 0.0),
            position=position,
            velocity=velocity,
            start_std=start_std,
            end_std=end_std,
        ),
        guess,
        count,
        np.where(real, 1 - weight, 0.0).sum(axis=1),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _LastTurn:
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


def _fitted(turn: _LastTurn, guess: FlightGuess, count: np.ndarray, strays: np.ndarray) -> FlightFits:
    """Evidence and end states of the last turn."""
    cov = inverted(turn.normal)
    inside = -np.logaddexp(np.log1p(-STRAY_SHARE) - 0.5 * turn.square, -STRAY_COST)
    inside = np.where(np.arange(inside.shape[1]) < count[:, None], inside - 1.0, 0.0).sum(axis=1)
    off = np.concatenate(
        [
            (turn.p - guess.start) / turn.start_std,
            turn.v / guess.velocity_std,
            turn.w / guess.spin_std[:, None],
        ],
        axis=1,
    )
    at_end = (turn.position[:, -1] - guess.end) / turn.end_std
    log_volume = 0.5 * np.linalg.slogdet(turn.normal)[1] + np.log(turn.prior).sum(axis=1)
    cost = inside + 0.5 * np.sum(off**2, axis=1) + 0.5 * np.sum(at_end**2, axis=1) + log_volume
    first, last = state_rows(turn.motion, 0), state_rows(turn.motion, -1)
    return FlightFits(
        cost=np.where(np.isfinite(cost), cost, np.inf),
        start=np.concatenate([turn.p, turn.v], axis=1),
        start_cov=first @ cov @ np.swapaxes(first, 1, 2),
        end=np.concatenate([turn.position[:, -1], turn.velocity[:, -1]], axis=1),
        end_cov=last @ cov @ np.swapaxes(last, 1, 2),
        start_off=np.concatenate([turn.p - guess.start, turn.v], axis=1),
        start_prior_std=np.concatenate([turn.start_std, guess.velocity_std], axis=1),
        spin=turn.w,
        path=turn.position,
        measured=count,
        inside=inside,
        strays=strays,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class QuickFlights:
    """Flights between events, fast and approximately; arrays one row a flight. Every flight is placed."""

    start_event: Int[np.ndarray, " flights"]
    """Index into the events."""
    end_event: Int[np.ndarray, " flights"]
    begins: Float[np.ndarray, " flights"]
    """Times as fitted, s."""
    ends: Float[np.ndarray, " flights"]
    position: Float[np.ndarray, "flights 3"]
    """Just after the start, world metres."""
    velocity: Float[np.ndarray, "flights 3"]
    """m/s."""
    spin: Float[np.ndarray, "flights 3"]
    """rad/s."""
    cov: Float[np.ndarray, "flights 9 9"]
    """Of position, velocity and spin."""
    residual: Float[np.ndarray, " flights"]
    """Rms distance of the frames on the path, in their standard deviations; NaN where there are none."""


def quick_flights(track: BallTrack, events: BallEvents, camera: Camera, *, world: BallWorld) -> QuickFlights:
    """Start states of the flights between each two events of a play, fitted together through bounces and hits.

    First guesses for a solver: lift is linear in spin and the bounce law loose, so that positions are good to some
    tenths of a metre along the ray. Where a `first` or `last` stands at a contact the contact counts. No flight comes
    back where the track has too few frames with a camera.
    """
    sights = sights_of(track, camera)
    start, end = _flights_between(events, 1e-3 if len(sights) < 2 else 0.5 * float(np.median(np.diff(sights.times))))
    if not len(sights):
        start = end = np.zeros(0, dtype=np.int64)
    begins, ends = events.times[start], events.times[end]
    step = float(np.median(np.diff(sights.times))) if len(sights) > 1 else 0.04
    doubt = np.clip(np.nan_to_num(events.time_std, nan=0.5 * step), 0.05 * step, 2 * step)
    bounce = events.kinds == "bounce"
    guess = flight_guess(
        begin_on_ground=np.asarray(bounce[start], dtype=bool),
        end_on_ground=np.asarray(bounce[end], dtype=bool),
        begin_time_std=doubt[start],
        end_time_std=doubt[end],
        world=world,
    )
    fits = fit_flights(sights, begins, ends, guess, world=world)
    state = np.concatenate([fits.start, fits.spin], axis=1)
    sketch = PlaySketch(
        begins=begins,
        ends=ends,
        kinds=events.kinds[start],
        joined=np.concatenate([np.zeros(min(len(start), 1), dtype=bool), end[:-1] == start[1:]]),
        time_std=doubt[start],
        state=state,
    )
    plays = fit_plays(sights, sketch, world=world, step=step)
    return QuickFlights(
        start_event=start,
        end_event=end,
        begins=plays.begins,
        ends=plays.ends,
        position=plays.state[:, :3],
        velocity=plays.state[:, 3:6],
        spin=plays.state[:, 6:],
        cov=plays.state_cov,
        residual=plays.residual,
    )


def _flights_between(events: BallEvents, at_once: float) -> tuple[np.ndarray, np.ndarray]:
    """Events at which flights begin and end."""
    touch = np.isin(events.kinds, ("hit", "bounce", "net"))
    beside = np.abs(events.times[:, None] - events.times[touch][None]).min(axis=1, initial=np.inf) <= at_once
    kept = np.flatnonzero(touch | ~beside)
    start, end = kept[:-1], kept[1:]
    flown = (events.kinds[start] != "last") & (events.kinds[end] != "first")
    # A contact beside a `last` ends its play, one beside a `first` begins it.
    for kind, side in (("last", start), ("first", end)):
        marked = events.times[events.kinds == kind]
        flown &= np.abs(events.times[side][:, None] - marked[None]).min(axis=1, initial=np.inf) > at_once
    flown &= events.times[end] - events.times[start] > 1e-6
    return start[flown], end[flown]
