"""`pgm trade` refuses what it cannot work with before anything is written."""

import pytest
from pgm_cli.console import UsageError
from pgm_cli.trade import main


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--clips", "-1"], "--clips"),
        (["--frames", "2"], "--frames"),
        (["--workers", "0"], "--workers"),
        (["--resolution", "1280"], "--resolution"),
        (["--quality", "draft", "draft"], "--quality"),
        (["--real", "absent"], "--real"),
        (["absent"], "DATA"),
        (["--network", "absent.onnx"], "--network"),
        (["--scene", "blocks"], "--scene"),
    ],
)
def test_bad_options_are_refused(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=f"^{named}: expected"):
        main(["calibrate", *arguments, "--out", "out"])
    assert not list(tmp_path.iterdir())


def test_a_folder_without_truth_is_nothing_usable(tmp_path, capsys):
    (tmp_path / "data").mkdir()
    assert main(["calibrate", str(tmp_path / "data"), "--out", str(tmp_path / "out"), "--negatives", "0"]) == 4
    assert "expected videos with their truth" in capsys.readouterr().err
