"""A clip in three dimensions as arrays that any 3D viewer can show: court, net, ball, players, cameras."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.dataset.clip_ball import BALL_TABLES, ClipBall, read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.rigid import rotvec_from_rotation
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.ball_paths import FlightPaths, flight_paths

RGB = tuple[int, int, int]
HITTER_COLOURS: tuple[RGB, ...] = ((130, 138, 148), (9, 105, 218), (191, 87, 0), (130, 80, 223))
"""Of unknown hitters, then of the others in order of their names, as in a clip's report."""
NET_STEP_M = 0.5
"""Between the net's cords across it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipScene:
    """What a clip's folder holds, frame by frame."""

    clip_id: str
    scene: Scene
    capture_time: Float[np.ndarray, " frames"]
    """Seconds; never falling."""
    size: tuple[int, int] | None
    """Width and height of the pictures, px; None where nobody says."""
    camera: ClipCamera | None
    ball: ClipBall | None
    paths: FlightPaths | None
    """The ball's flights; None without a ball."""
    bones: Float[np.ndarray, "frames players bones 2 3"]
    """Both ends of each joint's line to its parent, world metres; NaN where a player is not known."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("capture_time", "bones"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def viewable_clips(work: Path) -> tuple[Path, ...]:
    """The clip folders of a work folder, or the folder itself where it holds a clip's tables.

    Raises:
        ValueError: If there is nothing to see.
    """
    if not work.is_dir():
        raise ValueError(f"{work}: expected a folder, got {'a file' if work.exists() else 'nothing there'}")
    if _has_tables(work):
        return (work,)
    found = tuple(sorted(folder for folder in work.iterdir() if folder.is_dir() and _has_tables(folder)))
    if not found:
        raise ValueError(f"{work}: expected clips with a camera.parquet or a ball.parquet, got none")
    return found


def _has_tables(folder: Path) -> bool:
    return (folder / "camera.parquet").is_file() or _has_ball(folder)


def _has_ball(folder: Path) -> bool:
    return all((folder / f"{name}.parquet").is_file() for name in BALL_TABLES)


def clip_scene(folder: Path, scene: str = "") -> ClipScene:
    """What the folder of a clip holds.

    Args:
        folder: A clip's folder, or one that `pgm-ball3d` wrote from a track.
        scene: Name or file of the scene; that of the clip, else tennis, where empty.

    Raises:
        ValueError: If a table cannot be read, the scene is not known, or there is no frame.
    """
    document: dict[str, Any] = {}
    if (folder / "clip.json").is_file():
        document = read_document(folder / "clip.json", "clip")
    loaded = load_scene(scene or document.get("scene", "tennis"))
    camera = read_clip_camera(folder) if (folder / "camera.parquet").is_file() else None
    if camera is not None:
        times = camera.capture_time
    else:
        # A track that came alone: when its frames were taken is not kept.
        times = read_table(folder / "ball.parquet")["timestamp"]
    if not len(times):
        raise ValueError(f"{folder}: expected at least one frame, got none")
    ball = read_clip_ball(folder, times) if loaded.ball is not None and _has_ball(folder) else None
    size = (document["width"], document["height"]) if document else None
    return ClipScene(
        clip_id=folder.name,
        scene=loaded,
        capture_time=times,
        size=size,
        camera=camera,
        ball=ball,
        paths=flight_paths(ball) if ball is not None else None,
        bones=_bones(folder / "players.parquet", loaded, len(times)),
    )


def _bones(path: Path, scene: Scene, frames: int) -> Float[np.ndarray, "frames players bones 2 3"]:
    """The lines of the players' skeletons; no player where there is no table of them."""
    if not scene.players or not path.is_file():
        return np.zeros((frames, 0, 0, 2, 3))
    columns = read_table(path)
    per_player = []
    for player in scene.players:
        assert player.skeleton is not None
        name = f"{player.name}.joints"
        parents = player.skeleton.parents
        if name not in columns or columns[name].shape != (frames, 3 * len(parents)):
            got = columns[name].shape if name in columns else "none"
            expected = f"the column with {frames} x {3 * len(parents)} numbers"
            raise ValueError(f"{path}: {name}: expected {expected}, got {got}")
        joints = columns[name].reshape(frames, len(parents), 3).astype(np.float64)
        children = np.flatnonzero(parents >= 0)
        per_player.append(np.stack([joints[:, parents[children]], joints[:, children]], axis=2))
    most = max(bones.shape[1] for bones in per_player)
    padded = [np.pad(b, ((0, 0), (0, most - b.shape[1]), (0, 0), (0, 0)), constant_values=np.nan) for b in per_player]
    return np.stack(padded, axis=1)


def net_segments(court: Court) -> Float[np.ndarray, "segments 2 3"]:
    """The net's upper edge, and cords from it to the ground."""
    top = court.net_world
    if len(top) < 2:
        return np.zeros((0, 2, 3))
    xs = np.unique(np.concatenate([np.arange(top[0, 0], top[-1, 0], NET_STEP_M), top[:, 0]]))
    heads = np.stack([xs, np.interp(xs, top[:, 0], top[:, 1]), np.interp(xs, top[:, 0], top[:, 2])], axis=1)
    cords = np.stack([heads, heads * [1, 1, 0]], axis=1)
    return np.concatenate([np.stack([top[:-1], top[1:]], axis=1), cords])


def hitter_colours(paths: FlightPaths) -> dict[str, RGB]:
    """A colour for everybody who hits the ball in the clip; the empty name stands for those who are not known."""
    names = sorted({str(name) for name in paths.hitter} - {""})
    others = HITTER_COLOURS[1:]
    return {"": HITTER_COLOURS[0]} | {name: others[i % len(others)] for i, name in enumerate(names)}


def flight_segments(paths: FlightPaths, hitter: str) -> Float[np.ndarray, "segments 2 3"]:
    """All flights after a hit of that player, as short straight pieces; world metres."""
    flight = np.repeat(np.arange(len(paths)), np.diff(paths.first))
    pieces = np.stack([paths.points_world[:-1], paths.points_world[1:]], axis=1)
    same = (flight[:-1] == flight[1:]) & (paths.hitter[flight[:-1]] == hitter)
    return pieces[same & np.isfinite(pieces).all(axis=(1, 2))]


def quaternion(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 4"]:
    """The unit quaternion w, x, y, z of a rotation."""
    rotvec = rotvec_from_rotation(R)
    angle = float(np.linalg.norm(rotvec))
    # sinc is 1 at 0.
    return np.concatenate([[np.cos(angle / 2)], 0.5 * np.sinc(angle / (2 * np.pi)) * rotvec])


def ellipsoid(cov: Float[np.ndarray, "3 3"], least_m: float) -> tuple[Float[np.ndarray, " 4"], Float[np.ndarray, " 3"]]:
    """Orientation (quaternion w, x, y, z) and half axes, metres, of one standard deviation; none below `least_m`."""
    values, axes = np.linalg.eigh(cov)
    if np.linalg.det(axes) < 0:
        axes = axes * [-1, 1, 1]
    return quaternion(axes), np.maximum(np.sqrt(np.maximum(values, 0.0)), least_m)


def frustum(
    track: ClipCamera, frame: int, size: tuple[int, int]
) -> tuple[Float[np.ndarray, " 4"], Float[np.ndarray, " 3"], float]:
    """A frame's camera: orientation of world_from_camera (w, x, y, z), position, vertical field of view in radians."""
    camera = track.camera
    fov = 2 * np.arctan2(0.5 * size[1], camera.K[frame, 1, 1])
    return quaternion(camera.R_cam_from_world[frame].T), camera.position_world[frame], float(fov)
