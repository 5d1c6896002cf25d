import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.dataset.tables import read_table, write_table
from pgm_data.detect.ball.network import STRIDE, BallNetwork, Calibration
from pgm_data.scene import load_scene
from pgm_data.video import write_video
from pgm_models.detectors.ball_drawing import draw_ball, draw_distractor, smear
from pgm_models.detectors.ball_frames import (
    ABSENT,
    SEEN,
    UNKNOWN,
    BallClip,
    divide_matches,
    match_of,
    prepare_ball_clip,
    turns,
)
from pgm_models.detectors.ball_net import BALL_PRESETS, BallNet, quarters
from pgm_models.detectors.ball_score import Predictions, calibrate, score_frames
from pgm_models.detectors.ball_task import (
    BallTask,
    BallTaskOptions,
    Triple,
    focal_loss,
    place_loss,
    seen_through,
    truth_of,
)
from pgm_models.detectors.clip_pictures import FrameSet, Pictures, find_clips, find_video, keep_pictures
from pgm_models.detectors.export import export_ball, fold_norms
from pgm_models.detectors.heatmap_net import multiply_adds
from pgm_models.train import TrainOptions, train

SCENE = load_scene("tennis")
SIZE = (320, 192)
YELLOW = np.array([70.0, 235.0, 215.0])


def ground(rng: np.random.Generator, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A court-like picture: a plain colour with a few lines and blots."""
    bgr = np.full((size[1], size[0], 3), rng.uniform(50, 120, 3), np.uint8)
    for _ in range(4):
        a, b = rng.uniform([0, 0], size, (2, 2)).astype(int).tolist()
        cv2.line(bgr, a, b, (225, 225, 225), 2, cv2.LINE_AA)
        cv2.circle(bgr, rng.uniform([0, 0], size).astype(int).tolist(), 9, rng.uniform(0, 255, 3).tolist(), -1)
    return bgr


def with_ball(bgr: np.ndarray, centre: np.ndarray, streak: np.ndarray, radius: float) -> np.ndarray:
    cover = smear(centre, streak, radius, bgr.shape[:2])[..., None]
    return (bgr * (1 - cover) + YELLOW * cover + 0.5).astype(np.uint8)


@pytest.fixture
def toy_clip(tmp_path):
    """Makes a clip of a ball that flies through a standing picture, by its number of frames and its seed."""

    def make(frames: int, seed: int) -> BallClip:
        rng = np.random.default_rng(seed)
        bgr = ground(rng)
        path = np.array([30.3, 40.7]) + np.arange(frames)[:, None] * np.array([17.0, 6.3]) % (np.array(SIZE) - 60)
        streak = np.tile([5.0, 2.0], (frames, 1))
        jpegs = tmp_path / f"toy{seed}.jpegs"
        offsets = keep_pictures(jpegs, (with_ball(bgr, p, s, 2.5) for p, s in zip(path, streak, strict=True)))
        return BallClip(
            clip_id=f"toy_{seed}.00",
            pictures=Pictures(jpegs=jpegs, offsets=offsets),
            ball_px=path,
            streak_px=streak,
            radius_px=np.full(frames, 2.5),
            state=np.full(frames, SEEN),
            here_from_previous=np.repeat(np.eye(3)[None], frames, axis=0),
            boxes_px=np.full((frames, 2, 4), np.nan),
        )

    return make


@given(
    st.tuples(st.floats(20, 60), st.floats(20, 40)),
    st.tuples(st.floats(-25, 25), st.floats(-25, 25)),
    st.floats(1.5, 6),
)
def test_a_smeared_disc_keeps_its_area_its_centre_and_its_way(centre, streak, radius):
    centre, streak = np.array(centre), np.array(streak)
    cover = smear(centre, streak, radius, (64, 80))
    assert cover.min() >= 0 and cover.max() <= 1 + 1e-9
    if not (
        (centre - np.abs(streak) / 2 - radius > 0).all() and (centre + np.abs(streak) / 2 + radius < [79, 63]).all()
    ):
        return
    y, x = np.indices(cover.shape)
    mass = cover.sum()
    np.testing.assert_allclose(mass, np.pi * radius**2, rtol=0.06 + 0.12 / radius)
    offset = np.stack([x - centre[0], y - centre[1]], axis=-1)
    np.testing.assert_allclose((cover[..., None] * offset).sum(axis=(0, 1)) / mass, 0, atol=0.06 + 0.12 / radius)
    spread = np.einsum("rc,rci,rcj->ij", cover, offset, offset) / mass
    expected = np.outer(streak, streak) / 12 + np.eye(2) * radius**2 / 4
    np.testing.assert_allclose(spread, expected, atol=0.15 + 0.06 * expected.max())


def test_a_drawn_ball_is_where_it_says_in_the_middle_frame_and_elsewhere_in_the_others():
    for seed in range(12):
        rng = np.random.default_rng(seed)
        frames = [np.full((96, 96, 3), 20, np.uint8) for _ in range(3)]
        ball = draw_ball(frames, rng, least_trace=5.0)
        changed = np.abs(frames[1].astype(float) - 20).sum(axis=2)
        if not ball.seen:
            continue
        column, row = np.round(ball.pixel).astype(int)
        assert changed[row - 1 : row + 2, column - 1 : column + 2].max() > 0.6 * changed.max()
        assert not np.array_equal(frames[0], frames[1])


def test_distractors_change_pictures_and_nothing_of_their_shape():
    changed = 0
    for seed in range(30):
        frames = [np.full((96, 96, 3), 90, np.uint8) for _ in range(3)]
        draw_distractor(frames, np.zeros((3, 2)), np.random.default_rng(seed))
        assert all(f.shape == (96, 96, 3) and f.dtype == np.uint8 for f in frames)
        changed += any((f != 90).any() for f in frames)
    assert changed > 12


def test_the_truth_of_a_crop_has_one_cell_a_ball_and_does_not_count_round_unknown_ones():
    ball, hidden = np.array([50.3, 30.9]), np.array([120.0, 100.0])
    truth = truth_of([(ball, np.array([8.0, -4.0]))], [(hidden, np.zeros(2), 2.0)], 48)
    (row, column), *more = np.argwhere(truth.heat == 1.0)
    assert not more
    cell = np.array([column, row])
    np.testing.assert_allclose((cell + truth.place[:, row, column] + 0.5) * STRIDE - 0.5, ball)
    rows, columns = np.indices((48, 48))
    away = np.hypot((columns + 0.5) * STRIDE - 0.5 - hidden[0], (rows + 0.5) * STRIDE - 0.5 - hidden[1])
    assert not truth.counted[away < 12].any() and truth.counted[away > 20].all()
    nothing = truth_of([], [], 48)
    assert not nothing.heat.any() and nothing.counted.all()


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_a_crop_moves_the_ball_as_its_map_says_and_the_neighbours_onto_the_frame(seed):
    rng = np.random.default_rng(seed)
    centre = rng.uniform([120, 80], [200, 120])
    angle = 0.02
    turn = np.array([[np.cos(angle), -np.sin(angle), 6.0], [np.sin(angle), np.cos(angle), -3.0], [1e-5, 2e-5, 1.0]])
    there = np.linalg.inv(turn) @ [*centre, 1.0]
    frames = [np.zeros((192, 320, 3), np.uint8)] * 3
    frames[1] = with_ball(frames[1], centre, np.zeros(2), 6.0)
    frames[0] = with_ball(frames[0], there[:2] / there[2], np.zeros(2), 6.0)
    triple = Triple(
        frames=(frames[0], frames[1], frames[2]),
        now_from=(turn, None, None),
        pixel=centre,
        streak=np.zeros(2),
        radius=6.0,
        state=SEEN,
        boxes_px=np.full((0, 4), np.nan),
    )
    zoom, size = float(np.exp(rng.uniform(np.log(0.5), np.log(1.4)))), 96
    linear = zoom * np.array([[rng.choice([-1.0, 1.0]), 0.05], [-0.05, 1.0]])
    to = rng.uniform(35, 60, 2)
    affine = np.concatenate([linear, (to - linear @ centre)[:, None]], axis=1)
    shift = np.array([1.7, -2.2])
    for which, moved in ((1, np.zeros(2)), (0, shift)):
        seen = seen_through(triple, which, affine, moved, size).sum(axis=2).astype(float)
        y, x = np.indices(seen.shape)
        found = np.array([(seen * x).sum(), (seen * y).sum()]) / seen.sum()
        np.testing.assert_allclose(found, to + moved, atol=0.25)


def test_batches_repeat_and_differ(toy_clip):
    frames = divide_matches([toy_clip(12, 1)])
    one, two = (BallTask(lambda: frames, BallTaskOptions(batch=4, per_frame=2, crop=64)) for _ in range(2))
    for index in (0, 5):
        for name, value in one.batch(index).tensors.items():
            assert torch.equal(value, two.batch(index).tensors[name]), name
    assert not torch.equal(one.batch(0).tensors["grey"], one.batch(1).tensors["grey"])
    assert one.batch(0).tensors["grey"].dtype == torch.uint8


def test_losses_are_least_for_the_truth():
    heat = torch.zeros(1, 8, 8)
    heat[0, 3, 4] = 1.0
    counted = torch.ones(1, 8, 8)
    right = torch.full((1, 8, 8), -20.0)
    right[0, 3, 4] = 20.0
    assert float(focal_loss(right, heat, counted)) == pytest.approx(0, abs=1e-6)
    assert float(focal_loss(-right, heat, counted)) > 100
    counted[0, 3, 4] = 0.0
    assert float(focal_loss(torch.full((1, 8, 8), -20.0), heat, counted)) == pytest.approx(0, abs=1e-6)
    truth = torch.full((1, 2, 1, 1), 0.3)
    sigmas = torch.linspace(-3, 1, 81)
    misses = torch.cat([place_loss(truth + 0.2, s.reshape(1, 1, 1), truth).flatten() for s in sigmas])
    # Laplace's standard deviation for a mean miss of 0.2 is 0.2 times the root of 2.
    assert float(sigmas[misses.argmin()].exp()) == pytest.approx(0.2 * 2**0.5, rel=0.05)


def test_quarters_are_the_pixels_of_every_second_row_and_column():
    plane = torch.arange(4 * 6, dtype=torch.uint8).reshape(1, 1, 4, 6)
    assert torch.equal(quarters(plane), torch.nn.functional.pixel_unshuffle(plane, 2))


@pytest.mark.parametrize(("preset", "most"), [("nano", 0.6e9), ("small", 1.8e9)])
def test_presets_keep_their_size_promises(preset, most):
    network = BallNet(BALL_PRESETS[preset])
    grey, colour = torch.zeros(1, 3, 144, 256, dtype=torch.uint8), torch.zeros(1, 2, 72, 128, dtype=torch.uint8)
    assert sum(p.numel() for p in network.parameters()) < 300_000
    assert 25 * multiply_adds(network, grey, colour) < most


def test_nano_learns_a_handful_of_frames(toy_clip, tmp_path):
    clip = toy_clip(12, 3)
    pairs = np.array([[0, k] for k in range(1, 11)])
    frames = FrameSet(clips=(clip,), training=pairs, held_out=pairs)
    options = BallTaskOptions(
        preset="nano", batch=8, per_frame=4, crop=64, zoom=(0.24, 0.26), drawn=0.0, distractors=0.0, shake_px=0.0
    )
    task = BallTask(lambda: frames, options)
    torch.manual_seed(0)
    training = TrainOptions(steps=70, learning_rate=1e-2, average=0.9, log_every=1000, threads=1)
    outcome = train(BallNet(BALL_PRESETS["nano"]), task, training, tmp_path / "run", provenance={})
    figures = task.validate(outcome.network)
    assert figures["recall_of_best"] >= 0.8
    assert figures["median_px"] < 1.5


def test_onnx_equals_torch_at_any_size_and_carries_its_calibration(tmp_path):
    torch.manual_seed(0)
    network = BallNet(BALL_PRESETS["nano"]).train()
    with torch.no_grad():
        for _ in range(3):  # norms with statistics and weights that folding must not lose
            noise = torch.randint(0, 255, (2, 5, 64, 64), dtype=torch.uint8)
            network(noise[:, :3], noise[:, 3:, :32, :32])
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    network.eval()
    path = tmp_path / "ball.onnx"
    calibration = Calibration(slope=0.7, shift=-1.5, sigma=1.2)
    export_ball(network, calibration, path, about={"step": 3})
    reader = BallNetwork.load(path, threads=1)
    assert reader.calibration == calibration
    rng = np.random.default_rng(0)
    for rows, columns in ((64, 96), (176, 32)):
        grey = rng.integers(0, 255, (1, 3, rows, columns), dtype=np.uint8)
        colour = rng.integers(0, 255, (1, 2, rows // 2, columns // 2), dtype=np.uint8)
        with torch.no_grad():
            given = torch.from_numpy(grey), torch.from_numpy(colour)
            expected, folded = network(*given), fold_norms(network)(*given)
        assert float((expected - folded).abs().max()) < 2e-3
        np.testing.assert_allclose(expected.numpy(), reader.answers(grey, colour), atol=2e-3)
    assert not list(tmp_path.glob("*.data"))


def predictions(logits, error, *, diameter=4.0) -> Predictions:
    """Best candidates of frames with a ball each; a second one nowhere near."""
    count = len(logits)
    nowhere = np.full(count, np.inf)
    return Predictions(
        logits=np.stack([logits, np.full(count, np.nan)], axis=1),
        error_px=np.stack([error, nowhere], axis=1),
        sigma_px=np.full((count, 2), 0.5),
        right=np.stack([error < 5, nowhere < 5], axis=1),
        unknown=np.zeros((count, 2), bool),
        seen=np.ones(count, bool),
        diameter_px=np.full(count, diameter),
        streak_px=np.zeros(count),
        streak_error_px=np.full((count, 2), 1.0),
    )


def test_calibration_gives_back_the_odds_and_the_spread_that_made_the_data():
    rng = np.random.default_rng(0)
    logits = rng.uniform(-6, 4, 6000)
    right = rng.random(6000) < 1 / (1 + np.exp(-(0.6 * logits + 1.0)))
    error = np.where(right, np.hypot(*rng.normal(0, 0.8, (2, 6000))), 100.0)
    found = calibrate((predictions(logits[:3000], error[:3000]), predictions(logits[3000:], error[3000:])))
    assert found.slope == pytest.approx(0.6, abs=0.05)
    assert found.shift == pytest.approx(1.0, abs=0.1)
    assert found.sigma == pytest.approx(0.8 / 0.5, rel=0.05)


def test_scores_count_what_is_found_and_what_is_claimed():
    error = np.array([0.5, 0.5, 0.5, 50.0])
    perfect_order = score_frames(predictions(np.array([4.0, 3.0, 2.0, 1.0]), error))
    assert perfect_order["recall_at_90"] == pytest.approx(0.75)
    assert perfect_order["average_precision"] == pytest.approx(0.75)
    wrong_first = score_frames(predictions(np.array([1.0, 2.0, 3.0, 4.0]), error))
    assert wrong_first["recall_at_90"] == 0.0
    assert wrong_first["recall_of_best"] == pytest.approx(0.75)
    assert wrong_first["median_px"] == pytest.approx(0.5)


def test_matches_are_held_out_whole_and_names_tell_them():
    assert match_of("tennis_4101_003.01") == "tennis_4101_003"
    assert match_of("mix") == "mix"


def test_clips_of_one_match_stay_together(toy_clip):
    clips = [replace(toy_clip(5, k), clip_id=f"match_{k // 2}.{k % 2:02d}") for k in range(40)]
    frames = divide_matches(clips)
    kept, out = ({match_of(clips[c].clip_id) for c in np.unique(p[:, 0])} for p in (frames.training, frames.held_out))
    assert kept and out and not kept & out
    assert set(frames.training[:, 1]) == {1, 2, 3}  # both neighbours are there


@pytest.fixture
def ball_dataset(dataset):
    """The dataset of the conftest with a ball: seen, held by a player, behind the camera's view and gone."""
    folder = dataset / "work" / "mix"
    camera = read_table(folder / "camera.parquet")
    rows = len(camera["video_frame"])
    assert rows == 4
    return dataset, folder, rows


def ball_table(folder, position, velocity, event) -> None:
    rows = len(position)
    columns = {
        "clip_id": ["mix"] * rows,
        "frame_index": np.arange(rows),
        "video_frame": np.arange(1, rows + 1),
        "timestamp": np.arange(1, rows + 1) / 25,
        "ball.pixel": np.zeros((rows, 2), np.float32),
        "ball.score": np.ones(rows, np.float32),
        "ball.position": position,
        "ball.velocity": velocity,
        "ball.position_cov": np.zeros((rows, 6)),
        "ball.status": ["measured"] * rows,
        "ball.event": event,
    }
    write_table(folder / "ball.parquet", table="ball", scene=SCENE, columns=columns)


def test_a_prepared_clip_knows_where_its_ball_is_and_when_it_is_not_to_be_seen(ball_dataset, tmp_path):
    dataset, folder, rows = ball_dataset
    # The camera of the fixture: K = 150 px, centre (79.5, 47.5), 30 m before the net's middle and 6 m up.
    velocity = np.tile([20.0, 0.0, 0.0], (rows, 1))
    position = np.array([[-6.0, 0, 7.0], [-5.2, 0, 7.0], [-4.4, 0, 7.0], [-3.6, 0, 7.0]])
    pixel = np.array([79.5, 47.5]) + 150 / 30 * np.stack([position[:, 0], 6.0 - position[:, 2]], axis=1)
    document = json.loads((folder / "clip.json").read_text())
    (folder / "clip.json").write_text(json.dumps({**document, "shutter_s": 0.01}))
    bare = np.full((96, 160, 3), (90, 60, 50), np.uint8)
    drawn = [with_ball(bare, p, np.array([1.0, 0.0]), 1.4) for p in pixel]
    write_video(dataset / "videos" / "mix.mp4", iter([bare, *drawn[:2], bare, drawn[3], bare]), fps=25.0)
    ball_table(folder, position, velocity, ["none"] * rows)
    (found,) = find_clips(dataset, "ball.parquet")
    clip = prepare_ball_clip(found, find_video(found, dataset), tmp_path / "cache", SCENE)
    np.testing.assert_allclose(clip.ball_px[:3], pixel[:3], atol=0.05)
    np.testing.assert_allclose(clip.streak_px[:3], [[1.0, 0.0]] * 3, atol=0.02)
    # The third frame's picture lacks the ball, the fourth has no camera.
    assert clip.state.tolist() == [SEEN, SEEN, UNKNOWN, ABSENT]
    again = prepare_ball_clip(found, dataset / "gone.mp4", tmp_path / "cache", SCENE)
    np.testing.assert_array_equal(again.state, clip.state)
    ball_table(folder, position, velocity, ["none", "first", "none", "none"])
    held = prepare_ball_clip(found, find_video(found, dataset), tmp_path / "other", SCENE)
    assert held.state.tolist() == [UNKNOWN, UNKNOWN, UNKNOWN, ABSENT]


def test_turns_carry_far_points_between_frames(ball_dataset):
    from pgm_data.geometry.camera import Camera, project
    from pgm_data.geometry.rigid import rotation_from_rotvec

    R = rotation_from_rotvec(np.array([[0.0, 0.0, 0.0], [0.01, 0.03, 0.002]]))
    camera = Camera(
        K=np.array([[[900.0, 0, 320], [0, 900, 180], [0, 0, 1]], [[950.0, 0, 320], [0, 950, 180], [0, 0, 1]]]),
        distortion=np.zeros((2, 4)),
        R_cam_from_world=R,
        t_cam_from_world=np.zeros((2, 3)),
    )
    pixels, _ = project(camera, np.array([[1.0, 2.0, 40.0], [-3.0, 1.0, 25.0]]))
    moved = np.concatenate([pixels[0], np.ones((2, 1))], axis=1) @ turns(camera)[1].T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:], pixels[1], atol=1e-9)
    np.testing.assert_array_equal(turns(camera)[0], np.eye(3))
