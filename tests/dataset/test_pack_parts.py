"""Splits, rates, statistics, files and videos of a dataset, each by itself."""

import hashlib
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.columns import Column
from pgm_data.dataset.dataset_columns import DATA, FILES_PER_CHUNK, VIDEO_KEY, data_columns
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions, splits_of_matches
from pgm_data.dataset.pack_rate import RateCount, common_rate
from pgm_data.dataset.pack_shards import Shard, ShardWriter
from pgm_data.dataset.pack_stats import RunningStats
from pgm_data.scene import load_scene
from pgm_data.stages.encode_video import encode_video
from pgm_data.video import open_video, write_video
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
names = st.lists(st.text(min_size=1, max_size=8), max_size=40)


@given(matches=names, val=st.floats(0, 0.49), test=st.floats(0, 0.49))
@example(matches=["a", "b", "c"], val=0.49, test=0.49)
def test_every_match_has_one_split_whatever_the_order_and_training_is_never_empty(
    matches: list[str], val: float, test: float
) -> None:
    options = PackOptions(val_share=val, test_share=test)
    splits = splits_of_matches(matches, options)
    assert splits == splits_of_matches([*reversed(matches), *matches], options)
    counts = {split: list(splits.values()).count(split) for split in ("train", "val", "test")}
    count = len(set(matches))
    assert sum(counts.values()) == count
    assert counts["train"] > 0 or count == 0
    for split, share in (("val", val), ("test", test)):
        assert (counts[split] > 0) == (share > 0 and count >= 3)
        assert abs(counts[split] - share * count) <= 1.0 or count < 10


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"val_share": -0.1}, "val_share"),
        ({"test_share": 1.0}, "test_share"),
        ({"val_share": float("nan")}, "val_share"),
        ({"val_share": 0.5, "test_share": 0.5}, "val_share \\+ test_share"),
        ({"file_mb": 0}, "file_mb"),
    ],
)
def test_options_that_leave_nothing_to_train_on_are_refused(options: dict, named: str) -> None:
    with pytest.raises(ValueError, match=f"{named}: expected"):
        PackOptions(**options)


@pytest.mark.parametrize("rate", [1.0, 5.0, 23.976, 24.0, 25.0, 29.97, 30.0, 50.0, 59.94, 60.0, 119.88, 240.0])
def test_the_rate_that_was_meant_is_found_from_rounded_times(rate: float) -> None:
    exact = rate if rate == int(rate) else round(rate) / 1.001
    times = np.round(np.arange(500) / exact * 90000) / 90000 + 12.5
    count = RateCount()
    assert count.add(times) == pytest.approx(exact, rel=1e-12)
    assert count.rate().constant and count.rate().frames_per_second == pytest.approx(exact, rel=1e-12)


@given(st.floats(0.2, 1000.0))
def test_a_rate_is_changed_by_little(rate: float) -> None:
    assert common_rate(rate) == pytest.approx(rate, rel=3e-4, abs=1e-6)


def test_a_late_frame_or_another_rate_makes_a_dataset_s_rate_nominal() -> None:
    even = np.arange(100) / 25
    late = even + 2e-4 * (np.arange(100) == 50)
    for first, second, constant in ((even, even, True), (even, late, False), (even, np.arange(50) / 50, False)):
        count = RateCount()
        count.add(first)
        count.add(second)
        assert (count.rate().frames_per_second, count.rate().constant) == (25.0, constant)
    single = RateCount()
    assert np.isnan(single.add(np.zeros(1))) and not single.rate().constant


@given(
    sizes=st.lists(st.integers(0, 20), min_size=1, max_size=5),
    missing=st.floats(0, 0.9),
    offset=st.sampled_from([0.0, 1e6]),
    seed=st.integers(0, 99),
)
def test_statistics_of_parts_are_those_of_the_whole(sizes: list[int], missing: float, offset: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [rng.normal(offset, 2.0, (size, 3)) for size in sizes]
    for part in parts:
        part[rng.random(part.shape) < missing] = np.nan
    stats = RunningStats([Column(name="x", type="double", size=3, meaning="")])
    for part in parts:
        stats.update({"x": part})
    whole = np.concatenate(parts)
    there = np.isfinite(whole)
    found = stats.document()
    if not there.any(axis=0).all():
        assert found == {}
        return
    for key, function in (("min", np.nanmin), ("max", np.nanmax), ("mean", np.nanmean), ("std", np.nanstd)):
        np.testing.assert_allclose(found["x"][key], function(whole, axis=0), rtol=1e-9, atol=1e-7)
    assert found["x"]["count"] == [int(there.any(axis=1).sum())]


@given(sizes=st.lists(st.integers(0, 4000), min_size=1, max_size=6), cut=st.integers(0, 6))
def test_rows_come_back_in_order_from_files_of_one_split_each(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int], cut: int
) -> None:
    folder = tmp_path_factory.mktemp("shards")
    schema = pa.schema([pa.field("x", pa.int64(), nullable=False)])
    edges = np.cumsum([0, *sizes])
    shards = []
    with ShardWriter(folder, schema, bound_bytes=10**9) as writer:
        for i in range(len(sizes)):
            table = pa.table({"x": np.arange(edges[i], edges[i + 1])}, schema=schema)
            shards.append(writer.add(table, "train" if i < cut else "val"))
    files = [folder / f"{shard.name}.parquet" for shard in writer.shards]
    assert len(files) == len({"train" if i < cut else "val" for i in range(len(sizes))})
    rows = [pq.read_table(path).column("x").to_numpy() for path in files]
    np.testing.assert_array_equal(np.concatenate(rows), np.arange(edges[-1]))
    for shard, path in zip(writer.shards, files, strict=True):
        own = sum(size for size, of in zip(sizes, shards, strict=True) if of == shard)
        metadata = pq.ParquetFile(path).metadata
        assert metadata.num_rows == own
        assert [metadata.row_group(i).num_rows for i in range(metadata.num_row_groups)][:-1] == [3000] * (
            max(-(-own // 3000) - 1, 0)
        )


def test_files_are_counted_on_into_the_next_chunk() -> None:
    assert Shard(number=0, split="train").name == "chunk-000/file-000"
    assert Shard(number=FILES_PER_CHUNK + 2, split="train").name == "chunk-001/file-002"


@pytest.mark.parametrize("scene", ["tennis", "blocks", "badminton"])
def test_the_described_columns_are_those_of_every_scene(scene: str) -> None:
    loaded = load_scene(scene)
    described = {column.name: column for column in DATA.columns}
    optional = [f"{player.name}.betas" for player in loaded.players]
    used = set()
    for column in data_columns(loaded, optional=optional):
        name = re.sub(r"^player\d\.", "player.", column.name)
        assert (described[name].type, described[name].meaning) == (column.type, column.meaning)
        used.add(name)
    assert {name for name in described if name not in used} == (
        set() if loaded.ball else {name for name in described if name.startswith("ball.")}
    )


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two videos beside a work folder: one with two clips, one with one."""
    root = tmp_path_factory.mktemp("filmed")
    rng = np.random.default_rng(0)
    (root / "videos").mkdir()
    for name, clips in (("a", ("a.00", "a.01")), ("b", ("b",))):
        path = root / "videos" / f"{name}.mp4"
        frames = 10 * len(clips)
        write_video(path, iter(rng.integers(0, 255, (frames, 48, 64, 3), dtype=np.uint8)), fps=25.0, crf=30)
        for number, clip in enumerate(clips):
            folder = root / "work" / clip
            first = 10 * number
            write_truth_clip(folder, TENNIS, frames=10, match_id=name, video=path, first_video_frame=first)
    return root


@pytest.mark.parametrize("videos", ["copy", "link", "none"])
def test_each_video_is_copied_or_linked_once_and_episodes_say_where(filmed: Path, tmp_path: Path, videos: str) -> None:
    outcome = pack_work_folders([filmed / "work"], tmp_path / "out", PackOptions(videos=videos))
    assert outcome.problems == () and outcome.videos == (0 if videos == "none" else 2)
    info = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())
    episodes = pq.read_table(tmp_path / "out" / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    assert check_paths([tmp_path / "out"]) == []
    if videos == "none":
        assert info["video_path"] is None and VIDEO_KEY not in info["features"]
        assert not (tmp_path / "out" / "videos").exists() and "video_path" not in episodes[0]
        return
    place = f"videos/{VIDEO_KEY}"
    for episode in episodes:
        path = info["video_path"].format(
            video_key=VIDEO_KEY,
            chunk_index=episode[f"{place}/chunk_index"],
            file_index=episode[f"{place}/file_index"],
        )
        assert path == episode["video_path"]
        assert hashlib.sha256((tmp_path / "out" / path).read_bytes()).hexdigest() == episode["sha256"]
        assert (tmp_path / "out" / path).is_symlink() == (videos == "link")
        span = (episode[f"{place}/from_timestamp"], episode[f"{place}/to_timestamp"])
        first = episode["first_video_frame"] / 25
        assert span == pytest.approx((first, first + 0.4))
    assert len({episode["video_path"] for episode in episodes}) == 2
    assert info["features"][VIDEO_KEY]["shape"] == [48, 64, 3]
    assert info["features"][VIDEO_KEY]["info"]["video.codec"] == "h264"
    if videos == "link":
        # A dataset that is moved together with its videos still finds them.
        assert not any(os.path.isabs(os.readlink(path)) for path in (tmp_path / "out" / "videos").rglob("*.mp4"))


def episodes_at(dataset: Path) -> list[dict]:
    return pq.read_table(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()


@pytest.mark.parametrize("rate", [0.0, 24.9])
def test_encoded_videos_keep_every_frame_and_its_time_or_the_rate_asked_for(
    filmed: Path, tmp_path: Path, rate: float
) -> None:
    options = PackOptions(videos="encode", height=24, crf=30, rate=rate)
    outcome = pack_work_folders([filmed / "work"], tmp_path / "out", options, encode=encode_video)
    assert outcome.problems == () and outcome.videos == 2 and check_paths([tmp_path / "out"]) == []
    frames = {}
    for path in (tmp_path / "out" / "videos").rglob("*.mp4"):
        with open_video(path) as reader:
            frames[path] = [(frame.timestamp, frame.bgr().shape) for frame in reader]
    step = 1 / (rate or 25.0)
    for own in frames.values():
        assert {shape for _, shape in own} == {(24, 32, 3)}
        np.testing.assert_allclose([time for time, _ in own], step * np.arange(len(own)), atol=1e-4)
    assert sorted(len(own) for own in frames.values()) == [10, 20]
    data = pq.read_table(tmp_path / "out" / "data").to_pandas()
    np.testing.assert_allclose(data["timestamp"], step * data["frame_index"], atol=1e-6)
    np.testing.assert_allclose(data["source_timestamp"], data["video_frame"] / 25, atol=1e-9)
    for episode in episodes_at(tmp_path / "out"):
        first = episode[f"videos/{VIDEO_KEY}/from_timestamp"]
        assert first == pytest.approx(step * episode["first_video_frame"])
    info = json.loads((tmp_path / "out" / "meta" / "info.json").read_text())
    assert info["pgm"]["constant_rate"] and info["fps"] == pytest.approx(rate or 25.0)
    assert info["features"][VIDEO_KEY]["shape"] == [24, 32, 3]


def test_a_video_that_cannot_be_encoded_leaves_the_others_and_a_clip_of_another_rate_is_left_out(
    filmed: Path, tmp_path: Path
) -> None:
    work = tmp_path / "work"
    shutil.copytree(filmed / "work", work)
    shutil.copytree(filmed / "videos", tmp_path / "videos")
    (tmp_path / "videos" / "b.mp4").write_bytes(b"no video at all")
    content = {"sha256": hashlib.sha256(b"no video at all").hexdigest(), "bytes": 15}
    document = json.loads((work / "b" / "clip.json").read_text())
    (work / "b" / "clip.json").write_text(json.dumps(document | content))
    write_truth_clip(work / "fast", TENNIS, frames=10, fps=50.0, match_id="f")
    options = PackOptions(videos="encode", rate=25.0)
    outcome = pack_work_folders([work], tmp_path / "out", options, encode=encode_video)
    words = {problem.path.name: problem.reason for problem in outcome.problems}
    assert set(words) == {"b", "fast"} and "without its video" in words["b"] and "expected 25 frames" in words["fast"]
    assert {episode["clip_id"]: episode["video_path"] is None for episode in episodes_at(tmp_path / "out")} == {
        "a.00": False,
        "a.01": False,
        "b": True,
    }
    assert len(list((tmp_path / "out").rglob("*.mp4"))) == 1 and check_paths([tmp_path / "out"]) == []
    with pytest.raises(ValueError, match="encode: expected"):
        pack_work_folders([work], tmp_path / "none", options)
    for wrong in ({"height": 101}, {"crf": 52}, {"rate": -1.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            PackOptions(videos="encode", **wrong)
    with pytest.raises(ValueError, match="only encoding"):
        PackOptions(height=100)


def test_a_video_is_found_where_the_run_of_its_clip_read_it(filmed: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    shutil.copytree(filmed / "work", work)
    (work / "run.json").write_text(json.dumps({"options": {"videos": [str(filmed / "videos")]}}))
    outcome = pack_work_folders([work], tmp_path / "out", PackOptions(videos="link"))
    assert outcome.problems == () and outcome.videos == 2


def test_pictures_that_two_clips_show_are_packed_once_and_matches_of_one_video_share_a_split(
    filmed: Path, tmp_path: Path
) -> None:
    work = tmp_path / "work"
    shutil.copytree(filmed / "work", work)
    video = filmed / "videos" / "b.mp4"
    write_truth_clip(work / "again", TENNIS, frames=4, match_id="b", video=video, first_video_frame=6)
    write_truth_clip(work / "later", TENNIS, frames=4, match_id="x", video=video, first_video_frame=10)
    for number in range(6):
        write_truth_clip(work / f"z{number}", TENNIS, frames=3, match_id=f"z{number}")
    outcome = pack_work_folders([work], tmp_path / "out", PackOptions(videos="none"))
    (problem,) = outcome.problems
    assert problem.path.name in ("again", "b") and "no other clip shows" in problem.reason
    split_of = {episode["match_id"]: episode["split"] for episode in episodes_at(tmp_path / "out")}
    assert split_of["b"] == split_of["x"] and set(split_of.values()) == {"train", "val", "test"}
    assert check_paths([tmp_path / "out"]) == []


def test_a_video_that_is_gone_or_another_is_said_and_the_clip_packed_without_it(filmed: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    content = bytearray((filmed / "videos" / "a.mp4").read_bytes())
    content[-1] ^= 1
    (elsewhere / "a.mp4").write_bytes(content)
    options = PackOptions(videos="copy", video_folder=elsewhere)
    outcome = pack_work_folders([filmed / "work"], tmp_path / "out", options)
    words = {problem.path.name: problem.reason for problem in outcome.problems}
    assert set(words) == {"a.00", "a.01", "b"} and sum(outcome.clips.values()) == 3
    assert "sha256" in words["a.00"] and "nothing there" in words["b"]
    assert not list((tmp_path / "out").rglob("*.mp4"))
    assert check_paths([tmp_path / "out"]) == []
    (elsewhere / "a.mp4").write_bytes(b"cut off")
    again = pack_work_folders([filmed / "work" / "a.00"], tmp_path / "again", PackOptions(video_folder=elsewhere))
    assert "bytes: expected" in again.problems[0].reason
