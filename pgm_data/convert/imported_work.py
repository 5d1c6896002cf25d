"""A work folder made of pictures with cameras that came from another program.

Pictures that a time line of ours knows go back to their frames. All others are taken by folder: the pictures of one
folder, in the natural order of their names, are the frames of one clip, evenly spaced at a rate that the user states,
because such files hold no times.
"""

import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from pgm_data.convert.posed_pictures import PosedPictures, Problem
from pgm_data.convert.timeline import ClipTimeline, ShotRun, Timeline
from pgm_data.convert.work_pictures import plain_names
from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.tables import write_table
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene

WORK_FILES = ("run.json", "shots.parquet", "report.html")
"""Names in a work folder that no clip may have."""
NOT_IN_FILE = "no camera in the file that was imported"


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """Where pictures came from."""

    path: Path
    """The file that was read."""
    label: str
    """The format, as a person calls it."""
    frames_per_second: float
    """Nominal rate of pictures that bring no times."""


@dataclass(frozen=True, kw_only=True)
class ImportOutcome:
    """What came in."""

    clips: tuple[str, ...]
    pictures: int
    """Pictures whose camera was taken over."""
    nominal_times: tuple[str, ...]
    """Clips whose times were made at the stated rate."""
    problems: tuple[Problem, ...]
    """What could not be taken over."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Clip:
    """A clip about to be written."""

    document: dict[str, Any]
    track: ClipCamera


def write_imported_work(
    out: Path, pictures: PosedPictures, timeline: Timeline | None, *, scene: Scene, source: ForeignFile
) -> ImportOutcome:
    """Write clip.json and camera.parquet of every clip, and shots.parquet, into the work folder."""
    problems: list[Problem] = []
    known, foreign = _rows_by_clip(pictures, timeline)
    clips: list[_Clip] = []
    for clip_id, rows in known.items():
        assert timeline is not None  # it named the clip
        kept = _of_size(timeline.clips[clip_id].document, rows, pictures, source, problems)
        if len(kept):
            clips.append(_known_clip(timeline, clip_id, kept, pictures, scene, source))
    names = _clip_ids(tuple(foreign), source, taken=tuple(known))
    first = 0
    for folder, rows in foreign.items():
        size = {"width": int(pictures.sizes[rows[0], 0]), "height": int(pictures.sizes[rows[0], 1])}
        kept = _of_size(size, rows, pictures, source, problems)
        document = _foreign_document(out, names[folder], first, len(kept), scene, source) | size
        clips.append(_foreign_clip(document, kept, pictures, scene, source))
        first += len(kept)
    for clip in clips:
        path = out / clip.track.clip_id
        path.mkdir(parents=True, exist_ok=True)
        write_clip_camera(path, clip.track, scene=scene)
        write_document(path / "clip.json", "clip", clip.document)
    if clips:
        _write_shots(out, clips, timeline, scene)
    return ImportOutcome(
        clips=tuple(clip.track.clip_id for clip in clips),
        pictures=sum(int(clip.track.has_camera.sum()) for clip in clips),
        nominal_times=tuple(names[folder] for folder in foreign),
        problems=tuple(problems),
    )


def _rows_by_clip(
    pictures: PosedPictures, timeline: Timeline | None
) -> tuple[dict[str, Int[np.ndarray, " rows"]], dict[str, Int[np.ndarray, " rows"]]]:
    """Pictures of each clip of the time line, and of each folder of the others in the order of their names."""
    known: dict[str, list[int]] = {}
    foreign: dict[str, list[int]] = {}
    shown = timeline.pictures if timeline is not None else {}
    for row, name in enumerate(pictures.names):
        if name in shown:
            known.setdefault(shown[name].clip_id, []).append(row)
        else:
            foreign.setdefault(name.rpartition("/")[0], []).append(row)
    for rows in foreign.values():
        rows.sort(key=lambda row: natural_order(pictures.names[row]))
    return (
        {clip_id: np.array(rows) for clip_id, rows in sorted(known.items())},
        {folder: np.array(rows) for folder, rows in sorted(foreign.items())},
    )


def natural_order(name: str) -> tuple[tuple[int, str], ...]:
    """A key that sorts names by the numbers in them: frame_9 before frame_10."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((int(part), "") if i % 2 else (-1, part) for i, part in enumerate(parts))


def _of_size(
    size: dict[str, Any],
    rows: Int[np.ndarray, " rows"],
    pictures: PosedPictures,
    source: ForeignFile,
    problems: list[Problem],
) -> Int[np.ndarray, " kept"]:
    """The rows whose pictures have the clip's size; the others are noted."""
    expected = (size["width"], size["height"])
    right = (pictures.sizes[rows] == expected).all(axis=1)
    for row in rows[~right]:
        problems.append(
            Problem(
                place=f"{source.path}: {pictures.names[row]}",
                field="width, height",
                expected=f"{expected[0]} x {expected[1]}, as its clip has",
                found=" x ".join(map(str, pictures.sizes[row])),
            )
        )
    return rows[right]


def _clip_ids(folders: tuple[str, ...], source: ForeignFile, taken: tuple[str, ...]) -> dict[str, str]:
    """A clip's name for each folder: its path, or the source's name where that would say nothing."""
    stem = source.path.stem if source.path.stem not in ("images", "transforms") else source.path.absolute().parent.name
    raw = tuple(folder.replace("/", "_") if folder not in ("", "images") else stem for folder in folders)
    return dict(zip(folders, plain_names(raw, taken=(*taken, *WORK_FILES)), strict=True))


def _known_clip(
    timeline: Timeline,
    clip_id: str,
    rows: Int[np.ndarray, " rows"],
    pictures: PosedPictures,
    scene: Scene,
    source: ForeignFile,
) -> _Clip:
    """A clip of the time line, with the cameras that came back; frames without one have status `none`."""
    clip = timeline.clips[clip_id]
    frames = np.array([timeline.pictures[pictures.names[row]].frame_index for row in rows])
    status = np.full(len(clip.status), "none", dtype=object)
    status[frames] = [clip.status[i] for i in frames]
    # A camera for a frame that had none is the other program's own measurement.
    status[frames[status[frames] == "none"]] = "measured"
    reason = np.array(clip.reason, dtype=object)
    reason[status == "measured"] = ""
    none = status == "none"
    reason[none] = [words or NOT_IN_FILE for words in reason[none]]
    track = _track(clip_id, clip, status, reason, frames, pictures, rows)
    document = {key: value for key, value in clip.document.items() if key != "camera"}
    document |= _own_words(track, scene, source)
    return _Clip(document=document, track=track)


def _foreign_document(
    out: Path, clip_id: str, first: int, frames: int, scene: Scene, source: ForeignFile
) -> dict[str, Any]:
    step = 1 / Fraction(source.frames_per_second).limit_denominator(1001)
    return {
        "clip_id": clip_id,
        "match_id": clip_id,
        "source_path": _relative(source.path, out),
        "sha256": sha256_of(source.path),
        "bytes": source.path.stat().st_size,
        "time_base": f"{step.numerator}/{step.denominator}",
        "first_video_frame": first,
        "n_frames": frames,
        "scene": scene.name,
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {},
    }


def _relative(path: Path, out: Path) -> str:
    """The path from the folder that the work folder stands in, else the bare name."""
    try:
        below = path.resolve().relative_to(out.resolve().parent)
    except ValueError:
        return path.name
    return "../" + below.as_posix()


def _foreign_clip(
    document: dict[str, Any], rows: Int[np.ndarray, " rows"], pictures: PosedPictures, scene: Scene, source: ForeignFile
) -> _Clip:
    """A clip of pictures that no time line knows."""
    frames = np.arange(len(rows))
    video_frame = frames + document["first_video_frame"]
    times = video_frame / source.frames_per_second
    clip = ClipTimeline(
        document=document,
        video_frame=video_frame,
        timestamp=times,
        capture_time=times,
        is_duplicate=np.zeros(len(rows), dtype=bool),
        status=("measured",) * len(rows),
        reason=("",) * len(rows),
    )
    status, reason = np.array(clip.status, dtype=object), np.array(clip.reason, dtype=object)
    track = _track(document["clip_id"], clip, status, reason, frames, pictures, rows)
    return _Clip(document=document | _own_words(track, scene, source), track=track)


def _track(
    clip_id: str,
    clip: ClipTimeline,
    status: np.ndarray,
    reason: np.ndarray,
    frames: Int[np.ndarray, " rows"],
    pictures: PosedPictures,
    rows: Int[np.ndarray, " rows"],
) -> ClipCamera:
    total = len(clip.status)

    def spread(values: np.ndarray) -> np.ndarray:
        all_frames = np.full((total, *values.shape[1:]), np.nan)
        all_frames[frames] = values[rows]
        return all_frames

    inliers = np.zeros(total, dtype=np.int64)
    inliers[frames] = pictures.observations[rows]
    camera = pictures.camera
    return ClipCamera(
        clip_id=clip_id,
        video_frame=clip.video_frame,
        timestamp=clip.timestamp,
        is_duplicate=clip.is_duplicate,
        capture_time=clip.capture_time,
        camera=Camera(
            K=spread(camera.K),
            distortion=spread(camera.distortion),
            R_cam_from_world=spread(camera.R_cam_from_world),
            t_cam_from_world=spread(camera.t_cam_from_world),
        ),
        status=status,
        reason=reason,
        inliers=inliers,
        # Other programs do not say how well these fit, nor how sure they are.
        reprojection_px=np.full(total, np.nan),
        position_cov=np.full((total, 6), np.nan),
        focal_std_px=np.full(total, np.nan),
    )


def _own_words(track: ClipCamera, scene: Scene, source: ForeignFile) -> dict[str, Any]:
    """What the clip's file says that follows from the import."""
    used = np.nan_to_num(track.camera.distortion)
    terms = [name for name, values in zip(("k1", "k2", "p1", "p2"), used.T, strict=True) if values.any()]
    return {
        "scene": scene.name,
        "quality": "imported",
        "lens_model": {"model": " ".join(terms) or "pinhole", "reason": f"as in the {source.label} file"},
        "solved_share": float(track.has_camera.mean()),
    }


def _write_shots(out: Path, clips: list[_Clip], timeline: Timeline | None, scene: Scene) -> None:
    """Every frame of every video that is known: as the time line has it, or the pictures of foreign clips."""
    written = {clip.track.clip_id for clip in clips}
    runs: list[tuple[str, np.ndarray, ShotRun]] = []
    for video, shots in (timeline.shots if timeline is not None else {}).items():
        ends = np.cumsum([run.frames for run in shots.runs])
        for run, end in zip(shots.runs, ends, strict=True):
            if run.clip_id and run.clip_id not in written:
                run = ShotRun(frames=run.frames, verdict="other", reason=NOT_IN_FILE, clip_id="")
            runs.append((video, np.arange(end - run.frames, end), run))
    times = {video: shots.timestamp for video, shots in (timeline.shots if timeline is not None else {}).items()}
    for clip in clips:
        video, track = clip.document["source_path"], clip.track
        if timeline is None or track.clip_id not in timeline.clips:
            run = ShotRun(frames=len(track.status), verdict="clip", reason="", clip_id=track.clip_id)
            runs.append((video, track.video_frame, run))
            times[video] = np.concatenate([times.get(video, np.zeros(0)), track.timestamp])
    if not runs:
        return  # clips came back, but their work folder had no shots.parquet
    columns = {
        "video": [video for video, _, run in runs for _ in range(run.frames)],
        "video_frame": np.concatenate([frames for _, frames, _ in runs]),
        "timestamp": np.concatenate([times[video][frames] for video, frames, _ in runs]),
        "verdict": [run.verdict for _, _, run in runs for _ in range(run.frames)],
        "reason": [run.reason for _, _, run in runs for _ in range(run.frames)],
        "clip_id": [run.clip_id for _, _, run in runs for _ in range(run.frames)],
    }
    write_table(out / "shots.parquet", table="shots", scene=scene, columns=columns)
