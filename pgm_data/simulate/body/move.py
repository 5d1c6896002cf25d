"""A player's whole body at any time of a play: legs after the plan, arms after the strokes, eyes on the ball."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body import arms, postures
from pgm_data.simulate.body.carry import alertness, carried
from pgm_data.simulate.body.contact import solved_course
from pgm_data.simulate.body.figure import BodyTrack, Figure, smpl24, world_from_joints
from pgm_data.simulate.body.keys import rise
from pgm_data.simulate.body.legs import LowerBody, lower_body
from pgm_data.simulate.body.schedule import demand_at, schedule_of
from pgm_data.simulate.body.trunk import look_directions, neck_and_head
from pgm_data.simulate.tennis.play import Plan, Stroke

_NAMES = smpl24().joint_names
_TRUNK = [_NAMES.index(name) for name in ("Torso", "Spine", "Chest")]
_ARMS = {
    side: [_NAMES.index(side[0].upper() + "_" + part) for part in ("Thorax", "Shoulder", "Elbow", "Wrist", "Hand")]
    for side in ("left", "right")
}
_NECK = [_NAMES.index("Neck"), _NAMES.index("Head")]
MIRROR = np.array([-1.0, 1.0, 1.0])
_GRASPS = 0.55
"""The other hand is drawn to the shaft where its hold is firmer than this: by then it is near."""
BALL_IN_HAND = np.array([0.0, -0.05, 0.0])
"""A held ball's centre in the frame of the hand's joint, metres: before the palm."""


def body_track(
    figure: Figure,
    plan: Plan,
    strokes: tuple[Stroke, ...],
    watched: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]],
    times: Float[np.ndarray, " times"],
) -> BodyTrack:
    """The body at any times, in any order; what it does at one time does not depend on the others asked for.

    Args:
        figure: Whose body.
        plan: Where the pelvis goes.
        strokes: This player's strokes, in order of time.
        watched: World place of the ball at any times; NaN where there is none to look at.
        times: Seconds of the play.
    """
    schedule = schedule_of(figure, plan, strokes)
    special = schedule.special_times()
    lower = lower_body(figure, plan, lambda t: demand_at(schedule, t), np.concatenate([times, special]))
    n = len(times)
    course = solved_course(figure, schedule, lower.root_position[n:], lower.root_rotation[n:])
    lower = _first(lower, n)
    value = carried(lower, alertness(schedule.last_s, times), left_handed=figure.hand == "left")
    if course is not None:
        share = schedule.share_at(times)[:, None]
        value = value + share * (course.at(times) - value)
    racket, other = _arm_angles(figure, value)
    R = lower.leg_rotations.copy()
    R[:, 0] = lower.root_rotation
    _set_upper(R, figure, racket, other)
    chest = R[:, 0] @ R[:, _TRUNK[0]] @ R[:, _TRUNK[1]] @ R[:, _TRUNK[2]]
    look = look_directions(watched, schedule.place_at, figure.height_m, times)
    R[:, _NECK] = neck_and_head(np.einsum("nji,nj->ni", chest, look))[:, None]
    return BodyTrack(root_position=lower.root_position, rotations=R, contact=lower.contact)


def hand_position(track: BodyTrack, figure: Figure) -> Float[np.ndarray, "times 3"]:
    """World place of a ball in the hand without the racket."""
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    joint = _ARMS["left" if figure.hand == "right" else "right"][-1]
    return t[:, joint] + R[:, joint] @ BALL_IN_HAND


def _first(lower: LowerBody, n: int) -> LowerBody:
    return LowerBody(
        root_position=lower.root_position[:n],
        root_rotation=lower.root_rotation[:n],
        leg_rotations=lower.leg_rotations[:n],
        contact=lower.contact[:n],
        stride_phase=lower.stride_phase[:n],
        speed=lower.speed[:n],
    )


def _arm_angles(figure: Figure, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles of both chains within limits, the other hand on the shaft where it holds it."""
    racket = arms.within_limits(value[:, postures.RACKET])
    other = arms.within_limits(value[:, postures.OTHER])
    other[:, : arms.TRUNK] = arms.mirrored(racket)[:, : arms.TRUNK]
    hold, along = value[:, postures.HOLD].T
    away = "left" if figure.hand == "right" else "right"
    points = postures.shaft_points(racket, along, postures.side_bones(figure.translations, figure.hand))
    other = arms.follow_points(
        other, *arms.inner_limits(), arms.EASE, postures.side_bones(figure.translations, away), points,
        rise((hold - _GRASPS) / (1.0 - _GRASPS)),
    )  # fmt: skip
    return racket, other


def _set_upper(R: np.ndarray, figure: Figure, racket: np.ndarray, other: np.ndarray) -> None:
    """Fill trunk and arms, in place."""
    flip = np.outer(MIRROR, MIRROR)
    held, free = arms.joint_rotations(racket), arms.joint_rotations(other)
    right, left = (held, free * flip) if figure.hand == "right" else (free, held * flip)
    R[:, _TRUNK] = held[:, :3] if figure.hand == "right" else held[:, :3] * flip
    R[:, _ARMS["right"]] = right[:, 3:]
    R[:, _ARMS["left"]] = left[:, 3:]
