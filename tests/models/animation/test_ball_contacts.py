"""Contacts of balls are found between frames, where, when and by whom they were, in worlds that are known."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pgm_data.caption.measures import play_of_clip
from pgm_data.dataset.clip_ball import EventRows
from pgm_data.scene import load_scene
from pgm_models.animation.ball_contacts import (
    contacts_of_ball,
    landing_to_come,
    one_clip,
    shots_of_contacts,
)
from pgm_models.animation.flight_breaks import flown
from tests.caption.rallies import facing
from tests.models.animation.conftest import read_rows

TENNIS = load_scene("tennis")
RADIUS, DRAG = 0.0335, 0.0203
NEAR, FAR = np.array([1.0, -12.5, 0.95]), np.array([-1.0, 12.5, 0.95])


@dataclass(frozen=True, eq=False, kw_only=True)
class Rally:
    """A ball's states at some times, and what happened to it."""

    times: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    roots: np.ndarray
    events: tuple[tuple[float, str, str, tuple[float, ...]], ...]
    """Time, kind, player, place."""


def stepped(position: np.ndarray, velocity: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """The slow obvious flight: many small steps."""
    steps = max(1, round(abs(seconds) * 20_000))
    h = seconds / steps
    for _ in range(steps):
        pull = -DRAG * np.linalg.norm(velocity) * velocity - [0.0, 0.0, 9.81]
        position = position + h * velocity + 0.5 * h * h * pull
        velocity = velocity + h * pull
    return position, velocity


def rally(fps: float, *, net: bool = False) -> Rally:
    """Two hits, with a bounce between them and one after; or a ball into the net."""
    h = 1e-3
    x, v = np.array([1.6, -12.0, 1.1]), np.array([-1.0, -14.0, 2.0])
    x, v = x - 0.3 * v, v
    hits = {0.3003: np.array([-2.4, 30.0, 1.0]) if net else np.array([-2.4, 22.0, 5.0])}
    states, events, time, players = [], [], 0.0, [("player0", NEAR), ("player1", FAR)]
    while time < (1.1 if net else 2.6):
        states.append((time, x, v))
        for at in [at for at in hits if time <= at < time + h]:
            events.append((at, "hit", players[len(events) > 0][0], tuple(x)))
            v = hits.pop(at)
        pull = -DRAG * np.linalg.norm(v) * v - [0.0, 0.0, 9.81]
        x, v = x + h * v + 0.5 * h * h * pull, v + h * pull
        if x[2] < RADIUS and v[2] < 0:
            events.append((time + h, "bounce", "", tuple(x)))
            v = v * [0.7, 0.7, -0.75]
        if net and abs(x[1]) < 0.05 and abs(v[1]) > 5 and x[2] < 0.9:
            events.append((time + h, "net", "", tuple(x)))
            v = np.array([0.2, -0.8, 0.0])
        if not net and v[1] > 0 and x[1] > 11.8:
            events.append((time + h, "hit", "player1", tuple(x)))
            v = np.array([3.0, -24.0, 6.0])
        time += h
    every = round(1 / fps / h)
    times, position, velocity = (np.array(part)[::every] for part in zip(*states, strict=True))
    roots = np.tile(np.stack([NEAR, [x[0], FAR[1], FAR[2]]]), (len(times), 1, 1))
    roots[:, 1, 0] = next((e[3][0] for e in events if e[2] == "player1"), 0.0)
    return Rally(times=times, position=position, velocity=velocity, roots=roots, events=tuple(events))


def found(world: Rally, **changed: np.ndarray) -> EventRows:
    made = replace(world, **changed)
    return contacts_of_ball(made.position, made.velocity, made.times, made.roots, TENNIS)


def told(events: EventRows) -> list[tuple[str, str]]:
    inside = ~np.isin(events.kind, ("first", "last"))
    return list(zip(events.kind[inside], events.player[inside], strict=True))


@pytest.mark.parametrize("fps", [50.0, 25.0, 12.5, 10.0])
@pytest.mark.parametrize("net", [False, True])
def test_contacts_of_a_known_rally_are_found_with_their_times_and_places(fps, net):
    world = rally(fps, net=net)
    events = found(world)
    assert told(events) == [(kind, player) for _, kind, player, _ in world.events]
    assert len(world.events) >= 3
    inside = ~np.isin(events.kind, ("first", "last"))
    np.testing.assert_allclose(events.time[inside], [event[0] for event in world.events], atol=2e-3)
    np.testing.assert_allclose(events.position[inside], [event[3] for event in world.events], atol=0.06)
    assert (np.diff(events.time) >= 0).all()
    assert events.kind[0] == "first" and events.kind[-1] == "last"
    assert set(events.source) == {"detected"}


def test_noise_moves_contacts_a_little_and_makes_none():
    world = rally(25.0)
    random = np.random.default_rng(5)
    off = []
    for _ in range(20):
        noisy = world.position + 0.05 * random.normal(size=world.position.shape)
        events = found(world, position=noisy, velocity=world.velocity + 0.5 * random.normal(size=noisy.shape))
        assert told(events) == [(kind, player) for _, kind, player, _ in world.events]
        inside = ~np.isin(events.kind, ("first", "last"))
        off.append(np.abs(events.time[inside] - [event[0] for event in world.events]))
    assert np.median(off) < 0.006 and np.max(off) < 0.04


def test_contacts_that_are_spread_over_frames_are_one():
    world = rally(25.0)
    smeared = []
    for values in (world.position, world.velocity):
        padded = np.concatenate([values[:1], values, values[-1:]])
        smeared.append(0.15 * padded[:-2] + 0.7 * values + 0.15 * padded[2:])
    events = found(world, position=smeared[0], velocity=smeared[1])
    assert told(events) == [(kind, player) for _, kind, player, _ in world.events]


def test_a_ball_that_flies_touches_nothing():
    times = np.arange(20) / 25.0
    start = np.array([[0.0, -11.0, 1.0]]), np.array([[1.0, 25.0, 6.0]])
    position, velocity = flown(np.repeat(start[0], 20, 0), np.repeat(start[1], 20, 0), times, TENNIS)
    roots = np.tile(np.stack([NEAR, FAR]), (20, 1, 1))
    events = contacts_of_ball(position, velocity, times, roots, TENNIS)
    assert list(events.kind) == ["first", "last"]


def test_a_hit_needs_a_player_within_reach():
    world = rally(25.0)
    away = world.roots + [6.0, 0.0, 0.0]
    assert "hit" not in found(world, roots=away).kind
    assert "hit" not in found(world, roots=np.full_like(world.roots, np.nan)).kind


def test_states_that_are_missing_part_the_play():
    world = rally(25.0)
    position = world.position.copy()
    position[20:24] = np.nan
    events = found(world, position=position)
    assert list(events.kind).count("first") == 2 and list(events.kind).count("last") == 2
    assert not ((events.time > world.times[19] + 1e-9) & (events.time < world.times[24] - 1e-9)).any()
    assert len(found(world, position=np.full_like(position, np.nan)).kind) == 0


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_the_shortest_plays_have_no_contacts(frames):
    world = rally(25.0)
    short = {name: getattr(world, name)[:frames] for name in ("position", "velocity", "times", "roots")}
    assert told(found(world, **short)) == []


def test_times_and_players_must_be_those_of_the_scene():
    world = rally(25.0)
    with pytest.raises(ValueError, match="times: expected ascending"):
        found(world, times=np.zeros_like(world.times))
    with pytest.raises(ValueError, match="roots: expected those of 2 players, got 1"):
        found(world, roots=world.roots[:, :1])


@pytest.mark.parametrize("seconds", [0.0, 0.013, 0.4, 1.7, -0.2])
def test_flight_is_that_of_many_small_steps(seconds):
    position, velocity = np.array([1.0, -11.0, 2.5]), np.array([3.0, 48.0, -4.0])
    x, v = flown(position, velocity, np.array(seconds), TENNIS)
    slow_x, slow_v = stepped(position, velocity, seconds)
    np.testing.assert_allclose(x, slow_x, atol=2e-3)
    np.testing.assert_allclose(v, slow_v, atol=3e-3)
    back = flown(x, v, np.array(-seconds), TENNIS)
    np.testing.assert_allclose(back[0], position, atol=1e-6)
    np.testing.assert_allclose(back[1], velocity, atol=1e-6)


def test_flights_of_many_balls_are_each_its_own_and_nan_stays():
    random = np.random.default_rng(0)
    x, v, t = random.normal(size=(7, 3)), 20 * random.normal(size=(7, 3)), random.uniform(-0.3, 0.9, 7)
    x[3] = np.nan
    one, two = flown(x, v, t, TENNIS)
    assert np.isnan(one[3]).all() and np.isfinite(one[[0, 1, 2, 4, 5, 6]]).all()
    for row in (0, 5):
        np.testing.assert_allclose(one[row], stepped(x[row], v[row], t[row])[0], atol=1e-4)
        np.testing.assert_allclose(two[row], stepped(x[row], v[row], t[row])[1], atol=1e-3)


def test_shots_lie_between_contacts_and_land_at_the_next_bounce():
    world = rally(25.0)
    events = found(world)
    shots = shots_of_contacts(events, world.position, world.velocity, world.times, TENNIS)
    assert (shots.end_event == shots.start_event + 1).all()
    hit = int(np.flatnonzero(events.kind[shots.start_event] == "hit")[0])
    bounce = next(event for event in world.events if event[1] == "bounce")
    np.testing.assert_allclose(shots.landing_position[hit, :2], bounce[3][:2], atol=0.05)
    assert shots.landing_position[hit, 2] == 0.0
    assert shots.start_speed[hit] == pytest.approx(np.linalg.norm([-2.4, 22.0, 5.0]), abs=0.1)
    assert np.isnan(shots.spin).all() and np.isnan(shots.in_probability).all()
    others = events.kind[shots.end_event] != "bounce"
    assert np.isnan(shots.landing_position[others]).all()


def test_a_landing_is_foretold_where_it_will_be():
    world = rally(25.0)
    bounce = next(event for event in world.events if event[1] == "bounce")
    before = int(np.searchsorted(world.times, bounce[0])) - 9
    row = landing_to_come(world.position[before], world.velocity[before], float(world.times[before]), TENNIS)
    assert row.time[0] == pytest.approx(bounce[0], abs=2e-3)
    np.testing.assert_allclose(row.position[0], bounce[3], atol=0.05)
    up = landing_to_come(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 40.0]), 0.0, TENNIS)
    assert len(up.time) == 0


def test_contacts_of_simulated_play_are_those_that_happened(tennis_dataset: Path):
    columns = read_rows(tennis_dataset)
    truth = pq.read_table(tennis_dataset / "events" / "chunk-000" / "file-000.parquet").to_pydict()
    episode = np.array(truth["episode_index"])
    hits = bounces = met = extra = 0
    for number in np.unique(columns["episode_index"]):
        rows = np.flatnonzero(columns["episode_index"] == number)
        own = {name: values[rows] for name, values in columns.items()}
        roots = np.stack([own[f"player{k}.root_position"] for k in (0, 1)], axis=1).astype(np.float64)
        times = own["frame.capture_time"]
        events = contacts_of_ball(own["ball.position"], own["ball.velocity"], times, roots, TENNIS)
        real = [k for k in np.flatnonzero(episode == number) if truth["kind"][k] in ("hit", "bounce")]
        for k in real:
            same = (events.kind == truth["kind"][k]) & (events.player == truth["player"][k])
            near = np.abs(events.time[same] - truth["time"][k])
            met += bool(len(near) and near.min() < 0.01)
            hits, bounces = hits + (truth["kind"][k] == "hit"), bounces + (truth["kind"][k] == "bounce")
        extra += int(np.isin(events.kind, ("hit", "bounce")).sum()) - len(real)
    assert hits > 10 and bounces > 10
    assert met >= 0.97 * (hits + bounces)
    assert extra <= 1


def made_columns(world: Rally) -> dict[str, np.ndarray]:
    """Columns of the contract of standing players about the rally's ball."""
    rows, columns = len(world.times), {"ball.position": world.position, "ball.velocity": world.velocity}
    for number, player in enumerate(TENNIS.players):
        assert player.skeleton is not None
        joints = len(player.skeleton.parents)
        root = world.roots[:, number]
        rotations = np.zeros((rows, joints, 3))
        rotations[:, 0] = facing(np.pi * number, rows)
        columns |= {
            f"{player.name}.root_position": root,
            f"{player.name}.joints": np.tile(root, joints),
            f"{player.name}.joint_rotations": rotations.reshape(rows, -1),
            f"{player.name}.joint_translations": np.zeros((rows, 3 * joints)),
        }
    return columns


def test_made_states_are_read_by_the_rules_that_read_data():
    world = rally(25.0)
    players, ball = one_clip(made_columns(world), world.times, TENNIS)
    assert ball is not None
    play = play_of_clip(players, ball, world.times, TENNIS, ("right", "right"))
    assert list(play.hits.player) == [0, 1]
    bounce = next(event for event in world.events if event[1] == "bounce")
    np.testing.assert_allclose(play.hits.landing[0], bounce[3][:2], atol=0.05)
    assert play.hits.side[0] == "forehand"


def test_the_past_and_the_landing_to_come_are_events_of_the_clip():
    world = rally(25.0)
    past = EventRows(
        time=np.array([-0.5]),
        kind=np.array(["hit"], dtype=object),
        player=np.array([""], dtype=object),
        probability=np.array([np.nan]),
        source=np.array(["detected"], dtype=object),
        position=np.full((1, 3), np.nan),
    )
    cut = replace(world, **{name: getattr(world, name)[:12] for name in ("times", "position", "velocity", "roots")})
    _, ball = one_clip(made_columns(cut), cut.times, TENNIS, past=past, lands=True)
    assert ball is not None
    assert list(ball.events.kind) == ["hit", "first", "hit", "last", "bounce"]
    bounce = next(event for event in world.events if event[1] == "bounce")
    assert ball.events.time[-1] == pytest.approx(bounce[0], abs=5e-3)


def test_a_missing_column_is_named():
    world = rally(25.0)
    columns = made_columns(world)
    del columns["player1.joints"]
    with pytest.raises(ValueError, match=r"player1\.joints: expected the column"):
        one_clip(columns, world.times, TENNIS)


def test_without_a_ball_there_is_none():
    world = rally(25.0)
    columns = {name: values for name, values in made_columns(world).items() if not name.startswith("ball.")}
    assert one_clip(columns, world.times, TENNIS)[1] is None
