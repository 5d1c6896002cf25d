"""The count against a slow reading of the rules from the whole list of points."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.simulate.tennis.score import Count, after_fault, after_point, new_match


@dataclass
class _Told:
    """What an umpire who rereads all points from the first says before the next."""

    sets: list[tuple[int, int]]
    called: tuple[str, str]
    server: int
    right: bool
    near: int
    over: bool


def _told(winners: list[int], first_server: int, near: int) -> _Told:
    """Reread the match: split the points into games, the games into sets, and count changes of ends one by one."""
    sets: list[list[int]] = [[]]  # winners of the games of each set
    game: list[int] = []
    served = 0  # games finished, tie-breaks among them
    for winner in winners:
        game.append(winner)
        tie_break = sets[-1].count(0) == 6 and sets[-1].count(1) == 6
        a, b = game.count(0), game.count(1)
        if tie_break and len(game) % 6 == 0 and not (max(a, b) >= 7 and abs(a - b) >= 2):
            near = 1 - near
        if max(a, b) >= (7 if tie_break else 4) and abs(a - b) >= 2:
            sets[-1].append(winner)
            game, served = [], served + 1
            if len(sets[-1]) in (1, 3, 5, 7, 9, 11, 13):
                near = 1 - near
            won = sets[-1].count(winner)
            if won == 7 or (won == 6 and sets[-1].count(1 - winner) <= 4):
                sets.append([])
    taken = [max((0, 1), key=games.count) for games in sets[:-1]]
    over = max(taken.count(0), taken.count(1)) == 2
    shown = [(games.count(0), games.count(1)) for games in (sets[:-1] if over else sets)]
    tie_break = shown[-1] == (6, 6)
    a, b = game.count(0), game.count(1)
    turn = first_server if served % 2 == 0 else 1 - first_server
    if tie_break:
        order = [turn] + [1 - turn, 1 - turn, turn, turn] * 20
        return _Told(shown, (str(a), str(b)), order[len(game)], len(game) % 2 == 0, near, over)
    if a >= 3 and b >= 3:
        called = {0: ("40", "40"), 1: ("AD", "40"), -1: ("40", "AD")}[a - b]
    else:
        names = ["0", "15", "30", "40"]
        called = (names[a], names[b])
    return _Told(shown, called, turn, len(game) % 2 == 0, near, over)


def _same(count: Count, told: _Told) -> None:
    assert count.sets == tuple(told.sets)
    assert count.finished == told.over
    assert count.near == told.near
    if not told.over:
        assert count.score().points == told.called
        assert count.server == told.server
        assert count.right_court == told.right


# Points won in runs make lopsided sets, alternating ones tie-breaks and long deuces.
_points = st.lists(
    st.one_of(
        st.lists(st.integers(0, 1), min_size=1, max_size=8),
        st.sampled_from([[0] * 4, [1] * 4, [0, 1] * 5, [0] * 4 + [1] * 4]),
    ),
    max_size=60,
).map(lambda parts: [p for part in parts for p in part])


@given(points=_points, first=st.integers(0, 1), near=st.integers(0, 1))
def test_the_count_is_what_rereading_all_points_gives(points: list[int], first: int, near: int) -> None:
    count, played = new_match(first_server=first, near=near), []
    for point in points:
        if count.finished:
            break
        count = after_point(count, point)
        played.append(point)
        if len(played) % 3 == 0 or sum(count.points) == 0 or count.tie_break:
            _same(count, _told(played, first, near))
    _same(count, _told(played, first, near))


def test_held_serves_lead_to_a_tie_break_with_its_turns_and_changes() -> None:
    count = new_match(first_server=0, near=0)
    for game in range(12):
        for _ in range(4):
            count = after_point(count, game % 2)
    assert count.tie_break
    served, ends = [], []
    for point in range(13):
        served.append(count.server)
        ends.append(count.near)
        count = after_point(count, point % 2)
    assert served == [0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0]
    assert ends == [0] * 6 + [1] * 6 + [0]
    for _ in range(3):
        count = after_point(count, 1)
    assert count.sets == ((6, 7), (0, 0))
    assert count.server == 1, "who served first in the tie-break receives next"


@pytest.mark.parametrize("points", [1, 2, 7])
def test_a_fault_changes_nothing_but_the_serve_and_a_point_ends_it(points: int) -> None:
    count = new_match(first_server=1, near=0)
    for point in range(points):
        count = after_point(count, point % 2)
    fault = after_fault(count)
    assert fault.second_serve and not count.second_serve
    assert (fault.server, fault.right_court, fault.points) == (count.server, count.right_court, count.points)
    assert not after_point(fault, 0).second_serve
