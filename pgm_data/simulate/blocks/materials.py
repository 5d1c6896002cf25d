"""What blocks are made of, and the pictures of 16 x 16 texels on their faces."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import UInt8

TEXELS = 16
Texture = UInt8[np.ndarray, "16 16 4"]
"""BGR and coverage; row 0 is the upper edge."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Material:
    """One kind of filling."""

    name: str
    top: str
    """Names of the textures."""
    side: str
    solid: bool = True
    opaque: bool = True
    """Whether it hides the faces behind it and throws shadows."""
    standable: bool = True


def _plain(name: str, top: str = "", **kind: bool) -> Material:
    return Material(name=name, top=top or name, side=name, **kind)


COLOURS = {
    "red": (46, 38, 168),
    "blue": (160, 68, 52),
    "yellow": (40, 196, 244),
    "green": (36, 122, 84),
    "white": (226, 232, 232),
    "purple": (170, 46, 124),
    "orange": (24, 122, 238),
    "pink": (170, 140, 236),
}

MATERIALS = (
    _plain("air", solid=False, opaque=False, standable=False),
    Material(name="grass", top="grass", side="grass_side"),
    _plain("dirt"),
    _plain("stone"),
    _plain("cobblestone"),
    _plain("stone_bricks"),
    _plain("brick"),
    _plain("planks"),
    _plain("birch_planks"),
    _plain("sandstone", "sand"),
    _plain("oak_log", "oak_log_top"),
    _plain("birch_log", "birch_log_top"),
    _plain("dark_log", "dark_log_top"),
    _plain("leaves", standable=False),
    _plain("glass", opaque=False),
    _plain("water", standable=False),
    _plain("gravel"),
    _plain("sand"),
    _plain("quartz"),
    _plain("path", "path"),
    _plain("ore"),
    *(_plain(f"{colour}_block") for colour in COLOURS),
)


@cache
def material_id(name: str) -> int:
    """Number of a material in `MATERIALS`."""
    for index, material in enumerate(MATERIALS):
        if material.name == name:
            return index
    raise ValueError(f"material: expected one of {', '.join(m.name for m in MATERIALS)}, got {name!r}")


def _shaded(base: tuple[int, int, int], shade: np.ndarray) -> Texture:
    picture = np.full((TEXELS, TEXELS, 4), 255, dtype=np.uint8)
    picture[..., :3] = np.clip(np.array(base) * shade[..., None], 0, 255)
    return picture


def _speckled(rng: np.random.Generator, base: tuple[int, int, int], spread: float, steps: int = 5) -> Texture:
    """Every texel its own shade of the colour, out of a few."""
    shade = 1.0 + spread * (rng.integers(0, steps, (TEXELS, TEXELS)) / (steps - 1) * 2 - 1)
    return _shaded(base, shade)


def _blotched(rng: np.random.Generator, base: tuple[int, int, int], spread: float) -> Texture:
    """Speckles with runs of one shade along x, as stone has."""
    coarse = np.repeat(rng.uniform(-1, 1, (TEXELS, 6)), 3, axis=1)
    coarse = np.stack([np.roll(row, rng.integers(0, 3))[:TEXELS] for row in coarse])
    shade = 1 + spread * np.round(2 * (0.7 * coarse + 0.3 * rng.uniform(-1, 1, (TEXELS, TEXELS)))) / 2
    return _shaded(base, shade)


def _cobble(rng: np.random.Generator, base: tuple[int, int, int]) -> Texture:
    """Rounded stones: cells about points on a torus, dark joints."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(4), indexing="ij"))
    points = np.stack([x * 4 + rng.uniform(0, 3.5, 16), y * 4 + rng.uniform(0, 3.5, 16)], axis=1)
    grid = np.stack(np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5, indexing="ij"), axis=-1)
    away = np.abs(grid[:, :, None] - points)
    away = np.linalg.norm(np.minimum(away, 16 - away), axis=-1)
    order = np.sort(away, axis=-1)
    own = rng.uniform(0.82, 1.12, 16)[away.argmin(axis=-1)]
    shade = own * np.where(order[..., 1] - order[..., 0] < 0.9, 0.62, 1.0) * rng.uniform(0.95, 1.05, (16, 16))
    return _shaded(base, shade)


def _brick(rng: np.random.Generator, base: tuple[int, int, int], joint: tuple[int, int, int], rows: int, wide: int):
    picture = _speckled(rng, base, 0.07)
    tall = TEXELS // rows
    for row in range(rows):
        tone = rng.uniform(0.88, 1.1, TEXELS // wide + 1)
        for x in range(TEXELS):
            place = (x + (wide // 2 if row % 2 else 0)) % TEXELS
            texels = picture[row * tall : (row + 1) * tall, x, :3]
            texels[:] = np.clip(texels * tone[place // wide], 0, 255)
            texels[-1] = np.array(joint) * rng.uniform(0.95, 1.05)
            if place % wide == wide - 1:
                texels[:] = np.array(joint) * rng.uniform(0.93, 1.05)
            elif tall > 3:
                texels[0] = np.clip(texels[0] * 1.1, 0, 255)
    return picture


def _boards(rng: np.random.Generator, base: tuple[int, int, int]) -> Texture:
    """Four boards with grain and a seam each."""
    picture = _speckled(rng, base, 0.03)
    for row in range(4):
        board = picture[4 * row : 4 * row + 4, :, :3]
        grain = rng.uniform(0.9, 1.06, (4, 1)) * np.where(rng.random((4, TEXELS)) < 0.2, 0.92, 1.0)
        board[:] = np.clip(board * (rng.uniform(0.94, 1.06) * grain)[..., None], 0, 255)
        board[-1] = board[-1] * 0.68
        board[:3, (5, 13, 2, 10)[row]] = board[:3, (5, 13, 2, 10)[row]] * 0.74
    return picture


def _bark(rng: np.random.Generator, base: tuple[int, int, int], spread: float) -> Texture:
    columns = 1 + spread * rng.choice([-1.0, -0.4, 0.3, 0.8], TEXELS)
    shade = columns[None] * np.repeat(rng.uniform(1 - spread / 2, 1 + spread / 2, (8, TEXELS)), 2, axis=0)
    return _shaded(base, shade)


def _birch(rng: np.random.Generator) -> Texture:
    picture = _bark(rng, (205, 218, 222), 0.05)
    for _ in range(9):
        x, y, wide = int(rng.integers(0, 14)), int(rng.integers(0, 16)), int(rng.integers(2, 5))
        picture[y, x : x + wide, :3] = np.array((38, 40, 44)) * rng.uniform(0.9, 1.6)
    return picture


def _rings(rng: np.random.Generator, wood: tuple[int, int, int], bark: tuple[int, int, int]) -> Texture:
    far = np.maximum(*np.abs(np.mgrid[0:16, 0:16] - 7.5))
    picture = _shaded(wood, np.where(far.astype(int) % 2 == 0, 0.86, 1.05) * rng.uniform(0.96, 1.04, (16, 16)))
    picture[far > 7, :3] = _speckled(rng, bark, 0.1)[far > 7, :3]
    return picture


def _leafy(rng: np.random.Generator) -> Texture:
    shade = rng.choice([0.42, 0.7, 0.9, 1.08, 1.22], (TEXELS, TEXELS), p=[0.16, 0.22, 0.27, 0.23, 0.12])
    return _shaded((42, 128, 62), shade)


def _grass_side(rng: np.random.Generator) -> Texture:
    picture = texture("dirt").copy()
    blades = _speckled(rng, GRASS, 0.16)
    hang = rng.choice([2, 3, 3, 4, 5], TEXELS)
    over = np.arange(TEXELS)[:, None] < hang
    picture[over] = blades[over]
    return picture


def _glass(rng: np.random.Generator) -> Texture:
    picture = np.zeros((TEXELS, TEXELS, 4), dtype=np.uint8)
    frame = np.zeros((TEXELS, TEXELS), dtype=bool)
    frame[[0, -1]] = frame[:, [0, -1]] = True
    for start, length in ((3, 4), (9, 3)):
        for step in range(length):
            frame[start + length - step, start + step] = True
    picture[frame] = (238, 232, 214, 255)
    picture[frame, :3] = picture[frame, :3] * rng.uniform(0.9, 1.0, (int(frame.sum()), 1))
    return picture


def _ladder(rng: np.random.Generator) -> Texture:
    picture = np.zeros((TEXELS, TEXELS, 4), dtype=np.uint8)
    wood = _speckled(rng, (58, 104, 146), 0.12)
    for x in (2, 3, 12, 13):
        picture[:, x] = wood[:, x]
    for y in (2, 6, 10, 14):
        picture[y, 1:15] = wood[y, 1:15]
        picture[y + 1, 1:15, :3] = wood[y, 1:15, :3] * 0.62
        picture[y + 1, 1:15, 3] = 255
    return picture


def _decorated(rng: np.random.Generator, colour: tuple[int, int, int]) -> Texture:
    """Coloured cloth in a pale frame with a diamond."""
    picture = _speckled(rng, colour, 0.07)
    x, y = np.mgrid[0:16, 0:16]
    edge = (x < 1) | (y < 1) | (x > 14) | (y > 14)
    diamond = np.abs(x - 7.5) + np.abs(y - 7.5)
    ring = (diamond > 4) & (diamond < 6)
    pale = _speckled(rng, (196, 214, 222) if sum(colour) < 560 else (60, 70, 80), 0.05)
    picture[ring] = pale[ring]
    picture[edge, :3] = picture[edge, :3] * 0.6
    return picture


def _plant(rng: np.random.Generator, petal: tuple[int, int, int] | None) -> Texture:
    picture = np.zeros((TEXELS, TEXELS, 4), dtype=np.uint8)
    green = _speckled(rng, (44, 140, 74), 0.2)
    if petal is None:
        for _ in range(11):
            x, tall = float(rng.uniform(2, 13)), int(rng.integers(5, 12))
            lean = rng.uniform(-0.25, 0.25)
            for step in range(tall):
                place = int(np.clip(x + lean * step, 0, 15))
                picture[15 - step, place] = green[15 - step, place]
        return picture
    picture[8:, 7] = green[8:, 7]
    picture[11, 8:10] = picture[12, 5:7] = green[11, 0]
    head = np.zeros((TEXELS, TEXELS), dtype=bool)
    head[4:8, 6:9] = head[5:7, 5:10] = True
    picture[head] = _speckled(rng, petal, 0.1)[head]
    picture[5:7, 7, :3] = (60, 210, 245)
    return picture


def _quartz(rng: np.random.Generator) -> Texture:
    picture = _speckled(rng, (222, 228, 232), 0.02)
    picture[[0, 7, 8, 15], :, :3] = picture[[0, 7, 8, 15], :, :3] * 0.93
    picture[:, [0, 15], :3] = picture[:, [0, 15], :3] * 0.93
    return picture


def _ore(rng: np.random.Generator) -> Texture:
    picture = texture("stone").copy()
    for _ in range(6):
        x, y = rng.integers(1, 13, 2)
        picture[y : y + 2, x : x + 3, :3] = np.array((150, 196, 216)) * rng.uniform(0.8, 1.1)
        picture[y + 1, x, :3] = (60, 64, 66)
    return picture


def _sandstone(rng: np.random.Generator) -> Texture:
    picture = _blotched(rng, (160, 204, 220), 0.05)
    picture[[3, 10], :, :3] = picture[[3, 10], :, :3] * 0.84
    picture[15, :, :3] = picture[15, :, :3] * 0.78
    return picture


GRASS = (66, 158, 104)
_PAINTERS: dict[str, Callable[[np.random.Generator], Texture]] = {
    "grass": lambda rng: _speckled(rng, GRASS, 0.16),
    "grass_side": _grass_side,
    "dirt": lambda rng: _speckled(rng, (62, 94, 134), 0.2),
    "stone": lambda rng: _blotched(rng, (126, 126, 126), 0.08),
    "cobblestone": lambda rng: _cobble(rng, (132, 132, 132)),
    "stone_bricks": lambda rng: _brick(rng, (126, 124, 122), (84, 83, 82), 2, 8),
    "brick": lambda rng: _brick(rng, (76, 94, 156), (140, 152, 160), 4, 8),
    "planks": lambda rng: _boards(rng, (86, 136, 172)),
    "birch_planks": lambda rng: _boards(rng, (124, 182, 204)),
    "sandstone": _sandstone,
    "sand": lambda rng: _speckled(rng, (162, 208, 222), 0.06),
    "oak_log": lambda rng: _bark(rng, (50, 80, 104), 0.2),
    "oak_log_top": lambda rng: _rings(rng, (92, 146, 180), (50, 80, 104)),
    "birch_log": _birch,
    "birch_log_top": lambda rng: _rings(rng, (134, 188, 208), (205, 218, 222)),
    "dark_log": lambda rng: _bark(rng, (26, 40, 56), 0.22),
    "dark_log_top": lambda rng: _rings(rng, (36, 62, 90), (26, 40, 56)),
    "leaves": _leafy,
    "glass": _glass,
    "water": lambda rng: _blotched(rng, (206, 104, 52), 0.09),
    "gravel": lambda rng: _speckled(rng, (128, 130, 136), 0.2, 4),
    "quartz": _quartz,
    "path": lambda rng: _speckled(rng, (78, 128, 156), 0.12),
    "ore": _ore,
    "ladder": _ladder,
    "tuft": lambda rng: _plant(rng, None),
    "poppy": lambda rng: _plant(rng, (40, 36, 206)),
    "dandelion": lambda rng: _plant(rng, (40, 214, 250)),
    "daisy": lambda rng: _plant(rng, (238, 236, 234)),
    **{f"{name}_block": (lambda rng, c=colour: _decorated(rng, c)) for name, colour in COLOURS.items()},
}
TEXTURES = tuple(_PAINTERS)


@cache
def texture(name: str) -> Texture:
    """The picture of that name; the same in every world. Read only."""
    if name not in _PAINTERS:
        raise ValueError(f"texture: expected one of {', '.join(TEXTURES)}, got {name!r}")
    picture = _PAINTERS[name](np.random.default_rng([1613, TEXTURES.index(name)]))
    picture.setflags(write=False)
    return picture
