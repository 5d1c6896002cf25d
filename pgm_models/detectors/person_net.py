"""A small network that says where people of one size stand in strips of a picture, and which of them play."""

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn import functional as F

from pgm_data.detect.players.person_network import CHANNELS
from pgm_models.detectors.heatmap_net import ConvNorm, Residual, Up

RARE = -4.0
"""Logit of a person in a cell before anything is learned."""
WIDTHS = (20, 32, 40)
"""Channels at strides 4, 8 and 16."""
LOOKS = (24, 8)
"""Channels in which looks are compared, which tell who plays, and of what is kept of them."""


class PersonNet(nn.Module):
    """Answers (`CHANNELS`) at a quarter of the size of strips, whose rows and columns are multiples of 16."""

    def __init__(self) -> None:
        """Fresh weights that see nobody."""
        super().__init__()
        fine, s8, s16 = WIDTHS
        self.stem = ConvNorm(12, fine, stride=2)
        self.down8 = nn.Sequential(ConvNorm(fine, s8, stride=2), Residual(s8))
        self.down16 = nn.Sequential(ConvNorm(s8, s16, stride=2), Residual(s16))
        self.up8 = Up(s16, s8)
        self.up4 = Up(s8, fine)
        inner, kept = LOOKS
        self.looks = nn.Sequential(ConvNorm(s8, inner), ConvNorm(inner, inner), nn.Conv2d(inner, kept, 1))
        self.head = nn.Conv2d(fine + kept, len(CHANNELS), 1)
        nn.init.zeros_(self.head.weight)
        said = torch.zeros(len(CHANNELS))
        said[0] = RARE
        self.head.bias = nn.Parameter(said)

    def forward(self, strips: UInt8[Tensor, "strips rows columns 3"]) -> Float[Tensor, "strips channels high wide"]:
        """The answers, from strips in blue, green, red."""
        return self.head(self.features(strips))

    def features(self, strips: UInt8[Tensor, "strips rows columns 3"]) -> Float[Tensor, "strips fine high wide"]:
        """What the answers are read from."""
        planes = strips.permute(0, 3, 1, 2).float() / 64 - 2
        # Slices and not `pixel_unshuffle`: nothing then depends on the size, and the exported network takes any.
        parts = [planes[:, :, row::2, column::2] for row in range(2) for column in range(2)]
        x4 = self.stem(torch.cat(parts, dim=1))
        x8 = self.down8(x4)
        x8 = self.up8(self.down16(x8), x8)
        looks = F.interpolate(self.looks(x8), scale_factor=2.0, mode="bilinear", align_corners=False)
        return torch.cat([self.up4(x8, x4), looks], dim=1)
