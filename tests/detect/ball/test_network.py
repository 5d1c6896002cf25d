import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.detect.ball.network import (
    CHANNELS,
    MULTIPLE,
    STRIDE,
    BallInput,
    BallNetwork,
    BallNetworkOptions,
    Calibration,
    NetworkFinder,
    aligned,
    picture_planes,
    read_peaks,
)
from pgm_data.detect.ball.streaks import streaks_at
from pgm_data.scene import load_scene
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.mix import MixOptions, mix_pictures
from pgm_models.detectors.ball_drawing import smear

sizes = st.tuples(st.integers(1, 5000), st.integers(1, 3000))


class Lookout:
    """Stands in for a trained network: sure of the mean place of all pixels brighter than in both neighbours."""

    def run(self, names, given):
        before, now, after = given["grey"][0].astype(float)
        rows, columns = now.shape
        bright = np.maximum(np.minimum(now - before, now - after) - 8, 0)
        answers = np.full((1, len(CHANNELS), rows // STRIDE, columns // STRIDE), -12.0, np.float32)
        if bright.any():
            y, x = np.indices(now.shape)
            place = np.array([(bright * x).sum(), (bright * y).sum()]) / bright.sum()
            cells = (place + 0.5) / STRIDE - 0.5
            column, row = np.round(cells).astype(int)
            answers[0, :, row, column] = [
                5.0,
                cells[0] - column,
                cells[1] - row,
                np.log(0.25),
            ]
        return [answers]


def lookout(**options) -> NetworkFinder:
    return NetworkFinder(BallNetwork(Lookout(), Calibration()), BallNetworkOptions(**options))


def disc(size: tuple[int, int], centre: np.ndarray, sigma: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.exp(-0.5 * ((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / sigma**2)


def picture(size: tuple[int, int], centre: np.ndarray, sigma: float = 2.0, ground: np.ndarray | None = None):
    ground = np.full((size[1], size[0], 3), 90.0) if ground is None else ground.astype(float)
    return (ground + (230 - ground) * disc(size, centre, sigma)[..., None] + 0.5).astype(np.uint8)


@given(sizes, st.integers(64, 2000), st.tuples(st.floats(0, 5000), st.floats(0, 3000)))
def test_pixels_of_picture_and_input_are_inverse_and_the_edges_meet(size, widest, pixel):
    box = BallInput(picture_size=size, widest=widest)
    pixels = np.array([pixel])
    np.testing.assert_allclose(box.picture_from_input(box.input_from_picture(pixels)), pixels, atol=1e-6)
    edges = box.input_from_picture(np.array([[-0.5, -0.5], [size[0] - 0.5, size[1] - 0.5]]))
    np.testing.assert_allclose(edges, [[-0.5, -0.5], np.array(box.inner_size) - 0.5], atol=1e-6)
    assert box.inner_size[0] <= max(widest, 1) and (size[0] > widest or box.inner_size == size)
    assert all(n % MULTIPLE == 0 and 0 <= n - m < MULTIPLE for n, m in zip(box.input_size, box.inner_size, strict=True))


def test_an_empty_picture_is_refused():
    with pytest.raises(ValueError, match="expected at least one pixel, got 0x5"):
        BallInput(picture_size=(0, 5), widest=100)


def test_a_map_of_pixels_is_carried_to_the_input():
    box = BallInput(picture_size=(1920, 1080), widest=1280)
    turn = np.array([[1.01, 0.02, -7.0], [-0.01, 0.99, 3.0], [1e-6, 2e-6, 1.0]])
    pixel = np.array([700.0, 400.0])
    x, y, w = turn @ [*pixel, 1.0]
    u, v, t = box.carried(turn) @ [*box.input_from_picture(pixel), 1.0]
    np.testing.assert_allclose([u / t, v / t], box.input_from_picture(np.array([x / w, y / w])), atol=1e-9)


def test_planes_are_brightness_and_colour():
    bgr = np.zeros((16, 32, 3), np.uint8)
    bgr[:, 16:] = (0, 0, 255)
    planes = picture_planes(bgr)
    assert planes.grey.shape == (16, 32) and planes.colour.shape == (2, 8, 16)
    assert (planes.grey[:, :16] == 16).all() and (planes.grey[:, 16:] > 70).all()
    assert (planes.colour[:, :, :8] == 128).all()
    assert (planes.colour[1, :, 8:] > 200).all() and (planes.colour[0, :, 8:] < 128).all()


def test_peaks_come_best_first_apart_and_as_many_as_there_are():
    answers = np.full((len(CHANNELS), 40, 60), -9.0)
    answers[1:] = 0.0
    answers[0, 10, 20], answers[0, 11, 21] = 3.0, 2.9  # one ball
    answers[0, 30, 5], answers[0, 0, 59] = 1.0, 4.0
    answers[1:4, 10, 20] = 0.25, -0.5, np.log(0.5)
    peaks = read_peaks(answers, 3)
    np.testing.assert_allclose(peaks.logits, [4.0, 3.0, 1.0])
    np.testing.assert_allclose(peaks.pixels[1], (np.array([20.25, 9.5]) + 0.5) * STRIDE - 0.5)
    np.testing.assert_allclose(peaks.sigma_px[1], 2.0)
    np.testing.assert_allclose(peaks.pixels[0], (np.array([59, 0]) + 0.5) * STRIDE - 0.5)


def test_a_plateau_gives_candidates_that_are_apart_and_a_small_picture_few():
    flat = read_peaks(np.zeros((len(CHANNELS), 6, 6)), 4)
    cells = (flat.pixels + 0.5) / STRIDE - 0.5
    apart = np.abs(cells[:, None] - cells[None]).max(axis=-1)
    assert (apart[np.isfinite(apart) & (apart > 0)] > 2).all()
    few = read_peaks(np.zeros((len(CHANNELS), 1, 1)), 4)
    assert np.isfinite(few.logits).tolist() == [True, False, False, False]
    assert np.isnan(few.pixels[1:]).all()


@pytest.mark.parametrize(
    ("size", "widest"), [((640, 360), 1280), ((1921, 1079), 1280), ((1280, 720), 640), ((333, 777), 200)]
)
def test_the_finder_says_where_a_ball_is_whatever_the_pictures_size(size, widest):
    finder = lookout(widest=widest)
    scale = BallInput(picture_size=size, widest=widest).scale.mean()
    path = np.array([0.3, 0.4]) * size + np.arange(3)[:, None] * np.array([25.0, 11.0]) / scale + 0.37
    for centre in path:
        finder.add(picture(size, centre, 2.0 / scale), is_duplicate=False, here_from_previous=None)
    found = finder.finish()
    assert found.pixels.shape == (3, 4, 2)
    np.testing.assert_allclose(found.pixels[:, 0], path, atol=0.15 / scale)
    np.testing.assert_allclose(found.sigma_px[:, 0], 0.25 * STRIDE / scale, rtol=0.01)
    assert (np.linalg.norm(found.streak_px[:, 0], axis=1) < 2 / scale).all()  # round things went nowhere
    np.testing.assert_allclose(found.score[:, 0], 1 / (1 + np.exp(-5.0)), rtol=1e-6)
    assert np.isnan(found.pixels[:, 1:]).all()


def test_a_moved_picture_moves_what_is_found_by_as_much():
    path = np.array([[100.0, 90], [130, 95], [160, 100], [190, 105]])
    found = []
    for shift in (np.zeros(2), np.array([37.0, -22.0])):
        finder = lookout()
        for centre in path + shift:
            finder.add(picture((400, 208), centre), is_duplicate=False, here_from_previous=None)
        found.append(finder.finish().pixels[:, 0])
    np.testing.assert_allclose(found[1] - found[0], np.tile([37.0, -22.0], (4, 1)), atol=0.05)


def test_repeats_are_not_looked_at_and_change_nothing_for_the_others():
    path = np.array([[100.0, 90], [130, 95], [160, 100], [190, 105], [220, 110]])
    repeated = [0, 1, 1, 2, 3, 3, 3, 4]
    plain, with_repeats = lookout(), lookout()
    for centre in path:
        plain.add(picture((400, 208), centre), is_duplicate=False, here_from_previous=None)
    for row, k in enumerate(repeated):
        again = row > 0 and repeated[row - 1] == k
        with_repeats.add(picture((400, 208), path[k]), is_duplicate=again, here_from_previous=None)
    expected, found = plain.finish(), with_repeats.finish()
    first = [0, 1, 3, 4, 7]
    for name in ("pixels", "score", "sigma_px", "streak_px"):
        np.testing.assert_array_equal(getattr(found, name)[first], getattr(expected, name))
        assert np.isnan(getattr(found, name)[[2, 5, 6]]).all()


def test_a_camera_that_turns_is_followed_across_repeats_too():
    size, step = (480, 272), np.array([9.0, -4.0])
    rng = np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.uniform(20, 200, (600, 900, 3)).astype(np.float32), (0, 0), 1.5)
    ball = np.array([200.0, 120]) + np.arange(6)[:, None] * np.array([23.0, 10.0])
    shown = [0, 1, 1, 2, 3, 4, 5]
    move = np.eye(3)
    move[:2, 2] = step

    def scene(k):
        x, y = (np.array([200.0, 100.0]) - k * step).astype(int)
        return picture(size, ball[k], ground=ground[y : y + size[1], x : x + size[0]])

    def found(turns):
        finder = lookout()
        for row, k in enumerate(shown):
            again = row > 0 and shown[row - 1] == k
            turn = None if not turns or again or row == 0 else move
            finder.add(scene(k), is_duplicate=again, here_from_previous=turn)
        return finder.finish().pixels[:, 0]

    error = np.linalg.norm(found(True) - ball[shown], axis=1)
    assert np.isnan(error[2]) and np.nanmax(error) < 1.5
    assert np.nanmedian(np.linalg.norm(found(False) - ball[shown], axis=1)) > 10


def test_a_neighbour_that_looks_elsewhere_differs_nowhere():
    here, there = np.full((32, 48), 50, np.uint8), np.full((32, 48), 200, np.uint8)
    away = np.eye(3)
    away[0, 2] = 1000.0
    np.testing.assert_array_equal(aligned(there, away, here), here)
    assert aligned(there, None, here) is there
    behind = np.diag([1.0, 1.0, -1.0])
    np.testing.assert_array_equal(aligned(there, behind, here), here)


def test_one_picture_alone_and_none_at_all_are_answered():
    finder = lookout()
    finder.add(picture((64, 48), np.array([30.0, 20.0])), is_duplicate=False, here_from_previous=None)
    assert finder.finish().score.shape == (1, 4)
    assert lookout().finish().score.shape == (0, 4)


def test_another_size_on_the_way_is_refused():
    finder = lookout()
    finder.add(np.zeros((48, 64, 3), np.uint8), is_duplicate=False, here_from_previous=None)
    with pytest.raises(ValueError, match="frame 1: expected a picture of 64x48 as before, got 48x64"):
        finder.add(np.zeros((64, 48, 3), np.uint8), is_duplicate=False, here_from_previous=None)


def test_probabilities_rise_with_the_logit_and_bear_any_logit():
    said = Calibration(slope=0.5, shift=1.0).probability(np.array([-1e9, -2.0, 0.0, 1e9]))
    np.testing.assert_allclose(said, [0, 0.5, 1 / (1 + np.exp(-1.0)), 1], atol=1e-12)


def test_missing_broken_and_cut_off_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"ball network: expected a file at .*nowhere\.onnx"):
        BallNetwork.load(tmp_path / "nowhere.onnx")
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a network")
    with pytest.raises(ValueError, match=r"ball network .*broken\.onnx: expected an ONNX file"):
        BallNetwork.load(path)


def other_network(path, metadata: dict[str, str]) -> None:
    onnx = pytest.importorskip("onnx")
    inputs = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, 3, 8, 8]) for name in ("grey", "colour")
    ]
    output = onnx.helper.make_tensor_value_info("answers", onnx.TensorProto.FLOAT, [1, 3, 8, 8])
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Add", ["grey", "colour"], ["answers"])], "g", inputs, [output]
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, path)
    path.with_name("cut.onnx").write_bytes(path.read_bytes()[:-20])


def test_networks_of_another_kind_and_files_cut_off_are_refused(tmp_path):
    path = tmp_path / "other.onnx"
    other_network(path, {})
    with pytest.raises(ValueError, match="expected ball_channels and calibration in its metadata"):
        BallNetwork.load(path)
    with pytest.raises(ValueError, match=r"cut\.onnx: expected"):
        BallNetwork.load(tmp_path / "cut.onnx")
    other_network(path, {"ball_channels": json.dumps(["here", "there"]), "calibration": "{}"})
    with pytest.raises(ValueError, match=r"expected the answers \('ball', .*found \('here', 'there'\)"):
        BallNetwork.load(path)


def smeared(way: np.ndarray, step: np.ndarray, *, line: bool = False) -> np.ndarray:
    """Brightness of three frames of a disc at (50.3, 40.6) in the middle one."""
    rng = np.random.default_rng(0)
    frames = []
    for k in (-1, 0, 1):
        cover = cv2.GaussianBlur(smear(np.array([50.3, 40.6]) + k * step, way, 2.5, (90, 100)), (0, 0), 0.7)
        ground = np.full((90, 100), 90.0)
        if line:
            ground[39:43] = 220
        frames.append(np.clip(ground + 110 * cover + rng.normal(0, 1, cover.shape) + 0.5, 0, 255).astype(np.uint8))
    return np.stack(frames)


@pytest.mark.parametrize("length", [5.0, 9.0, 16.0, 26.0])
@pytest.mark.parametrize("angle", [0.0, 0.7, 1.57, 2.5])
def test_a_smeared_discs_way_is_measured(length, angle):
    way = length * np.array([np.cos(angle), np.sin(angle)])
    (found,) = streaks_at(smeared(way, way / 0.4), np.array([[50.0, 41.0]]))
    assert min(np.linalg.norm(found - way), np.linalg.norm(found + way)) < 0.1 * length + 1.0
    assert found[0] >= 0


def test_no_way_is_made_up_where_it_cannot_be_measured():
    way, place = np.array([6.0, 2.0]), np.array([[50.0, 41.0]])
    assert np.isnan(streaks_at(smeared(way, way * 0.2), place)).all()  # the ball hardly moved between frames
    assert np.isnan(streaks_at(smeared(way, way * 3, line=True), place)).all()  # it lies on a line
    assert np.isnan(streaks_at(smeared(way * 12, way * 20), place)).all()  # longer than what is looked at
    assert np.isnan(streaks_at(smeared(way, way * 3), np.array([[20.0, 15.0], [np.nan, np.nan], [-9.0, 300.0]]))).all()
    round_one = streaks_at(smeared(np.zeros(2), np.array([12.0, 3.0])), place)
    assert np.linalg.norm(round_one) < 2.0


@pytest.fixture(scope="module")
def shipped():
    return BallNetwork.load(threads=1)


@pytest.fixture(scope="module")
def courts():
    """Simulated pictures of courts that no training saw, with their cameras."""
    drawn = mix_pictures(load_scene("tennis"), MixOptions(pictures=3, width=1280, height=720), seed=31, video=0)
    return [(bgr, view) for bgr, view in drawn if view is not None]


def flight(view, fps: float = 25.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of a ball over the court in three frames, its streak in each (1/100 s) and its radius, all in pixels."""
    times = np.arange(3)[:, None] / fps
    place = np.array([1.5, -4.0, 1.3]) + times * np.array([4.0, 17.0, 1.0])
    half = 0.005 * np.array([4.0, 17.0, 1.0])
    camera = (view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    here, start, end = (pixels_of(p, *camera) for p in (place, place - half, place + half))
    depth = (place @ view.R_cam_from_world.T + view.t_cam_from_world)[:, 2]
    return here, end - start, view.K[0, 0] * 0.033 / depth


def test_the_shipped_network_finds_a_ball_that_flies_over_a_simulated_court(shipped, courts):
    errors, scores, streaks = [], [], []
    for ground, view in courts:
        pixels, streak, radius = flight(view)
        if (pixels < 20).any() or (pixels > [1260, 700]).any() or radius.max() > 5 or radius.min() < 1.2:
            continue
        finder = NetworkFinder(shipped)
        for k in range(3):
            cover = smear(pixels[k], streak[k], float(radius[k]), (720, 1280))[..., None]
            bgr = ground * (1 - cover) + np.array([70.0, 235, 215]) * cover
            finder.add((bgr + 0.5).astype(np.uint8), is_duplicate=False, here_from_previous=None)
        found = finder.finish()
        errors.append(np.linalg.norm(found.pixels[:, 0] - pixels, axis=1))
        scores.append(found.score[:, 0])
        way, said = streak[1], found.streak_px[1, 0]
        streaks.append(min(np.linalg.norm(said - way), np.linalg.norm(said + way)))  # may be NaN: not seen
    assert len(errors) >= 2
    assert np.max(errors) < 2.0
    assert np.min(scores) > 0.3
    assert np.isfinite(streaks).any() and np.nanmax(streaks) < 2.5


def test_the_shipped_network_sees_nothing_in_a_still_grey_picture(shipped):
    finder = NetworkFinder(shipped)
    for _ in range(3):
        finder.add(np.full((200, 330, 3), 90, np.uint8), is_duplicate=False, here_from_previous=None)
    assert not (np.nan_to_num(finder.finish().score) > 0.3).any()
