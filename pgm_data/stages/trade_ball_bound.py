"""How well any method could place a simulated ball: the Cramer-Rao bound of a case, from the simulator's own flight.

Unknown are where the ball starts, its drag and lift, velocity and spin after every hit, when the later hits are, and
restitution, friction and grip at the bounces of each shot, which differ as no method can foresee; spin, drag and
bounces have the scene's priors, lift and grip those that they are drawn from, hits the stated deviation of their times.
Measured are the pixels of the frames with a true detection, the ground marks, and the times of bounces as a person
gives them. The camera and which contact is what count as known.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Ball, Scene
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.flight.air import drag_per_m, force_per_m
from pgm_data.simulate.flight.contact import restitution
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.path import BallPath, Contact
from pgm_data.stages.trade_ball_cases import BallCase
from pgm_data.stages.trade_ball_shots import TrueShot

STEPS = np.array([1e-3] * 3 + [1e-3] * 3 + [0.1] * 3 + [1e-5, 1e-3, 1e-4, 1e-4, 1e-4])
"""Of the differences that stand for derivatives by position, velocity, spin, drag, lift, restitution, friction and
grip: m, m/s, rad/s, 1/m and plain numbers."""
SHARED, OWN = 5, 10
"""Parameters of a path: start (3), drag, lift; and of each shot: velocity (3), spin (3), time, restitution, friction,
grip."""
LIFT_STD, GRIP_STD = 0.1, 0.06
"""Scatter of the lift's factor about 1 and of the grip about 0.1."""
OPEN = 1e3
"""Prior standard deviation of a start and of velocities, m and m/s: as good as none."""
LEAST_PX = 0.01
"""No pixel counts as more exact."""
PIXEL_STEP_M = 1e-4
AFTER_S = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class Bound:
    """The least standard deviation that an unbiased estimate of a case can have."""

    position_cov: Float[np.ndarray, "frames 3 3"]
    """m^2; NaN outside the path."""
    rms_m: float
    """Predicted rms distance over the frames that are scored."""
    with_priors_m: float
    """The same of the best estimate with the scene's priors in this very case, whose spin, drag and bounces lie where
    they do about the priors' means: larger where they lie far off."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotSlopes:
    """How a shot depends on what it starts with."""

    positions: Float[np.ndarray, "times 3"]
    """World metres."""
    velocities: Float[np.ndarray, "times 3"]
    """m/s."""
    slopes: Float[np.ndarray, "times 3 14"]
    """Derivatives of the positions by start, velocity, spin, drag, lift, restitution, friction and grip."""
    bounce_s: float
    """Time of the first bounce after the start; NaN where there is none."""
    bounce_slopes: Float[np.ndarray, " 14"]
    """Its derivatives."""


def bound_of(case: BallCase, scene: Scene) -> Bound:
    """The bound of a case.

    Raises:
        ValueError: If the scene has no ball.
    """
    if scene.ball is None:
        raise ValueError(f"bound_of.scene: expected a ball, got {scene.name}")
    frames = np.flatnonzero(case.inside)
    times = case.track.times[frames] - case.start_s
    slopes, bounces = path_slopes(case.path.shots, times)
    by_position = _pixel_slopes(case, frames)
    rows, sigma = [], []
    used = (case.track.measured & ~case.false)[frames]
    rows.append((by_position @ slopes)[used].reshape(-1, slopes.shape[-1]))
    sigma.append(np.full(2 * int(used.sum()), max(case.options.noise_px, LEAST_PX)))
    if case.mark_frames:
        ends = np.array(case.mark_frames)
        at = times[np.searchsorted(frames, ends)]
        if case.options.event_times == "fractional":
            at = np.array([0.0, case.path.end_s])
        ground = _ground_slopes(case, ends) @ path_slopes(case.path.shots, at)[0]
        rows.append(ground.reshape(-1, slopes.shape[-1]))
        sigma.append(np.full(4, max(case.options.mark_px, LEAST_PX)))
    rows.append(bounces)
    sigma.append(np.full(len(bounces), float(case.events.time_std[0])))
    prior = prior_std(len(case.path.shots), scene.ball, float(case.events.time_std[0]))
    covariance = covariance_of(np.concatenate(rows), np.concatenate(sigma), prior)
    # The estimate is drawn towards the priors' means, and scatters by the measurements alone.
    pull = covariance @ (prior_offsets(case.path.shots, scene.ball) / prior**2)
    error = covariance - covariance @ np.diag(1.0 / prior**2) @ covariance + np.outer(pull, pull)
    position_cov = np.full((len(case.inside), 3, 3), np.nan)
    position_cov[frames] = slopes @ covariance @ np.swapaxes(slopes, 1, 2)
    scored = slopes[case.scored[frames]]
    mean = [np.einsum("tip,pq,tiq->t", scored, matrix, scored).mean() for matrix in (covariance, error)]
    return Bound(position_cov=position_cov, rms_m=float(np.sqrt(mean[0])), with_priors_m=float(np.sqrt(mean[1])))


def covariance_of(
    slopes: Float[np.ndarray, "rows parameters"],
    sigma: Float[np.ndarray, " rows"],
    prior: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The inverse of the information that measurements with those slopes and deviations, and priors, give."""
    weighted = slopes / sigma[:, None]
    information = weighted.T @ weighted + np.diag(1.0 / prior**2)
    # Metres beside 1/m: only in units of their own does the matrix invert well.
    scale = 1.0 / np.sqrt(np.diag(information))
    return scale[:, None] * np.linalg.inv(scale[:, None] * information * scale) * scale


def prior_std(shots: int, ball: Ball, time_std: float) -> Float[np.ndarray, " parameters"]:
    """Of start, drag and lift, and of each shot's velocity, spin, time, restitution, friction and grip, in this order.

    The first shot's time is known: it only says what is called the start.
    """
    spin = max(ball.spin_std_rad_s, 1e-3)
    kept = ball.restitution.std if ball.restitution is not None else 1e-6
    rubs = ball.friction.std if ball.friction is not None else 1e-6
    each = [[OPEN] * 3 + [spin] * 3 + [time_std if k else 1e-9, kept, rubs, GRIP_STD] for k in range(shots)]
    return np.array([OPEN] * 3 + [ball.drag_per_m.std, LIFT_STD] + [value for shot in each for value in shot])


def prior_offsets(shots: tuple[TrueShot, ...], ball: Ball) -> Float[np.ndarray, " parameters"]:
    """How far the priors' means lie from the truth, for the parameters of `prior_std`; 0 where there is no prior."""
    drag = ball.drag_per_m.mean - drag_per_m(shots[0].world.air, shots[0].world.build)
    offsets = [0.0, 0.0, 0.0, drag, 1.0 - shots[0].world.build.lift_factor]
    for shot in shots:
        kept, rubs = shot.world.surface.restitution, shot.world.surface.friction
        arrival = _arrival(shot)
        if arrival is not None:
            kept = restitution(arrival, shot.world.surface)
        bounce = [0.0 if ball.restitution is None else ball.restitution.mean - kept]
        bounce += [0.0 if ball.friction is None else ball.friction.mean - rubs, 0.1 - shot.world.surface.grip]
        offsets += [0.0] * 3 + (-shot.spin).tolist() + [0.0] + bounce
    return np.array(offsets)


def _arrival(shot: TrueShot) -> np.ndarray | None:
    """Velocity just before the shot's first bounce; None where it has none."""
    until = shot.end_s + AFTER_S
    flights, contacts = follow(shot.position, shot.velocity, shot.spin, shot.start_s, shot.world, until=until)
    return flights[0].velocities[-1] if contacts[0].kind == "bounce" else None


def path_slopes(
    shots: tuple[TrueShot, ...], times: Float[np.ndarray, " times"]
) -> tuple[Float[np.ndarray, "times 3 parameters"], Float[np.ndarray, "bounces parameters"]]:
    """Derivatives of positions at times of the path and of its first bounces' times, by the parameters of `prior_std`.

    Each shot starts where the one before it is at its hit.
    """
    count = SHARED + OWN * len(shots)
    out = np.full((len(times), 3, count), np.nan)
    bounces = []
    start = np.zeros((3, count))
    start[:, :3] = np.eye(3)
    for k, shot in enumerate(shots):
        own = SHARED + OWN * k
        last = k == len(shots) - 1
        inside = (times >= shot.start_s) & ((times <= shot.end_s) if last else (times < shot.end_s))
        here = shot_slopes(shot, np.append(times[inside], shot.end_s))
        full = _by_parameters(here.slopes, start, own)
        # A later start with all else the same is the same shot, later.
        full[:, :, own + 6] -= here.velocities
        out[inside] = full[:-1]
        if shot.start_s < here.bounce_s < shot.end_s:
            bounces.append(_by_parameters(here.bounce_slopes, start, own))
            bounces[-1][own + 6] += 1.0
        if not last:
            start = full[-1].copy()
            start[:, own + OWN + 6] += here.velocities[-1]
    return out, np.array(bounces).reshape(-1, count)


def _by_parameters(slopes: np.ndarray, start: np.ndarray, own: int) -> np.ndarray:
    """Derivatives by what a shot starts with as those by all parameters; its own begin at `own`."""
    full = slopes[..., :3] @ start
    full[..., own : own + 6] += slopes[..., 3:9]
    full[..., 3:5] += slopes[..., 9:11]
    full[..., own + 7 : own + 10] += slopes[..., 11:]
    return full


def shot_slopes(shot: TrueShot, times: Float[np.ndarray, " times"]) -> ShotSlopes:
    """A shot at times of its path and its derivatives, by differences of the simulator's flight."""
    middle, velocities, bounce_s = _flown(shot, times, np.zeros(len(STEPS)))
    ahead, behind = ([_flown(shot, times, sign * row) for row in np.diag(STEPS)] for sign in (1.0, -1.0))
    slopes = [(a[0] - b[0]) / (2 * h) for a, b, h in zip(ahead, behind, STEPS, strict=True)]
    bounces = [(a[2] - b[2]) / (2 * h) for a, b, h in zip(ahead, behind, STEPS, strict=True)]
    return ShotSlopes(
        positions=middle,
        velocities=velocities,
        slopes=np.stack(slopes, axis=-1),
        bounce_s=bounce_s,
        bounce_slopes=np.array(bounces),
    )


def _flown(shot: TrueShot, times: np.ndarray, change: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions and velocities at the times, and the first bounce's time, where the start is changed by that much."""
    world = _changed(shot.world, change[9:])
    position = shot.position + change[:3]
    # A ball that is hit at the very ground stays above it.
    position[2] = max(position[2], world.floor_z + world.build.radius_m)
    flights, contacts = follow(
        position,
        shot.velocity + change[3:6],
        shot.spin + change[6:9],
        shot.start_s,
        world,
        until=shot.end_s + AFTER_S,
    )
    start = Contact(time=shot.start_s, kind="hit", player=-1, position=position)
    path = BallPath(flights=tuple(flights), contacts=(start, *contacts))
    positions, velocities = path.at(times)
    return positions, velocities, next((c.time for c in contacts if c.kind == "bounce"), float("nan"))


def _changed(world: FlightWorld, by: np.ndarray) -> FlightWorld:
    """The same world with drag (1/m), lift, restitution, friction and grip changed."""
    drag = world.build.drag_coefficient + by[0] / force_per_m(world.air, world.build)
    surface = world.surface
    return replace(
        world,
        build=replace(
            world.build,
            drag_coefficient=max(float(drag), 0.0),
            lift_factor=world.build.lift_factor + float(by[1]),
        ),
        surface=replace(
            surface,
            restitution=min(max(surface.restitution + float(by[2]), 0.0), 1.0),
            friction=max(surface.friction + float(by[3]), 0.0),
            grip=min(max(surface.grip + float(by[4]), 0.0), 1.0),
        ),
    )


def _pixel_slopes(case: BallCase, frames: np.ndarray) -> np.ndarray:
    """Derivatives (frames, 2, 3) of the true pixels by the ball's place."""
    return _slopes_at(case, frames, case.position[frames])


def _ground_slopes(case: BallCase, frames: np.ndarray) -> np.ndarray:
    """Derivatives (frames, 2, 3) of the pixel of the ground below the ball by the ball's place."""
    flat = np.array([1.0, 1.0, 0.0])
    return _slopes_at(case, frames, case.position[frames] * flat) * flat


def _slopes_at(case: BallCase, frames: np.ndarray, points: np.ndarray) -> np.ndarray:
    camera, out = case.camera, np.empty((len(frames), 2, 3))
    offsets = np.concatenate([np.eye(3), -np.eye(3)]) * PIXEL_STEP_M
    for row, (i, point) in enumerate(zip(frames, points, strict=True)):
        k1 = float(camera.distortion[i, 0])
        seen = pixels_of(point + offsets, camera.K[i], k1, camera.R_cam_from_world[i], camera.t_cam_from_world[i])
        out[row] = ((seen[:3] - seen[3:]) / (2 * PIXEL_STEP_M)).T
    return out
