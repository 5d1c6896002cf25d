"""The players found in a clip's pictures: who is where, the points of their bodies, what they look like."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonFinder
from pgm_data.detect.pose.model import PoseModel
from pgm_data.people import PlayerBoxes, PlayerLooks, PlayerPoses
from pgm_data.scene import Scene
from pgm_data.stages.clip_pictures import ClipPictures
from pgm_data.stages.players_options import BOXES_OPTION, KEYPOINTS_OPTION, SKELETONS_OPTION, PlayersOptions, Quality

if TYPE_CHECKING:
    from pgm_data.convert.foreign_people import PeopleOptions

NETWORK_EVERY: dict[Quality, int] = {"draft": 5, "standard": 3, "best": 2}
"""Pictures from one that the network looks at to the next; motion looks at all of them."""
POSE_EVERY: dict[Quality, int] = {"draft": 3, "standard": 1, "best": 1}
"""Pictures from one in which body points are looked for to the next."""


POSE_LOOKS: dict[Quality, int] = {"draft": 1, "standard": 1, "best": 2}
"""1: each person as it is; 2: mirrored too, and the two averaged."""


CONFIRMED_S = 0.5
"""A box whose body no network saw for longer than this before and after is nobody's."""
JUMP_M = 2.5
FASTEST_M_S = 10.0
"""A player who moves by more than `JUMP_M` and what this speed gives has not run there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FoundPlayers:
    """What a clip's pictures show of its players."""

    boxes: PlayerBoxes
    poses: PlayerPoses
    looks: PlayerLooks
    cut: Bool[np.ndarray, " frames"]
    """Whether each frame is the first after a cut within the clip, which shows the players at other places."""
    said: str
    """Why there are no body points; empty where there are."""
    find_s: float
    pose_s: float


def person_finders(options: PlayersOptions, threads: int) -> tuple[PersonFinder, ...]:
    """The detectors of people that the options ask for.

    Raises:
        FileNotFoundError, ValueError: If a network is not there or is none.
    """
    from pgm_data.detect.players.motion import MotionPeople

    if options.detector:
        from pgm_data.detect.players.onnx_people import OnnxPeople

        return MotionPeople(), OnnxPeople.load(Path(options.detector), threads=threads)
    if options.people == "motion":
        return (MotionPeople(),)
    from pgm_data.detect.players.person_network import StripPeople

    network = StripPeople.load(None, threads=threads, every=NETWORK_EVERY[options.quality])
    return (network,) if options.people == "network" else (MotionPeople(), network)


def pose_model(options: PlayersOptions, threads: int) -> tuple[PoseModel | None, str]:
    """The network of body points, or why there is none.

    Raises:
        FileNotFoundError, ValueError: If a network is not there or is none.
    """
    if not options.joints:
        return None, "placed by boxes alone, as asked for"
    from pgm_data.detect.pose.load import load_pose_model

    model = load_pose_model(Path(options.pose) if options.pose else None, threads=threads)
    return model, "" if model is not None else "no pose weights here: `pgm weights pose` fetches them"


def found_players(
    pictures: ClipPictures,
    clip: ClipCamera,
    *,
    scene: Scene,
    options: PlayersOptions,
    files: dict[str, Path],
    finders: tuple[PersonFinder, ...],
    model: PoseModel | None,
    why_no_model: str,
) -> FoundPlayers:
    """The players of a clip, from its pictures or from another program's files about it.

    Args:
        pictures: The clip's.
        clip: Its frames and cameras.
        scene: What it shows.
        options: How.
        files: Another program's boxes, points or shapes, by the option that named them.
        finders: Detectors of people.
        model: Network of body points; None where there is none.
        why_no_model: Said then.

    Raises:
        ValueError: If a file is not what it must be.
        VideoError: If the video cannot be read.
    """
    started = time.monotonic()
    imported: PlayerPoses | None = None
    if KEYPOINTS_OPTION in files:
        from pgm_data.convert.coco_people import read_coco_people

        boxes, imported = read_coco_people(files[KEYPOINTS_OPTION], clip, scene.players, foreign(options, pictures))
    elif BOXES_OPTION in files:
        from pgm_data.convert.mot_boxes import read_mot_boxes

        boxes = read_mot_boxes(files[BOXES_OPTION], clip, scene.players, foreign(options, pictures))
    else:
        from pgm_data.detect.players.finder import find_players

        boxes = find_players(finders, pictures, clip, size=pictures.size, scene=scene)
    found = time.monotonic()
    said = ""
    if imported is not None:
        poses = imported
    elif model is not None and not _known_points(model, scene):
        poses, said = no_poses(boxes), f"the pose network knows no point of the skeletons of scene {scene.name}"
    elif model is not None:
        from pgm_data.detect.pose.estimate import PoseOptions, estimate_poses

        every = POSE_EVERY[options.quality]
        poses = estimate_poses(
            model, pictures, boxes, clip, options=PoseOptions(every=every, looks=POSE_LOOKS[options.quality])
        )
    else:
        poses, said = no_poses(boxes), why_no_model
    if imported is None and poses.point_names:
        boxes = confirmed(boxes, poses, clip.capture_time)
    if SKELETONS_OPTION in files:
        from pgm_data.stages.players_shapes import with_shapes

        poses = with_shapes(poses, files[SKELETONS_OPTION])
    from pgm_data.detect.players.looks import look

    cut = cuts(boxes, clip.capture_time)
    looks = look(pictures, boxes, poses if poses.point_names else None, clip, cut=cut)
    return FoundPlayers(
        boxes=boxes,
        poses=poses,
        looks=looks,
        cut=cut,
        said=said,
        find_s=found - started,
        pose_s=time.monotonic() - found,
    )


def _known_points(model: PoseModel, scene: Scene) -> set[str]:
    """Points of the network that a skeleton of the scene has."""
    names = [player.skeleton.point_names for player in scene.players if player.skeleton is not None]
    return set(model.point_names) & set(sum(names, ()))


def foreign(options: PlayersOptions, pictures: ClipPictures) -> "PeopleOptions":
    """How another program's file about a clip is to be read."""
    from pgm_data.convert.foreign_people import PeopleOptions

    width, height = pictures.size
    first = None if options.first_number < 0 else options.first_number
    return PeopleOptions(width=width, height=height, first_number=first)


def confirmed(boxes: PlayerBoxes, poses: PlayerPoses, times: Float[np.ndarray, " frames"]) -> PlayerBoxes:
    """The boxes without those in which the network of body points saw nobody, nor soon before or after."""
    there = np.asarray(boxes.status != "none", dtype=bool)
    found = np.asarray(poses.found.any(axis=-1))
    for player in range(len(boxes.names)):
        seen = times[found[:, player]]
        apart = np.abs(times[:, None] - seen[None]).min(axis=1, initial=np.inf)
        there[:, player] &= apart <= CONFIRMED_S
    blank = np.where(there, 0.0, np.nan)[..., None]
    return PlayerBoxes(
        names=boxes.names,
        boxes_px=boxes.boxes_px + blank,
        score=boxes.score + blank[..., 0],
        ground_world=boxes.ground_world + blank,
        status=np.where(there, boxes.status, "none").astype(object),
    )


def cuts(boxes: PlayerBoxes, times: Float[np.ndarray, " frames"]) -> Bool[np.ndarray, " frames"]:
    """Frames in which a player is farther from the last place than anybody could run: takes of one camera joined."""
    cut = np.zeros(len(times), dtype=bool)
    for player in range(len(boxes.names)):
        known = np.flatnonzero(np.isfinite(boxes.ground_world[:, player]).all(axis=1))
        moved = np.linalg.norm(np.diff(boxes.ground_world[known, player], axis=0), axis=1)
        cut[known[1:][moved > JUMP_M + FASTEST_M_S * np.diff(times[known])]] = True
    return cut


def no_poses(boxes: PlayerBoxes) -> PlayerPoses:
    """No body point at all."""
    shape = (*boxes.score.shape, 0)
    return PlayerPoses(
        names=boxes.names,
        point_names=(),
        points_px=np.zeros((*shape, 2)),
        score=np.zeros(shape),
        sigma_px=np.zeros(shape),
        points_ray=np.zeros((*shape, 3)),
    )
