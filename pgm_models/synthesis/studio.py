"""Whole pictures: a model's fields grown once, then any camera and any state."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from pgm_data.geometry.camera import Camera, same_camera
from pgm_data.scene import SceneObject
from pgm_models.synthesis.balls import ball_boxes
from pgm_models.synthesis.bodies import body_boxes
from pgm_models.synthesis.boxes import Boxes, screen_rectangle
from pgm_models.synthesis.enhancer import with_kept
from pgm_models.synthesis.fields import BakedWardrobe, States, Wardrobe
from pgm_models.synthesis.insertions import Insertion, Placed, placed_meshes
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.rays import Rays, camera_rays, picture_pixels
from pgm_models.synthesis.renderer import Background, Known, background, render
from pgm_models.synthesis.sparse_pictures import cell_of_pixels, followed_pixels, near_cells, spread
from pgm_models.synthesis.stylists import COLOURS
from pgm_models.synthesis.worlds import world_box


@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A rendered picture and what else rays saw."""

    rgb: Float[Tensor, "3 height width"]
    """Final, 0 to 1."""
    features: Float[Tensor, "features height width"]
    """Before the enhancer; the first three are the colour then."""
    depth: Float[Tensor, "height width"]
    """Metres along the ray; inf where there is nothing."""
    shares: Float[Tensor, "objects height width"]
    """How much of each pixel each object is."""
    inserted: Float[Tensor, "height width"] | None
    """The same of all inserted meshes; None where none is inserted."""
    looked_at: int
    """Samples of volumes whose density was asked for."""
    dressed: int
    """Samples that were given features."""


@dataclass(frozen=True, eq=False)
class _View:
    """What hangs on the camera alone."""

    camera: Camera
    rays: Rays
    behind: Background


class Studio:
    """Renders pictures of one size, of objects that wear the same throughout.

    What no state changes is kept: the fields' grids, what they wear, and, as long as the camera stands still, its rays
    and the surfaces behind everything.
    """

    @torch.no_grad()
    def __init__(
        self, model: SynthesisModel, styles: Float[Tensor, "1 objects style"], width: int, height: int
    ) -> None:
        """Grow and dress everything.

        Raises:
            ValueError: If the picture has no pixel.
        """
        if width < 1 or height < 1:
            raise ValueError(f"picture: expected at least 1x1 pixels, got {width}x{height}")
        self.model, self.styles = model, styles
        self.width, self.height = width, height
        self.grids = model.fields.grids()
        baked = model.fields.options.stylising == "grid"
        self.wardrobe = (BakedWardrobe if baked else Wardrobe)(model.fields, self.grids, styles)
        self._view: _View | None = None
        upsampled = model.upsampler is not None
        self._followed = followed_pixels(height, width, model.device) if upsampled else None

    @torch.no_grad()
    def picture(self, camera: Camera, states: States, inserted: Sequence[Insertion] = ()) -> Picture:
        """The picture of one frame's states.

        Args:
            camera: For pictures of this studio's size.
            states: Of one frame.
            inserted: Meshes that the model knows nothing of. Where they are seen, and next to it, the enhancer changes
                no colour; those of players who are not there are not there either.

        Raises:
            ValueError: If the camera is missing, or a mesh is fixed to a joint that its player has not.
        """
        view = self._of(camera)
        known = Known(behind=view.behind, near=self._near(camera, states))
        meshes = self._placed(camera, states, inserted)
        seen = render(view.rays, self.model.fields, self.grids, states, self.wardrobe, inserted=meshes, known=known)
        if self._followed is not None:
            seen = spread(seen, cell_of_pixels(self.height, self.width, self.model.device))
        size = (self.height, self.width)
        features = seen.features.T.unflatten(1, size)
        rgb = self.model.enhanced(features[None], self.styles)
        if seen.inserted is not None and self.model.enhancer is not None:
            rgb = with_kept(rgb, features[None, :COLOURS], seen.inserted.reshape(1, 1, *size))
        return Picture(
            rgb=rgb[0],
            features=features,
            depth=seen.depth.unflatten(0, size),
            shares=seen.shares.T.unflatten(1, size),
            inserted=None if seen.inserted is None else seen.inserted.unflatten(0, size),
            looked_at=seen.looked_at,
            dressed=seen.dressed,
        )

    def _of(self, camera: Camera) -> _View:
        if self._view is None or not same_camera(self._view.camera, camera):
            pixels = picture_pixels(self.width, self.height)
            rays = camera_rays(camera, pixels, device=self.model.device)
            if self._followed is not None:
                rays = rays[self._followed]
            behind = background(rays, self.model.fields, self.wardrobe)
            self._view = _View(camera, rays, behind)
        return self._view

    def _near(self, camera: Camera, states: States) -> dict[str, Tensor]:
        """The pixels that may show each volume."""
        near = {}
        for thing in self.model.scene.objects:
            boxes = self._boxes(thing, states)
            if boxes is not None:
                near[thing.name] = self._pixels(camera, boxes)
        return near

    def _placed(self, camera: Camera, states: States, inserted: Sequence[Insertion]) -> list[Placed]:
        """The meshes where they are, and the pixels that may show each."""
        meshes = placed_meshes([each.to(self.model.device) for each in inserted], states.poses, 1)
        return [replace(each, near=self._pixels(camera, each.boxes())) for each in meshes]

    def _boxes(self, thing: SceneObject, states: States) -> Boxes | None:
        name, fields = thing.name, self.model.fields
        if name in states.poses:
            return body_boxes(states.poses[name], fields.body(fields.key_of[name]).skinning)
        if name in fields.worlds:
            world = fields.world(name)
            return Boxes(low=world.low[None], high=world.high[None])
        if name in fields.balls and states.balls is not None:
            return ball_boxes(states.balls)
        if name in fields.veils:
            low, high = torch.as_tensor(world_box(thing), dtype=torch.float32)
            return Boxes(low=low[None], high=high[None])
        return None

    def _pixels(self, camera: Camera, boxes: Boxes) -> Tensor:
        """Those that may show what is in the box of the one frame."""
        low, high = (corner[0].double().cpu().numpy() for corner in (boxes.low, boxes.high))
        rectangle = screen_rectangle(camera, low, high, self.width, self.height)
        device = self.model.device
        if rectangle is None:
            return torch.zeros(0, dtype=torch.int64, device=device)
        left, top, right, bottom = rectangle
        rows = torch.arange(top, bottom, device=device)[:, None] * self.width
        pixels = (rows + torch.arange(left, right, device=device)).flatten()
        return pixels if self._followed is None else near_cells(pixels, self._followed)
