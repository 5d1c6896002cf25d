"""Frames of clips with a known ball: where it is, how it is smeared, and whether the picture shows it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.files import whole_file
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_models.detectors.ball_drawing import smear
from pgm_models.detectors.clip_pictures import FrameSet, Pictures, keep_pictures, video_pictures

UNKNOWN, ABSENT, SEEN = -1, 0, 1
"""Whether a frame's ball is to be found: neither asked for nor punished, not in the picture, to be found."""
LEAST_TRACE = 5.0
"""Grey values by which the ball must stand out, as a mean over its smeared disc."""
HELD_OUT_PART = 8
"""One match in so many is held out."""
WIDEST_PATCH = 60
"""Half the side of the largest piece in which a trace is looked for, pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallClip:
    """The distinct frames of one clip; pictures stay on disk."""

    clip_id: str
    pictures: Pictures
    ball_px: Float[np.ndarray, "frames 2"]
    """The ball's centre; NaN where there is none."""
    streak_px: Float[np.ndarray, "frames 2"]
    """Where it goes while the shutter is open."""
    radius_px: Float[np.ndarray, " frames"]
    """Half its width."""
    state: Int[np.ndarray, " frames"]
    """`SEEN`, `ABSENT` or `UNKNOWN`."""
    here_from_previous: Float[np.ndarray, "frames 3 3"]
    """Pixels of the frame before to pixels of this one, for what is far away; the first is the identity."""
    boxes_px: Float[np.ndarray, "frames players 4"]
    """Players: left, top, right, bottom; NaN where there is none."""

    def __len__(self) -> int:
        """Frames of the clip."""
        return len(self.pictures)


def turns(camera: Camera) -> Float[np.ndarray, "frames 3 3"]:
    """Pixels of each frame from those of the one before, by the camera's turn and zoom; the identity where unknown."""
    away = camera.K @ camera.R_cam_from_world
    maps = np.repeat(np.eye(3)[None], len(away), axis=0)
    known = np.asarray(np.isfinite(away).all(axis=(1, 2)))
    both = np.flatnonzero(known[1:] & known[:-1]) + 1
    found = away[both] @ np.linalg.inv(away[both - 1])
    maps[both] = found / found[:, 2:, 2:]
    return maps


def prepare_ball_clip(folder: Path, video: Path, cache: Path, scene: Scene) -> BallClip:
    """The clip's distinct frames, decoded once and kept under `cache`; read from there the next time.

    Raises:
        ValueError: If the scene has no ball, or tables and video do not belong together.
    """
    about = cache / f"{folder.name}.npz"
    jpegs = cache / f"{folder.name}.jpegs"
    if not about.exists():
        track = read_clip_camera(folder)
        distinct = np.flatnonzero(~track.is_duplicate)
        offsets = keep_pictures(jpegs, video_pictures(video, track.video_frame[distinct]))
        if len(offsets) - 1 != len(distinct):
            raise ValueError(
                f"{folder}: expected a picture for {len(distinct)} rows, got {len(offsets) - 1} from {video}"
            )
        truth = _truth(folder, track, distinct, scene)
        pictures = Pictures(jpegs=jpegs, offsets=offsets)
        truth["state"] = _states(pictures, truth)
        with whole_file(about) as temporary, temporary.open("wb") as file:
            kept = {name: values for name, values in truth.items() if name != "hidden"}
            np.savez(file, allow_pickle=False, offsets=offsets, **kept)
    with np.load(about) as kept:
        return BallClip(
            clip_id=folder.name,
            pictures=Pictures(jpegs=jpegs, offsets=kept["offsets"]),
            ball_px=kept["ball_px"],
            streak_px=kept["streak_px"],
            radius_px=kept["radius_px"],
            state=kept["state"],
            here_from_previous=kept["here_from_previous"],
            boxes_px=kept["boxes_px"],
        )


def _truth(folder: Path, track: ClipCamera, distinct: np.ndarray, scene: Scene) -> dict[str, np.ndarray]:
    """Pixel, streak, radius and whether hidden by body or hand, of the distinct frames."""
    if scene.ball is None:
        raise ValueError(f"scene {scene.name}: expected a ball, got none")
    ball = read_table(folder / "ball.parquet")
    if not np.array_equal(ball["video_frame"], track.video_frame):
        raise ValueError(f"{folder / 'ball.parquet'}: video_frame: expected the rows of camera.parquet, got others")
    camera = Camera(
        K=track.camera.K[distinct],
        distortion=track.camera.distortion[distinct],
        R_cam_from_world=track.camera.R_cam_from_world[distinct],
        t_cam_from_world=track.camera.t_cam_from_world[distinct],
    )
    position, velocity = ball["ball.position"][distinct], ball["ball.velocity"][distinct]
    velocity = np.where(np.isfinite(velocity), velocity, 0.0)
    half = 0.5 * shutter_s(folder) * velocity
    ends, _ = project(camera, np.stack([position - half, position, position + half], axis=1))
    here = ends[:, 1]
    depth = _depth(camera, position[:, None])[:, 0]
    boxes, players = _players(folder, track, distinct)
    behind = _depth(camera, players) < depth[:, None] + 1.0
    thrown = np.flatnonzero(ball["ball.event"][distinct] == "first")
    held = np.arange(len(distinct)) <= (thrown[0] if len(thrown) else -1)
    inside = _within(here, boxes, 0.05)
    slow = np.linalg.norm(np.gradient(here, axis=0), axis=1) < 0.5 if len(here) > 1 else np.ones(len(here), bool)
    near = _within(here, boxes, 0.25).any(axis=1)
    resting = (position[:, 2] < 2 * scene.ball.radius_m) & (np.linalg.norm(velocity, axis=1) < 0.5)
    return {
        "ball_px": here.astype(np.float64),
        "streak_px": np.nan_to_num(ends[:, 2] - ends[:, 0]),
        "radius_px": np.nan_to_num(camera.K[:, 0, 0] * scene.ball.radius_m / np.maximum(depth, 1.0), nan=1.0),
        "hidden": (inside & behind).any(axis=1) | (slow & near) | resting | held,
        "here_from_previous": turns(camera),
        "boxes_px": boxes,
    }


def shutter_s(folder: Path) -> float:
    """How long the shutter of a clip was open, s, by its `clip.json`; 0 where that does not say."""
    return float(json.loads((folder / "clip.json").read_text()).get("shutter_s") or 0.0)


def _players(folder: Path, track: ClipCamera, distinct: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (frames, players, 4) and positions in the world (frames, players, 3); NaN where there is none."""
    path = folder / "players.parquet"
    table = read_table(path) if path.is_file() else {}
    names = sorted({name.split(".")[0] for name in table if name.endswith(".box_px")})
    boxes = np.full((len(distinct), len(names), 4), np.nan)
    places = np.full((len(distinct), len(names), 3), np.nan)
    if not names:
        return boxes, places
    row_of = {int(frame): row for row, frame in enumerate(table["video_frame"])}
    rows = np.array([row_of.get(int(frame), -1) for frame in track.video_frame[distinct]])
    for k, name in enumerate(names):
        boxes[:, k] = np.where(rows[:, None] >= 0, table[f"{name}.box_px"][rows], np.nan)
        places[:, k] = np.where(rows[:, None] >= 0, table[f"{name}.root_position"][rows], np.nan)
    return boxes, places


def _depth(camera: Camera, points: Float[np.ndarray, "frames points 3"]) -> Float[np.ndarray, "frames points"]:
    """Distance in front of the camera along its axis, metres."""
    return np.einsum("fj,fpj->fp", camera.R_cam_from_world[:, 2], points) + camera.t_cam_from_world[:, None, 2]


def _within(pixels: np.ndarray, boxes: np.ndarray, margin: float) -> np.ndarray:
    """Whether each frame's pixel lies in each of its boxes, widened by a share of the box's height."""
    room = margin * (boxes[..., 3] - boxes[..., 1])[..., None]
    p = pixels[:, None]
    return np.asarray(((p >= boxes[..., :2] - room) & (p <= boxes[..., 2:] + room)).all(axis=-1))


def _states(pictures: Pictures, truth: dict[str, np.ndarray]) -> Int[np.ndarray, " frames"]:
    """Whether each frame's ball is to be found."""
    state = np.full(len(pictures), UNKNOWN, np.int64)
    around: dict[int, np.ndarray] = {}
    for k in range(len(pictures)):
        for index in (k - 1, k, k + 1):
            if 0 <= index < len(pictures) and index not in around:
                around[index] = pictures.read(index)
        around.pop(k - 2, None)
        high, wide = around[k].shape[:2]
        pixel = truth["ball_px"][k]
        if not np.isfinite(pixel).all() or (pixel < -20).any() or (pixel > np.array([wide, high]) + 20).any():
            state[k] = ABSENT
        elif truth["hidden"][k] or (pixel < 2).any() or (pixel > np.array([wide, high]) - 3).any():
            continue
        elif trace(k, around, truth) >= LEAST_TRACE:
            state[k] = SEEN
    return state


def trace(k: int, pictures: dict[int, np.ndarray], truth: dict[str, np.ndarray]) -> float:
    """Grey values by which frame k differs, over the ball's smeared disc, from what lies behind it.

    What lies behind is seen in the neighbouring frames where the ball has left the place, else round it.
    """
    pixel, streak, radius = truth["ball_px"][k], truth["streak_px"][k], float(truth["radius_px"][k])
    reach = min(WIDEST_PATCH, int(np.ceil(0.5 * np.linalg.norm(streak) + radius + 4)))
    corner = np.round(pixel) - reach
    side = 2 * reach + 1
    cover = smear(pixel - corner, streak, radius, (side, side))
    place = np.array([[1, 0, -corner[0]], [0, 1, -corner[1]], [0, 0, 1]])
    here = _patch(pictures[k], place, side)
    found = []
    for other in (k - 1, k + 1):
        if other not in pictures or not np.isfinite(truth["ball_px"][other]).all():
            continue
        turn = truth["here_from_previous"][max(k, other)]
        map_px = turn if other < k else np.linalg.inv(turn)
        there = map_px @ np.array([*truth["ball_px"][other], 1.0])
        gone = np.linalg.norm(there[:2] / there[2] - pixel)
        if gone > 0.5 * (np.linalg.norm(streak) + np.linalg.norm(truth["streak_px"][other])) + 2 * radius + 1:
            found.append(_stands_out(here - _patch(pictures[other], place @ map_px, side), cover))
    if not found:
        ring = cover <= 0.0
        behind = here[ring].mean(axis=0) if ring.any() else 0.0
        found.append(_stands_out(here - behind, cover))
    return min(found)


def _patch(bgr: UInt8[np.ndarray, "height width 3"], map_px: np.ndarray, side: int) -> np.ndarray:
    patch = cv2.warpPerspective(bgr, map_px, (side, side), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return patch.astype(np.float32)


def _stands_out(difference: np.ndarray, cover: np.ndarray) -> float:
    """The largest of the colours' mean differences over the smeared disc."""
    return float(np.abs(np.einsum("rc,rck->k", cover, difference)).max() / max(float(cover.sum()), 1e-6))


def match_of(clip_id: str) -> str:
    """The video a clip was cut from: the clip's name up to its number."""
    head, dot, tail = clip_id.rpartition(".")
    return head if dot and tail.isdigit() else clip_id


def divide_matches(clips: Sequence[BallClip]) -> FrameSet[BallClip]:
    """One match in `HELD_OUT_PART` held out, by its name; where that is none, the last tenth of each clip.

    Only frames with two neighbours count.
    """
    pairs = np.array([(c, f) for c, clip in enumerate(clips) for f in range(1, len(clip) - 1)]).reshape(-1, 2)
    chosen = np.array([crc32(match_of(clip.clip_id).encode()) % HELD_OUT_PART == 0 for clip in clips])
    out = chosen[pairs[:, 0]]
    if not chosen.any() or chosen.all():
        lengths = np.array([len(clip) for clip in clips])
        out = pairs[:, 1] >= 0.9 * lengths[pairs[:, 0]]
    return FrameSet(clips=tuple(clips), training=pairs[~out], held_out=pairs[out])
