import numpy as np
import pytest
import torch

from pgm_models.synthesis.grids import corners_of, mixed
from pgm_models.synthesis.stylists import COLOURS, Stylist, baked, dressed
from tests.models.synthesis.slow_renderer import array, slow_stylist
from tests.models.synthesis.toy_bodies import drawn

SIZE, CELLS = (3, 4, 2), 24


def stylist_of(inputs: int = 5, style: int = 4, features: int = 7) -> Stylist:
    torch.manual_seed(0)
    made = Stylist(inputs, style, features, hidden=8)
    torch.nn.init.normal_(made.shift.weight)
    return made


def around(points: int) -> tuple[torch.Tensor, torch.Tensor]:
    return corners_of(torch.rand(points, 3, generator=torch.Generator().manual_seed(1)), SIZE)


def test_features_are_those_of_weights_that_the_style_scales_row_by_row() -> None:
    stylist, values, styles = stylist_of(), drawn(9, 5), drawn(3, 4, seed=1)
    frame = torch.tensor([0, 2, 1, 1, 0, 2, 2, 0, 1])
    found = stylist(values, frame, styles)
    for row in range(9):
        expected = slow_stylist(stylist, array(values[row]), array(styles[frame[row]]))
        np.testing.assert_allclose(found[row].detach(), expected, atol=1e-5)
    alone = stylist(values, torch.zeros(9, dtype=torch.int64), styles[:1])
    torch.testing.assert_close(alone[[0, 4, 7]], found[[0, 4, 7]])


def test_colours_stay_within_zero_and_one_and_the_rest_does_not() -> None:
    stylist = stylist_of()
    found = stylist(100 * drawn(50, 5), torch.zeros(50, dtype=torch.int64), 10 * drawn(1, 4, seed=2)).detach()
    assert (found[:, :COLOURS] >= 0).all() and (found[:, :COLOURS] <= 1).all()
    assert float(found[:, COLOURS:].abs().max()) > 1.5
    assert torch.isfinite(found).all()


def test_dressing_by_grid_interpolates_dressed_cells_and_by_sample_dresses_what_is_interpolated() -> None:
    stylist, values, styles = stylist_of(), drawn(CELLS, 5), drawn(3, 4, seed=1)
    rows, shares = around(40)
    frame = torch.arange(40) % 3
    grid = dressed(stylist, values, rows, shares, frame, styles, "grid")
    sample = dressed(stylist, values, rows, shares, frame, styles, "sample")
    whole = baked(stylist, values, styles)
    torch.testing.assert_close(grid, mixed(whole, rows + (frame * CELLS)[:, None], shares), atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(sample, stylist(mixed(values, rows, shares), frame, styles))
    assert float((grid - sample).detach().abs().max()) > 1e-3
    at_cells = torch.arange(CELLS)[:, None], torch.ones(CELLS, 1), torch.zeros(CELLS, dtype=torch.int64)
    same = [dressed(stylist, values, *at_cells, styles, stylising) for stylising in ("grid", "sample")]  # type: ignore[arg-type]
    torch.testing.assert_close(same[0], same[1], atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("stylising", ["grid", "sample"])
def test_nothing_is_dressed_of_no_points(stylising) -> None:
    stylist, none = stylist_of(), torch.zeros(0, dtype=torch.int64)
    rows, shares = none[:, None].expand(0, 8), torch.zeros(0, 8)
    found = dressed(stylist, drawn(CELLS, 5), rows, shares, none, drawn(2, 4), stylising)
    assert found.shape == (0, 7)


@pytest.mark.parametrize("stylising", ["grid", "sample"])
def test_gradients_reach_values_styles_shares_and_weights(stylising) -> None:
    stylist = stylist_of().double()
    values = drawn(CELLS, 5, dtype=torch.float64).requires_grad_(True)
    styles = drawn(2, 4, seed=1, dtype=torch.float64).requires_grad_(True)
    rows, shares = around(6)
    shares = shares.double().requires_grad_(True)
    frame = torch.tensor([0, 1, 0, 1, 1, 0])

    def features(values: torch.Tensor, styles: torch.Tensor, shares: torch.Tensor) -> torch.Tensor:
        return dressed(stylist, values, rows, shares, frame, styles, stylising)

    assert torch.autograd.gradcheck(features, (values, styles, shares), fast_mode=True)
    features(values, styles, shares).square().sum().backward()
    assert all(p.grad is not None and torch.isfinite(p.grad).all() for p in stylist.parameters())
