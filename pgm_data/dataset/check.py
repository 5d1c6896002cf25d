"""Files and work folders against the contract: schemas, frame alignment, references and physics.

Nothing that is read is trusted: no object is unpickled, no path of a document is opened, and what is
too large to be one of ours is not read.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pgm_data.dataset.columns import TABLES, table_names
from pgm_data.dataset.document_check import law_faults
from pgm_data.dataset.document_schemas import document_kinds
from pgm_data.dataset.documents import YAML_SUFFIXES, Fault, document_faults, parse_document
from pgm_data.dataset.laws import Context, as_text, declared_keys
from pgm_data.dataset.table_check import table_faults
from pgm_data.dataset.tables import open_table
from pgm_data.scene import Scene, load_scene

STATE_FOLDER = ".pgm"
"""Folder of a run's own state inside its output; no part of the contract."""

LEFTOVER = re.compile(r"^\..*\.\d+(\.tmp|\.part(\.\w+)?)?$|\.(tmp|part|partial)$|~$")
"""Names of unfinished files, which a killed run leaves behind."""

DOCUMENT_NAMES = {
    "clip.json": "clip",
    "run.json": "run",
    "camera.json": "camera",
    "info.json": "dataset_info",
    "prompt.json": "prompt",
}


@dataclass(frozen=True, kw_only=True)
class Violation:
    """One way in which a file misses the contract."""

    path: Path
    field: str
    """Where in the file; empty for the file itself."""
    expected: str
    found: str

    def __str__(self) -> str:
        """One line, with nothing in it that a terminal would obey."""
        line = f"{self.path}: {self.field + ': ' if self.field else ''}expected {self.expected}, got {self.found}"
        return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in line)


@dataclass(frozen=True, eq=False, kw_only=True)
class Checked:
    """What a check looked at, and what it found."""

    files: tuple[Path, ...]
    violations: tuple[Violation, ...]


@dataclass(eq=False, kw_only=True)
class _Findings:
    """Files and violations, as they are found."""

    scene: Scene | None = None
    """Stands in for the scenes that files name."""
    kind: str = ""
    """Of single files whose name does not tell."""
    files: list[Path] = field(default_factory=list)
    violations: list[Violation] = field(default_factory=list)

    def add(self, path: Path, faults: Iterable[Fault]) -> None:
        self.violations += [Violation(path=path, field=f.field, expected=f.expected, found=f.found) for f in faults]

    def say(self, path: Path, field: str, expected: str, found: str) -> None:
        self.violations.append(Violation(path=path, field=field, expected=expected, found=found))


def file_kinds() -> tuple[str, ...]:
    """Kinds of single files: documents and tables."""
    return document_kinds() + tuple(name for name in table_names() if name not in document_kinds())


def check_paths(paths: Sequence[Path]) -> list[Violation]:
    """Every way in which the files, clip folders and work folders at the paths miss the contract.

    Raises:
        ValueError: If there is nothing at a path.
    """
    return list(examine(paths).violations)


def examine(paths: Sequence[Path], *, kind: str = "", scene: Scene | None = None) -> Checked:
    """The files at and below the paths that were looked at, and every violation.

    Args:
        paths: Files, clip folders and work folders.
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
    findings = _Findings(scene=scene, kind=kind)
    for path in paths:
        if not path.is_dir():
            _check_file(path, findings)
        elif (path / "clip.json").exists():
            _check_clip(path, findings)
        else:
            _check_work(path, findings)
    return Checked(files=tuple(findings.files), violations=tuple(findings.violations))


def _check_file(path: Path, findings: _Findings) -> None:
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
            findings.add(path, table_faults(path, kind, Context(scene=scene))[1])
    else:
        _document(path, kind, findings)


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
    return _shipped_scene(name)


@cache
def _shipped_scene(name: str) -> Scene | None:
    try:
        # A path would be a file of the reader's machine, chosen by whoever wrote the document.
        return load_scene(name) if name.isidentifier() else None
    except ValueError:
        return None


def _document(path: Path, kind: str, findings: _Findings) -> dict[str, Any] | None:
    """The document where it holds to its schema; otherwise its faults are noted."""
    findings.files.append(path)
    try:
        value = parse_document(path)
    except ValueError as error:
        found = str(error).removeprefix(f"{path}: ")
        findings.say(path, "", "a document that can be parsed", found)
        return None
    faults = document_faults(kind, value)
    if not faults:
        faults = tuple(law_faults(kind, value, findings.scene))
        findings.add(path, faults)
        return value
    findings.add(path, faults)
    return None


def _check_work(work: Path, findings: _Findings) -> None:
    """A work folder: its documents, its clips, and the table of shots that both belong to."""
    if (work / "meta" / "info.json").exists():
        findings.say(work, "", "a work folder, a clip folder or a file", "a dataset")
        return
    _leftovers(work, findings)
    _expect(work / "run.json", findings)
    if (work / "run.json").is_file():
        _document(work / "run.json", "run", findings)
    folders = sorted(p for p in work.iterdir() if p.is_dir() and p.name != STATE_FOLDER and _is_clip(p))
    clips = {folder.name: _check_clip(folder, findings) for folder in folders}
    _expect(work / "shots.parquet", findings)
    if (work / "shots.parquet").is_file():
        path = work / "shots.parquet"
        findings.files.append(path)
        shots, faults = table_faults(path, "shots", Context(scene=None))
        findings.add(path, faults)
        findings.add(path, _shots_of_clips(shots, clips))
    for name in TABLES:
        if name != "shots" and (work / f"{name}.parquet").exists():
            findings.say(work / f"{name}.parquet", "", "no such file here: it belongs into a clip's folder", name)


def _is_clip(folder: Path) -> bool:
    return any((folder / name).exists() for name in ("clip.json", *(f"{table}.parquet" for table in TABLES)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Clip:
    """What the folder of a clip said of itself."""

    document: dict[str, Any] | None
    keys: dict[str, np.ndarray]
    """Keys of its camera table; empty where they could not be read."""


def _check_clip(folder: Path, findings: _Findings) -> _Clip:
    """A clip's folder: its document and its tables, which agree frame by frame."""
    _leftovers(folder, findings)
    _expect(folder / "clip.json", findings)
    document = None
    if (folder / "clip.json").exists():
        document = _document(folder / "clip.json", "clip", findings)
    context = _context(folder, document, findings)
    _expect(folder / "camera.parquet", findings)
    keys: dict[str, dict[str, np.ndarray]] = {}
    tables: dict[str, dict[str, np.ndarray]] = {}
    for table in TABLES:
        path = folder / f"{table}.parquet"
        if not path.exists():
            continue
        if table == "shots":
            findings.say(path, "", "no such file here: it belongs into the work folder", table)
            continue
        findings.files.append(path)
        if context.scene is None and TABLES[table].needs:
            continue  # clip.json has been reported, and without its scene nobody can say which columns there are
        tables[table], faults = table_faults(path, table, context)
        findings.add(path, faults)
        if TABLES[table].frame_aligned and declared_keys(tables[table]):
            keys[table] = tables[table]
    for table, columns in keys.items():
        if "camera" in keys and table != "camera":
            findings.add(folder / f"{table}.parquet", _misaligned(columns, keys["camera"]))
    if document is not None and "solved_share" in document and "camera.status" in tables.get("camera", {}):
        findings.add(folder / "clip.json", _unsolved(document["solved_share"], tables["camera"]["camera.status"]))
    if "events" in tables and "ball_shots" in tables:
        findings.add(folder / "ball_shots.parquet", _missing_events(tables["ball_shots"], tables["events"]))
    return _Clip(document=document, keys=keys.get("camera", {}))


def _context(folder: Path, document: dict[str, Any] | None, findings: _Findings) -> Context:
    if document is None:
        return Context(scene=findings.scene, clip_id=folder.resolve().name)
    scene = findings.scene or _shipped_scene(document["scene"])
    name = folder.resolve().name
    if document["clip_id"] != name:
        findings.say(folder / "clip.json", "clip_id", f"{name!r}, the folder's name", repr(document["clip_id"]))
    if scene is not None:
        stray = sorted(set(document["players"]) - {player.name for player in scene.players})
        for player in stray:
            expected = f"a player object of scene {scene.name}"
            findings.say(folder / "clip.json", f"players.{player}", expected, repr(player))
    return Context(
        scene=scene,
        clip_id=name,
        n_frames=int(document["n_frames"]),
        first_video_frame=int(document["first_video_frame"]),
        size=(int(document["width"]), int(document["height"])),
        quality=document["quality"],
    )


def _misaligned(columns: dict[str, np.ndarray], camera: dict[str, np.ndarray]) -> Iterator[Fault]:
    for name in ("frame_index", "video_frame", "timestamp"):
        ours, theirs = columns[name], camera[name]
        if len(ours) != len(theirs):
            yield Fault(field="", expected=f"{len(theirs)} rows, as in camera.parquet", found=f"{len(ours)} rows")
            return
        bad = np.flatnonzero(ours != theirs)
        if len(bad):
            expected = f"{as_text(theirs[bad[0]])} in row {bad[0]}, as in camera.parquet"
            yield Fault(field=name, expected=expected, found=as_text(ours[bad[0]]))


def _unsolved(solved_share: float, status: np.ndarray) -> Iterator[Fault]:
    share = float(np.mean(status != "none")) if len(status) else 0.0
    if abs(share - solved_share) > 1e-6:
        expected = f"{share:.9g}, the share of frames with a camera in camera.parquet"
        yield Fault(field="solved_share", expected=expected, found=f"{solved_share:.9g}")


def _missing_events(flights: dict[str, np.ndarray], events: dict[str, np.ndarray]) -> Iterator[Fault]:
    count = len(events.get("clip_id", ()))
    for name in ("start_event", "end_event"):
        if name in flights:
            bad = np.flatnonzero(flights[name] >= count)
            if len(bad):
                yield Fault(
                    field=name, expected=f"one of the {count} events", found=f"{flights[name][bad[0]]} in row {bad[0]}"
                )


def _shots_of_clips(shots: dict[str, np.ndarray], clips: dict[str, _Clip]) -> Iterator[Fault]:
    """Clips without rows, rows without clips, and clips whose frames are not those of their rows."""
    if not all(name in shots for name in ("video", "video_frame", "timestamp", "clip_id")):
        return
    named = sorted(set(shots["clip_id"]) - {""})
    for name in named:
        if name not in clips:
            yield Fault(field="clip_id", expected="clips that have a folder", found=as_text(name))
    for name, clip in clips.items():
        rows = np.flatnonzero(shots["clip_id"] == name)
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


def _expect(path: Path, findings: _Findings) -> None:
    if not path.exists():
        findings.say(path, "", "the file", "nothing there")
    elif not path.is_file():
        findings.say(path, "", "a file", "something else")


def _leftovers(folder: Path, findings: _Findings) -> None:
    for path in sorted(folder.iterdir()):
        if LEFTOVER.search(path.name):
            findings.say(path, "", "no unfinished file", path.name)
