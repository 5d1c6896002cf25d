"""Every row of a packed dataset against the laws of the tables that it was joined from, an episode at a time."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pgm_data.dataset.camera_laws import camera_faults
from pgm_data.dataset.clip_laws import (
    ball_event_faults,
    caption_time_faults,
    event_frame_faults,
    flight_event_faults,
    net_faults,
    player_speed_faults,
)
from pgm_data.dataset.columns import Column
from pgm_data.dataset.dataset_columns import DATA_PATH, caption_name, data_columns, row_columns, row_tables
from pgm_data.dataset.documents import Fault
from pgm_data.dataset.findings import Findings
from pgm_data.dataset.laws import Columns, Context, key_faults, rows_fault, value_faults
from pgm_data.dataset.pack_rows import main_captions
from pgm_data.dataset.play_laws import ball_faults
from pgm_data.dataset.player_laws import players_faults
from pgm_data.dataset.table_check import LAWS, schema_faults, size_faults
from pgm_data.dataset.tables import DTYPES, ROW_GROUP, numpy_column, open_table, stored_schema
from pgm_data.scene import Scene

SAME_S = 1e-4
"""Seconds by which a float32 time may differ from the video's own since the episode began."""


def check_rows(
    folder: Path, info: Mapping[str, Any], episodes: Mapping[str, list[Any]], scene: Scene, findings: Findings
) -> None:
    """Note every fault of `data` and of the tables of their own; `meta` has been found sound."""
    places = [
        DATA_PATH.format(chunk_index=chunk, file_index=file)
        for chunk, file in zip(episodes["data/chunk_index"], episodes["data/file_index"], strict=True)
    ]
    wanted = data_columns(scene, optional=info["features"])
    paths = _files(folder, "data", findings)
    for name in sorted(set(places) - {path.relative_to(folder).as_posix() for path in paths}):
        findings.say(folder / name, "", "the file, which episodes are in", "nothing there")
    if not _sound_files(paths, "data", scene, wanted, findings):
        return
    tables = {}
    for table in row_tables(scene):
        own = _files(folder, table, findings)
        if not own:
            findings.say(folder / table, "", "at least one file", "none")
        elif _sound_files(own, table, scene, row_columns(table, scene), findings):
            tables[table] = _Runs(own, row_columns(table, scene))
    gathered = _Gathered(findings)
    number = -1
    for number, (path, episode, columns) in enumerate(_runs(paths, wanted)):
        if number >= len(places) or episode != number:
            gathered.add(path, episode, [Fault(field="episode_index", expected=f"{number}", found=f"{episode}")])
            break
        if path.relative_to(folder).as_posix() != places[number]:
            fault = Fault(field="episode_index", expected=f"episode {number} in {places[number]}", found="it")
            gathered.add(path, episode, [fault])
        own = {table: runs.take(number, gathered) for table, runs in tables.items()}
        whole = EpisodeRows(
            data=columns,
            own=own,
            first_index=episodes["dataset_from_index"][number],
            rate=float(info["fps"]) if info["pgm"].get("constant_rate") else 0.0,
            context=_context(number, episodes, scene),
        )
        for table, fault in episode_faults(whole, wanted):
            gathered.add(path if table == "data" else tables[table].path, episode, [fault])
    if number + 1 < len(places):
        findings.say(folder / "data", "", f"rows of {len(places)} episodes", f"of {number + 1}")
    for runs in tables.values():
        runs.take(len(places), gathered)
    gathered.report()


def _files(folder: Path, table: str, findings: Findings) -> list[Path]:
    paths = sorted((folder / table).glob("*/*.parquet"))
    findings.files.extend(paths)
    return paths


def _sound_files(paths: list[Path], table: str, scene: Scene, wanted: tuple[Column, ...], findings: Findings) -> bool:
    """Whether all files have the wanted columns; otherwise that is noted."""
    before = len(findings.violations)
    for path in paths:
        try:
            with open_table(path) as file:
                findings.add(path, schema_faults(stored_schema(file), table, scene, wanted))
                findings.add(path, size_faults(file, wanted))
        except (pa.ArrowException, OSError, ValueError) as error:
            findings.say(path, "", "a parquet file", " ".join(str(error).split()))
    return len(findings.violations) == before


def _runs(paths: list[Path], wanted: tuple[Column, ...]) -> Iterator[tuple[Path, int, dict[str, np.ndarray]]]:
    """The rows of each episode, in the order of the files; one that goes on in another file comes as two."""
    names = [column.name for column in wanted]
    for path in paths:
        waiting: list[pa.Table] = []
        with open_table(path) as file:
            for batch in file.iter_batches(batch_size=ROW_GROUP, columns=names):
                content = pa.Table.from_batches([batch])
                index = content.column("episode_index").to_numpy()
                starts = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(index)]
                for start, end in zip(starts[:-1], starts[1:], strict=True):
                    if waiting and waiting[-1].column("episode_index")[-1].as_py() != index[start]:
                        yield path, *_read(waiting, names)
                        waiting = []
                    waiting.append(content.slice(start, end - start))
        if waiting:
            yield path, *_read(waiting, names)


def _read(parts: list[pa.Table], names: list[str]) -> tuple[int, dict[str, np.ndarray]]:
    content = pa.concat_tables(parts)
    columns = {name: numpy_column(content.column(name), name) for name in names}
    return int(columns["episode_index"][0]), columns


class _Runs:
    """The rows of a table of its own, taken episode by episode."""

    def __init__(self, paths: list[Path], wanted: tuple[Column, ...]) -> None:
        self.path = paths[0]
        self.wanted = wanted
        self._runs = _runs(paths, wanted)
        self._next = next(self._runs, None)

    def take(self, episode: int, gathered: "_Gathered") -> dict[str, np.ndarray]:
        """Rows of the episode, none where it has none; rows of episodes before it are out of order."""
        while self._next is not None and self._next[1] < episode:
            expected = "episodes of data, in order, each in one file"
            fault = Fault(field="episode_index", expected=expected, found=f"{self._next[1]}")
            gathered.add(self._next[0], self._next[1], [fault])
            self._next = next(self._runs, None)
        if self._next is None or self._next[1] != episode:
            return {column.name: _no_values(column) for column in self.wanted}
        self.path, _, columns = self._next
        self._next = next(self._runs, None)
        return columns


def _no_values(column: Column) -> np.ndarray:
    dtype = object if column.type == "string" else DTYPES[column.type]
    return np.zeros((0, column.size) if column.size else 0, dtype=dtype)


class _Gathered:
    """Faults of many episodes: each kind once a file, with the number of episodes that have it."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._first: dict[tuple[Path, str], tuple[Fault, int]] = {}
        self._more: dict[tuple[Path, str], int] = {}

    def add(self, path: Path, episode: int, faults: Any) -> None:
        for fault in faults:
            key = (path, fault.field)
            if key in self._first:
                self._more[key] = self._more.get(key, 0) + 1
            else:
                self._first[key] = (fault, episode)

    def report(self) -> None:
        for (path, field), (fault, episode) in self._first.items():
            more = self._more.get((path, field), 0)
            found = f"{fault.found} of episode {episode}" + (f", and {more} more such places" if more else "")
            self._findings.say(path, field, fault.expected, found)


def _context(number: int, episodes: Mapping[str, list[Any]], scene: Scene) -> Context:
    return Context(
        scene=scene,
        clip_id=episodes["clip_id"][number],
        n_frames=episodes["length"][number],
        first_video_frame=episodes["first_video_frame"][number],
        size=(episodes["width"][number], episodes["height"][number]),
        quality=episodes["quality"][number],
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class EpisodeRows:
    """One episode as a dataset holds it."""

    data: Columns
    """Its wide rows."""
    own: Mapping[str, Columns]
    """Its rows of captions, events and flights, by table."""
    first_index: int
    """Row of the dataset at which it starts."""
    rate: float
    """Frames per second of a dataset of constant rate, else 0."""
    context: Context


def episode_faults(rows: EpisodeRows, wanted: Sequence[Column]) -> Iterator[tuple[str, Fault]]:
    """Every fault of an episode, after the table that it is in; `wanted` are the columns of data."""
    scene, data = rows.context.scene, dict(rows.data)
    for fault in _data_faults(rows, wanted):
        yield "data", fault
    data["timestamp"] = data["source_timestamp"]
    for table, columns in rows.own.items():
        if scene is not None:
            yield from ((table, fault) for fault in value_faults(columns, row_columns(table, scene)))
        yield from ((table, fault) for fault in LAWS[table](columns, rows.context))
    if "events" in rows.own:
        events = rows.own["events"]
        yield from (("events", fault) for fault in event_frame_faults(events, data))
        yield from (("data", fault) for fault in ball_event_faults(data, events))
        yield from (("data", fault) for fault in net_faults(data, events, data, scene))
        if "ball_shots" in rows.own:
            yield from (("ball_shots", fault) for fault in flight_event_faults(rows.own["ball_shots"], events))
    if "captions" in rows.own:
        yield from (("captions", fault) for fault in caption_time_faults(rows.own["captions"], data))
        for player, declared in enumerate(scene.players if scene is not None else ()):
            name = caption_name(declared.name)
            texts = np.array(main_captions(rows.own["captions"], player, len(data[name])), dtype=object)
            faults = rows_fault(name, data[name] != texts, "the main caption covering the frame", data[name])
            yield from (("data", fault) for fault in faults)


def _data_faults(rows: EpisodeRows, wanted: Sequence[Column]) -> Iterator[Fault]:
    """Faults of an episode's wide rows."""
    columns, context = rows.data, rows.context
    index = columns["index"]
    yield from rows_fault(
        "index", index != rows.first_index + np.arange(len(index)), "rows numbered one after another", index
    )
    source = columns["source_timestamp"]
    apart = ~(np.abs(columns["timestamp"] - (source - source[0])) <= SAME_S)
    expected = "source_timestamp less that of the episode's first frame"
    if rows.rate:
        apart &= ~(np.abs(columns["timestamp"] - np.arange(len(source)) / rows.rate) <= SAME_S)
        expected += f", or frame_index over {rows.rate:g}"
    yield from rows_fault("timestamp", apart, expected, columns["timestamp"])
    task = columns["task_index"]
    yield from rows_fault("task_index", task != 0, "0, the row of meta/tasks.parquet", task)
    captions = {caption_name(player.name) for player in context.scene.players} if context.scene is not None else set()
    on_source = {name: values for name, values in columns.items() if name not in captions} | {"timestamp": source}
    yield from value_faults(columns, wanted)
    for fault in key_faults(on_source, context):
        yield replace(fault, field="source_timestamp") if fault.field == "timestamp" else fault
    yield from camera_faults(on_source, context)
    yield from players_faults(on_source, context)
    yield from player_speed_faults(on_source, on_source, context.scene)
    yield from ball_faults(on_source, context)
