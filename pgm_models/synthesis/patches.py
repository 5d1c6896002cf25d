"""Batches for training: pairs of frames of one match, with patches of their pictures and the rays through them.

The frames of a batch are numbered from 0, pairs one after the other. Tensors of a batch, by name:

- `pictures` (frames 3 height width): the whole pictures, from which styles are read, RGB 0 to 1;
- `boxes_px` (frames objects 4): where each object is seen in them, x0, y0, x1, y1, NaN where it is not;
- `wears` (frames objects): the frame whose style each object wears, its own or that of the pair's other frame;
- `targets` (patches 3 size size): what is to be rendered, RGB 0 to 1, the patches of one frame after another's;
- `patch_frame` (patches), `patch_corner` (patches 2): frame, left and top of each, in pixels of the store's pictures;
- `rays.origin`, `rays.direction`, `rays.across`, `rays.down` (rays 3), `rays.frame` (rays): through the pixels of all
  patches, row by row, so that `unflatten(0, (patches, size, size))` makes patches of what they see (`rays_in`);
- `NAME.rotation`, `NAME.translation`, `NAME.scale`, `NAME.joints` of each player and `ball.position`, `ball.path`
  (frames ...): what moves (`states_in`);
- `rows` (frames): of the store.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from pgm_data.scene import Scene
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.object_boxes import scaled_pixels, whole_picture
from pgm_models.synthesis.picture_shelf import as_picture
from pgm_models.synthesis.rays import Rays, camera_rays, joined_rays, picture_pixels
from pgm_models.synthesis.skinning import Poses
from pgm_models.train import Batch

UI_MARGIN_PX = 1.0
"""By which patches stay away from graphics: their edges are blurred."""
AHEAD = 256
"""Batches whose frames are decoded together, at most, where memory for pictures allows."""
TURNS = 32
"""Workers, at most, that take turns in making batches."""
AHEAD_SHARE = 0.5
"""Share of the memory for pictures that frames of later batches may take."""


@dataclass(frozen=True, kw_only=True)
class PatchOptions:
    """What a batch holds."""

    patch: int
    """Pixels of a patch along each axis."""
    patches: int = 1
    """Patches of a frame."""
    pairs: int = 1
    """Pairs of frames."""
    players: float = 1 / 3
    """Share of patches that show a part of a player, where one is seen."""
    ball: float = 1 / 3
    """Share of patches that show the ball, where it is seen. The rest lie anywhere."""
    swap: float = 0.5
    """Share of pairs in which an object wears the style of the other frame, where both see it."""
    whole: int = 512
    """Width of the whole pictures, pixels, at most."""
    seed: int = 0
    """Of all that is drawn."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("patch", "patches", "pairs", "whole"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected 1 or more, got {getattr(self, name)}")
        if min(self.players, self.ball) < 0 or self.players + self.ball > 1:
            raise ValueError(f"players, ball: expected shares, 1 at most together, got {self.players}, {self.ball}")
        if not 0 <= self.swap <= 1:
            raise ValueError(f"swap: expected 0 to 1, got {self.swap}")
        if self.seed < 0:
            raise ValueError(f"seed: expected 0 or more, got {self.seed}")


class PatchSource:
    """Batches of a store's frames by number: the same batch whenever and wherever it is asked for."""

    def __init__(self, store: FrameStore, options: PatchOptions) -> None:
        """For all frames of a store.

        Raises:
            ValueError: If a patch does not fit into the pictures, or nowhere beside the graphics of a clip; if a clip's
                video is not there; or if there is no frame.
        """
        width, height = store.size
        if options.patch > min(width, height):
            raise ValueError(f"patch: expected at most {min(width, height)}, of {width}x{height}, got {options.patch}")
        if not len(store):
            raise ValueError("store: expected frames, got none")
        clips, first = np.unique(store.clip, return_index=True)
        for number, row in zip(clips.tolist(), first.tolist(), strict=True):
            clip = store.clips[number]
            if clip.video is None:
                raise ValueError(f"clip {clip.clip_id}: {clip.no_video}")
            if not free_corners(store.size, options.patch, store.ui_boxes_px(row)).any():
                raise ValueError(
                    f"clip {clip.clip_id}: ui_boxes_px: expected room beside them for a patch of "
                    f"{options.patch} pixels in a picture of {width}x{height}, got boxes that leave none"
                )
        self.store, self.options = store, options
        names = dict.fromkeys(store.matches)
        match_of_clip = np.array([list(names).index(name) for name in store.matches], dtype=np.int64)
        match = match_of_clip[store.clip]
        # Frames match after match: where each one stands there, and where its match begins and ends.
        self._order = np.argsort(match, kind="stable")
        self._stands = np.argsort(self._order, kind="stable")
        counts = np.bincount(match)
        ends = np.cumsum(counts)
        self._first, self._count = (ends - counts)[match], counts[match]
        self._latest: int | None = None

    def batch(self, index: int) -> Batch:
        """Batch number `index`; its tensors are those that this module describes.

        Raises:
            ValueError: If a picture cannot be read, or the lens has no ray for a pixel; names clip and frame.
        """
        generator = np.random.default_rng([self.options.seed, index])
        rows = self._pairs(generator)
        self._decode_ahead(index, rows)
        frames, store = rows.flatten(), self.store
        wears = self._wears(rows, generator)
        corners = np.stack([self._corners(int(row), generator) for row in frames])
        images = [store.rgb(int(row)) for row in frames]
        size = self.options.patch
        targets = [
            as_picture(image[top : top + size, left : left + size])
            for image, own in zip(images, corners, strict=True)
            for left, top in own
        ]
        rays = joined_rays([self._rays(int(row), number, corners[number]) for number, row in enumerate(frames)])
        pictures, boxes = self._wholes(frames, images)
        states = store.states(frames)
        tensors = {
            "pictures": pictures,
            "boxes_px": boxes,
            "wears": torch.from_numpy(wears),
            "targets": torch.stack(targets),
            "patch_frame": torch.arange(len(frames)).repeat_interleave(self.options.patches),
            "patch_corner": torch.from_numpy(corners.reshape(-1, 2)),
            "rows": torch.from_numpy(frames),
            **{f"rays.{name}": value for name, value in vars(rays).items()},
            **{f"{name}.{key}": value for name, poses in states.poses.items() for key, value in vars(poses).items()},
        }
        if states.balls is not None:
            tensors |= {"ball.position": states.balls.position, "ball.path": states.balls.path}
        return Batch(tensors=tensors, names=tuple(store.place(int(row)) for row in frames))

    def _pairs(self, generator: np.random.Generator) -> Int[np.ndarray, "pairs 2"]:
        """Two frames of one match each, two different ones where it has them."""
        one = generator.integers(0, len(self.store), self.options.pairs)
        first, count = self._first[one], self._count[one]
        step = 1 + generator.integers(0, np.maximum(count - 1, 1))
        other = self._order[first + (self._stands[one] - first + step) % count]
        return np.stack([one, other], axis=1)

    def _wears(
        self, rows: Int[np.ndarray, "pairs 2"], generator: np.random.Generator
    ) -> Int[np.ndarray, "frames objects"]:
        """The frame of the batch whose style each object wears."""
        store = self.store
        objects = store.scene.objects
        # NaN in any of the numbers of both frames.
        both = np.asarray(np.isfinite(store.boxes_px[rows].sum(axis=(1, 3))))
        swapped = (generator.random((len(rows), len(objects))) < self.options.swap) & both
        for number, player in enumerate(store.scene.players):
            # Two people change ends: then the far one's clothes are not the near one's.
            identity = store.identity[rows, number]
            unlike = (identity[:, 0] != identity[:, 1]) & (identity >= 0).all(axis=1)
            swapped[:, objects.index(player)] &= ~unlike
        own = np.arange(2 * len(rows)).reshape(-1, 2, 1)
        return np.where(swapped[:, None], own[:, ::-1], own).reshape(2 * len(rows), -1)

    def _corners(self, row: int, generator: np.random.Generator) -> Int[np.ndarray, "patches 2"]:
        """Left and top of each patch of a frame."""
        store, options = self.store, self.options
        free = free_corners(store.size, options.patch, store.ui_boxes_px(row))
        boxes: dict[str, list[np.ndarray]] = {"player": [], "ball": []}
        for thing, box in zip(store.scene.objects, store.boxes_px[row], strict=True):
            if thing.kind in boxes and not np.isnan(box).any():
                boxes[thing.kind].append(box.astype(np.float64))
        corners = []
        for draw in generator.random(options.patches):
            kind = "player" if draw < options.players else "ball" if draw < options.players + options.ball else ""
            aims = boxes.get(kind, [])
            aim = aims[generator.integers(len(aims))] if aims else whole_picture(store.size)
            corners.append(draw_corner(free, options.patch, aim, store.size, generator))
        return np.array(corners, dtype=np.int64)

    def _rays(self, row: int, number: int, corners: Int[np.ndarray, "patches 2"]) -> Rays:
        size = self.options.patch
        pixels = [picture_pixels(size, size, left=int(left), top=int(top)) for left, top in corners]
        try:
            return camera_rays(self.store.cameras[row], np.concatenate(pixels), frame=number)
        except ValueError as error:
            raise ValueError(f"{self.store.place(row)}: {error}") from error

    def _wholes(
        self, frames: Int[np.ndarray, " frames"], images: list[UInt8[np.ndarray, "height width 3"]]
    ) -> tuple[Float[Tensor, "frames 3 whole_height whole_width"], Float[Tensor, "frames objects 4"]]:
        """Whole pictures for reading styles, and where the objects are in them."""
        width, height = self.store.size
        small = min(width, self.options.whole)
        size = (small, max(1, round(height * small / width)))
        if size != (width, height):
            import cv2

            images = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
        factor = np.array([size[0] / width, size[1] / height])
        boxes = scaled_pixels(self.store.boxes_px[frames].reshape(-1, 2).astype(np.float64), factor)
        boxes = boxes.reshape(len(frames), -1, 4).astype(np.float32)
        return torch.stack([as_picture(image) for image in images]), torch.from_numpy(boxes)

    def _decode_ahead(self, index: int, rows: Int[np.ndarray, "pairs 2"]) -> None:
        """Where the batch's frames are not in memory, decode those of later batches with them: what is drawn stays."""
        options, store = self.options, self.store
        # Several workers take turns: each looks at those batches alone that come to it.
        step = 1 if self._latest is None else index - self._latest
        stride = step if 1 <= step <= TURNS else 1
        self._latest = index
        if all(store.kept(int(row)) for row in rows.flatten()):
            return
        fits = int(AHEAD_SHARE * store.shelf.cache.limit_bytes / (3 * store.size[0] * store.size[1] * rows.size))
        later = range(index + stride, index + stride * min(AHEAD, fits), stride)
        more = [self._pairs(np.random.default_rng([options.seed, number])) for number in later]
        store.prepare(np.concatenate([rows, *more]).flatten())


def free_corners(
    size: tuple[int, int], patch: int, ui_boxes_px: Float[np.ndarray, "boxes 4"]
) -> Bool[np.ndarray, "tops lefts"]:
    """Where the upper left pixel of a patch may lie so that it touches no graphics.

    Args:
        size: Width and height of the picture.
        patch: Pixels of a patch along each axis, at most those of the picture.
        ui_boxes_px: x0, y0, x1, y1 of graphics.
    """
    free = np.ones((size[1] - patch + 1, size[0] - patch + 1), dtype=bool)
    for x0, y0, x1, y1 in ui_boxes_px:
        # A pixel reaches half a pixel to both sides of its centre.
        first = np.floor(np.array([x0, y0]) - UI_MARGIN_PX - 0.5).astype(int) + 1
        last = np.ceil(np.array([x1, y1]) + UI_MARGIN_PX + 0.5).astype(int) - 1
        left, top = np.maximum(first - patch + 1, 0)
        free[top : max(last[1] + 1, 0), left : max(last[0] + 1, 0)] = False
    return free


def draw_corner(
    free: Bool[np.ndarray, "tops lefts"],
    patch: int,
    aim: Float[np.ndarray, " 4"],
    size: tuple[int, int],
    generator: np.random.Generator,
) -> tuple[int, int]:
    """Left and top of a patch that shows a point of `aim`, drawn evenly from it; of any patch where none does.

    Args:
        free: Of `free_corners`; somewhere true.
        patch: Pixels of a patch along each axis.
        aim: x0, y0, x1, y1, which overlaps the picture.
        size: Width and height of the picture.
        generator: Draws.
    """
    low, high = np.maximum(aim[:2], -0.5), np.minimum(aim[2:], np.array(size) - 0.5)
    x, y = np.clip(np.round(low + generator.random(2) * (high - low)), 0, np.array(size) - 1).astype(int)
    left, top = max(int(x) - patch + 1, 0), max(int(y) - patch + 1, 0)
    near = np.argwhere(free[top : int(y) + 1, left : int(x) + 1])
    if not len(near):
        near, left, top = np.argwhere(free), 0, 0
    row, column = near[generator.integers(len(near))]
    return left + int(column), top + int(row)


def rays_in(batch: Batch) -> Rays:
    """The rays of a batch, through the pixels of its patches."""
    names = ("origin", "direction", "across", "down", "frame")
    return Rays(**{name: batch.tensors[f"rays.{name}"] for name in names})


def states_in(batch: Batch, scene: Scene) -> States:
    """What moves in the frames of a batch."""
    poses = {
        player.name: Poses(
            rotation=batch.tensors[f"{player.name}.rotation"],
            translation=batch.tensors[f"{player.name}.translation"],
            scale=batch.tensors[f"{player.name}.scale"],
            joints=batch.tensors[f"{player.name}.joints"],
        )
        for player in scene.players
    }
    if scene.ball is None:
        return States(poses=poses, balls=None)
    position, path = batch.tensors["ball.position"], batch.tensors["ball.path"]
    return States(poses=poses, balls=Balls(position=position, path=path, radius=scene.ball.radius_m))
