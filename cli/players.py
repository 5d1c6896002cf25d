"""`pgm players WORK`: skeletons on the court."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .clip_command import NOTHING_USABLE, Telling, carried_out, planned, scene_of, short, told
from .console import option_error

if TYPE_CHECKING:
    from pgm_data.stages.players_options import PlayersOutcome


@dataclass(frozen=True, kw_only=True)
class PlayersCommand:
    """The players of every clip: who they are, their joints in metres, feet on the ground, with error bars.

    Finds them in the clips that pgm-calibrate made and writes players.parquet beside their cameras. Body points need
    the weights that `pgm weights pose` fetches, or a network of yours; without them players are placed by their boxes
    alone. Exit codes: 0 all well; 3 a clip failed; 4 no player was placed at all.
    """

    work: tyro.conf.Positional[Path]
    """Work folder."""
    quality: Literal["draft", "standard", "best"] = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    scene: str = ""
    """Name of a scene that ships with pgm, or the path of a scene file; that of the clips unless given."""
    people: Literal["auto", "network", "motion", "both"] = "auto"
    """What finds people; motion needs no network."""
    detector: str = ""
    """ONNX file of a person detector (YOLOX, RTMDet) instead of the bundled network."""
    pose: str = ""
    """File of a pose network (RTMPose, ViTPose as ONNX; BlazePose as TFLite) instead of the fetched one."""
    joints: bool = True
    """Whether body points are looked for; else players are placed by their boxes alone."""
    keypoints: str = ""
    """COCO keypoints JSON to take instead of detecting; of several clips a folder of files named after them."""
    boxes: str = ""
    """MOT CSV of boxes to take instead of finding people; of several clips a folder of files named after them."""
    skeletons: str = ""
    """npz of 3D skeletons in camera axes (SMPL poses or joints, of one or several players) to register; of several
    clips a folder of files named after them."""
    first_number: Literal[-1, 0, 1] = -1
    """What those files call the video's first frame, 0 or 1; -1 where they tell by themselves."""
    clip: tuple[str, ...] = ()
    """Only these clips."""
    videos: str = ""
    """Folder in which the videos are, where they have moved."""
    overlay: bool = True
    """Whether overlay.mp4 is drawn anew with the players in it."""
    workers: int = 0
    """Videos at a time; 0 for one a processor core."""
    timeout: float = 0.0
    """Longest time for one video, seconds; 0 for any."""
    resume: bool = False
    """Clips that an earlier run finished stay unless what they depend on changed."""
    overwrite: bool = False
    """Replace what an earlier run wrote."""
    quiet: bool = False
    """Say nothing but errors."""
    json: bool = False
    """Print one JSON document instead of a table."""


def main(argv: list[str]) -> int:
    """Place the players; the exit code."""
    command = tyro.cli(PlayersCommand, args=argv, prog="pgm players")
    line = shlex.join(["pgm", "players", *argv])
    work = command.work
    if not work.is_dir():
        raise option_error("WORK", expected="a work folder", got=f"{work}, which is none")
    from pgm_data.stages.players_options import BOXES_OPTION, KEYPOINTS_OPTION, SKELETONS_OPTION, PlayersOptions
    from pgm_data.stages.players_run import FILE_SUFFIXES, PLAYERS_STAGE

    for option, value in (("--detector", command.detector), ("--pose", command.pose)):
        if value and not Path(value).is_file():
            raise option_error(option, expected="a file", got=f"{value}, which is none")
    named = {KEYPOINTS_OPTION: command.keypoints, BOXES_OPTION: command.boxes, SKELETONS_OPTION: command.skeletons}
    files = {option: Path(value) for option, value in named.items() if value}
    tasks = planned(command, work, PLAYERS_STAGE, files=files, suffixes=FILE_SUFFIXES, for_every_clip=True)
    if not tasks:
        return NOTHING_USABLE
    scene, loaded = scene_of(command.scene, work, tasks)
    if not loaded.players:
        raise option_error("--scene", expected="a scene with player objects", got=loaded.name)
    options = PlayersOptions(
        scene=scene,
        quality=command.quality,
        people=command.people,
        detector=command.detector,
        pose=command.pose,
        joints=command.joints,
        first_number=command.first_number,
        overlay=command.overlay,
    )
    from pgm_data.stages.players_identity import name_players

    rows = carried_out(
        command,
        work,
        PLAYERS_STAGE,
        tasks,
        options=options,
        used=("scene", "detector", "pose"),
        line=line,
        after=lambda rows: name_players(work, rows, loaded),
    )
    return told(command, work, rows, TELLING)


def _cells(own: "PlayersOutcome") -> tuple[object, ...]:
    def each(counts: tuple[int, ...]) -> str:
        return " / ".join(f"{100 * count / max(own.with_camera, 1):.0f} %" for count in counts) or "-"

    times = (own.find_s, own.pose_s, own.lift_s)
    return (
        own.clip_id, own.state, own.frames, own.with_camera, each(own.seen), each(own.measured), each(own.filled),
        own.reprojection_px, *times, short(own.reason),
    )  # fmt: skip


TELLING = Telling(
    header=(
        "clip", "state", "frames", "with camera", "seen", "measured", "filled", "px", "find s", "pose s", "place s",
        "trouble",
    ),
    cells=_cells,
    nothing="no player was placed in any clip",
)  # fmt: skip
