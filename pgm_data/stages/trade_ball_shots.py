"""Shots and rallies by lot whose every moment is known, flown by the simulator alone.

A SHOT runs from a hit over the bounce to the next contact or to where the play is cut; a rally is shots in order. The
truth shares no code with the solvers: drag, spin, air, bounces and the ball's place at a time come from
`pgm_data.simulate`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallEvents
from pgm_data.scene import Scene
from pgm_data.simulate.flight.aim import aim, net_clearance
from pgm_data.simulate.flight.air import SEA_LEVEL_AIR, Air, ball_build, force_per_m
from pgm_data.simulate.flight.contact import SURFACES, net_shape
from pgm_data.simulate.flight.course import FlightWorld, cut, follow, truncated
from pgm_data.simulate.flight.path import BallPath, Contact, Flight
from pgm_data.simulate.tennis.match import draw_match, plays
from pgm_data.simulate.tennis.play import Play

SHOT_KINDS = ("serve", "forehand_near", "forehand_far", "slice", "lob")
RALLY_SHOTS = (4, 10)
"""Fewest and most hits of a rally."""
RPM = 2 * np.pi / 60
KMH = 1 / 3.6
WIDE = (30.0, 60.0)
"""Bounds without walls that a shot could reach, half width and half length, metres."""
LONGEST_S = 8.0
CLEARANCE_M = 0.03
"""Over the net, at least."""
AFTER_BOUNCE_S = (0.25, 0.6)
"""From a bounce to the next contact."""
LAST_BOUNCE_S = 0.6
"""After the bounce of a rally's last shot, at most, the play is cut."""
RETURNED = 0.8
"""Share of single shots that end with a hit; the others are cut there."""
LOB_DEG = (45.0, 60.0)
"""Elevation of a lob at the hit."""
ATTEMPTS = 2000


@dataclass(frozen=True, eq=False, kw_only=True)
class TrueShot:
    """One hit, or a serve's toss, and what the ball flies in up to the next hit."""

    start_s: float
    end_s: float
    position: Float[np.ndarray, " 3"]
    """At the hit, world metres."""
    velocity: Float[np.ndarray, " 3"]
    """m/s just after it."""
    spin: Float[np.ndarray, " 3"]
    """rad/s just after it."""
    world: FlightWorld
    """Without a net and walls."""
    landing: Float[np.ndarray, " 3"]
    """Where the ball meets the ground, z = 0; NaN where it is hit before."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TruePath:
    """A shot or rally from its first contact, at 0 s, to its last."""

    path: BallPath
    shots: tuple[TrueShot, ...]

    @property
    def end_s(self) -> float:
        """When its last contact is."""
        return self.shots[-1].end_s

    def spin_at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times 3"]:
        """rad/s; NaN outside of the path."""
        spin = np.full((len(times), 3), np.nan)
        for flight in self.path.flights:
            inside = (times >= flight.times[0]) & (times <= flight.times[-1])
            for axis in range(3):
                spin[inside, axis] = np.interp(times[inside], flight.times, flight.spins[:, axis])
        return spin

    def events(self) -> tuple[BallEvents, Float[np.ndarray, "events 3"]]:
        """The true contacts and where the ball's centre is at each, world metres."""
        contacts = self.path.contacts
        count = len(contacts)
        events = BallEvents(
            times=np.array([c.time for c in contacts]),
            kinds=np.array([c.kind for c in contacts], dtype=object),
            probability=np.ones(count),
            time_std=np.zeros(count),
            sources=np.array(["simulated"] * count, dtype=object),
            players=np.array([f"player{c.player}" if c.player >= 0 else "" for c in contacts], dtype=object),
            ground_px=np.full((count, 2), np.nan),
        )
        return events, np.stack([c.position for c in contacts])


@dataclass(frozen=True, kw_only=True)
class _Stroke:
    """How one shot is struck, as a player at the near end would."""

    start: tuple[float, float, float]
    target: tuple[float, float]
    speed: float
    """m/s."""
    topspin: float
    """rad/s."""
    sidespin: float
    """rad/s."""
    high: bool = False


def draw_shot(kind: str, rng: np.random.Generator, scene: Scene) -> TruePath:
    """A shot of one of `SHOT_KINDS`, in air, with a ball and on a ground by lot.

    Raises:
        ValueError: If the kind is unknown, the scene has no court or ball, or no such shot comes over the net.
    """
    if kind not in SHOT_KINDS:
        raise ValueError(f"draw_shot.kind: expected one of {', '.join(SHOT_KINDS)}, got {kind!r}")
    far = kind == "forehand_far" or (kind != "forehand_near" and rng.random() < 0.5)
    turn = np.array([-1.0, -1.0, 1.0]) if far else np.ones(3)
    world = draw_world(rng, scene)
    for _ in range(ATTEMPTS):
        stroke = _stroke(kind, rng)
        start, target = turn * np.array(stroke.start), turn[:2] * np.array(stroke.target)
        launch = aim(start, target, stroke.speed, stroke.topspin, stroke.sidespin, world, high=stroke.high)
        if launch is None or net_clearance(start, launch, world) < CLEARANCE_M:
            continue
        rise = np.degrees(np.arcsin(launch.velocity[2] / stroke.speed))
        if stroke.high and not LOB_DEG[0] < rise < LOB_DEG[1]:
            continue
        free = replace(world, net=None, bounds=WIDE)
        flights, contacts = follow(start, launch.velocity, launch.spin, 0.0, free, until=LONGEST_S)
        if len(contacts) < 2 or [c.kind for c in contacts[:1]] != ["bounce"]:
            continue
        bounce = contacts[0]
        end = bounce.time + min(rng.uniform(*AFTER_BOUNCE_S), 0.9 * (contacts[1].time - bounce.time))
        kept, _ = truncated(flights, contacts, end)
        hit = Contact(time=0.0, kind="hit", player=int(far), position=start)
        returned = rng.random() < RETURNED
        final = Contact(
            time=end,
            kind="hit" if returned else "last",
            player=int(not far) if returned else -1,
            position=kept[-1].positions[-1],
        )
        shot = TrueShot(
            start_s=0.0,
            end_s=end,
            position=start,
            velocity=launch.velocity,
            spin=launch.spin,
            world=free,
            landing=bounce.position * np.array([1.0, 1.0, 0.0]),
        )
        return TruePath(path=BallPath(flights=tuple(kept), contacts=(hit, bounce, final)), shots=(shot,))
    raise ValueError(f"draw_shot: expected a {kind} that comes over the net in {ATTEMPTS} draws, got none")


def draw_world(rng: np.random.Generator, scene: Scene) -> FlightWorld:
    """A ball, still air and a ground by lot: drag as the scene's prior scatters, surfaces as they differ.

    Raises:
        ValueError: If the scene has no court or no ball.
    """
    if scene.court is None or scene.ball is None:
        raise ValueError(f"draw_world.scene: expected a court and a ball, got {scene.name}")
    build = ball_build(scene.ball)
    air = Air(density_kg_m3=SEA_LEVEL_AIR)
    drag = scene.ball.drag_per_m
    constant = drag.mean + drag.std * float(np.clip(rng.normal(), -2.5, 2.5))
    surface = SURFACES[("hard", "clay", "grass")[int(rng.choice(3, p=[0.6, 0.28, 0.12]))]]
    return FlightWorld(
        air=air,
        build=replace(
            build,
            drag_coefficient=constant / force_per_m(air, build),
            lift_factor=build.lift_factor * float(np.clip(rng.normal(1.0, 0.1), 0.7, 1.3)),
        ),
        surface=replace(
            surface,
            restitution=float(np.clip(rng.normal(surface.restitution, 0.03), 0.65, 0.9)),
            friction=float(np.clip(rng.normal(surface.friction, 0.06), 0.3, 0.95)),
            grip=float(rng.uniform(0.0, 0.2)),
        ),
        net=net_shape(scene.court.net_world, scene.court.tape_width),
    )


def _stroke(kind: str, rng: np.random.Generator) -> _Stroke:
    """Speeds in km/h and spins in rpm of professional tennis; where from and to, as seen from the near end.

    Some are aimed beside or behind the lines, so that there is something to judge.
    """

    def about(mean: float, std: float, width: float = 2.0) -> float:
        return mean + std * float(np.clip(rng.normal(), -width, width))

    across = float(rng.uniform(-4.6, 4.6))
    behind = (float(rng.uniform(-4.0, 4.0)), -float(rng.uniform(10.5, 14.0)))
    if kind == "serve":
        side = 1.0 if rng.random() < 0.5 else -1.0
        kick = rng.random() < 0.25
        return _Stroke(
            start=(side * float(rng.uniform(0.2, 1.4)), -about(11.6, 0.15), float(rng.uniform(2.55, 2.95))),
            target=(-side * float(rng.uniform(0.2, 4.4)), float(rng.uniform(4.6, 6.8))),
            speed=KMH * (about(150, 8) if kick else about(200, 9)),
            topspin=RPM * (about(2900, 350) if kick else about(1000, 300)),
            sidespin=RPM * (about(0, 1200) if kick else about(0, 400)),
        )
    if kind == "slice":
        return _Stroke(
            start=(*behind, float(rng.uniform(0.5, 1.1))),
            target=(across, float(rng.uniform(5.5, 12.3))),
            speed=KMH * about(80, 6),
            topspin=RPM * about(-1800, 350),
            sidespin=RPM * about(0, 300),
        )
    if kind == "lob":
        return _Stroke(
            start=(*behind, float(rng.uniform(0.4, 1.2))),
            target=(across, float(rng.uniform(7.5, 12.4))),
            speed=KMH * about(72, 4),
            topspin=RPM * about(0, 600),
            sidespin=RPM * about(0, 150),
            high=True,
        )
    heavy = rng.random() < 0.3
    return _Stroke(
        start=(*behind, float(rng.uniform(0.7, 1.3))),
        target=(across, float(rng.uniform(6.0, 12.4))),
        speed=KMH * (about(125, 6) if heavy else about(110, 8)),
        topspin=RPM * (about(3200, 350) if heavy else about(2500, 400)),
        sidespin=RPM * about(0, 300),
    )


def draw_rally(rng: np.random.Generator, scene: Scene) -> TruePath:
    """The rally of a play by lot from the toss on, with so many hits as `RALLY_SHOTS` and none into the net.

    It ends in flight, some time after the bounce of its last shot; longer ones are cut so.
    """
    match = draw_match(rng, scene, name="rally")
    free = replace(match.world, net=None, bounds=WIDE)
    stream = plays(match, rng)
    while True:
        path = rally_of(next(stream), free)
        if path is not None:
            return path


def rally_of(play: Play, world: FlightWorld) -> TruePath | None:
    """The rally of that play, `world` being its match's; None where it has too few shots."""
    contacts, flights = play.ball.contacts, play.ball.flights
    kinds = [c.kind for c in contacts]
    stop = next(i for i in range(1, len(kinds)) if kinds[i] in ("net", "last"))
    hits = [i for i in range(stop) if kinds[i] == "hit"]
    if kinds[stop] == "net" and hits:
        # The shot into the net is no part of it.
        stop = hits.pop()
    if kinds[0] != "first" or len(hits) < RALLY_SHOTS[0]:
        return None
    if len(hits) > RALLY_SHOTS[1]:
        stop = hits[RALLY_SHOTS[1]]
        hits = hits[: RALLY_SHOTS[1]]
    start, end = contacts[0].time, _cut_time(contacts, hits[-1], stop)
    kept = [f for f in flights[:stop] if f.times[0] < end]
    kept = [_earlier(flight, start) for flight in (*kept[:-1], cut(kept[-1], end))]
    begun = [replace(c, time=c.time - start) for c in contacts[: len(kept)]]
    final = Contact(time=end - start, kind="last", player=-1, position=kept[-1].positions[-1])
    begins = [0, *hits]
    bounds = [*(contacts[i].time - start for i in begins), end - start]
    shots = tuple(
        TrueShot(
            start_s=float(bounds[k]),
            end_s=float(bounds[k + 1]),
            position=flights[i].positions[0],
            velocity=flights[i].velocities[0],
            spin=flights[i].spins[0],
            world=_with_drag(world, flights[i].drag_per_m),
            landing=_landing(contacts, i, end),
        )
        for k, i in enumerate(begins)
    )
    return TruePath(path=BallPath(flights=tuple(kept), contacts=(*begun, final)), shots=shots)


def _cut_time(contacts: Sequence[Contact], hit: int, stop: int) -> float:
    """When a rally with that last hit is cut: after the hit's first bounce if there is one, before contact `stop`."""
    bounces = [c.time for c in contacts[hit + 1 : stop + 1] if c.kind == "bounce"]
    since = bounces[0] if bounces else contacts[hit].time
    limit = bounces[1] if len(bounces) > 1 else contacts[stop].time
    return since + min(0.9 * (limit - since), LAST_BOUNCE_S)


def _landing(contacts: Sequence[Contact], hit: int, end: float) -> np.ndarray:
    """Where the shot of that hit meets the ground before the path ends; NaN where it does not."""
    after = contacts[hit + 1]
    bounced = after.kind == "bounce" and after.time <= end
    return after.position * np.array([1.0, 1.0, 0.0]) if bounced else np.full(3, np.nan)


def _with_drag(world: FlightWorld, drag_per_m: float) -> FlightWorld:
    coefficient = drag_per_m / force_per_m(world.air, world.build)
    return replace(world, build=replace(world.build, drag_coefficient=coefficient))


def _earlier(flight: Flight, by_s: float) -> Flight:
    return replace(flight, times=flight.times - by_s)
