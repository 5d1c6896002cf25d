import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.detect.court_network import (
    INPUT_SIZE,
    CourtNetwork,
    Letterbox,
    cell_from_input,
    input_from_cell,
    read_peaks,
)
from pgm_data.scene import load_scene
from pgm_data.simulate.mix import MixOptions, mix_pictures
from pgm_data.simulate.views import pixels_of

COURT = load_scene("tennis").court
sizes = st.tuples(st.integers(1, 5000), st.integers(1, 5000))


@given(sizes, st.tuples(st.floats(-100, 5000), st.floats(-100, 5000)))
def test_the_letterbox_is_undone_exactly(size, pixel):
    box = Letterbox(picture_size=size)
    pixels = np.array([pixel])
    scale = min(1.0, float(box.scale.min()))
    np.testing.assert_allclose(box.picture_from_input(box.input_from_picture(pixels)), pixels, atol=1e-9 / scale)


@given(sizes)
def test_the_picture_fills_the_input_along_one_side_and_keeps_its_edges(size):
    box = Letterbox(picture_size=size)
    inner, corner = np.array(box.inner_size), np.array(box.corner)
    assert (inner == INPUT_SIZE).any()
    assert (inner <= INPUT_SIZE).all() and (corner >= 0).all() and (corner + inner <= INPUT_SIZE).all()
    edges = box.input_from_picture(np.array([[-0.5, -0.5], [size[0] - 0.5, size[1] - 0.5]]))
    np.testing.assert_allclose(edges, [corner - 0.5, corner + inner - 0.5], atol=1e-9)


@pytest.mark.parametrize("size", [(1920, 1080), (640, 360), (333, 777), (201, 113), (512, 288), (1651, 929)])
def test_a_dot_in_the_picture_comes_out_where_the_letterbox_says(size):
    width, height = size
    dot = np.array([0.37 * width, 0.58 * height])
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    sigma = 4.0 / float(Letterbox(picture_size=size).scale.mean())
    glow = 250 * np.exp(-0.5 * ((x - dot[0]) ** 2 + (y - dot[1]) ** 2) / sigma**2)
    box = Letterbox(picture_size=size)
    seen = box.fill(np.repeat(glow.astype(np.uint8)[:, :, None], 3, axis=2))[:, :, 0].astype(float)
    centre = np.array([(seen * np.arange(INPUT_SIZE[0])).sum(), (seen * np.arange(INPUT_SIZE[1])[:, None]).sum()])
    np.testing.assert_allclose(centre / seen.sum(), box.input_from_picture(dot), atol=0.05)


def test_an_empty_picture_is_refused():
    with pytest.raises(ValueError, match="expected at least one pixel, got 0x5"):
        Letterbox(picture_size=(0, 5))


@given(st.floats(0, 127), st.floats(0, 71))
def test_cells_and_input_pixels_are_inverse(x, y):
    cell = np.array([x, y])
    np.testing.assert_allclose(cell_from_input(input_from_cell(cell)), cell, atol=1e-12)


@given(st.floats(4, 123), st.floats(4, 67))
def test_a_gaussian_peak_is_read_between_cells(x, y):
    rows, columns = np.arange(72.0)[:, None], np.arange(128.0)
    maps = -0.5 * ((columns - x) ** 2 + (rows - y) ** 2)[None]
    cells, scores = read_peaks(maps, np.array([-20.0]))
    np.testing.assert_allclose(cells, [[x, y]], atol=0.03)
    assert scores[0] > 0.99


def test_scores_fall_with_absence_and_with_a_second_peak():
    rows, columns = np.arange(72.0)[:, None], np.arange(128.0)
    one = -0.5 * ((columns - 30) ** 2 + (rows - 30) ** 2)
    two = np.logaddexp(one, -0.5 * ((columns - 90) ** 2 + (rows - 20) ** 2) - 1e-6)
    mass = np.log(2 * np.pi)
    _, scores = read_peaks(np.stack([one, one, two]), np.array([mass, mass + 6, -30.0]))
    np.testing.assert_allclose(scores, [0.5, 1 / (1 + np.exp(6)), 0.5], atol=0.005)


def test_peaks_in_corners_and_logits_without_bounds_are_read():
    maps = np.full((2, 72, 128), -1e4)
    maps[0, 0, 0] = 1e4
    maps[1, 71, 127] = 1e4
    cells, scores = read_peaks(maps, np.zeros(2))
    np.testing.assert_allclose(cells, [[0, 0], [127, 71]])
    np.testing.assert_allclose(scores, 1.0)


@pytest.fixture(scope="module")
def shipped():
    return CourtNetwork.load(None, network_file=COURT.network, names=COURT.all_names)


def test_the_shipped_network_finds_the_points_of_our_court(shipped):
    assert shipped.names == COURT.all_names


@pytest.mark.parametrize("size", [(1, 1), (90, 160), (301, 77), (1080, 1920)])
def test_pictures_of_any_size_are_read_and_a_plain_one_shows_no_court(shipped, size):
    seen = shipped.detect(np.full((*size, 3), 90, np.uint8))
    assert seen.pixels.shape == (len(COURT.all_names), 2)
    assert (seen.scores < 0.3).all()
    assert np.isnan(seen.pixels[seen.scores < shipped.least_score]).all()
    assert 0 <= seen.line_share < 0.02


@pytest.fixture(scope="module")
def simulated():
    """Simulated pictures that no training saw, with the pixels of their points; NaN where no court is seen."""
    found = []
    for bgr, view in mix_pictures(load_scene("tennis"), MixOptions(pictures=16), seed=77, video=0):
        pixels = np.full((len(COURT.all_names), 2), np.nan)
        if view is not None:
            pixels = pixels_of(COURT.all_world, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
        found.append((bgr, pixels))
    return found


def test_courts_in_simulated_pictures_are_found(shipped, simulated):
    errors = [
        np.linalg.norm(seen.pixels - truth, axis=1)[seen.scores >= 0.5]
        for seen, truth in ((shipped.detect(bgr), truth) for bgr, truth in simulated if np.isfinite(truth).any())
    ]
    assert np.median([len(e) for e in errors]) >= 10
    assert np.median(np.concatenate(errors)) < 2.5
    assert np.mean(np.concatenate(errors) < 8) > 0.85


def test_bars_round_a_picture_move_its_points_and_little_else(shipped, simulated):
    bgr, truth = max(simulated, key=lambda pair: np.isfinite(pair[1]).all() * shipped.detect(pair[0]).scores.min())
    for above, below, before, after in [(0, 0, 0, 0), (130, 90, 0, 0), (0, 0, 160, 40)]:
        seen = shipped.detect(np.pad(bgr, ((above, below), (before, after), (0, 0))))
        error = np.linalg.norm(seen.pixels - [before, above] - truth, axis=1)
        assert np.median(error) < 4.0
        assert (error < 10).mean() > 0.75


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.onnx"):
        CourtNetwork.load(tmp_path / "nowhere.onnx", network_file="")
    with pytest.raises(FileNotFoundError, match="no_such_court.onnx"):
        CourtNetwork.load(None, network_file="no_such_court.onnx")
    with pytest.raises(FileNotFoundError, match="''"):
        CourtNetwork.load(None, network_file="")


def test_a_broken_file_is_refused_by_name(tmp_path):
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a network")
    with pytest.raises(ValueError, match=r"broken\.onnx: expected an ONNX file"):
        CourtNetwork.load(path, network_file="")


def test_a_network_of_another_kind_is_refused(tmp_path):
    onnx = pytest.importorskip("onnx")
    one = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1, 3])
    two = onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, [1, 3])
    graph = onnx.helper.make_graph([onnx.helper.make_node("Relu", ["x"], ["y"])], "g", [one], [two])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    path = tmp_path / "other.onnx"
    onnx.save(model, path)
    with pytest.raises(ValueError, match="expected point names in its metadata"):
        CourtNetwork.load(path, network_file="")


def test_another_courts_points_are_refused(shipped):
    with pytest.raises(ValueError, match="expected the points .*found"):
        CourtNetwork.load(None, network_file=COURT.network, names=("a", "b"))
