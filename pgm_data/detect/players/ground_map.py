"""Where in the picture people can stand, and how tall they are there: from the camera and the ground."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.detect.players.canvas import coarse_pixels, refined_map
from pgm_data.geometry.camera import Camera, meet_plane, project
from pgm_data.scene import Scene, SceneObject

STEP = (4, 3)
"""Small pixels between places that are asked about, along x and y."""
LARGE = 40.0
"""Height of people who are looked for at fewer places, small px."""
BELOW = 0.25
"""How far below the picture's edge feet may stand, in heights of the picture."""
NOWHERE = 1e3
"""Metres to the players' regions where there is no ground."""
LEAST_HEIGHT = 8.0
"""Smallest people that are looked for, small px."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GroundMap:
    """Places on the ground in one picture."""

    x: Int[np.ndarray, " places"]
    """Column between the feet, px."""
    y: Int[np.ndarray, " places"]
    """Row of the feet, px."""
    height: Float[np.ndarray, " places"]
    """How tall a person of the scene's height is who stands there, px."""


def floor_height(scene: Scene) -> float:
    """World height of the ground that players stand on, metres: the bottom of their regions."""
    floors = [player.region_m[0][2] for player in scene.players if player.region_m]
    return min(floors, default=0.0)


def standing_area(scene: Scene) -> Float[np.ndarray, "2 2"]:
    """Lower and upper x, y of where players may be, metres; unbounded where the scene does not say."""
    regions = [np.array(player.region_m)[:, :2] for player in scene.players if player.region_m]
    if len(regions) < len(scene.players) or not regions:
        return np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    corners = np.array(regions)
    return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])


def ground_map(camera: Camera, size: tuple[int, int], scene: Scene, margin_m: float) -> GroundMap:
    """The places in the picture of one camera, a grid of them, that lie where players may be."""
    tall = (size[0], round(size[1] * (1 + BELOW)))
    height, beyond = height_map(camera, tall, scene)
    x, y = (at.ravel() for at in np.meshgrid(np.arange(0, tall[0], STEP[0]), np.arange(0, tall[1], STEP[1])))
    height, beyond = height[y, x], beyond[y, x]
    good = (beyond <= margin_m) & (height >= LEAST_HEIGHT) & (y - height < size[1] * 0.97)
    # Every second place will do for people who are large.
    good &= (height < LARGE) | ((x // STEP[0] + y // STEP[1]) % 2 == 0)
    good &= (height < 2 * LARGE) | (y // STEP[1] % 2 == 0)
    return GroundMap(x=x[good], y=y[good], height=height[good].astype(np.float64))


def height_map(
    camera: Camera, size: tuple[int, int], scene: Scene
) -> tuple[Float[np.ndarray, "high wide"], Float[np.ndarray, "high wide"]]:
    """How tall a person is who stands at each pixel, px, 0 where nobody can; and metres to the players' regions."""
    floor = floor_height(scene)
    grid, nodes = coarse_pixels(size)
    ground = meet_plane(camera, grid, floor)
    heads, _ = project(camera, ground + np.array([0.0, 0.0, scene.person_height_m]))
    height = np.nan_to_num(grid[:, 1] - heads[:, 1], nan=0.0, posinf=0.0, neginf=0.0)
    lower, upper = standing_area(scene)
    beyond = np.maximum(lower - ground[:, :2], ground[:, :2] - upper).max(axis=1)
    beyond = np.clip(np.nan_to_num(beyond, nan=NOWHERE, posinf=NOWHERE, neginf=-NOWHERE), -NOWHERE, NOWHERE)
    return refined_map(height, nodes, size), refined_map(beyond, nodes, size)


def standing_height(
    camera: Camera, ground_world: Float[np.ndarray, "people 2"], scene: Scene
) -> Float[np.ndarray, " people"]:
    """How tall a person of the scene's height is in the picture at each place, px; one camera for each, or one."""
    floor = floor_height(scene)
    feet = np.concatenate([ground_world, np.full((len(ground_world), 1), floor)], axis=1)[:, None]
    pixels, _ = project(camera, np.concatenate([feet, feet + [0.0, 0.0, scene.person_height_m]], axis=1))
    return np.linalg.norm(pixels[:, 0] - pixels[:, 1], axis=-1)


COURT_SIDE_M = 1.0
"""How far outside of the court's sides players are as a matter of course, m."""
COURT_END_M = 3.5
"""The same of its ends."""
NET_SIDE_M = 4.0
"""How far from the net nobody plays beside the court, m."""


def strangeness_of_place(
    ground_world: Float[np.ndarray, "people 2"], player: SceneObject, scene: Scene, outside_m: float
) -> Float[np.ndarray, " people"]:
    """By how much a place lowers the log odds that the player stands there; 0 on the court and around it."""
    result = np.zeros(len(ground_world))
    if player.region_m:
        lower, upper = np.array(player.region_m)[:, :2]
        beyond = np.maximum(np.maximum(lower - ground_world, ground_world - upper), 0.0)
        result += ((beyond / outside_m) ** 2).sum(axis=1)
    if scene.court is not None and len(scene.court.points_world):
        half = np.abs(scene.court.points_world[:, :2]).max(axis=0)
        aside = np.maximum(np.abs(ground_world) - half - [COURT_SIDE_M, COURT_END_M], 0.0)
        result += 0.5 * ((aside / outside_m) ** 2).sum(axis=1)
        if scene.court.net_top:
            # Ball kids and the umpire are beside the net, where a player has hardly anything to do.
            near_net = np.clip(1 - np.abs(ground_world[:, 1]) / NET_SIDE_M, 0, None)
            beside = np.maximum(np.abs(ground_world[:, 0]) - half[0], 0.0)
            result += 4.0 * near_net * beside
    return result
