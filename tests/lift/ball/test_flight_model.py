import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from pgm_data.geometry.camera import project
from pgm_data.lift.ball.flight_model import (
    AirLaw,
    acceleration,
    bounce_function,
    flow_function,
    flown,
    mark_function,
    rebound,
    sighting_function,
    steps_for,
)
from pgm_data.lift.ball.rally_plays import camera_numbers
from pgm_data.lift.ball.world import GRAVITY, INERTIA
from tests.lift.ball.flown_worlds import looking

LAW = AirLaw(radius_m=0.0335, lift_per_m=0.0368)
NO_LIFT = AirLaw(radius_m=0.0335, lift_per_m=0.0)
coordinate = st.floats(-40, 40)
three = st.tuples(coordinate, coordinate, coordinate).map(np.array)


@given(three, three, st.floats(0, 0.3), st.floats(-0.05, 0.05))
def test_casadi_and_arrays_fly_alike(velocity, spin, drag, duration):
    state = np.concatenate([[0.3, -2.0, 1.5], velocity])
    ours = flown(state, 10 * spin, np.array(drag), np.array(duration), LAW, 2)
    theirs, _ = flow_function(LAW, 2)(state, 10 * spin, drag, duration)
    # CasADi's square roots are rounded off at zero speed and spin.
    assert np.allclose(ours, np.array(theirs).ravel(), atol=2e-4)


def test_without_air_a_flight_is_a_parabola_of_any_length():
    state = np.array([1.0, 2.0, 3.0, 4.0, -5.0, 6.0])
    for t in (-0.3, 0.0, 1e-9, 2.0):
        end = flown(state, np.array([50.0, 20.0, 10.0]), np.array(0.0), np.array(t), NO_LIFT)
        fall = np.array([0, 0, GRAVITY])
        assert np.allclose(end[:3], state[:3] + state[3:] * t - fall * t**2 / 2, atol=1e-12)
        assert np.allclose(end[3:], state[3:] - fall * t, atol=1e-12)


@pytest.mark.parametrize(("law", "drag", "speed"), [(LAW, 0.0203, 60.0), (NO_LIFT, 0.212, 80.0)])
def test_steps_of_a_flight_agree_with_a_fine_integrator(law, drag, speed):
    state = np.array([0.0, 0.0, 2.5, 3.0, speed, 2.0])
    spin = np.array([-250.0, 30.0, 60.0])
    steps = steps_for(0.04, drag, speed)

    def slope(_, x):
        return np.concatenate([x[3:], acceleration(x[3:], spin, np.array(drag), law)])

    fine = solve_ivp(slope, (0, 0.6), state, rtol=1e-10, atol=1e-10).y[:, -1]
    now = state
    for _ in range(15):
        now = flown(now, spin, np.array(drag), np.array(0.04), law, steps)
    assert np.abs(now - fine)[:3].max() < 1e-3


def test_steps_grow_with_the_interval_and_with_the_drag():
    assert steps_for(0.04, 0.02, 50) == 1
    assert steps_for(0.1, 0.02, 50) == 4
    assert steps_for(0.04, 0.212, 90) == 4


def test_a_flight_back_in_time_undoes_one_forward():
    state = np.array([0.0, 0.0, 1.0, 5.0, 30.0, 4.0])
    spin, drag, t = np.array([-200.0, 0.0, 40.0]), np.array(0.02), np.array(0.04)
    there = flown(state, spin, drag, t, LAW)
    assert np.allclose(flown(there, spin, drag, np.array(-0.04), LAW), state, atol=1e-5)


def test_topspin_pulls_down_and_backspin_holds_up():
    velocity = np.array([0.0, 30.0, 0.0])
    plain = acceleration(velocity, np.zeros(3), np.array(0.02), LAW)
    topspin = acceleration(velocity, np.array([-200.0, 0.0, 0.0]), np.array(0.02), LAW)
    assert topspin[2] < plain[2] - 1
    assert acceleration(velocity, np.array([200.0, 0.0, 0.0]), np.array(0.02), LAW)[2] > plain[2] + 1
    # S / (1 + 2 S) with S = radius spin / speed.
    S = 0.0335 * 200 / 30
    assert np.isclose(plain[2] - topspin[2], LAW.lift_per_m * 30**2 * S / (1 + 2 * S))


def test_derivatives_of_the_flow_are_those_of_differences():
    f = flow_function(LAW, 1)
    at = np.array([0.1, 0.2, 1.0, 4.0, 33.0, -3.0, -180.0, 20.0, 30.0, 0.02, 0.03])

    def end(v):
        return np.array(f(v[:6], v[6:9], v[9], v[10])[0]).ravel()

    J = np.array(f(at[:6], at[6:9], at[9], at[10])[1])
    for i in range(11):
        step = 1e-5 * max(abs(at[i]), 1.0) * np.eye(11)[i]
        assert np.allclose((end(at + step) - end(at - step)) / (2 * step[i]), J[:, i], rtol=1e-5, atol=1e-6)


@given(three, three, st.floats(0.3, 0.95), st.floats(0.05, 1.2))
def test_no_bounce_gains_energy(velocity, spin, e, mu):
    velocity = velocity * np.array([1, 1, 0.3])
    after, turned = rebound(velocity, 5 * spin, np.array(e), np.array(mu), 0.0335)

    def energy(v, w):
        return (v**2).sum() + INERTIA * 0.0335**2 * (w**2).sum()

    assert energy(after, turned) <= energy(velocity, 5 * spin) + 1e-9


def test_a_bounce_slides_on_ice_and_grips_on_glue():
    velocity, spin = np.array([3.0, 25.0, -6.0]), np.array([-50.0, 10.0, 0.0])
    ice, _ = rebound(velocity, spin, np.array(0.75), np.array(0.05), 0.0335)
    lost = np.linalg.norm(velocity[:2] - ice[:2])
    assert np.isclose(lost, 0.05 * 1.75 * 6.0, rtol=1e-3)
    glue, turned = rebound(velocity, spin, np.array(0.75), np.array(50.0), 0.0335)
    slip = glue[:2] + 0.0335 * np.array([-turned[1], turned[0]])
    assert np.abs(slip).max() < 0.02
    assert np.isclose(glue[2], 0.75 * 6.0)


def test_a_ball_that_rolls_already_loses_nothing_along_the_ground():
    velocity = np.array([0.0, 10.0, -3.0])
    spin = np.array([-10.0 / 0.0335, 0.0, 0.0])
    after, turned = rebound(velocity, spin, np.array(0.8), np.array(0.6), 0.0335)
    assert np.allclose(after[:2], velocity[:2], atol=1e-6)
    assert np.allclose(turned, spin, atol=1e-3)


def test_a_bounce_by_the_law_costs_nothing_and_any_other_does():
    f = bounce_function(0.0335)
    before, spin = np.array([2.0, 28.0, -7.0]), np.array([-150.0, 5.0, 20.0])
    after, turned = rebound(before, spin, np.array(0.77), np.array(0.6), 0.0335)
    std = np.array([0.3, 0.5, 40.0])
    assert float(f(before, after, spin, turned, 0.77, 0.6, std)[0]) < 1e-4
    assert float(f(before, after + [0, 0, 0.6], spin, turned, 0.77, 0.6, std)[0]) == pytest.approx(2.0, rel=1e-2)
    # A ball that kept more of its speed along the ground was also turned less.
    kept = after + np.array([0.0, 1.0, 0.0])
    less = turned + np.array([1.0, 0.0, 0.0]) / (INERTIA * 0.0335)
    assert float(f(before, kept, spin, less, 0.77, 0.6, std)[0]) == pytest.approx(2.0, rel=1e-2)


def test_a_bounce_takes_any_speed():
    f = bounce_function(0.0335)
    for before in (np.zeros(3), np.array([0.0, 0.0, -1e3]), np.array([90.0, 90.0, -1e-9])):
        values = f(before, np.zeros(3), np.zeros(3), np.zeros(3), 0.7, 0.5, np.ones(3))
        assert all(np.isfinite(np.array(v)).all() for v in values)


def test_a_ball_is_seen_where_the_camera_projects_it():
    camera = looking(
        np.array([1.0, -35.0, 10.0]), np.array([0.0, 2.0, 0.0]), 2600.0, 1, lens=(0.08, -0.02, 0.001, -0.002)
    )
    numbers = camera_numbers(camera)[0]
    for point in (np.array([3.0, 8.0, 1.0]), np.array([-4.0, -11.0, 2.5])):
        pixel = project(camera[0], point[None])[0][0]
        cost, gradient, _ = sighting_function()(point, numbers, pixel, 1.0, 3.0)
        assert float(cost) < 1e-12
        assert np.abs(np.array(gradient)).max() < 1e-4
        below = project(camera[0], (point * [1, 1, 0])[None])[0][0]
        assert float(mark_function()(point[:2], numbers, below, 1.0, 3.0)[0]) < 1e-12


def test_far_pixels_pull_no_harder_than_near_ones_and_points_behind_the_camera_are_finite():
    camera = looking(np.array([0.0, -35.0, 10.0]), np.array([0.0, 0.0, 0.0]), 2600.0, 1)
    numbers, point = camera_numbers(camera)[0], np.array([1.0, 2.0, 1.0])
    pixel = project(camera[0], point[None])[0][0]
    pull = [
        np.linalg.norm(np.array(sighting_function()(point, numbers, pixel + [off, 0], 1.0, 3.0)[1]))
        for off in (1.0, 30.0, 3000.0)
    ]
    assert pull[0] < pull[1] < pull[2] < 1.02 * pull[1]
    behind = sighting_function()(np.array([0.0, -80.0, 5.0]), numbers, pixel, 1.0, 3.0)
    assert all(np.isfinite(np.array(v)).all() for v in behind)
    assert isinstance(behind[0], ca.DM)
