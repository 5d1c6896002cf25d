"""People that another program found, given to the player objects of a scene.

A file may say itself which player a row is. Else a row goes to the player in whose region its feet stand, seen through
the clip's camera; rows of one track go together, by the median of their places, so that a track without a place of its
own in some frames keeps its player. Of several people in one region (a ball kid beside the player) the one nearest to
the region's middle is taken, as a share of the region's size; the others are passed over.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.convert.posed_pictures import LARGEST_SIDE, FieldError
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import meet_plane
from pgm_data.people import PlayerBoxes
from pgm_data.scene import SceneObject

LONGEST_PX = 1e6
"""No coordinate of a picture lies further from its origin, px."""


@dataclass(frozen=True, kw_only=True)
class PeopleOptions:
    """How foreign people are taken."""

    width: int | None = None
    """Width of the video's picture, px; where it is known, coordinates of pictures of another size are scaled to it."""
    height: int | None = None
    first_number: int | None = None
    """The number that the file gives to the video's first frame; None where it follows from the file."""
    corner_px: float = 0.0
    """Where a MOT file has the picture's top-left corner, px: 0 as trackers do, 1 as MOTChallenge's own annotations."""
    sigma_px: float | None = None
    """Standard deviation of each coordinate of a point, px; None for COCO's measured ones, which grow with the box."""
    hidden_score: float = 0.3
    """Score of a point that COCO calls labelled but not visible."""

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name in ("width", "height"):
            value = getattr(self, name)
            if value is not None and not 1 <= value <= LARGEST_SIDE:
                raise ValueError(f"{name}: expected 1 to {LARGEST_SIDE} px, got {value}")
        if (self.width is None) != (self.height is None):
            raise ValueError(f"width, height: expected both or none, got {self.width} x {self.height}")
        if self.first_number not in (None, 0, 1):
            raise ValueError(f"first_number: expected 0 or 1, got {self.first_number}")
        if self.sigma_px is not None and not 0 < self.sigma_px < np.inf:
            raise ValueError(f"sigma_px: expected above 0, got {self.sigma_px}")
        if not 0 <= self.hidden_score <= 1:
            raise ValueError(f"hidden_score: expected 0 to 1, got {self.hidden_score}")
        if not abs(self.corner_px) <= 1:
            raise ValueError(f"corner_px: expected at most 1 from 0, got {self.corner_px}")


@dataclass(frozen=True, eq=False, kw_only=True)
class ForeignPeople:
    """People in frames of a clip, one row a person and frame."""

    path: Path
    frame: Int[np.ndarray, " rows"]
    """Frame of the clip."""
    boxes_px: Float[np.ndarray, "rows 4"]
    """x0, y0, x1, y1, px; the centre of the top-left pixel is (0, 0)."""
    feet_px: Float[np.ndarray, "rows 2"]
    """The point between the feet, px."""
    score: Float[np.ndarray, " rows"]
    """0 to 1."""
    player: Int[np.ndarray, " rows"]
    """Player object that the file names; -1 where it names none."""
    track: Shaped[np.ndarray, " rows"]
    """What the file calls the person throughout; empty where nothing."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name, kind in (("frame", np.int64), ("player", np.int64), ("boxes_px", float), ("feet_px", float)):
            object.__setattr__(self, name, frozen(getattr(self, name), kind))
        object.__setattr__(self, "score", frozen(self.score))


def boxes_with_centre_origin(boxes: Float[np.ndarray, "*rows 4"]) -> Float[np.ndarray, "*rows 4"]:
    """Our boxes from those of COCO and of trackers, whose (0, 0) is the CORNER of the top-left pixel.

    The border is crossed here alone. COCO's boxes are areas from the picture's corner; its keypoints are numbers of
    pixels, as ours, and stay as they are.
    """
    return boxes - 0.5


def boxes_with_corner_origin(boxes: Float[np.ndarray, "*rows 4"]) -> Float[np.ndarray, "*rows 4"]:
    """The inverse of `boxes_with_centre_origin`."""
    return boxes + 0.5


def box_of_sides(field: str, x: float, y: float, width: float, height: float) -> tuple[float, float, float, float]:
    """x0, y0, x1, y1 of a corner and sides.

    Raises:
        FieldError: If a number is absurd, or a side is not above 0.
    """
    found = f"{x:g}, {y:g}, {width:g}, {height:g}"
    if not all(abs(value) <= LONGEST_PX for value in (x, y, width, height)):
        raise FieldError(field, f"numbers of at most {LONGEST_PX:g} px", found)
    if not (width > 0 and height > 0):
        raise FieldError(field, "a width and a height above 0", found)
    return x, y, x + width, y + height


def chosen_rows(people: ForeignPeople, clip: ClipCamera, players: tuple[SceneObject, ...]) -> np.ndarray:
    """The row of each player in each frame, (frames, players); -1 where there is none.

    Raises:
        ValueError: If the scene has no player object, or the file names one player twice in a frame.
    """
    if not players:
        raise ValueError(f"{people.path}: players: expected a scene with player objects, got one without")
    rows = np.full((len(clip.status), len(players)), -1)
    cost = _costs(people, clip, players)
    for player, best in enumerate(cost.T):
        stated = np.flatnonzero(people.player == player)
        frames, first, counts = np.unique(people.frame[stated], return_index=True, return_counts=True)
        if (counts > 1).any():
            frame = frames[counts > 1][0]
            name = players[player].name
            raise ValueError(f"{people.path}: frame {frame}: {name}: expected one such person, got {counts.max()}")
        rows[frames, player] = stated[first]
        free = np.flatnonzero((people.player < 0) & (best < np.inf) & (rows[people.frame, player] < 0))
        order = free[np.lexsort((best[free], people.frame[free]))]
        frames, first = np.unique(people.frame[order], return_index=True)
        rows[frames, player] = order[first]
    return rows


def _costs(
    people: ForeignPeople, clip: ClipCamera, players: tuple[SceneObject, ...]
) -> Float[np.ndarray, "rows players"]:
    """How far each row is from the middle of each player's region, 1 at its border; inf where it is not that player."""
    ground = ground_world(people.feet_px, people.frame, clip, players)
    own = np.stack([_outside(ground[:, i], player) for i, player in enumerate(players)], axis=1)
    own[np.isnan(own)] = np.inf
    only = _only(own)
    cost = np.where(only, own, np.inf)
    tracks = people.track.astype(str)
    for track in np.unique(tracks[tracks != ""]):
        rows = np.flatnonzero(tracks == track)
        named = np.unique(people.player[rows][people.player[rows] >= 0])
        if len(named) == 1:  # the file said so in some of its rows
            cost[rows] = np.inf
            cost[rows, named[0]] = 0.0
            continue
        known = rows[np.isfinite(own[rows]).any(axis=1)]
        middle = np.median(own[known], axis=0) if len(known) else np.full(len(players), np.inf)
        player = int(middle.argmin())
        if middle[player] <= 1.0:
            # Where its feet plainly stand with the other player, the track has changed over to that one.
            kept = rows[~(only[rows].any(axis=1) & ~only[rows, player])]
            cost[kept] = np.inf
            cost[kept, player] = middle[player]
    return cost


def _only(own: Float[np.ndarray, "rows players"]) -> np.ndarray:
    """Which player each row is nearest to, within its region."""
    only = np.zeros(own.shape, dtype=bool)
    nearest = own.argmin(axis=1)
    rows = np.flatnonzero(own.min(axis=1) <= 1.0) if len(own) else np.zeros(0, dtype=int)
    only[rows, nearest[rows]] = True
    return only


def _outside(ground: Float[np.ndarray, "rows 2"], player: SceneObject) -> Float[np.ndarray, " rows"]:
    if not player.region_m:
        return np.zeros(len(ground))
    low, high = (np.array(corner[:2]) for corner in player.region_m)
    return np.abs((ground - (low + high) / 2) / ((high - low) / 2)).max(axis=1)


def ground_world(
    feet_px: Float[np.ndarray, "rows 2"],
    frame: Int[np.ndarray, " rows"],
    clip: ClipCamera,
    players: tuple[SceneObject, ...],
) -> Float[np.ndarray, "rows players 2"]:
    """World x and y of feet on each player's ground, metres; NaN where the frame has no camera or no feet."""
    camera = clip.camera[frame]
    heights = [player.region_m[0][2] if player.region_m else 0.0 for player in players]
    return np.stack([meet_plane(camera, feet_px[:, None], height)[:, 0, :2] for height in heights], axis=1)


def player_boxes(
    people: ForeignPeople, rows: np.ndarray, clip: ClipCamera, players: tuple[SceneObject, ...]
) -> PlayerBoxes:
    """The boxes of the chosen rows; status `measured` where there is one."""
    there = rows >= 0
    frames, who = np.nonzero(there)
    chosen = rows[frames, who]
    boxes, score, ground = (
        np.full((*rows.shape, 4), np.nan),
        np.full(rows.shape, np.nan),
        np.full((*rows.shape, 2), np.nan),
    )
    boxes[frames, who] = people.boxes_px[chosen]
    score[frames, who] = people.score[chosen]
    on_ground = ground_world(people.feet_px[chosen], frames, clip, players)
    ground[frames, who] = on_ground[np.arange(len(chosen)), who]
    return PlayerBoxes(
        names=tuple(player.name for player in players),
        boxes_px=boxes,
        score=score,
        ground_world=ground,
        status=np.where(there, "measured", "none").astype(object),
    )
