import math
from itertools import permutations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_models.synthesis.boxes import Spans
from pgm_models.synthesis.samples import (
    OPAQUE,
    Samples,
    along_rays,
    joined_samples,
    overlapping,
    passed_before,
    summed,
    uniform_samples,
    weights_of,
)
from tests.models.synthesis.toy_bodies import drawn


def spans(*ends: tuple[float, float]) -> Spans:
    near, far = torch.tensor(ends).T
    return Spans(near=near, far=far)


def slow_weights(ray: list[int], optical: list[float]) -> list[float]:
    """Light let through one sample after the other."""
    passed: dict[int, float] = {}
    found = []
    for one, depth in zip(ray, optical, strict=True):
        before = passed.get(one, 1.0)
        found.append(before * (1.0 - math.exp(-depth)))
        passed[one] = before * math.exp(-depth)
    return found


def test_spans_are_cut_into_equal_intervals_and_missed_ones_into_none() -> None:
    samples = uniform_samples(spans((2.0, 6.0), (3.0, 3.0), (1.0, 2.0)), 4)
    assert samples.ray.tolist() == [0] * 4 + [2] * 4
    np.testing.assert_allclose(samples.depth, [2.5, 3.5, 4.5, 5.5, 1.125, 1.375, 1.625, 1.875])
    np.testing.assert_allclose(samples.length, [1.0] * 4 + [0.25] * 4)
    assert len(uniform_samples(spans((1.0, 1.0)), 3)) == 0
    assert uniform_samples(spans((1.0, 2.0)), 1).depth.tolist() == [1.5]
    with pytest.raises(ValueError, match="count: expected 1 or more samples a ray, got 0"):
        uniform_samples(spans((1.0, 2.0)), 0)


def test_jittered_samples_stay_in_their_intervals() -> None:
    jitter = torch.rand(3, 5, generator=torch.Generator().manual_seed(0))
    jitter[0, 0], jitter[2, 4] = 0.0, 1.0
    some = spans((2.0, 7.0), (3.0, 3.0), (1.0, 2.0))
    still, moved = uniform_samples(some, 5), uniform_samples(some, 5, jitter=jitter)
    torch.testing.assert_close(moved.depth, still.depth + still.length * (jitter[[0, 2]].flatten() - 0.5))
    torch.testing.assert_close(moved.length, still.length)
    assert (moved.depth.reshape(2, 5).diff(dim=1) >= 0).all()


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 3), st.floats(0, 60)), max_size=30))
def test_weights_are_light_let_through_one_sample_after_the_other(rows: list[tuple[int, float]]) -> None:
    rows = sorted(rows, key=lambda row: row[0])
    ray, optical = [row[0] for row in rows], [row[1] for row in rows]
    found = weights_of(torch.tensor(ray, dtype=torch.int64), torch.tensor(optical))
    np.testing.assert_allclose(found, slow_weights(ray, optical), atol=1e-6)
    total = summed(torch.tensor(ray, dtype=torch.int64), found, 4)
    assert ((total >= 0) & (total <= 1 + 1e-6)).all()


def test_opaque_samples_hide_all_behind_them_however_dense_they_are() -> None:
    ray = torch.tensor([0, 0, 0, 1, 1])
    optical = torch.tensor([0.5, torch.inf, torch.inf, 3e38, 1.0], requires_grad=True)
    weights = weights_of(ray, optical)
    np.testing.assert_allclose(weights.detach(), [1 - math.exp(-0.5), math.exp(-0.5), 0.0, 1.0, 0.0], atol=1e-7)
    weights.sum().backward()
    assert optical.grad is not None and torch.isfinite(optical.grad).all()
    assert float(weights_of(torch.tensor([0]), torch.tensor([OPAQUE]))[0]) == 1.0


def test_thin_samples_keep_their_digits() -> None:
    optical = torch.full((5,), 1e-10)
    np.testing.assert_allclose(weights_of(torch.zeros(5, dtype=torch.int64), optical), optical, rtol=1e-6)


def test_half_precision_keeps_what_it_can() -> None:
    ray = torch.arange(40).repeat_interleave(50)
    optical = drawn(2000).abs()
    full = weights_of(ray, optical.half().float())
    half = weights_of(ray, optical.half())
    assert half.dtype == torch.float16 and torch.isfinite(half).all()
    np.testing.assert_allclose(half.float(), full, atol=2e-3)


def test_a_million_samples_of_other_rays_take_no_digits() -> None:
    own = drawn(100, seed=1).abs() * 0.05
    before = torch.full((1_000_000,), 1e4)
    ray = torch.cat([torch.arange(1_000_000) // 100, torch.full((100,), 10_000)])
    optical = torch.cat([before, own])
    np.testing.assert_allclose(
        weights_of(ray, optical)[-100:], slow_weights([0] * 100, own.tolist()), rtol=1e-5, atol=1e-8
    )
    # Clamped, as weights take them, 1e-7 is left of a sum of forty million.
    clamped = passed_before(ray, optical.clamp(max=OPAQUE))[-100:]
    expected = np.cumsum(own.double().numpy()) - own.double().numpy()
    np.testing.assert_allclose(clamped, expected, rtol=1e-6, atol=1e-7)


def test_nothing_is_composed_of_no_samples() -> None:
    none = torch.zeros(0, dtype=torch.int64)
    assert weights_of(none, torch.zeros(0)).shape == (0,)
    assert summed(none, torch.zeros(0, 3), 4).tolist() == [[0.0] * 3] * 4
    assert along_rays(Samples(ray=none, depth=torch.zeros(0), length=torch.zeros(0))).shape == (0,)


def composed(parts: list[tuple[Samples, torch.Tensor, torch.Tensor]], rays: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Colours and opacity of samples with optical depths and colours."""
    samples, _ = joined_samples([part[0] for part in parts])
    optical, colours = torch.cat([part[1] for part in parts]), torch.cat([part[2] for part in parts])
    order = along_rays(samples)
    weights = weights_of(samples.ray[order], optical[order])
    return summed(samples.ray[order], weights[:, None] * colours[order], rays), summed(
        samples.ray[order], weights, rays
    )


@pytest.mark.parametrize("gap", [0.0, 1e-3, 1.0, 300.0])
def test_two_boxes_keep_their_own_opacity_whatever_the_gap_between_them(gap: float) -> None:
    densities, parts, near = (0.7, 1.9), [], 2.0
    for number, density in enumerate(densities):
        samples = uniform_samples(spans((near, near + 1.5)), 6)
        colour = torch.eye(2)[number].expand(6, 2)
        parts.append((samples, density * samples.length, colour))
        near += 1.5 + gap
    colours, opacity = composed(parts, 1)
    first, second = (1 - math.exp(-1.5 * density) for density in densities)
    np.testing.assert_allclose(colours, [[first, (1 - first) * second]], atol=1e-6)
    np.testing.assert_allclose(opacity, [1 - (1 - first) * (1 - second)], atol=1e-6)


def test_boxes_through_each_other_keep_their_opacity_too() -> None:
    parts = []
    for number, (ends, density) in enumerate((((2.0, 5.0), 0.4), ((3.0, 4.1), 1.1))):
        samples = uniform_samples(spans(ends), 7)
        parts.append((samples, density * samples.length, torch.eye(2)[number].expand(7, 2)))
    _, opacity = composed(parts, 1)
    np.testing.assert_allclose(opacity, [1 - math.exp(-3.0 * 0.4 - 1.1 * 1.1)], atol=1e-6)


def test_the_order_of_objects_does_not_matter() -> None:
    rng, parts = np.random.default_rng(0), []
    for number in range(4):
        near = torch.tensor(rng.uniform(1, 4, 20)).float()
        samples = uniform_samples(Spans(near=near, far=near + torch.tensor(rng.uniform(0.1, 3, 20)).float()), 5)
        parts.append((samples, drawn(100, seed=number).abs(), drawn(100, 3, seed=number + 9)))
    expected = composed(parts, 20)
    for order in list(permutations(range(4)))[::5]:
        found = composed([parts[place] for place in order], 20)
        torch.testing.assert_close(found, expected, atol=1e-6, rtol=1e-5)


def test_samples_are_ordered_by_ray_then_depth_and_stay_in_order_where_both_are_equal() -> None:
    samples = Samples(
        ray=torch.tensor([1, 0, 1, 0, 1]), depth=torch.tensor([2.0, 5.0, 1.0, 5.0, 2.0]), length=torch.ones(5)
    )
    assert along_rays(samples).tolist() == [1, 3, 2, 0, 4]
    joined, part = joined_samples([samples, samples[torch.tensor([2, 0])]])
    assert part.tolist() == [0] * 5 + [1] * 2 and joined.depth.tolist() == [2, 5, 1, 5, 2, 1, 2]


def test_gradients_of_composition_are_right() -> None:
    ray = torch.tensor([0, 0, 0, 2, 2, 3])
    optical = drawn(6, dtype=torch.float64).abs().requires_grad_(True)
    colours = drawn(6, 3, seed=1, dtype=torch.float64).requires_grad_(True)

    def seen(optical: torch.Tensor, colours: torch.Tensor) -> torch.Tensor:
        return summed(ray, weights_of(ray, optical)[:, None] * colours, 4)

    assert torch.autograd.gradcheck(seen, (optical, colours))


def test_overlaps_are_where_both_spans_are() -> None:
    first = spans((1.0, 3.0), (1.0, 3.0), (1.0, 3.0), (2.0, 2.0), (1.0, 4.0))
    second = spans((2.0, 4.0), (3.0, 5.0), (4.0, 5.0), (1.0, 3.0), (2.0, 3.0))
    assert overlapping(first, second).tolist() == [True, False, False, False, True]
