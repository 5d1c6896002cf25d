"""Scores of the trade of the ball in metres are right on answers that are known, and a tiny run has its files."""

import json
from pathlib import Path

import numpy as np
import pytest
from pgm_cli.main import run

from pgm_data.lift.ball.solution import BallSolution, Flights
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import Prior, load_scene
from pgm_data.stages.trade_ball import sweep_settings, write_figures
from pgm_data.stages.trade_ball_cases import BallCase, CaseOptions, draw_case
from pgm_data.stages.trade_ball_clips import clips_figures, clips_table, pixel_figures
from pgm_data.stages.trade_ball_rally import law_figures, net_clearance
from pgm_data.stages.trade_ball_real import real_document, real_tables, view_figures
from pgm_data.stages.trade_ball_score import (
    brier,
    f1_of,
    lands_in,
    match_events,
    matched_times,
    score_events,
    score_places,
    score_shots,
)
from pgm_data.stages.trade_ball_summary import ALL, groups_of, lower_median, lower_quantile, pick
from pgm_data.stages.trade_ball_tracks import labelled_track, mean_error, view_camera
from pgm_data.stages.trade_run import rows_of

TENNIS = load_scene("tennis")


def solved(case: BallCase, rng: np.random.Generator, *, sigma: float, off: float = 0.0, lost: float = 0.0):
    """The truth with an error of `sigma` along each axis, stated as it is, `off` metres to the side."""
    frames, hits = len(case.position), np.flatnonzero(case.contacts.kinds == "hit")
    status = np.where(case.inside & (rng.random(frames) >= lost), "measured", "none").astype(object)
    placed = (status != "none")[:, None]
    shots = [shot for shot in case.path.shots if shot.start_s + case.start_s in case.contacts.times[hits]]
    count = len(shots)
    flights = Flights(
        start_event=hits[:count],
        end_event=hits[:count] + 1,
        start_velocity=np.stack([1.02 * shot.velocity for shot in shots]),
        start_velocity_cov=np.repeat(np.eye(3)[None], count, axis=0),
        spin=np.stack([shot.spin for shot in shots]),
        spin_std=np.full((count, 3), 10.0),
        drag_per_m=np.full(count, 0.02),
        drag_std_per_m=np.full(count, 0.001),
        landing=np.stack([shot.landing + [0.03, 0.04, 0.0] for shot in shots]),
        landing_cov=np.repeat(0.01 * np.eye(3)[None], count, axis=0),
        residual_px=np.full(count, 1.0),
        free=(("velocity",),) * count,
        status=("solved",) * count,
        said=("",) * count,
    )
    return BallSolution(
        position=np.where(placed, case.position + sigma * rng.normal(size=(frames, 3)) + [off, 0, 0], np.nan),
        velocity=np.where(placed, case.velocity, np.nan),
        position_cov=np.where(placed[:, None], sigma**2 * np.eye(3), np.nan),
        status=status,
        events=case.contacts,
        event_position=case.contact_position,
        event_cov=np.repeat(np.eye(3)[None], len(case.contacts), axis=0),
        flights=flights,
        drag=Prior(mean=0.02, std=0.001),
        restitution=None,
        friction=None,
        cost=0.0,
        said="",
    )


@pytest.fixture(scope="module")
def case() -> BallCase:
    return draw_case("forehand_near", 0, 0, CaseOptions(fps=240.0), TENNIS)


def row_of(case: BallCase, solution: BallSolution, **more) -> dict:
    assert TENNIS.court is not None
    return (
        {"part": "drawn", "setting": "base", "kind": case.kind, "solver": "line", "events": "given", "cold": False}
        | {"seconds": 0.1, "again_s": None, "bound_m": 0.1, "with_priors_m": 0.12}
        | score_places(case, solution)
        | {"found_events": score_events(case, solution.events)}
        | {"shots": score_shots(case, solution, np.ones(len(solution.flights)), TENNIS.court)}
        | more
    )


def test_an_error_that_is_stated_as_it_is_is_covered_as_it_should_be(case):
    rng = np.random.default_rng(0)
    rows = [row_of(case, solved(case, rng, sigma=0.1)) for _ in range(40)]
    rms = np.array([row["rms_m"] for row in rows])
    np.testing.assert_allclose(rms, 0.1 * np.sqrt(3), rtol=0.1)
    group = pick(groups_of(rows), kind=ALL, solver="line")
    assert group is not None and group.cases == 40 and group.failed == 0
    # 480 frames: five standard errors of a share of 0.683.
    for share in (*group.coverage.overall, *(v for axis in group.coverage.thirds for v in axis)):
        assert abs(share - 0.683) < 5 * np.sqrt(0.683 * 0.317 / 160)
    assert group.over_bound == pytest.approx(np.sqrt(3), rel=0.05)
    assert group.with_priors == pytest.approx(1.2)
    assert group.error_m == pytest.approx(0.1 * np.sqrt(3), rel=0.05)
    assert group.stated_m == pytest.approx(0.1 * np.sqrt(3), rel=1e-6)
    assert group.found.f1_kinds == 1.0 and group.found.time_median_s == 0.0
    assert group.speed_error == pytest.approx(0.02) and group.landing_m == pytest.approx(0.05)
    assert group.brier == 1.0 - group.in_share and group.in_share in (0.0, 1.0)


def test_failures_are_those_far_off_and_those_not_placed_and_count_as_infinite(case):
    rng = np.random.default_rng(1)
    good = row_of(case, solved(case, rng, sigma=0.01))
    off = row_of(case, solved(case, rng, sigma=0.01, off=1.1))
    lost = row_of(case, solved(case, rng, sigma=0.01, lost=0.7))
    assert [row["failed"] for row in (good, off, lost)] == [False, True, True]
    group = pick(groups_of([good, off, lost]), kind=ALL)
    assert group is not None and group.failed == 2 and group.error_m == np.inf
    most = pick(groups_of([good, good, off]), kind=ALL)
    assert most is not None and most.error_m == good["rms_m"] and most.error_p90_m == np.inf


def test_events_are_matched_by_hand():
    true, kinds = np.array([1.0, 2.0, 3.0, 4.0]), np.array(["hit", "bounce", "hit", "last"], dtype=object)
    times = np.array([1.01, 2.03, 2.98, 3.5])
    found = match_events(true, kinds, times, np.array(["hit", "hit", "hit", "bounce"], dtype=object), 0.04)
    assert (found["hit"].true, found["hit"].found, found["hit"].matched) == (2, 3, 2)
    assert found["hit"].f1 == pytest.approx(0.8)
    assert (found["bounce"].true, found["bounce"].found, found["bounce"].matched) == (1, 1, 0)
    assert found["kinds"].f1 == pytest.approx(2 * 2 / 7)
    assert (found["any"].true, found["any"].found, found["any"].matched) == (3, 4, 3)
    np.testing.assert_allclose(found["any"].errors_s, [0.01, 0.03, -0.02])
    assert np.isnan(f1_of(0, 0, 0)) and f1_of(3, 0, 0) == 0.0


def test_each_event_is_matched_once_and_as_many_as_can_be():
    assert matched_times(np.array([0.0, 1.0]), np.array([0.9]), 2.0) == [(1, 0)]
    # The nearest pair first would leave 1.0 alone.
    assert matched_times(np.array([0.0, 1.0]), np.array([0.6, -1.2]), 1.3) == [(0, 1), (1, 0)]
    assert matched_times(np.zeros(0), np.array([1.0]), 1.0) == []


def test_medians_and_quantiles_take_the_lower_value():
    assert lower_median(np.array([1.0, 2.0, np.inf, np.inf])) == 2.0
    assert lower_quantile(np.arange(10.0), 0.9) == 8.0
    assert np.isnan(lower_median(np.zeros(0)))
    assert brier([0.8, 0.4], [True, False]) == pytest.approx((0.04 + 0.16) / 2) and np.isnan(brier([], []))


@pytest.mark.parametrize(
    ("landing", "start", "is_in"),
    [
        ([4.0, 11.8, 0.0], [0.0, -12.0, 1.0], True),
        ([4.2, 11.8, 0.0], [0.0, -12.0, 1.0], False),
        ([4.0, -3.0, 0.0], [0.0, -12.0, 1.0], False),
        ([-3.0, 6.0, 0.0], [1.0, -11.8, 2.8], True),
        ([3.0, 6.0, 0.0], [1.0, -11.8, 2.8], False),
        ([-3.0, 7.0, 0.0], [1.0, -11.8, 2.8], False),
    ],
)
def test_what_is_in_is_in(landing, start, is_in):
    assert TENNIS.court is not None
    assert lands_in(np.array(landing), np.array(start), TENNIS.court) is is_in


def test_shots_cross_the_net_at_a_height_that_is_read_between_frames():
    world = ball_world(TENNIS)
    position = np.array([[0.0, -1.0, 1.5], [np.nan] * 3, [0.0, 1.0, 1.1], [0.0, 2.0, 0.2]])
    assert net_clearance(position, world) == pytest.approx(1.3 - world.radius_m - 0.914)
    assert net_clearance(position[:1], world) is None
    case = draw_case("rally", 0, 0, CaseOptions(), TENNIS)
    assert TENNIS.court is not None
    laws = law_figures(solved(case, np.random.default_rng(0), sigma=0.0), case.track.times, world, TENNIS.court)
    assert laws["shots"] == laws["over_net"] == laws["speeds_right"] == 4
    assert laws["bounces"] == laws["bounces_right"] == 4


def test_table_tennis_errors_count_what_is_placed():
    truth = np.zeros((4, 3))
    found = np.array([[0.3, 0.4, 0.0], [0.0, 0.0, 0.1], [np.nan] * 3, [0.0, 0.0, 0.0]])
    assert mean_error(found, truth) == {"mean_m": pytest.approx(0.2), "placed": 3, "frames": 4, "failed": False}
    assert mean_error(found + 1.0, truth)["failed"] and mean_error(np.full((4, 3), np.nan), truth)["failed"]
    rows = [
        {"part": "tabletennis", "view": "back", "solver": "line", "cold": False, "seconds": 0.1}
        | {"mean_m": mean, "failed": mean is None, "errors_m": [[0.1, 0.1, 0.1]], "sigmas_m": [[0.2, 0.05, 0.2]]}
        for mean in (0.1, 0.3, None)
    ]
    (view,) = view_figures(rows)
    assert (view.failed, view.median_m, view.mean_m, view.p90_m) == (1, 0.3, pytest.approx(0.2), np.inf)
    assert view.covered == (1.0, 0.0, 1.0)


def counted(true: int, found: int, matched: int) -> dict:
    one = {"true": true, "found": found, "matched": matched, "errors_s": [0.01] * matched}
    return dict.fromkeys(("hit", "bounce", "kinds", "any"), one)


def test_balls_in_pictures_are_right_within_a_distance():
    true = np.array([[10.0, 10.0], [20.0, 20.0], [np.nan] * 2, [30.0, 30.0], [30.0, 30.0]])
    found = np.array([[13.0, 14.0], [20.0, 26.5], [5.0, 5.0], [np.nan] * 2, [30.0, 30.0]])
    figures = pixel_figures(found, true, np.array([True, True, True, True, False]), 6.0)
    assert figures == {"frames": 5, "true_balls": 3, "found_balls": 3, "right_balls": 1}
    rows = [
        {"part": "clips", "clip": "a", "solver": "line", "detect_s": 0.5, "seconds": 0.1, "failed": False}
        | {"rms_m": 0.2, "errors_m": [[0.1] * 3], "sigmas_m": [[0.2] * 3], "found_events": counted(4, 4, 3)}
        | figures,
        {"part": "clips", "clip": "b", "solver": "line", "detect_s": 0.5, "seconds": 0.3, "failed": True}
        | {"rms_m": None, "reason": "ValueError: no"}
        | figures,
    ]
    (line,) = clips_figures(rows)
    assert (line.clips, line.failed, line.error_m, line.detect_fps) == (2, 1, 0.2, 10.0)
    assert line.recall == line.precision == pytest.approx(1 / 3) and line.events.f1_kinds == 0.75
    assert "| line | 2 | 1 | 33.3 % | 33.3 % | 0.750 |" in clips_table((line,))


def test_tables_of_real_data_say_what_was_measured_and_what_failed():
    laws = {"shots": 10, "over_net": 9, "speeds_right": 10, "bounces": 9, "bounces_right": 8, "residual_px": None}
    rally = {"part": "rally", "from": "track", "solver": "line", "failed": False, "seconds": 1.0, "placed": 0.9}
    rows = [
        rally | laws | {"found_events": counted(24, 24, 21), "found_2d": counted(24, 24, 22)},
        {"part": "rally", "from": "pixels", "solver": "best", "failed": True, "seconds": 1.0, "reason": "no"},
        {"part": "rolandgarros", "tuning": True, "found_events": counted(10, 8, 6)},
        {"part": "rolandgarros", "tuning": False, "found_events": counted(10, 10, 8)},
        {"part": "shots", "shots": 3, "time_ratio": [0.9, 1.0, 1.1], "height_m": 0.02},
    ]
    text = "\n".join(real_tables(rows))
    assert "| hits and bounces F1 | 0.8 | 0.875 | failed |" in text
    assert "| hits and bounces F1, in 2D |  | 0.917 | failed |" in text
    assert "| shots that cross the net above it | all | 9 of 10 | failed |" in text
    assert "| held out | 0.800 | 0.800 | 0.800 (0.75) | 0.800 | 10.0 |" in text
    assert "3 that bounced in" in text
    assert json.dumps(real_document(rows), allow_nan=False)


def test_real_files_are_read_as_they_are(tmp_path: Path):
    (tmp_path / "back.yaml").write_text(
        "rvec: [1.5707963, 0.0, 0.0]\ntvec: [0.0, 0.0, 25.0]\nf: 5000.0\nw: 1280\nh: 720\n"
    )
    camera, size = view_camera(tmp_path / "back.yaml", 3)
    assert size == (1280, 720) and camera.K.shape == (3, 3, 3)
    np.testing.assert_allclose(camera.position_world[0], [0.0, -25.0, 0.0], atol=1e-5)
    frames = {
        "101": {"x": None, "y": None, "visible": False, "action": "air"},
        "100": {"x": 5.0, "y": 6.0, "visible": True, "action": "hit"},
    }
    path = tmp_path / "ball_data_7.json"
    path.write_text(json.dumps(frames))
    track, kinds = labelled_track(path)
    assert list(kinds) == ["hit", "air"] and list(track.measured) == [True, False]
    np.testing.assert_allclose(track.times, [0.0, 0.02])


def test_every_setting_differs_from_the_one_that_the_bars_are_for():
    settings = sweep_settings()
    assert CaseOptions() not in settings.values()
    assert {case.fps for case in settings.values()} >= {10.0, 30.0, 50.0, 60.0, 240.0}
    assert {case.noise_px for case in settings.values()} >= {0.5, 1.0, 2.0, 3.0}


def test_a_small_run_writes_its_tables_and_resumes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    argv = ["trade", "ball3d", "--out", str(out), "--shots", "2", "--rallies", "0", "--sweeps", "0", "--kind", "slice"]
    assert run([*argv, "--method", "line"]) == 0
    assert {p.name for p in out.iterdir()} == {".pgm", "trade.md", "trade.svg", "trade.json", "rows.jsonl", "run.json"}
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [(row["kind"], row["number"]) for row in rows if row["events"] == "given"] == [("slice", 0), ("slice", 1)]
    assert all(0.005 < row["bound_m"] < 0.5 for row in rows)
    assert "| slice |" in (out / "trade.md").read_text(encoding="utf-8")
    assert (out / "trade.svg").read_text(encoding="utf-8").count("<circle") == 1
    figures = json.loads((out / "trade.json").read_text(encoding="utf-8"))
    assert {group["solver"] for group in figures["drawn"]} == {"line"}
    capfd.readouterr()
    assert run([*argv, "--method", "line", "--resume"]) == 0
    again = [json.loads(line) for line in (out / "rows.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [row["seconds"] for row in again] == [row["seconds"] for row in rows]
    assert write_figures(tmp_path, rows, ("line",)).count("## ") >= 2
    assert rows_of([]) == []
