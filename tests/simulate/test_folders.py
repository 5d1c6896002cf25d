"""What `pgm simulate` leaves on disk keeps the contract, and bad options end with exit code 2."""

from pathlib import Path

import numpy as np
import pytest
from pgm_cli.main import run

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.scene import load_scene
from pgm_data.simulate.clip import ClipOptions, simulate_clip
from pgm_data.simulate.folders import match_seed
from pgm_data.video import open_video

SMALL = ["--resolution", "160x90", "--jobs", "1"]


def test_a_match_has_its_video_and_the_truth_of_every_frame(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--matches", "1", "--minutes", "0.02", "--duplicates", "--seed", "3", *SMALL]
    assert run(argv) == 0
    assert check_paths([out / "work"]) == []
    camera = read_table(out / "work" / "tennis_3_000" / "camera.parquet")
    with open_video(out / "videos" / "tennis_3_000.mp4") as video:
        times = [frame.timestamp for frame in video]
    assert len(times) == 30
    np.testing.assert_allclose(camera["timestamp"], times, atol=1e-6)
    assert set(camera["camera.status"]) == {"measured"}
    options = ClipOptions(frames=30, width=160, height=90, duplicates=True)
    truth = simulate_clip(load_scene("tennis"), options, match_seed(3, 0))
    np.testing.assert_array_equal(camera["camera.K"].reshape(-1, 3, 3), truth.track.K)
    np.testing.assert_array_equal(camera["frame.is_duplicate"], truth.is_duplicate)
    assert not camera["camera.reprojection_px"].any()
    assert read_document(out / "work" / "run.json", "run")["options"]["seed"] == 3
    clip = read_document(out / "work" / "tennis_3_000" / "clip.json", "clip")
    assert clip["quality"] == "truth" and (out / "work" / clip["source_path"]).exists()


def test_truth_without_pictures_cuts_at_closeups_and_is_the_same_for_any_quality(tmp_path: Path) -> None:
    tables = []
    for name in ("a", "b"):
        argv = ["simulate", "--out", str(tmp_path / name), "--matches", "1", "--minutes", "1", "--closeups"]
        assert run([*argv, "--pictures", "none", *SMALL]) == 0
        assert not (tmp_path / name / "videos").exists()
        tables.append(read_table(tmp_path / name / "work" / "tennis_0_000.01" / "camera.parquet"))
    np.testing.assert_array_equal(tables[0]["camera.R_cam_from_world"], tables[1]["camera.R_cam_from_world"])
    shots = read_table(tmp_path / "a" / "work" / "shots.parquet")
    assert len(shots["video_frame"]) == 1500
    assert (shots["verdict"] == "other").any()
    assert ((shots["verdict"] == "clip") == (shots["clip_id"] != "")).all()


def test_a_mix_has_status_none_where_no_court_is_seen(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(["simulate", "--out", str(out), "--mix", "40", "--seed", "2", *SMALL]) == 0
    assert check_paths([out / "work"]) == []
    camera = read_table(out / "work" / "mix_2_0000" / "camera.parquet")
    none = camera["camera.status"] == "none"
    assert 0 < none.sum() < 16
    assert (np.isnan(camera["camera.K"]).all(axis=1) == none).all()


def test_resume_leaves_finished_videos_alone_and_a_full_folder_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--mix", "4", *SMALL]
    assert run(argv) == 0
    video = out / "videos" / "mix_0_0000.mp4"
    before = video.stat().st_mtime_ns
    assert run(argv) == 2
    assert run([*argv, "--resume"]) == 0
    assert video.stat().st_mtime_ns == before
    assert run([*argv, "--overwrite"]) == 0
    assert video.stat().st_mtime_ns > before


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        (["--matches", "1", "--fps", "-5"], "--fps"),
        (["--matches", "1", "--minutes", "0"], "--minutes"),
        (["--matches", "1", "--minutes", "nan"], "--minutes"),
        (["--matches", "1", "--resolution", "9999999x2"], "--resolution"),
        (["--matches", "1", "--resolution", "wide"], "--resolution"),
        (["--matches", "1", "--resolution", "641x360"], "--resolution"),
        (["--matches", "1", "--scene", "cricket"], "--scene"),
        (["--matches", "1", "--scene", "blocks"], "has no court"),
        (["--matches", "-2"], "--matches"),
        (["--matches", "1", "--mix", "1"], "--mix"),
        ([], "--matches"),
        (["--mix", "5", "--duplicates"], "--duplicates"),
        (["--mix", "5", "--seed", "-1"], "--seed"),
    ],
)
def test_bad_options_are_named_and_nothing_is_written(
    argv: list[str], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["simulate", "--out", str(tmp_path / "out"), *argv]) == 2
    said = capsys.readouterr().err
    assert named in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()
