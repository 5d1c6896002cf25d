"""Where the flight of a ball breaks between frames, and what may have broken it: ground, player or net."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.caption.court_areas import looks
from pgm_data.dataset.clip_ball import nearest_frames
from pgm_data.lift.ball.world import GRAVITY, BallWorld, ball_world
from pgm_data.scene import Scene
from pgm_models.animation import flight


@dataclass(frozen=True, kw_only=True)
class ContactOptions:
    """What counts as a contact."""

    least_break_m_s: float = 3.0
    """Velocity that flight must fail to explain at a hit or at the net, m/s."""
    least_bounce_m_s: float = 1.2
    """The same at a bounce, m/s."""
    noise_factor: float = 4.0
    """How many times the usual unexplained velocity of the play it must be as well."""
    least_hit_m_s: float = 5.0
    """Change of a hit's level velocity, m/s."""
    reach_m: float = 2.3
    """Level distance from a player's root within which it hits the ball, metres."""
    reach_height_m: float = 3.9
    """Height above the root's floor up to which it hits it, metres."""
    ground_m: float = 0.5
    """How far the two flights that meet at a bounce may miss the ground, in metres, where the ball is slow."""
    net_m: float = 0.45
    """Distance from the net's plane within which a break may be a contact with it, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Meeting:
    """Where the flight before some breaks and that after them meet; a row a break."""

    seconds: Float[np.ndarray, " rows"]
    """After the first frame."""
    position: Float[np.ndarray, "rows 3"]
    before: Float[np.ndarray, "rows 3"]
    """Velocity, m/s."""
    after: Float[np.ndarray, "rows 3"]


def flown(
    position: Float[np.ndarray, "*batch 3"],
    velocity: Float[np.ndarray, "*batch 3"],
    seconds: Float[np.ndarray, "*batch"],
    scene: Scene,
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Position (m) and velocity (m/s) of a ball that nothing touches and that does not spin, some time later.

    Gravity, and the scene's mean drag; times below 0 go back. NaN stays NaN.

    Raises:
        ValueError: If the scene has no ball.
    """
    return flight.flown(position, velocity, seconds, world_of(scene).drag_per_m.mean)


@lru_cache(maxsize=16)
def world_of(scene: Scene) -> BallWorld:
    """What the scene's ball flies in.

    Raises:
        ValueError: If the scene has no ball or no court.
    """
    return ball_world(scene)


def breaks(
    position: np.ndarray, velocity: np.ndarray, times: np.ndarray, rows: Int[np.ndarray, " rows"], scene: Scene
) -> Float[np.ndarray, " rows"]:
    """Speed that flight does not explain between each of the frames and the next one."""
    _, flew = flown(position[rows], velocity[rows], times[rows + 1] - times[rows], scene)
    return np.linalg.norm(velocity[rows + 1] - flew, axis=1)


def bounces_of(
    position: np.ndarray,
    velocity: np.ndarray,
    times: np.ndarray,
    start: Int[np.ndarray, " rows"],
    end: Int[np.ndarray, " rows"],
    scene: Scene,
    options: ContactOptions,
) -> tuple[Bool[np.ndarray, " rows"], Meeting]:
    """Which breaks between start and end frames are bounces, and where both flights meet the ground.

    The flight before and that after cross the height of the ball's radius at nearly one time between the frames, the
    faster the better known; level, the ball goes on as it did.
    """
    world = world_of(scene)
    span = times[end] - times[start]
    down = crossing_of(position[start], velocity[start], world, rising=False)
    up = span + crossing_of(position[end], velocity[end], world, rising=True)
    _, before = flown(position[start], velocity[start], np.nan_to_num(down).clip(0.0, span), scene)
    _, after = flown(position[end], velocity[end], np.nan_to_num(up).clip(0.0, span) - span, scene)
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = before[:, 2] ** 2 / (before[:, 2] ** 2 + after[:, 2] ** 2)
        seconds = weight * down + (1.0 - weight) * up
        slack = options.ground_m / np.minimum(-before[:, 2], after[:, 2])
        slack = np.minimum(slack, 0.04 + 0.75 * span)
        level = (before[:, :2] * after[:, :2]).sum(axis=1)
        bounces = (before[:, 2] < -0.3) & (after[:, 2] > 0.3) & (np.abs(up - down) < slack)
        bounces &= (seconds > -0.5 * slack) & (seconds < span + 0.5 * slack)
        # What goes on as it did has bounced; a ball hit as low as that comes back.
        bounces &= (level > 0) | (np.hypot(*before[:, :2].T) < 2.0)
        bounces &= np.hypot(*after[:, :2].T) < np.hypot(*before[:, :2].T) + options.least_hit_m_s
    seconds = np.where(bounces, seconds, 0.0).clip(0.0, span)
    one, before = flown(position[start], velocity[start], seconds, scene)
    two, after = flown(position[end], velocity[end], seconds - span, scene)
    place = 0.5 * (one + two)
    place[:, 2] = world.radius_m
    # Off a table's top a ball bounces, and beside it not; beside a court it does.
    inside = (np.abs(place[:, :2]) <= world.ground_half_size).all(axis=1) | (world.floor_z >= 0)
    return bounces & inside & world.bounces, Meeting(seconds=seconds, position=place, before=before, after=after)


def crossing_of(
    position: Float[np.ndarray, "rows 3"], velocity: Float[np.ndarray, "rows 3"], world: BallWorld, *, rising: bool
) -> Float[np.ndarray, " rows"]:
    """When the ball is at its radius above the ground, falling after or rising before the frame, s; NaN where never."""
    speed = np.linalg.norm(velocity, axis=1)
    pull = GRAVITY + world.drag_per_m.mean * speed * velocity[:, 2]
    height = position[:, 2] - world.radius_m
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(velocity[:, 2] ** 2 + 2.0 * pull * height)
        # Of the two forms of a quadratic's root, the one that does not subtract like numbers or divide by a small pull.
        falls = np.where(velocity[:, 2] < 0, 2.0 * height / (root - velocity[:, 2]), (velocity[:, 2] + root) / pull)
        rises = np.where(velocity[:, 2] > 0, -2.0 * height / (root + velocity[:, 2]), (velocity[:, 2] - root) / pull)
    return rises if rising else falls


def meeting_of(
    position: np.ndarray,
    velocity: np.ndarray,
    times: np.ndarray,
    start: Int[np.ndarray, " rows"],
    end: Int[np.ndarray, " rows"],
    scene: Scene,
) -> Meeting:
    """Where the flight from the start frame and that to the end frame come nearest to each other."""
    span = times[end] - times[start]
    back, _ = flown(position[end], velocity[end], -span, scene)
    ahead, _ = flown(position[start], velocity[start], span, scene)
    apart = position[start] - back
    rate = ((ahead - position[end]) - apart) / np.maximum(span, 1e-9)[:, None]
    seconds = -(apart * rate).sum(axis=1) / np.maximum((rate**2).sum(axis=1), 1e-9)
    seconds = seconds.clip(0.0, span)
    one, before = flown(position[start], velocity[start], seconds, scene)
    two, after = flown(position[end], velocity[end], seconds - span, scene)
    return Meeting(seconds=seconds, position=0.5 * (one + two), before=before, after=after)


def hitters_of(
    met: Meeting,
    when: Float[np.ndarray, " rows"],
    times: Float[np.ndarray, " frames"],
    roots: Float[np.ndarray, "frames players 3"],
    scene: Scene,
    options: ContactOptions,
) -> Int[np.ndarray, " rows"]:
    """Index of the player who hits the ball at each break; -1 where none does."""
    if not len(when) or not roots.shape[1]:
        return np.full(len(when), -1, dtype=np.int64)
    root = roots[nearest_frames(when, times)]
    away = np.hypot(*(met.position[:, None, :2] - root[..., :2]).transpose(2, 0, 1))
    away = np.where(np.isfinite(away), away, np.inf)
    floors = np.array([player.region_m[0][2] if player.region_m else 0.0 for player in scene.players])
    away[met.position[:, None, 2] - floors > options.reach_height_m] = np.inf
    changed = met.after - met.before
    look = looks(scene)
    # Whoever faces a net sends the ball to it, and against the way it came.
    towards = (met.after[:, None, 1] * look > 0) & (changed[:, None, 1] * look > 0)
    away[(look != 0) & ~towards] = np.inf
    away[np.hypot(*changed[:, :2].T) < options.least_hit_m_s] = np.inf
    nearest = away.argmin(axis=1)
    return np.where(away.min(axis=1) <= options.reach_m, nearest, -1)


def touches_net(met: Meeting, world: BallWorld, options: ContactOptions) -> Bool[np.ndarray, " rows"]:
    """Which breaks are at the net, by place and by what they take of the way across it."""
    if not len(world.net_xz):
        return np.zeros(len(met.seconds), dtype=bool)
    top = np.interp(met.position[:, 0], world.net_xz[:, 0], world.net_xz[:, 1], left=-np.inf, right=-np.inf)
    slower = (met.after[:, 1] - met.before[:, 1]) * np.sign(met.before[:, 1]) < 0
    return slower & (np.abs(met.position[:, 1]) < options.net_m) & (met.position[:, 2] < top + 3 * world.radius_m)
