"""What is marked in a clip's pictures, as annotation programs know it: points, boxes, events, texts.

A machine's labels go out to such a program, a person mends them there, and they come back as the same struct. Frames
are those of the whole video; pixels are ours (the centre of the top-left one is (0, 0)).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.clip_ball import BALL_TABLES, read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_captions import read_clip_captions
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.geometry.camera import project
from pgm_data.scene import Scene

COURT_EVERY = 50
"""Frames of a clip from one in which court points go out to the next; programs draw straight lines between."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipLabels:
    """Labels of one clip; each kind a struct of arrays, in order of frames within a name."""

    video: str
    """The video's path as the clip names it."""
    size: tuple[int, int]
    """Width and height, px."""
    first_frame: int
    """Of the video, that the clip begins with."""
    frames: int
    """Of the clip."""
    point_name: Shaped[np.ndarray, " points"]
    """Points of the court."""
    point_frame: Int[np.ndarray, " points"]
    point_px: Float[np.ndarray, "points 2"]
    box_name: Shaped[np.ndarray, " boxes"]
    """Player objects."""
    box_frame: Int[np.ndarray, " boxes"]
    box_px: Float[np.ndarray, "boxes 4"]
    ball_frame: Int[np.ndarray, " balls"]
    ball_px: Float[np.ndarray, "balls 2"]
    event_frame: Int[np.ndarray, " events"]
    event_kind: Shaped[np.ndarray, " events"]
    text_name: Shaped[np.ndarray, " texts"]
    """Player object that the text is about."""
    text_start: Int[np.ndarray, " texts"]
    text_end: Int[np.ndarray, " texts"]
    """Frame after the last."""
    text: Shaped[np.ndarray, " texts"]
    ui_px: Float[np.ndarray, "graphics 4"]
    """Graphics over the picture, the whole clip long."""


def clip_labels(folder: Path, scene: Scene) -> ClipLabels:
    """All that the clip's folder says of its pictures.

    Raises:
        ValueError: If a file of the clip cannot be read.
    """
    document = read_document(folder / "clip.json", "clip")
    clip = read_clip_camera(folder)
    video_frame = np.asarray(clip.video_frame, dtype=np.int64)
    names = np.zeros(0, dtype=object)
    values: dict = {
        "box_name": names, "box_frame": np.zeros(0, np.int64), "box_px": np.zeros((0, 4)),
        "ball_frame": np.zeros(0, np.int64), "ball_px": np.zeros((0, 2)),
        "event_frame": np.zeros(0, np.int64), "event_kind": names,
        "text_name": names, "text_start": np.zeros(0, np.int64), "text_end": np.zeros(0, np.int64), "text": names,
    }  # fmt: skip
    if scene.players and (folder / "players.parquet").is_file():
        tracks = read_clip_players(folder, scene).players
        there = [np.flatnonzero(np.isfinite(track.box_px).all(axis=1)) for track in tracks]
        values["box_name"] = np.array(
            [track.name for track, rows in zip(tracks, there, strict=True) for _ in rows], dtype=object
        )
        values["box_frame"] = np.concatenate([video_frame[rows] for rows in there])
        values["box_px"] = np.concatenate([track.box_px[rows] for track, rows in zip(tracks, there, strict=True)])
    if scene.ball is not None and all((folder / f"{name}.parquet").is_file() for name in BALL_TABLES):
        ball = read_clip_ball(folder, clip.capture_time)
        seen = np.flatnonzero(np.isfinite(ball.pixel).all(axis=1))
        values["ball_frame"], values["ball_px"] = video_frame[seen], ball.pixel[seen]
        frames = np.abs(clip.capture_time[None] - ball.events.time[:, None]).argmin(axis=1)
        values["event_frame"] = video_frame[frames]
        values["event_kind"] = np.asarray(ball.events.kind, dtype=object)
    if scene.players and (folder / "captions.parquet").is_file():
        said = read_clip_captions(folder)
        main = np.flatnonzero(said.alternative == 0)
        values["text_name"] = np.array([scene.players[i].name for i in said.player[main]], dtype=object)
        values["text_start"] = video_frame[0] + said.start_frame[main]
        values["text_end"] = video_frame[0] + said.end_frame[main]
        values["text"] = said.text[main]
    return ClipLabels(
        video=str(document["source_path"]),
        size=(document["width"], document["height"]),
        first_frame=int(document["first_video_frame"]),
        frames=int(document["n_frames"]),
        ui_px=np.array(document["ui_boxes_px"], dtype=float).reshape(-1, 4),
        **court_points(clip, scene, (document["width"], document["height"])),
        **values,
    )


def court_points(clip: ClipCamera, scene: Scene, size: tuple[int, int]) -> dict:
    """Columns of the court's points inside of the pictures, every so many frames that have a camera."""
    with_camera = np.flatnonzero(clip.has_camera)
    chosen = np.unique(np.r_[with_camera[:1], with_camera[::COURT_EVERY], with_camera[-1:]]).astype(np.int64)
    if scene.court is None or not len(chosen):
        return {"point_name": np.zeros(0, object), "point_frame": np.zeros(0, np.int64), "point_px": np.zeros((0, 2))}
    pixels, _ = project(clip.camera[chosen], scene.court.points_world)
    inside = np.isfinite(pixels).all(axis=-1) & ((pixels >= -0.5) & (pixels < np.array(size) - 0.5)).all(axis=-1)
    name, frame = np.nonzero(inside.T)
    return {
        "point_name": np.array(scene.court.point_names, dtype=object)[name],
        "point_frame": np.asarray(clip.video_frame, dtype=np.int64)[chosen[frame]],
        "point_px": pixels[frame, name],
    }


def spans(frames: Int[np.ndarray, " frames"], words: Shaped[np.ndarray, " frames"]) -> list[tuple[int, int, str]]:
    """Runs of following frames that have the same words: first frame, frame after the last, words; empty ones not."""
    found: list[tuple[int, int, str]] = []
    for frame, word in sorted(zip(frames.tolist(), words.tolist(), strict=True)):
        if not word:
            continue
        if found and found[-1][1] == frame and found[-1][2] == word:
            found[-1] = (found[-1][0], frame + 1, word)
        else:
            found.append((frame, frame + 1, word))
    return found
