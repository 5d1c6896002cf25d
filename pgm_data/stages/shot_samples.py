"""Shots as plain numbers, of real matches and of simulated ones, and how far apart two samples lie.

All places are the hitter's own: across to the hitter's right (or to the racket's side, where it says so), depth
away from the net. Real files: one match's shots with a header of names, and another's Hawk-Eye event points; both have
x along the court, and players at either end.
"""

import csv
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.tennis.play import Play

Sample = dict[str, np.ndarray]
# Slower "shots" of the real file are balls knocked away after the point.
_SLOWEST = 12.0
_LEFT_HANDED = "CD34"


def distance(simulated: np.ndarray, real: np.ndarray) -> tuple[float, float]:
    """Wasserstein distance over the real one's standard deviation, and the histograms' overlap (1 is the same)."""
    chances = (np.arange(200) + 0.5) / 200
    moved = np.abs(np.quantile(simulated, chances) - np.quantile(real, chances)).mean() / real.std()
    low, high = np.quantile(real, [0.01, 0.99])
    bins = int(np.clip(np.sqrt(len(real)), 6, 16))
    edges = np.concatenate([[-np.inf], np.linspace(low, high, bins + 1)[1:-1], [np.inf]])
    shares = [np.histogram(sample, edges)[0] / len(sample) for sample in (simulated, real)]
    return float(moved), float(np.minimum(*shares).sum())


class _Gathered:
    """Lists of numbers by name."""

    def __init__(self) -> None:
        self._lists: defaultdict[str, list[float]] = defaultdict(list)

    def add(self, name: str, value: float) -> None:
        if np.isfinite(value):
            self._lists[name].append(value)

    def sample(self) -> Sample:
        return {name: np.array(values) for name, values in sorted(self._lists.items())}


def _place(into: _Gathered, shot: int, serve: int, ball: np.ndarray, landing: np.ndarray) -> None:
    """Contact (across, depth, height) and landing (across, depth) of the shot-th shot of a point."""
    kind = f"serve {serve}" if shot == 1 else "return" if shot == 2 else "rally"
    for name, value in zip(("across", "depth", "height"), ball, strict=True):
        into.add(f"{kind} contact {name}", value)
    for name, value in zip(("across", "depth"), landing, strict=True):
        into.add(f"{kind} landing {name}", value)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Manner:
    """How a shot was hit."""

    speed: float
    """m/s."""
    spin: float
    """rpm, signed."""
    interval: float
    """Seconds since the shot before; NaN of serves."""
    height: float
    """Of the contact, metres."""
    hitter: Float[np.ndarray, " 2"]
    """Across and depth from the net, metres."""
    receiver: Float[np.ndarray, " 2"]
    racket: float
    """1 of right-handers, -1 of left-handers."""


def _manner(into: _Gathered, shot: int, serve: int, stroke: str, manner: _Manner) -> None:
    """Speed, spin, time since the shot before, and both players' places."""
    kind = f"serve {serve}" if shot == 1 else "return" if shot == 2 else "rally"
    into.add(f"{kind} speed", manner.speed)
    if shot == 1:
        into.add(f"{kind} receiver depth", manner.receiver[1])
        into.add(f"{kind} receiver aside", abs(manner.receiver[0]))
        return
    if shot == 2:
        into.add("return spin", manner.spin)
        return
    into.add("rally interval", manner.interval)
    into.add("rally receiver depth", manner.receiver[1])
    into.add("rally receiver across", manner.receiver[0])
    into.add(f"{stroke} speed", manner.speed)
    into.add(f"{stroke} spin", manner.spin)
    into.add(f"{stroke} contact height", manner.height)
    into.add(f"{stroke} hitter depth", manner.hitter[1])
    into.add(f"{stroke} hitter to the racket's side", manner.hitter[0] * manner.racket)


def real_sample(folder: Path) -> Sample:
    """All quantities of both real files in the folder of ball data."""
    into = _Gathered()
    _read_shots(into, folder / "tennis_shots_example.csv")
    _read_points(into, folder / "hawkeye")
    return into.sample()


def _read_shots(into: _Gathered, path: Path) -> None:
    before: tuple[int, float] | None = None
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        shot, serve = int(row["shot_no"]), int(row["serve"])
        time = datetime.fromisoformat(row["shot_start_timestamp"].replace("Z", "+00:00")).timestamp()
        interval = time - before[1] if before is not None and before[0] == shot - 1 else np.nan
        before = (shot, time)
        if row["stroke"] == "unknown" or float(row["speed_ms"]) < _SLOWEST:
            continue
        x = float(row["ball_hit_x"])
        end = np.sign(x)

        landing = _own(row, "ball_bounce", end)
        if np.sign(float(row["ball_bounce_x"] or "nan")) == end:
            landing = np.full(2, np.nan)
        names = ("hitter", "receiver")
        # The file now and then swaps the two.
        hitter, receiver = names if np.sign(float(row["hitter_x"])) == end else names[::-1]
        _place(into, shot, serve, np.array([end * float(row["ball_hit_y"]), abs(x), float(row["ball_hit_z"])]), landing)
        manner = _Manner(
            speed=float(row["speed_ms"]),
            spin=float(row["spin_rpm"]),
            interval=float(interval),
            height=float(row["ball_hit_z"]),
            hitter=_own(row, hitter, end),
            receiver=_own(row, receiver, end),
            racket=float(-1.0 if row["hitter_external_id"] == _LEFT_HANDED else 1.0),
        )
        _manner(into, shot, serve, row["stroke"], manner)


def _own(row: dict[str, str], name: str, end: float) -> np.ndarray:
    """Across as the player at this end sees it, and depth from the net, whichever half."""
    return np.array([end * float(row[name + "_y"] or "nan"), abs(float(row[name + "_x"] or "nan"))])


def _read_points(into: _Gathered, folder: Path) -> None:
    events: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    serves: dict[str, int] = {}
    (trajectories,) = folder.glob("*_ball_trajectory.csv")
    with trajectories.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            serves[row["point_ID"]] = int(row["serve_num"])
            shot = events.setdefault((row["point_ID"], int(row["strike_index"])), {})
            shot.setdefault(row["position"], np.array([float(row[name]) for name in "xyz"]))
    for (point, shot), seen in events.items():
        if "hit" not in seen:
            continue
        x, y, z = seen["hit"]
        end = np.sign(x)
        landing = np.full(2, np.nan)
        if "bounce" in seen and np.sign(seen["bounce"][0]) != end:
            landing = np.array([end * seen["bounce"][1], abs(seen["bounce"][0])])
        _place(into, shot, serves[point], np.array([end * y, abs(x), z]), landing)
    (points,) = folder.glob("*_pbp.csv")
    with points.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["is_fault"] == "0":
                into.add("shots in a point", float(row["rally_length"]))


def simulated_sample(plays: Iterable[Play]) -> Sample:
    """The same quantities of simulated plays."""
    into = _Gathered()
    for play in plays:
        before = np.nan
        for number, shot in enumerate(play.shots, start=1):
            stroke = play.strokes[shot.stroke]
            forward = np.array([1.0, -1.0]) * (1.0 if shot.player == 0 else -1.0)
            places = [_at(play, player, stroke.time) for player in (shot.player, 1 - shot.player)]
            ball = np.array([*(forward * stroke.ball[:2]), stroke.ball[2]])
            landing = forward * shot.landing * np.array([1.0, -1.0])
            if not landing[1] > 0:
                landing = np.full(2, np.nan)
            _place(into, number, play.serve_number, ball, landing)
            manner = _Manner(
                speed=float(shot.speed),
                spin=float(shot.spin_rpm),
                interval=float(stroke.time - before),
                height=float(stroke.ball[2]),
                hitter=forward * places[0],
                receiver=forward * places[1] * np.array([1.0, -1.0]),
                racket=float(1.0 if play.athletes[shot.player].figure.hand == "right" else -1.0),
            )
            side = "backhand" if stroke.side == "backhand" else "forehand"
            _manner(into, number, play.serve_number, side, manner)
            before = stroke.time
        if play.outcome not in ("fault", "double_fault", "let"):
            into.add("shots in a point", float(sum(shot.result == "in" for shot in play.shots)))
    return into.sample()


def _at(play: Play, player: int, time: float) -> np.ndarray:
    plan = play.plans[player]
    return np.array([np.interp(time, plan.times, plan.path[:, axis]) for axis in (0, 1)])
