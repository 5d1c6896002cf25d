"""The ball: a disc of one feature, blurred by its flight while the shutter was open, in closed form."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pgm_models.synthesis.boxes import NEAREST_M, Boxes
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import OPAQUE

SLICES = 48
"""Lines along the ball's path by which its share of a pixel is summed; along each the sum is exact."""
PIXELS_AT_ONCE = 1 << 14
"""Upper bound, which keeps the memory of a picture that a ball fills small."""
STILL_M = 1e-6
"""A ball that moves less while the shutter is open stands still."""
TINY = 1e-12
"""Metres by which a side of a pixel leaves the path's direction, at the least."""
SOLID = 1e4
"""Density inside a ball that stands still, 1/m: what the paper's form of the blur multiplies."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Balls:
    """One ball a frame."""

    position: Float[Tensor, "frames 3"]
    """In the middle of the exposure, world metres; NaN where the frame has none."""
    path: Float[Tensor, "frames 3"]
    """From where it was when the shutter opened to where it was when it closed, metres."""
    radius: float
    """Metres."""

    @property
    def present(self) -> Bool[Tensor, " frames"]:
        """Whether the frame has a ball."""
        return torch.isfinite(self.position).all(dim=1)


def ball_boxes(balls: Balls) -> Boxes:
    """Boxes that the balls do not leave while the shutter is open."""
    reach = 0.5 * balls.path.abs() + balls.radius
    return Boxes(low=balls.position - reach, high=balls.position + reach)


def ball_shares(rays: Rays, balls: Balls) -> tuple[Float[Tensor, " rays"], Float[Tensor, " rays"]]:
    """How much of each ray's pixel the ball of its frame fills while the shutter is open, and how far away it is.

    The mean over the pixel and over the time, for a ball that flies straight and even; of a ball however small, all
    pixels together keep its area. Depth is inf where the share is 0.
    """
    offset = (balls.position[rays.frame] - rays.origin).double()
    direction = rays.direction.double()
    depth = (offset * direction).sum(dim=1)
    share = torch.zeros_like(depth)
    for some in torch.nonzero(depth > NEAREST_M)[:, 0].split(PIXELS_AT_ONCE):
        own, away = rays[some], depth[some, None]
        crossed = CrossedPixels(
            right=away * own.across.double(),
            down=away * own.down.double(),
            ball=offset[some] - away * direction[some],
            path=_across(balls.path[own.frame].double(), direction[some]),
        )
        near = torch.nonzero(_may_cover(crossed, balls.radius))[:, 0]
        crossed = CrossedPixels(**{name: values[near] for name, values in vars(crossed).items()})
        share[some[near]] = covered_share(crossed, direction[some[near]], balls.radius)
    dtype = rays.direction.dtype
    return share.to(dtype), torch.where(share > 0, depth, torch.inf).to(dtype)


def _across(vectors: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays 3"]:
    """Vectors without what of them is along the rays."""
    return vectors - (vectors * direction).sum(dim=1, keepdim=True) * direction


@dataclass(frozen=True, eq=False, kw_only=True)
class CrossedPixels:
    """Pixels and the ball in planes across their rays at the ball's distance, metres from each ray."""

    right: Float[Tensor, "pixels 3"]
    """A pixel's extent along its row."""
    down: Float[Tensor, "pixels 3"]
    """The same along its column."""
    ball: Float[Tensor, "pixels 3"]
    """Middle of the ball in the middle of the exposure."""
    path: Float[Tensor, "pixels 3"]
    """How far it moves during the exposure."""


def _may_cover(crossed: CrossedPixels, radius: float) -> Bool[Tensor, " pixels"]:
    """Whether the ball comes closer to the pixel's ray than both reach."""
    squared = crossed.path.square().sum(dim=1, keepdim=True)
    along = (crossed.ball * crossed.path).sum(dim=1, keepdim=True) / torch.where(squared > 0, squared, 1.0)
    nearest = crossed.ball - along.clamp(-0.5, 0.5) * crossed.path
    reach = radius + 0.5 * (crossed.right.norm(dim=1) + crossed.down.norm(dim=1))
    return nearest.norm(dim=1) < reach


def covered_share(
    crossed: CrossedPixels, direction: Float[Tensor, "pixels 3"], radius: float
) -> Float[Tensor, " pixels"]:
    """Mean over each pixel and the time of whether the ball's disc covers it, 0 to 1.

    As in Cook 1984, distributed ray tracing, but along lines in the direction of the path summed exactly over place and
    time; the lines are spread evenly over the angle at which they cut the disc.
    """
    length = crossed.path.norm(dim=1)
    still = length < STILL_M
    onward = torch.where(still[:, None], crossed.right, crossed.path)
    onward = onward / onward.norm(dim=1, keepdim=True)
    aside = torch.linalg.cross(direction, onward)
    # Of both, what is aside of the path (x) and along it (y).
    right_x, down_x, ball_x = ((each * aside).sum(dim=1, keepdim=True) for each in _parts(crossed))
    right_y, down_y, ball_y = ((each * onward).sum(dim=1, keepdim=True) for each in _parts(crossed))
    area = right_x * down_y - right_y * down_x
    reach = 0.5 * (right_x.abs() + down_x.abs())
    low, high = (((end - ball_x) / radius).clamp(-1.0, 1.0).asin() for end in (-reach, reach))
    places = (torch.arange(SLICES, device=area.device) + 0.5) / SLICES
    angle = low + (high - low) * places
    x, half = ball_x + radius * angle.sin(), radius * angle.cos()
    sides = [_between(x * down_y, area, down_x), _between(-x * right_y, area, -right_x)]
    begins, ends = torch.maximum(sides[0][0], sides[1][0]), torch.minimum(sides[0][1], sides[1][1])
    half_path = torch.where(still, 0.0, 0.5 * length)[:, None]
    held = (half * _mean_overlap(begins - ball_y, ends - ball_y, half, half_path)).mean(dim=1)
    share = held * ((high - low) / area.abs())[:, 0]
    return torch.where(torch.isfinite(share), share, 0.0).clamp(0.0, 1.0)


def _parts(crossed: CrossedPixels) -> tuple[Tensor, Tensor, Tensor]:
    return crossed.right, crossed.down, crossed.ball


def _between(
    middle: Float[Tensor, "*#pixels"], area: Float[Tensor, "*#pixels"], slope: Float[Tensor, "*#pixels"]
) -> tuple[Tensor, Tensor]:
    """Where a line enters and leaves the strip between two opposite sides of a parallelogram."""
    slope = torch.where(slope.abs() > TINY, slope, TINY)
    one, other = (middle - 0.5 * area) / slope, (middle + 0.5 * area) / slope
    return torch.minimum(one, other), torch.maximum(one, other)


def _mean_overlap(
    begins: Float[Tensor, "*#pixels"],
    ends: Float[Tensor, "*#pixels"],
    half: Float[Tensor, "*#pixels"],
    half_path: Float[Tensor, "*#pixels"],
) -> Tensor:
    """Mean length that an interval has in common with one of half length `half` that moves evenly.

    Its middle goes from -half_path to half_path. The integral of what they share is a sum of squares; it is taken only
    while they touch, so that neither a path without end nor none loses digits.
    """
    overlap = (torch.minimum(ends, half) - torch.maximum(begins, -half)).clamp(min=0.0)
    first, last = torch.maximum(-half_path, begins - half), torch.minimum(half_path, ends + half)

    def until(middle: Tensor) -> Tensor:
        ramps = ((middle + half - begins, 1.0), (middle + half - ends, -1.0), (middle - half - begins, -1.0))
        return sum((0.5 * sign * ramp.clamp(min=0.0).square() for ramp, sign in ramps), torch.zeros_like(middle))

    moved = torch.where(last > first, until(last) - until(first), 0.0) / torch.where(half_path > 0, 2 * half_path, 1.0)
    return torch.where(ends > begins, torch.where(half_path > 0, moved, overlap), 0.0)


def blur_share(points: Float[Tensor, "points 3"], path: Float[Tensor, " 3"], radius: float) -> Float[Tensor, " points"]:
    """The paper's p: the share of the time in which the ball holds a point, given from its middle, metres.

    Source: Menapace et al. 2023, appendix B.1. The limit of no movement is whether the point is inside.
    """
    distance = float(path.norm())
    if distance < STILL_M:
        return (points.norm(dim=1) <= radius).to(points.dtype)
    onward = path / distance
    y = points @ onward
    aside = (points - y[:, None] * onward).square().sum(dim=1)
    chord = 2 * (radius**2 - aside).clamp(min=0.0).sqrt()
    share = torch.minimum((chord / distance).clamp(max=1.0), 0.5 + (0.5 * chord - y.abs()) / distance)
    return torch.where(chord > 0, share.clamp(min=0.0), 0.0)


def optical_of_share(share: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Optical depth of what hides that share of what is behind it."""
    return (-torch.log1p(-share.clamp(max=1.0 - 1e-12))).clamp(max=OPAQUE)
