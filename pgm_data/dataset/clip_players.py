"""The players of one clip as one struct: what `players.parquet` holds, read and written whole."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import Scene, SceneObject

STATUSES = ("measured", "filled", "none")
UPPER = np.triu_indices(3)
FULL = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerTrack:
    """One player object: a row a frame; NaN where the status is `none`, and of joints where no pose is known."""

    name: str
    """Player object of the scene."""
    identity: Shaped[np.ndarray, " frames"]
    """The person, constant in a match; empty where unknown."""
    box_px: Float[np.ndarray, "frames 4"]
    keypoints_px: Float[np.ndarray, "frames keypoints 2"]
    """Of the skeleton's keypoint set."""
    keypoint_score: Float[np.ndarray, "frames keypoints"]
    root_position: Float[np.ndarray, "frames 3"]
    """World metres."""
    joints: Float[np.ndarray, "frames joints 3"]
    """World metres."""
    joint_rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians; entry 0 is world_from_root."""
    joint_translations: Float[np.ndarray, "frames joints 3"]
    """Of parent_from_joint, metres; entry 0 is the root in the world."""
    root_cov: Float[np.ndarray, "frames 3 3"]
    """m^2."""
    contact: Float[np.ndarray, "frames 2"]
    """Probability that the left, the right foot is on the ground."""
    reprojection_px: Float[np.ndarray, " frames"]
    """Rms of 2D distances of the keypoints that were found."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`, `filled` or `none`."""
    betas: Float[np.ndarray, "frames 10"] | None = None
    """SMPL's shape, where a source gives it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipPlayers:
    """The players of one clip."""

    clip_id: str
    video_frame: Int[np.ndarray, " frames"]
    timestamp: Float[np.ndarray, " frames"]
    """The video's own presentation time, s."""
    players: tuple[PlayerTrack, ...]
    """In the scene's order."""


def write_clip_players(folder: Path, clip: ClipPlayers, *, scene: Scene) -> None:
    """Write the players as `players.parquet` into the clip's folder, whole or not at all.

    Raises:
        ValueError: If they are not the scene's players, or a column has another shape than the scene says.
    """
    names = tuple(player.name for player in scene.players)
    if tuple(track.name for track in clip.players) != names:
        got = ", ".join(track.name for track in clip.players)
        raise ValueError(f"{clip.clip_id}: players: expected {', '.join(names)}, got {got}")
    rows = len(clip.video_frame)
    columns: dict = {
        "clip_id": [clip.clip_id] * rows,
        "frame_index": np.arange(rows),
        "video_frame": clip.video_frame,
        "timestamp": clip.timestamp,
    }
    shaped = any(track.betas is not None for track in clip.players)
    for track in clip.players:
        own = {
            "identity": list(track.identity),
            "box_px": track.box_px,
            "keypoints_px": track.keypoints_px,
            "keypoint_score": track.keypoint_score,
            "root_position": track.root_position,
            "root_rotation": track.joint_rotations[:, 0],
            "joints": track.joints,
            "joint_rotations": track.joint_rotations,
            "joint_translations": track.joint_translations,
            "root_cov": track.root_cov[:, UPPER[0], UPPER[1]],
            "contact": track.contact,
            "reprojection_px": track.reprojection_px,
            "status": list(track.status),
        }
        if shaped:
            own["betas"] = track.betas if track.betas is not None else np.full((rows, 10), np.nan)
        columns |= {f"{track.name}.{name}": values for name, values in own.items()}
    write_table(folder / "players.parquet", table="players", scene=scene, columns=columns)


def read_clip_players(folder: Path, scene: Scene) -> ClipPlayers:
    """The players of a clip from its folder.

    Raises:
        ValueError: If the table is missing or lacks a column of the scene's players.
    """
    path = folder / "players.parquet"
    columns = read_table(path)

    def column(name: str) -> np.ndarray:
        if name not in columns:
            raise ValueError(f"{path}: {name}: expected the column, got {', '.join(columns)}")
        return columns[name]

    return ClipPlayers(
        clip_id=folder.name,
        video_frame=column("video_frame"),
        timestamp=column("timestamp"),
        players=tuple(_track(player, column, columns) for player in scene.players),
    )


def _track(player: SceneObject, column, columns: dict[str, np.ndarray]) -> PlayerTrack:
    def values(name: str) -> np.ndarray:
        return column(f"{player.name}.{name}").astype(np.float64)

    rows = len(column(f"{player.name}.status"))
    return PlayerTrack(
        name=player.name,
        identity=column(f"{player.name}.identity"),
        box_px=values("box_px"),
        keypoints_px=values("keypoints_px").reshape(rows, -1, 2),
        keypoint_score=values("keypoint_score"),
        root_position=values("root_position"),
        joints=values("joints").reshape(rows, -1, 3),
        joint_rotations=values("joint_rotations").reshape(rows, -1, 3),
        joint_translations=values("joint_translations").reshape(rows, -1, 3),
        root_cov=values("root_cov")[:, FULL].reshape(rows, 3, 3),
        contact=values("contact"),
        reprojection_px=values("reprojection_px"),
        status=column(f"{player.name}.status"),
        betas=values("betas") if f"{player.name}.betas" in columns else None,
    )
