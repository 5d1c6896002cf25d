"""What rays see: surfaces behind, volumes in front, each ray's samples in the order of their depth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float, Int
from torch import Tensor

from pgm_data.scene import SceneObject
from pgm_models.synthesis.balls import ball_shares, optical_of_share
from pgm_models.synthesis.bodies import Marched
from pgm_models.synthesis.fields import Fields, Grids, States, Wardrobe
from pgm_models.synthesis.insertions import Placed, march_mesh
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, along_rays, joined_samples, summed, weights_of
from pgm_models.synthesis.surfaces import Met, parted_veil

FAINT = 1e-6
"""Samples that make less of a pixel are not dressed; of a hundred on a ray, 1e-4 is lost at most."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Background:
    """What each ray sees where nothing is in front."""

    features: Float[Tensor, "rays features"]
    """0 where there is nothing."""
    depth: Float[Tensor, " rays"]
    """Metres along the ray; inf where there is nothing."""
    thing: Int[Tensor, " rays"]
    """Number of the object; -1 where there is nothing."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Rendered:
    """What rays see."""

    features: Float[Tensor, "rays features"]
    """The first three are the colour, RGB 0 to 1."""
    depth: Float[Tensor, " rays"]
    """Mean over what is seen, metres along the ray; inf where some of it is nothing."""
    shares: Float[Tensor, "rays objects"]
    """How much of the pixel each object is, 0 to 1."""
    inserted: Float[Tensor, " rays"] | None
    """The same of all inserted meshes; None where none is inserted."""
    looked_at: int
    """Samples of volumes whose density was asked for."""
    dressed: int
    """Samples that were given features."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What is at hand of some rays before they are followed."""

    behind: Background | None = None
    """Their background."""
    near: Mapping[str, Int[Tensor, " some"]] = field(default_factory=dict)
    """For volumes by object: the rays that may meet them; all where it says nothing of one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Part:
    """What rays meet of one object."""

    thing: int
    """Its number; those of inserted meshes follow those of objects."""
    marched: Marched
    worn: Float[Tensor, "samples features"] | None = None
    """What its samples look like, where that is known."""


def background(rays: Rays, fields: Fields, wardrobe: Wardrobe) -> Background:
    """The nearest surface that each ray meets, veils apart."""
    features = rays.direction.new_zeros(len(rays), fields.options.features)
    depth = torch.full_like(rays.direction[:, 0], torch.inf)
    thing = torch.full_like(rays.frame, -1)
    met: dict[int, Met] = {}
    for number, each in enumerate(fields.scene.objects):
        if (each.name in fields.planes or each.name in fields.skies) and not each.is_veil:
            with _exactly(rays):
                met[number] = fields.surface(each.name).meet(rays)
            nearer = met[number].depth < depth
            depth = torch.where(nearer, met[number].depth, depth)
            thing = torch.where(nearer, number, thing)
    for number, each in met.items():
        own = torch.nonzero(thing == number)[:, 0]
        frame = rays.frame[own]
        worn = wardrobe.wear(number, each.rows[own], each.shares[own], frame).to(features.dtype)
        name = fields.scene.objects[number].name
        if name in fields.paints:
            style = wardrobe.style(number)
            raw = fields.paints[name](style).to(features.dtype)
            painted = torch.cat([torch.sigmoid(raw[:, :3]), raw[:, 3:]], dim=1)
            painted = painted[frame] if len(style) > 1 else painted
            worn = torch.lerp(worn, painted.expand_as(worn), each.paint[own, None])
        features = features.index_put((own,), worn)
    return Background(features=features, depth=depth, thing=thing)


def render(
    rays: Rays,
    fields: Fields,
    grids: Grids,
    states: States,
    wardrobe: Wardrobe,
    *,
    inserted: Sequence[Placed] = (),
    known: Known | None = None,
    jitter: torch.Generator | None = None,
) -> Rendered:
    """What each ray sees.

    Args:
        rays: Of one frame or several.
        fields: Of the scene's objects.
        grids: What their networks make.
        states: What moves.
        wardrobe: Dresses samples.
        inserted: Meshes that are no objects of the scene.
        known: What is at hand of the rays already.
        jitter: Draws where in its interval each sample lies; in the middle without.
    """
    known = known or Known()
    behind = background(rays, fields, wardrobe) if known.behind is None else known.behind
    parts: list[_Part] = []
    veils = fields.veils
    for number, each in enumerate(fields.scene.objects):
        some = known.near.get(each.name)
        if each.name in veils:
            parts.append(_veiled(number, rays, some, behind.depth, fields, wardrobe))
            continue
        with _exactly(rays):
            marched = _marched(each, rays if some is None else rays[some], fields, grids, states, jitter)
        if marched is not None:
            parts.append(_Part(thing=number, marched=_in_front(marched, some, behind.depth)))
    objects = len(fields.scene.objects)
    for number, each in enumerate(inserted, objects):
        own = rays if each.near is None else rays[each.near]
        with _exactly(rays):
            marched = march_mesh(own, each.mesh, each.placement, count=each.mesh.intervals)
        parts.append(_Part(thing=number, marched=_in_front(marched, each.near, behind.depth)))
    shares = rays.direction.new_zeros(len(rays), objects + len(inserted))
    looked_at = sum(part.marched.looked_at for part in parts)
    if not sum(len(part.marched.samples) for part in parts):
        return Rendered(
            features=behind.features,
            depth=behind.depth,
            shares=_with_background(shares[:, :objects], torch.ones_like(behind.depth), behind),
            inserted=shares[:, objects:].sum(dim=1) if inserted else None,
            looked_at=looked_at,
            dressed=0,
        )
    samples, part = joined_samples([each.marched.samples for each in parts])
    optical = torch.cat([each.marched.optical for each in parts])
    order = along_rays(samples)
    weights = torch.empty_like(optical).index_put((order,), weights_of(samples.ray[order], optical[order]))
    passed = torch.exp(-summed(samples.ray, optical, len(rays)))
    features = behind.features * passed[:, None]
    dressed = 0
    for place, each in enumerate(parts):
        number, marched = each.thing, each.marched
        own = torch.nonzero(part == place)[:, 0]
        kept = torch.nonzero(weights[own].detach() > FAINT)[:, 0]
        chosen = own[kept]
        ray, weight = samples.ray[chosen], weights[chosen]
        if each.worn is not None:
            worn = each.worn[kept]
        elif number < objects:
            worn = wardrobe.wear(number, marched.rows[kept], marched.shares[kept], rays.frame[ray]).to(features.dtype)
        else:
            worn = _coloured(inserted[number - objects], features)
        features = features.index_add(0, ray, weight[:, None] * worn)
        shares = shares.index_put((samples.ray[own], torch.full_like(own, number)), weights[own], accumulate=True)
        dressed += len(kept)
    there = torch.isfinite(behind.depth)
    depth = summed(samples.ray, weights * samples.depth, len(rays)) + passed * torch.where(there, behind.depth, 0.0)
    return Rendered(
        features=features,
        depth=torch.where(there | (passed < FAINT), depth, torch.inf),
        shares=_with_background(shares[:, :objects], passed, behind),
        inserted=shares[:, objects:].sum(dim=1) if inserted else None,
        looked_at=looked_at,
        dressed=dressed,
    )


def _exactly(rays: Rays) -> torch.autocast:
    """Places are found with all digits, wherever networks are computed with fewer."""
    return torch.autocast(rays.direction.device.type, enabled=False)


def _marched(
    thing: SceneObject, rays: Rays, fields: Fields, grids: Grids, states: States, jitter: torch.Generator | None
) -> Marched | None:
    """Samples of the rays in a volume; None of what is no volume."""
    name, key = thing.name, fields.key_of[thing.name]
    wanted = fields.options.world_samples if name in fields.worlds else fields.options.samples
    count = min(wanted, thing.samples_per_ray)
    if name in states.poses:
        drawn = _drawn(rays, count, jitter)
        return fields.body(key).march(rays, states.poses[name], grids.bodies[key], count=count, jitter=drawn)
    if name in fields.worlds:
        return fields.world(name).march(rays, grids.worlds[name], count=count, jitter=_drawn(rays, count, jitter))
    if name in fields.balls and states.balls is not None:
        share, depth = ball_shares(rays, states.balls)
        own = torch.nonzero(share > 0)[:, 0]
        nowhere = torch.zeros_like(own)[:, None]
        samples = Samples(ray=own, depth=depth[own], length=torch.zeros_like(depth[own]))
        return Marched(
            samples=samples,
            optical=optical_of_share(share[own]),
            rows=nowhere,
            shares=torch.ones_like(samples.depth)[:, None],
            looked_at=len(own),
        )
    return None


def _veiled(
    number: int,
    rays: Rays,
    some: Int[Tensor, " some"] | None,
    hidden_from: Float[Tensor, " rays"],
    fields: Fields,
    wardrobe: Wardrobe,
) -> _Part:
    """Where the rays, or only some of them, meet a veil before they end, and what it looks like there."""
    with _exactly(rays):
        met = fields.surface(fields.scene.objects[number].name).meet(rays if some is None else rays[some])
    own = torch.nonzero(met.depth < (hidden_from if some is None else hidden_from[some]))[:, 0]
    ray = own if some is None else some[own]
    rows, shares, depth = met.rows[own], met.shares[own], met.depth[own]
    worn, optical = parted_veil(wardrobe.wear(number, rows, shares, rays.frame[ray]).to(depth.dtype))
    samples = Samples(ray=ray, depth=depth, length=torch.zeros_like(depth))
    marched = Marched(samples=samples, optical=optical, rows=rows, shares=shares, looked_at=len(own))
    return _Part(thing=number, marched=marched, worn=worn)


def _drawn(rays: Rays, count: int, jitter: torch.Generator | None) -> Tensor | None:
    if jitter is None:
        return None
    return torch.rand(len(rays), count, generator=jitter, device=jitter.device).to(rays.direction.device)


def _in_front(marched: Marched, some: Int[Tensor, " some"] | None, depth: Float[Tensor, " rays"]) -> Marched:
    """Those samples that no surface hides, of all rays, where only some of them were followed."""
    ray = marched.samples.ray if some is None else some[marched.samples.ray]
    kept = torch.nonzero(marched.samples.depth < depth[ray])[:, 0]
    own = marched.samples[kept]
    return Marched(
        samples=Samples(ray=ray[kept], depth=own.depth, length=own.length),
        optical=marched.optical[kept],
        rows=marched.rows[kept],
        shares=marched.shares[kept],
        looked_at=marched.looked_at,
    )


def _coloured(placed: Placed, features: Float[Tensor, "rays features"]) -> Float[Tensor, "1 features"]:
    """What a mesh looks like: its colour, and nothing for the enhancer."""
    colour = placed.mesh.colour.to(features.dtype)
    return torch.nn.functional.pad(colour, (0, features.shape[1] - colour.shape[1]))


def _with_background(
    shares: Float[Tensor, "rays objects"], passed: Float[Tensor, " rays"], behind: Background
) -> Float[Tensor, "rays objects"]:
    """The shares with those of surfaces."""
    own = torch.nonzero(behind.thing >= 0)[:, 0]
    return shares.index_put((own, behind.thing[own]), passed[own], accumulate=True)
