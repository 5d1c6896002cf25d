"""A work folder kept consistent while videos come and go: what belongs to a video, how it is replaced, what is swept.

Every video has a PART, its rows of `shots.parquet`, under `.pgm/shots`. A video's clips are replaced in three steps:
its part goes, its folders are exchanged, its new part comes. So a part always tells of folders that are there, and
folders without a part are what a killed process left behind.
"""

import hashlib
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq

from pgm_data.dataset.columns import arrow_schema
from pgm_data.dataset.files import whole_file
from pgm_data.dataset.tables import ROW_GROUP, read_table
from pgm_data.scene import Scene

STATE = ".pgm"
SHOTS = "shots.parquet"
RESERVED = frozenset({"run.json", SHOTS, "report.html"})
"""Names in a work folder that no clip may have."""
LONGEST_KEY = 80


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """What one video's rows of `shots.parquet` say."""

    path: Path
    video: str
    """Its source path."""
    frames: int
    clips: tuple[str, ...]
    reason: str
    """Why most of its frames outside of clips are there; empty where there are none."""


def key_of(stem: str) -> str:
    """A short plain name for the files of a video's state: the stem itself where it is one."""
    plain = re.sub(r"[^A-Za-z0-9_.+-]", "_", stem)
    if plain == stem and len(stem) <= LONGEST_KEY:
        return stem
    return f"{plain[: LONGEST_KEY - 20]}~{hashlib.sha256(stem.encode()).hexdigest()[:16]}"


def part_path(work: Path, stem: str) -> Path:
    """Where a video's part is."""
    return work / STATE / "shots" / f"{key_of(stem)}.parquet"


def read_part(path: Path) -> Part | None:
    """The part at the path; None where there is none.

    Raises:
        ValueError: If the file is there and cannot be read.
    """
    if not path.exists():
        return None
    columns = read_table(path)
    reasons = Counter(reason for reason, clip in zip(columns["reason"], columns["clip_id"], strict=True) if not clip)
    return Part(
        path=path,
        video=str(columns["video"][0]),
        frames=len(columns["video"]),
        clips=tuple(dict.fromkeys(str(clip) for clip in columns["clip_id"] if clip)),
        reason=str(reasons.most_common(1)[0][0]) if reasons else "",
    )


def parts_of(work: Path) -> tuple[Part, ...]:
    """All parts of a work folder, by name."""
    return tuple(filter(None, map(read_part, sorted((work / STATE / "shots").glob("*.parquet")))))


def is_clip_of(clip_id: str, stem: str) -> bool:
    """Whether a clip of that name is one that the stem's video gives."""
    return re.fullmatch(rf"{re.escape(stem)}(\.\d\d+)?", clip_id, re.IGNORECASE) is not None


def clip_folders(work: Path, stem: str) -> list[Path]:
    """The clip folders of a stem's video."""
    return sorted(p for p in work.iterdir() if is_clip_of(p.name, stem) and (p / "clip.json").is_file())


@contextmanager
def staging_folder(work: Path, stem: str) -> Iterator[Path]:
    """An empty folder on the work folder's disk for a video's clips in the making, gone afterwards."""
    staging = work / STATE / "clips" / key_of(stem)
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def commit(staging: Path, work: Path, stem: str, clips: Sequence[str]) -> None:
    """Put a video's new clip folders and its part in the place of the old ones, each by one rename."""
    part = part_path(work, stem)
    part.parent.mkdir(parents=True, exist_ok=True)
    part.unlink(missing_ok=True)
    old = staging / ".old"
    old.mkdir()
    for folder in clip_folders(work, stem):
        os.replace(folder, old / folder.name)
    for clip_id in clips:
        os.replace(staging / clip_id, work / clip_id)
    os.replace(staging / SHOTS, part)


def sweep(work: Path, stems: Iterable[str]) -> None:
    """Delete what killed processes left: clips in the making, and folders of the stems' videos without a part."""
    shutil.rmtree(work / STATE / "clips", ignore_errors=True)
    for stem in stems:
        if not part_path(work, stem).exists():
            for folder in clip_folders(work, stem):
                shutil.rmtree(folder)


def drop(work: Path, part: Part) -> None:
    """Delete a video's clips and its part."""
    part.path.unlink()
    for clip_id in part.clips:
        shutil.rmtree(work / clip_id, ignore_errors=True)


def merge_parts(work: Path, parts: Sequence[Part], *, scene: Scene) -> None:
    """Write `shots.parquet` from the parts in that order; one part at a time is in memory."""
    schema = arrow_schema("shots", scene)
    with whole_file(work / SHOTS) as temporary, pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
        for part in parts:
            writer.write_table(pq.read_table(part.path).cast(schema), row_group_size=ROW_GROUP)
