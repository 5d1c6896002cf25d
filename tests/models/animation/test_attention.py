import math

import pytest
import torch

from pgm_models.animation.attention import (
    Attention,
    PairBias,
    ShawKeys,
    attended,
    clipped_distances,
    unit_mean_square,
)

KINDS, TIMELESS, REACH, HEADS, WIDTH = 3, 2, 4, 2, 8


def filled(module: torch.nn.Module) -> torch.nn.Module:
    """The module with all its parameters drawn at random."""
    generator = torch.Generator().manual_seed(0)
    for parameter in module.parameters():
        parameter.data = torch.randn(parameter.shape, generator=generator)
    return module


def distances(frames: int) -> torch.Tensor:
    return clipped_distances(torch.arange(frames), REACH)


@pytest.mark.parametrize("frames", [1, 2, 9])
def test_the_pair_bias_is_that_of_kinds_and_distance(frames: int) -> None:
    module = filled(PairBias(HEADS, KINDS, TIMELESS, REACH))
    found = module(distances(frames))[0]
    table = module.timed.view(2 * REACH + 1, HEADS, KINDS, KINDS)
    size = frames * KINDS
    for row in range(size + TIMELESS):
        for column in range(size + TIMELESS):
            if row < size and column < size:
                gap = max(-REACH, min(REACH, column // KINDS - row // KINDS))
                wanted = table[gap + REACH, :, row % KINDS, column % KINDS]
            elif row < size:
                wanted = module.of_timeless[:, row % KINDS, column - size]
            elif column < size:
                wanted = module.by_timeless[:, row - size, column % KINDS]
            else:
                wanted = module.among_timeless[:, row - size, column - size]
            assert torch.equal(found[:, row, column], wanted)


@pytest.mark.parametrize("timeless", [0, TIMELESS])
def test_shaws_vectors_are_as_if_added_to_every_key_of_every_query(timeless: int) -> None:
    frames, batch, width = 7, 2, 5
    module = filled(ShawKeys(width, KINDS, timeless, REACH))
    size = frames * KINDS + timeless
    query = torch.randn(batch, HEADS, size, width, generator=torch.Generator().manual_seed(1))
    wanted = torch.empty(batch, HEADS, size, size)
    for row in range(size):
        for column in range(size):
            if max(row, column) < frames * KINDS:
                gap = max(-REACH, min(REACH, column // KINDS - row // KINDS))
                vector = module.timed[gap + REACH]
            else:
                vector = module.no_time
            wanted[:, :, row, column] = query[:, :, row] @ vector / math.sqrt(width)
    torch.testing.assert_close(module(query, distances(frames)), wanted)


def test_attention_is_the_plain_formula() -> None:
    frames = 3
    module = filled(Attention(WIDTH, HEADS, gain=1.0, shaw=ShawKeys(WIDTH // HEADS, KINDS, 0, REACH)))
    tokens = torch.randn(2, frames * KINDS, WIDTH, generator=torch.Generator().manual_seed(2))
    scale = torch.ones(2, WIDTH)
    weight = module.queries_keys_values.weight.view(3, HEADS, WIDTH // HEADS, WIDTH)
    query, key, value = torch.einsum("nhcd,bsd->nbhsc", weight, tokens)
    sharpness = module.sharpness.view(HEADS, 1, WIDTH // HEADS)
    query = query / query.square().mean(-1, keepdim=True).sqrt() * sharpness
    key = key / key.square().mean(-1, keepdim=True).sqrt()
    vectors = module.shaw.timed[distances(frames)].repeat_interleave(KINDS, 0).repeat_interleave(KINDS, 1)
    logits = torch.einsum("bhqc,bhkqc->bhqk", query, key[:, :, :, None] + vectors.transpose(0, 1))
    gathered = torch.softmax(logits / math.sqrt(WIDTH // HEADS), dim=-1) @ value
    wanted = module.out(gathered.transpose(1, 2).flatten(2), scale)
    torch.testing.assert_close(module(tokens, None, scale, distances(frames)), wanted, rtol=1e-4, atol=1e-4)


def test_attention_hears_its_bias_and_cannot_be_swamped_by_large_tokens() -> None:
    module = filled(Attention(WIDTH, HEADS, gain=1.0))
    tokens = torch.randn(1, 4, WIDTH, generator=torch.Generator().manual_seed(3))
    only_first = torch.full((1, HEADS, 4, 4), -1e4)
    only_first[..., 0] = 0.0
    said = module(tokens, only_first, torch.ones(1, WIDTH), distances(4))
    torch.testing.assert_close(said, said[:, :1].expand(-1, 4, -1))
    huge = module(1e6 * tokens, None, torch.ones(1, WIDTH), distances(4)) - module.out.bias
    plain = module(tokens, None, torch.ones(1, WIDTH), distances(4)) - module.out.bias
    torch.testing.assert_close(huge / 1e6, plain, rtol=1e-3, atol=1e-4)  # the same shares of values


@pytest.mark.parametrize("size", [1e-2, 1.0, 1e4])
def test_tokens_are_brought_to_unit_mean_square(size: float) -> None:
    tokens = size * torch.randn(5, 64, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(unit_mean_square(tokens).square().mean(-1), torch.ones(5), rtol=2e-2, atol=0)
    assert torch.equal(unit_mean_square(torch.zeros(2, 64)), torch.zeros(2, 64))


def test_what_is_learned_is_added_as_what_is_fixed() -> None:
    torch.manual_seed(0)
    query, key, value = torch.randn(3, 2, HEADS, 7, 4, dtype=torch.float64)
    added = torch.randn(1, HEADS, 7, 7, dtype=torch.float64)
    learned = added.clone().requires_grad_(True)
    found = attended(query, key, value, learned)
    torch.testing.assert_close(found.detach(), attended(query, key, value, added))
    weights = torch.softmax(query @ key.transpose(2, 3) / 2 + added, dim=-1)
    torch.testing.assert_close(found.detach(), weights @ value)
    assert torch.autograd.gradcheck(lambda bias: attended(query, key, value, bias), (learned,))
