"""The block figure: the posture that goes with a course, its joints, and the six boxes of its body.

Legs are rigid, as in block games. The leg that stands swings back under the body by just so much that the edge of its
sole which bears (the heel in front of the hip, the toe behind it) rests on the ground; the other leg mirrors it. The
body sinks and rises so that the lower edge of the soles touches the ground.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.simulate.blocks.course import KINDS, TICK_S, Course, smooth
from pgm_data.simulate.blocks.world import BlockWorld, solid_at
from pgm_data.simulate.rotations import about, facing
from pgm_data.skeleton import Skeleton, load_skeleton

PIXEL_M = 0.05625
"""One texel of the skin: the figure is 32 of them tall."""
LEG_M = 12 * PIXEL_M
SOLE_HALF_M = 2 * PIXEL_M
SWING_SPEEDS = (0.0, 1.0, 2.5, 4.3, 5.6)
SWINGS = (0.0, 0.28, 0.5, 0.70, 0.84)
"""Largest angle of a leg at those speeds (m/s), radians."""
AIR_SWING = 0.35
PARTS = ("head", "torso", "L_arm", "R_arm", "L_leg", "R_leg")
_BOXES_PX = {
    "head": ((-4, 0, -4), (4, 8, 4)),
    "torso": ((-4, -12, -2), (4, 0, 2)),
    "L_arm": ((-2, -10, -2), (2, 2, 2)),
    "R_arm": ((-2, -10, -2), (2, 2, 2)),
    "L_leg": ((-2, -12, -2), (2, 0, 2)),
    "R_leg": ((-2, -12, -2), (2, 0, 2)),
}
PART_BOXES_M = np.array([_BOXES_PX[p] for p in PARTS], dtype=float) * PIXEL_M
"""Lower and upper corner of each part in its joint's frame, metres."""


@cache
def blocks13() -> Skeleton:
    """The skeleton file that the figure follows."""
    return load_skeleton("blocks13")


@cache
def part_joints() -> tuple[int, ...]:
    """Index of the joint that carries each part."""
    return tuple(blocks13().joint_names.index(p) for p in PARTS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """The figure at some times."""

    rotations: Float[np.ndarray, "times 13 3 3"]
    """R_parent_from_joint; entry 0 is R_world_from_root."""
    translations: Float[np.ndarray, "times 13 3"]
    """t_parent_from_joint, metres; entry 0 is the root in the world."""
    world_rotations: Float[np.ndarray, "times 13 3 3"]
    joints: Float[np.ndarray, "times 13 3"]
    """World metres."""
    contact: Bool[np.ndarray, "times 2"]
    """Whether the left, the right foot stands on something."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Gait:
    """The legs along a course, on its ticks."""

    reach: Float[np.ndarray, " ticks"]
    """How far before the hip the left sole bears, metres; the right one is as far behind."""
    left_stands: Bool[np.ndarray, " ticks"]
    """Whether the left leg is the one that bears."""
    planted: Bool[np.ndarray, " ticks"]
    """Whether the bearing leg rests, and does not close up to the other or turn on the spot."""
    still: Bool[np.ndarray, " ticks"]
    """Whether both legs rest."""


def half_stride(swing: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """How far before the hip the sole bears at the largest angle, metres, counted so that it is 0 under the hip."""
    return np.asarray(LEG_M * np.sin(swing) + SOLE_HALF_M * (1 - np.cos(swing)))


def angle_of(reach: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Angle of a leg, radians, whose sole bears so far before (positive) or behind the hip; undoes `half_stride`."""
    radius, lean = np.hypot(LEG_M, SOLE_HALF_M), np.arctan2(SOLE_HALF_M, LEG_M)
    return np.asarray(np.sign(reach) * (lean + np.arcsin(np.clip((np.abs(reach) - SOLE_HALF_M) / radius, -1, 1))))


def hip_height(angle: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Height of the hip over the lowest edge of the sole of a leg at an angle, metres."""
    return np.asarray(LEG_M * np.cos(angle) + SOLE_HALF_M * np.abs(np.sin(angle)))


def gait_of(course: Course) -> Gait:
    """The steps that carry the figure along its course: the bearing sole moves back as fast as the body goes ahead."""
    ticks = TICK_S * np.arange(len(course.tick_headings))
    feet = course.feet_at(np.minimum(ticks, course.end))
    velocity = np.gradient(feet, TICK_S, axis=0)
    ahead = np.column_stack([-np.sin(course.tick_headings), np.cos(course.tick_headings)])
    forward = np.diff((feet[:, :2]), axis=0, prepend=feet[:1, :2])
    forward = (forward * ahead).sum(axis=1)
    speed = smooth(np.linalg.norm(velocity[:, :2], axis=1), 8)
    kinds = course.kind_at(ticks)
    air = smooth(np.isin(kinds, [KINDS.index("jump"), KINDS.index("fall")]).astype(float), 4)
    climbs = np.isin(kinds, [KINDS.index("climb_up"), KINDS.index("climb_down")])
    swing = np.interp(speed, SWING_SPEEDS, SWINGS) * (1 - air) + AIR_SWING * air
    swing = np.where(climbs, CLIMB_SWING, swing)
    step = np.where(course.grounded_at(ticks), forward, np.where(climbs, 0.4 * velocity[:, 2] * TICK_S, 0.35 * forward))
    rests = (np.linalg.norm(velocity[:, :2], axis=1) < 0.1) & ~climbs & (air < 0.5)
    reach, left_stands = _stepped(step, half_stride(swing), rests)
    turns = np.abs(np.gradient(course.tick_headings, TICK_S)) > 0.6
    closed = np.abs(reach) < 0.01
    return Gait(reach=reach, left_stands=left_stands, planted=~rests | closed & ~turns, still=rests & closed & ~turns)


CLIMB_SWING = 0.3
CLOSING = float(np.exp(-TICK_S / 0.05))


def _stepped(step: np.ndarray, half: np.ndarray, rests: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Reach of the left leg, and whether it bears, tick by tick; legs change where the bearing one has gone its way."""
    reach, left = np.empty(len(step)), np.empty(len(step), dtype=bool)
    own, stands_left = 0.0, True
    for tick, (ahead, limit, rest) in enumerate(zip(step.tolist(), half.tolist(), rests.tolist(), strict=True)):
        own -= ahead
        if (own < -limit and ahead > 0) or (own > limit and ahead < 0):
            own, stands_left = -own, not stands_left
        if rest:
            own *= CLOSING
        own = min(max(own, -LARGEST_REACH_M), LARGEST_REACH_M)
        reach[tick] = own if stands_left else -own
        left[tick] = stands_left
    return reach, left


LARGEST_REACH_M = 0.56


def posture_at(course: Course, gait: Gait, world: BlockWorld, times: Float[np.ndarray, " times"]) -> Posture:
    """The figure at times of the course; each instant by itself, so that no frame rate changes it."""
    ticks = TICK_S * np.arange(len(gait.reach))
    reach = angle_of(np.interp(times, ticks, gait.reach))
    feet = course.feet_at(times)
    heading = course.heading_at(times)
    kind = course.kind_at(times)
    wished = np.column_stack([reach, -reach])
    legs = _kept_out_of_walls(world, feet, heading, wished)
    R_root = facing(heading)
    hip = hip_height(legs).max(axis=1)
    names = blocks13().joint_names
    rotations = np.tile(np.eye(3), (len(times), 13, 1, 1))
    rotations[:, 0] = R_root
    for side, leg in enumerate(("L_leg", "R_leg")):
        rotations[:, names.index(leg)] = about(0, -legs[:, side])
    _upper_body(course, rotations, times, legs, kind)
    translations = np.tile(blocks13().rest_translations, (len(times), 1, 1))
    translations[:, 0] = feet + np.column_stack([np.zeros((len(times), 2)), hip])
    R_world, joints = rotations.copy(), translations.copy()
    for joint, parent in enumerate(blocks13().parents):
        if parent >= 0:
            R_world[:, joint] = R_world[:, parent] @ rotations[:, joint]
            joints[:, joint] = joints[:, parent] + (R_world[:, parent] @ translations[:, joint, :, None])[..., 0]
    contact = _contact(course, gait, world, times, legs, joints)
    return Posture(
        rotations=rotations, translations=translations, world_rotations=R_world, joints=joints, contact=contact
    )


WALL_TRIES = np.linspace(1.0, 0.0, 21)


def _kept_out_of_walls(world: BlockWorld, feet: np.ndarray, heading: np.ndarray, legs: np.ndarray) -> np.ndarray:
    """Angles of the legs, smaller where a foot would enter a block in front or behind."""
    ahead = np.column_stack([-np.sin(heading), np.cos(heading)])
    left = np.column_stack([-np.cos(heading), -np.sin(heading)])
    angles = legs[..., None] * WALL_TRIES
    hip = hip_height(angles)
    free = np.ones(angles.shape, dtype=bool)
    for edge in (-SOLE_HALF_M, SOLE_HALF_M):
        reach = LEG_M * np.sin(angles) + edge * np.cos(angles)
        # 5 mm to spare; a sole that grazes the ground is no collision.
        reach = reach + 0.005 * np.sign(reach)
        height = np.maximum(hip - LEG_M * np.cos(angles) + edge * np.sin(angles), 0.0) + 0.012
        for lateral in (-SOLE_HALF_M, SOLE_HALF_M):
            across = np.array([2 * PIXEL_M, -2 * PIXEL_M])[:, None] + lateral
            flat = (
                feet[:, None, None, :2]
                + reach[..., None] * ahead[:, None, None]
                + np.broadcast_to(across[None, :, :, None], (1, 2, 1, 1)) * left[:, None, None]
            )
            points = np.concatenate([flat, (feet[:, None, None, 2] + height)[..., None]], axis=-1)
            free &= ~solid_at(world, points)
    # The first of the tries from which on towards 0 all are free.
    blocked_later = np.cumsum(~free[..., ::-1], axis=-1)[..., ::-1] > 0
    first = np.argmax(~blocked_later, axis=-1)
    return legs * np.where(blocked_later.all(axis=-1), 0.0, WALL_TRIES[first])


def _upper_body(course: Course, rotations: np.ndarray, times: np.ndarray, legs: np.ndarray, kind: np.ndarray) -> None:
    """Arms against the legs, head ahead of the body's turns."""
    names = blocks13().joint_names
    ticks = TICK_S * np.arange(len(course.tick_headings))
    kinds = course.kind_at(ticks)

    def share(*wanted: str) -> np.ndarray:
        held = np.isin(kinds, [KINDS.index(w) for w in wanted if w in KINDS]).astype(float)
        return np.interp(times, ticks, smooth(held, 5))

    climbs, air, up = share("climb_up", "climb_down"), share("jump", "fall"), share("climb_up")
    down = share("climb_down", "fall")
    height = course.feet_at(times)[:, 2]
    for side, sign, arm in ((0, 1.0, "L_arm"), (1, -1.0, "R_arm")):
        swing = -0.85 * legs[:, side] * (1 - climbs)
        reach = climbs * (2.25 + 0.4 * sign * np.sin(2 * np.pi * height / 1.1))
        out = 0.05 + 0.03 * np.sin(1.8 * times + sign) + 0.3 * air * (1 - climbs)
        rotations[:, names.index(arm)] = about(2, sign * out) @ about(0, -(swing + reach))
    soon = course.heading_at(np.minimum(times + 0.3, course.end)) - course.heading_at(times)
    idle = 0.35 * np.sin(0.9 * times + 1.0) * share("stand") + 0.12 * np.sin(0.37 * times)
    yaw = np.clip(1.2 * soon, -1.0, 1.0) + idle
    pitch = 0.10 * np.sin(0.53 * times) + 0.05 * np.sin(1.31 * times + 2) - 0.45 * up + 0.5 * down
    rotations[:, names.index("head")] = about(1, yaw) @ about(0, pitch)
    rotations[:, names.index("torso")] = about(1, 0.10 * (legs[:, 1] - legs[:, 0]) * (1 - climbs))


def _contact(
    course: Course, gait: Gait, world: BlockWorld, times: np.ndarray, legs: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """A foot stands where the player is grounded, its leg bears, rests, and something firm is right below the sole."""
    names = blocks13().joint_names
    tick = np.minimum(np.floor(times / TICK_S + 1e-9).astype(np.int64), len(gait.reach) - 1)
    hip = hip_height(legs).max(axis=1)
    feet = course.feet_at(times)
    contact = np.zeros((len(times), 2), dtype=bool)
    for side, name in enumerate(("L_leg_end", "R_leg_end")):
        below = joints[:, names.index(name)].copy()
        below[:, 2] = feet[:, 2] - 0.02
        bears = gait.planted[tick] & ((gait.left_stands[tick] == (side == 0)) | gait.still[tick])
        low = hip - hip_height(legs[:, side]) < 0.01
        contact[:, side] = course.grounded_at(times) & bears & low & solid_at(world, below)
    return contact


def part_placements(posture: Posture, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """R_world_from_part (6, 3, 3) and positions (6, 3) of the parts' joints in one frame."""
    index = list(part_joints())
    return posture.world_rotations[frame, index], posture.joints[frame, index]


def hull_points(posture: Posture) -> Float[np.ndarray, "times 48 3"]:
    """Corners of the six boxes, world metres."""
    share = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    corners = PART_BOXES_M[:, 0, None] + share * (PART_BOXES_M[:, 1] - PART_BOXES_M[:, 0])[:, None]
    index = list(part_joints())
    turned = np.einsum("tpij,pcj->tpci", posture.world_rotations[:, index], corners)
    return (turned + posture.joints[:, index, None]).reshape(len(posture.joints), -1, 3)
