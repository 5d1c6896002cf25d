"""Work folders exchanged with other programs: what `pgm export` and `pgm import` do."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pgm_data.convert.colmap import model_folder, read_colmap, write_colmap
from pgm_data.convert.frame_pictures import write_frame_pictures
from pgm_data.convert.imported_work import ForeignFile, ImportOutcome, write_imported_work
from pgm_data.convert.nerfstudio import read_nerfstudio, write_nerfstudio
from pgm_data.convert.posed_pictures import PosedPictures, Problem
from pgm_data.convert.timeline import TIMELINE_FILE, TIMELINE_KEY, Timeline, json_from_timeline, timeline_from_json
from pgm_data.convert.work_pictures import WorkPictures, work_pictures
from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene

DEFAULT_SCENE = "tennis"
"""Scene of pictures that bring no time line, where the user names none."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Which frames go out, and whether as pictures too."""

    every: int = 30
    """Frames from one picture to the next."""
    images: bool = False
    """Write the frames as picture files."""
    picture_format: Literal["jpg", "png"] = "jpg"
    """Of those files."""
    videos: Path | None = None
    """Folder of the videos, where they are no longer where they were."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportOutcome:
    """What went out."""

    pictures: int
    timeline: Timeline
    """Says which frames were left out, and why."""
    problems: tuple[Problem, ...]
    """Picture files that could not be written."""


def export_colmap(work: Path, out: Path, options: ExportOptions, *, text: bool) -> ExportOutcome:
    """Write `sparse/0`, `pgm.json` and, where asked, `images` into the folder.

    Raises:
        ValueError: If the work folder cannot be read, or has no camera to write.
    """
    chosen = work_pictures(work, every=options.every, suffix=f".{options.picture_format}")
    write_colmap(out / "sparse" / "0", chosen.pictures, text=text)
    with whole_file(out / TIMELINE_FILE) as temporary:
        content = json.dumps(json_from_timeline(chosen.timeline), allow_nan=False, ensure_ascii=True)
        temporary.write_text(content, encoding="utf-8")
    return _with_pictures(work, chosen, out / "images", options)


def export_nerfstudio(work: Path, out: Path, options: ExportOptions) -> ExportOutcome:
    """Write `transforms.json` and, where asked, `images` into the folder.

    Raises:
        ValueError: If the work folder cannot be read, or has no camera to write.
    """
    chosen = work_pictures(work, every=options.every, folder="images/", suffix=f".{options.picture_format}")
    extra = {TIMELINE_KEY: json_from_timeline(chosen.timeline)}
    write_nerfstudio(out / "transforms.json", chosen.pictures, extra=extra)
    return _with_pictures(work, chosen, out, options)


def _with_pictures(work: Path, chosen: WorkPictures, folder: Path, options: ExportOptions) -> ExportOutcome:
    problems = write_frame_pictures(work, chosen.timeline, folder, videos=options.videos) if options.images else ()
    return ExportOutcome(pictures=len(chosen.pictures.names), timeline=chosen.timeline, problems=problems)


def import_colmap(folder: Path, out: Path, *, scene: str | None, frames_per_second: float) -> ImportOutcome:
    """Write the cameras of a COLMAP model as a work folder.

    Args:
        folder: The model's folder, or one with `sparse/0` in it; `pgm.json` is looked for there and above the model.
        out: The work folder.
        scene: Name or file; None for that of the time line, else tennis.
        frames_per_second: Nominal rate of pictures that bring no times.

    Raises:
        ValueError: If there is no model, or its files cannot be read at all.
    """
    pictures, problems, path = read_colmap(folder)
    model = model_folder(folder).absolute()
    places = [place / TIMELINE_FILE for place in (folder.absolute(), model, model.parent, model.parent.parent)]
    beside = next((place for place in places if place.is_file()), None)
    timeline = timeline_from_json(str(beside), _json(beside)) if beside is not None else None
    source = ForeignFile(path=path, label="COLMAP", frames_per_second=frames_per_second)
    return _imported(out, pictures, problems, timeline, scene, source)


def import_nerfstudio(path: Path, out: Path, *, scene: str | None, frames_per_second: float) -> ImportOutcome:
    """Write the cameras of a transforms.json, or of the one in the folder, as a work folder.

    Args:
        path: The file, or its folder.
        out: The work folder.
        scene: Name or file; None for that of the time line, else tennis.
        frames_per_second: Nominal rate of pictures that bring no times.

    Raises:
        ValueError: If the file cannot be read at all.
    """
    path = path / "transforms.json" if path.is_dir() else path
    pictures, problems, content = read_nerfstudio(path)
    timeline = timeline_from_json(f"{path}: {TIMELINE_KEY}", content[TIMELINE_KEY]) if TIMELINE_KEY in content else None
    source = ForeignFile(path=path, label="nerfstudio", frames_per_second=frames_per_second)
    return _imported(out, pictures, problems, timeline, scene, source)


def _imported(
    out: Path,
    pictures: PosedPictures,
    problems: tuple[Problem, ...],
    timeline: Timeline | None,
    scene: str | None,
    source: ForeignFile,
) -> ImportOutcome:
    stated = sorted({clip.document["scene"] for clip in timeline.clips.values()}) if timeline is not None else []
    if scene is None and len(stated) > 1:
        raise ValueError(f"{source.path}: expected clips of one scene, got {', '.join(stated)}: name one")
    chosen = load_scene(scene or (stated[0] if stated else DEFAULT_SCENE))
    outcome = write_imported_work(out, pictures, timeline, scene=chosen, source=source)
    return ImportOutcome(
        clips=outcome.clips,
        pictures=outcome.pictures,
        nominal_times=outcome.nominal_times,
        problems=(*problems, *outcome.problems),
    )


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected a JSON file, got: {error}") from error
