import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.flight.aim import Launch, aim, launched, net_clearance
from pgm_data.simulate.flight.air import Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES, net_shape
from pgm_data.simulate.flight.course import FlightWorld
from pgm_data.simulate.flight.integrate import Stop, fly

SCENE = load_scene("tennis")
assert SCENE.ball is not None and SCENE.court is not None
WORLD = FlightWorld(
    air=Air(),
    build=ball_build(SCENE.ball),
    surface=SURFACES["hard"],
    net=net_shape(SCENE.court.net_world, SCENE.court.tape_width),
)
RPM = 2 * math.pi / 60

starts = st.tuples(st.floats(-5.0, 5.0), st.floats(-15.0, -0.5), st.floats(0.1, 3.0)).map(np.array)
targets = st.tuples(st.floats(-5.5, 5.5), st.floats(0.5, 12.5)).map(np.array)
speeds = st.floats(8.0, 65.0)
topspins = st.floats(-3500.0, 5000.0).map(lambda rpm: rpm * RPM)
sidespins = st.floats(-3000.0, 3000.0).map(lambda rpm: rpm * RPM)


def landing(start: np.ndarray, launch: Launch, world: FlightWorld = WORLD) -> np.ndarray:
    flown = fly(start, launch.velocity, launch.spin, world.air, world.build, until=40.0, floor_z=world.floor_z)
    assert flown.stop == Stop.GROUND
    return flown.positions[-1, :2]


@given(start=starts, target=targets, speed=speeds, topspin=topspins, sidespin=sidespins, high=st.booleans())
def test_an_aimed_ball_lands_on_its_target_with_its_speed_and_spin(start, target, speed, topspin, sidespin, high):
    launch = aim(start, target, speed, topspin, sidespin, WORLD, high=high)
    assume(launch is not None)
    assert launch is not None
    assert np.linalg.norm(landing(start, launch) - target) < 1e-3
    assert np.linalg.norm(launch.velocity) == pytest.approx(speed)
    assert np.linalg.norm(launch.spin) == pytest.approx(math.hypot(topspin, sidespin), abs=1e-9)


@settings(max_examples=60)
@given(start=starts, target=targets, speed=st.floats(5.0, 15.0), topspin=topspins, sidespin=sidespins)
def test_where_aim_finds_nothing_no_elevation_comes_to_reach_as_far(start, target, speed, topspin, sidespin):
    """But for a jump: strong backspin lifts off a ball that all but touched the ground, and carries it over."""
    if aim(start, target, speed, topspin, sidespin, WORLD) is not None:
        return
    bearing = math.atan2(*(target - start[:2])[::-1])
    want = float(np.linalg.norm(target - start[:2]))

    def reach(elevation: float) -> float:
        at = landing(start, launched(speed, elevation, bearing, topspin, sidespin))
        return float(np.linalg.norm(at - start[:2]))

    elevations = np.linspace(-1.4, 1.5, 80)
    beyond = [i for i, e in enumerate(elevations) if reach(e) > want * 1.002]
    if beyond and beyond[0] > 0:
        low, high = elevations[beyond[0] - 1], elevations[beyond[0]]
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if reach(middle) < want else (low, middle)
        assert reach(high) - reach(low) > 0.5


def test_the_high_way_is_higher_and_both_arrive():
    start, target = np.array([1.0, -11.0, 0.8]), np.array([-2.0, 10.0])
    low, high = (aim(start, target, 22.0, 100.0, 0.0, WORLD, high=high) for high in (False, True))
    assert low is not None and high is not None
    assert high.velocity[2] > 15 > 10 > low.velocity[2]


@pytest.mark.parametrize("wind", [(0.0, -40.0, 0.0), (40.0, 0.0, 0.0), (0.0, 40.0, 0.0), (-10.0, 15.0, 2.0)])
def test_a_storm_is_aimed_into(wind):
    world = replace(WORLD, air=Air(wind=np.array(wind)))
    start, target = np.array([1.0, -3.0, 1.0]), np.array([-1.0, 2.0])
    launch = aim(start, target, 45.0, 200.0, -50.0, world)
    assert launch is not None
    assert np.linalg.norm(landing(start, launch, world) - target) < 1e-3


def test_against_a_storm_no_ball_flies_twenty_metres():
    world = replace(WORLD, air=Air(wind=np.array([0.0, -40.0, 0.0])))
    assert aim(np.array([0.0, -11.0, 1.0]), np.array([0.0, 9.0]), 45.0, 0.0, 0.0, world) is None


def test_in_a_vacuum_the_elevation_is_the_textbooks():
    world = replace(WORLD, air=Air(density_kg_m3=0.0))
    R = world.build.radius_m
    start, target = np.array([0.0, -10.0, R + 1e-9]), np.array([0.0, 8.0])
    for high in (False, True):
        launch = aim(start, target, 16.0, 0.0, 0.0, world, high=high)
        assert launch is not None
        double = math.asin(9.81 * 18.0 / 16.0**2)
        want = 0.5 * (math.pi - double if high else double)
        assert math.asin(launch.velocity[2] / 16.0) == pytest.approx(want, abs=1e-6)
    assert aim(start, target, 13.0, 0.0, 0.0, world) is None


def test_topspin_turns_forward_and_sidespin_anticlockwise():
    launch = launched(30.0, 0.1, math.pi / 2, 200.0, 50.0)
    np.testing.assert_allclose(launch.spin, [-200.0, 0.0, 50.0], atol=1e-9)
    # The top of the ball runs ahead of its centre.
    assert np.cross(launch.spin, [0.0, 0.0, 1.0])[1] > 0
    np.testing.assert_allclose(launch.velocity, 30.0 * np.array([0.0, math.cos(0.1), math.sin(0.1)]), atol=1e-12)


@given(start=starts, target=targets, speed=st.floats(15.0, 60.0), topspin=topspins)
def test_the_clearance_is_the_height_over_the_net_where_the_ball_crosses(start, target, speed, topspin):
    launch = aim(start, target, speed, topspin, 0.0, WORLD)
    assume(launch is not None)
    assert launch is not None and WORLD.net is not None
    flown = fly(start, launch.velocity, launch.spin, WORLD.air, WORLD.build, until=40.0)
    past = int(np.argmax(flown.positions[:, 1] > 0))
    p, q = flown.positions[past - 1], flown.positions[past]
    share = p[1] / (p[1] - q[1])
    near = p + share * (q - p)
    clearance = net_clearance(start, launch, WORLD)
    if abs(near[0]) < 6.39:
        want = near[2] - WORLD.net.top_at(near[0]) - WORLD.build.radius_m
        assert clearance == pytest.approx(want, abs=2e-3)
    else:
        assert clearance == math.inf or abs(near[0]) < 6.41


def test_a_ball_that_does_not_cross_the_net_has_infinite_clearance():
    short = launched(10.0, 0.0, math.pi / 2, 0.0, 0.0)
    assert net_clearance(np.array([0.0, -12.0, 1.0]), short, WORLD) == math.inf
    wide = launched(40.0, 0.2, math.pi / 2, 0.0, 0.0)
    assert net_clearance(np.array([7.0, -12.0, 1.0]), wide, WORLD) == math.inf
    assert net_clearance(np.array([0.0, -12.0, 1.0]), wide, replace(WORLD, net=None)) == math.inf
    assert 0 < net_clearance(np.array([0.0, -12.0, 1.0]), wide, WORLD) < 5


def test_both_directions_of_play_are_alike():
    """A half turn about the vertical."""
    start, target = np.array([1.0, -11.0, 0.8]), np.array([-2.0, 10.0])
    turn = np.array([-1.0, -1.0, 1.0])
    one = aim(start, target, 30.0, 200.0, 70.0, WORLD)
    two = aim(turn * start, -target, 30.0, 200.0, 70.0, WORLD)
    assert one is not None and two is not None
    np.testing.assert_allclose(two.velocity, turn * one.velocity, atol=1e-6)
    np.testing.assert_allclose(two.spin, turn * one.spin, atol=1e-6)
    assert net_clearance(start, one, WORLD) == pytest.approx(net_clearance(turn * start, two, WORLD), abs=1e-6)


@pytest.mark.parametrize(
    ("start", "target", "speed"),
    [((0, 0, 0.01), (0, 5), 20), ((0, 0, 1), (0, 0), 20), ((0, 0, 1), (0, 5), 0), ((math.nan, 0, 1), (0, 5), 20)],
)
def test_impossible_aims_are_refused(start, target, speed):
    with pytest.raises(ValueError, match="aim"):
        aim(np.array(start, dtype=float), np.array(target, dtype=float), float(speed), 0.0, 0.0, WORLD)


def test_a_ball_that_backspin_would_carry_over_its_target_has_no_low_way():
    """58 m/s under 2700 rpm from 12 cm: what does not touch the ground at once flies on past 20 m."""
    start, target = np.array([0.0, -11.0, 0.125]), np.array([0.0, 5.0])
    assert aim(start, target, 58.0, -2700 * RPM, 0.0, WORLD) is None
    reaches = [landing(start, launched(58.0, e, math.pi / 2, -2700 * RPM, 0.0))[1] for e in np.linspace(-0.1, 0.1, 201)]
    assert not any(3.0 < y < 7.0 for y in reaches)
