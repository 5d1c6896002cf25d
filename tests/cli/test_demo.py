"""The demo runs end to end, replaces its own folder, and leaves others alone."""

import pytest
from pgm_cli import simulate
from pgm_cli.console import UsageError
from pgm_cli.demo import OURS, main


def test_it_calibrates_what_it_drew_says_where_to_look_and_the_next_one_replaces_it(tmp_path, capsys, monkeypatch):
    out = tmp_path / "demo"
    argv = ["--out", str(out), "--seconds", "1", "--seed", "3"]
    assert main(argv) == 0
    told = capsys.readouterr().out
    assert "error of the camera's position" in told
    assert str(out / "work" / "report.html") in told
    assert (out / "work" / "report.html").is_file()
    assert list((out / "work").glob("*/overlay.mp4"))
    assert {path.name for path in out.iterdir()} >= {"simulated", "work", "dataset"}
    # The next one ends where it would draw, and what it would draw into is empty by then.
    monkeypatch.setattr(simulate, "main", lambda argv: 7 + sum((out / name).exists() for name in OURS))
    assert main(argv) == 7


def test_a_folder_of_the_same_name_that_no_demo_wrote_is_left_alone(tmp_path):
    (tmp_path / "work").mkdir()
    precious = tmp_path / "work" / "thesis.txt"
    precious.write_text("mine")
    with pytest.raises(UsageError, match="work"):
        main(["--out", str(tmp_path)])
    assert precious.read_text() == "mine"


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path):
    precious = tmp_path / "thesis.txt"
    precious.write_text("mine")
    with pytest.raises(UsageError, match=r"thesis\.txt"):
        main(["--out", str(tmp_path)])
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("arguments", [["--video", "absent.mp4"], ["--seconds", "0"]])
def test_bad_options_are_refused(arguments, tmp_path):
    with pytest.raises(UsageError):
        main([*arguments, "--out", str(tmp_path / "new")])
