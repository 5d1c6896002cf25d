"""Generated play as an ordinary work folder, as a simulator without pictures writes one.

Nothing was measured, so players and ball have the status `filled` wherever they are, and cameras `interpolated`; which
values the prompt gave stands in `run.json`, and the prompt itself beside each clip's tables. Covariances say how rough
generated paths are: the ball's, by how much its positions and velocities disagree; those of players' roots, by how far
each position is from the middle of its neighbours'. What a prompt fixed is certain.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows, write_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera, write_clip_camera
from pgm_data.dataset.clip_captions import CaptionRows, write_clip_captions
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack, write_clip_players
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.tables import write_table
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton
from pgm_models.animation.ball_contacts import one_clip
from pgm_models.animation.play_camera import PlayCamera, body_points, boxes, inside
from pgm_models.animation.prompt import Prompt, prompt_to_json

TIME_BASE = "1/90000"
NO_CAMERA = "generated play, which no camera filmed"
PROMPT_NAME = "prompt.json"
"""File of a clip's folder with the prompt and the seed that made it."""
NORMAL_SPREAD = 1.4826
"""Standard deviation of a normal distribution over the median of its distances from 0."""


@dataclass(frozen=True, kw_only=True)
class ClipNames:
    """What a clip is called."""

    clip_id: str
    match_id: str
    """Of all plays of one prompt: splits never divide them."""


def write_play(
    folder: Path,
    names: ClipNames,
    prompt: Prompt,
    columns: Mapping[str, Float[np.ndarray, "frames _"]],
    known: Mapping[str, np.ndarray],
    *,
    scene: Scene,
    view: PlayCamera | None,
) -> None:
    """Write a clip's document and tables into its folder.

    Args:
        folder: Of the clip; made where it is not there.
        names: Of the clip and its match.
        prompt: What was asked for; its texts become captions of the source `human`.
        columns: Of the contract, in its units, as `encode.decode` gives them.
        known: By column, which frames of it the prompt fixed; those that are absent, none.
        scene: What is played.
        view: Camera of every frame; None for none, and then nothing has a place in a picture.

    Raises:
        ValueError: If columns and prompt differ in length, or the scene is another one.
    """
    frames = prompt.frames
    for name, values in columns.items():
        if len(values) != frames:
            raise ValueError(f"{names.clip_id}: {name}: expected {frames} rows, got {len(values)}")
    if scene.name != prompt.scene:
        raise ValueError(f"{names.clip_id}: scene: expected {prompt.scene}, got {scene.name}")
    times = np.arange(frames) / prompt.rate
    players, ball = one_clip(_whole(columns, scene, frames), times, scene, clip_id=names.clip_id)
    folder.mkdir(parents=True, exist_ok=True)
    write_clip_camera(folder, _cameras(names.clip_id, times, view), scene=scene)
    if scene.players:
        write_clip_players(folder, _seen_players(players, known, scene, view), scene=scene)
        write_clip_captions(folder, names.clip_id, captions_of(prompt), scene=scene)
    if scene.ball is not None:
        free = ~known.get("ball.position", np.zeros(frames, dtype=bool))
        made = ball if ball is not None else _absent_ball(names.clip_id, times)
        write_clip_ball(folder, _seen_ball(made, free * ball_spread(columns, times), view), scene=scene)
    write_document(folder / PROMPT_NAME, "prompt", prompt_to_json(prompt))
    write_document(folder / "clip.json", "clip", _document(names, prompt, view))


def ball_spread(columns: Mapping[str, Float[np.ndarray, "frames _"]], times: Float[np.ndarray, " frames"]) -> float:
    """How far the ball's steps and its mean velocities over them disagree along an axis, metres: a robust deviation.

    0 where there are fewer than two frames of both.
    """
    if not all(name in columns for name in ("ball.position", "ball.velocity")) or len(times) < 2:
        return 0.0
    position, velocity = columns["ball.position"], columns["ball.velocity"]
    flown = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(times)[:, None]
    apart = np.abs(np.diff(position, axis=0) - flown)
    apart = apart[np.isfinite(apart)]
    return NORMAL_SPREAD * float(np.median(apart)) if len(apart) else 0.0


def path_spread(position: Float[np.ndarray, "frames 3"]) -> Float[np.ndarray, " 3"]:
    """How far positions stray from the line between their neighbours, of each axis, metres: a robust deviation.

    That of white noise on a path that is straight from frame to frame; what the path bends by counts as well.
    0 where fewer than three frames follow each other.
    """
    apart = np.abs(position[2:] - 2 * position[1:-1] + position[:-2])
    apart = apart[np.isfinite(apart).all(axis=1)]
    return NORMAL_SPREAD * np.median(apart, axis=0) / 6**0.5 if len(apart) else np.zeros(3)


def captions_of(prompt: Prompt) -> CaptionRows:
    """The prompt's texts as captions, in order of player and time."""
    texts = sorted(prompt.texts, key=lambda text: (text.player, text.start))
    start, end = np.array([t.start for t in texts], np.int64), np.array([t.end for t in texts], np.int64)
    return CaptionRows(
        player=np.array([text.player for text in texts], dtype=np.int64),
        start_frame=start,
        end_frame=end,
        start_s=start / prompt.rate,
        end_s=end / prompt.rate,
        text=np.array([text.text for text in texts], dtype=object),
        source=np.full(len(texts), "human", dtype=object),
        alternative=np.zeros(len(texts), dtype=np.int64),
    )


def write_play_shots(out: Path, clips: Sequence[str], *, scene: Scene) -> None:
    """Write `shots.parquet` of a work folder: every frame of the clips with these names, whose tables are there."""
    tracks = [read_clip_camera(out / clip_id) for clip_id in clips]
    columns = {
        "video": [_source(track.clip_id) for track in tracks for _ in track.video_frame],
        "video_frame": np.concatenate([track.video_frame for track in tracks]),
        "timestamp": np.concatenate([track.timestamp for track in tracks]),
        "verdict": ["clip" for track in tracks for _ in track.video_frame],
        "reason": ["" for track in tracks for _ in track.video_frame],
        "clip_id": [track.clip_id for track in tracks for _ in track.video_frame],
    }
    write_table(out / "shots.parquet", table="shots", scene=scene, columns=columns)


def _source(clip_id: str) -> str:
    """Where the clip's video would be."""
    return f"../videos/{clip_id}.mp4"


def _whole(
    columns: Mapping[str, Float[np.ndarray, "frames _"]], scene: Scene, frames: int
) -> dict[str, Float[np.ndarray, "frames _"]]:
    """The columns, and NaN in those of players that the model does not know."""
    whole = dict(columns)
    for player in scene.players:
        assert player.skeleton is not None  # scene files give every player one
        wide = 3 * len(player.skeleton.parents)
        parts = {"root_position": 3, "joints": wide, "joint_rotations": wide, "joint_translations": wide}
        for part, width in parts.items():
            whole.setdefault(f"{player.name}.{part}", np.full((frames, width), np.nan))
    return whole


def _cameras(clip_id: str, times: Float[np.ndarray, " frames"], view: PlayCamera | None) -> ClipCamera:
    rows = len(times)
    nowhere = Camera(
        K=np.full((rows, 3, 3), np.nan),
        distortion=np.full((rows, 4), np.nan),
        R_cam_from_world=np.full((rows, 3, 3), np.nan),
        t_cam_from_world=np.full((rows, 3), np.nan),
    )
    reason = NO_CAMERA if view is None else f"chosen for generated play: {view.reason}"
    return ClipCamera(
        clip_id=clip_id,
        video_frame=np.arange(rows),
        timestamp=times,
        is_duplicate=np.zeros(rows, dtype=bool),
        capture_time=times,
        camera=nowhere if view is None else view.camera,
        status=np.full(rows, "none" if view is None else "interpolated", dtype=object),
        reason=np.full(rows, reason, dtype=object),
        inliers=np.zeros(rows, dtype=np.int64),
        reprojection_px=np.full(rows, np.nan),
        position_cov=np.full((rows, 6), np.nan if view is None else 0.0),
        focal_std_px=np.full(rows, np.nan if view is None else 0.0),
    )


def _seen_players(
    clip: ClipPlayers, known: Mapping[str, np.ndarray], scene: Scene, view: PlayCamera | None
) -> ClipPlayers:
    tracks = []
    for track, player in zip(clip.players, scene.players, strict=True):
        free = ~known.get(f"{player.name}.root_position", np.zeros(len(track.status), dtype=bool))
        tracks.append(_seen_player(track, free, player.skeleton, view))
    return replace(clip, players=tuple(tracks))


def _seen_player(
    track: PlayerTrack, free: Bool[np.ndarray, " frames"], skeleton: Skeleton | None, view: PlayCamera | None
) -> PlayerTrack:
    """The track with what the camera sees of the body, and its covariance where nobody fixed it."""
    assert skeleton is not None  # scene files give every player one
    rows, points = len(track.status), len(skeleton.keypoint_names)
    spread = np.diag(path_spread(track.root_position) ** 2)
    unsure = replace(
        track,
        root_cov=np.where((track.status != "none")[:, None, None], free[:, None, None] * spread, np.nan),
        keypoints_px=np.full((rows, points, 2), np.nan),
        keypoint_score=np.full((rows, points), np.nan),
    )
    if view is None:
        return unsure
    joints, named = body_points(skeleton, track.joint_rotations, track.joint_translations)
    pixels, _ = project(view.camera, named[:, skeleton.keypoints])
    return replace(
        unsure,
        box_px=boxes(view, np.concatenate([joints, named], axis=1)),
        keypoints_px=pixels,
        keypoint_score=inside(pixels, view.size),
    )


def _seen_ball(ball: ClipBall, spread: Float[np.ndarray, " frames"], view: PlayCamera | None) -> ClipBall:
    """The ball with what the camera sees of it, and its covariance."""
    there = np.asarray(ball.status != "none")
    cov = np.where(there, spread**2, np.nan)[:, None, None] * np.eye(3)
    if view is None:
        return replace(ball, position_cov=cov)
    pixel = project(view.camera, ball.position[:, None])[0][:, 0]
    score = inside(pixel, view.size)
    return replace(ball, position_cov=cov, pixel=np.where(score[:, None] > 0, pixel, np.nan), score=score)


def _absent_ball(clip_id: str, times: Float[np.ndarray, " frames"]) -> ClipBall:
    """No ball, in a scene that has one but whose model does not know it."""
    rows = len(times)
    none, vectors = np.zeros(0), np.zeros((0, 3))
    words = np.zeros(0, dtype=object)
    return ClipBall(
        clip_id=clip_id,
        video_frame=np.arange(rows),
        timestamp=times,
        capture_time=times,
        pixel=np.full((rows, 2), np.nan),
        score=np.full(rows, np.nan),
        position=np.full((rows, 3), np.nan),
        velocity=np.full((rows, 3), np.nan),
        position_cov=np.full((rows, 3, 3), np.nan),
        status=np.full(rows, "none", dtype=object),
        events=EventRows(time=none, kind=words, player=words, probability=none, source=words, position=vectors),
        shots=ShotRows(
            start_event=np.zeros(0, dtype=np.int64),
            end_event=np.zeros(0, dtype=np.int64),
            player=words,
            start_speed=none,
            spin=vectors,
            spin_std=vectors,
            drag_per_m=none,
            drag_std_per_m=none,
            landing_position=vectors,
            in_probability=none,
            free_parameters=words,
            residual_px=none,
            status=words,
        ),
    )


def _document(names: ClipNames, prompt: Prompt, view: PlayCamera | None) -> dict[str, object]:
    width, height = (1, 1) if view is None else view.size
    return {
        "clip_id": names.clip_id,
        "match_id": names.match_id,
        "source_path": _source(names.clip_id),
        # As a simulator has it that drew no pictures.
        "sha256": hashlib.sha256().hexdigest(),
        "bytes": 0,
        "width": width,
        "height": height,
        "time_base": TIME_BASE,
        "first_video_frame": 0,
        "n_frames": prompt.frames,
        "scene": prompt.scene,
        "quality": "generated",
        "lens_model": None if view is None else {"model": "opencv_k1", "reason": view.reason},
        "shutter_s": None,
        "ui_boxes_px": [],
        "players": {},
        "solved_share": 0.0 if view is None else 1.0,
    }
