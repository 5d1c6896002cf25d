"""Labels that a person mended, as the files that the stages take, beside the clip they are about."""

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pgm_data.convert.captions_files import write_captions
from pgm_data.convert.clip_labels import ClipLabels, clip_labels
from pgm_data.convert.cvat_labels import read_cvat_labels, write_cvat_labels
from pgm_data.convert.exchange_tables import TableOutcome, clips_of
from pgm_data.convert.label_studio_labels import read_label_studio_labels, write_label_studio_labels
from pgm_data.convert.posed_pictures import Problem
from pgm_data.convert.track_csv import write_track_csv
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_captions import CaptionRows
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.files import whole_file
from pgm_data.scene import Scene, load_scene

Form = Literal["cvat", "label-studio"]
SUFFIXES: dict[Form, str] = {"cvat": ".xml", "label-studio": ".json"}
FOLDER = "corrected"
"""In a clip's folder: files that the stages take."""
DECIMALS = 4
"""Of pixels."""


@dataclass(frozen=True, kw_only=True)
class Corrections:
    """What came back for a clip."""

    files: tuple[Path, ...]
    commands: tuple[str, ...]
    """Commands that take the files in."""
    ui_boxes: int
    """Graphics that now stand in clip.json."""
    left_out: tuple[str, ...]
    """Lines about labels that are none of ours."""


def export_labels(work: Path, out: Path, *, form: Form) -> TableOutcome:
    """Write `<clip>.xml` or `<clip>.json` with every clip's labels, for a person to mend.

    Raises:
        ValueError: If the work folder cannot be read or holds no clips.
    """
    files, rows, problems = [], 0, []
    for clip in clips_of(work):
        path = out / f"{clip.folder.name}{SUFFIXES[form]}"
        players = tuple(player.name for player in clip.scene.players)
        try:
            labels = clip_labels(clip.folder, clip.scene)
            write = write_cvat_labels if form == "cvat" else write_label_studio_labels
            write(path, labels, players)
        except ValueError as error:
            problems.append(
                Problem(place=str(clip.folder), field="tables", expected="a clip that can be read", found=str(error))
            )
            continue
        files.append(path)
        rows += len(labels.box_name) + len(labels.ball_frame) + len(labels.point_name)
    return TableOutcome(files=tuple(files), rows=rows, problems=tuple(problems))


def import_labels(path: Path, folder: Path, *, form: Form) -> Corrections:
    """Take a person's labels of one clip: files beside the clip for the stages to take, graphics into clip.json.

    Args:
        path: The export of the program.
        folder: The clip's folder.
        form: The program.

    Raises:
        ValueError: If the file or the clip cannot be read, or nothing in it is about the clip.
    """
    document = read_document(folder / "clip.json", "clip")
    scene = load_scene(document["scene"])
    players = tuple(player.name for player in scene.players)
    points = scene.court.point_names if scene.court is not None else ()
    read = read_cvat_labels if form == "cvat" else read_label_studio_labels
    labels, strange = read(path, clip_labels(folder, scene), players, points)
    target, work = folder / FOLDER, folder.parent
    target.mkdir(exist_ok=True)
    files, commands = _write(target, folder, labels, scene, work)
    if len(labels.ui_px):
        boxes = np.round(labels.ui_px, DECIMALS).tolist()
        write_document(folder / "clip.json", "clip", document | {"ui_boxes_px": boxes})
    if not files and not len(labels.ui_px):
        last = labels.first_frame + labels.frames - 1
        got = f"none; {strange[0]}" if strange else "none"
        raise ValueError(f"{path}: expected labels in frames {labels.first_frame} to {last} of the video, got {got}")
    return Corrections(files=tuple(files), commands=tuple(commands), ui_boxes=len(labels.ui_px), left_out=strange)


def _write(target: Path, folder: Path, labels: ClipLabels, scene: Scene, work: Path) -> tuple[list[Path], list[str]]:
    """The files, and the commands that take them in."""
    name = folder.name
    files, commands = [], []
    if len(labels.point_name):
        video = Path(labels.video).name
        rows = [
            (video, frame, point, f"{x:.{DECIMALS}f}", f"{y:.{DECIMALS}f}")
            for point, frame, (x, y) in zip(
                labels.point_name, labels.point_frame.tolist(), labels.point_px.tolist(), strict=True
            )
        ]
        files.append(_csv(target / "keypoints.csv", ("video", "frame", "name", "x", "y"), rows))
        commands.append(f"pgm-calibrate VIDEO --out NEW_WORK --keypoints {files[-1]}")
    if len(labels.box_name):
        number = {player.name: i for i, player in enumerate(scene.players, 1)}
        corners = labels.box_px + [0.5, 0.5, 0.5, 0.5]
        rows = sorted(
            (frame + 1, number[str(who)], *(f"{v:.{DECIMALS}f}" for v in (x0, y0, x1 - x0, y1 - y0)), 1, -1, -1, -1)
            for who, frame, (x0, y0, x1, y1) in zip(
                labels.box_name, labels.box_frame.tolist(), corners.tolist(), strict=True
            )
        )
        files.append(_csv(target / "boxes.csv", (), rows))
        commands.append(f"pgm players {work} --clip {name} --boxes {files[-1]} --overwrite")
    if len(labels.ball_frame):
        timestamp = read_clip_camera(folder).timestamp[labels.ball_frame - labels.first_frame]
        files.append(target / "track.csv")
        write_track_csv(files[-1], frame=labels.ball_frame, pixels=labels.ball_px, timestamp=timestamp)
        camera = folder / "camera.parquet"
        commands.append(f"pgm-ball3d {files[-1]} --camera {camera} --out NEW_FOLDER")
    if len(labels.event_frame):
        rows = [(f, str(k), "", "") for f, k in zip(labels.event_frame.tolist(), labels.event_kind, strict=True)]
        files.append(_csv(target / "events.csv", ("frame", "kind", "x", "y"), rows))
        commands.append(f"pgm-ball3d {work} --clip {name} --events {files[-1]} --overwrite")
    if len(labels.text):
        files.append(target / "captions.csv")
        write_captions(
            files[-1], {name: _captions(labels, folder, scene)}, tuple(player.name for player in scene.players)
        )
        commands.append(f"pgm caption {work} --clip {name} --from {files[-1]} --source human --overwrite")
    return files, commands


def _captions(labels: ClipLabels, folder: Path, scene: Scene) -> CaptionRows:
    """The texts as rows of captions."""
    times = read_clip_camera(folder).capture_time
    start, end = labels.text_start - labels.first_frame, labels.text_end - labels.first_frame
    names = [player.name for player in scene.players]
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return CaptionRows(
        player=np.array([names.index(str(name)) for name in labels.text_name], dtype=np.int32),
        start_frame=start,
        end_frame=end,
        start_s=times[start],
        end_s=np.where(end < len(times), times[np.minimum(end, len(times) - 1)], times[-1] + step),
        text=labels.text,
        source=np.full(len(start), "human", dtype=object),
        alternative=np.zeros(len(start), dtype=np.int32),
    )


def _csv(path: Path, head: tuple[str, ...], rows: list) -> Path:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if head:
        writer.writerow(head)
    writer.writerows(rows)
    with whole_file(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
    return path
