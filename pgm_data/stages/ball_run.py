"""What a run of `pgm-ball3d` on a work folder is."""

from pgm_data.dataset.clip_ball import BALL_TABLES
from pgm_data.stages.ball_clips import ClipOutcome
from pgm_data.stages.clip_run import ClipStage

MARK_SUFFIXES = (".csv", ".xml", ".json")
BALL_STAGE = ClipStage(
    name="ball3d",
    tables=BALL_TABLES,
    reads=("camera.parquet", "players.parquet"),
    outcome=ClipOutcome,
    run_states={"ok": "ok", "no ball": "degraded", "failed": "failed"},
)
