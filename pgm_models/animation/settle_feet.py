"""Feet that stand: a projection of one player's motion to one whose standing feet rest and stay above the ground.

Stances are found in the motion as it is (`foot_stances`), each gets one place on the ground, a smooth correction of
the root goes half of the way to meet them, and the legs bend to do the rest (`leg_reach`). Arms and trunk stay as they
are, and so does to the bit what is known. The ground is flat.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solveh_banded

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.skeleton import Skeleton
from pgm_models.animation.foot_places import Footing, planted, sole_in_ankle
from pgm_models.animation.foot_stances import ERRING_M, Stance, StanceOptions, height_error, kept_up, runs, stances
from pgm_models.animation.leg_reach import LEAST_BEND, Leg, bent, hinge_of, legs_of
from pgm_models.animation.player_motion import Body, PlayerMotion, body_of

HELD = 1e8
"""Weight of a correction that must be none."""
SAME = 1e-9
"""Metres or radians under which a pose is left as it is."""
TOUCH_SPEED = 0.6
"""Soles faster than this do not touch the ground where heights err, m/s; certainly not at twice the speed."""


@dataclass(frozen=True, kw_only=True)
class SettleOptions:
    """How feet are settled.

    Raises:
        ValueError: If a number is out of range.
    """

    stance: StanceOptions = field(default_factory=StanceOptions)
    root_hz: float = 1.5
    """Corrections of the root are slower than this."""
    root_pull: float = 0.5
    """Weight of no correction of the root in the plane, against 1 of each standing foot: the legs take the rest."""
    leg_hz: float = 3.0
    """Corrections of a swinging foot are slower than this."""
    leg_pull: float = 0.05
    """Weight of no correction of a swinging foot."""
    level_m: float = 0.01
    """Heels or toes of a standing foot lower than this, and what the heights err, are put on the ground."""
    clearance_m: float = 0.035
    """Height of a sole in the middle of a swing at least."""
    given_up_m: float = 0.03
    """Frames of a stance whose place the leg misses by more are given up."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in ("root_hz", "leg_hz", "root_pull", "leg_pull", "level_m", "given_up_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"SettleOptions.{name}: expected more than 0, got {getattr(self, name)}")
        if not self.clearance_m >= 0:
            raise ValueError(f"SettleOptions.clearance_m: expected at least 0, got {self.clearance_m}")


@dataclass(frozen=True, eq=False, kw_only=True)
class SettleReport:
    """What was done to a motion."""

    stances: tuple[Stance, ...]
    """In which feet rest now."""
    given_up: tuple[Stance, ...]
    """Stances, or ends of some, that the legs could not keep."""
    root_moved_m: Float[np.ndarray, " frames"]
    joints_moved_m: Float[np.ndarray, "frames joints"]
    """In the world."""
    kept: Bool[np.ndarray, " frames"]
    """Frames left as they were, to the bit."""
    below_m: float
    """How deep the lowest point of a sole is below the ground now; 0 where none is."""
    left_because: str
    """Why nothing was done; empty where something was."""


def settled_feet(
    motion: PlayerMotion, skeleton: Skeleton, floor_z: float | None, options: SettleOptions | None = None
) -> tuple[PlayerMotion, SettleReport]:
    """The motion with feet that rest where they stand and are nowhere in the ground, and what was done.

    Where joints are known, only the root moves; where the root is known, only legs; where both are, nothing does, and
    feet that stand then say where the stance rests. Bones and rotations of root, trunk and arms are kept. Soles stay
    below the ground only where known values put them there.

    Args:
        motion: Of one player.
        skeleton: Its skeleton.
        floor_z: Height of the flat ground, world metres; None where it is uneven or not known: nothing is done.
        options: How.

    Raises:
        ValueError: If the motion's joints are not the skeleton's.
    """
    options = SettleOptions() if options is None else options
    if motion.joint_rotations.shape[1] != len(skeleton.parents):
        got = motion.joint_rotations.shape[1]
        raise ValueError(f"joint_rotations: expected {len(skeleton.parents)} joints of {skeleton.name}, got {got}")
    legs = legs_of(skeleton)
    if legs is None or floor_z is None or not len(motion.times):
        why = f"{skeleton.name} has no legs of hip, knee and ankle with soles of two points or more"
        why = why if legs is None else "the ground is not flat" if floor_z is None else "there are no frames"
        return motion, _nothing_done(motion, why)
    body = body_of(motion, skeleton)
    error = height_error(np.stack([body.soles(leg) for leg in legs]), motion.times, floor_z)
    standing = [
        stance
        for foot, leg in enumerate(legs)
        for stance in stances(body.soles(leg), motion.times, floor_z, error, options.stance, foot)
    ]
    given_up: list[Stance] = []
    settler = _Settler(body=body, legs=legs, floor_z=floor_z, error_m=error, options=options)
    for _ in range(3):
        moved, missed = settler.settled(standing)
        still, dropped = kept_up(standing, missed > options.given_up_m)
        if not dropped:
            break
        given_up += dropped
        standing = still
    else:
        moved, _ = settler.settled(standing)
    return moved, _report(body, moved, legs, floor_z, standing, given_up)


def _nothing_done(motion: PlayerMotion, why: str) -> SettleReport:
    frames, joints = motion.joint_rotations.shape[:2]
    return SettleReport(
        stances=(),
        given_up=(),
        root_moved_m=np.zeros(frames),
        joints_moved_m=np.zeros((frames, joints)),
        kept=np.ones(frames, dtype=bool),
        below_m=0.0,
        left_because=why,
    )


def _report(
    body: Body,
    moved: PlayerMotion,
    legs: Sequence[Leg],
    floor_z: float,
    standing: Sequence[Stance],
    given_up: Sequence[Stance],
) -> SettleReport:
    after = body_of(moved, body.skeleton)
    lowest = min(float(after.soles(leg)[..., 2].min()) for leg in legs)
    same = (moved.root_position == body.motion.root_position).all(axis=1)
    same &= (moved.joint_rotations == body.motion.joint_rotations).all(axis=(1, 2))
    return SettleReport(
        stances=tuple(standing),
        given_up=tuple(given_up),
        root_moved_m=np.linalg.norm(moved.root_position - body.motion.root_position, axis=1),
        joints_moved_m=np.linalg.norm(after.joints - body.joints, axis=-1),
        kept=np.asarray(same),
        below_m=max(0.0, floor_z - lowest),
        left_because="",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Settler:
    """Puts feet where they stand."""

    body: Body
    legs: tuple[Leg, Leg]
    floor_z: float
    error_m: float
    """Of heights."""
    options: SettleOptions

    def settled(self, standing: Sequence[Stance]) -> tuple[PlayerMotion, Float[np.ndarray, "frames feet"]]:
        """The motion with those stances, and by how far standing ankles miss their places, metres."""
        body, motion = self.body, self.body.motion
        footings, stands = self._footings(standing)
        root = self._root(footings, stands)
        position = motion.root_position + root
        local = body.local.copy()
        missed = np.zeros((len(motion.times), 2))
        for foot, leg in enumerate(self.legs):
            footing = self._swung(leg, footings[foot], stands[:, foot], root)
            missed[:, foot] = np.where(stands[:, foot], self._bend(leg, footing, root, local), 0.0)
        missed[motion.known_joints] = 0.0
        rotations = np.asarray(motion.joint_rotations, np.float64).copy()
        rotations[:, 1:] = local[:, 1:]
        return self._raised(replace(motion, root_position=position, joint_rotations=rotations)), missed

    def _footings(self, standing: Sequence[Stance]) -> tuple[list[Footing], Bool[np.ndarray, "frames feet"]]:
        """Where each foot rests in its stances, and where it is as the motion has it; and whether it stands."""
        body, motion = self.body, self.body.motion
        footings, stands = [], np.zeros((len(motion.times), 2), dtype=bool)
        for foot, leg in enumerate(self.legs):
            now = Footing(
                ankle=body.joints[:, leg.ankle].copy(),
                R=body.R[:, leg.ankle].copy(),
                toes=body.local[:, list(leg.foot)].copy(),
            )
            for stance in standing:
                if stance.foot == foot:
                    rows = stance.frames
                    rest = planted(body, leg, rows, self.floor_z, self.options.level_m + 1.5 * self.error_m)
                    now.ankle[rows], now.R[rows], now.toes[rows] = rest.ankle, rest.R, rest.toes
                    stands[rows, foot] = True
            footings.append(now)
        return footings, stands

    def _root(
        self, footings: Sequence[Footing], stands: Bool[np.ndarray, "frames feet"]
    ) -> Float[np.ndarray, "frames 3"]:
        """Smooth correction of the root that meets the standing feet half of the way, and all of it out of reach."""
        body, motion = self.body, self.body.motion
        wanted = np.stack([f.ankle - body.joints[:, leg.ankle] for f, leg in zip(footings, self.legs, strict=True)], 1)
        weight = stands.astype(np.float64)
        total, summed = weight.sum(axis=1), (weight[..., None] * wanted).sum(axis=1)
        pull = np.array([self.options.root_pull] * 2 + [0.02])
        # A body whose legs are given has only its root to get its soles out of the ground.
        lowest = np.min([body.soles(leg)[..., 2].min(axis=1) for leg in self.legs], axis=0)
        sunk = motion.known_joints & (lowest < self.floor_z) & (total == 0)
        total, summed[:, 2] = total + sunk, summed[:, 2] + np.where(sunk, self.floor_z - lowest, 0.0)
        total[motion.known_position], summed[motion.known_position] = HELD, 0.0
        root = _eased(summed, total, motion.times, self.options.root_hz, pull)
        for _ in range(3):
            total_far, summed_far = total.copy(), summed.copy()
            for foot, leg in enumerate(self.legs):
                away = footings[foot].ankle - (body.joints[:, leg.hip] + root)
                reach, far = hinge_of(leg, *_bones(body, leg)[1:]).longest, np.linalg.norm(away, axis=1)
                over = np.maximum(far - reach, 0.0) / np.maximum(far, 1e-9)
                heavy = np.where(
                    stands[:, foot] & (over > 0) & ~motion.known_position & ~motion.known_joints, 10.0, 0.0
                )
                total_far += heavy
                summed_far += heavy[:, None] * (root + over[:, None] * away)
            if (total_far == total).all():
                break
            root = _eased(summed_far, total_far, motion.times, self.options.root_hz, pull)
        root[motion.known_position] = 0.0
        return root

    def _swung(
        self, leg: Leg, footing: Footing, stands: Bool[np.ndarray, " frames"], root: Float[np.ndarray, "frames 3"]
    ) -> Footing:
        """Where the foot goes: at rest where it stands, led over from one rest to the next, and over the ground."""
        body, motion, options = self.body, self.body.motion, self.options
        free = body.joints[:, leg.ankle] + root
        R_free, toes_free = body.R[:, leg.ankle], body.local[:, list(leg.foot)]
        turn = rotvec_from_rotation(footing.R @ np.swapaxes(R_free, 1, 2))
        parts = [footing.ankle - free, turn, (footing.toes - toes_free).reshape(len(free), -1)]
        off = np.concatenate(parts, axis=1)
        weight = np.where(motion.known_joints, HELD, stands.astype(np.float64))
        values = np.where((stands & ~motion.known_joints)[:, None], off, 0.0)
        eased = _eased(
            weight[:, None] * values, weight, motion.times, options.leg_hz, np.full(off.shape[1], options.leg_pull)
        )
        eased = np.where(stands[:, None], off, eased)
        ankle = free + eased[:, :3]
        R = rotation_from_rotvec(eased[:, 3:6]) @ R_free
        toes = toes_free + eased[:, 6:].reshape(toes_free.shape)
        lowest = ankle[:, 2] + (R @ np.swapaxes(sole_in_ankle(body, leg, toes), 1, 2))[:, 2].min(axis=1)
        low = _clearance(stands, motion.times, options.clearance_m)
        low = np.maximum(low, self._hurried(stands, ankle))
        ankle[:, 2] += np.where(stands, 0.0, np.maximum(self.floor_z + low - lowest, 0.0))
        return Footing(ankle=ankle, R=R, toes=toes)

    def _hurried(
        self, stands: Bool[np.ndarray, " frames"], ankle: Float[np.ndarray, "frames 3"]
    ) -> Float[np.ndarray, " frames"]:
        """Least height of a sole that moves fast, where heights err: at such speed it cannot touch the ground."""
        times = self.body.motion.times
        if len(times) < 2 or not stands.any():
            return np.zeros(len(times))
        speed = np.linalg.norm(np.diff(ankle[:, :2], axis=0), axis=1) / np.diff(times)
        most = np.maximum(np.append(speed, 0.0), np.insert(speed, 0, 0.0))
        share = np.clip((most - TOUCH_SPEED) / TOUCH_SPEED, 0.0, 1.0) * min(1.0, self.error_m / ERRING_M)
        return np.where(stands, 0.0, self.options.clearance_m * share)

    def _bend(
        self,
        leg: Leg,
        footing: Footing,
        root: Float[np.ndarray, "frames 3"],
        local: Float[np.ndarray, "frames joints 3"],
    ) -> Float[np.ndarray, " frames"]:
        """Writes the leg's rotations that bring the foot there into `local`; how far off it stays, metres."""
        body = self.body
        hip, knee, thigh, shin = _bones(body, leg)
        to_ankle = footing.ankle - (body.joints[:, leg.hip] + root)
        law = hinge_of(leg, knee, thigh, shin)
        same = np.linalg.norm(footing.ankle - body.joints[:, leg.ankle] - root, axis=1) < SAME
        same &= np.abs(footing.R - body.R[:, leg.ankle]).max(axis=(1, 2)) < SAME
        same &= (footing.toes == body.local[:, list(leg.foot)]).all(axis=(1, 2))
        rows = ~(same & (-law.straight >= LEAST_BEND)) & ~body.motion.known_joints
        hip_new, knee_new = bent(leg, hip, knee, thigh, shin, to_ankle)
        shin_world = hip_new @ knee_new
        reached = ((hip_new @ thigh[..., None]) + (shin_world @ shin[..., None]))[..., 0]
        above = body.R[:, body.skeleton.parents[leg.hip]]
        turned = {
            leg.hip: np.swapaxes(above, 1, 2) @ hip_new,
            leg.knee: knee_new,
            leg.ankle: np.swapaxes(shin_world, 1, 2) @ footing.R,
        }
        for joint, R in turned.items():
            local[rows, joint] = rotvec_from_rotation(R[rows])
        for place, joint in enumerate(leg.foot):
            local[rows, joint] = footing.toes[rows, place]
        return np.linalg.norm(reached - to_ankle, axis=1)

    def _raised(self, moved: PlayerMotion) -> PlayerMotion:
        """The motion lifted out of the ground where legs alone could not do it."""
        body = body_of(moved, self.body.skeleton)
        lowest = np.min([body.soles(leg)[..., 2].min(axis=1) for leg in self.legs], axis=0)
        depth = np.where(moved.known_position, 0.0, np.maximum(self.floor_z - lowest, 0.0))
        depth = np.where(depth > 1e-6, depth, 0.0)
        position = moved.root_position.copy()
        position[:, 2] += depth
        bones = moved.joint_translations
        if bones.ndim == 3:
            bones = bones.copy()
            bones[:, 0] = position
        return replace(moved, root_position=position, joint_translations=bones)


def _bones(body: Body, leg: Leg) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """world_from_thigh, thigh_from_shin, and the bones of both."""
    return (
        body.R[:, leg.hip],
        rotation_from_rotvec(body.local[:, leg.knee]),
        body.bones[:, leg.knee],
        body.bones[:, leg.ankle],
    )


def _eased(
    summed: Float[np.ndarray, "frames n"],
    weight: Float[np.ndarray, " frames"],
    times: Float[np.ndarray, " frames"],
    cutoff_hz: float,
    pull: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "frames n"]:
    """Values near the weighted ones, smooth in time: least squares with second differences, and nothing far from both.

    Args:
        summed: Weights times values.
        weight: Of each frame.
        times: s.
        cutoff_hz: Faster changes are left out.
        pull: Weight of the value 0 in each frame, for each number.
    """
    frames = len(times)
    if frames < 2:
        return summed / (weight[:, None] + pull)
    step = np.gradient(times)
    band = np.zeros((3, frames))
    if frames > 2:
        a, b = np.diff(times)[:-1], np.diff(times)[1:]
        row = np.stack([2 / (a * (a + b)), -2 / (a * b), 2 / (b * (a + b))])
        strength = (2 * np.pi * cutoff_hz) ** -4 * (a + b) / 2
        for k in range(3):
            for other in range(k, 3):
                band[2 - (other - k), other : other + frames - 2] += strength * row[k] * row[other]
    out = np.empty_like(summed)
    for value in np.unique(pull):
        own = band.copy()
        own[2] += step * (weight + value)
        out[:, pull == value] = solveh_banded(own, step[:, None] * summed[:, pull == value])
    return out


def _clearance(
    stands: Bool[np.ndarray, " frames"], times: Float[np.ndarray, " frames"], most: float
) -> Float[np.ndarray, " frames"]:
    """Least height of a sole: rises and falls between two stances; 0 where it stands, or is never to stand again."""
    least = np.zeros(len(times))
    for first, last in runs(~stands):
        if first > 0 and last < len(times) - 1:
            begin, end = times[first - 1], times[last + 1]
            rows = slice(first, last + 1)
            least[rows] = most * np.sin(np.pi * (times[rows] - begin) / (end - begin))
    return least
