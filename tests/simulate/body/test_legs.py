"""Legs that follow plans: feet that stay, soles on the ground, joints within limits, times that do not matter."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.simulate.body import laws
from pgm_data.simulate.body.figure import BodyTrack, draw_figure, smpl24, world_from_joints
from pgm_data.simulate.body.legs import HipDemand, LowerBody, lower_body, no_demand
from pgm_data.simulate.tennis.play import Plan

FIGURE = draw_figure(np.random.default_rng(4), "right")
NAMES = smpl24().joint_names
LEGS = [NAMES.index(side + part) for side in ("L_", "R_") for part in ("Hip", "Knee", "Ankle", "Toe")]


def plan_of(velocity, heading, duration: float, splits=()) -> Plan:
    """A plan from functions of time."""
    times = np.arange(round(duration * 50) + 1) / 50
    v = np.array([velocity(t) for t in times], dtype=float)
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(0.01 * (v[1:] + v[:-1]), axis=0)])
    return Plan(
        times=times,
        path=path,
        heading=np.array([heading(t) for t in times], dtype=float),
        splits=np.array(splits, dtype=float),
    )


def trapezoid(t: float, start: float, end: float, top: float, rate: float) -> float:
    return float(np.sign(top) * max(0.0, min(rate * (t - start), abs(top), rate * (end - t))))


PLANS = {
    "stand": plan_of(lambda t: (0, 0), lambda t: 0.4, 2.0),
    "walk": plan_of(lambda t: (0, trapezoid(t, 0.5, 4, 1.4, 1.5)), lambda t: 0, 4.5),
    "sprint and brake": plan_of(lambda t: (0, trapezoid(t, 0.4, 3.6, 6, 5)), lambda t: 0, 4.0),
    "shuffle": plan_of(
        lambda t: (trapezoid(t, 0.5, 2, 2, 4) - trapezoid(t, 2.3, 4, 2, 4), 0), lambda t: 0, 4.5, [0.45, 2.25]
    ),
    "side run": plan_of(lambda t: (trapezoid(t, 0.5, 2.6, 4.5, 5), 0), lambda t: 0, 3.0, [0.45]),
    "backpedal": plan_of(lambda t: (0, trapezoid(t, 0.5, 3, -2.4, 3)), lambda t: 0, 3.5),
    "zigzag": plan_of(lambda t: (2.2 * np.sin(2.86 * t), 0.8 * np.sin(t)), lambda t: 0, 5.0),
    "turn on the spot": plan_of(lambda t: (0, 0), lambda t: float(np.clip(1.5 * (t - 0.5), 0, np.pi)), 3.5),
    "run and split": plan_of(lambda t: (0, trapezoid(t, 0, 1.5, 2.5, 3)), lambda t: 0, 3.0, [1.3, 2.2]),
}


def leap_and_turn(times) -> HipDemand:
    """A serve-like demand: turned away, down, up and off the ground from 1.6 to 2.0 s."""
    u = np.clip((times - 1.8) / 0.2, -1.0, 1.0)
    bump = np.exp(-(((times - 1.4) / 0.3) ** 2))
    return HipDemand(
        turn=-0.9 * bump, drop=0.15 * bump, lean_forward=0.1 * bump, lean_left=-0.15 * bump, hop=0.25 * (1 - u * u) ** 2
    )


def track_of(body: LowerBody) -> BodyTrack:
    rotations = body.leg_rotations.copy()
    rotations[:, 0] = body.root_rotation
    return BodyTrack(root_position=body.root_position, rotations=rotations, contact=body.contact)


def joints_of(body: LowerBody, figure=FIGURE) -> np.ndarray:
    track = track_of(body)
    return world_from_joints(figure, track.root_position, track.rotations)[1]


def every(plan: Plan, step: float) -> np.ndarray:
    return np.arange(0.0, plan.times[-1] + 1e-9, step)


def check_laws(plan: Plan, demand=no_demand, figure=FIGURE) -> LowerBody:
    """Every law of a body on one plan, 100 times a second."""
    times = every(plan, 0.01)
    body = lower_body(figure, plan, demand, times)
    track, scale = track_of(body), figure.height_m / 1.8
    assert laws.foot_slides(figure, track).max(initial=0.0) < 1e-6
    assert laws.ground_penetration(figure, track).max() < 0.01
    assert laws.joint_violations(track)[:, LEGS].max() < 0.02
    joints = joints_of(body, figure)
    for foot, toe in enumerate(("L_Toe", "R_Toe")):
        sole = joints[:, NAMES.index(toe), 2] - 0.01 * scale
        np.testing.assert_allclose(sole[body.contact[:, foot]], 0.0, atol=1e-6)
    path = np.stack([np.interp(times, plan.times, plan.path[:, i]) for i in (0, 1)], axis=-1)
    assert np.linalg.norm(body.root_position[:, :2] - path, axis=-1).max() < 0.03
    speed = np.linalg.norm(np.diff(joints[:, [0, *LEGS]], axis=0), axis=-1) / 0.01
    assert speed.max() < max(12.0, 2.2 * body.speed.max())
    lift = np.diff(body.root_position[:, 2], 2) / 0.01**2
    assert np.abs(lift).max() < 80.0
    return body


@pytest.mark.parametrize("name", sorted(PLANS))
def test_feet_stay_on_the_ground_and_joints_within_limits(name):
    check_laws(PLANS[name])


@pytest.mark.parametrize("name", ["stand", "walk", "zigzag"])
def test_the_laws_hold_under_a_stroke_that_turns_and_jumps(name):
    body = check_laws(PLANS[name], leap_and_turn)
    times = every(PLANS[name], 0.01)
    assert not body.contact[(times > 1.62) & (times < 1.98)].any()


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_smooth_plans_keep_the_laws(seed):
    rng = np.random.default_rng(seed)
    phases, rates = rng.uniform(0, 6.28, 3), rng.uniform(0.5, 1.5, 3)
    top = rng.uniform(0.2, 3.0, 2)
    plan = plan_of(
        lambda t: (top[0] * np.sin(rates[0] * t + phases[0]), top[1] * np.sin(rates[1] * t + phases[1])),
        lambda t: np.sin(rates[2] * t + phases[2]),
        3.0,
        rng.uniform(0.5, 2.8, int(rng.integers(3))),
    )
    check_laws(plan, figure=draw_figure(rng, "left"))


@pytest.mark.parametrize("name", ["shuffle", "sprint and brake", "run and split"])
def test_a_body_at_one_time_does_not_depend_on_the_other_times(name):
    plan = PLANS[name]
    rough, fine = every(plan, 0.04), every(plan, 0.01)
    some, all_ = lower_body(FIGURE, plan, no_demand, rough), lower_body(FIGURE, plan, no_demand, fine)
    alone = lower_body(FIGURE, plan, no_demand, rough[17:18])
    for field in ("root_position", "root_rotation", "leg_rotations", "contact", "stride_phase", "speed"):
        np.testing.assert_allclose(getattr(some, field), getattr(all_, field)[::4], atol=1e-9)
        np.testing.assert_allclose(getattr(alone, field), getattr(some, field)[17:18], atol=1e-9)


def test_no_times_give_an_empty_body_and_times_beyond_the_plan_its_ends():
    body = lower_body(FIGURE, PLANS["walk"], no_demand, np.zeros(0))
    assert body.root_position.shape == (0, 3)
    assert body.leg_rotations.shape == (0, 24, 3, 3)
    end = PLANS["walk"].times[-1]
    late = lower_body(FIGURE, PLANS["walk"], no_demand, np.array([-5.0, 0.0, end, end + 30.0]))
    np.testing.assert_allclose(late.root_position[0, :2], late.root_position[1, :2], atol=0.03)
    np.testing.assert_allclose(late.root_position[2, :2], late.root_position[3, :2], atol=0.03)
    assert late.contact[[0, 3]].all()


@pytest.mark.parametrize("knots", [1, 2, 3])
def test_a_plan_of_a_few_knots_stands(knots):
    plan = Plan(
        times=np.arange(knots) / 50, path=np.tile([3.0, -11.0], (knots, 1)), heading=np.zeros(knots), splits=np.zeros(0)
    )
    body = lower_body(FIGURE, plan, no_demand, np.array([0.0, 0.01]))
    assert body.contact.all()
    np.testing.assert_allclose(body.root_position[:, :2], [[3.0, -11.0]] * 2, atol=0.03)


def test_who_stands_does_not_step_and_keeps_the_feet_apart_with_bent_knees():
    body = lower_body(FIGURE, PLANS["stand"], no_demand, every(PLANS["stand"], 0.02))
    assert body.contact.all()
    joints = joints_of(body)
    apart = np.linalg.norm(joints[:, NAMES.index("L_Toe")] - joints[:, NAMES.index("R_Toe")], axis=-1)
    assert ((apart > 0.45) & (apart < 0.75)).all()
    assert (body.root_position[:, 2] < FIGURE.translations[0, 1] - 0.02).all()


def test_a_run_has_flights_and_a_walk_always_a_foot_on_the_ground():
    times = np.arange(1.8, 2.8, 0.005)
    running = lower_body(FIGURE, PLANS["sprint and brake"], no_demand, times)
    walking = lower_body(FIGURE, PLANS["walk"], no_demand, times)
    assert 0.15 < (~running.contact.any(axis=1)).mean() < 0.7
    assert walking.contact.any(axis=1).all()
    assert walking.contact.all(axis=1).any()


def test_feet_do_not_cross_in_a_shuffle():
    times = every(PLANS["shuffle"], 0.01)
    joints = joints_of(lower_body(FIGURE, PLANS["shuffle"], no_demand, times))
    # It looks along +y, so left is -x.
    assert (joints[:, NAMES.index("R_Toe"), 0] - joints[:, NAMES.index("L_Toe"), 0]).min() > 0.1


@pytest.mark.parametrize("split", [0.45, 2.25])
def test_a_split_step_leaves_the_ground_and_lands_wide_on_both_feet_at_its_time(split):
    plan = PLANS["shuffle"]
    before, after = split + np.array([-0.2, -0.1, -0.01]), split + np.array([0.001, 0.03])
    assert not lower_body(FIGURE, plan, no_demand, before).contact.any()
    landed = lower_body(FIGURE, plan, no_demand, after)
    assert landed.contact.all()
    joints = joints_of(landed)
    assert np.linalg.norm(joints[0, NAMES.index("L_Toe")] - joints[0, NAMES.index("R_Toe")]) > 0.6
    high = joints_of(lower_body(FIGURE, plan, no_demand, np.array([split - 0.12])))[0]
    for toe in ("L_Toe", "R_Toe"):
        assert 0.04 < high[NAMES.index(toe), 2] < 0.14


def test_a_hop_lifts_the_body_and_both_feet_by_its_height():
    times = np.array([1.0, 1.8])
    none = lower_body(FIGURE, PLANS["stand"], no_demand, times)
    hop = lower_body(FIGURE, PLANS["stand"], lambda t: replace(no_demand(t), hop=leap_and_turn(t).hop), times)
    assert hop.root_position[1, 2] - none.root_position[1, 2] == pytest.approx(0.25, abs=0.01)
    assert joints_of(hop)[1, [NAMES.index("L_Toe"), NAMES.index("R_Toe")], 2].min() > 0.2


def test_feet_travel_with_a_running_pelvis_that_hops_and_point_down():
    times = np.arange(0.8, 1.6, 0.01)
    plan = plan_of(lambda t: (0.0, 4.0 * t), lambda t: 0, 3.0)

    def leap(t):
        return replace(no_demand(t), hop=0.25 * np.maximum(1.0 - ((t - 1.2) / 0.23) ** 2, 0.0))

    body = lower_body(FIGURE, plan, leap, times)
    aloft = ~body.contact.any(axis=1) & (np.abs(times - 1.2) < 0.22)
    joints = joints_of(body)
    assert aloft.sum() > 40
    for side in ("L_", "R_"):
        ahead = (joints[:, NAMES.index(side + "Toe")] - body.root_position)[aloft, 1]
        assert ahead.min() > min(ahead[0], ahead[-1]) - 0.04
        assert joints[times.searchsorted(1.2), NAMES.index(side + "Ankle"), 2] > 0.37
    assert laws.ground_penetration(FIGURE, track_of(body)).max() < 0.01


def test_demands_turn_lower_and_lean_the_pelvis():
    times = np.array([1.4])
    plain = lower_body(FIGURE, PLANS["stand"], no_demand, times)
    for name, value in (("turn", 0.5), ("drop", 0.2), ("lean_forward", 0.3), ("lean_left", 0.2)):
        asked = lower_body(
            FIGURE, PLANS["stand"], lambda t, n=name, v=value: replace(no_demand(t), **{n: np.full(len(t), v)}), times
        )
        R = plain.root_rotation[0].T @ asked.root_rotation[0]
        if name == "drop":
            assert plain.root_position[0, 2] - asked.root_position[0, 2] == pytest.approx(0.2, abs=0.02)
        elif name == "turn":
            # Anticlockwise from above: forward goes to the body's left.
            assert np.arctan2(R[0, 2], R[2, 2]) == pytest.approx(value, abs=0.03)
        elif name == "lean_forward":
            assert np.arctan2(R[2, 1], R[1, 1]) == pytest.approx(value, abs=0.03)
        else:
            assert np.arctan2(R[0, 1], R[1, 1]) == pytest.approx(value, abs=0.03)


def test_turning_on_the_spot_takes_steps():
    body = lower_body(FIGURE, PLANS["turn on the spot"], no_demand, every(PLANS["turn on the spot"], 0.01))
    lifts = (body.contact[:-1] & ~body.contact[1:]).sum(axis=0)
    assert (lifts >= 2).all()
    assert body.contact.any(axis=1).all()


def test_the_stride_phase_rises_by_half_a_turn_a_step_and_rests_with_the_body():
    times = every(PLANS["sprint and brake"], 0.01)
    body = lower_body(FIGURE, PLANS["sprint and brake"], no_demand, times)
    assert (np.diff(body.stride_phase) >= -1e-9).all()
    landings = [times[1:][~body.contact[:-1, foot] & body.contact[1:, foot]] for foot in (0, 1)]
    for foot in (0, 1):
        # While it runs evenly.
        for time in landings[foot][(landings[foot] > 1.8) & (landings[foot] < 2.3)]:
            phase = np.interp(time, times, body.stride_phase) - np.pi * foot
            assert abs((phase + np.pi) % (2 * np.pi) - np.pi) < 0.4
    standing = lower_body(FIGURE, PLANS["stand"], no_demand, np.array([0.0, 2.0]))
    assert standing.stride_phase[0] == standing.stride_phase[1]


@pytest.mark.parametrize("name", ["shuffle", "side run"])
def test_the_mirror_image_of_a_plan_moves_as_the_mirror_image(name):
    plan = PLANS[name]
    other = Plan(times=plan.times, path=plan.path * [-1, 1], heading=-plan.heading, splits=plan.splits)
    times = every(plan, 0.02)
    body, image = (lower_body(FIGURE, p, no_demand, times) for p in (plan, other))
    np.testing.assert_array_equal(body.contact, image.contact[:, ::-1])
    # But for the sway of who rests.
    np.testing.assert_allclose(body.root_position * [-1, 1, 1], image.root_position, atol=0.03)


def test_the_same_plan_gives_the_same_bytes():
    times = every(PLANS["zigzag"], 0.04)
    first, second = (lower_body(FIGURE, PLANS["zigzag"], no_demand, times) for _ in range(2))
    assert first.leg_rotations.tobytes() == second.leg_rotations.tobytes()
    assert first.root_position.tobytes() == second.root_position.tobytes()
