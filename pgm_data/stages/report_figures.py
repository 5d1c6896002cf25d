"""The figures of a report: what the files of a work folder say about each clip and each video."""

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from pgm_data.dataset.clip_ball import BALL_TABLES, ClipBall, read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_captions import CaptionRows, read_clip_captions
from pgm_data.dataset.clip_players import ClipPlayers, read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.scene import load_scene

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
"""Numbers in a reason; reasons that differ only in them are counted as one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReasonCount:
    """Frames that share a reason."""

    status: str
    reason: str
    """One of the reasons as written."""
    frames: int


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipFigures:
    """What a clip's `clip.json`, `camera.parquet` and the other tables say."""

    document: dict[str, Any]
    track: ClipCamera
    ball: ClipBall | None
    """None where the ball has not been found yet."""
    players: ClipPlayers | None
    """None where the players have not been found yet, or the scene is not at hand."""
    captions: CaptionRows | None
    """None where nothing has been said yet."""
    pan_deg: Float[np.ndarray, " frames"]
    """Where the camera looks: to the right of +y, degrees; NaN without a camera."""
    tilt_deg: Float[np.ndarray, " frames"]
    """Where the camera looks: above the horizon, degrees; NaN without a camera."""
    reasons: tuple[ReasonCount, ...]
    """Of frames whose status is not `measured`, most frequent first."""

    @property
    def clip_id(self) -> str:
        """Name of the clip's folder."""
        return self.track.clip_id

    @property
    def focal_px(self) -> Float[np.ndarray, " frames"]:
        """Horizontal focal length; NaN without a camera."""
        return self.track.camera.K[:, 0, 0]

    @property
    def state(self) -> str:
        """`ok` where every frame has a camera, `failed` where none has, else `degraded`."""
        has = self.track.has_camera
        return "ok" if has.all() and len(has) else "degraded" if has.any() else "failed"

    def frames_of(self, status: str) -> int:
        """Frames of the given status."""
        return int((self.track.status == status).sum())

    @property
    def position_world(self) -> Float[np.ndarray, " 3"]:
        """The camera's centre, metres: as the clip's file says, else the median over its frames; NaN without one."""
        stated = self.camera_summary.get("position_world")
        if stated is not None:
            return np.array(stated, dtype=float)
        positions = self.track.camera.position_world[self.track.has_camera]
        return np.median(positions, axis=0) if len(positions) else np.full(3, np.nan)

    @property
    def position_std(self) -> Float[np.ndarray, " 3"]:
        """Its standard deviation: as the clip's file says, else the median of the frames' own; NaN without one."""
        stated = self.camera_summary.get("position_std")
        if stated is not None:
            return np.array(stated, dtype=float)
        variances = self.track.position_cov[:, [0, 3, 5]]
        variances = variances[np.isfinite(variances).all(axis=1)]
        return np.sqrt(np.median(variances, axis=0)) if len(variances) else np.full(3, np.nan)

    @property
    def camera_summary(self) -> dict[str, Any]:
        """The `camera` block of the clip's file; empty where it has none."""
        return self.document.get("camera") or {}


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoFigures:
    """What `run.json` and `shots.parquet` say about one input."""

    path: str
    state: str
    reason: str
    clips: tuple[str, ...]
    seconds: float
    """Time it took; NaN where unknown."""
    frames: int
    """Frames decoded; 0 where `shots.parquet` does not name it."""

    @property
    def frames_per_second(self) -> float:
        """Frames processed in a second; NaN where unknown."""
        return self.frames / self.seconds if self.seconds > 0 and self.frames else float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class WorkFigures:
    """What a work folder's files say."""

    run: dict[str, Any]
    """`run.json`; empty where there is none."""
    videos: tuple[VideoFigures, ...]
    clips: tuple[ClipFigures, ...]
    outside: tuple[ReasonCount, ...]
    """Decoded frames that belong to no clip, by verdict and reason."""
    unreadable: tuple[tuple[str, str], ...]
    """Clips whose files cannot be read, and why."""


def clip_figures(folder: Path) -> ClipFigures:
    """The figures of the clip in the folder.

    Raises:
        ValueError: If its `clip.json`, its `camera.parquet` or another of its tables cannot be read.
    """
    track = read_clip_camera(folder)
    has_ball = all((folder / f"{name}.parquet").is_file() for name in BALL_TABLES)
    forward_world = track.camera.R_cam_from_world[:, 2]
    document = read_document(folder / "clip.json", "clip")
    has_captions = (folder / "captions.parquet").is_file()
    return ClipFigures(
        document=document,
        track=track,
        players=_players(folder, str(document["scene"])),
        captions=read_clip_captions(folder) if has_captions else None,
        ball=read_clip_ball(folder, track.capture_time) if has_ball else None,
        pan_deg=np.degrees(np.arctan2(forward_world[:, 0], forward_world[:, 1])),
        tilt_deg=np.degrees(np.arcsin(np.clip(forward_world[:, 2], -1.0, 1.0))),
        reasons=counted(_pairs(track.status, track.reason, but="measured")),
    )


def _players(folder: Path, scene_name: str) -> ClipPlayers | None:
    """The clip's players; None without a table, and without a scene that says what is in it."""
    if not (folder / "players.parquet").is_file():
        return None
    try:
        scene = load_scene(scene_name)
    except ValueError:
        return None
    return read_clip_players(folder, scene) if scene.players else None


def counted(reasons: Iterable[tuple[str, str, int]]) -> tuple[ReasonCount, ...]:
    """Frames per status and reason, most frequent first; reasons that differ only in numbers count as one.

    Args:
        reasons: Status, reason, and how many frames have both.
    """
    frames: Counter[tuple[str, str]] = Counter()
    example: dict[tuple[str, str], str] = {}
    for status, reason, number in reasons:
        key = (status, NUMBER.sub("#", reason))
        frames[key] += number
        example.setdefault(key, reason)
    return tuple(ReasonCount(status=key[0], reason=example[key], frames=number) for key, number in frames.most_common())


def _pairs(
    words: Shaped[np.ndarray, " rows"], reasons: Shaped[np.ndarray, " rows"], *, but: str
) -> Iterable[tuple[str, str, int]]:
    """Each word with its reason and how many rows hold both; rows of the word `but` are left out."""
    pairs = Counter((str(word), str(reason)) for word, reason in zip(words, reasons, strict=True) if word != but)
    return [(word, reason, number) for (word, reason), number in pairs.items()]


def work_figures(work: Path) -> WorkFigures:
    """The figures of a work folder; what is not there yet is empty, what cannot be read is named.

    Raises:
        ValueError: If `run.json` or `shots.parquet` is there and cannot be read.
    """
    run = read_document(work / "run.json", "run") if (work / "run.json").exists() else {}
    frames_of_video: Counter[str] = Counter()
    outside: tuple[ReasonCount, ...] = ()
    if (work / "shots.parquet").exists():
        shots = read_table(work / "shots.parquet")
        frames_of_video.update(shots["video"].tolist())
        outside = counted(_pairs(shots["verdict"], shots["reason"], but="clip"))
    clips, unreadable = [], []
    for folder in sorted(path.parent for path in work.glob("*/clip.json")):
        try:
            clips.append(clip_figures(folder))
        except ValueError as error:
            unreadable.append((folder.name, str(error)))
    return WorkFigures(
        run=run,
        videos=_videos(run, frames_of_video, {clip.clip_id: str(clip.document["source_path"]) for clip in clips}),
        clips=tuple(clips),
        outside=outside,
        unreadable=tuple(unreadable),
    )


def _videos(run: dict[str, Any], frames_of_video: Counter[str], source_of: dict[str, str]) -> tuple[VideoFigures, ...]:
    """The run's inputs; where there is no run, the videos that `shots.parquet` names."""
    inputs = run.get("inputs") or [
        {
            "path": video,
            "state": "ok",
            "reason": "",
            "clips": [clip for clip, source in source_of.items() if source == video],
            "seconds": None,
        }
        for video in frames_of_video
    ]
    videos = []
    for entry in inputs:
        names = {source_of[clip] for clip in entry["clips"] if clip in source_of} | {entry["path"]}
        frames = max((frames_of_video[name] for name in names), default=0)
        seconds = entry.get("seconds")
        videos.append(
            VideoFigures(
                path=entry["path"],
                state=entry["state"],
                reason=entry["reason"],
                clips=tuple(entry["clips"]),
                seconds=float("nan") if seconds is None else float(seconds),
                frames=frames or _by_name(entry["path"], frames_of_video),
            )
        )
    return tuple(videos)


def _by_name(path: str, frames_of_video: Counter[str]) -> int:
    """Frames of the one video of that file name, where the run and the table write its path differently; else 0."""
    same = [video for video in frames_of_video if Path(video).name == Path(path).name]
    return frames_of_video[same[0]] if len(same) == 1 else 0
