"""Whether motion obeys the world: a ball that flies as balls do, feet that stand where they stand, speeds in reason.

Every figure is a pure function of motion in metres; what real windows give is its yardstick.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.scene import Ball, Scene, SceneObject
from pgm_data.skeleton import Skeleton, world_from_joints

GRAVITY = np.array([0.0, 0.0, -9.81])
"""m/s^2."""
SUBSTEPS = 8
"""Places on the way of a ball between two frames."""
NEAR_GROUND_M = 0.05
"""A ball whose lower edge gets nearer to the ground than this may touch it."""
REACH_M = 2.5
"""A ball nearer than this to a player's root may be hit: arm, racket and a stretch."""
SOLE_M = 0.03
"""Height under which a point of a sole counts as on the ground."""
FIGURES: Mapping[str, str] = MappingProxyType(
    {
        "ball_residual": "acceleration beyond gravity and drag",
        "ball_gap": "gap between states flown together",
        "ball_push": "velocity step between states flown together",
        "ball_free": "steps in free flight",
        "foot_slide": "speed of soles on the ground",
        "foot_down": "soles on the ground",
        "too_fast": "steps faster than any real one",
    }
)
"""Names of the figures in words."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """What is judged: B windows of T frames, metres, radians and metres a second, in the world."""

    columns: Mapping[str, Float[np.ndarray, "B T n"]]
    """By the contract's names."""
    valid: Mapping[str, Bool[np.ndarray, "B T"]]
    """Whether the data say anything of that column there; columns without an entry are not judged."""
    made: Mapping[str, Bool[np.ndarray, "B T"]]
    """Whether it is generated there. Of real windows True everywhere."""
    step_s: Float[np.ndarray, " B"]
    """Seconds between frames."""

    def steps(self, *columns: str) -> Bool[np.ndarray, "B steps"]:
        """Steps between frames at whose both ends all the columns are there, and any of them is generated at one."""
        there = np.logical_and.reduce([self.valid[name] for name in columns])
        made = np.logical_or.reduce([self.made[name] for name in columns])
        return np.asarray(there[:, 1:] & there[:, :-1] & (made[:, 1:] | made[:, :-1]))


@dataclass(frozen=True, kw_only=True)
class PhysicsFigure:
    """One figure of a motion."""

    name: str
    """Of `FIGURES`."""
    object: str
    unit: str
    value: float
    """NaN where nothing could be judged."""
    count: int
    """Steps (of soles: points and steps) that it was taken from."""


def physics_figures(motion: Motion, scene: Scene, fastest: Mapping[str, float]) -> tuple[PhysicsFigure, ...]:
    """All figures that the motion's columns allow.

    - `ball_residual`, median, m/s^2: acceleration of the ball's places over three frames in free flight that gravity
      and drag do not explain. Spin, which the scene file gives no value of, counts in full, also of real windows.
    - `ball_gap`, median, m: in the middle of a step in free flight, how far the place reached from the state before is
      from the place from which the state after is reached, under gravity and drag. A steady force moves both alike and
      cancels: what is left is how well velocities fit places. Of exact data next to nothing.
    - `ball_push`, median, m/s^2: the difference of the two velocities there, over the step.
    - `ball_free`: share of steps in free flight, not near the ground nor in a player's reach.
    - `foot_slide`, mean, m/s: level speed of points of the soles lower than 3 cm at both ends of a step.
    - `foot_down`: share of points and steps in which that is so.
    - `too_fast`: share of steps faster than `fastest`.

    Args:
        motion: What is judged.
        scene: Of which ball, skeletons and regions are taken.
        fastest: Highest speed of each object, m/s, by its name.
    """
    found = [*_ball_figures(motion, scene)]
    for player in scene.players:
        found += _foot_figures(motion, player)
    for name, limit in fastest.items():
        fast = speeds(motion, name) > limit
        found.append(_figure("too_fast", name, "share", fast, np.mean))
    return tuple(found)


def fastest_speeds(motion: Motion, scene: Scene) -> dict[str, float]:
    """Highest speed of each object of the scene between frames, m/s, by its name."""
    found = {name: speeds(motion, name) for name in (*(player.name for player in scene.players), "ball")}
    return {name: float(values.max()) for name, values in found.items() if len(values)}


def speeds(motion: Motion, name: str) -> Float[np.ndarray, " steps"]:
    """Speeds of an object's steps, from its places, m/s; none where the motion does not have it."""
    column = "ball.position" if name == "ball" else f"{name}.root_position"
    if column not in motion.valid:
        return np.zeros(0)
    moved = np.linalg.norm(np.diff(motion.columns[column], axis=1), axis=-1) / motion.step_s[:, None]
    return moved[motion.steps(column)]


def _ball_figures(motion: Motion, scene: Scene) -> list[PhysicsFigure]:
    if scene.ball is None or not {"ball.position", "ball.velocity"} <= set(motion.valid):
        return []
    steps = motion.steps("ball.position", "ball.velocity")
    players = [f"{player.name}.root_position" for player in scene.players]
    roots = [
        np.where(motion.valid[name][..., None], motion.columns[name], np.inf)
        for name in players
        if name in motion.valid
    ]
    flight = free_flight(
        motion.columns["ball.position"],
        motion.columns["ball.velocity"],
        np.stack(roots, axis=-2) if roots else np.zeros((*steps.shape[:1], steps.shape[1] + 1, 0, 3)),
        motion.step_s,
        scene.ball,
    )
    free = flight.free & steps
    twice = free[:, 1:] & free[:, :-1]
    pulls = unexplained(motion.columns["ball.position"], motion.step_s, scene.ball)
    return [
        _figure("ball_residual", "ball", "m/s^2", pulls[twice], np.median),
        _figure("ball_gap", "ball", "m", flight.gap[free], np.median),
        _figure("ball_push", "ball", "m/s^2", flight.push[free], np.median),
        _figure("ball_free", "ball", "share", flight.free[steps], np.mean),
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class Flight:
    """How each step of a ball agrees with free flight."""

    gap: Float[np.ndarray, "B steps"]
    """Between the two ways in the middle of the step, m."""
    push: Float[np.ndarray, "B steps"]
    """Between their velocities, over the step, m/s^2."""
    free: Bool[np.ndarray, "B steps"]
    """Whether neither way gets near the ground or into a player's reach."""


def free_flight(
    position: Float[np.ndarray, "B T 3"],
    velocity: Float[np.ndarray, "B T 3"],
    roots: Float[np.ndarray, "B T players 3"],
    step_s: Float[np.ndarray, " B"],
    ball: Ball,
) -> Flight:
    """Each step's two ways: flown on from the state before, and flown back from the state after.

    Args:
        position: Centre of the ball, world metres.
        velocity: m/s; after the contact, at a contact.
        roots: Of the players, world metres; infinite where there is none.
        step_s: Seconds between frames.
        ball: Its radius and drag.
    """
    step = step_s[:, None, None]
    on = flown(position[:, :-1], velocity[:, :-1], step, ball.drag_per_m.mean)
    back = flown(position[:, 1:], velocity[:, 1:], -step, ball.drag_per_m.mean)
    middle = SUBSTEPS // 2
    ways = np.concatenate([on[0], back[0]])
    high = ways[..., 2].min(axis=0) > ball.radius_m + NEAR_GROUND_M
    apart = np.ones_like(high)
    for root in np.moveaxis(roots, -2, 0):
        for end in (root[:, :-1], root[:, 1:]):
            apart &= (np.linalg.norm(ways - end, axis=-1) > REACH_M).all(axis=0)
    return Flight(
        gap=np.linalg.norm(on[0][middle] - back[0][middle], axis=-1),
        push=np.linalg.norm(on[1][middle] - back[1][middle], axis=-1) / step[..., 0],
        free=high & apart,
    )


def unexplained(
    position: Float[np.ndarray, "B T 3"], step_s: Float[np.ndarray, " B"], ball: Ball
) -> Float[np.ndarray, "B triples"]:
    """Acceleration of each three places in a row that gravity and drag do not explain, m/s^2.

    The places before and after are compared with those on the way through the middle one at the mean velocity.
    """
    step = step_s[:, None, None]
    before, here, after = position[:, :-2], position[:, 1:-1], position[:, 2:]
    velocity = (after - before) / (2 * step)
    ahead = flown(here, velocity, step, ball.drag_per_m.mean)[0][-1]
    behind = flown(here, velocity, -step, ball.drag_per_m.mean)[0][-1]
    return np.linalg.norm((after + before) - (ahead + behind), axis=-1) / step[..., 0] ** 2


def flown(
    position: Float[np.ndarray, "*batch 3"],
    velocity: Float[np.ndarray, "*batch 3"],
    time_s: Float[np.ndarray, "*#batch 1"],
    drag_per_m: float,
) -> tuple[Float[np.ndarray, "places *batch 3"], Float[np.ndarray, "places *batch 3"]]:
    """Places and velocities at even times from now (the first) to `time_s` (the last), under gravity and drag.

    Fourth-order Runge-Kutta; `time_s` may be below 0. Speeds are taken as at most 200 m/s for the drag, beyond which
    a way back in time soon has no end.
    """

    def pull(v: np.ndarray) -> np.ndarray:
        return GRAVITY - drag_per_m * np.minimum(np.linalg.norm(v, axis=-1, keepdims=True), 200.0) * v

    h = time_s / SUBSTEPS
    places, velocities = [position], [velocity]
    for _ in range(SUBSTEPS):
        p, v = places[-1], velocities[-1]
        a1 = pull(v)
        a2 = pull(v + h / 2 * a1)
        a3 = pull(v + h / 2 * a2)
        a4 = pull(v + h * a3)
        places.append(p + h * v + h**2 / 6 * (a1 + a2 + a3))
        velocities.append(v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))
    return np.stack(places), np.stack(velocities)


def _foot_figures(motion: Motion, player: SceneObject) -> list[PhysicsFigure]:
    name, skeleton = player.name, player.skeleton
    parts = [f"{name}.{part}" for part in ("root_position", "root_rotation", "joint_rotations")]
    if skeleton is None or not set(parts) <= set(motion.valid):
        return []
    steps = motion.steps(*parts)
    floor = player.region_m[0][2] if player.region_m else 0.0
    soles = sole_points(
        skeleton,
        motion.columns[f"{name}.joint_rotations"],
        motion.columns[f"{name}.joint_translations"],
    )
    slide, down = foot_slides(soles, motion.step_s, floor)
    return [
        _figure("foot_slide", name, "m/s", slide[down & steps[..., None]], np.mean),
        _figure("foot_down", name, "share", down[steps], np.mean),
    ]


def sole_points(
    skeleton: Skeleton,
    rotations: Float[np.ndarray, "B T numbers"],
    translations: Float[np.ndarray, "B T numbers"],
) -> Float[np.ndarray, "B T points 3"]:
    """Points of both soles in the world, metres; entry 0 of the columns is the root.

    The skeleton file gives them at its own size: they grow with the leg's bones.
    """
    names = [*skeleton.soles[0], *skeleton.soles[1]]
    points = np.array([skeleton.point_names.index(name) for name in names], dtype=np.int64)
    joints = skeleton.point_joints[points]
    shape = (*rotations.shape[:2], len(skeleton.parents), 3)
    t = translations.reshape(-1, *shape[2:])
    R, at = world_from_joints(skeleton.parents, rotations.reshape(-1, *shape[2:]), t)
    sizes = (
        np.linalg.norm(t[:, 1:], axis=-1).sum(axis=1) / np.linalg.norm(skeleton.rest_translations[1:], axis=-1).sum()
    )
    offsets = sizes[:, None, None] * skeleton.point_offsets[points]
    soles = at[:, joints] + (R[:, joints] @ offsets[..., None])[..., 0]
    return soles.reshape(*shape[:2], len(points), 3)


def foot_slides(
    soles: Float[np.ndarray, "B T points 3"], step_s: Float[np.ndarray, " B"], floor: float
) -> tuple[Float[np.ndarray, "B steps points"], Bool[np.ndarray, "B steps points"]]:
    """Level speed of each point in each step, m/s; and whether it is on the ground at both ends."""
    low = soles[..., 2] < floor + SOLE_M
    moved = np.linalg.norm(np.diff(soles[..., :2], axis=1), axis=-1) / step_s[:, None, None]
    return moved, np.asarray(low[:, 1:] & low[:, :-1])


def _figure(
    name: str, thing: str, unit: str, values: np.ndarray, middle: Callable[[np.ndarray], float]
) -> PhysicsFigure:
    return PhysicsFigure(
        name=name,
        object=thing,
        unit=unit,
        value=float(middle(values)) if values.size else float("nan"),
        count=int(values.size),
    )
