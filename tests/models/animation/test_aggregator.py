"""A text's vector depends on its tokens and their order, and on nothing else."""

import pytest
import torch
from torch import Tensor

from pgm_models.animation.aggregator import Aggregator, _Block, sinusoids
from pgm_models.animation.presets import PRESETS, TextOptions

WIDTH_IN = 12


def aggregator(layers: int = 2, dropout: float = 0.0) -> Aggregator:
    torch.manual_seed(layers)
    options = TextOptions(width=16, layers=layers, heads=4)
    return Aggregator(WIDTH_IN, options, dropout=dropout).eval().requires_grad_(False)


def some_texts(seed: int = 0) -> tuple[Tensor, Tensor]:
    """Five texts of 7, 1, 4, 0 and 6 tokens."""
    tokens = torch.randn(5, 7, WIDTH_IN, generator=torch.Generator().manual_seed(seed))
    mask = torch.arange(7) < torch.tensor([7, 1, 4, 0, 6])[:, None]
    return tokens * mask[..., None], mask


def slowly(network: Aggregator, tokens: Tensor) -> Tensor:
    """The vector of one text of tokens alone: every output of every layer, a loop over heads, then the last one."""
    width = network.project.out_features
    x = network.project((tokens - network.token_mean) @ network.token_map) + network.position_scale * torch.stack(
        [
            torch.tensor(
                [torch.sin(torch.tensor(place / 1e4 ** (k / (width // 2)))) for k in range(width // 2)]
                + [torch.cos(torch.tensor(place / 1e4 ** (k / (width // 2)))) for k in range(width // 2)]
            )
            for place in range(1, len(tokens) + 1)
        ]
    )
    for block in network.blocks:
        assert isinstance(block, _Block)
        normed = block.norm_attention(x)
        key, value = block.key_value(normed).chunk(2, -1)
        seen = []
        for q, k, v in zip(*(part.chunk(block.heads, -1) for part in (block.query(normed), key, value)), strict=True):
            seen.append((q @ k.T / q.shape[1] ** 0.5).softmax(-1) @ v)
        x = x + block.out(torch.cat(seen, -1))
        x = x + block.forward_part(x)
    return network.norm_out(x[-1])


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_the_vector_is_the_last_output_of_a_transformer_over_the_text_alone(layers: int) -> None:
    network = aggregator(layers)
    tokens, mask = some_texts()
    vectors = network(tokens, mask)
    for row in (0, 1, 2, 4):
        torch.testing.assert_close(vectors[row], slowly(network, tokens[row, mask[row]]), atol=1e-5, rtol=1e-5)


def test_padding_changes_nothing_whatever_it_holds_and_wherever_it_stands() -> None:
    network = aggregator()
    tokens, mask = some_texts()
    expected = network(tokens, mask)
    holes = torch.zeros(5, 20, dtype=torch.bool)
    holes[:, [0, 3, 4, 9, 11, 12, 17]] = mask
    spread = torch.full((5, 20, WIDTH_IN), torch.nan)
    spread[holes] = tokens[mask]
    torch.testing.assert_close(network(spread, holes), expected, atol=1e-5, rtol=1e-5)


def test_texts_do_not_see_each_other() -> None:
    network = aggregator()
    tokens, mask = some_texts()
    order = torch.tensor([4, 2, 0, 3, 1])
    torch.testing.assert_close(network(tokens[order], mask[order]), network(tokens, mask)[order], atol=1e-6, rtol=1e-5)
    other = tokens.clone()
    other[0] += 1
    assert torch.equal(network(other, mask)[1:], network(tokens, mask)[1:])


def test_the_order_of_tokens_matters_and_so_does_each_of_them() -> None:
    network = aggregator(layers=1)
    tokens, mask = some_texts()
    vector = network(tokens, mask)[0]
    swapped = tokens.clone()
    swapped[0, [1, 2]] = tokens[0, [2, 1]]
    assert (network(swapped, mask)[0] - vector).abs().max() > 1e-4
    for place in range(7):
        changed = tokens.clone()
        changed[0, place] = -tokens[0, place]
        assert (network(changed, mask)[0] - vector).abs().max() > 1e-4


@pytest.mark.parametrize(("texts", "tokens"), [(0, 0), (0, 5), (3, 0), (3, 5)])
def test_no_text_and_texts_without_tokens_give_finite_vectors_and_gradients(texts: int, tokens: int) -> None:
    network = aggregator().requires_grad_(True).train()
    vectors = network(torch.zeros(texts, tokens, WIDTH_IN), torch.zeros(texts, tokens, dtype=torch.bool))
    assert vectors.shape == (texts, 16)
    assert torch.isfinite(vectors).all()
    vectors.square().sum().backward()
    gradients = [parameter.grad for parameter in network.parameters()]
    assert all(gradient is not None and bool(torch.isfinite(gradient).all()) for gradient in gradients)


def test_every_weight_learns() -> None:
    network = aggregator().requires_grad_(True)
    weights = torch.randn(5, 16, generator=torch.Generator().manual_seed(3))
    (network(*some_texts()) * weights).sum().backward()
    still = [
        name for name, parameter in network.named_parameters() if parameter.grad is None or not parameter.grad.any()
    ]
    assert still == []


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_stays_near(dtype: torch.dtype) -> None:
    network = aggregator()
    tokens, mask = some_texts()
    expected = network(tokens, mask)
    vectors = network.to(dtype)(tokens.to(dtype), mask)
    assert vectors.dtype == dtype
    torch.testing.assert_close(vectors.float(), expected, atol=0.1, rtol=0.05)


def test_dropout_acts_in_training_alone() -> None:
    network, batch = aggregator(dropout=0.5), some_texts()
    assert torch.equal(network(*batch), network(*batch))
    network.train()
    assert not torch.equal(network(*batch), network(*batch))


def test_whitened_features_of_any_scale_and_offset_are_taken_alike() -> None:
    network = aggregator()
    tokens, mask = some_texts()
    expected = network(tokens, mask)
    network.whiten(torch.full((WIDTH_IN,), 3.0), torch.eye(WIDTH_IN) / 100)
    torch.testing.assert_close(network(100 * tokens + 3.0, mask), expected, atol=1e-4, rtol=1e-4)


def test_sinusoids_turn_at_wavelengths_from_two_pi_up() -> None:
    turns = sinusoids(torch.tensor([[0, 3]]), 4)
    expected = torch.tensor([[0.0, 0.0, 1.0, 1.0], [0.1411, 0.0300, -0.9900, 0.9996]])
    torch.testing.assert_close(turns[0], expected, atol=1e-4, rtol=0)


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_every_preset_is_a_size_that_can_be_built(preset: str) -> None:
    with torch.device("meta"):
        built = Aggregator(384, PRESETS[preset].text)
    assert len(built.blocks) == PRESETS[preset].text.layers


def test_sizes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="width: expected a multiple of twice 4 heads, got 12"):
        Aggregator(WIDTH_IN, TextOptions(width=12, layers=1, heads=4))
    with pytest.raises(ValueError, match="layers: expected at least 1, got 0"):
        Aggregator(WIDTH_IN, TextOptions(width=16, layers=0, heads=4))
