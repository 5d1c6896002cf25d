"""Small work folders with known cameras."""

import hashlib
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.tables import write_table
from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.scene import load_scene
from pgm_data.video import write_video

SIZE = (320, 180)
FPS = 25.0


def cameras(frames: int, *, seed: int = 0, size=SIZE, zoom=True, distortion=(-0.05, 0.0, 0.0, 0.0)) -> Camera:
    """A broadcast camera that pans a little and zooms."""
    rng = np.random.default_rng(seed)
    tilt = np.deg2rad(15.0)
    upright = np.array([[1, 0, 0], [0, -np.sin(tilt), -np.cos(tilt)], [0, np.cos(tilt), -np.sin(tilt)]])
    R = rotation_from_rotvec(rng.normal(scale=0.01, size=(frames, 3))) @ upright
    position = np.array([0.3, -35.0, 9.0])
    f = size[0] * (1.2 + 0.1 * np.sin(np.arange(frames)) if zoom else np.full(frames, 1.2))
    K = np.zeros((frames, 3, 3))
    K[:, 0, 0] = K[:, 1, 1] = f
    K[:, :2, 2] = (np.array(size) - 1) / 2
    K[:, 2, 2] = 1.0
    return Camera(
        K=K,
        distortion=np.tile(np.array(distortion, dtype=float), (frames, 1)),
        R_cam_from_world=R,
        t_cam_from_world=-(R @ position),
    )


def track(clip_id: str, camera: Camera, *, none=(), interpolated=(), first=0) -> ClipCamera:
    """A camera track with the given frames without a camera."""
    frames = len(camera.K)
    status = np.full(frames, "measured", dtype=object)
    reason = np.full(frames, "", dtype=object)
    status[list(interpolated)], reason[list(interpolated)] = "interpolated", "bridged"
    status[list(none)], reason[list(none)] = "none", "residual 3.1 px above 1.5 px <b>"
    blank = status == "none"

    def known(values: np.ndarray) -> np.ndarray:
        values = np.array(values, dtype=float)
        values[blank] = np.nan
        return values

    times = (np.arange(frames) + first) / FPS + 0.01
    return ClipCamera(
        clip_id=clip_id,
        video_frame=np.arange(frames) + first,
        timestamp=times,
        is_duplicate=np.zeros(frames, dtype=bool),
        capture_time=times,
        camera=Camera(
            K=known(camera.K),
            distortion=known(camera.distortion),
            R_cam_from_world=known(camera.R_cam_from_world),
            t_cam_from_world=known(camera.t_cam_from_world),
        ),
        status=status,
        reason=reason,
        inliers=np.where(blank, 0, 500),
        reprojection_px=known(0.4 + 0.01 * np.arange(frames)),
        position_cov=known(np.tile([0.01, 0, 0, 0.04, 0, 0.0025], (frames, 1))),
        focal_std_px=known(np.full(frames, 2.0)),
    )


def document(one: ClipCamera, source: Path, size=SIZE, **changes) -> dict:
    """The clip.json of a track."""
    return {
        "clip_id": one.clip_id,
        "match_id": "match",
        "source_path": f"../{source.name}",
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
        "bytes": source.stat().st_size,
        "width": size[0],
        "height": size[1],
        "time_base": "1/90000",
        "first_video_frame": int(one.video_frame[0]),
        "n_frames": len(one.status),
        "scene": "tennis",
        "quality": "standard",
        "lens_model": {"model": "k1", "reason": "it lowers the residual from 0.61 to 0.43 px"},
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {},
    } | changes


def numbered_video(path: Path, frames: int, size=SIZE) -> None:
    """A video whose frame i is of grey 40 + 5 i, so that a frame can be told by its pixels."""
    pictures = (np.full((size[1], size[0], 3), 40 + 5 * i, np.uint8) for i in range(frames))
    write_video(path, pictures, timestamps=[i / FPS + 0.01 for i in range(frames)])


def write_work(work: Path, tracks: list[ClipCamera], source: Path, *, size=SIZE, video_frames: int) -> None:
    """A work folder of clips of one video."""
    scene = load_scene("tennis")
    clip_of = np.full(video_frames, "", dtype=object)
    for one in tracks:
        folder = work / one.clip_id
        folder.mkdir(parents=True)
        write_clip_camera(folder, one, scene=scene)
        write_document(folder / "clip.json", "clip", document(one, source, size))
        clip_of[one.video_frame] = one.clip_id
    columns = {
        "video": [f"../{source.name}"] * video_frames,
        "video_frame": np.arange(video_frames),
        "timestamp": np.arange(video_frames) / FPS + 0.01,
        "verdict": ["clip" if name else "other" for name in clip_of],
        "reason": ["" if name else "close-up: 2 of 14 points" for name in clip_of],
        "clip_id": list(clip_of),
    }
    write_table(work / "shots.parquet", table="shots", scene=scene, columns=columns)
