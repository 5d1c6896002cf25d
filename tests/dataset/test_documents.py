import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.dataset.document_schemas import document_kinds
from pgm_data.dataset.documents import document_faults, parse_document, read_document, write_document
from pgm_data.scene import load_scene, scene_names, scene_text
from pgm_data.skeleton import skeleton_names
from tests.dataset.work_folders import clip_document, run_document

CLIP = clip_document("rally.00", scene=load_scene("tennis"), frames=12)


def test_every_kind_of_the_contract_is_there():
    assert document_kinds() == ("scene", "skeleton", "clip", "run", "camera", "camera_path", "dataset_info", "prompt")


@pytest.mark.parametrize(("kind", "value"), [("clip", CLIP), ("run", run_document())])
@pytest.mark.parametrize("suffix", [".json", ".yaml"])
def test_what_is_read_is_what_was_written(tmp_path, kind, value, suffix):
    path = tmp_path / f"document{suffix}"
    write_document(path, kind, value)
    assert read_document(path, kind) == value
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("scene", scene_names())
def test_shipped_scenes_hold_to_their_schema(tmp_path, scene):
    path = tmp_path / f"{scene}.yaml"
    path.write_text(scene_text(scene))
    assert read_document(path, "scene")["name"] == scene


def test_shipped_skeletons_hold_to_their_schema():
    import pgm_data.scenes

    folder = Path(pgm_data.scenes.__path__[0]) / "skeletons"
    for name in skeleton_names():
        assert read_document(folder / f"{name}.yaml", "skeleton")["name"] == name


def test_a_document_of_lerobot_with_our_block_is_valid():
    info = {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": 2,
        "total_frames": 24,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 25,
        "splits": {"train": "0:2"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": {"camera.K": {"dtype": "float64", "shape": [9], "names": None}},
        "pgm": {"schema_version": "1.0", "scene": "tennis", "units": {"camera.K": "px"}, "constant_rate": True},
    }
    assert document_faults("dataset_info", info) == ()
    assert [f.field for f in document_faults("dataset_info", info | {"pgm": {}})] == [
        "pgm.schema_version",
        "pgm.scene",
        "pgm.units",
        "pgm.constant_rate",
    ]


def test_all_faults_are_listed_with_field_expected_and_found():
    bad = CLIP | {"n_frames": -1, "width": "wide", "ui_boxes_px": [[0, 0, 1]], "extra": 1}
    del bad["sha256"]
    faults = {fault.field: fault for fault in document_faults("clip", bad)}
    assert set(faults) == {"n_frames", "width", "ui_boxes_px[0]", "extra", "sha256"}
    assert (faults["n_frames"].expected, faults["n_frames"].found) == ("at least 1 (decoded frames of the clip)", "-1")
    assert faults["width"].expected.startswith("integer")
    assert faults["sha256"].found == "none"


def test_a_fault_is_told_in_words_and_not_in_patterns():
    for change in (
        {"sha256": "x"},
        {"source_path": "/a"},
        {"clip_id": "a/b"},
        {"time_base": "1"},
        {"players": {"P": {}}},
    ):
        (fault,) = document_faults("clip", CLIP | change)
        assert "^" not in fault.expected, fault
        assert "\\" not in fault.expected, fault


@pytest.mark.parametrize(
    "value", [np.int64(3), np.float32(0.5), np.zeros(2), float("nan"), float("inf"), {1, 2}, Path("a"), b"x", object()]
)
def test_values_that_json_does_not_have_are_refused(tmp_path, value):
    with pytest.raises(ValueError, match=r"clip.json: clip: expected JSON values"):
        write_document(tmp_path / "clip.json", "clip", CLIP | {"solved_share": value})
    assert list(tmp_path.iterdir()) == []


def test_a_document_that_misses_its_schema_is_not_written(tmp_path):
    with pytest.raises(ValueError, match=r"clip.json: clip: n_frames: expected at least 1 .*, got 0 \(and 1 more\)"):
        write_document(tmp_path / "clip.json", "clip", CLIP | {"n_frames": 0, "width": 0})
    assert list(tmp_path.iterdir()) == []


def test_a_document_that_misses_its_schema_is_not_read(tmp_path):
    path = tmp_path / "clip.json"
    path.write_text(json.dumps(CLIP | {"n_frames": 0}))
    with pytest.raises(ValueError, match=r"clip.json: clip: n_frames: expected at least 1"):
        read_document(path, "clip")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", '{"a": 1, "a": 2}', "'a' twice"),
        ("a.json", '{"a": NaN}', "NaN"),
        ("a.json", '{"a": -Infinity}', "Infinity"),
        ("a.json", '{"a": 1e999}', "1e999"),
        ("a.json", "{", "JSON document"),
        ("a.json", "", "JSON document"),
        ("a.json", "[" * 200_000, "JSON document"),
        ("a.json", "9" * 5000, "JSON document"),
        ("a.yaml", "a: 1\na: 2", "'a' twice"),
        ("a.yaml", "a: .nan", "nan"),
        ("a.yaml", "a: .inf", "inf"),
        ("a.yaml", "1: a", "no string"),
        ("a.yaml", "a: &x [1]\nb: *x", "alias"),
        ("a.yaml", "<<: {a: 1}", "no string|a key|could not|'<<'|YAML"),
        ("a.yaml", "a: !!python/object/apply:os.system [exit]", "YAML document"),
        ("a.yaml", "a: !!python/name:os.system", "YAML document"),
        ("a.yaml", "a: [", "YAML document"),
        ("a.yaml", "[" * 5000, "YAML document"),
    ],
)
def test_files_that_are_no_plain_documents_are_refused(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ValueError, match=message):
        parse_document(path)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    for name in ("a.json", "a.yaml"):
        (tmp_path / name).write_bytes(b"\xff\xfe\x00\x80\x04")
        with pytest.raises(ValueError, match="document"):
            parse_document(tmp_path / name)


def test_a_file_far_too_large_is_not_read(tmp_path):
    path = tmp_path / "clip.json"
    with path.open("wb") as file:
        file.truncate(2**40)  # sparse: takes no room
    with pytest.raises(ValueError, match="more than"):
        parse_document(path)


def test_dates_and_sets_of_yaml_are_faults_and_not_crashes(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text("name: 2026-01-31\ncamera: !!set {a, b}\nobjects: !!binary aGVsbG8=\n")
    fields = {fault.field for fault in document_faults("scene", parse_document(path))}
    assert {"name", "camera", "objects"} <= fields


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda children: st.lists(children, max_size=3) | st.dictionaries(st.text(max_size=8), children, max_size=3),
    max_leaves=8,
)


@given(st.sampled_from(document_kinds()), json_values)
def test_any_value_at_all_gets_an_answer(kind, value):
    for fault in document_faults(kind, value):
        assert fault.expected


@given(st.sampled_from(sorted(CLIP)), json_values)
def test_any_value_in_any_field_gets_an_answer_about_that_field(name, value):
    for fault in document_faults("clip", CLIP | {name: value}):
        assert fault.field.startswith(name)


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="expected one of scene, skeleton"):
        document_faults("thing", {})
