"""How to strike a ball so that it comes down where it should."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.air import force_constants
from pgm_data.simulate.flight.course import FlightWorld
from pgm_data.simulate.flight.shooting import at_net, elevation_for


@dataclass(frozen=True, eq=False, kw_only=True)
class Launch:
    """A ball just after a hit."""

    velocity: Float[np.ndarray, " 3"]
    """m/s."""
    spin: Float[np.ndarray, " 3"]
    """rad/s."""


def launched(speed: float, elevation: float, azimuth: float, topspin: float, sidespin: float) -> Launch:
    """A launch by its angles, radians: elevation above the horizon, azimuth anticlockwise from +x as seen from above.

    Topspin: rad/s about the horizontal axis across the direction, negative is backspin. Sidespin: rad/s about the
    vertical, anticlockwise from above; it bends the flight to the left of its direction.
    """
    across = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    flat = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    velocity = speed * (math.cos(elevation) * flat + math.sin(elevation) * up)
    return Launch(velocity=velocity, spin=topspin * across + sidespin * up)


def aim(
    start: Float[np.ndarray, " 3"],
    target_xy: Float[np.ndarray, " 2"],
    speed: float,
    topspin: float,
    sidespin: float,
    world: FlightWorld,
    *,
    high: bool = False,
) -> Launch | None:
    """The launch of that speed (m/s) and spin (rad/s, see `launched`) that first meets the ground at the target.

    It hits within a millimetre, the net ignored. The lower of two ways, or the higher one (lobs); None where
    none reaches it.

    Raises:
        ValueError: If the start is not above the ground, the target is right below it or the speed is not above 0.
    """
    level = world.floor_z + world.build.radius_m
    reach = math.hypot(target_xy[0] - start[0], target_xy[1] - start[1])
    if not (start[2] > level and reach > 0.01 and speed > 0):
        given = f"{start}, {target_xy}, {speed} m/s"
        raise ValueError(f"aim: expected a start above the ground, a target away from it and a speed, got {given}")
    found, elevation, azimuth = elevation_for(
        np.asarray(start, dtype=float),
        np.asarray(target_xy, dtype=float),
        np.array([speed, topspin, sidespin], dtype=float),
        level,
        force_constants(world.air, world.build),
        high,
    )
    return launched(speed, elevation, azimuth, topspin, sidespin) if found else None


def net_clearance(start: Float[np.ndarray, " 3"], launch: Launch, world: FlightWorld) -> float:
    """How far the ball passes over the net's top, metres, from its underside; negative where it does not clear it.

    Inf where it does not cross within the net's extent before it meets the ground.
    """
    if world.net is None:
        return math.inf
    x, z = at_net(
        np.concatenate([start, launch.velocity]).astype(float),
        launch.spin,
        world.floor_z + world.build.radius_m,
        force_constants(world.air, world.build),
    )
    if not world.net.xs[0] <= x <= world.net.xs[-1]:
        return math.inf
    return z - world.net.top_at(x) - world.build.radius_m
