"""Named areas of a tennis court, as the players see them.

A player's own frame: the world turned so that the player looks along +y at the net: x to the player's right, y beyond
the net above 0. LEFT and RIGHT are those of the player that a caption is about: for places where this player stands and
as well for the areas across the net where its shots go, which are named as the hitting player sees them. Only DEUCE and
AD belong to the half that they name: the deuce side of a half is on the right of the player who plays there. A serve
from the server's deuce side therefore goes to the deuce service box, which the server sees on the left.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

SINGLES_HALF_WIDTH_M = 4.115
DOUBLES_HALF_WIDTH_M = 5.485
BASELINE_M = 11.885
SERVICE_LINE_M = 6.40

Side = Literal["left", "right", "middle", ""]
PlaceName = Literal["far_back", "behind", "baseline", "land", "service_line", "box", "net", ""]
TargetName = Literal[
    "box",
    "boxes",
    "deuce_box",
    "short_box",
    "tee",
    "service_line",
    "land",
    "corner",
    "baseline",
    "sideline",
    "half",
    "front",
]
Miss = Literal["long", "wide", "alley", "service_long", "box_wide", ""]
Course = Literal["cross", "line", "middle", ""]
Placement = Literal["tee", "body", "wide", ""]


@dataclass(frozen=True, eq=False, kw_only=True)
class Area:
    """One name of an area, with the side of it."""

    name: PlaceName | TargetName
    side: Side


def own_frame(player: int, world: Float[np.ndarray, "... 2"]) -> Float[np.ndarray, "... 2"]:
    """World positions or displacements in the frame of the player (0 near, 1 far)."""
    return world if player == 0 else -world


def side_of(x: float, *, middle: float, beside: float) -> Side:
    """Which side x is on: the middle up to `middle` metres, a side from `beside` on, nothing between the two."""
    if abs(x) <= middle:
        return "middle"
    if abs(x) < beside:
        return ""
    return "right" if x > 0 else "left"


def place_of(own: Float[np.ndarray, " 2"]) -> Area:
    """Where in its own half a player stands; a name or a side is empty where none fits clearly."""
    x, depth = float(own[0]), -float(own[1])
    name: PlaceName = ""
    if depth > 14.2:
        name = "far_back"
    elif depth > 12.5:
        name = "behind"
    elif 11.2 <= depth <= 12.3:
        name = "baseline"
    elif 7.1 <= depth <= 10.9:
        name = "land"
    elif 5.8 <= depth <= 6.9:
        name = "service_line"
    elif 3.6 <= depth <= 5.7 and abs(x) < 3.9:
        name = "box"
    elif 0.0 < depth <= 3.2:
        name = "net"
    return Area(name=name, side=side_of(x, middle=0.9, beside=1.6))


def targets_of(own: Float[np.ndarray, " 2"]) -> tuple[Area, ...]:
    """Every name of the area where a ball lands in the opponent's singles court, the most telling first."""
    x, y = float(own[0]), float(own[1])
    wide = abs(x)
    third = side_of(x, middle=1.1, beside=1.5)
    areas: list[Area] = []
    if abs(y - SERVICE_LINE_M) < 0.6 and wide < 0.8:
        areas.append(Area(name="tee", side=""))
    if 0 < y < SERVICE_LINE_M + 0.04 and wide > 0.05:
        box = "right" if x > 0 else "left"
        areas.append(Area(name="box", side=box))
        areas.append(Area(name="deuce_box", side=box))
        if y < 3.4:
            areas.append(Area(name="short_box", side=box))
    if 0 < y < SERVICE_LINE_M + 0.04 and wide < 0.7:
        areas.append(Area(name="boxes", side=""))
    if 0 < y < 2.6:
        areas.append(Area(name="front", side=third))
    if y > 9.6 and wide > 2.6:
        areas.append(Area(name="corner", side=third))
    if y > SERVICE_LINE_M + 0.3:
        areas.append(Area(name="land", side=third))
    if y > 10.5:
        areas.append(Area(name="baseline", side=third))
    if abs(y - SERVICE_LINE_M) < 0.7:
        areas.append(Area(name="service_line", side=third))
    if wide > 3.4:
        areas.append(Area(name="sideline", side=third))
    if third:
        areas.append(Area(name="half", side=third))
    return tuple(areas)


def miss_of(own: Float[np.ndarray, " 2"], *, serve: bool) -> tuple[Miss, Side]:
    """How a ball that landed in the own frame at `own` missed the court, and on which side; empty where unclear."""
    x, y = float(own[0]), float(own[1])
    side: Side = "right" if x > 0 else "left"
    wide, long = abs(x) > SINGLES_HALF_WIDTH_M + 0.02, y > BASELINE_M + 0.02
    if y <= 0 or (wide and long):
        return "", ""
    if serve:
        if y > SERVICE_LINE_M + 0.02 and not wide:
            return "service_long", side_of(x, middle=0.0, beside=1.0)
        return ("box_wide", side) if wide and y < SERVICE_LINE_M else ("", "")
    if long:
        return "long", side_of(x, middle=0.9, beside=1.5)
    if wide:
        return ("alley" if abs(x) < DOUBLES_HALF_WIDTH_M - 0.02 else "wide"), side
    return "", ""


def course_of(start: Float[np.ndarray, " 2"], end: Float[np.ndarray, " 2"]) -> Course:
    """Whether a ball goes cross court, down the line or to the middle; both ends in the hitter's frame."""
    if abs(end[0]) <= 0.9:
        return "middle"
    if abs(start[0]) < 1.2 or abs(end[0]) < 1.7:
        return ""
    if start[0] * end[0] < 0:
        return "cross"
    return "line" if abs(end[0] - start[0]) < 2.0 and abs(end[0]) > 2.2 else ""


def placement_of(landing: Float[np.ndarray, " 2"]) -> Placement:
    """Where in its box a serve lands."""
    wide = abs(float(landing[0]))
    if wide <= 1.1:
        return "tee"
    if 1.5 <= wide <= 2.6:
        return "body"
    return "wide" if wide >= 3.0 else ""
