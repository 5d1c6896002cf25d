"""Jobs of `pgm trade pipeline`: one drawn video through all stages, one preset changed at a time, scored."""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from pgm_data.dataset.clip_ball import read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_players import PlayerTrack, read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.ball_clips import BallOptions, ball_of_clips
from pgm_data.stages.calibrate import CalibrateOptions, calibrate_video
from pgm_data.stages.jobs import Job
from pgm_data.stages.players_clips import players_of_clips
from pgm_data.stages.players_options import PlayersOptions, Quality
from pgm_data.stages.trade_clips import truth_of
from pgm_data.stages.trade_players_score import plain_errors, player_errors
from pgm_data.stages.trade_score import Cost, score_video

SCORE = "pgm_data.stages.trade_pipeline_clips:score_pipeline"
STAGES = ("camera", "players", "ball")
USUAL: Quality = "standard"
Report = Callable[[dict], None]


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A preset for every stage."""

    camera: Quality = USUAL
    players: Quality = USUAL
    ball: Quality = USUAL

    @property
    def name(self) -> str:
        """What departs from the usual, in words."""
        changed = [f"{stage} {getattr(self, stage)}" for stage in STAGES if getattr(self, stage) != USUAL]
        return ", ".join(changed) or f"all {USUAL}"


def variants(qualities: Sequence[Quality]) -> tuple[Variant, ...]:
    """All standard, one stage changed at a time, and all stages changed together."""
    others: list[Quality] = [quality for quality in qualities if quality != USUAL]
    single = [replace(Variant(), **{stage: quality}) for stage in STAGES for quality in others]
    together = [Variant(camera=quality, players=quality, ball=quality) for quality in others]
    return (Variant(), *single, *together)


def pipeline_jobs(data: Path, qualities: Sequence[Quality], *, scratch: Path) -> list[Job]:
    """One job for every video in a folder that `pgm simulate` wrote.

    Raises:
        ValueError: If the folder holds no video with its truth.
    """
    return [
        Job(
            name=video.stem,
            stage="trade",
            entry=SCORE,
            arguments={
                "video": str(video),
                "truth": [str(folder.resolve()) for folder in folders],
                "qualities": list(qualities),
                "scratch": str(scratch.resolve()),
            },
        )
        for video, folders in sorted(truth_of(data).items())
    ]


def score_pipeline(arguments: dict, report: Report) -> dict:
    """A row for every variant of presets."""
    import cv2

    cv2.setNumThreads(1)
    video, truth = Path(arguments["video"]), [Path(folder) for folder in arguments["truth"]]
    scene = load_scene(read_document(truth[0] / "clip.json", "clip")["scene"])
    scratch = Path(arguments["scratch"])
    scratch.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=scratch, prefix="pipeline-"))
    known = _Truth(truth, scene)
    rows: list[dict] = []
    wanted = variants(arguments["qualities"])
    try:
        calibrated: dict[str, tuple[float, dict]] = {}
        placed: dict[tuple[str, str], tuple[float, dict]] = {}
        for number, variant in enumerate(wanted):
            cameras = folder / f"camera-{variant.camera}"
            if variant.camera not in calibrated:
                calibrated[variant.camera] = _calibrated(video, cameras, scene, variant.camera, truth)
            both = folder / f"players-{variant.camera}-{variant.players}"
            if (variant.camera, variant.players) not in placed:
                shutil.copytree(cameras, both)
                placed[variant.camera, variant.players] = _players(video, both, scene, variant.players, known)
            last = folder / "last"
            shutil.copytree(both, last)
            ball = _ball(video, last, scene, variant.ball, known)
            shutil.rmtree(last)
            seconds = [part[0] for part in (calibrated[variant.camera], placed[variant.camera, variant.players], ball)]
            figures = calibrated[variant.camera][1] | placed[variant.camera, variant.players][1] | ball[1]
            times = {f"{stage}_s": value for stage, value in zip(STAGES, seconds, strict=True)}
            rows.append({"video": video.stem, "variant": variant.name, "frames": known.frames} | times | figures)
            report({"progress": number + 1, "total": len(wanted)})
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return {"rows": rows}


class _Truth:
    """A video's truth, by its frames."""

    def __init__(self, folders: Sequence[Path], scene: Scene) -> None:
        self.scene = scene
        cameras = [read_clip_camera(folder) for folder in folders]
        self.cameras = cameras
        self.video_frame = np.concatenate([clip.video_frame for clip in cameras])
        self.frames = len(self.video_frame)
        players = [read_clip_players(folder, scene) for folder in folders]
        self.players = tuple(
            _joined([clip.players[number] for clip in players]) for number in range(len(scene.players))
        )
        balls = [read_clip_ball(folder, clip.capture_time) for folder, clip in zip(folders, cameras, strict=True)]
        self.ball = np.concatenate([ball.position for ball in balls])

    def rows(self, video_frame: Int[np.ndarray, " frames"]) -> tuple[np.ndarray, Bool[np.ndarray, " frames"]]:
        """Rows of the truth of those frames, and which frames have one."""
        order = np.argsort(self.video_frame)
        place = np.searchsorted(self.video_frame[order], video_frame).clip(0, self.frames - 1)
        rows = order[place]
        return rows, np.asarray(self.video_frame[rows] == video_frame)


def _joined(tracks: Sequence[PlayerTrack]) -> PlayerTrack:
    names = [name for name in PlayerTrack.__dataclass_fields__ if name not in ("name", "betas")]
    values = {name: np.concatenate([getattr(track, name) for track in tracks]) for name in names}
    return PlayerTrack(name=tracks[0].name, **values)


def _taken(track: PlayerTrack, rows: np.ndarray) -> PlayerTrack:
    names = [name for name in PlayerTrack.__dataclass_fields__ if name not in ("name", "betas")]
    return PlayerTrack(name=track.name, **{name: getattr(track, name)[rows] for name in names})


def _clips(work: Path) -> list[ClipCamera]:
    return [read_clip_camera(path.parent) for path in sorted(work.glob("*/camera.parquet"))]


def _threads() -> int:
    return int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)


def _calibrated(video: Path, work: Path, scene: Scene, quality: Quality, truth: Sequence[Path]) -> tuple[float, dict]:
    """Seconds and errors of the cameras."""
    begun = time.perf_counter()
    work.mkdir()
    options = CalibrateOptions(scene=scene.name, quality=quality, overlay=False)
    outcome = calibrate_video(video, work, stem=video.stem, match_id=video.stem, options=options, threads=_threads())
    seconds = time.perf_counter() - begun
    assert scene.court is not None
    document = read_document(truth[0] / "clip.json", "clip")
    score = score_video(
        video=video.stem,
        preset=quality,
        size=(document["width"], document["height"]),
        solved=_clips(work),
        truth=[read_clip_camera(folder) for folder in truth],
        court=scene.court,
        lens_model="",
        cost=Cost(seconds=outcome.seconds, cpu_s=0.0, memory_mb=0.0),
    )
    centre = None if score.centre_m is None else float(np.linalg.norm(score.centre_m))
    return seconds, {"camera_m": centre, "court_px": score.court_px}


def _players(video: Path, work: Path, scene: Scene, quality: Quality, known: _Truth) -> tuple[float, dict]:
    """Seconds and errors of the players."""
    clips = _clips(work)
    begun = time.perf_counter()
    options = replace(PlayersOptions(), scene=scene.name, quality=quality, overlay=False)
    names = tuple(clip.clip_id for clip in clips)
    players_of_clips(work, names, video=video, options=options, files={}, threads=_threads())
    seconds = time.perf_counter() - begun
    figures: dict = {}
    for number, player in enumerate(scene.players):
        assert player.skeleton is not None
        parts = []
        for clip in clips:
            path = work / clip.clip_id
            if not (path / "players.parquet").is_file():
                continue
            solved = read_clip_players(path, scene).players[number]
            rows, has = known.rows(clip.video_frame)
            errors = player_errors(
                _taken(known.players[number], rows), solved, skeleton=player.skeleton,
                counted=has & clip.has_camera & ~clip.is_duplicate,
            )  # fmt: skip
            parts.append(plain_errors(errors))
        told = [part for part in parts if part["root_rms_m"] is not None]
        figures[f"{player.name}_m"] = _weighted(told, "root_median_m", "placed")
        figures[f"{player.name}_placed"] = sum(part["placed"] for part in parts) / max(
            sum(part["there"] for part in parts), 1
        )
    return seconds, figures


def _weighted(parts: Sequence[dict], name: str, weight: str) -> float | None:
    total = sum(part[weight] for part in parts)
    return sum(part[name] * part[weight] for part in parts) / total if total else None


def _ball(video: Path, work: Path, scene: Scene, quality: Quality, known: _Truth) -> tuple[float, dict]:
    """Seconds and errors of the ball."""
    clips = _clips(work)
    begun = time.perf_counter()
    options = replace(BallOptions(), scene=scene.name, quality=quality, overlay=False)
    names = tuple(clip.clip_id for clip in clips)
    ball_of_clips(work, names, video=video, options=options, marks={}, threads=_threads())
    seconds = time.perf_counter() - begun
    errors, there = [], 0
    for clip in clips:
        if not (work / clip.clip_id / "ball.parquet").is_file():
            continue
        ball = read_clip_ball(work / clip.clip_id, clip.capture_time)
        rows, has = known.rows(clip.video_frame)
        counted = has & ~clip.is_duplicate & np.isfinite(known.ball[rows]).all(axis=1)
        there += int(counted.sum())
        apart = np.linalg.norm(ball.position - known.ball[rows], axis=1)
        errors.append(apart[counted & (ball.status != "none")])
    together = np.concatenate(errors) if errors else np.zeros(0)
    return seconds, {
        "ball_m": float(np.median(together)) if len(together) else None,
        "ball_placed": len(together) / max(there, 1),
    }
