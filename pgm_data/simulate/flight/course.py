"""A ball followed from flight to flight until it rests, leaves or its time is up."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.air import Air, BallBuild, drag_per_m
from pgm_data.simulate.flight.contact import NetShape, Surface, bounce, rolling, touch_net
from pgm_data.simulate.flight.integrate import Stop, fly
from pgm_data.simulate.flight.path import Contact, Flight
from pgm_data.simulate.flight.tape import slide_off

ROLL_BELOW = 0.35
"""Normal speed after a bounce, m/s, below which the ball stays on the ground: it would rise 6 mm."""
TOUCHES = 60
"""After so many touches of the net the course ends: the ball hangs in it."""
ALONG = 1e-9
"""Slope of a way, below which it runs along a wall or the net."""
KNOTS_S = 1e-9
"""Times closer than this are one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightWorld:
    """Where a ball flies: all that does not change from shot to shot but its build."""

    air: Air
    build: BallBuild
    surface: Surface
    net: NetShape | None
    """None where there is none."""
    floor_z: float = 0.0
    bounds: tuple[float, float] = (12.0, 21.0)
    """Half width and half length up to the walls, metres."""


def follow(
    position: Float[np.ndarray, " 3"],
    velocity: Float[np.ndarray, " 3"],
    spin: Float[np.ndarray, " 3"],
    time: float,
    world: FlightWorld,
    *,
    until: float,
    rng: np.random.Generator | None = None,
) -> tuple[list[Flight], list[Contact]]:
    """Flights from a start on, and the contacts that end them; the last one is `last`.

    It ends `until` (seconds) or where the ball leaves the bounds. A ball that starts on the ground or at the net and
    goes towards it bounces at once, without a contact of its own. Only touches of the net draw from `rng`; without one
    they go the middle way.

    Raises:
        ValueError: If the start is not finite, in the ground or out of bounds, or `until` does not lie after `time`.
    """
    if abs(position[0]) > world.bounds[0] or abs(position[1]) > world.bounds[1]:
        raise ValueError(f"follow.position: expected it within {world.bounds} m of the centre, got {position}")
    if not until - time > KNOTS_S:
        raise ValueError(f"follow.until: expected a time after {time} s, got {until}")
    flights: list[Flight] = []
    contacts: list[Contact] = []
    air, net, touches = world.air, world.net, 0
    constant = drag_per_m(world.air, world.build)
    while True:
        flown = fly(
            position,
            velocity,
            spin,
            air,
            world.build,
            time=time,
            until=until,
            floor_z=world.floor_z,
            net=net,
            bounds=world.bounds,
        )
        position, velocity, spin, stop = flown.positions[-1], flown.velocities[-1], flown.spins[-1], flown.stop
        time = float(flown.times[-1])
        # Less than a nanosecond before the end there is no room for another flight.
        touches += stop == Stop.NET
        over = stop in (Stop.TIME, Stop.BOUNDS) or until - time < KNOTS_S or touches > TOUCHES
        if len(flown.times) > 1:
            flights.append(
                Flight(
                    times=flown.times,
                    positions=flown.positions,
                    velocities=flown.velocities,
                    spins=flown.spins,
                    drag_per_m=constant,
                )
            )
            kind = "last" if over else "net" if stop == Stop.NET else "bounce"
            contacts.append(Contact(time=time, kind=kind, player=-1, position=position))
        if over:
            return flights, [*contacts[:-1], replace(contacts[-1], kind="last")]
        if stop == Stop.NET:
            assert net is not None
            luck = 0.5 if rng is None else float(rng.random())
            touch = touch_net(position, velocity, spin, net, world.build, air.gravity, luck)
            velocity, spin = touch.velocity, touch.spin
            blocked = touch.way in ("off", "rest")
            air = replace(air, wind=np.zeros(3)) if touch.way == "down" else air
            if touch.way == "rest":
                flight = slide_off(position, velocity, (time, until), net, world.build, air.gravity)
                position, velocity, spin = flight.positions[-1], flight.velocities[-1], flight.spins[-1]
                time = float(flight.times[-1])
                over = until - time < KNOTS_S
                flights.append(flight)
                contacts.append(Contact(time=time, kind="last" if over else "net", player=-1, position=position))
                if over:
                    return flights, contacts
            net = net if blocked else None
            continue
        air, net = world.air, world.net
        if velocity[2] < -ROLL_BELOW:
            velocity, spin = bounce(velocity, spin, world.surface, world.build)
        if velocity[2] < ROLL_BELOW:
            velocity, spin = rolling(velocity, spin, world.build)
            rolled, ends = _roll(position, velocity, time, world, until)
            return [*flights, *rolled], [*contacts, *ends]


def truncated(flights: list[Flight], contacts: list[Contact], time: float) -> tuple[list[Flight], list[Contact]]:
    """The course up to a time; its contacts are those before it: the one at that time is the caller's to add.

    Raises:
        ValueError: If the time does not lie within the course.
    """
    if not flights[0].times[0] < time <= flights[-1].times[-1]:
        span = (flights[0].times[0], flights[-1].times[-1])
        raise ValueError(f"truncated.time: expected one within the course's {span} s, got {time}")
    last = next(i for i, flight in enumerate(flights) if time <= flight.times[-1])
    return [*flights[:last], cut(flights[last], time)], contacts[:last]


def cut(flight: Flight, time: float) -> Flight:
    """The part of a flight up to a time within it."""
    before = flight.times < time
    position, velocity = flight.at(np.array([time]))
    spins = np.stack([np.interp(time, flight.times, flight.spins[:, axis]) for axis in range(3)])[None]
    return replace(
        flight,
        times=np.append(flight.times[before], time),
        positions=np.concatenate([flight.positions[before], position]),
        velocities=np.concatenate([flight.velocities[before], velocity]),
        spins=np.concatenate([flight.spins[before], spins]),
    )


def _roll(
    position: np.ndarray, velocity: np.ndarray, time: float, world: FlightWorld, until: float
) -> tuple[list[Flight], list[Contact]]:
    """The ball on the ground, slowed evenly, until it rests, meets the net's foot or leaves the bounds."""
    braking = world.surface.rolling * world.air.gravity
    speed = float(np.hypot(velocity[0], velocity[1]))
    way = velocity / speed if speed > 0 else np.zeros(3)
    rest = speed / braking if braking > 0 else math.inf
    wall = _time_for(_to_wall(position, way, world), speed, braking)
    foot = _time_for(_to_net(position, way, world), speed, braking)
    end = min(until - time, wall, foot)
    flights: list[Flight] = []
    contacts: list[Contact] = []
    if end > KNOTS_S:
        since = np.array([0.0, end]) if not KNOTS_S < rest < end - KNOTS_S else np.array([0.0, rest, end])
        moving = np.minimum(since, rest)[:, None]
        flight = Flight(
            times=time + since,
            positions=position + way * (speed * moving - 0.5 * braking * moving**2),
            velocities=way * np.maximum(speed - braking * moving, 0.0),
            spins=np.array([-way[1], way[0], 0.0]) * np.maximum(speed - braking * moving, 0.0) / world.build.radius_m,
            drag_per_m=0.0,
            rolls=True,
        )
        flights.append(flight)
        position, time = flight.positions[-1], float(flight.times[-1])
        kind = "net" if foot == end and until - time > KNOTS_S else "last"
        contacts.append(Contact(time=time, kind=kind, player=-1, position=position))
    if foot == end and until - time > KNOTS_S:
        # The net takes what speed a rolling ball has left.
        still, last = _roll(position, np.zeros(3), time, world, until)
        return [*flights, *still], [*contacts, *last]
    return flights, contacts


def _time_for(distance: float, speed: float, braking: float) -> float:
    """When a rolling ball has gone so far; inf where it rests before."""
    left = speed**2 - 2 * braking * distance
    return 2 * distance / (speed + math.sqrt(left)) if left > 0 else math.inf


def _to_wall(position: np.ndarray, way: np.ndarray, world: FlightWorld) -> float:
    """Distance along the ground to where the bounds end."""
    return min(
        ((bound - math.copysign(1.0, step) * place) / abs(step) if abs(step) > ALONG else math.inf)
        for place, step, bound in zip(position[:2], way[:2], world.bounds, strict=True)
    )


def _to_net(position: np.ndarray, way: np.ndarray, world: FlightWorld) -> float:
    """Distance along the ground to the net; inf where the ball rolls away from it or past it."""
    if world.net is None or abs(way[1]) < ALONG or position[1] * way[1] >= 0:
        return math.inf
    gap = max(abs(position[1]) - world.build.radius_m - world.net.tape_radius_m, 0.0)
    distance = gap / abs(way[1])
    x = position[0] + distance * way[0]
    return distance if world.net.xs[0] <= x <= world.net.xs[-1] else math.inf
