"""The two networks by whose words FID and FVD compare samples of pictures and of videos, with weights a user gives.

FID takes the Inception v3 that TensorFlow published on 2015-12-05, as others have put it into tensors by the names of
the usual public layout (`Mixed_5b.branch1x1.conv.weight`): its poolings differ from those of later versions. FVD takes
I3D (an Inception of three dimensions) as trained on Kinetics-400, by the names `Mixed_3b.b0.conv3d.weight`. Colours are
0 to 1, channels first. How many pictures a figure rests on belongs to it: see `pgm_models.metrics.FrechetScore`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pgm_models.image_networks import MetricUnavailable, check_colours, fill, read_weights

FID_SIDE, FVD_SIDE = 299, 224
"""Pictures are resized to squares of so many pixels, as the published figures are computed: blur below that is lost."""
LEAST_FRAMES = 9
"""Of a clip for FVD."""
NORM_EPS = 1e-3
"""Of all batch norms here."""


@dataclass(frozen=True, kw_only=True)
class Conv:
    """A convolution with a batch norm and a rectifier."""

    name: str
    width: int
    """Channels it gives out."""
    kernel: tuple[int, int] = (1, 1)
    """High and wide, pixels."""
    stride: int = 1
    padded: bool = True
    """Whether a stride of 1 keeps the size; with a larger one nothing is ever padded."""


def conv(name: str, width: int, *kernel: int, stride: int = 1, padded: bool = True) -> Conv:
    """One of them; the kernel is a square if one side is given, one pixel if none."""
    high, wide = (1, 1) if not kernel else (kernel[0], kernel[-1])
    return Conv(name=name, width=width, kernel=(high, wide), stride=stride, padded=padded)


class NormedConv(nn.Module):
    """Convolution, batch norm and rectifier, by the names that public files use."""

    def __init__(self, channels: int, of: Conv) -> None:
        """With random weights."""
        super().__init__()
        keep = of.stride == 1 and of.padded
        padding = (of.kernel[0] // 2, of.kernel[1] // 2) if keep else (0, 0)
        self.conv = nn.Conv2d(channels, of.width, of.kernel, of.stride, padding, bias=False)
        self.bn = nn.BatchNorm2d(of.width, eps=NORM_EPS)

    def forward(self, x: Tensor) -> Tensor:
        """Features of the layer."""
        return F.relu(self.bn(self.conv(x)))


Branch = Sequence[Conv | tuple[Conv, Conv]]
"""Convolutions one after the other; a pair looks at the same and is joined."""


class Mixed(nn.Module):
    """Branches that look at the same features, joined."""

    def __init__(self, channels: int, branches: Sequence[Branch], pool: str, pooled: int = 0) -> None:
        """With random weights.

        Args:
            channels: Features coming in.
            branches: What looks at them.
            pool: `mean` of what is there, `max`, or `shrink` for a maximum with a stride of 2.
            pooled: Features of the last branch, which looks at the pooled ones; 0 to join them as they are.
        """
        super().__init__()
        self.pool = pool
        self.plan: list[list[tuple[str, ...]]] = []
        for branch in branches:
            width, names = channels, []
            for part in branch:
                pair = part if isinstance(part, tuple) else (part,)
                for one in pair:
                    self.add_module(one.name, NormedConv(width, one))
                names.append(tuple(one.name for one in pair))
                width = sum(one.width for one in pair)
            self.plan.append(names)
        if pooled:
            self.branch_pool = NormedConv(channels, conv("branch_pool", pooled))

    def forward(self, x: Tensor) -> Tensor:
        """All branches' features, side by side."""
        found = []
        for branch in self.plan:
            y = x
            for names in branch:
                y = torch.cat([self.get_submodule(name)(y) for name in names], dim=1)
            found.append(y)
        if self.pool == "shrink":
            return torch.cat([*found, F.max_pool2d(x, 3, 2)], dim=1)
        # The mean is of the pixels that are there; the last block's maximum is an error that FID is defined with.
        pooled = F.max_pool2d(x, 3, 1, 1) if self.pool == "max" else F.avg_pool2d(x, 3, 1, 1, count_include_pad=False)
        return torch.cat([*found, self.branch_pool(pooled)], dim=1)


def _block_a(channels: int, pooled: int) -> Mixed:
    five = [conv("branch5x5_1", 48), conv("branch5x5_2", 64, 5)]
    double = [conv("branch3x3dbl_1", 64), conv("branch3x3dbl_2", 96, 3), conv("branch3x3dbl_3", 96, 3)]
    return Mixed(channels, [[conv("branch1x1", 64)], five, double], "mean", pooled)


def _block_b(channels: int) -> Mixed:
    double = [conv("branch3x3dbl_1", 64), conv("branch3x3dbl_2", 96, 3), conv("branch3x3dbl_3", 96, 3, stride=2)]
    return Mixed(channels, [[conv("branch3x3", 384, 3, stride=2)], double], "shrink")


def _block_c(channels: int, inner: int) -> Mixed:
    seven = [conv("branch7x7_1", inner), conv("branch7x7_2", inner, 1, 7), conv("branch7x7_3", 192, 7, 1)]
    double = [
        conv("branch7x7dbl_1", inner),
        conv("branch7x7dbl_2", inner, 7, 1),
        conv("branch7x7dbl_3", inner, 1, 7),
        conv("branch7x7dbl_4", inner, 7, 1),
        conv("branch7x7dbl_5", 192, 1, 7),
    ]
    return Mixed(channels, [[conv("branch1x1", 192)], seven, double], "mean", 192)


def _block_d(channels: int) -> Mixed:
    three = [conv("branch3x3_1", 192), conv("branch3x3_2", 320, 3, stride=2)]
    seven = [
        conv("branch7x7x3_1", 192),
        conv("branch7x7x3_2", 192, 1, 7),
        conv("branch7x7x3_3", 192, 7, 1),
        conv("branch7x7x3_4", 192, 3, stride=2),
    ]
    return Mixed(channels, [three, seven], "shrink")


def _block_e(channels: int, pool: str) -> Mixed:
    three = [conv("branch3x3_1", 384), (conv("branch3x3_2a", 384, 1, 3), conv("branch3x3_2b", 384, 3, 1))]
    double = [
        conv("branch3x3dbl_1", 448),
        conv("branch3x3dbl_2", 384, 3),
        (conv("branch3x3dbl_3a", 384, 1, 3), conv("branch3x3dbl_3b", 384, 3, 1)),
    ]
    return Mixed(channels, [[conv("branch1x1", 320)], three, double], pool, 192)


class FidNetwork(nn.Module):
    """Inception v3 up to its last pooling, as FID is defined with.

    Source: Szegedy et al. 2016; Heusel et al. 2017.
    """

    def __init__(self) -> None:
        """With random weights: use `load_fid`."""
        super().__init__()
        self.origin = "random weights"
        self.Conv2d_1a_3x3 = NormedConv(3, conv("1a", 32, 3, stride=2))
        self.Conv2d_2a_3x3 = NormedConv(32, conv("2a", 32, 3, padded=False))
        self.Conv2d_2b_3x3 = NormedConv(32, conv("2b", 64, 3))
        self.Conv2d_3b_1x1 = NormedConv(64, conv("3b", 80))
        self.Conv2d_4a_3x3 = NormedConv(80, conv("4a", 192, 3, padded=False))
        self.Mixed_5b, self.Mixed_5c, self.Mixed_5d = _block_a(192, 32), _block_a(256, 64), _block_a(288, 64)
        self.Mixed_6a, self.Mixed_6b = _block_b(288), _block_c(768, 128)
        self.Mixed_6c, self.Mixed_6d, self.Mixed_6e = _block_c(768, 160), _block_c(768, 160), _block_c(768, 192)
        self.Mixed_7a, self.Mixed_7b, self.Mixed_7c = _block_d(768), _block_e(1280, "mean"), _block_e(2048, "max")

    def forward(self, pictures: Float[Tensor, "batch 3 height width"]) -> Float[Tensor, "batch 2048"]:
        """What the network says of each picture.

        Raises:
            ValueError: If a colour is not between 0 and 1.
        """
        check_colours(pictures, "FID: pictures")
        x = 2 * F.interpolate(pictures, (FID_SIDE, FID_SIDE), mode="bilinear", align_corners=False) - 1
        x = F.max_pool2d(self.Conv2d_2b_3x3(self.Conv2d_2a_3x3(self.Conv2d_1a_3x3(x))), 3, 2)
        x = F.max_pool2d(self.Conv2d_4a_3x3(self.Conv2d_3b_1x1(x)), 3, 2)
        for block in (self.Mixed_5b, self.Mixed_5c, self.Mixed_5d, self.Mixed_6a, self.Mixed_6b, self.Mixed_6c):
            x = block(x)
        for block in (self.Mixed_6d, self.Mixed_6e, self.Mixed_7a, self.Mixed_7b, self.Mixed_7c):
            x = block(x)
        return x.mean(dim=(2, 3))


class Unit3d(nn.Module):
    """A convolution of space and time that keeps size over stride, rounded up, as TensorFlow's "same" does."""

    def __init__(self, channels: int, width: int, side: int, stride: int = 1, *, normed: bool = True) -> None:
        """With random weights; the last layer has no norm and no rectifier, but an offset."""
        super().__init__()
        self.side, self.stride = side, stride
        self.conv3d = nn.Conv3d(channels, width, side, stride, bias=not normed)
        self.bn = nn.BatchNorm3d(width, eps=NORM_EPS) if normed else None

    def forward(self, x: Tensor) -> Tensor:
        """Features of the layer."""
        x = self.conv3d(same_padded(x, (self.side,) * 3, (self.stride,) * 3))
        return x if self.bn is None else F.relu(self.bn(x))


def same_padded(x: Tensor, sides: tuple[int, ...], strides: tuple[int, ...]) -> Tensor:
    """With zeros around, so that a window gives as many results as strides fit, rounded up; the odd zero comes last."""
    padding: list[int] = []
    for size, side, stride in reversed(list(zip(x.shape[2:], sides, strides, strict=True))):
        lacking = max(side - (size % stride or stride), 0)
        padding += [lacking // 2, lacking - lacking // 2]
    return F.pad(x, padding)


def same_pooled(x: Tensor, sides: tuple[int, int, int], strides: tuple[int, int, int]) -> Tensor:
    """The largest features of windows of time, height and width; never below 0."""
    return F.max_pool3d(same_padded(x, sides, strides), sides, strides)


class Mixed3d(nn.Module):
    """Four branches that look at the same features, joined."""

    def __init__(self, channels: int, widths: tuple[int, int, int, int, int, int]) -> None:
        """With random weights."""
        super().__init__()
        self.b0 = Unit3d(channels, widths[0], 1)
        self.b1a, self.b1b = Unit3d(channels, widths[1], 1), Unit3d(widths[1], widths[2], 3)
        self.b2a, self.b2b = Unit3d(channels, widths[3], 1), Unit3d(widths[3], widths[4], 3)
        self.b3b = Unit3d(channels, widths[5], 1)

    def forward(self, x: Tensor) -> Tensor:
        """All branches' features, side by side."""
        pooled = same_pooled(x, (3, 3, 3), (1, 1, 1))
        return torch.cat([self.b0(x), self.b1b(self.b1a(x)), self.b2b(self.b2a(x)), self.b3b(pooled)], dim=1)


class FvdNetwork(nn.Module):
    """I3D up to the scores of Kinetics' 400 actions, by which FVD compares videos.

    Source: Carreira and Zisserman 2017; Unterthiner et al. 2018.
    """

    def __init__(self) -> None:
        """With random weights: use `load_fvd`."""
        super().__init__()
        self.origin = "random weights"
        self.Conv3d_1a_7x7 = Unit3d(3, 64, 7, 2)
        self.Conv3d_2b_1x1, self.Conv3d_2c_3x3 = Unit3d(64, 64, 1), Unit3d(64, 192, 3)
        self.Mixed_3b = Mixed3d(192, (64, 96, 128, 16, 32, 32))
        self.Mixed_3c = Mixed3d(256, (128, 128, 192, 32, 96, 64))
        self.Mixed_4b = Mixed3d(480, (192, 96, 208, 16, 48, 64))
        self.Mixed_4c = Mixed3d(512, (160, 112, 224, 24, 64, 64))
        self.Mixed_4d = Mixed3d(512, (128, 128, 256, 24, 64, 64))
        self.Mixed_4e = Mixed3d(512, (112, 144, 288, 32, 64, 64))
        self.Mixed_4f = Mixed3d(528, (256, 160, 320, 32, 128, 128))
        self.Mixed_5b = Mixed3d(832, (256, 160, 320, 32, 128, 128))
        self.Mixed_5c = Mixed3d(832, (384, 192, 384, 48, 128, 128))
        self.logits = Unit3d(1024, 400, 1, normed=False)

    def forward(self, clips: Float[Tensor, "batch frames 3 height width"]) -> Float[Tensor, "batch 400"]:
        """What the network says of each clip.

        Raises:
            ValueError: If a colour is not between 0 and 1, or there are fewer than nine frames.
        """
        check_colours(clips, "FVD: clips")
        batch, frames = clips.shape[:2]
        if frames < LEAST_FRAMES:
            raise ValueError(f"FVD: clips: expected at least {LEAST_FRAMES} frames, got {frames}")
        x = F.interpolate(clips.flatten(0, 1), (FVD_SIDE, FVD_SIDE), mode="bilinear", align_corners=False)
        x = self.Conv3d_1a_7x7((2 * x - 1).unflatten(0, (batch, frames)).transpose(1, 2))
        x = self.Conv3d_2c_3x3(self.Conv3d_2b_1x1(same_pooled(x, (1, 3, 3), (1, 2, 2))))
        x = self.Mixed_3c(self.Mixed_3b(same_pooled(x, (1, 3, 3), (1, 2, 2))))
        x = same_pooled(x, (3, 3, 3), (2, 2, 2))
        x = self.Mixed_4f(self.Mixed_4e(self.Mixed_4d(self.Mixed_4c(self.Mixed_4b(x)))))
        x = self.Mixed_5c(self.Mixed_5b(same_pooled(x, (2, 2, 2), (2, 2, 2))))
        return self.logits(F.avg_pool3d(x, (2, 7, 7), 1)).mean(dim=(2, 3, 4))


def load_fid(path: Path | None) -> FidNetwork:
    """FID's network with the weights of that file.

    Raises:
        MetricUnavailable: If none was given.
        FileNotFoundError: If it is not there.
        ValueError: If it holds something else.
    """
    if path is None:
        raise MetricUnavailable("FID: weights not given")
    network = FidNetwork()
    _fill(network, path)
    return network


def load_fvd(path: Path | None) -> FvdNetwork:
    """FVD's network with the weights of that file.

    Raises:
        MetricUnavailable: If none was given.
        FileNotFoundError: If it is not there.
        ValueError: If it holds something else.
    """
    if path is None:
        raise MetricUnavailable("FVD: weights not given")
    network = FvdNetwork()
    _fill(network, path)
    return network


def _fill(network: FidNetwork | FvdNetwork, path: Path) -> None:
    weights = read_weights(path)
    fill(network, weights)
    network.origin = weights.origin


@torch.inference_mode()
def words_of(network: FidNetwork | FvdNetwork, batches: Iterable[Tensor]) -> Float[np.ndarray, "rows numbers"]:
    """What the network says of pictures (or clips), batch after batch, one row each: what Frechet distances compare.

    Compare them by `pgm_models.metrics.frechet_score`, as many made ones as real ones.

    Raises:
        ValueError: If there is no batch.
    """
    device = next(network.parameters()).device
    rows = [network(batch.to(device)).double().cpu().numpy() for batch in batches]
    if not rows:
        raise ValueError("batches: expected at least one, got none")
    return np.concatenate(rows)
