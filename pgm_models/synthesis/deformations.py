"""From points of the world to those of a body in its rest pose, by a network that is told the pose as a code.

What the paper compares its skinning with: the body's root takes a point to the rest pose as if all of it were rigid,
and the network says how far from there the point belongs. Nothing ties that to limbs.

Source: Menapace et al. 2023, section 5.2.2; Tretschk et al. 2021, Non-Rigid Neural Radiance Fields, section 3.1.
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pgm_data.skeleton import Skeleton
from pgm_models.synthesis.place_networks import PlaceNetwork
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples
from pgm_models.synthesis.skinning import (
    LIMB_RADIUS_M,
    MARGIN_M,
    REACH,
    REACH_SHARE,
    Poses,
    limbs_of,
    rest_joints,
)

CODE = 32
"""Numbers of a pose's code."""
WAVES = 4
"""Frequencies of a place: what a pose does to a body is smooth."""


class PoseNetwork(nn.Module):
    """How the points of a body move with its pose, learned without its kinematic tree."""

    low: Tensor
    high: Tensor
    reach: Tensor

    def __init__(self, skeleton: Skeleton, *, width: int) -> None:
        """A network that moves nothing until it is trained; `width` as of `PlaceNetwork`."""
        super().__init__()
        rest = rest_joints(skeleton)
        low, high = rest.min(axis=0) - MARGIN_M, rest.max(axis=0) + MARGIN_M
        for name, value in (("low", low), ("high", high), ("reach", limb_boxes(skeleton, low, high))):
            self.register_buffer(name, torch.as_tensor(value, dtype=torch.float32), persistent=False)
        self.code = nn.Sequential(nn.Linear(12 * len(rest), 2 * CODE), nn.SiLU(), nn.Linear(2 * CODE, CODE))
        self.offset = PlaceNetwork(3, 3, width=width, waves=WAVES, told=CODE)
        for parameter in self.offset.out.parameters():
            nn.init.zeros_(parameter)

    def places(self, points_rest: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Points of the rest pose as places in the volume, 0 to 1 inside."""
        return (points_rest - self.low) / (self.high - self.low)

    def to_rest(
        self, points_world: Float[Tensor, "points 3"], poses: Poses, frame: int
    ) -> tuple[Int[Tensor, " kept"], Float[Tensor, "kept 3"]]:
        """Which points are in the volume of a frame's body, and where they lie in the rest pose, metres."""
        rigid = points_world @ poses.rotation[frame, 0].T + poses.translation[frame, 0]
        code = self.code(joint_turns(poses, frame).flatten())
        rest = rigid + self.offset(self.places(rigid), code)
        places = self.places(rest.detach())
        kept = torch.nonzero(((places >= 0) & (places <= 1)).all(dim=1))[:, 0]
        return kept, rest[kept]

    def rested_samples(
        self, rays: Rays, samples: Samples, poses: Poses, frame: int
    ) -> tuple[Int[Tensor, " kept"], Float[Tensor, "kept 3"]]:
        """The same for samples of a frame's rays."""
        along = samples.depth[:, None] * rays.direction[samples.ray]
        return self.to_rest(rays.origin[samples.ray] + along, poses, frame)


def joint_turns(poses: Poses, frame: int) -> Float[Tensor, "joints 12"]:
    """How each joint of a frame's body is turned (9) and moved (3) against its root: 0 in the rest pose.

    Neither the place nor the size of the body counts, nor where it looks.
    """
    R, t = poses.rotation[frame], poses.translation[frame]
    rest_from_root = R @ R[0].T / poses.scale[frame].square()  # of a point that the root has taken to the rest pose
    moved = t - (rest_from_root @ t[0, :, None])[..., 0]
    turned = rest_from_root - torch.eye(3, device=R.device)
    return torch.cat([turned.flatten(1), moved], dim=1)


def limb_boxes(
    skeleton: Skeleton, low: Float[np.ndarray, " 3"], high: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "joints 2 3"]:
    """Boxes of the rest pose beyond which nothing belongs to each joint, within a body's volume; inf for none.

    As far round each limb as the prior of skinning reaches.
    """
    owner, ends = limbs_of(skeleton)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    reach = np.maximum(REACH * LIMB_RADIUS_M, REACH_SHARE * length)[:, None]
    boxes = np.stack([np.full((len(skeleton.parents), 3), far) for far in (np.inf, -np.inf)], axis=1)
    np.minimum.at(boxes[:, 0], owner, np.maximum(ends.min(axis=1) - reach, low))
    np.maximum.at(boxes[:, 1], owner, np.minimum(ends.max(axis=1) + reach, high))
    return boxes
