"""Where objects are found in made pictures, and how far from where they are.

Players and the ball are found by what differs from the picture without them (`image_differences`). DISTANCES are those
of the middles of boxes, px: NaN where an object is not to be seen, inf where it is but nothing was found.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene
from pgm_models.image_detections import DetectionScore, boxes_of_masks, centres_of, match_centres
from pgm_models.image_differences import USUAL_HEIGHT, find_ball, find_player, moved_aside
from pgm_models.synthesis.evaluate_truth import TruePixels
from pgm_models.synthesis.object_boxes import scaled_pixels

ASIDE_PX = 14.0
"""How far from its place a ball is looked for to learn what is found by chance, px of pictures 288 px high."""


@dataclass(frozen=True, kw_only=True)
class FindOptions:
    """What counts as found. Lengths in px of pictures 288 px high; they grow with the height."""

    player_radius_px: float = 12.0
    """Of a player's match."""
    ball_radius_px: float = 6.0
    """Of a ball's."""
    near_px: float = 2.0
    """A ball no farther away is where it should be."""

    def radius_of(self, kind: str, height: int) -> float:
        """Of a match of an object of that kind in pictures of that height, px."""
        return (self.ball_radius_px if kind == "ball" else self.player_radius_px) * height / USUAL_HEIGHT


@dataclass(frozen=True, eq=False, kw_only=True)
class Places:
    """Where players and ball are in a frame, by object; only those that there are to be seen."""

    boxes: Mapping[str, Float[np.ndarray, " 4"]]
    """Of players: x0, y0, x1, y1, px."""
    ball_px: Float[np.ndarray, " 2"]
    """Of the ball's middle; NaN where it is not to be seen."""


def places_of(
    scene: Scene,
    size: tuple[int, int],
    camera: Camera,
    boxes_px: Float[np.ndarray, "objects 4"],
    ball_position: Float[np.ndarray, " 3"],
    truth: TruePixels | None,
) -> Places:
    """Where players and ball are to be seen in a frame.

    With the truth, a player's box is that of the pixels that show him, and a ball behind a player is not to be seen.
    Without it, boxes are those of bodies' joints with a margin, and a ball is seen wherever the picture has its place.

    Args:
        scene: What the frame shows.
        size: Width and height of the picture.
        camera: For pictures of that size.
        boxes_px: Of the scene's objects.
        ball_position: World metres; NaN where there is none.
        truth: What pixels show.
    """
    limits = np.array([size[0], size[1], size[0], size[1]]) - 1.0
    boxes = {}
    players = [number for number, thing in enumerate(scene.objects) if thing.kind == "player"]
    for number in players:
        box = np.clip(boxes_px[number].astype(np.float64), 0.0, limits)
        if truth is not None:
            factor = np.array([size[0] / truth.labels.shape[1], size[1] / truth.labels.shape[0]])
            box = scaled_pixels(boxes_of_masks(truth.labels == 1 + number).reshape(2, 2), factor).ravel()
        if np.isfinite(box).all() and (box[2:] > box[:2]).all():
            boxes[scene.objects[number].name] = box
    nowhere = np.full(2, np.nan)
    if not np.isfinite(ball_position).all():
        return Places(boxes=boxes, ball_px=nowhere)
    pixels, seen = project(camera, ball_position[None])
    inside = bool(seen[0]) and bool(((pixels[0] > -0.5) & (pixels[0] < np.array(size) - 0.5)).all())
    if inside and truth is not None:
        shape = np.array(truth.labels.shape[::-1])
        column, row = np.clip(np.rint(scaled_pixels(pixels[0], shape / np.array(size))).astype(int), 0, shape - 1)
        away = float(camera.R_cam_from_world[2] @ ball_position + camera.t_cam_from_world[2])
        hidden = truth.labels[row, column] in [1 + number for number in players]
        inside = not (hidden and float(truth.depth[row, column]) < away)
    return Places(boxes=boxes, ball_px=pixels[0] if inside else nowhere)


def found_distances(
    places: Places,
    picture: Float[np.ndarray, "3 height width"],
    without: Float[np.ndarray, "3 height width"],
    options: FindOptions,
) -> dict[str, float]:
    """How far from its place each object was found, px, by name; inf where it was not, `ball` NaN if not to be seen.

    Args:
        places: Where they are.
        picture: Made, or real.
        without: The same without players and ball.
        options: What counts as found.
    """
    height = picture.shape[1]
    distances = {
        name: _distance(box, find_player(picture, without, box), options.radius_of("player", height))
        for name, box in places.boxes.items()
    }
    place = places.ball_px
    if np.isfinite(place).all():
        box = np.concatenate([place, place])
        found = find_ball(picture, without, place)
        distances["ball"] = _distance(box, found, options.radius_of("ball", height))
    return distances


def chance_distance(
    places: Places,
    picture: Float[np.ndarray, "3 height width"],
    without: Float[np.ndarray, "3 height width"],
    options: FindOptions,
    rng: np.random.Generator,
) -> float:
    """How far from a place beside the ball's a ball is found where none is: inf where none is, NaN without a ball."""
    if not np.isfinite(places.ball_px).all():
        return float("nan")
    height = picture.shape[1]
    place = moved_aside(places.ball_px, ASIDE_PX * height / USUAL_HEIGHT, rng)
    found = find_ball(picture, without, place)
    return _distance(np.concatenate([place, place]), found, options.radius_of("ball", height))


def alpha_distances(places: Places, masks: Mapping[str, Bool[np.ndarray, "height width"]], radius: float) -> dict:
    """The distances of the boxes of the renderer's own masks, by player."""
    return {
        name: _distance(box, _boxes(boxes_of_masks(masks[name])[None]), radius)
        for name, box in places.boxes.items()
        if name in masks
    }


def _boxes(found: Float[np.ndarray, "found 4"]) -> Float[np.ndarray, "_ 4"]:
    return found[np.isfinite(found).all(axis=1)]


def _distance(box: Float[np.ndarray, " 4"], found: Float[np.ndarray, "found 4"], radius: float) -> float:
    _, _, distances = match_centres(centres_of(box[None]), centres_of(found), radius)
    return float(distances[0]) if len(distances) else float("inf")


def score_of(
    distances: Float[np.ndarray, " frames"], radius_px: float, size: tuple[int, int], *, alpha: bool = False
) -> DetectionScore:
    """ADD and MDR of an object's distances in all frames.

    Args:
        distances: px; NaN where the object is not to be seen, inf where it was not found.
        radius_px: Within which it was looked for.
        size: Width and height of the pictures.
        alpha: Whether the renderer's own masks told them, which then stands in the name.
    """
    found = np.isfinite(distances)
    return DetectionScore(
        total_px=float(distances[found].sum()),
        matched=int(found.sum()),
        valid=int((~np.isnan(distances)).sum()),
        radius_px=radius_px,
        size=size,
        found_by="alpha" if alpha else "detector",
    )


def near_share(distances: Float[np.ndarray, " frames"], near_px: float) -> float:
    """Share of the frames that show an object in which it was found no farther away; NaN where none does."""
    seen = ~np.isnan(distances)
    return float((distances[seen] <= near_px).mean()) if seen.any() else float("nan")
