"""What rays see when every sample of every object is looked at: what skipping is measured against.

Two ways, neither of which asks which rays meet a box, where limbs are, what is empty, or what is hidden:

- `dense_picture` renders the very picture of `renderer.render`: samples of every ray cut from where it is in an
  object's box, each carried to the rest pose by every joint, each dressed; a ray beside the box has samples of no
  length.
- `paper_picture` also dresses every sample by a network of its own, after interpolation, and samples the ball's box as
  the paper does: the work of its layout with these fields' sizes. It is not the picture that the model learned.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pgm_data.scene import SceneObject
from pgm_models.synthesis.balls import SOLID, Balls, ball_boxes, ball_shares, blur_share, optical_of_share
from pgm_models.synthesis.bodies import THIN, Body, BodyGrids, body_boxes, density_of
from pgm_models.synthesis.boxes import Boxes, box_spans
from pgm_models.synthesis.fields import Fields, Grids, States, Wardrobe
from pgm_models.synthesis.grids import corners_of, mixed
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.renderer import background
from pgm_models.synthesis.samples import OPAQUE
from pgm_models.synthesis.skinning import TINY, Poses, Skinning
from pgm_models.synthesis.stylists import dressed
from pgm_models.synthesis.surfaces import parted_veil
from pgm_models.synthesis.worlds import StaticVolume, WorldGrids

RAYS_AT_ONCE = 2048
"""Which keeps memory small: each has a row for each joint of each sample."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DenseSamples:
    """Samples of an object on every ray."""

    depth: Float[Tensor, "rays count"]
    """Metres along the ray."""
    optical: Float[Tensor, "rays count"]
    """Optical depth of each one's interval, of a veil what its own is multiplied by; 0 where the object is not."""
    rows: Int[Tensor, "samples corners"]
    """Cells about each, ray after ray."""
    shares: Float[Tensor, "samples corners"]
    """Their weights."""


class SampleWardrobe(Wardrobe):
    """Dresses every sample by the network, after interpolation, whatever the fields were trained for."""

    def wear(
        self,
        thing: int,
        rows: Int[Tensor, "points corners"],
        shares: Float[Tensor, "points corners"],
        frame: Int[Tensor, " points"],
    ) -> Float[Tensor, "points features"]:
        """Features of points of an object."""
        name = self.fields.scene.objects[thing].name
        values = self.grids.values(self.fields.key_of[name])
        return dressed(self.fields.stylist(name), values, rows, shares, frame, self.style(thing), "sample")


def dense_picture(
    rays: Rays, fields: Fields, grids: Grids, states: States, wardrobe: Wardrobe
) -> Float[Tensor, "rays features"]:
    """Features of what each ray sees, of one frame's states: those of `render`, the slow way."""
    return _chunked(rays, fields, grids, states, wardrobe, EXACT)


def paper_picture(
    rays: Rays, fields: Fields, grids: Grids, states: States, styles: Float[Tensor, "1 objects style"]
) -> Float[Tensor, "rays features"]:
    """Features of what each ray sees in the layout of the paper."""
    return _chunked(rays, fields, grids, states, SampleWardrobe(fields, grids, styles), PAPER)


def dense_samples(fields: Fields) -> int:
    """Field samples that a ray has when it has those of every object: one of a surface."""
    return sum(samples_of(thing, fields) for thing in fields.scene.objects)


def samples_of(thing: SceneObject, fields: Fields) -> int:
    """Samples of a ray in an object: as the scene says, and no more than the fields' own number."""
    most = fields.options.world_samples if thing.kind == "static" else fields.options.samples
    return min(most, thing.samples_per_ray)


@dataclass(frozen=True, eq=False, kw_only=True)
class Way:
    """How volumes are sampled."""

    ball: Callable[[Rays, Balls, int], DenseSamples]
    precision: torch.dtype
    """In which samples are carried to the rest pose."""


def _chunked(
    rays: Rays, fields: Fields, grids: Grids, states: States, wardrobe: Wardrobe, way: Way
) -> Float[Tensor, "rays features"]:
    parts = []
    for start in range(0, len(rays), RAYS_AT_ONCE):
        own = rays[torch.arange(start, min(start + RAYS_AT_ONCE, len(rays)), device=rays.frame.device)]
        parts.append(_seen(own, fields, grids, states, wardrobe, way))
    return torch.cat(parts) if parts else rays.direction.new_zeros(0, fields.options.features)


def _seen(
    rays: Rays, fields: Fields, grids: Grids, states: States, wardrobe: Wardrobe, way: Way
) -> Float[Tensor, "rays features"]:
    behind = background(rays, fields, wardrobe)
    depths, opticals, features = [], [], []
    for number, thing in enumerate(fields.scene.objects):
        found = _samples(thing, rays, fields, grids, states, way)
        if found is None:
            continue
        frame = rays.frame.repeat_interleave(found.depth.shape[1])
        worn, optical = wardrobe.wear(number, found.rows, found.shares, frame), found.optical
        if thing.name in fields.veils:
            worn, hides = parted_veil(worn)
            optical = optical * hides[:, None]
        depths.append(found.depth)
        opticals.append(torch.where(found.depth < behind.depth[:, None], optical, 0.0))
        features.append(worn.unflatten(0, found.depth.shape))
    if not depths:
        return behind.features
    depth, order = torch.sort(torch.cat(depths, dim=1), dim=1, stable=True)
    optical = torch.cat(opticals, dim=1).gather(1, order).clamp(max=OPAQUE).double()
    before = torch.cumsum(optical, dim=1) - optical
    weights = (torch.exp(-before) * -torch.expm1(-optical)).to(depth.dtype)
    worn = torch.cat(features, dim=1).gather(1, order[..., None].expand(-1, -1, features[0].shape[2]))
    passed = torch.exp(-optical.sum(dim=1)).to(depth.dtype)
    return (weights[..., None] * worn).sum(dim=1) + passed[:, None] * behind.features


def _samples(
    thing: SceneObject, rays: Rays, fields: Fields, grids: Grids, states: States, way: Way
) -> DenseSamples | None:
    """Of an object; None of a solid surface, or of what is not there."""
    name, count = thing.name, samples_of(thing, fields)
    if name in states.poses:
        key = fields.key_of[name]
        if not bool(states.poses[name].present[0]):
            return None
        return dense_body(
            rays, fields.body(key), states.poses[name], grids.bodies[key], count=count, precision=way.precision
        )
    if name in fields.worlds:
        world = fields.world(name)
        if not isinstance(world, StaticVolume):
            raise ValueError(f"{name}: expected cells to compare with dense samples, got {type(world).__name__}")
        return dense_world(rays, world, grids.worlds[name], count=count)
    if name in fields.balls and states.balls is not None and bool(states.balls.present[0]):
        return way.ball(rays, states.balls, count)
    if name in fields.veils:
        met = fields.surface(name).meet(rays)
        depth = torch.where(met.met, met.depth, 0.0)
        return DenseSamples(depth=depth[:, None], optical=met.met[:, None].float(), rows=met.rows, shares=met.shares)
    return None


def _cut(rays: Rays, boxes: Boxes, count: int) -> tuple[Float[Tensor, "rays count"], Float[Tensor, " rays"]]:
    """Depths of a ray's samples in the box of its frame, and the length of each; 0 where it misses the box."""
    spans = box_spans(rays, boxes)
    length = (spans.far - spans.near).clamp(min=0.0) / count
    place = torch.arange(count, device=length.device) + 0.5
    return spans.near[:, None] + length[:, None] * place, length


def dense_body(
    rays: Rays, body: Body, poses: Poses, grids: BodyGrids, *, count: int, precision: torch.dtype = torch.float32
) -> DenseSamples:
    """A body's samples, each carried to the rest pose by every joint; of one frame's poses.

    Args:
        rays: Of that frame.
        body: The field.
        poses: Of one frame.
        grids: What the field's networks make.
        count: Samples of a ray.
        precision: In which samples are carried: from a camera far away float32 leaves some 1e-5 m.
    """
    skinning = body.skinning
    if not isinstance(skinning, Skinning):
        raise ValueError(f"body: expected skinning to carry dense samples by, got {type(skinning).__name__}")
    depth, length = _cut(rays, body_boxes(poses, skinning), count)
    origin, direction = rays.origin.to(precision), rays.direction.to(precision)
    points = (origin[:, None] + depth[..., None].to(precision) * direction[:, None]).flatten(0, 1)
    total = rays.origin.new_zeros(len(points))
    blended = rays.origin.new_zeros(len(points), 3)
    for joint in range(skinning.joints):
        turned = points @ poses.rotation[0, joint].T.to(precision) + poses.translation[0, joint].to(precision)
        at = turned.to(blended.dtype)
        low, high = skinning.reach[joint]
        weight = mixed(
            grids.weights[:, joint : joint + 1].contiguous(), *corners_of(skinning.places(at), skinning.size)
        )
        weight = torch.where(((at >= low) & (at <= high)).all(dim=1), weight[:, 0], 0.0)
        total, blended = total + weight, blended + weight[:, None] * at
    inside = total > TINY
    rest = blended / torch.where(inside, total, 1.0)[:, None]
    rows, shares = corners_of(skinning.places(rest), body.size)
    density = density_of(mixed(grids.density, rows, shares)[:, 0]) * torch.where(inside, total.clamp(max=1.0), 0.0)
    # As bodies are defined: what is thinner is nothing.
    density = torch.where(density > THIN, density, 0.0)
    return DenseSamples(depth=depth, optical=density.view(depth.shape) * length[:, None], rows=rows, shares=shares)


def dense_world(rays: Rays, world: StaticVolume, grids: WorldGrids, *, count: int) -> DenseSamples:
    """A static volume's samples."""
    spans = world.spans(rays)
    length = (spans.far - spans.near).clamp(min=0.0) / count
    place = torch.arange(count, device=length.device) + 0.5
    depth = spans.near[:, None] + length[:, None] * place
    points = (rays.origin[:, None] + depth[..., None] * rays.direction[:, None]).flatten(0, 1)
    rows, shares = corners_of(world.places(points), world.size)
    density = density_of(mixed(grids.density, rows, shares)[:, 0])
    return DenseSamples(depth=depth, optical=density.view(depth.shape) * length[:, None], rows=rows, shares=shares)


def _exact_ball(rays: Rays, balls: Balls, count: int) -> DenseSamples:
    """The ball in closed form, one sample a ray."""
    share, depth = ball_shares(rays, balls)
    nowhere = torch.zeros_like(rays.frame)[:, None]
    depth = torch.where(share > 0, depth, 0.0)
    return DenseSamples(
        depth=depth[:, None],
        optical=torch.where(share > 0, optical_of_share(share), 0.0)[:, None],
        rows=nowhere,
        shares=torch.ones_like(depth)[:, None],
    )


def _sampled_ball(rays: Rays, balls: Balls, count: int) -> DenseSamples:
    """The ball by samples in its box, dense for the share of the time in which it holds them.

    Source: Menapace et al. 2023, appendix B.1.
    """
    depth, length = _cut(rays, ball_boxes(balls), count)
    points = (rays.origin[:, None] + depth[..., None] * rays.direction[:, None]).flatten(0, 1)
    density = SOLID * blur_share(points - balls.position[0], balls.path[0], balls.radius)
    nowhere = torch.zeros(len(points), 1, dtype=torch.int64, device=points.device)
    return DenseSamples(
        depth=depth,
        optical=density.view(depth.shape) * length[:, None],
        rows=nowhere,
        shares=torch.ones_like(points[:, :1]),
    )


EXACT = Way(ball=_exact_ball, precision=torch.float64)
PAPER = Way(ball=_sampled_ball, precision=torch.float32)
