"""Networks of the layouts, with weights of our own: they take blue squares for people."""

from pathlib import Path

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from pgm_data.detect.players.candidates import PersonFinder
from pgm_data.detect.players.onnx_people import (
    STRIDES,
    OnnxPeople,
    OnnxPeopleOptions,
    cells,
    decode_yolox,
    letterboxed,
)
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene

TENNIS = load_scene("tennis")
INPUT = (320, 192)
"""Width and height."""
PADDED = 114.0


def looking_down(size=(640, 360)) -> Camera:
    """A camera behind the near end."""
    tilt = np.arctan2(9.0, 38.0)
    R = np.array([[1.0, 0, 0], [0, -np.sin(tilt), -np.cos(tilt)], [0, np.cos(tilt), -np.sin(tilt)]])
    focal = 1.6 * size[0]
    return Camera(
        K=np.array([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1.0]]),
        distortion=np.zeros(4),
        R_cam_from_world=R,
        t_cam_from_world=-R @ np.array([0.0, -38.0, 9.0]),
    )


def network(path: Path, layout: str, *, mean=0.0, std=1.0, size=INPUT, outputs=None) -> Path:
    """A network of that layout whose score in a cell grows with the blue of the input there, 0 to 255 before norming.

    Every box is 2 by 4 strides large about its cell's point.
    """
    nodes, names, values = [], [], []

    def constant(name, value):
        values.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(kind, inputs, output, **attributes):
        nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    wide, high = size
    add("Slice", ["images", constant("b0", [0]), constant("b1", [1]), constant("ax", [1])], "blue")
    flat = {}
    for stride in STRIDES:
        pooled = add("AveragePool", ["blue"], f"pool{stride}", kernel_shape=[stride] * 2, strides=[stride] * 2)
        # 0..255 to -18..6, grey padding well below 0, where the input is not normed.
        scaled = add("Mul", [pooled, constant(f"m{stride}", np.float32(std * 24 / 255))], f"scaled{stride}")
        logit = add("Add", [scaled, constant(f"a{stride}", np.float32(mean * 24 / 255 - 18))], f"logit{stride}")
        score = add("Sigmoid", [logit], f"score{stride}")
        row = add("Reshape", [score, constant(f"s{stride}", [1, -1, 1])], f"row{stride}")
        flat[stride] = (logit, row)
    place, strides = cells(size)
    count = len(place)
    if layout == "yolox":
        add("Concat", [flat[s][1] for s in STRIDES], "scores", axis=1)
        boxes = np.tile(np.log([1.0, 1.0, 2.0, 4.0]), (1, count, 1)).astype(np.float32)
        boxes[..., :2] = 0.5
        ones = np.ones((1, count, 1), np.float32)
        zeros = np.zeros((1, count, 2), np.float32)
        parts = [constant("boxes", boxes), "scores", constant("ones", ones), constant("zeros", zeros)]
        names = [(add("Concat", parts, "output", axis=2), [1, count, 8], TensorProto.FLOAT)]
    elif layout == "rtmdet_heads":
        for s in STRIDES:
            names.append((flat[s][0], [1, 1, high // s, wide // s], TensorProto.FLOAT))
        for s in STRIDES:
            reach = np.tile(
                np.array([0.5, 1.5, 1.5, 2.5], np.float32)[None, :, None, None] * s, (1, 1, high // s, wide // s)
            )
            out = add("Identity", [constant(f"reach{s}", reach)], f"box{s}")
            names.append((out, [1, 4, high // s, wide // s], TensorProto.FLOAT))
    else:
        add("Concat", [flat[s][1] for s in STRIDES], "scores", axis=1)
        middle = (place + 0.5) * strides[:, None]
        half = strides[:, None] * [1.0, 2.0]
        boxes = constant("boxes", np.concatenate([middle - half, middle + half], axis=1)[None].astype(np.float32))
        if layout == "rtmdet":
            names.append((add("Concat", [boxes, "scores"], "dets", axis=2), [1, "found", 5], TensorProto.FLOAT))
            labels = np.zeros((1, count), np.int64)
            labels[0, : count // 2 : 7] = 3  # some are chairs
            names.append((add("Identity", [constant("kinds", labels)], "labels"), [1, "found"], TensorProto.INT64))
        else:
            names.append((add("Identity", [boxes], "dets"), [1, count, 4], TensorProto.FLOAT))
            names.append((add("Concat", ["scores", "scores"], "both", axis=2), [1, count, 2], TensorProto.FLOAT))
    graph = helper.make_graph(
        nodes,
        "people",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, high, wide])],
        [
            helper.make_tensor_value_info(n, kind, shape)
            for n, shape, kind in (names if outputs is None else names[:outputs])
        ],
        values,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return path


def blue_square(size, left, top, side) -> np.ndarray:
    """A black picture of that width and height with a blue square."""
    picture = np.zeros((size[1], size[0], 3), np.uint8)
    cv2.rectangle(picture, (left, top), (left + side - 1, top + side - 1), (255, 0, 0), -1)
    return picture


LAYOUTS = {"yolox": {}, "rtmdet": {}, "rtmdet_boxes": {}, "rtmdet_heads": {}}
NORMED = {"mean": 103.53, "std": 57.375}


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_each_layout_finds_the_square_where_it_is(layout, tmp_path):
    finder = OnnxPeople.load(network(tmp_path / "net.onnx", layout, **({} if layout == "yolox" else NORMED)))
    assert isinstance(finder, PersonFinder)
    assert (finder.layout, finder.input_size) == (layout, INPUT)
    # 640x360 goes into 320x180: a cell of stride 16 with its corner at (160, 64) shows (320, 128) to (352, 160).
    picture = blue_square((640, 360), 320, 128, 32)
    boxes, person = finder.boxes(picture)
    assert person[0] > 0.99
    middle = boxes[0].reshape(2, 2).mean(axis=0) + 0.5
    extent = boxes[0, 2:] - boxes[0, :2]
    assert extent[1] == pytest.approx(2 * extent[0])
    stride = extent[0] / 4
    assert min(abs(stride - 8.0), abs(stride - 16.0)) < 1e-4  # both see nothing but blue
    np.testing.assert_allclose(middle, [336, 144], atol=stride)
    assert (np.diff(person) <= 0).all()


def test_boxes_are_pixel_edges_turned_into_pixel_centres(tmp_path):
    finder = OnnxPeople.load(network(tmp_path / "net.onnx", "yolox"), options=OnnxPeopleOptions(overlap=0.01, most=1))
    boxes, _ = finder.boxes(blue_square(INPUT, 64, 32, 8))
    np.testing.assert_allclose(boxes, [[59.5, 19.5, 75.5, 51.5]], atol=1e-4)


def test_what_stands_on_the_ground_gets_its_place_from_the_camera(tmp_path):
    finder = OnnxPeople.load(network(tmp_path / "net.onnx", "yolox"))
    camera = looking_down()
    seen = finder.look(blue_square((640, 360), 320, 208, 32), camera)
    assert len(seen.person) >= 1 and np.isnan(seen.player).all()
    feet = np.stack([seen.boxes_px[:, [0, 2]].mean(axis=1), seen.boxes_px[:, 3]], axis=1)
    back, _ = project(camera, np.concatenate([seen.ground_world, np.zeros((len(seen.person), 1))], axis=1))
    np.testing.assert_allclose(back, feet, atol=1e-6)


def test_feet_over_the_horizon_are_nobody(tmp_path):
    finder = OnnxPeople.load(network(tmp_path / "net.onnx", "yolox"))
    camera = looking_down()
    level = Camera(
        K=camera.K,
        distortion=camera.distortion,
        R_cam_from_world=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        t_cam_from_world=np.array([0.0, 9.0, 38.0]),
    )
    picture = blue_square((640, 360), 320, 32, 32)
    assert len(finder.boxes(picture)[1]) > 0
    assert len(finder.look(picture, level).person) == 0


def test_overlapping_boxes_leave_the_best_one(tmp_path):
    path = network(tmp_path / "net.onnx", "yolox")
    picture = blue_square((640, 360), 300, 100, 90)
    many, _ = OnnxPeople.load(path, options=OnnxPeopleOptions(overlap=0.99)).boxes(picture)
    few, person = OnnxPeople.load(path, options=OnnxPeopleOptions(overlap=0.2)).boxes(picture)
    assert 1 <= len(few) < len(many)
    for i in range(len(few)):
        for j in range(i):
            low, high = np.maximum(few[i, :2], few[j, :2]), np.minimum(few[i, 2:], few[j, 2:])
            both = np.prod(np.maximum(high - low, 0))
            areas = [np.prod(few[k, 2:] - few[k, :2]) for k in (i, j)]
            assert both / (sum(areas) - both) <= 0.2 + 1e-6
    assert len(OnnxPeople.load(path, options=OnnxPeopleOptions(most=1)).boxes(picture)[1]) == 1
    assert len(OnnxPeople.load(path).boxes(np.zeros((360, 640, 3), np.uint8))[1]) == 0


def test_the_decoding_is_the_slow_one():
    rng = np.random.default_rng(0)
    size = (96, 64)
    count = sum(size[0] // s * (size[1] // s) for s in STRIDES)
    rows = rng.normal(0, 1, (1, count, 7)).astype(np.float32)
    boxes, person = decode_yolox([rows], size)
    k = 0
    for stride in STRIDES:
        for row in range(size[1] // stride):
            for column in range(size[0] // stride):
                x, y, w, h, there, kind = rows[0, k, :6].astype(float)
                x, y, w, h = (x + column) * stride, (y + row) * stride, np.exp(w) * stride, np.exp(h) * stride
                np.testing.assert_allclose(boxes[k], [x - w / 2, y - h / 2, x + w / 2, y + h / 2])
                assert person[k] == pytest.approx(there * kind)
                k += 1
    assert k == count


def test_pictures_fill_the_inputs_corner_and_grey_the_rest():
    filled, scale = letterboxed(np.full((100, 50, 3), 7, np.uint8), (320, 192))
    assert scale == pytest.approx(1.92)
    assert (filled[:192, :96] == 7).all() and (filled[:, 96:] == PADDED).all()


@pytest.mark.parametrize("outputs", [1, 2])
def test_networks_of_another_layout_are_refused(outputs, tmp_path):
    path = network(tmp_path / "net.onnx", "rtmdet_heads", outputs=outputs)
    with pytest.raises(ValueError, match="as YOLOX has it.*as RTMDet has them; found inputs"):
        OnnxPeople.load(path)


def test_other_inputs_answers_and_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="people detector"):
        OnnxPeople.load(tmp_path / "none.onnx")
    (tmp_path / "no.onnx").write_text("no network")
    with pytest.raises(ValueError, match="expected an ONNX file"):
        OnnxPeople.load(tmp_path / "no.onnx")
    with pytest.raises(ValueError, match="every: expected 1 or more, got 0"):
        OnnxPeople.load(tmp_path / "no.onnx", every=0)
    shipped = Path(__file__).parents[3] / "pgm_data" / "detect" / "weights" / "court_tennis.onnx"
    with pytest.raises(ValueError, match="expected one input"):
        OnnxPeople.load(shipped)
    with pytest.raises(ValueError, match="a row for each of 126 cells of 96x64"):
        decode_yolox([np.zeros((1, 5, 7), np.float32)], (96, 64))
    decoded = np.full((1, 126, 7), 60.0, np.float32)
    with pytest.raises(ValueError, match="export the network without decoding"):
        decode_yolox([decoded], (96, 64))
