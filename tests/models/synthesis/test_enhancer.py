import pytest
import torch
from torch.nn import functional

from pgm_models.synthesis.enhancer import (
    CONTOUR_PX,
    DemodulatedConvolution,
    Enhancer,
    clipped,
    demodulated_convolution,
    with_kept,
)
from pgm_models.synthesis.presets import EnhancerOptions

WIDTHS = [(), (4,), (4, 8), (4, 6, 8), (4, 4, 4, 4)]
SIZES = [(1, 1), (1, 9), (7, 1), (5, 6), (17, 23), (16, 24)]


def drawn(*sizes: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> torch.Tensor:
    return torch.randn(*sizes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def trained_like(widths: tuple[int, ...], features: int = 5, style: int = 4) -> Enhancer:
    """One that changes colours."""
    torch.manual_seed(0)
    enhancer = Enhancer(features, style, EnhancerOptions(widths=widths))
    for parameter in enhancer.parameters():
        parameter.data += 0.2 * torch.randn_like(parameter)
    return enhancer.requires_grad_(False)


def convolved_weight_by_weight(inputs, scale, weight, gain, bias, stride):
    """Each sample's own weights, written out."""
    outputs = []
    for sample, factors in zip(inputs, scale, strict=True):
        own = torch.empty_like(weight)
        for output in range(len(weight)):
            scaled = weight[output] * factors[:, None, None]
            own[output] = scaled / (scaled.square().sum() + 1e-8).sqrt() * gain[output]
        outputs.append(functional.conv2d(sample, own, bias, stride=stride, padding=weight.shape[2] // 2))
    return torch.stack(outputs)


@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize(("size", "stride"), [(1, 1), (3, 1), (3, 2)])
def test_modulated_activations_are_modulated_weights(samples: int, size: int, stride: int) -> None:
    double = torch.float64
    inputs, scale = drawn(samples, 4, 7, 6, seed=1, dtype=double), 1 + 0.4 * drawn(samples, 4, seed=2, dtype=double)
    weight, gain = drawn(5, 4, size, size, seed=3, dtype=double), drawn(5, seed=4, dtype=double)
    arguments = (inputs, scale, weight, gain, drawn(5, seed=5, dtype=double), stride)
    torch.testing.assert_close(demodulated_convolution(*arguments), convolved_weight_by_weight(*arguments))


def test_neither_the_size_of_weights_nor_that_of_scales_counts() -> None:
    inputs, scale, weight = drawn(2, 4, 6, 6), 1 + 0.3 * drawn(2, 4, seed=1), drawn(5, 4, 3, 3, seed=2)
    gain, bias = torch.ones(5), torch.zeros(5)
    once = demodulated_convolution(inputs, scale, weight, gain, bias)
    torch.testing.assert_close(demodulated_convolution(inputs, 7 * scale, weight / 3, gain, bias), once)


def test_weights_of_nothing_give_the_bias_and_no_nan() -> None:
    for samples in (1, 2):
        bias = drawn(5)
        said = demodulated_convolution(
            drawn(samples, 4, 6, 6), torch.ones(samples, 4), torch.zeros(5, 4, 3, 3), torch.ones(5), bias
        )
        assert torch.equal(said, bias[None, :, None, None].expand_as(said))


def test_gradients_of_a_demodulated_convolution_are_right() -> None:
    double = torch.float64
    for samples in (1, 2):
        shapes = ((samples, 2, 4, 3), (samples, 2), (3, 2, 3, 3), (3,), (3,))
        arguments = [drawn(*shape, seed=k, dtype=double).requires_grad_() for k, shape in enumerate(shapes)]
        assert torch.autograd.gradcheck(demodulated_convolution, arguments)


def test_a_layer_begins_with_outputs_of_its_gain() -> None:
    torch.manual_seed(0)
    layer = DemodulatedConvolution(32, 64, style=8, gain=0.25)
    said = layer(drawn(2, 32, 30, 30), drawn(2, 8, seed=1))[:, :, 1:-1, 1:-1].detach()
    assert float(said.std()) == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("widths", WIDTHS)
def test_an_untrained_enhancer_changes_no_colour(widths: tuple[int, ...]) -> None:
    enhancer = Enhancer(6, 4, EnhancerOptions(widths=widths))
    features = drawn(2, 6, 13, 10)
    assert torch.equal(enhancer(features, drawn(2, 4, seed=1)), features[:, :3].clamp(0, 1))


@pytest.mark.parametrize("widths", WIDTHS)
@pytest.mark.parametrize("size", SIZES)
def test_pictures_of_any_size_are_colours_between_0_and_1(widths: tuple[int, ...], size: tuple[int, int]) -> None:
    said = trained_like(widths)(1e3 * drawn(2, 5, *size), drawn(2, 4, seed=1))
    assert said.shape == (2, 3, *size)
    assert float(said.min()) >= 0
    assert float(said.max()) <= 1


def test_beyond_its_last_row_and_column_a_picture_goes_on_as_they_are() -> None:
    enhancer, features, styles = trained_like((4, 6, 8)), drawn(1, 5, 13, 18), drawn(1, 4, seed=1)
    longer = torch.cat([features, features[:, :, -1:].expand(-1, -1, 3, -1)], dim=2)
    longer = torch.cat([longer, longer[..., -1:].expand(-1, -1, -1, 2)], dim=3)
    torch.testing.assert_close(enhancer(longer, styles)[:, :, :13, :18], enhancer(features, styles))


def test_a_picture_is_the_same_alone_and_among_others() -> None:
    enhancer = trained_like((4, 6, 8))
    features, styles = drawn(3, 5, 18, 11), drawn(3, 4, seed=1)
    together = enhancer(features, styles)
    for k in range(3):
        torch.testing.assert_close(enhancer(features[k : k + 1], styles[k : k + 1])[0], together[k])


@pytest.mark.parametrize("widths", WIDTHS[:4])
def test_a_pixel_counts_within_the_reach_and_as_far_as_that(widths: tuple[int, ...]) -> None:
    enhancer = trained_like(widths).double()
    # Where no ReLU is 0, nothing that could be read goes unseen.
    for name, parameter in enhancer.named_parameters():
        if name.endswith(".bias") and "scales" not in name and "outward" not in name:
            parameter.data += 30.0
    size = 2 * enhancer.reach + 9
    features, style = drawn(1, 5, size, size, dtype=torch.float64), drawn(1, 4, seed=1, dtype=torch.float64)

    def change(picture: torch.Tensor) -> torch.Tensor:
        return enhancer._change(picture, style) if widths else picture[:, :3]

    before, farthest = change(features), 0
    for offset in range(enhancer.stride):
        place = enhancer.reach + 2 + offset
        moved = features.clone()
        moved[:, :, place, place] += 1
        rows, columns = torch.nonzero((change(moved) - before).abs().amax(dim=(0, 1)) > 1e-12).T
        farthest = max(farthest, int((rows - place).abs().max()), int((columns - place).abs().max()))
    assert farthest == enhancer.reach


def test_colours_beyond_the_range_are_not_stuck_there() -> None:
    colours = torch.tensor([-0.5, 0.5, 1.5], requires_grad=True)
    said = clipped(colours)
    assert said.tolist() == [0.0, 0.5, 1.0]
    said.sum().backward()
    assert colours.grad is not None
    assert colours.grad.tolist() == [1.0, 1.0, 1.0]


def test_inserted_objects_keep_their_colours_and_so_does_their_contour() -> None:
    enhancer = trained_like((4, 8))
    features, style = drawn(1, 5, 20, 30), drawn(1, 4, seed=1)
    kept = torch.zeros(1, 1, 20, 30)
    kept[0, 0, 10, 12:16] = 1
    free, said = enhancer(features, style), enhancer(features, style, kept)
    own = torch.zeros(20, 30, dtype=torch.bool)
    own[10 - CONTOUR_PX : 11 + CONTOUR_PX, 12 - CONTOUR_PX : 16 + CONTOUR_PX] = True
    assert torch.equal(said[0, :, own], features[0, :3, own].clamp(0, 1))
    assert torch.equal(said[0, :, ~own], free[0, :, ~own])
    assert not torch.equal(said, free)


def test_a_pixel_half_covered_by_an_inserted_object_keeps_half() -> None:
    pictures, colours = torch.full((1, 3, 4, 4), 0.2), torch.full((1, 3, 4, 4), 0.6)
    kept = torch.zeros(1, 1, 4, 4)
    kept[0, 0, 1, 1] = 0.5
    said = with_kept(pictures, colours, kept, contour_px=0)
    assert float(said[0, 0, 1, 1]) == pytest.approx(0.4)
    assert torch.equal(said[kept.expand_as(said) == 0], pictures[kept.expand_as(said) == 0])


def test_it_learns_what_depends_on_neighbours_and_on_the_style() -> None:
    torch.manual_seed(0)
    enhancer = Enhancer(4, 2, EnhancerOptions(widths=(6, 8)))
    optimiser = torch.optim.Adam(enhancer.parameters(), 1e-2)
    styles = torch.tensor([[1.0, 0.0], [0.0, 1.0]])

    def pair(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
        features = drawn(2, 4, 16, 16, seed=seed)
        features[:, :3] = 0.5
        # A shadow to the right of the fourth feature in one style, to the left in the other.
        shade = 0.15 * features[:, 3:].clamp(-2, 2)
        return features, features[:, :3] - torch.stack([shade[0].roll(2, dims=2), shade[1].roll(-2, dims=2)])

    def error(seed: int) -> torch.Tensor:
        features, wanted = pair(seed)
        return (enhancer(features, styles) - wanted)[..., 2:-2].square().mean()

    before = error(999).item()
    for step in range(100):
        optimiser.zero_grad()
        error(step).backward()
        optimiser.step()
    assert error(999).item() < 0.1 * before


def test_half_the_digits_give_nearly_the_same_picture() -> None:
    enhancer, features, styles = trained_like((4, 6, 8)), drawn(1, 5, 24, 24), drawn(1, 4, seed=1)
    features[:, :3] = 0.5 + 0.1 * features[:, :3]
    enhancer.outward.weight.data *= 0.1
    whole = enhancer(features, styles)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        rounded = enhancer(features, styles)
    assert rounded.dtype == torch.float32
    assert float((rounded - whole).abs().max()) < 0.02


def test_features_without_colours_are_refused() -> None:
    with pytest.raises(ValueError, match="features: expected 3 or more, .* got 2"):
        Enhancer(2, 4, EnhancerOptions(widths=(4,)))
