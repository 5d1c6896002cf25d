"""A play solved in rounds: pictures change flights and outliers drop out until neither moves any more."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.ball.flight_model import air_law, flown
from pgm_data.lift.ball.information import Information, information
from pgm_data.lift.ball.rally_fit import RallyFit, fit, misplaced, start_from
from pgm_data.lift.ball.rally_plan import Guess, RallyPlan, Surroundings, contact_priors, plan_rally
from pgm_data.lift.ball.rally_plays import Play, RallyFrames
from pgm_data.lift.ball.rally_problem import SolverOptions
from pgm_data.lift.ball.rally_start import ContactPriors, Course, first_course
from pgm_data.lift.camera_doubt import CameraDoubt

FASTEST = 90.0
"""No ball is faster than this, m/s."""
UNDER_M = 0.3
"""A ball lies no further under the ground than this, m: slack for noise just beside a bounce."""
AFAR_M = 80.0
"""No ball is further than this from the court's centre, along the ground or up, m."""
HOPELESS = 40.0
"""Where half of the pixels lie further off than this many standard deviations, further rounds help no more."""


@dataclass(frozen=True, kw_only=True)
class RoundOptions:
    """How a play is solved from one start."""

    solver: SolverOptions
    bend: float
    """Where the robust loss bends, standard deviations."""
    cut: float
    """Pixels further off than this many standard deviations are outliers and take no part."""
    rounds: int
    """Most rounds."""
    support: float
    """Spin and drag are free where their posterior standard deviation is below this share of the prior's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayFit:
    """A play's solution with what it knows."""

    fit: RallyFit
    information: Information
    spin_free: Bool[np.ndarray, " flights"]
    """Whether the data say anything about each flight's spin."""
    drag_free: bool
    kept: Float[np.ndarray, " flights"]
    """Share of each flight's measured pictures that took part, the others being outliers; 1 where there are none."""
    penalty: float
    """Half the logarithm of the priors' volumes, where starts have different priors: cost compares with it added."""

    @property
    def score(self) -> float:
        """Cost by which starts compare."""
        return self.fit.cost + self.penalty

    @property
    def flight_chi2(self) -> Float[np.ndarray, " flights"]:
        """Mean square of each flight's residuals, in standard deviations of one coordinate; 0 without measurements."""
        fit = self.fit
        flights = fit.plan.layout.pattern.flights
        misfit = fit.misfit
        seen = np.isfinite(misfit)
        flight = fit.plan.picture_flight[seen]
        count = np.bincount(flight, minlength=flights)
        return np.bincount(flight, weights=misfit[seen] ** 2, minlength=flights) / np.maximum(2 * count, 1)

    def implausible(self) -> Bool[np.ndarray, " flights"]:
        """Flights that no ball flies: under the ground, too fast or far away."""
        fit = self.fit
        layout = fit.plan.layout
        y = fit.unknowns
        ends = np.concatenate([y[layout.position[:-1]], y[layout.after]], axis=1)
        stops = np.concatenate([y[layout.position[1:]], y[layout.before]], axis=1)
        states = np.concatenate([fit.states, ends, stops])
        own = np.arange(layout.pattern.flights)
        flight = np.concatenate([fit.plan.picture_flight, own, own])
        with np.errstate(invalid="ignore"):
            fine = np.isfinite(states).all(axis=1)
            fine &= np.linalg.norm(states[:, 3:], axis=1) < FASTEST
            fine &= np.abs(states[:, :3]).max(axis=1) < AFAR_M
        return np.asarray(np.bincount(flight, weights=~fine, minlength=len(own)) > 0)


def solve_rounds(
    frames: RallyFrames,
    play: Play,
    around: Surroundings,
    *,
    doubt: CameraDoubt,
    options: RoundOptions,
    serve: bool = False,
    shift_s: Float[np.ndarray, " contacts"] | None = None,
    topspin: float = 0.0,
) -> PlayFit | None:
    """The play's solution from one start; None where nothing was measured.

    Args:
        frames: Pictures.
        play: Contacts.
        around: Camera, world and players.
        doubt: How far the camera may be off.
        options: How.
        serve: Whether the first hit is taken for an overhead serve.
        shift_s: By how much the start's contact times differ from those given.
        topspin: Of the start's flights after hits, rad/s.
    """
    priors = contact_priors(frames, play, around, serve=serve)
    times = play.times if shift_s is None else play.times + shift_s
    drag = around.world.drag_per_m.mean
    course = first_course(frames, play.at(times), around.camera, priors, drag)
    if course is None:
        return None
    guess = Guess(times=times, speed=_speed(course))
    plan = plan_rally(frames, play, around, priors, guess, bend=options.bend)
    start = start_from(plan, course, around.world)
    if topspin:
        start = _spun(plan, start, topspin)
    fitted = settle(plan, start, around, priors, options)
    known = information(fitted, camera=around.camera, world=around.world, doubt=doubt)
    spin_free, drag_free = supported(fitted, known, options.support)
    held = _held(fitted, spin_free, drag_free)
    if held is not None:
        again = fit(held, fitted.unknowns, camera=around.camera, world=around.world, options=options.solver)
        if again.converged:
            fitted = again
            known = information(fitted, camera=around.camera, world=around.world, doubt=doubt)
    penalty = -0.5 * float(np.log(priors.precision).sum())
    return PlayFit(
        fit=fitted,
        information=known,
        spin_free=spin_free,
        drag_free=drag_free,
        kept=_kept(frames, fitted.plan),
        penalty=penalty,
    )


def _kept(whole: RallyFrames, plan: RallyPlan) -> Float[np.ndarray, " flights"]:
    flights = plan.layout.pattern.flights
    had = np.bincount(plan.picture_flight, weights=whole.measured[plan.picture], minlength=flights)
    has = np.bincount(plan.picture_flight, weights=plan.frames.measured[plan.picture], minlength=flights)
    return np.where(had > 0, has / np.maximum(had, 1), 1.0)


def settle(
    plan: RallyPlan, start: np.ndarray, around: Surroundings, priors: ContactPriors, options: RoundOptions
) -> RallyFit:
    """The fit of a plan once pictures have found their flights and outliers are out."""
    camera, world = around.camera, around.world
    whole = plan.frames
    fitted = fit(plan, start, camera=camera, world=world, options=options.solver)
    for _ in range(options.rounds - 1):
        moved = misplaced(fitted)
        frames = _trimmed(whole, fitted, options.cut)
        same = bool((frames.precision == fitted.plan.frames.precision).all())
        far = fitted.misfit[np.isfinite(fitted.misfit)]
        lost = not np.isfinite(fitted.unknowns).all() or bool(len(far) and np.median(far) > HOPELESS)
        if lost or (not moved.any() and same):
            break
        guess = Guess(times=_ordered(fitted.times), speed=float(np.linalg.norm(fitted.states[:, 3:], axis=1).max()))
        again = plan_rally(frames, plan.play, around, priors, guess, bend=options.bend)
        fitted = fit(again, carried(again, fitted, around), camera=camera, world=world, options=options.solver)
    return fitted


def _trimmed(whole: RallyFrames, fitted: RallyFit, cut: float) -> RallyFrames:
    """The pictures less those that lie further off than the cut; one that is back near takes part again."""
    plan = fitted.plan
    rows = plan.picture
    residual = np.zeros(len(whole.times))
    shown = fitted.states[:, :3]
    seen = np.flatnonzero(whole.measured[rows])
    if not len(seen):
        return whole
    own = plan.frames
    misfit = np.zeros(len(rows))
    pixels = _pixels(fitted, shown[seen], seen)
    misfit[seen] = np.linalg.norm(pixels - own.pixels[rows[seen]], axis=1) * np.sqrt(whole.precision[rows[seen]])
    misfit = np.nan_to_num(misfit, nan=1e6)
    # Where the model itself is off by more than the noise, only what sticks out is an outlier.
    usual = max(1.0, float(np.median(misfit[seen])) / 1.18)
    residual[rows] = misfit / usual
    far = residual > cut
    # Never more than a third: then it is the model that is wrong.
    if far.sum() > len(seen) / 3:
        return whole
    return whole.without(far)


def _pixels(fitted: RallyFit, points: np.ndarray, seen: np.ndarray) -> np.ndarray:
    numbers = fitted.plan.frames.camera[fitted.plan.picture[seen]]
    R, t = numbers[:, 8:17].reshape(-1, 3, 3), numbers[:, 17:]
    cam = np.einsum("pij,pj->pi", R, points) + t
    xy = cam[:, :2] / np.where(cam[:, 2:] > 0, cam[:, 2:], np.nan)
    k1, k2, p1, p2 = numbers[:, 4:8].T
    x, y = xy.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    bent = np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
        axis=1,
    )
    return bent * numbers[:, :2] + numbers[:, 2:4]


def _speed(course: Course) -> float:
    flights = np.arange(len(course.times) - 1)
    speeds = np.linalg.norm(course.at(course.times[:-1], flights)[:, 3:], axis=1)
    return float(np.clip(np.nan_to_num(speeds, nan=60.0).max(), 1.0, FASTEST))


def _ordered(times: np.ndarray) -> np.ndarray:
    """Times, each a little later than the one before."""
    return np.maximum.accumulate(times) + 1e-6 * np.arange(len(times))


def _spun(plan: RallyPlan, start: np.ndarray, topspin: float) -> np.ndarray:
    y = start.copy()
    layout = plan.layout
    law = np.concatenate([[False], np.array(layout.pattern.bounces, dtype=bool)])
    own = np.flatnonzero(~law)
    flat = y[layout.after[own, :2]]
    along = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-6)
    y[layout.spin[own]] = topspin * np.stack([-along[:, 1], along[:, 0], np.zeros(len(own))], axis=1)
    return y


def carried(plan: RallyPlan, old: RallyFit, around: Surroundings) -> Float[np.ndarray, " unknowns"]:
    """Unknowns of a new plan of the same play from those of an old solution."""
    layout, before = plan.layout, old.plan.layout
    y = plan.data.prior_mean.copy()
    shared = ("position", "after", "before", "spin", "time")
    for name in shared:
        y[getattr(layout, name)] = old.unknowns[getattr(before, name)]
    for name in ("drag", "restitution", "friction"):
        y[getattr(layout, name)] = old.unknowns[getattr(before, name)]
    if not len(layout.node):
        return y
    flight = layout.node_flight
    times = plan.data.node_times + plan.origin_s
    # Where a picture kept its flight its state is known; the others are flown to from the nearer contact.
    start, stop = old.times[flight], old.times[flight + 1]
    from_start = np.abs(times - start) <= np.abs(times - stop)
    first = np.concatenate([old.unknowns[before.position[flight]], old.unknowns[before.after[flight]]], axis=1)
    last = np.concatenate([old.unknowns[before.position[flight + 1]], old.unknowns[before.before[flight]]], axis=1)
    base = np.where(from_start[:, None], first, last)
    delay = times - np.where(from_start, start, stop)
    spin, drag = old.unknowns[before.spin[flight]], np.full(len(flight), old.unknowns[before.drag])
    states = flown(base, spin, drag, delay, air_law(around.world), 4)
    nodes = plan.picture[plan.picture_delay == 0]
    row = np.searchsorted(old.plan.picture, nodes).clip(0, max(len(old.plan.picture) - 1, 0))
    if len(old.states):
        same = (old.plan.picture[row] == nodes) & (old.plan.picture_flight[row] == flight)
        states = np.where(same[:, None], old.states[row], states)
    y[layout.node] = states
    return y


def supported(fitted: RallyFit, known: Information, share: float) -> tuple[Bool[np.ndarray, " flights"], bool]:
    """Flights whose spin, and whether the rally's drag, the data narrow down beyond their priors."""
    layout, data = fitted.plan.layout, fitted.plan.data
    law = np.concatenate([[False], np.array(layout.pattern.bounces, dtype=bool)])
    with np.errstate(divide="ignore"):
        prior = 1 / np.sqrt(data.prior_precision[layout.spin])
        spin = (known.std(layout.spin) < share * prior).any(axis=1)
    # A spin that the bounce law gives has no prior of its own: that of the hit before it stands for it.
    hit = np.flatnonzero(~law)
    if len(hit) and data.prior_precision[layout.spin[hit[0], 0]] > 0:
        width = 1 / np.sqrt(data.prior_precision[layout.spin[hit[0], 0]])
        spin = np.where(law, (known.std(layout.spin) < share * width).any(axis=1), spin)
    else:
        spin = np.zeros_like(spin)
    drag = float(known.std(np.array([layout.drag]))[0]) < share / np.sqrt(data.prior_precision[layout.drag])
    return np.asarray(spin), bool(drag)


def _held(fitted: RallyFit, spin_free: np.ndarray, drag_free: bool) -> RallyPlan | None:
    """The plan with what the data do not support held at its prior mean; None where nothing is to be held."""
    plan, layout = fitted.plan, fitted.plan.layout
    law = np.concatenate([[False], np.array(layout.pattern.bounces, dtype=bool)])
    places = layout.spin[~law & ~spin_free].ravel()
    if not drag_free:
        places = np.append(places, layout.drag)
    places = places[~plan.held[places]]
    if not len(places):
        return None
    lower, upper = plan.lower.copy(), plan.upper.copy()
    lower[places] = upper[places] = plan.data.prior_mean[places]
    return replace(plan, lower=lower, upper=upper)
