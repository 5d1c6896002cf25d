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
    image, cover = canvas.image, canvas.cover
    seen, limits = canvas.aim(view)
    none = np.zeros((0, 0), np.float32)

    def flat(group: Polygons, keep: np.ndarray = none) -> None:
        paint_flat(image, cover, group.corners, group.starts, group.colours, group.alphas, seen, limits, keep)

    def exact(group: Polygons, keep: np.ndarray = none) -> None:
        if not canvas.fine or len(group.alphas) == 0:
            return flat(group, keep)
        args = (group.corners, group.starts, group.colours[0], group.alphas, seen, limits, keep)
        paint_fine(image, canvas.layer, canvas.fine_cover, *args)

    def textured(planes: tuple[Plane, ...]) -> None:
        for plane in planes:
            paint_texture(
                image,
                cover,
                plane.corners,
                seen,
                limits,
                canvas.straight,
                texture_from_ray(plane, view),
                plane.texture,
                plane.base,
                plane.gain,
                plane.alpha,
                plane.by_mask,
            )

    share = np.linspace(0.0, 1.0, canvas.height, dtype=np.float32)[:, None, None]
    image[:] = world.sky[0].astype(np.float32) * (1 - share) + world.sky[1].astype(np.float32) * share
    flat(world.ground)
    ground = ground_from_ray(view, 0.0 if world.floor_z < 0 else world.floor_z)
    texture_ground(image, canvas.straight, ground, world.grain, noise, canvas.keep)
    flat(world.foreign, canvas.keep)
    exact(world.lines, canvas.keep)
    textured(world.worn)
    textured(world.ground_words)
    flat(world.shadows)
    textured(world.planes)
    flat(world.behind)
    flat(world.net)
    exact(world.tape)
    textured(world.net_words)
    flat(world.front)
    return image


def draw_over(canvas: Canvas, picture: np.ndarray, group: Polygons, view: View) -> np.ndarray:
    """The picture with these polygons painted over it; the canvas's own buffer."""
    canvas.image[:] = picture
    seen, limits = canvas.aim(view)
    none = np.zeros((0, 0), np.float32)
    paint_flat(canvas.image, canvas.cover, group.corners, group.starts, group.colours, group.alphas, seen, limits, none)
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
