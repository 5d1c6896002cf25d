"""One play laid out for the solver: nodes, measurements, priors and bounds."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.camera import Camera, meet_plane, project
from pgm_data.lift.ball.flight_model import air_law, steps_for
from pgm_data.lift.ball.rally_layout import RallyLayout, RallyPattern
from pgm_data.lift.ball.rally_plays import Play, RallyFrames
from pgm_data.lift.ball.rally_problem import RallyData
from pgm_data.lift.ball.rally_start import ContactPriors, flight_of
from pgm_data.lift.ball.solution import PlayersAt
from pgm_data.lift.ball.world import HIT_HEIGHT, BallWorld

NODE_S = 0.02
"""Nodes lie at most about this far apart, s, where there are frames."""
SERVE_HEIGHT = (1.55, 0.12)
"""Height of the ball at an overhead serve over a person's height: mean and standard deviation."""
SERVE_Y_STD = 0.4
"""Of a serve's contact about the baseline along the court, over a person's height: toes behind it, ball before it."""
WRIST_STD, ROOT_STD = 0.5, 0.9
"""Reach of a racket from the wrist, each axis, and of an arm and racket from the root, each horizontal axis, m."""
MARK_STD_PX = 3.0
"""How well a person marks the ball's vertical projection, px."""
BOUNCE_NORMAL, BOUNCE_ALONG, BOUNCE_SPIN = (0.15, 0.05), (0.4, 0.12), 50.0
"""Departures from the bounce law. Normal: m/s, and share of the normal speed: restitution falls by 0.05 to 0.1 from a
soft steep bounce to a hard one and rises by as much for shallow ones (Cross; ITF CS 01/02). Along: m/s, and share of
the impulse that friction could give: balls grip, slip back and grip again (Cross 2002). Spin, rad/s: a thick wall's
inertia is known to a sixth, of impulses that give some 300 rad/s."""
TABLE_SPREAD = 1.0
"""Standard deviation of a bounce over the half extent of what it bounces off."""
FREE_STD = np.array([10.0, 16.0, 3.0])
"""Very weak prior of a ball's place at the ends of a play about (0, 0, 1.5), over a tennis court's size, m."""
HELD_M, HELD_S = 1e-4, 1e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyPlan:
    """A play as its fit reads it."""

    play: Play
    frames: RallyFrames
    layout: RallyLayout
    data: RallyData
    lower: Float[np.ndarray, " unknowns"]
    """Bounds of the unknowns; equal where one is held."""
    upper: Float[np.ndarray, " unknowns"]
    origin_s: float
    """Zero of the fit's clock."""
    picture: Int[np.ndarray, " pictures"]
    """Pictures of the play, in order."""
    picture_flight: Int[np.ndarray, " pictures"]
    picture_node: Int[np.ndarray, " pictures"]
    """The node at a picture, or the last one before it."""
    picture_delay: Float[np.ndarray, " pictures"]
    """Seconds after that node; 0 at it."""

    @property
    def held(self) -> Bool[np.ndarray, " unknowns"]:
        """Unknowns that may not move."""
        return np.asarray(self.lower >= self.upper)


@dataclass(frozen=True, eq=False, kw_only=True)
class Surroundings:
    """What a play's fit knows besides the ball's own track."""

    camera: Camera
    """One a frame of the track."""
    world: BallWorld
    players: PlayersAt | None


def contact_priors(frames: RallyFrames, play: Play, around: Surroundings, *, serve: bool) -> ContactPriors:
    """Where the contacts of a play happen, before the ball's own track is looked at.

    Args:
        frames: Pictures.
        play: The contacts.
        around: Camera, world and players.
        serve: Whether the play's first hit is taken for an overhead serve.
    """
    world = around.world
    count = len(play)
    reach = np.array(world.reach_half_size)
    mean = np.tile([0.0, 0.0, 1.5], (count, 1))
    std = np.tile(np.array([*(2.0 * np.maximum(reach, 1.0)), 3.0]), (count, 1))
    person = world.hit_height.std / HIT_HEIGHT.std
    for k, kind in enumerate(play.kinds):
        if kind == "bounce":
            mean[k] = 0, 0, world.radius_m
            std[k] = (*(TABLE_SPREAD * np.array(world.ground_half_size)), HELD_M)
        elif kind == "net":
            top = world.net_xz
            mean[k] = 0, 0, float(top[:, 1].mean()) if len(top) else 0.5
            std[k] = float(np.abs(top[:, 0]).max()) if len(top) else 5.0, 0.05 + world.radius_m, 0.5
        elif kind == "hit":
            std[k, :2] = np.maximum(reach, 1.0)
            mean[k, 2], std[k, 2] = world.hit_height.mean, world.hit_height.std
            if serve and k == play.serve:
                mean[k, 2] = world.floor_z + SERVE_HEIGHT[0] * person
                std[k, 2] = SERVE_HEIGHT[1] * person
                end = _end_of(frames, play, around, k, height=float(mean[k, 2]))
                if np.isfinite(end * world.serve_y):
                    mean[k, 1], std[k, 1] = end * world.serve_y, SERVE_Y_STD * person
            place, spread = _player(frames, play, around, k)
            known = np.isfinite(place)
            mean[k, known], std[k, known] = place[known], spread[known]
    return ContactPriors(mean=mean, precision=1 / std**2)


def _end_of(frames: RallyFrames, play: Play, around: Surroundings, k: int, *, height: float) -> float:
    """Which half a contact at that height is in by the nearest frame with a pixel: -1 near, 1 far; NaN unknown."""
    seen = np.flatnonzero(frames.measured)
    if not len(seen):
        return float("nan")
    frame = seen[np.abs(frames.times[seen] - play.times[k]).argmin()]
    place = meet_plane(around.camera[int(frames.index[frame])], frames.pixels[frame][None], height)[0]
    return float(np.sign(place[1]))


def _player(frames: RallyFrames, play: Play, around: Surroundings, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the player's hand or root has the ball at a hit, and how well; NaN where it says nothing."""
    nothing = np.full(3, np.nan), np.full(3, np.nan)
    if around.players is None:
        return nothing
    near = int(np.abs(frames.times - play.times[k]).argmin())
    frame = int(frames.index[near])
    names = around.players.names
    own = [names.index(play.players[k])] if play.players[k] in names else list(range(len(names)))
    hands = around.players.hands[frame, own].reshape(-1, 3)
    roots = around.players.root_position[frame, own]
    for points, spread in ((hands, np.full(3, WRIST_STD)), (roots, np.array([ROOT_STD, ROOT_STD, np.nan]))):
        known = points[np.isfinite(points).all(axis=1)]
        if not len(known):
            continue
        seen = np.flatnonzero(frames.measured)
        if len(known) > 1 and len(seen):
            pixel = frames.pixels[seen[np.abs(frames.times[seen] - play.times[k]).argmin()]]
            shown, _ = project(around.camera[frame], known)
            away = np.linalg.norm(shown - pixel, axis=1)
            known = known[[int(np.argmin(np.where(np.isfinite(away), away, np.inf)))]]
        return np.where(np.isfinite(spread), known[0], np.nan), spread
    return nothing


@dataclass(frozen=True, eq=False, kw_only=True)
class Guess:
    """What a plan takes as known of the solution that it is for."""

    times: Float[np.ndarray, " contacts"]
    """Contact times: a picture belongs to the flight in whose span it lies."""
    speed: float
    """About the fastest of the ball, m/s, for the integrator's steps."""


def plan_rally(
    frames: RallyFrames, play: Play, around: Surroundings, priors: ContactPriors, guess: Guess, *, bend: float
) -> RallyPlan:
    """The plan of a play.

    Args:
        frames: Pictures.
        play: Contacts at the times that their events give them.
        around: Camera, world and players.
        priors: Of the contacts.
        guess: Of the solution.
        bend: Where the robust loss bends, standard deviations.
    """
    world = around.world
    flight = flight_of(frames.times, guess.times)
    picture = np.flatnonzero((flight >= 0) & (flight < len(play) - 1))
    flight = flight[picture]
    every = max(1, int(NODE_S / frames.interval_s + 1e-6))
    first = np.searchsorted(flight, np.arange(len(play) - 1))
    rank = np.arange(len(picture)) - first[flight] if len(picture) else np.zeros(0, dtype=int)
    at_node = rank % every == 0
    node = np.cumsum(at_node) - 1
    nodes = np.bincount(flight[at_node], minlength=len(play) - 1)
    times = frames.times[picture]
    origin = float(play.times[0])
    node_times = times[at_node]
    knots = np.sort(np.concatenate([node_times, guess.times]))
    longest = float(np.diff(knots).max()) + 0.5 * frames.interval_s if len(knots) > 1 else frames.interval_s
    longest = min(longest, float(np.diff(knots).max()) * 1.5)
    marked = np.isfinite(play.ground_px).all(axis=1)
    pattern = RallyPattern(
        nodes=tuple(int(n) for n in nodes),
        bounces=tuple(kind == "bounce" and world.bounces for kind in play.kinds[1:-1]),
        marks=bool(marked.any()),
        between=every - 1,
        steps=steps_for(longest, world.drag_per_m.mean, guess.speed),
        law=air_law(world),
    )
    layout = RallyLayout(pattern=pattern)
    lower, upper, scale, mean, precision = _unknowns(layout, frames, play, world, priors, guess.times)
    between = np.zeros((int(nodes.sum()), every - 1), dtype=int) - 1
    inner = np.flatnonzero(~at_node)
    if len(inner):
        between[node[inner], rank[inner] % every - 1] = picture[inner]
    flat = between.ravel()
    there = flat >= 0
    delay = np.where(there, frames.times[flat] - np.repeat(node_times, every - 1), 0.0)
    mark_picture = np.abs(frames.times[:, None] - play.times[None]).argmin(axis=0)
    data = RallyData(
        scale=scale,
        prior_mean=mean,
        prior_precision=precision,
        node_times=node_times - origin,
        node_camera=frames.camera[picture[at_node]],
        node_pixel=frames.pixels[picture[at_node]],
        node_precision=frames.precision[picture[at_node]],
        between_delay=delay,
        between_camera=frames.camera[np.maximum(flat, 0)],
        between_pixel=frames.pixels[np.maximum(flat, 0)],
        between_precision=np.where(there, frames.precision[np.maximum(flat, 0)], 0.0),
        mark_camera=frames.camera[mark_picture],
        mark_pixel=np.where(np.reshape(marked, (-1, 1)), play.ground_px, 0.0),
        mark_precision=np.where(marked, 1.0, 0.0) / MARK_STD_PX**2,
        bounce_std=np.ones((len(layout.bounce), 3)),
        bend=bend,
    )
    return RallyPlan(
        play=play,
        frames=frames,
        layout=layout,
        data=data,
        lower=lower,
        upper=upper,
        origin_s=origin,
        picture=picture,
        picture_flight=flight,
        picture_node=node,
        picture_delay=times - node_times[node] if len(node) else times,
    )


def _unknowns(
    layout: RallyLayout, frames: RallyFrames, play: Play, world: BallWorld, priors: ContactPriors, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bounds, scales, prior means and precisions of all unknowns; contact times are bounded about those given."""
    n = layout.size
    lower, upper, scale = np.full(n, -np.inf), np.full(n, np.inf), np.ones(n)
    mean, precision = np.zeros(n), np.zeros(n)
    for places in (layout.after, layout.before, layout.node[:, 3:]):
        scale[places] = 10.0
    grounded = np.flatnonzero([kind == "bounce" for kind in play.kinds])
    mean[layout.position], precision[layout.position] = priors.mean, priors.precision
    held = layout.position[grounded, 2]
    lower[held] = upper[held] = mean[held]
    precision[held] = 0.0
    # Spin: free after a hit or net, by the law after a bounce.
    law = np.concatenate([[False], np.array(layout.pattern.bounces, dtype=bool)])
    scale[layout.spin] = 100.0
    if world.spin_std > 0:
        precision[layout.spin[~law]] = 1 / world.spin_std**2
    else:
        lower[layout.spin[~law]] = upper[layout.spin[~law]] = 0.0
    inner = np.flatnonzero(law)
    upper[layout.before[inner - 1, 2]] = -0.05
    lower[layout.after[inner, 2]] = 0.02
    # Contact times: their priors stay with the events, their bounds go with the pictures between them.
    origin = float(play.times[0])
    time = near - origin
    std = np.maximum(play.time_std, 1e-4)
    slack = np.maximum(2.0 * frames.interval_s, 3 * std)
    gap = np.diff(near)
    before = np.minimum(slack, 0.45 * np.append(np.inf, gap))
    after = np.minimum(slack, 0.45 * np.append(gap, np.inf))
    scale[layout.time] = 0.01
    mean[layout.time], precision[layout.time] = play.times - origin, 1 / std**2
    lower[layout.time], upper[layout.time] = time - before, time + after
    fixed = np.array([kind == "end" for kind in play.kinds]) | (play.time_std < HELD_S)
    # A mark is of the frame that its event names. At the ends of a play nothing else asks when the contact was.
    fixed[[0, -1]] |= np.isfinite(play.ground_px[[0, -1]]).all(axis=1)
    lower[layout.time[fixed]] = upper[layout.time[fixed]] = time[fixed]
    # Shared constants.
    drag = world.drag_per_m
    scale[layout.drag] = max(drag.std, 1e-6)
    mean[layout.drag], precision[layout.drag] = drag.mean, 1 / drag.std**2
    lower[layout.drag], upper[layout.drag] = min(0.0, drag.mean), drag.mean + 6 * drag.std
    for place, prior, top in (
        (layout.restitution, world.restitution, 1.0),
        (layout.friction, world.friction, 2.0),
    ):
        scale[place] = 0.1
        if prior is None or not any(layout.pattern.bounces):
            value = 0.5 if prior is None else prior.mean
            lower[place] = upper[place] = mean[place] = value
        else:
            mean[place], precision[place] = prior.mean, 1 / prior.std**2
            lower[place], upper[place] = 0.02, max(top, prior.mean + prior.std)
    return lower, upper, scale, mean, precision


def with_bounce_std(plan: RallyPlan, unknowns: Float[np.ndarray, " unknowns"]) -> RallyPlan:
    """The same plan with departures from the bounce law as the speeds of a solution make them."""
    layout = plan.layout
    if not len(layout.bounce):
        return plan
    down = np.abs(unknowns[layout.before[layout.bounce - 1, 2]])
    e, mu = unknowns[layout.restitution], unknowns[layout.friction]
    std = np.stack(
        [
            np.hypot(BOUNCE_NORMAL[0], BOUNCE_NORMAL[1] * down),
            np.hypot(BOUNCE_ALONG[0], BOUNCE_ALONG[1] * mu * (1 + e) * down),
            np.full(len(down), BOUNCE_SPIN),
        ],
        axis=1,
    )
    return replace(plan, data=replace(plan.data, bounce_std=std))
