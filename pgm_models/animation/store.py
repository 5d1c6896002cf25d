"""States of a whole dataset on disk, encoded once: training reads windows of them through memory maps."""

import hashlib
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.dataset.files import TEMPORARY_SUFFIX
from pgm_data.scene import Scene
from pgm_models.animation.layout import Layout, layout_from_json, layout_to_json
from pgm_models.animation.spans import Spans, paint_spans, read_spans
from pgm_models.animation.store_write import FRAME_ARRAYS, cut_segments, write_frames

VERSION = 1
"""Of the files; another one is not read."""
STATE, TABLES = "store.json", "tables.npz"


@dataclass(frozen=True, eq=False, kw_only=True)
class StateStore:
    """Encoded frames of a dataset, in segments of even time steps. Pickles as its folder."""

    folder: Path
    """Where its files lie."""
    layout: Layout
    tangent: Float[np.ndarray, "frames channels"]
    """Channels as of `encode`: not standardised, rotations within pi; 0 where not valid."""
    valid: Bool[np.ndarray, "frames properties"]
    """Whether the data say anything."""
    frame: Int[np.ndarray, " frames"]
    """Number of the frame in its clip."""
    time: Float[np.ndarray, " frames"]
    """When its picture was taken, seconds of the clip's clock."""
    span: Int[np.ndarray, "frames actions"]
    """Span of captions that each player is in; -1 where none."""
    segment_start: Int[np.ndarray, " segments"]
    """First row of the segment."""
    segment_length: Int[np.ndarray, " segments"]
    """Rows of it."""
    segment_clip: Int[np.ndarray, " segments"]
    """Clip that it is of, a row of `clips`."""
    segment_rate: Float[np.ndarray, " segments"]
    """Frames a second."""
    constants: Float[np.ndarray, "segments constants"]
    """Standardised; 0, the average, where unknown."""
    clips: tuple[str, ...]
    """Ids of all clips of the dataset."""
    matches: tuple[str, ...]
    """Match of each clip."""
    spans: Spans
    """Texts of the spans."""

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.frame)

    @property
    def texts(self) -> tuple[str, ...]:
        """All different texts."""
        return self.spans.texts

    def segments_of(self, matches: tuple[str, ...] | None) -> Int[np.ndarray, " some"]:
        """Segments of those matches; all where None.

        Raises:
            ValueError: If there is no such match.
        """
        if matches is None:
            return np.arange(len(self.segment_start))
        strange = sorted(set(matches) - set(self.matches))
        if strange:
            raise ValueError(f"matches: expected some of {', '.join(sorted(set(self.matches)))}, got {strange[0]!r}")
        wanted = np.array([match in set(matches) for match in self.matches], dtype=bool)
        return np.flatnonzero(wanted[self.segment_clip])

    def rows(self, segment: int, start: int, stop: int, stride: int = 1) -> Int[np.ndarray, " rows"]:
        """Rows of the store, of every so-manieth frame of a segment; its frames count from 0.

        Raises:
            ValueError: If the segment is not so long.
        """
        length = int(self.segment_length[segment])
        if not (0 <= start <= stop <= length and stride >= 1):
            raise ValueError(f"segment {segment}: expected frames within 0 to {length}, got {start}:{stop}:{stride}")
        return self.segment_start[segment] + np.arange(start, stop, stride)

    def states(
        self, segment: int, start: int, stop: int, stride: int = 1
    ) -> tuple[Float[np.ndarray, "rows channels"], Bool[np.ndarray, "rows properties"]]:
        """Channels of those frames as of `encode`, rotations within pi, and what is valid."""
        rows = self.rows(segment, start, stop, stride)
        return np.asarray(self.tangent)[rows], np.asarray(self.valid)[rows]

    def captions(self, segment: int, start: int, stop: int, stride: int = 1) -> Int[np.ndarray, "rows actions"]:
        """Spans of captions of those frames; -1 where none."""
        return np.asarray(self.span)[self.rows(segment, start, stop, stride)]

    def main_texts(self, span: Int[np.ndarray, "*batch"]) -> Int[np.ndarray, "*batch"]:
        """The main text of each span, a row of `texts`; -1 of -1."""
        return self.spans.text_of(span, np.zeros(span.shape))

    def clip_of(self, segment: int) -> str:
        """Id of the clip that a segment is of."""
        return self.clips[int(self.segment_clip[segment])]

    def __reduce__(self) -> tuple:
        return read_store, (self.folder,)


def open_store(dataset: Path, layout: Layout, folder: Path, *, scene: Scene | None = None) -> StateStore:
    """The states of a packed dataset, from files in the folder; these are written first where they are not yet there.

    They belong to one dataset, by its checksums, and one layout, so several of them lie side by side. Memory does not
    grow with the dataset, but for its captions.

    Args:
        dataset: Folder of the packed dataset.
        layout: What its states are made of.
        folder: Where files may be kept; made where it is not there.
        scene: What the dataset shows, where its scene does not ship with the package.

    Raises:
        ValueError: If the dataset is not sound; names file, clip, frame and column. If it shows another scene.
    """
    identity = store_identity(dataset, layout)
    own = folder / f"states_{identity[:16]}"
    if not _is_whole(own, identity):
        unfinished = folder / f".{own.name}.{os.getpid()}{TEMPORARY_SUFFIX}"
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir(parents=True)
        try:
            _write(dataset, layout, unfinished, identity, scene)
            # Another process may have been faster.
            if not _is_whole(own, identity):
                shutil.rmtree(own, ignore_errors=True)
                _take_place(unfinished, own, identity)
        finally:
            shutil.rmtree(unfinished, ignore_errors=True)
    return read_store(own)


def _take_place(unfinished: Path, own: Path, identity: str) -> None:
    try:
        os.replace(unfinished, own)
    except OSError:
        if not _is_whole(own, identity):
            raise


def dataset_identity(dataset: Path) -> str:
    """SHA-256 of what a dataset holds, hexadecimal: of its checksums, or of its files' names and sizes."""
    sums = dataset / "meta" / "sha256sums.txt"
    if sums.is_file():
        content = sums.read_bytes()
    else:
        files = sorted(path for table in ("data", "captions", "meta") for path in (dataset / table).rglob("*.*"))
        content = "".join(f"{path.relative_to(dataset)} {path.stat().st_size}\n" for path in files).encode()
    return hashlib.sha256(content).hexdigest()


def store_identity(dataset: Path, layout: Layout) -> str:
    """SHA-256 of what a dataset holds and of the layout, hexadecimal."""
    description = json.dumps([VERSION, layout_to_json(layout)], sort_keys=True)
    return hashlib.sha256(bytes.fromhex(dataset_identity(dataset)) + description.encode()).hexdigest()


def _is_whole(folder: Path, identity: str) -> bool:
    try:
        return json.loads((folder / STATE).read_text(encoding="utf-8"))["identity"] == identity
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _write(dataset: Path, layout: Layout, folder: Path, identity: str, scene: Scene | None) -> None:
    written = write_frames(dataset, layout, folder, scene=scene)
    segments = cut_segments(written)
    spans, places = read_spans(dataset, len(layout.players))
    paint_spans(folder / "span.bin", len(layout.players), written, places)
    np.savez(
        folder / TABLES,
        segment_start=segments.start,
        segment_length=segments.length,
        segment_clip=segments.clip,
        segment_rate=segments.rate,
        constants=written.constants[segments.clip],
        span_first=spans.first,
        span_texts=spans.rows,
    )
    description = {
        "identity": identity,
        "layout": layout_to_json(layout),
        "frames": written.frames,
        "clips": written.episodes.clips,
        "matches": written.episodes.matches,
        "texts": spans.texts,
    }
    (folder / STATE).write_text(json.dumps(description), encoding="utf-8")


def read_store(folder: Path) -> StateStore:
    """The store whose files lie in the folder.

    Raises:
        ValueError: If they are not a whole store.
    """
    try:
        raw = json.loads((folder / STATE).read_text(encoding="utf-8"))
        layout = layout_from_json(raw["layout"])
        with np.load(folder / TABLES) as tables:
            table = {name: tables[name] for name in tables.files}
        frames = {
            name: _mapped(folder / f"{name}.bin", dtype, (raw["frames"], *_shape_of(name, layout)))
            for name, dtype in FRAME_ARRAYS.items()
        }
        spans = Spans(texts=tuple(raw["texts"]), first=table.pop("span_first"), rows=table.pop("span_texts"))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{folder}: expected a store of states, got {error!r}") from error
    return StateStore(
        folder=folder,
        layout=layout,
        clips=tuple(raw["clips"]),
        matches=tuple(raw["matches"]),
        spans=spans,
        **frames,
        **table,
    )


def _shape_of(name: str, layout: Layout) -> tuple[int, ...]:
    wide = {"tangent": layout.channels, "valid": len(layout.properties), "span": len(layout.players)}
    return (wide[name],) if name in wide else ()


def _mapped(path: Path, dtype: type, shape: tuple[int, ...]) -> Shaped[np.ndarray, "..."]:
    if 0 in shape:
        return np.zeros(shape, dtype=dtype)
    return np.asarray(np.memmap(path, dtype=dtype, mode="r", shape=shape))
