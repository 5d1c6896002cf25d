from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_models.synthesis.boxes import NEAREST_M, Boxes, box_spans, screen_rectangle
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from tests.models.synthesis.slow_renderer import box_span, single_rays
from tests.models.synthesis.toy_bodies import looking, rays_towards


def box(low: list[float], high: list[float]) -> Boxes:
    return Boxes(low=torch.tensor([low]), high=torch.tensor([high]))


def test_spans_are_those_of_one_ray_at_a_time_and_of_their_own_frames() -> None:
    rng = np.random.default_rng(0)
    low = rng.normal(size=(3, 3))
    boxes = Boxes(low=torch.tensor(low).float(), high=torch.tensor(low + rng.uniform(1, 4, (3, 3))).float())
    rays = rays_towards(3 * rng.normal(size=(200, 3)), 1 + rng.normal(size=(200, 3)), rng.integers(0, 3, 200))
    rays.direction[::7, 0] = 0.0
    rays.direction[::11, 2] = -0.0
    spans = box_spans(rays, boxes)
    assert 20 < int(spans.met.sum()) < 180
    for number, ray in enumerate(single_rays(rays)):
        expected = box_span(ray, boxes.low[ray.frame].numpy(), boxes.high[ray.frame].numpy())
        assert bool(spans.met[number]) == (expected is not None)
        if expected is not None:
            np.testing.assert_allclose([spans.near[number], spans.far[number]], expected, rtol=1e-4, atol=1e-5)


def test_a_camera_inside_a_box_sees_it_from_the_nearest_depth_and_one_in_front_of_its_back_does_not() -> None:
    rays = rays_towards(np.zeros((2, 3)), np.array([[0.0, 2.0, 0.0], [1.0, 2.0, 3.0]]))
    spans = box_spans(rays, box([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]))
    assert spans.met.all() and (spans.near == NEAREST_M).all()
    assert float(spans.far[0]) == 1.0
    assert not box_spans(rays, box([-1.0, -3.0, -1.0], [1.0, -2.0, 1.0])).met.any()


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ([0.0, 5.0, 0.0], [0.0, 5.0, 0.0]),  # a point on the ray
        ([-1.0, 5.0, -1.0], [1.0, 5.0, 1.0]),  # a wall without thickness
        ([1.0, 6.0, 1.0], [-1.0, 5.0, -1.0]),  # inside out
        ([torch.nan] * 3, [torch.nan] * 3),
        ([-1.0, 5.0, torch.nan], [1.0, 6.0, 1.0]),
        ([torch.inf] * 3, [-torch.inf] * 3),
        ([0.0, 5.0, -1.0], [1.0, 6.0, 1.0]),  # the ray runs in the plane of a face
    ],
)
def test_boxes_without_volume_and_missing_ones_are_missed(low: list[float], high: list[float]) -> None:
    rays = rays_towards(np.zeros((1, 3)), np.array([[0.0, 2.0, 0.0]]))
    spans = box_spans(rays, box(low, high))
    assert not spans.met.any()
    assert torch.isfinite(spans.near).all() and torch.isfinite(spans.far).all()


def test_rays_that_graze_a_box_stay_finite() -> None:
    rays = rays_towards(np.zeros((4, 3)), np.array([[0.0, 2.0, 0.0]] * 4))
    rays.direction[:, 0] = torch.tensor([1e-38, -1e-38, 1e-44, 0.0])  # hardly any way to the side
    spans = box_spans(rays, box([-1.0, 3.0, -1.0], [1.0, 4.0, 1.0]))
    torch.testing.assert_close(spans.near, torch.full((4,), 3.0))
    torch.testing.assert_close(spans.far, torch.full((4,), 4.0))


@pytest.mark.parametrize("seed", range(6))
def test_no_ray_outside_its_screen_rectangle_meets_a_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = looking(
        (4 * rng.normal(size=3)).tolist(), rng.normal(size=3).tolist(), focal=40.0, roll=rng.uniform(-3, 3)
    )
    if seed % 2:
        camera = replace(camera, distortion=np.array([-0.1, 0.02, 0.01, 0.01]))
    met_any = False
    for _ in range(8):
        low = 3 * rng.normal(size=3)
        high = low + rng.uniform(0.05, 1.5, 3)
        found = screen_rectangle(camera, low, high, 64, 48)
        rays = camera_rays(camera, picture_pixels(64, 48))
        spans = box_spans(rays, Boxes(low=torch.tensor(low)[None].float(), high=torch.tensor(high)[None].float()))
        met = spans.met.reshape(48, 64)
        met_any |= bool(met.any())
        if found is None:
            assert not met.any()
            continue
        left, top, right, bottom = found
        assert 0 <= left < right <= 64 and 0 <= top < bottom <= 48
        inside = torch.zeros_like(met)
        inside[top:bottom, left:right] = True
        assert not (met & ~inside).any()
        if min(left, top) > 0 and right < 64 and bottom < 48 and met.any():  # wholly in the picture
            rows, columns = torch.nonzero(met, as_tuple=True)
            assert int(columns.min()) - left < 8 and right - int(columns.max()) < 8
            assert int(rows.min()) - top < 8 and bottom - int(rows.max()) < 8
    assert met_any


def test_boxes_behind_the_camera_beside_the_picture_and_missing_ones_have_no_rectangle() -> None:
    camera = looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0])
    at = {
        "behind": [0.0, -7.0, 1.0],
        "beside": [30.0, 0.0, 1.0],
        "missing": [np.nan, 0.0, 1.0],
    }
    for place in at.values():
        assert screen_rectangle(camera, np.array(place), np.array(place) + 0.5, 64, 48) is None
    around = screen_rectangle(camera, np.array([-1.0, -6.0, 0.0]), np.array([1.0, -4.0, 2.0]), 64, 48)
    assert around == (0, 0, 64, 48)
    ahead = screen_rectangle(camera, np.array([-0.1, 0.0, 0.9]), np.array([0.1, 0.2, 1.1]), 64, 48)
    assert ahead is not None and ahead != (0, 0, 64, 48)


def test_a_box_past_the_fold_of_a_lens_may_be_anywhere() -> None:
    camera = replace(looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0], focal=30.0), distortion=np.array([-0.4, 0, 0, 0]))
    assert screen_rectangle(camera, np.array([3.0, -1.0, 0.0]), np.array([9.0, 0.0, 2.0]), 64, 48) == (0, 0, 64, 48)
