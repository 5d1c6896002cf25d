"""What people on and about a court wear."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

Role = Literal["player", "umpire", "line_judge", "ball_kid"]
Build = Literal["man", "woman"]
Top = Literal["tee", "polo", "sleeveless", "tank", "long", "blazer"]
Bottom = Literal["shorts", "skirt", "dress", "tights", "trousers"]
Hair = Literal["bald", "buzz", "short", "thick", "bob", "ponytail", "bun"]
Headwear = Literal["none", "cap", "cap_back", "headband", "visor", "hat"]
Pattern = Literal["plain", "yoke", "chest_band", "hoops", "side_panels", "sleeves", "halves"]

Colour = Float[np.ndarray, " 3"]

SKIN = np.array(
    [[168, 196, 236], [150, 182, 226], [132, 168, 214], [104, 140, 190], [78, 110, 160], [48, 72, 112]], float
)
"""BGR, fair to dark."""
HAIR = np.array([[22, 24, 28], [30, 42, 62], [42, 66, 98], [70, 116, 160], [96, 160, 205], [34, 62, 120]], float)
VIVID = np.array(
    [
        [190, 80, 20], [60, 30, 190], [40, 150, 30], [30, 200, 230], [20, 110, 240], [150, 60, 150],
        [200, 190, 40], [110, 40, 20], [40, 20, 90], [160, 120, 240], [60, 220, 160], [180, 150, 90],
    ],
    float,
)  # fmt: skip
GREYS = np.array([[245, 245, 245], [225, 225, 225], [40, 38, 36], [24, 24, 26], [110, 105, 100], [72, 46, 30]], float)


@dataclass(frozen=True, eq=False, kw_only=True)
class BodyLook:
    """One person's body and clothes; colours BGR 0 to 255, as a white sky would show them."""

    build: Build
    skin: Colour
    hair: Hair
    hair_colour: Colour
    beard: float
    """0 shaven to 1 full."""
    headwear: Headwear
    headwear_colour: Colour
    top: Top
    pattern: Pattern
    top_colours: Float[np.ndarray, "3 3"]
    """Cloth, pattern, collar and hems."""
    bottom: Bottom
    bottom_colours: Float[np.ndarray, "2 3"]
    """Cloth, side stripe and hem."""
    hem: float
    """Length of shorts or skirt, 0 short to 1 to the knee."""
    loose: float
    """Width of the clothes, 0 tight to 1 wide."""
    sleeve: float
    """Length of short sleeves, 0 to 1."""
    socks: Colour
    sock_height: float
    """0 at the ankle to 1 below the knee."""
    shoes: Float[np.ndarray, "2 3"]
    """Upper, sole."""
    wristbands: tuple[bool, bool]
    """Left, right."""
    band_colour: Colour
    racket: Float[np.ndarray, "3 3"]
    """Frame, pattern of the frame, strings."""


def draw_look(rng: np.random.Generator, role: Role, *, white: bool) -> BodyLook:
    """A look by lot; `white` for places where players must wear white."""
    if role == "player":
        return _player(rng, white)
    build: Build = "man" if rng.random() < 0.6 else "woman"
    dark = GREYS[int(rng.integers(2, 6))]
    base = _some(rng)
    kid = role == "ball_kid"
    blazer = role == "umpire" and rng.random() < 0.5
    bottom: Bottom = "shorts" if kid and rng.random() < 0.8 else "trousers"
    headwear: Headwear = "none" if role == "umpire" else _pick(rng, ("cap", "none", "hat"), (0.6, 0.25, 0.15))
    pattern: Pattern = _pick(rng, ("plain", "yoke", "side_panels", "sleeves"), (0.5, 0.2, 0.15, 0.15))
    pale = GREYS[int(rng.integers(0, 2))]
    cloth = dark * 1.2 if blazer else base
    return BodyLook(
        **_person(rng, build),
        headwear=headwear,
        headwear_colour=base if rng.random() < 0.5 else pale,
        top="blazer" if blazer else _pick(rng, ("polo", "tee", "long"), (0.6, 0.25, 0.15)),
        pattern="plain" if blazer else pattern,
        top_colours=np.stack([cloth, pale, pale if blazer else _near(rng, base)]),
        bottom=bottom,
        bottom_colours=np.stack([dark if rng.random() < 0.7 else pale * 0.85, base]),
        hem=float(rng.uniform(0.4, 0.9)),
        loose=float(rng.uniform(0.4, 0.9)),
        sleeve=float(rng.uniform(0.4, 1.0)),
        socks=pale.copy(),
        sock_height=float(rng.uniform(0.1, 0.5)),
        shoes=np.stack([pale if kid else dark, pale]),
        wristbands=(False, False),
        band_colour=pale.copy(),
        racket=np.stack([dark, base, pale]),
    )


def _player(rng: np.random.Generator, white: bool) -> BodyLook:
    build: Build = "man" if rng.random() < 0.55 else "woman"
    first, second = _some(rng), _some(rng)
    if rng.random() < 0.35:
        second = GREYS[int(rng.integers(0, 4))].copy()
    if white:
        first, second = rng.uniform(236, 250) * np.ones(3), rng.uniform(225, 245) * np.ones(3)
    top: Top
    bottom: Bottom
    if build == "man":
        top = _pick(rng, ("tee", "polo", "sleeveless", "long"), (0.58, 0.28, 0.1, 0.04))
        bottom = _pick(rng, ("shorts", "trousers"), (0.985, 0.015))
        headwear = _pick(rng, ("none", "cap", "cap_back", "headband"), (0.36, 0.2, 0.14, 0.3))
    else:
        top = _pick(rng, ("tank", "sleeveless", "tee", "long"), (0.5, 0.2, 0.25, 0.05))
        bottom = _pick(rng, ("skirt", "dress", "shorts", "tights"), (0.55, 0.25, 0.15, 0.05))
        headwear = _pick(rng, ("none", "cap", "headband", "visor"), (0.35, 0.15, 0.2, 0.3))
    low = first if bottom == "dress" or rng.random() < 0.35 else _some(rng)
    if rng.random() < 0.4 and bottom != "dress":
        low = GREYS[int(rng.integers(0, 4))].copy()
    if white:
        low = rng.uniform(232, 250) * np.ones(3)
    accent = _near(rng, first) if white else (second if rng.random() < 0.5 else _some(rng))
    bands = rng.random(2) < (0.75, 0.3)
    pale = GREYS[int(rng.integers(0, 2))].copy()
    shoe = pale if white or rng.random() < 0.45 else _some(rng)
    sock = pale if white or rng.random() < 0.75 else GREYS[int(rng.integers(2, 4))].copy()
    return BodyLook(
        **_person(rng, build),
        headwear=headwear,
        headwear_colour=pale if white or rng.random() < 0.5 else second.copy(),
        top=top,
        pattern=_pick(
            rng,
            ("plain", "yoke", "chest_band", "hoops", "side_panels", "sleeves", "halves"),
            (0.34, 0.12, 0.12, 0.08, 0.16, 0.12, 0.06),
        ),
        top_colours=np.stack([first, second, accent]),
        bottom=bottom,
        bottom_colours=np.stack([low, accent]),
        hem=float(rng.uniform(0.25, 1.0) if build == "man" else rng.uniform(0.0, 0.5)),
        loose=float(rng.uniform(0.35, 0.9) if build == "man" else rng.uniform(0.1, 0.6)),
        sleeve=float(rng.uniform(0.2, 1.0)),
        socks=sock,
        sock_height=float(np.clip(rng.normal(0.35, 0.18), 0.05, 0.9)),
        shoes=np.stack([shoe, pale if rng.random() < 0.7 else _some(rng)]),
        wristbands=(bool(bands[0]), bool(bands[1])),
        band_colour=pale if white or rng.random() < 0.6 else accent.copy(),
        racket=np.stack([_dark_or(rng), _some(rng), rng.uniform(150, 240) * np.ones(3)]),
    )


def _person(rng: np.random.Generator, build: Build) -> dict:
    share = float(np.clip(rng.beta(1.3, 1.6), 0, 1)) * (len(SKIN) - 1)
    at = min(int(share), len(SKIN) - 2)
    skin = SKIN[at] + (share - at) * (SKIN[at + 1] - SKIN[at])
    hairs = HAIR[:2] if share > 3.2 else HAIR
    if build == "man":
        hair: Hair = _pick(rng, ("short", "buzz", "thick", "bald", "bun"), (0.48, 0.18, 0.24, 0.05, 0.05))
    else:
        hair = _pick(rng, ("ponytail", "bun", "bob", "thick"), (0.68, 0.17, 0.12, 0.03))
    return {
        "build": build,
        "skin": skin * rng.uniform(0.95, 1.05),
        "hair": hair,
        "hair_colour": hairs[int(rng.integers(len(hairs)))] * rng.uniform(0.8, 1.2),
        "beard": float(rng.uniform(0.2, 0.9)) if build == "man" and rng.random() < 0.45 else 0.0,
    }


def _pick(rng: np.random.Generator, of: tuple, shares: tuple[float, ...]):
    return of[int(rng.choice(len(of), p=np.array(shares) / np.sum(shares)))]


def _some(rng: np.random.Generator) -> np.ndarray:
    """A colour of sports clothes."""
    kind = rng.random()
    if kind < 0.2:
        return GREYS[int(rng.integers(0, 2))].copy()
    if kind < 0.4:
        return GREYS[int(rng.integers(2, 6))] * rng.uniform(0.9, 1.3)
    colour = VIVID[int(rng.integers(len(VIVID)))] * rng.uniform(0.75, 1.2)
    return np.clip(colour + rng.uniform(-15, 15, 3), 12, 245)


def _near(rng: np.random.Generator, colour: np.ndarray) -> np.ndarray:
    return np.clip(colour * rng.uniform(0.55, 0.92), 12, 245)


def _dark_or(rng: np.random.Generator) -> np.ndarray:
    return GREYS[int(rng.integers(2, 4))] * rng.uniform(0.8, 1.5) if rng.random() < 0.6 else _some(rng)
