"""Triangles of the world as pixels: exact projection, z test, S x S samples per pixel; the same bytes everywhere.

Pixels are OpenCV's (the centre of the top-left one is (0, 0)); colours are BGR, 0 to 255; depth is the camera's z in
metres. The lens bends vertices, not edges: keep edges short (some 15 px) where the lens is not straight.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, Int16

from pgm_data.simulate.pictures.triangles import averaged, blend, box_of, fill_triangles, look
from pgm_data.simulate.views import View


@dataclass(frozen=True, eq=False, kw_only=True)
class Texture:
    """Pictures that triangles show.

    Raises:
        ValueError: If there are neither three nor four channels.
    """

    texels: Float32[np.ndarray, "layers tall wide channels"]
    """BGR 0 to 255; what has less than 127.5 in a fourth channel is a hole."""
    layers: Int16[np.ndarray, " triangles"]
    """Which picture each triangle shows."""
    uv: Float[np.ndarray, "vertices 2"]
    """Repeats of the picture to the right and down, (0, 0) its top-left corner; every picture repeats."""
    smooth: bool = False
    """Between texels: interpolate, or take the nearest."""

    def __post_init__(self) -> None:
        """Check the channels."""
        if self.texels.shape[3] not in (3, 4) or 0 in self.texels.shape:
            raise ValueError(f"Texture.texels: expected 3 or 4 channels of one texel or more, got {self.texels.shape}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Triangles with their colours.

    Raises:
        ValueError: If a place is not finite, an index leads nowhere or a length does not fit.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    """World metres."""
    triangles: Int[np.ndarray, "triangles 3"]
    """Anticlockwise seen from outside."""
    colours: Float32[np.ndarray, "vertices 3"]
    """BGR 0 to 255, light included; with a texture, factors on its colours."""
    texture: Texture | None = None
    labels: Int16[np.ndarray, " triangles"] | None = None
    """0 where None."""
    opacity: Float[np.ndarray, " triangles"] | None = None
    """Share of a pixel's samples that each triangle fills; all where None. Coarse: steps of 1 / S^2."""
    two_sided: bool = True
    """False drops the triangles that are seen from inside."""

    def __post_init__(self) -> None:
        """Check what the inner loops do not."""
        count, faces = len(self.vertices), len(self.triangles)
        if not np.isfinite(self.vertices).all():
            raise ValueError("Mesh.vertices: expected finite places, got NaN or infinite ones")
        if faces and not 0 <= int(self.triangles.min()) <= int(self.triangles.max()) < count:
            raise ValueError(f"Mesh.triangles: expected indices below {count}, got up to {self.triangles.max()}")
        lengths = {"colours": (self.colours, count), "labels": (self.labels, faces), "opacity": (self.opacity, faces)}
        if self.texture is not None:
            lengths |= {"texture.uv": (self.texture.uv, count), "texture.layers": (self.texture.layers, faces)}
            layers = self.texture.layers
            if faces and not 0 <= int(layers.min()) <= int(layers.max()) < len(self.texture.texels):
                raise ValueError(f"Mesh.texture.layers: expected below {len(self.texture.texels)}, got {layers.max()}")
        for name, (values, expected) in lengths.items():
            if values is not None and len(values) != expected:
                raise ValueError(f"Mesh.{name}: expected {expected}, got {len(values)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Sprite:
    """A part of a picture with its opacity."""

    x0: int
    """Column in the picture of the sprite's first one."""
    y0: int
    bgr: Float32[np.ndarray, "h w 3"]
    """Mean colour of what covers the pixel."""
    alpha: Float32[np.ndarray, "h w"]
    """Share of the pixel that is covered."""
    depth: Float32[np.ndarray, "h w"]
    """Nearest z in the camera, metres; inf where nothing is."""
    label: Int16[np.ndarray, "h w"] | None = None
    """Label of the nearest sample; -1 where nothing is."""


def packed(view: View) -> Float[np.ndarray, " 17"]:
    """The camera as the inner loops read it."""
    K, R, t = view.K, view.R_cam_from_world, view.t_cam_from_world
    return np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2], view.k1], R.ravel(), t])


def sample_ranks(S: int) -> Int[np.ndarray, " samples"]:
    """In which order a pixel's samples are filled by something half transparent: spread over the pixel."""
    i, j = np.divmod(np.arange(S * S), S)
    scattered = (i * 0.754877666 + j * 0.569840291 + 0.5) % 1.0
    return np.argsort(np.argsort(scattered, kind="stable"), kind="stable").astype(np.int64)


class Frame:
    """Sample buffers of one part of a picture: meshes are drawn into them, then averaged."""

    def __init__(self, width: int, height: int, samples: int, *, x0: int = 0, y0: int = 0) -> None:
        """Allocate for width x height pixels that start at column x0, row y0, with samples x samples each."""
        if min(width, height, samples) < 1:
            raise ValueError(f"Frame: expected a size and samples of 1 or more, got {width} x {height}, {samples}")
        self.width, self.height, self.samples, self.x0, self.y0 = width, height, samples, x0, y0
        shape = (height * samples, width * samples)
        self.colour = np.zeros((*shape, 3), np.float32)
        self.nearest = np.zeros(shape, np.float32)
        self.label = np.full(shape, -1, np.int16)
        self._ranks = sample_ranks(samples)

    def clear(self) -> None:
        """Forget what was drawn."""
        self.nearest.fill(0.0)

    def draw(self, mesh: Mesh, view: View) -> None:
        """Draw a mesh, hidden by what is nearer and hiding what is further away; cut at the near plane."""
        seen = packed(view)
        cam, px = np.empty((len(mesh.vertices), 3)), np.empty((len(mesh.vertices), 2))
        look(np.ascontiguousarray(mesh.vertices), seen, cam, px)
        self._fill(mesh, cam, px, seen)

    def _fill(self, mesh: Mesh, cam: np.ndarray, px: np.ndarray, seen: np.ndarray) -> None:
        S, count = self.samples, len(mesh.triangles)
        labels = np.zeros(count, np.int16) if mesh.labels is None else mesh.labels
        if mesh.opacity is None:
            solid = np.full(count, S * S, np.int64)
        else:
            solid = np.clip(np.round(mesh.opacity * (S * S)), 0, S * S).astype(np.int64)
        texture = mesh.texture
        if texture is None:
            skin = (np.zeros((0, 1, 1, 3), np.float32), np.zeros(0, np.int16), False, self._ranks)
            uv = np.zeros((0, 2))
        else:
            skin = (np.ascontiguousarray(texture.texels), texture.layers, texture.smooth, self._ranks)
            uv = np.ascontiguousarray(texture.uv, dtype=float)
        paint = (np.ascontiguousarray(mesh.colours), uv, labels, solid)
        buffers = (self.colour, self.nearest, self.label)
        triangles = np.ascontiguousarray(mesh.triangles, dtype=np.int64)
        fill_triangles(buffers, self.x0, self.y0, S, cam, px, triangles, paint, skin, seen, mesh.two_sided)

    def sprite(self) -> Sprite:
        """What was drawn since the last clearing, as pixels."""
        shape = (self.height, self.width)
        bgr, alpha = np.empty((*shape, 3), np.float32), np.empty(shape, np.float32)
        depth, label = np.empty(shape, np.float32), np.empty(shape, np.int16)
        averaged(self.colour, self.nearest, self.label, self.samples, bgr, alpha, depth, label)
        return Sprite(x0=self.x0, y0=self.y0, bgr=bgr, alpha=alpha, depth=depth, label=label)


def draw_triangles(meshes: Mesh | Sequence[Mesh], view: View, size: tuple[int, int], samples: int) -> Sprite | None:
    """The pixels of one or several meshes, in their common box; None if the picture (width, height) shows none.

    Raises:
        ValueError: If fewer than one sample is asked for.
    """
    if samples < 1:
        raise ValueError(f"draw_triangles.samples: expected 1 or more, got {samples}")
    seen = packed(view)
    parts = []
    box = np.array([size[0], size[1], 0, 0], dtype=np.int64)
    for mesh in [meshes] if isinstance(meshes, Mesh) else meshes:
        cam, px = np.empty((len(mesh.vertices), 3)), np.empty((len(mesh.vertices), 2))
        look(np.ascontiguousarray(mesh.vertices), seen, cam, px)
        own = np.zeros(4, dtype=np.int64)
        triangles = np.ascontiguousarray(mesh.triangles, dtype=np.int64)
        if box_of(cam, px, triangles, seen, float(size[0]), float(size[1]), own):
            box[:2], box[2:] = np.minimum(box[:2], own[:2]), np.maximum(box[2:], own[2:])
            parts.append((mesh, cam, px))
    if not parts:
        return None
    frame = Frame(int(box[2] - box[0]), int(box[3] - box[1]), samples, x0=int(box[0]), y0=int(box[1]))
    for mesh, cam, px in parts:
        frame._fill(mesh, cam, px, seen)
    return frame.sprite()


def shadow(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    thrown: Float[np.ndarray, " 2"],
    floor_z: float,
    view: View,
    size: tuple[int, int],
    samples: int,
) -> Sprite | None:
    """The shadow of triangles on the floor, black; `thrown`: the ground vector by which a metre of height is thrown."""
    flat = np.empty_like(vertices)
    flat[:, :2] = vertices[:, :2] + np.maximum(vertices[:, 2:] - floor_z, 0.0) * thrown
    flat[:, 2] = floor_z
    black = np.zeros((len(flat), 3), np.float32)
    return draw_triangles(Mesh(vertices=flat, triangles=triangles, colours=black), view, size, samples)


def over(image: Float32[np.ndarray, "height width 3"], sprite: Sprite | None) -> None:
    """Lay a sprite over the picture, in place."""
    if sprite is not None:
        part = _inside(sprite, image.shape[1], image.shape[0])
        if part is not None:
            blend(image, part.bgr, part.alpha, part.x0, part.y0)


def darken(image: Float32[np.ndarray, "height width 3"], sprite: Sprite | None, strength: float) -> None:
    """Take a share of the light away where a shadow falls, in place."""
    if sprite is not None:
        part = _inside(sprite, image.shape[1], image.shape[0])
        if part is not None:
            height, width = part.alpha.shape
            under = image[part.y0 : part.y0 + height, part.x0 : part.x0 + width]
            under *= (np.float32(1.0) - np.float32(strength) * part.alpha)[..., None]


def hidden_by(sprite: Sprite, depth: Float32[np.ndarray, "height width"]) -> Sprite:
    """The sprite without what is further away than the picture's depth there."""
    height, width = sprite.alpha.shape
    behind = sprite.depth > depth[sprite.y0 : sprite.y0 + height, sprite.x0 : sprite.x0 + width]
    return Sprite(
        x0=sprite.x0,
        y0=sprite.y0,
        bgr=sprite.bgr,
        alpha=np.where(behind, np.float32(0.0), sprite.alpha),
        depth=np.where(behind, np.float32(np.inf), sprite.depth),
        label=None if sprite.label is None else np.where(behind, np.int16(-1), sprite.label),
    )


def blurred(sprites: Sequence[Sprite | None]) -> Sprite | None:
    """The mean of sprites over equal parts of an exposure; None if no part shows anything."""
    shown = [s for s in sprites if s is not None]
    if not shown:
        return None
    x0, y0 = min(s.x0 for s in shown), min(s.y0 for s in shown)
    width = max(s.x0 + s.alpha.shape[1] for s in shown) - x0
    height = max(s.y0 + s.alpha.shape[0] for s in shown) - y0
    light, alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    depth = np.full((height, width), np.inf, np.float32)
    label = np.full((height, width), -1, np.int16)
    for s in shown:
        part = np.s_[s.y0 - y0 : s.y0 - y0 + s.alpha.shape[0], s.x0 - x0 : s.x0 - x0 + s.alpha.shape[1]]
        light[part] += s.bgr * s.alpha[..., None]
        alpha[part] += s.alpha
        nearer = s.depth < depth[part]
        depth[part][nearer] = s.depth[nearer]
        if s.label is not None:
            label[part][nearer] = s.label[nearer]
    bgr = light / np.maximum(alpha, np.float32(1e-6))[..., None]
    return Sprite(x0=x0, y0=y0, bgr=bgr, alpha=alpha / np.float32(len(sprites)), depth=depth, label=label)


def _inside(sprite: Sprite, width: int, height: int) -> Sprite | None:
    """The part of a sprite that lies in a picture."""
    tall, wide = sprite.alpha.shape
    left, top = max(-sprite.x0, 0), max(-sprite.y0, 0)
    right, bottom = min(wide, width - sprite.x0), min(tall, height - sprite.y0)
    if left >= right or top >= bottom:
        return None
    if (left, top, right, bottom) == (0, 0, wide, tall):
        return sprite
    part = np.s_[top:bottom, left:right]
    return Sprite(
        x0=sprite.x0 + left,
        y0=sprite.y0 + top,
        bgr=sprite.bgr[part],
        alpha=sprite.alpha[part],
        depth=sprite.depth[part],
    )
