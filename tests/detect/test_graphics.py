"""Graphics that stay while the scene moves."""

import numpy as np

from pgm_data.detect.graphics import GraphicsOptions, boxes_that_stay

HIGH, WIDE = 180, 320


def scenes(shift: int, count: int = 30) -> np.ndarray:
    """A textured scene that passes by with a level line along its motion, under a scoreboard."""
    rng = np.random.default_rng(3)
    world = np.repeat(np.repeat(rng.integers(40, 200, (HIGH // 6, 400)), 6, axis=0), 6, axis=1).astype(np.uint8)
    world[100:103] = 255
    pictures = np.stack([world[:, shift * i : shift * i + WIDE] for i in range(count)]).copy()
    board = np.full((24, 80), 20, np.uint8)
    board[4:20:8, 6:70] = 230
    board[4:20, 10:70:12] = 230
    pictures[:, 140:164, 20:100] = board
    noise = rng.normal(0, 2, pictures.shape)
    return np.clip(pictures + noise, 0, 255).astype(np.uint8)


def test_a_scoreboard_is_found_and_a_line_along_the_motion_is_not():
    boxes = boxes_that_stay(scenes(17), GraphicsOptions())
    assert len(boxes) == 1
    np.testing.assert_allclose(boxes[0], [19.5, 139.5, 99.5, 163.5], atol=12)


def test_nothing_is_found_where_nothing_stays():
    pictures = scenes(17)
    pictures[:, 140:164, 20:100] = np.random.default_rng(0).integers(0, 255, (len(pictures), 24, 80))
    assert len(boxes_that_stay(pictures, GraphicsOptions())) == 0
