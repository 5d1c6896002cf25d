"""A noisy ball is put back on a path that balls can fly, and what is given stays as it is."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_models.animation.settle_ball import BallPath, SettleBallOptions, SettledBall, settled_ball
from pgm_models.animation.settle_breaks import flown

TENNIS = load_scene("tennis")
RADIUS, DRAG, RESTITUTION = 0.0335, 0.0203, 0.75
NEAR, FAR = np.array([1.0, -12.5, 0.95]), np.array([-1.0, 12.5, 0.95])
BOUNCES, HIT_S = 2, 1.25


def stepped(position: np.ndarray, velocity: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The slow obvious flight: many small steps."""
    h = seconds / 4_000
    for _ in range(4_000):
        pull = -DRAG * np.linalg.norm(velocity) * velocity - [0.0, 0.0, 9.81]
        position = position + h * velocity + 0.5 * h * h * pull
        velocity = velocity + h * pull
    return position, velocity


def rally(fps: float = 25.0, seconds: float = 2.4, early_s: float = 0.0) -> tuple[BallPath, list[tuple[float, str]]]:
    """A shot that bounces, is hit back near the far player, and bounces again; and when that was.

    The far player stands where the shot is at `HIT_S`; it is hit back that much earlier.
    """
    h, x, v, time = 1e-3, np.array([1.0, -11.5, 1.0]), np.array([-1.5, 24.0, 4.0]), 0.0
    states, events, goes_on = [], [], None
    while time < seconds:
        states.append((x, v))
        if goes_on is None and time >= HIT_S - early_s:
            events.append((time, "hit"))
            goes_on, v = (x, v), np.array([1.0, -21.0, 5.0])
        x, v, landed = small_step(x, v, h)
        if landed:
            events.append((time + h, "bounce"))
        time += h
    every = round(1 / fps / h)
    position, velocity = (np.array(part)[::every] for part in zip(*states, strict=True))
    at_hit, v = goes_on or states[-1]
    for _ in range(round(abs(early_s) / h)):
        at_hit, v, _ = small_step(at_hit, v, np.sign(early_s) * h)
    roots = np.tile(np.stack([NEAR, at_hit + [0.8, 0.5, 0.0]]), (len(position), 1, 1))
    return path(position, velocity, fps=fps, roots=roots), events


def small_step(x: np.ndarray, v: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray, bool]:
    """A ball a little later, and whether it bounced."""
    pull = -DRAG * np.linalg.norm(v) * v - [0.0, 0.0, 9.81]
    x, v = x + h * v + 0.5 * h * h * pull, v + h * pull
    landed = bool(x[2] < RADIUS and v[2] < 0 and h > 0)
    return x, v * [0.7, 0.7, -RESTITUTION] if landed else v, landed


def path(position: np.ndarray, velocity: np.ndarray, *, fps: float = 25.0, roots: np.ndarray | None = None) -> BallPath:
    count = len(position)
    return BallPath(
        position=np.asarray(position, dtype=np.float64),
        velocity=np.asarray(velocity, dtype=np.float64),
        known_position=np.zeros(count, dtype=bool),
        known_velocity=np.zeros(count, dtype=bool),
        times=np.arange(count) / fps,
        roots=np.zeros((count, 0, 3)) if roots is None else roots,
    )


def noisy(ball: BallPath, metres: float, speed: float, seed: int = 0) -> BallPath:
    draws = np.random.default_rng(seed).normal(size=(2, len(ball.times), 3))
    made = ~ball.known_position[:, None], ~ball.known_velocity[:, None]
    return replace(
        ball,
        position=ball.position + metres * draws[0] * made[0],
        velocity=ball.velocity + speed * draws[1] * made[1],
    )


def free_steps(settled: SettledBall, times: np.ndarray) -> np.ndarray:
    """Steps between frames in which no contact is."""
    inside = (settled.contact_time >= times[:-1, None]) & (settled.contact_time <= times[1:, None])
    return np.array(~inside.any(axis=1), dtype=bool)


def assert_plausible(settled: SettledBall, ball: BallPath) -> None:
    """Nothing below the ground; between contacts no energy gained, and velocities that fit places."""
    flies = settled.status == "flight"
    assert (settled.position[flies, 2] >= RADIUS - 1e-12).all()
    steps = free_steps(settled, ball.times) & flies[1:] & flies[:-1]
    known = ball.known_position | ball.known_velocity
    steps &= ~known[1:] & ~known[:-1]
    energy = 0.5 * (settled.velocity**2).sum(axis=1) + 9.81 * settled.position[:, 2]
    # A frame may be lifted onto the ground by the error up to which flights meet there.
    assert (np.diff(energy)[steps] < 1e-2).all()
    moved = np.diff(settled.position, axis=0) / np.diff(ball.times)[:, None]
    mean = 0.5 * (settled.velocity[1:] + settled.velocity[:-1])
    assert (np.abs(moved - mean)[steps] < 0.15).all()


def test_flights_are_those_of_many_small_steps():
    position, velocity = np.array([0.0, -11.0, 1.0]), np.array([2.0, 31.0, 4.0])
    slow = stepped(position, velocity, 1.1)
    fast = flown(position[None], velocity[None], np.array([1.1]), DRAG)
    np.testing.assert_allclose(fast[0][0], slow[0], atol=5e-3)
    np.testing.assert_allclose(fast[1][0], slow[1], atol=5e-3)


def test_a_true_rally_stays_as_it_is_with_its_contacts():
    ball, events = rally()
    settled = settled_ball(ball, TENNIS)
    assert settled.moved_m.max() < 0.03
    assert settled.contact_kind.tolist() == [kind for _, kind in events]
    np.testing.assert_allclose(settled.contact_time, [time for time, _ in events], atol=0.01)
    assert_plausible(settled, ball)


@pytest.mark.parametrize(("metres", "speed"), [(0.1, 1.0), (0.3, 3.0)])
def test_noise_is_taken_off(metres: float, speed: float):
    truth, events = rally()
    ball = noisy(truth, metres, speed)
    settled = settled_ball(ball, TENNIS)
    before = np.median(np.linalg.norm(ball.position - truth.position, axis=1))
    after = np.median(np.linalg.norm(settled.position - truth.position, axis=1))
    assert after < 0.6 * before
    assert settled.contact_kind.tolist() == [kind for _, kind in events]
    np.testing.assert_allclose(settled.contact_time, [time for time, _ in events], atol=0.06)
    assert_plausible(settled, ball)


def test_a_bounce_is_on_the_ground_and_gives_back_what_the_ground_can():
    ball = noisy(rally()[0], 0.2, 2.0, seed=3)
    settled = settled_ball(ball, TENNIS)
    bounces = np.flatnonzero(settled.contact_kind == "bounce")
    assert len(bounces) == BOUNCES
    np.testing.assert_allclose(settled.contact_position[bounces, 2], RADIUS, atol=2e-3)
    for time in settled.contact_time[bounces]:
        before, after = np.searchsorted(ball.times, time) - 1, np.searchsorted(ball.times, time)
        down = stepped(settled.position[before], settled.velocity[before], time - ball.times[before])[1][2]
        up = stepped(settled.position[after], settled.velocity[after], time - ball.times[after])[1][2]
        assert 0.59 - 0.1 < -up / down < 0.91 + 0.1


@pytest.mark.parametrize("early_s", [-0.2, -0.15, 0.06, 0.12, 0.2])
def test_a_stroke_out_of_reach_is_put_where_the_player_reaches_the_ball(early_s: float):
    ball, events = rally(seconds=2.6, early_s=early_s)
    ball = noisy(ball, 0.1, 0.5)
    settled = settled_ball(ball, TENNIS)
    assert_plausible(settled, ball)
    (hit,) = np.flatnonzero(settled.contact_kind == "hit")
    away = np.linalg.norm(settled.contact_position[hit] - ball.roots[0, 1])
    assert away < 1.3
    assert abs(settled.contact_time[hit] - HIT_S) < 0.14
    # Where it bounces before and after stays.
    (first, last) = (time for time, kind in events if kind == "bounce")
    found = settled.contact_time[settled.contact_kind == "bounce"]
    np.testing.assert_allclose(found[0], first, atol=0.03)
    np.testing.assert_allclose(found[-1], last, atol=0.08)
    unmoved = settled_ball(ball, TENNIS, SettleBallOptions(stroke_farthest_m=0.0))
    (before,) = np.flatnonzero(np.isin(unmoved.contact_kind, ("hit", "free")))
    assert np.linalg.norm(unmoved.contact_position[before] - ball.roots[0, 1]) > 1.3


def test_a_stroke_that_nobody_can_reach_stays():
    ball, _ = rally(early_s=0.12)
    away = replace(ball, roots=ball.roots + [4.0, 0.0, 0.0])
    one, other = (settled_ball(ball, TENNIS, SettleBallOptions(stroke_farthest_m=far)) for far in (0.0, 2.2))
    settled = settled_ball(away, TENNIS)
    np.testing.assert_allclose(settled.position, one.position, atol=0.02)
    assert np.abs(other.position - one.position).max() > 1.0


def test_known_frames_keep_their_flights_when_a_stroke_would_be_moved():
    ball, _ = rally(early_s=0.12)
    known = np.zeros(len(ball.times), dtype=bool)
    known[:-20] = True
    settled = settled_ball(replace(ball, known_position=known, known_velocity=known), TENNIS)
    assert np.array_equal(settled.position[known], ball.position[known])
    assert settled.moved_m.max() < 0.5


def test_settling_twice_changes_little():
    once = settled_ball(noisy(rally()[0], 0.1, 1.0), TENNIS)
    again = settled_ball(replace(rally()[0], position=once.position, velocity=once.velocity), TENNIS)
    assert np.median(again.moved_m) < 0.01
    assert again.contact_kind.tolist() == once.contact_kind.tolist()


def test_known_values_come_back_to_the_bit_and_the_path_goes_on_from_them():
    truth, _ = rally()
    known = np.zeros(len(truth.times), dtype=bool)
    known[[0, 1, 2, 20, 45]] = True
    ball = noisy(replace(truth, known_position=known, known_velocity=known), 0.2, 2.0)
    settled = settled_ball(ball, TENNIS)
    assert (settled.position[known] == truth.position[known]).all()
    assert (settled.velocity[known] == truth.velocity[known]).all()
    assert (settled.status == "flight").all()
    ahead, _ = flown(truth.position[[2]], truth.velocity[[2]], np.array([0.04]), DRAG)
    assert np.linalg.norm(settled.position[3] - ahead[0]) < 0.02
    assert np.linalg.norm(settled.position[21] - settled.position[20] - 0.04 * settled.velocity[20]) < 0.03


def test_all_known_is_returned():
    truth, _ = rally(seconds=0.4)
    known = np.ones(len(truth.times), dtype=bool)
    odd = replace(noisy(truth, 1.0, 9.0), known_position=known, known_velocity=known)
    settled = settled_ball(odd, TENNIS)
    assert (settled.position == odd.position).all() and (settled.velocity == odd.velocity).all()
    assert (settled.moved_m == 0).all()


def test_between_few_frames_the_path_is_plausible_too():
    truth, _ = rally(fps=4.0)
    settled = settled_ball(noisy(truth, 0.1, 1.0), TENNIS)
    assert (settled.position[:, 2] >= RADIUS).all()
    assert np.median(np.linalg.norm(settled.position - truth.position, axis=1)) < 0.2
    assert len(settled.contact_time) >= 2


def test_one_frame_is_its_own_flight():
    one = path(np.array([[0.0, 1.0, 2.0]]), np.array([[3.0, 4.0, 5.0]]))
    settled = settled_ball(one, TENNIS)
    np.testing.assert_allclose(settled.position, one.position, atol=1e-6)
    np.testing.assert_allclose(settled.velocity, one.velocity, atol=1e-6)
    assert len(settled.contact_time) == 0


def test_without_a_player_a_parabola_is_one_flight():
    times = np.arange(30) / 25.0
    start = np.array([0.0, -11.0, 1.0]), np.array([1.0, 20.0, 7.0])
    position, velocity = flown(np.tile(start[0], (30, 1)), np.tile(start[1], (30, 1)), times, DRAG)
    settled = settled_ball(noisy(path(position, velocity), 0.2, 2.0), TENNIS)
    assert len(settled.contact_time) == 0
    assert np.linalg.norm(settled.position - position, axis=1).max() < 0.3


def test_a_ball_at_rest_lies_on_the_ground():
    lying = np.tile([2.0, 3.0, RADIUS], (25, 1))
    settled = settled_ball(noisy(path(lying, np.zeros((25, 3))), 0.02, 0.1), TENNIS)
    assert (settled.status == "ground").all()
    np.testing.assert_allclose(settled.position, lying, atol=0.03)


def test_a_held_ball_is_left_in_the_hand_until_it_is_hit():
    truth, _ = rally()
    times = np.arange(30) / 25.0
    sway = np.column_stack([0.1 * np.sin(9 * times), 0.1 * np.cos(9 * times) - 0.1, 0.1 * np.sin(13 * times)])
    hand = truth.position[0] + sway
    ball = path(
        np.concatenate([hand, truth.position]),
        np.concatenate([np.gradient(hand, times, axis=0), truth.velocity]),
        roots=np.concatenate([np.repeat(truth.roots[:1], 30, axis=0), truth.roots]),
    )
    settled = settled_ball(ball, TENNIS)
    assert (settled.status[:30] == "held").mean() > 0.9
    assert (settled.status[31:] == "flight").all()
    assert settled.contact_kind.tolist() == ["held", "bounce", "hit", "bounce"]


def test_a_thousand_frames_are_settled():
    truth, events = rally()
    count = len(truth.times)
    repeats = -(-1000 // count)
    whole = path(
        np.tile(truth.position, (repeats, 1))[:1000],
        np.tile(truth.velocity, (repeats, 1))[:1000],
        roots=np.tile(truth.roots, (repeats, 1, 1))[:1000],
    )
    settled = settled_ball(noisy(whole, 0.05, 0.5), TENNIS, SettleBallOptions(rounds=2, steps=3))
    assert np.isfinite(settled.position).all()
    found = [kind for kind in settled.contact_kind if kind == "bounce"]
    assert abs(len(found) - 1000 // count * BOUNCES) <= BOUNCES
    assert len(events) == BOUNCES + 1


def test_what_is_no_number_is_refused():
    truth, _ = rally(seconds=0.4)
    position = truth.position.copy()
    position[3, 1] = np.nan
    with pytest.raises(ValueError, match="position: expected finite numbers, got NaN or infinity in frame 3"):
        replace(truth, position=position)
    with pytest.raises(ValueError, match="ascending"):
        replace(truth, times=truth.times[::-1].copy())
    with pytest.raises(ValueError, match="SettleBallOptions.rounds"):
        SettleBallOptions(rounds=0)


def test_a_scene_without_a_ball_is_refused():
    with pytest.raises(ValueError, match="ball"):
        settled_ball(rally(seconds=0.4)[0], load_scene("blocks"))
