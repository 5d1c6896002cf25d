"""Hits by measured contacts: what they are, where they go, and what is not claimed."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.caption.facts import HitFacts
from pgm_data.caption.measures import facts_of_clip, play_of_clip
from tests.caption.rallies import (
    TENNIS,
    Contact,
    clip_ball,
    clip_players,
    mirrored,
    person,
    standing,
    times_of,
    turned_about,
)

TIMES = times_of(6.0)
RIGHT = ("right", "right")


def rally(
    *, x: float = 0.0, ball_side: float = 0.8, to: tuple[float, float] = (-3.0, 9.0), probability: float = 1.0, **more
):
    """The far player hits, it bounces, the near player at x hits it to `to`, where it bounces twice."""
    contacts = [
        Contact(kind="hit", time=0.5, at=(0.8, 12.0, 1.0), player="player1", in_probability=1.0),
        Contact(kind="bounce", time=1.5, at=(x, -8.0, 0.033)),
        Contact(
            kind="hit", time=2.1, at=(x + ball_side, -12.0, 0.9), player="player0", in_probability=probability, **more
        ),
        Contact(kind="bounce", time=3.1, at=(*to, 0.033)),
        Contact(kind="bounce", time=3.9, at=(to[0] * 1.4, to[1] * 1.5, 0.033)),
        Contact(kind="last", time=4.2, at=(to[0] * 1.5, to[1] * 1.7, 0.5)),
    ]
    people = clip_players(standing(0, (x, -12.3), len(TIMES)), standing(1, (-0.5, 12.4), len(TIMES)))
    return people, contacts


def hits(people, contacts, *, std: float = 0.0, handedness=RIGHT) -> HitFacts:
    return facts_of_clip(people, clip_ball(contacts, TIMES, std=std), TIMES, TENNIS, handedness).hits


def test_a_ball_on_the_side_of_the_racket_is_a_forehand_and_on_the_other_a_backhand():
    for offset, hand, side in ((0.8, "right", "forehand"), (-0.8, "right", "backhand"), (0.8, "left", "backhand")):
        found = hits(*rally(ball_side=offset), handedness=(hand, hand))
        assert found.side[1] == side
    assert hits(*rally(ball_side=0.05)).side[1] == "", "a ball at the body is neither"


def test_left_and_right_beyond_the_net_are_those_of_the_hitting_player():
    people, contacts = rally(to=(-3.0, 9.0))
    near = hits(people, contacts)
    assert (near.zone[1], near.zone_side[1], near.ending[1]) == ("land", "left", "winner")
    turned = facts_of_clip(*turned_about(people, clip_ball(contacts, TIMES)), TIMES, TENNIS, RIGHT)
    assert (turned.hits.player[1], turned.hits.zone_side[1]) == (1, "left")


def test_changing_ends_changes_nothing_but_the_players():
    people, contacts = rally(x=2.5, to=(-2.8, 10.5), spin=(-250.0, 0.0, 0.0))
    ball = clip_ball(contacts, TIMES)
    one = facts_of_clip(people, ball, TIMES, TENNIS, RIGHT)
    two = facts_of_clip(*turned_about(people, ball), TIMES, TENNIS, RIGHT)
    assert list(one.hits.player) == [1 - p for p in two.hits.player]
    for name in ("stroke", "side", "spin", "direction", "zone", "zone_side", "depth", "outcome", "ending", "pace"):
        assert list(getattr(one.hits, name)) == list(getattr(two.hits, name)), name
    assert one.hits.landing == pytest.approx(two.hits.landing)


def test_a_mirror_changes_left_and_right_and_hands_and_nothing_else():
    people, contacts = rally(x=2.5, to=(-2.8, 10.5), spin=(-250.0, 0.0, 0.0))
    ball = clip_ball(contacts, TIMES)
    one = facts_of_clip(people, ball, TIMES, TENNIS, RIGHT)
    two = facts_of_clip(*mirrored(people, ball), TIMES, TENNIS, ("left", "left"))
    other = {"left": "right", "right": "left"}
    assert [other.get(side, side) for side in one.hits.zone_side] == list(two.hits.zone_side)
    for name in ("stroke", "side", "spin", "direction", "zone", "depth", "outcome", "ending"):
        assert list(getattr(one.hits, name)) == list(getattr(two.hits, name)), name


@pytest.mark.parametrize(
    ("start", "end", "word"),
    [(3.0, -3.0, "cross"), (-3.0, 3.0, "cross"), (3.0, 3.2, "line"), (2.0, 0.3, "middle"), (0.2, 3.0, "")],
)
def test_directions_are_named_where_they_are_clear(start, end, word):
    assert hits(*rally(x=start, ball_side=0.3, to=(end, 9.0))).direction[1] == word


@pytest.mark.parametrize(
    ("to", "zone", "side", "depth"),
    [
        ((2.0, 5.0), "box", "right", ""),
        ((-0.4, 5.0), "box", "left", ""),
        ((2.0, 2.5), "box", "right", "short"),
        ((0.2, 8.0), "land", "middle", ""),
        ((1.25, 8.0), "land", "", ""),
        ((3.4, 11.0), "land", "right", "deep"),
    ],
)
def test_targets_are_named_by_their_area(to, zone, side, depth):
    found = hits(*rally(to=to))
    assert (found.zone[1], found.zone_side[1], found.depth[1]) == (zone, side, depth)


def test_what_is_uncertain_is_not_claimed():
    people, contacts = rally(x=3.0, ball_side=0.3, to=(-3.0, 9.0))
    sure, unsure = hits(people, contacts, std=0.2), hits(people, contacts, std=3.0)
    assert (sure.zone[1], sure.zone_side[1], sure.direction[1]) == ("land", "left", "cross")
    assert (unsure.zone[1], unsure.zone_side[1], unsure.direction[1]) == ("", "", "")
    for probability, outcome in ((0.95, "in"), (0.5, ""), (0.05, "out"), (np.nan, "")):
        assert hits(*rally(probability=probability)).outcome[1] == outcome
    assert hits(*rally(probability=0.5)).ending[1] == ""
    doubted = rally(spin=(-250.0, 0.0, 0.0))
    ball = clip_ball(doubted[1], TIMES)
    assert facts_of_clip(doubted[0], ball, TIMES, TENNIS, RIGHT).hits.spin[1] == "topspin"
    vague = replace(ball, shots=replace(ball.shots, spin_std=ball.shots.spin_std + 200.0))
    assert facts_of_clip(doubted[0], vague, TIMES, TENNIS, RIGHT).hits.spin[1] == ""
    unknown = replace(ball, shots=replace(ball.shots, spin=ball.shots.spin * np.nan))
    assert facts_of_clip(doubted[0], unknown, TIMES, TENNIS, RIGHT).hits.spin[1] == ""


def test_topspin_runs_ahead_at_either_end_and_slice_comes_back():
    for spin, word in (((-250.0, 0.0, 0.0), "topspin"), ((150.0, 0.0, 0.0), "slice"), ((20.0, 0.0, 300.0), "flat")):
        people, contacts = rally(to=(0.8, 9.0), spin=spin)
        ball = clip_ball(contacts, TIMES)
        assert facts_of_clip(people, ball, TIMES, TENNIS, RIGHT).hits.spin[1] == word
        assert facts_of_clip(*turned_about(people, ball), TIMES, TENNIS, RIGHT).hits.spin[1] == word


def test_balls_that_land_out_say_which_way_and_balls_in_the_net_say_no_target():
    long = hits(*rally(to=(1.0, 12.8), probability=0.0))
    assert (long.outcome[1], long.miss[1], long.ending[1], long.zone[1]) == ("out", "long", "error", "")
    wide = hits(*rally(to=(-5.0, 9.0), probability=0.0))
    assert (wide.outcome[1], wide.miss[1]) == ("out", "wide")
    people, contacts = rally()
    contacts[3:] = [
        Contact(kind="net", time=2.7, at=(0.5, 0.0, 0.7)),
        Contact(kind="bounce", time=3.1, at=(0.5, -0.6, 0.033)),
        Contact(kind="last", time=4.2, at=(0.5, -1.0, 0.033)),
    ]
    net = hits(people, contacts)
    assert (net.outcome[1], net.ending[1], net.zone[1], net.zone_side[1]) == ("net", "error", "", "")
    assert net.decided_s[1] == pytest.approx(2.7)


def serve(*, to: tuple[float, float], probability: float):
    contacts = [
        Contact(kind="first", time=0.8, at=(0.7, -11.9, 1.6)),
        Contact(kind="hit", time=1.6, at=(0.9, -11.6, 2.7), player="player0", in_probability=probability),
        Contact(kind="bounce", time=2.1, at=(*to, 0.033)),
        Contact(kind="bounce", time=2.9, at=(to[0] * 2, to[1] * 2, 0.033)),
        Contact(kind="last", time=3.3, at=(to[0] * 2.2, to[1] * 2.2, 0.5)),
    ]
    people = clip_players(standing(0, (0.6, -12.0), len(TIMES)), standing(1, (-3.5, 13.0), len(TIMES)))
    return people, contacts


def test_serves_are_known_and_end_as_ace_or_fault():
    ace = hits(*serve(to=(-3.5, 5.0), probability=1.0))
    assert (ace.stroke[0], ace.zone[0], ace.zone_side[0], ace.ending[0]) == ("serve", "box", "left", "ace")
    fault = hits(*serve(to=(-2.0, 7.2), probability=0.0))
    assert (fault.outcome[0], fault.miss[0], fault.ending[0]) == ("out", "long", "fault")
    on_the_line = hits(*serve(to=(-2.0, 6.42), probability=1.0))
    assert (on_the_line.zone[0], on_the_line.zone_side[0]) == ("box", "left")


def test_volleys_come_without_a_bounce_near_the_net():
    people, contacts = rally()
    near = clip_players(standing(0, (0.0, -4.0), len(TIMES)), people.players[1])
    contacts[1:3] = [Contact(kind="hit", time=1.4, at=(0.8, -3.6, 1.2), player="player0", in_probability=1.0)]
    assert hits(near, contacts).stroke[1] == "volley"
    assert hits(*rally()).stroke[1] == "groundstroke"
    # Further back, a flight without a bounce may be one whose bounce was missed.
    back = clip_players(standing(0, (0.0, -9.0), len(TIMES)), people.players[1])
    contacts[1] = replace(contacts[1], at=(0.8, -8.8, 0.9), time=1.9)
    assert hits(back, contacts).stroke[1] == ""


def test_lobs_and_drop_shots_are_told_by_their_flight():
    people, contacts = rally(to=(1.0, 10.0))
    slow = [*contacts[:3], *(replace(c, time=c.time + 1.2) for c in contacts[3:])]
    assert hits(people, slow).stroke[1] == "lob"
    short = [*contacts[:3], replace(contacts[3], at=(1.0, 2.5, 0.033), time=3.3), *contacts[4:]]
    assert hits(people, short).stroke[1] == "drop shot"


def test_hits_without_a_name_belong_to_the_end_they_happen_at():
    people, contacts = rally()
    nameless = [replace(contact, player="") for contact in contacts]
    assert list(hits(people, nameless).player) == [1, 0]
    nowhere = clip_ball(nameless, TIMES)
    nowhere.events.position[:] = np.nan
    assert len(facts_of_clip(people, nowhere, TIMES, TENNIS, RIGHT).hits) == 0


def test_handedness_is_estimated_from_the_wrist_at_the_ball_or_left_open():
    # With arms out, the hand nearer the ball is the one on its side.
    right = rally(ball_side=0.85)
    assert play_of_clip(right[0], clip_ball(right[1], TIMES), TIMES, TENNIS).handedness[0] == "right"
    left = rally(ball_side=-0.85)
    assert play_of_clip(left[0], clip_ball(left[1], TIMES), TIMES, TENNIS).handedness[0] == "left"
    open_ = rally(ball_side=0.02)
    found = play_of_clip(open_[0], clip_ball(open_[1], TIMES), TIMES, TENNIS)
    assert (found.handedness[0], found.hits.side[1]) == ("", "")


def test_a_player_without_joints_gets_no_claim_that_needs_them():
    people, contacts = rally()
    near = people.players[0]
    blind = replace(near, joints=near.joints * np.nan, joint_rotations=near.joint_rotations * np.nan)
    found = hits(replace(people, players=(blind, people.players[1])), contacts, handedness=("", ""))
    assert (found.side[1], found.hands[1], found.zone[1]) == ("", 0, "land")
    gone = replace(near, status=np.full(len(TIMES), "none", dtype=object), root_position=near.root_position * np.nan)
    found = hits(replace(people, players=(gone, people.players[1])), contacts)
    assert (found.side[1], found.zone[1]) == ("", "land")


def test_tables_of_other_lengths_and_players_are_refused():
    people, contacts = rally()
    with pytest.raises(ValueError, match="ball: expected 150 rows, as the clip has, got 100"):
        facts_of_clip(people, clip_ball(contacts, times_of(4.0)), TIMES, TENNIS)
    with pytest.raises(ValueError, match="expected player0, player1, got player0"):
        facts_of_clip(replace(people, players=people.players[:1]), None, TIMES, TENNIS)
    assert person(0, np.zeros((2, 2))).joints.shape == (2, 24, 3)
