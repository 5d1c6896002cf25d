"""What a caption says of how the player moves, held against the path."""

import re

import numpy as np

from pgm_data.simulate.tennis.play import Stroke
from tests.simulate.tennis.caption_said import Said, World
from tests.simulate.tennis.caption_words import GAITS, HALT, SHIFT, SPLIT, STAY, STRETCH


def read_motion(said: Said, world: World, window: tuple[float, float], stroke: Stroke | None) -> None:
    """Directions, gaits, starts, stops, split steps and stretches."""
    span = world.piece(said.start, said.end)
    piece = world.piece(*window)
    x, y, speed = world.x[piece], world.y[piece], world.speed[piece]
    peak, last = float(speed.max()), float(speed[-4:].min())
    if said.all(SPLIT):
        splits = said.play.plans[said.player].splits
        said.must(bool(((splits >= said.start) & (splits < said.end)).any()), "split step")
    if said.all(STRETCH):
        said.must(stroke is not None and stroke.stretch > 0.5, "stretch")
    said.all(r"to (?:reach|get to|hit|catch up with) the ball|after the ball|chasing the ball")
    sets_off = re.search(r"\bset(?:s|ting)? off\b", said.left)
    if said.all(r"(?:start|starts|starting|begin|begins|beginning)(?: to)?") or sets_off:
        said.must(float(speed[:4].min()) < 0.6 and float(speed[-4:].max()) > 0.7, "start")
    if said.all(HALT):
        said.must(last < 0.6 and peak > 0.8, f"stop at {last:.2f}")
    if said.all(SHIFT):
        moved = np.hypot(x[-1] - x[0], y[-1] - y[0])
        said.must(bool(moved < 0.6), f"small steps over {moved:.2f} m")
    if said.all(STAY):
        moved = (
            np.hypot(world.x[span] - x[0], world.y[span] - y[0]).max()
            if stroke is None
            else np.hypot(x - x[0], y - y[0]).max()
        )
        said.must(bool(moved < 0.45), f"stays over {moved:.2f} m")
    quick = said.all(r"quickly|swiftly|rapidly|in a hurry")
    said.must(not quick or peak > 3.0, "quick")
    slow = said.all(r"slowly|at a slow pace|without hurry")
    said.must(not slow or peak < 2.0, "slow")
    gaits: list[tuple[int, str]] = []
    for name, pattern in GAITS.items():
        gaits += [(m.start(), name) for m in said.all(pattern)]
    gaits.sort()
    fastest = {"jog": 3.6, "walk": 2.2, "step": 2.6, "sidestep": 4.2, "retreat": 4.5}
    slowest = {"sprint": 4.3, "run": 2.8, "jog": 1.8}
    for _, name in gaits:
        said.must(slowest.get(name, 0.0) <= peak, f"{name} at {peak:.1f} m/s")
        said.must(len(gaits) > 1 or peak <= fastest.get(name, np.inf), f"{name} at {peak:.1f} m/s")
    _read_ways(said, gaits, x, y)


def _read_ways(said: Said, gaits: list[tuple[int, str]], x: np.ndarray, y: np.ndarray) -> None:
    """The directions of each move, in order, against the path."""
    ways = [claim for kind, claim in said.claims if kind == "way"]
    if ("recover", 0) in said.claims:
        said.must(bool(abs(x[-1]) < 1.2 and abs(x[-1]) < abs(x[0])), "back to the middle")
    diagonal = bool(said.all("diagonally"))
    for m in said.all(r"(?:back )?(?:to|towards) (?:the|its) (left|right)(?: side)?|left|right"):
        ways.append((m.start(), m.group(1) or m.group()))
    ways += [(m.start(), "forward") for m in said.all("forwards?(?: again)?")]
    ways += [(m.start(), "back") for m in said.all("backwards?(?: again)?|back")]
    ways += [(at, "back") for at, name in gaits if name == "retreat"]
    legs: dict[int, set[str]] = {}
    for at, way in ways:
        leg = max((i for i, (start, _) in enumerate(gaits) if start <= at), default=-1)
        legs.setdefault(leg, set()).add(way)
    said.must(-1 not in legs, "a direction of no move")
    said.all(r"first(?= _)|turn(?:s|ing)? around")
    told = [legs[i] for i in sorted(legs)]
    said.must(len(told) <= 2, "more than two moves")
    if len(told) == 1:
        said.must(_goes(x, y, 0, len(x) - 1, told[0]), f"goes {told[0]} over {x[-1] - x[0]:.2f}, {y[-1] - y[0]:.2f} m")
        d = sorted((abs(x[-1] - x[0]), abs(y[-1] - y[0])))
        said.must(not diagonal or (d[0] > 0.3 and d[0] > 0.5 * d[1]), "diagonally")
    if len(told) == 2:
        n = len(x) - 1
        turns = (_goes(x, y, 0, k, told[0]) and _goes(x, y, k, n, told[1]) for k in range(2, n - 1))
        said.must(any(turns), f"goes {told[0]}, then {told[1]}")


def _goes(x: np.ndarray, y: np.ndarray, start: int, end: int, ways: set[str]) -> bool:
    """Whether the path goes all these ways, each by more than a hand and not just beside another one."""
    dx, dy = x[end] - x[start], y[end] - y[start]
    parts = {"right": dx, "left": -dx, "forward": dy, "back": -dy}
    return all(parts[way] > max(0.2, 0.4 * np.hypot(dx, dy)) for way in ways)
