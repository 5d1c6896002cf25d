"""A small network that finds a ball in the middle one of three frames: where, and how surely."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from pgm_data.detect.ball.network import CHANNELS
from pgm_models.detectors.heatmap_net import ConvNorm, Residual, Up

RARE = -5.0
"""Logit of a ball in fresh weights: nearly all cells hold none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallNetOptions:
    """Widths and depths of `BallNet`."""

    widths: tuple[int, int, int, int] = (32, 32, 64, 16)
    """Channels at strides 4, 8 and 16 on the way down, and at stride 4 on the way up."""
    depths: tuple[int, int] = (1, 2)
    """Residual blocks at strides 8 and 16."""


BALL_PRESETS: dict[str, BallNetOptions] = {
    "nano": BallNetOptions(widths=(16, 16, 16, 16), depths=(1, 1)),
    "small": BallNetOptions(),
}
BallPreset = Literal["nano", "small"]


class BallNet(nn.Module):
    """Answers (`CHANNELS`) per cell of 4 x 4 pixels, from three frames of brightness and the middle one's colour.

    Height and width are multiples of 16. What differs from the frame before and from the one after is computed first:
    a moving ball differs from both.
    """

    def __init__(self, options: BallNetOptions) -> None:
        """Fresh weights that see no ball anywhere."""
        super().__init__()
        fine, s8, s16, out = options.widths
        down8, down16 = options.depths
        self.stem = ConvNorm(4 * 5 + 2, fine, stride=2)
        self.down8 = nn.Sequential(ConvNorm(fine, s8, stride=2), *(Residual(s8) for _ in range(down8)))
        self.down16 = nn.Sequential(ConvNorm(s8, s16, stride=2), *(Residual(s16) for _ in range(down16)))
        self.up8 = Up(s16, s8)
        self.skip = nn.Conv2d(fine, out, 1)
        self.up4 = Up(s8, out)
        self.head = nn.Conv2d(out, len(CHANNELS), 1)
        nn.init.zeros_(self.head.weight)
        said = torch.zeros(len(CHANNELS))
        said[0] = RARE
        self.head.bias = nn.Parameter(said)

    def forward(
        self, grey: UInt8[Tensor, "batch 3 height width"], colour: UInt8[Tensor, "batch 2 half_height half_width"]
    ) -> Float[Tensor, "batch channels rows columns"]:
        """The answers, from brightness before, in and after the frame and the frame's two colour differences."""
        return self.head(self.features(grey, colour))

    def features(
        self, grey: UInt8[Tensor, "batch 3 height width"], colour: UInt8[Tensor, "batch 2 half_height half_width"]
    ) -> Float[Tensor, "batch out rows columns"]:
        """What the answers are read from."""
        before, now, after = (quarters(grey[:, k : k + 1]).float() for k in range(3))
        rise, fall = now - before, now - after
        passing = torch.minimum(rise, fall).relu() - torch.maximum(rise, fall).neg().relu()
        planes = [now / 64 - 2, rise / 16, fall / 16, passing / 16, (before - after) / 16, colour.float() / 16 - 8]
        x4 = self.stem(torch.cat(planes, dim=1))
        x8 = self.down8(x4)
        x8 = self.up8(self.down16(x8), x8)
        return self.up4(x8, self.skip(x4))


def quarters(plane: UInt8[Tensor, "batch 1 height width"]) -> UInt8[Tensor, "batch 4 half_height half_width"]:
    """The plane's pixels as four planes of half its size, as `pixel_unshuffle` gives them.

    Written so that nothing in it depends on the size: the exported network then takes any.
    """
    return torch.cat([plane[:, :, row::2, column::2] for row in range(2) for column in range(2)], dim=1)
