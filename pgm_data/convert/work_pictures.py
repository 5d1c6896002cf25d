"""Frames of a work folder's clips as pictures with cameras, for other programs."""

import re
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from pgm_data.convert.posed_pictures import PosedPictures
from pgm_data.convert.timeline import ClipTimeline, FrameOf, LeftOut, ShotRun, Timeline, VideoShots
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import Camera


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkPictures:
    """The frames of a work folder that were chosen for another program."""

    pictures: PosedPictures
    timeline: Timeline
    """Of all frames; says which of them each picture shows, and which chosen ones have no camera."""


def work_pictures(work: Path, *, every: int, folder: str = "", suffix: str = ".jpg") -> WorkPictures:
    """Every `every`-th frame of every clip of the work folder that has a camera.

    Args:
        work: The work folder.
        every: Frames from one picture to the next; 1 takes all.
        folder: Put before each picture's name, which then goes on as `<clip>/<frame><suffix>`.
        suffix: Ending of the names.

    Raises:
        ValueError: If the folder holds no clip, a clip cannot be read, or no chosen frame has a camera.
    """
    if every < 1:
        raise ValueError(f"every: expected at least 1, got {every}")
    folders = sorted(path.parent for path in work.glob("*/clip.json"))
    if not folders:
        raise ValueError(f"{work}: expected a work folder with clips, got no clip.json in its folders")
    tracks = {folder.name: read_clip_camera(folder) for folder in folders}
    clips = {folder.name: clip_timeline(folder, tracks[folder.name]) for folder in folders}
    plain = dict(zip(tracks, plain_names(tuple(tracks)), strict=True))
    shown: dict[str, FrameOf] = {}
    left_out: list[LeftOut] = []
    for clip_id, track in tracks.items():
        for i in range(0, len(track.status), every):
            if track.has_camera[i]:
                shown[f"{folder}{plain[clip_id]}/{i:06d}{suffix}"] = FrameOf(clip_id=clip_id, frame_index=i)
            else:
                left_out.append(LeftOut(clip_id=clip_id, frame_index=i, reason=str(track.reason[i])))
    if not shown:
        raise ValueError(f"{work}: expected frames with a camera, got none among the {len(left_out)} chosen")
    documents = [clips[frame.clip_id].document for frame in shown.values()]
    return WorkPictures(
        pictures=PosedPictures(
            names=tuple(shown),
            sizes=np.array([(document["width"], document["height"]) for document in documents], dtype=np.int64),
            camera=_cameras(tracks, tuple(shown.values())),
            observations=np.zeros(len(shown), dtype=np.int64),
        ),
        timeline=Timeline(clips=clips, pictures=shown, left_out=tuple(left_out), shots=_shots(work, clips)),
    )


def plain_names(names: tuple[str, ...], *, taken: tuple[str, ...] = ()) -> tuple[str, ...]:
    """A folder name for each that every program can read, unlike each other and those taken, also in lower case.

    Letters, digits, dot, dash and underscore are left: COLMAP ends a picture's name at its first space.
    """
    used = {name.lower() for name in taken}
    plain = []
    for name in names:
        stem = re.sub(r"[^A-Za-z0-9._-]", "_", name).lstrip(".") or "clip"
        candidate, number = stem, 2
        while candidate.lower() in used:
            candidate, number = f"{stem}_{number}", number + 1
        used.add(candidate.lower())
        plain.append(candidate)
    return tuple(plain)


def clip_timeline(folder: Path, track: ClipCamera) -> ClipTimeline:
    """The time line of a clip, whose camera table has a row for each of its frames.

    Raises:
        ValueError: If it has not, or its clip.json cannot be read.
    """
    document = read_document(folder / "clip.json", "clip")
    if document["n_frames"] != len(track.status):
        path = folder / "camera.parquet"
        raise ValueError(f"{path}: expected {document['n_frames']} rows, as in clip.json, got {len(track.status)}")
    return ClipTimeline(
        document=document,
        video_frame=track.video_frame,
        timestamp=track.timestamp,
        capture_time=track.capture_time,
        is_duplicate=track.is_duplicate,
        status=tuple(str(word) for word in track.status),
        reason=tuple(str(word) for word in track.reason),
    )


def _shots(work: Path, clips: dict[str, ClipTimeline]) -> dict[str, VideoShots]:
    """What shots.parquet says of the videos of the clips; empty where there is none."""
    path = work / "shots.parquet"
    if not path.exists():
        return {}
    table = read_table(path)
    sources = {clip.document["source_path"] for clip in clips.values()}
    shots = {}
    for video in sorted(sources & set(table["video"])):
        rows = np.flatnonzero(table["video"] == video)
        words = zip(*(table[name][rows] for name in ("verdict", "reason", "clip_id")), strict=True)
        runs = tuple(
            ShotRun(frames=len(list(same)), verdict=verdict, reason=reason, clip_id=clip_id)
            for (verdict, reason, clip_id), same in groupby(words)
        )
        shots[video] = VideoShots(timestamp=table["timestamp"][rows], runs=runs)
    return shots


def _cameras(tracks: dict[str, ClipCamera], frames: tuple[FrameOf, ...]) -> Camera:
    def values(name: str) -> np.ndarray:
        return np.array([getattr(tracks[frame.clip_id].camera, name)[frame.frame_index] for frame in frames])

    return Camera(
        K=values("K"),
        distortion=values("distortion"),
        R_cam_from_world=values("R_cam_from_world"),
        t_cam_from_world=values("t_cam_from_world"),
    )
