"""`pgm-ball3d` in both its forms: what it writes, how near the truth that is, what it refuses."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pgm_cli.main import run

from pgm_data.dataset.check import check_paths
from tests.lift.ball.line_worlds import SIZE, Shot, shot


def write_shot(folder: Path, made: Shot, *, fps: float) -> tuple[Path, Path, Path]:
    """TRACK.csv, CAMERA.json and EVENTS.csv of a shot."""
    folder.mkdir(parents=True, exist_ok=True)
    pixels = made.track.pixels
    seen = np.isfinite(pixels[:, 0]).astype(int)
    track = pd.DataFrame({"frame": np.arange(len(pixels)), "x": pixels[:, 0], "y": pixels[:, 1], "visible": seen})
    track.to_csv(folder / "TRACK.csv", index=False)
    camera = made.camera[0]
    document = {"width": SIZE[0], "height": SIZE[1]} | {
        name: getattr(camera, name).reshape(-1).tolist()
        for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    }
    (folder / "CAMERA.json").write_text(json.dumps(document))
    events = pd.DataFrame(
        {
            "frame": (made.events.times - made.track.times[0]) * fps,
            "kind": list(made.events.kinds),
            "x": made.events.ground_px[:, 0],
            "y": made.events.ground_px[:, 1],
        }
    )
    inside = (events["frame"] >= 0) & (events["frame"] <= len(pixels) - 1)
    events[inside].to_csv(folder / "EVENTS.csv", index=False)
    return folder / "TRACK.csv", folder / "CAMERA.json", folder / "EVENTS.csv"


@pytest.fixture
def forehand(tmp_path) -> tuple[Shot, Path]:
    made = shot("forehand near", np.random.default_rng(3), fps=25.0, marked=True)
    write_shot(tmp_path / "in", made, fps=25.0)
    return made, tmp_path / "in"


@pytest.mark.parametrize("method", ["line", "physics"])
def test_a_foreign_track_with_marks_is_placed_to_decimetres(forehand, tmp_path, capsys, method):
    made, given = forehand
    out = tmp_path / "out"
    argv = ["ball3d", str(given / "TRACK.csv"), "--camera", str(given / "CAMERA.json"), "--out", str(out)]
    assert run([*argv, "--fps", "25", "--events", str(given / "EVENTS.csv"), "--method", method]) == 0
    assert "ball.parquet" in capsys.readouterr().out
    ball = pd.read_parquet(out / "ball.parquet")
    assert len(ball) == len(made.position)
    placed = (ball["ball.status"] != "none").to_numpy()
    assert placed.mean() > 0.9
    error = np.linalg.norm(np.stack(ball["ball.position"])[placed] - made.position[placed], axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.5
    assert check_paths([out]) == []
    shots = pd.read_parquet(out / "ball_shots.parquet")
    assert shots["start_speed"][0] == pytest.approx(np.linalg.norm(made.start_velocity), rel=0.1)
    assert 0 <= shots["in_probability"][0] <= 1
    assert shots["player"][0] == "player0"


def test_without_events_they_are_found(forehand, tmp_path):
    _, given = forehand
    out = tmp_path / "out"
    argv = ["ball3d", str(given / "TRACK.csv"), "--camera", str(given / "CAMERA.json"), "--out", str(out)]
    assert run([*argv, "--fps", "25", "--method", "line"]) == 0
    events = pd.read_parquet(out / "events.parquet")
    assert "bounce" in set(events["kind"])
    assert set(events["source"]) == {"detected"}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (["--camera", "absent.json"], "--camera"),
        (["--fps", "0"], "--fps"),
        (["--fps", "nan"], "--fps"),
        (["--sigma", "0"], "--sigma"),
        (["--scene", "blocks"], "--scene"),
        (["--events", "absent.csv"], "--events"),
        (["--workers", "2"], "--workers"),
        (["--size", "wide"], "wide"),
    ],
)
def test_what_cannot_be_is_refused_and_named(forehand, tmp_path, capsys, change, named):
    _, given = forehand
    argv = ["ball3d", str(given / "TRACK.csv"), "--camera", str(given / "CAMERA.json"), "--out", str(tmp_path / "o")]
    assert run([*argv, "--fps", "25", *change]) == 2
    assert named in capsys.readouterr().err
    assert not (tmp_path / "o" / "ball.parquet").exists()


def test_a_track_without_times_needs_a_frame_rate(forehand, tmp_path, capsys):
    _, given = forehand
    argv = ["ball3d", str(given / "TRACK.csv"), "--camera", str(given / "CAMERA.json"), "--out", str(tmp_path / "o")]
    assert run(argv) == 2
    assert "--fps" in capsys.readouterr().err


def test_a_track_of_nothing_is_none_and_says_so(forehand, tmp_path, capsys):
    _, given = forehand
    empty = pd.read_csv(given / "TRACK.csv").assign(visible=0)
    empty.to_csv(given / "TRACK.csv", index=False)
    argv = ["ball3d", str(given / "TRACK.csv"), "--camera", str(given / "CAMERA.json"), "--out", str(tmp_path / "o")]
    assert run([*argv, "--fps", "25"]) == 4
    assert "no ball" in capsys.readouterr().err
    ball = pd.read_parquet(tmp_path / "o" / "ball.parquet")
    assert set(ball["ball.status"]) == {"none"}
    assert check_paths([tmp_path / "o"]) == []


def test_a_folder_that_is_no_work_folder_is_refused(tmp_path, capsys):
    assert run(["ball3d", str(tmp_path)]) == 4
    assert "no clip" in capsys.readouterr().err


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    """A short match drawn at a small size, with its true cameras and without the ball's tables."""
    out = tmp_path_factory.mktemp("match") / "sim"
    argv = ["--matches", "1", "--minutes", "0.06", "--seed", "5", "--pictures", "draft", "--resolution", "640x360"]
    assert run(["simulate", "--out", str(out), *argv, "--no-closeups", "--no-dataset", "--jobs", "1"]) == 0
    for path in (out / "work").rglob("*.parquet"):
        if path.stem in ("ball", "events", "ball_shots", "players", "captions"):
            path.rename(path.with_suffix(".true"))
    return out


def test_a_work_folder_gets_the_balls_tables_overlay_and_report(work, capsys):
    folder = work / "work"
    argv = ["ball3d", str(folder), "--method", "line", "--detector", "motion", "--workers", "1", "--json"]
    code = run([*argv, "--videos", str(work / "videos")])
    told = json.loads(capsys.readouterr().out)
    clip = told["clips"][0]
    assert code in (0, 4), told
    assert clip["detected"] >= 10
    name = clip["clip_id"]
    for table in ("ball", "events", "ball_shots"):
        assert (folder / name / f"{table}.parquet").is_file()
    assert (folder / name / "overlay.mp4").is_file()
    assert "<h" in (folder / name / "report.html").read_text()
    assert [v for v in check_paths([folder]) if "captions" not in str(v)] == []
    ball = pd.read_parquet(folder / name / "ball.parquet")
    true = pd.read_parquet(folder / name / "ball.true")
    seen = np.isfinite(np.stack(ball["ball.pixel"])[:, 0])
    far = np.linalg.norm(np.stack(ball["ball.pixel"])[seen] - np.stack(true["ball.pixel"])[seen], axis=1)
    assert np.mean(far < 3) > 0.85


def test_a_ball_that_is_there_is_not_replaced_unasked(work, capsys):
    folder = work / "work"
    assert run(["ball3d", str(folder)]) == 2
    assert "--resume" in capsys.readouterr().err
    argv = ["ball3d", str(folder), "--method", "line", "--detector", "motion", "--workers", "1"]
    assert run([*argv, "--videos", str(work / "videos"), "--resume"]) in (0, 4)
    assert "done before" in capsys.readouterr().err


def test_a_clip_without_its_video_fails_alone_and_says_which(work, tmp_path, capsys):
    folder = work / "work"
    assert run(["ball3d", str(folder), "--overwrite", "--videos", str(tmp_path)]) == 4
    assert "--videos" in capsys.readouterr().err


def test_a_scene_of_another_court_than_the_cameras_is_refused(work, capsys):
    argv = ["ball3d", str(work / "work"), "--videos", str(work / "videos"), "--overwrite", "--scene", "tabletennis"]
    assert run(argv) == 2
    assert "--scene" in capsys.readouterr().err
