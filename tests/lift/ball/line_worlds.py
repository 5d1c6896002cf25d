"""Single shots with their exact truth, seen by a broadcast camera with noise, gaps, marks and events."""

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
from pgm_data.simulate.flight.course import FlightWorld, follow
from pgm_data.simulate.flight.path import BallPath, Contact

SCENE = load_scene("tennis")
WORLD = ball_world(SCENE)
RPM = 2 * math.pi / 60
SIZE = (1920, 1080)
KINDS = ("serve", "forehand near", "forehand far", "slice", "lob")


def track_of(times: np.ndarray, pixels: np.ndarray, sigma_px: float = 1.0) -> BallTrack:
    """No repeats; NaN where it was not seen."""
    known = np.where(np.isfinite(pixels).all(axis=1), 1.0, np.nan)
    return BallTrack(
        times=times,
        is_duplicate=np.zeros(len(times), dtype=bool),
        pixels=pixels,
        sigma_px=known * sigma_px,
        score=known,
        streak_px=np.full((len(times), 2), np.nan),
    )


def events_of(times: np.ndarray, kinds: list[str], time_std: float, ground_px: np.ndarray | None = None) -> BallEvents:
    count = len(kinds)
    return BallEvents(
        times=np.asarray(times, dtype=float),
        kinds=np.array(kinds, dtype=object),
        probability=np.ones(count),
        time_std=np.full(count, time_std),
        sources=np.array(["human"] * count, dtype=object),
        players=np.array([""] * count, dtype=object),
        ground_px=np.full((count, 2), np.nan) if ground_px is None else ground_px,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """What a solver gets, and the truth."""

    track: BallTrack
    events: BallEvents
    camera: Camera
    position: np.ndarray
    velocity: np.ndarray
    contacts: np.ndarray
    times: np.ndarray
    """Of the contacts, as they were."""
    start_velocity: np.ndarray
    second_bounce: np.ndarray

    def frames(self, rows: np.ndarray) -> "Shot":
        """Only those frames, with all events."""
        t = self.track
        track = track_of(t.times[rows], t.pixels[rows])
        return replace(self, track=track, camera=self.camera[rows], position=self.position[rows])

    def until(self, time: float) -> "Shot":
        """The shot up to a time, where it is last seen."""
        cut = self.frames(np.flatnonzero(self.track.times <= time))
        events = events_of(np.array([self.events.times[0], time]), ["hit", "last"], 0.01, self.events.ground_px[[0, 1]])
        return replace(cut, events=events)


def look_at(position: np.ndarray, target: np.ndarray, hfov_deg: float, frames: int) -> Camera:
    """A still camera, one for each frame."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = 0.5 * SIZE[0] / math.tan(math.radians(hfov_deg) / 2)
    K = np.array([[focal, 0, SIZE[0] / 2 - 0.5], [0, focal, SIZE[1] / 2 - 0.5], [0, 0, 1]])
    one = Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ position)
    return one[None][np.zeros(frames, dtype=int)]


def broadcast_camera(rng: np.random.Generator, frames: int) -> Camera:
    behind = rng.uniform(17, 41)
    low, high = np.interp(behind, [17, 41], [30, 21]), np.interp(behind, [17, 41], [47, 26])
    position = np.array([rng.uniform(-1, 1), -11.885 - behind, rng.uniform(8, 12.5)])
    return look_at(position, np.array([0.0, rng.uniform(-1, 2), 0.5]), rng.uniform(low, high), frames)


def strike(kind: str, rng: np.random.Generator, world: FlightWorld, faster: float = 0.0):
    """Start and launch of a shot of that kind, from the near end but for `forehand far`."""
    while True:
        side = rng.choice([-1.0, 1.0])
        start = np.array([rng.uniform(-3.5, 3.5), -11.885 - rng.uniform(-0.5, 1.0), rng.uniform(0.7, 1.4)])
        target = np.array([rng.uniform(-3.5, 3.5), rng.uniform(7.0, 11.0)])
        if kind == "serve":
            start = np.array([side * rng.uniform(0.3, 1.5), -11.6, rng.uniform(2.5, 2.9)])
            target = np.array([-side * rng.uniform(0.4, 3.6), rng.uniform(4.5, 6.2)])
            flat = rng.random() < 0.6
            speed, topspin = (rng.normal(55, 3), rng.normal(1200, 200)) if flat else (rng.normal(42, 2), 3000)
            sidespin, high = rng.normal(0, 700), False
        elif kind == "slice":
            speed, topspin, sidespin, high = rng.normal(22.5, 1.5), rng.normal(-1700, 300), rng.normal(0, 200), False
        elif kind == "lob":
            speed, topspin, sidespin, high = rng.normal(22.0, 1.0), rng.normal(300, 600), rng.normal(0, 200), True
        else:
            speed, topspin, sidespin, high = rng.normal(31, 2.5), rng.normal(2500, 500), rng.normal(0, 400), False
        if kind == "forehand far" or (kind in ("slice", "lob") and rng.random() < 0.3):
            start[:2], target = -start[:2], -target
        launch = aim(start, target, float(speed) + faster, topspin * RPM, sidespin * RPM, world, high=high)
        if launch is not None:
            return start, launch


def shot(kind: str, rng: np.random.Generator, fps: float = 25.0, marked: bool = True, faster: float = 0.0) -> Shot:
    """Hit, bounce, next contact: 1 px, 8 % unseen and a burst of 3, marks 3 px, times of contacts 10 ms."""
    build = ball_build(SCENE.ball)
    build = replace(
        build,
        drag_coefficient=build.drag_coefficient * (1 + 0.07 * rng.normal()),
        lift_factor=build.lift_factor * (1 + 0.1 * rng.normal()),
    )
    surface = SURFACES[("hard", "clay", "grass")[rng.integers(3)]]
    world = FlightWorld(air=Air(), build=build, surface=surface, net=None, bounds=(40.0, 60.0))
    start, launch = strike(kind, rng, world, faster)
    flights, ends = follow(start, launch.velocity, launch.spin, 0.0, world, until=20.0)
    bounce, second = ends[0].time, ends[1].time
    until = bounce + rng.uniform(0.45, 0.85) * min(second - bounce, 1.0)
    contacts = (Contact(time=0.0, kind="hit", player=0, position=start), *ends)
    path = BallPath(flights=tuple(flights), contacts=contacts)
    offset = rng.uniform(0, 1 / fps)
    times = np.arange(math.ceil((until + offset) * fps) + 1) / fps
    position, velocity = path.at(times - offset)
    outside = (times < offset) | (times > until + offset)
    position[outside], velocity[outside] = np.nan, np.nan
    camera = broadcast_camera(rng, len(times))
    pixels = project(camera, np.nan_to_num(position)[:, None])[0][:, 0] + rng.normal(size=(len(times), 2))
    lost = outside | (rng.random(len(times)) < 0.08)
    burst = rng.integers(2, max(len(times) - 5, 3))
    lost[burst : burst + 3] = True
    pixels[lost] = np.nan
    contact_times = np.array([0.0, bounce, until])
    places = path.at(contact_times)[0]
    ground = project(camera[:1], places[None] * [1, 1, 0])[0][0] + 3 * rng.normal(size=(3, 2))
    ground[1] = np.nan
    measured = contact_times + offset + rng.normal(size=3) * [0.003, 0.01, 0.01]
    return Shot(
        track=track_of(times, pixels),
        events=events_of(measured, ["hit", "bounce", "hit"], 0.01, ground if marked else None),
        camera=camera,
        position=position,
        velocity=velocity,
        contacts=places,
        times=contact_times + offset,
        start_velocity=launch.velocity,
        second_bounce=ends[1].position,
    )
