"""A court as plain colours, people as upright figures on it, and cameras that stand, turn or travel."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.geometry.camera import Camera, project

SIZE = (640, 360)


@dataclass(frozen=True, eq=False, kw_only=True)
class Filmed:
    """A clip with what it shows."""

    clip: ClipCamera
    pictures: Callable[[], Iterator[np.ndarray]]
    boxes_px: np.ndarray
    """Of each figure, frames x figures x 4; NaN where it is not there."""


def camera_of(turn: np.ndarray, focal: np.ndarray, shift: np.ndarray) -> Camera:
    """Cameras 27 m behind the net and 9 m up (moved by `shift` along x), turned by `turn` radians."""
    rows = len(turn)
    sine, cosine = np.sin(0.3), np.cos(0.3)
    down = np.array([[1.0, 0.0, 0.0], [0.0, -sine, -cosine], [0.0, cosine, -sine]])
    c, s, o, i = np.cos(turn), np.sin(turn), np.zeros(rows), np.ones(rows)
    pan = np.stack([c, s, o, -s, c, o, o, o, i], axis=1).reshape(rows, 3, 3)
    R = down @ pan
    K = np.zeros((rows, 3, 3))
    K[:, 0, 0], K[:, 1, 1], K[:, 2, 2], K[:, 0, 2], K[:, 1, 2] = focal, focal, 1.0, 319.5, 179.5
    centre = np.stack([shift, np.full(rows, -27.0), np.full(rows, 9.0)], axis=1)
    return Camera(
        K=K, distortion=np.zeros((rows, 4)), R_cam_from_world=R, t_cam_from_world=-(R @ centre[..., None])[..., 0]
    )


def clip_of(camera: Camera, *, fps: float = 25.0, duplicates: tuple[int, ...] = (), lost: tuple[int, ...] = ()):
    """A clip of those cameras; `lost` frames have none."""
    rows = len(camera.K)
    duplicate = np.isin(np.arange(rows), duplicates)
    time = np.arange(rows) / fps
    for frame in duplicates:
        time[frame] = time[frame - 1]
    status = np.full(rows, "measured", dtype=object)
    status[list(lost)] = "none"

    def kept(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[list(lost)] = np.nan
        return values

    return ClipCamera(
        clip_id="clip",
        video_frame=np.arange(rows),
        timestamp=np.arange(rows) / fps,
        is_duplicate=duplicate,
        capture_time=time,
        camera=Camera(
            K=kept(camera.K),
            distortion=kept(camera.distortion),
            R_cam_from_world=kept(camera.R_cam_from_world),
            t_cam_from_world=kept(camera.t_cam_from_world),
        ),
        status=status,
        reason=np.full(rows, "", dtype=object),
        inliers=np.zeros(rows, np.int64),
        reprojection_px=np.zeros(rows),
        position_cov=np.zeros((rows, 6)),
        focal_std_px=np.zeros(rows),
    )


def film(camera: Camera, feet_world: np.ndarray, **options) -> Filmed:
    """Figures of 1.85 m at the given places, frames x figures x 2; nobody where NaN."""
    clip = clip_of(camera, **options)
    feet = np.concatenate([feet_world, np.zeros((*feet_world.shape[:2], 1))], axis=2)
    low, high = project(camera, feet)[0], project(camera, feet + [0.0, 0.0, 1.85])[0]
    tall = low[..., 1] - high[..., 1]
    boxes = np.stack([low[..., 0] - 0.2 * tall, high[..., 1], low[..., 0] + 0.2 * tall, low[..., 1]], axis=2)

    def pictures() -> Iterator[np.ndarray]:
        noise = np.random.default_rng(5)
        for frame in range(len(boxes)):
            picture = ground_picture(camera[frame])
            for box in boxes[frame][np.argsort(-np.nan_to_num(feet_world[frame, :, 1]))]:
                if np.isfinite(box).all():
                    draw_figure(picture, box)
            grains = noise.normal(0, 1.5, picture.shape)
            yield np.clip(picture + grains, 0, 255).astype(np.uint8)

    return Filmed(clip=clip, pictures=pictures, boxes_px=boxes)


def ground_picture(camera: Camera) -> np.ndarray:
    """A green ground with a blue court and its white lines, under a grey sky."""
    picture = np.full((SIZE[1], SIZE[0], 3), (90, 140, 80), np.uint8)

    def quad(corners: list[tuple[float, float]]) -> np.ndarray:
        points = np.array([(*corner, 0.0) for corner in corners])
        return np.round(project(camera, points)[0] * 16).astype(np.int32)

    x, y = 5.485, 11.885
    court = quad([(-x, -y), (x, -y), (x, y), (-x, y)])
    cv2.fillPoly(picture, [court], (150, 90, 60), shift=4)
    cv2.polylines(picture, [court], True, (235, 235, 235), 1, cv2.LINE_AA, shift=4)
    for line in (
        [(-4.1, -y), (-4.1, y)],
        [(4.1, -y), (4.1, y)],
        [(-4.1, 6.4), (4.1, 6.4)],
        [(-4.1, -6.4), (4.1, -6.4)],
    ):
        cv2.polylines(picture, [quad(line)], False, (235, 235, 235), 1, cv2.LINE_AA, shift=4)
    wall = project(camera, np.array([[-30.0, 21.0, 3.0], [30.0, 21.0, 3.0], [30.0, 21.0, 0.0], [-30.0, 21.0, 0.0]]))[0]
    cv2.fillPoly(picture, [np.round(wall * 16).astype(np.int32)], (70, 60, 60), shift=4)
    return picture


def draw_figure(picture: np.ndarray, box: np.ndarray) -> None:
    """Head, shirt and two legs that fill the box."""
    x0, y0, x1, y1 = box
    middle, wide, tall = (x0 + x1) / 2, x1 - x0, y1 - y0

    def part(left: float, top: float, right: float, bottom: float, colour: tuple[int, int, int]) -> None:
        corners = np.round([middle + left * wide, y0 + top * tall, middle + right * wide, y0 + bottom * tall])
        (a, b), (c, d) = np.maximum(corners.astype(int), 0).reshape(2, 2)
        picture[b : d + 1, a : c + 1] = colour

    part(-0.25, 0.0, 0.25, 0.18, (60, 40, 30))
    part(-0.5, 0.18, 0.5, 0.55, (40, 40, 210))
    part(-0.5, 0.55, -0.06, 1.0, (230, 230, 230))
    part(0.06, 0.55, 0.5, 1.0, (230, 230, 230))


def overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Shared area over that of both, the obvious way."""
    wide = np.clip(np.minimum(a[..., 2], b[..., 2]) - np.maximum(a[..., 0], b[..., 0]), 0, None)
    tall = np.clip(np.minimum(a[..., 3], b[..., 3]) - np.maximum(a[..., 1], b[..., 1]), 0, None)
    area = [(c[..., 2] - c[..., 0]) * (c[..., 3] - c[..., 1]) for c in (a, b)]
    return wide * tall / (area[0] + area[1] - wide * tall)
