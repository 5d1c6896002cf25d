"""`pgm trade` refuses what it cannot work with before anything is written."""

import pytest
from pgm_cli.console import UsageError
from pgm_cli.trade import main
from pgm_cli.trade_ball import BallTrade, solvers_of


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


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--shots", "-1"], "--shots"),
        (["--rallies", "-1"], "--rallies"),
        (["--sweeps", "-1"], "--sweeps"),
        (["--workers", "0"], "--workers"),
        (["--seed", "-1"], "--seed"),
        (["--quality", "draft", "draft"], "--quality"),
        (["--method", "line", "line"], "--method"),
        (["--kind", "lob", "lob"], "--kind"),
        (["--real", "absent"], "--real"),
        (["--pixels"], "--pixels"),
        (["absent"], "DATA"),
    ],
)
def test_bad_options_of_the_balls_trade_are_refused(arguments, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=f"^{named}: expected"):
        main(["ball3d", *arguments, "--out", "out"])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "solvers"),
    [
        ({}, ("line", "draft", "standard", "best")),
        ({"method": ("line",)}, ("line",)),
        ({"method": ("physics",), "quality": ("best",)}, ("best",)),
    ],
)
def test_methods_and_presets_make_solvers(arguments, solvers, tmp_path):
    assert solvers_of(BallTrade(out=tmp_path, **arguments)) == solvers


def test_folders_without_real_data_or_truth_are_nothing_usable(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    for number, argv in enumerate((["--real", str(tmp_path / "empty")], [str(tmp_path / "empty")])):
        out = str(tmp_path / f"out{number}")
        assert main(["ball3d", *argv, "--out", out, "--shots", "0", "--rallies", "0", "--sweeps", "0"]) == 4
        assert "expected" in capsys.readouterr().err
