"""The painter's weights are exact areas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.pictures.foreign import foreign_lines
from pgm_data.simulate.pictures.painter import MAX_CORNERS, paint_flat, paint_texture
from pgm_data.simulate.pictures.people import draw_cast
from pgm_data.simulate.pictures.shapes import polygons

WIDE, TALL = 24, 18
NONE = np.zeros((0, 0), np.float32)


def _weights(corners_px: np.ndarray, keep: np.ndarray = NONE) -> np.ndarray:
    """Weights of a polygon given by pixels, seen by a camera of focal length 1 at z = 0, whose plane is z = 1."""
    corners = np.concatenate([corners_px, np.ones((len(corners_px), 1))], axis=1)
    view = np.zeros(17)
    view[:2] = 1.0
    view[5:14] = np.eye(3).ravel()
    limits = np.array([-50.0, 80.0, -50.0, 80.0])
    image = np.zeros((TALL, WIDE, 3), np.float32)
    cover = np.zeros((TALL, WIDE + 2), np.float32)
    group = polygons([(corners, np.ones(3), 1.0)])
    paint_flat(image, cover, group.corners, group.starts, group.colours, group.alphas, view, limits, keep)
    assert not cover.any()
    return image[..., 0].astype(float)


def _counted(corners_px: np.ndarray, samples: int = 24) -> np.ndarray:
    """The slow obvious way: the share of a pixel's sample points that lie inside a convex polygon."""
    at = (np.arange(samples) + 0.5) / samples - 0.5
    x = (np.arange(WIDE)[:, None] + at).ravel()
    y = (np.arange(TALL)[:, None] + at).ravel()
    gx, gy = np.meshgrid(x, y)
    sides = []
    for a, b in zip(corners_px, np.roll(corners_px, -1, axis=0), strict=True):
        sides.append((b[0] - a[0]) * (gy - a[1]) - (b[1] - a[1]) * (gx - a[0]))
    inside = (np.array(sides) >= 0).all(axis=0) | (np.array(sides) <= 0).all(axis=0)
    return inside.reshape(TALL, samples, WIDE, samples).mean(axis=(1, 3))


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1))
def test_weights_are_the_shares_of_pixels_inside_even_beyond_the_borders(seed: int) -> None:
    corners = np.random.default_rng(seed).uniform([-8, -8], [WIDE + 8, TALL + 8], (3, 2))
    np.testing.assert_allclose(_weights(corners), _counted(corners), atol=0.05)


def test_a_rectangle_between_pixels_has_exact_weights() -> None:
    corners = np.array([[2.25, 3.0], [5.5, 3.0], [5.5, 4.75], [2.25, 4.75]])
    weights = _weights(corners)
    np.testing.assert_allclose(weights[3, 2:7], [0.125, 0.5, 0.5, 0.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(weights[4, 2:7], [0.25, 1.0, 1.0, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(weights[5, 2:7], [0.0625, 0.25, 0.25, 0.25, 0.0], atol=1e-6)
    assert weights.sum() == pytest.approx(3.25 * 1.75, abs=1e-5)


def test_direction_round_a_polygon_does_not_matter() -> None:
    corners = np.array([[1.3, 2.0], [9.1, 3.3], [6.2, 11.0], [2.0, 8.0]])
    np.testing.assert_allclose(_weights(corners), _weights(corners[::-1]), atol=1e-6)


def test_what_lies_behind_the_camera_is_not_painted() -> None:
    view = np.zeros(17)
    view[:2] = 1.0
    view[5:14] = np.eye(3).ravel()
    corners = np.array([[0.0, 0.0, -1.0], [5.0, 0.0, -1.0], [5.0, 5.0, -1.0]])
    image = np.zeros((TALL, WIDE, 3), np.float32)
    cover = np.zeros((TALL, WIDE + 2), np.float32)
    args = (corners, np.array([0, 3]), np.ones((1, 3)), np.ones(1), view, np.array([-9.0, 99.0, -9.0, 99.0]), NONE)
    paint_flat(image, cover, *args)
    assert not image.any()


def test_worn_paint_is_weaker_by_the_given_share() -> None:
    corners = np.array([[2.0, 2.0], [9.0, 2.0], [9.0, 9.0], [2.0, 9.0]])
    keep = np.full((TALL, WIDE), 0.25, np.float32)
    np.testing.assert_allclose(_weights(corners, keep), 0.25 * _weights(corners), atol=1e-6)


def test_a_texture_lands_with_its_pixels_where_the_homography_puts_them() -> None:
    view = np.zeros(17)
    view[:2] = 1.0
    view[5:14] = np.eye(3).ravel()
    texture = np.random.default_rng(0).integers(0, 255, (16, 16, 3)).astype(np.uint8)
    image = np.zeros((TALL, WIDE, 3), np.float32)
    cover = np.zeros((TALL, WIDE + 2), np.float32)
    y, x = np.mgrid[:TALL, :WIDE].astype(np.float32)
    corners = np.array([[-1.0, -1, 1], [30, -1, 1], [30, 30, 1], [-1, 30, 1]])
    limits = np.array([-2.0, 40.0, -2.0, 40.0])
    shift = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 5.0], [0.0, 0.0, 1.0]])
    args = (np.stack([x, y], -1), shift, texture, np.zeros(3), np.ones(3), 1.0, False, np.zeros((0, 8, 3), np.uint8))
    paint_texture(image, cover, corners, view, limits, *args)
    wrapped = texture[(np.arange(TALL) + 5) % 16][:, (np.arange(WIDE) + 3) % 16]
    np.testing.assert_allclose(image, wrapped, atol=1e-3)


def test_no_shape_has_more_corners_than_the_painter_keeps() -> None:
    rng = np.random.default_rng(0)
    cast = draw_cast(rng, 2)
    for figure in (*cast.standing, *cast.seated, *cast.playing, *cast.chairs):
        assert np.diff(figure.starts).max() <= MAX_CORNERS
    court = load_scene("badminton").court
    assert court is not None
    for _ in range(30):
        assert all(len(corners) <= MAX_CORNERS for corners, _, _ in foreign_lines(rng, [court], 1.0))
