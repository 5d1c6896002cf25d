import itertools

import numpy as np
import pytest
import torch
from scipy.interpolate import RegularGridInterpolator
from torch.nn import functional

from pgm_models.synthesis.grids import (
    SLOW_VALUES,
    Convolution3d,
    Grown,
    corners_of,
    fetched,
    first_corners,
    mixed,
    near_any,
)
from tests.models.synthesis.toy_bodies import drawn

SIZES = [(5, 4, 7), (2, 2, 2), (3, 9), (6, 1, 4), (1, 5), (8,), (1, 1, 1)]


@pytest.mark.parametrize("size", [(5, 4, 7), (2, 2, 2), (3, 9)])
def test_values_between_cells_are_those_of_scipy(size: tuple[int, ...]) -> None:
    table = drawn(int(np.prod(size)), 3, dtype=torch.float64)
    points = torch.rand(200, len(size), dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    axes = [np.linspace(0.0, 1.0, cells) for cells in size]
    expected = RegularGridInterpolator(axes, table.numpy().reshape(*size, 3))(points.numpy())
    np.testing.assert_allclose(fetched(table, points, size), expected, atol=1e-12)


def test_values_between_cells_are_those_of_torch() -> None:
    size, table = (5, 4, 7), drawn(140, 3)
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(1))
    volume = table.T.reshape(1, 3, *size)
    at = (2 * points - 1).flip(1).reshape(1, 1, 1, 200, 3)
    expected = functional.grid_sample(volume, at, align_corners=True)[0, :, 0, 0].T
    torch.testing.assert_close(fetched(table, points, size), expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_weights_add_up_to_one_and_cells_exist_even_on_the_border_and_beyond(size: tuple[int, ...]) -> None:
    ends = torch.tensor(list(itertools.product([-3.0, 0.0, 0.4, 1.0, 1.0 + 1e-7, 9.0, torch.inf], repeat=len(size))))
    rows, weights = corners_of(ends, size)
    assert rows.shape == weights.shape == (len(ends), 2 ** len(size))
    assert int(rows.min()) >= 0 and int(rows.max()) < np.prod(size)
    torch.testing.assert_close(weights.sum(dim=1), torch.ones(len(ends)))
    assert (weights >= 0).all()
    clamped = corners_of(ends.clamp(0.0, 1.0), size)
    torch.testing.assert_close(weights, clamped[1])
    assert (rows == clamped[0]).all()
    assert (first_corners(ends, size) == rows[:, 0]).all()


@pytest.mark.parametrize("size", SIZES)
def test_cells_are_found_at_their_own_places(size: tuple[int, ...]) -> None:
    cells = np.stack(np.meshgrid(*[np.linspace(0, 1, n) for n in size], indexing="ij"), -1).reshape(-1, len(size))
    table = drawn(len(cells), 2)
    torch.testing.assert_close(fetched(table, torch.tensor(cells).float(), size), table, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_near_any_knows_of_all_cells_around_a_point(size: tuple[int, ...]) -> None:
    filled = torch.rand(int(np.prod(size)), 2, generator=torch.Generator().manual_seed(0)) < 0.2
    points = torch.rand(300, len(size), generator=torch.Generator().manual_seed(1))
    rows, _ = corners_of(points, size)
    found = near_any(filled, size)[first_corners(points, size)]
    assert (found == filled[rows].any(dim=1)).all()


def test_gradients_reach_cells_and_places() -> None:
    size = (3, 4, 2)
    table = drawn(24, 2, dtype=torch.float64).requires_grad_(True)
    points = torch.rand(6, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(4)).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda t, p: fetched(t, p, size), (table, points), atol=1e-6)


def test_no_points_and_half_precision_are_fetched() -> None:
    table = drawn(24, 5)
    assert fetched(table, torch.zeros(0, 3), (2, 3, 4)).shape == (0, 5)
    rows, weights = corners_of(torch.rand(9, 3, generator=torch.Generator().manual_seed(0)), (2, 3, 4))
    found = mixed(table.half(), rows, weights)
    assert found.dtype == torch.float16
    torch.testing.assert_close(found.float(), mixed(table, rows, weights), atol=5e-3, rtol=5e-3)


@pytest.mark.parametrize(
    ("size", "width"), [((16, 16, 16), 8), ((5, 9, 17), 4), ((33, 7), 6), ((4, 4), 3), ((1, 8), 4), ((2, 1, 3), 10)]
)
def test_grids_grow_to_their_size_the_same_from_the_same_seed(size: tuple[int, ...], width: int) -> None:
    torch.manual_seed(0)
    grown = Grown(size, 5, width=width, seed=3)
    cells = grown()
    assert cells.shape == (np.prod(size), 5) and torch.isfinite(cells).all()
    torch.testing.assert_close(grown(), cells)
    assert (Grown(size, 5, width=width, seed=3).noise == grown.noise).all()
    assert not (Grown(size, 5, width=width, seed=4).noise == grown.noise).any()
    cells.square().sum().backward()
    assert all(p.grad is not None and torch.isfinite(p.grad).all() for p in grown.parameters())


def test_cells_run_along_the_last_axis_first() -> None:
    grown = Grown((4, 3, 2), 1, width=1, seed=0)
    volume = torch.arange(24.0).reshape(1, 1, 4, 3, 2)
    bias = grown.out.bias
    assert bias is not None
    with torch.no_grad():
        bias.zero_()
        grown.steps = torch.nn.ModuleList([torch.nn.Identity()])
        grown.noise = volume
        grown.out.weight.copy_(torch.ones_like(grown.out.weight))
        assert grown()[:, 0].tolist() == list(range(24))
        at = torch.tensor([[2 / 3, 0.5, 1.0]])
        assert float(fetched(grown(), at, (4, 3, 2))) == pytest.approx(float(volume[0, 0, 2, 1, 1]))


@pytest.mark.parametrize("size", [(4,), (4, 4, 4, 4), (0, 3), (3, -1, 2)])
def test_sizes_of_other_kinds_are_refused(size: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="size: expected two or three numbers of 1 or more, got"):
        Grown(size, 2, width=4, seed=0)


@pytest.mark.parametrize("size", [(5, 4, 7), (1, 3, 2), (2, 1, 1), (1, 1, 1), (72, 72, 2)])
def test_convolutions_over_volumes_are_those_of_torch(size: tuple[int, int, int]) -> None:
    torch.manual_seed(0)
    layer = Convolution3d(4, 6).double()
    inputs = drawn(1, 4, *size, dtype=torch.float64).requires_grad_()
    assert (4 * size[0] * size[1] > SLOW_VALUES) == (size == (72, 72, 2))  # either side of the border between two ways
    expected = functional.conv3d(inputs, layer.weight, layer.bias, padding=1)
    found = layer(inputs)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)
    back = drawn(*expected.shape, seed=1, dtype=torch.float64)
    given = [inputs, *layer.parameters()]
    for own, other in zip(
        torch.autograd.grad(found, given, back), torch.autograd.grad(expected, given, back), strict=True
    ):
        torch.testing.assert_close(own, other, rtol=1e-12, atol=1e-10)
    assert set(layer.state_dict()) == {"weight", "bias"} and layer.weight.shape == (6, 4, 3, 3, 3)
