"""How far players and ball are from each other and how close they come, told to the network in metres.

A ball's places spread over the whole court and a player's over a part of it, and each is standardised by its own
spread: that a racket is an arm's length from the ball, which decides a hit, is a small difference of numbers that are
scaled otherwise, and between two frames besides. So each place is told its offset from the others, and of what moves
with a velocity also the offset when they are closest within the frame to come and within the one before; in their own
metres near by and saturating far off.
"""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pgm_models.animation.layout import Layout

PLACES = (".root_position", ".position")
"""Ends of the columns that are places in the world."""
NEAR_M = 2.0
"""Offsets well below this are told as they are, in units of it; those beyond by their direction alone."""
_ALL = [0, 1, 2]


def places_of(layout: Layout) -> tuple[int, ...]:
    """Rows of the properties that are places in the world, all three numbers of which are generated."""
    return tuple(
        row
        for row, entry in enumerate(layout.properties)
        if entry.column.endswith(PLACES) and entry.channels.tolist() == _ALL
    )


def velocity_of(layout: Layout, row: int) -> int | None:
    """Row of the velocity of that place, all of which is generated; None where there is none."""
    column = layout.properties[row].column.removesuffix(".position") + ".velocity"
    found = (at for at, entry in enumerate(layout.properties) if entry.column == column)
    return next((at for at in found if layout.properties[at].channels.tolist() == _ALL), None)


def offset_widths(layout: Layout) -> tuple[int, ...]:
    """Numbers that each property is told beside its own: three for each offset."""
    widths = [0] * len(layout.properties)
    places = places_of(layout)
    moves = {row for row in places if velocity_of(layout, row) is not None}
    for own in places:
        widths[own] = sum(9 if moves & {own, other} else 3 for other in places if other != own)
    return tuple(widths)


class Nearness(nn.Module):
    """Offsets of each place from the others: now, and where one moves closest ahead and closest behind."""

    def __init__(self, layout: Layout) -> None:
        """For states of that layout."""
        super().__init__()
        rows = places_of(layout)
        speeds = [velocity_of(layout, row) for row in rows]
        pairs = [(own, other) for own in range(len(rows)) for other in range(len(rows)) if own != other]
        # What has no velocity reads its own place for one, times zero.
        moved = [row if speed is None else speed for row, speed in zip(rows, speeds, strict=True)]
        moves = np.array([speed is not None for speed in speeds], dtype=bool)

        def channels(of: list[int]) -> np.ndarray:
            return np.array([np.arange(3) + layout.slice_of(row).start for row in of], dtype=np.int64).reshape(-1, 3)

        def numbers(of: list[int], name: str) -> np.ndarray:
            return np.array([getattr(layout.properties[row], name) for row in of], dtype=np.float32).reshape(-1, 3)

        told = [[True, moves[own] or moves[other], moves[own] or moves[other]] for own, other in pairs]
        values = {
            "rows": np.array([rows, moved], dtype=np.int64),
            "channels": channels(list(rows)),
            "std": numbers(list(rows), "std"),
            "mean": numbers(list(rows), "mean"),
            "speed_channels": channels(moved),
            "speed_std": numbers(moved, "std") * moves[:, None],
            "speed_mean": numbers(moved, "mean") * moves[:, None],
            "pairs": np.array(pairs, dtype=np.int64).reshape(-1, 2),
            "told": np.flatnonzero(np.array(told, dtype=bool)),
        }
        self.rows: Tensor
        self.channels: Tensor
        self.std: Tensor
        self.mean: Tensor
        self.speed_channels: Tensor
        self.speed_std: Tensor
        self.speed_mean: Tensor
        self.pairs: Tensor
        self.told: Tensor
        for name, value in values.items():
            self.register_buffer(name, torch.as_tensor(value), persistent=False)

    def forward(
        self, state: Float[Tensor, "B T C"], valid: Bool[Tensor, "B T P"], rate: Float[Tensor, " B"]
    ) -> Float[Tensor, "B T offsets"]:
        """Offsets in standardised states, at most 1 long; of each place in turn from each other one.

        0 where one of the two is not valid.
        """
        places = state[..., self.channels] * self.std + self.mean
        speeds = state[..., self.speed_channels] * self.speed_std + self.speed_mean
        there = valid[..., self.rows].all(dim=-2)
        own, other = self.pairs.unbind(dim=1)
        apart = places[..., other, :] - places[..., own, :]
        against = speeds[..., other, :] - speeds[..., own, :]
        meet = -(apart * against).sum(dim=-1) / against.square().sum(dim=-1).clamp(min=1e-6)
        frame = (1 / rate)[:, None, None]
        ahead, behind = meet.clamp(min=0).minimum(frame), meet.clamp(max=0).maximum(-frame)
        times = torch.stack([torch.zeros_like(meet), ahead, behind], dim=-1)[..., None]
        offset = (apart[..., None, :] + times * against[..., None, :]) / NEAR_M
        offset = offset / (1 + offset.square().sum(dim=-1, keepdim=True)).sqrt()
        seen = (there[..., own] & there[..., other])[..., None, None]
        return torch.where(seen, offset, 0).flatten(-3, -2)[..., self.told, :].flatten(-2)
