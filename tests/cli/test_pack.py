"""`pgm pack` says what it did, and ends with the exit code that tells."""

import json
from pathlib import Path

import pytest
from pgm_cli.main import run

from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")


@pytest.fixture
def work(tmp_path: Path) -> Path:
    for number, match in enumerate("abc"):
        write_truth_clip(tmp_path / "work" / match, TENNIS, frames=8, match_id=match, seed=number)
    return tmp_path / "work"


def test_a_dataset_is_written_and_passes_its_check(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "dataset"
    assert run(["pack", str(work), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "3 clips (train 1, val 1, test 1), 24 frames" in said and "25 frames per second, constant" in said
    assert run(["check", str(out)]) == 0
    info = json.loads((out / "meta" / "info.json").read_text())
    (out / "meta" / "info.json").write_text(json.dumps(info | {"total_frames": 1}))
    assert run(["check", str(out)]) == 5
    assert "total_frames" in capsys.readouterr().out


def test_a_full_folder_is_refused_and_overwritten_when_asked(work: Path, tmp_path: Path) -> None:
    out = tmp_path / "dataset"
    assert run(["pack", str(work), "--out", str(out), "--val-share", "0", "--test-share", "0"]) == 0
    assert run(["pack", str(work), "--out", str(out)]) == 2
    assert list(json.loads((out / "meta" / "info.json").read_text())["splits"]) == ["train"]
    assert run(["pack", str(work), "--out", str(out), "--overwrite"]) == 0
    assert list(json.loads((out / "meta" / "info.json").read_text())["splits"]) == ["train", "val", "test"]


def test_a_bad_clip_ends_with_3_and_none_at_all_with_4(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (work / "b" / "camera.parquet").unlink()
    assert run(["pack", str(work), "--out", str(tmp_path / "some")]) == 3
    captured = capsys.readouterr()
    assert f"error: {work / 'b'}: camera.parquet" in captured.err and "2 clips" in captured.out
    assert run(["check", str(tmp_path / "some")]) == 0
    for clip in "ac":
        (work / clip / "camera.parquet").unlink()
    assert run(["pack", str(work), "--out", str(tmp_path / "none")]) == 4
    assert "nothing was written" in capsys.readouterr().err
    assert not (tmp_path / "none" / "meta").exists()


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        ([], "WORK: expected at least one"),
        (["nowhere"], "WORK: expected a work folder"),
        (["work", "--val-share", "1.5"], "--val-share: expected"),
        (["work", "--val-share", "0.6", "--test-share", "0.5"], "--val-share + --test-share: expected"),
        (["work", "--file-mb", "0"], "--file-mb: expected"),
        (["work", "--scene", "chess"], "--scene: expected"),
        (["work", "--video-folder", "nowhere"], "--video-folder: expected"),
        (["work", "twin"], "clip a: expected once"),
        (["work", "--out", "work"], "--out: expected another folder"),
    ],
)
def test_what_cannot_be_packed_is_named_and_nothing_is_written(
    work: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    argv: list[str],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_truth_clip(tmp_path / "twin" / "a", TENNIS, frames=2)
    assert run(["pack", *argv, *([] if "--out" in argv else ["--out", "dataset"])]) == 2
    said = capsys.readouterr().err
    assert named in said and said.count("\n") == 1
    assert not (tmp_path / "dataset").exists()
    assert sorted(path.name for path in work.iterdir()) == ["a", "b", "c"]
