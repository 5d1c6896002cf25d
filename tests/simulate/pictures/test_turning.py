"""A backdrop read through turning cameras lies where painting it anew puts it."""

from dataclasses import replace

import numpy as np

from pgm_data.simulate.pictures.picture import Brush, Canvas
from pgm_data.simulate.pictures.shapes import polygons, rectangle
from pgm_data.simulate.pictures.turning import covers, read_through, wide_size, wide_view
from pgm_data.simulate.views import Pose

SIZE = (640, 360)
POSE = Pose(
    centre_world=np.array([0.5, -35.0, 9.0]), heading=0.01, tilt=-0.22, roll=0.004, focal_px=900.0,
    principal_px=(322.0, 178.0), k=0.04,
)  # fmt: skip


def _centroid(image: np.ndarray) -> np.ndarray:
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    weight = image[..., 0]
    return np.array([(columns * weight).sum(), (rows * weight).sum()]) / weight.sum()


def test_painted_things_stay_in_place_to_a_twentieth_of_a_pixel() -> None:
    wide_pose = wide_view(POSE.view(SIZE), SIZE)
    for x, y in ((-4.0, -8.0), (3.0, 2.0), (5.0, 11.0)):
        group = polygons([(rectangle(x, x + 0.5, y, y + 1.5), np.ones(3), 1.0)])
        big, small = Canvas(*wide_size(SIZE)), Canvas(*SIZE)
        Brush(big, wide_pose).flat(group)
        for turn, zoom in ((0.0, 1.0), (0.04, 1.05), (-0.05, 0.97)):
            view = replace(POSE, heading=POSE.heading + turn, focal_px=POSE.focal_px * zoom).view(SIZE)
            assert covers(wide_pose, view, SIZE)
            small.aim(view)
            read = np.zeros_like(small.image)
            read_through(read, small.straight, big.image, wide_pose, view)
            small.image[:] = 0.0
            Brush(small, view).flat(group)
            assert np.abs(_centroid(read) - _centroid(small.image)).max() < 0.05


def test_a_camera_that_looks_past_the_margin_or_stands_elsewhere_is_not_covered() -> None:
    wide = wide_view(POSE.view(SIZE), SIZE)
    assert covers(wide, POSE.view(SIZE), SIZE)
    assert not covers(wide, replace(POSE, heading=0.5).view(SIZE), SIZE)
    assert not covers(wide, replace(POSE, focal_px=1500.0).view(SIZE), SIZE)
    assert not covers(wide, replace(POSE, centre_world=np.array([0.5, -35.0, 9.1])).view(SIZE), SIZE)
