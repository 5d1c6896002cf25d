"""Where a ball lands in, and how probable that is."""

import numpy as np
import pytest

from pgm_data.lift.ball.landing import in_probability, inside_probability, serves
from pgm_data.scene import load_scene

COURT = load_scene("tennis").court
assert COURT is not None


def in_by(landing, start, *, is_serve, std=0.0):
    return in_probability(
        np.array([*landing, 0.03]),
        np.eye(3) * std**2,
        start=np.array(start, dtype=float),
        is_serve=is_serve,
        in_play=COURT.in_play,
        in_serve=COURT.in_serve,
    )


@pytest.mark.parametrize("cov", [np.diag([0.04, 0.25]), np.array([[0.3, 0.25], [0.25, 0.4]])])
def test_the_probability_is_the_share_of_drawn_landings(cov):
    point, area = np.array([3.9, 11.5]), np.array([[-4.115, 0.0], [4.115, 11.885]])
    drawn = np.random.default_rng(0).multivariate_normal(point, cov, 200_000)
    share = np.mean(np.all((drawn > area[0]) & (drawn < area[1]), axis=1))
    assert inside_probability(point, cov, area) == pytest.approx(share, abs=4e-3)


def test_a_known_landing_is_in_or_out_to_the_outer_edge_of_the_line():
    assert in_by((4.11, 11.88), (0, -11, 1), is_serve=False) == 1.0
    assert in_by((4.12, 11.0), (0, -11, 1), is_serve=False) == 0.0
    assert in_by((0.0, 11.9), (0, -11, 1), is_serve=False) == 0.0


def test_a_ball_into_the_own_half_is_out():
    assert in_by((0.0, -5.0), (0, -11, 1), is_serve=False) == 0.0
    assert in_by((0.0, -5.0), (0, 11, 1), is_serve=False) == 1.0


@pytest.mark.parametrize(
    ("landing", "start", "inside"),
    [
        ((-2.0, 5.0), (1.0, -11.9, 2.8), 1.0),
        ((2.0, 5.0), (1.0, -11.9, 2.8), 0.0),
        ((0.02, 5.0), (1.0, -11.9, 2.8), 1.0),
        ((-2.0, 6.5), (1.0, -11.9, 2.8), 0.0),
        ((2.0, -5.0), (-1.0, 11.9, 2.8), 1.0),
        ((-2.0, -5.0), (-1.0, 11.9, 2.8), 0.0),
    ],
)
def test_a_serve_goes_to_the_box_across(landing, start, inside):
    assert in_by(landing, start, is_serve=True) == inside


def test_on_the_line_by_half_the_doubt():
    assert in_by((4.115, 6.0), (0, -11, 1), is_serve=False, std=0.1) == pytest.approx(0.5, abs=1e-3)


def test_nothing_is_said_where_nothing_lands_or_counts():
    assert np.isnan(in_by((np.nan, np.nan), (0, -11, 1), is_serve=False))
    none = np.zeros((0, 2, 2))
    landing, start = np.array([0.0, 5.0, 0.0]), np.array([0.0, -11.0, 1.0])
    told = in_probability(landing, np.eye(3), start=start, is_serve=False, in_play=none, in_serve=none)
    assert np.isnan(told)


def test_serves_are_high_first_hits():
    kinds = np.array(["hit", "bounce", "hit", "hit", "hit"], dtype=object)
    times = np.array([0.0, 0.5, 1.0, 10.0, 11.0])
    heights = np.array([2.7, 0.03, 1.0, 1.1, 2.8])
    position = np.stack([np.zeros(5), np.zeros(5), heights], axis=1)
    assert serves(kinds, times, position, serve_z=2.1).tolist() == [True, False, False, False, False]
