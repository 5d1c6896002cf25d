import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.simulate.tennis.areas import (
    course_of,
    miss_of,
    own_frame,
    place_of,
    placement_of,
    side_of,
    targets_of,
)

across = st.floats(-9.0, 9.0)
ahead = st.floats(0.01, 18.0)
MIRRORED = {"left": "right", "right": "left", "middle": "middle", "": ""}


def test_the_far_player_sees_the_world_turned_half_about() -> None:
    world = np.array([2.0, -9.0])
    assert own_frame(0, world) == pytest.approx(world)
    assert own_frame(1, world) == pytest.approx([-2.0, 9.0])


@given(x=across, y=ahead)
def test_areas_are_alike_on_both_sides(x: float, y: float) -> None:
    here, there = targets_of(np.array([x, y])), targets_of(np.array([-x, y]))
    assert [a.name for a in here] == [a.name for a in there]
    assert [a.side for a in here] == [MIRRORED[a.side] for a in there]
    for serve in (False, True):
        miss, side = miss_of(np.array([x, y]), serve=serve)
        assert miss_of(np.array([-x, y]), serve=serve) == (miss, MIRRORED[side])
    place, mirrored = place_of(np.array([x, -y])), place_of(np.array([-x, -y]))
    assert (place.name, place.side) == (mirrored.name, MIRRORED[mirrored.side])


@given(x=across, y=ahead)
def test_what_lands_in_has_a_name_and_what_is_missed_lies_outside(x: float, y: float) -> None:
    inside = abs(x) <= 4.1 and y <= 11.8
    assert not (inside and miss_of(np.array([x, y]), serve=False)[0])
    names = {area.name for area in targets_of(np.array([x, y]))}
    if inside and not 6.43 < y < 6.71 and abs(x) > 0.06:
        assert names & {"box", "land"}
    assert not {"box", "land"} <= names
    if "box" in names:
        assert y < 6.45
    if "corner" in names:
        assert "land" in names and abs(x) > 2.5


@pytest.mark.parametrize(
    ("x", "y", "serve", "expected"),
    [
        (0.0, 12.5, False, ("long", "middle")),
        (3.0, 12.5, False, ("long", "right")),
        (-5.0, 9.0, False, ("alley", "left")),
        (6.0, 9.0, False, ("wide", "right")),
        (6.0, 12.5, False, ("", "")),
        (2.0, 7.0, True, ("service_long", "right")),
        (-4.6, 5.0, True, ("box_wide", "left")),
        (2.0, -1.0, False, ("", "")),
        (2.0, 5.0, True, ("", "")),
    ],
)
def test_misses_are_told_by_where_they_land(x: float, y: float, serve: bool, expected: tuple[str, str]) -> None:
    assert miss_of(np.array([x, y]), serve=serve) == expected


@pytest.mark.parametrize(
    ("depth", "name"),
    [
        (1.0, "net"),
        (4.5, "box"),
        (6.4, "service_line"),
        (9.0, "land"),
        (11.9, "baseline"),
        (13.0, "behind"),
        (15.0, "far_back"),
    ],
)
def test_places_go_from_the_net_to_the_back(depth: float, name: str) -> None:
    assert place_of(np.array([2.0, -depth])).name == name


def test_sides_leave_a_gap_that_stays_unsaid() -> None:
    assert [side_of(x, middle=0.9, beside=1.6) for x in (-2.0, -1.2, 0.0, 1.2, 2.0)] == [
        "left",
        "",
        "middle",
        "",
        "right",
    ]


def test_a_ball_goes_cross_court_down_the_line_or_to_the_middle() -> None:
    right = np.array([3.0, -11.0])
    assert course_of(right, np.array([-3.0, 9.0])) == "cross"
    assert course_of(right, np.array([3.5, 9.0])) == "line"
    assert course_of(right, np.array([0.3, 9.0])) == "middle"
    assert course_of(np.array([0.5, -11.0]), np.array([3.0, 9.0])) == ""


def test_serves_go_to_the_t_the_body_or_wide() -> None:
    assert [placement_of(np.array([x, 5.0])) for x in (0.4, -2.0, 3.8, 1.3)] == ["tee", "body", "wide", ""]
