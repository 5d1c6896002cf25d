"""Tables of work folders for other programs, a file a clip: what `pgm export coco`, `mot`, `track`, `captions` do."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pgm_data.convert.captions_files import write_captions
from pgm_data.convert.coco_write import coco_document
from pgm_data.convert.exchange import ExportOptions
from pgm_data.convert.frame_pictures import write_frame_pictures
from pgm_data.convert.mot_boxes import write_mot_boxes
from pgm_data.convert.posed_pictures import Problem
from pgm_data.convert.timeline import FrameOf, Timeline
from pgm_data.convert.track_csv import TrackForm, write_track_csv
from pgm_data.convert.work_pictures import clip_timeline, plain_names
from pgm_data.dataset.clip_ball import read_clip_ball
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_captions import read_clip_captions
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene, load_scene


@dataclass(frozen=True, eq=False, kw_only=True)
class TableOutcome:
    """What went out."""

    files: tuple[Path, ...]
    rows: int
    """Boxes, frames with a ball, or texts."""
    problems: tuple[Problem, ...]
    """Clips and pictures that could not be written."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedClip:
    """A clip of the work folder on its way out."""

    folder: Path
    document: dict[str, Any]
    """Its `clip.json`."""
    scene: Scene


def clips_of(work: Path) -> Iterator[ExportedClip]:
    """The clips of a work folder.

    Raises:
        ValueError: If there is none, a clip.json cannot be read, or names a scene that is not shipped.
    """
    folders = sorted(path.parent for path in work.glob("*/clip.json"))
    if not folders:
        raise ValueError(f"{work}: expected a work folder with clips, got no clip.json in its folders")
    for folder in folders:
        document = read_document(folder / "clip.json", "clip")
        yield ExportedClip(folder=folder, document=document, scene=load_scene(document["scene"]))


def export_coco(work: Path, out: Path, options: ExportOptions) -> TableOutcome:
    """Write `<clip>.json` in COCO's keypoints format for every clip with players, and its pictures where asked.

    Pictures go to `images`, which the file names in the JSON are relative to.

    Raises:
        ValueError: If the work folder cannot be read, or none of its clips has players.
    """
    if options.every < 1:
        raise ValueError(f"every: expected at least 1, got {options.every}")
    plain = _plain(work)
    timelines: dict[str, Any] = {}
    shown: dict[str, FrameOf] = {}

    def write(clip: ExportedClip, path: Path) -> int:
        players = read_clip_players(clip.folder, clip.scene)
        clip_id = clip.folder.name
        frames = np.arange(0, len(players.video_frame), options.every)
        names = tuple(f"{plain[clip_id]}/{frame:06d}.{options.picture_format}" for frame in frames)
        size = (clip.document["width"], clip.document["height"])
        content = coco_document(players, clip.scene, frames, names, size)
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(content, allow_nan=False), encoding="utf-8")
        if options.images:
            timelines[clip_id] = clip_timeline(clip.folder, read_clip_camera(clip.folder))
            shown.update(
                {name: FrameOf(clip_id=clip_id, frame_index=f) for name, f in zip(names, frames.tolist(), strict=True)}
            )
        return len(content["annotations"])

    outcome = _export(work, out, "players.parquet", ".json", write)
    timeline = Timeline(clips=timelines, pictures=shown, left_out=(), shots={})
    problems = write_frame_pictures(work, timeline, out / "images", videos=options.videos) if options.images else ()
    return TableOutcome(files=outcome.files, rows=outcome.rows, problems=(*outcome.problems, *problems))


def export_mot(work: Path, out: Path) -> TableOutcome:
    """Write `<clip>.txt` in MOTChallenge's format for every clip with players.

    Raises:
        ValueError: If the work folder cannot be read, or none of its clips has players.
    """

    def write(clip: ExportedClip, path: Path) -> int:
        return write_mot_boxes(path, read_clip_players(clip.folder, clip.scene))

    return _export(work, out, "players.parquet", ".txt", write)


def export_track(work: Path, out: Path, *, form: TrackForm = "plain") -> TableOutcome:
    """Write `<clip>.csv`, the ball's pixels, for every clip with a ball; `pgm-ball3d` reads it back.

    Lost: scores, everything in metres, events, and in the form `tracknet` times and parts of a pixel.

    Raises:
        ValueError: If the work folder cannot be read, or none of its clips has a ball.
    """

    def write(clip: ExportedClip, path: Path) -> int:
        ball = read_clip_ball(clip.folder, read_clip_camera(clip.folder).capture_time)
        write_track_csv(path, frame=ball.video_frame, pixels=ball.pixel, timestamp=ball.timestamp, form=form)
        return int(np.isfinite(ball.pixel).all(axis=1).sum())

    return _export(work, out, "ball.parquet", ".csv", write)


def export_captions(work: Path, out: Path, *, form: Literal["csv", "json", "vtt"] = "csv") -> TableOutcome:
    """Write `<clip>.csv`, `.json` or `.vtt` for every clip with captions.

    Raises:
        ValueError: If the work folder cannot be read, or none of its clips has captions.
    """

    def write(clip: ExportedClip, path: Path) -> int:
        captions = read_clip_captions(clip.folder)
        players = tuple(player.name for player in clip.scene.players)
        write_captions(path, {clip.folder.name: captions}, players)
        return len(captions)

    return _export(work, out, "captions.parquet", f".{form}", write)


def _plain(work: Path) -> dict[str, str]:
    """A name for each clip's folder of pictures."""
    names = tuple(sorted(path.parent.name for path in work.glob("*/clip.json")))
    return dict(zip(names, plain_names(names), strict=True))


def _export(work: Path, out: Path, table: str, suffix: str, write: Callable[[ExportedClip, Path], int]) -> TableOutcome:
    """A file for every clip that has the table."""
    files: list[Path] = []
    problems: list[Problem] = []
    rows = 0
    for clip in clips_of(work):
        if not (clip.folder / table).is_file():
            problems.append(Problem(place=str(clip.folder), field=table, expected="the table", found="nothing there"))
            continue
        out.mkdir(parents=True, exist_ok=True)
        path = out / f"{clip.folder.name}{suffix}"
        rows += write(clip, path)
        files.append(path)
    if not files:
        raise ValueError(
            str(problems[0]) if len(problems) == 1 else f"{work}: {table}: expected it of a clip, got none"
        )
    return TableOutcome(files=tuple(files), rows=rows, problems=tuple(problems))
