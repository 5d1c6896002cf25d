"""Pictures to paint with: noise, crowds, foliage, hoardings and lettering, all drawn here from random numbers.

Sides are powers of two, so that the painter can repeat them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_SCRIPT_COMPLEX,
)
_SINGLE = "BDFGKLMNPRSTVZX"
_ONSETS = (*_SINGLE, "BR", "CL", "DR", "FL", "GR", "KR", "PR", "ST", "TR", "SK", "LT", "NT", "RN", "LM", "ND")
_INNER = 5
"""How many of the last stand only within a word."""
CROWD_PX_PER_M = 34.0
"""Texture pixels per metre of stand."""
MASK_PX_PER_M = 64.0
"""Texture pixels per metre of a hoarding one metre high."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Textures:
    """A pool of pictures that every frame of one stream draws from."""

    noise: Float[np.ndarray, "512 512"]
    """Noise of several octaves that repeats, about -1 to 1."""
    crowds: tuple[UInt8[np.ndarray, "_ _ 3"], ...]
    """Rows of spectators, BGR."""
    foliage: tuple[UInt8[np.ndarray, "_ _ 3"], ...]
    """Trees, hedges and plain backdrops, BGR."""
    hoardings: tuple[UInt8[np.ndarray, "_ _ 1"], ...]
    """Lettering and marks of hoardings as masks, 64 px high."""
    words: tuple[UInt8[np.ndarray, "_ _ 1"], ...]
    """Single words and marks as masks, 64 px high."""
    patches: tuple[UInt8[np.ndarray, "_ _ 1"], ...]
    """Blotches as masks, strongest in the middle."""
    grain: tuple[Float[np.ndarray, "_ _ 3"], ...]
    """Noise of the sensor, standard deviation 1."""


def draw_textures(rng: np.random.Generator, grain_shape: tuple[int, int], count: int = 12) -> Textures:
    """A new pool; `grain_shape` (height, width) is the picture's size."""
    noise = _noise(rng)
    return Textures(
        noise=noise,
        patches=tuple(_patch(rng, noise) for _ in range(count)),
        crowds=tuple(_crowd(rng) for _ in range(count)),
        foliage=tuple(_foliage(rng) for _ in range(count)),
        hoardings=tuple(_hoarding(rng) for _ in range(3 * count)),
        words=tuple(_word(rng) for _ in range(4 * count)),
        grain=tuple(_grain(rng, grain_shape, soft) for soft in (0.0, 0.6, 0.9)),
    )


def random_word(rng: np.random.Generator, shortest: int = 2, longest: int = 10) -> str:
    """A name that nobody bears, in capitals: syllables that can be spoken."""
    length = int(rng.integers(shortest, longest + 1))
    word = ""
    vowel = rng.random() < 0.25
    while len(word) < length:
        room = len(_SINGLE) if length - len(word) < 2 else len(_ONSETS)
        word += _pick(rng, "AEIOU" if vowel else _ONSETS[:room] if word else _ONSETS[:-_INNER])
        vowel = not vowel
    if len(word) == length and rng.random() < 0.3:
        word = word[:-1] + _pick(rng, "NRSXLTKOA")
    return word[:length]


def _pick(rng: np.random.Generator, choices: Sequence[str]) -> str:
    return choices[int(rng.integers(len(choices)))]


def _noise(rng: np.random.Generator) -> np.ndarray:
    size = 512
    total = np.zeros((size, size), np.float32)
    for cells, weight in ((8, 0.5), (16, 0.4), (32, 0.35), (64, 0.3), (128, 0.25), (512, 0.35)):
        small = rng.normal(size=(cells, cells)).astype(np.float32)
        tiled = np.tile(small, (3, 3))
        big = cv2.resize(tiled, (3 * size, 3 * size), interpolation=cv2.INTER_CUBIC)
        total += np.float32(weight) * big[size : 2 * size, size : 2 * size]
    return np.clip(total / (2.0 * total.std()), -1.5, 1.5).astype(np.float32)


def _patch(rng: np.random.Generator, noise: np.ndarray) -> np.ndarray:
    size = 128
    across = np.linspace(-2.2, 2.2, size)
    hill = np.exp(-(across[:, None] ** 2) - across[None] ** 2) - np.exp(-(2.2**2))
    y, x = rng.integers(0, 512 - size, 2)
    mask = hill * (1.0 + rng.uniform(0.3, 1.4) * noise[y : y + size, x : x + size])
    return np.clip(255.0 * mask, 0, 255).astype(np.uint8)[..., None]


def _grain(rng: np.random.Generator, shape: tuple[int, int], soft: float) -> np.ndarray:
    field = rng.normal(size=(shape[0] + 64, shape[1] + 64, 1)).astype(np.float32)
    field = np.concatenate([field, field, field], axis=2) * 0.8
    field += 0.5 * rng.normal(size=field.shape).astype(np.float32)
    if soft > 0:
        field = cv2.GaussianBlur(field, (0, 0), soft)
    return field / field.std()


def _clothes(rng: np.random.Generator, count: int, style: int) -> np.ndarray:
    colours = rng.uniform(10, 235, (count, 3))
    colours += rng.uniform(0.1, 0.95, (count, 1)) * (rng.uniform(8, 235, (count, 1)) - colours)
    if style == 0:  # pale summer clothes
        colours = 0.35 * colours + 0.65 * rng.uniform(120, 250, (count, 1))
    elif style == 1:  # dark hall
        colours = 0.4 * colours + 0.2 * rng.uniform(0, 160, (count, 1))
    elif style == 2:  # one team's colour
        colours = 0.5 * colours + 0.5 * rng.uniform(10, 235, 3)
    grey = colours.mean(axis=1, keepdims=True)
    return grey + rng.uniform(0.25, 0.65) * (colours - grey)


def _crowd(rng: np.random.Generator) -> np.ndarray:
    height, width = 512, 1024
    style = int(rng.integers(0, 4))
    back = rng.uniform(5, 90) + rng.normal(0, 6, 3) if rng.random() < 0.7 else rng.uniform(60, 170, 3)
    picture = np.full((height, width, 3), back, np.uint8)
    pitch_x, pitch_y = rng.uniform(14, 22), rng.uniform(20, 34)
    filled = rng.uniform(0.35, 1.0) if rng.random() < 0.6 else 0.95
    seat = rng.uniform(10, 200, 3) if rng.random() < 0.5 else np.full(3, rng.uniform(10, 120))
    for row, y in enumerate(np.arange(0.0, height + pitch_y, pitch_y)):
        xs = np.arange((row % 2) * 0.5 * pitch_x, width, pitch_x)
        if rng.random() < 0.7:
            cv2.line(picture, (0, int(y + 0.45 * pitch_y)), (width, int(y + 0.45 * pitch_y)), (seat * 0.6).tolist(), 2)
        xs = xs + rng.normal(0, 0.12 * pitch_x, len(xs))
        ys = y + rng.normal(0, 0.08 * pitch_y, len(xs))
        colours = _clothes(rng, len(xs), style)
        skin = np.array([110, 140, 190]) * rng.uniform(0.3, 1.15, (len(xs), 1))
        hair = np.array([30, 45, 70]) * rng.uniform(0.1, 2.6, (len(xs), 1))
        hats = rng.random(len(xs)) < 0.2
        present = rng.random(len(xs)) < filled
        for x, yy, c, s, h, hat, there in zip(xs, ys, colours, skin, hair, hats, present, strict=True):
            at = (int(x), int(yy))
            if not there:
                cv2.rectangle(picture, (at[0] - 5, at[1] + 3), (at[0] + 5, at[1] + 12), seat.tolist(), -1)
                continue
            cv2.ellipse(picture, (at[0], at[1] + 11), (int(0.42 * pitch_x), 10), 0, 0, 360, c.tolist(), -1)
            cv2.circle(picture, at, 5, s.tolist(), -1)
            top = (240, 240, 240) if hat else h.tolist()
            cv2.ellipse(picture, (at[0], at[1] - 2), (5, 4), 0, 180, 360, top, -1)
    for x in np.arange(rng.uniform(0, 300), width, rng.uniform(180, 420)):
        if rng.random() < 0.6:  # stairs
            shade = (rng.uniform(40, 210) + rng.normal(0, 8, 3)).tolist()
            cv2.rectangle(picture, (int(x), 0), (int(x) + 22, height), shade, -1)
            for y in range(0, height, 9):
                cv2.line(picture, (int(x), y), (int(x) + 22, y), (np.array(shade) * 0.6).tolist(), 2)
    coarse = rng.uniform(0.55, 1.25, (4, 8)).astype(np.float32)
    shading = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(picture * shading[..., None], 0, 255).astype(np.uint8)


def _foliage(rng: np.random.Generator) -> np.ndarray:
    height, width = 256, 1024
    kind = rng.random()
    field = rng.normal(size=(height, width)).astype(np.float32)
    rough = cv2.GaussianBlur(field, (0, 0), rng.uniform(1.0, 3.0)) + 2.0 * cv2.GaussianBlur(field, (0, 0), 8.0)
    rough = rough / rough.std()
    if kind < 0.55:
        colour = np.array([40, 90, 60]) * rng.uniform(0.5, 1.3) + rng.uniform(-20, 20, 3)
        picture = colour * (1.0 + 0.4 * rough[..., None])
    elif kind < 0.8:  # a fence with posts and rails before something plain
        colour = rng.uniform(20, 200, 3)
        picture = np.clip(colour * (1.0 + 0.15 * rough[..., None]), 0, 255).astype(np.uint8)
        for x in range(0, width, int(rng.integers(40, 160))):
            cv2.line(picture, (x, 0), (x, height), (colour * 0.5 + rng.uniform(0, 120)).tolist(), 3)
        for y in rng.integers(0, height, 3):
            cv2.line(picture, (0, int(y)), (width, int(y)), (colour * 0.5 + rng.uniform(0, 120)).tolist(), 2)
    else:
        picture = _buildings(rng, height, width)
    return np.clip(picture, 0, 255).astype(np.uint8)


def _buildings(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """House fronts with rows of windows before a pale sky."""
    picture = np.full((height, width, 3), rng.uniform(150, 220) * np.array([1.05, 1.0, 0.95]), np.uint8)
    x = -int(rng.integers(0, 60))
    while x < width:
        wide, top = int(rng.integers(70, 220)), int(rng.integers(0, height // 2))
        grey = rng.uniform(70, 190)
        wall = np.clip(grey + rng.normal(0, 12) * np.array([-1.0, 0.1, 1.0]), 10, 240)
        cv2.rectangle(picture, (x, top), (x + wide, height), wall.tolist(), -1)
        cell, pane = int(rng.integers(14, 30)), (wall * rng.uniform(0.35, 0.75)).tolist()
        for y in range(top + cell // 2, height - cell // 2, cell):
            for left in range(x + cell // 3, x + wide - cell // 2, cell):
                cv2.rectangle(picture, (left, y), (left + cell // 2, y + int(0.6 * cell)), pane, -1)
        x += wide + int(rng.integers(0, 12))
    return picture


def _mark(rng: np.random.Generator, picture: np.ndarray, x: int) -> int:
    """Draws a logo-like figure at x of a mask 64 px high; returns where the next may start."""
    size = int(rng.integers(18, 50))
    y = int(rng.integers(8, 60 - min(size, 50)))
    kind = int(rng.integers(0, 5))
    if kind == 0:
        cv2.circle(picture, (x + size // 2, y + size // 2), size // 2, 255, int(rng.choice([-1, 2, 4])))
    elif kind == 1:
        cv2.rectangle(picture, (x, y), (x + size, y + size), 255, int(rng.choice([-1, 2, 4])))
    elif kind == 2:
        corners = rng.integers(0, size + 1, (int(rng.integers(3, 6)), 2)) + np.array([x, y])
        cv2.fillPoly(picture, [corners.astype(np.int32)], 255)
    elif kind == 3:
        middle, turn = (x + size // 2, y + size // 2), float(rng.uniform(0, 180))
        cv2.ellipse(picture, middle, (size // 2, size // 4), turn, 0, 300, 255, 3)
    else:
        for step in range(4):
            cv2.line(picture, (x + step * size // 4, y), (x + step * size // 4 + size // 5, y + size), 255, 3)
    return x + size + int(rng.integers(4, 20))


def _text(rng: np.random.Generator, picture: np.ndarray, x: int, limit: int) -> int:
    word = random_word(rng)
    font = int(rng.choice(FONTS))
    thick = int(rng.integers(1, 6))
    scale = rng.uniform(0.7, 1.7)
    (wide, tall), _ = cv2.getTextSize(word, font, scale, thick)
    if x + wide > limit or tall > 58:
        scale *= min((limit - x) / max(wide, 1), 58 / max(tall, 1))
        if scale < 0.4:
            return limit
        (wide, tall), _ = cv2.getTextSize(word, font, scale, thick)
    y = int(rng.integers(tall + 2, max(tall + 3, 62)))
    cv2.putText(picture, word, (x, y), font, scale, 255, thick, cv2.LINE_AA)
    return x + wide + int(rng.integers(6, 60))


def _hoarding(rng: np.random.Generator) -> np.ndarray:
    width = 1024
    picture = np.zeros((64, width), np.uint8)
    x = int(rng.integers(5, 100))
    gap = rng.uniform(0, 160)
    while x < width - 80:
        x = _mark(rng, picture, x) if rng.random() < 0.35 else _text(rng, picture, x, width - 4)
        x += int(rng.uniform(0, gap))
    if rng.random() < 0.25:
        cv2.line(picture, (0, 2), (width, 2), 255, int(rng.integers(1, 5)))
    if rng.random() < 0.2:
        cv2.line(picture, (0, 61), (width, 61), 255, int(rng.integers(1, 5)))
    if rng.random() < 0.25:
        picture = 255 - picture
    return picture[..., None]


def _word(rng: np.random.Generator) -> np.ndarray:
    picture = np.zeros((64, 512), np.uint8)
    end = _text(rng, picture, 8, 500) if rng.random() < 0.75 else _mark(rng, picture, 8)
    wide = 2 ** int(np.clip(np.round(np.log2(end)), 6, 9))
    cut = picture[:, : int(np.clip(end, 40, 512))]
    return cv2.resize(cut, (wide, 64), interpolation=cv2.INTER_AREA)[..., None]
