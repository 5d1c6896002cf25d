"""Bodies' shapes in space from another program, laid beside the points that were found in the pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pgm_data.convert.smpl_npz import SkeletonShapes, read_skeleton_shapes
from pgm_data.lift.players.joint_sets import at_places
from pgm_data.people import PlayerPoses


def with_shapes(poses: PlayerPoses, path: Path) -> PlayerPoses:
    """The poses with the shapes that the file gives in place of a network's guesses.

    A network that looks at a crop sees in the axes of a camera that looks at the crop's middle, as `points_ray` has it.

    Raises:
        ValueError: If the file holds no such shapes, players that the scene has not, or frames that the clip has not;
            or there are no points that a shape could be registered to.
    """
    shapes = read_skeleton_shapes(path)
    if not poses.point_names:
        raise ValueError(f"{path}: expected body points in the pictures to register to, got none: see `pgm weights`")
    frames = len(poses.points_px)
    if len(shapes.frame) and shapes.frame[-1] >= frames:
        raise ValueError(f"{path}: frame_index: expected frames 0 to {frames - 1}, got {int(shapes.frame[-1])}")
    points = np.full_like(poses.points_ray, np.nan)
    placed = at_places(shapes.joints_cam, source=shapes.joint_set, places=poses.point_names)
    points[shapes.frame[:, None], np.array(_columns(shapes, poses, path))] = placed
    return replace(poses, points_ray=points)


def _columns(shapes: SkeletonShapes, poses: PlayerPoses, path: Path) -> list[int]:
    """The player object of each body of the file: by its name, else by its place."""
    if shapes.players == ("",):
        if len(poses.names) > 1:
            raise ValueError(f"{path}: player: expected a name among {', '.join(poses.names)}, got none")
        return [0]
    stray = [name for name in shapes.players if name not in poses.names]
    if stray:
        raise ValueError(f"{path}: player: expected names among {', '.join(poses.names)}, got {stray[0]!r}")
    return [poses.names.index(name) for name in shapes.players]
