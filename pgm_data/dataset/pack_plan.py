"""What a dataset is to hold: which clips of which work folders, and the split of every match."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.clip_check import shipped_scene
from pgm_data.dataset.columns import TABLES, table_columns
from pgm_data.dataset.dataset_columns import NO_VIDEO, SPLITS, frame_tables
from pgm_data.dataset.documents import parse_document
from pgm_data.scene import Scene

STATE_FOLDER = ".pgm"

Videos = Literal["copy", "link", "encode", "none"]


@dataclass(frozen=True, kw_only=True)
class PackOptions:
    """How a dataset is packed."""

    videos: Videos = "link"
    """What becomes of the videos: copied, linked to where they are, encoded anew as H.264, or left out."""
    video_folder: Path | None = None
    """Where the videos are, if no longer where the clips say."""
    height: int = 0
    """Height of encoded videos, pixels; 0 keeps each as it is. Columns in pixels stay those of the source."""
    crf: int = 20
    """Quality of encoded videos as x264 counts it, the same for every picture: 0 is lossless, 51 the worst."""
    rate: float = 0.0
    """Frames per second of encoded videos, one frame after another as they come; 0 keeps the times of each."""
    val_share: float = 0.1
    """Share of the matches kept for validation; at least one match of three or more, unless 0."""
    test_share: float = 0.1
    """Share of the matches kept for testing; at least one match of three or more, unless 0."""
    file_mb: int = 100
    """Size at which a data file ends, MB."""

    def __post_init__(self) -> None:
        """Check the shares and the size."""
        for name, share in (("val_share", self.val_share), ("test_share", self.test_share)):
            if not 0.0 <= share < 1.0:
                raise ValueError(f"{name}: expected at least 0 and below 1, got {share}")
        if self.val_share + self.test_share >= 1.0:
            raise ValueError(
                f"val_share + test_share: expected below 1, got {self.val_share} + {self.test_share}: none for training"
            )
        if not (self.height == 0 or 16 <= self.height <= 8192) or self.height % 2:
            raise ValueError(f"height: expected 0, or an even number of 16 to 8192, got {self.height}")
        if not 0 <= self.crf <= 51:
            raise ValueError(f"crf: expected 0 to 51, got {self.crf}")
        if not 0.0 <= self.rate <= 1000.0:
            raise ValueError(f"rate: expected 0 to 1000, got {self.rate}")
        if self.videos != "encode" and (self.height or self.rate):
            name = "height" if self.height else "rate"
            raise ValueError(f"{name}: expected 0, as videos is {self.videos}: only encoding changes a picture")
        if not 1 <= self.file_mb <= 1000:
            raise ValueError(f"file_mb: expected 1 to 1000, got {self.file_mb}")


@dataclass(frozen=True, kw_only=True)
class PackProblem:
    """Why a clip, or its video, is not in the dataset."""

    path: Path
    reason: str

    def __str__(self) -> str:
        """One line."""
        return f"{self.path}: {self.reason}"


@dataclass(frozen=True, kw_only=True)
class PlannedClip:
    """One clip that is to be packed."""

    folder: Path
    work: Path
    """Folder from which its video's path starts."""
    clip_id: str
    match_id: str
    split: str


@dataclass(frozen=True, eq=False, kw_only=True)
class PackPlan:
    """What is to be packed, in the order of its episodes."""

    scene: Scene
    clips: tuple[PlannedClip, ...]
    optional: frozenset[str]
    """Optional columns that some clip has."""
    problems: tuple[PackProblem, ...]
    """Clips that cannot be packed."""


def plan_pack(works: Sequence[Path], options: PackOptions, *, scene: Scene | None = None) -> PackPlan:
    """The clips of the work folders, each in the split of its match.

    Args:
        works: Work folders, folders that hold one as `work`, and clip folders.
        options: How it is packed.
        scene: Taken in place of the one that the clips name, for a scene that does not ship with the package.

    Raises:
        ValueError: If there are no clips at all, two of one name, or clips of several scenes.
    """
    documents: dict[Path, dict] = {}
    problems = []
    # A folder that is named twice is taken once.
    folders = {folder.resolve(): folder for work in works for folder in clip_folders(work)}
    for folder in folders.values():
        try:
            documents[folder] = _what_plans_need(parse_document(folder / "clip.json"))
        except ValueError as error:
            problems.append(PackProblem(path=folder, reason=str(error).removeprefix(f"{folder}/")))
    if not documents and not problems:
        raise ValueError(f"{', '.join(map(str, works))}: expected clips, got no clip.json in any folder there")
    _refuse_twins([*documents, *(problem.path for problem in problems)])
    chosen = scene or _one_scene({folder: document["scene"] for folder, document in documents.items()})
    kin = _matches_of_one_video(documents.values())
    splits = splits_of_matches(kin.values(), options)
    clips = [
        PlannedClip(
            folder=folder,
            work=folder.parent,
            clip_id=folder.resolve().name,
            match_id=document["match_id"],
            split=splits[kin[document["match_id"]]],
        )
        for folder, document in documents.items()
    ]
    clips.sort(key=lambda clip: (SPLITS.index(clip.split), clip.match_id, clip.clip_id))
    return PackPlan(
        scene=chosen, clips=tuple(clips), optional=_optional_columns(clips, chosen), problems=tuple(problems)
    )


def _what_plans_need(document: object) -> dict:
    """The document, if it names scene and match; whether all of it is right is found when the clip's turn comes."""
    if not isinstance(document, dict):
        raise ValueError(f"clip.json: expected an object, got {document!r:.60}")
    for name in ("scene", "match_id"):
        if not isinstance(document.get(name), str):
            raise ValueError(f"clip.json: {name}: expected a text, got {document.get(name)!r:.60}")
    json.dumps(document, ensure_ascii=False).encode()  # JSON can spell half a character; no table holds one
    return document


def clip_folders(work: Path) -> list[Path]:
    """The clip folders at a path: its own, those of a work folder, or of the folder `work` in it."""
    if (work / "clip.json").is_file():
        return [work]
    names = ("clip.json", *(f"{table}.parquet" for table in TABLES if table != "shots"))
    for folder in (work, work / "work"):
        if folder.is_dir():
            inner = sorted(p for p in folder.iterdir() if p.is_dir() and p.name != STATE_FOLDER)
            found = [path for path in inner if any((path / name).exists() for name in names)]
            if found:
                return found
    return []


def _refuse_twins(folders: Iterable[Path]) -> None:
    seen: dict[str, Path] = {}
    for folder in folders:
        name = folder.resolve().name
        if name in seen:
            raise ValueError(
                f"clip {name}: expected once among all work folders, got it in {seen[name].parent} and in "
                f"{folder.parent}; --clip-prefix of pgm-calibrate tells videos of one name apart"
            )
        seen[name] = folder


def _one_scene(named: dict[Path, str]) -> Scene:
    first: dict[str, Path] = {}
    for folder, name in named.items():
        first.setdefault(name, folder)
    if len(first) > 1:
        places = ", ".join(f"{name} ({folder})" for name, folder in sorted(first.items()))
        raise ValueError(f"scene: expected one for all clips, since a dataset has one set of columns, got {places}")
    if not first:
        raise ValueError("scene: expected a clip.json that can be read, or --scene, got neither")
    ((name, folder),) = first.items()
    scene = shipped_scene(name)
    if scene is None:
        raise ValueError(f"scene: expected one that ships with pgm, or --scene, got {name!r} in {folder}")
    return scene


def _matches_of_one_video(documents: Iterable[dict]) -> dict[str, str]:
    """For each match the first of those that share a video with it, which no split may tell apart."""
    first: dict[str, str] = {}

    def root(match: str) -> str:
        while first[match] != match:
            match = first[match]
        return match

    match_of: dict[str, str] = {}
    for document in documents:
        match, video = document["match_id"], document.get("sha256")
        first.setdefault(match, match)
        if isinstance(video, str) and video != NO_VIDEO:
            other = match_of.setdefault(video, match)
            least, larger = sorted((root(match), root(other)))
            first[larger] = least
    return {match: root(match) for match in first}


def splits_of_matches(matches: Iterable[str], options: PackOptions) -> dict[str, str]:
    """The split of every match: in the order of a hash of their names, the first are tested, the next validate.

    The same matches are always divided alike. Fewer than three are all for training.
    """
    order = sorted(set(matches), key=lambda match: hashlib.sha256(match.encode()).digest())
    count = len(order)
    test = min(_share_of(count, options.test_share), max(count - 2, 0))
    val = min(_share_of(count, options.val_share), max(count - 1 - test, 0))
    return {match: "test" if i < test else "val" if i < test + val else "train" for i, match in enumerate(order)}


def _share_of(count: int, share: float) -> int:
    if share == 0.0 or count < 3:
        return 0
    return max(1, int(share * count + 0.5))


def _optional_columns(clips: Sequence[PlannedClip], scene: Scene) -> frozenset[str]:
    optional = {c.name for table in frame_tables(scene) for c in table_columns(table, scene) if c.optional}
    found: set[str] = set()
    for clip in clips if optional else ():
        path = clip.folder / "players.parquet"
        if path.is_file():
            try:
                found |= optional & set(pq.read_schema(path).names)
            except (pa.ArrowException, OSError, ValueError):
                continue  # the clip's own check says so
    return frozenset(found)
