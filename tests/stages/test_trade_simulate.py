"""`pgm trade simulate` writes its tables, sheets and figures, and the laws that it measures hold."""

import json
from pathlib import Path

from pgm_cli.main import run


def test_a_small_trade_has_its_files_and_keeps_the_laws(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["--plays", "3", "--bodies", "2", "--minutes", "0.02", "--seconds", "0.2"]
    assert run(["trade", "simulate", "--out", str(out), *argv]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {".pgm", "trade.md", "trade.json", "tennis.jpg", "blocks.jpg", "run.json"}
    figures = json.loads((out / "trade.json").read_text(encoding="utf-8"))
    physics = figures["physics"]
    assert physics["plays"] == 3 and physics["flights"] >= 3
    assert physics["energy_gain"] < 1e-6
    assert physics["slide_m"][1] < 0.01
    assert physics["penetration_m"] < 0.01
    assert len(figures["runs"]) == 7
    assert all(r["frames"] > 0 and r["memory_mb"] > 0 for r in figures["runs"])
    assert run(["trade", "simulate", "--out", str(out), *argv]) == 2
