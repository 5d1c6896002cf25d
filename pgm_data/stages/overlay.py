"""A clip's video with court, players and ball drawn in through its cameras, and a few of its frames as pictures."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8

from pgm_data.dataset.clip_ball import BALL_TABLES, read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import Scene
from pgm_data.stages.ball_overlay import BallStrokes, ball_label, ball_strokes, draw_ball
from pgm_data.stages.court_drawing import CourtStrokes, court_strokes, draw_court, draw_label, resized
from pgm_data.stages.players_overlay import PlayerStrokes, draw_players, player_strokes
from pgm_data.video import DecodedFrame, open_video, write_video

KEY_FRAMES = 6
KEY_FRAME_WIDTH = 960
"""Pixels; key frames go into a page that should stay small."""
KEY_FRAME_FOLDER = "key_frames"
"""Beside a clip's other files: `000123.jpg` is the clip's frame 123 with the court drawn in."""
REASON_CHARACTERS = 64


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipStrokes:
    """What is drawn into a clip's pictures."""

    court: CourtStrokes | None
    """None where the scene has none."""
    ball: BallStrokes | None
    """None where the clip's ball has not been found yet."""
    players: PlayerStrokes | None
    """None where the clip's players have not been found yet."""


@dataclass(frozen=True, eq=False, kw_only=True)
class KeyFrame:
    """One frame of a clip with the court drawn in."""

    frame_index: int
    """Frame of the clip, from 0."""
    jpeg: bytes


def write_overlay(
    work: Path, clip_id: str, *, video: Path, scene: Scene, max_width: int = 1280
) -> tuple[KeyFrame, ...]:
    """Write the clip's overlay.mp4 and key frames, with players and ball where it has tables of them; the key frames.

    Raises:
        ValueError: If the video does not hold the frames of the clip's camera track, or a table is bad.
    """
    return write_overlays(work, (clip_id,), video=video, scene=scene, max_width=max_width)[clip_id]


def write_overlays(
    work: Path, clip_ids: tuple[str, ...], *, video: Path, scene: Scene, max_width: int = 1280
) -> dict[str, tuple[KeyFrame, ...]]:
    """The same for several clips of one video, which is decoded once.

    Raises:
        ValueError: If the video does not hold the frames of a clip's camera track, or a table is bad.
    """
    tracks = [read_clip_camera(work / clip_id) for clip_id in clip_ids]
    for track in tracks:
        if not len(track.video_frame):
            raise ValueError(f"{work / track.clip_id}: camera.parquet: expected at least one frame, got none")
    tracks.sort(key=lambda track: int(track.video_frame[0]))
    for one, following in pairwise(tracks):
        if one.video_frame[-1] >= following.video_frame[0]:
            raise ValueError(f"{video}: expected clips that share no frame, got {one.clip_id}, {following.clip_id}")
    court = court_strokes(scene.court) if scene.court is not None else None
    strokes = {
        track.clip_id: ClipStrokes(
            court=court,
            ball=_ball(work / track.clip_id, track, scene),
            players=_players(work / track.clip_id, scene),
        )
        for track in tracks
    }
    key_frames: dict[str, tuple[KeyFrame, ...]] = {}
    with open_video(video) as reader:
        frames = iter(reader)
        for track in tracks:
            painter = _Painter(track, strokes[track.clip_id], (reader.info.width, reader.info.height), max_width)
            start = float(track.timestamp[0])
            write_video(
                work / track.clip_id / "overlay.mp4",
                painter.pictures(frames, video),
                timestamps=[float(t) - start for t in track.timestamp],
            )
            key_frames[track.clip_id] = tuple(painter.key_frames)
            _save(work / track.clip_id / KEY_FRAME_FOLDER, painter.key_frames)
    return key_frames


def _ball(folder: Path, track: ClipCamera, scene: Scene) -> BallStrokes | None:
    """The clip's ball, where its tables are there."""
    if (
        scene.ball is None
        or scene.court is None
        or not all((folder / f"{name}.parquet").is_file() for name in BALL_TABLES)
    ):
        return None
    world = ball_world(scene)
    ball = read_clip_ball(folder, track.capture_time)
    return ball_strokes(ball, ground_half_size=world.ground_half_size, floor_z=world.floor_z)


def _players(folder: Path, scene: Scene) -> PlayerStrokes | None:
    """The clip's players, where their table is there."""
    if not scene.players or not (folder / "players.parquet").is_file():
        return None
    return player_strokes(read_clip_players(folder, scene), scene)


def saved_key_frames(folder: Path) -> tuple[KeyFrame, ...]:
    """The key frames beside a clip's other files, in order; none where no overlay was written."""
    paths = sorted(path for path in (folder / KEY_FRAME_FOLDER).glob("*.jpg") if path.stem.isdigit())
    return tuple(KeyFrame(frame_index=int(path.stem), jpeg=path.read_bytes()) for path in paths)


def key_frame_indices(
    status: Shaped[np.ndarray, " frames"], reprojection_px: Float[np.ndarray, " frames"], count: int = KEY_FRAMES
) -> Int[np.ndarray, " chosen"]:
    """Frames worth a look, at most `count`, in order.

    The worst measured residual, one interpolated frame and one without a camera come first; the rest
    is spread evenly over the clip.
    """
    frames = len(status)
    chosen: list[int] = []
    residual = np.where((status == "measured") & np.isfinite(reprojection_px), reprojection_px, -np.inf)
    if frames and residual.max() > -np.inf:
        chosen.append(int(residual.argmax()))
    for wanted in ("none", "interpolated"):
        places = np.flatnonzero(status == wanted)
        if len(places):
            chosen.append(int(places[len(places) // 2]))
    chosen = chosen[:count]
    rest = count - len(chosen)
    spread = np.unique(np.round(np.linspace(0, frames - 1, rest)).astype(int)) if frames and rest else []
    return np.unique(np.array([*chosen, *spread], dtype=np.int64))


class _Painter:
    """Draws one clip's frames as they stream by, and keeps its key frames."""

    def __init__(self, track: ClipCamera, strokes: ClipStrokes, size: tuple[int, int], max_width: int) -> None:
        self.track = track
        self.strokes = strokes
        self.size = size
        self.max_width = max_width
        self.wanted = set(key_frame_indices(track.status, track.reprojection_px).tolist())
        self.key_frames: list[KeyFrame] = []

    def pictures(self, frames: Iterator[DecodedFrame], video: Path) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
        """The clip's frames with all that is known drawn in."""
        for index, video_frame in enumerate(self.track.video_frame.tolist()):
            frame = next((frame for frame in frames if frame.video_frame >= video_frame), None)
            if frame is None or frame.video_frame != video_frame:
                got = "its end" if frame is None else f"frame {frame.video_frame}"
                raise ValueError(f"{video}: {self.track.clip_id}: expected frame {video_frame} of the video, got {got}")
            picture = drawn(frame, self.size, self.track, index, self.strokes, self.max_width)
            if index in self.wanted:
                self.key_frames.append(KeyFrame(frame_index=index, jpeg=_jpeg(picture)))
            yield picture


def drawn(
    frame: DecodedFrame,
    size: tuple[int, int],
    track: ClipCamera,
    index: int,
    strokes: ClipStrokes,
    max_width: int = 1280,
) -> UInt8[np.ndarray, "h w 3"]:
    """A decoded frame, made smaller where wider than `max_width`, with court, players and ball, and lines about them.

    Args:
        frame: The picture.
        size: Its displayed width and height, pixels.
        track: The clip's cameras.
        index: Frame of the clip.
        strokes: Court, players and ball.
        max_width: Pixels.
    """
    picture = np.require(frame.small_bgr(min(size[0], max_width)), requirements=["C", "W"])
    status = str(track.status[index])
    scale = np.array([picture.shape[1] / size[0], picture.shape[0] / size[1]])
    camera = resized(track.camera[index], scale)
    if strokes.court is not None and status != "none":
        draw_court(picture, strokes.court, camera, status)
    lines = _label(track, index)
    if strokes.players is not None:
        draw_players(picture, strokes.players, camera, index, scale)
    if strokes.ball is not None:
        draw_ball(picture, strokes.ball, camera, index, scale)
        lines = (*lines, ball_label(strokes.ball, index))
    draw_label(picture, lines, status)
    return picture


def _label(track: ClipCamera, index: int) -> tuple[str, ...]:
    place = f"frame {index}   {track.timestamp[index]:.3f} s"
    if track.is_duplicate[index]:
        place += "   repeat"
    status, reason = str(track.status[index]), str(track.reason[index])
    if status == "none":
        return (f"{place}   NO CAMERA", *_wrapped(reason or "no reason given"))
    focal = track.camera.K[index, 0, 0]
    residual = track.reprojection_px[index]
    fit = f"   {residual:.2f} px rms" if np.isfinite(residual) else ""
    return (f"{place}   {status}{fit}   f {focal:.0f} px", *(_wrapped(reason) if reason else ()))


def _wrapped(text: str) -> tuple[str, ...]:
    words = " ".join(text.split())
    rows = [words[i : i + REASON_CHARACTERS] for i in range(0, len(words), REASON_CHARACTERS)]
    return tuple(rows[:2])


def _jpeg(picture: UInt8[np.ndarray, "h w 3"]) -> bytes:
    height, width = picture.shape[:2]
    if width > KEY_FRAME_WIDTH:
        size = (KEY_FRAME_WIDTH, max(1, round(height * KEY_FRAME_WIDTH / width)))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 82])
    if not done:
        raise RuntimeError(f"expected a picture that can be encoded, got one of {width}x{height}")
    return data.tobytes()


def _save(folder: Path, key_frames: list[KeyFrame]) -> None:
    """Replace the folder by one of these key frames; a reader never sees half of them."""
    fresh = folder.with_name(f".{folder.name}.tmp")
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir()
    for key_frame in key_frames:
        (fresh / f"{key_frame.frame_index:06d}.jpg").write_bytes(key_frame.jpeg)
    if folder.exists():
        shutil.rmtree(folder)
    fresh.rename(folder)
