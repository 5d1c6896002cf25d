"""The look of one event: court surface, lines, light, stands and everything that stands about, drawn by lot."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.scene import Scene
from pgm_data.simulate.people import Cast, blob_shadow, by_distance, crate, placed
from pgm_data.simulate.shapes import NetLook, Plane, Polygons, line_rectangles, net_polygons, polygons, rectangle
from pgm_data.simulate.surroundings import Venue, draw_venue, lettering
from pgm_data.simulate.textures import Textures

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
    front: Polygons
    """What stands before the net."""


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
) -> World:
    """A world seen from this centre; `hard` ones may be worn, crowded and crossed by other sports' lines.

    Without `players` nobody stands where players would.

    Raises:
        ValueError: If the scene has no court.
    """
    half_x, half_y, floor_z = area_of(scene)
    court = scene.court
    assert court is not None
    kind = rng.choice(["firm", "clay", "grass"], p=[0.62, 0.22, 0.16])
    inner, outer = surface_colours(rng, kind, hard)
    venue = draw_venue(rng, half_x, half_y, floor_z, textures, centre_world, hard=hard)
    thrown = _thrown(rng)
    cloth = Clothes(rng, white=kind == "grass" and rng.random() < 0.7)
    net, tape = net_polygons(court, net_look(rng), floor_z)
    foreign = foreign_lines(rng, others, rng.uniform(0.5, 1.0)) if hard and others and rng.random() < 0.1 else []
    behind, front, feet = _things(rng, half_x, half_y, floor_z, cast, cloth, centre_world, venue, hard, players)
    return World(
        floor_z=floor_z,
        sky=venue.sky,
        ground=_ground(rng, court, inner, outer, floor_z, half_x, half_y, kind),
        grain=_grain(rng, kind),
        worn=_worn(rng, court, kind, inner, textures, floor_z, hard=hard),
        foreign=polygons(foreign),
        lines=_lines(rng, court, kind, hard),
        ground_words=_ground_words(rng, half_x, half_y, floor_z, textures, hard),
        shadows=_shadows(rng, court, half_x, half_y, feet, thrown, floor_z),
        planes=venue.planes,
        behind=behind,
        net=net,
        tape=tape,
        net_words=_net_words(rng, court, textures),
        front=front,
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
    return np.clip(inner * tint, 8, 225), np.clip(outer * tint, 8, 225)


def muted(rng: np.random.Generator) -> np.ndarray:
    """A colour of cloth or plastic, BGR: mostly greyish or dark, seldom glaring."""
    colour = rng.uniform(5, 240, 3)
    return colour + rng.uniform(0.0, 0.9) * (rng.uniform(10, 240) - colour)


class Clothes:
    """The colours that one event's people wear."""

    def __init__(self, rng: np.random.Generator, *, white: bool) -> None:
        """`white`: players all in white."""
        self._rng = rng
        self._white = white
        self._staff = np.stack([muted(rng), 0.6 * muted(rng)])

    def staff(self) -> np.ndarray:
        """Shirt, legs and skin of an official."""
        return np.stack([*self._staff, self._skin()])

    def anyone(self) -> np.ndarray:
        """Shirt, legs and skin of a player or guest."""
        rng = self._rng
        if self._white or rng.random() < 0.3:
            return np.stack([np.full(3, rng.uniform(195, 250)), np.full(3, rng.uniform(190, 250)), self._skin()])
        return np.stack([muted(rng), np.full(3, rng.uniform(5, 200)), self._skin()])

    def _skin(self) -> np.ndarray:
        return np.array([115.0, 150.0, 200.0]) * self._rng.uniform(0.3, 1.15)


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
    strength = {"firm": 0.25, "clay": 0.6, "grass": 0.9}[kind] * rng.uniform(0.0, 1.1)
    places = []
    for end in (-1.0, 1.0):
        x, y = rng.normal(0, 0.1) * width, end * length * rng.uniform(0.97, 1.08)
        places.append((x, y, 2.2 * width * rng.uniform(0.4, 1.0), 2.2 * length * rng.uniform(0.05, 0.13), strength))
    for _ in range(int(rng.integers(0, 6)) if hard else 2):
        x, y = rng.uniform(-1.5, 1.5) * width, rng.uniform(-1.5, 1.5) * length
        size = 2.2 * rng.uniform(0.08, 0.5, 2) * width
        places.append((x, y, size[0], size[1], strength * rng.uniform(0.2, 0.8)))
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
    each = 1.0 - (rng.uniform(0.0, 0.5) if kind != "firm" or rng.random() < 0.1 else 0.06) * rng.random(len(court.line_names))
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


def foreign_lines(
    rng: np.random.Generator, courts: Sequence[Court], alpha: float
) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Lines of other sports on this ground: courts of other scenes set down anywhere, or arcs, circles and long bars."""
    colour = rng.uniform(20, 250, 3) if rng.random() < 0.6 else np.full(3, rng.uniform(190, 255))
    shapes: list[tuple[np.ndarray, np.ndarray, float]] = []
    kind = rng.random()
    if kind < 0.5:
        court = courts[int(rng.integers(len(courts)))]
        scale = rng.uniform(0.9, 1.4)
        angle = float(rng.choice([0.0, 0.5 * np.pi])) + (rng.normal(0, 0.1) if rng.random() < 0.2 else 0.0)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = rng.normal(0, 3.0, 2) if rng.random() < 0.7 else np.zeros(2)
        for _, corners in line_rectangles(court):
            corners = corners.copy()
            corners[:, :2] = scale * corners[:, :2] @ turn.T + shift
            corners[:, 2] = 0.0
            shapes.append((corners, colour, alpha))
        return shapes
    for _ in range(int(rng.integers(1, 5))):
        half = rng.uniform(0.02, 0.06)
        if rng.random() < 0.5:
            radius, middle = rng.uniform(0.8, 7.0), rng.normal(0, 6.0, 2)
            turns = np.linspace(0, rng.uniform(1.5, 2 * np.pi), 24) + rng.uniform(0, 6)
            ring = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
            flat = np.concatenate([middle + (radius + half) * ring, (middle + (radius - half) * ring)[::-1]])
        else:
            start, angle = rng.normal(0, 8.0, 2), rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0, 0.02)
            along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            end = start + rng.uniform(3, 30) * along
            flat = np.array([start - half * across, end - half * across, end + half * across, start + half * across])
        shapes.append((np.concatenate([flat, np.zeros((len(flat), 1))], axis=1), colour, alpha))
    return shapes


def _ground_words(rng, half_x, half_y, floor_z, textures, hard) -> tuple[Plane, ...]:
    planes = []
    if rng.random() < 0.45:
        white = rng.uniform(150, 255, 3) if rng.random() < 0.8 else rng.uniform(0, 255, 3)
        height = half_y * rng.uniform(0.03, 0.09)
        places = [(0.0, -0.82 * half_y), (0.0, 0.78 * half_y), (-0.8 * half_x, -0.1 * half_y), (0.8 * half_x, -0.1 * half_y)]
        for x, y in places:
            if rng.random() < 0.6:
                word = textures.words[int(rng.integers(len(textures.words)))]
                planes.append(lettering(word, np.array([x, y, floor_z]), height, white, np.array([0.0, 1.0, 0.0])))
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
            planes.append(lettering(word, np.array([x, -0.01, middle]), 0.5 * height, pale, up, width=0.8 * wide, alpha=0.9))
    if rng.random() < 0.6:
        pale = np.full(3, rng.uniform(120, 255))
        shade = float(rng.uniform(0.3, 0.8))
        planes.append(lettering(word, np.array([0.3 * left, -0.01, middle]), 0.6 * height, pale, up, alpha=shade))
    return tuple(planes)


def _thrown(rng: np.random.Generator) -> list[tuple[np.ndarray, float]]:
    """(ground vector per metre of height, strength) of every light."""
    kind = rng.random()
    if kind < 0.5:
        angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 2.2)
        return [(reach * np.array([np.cos(angle), np.sin(angle)]), float(rng.uniform(0.25, 0.7)))]
    if kind < 0.8:
        angles = rng.uniform(0, 2 * np.pi) + np.arange(4) * 0.5 * np.pi
        return [(0.9 * np.array([np.cos(a), np.sin(a)]), float(rng.uniform(0.05, 0.2))) for a in angles]
    return [(np.zeros(2), 0.15)]


def _shadows(rng, court: Court, half_x, half_y, feet, thrown, floor_z) -> Polygons:
    shapes: list[tuple[np.ndarray, np.ndarray, float]] = []
    vector, strength = thrown[0]
    if len(thrown) == 1 and strength > 0.2:
        if rng.random() < 0.4:  # the stands' edge across the court
            angle = rng.choice([0.0, 0.5 * np.pi]) + rng.normal(0, 0.25)
            normal = np.array([np.cos(angle), np.sin(angle)]) * rng.choice([-1.0, 1.0])
            along = np.array([-normal[1], normal[0]])
            start = normal * rng.uniform(-1.0, 1.0) * (half_x if abs(normal[0]) > 0.7 else half_y)
            far = [start - 200 * along, start + 200 * along, start + 200 * (along + normal), start + 200 * (normal - along)]
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
    return polygons(shapes)


def _things(rng, half_x, half_y, floor_z, cast: Cast, cloth: Clothes, centre_world, venue: Venue, hard, players):
    """People and furniture beyond and before the net, and where they stand."""
    beyond: list[tuple[float, Polygons]] = []
    before: list[tuple[float, Polygons]] = []
    feet: list[tuple[np.ndarray, float]] = []

    def pick(figures):
        return figures[int(rng.integers(len(figures)))]

    def put(figure, x, y, clothes, height, shadow=True, lift=0.0) -> None:
        place = np.array([x, y, floor_z + lift])
        reach = float(np.linalg.norm(place - centre_world))
        if reach < 3.0:
            return
        flipped = bool(rng.random() < 0.5)
        shapes = placed(figure, place, centre_world, clothes, height_m=height, flipped=flipped)
        (beyond if y > 0 else before).append((reach, shapes))
        if shadow:
            feet.append((place, height))

    wall_x, wall_y = venue.wall_x, venue.wall_y
    for end in (-1.0, 1.0):
        if players and rng.random() < 0.9:
            x, y = rng.normal(0, 0.35) * half_x, end * half_y * rng.uniform(0.1, 0.85)
            put(pick(cast.playing), x, y, cloth.anyone(), rng.uniform(1.6, 2.0))
    for _ in range(int(rng.integers(0, 4)) if hard and players and rng.random() < 0.35 else 0):
        put(pick(cast.playing), rng.normal(0, 0.5) * half_x, rng.uniform(-0.9, 0.9) * half_y, cloth.anyone(), 1.8)
    for x in np.linspace(-0.8, 0.8, int(rng.integers(2, 8))) * wall_x:
        if rng.random() < 0.7:
            put(pick(cast.standing), x + rng.normal(0, 0.3), wall_y - rng.uniform(0.3, 1.2), cloth.staff(), 1.75)
    if rng.random() < 0.4:
        for x in np.linspace(-0.7, 0.7, int(rng.integers(2, 5))) * wall_x:
            if rng.random() < 0.7:
                put(pick(cast.standing), x, -wall_y + rng.uniform(-1.5, 2.0), cloth.staff(), 1.75)
    for side in (-1.0, 1.0):
        for _ in range(int(rng.integers(1, 6))):
            x, y = side * wall_x * rng.uniform(0.75, 0.97), rng.uniform(-0.8, 0.8) * half_y
            figures = cast.seated if rng.random() < 0.5 else cast.standing
            put(pick(figures), x, y, cloth.staff() if rng.random() < 0.6 else cloth.anyone(), 1.75)
        for _ in range(int(rng.integers(0, 6))):
            low = np.array([side * wall_x * rng.uniform(0.72, 0.95), rng.uniform(-0.7, 0.7) * half_y, floor_z])
            size = rng.uniform(0.3, 1.6, 3) * [1.0, 1.2, 0.7]
            shapes = crate(low, size, muted(rng), centre_world)
            (beyond if low[1] > 0 else before).append((float(np.linalg.norm(low - centre_world)), shapes))
    if rng.random() < 0.75:
        side = rng.choice([-1.0, 1.0])
        x = side * (half_x * rng.uniform(0.72, 0.85))
        put(pick(cast.chairs), x, 0.05, cloth.staff(), 2.7)
        put(pick(cast.seated), x, 0.04, cloth.staff(), 1.7, shadow=False, lift=1.35)
    return by_distance(beyond), by_distance(before), feet
