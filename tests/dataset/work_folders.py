"""Small work folders that hold to the contract, made without any solver."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pgm_data.dataset.columns import Column, scene_tables, table_columns
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.tables import write_table
from pgm_data.scene import Scene, load_scene

FPS = 25.0
ABSENT = 4
"""Frames at the end of each clip without a camera."""


def clip_document(clip_id: str, *, scene: Scene, frames: int, first_video_frame: int = 0) -> dict:
    """The document of a clip of ours."""
    return {
        "clip_id": clip_id,
        "match_id": "match",
        "source_path": "../videos/rally.mp4",
        "sha256": "0" * 64,
        "bytes": 12345,
        "width": 1920,
        "height": 1080,
        "time_base": "1/90000",
        "first_video_frame": first_video_frame,
        "n_frames": frames,
        "scene": scene.name,
        "quality": "standard",
        "lens_model": {"model": "radial", "reason": "the lines bend"},
        "shutter_s": None,
        "ui_boxes_px": [[10, 10, 200, 80]],
        "players": {"player0": {"identity": "a", "handedness": "left"}},
        "camera": {
            "position_world": [0.0, -33.0, 9.0],
            "position_std": [0.01, 0.1, 0.02],
            "jitter_px": 0.1,
            "focal_px_range": [2700.0, 2800.0],
            "principal_point": [959.5, 539.5],
            "evidence": "residuals fell from 1.2 to 0.3 px",
        },
        "solved_share": 1 - ABSENT / frames,
    }


def run_document() -> dict:
    """The document of a run."""
    return {
        "command": "pgm-calibrate videos --out work",
        "options": {"quality": "standard"},
        "versions": {"pgm": "0.1.0"},
        "commit": "",
        "started": "2026-01-31T12:00:00+00:00",
        "seconds": 3.5,
        "machine": {"system": "Linux", "cores": 2},
        "inputs": [{"path": "rally.mp4", "state": "done", "reason": "", "clips": ["rally.00"], "seconds": 3.0}],
    }


def keys(clip_id: str, frames: int, first: int = 0) -> dict:
    """Keys of a frame-aligned table."""
    video_frame = np.arange(first, first + frames)
    return {
        "clip_id": [clip_id] * frames,
        "frame_index": np.arange(frames),
        "video_frame": video_frame,
        "timestamp": video_frame / FPS,
    }


def camera_columns(clip_id: str, frames: int, first: int = 0) -> dict:
    """A camera that pans, with one repeated frame and none at all in the last frames."""
    columns = keys(clip_id, frames, first)
    duplicate = np.arange(frames) == 5
    pan = Rotation.from_rotvec(np.linspace([0, 0, 0], [0, 0, 0.1], frames))
    R_cam_from_world = (Rotation.from_euler("x", 104, degrees=True) * pan).as_matrix()
    t = -R_cam_from_world @ np.array([0.0, -33.0, 9.0])
    there = np.arange(frames) < frames - ABSENT
    status = np.where(there, "measured", "none").astype(object)
    status[2] = "interpolated"

    def where_there(values: np.ndarray) -> np.ndarray:
        values = np.array(np.broadcast_to(values, (frames, *np.shape(values)[-1:])), dtype=float)
        values[~there] = np.nan
        return values

    scalar = np.where(there, 1.0, np.nan)
    return columns | {
        "frame.is_duplicate": duplicate,
        "frame.capture_time": columns["timestamp"] - duplicate / FPS,
        "camera.K": where_there(np.array([2750.0, 0, 959.5, 0, 2750, 539.5, 0, 0, 1])),
        "camera.distortion": where_there(np.array([0.1, 0, 0, 0])),
        "camera.R_cam_from_world": where_there(R_cam_from_world.reshape(-1, 9)),
        "camera.t_cam_from_world": where_there(t),
        "camera.status": list(status),
        "camera.reason": ["" if s == "measured" else "no court in sight" for s in status],
        "camera.inliers": np.where(there, 14, 0).astype(np.int32),
        "camera.reprojection_px": 0.3 * scalar,
        "camera.position_cov": where_there(np.array([1e-4, 0, 0, 1e-2, 1e-4, 4e-4])),
        "camera.focal_std_px": 2.0 * scalar,
    }


def absent_columns(columns: tuple[Column, ...], frames: int) -> dict:
    """Columns of a declared object whose stage has not run: NaN, and status none."""
    values: dict = {}
    for column in columns:
        if column.type == "string":
            values[column.name] = ["none" if column.allowed else ""] * frames
        elif not column.optional:
            values[column.name] = np.full((frames, column.size) if column.size else frames, np.nan)
    return values


def write_clip(folder: Path, *, scene: Scene, frames: int = 12, first_video_frame: int = 0) -> None:
    """A clip's folder with every table that its scene declares."""
    folder.mkdir(parents=True)
    name = folder.name
    document = clip_document(name, scene=scene, frames=frames, first_video_frame=first_video_frame)
    write_document(folder / "clip.json", "clip", document)
    camera = camera_columns(name, frames, first_video_frame)
    write_table(folder / "camera.parquet", table="camera", scene=scene, columns=camera)
    for table in ("players", "ball"):
        if table in scene_tables(scene):
            own = table_columns(table, scene)[4:]
            columns = keys(name, frames, first_video_frame) | absent_columns(own, frames)
            write_table(folder / f"{table}.parquet", table=table, scene=scene, columns=columns)
    start = first_video_frame / FPS
    captions = {
        "clip_id": [name, name],
        "player": np.array([0, 0], np.int32),
        "start_frame": [0, 6],
        "end_frame": [6, frames],
        "start_s": [start, start + 0.24],
        "end_s": [start + 0.24, start + frames / FPS],
        "text": ["runs", "waits"],
        "source": ["human", "human"],
        "alternative": np.array([0, 0], np.int32),
    }
    write_table(folder / "captions.parquet", table="captions", scene=scene, columns=captions)
    if scene.ball is not None:
        events = {
            "clip_id": [name] * 2,
            "time": [start + 0.05, start + 0.31],
            "frame_index": [1, 8],
            "kind": ["hit", "bounce"],
            "player": ["player0", ""],
            "probability": [1.0, 0.9],
            "source": ["human"] * 2,
            "position": np.array([[0.0, -12, 1], [0, 6, 0.03]]),
        }
        write_table(folder / "events.parquet", table="events", scene=scene, columns=events)
        flights = {
            "clip_id": [name],
            "start_event": [0],
            "end_event": [1],
            "start_time": [start + 0.05],
            "end_time": [start + 0.31],
            "player": ["player0"],
            "start_speed": [50.0],
            "spin": np.zeros((1, 3)),
            "spin_std": np.ones((1, 3)),
            "drag_per_m": [0.02],
            "drag_std_per_m": [0.002],
            "landing_position": np.array([[0.0, 6, 0]]),
            "in_probability": [0.99],
            "free_parameters": ["v0 drag"],
            "residual_px": [0.8],
            "status": ["converged"],
        }
        write_table(folder / "ball_shots.parquet", table="ball_shots", scene=scene, columns=flights)


def shots_columns(frames: int = 12) -> dict:
    """Two clips with a cross-fade of three frames between them, and a second video without the scene."""
    gap = 3
    rally, crowd = 2 * frames + gap, 4
    frame = np.concatenate([np.arange(rally), np.arange(crowd)])
    verdict = ["clip"] * frames + ["transition"] * gap + ["clip"] * frames + ["other"] * crowd
    clip = ["rally.00"] * frames + [""] * gap + ["rally.01"] * frames + [""] * crowd
    return {
        "video": ["../videos/rally.mp4"] * rally + ["../videos/crowd.mp4"] * crowd,
        "video_frame": frame,
        "timestamp": frame / FPS,
        "verdict": verdict,
        "reason": ["" if v == "clip" else f"{v} shot" for v in verdict],
        "clip_id": clip,
    }


def write_work(work: Path, *, scene: str = "tennis", frames: int = 12) -> Path:
    """A work folder of one video with two clips and another with none."""
    loaded = load_scene(scene)
    work.mkdir(parents=True)
    write_clip(work / "rally.00", scene=loaded, frames=frames)
    write_clip(work / "rally.01", scene=loaded, frames=frames, first_video_frame=frames + 3)
    write_table(work / "shots.parquet", table="shots", scene=loaded, columns=shots_columns(frames))
    write_document(work / "run.json", "run", run_document())
    return work
