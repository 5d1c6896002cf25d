"""Footsteps along a course."""

import numpy as np
import pytest

from pgm_data.simulate.body import footsteps
from pgm_data.simulate.body.footsteps import TICK_S, Course, march


def straight(speed: float, seconds: float = 6.0, airborne=()) -> Course:
    """Along +y, looking there, at an even speed."""
    times = np.arange(round(seconds / TICK_S)) * TICK_S
    return Course(
        xy=np.stack([0 * times, speed * times], axis=-1),
        velocity=np.tile([0.0, speed], (len(times), 1)),
        heading=np.zeros(len(times)),
        airborne=np.array(airborne, dtype=float).reshape(-1, 2),
        wide=np.full(len(airborne), footsteps.SPLIT_WIDTH_M),
    )


@pytest.mark.parametrize("speed", [0.0, 0.7, 1.4, 2.5, 4.0, 6.0, 7.0])
@pytest.mark.parametrize("scale", [0.9, 1.12])
def test_stances_follow_each_other_in_time(speed, scale):
    for foot in march(straight(speed), scale):
        assert foot.land[0] == -np.inf
        assert foot.lift[-1] == np.inf
        assert (foot.lift > foot.land).all()
        assert (foot.land[1:] - foot.lift[:-1] >= 0.1 - 1e-9).all()
        assert np.isfinite(foot.toe).all()
        assert np.isfinite(foot.yaw).all()


@pytest.mark.parametrize(("speed", "fewest", "most"), [(1.4, 1.5, 2.4), (3.0, 2.6, 3.9), (6.0, 3.5, 5.0)])
def test_even_speeds_take_even_alternating_steps_at_a_human_rate(speed, fewest, most):
    left, right = march(straight(speed), 1.0)
    lands = np.concatenate([left.land[1:], right.land[1:]])
    foot = np.repeat([0, 1], [len(left.land) - 1, len(right.land) - 1])
    order = np.argsort(lands)
    late = lands[order] > 2.0
    assert (np.diff(foot[order][late]) != 0).all()
    gaps = np.diff(lands[order][late])
    assert fewest < 1.0 / gaps.mean() < most
    assert gaps.max() < 1.5 * gaps.min()


def test_who_stands_takes_no_step():
    for foot in march(straight(0.0), 1.0):
        assert len(foot.land) == 1


def test_both_feet_leave_for_a_leap_and_land_from_it_together():
    for foot in march(straight(0.0, airborne=[(2.0, 2.24)]), 1.0):
        assert foot.lift[0] == pytest.approx(2.0)
        assert foot.land[1] == 2.24
    left, right = march(straight(0.0, airborne=[(2.0, 2.24)]), 1.0)
    assert np.linalg.norm(left.toe[1] - right.toe[1]) == pytest.approx(footsteps.SPLIT_WIDTH_M, abs=0.02)


def test_the_left_foot_walks_on_the_left():
    left, right = march(straight(1.4), 1.0)
    assert (left.toe[:, 0] < 0).all()
    assert (right.toe[:, 0] > 0).all()


def test_planning_needs_no_look_at_what_comes_much_later():
    course = straight(2.0)
    short = Course(
        xy=course.xy[:300],
        velocity=course.velocity[:300],
        heading=course.heading[:300],
        airborne=course.airborne,
        wide=course.wide,
    )
    for long_foot, short_foot in zip(march(course, 1.0), march(short, 1.0), strict=True):
        early = long_foot.land < 2.0
        np.testing.assert_array_equal(long_foot.toe[early], short_foot.toe[: early.sum()])
