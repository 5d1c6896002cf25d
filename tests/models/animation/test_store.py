"""A store holds what the dataset's rows say, cut where time steps are uneven, and is written once."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pgm_models.animation.encode import decode, encode
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.layout import Layout
from pgm_models.animation.shards import read_episodes
from pgm_models.animation.store import StateStore, open_store, read_store, store_identity
from pgm_models.animation.store_write import FRAME_ARRAYS

Columns = dict[str, np.ndarray]


def read(dataset: Path) -> Columns:
    table = pa.concat_tables([pq.read_table(path) for path in sorted((dataset / "data").glob("*/*.parquet"))])
    columns = {}
    for name in table.column_names:
        values = table.column(name).combine_chunks()
        if pa.types.is_fixed_size_list(values.type):
            columns[name] = values.flatten().to_numpy().reshape(len(values), -1)
        else:
            columns[name] = values.to_numpy(zero_copy_only=False)
    return columns


@pytest.fixture(scope="module")
def layout(tennis_dataset: Path) -> Layout:
    return fit_layout(tennis_dataset)


@pytest.fixture(scope="module")
def store(tennis_dataset: Path, layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> StateStore:
    return open_store(tennis_dataset, layout, tmp_path_factory.mktemp("store"))


def files_of(store: StateStore) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(store.folder.iterdir()) if path.suffix != ".json"}


def test_rows_are_the_encoded_rows_of_the_dataset(tennis_dataset: Path, layout: Layout, store: StateStore) -> None:
    columns = read(tennis_dataset)
    tangent, valid = encode(layout, columns)
    np.testing.assert_array_equal(store.tangent, tangent)
    np.testing.assert_array_equal(store.valid, valid)
    np.testing.assert_array_equal(store.frame, columns["frame_index"])
    np.testing.assert_array_equal(store.time, columns["frame.capture_time"])
    assert store.frames == len(columns["frame_index"])
    assert 0 < (~valid).sum() and not valid[columns["ball.status"] == "none", -2:].any()


def test_each_clip_of_even_steps_is_one_segment(tennis_dataset: Path, store: StateStore) -> None:
    episodes = read_episodes(tennis_dataset)
    assert store.clips == episodes.clips and store.matches == episodes.matches
    lengths = np.bincount(read(tennis_dataset)["episode_index"])
    np.testing.assert_array_equal(store.segment_length, lengths)
    np.testing.assert_array_equal(store.segment_start, np.cumsum(lengths) - lengths)
    np.testing.assert_array_equal(store.segment_clip, np.arange(len(lengths)))
    np.testing.assert_allclose(store.segment_rate, 25.0, rtol=1e-6)
    assert store.clip_of(1) == episodes.clips[1]


def test_captions_of_frames_are_those_of_the_rows(tennis_dataset: Path, store: StateStore) -> None:
    columns = read(tennis_dataset)
    main = store.main_texts(np.asarray(store.span))
    for player in range(2):
        said = np.array([store.texts[row] if row >= 0 else "" for row in main[:, player]], dtype=object)
        np.testing.assert_array_equal(said, columns[f"player{player}.caption"])
    assert len(set(store.texts)) == len(store.texts) > 50


def test_spans_hold_their_alternatives(tennis_dataset: Path, store: StateStore) -> None:
    captions = pq.read_table(tennis_dataset / "captions/chunk-000/file-000.parquet").to_pylist()
    row = captions[len(captions) // 2]
    key = ("episode_index", "player", "start_frame", "end_frame")
    same = [other for other in captions if all(other[name] == row[name] for name in key)]
    expected = tuple(other["text"] for other in sorted(same, key=lambda other: other["alternative"]))
    segment = row["episode_index"]
    (span,) = set(store.captions(segment, row["start_frame"], row["end_frame"])[:, row["player"]].tolist())
    assert store.spans.texts_of(span) == expected and len(expected) > 1
    last = np.array([[span, -1]])
    drawn = store.spans.text_of(last, np.array([[0.999, 0.5]]))
    assert drawn[0, 1] == -1 and store.texts[drawn[0, 0]] == expected[-1]


def test_states_are_read_at_a_stride(store: StateStore) -> None:
    begin = int(store.segment_start[2])
    tangent, valid = store.states(2, 3, 30, 4)
    np.testing.assert_array_equal(tangent, np.asarray(store.tangent)[begin + 3 : begin + 30 : 4])
    np.testing.assert_array_equal(valid, np.asarray(store.valid)[begin + 3 : begin + 30 : 4])
    with pytest.raises(ValueError, match="segment 2: expected frames within 0 to"):
        store.states(2, 0, int(store.segment_length[2]) + 1)


def test_bones_come_back_by_clip(tennis_dataset: Path, layout: Layout, store: StateStore) -> None:
    columns = read(tennis_dataset)
    got = decode(layout, np.zeros((len(store.clips), 1, layout.channels)), store.constants)
    for clip in (0, len(store.clips) - 1):
        row = int(store.segment_start[clip])
        expected = columns["player1.joint_translations"][row, 3:]
        # What varies by less than a tenth of a millimetre between clips is told by its mean.
        np.testing.assert_allclose(got["player1.joint_translations"][clip, 0, 3:], expected, atol=5e-4)
    assert np.ptp(got["player1.joint_translations"][:, 0], axis=0).max() > 1e-3


def test_it_is_written_once(tennis_dataset: Path, layout: Layout, tmp_path: Path) -> None:
    first = open_store(tennis_dataset, layout, tmp_path)
    made = {path: path.stat().st_mtime_ns for path in first.folder.iterdir()}
    again = open_store(tennis_dataset, layout, tmp_path)
    assert again.folder == first.folder
    assert made == {path: path.stat().st_mtime_ns for path in again.folder.iterdir()}
    other = open_store(tennis_dataset, fit_layout(tennis_dataset, matches=first.matches[:1]), tmp_path)
    assert other.folder != first.folder and first.folder.is_dir()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([first.folder.name, other.folder.name])


def test_what_is_not_whole_is_written_again(tennis_dataset: Path, layout: Layout, tmp_path: Path) -> None:
    first = open_store(tennis_dataset, layout, tmp_path)
    before = files_of(first)
    (first.folder / "store.json").unlink()
    (first.folder / "tangent.bin").write_bytes(b"half")
    assert files_of(open_store(tennis_dataset, layout, tmp_path)) == before
    (first.folder / "tangent.bin").unlink()
    with pytest.raises(ValueError, match="expected a store of states"):
        read_store(first.folder)


def test_neither_folder_nor_row_groups_matter(
    tennis_dataset: Path, layout: Layout, store: StateStore, altered, tmp_path: Path
) -> None:
    split = open_store(altered(tennis_dataset, row_group=97), layout, tmp_path / "other")
    assert files_of(split) == files_of(store)


def test_another_dataset_is_another_store(tennis_dataset: Path, layout: Layout, altered) -> None:
    same, other = altered(tennis_dataset), altered(tennis_dataset, lambda columns: first_rows(columns, 900), name="b")
    # Without checksums sizes and names tell.
    assert store_identity(same, layout) != store_identity(tennis_dataset, layout)
    assert store_identity(same, layout) != store_identity(other, layout)


def first_rows(columns: Columns, count: int) -> Columns:
    return {name: values[:count] for name, values in columns.items()}


def test_repeated_pictures_are_left_out_and_uneven_steps_end_segments(
    tennis_dataset: Path, layout: Layout, altered, tmp_path: Path
) -> None:
    def disturbed(columns: Columns) -> Columns:
        columns = first_rows(columns, 300)
        columns["episode_index"][:] = 0
        columns["frame_index"][:] = np.arange(300)
        # As after a conversion: each sixth picture repeats, and times go by those that were taken.
        columns["frame.is_duplicate"] = np.arange(300) % 6 == 5
        taken = np.cumsum(~columns["frame.is_duplicate"]) / 25.0
        taken[180:] += 0.03
        columns["frame.capture_time"] = taken
        return columns

    dataset = altered(tennis_dataset, disturbed)
    store = open_store(dataset, layout, tmp_path / "store")
    assert store.frames == 250 and not (np.asarray(store.frame) % 6 == 5).any()
    np.testing.assert_array_equal(store.segment_start, [0, 150])
    np.testing.assert_array_equal(store.segment_length, [150, 100])
    np.testing.assert_allclose(store.segment_rate, 25.0)


def test_a_dataset_without_captions_has_no_texts(blocks_dataset: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(blocks_dataset, bare, ignore=shutil.ignore_patterns("captions"))
    store = open_store(bare, fit_layout(bare), tmp_path / "store")
    assert store.texts == () and (np.asarray(store.span) == -1).all() and store.span.shape[1] == 1
    assert len(store.spans.first) == 1


def test_blank_captions_are_none(blocks_dataset: Path, tmp_path: Path) -> None:
    mute = tmp_path / "mute"
    shutil.copytree(blocks_dataset, mute)
    path = mute / "captions/chunk-000/file-000.parquet"
    table = pq.read_table(path)
    place = table.schema.get_field_index("text")
    pq.write_table(table.set_column(place, table.schema.field(place), [["  "] * table.num_rows]), path)
    store = open_store(mute, fit_layout(mute), tmp_path / "store")
    assert store.texts == () and (np.asarray(store.span) == -1).all()


def test_three_players(tennis_dataset: Path, altered, three_players, tmp_path: Path) -> None:
    def joined(columns: Columns) -> Columns:
        columns = first_rows(columns, 200)
        third = {f"player2.{n.partition('.')[2]}": v for n, v in columns.items() if n.startswith("player0.")}
        third["player2.status"] = np.array(["none"] * 50 + ["measured"] * 150)
        return {n: v for n, v in columns.items() if not n.startswith("ball.")} | third

    dataset = altered(tennis_dataset, joined)
    layout = fit_layout(dataset, scene=three_players)
    store = open_store(dataset, layout, tmp_path / "store", scene=three_players)
    assert store.span.shape == (200, 3) and len(layout.properties) == 9
    np.testing.assert_array_equal(np.asarray(store.valid)[:, 6:].all(axis=1), np.arange(200) >= 50)
    columns = decode(
        layout, np.zeros((2, 4, layout.channels)), np.zeros((2, layout.constant_channels)), scene=three_players
    )
    assert columns["player2.joints"].shape == (2, 4, 72)


def test_it_pickles_as_its_folder(store: StateStore) -> None:
    content = pickle.dumps(store)
    assert len(content) < 1000
    back = pickle.loads(content)
    np.testing.assert_array_equal(back.tangent, store.tangent)
    assert back.texts == store.texts


def test_unsound_data_leave_nothing_behind(tennis_dataset: Path, layout: Layout, altered, tmp_path: Path) -> None:
    def spoilt(columns: Columns) -> Columns:
        columns["player1.joint_rotations"][1100, 40] = np.nan
        return columns

    with pytest.raises(ValueError, match=r"file-000.parquet: clip .*, frame \d+: player1.joint_rotations\[40\]"):
        open_store(altered(tennis_dataset, spoilt), layout, tmp_path / "store")
    assert list((tmp_path / "store").iterdir()) == []


def test_a_picture_of_no_known_time_is_refused(tennis_dataset: Path, layout: Layout, altered, tmp_path: Path) -> None:
    def timeless(columns: Columns) -> Columns:
        columns["frame.capture_time"][7] = np.nan
        return columns

    with pytest.raises(ValueError, match="frame 7: frame.capture_time: expected a finite number, got nan"):
        open_store(altered(tennis_dataset, timeless), layout, tmp_path / "store")


def test_another_scene_is_refused(blocks_dataset: Path, layout: Layout, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scene: expected tennis, as the layout has it, got blocks"):
        open_store(blocks_dataset, layout, tmp_path)


def test_every_array_of_frames_is_as_long_as_it_says(store: StateStore) -> None:
    for name, dtype in FRAME_ARRAYS.items():
        values = getattr(store, name)
        assert len(values) == store.frames and values.dtype == dtype
        assert not values.flags.writeable
