"""People of a COCO keypoints JSON as players: a dataset (images, annotations, categories) or a list of results.

Boxes are areas from the picture's corner and lose half a pixel here; keypoints are numbers of pixels, as ours. A
keypoint of v = 0 is not there, v = 1 (labelled, hidden) has a low score, v = 2 a score of 1; a list of results has
scores there. Which image is which frame: `coco_frames`. Who a person is: `player` of an annotation or of its
`attributes`, or the name of its category, where that is a player object of the scene; else where the feet stand, the
rows of one `track_id` together (`foreign_people`). Crowds and categories without people are passed over.

Source: cocodataset.org, data and results format; the standard deviations are those of its keypoint evaluation, which
its makers measured on 5000 images labelled twice.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pgm_data.convert.coco_file import (
    CocoCategory,
    categories_of,
    category_of,
    id_of,
    images_of,
    images_of_results,
    key_of,
    numbers_of,
    objects_of,
    plain_name,
    read_foreign_json,
    share_of,
    video_scale,
)
from pgm_data.convert.coco_frames import frames_of_images
from pgm_data.convert.foreign_people import (
    ForeignPeople,
    PeopleOptions,
    box_of_sides,
    boxes_with_centre_origin,
    chosen_rows,
    player_boxes,
)
from pgm_data.convert.posed_pictures import FieldError
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.people import PlayerBoxes, PlayerPoses
from pgm_data.scene import SceneObject

COCO_POINTS = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"),
)
"""What 51 numbers without names are."""
SPREAD = {
    "nose": 0.026,
    "eye": 0.025,
    "ear": 0.035,
    "shoulder": 0.079,
    "elbow": 0.072,
    "wrist": 0.062,
    "hip": 0.107,
    "knee": 0.087,
    "ankle": 0.089,
    "big_toe": 0.068,
    "heel": 0.066,
}
"""Rms distance of a label from where others put it, as a share of the root of the person's area, left and right alike.

Those of the feet are of COCO-WholeBody.
"""
OTHER_SPREAD = 0.08
"""Of points that COCO does not know."""
AREA_SHARE = 0.53
"""Of a box that is the person, as evaluations take it where no area is known."""
LEAST_SIGMA_PX = 0.5
MOST_POINTS = 1000


@dataclass(frozen=True, eq=False, kw_only=True)
class _Reading:
    """What is the same for all annotations."""

    players: tuple[SceneObject, ...]
    point_names: tuple[str, ...]
    """Points of the players' skeleton."""
    options: PeopleOptions
    has_scores: bool
    """Whether scores stand third of keypoints, not levels of visibility."""


@dataclass(kw_only=True)
class _Rows:
    """Annotations while they are read, one a person and frame."""

    frame: list[int] = field(default_factory=list)
    box: list[tuple[float, ...]] = field(default_factory=list)
    score: list[float] = field(default_factory=list)
    player: list[int] = field(default_factory=list)
    track: list[str] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    """(points, 3) in the order of the scene's points: x, y, score; NaN where not found."""


def read_coco_people(
    path: Path, clip: ClipCamera, players: tuple[SceneObject, ...], options: PeopleOptions | None = None
) -> tuple[PlayerBoxes, PlayerPoses]:
    """The players' boxes and points in the clip's frames.

    Points are those of the player's skeleton that the file knows, in the skeleton's order. A person without a box has
    that of its points.

    Args:
        path: The JSON file.
        clip: The clip, whose camera tells who stands where.
        players: Player objects of the scene.
        options: How the file is taken.

    Raises:
        ValueError: If the file cannot be read, holds no frame of the clip, or a field is not what it must be. The
            message names file, field, what was expected and found.
    """
    options = options or PeopleOptions()
    if not players or players[0].skeleton is None:
        raise ValueError(f"{path}: players: expected a scene with player objects, got one without")
    content = read_foreign_json(path)
    is_results = isinstance(content, list)
    annotations = objects_of(path, "annotations", content if is_results else key_of(path, content, "annotations"))
    images = images_of_results(path, annotations) if is_results else images_of(path, content)
    categories = {} if is_results else categories_of(path, content)
    frame = frames_of_images(path, images, clip, options.first_number)
    at = {image["id"]: (int(frame[row]), video_scale(path, row, image, options)) for row, image in enumerate(images)}
    reading = _Reading(
        players=players,
        point_names=players[0].skeleton.point_names,
        options=options,
        has_scores=is_results or _third_values(annotations) - {0, 1, 2} != set(),
    )
    rows = _Rows()
    seen: set[Any] = set()
    for index, annotation in enumerate(annotations):
        place = f"{path}: annotations[{index}]"
        try:
            if not is_results and id_of(annotation, "id", seen) is not None:
                seen.add(annotation["id"])
            image_id = annotation.get("image_id")
            if not isinstance(image_id, int | str) or image_id not in at:
                raise FieldError("image_id", "the id of an image of the file", repr(image_id)[:60])
            category = category_of(annotation, categories, is_results)
            own, scale = at[image_id]
            if category is None or own < 0 or annotation.get("iscrowd", 0):
                continue
            _append(rows, annotation, category, own, scale, reading)
        except FieldError as error:
            raise ValueError(str(error.at(place))) from error
    return _players(path, rows, clip, players, options)


def _append(
    rows: _Rows,
    annotation: dict[str, Any],
    category: CocoCategory,
    frame: int,
    scale: np.ndarray,
    reading: _Reading,
) -> None:
    points = _points(annotation, category, reading)
    points[:, :2] = (points[:, :2] + 0.5) * scale - 0.5
    box = np.full(4, np.nan)
    if annotation.get("bbox") is not None:
        x, y, w, h = numbers_of("bbox", annotation["bbox"], 4)
        box = boxes_with_centre_origin(np.array(box_of_sides("bbox", x, y, w, h)) * np.tile(scale, 2))
    elif np.isfinite(points[:, 0]).sum() > 1:
        low, high = np.nanmin(points[:, :2], axis=0), np.nanmax(points[:, :2], axis=0)
        if (high > low).all():
            box = np.concatenate([low, high])
    if not np.isfinite(box).all():
        return  # a person of whom nothing is said
    score = annotation.get("score", 1.0)
    rows.frame.append(frame)
    rows.box.append(tuple(box))
    rows.score.append(share_of("score", score))
    rows.points.append(points)
    attributes = annotation.get("attributes", {})
    attributes = attributes if isinstance(attributes, dict) else {}
    objects = [player.name for player in reading.players]
    said = annotation.get("player", attributes.get("player", category.name))
    rows.player.append(objects.index(said) if said in objects else -1)
    track = annotation.get("track_id", attributes.get("track_id"))
    if track is not None and not isinstance(track, int | str):
        raise FieldError("track_id", "a number or a text", repr(track)[:60])
    rows.track.append("" if track is None else str(track)[:100])


def _players(
    path: Path, rows: _Rows, clip: ClipCamera, players: tuple[SceneObject, ...], options: PeopleOptions
) -> tuple[PlayerBoxes, PlayerPoses]:
    assert players[0].skeleton is not None
    names = players[0].skeleton.point_names
    boxes = np.array(rows.box, dtype=np.float64).reshape(-1, 4)
    points = np.array(rows.points, dtype=np.float64).reshape(-1, len(names), 3)
    people = ForeignPeople(
        path=path,
        frame=np.array(rows.frame, dtype=np.int64),
        boxes_px=boxes,
        feet_px=np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1),
        score=np.array(rows.score, dtype=np.float64),
        player=np.array(rows.player, dtype=np.int64),
        track=np.array(rows.track, dtype=object),
    )
    chosen = chosen_rows(people, clip, players)
    known = np.flatnonzero(np.isfinite(points[..., 0]).any(axis=0))
    found = np.full((*chosen.shape, len(known), 3), np.nan)
    there = chosen >= 0
    found[there] = points[chosen[there]][:, known]
    placed = player_boxes(people, chosen, clip, players)
    sides = placed.boxes_px[..., 2:] - placed.boxes_px[..., :2]
    size = np.sqrt(AREA_SHARE * sides.prod(axis=-1))
    if options.sigma_px is None:
        # In each coordinate alone, of an rms distance in both.
        sigma = np.maximum(size[..., None] * _spreads(tuple(names[i] for i in known)) / np.sqrt(2), LEAST_SIGMA_PX)
    else:
        sigma = np.full(found.shape[:-1], options.sigma_px)
    return placed, PlayerPoses(
        names=placed.names,
        point_names=tuple(names[i] for i in known),
        points_px=found[..., :2],
        score=found[..., 2],
        sigma_px=np.where(np.isfinite(found[..., 0]), sigma, np.nan),
        points_ray=np.full((*found.shape[:-1], 3), np.nan),
    )


def _spreads(names: tuple[str, ...]) -> Float[np.ndarray, " points"]:
    plain = [name.removeprefix("left_").removeprefix("right_") for name in names]
    return np.array([SPREAD.get(name, OTHER_SPREAD) for name in plain])


def _points(annotation: dict[str, Any], category: CocoCategory, reading: _Reading) -> Float[np.ndarray, "points 3"]:
    """x, y, score of the scene's points; NaN where the annotation has none."""
    points = np.full((len(reading.point_names), 3), np.nan)
    raw = annotation.get("keypoints")
    if raw is None:
        return points
    if not isinstance(raw, list) or len(raw) % 3 or len(raw) > 3 * MOST_POINTS:
        got = f"{len(raw)} numbers" if isinstance(raw, list) else type(raw).__name__
        raise FieldError("keypoints", f"x, y, v of at most {MOST_POINTS} points", got)
    own = category.points or (COCO_POINTS if len(raw) == 3 * len(COCO_POINTS) else ())
    if len(own) * 3 != len(raw):
        raise FieldError("keypoints", f"3 numbers for each of {len(own)} named points", f"{len(raw)} numbers")
    values = np.array(numbers_of("keypoints", raw, len(raw))).reshape(-1, 3)
    if not reading.has_scores:
        values[:, 2] = np.array([0.0, reading.options.hidden_score, 1.0])[values[:, 2].astype(int)]
        values[values[:, 2] == 0, :2] = np.nan
        values[:, 2] = _stored_scores(annotation, values[:, 2])
    elif not ((values[:, 2] >= 0) & (values[:, 2] <= 1)).all():
        wrong = values[~((values[:, 2] >= 0) & (values[:, 2] <= 1)), 2][0]
        raise FieldError("keypoints", "v of 0, 1, 2, or throughout scores of 0 to 1", f"{wrong:g}")
    values[(values[:, 2] == 0) | np.isnan(values[:, 0])] = np.nan
    plain = [plain_name(name) for name in reading.point_names]
    for row, name in enumerate(own):
        if name in plain:
            points[plain.index(name)] = values[row]
    return points


def _stored_scores(annotation: dict[str, Any], scores: np.ndarray) -> np.ndarray:
    """Scores as our own export keeps them beside the three levels of v; else those of the levels."""
    raw = annotation.get("keypoint_scores")
    if not isinstance(raw, list) or len(raw) != len(scores):
        return scores
    stored = np.array([share_of("keypoint_scores", value) for value in raw])
    return np.where(scores > 0, stored, scores)


def _third_values(annotations: list[dict[str, Any]]) -> set:
    """What stands third of all keypoints."""
    values: set = set()
    for annotation in annotations:
        raw = annotation.get("keypoints")
        if isinstance(raw, list):
            values.update(value for value in raw[2::3] if isinstance(value, int | float))
    return values
