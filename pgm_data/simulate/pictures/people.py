"""Person-like silhouettes, furniture and their shadows, as flat shapes turned to the camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int

from pgm_data.simulate.pictures.shapes import Polygons, polygons, stacked

_ARC = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 6)
_CAP = np.stack([np.cos(_ARC), np.sin(_ARC)], axis=-1)
_ROUND = np.stack([np.cos(np.linspace(0, 2 * np.pi, 13)[:-1]), np.sin(np.linspace(0, 2 * np.pi, 13)[:-1])], axis=-1)
SHIRT, LEGS, SKIN, OWN = 0, 1, 2, 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Silhouette:
    """One figure as polygons in an upright plane: right and up in units of its height, feet at the origin."""

    corners: Float[np.ndarray, "corners 2"]
    starts: Int[np.ndarray, " polygons_plus_one"]
    part: Int[np.ndarray, " polygons"]
    """Whose colour each polygon takes: shirt, legs, skin, or its own."""
    shade: Float[np.ndarray, " polygons"]
    """Factor on that colour."""
    own: Float[np.ndarray, "polygons 3"]
    """Own colours, BGR."""
    alphas: Float[np.ndarray, " polygons"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Cast:
    """Figures to place: standing and bent over, seated, and with rackets."""

    standing: tuple[Silhouette, ...]
    seated: tuple[Silhouette, ...]
    playing: tuple[Silhouette, ...]
    chairs: tuple[Silhouette, ...]
    """Umpires' high chairs."""


def draw_cast(rng: np.random.Generator, count: int = 40) -> Cast:
    """A new cast."""
    return Cast(
        standing=tuple(_person(rng, racket=False, sits=False) for _ in range(count)),
        seated=tuple(_person(rng, racket=False, sits=True) for _ in range(count)),
        playing=tuple(_person(rng, racket=True, sits=False) for _ in range(2 * count)),
        chairs=tuple(_chair(rng) for _ in range(8)),
    )


def capsule(start: np.ndarray, end: np.ndarray, radius_start: float, radius_end: float) -> np.ndarray:
    """Twelve corners of a limb in a plane: a segment with round ends, the plane's units."""
    along = np.subtract(end, start).astype(float)
    length = max(float(np.hypot(*along)), 1e-9)
    along = along / length
    across = np.array([-along[1], along[0]])
    far = end + radius_end * (_CAP[:, :1] * along + _CAP[:, 1:] * across)
    near = start + radius_start * (-_CAP[:, :1] * along - _CAP[:, 1:] * across)
    return np.concatenate([far, near])


def _silhouette(shapes: list[tuple[np.ndarray, int, float, np.ndarray, float]]) -> Silhouette:
    return Silhouette(
        corners=np.concatenate([s[0] for s in shapes]),
        starts=np.concatenate([[0], np.cumsum([len(s[0]) for s in shapes])]).astype(np.int64),
        part=np.array([s[1] for s in shapes], np.int64),
        shade=np.array([s[2] for s in shapes]),
        own=np.array([s[3] for s in shapes], dtype=float),
        alphas=np.array([s[4] for s in shapes]),
    )


def _person(rng: np.random.Generator, *, racket: bool, sits: bool) -> Silhouette:
    none = np.zeros(3)
    lean = rng.normal(0, 0.05)
    spread = abs(rng.normal(0.09, 0.16 if racket else 0.08))
    crouch = rng.uniform(0.5, 0.7) if sits else (rng.uniform(0.75, 1.0) if rng.random() < 0.4 else 1.0)
    hip = np.array([0.0, 0.5 * crouch])
    neck = hip + np.array([lean + rng.normal(0, 0.03), 0.31 * rng.uniform(0.85, 1.0)])
    head = neck + np.array([0.4 * lean, 0.095])
    shade = rng.uniform(0.55, 0.95)
    lower = SKIN if rng.random() < (0.7 if racket else 0.35) else LEGS
    shapes: list[tuple[np.ndarray, int, float, np.ndarray, float]] = []
    for side in (-1.0, 1.0):
        foot = np.array([side * spread + 0.3 * lean, 0.02])
        knee = 0.5 * (hip + foot) + np.array([side * rng.uniform(0.0, 0.07) + (1 - crouch) * 0.2 * side, 0.02])
        dark = shade if side < 0 else 1.0
        shapes.append((capsule(knee, foot, 0.033, 0.022), lower, dark, none, 1.0))
        shapes.append((capsule(hip + [0.045 * side, 0.0], knee, 0.055, 0.042), LEGS, dark, none, 1.0))
        shoe = foot + np.array([0.012 * side, -0.006])
        grey = rng.uniform(20, 250) * np.ones(3)
        shapes.append((capsule(shoe, shoe + [0.03 * side, 0], 0.018, 0.014), OWN, 1.0, grey, 1.0))
    hands = []
    for side in (-1.0, 1.0):
        shoulder = neck + np.array([side * 0.085, -0.02])
        swing = rng.uniform(-1.7, 1.4) if racket else rng.normal(-1.2, 0.35)
        elbow = shoulder + 0.16 * np.array([side * np.cos(swing), np.sin(swing)])
        bend = swing + rng.uniform(-0.3, 1.4)
        hand = elbow + 0.15 * np.array([side * np.cos(bend), np.sin(bend)])
        hands.append(hand)
        shapes.append((capsule(shoulder, elbow, 0.032, 0.026), SHIRT, 0.9, none, 1.0))
        shapes.append((capsule(elbow, hand, 0.024, 0.018), SKIN, 1.0, none, 1.0))
    shapes.append((capsule(hip + [0, 0.01], neck + [0, -0.03], 0.075, 0.088), SHIRT, 1.0, none, 1.0))
    lit = capsule(hip + [0.03, 0.02], neck + [0.03, -0.04], 0.03, 0.035)
    shapes.append((lit, SHIRT, rng.uniform(1.0, 1.25), none, 0.6))
    shapes.append((head + _ROUND * [0.045, 0.062], SKIN, 1.0, none, 1.0))
    hair = np.array([30, 40, 60]) * rng.uniform(0.2, 2.5) if rng.random() < 0.6 else rng.uniform(10, 250) * np.ones(3)
    shapes.append((head + [0, 0.022] + _ROUND * [0.047, 0.043], OWN, 1.0, hair, 1.0))
    if racket:
        hand = hands[int(rng.integers(0, 2))]
        angle = rng.uniform(-0.5, 3.6)
        away = np.array([np.cos(angle), np.sin(angle)])
        middle = hand + 0.27 * away
        colour = rng.uniform(10, 240, 3)
        shapes.append((capsule(hand, hand + 0.15 * away, 0.008, 0.008), OWN, 1.0, colour, 1.0))
        shapes.append((middle + _ROUND * [0.085, 0.085], OWN, 1.0, colour, 0.35))
        shapes.append((middle + _ROUND * [0.065, 0.065], OWN, 0.5, colour, 0.12))
    return _silhouette(shapes)


def _chair(rng: np.random.Generator) -> Silhouette:
    """Thin bars, in units of 2.7 m."""
    colour = rng.uniform(120, 250) * np.ones(3) if rng.random() < 0.6 else rng.uniform(10, 200, 3)
    bars = [((-0.6, 0), (-0.3, 1.9)), ((0.6, 0), (0.3, 1.9)), ((-0.2, 0), (-0.2, 1.9)), ((0.25, 0), (0.2, 1.9))]
    bars += [((-0.5, z), (0.5, z)) for z in np.arange(0.3, 1.9, 0.4)]
    bars += [((-0.35, 1.9), (-0.35, 2.7)), ((0.35, 1.9), (0.35, 2.7)), ((-0.35, 1.95), (0.35, 1.95))]
    ends = [(np.array(a) / 2.7, np.array(b) / 2.7) for a, b in bars]
    return _silhouette([(capsule(a, b, 0.017, 0.017), OWN, rng.uniform(0.7, 1), colour, 1.0) for a, b in ends])


def stands_facing(foot_world: np.ndarray, centre_world: np.ndarray) -> np.ndarray:
    """Unit vector along the ground that runs to the right in the picture, at this place."""
    towards = foot_world[:2] - centre_world[:2]
    length = float(np.hypot(towards[0], towards[1]))
    return np.array([1.0, 0.0, 0.0]) if length < 1e-9 else np.array([towards[1], -towards[0], 0.0]) / length


def placed(
    figure: Silhouette,
    foot_world: np.ndarray,
    centre_world: np.ndarray,
    clothes: np.ndarray,
    *,
    height_m: float = 1.8,
    flipped: bool = False,
) -> Polygons:
    """The figure at a place on the ground, turned to the camera's centre; `clothes` (3, 3): shirt, legs, skin, BGR."""
    right = stands_facing(foot_world, centre_world) * (-height_m if flipped else height_m)
    corners = foot_world + figure.corners[:, :1] * right
    corners[:, 2] += height_m * figure.corners[:, 1]
    worn = clothes[np.minimum(figure.part, 2)]
    colours = np.where((figure.part == OWN)[:, None], figure.own, worn) * figure.shade[:, None]
    return Polygons(corners=corners, starts=figure.starts, colours=np.minimum(colours, 255.0), alphas=figure.alphas)


def blob_shadow(
    foot_world: np.ndarray, height_m: float, thrown: np.ndarray, strength: float
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """The shadow of something upright; `thrown` is the ground vector by which one metre of height is thrown."""
    end = foot_world[:2] + height_m * thrown[:2]
    middle = foot_world[:2] + 0.45 * (end - foot_world[:2])
    shapes = [capsule(foot_world[:2], middle, 0.16, 0.2), capsule(middle, end, 0.25, 0.14)]
    z = np.full((12, 1), foot_world[2])
    return [(np.concatenate([s, z], axis=1), np.zeros(3), strength) for s in shapes]


def crate(
    low: np.ndarray,
    size: np.ndarray,
    colour: np.ndarray,
    centre_world: np.ndarray,
    thrown: np.ndarray | None = None,
) -> Polygons:
    """The faces of an upright box that this camera sees, shaded; by a sun that throws shadows along `thrown` if given.

    `thrown` is the ground vector by which one metre of height is thrown.
    """
    x0, y0, z0 = low
    x1, y1, z1 = low + size
    if thrown is not None:
        colour = np.minimum(colour, 215.0)
        sun = np.array([-thrown[0], -thrown[1], 1.0]) / np.sqrt(1.0 + float(thrown @ thrown))
        shade = {(axis, sign): 0.55 + 0.5 * max(0.0, sign * float(sun[axis])) for axis in (0, 1) for sign in (-1, 1)}
        side = -1 if centre_world[0] < x0 else 1
        end = -1 if centre_world[1] < y0 else 1
        faces = []
        if centre_world[0] < x0 or centre_world[0] > x1:
            x = x0 if side < 0 else x1
            face = np.array([[x, y0, z0], [x, y1, z0], [x, y1, z1], [x, y0, z1]])
            faces.append((face, shade[0, side] * colour, 1.0))
        y = y0 if end < 0 else y1
        face = np.array([[x0, y, z0], [x1, y, z0], [x1, y, z1], [x0, y, z1]])
        faces.append((face, shade[1, end] * colour, 1.0))
        if centre_world[2] > z1:
            top = np.array([[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]])
            faces.append((top, (0.6 + 0.55 * sun[2]) * colour, 1.0))
        return polygons(faces)
    shapes = []
    if centre_world[0] < x0:
        shapes.append((np.array([[x0, y0, z0], [x0, y1, z0], [x0, y1, z1], [x0, y0, z1]]), 0.6 * colour, 1.0))
    elif centre_world[0] > x1:
        shapes.append((np.array([[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1]]), 0.75 * colour, 1.0))
    front = y0 if centre_world[1] < y0 else y1
    shapes.append((np.array([[x0, front, z0], [x1, front, z0], [x1, front, z1], [x0, front, z1]]), 0.85 * colour, 1.0))
    if centre_world[2] > z1:
        top = np.array([[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]])
        shapes.append((top, np.minimum(1.1 * colour, 255), 1.0))
    return polygons(shapes)


def crate_shadow(low: np.ndarray, size: np.ndarray, thrown: np.ndarray) -> np.ndarray:
    """Corners of the shadow of an upright box on the ground at the height of z = 0, metres."""
    x0, y0, z0 = low
    foot = np.array([[x0, y0], [x0 + size[0], y0], [x0 + size[0], y0 + size[1]], [x0, y0 + size[1]]])
    ends = np.concatenate([foot + z0 * thrown, foot + (z0 + size[2]) * thrown])
    hull = cv2.convexHull(ends.astype(np.float32))[:, 0].astype(float)
    return np.concatenate([hull, np.zeros((len(hull), 1))], axis=1)


def by_distance(things: Sequence[tuple[float, Polygons]]) -> Polygons:
    """The things' polygons, the most distant first."""
    return stacked([shapes for _, shapes in sorted(things, key=lambda thing: -thing[0])])
