"""Jobs of `pgm trade ball3d` on real tracks: table tennis with 3D truth, 2D tennis with hits and bounces, tennis shots.

World axes of the table tennis files: x across the table, y along it, z up, metres, origin on the table's middle.
"""

import csv
import json
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import yaml
from numpy.linalg import LinAlgError

from pgm_data.ball import BallTrack
from pgm_data.fields import fields, number, numbers
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.flight.aim import aim
from pgm_data.simulate.flight.air import Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.path import BallPath, Contact
from pgm_data.stages.ball_lift import Surroundings, lift_ball
from pgm_data.stages.trade_ball_score import FAILED_M, PLACED_SHARE, WITHIN_FRAMES, match_events, plain_matches
from pgm_data.stages.trade_ball_shots import RPM, WIDE
from pgm_data.stages.trade_ball_solve import solver_of

TABLE_SIGMA_PX = 2.0
"""Noise of the views that carry some."""
RALLY_FPS = 50.0
"""Of the labelled 2D tracks; their files do not say it."""
RALLY_SIZE = (1920, 1080)
TUNING = 20
"""So many of the 2D tracks, in the order of their numbers, were there to tune on; the others are scored only."""
Report = Callable[[dict], None]


def table_tennis(arguments: dict, report: Report) -> dict:
    """A row for every trajectory of one view through one solver; contacts are found, not given."""
    folder, view = Path(arguments["folder"]), arguments["view"]
    scene, solver = load_scene("tabletennis"), solver_of(arguments["solver"])
    files = sorted((folder / view).glob("*.csv"))
    rows = []
    for done, path in enumerate(files):
        table = read_columns(path, ("Timestamp", "X", "Y", "Z", "u", "v"))
        truth = np.stack([table[name] for name in "XYZ"], axis=-1)
        times, pixels = table["Timestamp"], np.stack([table["u"], table["v"]], axis=-1)
        camera, size = view_camera(folder / f"{view}.yaml", len(times))
        track = plain_track(times, pixels, TABLE_SIGMA_PX)
        row: dict = {"part": "tabletennis", "view": view, "file": path.stem, "solver": solver.name, "cold": not done}
        began = time.perf_counter()
        try:
            around = Surroundings(camera=camera, size=size)
            lifted = lift_ball(track, around, scene=scene, method=solver.method, quality=solver.quality)
        except (ValueError, RuntimeError, ArithmeticError, LinAlgError, IndexError) as error:
            # What is measured is the solver, its faults among the rest.
            took = time.perf_counter() - began
            row |= {"failed": True, "mean_m": None, "placed": 0, "seconds": took, "reason": f"{error}"}
        else:
            row["seconds"] = time.perf_counter() - began
            row |= mean_error(lifted.solution.position, truth)
            kinds = lifted.solution.events.kinds
            row |= {"reason": lifted.solution.said, "bounces": int((kinds == "bounce").sum())}
            error = lifted.solution.position - truth
            sigma = np.sqrt(np.diagonal(lifted.solution.position_cov, axis1=1, axis2=2))
            known = np.isfinite(error).all(axis=1)
            row |= {"errors_m": np.round(error[known], 5).tolist(), "sigmas_m": np.round(sigma[known], 5).tolist()}
        rows.append(row)
        report({"progress": done + 1, "total": len(files)})
    return {"rows": rows}


def mean_error(position: np.ndarray, truth: np.ndarray) -> dict:
    """Mean distance over the frames that are placed, and whether that counts as failed."""
    known = np.asarray(np.isfinite(position).all(axis=1))
    mean = float(np.linalg.norm(position[known] - truth[known], axis=1).mean()) if known.any() else None
    failed = known.mean() < PLACED_SHARE or mean is None or not mean <= FAILED_M
    return {"mean_m": mean, "placed": int(known.sum()), "frames": len(known), "failed": bool(failed)}


def view_camera(path: Path, frames: int) -> tuple[Camera, tuple[int, int]]:
    """The fixed camera of a view, once a frame, and its picture's size; its principal point is half the size.

    Raises:
        FieldError: If the file is not what it must be.
    """
    import cv2

    raw = fields(yaml.safe_load(path.read_text(encoding="utf-8")), path.name, required=("rvec", "tvec", "f", "w", "h"))
    width, height = number(raw["w"], "w", above=0), number(raw["h"], "h", above=0)
    focal = number(raw["f"], "f", above=0)
    K = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    R, _ = cv2.Rodrigues(np.array(numbers(raw["rvec"], "rvec", 3)))
    camera = Camera(
        K=np.repeat(K[None], frames, axis=0),
        distortion=np.zeros((frames, 4)),
        R_cam_from_world=np.repeat(R[None], frames, axis=0),
        t_cam_from_world=np.repeat(np.array(numbers(raw["tvec"], "tvec", 3))[None], frames, axis=0),
    )
    return camera, (round(width), round(height))


def rally_events(arguments: dict, report: Report) -> dict:
    """A row for every labelled 2D track: what is found without a camera against what is labelled."""
    from pgm_data.detect.ball.track_events import find_events

    files = sorted(Path(arguments["folder"]).glob("ball_data_*.json"), key=lambda p: int(p.stem.rpartition("_")[2]))
    rows = []
    for place, path in enumerate(files):
        track, kinds = labelled_track(path)
        labelled = np.flatnonzero(np.isin(kinds.astype(str), ("hit", "bounce")))
        began = time.perf_counter()
        events = find_events(track, size=RALLY_SIZE)
        seconds = time.perf_counter() - began
        found = match_events(
            track.times[labelled], kinds[labelled], events.times, events.kinds, WITHIN_FRAMES / RALLY_FPS
        )
        rows.append(
            {
                "part": "rolandgarros",
                "file": path.stem,
                "tuning": place < TUNING,
                "seconds": seconds,
                "found_events": plain_matches(found),
            }
        )
        report({"progress": place + 1, "total": len(files)})
    return {"rows": rows}


def labelled_track(path: Path) -> tuple[BallTrack, np.ndarray]:
    """A 2D track, and the label of each frame: hit, bounce or air."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    frames = sorted(raw, key=int)
    times = (np.array([int(frame) for frame in frames]) - int(frames[0])) / RALLY_FPS
    pixels = np.array(
        [[raw[f]["x"], raw[f]["y"]] if raw[f]["visible"] and raw[f]["x"] is not None else [np.nan] * 2 for f in frames]
    )
    return plain_track(times, pixels, 1.0), np.array([raw[f]["action"] for f in frames], dtype=object)


def plain_track(times: np.ndarray, pixels: np.ndarray, sigma_px: float) -> BallTrack:
    """A track of those pixels, NaN where there is none."""
    found = np.isfinite(pixels).all(axis=1)
    return BallTrack(
        times=times.astype(float),
        is_duplicate=np.zeros(len(times), dtype=bool),
        pixels=pixels.astype(float),
        sigma_px=np.where(found, sigma_px, np.nan),
        score=np.where(found, 1.0, np.nan),
        streak_px=np.full((len(times), 2), np.nan),
    )


def shot_times(arguments: dict, report: Report) -> dict:
    """One row for measured ground strokes: how long they take to the next hit, against flights of the scene's ball.

    Given are place, speed and spin at the hit and where the ball bounces; a flight with the scene's mean drag, lift
    and bounce is struck so that it bounces there, and followed to the plane across the court of the next hit.
    """
    scene = load_scene("tennis")
    measured, flown, heights = [], [], []
    with Path(arguments["file"]).open(encoding="utf-8", newline="") as file:
        shots = list(csv.DictReader(file))
    for shot, after in zip(shots[:-1], shots[1:], strict=True):
        same = all(shot[name] == after[name] for name in ("set", "game", "point", "serve"))
        if not same or shot["stroke"] not in ("forehand", "backhand") or shot["call"] != "in":
            continue
        found = _flown_shot(shot, after, scene)
        if found is not None:
            measured.append(_seconds(shot))
            flown.append(found[0])
            heights.append(found[1])
    ratio = np.array(flown) / np.array(measured)
    low, middle, high = np.quantile(ratio, [0.25, 0.5, 0.75]).tolist() if len(ratio) else [float("nan")] * 3
    row = {
        "part": "shots",
        "shots": len(ratio),
        "time_ratio": [low, middle, high] if len(ratio) else None,
        "height_m": float(np.median(heights)) if heights else None,
    }
    return {"rows": [row]}


def _flown_shot(shot: dict[str, str], after: dict[str, str], scene: Scene) -> tuple[float, float] | None:
    """Seconds to the next hit, and how much higher the ball is there than it was; None where no such shot lands."""
    assert scene.ball is not None
    # In the file x runs along the court.
    start = np.array([-float(shot["ball_hit_y"]), float(shot["ball_hit_x"]), float(shot["ball_hit_z"])])
    bounce = np.array([-float(shot["ball_bounce_y"]), float(shot["ball_bounce_x"])])
    end = float(after["ball_hit_x"])
    if start[1] * bounce[1] >= 0 or abs(end) <= abs(bounce[1]) or end * bounce[1] <= 0:
        return None
    world = FlightWorld(
        air=Air(), build=ball_build(scene.ball), surface=SURFACES["hard"], net=None, floor_z=0.0, bounds=WIDE
    )
    launch = aim(start, bounce, float(shot["speed_ms"]), RPM * float(shot["spin_rpm"]), 0.0, world)
    if launch is None:
        return None
    flights, contacts = follow(start, launch.velocity, launch.spin, 0.0, world, until=6.0)
    hit = Contact(time=0.0, kind="hit", player=-1, position=start)
    times = np.arange(0.0, contacts[-1].time, 0.002)
    places, _ = BallPath(flights=tuple(flights), contacts=(hit, *contacts)).at(times)
    past = np.flatnonzero(np.abs(places[:, 1]) * np.sign(places[:, 1] * end) >= abs(end))
    if not len(past):
        return None
    return float(times[past[0]]), float(places[past[0], 2] - float(after["ball_hit_z"]))


def _seconds(shot: dict[str, str]) -> float:
    begins, ends = (datetime.fromisoformat(shot[f"shot_{name}_timestamp"]) for name in ("start", "end"))
    return (ends - begins).total_seconds()


def read_columns(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Columns of numbers of a CSV file.

    Raises:
        ValueError: If one is not there or a cell is no number.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lacking = [name for name in names if not rows or name not in rows[0]]
    if lacking:
        raise ValueError(f"{path}: expected a column {lacking[0]} with rows below it, got none")
    return {name: np.array([float(row[name]) for row in rows]) for name in names}
