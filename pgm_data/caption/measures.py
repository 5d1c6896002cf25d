"""The rules that read states and give facts: what captions are made of, and what generated play is scored by.

    play = play_of_clip(players, ball, capture_time, scene)
    facts = facts_of_clip(players, ball, capture_time, scene)

Pure functions of the tables. The same rules on states that a model made say what its players do.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.caption.contacts import Contacts, contacts_of, estimated_handedness
from pgm_data.caption.court_areas import CourtAreas, court_areas, looks, place
from pgm_data.caption.facts import HitFacts, PlayFacts, SpanFacts
from pgm_data.caption.movement import (
    Movement,
    PlayerPath,
    changes_of,
    leaps_of,
    movement_between,
    path_of,
    runs_of,
    split_steps,
)
from pgm_data.caption.spans import WALKS, Cuts, SpanOptions, cut
from pgm_data.caption.strokes import hit_facts
from pgm_data.dataset.clip_ball import ClipBall
from pgm_data.dataset.clip_players import ClipPlayers
from pgm_data.scene import Scene

LEAST_SPAN_S = 0.2
"""Shorter stretches of states say nothing."""
AFTER_OWN_S, AFTER_OTHER_S, AFTER_END_S = 0.25, 0.04, 0.4
"""Where spans end after a hit of the player, of another, after a point."""
RECOVERS_M = 0.9


@dataclass(frozen=True, eq=False, kw_only=True)
class Play:
    """One clip, read for facts."""

    clip_id: str
    capture_time: Float[np.ndarray, " frames"]
    paths: tuple[tuple[PlayerPath, ...], ...]
    """Of each player its uninterrupted stretches."""
    frames: tuple[tuple[tuple[int, int], ...], ...]
    """Of each of them its first frame and the frame after its last."""
    hits: HitFacts
    bounces_s: Float[np.ndarray, " bounces"]
    """Capture times of bounces and net contacts, s."""
    areas: CourtAreas | None
    handedness: tuple[str, ...]

    @property
    def has_net(self) -> bool:
        """Whether players face a net."""
        return self.areas is not None


def play_of_clip(
    players: ClipPlayers,
    ball: ClipBall | None,
    capture_time: Float[np.ndarray, " frames"],
    scene: Scene,
    handedness: tuple[str, ...] = (),
) -> Play:
    """Paths and hits of a clip.

    Args:
        players: States of the scene's players, a row a frame.
        ball: The ball's tables; None where there is none.
        capture_time: When each frame was taken, s.
        scene: What the clip shows.
        handedness: Of each player `left`, `right`, or empty to estimate it from the clip; empty for all.

    Raises:
        ValueError: If rows differ in number, or players are not the scene's.
    """
    rows, names = len(capture_time), tuple(player.name for player in scene.players)
    if tuple(track.name for track in players.players) != names:
        raise ValueError(f"players: expected {', '.join(names)}, got {', '.join(t.name for t in players.players)}")
    for what, got in [("players", len(players.video_frame))] + ([("ball", len(ball.status))] if ball else []):
        if got != rows:
            raise ValueError(f"{players.clip_id}: {what}: expected {rows} rows, as the clip has, got {got}")
    if handedness and len(handedness) != len(names):
        raise ValueError(f"handedness: expected one of each of {len(names)} players, got {len(handedness)}")
    look = looks(scene)
    areas = court_areas(scene)
    paths, frames = [], []
    for track, end in zip(players.players, look.tolist(), strict=True):
        runs = [(run, path_of(track, capture_time, *run, end)) for run in runs_of(track, capture_time)]
        paths.append(tuple(path for _, path in runs if path is not None))
        frames.append(tuple(run for run, path in runs if path is not None))
    contacts = contacts_of(players, ball, capture_time, scene, look) if ball is not None else None
    found = estimated_handedness(contacts, len(names)) if contacts is not None else ("",) * len(names)
    known = tuple(said or guess for said, guess in zip(handedness or ("",) * len(names), found, strict=True))
    return Play(
        clip_id=players.clip_id,
        capture_time=capture_time,
        paths=tuple(paths),
        frames=tuple(frames),
        hits=_hits(contacts, ball, scene, areas, known),
        bounces_s=_bounces(ball),
        areas=areas,
        handedness=known,
    )


def facts_of_clip(
    players: ClipPlayers,
    ball: ClipBall | None,
    capture_time: Float[np.ndarray, " frames"],
    scene: Scene,
    handedness: tuple[str, ...] = (),
) -> PlayFacts:
    """The facts of a clip over spans that are cut where something happens; arguments as of `play_of_clip`."""
    play = play_of_clip(players, ball, capture_time, scene, handedness)
    return facts_of_play(play, spans_of_play(play, WALKS if not play.has_net else SpanOptions()))


def spans_of_play(play: Play, options: SpanOptions) -> Int[np.ndarray, "spans 3"]:
    """Player, first frame and frame after the last of each span, by player and time; none where there is no state."""
    rows = []
    for player, (paths, frames) in enumerate(zip(play.paths, play.frames, strict=True)):
        for path, (first, last) in zip(paths, frames, strict=True):
            if path.times[-1] - path.times[0] < LEAST_SPAN_S:
                continue
            hits = play.hits.time[play.hits.player == player]
            own = hits[(hits > path.times[0]) & (hits < path.times[-1])]
            spans = cut(float(path.times[0]), float(path.times[-1]), _cuts(play, player, path), own, options)
            edges = first + np.searchsorted(play.capture_time[first:last], [start for start, _ in spans[1:]])
            edges = np.concatenate([[first], edges, [last]])
            rows += [(player, int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def _cuts(play: Play, player: int, path: PlayerPath) -> Cuts:
    hits = play.hits
    own, other = hits.time[hits.player == player], hits.time[hits.player != player]
    decided = hits.decided_s[np.isfinite(hits.decided_s)]
    changes = changes_of(path)
    if not play.has_net:
        changes = np.concatenate([changes, leaps_of(path)])
    parts = (
        (own + AFTER_OWN_S, 2.5),
        (other + AFTER_OTHER_S, 1.2),
        (decided + AFTER_END_S, 1.2),
        (play.bounces_s + 0.04, 0.3),
        (changes, 0.7),
    )
    times = np.concatenate([times for times, _ in parts])
    return Cuts(times=times, worth=np.concatenate([np.full(len(times), worth) for times, worth in parts]))


def facts_of_play(play: Play, spans: Int[np.ndarray, "spans 3"]) -> PlayFacts:
    """The facts of given spans (player, first frame, frame after the last), as of a caption that is to be judged."""
    rows = [_span(play, int(player), int(start), int(end)) for player, start, end in spans]
    columns = {}
    for name, dtype in SPAN_TYPES.items():
        columns[name] = np.array([row[name] for row in rows], dtype=dtype)
    return PlayFacts(
        clip_id=play.clip_id,
        hits=play.hits,
        spans=SpanFacts(**columns),
        handedness=play.handedness,
        has_net=play.has_net,
    )


SPAN_TYPES: dict[str, type] = {
    **dict.fromkeys(("player", "start_frame", "end_frame", "hit", "other_hit", "next_hit", "ended"), np.int64),
    **dict.fromkeys(("start_s", "end_s", "rise_m", "turn_deg", "distance_m", "top_speed_m_s"), np.float64),
    **dict.fromkeys(("starts", "stops", "split_step", "jumps", "centring", "serves"), np.bool_),
    **dict.fromkeys(
        ("motion", "way", "second_way", "gait", "place", "place_before", "place_side", "phase"), object
    ),
}  # fmt: skip


def _span(play: Play, player: int, start: int, end: int) -> dict:
    """One row of the spans' facts."""
    times = play.capture_time
    start_s = float(times[start])
    end_s = float(times[end]) if end < len(times) else float(times[-1])
    if end == len(times) and len(times) > 1:
        end_s += float(np.median(np.diff(np.unique(times)))) if len(np.unique(times)) > 1 else 0.0
    path = next((p for p in play.paths[player] if p.times[0] - 1e-6 <= start_s < p.times[-1]), None)
    hits = play.hits
    own = np.flatnonzero((hits.player == player) & (hits.time >= start_s) & (hits.time < end_s))
    other = np.flatnonzero((hits.player != player) & (hits.time >= start_s) & (hits.time < end_s))
    ended = np.flatnonzero((hits.decided_s >= start_s) & (hits.decided_s < end_s))
    hit = int(own[-1]) if len(own) else -1
    until = float(hits.time[hit]) if hit >= 0 else end_s
    # What a player does before the stroke is told of a span with one.
    until = end_s if until - start_s < 0.35 else until
    move = Movement() if path is None else movement_between(path, start_s, until, has_net=play.has_net)
    after = np.flatnonzero(hits.time >= end_s)
    following = int(after[0]) if len(after) and hits.player[after[0]] == player else -1
    row = {name: getattr(move, name) for name in Movement.__dataclass_fields__}
    return row | {
        "player": player,
        "start_frame": start,
        "end_frame": end,
        "start_s": start_s,
        "end_s": end_s,
        **_places(play, path, start_s, until),
        "split_step": _splits(play, player, path, start_s, end_s),
        "centring": _centres(play, player, path, move, start_s, until),
        "hit": hit,
        "other_hit": int(other[-1]) if len(other) else -1,
        "next_hit": following,
        "ended": int(ended[-1]) if len(ended) else -1,
        "phase": _phase(play, start_s, end_s),
        "serves": following >= 0 and hits.stroke[following] == "serve",
    }


def _knot(path: PlayerPath, time: float) -> int:
    return int(np.abs(path.times - time).argmin())


def _places(play: Play, path: PlayerPath | None, start_s: float, end_s: float) -> dict[str, str]:
    if path is None or play.areas is None:
        return {"place": "", "place_side": "", "place_before": ""}
    one, two = _knot(path, start_s), _knot(path, end_s)
    word, side = place(path.position[two], path.std[two], play.areas)
    before, _ = place(path.position[one], path.std[one], play.areas)
    return {"place": word, "place_side": side, "place_before": before}


def _splits(play: Play, player: int, path: PlayerPath | None, start_s: float, end_s: float) -> bool:
    if path is None or not play.has_net:
        return False
    knots = split_steps(path, play.hits.time[play.hits.player != player])
    inside = knots[(path.times[knots] >= start_s) & (path.times[knots] < end_s)]
    near_own = np.abs(play.hits.time[play.hits.player == player][:, None] - path.times[inside]) < 0.4
    return int((~near_own.any(axis=0)).sum()) >= 3


def _centres(play: Play, player: int, path: PlayerPath | None, move: Movement, start_s: float, end_s: float) -> bool:
    """Whether the player, having hit the ball last, comes in from a side to the middle."""
    if path is None or not play.has_net or move.motion != "moves":
        return False
    before = np.flatnonzero(play.hits.time < start_s + 0.1)
    if not len(before) or play.hits.player[before[-1]] != player:
        return False
    x0, x1 = path.position[_knot(path, start_s), 0], path.position[_knot(path, end_s), 0]
    return bool(abs(x0) - abs(x1) > RECOVERS_M and abs(x1) < 1.5 and abs(x1 - x0) > 0.6 * move.distance_m)


def _phase(play: Play, start_s: float, end_s: float) -> str:
    """Before the serve, in play, or after the point; empty where no hit tells."""
    hits = play.hits
    if not len(hits):
        return ""
    before = np.flatnonzero(hits.time < start_s)
    after = np.flatnonzero(hits.time >= end_s)
    ends = hits.decided_s[before[-1]] if len(before) else np.nan
    if len(after) and hits.stroke[after[0]] == "serve" and len(before) == len(hits) - len(after):
        if not len(before) or (np.isfinite(ends) and ends < start_s - 2.0):
            return "before"
    if len(before) and np.isfinite(ends) and ends < start_s:
        return "after"
    return "play" if len(before) and len(before) + len(after) >= len(hits) - 1 and not np.isfinite(ends) else ""


def _hits(
    contacts: Contacts | None,
    ball: ClipBall | None,
    scene: Scene,
    areas: CourtAreas | None,
    handedness: tuple[str, ...],
) -> HitFacts:
    if contacts is None or ball is None:
        return no_hits()
    return hit_facts(contacts, ball, scene, areas, handedness)


def no_hits() -> HitFacts:
    """The facts of a clip in which nothing is hit."""
    words = np.array([], dtype=object)
    number, whole, truth = np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.bool_)
    return HitFacts(
        event=whole,
        player=whole,
        time=number,
        stroke=words,
        side=words,
        hands=whole,
        is_return=truth,
        spin=words,
        pace=words,
        direction=words,
        zone=words,
        zone_side=words,
        depth=words,
        at_sideline=truth,
        outcome=words,
        miss=words,
        ending=words,
        decided_s=number,
        landing=np.zeros((0, 2)),
        landing_std=np.zeros((0, 2)),
        contact_height_m=number,
        speed_m_s=number,
        apex_m=number,
        topspin_rpm=number,
        topspin_std_rpm=number,
    )


def _bounces(ball: ClipBall | None) -> Float[np.ndarray, " bounces"]:
    if ball is None:
        return np.zeros(0)
    return ball.events.time[(ball.events.kind == "bounce") | (ball.events.kind == "net")]
