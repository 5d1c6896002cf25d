"""`pgm export` writes what each format asks for, says what it did, and ends with the exit code that tells."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from pgm_cli.export import FORMATS
from pgm_cli.main import run

from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("export")
    write_truth_clip(root / "work" / "rally", TENNIS, frames=6)
    write_truth_clip(root / "work" / "camera only", TENNIS, frames=3, seed=1, without=("players", "ball", "captions"))
    return root / "work"


@pytest.mark.parametrize(
    ("words", "files", "said"),
    [
        (("coco",), ["rally.json"], "12 boxes of 1 files to "),
        (("mot",), ["rally.txt"], "12 boxes of 1 files to "),
        (("track",), ["rally.csv"], "6 pixels of the ball of 1 files to "),
        (("track", "--form", "tracknet"), ["rally.csv"], "6 pixels of the ball of 1 files to "),
        (("captions",), ["rally.csv"], "captions of 1 files to "),
        (("captions", "--form", "vtt"), ["rally.vtt"], "captions of 1 files to "),
    ],
)
def test_a_file_is_written_for_each_clip_that_has_the_table(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple, files: list, said: str
) -> None:
    assert run(["export", words[0], str(work), "--out", str(tmp_path / "out"), *words[1:]]) == 3
    captured = capsys.readouterr()
    assert said in captured.out
    assert "camera only: " in captured.err and ".parquet: expected the table, got nothing there" in captured.err
    assert sorted(path.name for path in (tmp_path / "out").iterdir() if path.name != ".pgm") == files


def test_every_second_frame_and_only_one_clip_are_all_well(tmp_path: Path) -> None:
    write_truth_clip(tmp_path / "work" / "rally", TENNIS, frames=6)
    assert run(["export", "coco", str(tmp_path / "work"), "--out", str(tmp_path / "out"), "--every", "2"]) == 0
    content = json.loads((tmp_path / "out" / "rally.json").read_text())
    assert [image["frame_index"] for image in content["images"]] == [0, 2, 4]
    assert [image["file_name"] for image in content["images"]] == [f"rally/{i:06d}.jpg" for i in (0, 2, 4)]


@pytest.mark.parametrize(("form", "suffix"), [("smpl", "npz"), ("bvh", "bvh")])
def test_skeletons_go_out_and_come_back(work: Path, tmp_path: Path, form: str, suffix: str) -> None:
    assert run(["export", form, str(work), "--out", str(tmp_path / "out"), "--player", "player1"]) == 0
    assert [path.name for path in (tmp_path / "out").glob(f"*.{suffix}")] == [f"rally_player1.{suffix}"]
    file = tmp_path / "out" / f"rally_player1.{suffix}"
    assert run(["import", form, str(file), "--out", str(tmp_path / "back"), "--player", "player1"]) == 0
    assert run(["check", str(tmp_path / "back")]) == 0


def test_what_cannot_be_exported_is_named_and_nothing_is_written(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    out = str(tmp_path / "out")
    for words, code, named in (
        (["coco", str(tmp_path / "nowhere"), "--out", out], 2, "WORK: expected a work folder"),
        (["mot", str(tmp_path / "nowhere"), "--out", out], 2, "WORK: expected a work folder"),
        (["coco", str(work), "--out", out, "--every", "0"], 2, "--every: expected at least 1"),
        (["bvh", str(work), "--out", out, "--unit-m", "nan"], 2, "--unit-m: expected above 0"),
        (["coco", str(tmp_path / "empty"), "--out", out], 4, "no clip.json in its folders"),
        (["track", str(work), "--out", str(work)], 2, "--out: expected a new or empty folder"),
        (["smpl", str(tmp_path / "empty"), "--out", out, "--overwrite"], 4, "expected clips with players.parquet"),
    ):
        assert run(["export", *words]) == code, words
        assert named in capsys.readouterr().err, words


def test_a_full_folder_is_overwritten_when_asked(work: Path, tmp_path: Path) -> None:
    words = ["export", "mot", str(work), "--out", str(tmp_path / "out")]
    assert [run(words), run(words), run([*words, "--overwrite"])] == [3, 2, 3]


@pytest.mark.parametrize("form", list(FORMATS))
def test_every_format_says_what_is_lost(form: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", form, "--help"]) == 0
    assert "Lost" in capsys.readouterr().out


def test_help_imports_nothing_heavy() -> None:
    heavy = ("cv2", "pycolmap", "scipy", "pyarrow", "torch", "casadi")
    code = (
        "import sys\nfrom pgm_cli.main import run\n"
        "for words in (['export', '--help'], ['import', '--help'], ['import', 'smpl', '--help']):\n    run(words)\n"
        f"assert not [name for name in {heavy} if name in sys.modules], sys.modules.keys() & {set(heavy)}"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=60)
