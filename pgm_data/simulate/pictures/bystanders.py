"""Who and what stands about a court: players' doubles, officials, ball kids, chairs and boxes."""

import numpy as np

from pgm_data.simulate.pictures.people import Cast, Silhouette, by_distance, crate, placed
from pgm_data.simulate.pictures.shapes import Polygons


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


def draw_bystanders(
    rng: np.random.Generator,
    area: tuple[float, float, float],
    cast: Cast,
    clothes: Clothes,
    centre_world: np.ndarray,
    walls: tuple[float, float],
    *,
    hard: bool,
    players: bool,
    people: bool,
    boxes: bool,
) -> tuple[Polygons, Polygons, list[tuple[np.ndarray, float]], np.ndarray | None]:
    """People, if wanted, and furniture beyond the net and before it, who stands on the ground, and the umpire's seat.

    Who stands: (place, height) of each. The seat is None where there is no high chair. With `boxes` crates of all sorts
    stand at the sides.

    `area` is the half width and half length of the space and the floor's height, `walls` the half width and half length
    between the hoardings, metres.
    """
    half_x, half_y, floor_z = area
    beyond: list[tuple[float, Polygons]] = []
    before: list[tuple[float, Polygons]] = []
    feet: list[tuple[np.ndarray, float]] = []

    def pick(figures: tuple[Silhouette, ...]) -> Silhouette:
        return figures[int(rng.integers(len(figures)))]

    def put(figure: Silhouette, x: float, y: float, worn: np.ndarray, height: float, lift: float = 0.0) -> None:
        if people:
            place_figure(figure, x, y, worn, height, lift)

    def place_figure(figure: Silhouette, x: float, y: float, worn: np.ndarray, height: float, lift: float) -> None:
        place = np.array([x, y, floor_z + lift])
        reach = float(np.linalg.norm(place - centre_world))
        if reach < 3.0:
            return
        flipped = bool(rng.random() < 0.5)
        shapes = placed(figure, place, centre_world, worn, height_m=height, flipped=flipped)
        (beyond if y > 0 else before).append((reach, shapes))
        if lift == 0.0:
            feet.append((place, height))

    wall_x, wall_y = walls
    for end in (-1.0, 1.0):
        if players and rng.random() < 0.9:
            x, y = rng.normal(0, 0.35) * half_x, end * half_y * rng.uniform(0.1, 0.85)
            put(pick(cast.playing), x, y, clothes.anyone(), rng.uniform(1.6, 2.0))
    for _ in range(int(rng.integers(0, 4)) if hard and players and rng.random() < 0.35 else 0):
        put(pick(cast.playing), rng.normal(0, 0.5) * half_x, rng.uniform(-0.9, 0.9) * half_y, clothes.anyone(), 1.8)
    for x in np.linspace(-0.8, 0.8, int(rng.integers(2, 8))) * wall_x:
        if rng.random() < 0.7:
            put(pick(cast.standing), x + rng.normal(0, 0.3), wall_y - rng.uniform(0.3, 1.2), clothes.staff(), 1.75)
    if rng.random() < 0.4:
        for x in np.linspace(-0.7, 0.7, int(rng.integers(2, 5))) * wall_x:
            if rng.random() < 0.7:
                put(pick(cast.standing), x, -wall_y + rng.uniform(-1.5, 2.0), clothes.staff(), 1.75)
    for side in (-1.0, 1.0):
        for _ in range(int(rng.integers(1, 6))):
            x, y = side * wall_x * rng.uniform(0.75, 0.97), rng.uniform(-0.8, 0.8) * half_y
            figures = cast.seated if rng.random() < 0.5 else cast.standing
            put(pick(figures), x, y, clothes.staff() if rng.random() < 0.6 else clothes.anyone(), 1.75)
        for _ in range(int(rng.integers(0, 6)) if boxes else 0):
            low = np.array([side * wall_x * rng.uniform(0.72, 0.95), rng.uniform(-0.7, 0.7) * half_y, floor_z])
            size = rng.uniform(0.3, 1.6, 3) * [1.0, 1.2, 0.7]
            shapes = crate(low, size, muted(rng), centre_world)
            (beyond if low[1] > 0 else before).append((float(np.linalg.norm(low - centre_world)), shapes))
    seat = None
    if rng.random() < 0.75:
        side = rng.choice([-1.0, 1.0])
        x = side * (half_x * rng.uniform(0.72, 0.85))
        place_figure(pick(cast.chairs), x, 0.05, clothes.staff(), 2.7, 0.0)
        put(pick(cast.seated), x, 0.04, clothes.staff(), 1.7, lift=1.35)
        seat = np.array([x, 0.05, floor_z + 1.9])
    return by_distance(beyond), by_distance(before), feet, seat
