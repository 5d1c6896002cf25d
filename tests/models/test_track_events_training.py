"""Tracks to learn contacts from, and the network that learns them."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

from pgm_data.detect.ball.track_features import FEATURES, STEP_S
from pgm_data.detect.ball.track_network import CLASSES, TrackEventNetwork, class_shares
from pgm_data.geometry.camera import Camera, project
from pgm_models.detectors.track_event_net import TrackEventNet
from pgm_models.detectors.track_event_plays import (
    BOUNCE,
    DEAD_BOUNCE,
    HIT,
    NET,
    TOSS,
    TruePlay,
    find_plays,
    with_dribbles,
)
from pgm_models.detectors.track_event_run import TrackEventRunOptions, train_track_events
from pgm_models.detectors.track_event_task import TrackEventTask, TrackEventTaskOptions, class_targets, draw_window
from pgm_models.detectors.track_event_views import detected, draw_rate, draw_view, hide_contacts, hide_spells


def made_up_play() -> TruePlay:
    """A toss, a serve, its bounce and one more, in straight lines."""
    times = np.array([0.0, 1.0, 1.8, 2.3, 3.0, 3.6])
    places = np.array([[0, -11.5, 1], [0, -11.5, 1.6], [0, -11.3, 2.8], [1, 5, 0.03], [1.5, 11, 0.03], [2, 14, 0.5]])
    return TruePlay(
        times=times, positions=places, event_times=times[1:5], event_classes=np.array([TOSS, HIT, BOUNCE, DEAD_BOUNCE])
    )


def write_clip(folder: Path, kinds: list[str], event_times: list[float]) -> np.ndarray:
    """Tables of a clip whose ball moves along x with 10 m/s, its fifth frame a repeat; positions at the events."""
    folder.mkdir(parents=True)
    frames = np.arange(51) - (np.arange(51) > 4)
    taken = 20.0 + 0.04 * frames

    def course(times: np.ndarray) -> np.ndarray:
        return np.stack([10 * (times - 20.0), np.zeros(len(times)), np.ones(len(times))], axis=1)

    def vectors(values: np.ndarray) -> pa.Array:
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), 3)

    at = np.array(event_times)
    camera = {"frame.is_duplicate": np.diff(frames, prepend=-1) == 0, "frame.capture_time": taken}
    pq.write_table(pa.table(camera), folder / "camera.parquet")
    pq.write_table(pa.table({"ball.position": vectors(course(taken))}), folder / "ball.parquet")
    events = {"kind": kinds, "time": at, "position": vectors(course(at))}
    pq.write_table(pa.table(events), folder / "events.parquet")
    return course(at)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulated")
    kinds = ["first", "hit", "bounce", "hit", "net", "bounce", "bounce", "last"]
    write_clip(out / "work" / "a", kinds, [20.103, 20.5, 20.811, 21.0, 21.2, 21.317, 21.5, 21.9])
    write_clip(out / "work" / "b", ["first", "hit", "bounce", "bounce", "last"], [20.2, 20.6, 21.0, 21.4, 21.8])
    write_clip(out / "work" / "c", ["bounce", "last"], [20.2, 20.6])
    return out


def test_plays_are_read_with_their_events_on_the_path(simulated):
    first, second = find_plays(simulated)
    assert first.event_classes.tolist() == [TOSS, HIT, BOUNCE, HIT, NET, DEAD_BOUNCE, DEAD_BOUNCE]
    assert second.event_classes.tolist() == [TOSS, HIT, BOUNCE, DEAD_BOUNCE]
    for play in (first, second):
        assert (np.diff(play.times) > 0).all()
        assert np.isin(play.event_times, play.times).all()
        np.testing.assert_allclose(play.at(play.event_times)[:, 0], 10 * (play.event_times - 20.0), atol=1e-9)
        assert np.isnan(play.at(np.array([19.9, 22.1]))).all()


def test_a_dataset_without_plays_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected clip folders with the truth of a play"):
        find_plays(tmp_path)


def test_dribbles_come_before_the_toss_and_are_no_event():
    play = made_up_play()
    for seed in range(5):
        more = with_dribbles(play, np.random.default_rng(seed))
        np.testing.assert_array_equal(more.event_times, play.event_times)
        after = np.linspace(1.0, 3.5, 40)
        np.testing.assert_allclose(more.at(after), play.at(after), atol=1e-12)
        assert (np.diff(more.times) > 0).all()
        before = more.positions[more.times < play.event_times[0]]
        assert before[:, 2].min() < 0.05 and 0.5 < before[:, 2].max() < 1.7


def test_targets_of_an_event_have_its_exact_time_as_their_mean():
    times = np.array([0.314159, 1.0, 1.013])
    targets = class_targets(times, np.array([HIT, BOUNCE, HIT]), 100)
    np.testing.assert_allclose(targets.sum(axis=0), 1.0)
    steps = np.arange(100) * STEP_S
    early = np.where(steps < 0.6, targets[HIT], 0.0)
    np.testing.assert_allclose((early * steps).sum() / early.sum(), times[0])
    np.testing.assert_allclose((targets[BOUNCE] * steps).sum() / targets[BOUNCE].sum(), 1.0)
    assert class_targets(np.array([-5.0, 50.0]), np.array([HIT, HIT]), 100)[0].min() == 1.0


def test_a_view_that_does_not_follow_projects_as_any_camera():
    rng = np.random.default_rng(2)
    points = np.stack([rng.uniform(-4, 4, 30), rng.uniform(-11, 11, 30), rng.uniform(0, 3, 30)], axis=1)
    seen = 0
    for _ in range(10):
        view = replace(draw_view(rng), follow=0.0)
        width, height = view.size
        K = np.array([[view.focal_px, 0, (width - 1) / 2], [0, view.focal_px, (height - 1) / 2], [0, 0, 1.0]])
        R = view.R_cam_from_world
        camera = Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ view.centre_world)
        expected, _ = project(camera, points)
        pixels = view.pixels(points, np.arange(30.0))
        inside = np.isfinite(pixels[:, 0])
        np.testing.assert_allclose(pixels[inside], expected[inside], atol=1e-6)
        seen += inside.sum()
    assert seen > 150


def test_a_view_that_follows_keeps_a_resting_ball_nearer_the_middle():
    rng = np.random.default_rng(4)
    times = np.arange(0.0, 4.0, 0.04)
    for _ in range(20):
        view = draw_view(rng)
        middle = (view.size[0] - 1) / 2
        ball = np.tile([rng.uniform(-2.0, 2.0), rng.uniform(-4.0, 4.0), 1.0], (len(times), 1))
        off = [abs(replace(view, follow=f).pixels(ball, times)[-1, 0] - middle) for f in (0.0, 0.3, 0.6, 1.0)]
        assert off[0] >= off[1] >= off[2] >= off[3]
        assert off[3] < 0.1 * middle


def test_detectors_faults_keep_the_shape_and_hide_what_they_should():
    rng = np.random.default_rng(6)
    times = np.arange(0.0, 10.0, 0.04)
    straight = np.stack([100 + 50 * times, 300 + 10 * times], axis=1)
    shares, errors = [], []
    for _ in range(40):
        hidden = hide_spells(rng, times) | hide_contacts(rng, times, np.array([2.0, 5.0]))
        shares.append(hidden.mean())
        pixels = detected(rng, times, np.where(hidden[:, None], np.nan, straight), (1920, 1080))
        assert pixels.shape == straight.shape
        assert (np.isfinite(pixels[:, 0]) == np.isfinite(pixels[:, 1])).all()
        errors.append(np.nanmedian(np.abs(pixels - straight)))
        assert 10.0 <= draw_rate(rng) <= 240.0
    assert 0.05 < np.mean(shares) < 0.4
    assert 0.2 < np.median(errors) < 3.0


def test_windows_are_what_their_seed_says_and_hold_every_kind_of_step():
    options = TrackEventTaskOptions(batch=8, steps=256)
    task = TrackEventTask([made_up_play()] * 3, options)
    first, again, other = task.batch(3), task.batch(3), task.batch(4)
    for name, value in first.tensors.items():
        torch.testing.assert_close(value, again.tensors[name], rtol=0, atol=0)
    assert not torch.equal(first.tensors["features"], other.tensors["features"])
    assert first.tensors["features"].shape == (8, FEATURES, 256)
    torch.testing.assert_close(first.tensors["classes"].sum(dim=1), torch.ones(8, 256))
    assert torch.isfinite(first.tensors["features"]).all()
    window = draw_window(np.random.default_rng(0), [made_up_play()], options)
    assert window.counted.max() == 1.0


def test_training_learns_and_leaves_a_network_that_reads_any_length(simulated, tmp_path):
    options = TrackEventRunOptions(dataset=simulated, run=tmp_path / "run", steps=6, batch=2, learning_rate=1e-2)
    said: list[str] = []
    outcome = train_track_events(options, command=["pgm-train"], show=said.append)
    assert outcome.state == "done" and any("held out" in line for line in said)
    network = TrackEventNetwork.load(tmp_path / "run" / "track_events.onnx")
    rng = np.random.default_rng(0)
    for steps in (2, 77, 1300):
        features = rng.standard_normal((FEATURES, steps))
        with torch.no_grad():
            logits = outcome.network(torch.from_numpy(features[None].astype(np.float32)))[0].numpy().astype(float)
        np.testing.assert_allclose(network.shares(features), class_shares(logits), atol=1e-5)


def test_a_few_steps_on_one_batch_lower_its_loss():
    task = TrackEventTask([made_up_play()], TrackEventTaskOptions(batch=2, steps=128))
    torch.manual_seed(0)
    network = TrackEventNet(width=8, dilations=(1, 4))
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    batch = task.batch(0)
    losses = []
    for _ in range(25):
        optimiser.zero_grad()
        loss, _ = task.loss(network, batch)
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.5 * losses[0]
    figures = task.validate(network.eval())
    assert set(figures) == {"loss_e3", *(f"{name}_ratio" for name in CLASSES)}


def test_a_file_of_another_network_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected an ONNX file"):
        (tmp_path / "bad.onnx").write_bytes(b"no network")
        TrackEventNetwork.load(tmp_path / "bad.onnx")
    with pytest.raises(ValueError, match="expected the classes"):
        TrackEventNetwork.load(Path(str(files("pgm_data.detect") / "weights" / "court_tennis.onnx")))
