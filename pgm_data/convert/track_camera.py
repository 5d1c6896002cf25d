"""The camera of a foreign track: a CAMERA.json that stands still, or the camera.parquet of a clip."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from pgm_data.convert.frame_clock import FrameClock
from pgm_data.dataset.clip_camera import STATUSES
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera

PARTS = {"K": (3, 3), "distortion": (4,), "R_cam_from_world": (3, 3), "t_cam_from_world": (3,)}
COLUMNS = (
    *("video_frame", "timestamp", "frame.is_duplicate", "frame.capture_time", "camera.status"),
    *("camera.reprojection_px", "camera.position_cov", "camera.focal_std_px"),
    *(f"camera.{name}" for name in PARTS),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackCamera:
    """One camera a frame."""

    camera: Camera
    """Batch axis = frames; NaN where a frame has none."""
    clock: FrameClock | None
    """The frames' times where the file says them; None of a CAMERA.json."""
    size: tuple[int, int] | None
    """Width and height of the picture, px; None of a camera.parquet, which does not say."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`, `interpolated` or `none`; `measured` throughout of a CAMERA.json."""
    reprojection_px: Float[np.ndarray, " frames"]
    """Rms of 2D distances of what the camera was solved from; NaN where nobody says."""
    position_cov: Float[np.ndarray, "frames 6"]
    """Covariance of its position (xx, xy, xz, yy, yz, zz), m^2; NaN where nobody says."""
    focal_std_px: Float[np.ndarray, " frames"]
    """NaN where nobody says."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("reprojection_px", "position_cov", "focal_std_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def read_track_camera(path: Path, frames: int) -> TrackCamera:
    """The camera at the path: that of a CAMERA.json for so many frames, or the frames of a camera.parquet.

    Raises:
        ValueError: If the file cannot be read, lacks a field, holds a camera that is none, or no frame at all.
    """
    if path.suffix.lower() == ".json":
        return _fixed(path, frames)
    if path.suffix.lower() == ".parquet":
        return _of_clip(path)
    raise ValueError(f"{path}: expected a camera in a .json or a .parquet file, got {path.suffix or 'no suffix'}")


def _fixed(path: Path, frames: int) -> TrackCamera:
    if frames < 1:
        raise ValueError(f"frames: expected at least one, got {frames}")
    document = read_document(path, "camera")
    parts = {
        name: np.broadcast_to(np.array(document[name], dtype=np.float64).reshape(shape), (frames, *shape))
        for name, shape in PARTS.items()
    }
    return TrackCamera(
        camera=_camera(path, parts),
        clock=None,
        size=(document["width"], document["height"]),
        status=np.full(frames, "measured", dtype=object),
        reprojection_px=np.full(frames, np.nan),
        position_cov=np.full((frames, 6), np.nan),
        focal_std_px=np.full(frames, np.nan),
    )


def _of_clip(path: Path) -> TrackCamera:
    columns = read_table(path)
    absent = [name for name in COLUMNS if name not in columns]
    if absent:
        raise ValueError(f"{path}: {absent[0]}: expected the column, got {', '.join(columns)}")
    rows = len(columns["video_frame"])
    clips = sorted(set(columns["clip_id"])) if "clip_id" in columns else []
    if not rows or len(clips) > 1:
        raise ValueError(f"{path}: clip_id: expected the frames of one clip, got {', '.join(clips) or 'none'}")
    status = columns["camera.status"]
    stray = sorted(set(status) - set(STATUSES))
    if stray:
        raise ValueError(f"{path}: camera.status: expected one of {', '.join(STATUSES)}, got {stray[0]!r}")
    parts = {}
    for name, shape in PARTS.items():
        values = columns[f"camera.{name}"]
        if values.dtype.kind != "f" or values.shape != (rows, int(np.prod(shape))):
            raise ValueError(f"{path}: camera.{name}: expected {np.prod(shape)} numbers a row, got {values.shape[1:]}")
        wrong = np.flatnonzero((status != "none") & ~np.isfinite(values).all(axis=1))
        if len(wrong):
            said = f"expected numbers, as its status is {status[wrong[0]]}, got {values[wrong[0]]}"
            raise ValueError(f"{path}: camera.{name}: frame {wrong[0]}: {said}")
        parts[name] = values.reshape(rows, *shape)
    try:
        clock = FrameClock(
            video_frame=columns["video_frame"],
            timestamp=columns["timestamp"],
            capture_time=columns["frame.capture_time"],
            is_duplicate=columns["frame.is_duplicate"],
            said=f"times of {path.name}",
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return TrackCamera(
        camera=_camera(path, parts),
        clock=clock,
        size=None,
        status=status,
        reprojection_px=columns["camera.reprojection_px"],
        position_cov=columns["camera.position_cov"],
        focal_std_px=columns["camera.focal_std_px"],
    )


def _camera(path: Path, parts: dict[str, np.ndarray]) -> Camera:
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are no rotation, and are refused as such
            return Camera(**parts)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
