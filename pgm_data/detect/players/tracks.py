"""One path a player through the people found in the pictures of a clip.

A PATH visits at most one person a frame. It gains by each according to how probably that is the player, loses by moves
that people do not make, and may leave out frames. The best one is found exactly, by dynamic programming.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonCandidates
from pgm_data.detect.players.ground_map import strangeness_of_place
from pgm_data.detect.players.path_boxes import boxes_along
from pgm_data.geometry.camera import Camera
from pgm_data.people import PlayerBoxes
from pgm_data.scene import Scene, SceneObject

USUAL_STEP_S = 0.04
"""Time between pictures that gains are stated for, s."""


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """How players are followed."""

    speed_m_s: float = 9.0
    """Fastest that people run."""
    place_std_m: float = 0.25
    """Standard deviation of a person's place as the camera sees it, across its view, m."""
    longest_gap_s: float = 1.0
    """Longest time without the player that is bridged, s."""
    longest_absence_s: float = 3.0
    """Longest time without the player after which he is looked for within his reach, s."""
    absence_cost: float = 4.0
    """What each second of it costs that is not bridged, log odds."""
    jump_cost: float = 25.0
    """What it costs to go on anywhere, as after a cut or a longer absence, log odds."""
    surest: float = 2.0
    """Largest gain or loss by one person, log odds."""
    still_cost: float = 2.0
    """What it costs to stand in one place all clip long, as officials do, log odds; on the court a quarter."""
    outside_m: float = 1.5
    """How far outside of their usual places players are met as often as not, m."""
    overlap: float = 0.6
    """Share of two boxes in common above which two players are one person."""
    smooth_s: float = 0.12
    """Standard deviation of the times over which boxes are smoothed, s."""


def follow_players(
    candidates: PersonCandidates,
    clip: ClipCamera,
    *,
    size: tuple[int, int],
    scene: Scene,
    options: FollowOptions | None = None,
) -> PlayerBoxes:
    """The players of the scene in the frames of a clip.

    Args:
        candidates: People found.
        clip: Its cameras; a repeated frame takes what its source has.
        size: Width and height of the pictures, px.
        scene: What players there are, and where.
        options: How.

    Raises:
        ValueError: If a candidate lies in a frame that the clip does not have.
    """
    options = options or FollowOptions()
    rows = len(clip.status)
    if len(candidates.frame) and not (0 <= candidates.frame.min() and candidates.frame.max() < rows):
        got = f"{candidates.frame.min()} to {candidates.frame.max()}"
        raise ValueError(f"{clip.clip_id}: people: frame: expected 0 to {rows - 1}, got {got}")
    people = _usable(candidates, clip)
    still = share_of_time_there(people, _seen_places(people, clip.camera)) ** 2
    gains = [_gains(people, still, player, scene, options) for player in scene.players]
    paths = _paths(people, clip, gains, options)
    tracks = [
        boxes_along(
            people, path, _spans(people, path, clip, options), clip, size=size, scene=scene, window_s=options.smooth_s
        )
        for path in paths
    ]
    shape = (rows, len(scene.players))
    boxes, score = np.full((*shape, 4), np.nan), np.zeros(shape)
    ground, status = np.full((*shape, 2), np.nan), np.full(shape, "none", dtype=object)
    for column, track in enumerate(tracks):
        boxes[:, column], ground[:, column] = track.boxes_px, track.ground_world
        status[:, column] = track.status
        chance = np.full(len(people.frame), np.nan)
        chance[:] = np.exp(-np.logaddexp(0.0, -gains[column]))
        score[:, column] = track.scores(chance)
    return PlayerBoxes(
        names=tuple(player.name for player in scene.players),
        boxes_px=boxes,
        score=score,
        ground_world=ground,
        status=status,
    )


def _usable(candidates: PersonCandidates, clip: ClipCamera) -> PersonCandidates:
    """The people in frames that are looked at, in order."""
    looked_at = (clip.has_camera & ~clip.is_duplicate)[candidates.frame]
    looked_at &= np.isfinite(candidates.ground_world).all(axis=1) & np.isfinite(candidates.boxes_px).all(axis=1)
    order = np.flatnonzero(looked_at)[np.argsort(candidates.frame[looked_at], kind="stable")]
    return PersonCandidates(
        frame=candidates.frame[order],
        boxes_px=candidates.boxes_px[order],
        ground_world=candidates.ground_world[order],
        person=candidates.person[order],
        player=candidates.player[order],
    )


def _log_odds(probability: np.ndarray, most: float) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.clip(np.log(probability) - np.log1p(-probability), -most, most)


def _gains(
    people: PersonCandidates,
    still: Float[np.ndarray, " people"],
    player: SceneObject,
    scene: Scene,
    options: FollowOptions,
) -> Float[np.ndarray, " people"]:
    """Log odds that each person is the player, from his looks, his place, and whether he ever leaves it."""
    person = _log_odds(people.person, options.surest)
    plays = np.where(np.isnan(people.player), 0.0, _log_odds(np.nan_to_num(people.player, nan=0.5), options.surest))
    strange = strangeness_of_place(people.ground_world, player, scene, options.outside_m)
    # Who stands where players do may wait for a serve all through a short clip.
    waits = options.still_cost * (0.25 + np.minimum(strange, 1.0))
    return person + plays - strange - waits * still


STILL_CELL_M = 0.3
"""How far apart places are that are told apart, as the camera sees them, m."""


def share_of_time_there(
    people: PersonCandidates, places: Float[np.ndarray, "people 3"]
) -> Float[np.ndarray, " people"]:
    """Share of all frames with people in which somebody is where each person is."""
    if not len(people.frame):
        return np.zeros(0)
    seen = np.stack([places[:, 0], places[:, 1] * places[:, 2]], axis=1)
    cells = np.round((seen - seen.min(axis=0)) / STILL_CELL_M).astype(np.int64) + 1
    wide = int(cells[:, 1].max()) + 2
    cell = cells[:, 0] * wide + cells[:, 1]
    # A frame counts once at each cell and at the cells around it, so that a border between cells does not matter.
    around = (np.array([-1, 0, 1])[:, None] * wide + np.array([-1, 0, 1])).ravel()
    near = np.unique(np.stack([(cell[:, None] + around).ravel(), np.repeat(people.frame, 9)], axis=1), axis=0)
    there, counts = np.unique(near[:, 0], return_counts=True)
    return counts[np.searchsorted(there, cell)] / len(np.unique(people.frame))


def _paths(
    people: PersonCandidates, clip: ClipCamera, gains: list[np.ndarray], options: FollowOptions
) -> list[Int[np.ndarray, " visited"]]:
    """One path for each player; no two of them visit the same person. The clearer player goes first."""
    places = _seen_places(people, clip.camera)
    paths: list[np.ndarray] = [np.zeros(0, np.int64) for _ in gains]
    free = np.ones(len(people.frame), bool)
    left = list(range(len(gains)))
    while left:
        found = {
            column: best_path(people.frame, places, np.where(free, gains[column], -np.inf), clip, options)
            for column in left
        }
        # A person whom two want goes to him who gains more by him than all of his path would lose without.
        first = max(left, key=lambda column: float(gains[column][found[column]].sum()))
        paths[first] = found[first]
        free &= ~_same_people(people, found[first], options.overlap)
        left.remove(first)
    return paths


def _spans(
    people: PersonCandidates, path: Int[np.ndarray, " visited"], clip: ClipCamera, options: FollowOptions
) -> Int[np.ndarray, " visited"]:
    """Number of the stretch without a cut or a long gap that each person of a path belongs to."""
    places, time = _seen_places(people, clip.camera)[path], clip.capture_time[people.frame[path]]
    camera_xy = clip.camera.position_world[people.frame[path]][:, :2]
    passed = np.diff(time)
    breaks = _move_cost(places[1:], places[:-1], passed, camera_xy[1:], options) > options.jump_cost
    breaks |= passed > options.longest_gap_s
    return np.concatenate([np.zeros(min(1, len(path)), np.int64), np.cumsum(breaks)])


def _same_people(people: PersonCandidates, path: np.ndarray, overlap: float) -> Bool[np.ndarray, " people"]:
    """Who is on the path, or lies over somebody who is."""
    last = int(people.frame.max()) + 1 if len(people.frame) else 0
    taken = np.full((last, 4), np.nan)
    taken[people.frame[path]] = people.boxes_px[path]
    return np.asarray(overlap_of(people.boxes_px, taken[people.frame]) > overlap)


def overlap_of(a: Float[np.ndarray, "*n 4"], b: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n"]:
    """Area that two boxes share over that of both together; NaN where one is."""
    sides = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    shared = np.prod(np.maximum(sides, 0.0), axis=-1)
    areas = [np.prod(box[..., 2:] - box[..., :2], axis=-1) for box in (a, b)]
    return shared / np.maximum(areas[0] + areas[1] - shared, 1e-9)


def _seen_places(people: PersonCandidates, camera: Camera) -> Float[np.ndarray, "people 3"]:
    """World x, y on the ground, and how much an error along the view is foreshortened, 0 to 1."""
    position = camera.position_world[people.frame]
    away = people.ground_world - position[:, :2]
    flat = np.linalg.norm(away, axis=1)
    sine = np.abs(position[:, 2]) / np.maximum(np.hypot(flat, position[:, 2]), 1e-9)
    return np.concatenate([people.ground_world, np.clip(sine, 0.05, 1.0)[:, None]], axis=1)


def best_path(
    frame: Int[np.ndarray, " people"],
    places: Float[np.ndarray, "people 3"],
    gains: Float[np.ndarray, " people"],
    clip: ClipCamera,
    options: FollowOptions,
) -> Int[np.ndarray, " visited"]:
    """The people of the path that gains most, in order of their frames; nobody where none gains.

    Args:
        frame: Of each person, in order.
        places: Where each stands, and by how much the view of the camera shortens errors along it.
        gains: Log odds that each is the player; minus infinity for one who cannot be.
        clip: Its times and cameras.
        options: How.
    """
    used = np.flatnonzero(np.isfinite(gains) & (gains > 0))
    if not len(used):
        return used
    frame, places, time = frame[used], places[used], clip.capture_time[frame[used]]
    looked_at = clip.capture_time[clip.has_camera & ~clip.is_duplicate]
    step = float(np.median(np.diff(looked_at))) if len(looked_at) > 1 else USUAL_STEP_S
    value = gains[used] * np.clip(step / USUAL_STEP_S, 0.1, 3.0)
    camera_xy = clip.camera.position_world[frame][:, :2]
    total, previous = value.copy(), np.full(len(used), -1)
    starts = np.flatnonzero(np.r_[True, np.diff(frame) > 0])
    ends = np.r_[starts[1:], len(used)]
    since = np.searchsorted(time, time[starts] - options.longest_absence_s, side="left")
    best, best_at = -np.inf, -1
    for start, end, first in zip(starts, ends, since, strict=True):
        if start:
            here, before = slice(start, end), slice(min(first, start), start)
            passed = time[here, None] - time[None, before]
            cost = _move_cost(places[here, None], places[None, before], passed, camera_xy[here, None], options)
            cost += options.absence_cost * np.maximum(passed - options.longest_gap_s, 0.0)
            jump = best - options.jump_cost
            came = np.concatenate([total[before][None] - cost, np.full((end - start, 1), jump)], axis=1)
            at = came.argmax(axis=1)
            gained = came[np.arange(end - start), at]
            source = np.where(at == came.shape[1] - 1, best_at, np.arange(before.start, before.stop + 1)[at])
            went = gained > 0
            total[here] += np.where(went, gained, 0.0)
            previous[here] = np.where(went, source, -1)
        top = start + int(np.argmax(total[start:end]))
        if total[top] > best:
            best, best_at = float(total[top]), top
    visited = []
    at = best_at
    while at >= 0:
        visited.append(at)
        at = int(previous[at])
    return used[np.array(visited[::-1], dtype=np.int64)]


def _move_cost(
    places: Float[np.ndarray, "*#pairs 3"],
    places_before: Float[np.ndarray, "*#pairs 3"],
    passed: Float[np.ndarray, "*pairs"],
    camera_xy: Float[np.ndarray, "*#pairs 2"],
    options: FollowOptions,
) -> Float[np.ndarray, "*pairs"]:
    """What it costs to have gone from there to here: little for what people do, the more the faster they would be."""
    view = places[..., :2] - camera_xy
    view = view / np.maximum(np.linalg.norm(view, axis=-1, keepdims=True), 1e-9)
    move = places[..., :2] - places_before[..., :2]
    along = (move * view).sum(axis=-1)
    across = move[..., 0] * view[..., 1] - move[..., 1] * view[..., 0]
    # The place along the view is known the worse the flatter one looks, so only what the camera sees of it counts.
    noise = options.place_std_m * np.sqrt(2.0)
    reach = options.speed_m_s * np.maximum(passed, 1e-3)
    along_noise = noise / places[..., 2]
    far_across = np.maximum(np.abs(across) - reach, 0.0) / noise
    far_along = np.maximum(np.abs(along) - reach, 0.0) / along_noise
    usual = np.hypot(across / (noise + 0.5 * reach), along / (along_noise + 0.5 * reach))
    return far_across**2 + far_along**2 + 0.5 * usual**2
