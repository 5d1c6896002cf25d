"""Pieces of strips from pictures with known people, and what the network should say of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.players.person_network import STRIDE
from pgm_data.detect.players.person_strips import (
    FEET_ROW,
    NODE_PX,
    PERSON_PX,
    REACH_PX,
    ROWS,
    GroundView,
    between_nodes,
    cut_strips,
    ground_view,
)
from pgm_data.geometry.camera import Camera, project
from pgm_data.simulate.views import View
from pgm_models.detectors.person_figures import Standing

COLUMNS = 160
"""Of a piece."""
SIGMA = 1.1
"""Standard deviation of a person's target, cells."""
NEAR = 0.35
"""Target above which a cell says who is there and where the box lies."""
SIZES = (0.77, 1.3)
"""Over and under which a person is too small or too large for a piece to be asked for, as a share of the strip's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """One person before one camera."""

    part: str
    depth: float
    """Metres, of the feet."""
    side: float
    """Metres, of the feet."""
    reach: Float[np.ndarray, " 4"]
    """Left, top, right, bottom of the body: sides and heights over the camera as shares of the depth."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What the network should say of one piece."""

    heat: Float[np.ndarray, "high wide"]
    """1 in the cell with a person's middle, less around it, 0 elsewhere."""
    counted: Float[np.ndarray, "high wide"]
    """1, and 0 where it is not asked whether there is a person."""
    player: Float[np.ndarray, "high wide"]
    """1 where the nearest person plays."""
    place: Float[np.ndarray, "six high wide"]
    """Of the nearest person's box and feet, as `CHANNELS` has them."""


def camera_of(view: View) -> Camera:
    """The solvers' camera of a drawn picture."""
    return Camera(
        K=view.K,
        distortion=np.array([view.k1, 0.0, 0.0, 0.0]),
        R_cam_from_world=view.R_cam_from_world,
        t_cam_from_world=view.t_cam_from_world,
    )


def seen_people(people: Sequence[Standing], ground: GroundView) -> list[Seen]:
    """The people as that camera has them before itself, in the same order."""
    found = []
    for person in people:
        depth, side = ground.depth_and_side(person.ground)
        body = ground.depth_and_side(person.vertices[:, :2])
        across = body[:, 1] / body[:, 0]
        upward = (person.vertices[:, 2] - ground.height) / body[:, 0]
        reach = np.array([across.min(), upward.max(), across.max(), upward.min()])
        found.append(Seen(part=person.part, depth=float(depth), side=float(side), reach=reach))
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A part of the upright plane at one depth, seen a little larger, stretched, turned or mirrored."""

    depth: float
    """Metres."""
    side: float
    """Side of the middle of the ground line, metres."""
    pixel_from_metre: Float[np.ndarray, "2 2"]
    """Of (side, height) on the plane."""
    column: float
    """Of the middle of the ground line."""
    person_height_m: float

    def pixels(self, plane: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Column and row of side and height, metres."""
        return (plane - np.array([self.side, 0.0])) @ self.pixel_from_metre.T + np.array([self.column, FEET_ROW])

    def plane(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Side and height, metres, of column and row."""
        back = np.linalg.inv(self.pixel_from_metre)
        return (pixels - np.array([self.column, FEET_ROW])) @ back.T + np.array([self.side, 0.0])


def random_piece(
    rng: np.random.Generator, people: Sequence[Seen], ground: GroundView, person_height_m: float, depths: np.ndarray
) -> Piece:
    """A piece about a person, mostly, or anywhere between the lowest and highest of `depths`."""
    scale = PERSON_PX / person_height_m * float(np.exp(rng.uniform(-0.15, 0.15)))
    stretch = float(np.exp(rng.normal(0, 0.04)))
    angle = rng.normal(0, 0.03)
    mirrored = -1.0 if rng.random() < 0.5 else 1.0
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = turn @ np.diag([mirrored * scale * stretch, -scale / stretch])
    depth = float(np.exp(rng.uniform(*np.log(depths))))
    side, column = float(rng.uniform(-10.0, 10.0)), 0.5 * (COLUMNS - 1)
    known = [p for p in people if depths[0] < p.depth < depths[1]]
    if known and rng.random() < 0.85:
        weights = np.array([2.0 if p.part == "plays" else 1.0 for p in known])
        person = known[int(rng.choice(len(known), p=weights / weights.sum()))]
        up = float(rng.uniform(-1.2, 1.2)) * REACH_PX / scale
        depth = person.depth * (1.0 - np.clip(up / ground.height, -0.25, 0.25))
        side = person.side * depth / person.depth
        column = float(rng.uniform(8, COLUMNS - 8))
    return Piece(depth=depth, side=side, pixel_from_metre=linear, column=column, person_height_m=person_height_m)


def piece_map(piece: Piece, ground: GroundView, camera: Camera) -> np.ndarray:
    """Where each pixel of the piece lies in the picture, as one strip of `strip_maps`."""
    high, wide = ROWS // NODE_PX + 1, COLUMNS // NODE_PX + 1
    node = np.stack(np.meshgrid(np.arange(wide), np.arange(high)), axis=-1) * float(NODE_PX)
    plane = piece.plane(node)
    world = ground.world(np.full(plane.shape[:-1], piece.depth), plane[..., 0], plane[..., 1])
    pixels, _ = project(camera, world.reshape(-1, 3))
    return between_nodes(pixels.reshape(1, high, wide, 2))


def cut_piece(bgr: UInt8[np.ndarray, "height width 3"], map_px: np.ndarray) -> np.ndarray:
    """The piece of the picture, BGR."""
    return cut_strips(bgr, map_px)[0]


def truth_of(piece: Piece, people: Sequence[Seen], ground: GroundView, shown: np.ndarray) -> Truth:
    """What the network should say of a piece; people are given the furthest first.

    `shown`: 1 in cells that lie in the picture, 0 elsewhere.
    """
    high, wide = ROWS // STRIDE, COLUMNS // STRIDE
    rows, columns = np.indices((high, wide)).astype(float)
    at = np.stack([columns, rows]) * STRIDE + 0.5 * STRIDE - 0.5  # cells' centres, pixels
    heat, counted = np.zeros((high, wide)), np.ones((high, wide))
    player, place = np.zeros((high, wide)), np.zeros((6, high, wide))
    scale = float(np.sqrt(abs(np.linalg.det(piece.pixel_from_metre))))
    for person in people:
        if person.depth <= 0.5:
            continue
        nearer = piece.depth / person.depth
        feet = piece.pixels(np.array([person.side * nearer, ground.height * (1.0 - nearer)]))
        reach = person.reach * piece.depth + np.array([0.0, ground.height, 0.0, ground.height])
        corners = piece.pixels(np.array([[reach[i], reach[j]] for i in (0, 2) for j in (1, 3)]))
        box = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
        tall = nearer * scale * piece.person_height_m / PERSON_PX
        middle = feet - np.array([0.0, 0.5 * PERSON_PX * tall])
        inside = (at[0] > box[0] - 3) & (at[0] < box[2] + 3) & (at[1] > box[1] - 3) & (at[1] < box[3] + 3)
        if not inside.any() and not (-20 < middle[0] < COLUMNS + 20 and -20 < middle[1] < ROWS + 20):
            continue
        column, row = (int(np.floor((m + 0.5) / STRIDE)) for m in middle)
        within = 0 <= row < high and 0 <= column < wide
        asked = SIZES[0] < tall < SIZES[1] and abs(feet[1] - FEET_ROW) < 1.35 * REACH_PX * tall
        if person.part == "seated" or not asked or (within and not shown[row, column]):
            counted[inside] = 0.0
            continue
        away = ((at - middle[:, None, None]) / STRIDE) ** 2
        bump = np.exp(-0.5 * away.sum(axis=0) / SIGMA**2)
        # Who is in front hides who is behind: nobody is asked for there, nor punished.
        core = np.abs(at[0] - 0.5 * (box[0] + box[2])) < 0.3 * (box[2] - box[0])
        hidden = inside & core & (bump < 0.3) & (heat == 1.0)
        heat[hidden], counted[hidden] = 0.99, 0.0
        if within:
            bump[row, column] = 1.0
        own = bump >= heat
        here = own & (bump > 0.05)
        player[here] = float(person.part == "plays")
        edges = np.stack([at[0] - box[0], at[1] - box[1], box[2] - at[0], box[3] - at[1]])
        values = np.concatenate([edges, feet[:, None, None] - at]) / PERSON_PX
        place[:, here] = values[:, here]
        heat = np.maximum(heat, bump)
        counted[bump > 0.3] = 1.0
    return Truth(heat=heat, counted=counted, player=player, place=place)


def shown_cells(map_px: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """1 in the cells of a piece that lie in a picture of that width and height, 0 elsewhere."""
    middle = map_px[0, STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    inside = (middle > -0.5).all(axis=-1) & (middle[..., 0] < size[0] - 0.5) & (middle[..., 1] < size[1] - 0.5)
    return inside.astype(float)


def ground_before(camera: Camera) -> GroundView:
    """The ground before a drawn picture's camera.

    Raises:
        ValueError: If the camera has no ground before it.
    """
    ground = ground_view(camera)
    if ground is None:
        raise ValueError("drawn picture: expected a camera over the ground that looks along it, got another")
    return ground
