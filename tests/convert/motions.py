"""Small work folders of bodies in motion."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from pgm_data.convert.motion_work import Motion, write_motion_work
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera, write_clip_camera
from pgm_data.dataset.clip_players import PlayerTrack, read_clip_players
from pgm_data.scene import load_scene

TENNIS, BLOCKS = load_scene("tennis"), load_scene("blocks")


def motion(path: Path, frames: int = 12, *, scene=TENNIS, missing=(), scale=1.1, rate=25.0, betas=None) -> Motion:
    """A body that walks and waves, upright; no pose in the frames named."""
    skeleton = scene.players[0].skeleton
    rng = np.random.default_rng(frames)
    at = np.arange(frames)[:, None, None] / rate
    phase, size = rng.uniform(0, 6, (len(skeleton.parents), 3)), rng.uniform(0.1, 0.5, (len(skeleton.parents), 3))
    rotations = size * np.sin(2 * at + phase)
    rotations[:, 0] = [np.pi / 2, 0, 0] + 0.05 * np.sin(3 * at[:, 0] + phase[0])
    translations = np.broadcast_to(skeleton.rest_translations * scale, rotations.shape).copy()
    translations[:, 0] = np.array([1.0, -11.0, 1.0]) + at[:, 0] * [0.5, 1.0, 0.0]
    rotations[list(missing)] = translations[list(missing)] = np.nan
    path.write_bytes(hashlib.sha256(str(frames).encode()).digest())
    return Motion(
        path=path, frames_per_second=rate, nominal=False, rotations=rotations, translations=translations, betas=betas
    )


def work_folder(folder: Path, *motions: Motion, scene=TENNIS) -> Path:
    """The motions as a work folder."""
    write_motion_work(folder / "work", motions, (), scene=scene, player="")
    return folder / "work"


def first_player(work: Path, clip: str, *, scene=TENNIS, player: int = 0) -> PlayerTrack:
    """A player of a clip."""
    return read_clip_players(work / clip, scene).players[player]


def retimed(work: Path, clip: str, capture: np.ndarray, duplicate: np.ndarray) -> None:
    """Give a clip other capture times."""
    track: ClipCamera = read_clip_camera(work / clip)
    write_clip_camera(work / clip, replace(track, capture_time=capture, is_duplicate=duplicate), scene=TENNIS)
