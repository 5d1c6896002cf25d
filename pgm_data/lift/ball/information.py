"""How sure a fit is: covariances from its information matrix, those of what was held among them.

The constraints tie all nodes of a flight to its start, so the unknowns are condensed to what may move on its own: where
the rally starts, the velocity after each contact, spins, contact times and the shared constants. All else is linear in
those.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.camera import Camera, project
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.ball.flight_model import air_law, flow_function
from pgm_data.lift.ball.rally_fit import RallyFit
from pgm_data.lift.ball.rally_plan import HELD_M, HELD_S
from pgm_data.lift.ball.world import BallWorld
from pgm_data.lift.camera_doubt import CameraDoubt

STEP_M = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class Information:
    """What a fit knows of its unknowns and of the ball at its pictures."""

    spread: Float[np.ndarray, "unknowns free"]
    """Square root of the unknowns' covariance: times its transpose."""
    picture_spread: Float[np.ndarray, "pictures 6 free"]
    """Of the states at the pictures."""
    camera_spread: Float[np.ndarray, "unknowns errors"]
    """What one standard deviation of each of the camera's shared errors does to the unknowns."""
    picture_camera_spread: Float[np.ndarray, "pictures 6 errors"]
    """And to the states at the pictures."""
    chi2: float
    """Sum of the measurements' squared residuals in standard deviations over their degrees of freedom."""
    weakest: float
    """Smallest eigenvalue of the scaled information matrix over its largest."""

    @property
    def inflation(self) -> float:
        """By how much variances grow since residuals are larger than stated."""
        return max(self.chi2, 1.0)

    def covariance(self, places: Int[np.ndarray, "*rows width"]) -> Float[np.ndarray, "*rows width width"]:
        """Of groups of unknowns."""
        rows, camera = self.spread[places], self.camera_spread[places]
        own = rows @ np.swapaxes(rows, -1, -2) * self.inflation
        return own + camera @ np.swapaxes(camera, -1, -2)

    def std(self, places: Int[np.ndarray, "*rows"]) -> Float[np.ndarray, "*rows"]:
        """Standard deviations of unknowns."""
        own = (self.spread[places] ** 2).sum(axis=-1) * self.inflation
        return np.sqrt(own + (self.camera_spread[places] ** 2).sum(axis=-1))

    @property
    def position_cov(self) -> Float[np.ndarray, "pictures 3 3"]:
        """Of the ball at the pictures, m^2."""
        rows, camera = self.picture_spread[:, :3], self.picture_camera_spread[:, :3]
        own = rows @ np.swapaxes(rows, -1, -2) * self.inflation
        return own + camera @ np.swapaxes(camera, -1, -2)


def information(fit: RallyFit, *, camera: Camera, world: BallWorld, doubt: CameraDoubt) -> Information:
    """The information of a fit.

    Args:
        fit: A solution.
        camera: One a frame of the track.
        world: What the ball flew in.
        doubt: How far the camera may be off.
    """
    H, A, tied, free = _normal_equations(fit)
    T = _condensed(A, tied, free)
    matrix = np.asarray(T.T @ (H @ T))
    root, weakest = _inverse_root(matrix)
    spread = T @ root
    pictures = _picture_rows(fit, world)
    columns = _picture_columns(fit)
    marked, mark_frames = _marks(fit)
    count = len(fit.plan.picture)
    errors = camera_errors(camera[np.concatenate([fit.plan.frames.index[fit.plan.picture], mark_frames])], doubt, world)
    pulled = _pull(fit, camera, [off[:count] for off in errors])
    # Gradient of the cost by the unknowns under each camera error; the solution moves against it.
    gradient = np.zeros((len(T), pulled.shape[-1]))
    moved = np.einsum("pij,pie->pje", pictures[:, :3], pulled)
    np.add.at(gradient, columns, moved)
    if len(marked) and errors:
        ground = fit.plan.layout.position[marked, :2]
        gradient[ground] += _mark_pull(fit, camera[mark_frames], marked, [off[count:] for off in errors])
    camera_spread = -(spread @ (spread.T @ gradient))
    picture_camera = np.einsum("pij,pje->pie", pictures, camera_spread[columns]) if len(columns) else moved
    misfit = fit.misfit
    seen = np.isfinite(misfit)
    # Each coordinate counts; what priors determine is no loss of freedom.
    shown = np.einsum("pij,pjk->pik", pictures, spread[columns]) if len(columns) else np.zeros((0, 6, len(free)))
    freedom = max(2 * int(seen.sum()) - _spent(fit, shown, camera), 1.0)
    return Information(
        spread=spread,
        picture_spread=shown,
        camera_spread=camera_spread,
        picture_camera_spread=picture_camera,
        chi2=float((misfit[seen] ** 2).sum() / freedom) if seen.any() else 1.0,
        weakest=weakest,
    )


def _normal_equations(fit: RallyFit):
    """Hessian of the cost, Jacobian of the constraints in the unknowns' own units, tied and free unknowns."""
    import scipy.sparse as sp

    plan, layout = fit.plan, fit.plan.layout
    data, n = plan.data, plan.layout.size
    x, p = fit.unknowns / data.scale, data.packed(layout.pattern)
    unscale = sp.diags(1 / data.scale)
    upper = _scipy(fit.problem.curvature(x, p))
    H = sp.csc_matrix(unscale @ (upper + sp.triu(upper, 1).T) @ unscale)
    extra = np.zeros(n)
    held = plan.held
    known = held & (data.prior_precision == 0)
    # What is held without a prior is known; the rest keeps the uncertainty of its prior.
    extra[known] = 1 / HELD_M**2
    times = layout.time[held[layout.time]]
    extra[times] = 1 / HELD_S**2
    A = sp.csc_matrix(_scipy(fit.problem.constraints(x, p)[1]) @ unscale)
    tied = layout.interval_to.ravel()
    free = np.setdiff1d(np.arange(n), tied)
    return sp.csc_matrix(H + sp.diags(extra)), A, tied, free


def _scipy(matrix):
    import scipy.sparse as sp

    pattern = matrix.sparsity()
    values = np.array(matrix.nonzeros())
    return sp.csc_matrix((values, np.array(pattern.row()), np.array(pattern.colind())), shape=matrix.shape)


def _condensed(A, tied: np.ndarray, free: np.ndarray) -> Float[np.ndarray, "unknowns free"]:
    """All unknowns as linear in the free ones along the constraints."""
    from scipy.sparse.linalg import splu

    T = np.zeros((A.shape[1], len(free)))
    T[free, np.arange(len(free))] = 1.0
    factors = splu(A[:, tied].tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
    T[tied] = -factors.solve(A[:, free].toarray())
    return T


def _inverse_root(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """A square root of the inverse, and how well conditioned it was; directions that nothing pins get a huge one."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    kept = np.maximum(values, 1e-13 * values[-1])
    return vectors / np.sqrt(kept) / size[:, None], float(values[0] / values[-1])


def _picture_columns(fit: RallyFit) -> Int[np.ndarray, "pictures 10"]:
    """Unknowns on which the state at each picture depends: its node, spin and drag."""
    layout, plan = fit.plan.layout, fit.plan
    drag = np.full((len(plan.picture), 1), layout.drag)
    if not len(plan.picture):
        return np.zeros((0, 10), dtype=int)
    return np.concatenate([layout.node[plan.picture_node], layout.spin[plan.picture_flight], drag], axis=1)


def _picture_rows(fit: RallyFit, world: BallWorld) -> Float[np.ndarray, "pictures 6 10"]:
    """Derivatives of the state at each picture by those."""
    plan, layout = fit.plan, fit.plan.layout
    count = len(plan.picture)
    rows = np.zeros((count, 6, 10))
    rows[:, :, :6] = np.eye(6)
    later = np.flatnonzero(plan.picture_delay != 0)
    if len(later):
        f = flow_function(air_law(world), layout.pattern.steps).map(len(later))
        node = fit.unknowns[layout.node[plan.picture_node[later]]]
        spin = fit.unknowns[layout.spin[plan.picture_flight[later]]]
        J = np.array(f(node.T, spin.T, fit.unknowns[layout.drag], plan.picture_delay[later][None])[1])
        rows[later] = J.reshape(6, len(later), 11).transpose(1, 0, 2)[:, :, :10]
    return rows


def _weights(fit: RallyFit) -> Float[np.ndarray, " pictures"]:
    """Weight of each picture's pixel in the cost, 1/px^2; 0 where there is none."""
    precision = fit.plan.frames.precision[fit.plan.picture]
    misfit = np.nan_to_num(fit.misfit)
    return precision / np.sqrt(1 + (misfit / fit.plan.data.bend) ** 2)


def _pixel_rows(camera: Camera, points: Float[np.ndarray, "pictures 3"]) -> Float[np.ndarray, "pictures 2 3"]:
    """Derivatives of pixels by world points; 0 where there is no pixel."""
    offsets = STEP_M * np.concatenate([np.eye(3), -np.eye(3)])
    pixels, _ = project(camera, points[:, None] + offsets)
    rows = (pixels[:, :3] - pixels[:, 3:]) / (2 * STEP_M)
    return np.nan_to_num(np.swapaxes(rows, 1, 2))


def _spent(fit: RallyFit, shown: np.ndarray, camera: Camera) -> float:
    """Degrees of freedom that the fit took from the measurements."""
    plan = fit.plan
    rows = np.flatnonzero(_weights(fit) > 0)
    if not len(rows):
        return 0.0
    J = _pixel_rows(camera[plan.frames.index[plan.picture[rows]]], fit.states[rows, :3])
    leverage = np.einsum("pij,pjk->pik", J, shown[rows, :3])
    return float((leverage**2).sum(axis=(1, 2)) @ _weights(fit)[rows])


def _marks(fit: RallyFit) -> tuple[Int[np.ndarray, " marks"], Int[np.ndarray, " marks"]]:
    """Contacts with a ground mark and the frames of their cameras."""
    plan = fit.plan
    marked = np.flatnonzero(plan.data.mark_precision > 0)
    nearest = np.abs(plan.frames.times[:, None] - plan.play.times[None, marked]).argmin(axis=0)
    return marked, plan.frames.index[nearest]


def _mark_pull(
    fit: RallyFit, camera: Camera, marked: np.ndarray, errors: list[Camera]
) -> Float[np.ndarray, "marks 2 errors"]:
    """Gradient of the cost by the marked contacts' x and y when the camera is off by each of the errors."""
    ground = fit.unknowns[fit.plan.layout.position[marked]] * np.array([1.0, 1.0, 0.0])
    J = _pixel_rows(camera, ground)[:, :, :2] * fit.plan.data.mark_precision[marked, None, None]
    there, _ = project(camera, ground[:, None])
    shifts = [np.nan_to_num(project(off, ground[:, None])[0] - there)[:, 0] for off in errors]
    return np.stack([np.einsum("kij,ki->kj", J, shift) for shift in shifts], axis=-1)


def _pull(fit: RallyFit, camera: Camera, errors: list[Camera]) -> Float[np.ndarray, "pictures 3 errors"]:
    """Gradient of the cost by each picture's position when the camera is off by each of the errors."""
    plan = fit.plan
    pulled = np.zeros((len(plan.picture), 3, len(errors)))
    weight = _weights(fit)
    seen = np.asarray(weight > 0)
    if not errors or not seen.any():
        return pulled
    own = camera[plan.frames.index[plan.picture[seen]]]
    points = fit.states[seen, :3]
    J = _pixel_rows(own, points)
    there, _ = project(own, points[:, None])
    for e, off in enumerate(errors):
        moved, _ = project(off[seen], points[:, None])
        shift = np.nan_to_num(moved - there)[:, 0]
        pulled[seen, :, e] = np.einsum("pij,pi->pj", J, shift * weight[seen, None])
    return pulled


def camera_errors(camera: Camera, doubt: CameraDoubt, world: BallWorld) -> list[Camera]:
    """The cameras as they would be, one standard deviation off in each independent direction of their shared error.

    A camera is calibrated on the ground: whatever its centre is off by, its rotation and focal length make up for it
    there as well as they can, so each error comes with the turn and zoom that least move the ground's pixels.
    """
    values, axes = np.linalg.eigh(doubt.position_cov)
    moves = [np.append(np.sqrt(v) * axes[:, i], 0.0) for i, v in enumerate(values) if v > 1e-12]
    usable = np.flatnonzero(np.isfinite(camera.K[..., 0, 0]))
    if not len(usable) or (not moves and doubt.focal_std_share <= 0):
        return []
    one = camera[int(usable[len(usable) // 2])]
    half = np.array(world.ground_half_size) * 0.6
    ground = np.stack(np.meshgrid([-half[0], 0, half[0]], [-half[1], 0, half[1]], [0.0]), axis=-1).reshape(-1, 3)
    base, there = project(one, ground)
    if there.sum() < 4:
        return []
    steps = np.array([1e-2, 1e-2, 1e-2, 1e-4, 1e-5, 1e-5, 1e-5])
    columns = []
    for i, step in enumerate(steps):
        moved, _ = project(_off(one, step * np.eye(7)[i]), ground)
        columns.append(((moved - base) / step)[there].ravel())
    J = np.nan_to_num(np.stack(columns, axis=1))
    found = []
    explained = 0.0
    for move in moves:
        rest, *_ = np.linalg.lstsq(J[:, 3:], -J[:, :3] @ move[:3], rcond=None)
        explained += rest[0] ** 2
        found.append(np.concatenate([move[:3], rest]))
    left = doubt.focal_std_share**2 - explained
    if left > 1e-12:
        share = np.sqrt(left)
        turn, *_ = np.linalg.lstsq(J[:, 4:], -J[:, 3] * share, rcond=None)
        found.append(np.concatenate([np.zeros(3), [share], turn]))
    return [_off(camera, error) for error in found]


def _off(camera: Camera, error: Float[np.ndarray, " 7"]) -> Camera:
    """The camera with its centre moved (m), its focal length longer by a share, and itself turned (radians)."""
    R = rotation_from_rotvec(error[4:]) @ camera.R_cam_from_world
    centre = camera.position_world + error[:3]
    K = camera.K.copy()
    K[..., :2, :2] *= 1 + error[3]
    return Camera(
        K=K,
        distortion=camera.distortion,
        R_cam_from_world=R,
        t_cam_from_world=-(R @ centre[..., None])[..., 0],
    )
