"""Jobs of `pgm trade players`: drawn plays through registration alone, drawn and real videos from their pixels."""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_players import ClipPlayers, read_clip_players
from pgm_data.dataset.documents import read_document
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from pgm_data.people import PlayerBoxes, PlayerPoses
from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, write_match
from pgm_data.stages.clip_doubt import camera_doubt
from pgm_data.stages.clip_pictures import ClipPictures
from pgm_data.stages.jobs import Job
from pgm_data.stages.players_detect import FoundPlayers, found_players, person_finders, pose_model
from pgm_data.stages.players_lift import clip_players, placed_players
from pgm_data.stages.players_options import PlayersOptions, Quality
from pgm_data.stages.trade_clips import truth_of
from pgm_data.stages.trade_players_score import plain_errors, player_errors

DRAWN = "pgm_data.stages.trade_players_clips:score_drawn"
VIDEO = "pgm_data.stages.trade_players_clips:score_video"
REAL = "pgm_data.stages.trade_players_clips:score_real"
BOX_NEAR = 0.3
"""Overlap over union from which a box is that of the player."""
Report = Callable[[dict], None]


def drawn_jobs(
    plays: int, qualities: Sequence[str], *, seed: int, noise_px: float, frames: int, scratch: Path
) -> list[Job]:
    """One job for every drawn match and preset; the presets see the same pixels."""
    return [
        Job(
            name=f"play {number:03d}, {quality}",
            stage="trade",
            entry=DRAWN,
            arguments={
                "number": number,
                "seed": seed,
                "quality": quality,
                "noise_px": noise_px,
                "frames": frames,
                "scratch": str(scratch.resolve()),
            },
        )
        for number in range(plays)
        for quality in qualities
    ]


def video_jobs(data: Path, qualities: Sequence[str]) -> list[Job]:
    """One job for every video and preset in a folder that `pgm simulate` wrote.

    Raises:
        ValueError: If the folder holds no video with its truth.
    """
    return [
        Job(
            name=f"{video.stem}, {quality}",
            stage="trade",
            entry=VIDEO,
            arguments={
                "video": str(video),
                "truth": [str(folder.resolve()) for folder in folders],
                "quality": quality,
            },
        )
        for video, folders in sorted(truth_of(data).items())
        for quality in qualities
    ]


def real_jobs(work: Path, qualities: Sequence[str]) -> list[Job]:
    """One job for every clip of a calibrated work folder and preset.

    Raises:
        ValueError: If the folder holds no clip.
    """
    folders = sorted(path.parent for path in work.glob("*/camera.parquet"))
    if not folders:
        raise ValueError(f"{work}: expected clips that pgm-calibrate made, got none")
    return [
        Job(
            name=f"{folder.name}, {quality}",
            stage="trade",
            entry=REAL,
            arguments={"clip": str(folder.resolve()), "quality": quality},
        )
        for folder in folders
        for quality in qualities
    ]


def score_drawn(arguments: dict, report: Report) -> dict:
    """A row for each player of one drawn match: true boxes and true points with noise, registered."""
    scene = load_scene("tennis")
    scratch = Path(arguments["scratch"])
    scratch.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(dir=scratch, prefix="play-"))
    try:
        options = ClipOptions(frames=int(arguments["frames"]), width=1920, height=1080)
        seed, number = int(arguments["seed"]), int(arguments["number"])
        written = write_match(folder, scene, options, MatchFiles(pictures="none"), seed=seed, match=number)
        rows: list[dict] = []
        for clip_id in written.clips:
            clip = read_clip_camera(folder / "work" / clip_id)
            truth = read_clip_players(folder / "work" / clip_id, scene)
            rng = np.random.default_rng([seed, number, len(rows)])
            boxes, poses = noisy(truth, scene, rng, float(arguments["noise_px"]))
            rows += _scored(clip, truth, boxes, poses, scene, arguments["quality"], no_doubt(), {"part": "drawn"})
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return {"rows": rows}


def noisy(
    truth: ClipPlayers, scene: Scene, rng: np.random.Generator, noise_px: float
) -> tuple[PlayerBoxes, PlayerPoses]:
    """True boxes, and true points with noise, as detectors would give them."""
    tracks = truth.players
    boxes = np.stack([track.box_px for track in tracks], axis=1)
    points = np.stack([track.keypoints_px for track in tracks], axis=1)
    points = points + rng.normal(0.0, noise_px, points.shape)
    score = np.where(np.isfinite(points).all(axis=-1), 1.0, np.nan)
    there = np.asarray(np.isfinite(boxes).all(axis=-1))
    names = tuple(track.name for track in tracks)
    skeleton = scene.players[0].skeleton
    assert skeleton is not None
    shape = boxes.shape[:2]
    return (
        PlayerBoxes(
            names=names,
            boxes_px=np.where(there[..., None], boxes, np.nan),
            score=np.where(there, 1.0, np.nan),
            ground_world=np.full((*shape, 2), np.nan),
            status=np.where(there, "measured", "none").astype(object),
        ),
        PlayerPoses(
            names=names,
            point_names=skeleton.keypoint_names,
            points_px=points,
            score=score,
            sigma_px=np.where(np.isfinite(score), max(noise_px, 0.1), np.nan),
            points_ray=np.full((*points.shape[:-1], 3), np.nan),
        ),
    )


def score_video(arguments: dict, report: Report) -> dict:
    """A row for each player of each clip of a drawn video, from its pixels through the true cameras."""
    import cv2

    cv2.setNumThreads(1)
    video = Path(arguments["video"])
    folders = [Path(folder) for folder in arguments["truth"]]
    scene = load_scene(read_document(folders[0] / "clip.json", "clip")["scene"])
    rows: list[dict] = []
    for folder in folders:
        clip, truth = read_clip_camera(folder), read_clip_players(folder, scene)
        found = _found(video, clip, scene, arguments["quality"])
        about = {"part": "videos", "clip": clip.clip_id} | _cost(found, len(clip.video_frame))
        document = read_document(folder / "clip.json", "clip")
        doubt = camera_doubt(clip, document)
        own = _scored(clip, truth, found.boxes, found.poses, scene, arguments["quality"], doubt, about)
        counted = clip.has_camera & ~clip.is_duplicate
        for number, row in enumerate(own):
            true_box, box = truth.players[number].box_px[counted], found.boxes.boxes_px[counted, number]
            overlap = overlaps(true_box, box)
            there = np.isfinite(true_box).all(axis=1)
            row["boxes"] = int(there.sum())
            row["boxes_right"] = int((overlap[there] >= BOX_NEAR).sum())
            row["boxes_wrong"] = int((np.isfinite(box).all(axis=1) & (overlap < BOX_NEAR))[there].sum())
        rows += own
        report({"progress": len(rows), "total": len(folders) * len(scene.players)})
    return {"rows": rows}


def score_real(arguments: dict, report: Report) -> dict:
    """A row for each player of a real clip: how often found and placed, how well its points are met."""
    import cv2

    from pgm_data.convert.frame_pictures import source_video

    cv2.setNumThreads(1)
    folder = Path(arguments["clip"])
    document = read_document(folder / "clip.json", "clip")
    scene = load_scene(document["scene"])
    clip = read_clip_camera(folder)
    found = _found(source_video(folder.parent, document, None), clip, scene, arguments["quality"])
    begun = time.perf_counter()
    doubt = camera_doubt(clip, document)
    motions = placed_players(clip, found.boxes, found.poses, scene=scene, quality=arguments["quality"], doubt=doubt)
    seconds = time.perf_counter() - begun
    solved = clip_players(clip, found.boxes, found.poses, motions, scene=scene)
    scale = max(document["width"], document["height"] * 16 / 9) / 1920
    rows = []
    for number, track in enumerate(solved.players):
        fit = track.reprojection_px[np.isfinite(track.reprojection_px)] / scale
        rows.append(
            {"part": "real", "clip": clip.clip_id, "player": track.name, "quality": arguments["quality"]}
            | _cost(found, len(clip.video_frame))
            | {
                "with_camera": int(clip.has_camera.sum()),
                "seen": int((np.isfinite(found.boxes.boxes_px[:, number, 0]) & clip.has_camera).sum()),
                "placed": int((track.status != "none").sum()),
                "reprojection_1080_px": float(np.mean(fit)) if len(fit) else None,
                "stated_m": _stated(track.root_cov),
                "lift_s": seconds,
            }
        )
    return {"rows": rows}


def _found(video: Path, clip: ClipCamera, scene: Scene, quality: Quality) -> FoundPlayers:
    options = replace(PlayersOptions(), quality=quality)
    threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
    model, why = pose_model(options, threads)
    return found_players(
        ClipPictures(video, clip, threads=threads, fast=quality == "draft"),
        clip,
        scene=scene,
        options=options,
        files={},
        finders=person_finders(options, threads),
        model=model,
        why_no_model=why,
    )


def _cost(found: FoundPlayers, frames: int) -> dict:
    return {"frames": frames, "find_s": found.find_s, "pose_s": found.pose_s, "points": len(found.poses.point_names)}


def _scored(
    clip: ClipCamera,
    truth: ClipPlayers,
    boxes: PlayerBoxes,
    poses: PlayerPoses,
    scene: Scene,
    quality: Quality,
    doubt: CameraDoubt,
    about: dict,
) -> list[dict]:
    """A row for each player."""
    begun = time.perf_counter()
    motions = placed_players(clip, boxes, poses, scene=scene, quality=quality, doubt=doubt)
    seconds = time.perf_counter() - begun
    solved = clip_players(clip, boxes, poses, motions, scene=scene)
    counted = clip.has_camera & ~clip.is_duplicate
    rows = []
    for number, player in enumerate(scene.players):
        assert player.skeleton is not None
        errors = player_errors(truth.players[number], solved.players[number], skeleton=player.skeleton, counted=counted)
        fit = solved.players[number].reprojection_px
        rows.append(
            about
            | {"player": player.name, "quality": quality, "lift_s": seconds, "clip_frames": len(clip.video_frame)}
            | {"reprojection_px": float(np.nanmedian(fit)) if np.isfinite(fit).any() else None}
            | plain_errors(errors)
        )
    return rows


def overlaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Overlap over union of boxes row by row; 0 where one is NaN."""
    low, high = np.maximum(a[:, :2], b[:, :2]), np.minimum(a[:, 2:], b[:, 2:])
    inner = np.clip(high - low, 0.0, None).prod(axis=1)
    both = (a[:, 2:] - a[:, :2]).prod(axis=1) + (b[:, 2:] - b[:, :2]).prod(axis=1) - inner
    return np.nan_to_num(inner / np.where(both > 0, both, np.inf))


def _stated(cov: np.ndarray) -> float | None:
    """Median of the largest stated deviation."""
    known = cov[np.isfinite(cov).all(axis=(1, 2))]
    return float(np.median(np.sqrt(np.maximum(np.linalg.eigvalsh(known)[:, -1], 0.0)))) if len(known) else None
