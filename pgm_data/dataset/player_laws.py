"""What the table of players holds to: a skeleton that moves as its rotations say, feet, boxes, and a person's speed."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import (
    Columns,
    Context,
    covariance_faults,
    missing_faults,
    rows_fault,
    share_faults,
    there_faults,
    torn_faults,
)
from pgm_data.dataset.play_laws import DEVIATIONS
from pgm_data.scene import SceneObject
from pgm_data.skeleton import world_joints

SAME_M = 1e-3
"""Metres by which two columns may differ that say the same; float32 at 20 m keeps 2e-6."""
SAME_RAD = 1e-3
ROWS_AT_ONCE = 4096
BELOW_GROUND_M = 0.10
"""How far a joint of an estimated body may lie below the ground, beside what its own uncertainty allows."""
OUTSIDE_M = 5.0
"""How far a player may leave the region that the scene gives to the object."""
BONE_M, BONE_SHARE = 0.02, 0.1
"""Metres, and the share of its length, by which a bone may differ from its usual length in the clip."""


POSE = ("joints", "joint_rotations", "joint_translations")


def players_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the players table beyond its keys."""
    for player in context.scene.players if context.scene is not None else ():
        prefix = f"{player.name}."
        own = {name: values for name, values in columns.items() if name.startswith(prefix)}
        if f"{prefix}status" in own:
            # Who plays, how the person is built and what the picture shows are known without a place in the world too.
            flat = ("identity", "status", "betas", "box_px", "keypoints_px", "keypoint_score")
            kept = {f"{prefix}{name}" for name in flat}
            names = [name for name in own if name not in kept]
            status = own[f"{prefix}status"]
            yield from missing_faults(own, names, status, f"{prefix}status")
            yield from there_faults(own, [f"{prefix}root_position"], status, f"{prefix}status")
        whole = ("box_px", "root_position", "root_rotation", *POSE)
        yield from torn_faults(own, [f"{prefix}{name}" for name in whole])
        yield from torn_faults(own, [f"{prefix}keypoints_px"], 2)
        if f"{prefix}box_px" in own:
            box = own[f"{prefix}box_px"]
            inside_out = (box[:, 2] <= box[:, 0]) | (box[:, 3] <= box[:, 1])
            yield from rows_fault(f"{prefix}box_px", inside_out, "x0 < x1 and y0 < y1", box)
        yield from share_faults(own, (f"{prefix}contact",))
        yield from covariance_faults(own, f"{prefix}root_cov")
        if f"{prefix}reprojection_px" in own:
            values = own[f"{prefix}reprojection_px"]
            yield from rows_fault(f"{prefix}reprojection_px", values < 0, "at least 0", values)
        yield from _root_faults(own, prefix)
        yield from _skeleton_faults(own, player)
        yield from _bone_faults(own, player)
        yield from _place_faults(own, player)


def _deviation(own: Columns, prefix: str, axes: tuple[int, ...], rows: int) -> np.ndarray:
    """Standard deviation of the root along the axes together; 0 where nobody says."""
    cov = own.get(f"{prefix}root_cov")
    if cov is None:
        return np.zeros(rows)
    return np.sqrt(np.nan_to_num(cov[:, list(axes)].astype(np.float64)).clip(0.0).sum(axis=1))


def _place_faults(own: Columns, player: SceneObject) -> Iterator[Fault]:
    """Joints below the ground, and roots far from where the scene has the object."""
    if not player.region_m:
        return
    prefix = f"{player.name}."
    low, high = (np.array(corner) for corner in player.region_m)
    if f"{prefix}joints" in own:
        joints = own[f"{prefix}joints"]
        lowest = joints[:, 2::3].min(axis=1, initial=np.inf)
        floor = low[2] - BELOW_GROUND_M - DEVIATIONS * _deviation(own, prefix, (5,), len(joints))
        expected = f"joints at {low[2] - BELOW_GROUND_M:g} m or higher, but for {DEVIATIONS:g} deviations of the root"
        yield from rows_fault(f"{prefix}joints", lowest < floor, expected, lowest)
    if f"{prefix}root_position" in own:
        root = own[f"{prefix}root_position"]
        slack = (OUTSIDE_M + DEVIATIONS * _deviation(own, prefix, (0, 3, 5), len(root)))[:, None]
        outside = ((root < low - slack) | (root > high + slack)).any(axis=1)
        expected = f"a place within {OUTSIDE_M:g} m of the region from {low.tolist()} to {high.tolist()}"
        yield from rows_fault(f"{prefix}root_position", outside, expected, root)


def _bone_faults(own: Columns, player: SceneObject) -> Iterator[Fault]:
    """Bones that are longer or shorter than the same person's are in most of the clip."""
    name = f"{player.name}.joint_translations"
    if name not in own or player.skeleton is None or own[name].shape[1] < 6:
        return
    length = np.linalg.norm(own[name].reshape(len(own[name]), own[name].shape[1] // 3, 3)[:, 1:], axis=-1)
    known = np.isfinite(length).all(axis=1)
    person = own.get(f"{player.name}.identity", np.zeros(len(known), dtype=object))
    off = np.zeros(length.shape)
    for who in set(person[known].tolist()):
        rows = np.flatnonzero(known & (person == who))
        usual = np.median(length[rows], axis=0)
        off[rows] = np.abs(length[rows] - usual) - (BONE_M + BONE_SHARE * usual)
    bones = player.skeleton.joint_names[1:]

    def shown(row: int) -> str:
        worst = int(np.argmax(off[row]))
        return f"{length[row, worst]:.3g} m at {bones[worst]}"

    expected = f"bones within {BONE_M:g} m and {BONE_SHARE:.0%} of their median length in the clip"
    yield from rows_fault(name, (off > 0).any(axis=1), expected, shown)


def _root_faults(own: Columns, prefix: str) -> Iterator[Fault]:
    """Entries 0 that do not repeat the root."""
    for name, root, allowed in (
        ("joints", "root_position", SAME_M),
        ("joint_translations", "root_position", SAME_M),
        ("joint_rotations", "root_rotation", SAME_RAD),
    ):
        if f"{prefix}{name}" in own and f"{prefix}{root}" in own:
            first, value = own[f"{prefix}{name}"][:, :3], own[f"{prefix}{root}"]
            apart = np.abs(first - value).max(axis=1, initial=0.0) > allowed
            yield from rows_fault(f"{prefix}{name}", apart, f"entry 0 to repeat {prefix}{root}", first)


def _skeleton_faults(own: Columns, player: SceneObject) -> Iterator[Fault]:
    """Joints that are not where the row's own rotations and translations lead."""
    names = [f"{player.name}.{name}" for name in ("joints", "joint_rotations", "joint_translations")]
    if player.skeleton is None or not all(name in own for name in names):
        return
    joints, rotations, translations = (own[name].reshape(len(own[name]), -1, 3) for name in names)
    apart = np.zeros(len(joints))
    for start in range(0, len(joints), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        led = world_joints(player.skeleton.parents, rotations[rows].astype(float), translations[rows].astype(float))
        apart[rows] = np.linalg.norm(led - joints[rows], axis=-1).max(axis=1)

    def shown(row: int) -> str:
        return f"{apart[row]:.3g} m away"

    expected = f"joints within {SAME_M:g} m of where the rotations and translations lead"
    yield from rows_fault(names[0], apart > SAME_M, expected, shown)
