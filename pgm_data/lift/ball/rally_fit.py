"""A play fitted: the solver run from a start, and what its solution says of every picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.flight_model import air_law, flown, rebound
from pgm_data.lift.ball.rally_plan import RallyPlan, with_bounce_std
from pgm_data.lift.ball.rally_problem import RallyProblem, SolverOptions, rally_problem
from pgm_data.lift.ball.rally_start import Course
from pgm_data.lift.ball.world import BallWorld


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyFit:
    """A solution of a plan."""

    plan: RallyPlan
    problem: RallyProblem
    unknowns: Float[np.ndarray, " unknowns"]
    """In their own units."""
    cost: float
    """Half the weighted squares, priors among them."""
    converged: bool
    said: str
    """IPOPT's word and its iterations."""
    states: Float[np.ndarray, "pictures 6"]
    """Position and velocity at each picture of the plan."""
    residual_px: Float[np.ndarray, "pictures 2"]
    """Projected less measured; NaN where nothing was measured."""

    @property
    def misfit(self) -> Float[np.ndarray, " pictures"]:
        """Distance of each picture's pixel from the solution, in standard deviations; NaN where none was measured."""
        precision = self.plan.frames.precision[self.plan.picture]
        return np.sqrt((self.residual_px**2).sum(axis=1) * precision)

    @property
    def times(self) -> Float[np.ndarray, " contacts"]:
        """Of the contacts, seconds."""
        return self.unknowns[self.plan.layout.time] + self.plan.origin_s


def start_from(plan: RallyPlan, course: Course, world: BallWorld) -> Float[np.ndarray, " unknowns"]:
    """Unknowns on a course: spins are those that the bounce law gives to a ball without spin."""
    layout = plan.layout
    flights = layout.pattern.flights
    each = np.arange(flights)
    y = plan.data.prior_mean.copy()
    y[layout.position] = course.contacts
    y[layout.after] = course.at(course.times[:-1], each)[:, 3:]
    y[layout.before] = course.at(course.times[1:], each)[:, 3:]
    y[layout.time] = course.times - plan.origin_s
    if len(layout.node):
        y[layout.node] = course.at(plan.data.node_times + plan.origin_s, layout.node_flight)
    y[layout.spin] = 0.0
    for k in layout.bounce:
        spin = y[layout.spin[k - 1]]
        shared = y[layout.restitution], y[layout.friction]
        _, turned = rebound(y[layout.before[k - 1]], spin, np.array(shared[0]), np.array(shared[1]), world.radius_m)
        y[layout.spin[k]] = turned
    return y


def fit(
    plan: RallyPlan,
    start: Float[np.ndarray, " unknowns"],
    *,
    camera: Camera,
    world: BallWorld,
    options: SolverOptions,
) -> RallyFit:
    """The plan's solution near a start; never raises for want of convergence, but says so."""
    plan = with_bounce_std(plan, start)
    problem = rally_problem(plan.layout.pattern, options)
    data = plan.data
    packed = data.packed(plan.layout.pattern)
    x0 = np.clip(start, plan.lower, plan.upper) / data.scale
    solved = problem.solver(x0=x0, p=packed, lbx=plan.lower / data.scale, ubx=plan.upper / data.scale, lbg=0.0, ubg=0.0)
    stats = problem.solver.stats()
    x = np.array(solved["x"]).ravel()
    status = str(stats["return_status"])
    converged = status in ("Solve_Succeeded", "Solved_To_Acceptable_Level") and bool(np.isfinite(x).all())
    cost = float(solved["f"])
    unknowns = x * data.scale
    states = picture_states(plan, unknowns, world)
    return RallyFit(
        plan=plan,
        problem=problem,
        unknowns=unknowns,
        cost=cost if np.isfinite(cost) else np.inf,
        converged=converged,
        said=f"{status.replace('_', ' ')} in {stats['iter_count']} iterations",
        states=states,
        residual_px=_residuals(plan, states, camera),
    )


def picture_states(
    plan: RallyPlan, unknowns: Float[np.ndarray, " unknowns"], world: BallWorld
) -> Float[np.ndarray, "pictures 6"]:
    """Position and velocity of the ball at each picture of a plan."""
    layout = plan.layout
    if not len(plan.picture):
        return np.zeros((0, 6))
    spin = unknowns[layout.spin[plan.picture_flight]]
    node = unknowns[layout.node[plan.picture_node]]
    drag = np.full(len(node), unknowns[layout.drag])
    states = flown(node, spin, drag, plan.picture_delay, air_law(world), layout.pattern.steps)
    return np.where((plan.picture_delay == 0)[:, None], node, states)


def _residuals(plan: RallyPlan, states: np.ndarray, camera: Camera) -> np.ndarray:
    frames = plan.frames
    residual = np.full((len(states), 2), np.nan)
    rows = np.flatnonzero(frames.measured[plan.picture])
    if len(rows):
        own = camera[frames.index[plan.picture[rows]]]
        shown, seen = project(own, states[rows, None, :3])
        apart = shown[:, 0] - frames.pixels[plan.picture[rows]]
        # A ball behind the camera has no pixel: as far off as can be.
        residual[rows] = np.where(seen, apart, 1e4)
    return residual


def misplaced(fit: RallyFit) -> Bool[np.ndarray, " pictures"]:
    """Pictures whose time lies on the other side of a contact than their flight, beyond rounding."""
    plan, times = fit.plan, fit.times
    at = plan.frames.times[plan.picture]
    slack = 0.05 * plan.frames.interval_s
    start, end = times[plan.picture_flight], times[plan.picture_flight + 1]
    return np.asarray((at < start - slack) | (at > end + slack))
