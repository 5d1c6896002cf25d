"""What a player decides to do with a ball: which stroke, where to, how fast, how sure.

Here x and y of places are the hitter's own: x to the hitter's right, y ahead over the net, origin under the net.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.tennis import shot_tables as tables
from pgm_data.simulate.tennis.play import Athlete, Side, StrokeKind
from pgm_data.simulate.tennis.shot_tables import Serves, Strokes, drawn


@dataclass(frozen=True, eq=False, kw_only=True)
class Situation:
    """What a player sees just before the contact."""

    athlete: Athlete
    ball: Float[np.ndarray, " 3"]
    """Contact, own x, y (below 0) and height."""
    opponent: Float[np.ndarray, " 2"]
    weaker: float
    """-1 where the opponent's backhand lies to the hitter's left, else 1."""
    side: Side
    hands: int
    stretch: float
    """0 at ease to 1 at the limit of reach."""
    effort: float
    """0 at rest to 1 at the limits of the legs."""
    pace: float
    """Speed of the ball that comes, m/s."""
    volley: bool
    """Whether the ball has not bounced."""
    since_bounce: float
    """Seconds."""
    returns: bool
    """Whether it is the return of a serve."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Intent:
    """What the player means to do, and how far that may go wrong."""

    kind: StrokeKind
    target: Float[np.ndarray, " 2"]
    """Where the ball is to land, own x, y."""
    speed: float
    """m/s."""
    topspin_rpm: float
    sidespin_rpm: float
    clearance: float
    """Least height over the net that the player is content with, metres."""
    high: bool
    """Whether the higher of two ways is meant."""
    elevation_sd: float
    """Radians."""
    azimuth_sd: float
    """Radians."""
    speed_sd: float
    """Share."""
    attacks: bool
    """Whether the player then goes to the net."""


def choose(rng: np.random.Generator, seen: Situation) -> Intent:
    """The decision for a stroke after the serve."""
    kind = _kind(rng, seen)
    table = _table(kind, seen)
    depth = drawn(rng, table.depth)
    across = _across(rng, seen, kind)
    chance = rng.random()
    speed = float(np.interp(chance, tables.CHANCES, table.speed)) * seen.athlete.power
    # Faster balls carry more spin within a kind too, but loosely.
    blend = 0.4 * chance + 0.6 * rng.random()
    spin = float(np.interp(blend, tables.CHANCES, table.topspin_rpm))
    if kind in ("drive", "slice"):
        spin *= seen.athlete.topspin
        speed *= 1.0 - 0.22 * seen.stretch
    if kind == "half_volley":
        speed *= 0.8
    return Intent(
        kind=kind,
        target=np.array([across, depth]),
        speed=speed,
        topspin_rpm=spin,
        sidespin_rpm=float(rng.normal(0.0, 250.0)),
        clearance=_clearance(rng, kind, seen),
        high=kind == "lob",
        attacks=_attacks(rng, seen, kind),
        **_scatter(rng, seen, table),
    )


def _kind(rng: np.random.Generator, seen: Situation) -> StrokeKind:
    if seen.side == "overhead":
        return "smash"
    if seen.volley:
        return "drop" if rng.random() < 0.08 and seen.stretch < 0.5 else "volley"
    own_depth, opposite = -seen.ball[1], seen.opponent[1]
    if seen.since_bounce < 0.13 and seen.ball[2] < 0.45:
        return "half_volley"
    lob, drop, touch = rng.random(3)
    if lob < (0.16 + 0.35 * seen.stretch if opposite < 7.0 else 0.012 + 0.06 * seen.stretch):
        return "lob"
    if opposite > 12.0 and seen.stretch < 0.4 and drop < (0.07 if own_depth < 12.0 else 0.012):
        return "drop"
    if seen.side == "backhand" and seen.athlete.backhand_hands == 2:
        # Two-handed players who come with one hand have chosen to slice.
        return "slice" if seen.hands == 1 else "drive"
    if seen.side == "backhand":
        share = 0.4
    else:
        share = 0.33 if seen.returns else 0.05
    return "slice" if touch < share + 0.75 * max(seen.stretch - 0.4, 0.0) else "drive"


def prefers_one_hand(rng: np.random.Generator, athlete: Athlete, *, returns: bool) -> bool:
    """Whether a two-handed player would rather slice the next backhand."""
    return athlete.backhand_hands == 2 and rng.random() < (0.22 if returns else 0.33)


def _table(kind: StrokeKind, seen: Situation) -> Strokes:
    side = "forehand" if seen.side != "backhand" else "backhand"
    if kind == "drive":
        return (tables.RETURN_DRIVES if seen.returns else tables.DRIVES)[side]
    if kind in ("slice", "half_volley"):
        return tables.SLICES[side]
    return {"volley": tables.VOLLEY, "smash": tables.SMASH, "lob": tables.LOB, "drop": tables.DROP}[kind]


def _across(rng: np.random.Generator, seen: Situation, kind: StrokeKind) -> float:
    x = float(seen.ball[0])
    reach = drawn(rng, tables.SIDEWAYS)
    side = "backhand" if seen.side == "backhand" else "forehand"
    share = tables.CROSS_SHARE[side]
    across = -np.sign(x) if abs(x) > 0.7 else (-1.0 if rng.random() < 0.5 else 1.0)
    # The emptier half draws the ball, the more so the further off the opponent stands.
    lean = np.log(share / (1 - share)) - 0.15 * across * float(np.clip(seen.opponent[0], -3.0, 3.0))
    lean += 0.3 * across * seen.weaker
    sign = across if rng.random() < 1.0 / (1.0 + np.exp(-lean)) else -across
    if kind == "lob":
        reach *= 0.75
    if sign != across and abs(x) > 3.5:
        # Around the post is not tried on purpose; down the line means along it.
        reach = max(reach, 2.2)
    return float(sign * reach * (1.0 - 0.3 * seen.stretch))


def _clearance(rng: np.random.Generator, kind: StrokeKind, seen: Situation) -> float:
    if kind in ("smash", "volley", "half_volley"):
        return 0.12
    if kind == "drop":
        return 0.2
    passing = seen.opponent[1] < 7.0
    return float(0.08 + (0.1 if passing else 0.35) * rng.random())


def _attacks(rng: np.random.Generator, seen: Situation, kind: StrokeKind) -> bool:
    own_depth = -float(seen.ball[1])
    if seen.volley or kind in ("smash", "half_volley"):
        return own_depth < 9.0
    if kind == "drop":
        return bool(own_depth < 10.5 and rng.random() < 0.5)
    chance = float(np.interp(own_depth, [7.5, 9.5, 11.0, 12.5], [0.9, 0.55, 0.2, 0.02]))
    return bool(kind != "lob" and rng.random() < chance * (0.4 + seen.athlete.attacks_net))


def _scatter(rng: np.random.Generator, seen: Situation, table: Strokes) -> dict[str, float]:
    hardness = seen.athlete.steadiness * (
        1.0
        + 1.5 * seen.stretch
        + 0.8 * seen.effort**2
        + 0.35 * float(np.clip((seen.pace - 22.0) / 15.0, 0.0, 1.0))
        + 0.6 * max(0.35 - float(seen.ball[2]), 0.0)
    )
    # Now and then the frame meets the ball.
    if rng.random() < 0.012 + 0.03 * seen.stretch:
        hardness *= 4.0
    return {
        "elevation_sd": float(np.radians(table.elevation_sd)) * hardness,
        "azimuth_sd": float(np.radians(table.azimuth_sd)) * hardness,
        "speed_sd": 0.025 * hardness,
    }


def choose_serve(rng: np.random.Generator, athlete: Athlete, *, right_court: bool, second: bool) -> Intent:
    """The decision for a serve; from the right court it goes to the left, so to negative x."""
    table: Serves = tables.SECOND_SERVES if second else tables.FIRST_SERVES
    way = rng.random()
    wide, body, _ = table.directions
    reach = drawn(rng, table.wide if way < wide else tables.BODY if way < wide + body else tables.CENTRE)
    chance = rng.random()
    # The harder a serve is hit, the less spin is left for it.
    blend = 0.55 * (1.0 - chance) + 0.45 * rng.random()
    curve = 1.0 if athlete.figure.hand == "right" else -1.0
    return Intent(
        kind="serve",
        target=np.array([-reach if right_court else reach, drawn(rng, table.depth)]),
        speed=float(np.interp(chance, tables.CHANCES, table.speed)) * athlete.power,
        topspin_rpm=float(np.interp(blend, tables.CHANCES, table.topspin_rpm)),
        sidespin_rpm=curve * float(np.interp(blend, tables.CHANCES, table.sidespin_rpm)),
        clearance=0.1 if not second else 0.15,
        high=False,
        elevation_sd=float(np.radians(table.elevation_sd)) * athlete.steadiness,
        azimuth_sd=float(np.radians(table.azimuth_sd)) * athlete.steadiness,
        speed_sd=0.012,
        attacks=not second and rng.random() < 0.06 * (0.5 + athlete.attacks_net),
    )
