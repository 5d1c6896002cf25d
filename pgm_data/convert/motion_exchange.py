"""Motion exchanged with other programs: what `pgm import smpl|bvh` and `pgm export smpl|bvh` do."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.convert.bvh import BvhMotion, bvh_text, read_bvh
from pgm_data.convert.bvh_bodies import on_skeleton
from pgm_data.convert.imported_work import ImportOutcome
from pgm_data.convert.motion_work import (
    Motion,
    MotionImport,
    R_world_from_file,
    check_upright,
    in_world,
    motion_files,
    player_named,
    player_of,
    write_motion_work,
)
from pgm_data.convert.posed_pictures import Problem
from pgm_data.convert.smpl_npz import SKELETON, read_smpl_motion, write_smpl_npz
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_players import PlayerTrack, read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.files import whole_file
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.scene import Scene, load_scene
from pgm_data.skeleton import Skeleton, world_joints

DEFAULT_SCENE = "tennis"
EVEN = 0.01
"""Share of a frame by which capture times may be off and still count as evenly spaced."""


@dataclass(frozen=True, kw_only=True)
class MotionExport:
    """Which players go out, and how; what one format does not have it passes over."""

    players: tuple[str, ...] = ()
    """Player objects; empty for all."""
    order: Literal["ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX"] = "ZXY"
    """BVH: rotation channels in their order."""
    unit_m: float = 0.01
    """BVH: metres of its unit of length."""
    up: Literal["y", "z"] = "y"
    """BVH: axis that points up."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (np.isfinite(self.unit_m) and self.unit_m > 0):
            raise ValueError(f"unit_m: expected above 0, got {self.unit_m}")


@dataclass(frozen=True, kw_only=True)
class MotionExportOutcome:
    """What went out."""

    files: tuple[str, ...]
    """Names in the folder, one a player of a clip."""
    frames: int
    """Frames with a pose in them."""
    said: tuple[str, ...]
    """What the files could not say as it was (gaps that were filled, times made even), and players without a pose."""
    problems: tuple[Problem, ...]
    """Players whose poses the format cannot hold."""


def import_smpl(
    path: Path, out: Path, *, scene: str | None = None, options: MotionImport | None = None
) -> ImportOutcome:
    """Write the body motion of SMPL or AMASS .npz files as a work folder, one clip a file.

    Args:
        path: A file, or a folder of them.
        out: The work folder.
        scene: Name or file of the scene whose player moves; None for tennis.
        options: `up` (z unless given, as AMASS has it), `player`, `frames_per_second` of files without a rate, `unit_m`
            (1), `size` of a body whose file has no joints, `origin_m`, `pelvis_m`.

    Raises:
        ValueError: If there is no file, the scene has no such player, or its skeleton is not SMPL's. A file that cannot
            be read is a problem of the outcome.
    """
    options = options or MotionImport()
    chosen = load_scene(scene or DEFAULT_SCENE)
    _, skeleton = player_of(chosen, options.player)
    if skeleton.name != SKELETON:
        raise ValueError(f"scene {chosen.name}: expected a player with the skeleton {SKELETON}, got {skeleton.name}")
    return _imported(path, ".npz", out, chosen, options, read_smpl_motion)


def import_bvh(
    path: Path, out: Path, *, scene: str | None = None, options: MotionImport | None = None
) -> ImportOutcome:
    """Write the body motion of BVH files as a work folder, one clip a file.

    Args:
        path: A file, or a folder of them.
        out: The work folder.
        scene: Name or file of the scene whose player moves; None for tennis. Joints with the names of its skeleton are
            taken as they are; for SMPL's skeleton the common names of bodies are known too.
        options: `up` (y unless given), `player`, `unit_m` (0.01 unless given: centimetres), `origin_m`.

    Raises:
        ValueError: If there is no file, or the scene has no such player. A file that cannot be read is a problem of the
            outcome.
    """
    options = options or MotionImport()
    chosen = load_scene(scene or DEFAULT_SCENE)
    player_of(chosen, options.player)
    return _imported(path, ".bvh", out, chosen, options, read_bvh_motion)


def _imported(
    path: Path,
    suffix: str,
    out: Path,
    scene: Scene,
    options: MotionImport,
    read: Callable[[Path, MotionImport, Skeleton], Motion],
) -> ImportOutcome:
    motions: list[Motion] = []
    problems: list[Problem] = []
    for file in motion_files(path, suffix):
        try:
            _, skeleton = player_of(scene, player_named(file, scene, options.player))
            motions.append(read(file, options, skeleton))
        except ValueError as error:
            problems.append(_problem(str(file), f"motion in a {suffix} file", error))
    return write_motion_work(out, tuple(motions), tuple(problems), scene=scene, player=options.player)


def _problem(place: str, expected: str, error: ValueError) -> Problem:
    """The problem of an error that says `field: expected ..., got ...` after its place."""
    words = str(error).removeprefix(f"{place}: ")
    field, _, rest = words.partition(": expected ")
    known, _, found = rest.partition(", got ")
    if rest and found:
        return Problem(place=place, field=field, expected=known, found=found)
    return Problem(place=place, field="file", expected=expected, found=words)


def read_bvh_motion(path: Path, options: MotionImport, skeleton: Skeleton) -> Motion:
    """The body in motion that a BVH file holds, on the skeleton.

    Raises:
        ValueError: If it cannot be read, its joints are not those of a body, or unit or axis up cannot be right.
    """
    bvh = read_bvh(path)
    unit = options.unit_m if options.unit_m is not None else 0.01
    try:
        rotations, translations = on_skeleton(bvh, skeleton, unit_m=unit)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    up = "y" if options.up == "format" else options.up
    check_upright(str(path), world_joints(skeleton.parents, rotations, translations), skeleton, up)
    rotations, translations = in_world(rotations, translations, up=up, origin_m=options.origin_m)
    return Motion(
        path=path,
        frames_per_second=1 / bvh.frame_time,
        nominal=False,
        rotations=rotations,
        translations=translations,
    )


def export_smpl(work: Path, out: Path, options: MotionExport | None = None) -> MotionExportOutcome:
    """Write `<clip>_<player>.npz` for every player of every clip into the folder: see `write_smpl_npz`.

    Rows are the clip's frames; frames without a pose are NaN. `mocap_framerate` is that of the presentation times;
    `capture_time` says when each picture was taken.

    Args:
        work: A work folder, or one clip's folder.
        out: The folder for the files.
        options: `players`.

    Raises:
        ValueError: If there is no clip in the folder, or no clip has a player of that name. A player whose skeleton is
            not SMPL's is a problem of the outcome.
    """
    options = options or MotionExport()
    files, problems, said, frames = [], [], [], 0
    for clip in _clips(work):
        for track, skeleton in _tracks(clip, options, said):
            place = f"{clip.folder}: {track.name}"
            if skeleton.name != SKELETON:
                problems.append(Problem(place=place, field="skeleton", expected=SKELETON, found=skeleton.name))
                continue
            name = f"{clip.folder.name}_{track.name}.npz"
            out.mkdir(parents=True, exist_ok=True)
            rate = _rate(clip.camera.timestamp)
            write_smpl_npz(out / name, track, frames_per_second=rate, capture_time=clip.camera.capture_time)
            files.append(name)
            frames += int(_known(track).sum())
    return MotionExportOutcome(files=tuple(files), frames=frames, said=tuple(said), problems=tuple(problems))


def export_bvh(work: Path, out: Path, options: MotionExport | None = None) -> MotionExportOutcome:
    """Write `<clip>_<player>.bvh` for every player of every clip into the folder.

    A file begins at the player's first pose and ends at the last. BVH has no gaps: frames without a pose between others
    are filled by interpolation, rotations along the shortest way, and the outcome says how many. It has one rate: poses
    at uneven capture times (repeated pictures are no poses of their own) are interpolated at even ones, at the rate of
    the median step; the outcome says so. Betas, boxes, keypoints, contacts and doubts stay behind.

    Args:
        work: A work folder, or one clip's folder.
        out: The folder for the files.
        options: `players`, `order`, `unit_m`, `up`.

    Raises:
        ValueError: If there is no clip in the folder, or no clip has a player of that name.
    """
    options = options or MotionExport()
    files, said, frames = [], [], 0
    for clip in _clips(work):
        for track, skeleton in _tracks(clip, options, said):
            motion, words = bvh_of_track(track, skeleton, clip.camera, options)
            name = f"{clip.folder.name}_{track.name}.bvh"
            out.mkdir(parents=True, exist_ok=True)
            with whole_file(out / name) as temporary:
                temporary.write_text(bvh_text(motion, order=options.order), encoding="utf-8")
            files.append(name)
            said += [f"{name}: {word}" for word in words]
            frames += len(motion.rotations)
    return MotionExportOutcome(files=tuple(files), frames=frames, said=tuple(said), problems=())


@dataclass(frozen=True, eq=False, kw_only=True)
class _Clip:
    """A clip with players."""

    folder: Path
    scene: Scene
    camera: ClipCamera


def _clips(work: Path) -> list[_Clip]:
    """Clips of the folder that have players.

    Raises:
        ValueError: If there is none.
    """
    candidates = [work, *sorted(work.iterdir())] if work.is_dir() else []
    folders = [f for f in candidates if (f / "players.parquet").is_file() and (f / "clip.json").is_file()]
    if not folders:
        raise ValueError(f"{work}: expected clips with players.parquet, got none")
    return [
        _Clip(
            folder=folder,
            scene=load_scene(read_document(folder / "clip.json", "clip")["scene"]),
            camera=read_clip_camera(folder),
        )
        for folder in folders
    ]


def _tracks(clip: _Clip, options: MotionExport, said: list[str]) -> list[tuple[PlayerTrack, Skeleton]]:
    """The players to write, with a pose in a frame at least."""
    names = [player.name for player in clip.scene.players]
    stray = [name for name in options.players if name not in names]
    if stray:
        expected = ", ".join(names) or "none, as its scene has no player"
        raise ValueError(f"{clip.folder}: players: expected some of {expected}, got {stray[0]!r}")
    tracks = []
    for player, track in zip(clip.scene.players, read_clip_players(clip.folder, clip.scene).players, strict=True):
        if options.players and track.name not in options.players:
            continue
        if len(track.status) != len(clip.camera.timestamp):
            got = f"{len(track.status)} rows for {len(clip.camera.timestamp)} of camera.parquet"
            raise ValueError(f"{clip.folder}: players.parquet: expected a row a frame, got {got}")
        if not _known(track).any():
            said.append(f"{clip.folder.name}: {track.name} has no pose in any frame, so no file")
            continue
        assert player.skeleton is not None
        tracks.append((track, player.skeleton))
    return tracks


def _known(track: PlayerTrack) -> Bool[np.ndarray, " frames"]:
    finite = np.isfinite(track.joint_rotations) & np.isfinite(track.joint_translations)
    return np.asarray(finite.all(axis=(1, 2)) & (track.status != "none"), dtype=bool)


def _rate(times: Float[np.ndarray, " frames"]) -> float:
    steps = np.diff(times)
    steps = steps[steps > 0]
    return float(1 / np.median(steps)) if len(steps) else 1.0


def bvh_of_track(
    track: PlayerTrack, skeleton: Skeleton, camera: ClipCamera, options: MotionExport
) -> tuple[BvhMotion, tuple[str, ...]]:
    """The player as a BVH file holds it, and what had to be changed for that.

    Raises:
        ValueError: If there is no pose in any frame.
    """
    known = _known(track)
    if not known.any():
        raise ValueError(f"{track.name}: joint_rotations: expected a pose in some frame, got none")
    own = np.flatnonzero(known & ~camera.is_duplicate)
    own = own if len(own) else np.flatnonzero(known)[:1]
    first, last = int(own[0]), int(own[-1])
    fresh = np.flatnonzero(~camera.is_duplicate[first : last + 1]) + first if len(own) > 1 else own
    taken = camera.capture_time[fresh]
    steps = np.diff(taken)
    said = []
    step = float(np.median(steps)) if len(steps) else 1 / _rate(camera.timestamp)
    even = taken[0] + step * np.arange(round((taken[-1] - taken[0]) / step) + 1)
    if len(even) == len(taken) and np.abs(even - taken).max() <= EVEN * step:
        even = taken
    else:
        said.append(f"{len(taken)} pictures at uneven times made {len(even)} poses at {1 / step:g} per second")
    gaps = len(fresh) - int(np.isin(fresh, own).sum())
    if gaps:
        said.append(f"{gaps} frames without a pose filled by interpolation")
    rotations, translations = _interpolated(track, own, camera.capture_time[own], even)
    R = R_world_from_file(options.up).T
    rotations[:, 0] = rotvec_from_rotation(R @ rotation_from_rotvec(rotations[:, 0]))
    translations[:, 0] = translations[:, 0] @ R.T
    rest = skeleton.rest_translations * _size(translations, skeleton)
    return (
        BvhMotion(
            joint_names=skeleton.joint_names,
            parents=skeleton.parents,
            offsets=rest / options.unit_m,
            rotations=rotations,
            translations=translations / options.unit_m,
            frame_time=step,
        ),
        tuple(said),
    )


def _size(translations: Float[np.ndarray, "frames joints 3"], skeleton: Skeleton) -> float:
    """Median of the bones' lengths over those of the rest pose; 1 without bones."""
    rest = np.linalg.norm(skeleton.rest_translations[1:], axis=1)
    own = np.linalg.norm(translations[:, 1:], axis=2).mean(axis=0)
    kept = rest > 0
    return float(np.median(own[kept] / rest[kept])) if kept.any() else 1.0


def _interpolated(
    track: PlayerTrack,
    rows: np.ndarray,
    times: Float[np.ndarray, " rows"],
    at: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "n joints 3"], Float[np.ndarray, "n joints 3"]]:
    """Rotations and translations at other times, between those of the rows; exact at theirs."""
    rotations, translations = track.joint_rotations[rows], track.joint_translations[rows]
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
    after = np.minimum(before + 1, len(times) - 1)
    span = np.where(after > before, times[after] - times[before], 1.0)
    share = np.clip((at - times[before]) / span, 0.0, 1.0)[:, None, None]
    R = rotation_from_rotvec(rotations[before])
    turn = rotvec_from_rotation(np.swapaxes(R, -1, -2) @ rotation_from_rotvec(rotations[after]))
    between = rotvec_from_rotation(R @ rotation_from_rotvec(share * turn))
    return between, (1 - share) * translations[before] + share * translations[after]
