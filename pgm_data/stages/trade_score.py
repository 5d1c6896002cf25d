"""How far solved cameras are from true ones, and how well their stated deviations cover it: numbers per clip.

A clip is SOLVED when nine frames in ten have a camera and the court of the median frame lies near its true place. The
true camera is projected by the code that drew the pictures, the solved one by `pgm_data.geometry`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.geometry.camera import Camera, project
from pgm_data.simulate.camera import pixels_of

SOLVED_SHARE = 0.9
"""Least share of a solved clip's frames that have a camera."""
RIGHT_SHARE = 0.004
"""A camera whose court lies further off than this share of the picture's width (5 px at 1280) is wrong."""
POINT_STEP_M = 0.5
"""Distance between the points that a court's lines are compared at."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameErrors:
    """Errors of the frames that have both a true and a solved camera; empty where there is none."""

    centre_m: Float[np.ndarray, "frames 3"]
    """Solved less true position, world axes."""
    centre_sigma_m: Float[np.ndarray, "frames 3"]
    """Stated standard deviations."""
    focal: Float[np.ndarray, " frames"]
    """Solved less true focal length, over the true one."""
    focal_sigma: Float[np.ndarray, " frames"]
    """Stated standard deviation, over the true focal length."""
    court_px: Float[np.ndarray, " frames"]
    """Rms distance between the solved and the true places of the court's line points in view."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipScore:
    """One video under one preset, as JSON keeps it: None where no camera was found."""

    video: str
    preset: str
    width: int
    frames: int
    """Decoded frames that show the court."""
    measured: int
    interpolated: int
    false_frames: int
    """Frames with a camera in shots that do not show the court."""
    reason: str
    """Commonest reason of frames without a camera; empty when all have one."""
    lens_model: str
    distance_m: float
    """True distance of the camera from the net, along the ground."""
    height_m: float
    focal_widths: float
    """True focal length (median frame), in picture widths."""
    pan_px: float
    """How far the true camera's aim moves, pixels."""
    zoom: float
    """Longest over shortest true focal length."""
    centre_m: tuple[float, float, float] | None
    """Median over frames of the centre's error, by axis."""
    centre_sigma_m: tuple[float, float, float] | None
    focal: float | None
    """Median over frames of the focal length's absolute relative error."""
    focal_sigma: float | None
    focal_covered: float | None
    """Share of frames whose focal error is within one stated deviation."""
    court_px: float | None
    """Median over frames of the court's rms error."""
    worst_px: float | None
    """The same of the worst frame."""
    seconds: float
    """Wall clock of the calibration, decoding and reports included."""
    cpu_s: float
    """Processor time of the same, all threads."""
    memory_mb: float
    """Peak of the process."""

    @property
    def solved(self) -> bool:
        """Whether the clip counts as solved."""
        return self.found and not self.wrong

    @property
    def found(self) -> bool:
        """Whether nearly all frames have a camera, right or wrong."""
        return self.measured + self.interpolated >= SOLVED_SHARE * self.frames

    @property
    def wrong(self) -> bool:
        """Whether it has cameras that are far off."""
        return self.court_px is not None and self.court_px > RIGHT_SHARE * self.width

    @property
    def centre_error_m(self) -> float:
        """Distance of the solved centre from the true one; NaN without a camera."""
        return float("nan") if self.centre_m is None else float(np.linalg.norm(self.centre_m))


def line_points(court: Court) -> Float[np.ndarray, "points 3"]:
    """Points along the centres of the court's lines, evenly spaced on each."""
    points = []
    for a, b in court.lines_world:
        steps = max(2, round(float(np.linalg.norm(b - a)) / POINT_STEP_M) + 1)
        points.append(a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a))
    return np.concatenate(points)


def true_pixels(truth: Camera, points_world: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "frames points 2"]:
    """Where the drawing camera puts world points in every frame; NaN behind the camera or without one."""
    frames = zip(truth.K, truth.distortion[:, 0], truth.R_cam_from_world, truth.t_cam_from_world, strict=True)
    return np.stack([pixels_of(points_world, K, float(k1), R, t) for K, k1, R, t in frames])


def court_error_px(
    solved: Camera, truth: Camera, court: Court, *, size: tuple[int, int]
) -> Float[np.ndarray, " frames"]:
    """Rms distance over the line points that truly lie in the picture; NaN where none does or a camera is missing.

    A point that the solved camera does not see counts as the picture's width off.
    """
    points = line_points(court)
    there = true_pixels(truth, points)
    here, seen = project(solved, points)
    width, height = size
    x, y = there[..., 0], there[..., 1]
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
    off = np.where(seen, np.linalg.norm(here - there, axis=-1), float(width))
    count = inside.sum(axis=1)
    mean = np.where(inside, off**2, 0.0).sum(axis=1) / np.maximum(count, 1)
    has = np.isfinite(solved.K[:, 0, 0]) & (count > 0)
    return np.where(has, np.sqrt(mean), np.nan)


def frame_errors(
    solved: Camera,
    position_cov: Float[np.ndarray, "frames 6"],
    focal_std_px: Float[np.ndarray, " frames"],
    truth: Camera,
    court: Court,
    *,
    size: tuple[int, int],
) -> FrameErrors:
    """Errors of every frame; all cameras of `solved` and `truth` are there, frame by frame."""
    focal = truth.K[:, 0, 0]
    return FrameErrors(
        centre_m=solved.position_world - truth.position_world,
        centre_sigma_m=np.sqrt(np.maximum(position_cov[:, [0, 3, 5]], 0.0)),
        focal=solved.K[:, 0, 0] / focal - 1.0,
        focal_sigma=focal_std_px / focal,
        court_px=court_error_px(solved, truth, court, size=size),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Cost:
    """What a calibration took."""

    seconds: float
    cpu_s: float
    memory_mb: float


def score_video(
    *,
    video: str,
    preset: str,
    size: tuple[int, int],
    solved: Sequence[ClipCamera],
    truth: Sequence[ClipCamera],
    court: Court,
    lens_model: str,
    cost: Cost,
) -> ClipScore:
    """The score of one video whose clips were solved and whose true clips are known; matched by video frame.

    Raises:
        ValueError: If no true clip is given.
    """
    if not truth:
        raise ValueError(f"{video}: expected a true clip at least, got none")
    place = {int(f): (c, i) for c in solved for i, f in enumerate(c.video_frame)}
    true_frames = [int(f) for c in truth for f in c.video_frame]
    real = _joined([c.camera for c in truth])
    found = [place.get(f) for f in true_frames]
    status = np.array(["none" if p is None else p[0].status[p[1]] for p in found])
    reasons = [p[0].reason[p[1]] if p else "in no clip" for p, s in zip(found, status, strict=True) if s == "none"]
    has = np.flatnonzero(status != "none")
    false = sum(int(c.has_camera[i]) for f, (c, i) in place.items() if f not in set(true_frames))
    focal = real.K[:, 0, 0]
    aim = real.R_cam_from_world[:, 2]
    errors = None
    if len(has):
        rows = [p for p in (found[i] for i in has) if p is not None]
        errors = frame_errors(
            _joined([c.camera[i : i + 1] for c, i in rows]),
            np.stack([c.position_cov[i] for c, i in rows]),
            np.array([c.focal_std_px[i] for c, i in rows]),
            real[has],
            court,
            size=size,
        )
    position = real.position_world[0]
    return ClipScore(
        video=video,
        preset=preset,
        width=size[0],
        frames=len(true_frames),
        measured=int((status == "measured").sum()),
        interpolated=int((status == "interpolated").sum()),
        false_frames=false,
        reason=max(sorted(set(reasons)), key=reasons.count) if reasons else "",
        lens_model=lens_model,
        distance_m=float(np.hypot(position[0], position[1])),
        height_m=float(position[2]),
        focal_widths=float(np.median(focal)) / size[0],
        pan_px=float(np.arccos(np.clip(aim @ aim[0], -1, 1)).max() * np.median(focal)),
        zoom=float(focal.max() / focal.min()),
        centre_m=None if errors is None else _triple(errors.centre_m),
        centre_sigma_m=None if errors is None else _triple(errors.centre_sigma_m),
        focal=None if errors is None else float(np.median(np.abs(errors.focal))),
        focal_sigma=None if errors is None else float(np.median(errors.focal_sigma)),
        focal_covered=None if errors is None else float(np.mean(np.abs(errors.focal) <= errors.focal_sigma)),
        court_px=None if errors is None else float(np.nanmedian(errors.court_px)),
        worst_px=None if errors is None else float(np.nanmax(errors.court_px)),
        seconds=cost.seconds,
        cpu_s=cost.cpu_s,
        memory_mb=cost.memory_mb,
    )


def coverage(error: Float[np.ndarray, " clips"], sigma: Float[np.ndarray, " clips"]) -> float:
    """Share of errors within one stated deviation, which is 0.683 where the deviations are right; NaN without any."""
    known = np.isfinite(error) & np.isfinite(sigma)
    return float(np.mean(np.abs(error[known]) <= sigma[known])) if known.any() else float("nan")


def coverage_by_thirds(
    error: Float[np.ndarray, " clips"], sigma: Float[np.ndarray, " clips"]
) -> tuple[float, float, float]:
    """`coverage` among the smallest, middle and largest stated deviations."""
    order = np.argsort(sigma)
    low, middle, high = (coverage(error[part], sigma[part]) for part in np.array_split(order, 3))
    return low, middle, high


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.median(values, axis=0))
    return x, y, z


def _joined(cameras: Sequence[Camera]) -> Camera:
    names = ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    return Camera(**{name: np.concatenate([getattr(c, name) for c in cameras]) for name in names})
