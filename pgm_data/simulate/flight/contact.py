"""What the ground and the net do to a ball that meets them."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.air import BallBuild

DROP_SPEED = 7.0
"""Normal speed of the ITF's drop from 254 cm, m/s, at which `Surface.restitution` holds."""
RESTITUTION_RANGE = (0.45, 0.92)
PATCH_M = 0.01
"""Radius of the patch on which the ball touches the ground, for its torque about the vertical."""

SurfaceName = Literal["hard", "clay", "grass"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """What a bounce takes from a ball.

    Raises:
        ValueError: If a value is out of its range.
    """

    name: str
    restitution: float
    """Normal speed kept in the ITF's drop test."""
    shallow_gain: float
    """What a ball that comes in along the ground keeps in addition; goes with the squared cosine of its angle."""
    speed_loss: float
    """What is kept less for each m/s of normal speed above that of the drop test, s/m."""
    friction: float
    """Of sliding, tangential over normal impulse at most."""
    grip: float
    """Share of the contact point's tangential speed that comes back reversed where the ball grips, 0 to 1."""
    rolling: float
    """Deceleration of a rolling ball over gravity."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name, low, high in (("restitution", 0, 1), ("friction", 0, 10), ("grip", 0, 1), ("rolling", 1e-3, 10)):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"Surface.{name}: expected {low} to {high}, got {getattr(self, name)}")


# Drops: the ITF's 135 to 147 cm. Friction, and restitution of fast shallow balls: ITF CS 01/02 (0.81 on average at
# 30 m/s and 16 degrees), Brody, Cross. Grip: Cross 2002, tennis balls leave a rough ground with some reversed slip.
SURFACES: dict[SurfaceName, Surface] = {
    "hard": Surface(
        name="hard", restitution=0.775, shallow_gain=0.045, speed_loss=0.008, friction=0.6, grip=0.1, rolling=0.035
    ),
    "clay": Surface(
        name="clay", restitution=0.77, shallow_gain=0.08, speed_loss=0.008, friction=0.72, grip=0.05, rolling=0.06
    ),
    "grass": Surface(
        name="grass", restitution=0.765, shallow_gain=-0.03, speed_loss=0.01, friction=0.45, grip=0.05, rolling=0.08
    ),
}


def restitution(velocity: Float[np.ndarray, " 3"], surface: Surface) -> float:
    """Share of the normal speed that a bounce keeps: less when steep and hard, more when shallow."""
    normal = abs(float(velocity[2]))
    along = float(velocity[0] ** 2 + velocity[1] ** 2)
    shallow = along / (along + normal**2) if normal > 0 else 1.0
    kept = surface.restitution - surface.speed_loss * (normal - DROP_SPEED) + surface.shallow_gain * shallow
    return min(max(kept, RESTITUTION_RANGE[0]), RESTITUTION_RANGE[1])


def bounce(
    velocity: Float[np.ndarray, " 3"], spin: Float[np.ndarray, " 3"], surface: Surface, build: BallBuild
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Velocity (m/s) and spin (rad/s) after a bounce off level ground.

    The contact point slides under Coulomb's friction, or grips where that would stop it. Spin about the vertical is
    braked by the patch's friction. No bounce gains energy.

    Raises:
        ValueError: If the ball is not coming down.
    """
    if not velocity[2] < 0:
        raise ValueError(f"bounce.velocity: expected one that goes down, got {velocity} m/s")
    R, inertia = build.radius_m, build.inertia_factor
    kept = restitution(velocity, surface)
    push = -(1 + kept) * velocity[2]
    # Velocity of the contact point: v + spin x (0, 0, -R).
    slip = velocity[:2] + R * np.array([-spin[1], spin[0]])
    slip_speed = float(np.hypot(*slip))
    gripping = (1 + surface.grip) * slip_speed * inertia / (1 + inertia)
    size = min(surface.friction * push, gripping)
    impulse = -slip / slip_speed * size if slip_speed > 0 else np.zeros(2)
    twist = abs(float(spin[2])) * PATCH_M
    share = twist / math.hypot(twist, slip_speed) if twist > 0 else 0.0
    braking = min(surface.friction * push * PATCH_M * share / (1.5 * inertia * R**2), abs(float(spin[2])))
    after = np.array([velocity[0] + impulse[0], velocity[1] + impulse[1], -kept * velocity[2]])
    turn = np.array([impulse[1], -impulse[0]]) / (inertia * R)
    return after, np.array([spin[0] + turn[0], spin[1] + turn[1], spin[2] - math.copysign(braking, spin[2])])


def rolling(
    velocity: Float[np.ndarray, " 3"], spin: Float[np.ndarray, " 3"], build: BallBuild
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Velocity and spin of a ball that stops bouncing, once its contact point has come to rest by friction alone."""
    R, inertia = build.radius_m, build.inertia_factor
    slip = velocity[:2] + R * np.array([-spin[1], spin[0]])
    flat = velocity[:2] - slip * inertia / (1 + inertia)
    return np.array([flat[0], flat[1], 0.0]), np.array([-flat[1] / R, flat[0] / R, 0.0])


@dataclass(frozen=True, eq=False, kw_only=True)
class NetShape:
    """A net in the plane y = 0.

    Raises:
        ValueError: If the top does not run from left to right.
    """

    xs: Float[np.ndarray, " corners"]
    """Where the top edge bends, left to right; there is no net beyond the ends. Metres."""
    tops: Float[np.ndarray, " corners"]
    """Height of the top edge there, world z, metres."""
    tape_height_m: float = 0.06
    """Height of the band along the top."""
    tape_radius_m: float = 0.006
    """Of the rounded top: half the thickness of band and cord."""

    def __post_init__(self) -> None:
        """Check the corners."""
        if len(self.xs) < 2 or len(self.xs) != len(self.tops) or not (np.diff(self.xs) > 0).all():
            raise ValueError(f"NetShape: expected two corners or more, left to right, got {self.xs}, {self.tops}")

    def top_at(self, x: float) -> float:
        """Height of the top edge, metres."""
        return float(np.interp(x, self.xs, self.tops))


def net_shape(net_world: Float[np.ndarray, "corners 3"], tape_height_m: float) -> NetShape:
    """The net whose top edge runs through those points of the court.

    Raises:
        ValueError: If they do not lie over the line y = 0.
    """
    if np.abs(net_world[:, 1]).max() > 1e-6:
        raise ValueError(f"net_shape.net_world: expected a net over y = 0, got {net_world}")
    return NetShape(xs=net_world[:, 0].copy(), tops=net_world[:, 2].copy(), tape_height_m=tape_height_m)


HANG_SPEED = 0.3
"""Slower than this across the net, m/s, the ball hangs in it and slides down."""
SOFT_SPEED = 5.0
"""Faster than this across the net, m/s, and less than 45 degrees down, a ball presses the tape aside; others bounce
off it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NetTouch:
    """A ball after the net."""

    velocity: Float[np.ndarray, " 3"]
    spin: Float[np.ndarray, " 3"]
    way: Literal["off", "over", "down", "rest"]
    """`over`: the tape gave way, and the ball cannot touch it a second time in this flight; `down`: it slides down
    along the net, out of the wind; `rest`: it lies on the tape and will slide off."""


def touch_net(
    position: Float[np.ndarray, " 3"],
    velocity: Float[np.ndarray, " 3"],
    spin: Float[np.ndarray, " 3"],
    net: NetShape,
    build: BallBuild,
    gravity: float,
    luck: float,
) -> NetTouch:
    """What the net leaves of a ball that touches it and goes towards it. `luck` (0 to 1) scatters the outcome.

    Below the top edge the ball loses nearly all its speed and falls down on the side it came from. At the edge a fast
    ball presses the tape aside: the higher it hits, the likelier it goes over, slowed and lifted; a slow one
    bounces off the rounded edge. No touch gains energy.
    """
    rise = position[2] - (net.top_at(float(position[0])) - net.tape_radius_m)
    across = float(velocity[1])
    if rise <= 0:
        in_tape = rise > net.tape_radius_m - net.tape_height_m
        if abs(across) < HANG_SPEED:
            return NetTouch(velocity=np.array([0.0, 0.0, 0.5 * velocity[2]]), spin=np.zeros(3), way="down")
        # The cords stretch farther under a faster ball and give less of its speed back.
        back = ((0.12 if in_tape else 0.06) + 0.08 * luck) / (1 + abs(across) / 15)
        keep = np.array([0.35, -back, 0.35])
        return NetTouch(velocity=velocity * keep, spin=0.3 * spin, way="off")
    away = np.array([0.0, position[1], rise])
    away = away / np.linalg.norm(away)
    # 0: the centre is level with the edge; 1: the ball grazes the edge from above.
    height = float(away[2])
    if across * position[1] >= 0 or abs(across) <= max(SOFT_SPEED, -float(velocity[2])):
        closing = float(velocity @ away)
        along = velocity - closing * away
        reach = build.radius_m + net.tape_radius_m
        if closing > -0.2 and along[1] ** 2 + along[2] ** 2 < gravity * height * reach:
            return NetTouch(velocity=np.array([0.0, along[1], along[2]]), spin=np.zeros(3), way="rest")
        # Slow enough, it springs back whole, so that bounces do not pile up.
        kept = 1.0 if closing > -0.2 else 0.2 + 0.3 * luck
        return NetTouch(velocity=0.85 * along - kept * closing * away, spin=0.6 * spin, way="off")
    lift = abs(across) * (1 - height) * (0.06 + 0.08 * luck)
    if height + 0.3 * (luck - 0.5) > 0.4:
        keep = (0.3 + 0.65 * height) * (0.5 + 0.5 * luck)
        up = lift + (0.7 if velocity[2] > 0 else 0.1 + 0.8 * height) * velocity[2]
        over = np.array([0.8 * velocity[0], keep * across, up])
        return NetTouch(velocity=over, spin=(0.4 + 0.5 * height) * spin, way="over")
    up = 0.5 * lift + 0.3 * max(float(velocity[2]), 0.0)
    back = np.array([0.4 * velocity[0], -(0.05 + 0.1 * luck) * across, up])
    return NetTouch(velocity=back, spin=0.3 * spin, way="off")
