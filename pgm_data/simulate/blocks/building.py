"""Worlds of blocks by lot: platforms, pillars, stairs, ladders, a bridge, decorated blocks, trees, a pond."""

from dataclasses import dataclass, field

import numpy as np

from pgm_data.simulate.blocks.materials import COLOURS, material_id
from pgm_data.simulate.blocks.naming import Draft, named
from pgm_data.simulate.blocks.world import CELLS, COLUMNS, GROUND_CELL, BlockWorld, Ladder, Plant, fill

PLATFORM_WORDS = {
    "stone": "stone_bricks",
    "cobblestone": "cobblestone",
    "brick": "brick",
    "wooden": "planks",
    "sandstone": "sandstone",
    "quartz": "quartz",
}
PILLAR_WORDS = {"wooden": "oak_log", "birch": "birch_log", "dark": "dark_log", "stone": "stone", "glass": "glass"}
SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))


@dataclass(eq=False)
class _Site:
    """A world while it is built."""

    rng: np.random.Generator
    cells: np.ndarray
    taken: np.ndarray
    """Columns with something on them."""
    drafts: list[Draft] = field(default_factory=list)
    ladders: list[Ladder] = field(default_factory=list)

    def free(self, columns: list[tuple[int, int]], margin: int) -> bool:
        """Whether the columns lie inside of the rim and nothing stands within the margin."""
        for i, j in columns:
            if not (1 <= i < COLUMNS - 1 and 1 <= j < COLUMNS - 1):
                return False
            if self.taken[max(i - margin, 0) : i + margin + 1, max(j - margin, 0) : j + margin + 1].any():
                return False
        return True

    def put(self, draft: Draft, material: str, bottom: int = 0) -> None:
        """Build a thing of one material from the ground (or a level) to its tops."""
        for (i, j), level in zip(draft.columns, draft.levels, strict=True):
            fill(self.cells, (i, j), bottom, level, material)
            self.taken[i, j] = True
        self.drafts.append(draft)


def build_world(rng: np.random.Generator) -> BlockWorld:
    """One world; what cannot be placed is left out, so worlds differ in what they have."""
    cells = np.zeros(CELLS, dtype=np.uint8)
    _ground(rng, cells)
    site = _Site(rng, cells, np.zeros((COLUMNS, COLUMNS), dtype=bool))
    quadrants = [(0, 0), (8, 0), (0, 8), (8, 8)]
    rng.shuffle(quadrants)
    words = list(rng.permutation(list(PLATFORM_WORDS)))
    height = int(rng.choice([4, 6]))
    big = _platform(site, quadrants[0], words[0], _size(rng, 4, 6), height)
    other = _platform(site, quadrants[1], words[1], _size(rng, 3, 5), int(rng.choice([height, 4, 6, 2])))
    small = _platform(site, quadrants[2], words[2], _size(rng, 2, 4), int(rng.choice([2, 3, 4])))
    _bridge(site, big, other)
    stairs_of = (big, other)[int(rng.integers(2))]
    if not _stairs(site, stairs_of):
        _stairs(site, big if stairs_of is other else other)
    _pillar_row(site, quadrants[3])
    for draft in (big, other, small):
        if all(d.leads_to is not draft for d in site.drafts) and max(draft.levels) > 2 or rng.random() < 0.35:
            _ladder(site, draft)
    for word in rng.permutation(["birch", "stone", "dark", "glass"])[: int(rng.integers(2, 4))]:
        _pillar(site, str(word), int(rng.choice([2, 2, 4, 4, 6])))
    for colour in rng.permutation(list(COLOURS))[: int(rng.integers(3, 6))]:
        _block(site, str(colour))
    _pond(site)
    for _ in range(int(rng.integers(1, 3))):
        _tree(site)
    posts = _fence(site)
    plants = _plants(site)
    return BlockWorld(
        cells=cells, elements=named(site.drafts), ladders=tuple(site.ladders), plants=tuple(plants), posts=posts
    )


def _ground(rng: np.random.Generator, cells: np.ndarray) -> None:
    cells[:, :, :GROUND_CELL] = material_id("stone")
    cells[:, :, GROUND_CELL - 2 : GROUND_CELL] = material_id("grass")
    for _ in range(12):
        i, j = rng.integers(0, 16, 2)
        cells[2 * i : 2 * i + 2, 2 * j : 2 * j + 2, 0:2] = material_id(str(rng.choice(["ore", "dirt", "gravel"])))
    for _ in range(int(rng.integers(1, 4))):
        patch = str(rng.choice(["path", "gravel", "cobblestone", "sand", "dirt"]))
        at, reach = rng.uniform(2, 14, 2), rng.uniform(1.0, 2.6, 2)
        i, j = np.mgrid[0:16, 0:16] + 0.5
        ragged = rng.uniform(0.8, 1.25, (16, 16))
        for column in np.argwhere(((i - at[0]) / reach[0]) ** 2 + ((j - at[1]) / reach[1]) ** 2 < ragged):
            fill(cells, (int(column[0]), int(column[1])), -2, 0, patch)


def _size(rng: np.random.Generator, least: int, end: int) -> tuple[int, int]:
    return int(rng.integers(least, end)), int(rng.integers(least, end))


def _rectangle(corner: tuple[int, int], size: tuple[int, int]) -> list[tuple[int, int]]:
    return [(corner[0] + a, corner[1] + b) for a in range(int(size[0])) for b in range(int(size[1]))]


def _platform(site: _Site, quadrant: tuple[int, int], word: str, size: tuple[int, int], level: int) -> Draft:
    low = [1 if q == 0 else 8 for q in quadrant]
    high = [(7 if q == 0 else 14) - int(s) + 1 for q, s in zip(quadrant, size, strict=True)]
    corner = tuple(int(site.rng.integers(a, max(b, a) + 1)) for a, b in zip(low, high, strict=True))
    columns = _rectangle((corner[0], corner[1]), size)
    draft = Draft("platform", str(word), columns, [level] * len(columns))
    site.put(draft, PLATFORM_WORDS[str(word)])
    return draft


def _bridge(site: _Site, a: Draft, b: Draft) -> None:
    if max(a.levels) != max(b.levels):
        return
    for axis in (0, 1):
        rows = sorted({c[1 - axis] for c in a.columns} & {c[1 - axis] for c in b.columns})
        first, second = sorted((a, b), key=lambda d: d.columns[0][axis])
        start = max(c[axis] for c in first.columns) + 1
        stop = min(c[axis] for c in second.columns)
        if rows and 1 <= stop - start <= 8:
            row = rows[int(site.rng.integers(len(rows)))]
            columns = [(t, row) if axis == 0 else (row, t) for t in range(start, stop)]
            level = max(a.levels)
            draft = Draft("bridge", "wooden", columns, [level] * len(columns))
            site.put(draft, "birch_planks" if a.material == "wooden" else "planks", bottom=level - 1)
            return


def _stairs(site: _Site, platform: Draft) -> bool:
    level = max(platform.levels)
    inside = set(platform.columns)
    material = {"platform": "cobblestone" if platform.material != "cobblestone" else "stone_bricks"}["platform"]
    walls = [(c, s) for c in platform.columns for s in SIDES if (c[0] + s[0], c[1] + s[1]) not in inside]
    for choice in site.rng.permutation(len(walls)):
        column, step = walls[int(choice)]
        columns = [(column[0] + n * step[0], column[1] + n * step[1]) for n in range(1, level)]
        foot = (column[0] + level * step[0], column[1] + level * step[1])
        if site.free([*columns, foot], 0) and columns:
            levels = [level - n for n in range(1, level)]
            draft = Draft("stairs", "stone", columns, levels)
            draft.leads_to = platform
            site.put(draft, material)
            site.taken[foot] = True
            return True
    return False


def _ladder(site: _Site, draft: Draft) -> bool:
    inside = set(draft.columns)
    walls = [(c, s) for c in draft.columns for s in SIDES if (c[0] + s[0], c[1] + s[1]) not in inside]
    for choice in site.rng.permutation(len(walls)):
        column, step = walls[int(choice)]
        foot = (column[0] + step[0], column[1] + step[1])
        before = (foot[0] + step[0], foot[1] + step[1])
        if site.free([foot], 0) and site.free([before], 0):
            site.taken[foot] = True
            site.ladders.append(Ladder(column=foot, towards=(-step[0], -step[1]), bottom=0, top=max(draft.levels)))
            draft.has_ladder = True
            return True
    return False


def _pillar_row(site: _Site, quadrant: tuple[int, int]) -> None:
    for _ in range(20):
        step = SIDES[int(site.rng.integers(4))]
        apart = int(site.rng.choice([2, 2, 3]))
        start = (quadrant[0] + int(site.rng.integers(0, 8)), quadrant[1] + int(site.rng.integers(0, 8)))
        columns = [(start[0] + n * apart * step[0], start[1] + n * apart * step[1]) for n in range(3)]
        if site.free(columns, 1):
            for column, level, rank in zip(columns, (2, 4, 6), ("low", "intermediate", "high"), strict=True):
                draft = Draft("pillar", "wooden", [column], [level])
                draft.rank = rank
                site.put(draft, PILLAR_WORDS["wooden"])
            if apart == 3:
                _ladder(site, site.drafts[-1])
            return


def _pillar(site: _Site, word: str, level: int) -> None:
    for _ in range(30):
        column = (int(site.rng.integers(1, 15)), int(site.rng.integers(1, 15)))
        if site.free([column], 1):
            draft = Draft("pillar", word, [column], [level])
            site.put(draft, PILLAR_WORDS[word])
            if level > 2:
                _ladder(site, draft)
            return


def _block(site: _Site, colour: str) -> None:
    for _ in range(20):
        column = (int(site.rng.integers(1, 15)), int(site.rng.integers(1, 15)))
        if site.free([column], 1):
            site.put(Draft("block", colour, [column], [2]), f"{colour}_block")
            return


def _pond(site: _Site) -> None:
    for _ in range(12):
        corner = (int(site.rng.integers(1, 12)), int(site.rng.integers(1, 12)))
        columns = _rectangle(corner, _size(site.rng, 2, 4))
        if site.free(columns, 0):
            for column in columns:
                fill(site.cells, column, -2, 0, "air")
                fill(site.cells, column, -2, -1, "water")
                site.taken[column] = True
            return


def _tree(site: _Site) -> None:
    for _ in range(12):
        i, j = (int(v) for v in site.rng.integers(2, 14, 2))
        tall = int(site.rng.integers(8, 11))
        around = [(i + a, j + b) for a in (-2, -1, 0, 1, 2) for b in (-2, -1, 0, 1, 2)]
        inside = [c for c in around if 0 <= c[0] < 16 and 0 <= c[1] < 16]
        top = GROUND_CELL + tall
        clear = all(not site.cells[2 * a : 2 * a + 2, 2 * b : 2 * b + 2, GROUND_CELL + 2 :].any() for a, b in inside)
        if not site.free([(i, j)], 1) or not clear:
            continue
        leaves = material_id("leaves")
        for a, b in inside:
            far = max(abs(a - i), abs(b - j))
            corner = abs(a - i) == abs(b - j) == 2
            box = (slice(2 * a, 2 * a + 2), slice(2 * b, 2 * b + 2))
            if not (corner and site.rng.random() < 0.6):
                site.cells[(*box, slice(top - 2, top))] = leaves
            if far <= 1 and not (far == 1 and abs(a - i) == abs(b - j) and site.rng.random() < 0.7):
                site.cells[(*box, slice(top, top + 2))] = leaves
        fill(site.cells, (i, j), 0, tall, "oak_log")
        site.taken[i, j] = True
        return


def _fence(site: _Site) -> np.ndarray:
    """A short run of posts and rails."""
    boxes: list[tuple[list[float], list[float]]] = []
    for _ in range(15):
        axis = int(site.rng.integers(2))
        start, length = site.rng.integers(1, 14, 2), int(site.rng.integers(3, 6))
        columns = [tuple(int(v) for v in start + n * np.eye(2, dtype=int)[axis]) for n in range(length)]
        if not site.free([(c[0], c[1]) for c in columns], 0):
            continue
        for n, (i, j) in enumerate(columns):
            x, y = i - 7.5, j - 7.5
            boxes.append(([x - 0.125, y - 0.125, 0.0], [x + 0.125, y + 0.125, 1.0]))
            site.taken[i, j] = True
            if n + 1 < length:
                for low in (0.375, 0.75):
                    reach = np.eye(2)[axis]
                    corner = np.array([x, y]) + 0.125 * reach - 0.0625 * (1 - reach)
                    end = np.array([x, y]) + 0.875 * reach + 0.0625 * (1 - reach)
                    boxes.append(([*corner, low], [*end, low + 0.1875]))
        break
    return np.array(boxes, dtype=float).reshape(-1, 2, 3)


def _plants(site: _Site) -> list[Plant]:
    plants = []
    for _ in range(26):
        i, j = (int(v) for v in site.rng.integers(0, 16, 2))
        grows = site.cells[2 * i, 2 * j, GROUND_CELL - 1] == material_id("grass")
        if grows and not site.taken[i, j] and not site.cells[2 * i, 2 * j, GROUND_CELL]:
            shift = site.rng.uniform(-0.15, 0.15, 2)
            kind = str(site.rng.choice(["tuft", "tuft", "tuft", "poppy", "dandelion", "daisy"]))
            plants.append(Plant(base=np.array([i - 7.5 + shift[0], j - 7.5 + shift[1], 0.0]), texture=kind))
    return plants
