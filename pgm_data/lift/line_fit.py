"""Cameras fitted to measured court lines, each frame by itself.

Every line measurement pins a camera only ACROSS the line, so a residual is
``normal . (projected point - measured point)``, pixels. Points seen as points (net posts, a person's marks) enter
as two such rows with normals along x and y.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial.legendre import legvander

from pgm_data.geometry.arrays import frozen
from pgm_data.lift.court_camera import (
    PARAMETERS,
    CourtCamera,
    project_with_jacobian,
    step,
)

BEND = 0.5
"""How far lines bend between their ends, as a share of how far they are shifted and tilted."""
TURN = tuple(range(0, 4))
"""Free columns of a frame whose centre and lens are known: rotation and focal length."""
FREE_POSE = tuple(range(0, 7))
"""Rotation, focal length and centre."""
FREE_LENS = tuple(range(0, 8))
"""Rotation, focal length, centre and the radial term."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sightings:
    """Measurements of one frame, or of a track of frames padded with rows of zero weight."""

    points_world: Float[np.ndarray, "*batch rows 3"]
    """Known points, metres."""
    measured_px: Float[np.ndarray, "*batch rows 2"]
    """Where each was measured."""
    normals: Float[np.ndarray, "*batch rows 2"]
    """Unit direction along which the measurement counts."""
    sigma_px: Float[np.ndarray, "*batch rows"]
    """Standard deviation along that direction; infinite for padding."""
    line: Int[np.ndarray, "*batch rows"]
    """Index of the court line; -1 for points."""
    along: Float[np.ndarray, "*batch rows"]
    """Place on the line, -1 at its first end and 1 at its last; 0 for points."""
    bias_px: Float[np.ndarray, "*batch rows"]
    """Standard deviation of an error that all rows of the line share, in all frames."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("points_world", "measured_px", "normals", "sigma_px", "along", "bias_px"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "line", frozen(self.line, np.int64))

    def __getitem__(self, index) -> "Sightings":
        """The sightings at the given leading index."""
        return Sightings(
            points_world=self.points_world[index],
            measured_px=self.measured_px[index],
            normals=self.normals[index],
            sigma_px=self.sigma_px[index],
            line=self.line[index],
            along=self.along[index],
            bias_px=self.bias_px[index],
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """A fitted camera or track, and how well its sightings agree."""

    camera: CourtCamera
    residual_px: Float[np.ndarray, "*batch rows"]
    """Signed residuals along the normals, the lines' own shifts included; NaN for padding and without an image."""
    inlier: Bool[np.ndarray, "*batch rows"]
    rms_px: Float[np.ndarray, "*batch"]
    """Root mean square residual of the inliers."""
    normal_matrix: Float[np.ndarray, "*batch 10 10"]
    """Weighted information about all ten parameters at the solution."""


def residuals(camera: CourtCamera, sightings: Sightings) -> tuple[np.ndarray, np.ndarray]:
    """Signed residuals (…, rows) and their derivatives (…, rows, 10)."""
    pixels, J = project_with_jacobian(camera, sightings.points_world)
    r = np.sum(sightings.normals * (pixels - sightings.measured_px), axis=-1)
    return r, (sightings.normals[..., None, :] @ J)[..., 0, :]


def robust_weights(r: np.ndarray, sigma: np.ndarray, scale: np.ndarray, cut: float) -> np.ndarray:
    """Tukey's weights over the variance; zero beyond `cut` standard deviations, stated or found, whichever is more."""
    z = r / (sigma * np.maximum(scale, 1.0)[..., None] * cut)
    inside = np.abs(np.nan_to_num(z, nan=2.0)) < 1
    return np.where(inside, (1 - np.where(inside, z, 0.0) ** 2) ** 2, 0.0) / (sigma * scale[..., None]) ** 2


def residual_scale(r: np.ndarray, sigma: np.ndarray, floor: float = 0.2) -> np.ndarray:
    """How many stated standard deviations the residuals really spread over (1.48 MAD), at least the floor."""
    z = np.where(np.isfinite(sigma) & np.isfinite(r), np.abs(r) / np.where(np.isfinite(sigma), sigma, 1.0), np.nan)
    some = np.isfinite(z).any(axis=-1)
    median = np.zeros(z.shape[:-1])
    median[some] = np.nanmedian(z[some], axis=-1)
    return np.asarray(np.maximum(1.4826 * median, floor))


def crooked_columns(sightings: Sightings, lines: int, degree: int) -> Float[np.ndarray, "*batch rows columns"]:
    """Derivatives of the residuals by each line's own course, pixels: Legendre polynomials along it, degree by degree.

    Painted lines are not where the rules put them: real ones lie up to a centimetre or two off and bend, and a
    profile's bias is the same all along a line. Each line may therefore be shifted (degree 0), tilted (1) and bent.
    """
    onehot = (sightings.line[..., None] == np.arange(lines)).astype(float)
    shapes = legvander(np.clip(sightings.along, -1, 1), degree)
    return np.concatenate([onehot * shapes[..., n, None] for n in range(degree + 1)], axis=-1)


def fit_track(
    camera: CourtCamera,
    sightings: Sightings,
    *,
    free: tuple[int, ...],
    crooked_px: float,
    lines: int,
    cut: float = 4.0,
    steps: int = 8,
    prior: tuple[Float[np.ndarray, " 10"], Float[np.ndarray, " 10"]] | None = None,
) -> Fit:
    """Each frame fitted by itself over the free columns, by damped Gauss-Newton with Tukey's weights.

    Args:
        camera: Start, with the sightings' leading axes.
        sightings: Measurements.
        free: Columns that may move.
        crooked_px: Standard deviation of each line's own shift and tilt, pixels; 0 for lines that are exact.
        lines: Number of court lines.
        cut: Residuals beyond this many robust standard deviations count for nothing.
        steps: Upper bound on the steps.
        prior: Standard deviations that hold each column near a value, and how far the start is from that value.
    """
    columns = list(free)
    batch = camera.focal_px.shape
    width = len(columns) + (2 * lines if crooked_px > 0 else 0)
    extra = crooked_columns(sightings, lines, 1) if crooked_px > 0 else None
    precision = np.zeros(width)
    moved = np.zeros((*batch, width))
    if prior is not None:
        precision[: len(columns)] = 1 / prior[0][columns] ** 2
        moved[..., : len(columns)] = prior[1][columns]
    precision[len(columns) :] = 1 / max(crooked_px, 1e-9) ** 2
    for _ in range(steps):
        r, J = residuals(camera, sightings)
        J = J[..., columns]
        if extra is not None:
            r = r + (extra @ moved[..., len(columns) :, None])[..., 0]
            J = np.concatenate([J, extra], axis=-1)
        sigma = np.hypot(sightings.sigma_px, BEND * crooked_px)
        w = np.where(np.isfinite(r), robust_weights(r, sigma, residual_scale(r, sigma), cut), 0.0)
        r, J = np.where(w > 0, r, 0.0), np.where(w[..., None] > 0, J, 0.0)
        Jt = np.swapaxes(J, -1, -2) * w[..., None, :]
        A = Jt @ J + np.diag(precision)
        g = (Jt @ r[..., None])[..., 0] + precision * moved
        A = A + np.eye(width) * (1e-9 * np.einsum("...ii->...i", A) + 1e-12)[..., None, :]
        move = -np.linalg.solve(A, g[..., None])[..., 0]
        delta = np.zeros((*batch, PARAMETERS))
        delta[..., columns] = move[..., : len(columns)]
        delta = bounded(delta)
        camera = step(camera, delta)
        moved = moved + np.concatenate([delta[..., columns], move[..., len(columns) :]], axis=-1)
        if np.abs(delta[..., :4]).max(initial=0.0) < 1e-8 and np.abs(delta[..., 4:]).max(initial=0.0) < 1e-5:
            break
    course = None if extra is None else (extra @ moved[..., len(columns) :, None])[..., 0]
    return judge(camera, sightings, cut=cut, course_px=course, crooked_px=crooked_px)


def judge(
    camera: CourtCamera,
    sightings: Sightings,
    *,
    cut: float = 4.0,
    course_px: np.ndarray | None = None,
    crooked_px: float = 0.0,
) -> Fit:
    """The fit of a given camera: residuals, inliers, and information.

    Args:
        camera: Camera or track.
        sightings: Measurements.
        cut: Residuals beyond this many robust standard deviations are outliers.
        course_px: How far each line itself is off at each row, taken off before outliers are told apart.
        crooked_px: Standard deviation of lines' bends that were not taken off, pixels, over `BEND`.
    """
    r, J = residuals(camera, sightings)
    whole = r
    if course_px is not None:
        r = r + course_px
    sigma = np.hypot(sightings.sigma_px, BEND * crooked_px)
    scale = residual_scale(r, sigma)
    real = np.isfinite(sigma) & np.isfinite(r)
    limit = cut * np.where(real, sigma, 1.0) * np.maximum(scale, 1.0)[..., None]
    inlier = real & (np.abs(np.nan_to_num(r)) < limit)
    count = np.maximum(inlier.sum(axis=-1), 1)
    rms = np.sqrt(np.where(inlier, np.nan_to_num(whole) ** 2, 0.0).sum(axis=-1) / count)
    w = np.where(inlier, 1.0 / np.where(real, sigma, np.inf) ** 2, 0.0)
    J = np.where(inlier[..., None], J, 0.0)
    A = (np.swapaxes(J, -1, -2) * w[..., None, :]) @ J
    return Fit(
        camera=camera, residual_px=np.where(real, whole, np.nan), inlier=inlier, rms_px=np.asarray(rms), normal_matrix=A
    )


def bounded(delta: np.ndarray) -> np.ndarray:
    """Steps kept within what one linearisation can be trusted for."""
    limit = np.array([0.05, 0.05, 0.05, 0.2, 3.0, 5.0, 3.0, 0.05, 50.0, 50.0])
    return np.clip(delta, -limit, limit)
