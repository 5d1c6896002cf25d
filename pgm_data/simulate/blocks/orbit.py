"""The camera of a match of blocks: one slow continuous orbit about the middle of the world."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.camera import CameraTrack, pixels_of, rotation_towards

MARGIN = 0.02
"""Share of the picture's size between its rim and the outermost place of a player."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Orbit:
    """How one match's camera goes round."""

    start: float
    """Bearing from the middle at time 0, radians anticlockwise from +x."""
    rate: float
    """Mean, rad/s; positive anticlockwise from above."""
    sway: Float[np.ndarray, "3 4"]
    """Slow waves of bearing (rad), distance (m), height (m): amplitude, rate (rad/s), phase, 0."""
    distance_m: float
    """Level distance from the middle."""
    height_m: float
    aim_m: float
    """Height over the middle that the camera looks at."""
    focal_of_height: float
    """Focal length over the picture's height in pixels."""


def draw_orbit(rng: np.random.Generator, size: tuple[int, int]) -> Orbit:
    """An orbit by lot that keeps every place of the world where a player can be inside of the picture."""
    distance, height = float(rng.uniform(21.0, 26.0)), float(rng.uniform(6.0, 12.0))
    sway = np.column_stack(
        [
            rng.uniform(0.3, 1.0, 3) * (0.06, 0.8, 0.7),
            2 * np.pi / rng.uniform(25.0, 60.0, 3),
            rng.uniform(0, 2 * np.pi, 3),
            np.zeros(3),
        ]
    )
    rate = float(rng.choice([-1, 1]) * rng.uniform(0.03, 0.09))
    start = float(rng.uniform(-np.pi, np.pi))
    trials = []
    for aim in np.linspace(0.0, 3.0, 7):
        trial = Orbit(
            start=start,
            rate=rate,
            sway=sway,
            distance_m=distance,
            height_m=height,
            aim_m=float(aim),
            focal_of_height=1.0,
        )
        trials.append((_largest_focal(trial, size), float(aim)))
    focal, aim = max(trials)
    return Orbit(
        start=start,
        rate=rate,
        sway=sway,
        distance_m=distance,
        height_m=height,
        aim_m=aim,
        focal_of_height=focal,
    )


def _largest_focal(orbit: Orbit, size: tuple[int, int]) -> float:
    """Focal length over height at which all places of a player are just in view from all around."""
    flat = np.array([[x, y] for x in (-7.7, 7.7) for y in (-7.7, 7.7)])
    places = np.vstack(
        [np.column_stack([flat, np.full(4, z)]) for z in (0.0, 1.9)]
        + [np.column_stack([flat * 0.8, np.full(4, 5.3)]), [[0.0, 0.0, 6.0]]]
    )
    reach = orbit.sway[:, 0]
    largest = np.inf
    for bearing in np.linspace(0, np.pi / 2, 13):
        for far in (-1.0, 1.0):
            for high in (-1.0, 1.0):
                centre = _centre(bearing, orbit.distance_m + far * reach[1], orbit.height_m + high * reach[2])
                R, t = _pose(centre, orbit.aim_m)
                seen = pixels_of(places, np.eye(3), 0.0, R, t)
                wide, tall = np.abs(seen).max(axis=0)
                largest = min(largest, (0.5 - MARGIN) * size[0] / wide / size[1], (0.5 - MARGIN) / tall)
    return float(largest)


def _centre(bearing: float, distance: float, height: float) -> np.ndarray:
    return np.array([distance * np.cos(bearing), distance * np.sin(bearing), height])


def _pose(centre: np.ndarray, aim: float) -> tuple[np.ndarray, np.ndarray]:
    R = rotation_towards(np.array([0.0, 0.0, aim]) - centre, 0.0)
    return R, -R @ centre


def orbit_track(orbit: Orbit, times: Float[np.ndarray, " frames"], size: tuple[int, int]) -> CameraTrack:
    """The cameras at times of the match, for pictures of a size (width, height)."""
    bearing, distance, height = (amplitude * np.sin(rate * times + phase) for amplitude, rate, phase, _ in orbit.sway)
    bearing = bearing + orbit.start + orbit.rate * times
    distance, height = distance + orbit.distance_m, height + orbit.height_m
    centres = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), height])
    forward = np.array([0.0, 0.0, orbit.aim_m]) - centres
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    right = np.column_stack([forward[:, 1], -forward[:, 0], np.zeros(len(times))])
    right /= np.linalg.norm(right, axis=1)[:, None]
    R = np.stack([right, np.cross(forward, right), forward], axis=1)
    width, tall = size
    focal = orbit.focal_of_height * tall
    K = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (tall - 1) / 2], [0.0, 0.0, 1.0]])
    return CameraTrack(
        K=np.tile(K, (len(times), 1, 1)),
        distortion=np.zeros((len(times), 4)),
        R_cam_from_world=R,
        t_cam_from_world=-np.einsum("fij,fj->fi", R, centres),
    )
