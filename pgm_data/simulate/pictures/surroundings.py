"""Hoardings, stands and backdrops round the court."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.pictures.shapes import Plane
from pgm_data.simulate.pictures.textures import CROWD_PX_PER_M, Textures


@dataclass(frozen=True, eq=False, kw_only=True)
class Venue:
    """What stands round a court."""

    wall_x: float
    """Where the side hoardings stand, metres."""
    wall_y: float
    """Where the far hoarding stands, metres."""
    sky: Float[np.ndarray, "2 3"]
    """BGR at the top and at the horizon."""
    planes: tuple[Plane, ...]
    """Far ones first."""
    roofed: bool
    """A hall: no sun."""


def lettering(
    mask: np.ndarray,
    middle_world: np.ndarray,
    height_m: float,
    colour: np.ndarray,
    up_world: np.ndarray,
    *,
    width: float | None = None,
    alpha: float = 0.95,
) -> Plane:
    """A mask as one patch about a point, its right along x and its up along `up_world` (a unit vector)."""
    rows, columns = mask.shape[:2]
    wide = height_m * columns / rows if width is None else width
    right, up = np.array([0.5 * wide, 0.0, 0.0]), 0.5 * height_m * up_world
    corners = middle_world + np.array([-right - up, right - up, right + up, up - right])
    return Plane(
        corners=corners,
        origin=corners[3],
        right=2.0 * right / columns,
        down=-2.0 * up / rows,
        texture=mask,
        base=np.asarray(colour, dtype=float),
        gain=np.zeros(3),
        alpha=alpha,
        by_mask=True,
    )


def draw_venue(
    rng: np.random.Generator,
    half_x: float,
    half_y: float,
    floor_z: float,
    textures: Textures,
    centre_world: np.ndarray,
    *,
    hard: bool,
) -> Venue:
    """Stands with crowds, a hall, or a club with trees and a fence; only what faces the camera is built."""
    # Where play is shown nobody may run into a hoarding.
    wall_x = half_x * (rng.uniform(0.88, 1.5) if hard else rng.uniform(1.03, 1.5))
    wall_y = half_y * (rng.uniform(0.86, 1.2) if hard else rng.uniform(0.99, 1.2))
    kind = rng.choice(["stands", "hall", "club"], p=[0.66, 0.16, 0.18])
    size = max(half_y / 20.0, 0.4)
    planes: list[Plane] = []
    if kind == "club":
        sky = np.array([rng.uniform(100, 255, 3), rng.uniform(150, 255, 3)])
        sky = np.stack([np.sort(sky[0])[::-1], np.sort(sky[1])[::-1]])
    else:
        sky = np.array([rng.uniform(0, 50, 3), rng.uniform(0, 70, 3)])
    tall = size * rng.uniform(0.9, 3.4 if hard else 2.5)
    side_tall = size * rng.uniform(0.5, 1.6)
    crowd = textures.crowds[int(rng.integers(len(textures.crowds)))]
    light = rng.uniform(0.3 if hard else 0.5, 1.15) * rng.uniform(0.9, 1.1, 3)
    rise = rng.uniform(0.35, 0.9)

    def sloped(side: str) -> Plane:
        """A stand that climbs away from the court behind one wall."""
        reach = size * rng.uniform(14.0, 40.0)
        gap = size * rng.uniform(0.0, 2.0)
        away = np.array([1.0, 0.0, rise]) if side == "right" else np.array([-1.0, 0.0, rise])
        along = np.array([0.0, -1.0, 0.0]) if side == "right" else np.array([0.0, 1.0, 0.0])
        if side == "far":
            away, along = np.array([0.0, 1.0, rise]), np.array([1.0, 0.0, 0.0])
            foot = np.array([0.0, wall_y + gap, floor_z + tall * rng.uniform(0.6, 1.0)])
            half = 6.0 * wall_x
        else:
            foot = np.array([np.sign(away[0]) * (wall_x + gap), 0.0, floor_z + side_tall * rng.uniform(0.6, 1.0)])
            half = 2.2 * wall_y
        away = away / np.linalg.norm(away)
        a, b, top = foot - half * along, foot + half * along, reach * away
        corners = np.array([a, b, b + top, a + top])
        step = 1.0 / CROWD_PX_PER_M
        shift = rng.uniform(0, 500)
        return Plane(
            corners=corners,
            origin=corners[3] - shift * step * along,
            right=along * step,
            down=-away * step,
            texture=crowd,
            base=np.zeros(3),
            gain=light,
            alpha=1.0,
            by_mask=False,
        )

    def upright(side: str, height: float, texture: np.ndarray, colours: np.ndarray, px_per_m: float) -> Plane:
        """A wall round the court, its texture's full height over the wall's; `colours`: base and gain."""
        if side == "far":
            along, foot, half = np.array([1.0, 0.0, 0.0]), np.array([0.0, wall_y, floor_z]), wall_x
        else:
            sign = 1.0 if side == "right" else -1.0
            along, foot, half = np.array([0.0, -sign, 0.0]), np.array([sign * wall_x, 0.0, floor_z]), wall_y
        top = np.array([0.0, 0.0, height])
        a, b = foot - half * along, foot + half * along
        if kind != "stands" and side == "far":
            a, b = foot - 3 * half * along, foot + 3 * half * along
        return Plane(
            corners=np.array([a, b, b + top, a + top]),
            origin=a + top - along * rng.uniform(0, 10),
            right=along / px_per_m,
            down=np.array([0.0, 0.0, -height / texture.shape[0]]),
            texture=texture,
            base=colours[0],
            gain=colours[1],
            alpha=1.0,
            by_mask=False,
        )

    def hoarding(side: str, height: float) -> Plane:
        mask = textures.hoardings[int(rng.integers(len(textures.hoardings)))]
        back = rng.uniform(5, 235, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(5, 250))
        ink = np.full(3, rng.uniform(190, 255)) if back.mean() < 130 else rng.uniform(0, 200, 3)
        if rng.random() < 0.15:
            ink = back * rng.uniform(0.8, 1.2)
        three = np.repeat(mask, 3, axis=2) if mask.shape[2] == 1 else mask
        return upright(
            side, height, three, np.stack([back, (ink - back) / 255.0]), 64.0 / (height * rng.uniform(0.5, 1.0))
        )

    sides = ["far"]
    if centre_world[0] > -wall_x:
        sides.append("left")
    if centre_world[0] < wall_x:
        sides.append("right")
    if kind == "stands":
        planes += [sloped(side) for side in sides]
        if rng.random() < 0.3:  # an upper front above the first rows
            height = size * rng.uniform(0.5, 1.5)
            board = hoarding("far", height)
            lift = np.array([0.0, rng.uniform(2, 12), rng.uniform(2.5, 7.0)]) * size
            planes.append(
                Plane(
                    corners=board.corners + lift,
                    origin=board.origin + lift,
                    right=board.right,
                    down=board.down,
                    texture=board.texture,
                    base=board.base,
                    gain=board.gain,
                    alpha=1.0,
                    by_mask=False,
                )
            )
    else:
        back = textures.foliage[int(rng.integers(len(textures.foliage)))]
        gain = (
            np.full(3, rng.uniform(0.4, 1.3)) if kind == "club" else np.full(3, rng.uniform(0.1 if hard else 0.3, 0.8))
        )
        heights = size * rng.uniform(3.0, 9.0, 3)
        planes += [
            upright(side, h, back, np.stack([np.zeros(3), gain]), back.shape[0] / h)
            for side, h in zip(sides, heights, strict=False)
        ]
        if rng.random() < 0.35:
            return Venue(wall_x=wall_x, wall_y=wall_y, sky=sky, planes=tuple(planes), roofed=kind == "hall")
    planes.append(hoarding("far", tall))
    if rng.random() < 0.85:
        planes += [hoarding(side, side_tall) for side in sides[1:]]
    return Venue(wall_x=wall_x, wall_y=wall_y, sky=sky, planes=tuple(planes), roofed=kind == "hall")
