"""What adjusted keyframes say of every frame, contact and flight of a play, with covariances."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.lift.ball.line_adjust import (
    OWN,
    STEPS,
    Adjusted,
    Known,
    Unknowns,
    columns_of,
    ends_of,
    grouped,
    nudged,
    residual_rows,
)
from pgm_data.lift.ball.line_path import Ends, at, flights_of, landings, paths_between
from pgm_data.lift.ball.line_sight import Sights

UNMODELLED_M = 0.01
"""What flights leave unexplained of a position, along each axis."""
DISBELIEVED = 8.0
"""Standard deviations beside its flight at which a pixel is something else than the ball."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frames:
    """Frames between a play's first and last contact."""

    times: Float[np.ndarray, " frames"]
    """s."""
    seen: Int[np.ndarray, " pixels"]
    """Those of them with a pixel."""
    sights: Sights
    """Rays of those."""
    sigma_px: Float[np.ndarray, " pixels"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Ground:
    """Where flights come down."""

    level: float
    """Height of the ball's centre there, m."""
    met: Bool[np.ndarray, " flights"]
    """Flights that end there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedPlay:
    """A play in metres, world frame."""

    seen: Int[np.ndarray, " believed"]
    """Frames whose pixel took part: it lies where the flight can have been."""
    position: Float[np.ndarray, "frames 3"]
    velocity: Float[np.ndarray, "frames 3"]
    position_cov: Float[np.ndarray, "frames 3 3"]
    contact_cov: Float[np.ndarray, "contacts 3 3"]
    start_velocity: Float[np.ndarray, "flights 3"]
    start_velocity_cov: Float[np.ndarray, "flights 3 3"]
    landing: Float[np.ndarray, "flights 3"]
    """Where each flight comes down, flown on where it must be; NaN where it does not."""
    landing_cov: Float[np.ndarray, "flights 3 3"]
    residual_px: Float[np.ndarray, " flights"]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Reading:
    """Frames and flights as some unknowns have them; a leading axis where there are several of those."""

    position: np.ndarray
    velocity: np.ndarray
    start_velocity: np.ndarray
    landing: np.ndarray


def placed_play(
    solved: Adjusted, known: Known, frames: Frames, doubts: list[tuple[Sights, Sights, Sights]], ground: Ground
) -> PlacedPlay:
    """Frames, contacts and flights with what pixels, marks, priors and camera leave open.

    `doubts` holds, for each way the camera may be off, the rays of the known pixels, of the marks and of the frames.
    """
    unknowns = solved.unknowns
    flights = len(unknowns.topspin)
    table = grouped(frames.times, unknowns.times)
    rows = table[table >= 0]
    flight_of = np.zeros(len(frames.times), dtype=np.int64)
    flight_of[rows] = np.nonzero(table >= 0)[0]
    many = _read(nudged(ends_of(unknowns, known.lift_per_m)), known.passes, frames.times, table, ground)
    columns = columns_of(flights)
    own_cov = solved.cov[columns[:, :, None], columns[:, None, :]]
    base_rows = residual_rows(unknowns, known, known.sights, known.marks)

    def moved(pixels: Sights, marks: Sights) -> Unknowns:
        return unknowns.moved(solved.gain @ (residual_rows(unknowns, known, pixels, marks) - base_rows))

    off = [(moved(pixels, marks), rays) for pixels, marks, rays in doubts]
    others = [_read(ends_of(u, known.lift_per_m), known.passes, frames.times, table, ground) for u, _ in off]

    model = many.position[0]
    spread = _spread(many.position, own_cov[flight_of]) + UNMODELLED_M**2 * np.eye(3)
    shifts = _stack([other.position - model for other in others], model)
    position, cov = model.copy(), spread.copy()
    miss = np.linalg.norm(frames.sights.beside(model[frames.seen]), axis=1)
    believed = miss < DISBELIEVED * frames.sigma_px * solved.scatter
    seen, rays, sigma_px = frames.seen[believed], frames.sights.take(believed), frames.sigma_px[believed]
    pull = rays.pull()
    position[seen] = _on_ray(rays, pull, model[seen])
    cov[seen] = pull @ spread[seen] @ np.swapaxes(pull, 1, 2) + _across(rays, position[seen], sigma_px * solved.scatter)
    for shift, (_, other_rays) in zip(shifts, off, strict=True):
        other = other_rays.take(believed)
        shift[seen] = _on_ray(other, other.pull(), model[seen] + shift[seen]) - position[seen]
    beside = np.zeros(flights)
    counts = np.bincount(flight_of[seen], minlength=flights)
    np.add.at(beside, flight_of[seen], (rays.beside(model[seen]) ** 2).sum(axis=-1))
    with np.errstate(all="ignore"):
        residual = np.sqrt(beside / counts)
    contacts = len(unknowns.times)
    place = 3 * np.arange(contacts)[:, None] + np.arange(3)
    contact_shift = _stack([u.places - unknowns.places for u, _ in off], unknowns.places)
    velocity_shift = _stack([o.start_velocity - many.start_velocity[0] for o in others], many.start_velocity[0])
    landing_shift = _stack([o.landing - many.landing[0] for o in others], many.landing[0])
    return PlacedPlay(
        seen=seen,
        position=position,
        velocity=many.velocity[0],
        position_cov=_even(cov + _outer(shifts)),
        contact_cov=_even(solved.cov[place[:, :, None], place[:, None, :]] + _outer(contact_shift)),
        start_velocity=many.start_velocity[0],
        start_velocity_cov=_even(_spread(many.start_velocity, own_cov) + _outer(velocity_shift)),
        landing=many.landing[0],
        landing_cov=_even(_spread(many.landing, own_cov) + _outer(landing_shift)),
        residual_px=residual,
    )


def _read(ends: Ends, passes: int, times: np.ndarray, table: np.ndarray, ground: Ground) -> _Reading:
    paths = paths_between(ends, passes)
    points, rates = at(paths, times[table])
    lead = points.shape[:-3]
    position, velocity = np.zeros((*lead, len(times), 3)), np.zeros((*lead, len(times), 3))
    inside = table >= 0
    position[..., table[inside], :] = points[..., inside, :]
    velocity[..., table[inside], :] = rates[..., inside, :]
    first = paths.velocities[..., 0, :]
    landing = np.array(ends.stop, copy=True)
    free = ~ground.met
    if free.any():
        lifted = ends.start[..., free, :] + np.array([0.0, 0.0, 1e-3])
        landing[..., free, :] = landings(lifted, first[..., free, :], flights_of(ends, free), ground.level)
    return _Reading(position=position, velocity=velocity, start_velocity=first, landing=landing)


def _spread(many: np.ndarray, own_cov: np.ndarray) -> np.ndarray:
    """Covariances of values (1 + OWN, rows, 3) of which all but the first are nudged."""
    slopes = np.moveaxis((many[1:] - many[0]) / STEPS.reshape(OWN, 1, 1), 0, -1)
    return slopes @ own_cov @ np.swapaxes(slopes, 1, 2)


def _stack(shifts: list[np.ndarray], like: np.ndarray) -> np.ndarray:
    return np.array(shifts, dtype=float).reshape(len(shifts), *like.shape)


def _outer(shifts: np.ndarray) -> np.ndarray:
    """Sum over the ways of being off, one standard deviation each."""
    return np.einsum("wri,wrj->rij", shifts, shifts)


def _even(cov: np.ndarray) -> np.ndarray:
    return 0.5 * (cov + np.swapaxes(cov, 1, 2))


def _on_ray(rays: Sights, pull: np.ndarray, guess: np.ndarray) -> np.ndarray:
    return rays.origin + (pull @ (guess - rays.origin)[:, :, None])[:, :, 0]


def _across(rays: Sights, points: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """Covariance across the ray of a point on it, from its pixel's."""
    far = np.linalg.norm(points - rays.origin, axis=1)
    turn = np.linalg.inv(rays.px_per_rad) * (sigma_px * far)[:, None, None]
    spots = np.swapaxes(rays.across, 1, 2) @ turn
    return spots @ np.swapaxes(spots, 1, 2)
