"""Every frame of one shot with its camera, or with the reason why it has none."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.geometry.rigid import rotvec_from_rotation
from pgm_data.lift.clip_solve import ClipSolution, between
from pgm_data.lift.court_camera import CourtCamera


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotCameras:
    """Every frame of one shot."""

    video_frame: Int[np.ndarray, " frames"]
    timestamp: Float[np.ndarray, " frames"]
    is_duplicate: Bool[np.ndarray, " frames"]
    camera: CourtCamera
    """NaN where the status is `none`."""
    status: Shaped[np.ndarray, " frames"]
    reason: Shaped[np.ndarray, " frames"]
    inliers: Int[np.ndarray, " frames"]
    reprojection_px: Float[np.ndarray, " frames"]
    position_cov: Float[np.ndarray, "frames 6"]
    focal_std_px: Float[np.ndarray, " frames"]
    solution: ClipSolution | None
    """What the frames share; None for moving cameras and where no frame has one."""
    jitter_px: float | None
    """Frame-to-frame shake of a camera that stands still."""

    @property
    def solved(self) -> bool:
        """Whether any frame has a camera."""
        return bool((self.status != "none").any())


def jitter(camera: CourtCamera, measured: Bool[np.ndarray, " frames"], width: int) -> float | None:
    """Frame-to-frame shake of a still camera, pixels; None where it moves or too few frames follow each other.

    The robust spread of second differences of pan and tilt over sqrt(6), which a slow drift does not enter.
    """
    runs = measured[:-2] & measured[1:-1] & measured[2:]
    if runs.sum() < 5:
        return None
    at = np.flatnonzero(measured)
    first = camera.R_cam_from_world[at[0]]
    turn = rotvec_from_rotation(camera.R_cam_from_world[measured] @ first.T) * camera.focal_px[measured][:, None]
    if np.ptp(turn[:, :2], axis=0).max() > 0.01 * width:
        return None
    path = np.full((len(measured), 2), np.nan)
    path[measured] = turn[:, :2]
    second = path[2:] - 2 * path[1:-1] + path[:-2]
    return float(1.4826 * np.nanmedian(np.abs(second[runs])) / np.sqrt(6))


def blank_track(count: int) -> dict[str, np.ndarray]:
    """A track of cameras that are all missing, array by array."""
    return {
        "R_cam_from_world": np.full((count, 3, 3), np.nan),
        "focal_px": np.full(count, np.nan),
        "position_world": np.full((count, 3), np.nan),
        "radial": np.full(count, np.nan),
        "principal_px": np.full((count, 2), np.nan),
    }


def set_frames(blank: dict[str, np.ndarray], frame, camera: CourtCamera | dict[str, np.ndarray]) -> None:
    """Give the frames (an index of any kind) the camera, or the track's arrays of one, in place."""
    for name, values in blank.items():
        values[frame] = camera[name] if isinstance(camera, dict) else getattr(camera, name)


def bridge(
    blank: dict[str, np.ndarray],
    status: np.ndarray,
    reason: np.ndarray,
    cov: np.ndarray,
    focal_std: np.ndarray,
    times: np.ndarray,
    longest_s: float,
    width: int,
) -> None:
    """Fill short gaps between measured frames, in place; frames beyond the last or before the first stay empty.

    A gap across which the view turns by more than a quarter of the picture is no gap of one motion, and stays empty.

    Args:
        blank: The track.
        status: Of every frame.
        reason: Why a frame is not measured.
        cov: Covariance of the centre.
        focal_std: Standard deviation of the focal length.
        times: When the pictures were taken, s.
        longest_s: Longest gap.
        width: Of the picture, pixels.
    """
    measured = np.flatnonzero(status == "measured")
    whole = CourtCamera(**blank, half_diagonal_px=1.0)
    for a, b in zip(measured[:-1], measured[1:], strict=True):
        if b - a < 2 or not 0 < times[b] - times[a] <= longest_s:
            continue
        turn = rotvec_from_rotation(whole.R_cam_from_world[b] @ whole.R_cam_from_world[a].T)
        if np.linalg.norm(turn) * whole.focal_px[a] > 0.25 * width:
            continue
        gap = np.arange(a + 1, b)
        cameras = between(whole[a], whole[b], (times[gap] - times[a]) / (times[b] - times[a]))
        set_frames(blank, gap, cameras)
        why = reason[gap[0]] or "no court found"
        status[gap] = "interpolated"
        reason[gap] = [f"bridged: {reason[g] or why}" for g in gap]
        apart = whole.position_world[b] - whole.position_world[a]
        cov[gap] = (cov[a] + cov[b]) / 2 + np.outer(apart, apart)[np.triu_indices(3)] / 4
        drift = abs(whole.focal_px[b] - whole.focal_px[a]) / 2
        focal_std[gap] = np.hypot(max(focal_std[a], focal_std[b]), drift)
