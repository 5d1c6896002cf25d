"""A dataset that was spoilt on disk is found out: exit code 5, and the file and the field are named."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pgm_cli.main import run

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.dataset_columns import SUMS_PATH
from pgm_data.dataset.pack_sums import write_sums

Spoil = Callable[[Path, np.random.Generator], object]
FIRST = "chunk-000/file-000.parquet"
DATA, CAPTIONS, EVENTS, FLIGHTS = (f"{name}/{FIRST}" for name in ("data", "captions", "events", "ball_shots"))
EPISODES, INFO, STATS = f"meta/episodes/{FIRST}", "meta/info.json", "meta/stats.json"
EDGE = 4
"""Rows at both ends of the first clip that are left alone, so that each has neighbours."""


def rewritten(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(change(pq.read_table(path)), path)


def drop(name: str) -> Spoil:
    return lambda path, rng: rewritten(path, lambda table: table.drop_columns([name]))


def metadata(name: str, key: str, value: str) -> Spoil:
    def change(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        own = dict(field.metadata) | {key.encode(): value.encode()}
        return table.set_column(index, field.with_metadata(own), table.column(index))

    return lambda path, rng: rewritten(path, change)


def retyped(name: str, kind: pa.DataType) -> Spoil:
    def change(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        return table.set_column(index, table.schema.field(index).with_type(kind), table.column(index).cast(kind))

    return lambda path, rng: rewritten(path, change)


def value(name: str, made: Callable[[Any, np.random.Generator], Any], *, row: int | None = None) -> Spoil:
    """One value of a column changed, in the given row or in one of the first clip's."""

    def spoil(path: Path, rng: np.random.Generator) -> None:
        def change(table: pa.Table) -> pa.Table:
            index = table.schema.get_field_index(name)
            values = table.column(index).to_pylist()
            place = int(rng.integers(EDGE, 30 - EDGE)) if row is None else row
            values[place] = made(values[place], rng)
            field = table.schema.field(index)
            return table.set_column(index, field, pa.array(values, type=field.type))

        rewritten(path, change)

    return spoil


def numbers(name: str, change: Callable[[np.ndarray, np.random.Generator], np.ndarray], **where: int) -> Spoil:
    return value(name, lambda old, rng: change(np.array(old, dtype=float), rng).tolist(), **where)


def with_rows(order: Callable[[int, np.random.Generator], np.ndarray]) -> Spoil:
    return lambda path, rng: rewritten(path, lambda table: table.take(pa.array(order(len(table), rng))))


def document(**changes: Any) -> Spoil:
    return lambda path, rng: path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def cut(path: Path, rng: np.random.Generator) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(rng.uniform(0.3, 0.9) * len(content))])


def swapped_clips(path: Path, rng: np.random.Generator) -> None:
    def change(table: pa.Table) -> pa.Table:
        ids = table.column("clip_id").to_pylist()
        first, second = list(dict.fromkeys(ids))[:2]
        swapped = [{first: second, second: first}.get(name, name) for name in ids]
        index = table.schema.get_field_index("clip_id")
        return table.set_column(index, table.schema.field(index), pa.array(swapped, pa.string()))

    rewritten(path, change)


def leaked_video(path: Path, rng: np.random.Generator) -> None:
    """The same film under two matches, at other frames of it."""

    def change(table: pa.Table) -> pa.Table:
        splits = table.column("split").to_pylist()
        other = next(row for row, split in enumerate(splits) if split != splits[0])
        columns = {name: table.column(name).to_pylist() for name in ("sha256", "first_video_frame")}
        columns["sha256"][0] = columns["sha256"][other] = "ab" * 32
        columns["first_video_frame"][other] = 5000
        for name, values in columns.items():
            index = table.schema.get_field_index(name)
            field = table.schema.field(index)
            table = table.set_column(index, field, pa.array(values, type=field.type))
        return table

    rewritten(path, change)


def clip_twice(path: Path, rng: np.random.Generator) -> None:
    def change(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index("sha256")
        pairs = zip(table.column("match_id").to_pylist(), table.column("sha256").to_pylist(), strict=True)
        values = ["cd" * 32 if match == "a" else video for match, video in pairs]
        return table.set_column(index, table.schema.field(index), pa.array(values, pa.string()))

    rewritten(path, change)


def moved_body(path: Path, rng: np.random.Generator, shift: np.ndarray) -> None:
    """A body of one frame elsewhere, all columns in accord."""
    place = int(rng.integers(EDGE, 30 - EDGE))
    for name in ("joints", "root_position", "joint_translations"):
        count = 24 if name == "joints" else 1
        tiled = np.tile(shift, count)
        moved = lambda old, _, tiled=tiled: old + np.pad(tiled, (0, len(old) - len(tiled)))  # noqa: E731
        numbers(f"player0.{name}", moved, row=place)(path, rng)


def other_digit(path: Path, rng: np.random.Generator) -> None:
    text = path.read_text()
    line = text.index(f"  {DATA}") - 1 - int(rng.integers(0, 60))
    path.write_text(text[:line] + ("0" if text[line] != "0" else "1") + text[line + 1 :])


def again(path: Path, rng: np.random.Generator) -> None:
    pq.write_table(pq.read_table(path), path, compression="snappy")


def ball_below(old: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.array([old[0], old[1], -rng.uniform(0.1, 3.0)])


CORRUPTIONS: dict[str, tuple[str, Spoil, str, str]] = {
    "a missing column": (DATA, drop("player1.joints"), "player1.joints", "the column"),
    "a wrong unit": (DATA, metadata("ball.velocity", "unit", "km/h"), "ball.velocity.unit", "m/s"),
    "a wrong frame": (DATA, metadata("player0.joints", "frame", "camera"), "player0.joints.frame", "world"),
    "another type": (DATA, retyped("source_timestamp", pa.float32()), "source_timestamp", "double"),
    "NaN in a camera that is there": (
        DATA,
        numbers("camera.K", lambda K, rng: np.where(np.arange(9) == rng.integers(0, 9), np.nan, K)),
        "camera.K",
        "numbers, since",
    ),
    "a rotation that is none": (
        DATA,
        numbers("camera.R_cam_from_world", lambda R, rng: R * (1 + rng.uniform(1e-4, 0.1))),
        "camera.R_cam_from_world",
        "orthonormal",
    ),
    "a time that goes back": (
        DATA,
        value("source_timestamp", lambda time, rng: time - rng.uniform(0.05, 0.1)),
        "source_timestamp",
        "more than in the row before",
    ),
    "a capture time that goes back": (
        DATA,
        value("frame.capture_time", lambda time, rng: time - rng.uniform(0.05, 0.1)),
        "frame.capture_time",
        "the row before",
    ),
    "a truncated file": (DATA, cut, "", "a parquet file"),
    "truncated captions": (CAPTIONS, cut, "", "a parquet file"),
    "swapped clip ids": (DATA, swapped_clips, "clip_id", "as in the clip's folder"),
    "captions of another clip": (CAPTIONS, swapped_clips, "clip_id", "as in the clip's folder"),
    "a span outside its clip": (CAPTIONS, value("end_frame", lambda end, rng: 31 + int(rng.integers(99)), row=0),
                                "end_frame", "0 to"),
    "a leaked match": (EPISODES, value("match_id", lambda old, rng: "a", row=5), "match_id", "never divide a match"),
    "a leaked video": (EPISODES, leaked_video, "split", "one video in one split"),
    "the same pictures twice": (EPISODES, clip_twice, "sha256", "no other clip shows"),
    "a row that is gone": (DATA, with_rows(lambda n, rng: np.delete(np.arange(n), rng.integers(2, 28))), "", "rows"),
    "a row twice": (DATA, with_rows(lambda n, rng: np.insert(np.arange(n), (k := rng.integers(2, 28)), k)),
                    "index", "one after another"),
    "a file that is gone": (DATA, lambda path, rng: path.unlink(), "", "which episodes are in"),
    "too many frames": (INFO, document(total_frames=10**6), "total_frames", "at the end of the last episode"),
    "splits that overlap": (INFO, document(splits={"train": "0:6", "test": "5:6"}), "splits.test", "no other split"),
    "statistics that cannot be": (
        STATS,
        document(index={"min": [0], "max": [9], "mean": [11], "std": [1], "count": [9]}),
        "index",
        "min <= mean",
    ),
    "a player unknown to the scene": (CAPTIONS, value("player", lambda old, rng: 2 + int(rng.integers(9)), row=1),
                                      "player", "2 player objects"),
    "a flight of no event": (FLIGHTS, value("end_event", lambda old, rng: 50, row=1), "end_event", "events"),
    "a ball under the ground": (DATA, numbers("ball.position", ball_below), "ball.position", "height"),
    "a body under the ground": (DATA, lambda path, rng: moved_body(path, rng, np.array([0, 0, -rng.uniform(2, 3)])),
                                "player0.joints", "m or higher"),
    "a body that leaps aside": (DATA, lambda path, rng: moved_body(path, rng, np.array([rng.uniform(7, 9), 0, 0])),
                                "player0.root_position", "m/s"),
    "another caption": (DATA, value("player1.caption", lambda old, rng: f"{old} twice"), "player1.caption", "covering"),
    "an event that never was": (EVENTS, value("kind", lambda old, rng: "kick", row=3), "kind", "one of"),
}  # fmt: skip
OF_CHECKSUMS: dict[str, tuple[str, Spoil, str, str]] = {
    "a wrong checksum": (SUMS_PATH, other_digit, "sha256", "sha256sums.txt says"),
    "the same rows in other bytes": (DATA, again, "sha256", "sha256sums.txt says"),
    "a file that nobody packed": (
        DATA,
        lambda path, rng: shutil.copy(path, path.with_name("notes.txt")),
        "sha256",
        "its checksum in",
    ),
    "no checksums": (SUMS_PATH, lambda path, rng: path.unlink(), "", "the file"),
    "a list of something else": (
        SUMS_PATH,
        lambda path, rng: path.write_text("../../etc/passwd\n"),
        "line 1",
        "64 hex",
    ),
}
NAMED = {"a wrong checksum": DATA, "a file that nobody packed": DATA.replace("file-000.parquet", "notes.txt")}
"""Files that are named where they are not the one that was spoilt."""


@pytest.mark.parametrize("name", [*CORRUPTIONS, *OF_CHECKSUMS])
def test_a_corruption_ends_with_exit_code_5_and_names_its_place(
    small_dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    file, spoil, field, expected = (CORRUPTIONS | OF_CHECKSUMS)[name]
    copy = tmp_path / "dataset"
    shutil.copytree(small_dataset, copy)
    seed = sum(name.encode())
    spoil(copy / file, np.random.default_rng(seed))
    if name in CORRUPTIONS:
        write_sums(copy)  # so that the law itself must find it
    assert run(["check", str(copy)]) == 5
    said = capsys.readouterr().out
    named = copy / NAMED.get(name, file)
    place = f"{named}: {field}: expected" if field else f"{named}: expected"
    assert [line for line in said.splitlines() if line.startswith(place) and expected in line], said


def test_a_link_has_no_checksum_and_is_not_followed(small_dataset: Path, tmp_path: Path) -> None:
    copy = tmp_path / "dataset"
    shutil.copytree(small_dataset, copy)
    (copy / "videos").mkdir()
    (copy / "videos" / "loop").symlink_to(copy)
    (copy / "videos" / "file-000.mp4").symlink_to("/etc/hostname")
    assert check_paths([copy]) == []
    (copy / "README.md").write_text("a card that somebody wrote")
    assert check_paths([copy]) == []
