"""People from what differs from the background of a clip, where the camera says that one can stand, at his size."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.background import (
    Background,
    BackgroundOptions,
    Bounds,
    bounds,
    distinct_frames,
    learn_background,
    picked,
)
from pgm_data.detect.players.candidates import PersonCandidates, Pictures
from pgm_data.detect.players.canvas import SmallView, small_view
from pgm_data.detect.players.emptied import emptied
from pgm_data.detect.players.evidence import PERSON_WEIGHTS, people_in
from pgm_data.detect.players.ground_map import GroundMap, floor_height, ground_map
from pgm_data.geometry.camera import Camera, meet_plane
from pgm_data.scene import Scene


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """How people are looked for by their motion."""

    background: BackgroundOptions = field(default_factory=BackgroundOptions)
    """How the background is learnt."""
    margin_m: float = 3.0
    """How far outside of the players' regions people are looked for, metres."""
    most: int = 8
    """People a frame."""
    least: float = 0.05
    """Smallest probability that is kept."""
    shadow: tuple[float, float] = (0.55, 0.95)
    """Brightness of a shadow over that of the ground."""
    shadow_hue: float = 0.1
    """Largest difference of that between colours."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionPeople:
    """Finds people by their motion; a `PersonFinder`. It cannot tell who plays."""

    options: MotionOptions = field(default_factory=MotionOptions)
    """How."""

    def find(self, pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], scene: Scene) -> PersonCandidates:
        """People in the frames of a clip that have a camera; none where its camera travels."""
        view = small_view(clip.camera, size, self.options.background.width)
        background = learn_background(pictures, clip, view, self.options.background) if scene.players else None
        frames, boxes, probabilities = [], [], []
        if background is not None:
            background = emptied(background, scene)
            for frame, mask, places in _masks(pictures, clip, view, background, scene, self.options):
                for person in people_in(mask, places, self.options.most):
                    probability = 1 / (1 + np.exp(-person.features @ PERSON_WEIGHTS))
                    if probability >= self.options.least:
                        frames.append(frame)
                        boxes.append(person.box)
                        probabilities.append(probability)
        return _candidates(
            np.array(frames, dtype=np.int64),
            np.array(boxes, dtype=np.float64).reshape(-1, 4),
            np.array(probabilities, dtype=np.float64),
            clip=clip,
            view=view,
            scene=scene,
        )


def _masks(
    pictures: Pictures,
    clip: ClipCamera,
    view: SmallView,
    background: Background,
    scene: Scene,
    options: MotionOptions,
) -> Iterator[tuple[int, np.ndarray, GroundMap]]:
    """Each distinct frame with what is new in it, and where people may stand."""
    places, seen = None, None
    camera_of_places, camera_of_seen = view.camera[0], view.camera[0]
    for frame, bgr in picked(pictures, distinct_frames(clip), clip):
        camera = view.camera[frame]
        if places is None or _shift(camera, camera_of_places, view.size) > SAME_PLACES:
            places, camera_of_places = ground_map(camera, view.size, scene, options.margin_m), camera
        if seen is None or _shift(camera, camera_of_seen, view.size) > SAME_PICTURE:
            seen, camera_of_seen = bounds(background, camera, view.size), camera
        yield frame, foreground(view.shrunk(bgr), seen, options), places


SAME_PLACES = 1.5
"""Shift of the picture up to which people stand where they stood, small px."""
SAME_PICTURE = 0.1
"""Shift up to which a picture stays the same, small px."""


def _shift(a: Camera, b: Camera, size: tuple[int, int]) -> float:
    """About how far two cameras at one place show the same apart, at most, px."""
    half = np.array([[-0.5, -0.5, 1.0], [0.5, -0.5, 1.0], [-0.5, 0.5, 1.0], [0.5, 0.5, 1.0]])
    corners = np.array([size[0] / a.K[0, 0], size[1] / a.K[1, 1], 1.0]) * half
    there = corners @ (a.R_cam_from_world @ b.R_cam_from_world.T)
    moved = np.abs(there[:, :2] / there[:, 2:] * np.diag(b.K)[:2] - corners[:, :2] * np.diag(a.K)[:2])
    return float(moved.max() + np.abs(a.K[:2, 2] - b.K[:2, 2]).max())


def foreground(
    small: UInt8[np.ndarray, "high wide 3"], seen: Bounds, options: MotionOptions
) -> UInt8[np.ndarray, "high wide"]:
    """1 where the picture shows something new that is no shadow, else 0."""
    brighter, darker = cv2.subtract(small, seen.upper), cv2.subtract(seen.lower, small)
    blue, green, red = cv2.split(cv2.max(brighter, darker))
    _, mask = cv2.threshold(cv2.max(cv2.max(blue, green), red), 0, 1, cv2.THRESH_BINARY)
    blue, green, red = cv2.split(darker)
    rows, columns = np.nonzero(cv2.max(cv2.max(blue, green), red))
    ratio = (small[rows, columns] + np.float32(1)) / (seen.middle[rows, columns] + np.float32(1))
    least, most = ratio.min(axis=1), ratio.max(axis=1)
    shadow = (least > options.shadow[0]) & (most < options.shadow[1]) & (most - least < options.shadow_hue)
    mask[rows[shadow], columns[shadow]] = 0
    return cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))


def _candidates(
    frames: np.ndarray, boxes: np.ndarray, probabilities: np.ndarray, *, clip: ClipCamera, view: SmallView, scene: Scene
) -> PersonCandidates:
    full = view.full(boxes.reshape(-1, 2, 2)).reshape(-1, 4)
    ground = ground_of(clip.camera[frames], full, scene)
    good = np.isfinite(ground).all(axis=1)
    return PersonCandidates(
        frame=frames[good],
        boxes_px=full[good],
        ground_world=ground[good],
        person=probabilities[good],
        player=np.full(int(good.sum()), np.nan),
    )


FEET_BEHIND_M = 0.12
"""How far the point between the feet lies behind the lower edge of the box, seen from the camera, metres."""


def ground_of(camera: Camera, boxes_px: Float[np.ndarray, "people 4"], scene: Scene) -> Float[np.ndarray, "people 2"]:
    """World x and y between the feet of the people in the boxes, metres; one camera for each; NaN where none."""
    feet = np.stack([boxes_px[:, [0, 2]].mean(axis=1), boxes_px[:, 3]], axis=1)[:, None]
    ground = meet_plane(camera, feet, floor_height(scene))[:, 0, :2]
    away = ground - camera.position_world[..., :2]
    return ground + away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9) * FEET_BEHIND_M
