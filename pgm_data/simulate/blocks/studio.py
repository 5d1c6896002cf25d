"""Draws the pictures of one match: its world lit once, its figure anew in every frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pgm_data.simulate.blocks.figure import PART_BOXES_M, PARTS, PIXEL_M, Posture, part_placements
from pgm_data.simulate.blocks.light import daylight, sunlight
from pgm_data.simulate.blocks.mesh import Rectangles, world_rectangles
from pgm_data.simulate.blocks.painter import paint, see
from pgm_data.simulate.blocks.skins import FACES, Skin, draw_skin
from pgm_data.simulate.blocks.sky import draw_sky
from pgm_data.simulate.blocks.world import OPAQUE, BlockWorld
from pgm_data.simulate.camera import CameraTrack

NEAREST_M = 0.05
"""Cameras stay this far from everything that is drawn."""
# Face of a part: axis, side, u axis and sign, v axis and sign (v runs down), as seen from outside.
_FACE_AXES = {
    "front": (2, 1, 0, 1, 1, -1),
    "back": (2, -1, 0, -1, 1, -1),
    "left": (0, 1, 2, -1, 1, -1),
    "right": (0, -1, 2, 1, 1, -1),
    "top": (1, 1, 0, 1, 2, 1),
    "bottom": (1, -1, 0, 1, 2, -1),
}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Daytime:
    """Light of a match."""

    sun: Float[np.ndarray, " 3"]
    """Unit vector towards the sun."""
    light: Float[np.ndarray, "6 3"]
    """BGR: daylight, sunlight, haze (0 to 255), reach of the haze (m), zenith, clouds."""


def _draw_daytime(rng: np.random.Generator) -> _Daytime:
    bearing, height = float(rng.uniform(-np.pi, np.pi)), float(np.radians(rng.uniform(36, 62)))
    sun = np.array([np.cos(height) * np.cos(bearing), np.cos(height) * np.sin(bearing), np.sin(height)])
    warm = float(rng.uniform(0.0, 1.0))
    light = np.array(
        [
            np.array([0.66, 0.61, 0.57]) * rng.uniform(0.94, 1.05),
            np.array([0.62 - 0.10 * warm, 0.68 - 0.03 * warm, 0.72]) * rng.uniform(0.95, 1.08),
            [250.0 - 14 * warm, 222.0, 196.0 + 24 * warm],
            [420.0, 0.0, 0.0],
            [236.0, 150.0, 96.0 + 20 * warm],
            [252.0, 250.0 - 4 * warm, 248.0],
        ]
    )
    return _Daytime(sun=sun, light=light)


class Studio:
    """The pictures of one match; what is costly is made when the first one is asked for."""

    def __init__(self, world: BlockWorld, seed: int, *, fine: bool, light_seed: int | None = None) -> None:
        """With `fine`, 3 x 3 samples where edges cross a pixel; else one. Light and sky may have an own seed."""
        self.world = world
        self.seed = seed
        self.light_seed = seed if light_seed is None else light_seed
        self.fine = fine

    @cached_property
    def skin(self) -> Skin:
        """What the figure wears."""
        return draw_skin(np.random.default_rng([self.seed, 0]))

    @property
    def identity(self) -> str:
        """Name of the person: the skin's."""
        return self.skin.name

    @cached_property
    def _daytime(self) -> _Daytime:
        return _draw_daytime(np.random.default_rng([self.light_seed, 1]))

    @cached_property
    def _sky(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return draw_sky(np.random.default_rng([self.light_seed, 2]))

    @cached_property
    def _static(self) -> Rectangles:
        return world_rectangles(self.world)

    @cached_property
    def _texels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Lit colours with the share of sunlight, coverage, counts, offsets, and which rectangles have holes."""
        static = self._static
        light, sun = self._daytime.light, self._daytime.sun
        areas = static.counts.prod(axis=1)
        slope = np.maximum(static.normal @ sun, 0.0)
        slope[static.two_sided] = 0.6
        around = np.select([static.normal[:, 2] > 0.5, np.abs(static.normal[:, 1]) > 0.5], [1.0, 0.86], default=0.76)
        around[static.two_sided] = 0.95
        lit = sunlight(self.world, static, sun) * np.repeat(slope, areas)
        open_sky = daylight(self.world, static, 96) * np.repeat(around, areas)
        steady = open_sky[:, None] * light[0]
        sunny = lit[:, None] * light[1]
        colours = np.empty((len(steady), 4), dtype=np.uint8)
        colours[:, :3] = np.clip(static.texels[:, :3] * (steady + sunny), 0, 255)
        colours[:, 3] = 255 * sunny.mean(axis=1) / np.maximum((steady + sunny).mean(axis=1), 1e-6)
        skin = [self.skin.faces[p, f] for p in PARTS for f in FACES]
        own = np.vstack([np.column_stack([s.reshape(-1, 3), np.full(s.shape[0] * s.shape[1], 255)]) for s in skin])
        counts = np.vstack([static.counts, [(s.shape[1], s.shape[0]) for s in skin]]).astype(np.int64)
        offsets = np.concatenate([[0], np.cumsum(counts.prod(axis=1))[:-1]])
        cover = np.concatenate([static.texels[:, 3] > 0, np.ones(len(own), dtype=bool)])
        holes = np.array([not cover[o : o + n].all() for o, n in zip(offsets, counts.prod(axis=1), strict=True)])
        return np.vstack([colours, own.astype(np.uint8)]), cover, counts, offsets, holes

    @cached_property
    def _part_faces(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Corner, step of u, step of v (metres) and normal of the six faces of each part, in the part's frame."""
        out = []
        unit = np.eye(3)
        for low, high in PART_BOXES_M:
            for face in FACES:
                axis, side, ua, us, va, vs = _FACE_AXES[face]
                corner = np.empty(3)
                corner[axis] = high[axis] if side > 0 else low[axis]
                corner[ua] = low[ua] if us > 0 else high[ua]
                corner[va] = low[va] if vs > 0 else high[va]
                out.append((corner, us * PIXEL_M * unit[ua], vs * PIXEL_M * unit[va], side * unit[axis]))
        corner, along, down, normal = (np.array(a) for a in zip(*out, strict=True))
        return corner, along, down, normal

    def _rectangles(self, posture: Posture, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Corner, step of u, step of v and normal in the world of everything in a frame, the figure last."""
        R, t = part_placements(posture, frame)
        R, t = np.repeat(R, 6, axis=0), np.repeat(t, 6, axis=0)
        static = self._static
        corner, along, down, normal = self._part_faces

        def turned(v: np.ndarray) -> np.ndarray:
            return np.einsum("qij,qj->qi", R, v)

        return (
            np.vstack([static.corner, turned(corner) + t]),
            np.vstack([static.along, turned(along)]),
            np.vstack([static.down, turned(down)]),
            np.vstack([static.normal, turned(normal)]),
        )

    def _seen(self, track: CameraTrack, posture: Posture, frame: int, size: tuple[int, int], samples: int):
        colours, cover, counts, offsets, holes = self._texels
        corner, along, down, normal = self._rectangles(posture, frame)
        K, R, t = track.K[frame], track.R_cam_from_world[frame], track.t_cam_from_world[frame]
        to_ray = np.linalg.inv(K)
        corner_cam, along_cam, down_cam, normal_cam = corner @ R.T + t, along @ R.T, down @ R.T, normal @ R.T
        height = (normal_cam * corner_cam).sum(axis=1)
        two_sided = np.concatenate([self._static.two_sided, np.zeros(len(corner) - len(self._static), dtype=bool)])
        front = np.where(two_sided, np.abs(height) > 1e-9, height < -1e-9)
        # 1/z = (n . ray) / (n . corner); u = ((z ray - corner) . along) / |along|^2, so u/z is linear too.
        w = normal_cam / np.where(front, height, 1.0)[:, None]
        forms = np.empty((len(corner), 3, 3))
        forms[:, 0] = w
        for row, step in ((1, along_cam), (2, down_cam)):
            square = (step * step).sum(axis=1)
            forms[:, row] = step / square[:, None] - ((corner_cam * step).sum(axis=1) / square)[:, None] * w
        forms = forms @ to_ray
        far_u, far_v = counts[:, :1] * along_cam, counts[:, 1:] * down_cam
        outline = np.stack([corner_cam, corner_cam + far_u, corner_cam + far_u + far_v, corner_cam + far_v], axis=1)
        if outline[..., 2].min() < NEAREST_M:
            raise ValueError(
                f"frame {frame}: expected a camera outside of the world, got one {outline[..., 2].min()} m away"
            )
        flat = outline[..., :2] / outline[..., 2:]
        outline_px = np.stack([K[0, 0] * flat[..., 0] + K[0, 2], K[1, 1] * flat[..., 1] + K[1, 2]], axis=-1)
        order = np.flatnonzero(front)
        order = order[np.argsort(outline[order, :, 2].mean(axis=1), kind="stable")]
        width, tall = size
        nearest = np.empty((tall * samples, width * samples), dtype=np.float32)
        seen = np.empty((tall * samples, width * samples), dtype=np.int16)
        see(order, outline_px, forms, counts, offsets, holes, cover, samples, nearest, seen)
        return nearest, seen, forms, normal

    def picture(
        self, track: CameraTrack, posture: Posture, frame: int, size: tuple[int, int]
    ) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of a frame, BGR."""
        samples = 3 if self.fine else 1
        _, seen, forms, normal = self._seen(track, posture, frame, size, samples)
        colours, _, counts, offsets, _ = self._texels
        R, t = track.R_cam_from_world[frame], track.t_cam_from_world[frame]
        parts_R, parts_t = part_placements(posture, frame)
        middle = posture.joints[frame, 0] + [0.0, 0.0, 0.2]
        out = np.empty((size[1], size[0], 3), dtype=np.uint8)
        paint(
            seen,
            samples,
            forms,
            counts,
            offsets,
            colours,
            normal,
            len(self._static),
            R.T @ np.linalg.inv(track.K[frame]),
            -R.T @ t,
            self._daytime.sun,
            self._daytime.light,
            OPAQUE[self.world.cells],
            (np.ascontiguousarray(parts_R), np.ascontiguousarray(parts_t), PART_BOXES_M, middle),
            self._sky,
            2 if self.fine else 1,
            out,
        )
        return out

    def masks(
        self, track: CameraTrack, posture: Posture, frame: int, size: tuple[int, int]
    ) -> tuple[UInt8[np.ndarray, "height width"], Float32[np.ndarray, "height width"]]:
        """What the centre of each pixel shows (0 sky, 1 player, 2 world), and its depth, m; infinite in the sky."""
        nearest, seen, _, _ = self._seen(track, posture, frame, size, 1)
        label = np.where(seen < 0, 0, np.where(seen >= len(self._static), 1, 2)).astype(np.uint8)
        depth = np.full(nearest.shape, np.inf, dtype=np.float32)
        np.divide(np.float32(1.0), nearest, out=depth, where=seen >= 0)
        return label, depth
