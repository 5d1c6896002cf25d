"""`pgm simulate` as a command: what it refuses, what it says, and what is left when it fails, stops or goes on."""

import pickle
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from pgm_cli.main import run

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.documents import read_document
from pgm_data.scene import scene_text
from pgm_data.stages import simulate_run

SMALL = ["--resolution", "64x36", "--jobs", "1"]
THREE = ["--matches", "3", "--minutes", "0.002", "--pictures", "none", "--scene", "badminton", *SMALL]


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        (["--matches", "1", "--fps", "-5"], "--fps"),
        (["--matches", "1", "--fps", "0"], "--fps"),
        (["--matches", "1", "--fps", "1000"], "--fps"),
        (["--matches", "1", "--fps", "nan"], "--fps"),
        (["--matches", "1", "--minutes", "0"], "--minutes"),
        (["--matches", "1", "--minutes", "nan"], "--minutes"),
        (["--matches", "1", "--minutes", "inf"], "--minutes"),
        (["--matches", "1", "--minutes", "0.0001"], "--minutes"),
        (["--matches", "1", "--resolution", "9999999x2"], "--resolution"),
        (["--matches", "1", "--resolution", "wide"], "--resolution"),
        (["--matches", "1", "--resolution", "641x360"], "--resolution"),
        (["--matches", "1", "--resolution", "7680x36"], "--resolution"),
        (["--matches", "1", "--scene", "cricket"], "--scene"),
        (["--matches", "1", "--scene", "../x"], "--scene"),
        (["--matches", "1", "--shutter", "1.5"], "--shutter"),
        (["--matches", "1", "--shutter", "nan"], "--shutter"),
        (["--matches", "1", "--wind", "100", "0"], "--wind"),
        (["--matches", "1", "--wind", "nan", "0"], "--wind"),
        (["--matches", "1", "--jobs", "-1"], "--jobs"),
        (["--matches", "-2"], "--matches"),
        (["--matches", "1", "--mix", "1"], "--mix"),
        ([], "--matches"),
        (["--mix", "1", "--scene", "blocks"], "--mix"),
        (["--mix", "5", "--duplicates"], "--duplicates"),
        (["--mix", "5", "--masks"], "--masks"),
        (["--mix", "5", "--seed", "-1"], "--seed"),
        (["--matches", "1", "--scene", "badminton", "--masks"], "--masks"),
        (["--matches", "1", "--scene", "blocks", "--wind", "1", "0"], "--wind"),
        (["--matches", "1", "--worlds", "1"], "--worlds"),
        (["--matches", "1", "--scene", "badminton", "--worlds", "1"], "--worlds"),
        (["--matches", "1", "--scene", "blocks", "--worlds", "-1"], "--worlds"),
        (["--mix", "5", "--worlds", "1"], "--worlds"),
    ],
)
def test_bad_options_are_named_and_nothing_is_written(
    argv: list[str], named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["simulate", "--out", str(tmp_path / "out"), *argv]) == 2
    said = capsys.readouterr().err
    assert named in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", [b"a: [1, 2\nb: }", pickle.dumps({"name": "x"}), b"- 1", b"", b"name: ../x"])
def test_a_file_that_is_no_scene_is_named(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my scene.yaml"
    path.write_bytes(content)
    assert run(["simulate", "--out", str(tmp_path / "out"), "--matches", "1", "--scene", str(path)]) == 2
    said = capsys.readouterr().err
    assert str(path) in said and said.count("\n") == 1


def test_a_scene_whose_name_leaves_the_folder_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = yaml.safe_load(scene_text("badminton")) | {"name": "../x"}
    path = tmp_path / "evil.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    assert run(["simulate", "--out", str(tmp_path / "out"), "--matches", "1", "--scene", str(path)]) == 2
    assert "../x" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["evil.yaml"]


def _fail_at(number: int, error: BaseException, patch: pytest.MonkeyPatch) -> None:
    """The video of that number fails, half written."""
    whole = simulate_run.run_job

    def broken(arguments: dict, report) -> dict:
        result = whole(arguments, report)
        if arguments["number"] == number:
            raise error
        return result

    patch.setattr(simulate_run, "run_job", broken)


def test_a_video_that_fails_is_named_and_the_others_are_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        _fail_at(1, ValueError("a ball that does not come down"), patch)
        assert run(["simulate", "--out", str(out), *THREE]) == 3
    said = capsys.readouterr().err
    assert "error: badminton_0_001: ValueError: a ball that does not come down\n" in said
    assert not list((out / "work").glob("badminton_0_001*"))
    assert check_paths([out / "work", out / "dataset"]) == []
    states = [entry["state"] for entry in read_document(out / "work" / "run.json", "run")["inputs"]]
    assert states == ["done", "failed", "done"]
    assert run(["simulate", "--out", str(out), *THREE, "--resume"]) == 0
    assert capsys.readouterr().err.count("done before") == 2
    assert (out / "work" / "badminton_0_001").is_dir()


def test_a_run_whose_every_video_fails_ends_with_4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _fail_at(0, ValueError("no"), monkeypatch)
    assert run(["simulate", "--out", str(tmp_path / "out"), *THREE, "--matches", "1"]) == 4


def test_a_full_disk_ends_the_run_with_4(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _fail_at(1, OSError(28, "No space left on device"), monkeypatch)
    assert run(["simulate", "--out", str(tmp_path / "out"), *THREE]) == 4
    assert "the disk is full" in capsys.readouterr().err
    assert sorted(p.name for p in (tmp_path / "out" / "work").glob("*_*")) == ["badminton_0_000"]


def test_an_interrupted_run_leaves_whole_videos_alone_and_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    assert run(["simulate", "--out", str(whole), *THREE]) == 0
    with monkeypatch.context() as patch:
        _fail_at(1, KeyboardInterrupt(), patch)
        assert run(["simulate", "--out", str(out), *THREE]) == 130
    assert sorted(p.name for p in (out / "work").glob("*_*")) == ["badminton_0_000"]
    assert check_paths([out / "work"]) == []
    assert run(["simulate", "--out", str(out), *THREE, "--resume"]) == 0
    for path in whole.rglob("*"):
        if path.is_file() and path.name != "run.json" and path.parent.name != ".pgm":
            assert path.read_bytes() == (out / path.relative_to(whole)).read_bytes(), path


def test_what_a_killed_run_left_half_written_is_made_anew(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code = """
import os, sys
from pgm_cli.main import run
from pgm_data.simulate import folders
folders.write_clip_truth = lambda *a, **k: os.kill(os.getpid(), 9)
run(sys.argv[1:])
"""
    argv = ["simulate", "--out", str(out), "--matches", "1", "--minutes", "0.002", "--scene", "badminton", *SMALL]
    killed = subprocess.run([sys.executable, "-c", code, *argv], check=False, capture_output=True)
    assert killed.returncode == -signal.SIGKILL
    (out / "videos" / ".badminton_0_000.4711.part.mp4").touch()
    assert run(argv) == 2
    assert run([*argv, "--resume"]) == 0
    assert [p.name for p in (out / "videos").iterdir()] == ["badminton_0_000.mp4"]
    assert check_paths([out / "work", out / "dataset"]) == []


def test_resume_makes_anew_what_depends_on_changed_options_and_refuses_other_videos(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), *THREE]
    assert run(argv) == 0
    clip = out / "work" / "badminton_0_000" / "clip.json"
    before = clip.stat().st_mtime_ns
    assert run([*argv, "--resume"]) == 0
    assert clip.stat().st_mtime_ns == before
    assert run([*argv, "--resume", "--minutes", "0.003"]) == 0
    assert read_document(clip, "clip")["n_frames"] == 4
    capsys.readouterr()
    for other in (["--matches", "2"], ["--seed", "1"]):
        assert run([*argv, "--resume", "--minutes", "0.003", *other]) == 2
        assert "--resume" in capsys.readouterr().err
    assert run([*argv, "--overwrite"]) == 0
    assert clip.stat().st_mtime_ns > before


def test_progress_tells_of_frames_within_a_match(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(simulate_run, "TELL_EVERY_S", 0.0)
    argv = ["simulate", "--out", str(tmp_path / "out"), "--matches", "1", "--minutes", "0.004", *SMALL]
    assert run([*argv, "--scene", "badminton"]) == 0
    assert "frame 1 of 6" in capsys.readouterr().err
