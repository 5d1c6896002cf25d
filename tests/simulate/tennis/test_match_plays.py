"""Every play keeps the rules of tennis, the limits of legs and the ball's own law; same seed, same play."""

import hashlib
import pickle
import subprocess
import sys
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.body.racket import BALL_RADIUS_M
from pgm_data.simulate.body.reach import GROUND_REACH, LOWEST_BALL_M, OVERHEAD_REACH, pelvis_at_contact
from pgm_data.simulate.flight.contact import SurfaceName
from pgm_data.simulate.tennis import match as match_module
from pgm_data.simulate.tennis import rally
from pgm_data.simulate.tennis.match import Match, draw_match, plays
from pgm_data.simulate.tennis.movement import RATE, inside
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.tennis.score import after_fault, after_point, new_match
from pgm_data.simulate.tennis.umpire import outside

_Wind = tuple[float, float, float] | None
_MATCHES: tuple[tuple[SurfaceName | None, _Wind], ...] = (
    ("hard", None),
    ("clay", (2.0, -3.0, 0.0)),
    ("grass", None),
    (None, (-6.0, 5.0, 0.0)),
)


def _played(seed: int, count: int) -> list[Play]:
    surface, wind = _MATCHES[seed % len(_MATCHES)]
    match = draw_match(
        np.random.default_rng(seed),
        load_scene("tennis"),
        name="m",
        surface=surface,
        wind=None if wind is None else np.array(wind),
    )
    return list(islice(plays(match, np.random.default_rng([seed, 1])), count))


@pytest.fixture(scope="module")
def matches() -> list[list[Play]]:
    return [_played(seed, 38) for seed in range(len(_MATCHES))]


@pytest.fixture(scope="module")
def some(matches: list[list[Play]]) -> list[Play]:
    return [play for match in matches for play in match]


def _place(play: Play, player: int, time: float) -> np.ndarray:
    plan = play.plans[player]
    return np.array([np.interp(time, plan.times, plan.path[:, axis]) for axis in (0, 1)])


def test_nobody_runs_turns_or_leaves_beyond_the_limits(some: list[Play]) -> None:
    for play in some:
        for player, (athlete, plan) in enumerate(zip(play.athletes, play.plans, strict=True)):
            np.testing.assert_allclose(plan.times, np.arange(len(plan.times)) / RATE)
            assert plan.times[-1] == pytest.approx(play.duration_s)
            velocity = np.diff(plan.path, axis=0) * RATE
            assert np.hypot(*velocity.T).max() <= athlete.top_speed
            assert np.hypot(*np.diff(velocity, axis=0).T).max() * RATE <= athlete.acceleration
            assert inside(plan.path, player).all()
            assert np.abs(np.diff(plan.heading)).max() * RATE <= 7.0
            assert ((plan.splits >= 0) & (plan.splits < play.duration_s)).all()


def test_who_waits_for_the_serve_stands_still_at_the_right_place(some: list[Play]) -> None:
    for play in some:
        serve = play.strokes[0]
        server, receiver = play.server, 1 - play.server
        assert 1.0 <= serve.toss_time <= 2.5
        before = play.plans[server].path[: int(serve.toss_time * RATE)]
        assert np.ptp(before, axis=0).max() < 1e-9
        forward = np.array([1.0, -1.0])
        stance, waits = forward[server] * before[0], forward[receiver] * _place(play, receiver, 0.0)
        assert stance[1] < -11.9, "behind the baseline"
        assert waits[0] * stance[0] > 0, "diagonally opposite, each in the own right or left half"
        assert -16.0 < waits[1] < -12.3


def test_the_ball_is_met_where_the_stroke_says_and_within_reach(some: list[Play]) -> None:
    for play in some:
        for stroke in play.strokes:
            athlete = play.athletes[stroke.player]
            goal = pelvis_at_contact(
                athlete.figure, stroke.player, stroke.ball[:2], stroke.side, stroke.hands, stroke.stretch
            )
            assert np.hypot(*(_place(play, stroke.player, stroke.time) - goal)) < 0.02
            tall = athlete.figure.height_m
            low, high = LOWEST_BALL_M, GROUND_REACH * tall
            if stroke.side == "overhead":
                low, high = OVERHEAD_REACH[0] * tall, OVERHEAD_REACH[1] * tall
            assert low <= stroke.ball[2] <= high
            assert np.linalg.norm(stroke.swing) == pytest.approx(1.0)
            assert 0 <= stroke.stretch <= 1
            heading = np.interp(stroke.time, play.plans[stroke.player].times, play.plans[stroke.player].heading)
            assert abs(heading - (0.0 if stroke.player == 0 else np.pi)) < np.radians(62)
            ball = play.ball.at(np.array([stroke.time - 1e-9]))[0][0]
            if stroke.hit:
                assert np.linalg.norm(ball - stroke.ball) < 1e-3
            else:
                assert not np.linalg.norm(ball - stroke.ball) < 0.25, "a miss is one"
            assert np.isfinite(stroke.toss).all() == (stroke.kind == "serve") == np.isfinite(stroke.toss_time)


def test_balls_fly_without_jumps_from_the_toss_to_the_end(some: list[Play]) -> None:
    for play in some:
        contacts, flights = play.ball.contacts, play.ball.flights
        assert [contacts[0].kind, contacts[-1].kind] == ["first", "last"]
        assert not any(c.kind in ("first", "last") for c in contacts[1:-1])
        assert contacts[-1].time <= play.duration_s + 1e-9
        for flight, start, end in zip(flights, contacts[:-1], contacts[1:], strict=True):
            assert (flight.times[0], flight.times[-1]) == pytest.approx((start.time, end.time))
            np.testing.assert_allclose(flight.positions[[0, -1]], [start.position, end.position], atol=1e-9)
            for values in (flight.positions, flight.velocities, flight.spins):
                assert np.isfinite(values).all()
            assert flight.positions[:, 2].min() > BALL_RADIUS_M - 1e-3
        toss = play.strokes[0]
        tall = play.athletes[play.server].figure.height_m
        assert 0.75 <= toss.time - toss.toss_time <= 1.1
        assert 0.94 * tall <= toss.toss[2] <= 1.01 * tall
        assert 0.0 < flights[0].positions[:, 2].max() - toss.ball[2] < 0.6


def test_hits_alternate_and_every_shot_is_one_of_them(some: list[Play]) -> None:
    for play in some:
        hits = [i for i, c in enumerate(play.ball.contacts) if c.kind == "hit"]
        assert hits == [shot.contact for shot in play.shots]
        players = [play.ball.contacts[i].player for i in hits]
        assert players == [(play.server + i) % 2 for i in range(len(hits))]
        assert [i for i, stroke in enumerate(play.strokes) if stroke.hit] == [shot.stroke for shot in play.shots]
        times = [stroke.time for stroke in play.strokes]
        assert times == sorted(times)
        assert sum(not stroke.hit for stroke in play.strokes) <= 1
        for shot in play.shots:
            stroke, contact = play.strokes[shot.stroke], play.ball.contacts[shot.contact]
            assert (stroke.player, stroke.time) == (shot.player, contact.time) == (contact.player, contact.time)
            _, velocity = play.ball.at(np.array([contact.time]))
            assert np.linalg.norm(velocity[0]) == pytest.approx(shot.speed, rel=1e-6)


def _read(play: Play, index: int) -> str:
    """One shot's result by the rules, from the ball's contacts alone."""
    shot = play.shots[index]
    ends = [s.contact for s in play.shots[index + 1 :]][:1]
    after = play.ball.contacts[shot.contact + 1 : ends[0] if ends else None]
    bounces = [c for c in after if c.kind == "bounce"]
    forward = 1.0 if shot.player == 0 else -1.0
    if not bounces:
        # Volleyed; caught in the net; or gone over the fence.
        return "in" if ends else "net" if any(c.kind == "net" for c in after) else "out"
    assert np.allclose(shot.landing, bounces[0].position[:2])
    x, y = forward * bounces[0].position[:2]
    if y <= 0:
        return "net"
    edge = BALL_RADIUS_M
    if index:
        return "in" if abs(x) <= 4.115 + edge and y <= 11.885 + edge else "out"
    left = sum(map(_order, play.score.points)) % 2 == 0
    inwards = -x if left else x
    fits = -0.025 - edge <= inwards <= 4.115 + edge and y <= 6.40 + edge
    touched = any(c.kind == "net" and c.time < bounces[0].time for c in after)
    return "out" if not fits else "let" if touched else "in"


def _order(points: str) -> int:
    """How many points a call stands for, as far as odd and even go; advantage is one more than 40."""
    return {"0": 0, "15": 1, "30": 2, "40": 3, "AD": 4}.get(points, int(points) if points.isdigit() else 0)


def test_results_and_outcomes_are_what_the_ball_did(some: list[Play]) -> None:
    for play in some:
        if play.score.sets[-1] == (6, 6):
            continue
        results = [shot.result for shot in play.shots]
        assert [_read(play, i) for i in range(len(results))] == results
        assert all(result == "in" for result in results[:-1])
        last = play.shots[-1]
        first, missed = len(results) == 1, any(not stroke.hit for stroke in play.strokes)
        if first and last.result == "let":
            expected = (("let",), -1)
        elif first and last.result != "in":
            expected = (("fault",), -1) if play.serve_number == 1 else (("double_fault",), 1 - last.player)
        elif last.result != "in":
            expected = (("forced_error", "unforced_error"), 1 - last.player)
        elif first:
            expected = (("service_winner",) if missed else ("ace",), last.player)
        else:
            expected = (("winner",), last.player)
        assert play.outcome in expected[0] and play.winner == expected[1]


def test_plays_follow_the_count_of_a_match(matches: list[list[Play]]) -> None:
    for played in matches:
        first = played[0]
        names = {a.identity for a in first.athletes}
        assert names == {"m_A", "m_B"}
        count = new_match(first_server=first.identities[first.server], near=first.identities[0])
        people: dict[int, str] = {}
        for number, play in enumerate(played):
            assert play.number == number
            assert play.identities == (count.near, 1 - count.near)
            assert play.identities[play.server] == count.server
            assert play.serve_number == 1 + count.second_serve
            assert (play.score.sets, play.score.points) == (count.score().sets, count.score().points)
            for identity, athlete in zip(play.identities, play.athletes, strict=True):
                assert people.setdefault(identity, athlete.identity) == athlete.identity
            if play.outcome == "fault":
                count = after_fault(count)
            elif play.outcome != "let":
                count = after_point(count, play.identities[play.winner])


def test_a_won_match_is_followed_by_another_from_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    one, starts = _played(0, 1)[0], []

    def decided(rng, start):
        starts.append(start)
        return replace(one, outcome="ace", winner=start.identities.index(0), identities=start.identities)

    monkeypatch.setattr(match_module, "played", decided)
    assert len(list(islice(plays(_match(3), np.random.default_rng(8)), 100))) == 100
    assert starts[47].score.sets == ((6, 0), (5, 0)) and starts[47].score.points == ("40", "0")
    for i in (0, 48, 96):
        assert starts[i].score.sets == ((0, 0),) and starts[i].score.points == ("0", "0")
        assert starts[i].right_court and not starts[i].second
    assert [start.number for start in starts] == list(range(100))


@pytest.mark.parametrize("wind", [(0.0, 25.0, 0.0), (-25.0, 10.0, 0.0), (0.0, 0.0, 8.0)])
def test_a_match_goes_on_in_a_storm(wind: tuple[float, float, float]) -> None:
    match = draw_match(np.random.default_rng(0), load_scene("tennis"), name="m", wind=np.array(wind))
    for play in islice(plays(match, np.random.default_rng(1)), 8):
        assert all(np.isfinite(flight.positions).all() for flight in play.ball.flights)
        assert all(np.isfinite(plan.path).all() for plan in play.plans)


def _match(seed: int) -> Match:
    return draw_match(np.random.default_rng(seed), load_scene("tennis"), name="m", surface="hard")


def _digest(seed: int, count: int) -> str:
    played = _played(seed, count)
    whole = hashlib.sha256()
    for play in played:
        for plan in play.plans:
            whole.update(plan.path.tobytes() + plan.heading.tobytes() + plan.splits.tobytes())
        for flight in play.ball.flights:
            whole.update(flight.times.tobytes() + flight.positions.tobytes() + flight.spins.tobytes())
        whole.update(pickle.dumps([(s.kind, s.side, s.hands, s.time, s.hit) for s in play.strokes]))
        whole.update(repr((play.outcome, play.winner, play.score.points)).encode())
    return whole.hexdigest()


def test_one_seed_gives_the_same_bytes_in_every_process_and_another_gives_others() -> None:
    here = _digest(1, 6)
    assert here != _digest(5, 6)
    code = f"import runpy; print(runpy.run_path({__file__!r})['_digest'](1, 6))"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert told.strip() == here


@pytest.mark.parametrize("which", [1, 2, 4])
def test_nothing_before_a_reaction_depends_on_what_a_shot_becomes(which: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same plays twice, the second time one shot of each leaves the racket otherwise: all before stays."""
    struck, calls = rally.struck, []

    def changed(rng, intent, player, ball, world):
        strike = struck(rng, intent, player, ball, world)
        calls.append(None)
        if len(calls) == which:
            turn = np.array([[np.cos(0.15), -np.sin(0.15), 0.0], [np.sin(0.15), np.cos(0.15), 0.0], [0.0, 0.0, 1.0]])
            return replace(strike, velocity=turn @ strike.velocity * 0.9)
        return strike

    compared = 0
    for seed in range(8):
        start = next(_starts(seed))
        plain = rally.played(np.random.default_rng(seed), start)
        calls.clear()
        with monkeypatch.context() as patch:
            patch.setattr(rally, "struck", changed)
            other = rally.played(np.random.default_rng(seed), start)
        if len(plain.shots) < which:
            continue
        compared += 1
        shot = plain.shots[which - 1]
        moment = plain.strokes[shot.stroke].time
        after = {player: moment + 0.4 * plain.athletes[player].reaction_s for player in (0, 1)}
        after[shot.player] = moment
        for player, until in after.items():
            knots = int(until * RATE)
            np.testing.assert_array_equal(plain.plans[player].path[:knots], other.plans[player].path[:knots])
            np.testing.assert_array_equal(
                plain.plans[player].heading[: knots - 1], other.plans[player].heading[: knots - 1]
            )
        same = shot.stroke + 1
        assert [s.time for s in plain.strokes[:same]] == [s.time for s in other.strokes[:same]]
        times = np.arange(0.0, moment, 0.01)
        np.testing.assert_array_equal(plain.ball.at(times)[0], other.ball.at(times)[0])
        later = plain.ball.at(np.array([moment + 0.1]))[0] - other.ball.at(np.array([moment + 0.1]))[0]
        assert np.abs(later).max() > 0.05, "the shot did change"
    assert compared >= 2


def _starts(seed: int):
    match = _match(seed)
    yield rally.Start(
        number=0,
        athletes=match.athletes,
        identities=(0, 1),
        server=seed % 2,
        right_court=seed % 3 > 0,
        second=True,
        score=new_match(first_server=0, near=0).score(),
        world=match.world,
    )


@pytest.mark.parametrize("hitter", [0, 1])
def test_a_ball_that_touches_a_line_is_in(hitter: int) -> None:
    forward = 1.0 if hitter == 0 else -1.0

    def gap(x: float, y: float, serve: bool | None = None) -> float:
        return outside(forward * np.array([x, y]), hitter, serve_from_right=serve)

    edge = BALL_RADIUS_M
    for sign in (-1, 1):
        assert gap(sign * (4.115 + edge - 1e-6), 8.0) < 0 < gap(sign * (4.115 + edge + 1e-6), 8.0)
    assert gap(0.0, 11.885 + edge - 1e-6) < 0 < gap(0.0, 11.885 + edge + 1e-6)
    assert gap(-2.0, 6.4 + edge - 1e-6, True) < 0 < gap(-2.0, 6.4 + edge + 1e-6, True)
    assert gap(2.0, 6.0, False) < 0 < gap(2.0, 6.0, True)
    assert gap(0.025 + edge - 1e-6, 6.0, True) < 0 < gap(0.025 + edge + 1e-6, 6.0, True)


def test_players_of_many_matches_differ_as_professionals_do() -> None:
    scene = load_scene("tennis")
    drawn = [a for seed in range(150) for a in draw_match(np.random.default_rng(seed), scene, name=f"s{seed}").athletes]
    assert len({a.identity for a in drawn}) == 300
    left = np.mean([a.figure.hand == "left" for a in drawn])
    assert 0.08 < left < 0.19
    assert 0.12 < np.mean([a.backhand_hands == 1 for a in drawn]) < 0.3
    assert len({a.figure.height_m for a in drawn}) > 290
    with pytest.raises(ValueError, match="court"):
        draw_match(np.random.default_rng(0), load_scene("blocks"), name="m")
