"""A clip's frames fitted together: one centre, one lens, and the court's own crookedness, shared by all of them.

Parameters: each frame has its rotation and focal length; all frames share the centre, the radial term, the principal
point where it is free, and each line's own course (a shift, a tilt and bends, pixels). A frame more of a still camera
shows the same crooked line again, so such errors must not average away: the courses are held near zero by a Gaussian
whose width is estimated with the rest, and a perfect court keeps its accuracy, a crooked one an honest error bar.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.lift.court_camera import CENTRE, PARAMETERS, PRINCIPAL, RADIAL, CourtCamera, project, step
from pgm_data.lift.line_fit import (
    BEND,
    TURN,
    Fit,
    Sightings,
    bounded,
    crooked_columns,
    judge,
    residual_scale,
    residuals,
    robust_weights,
)

COURSE = np.array([1.0, 1.0, 0.5, 0.3])
"""Relative standard deviations of the Legendre coefficients of a line's course, degree by degree."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipFit:
    """Frames that share one centre and one lens."""

    fit: Fit
    shared: tuple[int, ...]
    """Which of centre, radial term and principal point were free."""
    covariance: Float[np.ndarray, "shared shared"]
    """Of the free shared columns, all else marginalised."""
    shifts_px: Float[np.ndarray, " shifts"]
    """Coefficients of each line's own course, pixels: all lines' shifts, then their tilts, then their bends."""
    crooked_px: float
    """Their estimated standard deviation."""
    noise: float
    """Spread of the residuals in units of their stated standard deviation."""
    evidence: float
    """Minus twice the log of Laplace's marginal likelihood, up to a constant that all lens models share."""

    @property
    def position_covariance(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of the shared centre, m^2."""
        at = [self.shared.index(c) for c in range(CENTRE.start, CENTRE.stop)]
        return self.covariance[np.ix_(at, at)]


@dataclass(frozen=True, kw_only=True)
class ClipFitOptions:
    """How a clip is fitted."""

    crooked_px: float = 0.3
    """First guess of the lines' shifts and tilts, pixels."""
    typical_crooked_px: float = 0.01
    """What the estimate leans to where the data say little, pixels."""
    crooked_weight: float = 2.0
    """How many coefficients' worth that leaning weighs."""
    least_crooked_px: float = 0.003
    """Their estimate never falls below this, pixels."""
    cut: float = 4.0
    """Residuals beyond this many robust standard deviations count for nothing."""
    steps: int = 30
    """Upper bound on the steps."""
    radial_prior: tuple[float, float] = (0.02, 0.03)
    """Mean and standard deviation of the radial term of broadcast lenses; data soon outweigh it."""
    principal_prior_per_width: float = 0.03
    """Standard deviation of the principal point about the picture's centre, over the picture's width."""


def fit_clip(
    camera: CourtCamera,
    sightings: Sightings,
    *,
    shared: tuple[int, ...],
    lines: int,
    options: ClipFitOptions,
    simpler: ClipFit | None = None,
    richer: ClipFit | None = None,
) -> ClipFit:
    """One centre and lens for all frames, with each frame's own rotation and focal length.

    The normal equations are an arrow: each frame's four columns are eliminated first (Schur complement), so the
    cost grows linearly with the frames.

    Args:
        camera: Start, a track along one axis; what is shared starts at its medians.
        sightings: Measurements of the same frames.
        shared: Shared columns that may move: of centre, radial term, principal point.
        lines: Number of court lines.
        options: How.
        simpler: A fit of the same sightings with fewer free columns, to start from.
        richer: A fit with more free columns, to compare with: its noise, crookedness and inliers are taken as known, as
            lines would otherwise pass for as crooked, or for outliers, as a missing lens term makes them look.
    """
    frames = len(camera.focal_px)
    camera = replace(
        camera,
        position_world=np.broadcast_to(np.median(camera.position_world, axis=0), (frames, 3)),
        radial=np.full(frames, np.median(camera.radial)),
        principal_px=np.broadcast_to(np.median(camera.principal_px, axis=0), (frames, 2)),
    )
    rows = None if richer is None else richer.fit.inlier
    problem = _Problem(camera=camera, sightings=sightings, shared=shared, lines=lines, options=options, rows=rows)
    shifts = np.zeros(len(COURSE) * lines)
    crooked, noise, damping = options.crooked_px, 1.0, 1e-4
    if simpler is not None:
        shifts, crooked = simpler.shifts_px.copy(), simpler.crooked_px
    if richer is not None:
        crooked, noise = richer.crooked_px, richer.noise
    last, cost = np.inf, np.inf
    weak = options.crooked_weight
    information = np.eye(len(shared) + len(shifts))
    for _ in range(options.steps):
        sigma = np.hypot(sightings.sigma_px, BEND * crooked)
        r, _ = residuals(camera, sightings)
        if richer is None:
            noise = float(np.sqrt(np.mean(residual_scale(r + problem.extra @ shifts, sigma) ** 2)))
        cost = problem.cost(camera, shifts, sigma, noise, crooked)
        information, solve = problem.linearise(camera, shifts, sigma, noise, crooked)
        for _ in range(8):  # Damp until a step goes downhill; weights and variances stay as they are meanwhile.
            delta, move = solve(damping)
            tried = step(camera, delta), shifts + move
            if problem.cost(*tried, sigma, noise, crooked) <= cost + 1e-6:
                camera, shifts = tried
                damping = max(damping / 10, 1e-9)
                break
            damping *= 10
        spread = _inverse(information)
        # Expectation-maximisation of the shifts' variance: what they are, and how unsure they are.
        k = len(shared)
        # (MacKay's fixed point: their sum of squares over the number of them that the data determine.)
        if richer is None:
            own_std = problem.course_std(crooked)
            determined = np.sum(1 - np.diag(spread)[k:] / own_std**2)
            squares = np.sum((shifts / own_std) ** 2) * crooked**2
            found = np.sqrt((squares + weak * options.typical_crooked_px**2) / (max(determined, 0.0) + weak))
            crooked = float(np.clip(found, max(crooked / 3, options.least_crooked_px), crooked * 3))
        if abs(last - cost) < 0.05:
            break
        last = cost
    fit = judge(camera, sightings, cut=options.cut, course_px=problem.extra @ shifts)
    return ClipFit(
        fit=fit,
        shared=shared,
        covariance=_inverse(information)[: len(shared), : len(shared)],
        shifts_px=shifts,
        crooked_px=crooked,
        noise=noise,
        evidence=cost + problem.log_volume(information),
    )


def evidence_gain(
    simple: ClipFit, richer: ClipFit, sightings: Sightings, *, lines: int, options: ClipFitOptions
) -> float:
    """Drop of minus twice the log evidence from a simple fit to a richer one.

    Args:
        simple: Fitted with the richer one's noise, crookedness and inliers.
        richer: The one with more free columns.
        sightings: What both were fitted to.
        lines: Number of court lines.
        options: As for both.
    """
    start = replace(richer.fit.camera, principal_px=simple.fit.camera.principal_px)
    problem = _Problem(
        camera=start, sightings=sightings, shared=richer.shared, lines=lines, options=options, rows=richer.fit.inlier
    )
    sigma = np.hypot(sightings.sigma_px, BEND * richer.crooked_px)
    state = (richer.fit.camera, richer.shifts_px, sigma, richer.noise, richer.crooked_px)
    return simple.evidence - (problem.cost(*state) + problem.log_volume(problem.linearise(*state)[0]))


def _inverse(information: np.ndarray) -> np.ndarray:
    """The inverse of an information matrix whose columns differ in scale; what nothing pins is huge."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    return (vectors / np.maximum(values, 1e-12)) @ vectors.T / np.outer(size, size)


class _Problem:
    """The terms of one clip's fit that stay the same from step to step."""

    def __init__(
        self,
        *,
        camera: CourtCamera,
        sightings: Sightings,
        shared: tuple[int, ...],
        lines: int,
        options: ClipFitOptions,
        rows: np.ndarray | None,
    ) -> None:
        self.sightings, self.options, self.own = sightings, options, list(shared)
        self.rows = rows
        """Rows that count in full, whatever their residuals; None for robust weights."""
        self.extra = crooked_columns(sightings, lines, len(COURSE) - 1)
        self.shape = np.repeat(COURSE, lines)
        self.bias = np.zeros(len(self.shape))
        for line in range(lines):  # The shared error shifts and tilts a line; it does not bend it.
            of_line = sightings.line == line
            if of_line.any():
                self.bias[[line, lines + line]] = np.median(sightings.bias_px[of_line])
        self.real = np.isfinite(sightings.sigma_px)
        self.middle = camera.principal_px[0].copy()
        width = 2 * self.middle[0] + 1
        mean, std = np.zeros(PARAMETERS), np.full(PARAMETERS, np.inf)
        mean[RADIAL], std[RADIAL] = options.radial_prior
        mean[PRINCIPAL], std[PRINCIPAL] = self.middle, options.principal_prior_per_width * width
        self.mean, self.precision = mean[self.own], 1 / std[self.own] ** 2

    def course_std(self, crooked: float) -> np.ndarray:
        """Prior standard deviations of the lines' course coefficients, pixels."""
        return np.hypot(crooked * self.shape, self.bias)

    def log_volume(self, information: np.ndarray) -> float:
        """Log of prior over posterior volume of the shared parameters that have a prior."""
        prior = self.precision[self.precision > 0]
        return float(np.linalg.slogdet(information)[1] - np.log(prior).sum())

    def off_prior(self, camera: CourtCamera) -> np.ndarray:
        """How far the free shared columns lie from their prior means."""
        value = np.concatenate([np.zeros(4), np.zeros(3), camera.radial[:1], camera.principal_px[0]])
        return np.where(self.precision > 0, value[self.own] - self.mean, 0.0)

    def cost(self, camera: CourtCamera, shifts: np.ndarray, sigma: np.ndarray, noise: float, crooked: float) -> float:
        """Minus twice the log posterior, up to a constant, with residuals beyond the cut all costing the same."""
        pixels = project(camera, self.sightings.points_world)
        r = np.sum(self.sightings.normals * (pixels - self.sightings.measured_px), axis=-1) + self.extra @ shifts
        cut = self.options.cut * max(noise, 1.0) / noise
        z2 = (np.nan_to_num(r, nan=1e3) / np.where(self.real, sigma * noise, 1.0) / cut) ** 2
        # Tukey's loss, whose derivative the weights are.
        loss = cut**2 / 3 * (1 - np.clip(1 - z2, 0, 1) ** 3)
        if self.rows is not None:
            loss = np.where(self.rows, z2 * cut**2, 0.0)
        data = np.where(self.real, loss + 2 * np.log(np.where(self.real, sigma * noise, 1.0)), 0.0).sum()
        std = self.course_std(crooked)
        prior = ((shifts / std) ** 2).sum() + 2 * np.log(std).sum()
        return float(data + prior + (self.precision * self.off_prior(camera) ** 2).sum())

    def linearise(
        self, camera: CourtCamera, shifts: np.ndarray, sigma: np.ndarray, noise: float, crooked: float
    ) -> tuple[np.ndarray, Callable[[float], tuple[np.ndarray, np.ndarray]]]:
        """Information about the shared columns and shifts, and a solver of the damped step."""
        turn, own, k = list(TURN), self.own, len(self.own)
        frames = len(camera.focal_px)
        r, J = residuals(camera, self.sightings)
        r = r + self.extra @ shifts
        if self.rows is None:
            w = robust_weights(r, sigma, np.full(frames, noise), self.options.cut)
        else:
            w = np.where(self.rows, 1 / (sigma * noise) ** 2, 0.0)
        w = np.where(np.isfinite(r), w, 0.0)
        r, J = np.where(w > 0, r, 0.0), np.where(w[..., None] > 0, J, 0.0)
        own_J = np.concatenate([J[..., own], np.where(w[..., None] > 0, self.extra, 0.0)], axis=-1)
        turn_J = J[..., turn]
        turn_Jt, own_Jt = np.swapaxes(turn_J, -1, -2) * w[..., None, :], np.swapaxes(own_J, -1, -2) * w[..., None, :]
        B, E, g_turn = turn_Jt @ turn_J, turn_Jt @ own_J, turn_Jt @ r[..., None]
        precision = np.concatenate([self.precision, 1 / self.course_std(crooked) ** 2])
        D = (own_Jt @ own_J).sum(axis=0) + np.diag(precision)
        g_own = (own_Jt @ r[..., None])[..., 0].sum(axis=0) + precision * np.concatenate(
            [self.off_prior(camera), shifts]
        )

        def eliminated(damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
            scaled = np.einsum("fii->fi", B) * (damping + 1e-9) + 1e-12
            damped = B + np.eye(4) * scaled[:, None, :]
            BinvE, Binvg = np.linalg.solve(damped, E), np.linalg.solve(damped, g_turn)[..., 0]
            information = D - np.einsum("fij,fik->jk", E, BinvE)
            return information, g_own - np.einsum("fij,fi->j", E, Binvg), BinvE, Binvg

        def solve(damping: float) -> tuple[np.ndarray, np.ndarray]:
            information, rhs, BinvE, Binvg = eliminated(damping)
            move = -np.linalg.solve(information + np.diag(damping * np.diag(information) + 1e-12), rhs)
            delta = np.zeros((frames, PARAMETERS))
            delta[:, own] = move[:k]
            delta[:, turn] = -Binvg - BinvE @ move
            return bounded(delta), move[k:]

        return eliminated(0.0)[0], solve
