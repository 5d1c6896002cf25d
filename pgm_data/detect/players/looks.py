"""What players look like: the colours of hair, shirt, shorts, legs and shoes, seen through the points of their bodies.

Colours are CIE L*a*b* (D65): L 0 to 100, a and b about -100 to 100. Distances of a few units are barely seen.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import Pictures
from pgm_data.people import PlayerBoxes, PlayerLooks, PlayerPoses

PARTS = ("hair", "shirt", "shorts", "legs", "shoes")
NUMBERS = (*(f"{part}_{axis}" for part in PARTS for axis in "Lab"), "shirt_spread", "shorts_spread")
"""What a descriptor says: median colours, and half of the range of 80 % of the lightness."""
STANDING = {
    **{"left_ear": (0.56, 0.07), "right_ear": (0.44, 0.07)},
    **{"left_shoulder": (0.66, 0.2), "right_shoulder": (0.34, 0.2), "left_hip": (0.6, 0.51), "right_hip": (0.4, 0.51)},
    **{"left_knee": (0.62, 0.73), "right_knee": (0.38, 0.73), "left_ankle": (0.64, 0.94), "right_ankle": (0.36, 0.94)},
}
"""Points of a standing body as shares of its box, for bodies whose points nobody knows."""
BESIDE = (0.15, 0.45)
"""How far beside its box, in widths of the box, the surroundings are looked at."""
LIKE_SURROUNDINGS = 8.0
"""A sample this close to the colour beside the body at its height may be seen past the body."""
LEAST_KEPT = 0.3
"""Share of a part's samples that must differ from the surroundings; else all of them count."""


@dataclass(frozen=True, kw_only=True)
class LookOptions:
    """How much is looked at.

    Raises:
        ValueError: If a number is below 1.
    """

    frames: int = 30
    """Of a clip, spread over it."""
    frames_a_run: int = 6
    """At least so many between two cuts, where there are so many."""
    least_height_px: float = 20.0
    """Smaller bodies are not looked at."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("frames", "frames_a_run", "least_height_px"):
            if getattr(self, name) < 1:
                raise ValueError(f"look options: {name}: expected at least 1, got {getattr(self, name)}")


def look(
    pictures: Pictures,
    boxes: PlayerBoxes,
    poses: PlayerPoses | None,
    clip: ClipCamera,
    *,
    cut: Bool[np.ndarray, " frames"] | None = None,
    options: LookOptions | None = None,
) -> PlayerLooks:
    """What the players look like in some frames of the clip; NaN in the others.

    Args:
        pictures: A fresh pass over the pictures.
        boxes: Where the players are.
        poses: Points of their bodies; without them a body is taken to stand upright in its box.
        clip: Which frames repeat others.
        cut: Whether each frame is the first after a cut, so that each run between cuts is looked at.
        options: How many frames.

    Raises:
        ValueError: If boxes, clip and poses differ in their number of frames.
    """
    options = options or LookOptions()
    frames, players = boxes.status.shape
    for name, rows in (("clip", len(clip.is_duplicate)), ("poses", frames if poses is None else len(poses.score))):
        if rows != frames:
            raise ValueError(f"{clip.clip_id}: {name}: expected {frames} frames, got {rows}")
    height = boxes.boxes_px[..., 3] - boxes.boxes_px[..., 1]
    good = (boxes.status == "measured") & (height >= options.least_height_px) & ~clip.is_duplicate[:, None]
    cut = np.zeros(frames, dtype=bool) if cut is None else cut
    if poses is not None:
        good = _with_points(good, np.asarray(poses.found.any(axis=-1)), np.cumsum(cut))
    chosen = chosen_frames(np.asarray(good), cut, options)
    descriptors = np.full((frames, players, len(NUMBERS)), np.nan)
    weight = np.zeros((frames, players))
    last = int(np.flatnonzero(chosen.any(axis=1)).max(initial=-1))
    if last >= 0:
        for frame, picture in enumerate(pictures()):
            for player in np.flatnonzero(chosen[frame]):
                points = _points(boxes, poses, frame, int(player))
                seen = describe(picture, points, boxes.boxes_px[frame, player])
                descriptors[frame, player], weight[frame, player] = seen
            if frame == last:
                break
    return PlayerLooks(names=boxes.names, descriptors=descriptors, weight=weight)


def chosen_frames(
    good: Bool[np.ndarray, "frames players"], cut: Bool[np.ndarray, " frames"], options: LookOptions
) -> Bool[np.ndarray, "frames players"]:
    """Which frames to look at, spread over each run between cuts; those with all players first.

    Args:
        good: Which player can be seen in which frame.
        cut: Whether each frame is the first after a cut.
        options: How many frames.
    """
    chosen = np.zeros(good.shape, dtype=bool)
    run = np.cumsum(cut)
    for each in np.unique(run):
        inside = run == each
        share = max(options.frames_a_run, round(options.frames * float(inside.mean())))
        together = np.flatnonzero(inside & good.all(axis=1))
        rows = together if len(together) else np.flatnonzero(inside & good.any(axis=1))
        chosen[_spread(rows, share)] = True
    return chosen & good


def _with_points(
    good: Bool[np.ndarray, "frames players"], found: Bool[np.ndarray, "frames players"], run: Int[np.ndarray, " frames"]
) -> Bool[np.ndarray, "frames players"]:
    """Those frames whose body points are known, of players who have such frames in a run; else all."""
    preferred = good & found
    runs, place = np.unique(run, return_inverse=True)
    some = np.array([preferred[run == each].any(axis=0) for each in runs], dtype=bool).reshape(-1, good.shape[1])
    return np.asarray(np.where(some[place], preferred, good))


def _spread(rows: Int[np.ndarray, " rows"], count: int) -> Int[np.ndarray, " some"]:
    """So many of the rows, evenly spread."""
    if len(rows) <= count:
        return rows
    return rows[np.round((np.arange(count) + 0.5) * len(rows) / count - 0.5).astype(np.int64)]


def _points(boxes: PlayerBoxes, poses: PlayerPoses | None, frame: int, player: int) -> dict[str, np.ndarray]:
    """Points of one body: those found, and a standing body's where none were."""
    box = boxes.boxes_px[frame, player]
    points = {name: box[:2] + np.array(share) * (box[2:] - box[:2]) for name, share in STANDING.items()}
    if poses is None:
        return points
    found = {
        name: point
        for name, point in zip(poses.point_names, poses.points_px[frame, player], strict=True)
        if name in points and np.isfinite(point).all()
    }
    return points if len(found) < len(points) // 2 else found


def describe(
    picture: UInt8[np.ndarray, "height width 3"],
    points: dict[str, np.ndarray],
    box_px: Float[np.ndarray, " 4"],
) -> tuple[Float[np.ndarray, " numbers"], float]:
    """The descriptor of one body, NaN where a part is not seen, and the share of its parts that are."""
    high = float(box_px[3] - box_px[1])
    surroundings = _beside(picture, box_px)
    medians, spreads = [], {}
    for part, places in part_samples(points, high).items():
        colours, rows = colours_at(picture, places)
        kept = _not_background(colours, rows, surroundings, box_px)
        medians.append(np.median(kept, axis=0) if len(kept) else np.full(3, np.nan))
        spreads[part] = 0.5 * np.ptp(np.quantile(kept[:, 0], [0.1, 0.9])) if len(kept) else np.nan
    values = np.concatenate([*medians, [spreads["shirt"], spreads["shorts"]]])
    return values, float(np.isfinite(medians).all(axis=1).mean())


def part_samples(points: dict[str, np.ndarray], high: float) -> dict[str, Float[np.ndarray, "samples 2"]]:
    """Places in the picture where each part of the body is to be seen; none where its points are not known.

    `high` is the body's height, px.
    """

    def mean(*names: str) -> np.ndarray | None:
        known = [points[name] for name in names if name in points]
        return np.mean(known, axis=0) if known else None

    shoulders, hips = mean("left_shoulder", "right_shoulder"), mean("left_hip", "right_hip")
    ears = mean("left_ear", "right_ear")
    wide = 0.05 * high
    if "left_shoulder" in points and "right_shoulder" in points:
        wide = max(wide, 0.35 * float(np.linalg.norm(points["left_shoulder"] - points["right_shoulder"])))
    up = np.array([0.0, -1.0])
    if shoulders is not None and hips is not None and np.linalg.norm(shoulders - hips) > 0.05 * high:
        up = (shoulders - hips) / np.linalg.norm(shoulders - hips)
    sides = [tuple(points.get(f"{side}_{name}") for name in ("hip", "knee", "ankle")) for side in ("left", "right")]
    return {
        "hair": _strip(ears, None if ears is None else ears + 0.055 * high * up, (0.5, 1.0), 0.02 * high),
        "shirt": _strip(shoulders, hips, (0.1, 0.8), wide),
        "shorts": np.concatenate([_strip(hip, knee, (0.08, 0.45), 0.035 * high) for hip, knee, _ in sides]),
        "legs": np.concatenate([_strip(knee, ankle, (0.1, 0.6), 0.015 * high) for _, knee, ankle in sides]),
        "shoes": np.concatenate([_strip(knee, ankle, (1.0, 1.15), 0.02 * high) for _, knee, ankle in sides]),
    }


def _strip(
    start: np.ndarray | None, end: np.ndarray | None, span: tuple[float, float], half_width: float
) -> Float[np.ndarray, "samples 2"]:
    """Places on a strip along the line from start to end, between two shares of its length."""
    if start is None or end is None:
        return np.empty((0, 2))
    along = end - start
    length = float(np.linalg.norm(along))
    across = np.array([-along[1], along[0]]) / length if length > 0 else np.array([1.0, 0.0])
    share, offset = np.meshgrid(np.linspace(*span, 9), np.linspace(-half_width, half_width, 9))
    return start + share.reshape(-1, 1) * along + offset.reshape(-1, 1) * across


def colours_at(
    picture: UInt8[np.ndarray, "height width 3"], places: Float[np.ndarray, "samples 2"]
) -> tuple[Float[np.ndarray, "inside 3"], Float[np.ndarray, " inside"]]:
    """L*a*b* of the pixels at those places that lie in the picture, and their rows."""
    column, row = np.round(places).astype(np.int64).T
    inside = (column >= 0) & (column < picture.shape[1]) & (row >= 0) & (row < picture.shape[0])
    return lab(picture[row[inside], column[inside]]), row[inside].astype(np.float64)


def lab(bgr: UInt8[np.ndarray, "samples 3"]) -> Float[np.ndarray, "samples 3"]:
    """L*a*b* of colours."""
    if len(bgr) == 0:
        return np.empty((0, 3))
    return cv2.cvtColor((bgr[None] / 255.0).astype(np.float32), cv2.COLOR_BGR2Lab)[0].astype(np.float64)


def _beside(
    picture: UInt8[np.ndarray, "height width 3"], box_px: Float[np.ndarray, " 4"]
) -> tuple[Float[np.ndarray, "places 3"], Float[np.ndarray, " places"]]:
    """Colours beside the body on both sides of its box, and their rows."""
    wide = box_px[2] - box_px[0]
    rows = np.linspace(box_px[1], box_px[3], 24)
    out = np.linspace(*BESIDE, 5) * wide
    columns = np.concatenate([box_px[0] - out, box_px[2] + out])
    places = np.stack([a.ravel() for a in np.meshgrid(columns, rows)], axis=-1)
    return colours_at(picture, places)


def _not_background(
    colours: Float[np.ndarray, "samples 3"],
    rows: Float[np.ndarray, " samples"],
    surroundings: tuple[Float[np.ndarray, "places 3"], Float[np.ndarray, " places"]],
    box_px: Float[np.ndarray, " 4"],
) -> Float[np.ndarray, "kept 3"]:
    """The samples whose colour is not the one beside the body at their height; all where too few would be left."""
    beside, beside_rows = surroundings
    if len(colours) == 0 or len(beside) == 0:
        return colours
    level = np.abs(rows[:, None] - beside_rows[None]) < 0.06 * (box_px[3] - box_px[1])
    near = np.linalg.norm(colours[:, None] - beside[None], axis=-1) < LIKE_SURROUNDINGS
    kept = ~(level & near).any(axis=1)
    return colours[kept] if kept.mean() >= LEAST_KEPT else colours
