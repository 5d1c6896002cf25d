"""The background without the people who stand in it, who are told from what lies to their left and right.

Whoever does not move all clip long is in the median of its pictures. Courts are of one colour along a row of the
picture, walls and lines behind them too, so a person is what differs from both sides, is as tall as people are there,
and as narrow. Taken out of the background he is something new in each picture that shows him.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from pgm_data.detect.players.background import Background, ranked
from pgm_data.detect.players.evidence import people_in
from pgm_data.detect.players.ground_map import GroundMap, floor_height, ground_map, height_map, strangeness_of_place
from pgm_data.geometry.camera import Camera, meet_plane, project
from pgm_data.scene import Scene

ASIDE = (0.42, 0.55, 0.7, 0.9, 1.15)
"""Where the ground is looked at on each side of a pixel, in heights of a person."""
CLEARLY = 1.5
"""By how much a person must differ from the ground at either side, in the usual margins of the background."""
OUTSIDE_M = 1.5
"""How far outside of their usual places players are met as often as not, m."""
LARGEST_STRANGENESS = 0.5
"""Largest loss of log odds by a place."""
NET_M = 3.0
"""How far from the net nobody stands still for long, m."""
LINE_PX = 3
"""How wide lines are at most in the small copies, px."""
MOST = 14
"""People who stand still."""
LEAST_FULL = (0.35, 0.35, 0.2)
"""Least share of head, trunk and legs that differ from the ground."""
LARGEST_ASIDE = 0.35
"""Largest share of what is left, right, above and below of a person that may differ from the ground too."""
TALLEST = 1.3
"""Tallest of them, in heights of a standing person; the shortest is as much shorter."""


def emptied(background: Background, scene: Scene) -> Background:
    """The background, with the ground in the place of the people who stand on it."""
    size = (background.middle.shape[1], background.middle.shape[0])
    heights, _ = height_map(background.camera, size, scene)
    sides = [ground_colours(background.middle, heights * sign) for sign in (-1, 1)]
    different = cv2.min(*(cv2.absdiff(background.middle, side).max(axis=2) for side in sides))
    usual = int(np.median(background.margin[background.margin < 255])) if (background.margin < 255).any() else 255
    known = (background.margin < 255).astype(np.uint8)
    beside = [ground_colours(known, heights * sign) for sign in (-1, 1)]
    lines = painted(background.camera, size, scene)
    stands = (different > CLEARLY * usual) & (np.minimum(beside[0], beside[1]) > 0) & (known > 0) & ~lines
    mask = cv2.morphologyEx(stands.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    places = _usual_places(ground_map(background.camera, size, scene, 0.0), background.camera, scene)
    middle, margin = background.middle.copy(), background.margin.copy()
    for person in people_in(mask, places, MOST):
        if _stands(person.features):
            (x0, y0), (x1, y1) = np.clip(np.round(person.box).astype(int).reshape(2, 2) + [[-4, -4], [5, 5]], 0, size)
            window = (slice(y0, y1), slice(x0, x1))
            his = (cv2.dilate(mask[window], np.ones((5, 5), np.uint8)) > 0) & ~lines[window]
            left = np.arange(x0, x1) < (x0 + x1) // 2
            colours = np.where(left[None, :, None], sides[0][window], sides[1][window])
            # Where he was not there all the time, the ground itself has been seen.
            now, other = (picture[window].astype(int) for picture in (background.middle, background.other))
            seen = np.abs(other - now).max(axis=2) > usual
            seen &= np.abs(other - colours).max(axis=2) < np.abs(now - colours).max(axis=2)
            middle[window][his] = np.where(seen[..., None], other, colours)[his]
            margin[window][his] = usual
    return replace(background, middle=middle, margin=margin)


def _usual_places(places: GroundMap, camera: Camera, scene: Scene) -> GroundMap:
    """Those where a player may stand still for long: not beside the court, not at the net, where its posts are."""
    pixels = np.stack([places.x, places.y], axis=1).astype(np.float64)
    ground = meet_plane(camera, pixels, floor_height(scene))[:, :2]
    strange = [strangeness_of_place(ground, player, scene, OUTSIDE_M) for player in scene.players]
    usual = np.min(strange, axis=0) < LARGEST_STRANGENESS
    if scene.court is not None and scene.court.net_top:
        usual &= np.abs(ground[:, 1]) > NET_M
    return GroundMap(x=places.x[usual], y=places.y[usual], height=places.height[usual])


def _stands(features: Float[np.ndarray, " features"]) -> bool:
    """Whether what differs from the ground has the shape of a person who stands alone."""
    full, aside, height = features[1:4], features[4:8], np.sqrt(features[8])
    return bool((full > LEAST_FULL).all() and aside.max() < LARGEST_ASIDE and height < np.log(TALLEST))


def painted(camera: Camera, size: tuple[int, int], scene: Scene) -> Bool[np.ndarray, "high wide"]:
    """Where the picture shows the lines of the court."""
    mask = np.zeros((size[1], size[0]), np.uint8)
    ends = scene.court.lines_world if scene.court is not None else np.zeros((0, 2, 3))
    along = np.linspace(0.0, 1.0, 41)[:, None]
    for start, end in ends:
        pixels, seen = project(camera, start + along * (end - start))
        near = seen & (np.abs(pixels) < 4 * max(size)).all(axis=1)
        for a, b in zip(np.flatnonzero(near[:-1] & near[1:]), np.flatnonzero(near[:-1] & near[1:]) + 1, strict=True):
            corners = [tuple(np.round(pixels[i]).astype(int).tolist()) for i in (a, b)]
            cv2.line(mask, corners[0], corners[1], 1, LINE_PX)
    return mask > 0


def ground_colours(
    picture: UInt8[np.ndarray, "high wide *colours"], heights: Float[np.ndarray, "high wide"]
) -> UInt8[np.ndarray, "high wide *colours"]:
    """The median colour to the right of each pixel, a person's width away and more; to the left for heights below 0."""
    x, y = np.meshgrid(np.arange(picture.shape[1], dtype=np.float32), np.arange(picture.shape[0], dtype=np.float32))
    tall = heights.astype(np.float32)
    sides = [
        cv2.remap(picture, x + np.float32(aside) * tall, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        for aside in ASIDE
    ]
    return ranked(sides, 0.5)
