"""From points of the world to those of a body in its rest pose, by inverse linear blend skinning.

x_rest = sum_j w_j(T_j x) T_j x / sum_k w_k(T_k x), where T_j takes a point from the world, as if it were fixed to
joint j, to where that joint is in the rest pose. Source: Weng et al. 2022, HumanNeRF, equations 4 and 5 (Menapace et
al. 2023, equations 7 and 8, whose denominator mixes its indices). The w_j are zero beyond a limb's reach, so that only
pairs of points and joints near each other are looked at, and what lies beyond all of them is empty exactly.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from pgm_data.skeleton import Skeleton, world_from_joints
from pgm_models.synthesis.boxes import Spans
from pgm_models.synthesis.grids import Grown, corners_of, first_corners, mixed, near_any
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples

TINY = 1e-6
"""Weights of a point that add up to less count as nothing."""
SLACK_M = 1e-2
"""How much farther limbs are looked for than they reach: more than rounding can take off."""
STILL = 1e-12
"""A ray that goes less far along an axis in a metre does not move along it."""
LIMB_RADIUS_M = 0.12
"""Standard deviation of the prior of a limb's weight about its bone."""
REACH = 2.0
"""Times that radius: where a limb ends, at the least, and where its prior is that of the background."""
REACH_SHARE = 0.8
"""Of its bone's length: where a limb ends that is long; the head of a figure of blocks is as wide as it is tall."""
MARGIN_M = 0.3
"""Of the box of a body beyond its joints; hair rises up to 0.28 m above that of the head."""
STUB_M = 0.25
"""How far a joint without children goes on, at the most."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Poses:
    """One body a frame."""

    rotation: Float[Tensor, "frames joints 3 3"]
    """Of T_j: rest_from_world with joint j fixed; NaN where the frame has no body."""
    translation: Float[Tensor, "frames joints 3"]
    """Of T_j, metres."""
    scale: Float[Tensor, " frames"]
    """Metres of the rest pose for a metre of the body."""
    joints: Float[Tensor, "frames joints 3"]
    """Joints in the world, metres."""

    @property
    def present(self) -> Bool[Tensor, " frames"]:
        """Whether the frame has a body."""
        return torch.isfinite(self.translation).all(dim=-1).all(dim=-1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Carried:
    """Points taken to the rest pose by one joint each, as if fixed to it; a point is there once for every joint."""

    point: Int[Tensor, " pairs"]
    """Which point it is."""
    joint: Int[Tensor, " pairs"]
    """Which joint takes it."""
    at: Float[Tensor, "pairs 3"]
    """Where to, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Weights:
    """Each joint's weights over the rest pose, ready to be looked up: one joint's cells after the other's."""

    table: Float[Tensor, "joint_cells 1"]
    held: Bool[Tensor, " joint_cells"]
    """Whether any cell around a point weighs, by the first of them."""


def poses_of(
    skeleton: Skeleton,
    rotations: Float[np.ndarray, "frames joints 3"],
    translations: Float[np.ndarray, "frames joints 3"],
) -> Poses:
    """Poses from a body's rows: axis-angles and translations of parent_from_joint, as tables have them.

    A body that is larger than the skeleton's rest pose is scaled by the length of all its bones together.
    """
    R, joints = world_from_joints(skeleton.parents, rotations, translations)
    rest = rest_joints(skeleton)
    bones = skeleton.parents >= 0
    own = np.linalg.norm(translations[:, bones], axis=-1).sum(axis=1)
    usual = np.linalg.norm(skeleton.rest_translations[bones], axis=-1).sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(own > 0, usual / own, 1.0) if bones.any() else np.ones(len(own))
    scale = np.where(np.isfinite(translations).all(axis=(1, 2)), scale, np.nan)
    rotation = scale[:, None, None, None] * np.swapaxes(R, -1, -2)
    translation = rest - (rotation @ joints[..., None])[..., 0]
    as_tensor = [torch.as_tensor(part, dtype=torch.float32) for part in (rotation, translation, scale, joints)]
    return Poses(rotation=as_tensor[0], translation=as_tensor[1], scale=as_tensor[2], joints=as_tensor[3])


def rest_joints(skeleton: Skeleton) -> Float[np.ndarray, "joints 3"]:
    """Joints in the rest pose, metres, the ground at height 0."""
    rest = np.array(skeleton.rest_translations)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            rest[joint] += rest[parent]
    return rest


def limbs_of(skeleton: Skeleton) -> tuple[Int[np.ndarray, " limbs"], Float[np.ndarray, "limbs 2 3"]]:
    """The joint that each limb moves with, and its two ends in the rest pose, metres.

    A joint moves the bones to its children. One without children moves a stub that goes on as far as its own bone
    did, at most `STUB_M`.
    """
    rest, parents = rest_joints(skeleton), skeleton.parents
    joints, ends = [], []
    for child, parent in enumerate(parents):
        if parent >= 0:
            joints.append(int(parent))
            ends.append([rest[parent], rest[child]])
        if child not in parents:
            bone = rest[child] - rest[parent] if parent >= 0 else np.zeros(3)
            length = float(np.linalg.norm(bone))
            stub = bone * min(1.0, STUB_M / length) if length > 0 else bone
            joints.append(child)
            ends.append([rest[child], rest[child] + stub])
    return np.array(joints, dtype=np.int64), np.array(ends)


def distance_to_limbs(
    points: Float[np.ndarray, "points 3"], ends: Float[np.ndarray, "limbs 2 3"]
) -> Float[np.ndarray, "points limbs"]:
    """Of each point to each limb's line, metres."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    squared = (along**2).sum(axis=1)
    offset = points[:, None] - start
    share = (offset * along).sum(axis=2) / np.where(squared > 0, squared, 1.0)
    nearest = offset - np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(nearest, axis=2)


class Skinning(nn.Module):
    """Learned weights of a skeleton's joints over its rest pose, about a prior of limbs."""

    low: Tensor
    high: Tensor
    prior: Tensor
    support: Tensor
    reach: Tensor

    def __init__(self, skeleton: Skeleton, size: tuple[int, int, int], *, width: int, seed: int) -> None:
        """Weights on a grid of that size; `width` and `seed` as of `Grown`."""
        super().__init__()
        self.skeleton, self.size = skeleton, size
        self.joints = len(skeleton.parents)
        rest = rest_joints(skeleton)
        low, high = rest.min(axis=0) - MARGIN_M, rest.max(axis=0) + MARGIN_M
        self.grown = Grown(size, self.joints + 1, width=width, seed=seed)
        nn.init.zeros_(self.grown.out.weight)
        assert self.grown.out.bias is not None
        nn.init.zeros_(self.grown.out.bias)
        cells = grid_places(low, high, size)
        owner, ends = limbs_of(skeleton)
        distance = distance_to_limbs(cells, ends)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        reach = np.maximum(REACH * LIMB_RADIUS_M, REACH_SHARE * length)
        logit = np.where(distance <= reach, -0.5 * (distance / LIMB_RADIUS_M) ** 2, -np.inf)
        logits = np.full((len(cells), self.joints), -np.inf)
        np.maximum.at(logits.T, owner, logit.T)
        background = np.full((len(cells), 1), -0.5 * REACH**2)
        self.register_buffer("low", torch.as_tensor(low, dtype=torch.float32))
        self.register_buffer("high", torch.as_tensor(high, dtype=torch.float32))
        prior = np.concatenate([logits, background], axis=1)
        self.register_buffer("prior", torch.as_tensor(prior, dtype=torch.float32), persistent=False)
        self.register_buffer("support", torch.as_tensor(np.isfinite(logits)))
        self.register_buffer("reach", torch.zeros(self.joints, 2, 3))
        self.confine(self.support)

    @torch.no_grad()
    def confine(self, support: Bool[Tensor, "cells joints"]) -> None:
        """Let joints weigh only in those cells, and nothing beyond the boxes round them."""
        self.support.copy_(support)
        places = torch.as_tensor(
            grid_places(self.low.cpu().numpy(), self.high.cpu().numpy(), self.size), dtype=torch.float32
        ).to(support.device)
        step = (self.high - self.low) / (torch.as_tensor(self.size, device=self.low.device) - 1).clamp(min=1)
        for joint in range(self.joints):
            own = places[support[:, joint]]
            if len(own):
                # Not beyond the grid, where there are no weights.
                self.reach[joint, 0] = torch.maximum(own.amin(dim=0) - step, self.low)
                self.reach[joint, 1] = torch.minimum(own.amax(dim=0) + step, self.high)
            else:
                self.reach[joint, 0], self.reach[joint, 1] = torch.inf, -torch.inf

    def forward(self) -> Float[Tensor, "cells joints"]:
        """Each joint's weight in each cell, 0 outside its support."""
        logits = self.grown() + self.prior.clamp(min=-1e4)
        return torch.softmax(logits, dim=1)[:, : self.joints] * self.support

    def places(self, points_rest: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Points of the rest pose as places in the grid, 0 to 1 inside."""
        return (points_rest - self.low) / (self.high - self.low)

    def weights_of(self, weights: Float[Tensor, "cells joints"]) -> Weights:
        """What `forward` gave, to be looked up."""
        held = near_any(weights.detach() > 0, self.size)
        return Weights(table=weights.T.reshape(-1, 1), held=held.T.flatten())

    def to_rest(
        self,
        points_world: Float[Tensor, "points 3"],
        poses: Poses,
        frame: int,
        weights: Float[Tensor, "cells joints"],
    ) -> tuple[Int[Tensor, " kept"], Float[Tensor, "kept 3"], Float[Tensor, " kept"]]:
        """Points near the body of a frame in its rest pose.

        Returns:
            Which points are within some joint's reach; where they lie in the rest pose, metres; and how far they
            belong to the body, 0 to 1.
        """
        looked_up = self.weights_of(weights)
        return self.blended(self.carried(points_world, poses, frame, looked_up), len(points_world), looked_up)

    def carried(self, points_world: Float[Tensor, "points 3"], poses: Poses, frame: int, weights: Weights) -> Carried:
        """The points by every joint that weighs where it takes them."""
        turned = points_world @ poses.rotation[frame].flatten(0, 1).T
        turned = turned.unflatten(1, (self.joints, 3)) + poses.translation[frame]
        near = ((turned >= self.reach[:, 0]) & (turned <= self.reach[:, 1])).all(dim=2)
        point, joint = torch.nonzero(near, as_tuple=True)
        return self._held(point, joint, turned[point, joint], weights)

    def carried_samples(
        self, rays: Rays, spans: Spans, samples: Samples, poses: Poses, frame: int, weights: Weights
    ) -> Carried:
        """The samples by every joint that weighs where it takes them; those of limbs that rays miss are not looked at.

        Args:
            rays: Of that frame.
            spans: Of all these rays, each met.
            samples: What `uniform_samples` makes of them.
            poses: Of bodies.
            frame: Whose body.
            weights: Of joints.
        """
        count = len(samples) // len(rays)
        # From a sample near the body, as a camera far away leaves few digits to differences.
        middle = samples.depth.view(-1, count)[:, count // 2]
        beyond = (samples.depth.view(-1, count) - middle[:, None]).flatten()
        at, along = rays.at(middle), rays.direction
        ray, joint = self._rays_near(at, along, poses, frame)
        rows, pick = poses.rotation[frame].transpose(0, 1).flatten(0, 1), joint * len(rays) + ray
        # From here on the three axes are rows, which is several times faster than columns.
        at_rest, along_rest = ((rows @ each.T).view(3, -1).index_select(1, pick) for each in (at, along))
        at_rest = at_rest + poses.translation[frame].T.index_select(1, joint)
        enters, leaves = _crossed(at_rest, along_rest, *(self.reach[:, end].T.index_select(1, joint) for end in (0, 1)))
        # Each sample lies somewhere in its interval: that of an end is looked at.
        edge, length = (spans.near - middle)[ray], samples.length.view(-1, count)[ray, 0]
        first, last = (((end - edge) / length).clamp(-1, count).floor().long() for end in (enters, leaves))
        first, last = first.clamp(min=0), last.clamp(max=count - 1)
        first = first + (beyond[ray * count + first.clamp(max=count - 1)] < enters)
        last = last - (beyond[ray * count + last.clamp(min=0)] > leaves).long()
        many = torch.where(leaves >= enters, last - first + 1, 0).clamp(min=0)
        crossing = torch.repeat_interleave(torch.arange(len(ray), device=ray.device), many)
        start = ray * count + first - (torch.cumsum(many, dim=0) - many)
        point = start.index_select(0, crossing) + torch.arange(len(crossing), device=ray.device)
        along_rest = along_rest.index_select(1, crossing) * beyond.index_select(0, point)
        carried = at_rest.index_select(1, crossing) + along_rest
        return self._held(point, joint.index_select(0, crossing), carried.T, weights)

    def _rays_near(
        self, at: Float[Tensor, "rays 3"], along: Float[Tensor, "rays 3"], poses: Poses, frame: int
    ) -> tuple[Int[Tensor, " pairs"], Int[Tensor, " pairs"]]:
        """Rays, and joints to the spheres about whose boxes they come; rays begin close to the body."""
        R, t, scale = poses.rotation[frame], poses.translation[frame], poses.scale[frame]
        middle = ((self.reach.mean(dim=1) - t)[:, None] @ R)[:, 0] / scale.square()
        radius = 0.5 * (self.reach[:, 1] - self.reach[:, 0]).norm(dim=1) / scale + SLACK_M
        root = poses.joints[frame, 0]
        offset, middle = at - root, middle - root
        squared = offset.square().sum(dim=1)[:, None] - 2 * offset @ middle.T + middle.square().sum(dim=1)
        forward = along @ middle.T - (along * offset).sum(dim=1)[:, None]
        ray, joint = torch.nonzero(squared - forward.square() < radius.square(), as_tuple=True)
        return ray, joint

    def _held(
        self, point: Int[Tensor, " pairs"], joint: Int[Tensor, " pairs"], at: Float[Tensor, "pairs 3"], weights: Weights
    ) -> Carried:
        """Those within the joints' boxes that have a cell about them which weighs."""
        kept = weights.held.take(first_corners(self.places(at), self.size) + joint * math.prod(self.size))
        kept = torch.nonzero(kept)[:, 0]
        return Carried(
            point=point.index_select(0, kept), joint=joint.index_select(0, kept), at=at.T.index_select(1, kept).T
        )

    def blended(
        self, carried: Carried, points: int, weights: Weights
    ) -> tuple[Int[Tensor, " kept"], Float[Tensor, "kept 3"], Float[Tensor, " kept"]]:
        """Points in the rest pose, of so many; as of `to_rest`."""
        rows, shares = corners_of(self.places(carried.at), self.size)
        weight = mixed(weights.table, rows + (carried.joint * math.prod(self.size))[:, None], shares).T
        sums = weight.new_zeros(4, points)
        sums = sums.index_add(1, carried.point, torch.cat([weight * carried.at.T, weight]))
        kept = torch.nonzero(sums[3].detach() > TINY)[:, 0]
        sums = sums.index_select(1, kept)
        return kept, (sums[:3] / sums[3]).T, sums[3].clamp(max=1.0)


def _crossed(
    at: Float[Tensor, "3 rays"],
    along: Float[Tensor, "3 rays"],
    low: Float[Tensor, "3 rays"],
    high: Float[Tensor, "3 rays"],
) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"]]:
    """Where lines enter boxes and leave them, each line its own; it leaves before it enters where it misses."""
    moving = torch.where(along.abs() > STILL, along, STILL)
    one, other = (low - at) / moving, (high - at) / moving
    return torch.minimum(one, other).amax(dim=0), torch.maximum(one, other).amin(dim=0)


def grid_places(
    low: Float[np.ndarray, " 3"], high: Float[np.ndarray, " 3"], size: tuple[int, int, int]
) -> Float[np.ndarray, "cells 3"]:
    """The places of a grid's cells: the first ones on the lower faces of the box, the last ones on the upper."""
    axes = [np.linspace(a, b, count) for a, b, count in zip(low, high, size, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
