"""Captions of a dataset: spans of frames, each with its texts."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float, Int

from pgm_models.animation.store_write import FRAME_ARRAYS, WrittenFrames

COLUMNS = ("episode_index", "player", "start_frame", "end_frame", "alternative", "text")


@dataclass(frozen=True, eq=False, kw_only=True)
class Spans:
    """Texts of spans, ragged."""

    texts: tuple[str, ...]
    """All different ones, sorted."""
    first: Int[np.ndarray, " bounds"]
    """Where the texts of each span begin among `rows`."""
    rows: Int[np.ndarray, " captions"]
    """Texts of the spans, one after another, the main one of each first: rows of `texts`."""

    def texts_of(self, span: int) -> tuple[str, ...]:
        """Texts of one span, the main one first."""
        return tuple(self.texts[row] for row in self.rows[self.first[span] : self.first[span + 1]])

    def text_of(self, span: Int[np.ndarray, "*batch"], draw: Float[np.ndarray, "*batch"]) -> Int[np.ndarray, "*batch"]:
        """One text of each span, a row of `texts`; -1 of -1.

        Args:
            span: Spans.
            draw: Which of its texts, from 0 (the main one) to below 1.
        """
        result = np.full(span.shape, -1, dtype=np.int64)
        there = span >= 0
        first, count = self.first[span[there]], np.diff(self.first)[span[there]]
        result[there] = self.rows[first + np.floor(draw[there] * count).astype(np.int64)]
        return result


@dataclass(frozen=True, eq=False, kw_only=True)
class SpanPlaces:
    """Where each span is, sorted by clip and then by its start."""

    span: Int[np.ndarray, " spans"]
    clip: Int[np.ndarray, " spans"]
    player: Int[np.ndarray, " spans"]
    start: Int[np.ndarray, " spans"]
    """First frame of the clip in it."""
    end: Int[np.ndarray, " spans"]
    """First frame after it."""


def read_spans(dataset: Path, players: int) -> tuple[Spans, SpanPlaces]:
    """Spans of a packed dataset and where they are; none where it has no captions. Blank texts are none.

    Raises:
        ValueError: If a file of captions is none, or a caption is of a player that the scene does not have.
    """
    paths = sorted((dataset / "captions").glob("chunk-*/file-*.parquet"))
    try:
        tables = [pq.read_table(path, columns=list(COLUMNS)) for path in paths]
    except (pa.ArrowException, OSError, KeyError) as error:
        raise ValueError(f"{dataset / 'captions'}: expected captions with {', '.join(COLUMNS)}, got {error}") from error
    numbers = {
        name: np.concatenate([np.zeros(0, np.int64), *(table.column(name).to_numpy() for table in tables)])
        for name in COLUMNS[:-1]
    }
    spoken = [text for table in tables for text in table.column("text").to_pylist()]
    said = np.array([bool(text.strip()) for text in spoken], dtype=bool)
    numbers = {name: values[said] for name, values in numbers.items()}
    spoken = [text for text, full in zip(spoken, said, strict=True) if full]
    strange = numbers["player"][(numbers["player"] < 0) | (numbers["player"] >= players)]
    if len(strange):
        raise ValueError(f"{dataset / 'captions'}: player: expected below {players}, got {strange[0]}")
    texts = tuple(sorted(set(spoken)))
    row_of = {text: row for row, text in enumerate(texts)}
    keys = np.stack([numbers[name] for name in ("episode_index", "start_frame", "player", "end_frame")], axis=1)
    order = np.lexsort((numbers["alternative"], *keys.T[::-1]))
    spans, first = np.unique(keys[order], axis=0, return_index=True)
    rows = np.array([row_of[text] for text in spoken], dtype=np.int64)[order]
    places = SpanPlaces(
        span=np.arange(len(spans)), clip=spans[:, 0], start=spans[:, 1], player=spans[:, 2], end=spans[:, 3]
    )
    return Spans(texts=texts, first=np.concatenate([first, [len(rows)]]), rows=rows), places


def paint_spans(path: Path, players: int, written: WrittenFrames, places: SpanPlaces) -> None:
    """Write the span of each frame and player, -1 where none; where two meet, the one that starts later."""
    bounds = np.searchsorted(places.clip, np.arange(len(written.episodes.clips) + 1))
    with path.open("wb") as file:
        for clip in range(len(written.episodes.clips)):
            frame = written.rows_of(clip, "frame")
            own = np.full((len(frame), players), -1, dtype=FRAME_ARRAYS["span"])
            chosen = slice(bounds[clip], bounds[clip + 1])
            begin, end = np.searchsorted(frame, places.start[chosen]), np.searchsorted(frame, places.end[chosen])
            for span, player, a, b in zip(places.span[chosen], places.player[chosen], begin, end, strict=True):
                own[a:b, player] = span
            file.write(own.tobytes())
