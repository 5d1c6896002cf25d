"""What rays see, the slow obvious way: one ray, one object and one sample at a time, in float64.

Nothing is packed, skipped or stopped early. Every sample of a volume stands for its own interval; a ray's samples are
put in order of depth and let through what is behind them one after the other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from torch import Tensor

from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.bodies import DENSITY_SCALE, THIN, Body, BodyGrids
from pgm_models.synthesis.boxes import NEAREST_M
from pgm_models.synthesis.fields import Fields, Grids, States
from pgm_models.synthesis.insertions import SUBPIXELS, Placed
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.skinning import TINY, Poses, Skinning
from pgm_models.synthesis.stylists import Stylist
from pgm_models.synthesis.surfaces import Plane, Sky
from pgm_models.synthesis.worlds import StaticVolume

BALL_SPOTS = 64
"""Places in a pixel along each axis at which the ball is looked for."""
BALL_TIMES = 256
"""Times of the exposure at which it is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Ray:
    """One ray."""

    origin: np.ndarray
    direction: np.ndarray
    across: np.ndarray
    down: np.ndarray
    frame: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """One thing that a ray meets."""

    depth: float
    """Metres along the ray."""
    hidden: float
    """Share that it hides of what is behind, 0 to 1."""
    features: np.ndarray
    thing: int


@dataclass(frozen=True, eq=False, kw_only=True)
class SlowPicture:
    """What rays see."""

    features: Float[np.ndarray, "rays features"]
    depth: Float[np.ndarray, " rays"]
    shares: Float[np.ndarray, "rays objects"]
    inserted: Float[np.ndarray, " rays"]


def slow_picture(
    rays: Rays,
    fields: Fields,
    grids: Grids,
    states: States,
    styles: Float[Tensor, "frames objects style"],
    inserted: Sequence[Placed] = (),
) -> SlowPicture:
    """What each ray sees; arguments as of `renderer.render`."""
    features, depths, shares = [], [], []
    things = len(fields.scene.objects)
    for ray in single_rays(rays):
        seen: list[Seen] = []
        for number, thing in enumerate(fields.scene.objects):
            key = fields.key_of[thing.name]
            stylist = fields.stylists[key]
            assert isinstance(stylist, Stylist)
            style = array(styles[ray.frame if len(styles) > 1 else 0, number])
            wanted = fields.options.world_samples if thing.name in fields.worlds else fields.options.samples
            count = min(wanted, thing.samples_per_ray)
            dress = Dress(stylist=stylist, style=style, per_cell=fields.options.stylising == "grid")
            if thing.name in states.poses:
                body = fields.bodies[key]
                assert isinstance(body, Body)
                seen += body_seen(ray, body, grids.bodies[key], states.poses[thing.name], dress, count, number)
            elif thing.name in fields.worlds:
                world = fields.worlds[thing.name]
                assert isinstance(world, StaticVolume)
                grid = grids.worlds[thing.name]
                seen += world_seen(ray, world, array(grid.density), array(grid.values), dress, count, number)
            elif thing.name in fields.balls and states.balls is not None:
                seen += ball_seen(ray, states.balls, dress.features([(1.0, array(grids.surfaces[key])[0])]), number)
            elif thing.name in fields.planes:
                plane = fields.planes[thing.name]
                assert isinstance(plane, Plane)
                paint = None
                if thing.name in fields.paints:
                    raw = array(fields.paints[thing.name](styles[ray.frame if len(styles) > 1 else 0, number]))
                    paint = np.concatenate([logistic(raw[:3]), raw[3:]])
                found = plane_seen(ray, plane, array(grids.surfaces[thing.name]), dress, paint, number)
                seen += [veiled(one) for one in found] if thing.opacity == "learned" else found
            elif thing.name in fields.skies:
                sky = fields.skies[thing.name]
                assert isinstance(sky, Sky)
                seen += sky_seen(ray, sky, array(grids.surfaces[thing.name]), dress, number)
        for number, placed in enumerate(inserted, things):
            seen += mesh_seen(ray, placed, fields.options.features, number)
        one = composed(seen, fields.options.features, things + len(inserted))
        features.append(one[0])
        depths.append(one[1])
        shares.append(one[2])
    all_shares = np.array(shares)
    return SlowPicture(
        features=np.array(features),
        depth=np.array(depths),
        shares=all_shares[:, :things],
        inserted=all_shares[:, things:].sum(axis=1),
    )


def composed(seen: list[Seen], features: int, things: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Features, mean depth (inf where some of it is nothing) and shares of what a ray meets."""
    total, shares, depth, passed = np.zeros(features), np.zeros(things), 0.0, 1.0
    for each in sorted(seen, key=lambda one: one.depth):
        weight = passed * each.hidden
        total += weight * each.features
        shares[each.thing] += weight
        depth += weight * each.depth
        passed *= 1.0 - each.hidden
    return total, depth if passed < 1e-6 else math.inf, shares


def array(values: Tensor) -> np.ndarray:
    """In float64."""
    return values.detach().cpu().double().numpy()


def single_rays(rays: Rays) -> list[Ray]:
    """One by one."""
    parts = [array(part) for part in (rays.origin, rays.direction, rays.across, rays.down)]
    return [
        Ray(origin=o, direction=d, across=a, down=b, frame=int(frame))
        for o, d, a, b, frame in zip(*parts, rays.frame.tolist(), strict=True)
    ]


def logistic(values: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-x))."""
    return 1.0 / (1.0 + np.exp(-values))


def trilinear(grid: np.ndarray, place: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Weights and values of the cells about a place, 0 to 1 along each axis of a grid (x, y, ..., channels)."""
    last = np.array(grid.shape[:-1]) - 1
    at = np.clip(place, 0.0, 1.0) * last
    first = np.minimum(np.floor(at), np.maximum(last - 1, 0)).astype(int)
    found: list[tuple[float, np.ndarray]] = []
    for corner in np.ndindex(*(2,) * len(last)):
        weight, cell = 1.0, []
        for axis, beyond in enumerate(corner):
            share = at[axis] - first[axis]
            weight *= share if beyond else 1.0 - share
            cell.append(min(first[axis] + beyond, last[axis]))
        if weight > 0:
            found.append((float(weight), grid[tuple(cell)]))
    return found


def interpolated(grid: np.ndarray, place: np.ndarray) -> np.ndarray:
    """What a grid holds at a place."""
    return np.sum([weight * value for weight, value in trilinear(grid, place)], axis=0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Dress:
    """How values become features."""

    stylist: Stylist
    style: np.ndarray
    per_cell: bool
    """Whether cells are dressed, then interpolated; the other way round otherwise."""

    def features(self, cells: list[tuple[float, np.ndarray]]) -> np.ndarray:
        """Of a place whose cells have these weights and values."""
        if self.per_cell:
            return np.sum([weight * slow_stylist(self.stylist, value, self.style) for weight, value in cells], axis=0)
        value = np.sum([weight * value for weight, value in cells], axis=0)
        return slow_stylist(self.stylist, value, self.style)


def slow_stylist(stylist: Stylist, values: np.ndarray, style: np.ndarray) -> np.ndarray:
    """Features of one row of values: weights scaled by the style, brought to length, applied."""
    scales = 1 + array(stylist.scales.weight) @ style + array(stylist.scales.bias)
    hidden = values
    for layer, scale in ((stylist.first, scales[: stylist.inputs]), (stylist.second, scales[stylist.inputs :])):
        weight = array(layer.weight) * scale
        length = np.sqrt((weight**2).sum(axis=1) + 1e-8)
        raw = array(layer.gain) * (weight @ hidden) / length + array(layer.bias)
        hidden = raw * logistic(raw)
    raw = raw + array(stylist.shift.weight) @ style + array(stylist.shift.bias)
    return np.concatenate([logistic(raw[:3]), raw[3:]])


def slow_density(raw: float) -> float:
    """1/m, of what a volume holds."""
    density = DENSITY_SCALE * float(np.logaddexp(0.0, raw))
    return density if density > THIN else 0.0


def box_span(ray: Ray, low: np.ndarray, high: np.ndarray) -> tuple[float, float] | None:
    """Where a ray is inside a box; None where it is not."""
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        return None
    near, far = NEAREST_M, math.inf
    for axis in range(3):
        offsets, speed = (low[axis] - ray.origin[axis], high[axis] - ray.origin[axis]), ray.direction[axis]
        if speed == 0:
            if not offsets[0] < 0 < offsets[1]:
                return None
            continue
        ends = sorted(offset / speed for offset in offsets)
        near, far = max(near, ends[0]), min(far, ends[1])
    return (near, far) if far > near else None


def samples_in(span: tuple[float, float] | None, count: int) -> list[tuple[float, float]]:
    """Depth of the middle and length of each of the intervals that a span is cut into."""
    if span is None:
        return []
    length = (span[1] - span[0]) / count
    return [(span[0] + (number + 0.5) * length, length) for number in range(count)]


@dataclass(frozen=True, eq=False, kw_only=True)
class SlowBody:
    """A body's grids in float64."""

    body: Body
    density: np.ndarray
    values: np.ndarray
    weights: np.ndarray
    reach: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def rest(self, point: np.ndarray, poses: Poses, frame: int) -> tuple[np.ndarray, float] | None:
        """Place of a point of the world in the rest pose, and how far it belongs to the body; None outside."""
        total, blended = 0.0, np.zeros(3)
        for joint in range(self.weights.shape[-1]):
            at = array(poses.rotation[frame, joint]) @ point + array(poses.translation[frame, joint])
            if ((at > self.reach[joint, 0]) & (at < self.reach[joint, 1])).all():
                place = (at - self.low) / (self.high - self.low)
                weight = float(interpolated(self.weights[..., joint : joint + 1], place)[0])
                total, blended = total + weight, blended + weight * at
        return (blended / total, min(total, 1.0)) if total > TINY else None

    def place(self, rest: np.ndarray) -> np.ndarray:
        """A point of the rest pose in the grids, 0 to 1 inside."""
        return (rest - self.low) / (self.high - self.low)

    def box(self, poses: Poses, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """A box of the world about all that joints weigh in."""
        corners = []
        for joint, ends in enumerate(self.reach):
            R, t = array(poses.rotation[frame, joint]), array(poses.translation[frame, joint])
            if np.isfinite(ends).all():
                for corner in np.ndindex(2, 2, 2):
                    corners.append(np.linalg.solve(R, np.array([ends[c, axis] for axis, c in enumerate(corner)]) - t))
        return np.min(corners, axis=0), np.max(corners, axis=0)


def slow_body(body: Body, grids: BodyGrids) -> SlowBody:
    """The body with these grids."""
    skinning = body.skinning
    assert isinstance(skinning, Skinning)
    return SlowBody(
        body=body,
        density=array(grids.density).reshape(*body.size, 1),
        values=array(grids.values).reshape(*body.size, -1),
        weights=array(grids.weights).reshape(*skinning.size, -1),
        reach=array(skinning.reach),
        low=array(skinning.low),
        high=array(skinning.high),
    )


def body_seen(ray: Ray, body: Body, grids: BodyGrids, poses: Poses, dress: Dress, count: int, thing: int) -> list[Seen]:
    """A body's samples on a ray."""
    slow, seen = slow_body(body, grids), []
    if not bool(poses.present[ray.frame]):
        return seen
    for depth, length in samples_in(box_span(ray, *slow.box(poses, ray.frame)), count):
        found = slow.rest(ray.origin + depth * ray.direction, poses, ray.frame)
        if found is not None:
            place = slow.place(found[0])
            density = slow_density(float(interpolated(slow.density, place)[0])) * found[1]
            if density > THIN:
                hidden = 1.0 - math.exp(-density * length)
                features = dress.features(trilinear(slow.values, place))
                seen.append(Seen(depth=depth, hidden=hidden, features=features, thing=thing))
    return seen


def world_seen(
    ray: Ray, world: StaticVolume, density: np.ndarray, values: np.ndarray, dress: Dress, count: int, thing: int
) -> list[Seen]:
    """A static volume's samples on a ray."""
    low, high, seen = array(world.low), array(world.high), []
    for depth, length in samples_in(box_span(ray, low, high), count):
        place = (ray.origin + depth * ray.direction - low) / (high - low)
        found = slow_density(float(interpolated(density.reshape(*world.size, 1), place)[0]))
        if found > 0:
            features = dress.features(trilinear(values.reshape(*world.size, -1), place))
            seen.append(Seen(depth=depth, hidden=1.0 - math.exp(-found * length), features=features, thing=thing))
    return seen


def ball_seen(ray: Ray, balls: Balls, features: np.ndarray, thing: int) -> list[Seen]:
    """The ball on a ray, by looking for it at many places of the pixel and at many times."""
    position, path = array(balls.position[ray.frame]), array(balls.path[ray.frame])
    offset = position - ray.origin
    depth = float(offset @ ray.direction)
    if not depth > NEAREST_M:
        return []
    spots = (np.arange(BALL_SPOTS) + 0.5) / BALL_SPOTS - 0.5
    times = (np.arange(BALL_TIMES) + 0.5) / BALL_TIMES - 0.5
    centres = offset + times[:, None] * path
    held = 0.0
    for x in spots:
        directions = ray.direction + x * ray.across + spots[:, None] * ray.down
        along = centres @ (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
        held += float(((centres**2).sum(axis=1)[:, None] - along**2 < balls.radius**2).mean())
    share = held / BALL_SPOTS
    return [Seen(depth=depth, hidden=share, features=features, thing=thing)] if share > 0 else []


def mesh_seen(ray: Ray, placed: Placed, features: int, thing: int) -> list[Seen]:
    """An inserted mesh on a ray, through several places of its pixel."""
    mesh = placed.mesh
    R, t = (array(each[ray.frame]) for each in (placed.placement.R_mesh_from_world, placed.placement.t_mesh_from_world))
    low, high, count = array(mesh.low), array(mesh.high), mesh.intervals
    distance = array(mesh.distance).reshape(*mesh.size, 1)
    hidden, away = [], []
    for x, y in np.ndindex(SUBPIXELS, SUBPIXELS):
        spot = [(place + 0.5) / SUBPIXELS - 0.5 for place in (x, y)]
        direction = R @ (ray.direction + spot[0] * ray.across + spot[1] * ray.down)
        own = Ray(
            origin=R @ ray.origin + t,
            direction=direction / np.linalg.norm(direction),
            across=ray.across,
            down=ray.down,
            frame=ray.frame,
        )
        inside = [
            (depth, length)
            for depth, length in samples_in(box_span(own, low, high), count)
            if interpolated(distance, (own.origin + depth * own.direction - low) / (high - low))[0] < 0
        ]
        hidden.append(1.0 - math.exp(-mesh.density * sum(length for _, length in inside)))
        away.append(inside[0][0] if inside else 0.0)
    if not any(hidden):
        return []
    colour = np.concatenate([array(mesh.colour)[0], np.zeros(features - 3)])
    share, depth = float(np.mean(hidden)), float(np.dot(hidden, away) / np.sum(hidden))
    return [Seen(depth=depth, hidden=share, features=colour, thing=thing)]


def plane_seen(
    ray: Ray, plane: Plane, values: np.ndarray, dress: Dress, paint: np.ndarray | None, thing: int
) -> list[Seen]:
    """A rectangle on a ray."""
    edges, normal, corner = array(plane.edges), array(plane.normal), array(plane.corner)
    towards = float(ray.direction @ normal)
    if towards == 0:
        return []
    depth = float((corner - ray.origin) @ normal) / towards
    share = edges @ (ray.origin + depth * ray.direction - corner)
    if not (depth > NEAREST_M and ((share >= 0) & (share <= 1)).all()):
        return []
    knots = np.linspace(0.0, 1.0, plane.maps.shape[1])
    place = np.array([np.interp(s, knots, row) for s, row in zip(share, array(plane.maps), strict=True)])
    features = dress.features(trilinear(values.reshape(*plane.size, -1), place))
    if paint is not None:
        share = float(painted_share(ray, corner, normal, array(plane.lines)))
        features = (1 - share) * features + share * paint
    return [Seen(depth=depth, hidden=1.0, features=features, thing=thing)]


def veiled(one: Seen) -> Seen:
    """What is met of a veil: the last of its numbers tells how much it hides."""
    return replace(one, features=one.features[:-1], hidden=float(logistic(one.features[-1])))


def painted_share(ray: Ray, corner: np.ndarray, normal: np.ndarray, lines: np.ndarray, spots: int = 200) -> float:
    """How much of a pixel one line covers, the one that covers most: by looking at many places of the pixel."""
    places = (np.arange(spots) + 0.5) / spots - 0.5
    x, y = (part.ravel()[:, None] for part in np.meshgrid(places, places))
    # The pixel's outline on the plane is taken for a parallelogram, as its rays hardly diverge.
    towards = float(ray.direction @ normal)
    depth = float((corner - ray.origin) @ normal) / towards
    sides = [depth * (c - ray.direction * (c @ normal) / towards) for c in (ray.across, ray.down)]
    points = (ray.origin + depth * ray.direction + x * sides[0] + y * sides[1])[:, :2]
    most = 0.0
    for (middle_x, middle_y, half_length), (along_x, along_y, half_width) in lines:
        offset = points - [middle_x, middle_y]
        along, aside = offset @ [along_x, along_y], offset @ [-along_y, along_x]
        most = max(most, float(((np.abs(along) < half_length) & (np.abs(aside) < half_width)).mean()))
    return most


def sky_seen(ray: Ray, sky: Sky, values: np.ndarray, dress: Dress, thing: int) -> list[Seen]:
    """The sky on a ray: columns go round the horizon and meet again, rows go from straight down to straight up."""
    grid = values.reshape(*sky.size, -1)
    x, y, z = ray.direction
    turn = (math.atan2(y, x) / (2 * math.pi)) % 1.0 * sky.size[0]
    first = math.floor(turn)
    height = np.array([math.asin(min(max(z, -1.0), 1.0)) / math.pi + 0.5])
    cells = [
        (share * weight, value)
        for share, column in ((1 - (turn - first), first), (turn - first, first + 1))
        for weight, value in trilinear(grid[column % sky.size[0]], height)
    ]
    return [Seen(depth=1e6, hidden=1.0, features=dress.features(cells), thing=thing)]
