"""Shots and rallies flown by the simulator's own laws, seen by broadcast cameras: the truth for the physics solver."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import load_scene
from pgm_data.simulate.flight.aim import aim
from pgm_data.simulate.flight.air import Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES
from pgm_data.simulate.flight.course import FlightWorld, follow, truncated
from pgm_data.simulate.flight.path import BallPath, Contact, Flight
from tests.lift.ball.line_worlds import events_of, track_of

SCENE = load_scene("tennis")
WORLD = ball_world(SCENE)


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """What a solver gets, and the truth."""

    track: BallTrack
    events: BallEvents
    camera: Camera
    position: np.ndarray
    contacts: np.ndarray
    """True times of the events."""
    spins: tuple[np.ndarray, ...]
    """Of the flights, at their starts."""

    def error(self, position: np.ndarray) -> float:
        """Rms distance over the frames that are placed, m."""
        off = ((position - self.position) ** 2).sum(axis=1)
        return float(np.sqrt(np.nanmean(off)))


def still(K: np.ndarray, R: np.ndarray, t: np.ndarray, frames: int, lens: tuple[float, ...] = (0, 0, 0, 0)) -> Camera:
    """The same camera in every frame."""
    return Camera(
        K=np.tile(K, (frames, 1, 1)),
        distortion=np.tile(np.array(lens, dtype=float), (frames, 1)),
        R_cam_from_world=np.tile(R, (frames, 1, 1)),
        t_cam_from_world=np.tile(t, (frames, 1)),
    )


def looking(centre: np.ndarray, target: np.ndarray, focal: float, frames: int, **lens) -> Camera:
    """A level camera from one point to another."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal, 0.0, 959.5], [0.0, focal, 539.5], [0.0, 0.0, 1.0]])
    return still(K, R, -R @ centre, frames, **lens)


def broadcast(rng: np.random.Generator, frames: int) -> Camera:
    """A camera behind the court as broadcasts have it."""
    back = rng.uniform(29, 53)
    field = np.clip(2 * math.atan(rng.uniform(7.5, 9) / (back - 11.9)), math.radians(21), math.radians(47))
    centre = np.array([0.0, -back, rng.uniform(8, 12.5)])
    return looking(centre, np.array([0.0, -1.0, 0.0]), 960 / math.tan(field / 2), frames, lens=(0.05, 0.0, 0.0, 0.0))


def _struck(rng: np.random.Generator, kind: str, near: bool, start: np.ndarray | None, world: FlightWorld):
    """Flights and contacts of one shot, from 0 s to the next hit."""
    side = -1.0 if near else 1.0
    for _ in range(400):
        high = kind == "lob"
        across = float(rng.uniform(-3.6, 3.6))
        if kind == "serve":
            own = np.array([rng.uniform(0.2, 1.4), side * 11.8, rng.uniform(2.55, 2.9)])
            target, speed, topspin = np.array([-abs(across), -side * 5.3]), rng.uniform(42, 56), rng.uniform(80, 260)
        else:
            own = np.array([rng.uniform(-3.8, 3.8), side * rng.uniform(10.5, 13.0), rng.uniform(0.6, 1.4)])
            target = np.array([across, -side * rng.uniform(6.5, 11.3)])
            speed, topspin = (rng.uniform(19, 24), 50.0) if high else (rng.uniform(26, 36), rng.uniform(150, 330))
        begin = own if start is None else start
        launch = aim(begin, target, speed, topspin, rng.normal() * 30, world, high=high)
        if launch is None:
            continue
        flights, contacts = follow(begin, launch.velocity, launch.spin, 0.0, world, until=9.0)
        if contacts[0].kind != "bounce" or len(contacts) < 2:
            continue
        stop = contacts[0].time + (contacts[1].time - contacts[0].time) * rng.uniform(0.3, 0.97)
        kept, before = truncated(flights, contacts, stop)
        end = kept[-1].positions[-1]
        if 0.3 < end[2] < 2.0 and abs(end[1]) < 18 and abs(end[0]) < 8:
            hit = Contact(time=stop, kind="hit", player=-1, position=end)
            return kept, [Contact(time=0.0, kind="hit", player=-1, position=begin), *before, hit]
    raise AssertionError(f"no {kind} in 400 draws")


def course(rng: np.random.Generator, kinds: list[str], *, near: bool = True) -> BallPath:
    """Shots in turn, each struck where the last one ended; ball, air and ground by lot."""
    build = ball_build(SCENE.ball)
    hard = SURFACES["hard"]
    world = FlightWorld(
        air=Air(),
        build=replace(
            build,
            drag_coefficient=build.drag_coefficient * (1 + 0.1 * float(np.clip(rng.normal(), -2, 2))),
            lift_factor=float(rng.uniform(0.9, 1.1)),
        ),
        surface=replace(hard, restitution=float(rng.uniform(0.74, 0.8)), friction=float(rng.uniform(0.5, 0.7))),
        net=None,
        bounds=(12.0, 21.0),
    )
    flights: list[Flight] = []
    contacts: list[Contact] = []
    for kind in kinds:
        since = contacts[-1].time if contacts else 0.0
        start = contacts[-1].position if contacts else None
        own, met = _struck(rng, kind, near, start, world)
        flights += [replace(flight, times=flight.times + since) for flight in own]
        contacts = [*contacts[:-1], *(replace(contact, time=contact.time + since) for contact in met)]
        near = not near
    return BallPath(flights=tuple(flights), contacts=tuple(contacts))


def seen(
    rng: np.random.Generator, path: BallPath, fps: float, *, marks: bool, noise_px: float = 1.0, missing: float = 0.08
) -> Seen:
    """The path as a detector and a person give it: noisy, with gaps, contacts to the nearest frame."""
    end = path.contacts[-1].time
    times = (np.arange(int(end * fps) + 6) - 2 + rng.uniform()) / fps
    position, _ = path.at(times)
    inside = np.isfinite(position[:, 0])
    camera = broadcast(rng, len(times))
    pixels = np.full((len(times), 2), np.nan)
    pixels[inside] = project(camera[inside], position[inside, None])[0][:, 0]
    pixels += noise_px * rng.normal(size=pixels.shape)
    gone = rng.uniform(size=len(times)) < missing
    burst = np.flatnonzero(inside)[int(rng.integers(3, max(inside.sum() - 6, 4)))]
    gone[burst : burst + 3] = missing > 0
    pixels[gone] = np.nan
    contacts = np.array([contact.time for contact in path.contacts])
    rows = np.flatnonzero(inside)
    nearest = rows[np.abs(times[rows][None] - contacts[:, None]).argmin(axis=1)]
    ground = np.full((len(contacts), 2), np.nan)
    if marks:
        for k in (0, -1):
            below = position[nearest[k]] * np.array([1.0, 1.0, 0.0])
            ground[k] = project(camera[nearest[k]], below[None])[0][0] + 3 * rng.normal(size=2)
    kinds = [contact.kind for contact in path.contacts]
    return Seen(
        track=track_of(times, pixels, noise_px),
        events=events_of(times[nearest], [str(kind) for kind in kinds], 1 / fps / math.sqrt(12), ground),
        camera=camera,
        position=position,
        contacts=contacts,
        spins=tuple(flight.spins[0] for flight in path.flights),
    )
