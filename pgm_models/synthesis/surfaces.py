"""Surfaces that a ray meets once at most: planes of the world, and the sky."""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pgm_data.court import Court
from pgm_data.scene import SceneObject
from pgm_models.synthesis.boxes import NEAREST_M
from pgm_models.synthesis.grids import Grown, corners_of
from pgm_models.synthesis.place_networks import PlaceNetwork, unit_rows
from pgm_models.synthesis.presets import SynthesisDesign
from pgm_models.synthesis.rays import Rays

WAVES = 10
"""Frequencies of a place in a surface that is computed: down to a 1024th of its length."""
PAINTED_AT_ONCE = 1 << 17
"""Upper bound on the rays whose lines are looked for at once, which keeps the memory of large pictures small."""
KNOTS = 65
"""Of the maps from a plane's metres to its cells."""
EVEN_SHARE = 0.2
"""Share of a plane's cells that are spread evenly, whatever pictures show of it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Met:
    """Where rays meet a surface."""

    depth: Float[Tensor, " rays"]
    """Metres along the ray; inf where it does not."""
    rows: Int[Tensor, "rays corners"]
    """Cells about the place; some cells where it does not."""
    shares: Float[Tensor, "rays corners"]
    """Their weights."""
    paint: Float[Tensor, " rays"]
    """How much of the pixel's footprint there the court's painted lines cover, 0 to 1."""

    @property
    def met(self) -> Bool[Tensor, " rays"]:
        """Whether the ray meets it."""
        return torch.isfinite(self.depth)


@dataclass(frozen=True, eq=False, kw_only=True)
class Rectangle:
    """A flat rectangle in the world."""

    corner: Float[np.ndarray, " 3"]
    """Where both its axes begin, metres."""
    right: Float[np.ndarray, " 3"]
    """Its first edge, metres."""
    up: Float[np.ndarray, " 3"]
    """Its second edge, at a right angle."""


def rectangle_of(plane: SceneObject) -> Rectangle:
    """Where a plane of a scene lies: its region; without one its box about the origin, an upright one on the ground.

    Raises:
        ValueError: If not exactly one of its sides is 0.
    """
    if plane.region_m:
        low, high = np.array(plane.region_m, dtype=float)
    else:
        size = np.array(plane.box_m, dtype=float)
        low = np.array([-0.5 * size[0], -0.5 * size[1], 0.0])
        high = low + size
    sides = np.flatnonzero(high > low)
    if len(sides) != 2:
        raise ValueError(f"{plane.name}: expected a plane, with exactly one side of 0 m, got {(high - low).tolist()}")
    edges = np.diag(high - low)[sides]
    return Rectangle(corner=low, right=edges[0], up=edges[1])


class Plane(nn.Module):
    """The field of a flat rectangle, its cells where pictures show most of it."""

    corner: Tensor
    edges: Tensor
    normal: Tensor
    maps: Tensor
    lines: Tensor

    def __init__(
        self,
        rectangle: Rectangle,
        size: tuple[int, int],
        features: int,
        *,
        width: int,
        seed: int,
        court: Court | None = None,
        design: SynthesisDesign | None = None,
    ) -> None:
        """A grid of that size over the rectangle; with a court, its painted lines as they lie on the ground.

        Of a design it is told whether a network takes the grid's place.
        """
        super().__init__()
        self.size = size
        self.grown: Grown | PlaceNetwork
        if design is None or design.planes == "texels":
            self.grown = Grown(size, features, width=width, seed=seed)
        else:
            self.grown = PlaceNetwork(2, features, width=width, waves=WAVES)
        edges = np.stack([rectangle.right, rectangle.up])
        normal = np.cross(*edges)
        for name, value in (
            ("corner", rectangle.corner),
            ("edges", edges / (edges**2).sum(axis=1, keepdims=True)),
            ("normal", normal / np.linalg.norm(normal)),
            ("lines", painted_rectangles(court) if court is not None else np.zeros((0, 2, 3))),
        ):
            self.register_buffer(name, torch.as_tensor(value, dtype=torch.float32), persistent=False)
        self.register_buffer("maps", torch.linspace(0.0, 1.0, KNOTS).repeat(2, 1))

    @torch.no_grad()
    def fit_maps(self, seen: Float[Tensor, "2 bins"]) -> None:
        """Give places that many pixels show more cells; `seen` counts pixels by place along each axis."""
        share = seen / seen.sum(dim=1, keepdim=True).clamp(min=1.0)
        share = (1 - EVEN_SHARE) * share + EVEN_SHARE / seen.shape[1]
        total = torch.cat([share.new_zeros(2, 1), torch.cumsum(share, dim=1)], dim=1)
        total = total / total[:, -1:]
        self.maps.copy_(nn.functional.interpolate(total[None], KNOTS, mode="linear", align_corners=True)[0])

    def across(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 2"]:
        """Points of the plane by their share of its two edges, 0 to 1 within."""
        return (points - self.corner) @ self.edges.T

    def table(self) -> Float[Tensor, "cells inputs"]:
        """What is dressed, of which `Met` tells the rows."""
        return table_of(self.grown, self.normal.device)

    def meet(self, rays: Rays) -> Met:
        """Where each ray meets the rectangle; nowhere where it runs along it."""
        towards = rays.direction @ self.normal
        depth = (self.corner - rays.origin) @ self.normal / towards
        share = self.across(rays.at(torch.where(torch.isfinite(depth), depth, 0.0)))
        inside = ((share >= 0) & (share <= 1)).all(dim=1)
        met = torch.isfinite(depth) & (depth > NEAREST_M) & inside
        places = mapped(self.maps, share.clamp(0.0, 1.0))
        if isinstance(self.grown, PlaceNetwork):
            weights = self.grown(places)
            rows = unit_rows(weights)
        else:
            rows, weights = corners_of(places, self.size)
        depth = torch.where(met, depth, torch.inf)
        return Met(depth=depth, rows=rows, shares=weights, paint=self._painted(rays, depth, towards))

    def _painted(self, rays: Rays, depth: Tensor, towards: Tensor) -> Tensor:
        """Share of each pixel's footprint on the plane that lines cover."""
        paint = torch.zeros_like(depth)
        if not len(self.lines):
            return paint
        for near in torch.nonzero(torch.isfinite(depth))[:, 0].split(PAINTED_AT_ONCE):
            own = rays[near]
            at = own.at(depth[near])[:, :2]
            # A pixel further on, the ray meets the plane where the change of its direction takes it.
            steps = []
            for change in (own.across, own.down):
                moved = change - own.direction * ((change @ self.normal) / towards[near])[:, None]
                steps.append(depth[near, None] * moved[:, :2])
            paint[near] = covered(at, torch.stack(steps, dim=1), self.lines)
        return paint


def parted_veil(
    worn: Float[Tensor, "points outputs"],
) -> tuple[Float[Tensor, "points features"], Float[Tensor, " points"]]:
    """Features of places of a veil, and their optical depth, of which its stylist gives one number beside them.

    The veil hides a share of what is behind it that is the number's sigmoid.
    """
    return worn[:, :-1], nn.functional.softplus(worn[:, -1])


def table_of(content: Grown | PlaceNetwork, device: torch.device) -> Float[Tensor, "cells inputs"]:
    """A grid's cells; of a network the unit vectors."""
    return content() if isinstance(content, Grown) else torch.eye(content.channels, device=device)


def mapped(maps: Float[Tensor, "axes knots"], share: Float[Tensor, "points axes"]) -> Float[Tensor, "points axes"]:
    """Places by a piecewise linear map of each axis, whose knots lie evenly from 0 to 1."""
    place = share * (maps.shape[1] - 1)
    first = place.detach().floor().clamp(0, maps.shape[1] - 2).long()
    low, high = (torch.stack([row[knot] for row, knot in zip(maps, (first + k).T, strict=True)], 1) for k in (0, 1))
    return low + (place - first) * (high - low)


def painted_rectangles(court: Court) -> Float[np.ndarray, "lines 2 3"]:
    """Each line of a court as its middle and half its length along and half its width across: (x, y, half) twice.

    Row 0 is (middle x, middle y, half length), row 1 (unit direction x, y, half width); ends reach as far as the paint
    of a line that they meet.
    """
    ends = court.points_world[court.line_ends][:, :, :2]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    half = 0.5 * (length + court.line_width)
    first = np.concatenate([ends.mean(axis=1), half[:, None]], axis=1)
    second = np.concatenate([along / length[:, None], 0.5 * court.line_width[:, None]], axis=1)
    return np.stack([first, second], axis=1)


def covered(
    at: Float[Tensor, "points 2"], steps: Float[Tensor, "points 2 2"], lines: Float[Tensor, "lines 2 3"]
) -> Float[Tensor, " points"]:
    """Share of the parallelograms about the points that the lines cover.

    Exact within one line; beside an end, its share of the length times its share of the width. Where lines meet, the
    one that covers most counts.

    Args:
        at: Middles, metres.
        steps: The parallelograms' two sides, metres.
        lines: As of `painted_rectangles`.
    """
    half = torch.stack([lines[:, 0, 2], lines[:, 1, 2]], dim=1)[:, :, None]
    direction = lines[:, 1, :2]
    frames = torch.stack([direction, torch.stack([-direction[:, 1], direction[:, 0]], dim=1)], dim=1)
    offset = frames @ at.T - frames @ lines[:, 0, :2, None]  # lines, along and aside, points
    one, other = (frames @ steps[:, side].T for side in (0, 1))
    one, other = one.abs(), other.abs()
    near = (offset.abs() < half + 0.5 * (one + other)).all(dim=1)
    line, point = torch.nonzero(near, as_tuple=True)
    offset, one, other = (each[line, :, point] for each in (offset, one, other))
    half = half[line, :, 0]
    share = share_below(half - offset, one, other) - share_below(-half - offset, one, other)
    share = share.prod(dim=1).clamp(0.0, 1.0)
    return share.new_zeros(len(at)).scatter_reduce(0, point, share, "amax")


def share_below(
    place: Float[Tensor, "*batch"], one: Float[Tensor, "*batch"], other: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """Share of a parallelogram about 0 that lies below a place along an axis, on which its sides measure so much."""
    longer = torch.maximum(one, other).clamp(min=1e-6)
    shorter = torch.minimum(one, other).clamp(min=1e-9)
    left = 0.5 * (longer + shorter) - place.abs()  # to its end
    corner = left.clamp(min=0.0) * (left.clamp(min=0.0) / shorter) / (2 * longer)
    above = torch.where(left < shorter, corner, 0.5 - place.abs() / longer)
    return torch.where(place > 0, 1 - above, above)


class Sky(nn.Module):
    """The field of what is so far away that only its direction counts."""

    def __init__(
        self, size: tuple[int, int], features: int, *, width: int, seed: int, design: SynthesisDesign | None = None
    ) -> None:
        """A grid of that size over all directions: once round the horizon, and from straight down to straight up.

        Of a design it is told whether a network takes the grid's place; that is asked about directions.
        """
        super().__init__()
        self.size = size
        self.grown: Grown | PlaceNetwork
        if design is None or design.planes == "texels":
            self.grown = Grown(size, features, width=width, seed=seed)
        else:
            self.grown = PlaceNetwork(3, features, width=width, waves=WAVES)

    def table(self) -> Float[Tensor, "cells inputs"]:
        """What is dressed, of which `Met` tells the rows."""
        return table_of(self.grown, next(self.grown.parameters()).device)

    def meet(self, rays: Rays, depth: float = 1e6) -> Met:
        """Where each ray ends; every one does, at that depth."""
        if isinstance(self.grown, PlaceNetwork):
            values, none = self.grown(0.5 + 0.5 * rays.direction), torch.zeros_like(rays.direction[:, 0])
            return Met(depth=torch.full_like(none, depth), rows=unit_rows(values), shares=values, paint=none)
        x, y, z = rays.direction.unbind(dim=1)
        turn = (torch.atan2(y, x) / (2 * math.pi)) % 1.0 * self.size[0]
        height = (torch.asin(z.clamp(-1.0, 1.0)) / math.pi + 0.5)[:, None]
        first = turn.detach().floor()
        share = (turn - first)[:, None]
        columns = torch.stack([first, first + 1], dim=1).long() % self.size[0]
        rows, shares = corners_of(height, self.size[1:])
        return Met(
            depth=torch.full_like(z, depth),
            rows=(columns[:, :, None] * self.size[1] + rows[:, None]).flatten(1),
            shares=(torch.cat([1 - share, share], dim=1)[:, :, None] * shares[:, None]).flatten(1),
            paint=torch.zeros_like(z),
        )
