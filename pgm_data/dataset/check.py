"""Files, work folders and datasets against the contract: schemas, frame alignment, references and physics.

Nothing that is read is trusted: no object is unpickled, no path of a document is opened, and what is
too large to be one of ours is not read.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from pgm_data.dataset.clip_ball import BALL_TABLES
from pgm_data.dataset.clip_check import CheckedClip, check_clip, shipped_scene
from pgm_data.dataset.clip_laws import ball_event_faults, flight_event_faults
from pgm_data.dataset.columns import TABLES, table_names
from pgm_data.dataset.dataset_check import check_dataset, is_dataset
from pgm_data.dataset.document_schemas import document_kinds
from pgm_data.dataset.documents import YAML_SUFFIXES, Fault, parse_document
from pgm_data.dataset.findings import Checked, Findings, Violation
from pgm_data.dataset.laws import Context, as_text
from pgm_data.dataset.table_check import checked_table
from pgm_data.dataset.tables import open_table
from pgm_data.scene import Scene

STATE_FOLDER = ".pgm"
"""Folder of a run's own state inside its output; no part of the contract."""

LEFTOVER = re.compile(r"^\..*\.\d+(\.tmp|\.part(\.\w+)?)?$|\.(tmp|part|partial)$|~$")
"""Names of unfinished files, which a killed run leaves behind."""

STAGE_RUNS = ("run_players.json", "run_ball3d.json", "run_caption.json")
"""Documents of the stages that work on a work folder, where they ran."""
DOCUMENT_NAMES = {
    "clip.json": "clip",
    "run.json": "run",
    **dict.fromkeys(STAGE_RUNS, "run"),
    "camera.json": "camera",
    "info.json": "dataset_info",
    "prompt.json": "prompt",
}


def file_kinds() -> tuple[str, ...]:
    """Kinds of single files: documents and tables."""
    return document_kinds() + tuple(name for name in table_names() if name not in document_kinds())


def check_paths(paths: Sequence[Path]) -> list[Violation]:
    """Every way in which the files, clip folders, work folders and datasets at the paths miss the contract.

    Raises:
        ValueError: If there is nothing at a path.
    """
    return list(examine(paths).violations)


def examine(paths: Sequence[Path], *, kind: str = "", scene: Scene | None = None) -> Checked:
    """The files at and below the paths that were looked at, and every violation.

    Args:
        paths: Files, clip folders, work folders and datasets.
        kind: What single files are whose name does not tell: one of `file_kinds`.
        scene: Taken in place of the scene that the files name, for a scene that does not ship with the package.

    Raises:
        ValueError: If there is nothing at a path, or no such kind.
    """
    if kind and kind not in file_kinds():
        raise ValueError(f"kind: expected one of {', '.join(file_kinds())}, got {kind!r}")
    for path in paths:
        if not path.exists():
            raise ValueError(f"{path}: expected a file or a folder, got nothing there")
    findings = Findings(scene=scene, kind=kind)
    for path in paths:
        if path.is_dir():
            _check_folder(path, findings)
        else:
            _check_file(path, findings)
    return Checked(files=tuple(findings.files), violations=tuple(findings.violations))


def _check_folder(path: Path, findings: Findings) -> None:
    """A clip, a dataset, a work folder, the tables of a foreign track, or a simulator's `work` and `dataset`."""
    own = ("run.json", "shots.parquet")
    inner = [path / name for name in ("work", "dataset") if (path / name).is_dir()]
    if (path / "clip.json").exists():
        _check_clip(path, findings)
    elif is_dataset(path):
        for folder in (path, *sorted(p for p in path.rglob("*") if p.is_dir())):
            if STATE_FOLDER not in folder.relative_to(path).parts:
                _leftovers(folder, findings)
        check_dataset(path, findings)
    elif inner and not any((path / name).exists() for name in own):
        for folder in inner:
            _check_folder(folder, findings)
    elif (path / "ball.parquet").exists() and not (path / "shots.parquet").exists():
        _check_track(path, findings)
    else:
        _check_work(path, findings)


def _check_track(folder: Path, findings: Findings) -> None:
    """The ball's tables of a foreign track, which has no clip."""
    _leftovers(folder, findings)
    if findings.expect(folder / "run.json"):
        findings.document(folder / "run.json", "run")
    tables = {}
    for name in BALL_TABLES:
        path = folder / f"{name}.parquet"
        if findings.expect(path):
            findings.files.append(path)
            scene = findings.scene or _scene_in_metadata(path)
            checked = checked_table(path, name, Context(scene=scene))
            tables[name] = checked.columns
            findings.add(path, checked.faults)
    if len(tables) == len(BALL_TABLES):
        findings.add(folder / "ball_shots.parquet", flight_event_faults(tables["ball_shots"], tables["events"]))
        findings.add(folder / "ball.parquet", ball_event_faults(tables["ball"], tables["events"]))


def _check_file(path: Path, findings: Findings) -> None:
    kind = _kind_of(path, findings.kind)
    if not kind:
        names = ", ".join([*DOCUMENT_NAMES, *(f"{name}.parquet" for name in TABLES), "*.yaml"])
        findings.say(path, "", f"a file whose name tells what it is ({names}), or --kind", path.name)
    elif path.suffix == ".parquet":
        findings.files.append(path)
        scene = findings.scene or _scene_in_metadata(path)
        if scene is None and TABLES[kind].needs:
            findings.say(path, "pgm.scene", "a scene that ships with the package in the metadata, or --scene", "none")
        else:
            findings.add(path, checked_table(path, kind, Context(scene=scene)).faults)
    else:
        findings.document(path, kind)


def _kind_of(path: Path, given: str) -> str:
    if path.suffix == ".parquet":
        kind = given or path.stem
        return kind if kind in TABLES else ""
    if given:
        return given if given in document_kinds() else ""
    if path.suffix in YAML_SUFFIXES:
        return "skeleton" if _holds(path, "joints") else "scene"
    return DOCUMENT_NAMES.get(path.name, "")


def _holds(path: Path, name: str) -> bool:
    try:
        value = parse_document(path)
    except ValueError:
        return False
    return isinstance(value, dict) and name in value


def _scene_in_metadata(path: Path) -> Scene | None:
    """The shipped scene that a parquet file names."""
    try:
        with open_table(path) as file:
            name = (file.schema_arrow.metadata or {}).get(b"pgm.scene", b"").decode(errors="replace")
    except (pa.ArrowException, OSError, ValueError):
        return None
    return shipped_scene(name)


def _check_work(work: Path, findings: Findings) -> None:
    """A work folder: its documents, its clips, and the table of shots that both belong to."""
    _leftovers(work, findings)
    if findings.expect(work / "run.json"):
        findings.document(work / "run.json", "run")
    for name in STAGE_RUNS:
        if (work / name).exists():
            findings.document(work / name, "run")
    folders = sorted(p for p in work.iterdir() if p.is_dir() and p.name != STATE_FOLDER and _is_clip(p))
    clips = {folder.name: _check_clip(folder, findings) for folder in folders}
    path = work / "shots.parquet"
    if findings.expect(path):
        findings.files.append(path)
        shots = checked_table(path, "shots", Context(scene=None))
        findings.add(path, shots.faults)
        findings.add(path, _shots_of_clips(shots.columns, clips))
    for name in TABLES:
        if name != "shots" and (work / f"{name}.parquet").exists():
            findings.say(work / f"{name}.parquet", "", "no such file here: it belongs into a clip's folder", name)


def _check_clip(folder: Path, findings: Findings) -> CheckedClip:
    _leftovers(folder, findings)
    return check_clip(folder, findings)


def _is_clip(folder: Path) -> bool:
    return any((folder / name).exists() for name in ("clip.json", *(f"{table}.parquet" for table in TABLES)))


def _shots_of_clips(shots: dict[str, np.ndarray], clips: dict[str, CheckedClip]) -> Iterator[Fault]:
    """Clips without rows, rows without clips, and clips whose frames are not those of their rows."""
    if not all(name in shots for name in ("video", "video_frame", "timestamp", "clip_id")):
        return
    rows_of = _rows_of(shots["clip_id"])
    for name in sorted(set(rows_of) - {""}):
        if name not in clips:
            yield Fault(field="clip_id", expected="clips that have a folder", found=as_text(name))
    for name, clip in clips.items():
        rows = rows_of.get(name, np.zeros(0, dtype=np.int64))
        if not len(rows):
            yield Fault(field="clip_id", expected=f"rows of clip {name}, which has a folder", found="none")
            continue
        if clip.document is not None:
            if len(rows) != clip.document["n_frames"]:
                expected = f"{clip.document['n_frames']} rows of clip {name}, its n_frames"
                yield Fault(field="clip_id", expected=expected, found=f"{len(rows)}")
            video = shots["video"][rows[0]]
            if video != clip.document["source_path"]:
                expected = f"{as_text(clip.document['source_path'])}, source_path of clip {name}"
                yield Fault(field="video", expected=expected, found=as_text(video))
        for key in ("video_frame", "timestamp"):
            if clip.keys and len(clip.keys[key]) == len(rows):
                bad = np.flatnonzero(clip.keys[key] != shots[key][rows])
                if len(bad):
                    expected = f"{as_text(clip.keys[key][bad[0]])}, as in camera.parquet of clip {name}"
                    yield Fault(
                        field=key, expected=expected, found=f"{as_text(shots[key][rows[bad[0]]])} in row {rows[bad[0]]}"
                    )


def _rows_of(words: np.ndarray) -> dict[str, np.ndarray]:
    """Rows of each word, in order."""
    if not len(words):
        return {}
    starts = np.flatnonzero(np.concatenate([[True], words[1:] != words[:-1]]))
    runs: dict[str, list[np.ndarray]] = {}
    for start, end in zip(starts, np.append(starts[1:], len(words)), strict=True):
        runs.setdefault(words[start], []).append(np.arange(start, end))
    return {word: np.concatenate(rows) for word, rows in runs.items()}


def _leftovers(folder: Path, findings: Findings) -> None:
    for path in sorted(folder.iterdir()):
        if LEFTOVER.search(path.name):
            findings.say(path, "", "no unfinished file", path.name)
