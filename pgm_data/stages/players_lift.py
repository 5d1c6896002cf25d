"""Players placed in metres, as the rows of their table."""

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.lift.camera_doubt import CameraDoubt
from pgm_data.lift.players.register import register_options, register_player
from pgm_data.lift.players.solution import PlayerMotion
from pgm_data.lift.players.view import PlayerView
from pgm_data.people import PlayerBoxes, PlayerPoses
from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton
from pgm_data.stages.players_options import Quality
from pgm_data.stages.players_withheld import without_buried


def placed_players(
    clip: ClipCamera,
    boxes: PlayerBoxes,
    poses: PlayerPoses,
    *,
    scene: Scene,
    quality: Quality,
    doubt: CameraDoubt,
) -> tuple[PlayerMotion, ...]:
    """The motion of every player object of the scene."""
    motions = []
    for number, player in enumerate(scene.players):
        assert player.skeleton is not None
        known = [place for place, name in enumerate(poses.point_names) if name in player.skeleton.point_names]
        view = PlayerView(
            camera=clip.camera,
            has_camera=clip.has_camera,
            times=clip.capture_time,
            is_duplicate=clip.is_duplicate,
            point_names=tuple(poses.point_names[place] for place in known),
            points_px=poses.points_px[:, number][:, known],
            sigma_px=poses.sigma_px[:, number][:, known],
            score=poses.score[:, number][:, known],
            points_ray=poses.points_ray[:, number][:, known],
            boxes_px=boxes.boxes_px[:, number],
            ground_world=boxes.ground_world[:, number],
        )
        motion = register_player(
            player.name,
            view,
            skeleton=player.skeleton,
            height_m=scene.person_height_m,
            doubt=doubt,
            options=register_options(quality),
        )
        motions.append(without_buried(motion, player.region_m[0][2]) if player.region_m else motion)
    return tuple(motions)


def clip_players(
    clip: ClipCamera,
    boxes: PlayerBoxes,
    poses: PlayerPoses,
    motions: tuple[PlayerMotion, ...],
    *,
    scene: Scene,
) -> ClipPlayers:
    """The table of a clip's players; who they are is not known yet."""
    frames = len(clip.video_frame)
    tracks = []
    for number, (player, motion) in enumerate(zip(scene.players, motions, strict=True)):
        assert player.skeleton is not None
        points, score = keypoint_set(player.skeleton, poses, number)
        tracks.append(
            PlayerTrack(
                name=player.name,
                identity=np.full(frames, "", dtype=object),
                box_px=boxes.boxes_px[:, number],
                keypoints_px=points,
                keypoint_score=score,
                root_position=motion.root_position,
                joints=motion.joints,
                joint_rotations=motion.joint_rotations,
                joint_translations=motion.joint_translations,
                root_cov=motion.root_cov,
                contact=motion.contact,
                reprojection_px=motion.reprojection_px,
                status=motion.status,
            )
        )
    return ClipPlayers(
        clip_id=clip.clip_id, video_frame=clip.video_frame, timestamp=clip.timestamp, players=tuple(tracks)
    )


def keypoint_set(skeleton: Skeleton, poses: PlayerPoses, player: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels and scores of the skeleton's keypoint set; NaN of points that were not looked for."""
    frames, names = len(poses.points_px), skeleton.keypoint_names
    points, score = np.full((frames, len(names), 2), np.nan), np.full((frames, len(names)), np.nan)
    known = [(row, poses.point_names.index(name)) for row, name in enumerate(names) if name in poses.point_names]
    if known:
        to, source = np.array(known).T
        points[:, to], score[:, to] = poses.points_px[:, player, source], poses.score[:, player, source]
    return points, score
