from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.geometry.camera import Camera, project
from pgm_models.synthesis.rays import camera_rays, joined_rays, picture_pixels
from tests.models.synthesis.toy_bodies import looking


def bent_lens(skew: float = 0.0) -> Camera:
    camera = looking([3.0, -12.0, 5.0], [0.5, 0.0, 1.0], focal=90.0, roll=0.3)
    K = camera.K + np.array([[0.0, skew, 3.0], [0.0, 7.0, -2.0], [0.0, 0.0, 0.0]])
    return replace(camera, K=K, distortion=np.array([-0.2, 0.05, 0.01, -0.02]))


@settings(max_examples=20)
@given(st.floats(0, 63), st.floats(0, 47), st.floats(0.1, 80.0))
def test_points_of_a_ray_are_seen_in_its_pixel(x: float, y: float, depth: float) -> None:
    for camera in (looking([3.0, -12.0, 5.0], [0.5, 0.0, 1.0]), bent_lens()):
        rays = camera_rays(camera, np.array([[x, y]]), frame=3)
        pixels, seen = project(camera, rays.at(torch.tensor([depth])).double().numpy())
        assert seen.all() and rays.frame.tolist() == [3]
        np.testing.assert_allclose(pixels, [[x, y]], atol=3e-3)
        np.testing.assert_allclose(rays.direction.norm(dim=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("camera", [looking([3.0, -12.0, 5.0], [0.5, 0.0, 1.0]), bent_lens(), bent_lens(skew=4.0)])
def test_directions_change_across_and_down_as_those_of_the_next_pixels_do(camera: Camera) -> None:
    pixels = picture_pixels(64, 48)[::37]
    rays, step = camera_rays(camera, pixels), 0.01
    for change, axis in ((rays.across, 0), (rays.down, 1)):
        moved = np.zeros(2)
        moved[axis] = step
        from pgm_data.geometry.camera import rays as directions_of

        expected = (directions_of(camera, pixels + moved) - directions_of(camera, pixels - moved)) / (2 * step)
        np.testing.assert_allclose(change.numpy(), expected, atol=2e-5 * np.abs(expected).max())


def test_pixels_of_a_rectangle_run_row_by_row() -> None:
    assert picture_pixels(3, 2, left=5, top=7).tolist() == [[5, 7], [6, 7], [7, 7], [5, 8], [6, 8], [7, 8]]
    assert picture_pixels(1, 1).tolist() == [[0, 0]]
    assert len(picture_pixels(0, 5)) == 0


def test_rays_are_chosen_and_joined_in_order() -> None:
    camera = looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0])
    first, second = (camera_rays(camera, picture_pixels(4, 2), frame=frame) for frame in (0, 1))
    both = joined_rays([first, second])
    assert len(both) == 16 and both.frame.tolist() == [0] * 8 + [1] * 8
    chosen = both[torch.tensor([9, 2])]
    assert chosen.frame.tolist() == [1, 0]
    torch.testing.assert_close(chosen.direction, torch.stack([second.direction[1], first.direction[2]]))
    assert len(both[torch.zeros(16, dtype=torch.bool)]) == 0


def test_a_missing_camera_and_a_pixel_beyond_the_lens_are_named() -> None:
    camera = looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0])
    none = Camera(**{name: np.full_like(values, np.nan) for name, values in vars(camera).items()})
    with pytest.raises(ValueError, match="camera: expected one that is there, got NaN"):
        camera_rays(none, picture_pixels(2, 2))
    folded = replace(camera, distortion=np.array([-2.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="pixels: expected some that the lens has a ray for"):
        camera_rays(folded, np.array([[31.5, 23.5], [4000.0, 0.0]]))


def test_a_camera_of_one_pixel_has_one_ray() -> None:
    camera = looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0], focal=1.0, size=(1, 1))
    rays = camera_rays(camera, picture_pixels(1, 1))
    torch.testing.assert_close(rays.direction, torch.tensor([[0.0, 1.0, 0.0]]), atol=1e-6, rtol=0)
