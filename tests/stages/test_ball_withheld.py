"""A flight that no ball can have flown comes back as `none`, and leaves its neighbours as they are."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.ball import BallEvents
from pgm_data.lift.ball.solution import BallSolution, Flights
from pgm_data.lift.ball.world import ball_world
from pgm_data.scene import Prior, load_scene
from pgm_data.stages.ball_withheld import without_absurd

TIMES = np.arange(21) / 20
WORLD = ball_world(load_scene("tennis"))


def two_flights(end: np.ndarray) -> BallSolution:
    """Straight from the near end to the far one in half a second, and on to the end in another half."""
    knots = np.array([[0.0, -11.0, 1.0], [0.0, 9.0, 0.0335], end])
    velocity = np.diff(knots, axis=0) / 0.5
    flight = np.minimum((TIMES >= 0.5).astype(int), 1)
    position = knots[flight] + (TIMES - 0.5 * flight)[:, None] * velocity[flight]
    free = ("position", "velocity")
    return BallSolution(
        position=position,
        velocity=velocity[flight],
        position_cov=np.tile(np.eye(3), (21, 1, 1)),
        status=np.full(21, "measured", dtype=object),
        events=BallEvents(
            times=np.array([0.0, 0.5, 1.0]),
            kinds=np.array(["hit", "bounce", "last"], dtype=object),
            probability=np.ones(3),
            time_std=np.full(3, 0.01),
            sources=np.full(3, "detected", dtype=object),
            players=np.full(3, "", dtype=object),
            ground_px=np.full((3, 2), np.nan),
        ),
        event_position=knots,
        event_cov=np.tile(np.eye(3), (3, 1, 1)),
        flights=Flights(
            start_event=np.array([0, 1]),
            end_event=np.array([1, 2]),
            start_velocity=velocity,
            start_velocity_cov=np.tile(np.eye(3), (2, 1, 1)),
            spin=np.zeros((2, 3)),
            spin_std=np.ones((2, 3)),
            drag_per_m=np.full(2, 0.02),
            drag_std_per_m=np.full(2, 0.002),
            landing=knots[1:],
            landing_cov=np.tile(np.eye(3), (2, 1, 1)),
            residual_px=np.ones(2),
            free=(free, free),
            status=("solved", "line"),
            said=("", ""),
        ),
        drag=Prior(mean=0.02, std=0.002),
        restitution=None,
        friction=None,
        cost=0.0,
        said="",
    )


def test_possible_flights_stay():
    solution = two_flights(np.array([1.0, 17.0, 1.0]))
    assert without_absurd(solution, TIMES, WORLD) is solution


@pytest.mark.parametrize(
    ("end", "said"),
    [
        ([0.0, 95.0, 1.0], "m/s"),
        ([0.0, 70.0, 1.0], "y 6"),
        ([0.0, 12.0, -4.0], "z -"),
    ],
)
def test_impossible_flight_is_none_and_says_why(end, said):
    solution = two_flights(np.array(end))
    got = without_absurd(solution, TIMES, WORLD)
    assert got.flights.status == ("solved", "none")
    assert got.flights.said[1].startswith("not believed") and said in got.flights.said[1]
    after = TIMES > 0.5
    assert (got.status[after] == "none").all() and (got.status[~after] == "measured").all()
    assert np.isnan(got.position[after]).all()
    np.testing.assert_array_equal(got.position[~after], solution.position[~after])
    # The contact that both flights share is placed by the one that holds.
    np.testing.assert_array_equal(np.isfinite(got.event_position[:, 0]), [True, True, False])
    assert np.isnan(got.flights.start_velocity[1]).all() and np.isfinite(got.flights.start_velocity[0]).all()
    assert got.flights.free[1] == ()


def test_flights_that_were_not_placed_stay_as_they_are():
    solution = without_absurd(two_flights(np.array([0.0, 95.0, 1.0])), TIMES, WORLD)
    again = without_absurd(replace(solution), TIMES, WORLD)
    assert again.flights.said == solution.flights.said


def test_a_place_under_the_floor_is_withheld_unless_it_is_as_uncertain():
    solution = two_flights(np.array([0.0, 15.0, 1.0]))
    position, cov, events = solution.position.copy(), solution.position_cov.copy(), solution.event_position.copy()
    position[[3, 4], 2] = -0.5
    cov[3] = 1e-4 * np.eye(3)
    events[0, 2] = -0.5
    kept = without_absurd(replace(solution, position=position, position_cov=cov, event_position=events), TIMES, WORLD)
    assert kept.status[3] == "none" and kept.status[4] == "measured"
    assert np.isnan(kept.position[3]).all() and np.isfinite(kept.position[4]).all()
    assert np.isnan(kept.event_position[0]).all() and np.isfinite(kept.event_position[1:]).all()
