"""What a clip's cameras hold to: geometry, time, uncertainty, and no value without a camera."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import (
    LATEST_S,
    Columns,
    Context,
    covariance_faults,
    missing_faults,
    per_row,
    rows_fault,
    time_faults,
)

FOCAL_PX = (50.0, 100_000.0)
"""Focal lengths outside of this are a mistake, pixels."""
FARTHEST_M = 1000.0
"""No camera is farther from the world's origin, metres."""
DISTORTION_LIMITS = (1e6, 1e12, 1e3, 1e3)
"""Largest k1, k2, p1, p2. Counted in focal lengths: at 100,000 px, k1 of an ordinary lens reaches thousands."""

CAPTURE_S = 1.0
"""Seconds by which the moment a picture was taken may wander against the moment it is shown."""

POSE = ("camera.K", "camera.distortion", "camera.R_cam_from_world", "camera.t_cam_from_world")
UNCERTAINTY = ("camera.position_cov", "camera.focal_std_px")
OURS = ("draft", "standard", "best")
"""Presets of our own solver, which owes every camera its uncertainty and its support."""


def camera_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the camera table beyond its keys."""
    yield from capture_time_faults(columns)
    if "camera.status" not in columns:
        return
    status = columns["camera.status"]
    present = status != "none"
    yield from missing_faults(columns, (*POSE, *UNCERTAINTY, "camera.reprojection_px"), status, "camera.status")
    for name in POSE:
        if name in columns:
            gap = present & ~np.isfinite(columns[name]).all(axis=1)
            yield from rows_fault(name, gap, "numbers, since camera.status is not none", columns[name])
    if "camera.reason" in columns:
        silent = ((status == "interpolated") | ~present) & (columns["camera.reason"] == "")
        yield from rows_fault("camera.reason", silent, "why camera.status is not measured", columns["camera.reason"])
    if context.quality in OURS:
        yield from _support_faults(columns, status)
    for name in ("camera.reprojection_px", "camera.focal_std_px"):
        if name in columns:
            yield from rows_fault(name, columns[name] < 0, "at least 0", columns[name])
    if "camera.inliers" in columns:
        yield from rows_fault("camera.inliers", columns["camera.inliers"] < 0, "at least 0", columns["camera.inliers"])
    yield from covariance_faults(columns, "camera.position_cov")
    if all(name in columns for name in POSE):
        complete = present & np.all([np.isfinite(columns[name]).all(axis=1) for name in POSE], axis=0)
        yield from geometry_faults(columns, complete, context)


def _support_faults(columns: Columns, status: np.ndarray) -> Iterator[Fault]:
    """Cameras of our own solver without uncertainty or support."""
    for name in UNCERTAINTY:
        if name in columns:
            gap = (status != "none") & ~np.isfinite(per_row(columns[name])).all(axis=1)
            yield from rows_fault(name, gap, "numbers, since camera.status is not none", columns[name])
    measured = status == "measured"
    if "camera.reprojection_px" in columns:
        values = columns["camera.reprojection_px"]
        yield from rows_fault(
            "camera.reprojection_px",
            measured & ~np.isfinite(values),
            "a number, since camera.status is measured",
            values,
        )
    if "camera.inliers" in columns:
        values = columns["camera.inliers"]
        yield from rows_fault(
            "camera.inliers", measured & (values < 1), "at least 1, since camera.status is measured", values
        )


def capture_time_faults(columns: Columns) -> Iterator[Fault]:
    """Capture times that are missing or go back, and repeats that do not carry their source's."""
    if "frame.capture_time" not in columns:
        return
    time = columns["frame.capture_time"]
    yield from time_faults("frame.capture_time", time)
    if len(time) and "timestamp" in columns and len(columns["timestamp"]) == len(time):
        early = columns["timestamp"] - time
        sane = np.abs(columns["timestamp"]) <= LATEST_S
        off = sane & (np.abs(early - np.median(early)) > CAPTURE_S)
        expected = f"as long before timestamp as in most frames, within {CAPTURE_S:g} s"
        yield from rows_fault("frame.capture_time", off, expected, early)
    if len(time) < 2:
        return
    later = np.concatenate([[True], time[1:] > time[:-1]])
    equal = np.concatenate([[True], time[1:] == time[:-1]])

    def shown(row: int) -> str:
        return f"{time[row]} after {time[row - 1]}"

    yield from rows_fault("frame.capture_time", ~later & ~equal, "at least that of the row before", shown)
    if "frame.is_duplicate" in columns:
        duplicate = columns["frame.is_duplicate"]
        yield from rows_fault(
            "frame.capture_time", duplicate & ~equal, "that of the row before, which it repeats", shown
        )
        yield from rows_fault(
            "frame.capture_time",
            ~duplicate & equal & ~later,
            "more than in the row before, which it does not repeat",
            shown,
        )


def geometry_faults(columns: Columns, complete: np.ndarray, context: Context) -> Iterator[Fault]:
    """Rotations, intrinsics and positions that no camera of the scene can have, among the complete rows."""
    with np.errstate(over="ignore", invalid="ignore"):
        K = columns["camera.K"].reshape(-1, 3, 3)
        R = columns["camera.R_cam_from_world"].reshape(-1, 3, 3)
        gram_error = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(1, 2))
        right_handed = np.einsum("ni,ni->n", np.cross(R[:, 0], R[:, 1]), R[:, 2]) > 0
        position = -(np.swapaxes(R, -1, -2) @ columns["camera.t_cam_from_world"][..., None])[..., 0]
        turned = complete & ~((gram_error <= 1e-6) & right_handed)
        far = complete & ~turned & ~(np.linalg.norm(position, axis=1) <= FARTHEST_M)
    yield from rows_fault(
        "camera.R_cam_from_world", turned, "a rotation: orthonormal, right-handed", columns["camera.R_cam_from_world"]
    )
    focal = K[:, [0, 1], [0, 1]]
    low, high = FOCAL_PX
    absurd = complete & ~((focal >= low) & (focal <= high)).all(axis=1)
    yield from rows_fault("camera.K", absurd, f"focal lengths of {low:g} to {high:g} px", focal)
    fixed = K[:, [0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] == [0, 0, 0, 0, 1]
    yield from rows_fault(
        "camera.K", complete & ~fixed.all(axis=1), "0 off its diagonal, 1 at its end", columns["camera.K"]
    )
    if context.size is not None:
        # A crop moves the principal point, but not out of the uncropped picture.
        middle = K[:, :2, 2] / np.array(context.size)
        out = complete & ~((middle > -2) & (middle < 3)).all(axis=1)
        yield from rows_fault(
            "camera.K",
            out,
            f"a principal point near the picture of {context.size[0]} x {context.size[1]} px",
            K[:, :2, 2],
        )
    wild = complete & ~(np.abs(columns["camera.distortion"]) <= DISTORTION_LIMITS).all(axis=1)
    yield from rows_fault("camera.distortion", wild, "terms of a lens", columns["camera.distortion"])
    yield from rows_fault("camera.t_cam_from_world", far, f"a camera within {FARTHEST_M:g} m of the origin", position)
    if context.scene is not None and context.scene.court is not None:
        below = complete & ~turned & ~far & ~(position[:, 2] > 0)
        yield from rows_fault("camera.t_cam_from_world", below, "a camera above the ground", position)
