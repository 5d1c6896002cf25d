"""`pgm trade simulate` writes its tables, sheets and figures, and the laws that it measures hold."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest
from pgm_cli.main import run

from pgm_data.stages import trade_simulate
from pgm_data.stages.simulate_sheet import write_sheet
from pgm_data.stages.simulate_speed import Run, timed_simulate

ARGV = ["--plays", "3", "--bodies", "2", "--minutes", "0.02", "--seconds", "0.2"]


def test_a_small_trade_has_its_files_and_keeps_the_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    timed: list[Sequence[str]] = []

    def noted(what: str, arguments: Sequence[str], frames: int, out: Path) -> Run:
        timed.append(arguments)
        return Run(what=what, frames=frames, seconds=1.0, cpu_s=1.0, memory_mb=1.0, load=0.0)

    monkeypatch.setattr(trade_simulate, "timed_simulate", noted)
    monkeypatch.setattr(trade_simulate, "SIZES", {"tennis": (160, 90), "blocks": (160, 90)})
    monkeypatch.setattr(trade_simulate, "write_sheet", partial(write_sheet, count=2))
    out = tmp_path / "out"
    assert run(["trade", "simulate", "--out", str(out), *ARGV]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {".pgm", "trade.md", "trade.json", "tennis.jpg", "blocks.jpg", "run.json"}
    figures = json.loads((out / "trade.json").read_text(encoding="utf-8"))
    physics = figures["physics"]
    assert physics["plays"] == 3 and physics["flights"] >= 3
    assert physics["energy_gain"] < 1e-6
    assert physics["slide_m"][1] < 0.01
    assert physics["penetration_m"] < 0.01
    assert len(figures["runs"]) == len(timed) - 1 == 7
    assert run(["trade", "simulate", "--out", str(out), *ARGV]) == 2


def test_a_timed_run_tells_its_cost_and_one_that_fails_tells_why(tmp_path: Path) -> None:
    argv = ["--scene", "badminton", "--matches", "1", "--minutes", "0.002", "--resolution", "64x36", "--no-dataset"]
    cost = timed_simulate("three frames", argv, 3, tmp_path / "out")
    assert cost.frames_per_second > 0 and cost.memory_mb > 20
    with pytest.raises(RuntimeError, match="--out: expected a new or empty folder"):
        timed_simulate("again", argv, 3, tmp_path / "out")
