"""Small networks that dress the values of a field in a style."""

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.modulation import DemodulatedLinear
from pgm_models.synthesis.grids import mixed

COLOURS = 3
"""Of the features, those that are a colour."""


class Stylist(nn.Module):
    """Features of a field's values in the style of their frame: two layers whose weights the style scales.

    Source: Menapace et al. 2023, section 3.2.3 and appendix D.1.
    """

    def __init__(self, inputs: int, style: int, features: int, *, hidden: int = 64) -> None:
        """For values and styles of that many numbers; the first three features are colours."""
        super().__init__()
        self.scales = nn.Linear(style, inputs + hidden)
        nn.init.normal_(self.scales.weight, std=0.5 / style**0.5)
        nn.init.zeros_(self.scales.bias)
        self.first = DemodulatedLinear(inputs, hidden, gain=1.0)
        self.second = DemodulatedLinear(hidden, features, gain=1.0)
        self.shift = nn.Linear(style, features)
        nn.init.zeros_(self.shift.weight)
        nn.init.zeros_(self.shift.bias)
        self.inputs = inputs

    def forward(
        self, values: Float[Tensor, "rows inputs"], frame: Int[Tensor, " rows"], styles: Float[Tensor, "frames style"]
    ) -> Float[Tensor, "rows features"]:
        """Features of each row; colours 0 to 1."""
        first, second = (1 + self.scales(styles)).split((self.inputs, self.first.weight.shape[0]), dim=1)
        hidden = functional.silu(self.first.of_rows(values, frame, first))
        raw = self.second.of_rows(hidden, frame, second) + self.shift(styles)[frame]
        return torch.cat([torch.sigmoid(raw[:, :COLOURS]), raw[:, COLOURS:]], dim=1)


Stylising = Literal["grid", "sample"]


def dressed(
    stylist: Stylist,
    values: Float[Tensor, "cells inputs"],
    rows: Int[Tensor, "points corners"],
    shares: Float[Tensor, "points corners"],
    frame: Int[Tensor, " points"],
    styles: Float[Tensor, "frames style"],
    stylising: Stylising,
) -> Float[Tensor, "points features"]:
    """Features at points of a grid in the styles of their frames.

    Args:
        stylist: Dresses values.
        values: Of the grid's cells, the same for all frames.
        rows: Cells about each point.
        shares: Their weights.
        frame: Of each point.
        styles: One a frame.
        stylising: `sample` interpolates values and dresses each point; `grid` dresses the cells that any point needs,
            and interpolates features.
    """
    if stylising == "sample":
        return stylist(mixed(values, rows, shares), frame, styles)
    cells = len(values)
    keys = rows + (frame * cells)[:, None]
    needed = torch.zeros(len(styles) * cells, dtype=torch.bool, device=rows.device)
    needed[keys.flatten()] = True
    those = torch.nonzero(needed)[:, 0]
    place = torch.cumsum(needed, dim=0) - 1
    return mixed(stylist(values[those % cells], those // cells, styles), place[keys], shares)


def baked(
    stylist: Stylist, values: Float[Tensor, "cells inputs"], styles: Float[Tensor, "frames style"]
) -> Float[Tensor, "all features"]:
    """All cells dressed in each of the styles, one frame after the other: what `grid` interpolates between."""
    cells, frames = len(values), len(styles)
    frame = torch.arange(frames, device=values.device).repeat_interleave(cells)
    return stylist(values.repeat(frames, 1), frame, styles)
