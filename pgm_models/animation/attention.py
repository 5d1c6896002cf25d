"""Attention among the tokens of a window, which know their distance in time and nothing of absolute time.

The sequence is: for each frame its tokens, one of each kind, in order; then the tokens that have no time.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from pgm_models.modulation import DemodulatedLinear

TINY = 1e-6
"""Added to mean squares."""


def clipped_distances(times: Int[Tensor, " T"], reach: int) -> Int[Tensor, "T T"]:
    """Row in a table of 2 reach + 1 for each frame that asks and each that is asked; farther counts as `reach`."""
    return (times[None, :] - times[:, None]).clamp(-reach, reach) + reach


def unit_mean_square(tokens: Float[Tensor, "*batch width"]) -> Float[Tensor, "*batch width"]:
    """The tokens scaled so that their mean square over the last axis is 1.

    Without learned scales: the linear layer that follows has them. Source: Zhang and Sennrich 2019, Root Mean Square
    Layer Normalization.
    """
    return functional.rms_norm(tokens, (tokens.shape[-1],), eps=TINY)


class PairBias(nn.Module):
    """What is added to the attention of two tokens for their kinds and their distance in time, of each head."""

    def __init__(self, heads: int, kinds: int, timeless: int, reach: int) -> None:
        """For that many kinds of tokens in time, and tokens without."""
        super().__init__()
        self.heads, self.kinds, self.timeless = heads, kinds, timeless
        self.timed = nn.Parameter(torch.zeros(2 * reach + 1, heads * kinds * kinds))
        if timeless:
            self.of_timeless = nn.Parameter(torch.zeros(heads, kinds, timeless))
            self.by_timeless = nn.Parameter(torch.zeros(heads, timeless, kinds))
            self.among_timeless = nn.Parameter(torch.zeros(heads, timeless, timeless))

    def forward(self, distances: Int[Tensor, "T T"]) -> Float[Tensor, "1 heads S S"]:
        """The bias of each token that asks (rows) to each that is asked (columns); distances as rows of the table."""
        heads, kinds, timeless, frames = self.heads, self.kinds, self.timeless, distances.shape[0]
        timed = self.timed[distances].view(frames, frames, heads, kinds, kinds)
        timed = timed.permute(2, 0, 3, 1, 4).reshape(heads, frames * kinds, frames * kinds)
        if not timeless:
            return timed[None]
        of_timeless = self.of_timeless[:, None].expand(-1, frames, -1, -1).reshape(heads, frames * kinds, timeless)
        by_timeless = self.by_timeless[:, :, None].expand(-1, -1, frames, -1).reshape(heads, timeless, frames * kinds)
        upper = torch.cat([timed, of_timeless], dim=2)
        lower = torch.cat([by_timeless, self.among_timeless], dim=2)
        return torch.cat([upper, lower], dim=1)[None]


class ShawKeys(nn.Module):
    """A vector for each distance in time that is added to the keys, the same in all heads.

    Source: Shaw et al. 2018, Self-Attention with Relative Position Representations, equation 4 and section 3.3; its
    vectors for values are left out, which its table 4 finds to change nothing.
    """

    def __init__(self, width: int, kinds: int, timeless: int, reach: int) -> None:
        """Vectors of that width; one more stands for the distance to and from tokens without time."""
        super().__init__()
        self.kinds, self.timeless = kinds, timeless
        self.timed = nn.Parameter(torch.randn(2 * reach + 1, width) / math.sqrt(width))
        if timeless:
            self.no_time = nn.Parameter(torch.randn(width) / math.sqrt(width))

    def forward(
        self, query: Float[Tensor, "B heads S width"], distances: Int[Tensor, "T T"]
    ) -> Float[Tensor, "B heads S S"]:
        """What the vectors add to the scaled products of queries (rows) and keys (columns)."""
        batch, heads, _, width = query.shape
        kinds, timeless, frames = self.kinds, self.timeless, distances.shape[0]
        scaled = query / math.sqrt(width)
        vectors = self.timed[distances].to(query.dtype)
        timed = scaled[:, :, : frames * kinds].unflatten(2, (frames, kinds))
        products = torch.einsum("bhtkd,tsd->bhtks", timed, vectors)
        bias = products[..., None].expand(-1, -1, -1, -1, -1, kinds)
        bias = bias.reshape(batch, heads, frames * kinds, frames * kinds)
        if not timeless:
            return bias
        still = functional.linear(scaled, self.no_time[None])
        upper = torch.cat([bias, still[:, :, : frames * kinds].expand(-1, -1, -1, timeless)], dim=3)
        lower = still[:, :, frames * kinds :].expand(-1, -1, -1, frames * kinds + timeless)
        return torch.cat([upper, lower], dim=2)


class Attention(nn.Module):
    """Attention of all tokens to all, queries and keys brought to unit mean square first."""

    def __init__(self, width: int, heads: int, *, gain: float, shaw: ShawKeys | None = None) -> None:
        """`gain` is the scale of what it gives out at the start."""
        super().__init__()
        self.heads = heads
        self.queries_keys_values = nn.Linear(width, 3 * width, bias=False)
        nn.init.normal_(self.queries_keys_values.weight, std=1 / math.sqrt(width))
        self.sharpness = nn.Parameter(torch.ones(width))
        self.out = DemodulatedLinear(width, width, gain=gain)
        self.shaw = shaw

    def forward(
        self,
        tokens: Float[Tensor, "B S width"],
        bias: Float[Tensor, "1 heads S S"] | None,
        scale: Float[Tensor, "B width"],
        distances: Int[Tensor, "T T"],
    ) -> Float[Tensor, "B S width"]:
        """What each token gathers from all; `scale` modulates the output projection."""
        both, value = self.queries_keys_values(tokens).unflatten(2, (3, self.heads, -1)).split([2, 1], dim=2)
        value = value.squeeze(2).transpose(1, 2)
        query, key = unit_mean_square(both).to(value.dtype).transpose(1, 3).unbind(2)
        query = query * self.sharpness.to(value.dtype).view(self.heads, 1, -1)
        added = self.shaw(query, distances) if self.shaw is not None else bias
        if added is not None:
            added = added.to(value.dtype)
        return self.out(attended(query, key, value, added).transpose(1, 2).flatten(2), scale)


def attended(
    query: Float[Tensor, "B heads S width"],
    key: Float[Tensor, "B heads S width"],
    value: Float[Tensor, "B heads S width"],
    added: Float[Tensor, "_ heads S S"] | None,
) -> Float[Tensor, "B heads S width"]:
    """Values weighed by the softmax of scaled products and what is added to them."""
    if added is None or not added.requires_grad or added.device.type != "cpu":
        return functional.scaled_dot_product_attention(query, key, value, attn_mask=added)
    # No kernel of a CPU learns what is added; in its own products torch also looks for rows that may see nothing.
    products = (query / math.sqrt(query.shape[-1])) @ key.transpose(-1, -2)
    return (products + added).softmax(dim=-1) @ value
