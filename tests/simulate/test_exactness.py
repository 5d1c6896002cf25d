"""The painted lines lie where OpenCV's own projection of the truth says, to a small part of a pixel."""

import cv2
import numpy as np
import pytest

from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.painter import paint_flat
from pgm_data.simulate.picture import Canvas
from pgm_data.simulate.shapes import line_rectangles, polygons
from pgm_data.simulate.views import View, framed_pose

SIZE = (1280, 720)


def _view(k: float, shift: tuple[float, float] = (0.0, 0.0), roll: float = 0.004) -> View:
    return framed_pose(
        centre_world=np.array([0.6, -38.0, 9.0]),
        aim_world=np.array([0.3, -2.0, 0.0]),
        aim_px=(640.0, 390.0),
        roll=roll,
        focal_px=2000.0,
        principal_px=(639.5 + shift[0], 359.5 + shift[1]),
        k=k,
    )


def _opencv_pixels(points: np.ndarray, view: View) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(view.R_cam_from_world)
    lens = np.array([view.k1, 0.0, 0.0, 0.0])
    px, _ = cv2.projectPoints(points, rotation, view.t_cam_from_world, view.K, lens)
    return px[:, 0]


def _painted_line(scene: Scene, view: View, line: int) -> np.ndarray:
    """The picture of one white line on black, 0 to 1."""
    assert scene.court is not None
    canvas = Canvas(*SIZE)
    group = polygons([(c, np.ones(3), 1.0) for i, c in line_rectangles(scene.court) if i == line])
    seen, limits = canvas.aim(view)
    none = np.zeros((0, 0), np.float32)
    paint_flat(canvas.image, canvas.cover, group.corners, group.starts, group.colours, group.alphas, seen, limits, none)
    assert not canvas.cover.any()
    return canvas.image[..., 0].astype(float)


def _centre_errors(picture: np.ndarray, points: np.ndarray, view: View) -> np.ndarray:
    """Distance across the line between the paint's centroid and the projected centre line, at these points of it."""
    px = _opencv_pixels(points, view)
    errors = []
    for i in range(1, len(px) - 1):
        along = px[i + 1] - px[i - 1]
        steep = abs(along[1]) > abs(along[0])
        middle = px[i]
        if not (15 < middle[0] < SIZE[0] - 15 and 15 < middle[1] < SIZE[1] - 15):
            continue
        fixed = int(round(middle[1] if steep else middle[0]))
        # Where the centre line crosses this row or column, along its local direction.
        if steep:
            expected = middle[0] + along[0] / along[1] * (fixed - middle[1])
            profile = picture[fixed]
        else:
            expected = middle[1] + along[1] / along[0] * (fixed - middle[0])
            profile = picture[:, fixed]
        low = int(expected) - 12
        window = profile[low : low + 25]
        found = low + np.sum(window * np.arange(25)) / np.sum(window)
        slope = np.hypot(*along) / (abs(along[1]) if steep else abs(along[0]))
        errors.append((found - expected) / slope)
    return np.array(errors)


@pytest.mark.parametrize("k", [0.0, 0.03, 0.05])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (61.3, -40.7)])
def test_every_painted_line_is_centred_on_the_projected_truth(k: float, shift: tuple[float, float]) -> None:
    """Within 0.02 px, a fifth of what a solver of 0.1 px needs, at both ends of the court."""
    scene = load_scene("tennis")
    assert scene.court is not None
    view = _view(k, shift)
    for line, (start, end) in enumerate(scene.court.lines_world):
        points = start + np.linspace(0.03, 0.97, 120)[:, None] * (end - start)
        errors = _centre_errors(_painted_line(scene, view, line), points, view)
        assert len(errors) > 40
        assert np.abs(errors).max() < 0.02, f"{scene.court.line_names[line]}: {np.abs(errors).max():.4f} px"
        assert abs(errors.mean()) < 0.004
