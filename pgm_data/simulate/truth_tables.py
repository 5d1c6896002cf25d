"""The truth of players, ball and words as tables of the contract.

Everything is known, so status is `measured` wherever a thing is there at all, covariances and residuals are 0 and
probabilities 0 or 1. Pixels are projections by the camera that draws, at the frame's capture time, whether or not
something hides the thing; scores say whether the pixel lies inside of the picture (1) or not (0).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.dataset.clip_ball import SHOWN_FIRST, nearest_frames
from pgm_data.dataset.tables import Values, write_table
from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack, distorted
from pgm_data.simulate.rotations import to_axis_angle
from pgm_data.simulate.states import BallEvent, BallFlight, BallStates, Caption, PlayerStates, ShotStates

NOTHING = "none"

Columns = dict[str, Values]


def write_states(
    folder: Path,
    *,
    clip_id: str,
    scene: Scene,
    states: ShotStates,
    track: CameraTrack,
    timestamps: Float[np.ndarray, " frames"],
    capture_times: Float[np.ndarray, " frames"],
    first_video_frame: int,
    size: tuple[int, int],
) -> None:
    """Tables `players`, `ball`, `events`, `ball_shots` and `captions` of one clip: those whose things the states have.

    Args:
        folder: The clip's folder.
        clip_id: Its name.
        scene: What the clip shows.
        states: One row per frame of the clip; a repeated frame has its source's. Times are capture times.
        track: The clip's cameras.
        timestamps: Presentation times, s.
        capture_times: Capture times, s; a repeat has its source's.
        first_video_frame: The clip's first frame in its video.
        size: Width and height of the pictures, px.

    Raises:
        ValueError: If the states hold what the scene does not declare, or another number of frames than the track.
    """
    _check(clip_id, scene, states, len(track))
    count = len(track)
    index = np.arange(count, dtype=np.int64)
    keys: Columns = {
        "clip_id": [clip_id] * count,
        "frame_index": index,
        "video_frame": index + first_video_frame,
        "timestamp": timestamps,
    }
    tables: dict[str, Columns] = {}
    if states.players:
        tables["players"] = keys.copy()
        for player, truth in zip(scene.players, states.players, strict=True):
            tables["players"] |= player_columns(player.name, truth, track, size)
        tables["captions"] = caption_columns(clip_id, states.captions, capture_times)
    if states.ball is not None:
        nearest = nearest_frames(np.array([event.time for event in states.events], dtype=float), capture_times)
        tables["ball"] = keys | ball_columns(states.ball, track, size)
        tables["ball"]["ball.event"] = shown_events(states.events, nearest, count)
        tables["events"] = event_columns(clip_id, states.events, nearest)
        tables["ball_shots"] = flight_columns(clip_id, states.flights, states.events)
    folder.mkdir(parents=True, exist_ok=True)
    for table, columns in tables.items():
        write_table(folder / f"{table}.parquet", table=table, scene=scene, columns=columns)


def _check(clip_id: str, scene: Scene, states: ShotStates, frames: int) -> None:
    declared = [player.name for player in scene.players]
    if len(states.players) not in (0, len(declared)):
        raise ValueError(f"{clip_id}: states.players: expected one for each of {declared}, got {len(states.players)}")
    if states.ball is not None and scene.ball is None:
        raise ValueError(f"{clip_id}: states.ball: expected none, since scene {scene.name} declares no ball, got one")
    if states.captions and not states.players:
        raise ValueError(f"{clip_id}: states.captions: expected none without players, got {len(states.captions)}")
    if (states.events or states.flights) and states.ball is None:
        raise ValueError(f"{clip_id}: states.events: expected none without a ball, got {len(states.events)}")
    lengths = [len(player.joints) for player in states.players]
    lengths += [] if states.ball is None else [len(states.ball.position)]
    if any(length != frames for length in lengths):
        raise ValueError(f"{clip_id}: states: expected {frames} rows, one per frame of the track, got {lengths}")


def seen(
    points_world: Float[np.ndarray, "frames points 3"], track: CameraTrack
) -> tuple[Float[np.ndarray, "frames points 2"], Float[np.ndarray, "frames points"]]:
    """Pixels of each frame's points, and their depths, metres.

    Pixels are NaN behind the camera, without a camera, and so far to the side that the lens's formula folds back.
    """
    cam = points_world @ np.swapaxes(track.R_cam_from_world, -1, -2) + track.t_cam_from_world[:, None]
    depth = cam[..., 2]
    straight = cam[..., :2] / np.where(depth > 1e-6, depth, np.nan)[..., None]
    k1 = track.distortion[:, None, 0]
    straight[1.0 + 3.0 * k1 * np.sum(straight**2, axis=-1) <= 0.0] = np.nan
    focal, middle = track.K[:, None, [0, 1], [0, 1]], track.K[:, None, :2, 2]
    return focal * distorted(straight, k1) + middle, depth


def inside(pixels: Float[np.ndarray, "*rows 2"], size: tuple[int, int]) -> np.ndarray:
    """Whether pixels lie inside of a picture of width and height; False of NaN."""
    return np.all((pixels >= -0.5) & (pixels < np.array(size) - 0.5), axis=-1)


def player_columns(name: str, truth: PlayerStates, track: CameraTrack, size: tuple[int, int]) -> Columns:
    """Columns of one player object; NaN and status `none` in frames whose states are NaN."""
    count = len(truth.joints)
    there = np.all(np.isfinite(truth.joints), axis=(1, 2))
    zero = np.where(there, 0.0, np.nan)
    turns = to_axis_angle(truth.rotations)
    turns[~there] = np.nan
    pixels, _ = seen(truth.keypoints, track)
    values: Columns = {
        "identity": [truth.identity] * count,
        "box_px": boxes(truth, track),
        "keypoints_px": pixels,
        "keypoint_score": np.where(inside(pixels, size), 1.0, zero[:, None]),
        "root_position": truth.joints[:, 0],
        "root_rotation": turns[:, 0],
        "joints": truth.joints,
        "joint_rotations": turns,
        "joint_translations": np.where(there[:, None, None], truth.translations, np.nan),
        "root_cov": np.repeat(zero[:, None], 6, axis=1),
        "contact": np.where(there[:, None], truth.contact, np.nan),
        "reprojection_px": zero,
        "status": np.where(there, "measured", NOTHING).tolist(),
    }
    return {f"{name}.{column}": column_values for column, column_values in values.items()}


def boxes(truth: PlayerStates, track: CameraTrack) -> Float[np.ndarray, "frames 4"]:
    """Boxes x0, y0, x1, y1 around the hull's balls, px, not cut off at the picture's edge.

    NaN where a part of the body is not in front of the camera.
    """
    pixels, depth = seen(truth.hull_centres, track)
    reach = np.where(depth > truth.hull_radii, truth.hull_radii / depth, np.nan)[..., None]
    reach = reach * track.K[:, None, [0, 1], [0, 1]]
    return np.concatenate([(pixels - reach).min(axis=1), (pixels + reach).max(axis=1)], axis=-1)


def ball_columns(truth: BallStates, track: CameraTrack, size: tuple[int, int]) -> Columns:
    """Columns of the ball but its event; NaN and status `none` in frames without it."""
    there = np.all(np.isfinite(truth.position), axis=1)
    zero = np.where(there, 0.0, np.nan)
    pixel = seen(truth.position[:, None], track)[0][:, 0]
    shown = inside(pixel, size)
    return {
        "ball.pixel": np.where(shown[:, None], pixel, np.nan),
        "ball.score": np.where(shown, 1.0, zero),
        "ball.position": truth.position + zero[:, None],
        "ball.velocity": truth.velocity + zero[:, None],
        "ball.position_cov": np.repeat(zero[:, None], 6, axis=1),
        "ball.status": np.where(there, "measured", NOTHING).tolist(),
    }


def shown_events(events: Sequence[BallEvent], nearest: Int[np.ndarray, " events"], frames: int) -> list[str]:
    """The kind of event each frame is nearest to, or `none`; by `SHOWN_FIRST` where there are several."""
    words = [NOTHING] * frames
    for kind in reversed(SHOWN_FIRST):
        for event, frame in zip(events, nearest, strict=True):
            if event.kind == kind:
                words[frame] = kind
    return words


def event_columns(clip_id: str, events: Sequence[BallEvent], nearest: Int[np.ndarray, " events"]) -> Columns:
    """Columns of the events."""
    return {
        "clip_id": [clip_id] * len(events),
        "time": np.array([event.time for event in events], dtype=float),
        "frame_index": nearest,
        "kind": [event.kind for event in events],
        "player": [event.player for event in events],
        "probability": np.ones(len(events)),
        "source": ["simulated"] * len(events),
        "position": np.array([event.position for event in events], dtype=float).reshape(-1, 3),
    }


def flight_columns(clip_id: str, flights: Sequence[BallFlight], events: Sequence[BallEvent]) -> Columns:
    """Columns of the flights; nothing was fitted, so no parameter is free and no residual is left."""
    zero = np.zeros(len(flights))
    lands_in = [np.nan if flight.lands_in is None else float(flight.lands_in) for flight in flights]
    return {
        "clip_id": [clip_id] * len(flights),
        "start_event": np.array([flight.start_event for flight in flights], dtype=np.int64),
        "end_event": np.array([flight.end_event for flight in flights], dtype=np.int64),
        "start_time": np.array([events[flight.start_event].time for flight in flights], dtype=float),
        "end_time": np.array([events[flight.end_event].time for flight in flights], dtype=float),
        "player": [flight.player for flight in flights],
        "start_speed": np.array([flight.start_speed for flight in flights], dtype=float),
        "spin": np.array([flight.spin for flight in flights], dtype=float).reshape(-1, 3),
        "spin_std": np.zeros((len(flights), 3)),
        "drag_per_m": np.array([flight.drag_per_m for flight in flights], dtype=float),
        "drag_std_per_m": zero,
        "landing_position": np.array([flight.landing for flight in flights], dtype=float).reshape(-1, 3),
        "in_probability": np.array(lands_in, dtype=float),
        "free_parameters": [""] * len(flights),
        "residual_px": zero,
        "status": ["truth"] * len(flights),
    }


def caption_columns(clip_id: str, captions: Sequence[Caption], capture_times: Float[np.ndarray, " frames"]) -> Columns:
    """Columns of the captions: each span's texts, the main one first; spans without a frame are left out."""
    start_s = np.array([caption.start_s for caption in captions], dtype=float)
    end_s = np.array([caption.end_s for caption in captions], dtype=float)
    start, end = np.searchsorted(capture_times, start_s), np.searchsorted(capture_times, end_s)
    rows = [(i, k) for i, caption in enumerate(captions) if start[i] < end[i] for k in range(len(caption.texts))]
    span = np.array([i for i, _ in rows], dtype=np.int64)
    return {
        "clip_id": [clip_id] * len(rows),
        "player": np.array([captions[i].player for i, _ in rows], dtype=np.int32),
        "start_frame": start[span],
        "end_frame": end[span],
        "start_s": start_s[span],
        "end_s": end_s[span],
        "text": [captions[i].texts[k] for i, k in rows],
        "source": ["generated"] * len(rows),
        "alternative": np.array([k for _, k in rows], dtype=np.int32),
    }
