"""Whether a fitted camera may be believed: enough of the court seen, small residuals, and a camera that could exist."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from pgm_data.court import Court
from pgm_data.lift.court_camera import CourtCamera, project
from pgm_data.lift.line_fit import Fit, Sightings


@dataclass(frozen=True, kw_only=True)
class TrustOptions:
    """What a frame's camera must show."""

    least_share: float = 0.55
    """Least share of the readable samples that support the camera."""
    line_share: float = 0.4
    """Share of a line's samples that must support it for the line to count as seen."""
    least_lines: int = 5
    """Fewest lines seen (or all but one, on courts with fewer)."""
    most_missing: int = 1
    """Most lines of which at least `missing_of` samples are readable and hardly any agree."""
    missing_of: int = 10
    missing_share: float = 0.1
    """Share of a line's samples under which it counts as missing."""
    least_each_way: int = 2
    """Fewest lines seen along, and fewest across, the court."""
    rms_px: tuple[float, float] = (0.45, 0.0008)
    """Greatest rms residual: pixels, plus this share of the picture's width."""
    height_per_length: tuple[float, float] = (0.03, 4.0)
    """Least and greatest camera height over the court's length."""
    distance_per_length: tuple[float, float] = (0.4, 12.0)
    """Least and greatest distance from the court's centre over the court's length."""
    focal_per_width: tuple[float, float] = (0.35, 12.0)
    """Least and greatest focal length over the picture's width."""
    roll_deg: float = 20.0
    """Greatest roll."""
    radial: tuple[float, float] = (-0.08, 0.12)
    """Least and greatest radial lens term: beyond what lenses of match cameras show, a misfit is likelier."""


def line_counts(
    line: Int[np.ndarray, " rows"], lines: int, which: Bool[np.ndarray, " rows"]
) -> Int[np.ndarray, " lines"]:
    """How many of the chosen rows lie on each line."""
    return np.bincount(line[which & (line >= 0)], minlength=lines)


def frame_trust(
    *,
    support: Int[np.ndarray, " lines"],
    readable: Int[np.ndarray, " lines"],
    rms_px: float,
    width: int,
    court: Court,
    options: TrustOptions,
) -> str:
    """Why the frame's camera cannot be believed; empty where it can.

    Args:
        support: Samples of each line that agree with the camera.
        readable: Samples of each line that lie inside the picture.
        rms_px: Rms residual of those that agree.
        width: Of the picture, pixels.
        court: The court.
        options: Limits.
    """
    total = int(readable.sum())
    if total < 12:
        return "too little of the court in view"
    share = support.sum() / total
    if share < options.least_share:
        return f"court lines not found: {share:.0%} of samples agree, {options.least_share:.0%} wanted"
    seen = (support >= 3) & (support >= options.line_share * readable)
    ends = court.lines_world
    along = np.abs(ends[:, 1, 1] - ends[:, 0, 1]) > np.abs(ends[:, 1, 0] - ends[:, 0, 0])
    least = min(options.least_lines, len(seen) - 1)
    if seen.sum() < least:
        return f"too few court lines seen: {int(seen.sum())}, {least} wanted"
    for name, way in (("along", along), ("across", ~along)):
        if (seen & way).sum() < options.least_each_way:
            return f"too few lines {name} the court seen: {int((seen & way).sum())}, {options.least_each_way} wanted"
    missing = (readable >= options.missing_of) & (support < options.missing_share * readable)
    if missing.sum() > options.most_missing:
        return f"{int(missing.sum())} court lines are not where they should be in plain view"
    limit = options.rms_px[0] + options.rms_px[1] * width
    if not rms_px <= limit:
        return f"lines disagree with the court: rms {rms_px:.2f} px, {limit:.2f} px allowed"
    return ""


def camera_trust(camera: CourtCamera, court: Court, *, width: int, options: TrustOptions) -> str:
    """Why one camera cannot exist at a court; empty where it can."""
    length = float(np.ptp(court.points_world[:, 1]))
    position = camera.position_world
    height, distance = position[2] / length, float(np.linalg.norm(position)) / length
    if not options.height_per_length[0] <= height <= options.height_per_length[1]:
        return f"camera height {position[2]:.1f} m is not plausible"
    if not options.distance_per_length[0] <= distance <= options.distance_per_length[1]:
        return f"camera distance {distance * length:.1f} m is not plausible"
    focal = float(camera.focal_px) / width
    if not options.focal_per_width[0] <= focal <= options.focal_per_width[1]:
        return f"focal length {float(camera.focal_px):.0f} px is not plausible"
    right = camera.R_cam_from_world[0]
    roll = np.degrees(np.arcsin(np.clip(abs(right[2]), 0, 1)))
    if camera.R_cam_from_world[1, 2] > 0.2:
        return "the camera hangs upside down"
    if roll > options.roll_deg:
        return f"roll {roll:.0f} deg is not plausible"
    if not options.radial[0] <= float(camera.radial) <= options.radial[1]:
        return f"radial lens term {float(camera.radial):.3f} is not plausible"
    if not np.isfinite(project(camera, court.points_world)).any():
        return "the court lies behind the camera"
    return ""


def fit_support(fit: Fit, sightings: Sightings, lines: int) -> Int[np.ndarray, " lines"]:
    """How many inliers of one frame lie on each line."""
    return line_counts(sightings.line, lines, fit.inlier)
