"""`pgm import` makes a work folder that passes its check, and ends with the exit code that tells."""

import json
from pathlib import Path

import pytest
from pgm_cli import import_labels
from pgm_cli.import_ import FORMATS
from pgm_cli.main import run

from pgm_data.dataset.clip_camera import read_clip_camera
from tests.convert.playable_folders import write_video


@pytest.fixture
def playable(tmp_path: Path) -> Path:
    write_video(tmp_path / "data" / "train" / "00000" / "00000", 3, size=(64, 36))
    write_video(tmp_path / "data" / "test" / "00004" / "00000", 2, size=(64, 36))
    return tmp_path / "data"


def test_a_playable_dataset_becomes_a_work_folder(
    playable: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "work"
    assert run(["import", "playable", str(playable), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "5 cameras in 2 clips" in said and "test_00004: times are nominal, at 5 frames per second (--fps)" in said
    assert run(["check", str(out)]) == 0
    document = json.loads((out / "run.json").read_text())
    assert (document["command"], document["inputs"][0]["state"]) == ("pgm import playable", "ok")
    assert document["options"]["pictures"] == "video" and (out / "videos" / "train_00000.mp4").is_file()
    assert run(["pack", str(out), "--out", str(tmp_path / "dataset"), "--videos", "none"]) == 0
    assert list(json.loads((tmp_path / "dataset" / "meta" / "info.json").read_text())["splits"]) == ["train"]


def test_its_options_reach_the_clips(playable: Path, tmp_path: Path) -> None:
    words = ["--fps", "10", "--focal-size", "128", "72", "--pictures", "none"]
    assert run(["import", "playable", str(playable), "--out", str(tmp_path / "work"), *words]) == 0
    clip = read_clip_camera(tmp_path / "work" / "train_00000")
    assert clip.timestamp.tolist() == [0.0, 0.1, 0.2] and clip.camera.K[0, 0, 0] == 1140.0
    assert not (tmp_path / "work" / "videos").exists()


def test_a_damaged_sequence_ends_with_3_and_none_at_all_with_4(
    playable: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (playable / "train" / "00000" / "00000" / "cameras.pkl").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    assert run(["import", "playable", str(playable), "--out", str(tmp_path / "some")]) == 3
    captured = capsys.readouterr()
    assert "cameras.pkl: byte 0: name: expected one of" in captured.err and "2 cameras in 1 clips" in captured.out
    assert run(["check", str(tmp_path / "some")]) == 0
    (playable / "test" / "00004" / "00000" / "focals.pkl").unlink()
    assert run(["import", "playable", str(playable), "--out", str(tmp_path / "none")]) == 4
    assert "expected at least one clip" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert run(["import", "playable", str(tmp_path / "empty"), "--out", str(tmp_path / "nothing")]) == 4


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["playable", "nowhere"], "PATH: expected a file or folder"),
        (["playable", "data", "--fps", "0"], "--fps: expected"),
        (["playable", "data", "--focal-size", "0", "5"], "--focal-size: expected"),
        (["playable", "data", "--scene", "chess"], "--scene: expected a scene"),
        (["smpl", "data", "--size", "-1"], "size: expected above 0"),
        (["bvh", "data", "--unit-m", "0"], "unit_m: expected above 0"),
        (["colmap", "data", "--fps", "inf"], "--fps: expected"),
        (["nothing", "data"], "nothing"),
    ],
)
def test_bad_options_are_named_and_nothing_is_written(
    playable: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["import", *words, "--out", "work"]) == 2
    assert named in capsys.readouterr().err and not (tmp_path / "work").exists()


@pytest.mark.parametrize("form", [form for form, made in FORMATS.items() if made.__module__ != import_labels.__name__])
def test_every_format_that_makes_a_work_folder_says_what_is_lost(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["import", form, "--help"]) == 0
    assert "Lost" in capsys.readouterr().out
