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
)
from pgm_data.scene import SceneObject
from pgm_data.skeleton import world_joints

SAME_M = 1e-3
"""Metres by which two columns may differ that say the same; float32 at 20 m keeps 2e-6."""
SAME_RAD = 1e-3
ROWS_AT_ONCE = 4096


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
            yield from missing_faults(own, names, own[f"{prefix}status"], f"{prefix}status")
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
