from dataclasses import replace

import numpy as np
import pytest

from pgm_data.ball import BallTrack, no_events
from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.flight_model import air_law, flown
from pgm_data.lift.ball.physics_solve import PhysicsOptions, physics_preset, solve_physics
from pgm_data.lift.ball.solution import BallSolution, PlayersAt
from pgm_data.lift.ball.world import BallWorld, ball_world
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from pgm_data.scene import Prior, load_scene
from tests.lift.ball.flown_worlds import WORLD, Seen, course, looking, seen
from tests.lift.ball.line_worlds import events_of, track_of

STANDARD = physics_preset("standard")


def solve(
    case: Seen,
    *,
    world: BallWorld = WORLD,
    track: BallTrack | None = None,
    start: BallSolution | None = None,
    options: PhysicsOptions = STANDARD,
    players: PlayersAt | None = None,
) -> BallSolution:
    return solve_physics(
        case.track if track is None else track,
        case.events,
        case.camera,
        world=world,
        doubt=no_doubt(),
        players=players,
        options=options,
        start=start,
    )


def one(seed: int, kind: str = "forehand", fps: float = 25.0, **how) -> Seen:
    rng = np.random.default_rng(seed)
    return seen(rng, course(rng, [kind]), fps, **{"marks": True, **how})


@pytest.fixture(scope="module")
def rally() -> Seen:
    rng = np.random.default_rng(11)
    return seen(rng, course(rng, ["serve", "forehand", "forehand", "forehand"]), 25.0, marks=False)


@pytest.fixture(scope="module")
def solved(rally: Seen) -> BallSolution:
    return solve(rally)


def placed(solution: BallSolution) -> np.ndarray:
    return np.asarray(solution.status != "none", dtype=bool)


@pytest.mark.parametrize(("kind", "bar"), [("serve", 0.20), ("forehand", 0.15), ("lob", 0.15)])
def test_marked_shots_are_placed_to_centimetres_and_know_it(kind, bar):
    errors, scaled = [], []
    for seed in range(4):
        case = one(seed, kind, 25.0 if seed % 2 else 50.0)
        solution = solve(case)
        assert set(solution.flights.status) == {"solved"}
        errors.append(case.error(solution.position))
        std = np.sqrt(np.diagonal(solution.position_cov, axis1=1, axis2=2))
        scaled.append(((solution.position - case.position) / std)[placed(solution) & np.isfinite(case.position[:, 0])])
    assert np.median(errors) < bar
    # One sigma covers 68 per cent; frames of a shot are off together, so few shots say this loosely.
    assert 0.4 < (np.abs(np.concatenate(scaled)) < 1).mean() < 0.95


def test_an_unmarked_rally_is_placed_whole(rally, solved):
    assert set(solved.flights.status) == {"solved"}
    assert rally.error(solved.position) < 0.35
    assert rally.track.measured[np.asarray(solved.status == "measured", dtype=bool)].all()
    # Each frame between first and last contact, as solved, has a ball; none has one outside.
    times = rally.track.times
    inside = (times >= solved.events.times[0]) & (times <= solved.events.times[-1])
    assert (placed(solved) == inside).all()


def test_contact_times_come_finer_than_frames(rally, solved):
    bounces = rally.events.kinds == "bounce"
    given = np.abs(rally.events.times - rally.contacts)[bounces]
    found = np.abs(solved.events.times - rally.contacts)[bounces]
    assert np.median(found) < 0.5 * np.median(given)
    assert (np.diff(solved.events.times) >= 0).all()


def test_bounces_lie_on_the_ground_and_landings_are_theirs(rally, solved):
    bounces = np.flatnonzero(rally.events.kinds == "bounce")
    assert np.allclose(solved.event_position[bounces, 2], WORLD.radius_m, atol=1e-3)
    before = np.flatnonzero(np.isin(solved.flights.end_event, bounces))
    assert np.allclose(solved.flights.landing[before], solved.event_position[bounces], atol=1e-6)
    after = solved.flights.landing[before + 1]
    assert np.allclose(after[np.isfinite(after[:, 0]), 2], WORLD.radius_m, atol=1e-3)


def test_spin_is_told_where_it_was_free_and_has_the_sign_of_the_truth(rally, solved):
    for i, words in enumerate(solved.flights.free):
        assert ("spin" in words) == bool(np.isfinite(solved.flights.spin[i]).all())
        assert np.isfinite(solved.flights.spin_std[i]).all()
        if "spin" in words:
            off = np.abs(solved.flights.spin[i] - rally.spins[i]) / solved.flights.spin_std[i]
            assert off.max() < 4.5


def test_constants_come_with_their_posterior(solved):
    assert solved.drag.std < WORLD.drag_per_m.std
    assert solved.restitution is not None and solved.friction is not None
    assert WORLD.restitution is not None
    assert solved.restitution.std < WORLD.restitution.std


def test_a_spin_that_no_data_support_is_held_and_not_told():
    # A few coarse pixels of a short flight in the air say nothing of its spin.
    case = one(3)
    keep = np.flatnonzero(case.track.measured)[:5]
    pixels = np.full_like(case.track.pixels, np.nan)
    pixels[keep] = case.track.pixels[keep]
    end = case.track.times[keep[-1]]
    events = events_of(np.array([case.track.times[keep[0]], end]), ["first", "last"], 0.0)
    solution = solve(replace(case, track=track_of(case.track.times, pixels, 4.0), events=events))
    assert solution.flights.status == ("solved",)
    assert "spin" not in solution.flights.free[0] and np.isnan(solution.flights.spin).all()
    assert np.allclose(solution.flights.spin_std, WORLD.spin_std, rtol=0.1)
    assert "drag" not in solution.flights.free[0] and solution.flights.drag_per_m[0] == WORLD.drag_per_m.mean


def test_repeated_pictures_change_nothing():
    case = one(5)
    rows = np.sort(np.concatenate([np.arange(len(case.track.times)), np.arange(4, len(case.track.times), 5)]))
    again = np.append(False, np.diff(rows) == 0)
    track = BallTrack(
        times=case.track.times[rows],
        is_duplicate=again,
        pixels=case.track.pixels[rows],
        sigma_px=case.track.sigma_px[rows],
        score=case.track.score[rows],
        streak_px=case.track.streak_px[rows],
    )
    plain = solve(case)
    twice = solve(replace(case, track=track, camera=case.camera[rows]))
    assert np.allclose(twice.position, plain.position[rows], atol=1e-9, equal_nan=True)
    assert set(twice.status[again]) <= {"filled", "none"}


def test_without_measurements_nothing_is_placed():
    case = one(1)
    empty = track_of(case.track.times, np.full_like(case.track.pixels, np.nan))
    repeats = replace(case.track, is_duplicate=np.ones(len(case.track.times), dtype=bool))
    blind = Camera(
        K=np.full_like(case.camera.K, np.nan),
        distortion=np.full_like(case.camera.distortion, np.nan),
        R_cam_from_world=np.full_like(case.camera.R_cam_from_world, np.nan),
        t_cam_from_world=np.full_like(case.camera.t_cam_from_world, np.nan),
    )
    for changed in (replace(case, track=empty), replace(case, track=repeats), replace(case, camera=blind)):
        solution = solve(changed)
        assert not placed(solution).any()
        assert set(solution.flights.status) == {"none"} and all(solution.flights.said)
        assert solution.drag.mean == WORLD.drag_per_m.mean and solution.drag.std == WORLD.drag_per_m.std
    assert len(solve(replace(case, events=no_events())).flights) == 0


def test_frames_without_a_camera_are_no_measurement():
    case = one(1)
    gone = np.zeros(len(case.track.times), dtype=bool)
    gone[8:12] = True
    holed = Camera(
        K=np.where(gone[:, None, None], np.nan, case.camera.K),
        distortion=np.where(gone[:, None], np.nan, case.camera.distortion),
        R_cam_from_world=np.where(gone[:, None, None], np.nan, case.camera.R_cam_from_world),
        t_cam_from_world=np.where(gone[:, None], np.nan, case.camera.t_cam_from_world),
    )
    solution = solve(replace(case, camera=holed))
    assert (solution.status[gone] == "filled").all()
    assert case.error(solution.position) < 0.5


def test_a_ball_behind_the_camera_is_not_placed():
    case = one(2)
    away = looking(np.array([0.0, -40.0, 10.0]), np.array([0.0, -90.0, 0.0]), 2500.0, len(case.track.times))
    solution = solve(replace(case, camera=away))
    # Wherever a ball is placed it lies before the camera and on its pixels.
    rows = np.flatnonzero(placed(solution))
    if len(rows):
        assert (solution.position[rows, 1] < -40).all()
    assert set(solution.flights.status) == {"none"}


def test_single_precision_gives_the_same_ball():
    case = one(4)
    track = replace(
        case.track,
        pixels=case.track.pixels.astype(np.float32),
        sigma_px=case.track.sigma_px.astype(np.float32),
        times=case.track.times.astype(np.float32),
    )
    # Times lose some hundred nanoseconds, at 30 m/s a few micrometres.
    assert np.allclose(solve(case, track=track).position, solve(case).position, atol=2e-3, equal_nan=True)


@pytest.mark.parametrize("fps", [10.0, 240.0])
def test_slow_and_fast_cameras_place_the_ball(fps):
    case = one(7, fps=fps)
    solution = solve(case)
    assert set(solution.flights.status) == {"solved"}
    assert case.error(solution.position) < 0.4


def test_false_detections_drop_out():
    case = one(8)
    rng = np.random.default_rng(0)
    pixels = case.track.pixels.copy()
    wrong = rng.choice(np.flatnonzero(case.track.measured), 4, replace=False)
    pixels[wrong] += rng.choice([-1, 1], size=(4, 2)) * rng.uniform(40, 200, size=(4, 2))
    solution = solve(replace(case, track=track_of(case.track.times, pixels)))
    assert case.error(solution.position) < 0.3
    assert (solution.status[wrong] == "filled").all()


def test_a_spoilt_shot_falls_back_and_its_neighbours_stay(rally):
    # The third shot's pixels are those of a bird.
    hits = np.flatnonzero(rally.events.kinds == "hit")
    first, last = rally.events.times[hits[2]], rally.events.times[hits[3]]
    bad = (rally.track.times > first) & (rally.track.times < last)
    pixels = rally.track.pixels.copy()
    phase = np.arange(bad.sum())
    pixels[bad] = np.stack([960 + 700 * np.sin(1.3 * phase), 540 + 400 * np.cos(0.9 * phase)], axis=1)
    spoilt = replace(rally, track=track_of(rally.track.times, pixels))
    alone = solve(spoilt)
    flights = np.arange(len(alone.flights))
    own = (flights >= 4) & (flights < 6)
    status = np.array(alone.flights.status)
    # The rally before and after it may pin the shot, or it is left out: but nobody is told that its own pixels did.
    assert set(status[own]) <= {"fallback", "none"}
    assert all("left out" in said or "failed" in said for said in np.array(alone.flights.said)[own])
    assert (status[~own] == "solved").all()
    assert not np.isin("measured", alone.status[bad][3:-3])
    assert rally.error(alone.position) < 0.6


def test_a_shot_that_cannot_be_solved_is_left_to_the_line_method():
    # Off its pixels and with no neighbour to lean on.
    case = one(9, noise_px=0.5)
    rng = np.random.default_rng(2)
    pixels = np.where(
        np.isfinite(case.track.pixels), rng.uniform([0, 0], [1920, 1080], case.track.pixels.shape), np.nan
    )
    noise = replace(case, track=track_of(case.track.times, pixels))
    alone = solve(noise)
    assert set(alone.flights.status) == {"none"} and "failed" in alone.flights.said[0]
    assert not placed(alone).any()
    # With a line solution at hand (here: any other one) the gap is filled and says so.
    other = solve(case)
    helped = solve(noise, start=other)
    assert set(helped.flights.status) == {"line"} and "failed" in helped.flights.said[0]
    assert np.allclose(helped.position[placed(helped)], other.position[placed(helped)])
    assert placed(helped).sum() > 10


def test_an_overhead_serve_is_told_from_a_low_hit():
    for kind, high in (("serve", True), ("forehand", False)):
        rng = np.random.default_rng(21)
        case = seen(rng, course(rng, [kind, "forehand"]), 50.0, marks=False)
        solution = solve(case)
        assert (solution.event_position[0, 2] > 2.0) == high


def test_players_hands_place_the_hits():
    rng = np.random.default_rng(31)
    path = course(rng, ["forehand"])
    case = seen(rng, path, 25.0, marks=False)
    frames = len(case.track.times)
    hands = np.full((frames, 2, 2, 3), np.nan)
    for player, contact in ((0, path.contacts[0]), (1, path.contacts[-1])):
        hands[:, player, 0] = contact.position + np.array([0.3, 0.0, -0.2])
        hands[:, player, 1] = contact.position + np.array([-0.9, 0.3, -0.1])
    players = PlayersAt(names=("player0", "player1"), root_position=hands[:, :, 0], hands=hands)
    without, given = solve(case), solve(case, players=players)
    at = [0, -1]
    off = np.linalg.norm(given.event_position[at] - [path.contacts[0].position, path.contacts[-1].position], axis=1)
    assert off.max() < 1.0
    assert (
        np.trace(given.event_cov[at], axis1=1, axis2=2).sum() < np.trace(without.event_cov[at], axis1=1, axis2=2).sum()
    )


def synthetic(world: BallWorld, start: np.ndarray, camera_at: np.ndarray, focal: float, kinds: list[str]) -> Seen:
    """A flight without spin by the solver's own law, 1 px of noise."""
    states = [start]
    while states[-1][2] > world.radius_m and len(states) < 400:
        now = states[-1]
        states.append(flown(now, np.zeros(3), np.array(world.drag_per_m.mean), np.array(0.04), air_law(world), 16))
    position = np.array(states[:-1])[:, :3]
    times = 0.04 * np.arange(len(position))
    middle = (position.min(axis=0) + position.max(axis=0)) / 2
    camera = looking(camera_at, middle, focal, len(times))
    pixels = project(camera, position[:, None])[0][:, 0] + np.random.default_rng(0).normal(size=(len(times), 2))
    events = events_of(times[[0, -1]], kinds, 0.01)
    return Seen(
        track=track_of(times, pixels),
        events=events,
        camera=camera,
        position=position,
        contacts=times[[0, -1]],
        spins=(np.zeros(3),),
    )


def test_without_drag_a_parabola_comes_back():
    world = replace(WORLD, drag_per_m=Prior(mean=0.0, std=1e-6), lift_per_m=0.0, spin_std=0.0)
    case = synthetic(
        world, np.array([0.0, -8.0, 1.0, 1.0, 12.0, 9.0]), np.array([0.0, -35.0, 9.0]), 1800.0, ["first", "last"]
    )
    solution = solve(case, world=world)
    assert case.error(solution.position) < 0.15
    assert solution.drag.mean == pytest.approx(0.0, abs=1e-5)
    assert solution.flights.status == ("solved",)


def test_a_lob_that_stays_up_for_long_and_never_bounces():
    start = np.array([1.0, -10.0, 1.0, 1.0, 3.0, 60.0])
    case = synthetic(WORLD, start, np.array([0.0, -90.0, 12.0]), 900.0, ["first", "last"])
    assert case.track.times[-1] > 6
    solution = solve(case)
    assert solution.flights.status == ("solved",)
    assert case.error(solution.position) < 1.0
    assert solution.restitution is None


def test_a_flight_beyond_any_ball_is_refused():
    # Thirty seconds in the air take a ball a kilometre up, where no court's ball goes.
    times = np.arange(0, 30, 0.2)
    position = np.stack([0.1 * times, 0.2 * times, 1 + 147 * times - 4.905 * times**2], axis=1)
    camera = looking(np.array([0.0, -900.0, 300.0]), np.array([0.0, 0.0, 500.0]), 700.0, len(times))
    pixels = project(camera, position[:, None])[0][:, 0]
    events = events_of(times[[0, -1]], ["first", "last"], 0.01)
    solution = solve_physics(
        track_of(times, pixels),
        events,
        camera,
        world=WORLD,
        doubt=no_doubt(),
        players=None,
        options=STANDARD,
    )
    assert solution.flights.status == ("none",) and "implausible" in solution.flights.said[0]


def test_a_shuttle_flies_without_bounce_or_lift():
    world = ball_world(load_scene("badminton"))
    start = np.array([0.5, -5.0, 2.4, 1.0, 60.0, 12.0])
    case = synthetic(world, start, np.array([0.0, -16.0, 6.0]), 1400.0, ["hit", "bounce"])
    solution = solve(case, world=world)
    assert solution.flights.status == ("solved",)
    assert case.error(solution.position) < 0.3
    assert solution.restitution is None and solution.friction is None


def test_a_ball_without_lift_bounces_all_the_same():
    world = replace(WORLD, lift_per_m=0.0, spin_std=0.0)
    rng = np.random.default_rng(41)
    case = seen(rng, course(rng, ["lob"]), 25.0, marks=True)
    solution = solve(case, world=world)
    assert set(solution.flights.status) == {"solved"}
    assert not any("spin" in words for words in solution.flights.free)


def test_a_doubtful_camera_makes_doubtful_balls():
    case = one(6)
    plain = solve(case)
    doubt = CameraDoubt(position_cov=np.diag([0.01, 0.25, 0.04]), focal_std_share=0.008, pixel_std=0.5)
    doubted = solve_physics(
        case.track, case.events, case.camera, world=WORLD, doubt=doubt, players=None, options=STANDARD
    )
    rows = placed(plain)
    grown = np.trace(doubted.position_cov[rows], axis1=1, axis2=2) / np.trace(
        plain.position_cov[rows], axis1=1, axis2=2
    )
    assert np.median(grown) > 1.02


def test_presets_differ_and_a_wrong_one_is_told():
    assert physics_preset("draft").rounds < STANDARD.rounds < physics_preset("best").rounds
    with pytest.raises(ValueError, match="expected one of draft, standard, best, got 'fast'"):
        physics_preset("fast")
    case = one(1)
    for name in ("draft", "best"):
        assert case.error(solve(case, options=physics_preset(name)).position) < 0.4


def test_a_camera_for_other_frames_is_refused():
    case = one(1)
    with pytest.raises(ValueError, match="expected one a frame"):
        solve(replace(case, camera=case.camera[:-1]))
