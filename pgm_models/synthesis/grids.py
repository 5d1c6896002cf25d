"""Grids of values between which one interpolates: volumes and planes, grown by convolutions from fixed noise."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional

SLOW_VALUES = 20480
"""Channels times cells of two axes up to which PyTorch takes its slow way with one volume."""
GROUPS = 4
"""Of the group norms, at the most; they act within a grid only, which is the same for all frames."""


def corners_of(
    points: Float[Tensor, "points axes"], size: Sequence[int]
) -> tuple[Int[Tensor, "points corners"], Float[Tensor, "points corners"]]:
    """Cells around each point, as rows of the flattened grid, and their weights, which add up to 1.

    Args:
        points: Places in the grid, 0 at the first cell's middle and 1 at the last one's, along each axis; those outside
            count as on the border.
        size: Cells along each axis, the last one varying fastest.
    """
    place, first = _placed(points, size)
    share = (place - first).T.contiguous()  # rows as long as there are points are several times faster
    both = torch.stack([1 - share, share])
    weights, steps = torch.ones_like(share[:1]), [0]
    for axis, (step, cells) in enumerate(zip(_strides(size), size, strict=True)):
        weights = (both[:, None, axis] * weights).flatten(0, 1)
        steps += [before + (step if cells > 1 else 0) for before in steps]
    return _rows(first, size)[:, None] + torch.tensor(steps, device=points.device), weights.T.contiguous()


def first_corners(points: Float[Tensor, "points axes"], size: Sequence[int]) -> Int[Tensor, " points"]:
    """The first of the cells around each point, as `corners_of` has them."""
    return _rows(_placed(points, size)[1], size)


def near_any(filled: Bool[Tensor, "cells *channels"], size: Sequence[int]) -> Bool[Tensor, "cells *channels"]:
    """Whether any of the cells around a point is filled, by the first of those cells."""
    found = filled.reshape(*size, *filled.shape[1:])
    for axis, cells in enumerate(size):
        after = torch.cat([found.narrow(axis, 1, cells - 1), found.narrow(axis, cells - 1, 1)], dim=axis)
        found = found | after
    return found.reshape(filled.shape)


def _placed(
    points: Float[Tensor, "points axes"], size: Sequence[int]
) -> tuple[Float[Tensor, "points axes"], Float[Tensor, "points axes"]]:
    """Points in cells from the first one, and the whole cells before each."""
    last = torch.tensor([cells - 1 for cells in size], device=points.device)
    place = points.clamp(0.0, 1.0) * last
    return place, torch.minimum(place.detach().floor(), (last - 1).clamp(min=0))


def _rows(first: Float[Tensor, "points axes"], size: Sequence[int]) -> Int[Tensor, " points"]:
    return (first.double() @ torch.tensor(_strides(size), dtype=torch.float64, device=first.device)).long()


def _strides(size: Sequence[int]) -> list[int]:
    strides = [1]
    for cells in reversed(size[1:]):
        strides.append(strides[-1] * cells)
    return strides[::-1]


def mixed(
    table: Float[Tensor, "cells channels"],
    rows: Int[Tensor, "points corners"],
    weights: Float[Tensor, "points corners"],
) -> Float[Tensor, "points channels"]:
    """Sum of the table's rows by their weights: what a grid holds at a point, given its cells."""
    return functional.embedding_bag(rows, table, per_sample_weights=weights.to(table.dtype), mode="sum")


def fetched(
    table: Float[Tensor, "cells channels"], points: Float[Tensor, "points axes"], size: Sequence[int]
) -> Float[Tensor, "points channels"]:
    """The grid's values at the points, linearly between its cells; arguments as of `corners_of`."""
    return mixed(table, *corners_of(points, size))


def finer(
    table: Float[Tensor, "cells channels"], size: Sequence[int], wanted: Sequence[int]
) -> Float[Tensor, "wanted_cells channels"]:
    """A volume with other numbers of cells along its axes, linearly between its own; its outermost cells stay there."""
    if tuple(size) == tuple(wanted):
        return table
    # One axis after the other, as matrix products: the last one is most of the work, and several times faster so.
    values = table.unflatten(0, tuple(size))
    for axis, (cells, more) in enumerate(zip(size, wanted, strict=True)):
        hats = functional.interpolate(
            torch.eye(cells, device=table.device, dtype=table.dtype)[None], size=more, mode="linear", align_corners=True
        )
        before, after = values.shape[:axis], values.shape[axis + 1 :]
        with torch.autocast(table.device.type, enabled=False):  # which would round
            values = hats[0].T @ values.reshape(-1, cells, after.numel())
        values = values.reshape(*before, more, *after)
    return values.flatten(0, -2)


class Convolution3d(nn.Conv3d):
    """A convolution over a volume's neighbours, zeros beyond it, as fast for one small volume as for many.

    PyTorch hands single volumes with few values to code that takes three to five times as long, on a CPU: there slices
    along the first axis count as pictures, with their neighbours' channels beside their own.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        """Fresh weights over 3 x 3 x 3 cells."""
        super().__init__(inputs, outputs, 3, padding=1)

    def forward(self, input: Float[Tensor, "1 inputs x y z"]) -> Float[Tensor, "1 outputs x y z"]:
        """The outputs, of the same size."""
        if input.device.type != "cpu" or input[0, ..., 0].numel() > SLOW_VALUES:
            return super().forward(input)
        depth = input.shape[2]
        padded = functional.pad(input[0], (0, 0, 0, 0, 1, 1))
        slices = torch.cat([padded[:, step : step + depth] for step in range(3)]).transpose(0, 1)
        found = functional.conv2d(slices, self.weight.transpose(1, 2).flatten(1, 2), self.bias, padding=1)
        return found.transpose(0, 1)[None]


class Grown(nn.Module):
    """A grid whose cells convolutions make of fixed noise, doubling it until it has its size.

    Source: Menapace et al. 2023, section 3.2.3. Steps of the same grid share what is around each cell, which is what
    keeps places that no picture showed like their neighbours.
    """

    noise: Tensor

    def __init__(self, size: Sequence[int], channels: int, *, width: int, seed: int, coarsest: int = 4) -> None:
        """A grid of that size.

        Args:
            size: Cells along each axis, two or three axes.
            channels: Numbers of a cell.
            width: Channels of the finest hidden layer; coarser ones have up to four times as many.
            seed: Of the noise.
            coarsest: Cells of the noise along the longest axis, at least.

        Raises:
            ValueError: If the size has another number of axes, or an axis without cells.
        """
        super().__init__()
        if len(size) not in (2, 3) or min(size) < 1:
            raise ValueError(f"size: expected two or three numbers of 1 or more, got {tuple(size)}")
        self.size, self.channels = tuple(size), channels
        sizes = [self.size]
        while max(sizes[0]) >= 2 * coarsest:
            sizes.insert(0, tuple(max(1, -(-cells // 2)) for cells in sizes[0]))
        self.sizes = sizes
        widths = [min(4 * width, width * 2 ** (len(sizes) - 1 - level)) for level in range(len(sizes))]
        generator = torch.Generator().manual_seed(seed)
        self.register_buffer("noise", torch.randn(1, widths[0], *sizes[0], generator=generator), persistent=True)
        self.steps = nn.ModuleList(
            nn.Sequential(
                nn.Conv2d(before, after, 3, padding=1) if len(size) == 2 else Convolution3d(before, after),
                nn.GroupNorm(math.gcd(GROUPS, after), after),
                nn.SiLU(),
            )
            for before, after in zip([widths[0], *widths], widths, strict=False)
        )
        self.out = (nn.Conv2d if len(size) == 2 else nn.Conv3d)(widths[-1], channels, 1)

    def forward(self) -> Float[Tensor, "cells channels"]:
        """The grid's cells, the last axis varying fastest."""
        values = self.noise
        mode = "bilinear" if len(self.size) == 2 else "trilinear"
        for size, step in zip(self.sizes, self.steps, strict=True):
            if tuple(values.shape[2:]) != size:
                values = functional.interpolate(values, size=size, mode=mode, align_corners=False)
            values = step(values)
        # As a matrix product: the cells' rows come out as they are looked up, and nothing is copied.
        # Wherever networks are computed with fewer digits, cells have all of them.
        return functional.linear(values[0].flatten(1).T, self.out.weight.flatten(1), self.out.bias).to(self.noise.dtype)
