"""The look of one event: court surface, lines, light, stands and everything that stands about, drawn by lot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.scene import Scene
from pgm_data.simulate.pictures.bystanders import Clothes, draw_bystanders
from pgm_data.simulate.pictures.foreign import foreign_lines
from pgm_data.simulate.pictures.furniture import draw_furniture
from pgm_data.simulate.pictures.people import Cast, blob_shadow, crate_shadow
from pgm_data.simulate.pictures.shapes import (
    NetLook,
    Plane,
    Polygons,
    line_rectangles,
    net_mesh,
    net_polygons,
    polygons,
    rectangle,
    stacked,
)
from pgm_data.simulate.pictures.surroundings import draw_venue, lettering
from pgm_data.simulate.pictures.textures import Textures

Surface = Literal["firm", "clay", "grass"]
FIRM_SURFACES = (  # (court, run-off) BGR
    ((150, 95, 62), (92, 135, 88)),
    ((140, 85, 60), (165, 155, 75)),
    ((135, 85, 45), (200, 160, 90)),
    ((120, 65, 85), (110, 165, 125)),
    ((105, 120, 62), (85, 80, 80)),
    ((85, 130, 70), (45, 35, 165)),
    ((90, 140, 80), (80, 120, 70)),
    ((160, 100, 40), (160, 100, 40)),
    ((115, 105, 100), (115, 105, 100)),
    ((60, 55, 50), (150, 80, 50)),
    ((150, 90, 140), (120, 60, 110)),
    ((170, 120, 60), (60, 60, 70)),
    ((80, 100, 90), (60, 85, 160)),
    ((70, 90, 190), (90, 130, 80)),
)
CLAY = ((48, 88, 172), (62, 108, 190), (52, 80, 140), (70, 105, 170), (95, 115, 95))
GRASS = ((62, 122, 108), (60, 140, 110), (70, 120, 130), (50, 150, 125), (50, 105, 80))


@dataclass(frozen=True, eq=False, kw_only=True)
class World:
    """Everything one picture shows, apart from its camera, in world metres and BGR 0 to 255."""

    floor_z: float
    """Height of the floor, metres; below zero where the court is a table."""
    sky: Float[np.ndarray, "2 3"]
    """Colours at the picture's top and at the horizon."""
    ground: Polygons
    """The floor and its coloured areas."""
    grain: Float[np.ndarray, " 8"]
    """The ground's texture, as `painter.texture_ground` reads it."""
    worn: tuple[Plane, ...]
    """Places where the surface, and the lines on it, are worn off or covered."""
    foreign: Polygons
    """Lines of other sports."""
    lines: Polygons
    """The court's painted lines, of one colour."""
    ground_words: tuple[Plane, ...]
    shadows: Polygons
    planes: tuple[Plane, ...]
    """Stands and hoardings, far ones first."""
    behind: Polygons
    """What stands beyond the net."""
    net: Polygons
    """Posts and mesh."""
    tape: Polygons
    """Tape and centre strap, of one colour."""
    net_words: tuple[Plane, ...]
    mesh: tuple[Plane, ...]
    """The net's cords, where `net` holds no mesh."""
    front: Polygons
    """What stands before the net."""
    thrown: tuple[tuple[Float[np.ndarray, " 2"], float], ...]
    """Every light's shadow: ground vector per metre of height, and strength."""
    shade: Float[np.ndarray, " 3"] | None
    """(a, b, c): where a x + b y > c on the ground the stands keep the sun off; None without such a place."""
    walls: tuple[float, float]
    """Half width and half length between the hoardings, metres."""
    seat: Float[np.ndarray, " 3"] | None
    """Of the umpire's high chair, world metres; None without one."""


def area_of(scene: Scene) -> tuple[float, float, float]:
    """Half width, half length of the space that play uses, and the floor's height, metres."""
    court = scene.court
    if court is None:
        raise ValueError(f"scene {scene.name}: expected a court to draw, got none: this scene has no court")
    half_x, half_y = court.surface_half_size
    floor = 0.0
    for player in scene.players:
        if player.region_m:
            region = np.abs(np.array(player.region_m))
            half_x, half_y = max(half_x, region[:, 0].max()), max(half_y, region[:, 1].max())
            floor = min(floor, player.region_m[0][2])
    return float(half_x), float(half_y), float(floor)


def draw_world(
    rng: np.random.Generator,
    scene: Scene,
    others: Sequence[Court],
    textures: Textures,
    cast: Cast,
    centre_world: np.ndarray,
    *,
    hard: bool,
    players: bool = True,
    people: bool = True,
    surface: Surface | None = None,
) -> World:
    """A world seen from this centre; `hard` ones may be worn, crowded and crossed by other sports' lines.

    Without `players` nobody stands where players would, without `people` nobody at all; a surface by lot unless given.

    Raises:
        ValueError: If the scene has no court.
    """
    half_x, half_y, floor_z = area_of(scene)
    court = scene.court
    assert court is not None
    kind = str(rng.choice(["firm", "clay", "grass"], p=[0.62, 0.22, 0.16])) if surface is None else surface
    inner, outer = surface_colours(rng, kind, hard)
    venue = draw_venue(rng, half_x, half_y, floor_z, textures, centre_world, hard=hard)
    thrown = _thrown(rng, roofed=venue.roofed and not hard)
    clothes = Clothes(rng, white=kind == "grass" and rng.random() < 0.7)
    look = net_look(rng)
    mesh: tuple[Plane, ...] = ()
    if not hard:
        look = replace(look, mesh=np.full(3, rng.uniform(8, 45)), mesh_alpha=float(rng.uniform(0.25, 0.6)))
        mesh, look = net_mesh(court, look), replace(look, mesh_alpha=0.0)
    net, tape = net_polygons(court, look, floor_z)
    foreign = foreign_lines(rng, others, rng.uniform(0.5, 1.0)) if hard and others and rng.random() < 0.1 else []
    walls = (venue.wall_x, venue.wall_y)
    behind, front, feet, seat = draw_bystanders(
        rng,
        (half_x, half_y, floor_z),
        cast,
        clothes,
        centre_world,
        walls,
        hard=hard,
        players=players,
        people=people,
        boxes=hard,
    )
    shadows, shade = _shadows(rng, court, half_x, half_y, feet, thrown, floor_z)
    if not hard and floor_z == 0.0:
        far, near, stands = draw_furniture(rng, walls, seat, centre_world, thrown[0][0])
        behind, front = stacked([far, behind]), stacked([front, near])
        fallen = [(crate_shadow(low, size, throw), np.zeros(3), dark) for low, size in stands for throw, dark in thrown]
        shadows = stacked([shadows, polygons(fallen)])
    return World(
        floor_z=floor_z,
        sky=venue.sky,
        ground=_ground(rng, court, inner, outer, floor_z, half_x, half_y, kind),
        grain=_grain(rng, kind),
        worn=_worn(rng, court, kind, inner, textures, floor_z, hard=hard),
        foreign=polygons(foreign),
        lines=_lines(rng, court, kind, hard),
        ground_words=_ground_words(rng, half_x, half_y, floor_z, textures, hard),
        shadows=shadows,
        planes=venue.planes,
        behind=behind,
        net=net,
        tape=tape,
        net_words=_net_words(rng, court, textures),
        mesh=mesh,
        front=front,
        thrown=tuple(thrown),
        shade=shade,
        walls=walls,
        seat=seat,
    )


def surface_colours(rng: np.random.Generator, kind: str, hard: bool) -> tuple[np.ndarray, np.ndarray]:
    """Colours of the court and of its run-off."""
    if kind == "firm":
        pair = FIRM_SURFACES[int(rng.integers(len(FIRM_SURFACES)))]
        inner, outer = np.array(pair[0], float), np.array(pair[1], float)
        if rng.random() < 0.2:
            inner, outer = outer, inner
        if rng.random() < 0.12:
            outer = inner * rng.uniform(0.85, 1.15)
        if hard and rng.random() < 0.2:
            inner, outer = rng.uniform(15, 200, 3), rng.uniform(15, 200, 3)
    else:
        table = CLAY if kind == "clay" else GRASS
        inner = np.array(table[int(rng.integers(len(table)))], float)
        outer = inner * rng.uniform(0.92, 1.08)
    tint = rng.uniform(0.7, 1.3) * rng.uniform(0.85, 1.15, 3)
    # Televised courts are painted for contrast: none is as bright as its lines.
    brightest = 225 if hard else 135
    darkest = 8 if hard else 30
    return np.clip(inner * tint, darkest, brightest), np.clip(outer * tint, darkest, brightest)


def net_look(rng: np.random.Generator) -> NetLook:
    """A net's colours."""
    white = np.full(3, rng.uniform(205, 255))
    post = np.full(3, rng.uniform(10, 240)) if rng.random() < 0.6 else rng.uniform(10, 220, 3)
    return NetLook(
        mesh=np.full(3, rng.uniform(5, 60)) if rng.random() < 0.85 else rng.uniform(90, 200, 3),
        mesh_alpha=float(rng.uniform(0.08, 0.7)),
        tape=white * rng.uniform(0.9, 1.0, 3),
        post=post,
        strap=bool(rng.random() < 0.93),
        band=bool(rng.random() < 0.35),
    )


def _grain(rng: np.random.Generator, kind: str) -> np.ndarray:
    fine = {"firm": 0.03, "clay": 0.10, "grass": 0.09}[kind]
    look = np.zeros(8)
    look[:4] = rng.uniform(0.3, 1.6) * fine, rng.uniform(4, 14), rng.uniform(0.2, 2.0) * fine, rng.uniform(0.5, 3.0)
    look[6] = rng.uniform(0.8, 2.6)
    if kind == "grass" and rng.random() < 0.8:
        strong = rng.uniform(0.015, 0.11)
        weak = strong * rng.uniform(0.3, 1.0) if rng.random() < 0.35 else 0.0
        look[4:6] = (strong, weak) if rng.random() < 0.7 else (weak, strong)
    if kind == "clay":
        look[7] = rng.uniform(0.0, 0.9)
    elif rng.random() < 0.35:
        look[7] = rng.uniform(0.0, 0.6)
    return look


def _worn(rng, court: Court, kind: str, inner, textures: Textures, floor_z: float, *, hard: bool) -> tuple[Plane, ...]:
    if floor_z < 0:
        return ()
    width, length = np.abs(court.points_world[:, :2]).max(axis=0)
    if kind == "grass":
        colour = np.array([105, 150, 175]) * rng.uniform(0.7, 1.1)
    elif kind == "clay":
        colour = inner * rng.uniform(0.75, 1.25)
    else:
        colour = inner * rng.uniform(0.8, 1.2) + rng.uniform(-10, 10)
    colour = np.clip(colour, 5, 240)
    strength = {"firm": 0.25, "clay": 0.6, "grass": 0.9}[kind] * rng.uniform(
        0.0 if hard or kind == "firm" else 0.4, 1.1
    )
    places = []
    for end in (-1.0, 1.0):
        x, y = rng.normal(0, 0.1) * width, end * length * rng.uniform(0.97, 1.08)
        places.append((x, y, 2.2 * width * rng.uniform(0.4, 1.0), 2.2 * length * rng.uniform(0.05, 0.13), strength))
    for _ in range(int(rng.integers(0, 6)) if hard else 2):
        x, y = rng.uniform(-1.5, 1.5) * width, rng.uniform(-1.5, 1.5) * length
        size = 2.2 * rng.uniform(0.08, 0.5, 2) * width
        places.append((x, y, size[0], size[1], strength * rng.uniform(0.2, 0.8)))
    if not hard and kind != "firm" and court.tape_width == 0.06:
        # Footmarks and slides, behind the baselines and short of them, clear of every line.
        for _ in range(int(rng.integers(20, 60))):
            out = rng.random() < 0.65
            y = rng.choice([-1.0, 1.0]) * (
                length + rng.gamma(2.0, 0.5) + 0.55 if out else length - rng.uniform(0.8, 3.5)
            )
            x = rng.normal(0, 2.2) if out else rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 3.0)
            places.append((x, y, rng.uniform(0.08, 0.6), rng.uniform(0.05, 0.3), rng.uniform(0.25, 0.8) * strength))
    planes = []
    for x, y, half_x, half_y, alpha in places:
        mask = textures.patches[int(rng.integers(len(textures.patches)))]
        middle, up = np.array([x, y, floor_z]), np.array([0.0, 1.0, 0.0])
        patch = lettering(mask, middle, 2 * half_y, colour, up, width=2 * half_x, alpha=min(float(alpha), 1.0))
        planes.append(patch)
    return tuple(planes)


def _ground(rng, court: Court, inner, outer, floor_z, half_x, half_y, kind) -> Polygons:
    shapes = [(rectangle(-300, 300, -300, 300, floor_z), outer, 1.0)]
    reach = np.abs(court.points_world[:, :2]).max(axis=0) + court.line_width.max() / 2
    if floor_z < 0:
        sx, sy = court.surface_half_size
        for y in (-0.8 * sy, 0.8 * sy):
            for x in (-0.8 * sx, 0.8 * sx):
                leg = np.array([[x - 0.03, y, floor_z], [x + 0.03, y, floor_z], [x + 0.03, y, 0], [x - 0.03, y, 0]])
                shapes.append((leg, np.full(3, 40.0), 1.0))
        shapes.append((rectangle(-sx, sx, -sy, sy), inner, 1.0))
        return polygons(shapes)
    if kind == "firm" or rng.random() < 0.15:
        if rng.random() < 0.25:  # a third colour round the run-off
            shapes.append((rectangle(-half_x, half_x, -half_y, half_y), outer * rng.uniform(0.7, 1.3), 1.0))
        if rng.random() < 0.85:
            x, y = reach if rng.random() < 0.8 else reach + rng.uniform(0.05, 1.5, 2)
            shapes.append((rectangle(-x, x, -y, y), inner, 1.0))
        if rng.random() < 0.15:  # alleys or service boxes in a shade of their own
            xs = np.unique(np.abs(court.points_world[:, 0]))
            x = xs[-2] if len(xs) > 2 else xs[-1]
            y = np.unique(np.abs(court.points_world[:, 1]))[0] if rng.random() < 0.5 else reach[1]
            shapes.append((rectangle(-x, x, -y, y), inner * rng.uniform(0.8, 1.25), 1.0))
    return polygons([(c, np.clip(colour, 5, 245), a) for c, colour, a in shapes])


def _lines(rng, court: Court, kind: str, hard: bool) -> Polygons:
    shapes: list[tuple[np.ndarray, np.ndarray, float]] = []
    white = np.full(3, rng.uniform(190, 255)) * np.array([rng.uniform(0.75, 1.0), rng.uniform(0.93, 1.0), 1.0])
    faint = rng.uniform(0.0, 0.25) if rng.random() < 0.8 else rng.uniform(0.25, 0.68)
    if hard and rng.random() < 0.025:
        white, faint = rng.uniform(0, 60, 3), 0.0
    if not hard:
        faint *= 0.5
    alpha = 1.0 - faint
    uneven = rng.uniform(0.0, 0.5) if kind != "firm" or rng.random() < 0.1 else 0.06
    each = 1.0 - (uneven if hard else 0.5 * uneven) * rng.random(len(court.line_names))
    # Bright lines bloom in a camera: training pictures show them wider, about the same centres.
    bloom = rng.uniform(0.9, 1.5) if hard else 1.0
    for line, corners in line_rectangles(court):
        ends = court.lines_world[line]
        axis = 1 if abs(ends[1, 0] - ends[0, 0]) > abs(ends[1, 1] - ends[0, 1]) else 0
        corners = corners.copy()
        corners[:, axis] += (bloom - 1.0) * (corners[:, axis] - ends[0, axis])
        shapes.append((corners, white, float(alpha * each[line])))
    marks = [n for n in court.line_names if "baseline" in n]
    if len(marks) == 2 and court.tape_width == 0.06:  # tennis: a centre mark on each baseline, 10 cm long
        length = np.abs(court.points_world[:, 1]).max() - 0.05
        for end in (-1.0, 1.0):
            y0, y1 = sorted((end * length, end * (length - 0.1)))
            shapes.append((rectangle(-0.025, 0.025, y0, y1), white, float(alpha)))
    return polygons(shapes)


def _ground_words(rng, half_x, half_y, floor_z, textures, hard) -> tuple[Plane, ...]:
    planes = []
    if rng.random() < 0.45:
        white = rng.uniform(150, 255, 3) if rng.random() < 0.8 else rng.uniform(0, 255, 3)
        if not hard:
            white = white.mean() + 0.3 * (white - white.mean())
        height = half_y * rng.uniform(0.03, 0.09)
        places = [(0.0, -0.82), (0.0, 0.78), (-0.8, -0.1), (0.8, -0.1)]
        for x, y in places:
            if rng.random() < 0.6:
                word = textures.words[int(rng.integers(len(textures.words)))]
                planes.append(
                    lettering(
                        word, np.array([x * half_x, y * half_y, floor_z]), height, white, np.array([0.0, 1.0, 0.0])
                    )
                )
    return tuple(planes)


def _net_words(rng, court: Court, textures: Textures) -> tuple[Plane, ...]:
    top = court.net_world
    if len(top) < 2 or rng.random() < 0.4:
        return ()
    height = float(top[:, 2].min()) * 0.6
    middle = 0.5 * height
    left, right = court.points_world[:, 0].min(), court.points_world[:, 0].max()
    planes, up = [], np.array([0.0, 0.0, 1.0])
    word = textures.words[int(rng.integers(len(textures.words)))]
    if rng.random() < 0.7:
        board = rng.uniform(10, 230, 3)
        for x in (left * 0.93, right * 0.93):
            patch = np.full((4, 4, 1), 255, np.uint8)
            wide = rng.uniform(0.9, 1.5) * height
            planes.append(lettering(patch, np.array([x, -0.01, middle]), height, board, up, width=wide, alpha=0.9))
            pale = np.full(3, rng.uniform(180, 255))
            at = np.array([x, -0.01, middle])
            planes.append(lettering(word, at, 0.5 * height, pale, up, width=0.8 * wide, alpha=0.9))
    if rng.random() < 0.6:
        pale = np.full(3, rng.uniform(120, 255))
        shade = float(rng.uniform(0.3, 0.8))
        planes.append(lettering(word, np.array([0.3 * left, -0.01, middle]), 0.6 * height, pale, up, alpha=shade))
    return tuple(planes)


def _thrown(rng: np.random.Generator, *, roofed: bool) -> list[tuple[np.ndarray, float]]:
    """(ground vector per metre of height, strength) of every light; under a roof there is no sun."""
    kind = rng.random() * (0.5 if roofed else 1.0) + (0.5 if roofed else 0.0)
    if kind < 0.5:
        angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 2.2)
        return [(reach * np.array([np.cos(angle), np.sin(angle)]), float(rng.uniform(0.25, 0.7)))]
    if kind < 0.8:
        angles = rng.uniform(0, 2 * np.pi) + np.arange(4) * 0.5 * np.pi
        return [(0.9 * np.array([np.cos(a), np.sin(a)]), float(rng.uniform(0.05, 0.2))) for a in angles]
    return [(np.zeros(2), 0.15)]


def _shadows(rng, court: Court, half_x, half_y, feet, thrown, floor_z) -> tuple[Polygons, np.ndarray | None]:
    shapes: list[tuple[np.ndarray, np.ndarray, float]] = []
    shade: np.ndarray | None = None
    vector, strength = thrown[0]
    if len(thrown) == 1 and strength > 0.2:
        if rng.random() < 0.4:  # the stands' edge across the court
            angle = rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0, 0.25)
            normal = np.array([np.cos(angle), np.sin(angle)]) * rng.choice([-1.0, 1.0])
            along = np.array([-normal[1], normal[0]])
            start = normal * rng.uniform(-1.0, 1.0) * (half_x if abs(normal[0]) > 0.7 else half_y)
            shade = np.array([*normal, float(normal @ start)])
            near, beyond = 200 * along, 200 * normal
            far = [start - near, start + near, start + near + beyond, start - near + beyond]
            corners = np.concatenate([np.array(far), np.full((4, 1), floor_z)], axis=1)
            shapes.append((corners, np.zeros(3), strength * float(rng.uniform(0.6, 1.0))))
        top = court.net_world
        if len(top) > 1 and floor_z == 0.0:
            away = top[:, :2] + top[:, 2:] * vector
            ring = np.concatenate([top[:, :2], away[::-1]])
            corners = np.concatenate([ring, np.zeros((len(ring), 1))], axis=1)
            shapes.append((corners, np.zeros(3), strength * float(rng.uniform(0.2, 0.6))))
    for place, height in feet:
        for throw, dark in thrown:
            shapes += blob_shadow(place, height, throw, dark)
    return polygons(shapes), shade
