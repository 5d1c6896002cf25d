"""Drawn shots and rallies are physical, depend on their seed alone, and are seen with the noise that is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_data.simulate.flight.laws import energy_gains
from pgm_data.stages.trade_ball_cases import BEHIND_M, CASE_KINDS, UP_M, BallCase, CaseOptions, draw_case
from pgm_data.stages.trade_ball_score import lands_in
from pgm_data.stages.trade_ball_shots import RALLY_SHOTS, draw_shot

TENNIS = load_scene("tennis")


def drawn(kind: str, number: int = 0, seed: int = 3, **options) -> BallCase:
    return draw_case(kind, number, seed, CaseOptions(**options), TENNIS)


def seen(case: BallCase) -> np.ndarray:
    """True pixels by the solver's own projection."""
    pixels, _ = project(case.camera, case.position[:, None])
    return pixels[:, 0]


@pytest.mark.parametrize("kind", ["serve", "lob", "rally"])
def test_a_case_depends_on_kind_number_and_seed_alone(kind):
    one, again = drawn(kind), drawn(kind)
    for name in ("times", "pixels", "sigma_px"):
        np.testing.assert_array_equal(getattr(one.track, name), getattr(again.track, name))
    np.testing.assert_array_equal(one.position, again.position)
    np.testing.assert_array_equal(one.events.ground_px, again.events.ground_px)
    assert not np.array_equal(one.path.shots[-1].velocity, drawn(kind, 1).path.shots[-1].velocity)
    assert not np.array_equal(one.path.shots[-1].velocity, drawn(kind, 0, 4).path.shots[-1].velocity)
    noisy = drawn(kind, noise_px=3.0, mark_px=6.0, marks=False)
    np.testing.assert_array_equal(one.position, noisy.position)
    np.testing.assert_array_equal(one.camera.K, noisy.camera.K)


@pytest.mark.parametrize("kind", CASE_KINDS)
def test_paths_lose_energy_stay_above_the_ground_and_clear_the_net(kind):
    for number in range(1 if kind == "rally" else 3):
        path = drawn(kind, number).path
        world = path.shots[-1].world
        assert energy_gains(path.path, world.build, world.air.gravity).max() < 1e-6
        places, _ = path.path.at(np.linspace(0.0, path.end_s, 3001))
        assert np.isfinite(places).all()
        assert places[:, 2].min() > world.build.radius_m - 1e-6
        crossings = np.flatnonzero(np.diff(np.sign(places[:, 1])) != 0)
        assert len(crossings) >= len([c for c in path.path.contacts if c.kind == "hit"]) - 1
        assert (places[crossings, 2] > 0.914).all()
        for contact in path.path.contacts:
            if contact.kind == "bounce":
                assert contact.position[2] == pytest.approx(world.build.radius_m, abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "slowest", "fastest", "high"),
    [
        ("serve", 130, 220, False),
        ("forehand_near", 90, 140, False),
        ("forehand_far", 90, 140, False),
        ("slice", 65, 95, False),
        ("lob", 60, 82, True),
    ],
)
def test_shots_are_of_their_kind_and_land_in_the_other_half(kind, slowest, fastest, high):
    for number in range(4):
        path = draw_shot(kind, np.random.default_rng([5, number]), TENNIS)
        (shot,) = path.shots
        assert slowest < 3.6 * np.linalg.norm(shot.velocity) < fastest
        assert [c.kind for c in path.path.contacts[:2]] == ["hit", "bounce"]
        assert np.sign(shot.landing[1]) != np.sign(shot.position[1])
        top = path.path.at(np.linspace(0.0, path.end_s, 500))[0][:, 2].max()
        assert (top > 6.0) == high
        if kind.startswith("forehand"):
            assert np.sign(shot.velocity[1]) == (1 if kind == "forehand_near" else -1)
        if kind == "slice":
            assert np.cross(shot.velocity, shot.spin)[2] < 0, "backspin lifts: spin x velocity points up"


def test_most_shots_land_in_and_some_do_not():
    court = TENNIS.court
    assert court is not None
    shots = [draw_shot("slice", np.random.default_rng([6, number]), TENNIS).shots[0] for number in range(60)]
    share = np.mean([lands_in(shot.landing, shot.position, court) for shot in shots])
    assert 0.6 < share < 0.95


def test_a_rally_runs_from_the_toss_over_four_to_ten_hits():
    for number in range(2):
        case = drawn("rally", number)
        kinds = list(case.contacts.kinds)
        assert kinds[0] == "first" and kinds[1] == "hit" and kinds[-1] == "last" and "net" not in kinds
        assert RALLY_SHOTS[0] <= kinds.count("hit") <= RALLY_SHOTS[1]
        assert len(case.path.shots) == kinds.count("hit") + 1
        assert np.isnan(case.events.ground_px).all() and case.mark_frames == ()
        begun = case.track.times[np.flatnonzero(case.scored)[0]]
        assert case.contacts.times[1] <= begun < case.contacts.times[1] + 1 / 25
        for before, after in zip(case.path.shots[:-1], case.path.shots[1:], strict=True):
            assert before.end_s == after.start_s


def test_the_track_is_the_projection_with_the_noise_that_is_asked_for():
    off, marks = [], []
    for kind in ("serve", "slice", "forehand_far"):
        for number in range(8):
            case = drawn(kind, number, noise_px=2.0, mark_px=4.0)
            measured = case.track.measured
            assert not measured[~case.inside].any()
            off.append((case.track.pixels - seen(case))[measured])
            ends = np.array(case.mark_frames)
            ground, _ = project(case.camera[ends], (case.position[ends] * [1, 1, 0])[:, None])
            marks.append(case.events.ground_px[[0, -1]] - ground[:, 0])
            np.testing.assert_allclose(case.events.times[[0, -1]], case.track.times[ends])
    errors, marked = np.concatenate(off), np.concatenate(marks)
    # Five standard errors of the standard deviation and of the mean.
    for values, sigma in ((errors, 2.0), (marked, 4.0)):
        count = values.size
        assert abs(values.std() / sigma - 1) < 5 / np.sqrt(2 * count)
        assert abs(values.mean()) < 5 * sigma / np.sqrt(count)


def test_missing_and_false_detections_come_in_their_shares():
    lost, wrong, frames = 0, 0, 0
    for number in range(30):
        case = drawn("slice", number, false_share=0.1)
        width, height = case.options.size
        pixels = seen(case)
        in_picture = (pixels > 0).all(axis=1) & (pixels[:, 0] < width - 1) & (pixels[:, 1] < height - 1)
        inside = case.inside & in_picture
        frames += int(inside.sum())
        lost += int((inside & ~case.track.measured & ~case.false).sum())
        wrong += int(case.false[inside].sum())
        assert (np.linalg.norm((case.track.pixels - pixels)[case.false], axis=1) > 6).any() or not case.false.any()
    assert 0.06 < wrong / frames < 0.14
    # 8 % by chance and 3 of about 42 in the burst, less those that something false fills.
    assert 0.09 < lost / frames < 0.19


def test_three_frames_in_a_row_are_missing_and_none_where_none_is_to_be():
    for number in range(6):
        gone = ~drawn("slice", number).track.measured[1:-1]
        assert (gone[:-2] & gone[1:-1] & gone[2:]).any()
    assert drawn("slice", missing=0.0).track.measured[1:-1].all()


def test_repeats_carry_their_source():
    case = drawn("slice", fps=30.0, repeats=True)
    repeat = np.flatnonzero(case.track.is_duplicate)
    assert len(repeat) and (np.diff(repeat) == 6).all()
    np.testing.assert_array_equal(case.track.times[repeat], case.track.times[repeat - 1])
    np.testing.assert_array_equal(case.track.pixels[repeat], case.track.pixels[repeat - 1])
    steps = np.diff(case.track.times[~case.track.is_duplicate])
    np.testing.assert_allclose(steps, 1 / 25.0)
    assert not case.scored[repeat].any()


@pytest.mark.parametrize("fps", [10.0, 25.0, 240.0])
def test_frames_cover_the_path_and_one_more_at_each_end(fps):
    case = drawn("serve", 2, fps=fps)
    inside = np.flatnonzero(case.inside)
    assert list(inside) == list(range(1, len(case.inside) - 1))
    np.testing.assert_allclose(np.diff(case.track.times), 1 / fps)
    path_times = case.track.times[inside] - case.start_s
    assert 0 <= path_times[0] < 1 / fps and 0 <= case.path.end_s - path_times[-1] < 1 / fps
    np.testing.assert_allclose(case.contacts.times[[0, -1]] - case.start_s, [0.0, case.path.end_s], atol=1e-12)


def test_people_tell_times_in_whole_frames_or_exactly():
    whole, exact = drawn("slice"), drawn("slice", event_times="fractional")
    assert np.isin(whole.events.times, whole.track.times).all()
    assert (np.abs(whole.events.times - whole.contacts.times) < 1 / 25).all()
    np.testing.assert_allclose(exact.events.times, exact.contacts.times)


def test_cameras_stand_where_broadcast_cameras_do_and_show_the_court():
    court = TENNIS.court
    assert court is not None
    turning = 0
    for number in range(12):
        case = drawn("forehand_far", number)
        x, y, z = case.camera.position_world[0]
        assert abs(x) <= 1.5 and BEHIND_M[0] <= -11.835 - y <= BEHIND_M[1] and UP_M[0] <= z <= UP_M[1]
        width = case.options.size[0]
        assert 21 < 2 * np.degrees(np.arctan(0.5 * width / case.camera.K[0, 0, 0])) < 47
        turning += int(not np.allclose(case.camera.R_cam_from_world, case.camera.R_cam_from_world[:1]))
        if np.allclose(case.camera.R_cam_from_world, case.camera.R_cam_from_world[:1]):
            pixels, shown = project(case.camera[0], court.points_world)
            assert shown.all() and (pixels > -0.5).all() and (pixels < np.array(case.options.size) - 0.5).all()
    assert 0 < turning < 12


def test_unknown_kinds_and_scenes_without_a_court_are_refused():
    with pytest.raises(ValueError, match=r"draw_case.kind: expected one of serve"):
        draw_case("smash", 0, 0, CaseOptions(), TENNIS)
    with pytest.raises(ValueError, match=r"draw_shot.kind: expected one of serve"):
        draw_shot("rally", np.random.default_rng(0), TENNIS)
    with pytest.raises(ValueError, match=r"draw_case.scene: expected a court"):
        draw_case("serve", 0, 0, CaseOptions(), replace(TENNIS, court=None))
