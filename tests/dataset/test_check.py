import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pgm_data.dataset.check import LEFTOVER, Violation, check_paths, examine
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.table_check import LARGEST_TABLE
from pgm_data.scene import load_scene, scene_text
from tests.dataset.work_folders import ABSENT, absent_columns, clip_document, write_work

FRAMES = 12
CLIP = "rally.00"


@pytest.fixture(scope="module")
def sound_work(tmp_path_factory) -> Path:
    """A work folder without a fault; copied before it is spoilt."""
    return write_work(tmp_path_factory.mktemp("sound") / "work", frames=FRAMES)


@pytest.fixture
def work(sound_work, tmp_path) -> Path:
    """A work folder to spoil."""
    copy = tmp_path / "work"
    for source in sorted(sound_work.rglob("*")):
        target = copy / source.relative_to(sound_work)
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_file():
            target.write_bytes(source.read_bytes())
    return copy


def rewrite(path: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    """Change a table behind the back of `write_table`."""
    pq.write_table(change(pq.read_table(path)), path)


def with_values(name: str, change: Callable[[np.ndarray], None]) -> Callable[[pa.Table], pa.Table]:
    """The table with the values of one column changed in place."""

    def changed(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        column = table.column(index).combine_chunks()
        if pa.types.is_fixed_size_list(field.type):
            values = column.flatten().to_numpy().reshape(-1, field.type.list_size).copy()
            change(values)
            array = pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), type=field.type)
        else:
            values = np.array(column.to_pylist(), dtype=object if pa.types.is_string(field.type) else None)
            change(values)
            array = pa.array(values.tolist(), type=field.type)
        return table.set_column(index, field, array)

    return changed


def put(row, value) -> Callable[[np.ndarray], None]:
    """Set one row, or one entry, to the value."""

    def change(values: np.ndarray) -> None:
        values[row] = value

    return change


def add(row, value) -> Callable[[np.ndarray], None]:
    """Add the value to one row, or one entry."""

    def change(values: np.ndarray) -> None:
        values[row] = values[row] + value

    return change


def scale(row, value) -> Callable[[np.ndarray], None]:
    """Multiply one row by the value."""

    def change(values: np.ndarray) -> None:
        values[row] = values[row] * value

    return change


def with_document(path: Path, **changes) -> None:
    """Change fields of a JSON document; None takes a field away."""
    value = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({k: v for k, v in value.items() if v is not ...}))


def only(violations: list[Violation], path: Path, field: str) -> Violation:
    """The one violation, which is where it should be."""
    assert [(v.path, v.field) for v in violations] == [(path, field)], [str(v) for v in violations]
    return violations[0]


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis", "blocks"])
def test_a_sound_work_folder_has_no_violation(tmp_path, scene):
    checked = examine([write_work(tmp_path / "work", scene=scene)])
    assert [str(v) for v in checked.violations] == []
    assert len(checked.files) == (16 if scene != "blocks" else 10)


def test_every_sound_file_passes_by_itself_too(sound_work):
    files = [path for path in sound_work.rglob("*") if path.is_file()]
    assert len(files) == 16
    assert check_paths(files) == []
    assert check_paths([sound_work / CLIP]) == []


TABLE_FAULTS = {
    "another clip's rows": ("camera", "clip_id", put(3, "rally.01"), "'rally.00'"),
    "a frame left out": ("camera", "frame_index", put(slice(6, None), np.arange(7, 13)), "the row's own number"),
    "a frame twice": ("camera", "video_frame", put(4, 3), "more than in the row before"),
    "time going back": ("camera", "timestamp", put(4, 0.0), "more than in the row before"),
    "time standing still": ("camera", "timestamp", put(4, 3 / 25), "more than in the row before"),
    "no time": ("camera", "timestamp", put(4, np.nan), "a time within"),
    "absurd time": ("camera", "timestamp", put(11, 1e300), "a time within"),
    "capture time going back": ("camera", "frame.capture_time", put(8, 0.1), "at least that of the row before"),
    "no capture time": ("camera", "frame.capture_time", put(11, np.nan), "a time within"),
    "a repeat with a time of its own": ("camera", "frame.capture_time", put(5, 0.19), "which it repeats"),
    "a repeat's time on a new frame": ("camera", "frame.capture_time", put(9, 8 / 25), "which it does not repeat"),
    "a scaled rotation": ("camera", "camera.R_cam_from_world", scale(3, 1.001), "a rotation"),
    "a reflection": ("camera", "camera.R_cam_from_world", scale(3, -1.0), "a rotation"),
    "a rotation of zeros": ("camera", "camera.R_cam_from_world", put(3, 0.0), "a rotation"),
    "a huge rotation": ("camera", "camera.R_cam_from_world", put(3, 1e200), "a rotation"),
    "a negative focal length": ("camera", "camera.K", put((3, 0), -2750.0), "focal lengths"),
    "a focal length far too long": ("camera", "camera.K", put((3, 4), 3.4e6), "focal lengths"),
    "skew": ("camera", "camera.K", put((3, 1), 0.5), "0 off its diagonal"),
    "a last row that is none": ("camera", "camera.K", put((3, 8), 2.0), "1 at its end"),
    "a principal point far away": ("camera", "camera.K", put((3, 2), 1e7), "principal point"),
    "an absurd lens": ("camera", "camera.distortion", put((3, 0), 1e9), "terms of a lens"),
    "an infinite number": ("camera", "camera.focal_std_px", put(3, np.inf), "finite numbers"),
    "NaN in a measured camera": ("camera", "camera.distortion", put((3, 1), np.nan), "camera.status is not none"),
    "a number where there is no camera": ("camera", "camera.K", put((11, 4), 0.0), "NaN, since camera.status is none"),
    "an error of no camera": ("camera", "camera.reprojection_px", put(11, 0.0), "NaN, since camera.status is none"),
    "a camera under the ground": (
        "camera",
        "camera.t_cam_from_world",
        scale(3, -1.0),
        "above the ground",
    ),
    "a camera on the moon": ("camera", "camera.t_cam_from_world", scale(3, 1e7), "within 1000 m"),
    "an unknown status": ("camera", "camera.status", put(3, "guessed"), "one of measured"),
    "no reason for no camera": ("camera", "camera.reason", put(11, ""), "why camera.status is not measured"),
    "support by nothing": ("camera", "camera.inliers", put(3, 0), "at least 1"),
    "a count below zero": ("camera", "camera.inliers", put(11, -1), "at least 0"),
    "an error below zero": ("camera", "camera.reprojection_px", put(3, -0.1), "at least 0"),
    "no error of a measured camera": ("camera", "camera.reprojection_px", put(3, np.nan), "camera.status is measured"),
    "no uncertainty": ("camera", "camera.position_cov", put(3, np.nan), "camera.status is not none"),
    "a covariance that is none": ("camera", "camera.position_cov", put((3, 1), 1.0), "positive semidefinite"),
    "half a covariance": ("camera", "camera.position_cov", put((3, 2), np.nan), "six numbers, or six NaN"),
    "a negative variance": ("camera", "camera.position_cov", put((3, 0), -1e-4), "positive semidefinite"),
    "a player where there is none": ("players", "player1.joints", put((3, 7), 0.5), "player1.status is none"),
    "a probability above one": ("players", "player0.contact", put((3, 0), 1.5), "player0.status is none"),
    "a ball where there is none": ("ball", "ball.position", put((3, 0), 0.5), "ball.status is none"),
    "an unknown event": ("events", "kind", put(0, "smash"), "one of hit"),
    "an event after the end": ("events", "frame_index", put(1, FRAMES), "0 to 11"),
    "an event before the start": ("events", "frame_index", put(0, -1), "0 to 11"),
    "an improbable probability": ("events", "probability", put(0, 1.01), "a probability"),
    "an unknown player": ("events", "player", put(0, "player7"), "one of player0, player1"),
    "an event of another clip": ("events", "clip_id", put(0, "rally.01"), "'rally.00'"),
    "a flight to no event": ("ball_shots", "end_event", put(0, 2), "one of the 2 events"),
    "a flight that ends before it starts": ("ball_shots", "end_time", put(0, 0.01), "after start_time"),
    "a flight with negative drag": ("ball_shots", "drag_per_m", put(0, -0.02), "at least 0"),
    "a caption past the end": ("captions", "end_frame", put(1, FRAMES + 1), "0 to 12"),
    "a caption of no frame": ("captions", "end_frame", put(0, 0), "a frame after start_frame"),
    "a caption of nobody": ("captions", "player", put(0, 2), "the index of one of 2"),
    "an alternative before the main text": ("captions", "alternative", put(0, -1), "at least 0"),
    "a text that ends before it starts": ("captions", "end_s", put(0, -1.0), "at least start_s"),
    "a flight from before the first event": ("ball_shots", "start_event", put(0, -1), "at least 0"),
    "a flight that ends where it starts": ("ball_shots", "end_event", put(0, 0), "an event after start_event"),
    "a caption without words": ("captions", "text", put(0, "  "), "words"),
}


@pytest.mark.parametrize("name", TABLE_FAULTS)
def test_one_wrong_value_is_found_and_nothing_else(work, name):
    table, column, change, expected = TABLE_FAULTS[name]
    path = work / CLIP / f"{table}.parquet"
    rewrite(path, with_values(column, change))
    found = [v for v in check_paths([work / CLIP]) if v.path == path]
    named = [v for v in found if v.field == column and expected in v.expected]
    assert named, [str(v) for v in found]
    # The same value may break a second law of its own column, but no other column is blamed.
    assert {v.field for v in found} == {column}, [str(v) for v in found]


def test_rows_are_counted_and_the_first_is_shown(work):
    path = work / CLIP / "camera.parquet"
    rewrite(path, with_values("camera.reprojection_px", put(slice(3, 7), -0.5)))
    found = only(check_paths([work]), path, "camera.reprojection_px")
    assert found.found == "-0.5 in row 3 and 3 more"


def test_values_where_nothing_was_solved_are_judged_by_their_status_only(work):
    # Simulated truth and foreign cameras owe neither support nor uncertainty.
    path = work / CLIP / "camera.parquet"
    for column in ("camera.position_cov", "camera.focal_std_px", "camera.reprojection_px"):
        rewrite(path, with_values(column, put(slice(None), np.nan)))
    rewrite(path, with_values("camera.inliers", put(slice(None), 0)))
    assert check_paths([work])
    for quality in ("truth", "imported"):
        with_document(work / CLIP / "clip.json", quality=quality)
        assert check_paths([work]) == []


PLAYER_FAULTS = {
    "player0.box_px": (np.array([30.0, 10, 20, 40]), "x0 < x1"),
    "player0.contact": (np.array([0.5, 1.5]), "a probability"),
    "player0.root_cov": (np.array([1.0, 0, 0, -1, 0, 1]), "positive semidefinite"),
    "player0.reprojection_px": (-1.0, "at least 0"),
}


@pytest.mark.parametrize("column", PLAYER_FAULTS)
def test_a_player_who_is_there_is_judged_by_physics(work, column):
    value, expected = PLAYER_FAULTS[column]
    path = work / CLIP / "players.parquet"
    rewrite(path, with_values("player0.status", put(3, "measured")))
    assert only(check_paths([work]), path, "player0.root_position").expected.startswith("numbers, since")
    rewrite(path, with_values("player0.root_position", put(3, np.array([0.0, -12, 1]))))
    assert check_paths([work]) == []
    rewrite(path, with_values(column, put(3, value)))
    assert expected in only(check_paths([work]), path, column).expected


def test_a_camera_may_stand_below_the_origin_where_there_is_no_court(tmp_path):
    work = write_work(tmp_path / "work", scene="blocks")
    rewrite(work / CLIP / "camera.parquet", with_values("camera.t_cam_from_world", scale(3, -1.0)))
    assert check_paths([work]) == []


def drop(name: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.drop_columns([name])


def retype(name: str, kind: pa.DataType) -> Callable[[pa.Table], pa.Table]:
    def changed(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        array = pa.array(table.column(index).to_pylist(), type=kind)
        return table.set_column(index, pa.field(name, kind, metadata=field.metadata), array)

    return changed


def reunit(name: str, unit: str) -> Callable[[pa.Table], pa.Table]:
    def changed(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        return table.cast(table.schema.set(index, field.with_metadata({**field.metadata, b"unit": unit.encode()})))

    return changed


def extra(name: str, values) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.append_column(name, pa.array(values))


def metadata(**changes: str) -> Callable[[pa.Table], pa.Table]:
    return lambda table: table.replace_schema_metadata(
        {**table.schema.metadata, **{f"pgm.{k}".encode(): v for k, v in changes.items()}}
    )


def with_null(name: str) -> Callable[[pa.Table], pa.Table]:
    def changed(table: pa.Table) -> pa.Table:
        index = table.schema.get_field_index(name)
        field = table.schema.field(index)
        values = table.column(index).to_pylist()
        return table.set_column(index, field.with_nullable(True), pa.array([None, *values[1:]], type=field.type))

    return changed


SCHEMA_FAULTS = {
    "a missing column": ("camera", drop("camera.focal_std_px"), "camera.focal_std_px", "the column"),
    "an undeclared column": ("camera", extra("camera.zoom", [1.0] * FRAMES), "camera.zoom", "no such column"),
    "a column twice": ("camera", extra("timestamp", [1.0] * FRAMES), "timestamp", "the column once"),
    "float for double": ("camera", retype("timestamp", pa.float32()), "timestamp", "double"),
    "numbers as text": ("camera", retype("camera.status", pa.large_binary()), "camera.status", "string"),
    "a list of any length": (
        "camera",
        retype("camera.K", pa.list_(pa.float64())),
        "camera.K",
        "fixed_size_list<double>[9]",
    ),
    "another length": (
        "players",
        lambda t: t.drop_columns(["player0.box_px"]).append_column(
            "player0.box_px", pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(5 * FRAMES, np.float32)), 5)
        ),
        "player0.box_px",
        "fixed_size_list<float>[4]",
    ),
    "a wrong unit": ("camera", reunit("timestamp", "ms"), "timestamp.unit", "s"),
    "a newer major version": ("camera", metadata(schema_version="2.0"), "pgm.schema_version", "1.0"),
    "another table": ("camera", metadata(table="ball"), "pgm.table", "camera"),
    "another scene": ("camera", metadata(scene="blocks"), "pgm.scene", "tennis"),
    "a null": ("camera", with_null("camera.status"), "camera.status", "values without nulls"),
}


@pytest.mark.parametrize("name", SCHEMA_FAULTS)
def test_a_table_of_another_schema_is_found_out(work, name):
    table, change, field, expected = SCHEMA_FAULTS[name]
    path = work / CLIP / f"{table}.parquet"
    rewrite(path, change)
    found = check_paths([work])
    assert (path, field) in {(v.path, v.field) for v in found}, [str(v) for v in found]
    assert expected in next(v for v in found if v.field == field).expected
    assert {v.path for v in found} == {path}


def test_an_optional_column_may_be_there_and_may_not(work):
    path = work / CLIP / "players.parquet"
    names = pq.read_schema(path).names
    assert "player0.betas" not in names
    scene = load_scene("tennis")
    from pgm_data.dataset.columns import table_columns
    from pgm_data.dataset.tables import read_table, write_table

    columns = read_table(path) | {"player0.betas": np.zeros((FRAMES, 10)), "player1.betas": np.zeros((FRAMES, 10))}
    assert len(absent_columns(table_columns("players", scene), FRAMES)) == len(names)
    write_table(path, table="players", scene=scene, columns=columns)
    assert check_paths([work]) == []


def test_tables_that_the_scene_does_not_declare_are_violations(work, tmp_path):
    blocks = write_work(tmp_path / "blocks", scene="blocks")
    ball = blocks / CLIP / "ball.parquet"
    ball.write_bytes((work / CLIP / "ball.parquet").read_bytes())
    assert "declares no ball" in only(check_paths([blocks]), ball, "").expected


def test_columns_of_objects_that_the_scene_does_not_declare_are_violations(work, tmp_path):
    blocks = write_work(tmp_path / "blocks", scene="blocks")
    players = blocks / CLIP / "players.parquet"
    players.write_bytes((work / CLIP / "players.parquet").read_bytes())
    found = check_paths([blocks])
    assert {v.path for v in found} == {players}
    fields = {v.field for v in found}
    assert {"player1.joints", "player0.joints", "pgm.scene"} <= fields


@pytest.mark.parametrize("table", ["players", "ball"])
def test_frame_tables_that_disagree_are_found_out(work, table):
    path = work / CLIP / f"{table}.parquet"
    rewrite(path, with_values("video_frame", add(slice(5, None), 1)))
    assert "as in camera.parquet" in only(check_paths([work]), path, "video_frame").expected


def test_a_table_cut_short_is_found_out(work):
    path = work / CLIP / "players.parquet"
    rewrite(path, lambda table: table.slice(0, FRAMES - 1))
    found = check_paths([work])
    assert {(v.path, v.field) for v in found} == {(path, "")}
    assert any(v.expected == "12 rows, n_frames of clip.json" for v in found)


SHOTS_FAULTS = {
    "a clip without a folder": ("clip_id", put(slice(15, 27), "rally.02"), "clip_id"),
    "a verdict without its clip": ("clip_id", put(3, ""), "clip_id"),
    "a clip outside of its verdict": ("clip_id", put(13, "rally.00"), "clip_id"),
    "a frame of the video missing": ("video_frame", put(slice(28, None), np.array([5, 6, 7])), "video_frame"),
    "time going back": ("timestamp", put(13, 0.0), "timestamp"),
    "no reason": ("reason", put(13, ""), "reason"),
    "an unknown verdict": ("verdict", put(13, "nice"), "verdict"),
    "an absolute path": ("video", put(slice(27, None), "/videos/crowd.mp4"), "video"),
    "a path that climbs": ("video", put(slice(27, None), "../../crowd.mp4"), "video"),
    "a video in two parts": ("video", put(slice(13, 14), "../videos/crowd.mp4"), "video"),
    "another time than the camera's": ("timestamp", add(3, 1e-4), "timestamp"),
    "another video than the clip's": ("video", put(slice(0, 27), "../videos/other.mp4"), "video"),
}


@pytest.mark.parametrize("name", SHOTS_FAULTS)
def test_shots_that_do_not_fit_are_found_out(work, name):
    column, change, field = SHOTS_FAULTS[name]
    path = work / "shots.parquet"
    rewrite(path, with_values(column, change))
    found = check_paths([work])
    assert field in {v.field for v in found}, [str(v) for v in found]
    assert {v.path for v in found} == {path}


def test_a_clip_folder_without_rows_in_shots_is_found_out(work):
    (work / "rally.01").rename(work / "rally.09")
    found = check_paths([work])
    shots = [v for v in found if v.path == work / "shots.parquet"]
    assert {(v.expected, v.found) for v in shots} == {
        ("clips that have a folder", "'rally.01'"),
        ("rows of clip rally.09, which has a folder", "none"),
    }
    assert "'rally.09'" in next(v for v in found if v.field == "clip_id" and v.path.name == "clip.json").expected


def test_swapped_clip_folders_are_found_out(work):
    (work / "rally.00").rename(work / "aside")
    (work / "rally.01").rename(work / "rally.00")
    (work / "aside").rename(work / "rally.01")
    found = check_paths([work])
    assert {v.path.parent.name for v in found if v.path.name == "clip.json"} == {"rally.00", "rally.01"}


def test_missing_files_are_named(work):
    for name in ("run.json", "shots.parquet", f"{CLIP}/clip.json", "rally.01/camera.parquet"):
        (work / name).unlink()
    missing = {v.path.relative_to(work).as_posix() for v in check_paths([work]) if v.found == "nothing there"}
    assert missing == {"run.json", "shots.parquet", f"{CLIP}/clip.json", "rally.01/camera.parquet"}


def test_a_table_in_the_wrong_folder_is_found_out(work):
    (work / "camera.parquet").write_bytes((work / CLIP / "camera.parquet").read_bytes())
    (work / CLIP / "shots.parquet").write_bytes((work / "shots.parquet").read_bytes())
    found = check_paths([work])
    assert {v.path for v in found} == {work / "camera.parquet", work / CLIP / "shots.parquet"}


def test_an_empty_folder_is_no_work_folder(tmp_path):
    assert {v.path.name for v in check_paths([tmp_path])} == {"run.json", "shots.parquet"}


@pytest.mark.parametrize(
    "name",
    [".camera.parquet.4321.tmp", ".overlay.4321.part.mp4", ".state.json.77", "overlay.mp4.part", "clip.json.tmp", "a~"],
)
def test_unfinished_files_are_reported(work, name):
    for folder in (work, work / CLIP):
        (folder / name).write_bytes(b"")
    assert {v.path for v in check_paths([work])} == {work / name, work / CLIP / name}


def test_pictures_reports_and_a_runs_own_state_are_left_alone(work):
    for name in ("overlay.mp4", "report.html", ".DS_Store", "notes.txt"):
        assert not LEFTOVER.search(name)
        (work / CLIP / name).write_bytes(b"\x00")
    (work / ".pgm").mkdir()
    (work / ".pgm" / ".jobs.jsonl.5.tmp").write_bytes(b"")
    (work / "plots").mkdir()
    assert check_paths([work]) == []


@pytest.mark.parametrize("name", ["shots.parquet", f"{CLIP}/camera.parquet", f"{CLIP}/players.parquet"])
@pytest.mark.parametrize("spoil", ["empty", "truncated", "garbled", "text", "pickle"])
def test_files_that_are_no_parquet_are_one_violation_each(work, name, spoil):
    path = work / name
    content = path.read_bytes()
    pickled = pickle.dumps(_Bomb())
    middle = len(content) // 2
    path.write_bytes(
        {
            "empty": b"",
            "truncated": content[:middle],
            "garbled": content[:-300] + b"\xff" * 292 + content[-8:],
            "text": b"clip_id,frame_index\n",
            "pickle": pickled,
        }[spoil]
    )
    found = [v for v in check_paths([work]) if v.path == path]
    assert [(v.field, v.expected) for v in found] == [("", "a parquet file")]


class _Bomb:
    """Ends the test if it is ever unpickled."""

    def __reduce__(self):
        return (pytest.exit, ("a file that was checked has been unpickled",))


def test_pages_with_bits_flipped_are_found_or_harmless(work):
    # Whatever bits do, the check comes back with an answer.
    path = work / CLIP / "camera.parquet"
    content = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(20):
        spoilt = bytearray(content)
        for place in rng.integers(0, len(content), 3):
            spoilt[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(spoilt))
        assert all(isinstance(v, Violation) for v in check_paths([work / CLIP]))


def test_a_column_full_of_nan_is_found_out(work):
    path = work / CLIP / "camera.parquet"
    for name in ("camera.K", "timestamp", "frame.capture_time"):
        rewrite(path, with_values(name, put(slice(None), np.nan)))
    assert {"camera.K", "timestamp", "frame.capture_time"} <= {v.field for v in check_paths([work])}


def test_a_table_of_absurdly_many_rows_is_not_read(tmp_path):
    # Four megabytes that would fill the memory.
    rows = 40_000_000
    words = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int8)), pa.array(["x" * 1000]))
    path = tmp_path / "camera.parquet"
    pq.write_table(pa.table({"clip_id": words}), path)
    assert path.stat().st_size < LARGEST_TABLE / 500
    found = check_paths([path])
    assert "rows" in {v.field for v in found}


@pytest.mark.parametrize(
    "source_path",
    [
        "/etc/passwd",
        "../../video.mp4",
        "videos/../../secret.mp4",
        "C:/video.mp4",
        "..\\video.mp4",
        "videos//a.mp4",
        "./a.mp4",
        "..",
        "",
        "a.mp4\n",
        "a\x00.mp4",
    ],
)
def test_paths_that_lead_astray_are_refused(work, source_path):
    path = work / CLIP / "clip.json"
    with_document(path, source_path=source_path)
    assert (path, "source_path") in {(v.path, v.field) for v in check_paths([work])}


@pytest.mark.parametrize(
    "source_path", ["a.mp4", "deep/er/a b.mp4", "../videos/a.mp4", "..a.mp4", "é.mp4", "a..b/c.mp4"]
)
def test_paths_below_or_beside_the_work_folder_are_fine(source_path):
    from pgm_data.dataset.documents import document_faults

    document = clip_document("a", scene=load_scene("tennis"), frames=12) | {"source_path": source_path}
    assert document_faults("clip", document) == ()


DOCUMENT_FAULTS = {
    "no number": ({"n_frames": "12"}, "n_frames"),
    "no frames": ({"n_frames": 0}, "n_frames"),
    "half a frame": ({"n_frames": 11.5}, "n_frames"),
    "a huge picture": ({"width": 10**30}, "width"),
    "an unknown field": ({"colour": "green"}, "colour"),
    "a missing field": ({"sha256": ...}, "sha256"),
    "a short hash": ({"sha256": "abc"}, "sha256"),
    "an unknown quality": ({"quality": "superb"}, "quality"),
    "an unknown scene": ({"scene": "curling"}, "scene"),
    "a scene by its path": ({"scene": "/etc/scene.yaml"}, "scene"),
    "a box inside out": ({"ui_boxes_px": [[10, 10, 5, 20]]}, "ui_boxes_px[0]"),
    "a player of no object": ({"players": {"player9": {}}}, "players.player9"),
    "a share above one": ({"solved_share": 1.2}, "solved_share"),
    "a share that is not the table's": ({"solved_share": 0.7}, "solved_share"),
    "an empty list for a model": ({"lens_model": []}, "lens_model"),
    "an unlikely hand": ({"players": {"player0": {"handedness": "both"}}}, "players.player0.handedness"),
    "a negative deviation": ({"camera": {"position_std": [0.1, -0.1, 0.1]}}, "camera.position_std"),
    "a range the wrong way": ({"camera": {"focal_px_range": [3000, 2000]}}, "camera.focal_px_range"),
}


@pytest.mark.parametrize("name", DOCUMENT_FAULTS)
def test_wrong_fields_of_a_clip_are_found_out(work, name):
    changes, field = DOCUMENT_FAULTS[name]
    path = work / CLIP / "clip.json"
    with_document(path, **changes)
    found = [v for v in check_paths([work]) if v.path == path]
    assert [v.field for v in found] == [field], [str(v) for v in found]


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "null",
        "3",
        '{"clip_id": NaN}',
        "{'a': 1}",
        "\ufeff{}",
        "[" * 100_000,
        '{"n_frames": ' + "9" * 5000 + "}",
    ],
)
def test_documents_that_are_none_are_refused(work, content):
    path = work / CLIP / "clip.json"
    path.write_text(content, encoding="utf-8")
    assert path in {v.path for v in check_paths([work])}


def test_a_single_camera_is_checked_beyond_its_schema(tmp_path):
    path = tmp_path / "camera.json"
    R = np.eye(3)
    sound = {
        "width": 1920,
        "height": 1080,
        "K": [2000.0, 0, 960, 0, 2000, 540, 0, 0, 1],
        "distortion": [0.0] * 4,
        "R_cam_from_world": R.reshape(-1).tolist(),
        "t_cam_from_world": [0.0, 0, 20],
    }
    write_document(path, "camera", sound)
    assert check_paths([path]) == []
    for change, field in (
        ({"R_cam_from_world": (1.1 * R).reshape(-1).tolist()}, "R_cam_from_world"),
        ({"K": [1.0, 0, 960, 0, 2000, 540, 0, 0, 1]}, "K"),
        ({"K": [2000.0, 0, 960]}, "K"),
        ({"t_cam_from_world": [0, 0, 1e9]}, "t_cam_from_world"),
        ({"note": ""}, "note"),
    ):
        path.write_text(json.dumps(sound | change))
        only(check_paths([path]), path, field)


def test_a_prompt_is_checked_against_its_own_length(tmp_path):
    path = tmp_path / "prompt.json"
    text = {"player": 0, "start_frame": 0, "end_frame": 20, "text": "serves wide"}
    prompt = {"scene": "tennis", "n_frames": 20, "frames_per_second": 25, "texts": [text]}
    write_document(path, "prompt", prompt)
    assert check_paths([path]) == []
    path.write_text(json.dumps(prompt | {"n_frames": 19}))
    only(check_paths([path]), path, "texts[0]")


def test_scene_and_skeleton_files_are_told_apart_and_checked(tmp_path):
    scene = tmp_path / "mine.yaml"
    scene.write_text(scene_text("tennis"))
    assert check_paths([scene]) == []
    scene.write_text(scene_text("tennis").replace("near_service_T, far_service_T", "near_service_T, nowhere"))
    only(check_paths([scene]), scene, "court.lines.centre_service_line.ends")
    skeleton = tmp_path / "bones.yaml"
    skeleton.write_text(
        "name: bones\njoints:\n  a: {parent: b, rest_m: [0, 0, 0]}\npoints:\n  a: {joint: a, at_m: [0, 0, 0]}\n"
        "soles: {left: [a], right: [a]}\nkeypoints: [a]\n"
    )
    only(check_paths([skeleton]), skeleton, "joints.a.parent")


def test_a_scene_of_ones_own_is_taken_in_place_of_an_unknown_one(work):
    for path in (work / CLIP / "clip.json", work / "rally.01" / "clip.json"):
        with_document(path, scene="mine")
    for path in work.rglob("*.parquet"):
        rewrite(path, metadata(scene="mine"))
    assert {v.field for v in check_paths([work])} == {"scene"}
    found = examine([work], scene=load_scene("tennis")).violations
    assert {v.field for v in found} == {"pgm.scene"}


def test_files_whose_name_tells_nothing_need_their_kind(tmp_path, work):
    path = tmp_path / "thing.json"
    path.write_bytes((work / CLIP / "clip.json").read_bytes())
    assert "--kind" in only(check_paths([path]), path, "").expected
    assert examine([path], kind="clip").violations == ()
    table = tmp_path / "thing.parquet"
    table.write_bytes((work / CLIP / "camera.parquet").read_bytes())
    assert "--kind" in only(check_paths([table]), table, "").expected
    assert examine([table], kind="camera").violations == ()
    with pytest.raises(ValueError, match="expected one of"):
        examine([path], kind="thing")


def test_nothing_at_a_path_is_an_error_and_not_a_violation(tmp_path):
    with pytest.raises(ValueError, match="nothing there"):
        check_paths([tmp_path / "absent"])


def test_a_pipe_in_place_of_a_file_does_not_hang(work):
    for name in ("run.json", "shots.parquet", f"{CLIP}/clip.json", f"{CLIP}/camera.parquet"):
        (work / name).unlink()
        os.mkfifo(work / name)
    names = {v.path.relative_to(work).as_posix() for v in check_paths([work])}
    assert {"run.json", "shots.parquet", f"{CLIP}/clip.json", f"{CLIP}/camera.parquet"} <= names


def test_what_is_printed_cannot_move_the_cursor(work):
    with_document(work / CLIP / "clip.json", **{"\x1b[2J": 1})
    lines = [str(v) for v in check_paths([work])]
    assert any("\\x1b[2J" in line for line in lines)
    assert not any("\x1b" in line for line in lines)


def test_absent_cameras_are_those_at_the_end():
    assert 0 < ABSENT < FRAMES - 6  # the faults above rely on rows 0 to 5 having a camera and row 11 none
