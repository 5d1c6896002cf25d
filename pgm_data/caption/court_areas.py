"""Areas of a court as a player sees them who faces the net, and which of them a point is in for sure.

A player's own frame is the world turned so that the player looks along +y at the net: x to the player's right, beyond
the net y is above 0. Names that only some courts have (service boxes) are claimed on those alone.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.scene import Scene

SURE = 1.3
"""Standard deviations by which a point must lie inside of what is claimed: nine of ten."""
LEAST_COURT_M = 4.0
"""Half length above which players stand on a court and not beside a table."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtAreas:
    """Sizes of a court with a net, metres."""

    half_width: float
    """To the outer edge of the lines within which a ball in play must land."""
    half_length: float
    service_line: float
    """Distance of the service line from the net; NaN on courts without service boxes."""

    @property
    def has_boxes(self) -> bool:
        """Whether there are service boxes."""
        return bool(np.isfinite(self.service_line))

    @property
    def is_walked_on(self) -> bool:
        """Whether players stand on it."""
        return self.half_length > LEAST_COURT_M


def court_areas(scene: Scene) -> CourtAreas | None:
    """The areas of the scene's court; None where it has no net or does not say where balls may land."""
    court = scene.court
    if court is None or not court.net_top or not len(court.in_play):
        return None
    corner = np.abs(court.in_play).max(axis=(0, 1))
    line = float(np.abs(court.in_serve[..., 1]).max()) if len(court.in_serve) else float("nan")
    return CourtAreas(half_width=float(corner[0]), half_length=float(corner[1]), service_line=line)


def looks(scene: Scene) -> Int[np.ndarray, " players"]:
    """Of each player, whether it looks along world +y (1) or -y (-1) at the net; 0 where it plays on no one end."""
    found = []
    for player in scene.players:
        low, high = (corner[1] for corner in player.region_m) if player.region_m else (-1.0, 1.0)
        found.append(1 if high <= 0 else -1 if low >= 0 else 0)
    ends = np.array(found, dtype=np.int64)
    return ends if court_areas(scene) is not None else np.zeros_like(ends)


def across(
    x: Float[np.ndarray, " rows"], std: Float[np.ndarray, " rows"], *, middle: float, beside: float
) -> Shaped[np.ndarray, " rows"]:
    """`middle` up to `middle` metres, `left` or `right` from `beside` on, empty between and where it is not sure."""
    reach = SURE * std
    words = np.full(len(x), "", dtype=object)
    with np.errstate(invalid="ignore"):
        words[np.abs(x) + reach <= middle] = "middle"
        words[x - reach >= beside] = "right"
        words[x + reach <= -beside] = "left"
    return words


@dataclass(frozen=True, eq=False, kw_only=True)
class Target:
    """Where balls land, in words of `facts`."""

    zone: Shaped[np.ndarray, " hits"]
    side: Shaped[np.ndarray, " hits"]
    depth: Shaped[np.ndarray, " hits"]
    at_sideline: Bool[np.ndarray, " hits"]
    miss: Shaped[np.ndarray, " hits"]


def targets(
    landing: Float[np.ndarray, "hits 2"],
    std: Float[np.ndarray, "hits 2"],
    is_serve: Bool[np.ndarray, " hits"],
    areas: CourtAreas,
) -> Target:
    """The areas beyond the net that balls land in, in the hitting player's frame."""
    x, y = landing.T
    reach_x, reach_y = SURE * std.T
    count = len(x)
    scale = areas.half_width / 4.115
    with np.errstate(invalid="ignore"):
        inside = (np.abs(x) + reach_x <= areas.half_width) & (y - reach_y > 0) & (y + reach_y <= areas.half_length)
        zone = np.full(count, "", dtype=object)
        if areas.has_boxes:
            zone[inside & (y + reach_y <= areas.service_line)] = "box"
            zone[inside & (y - reach_y >= areas.service_line + 0.1)] = "land"
        else:
            zone[inside] = "court"
        depth = np.full(count, "", dtype=object)
        depth[inside & (y + reach_y <= 0.28 * areas.half_length)] = "short"
        depth[inside & (y - reach_y >= 0.81 * areas.half_length)] = "deep"
        at_sideline = inside & (np.abs(x) - reach_x >= areas.half_width - 0.75 * scale)
        side = across(x, std[:, 0], middle=1.0 * scale, beside=1.5 * scale)
        box = zone == "box"
        side[box] = across(x[box], std[box, 0], middle=0.0, beside=0.05)
        miss = _misses(x, y, reach_x, reach_y, is_serve, areas)
    return Target(zone=zone, side=side, depth=depth, at_sideline=at_sideline, miss=miss)


def _misses(x, y, reach_x, reach_y, is_serve, areas: CourtAreas) -> Shaped[np.ndarray, " hits"]:
    """`long` or `wide`; empty where a ball is neither, both, or not sure."""
    length = np.where(is_serve & areas.has_boxes, areas.service_line if areas.has_boxes else 0.0, areas.half_length)
    wide, narrow = np.abs(x) - reach_x > areas.half_width, np.abs(x) + reach_x < areas.half_width
    long, short = y - reach_y > length, y + reach_y < length
    miss = np.full(len(x), "", dtype=object)
    miss[long & narrow] = "long"
    miss[wide & short & (y - reach_y > 0)] = "wide"
    return miss


def directions(
    start_x: Float[np.ndarray, " hits"],
    end_x: Float[np.ndarray, " hits"],
    end_std: Float[np.ndarray, " hits"],
    areas: CourtAreas,
) -> Shaped[np.ndarray, " hits"]:
    """`cross` the middle to the other side, along the near `line`, or to the `middle`; empty where none is clear."""
    reach = SURE * end_std
    scale = areas.half_width / 4.115
    words = np.full(len(start_x), "", dtype=object)
    with np.errstate(invalid="ignore"):
        words[np.abs(end_x) + reach <= 0.9 * scale] = "middle"
        off = np.abs(start_x) >= 1.2 * scale
        other = start_x * end_x < 0
        words[off & other & (np.abs(end_x) - reach >= 1.7 * scale)] = "cross"
        along = np.abs(end_x - start_x) + reach <= 2.0 * scale
        words[off & ~other & along & (np.abs(end_x) - reach >= 2.2 * scale)] = "line"
    return words


def place(own: Float[np.ndarray, " 2"], std: Float[np.ndarray, " 2"], areas: CourtAreas | None) -> tuple[str, str]:
    """Where in its own half a player stands and on which side of it, in words of `facts`; empty where none is clear."""
    if areas is None or not areas.is_walked_on or not np.isfinite(own).all():
        return "", ""
    depth, reach = -float(own[1]), SURE * float(std[1])
    back, line = areas.half_length, areas.service_line
    low, high = depth - reach, depth + reach
    if areas.has_boxes:
        bands = (
            ("far back", back + 2.3, np.inf),
            ("behind", back + 0.6, back + 2.3),
            ("baseline", back - 0.7, back + 0.5),
            ("land", line + 0.6, back - 0.9),
            ("service line", line - 0.6, line + 0.5),
            ("box", 3.6, line - 0.6),
            ("net", 0.0, 3.3),
        )
    else:
        bands = (("back", 0.75 * back, np.inf), ("net", 0.0, 0.28 * back))
    word = next((name for name, nearest, furthest in bands if nearest <= low and high <= furthest), "")
    scale = areas.half_width / 4.115
    x = np.array([float(own[0])])
    return word, str(across(x, np.array([float(std[0])]), middle=0.9 * scale, beside=1.6 * scale)[0])
