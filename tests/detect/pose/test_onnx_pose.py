"""RTMPose's and ViTPose's layouts: small networks that look for red, green and blue blobs, as those look for joints."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from pgm_data.detect.pose.blazepose import BlazePose
from pgm_data.detect.pose.heatmap import HeatmapPose, heat_peaks
from pgm_data.detect.pose.load import load_pose_model
from pgm_data.detect.pose.model import COCO_POINTS, PoseModel
from pgm_data.detect.pose.simcc import SimccPose

WIDE, HIGH = 192, 256
MEAN = np.array([123.675, 116.28, 103.53], np.float32).reshape(1, 3, 1, 1)
DEVIATION = np.array([58.395, 57.12, 57.375], np.float32).reshape(1, 3, 1, 1)


def network(path: Path, layout: str, *, points: int = 17, batch: str | int = "n") -> Path:
    """A network whose point k is the brightest place of the input's red, green or blue, by k modulo 3."""

    def constant(name: str, values: np.ndarray) -> None:
        constants.append(numpy_helper.from_array(values, name))

    constants: list = []
    constant("deviation", DEVIATION / 255)
    constant("mean", MEAN / 255)
    constant("colours", np.arange(points, dtype=np.int64) % 3)
    constant("none", np.zeros(0, np.float32))
    nodes = [
        helper.make_node("Mul", ["input", "deviation"], ["spread"]),
        helper.make_node("Add", ["spread", "mean"], ["brightness"]),
        helper.make_node("Gather", ["brightness", "colours"], ["maps"], axis=1),
    ]
    if layout == "heat":
        constant("share", np.array([1, 1, 0.25, 0.25], np.float32))
        mode = {"mode": "linear", "coordinate_transformation_mode": "align_corners"}
        nodes.append(helper.make_node("Resize", ["maps", "none", "share"], ["heat"], **mode))
        shapes = {"heat": [batch, points, HIGH // 4, WIDE // 4]}
    else:
        constant("twice", np.array([1, 1, 2], np.float32))
        mode = {"mode": "linear", "coordinate_transformation_mode": "asymmetric"}
        for axis, name in ((2, "simcc_x"), (3, "simcc_y")):
            constant(f"over_{name}", np.array([axis], np.int64))
            nodes.append(helper.make_node("ReduceMax", ["maps", f"over_{name}"], [f"row_{name}"], keepdims=0))
            nodes.append(helper.make_node("Resize", [f"row_{name}", "none", "twice"], [name], **mode))
        shapes = {"simcc_x": [batch, points, 2 * WIDE], "simcc_y": [batch, points, 2 * HIGH]}
    graph = helper.make_graph(
        nodes,
        layout,
        [helper.make_tensor_value_info("input", TensorProto.FLOAT, [batch, 3, HIGH, WIDE])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in shapes.items()],
        constants,
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


def blobs(places: np.ndarray, height: float = 1.0) -> np.ndarray:
    """A BGR crop with a red, a green and a blue blob of 8 px at those places."""
    x, y = np.arange(WIDE), np.arange(HIGH)[:, None]
    planes = [np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 8.0**2)) for px, py in places[::-1]]
    return np.round(255 * height * np.stack(planes, axis=-1)).astype(np.uint8)


PLACES = np.array([[[60.3, 80.9], [121.0, 200.4], [30.75, 141.2]], [[150.6, 25.25], [90.1, 99.9], [10.4, 240.0]]])


@pytest.mark.parametrize(("layout", "kind"), [("heat", HeatmapPose), ("simcc", SimccPose)])
@pytest.mark.parametrize("batch", ["n", 1])
def test_points_are_where_the_blobs_are_and_scores_are_their_heights(
    tmp_path: Path, layout: str, kind: type, batch: str | int
) -> None:
    model = load_pose_model(network(tmp_path / "net.onnx", layout, batch=batch))
    assert isinstance(model, kind) and isinstance(model, PoseModel)
    assert (model.input_size, model.point_names) == ((WIDE, HIGH), COCO_POINTS)
    poses = model(np.stack([blobs(PLACES[0]), blobs(PLACES[1], 0.45)]))
    expected = PLACES[:, np.arange(17) % 3]
    np.testing.assert_allclose(poses.points_px, expected, atol=0.5)
    np.testing.assert_allclose(poses.score[0], 1.0, atol=0.05)
    np.testing.assert_allclose(poses.score[1], 0.45, atol=0.05)
    np.testing.assert_allclose(poses.presence, [1.0, 0.75], atol=0.08)
    assert (poses.sigma_px[1] > 1.5 * poses.sigma_px[0]).all()
    assert np.isnan(poses.points_ray).all()


@pytest.mark.parametrize(("points", "toe"), [(26, 20), (133, 17)])
def test_layouts_with_feet_give_the_feet_by_name(tmp_path: Path, points: int, toe: int) -> None:
    model = load_pose_model(network(tmp_path / "net.onnx", "simcc", points=points))
    assert model is not None
    assert set(model.point_names) == {
        *COCO_POINTS,
        *(f"{side}_{part}" for side in ("left", "right") for part in ("heel", "big_toe")),
    }
    points_px = model(blobs(PLACES[0])[None]).points_px[0]
    np.testing.assert_allclose(points_px[model.point_names.index("left_big_toe")], PLACES[0][toe % 3], atol=0.3)


def test_a_peak_at_the_edge_and_an_empty_map_stay_inside() -> None:
    heat = np.zeros((1, 3, 12, 9))
    heat[0, 0, 0, 8] = 1.0
    heat[0, 1, 11, 0] = 1.0
    cells, score = heat_peaks(heat)
    np.testing.assert_allclose(cells[0, :2], [[8, 0], [0, 11]], atol=0.51)
    np.testing.assert_array_equal(score[0], [1, 1, 0])
    assert np.isfinite(cells).all()


def test_crops_of_another_size_are_refused(tmp_path: Path) -> None:
    model = load_pose_model(network(tmp_path / "net.onnx", "heat"))
    assert model is not None
    with pytest.raises(ValueError, match=r"expected \(n, 256, 192, 3\), got \(1, 256, 256, 3\)"):
        model(np.zeros((1, 256, 256, 3), np.uint8))


def test_files_of_no_known_layout_are_refused_with_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="expected a file"):
        load_pose_model(tmp_path / "absent.onnx")
    for name in ("noise.onnx", "noise.tflite"):
        (tmp_path / name).write_bytes(b"noise")
        with pytest.raises(ValueError, match="expected a"):
            load_pose_model(tmp_path / name)
    with pytest.raises(ValueError, match="expected one of 17, 26, 133, got 5"):
        load_pose_model(network(tmp_path / "five.onnx", "heat", points=5))
    other = helper.make_graph(
        [helper.make_node("Flatten", ["input"], ["out"])],
        "other",
        [helper.make_tensor_value_info("input", TensorProto.FLOAT, [1, 3, 8, 8])],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, 192])],
    )
    model = helper.make_model(other, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(ValueError, match=r"answers: expected two .* got out\[1, 192\]"):
        load_pose_model(tmp_path / "other.onnx")


def test_without_a_path_the_fetched_network_is_taken_and_none_where_there_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PGM_WEIGHTS", str(tmp_path))
    assert load_pose_model() is None
    assert isinstance(BlazePose.point_names, tuple)
