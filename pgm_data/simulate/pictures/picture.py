"""One picture of a world through a camera, before the camera's and the broadcast's own flaws."""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.camera import undistorted
from pgm_data.simulate.pictures.painter import (
    FINE,
    paint_fine,
    paint_flat,
    paint_texture,
    straight_rays,
    texture_ground,
)
from pgm_data.simulate.pictures.shapes import Plane, Polygons
from pgm_data.simulate.pictures.world import World
from pgm_data.simulate.views import View

NOTHING_WORN = np.zeros((0, 0), np.float32)


class Canvas:
    """Buffers of one picture size, reused from picture to picture."""

    def __init__(self, width: int, height: int, *, fine: bool = False) -> None:
        """Allocate for pictures of width x height pixels; `fine` keeps the centres of lines thinner than a pixel."""
        self.width, self.height, self.fine = width, height, fine
        self.image = np.zeros((height, width, 3), np.float32)
        self.cover = np.zeros((height, width + 2), np.float32)
        self.straight = np.zeros((height, width, 2), np.float32)
        self.keep = np.ones((height, width), np.float32)
        self._rays_of: bytes = b""
        if fine:
            self.layer = np.zeros((height, width), np.float32)
            self.fine_cover = np.zeros((FINE * (height + 2), FINE * (width + 2) + 2), np.float32)

    def aim(self, view: View) -> tuple[np.ndarray, np.ndarray]:
        """The view and its clipping limits as the painter reads them; refreshes the pinhole rays."""
        K, R, t = view.K, view.R_cam_from_world, view.t_cam_from_world
        packed = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2], view.k1], R.ravel(), t])
        lens = packed[:5].tobytes()
        if lens != self._rays_of:
            straight_rays(self.height, self.width, packed, self.straight)
            self._rays_of = lens
        x = np.linspace(-2.0, self.width + 1.0, 9)
        y = np.linspace(-2.0, self.height + 1.0, 9)
        sides = [np.stack([x, np.full(9, v)], -1) for v in (y[0], y[-1])]
        rim = np.concatenate([*sides, *(np.stack([np.full(9, u), y], -1) for u in (x[0], x[-1]))])
        rays = undistorted((rim - packed[2:4]) / packed[:2], view.k1)
        low, high = rays.min(axis=0), rays.max(axis=0)
        return packed, np.array([low[0], high[0], low[1], high[1]])


def draw_picture(canvas: Canvas, world: World, view: View, noise: np.ndarray) -> Float[np.ndarray, "height width 3"]:
    """BGR of the world seen by this camera, about 0 to 255, in a buffer that the next picture overwrites."""
    brush = Brush(canvas, view)
    brush.backdrop(world, noise)
    brush.net(world)
    brush.flat(world.front)
    return canvas.image


class Brush:
    """Paints a world's layers into a canvas through one camera."""

    def __init__(self, canvas: Canvas, view: View) -> None:
        """Aim the canvas."""
        self._canvas, self._view = canvas, view
        self._seen, self._limits = canvas.aim(view)

    def backdrop(self, world: World, noise: np.ndarray) -> None:
        """Everything beyond the net: sky, ground, lines, words, shadows, stands, and who stands there."""
        canvas, image = self._canvas, self._canvas.image
        share = np.linspace(0.0, 1.0, canvas.height, dtype=np.float32)[:, None, None]
        image[:] = world.sky[0].astype(np.float32) * (1 - share) + world.sky[1].astype(np.float32) * share
        self.flat(world.ground)
        ground = ground_from_ray(self._view, 0.0 if world.floor_z < 0 else world.floor_z)
        texture_ground(image, canvas.straight, ground, world.grain, noise, canvas.keep)
        self.flat(world.foreign, canvas.keep)
        self._exact(world.lines, canvas.keep)
        self._textured(world.worn)
        self._textured(world.ground_words)
        self.flat(world.shadows)
        self._textured(world.planes)
        self.flat(world.behind)

    def net(self, world: World) -> None:
        """Posts, mesh, tape and what is written on them."""
        self.flat(world.net)
        self._textured(world.mesh)
        self._exact(world.tape)
        self._textured(world.net_words)

    def flat(self, group: Polygons, keep: np.ndarray = NOTHING_WORN) -> None:
        """Polygons in order."""
        canvas = self._canvas
        args = (group.corners, group.starts, group.colours, group.alphas, self._seen, self._limits, keep)
        paint_flat(canvas.image, canvas.cover, *args)

    def _exact(self, group: Polygons, keep: np.ndarray = NOTHING_WORN) -> None:
        canvas = self._canvas
        if not canvas.fine or len(group.alphas) == 0:
            return self.flat(group, keep)
        args = (group.corners, group.starts, group.colours[0], group.alphas, self._seen, self._limits, keep)
        paint_fine(canvas.image, canvas.layer, canvas.fine_cover, *args)

    def _textured(self, planes: tuple[Plane, ...]) -> None:
        canvas = self._canvas
        for plane in planes:
            paint_texture(
                canvas.image,
                canvas.cover,
                plane.corners,
                self._seen,
                self._limits,
                canvas.straight,
                texture_from_ray(plane, self._view),
                plane.texture,
                plane.base,
                plane.gain,
                plane.alpha,
                plane.by_mask,
                plane.smaller,
            )


def draw_over(canvas: Canvas, picture: np.ndarray, group: Polygons, view: View) -> np.ndarray:
    """The picture with these polygons painted over it; the canvas's own buffer."""
    canvas.image[:] = picture
    Brush(canvas, view).flat(group)
    return canvas.image


def texture_from_ray(plane: Plane, view: View) -> Float[np.ndarray, "3 3"]:
    """Takes a pinhole ray (x, y, 1) to (u w, v w, w), texture pixels with the first pixel's centre at (0.5, 0.5)."""
    R, centre = view.R_cam_from_world, view.centre_world
    normal = np.cross(plane.right, plane.down)
    normal = normal / np.linalg.norm(normal)
    lift = float(normal @ (plane.origin - centre))
    rows = []
    for axis in (plane.right, plane.down):
        unit = axis / (axis @ axis)
        rows.append(R @ (float(unit @ (centre - plane.origin)) * normal + lift * unit))
    rows.append(R @ normal)
    return np.array(rows)


def ground_from_ray(view: View, floor_z: float) -> Float[np.ndarray, "3 3"]:
    """Takes a pinhole ray (x, y, 1) to (X w, Y w, w) on the floor, metres; w > 0 below the horizon."""
    R, centre = view.R_cam_from_world, view.centre_world
    height = centre[2] - floor_z
    down = -R[:, 2]
    return np.array([centre[0] * down + height * R[:, 0], centre[1] * down + height * R[:, 1], down])
