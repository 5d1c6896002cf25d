import math

import numpy as np
import pytest
import torch

from pgm_data.geometry.camera import Camera
from pgm_models.synthesis.balls import Balls, ball_boxes, ball_shares, blur_share, optical_of_share
from pgm_models.synthesis.rays import Rays, camera_rays, picture_pixels
from pgm_models.synthesis.samples import OPAQUE
from tests.models.synthesis.toy_bodies import looking

FOCAL, SIZE, RADIUS = 300.0, (24, 18), 0.0335


def camera_of(roll: float = 0.4) -> Camera:
    return looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0], focal=FOCAL, size=SIZE, roll=roll)


def ball(position: list[float], path: list[float], radius: float = RADIUS) -> Balls:
    return Balls(position=torch.tensor([position]), path=torch.tensor([path]), radius=radius)


def swept(rays: Rays, balls: Balls, *, spots: int, times: int, seed: int = 0) -> np.ndarray:
    """Share of each pixel and of the exposure that a moving sphere covers, by looking at many places and times."""
    rng = np.random.default_rng(seed)
    parts = [part.double().numpy() for part in (rays.origin, rays.direction, rays.across, rays.down)]
    position, path = balls.position[0].double().numpy(), balls.path[0].double().numpy()
    held = np.zeros(len(rays))
    for x in range(spots):
        for y in range(spots):
            at = (np.array([x, y])[:, None] + rng.random((2, len(rays)))) / spots - 0.5
            direction = parts[1] + at[0][:, None] * parts[2] + at[1][:, None] * parts[3]
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            time = (np.arange(times) + rng.random(times)) / times - 0.5
            offset = position + time[:, None] * path - parts[0][0]
            along = direction @ offset.T
            held += (((offset**2).sum(axis=1) - along**2 < balls.radius**2) & (along > 0)).mean(axis=1)
    return held / spots**2


PATHS = {
    "still": ([0.01, 0.0, 1.01], [0.0, 0.0, 0.0]),
    "slow": ([0.01, 0.0, 1.01], [0.01, 0.0, 0.006]),
    "along a row": ([0.0, 0.0, 1.0], [0.2, 0.0, 0.0]),
    "steep": ([0.02, 0.1, 1.0], [0.04, 0.02, 0.16]),
    "towards the camera": ([0.005, 0.0, 1.0], [0.0, -0.4, 0.0]),
}


@pytest.mark.parametrize("name", PATHS)
def test_shares_are_those_of_a_moving_sphere_looked_for_at_many_places_and_times(name: str) -> None:
    rays = camera_rays(camera_of(), picture_pixels(*SIZE))
    balls = ball(*PATHS[name])
    share, depth = ball_shares(rays, balls)
    moves = name not in ("still", "towards the camera")
    expected = swept(rays, balls, spots=10 if moves else 24, times=60 if moves else 4)
    np.testing.assert_allclose(share, expected, atol=0.03)
    np.testing.assert_allclose(float(share.sum()), expected.sum(), rtol=0.01)
    assert (torch.isfinite(depth) == (share > 0)).all()
    np.testing.assert_allclose(depth[share > 0], 5.0, atol=0.2)


@pytest.mark.parametrize("radius", [0.15, 0.0335, 0.004, 1e-4])
@pytest.mark.parametrize("path", [[0.0, 0.0, 0.0], [1e-7, 0.0, 0.0], [0.003, 0.0, 0.002], [0.1, 0.02, 0.05]])
def test_all_pixels_together_keep_the_area_of_a_ball_however_small(radius: float, path: list[float]) -> None:
    rays = camera_rays(looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0], focal=FOCAL, size=(36, 36)), picture_pixels(36, 36))
    area = math.pi * (FOCAL * radius / 5.0) ** 2
    for shift in (0.0, 0.0071):  # pixels are 0.0167 m wide there
        share, _ = ball_shares(rays, ball([shift, 0.0, 1.0 + 0.7 * shift], path, radius))
        assert float(share.sum()) == pytest.approx(area, rel=0.02)
        assert float(share.max()) <= 1.0


def test_a_pixel_within_a_ball_is_full_and_one_far_from_it_empty() -> None:
    rays = camera_rays(camera_of(), picture_pixels(*SIZE))
    share, depth = ball_shares(rays, ball([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], 0.05))
    picture = share.reshape(SIZE[1], SIZE[0])
    assert float(picture[8, 11]) == pytest.approx(1.0, abs=1e-6)
    assert float(picture[0].sum() + picture[:, 0].sum()) == 0.0
    assert torch.isinf(depth[share == 0]).all()


def test_half_a_pixel_is_half_covered() -> None:
    """The edge of a ball that seems straight from near runs through the middle of a pixel."""
    camera = looking([0.0, -5.0, 1.0], [0.0, 0.0, 1.0], focal=1e5, size=(3, 1))
    rays = camera_rays(camera, picture_pixels(3, 1))
    share, _ = ball_shares(rays, ball([1.0, 0.0, 1.0], [0.0, 0.0, 0.0], 1.0))
    np.testing.assert_allclose(share, [0.0, 0.5, 1.0], atol=2e-3)


def test_a_ball_of_enormous_speed_leaves_a_faint_even_streak_and_one_of_endless_speed_none() -> None:
    rays = camera_rays(camera_of(roll=0.0), picture_pixels(*SIZE))
    for length in (1e3, 1e9, 1e20):
        share, _ = ball_shares(rays, ball([0.0, 0.0, 1.0], [length, 0.0, 0.0], 0.05))
        # Every place of the streak is covered for as long as the ball takes for its own chord.
        rows = share.reshape(SIZE[1], SIZE[0]).sum(dim=0) * length
        np.testing.assert_allclose(rows, math.pi * 0.05**2 * FOCAL / 5.0, rtol=5e-3)
    for path in ([torch.inf, 0.0, 0.0], [torch.nan] * 3):
        assert (ball_shares(rays, ball([0.0, 0.0, 1.0], path))[0] == 0).all()


def test_balls_that_are_missing_behind_or_beside_are_not_seen_and_one_round_the_camera_is_all() -> None:
    rays = camera_rays(camera_of(), picture_pixels(*SIZE))
    for position in ([torch.nan] * 3, [0.0, -9.0, 1.0], [3.0, 0.0, 1.0], [0.0, 0.0, -4.0]):
        share, depth = ball_shares(rays, ball(position, [0.1, 0.0, 0.0]))
        assert (share == 0).all() and torch.isinf(depth).all()
    inside, _ = ball_shares(rays, ball([0.0, -4.9, 1.0], [0.0, 0.0, 0.0], 0.5))
    np.testing.assert_allclose(inside, 1.0, atol=1e-6)
    assert ball_shares(rays[torch.zeros(0, dtype=torch.int64)], ball([0.0, 0.0, 1.0], [0.0] * 3))[0].shape == (0,)


def test_each_ray_looks_for_the_ball_of_its_own_frame() -> None:
    rays = camera_rays(camera_of(), picture_pixels(*SIZE))
    both = Balls(
        position=torch.tensor([[0.05, 0.0, 1.0], [torch.nan] * 3, [-0.05, 0.0, 1.02]]),
        path=torch.zeros(3, 3),
        radius=0.05,
    )
    assert both.present.tolist() == [True, False, True]
    for frame in range(3):
        own = Rays(**{**vars(rays), "frame": torch.full_like(rays.frame, frame)})
        alone = Balls(position=both.position[frame : frame + 1], path=both.path[frame : frame + 1], radius=0.05)
        torch.testing.assert_close(ball_shares(own, both)[0], ball_shares(rays, alone)[0])


def test_boxes_hold_the_ball_at_all_times() -> None:
    balls = ball([1.0, 2.0, 3.0], [0.4, -0.2, 0.0])
    boxes = ball_boxes(balls)
    for time in np.linspace(-0.5, 0.5, 5):
        middle = balls.position[0] + float(time) * balls.path[0]
        assert (middle - RADIUS >= boxes.low[0] - 1e-6).all() and (middle + RADIUS <= boxes.high[0] + 1e-6).all()
    np.testing.assert_allclose(boxes.high[0], [1.2 + RADIUS, 2.1 + RADIUS, 3.0 + RADIUS], rtol=1e-6)


@pytest.mark.parametrize("length", [0.0, 1e-8, 1e-3, 0.05, 0.5, 1e7])
def test_the_papers_blur_is_the_share_of_the_time_in_which_a_point_is_held(length: float) -> None:
    rng = np.random.default_rng(0)
    path = length * np.array([0.6, 0.0, -0.8])
    points = rng.uniform(-0.05, 0.05, (300, 3)) + rng.uniform(-0.5, 0.5, (300, 1)) * path * rng.choice([0, 1], (300, 1))
    times = (np.arange(4001) + 0.5) / 4001 - 0.5
    if length < 1e5:
        apart = np.linalg.norm(points[:, None] - times[:, None] * path, axis=2)
        expected = (apart <= RADIUS).mean(axis=1)
    else:  # held while it passes
        aside = points - (points @ path)[:, None] * path / length**2
        expected = 2 * np.sqrt(np.maximum(RADIUS**2 - (aside**2).sum(axis=1), 0)) / length
    found = blur_share(torch.tensor(points), torch.tensor(path), RADIUS)
    edge = np.abs(np.linalg.norm(points, axis=1) - RADIUS) < 1e-6
    np.testing.assert_allclose(found[~edge], expected[~edge], atol=6e-4 if length < 1e5 else 1e-10)
    assert (found > 0).any() and (found <= 1).all()


def test_optical_depth_of_a_share_hides_that_share() -> None:
    share = torch.tensor([0.0, 1e-6, 0.3, 0.999, 1.0])
    optical = optical_of_share(share)
    np.testing.assert_allclose(-torch.expm1(-optical), share, rtol=1e-5)
    assert float(optical[-1]) == OPAQUE and float(optical[0]) == 0.0
