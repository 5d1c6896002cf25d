"""Boxes along a player's path: smooth, bridged where he is not seen for a moment, the same in repeated pictures.

Boxes are smoothed as METRIC BOXES: the point on the ground under the middle of the lower edge, and width and height in
metres as if he stood there; so a camera that turns or zooms does no harm.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonCandidates
from pgm_data.detect.players.ground_map import floor_height, standing_height
from pgm_data.geometry.camera import meet_plane, project
from pgm_data.scene import Scene

LEAST_BOX_M = 0.2
"""Least side of a smoothed box, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PathBoxes:
    """One player in the frames of a clip."""

    boxes_px: Float[np.ndarray, "frames 4"]
    """NaN where there is none."""
    ground_world: Float[np.ndarray, "frames 2"]
    """Metres; NaN where there is none."""
    status: Shaped[np.ndarray, " frames"]
    """`measured`, `filled` or `none`."""
    before: Int[np.ndarray, " frames"]
    """Person of the path in this frame, or the last one before; -1 where there is none."""
    after: Int[np.ndarray, " frames"]
    """The same, or the first one after."""

    def scores(self, chance: Float[np.ndarray, " people"]) -> Float[np.ndarray, " frames"]:
        """Probability of the player in each frame from that of each person; half of it where he is bridged."""
        there = self.status != "none"
        result = np.zeros(len(there))
        result[there] = np.minimum(chance[self.before[there]], chance[self.after[there]])
        return np.where(self.status == "filled", 0.5 * result, result)


def boxes_along(
    people: PersonCandidates,
    path: Int[np.ndarray, " visited"],
    spans: Int[np.ndarray, " visited"],
    clip: ClipCamera,
    *,
    size: tuple[int, int],
    scene: Scene,
    window_s: float,
) -> PathBoxes:
    """The boxes of one player in all frames.

    Args:
        people: Everybody.
        path: Rows of the player, in order of their frames.
        spans: Number of the stretch that each belongs to; nothing is smoothed or bridged from one to the next.
        clip: Times and cameras.
        size: Width and height of the pictures, px.
        scene: How tall people are, and on what ground.
        window_s: Standard deviation of the times over which boxes are smoothed, s.
    """
    rows = len(clip.status)
    source = source_frames(clip)
    nobody = PathBoxes(
        boxes_px=np.full((rows, 4), np.nan),
        ground_world=np.full((rows, 2), np.nan),
        status=np.full(rows, "none", dtype=object),
        before=np.full(rows, -1),
        after=np.full(rows, -1),
    )
    if not len(path):
        return nobody
    frames = people.frame[path]
    seen = _metric_boxes(people.boxes_px[path], frames, clip, scene)
    # A box that meets no ground says nothing of its size in metres.
    good = np.isfinite(seen).all(axis=1)
    path, frames, seen, spans = path[good], frames[good], seen[good], spans[good]
    if not len(path):
        return nobody
    time, times = clip.capture_time[frames], clip.capture_time
    # The ground point of the detector need not lie at the middle of the lower edge.
    offset = people.ground_world[path] - seen[:, :2]
    smooth = _smoothed(np.concatenate([seen, offset], axis=1), time, spans, window_s)
    before = np.searchsorted(frames, source, side="right") - 1
    after = np.searchsorted(frames, source, side="left")
    inside = (before >= 0) & (after < len(frames)) & clip.has_camera
    before, after = np.where(inside, before, 0), np.where(inside, after, 0)
    inside &= spans[before] == spans[after]
    gap = np.maximum(time[after] - time[before], 1e-9)
    share = np.clip((times[source] - time[before]) / gap, 0, 1)[:, None]
    metric = np.where((before == after)[:, None], smooth[before], (1 - share) * smooth[before] + share * smooth[after])
    boxes = np.full((rows, 4), np.nan)
    at = np.flatnonzero(inside)
    boxes[at] = _pixel_boxes(metric[at, :4], at, clip, scene)
    inside &= np.isfinite(boxes).all(axis=1) & _in_picture(boxes, size)
    status = np.where(inside, np.where(before == after, "measured", "filled"), "none").astype(object)
    boxes[~inside] = np.nan
    ground = np.where(inside[:, None], metric[:, :2] + metric[:, 4:], np.nan)
    return PathBoxes(
        boxes_px=boxes,
        ground_world=ground,
        status=status,
        before=np.where(inside, path[before], -1),
        after=np.where(inside, path[after], -1),
    )


def source_frames(clip: ClipCamera) -> Int[np.ndarray, " frames"]:
    """The frame whose picture each frame shows: itself, or the last one before that it repeats."""
    own = np.where(clip.is_duplicate, -1, np.arange(len(clip.status)))
    return np.maximum(np.maximum.accumulate(own), 0)


def _in_picture(boxes: Float[np.ndarray, "frames 4"], size: tuple[int, int]) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return (boxes[:, 2] > 0) & (boxes[:, 3] > 0) & (boxes[:, 0] < size[0]) & (boxes[:, 1] < size[1])


def _metric_boxes(
    boxes: Float[np.ndarray, "people 4"], frames: Int[np.ndarray, " people"], clip: ClipCamera, scene: Scene
) -> Float[np.ndarray, "people 4"]:
    """Ground x, y under the middle of the lower edge, width, height, metres."""
    camera = clip.camera[frames]
    feet = np.stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3]], axis=1)[:, None]
    ground = meet_plane(camera, feet, floor_height(scene))[:, 0, :2]
    scale = scene.person_height_m / standing_height(camera, ground, scene)
    sides = (boxes[:, 2:] - boxes[:, :2]) * scale[:, None]
    return np.concatenate([ground, sides], axis=1)


def _pixel_boxes(
    metric: Float[np.ndarray, "frames 4"], frames: Int[np.ndarray, " frames"], clip: ClipCamera, scene: Scene
) -> Float[np.ndarray, "frames 4"]:
    camera = clip.camera[frames]
    ground = np.concatenate([metric[:, :2], np.full((len(metric), 1), floor_height(scene))], axis=1)
    feet = project(camera, ground[:, None])[0][:, 0]
    scale = standing_height(camera, metric[:, :2], scene) / scene.person_height_m
    width, height = (np.maximum(metric[:, 2:], LEAST_BOX_M) * scale[:, None]).T
    return np.stack([feet[:, 0] - width / 2, feet[:, 1] - height, feet[:, 0] + width / 2, feet[:, 1]], axis=1)


def _smoothed(
    values: Float[np.ndarray, "visited numbers"],
    time: Float[np.ndarray, " visited"],
    spans: Int[np.ndarray, " visited"],
    window_s: float,
) -> Float[np.ndarray, "visited numbers"]:
    """Each value as the parabola through those around says, of its own span; outliers count little."""
    result = values.copy()
    for span in np.unique(spans):
        rows = np.flatnonzero(spans == span)
        for _ in range(2):  # The second time the outliers of the first are known.
            reference = result[rows]
            result[rows] = _local_curves(values[rows], reference, time[rows], window_s)
    return result


RIDGE = 0.01
"""Weight of a level line against that of the values."""
LEAST_SPREAD_M = 0.03
"""Least standard deviation of a box's place and sides, metres."""
REACH = 3.0
"""Smoothing windows on either side that count."""


def _local_curves(
    values: Float[np.ndarray, "visited numbers"],
    reference: Float[np.ndarray, "visited numbers"],
    time: Float[np.ndarray, " visited"],
    window_s: float,
) -> Float[np.ndarray, "visited numbers"]:
    """Weighted parabolas through the neighbours of each value, at its own time."""
    count = len(time)
    first = np.searchsorted(time, time - REACH * window_s, side="left")
    last = np.searchsorted(time, time + REACH * window_s, side="right")
    width = int((last - first).max())
    at = first[:, None] + np.arange(width)
    inside = at < last[:, None]
    at = np.minimum(at, count - 1)
    passed = time[at] - time[:, None]
    error = np.abs(values - reference)
    scale = np.maximum(1.4826 * np.median(error, axis=0), LEAST_SPREAD_M)
    trust = 1 / (1 + (error / (3 * scale)) ** 2)
    weight = (np.exp(-0.5 * (passed / window_s) ** 2) * inside)[..., None] * trust[at]
    powers = (passed / window_s)[..., None] ** np.arange(3)
    normal = np.einsum("nkv,nki,nkj->nvij", weight, powers, powers)
    right = np.einsum("nkv,nki,nkv->nvi", weight, powers, values[at])
    # A small weight on slope and curvature keeps a lone value, or two, on a level line.
    normal += RIDGE * normal[..., :1, :1] * np.diag([0.0, 1.0, 1.0])
    return np.linalg.solve(normal, right[..., None])[..., 0, 0]
