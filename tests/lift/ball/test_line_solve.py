from dataclasses import replace

import numpy as np
import pytest

from pgm_data.ball import BallTrack, no_events
from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.line_solve import LineOptions, solve_line
from pgm_data.lift.ball.solution import BallSolution, PlayersAt
from pgm_data.lift.ball.world import ball_world
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from pgm_data.scene import Prior, load_scene
from pgm_data.simulate.flight.aim import aim
from pgm_data.simulate.flight.air import Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.path import BallPath, Contact
from tests.lift.ball.line_worlds import KINDS, WORLD, Shot, events_of, look_at, shot, track_of


def solved(one: Shot, **changes) -> BallSolution:
    options = changes.pop("options", LineOptions())
    asked = {"track": one.track, "events": one.events, "camera": one.camera, "players": None, "doubt": no_doubt()}
    asked |= {"world": WORLD} | changes
    track, events, camera = asked.pop("track"), asked.pop("events"), asked.pop("camera")
    return solve_line(track, events, camera, options=options, **asked)


def rms(one: Shot, solution: BallSolution) -> float:
    off = np.linalg.norm(solution.position - one.position, axis=1)
    return float(np.sqrt(np.nanmean(off**2)))


def with_pixels(track: BallTrack, keep: np.ndarray) -> BallTrack:
    rows = keep[:, None]
    known = {name: np.where(keep, getattr(track, name), np.nan) for name in ("sigma_px", "score")}
    return replace(track, pixels=np.where(rows, track.pixels, np.nan), **known)


def placed(solution: BallSolution) -> np.ndarray:
    return np.asarray(solution.status != "none", dtype=bool)


BARS_CM = {"serve": 22.0, "forehand near": 16.0, "forehand far": 15.0, "slice": 16.0, "lob": 35.0}


@pytest.mark.parametrize("kind", KINDS)
def test_marked_shots_come_out_within_their_bar_and_their_errors_are_true(kind):
    rng = np.random.default_rng([7, KINDS.index(kind)])
    errors, scaled = [], []
    for i in range(6):
        one = shot(kind, rng, fps=25.0 if i % 2 else 50.0)
        solution = solved(one)
        errors.append(rms(one, solution))
        off = solution.position - one.position
        sigma = np.sqrt(np.einsum("nii->ni", solution.position_cov))
        scaled.append((off / sigma)[np.isfinite(off).all(axis=1)])
        # The outermost frames may lie beyond a contact whose time came in 10 ms off.
        assert placed(solution)[np.flatnonzero(np.isfinite(one.position).all(axis=1))[1:-1]].all()
    assert 100 * np.median(errors) < BARS_CM[kind]
    inside = (np.abs(np.concatenate(scaled)) < 1).mean(axis=0)
    assert (inside > 0.5).all() and (inside < 0.97).all()


def test_the_ratio_of_speeds_mends_lobs():
    rng = np.random.default_rng(3)
    lobs = [shot("lob", rng) for _ in range(4)]
    paper, mended = (
        np.median([rms(one, solved(one, options=LineOptions(passes=passes))) for one in lobs]) for passes in (0, 2)
    )
    assert mended < 0.12 < 0.25 < paper


def test_what_is_measured_lies_on_its_ray_and_what_is_not_is_filled():
    one = shot("forehand near", np.random.default_rng(4))
    solution = solved(one)
    measured = np.asarray(solution.status == "measured", dtype=bool)
    np.testing.assert_array_equal(measured, placed(solution) & one.track.measured)
    assert (solution.status == "filled").sum() >= 3
    pixels = project(one.camera, np.nan_to_num(solution.position)[:, None])[0][:, 0]
    np.testing.assert_allclose(pixels[measured], one.track.pixels[measured], atol=1e-6)
    filled = np.asarray(solution.status == "filled", dtype=bool)
    assert np.linalg.norm(solution.position - one.position, axis=1)[filled].max() < 0.6


def test_what_is_not_the_ball_is_not_believed():
    rng = np.random.default_rng(14)
    one = shot("forehand near", rng)
    wrong = rng.choice(np.flatnonzero(one.track.measured)[2:-2], 3, replace=False)
    pixels = one.track.pixels.copy()
    pixels[wrong] += [60.0, -45.0]
    solution = solved(one, track=replace(one.track, pixels=pixels))
    assert (solution.status[wrong] == "filled").all()
    assert rms(one, solution) < 0.3


def test_a_bounce_is_on_the_ground_and_its_time_is_finer_than_a_frame():
    rng = np.random.default_rng(5)
    before, after = [], []
    for _ in range(8):
        one = shot("serve", rng)
        late = replace(one.events, times=one.events.times + [0.0, 0.02, 0.0], time_std=np.array([0.01, 0.02, 0.01]))
        solution = solved(one, events=late)
        assert solution.event_position[1, 2] == pytest.approx(WORLD.radius_m, abs=0.02)
        bounce = one.times[1]
        before.append(late.times[1] - bounce)
        after.append(solution.events.times[1] - bounce)
    assert np.std(after) < 0.006 and abs(np.mean(after)) < 0.25 * np.mean(before)


def test_without_marks_gravity_places_the_hits():
    """A hit's height is known to half a metre, which alone leaves two metres of depth."""
    rng = np.random.default_rng(6)
    errors = [rms(one, solved(one)) for one in (shot("forehand near", rng, marked=False) for _ in range(5))]
    assert np.median(errors) < 0.6


def test_a_serve_is_told_from_a_ball_hit_at_the_usual_height():
    rng = np.random.default_rng(8)
    for kind, low, high in (("serve", 2.1, 3.4), ("forehand near", 0.2, 1.9)):
        heights = [solved(shot(kind, rng, marked=False)).event_position[0, 2] for _ in range(3)]
        assert low < np.median(heights) < high


def test_wrists_near_the_hit_place_it():
    rng = np.random.default_rng(9)
    errors = {True: [], False: []}
    for _ in range(4):
        one = shot("forehand far", rng, marked=False)
        count = len(one.track.times)
        hands = np.tile(one.contacts[[0, 2]] + 0.3 * rng.normal(size=(2, 3)), (count, 1, 1))[:, :, None]
        players = PlayersAt(names=("player0", "player1"), root_position=hands[:, :, 0] * [1, 1, 0.8], hands=hands)
        for known in (True, False):
            errors[known].append(rms(one, solved(one, players=players if known else None)))
    assert np.median(errors[True]) < np.median(errors[False])


def test_a_doubtful_camera_widens_the_errors_by_what_it_moves_them():
    rng = np.random.default_rng(10)
    one = shot("forehand near", rng)
    doubt = CameraDoubt(position_cov=np.diag([0.05, 0.6, 0.1]) ** 2, focal_std_share=0.02, pixel_std=0.0)
    sure, unsure = solved(one), solved(one, doubt=doubt)
    np.testing.assert_allclose(unsure.position, sure.position, atol=1e-9, equal_nan=True)
    ok = placed(sure)
    assert (unsure.position_cov[ok, 1, 1] > sure.position_cov[ok, 1, 1]).all()


def test_the_flights_say_how_they_start_and_where_they_land():
    one = shot("forehand near", np.random.default_rng(11))
    solution = solved(one)
    flights = solution.flights
    assert flights.status == ("solved", "solved") and len(flights) == 2
    assert np.linalg.norm(flights.start_velocity[0] - one.start_velocity) < 2.0
    np.testing.assert_allclose(flights.landing[0], solution.event_position[1], atol=1e-9)
    # The second flight's landing is the second bounce, flown on from the next contact.
    assert np.linalg.norm(flights.landing[1] - one.second_bounce) < 1.5
    assert np.isfinite(flights.landing_cov).all() and np.isnan(flights.spin).all()
    assert (flights.residual_px < 2.5).all()
    assert (solution.drag.mean, solution.drag.std) == (WORLD.drag_per_m.mean, WORLD.drag_per_m.std)
    other = solved(one, options=LineOptions(drag=Prior(mean=0.022, std=0.0004)))
    assert other.drag.mean == 0.022 and (other.flights.drag_per_m == 0.022).all()


def test_a_flight_without_a_bounce_is_flown_directly():
    one = shot("forehand near", np.random.default_rng(12))
    volley = one.until(one.times[1] - 0.15)
    solution = solved(volley)
    assert solution.flights.status == ("solved",)
    assert rms(volley, solution) < 1.0
    assert np.isfinite(solution.flights.landing[0]).all()
    assert np.linalg.norm(solution.flights.landing[0] - one.contacts[1]) < 1.5


def test_marks_of_first_and_last_count_for_the_hit_that_stands_there():
    one = shot("forehand near", np.random.default_rng(13))
    e = one.events
    marks = np.stack([e.ground_px[0], *np.full((3, 2), np.nan), e.ground_px[2]])
    both = events_of(e.times[[0, 0, 1, 2, 2]], ["first", "hit", "bounce", "hit", "last"], 0.01, marks)
    solution = solved(one, events=both)
    plain = solved(one)
    np.testing.assert_allclose(solution.position, plain.position, atol=1e-6)
    assert solution.flights.start_event.tolist() == [1, 2] and solution.flights.end_event.tolist() == [2, 3]
    assert solution.events.times[0] == solution.events.times[1]


# Extremes: a right answer or a clear none.


def nothing(solution: BallSolution, *words: str) -> None:
    assert not placed(solution).any() and np.isnan(solution.position).all()
    for word in words:
        assert any(word in said for said in (*solution.flights.said, solution.said)), solution.flights.said


ONE = shot("forehand near", np.random.default_rng(20))


def test_no_event_bounds_no_flight():
    nothing(solved(ONE, events=no_events()), "no two contacts")
    nothing(solved(ONE, events=ONE.events.take(np.array([1]))), "no two contacts")


def test_a_ball_never_seen_or_only_in_repeats_is_none():
    unseen = with_pixels(ONE.track, np.zeros(len(ONE.track.times), dtype=bool))
    nothing(solved(ONE, track=unseen), "no pixel near a bounce")
    repeats = replace(ONE.track, is_duplicate=np.ones(len(ONE.track.times), dtype=bool))
    nothing(solved(ONE, track=repeats), "no pixel near a bounce")


def test_no_camera_at_all_is_none_and_frames_without_one_are_filled():
    blank = Camera(**{name: np.full_like(getattr(ONE.camera, name), np.nan) for name in Camera.__dataclass_fields__})
    nothing(solved(ONE, camera=blank), "no pixel near")
    gone = np.zeros(len(ONE.track.times), dtype=bool)
    gone[8:12] = True
    parts = {}
    for name in Camera.__dataclass_fields__:
        parts[name] = getattr(ONE.camera, name).copy()
        parts[name][gone] = np.nan
    solution = solved(ONE, camera=Camera(**parts))
    assert (solution.status[gone] == "filled").all() and rms(ONE, solution) < 0.4


@pytest.mark.parametrize("frames", (1, 2, 3))
def test_a_few_frames_raise_nothing(frames):
    cut = ONE.frames(np.arange(frames))
    solution = solved(cut)
    assert len(solution.position) == frames
    nothing(solution)


def test_a_bounce_off_the_ground_is_none_and_says_so():
    """A ball in mid-air taken for one that bounces: its ray meets the ground far behind the court."""
    high = shot("lob", np.random.default_rng(21))
    apex = high.events.times.copy()
    apex[1] = 0.5 * (apex[0] + high.events.times[1])
    solution = solved(high, events=replace(high.events, times=apex))
    nothing(solution, "the ground")
    assert solution.flights.status == ("none", "none")


def test_a_camera_at_the_height_of_the_ball_looks_along_the_ground():
    """Rays are level: a bounce cannot be met, a marked hit can."""
    count = len(ONE.track.times)
    low = look_at(np.array([0.0, -30.0, 1.0]), np.array([0.0, 0.0, 1.0]), 30.0, count)
    pixels = project(low, np.nan_to_num(ONE.position)[:, None])[0][:, 0]
    flat = replace(ONE.track, pixels=np.where(ONE.track.measured[:, None], pixels, np.nan))
    level = replace(flat, pixels=np.where(ONE.track.measured[:, None], pixels * [1, 0] + [0, 539.5], np.nan))
    unmarked = replace(ONE.events, ground_px=np.full((3, 2), np.nan))
    nothing(solved(ONE, camera=low, track=level, events=unmarked), "bounce")
    solution = solved(ONE, camera=low, track=flat, events=unmarked)
    assert np.isfinite(solution.position[placed(solution)]).all()


def test_a_ball_behind_the_camera_is_none():
    """The camera looks away from the court: no pixel's ray meets the ground of it."""
    count = len(ONE.track.times)
    away = look_at(np.array([0.0, 30.0, 9.0]), np.array([0.0, 60.0, 0.0]), 40.0, count)
    nothing(solved(ONE, camera=away, events=replace(ONE.events, ground_px=np.full((3, 2), np.nan))), "bounce")


@pytest.mark.parametrize("fps", (10.0, 240.0))
def test_slow_and_fast_cameras_do(fps):
    one = shot("slice", np.random.default_rng(22), fps=fps)
    assert rms(one, solved(one)) < 0.35


def test_half_of_the_frames_are_repeats():
    one = shot("slice", np.random.default_rng(23), fps=50.0)
    repeat = np.arange(len(one.track.times)) % 2 == 1
    times = np.where(repeat, np.roll(one.track.times, 1), one.track.times)
    truth = np.where(repeat[:, None], np.roll(one.position, 1, axis=0), one.position)
    solution = solved(one, track=replace(one.track, times=times, is_duplicate=repeat))
    assert not (solution.status[repeat] == "measured").any()
    off = np.linalg.norm(solution.position - truth, axis=1)
    assert np.sqrt(np.nanmean(off**2)) < 0.35


def test_a_lob_of_many_seconds_and_a_ball_that_never_bounces():
    lob = shot("lob", np.random.default_rng(24), faster=10.0)
    assert lob.times[1] > 4
    assert rms(lob, solved(lob)) < 0.4
    volley = lob.until(lob.times[1] - 0.4)
    assert rms(volley, solved(volley)) < 0.8


def test_contacts_half_a_minute_apart_with_nothing_seen_between_are_none_or_honest():
    times = np.append(ONE.track.times[:3], ONE.track.times[3:] + 30.0)
    events = replace(ONE.events, times=np.where(ONE.events.times > ONE.track.times[2], ONE.events.times + 30, 0.0))
    solution = solved(ONE, track=replace(ONE.track, times=times), events=events)
    ok = placed(solution)
    sigma = np.sqrt(np.einsum("nii->ni", solution.position_cov[ok]))
    assert np.isfinite(solution.position[ok]).all() and (sigma > 0).all()


@pytest.mark.parametrize("drag", (0.0, 1e-12, 1e-6, 0.02, 0.2))
def test_any_drag_flies_as_its_equation_of_motion(drag):
    """Without lift, and pixels without noise: the solver finds the flight of a slow sure integration again."""
    air = replace(WORLD, drag_per_m=Prior(mean=drag, std=0.0), lift_per_m=0.0, restitution=None, friction=None)
    fine, fps = 2000, 25
    state, way = np.array([0.0, -11.0, 1.0, 2.0, 24.0, 7.5]), []
    for _ in range(fine):
        way.append(state[:3])
        middle = state[3:] - 0.5 / fine * (drag * np.linalg.norm(state[3:]) * state[3:] + [0, 0, 9.81])
        state = state + np.append(middle, -drag * np.linalg.norm(middle) * middle - [0, 0, 9.81]) / fine
    truth = np.array(way)[:: fine // fps]
    times = np.arange(len(truth)) / fps
    camera = look_at(np.array([0.0, -35.0, 10.0]), np.zeros(3), 50.0, len(times))
    pixels, ground = (project(camera, points[:, None])[0][:, 0] for points in (truth, truth * [1, 1, 0]))
    events = events_of(times[[0, -1]], ["hit", "last"], 0.002, ground[[0, -1]])
    solution = solved(ONE, track=track_of(times, pixels, 0.05), events=events, camera=camera, world=air)
    assert np.linalg.norm(solution.position - truth, axis=1).max() < 0.02
    assert np.isfinite(solution.position_cov).all()


@pytest.mark.parametrize("seed", range(8))
def test_pixels_and_events_without_sense_raise_nothing_and_stay_finite(seed):
    rng = np.random.default_rng(seed)
    count, kinds = int(rng.integers(1, 80)), ["hit", "bounce", "net", "first", "last"]
    times = np.arange(count) / 25
    pixels = np.cumsum(rng.normal(size=(count, 2)) * rng.choice([1, 20, 200]), axis=0) + [960, 540]
    pixels[rng.random(count) < 0.3] = np.nan
    many = int(rng.integers(0, 8))
    when = np.sort(rng.uniform(-0.1, times[-1] + 0.1, many))
    marks = np.where(rng.random((many, 1)) < 0.4, rng.uniform(0, 1080, (many, 2)), np.nan)
    events = events_of(when, [str(rng.choice(kinds)) for _ in range(many)], 0.02, marks)
    camera = look_at(rng.normal(size=3) * [10, 30, 4] + [0, -20, 6], rng.normal(size=3), 40.0, count)
    doubt = CameraDoubt(position_cov=0.01 * np.eye(3), focal_std_share=0.01, pixel_std=0.3)
    solution = solved(ONE, track=track_of(times, pixels), events=events, camera=camera, doubt=doubt)
    ok = placed(solution)
    assert np.isfinite(solution.position_cov[ok]).all()
    assert len(solution.flights.said) == len(solution.flights)


def test_lengths_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="camera: expected one for each"):
        solved(ONE, camera=ONE.camera[:5])


def test_table_tennis_serves_bounce_on_the_table():
    scene = load_scene("tabletennis")
    assert scene.ball is not None
    table, rng = ball_world(scene), np.random.default_rng(30)
    world = FlightWorld(air=Air(), build=ball_build(scene.ball), surface=SURFACES["hard"], net=None)
    start = np.array([0.2, -1.5, 0.3])
    launch = aim(start, np.array([-0.3, 0.9]), 7.0, 100.0, 0.0, world)
    assert launch is not None
    flights, ends = follow(start, launch.velocity, launch.spin, 0.0, world, until=5.0)
    path = BallPath(flights=tuple(flights), contacts=(Contact(time=0.0, kind="hit", player=0, position=start), *ends))
    times = np.arange(0, ends[0].time + 0.2, 1 / 60)
    truth = path.at(times)[0]
    camera = look_at(np.array([0.0, -8.0, 2.5]), np.zeros(3), 30.0, len(times))
    pixels = project(camera, truth[:, None])[0][:, 0] + rng.normal(size=(len(times), 2))
    events = events_of(np.array([0.0, ends[0].time, times[-1]]), ["hit", "bounce", "last"], 0.01)
    solution = solved(ONE, track=track_of(times, pixels), events=events, camera=camera, world=table)
    assert np.sqrt(((solution.position - truth) ** 2).sum(axis=1).mean()) < 0.25
    beyond = replace(events, times=events.times + [0.0, 0.12, 0.0])
    off_table = solved(ONE, track=track_of(times, pixels), events=beyond, camera=camera, world=table)
    assert off_table.flights.status == ("none", "none") or np.abs(off_table.event_position[1, 1]) < 1.37 + 1.0
