"""The ball as a camera with a shutter sees it: a disc smeared along its way while the shutter is open.

The way is cut into straight pieces; how long the moving disc covers a sample is then exact, and pixels are means of
samples. Nothing is made larger than it is: a ball 2 px wide is drawn 2 px wide.
"""

import math

import numba
import numpy as np
from jaxtyping import Float

from pgm_data.simulate.camera import pixels_of, seen_from
from pgm_data.simulate.flight.path import BallPath
from pgm_data.simulate.pictures.body_mesh import Light
from pgm_data.simulate.pictures.raster import Sprite
from pgm_data.simulate.pictures.triangles import NEAR_M
from pgm_data.simulate.views import View

PIECES = 4
SAMPLES = 6
BALL_BGR = np.array([70.0, 225.0, 205.0])
"""Optic yellow under white light."""
_SHADE = 0.16
"""How much brighter than its middle the ball is towards the light, at its rim."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _smear(cover, shade, pieces, shapes, shares, x0, y0, samples, light):
    """Adds the share of time that the moving ellipse covers each pixel, and that share times the shade, in place.

    `pieces` (n, 6): start x, y, end x, y and half the ellipse's width and height, pixels; `shapes` (n, 2, 2) take
    offsets in pixels to those in radii of a round disc; `light` (2): towards the light in the picture.
    """
    area = 1.0 / (samples * samples)
    for piece in range(pieces.shape[0]):
        ax, ay, bx, by, wide, tall = pieces[piece]
        m00, m01, m10, m11 = shapes[piece, 0, 0], shapes[piece, 0, 1], shapes[piece, 1, 0], shapes[piece, 1, 1]
        # The way in radii.
        ux, uy = m00 * (bx - ax) + m01 * (by - ay), m10 * (bx - ax) + m11 * (by - ay)
        length = math.hypot(ux, uy)
        ux, uy = (ux / length, uy / length) if length > 1e-9 else (1.0, 0.0)
        left = max(int(math.floor(min(ax, bx) - wide + 0.5)) - x0, 0)
        right = min(int(math.floor(max(ax, bx) + wide + 0.5)) - x0 + 1, cover.shape[1])
        top = max(int(math.floor(min(ay, by) - tall + 0.5)) - y0, 0)
        bottom = min(int(math.floor(max(ay, by) + tall + 0.5)) - y0 + 1, cover.shape[0])
        for row in range(top, bottom):
            for column in range(left, right):
                held = 0.0
                bright = 0.0
                for i in range(samples):
                    dy = y0 + row + (i + 0.5) / samples - 0.5 - ay
                    for j in range(samples):
                        dx = x0 + column + (j + 0.5) / samples - 0.5 - ax
                        x, y = m00 * dx + m01 * dy, m10 * dx + m11 * dy
                        along, across = x * ux + y * uy, y * ux - x * uy
                        if abs(across) >= 1.0:
                            continue
                        half = math.sqrt(1.0 - across * across)
                        if length > 1e-9:
                            first, last = max(along - half, 0.0), min(along + half, length)
                            if last <= first:
                                continue
                            time = (last - first) / length
                            middle = 0.5 * (first + last)
                        else:
                            if abs(along) > half:
                                continue
                            time, middle = 1.0, 0.0
                        held += time
                        bright += time * ((x - middle * ux) * light[0] + (y - middle * uy) * light[1])
                cover[row, column] += shares[piece] * held * area
                shade[row, column] += shares[piece] * bright * area


def exposure(path: BallPath, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (points, 3) of a ball while the shutter is open, and the share of that time from each to the next.

    Contacts in between are points of their own; NaN outside of the course.

    Raises:
        ValueError: If the shutter closes before it opens.
    """
    if end_s < start_s:
        raise ValueError(f"exposure: expected an end not before the start {start_s} s, got {end_s} s")
    contacts = [c.time for c in path.contacts if start_s < c.time < end_s]
    times = np.unique(np.concatenate([np.linspace(start_s, end_s, PIECES + 1), contacts]))
    positions, _ = path.at(times)
    return positions, np.diff(times) / (end_s - start_s) if len(times) > 1 else np.ones(0)


def ball_streak(
    positions: Float[np.ndarray, "points 3"],
    shares: Float[np.ndarray, " pieces"],
    radius_m: float,
    view: View,
    size: tuple[int, int],
    light: Light,
    colour: Float[np.ndarray, " 3"] = BALL_BGR,
) -> Sprite | None:
    """The ball's pixels, its opacity the share of the exposure that it covers them; None if the picture lacks it.

    `positions` are world places through the exposure and `shares` the parts of its time between them; one position
    alone is a ball at rest. Parts with a NaN end, or not in front of the camera, are left out.
    """
    cam = seen_from(positions, view.R_cam_from_world, view.t_cam_from_world)
    px = pixels_of(positions, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    depth = np.where(cam[:, 2] > NEAR_M + radius_m, cam[:, 2], np.nan)
    bent = view.k1 * np.sum((cam[:, :2] / depth[:, None]) ** 2, axis=1)
    # The lens stretches the disc's area by its scales along and across the picture's radius.
    stretch = np.sqrt(np.maximum((1.0 + bent) * (1.0 + 3.0 * bent), 0.0))
    radius = np.sqrt(view.K[0, 0] * view.K[1, 1]) * radius_m / depth * stretch
    reach = np.repeat(radius[:, None], 2, axis=1)
    shape = np.eye(2) / radius[:, None, None]
    sunward = view.R_cam_from_world @ (light.towards_sun + np.array([0.0, 0.0, 0.6]))
    towards = _SHADE * sunward[:2] / max(float(np.linalg.norm(sunward)), 1e-9)
    found = _swept(px, reach, shape, shares, size, towards)
    if found is None:
        return None
    x0, y0, cover, shade = found
    bright = light.sky + 0.75 * light.sun + 0.1 * light.ground
    factor = 1.0 + shade / np.maximum(cover, 1e-9)
    bgr = np.minimum(colour * bright * factor[..., None], 255.0) * (cover > 0.0)[..., None]
    nearest = float(np.nanmin(depth)) - radius_m
    return Sprite(
        x0=x0,
        y0=y0,
        bgr=bgr.astype(np.float32),
        alpha=np.minimum(cover, 1.0).astype(np.float32),
        depth=np.where(cover > 0.0, nearest, np.inf).astype(np.float32),
    )


def ball_shadow(
    positions: Float[np.ndarray, "points 3"],
    radius_m: float,
    thrown: Float[np.ndarray, " 2"],
    floor_z: float,
    view: View,
    size: tuple[int, int],
) -> Sprite | None:
    """The ball's shadow on the floor, smeared likewise; `thrown` is the ground vector per metre of height."""
    lift = np.maximum(positions[:, 2:] - floor_z, 0.0)
    fallen = np.concatenate([positions[:, :2] + lift * thrown, np.full((len(positions), 1), floor_z)], axis=1)
    far = float(np.hypot(*thrown))
    along = thrown / far if far > 1e-9 else np.array([1.0, 0.0])
    # The shadow's two half axes on the ground, and in the picture.
    axes = radius_m * np.array(
        [[np.hypot(1.0, far) * along[0], np.hypot(1.0, far) * along[1], 0.0], [-along[1], along[0], 0.0]]
    )
    camera = (view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    px = pixels_of(fallen, *camera)
    ellipse = np.stack([0.5 * (pixels_of(fallen + a, *camera) - pixels_of(fallen - a, *camera)) for a in axes], axis=-1)
    spread = np.abs(ellipse[:, 0, 0] * ellipse[:, 1, 1] - ellipse[:, 0, 1] * ellipse[:, 1, 0])
    px[~(spread > 1e-9)] = np.nan  # seen edge-on, or not at all
    ellipse[~np.isfinite(px[:, 0])] = np.eye(2)
    shares = np.full(max(len(positions) - 1, 0), 1.0 / max(len(positions) - 1, 1))
    reach = np.linalg.norm(ellipse, axis=2)
    found = _swept(px, reach, np.linalg.inv(ellipse), shares, size, np.zeros(2))
    if found is None:
        return None
    x0, y0, cover, _ = found
    depth = seen_from(fallen, view.R_cam_from_world, view.t_cam_from_world)[:, 2]
    return Sprite(
        x0=x0,
        y0=y0,
        bgr=np.zeros((*cover.shape, 3), np.float32),
        alpha=np.minimum(cover, 1.0).astype(np.float32),
        depth=np.where(cover > 0.0, float(np.nanmin(depth)), np.inf).astype(np.float32),
    )


def _swept(
    px: np.ndarray, reach: np.ndarray, shape: np.ndarray, shares: np.ndarray, size: tuple[int, int], light: np.ndarray
) -> tuple[int, int, np.ndarray, np.ndarray] | None:
    """Where an ellipse that moves through `px` lies in the picture, how long it covers each pixel, and its shade.

    `reach` (points, 2) is half its width and height, `shape` (points, 2, 2) takes pixels to its radii.
    """
    ends = (slice(0, 1), slice(0, 1)) if len(px) == 1 else (slice(0, -1), slice(1, None))
    pieces = np.concatenate([px[ends[0]], px[ends[1]], 0.5 * (reach[ends[0]] + reach[ends[1]])], axis=1)
    shapes = 0.5 * (shape[ends[0]] + shape[ends[1]])
    weights = np.ones(1) if len(px) == 1 else np.asarray(shares, dtype=float)
    kept = np.isfinite(pieces).all(axis=1)
    pieces, shapes, weights = pieces[kept], shapes[kept], weights[kept]
    if len(pieces) == 0:
        return None
    margin = pieces[:, 4:]
    low = np.min(np.minimum(pieces[:, :2], pieces[:, 2:4]) - margin, axis=0)
    high = np.max(np.maximum(pieces[:, :2], pieces[:, 2:4]) + margin, axis=0)
    end = np.array(size) - 1.0
    if (high < -0.5).any() or (low > end + 0.5).any():
        return None
    x0, y0 = (int(v) for v in np.floor(np.maximum(low, 0.0) + 0.5))
    x1, y1 = (int(v) + 1 for v in np.floor(np.minimum(high, end) + 0.5))
    if x1 <= x0 or y1 <= y0:
        return None
    cover, shade = np.zeros((y1 - y0, x1 - x0)), np.zeros((y1 - y0, x1 - x0))
    # Small discs need finer samples to keep their centre.
    samples = int(np.clip(np.ceil(20.0 / np.sqrt(max(float(margin.max()), 0.05))), SAMPLES, 32))
    _smear(cover, shade, pieces, np.ascontiguousarray(shapes), weights, x0, y0, samples, light)
    return x0, y0, cover, shade
