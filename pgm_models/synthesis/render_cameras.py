"""The camera of a rendered video: that of a file, or one that goes round the play, or rides past it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pgm_data.scene import Scene
from pgm_models.synthesis.camera_path_file import read_camera_path
from pgm_models.synthesis.camera_paths import Dolly, cameras_at, dolly, orbit, play_area, usual_orbit
from pgm_models.synthesis.render_source import CameraAt

DOLLY_S = 8.0
"""How long a ride past the play takes."""
DOLLY_SHARE = 0.6
"""Of the play's width: how far it goes to each side of the middle."""


def path_cameras(path: Path) -> tuple[CameraAt, tuple[int, int]]:
    """The cameras of a camera path file, and width and height of their pictures.

    Raises:
        ValueError: If the file does not hold a camera path; names the field.
    """
    keys = read_camera_path(path)
    return lambda seconds: cameras_at(keys, seconds), keys.size


def orbit_cameras(
    scene: Scene,
    size: tuple[int, int],
    *,
    turn_deg_s: float | None = None,
    radius_m: float | None = None,
    elevation_deg: float | None = None,
) -> CameraAt:
    """Cameras that go round the scene's play, for pictures of that size; as usual where nothing is said.

    Args:
        scene: What is played.
        size: Width and height of the pictures.
        turn_deg_s: How fast, degrees a second.
        radius_m: How far from the middle of the play, metres.
        elevation_deg: How high, as seen from there, degrees.
    """
    said = {"turn_deg_s": turn_deg_s, "radius_m": radius_m, "elevation_deg": elevation_deg}
    options = replace(usual_orbit(scene, size), **{name: value for name, value in said.items() if value is not None})
    return lambda seconds: orbit(options, seconds)


def dolly_cameras(scene: Scene, size: tuple[int, int], duration_s: float = DOLLY_S) -> CameraAt:
    """Cameras that ride past the scene's play from left to right in that time, for pictures of that size."""
    options = usual_dolly(scene, size, duration_s)
    return lambda seconds: dolly(options, seconds)


def usual_dolly(scene: Scene, size: tuple[int, int], duration_s: float = DOLLY_S) -> Dolly:
    """A ride from left to right past where the scene's play is, where the usual orbit begins, with the eyes on it."""
    round_it = usual_orbit(scene, size)
    lower, upper = play_area(scene)
    middle = orbit(round_it, np.zeros(1)).camera.position_world[0]
    aside = np.array([DOLLY_SHARE * (upper - lower)[0], 0.0, 0.0])
    start, end = (tuple(point.tolist()) for point in (middle - aside, middle + aside))
    return Dolly(start_world=start, end_world=end, aim_world=round_it.aim_world, duration_s=duration_s, size=size)
