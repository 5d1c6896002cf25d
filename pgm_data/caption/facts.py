"""What can be said of a play, as structures of arrays: hits, and spans of what one player does.

Words are those of the caption and never of a colour that the tracks do not show: an empty word says that nothing can be
claimed. LEFT and RIGHT are those of the player that a row is about, facing the net, for areas across the net as well.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

STROKES = ("serve", "smash", "lob", "drop shot", "volley", "half volley", "groundstroke", "")
SIDES = ("forehand", "backhand", "overhead", "")
SPINS = ("topspin", "flat", "slice", "")
PACES = ("hard", "soft", "")
DIRECTIONS = ("cross", "line", "middle", "")
ZONES = ("box", "land", "court", "")
DEPTHS = ("short", "deep", "")
ACROSS = ("left", "right", "middle", "")
OUTCOMES = ("in", "out", "net", "let", "")
MISSES = ("long", "wide", "")
ENDINGS = ("ace", "winner", "fault", "error", "")
MOTIONS = ("still", "moves", "turns", "shifts", "")
GAITS = ("sprint", "run", "jog", "walk", "sidestep", "backpedal", "step", "move", "")
OWN_WAYS = ("left", "right", "forward", "back", "left forward", "right forward", "left back", "right back")
COMPASS = ("north", "north east", "east", "south east", "south", "south west", "west", "north west")
"""Clockwise from world +y, by eighths of a turn; the ways of scenes without a net."""
PLACES = ("far back", "behind", "baseline", "land", "service line", "box", "net", "back", "")
PHASES = ("before", "play", "after", "")


@dataclass(frozen=True, eq=False, kw_only=True)
class HitFacts:
    """One row a hit whose player is known, in order of time.

    Raises:
        ValueError: If columns differ in length, or a word is not one of its column's.
    """

    event: Int[np.ndarray, " hits"]
    """Row among the clip's events."""
    player: Int[np.ndarray, " hits"]
    """Index of the player object."""
    time: Float[np.ndarray, " hits"]
    """Capture time, s."""
    stroke: Shaped[np.ndarray, " hits"]
    """Of `STROKES`."""
    side: Shaped[np.ndarray, " hits"]
    """Of `SIDES`."""
    hands: Int[np.ndarray, " hits"]
    """On the racket of a backhand: 1 or 2; 0 where unknown."""
    is_return: Bool[np.ndarray, " hits"]
    """Whether it returns a serve."""
    spin: Shaped[np.ndarray, " hits"]
    """Of `SPINS`."""
    pace: Shaped[np.ndarray, " hits"]
    """Of `PACES`."""
    direction: Shaped[np.ndarray, " hits"]
    """Of `DIRECTIONS`: crossing the middle, along the line, to the middle."""
    zone: Shaped[np.ndarray, " hits"]
    """Of `ZONES`, where it lands: a service box, between service line and baseline, in a court without boxes."""
    zone_side: Shaped[np.ndarray, " hits"]
    """Of `ACROSS`, as the hitting player sees it; of a ball taken in the air, where it was taken."""
    depth: Shaped[np.ndarray, " hits"]
    """Of `DEPTHS`: just behind the net, or close to the baseline."""
    at_sideline: Bool[np.ndarray, " hits"]
    """Whether it lands beside a sideline."""
    outcome: Shaped[np.ndarray, " hits"]
    """Of `OUTCOMES`."""
    miss: Shaped[np.ndarray, " hits"]
    """Of `MISSES`, of balls that land out."""
    ending: Shaped[np.ndarray, " hits"]
    """Of `ENDINGS`: how the point ended with it."""
    decided_s: Float[np.ndarray, " hits"]
    """Capture time at which its ending shows, s; NaN where it has none."""
    landing: Float[np.ndarray, "hits 2"]
    """The hitting player's frame (x to its right, y beyond the net), metres; NaN where unknown."""
    landing_std: Float[np.ndarray, "hits 2"]
    """Metres."""
    contact_height_m: Float[np.ndarray, " hits"]
    """Above the ground."""
    speed_m_s: Float[np.ndarray, " hits"]
    """After the hit."""
    apex_m: Float[np.ndarray, " hits"]
    """Highest point until the next contact, above the ground."""
    topspin_rpm: Float[np.ndarray, " hits"]
    """Revolutions a minute about the axis across its way; backspin below 0; NaN where unknown."""
    topspin_std_rpm: Float[np.ndarray, " hits"]

    def __post_init__(self) -> None:
        """Check lengths and words."""
        _check(self, len(self.event), "hits", HIT_WORDS)

    def __len__(self) -> int:
        """Number of hits."""
        return len(self.event)


HIT_WORDS = {
    "stroke": STROKES,
    "side": SIDES,
    "spin": SPINS,
    "pace": PACES,
    "direction": DIRECTIONS,
    "zone": ZONES,
    "zone_side": ACROSS,
    "depth": DEPTHS,
    "outcome": OUTCOMES,
    "miss": MISSES,
    "ending": ENDINGS,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class SpanFacts:
    """One row a span of one player's frames, by player and time.

    Raises:
        ValueError: If columns differ in length, or a word is not one of its column's.
    """

    player: Int[np.ndarray, " spans"]
    start_frame: Int[np.ndarray, " spans"]
    end_frame: Int[np.ndarray, " spans"]
    """Frame after the last."""
    start_s: Float[np.ndarray, " spans"]
    """Capture time, s."""
    end_s: Float[np.ndarray, " spans"]
    motion: Shaped[np.ndarray, " spans"]
    """Of `MOTIONS`: stays, goes one way, goes there and back, takes small steps on the spot."""
    way: Shaped[np.ndarray, " spans"]
    """Of `OWN_WAYS`, in scenes without a net of `COMPASS`; of a turn, the first one."""
    second_way: Shaped[np.ndarray, " spans"]
    """Of a turn."""
    gait: Shaped[np.ndarray, " spans"]
    """Of `GAITS`."""
    starts: Bool[np.ndarray, " spans"]
    """Stands at first and moves at the end."""
    stops: Bool[np.ndarray, " spans"]
    """Moves at first and stands at the end."""
    split_step: Bool[np.ndarray, " spans"]
    """Hops on the spot as the opponent hits."""
    jumps: Bool[np.ndarray, " spans"]
    """Leaves the ground, upwards."""
    rise_m: Float[np.ndarray, " spans"]
    """Of the root, from start to end."""
    turn_deg: Float[np.ndarray, " spans"]
    """Of the body, anticlockwise from above; NaN where unknown."""
    distance_m: Float[np.ndarray, " spans"]
    """From start to end, level."""
    top_speed_m_s: Float[np.ndarray, " spans"]
    """Level."""
    place: Shaped[np.ndarray, " spans"]
    """Of `PLACES`, at the end."""
    place_side: Shaped[np.ndarray, " spans"]
    """Of `ACROSS`."""
    place_before: Shaped[np.ndarray, " spans"]
    """Of `PLACES`, at the start."""
    centring: Bool[np.ndarray, " spans"]
    """Comes back from a side to the middle after an own hit."""
    hit: Int[np.ndarray, " spans"]
    """Row of the own hit in the span; -1 where there is none."""
    other_hit: Int[np.ndarray, " spans"]
    """Row of the last hit of another in the span; -1 where there is none."""
    next_hit: Int[np.ndarray, " spans"]
    """Row of the next own hit after the span, before any other's; -1 where there is none."""
    ended: Int[np.ndarray, " spans"]
    """Row of the hit whose ending shows in the span; -1 where there is none."""
    phase: Shaped[np.ndarray, " spans"]
    """Of `PHASES`, of the point."""
    serves: Bool[np.ndarray, " spans"]
    """Whether the player serves next, before the serve."""

    def __post_init__(self) -> None:
        """Check lengths and words."""
        _check(self, len(self.player), "spans", SPAN_WORDS)

    def __len__(self) -> int:
        """Number of spans."""
        return len(self.player)


WAYS = ("", *OWN_WAYS, *COMPASS)
SPAN_WORDS = {
    "motion": MOTIONS,
    "way": WAYS,
    "second_way": WAYS,
    "gait": GAITS,
    "place": PLACES,
    "place_before": PLACES,
    "place_side": ACROSS,
    "phase": PHASES,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayFacts:
    """What can be said of one clip."""

    clip_id: str
    hits: HitFacts
    spans: SpanFacts
    handedness: tuple[str, ...]
    """Of each player: left, right, or empty where unknown."""
    has_net: bool
    """Whether ways are those of players who face a net."""


def _check(facts: HitFacts | SpanFacts, rows: int, what: str, words: dict[str, tuple[str, ...]]) -> None:
    for name in facts.__dataclass_fields__:
        if len(getattr(facts, name)) != rows:
            raise ValueError(f"{what}: {name}: expected {rows} rows, got {len(getattr(facts, name))}")
    for name, known in words.items():
        stray = sorted(set(getattr(facts, name)) - set(known))
        if stray:
            raise ValueError(f"{what}: {name}: expected one of {', '.join(known)}, got {stray[0]!r}")
