import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pgm_data.scene import load_scene
from pgm_data.simulate.flight.air import Air, BallBuild, ball_build, drag_per_m
from pgm_data.simulate.flight.contact import net_shape
from pgm_data.simulate.flight.integrate import Flown, Stop, fly
from pgm_data.simulate.flight.laws import energy_gains
from pgm_data.simulate.flight.path import BallPath, Contact, Flight

SCENE = load_scene("tennis")
assert SCENE.ball is not None and SCENE.court is not None
BALL = ball_build(SCENE.ball)
NET = net_shape(SCENE.court.net_world, SCENE.court.tape_width)
SERVE = (np.array([0.4, -11.7, 2.9]), np.array([-9.5, 54.0, -5.5]), np.array([-120.0, 40.0, 260.0]))
NOWHERE = -math.inf
RPM = 2 * math.pi / 60

speeds = st.floats(0.0, 70.0)
turns = st.floats(-6000 * RPM, 6000 * RPM)
angles = st.floats(-1.5, 1.5)


def launch(speed: float, elevation: float, azimuth: float) -> np.ndarray:
    c = math.cos(elevation)
    return speed * np.array([c * math.sin(azimuth), c * math.cos(azimuth), math.sin(elevation)])


def as_path(flown: Flown) -> BallPath:
    flight = Flight(
        times=flown.times,
        positions=flown.positions,
        velocities=flown.velocities,
        spins=flown.spins,
        drag_per_m=0.0,
    )
    ends = [Contact(time=0.0, kind="first", player=-1, position=flown.positions[i]) for i in (0, -1)]
    return BallPath(flights=(flight,), contacts=tuple(ends))


def reference(start: tuple[np.ndarray, ...], air: Air, build: BallBuild, times: np.ndarray) -> np.ndarray:
    """Positions by another integrator, of the laws written out with vectors."""
    position, velocity, spin = start
    area = math.pi * build.radius_m**2

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        through = state[3:] - air.wind
        turning = spin * math.exp(-build.spin_decay_per_s * t)
        speed = np.linalg.norm(through)
        pressure = 0.5 * air.density_kg_m3 * area * speed**2 / build.mass_kg
        force = -pressure * build.drag_coefficient * through / speed
        rate = np.linalg.norm(turning)
        if rate > 0:
            S = build.radius_m * rate / speed
            lift = build.lift_factor * S / (1 + 2 * S)
            force += pressure * lift * np.cross(turning / rate, through / speed)
        return np.concatenate([state[3:], force - [0, 0, air.gravity]])

    solved = solve_ivp(
        slope,
        (0, times[-1]),
        np.concatenate([position, velocity]),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-12,
    )
    return solved.y[:3].T


@pytest.mark.parametrize("wind", [np.zeros(3), np.array([-6.0, 25.0, 3.0])])
@pytest.mark.parametrize("rpm", [0.0, 1000.0, 6000.0])
def test_a_serve_of_two_seconds_agrees_with_another_integrator(wind, rpm):
    air = Air(wind=wind)
    start = (SERVE[0], SERVE[1], np.array([-0.8, 0.3, 0.5]) * rpm * RPM)
    flown = fly(*start, air, BALL, until=2.0, floor_z=NOWHERE)
    assert flown.stop == Stop.TIME and flown.times[-1] == 2.0
    error = np.abs(flown.positions - reference(start, air, BALL, flown.times)).max()
    assert error < 1e-7, error


def test_reading_between_samples_equals_integrating_again():
    """To 0.1 mm is promised; a thousandth of it is kept."""
    flown = fly(*SERVE, Air(), BALL, until=2.0, floor_z=NOWHERE)
    times = np.sort(np.random.default_rng(0).uniform(0, 2, 200))
    position, velocity = as_path(flown).at(times)
    assert np.abs(position - reference(SERVE, Air(), BALL, times)).max() < 1e-7
    again = np.stack([fly(*SERVE, Air(), BALL, until=t, floor_z=NOWHERE).velocities[-1] for t in times])
    assert np.abs(velocity - again).max() < 1e-4


def test_a_ball_in_a_vacuum_flies_a_parabola():
    air = Air(density_kg_m3=0.0)
    flown = fly(*SERVE, air, BALL, until=1.5, floor_z=NOWHERE)
    t = flown.times[:, None]
    want = SERVE[0] + SERVE[1] * t - [0, 0, 0.5 * air.gravity] * t**2
    np.testing.assert_allclose(flown.positions, want, atol=1e-12)


@given(speed=st.floats(0.1, 70.0), drag=st.floats(0.0, 10.0))
def test_drag_alone_slows_a_ball_by_the_logarithm(speed, drag):
    build = replace(BALL, drag_coefficient=drag)
    air = Air(gravity=0.0)
    C = drag_per_m(air, build)
    flown = fly(np.array([0.0, 0.0, 5.0]), np.array([0.0, speed, 0.0]), np.zeros(3), air, build, until=2.0)
    want = np.log1p(C * speed * flown.times) / C if C > 0 else speed * flown.times
    np.testing.assert_allclose(flown.positions[:, 1], want, rtol=0, atol=5e-6)


def test_a_drop_from_a_hundred_metres_follows_the_hyperbolic_tangent_to_its_terminal_speed():
    air = Air()
    flown = fly(np.array([0.0, 0.0, 100.0]), np.zeros(3), np.zeros(3), air, BALL, until=60.0)
    terminal = math.sqrt(air.gravity / drag_per_m(air, BALL))
    assert 20 < terminal < 24
    np.testing.assert_allclose(
        -flown.velocities[:, 2], terminal * np.tanh(air.gravity * flown.times / terminal), atol=1e-7
    )
    assert flown.stop == Stop.GROUND and 0.98 * terminal < -flown.velocities[-1, 2] < terminal
    fall = 100.0 - BALL.radius_m
    want = terminal / air.gravity * math.acosh(math.exp(fall * air.gravity / terminal**2))
    assert abs(flown.times[-1] - want) < 1e-8


def test_a_ball_reaches_the_ground_at_the_moment_of_the_closed_form():
    air = Air(density_kg_m3=0.0)
    for rise in (-7.0, 0.0, 0.02, 0.3, 4.0):
        for height in (0.0, 1e-4, 0.3, 2.0):
            if rise <= 0 and height == 0:
                continue
            start = np.array([0.0, 3.0, 1.0 + BALL.radius_m + height])
            flown = fly(start, np.array([1.0, 2.0, rise]), np.zeros(3), air, BALL, until=9.0, floor_z=1.0)
            want = (rise + math.sqrt(rise**2 + 2 * air.gravity * height)) / air.gravity
            assert flown.stop == Stop.GROUND and abs(flown.times[-1] - want) < 1e-9
            assert flown.positions[-1, 2] == 1.0 + BALL.radius_m and flown.velocities[-1, 2] < 0


@pytest.mark.parametrize(("height", "meets"), [(4e-4, True), (6e-4, False)])
def test_a_ball_that_backspin_lifts_off_again_within_a_step_still_met_the_ground(height, meets):
    """It falls by 0.5 mm and is up again after 13 ms."""
    start = np.array([0.0, 0.0, BALL.radius_m + height])
    flown = fly(start, np.array([0.0, 69.0, -0.15]), np.array([620.0, 0.0, 0.0]), Air(), BALL, until=0.5)
    assert (flown.stop == Stop.GROUND and flown.times[-1] < 0.01) == meets
    assert meets or flown.stop == Stop.TIME


@given(speed=speeds, elevation=angles, azimuth=angles, spin=st.tuples(turns, turns, turns))
def test_energy_never_rises_in_still_air(speed, elevation, azimuth, spin):
    start = np.array([0.0, -10.0, 2.0])
    flown = fly(start, launch(speed, elevation, azimuth), np.array(spin), Air(), BALL, until=5.0)
    assert energy_gains(as_path(flown), BALL, 9.81).max() < 1e-12


@given(speed=speeds, elevation=angles, spin=st.tuples(turns, turns, turns))
def test_the_lift_does_no_work(speed, elevation, spin):
    build = replace(BALL, drag_coefficient=0.0, spin_decay_per_s=0.0)
    velocity = launch(speed, elevation, 0.3)
    flown = fly(np.zeros(3), velocity, np.array(spin), Air(gravity=0.0), build, until=2.0, floor_z=NOWHERE)
    np.testing.assert_allclose(np.linalg.norm(flown.velocities, axis=1), speed, rtol=1e-8, atol=1e-12)


@given(speed=speeds, elevation=angles, azimuth=angles, spin=st.tuples(turns, turns, turns))
def test_a_mirrored_launch_flies_the_mirrored_path(speed, elevation, azimuth, spin):
    """Spin is an axial vector: mirrored in x = 0, it keeps x and turns y and z about."""
    air = Air(wind=np.array([3.0, -5.0, 0.0]))
    other = Air(wind=np.array([-3.0, -5.0, 0.0]))
    start, velocity = np.array([1.0, -10.0, 2.0]), launch(speed, elevation, azimuth)
    mirror = np.array([-1.0, 1.0, 1.0])
    one = fly(start, velocity, np.array(spin), air, BALL, until=3.0)
    two = fly(mirror * start, mirror * velocity, -mirror * np.array(spin), other, BALL, until=3.0)
    np.testing.assert_allclose(two.positions, one.positions * mirror, atol=1e-9)


@given(
    speed=speeds, elevation=angles, wind=st.tuples(*[st.floats(-40.0, 40.0)] * 3), spin=st.tuples(turns, turns, turns)
)
def test_a_steady_wind_is_still_air_seen_from_a_moving_frame(speed, elevation, wind, spin):
    velocity, wind = launch(speed, elevation, 0.2), np.array(wind)
    blown = fly(SERVE[0], velocity, np.array(spin), Air(wind=wind), BALL, until=2.0, floor_z=NOWHERE)
    calm = fly(SERVE[0], velocity - wind, np.array(spin), Air(), BALL, until=2.0, floor_z=NOWHERE)
    np.testing.assert_allclose(blown.positions, calm.positions + wind * calm.times[:, None], atol=1e-9)


@pytest.mark.parametrize(
    ("spin", "side", "sign"),
    [((-200.0, 0, 0), 2, -1), ((200.0, 0, 0), 2, 1), ((0, 0, 200.0), 0, -1), ((0, 0, -200.0), 0, 1)],
)
def test_topspin_bends_down_backspin_up_and_sidespin_from_above_anticlockwise_to_the_left(spin, side, sign):
    """A ball that flies along +y: topspin turns about -x, its left is -x."""
    start, velocity = np.array([0.0, -10.0, 5.0]), np.array([0.0, 30.0, 0.0])
    spun = fly(start, velocity, np.array(spin, dtype=float), Air(), BALL, until=0.5)
    plain = fly(start, velocity, np.zeros(3), Air(), BALL, until=0.5)
    assert sign * (spun.positions[-1, side] - plain.positions[-1, side]) > 0.3


def test_spin_decays_by_its_share():
    flown = fly(*SERVE, Air(), replace(BALL, spin_decay_per_s=0.05), until=1.0, floor_z=NOWHERE)
    np.testing.assert_allclose(flown.spins[-1], SERVE[2] * math.exp(-0.05), rtol=1e-12)


def test_a_flight_stops_where_the_ball_touches_the_net():
    flown = fly(np.array([1.0, -9.0, 0.8]), np.array([0.0, 45.0, 0.5]), np.zeros(3), Air(), BALL, until=3.0, net=NET)
    assert flown.stop == Stop.NET
    assert abs(flown.positions[-1, 1] + BALL.radius_m + NET.tape_radius_m) < 1e-8


@settings(max_examples=60)
@given(speed=st.floats(0.5, 70.0), height=st.floats(0.2, 1.3), x=st.floats(-6.0, 6.0), rise=st.floats(-3.0, 3.0))
def test_the_net_is_met_exactly_where_the_path_without_it_comes_near_enough(speed, height, x, rise):
    start, velocity = np.array([x, -1.0, height]), np.array([0.0, speed, rise])
    met = fly(start, velocity, np.zeros(3), Air(), BALL, until=3.0, net=NET)
    path = as_path(fly(start, velocity, np.zeros(3), Air(), BALL, until=3.0))
    crossing = np.arange(0, path.flights[0].times[-1], 1e-5 if speed > 5 else 1e-4)
    p = path.at(crossing)[0]
    over = np.maximum(p[:, 2] - (NET.top_at(x) - NET.tape_radius_m), 0.0)
    gap = np.hypot(p[:, 1], over) - BALL.radius_m - NET.tape_radius_m
    if gap.min() < -1e-3:
        assert met.stop == Stop.NET
        assert abs(met.times[-1] - crossing[np.argmax(gap <= 0)]) < 2e-4
    elif gap.min() > 1e-3:
        assert met.stop != Stop.NET


def test_a_ball_beside_the_net_passes_it():
    flown = fly(np.array([7.0, -5.0, 0.5]), np.array([0.0, 30.0, 1.0]), np.zeros(3), Air(), BALL, until=0.3, net=NET)
    assert flown.stop == Stop.TIME and flown.positions[-1, 1] > 0


def test_a_flight_stops_at_the_walls():
    flown = fly(*SERVE, Air(), BALL, until=3.0, floor_z=-100.0, bounds=(9.0, 18.0))
    assert flown.stop == Stop.BOUNDS and abs(flown.positions[-1, 1] - 18.0) < 1e-9


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("until", {"until": 0.0}),
        ("until", {"until": math.nan}),
        ("finite", {"velocity": np.array([0.0, math.nan, 0.0])}),
        ("position", {"position": np.array([0.0, 0.0, 0.01])}),
    ],
)
def test_an_impossible_flight_is_refused_by_its_field(field, change):
    values = {"position": SERVE[0], "velocity": SERVE[1], "spin": SERVE[2], "until": 1.0, **change}
    with pytest.raises(ValueError, match=field):
        fly(air=Air(), build=BALL, **values)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Air(density_kg_m3=-1.0), "density"),
        (lambda: Air(wind=np.array([0.0, math.inf, 0.0])), "wind"),
        (lambda: replace(BALL, radius_m=0.0), "radius"),
        (lambda: replace(BALL, drag_coefficient=-0.1), "drag"),
        (lambda: replace(BALL, lift_factor=math.nan), "lift"),
    ],
)
def test_impossible_air_and_balls_are_refused_by_their_field(make, match):
    with pytest.raises(ValueError, match=match):
        make()


def test_the_scene_files_drag_constant_holds_at_sea_level():
    assert SCENE.ball is not None
    assert drag_per_m(Air(), BALL) == pytest.approx(SCENE.ball.drag_per_m.mean, rel=1e-12)
    assert drag_per_m(Air(density_kg_m3=0.95), BALL) < SCENE.ball.drag_per_m.mean
