"""A backdrop painted once through a wide lens and read through every camera that turns and zooms about one place."""

import cv2
import numba
import numpy as np
from jaxtyping import Float32

from pgm_data.simulate.camera import pixels_of, undistorted
from pgm_data.simulate.pictures.picture import Brush, Canvas
from pgm_data.simulate.pictures.world import World
from pgm_data.simulate.views import View

MARGIN = 0.2
"""How much further the wide lens sees on each side, as a share of the picture."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _places(straight, M, across, down):
    """Where each pixel's pinhole ray meets the wide picture: `across` and `down` (H, W), pixels."""
    for row in range(straight.shape[0]):
        for column in range(straight.shape[1]):
            x, y = straight[row, column, 0], straight[row, column, 1]
            w = 1.0 / (M[2, 0] * x + M[2, 1] * y + M[2, 2])
            across[row, column] = (M[0, 0] * x + M[0, 1] * y + M[0, 2]) * w
            down[row, column] = (M[1, 0] * x + M[1, 1] * y + M[1, 2]) * w


def wide_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the wide lens's picture."""
    width, height = size
    return 2 * round((0.5 + MARGIN) * width), 2 * round((0.5 + MARGIN) * height)


def wide_view(view: View, size: tuple[int, int]) -> View:
    """The same camera without distortion and with a margin on each side."""
    wide = wide_size(size)
    K = view.K.copy()
    K[0, 2] += (wide[0] - size[0]) / 2
    K[1, 2] += (wide[1] - size[1]) / 2
    return View(K=K, k1=0.0, R_cam_from_world=view.R_cam_from_world, centre_world=view.centre_world)


def covers(wide: View, view: View, size: tuple[int, int]) -> bool:
    """Whether the wide picture holds, sharply enough, all that a camera at the same place sees."""
    if not np.array_equal(wide.centre_world, view.centre_world) or not 0.8 < view.K[0, 0] / wide.K[0, 0] < 1.12:
        return False
    edge = np.linspace(0.0, 1.0, 5)
    rim = np.concatenate([np.stack([edge, 0 * edge + s], -1) for s in (0.0, 1.0)])
    rim = np.concatenate([rim, rim[:, ::-1]]) * (np.array(size) - 1)
    rays = undistorted((rim - view.K[:2, 2]) / view.K[[0, 1], [0, 1]], view.k1)
    world = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ view.R_cam_from_world + view.centre_world
    px = pixels_of(world, wide.K, 0.0, wide.R_cam_from_world, wide.t_cam_from_world)
    inside = (px >= 0.0) & (px <= np.array(wide_size(size)) - 1)
    return bool(inside.all())


def read_through(
    image: Float32[np.ndarray, "height width 3"],
    straight: Float32[np.ndarray, "height width 2"],
    picture: Float32[np.ndarray, "tall broad 3"],
    wide: View,
    view: View,
) -> None:
    """Fill `image` with what a camera, whose pixels' pinhole rays are `straight`, sees of a wide picture; bilinear."""
    M = wide.K @ wide.R_cam_from_world @ view.R_cam_from_world.T
    across, down = np.empty(straight.shape[:2], np.float32), np.empty(straight.shape[:2], np.float32)
    _places(straight, M, across, down)
    cv2.remap(picture, across, down, cv2.INTER_LINEAR, dst=image, borderMode=cv2.BORDER_REPLICATE)


class WideBackdrop:
    """A world's backdrop through a wide lens, painted anew when a camera leaves what it holds."""

    def __init__(self, size: tuple[int, int]) -> None:
        """For pictures of this size (width, height)."""
        self._size = size
        self._canvas = Canvas(*wide_size(size))
        self._view: View | None = None

    def read(self, canvas: Canvas, view: View, world: World, noise: np.ndarray) -> None:
        """Fill the canvas, aimed by this view, with the world's backdrop."""
        if self._view is None or not covers(self._view, view, self._size):
            self._view = wide_view(view, self._size)
            Brush(self._canvas, self._view).backdrop(world, noise)
        read_through(canvas.image, canvas.straight, self._canvas.image, self._view, view)
