import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.lift.ball.drag_line import distance_at
from pgm_data.lift.ball.line_path import Ends, at, landings, paths_between
from pgm_data.lift.ball.line_times import meetings

LIFT = 0.0368


def ends_of(start, stop, span, drag, lift=0.0, topspin=0.0, sidespin=0.0) -> Ends:
    return Ends(
        start=np.asarray(start, dtype=float)[None],
        stop=np.asarray(stop, dtype=float)[None],
        start_time=np.array([0.3]),
        stop_time=np.array([0.3 + span]),
        drag=np.array([drag]),
        lift=np.array([lift]),
        topspin=np.array([topspin]),
        sidespin=np.array([sidespin]),
    )


def flown(start, velocity, span, drag, lift, topspin, sidespin, steps=1500):
    """The slow reference: drag -C |v| v, lift along spin x v of size lift v^2 S / (1 + 2 S), gravity; midpoint rule.

    The spin turns with the flight's direction along the ground, as topspin and sidespin are about axes across it.
    """
    surface = np.hypot(topspin, sidespin)

    def pull(v):
        speed = np.linalg.norm(v)
        ground = np.hypot(v[0], v[1])
        across = np.array([-v[1], v[0], 0.0]) / max(ground, 1e-12)
        axis = topspin * across + sidespin * np.array([0, 0, 1.0])
        size = lift * speed / (speed + 2 * surface)
        return -drag * speed * v + size * np.cross(axis, v) - [0, 0, 9.81]

    x, v, h = np.array(start, dtype=float), np.array(velocity, dtype=float), span / steps
    way, speeds = [x], [v]
    for _ in range(steps):
        middle = v + 0.5 * h * pull(v)
        x, v = x + h * middle, v + h * pull(middle)
        way.append(x)
        speeds.append(v)
    return np.array(way), np.array(speeds)


@pytest.mark.parametrize(
    ("velocity", "span", "topspin", "sidespin", "tolerance"),
    [
        ((3.0, 53.0, -4.0), 0.45, 4.0, 1.0, 0.004),
        ((-4.0, 30.0, 3.5), 1.0, 9.0, 1.0, 0.02),
        ((2.0, -21.0, 4.0), 1.1, -6.0, 0.5, 0.02),
        ((1.0, 12.0, 17.0), 3.2, 2.0, 0.0, 0.06),
        ((0.2, 0.1, 5.0), 0.9, 0.0, 0.0, 0.002),
        ((0.0, 0.0, 6.0), 1.0, 0.0, 0.0, 0.002),
    ],
)
def test_a_flight_between_its_ends_is_the_one_that_gravity_drag_and_lift_make(
    velocity, span, topspin, sidespin, tolerance
):
    way, speeds = flown((0.0, -11.0, 1.5), velocity, span, 0.0203, LIFT, topspin, sidespin)
    ends = ends_of(way[0], way[-1], span, 0.0203, LIFT, topspin, sidespin)
    rows = np.arange(0, len(way), 50)
    position, rates = at(paths_between(ends, 3), (0.3 + span * rows / (len(way) - 1))[None])
    assert np.linalg.norm(position[0] - way[rows], axis=1).max() < tolerance
    assert np.linalg.norm(rates[0] - speeds[rows], axis=1).max() < 20 * tolerance
    np.testing.assert_allclose(position[0][[0, -1]], way[[0, -1]], atol=1e-9)


@given(st.floats(0.05, 6.0), st.floats(0.0, 0.3), st.floats(0.0, 30.0), st.floats(-1.0, 1.0))
@settings(max_examples=50)
def test_without_a_pass_the_ground_is_covered_as_the_papers_equation_has_it(span, drag, length, climb):
    ends = ends_of((1.0, 2.0, 1.5), (1.0, 2.0 + length, 1.5 + climb), span, drag)
    knots = paths_between(ends, 0)
    times = np.linspace(0, span, knots.positions.shape[1])
    np.testing.assert_allclose(knots.positions[0, :, 1] - 2.0, distance_at(times, length, span, drag), atol=1e-9)


@given(st.floats(1e-4, 40.0), st.floats(0.0, 3.0), st.floats(-40.0, 40.0), st.floats(0.0, 40.0))
@settings(max_examples=80)
def test_every_flight_is_finite_and_meets_its_ends(span, drag, x, y):
    stop = np.array([x, y, 0.5])
    paths = paths_between(ends_of((0.0, 0.0, 1.0), stop, span, drag, LIFT, 5.0, -3.0), 2)
    assert np.isfinite(paths.positions).all() and np.isfinite(paths.velocities).all()
    np.testing.assert_allclose(paths.positions[0, -1], stop, atol=1e-6)


def test_a_flight_flown_on_lands_where_the_reference_does():
    start, velocity = np.array([0.0, -11.0, 1.0]), np.array([2.0, 27.0, 6.0])
    way, _ = flown(start, velocity, 2.5, 0.0203, LIFT, 6.0, 1.0)
    down = int(np.flatnonzero(way[:, 2] < 0.0335)[0])
    ends = ends_of(start, start + 1.0, 1.0, 0.0203, LIFT, 6.0, 1.0)
    landed = landings(start[None], velocity[None], ends, 0.0335)[0]
    assert np.linalg.norm(landed - way[down]) < 0.03
    assert np.isnan(landings(start[None] - [0, 0, 2.0], velocity[None], ends, 0.0335)).all()


def test_two_ways_meet_to_a_tenth_of_a_frame():
    rng = np.random.default_rng(0)
    off = []
    for _ in range(40):
        times = np.arange(24) / 25
        contact = rng.uniform(0.4, 0.5)
        since = times - contact
        way = np.where(since < 0, 420 * since + 260 * since**2, -300 * since + 350 * since**2)
        pixels = np.stack([900 + 90 * since, 500 + way], axis=-1) + rng.normal(size=(24, 2))
        met = meetings(np.array([contact + 0.02]), np.array([0.02]), times, pixels, np.ones(24))
        off.append(met.times[0] - contact)
        assert np.linalg.norm(met.pixels[0] - [900, 500]) < 6
    assert np.std(off) < 0.004 and abs(np.mean(off)) < 0.002


def test_where_no_pixel_is_near_there_is_no_meeting():
    times = np.arange(5) / 25
    met = meetings(np.array([3.0]), np.array([0.02]), times, np.ones((5, 2)), np.ones(5))
    assert met.times[0] == 3.0 and np.isnan(met.pixels).all()
    assert np.isnan(meetings(np.array([3.0]), np.array([0.02]), np.zeros(0), np.ones((0, 2)), np.zeros(0)).pixels).all()
