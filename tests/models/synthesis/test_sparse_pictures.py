import pytest
import torch

from pgm_models.synthesis.renderer import Rendered
from pgm_models.synthesis.sparse_pictures import (
    CELL_PX,
    Upsampler,
    cell_of_pixels,
    followed_pixels,
    near_cells,
    spread,
)

SIZES = [(72, 128), (5, 7), (1, 1), (4, 9), (2, 3)]


@pytest.mark.parametrize("size", SIZES)
def test_each_cell_follows_one_of_its_own_pixels_and_each_pixel_has_a_cell(size: tuple[int, int]) -> None:
    height, width = size
    followed, cell = followed_pixels(height, width), cell_of_pixels(height, width)
    assert len(followed) == -(-height // CELL_PX) * -(-width // CELL_PX)
    assert torch.equal(cell[followed], torch.arange(len(followed)))
    for pixel, own in enumerate(cell.tolist()):
        y, x = divmod(pixel, width)
        there = divmod(int(followed[own]), width)
        assert abs(y - there[0]) < CELL_PX and abs(x - there[1]) < CELL_PX


def test_what_is_followed_of_a_rectangle_are_its_pixels_that_are() -> None:
    followed = followed_pixels(12, 16)
    rectangle = (torch.arange(3, 9)[:, None] * 16 + torch.arange(4, 14)).flatten()
    found = near_cells(rectangle, followed)
    assert sorted(followed[found].tolist()) == sorted(set(followed.tolist()) & set(rectangle.tolist()))
    assert len(found) == 3  # row 5, columns 5, 9 and 13
    assert not len(near_cells(rectangle[:0], followed))


def test_what_rays_saw_is_spread_over_their_cells() -> None:
    cell = cell_of_pixels(6, 10)
    rays = len(followed_pixels(6, 10))
    seen = Rendered(
        features=torch.rand(rays, 4),
        depth=torch.rand(rays),
        shares=torch.rand(rays, 2),
        inserted=None,
        looked_at=5,
        dressed=4,
    )
    whole = spread(seen, cell)
    assert whole.features.shape == (60, 4) and whole.looked_at == 5 and whole.inserted is None
    for pixel in range(60):
        assert torch.equal(whole.features[pixel], seen.features[cell[pixel]])
        assert whole.depth[pixel] == seen.depth[cell[pixel]]


@pytest.mark.parametrize("size", SIZES)
def test_the_full_picture_is_made_of_the_followed_pixels_alone(size: tuple[int, int]) -> None:
    torch.manual_seed(0)
    upsampler, (height, width) = Upsampler(5, width=4), size
    features = torch.randn(2, 5, height, width)
    made = upsampler(features)
    assert made.shape == (2, 3, height, width) and made.min() >= 0 and made.max() <= 1
    others = torch.ones(height * width, dtype=torch.bool)
    others[followed_pixels(height, width)] = False
    changed = features.flatten(2).clone()
    changed[:, :, others] = 9.0
    assert torch.equal(upsampler(changed.unflatten(2, size)), made)
    changed[:, :, ~others] += 1.0
    assert not torch.equal(upsampler(changed.unflatten(2, size)), made)
