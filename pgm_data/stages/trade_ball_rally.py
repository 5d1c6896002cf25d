"""Job of `pgm trade ball3d` on a real rally without 3D truth: calibrated, its ball found and placed, laws checked."""

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.linalg import LinAlgError

from pgm_data.ball import BallTrack
from pgm_data.convert.foreign_track import TrackOptions, track_of_rows
from pgm_data.convert.frame_clock import FrameClock
from pgm_data.convert.track_csv import TrackRows, read_track_csv
from pgm_data.court import Court
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.detect.ball.track_events import find_events
from pgm_data.lift.ball.solution import BallSolution
from pgm_data.lift.ball.world import BallWorld, ball_world
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.ball_clips import BallOptions, detect_options
from pgm_data.stages.ball_detect import detect_clips
from pgm_data.stages.ball_lift import Surroundings, lift_ball
from pgm_data.stages.calibrate import CalibrateOptions, calibrate_video
from pgm_data.stages.clip_doubt import camera_doubt
from pgm_data.stages.trade_ball_score import WITHIN_FRAMES, match_events, plain_matches
from pgm_data.stages.trade_ball_solve import Solver, solver_of

NEAR_PX = 6.0
"""A detection no farther from the reference is right."""
NEAR_COURT_M = 2.0
"""A bounce no farther outside of the lines is near the court."""
ON_GROUND_M = 0.1
SPEEDS = (15.0, 60.0)
"""Of shots, m/s."""
Report = Callable[[dict], None]


def real_rally(arguments: dict, report: Report) -> dict:
    """Rows of a real rally: each solver on the reference track and, with `pixels`, on what is found in the video."""
    import cv2

    cv2.setNumThreads(1)
    video, scene = Path(arguments["video"]), load_scene("tennis")
    solvers = [solver_of(name) for name in arguments["solvers"]]
    labels = json.loads(Path(arguments["events"]).read_text(encoding="utf-8"))
    reference = read_track_csv(Path(arguments["track"]))
    threads = int(os.environ.get("OPENCV_FOR_THREADS_NUM") or 2)
    Path(arguments["scratch"]).mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(dir=arguments["scratch"], prefix="rally-"))
    try:
        outcome = calibrate_video(
            video,
            work,
            stem=video.stem,
            match_id=video.stem,
            options=CalibrateOptions(scene="tennis", overlay=False),
            threads=threads,
            report=lambda detail: None,
        )
        if not outcome.clips:
            raise ValueError(f"{video.name}: expected a clip that shows the court, got none")
        clips = [read_clip_camera(work / name) for name in outcome.clips]
        longest = max(clips, key=lambda clip: len(clip.video_frame))
        document = read_document(work / longest.clip_id / "clip.json", "clip")
    finally:
        shutil.rmtree(work, ignore_errors=True)
    size = (document["width"], document["height"])
    doubt = camera_doubt(longest, document)
    report({"progress": 1, "total": 3})
    around = Surroundings(camera=longest.camera, size=size, doubt=doubt)
    rows = []
    given = reference_track(reference, longest, size)
    for solver in solvers:
        rows.append(
            {"part": "rally", "from": "track", "solver": solver.name}
            | _solved(given, around, solver, scene, longest.video_frame, labels)
        )
    report({"progress": 2, "total": 3})
    if arguments["pixels"]:
        found: dict[str, tuple[BallTrack, float]] = {}
        for solver in solvers:
            # Detection goes with the quality, whatever lifts.
            options = detect_options(BallOptions(quality=solver.quality), threads)
            if solver.quality not in found:
                began = time.perf_counter()
                ((_, track, _),) = detect_clips(
                    video, [longest], options=options, fast_decode=solver.quality == "draft"
                )
                found[solver.quality] = track, time.perf_counter() - began
            track, seconds = found[solver.quality]
            rows.append(
                {"part": "rally", "from": "pixels", "solver": solver.name, "detect_s": seconds}
                | track_figures(track, longest, reference)
                | _solved(track, around, solver, scene, longest.video_frame, labels)
            )
    return {"rows": rows}


def reference_track(rows: TrackRows, clip: ClipCamera, size: tuple[int, int]) -> BallTrack:
    """The reference's rows on the clip's frames, without what was interpolated."""
    clock = FrameClock(
        video_frame=clip.video_frame,
        timestamp=clip.timestamp,
        capture_time=clip.capture_time,
        is_duplicate=clip.is_duplicate,
        said="",
    )
    return track_of_rows(rows, clock, TrackOptions(sigma_px=1.0, width=size[0], height=size[1]))


def track_figures(track: BallTrack, clip: ClipCamera, reference: TrackRows) -> dict:
    """Recall and precision within 6 px in the frames in which the reference saw the ball itself."""
    real = reference.visible & ~reference.is_interpolated
    place = {int(frame): i for i, frame in enumerate(clip.video_frame)}
    rows = [i for i in np.flatnonzero(real).tolist() if int(reference.frame[i]) in place]
    pixels = track.pixels[[place[int(reference.frame[i])] for i in rows]]
    off = np.linalg.norm(pixels - reference.pixels[rows], axis=1)
    found = np.isfinite(off)
    right = int((off[found] <= NEAR_PX).sum())
    return {
        "frames": len(track.times),
        "recall": right / max(len(rows), 1),
        "precision": right / max(int(found.sum()), 1),
        "off_px": float(np.median(off[found])) if found.any() else None,
    }


def _solved(
    track: BallTrack, around: Surroundings, solver: Solver, scene: Scene, video_frame: np.ndarray, labels: dict
) -> dict:
    """What comes of the track: contacts against those read by eye, and whether shots keep the laws."""
    began = time.perf_counter()
    try:
        lifted = lift_ball(track, around, scene=scene, method=solver.method, quality=solver.quality)
    except (ValueError, RuntimeError, ArithmeticError, LinAlgError, IndexError) as error:
        # What is measured is the solver, its faults among the rest.
        return {"failed": True, "seconds": time.perf_counter() - began, "reason": f"{type(error).__name__}: {error}"}
    seconds = time.perf_counter() - began
    assert scene.court is not None
    solution = lifted.solution
    true = np.array([frame for frame, *_ in labels["events"]], dtype=float)
    kinds = np.array([kind for _, kind, *_ in labels["events"]], dtype=object)
    times = np.interp(true, video_frame, track.times)
    within = WITHIN_FRAMES / float(labels["fps"])
    found = match_events(times, kinds, solution.events.times, solution.events.kinds, within)
    flat = find_events(track, size=around.size)
    found_2d = match_events(times, kinds, flat.times, flat.kinds, within)
    return (
        {"failed": False, "seconds": seconds, "reason": solution.said, "found_events": plain_matches(found)}
        | {"found_2d": plain_matches(found_2d)}
        | {"placed": float(np.mean(solution.status != "none"))}
        | law_figures(solution, track.times, ball_world(scene), scene.court)
    )


def law_figures(solution: BallSolution, times: Float[np.ndarray, " frames"], world: BallWorld, court: Court) -> dict:
    """How many shots cross the net above it, bounce on the ground in or near the court and have a tennis speed."""
    flights, events = solution.flights, solution.events
    hits = np.flatnonzero(events.kinds == "hit")
    starts = flights.start_event
    heights = []
    for start in starts[np.asarray(events.kinds[starts] == "hit", dtype=bool)]:
        span = (times >= events.times[start]) & (times <= _next_hit(events.times, hits, int(start)))
        heights.append(net_clearance(solution.position[span], world))
    speeds = np.linalg.norm(flights.start_velocity[events.kinds[starts] == "hit"], axis=1)
    bounces = solution.event_position[np.asarray(events.kinds == "bounce", dtype=bool)]
    half = np.abs(court.in_play).max(axis=(0, 1)) + NEAR_COURT_M
    on_ground = np.abs(bounces[:, 2] - world.radius_m) <= ON_GROUND_M
    near = (np.abs(bounces[:, :2]) <= half).all(axis=1)
    known = [height for height in heights if height is not None]
    return {
        "shots": len(speeds),
        "crossings": len(known),
        "over_net": sum(height > 0 for height in known),
        "lowest_over_net_m": min(known) if known else None,
        "speeds_right": int(((speeds >= SPEEDS[0]) & (speeds <= SPEEDS[1])).sum()),
        "speeds": [float(v) if np.isfinite(v) else None for v in np.round(speeds, 2)],
        "bounces": len(bounces),
        "bounces_right": int((on_ground & near).sum()),
        "residual_px": _median(flights.residual_px),
    }


def net_clearance(position: Float[np.ndarray, "frames 3"], world: BallWorld) -> float | None:
    """How far above the net the ball's underside first crosses it, metres; None where it does not cross it."""
    known = position[np.isfinite(position).all(axis=1)]
    side = np.sign(known[:, 1])
    across = np.flatnonzero(side[1:] * side[:-1] < 0)
    if not len(across) or not len(world.net_xz):
        return None
    before, after = known[across[0]], known[across[0] + 1]
    x, _, z = before + (after - before) * before[1] / (before[1] - after[1])
    return float(z - world.radius_m - np.interp(x, world.net_xz[:, 0], world.net_xz[:, 1]))


def _next_hit(times: np.ndarray, hits: np.ndarray, start: int) -> float:
    later = hits[hits > start]
    return float(times[later[0]]) if len(later) else float("inf")


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
