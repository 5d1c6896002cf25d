"""Events told from simulated tracks of seeds that no training has seen, and the laws they keep."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.detect.ball.track_event_times import kink_squares, kink_time
from pgm_data.detect.ball.track_events import TrackEventOptions, find_events, find_hills
from pgm_data.detect.ball.track_features import FEATURES, STEP_S, step_features, stretches
from pgm_data.detect.ball.track_network import TrackEventNetwork
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from pgm_data.simulate.tennis.match import draw_match, plays

SIZE = (1280, 720)
ALL = TrackEventOptions(least_live=0.0)


def camera(size: tuple[int, int] = SIZE) -> Camera:
    """A broadcast camera behind the near end."""
    centre = np.array([0.6, -38.0, 9.5])
    forward = np.array([0.0, -1.5, 0.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = 2.05 * size[0]
    K = np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ centre)


def track_of(times: np.ndarray, pixels: np.ndarray, is_duplicate: np.ndarray | None = None) -> BallTrack:
    """A track of those pixels, NaN where missing."""
    seen = np.isfinite(pixels[:, 0])
    return BallTrack(
        times=times,
        is_duplicate=np.zeros(len(times), bool) if is_duplicate is None else is_duplicate,
        pixels=pixels,
        sigma_px=np.where(seen, 1.0, np.nan),
        score=np.where(seen, 0.9, np.nan),
        streak_px=np.full((len(times), 2), np.nan),
    )


def rallies(seed: int, count: int, fps: float) -> list[tuple[BallTrack, dict[str, np.ndarray]]]:
    """Tracks of simulated plays with 1 px noise, 8 % and bursts of 3 missing, and the true times of each kind."""
    rng = np.random.default_rng(seed)
    match = draw_match(rng, load_scene("tennis"), name="m")
    found = []
    for play in islice(plays(match, rng), count):
        times = np.arange(0.0, play.duration_s, 1 / fps)
        positions, _ = play.ball.at(times)
        pixels, _ = project(camera(), positions)
        pixels = pixels + rng.standard_normal(pixels.shape)
        hidden = rng.random(len(times)) < 0.08
        for start in rng.integers(0, len(times), int(play.duration_s / 3) + 1):
            hidden[start : start + 3] = True
        outside = ~((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(axis=1)
        pixels[hidden | outside] = np.nan
        contacts = play.ball.contacts
        truth = {kind: np.array([c.time for c in contacts if c.kind == kind]) for kind in ("hit", "bounce")}
        found.append((track_of(times, pixels), truth))
    return found


def pairs_within(found: np.ndarray, true: np.ndarray, reach: float) -> list[tuple[int, int]]:
    """One-to-one, nearest first."""
    near = sorted((abs(a - b), i, j) for i, a in enumerate(found) for j, b in enumerate(true) if abs(a - b) <= reach)
    pairs: list[tuple[int, int]] = []
    for _, i, j in near:
        if all(i != k and j != m for k, m in pairs):
            pairs.append((i, j))
    return pairs


def of_kind(events: BallEvents, kind: str) -> np.ndarray:
    """Times of one kind."""
    return events.times[events.kinds == kind]


@pytest.fixture(scope="module")
def network() -> TrackEventNetwork:
    return TrackEventNetwork.load()


@pytest.fixture(scope="module")
def unseen() -> list[tuple[BallTrack, dict[str, np.ndarray]]]:
    return rallies(77031, 12, 50.0)


@pytest.mark.parametrize("fps", [25.0, 50.0])
def test_hits_and_bounces_of_unseen_rallies_are_found_and_told_apart(network, unseen, fps):
    cases = unseen if fps == 50.0 else rallies(40412, 12, fps)
    right, told, true, errors, scores = 0, 0, 0, [], []
    for track, truth in cases:
        events = find_events(track, size=SIZE, options=ALL, network=network)
        for kind, times in truth.items():
            found = of_kind(events, kind)
            pairs = pairs_within(found, times, 2 / fps)
            right, told, true = right + len(pairs), told + len(found), true + len(times)
            std = events.time_std[events.kinds == kind]
            errors += [found[i] - times[j] for i, j in pairs]
            scores += [(found[i] - times[j]) / std[i] for i, j in pairs]
    assert 2 * right / (told + true) > 0.88
    assert np.median(np.abs(errors)) < 0.15 / fps
    assert 0.5 < np.mean(np.abs(scores) < 1) < 0.85


def test_dead_bounces_are_left_out_where_only_play_counts(network, unseen):
    for track, _ in unseen:
        whole = find_events(track, size=SIZE, options=ALL, network=network)
        live = find_events(track, size=SIZE, options=TrackEventOptions(least_live=0.5), network=network)
        assert len(of_kind(live, "bounce")) <= len(of_kind(whole, "bounce"))
        np.testing.assert_allclose(of_kind(live, "hit"), of_kind(whole, "hit"), atol=0.01)
        hits = of_kind(live, "hit")
        after = of_kind(live, "bounce")
        assert (after > hits.max()).sum() <= 1


def one_after_another(tracks: list[BallTrack], pause: float) -> BallTrack:
    """The tracks as one."""
    times, start = [], 0.0
    for track in tracks:
        times.append(track.times - track.times[0] + start)
        start = times[-1][-1] + pause
    return track_of(np.concatenate(times), np.concatenate([track.pixels for track in tracks]))


def test_each_play_has_one_first_and_one_last_round_its_contacts(network, unseen):
    whole = [one_after_another([track for track, _ in unseen], pause) for pause in (0.02, 1.0, 8.0)]
    assert all((find_events(track, size=SIZE, network=network).kinds == "first").sum() >= 10 for track in whole)
    for track in [track for track, _ in unseen] + whole:
        events = find_events(track, size=SIZE, network=network)
        inside = 0
        for kind in events.kinds:
            inside += {"first": 1, "last": -1}.get(kind, 0)
            assert inside == (kind != "last")
        assert inside == 0
        assert (np.diff(events.times) >= 0).all()
        assert events.times[0] >= track.times[0] and events.times[-1] <= track.times[-1]
        assert set(events.sources) == {"detected"} and set(events.players) == {""}
        assert ((events.probability > 0) & (events.probability <= 1)).all() and (events.time_std > 0).all()


def test_a_toss_begins_the_play(network):
    starts = []
    rng = np.random.default_rng(5)
    match = draw_match(rng, load_scene("tennis"), name="m")
    for play in islice(plays(match, rng), 5):
        times = np.arange(0.0, play.duration_s, 0.02)
        pixels, _ = project(camera(), play.ball.at(times)[0])
        events = find_events(track_of(times, pixels), size=SIZE, network=network)
        starts.append(events.times[0] - play.ball.contacts[0].time)
    assert np.median(np.abs(starts)) < 0.1


@pytest.mark.parametrize("fps", [10.0, 240.0])
def test_very_slow_and_very_fast_cameras_find_most_of_it(network, fps):
    right = true = 0
    for track, truth in rallies(812, 4, fps):
        events = find_events(track, size=SIZE, options=ALL, network=network)
        for kind in ("hit", "bounce"):
            right += len(pairs_within(of_kind(events, kind), truth[kind], max(2 / fps, 0.04)))
            true += len(truth[kind])
    assert right > (0.6 if fps == 10.0 else 0.85) * true


def same(a: BallEvents, b: BallEvents, atol: float) -> None:
    assert list(a.kinds) == list(b.kinds)
    np.testing.assert_allclose(a.times, b.times, atol=atol)


def test_neither_clock_nor_size_of_the_picture_matters(network, unseen):
    track, _ = unseen[0]
    events = find_events(track, size=SIZE, network=network)
    later = replace(track, times=track.times + 3600.0)
    moved = find_events(later, size=SIZE, network=network)
    same(events, replace(moved, times=moved.times - 3600.0), 1e-6)
    large = replace(track, pixels=(track.pixels + 0.5) * 2 - 0.5)
    same(events, find_events(large, size=(2560, 1440), network=network), 1e-6)


def test_repeats_change_nothing(network, unseen):
    track, _ = unseen[1]
    index = np.sort(np.concatenate([np.arange(len(track.times)), np.arange(4, len(track.times), 5)]))
    repeat = np.concatenate([[False], np.diff(index) == 0])
    doubled = track_of(track.times[index], np.where(repeat[:, None], 99.0, track.pixels[index]), repeat)
    same(find_events(track, size=SIZE, network=network), find_events(doubled, size=SIZE, network=network), 1e-9)


def test_tracks_without_an_event_give_none(network):
    times = np.arange(0.0, 30.0, 0.04)
    missing = np.full((len(times), 2), np.nan)
    level = np.stack([200 + 2 * times, np.full(len(times), 300.0)], axis=1)
    for track in (
        track_of(np.zeros(0), np.zeros((0, 2))),
        track_of(times[:1], level[:1]),
        track_of(times, missing),
        track_of(times, level, np.ones(len(times), bool)),
        track_of(np.zeros(50), level[:50]),
        track_of(times, level),
        track_of(np.array([0.0, 1e7]), level[:2]),
    ):
        assert len(find_events(track, size=SIZE, network=network)) == 0


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_and_wild_pixels_break_nothing(network, seed):
    rng = np.random.default_rng(seed)
    times = np.sort(rng.random(400) * 20)
    pixels = rng.random((400, 2)) * SIZE * (1.0, 1e9)[seed % 2]
    events = find_events(track_of(times, pixels), size=SIZE, network=network)
    assert np.isfinite(events.times).all()


def test_an_empty_picture_and_foreign_networks_are_refused(tmp_path):
    track = track_of(np.arange(3.0), np.ones((3, 2)))
    with pytest.raises(ValueError, match="size: expected at least one pixel, got 0x720"):
        find_events(track, size=(0, 720))
    with pytest.raises(FileNotFoundError, match="track event network"):
        find_events(track, size=SIZE, options=TrackEventOptions(network=tmp_path / "none.onnx"))


def test_an_event_divided_between_two_steps_has_its_exact_time():
    shares = np.zeros((2, 100))
    shares[0, 40], shares[0, 41] = 0.72, 0.18
    shares[1, 70], shares[1, 71] = 0.3, 0.3
    hills = find_hills(shares, start_s=5.0)
    np.testing.assert_allclose(hills.times, [5 + 40.2 * STEP_S, 5 + 70.5 * STEP_S])
    np.testing.assert_allclose(hills.masses, [0.9, 0.6])
    np.testing.assert_allclose(hills.live, [1.0, 0.0])


def test_features_of_a_straight_flight_are_its_place_and_velocity():
    times = np.arange(0.0, 1.0, 0.013)
    velocity = np.array([300.0, -120.0])
    pixels = np.array([100.0, 500.0]) + times[:, None] * velocity
    features = step_features(times, pixels, size=SIZE, start_s=0.0, steps=50)
    assert features.shape == (FEATURES, 50)
    unit = np.hypot(*SIZE) / 2
    middle = np.arange(50) * STEP_S
    expected = (np.array([100.0, 500.0]) + middle[:, None] * velocity - (np.array(SIZE) - 1) / 2) / unit
    np.testing.assert_allclose(features[0:2, 1:-2].T, expected[1:-2], atol=1e-9)
    np.testing.assert_allclose(features[2:4, 3:-3].T - velocity / unit, 0, atol=1e-9)
    np.testing.assert_allclose(features[4:6, 4:-5], 0, atol=1e-9)


def test_parts_of_a_track_are_cut_at_long_holes_only():
    parts = stretches(np.array([0.0, 1.0, 5.0, 5.5, 9.0]), 3.2)
    assert [(p.start, p.stop) for p in parts] == [(0, 2), (2, 4), (4, 5)]
    assert stretches(np.zeros(0), 1.0) == []


def kinked(t: np.ndarray, at: float) -> np.ndarray:
    """Two parabolas that meet."""
    before, after = np.minimum(t - at, 0), np.maximum(t - at, 0)
    down, up = np.array([80.0, 400.0]), np.array([60.0, -250.0])
    return 300 + before[:, None] * down + after[:, None] * up + (before**2 + after**2)[:, None] * [0.0, 300.0]


def test_the_least_squares_of_a_kink_are_those_of_a_plain_fit():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(-0.2, 0.2, 14))
    places = rng.normal(0, 10, (14, 2))
    for kink, squares in zip((-0.03, 0.05), kink_squares(t, places, np.array([-0.03, 0.05]), bend=0.0), strict=True):
        before, after = np.minimum(t - kink, 0), np.maximum(t - kink, 0)
        terms = np.stack([np.ones(14), before, after, before**2, after**2], axis=1)
        _, residual, _, _ = np.linalg.lstsq(terms, places, rcond=None)
        np.testing.assert_allclose(squares, residual.sum(), rtol=1e-6)


def test_the_time_of_a_kink_is_finer_than_a_frame_and_knows_its_error():
    rng = np.random.default_rng(3)
    errors, stds = [], []
    for _ in range(150):
        at = rng.uniform(0.48, 0.52)
        times = np.arange(0.0, 1.0, 0.04) + rng.uniform(0, 0.04)
        pixels = kinked(times, at) + rng.standard_normal((len(times), 2))
        time, std = kink_time(
            times, pixels, about_s=at + rng.normal(0, 0.01), about_std_s=0.01,
            sides_s=(-np.inf, np.inf), sigma_px=1.0, unit_px=734.0,
        )  # fmt: skip
        errors.append(time - at)
        stds.append(std)
    assert np.sqrt(np.mean(np.square(errors))) < 0.004
    assert 0.6 < np.mean(np.abs(errors) < stds) < 0.95


def test_a_kink_with_too_little_round_it_keeps_the_first_idea():
    times = np.array([0.3, 0.4, 0.55])
    answer = kink_time(
        times, np.ones((3, 2)), about_s=0.5, about_std_s=0.02, sides_s=(-np.inf, np.inf), sigma_px=1.0, unit_px=700.0
    )
    assert answer == (0.5, 0.02)
