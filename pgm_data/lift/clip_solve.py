"""A clip's cameras from its measured lines: which lens the data support, the shared solution, and every frame's own."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from pgm_data.court import Court
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.lift.clip_fit import COURSE, ClipFit, ClipFitOptions, evidence_gain, fit_clip
from pgm_data.lift.court_camera import CourtCamera
from pgm_data.lift.line_fit import BEND, FREE_POSE, TURN, Fit, Sightings, crooked_columns, fit_track, judge, residuals
from pgm_data.lift.views import condense, group_views

CENTRE_ONLY, WITH_RADIAL, WITH_PRINCIPAL = (4, 5, 6), (4, 5, 6, 7), (4, 5, 6, 7, 8, 9)


@dataclass(frozen=True, kw_only=True)
class LensOptions:
    """When a lens parameter is fitted."""

    least_gain: float = 6.0
    """Least drop of minus twice the log evidence that frees a parameter (6 is odds of 20 to 1)."""
    views: int = 24
    """Most distinct views that the shared solution rests on."""
    view_apart: float = 0.004
    """How far a court point moves between distinct views, as a share of the picture's width."""
    try_principal: bool = True
    """Whether an off-centre principal point is tried."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipSolution:
    """What all frames of a clip share."""

    clip_fit: ClipFit
    lens_model: str
    """`pinhole`, `radial` or `radial and principal point`."""
    evidence: str
    """Why that one."""


def solve_shared(
    camera: CourtCamera,
    sightings: Sightings,
    *,
    court: Court,
    size: tuple[int, int],
    fit_options: ClipFitOptions,
    lens: LensOptions,
) -> ClipSolution:
    """The shared centre and lens of the chosen frames, with the simplest lens that the data support.

    Args:
        camera: Each frame's camera so far; centre and radial term start at their medians, the principal point at the
            picture's centre.
        sightings: Each frame's sightings.
        court: The court.
        size: Picture width and height, pixels.
        fit_options: How the clip is fitted.
        lens: When lens parameters are fitted.
    """
    lines, frames = len(court.line_names), len(camera.focal_px)
    start = replace(
        camera,
        position_world=np.broadcast_to(np.median(camera.position_world, axis=0), (frames, 3)),
        radial=np.full(frames, np.median(camera.radial)),
        principal_px=np.broadcast_to((np.array(size, dtype=float) - 1) / 2, (frames, 2)),
    )
    own = fit_track(start, sightings, free=TURN, crooked_px=fit_options.crooked_px, lines=lines)
    groups = group_views(own.camera, court.points_world, apart_px=lens.view_apart * size[0], most=lens.views)
    camera, sightings = condense(own, sightings, groups)
    radial = fit_clip(camera, sightings, shared=WITH_RADIAL, lines=lines, options=fit_options)
    straight = replace(radial.fit.camera, radial=np.zeros_like(radial.fit.camera.radial))
    pinhole = fit_clip(straight, sightings, shared=CENTRE_ONLY, lines=lines, options=fit_options, richer=radial)
    gain = evidence_gain(pinhole, radial, sightings, lines=lines, options=fit_options)
    value = float(radial.fit.camera.radial[0])
    if not gain > lens.least_gain:
        pinhole = fit_clip(straight, sightings, shared=CENTRE_ONLY, lines=lines, options=fit_options)
        text = f"a radial term of {value:.4f} gains {gain:.0f}, {lens.least_gain:.0f} wanted: none fitted"
        return ClipSolution(clip_fit=pinhole, lens_model="pinhole", evidence=text)
    text = f"radial term {value:.4f} gains {gain:.0f}, {lens.least_gain:.0f} wanted"
    if lens.try_principal:
        moved = fit_clip(
            radial.fit.camera, sightings, shared=WITH_PRINCIPAL, lines=lines, options=fit_options, simpler=radial
        )
        compared = fit_clip(
            radial.fit.camera, sightings, shared=WITH_RADIAL, lines=lines, options=fit_options, richer=moved
        )
        gain = evidence_gain(compared, moved, sightings, lines=lines, options=fit_options)
        shift = moved.fit.camera.principal_px[0] - camera.principal_px[0]
        told = f"principal point shifted by ({shift[0]:.0f}, {shift[1]:.0f}) px gains {gain:.0f}"
        if gain > lens.least_gain:
            return ClipSolution(
                clip_fit=moved,
                lens_model="radial and principal point",
                evidence=f"{text}; {told}, {lens.least_gain:.0f} wanted",
            )
        text += f"; {told}, {lens.least_gain:.0f} wanted: left at the centre"
    return ClipSolution(clip_fit=radial, lens_model="radial", evidence=text)


def key_frames(cameras: CourtCamera, most: int) -> Int[np.ndarray, " chosen"]:
    """Frames spread evenly over the path that the viewing direction and zoom describe, and over time."""
    count = len(cameras.focal_px)
    if count <= most:
        return np.arange(count)
    forward = cameras.R_cam_from_world[:, 2]
    path = np.concatenate([forward * cameras.focal_px[:, None], cameras.focal_px[:, None]], axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    # A still camera still deserves frames spread over time: noise alone travels a little, so mix both clocks.
    clock = travelled / max(travelled[-1], 1e-9) + np.arange(count) / (count - 1)
    return np.unique(np.searchsorted(clock, np.linspace(0, clock[-1], most)).clip(0, count - 1))


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameCameras:
    """Frames solved by themselves under the shared solution."""

    fit: Fit
    position_cov: Float[np.ndarray, "frames 6"]
    """xx, xy, xz, yy, yz, zz, m^2."""
    focal_std_px: Float[np.ndarray, " frames"]


def solve_frames(cameras: CourtCamera, sightings: Sightings, *, solution: ClipSolution, lines: int) -> FrameCameras:
    """Rotation and focal length of every frame, with centre, lens and the lines' own shifts as solved for the clip."""
    shared = solution.clip_fit
    frames = len(cameras.focal_px)
    one = shared.fit.camera[0]
    cameras = replace(
        cameras,
        position_world=np.broadcast_to(one.position_world, (frames, 3)),
        radial=np.broadcast_to(one.radial, (frames,)),
        principal_px=np.broadcast_to(one.principal_px, (frames, 2)),
    )
    course = (crooked_columns(sightings, lines, len(COURSE) - 1) @ shared.shifts_px)[..., None]
    straight = replace(sightings, measured_px=sightings.measured_px - sightings.normals * course)
    fit = fit_track(cameras, straight, free=TURN, crooked_px=0.0, lines=lines, cut=5.0)
    # Residuals and verdicts are against the court of the rules, crooked lines and all.
    fit = judge(fit.camera, sightings, cut=5.0, course_px=course[..., 0])
    # The focal length inherits the uncertainty of what is shared, besides its own noise.
    sigma = straight.sigma_px * shared.noise
    _, J = residuals(fit.camera, straight)
    w = np.where(fit.inlier, 1 / np.where(np.isfinite(sigma), sigma, np.inf) ** 2, 0.0)
    J = np.where(fit.inlier[..., None], J, 0.0)
    A = (np.swapaxes(J, -1, -2) * w[..., None, :]) @ J
    turn, own = list(TURN), list(shared.shared)
    B = A[:, turn][:, :, turn] + 1e-9 * np.eye(4)
    inverse = np.linalg.inv(B)
    by_shared = -(inverse @ A[:, turn][:, :, own])[:, 3]
    variance = inverse[:, 3, 3] + np.einsum("fi,ij,fj->f", by_shared, shared.covariance, by_shared)
    cov = shared.position_covariance
    packed = np.array([cov[0, 0], cov[0, 1], cov[0, 2], cov[1, 1], cov[1, 2], cov[2, 2]])
    return FrameCameras(
        fit=fit,
        position_cov=np.broadcast_to(packed, (frames, 6)).copy(),
        focal_std_px=fit.camera.focal_px * np.sqrt(np.maximum(variance, 0)),
    )


def solve_moving(cameras: CourtCamera, sightings: Sightings, *, lines: int, crooked_px: float) -> FrameCameras:
    """Every frame with a centre of its own, for scenes whose camera moves; the lens stays as it was found."""
    fit = fit_track(cameras, sightings, free=FREE_POSE, crooked_px=crooked_px, lines=lines)
    free = list(FREE_POSE)
    A = fit.normal_matrix[:, free][:, :, free] + 1e-9 * np.eye(len(free))
    # The information is in units of the stated deviations; where residuals spread wider, so do the error bars.
    sigma = np.hypot(sightings.sigma_px, BEND * crooked_px)
    z = np.where(fit.inlier, np.nan_to_num(fit.residual_px) / np.where(np.isfinite(sigma), sigma, 1.0), 0.0)
    chi2 = (z**2).sum(axis=-1) / np.maximum(fit.inlier.sum(axis=-1) - len(free), 1)
    spread = np.linalg.inv(A) * np.maximum(chi2, 1.0)[:, None, None]
    cov = spread[:, 4:, 4:]
    packed = np.stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 0, 2], cov[:, 1, 1], cov[:, 1, 2], cov[:, 2, 2]], axis=1)
    return FrameCameras(fit=fit, position_cov=packed, focal_std_px=fit.camera.focal_px * np.sqrt(spread[:, 3, 3]))


def between(before: CourtCamera, after: CourtCamera, share: Float[np.ndarray, " frames"]) -> CourtCamera:
    """Cameras on the way from one to another: evenly turning, evenly zooming (in log focal), evenly moving."""
    turn = rotvec_from_rotation(after.R_cam_from_world @ before.R_cam_from_world.T)
    R = rotation_from_rotvec(share[:, None] * turn) @ before.R_cam_from_world
    focal = before.focal_px * (after.focal_px / before.focal_px) ** share

    def mix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        weight = share.reshape(-1, *([1] * np.ndim(a)))
        return (1 - weight) * a + weight * b

    return replace(
        before,
        R_cam_from_world=R,
        focal_px=focal,
        position_world=mix(before.position_world, after.position_world),
        radial=mix(before.radial, after.radial),
        principal_px=mix(before.principal_px, after.principal_px),
    )
