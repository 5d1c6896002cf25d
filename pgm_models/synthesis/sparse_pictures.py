"""Pictures of which one ray in 4 x 4 pixels is followed, and a network that makes the rest of them.

How Playable Environments renders, which the paper compares with. The ray is that of one of the middle pixels, and no
wider than it, so that what is small may lie between rays.
"""

from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.synthesis.renderer import Rendered
from pgm_models.synthesis.stylists import COLOURS

DOUBLINGS = 2
CELL_PX = 2**DOUBLINGS
"""Pixels for a ray, along each axis."""
FOLLOWED = 1
"""Of a cell's pixels along an axis, the one whose ray is followed; the last one where a picture ends before."""


def followed_pixels(height: int, width: int, device: torch.device | str = "cpu") -> Int[Tensor, " cells"]:
    """The pixels whose rays are followed, row by row, by their number in the picture."""
    rows, columns = (_along(side, device) for side in (height, width))
    return (rows[:, None] * width + columns).flatten()


def cell_of_pixels(height: int, width: int, device: torch.device | str = "cpu") -> Int[Tensor, " pixels"]:
    """The cell that each pixel of a picture belongs to, as `followed_pixels` counts them."""
    rows, columns = (torch.arange(side, device=device) // CELL_PX for side in (height, width))
    return (rows[:, None] * -(-width // CELL_PX) + columns).flatten()


def near_cells(pixels: Int[Tensor, " some"], followed: Int[Tensor, " cells"]) -> Int[Tensor, " found"]:
    """Those of the followed pixels that are among some, by cell; both in ascending order."""
    return torch.nonzero(torch.isin(followed, pixels, assume_unique=True))[:, 0]


def spread(seen: Rendered, cell: Int[Tensor, " pixels"]) -> Rendered:
    """What the ray of each pixel's cell sees."""
    inserted = None if seen.inserted is None else seen.inserted[cell]
    return replace(
        seen, features=seen.features[cell], depth=seen.depth[cell], shares=seen.shares[cell], inserted=inserted
    )


def _along(side: int, device: torch.device | str) -> Int[Tensor, " cells"]:
    first = torch.arange(0, side, CELL_PX, device=device)
    return (first + FOLLOWED).clamp(max=side - 1)


class Upsampler(nn.Module):
    """Full pictures of the features of the pixels that are followed, whatever is known of others.

    Source: Menapace et al. 2022, Playable Environments: convolutions and doublings; their sizes are ours.
    """

    def __init__(self, features: int, *, width: int) -> None:
        """For that many features of a pixel; `width` channels at the full size, twice as many at half of it."""
        super().__init__()
        widths = [width * 2**doubled for doubled in range(DOUBLINGS, -1, -1)]
        self.inward = nn.Conv2d(features, widths[0], 3, padding=1)
        self.mixes = nn.ModuleList(
            nn.Conv2d(before, after, 3, padding=1) for before, after in zip([widths[0], *widths], widths, strict=False)
        )
        self.outward = nn.Conv2d(width, COLOURS, 3, padding=1)

    def forward(self, features: Float[Tensor, "B features H W"]) -> Float[Tensor, "B 3 H W"]:
        """The pictures, 0 to 1."""
        height, width = features.shape[2:]
        rows, columns = (_along(side, features.device) for side in (height, width))
        here = functional.relu(self.inward(features[:, :, rows][:, :, :, columns]))
        for number, mix in enumerate(self.mixes):
            if number:
                here = functional.interpolate(here, scale_factor=2.0, mode="nearest")
            here = functional.relu(mix(here))
        return torch.sigmoid(self.outward(here))[:, :, :height, :width]
