import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.flight.aim import aim
from pgm_data.simulate.flight.air import Air, ball_build
from pgm_data.simulate.flight.contact import SURFACES, SurfaceName, net_shape
from pgm_data.simulate.flight.course import FlightWorld, follow, truncated
from pgm_data.simulate.flight.integrate import fly
from pgm_data.simulate.flight.laws import bounce_height_ratios, energies, energy_gains, speed_losses
from pgm_data.simulate.flight.path import BallPath, Contact, Flight

SCENE = load_scene("tennis")
assert SCENE.ball is not None and SCENE.court is not None
BALL = ball_build(SCENE.ball)
WORLD = FlightWorld(
    air=Air(),
    build=BALL,
    surface=SURFACES["hard"],
    net=net_shape(SCENE.court.net_world, SCENE.court.tape_width),
)
R = BALL.radius_m
RPM = 2 * math.pi / 60
STILL = np.zeros(3)

places = st.tuples(st.floats(-11.0, 11.0), st.floats(-20.0, 20.0), st.floats(R, 4.0)).map(np.array)
components = st.floats(-50.0, 50.0)
velocities = st.tuples(components, components, st.floats(-40.0, 40.0)).map(np.array)
turns = st.floats(-630.0, 630.0)
spins = st.tuples(turns, turns, turns).map(np.array)
winds = st.one_of(
    st.just(np.zeros(3)),
    st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-5.0, 5.0)).map(np.array),
)


def path_of(position: np.ndarray, flights: list[Flight], contacts: list[Contact]) -> BallPath:
    hit = Contact(time=float(flights[0].times[0]), kind="hit", player=0, position=position)
    return BallPath(flights=tuple(flights), contacts=(hit, *contacts))


@settings(max_examples=150)
@given(
    position=places,
    velocity=velocities,
    spin=spins,
    wind=winds,
    surface=st.sampled_from(list(SURFACES.values())),
    seed=st.integers(0, 1000),
)
def test_every_ball_comes_to_an_end_on_a_path_without_gaps(position, velocity, spin, wind, surface, seed):
    world = replace(WORLD, air=Air(wind=wind), surface=surface)
    flights, contacts = follow(position, velocity, spin, 3.0, world, until=15.0, rng=np.random.default_rng(seed))
    path = path_of(position, flights, contacts)
    assert len(flights) < 400
    for i, flight in enumerate(flights):
        ends = (path.contacts[i], path.contacts[i + 1])
        for k, contact in zip((0, -1), ends, strict=True):
            assert flight.times[k] == contact.time
            np.testing.assert_allclose(flight.positions[k], contact.position, atol=1e-9)
        assert flight.positions[:, 2].min() >= R - 1e-9
        if flight.rolls and flight.positions[0, 2] < R + 1e-6:
            np.testing.assert_allclose(flight.positions[:, 2], R, atol=1e-12)
            assert flight.drag_per_m == 0
    kinds = [c.kind for c in contacts]
    assert kinds[-1] == "last" and set(kinds[:-1]) <= {"bounce", "net"} and all(c.player == -1 for c in contacts)
    assert all(abs(c.position[2] - R) < 1e-9 for c in contacts if c.kind == "bounce")
    end = contacts[-1]
    gone = abs(abs(end.position[0]) - 12.0) < 1e-6 or abs(abs(end.position[1]) - 21.0) < 1e-6
    assert gone or end.time == 15.0


@settings(max_examples=100)
@given(position=places, velocity=velocities, spin=spins, seed=st.integers(0, 1000))
def test_energy_never_rises_along_a_course_in_still_air(position, velocity, spin, seed):
    flights, contacts = follow(position, velocity, spin, 0.0, WORLD, until=15.0, rng=np.random.default_rng(seed))
    assert energy_gains(path_of(position, flights, contacts), BALL, 9.81).max() < 1e-9
    level = np.inf
    for flight in flights:
        energy = energies(flight, BALL, 9.81)
        assert energy[0] <= level * (1 + 1e-9)
        level = energy[-1]


@settings(max_examples=100)
@given(
    x=st.floats(-6.0, 6.0),
    height=st.floats(R, 2.5),
    speed=st.floats(1.0, 60.0),
    rise=st.floats(-20.0, 3.0),
    seed=st.integers(0, 1000),
)
def test_a_ball_changes_sides_only_over_the_net(x, height, speed, rise, seed):
    """At every crossing of y = 0 within the posts its centre is no lower than the axis of the rounded top."""
    start = np.array([x, -1.5, height])
    rng = np.random.default_rng(seed)
    flights, contacts = follow(start, np.array([0.0, speed, rise]), STILL, 0.0, WORLD, until=8.0, rng=rng)
    assert WORLD.net is not None
    for flight in flights:
        y = flight.positions[:, 1]
        for i in np.flatnonzero((y[:-1] < 0) != (y[1:] < 0)):
            crossing = np.linspace(flight.times[i], flight.times[i + 1], 200)
            p = flight.at(crossing)[0]
            near = p[np.argmin(np.abs(p[:, 1]))]
            assert near[2] > WORLD.net.top_at(near[0]) - WORLD.net.tape_radius_m - 0.002


@pytest.mark.parametrize("luck", range(5))
def test_a_ball_into_the_middle_of_the_net_falls_down_before_it(luck):
    start = np.array([0.5, -6.0, 0.7])
    rng = np.random.default_rng(luck)
    flights, contacts = follow(start, np.array([1.0, 40.0, 0.0]), STILL, 0.0, WORLD, until=10.0, rng=rng)
    assert contacts[0].kind == "net" and contacts[1].kind == "bounce"
    after = np.concatenate([f.positions for f in flights])
    assert (after[:, 1] < 0).all() and -2.0 < contacts[1].position[1] and flights[-1].positions[-1, 1] > -5.0


def test_some_cords_go_over_and_some_fall_back():
    ends = []
    for height in np.linspace(0.90, 0.97, 15):
        start = np.array([0.0, -0.5, height])
        flights, contacts = follow(start, np.array([0.0, 30.0, 0.2]), STILL, 0.0, WORLD, until=0.6)
        ends.append((contacts[0].kind, bool(flights[-1].positions[-1, 1] > 0)))
    assert ("net", True) in ends and ("net", False) in ends and ends[-1] == ("bounce", True)


@pytest.mark.parametrize(("y", "side"), [(0.0, 1), (1e-3, 1), (-1e-3, -1), (-0.01, -1)])
def test_a_ball_that_lands_on_the_tape_slides_off_to_its_side(y, side):
    start = np.array([0.5, y, 1.1])
    flights, contacts = follow(start, np.array([0.5, 0.0, 0.0]), STILL, 0.0, WORLD, until=20.0)
    assert contacts[0].kind == "net" and contacts[-1].time == 20.0
    assert side * flights[-1].positions[-1, 1] > R
    assert (side * np.concatenate([f.positions[:, 1] for f in flights]) >= 0).all()


def test_a_storm_holds_a_ball_in_the_net_until_it_has_slid_down():
    world = replace(WORLD, air=Air(wind=np.array([0.0, 40.0, 0.0])))
    flights, contacts = follow(np.array([1.0, -2.0, 0.6]), np.array([0.0, 10.0, 0.0]), STILL, 0.0, world, until=20.0)
    assert contacts[-1].time == 20.0
    assert flights[-1].rolls and abs(flights[-1].positions[-1, 1] + R + 0.006) < 0.01


@pytest.mark.parametrize("name", ["hard", "clay", "grass"])
def test_a_ball_dropped_from_254_cm_rebounds_to_the_itfs_135_to_147(name: SurfaceName):
    world = replace(WORLD, surface=SURFACES[name], net=None)
    start = np.array([0.0, 5.0, 2.54 + R])
    flights, contacts = follow(start, STILL, STILL, 0.0, world, until=30.0)
    path = path_of(start, flights, contacts)
    ratios = bounce_height_ratios(path, R)
    assert 0.53 < ratios[0] < 0.58
    rebound = path.at(np.arange(contacts[0].time, contacts[1].time, 1e-4))[0][:, 2].max() - R
    assert 1.35 < rebound < 1.47
    assert flights[-1].rolls and (flights[-1].velocities == 0).all() and contacts[-1].time == 30.0
    assert np.abs(flights[-1].positions[:, :2] - start[:2]).max() < 1e-12


@pytest.mark.parametrize(
    ("start", "target", "speed_kmh", "rpm"),
    [
        ((0.5, -11.6, 2.9), (-3.0, 5.5), 200.0, 800.0),
        ((0.5, -11.6, 2.9), (-0.5, 6.0), 200.0, 0.0),
        ((-2.0, -12.0, 1.0), (2.0, 9.0), 110.0, 2500.0),
        ((-2.0, -12.0, 1.0), (-3.0, 8.5), 110.0, 1500.0),
    ],
)
def test_serves_and_forehands_lose_25_to_35_per_cent_of_their_speed_to_the_bounce(start, target, speed_kmh, rpm):
    start = np.array(start)
    launch = aim(start, np.array(target), speed_kmh / 3.6, rpm * RPM, 0.0, WORLD)
    assert launch is not None
    flights, contacts = follow(start, launch.velocity, launch.spin, 0.0, WORLD, until=5.0)
    path = path_of(start, flights, contacts)
    assert path.contacts[1].kind == "bounce"
    assert 0.25 < speed_losses(path)[0] < 0.35


def test_a_ball_at_rest_on_the_ground_stays_there():
    start = np.array([1.0, 2.0, R])
    flights, contacts = follow(start, STILL, STILL, 0.0, WORLD, until=7.0)
    assert len(flights) == 1 and flights[0].rolls and contacts[-1].kind == "last"
    assert (flights[0].positions == start).all() and (flights[0].velocities == 0).all()
    assert (flights[0].spins == 0).all() and flights[0].times[-1] == 7.0


@pytest.mark.parametrize("rpm", [0.0, 6000.0])
def test_a_drop_from_a_hundred_metres_bounces_and_rests(rpm):
    start = np.array([0.0, 5.0, 100.0])
    flights, contacts = follow(start, STILL, np.array([0.0, 0.0, rpm * RPM]), 0.0, WORLD, until=60.0)
    assert 20 < np.linalg.norm(flights[0].velocities[-1]) < 24
    assert flights[-1].rolls and contacts[-1].time == 60.0


def test_a_rolling_ball_slows_evenly_without_slip_and_stops_for_good():
    start = np.array([0.0, 2.0, R])
    flights, _ = follow(start, np.array([0.3, 1.0, 0.0]), STILL, 0.0, WORLD, until=60.0)
    roll = flights[0]
    slip = roll.velocities + np.cross(roll.spins, [0.0, 0.0, -R])
    assert roll.rolls and np.abs(slip).max() < 1e-12
    speed, braking = np.linalg.norm(roll.velocities[0]), WORLD.surface.rolling * 9.81
    assert np.linalg.norm(roll.positions[-1] - start) == pytest.approx(speed**2 / (2 * braking))
    t = np.linspace(0.0, speed / braking, 50)
    position, _ = roll.at(t)
    np.testing.assert_allclose(np.linalg.norm(position - start, axis=1), speed * t - 0.5 * braking * t**2, atol=1e-12)
    still, velocity = roll.at(np.array([speed / braking + 1.0, 50.0]))
    np.testing.assert_allclose(still, np.tile(roll.positions[-1], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-12)


def test_a_rolling_ball_stops_at_the_net_and_leaves_through_the_bounds():
    flights, contacts = follow(np.array([0.0, -0.5, R]), np.array([0.0, 2.0, 0.0]), STILL, 0.0, WORLD, until=9.0)
    assert [c.kind for c in contacts] == ["net", "last"] and contacts[-1].time == 9.0
    assert flights[-1].positions[-1, 1] == pytest.approx(-R - 0.006) and (flights[-1].velocities == 0).all()
    _, contacts = follow(np.array([0.0, -19.0, R]), np.array([0.0, -9.0, 0.0]), STILL, 0.0, WORLD, until=9.0)
    assert [c.kind for c in contacts] == ["last"] and contacts[0].position[1] == pytest.approx(-21.0)


@given(velocity=velocities, spin=spins, share=st.floats(0.001, 1.0))
def test_a_course_cut_at_a_time_reads_as_before_up_to_it(velocity, spin, share):
    start = np.array([0.0, -8.0, 1.0])
    flights, contacts = follow(start, velocity, spin, 2.0, WORLD, until=6.0)
    time = 2.0 + share * (contacts[-1].time - 2.0)
    part, before = truncated(flights, contacts, time)
    assert part[-1].times[-1] == time and len(before) == len(part) - 1
    assert all(c.time < time for c in before)
    hit = Contact(time=time, kind="hit", player=1, position=part[-1].positions[-1])
    t = np.linspace(2.0, time, 60)[:-1]
    whole, cut_off = path_of(start, flights, contacts).at(t), path_of(start, part, [*before, hit]).at(t)
    for one, other in zip(whole, cut_off, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


def test_reading_a_course_equals_integrating_it_again_to_a_tenth_of_a_millimetre():
    start = np.array([0.0, -12.0, 1.0])
    launch = aim(start, np.array([2.0, 8.0]), 33.0, 3000 * RPM, 800 * RPM, WORLD)
    assert launch is not None
    flights, contacts = follow(start, launch.velocity, launch.spin, 0.0, WORLD, until=4.0)
    path = path_of(start, flights, contacts)
    rng = np.random.default_rng(2)
    for flight in flights:
        for t in rng.uniform(flight.times[0], flight.times[-1], 10):
            first = (flight.positions[0], flight.velocities[0], flight.spins[0])
            again = fly(*first, WORLD.air, BALL, time=float(flight.times[0]), until=float(t), floor_z=-1.0)
            assert np.abs(path.at(np.array([t]))[0] - again.positions[-1]).max() < 1e-6


def test_the_same_seed_gives_the_same_course():
    start = np.array([0.0, -0.5, 0.94])
    one, two = (
        follow(start, np.array([0.0, 30.0, 0.2]), STILL, 0.0, WORLD, until=3.0, rng=np.random.default_rng(5))
        for _ in range(2)
    )
    assert all((a.positions == b.positions).all() for a, b in zip(one[0], two[0], strict=True))


@pytest.mark.parametrize(
    ("position", "until", "match"),
    [((13.0, 0.0, 1.0), 1.0, "position"), ((0.0, 0.0, 0.0), 1.0, "position"), ((0.0, 1.0, 1.0), 0.0, "until")],
)
def test_impossible_starts_are_refused_by_their_field(position, until, match):
    with pytest.raises(ValueError, match=match):
        follow(np.array(position), STILL, STILL, 0.0, WORLD, until=until)


def test_a_cut_outside_of_the_course_is_refused():
    flights, contacts = follow(np.array([0.0, -8.0, 1.0]), STILL, STILL, 2.0, WORLD, until=6.0)
    for time in (2.0, 6.1):
        with pytest.raises(ValueError, match="truncated.time"):
            truncated(flights, contacts, time)


def test_a_peak_that_is_not_within_its_flight_has_no_ratio():
    start = np.array([0.0, -8.0, 1.0])
    flights, contacts = follow(start, np.array([0.0, 3.0, -1.0]), STILL, 0.0, WORLD, until=30.0)
    ratios = bounce_height_ratios(path_of(start, flights, contacts), R)
    assert math.isnan(ratios[0]) and (ratios[1:] > 0.5).all() and (ratios[1:] < 0.85).all()
    part, before = truncated(flights, contacts, float(contacts[0].time) + 0.02)
    hit = Contact(time=part[-1].times[-1], kind="hit", player=1, position=part[-1].positions[-1])
    assert np.isnan(bounce_height_ratios(path_of(start, part, [*before, hit]), R)).all()


def test_a_volley_has_no_speed_loss_to_a_bounce():
    start = np.array([0.0, -8.0, 1.0])
    flights, contacts = follow(start, np.array([0.0, 20.0, 1.0]), STILL, 0.0, WORLD, until=9.0)
    part, before = truncated(flights, contacts, 0.3)
    hit = Contact(time=0.3, kind="hit", player=1, position=part[-1].positions[-1])
    assert np.isnan(speed_losses(path_of(start, part, [*before, hit]))).all()
