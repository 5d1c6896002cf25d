"""States that no simulator made, written as clips of truth: bodies that wave, a ball that hops, words about both."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack, rotation_towards
from pgm_data.simulate.rotations import about, facing
from pgm_data.simulate.states import BallEvent, BallFlight, BallStates, Caption, PlayerStates, ShotStates
from pgm_data.simulate.store import write_camera_truth, write_clip_truth
from pgm_data.simulate.truth_tables import write_states

SIZE = (1280, 720)
TEXTS = ("runs to the left and hits a forehand down the line", "moves left", "plays a forehand")


def player_states(scene: Scene, player: int, times: np.ndarray, rng: np.random.Generator) -> PlayerStates:
    """A body that waves all its joints while it walks along its end of the court."""
    skeleton = scene.players[player].skeleton
    assert skeleton is not None
    count = len(skeleton.joint_names)
    phase = rng.uniform(0, 6, count)
    rotations = np.stack([about(j % 3, 0.4 * np.sin(2 * times + phase[j])) for j in range(count)], axis=1)
    rotations[:, 0] = facing(np.pi * player + 0.3 * np.sin(times))
    translations = np.tile(skeleton.rest_translations, (len(times), 1, 1))
    end = -12.0 if player == 0 else 12.0
    translations[:, 0] = np.stack([np.sin(times), np.full(len(times), end), np.full(len(times), 0.95)], axis=-1)
    R, joints = rotations.copy(), translations.copy()
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            joints[:, joint] = joints[:, parent] + np.einsum("nij,nj->ni", R[:, parent], translations[:, joint])
            R[:, joint] = R[:, parent] @ R[:, joint]
    return PlayerStates(
        identity=f"person {player}",
        handedness="left" if player else "right",
        rotations=rotations,
        translations=translations,
        joints=joints,
        contact=rng.random((len(times), 2)) > 0.5,
        keypoints=joints[:, rng.integers(0, count, len(skeleton.keypoint_names))] + 0.05,
        hull_centres=joints,
        hull_radii=np.full(count, 0.1),
    )


def shot_states(scene: Scene, times: np.ndarray, rng: np.random.Generator, *, spans: int = 6) -> ShotStates:
    """States at the times of what the scene declares."""
    players = tuple(player_states(scene, i, times, rng) for i in range(len(scene.players)))
    starts = np.linspace(times[0], times[-1], spans) if len(times) > 1 else times
    captions = tuple(
        Caption(player=i % len(players), start_s=float(start), end_s=float(start) + 0.6, texts=TEXTS)
        for i, start in enumerate(starts if players else ())
    )
    if scene.ball is None:
        return ShotStates(players=players, ball=None, events=(), flights=(), captions=captions)
    position = np.stack([np.sin(times), -11 + times, 1 + 0.5 * np.sin(5 * times)], axis=-1)
    velocity = np.stack([np.cos(times), np.ones(len(times)), 2.5 * np.cos(5 * times)], axis=-1)
    if len(times) > 10:
        position[:2] = velocity[:2] = np.nan  # not there yet
    kinds = ("first", "hit", "bounce", "hit", "net", "last") if len(times) > 1 else ("first",)
    events = tuple(
        BallEvent(time=float(t), kind=kind, player="player0" if kind == "hit" else "", position=np.array([0, 0, 1.0]))
        for t, kind in zip(np.linspace(times[0], times[-1], len(kinds)), kinds, strict=True)
    )
    flights = tuple(
        BallFlight(
            start_event=i,
            end_event=i + 1,
            player=events[i].player,
            start_speed=30.0,
            spin=np.array([100.0, -50.0, 10.0]),
            drag_per_m=0.02,
            landing=np.array([1.0, 5.0, 0.03]) if i % 2 else np.full(3, np.nan),
            lands_in=(True, False, None)[i % 3],
        )
        for i in range(len(events) - 1)
    )
    ball = BallStates(position=position, velocity=velocity)
    return ShotStates(players=players, ball=ball, events=events, flights=flights, captions=captions)


def broadcast_track(frames: int, *, k1: float = -0.05) -> CameraTrack:
    """A camera behind the near end that zooms in."""
    R = np.tile(rotation_towards(np.array([0.0, 33.0, -8.0]), 0.01), (frames, 1, 1))
    K = np.zeros((frames, 3, 3))
    K[:, 0, 0] = K[:, 1, 1] = np.linspace(1500, 1600, frames)
    K[:, 0, 2], K[:, 1, 2], K[:, 2, 2] = 639.5, 359.5, 1.0
    distortion = np.tile([k1, 0.0, 0.0, 0.0], (frames, 1))
    return CameraTrack(K=K, distortion=distortion, R_cam_from_world=R, t_cam_from_world=-R @ np.array([0, -33.0, 9.0]))


def write_truth_clip(
    folder: Path,
    scene: Scene,
    *,
    frames: int = 30,
    match_id: str = "match",
    seed: int = 0,
    fps: float = 25.0,
    video: Path | None = None,
    without: Sequence[str] = (),
    first_video_frame: int = 0,
) -> ShotStates:
    """Write a clip of truth of the folder's name; `without` names tables that are left out."""
    times = (first_video_frame + np.arange(frames)) / fps
    track = broadcast_track(frames)
    states = shot_states(scene, times, np.random.default_rng(seed))
    folder.mkdir(parents=True)
    write_clip_truth(
        folder,
        clip_id=folder.name,
        match_id=match_id,
        video=video or folder / "never drawn.mp4",
        source_path=f"../videos/{video.name}" if video else "../videos/never_drawn.mp4",
        scene=scene,
        size=SIZE,
        first_video_frame=first_video_frame,
        track=track,
        lens_reason="made up",
        shutter_s=0.01,
        ui_boxes_px=[[10, 10, 200, 60]],
        players={
            player.name: {"identity": truth.identity, "handedness": truth.handedness}
            for player, truth in zip(scene.players, states.players, strict=True)
        },
    )
    write_camera_truth(
        folder,
        clip_id=folder.name,
        scene=scene,
        track=track,
        timestamps=times,
        first_video_frame=first_video_frame,
    )
    write_states(
        folder,
        clip_id=folder.name,
        scene=scene,
        states=states,
        track=track,
        timestamps=times,
        capture_times=times,
        first_video_frame=first_video_frame,
        size=SIZE,
    )
    for table in without:
        (folder / f"{table}.parquet").unlink()
    return states
