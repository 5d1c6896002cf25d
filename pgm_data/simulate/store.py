"""Writes simulated videos and their truth as work folders of the contract."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.tables import write_table
from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack

TIME_BASE = "1/90000"
NOBODY: Mapping[str, Mapping[str, str | None]] = MappingProxyType({})


def write_camera_truth(
    folder: Path,
    *,
    clip_id: str,
    scene: Scene,
    track: CameraTrack,
    timestamps: np.ndarray,
    first_video_frame: int = 0,
    capture_times: np.ndarray | None = None,
    is_duplicate: np.ndarray | None = None,
) -> None:
    """`camera.parquet` of exact cameras: reprojection 0, covariances 0, NaN and status `none` without a court."""
    count = len(track)
    shown = track.shows_court
    zero = np.where(shown, 0.0, np.nan)
    index = np.arange(count, dtype=np.int64)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(
        folder / "camera.parquet",
        table="camera",
        scene=scene,
        columns={
            "clip_id": [clip_id] * count,
            "frame_index": index,
            "video_frame": index + first_video_frame,
            "timestamp": timestamps,
            "frame.is_duplicate": np.zeros(count, bool) if is_duplicate is None else is_duplicate,
            "frame.capture_time": timestamps if capture_times is None else capture_times,
            "camera.K": track.K.reshape(count, 9),
            "camera.distortion": track.distortion,
            "camera.R_cam_from_world": track.R_cam_from_world.reshape(count, 9),
            "camera.t_cam_from_world": track.t_cam_from_world,
            "camera.status": ["measured" if s else "none" for s in shown],
            "camera.reason": ["" if s else "the picture shows no court" for s in shown],
            "camera.inliers": np.zeros(count, np.int32),
            "camera.reprojection_px": zero,
            "camera.position_cov": np.repeat(zero[:, None], 6, axis=1),
            "camera.focal_std_px": zero,
        },
    )


@dataclass(frozen=True, kw_only=True)
class VideoContent:
    """What tells one video file from another."""

    sha256: str
    bytes: int


def content_of(video: Path) -> VideoContent:
    """Of the file; of an empty one where there is none."""
    if not video.exists():
        return VideoContent(sha256=hashlib.sha256().hexdigest(), bytes=0)
    return VideoContent(sha256=sha256_of(video), bytes=video.stat().st_size)


def write_clip_truth(
    folder: Path,
    *,
    clip_id: str,
    match_id: str,
    video: Path | VideoContent,
    source_path: str,
    scene: Scene,
    size: tuple[int, int],
    first_video_frame: int,
    track: CameraTrack,
    lens_reason: str,
    shutter_s: float | None = None,
    ui_boxes_px: Sequence[Sequence[float]] = (),
    players: Mapping[str, Mapping[str, str | None]] = NOBODY,
) -> None:
    """`clip.json` of a simulated clip.

    Args:
        folder: The clip's folder.
        clip_id: Its name.
        match_id: The match, which no split divides.
        video: The drawn video, or what it holds, read once for all of its clips; absent where no pictures were drawn.
        source_path: Its path from the work folder.
        scene: What it shows.
        size: Width and height of the pictures, px.
        first_video_frame: The clip's first frame in its video.
        track: The clip's cameras.
        lens_reason: Why the lens is as it is.
        shutter_s: How long the shutter is open, s.
        ui_boxes_px: x0, y0, x1, y1 of logos and score boards, px.
        players: Identity and handedness of each player object, such as player0.
    """
    content = content_of(video) if isinstance(video, Path) else video
    centres = -np.einsum("nji,nj->ni", track.R_cam_from_world, track.t_cam_from_world)
    shown = track.shows_court
    focal = track.K[shown, 0, 0]
    camera: dict = {"jitter_px": 0.0}
    if shown.any():
        camera |= {
            "focal_px_range": [float(focal.min()), float(focal.max())],
            "evidence": "exact: the camera that drew the pictures",
        }
        if np.ptp(centres[shown], axis=0).max() < 1e-6:
            camera |= {
                "position_world": centres[shown][0].tolist(),
                "position_std": [0.0, 0.0, 0.0],
                "principal_point": track.K[shown][0, :2, 2].tolist(),
            }
    write_document(
        folder / "clip.json",
        "clip",
        {
            "clip_id": clip_id,
            "match_id": match_id,
            "source_path": source_path,
            "sha256": content.sha256,
            "bytes": content.bytes,
            "width": size[0],
            "height": size[1],
            "time_base": TIME_BASE,
            "first_video_frame": first_video_frame,
            "n_frames": len(track),
            "scene": scene.name,
            "quality": "truth",
            "lens_model": {"model": "opencv_k1", "reason": lens_reason},
            "shutter_s": shutter_s,
            "ui_boxes_px": [[float(edge) for edge in box] for box in ui_boxes_px],
            "players": {name: dict(person) for name, person in players.items()},
            "camera": camera,
            "solved_share": float(shown.mean()),
        },
    )
