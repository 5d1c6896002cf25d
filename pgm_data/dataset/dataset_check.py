"""A packed dataset against the contract: what it says of itself, and then every row of it."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pgm_data.dataset.clip_check import shipped_scene
from pgm_data.dataset.dataset_columns import DATA_PATH, EPISODES_PATH, NO_VIDEO, VIDEO_KEY, data_columns
from pgm_data.dataset.document_schemas import RELATIVE_PATH
from pgm_data.dataset.documents import Fault, parse_document
from pgm_data.dataset.findings import Findings
from pgm_data.dataset.laws import as_text
from pgm_data.dataset.pack_meta import episode_schema, feature_of
from pgm_data.dataset.pack_sums import check_sums
from pgm_data.dataset.rows_check import check_rows
from pgm_data.dataset.tables import open_table, stored_schema
from pgm_data.scene import Scene

MOST_EPISODES = 10_000_000
"""Above this, a table of episodes is not read."""
STATISTICS = ("min", "max", "mean", "std")
NULLABLE = re.compile(r"^(videos/|video_path|shutter_s|.*\.identity|.*\.handedness|tasks|ui_boxes_px)")
"""Columns of episodes in which a value may be missing."""

OF_INFO = ("splits.", "total_")
"""Fields of `info.json` that are compared with the table of episodes."""

Info = dict[str, Any]
Episodes = dict[str, list[Any]]
"""Columns of `meta/episodes`."""


def is_dataset(folder: Path) -> bool:
    """Whether a folder holds a packed dataset."""
    return (folder / "meta" / "info.json").exists()


def check_dataset(folder: Path, findings: Findings) -> None:
    """Note every way in which the dataset in the folder misses the contract."""
    path = folder / "meta" / "info.json"
    info = findings.document(path, "dataset_info")
    findings.expect(folder / "README.md")
    if info is None:
        return
    scene = findings.scene or shipped_scene(info["pgm"]["scene"])
    if scene is None:
        findings.say(path, "pgm.scene", "a scene that ships with the package, or --scene", repr(info["pgm"]["scene"]))
        return
    findings.add(path, _info_faults(info, scene))
    _check_tasks(folder / "meta" / "tasks.parquet", info, findings)
    _check_stats(folder / "meta" / "stats.json", info, findings)
    episodes = _read_episodes(folder, info, scene, findings)
    if episodes is not None:
        findings.add(folder / EPISODES_PATH.format(chunk_index=0, file_index=0), _video_faults(folder, episodes))
        check_rows(folder, info, episodes, scene, findings)
    check_sums(folder, findings)


def _info_faults(info: Info, scene: Scene) -> Iterator[Fault]:
    if info["data_path"] != DATA_PATH:
        yield Fault(field="data_path", expected=DATA_PATH, found=repr(info["data_path"]))
    features = info["features"]
    optional = {column.name for column in data_columns(scene, optional=features) if column.name in features}
    declared = {column.name: feature_of(column) for column in data_columns(scene, optional=optional)}
    for name, wanted in declared.items():
        found = features.get(name)
        if found is None:
            yield Fault(field=f"features.{name}", expected="the column", found="none")
        elif (found["dtype"], found["shape"]) != (wanted["dtype"], wanted["shape"]):
            expected = f"{wanted['dtype']} of shape {wanted['shape']}"
            yield Fault(
                field=f"features.{name}", expected=expected, found=f"{found['dtype']} of shape {found['shape']}"
            )
    for name in features:
        if name not in declared and name != VIDEO_KEY:
            yield Fault(
                field=f"features.{name}", expected=f"a column of data of scene {scene.name}", found="the feature"
            )


def _check_tasks(path: Path, info: Info, findings: Findings) -> None:
    if not findings.expect(path):
        return
    findings.files.append(path)
    try:
        with open_table(path) as file:
            rows = file.metadata.num_rows
            if rows != info["total_tasks"]:
                findings.say(path, "", f"{info['total_tasks']} rows, total_tasks of info.json", f"{rows} rows")
                return
            tasks = file.read(columns=["task_index", "task"])
    except (pa.ArrowException, OSError, ValueError) as error:
        findings.say(path, "", "a parquet file with task and task_index", " ".join(str(error).split()))
        return
    if tasks.column("task_index").to_pylist() != list(range(rows)):
        findings.say(path, "task_index", "the row's own number", as_text(tasks.column("task_index").to_pylist()))


def _check_stats(path: Path, info: Info, findings: Findings) -> None:
    if not findings.expect(path):
        return
    findings.files.append(path)
    try:
        stats = parse_document(path)
    except ValueError as error:
        findings.say(path, "", "a document that can be parsed", str(error).removeprefix(f"{path}: "))
        return
    if not isinstance(stats, dict):
        findings.say(path, "", "statistics by column", as_text(stats))
        return
    for name, values in stats.items():
        feature = info["features"].get(name)
        if feature is None:
            findings.say(path, name, "a column of data", "statistics of it")
        elif not _sound_statistics(values, feature["shape"][0], info["total_frames"]):
            expected = f"min <= mean <= max and std of {feature['shape'][0]} components each, and one count"
            findings.say(path, name, expected, as_text(values))


def _sound_statistics(values: Any, size: int, frames: int) -> bool:
    if not isinstance(values, dict) or not {*STATISTICS, "count"} <= values.keys():
        return False
    try:
        least, largest, mean, std = (np.array(values[name], dtype=float) for name in STATISTICS)
        count = [int(number) for number in values["count"]]
    except (TypeError, ValueError):
        return False
    if any(part.shape != (size,) for part in (least, largest, mean, std)) or len(count) != 1:
        return False
    slack = 1e-9 * np.maximum(np.abs(least), np.abs(largest))
    ordered = (least <= mean + slack) & (mean <= largest + slack) & (std >= 0)
    return bool(ordered.all()) and 0 < count[0] <= frames


def _read_episodes(folder: Path, info: Info, scene: Scene, findings: Findings) -> Episodes | None:
    """`meta/episodes` where its columns are what they must be; otherwise that is noted."""
    paths = sorted((folder / "meta" / "episodes").glob("*/*.parquet"))
    path = folder / EPISODES_PATH.format(chunk_index=0, file_index=0)
    if path not in paths:
        findings.say(path, "", "the file", "nothing there")
        return None
    findings.files.extend(paths)
    before = len(findings.violations)
    columns: Episodes = {}
    for part in paths:
        try:
            with open_table(part) as file:
                schema = stored_schema(file)
                wanted = episode_schema(scene, videos="video_path" in schema.names)
                findings.add(part, _episode_schema_faults(schema, wanted))
                if file.metadata.num_rows > MOST_EPISODES:
                    findings.say(part, "", f"at most {MOST_EPISODES} episodes", f"{file.metadata.num_rows}")
                if len(findings.violations) > before:
                    return None
                content = file.read(columns=wanted.names)
        except (pa.ArrowException, OSError, ValueError) as error:
            findings.say(part, "", "a parquet file", " ".join(str(error).split()))
            return None
        for name in wanted.names:
            columns.setdefault(name, []).extend(content.column(name).to_pylist())
    lengths = {len(values) for values in columns.values()}
    findings.add(path, _null_faults(columns))
    if len(lengths) == 1 and len(findings.violations) == before:
        for fault in _episode_faults(columns, info):
            findings.add(folder / "meta" / "info.json" if fault.field.startswith(OF_INFO) else path, [fault])
    return columns if len(findings.violations) == before else None


def _episode_schema_faults(schema: pa.Schema, wanted: pa.Schema) -> Iterator[Fault]:
    for field in wanted:
        indices = schema.get_all_field_indices(field.name)
        if len(indices) != 1:
            yield Fault(field=field.name, expected="the column once", found=f"{len(indices)} times")
        elif str(schema.field(indices[0]).type).replace("item", "element") != str(field.type).replace(
            "item", "element"
        ):
            yield Fault(field=field.name, expected=str(field.type), found=str(schema.field(indices[0]).type))


def _null_faults(columns: Episodes) -> Iterator[Fault]:
    for name, values in columns.items():
        if not NULLABLE.match(name) and None in values:
            yield Fault(field=name, expected="a value", found=f"none in row {values.index(None)}")


def _episode_faults(episodes: Episodes, info: Info) -> Iterator[Fault]:
    """Episodes that are not one after another, or not as many as info.json says; splits that divide a match."""
    count = len(episodes["episode_index"])
    if count != info["total_episodes"]:
        expected = f"{count}, the rows of meta/episodes"
        yield Fault(field="total_episodes", expected=expected, found=f"{info['total_episodes']}")
    index = np.array(episodes["episode_index"], dtype=np.int64)
    first = np.array(episodes["dataset_from_index"], dtype=np.int64)
    end = np.array(episodes["dataset_to_index"], dtype=np.int64)
    length = np.array(episodes["length"], dtype=np.int64)
    for field, bad, expected in (
        ("episode_index", index != np.arange(count), "the row's own number"),
        ("length", length < 1, "at least 1"),
        ("dataset_from_index", first != np.concatenate([[0], end[:-1]])[:count], "the end of the episode before"),
        ("dataset_to_index", end != first + length, "dataset_from_index and the length"),
    ):
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            yield Fault(field=field, expected=expected, found=f"{episodes[field][row]} in row {row}")
    frames = int(end[-1]) if count else 0
    if frames != info["total_frames"]:
        expected = f"{frames}, dataset_to_index at the end of the last episode"
        yield Fault(field="total_frames", expected=expected, found=f"{info['total_frames']}")
    if len(set(episodes["clip_id"])) < count:
        twice = Counter(episodes["clip_id"]).most_common(1)[0][0]
        yield Fault(field="clip_id", expected="every clip once", found=f"{twice!r} more than once")
    yield from _split_faults(episodes, info["splits"])
    yield from twin_faults(episodes)


def twin_faults(clips: Mapping[str, Sequence[Any]]) -> Iterator[Fault]:
    """Pictures that are there twice, one video under two names, and videos that splits divide.

    Videos are told apart by what they hold. Identities are not looked at: they name a person within one match, so
    the same word in two matches says nothing, and one player meets many opponents.

    Args:
        clips: Columns of `meta/episodes`, or the same of `clip.json` of many clips; `split` may be absent.
    """
    seen: dict[str, list[int]] = {}
    for row, video in enumerate(clips["sha256"]):
        if video == NO_VIDEO:
            continue
        others = seen.setdefault(video, [])
        name = clips["clip_id"][row]
        for other in others:
            if clips["first_video_frame"][row] < clips["first_video_frame"][other] + clips["length"][other] and (
                clips["first_video_frame"][other] < clips["first_video_frame"][row] + clips["length"][row]
            ):
                expected = f"pictures that no other clip shows; those of {as_text(clips['clip_id'][other])} overlap"
                yield Fault(field="sha256", expected=expected, found=f"the same video in row {row}, {as_text(name)}")
                return
        for column, expected in (
            ("source_path", "one name for one video"),
            ("split", "one video in one split: splits never divide a match"),
        ):
            if others and column in clips and clips[column][row] != clips[column][others[0]]:
                both = f"{as_text(clips[column][others[0]])} and {as_text(clips[column][row])} in row {row}"
                yield Fault(field=column, expected=expected, found=both)
                return
        others.append(row)


def _split_faults(episodes: Episodes, splits: dict[str, str]) -> Iterator[Fault]:
    count = len(episodes["episode_index"])
    of_episode: list[str] = [""] * count
    for name, span in splits.items():
        first, _, end = span.partition(":")
        if not int(first) <= int(end) <= count:
            yield Fault(field=f"splits.{name}", expected=f"a range of the {count} episodes", found=span)
            return
        if any(of_episode[int(first) : int(end)]):
            yield Fault(field=f"splits.{name}", expected="episodes of no other split", found=span)
        of_episode[int(first) : int(end)] = [name] * (int(end) - int(first))
    for row, (wanted, found) in enumerate(zip(of_episode, episodes["split"], strict=True)):
        if wanted != found:
            yield Fault(field="split", expected=f"{wanted or 'a split'}, by info.json", found=f"{found!r} in row {row}")
            break
    split_of: dict[str, str] = {}
    for match, split in zip(episodes["match_id"], episodes["split"], strict=True):
        if split_of.setdefault(match, split) != split:
            expected = f"match {match} in one split: splits never divide a match"
            yield Fault(field="match_id", expected=expected, found=f"{split_of[match]} and {split}")
            break


def _video_faults(folder: Path, episodes: Episodes) -> Iterator[Fault]:
    for row, name in enumerate(episodes.get("video_path", ())):
        if name is None:
            continue
        if not re.match(RELATIVE_PATH, name):
            yield Fault(field="video_path", expected="a path below the dataset", found=f"{name!r} in row {row}")
            return
        if not (folder / name).is_file():
            yield Fault(field="video_path", expected="its video", found=f"nothing at {name}, row {row}")
            return
