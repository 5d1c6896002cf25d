"""The trade's figures against cases worked out by hand, and a small trade from end to end."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.scene import load_scene
from pgm_data.simulate.views import broadcast_pose
from pgm_data.stages.jobs import JobEvent
from pgm_data.stages.trade_calibrate import TradeOptions, run_trade
from pgm_data.stages.trade_pictures import changed, real_sources
from pgm_data.stages.trade_plot import Dot, Panel, plot_svg
from pgm_data.stages.trade_real import ReadFrame, RealScore, point_errors, read_frame, real_videos, scaled
from pgm_data.stages.trade_score import (
    Cost,
    court_error_px,
    coverage,
    coverage_by_thirds,
    line_points,
    score_video,
    true_pixels,
)
from pgm_data.stages.trade_summary import dominance_lines, dominated, farthest_third, summarise
from pgm_data.stages.trade_tables import RealRun, real_table, summarise_real

SIZE = (1280, 720)
COURT = load_scene("tennis").court
assert COURT is not None
FREE = Cost(seconds=2.0, cpu_s=3.0, memory_mb=100.0)


def view_camera(seed: int, frames: int) -> Camera:
    """A broadcast camera that stands still for some frames."""
    view = broadcast_pose(np.random.default_rng(seed), COURT, SIZE).view(SIZE)
    return Camera(
        K=np.tile(view.K, (frames, 1, 1)),
        distortion=np.tile([view.k1, 0.0, 0.0, 0.0], (frames, 1)),
        R_cam_from_world=np.tile(view.R_cam_from_world, (frames, 1, 1)),
        t_cam_from_world=np.tile(view.t_cam_from_world, (frames, 1)),
    )


def moved(camera: Camera, offset_m: np.ndarray) -> Camera:
    """The camera with its centre elsewhere, turned as before."""
    t = -(camera.R_cam_from_world @ (camera.position_world + offset_m)[..., None])[..., 0]
    return replace(camera, t_cam_from_world=t)


def clip_of(camera: Camera, *, first: int = 0, status: str = "measured", sigma_m: float = 0.1) -> ClipCamera:
    frames = len(camera.K)
    cov = np.tile([sigma_m**2, 0, 0, sigma_m**2, 0, sigma_m**2], (frames, 1))
    return ClipCamera(
        clip_id="clip",
        video_frame=np.arange(first, first + frames),
        timestamp=np.arange(frames) / 25.0,
        is_duplicate=np.zeros(frames, bool),
        capture_time=np.arange(frames) / 25.0,
        camera=camera,
        status=np.array([status] * frames, dtype=object),
        reason=np.array([""] * frames, dtype=object),
        inliers=np.full(frames, 100),
        reprojection_px=np.full(frames, 0.3),
        position_cov=cov,
        focal_std_px=np.full(frames, 5.0),
    )


def score(solved: list[ClipCamera], truth: ClipCamera, *, preset: str = "standard", cost: Cost = FREE):
    return score_video(
        video="clip",
        preset=preset,
        size=SIZE,
        solved=solved,
        truth=[truth],
        court=COURT,
        lens_model="radial",
        cost=cost,
    )


@given(seed=st.integers(0, 1000))
def test_a_perfect_camera_has_no_error(seed: int) -> None:
    camera = view_camera(seed, 3)
    found = score([clip_of(camera)], clip_of(camera))
    assert found.solved and not found.wrong
    assert (found.frames, found.measured, found.interpolated, found.false_frames) == (3, 3, 0, 0)
    assert found.centre_error_m == pytest.approx(0.0, abs=1e-9)
    assert found.focal == pytest.approx(0.0, abs=1e-12)
    assert found.court_px == pytest.approx(0.0, abs=1e-6)
    assert found.focal_covered == 1.0


def test_errors_of_a_moved_camera_are_what_it_was_moved_by() -> None:
    truth = view_camera(3, 4)
    offset = np.array([0.03, -0.2, 0.06])
    zoomed = np.array(truth.K)
    zoomed[:, [0, 1], [0, 1]] *= 1.01
    found = score([clip_of(replace(moved(truth, offset), K=zoomed))], clip_of(truth))
    assert found.centre_m == pytest.approx(tuple(offset), abs=1e-9)
    assert found.centre_sigma_m == pytest.approx((0.1, 0.1, 0.1))
    assert found.centre_error_m == pytest.approx(np.linalg.norm(offset))
    assert found.focal == pytest.approx(0.01)
    assert found.focal_sigma == pytest.approx(5.0 / truth.K[0, 0, 0])
    assert found.distance_m == pytest.approx(np.hypot(*truth.position_world[0, :2]))


def test_court_error_of_a_shifted_principal_point_is_the_shift() -> None:
    truth = view_camera(5, 2)
    K = np.array(truth.K)
    K[:, :2, 2] += [3.0, -4.0]
    assert court_error_px(replace(truth, K=K), truth, COURT, size=SIZE) == pytest.approx([5.0, 5.0])


def test_court_error_counts_points_in_view_only() -> None:
    truth = view_camera(5, 1)
    K = np.array(truth.K)
    K[:, 0, 2] += 2000.0
    away = replace(truth, K=K)
    assert np.isnan(court_error_px(away, away, COURT, size=SIZE)).all()


def test_true_pixels_come_from_the_drawing_camera_and_agree_with_the_solvers() -> None:
    from pgm_data.geometry.camera import project

    camera = view_camera(11, 2)
    points = line_points(COURT)
    np.testing.assert_allclose(true_pixels(camera, points), project(camera, points)[0], atol=1e-9)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).min() > 0.2


def test_frames_are_matched_by_video_frame() -> None:
    truth = view_camera(1, 6)
    solved = [clip_of(truth[:3]), clip_of(truth[3:5], first=3), clip_of(truth[:2], first=50)]
    found = score(solved, clip_of(truth))
    assert (found.frames, found.measured, found.false_frames) == (6, 5, 2)
    assert found.reason == "in no clip"
    assert not found.found and not found.solved


def test_a_camera_far_off_is_wrong_and_not_solved() -> None:
    truth = view_camera(2, 3)
    turn = rotation_from_rotvec(np.array([0.0, 0.02, 0.0]))
    t = truth.t_cam_from_world @ turn.T
    found = score(
        [clip_of(replace(truth, R_cam_from_world=turn @ truth.R_cam_from_world, t_cam_from_world=t))], clip_of(truth)
    )
    assert found.found and found.wrong and not found.solved


def test_nothing_found_counts_as_infinitely_wrong() -> None:
    truth = view_camera(2, 3)
    lost = score([], clip_of(truth))
    assert lost.centre_m is None and lost.court_px is None and not lost.solved
    summary = summarise("standard", [lost, lost, score([clip_of(truth)], clip_of(truth))])
    assert summary.solved == pytest.approx(1 / 3)
    assert np.isinf(summary.centre_m) and np.isinf(summary.court_px)
    assert summary.frame_s == pytest.approx(6.0 / 9)


def test_right_deviations_cover_two_thirds_and_wrong_ones_do_not() -> None:
    rng = np.random.default_rng(0)
    sigma = np.exp(rng.normal(0, 1, 30000))
    error = sigma * rng.standard_normal(30000)
    assert coverage(error, sigma) == pytest.approx(0.6827, abs=0.01)
    assert coverage_by_thirds(error, sigma) == pytest.approx((0.6827,) * 3, abs=0.02)
    assert coverage(error, 0.5 * sigma) == pytest.approx(0.3829, abs=0.01)
    assert coverage(np.array([1.0, 3.0, np.nan]), np.array([2.0, 2.0, 2.0])) == 0.5
    assert np.isnan(coverage(np.zeros(0), np.zeros(0)))


def test_thirds_are_those_of_the_stated_deviation() -> None:
    sigma = np.array([3.0, 1.0, 2.0, 3.1, 1.1, 2.1])
    error = np.array([9.0, 0.0, 0.0, 9.0, 0.0, 9.0])
    assert coverage_by_thirds(error, sigma) == (1.0, 0.5, 0.0)


def test_the_farthest_third_has_the_longest_lenses_farthest_away() -> None:
    truth = view_camera(2, 2)
    base = score([clip_of(truth)], clip_of(truth))
    lenses = [(1.0, 30.0), (2.0, 50.0), (2.0, 30.0), (1.0, 50.0)]
    scores = [replace(base, video=str(i), focal_widths=f, distance_m=d) for i, (f, d) in enumerate(lenses)]
    assert {s.video for s in farthest_third(scores)} == {"1", "2"}


def test_dominance_needs_both_time_and_error() -> None:
    assert dominated(np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0])) == []
    assert dominated(np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 2.0])) == [(2, 1)]
    assert dominated(np.array([1.0, 1.0]), np.array([1.0, 1.0])) == []
    lines = dominance_lines(["draft", "best"], [1.0, 2.0], {"error": [1.0, 5.0]})
    assert lines == ["in error against time best is dominated by draft"]
    assert dominance_lines(["draft"], [1.0], {"error": [1.0]}) == []


def test_hand_read_points_are_scored_in_pixels_of_at_most_1920() -> None:
    camera = view_camera(7, 1)
    world = COURT.all_world
    from pgm_data.geometry.camera import project

    pixels = project(camera[0], world)[0]
    points = {name: list(pixels[i] + [0.3, 0.4]) for i, name in enumerate(COURT.point_names)}
    net = list(pixels[COURT.all_names.index("net_centre_top")] + [0.0, 2.0])
    assert point_errors(camera[0], COURT, points) == pytest.approx([0.5] * len(points))
    read = read_frame(0, [clip_of(camera)], COURT, points, net)
    assert (read.rms_px, read.max_px, read.net_px) == pytest.approx((0.5, 0.5, 2.0))
    assert scaled(read, 3840).rms_px == pytest.approx(0.25)
    assert scaled(read, 1280).net_px == pytest.approx(2.0)
    assert read_frame(1, [clip_of(camera)], COURT, points, net).status == "none"
    with pytest.raises(ValueError, match="net_center"):
        point_errors(camera[0], COURT, {"net_center": [0.0, 0.0]})


def test_a_read_frame_without_camera_counts_in_the_worst_error() -> None:
    good = ReadFrame(frame=1, status="measured", rms_px=0.5, max_px=0.9, net_px=1.0)
    lost = ReadFrame(frame=2, status="none", rms_px=None, max_px=None, net_px=None)
    runs = [
        RealRun(
            score=RealScore(
                video="a.mp4",
                preset="draft",
                frames=100,
                measured=90,
                interpolated=5,
                clips=1,
                false_frames=0,
                read=read,
                jitter_px=0.01,
                lens_model="radial",
                reprojection_px=0.2,
                seconds=3.0,
                cpu_s=3.0,
                memory_mb=300.0,
            ),
            process_s=4.0,
        )
        for read in ((good,), (good, lost))
    ]
    first = summarise_real("draft", runs[:1])
    assert (first.rms_worst_px, first.unsolved, first.fps) == (0.5, 0, 25.0)
    both = summarise_real("draft", runs)
    assert np.isinf(both.rms_worst_px) and both.unsolved == 1
    assert "0.50, none" in real_table(runs)


def test_the_plot_holds_each_preset_and_leaves_out_what_is_not_finite() -> None:
    from xml.etree import ElementTree

    dots = (Dot(name="a<b", time=1.0, error=2.0), Dot(name="lost", time=3.0, error=np.inf))
    text = plot_svg([Panel(title="t", time_unit="ms", error_unit="px", dots=dots)])
    root = ElementTree.fromstring(text)
    words = [element.text for element in root.iter() if element.tag.endswith("text")]
    assert "a<b" in words and "lost" not in words
    assert len([e for e in root.iter() if e.tag.endswith("circle")]) == 1


def test_changed_pictures_depend_on_their_generator_alone() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (360, 640, 3)).astype(np.uint8)
    first, again = (changed(np.random.default_rng(4), picture) for _ in range(2))
    assert np.array_equal(first, again)
    assert first.shape[0] % 2 == 0 and first.shape[1] in (640, 854, 1280)


def test_real_folders_are_read_by_their_names(tmp_path) -> None:
    closes = "usopen_360p30_pan_cuts.mp4"
    for name in ("other_sports/badminton_1.mp4", "other_sports/tennis_2.mp4", f"tennis/{closes}", "tennis/a.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    sources = real_sources(tmp_path, "tennis")
    assert [(s.path.name, s.first_frame) for s in sources] == [("badminton_1.mp4", 0), (closes, 2340)]
    assert [p.name for p in real_videos(tmp_path, "tennis")] == [closes]


def test_a_small_trade_runs_and_goes_on_where_it_stopped(tmp_path) -> None:
    options = TradeOptions(
        out=tmp_path,
        state_dir=tmp_path / ".pgm",
        qualities=("draft",),
        clips=1,
        frames=8,
        negatives=2,
        size=(640, 360),
        seed=5,
    )
    events: list[str] = []

    def note(event: JobEvent) -> None:
        events.append(f"{event.kind} {event.name}")

    outcome = run_trade(options, on_event=note, on_jobs=lambda _: None)
    assert outcome.failed == ()
    assert outcome.scored == 2
    (simulated,) = outcome.figures.simulated
    assert simulated.clips == 1 and simulated.frame_s > 0 and simulated.memory_mb > 0
    assert simulated.solved == 1.0 and simulated.court_px < 1.0
    (pictures,) = outcome.figures.pictures
    assert (pictures.pictures, pictures.real) == (2, 0)
    document = json.loads((tmp_path / "trade.json").read_text())
    assert document["simulated"][0]["court_px"] == simulated.court_px
    assert "| clips solved | 99 % | 100.0 % |" in (tmp_path / "trade.md").read_text()
    assert "draft" in (tmp_path / "trade.svg").read_text()
    rows = [json.loads(line) for line in (tmp_path / "rows.jsonl").read_text().splitlines()]
    assert [row["job"] for row in rows] == ["draw 000", "draft tennis_5_000", "pictures 00000"]
    assert not list((tmp_path / ".pgm" / "scratch").iterdir())

    events.clear()
    again = run_trade(replace(options, resume=True), on_event=note, on_jobs=lambda _: None)
    assert events == ["skipped draw 000", "skipped draft tennis_5_000", "skipped pictures 00000"]
    assert again.figures.table() == outcome.figures.table()


def test_a_data_folder_without_truth_is_refused(tmp_path) -> None:
    options = TradeOptions(out=tmp_path, state_dir=tmp_path / ".pgm", data=tmp_path)
    with pytest.raises(ValueError, match="expected videos with their truth"):
        run_trade(options, on_event=lambda _: None, on_jobs=lambda _: None)
