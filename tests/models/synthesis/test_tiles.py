import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_models.synthesis.enhancer import Enhancer
from pgm_models.synthesis.presets import EnhancerOptions
from pgm_models.synthesis.tiles import (
    TILE_PX,
    StaticLayer,
    changed_pixels,
    enhanced_where_changed,
    rectangles,
    static_layer,
    touched_tiles,
)

WIDTHS = [(), (4,), (4, 4), (4, 4, 8), (2, 2, 2, 2, 2)]


def trained_like(widths: tuple[int, ...]) -> Enhancer:
    """One that changes colours."""
    torch.manual_seed(0)
    enhancer = Enhancer(5, 4, EnhancerOptions(widths=widths))
    for parameter in enhancer.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    return enhancer.requires_grad_(False)


def layer_of(enhancer: Enhancer, height: int, width: int) -> StaticLayer:
    generator = torch.Generator().manual_seed(1)
    return static_layer(
        enhancer, torch.rand(1, 5, height, width, generator=generator), torch.randn(1, 4, generator=generator)
    )


def moved(layer: StaticLayer, *places: tuple[slice, slice]) -> torch.Tensor:
    """The layer's features with others in those places."""
    features = layer.features.clone()
    for number, place in enumerate(places):
        part = features[(..., *place)]
        part.copy_(torch.rand(part.shape, generator=torch.Generator().manual_seed(number + 2)))
    return features


ENHANCERS = {widths: trained_like(widths) for widths in WIDTHS}


@settings(max_examples=40)
@given(data=st.data(), widths=st.sampled_from(WIDTHS), height=st.integers(1, 150), width=st.integers(1, 190))
def test_enhanced_where_changed_is_enhanced_as_a_whole(data, widths, height: int, width: int) -> None:
    enhancer = ENHANCERS[widths]
    layer = layer_of(enhancer, height, width)
    places = []
    for _ in range(data.draw(st.integers(0, 3))):
        top, left = data.draw(st.integers(0, height - 1)), data.draw(st.integers(0, width - 1))
        places.append(
            (slice(top, top + data.draw(st.integers(1, 9))), slice(left, left + data.draw(st.integers(1, 9))))
        )
    features = moved(layer, *places)
    said = enhanced_where_changed(enhancer, layer, features, changed_pixels(layer, features))
    assert float((said - enhancer(features, layer.styles)).abs().max()) < 1e-5


@pytest.mark.parametrize("widths", WIDTHS)
def test_inserted_objects_are_kept_wherever_they_are(widths: tuple[int, ...]) -> None:
    enhancer = ENHANCERS[widths]
    layer = layer_of(enhancer, 90, 120)
    features = moved(layer, (slice(10, 20), slice(0, 9)))
    kept = torch.zeros(1, 1, 90, 120)
    kept[0, 0, 12:18, 2:6] = 1
    kept[0, 0, 70, 100] = 0.5
    said = enhanced_where_changed(enhancer, layer, features, changed_pixels(layer, features), kept)
    assert float((said - enhancer(features, layer.styles, kept)).abs().max()) < 1e-5


def test_a_frame_without_a_change_is_the_layer_and_costs_nothing() -> None:
    enhancer = ENHANCERS[4, 4, 8]
    layer = layer_of(enhancer, 50, 60)
    seen = []
    with enhancer.register_forward_hook(lambda module, inputs, output: seen.append(output.shape)):
        said = enhanced_where_changed(enhancer, layer, layer.features, changed_pixels(layer, layer.features))
    assert torch.equal(said, layer.picture)
    assert said is not layer.picture
    assert not seen


def test_a_changed_tenth_in_two_places_costs_a_third_at_most() -> None:
    enhancer = ENHANCERS[4, 4, 8]
    layer = layer_of(enhancer, 576, 1024)
    before = layer.picture.clone()
    features = moved(layer, (slice(330, 530), slice(300, 448)), (slice(40, 240), slice(600, 748)))
    changed = changed_pixels(layer, features)
    assert float(changed.float().mean()) == pytest.approx(0.1, abs=0.001)
    pixels = []
    with enhancer.register_forward_hook(lambda module, inputs, output: pixels.append(output.shape[2:].numel())):
        said = enhanced_where_changed(enhancer, layer, features, changed)
    assert sum(pixels) < 576 * 1024 / 3
    assert torch.equal(layer.picture, before)
    assert float((said - enhancer(features, layer.styles)).abs().max()) < 1e-5


def test_a_frame_that_changed_all_over_is_enhanced_once_as_a_whole() -> None:
    enhancer = ENHANCERS[4, 4, 8]
    layer = layer_of(enhancer, 64, 96)
    features = moved(layer, (slice(None), slice(None)))
    sizes = []
    with enhancer.register_forward_hook(lambda module, inputs, output: sizes.append(tuple(output.shape[2:]))):
        said = enhanced_where_changed(enhancer, layer, features, changed_pixels(layer, features))
    assert sizes == [(64, 96)]
    assert torch.equal(said, enhancer(features, layer.styles))


def test_a_pixel_changed_in_one_feature_is_found_and_no_other() -> None:
    layer = layer_of(ENHANCERS[4, 4], 12, 9)
    features = layer.features.clone()
    features[0, 4, 11, 8] += 1e-6
    found = changed_pixels(layer, features)
    assert torch.nonzero(found).tolist() == [[11, 8]]


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**31),
    height=st.integers(1, 40),
    width=st.integers(1, 40),
    tile=st.sampled_from([1, 4, 8]),
    reach=st.integers(0, 20),
)
def test_touched_tiles_are_those_within_reach_of_a_change(seed, height, width, tile, reach) -> None:
    changed = np.random.default_rng(seed).random((height, width)) < 0.01
    expected = np.zeros((-(-height // tile), -(-width // tile)), dtype=bool)
    for row, column in np.argwhere(changed):
        for i, j in np.ndindex(*expected.shape):
            down = max(i * tile - row, row - (i * tile + tile - 1), 0)
            across = max(j * tile - column, column - (j * tile + tile - 1), 0)
            expected[i, j] |= max(down, across) <= reach
    assert np.array_equal(touched_tiles(torch.from_numpy(changed), tile, reach), expected)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), share=st.sampled_from([0.0, 0.01, 0.05, 0.5]), margin=st.sampled_from([0, 8, 40]))
def test_rectangles_cover_every_touched_tile(seed: int, share: float, margin: int) -> None:
    touched = np.random.default_rng(seed).random((18, 25)) < share
    covered = np.zeros((18, 25), dtype=bool)
    for (top, left), (bottom, right) in rectangles(touched, 8, margin) // 8:
        assert 0 <= top < bottom <= 18
        assert 0 <= left < right <= 25
        covered[top:bottom, left:right] = True
    assert not (touched & ~covered).any()


def test_rectangles_close_to_each_other_are_made_one_and_distant_ones_not() -> None:
    touched = np.zeros((60, 100), dtype=bool)
    touched[2:6, 2:6] = touched[2:6, 8:10] = touched[50:55, 90:95] = True
    found = rectangles(touched, TILE_PX, 16)
    assert sorted(found.tolist()) == [[[16, 16], [48, 80]], [[400, 720], [440, 760]]]


def test_a_frame_of_another_size_is_refused() -> None:
    layer = layer_of(ENHANCERS[4, 4], 12, 9)
    with pytest.raises(ValueError, match=r"features: expected \(1, 5, 12, 9\) .* got \(1, 5, 12, 8\)"):
        changed_pixels(layer, layer.features[..., :8])
    with pytest.raises(ValueError, match="features: expected"):
        enhanced_where_changed(
            ENHANCERS[4, 4], layer, layer.features[..., :8], torch.zeros(12, 8, dtype=torch.bool), None
        )
