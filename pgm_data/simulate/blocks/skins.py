"""Skins of the block figure: the texels of its six parts, by lot."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from pgm_data.simulate.blocks.figure import PART_BOXES_M, PARTS, PIXEL_M

SKIN_TONES = ((150, 184, 228), (120, 158, 206), (96, 134, 186), (66, 98, 146), (44, 66, 104))
HAIR = ((28, 42, 66), (20, 24, 30), (60, 110, 160), (90, 176, 218), (36, 70, 150), (150, 150, 156))
CLOTH = (
    (168, 150, 28),
    (60, 60, 190),
    (70, 150, 60),
    (40, 150, 226),
    (150, 60, 120),
    (200, 200, 204),
    (52, 48, 46),
    (190, 120, 60),
)
TROUSERS = ((140, 62, 50), (70, 66, 64), (44, 60, 84), (80, 110, 130), (40, 70, 50), (100, 44, 60))
SHOES = ((70, 70, 74), (30, 32, 38), (40, 60, 92), (200, 204, 208))
FACES = ("front", "back", "left", "right", "top", "bottom")
"""Of the figure: front is +z, left is +x, top is +y in a part's frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Skin:
    """What the figure wears."""

    name: str
    faces: dict[tuple[str, str], UInt8[np.ndarray, "rows columns 3"]]
    """BGR texels by part and face, upright, as seen from outside."""


def draw_skin(rng: np.random.Generator) -> Skin:
    """A skin by lot: shirt with a pattern or without, hair long or short, sleeves long or short."""
    tone = np.array(SKIN_TONES[int(rng.integers(len(SKIN_TONES)))])
    hair = np.array(HAIR[int(rng.integers(len(HAIR)))])
    shirt, stripe = (np.array(CLOTH[int(i)]) for i in rng.choice(len(CLOTH), 2, replace=False))
    trousers = np.array(TROUSERS[int(rng.integers(len(TROUSERS)))])
    shoes = np.array(SHOES[int(rng.integers(len(SHOES)))])
    long_sleeves, long_hair = rng.random() < 0.4, rng.random() < 0.45
    pattern = int(rng.integers(4))
    faces: dict[tuple[str, str], np.ndarray] = {}
    for part, (low, high) in zip(PARTS, PART_BOXES_M, strict=True):
        size = np.round((high - low) / PIXEL_M).astype(int)
        for face in FACES:
            wide = size[2] if face in ("left", "right") else size[0]
            tall = size[2] if face in ("top", "bottom") else size[1]
            base = {"head": tone, "torso": shirt, "arm": tone, "leg": trousers}[part.split("_")[-1]]
            faces[part, face] = _cloth(rng, np.tile(base, (tall, wide, 1)))
    for face in FACES:
        _head(rng, faces["head", face], face, hair, tone, long_hair)
        _torso(faces["torso", face], face, pattern, stripe, trousers, rng)
        for side in ("L", "R"):
            arm, leg = faces[f"{side}_arm", face], faces[f"{side}_leg", face]
            if face == "top":
                arm[:] = _cloth(rng, np.tile(shirt, (*arm.shape[:2], 1)))
            elif face != "bottom":
                sleeve = 10 if long_sleeves else 4
                arm[:sleeve] = _cloth(rng, np.tile(shirt, (sleeve, arm.shape[1], 1)))
                arm[sleeve - 1] = arm[sleeve - 1] * 0.85
                leg[9:] = _cloth(rng, np.tile(shoes, (3, leg.shape[1], 1)))
            else:
                leg[:] = _cloth(rng, np.tile(shoes * 0.7, (*leg.shape[:2], 1)))
    number = int(rng.integers(1000))
    return Skin(name=f"skin{number:03d}", faces={k: v.astype(np.uint8) for k, v in faces.items()})


def _cloth(rng: np.random.Generator, picture: np.ndarray) -> np.ndarray:
    shade = 1 + 0.05 * rng.integers(-1, 2, picture.shape[:2])
    return np.clip(picture * shade[..., None], 0, 255)


def _head(
    rng: np.random.Generator, face: np.ndarray, side: str, hair: np.ndarray, tone: np.ndarray, long_hair: bool
) -> None:
    strands = _cloth(rng, np.tile(hair, (8, 8, 1)))
    if side == "top":
        face[:] = strands
    elif side == "back":
        rows = 7 if long_hair else 5
        face[:rows] = strands[:rows]
    elif side in ("left", "right"):
        face[:2] = strands[:2]
        # Seen from outside, the front is at the left edge of the left side and at the right edge of the right one.
        behind = slice(3, 8) if side == "left" else slice(0, 5)
        rear = slice(5, 8) if side == "left" else slice(0, 3)
        face[:4, behind] = strands[:4, behind]
        face[: 7 if long_hair else 5, rear] = strands[: 7 if long_hair else 5, rear]
        face[4, 3 if side == "left" else 4] = tone * 0.85
    elif side == "front":
        face[:2] = strands[:2]
        face[2, [0, 7]] = strands[2, [0, 7]]
        face[4, [1, 6]] = (250, 250, 250)
        face[4, [2, 5]] = rng.choice(np.array([(150, 70, 40), (50, 90, 40), (30, 50, 80)]))
        face[3, [1, 2, 5, 6]] = tone * 0.82
        face[5, 3:5] = tone * 0.8
        face[6, 2:6] = tone * np.array([0.7, 0.62, 0.74])


def _torso(
    face: np.ndarray, side: str, pattern: int, stripe: np.ndarray, trousers: np.ndarray, rng: np.random.Generator
) -> None:
    if side in ("top", "bottom"):
        return
    if pattern == 1:
        face[4:6] = _cloth(rng, np.tile(stripe, (2, face.shape[1], 1)))
    elif pattern == 2 and side in ("front", "back"):
        face[:, 3:5] = _cloth(rng, np.tile(stripe, (12, 2, 1)))
    elif pattern == 3 and side == "front":
        face[3:7, 2:6] = _cloth(rng, np.tile(stripe, (4, 4, 1)))
    face[10] = np.clip(trousers * 0.6, 0, 255)
    face[11] = trousers
