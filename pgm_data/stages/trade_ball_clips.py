"""Jobs of `pgm trade ball3d` on drawn videos: the ball found in their pictures, placed, scored against the truth."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from numpy.linalg import LinAlgError

from pgm_data.dataset.clip_ball import ClipBall, read_clip_ball
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.scene import load_scene
from pgm_data.stages.ball_clips import BallOptions, detect_options
from pgm_data.stages.ball_detect import detect_clips
from pgm_data.stages.ball_lift import LiftedBall, Surroundings, lift_ball
from pgm_data.stages.clip_doubt import camera_doubt
from pgm_data.stages.jobs import Job
from pgm_data.stages.trade_ball_score import (
    FAILED_M,
    PLACED_SHARE,
    SAMPLES,
    WITHIN_FRAMES,
    match_events,
    plain_matches,
)
from pgm_data.stages.trade_ball_solve import solver_of
from pgm_data.stages.trade_ball_summary import EventFigures, event_figures, lower_median
from pgm_data.stages.trade_ball_tables import cm, markdown
from pgm_data.stages.trade_clips import truth_of
from pgm_data.stages.trade_score import coverage
from pgm_data.stages.trade_summary import number, percent

SCORE = "pgm_data.stages.trade_ball_clips:score_video"
NEAR_PX = 6.0
"""A detection no farther from the truth is right, in a picture 720 high."""
Report = Callable[[dict], None]


def clip_jobs(data: Path, solvers: Sequence[str]) -> list[Job]:
    """One job for every video and quality of detection in a folder that `pgm simulate` wrote.

    Raises:
        ValueError: If the folder holds no video with its truth.
    """
    by_quality: dict[str, list[str]] = {}
    for name in solvers:
        by_quality.setdefault(solver_of(name).quality, []).append(name)
    return [
        Job(
            name=f"{video.stem}, {quality}",
            stage="trade",
            entry=SCORE,
            arguments={
                "video": str(video),
                "truth": [str(folder.resolve()) for folder in folders],
                "quality": quality,
                "solvers": names,
            },
        )
        for video, folders in sorted(truth_of(data).items())
        for quality, names in by_quality.items()
    ]


def score_video(arguments: dict, report: Report) -> dict:
    """A row for every clip of a video through each solver."""
    import cv2

    cv2.setNumThreads(1)
    threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
    folders = {Path(folder).name: Path(folder) for folder in arguments["truth"]}
    scene = load_scene(read_document(next(iter(folders.values())) / "clip.json", "clip")["scene"])
    clips = [read_clip_camera(folder) for folder in folders.values()]
    options = detect_options(BallOptions(quality=arguments["quality"]), threads)
    rows: list[dict] = []
    began = time.perf_counter()
    for clip, track, size in detect_clips(
        Path(arguments["video"]), clips, options=options, fast_decode=arguments["quality"] == "draft"
    ):
        detect_s = time.perf_counter() - began
        folder = folders[clip.clip_id]
        truth = read_clip_ball(folder, clip.capture_time)
        doubt = camera_doubt(clip, read_document(folder / "clip.json", "clip"))
        around = Surroundings(camera=clip.camera, size=size, doubt=doubt)
        seen = pixel_figures(track.pixels, truth.pixel, ~clip.is_duplicate, NEAR_PX * size[1] / 720)
        for name in arguments["solvers"]:
            solver = solver_of(name)
            row = {"part": "clips", "clip": clip.clip_id, "solver": name, "detect_s": detect_s} | seen
            begun = time.perf_counter()
            try:
                lifted = lift_ball(track, around, scene=scene, method=solver.method, quality=solver.quality)
            except (ValueError, RuntimeError, ArithmeticError, LinAlgError, IndexError) as error:
                # What is measured is the solver, its faults among the rest.
                rows.append(row | {"failed": True, "rms_m": None, "seconds": 0.0, "reason": f"{error}"})
                continue
            rows.append(
                row | {"seconds": time.perf_counter() - begun} | clip_figures(lifted, truth, ~clip.is_duplicate)
            )
        report({"progress": len(rows), "total": len(clips) * len(arguments["solvers"])})
        began = time.perf_counter()
    return {"rows": rows}


def pixel_figures(
    found: Float[np.ndarray, "frames 2"],
    true: Float[np.ndarray, "frames 2"],
    distinct: Bool[np.ndarray, " frames"],
    near_px: float,
) -> dict:
    """Frames with a true ball and with a found one, and in how many both agree."""
    there, seen = np.isfinite(true).all(axis=1) & distinct, np.isfinite(found).all(axis=1) & distinct
    with np.errstate(invalid="ignore"):
        right = np.linalg.norm(found - true, axis=1) <= near_px
    return {
        "frames": len(true),
        "true_balls": int(there.sum()),
        "found_balls": int(seen.sum()),
        "right_balls": int((right & distinct).sum()),
    }


def clip_figures(lifted: LiftedBall, truth: ClipBall, distinct: Bool[np.ndarray, " frames"]) -> dict:
    """Errors over the distinct frames from the first true hit to the last true contact, and the contacts."""
    solution, events = lifted.solution, truth.events
    touched = events.time[np.isin(events.kind.astype(str), ("hit", "bounce", "net"))]
    hits = events.time[events.kind == "hit"]
    found = match_events(
        events.time,
        events.kind,
        solution.events.times,
        solution.events.kinds,
        WITHIN_FRAMES * float(np.median(np.diff(truth.timestamp))),
    )
    figures: dict = {"found_events": plain_matches(found), "reason": solution.said}
    if not len(hits):
        return figures | {"failed": False, "rms_m": None, "errors_m": [], "sigmas_m": []}
    times = truth.capture_time
    scored = (times >= hits[0]) & (times <= touched.max()) & distinct & np.isfinite(truth.position).all(axis=1)
    placed = np.asarray(scored & (solution.status != "none"), dtype=bool)
    error = solution.position[placed] - truth.position[placed]
    sigma = np.sqrt(np.maximum(np.diagonal(solution.position_cov[placed], axis1=1, axis2=2), 0.0))
    rms = float(np.sqrt((error**2).sum(axis=1).mean())) if len(error) else None
    few = np.unique(np.linspace(0, len(error) - 1, min(SAMPLES, len(error))).round().astype(int)) if len(error) else []
    failed = placed.sum() < PLACED_SHARE * scored.sum() or rms is None or rms > FAILED_M
    return figures | {
        "failed": bool(failed),
        "rms_m": rms,
        "errors_m": np.round(error[few], 6).tolist(),
        "sigmas_m": np.round(sigma[few], 6).tolist(),
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipFigures:
    """One solver on the drawn videos, from pictures to metres."""

    solver: str
    clips: int
    failed: int
    recall: float
    """Of true balls in the picture, within 6 px at 720 rows."""
    precision: float
    events: EventFigures
    error_m: float
    """Median over clips of the rms; failed ones count as infinite."""
    covered: tuple[float, float, float]
    """Share of frames within one stated deviation, x, y, z."""
    detect_fps: float
    seconds: float
    """Median to place a clip."""


def clips_figures(rows: Sequence[dict]) -> tuple[ClipFigures, ...]:
    """Figures by solver."""
    own = [row for row in rows if row["part"] == "clips"]
    figures = []
    for solver in dict.fromkeys(row["solver"] for row in own):
        mine = [row for row in own if row["solver"] == solver]
        hit = [row for row in mine if row["rms_m"] is not None or row["failed"]]
        good = [row for row in hit if not row["failed"]]
        errors = np.array([e for row in good for e in row["errors_m"]], dtype=float).reshape(-1, 3)
        sigmas = np.array([s for row in good for s in row["sigmas_m"]], dtype=float).reshape(-1, 3)
        x, y, z = (coverage(errors[:, axis], sigmas[:, axis]) for axis in range(3))
        right = sum(row["right_balls"] for row in mine)
        figures.append(
            ClipFigures(
                solver=solver,
                clips=len(mine),
                failed=sum(row["failed"] for row in mine),
                recall=right / max(sum(row["true_balls"] for row in mine), 1),
                precision=right / max(sum(row["found_balls"] for row in mine), 1),
                events=event_figures([row["found_events"] for row in mine if "found_events" in row]),
                error_m=lower_median(np.array([np.inf if row["failed"] else row["rms_m"] for row in hit])),
                covered=(x, y, z),
                detect_fps=sum(row["frames"] for row in mine) / max(sum(row["detect_s"] for row in mine), 1e-9),
                seconds=lower_median(np.array([row["seconds"] for row in mine])),
            )
        )
    return tuple(figures)


def clips_table(figures: Sequence[ClipFigures]) -> str:
    """A row for each solver."""
    head = ["solver", "clips", "failed", "2D recall", "precision", "hits and bounces F1", "kind apart F1"]
    head += ["error, cm, rms, median", "within one sigma x, y, z", "frames/s of detection", "seconds to place"]
    return markdown(
        head,
        [
            [
                f.solver,
                str(f.clips),
                str(f.failed),
                percent(f.recall),
                percent(f.precision),
                number(f.events.f1_kinds, 3),
                number(f.events.f1_any, 3),
                cm(f.error_m),
                ", ".join(number(100 * share, 0) for share in f.covered) + " %",
                number(f.detect_fps, 1),
                number(f.seconds, 2),
            ]
            for f in figures
        ],
    )
