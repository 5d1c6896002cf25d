"""Quick fits against flights that were integrated in small steps, and against the events between them."""

import numpy as np
import pytest

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.contact_motion import motion_along, sights_of
from pgm_data.lift.ball.quick_flight import fit_flights, flight_guess, quick_flights
from pgm_data.lift.ball.world import GRAVITY, BallWorld, ball_world
from pgm_data.scene import load_scene

WORLD = ball_world(load_scene("tennis"))
FINE = 4e-3


def behind_court(frames: int, *, back: float = 30.0, up: float = 11.0, focal: float = 2600.0) -> Camera:
    """A camera behind the near baseline that looks at the middle of the court."""
    centre = np.array([0.0, -back, up])
    forward = -centre / np.linalg.norm(centre)
    right = np.array([1.0, 0.0, 0.0])
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal, 0, 640], [0, focal, 360], [0, 0, 1.0]])
    return Camera(
        K=np.repeat(K[None], frames, 0),
        distortion=np.zeros((frames, 4)),
        R_cam_from_world=np.repeat(R[None], frames, 0),
        t_cam_from_world=np.repeat((-R @ centre)[None], frames, 0),
    )


def flown(p, v, w, times: np.ndarray, world: BallWorld) -> np.ndarray:
    """Position and velocity by small midpoint steps from time 0."""

    def push(v):
        speed = np.linalg.norm(v)
        share = world.lift_per_m * world.radius_m / (1 + 2 * world.radius_m * world.spin_std / max(speed, 1.0))
        return -world.drag_per_m.mean * speed * v + share * np.cross(w, v) - np.array([0, 0, GRAVITY])

    states = [np.concatenate([p, v])]
    fine = np.arange(0, times[-1] + FINE, FINE)
    for _ in fine[1:]:
        p, v = states[-1][:3], states[-1][3:]
        half = v + 0.5 * FINE * push(v)
        states.append(np.concatenate([p + FINE * half, v + FINE * push(half)]))
    table = np.array(states)
    return np.stack([np.interp(times, fine, table[:, k]) for k in range(6)], axis=1)


def track_of(times: np.ndarray, pixels: np.ndarray, sigma: float) -> BallTrack:
    """A track of those pixels; NaN where there is none."""
    seen = np.isfinite(pixels).all(axis=1)
    return BallTrack(
        times=times,
        is_duplicate=np.zeros(len(times), bool),
        pixels=pixels,
        sigma_px=np.where(seen, sigma, np.nan),
        score=np.where(seen, 0.9, np.nan),
        streak_px=np.full((len(times), 2), np.nan),
    )


def seen(positions: np.ndarray, camera: Camera) -> np.ndarray:
    """Pixels of one position a frame."""
    return project(camera, positions[:, None])[0][:, 0]


def events_of(times, kinds, std: float = 1e-3) -> BallEvents:
    """Detected events."""
    n = len(times)
    return BallEvents(
        times=np.array(times, float),
        kinds=np.array(kinds, dtype=object),
        probability=np.ones(n),
        time_std=np.full(n, std),
        sources=np.full(n, "detected", dtype=object),
        players=np.full(n, "", dtype=object),
        ground_px=np.full((n, 2), np.nan),
    )


@pytest.mark.parametrize(
    ("velocity", "spin"),
    [
        ((2.0, 30.0, 3.0), (0.0, 0.0, 0.0)),
        ((-3.0, 25.0, 5.0), (250.0, 20.0, 50.0)),
        ((0.0, 6.0, 15.0), (0.0, 0.0, 0.0)),
    ],
)
def test_a_motion_along_its_own_velocity_is_the_integrated_flight(velocity, spin):
    times = np.linspace(0, 0.8, 41)
    start = np.array([1.0, -12.0, 1.0])
    truth = flown(start, np.array(velocity), np.array(spin), times, WORLD)
    motion = motion_along(times[None], truth[None, :, 3:], WORLD)
    position = motion.position(start[None], np.array(velocity)[None], np.array(spin)[None])[0]
    speed = motion.velocity(np.array(velocity)[None], np.array(spin)[None])[0]
    assert np.abs(position - truth[:, :3]).max() < 0.02
    assert np.abs(speed - truth[:, 3:]).max() < 0.05


def test_sights_vanish_on_the_ray_and_measure_pixels_beside_it():
    camera = behind_court(2)
    points = np.array([[1.0, 3.0, 2.0], [-2.0, -5.0, 0.5]])
    pixels = seen(points, camera)
    sights = sights_of(track_of(np.array([0.0, 0.04]), pixels, 1.0), camera)
    moved = points + np.array([0.01, 0.0, 0.02])
    depth = np.sum(sights.axis * moved, axis=1) + sights.axis_offset
    on = np.einsum("nki,ni->nk", sights.planes, points) + sights.offsets
    off = np.einsum("nki,ni->nk", sights.planes, moved) + sights.offsets
    np.testing.assert_allclose(on / depth[:, None], 0, atol=1e-8)
    np.testing.assert_allclose(off / depth[:, None], seen(moved, camera) - pixels, atol=1e-8)


def flights_to_ground(count: int, noise: float, rng: np.random.Generator):
    """Flights from a hit to the ground: sights, begins, ends, truths at the start."""
    out = []
    for _ in range(count):
        velocity = np.array([rng.uniform(-4, 4), rng.uniform(22, 34), rng.uniform(1, 5)])
        start = np.array([rng.uniform(-3, 3), rng.uniform(-13, -10), rng.uniform(0.7, 1.4)])
        spin = np.array([-rng.uniform(0, 250), 0.0, 0.0])
        fine = np.arange(0, 1.6, FINE)
        path = flown(start, velocity, spin, fine, WORLD)
        under = int(np.argmax(path[:, 2] < WORLD.radius_m))
        share = (path[under - 1, 2] - WORLD.radius_m) / (path[under - 1, 2] - path[under, 2])
        lands = fine[under - 1] + share * FINE
        times = np.arange(0.5 / 25, lands, 1 / 25)
        points = np.stack([np.interp(times, fine, path[:, k]) for k in range(3)], axis=1)
        camera = behind_court(len(times))
        pixels = seen(points, camera) + rng.normal(0, noise, (len(times), 2))
        out.append((sights_of(track_of(times, pixels, max(noise, 0.1)), camera), lands, start, velocity))
    return out


def fitted(sights, lands: float):
    """The fit of one flight from a hit at 0 to the ground."""
    guess = flight_guess(
        begin_on_ground=np.array([False]),
        end_on_ground=np.array([True]),
        begin_time_std=np.array([1e-3]),
        end_time_std=np.array([2e-3]),
        world=WORLD,
    )
    return fit_flights(sights, np.zeros(1), np.array([lands]), guess, world=WORLD)


def test_flights_to_the_ground_are_placed_within_their_stated_errors():
    rng = np.random.default_rng(3)
    off, stated = [], []
    for sights, lands, start, velocity in flights_to_ground(24, 1.0, rng):
        fit = fitted(sights, lands)
        off.append(fit.start[0] - np.concatenate([start, velocity]))
        stated.append(np.sqrt(np.diag(fit.start_cov[0])))
    score = np.array(off) / np.array(stated)
    assert 0.5 < (np.abs(score) < 1).mean() < 0.9
    assert np.median(np.abs(np.array(off)[:, 1])) < 2.0


def test_strays_do_not_pull_a_flight():
    sights, lands, start, _ = flights_to_ground(1, 0.5, np.random.default_rng(4))[0]
    clean = fitted(sights, lands)
    offsets = sights.offsets.copy()
    depth = np.sum(sights.axis * np.array([0.0, 0.0, 1.0]), axis=1) + sights.axis_offset
    offsets[5] += 80 * depth[5]
    fields = {name: getattr(sights, name) for name in sights.__dataclass_fields__}
    spoilt = fitted(type(sights)(**(fields | {"offsets": offsets})), lands)
    assert spoilt.strays[0] > 0.9 > clean.strays[0]
    assert np.abs(spoilt.start - clean.start)[0, :3].max() < 0.5
    assert spoilt.cost[0] > clean.cost[0] + 5


def test_thinned_sights_are_some_of_all():
    sights, lands, _, _ = flights_to_ground(1, 0.5, np.random.default_rng(5))[0]
    thin = sights.thinned(2)
    assert len(thin) == (len(sights) + 1) // 2
    np.testing.assert_array_equal(thin.planes, sights.planes[::2])
    assert sights.thinned(1) is sights


def shot_with_bounce(fps: float, noise: float):
    """A hit, its bounce and what follows: track, camera, truths of both starts and the bounce's time."""
    start, velocity = np.array([1.0, -12.0, 1.0]), np.array([-2.0, 27.0, 4.0])
    fine = np.arange(0, 1.8, FINE)
    before = flown(start, velocity, np.zeros(3), fine, WORLD)
    at = int(np.argmax(before[:, 2] < WORLD.radius_m))
    down = before[at]
    after_v = down[3:] * np.array([0.7, 0.7, -0.75])
    after = flown(down[:3], after_v, np.zeros(3), np.arange(0, 0.6, FINE), WORLD)
    path = np.concatenate([before[:at, :3], after[:, :3]])
    clock = np.arange(len(path)) * FINE
    times = np.arange(0.3 / fps, clock[-1], 1 / fps)
    points = np.stack([np.interp(times, clock, path[:, k]) for k in range(3)], axis=1)
    camera = behind_court(len(times))
    pixels = seen(points, camera) + np.random.default_rng(6).normal(0, noise, (len(times), 2))
    return track_of(times, pixels, noise), camera, (start, velocity, down[:3], after_v), at * FINE, clock[-1]


def test_quick_flights_meet_at_the_bounce_and_move_its_time_to_where_it_was():
    track, camera, (start, velocity, spot, after), at, end = shot_with_bounce(25, 1.0)
    events = events_of([0.0, at + 0.012, end], ["hit", "bounce", "last"], std=0.02)
    flights = quick_flights(track, events, camera, world=WORLD)
    assert flights.start_event.tolist() == [0, 1] and flights.end_event.tolist() == [1, 2]
    assert abs(flights.begins[1] - at) < 0.004
    assert np.linalg.norm(flights.position[1] - spot) < 0.3
    assert np.linalg.norm(flights.position[0] - start) < 1.0
    assert np.abs(flights.velocity[0] - velocity).max() < 3.0
    assert np.abs(flights.velocity[1] - after).max() < 3.0
    assert (flights.residual < 2).all()


def test_quick_flights_of_nothing_are_none():
    times = np.arange(5) / 25
    empty = track_of(times, np.full((5, 2), np.nan), 1.0)
    assert len(quick_flights(empty, events_of([0.0, 0.1], ["hit", "bounce"]), behind_court(5), world=WORLD).begins) == 0
    full = track_of(times, np.full((5, 2), 400.0), 1.0)
    assert len(quick_flights(full, events_of([], []), behind_court(5), world=WORLD).begins) == 0


def test_a_last_and_a_first_part_plays():
    track, camera, _, at, end = shot_with_bounce(25, 1.0)
    kinds = ["hit", "first", "bounce", "last", "first", "hit"]
    events = events_of([0.0, 0.0, at, at + 0.2, at + 0.3, end], kinds)
    flights = quick_flights(track, events, camera, world=WORLD)
    pairs = [(kinds[a], kinds[b]) for a, b in zip(flights.start_event, flights.end_event, strict=True)]
    assert pairs == [("hit", "bounce"), ("bounce", "last"), ("first", "hit")]
