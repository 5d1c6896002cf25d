"""The painted lines lie where OpenCV's own projection of the truth says, to a small part of a pixel."""

from typing import Literal

import cv2
import numpy as np
import pytest

from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.clip import simulate_clip
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.pictures.painter import paint_fine, paint_flat
from pgm_data.simulate.pictures.picture import Canvas
from pgm_data.simulate.pictures.shapes import in_pieces, line_rectangles, polygons
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
    ).view(SIZE)


def _opencv_pixels(points: np.ndarray, view: View) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(view.R_cam_from_world)
    lens = np.array([view.k1, 0.0, 0.0, 0.0])
    px, _ = cv2.projectPoints(points, rotation, view.t_cam_from_world, view.K, lens)
    return px[:, 0]


def _painted_line(scene: Scene, view: View, line: int, fine: bool) -> np.ndarray:
    """The picture of one white line on black, 0 to 1."""
    assert scene.court is not None
    canvas = Canvas(*SIZE, fine=fine)
    group = in_pieces(polygons([(c, np.ones(3), 1.0) for i, c in line_rectangles(scene.court) if i == line]), 2.0)
    seen, limits = canvas.aim(view)
    none = np.zeros((0, 0), np.float32)
    if fine:
        args = (group.corners, group.starts, group.colours[0], group.alphas, seen, limits, none)
        paint_fine(canvas.image, canvas.layer, canvas.fine_cover, *args)
        assert not canvas.layer.any() and not canvas.fine_cover.any()
    else:
        args = (group.corners, group.starts, group.colours, group.alphas, seen, limits, none)
        paint_flat(canvas.image, canvas.cover, *args)
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


def _inner_points(scene: Scene, line: int) -> np.ndarray:
    """Points along a line's centre, away from its ends and from where other lines interrupt its paint."""
    assert scene.court is not None
    start, end = scene.court.lines_world[line]
    points = start + np.linspace(0.03, 0.97, 120)[:, None] * (end - start)
    if abs(end[1] - start[1]) > abs(end[0] - start[0]):
        across = np.unique(scene.court.points_world[:, 1])
        points = points[(np.abs(points[:, 1:2] - across) > 0.8).all(axis=1)]
    return points


@pytest.mark.parametrize("k", [0.0, 0.03, 0.05])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (61.3, -40.7)])
def test_every_painted_line_is_centred_on_the_projected_truth(k: float, shift: tuple[float, float]) -> None:
    """Near lines within 0.01 px, far ones, 0.4 px thin, within 0.03 px at every place and 0.005 px on average."""
    scene = load_scene("tennis")
    assert scene.court is not None
    view = _view(k, shift)
    for line, name in enumerate(scene.court.line_names):
        errors = _centre_errors(_painted_line(scene, view, line, fine=True), _inner_points(scene, line), view)
        assert len(errors) > 40
        allowed = 0.03 if "service_line" in name else 0.012
        assert np.abs(errors).max() < allowed, f"{name}: {np.abs(errors).max():.4f} px"
        assert abs(errors.mean()) < 0.006, f"{name}: {errors.mean():.4f} px on average"


def test_draft_lines_are_centred_on_average_but_not_at_every_place() -> None:
    scene = load_scene("tennis")
    errors = []
    for line in range(2):
        painted = _painted_line(scene, _view(0.03), line, fine=False)
        errors.append(_centre_errors(painted, _inner_points(scene, line), _view(0.03)))
    assert abs(np.concatenate(errors).mean()) < 0.02
    assert np.abs(np.concatenate(errors)).max() > 0.05


@pytest.mark.parametrize("surface, seed", [("clay", 12), ("grass", 12)])
def test_in_a_whole_clean_picture_the_near_baseline_lies_at_the_truth(
    surface: Literal["clay", "grass"], seed: int
) -> None:
    """Everything drawn and nothing spoilt: the middle of what is brighter than the ground on both sides."""
    scene = load_scene("tennis")
    assert scene.court is not None
    clip = simulate_clip(scene, ClipOptions(frames=1, clean=True, motion="still", surface=surface), seed)
    picture = next(clip.frames()).astype(float).mean(axis=2)
    track = clip.track
    rotation, _ = cv2.Rodrigues(track.R_cam_from_world[0])
    start, end = scene.court.lines_world[scene.court.line_names.index("near_baseline")]
    points = np.linspace(start, end, 80)[4:-4]
    lens = track.distortion[0]
    errors = []
    for u, v in cv2.projectPoints(points, rotation, track.t_cam_from_world[0], track.K[0], lens)[0][:, 0]:
        if 8 < u < SIZE[0] - 9 and 8 < v < SIZE[1] - 9:
            column = picture[int(v) - 6 : int(v) + 8, int(round(u))]
            rise = np.clip(column - np.median(np.r_[column[:3], column[-3:]]) - 6.0, 0.0, None)
            if rise.max() > 20.0:
                errors.append(int(v) - 6 + float(rise @ np.arange(len(rise)) / rise.sum()) - v)
    assert len(errors) > 40
    assert abs(np.median(errors)) < 0.03
