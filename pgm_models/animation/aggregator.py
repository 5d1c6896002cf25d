"""The trained part of the text encoder: one vector of a text from the features of its tokens."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from pgm_models.animation.presets import TextOptions


class Aggregator(nn.Module):
    """A small transformer over the tokens of each text; what it says at the end token is the text's vector.

    Positions are sinusoidal and count tokens, so that padding, wherever it stands, changes nothing; texts do not see
    each other. The last layer asks for the end token alone: no other output is used.

    Raises:
        ValueError: If the width is not a multiple of twice the heads, or there is no layer.

    Source: the paper, "Text Encoder" and its appendix on details (end token; mean pooling was no better there).
    """

    def __init__(self, width_in: int, options: TextOptions, *, dropout: float = 0.0) -> None:
        super().__init__()
        if options.width % (2 * options.heads):
            raise ValueError(f"width: expected a multiple of twice {options.heads} heads, got {options.width}")
        if options.layers < 1:
            raise ValueError(f"layers: expected at least 1, got {options.layers}")
        self.width = options.width
        self.token_mean: Tensor
        self.token_map: Tensor
        self.register_buffer("token_mean", torch.zeros(width_in))
        self.register_buffer("token_map", torch.eye(width_in))
        self.project = nn.Linear(width_in, options.width)
        self.position_scale = nn.Parameter(torch.tensor(0.5))
        self.dropout = nn.Dropout(dropout)
        self.blocks = nn.ModuleList(_Block(options.width, options.heads, dropout) for _ in range(options.layers))
        self.norm_out = nn.LayerNorm(options.width)

    @torch.no_grad()
    def whiten(self, mean: Float[Tensor, " E"], linear: Float[Tensor, "E E"]) -> None:
        """From now on take the mean from token features and multiply them by that map."""
        self.token_mean.copy_(mean)
        self.token_map.copy_(linear)

    def forward(self, tokens: Float[Tensor, "U L E"], mask: Bool[Tensor, "U L"]) -> Float[Tensor, "U D"]:
        """One vector a text; U may be 0. A text without any token gives finite numbers, the same for all such."""
        if tokens.shape[1] == 0:
            tokens, mask = nn.functional.pad(tokens, (0, 0, 0, 1)), nn.functional.pad(mask, (0, 1))
        place = torch.arange(tokens.shape[1], device=tokens.device)
        end = (mask * place).argmax(1)
        attended = mask | (place == end[:, None])
        # What stands in padding may be anything, NaN too.
        tokens = torch.where(mask[..., None], tokens - self.token_mean, 0.0) @ self.token_map
        position = sinusoids(mask.cumsum(1), self.project.out_features).to(tokens.dtype)
        x = self.dropout(self.project(tokens) + self.position_scale * position)
        for block in self.blocks[:-1]:
            x = block(x, x, attended)
        asked = x.gather(1, end[:, None, None].expand(-1, 1, x.shape[2]))
        return self.norm_out(self.blocks[-1](asked, x, attended)[:, 0])


class _Block(nn.Module):
    """Pre-norm attention and feed-forward."""

    def __init__(self, width: int, heads: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.norm_attention = nn.LayerNorm(width)
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.forward_part = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )
        self.dropout = nn.Dropout(dropout)

    def forward(
        self, asked: Float[Tensor, "U Q D"], x: Float[Tensor, "U L D"], attended: Bool[Tensor, "U L"]
    ) -> Float[Tensor, "U Q D"]:
        """What the tokens that are asked for become; they see all that are attended to."""
        query = self.query(self.norm_attention(asked)).unflatten(2, (self.heads, -1)).transpose(1, 2)
        key_value = self.key_value(self.norm_attention(x)).unflatten(2, (2, self.heads, -1))
        key, value = key_value.permute(2, 0, 3, 1, 4).unbind(0)
        seen = nn.functional.scaled_dot_product_attention(query, key, value, attn_mask=attended[:, None, None])
        asked = asked + self.dropout(self.out(seen.transpose(1, 2).flatten(2)))
        return asked + self.dropout(self.forward_part(asked))


def sinusoids(position: Tensor, width: int) -> Float[Tensor, "*batch width"]:
    """Sines and cosines of positions, of wavelengths from 2 pi to 2 pi * 10,000; the width is even.

    Source: Vaswani et al., "Attention is all you need", section 3.5.
    """
    exponents = torch.arange(width // 2, device=position.device) * (-math.log(1e4) / (width // 2))
    angles = position[..., None] * exponents.exp()
    return torch.cat([angles.sin(), angles.cos()], -1)
