"""Generated play brought onto what feet and balls can do: standing feet rest, and balls fly as gravity and air have it.

A model's states are near such play and not on it. What it was given stays to the bit; how far the rest was moved is
said. Feet need flat ground, which scenes with a court have; a ball needs the scene's ball and court.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton, world_joints
from pgm_models.animation.player_motion import PlayerMotion
from pgm_models.animation.settle_ball import BallPath, settled_ball
from pgm_models.animation.settle_feet import settled_feet

MOTION = ("root_position", "root_rotation", "joint_rotations", "joint_translations")


@dataclass(frozen=True, eq=False, kw_only=True)
class Settled:
    """Play as it is written, and what was done to it."""

    columns: dict[str, Float[np.ndarray, "frames _"]]
    """Of the contract, in its units."""
    notes: tuple[str, ...]
    """How far players and ball were moved, a line each."""


def settled(
    columns: Mapping[str, Float[np.ndarray, "frames _"]],
    known: Mapping[str, Bool[np.ndarray, " frames"]],
    times: Float[np.ndarray, " frames"],
    scene: Scene,
) -> Settled:
    """The play with feet that stand and a ball that flies.

    Args:
        columns: As `encode.decode` gives them, of one sequence.
        known: By column in which frames it was given; columns that are missing were given nowhere.
        times: Of the frames, s, rising.
        scene: With flat ground where it has a court.
    """
    made, notes = dict(columns), []
    nowhere = np.zeros(len(times), dtype=bool)
    for player in scene.players:
        names = [f"{player.name}.{part}" for part in MOTION]
        if player.skeleton is None or not all(name in made for name in names):
            continue
        floor = player.region_m[0][2] if player.region_m and scene.court is not None else None
        notes += _settle_player(made, player.name, player.skeleton, floor, known, times)
    if scene.ball is not None and scene.court is not None and {"ball.position", "ball.velocity"} <= set(made):
        roots = [made.get(f"{player.name}.root_position") for player in scene.players]
        there = [root for root in roots if root is not None]
        path = BallPath(
            position=np.asarray(made["ball.position"], dtype=np.float64),
            velocity=np.asarray(made["ball.velocity"], dtype=np.float64),
            known_position=known.get("ball.position", nowhere),
            known_velocity=known.get("ball.velocity", nowhere),
            times=times,
            roots=np.stack(there, axis=1) if there else np.zeros((len(times), 0, 3)),
        )
        ball = settled_ball(path, scene)
        made |= {"ball.position": ball.position, "ball.velocity": ball.velocity}
        left = int((ball.status == "left").sum())
        notes.append(
            f"ball: moved {_centimetres(ball.moved_m)}; {len(ball.contact_time)} contacts"
            + (f"; {left} of {len(times)} frames as they were made, since no flight fits" if left else "")
        )
    return Settled(columns=made, notes=tuple(notes))


def settled_windows(
    columns: Mapping[str, Float[np.ndarray, "B T _"]],
    known: Mapping[str, Bool[np.ndarray, "B T"]],
    rate: Float[np.ndarray, " B"],
    scene: Scene,
) -> dict[str, Float[np.ndarray, "B T _"]]:
    """Windows that are settled each by itself; arguments as of `settled`, and frames a second."""
    made = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    for window in range(len(rate)):
        own = {name: values[window] for name, values in columns.items()}
        given = {name: flags[window] for name, flags in known.items()}
        times = np.arange(next(iter(own.values())).shape[0]) / float(rate[window])
        for name, values in settled(own, given, times, scene).columns.items():
            made[name][window] = values
    return made


def _settle_player(
    made: dict[str, np.ndarray],
    name: str,
    skeleton: Skeleton,
    floor: float | None,
    known: Mapping[str, Bool[np.ndarray, " frames"]],
    times: Float[np.ndarray, " frames"],
) -> list[str]:
    """Put the settled motion of one player in the place of what was made; what was done, a line or none."""
    frames, nowhere = len(times), np.zeros(len(times), dtype=bool)
    motion = PlayerMotion(
        times=times,
        root_position=made[f"{name}.root_position"],
        root_rotation=made[f"{name}.root_rotation"],
        joint_rotations=made[f"{name}.joint_rotations"].reshape(frames, -1, 3),
        joint_translations=made[f"{name}.joint_translations"].reshape(frames, -1, 3),
        known_position=known.get(f"{name}.root_position", nowhere),
        known_rotation=known.get(f"{name}.root_rotation", nowhere),
        known_joints=known.get(f"{name}.joint_rotations", nowhere),
    )
    moved, report = settled_feet(motion, skeleton, floor)
    if report.left_because:
        return []
    rotations = moved.joint_rotations.copy()
    rotations[:, 0] = moved.root_rotation
    bones = np.array(np.broadcast_to(moved.joint_translations, rotations.shape))
    bones[:, 0] = moved.root_position
    made |= {
        f"{name}.root_position": moved.root_position,
        f"{name}.root_rotation": moved.root_rotation,
        f"{name}.joint_rotations": rotations.reshape(frames, -1),
        f"{name}.joint_translations": bones.reshape(frames, -1),
        f"{name}.joints": world_joints(skeleton.parents, rotations, bones).reshape(frames, -1),
    }
    said = f"{name}: root moved {_centimetres(report.root_moved_m)}; {len(report.stances)} stances"
    return [said + (f", {len(report.given_up)} given up" if report.given_up else "")]


def _centimetres(moved_m: Float[np.ndarray, " frames"]) -> str:
    return f"{100 * float(np.median(moved_m)):.1f} cm (median), {100 * float(moved_m.max()):.1f} cm (most)"
