"""A packed dataset holds the rows of its clips, joined, in whole files, and always the same bytes."""

import gc
import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset
import pyarrow.parquet as pq
import pytest
import yaml

from pgm_data.dataset import pack as pack_module
from pgm_data.dataset.check import check_paths
from pgm_data.dataset.columns import scene_tables, table_columns
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions, PackProblem, PlannedClip
from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import load_scene, scene_from_fields, scene_text
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
LENGTHS = {"a.00": 30, "a.01": 1, "b": 12, "c.00": 25, "c.01": 40, "d": 7}
"""Frames of the clips; a letter is a match."""


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    work = tmp_path_factory.mktemp("packed") / "work"
    for seed, (name, frames) in enumerate(LENGTHS.items()):
        write_truth_clip(work / name, TENNIS, frames=frames, match_id=name[0], seed=seed)
    return work


@pytest.fixture(scope="module")
def dataset(work: Path) -> Path:
    out = work.parent / "dataset"
    outcome = pack_work_folders([work], out)
    assert outcome.problems == () and sum(outcome.clips.values()) == len(LENGTHS)
    return out


def data_of(dataset: Path) -> dict[str, np.ndarray]:
    parts = [read_table(path) for path in sorted((dataset / "data").rglob("*.parquet"))]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def episodes_of(dataset: Path) -> list[dict]:
    return pq.read_table(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()


def hashes(folder: Path) -> dict[str, str]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def test_every_column_of_every_frame_table_comes_back_from_the_joined_rows(work: Path, dataset: Path) -> None:
    data = data_of(dataset)
    assert len(data["index"]) == sum(LENGTHS.values())
    for episode in episodes_of(dataset):
        rows = slice(episode["dataset_from_index"], episode["dataset_to_index"])
        for table in ("camera", "players", "ball"):
            for name, values in read_table(work / episode["clip_id"] / f"{table}.parquet").items():
                joined = data["source_timestamp" if name == "timestamp" else name][rows]
                assert joined.dtype == values.dtype
                np.testing.assert_array_equal(joined, values, err_msg=name)


def test_keys_count_up_and_time_restarts_with_each_episode(dataset: Path) -> None:
    data = data_of(dataset)
    np.testing.assert_array_equal(data["index"], np.arange(len(data["index"])))
    assert data["timestamp"].dtype == np.float32 and not data["task_index"].any()
    for number, episode in enumerate(episodes_of(dataset)):
        rows = data["episode_index"] == number
        assert rows.sum() == episode["length"] == LENGTHS[episode["clip_id"]]
        assert np.flatnonzero(rows)[0] == episode["dataset_from_index"]
        np.testing.assert_allclose(data["timestamp"][rows], np.arange(rows.sum()) / 25, atol=1e-6)


def test_each_frame_has_the_main_caption_that_covers_it(work: Path, dataset: Path) -> None:
    data = data_of(dataset)
    covered = 0
    for episode in episodes_of(dataset):
        captions = read_table(work / episode["clip_id"] / "captions.parquet")
        for player in (0, 1):
            found = data[f"player{player}.caption"][data["episode_index"] == episode["episode_index"]]
            for frame, text in enumerate(found):
                wanted = ""
                for i in range(len(captions["text"])):
                    main = captions["player"][i] == player and captions["alternative"][i] == 0
                    if main and captions["start_frame"][i] <= frame < captions["end_frame"][i]:
                        wanted = captions["text"][i]
                assert text == wanted
                covered += bool(wanted)
    assert 0 < covered < 2 * sum(LENGTHS.values())


def test_all_spans_events_and_flights_are_there_after_their_episode(work: Path, dataset: Path) -> None:
    for table in ("captions", "events", "ball_shots"):
        parts = [read_table(path) for path in sorted((dataset / table).rglob("*.parquet"))]
        found = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        assert list(found) == ["episode_index", *(c.name for c in table_columns(table, TENNIS))]
        for episode in episodes_of(dataset):
            rows = found["episode_index"] == episode["episode_index"]
            for name, values in read_table(work / episode["clip_id"] / f"{table}.parquet").items():
                np.testing.assert_array_equal(found[name][rows], values)


def test_pandas_and_arrow_open_it_and_info_says_what_is_in_it(dataset: Path) -> None:
    frame = pd.read_parquet(dataset / "data")
    assert len(frame) == sum(LENGTHS.values())
    assert np.stack(list(frame["camera.K"])).shape == (len(frame), 9)
    found = pyarrow.dataset.dataset(dataset / "data", format="parquet")
    assert found.count_rows() == len(frame)
    field = found.schema.field("player0.joints")
    assert pa.types.is_fixed_size_list(field.type) and field.type.list_size == 72
    assert field.metadata == {b"unit": b"m", b"frame": b"world"}
    assert found.schema.metadata[b"pgm.schema_version"] == b"1.0"
    tasks = pd.read_parquet(dataset / "meta" / "tasks.parquet")
    assert tasks.index.name == "task" and tasks.loc["tennis", "task_index"] == 0
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert list(info["features"]) == list(frame.columns)
    assert info["features"]["camera.K"] == {"dtype": "float64", "shape": [9], "names": None}
    assert info["features"]["timestamp"] == {"dtype": "float32", "shape": [1], "names": None}
    assert info["pgm"]["constant_rate"] and info["fps"] == 25 and info["video_path"] is None
    assert info["pgm"]["units"]["ball.velocity"] == "m/s"
    card = (dataset / "README.md").read_text()
    head = yaml.safe_load(card.split("---")[1])
    named = [path for config in head["configs"] for part in config["data_files"] for path in part["path"]]
    on_disk = [p.relative_to(dataset).as_posix() for p in dataset.rglob("*/chunk-*/*.parquet") if "meta" not in p.parts]
    assert sorted(named) == sorted(on_disk)
    assert [config["config_name"] for config in head["configs"]] == ["default", "captions", "events", "ball_shots"]


def test_splits_are_ranges_of_episodes_that_divide_no_match_and_no_file(dataset: Path) -> None:
    info = json.loads((dataset / "meta" / "info.json").read_text())
    episodes = episodes_of(dataset)
    assert list(info["splits"]) == ["train", "val", "test"]
    for split, span in info["splits"].items():
        first, end = map(int, span.split(":"))
        assert {episode["split"] for episode in episodes[first:end]} == {split}
    assert len({(e["match_id"], e["split"]) for e in episodes}) == len({e["match_id"] for e in episodes}) == 4
    assert len({(e["data/file_index"], e["split"]) for e in episodes}) == len({e["data/file_index"] for e in episodes})
    assert episodes[0]["player1.handedness"] == "left" and episodes[0]["ui_boxes_px"] == [[10.0, 10.0, 200.0, 60.0]]


def test_statistics_are_those_of_the_whole_columns(dataset: Path) -> None:
    data = data_of(dataset)
    stats = json.loads((dataset / "meta" / "stats.json").read_text())
    assert "clip_id" not in stats and "ball.position" in stats and "camera.inliers" in stats
    for name, found in stats.items():
        values = data[name].reshape(len(data[name]), -1).astype(float)
        for key, function in (("min", np.nanmin), ("max", np.nanmax), ("mean", np.nanmean), ("std", np.nanstd)):
            np.testing.assert_allclose(found[key], function(values, axis=0), rtol=1e-9, atol=1e-9, err_msg=name)
        assert found["count"] == [int(np.isfinite(values).any(axis=1).sum())]
    assert stats["ball.position"]["count"][0] < len(data["index"]), "the ball is never missing"


def test_the_same_clips_give_the_same_bytes_wherever_they_lie(work: Path, dataset: Path, tmp_path: Path) -> None:
    shutil.copytree(work, tmp_path / "elsewhere" / "work")
    pack_work_folders([tmp_path / "elsewhere"], tmp_path / "again")  # found in the folder that holds `work`
    assert hashes(tmp_path / "again") == hashes(dataset)


def test_a_scene_without_a_ball_or_players_has_no_column_of_them(tmp_path: Path) -> None:
    blocks = load_scene("blocks")
    write_truth_clip(tmp_path / "work" / "walk", blocks)
    pack_work_folders([tmp_path / "work"], tmp_path / "blocks")
    names = pq.read_schema(tmp_path / "blocks" / "data" / "chunk-000" / "file-000.parquet").names
    assert "player0.joints" in names and "player0.caption" in names
    assert not any(name.startswith(("ball.", "player1.")) for name in names)
    assert not (tmp_path / "blocks" / "events").exists()
    fields = yaml.safe_load(scene_text("tennis")) | {"name": "court_only"}
    fields["objects"] = {name: o for name, o in fields["objects"].items() if o["kind"] not in ("player", "ball")}
    del fields["ball"]
    court = scene_from_fields(fields)
    assert scene_tables(court) == ("shots", "camera")
    write_truth_clip(tmp_path / "courts" / "empty", court)
    pack_work_folders([tmp_path / "courts"], tmp_path / "court", scene=court)
    names = pq.read_schema(tmp_path / "court" / "data" / "chunk-000" / "file-000.parquet").names
    assert "camera.K" in names and not any(name.startswith(("ball.", "player")) for name in names)
    assert sorted(p.name for p in (tmp_path / "court").iterdir()) == ["README.md", "data", "meta"]
    assert check_paths([tmp_path / "blocks"]) == []
    with pytest.raises(ValueError, match="ships with pgm"):
        pack_work_folders([tmp_path / "courts"], tmp_path / "unknown")


def test_a_stage_that_has_not_run_leaves_nan_and_status_none(tmp_path: Path) -> None:
    tables = ("players", "ball", "events", "ball_shots", "captions")
    write_truth_clip(tmp_path / "work" / "clip", TENNIS, without=tables)
    pack_work_folders([tmp_path / "work"], tmp_path / "out")
    data = data_of(tmp_path / "out")
    for column in (*table_columns("players", TENNIS)[4:], *table_columns("ball", TENNIS)[4:]):
        if column.optional:
            assert column.name not in data
        elif column.type == "string":
            assert set(data[column.name]) == {"none" if column.allowed else ""}
        else:
            assert np.isnan(data[column.name]).all()
    assert set(data["player0.caption"]) == {""}
    assert check_paths([tmp_path / "out"]) == []
    assert "ball.position" not in json.loads((tmp_path / "out" / "meta" / "stats.json").read_text())


def test_optional_columns_exist_where_one_clip_has_them_and_are_nan_in_the_others(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_truth_clip(tmp_path / "work" / name, TENNIS, frames=5)
    path = tmp_path / "work" / "b" / "players.parquet"
    columns = read_table(path) | {"player1.betas": np.ones((5, 10))}
    write_table(path, table="players", scene=TENNIS, columns=columns)
    pack_work_folders([tmp_path / "work"], tmp_path / "out")
    betas = data_of(tmp_path / "out")["player1.betas"]
    assert np.isnan(betas[:5]).all() and (betas[5:] == 1).all()
    assert "player0.betas" not in data_of(tmp_path / "out")
    assert check_paths([tmp_path / "out"]) == []


def spoilt(work: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "work"
    shutil.copytree(work, copy)
    return copy


def test_a_bad_clip_is_named_and_left_out_and_the_others_stay_as_they_are(work: Path, tmp_path: Path) -> None:
    copy = spoilt(work, tmp_path)
    (copy / "a.01" / "clip.json").write_text("{")
    columns = read_table(copy / "b" / "ball.parquet")
    columns["ball.velocity"] = columns["ball.velocity"] + 500.0
    write_table(copy / "b" / "ball.parquet", table="ball", scene=TENNIS, columns=columns)
    (copy / "c.00" / "players.parquet").write_bytes(b"not parquet")
    (copy / "d" / "camera.parquet").unlink()
    said: list[tuple[PlannedClip, PackProblem | None]] = []
    outcome = pack_work_folders([copy], tmp_path / "out", said=lambda clip, problem: said.append((clip, problem)))
    assert {problem.path.name for problem in outcome.problems} == {"a.01", "b", "c.00", "d"}
    words = {problem.path.name: str(problem) for problem in outcome.problems}
    assert "ball.velocity: expected at most 120 m/s" in words["b"] and "camera.parquet" in words["d"]
    assert sorted(episode["clip_id"] for episode in episodes_of(tmp_path / "out")) == ["a.00", "c.01"]
    assert check_paths([tmp_path / "out"]) == []
    assert len(said) == 5 and sum(problem is not None for _, problem in said) == 3


def test_a_text_that_no_table_can_hold_leaves_its_clip_out(work: Path, tmp_path: Path) -> None:
    copy = spoilt(work, tmp_path)
    path = copy / "b" / "clip.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"match_id": "half \ud800"}))
    outcome = pack_work_folders([copy], tmp_path / "out")
    assert [problem.path.name for problem in outcome.problems] == ["b"]
    assert sum(outcome.clips.values()) == len(LENGTHS) - 1


def test_nothing_is_written_when_no_clip_can_be_packed(work: Path, tmp_path: Path) -> None:
    copy = spoilt(work, tmp_path)
    for path in copy.rglob("camera.parquet"):
        path.unlink()
    outcome = pack_work_folders([copy], tmp_path / "out")
    assert outcome.clips == {} and len(outcome.problems) == len(LENGTHS)
    assert list((tmp_path / "out").iterdir()) == []


def test_a_failure_in_the_middle_leaves_nothing_behind(
    work: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(pack_module, "write_meta", broken)
    with pytest.raises(OSError, match="disk is full"):
        pack_work_folders([work], tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_what_cannot_be_one_dataset_is_refused_before_anything_is_written(work: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "work"
    write_truth_clip(other / "b", TENNIS, frames=2)
    with pytest.raises(ValueError, match="clip b: expected once .* --clip-prefix"):
        pack_work_folders([work, other], tmp_path / "out")
    write_truth_clip(tmp_path / "mixed" / "walk", load_scene("blocks"), frames=2)
    with pytest.raises(ValueError, match="expected one for all clips.*blocks.*tennis"):
        pack_work_folders([work, tmp_path / "mixed"], tmp_path / "out")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"expected clips, got no clip\.json"):
        pack_work_folders([tmp_path / "empty"], tmp_path / "out")
    assert not (tmp_path / "out").exists()
    (tmp_path / "out" / "meta").mkdir(parents=True)
    with pytest.raises(ValueError, match="without a dataset"):
        pack_work_folders([work], tmp_path / "out")


def test_a_work_folder_that_is_named_twice_is_packed_once(work: Path, tmp_path: Path) -> None:
    outcome = pack_work_folders([work, work / ".." / "work", work / "b"], tmp_path / "out")
    assert sum(outcome.clips.values()) == len(LENGTHS)


def test_memory_does_not_grow_and_files_end_at_the_bound_in_row_groups_of_3000(tmp_path: Path) -> None:
    source = tmp_path / "source" / "clip"
    write_truth_clip(source, TENNIS, frames=700, match_id="m")
    work = tmp_path / "work"
    for number in range(16):
        folder = work / f"clip.{number:02d}"
        shutil.copytree(source, folder)
        document = json.loads((folder / "clip.json").read_text()) | {"clip_id": folder.name}
        (folder / "clip.json").write_text(json.dumps(document))
        for path in folder.glob("*.parquet"):
            table = pq.read_table(path)
            ids = pa.array([folder.name] * len(table))
            pq.write_table(table.set_column(0, table.schema.field(0), ids), path)
    held: list[int] = []

    def allocated() -> int:
        gc.collect()  # what is no longer used is not held
        return pa.total_allocated_bytes()

    before = allocated()
    options = PackOptions(file_mb=1)
    pack_work_folders([work], tmp_path / "out", options, said=lambda *_: held.append(allocated() - before))
    one_group = 3000 * 2500  # rows, bytes a row
    assert max(held) < 2 * one_group
    assert max(held[8:]) <= 1.2 * max(held[:8])
    files = sorted((tmp_path / "out" / "data").rglob("*.parquet"))
    assert len(files) >= 2
    for path in files:
        groups = pq.ParquetFile(path).metadata
        rows = [groups.row_group(i).num_rows for i in range(groups.num_row_groups)]
        assert all(count == 3000 for count in rows[:-1])
        assert groups.num_rows % 700 == 0
    assert all(10**6 <= path.stat().st_size < 4 * 10**6 for path in files[:-1])
    assert check_paths([tmp_path / "out"]) == []
