"""How players are found and placed, and what became of each clip."""

from dataclasses import dataclass
from typing import Literal

Quality = Literal["draft", "standard", "best"]
People = Literal["auto", "network", "motion", "both"]
KEYPOINTS_OPTION, BOXES_OPTION, SKELETONS_OPTION = "--keypoints", "--boxes", "--skeletons"


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayersOptions:
    """How players are found and placed."""

    scene: str = "tennis"
    """Name of a scene that ships with pgm, or the path of a scene file."""
    quality: Quality = "standard"
    """draft browses an archive, standard is for work, best for publishing."""
    people: People = "auto"
    """What finds people; auto takes what the quality asks for, motion needs no network."""
    detector: str = ""
    """ONNX file of a person detector (YOLOX, RTMDet) to use besides motion instead of the bundled network."""
    pose: str = ""
    """File of a pose network (RTMPose, ViTPose as ONNX, BlazePose as TFLite) instead of the fetched one."""
    joints: bool = True
    """Whether body points are looked for; else players are placed by their boxes alone."""
    first_number: int = -1
    """What another program's files call the video's first frame; -1 where they tell by themselves."""
    overlay: bool = True
    """Whether overlay.mp4 is drawn anew, with the players in it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayersOutcome:
    """What became of one clip."""

    clip_id: str
    state: Literal["ok", "no players", "failed"]
    reason: str
    frames: int = 0
    with_camera: int = 0
    """Frames that have a camera."""
    seen: tuple[int, ...] = ()
    """Frames with a box, of each player object."""
    measured: tuple[int, ...] = ()
    """Frames placed by their own pixels, of each player object."""
    filled: tuple[int, ...] = ()
    """Frames placed between others, of each player object."""
    joints: bool = False
    """Whether skeletons stand in the table, or roots alone."""
    reprojection_px: float | None = None
    """Median over frames and players."""
    find_s: float = 0.0
    pose_s: float = 0.0
    lift_s: float = 0.0
