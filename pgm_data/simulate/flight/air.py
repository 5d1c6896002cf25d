"""What a ball flies through, and what it is made of."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Ball

SEA_LEVEL_AIR = 1.205
"""Density at 20 degrees C, kg/m^3."""


def _calm() -> np.ndarray:
    return np.zeros(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Air:
    """The air over the court and the gravity there.

    Raises:
        ValueError: If the density or gravity is below zero or a value is not finite.
    """

    density_kg_m3: float = SEA_LEVEL_AIR
    wind: Float[np.ndarray, " 3"] = field(default_factory=_calm)
    """Velocity of the air in the world, m/s."""
    gravity: float = 9.81
    """Downwards, m/s^2."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("density_kg_m3", "gravity"):
            _at_least("Air", name, getattr(self, name), 0.0)
        if self.wind.shape != (3,) or not np.isfinite(self.wind).all():
            raise ValueError(f"Air.wind: expected three finite numbers, m/s, got {self.wind}")


@dataclass(frozen=True, eq=False, kw_only=True)
class BallBuild:
    """One ball, and how the air takes hold of it in one shot.

    Raises:
        ValueError: If a value is out of its range.
    """

    radius_m: float
    mass_kg: float
    drag_coefficient: float = 0.55
    """Cd, on the area of the ball's disc."""
    lift_factor: float = 1.0
    """Lift is this times S / (1 + 2 S), S = radius spin / speed: scatters from shot to shot."""
    spin_decay_per_s: float = 0.04
    """Share of the spin that the air takes in a second. Golf balls lose 3.3 to 4 per cent (TrackMan); the torque on a
    ball goes with density, radius^2 and speed over inertia (Nathan 2008), which for a tennis ball at half the speed
    gives 3 per cent and more for its nap."""
    inertia_factor: float = 0.55
    """Moment of inertia over mass radius^2; a thin shell has 2/3, a tennis ball's thick one about 0.55 (Cross)."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("radius_m", "mass_kg", "inertia_factor"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"BallBuild.{name}: expected above 0, got {getattr(self, name)}")
        for name in ("drag_coefficient", "spin_decay_per_s"):
            _at_least("BallBuild", name, getattr(self, name), 0.0)
        if not math.isfinite(self.lift_factor):
            raise ValueError(f"BallBuild.lift_factor: expected a finite number, got {self.lift_factor}")


def _at_least(owner: str, name: str, value: float, least: float) -> None:
    if not (math.isfinite(value) and value >= least):
        raise ValueError(f"{owner}.{name}: expected {least} or more, got {value}")


def force_per_m(air: Air, build: BallBuild) -> float:
    """Acceleration per coefficient and squared speed, 1/m: half the density times the disc's area over the mass."""
    return air.density_kg_m3 * math.pi * build.radius_m**2 / (2 * build.mass_kg)


def drag_per_m(air: Air, build: BallBuild) -> float:
    """C = rho Cd A / (2 m), 1/m."""
    return build.drag_coefficient * force_per_m(air, build)


def ball_build(ball: Ball) -> BallBuild:
    """The mean ball of a scene file: its drag constant is read as that of air at sea level."""
    per_coefficient = SEA_LEVEL_AIR * math.pi * ball.radius_m**2 / (2 * ball.mass_kg)
    return BallBuild(
        radius_m=ball.radius_m,
        mass_kg=ball.mass_kg,
        drag_coefficient=ball.drag_per_m.mean / per_coefficient,
        lift_factor=1.0 if ball.lift == "spin" else 0.0,
    )


def force_constants(air: Air, build: BallBuild) -> Float[np.ndarray, " 8"]:
    """What the integrator reads: drag 1/m, lift (a length per m), radius, gravity, wind (3), spin decay 1/s."""
    lift = build.lift_factor * build.radius_m * force_per_m(air, build)
    return np.array(
        [drag_per_m(air, build), lift, build.radius_m, air.gravity, *air.wind, build.spin_decay_per_s], dtype=float
    )
