"""A small U-shaped network that says where each known point of a court is, and where lines are painted."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F


@dataclass(frozen=True, eq=False, kw_only=True)
class HeatmapNetOptions:
    """Widths and depths of `HeatmapNet`."""

    widths: tuple[int, int, int, int, int] = (16, 24, 48, 80, 112)
    """Channels at strides 2, 4, 8, 16 and 32."""
    depths: tuple[int, int, int] = (1, 2, 2)
    """Residual blocks on the way down at strides 8, 16 and 32."""


PRESETS: dict[str, HeatmapNetOptions] = {
    "nano": HeatmapNetOptions(widths=(8, 16, 16, 24, 32), depths=(1, 1, 1)),
    "tiny": HeatmapNetOptions(widths=(12, 20, 32, 56, 80), depths=(1, 1, 2)),
    "small": HeatmapNetOptions(),
}
Preset = Literal["nano", "tiny", "small"]


class HeatmapNet(nn.Module):
    """Logits of points and lines at a quarter of the picture's size, from an RGB picture in 0..1.

    The picture's height and width are multiples of 32. Point channel k and entry k of `absent` are the logits of
    one distribution: the point is in one of the cells, or nowhere in the picture.
    """

    def __init__(self, points: int, options: HeatmapNetOptions) -> None:
        """Fresh weights for that many points; `absent` starts as likely as all cells together."""
        super().__init__()
        s2, s4, s8, s16, s32 = options.widths
        down8, down16, down32 = options.depths
        self.stem = nn.Sequential(ConvNorm(3, s2, stride=2), ConvNorm(s2, s4, stride=2))
        self.down8 = nn.Sequential(ConvNorm(s4, s8, stride=2), *(Residual(s8) for _ in range(down8)))
        self.down16 = nn.Sequential(ConvNorm(s8, s16, stride=2), *(Residual(s16) for _ in range(down16)))
        self.down32 = nn.Sequential(ConvNorm(s16, s32, stride=2), *(Residual(s32) for _ in range(down32)))
        self.up16 = Up(s32, s16)
        self.up8 = Up(s16, s8)
        self.up4 = Up(s8, s4)
        self.heads = nn.Conv2d(s4, points + 1, 1)
        self.absent = nn.Linear(s32, points)
        nn.init.constant_(self.absent.bias, 9.0)

    def forward(
        self, picture: Float[Tensor, "batch 3 height width"]
    ) -> tuple[
        Float[Tensor, "batch points rows columns"], Float[Tensor, "batch points"], Float[Tensor, "batch rows columns"]
    ]:
        """Logits of points per cell, of their absence, and of painted line per cell."""
        return self.read(*self.features(picture))

    def features(
        self, picture: Float[Tensor, "batch 3 height width"]
    ) -> tuple[Float[Tensor, "batch fine rows columns"], Float[Tensor, "batch coarse"]]:
        """Features per cell and of the whole picture."""
        x4 = self.stem(picture * 4.0 - 2.0)
        x8 = self.down8(x4)
        x16 = self.down16(x8)
        x32 = self.down32(x16)
        return self.up4(self.up8(self.up16(x32, x16), x8), x4), x32.mean(dim=(2, 3))

    def read(
        self, features: Float[Tensor, "batch fine rows columns"], whole: Float[Tensor, "batch coarse"]
    ) -> tuple[
        Float[Tensor, "batch points rows columns"], Float[Tensor, "batch points"], Float[Tensor, "batch rows columns"]
    ]:
        """Logits from features."""
        maps = self.heads(features)
        return maps[:, :-1], self.absent(whole), maps[:, -1]


class ConvNorm(nn.Sequential):
    """3x3 convolution, batch norm, ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1) -> None:
        """A layer with fresh weights."""
        super().__init__(
            nn.Conv2d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        )


class Residual(nn.Module):
    """Two 3x3 convolutions around which the input is added."""

    def __init__(self, width: int) -> None:
        """A block that starts as the identity."""
        super().__init__()
        self.first = ConvNorm(width, width)
        self.second = nn.Conv2d(width, width, 3, padding=1, bias=False)
        norm = nn.BatchNorm2d(width)
        nn.init.zeros_(norm.weight)
        self.norm: nn.Module = norm

    def forward(self, x: Tensor) -> Tensor:
        """The block's output, of the input's shape."""
        return F.relu(x + self.norm(self.second(self.first(x))))


class Up(nn.Module):
    """Coarse features doubled in size, joined with the fine ones of the way down."""

    def __init__(self, coarse: int, fine: int) -> None:
        """A layer with fresh weights."""
        super().__init__()
        self.narrow = nn.Conv2d(coarse, fine, 1, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(fine)
        self.mix = ConvNorm(fine, fine)

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """Features at the fine size."""
        wide = F.interpolate(self.norm(self.narrow(coarse)), scale_factor=2.0, mode="bilinear", align_corners=False)
        return self.mix(wide + fine)


def multiply_adds(net: nn.Module, *inputs: Tensor) -> int:
    """Multiply-accumulates of the convolutions and linear layers for those inputs, a batch of one each."""
    total = 0

    def count(layer: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
        nonlocal total
        weights = sum(p.numel() for p in layer.parameters() if p.ndim > 1)
        total += weights * (output.numel() // output.shape[1])

    hooks = [m.register_forward_hook(count) for m in net.modules() if isinstance(m, nn.Conv2d | nn.Linear)]
    was_training = net.training
    net.eval()
    with torch.no_grad():
        net(*inputs)
    net.train(was_training)
    for hook in hooks:
        hook.remove()
    return total
