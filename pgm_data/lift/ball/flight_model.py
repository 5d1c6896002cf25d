"""How a ball flies and bounces, for the solvers: the same laws as CasADi functions with derivatives, and on arrays.

A state is position (m) and velocity (m/s), six numbers; spin is an angular velocity (rad/s), constant in a flight.
The ground's law is Coulomb's: the contact point slides, or grips where that would stop it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from pgm_data.lift.ball.world import GRAVITY, INERTIA, BallWorld

STEP_S = 0.04
"""Longest step of the integrator, s."""
DRAG_STEP = 0.25
"""Largest share of its speed that a ball may lose in one step."""
CAMERA_NUMBERS = 20
"""fx, fy, cx, cy, four of the lens, nine of the rotation, three of the translation."""


@dataclass(frozen=True)
class AirLaw:
    """What the forces on a ball need besides its drag: a key, so equal laws share their functions."""

    radius_m: float
    lift_per_m: float

    @property
    def lifts(self) -> bool:
        """Whether spin bends a flight."""
        return self.lift_per_m > 0


def air_law(world: BallWorld) -> AirLaw:
    """The law of the world's air."""
    return AirLaw(radius_m=world.radius_m, lift_per_m=world.lift_per_m)


def acceleration(
    velocity: Float[np.ndarray, "*batch 3"],
    spin: Float[np.ndarray, "*batch 3"],
    drag_per_m: Float[np.ndarray, "*batch"],
    law: AirLaw,
) -> Float[np.ndarray, "*batch 3"]:
    """Gravity, drag and Magnus lift, m/s^2."""
    speed = np.linalg.norm(velocity, axis=-1)
    turn = law.radius_m * np.linalg.norm(spin, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Lift factor over speed: S / (1 + 2 S) over S, as a limit of 1 without spin.
        kept = np.where(speed + 2 * turn > 0, speed / (speed + 2 * turn), 0.0)
    bent = law.lift_per_m * law.radius_m * kept[..., None] * np.cross(spin, velocity)
    return bent - (drag_per_m * speed)[..., None] * velocity - np.array([0.0, 0.0, GRAVITY])


def flown(
    state: Float[np.ndarray, "*batch 6"],
    spin: Float[np.ndarray, "*batch 3"],
    drag_per_m: Float[np.ndarray, "*batch"],
    duration: Float[np.ndarray, "*batch"],
    law: AirLaw,
    steps: int = 1,
) -> Float[np.ndarray, "*batch 6"]:
    """States after a time in seconds (may be below zero) by `steps` steps of Runge and Kutta's fourth order."""

    def slope(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[..., 3:], acceleration(x[..., 3:], spin, drag_per_m, law)], axis=-1)

    h = (duration / steps)[..., None]
    for _ in range(steps):
        k1 = slope(state)
        k2 = slope(state + h / 2 * k1)
        k3 = slope(state + h / 2 * k2)
        k4 = slope(state + h * k3)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def steps_for(longest_s: float, drag_per_m: float, speed: float) -> int:
    """Integrator steps that the longest interval between nodes takes, a power of two as its functions are kept."""
    wanted = max(longest_s / STEP_S, drag_per_m * speed * longest_s / DRAG_STEP) - 1e-6
    return int(2 ** np.ceil(np.log2(max(wanted, 1.0))))


def rebound(
    velocity: Float[np.ndarray, "*batch 3"],
    spin: Float[np.ndarray, "*batch 3"],
    restitution: Float[np.ndarray, "*batch"],
    friction: Float[np.ndarray, "*batch"],
    radius_m: float,
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Velocity and spin after a bounce on level ground by the law of the solvers; any velocity, any spin."""
    slip = velocity[..., :2] + radius_m * np.stack([-spin[..., 1], spin[..., 0]], axis=-1)
    sliding = friction * (1 + restitution) * np.abs(velocity[..., 2])
    gripping = INERTIA / (1 + INERTIA)
    speed = np.sqrt((slip**2).sum(axis=-1) + SMALL_SLIP**2)
    share = sliding / speed
    kept = gripping * share / (share**SHARP + gripping**SHARP) ** (1 / SHARP)
    impulse = -kept[..., None] * slip
    after = np.concatenate([velocity[..., :2] + impulse, -(restitution * velocity[..., 2])[..., None]], axis=-1)
    turn = np.stack([impulse[..., 1], -impulse[..., 0], 0 * friction], axis=-1) / (INERTIA * radius_m)
    return after, spin + turn


SMALL_SLIP = 0.05
"""Slip below which friction fades, m/s: keeps the law smooth where the ball rolls."""
SHARP = 6
"""Power of the smooth minimum of sliding and gripping."""


@lru_cache(maxsize=64)
def flow_function(law: AirLaw, steps: int):
    """CasADi: the state after an interval and its derivatives by state, spin, drag and duration, `(6, 11)`."""
    import casadi as ca

    x, w, c, dt = ca.SX.sym("x", 6), ca.SX.sym("w", 3), ca.SX.sym("c"), ca.SX.sym("dt")
    end = _flow(x, w, c, dt, law, steps)
    return ca.Function("flow", [x, w, c, dt], [end, ca.densify(ca.jacobian(end, ca.vertcat(x, w, c, dt)))])


@lru_cache(maxsize=64)
def end_function(law: AirLaw, steps: int):
    """CasADi: the state after an interval, without derivatives."""
    import casadi as ca

    x, w, c, dt = ca.SX.sym("x", 6), ca.SX.sym("w", 3), ca.SX.sym("c"), ca.SX.sym("dt")
    return ca.Function("flow_end", [x, w, c, dt], [_flow(x, w, c, dt, law, steps)])


def _flow(x, w, c, dt, law: AirLaw, steps: int):
    import casadi as ca

    def slope(s):
        v = s[3:]
        speed = ca.sqrt(ca.sumsqr(v) + 1e-8)
        a = -c * speed * v - ca.vertcat(0, 0, GRAVITY)
        if law.lifts:
            turn = law.radius_m * ca.sqrt(ca.sumsqr(w) + 1e-2)
            a += law.lift_per_m * law.radius_m * speed / (speed + 2 * turn) * ca.cross(w, v)
        return ca.vertcat(v, a)

    h = dt / steps
    for _ in range(steps):
        k1 = slope(x)
        k2 = slope(x + h / 2 * k1)
        k3 = slope(x + h / 2 * k2)
        k4 = slope(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def _pixel(point, camera):
    """Pixel of a world point through the twenty numbers of a camera."""
    import casadi as ca

    R = ca.reshape(camera[8:17], 3, 3).T
    cam = R @ point + camera[17:20]
    # A point behind the camera is drawn to just before it: far out in the picture, with a gradient that turns it back.
    depth = ca.fmax(cam[2], 0.05)
    x, y = cam[0] / depth, cam[1] / depth
    r2 = ca.fmin(x * x + y * y, 4.0)
    k1, k2, p1, p2 = camera[4], camera[5], camera[6], camera[7]
    radial = 1 + r2 * (k1 + r2 * k2)
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return ca.vertcat(camera[0] * xd + camera[2], camera[1] * yd + camera[3])


def _sighting_cost(residual, variables, precision, bend):
    """Cost, gradient and Gauss-Newton Hessian (upper triangle, column by column) of one robust pixel residual."""
    import casadi as ca

    squared = precision * ca.sumsqr(residual)
    root = ca.sqrt(1 + squared / bend**2)
    J = ca.densify(ca.jacobian(residual, variables))
    weight = precision / root
    return bend**2 * (root - 1), weight * (J.T @ residual), _upper(weight * (J.T @ J))


def _upper(H):
    import casadi as ca

    n = H.shape[0]
    return ca.vertcat(*[H[i, j] for j in range(n) for i in range(j + 1)])


@lru_cache(maxsize=4)
def sighting_function():
    """CasADi: cost, gradient (3) and Hessian (6) of a ball seen at a node, by its position.

    Inputs: position, camera, pixel, precision (1/px^2), and the robust loss's bend in standard deviations.
    """
    import casadi as ca

    p, camera, pixel = ca.SX.sym("p", 3), ca.SX.sym("camera", CAMERA_NUMBERS), ca.SX.sym("pixel", 2)
    precision, bend = ca.SX.sym("precision"), ca.SX.sym("bend")
    cost, gradient, H = _sighting_cost(_pixel(p, camera) - pixel, p, precision, bend)
    return ca.Function("sighting", [p, camera, pixel, precision, bend], [cost, gradient, H])


@lru_cache(maxsize=4)
def mark_function():
    """CasADi: the same for a ground mark, the pixel of the point right below the ball; by x and y: 2 and 3 numbers."""
    import casadi as ca

    p, camera, pixel = ca.SX.sym("p", 2), ca.SX.sym("camera", CAMERA_NUMBERS), ca.SX.sym("pixel", 2)
    precision, bend = ca.SX.sym("precision"), ca.SX.sym("bend")
    cost, gradient, H = _sighting_cost(_pixel(ca.vertcat(p, 0), camera) - pixel, p, precision, bend)
    return ca.Function("mark", [p, camera, pixel, precision, bend], [cost, gradient, H])


@lru_cache(maxsize=64)
def between_function(law: AirLaw, steps: int):
    """CasADi: the same for a ball seen a time after a node, by the node's state, spin and drag: 10 and 55 numbers."""
    import casadi as ca

    x, w, c, dt = ca.SX.sym("x", 6), ca.SX.sym("w", 3), ca.SX.sym("c"), ca.SX.sym("dt")
    camera, pixel = ca.SX.sym("camera", CAMERA_NUMBERS), ca.SX.sym("pixel", 2)
    precision, bend = ca.SX.sym("precision"), ca.SX.sym("bend")
    p = _flow(x, w, c, dt, law, steps)[:3]
    cost, gradient, H = _sighting_cost(_pixel(p, camera) - pixel, ca.vertcat(x, w, c), precision, bend)
    return ca.Function("between", [x, w, c, dt, camera, pixel, precision, bend], [cost, gradient, H])


@lru_cache(maxsize=16)
def bounce_function(radius_m: float):
    """CasADi: cost, gradient (14) and Hessian (105) of what a bounce departs from the law.

    By velocity before, velocity after, spin before, spin after, restitution, friction. The last input is the standard
    deviation of the departures: normal speed, tangential velocity (m/s), spin (rad/s). Spin departs from what the
    impulse that was felt gives it, whether or not friction's law explains the impulse.
    """
    import casadi as ca

    before, after = ca.SX.sym("before", 3), ca.SX.sym("after", 3)
    spin, spun = ca.SX.sym("spin", 3), ca.SX.sym("spun", 3)
    e, mu, std = ca.SX.sym("e"), ca.SX.sym("mu"), ca.SX.sym("std", 3)
    slip = before[:2] + radius_m * ca.vertcat(-spin[1], spin[0])
    down = ca.sqrt(before[2] ** 2 + 1e-4)
    share = mu * (1 + e) * down / ca.sqrt(ca.sumsqr(slip) + SMALL_SLIP**2)
    gripping = INERTIA / (1 + INERTIA)
    # The smooth minimum, written so that neither a huge nor a small share overflows.
    kept = share * (1 + (share / gripping) ** SHARP) ** (-1 / SHARP)
    impulse = after[:2] - before[:2]
    turn = ca.vertcat(impulse[1], -impulse[0], 0) / (INERTIA * radius_m)
    residual = ca.vertcat(
        (after[2] + e * before[2]) / std[0],
        (impulse + kept * slip) / std[1],
        (spun - spin - turn) / std[2],
    )
    variables = ca.vertcat(before, after, spin, spun, e, mu)
    J = ca.densify(ca.jacobian(residual, variables))
    cost = ca.sumsqr(residual) / 2
    return ca.Function("rebound", [before, after, spin, spun, e, mu, std], [cost, J.T @ residual, _upper(J.T @ J)])
