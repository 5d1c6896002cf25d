"""A work folder made of recorded motion: skeletons in the world, without pictures and without cameras."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.convert.imported_work import WORK_FILES, ImportOutcome, natural_order
from pgm_data.convert.posed_pictures import Problem
from pgm_data.convert.work_pictures import plain_names
from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack, write_clip_players
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.tables import write_table
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.scene import Scene, SceneObject
from pgm_data.skeleton import Skeleton, world_joints

UPRIGHT = 0.3
"""Share of a body's height along the axis said to be up, below which another axis that has more must be meant."""
NO_CAMERA = "recorded motion, without pictures"
MOST_FRAMES = 2_000_000


@dataclass(frozen=True, kw_only=True)
class MotionImport:
    """How recorded motion is taken over, whatever its format."""

    up: Literal["y", "z", "format"] = "format"
    """Axis of the file that points up; `format`: z of SMPL (as AMASS has it), y of BVH."""
    player: str = ""
    """Player object that moves; empty: the one that the file's name ends in (`_player1`), else the first."""
    frames_per_second: float | None = None
    """Of files that do not say; None: such files are refused."""
    unit_m: float | None = None
    """Metres of the file's unit of length; None: 1 of SMPL, 0.01 of BVH."""
    size: float = 1.0
    """Of the body over that of the skeleton's rest pose, where the file says nothing of its bones (SMPL's poses)."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the file's origin lies in the world, metres."""
    pelvis_m: tuple[float, float, float] | None = None
    """SMPL: from `trans` to the pelvis, in the file's axes, metres, which only the body model knows.

    None: what the file says, else 0.
    """

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("frames_per_second", "unit_m", "size"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name}: expected above 0, got {value}")
        if not np.isfinite([*self.origin_m, *(self.pelvis_m or ())]).all():
            raise ValueError(f"origin_m, pelvis_m: expected finite metres, got {self.origin_m}, {self.pelvis_m}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """One body in motion, in our world's axes; NaN in frames without a pose.

    Raises:
        ValueError: If there is no frame, too many of them, or shapes differ.
    """

    path: Path
    """The file."""
    frames_per_second: float
    nominal: bool
    """Whether the rate is the user's word, not the file's."""
    rotations: Float[np.ndarray, "frames joints 3"]
    """Axis-angle of parent_from_joint, radians; entry 0 is world_from_root."""
    translations: Float[np.ndarray, "frames joints 3"]
    """Of parent_from_joint, metres; entry 0 is the root in the world."""
    betas: Float[np.ndarray, " 10"] | None = None
    """SMPL's shape."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check the values."""
        for name in ("rotations", "translations"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if not 1 <= len(self.rotations) <= MOST_FRAMES:
            raise ValueError(f"{self.path}: expected 1 to {MOST_FRAMES} frames, got {len(self.rotations)}")
        if self.rotations.shape != self.translations.shape:
            shapes = f"{self.rotations.shape} and {self.translations.shape}"
            raise ValueError(f"{self.path}: expected rotations and translations of one shape, got {shapes}")


def player_of(scene: Scene, name: str) -> tuple[SceneObject, Skeleton]:
    """The player object of that name, the first for an empty one, and its skeleton.

    Raises:
        ValueError: If the scene has none.
    """
    names = [player.name for player in scene.players]
    if not names:
        raise ValueError(f"scene {scene.name}: expected a player object for the motion, got none")
    if name and name not in names:
        raise ValueError(f"player: expected one of {', '.join(names)} of scene {scene.name}, got {name!r}")
    player = scene.players[names.index(name) if name else 0]
    assert player.skeleton is not None  # scene files give every player one
    return player, player.skeleton


def player_named(path: Path, scene: Scene, stated: str) -> str:
    """The player object stated, else the one that the file's name ends in, else the scene's first."""
    ending = next((p.name for p in scene.players if path.stem.endswith(f"_{p.name}")), "")
    return player_of(scene, stated or ending)[0].name


def R_world_from_file(up: str) -> Float[np.ndarray, "3 3"]:
    """The rotation from a file's axes, of which `up` points up, to the world's; x stays."""
    if up == "z":
        return np.eye(3)
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def check_upright(place: str, joints_file: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton, up: str) -> None:
    """Refuse motion whose body stands along another axis than the one said to be up.

    Raises:
        ValueError: If that is so in most frames; a body that lies down is let pass.
    """
    heights = np.zeros(len(skeleton.parents))
    for joint, parent in enumerate(skeleton.parents):
        heights[joint] = skeleton.rest_translations[joint, 1] + (heights[parent] if parent >= 0 else 0.0)
    body = joints_file[:, heights.argmax()] - joints_file[:, heights.argmin()]
    body = body[np.isfinite(body).all(axis=1)]
    length = np.linalg.norm(body, axis=1)
    if not (length > 0).any():
        return
    along = np.median(body[length > 0] / length[length > 0, None], axis=0)
    stated, other = (1, 2) if up == "y" else (2, 1)
    if along[stated] < -UPRIGHT or (along[stated] < UPRIGHT and along[other] > 2 * UPRIGHT):
        found = f"one whose height lies along it by {along[stated]:.2f}, and along {'xyz'[other]} by {along[other]:.2f}"
        raise ValueError(f"{place}: up: expected a body that stands along {up}, got {found}")


def in_world(
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
    *,
    up: str,
    origin_m: tuple[float, float, float],
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3"]]:
    """Rotations (angles up to pi) and translations whose root was in the file's axes, in the world; NaN together."""
    R = R_world_from_file(up)
    turned, placed = rotations.copy(), translations.copy()
    turned[:, 0] = rotvec_from_rotation(R @ rotation_from_rotvec(rotations[:, 0]))
    turned[:, 1:] = rotvec_from_rotation(rotation_from_rotvec(rotations[:, 1:]))
    placed[:, 0] = translations[:, 0] @ R.T + np.array(origin_m)
    gone = ~(np.isfinite(turned).all(axis=(1, 2)) & np.isfinite(placed).all(axis=(1, 2)))
    turned[gone] = placed[gone] = np.nan
    return turned, placed


def motion_files(path: Path, suffix: str) -> tuple[Path, ...]:
    """The file, or those of that ending in the folder in their natural order.

    Raises:
        ValueError: If there is none.
    """
    if not path.is_dir():
        return (path,)
    found = sorted((p for p in path.iterdir() if p.suffix.lower() == suffix), key=lambda p: natural_order(p.name))
    if not found:
        raise ValueError(f"{path}: expected files that end in {suffix}, got none")
    return tuple(found)


def write_motion_work(
    out: Path, motions: tuple[Motion, ...], problems: tuple[Problem, ...], *, scene: Scene, player: str
) -> ImportOutcome:
    """Write a clip for each motion, and `shots.parquet`, into the work folder.

    A clip has one frame for each of the motion's, at its rate from 0 s; `camera.parquet` has no camera. Pictures there
    are none: width and height say 1. The player that moves is the one stated, else the one a file's name ends in, else
    the scene's first.
    """
    clip_ids = plain_names(tuple(motion.path.stem for motion in motions), taken=WORK_FILES)
    for clip_id, motion in zip(clip_ids, motions, strict=True):
        folder = out / clip_id
        folder.mkdir(parents=True, exist_ok=True)
        times = np.arange(len(motion.rotations)) / motion.frames_per_second
        moving = player_named(motion.path, scene, player)
        write_clip_players(folder, _players(clip_id, motion, times, scene, moving), scene=scene)
        write_clip_camera(folder, _no_cameras(clip_id, times), scene=scene)
        write_document(folder / "clip.json", "clip", _document(out, clip_id, motion, scene))
    if motions:
        _write_shots(out, clip_ids, motions, scene)
    return ImportOutcome(
        clips=clip_ids,
        pictures=sum(int(np.isfinite(motion.rotations[:, 0, 0]).sum()) for motion in motions),
        nominal_times=tuple(c for c, motion in zip(clip_ids, motions, strict=True) if motion.nominal),
        problems=problems,
    )


def _players(
    clip_id: str,
    motion: Motion,
    times: Float[np.ndarray, " frames"],
    scene: Scene,
    moving: str,
) -> ClipPlayers:
    tracks = []
    for player in scene.players:
        assert player.skeleton is not None
        rows, joints = len(times), len(player.skeleton.parents)
        rotations = translations = np.full((rows, joints, 3), np.nan)
        betas = None
        if player.name == moving:
            rotations, translations = motion.rotations, motion.translations
            known = np.isfinite(rotations[:, 0, 0])
            if motion.betas is not None:
                betas = np.where(known[:, None], motion.betas, np.nan)
        else:
            known = np.zeros(rows, dtype=bool)
        points = len(player.skeleton.keypoint_names)
        tracks.append(
            PlayerTrack(
                name=player.name,
                identity=np.array([""] * rows, dtype=object),
                box_px=np.full((rows, 4), np.nan),
                keypoints_px=np.full((rows, points, 2), np.nan),
                keypoint_score=np.full((rows, points), np.nan),
                root_position=translations[:, 0],
                joints=world_joints(player.skeleton.parents, rotations, translations),
                joint_rotations=rotations,
                joint_translations=translations,
                root_cov=np.full((rows, 3, 3), np.nan),
                contact=np.full((rows, 2), np.nan),
                reprojection_px=np.full(rows, np.nan),
                status=np.where(known, "measured", "none").astype(object),
                betas=betas,
            )
        )
    return ClipPlayers(clip_id=clip_id, video_frame=np.arange(len(times)), timestamp=times, players=tuple(tracks))


def _no_cameras(clip_id: str, times: Float[np.ndarray, " frames"]) -> ClipCamera:
    rows = len(times)
    return ClipCamera(
        clip_id=clip_id,
        video_frame=np.arange(rows),
        timestamp=times,
        is_duplicate=np.zeros(rows, dtype=bool),
        capture_time=times,
        camera=Camera(
            K=np.full((rows, 3, 3), np.nan),
            distortion=np.full((rows, 4), np.nan),
            R_cam_from_world=np.full((rows, 3, 3), np.nan),
            t_cam_from_world=np.full((rows, 3), np.nan),
        ),
        status=np.array(["none"] * rows, dtype=object),
        reason=np.array([NO_CAMERA] * rows, dtype=object),
        inliers=np.zeros(rows, dtype=np.int64),
        reprojection_px=np.full(rows, np.nan),
        position_cov=np.full((rows, 6), np.nan),
        focal_std_px=np.full(rows, np.nan),
    )


def _document(out: Path, clip_id: str, motion: Motion, scene: Scene) -> dict:
    digest = sha256_of(motion.path)
    step = 1 / Fraction(motion.frames_per_second).limit_denominator(100_000)
    return {
        "clip_id": clip_id,
        "match_id": clip_id,
        "source_path": _source(out, motion.path),
        "sha256": digest,
        "bytes": motion.path.stat().st_size,
        "width": 1,
        "height": 1,
        "time_base": f"{step.numerator}/{step.denominator}",
        "first_video_frame": 0,
        "n_frames": len(motion.rotations),
        "scene": scene.name,
        "quality": "imported",
        "lens_model": None,
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {},
        "solved_share": 0.0,
    }


def _source(out: Path, path: Path) -> str:
    """The path from the folder that the work folder stands in, else the bare name."""
    try:
        below = path.resolve().relative_to(out.resolve().parent)
    except ValueError:
        return path.name
    return "../" + below.as_posix()


def _write_shots(out: Path, clip_ids: tuple[str, ...], motions: tuple[Motion, ...], scene: Scene) -> None:
    rows = [len(motion.rotations) for motion in motions]
    times = [np.arange(n) / m.frames_per_second for n, m in zip(rows, motions, strict=True)]
    total = sum(rows)
    columns = {
        "video": [_source(out, m.path) for n, m in zip(rows, motions, strict=True) for _ in range(n)],
        "video_frame": np.concatenate([np.arange(n) for n in rows]),
        "timestamp": np.concatenate(times),
        "verdict": ["clip"] * total,
        "reason": [""] * total,
        "clip_id": [clip_id for n, clip_id in zip(rows, clip_ids, strict=True) for _ in range(n)],
    }
    write_table(out / "shots.parquet", table="shots", scene=scene, columns=columns)
