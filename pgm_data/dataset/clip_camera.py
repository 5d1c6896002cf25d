"""A clip's camera track as one struct: what `camera.parquet` holds, read and written whole."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.dataset.tables import read_table, write_table
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene

STATUSES = ("measured", "interpolated", "none")


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipCamera:
    """One row per decoded frame of a clip, in order.

    Raises:
        ValueError: If the columns differ in length, or a frame with a camera holds NaN in it.
    """

    clip_id: str
    video_frame: Int[np.ndarray, " frames"]
    """Frame of the source video, from 0."""
    timestamp: Float[np.ndarray, " frames"]
    """The video's own presentation time, s."""
    is_duplicate: Bool[np.ndarray, " frames"]
    """Whether the picture repeats an earlier one."""
    capture_time: Float[np.ndarray, " frames"]
    """Estimated moment the picture was taken, s."""
    camera: Camera
    """One camera per frame; NaN where the status is `none`."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`, `interpolated` or `none`."""
    reason: Shaped[np.ndarray, " frames"]
    """Why the status is not `measured`; else empty."""
    inliers: Int[np.ndarray, " frames"]
    """Observations that support the camera."""
    reprojection_px: Float[np.ndarray, " frames"]
    """Rms of 2D distances of the inliers."""
    position_cov: Float[np.ndarray, "frames 6"]
    """Covariance of the camera's position (xx, xy, xz, yy, yz, zz), m^2."""
    focal_std_px: Float[np.ndarray, " frames"]
    """Standard deviation of the focal length."""

    def __post_init__(self) -> None:
        """Check the values."""
        rows = len(self.video_frame)
        for name in ("timestamp", "status", "reason", "inliers", "reprojection_px", "position_cov", "focal_std_px"):
            if len(getattr(self, name)) != rows:
                raise ValueError(f"{self.clip_id}: {name}: expected {rows} rows, got {len(getattr(self, name))}")
        if self.camera.K.shape[:-2] != (rows,):
            raise ValueError(f"{self.clip_id}: camera: expected {rows} cameras, got {self.camera.K.shape[:-2]}")
        stray = sorted(set(self.status) - set(STATUSES))
        if stray:
            raise ValueError(f"{self.clip_id}: camera.status: expected one of {', '.join(STATUSES)}, got {stray[0]!r}")
        for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world"):
            finite = np.isfinite(getattr(self.camera, name).reshape(rows, -1)).all(axis=1)
            bad = np.flatnonzero(self.has_camera & ~finite)
            if len(bad):
                place = f"{self.clip_id}: camera.{name}: frame {bad[0]}"
                raise ValueError(f"{place}: expected numbers, as its status is {self.status[bad[0]]}, got NaN")

    @property
    def has_camera(self) -> Bool[np.ndarray, " frames"]:
        """Whether each frame has a camera."""
        return np.asarray(self.status != "none", dtype=bool)


def read_clip_camera(folder: Path) -> ClipCamera:
    """The camera track in a clip's folder.

    Raises:
        ValueError: If its `camera.parquet` is missing, lacks a column, or is of another clip.
    """
    path = folder / "camera.parquet"
    columns = read_table(path)

    def column(name: str) -> np.ndarray:
        if name not in columns:
            raise ValueError(f"{path}: {name}: expected the column, got {', '.join(columns)}")
        return columns[name]

    clip_ids = sorted(set(column("clip_id")))
    if clip_ids not in ([], [folder.name]):
        raise ValueError(f"{path}: clip_id: expected {folder.name!r}, the folder's name, got {clip_ids}")
    camera = Camera(
        K=column("camera.K").reshape(-1, 3, 3),
        distortion=column("camera.distortion"),
        R_cam_from_world=column("camera.R_cam_from_world").reshape(-1, 3, 3),
        t_cam_from_world=column("camera.t_cam_from_world"),
    )
    return ClipCamera(
        clip_id=folder.name,
        video_frame=column("video_frame"),
        timestamp=column("timestamp"),
        is_duplicate=column("frame.is_duplicate"),
        capture_time=column("frame.capture_time"),
        camera=camera,
        status=column("camera.status"),
        reason=column("camera.reason"),
        inliers=column("camera.inliers"),
        reprojection_px=column("camera.reprojection_px"),
        position_cov=column("camera.position_cov"),
        focal_std_px=column("camera.focal_std_px"),
    )


def write_clip_camera(folder: Path, track: ClipCamera, *, scene: Scene) -> None:
    """Write the camera track as `camera.parquet` into the clip's folder."""
    rows = len(track.video_frame)
    columns = {
        "clip_id": [track.clip_id] * rows,
        "frame_index": np.arange(rows),
        "video_frame": track.video_frame,
        "timestamp": track.timestamp,
        "frame.is_duplicate": track.is_duplicate,
        "frame.capture_time": track.capture_time,
        "camera.K": track.camera.K,
        "camera.distortion": track.camera.distortion,
        "camera.R_cam_from_world": track.camera.R_cam_from_world,
        "camera.t_cam_from_world": track.camera.t_cam_from_world,
        "camera.status": list(track.status),
        "camera.reason": list(track.reason),
        "camera.inliers": track.inliers,
        "camera.reprojection_px": track.reprojection_px,
        "camera.position_cov": track.position_cov,
        "camera.focal_std_px": track.focal_std_px,
    }
    write_table(folder / "camera.parquet", table="camera", scene=scene, columns=columns)
