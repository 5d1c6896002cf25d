"""A Playable Environments dataset as a work folder.

`ROOT/{train,val,test}/<sequence>/<camera>/`, or one of its splits, or a folder of sequences; every camera of every
sequence becomes a clip, named after its folders: `train_00012`, with `_00001` where there are several cameras. Folder
names are kept as they are: in that dataset a sequence's number is its rank among the source's cut videos, so one video
that was missing when it was made shifts all later numbers, and nothing here can tell.

Which match a sequence is of is not stored, and videos of `test` occur in `train` too, so all clips get one `match_id`
and `pgm pack` keeps them in one split; write the match into each clip.json where it is known. Times are nominal.
Pictures are encoded as `videos/<clip>.mp4` in the work folder (or not at all: then `bytes` is 0, as of simulated
states).

Lost: actions, rewards, dones, metadata (made up in the tennis set), object poses and optical flow; keypoints, whose
order of joints is nowhere stated, unless they are said to be COCO's. There is no way back: its loader takes no
distortion and no principal point beside the middle, and has no place for a ball, a skeleton, words or times.
"""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from pgm_data.convert.coco_people import COCO_POINTS
from pgm_data.convert.foreign_people import boxes_with_centre_origin
from pgm_data.convert.imported_work import ImportOutcome
from pgm_data.convert.playable_files import PlayableVideo, crop_is_whole, playable_camera, read_playable_video
from pgm_data.convert.posed_pictures import LARGEST_SIDE, FieldError, Problem
from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack, write_clip_players
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.tables import write_table
from pgm_data.inputs import clean_name
from pgm_data.scene import Scene, SceneObject
from pgm_data.video import write_video

SPLITS = ("train", "val", "test")
FOLDER_NUMBER = re.compile("[0-9]{1,9}", re.ASCII)
FOCAL_SIZES = {"tennis": (996, 560), "blocks": (1024, 576)}
"""Width and height that focal lengths are of, by scene: the tennis set's pictures are smaller than that (512 x 288)."""
NO_CAMERA = "a made-up camera of the loader (focal length 0 or 1)"
VIDEO_CRF = 10
"""x264's quality of the encoded pictures: no difference that an eye sees."""


@dataclass(frozen=True, kw_only=True)
class PlayableOptions:
    """How a dataset is taken."""

    fps: float = 5.0
    """Frames per second; the tennis set was cut at 5."""
    focal_size: tuple[int, int] | None = None
    """Width and height of the pictures that focal lengths are of, px; None for those of the published sets."""
    pictures: Literal["video", "none"] = "video"
    """Whether pictures are encoded as videos."""
    keypoints: Literal["none", "coco"] = "none"
    """Whether keypoints are taken, as COCO's 17 in its order."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not 0.001 <= self.fps <= 1000:
            raise ValueError(f"fps: expected 0.001 to 1000, got {self.fps}")
        if self.focal_size is not None and not all(1 <= side <= LARGEST_SIDE for side in self.focal_size):
            raise ValueError(f"focal_size: expected 1 to {LARGEST_SIDE} px, got {self.focal_size}")


@dataclass(frozen=True, eq=False, kw_only=True)
class _Take:
    """What is the same for all clips."""

    out: Path
    scene: Scene
    options: PlayableOptions
    match_id: str
    focal_size: tuple[int, int]
    step: Fraction
    """Seconds from frame to frame."""


def import_playable(root: Path, out: Path, *, scene: Scene, options: PlayableOptions | None = None) -> ImportOutcome:
    """Write a clip for every camera of every sequence, and shots.parquet, into the work folder.

    A sequence that is damaged is left out, and its first fault is among the problems.

    Args:
        root: The dataset, one of its splits, or a folder of sequences.
        out: The work folder.
        scene: What it shows: tennis, or blocks for Minecraft, whose world has y up.
        options: How it is taken.

    Raises:
        ValueError: If there is no sequence at all, or nobody knows what its focal lengths are of.
    """
    options = options or PlayableOptions()
    focal_size = options.focal_size or FOCAL_SIZES.get(scene.name)
    if focal_size is None:
        raise ValueError(f"focal_size: expected the picture size that focal lengths are of, got none for {scene.name}")
    step = 1 / Fraction(options.fps).limit_denominator(1001)
    match_id = clean_name(root.resolve().name)
    take = _Take(out=out, scene=scene, options=options, match_id=match_id, focal_size=focal_size, step=step)
    problems: list[Problem] = []
    tracks: list[tuple[str, ClipCamera]] = []
    found = False
    for clip_id, folder, beside in _videos(root, problems):
        found = True
        try:
            tracks.append(_write_clip(take, clip_id, folder, beside))
        except FieldError as error:
            problems.append(error.at(str(folder)))
    if not found:
        raise ValueError(f"{root}: expected train/00000/00000 or the like, with 00000.png in it, got none")
    if tracks:
        _write_shots(take, tracks)
    return ImportOutcome(
        clips=tuple(track.clip_id for _, track in tracks),
        pictures=sum(int(track.has_camera.sum()) for _, track in tracks),
        nominal_times=tuple(track.clip_id for _, track in tracks),
        problems=tuple(problems),
    )


def _videos(root: Path, problems: list[Problem]) -> Iterator[tuple[str, Path, tuple[Path, ...]]]:
    """The clip's name, the folder of its camera and those of the sequence's other cameras."""
    splits = [root / name for name in SPLITS if (root / name).is_dir()] or [root]
    for split in splits:
        prefix = split.name if split.name in SPLITS else clean_name(split.resolve().name)
        for sequence in sorted(path for path in split.iterdir() if path.is_dir()):
            cameras = tuple(sorted(path for path in sequence.iterdir() if path.is_dir() and _is_number(path)))
            if not _is_number(sequence) or not cameras:
                expected = "a number as its name, and folders of cameras in it"
                problems.append(Problem(place=str(sequence), field="folder", expected=expected, found="neither or one"))
                continue
            for camera in cameras:
                clip_id = f"{prefix}_{sequence.name}" + (f"_{camera.name}" if len(cameras) > 1 else "")
                yield clip_id, camera, tuple(other for other in cameras if other != camera)


def _is_number(path: Path) -> bool:
    return FOLDER_NUMBER.fullmatch(path.name) is not None


def _write_clip(take: _Take, clip_id: str, folder: Path, beside: tuple[Path, ...]) -> tuple[str, ClipCamera]:
    """Write one clip; the path of its video, and its cameras.

    Raises:
        FieldError: If its files are not what they must be; then nothing is written.
    """
    video = read_playable_video(folder)
    if not crop_is_whole(folder):
        raise FieldError("crop_region.pkl", "the whole picture, as cameras and boxes are of it", "a part of it")
    for other in beside:
        frames = sum(1 for path in other.iterdir() if path.suffix == video.pictures[0].suffix)
        if frames != len(video.pictures):
            raise FieldError("frames", f"as many as camera {other.name} has, {frames}", str(len(video.pictures)))
    players = _players(take, clip_id, video)
    track = _track(take, clip_id, video)
    source_path, size = f"videos/{clip_id}.mp4", video.size
    path = take.out / source_path
    if take.options.pictures == "video":
        path.parent.mkdir(parents=True, exist_ok=True)
        write_video(path, _pictures(video), fps=1 / take.step, crf=VIDEO_CRF)
        size = (size[0] + size[0] % 2, size[1] + size[1] % 2)  # as videos are, which have even sides
    clip = take.out / clip_id
    clip.mkdir(parents=True)
    write_clip_camera(clip, track, scene=take.scene)
    if take.scene.players:
        write_clip_players(clip, players, scene=take.scene)
    drawn = path.is_file()
    reason = f"as in the dataset; focal lengths are of {take.focal_size[0]} x {take.focal_size[1]} px, the middle is"
    document = {
        "clip_id": clip_id,
        "match_id": take.match_id,
        "source_path": source_path,
        "sha256": sha256_of(path) if drawn else hashlib.sha256().hexdigest(),
        "bytes": path.stat().st_size if drawn else 0,
        "width": size[0],
        "height": size[1],
        "time_base": f"{take.step.numerator}/{take.step.denominator}",
        "first_video_frame": 0,
        "n_frames": len(video.pictures),
        "scene": take.scene.name,
        "quality": "imported",
        "lens_model": {"model": "pinhole", "reason": f"{reason} (width / 2, height / 2), as its renderer has it"},
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {},
        "solved_share": float(track.has_camera.mean()),
    }
    write_document(clip / "clip.json", "clip", document)
    return source_path, track


def _pictures(video: PlayableVideo) -> Iterator[np.ndarray]:
    for path in video.pictures:
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if picture is None or (picture.shape[1], picture.shape[0]) != video.size:
            got = "no picture" if picture is None else f"{picture.shape[1]} x {picture.shape[0]}"
            raise FieldError(path.name, f"a picture of {video.size[0]} x {video.size[1]}, as the first", got)
        yield picture


def _track(take: _Take, clip_id: str, video: PlayableVideo) -> ClipCamera:
    frames = len(video.pictures)
    times = np.arange(frames) * float(take.step)
    there = video.has_camera
    return ClipCamera(
        clip_id=clip_id,
        video_frame=np.arange(frames),
        timestamp=times,
        is_duplicate=np.zeros(frames, dtype=bool),
        capture_time=times,
        camera=playable_camera(video, take.focal_size, y_up=take.scene.court is None),
        status=np.where(there, "measured", "none").astype(object),
        reason=np.where(there, "", NO_CAMERA).astype(object),
        inliers=np.zeros(frames, dtype=np.int64),
        # The dataset does not say how well its cameras fit, nor how sure they are.
        reprojection_px=np.full(frames, np.nan),
        position_cov=np.full((frames, 6), np.nan),
        focal_std_px=np.full(frames, np.nan),
    )


def _players(take: _Take, clip_id: str, video: PlayableVideo) -> ClipPlayers:
    """The objects as players: boxes, and keypoints where asked; where in the world they are is not known."""
    players, objects = take.scene.players, video.boxes.shape[1]
    if objects != len(players):
        if np.isfinite(video.boxes).any():
            expected = f"{len(players)} objects, the players of scene {take.scene.name}"
            raise FieldError("bounding_boxes.pkl", expected, objects)
        boxes = np.full((len(video.pictures), len(players), 4), np.nan)
    else:
        boxes = boxes_with_centre_origin(video.boxes * np.tile(video.size, 2))
    points = video.keypoints if take.options.keypoints == "coco" else None
    if points is not None and points.shape[2] != len(COCO_POINTS):
        raise FieldError("keypoints.pkl", f"COCO's {len(COCO_POINTS)} points", points.shape[2])
    if points is not None and not ((points[..., 2] >= 0) & (points[..., 2] <= 1) | np.isnan(points[..., 2])).all():
        raise FieldError("keypoints.pkl", "confidences of 0 to 1", "others")
    frames = len(video.pictures)
    return ClipPlayers(
        clip_id=clip_id,
        video_frame=np.arange(frames),
        timestamp=np.arange(frames) * float(take.step),
        players=tuple(
            _player(player, boxes[:, i], None if points is None else points[:, i], video.size)
            for i, player in enumerate(players)
        ),
    )


def _player(player: SceneObject, boxes: np.ndarray, points: np.ndarray | None, size: tuple[int, int]) -> PlayerTrack:
    assert player.skeleton is not None
    frames, joints = len(boxes), len(player.skeleton.joint_names)
    names = player.skeleton.keypoint_names
    keypoints, score = np.full((frames, len(names), 2), np.nan), np.full((frames, len(names)), np.nan)
    for place, name in enumerate(COCO_POINTS if points is not None else ()):
        if points is not None and name in names:
            keypoints[:, names.index(name)] = points[:, place, :2] * np.array(size) - 0.5
            score[:, names.index(name)] = points[:, place, 2]

    def unknown(*shape: int) -> np.ndarray:
        return np.full((frames, *shape), np.nan)

    return PlayerTrack(
        name=player.name,
        identity=np.full(frames, "", dtype=object),
        box_px=boxes,
        keypoints_px=keypoints,
        keypoint_score=score,
        root_position=unknown(3),
        joints=unknown(joints, 3),
        joint_rotations=unknown(joints, 3),
        joint_translations=unknown(joints, 3),
        root_cov=unknown(3, 3),
        contact=unknown(2),
        reprojection_px=unknown(),
        status=np.full(frames, "none", dtype=object),
    )


def _write_shots(take: _Take, tracks: list[tuple[str, ClipCamera]]) -> None:
    """Every frame of every video, all of them in clips."""
    counts = [len(track.status) for _, track in tracks]
    columns = {
        "video": np.repeat([source for source, _ in tracks], counts).tolist(),
        "video_frame": np.concatenate([track.video_frame for _, track in tracks]),
        "timestamp": np.concatenate([track.timestamp for _, track in tracks]),
        "verdict": ["clip"] * sum(counts),
        "reason": [""] * sum(counts),
        "clip_id": np.repeat([track.clip_id for _, track in tracks], counts).tolist(),
    }
    write_table(take.out / "shots.parquet", table="shots", scene=take.scene, columns=columns)
