"""Toy pictures of a court, drawn with cv2 from cameras of our own choosing."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.geometry.camera import Camera
from pgm_data.scene import load_scene
from pgm_data.video import write_video
from pgm_models.detectors.clip_pictures import FrameSet, Pictures
from pgm_models.detectors.court_frames import ClipFrames, court_pixels, divide

SIZE = (640, 360)


def toy_camera(rng: np.random.Generator) -> Camera:
    """A broadcast-like camera."""
    centre = np.array([rng.normal(0, 2), -rng.uniform(28, 45), rng.uniform(7, 14)])
    aim = np.array([rng.normal(0, 1), rng.uniform(-5, 1), 0.0])
    forward = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = rng.uniform(0.9, 1.5) * SIZE[0] * np.linalg.norm(centre) / 38
    return Camera(
        K=np.array([[[focal, 0, 319.5], [0, focal, 179.5], [0, 0, 1.0]]]),
        distortion=np.zeros((1, 4)),
        R_cam_from_world=R[None],
        t_cam_from_world=-(R @ centre)[None],
    )


def toy_clip(folder: Path, frames: int, seed: int) -> ClipFrames:
    """Frames of flat-coloured courts, each from its own camera; every eighth shows none."""
    court = load_scene("tennis").court
    rng = np.random.default_rng(seed)
    points, lines, offsets = [], [], [0]
    path = folder / f"toy{seed}.jpegs"
    with path.open("wb") as file:
        for number in range(frames):
            picture = np.full((SIZE[1], SIZE[0], 3), rng.uniform(30, 140, 3), np.uint8)
            p, ls = court_pixels(court, toy_camera(rng))
            if number % 8 == 7:
                p, ls = np.full_like(p, np.nan), np.full_like(ls, np.nan)
            else:
                for line in ls[0]:
                    cv2.polylines(
                        picture, [np.round(line * 16).astype(np.int32)], False, (235, 235, 235), 2, cv2.LINE_AA, 4
                    )
            points.append(p[0])
            lines.append(ls[0])
            data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            file.write(data)
            offsets.append(offsets[-1] + len(data))
    return ClipFrames(
        clip_id=f"toy{seed}",
        pictures=Pictures(jpegs=path, offsets=np.array(offsets)),
        points_px=np.stack(points),
        lines_px=np.stack(lines),
    )


@pytest.fixture
def toy_frames(tmp_path: Path) -> Callable[[int], FrameSet]:
    """A set of that many toy frames."""
    return lambda frames: divide([toy_clip(tmp_path, frames, seed=1)], every=max(4, min(50, frames // 2)))


@pytest.fixture
def dataset(tmp_path):
    """One video of six frames of grey 40, 60, ...; its clip is frames 1 to 4, the last of them without a court."""
    (tmp_path / "videos").mkdir()
    pictures = (np.full((96, 160, 3), 40 + 20 * k, np.uint8) for k in range(6))
    write_video(tmp_path / "videos" / "mix.mp4", pictures, fps=25.0)
    folder = tmp_path / "work" / "mix"
    folder.mkdir(parents=True)
    (folder / "clip.json").write_text(json.dumps({"source_path": "../videos/mix.mp4"}))
    shown = np.array([True, True, True, False])
    lost = np.where(shown, 1.0, np.nan)
    camera = Camera(
        K=np.array([[150.0, 0, 79.5], [0, 150, 47.5], [0, 0, 1]]) * lost[:, None, None],
        distortion=np.array([0.01, 0, 0, 0]) * lost[:, None],
        R_cam_from_world=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) * lost[:, None, None],
        t_cam_from_world=np.array([0.0, 6.0, 30.0]) * lost[:, None],
    )
    track = ClipCamera(
        clip_id="mix",
        video_frame=np.arange(1, 5),
        timestamp=np.arange(1, 5) / 25,
        is_duplicate=np.zeros(4, bool),
        capture_time=np.arange(1, 5) / 25,
        camera=camera,
        status=np.where(shown, "measured", "none").astype(object),
        reason=np.where(shown, "", "no court").astype(object),
        inliers=np.zeros(4, np.int64),
        reprojection_px=np.zeros(4),
        position_cov=np.zeros((4, 6)),
        focal_std_px=np.zeros(4),
    )
    write_clip_camera(folder, track, scene=load_scene("tennis"))
    return tmp_path
