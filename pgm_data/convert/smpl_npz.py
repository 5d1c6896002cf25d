"""SMPL's numbers in .npz files, as AMASS and many pose networks write them. Arrays alone: no body model is needed.

`poses` (T, 72), or (T, 156) of SMPL-H, or (T, 165) of SMPL-X, of which the body's 22 joints are taken and fingers, jaw
and eyes left out; `trans` (T, 3); `betas`; `mocap_framerate` or `mocap_frame_rate`; `joints` (T, 24 or 30, 3) where the
writer knew them. The joints' own axes are SMPL's: x to the person's left, y up, z forward, as in our skeleton.

Without `joints` the bones are those of our skeleton, as their lengths follow from `betas` by the body model alone; and
`trans` is not the pelvis but lies off it by a vector of that model (`pelvis_m`).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.convert.motion_work import Motion, MotionImport, check_upright, in_world
from pgm_data.convert.npz_arrays import floats, read_npz, texts
from pgm_data.dataset.clip_players import PlayerTrack
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.arrays import frozen
from pgm_data.skeleton import Skeleton, load_skeleton, world_from_joints

SKELETON = "smpl24"
JOINTS = load_skeleton(SKELETON).joint_names
FACE = ("Nose", "L_Eye", "R_Eye", "L_Ear", "R_Ear", "Head_top")
"""What 3DCrowdNet adds to SMPL's joints."""
BODY = 22
"""Joints of SMPL-H and SMPL-X that are SMPL's; its two hands are fingers there."""
COLUMNS = (72, 156, 165)
JOINT_KEYS = ("joints", "joints3d", "joints_3d", "joints_cam", "smpl_joints")
RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "fps", "frame_rate")
FRAME_KEYS = ("frame_index", "frames", "frame", "frame_ids")
PLAYER_KEYS = ("player", "players")
OTHER_KEYS = ("poses", "trans", "betas", "pelvis_m")
LONGEST_RATE = 100_000.0
THIGH_M = (0.15, 0.9)
"""Of anybody from a child to a giant: from hip to knee."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SkeletonShapes:
    """3D skeletons that a network saw in a camera, whose place and size are not to be relied on."""

    path: Path
    joint_set: str
    """`smpl24`, or `3dcrowdnet30` with the points of the face."""
    joint_names: tuple[str, ...]
    frame: Int[np.ndarray, " rows"]
    """Frame of the clip, from 0, rising; 0, 1, 2 ... where the file does not say."""
    players: tuple[str, ...]
    """Player objects as the file names them; one empty name where it does not."""
    joints_cam: Float[np.ndarray, "rows players joints 3"]
    """Camera axes (x right, y down, z away), metres; NaN where there is none."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "frame", frozen(self.frame, np.int64))
        object.__setattr__(self, "joints_cam", frozen(self.joints_cam))


def read_smpl_motion(path: Path, options: MotionImport, skeleton: Skeleton) -> Motion:
    """The body in motion that the file holds.

    Rotations by more than pi come back as the same rotation by less; frames with a NaN are frames without a pose.

    Raises:
        ValueError: If the skeleton is not SMPL's, the file lacks an array, one has another shape or holds objects, or
            the body does not stand along the axis said to be up.
    """
    if skeleton.name != SKELETON:
        raise ValueError(f"{path}: expected a player with the skeleton {SKELETON}, got {skeleton.name}")
    arrays = _arrays(path, needed=("poses",))
    rotations = _poses(f"{path}: poses", arrays["poses"])
    unit = options.unit_m if options.unit_m is not None else 1.0
    joints = _joints(path, arrays, len(rotations))
    translations = np.broadcast_to(skeleton.rest_translations * options.size, rotations.shape).copy()
    if joints is not None:
        translations = _translations(rotations, joints[:, 0, : len(JOINTS)] * unit, skeleton)
    elif "trans" in arrays:
        trans = floats(f"{path}: trans", arrays["trans"])
        if trans.shape != (len(rotations), 3):
            raise ValueError(f"{path}: trans: expected {(len(rotations), 3)} as poses has, got {trans.shape}")
        translations[:, 0] = trans * unit + _pelvis(path, arrays, options)
    else:
        raise ValueError(f"{path}: trans: expected the array, or joints, got neither")
    _, placed = world_from_joints(skeleton.parents, rotations, translations)
    up = "z" if options.up == "format" else options.up
    check_upright(str(path), placed, skeleton, up)
    rotations, translations = in_world(rotations, translations, up=up, origin_m=options.origin_m)
    rate = _rate(path, arrays)
    if rate is None and options.frames_per_second is None:
        raise ValueError(f"{path}: mocap_framerate: expected it, or frames_per_second given, got neither")
    return Motion(
        path=path,
        frames_per_second=rate if rate is not None else float(options.frames_per_second or 0),
        nominal=rate is None,
        rotations=rotations,
        translations=translations,
        betas=_betas(path, arrays),
    )


def read_skeleton_shapes(path: Path, *, unit_m: float = 1.0) -> SkeletonShapes:
    """The relative 3D shapes that the file holds: input of `pgm players --skeletons`.

    `joints` (T, 24 or 30, 3), or (T, P, 24 or 30, 3) of P players; without them `poses` (T, 72 and up) whose first
    rotation is camera_from_body, led along our skeleton's bones. `frame_index` (T,) and `player` are optional.

    Args:
        path: An .npz file.
        unit_m: Metres of its unit of length.

    Raises:
        ValueError: If an array is missing, has another shape or holds objects, frames do not rise, or the thighs are of
            no length that thighs have.
    """
    arrays = _arrays(path, needed=())
    key = next((key for key in JOINT_KEYS if key in arrays), None)
    if key is not None:
        joints = _joints(path, arrays, None)
        assert joints is not None
        joints = joints * unit_m
    elif "poses" in arrays:
        rotations = _poses(f"{path}: poses", arrays["poses"])
        skeleton = load_skeleton(SKELETON)
        rest = np.broadcast_to(skeleton.rest_translations, rotations.shape).copy()
        rest[:, 0] = 0.0
        joints = world_from_joints(skeleton.parents, rotations, rest)[1][:, None]
    else:
        raise ValueError(f"{path}: expected one of the arrays {', '.join((*JOINT_KEYS, 'poses'))}, got none of them")
    rows, people = joints.shape[:2]
    thigh = np.linalg.norm(joints[..., JOINTS.index("L_Knee"), :] - joints[..., JOINTS.index("L_Hip"), :], axis=-1)
    if np.isfinite(thigh).any() and not THIGH_M[0] <= float(np.nanmedian(thigh)) <= THIGH_M[1]:
        expected = f"a unit of length that makes thighs {THIGH_M[0]} to {THIGH_M[1]} m long"
        raise ValueError(f"{path}: {key}: expected {expected}, got {float(np.nanmedian(thigh)):.3g} m: give unit_m")
    full = joints.shape[2] > len(JOINTS)
    return SkeletonShapes(
        path=path,
        joint_set="3dcrowdnet30" if full else SKELETON,
        joint_names=(*JOINTS, *FACE) if full else JOINTS,
        frame=_frames(path, arrays, rows),
        players=_players(path, arrays, people),
        joints_cam=joints,
    )


def write_smpl_npz(
    path: Path,
    track: PlayerTrack,
    *,
    frames_per_second: float,
    capture_time: Float[np.ndarray, " frames"],
) -> None:
    """Write one player as an .npz file, whole or not at all.

    `poses` (T, 72), `trans` (T, 3: the pelvis itself, so `pelvis_m` is 0), `joints` (T, 24, 3), `mocap_framerate`,
    `gender` neutral, `betas` (10) where known (their median), `frame_index`, `capture_time` (s), `player`. World axes,
    z up, metres. Frames without a pose are NaN. Rest pose and proportions are the track's, not SMPL's: programs that
    draw SMPL's mesh get its rotations on their own bones. Boxes, keypoints, contacts, covariances, status and identity
    stay behind.

    Raises:
        ValueError: If the joints are not SMPL's 24.
    """
    rows = len(track.joint_rotations)
    if track.joint_rotations.shape[1:] != (len(JOINTS), 3):
        raise ValueError(f"{track.name}: expected the 24 joints of SMPL, got {track.joint_rotations.shape[1]}")
    arrays: dict[str, np.ndarray] = {
        "poses": track.joint_rotations.reshape(rows, -1),
        "trans": track.joints[:, 0],
        "joints": track.joints,
        "mocap_framerate": np.array(frames_per_second),
        "gender": np.array("neutral"),
        "pelvis_m": np.zeros(3),
        "frame_index": np.arange(rows),
        "capture_time": capture_time,
        "player": np.array(track.name),
    }
    if track.betas is not None and np.isfinite(track.betas).all(axis=1).any():
        arrays["betas"] = np.nanmedian(track.betas, axis=0)
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _arrays(path: Path, *, needed: tuple[str, ...]) -> dict[str, np.ndarray]:
    wanted = frozenset((*JOINT_KEYS, *RATE_KEYS, *FRAME_KEYS, *PLAYER_KEYS, *OTHER_KEYS))
    arrays, names = read_npz(path, wanted)
    for name in needed:
        if name not in arrays:
            raise ValueError(f"{path}: {name}: expected the array, got {', '.join(names)[:200] or 'an empty file'}")
    return arrays


def _poses(place: str, raw: np.ndarray) -> Float[np.ndarray, "frames joints 3"]:
    values = floats(place, raw)
    flat = values.reshape(len(values), -1) if values.ndim == 3 and values.shape[-1] == 3 else values
    if flat.ndim != 2 or flat.shape[1] not in COLUMNS or not len(flat):
        expected = " or ".join(f"(T, {n})" for n in COLUMNS)
        raise ValueError(f"{place}: expected {expected}, got {values.shape}")
    kept = len(JOINTS) if flat.shape[1] == 3 * len(JOINTS) else BODY
    rotations = np.zeros((len(flat), len(JOINTS), 3))
    rotations[:, :kept] = flat[:, : 3 * kept].reshape(len(flat), kept, 3)
    return rotations


def _joints(path: Path, arrays: dict[str, np.ndarray], rows: int | None) -> Float[np.ndarray, "rows p joints 3"] | None:
    """Joints of each player, in the file's unit; None where it has none."""
    key = next((key for key in JOINT_KEYS if key in arrays), None)
    if key is None:
        return None
    joints = floats(f"{path}: {key}", arrays[key])
    if joints.ndim == 3:
        joints = joints[:, None]
    sizes = (len(JOINTS), len(JOINTS) + len(FACE))
    if joints.ndim != 4 or joints.shape[2] not in sizes or joints.shape[3] != 3 or not joints.size:
        expected = f"(T, {sizes[0]} or {sizes[1]}, 3), or that of several players"
        raise ValueError(f"{path}: {key}: expected {expected}, got {arrays[key].shape}")
    if rows is not None and joints.shape[:2] != (rows, 1):
        raise ValueError(f"{path}: {key}: expected {rows} rows of one body, as poses has, got {arrays[key].shape}")
    return joints


def _translations(
    rotations: Float[np.ndarray, "frames joints 3"],
    joints: Float[np.ndarray, "frames joints 3"],
    skeleton: Skeleton,
) -> Float[np.ndarray, "frames joints 3"]:
    """Translations of parent_from_joint that lead to the joints."""
    R, _ = world_from_joints(skeleton.parents, rotations, np.zeros_like(joints))
    parents = skeleton.parents[1:]
    translations = joints.copy()
    apart = joints[:, 1:] - joints[:, parents]
    translations[:, 1:] = (np.swapaxes(R[:, parents], -1, -2) @ apart[..., None])[..., 0]
    return translations


def _pelvis(path: Path, arrays: dict[str, np.ndarray], options: MotionImport) -> Float[np.ndarray, " 3"]:
    if options.pelvis_m is not None:
        return np.array(options.pelvis_m)
    if "pelvis_m" not in arrays:
        return np.zeros(3)
    offset = floats(f"{path}: pelvis_m", arrays["pelvis_m"])
    if offset.shape != (3,) or not np.isfinite(offset).all():
        raise ValueError(f"{path}: pelvis_m: expected 3 numbers, got {offset}")
    return offset


def _rate(path: Path, arrays: dict[str, np.ndarray]) -> float | None:
    key = next((key for key in RATE_KEYS if key in arrays), None)
    if key is None:
        return None
    value = floats(f"{path}: {key}", arrays[key]).ravel()
    if len(value) != 1 or not 0 < value[0] <= LONGEST_RATE:
        raise ValueError(f"{path}: {key}: expected one number above 0, got {value}")
    return float(value[0])


def _betas(path: Path, arrays: dict[str, np.ndarray]) -> Float[np.ndarray, " 10"] | None:
    """The first ten; SMPL-X's files have sixteen."""
    if "betas" not in arrays:
        return None
    betas = floats(f"{path}: betas", arrays["betas"])
    flat = betas.reshape(-1, betas.shape[-1])[0] if betas.ndim in (1, 2) and betas.size else np.zeros(0)
    if len(flat) < 10:
        raise ValueError(f"{path}: betas: expected 10 numbers or more, got {betas.shape}")
    return flat[:10]


def _frames(path: Path, arrays: dict[str, np.ndarray], rows: int) -> Int[np.ndarray, " rows"]:
    key = next((key for key in FRAME_KEYS if key in arrays), None)
    if key is None:
        return np.arange(rows)
    frames = floats(f"{path}: {key}", arrays[key])
    whole = np.isfinite(frames).all() and (frames == np.rint(frames)).all()
    if frames.shape != (rows,) or not whole or (frames < 0).any() or (np.diff(frames) <= 0).any():
        raise ValueError(f"{path}: {key}: expected {rows} whole numbers from 0 that rise, got {frames.ravel()[:5]}")
    return frames.astype(np.int64)


def _players(path: Path, arrays: dict[str, np.ndarray], people: int) -> tuple[str, ...]:
    key = next((key for key in PLAYER_KEYS if key in arrays), None)
    if key is None:
        if people > 1:
            raise ValueError(f"{path}: players: expected the names of {people} players, got none")
        return ("",)
    names = texts(arrays[key])
    if arrays[key].dtype.kind not in "US" or len(names) != people or len(set(names)) != people:
        raise ValueError(f"{path}: {key}: expected {people} different names, got {names[:5]}")
    return names
