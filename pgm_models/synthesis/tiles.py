"""Pictures enhanced where they differ from one of the same view that is enhanced already: equal to the whole, for less.

A fixed camera sees a court that stays and players that move. What the court alone looks like is enhanced once (the
STATIC layer). Of each frame only the tiles are enhanced on which a changed pixel has an effect: those within the
enhancer's reach of one. Tiles are gathered into rectangles, as each part that is enhanced alone needs a margin as wide
as the reach, and begin at multiples of the enhancer's stride, so that its cells are those of the whole picture.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn import functional

from pgm_models.synthesis.enhancer import Enhancer, with_kept
from pgm_models.synthesis.stylists import COLOURS

TILE_PX = 8
"""Side of a tile, unless the enhancer's stride is greater."""
RECTANGLE_PX = 4096
"""Pixels that enhancing one more rectangle costs in time, whatever its size."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StaticLayer:
    """A view without what moves, rendered and enhanced."""

    features: Float[Tensor, "1 features H W"]
    """As rendered."""
    styles: Float[Tensor, "1 style"]
    """What it was enhanced in."""
    picture: Float[Tensor, "1 3 H W"]
    """Enhanced, 0 to 1."""


def static_layer(
    enhancer: Enhancer, features: Float[Tensor, "1 features H W"], styles: Float[Tensor, "1 style"]
) -> StaticLayer:
    """The layer of a view, enhanced as a whole."""
    return StaticLayer(features=features, styles=styles, picture=enhancer(features, styles))


def changed_pixels(layer: StaticLayer, features: Float[Tensor, "1 features H W"]) -> Bool[Tensor, "H W"]:
    """Where a frame of the layer's view differs from it.

    Raises:
        ValueError: If it has another size or other features.
    """
    _check(layer, features)
    return (features != layer.features).any(dim=1)[0]


def enhanced_where_changed(
    enhancer: Enhancer,
    layer: StaticLayer,
    features: Float[Tensor, "1 features H W"],
    changed: Bool[Tensor, "H W"],
    kept: Float[Tensor, "1 1 H W"] | None = None,
) -> Float[Tensor, "1 3 H W"]:
    """What the enhancer makes of a frame of the layer's view in the layer's style, up to rounding.

    Args:
        enhancer: That of the layer.
        layer: The view without what moves.
        features: The frame's.
        changed: Where these may differ from the layer's; everywhere else they are the same.
        kept: Share of each pixel that belongs to inserted objects, as of `Enhancer.forward`.

    Raises:
        ValueError: If the frame has another size or other features than the layer.
    """
    _check(layer, features)
    tile = max(TILE_PX, enhancer.stride)
    margin = -(-enhancer.reach // enhancer.stride) * enhancer.stride
    size = (features.shape[2], features.shape[3])
    inner = np.minimum(rectangles(touched_tiles(changed, tile, enhancer.reach), tile, margin), size)
    outer = np.clip(inner + [[-margin], [margin]], 0, size)
    if _work(outer).sum() >= size[0] * size[1]:
        return enhancer(features, layer.styles, kept)
    picture = layer.picture.clone()
    for own, read in zip(inner, outer, strict=True):
        part = enhancer(features[(..., *_slices(read))], layer.styles)
        picture[(..., *_slices(own))] = part[(..., *_slices(own - read[0]))]
    return picture if kept is None else with_kept(picture, features[:, :COLOURS], kept)


def touched_tiles(changed: Bool[Tensor, "H W"], tile: int, reach: int) -> Bool[np.ndarray, "rows columns"]:
    """Which tiles of that side lie within that many pixels, along each axis, of a changed pixel."""
    height, width = changed.shape
    share = functional.pad(changed[None, None].float(), (0, -width % tile, 0, -height % tile))
    # First by row, then by column: the same as by square, and cheaper.
    for step, before in (((1, tile), (0, reach)), ((tile, 1), (reach, 0))):
        size = tuple(side + 2 * more for side, more in zip(step, before, strict=True))
        share = functional.max_pool2d(share, size, stride=step, padding=before)
    return (share[0, 0] > 0).cpu().numpy()


def rectangles(touched: Bool[np.ndarray, "rows columns"], tile: int, margin: int) -> Int[np.ndarray, "found 2 2"]:
    """Rectangles over all touched tiles, chosen for little work: where each begins and ends, row and column, pixels.

    Those about tiles that touch each other; two are made one where that one and its margin cost no more than both.
    """
    import cv2

    # Row 0 is the background; columns are left, top, width, height, area.
    stats = cv2.connectedComponentsWithStats(touched.astype(np.uint8), connectivity=8)[2][1:].astype(np.int64)
    begin = stats[:, [1, 0]]
    found = np.stack([begin, begin + stats[:, [3, 2]]], axis=1) * tile
    while len(found) > 1:
        begin = np.minimum(found[:, None, 0], found[None, :, 0])
        end = np.maximum(found[:, None, 1], found[None, :, 1])
        united = np.stack([begin, end], axis=2)
        alone, together = (_work(each + [[-margin], [margin]]) for each in (found, united))
        saved = alone[:, None] + alone[None] - together
        np.fill_diagonal(saved, -1)
        first, second = np.unravel_index(np.argmax(saved), saved.shape)
        if saved[first, second] < 0:
            break
        found = np.concatenate([np.delete(found, [first, second], axis=0), united[None, first, second]])
    return found


def _work(rectangle: Int[np.ndarray, "*any 2 2"]) -> Int[np.ndarray, "*any"]:
    """Cost of enhancing rectangles, in pixels."""
    return (rectangle[..., 1, :] - rectangle[..., 0, :]).prod(axis=-1) + RECTANGLE_PX


def _slices(rectangle: Int[np.ndarray, "2 2"]) -> tuple[slice, slice]:
    """Its rows and columns."""
    (top, left), (bottom, right) = rectangle.tolist()
    return slice(top, bottom), slice(left, right)


def _check(layer: StaticLayer, features: Tensor) -> None:
    if features.shape != layer.features.shape:
        expected, got = tuple(layer.features.shape), tuple(features.shape)
        raise ValueError(f"features: expected {expected} as those of the static layer, got {got}")
