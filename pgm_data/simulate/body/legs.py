"""Pelvis and legs that follow a plan: planted feet stay where they are, whatever times the body is asked for."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.simulate import rotations
from pgm_data.simulate.body import feet, footsteps, limb, pelvis
from pgm_data.simulate.body.figure import Figure, smpl24
from pgm_data.simulate.body.pelvis import HipDemand, no_demand
from pgm_data.simulate.tennis.play import Plan

__all__ = ["HipDemand", "LowerBody", "lower_body", "no_demand"]

_NAMES = smpl24().joint_names
_LEGS = tuple(tuple(_NAMES.index(side + part) for part in ("Hip", "Knee", "Ankle", "Toe")) for side in ("L_", "R_"))
_ANKLE_LIMITS = (-0.75, 0.85)
"""Radians, toes up and toes down, of a foot in the air."""
_ANKLE_MOST = 0.9
"""Radians in any direction, of a foot in the air."""
_CROSSES = 0.42
"""Share of the leg's length by which an ankle in the air may be on the inside of its hip, before it is held back."""
_HEEL_STAYS = -0.6
"""Radians, toes up: the heel comes off the ground beyond."""
_TOE_LIMIT = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class LowerBody:
    """Pelvis and legs at some times."""

    root_position: Float[np.ndarray, "times 3"]
    """World metres, of the pelvis."""
    root_rotation: Float[np.ndarray, "times 3 3"]
    """R_world_from_root."""
    leg_rotations: Float[np.ndarray, "times 24 3 3"]
    """R_parent_from_joint of hips, knees, ankles, toes; the identity elsewhere."""
    contact: Bool[np.ndarray, "times 2"]
    """Whether the left, the right foot is planted: its toe joint does not move."""
    stride_phase: Float[np.ndarray, " times"]
    """Radians, rising without jumps: a multiple of 2 pi where the left foot lands, pi more where the right one does."""
    speed: Float[np.ndarray, " times"]
    """m/s of the pelvis over the ground."""


def lower_body(
    figure: Figure,
    plan: Plan,
    demand_of: Callable[[Float[np.ndarray, " times"]], HipDemand],
    times: Float[np.ndarray, " times"],
) -> LowerBody:
    """Pelvis and legs at any times; what comes back for one time does not depend on the others.

    Before and after the plan the body stands as at its ends. `demand_of` is asked once, at times of its own.
    """
    build = feet.Build.of(figure)
    course = pelvis.course_of(plan, demand_of, build.scale)
    stances = footsteps.march(course.ground(), build.scale)
    course = course.with_phase(pelvis.stride_phase(stances, course.times))
    on_grid = course.at(course.times)
    standing = figure.translations[0, 1]
    hips = [figure.translations[leg[0]] for leg in _LEGS]
    ends = [feet.StanceEnds.of(build, foot, stances[foot], course) for foot in (0, 1)]
    excess = np.zeros(len(course.times))
    root = pelvis.wanted_position(on_grid, standing, build.scale)
    R_root = pelvis.rotation(on_grid)
    for foot in (0, 1):
        pose = feet.pose(build, foot, stances[foot], ends[foot], on_grid)
        reach = limb.reach(*_bones(figure, foot), limb.KNEE_AT_REST)[1]
        excess = np.maximum(excess, pelvis.excess_height(root, R_root @ hips[foot], pose, reach))
    course = course.with_excess(pelvis.smooth_excess(excess))

    moment = course.at(times)
    root = pelvis.wanted_position(moment, standing, build.scale)
    root[:, 2] -= moment.excess
    R_root = pelvis.rotation(moment)
    leg_rotations = np.tile(np.eye(3), (len(times), 24, 1, 1))
    contact = np.zeros((len(times), 2), dtype=bool)
    for foot, leg in enumerate(_LEGS):
        pose = feet.pose(build, foot, stances[foot], ends[foot], moment)
        contact[:, foot] = pose.planted
        leg_rotations[:, leg] = _leg(figure, foot, root, R_root, pose)
    return LowerBody(
        root_position=root,
        root_rotation=R_root,
        leg_rotations=leg_rotations,
        contact=contact,
        stride_phase=moment.phase,
        speed=np.hypot(moment.velocity[:, 0], moment.velocity[:, 1]),
    )


def _bones(figure: Figure, foot: int) -> tuple[np.ndarray, np.ndarray]:
    return figure.translations[_LEGS[foot][1]], figure.translations[_LEGS[foot][2]]


def _leg(figure: Figure, foot: int, root: np.ndarray, R_root: np.ndarray, pose: feet.FootPose) -> np.ndarray:
    """Rotations (times, 4, 3, 3) of hip, knee, ankle and toe."""
    upper, lower = _bones(figure, foot)
    hip = root + R_root @ figure.translations[_LEGS[foot][0]]
    way = pose.ankle - hip
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    # A foot in the air yields smoothly where the leg is too short; a planted one is in reach by the pelvis' height.
    longest = limb.reach(upper, lower, limb.KNEE_AT_REST)[1]
    room = (1.0 - pelvis.STRETCH) * longest
    over = np.maximum(distance - (longest - room), 0.0)
    shorter = np.where(over > 0, longest - room + room * np.tanh(over / room), distance)
    way = way * shorter / np.maximum(distance, 1e-9)
    # Nor does a leg in the air cross the other one by more than a hip allows.
    outward = R_root[:, :, 0] * (1.0 if foot == 0 else -1.0)
    inside = np.maximum(-np.sum(way * outward, axis=-1) / longest - _CROSSES, 0.0)
    way = way + longest * (pose.away * (inside - 0.1 * np.tanh(inside / 0.1)))[:, None] * outward
    target = np.where(pose.planted[:, None], pose.ankle, hip + way)
    forward = R_root[:, :, 2] * [1.0, 1.0, 0.0]
    pole = pose.forward + 0.7 * forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    R_hip, R_knee, _ = limb.two_bone(hip, R_root, upper, lower, target, pole, limb.KNEE_AT_REST)
    R_ankle = np.swapaxes(R_root @ R_hip @ R_knee, -1, -2) @ pose.R_world_from_foot
    # Where the shin leans too far over the foot, the heel comes up about the toe joint.
    raised = 1.1 * np.maximum(_HEEL_STAYS - _point(R_ankle), 0.0)
    some = raised > 0.0
    if some.any():
        toe = figure.translations[_LEGS[foot][3]]
        R_foot = pose.R_world_from_foot[some] @ rotations.about(0, raised[some])
        target = target[some] + pose.R_world_from_foot[some] @ toe - R_foot @ toe
        again = limb.two_bone(hip[some], R_root[some], upper, lower, target, pole[some], limb.KNEE_AT_REST)
        R_hip[some], R_knee[some] = again[0], again[1]
        R_ankle[some] = np.swapaxes(R_root[some] @ again[0] @ again[1], -1, -2) @ R_foot
    point = _point(R_ankle)
    turn = np.where(pose.planted, 0.0, np.clip(point, *_ANKLE_LIMITS) - point)
    R_ankle = R_ankle @ rotations.about(0, turn)
    # A foot in the air follows its shin where an ankle could not turn as far.
    bend = rotations.to_axis_angle(R_ankle)
    size = np.linalg.norm(bend, axis=-1)
    far = ~pose.planted & (size > _ANKLE_MOST)
    if far.any():
        R_ankle[far] = rotations.from_axis_angle(bend[far] * (_ANKLE_MOST / size[far])[:, None])
    R_toe = rotations.about(0, -np.clip(pose.pitch + raised, 0.0, _TOE_LIMIT) * pose.toe_bend)
    return np.stack([R_hip, R_knee, R_ankle, R_toe], axis=1)


def _point(R_ankle: np.ndarray) -> np.ndarray:
    """Radians that the toes point down."""
    return np.arctan2(-R_ankle[:, 1, 2], R_ankle[:, 2, 2])
