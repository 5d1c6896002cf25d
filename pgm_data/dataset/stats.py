"""What a dataset holds, counted: sequences, hours, frames, captions, words and their parts of speech, by split.

Read in batches, so memory does not grow with the dataset but for one number a different caption.
"""

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.dataset_columns import SPLITS
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.stats_words import PARTS, is_word, parts_of, words_of

ALL = "all"
BATCH = 65_536
"""Rows read at once."""
SOURCES = ("human", "generated", "imported")


@dataclass(eq=False, kw_only=True)
class Tally:
    """Counts of one split, or of all."""

    matches: set[str] = field(default_factory=set)
    durations_s: list[float] = field(default_factory=list)
    """Of each sequence: its frames over their rate, seconds."""
    frames: int = 0
    annotated: int = 0
    """Frames with a camera and every player of the scene."""
    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)
    """Sequences by width and height, pixels."""
    rates: Counter[float] = field(default_factory=Counter)
    """Sequences by frames per second."""
    captions: int = 0
    main: int = 0
    """Captions that are the main one of their span."""
    unique: set[bytes] = field(default_factory=set)
    """Digests of the texts."""
    sources: Counter[str] = field(default_factory=Counter)
    words: Counter[str] = field(default_factory=Counter)
    parts: Counter[str] = field(default_factory=Counter)
    lengths: Counter[int] = field(default_factory=Counter)
    """Captions by number of words."""
    spans_s: list[np.ndarray] = field(default_factory=list)
    """Lengths of spans, each once however many texts it has, seconds."""

    @property
    def spans(self) -> np.ndarray:
        """Lengths of all spans, seconds."""
        return np.concatenate(self.spans_s) if self.spans_s else np.zeros(0)


@dataclass(frozen=True, eq=False, kw_only=True)
class DatasetStats:
    """What a dataset holds."""

    scene: str
    splits: Mapping[str, Tally]
    """Those that it has, and `all`."""

    @property
    def whole(self) -> Tally:
        """Of all splits together."""
        return self.splits[ALL]


def dataset_stats(folder: Path) -> DatasetStats:
    """Count what the packed dataset in the folder holds.

    Raises:
        ValueError: If there is no dataset, or a file of it is not what it must be.
    """
    info = read_document(folder / "meta" / "info.json", "dataset_info")
    tallies: dict[str, Tally] = {}
    split_of = _count_episodes(folder, tallies)
    players = [name.removesuffix(".caption") for name in info["features"] if name.endswith(".caption")]
    _count_frames(folder, split_of, players, tallies)
    if (folder / "captions").is_dir():
        _count_captions(folder, split_of, tallies)
    ordered = {name: tallies[name] for name in (ALL, *SPLITS) if name in tallies}
    return DatasetStats(scene=info["pgm"]["scene"], splits=ordered or {ALL: Tally()})


def _batches(folder: Path, table: str, columns: Sequence[str]) -> Iterator[dict[str, pa.Array]]:
    for path in sorted((folder / table).glob("*/*.parquet")):
        try:
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(batch_size=BATCH, columns=list(columns)):
                    yield {name: batch.column(name) for name in columns}
        except (pa.ArrowException, OSError, KeyError) as error:
            raise ValueError(f"{path}: expected a parquet file with {', '.join(columns)}, got: {error}") from error


def _count_episodes(folder: Path, tallies: dict[str, Tally]) -> np.ndarray:
    """The split of every episode."""
    splits: list[str] = []
    names = ("split", "match_id", "width", "height")
    for batch in _batches(folder, "meta/episodes", names):
        for split, match, width, height in zip(*(batch[name].to_pylist() for name in names), strict=True):
            splits.append(split)
            for name in (ALL, split):
                tally = tallies.setdefault(name, Tally())
                tally.matches.add(match)
                tally.sizes[width, height] += 1
    return np.array(splits, dtype=object)


def _count_frames(folder: Path, split_of: np.ndarray, players: Sequence[str], tallies: dict[str, Tally]) -> None:
    """Frames, annotated ones, and how long the sequences are."""
    count = len(split_of)
    frames, first, last = np.zeros(count, np.int64), np.full(count, np.inf), np.full(count, -np.inf)
    statuses = ["camera.status", *(f"{player}.status" for player in players)]
    for batch in _batches(folder, "data", ["episode_index", "source_timestamp", *statuses]):
        episode = _episodes(batch["episode_index"], count)
        there = np.ones(len(episode), dtype=bool)
        for name in statuses:
            status = batch[name].dictionary_encode()
            known = np.array([word != "none" for word in status.dictionary.to_pylist()], dtype=bool)
            there &= known[status.indices.to_numpy()]
        time = batch["source_timestamp"].to_numpy()
        frames += np.bincount(episode, minlength=count)
        np.minimum.at(first, episode, time)
        np.maximum.at(last, episode, time)
        for split in set(split_of[np.unique(episode)]):
            tallies[split].annotated += int((there & (split_of[episode] == split)).sum())
        tallies[ALL].annotated += int(there.sum()) if len(episode) else 0
    for split, rows, start, end in zip(split_of.tolist(), frames.tolist(), first, last, strict=True):
        rate = (rows - 1) / (end - start) if rows > 1 and end > start else float("nan")
        for name in (ALL, split):
            tallies[name].frames += rows
            tallies[name].durations_s.append(rows / rate if rate == rate else 0.0)
            if rate == rate:
                tallies[name].rates[round(float(rate), 2)] += 1


def _episodes(values: pa.Array, count: int) -> np.ndarray:
    episode = values.to_numpy()
    if len(episode) and not 0 <= episode.min() <= episode.max() < count:
        raise ValueError(f"episode_index: expected 0 to {count - 1}, got {episode.min()} to {episode.max()}")
    return episode


def _count_captions(folder: Path, split_of: np.ndarray, tallies: dict[str, Tally]) -> None:
    columns = ("episode_index", "text", "source", "alternative", "start_s", "end_s")
    for batch in _batches(folder, "captions", columns):
        of_row = split_of[_episodes(batch["episode_index"], len(split_of))]
        texts = batch["text"].dictionary_encode()
        words = [words_of(text) for text in texts.dictionary.to_pylist()]
        digests = [hashlib.blake2b(t.encode(), digest_size=8).digest() for t in texts.dictionary.to_pylist()]
        parts = [parts_of(own) for own in words]
        text, main = texts.indices.to_numpy(), batch["alternative"].to_numpy() == 0
        span = batch["end_s"].to_numpy() - batch["start_s"].to_numpy()
        sources = np.array(batch["source"].to_pylist(), dtype=object)
        for split in {ALL, *of_row.tolist()} if len(text) else ():
            rows = np.ones(len(text), dtype=bool) if split == ALL else of_row == split
            tally = tallies[split]
            tally.captions += int(rows.sum())
            tally.main += int((rows & main).sum())
            tally.spans_s.append(span[rows & main])
            tally.sources.update(sources[rows].tolist())
            for number, times in enumerate(np.bincount(text[rows], minlength=len(words)).tolist()):
                if times:
                    _count_text(tally, digests[number], words[number], parts[number], times)


def _count_text(tally: Tally, digest: bytes, tokens: Sequence[str], parts: Sequence[str], times: int) -> None:
    tally.unique.add(digest)
    own = [token for token in tokens if is_word(token)]
    tally.lengths[len(own)] += times
    for word in own:
        tally.words[word] += times
    for part in parts:
        tally.parts[part] += times


def tally_document(tally: Tally) -> dict[str, Any]:
    """The numbers of a split in plain data; None of what nothing was counted for."""
    spans, spoken = tally.spans, tally.captions
    counted = sum(tally.parts.values())
    return {
        "matches": len(tally.matches),
        "sequences": len(tally.durations_s),
        "hours": sum(tally.durations_s) / 3600.0,
        "frames": tally.frames,
        "annotated_frames": tally.annotated,
        "resolutions": [{"size": list(size), "sequences": n} for size, n in tally.sizes.most_common()],
        "rates": [{"frames_per_second": rate, "sequences": n} for rate, n in tally.rates.most_common()],
        "captions": spoken,
        "main_captions": tally.main,
        "unique_captions": len(tally.unique),
        "caption_sources": {name: tally.sources[name] for name in SOURCES if tally.sources[name]},
        "unique_words": len(tally.words),
        "words_per_caption": _share(sum(n * times for n, times in tally.lengths.items()), spoken),
        "span_s": float(spans.mean()) if len(spans) else None,
        "parts_of_speech": {part: _share(tally.parts[part], counted) for part in PARTS},
    }


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole else None
