"""Tables and plots of the trades of players and of the whole pipeline, from made-up rows."""

import json

import numpy as np
import pytest

from pgm_data.stages import trade_pipeline, trade_players
from pgm_data.stages.trade_pipeline_clips import Variant, variants

PRESETS = ("draft", "standard", "best")


def player_row(quality: str, root: float | None, seconds: float, **changes) -> dict:
    return {
        "part": "drawn", "player": "player0", "quality": quality, "lift_s": seconds, "clip_frames": 100,
        "there": 100, "placed": 0 if root is None else 100, "wrong": 0, "root_rms_m": root, "root_median_m": root,
        "root_axes_rms_m": [root] * 3, "covered": [0.7] * 3, "joints_m": 0.1, "pose_m": 0.05, "stance_rms_m": 0.01,
        "stance_p95_m": 0.02, "slide_m": 0.01, "jump_rms_m": 0.03, "jumps": 2, "contact_right": 0.9,
    } | changes  # fmt: skip


def test_errors_are_pooled_over_clips_and_a_dominated_preset_is_named(tmp_path):
    rows = [player_row("draft", 0.3, 1.0), player_row("standard", 0.1, 2.0), player_row("standard", 0.2, 2.0)]
    rows += [player_row("best", 0.25, 4.0)]
    table = trade_players.write_figures(tmp_path, rows, PRESETS)
    assert f"{100 * np.sqrt((0.1**2 + 0.2**2) / 2):.1f}" in table
    assert "best is dominated by standard" in table
    assert "<svg" in (tmp_path / "trade.svg").read_text()
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 4
    assert json.loads((tmp_path / "trade.json").read_text())["rows"] == 4


def test_a_clip_in_which_nobody_was_placed_is_counted_and_breaks_nothing(tmp_path):
    rows = [player_row("draft", None, 1.0, root_axes_rms_m=[None] * 3, covered=[None] * 3), player_row("draft", 0.1, 1)]
    assert "50.0 %" in trade_players.write_figures(tmp_path, rows, ("draft",))


def test_every_stage_is_changed_alone_and_all_together():
    found = variants(PRESETS)
    assert found[0] == Variant()
    assert len(found) == len(set(found)) == 1 + 3 * 2 + 2
    assert Variant(camera="draft") in found
    assert Variant(camera="best", players="best", ball="best").name == "camera best, players best, ball best"
    assert variants(("standard",)) == (Variant(),)


@pytest.mark.parametrize("ball", [0.2, None])
def test_the_cheapest_presets_near_the_best_are_told(tmp_path, ball):
    def row(variant: str, near: float, seconds: float) -> dict:
        errors = {"ball_m": ball, "player0_m": near, "player1_m": 2 * near, "camera_m": 0.01}
        times = {"camera_s": seconds, "players_s": seconds, "ball_s": seconds}
        shares = {"ball_placed": 0.5, "player1_placed": 0.9, "court_px": 0.05}
        return {"video": "v", "variant": variant, "frames": 1500} | errors | times | shares

    rows = [row("all standard", 0.1, 10.0), row("camera draft", 0.105, 5.0), row("ball draft", 0.3, 1.0)]
    table = trade_pipeline.write_figures(tmp_path, rows)
    assert "near player: the cheapest within a tenth of the best is `camera draft`, 10.5 cm" in table
    assert "| all standard |" in table
    assert "30" in table.split("| all standard |")[1].splitlines()[0]  # seconds of all stages
