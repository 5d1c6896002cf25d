"""The picture seen through upright planes on the ground, one behind the other: in each, people are of one size.

Ground coordinates of a camera: depth, metres from the camera's foot the way it looks, and side, metres to its right. A
strip is the upright plane at one depth, drawn with `PX_PER_M`. The ray from the camera at height H through a plane's
point (side u, height h) at depth d meets the ground at depth d H / (H - h) and side u H / (H - h).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene

PERSON_PX = 48.0
"""Height of a person of the scene's `person_height_m` who stands on a strip's ground line, strip pixels."""
ROWS = 80
"""Of a strip."""
FEET_ROW = 60.0
"""Row of a strip's ground line."""
REACH_PX = 12.0
"""Somebody's feet lie at most so far above or below the ground line of the nearest strip."""
MULTIPLE = 32
"""Of which a strip's columns are a multiple."""
NODE_PX = 8
"""Strip pixels between points that are projected; between them the lens is taken as straight."""
MOST_STRIPS = 32
GROWTH = 1.2
"""Largest step from one depth to the next, as a factor."""
LEAST_SEEN = 0.3
"""Share of a person's height that a strip's picture must show."""
LEAST_DEPTH_M = 2.0
LEAST_HEIGHT_M = 0.5
"""Of a camera over the ground, for strips to make sense."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GroundView:
    """The ground as one camera has it before itself."""

    foot: Float[np.ndarray, " 2"]
    """World x and y under the camera, metres."""
    ahead: Float[np.ndarray, " 2"]
    """Unit vector on the ground, the way the camera looks."""
    right: Float[np.ndarray, " 2"]
    """Unit vector on the ground, to the camera's right."""
    height: float
    """Of the camera over the ground, metres."""

    def depth_and_side(self, ground: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Depth and side, metres, of world x and y."""
        return (ground - self.foot) @ np.stack([self.ahead, self.right], axis=1)

    def world(
        self,
        depth: Float[np.ndarray, "*batch"],
        side: Float[np.ndarray, "*batch"],
        up: Float[np.ndarray, "*batch"],
    ) -> Float[np.ndarray, "*batch 3"]:
        """World points at these depths, sides and heights, metres."""
        ground = self.foot + depth[..., None] * self.ahead + side[..., None] * self.right
        return np.concatenate([ground, up[..., None]], axis=-1)


@dataclass(frozen=True, eq=False, kw_only=True)
class StripPlan:
    """The strips of one camera."""

    view: GroundView
    px_per_m: float
    """Strip pixels in a metre."""
    depths: Float[np.ndarray, " strips"]
    """Metres, the nearest first."""
    lefts: Float[np.ndarray, " strips"]
    """Side of each strip's first column, metres."""
    columns: int
    """Of every strip."""

    def plane(
        self, strips: np.ndarray, pixels: Float[np.ndarray, "*batch 2"]
    ) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch"]]:
        """Side and height, metres, of pixels (column, row) of those strips."""
        side = self.lefts[strips] + pixels[..., 0] / self.px_per_m
        return side, (FEET_ROW - pixels[..., 1]) / self.px_per_m

    def world(self, strips: np.ndarray, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """World points, on the strips' planes, of pixels (column, row) of those strips."""
        side, up = self.plane(strips, pixels)
        return self.view.world(np.broadcast_to(self.depths[strips], side.shape), side, up)

    def ground(self, strips: np.ndarray, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """World x and y of the ground seen at pixels of those strips; NaN at and above the camera's height."""
        side, up = self.plane(strips, pixels)
        height = self.view.height
        with np.errstate(divide="ignore", invalid="ignore"):
            stretch = np.where(up < height, height / (height - up), np.nan)
        return self.view.world(self.depths[strips] * stretch, side * stretch, np.zeros_like(side))[..., :2]

    def place(self, ground: Float[np.ndarray, " 2"], strip: int) -> tuple[float, float]:
        """Column and row of a strip where a place on the ground, world x and y, is seen."""
        depth, side = self.view.depth_and_side(ground)
        nearer = float(self.depths[strip] / depth)
        up = self.view.height * (1.0 - nearer)
        return (float(side) * nearer - float(self.lefts[strip])) * self.px_per_m, FEET_ROW - up * self.px_per_m


def searched_ground(scene: Scene) -> Float[np.ndarray, "2 2"]:
    """Lower and upper corner, world x and y in metres, of where the scene's people are looked for.

    Raises:
        ValueError: If the scene has neither players with a region nor a court.
    """
    regions = [np.array(player.region_m)[:, :2] for player in scene.players if player.region_m]
    if regions:
        return np.stack([np.min([r[0] for r in regions], axis=0), np.max([r[1] for r in regions], axis=0)])
    if scene.court is None:
        raise ValueError(f"scene {scene.name}: expected players with region_m, or a court, to look for people at")
    half = np.array(scene.court.surface_half_size, dtype=float)
    return np.stack([-half, half])


def ground_view(camera: Camera) -> GroundView | None:
    """The ground before one camera; None where it is too low over it or looks straight down."""
    foot = camera.position_world
    ahead = camera.R_cam_from_world[2, :2]
    length = float(np.hypot(*ahead))
    if not np.isfinite(foot).all() or foot[2] < LEAST_HEIGHT_M or length < 0.2:
        return None
    ahead = ahead / length
    return GroundView(foot=foot[:2].copy(), ahead=ahead, right=np.array([ahead[1], -ahead[0]]), height=float(foot[2]))


def plan_strips(camera: Camera, *, size: tuple[int, int], scene: Scene) -> StripPlan | None:
    """The strips of one camera over the ground that is searched and seen; None where it sees none of it.

    `size` is width and height of the picture, px.
    """
    view = ground_view(camera)
    if view is None:
        return None
    px_per_m = PERSON_PX / scene.person_height_m
    ground = searched_ground(scene)
    corners = np.array([[ground[i, 0], ground[j, 1]] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
    outline = view.depth_and_side(corners)
    depths = _depths(view, outline[:, 0], REACH_PX / px_per_m)
    spans = np.array([_crossed(outline, d) for d in depths]).reshape(-1, 2)
    seen = _seen_sides(camera, view, depths, size)
    spans = np.stack([np.maximum(spans[:, 0], seen[:, 0]), np.minimum(spans[:, 1], seen[:, 1])], axis=1)
    room = 0.5  # half a person to each side of the middle of its feet
    kept = spans[:, 1] - spans[:, 0] > 0.0
    kept &= _shows(camera, view, depths, spans, scene.person_height_m, size)
    if not kept.any():
        return None
    depths, spans = depths[kept], spans[kept] + np.array([-room, room])
    wide = float((spans[:, 1] - spans[:, 0]).max())
    columns = MULTIPLE * int(np.ceil(wide * px_per_m / MULTIPLE))
    middle = spans.mean(axis=1)
    return StripPlan(
        view=view,
        px_per_m=px_per_m,
        depths=depths,
        lefts=middle - 0.5 * (columns - 1) / px_per_m,
        columns=columns,
    )


def _depths(view: GroundView, outline: Float[np.ndarray, " corners"], reach_m: float) -> Float[np.ndarray, " strips"]:
    """Depths so close that everybody between stands within the reach of one strip's ground line."""
    low, high = max(float(outline.min()), LEAST_DEPTH_M), float(outline.max())
    if high <= low:
        return np.zeros(0)
    growth = min((1.0 + reach_m / view.height) / max(1.0 - reach_m / view.height, 0.5), GROWTH)
    count = min(max(1, int(np.ceil(np.log(high / low) / np.log(growth)))), MOST_STRIPS)
    # The middles, in depth's logarithm, of as many equal parts.
    return low * (high / low) ** ((np.arange(count) + 0.5) / count)


def _crossed(outline: Float[np.ndarray, "corners 2"], depth: float) -> tuple[float, float]:
    """Lowest and highest side of a convex outline at a depth inside it."""
    a, b = outline, np.roll(outline, -1, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (depth - a[:, 0]) / (b[:, 0] - a[:, 0])
    cut = (share >= 0.0) & (share <= 1.0)
    sides = (a[:, 1] + share * (b[:, 1] - a[:, 1]))[cut]
    return float(sides.min()), float(sides.max())


def _seen_sides(
    camera: Camera, view: GroundView, depths: Float[np.ndarray, " strips"], size: tuple[int, int]
) -> Float[np.ndarray, "strips 2"]:
    """Sides between which points a metre over the ground lie in the picture; inside out where none does."""
    sides = np.linspace(-1.5, 1.5, 241) * depths[:, None]
    points = view.world(np.broadcast_to(depths[:, None], sides.shape), sides, np.ones_like(sides))
    pixels, _ = project(camera, points.reshape(-1, 3))
    column = pixels.reshape(*sides.shape, 2)[..., 0]
    inside = (column > -0.5) & (column < size[0] - 0.5)  # NaN compares false
    low = np.where(inside, sides, np.inf).min(axis=1)
    return np.stack([low, np.where(inside, sides, -np.inf).max(axis=1)], axis=1)


def _shows(
    camera: Camera,
    view: GroundView,
    depths: Float[np.ndarray, " strips"],
    spans: Float[np.ndarray, "strips 2"],
    tall: float,
    size: tuple[int, int],
) -> np.ndarray:
    """Whether the picture's rows show `LEAST_SEEN` or more of people at these depths."""
    middle = np.where(spans[:, 1] > spans[:, 0], 0.5 * np.nan_to_num(spans, posinf=0.0, neginf=0.0).sum(axis=1), 0.0)
    ends = [view.world(depths, middle, np.full(len(depths), up * tall)) for up in (LEAST_SEEN, 1.0 - LEAST_SEEN)]
    pixels, seen = project(camera, np.concatenate(ends))
    low, high = np.split(pixels[:, 1], 2)
    return np.asarray(seen.reshape(2, -1).all(axis=0) & (low > 0) & (high < size[1] - 1))


def strip_maps(plan: StripPlan, camera: Camera) -> Float32[np.ndarray, "strips rows columns 2"]:
    """Where each pixel of the strips lies in the picture, px; far outside of it where the camera has no such pixel."""
    high, wide = ROWS // NODE_PX + 1, plan.columns // NODE_PX + 1
    node = np.stack(np.meshgrid(np.arange(wide), np.arange(high)), axis=-1) * float(NODE_PX)
    strips = np.arange(len(plan.depths))[:, None, None]
    world = plan.world(strips, np.broadcast_to(node, (len(plan.depths), high, wide, 2)))
    pixels, _ = project(camera, world.reshape(-1, 3))
    return between_nodes(pixels.reshape(len(plan.depths), high, wide, 2))


def between_nodes(nodes: Float[np.ndarray, "strips high wide 2"]) -> Float32[np.ndarray, "strips rows columns 2"]:
    """Values at every pixel from those at every `NODE_PX`-th one, the last row and column of nodes just outside."""
    count, high, wide = nodes.shape[:3]
    known = np.nan_to_num(nodes, nan=-1e6).astype(np.float32)
    size = ((wide - 1) * NODE_PX, (high - 1) * NODE_PX)
    # OpenCV places pixels to 1/32 of one, which eighths are whole numbers of.
    finer = np.diag([1.0 / NODE_PX, 1.0 / NODE_PX, 1.0])[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    between = np.empty((count, size[1], size[0], 2), np.float32)
    for of, out in zip(known, between, strict=True):
        cv2.warpAffine(of, finer, size, out, flags=flags)
    return between


def shrinks(maps: Float32[np.ndarray, "strips rows columns 2"]) -> Float[np.ndarray, " strips"]:
    """Picture pixels in a strip pixel along the columns, in the middle of each strip."""
    row, column = ROWS // 2, maps.shape[2] // 2
    step = maps[:, row, column].astype(float) - maps[:, row, column - 1]
    return np.hypot(step[:, 0], step[:, 1])


def halvings(shrink: float) -> int:
    """How often the picture is halved before it is read with so many of its pixels in a strip pixel."""
    return int(np.clip(np.floor(np.log2(max(shrink, 1e-6)) + 0.5), 0, 3))


def cut_strips(
    bgr: UInt8[np.ndarray, "height width 3"], maps: Float32[np.ndarray, "strips rows columns 2"]
) -> UInt8[np.ndarray, "strips rows columns 3"]:
    """The strips of a picture, BGR; black where it shows nothing."""
    levels = np.array([halvings(s) for s in shrinks(maps)], dtype=int)
    strips = np.empty((*maps.shape[:3], 3), np.uint8)
    picture = bgr
    for level in range(int(levels.max(initial=-1)) + 1):
        if level:
            size = (max(1, picture.shape[1] // 2), max(1, picture.shape[0] // 2))
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        mine = np.flatnonzero(levels == level)
        if not len(mine):
            continue
        scale = np.array([picture.shape[1] / bgr.shape[1], picture.shape[0] / bgr.shape[0]], np.float32)
        where = maps[mine] if not level else (maps[mine] + np.float32(0.5)) * scale - np.float32(0.5)
        where = where.reshape(-1, maps.shape[2], 2)
        cut = cv2.remap(picture, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)  # pyright: ignore[reportCallIssue, reportArgumentType] the stubs want a second map
        strips[mine] = cut.reshape(len(mine), *maps.shape[1:3], 3)
    return strips
