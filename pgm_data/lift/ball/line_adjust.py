"""The keyframes of one play adjusted to the pixels between them: places and times of contacts, lift of each flight.

A flight is what `line_path` makes of its ends, so the only unknowns are the ends (place and time), two
components of spin a flight and the drag that they share, all with priors; flights on both sides of a bounce are tied by
what a bounce takes. Levenberg and Marquardt's way with Huber's weights.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from pgm_data.lift.ball.line_path import Ends, at, paths_between
from pgm_data.lift.ball.line_sight import Sights
from pgm_data.scene import Prior

STEPS = np.array([1e-3] * 6 + [1e-4] * 2 + [0.03] * 2 + [1e-4])
"""Differences that stand for derivatives: both ends, m; both times, s; topspin and sidespin, m/s; drag, 1/m."""
HUBER = 3.0
"""Standard deviations beyond which a pixel counts by its distance, no longer by its square."""
GAP_S = 2e-3
"""Contacts never come closer."""
MOST_STEPS = 30
MOST_TRIES = 8
"""Of one step, each shorter."""
SETTLED = 1e-3
"""Share of the cost below which a step ends the search."""
SPREAD = (0.04, 0.07, 0.12)
"""What restitution, the direction and the speed along the ground scatter about the law of a bounce beyond the priors of
its constants, as shares of the speed downwards and twice of that along the ground: shallow and steep bounces, spin
about the way, seams."""
LEAST_CHANGE = 0.3
"""m/s, the same for slow balls."""
GRIP = 0.37
"""Share of the contact point's slip that a gripping bounce takes off the speed: (1 + 0.05) i / (1 + i), i = 0.55."""
TOSS_M = 0.6
"""Standard deviation along x and y of how far a server's toss drifts."""
OWN = 11
"""Unknowns that one flight depends on."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Unknowns:
    """What is adjusted."""

    places: Float[np.ndarray, "contacts 3"]
    """World, m."""
    times: Float[np.ndarray, " contacts"]
    """s."""
    topspin: Float[np.ndarray, " flights"]
    """m/s, see `line_path.Ends`."""
    sidespin: Float[np.ndarray, " flights"]
    drag: Float[np.ndarray, " 1"]
    """C, 1/m."""

    def vector(self) -> np.ndarray:
        """All in a row."""
        return np.concatenate([self.places.reshape(-1), self.times, self.topspin, self.sidespin, self.drag])

    def moved(self, by: np.ndarray) -> "Unknowns":
        """The same, that much further on."""
        contacts, flights = len(self.times), len(self.topspin)
        parts = np.split(by, np.cumsum([3 * contacts, contacts, flights, flights]))
        return Unknowns(
            places=self.places + parts[0].reshape(-1, 3),
            times=self.times + parts[1],
            topspin=self.topspin + parts[2],
            sidespin=self.sidespin + parts[3],
            drag=np.maximum(self.drag + parts[4], 0.0),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What is measured of one play, and its priors."""

    times: Float[np.ndarray, " pixels"]
    """Of the frames with a pixel, s."""
    sights: Sights
    """Their rays."""
    sigma_px: Float[np.ndarray, " pixels"]
    marks: Sights
    """Rays of the ground marks."""
    marked: Int[np.ndarray, " marks"]
    """Contacts they belong to."""
    mark_px: float
    """Standard deviation of each coordinate of a mark."""
    prior: Unknowns
    """Means."""
    prior_std: Unknowns
    """Standard deviations; inf where there is no prior."""
    bounced: Int[np.ndarray, " bounces"]
    """Contacts within the play that are bounces."""
    tossed: Int[np.ndarray, " tosses"]
    """Flights that are a server's toss."""
    restitution: Prior
    friction: Prior
    lift_per_m: float
    """See `BallWorld`."""
    passes: int
    """See `line_path.paths_between`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Adjusted:
    """The unknowns as adjusted, and what they leave open."""

    unknowns: Unknowns
    cov: Float[np.ndarray, "unknowns unknowns"]
    """From pixels, marks and priors, widened where the pixels scatter more than they say."""
    gain: Float[np.ndarray, "unknowns rows"]
    """Change of the unknowns for each of `residuals`."""
    cost: float
    """Half the sum of squared weighted residuals, priors among them; beyond `HUBER` it rises as the distance."""
    scatter: float
    """Factor of the pixels' standard deviations that the residuals ask for, 1 or more."""


def ends_of(unknowns: Unknowns, lift_per_m: float) -> Ends:
    """The flights between the contacts."""
    return Ends(
        start=unknowns.places[:-1],
        stop=unknowns.places[1:],
        start_time=unknowns.times[:-1],
        stop_time=unknowns.times[1:],
        drag=np.repeat(unknowns.drag, len(unknowns.topspin)),
        lift=np.full(len(unknowns.topspin), lift_per_m),
        topspin=unknowns.topspin,
        sidespin=unknowns.sidespin,
    )


def nudged(ends: Ends) -> Ends:
    """The flights as they are, then each with one of its own unknowns changed by `STEPS`: (1 + OWN, flights, ...)."""
    by = np.concatenate([np.zeros((1, OWN)), np.diag(STEPS)])[:, None, :]
    return Ends(
        start=ends.start + by[..., 0:3],
        stop=ends.stop + by[..., 3:6],
        start_time=ends.start_time + by[..., 6],
        stop_time=ends.stop_time + by[..., 7],
        drag=ends.drag + by[..., 10],
        lift=np.broadcast_to(ends.lift, (1 + OWN, len(ends.lift))),
        topspin=ends.topspin + by[..., 8],
        sidespin=ends.sidespin + by[..., 9],
    )


def columns_of(flights: int) -> Int[np.ndarray, "flights own"]:
    """Where each flight's own unknowns stand in the vector of all."""
    contacts = flights + 1
    f = np.arange(flights)[:, None]
    place, time = 3 * f + np.arange(6), 3 * contacts + f + np.arange(2)
    shared = np.full_like(f, 4 * contacts + 2 * flights)
    return np.concatenate([place, time, 4 * contacts + f, 4 * contacts + flights + f, shared], axis=1)


def grouped(
    times: Float[np.ndarray, " rows"], contacts: Float[np.ndarray, " contacts"]
) -> Int[np.ndarray, "flights most"]:
    """Rows of each flight, those at a contact with the flight that it starts; -1 pads."""
    flights = len(contacts) - 1
    flight = np.searchsorted(contacts[1:-1], times, side="right")
    inside = (times >= contacts[0] - 1e-9) & (times <= contacts[-1] + 1e-9)
    rows = np.flatnonzero(inside)
    counts = np.bincount(flight[rows], minlength=flights)
    table = np.full((flights, int(counts.max(initial=0))), -1)
    order = rows[np.argsort(flight[rows], kind="stable")]
    slot = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
    table[flight[order], slot] = order
    return table


def adjusted(start: Unknowns, known: Known) -> Adjusted:
    """The unknowns that fit pixels, marks and priors best, from a start nearby."""
    now = start
    residuals, weights = _residuals(now, known)
    cost = _cost(residuals, weights)
    damping = 1e-3
    for _ in range(MOST_STEPS):
        slopes = _slopes(now, known)
        weighted = weights[:, None] * slopes
        normal, pull = weighted.T @ slopes, weighted.T @ residuals
        scale = np.diag(np.diag(normal) + 1e-12)
        before = cost
        for _ in range(MOST_TRIES):
            trial = now.moved(-np.linalg.solve(normal + damping * scale, pull))
            if (np.diff(trial.times) > GAP_S).all():
                new_residuals, new_weights = _residuals(trial, known)
                new_cost = _cost(new_residuals, new_weights)
                if new_cost < cost:
                    now, residuals, weights, cost = trial, new_residuals, new_weights, new_cost
                    break
            damping = damping * 6
        damping = max(damping * 0.2, 1e-9)
        if before - cost < SETTLED * cost + 1e-3:
            break
    slopes = _slopes(now, known)
    weighted = weights[:, None] * slopes
    inverse = np.linalg.inv(weighted.T @ slopes)
    dof = max(len(residuals) - slopes.shape[1], 1)
    # Only what chance does not explain.
    spread = float(np.sqrt(max(1.0, ((weights * residuals) ** 2).sum() / dof - np.sqrt(2 / dof))))
    return Adjusted(unknowns=now, cov=inverse * spread**2, gain=-inverse @ weighted.T, cost=float(cost), scatter=spread)


def residual_rows(unknowns: Unknowns, known: Known, sights: Sights, marks: Sights) -> Float[np.ndarray, " rows"]:
    """Weighted residuals of pixels, marks, priors, bounces and tosses, in this order, with those rays."""
    table = grouped(known.times, unknowns.times)
    ends = ends_of(unknowns, known.lift_per_m)
    points, first, last = _flown(ends, known, table)
    before, after = known.bounced - 1, known.bounced
    bounce = _bounces(last[before], ends.topspin[before], first[after], known)
    pixels = np.zeros((len(known.times), 2))
    rows = table[table >= 0]
    pixels[rows] = sights.take(rows).beside(points[table >= 0]) / known.sigma_px[rows, None]
    mark, prior, toss = _marks(unknowns, known, marks), _priors(unknowns, known), _tosses(unknowns, known)
    return np.concatenate([pixels.reshape(-1), mark.reshape(-1), prior, bounce.reshape(-1), toss.reshape(-1)])


def _residuals(unknowns: Unknowns, known: Known) -> tuple[np.ndarray, np.ndarray]:
    residuals = residual_rows(unknowns, known, known.sights, known.marks)
    pixels = 2 * len(known.times)
    far = np.linalg.norm(residuals[:pixels].reshape(-1, 2), axis=1)
    weights = np.ones(len(residuals))
    weights[:pixels] = np.repeat(np.minimum(1.0, HUBER / np.maximum(far, 1e-9)), 2)
    return residuals, weights


def _cost(residuals: np.ndarray, weights: np.ndarray) -> float:
    """Huber's, since w r^2 (2 - w) / 2 is r^2 / 2 within the bend and c |r| - c^2 / 2 beyond it."""
    return float((0.5 * weights * (2 - weights) * residuals**2).sum())


def _flown(ends: Ends, known: Known, table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions in the table's frames, and the flights' first and last velocities."""
    paths = paths_between(ends, known.passes)
    return at(paths, known.times[table])[0], paths.velocities[..., 0, :], paths.velocities[..., -1, :]


def _bounces(before: np.ndarray, topspin: np.ndarray, after: np.ndarray, known: Known) -> np.ndarray:
    """Weighted residuals (..., bounces, 3) of velocities before and after: upwards, aside, forward.

    Friction slides, or grips where that takes less off the speed along the ground.
    """
    down = np.abs(before[..., 2])
    speed = np.hypot(before[..., 0], before[..., 1])
    forward = before[..., :2] / np.maximum(speed, 1e-9)[..., None]
    e, mu = known.restitution, known.friction
    slide = mu.mean * (1 + e.mean) * down
    slip = speed - topspin
    loss = np.clip(GRIP * slip, -slide, slide)
    ahead = (after[..., :2] * forward).sum(axis=-1)
    aside = after[..., 1] * forward[..., 0] - after[..., 0] * forward[..., 1]
    loss_std = np.hypot(SPREAD[2] * speed, mu.std * (1 + e.mean) * down)
    return np.stack(
        [
            (after[..., 2] - e.mean * down) / np.hypot(np.hypot(SPREAD[0], e.std) * down, LEAST_CHANGE),
            aside / np.hypot(SPREAD[1] * speed, LEAST_CHANGE),
            (ahead - speed + loss) / np.hypot(loss_std, LEAST_CHANGE),
        ],
        axis=-1,
    )


def _tosses(unknowns: Unknowns, known: Known) -> np.ndarray:
    return (unknowns.places[known.tossed + 1, :2] - unknowns.places[known.tossed, :2]) / TOSS_M


def _marks(unknowns: Unknowns, known: Known, marks: Sights) -> np.ndarray:
    ground = unknowns.places[known.marked] * [1.0, 1.0, 0.0]
    return marks.beside(ground) / known.mark_px


def _priors(unknowns: Unknowns, known: Known) -> np.ndarray:
    return (unknowns.vector() - known.prior.vector()) / known.prior_std.vector()


def _slopes(unknowns: Unknowns, known: Known) -> np.ndarray:
    """Derivatives of the weighted residuals by the unknowns."""
    flights, contacts = len(unknowns.topspin), len(unknowns.times)
    pixels, marks = len(known.times), len(known.marked)
    total = 4 * contacts + 2 * flights + 1
    bounces, tosses = len(known.bounced), len(known.tossed)
    slopes = np.zeros((2 * (pixels + marks) + total + 3 * bounces + 2 * tosses, total))
    table = grouped(known.times, unknowns.times)
    ends = nudged(ends_of(unknowns, known.lift_per_m))
    points, first, last = _flown(ends, known, table)
    inside = table >= 0
    rows = table[inside]
    beside = known.sights.take(rows).beside(points[:, inside]) / known.sigma_px[rows, None]
    own = (beside[1:] - beside[0]) / STEPS[:, None, None]
    columns = columns_of(flights)[np.nonzero(inside)[0]]
    for axis in range(2):
        slopes[2 * rows[:, None] + axis, columns] = own[:, :, axis].T
    if marks:
        base = _marks(unknowns, known, known.marks)
        for axis in range(2):
            shift = np.zeros(3)
            shift[axis] = 1e-3
            near = _marks(replace(unknowns, places=unknowns.places + shift), known, known.marks)
            by = (near - base) / 1e-3
            for coordinate in range(2):
                slopes[2 * (pixels + np.arange(marks)) + coordinate, 3 * known.marked + axis] = by[:, coordinate]
    place = np.arange(total)
    slopes[2 * (pixels + marks) + place, place] = 1 / known.prior_std.vector()
    top = 2 * (pixels + marks) + total
    before, after = known.bounced - 1, known.bounced
    base = _bounces(last[0, before], ends.topspin[0, before], first[0, after], known)
    for flight, near in (
        (before, _bounces(last[1:, before], ends.topspin[1:, before], first[0, after], known)),
        (after, _bounces(last[0, before], ends.topspin[0, before], first[1:, after], known)),
    ):
        by = (near - base) / STEPS[:, None, None]
        for part in range(3):
            rows = top + 3 * np.arange(bounces)[:, None] + part
            # Both flights share the bounce's place and time, and the drag.
            np.add.at(slopes, (rows, columns_of(flights)[flight]), by[:, :, part].T)
    for axis in range(2):
        rows = top + 3 * bounces + 2 * np.arange(tosses) + axis
        slopes[rows, 3 * (known.tossed + 1) + axis] = 1 / TOSS_M
        slopes[rows, 3 * known.tossed + axis] = -1 / TOSS_M
    return slopes
