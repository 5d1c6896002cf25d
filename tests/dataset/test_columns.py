import pyarrow as pa
import pytest

from pgm_data.dataset.columns import TABLES, arrow_schema, scene_tables, table_columns, table_names
from pgm_data.scene import load_scene, scene_names


def names(table: str, scene: str) -> list[str]:
    return [column.name for column in table_columns(table, load_scene(scene))]


def test_every_table_of_the_contract_is_there():
    assert table_names() == ("shots", "camera", "players", "ball", "events", "ball_shots", "captions")


@pytest.mark.parametrize("scene", scene_names())
def test_a_scene_declares_a_table_for_what_it_holds_and_no_other(scene):
    loaded = load_scene(scene)
    ball = {"ball", "events", "ball_shots"}
    assert set(scene_tables(loaded)) == set(table_names()) - (ball if loaded.ball is None else set())
    for table in set(table_names()) - set(scene_tables(loaded)):
        with pytest.raises(ValueError, match=f"expected a scene that declares ball, got {scene}"):
            table_columns(table, loaded)


def test_blocks_holds_no_word_of_a_ball_or_of_a_second_player():
    loaded = load_scene("blocks")
    found = [column.name for table in scene_tables(loaded) for column in table_columns(table, loaded)]
    assert not [name for name in found if name.startswith(("ball", "player1"))]


def test_columns_of_players_follow_their_skeletons():
    tennis = {c.name: c for c in table_columns("players", load_scene("tennis"))}
    blocks = {c.name: c for c in table_columns("players", load_scene("blocks"))}
    for joints, keypoints, columns in ((24, 17, tennis), (13, 13, blocks)):
        assert columns["player0.keypoints_px"].size == 2 * keypoints
        assert columns["player0.keypoint_score"].size == keypoints
        for name in ("joints", "joint_rotations", "joint_translations"):
            assert columns[f"player0.{name}"].size == 3 * joints
    assert "player1.joints" in tennis
    assert "player1.joints" not in blocks


def test_frame_aligned_tables_start_with_the_same_keys():
    aligned = [name for name, table in TABLES.items() if table.frame_aligned]
    assert aligned == ["camera", "players", "ball"]
    for table in aligned:
        assert names(table, "tennis")[:4] == ["clip_id", "frame_index", "video_frame", "timestamp"]


def test_no_name_stands_twice_in_the_joined_table():
    joined = [name for table in ("camera", "players", "ball") for name in names(table, "tennis")[4:]]
    assert len(set(joined)) == len(joined)


def test_the_camera_table_is_the_contracts():
    schema = arrow_schema("camera", load_scene("tennis"))
    double = {
        "camera.K": 9,
        "camera.distortion": 4,
        "camera.R_cam_from_world": 9,
        "camera.t_cam_from_world": 3,
        "camera.position_cov": 6,
    }
    for name, size in double.items():
        assert pa.types.is_fixed_size_list(schema.field(name).type)
        assert schema.field(name).type.list_size == size
        assert schema.field(name).type.value_type == pa.float64()
    scalars = {
        "clip_id": pa.string(),
        "frame_index": pa.int64(),
        "video_frame": pa.int64(),
        "timestamp": pa.float64(),
        "frame.is_duplicate": pa.bool_(),
        "frame.capture_time": pa.float64(),
        "camera.status": pa.string(),
        "camera.reason": pa.string(),
        "camera.inliers": pa.int32(),
        "camera.reprojection_px": pa.float64(),
        "camera.focal_std_px": pa.float64(),
    }
    assert {name: schema.field(name).type for name in scalars} == scalars
    assert set(schema.names) == set(double) | set(scalars)


@pytest.mark.parametrize("scene", scene_names())
def test_every_field_says_its_unit_and_frame_and_every_schema_its_version(scene):
    loaded = load_scene(scene)
    for table in scene_tables(loaded):
        schema = arrow_schema(table, loaded)
        assert schema.metadata[b"pgm.schema_version"] == b"1.0"
        assert schema.metadata[b"pgm.scene"] == scene.encode()
        for field in schema:
            assert set(field.metadata) == {b"unit", b"frame"}


def test_positions_are_metres_in_the_world_and_pixels_are_of_the_image():
    for table in ("camera", "players", "ball"):
        for column in table_columns(table, load_scene("tennis")):
            if column.name.endswith("position"):
                assert (column.unit, column.frame) == ("m", "world")
            if column.unit == "px":
                assert column.frame == "image"


def test_only_optional_columns_may_be_left_out():
    scene = load_scene("tennis")
    assert "player0.betas" not in arrow_schema("players", scene, without=["player0.betas"]).names
    with pytest.raises(ValueError, match="not optional"):
        arrow_schema("players", scene, without=["player0.joints"])


def test_an_unknown_table_is_refused():
    with pytest.raises(ValueError, match="expected one of shots, camera"):
        table_columns("racket", load_scene("tennis"))
