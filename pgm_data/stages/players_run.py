"""What a run of `pgm players` on a work folder is."""

from pgm_data.stages.clip_run import ClipStage
from pgm_data.stages.players_options import (
    BOXES_OPTION,
    KEYPOINTS_OPTION,
    SKELETONS_OPTION,
    PlayersOutcome,
)

FILE_SUFFIXES = {KEYPOINTS_OPTION: (".json",), BOXES_OPTION: (".csv", ".txt"), SKELETONS_OPTION: (".npz",)}
PLAYERS_STAGE = ClipStage(
    name="players",
    tables=("players",),
    reads=("camera.parquet",),
    outcome=PlayersOutcome,
    run_states={"ok": "ok", "no players": "degraded", "failed": "failed"},
)
