"""A reader of captions that knows English and tennis, and nothing of how captions are made.

`contradictions` takes a text apart: it crosses out every phrase that it understands and holds it against the play's own
numbers. What is left over must be words without a claim, so that no claim goes unread.
"""
# ruff: noqa: E501 (patterns stay whole)

import re

import numpy as np

from pgm_data.simulate.tennis.play import Play, Shot, Stroke
from tests.simulate.tennis.caption_events import read_end, read_opponent, read_waits
from tests.simulate.tennis.caption_motion_read import read_motion
from tests.simulate.tennis.caption_places import landing, read_places
from tests.simulate.tennis.caption_said import Said, World
from tests.simulate.tennis.caption_words import (
    GAITS,
    HARD,
    HIT,
    NEUTRAL,
    NOUNS,
    SHIFT,
    SOFT,
    SPLIT,
    STAY,
    STRETCH,
    verb,
)


def contradictions(play: Play, player: int, start: float, end: float, text: str) -> list[str]:
    """What a text says of the player from start to end that is not so, or that this reader does not understand."""
    said = Said(left=text, play=play, player=player, start=start, end=end)
    world = World(play, player)
    placement = said.cut(r"(?:at|into) the body of the opponent|at the opponent's body")
    read_waits(said, world)
    read_opponent(said, world)
    read_end(said, world)
    said.all(r"(?<=the serve )back|(?<=the ball )back")
    own = world.strokes(player, start, end)
    stroke, shot = own[-1] if own else (None, None)
    if own and shot is None:
        stroke, shot = own[0]
    verbs, hit_at = _verbs(said)
    hits = hit_at is not None
    said.must(not hits or stroke is not None, "tells of a stroke where there is none")
    said.must(stroke is None or hits, "does not tell of the stroke")
    window = _window(said, verbs, hit_at, stroke)
    told = read_places(said, world, verbs, stroke, shot, window)
    read_motion(said, world, window, stroke)
    if stroke is not None and hits:
        if placement:
            said.must(shot is not None and stroke.kind == "serve" and 1.3 < abs(landing(stroke, shot)[0]) < 2.8, "body")
        _read_stroke(said, world, stroke, shot, told)
    rest = set(re.sub(r"[_,]+", " ", said.left).split()) - NEUTRAL
    said.must(not rest, f"not understood: {sorted(rest)}")
    return [f"{wrong}: {text!r}" for wrong in said.wrong]


def _verbs(said: Said) -> tuple[list[tuple[int, str]], int | None]:
    """Where the text speaks of moving, staying and hitting, and where of the first hit."""
    scratch = Said(left=said.left, play=said.play, player=said.player, start=0, end=0)
    verbs: list[tuple[int, str]] = []
    scratch.all(rf"to (?:hit|reach|get to|catch up with) the ball|{SPLIT}|{STRETCH}")
    verbs += [
        (m.start(), "hit")
        for m in scratch.all(r"the ball (?:goes|ends|lands|touches|brushes)|that lands|which goes|that flies")
    ]
    verbs += [(m.start(), "stay") for m in scratch.all(f"{SHIFT}|{STAY}")]
    for pattern in GAITS.values():
        verbs += [(m.start(), "move") for m in scratch.all(pattern)]
    verbs += [(m.start(), "hit") for m in scratch.all(HIT)]
    verbs.sort()
    return verbs, next((at for at, kind in verbs if kind == "hit"), None)


def _window(said: Said, verbs: list, hit_at: int | None, stroke: Stroke | None) -> tuple[float, float]:
    """The time in which the player's motion is told: all of the span, or before or after the hit."""
    moved = next((at for at, kind in verbs if kind != "hit"), None)
    if stroke is None or hit_at is None or moved is None:
        return said.start, said.end
    before = moved < hit_at or "after" in said.left[hit_at:moved]
    return (said.start, stroke.time) if before else (stroke.time, said.end)


def _read_stroke(said: Said, world: World, stroke: Stroke, shot: Shot | None, told: set[str]) -> None:
    """The stroke's name, its hands, its spin and speed, and what came of it."""
    play, serve = said.play, stroke.kind == "serve"
    if shot is None:
        missed = said.all(
            rf"{verb('swing')}|{verb('miss')}(?: the ball)?|{verb('fail')} to touch it|{verb('tr-y', 'attempt')}|at the ball"
        )
        said.must(bool(missed), "does not tell of the miss")
    for m in said.all(r"forehand|backhand"):
        said.must(stroke.side == m.group(), m.group())
    for m in said.all(r"(two|double|one|single)-(?:handed|hand)"):
        said.must(
            stroke.side == "backhand" and stroke.hands == (2 if m.group(1) in ("two", "double") else 1), m.group()
        )
    toss = said.all(r"(?:toss|throw)(?:es|s|ing)? the ball(?: up| in the air)?")
    said.must(not toss or (serve and said.start < stroke.toss_time), "toss")
    for m in said.all(r"first|second"):
        said.must(serve and play.serve_number == (1 if m.group() == "first" else 2), m.group())
    named = {kind for kind, pattern in NOUNS.items() if said.all(pattern)}
    if serve:
        axis = play.ball.flights[shot.contact].spins[0] if shot else np.zeros(3)
        rpm = float(np.linalg.norm(axis)) * 60 / 2 / np.pi
        for m in said.all("flat|kick|topspin"):
            said.must(rpm < 1600 if m.group() == "flat" else rpm > 2400, m.group())
        said.must(
            named <= {"slice"} and ("slice" not in named or abs(axis[2]) > 0.6 * np.linalg.norm(axis)), str(named)
        )
        said.must(bool(said.all(verb("serv-e"))) or "ace" in told, "does not tell of the serve")
    else:
        passing = "passing" in named
        kind = stroke.kind if stroke.kind != "drive" or stroke.side != "overhead" else "smash"
        said.must(named - {"passing"} == ({kind} - {"drive"} if shot is not None else set()), f"{named} for {kind}")
        knot = min(int(stroke.time * 50), len(world.t) - 1)
        said.must(not passing or abs(play.plans[1 - said.player].path[knot, 1]) < 6.4, "passing")
        for m in said.all("heavy topspin|topspin|spinning|flat"):
            said.must(
                shot is not None and (abs(shot.spin_rpm) < 1000 if m.group() == "flat" else shot.spin_rpm > 1500),
                m.group(),
            )
    for m in said.all(HARD):
        said.must(shot is not None and shot.speed > (50 if serve else 33), m.group())
    for m in said.all(SOFT):
        said.must(shot is not None and shot.speed < 19, m.group())
    if shot is None:
        said.all(verb("hit"))
        return
    returned = re.search(r"\bserve\b|\breturn\b(?= with| to| into| down| cross)", said.left) is not None and not serve
    before = [s for s in play.strokes if s.time < stroke.time]
    said.must(not returned or (len(before) == 1 and before[0].kind == "serve"), "return of the serve")
    said.all(r"serve|return")
    said.all(
        HIT
        + rf"|{verb('get')}|lands|falls|ends|flies|goes|touches|brushes|error|mistake|shot|drive|stroke|groundstroke|back|it|point"
    )
    said.must("net" not in told or shot.result == "net", "net")
    said.must("out" not in told or shot.result == "out", "out")
    said.must(("let" in told) == (shot.result == "let"), "let")
    said.must("clip" not in told or play.ball.contacts[shot.contact + 1].kind == "net", "net cord")
    said.must(not ({"fault", "double_fault"} & told) or (serve and shot.result in ("net", "out")), "fault")
    said.must(("double_fault" in told) <= (play.outcome == "double_fault"), "double fault")
    said.must("ace" not in told or play.outcome == "ace", "ace")
    won = play.outcome in ("winner", "ace") and play.winner == said.player and world.last is shot
    said.must("winner" not in told or won, "winner")
    said.must(shot.result != "out" or "out" in told, "does not tell that it goes out")
    said.must(shot.result != "net" or "net" in told, "does not tell that it goes into the net")
    lands = bool(np.isfinite(shot.landing).all())
    said.must(shot.result != "in" or not lands or "target" in told, "does not tell where the ball goes")
