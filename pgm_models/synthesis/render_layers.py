"""Frames of a video as fast as its camera allows: what stands still is rendered and enhanced once."""

import copy
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from pgm_data.geometry.camera import Camera, same_camera
from pgm_data.geometry.camera import rays as directions_of
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.insertions import Insertion
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.rays import picture_pixels
from pgm_models.synthesis.skinning import Poses
from pgm_models.synthesis.studio import Picture, Studio
from pgm_models.synthesis.tiles import StaticLayer, changed_pixels, enhanced_where_changed, static_layer

Quality = Literal["draft", "standard"]
"""`draft` leaves the enhancer out."""
T = TypeVar("T", Poses, Balls)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Still:
    """A view without what moves."""

    camera: Camera
    layer: StaticLayer


class Filmer:
    """Makes pictures of one size, of objects that wear the same throughout, some of which may be left out."""

    @torch.no_grad()
    def __init__(
        self,
        model: SynthesisModel,
        styles: Float[Tensor, "1 objects style"],
        size: tuple[int, int],
        *,
        quality: Quality = "standard",
        without: Collection[str] = (),
    ) -> None:
        """Grow and dress everything.

        Args:
            model: That renders.
            styles: What each object wears.
            size: Width and height of the pictures.
            quality: Of them.
            without: Objects that are left out: nothing of them is computed, and what is behind them shows.

        Raises:
            ValueError: If there is no such object, or the picture has no pixel.
        """
        names = [thing.name for thing in model.scene.objects]
        strange = sorted(set(without) - set(names))
        if strange:
            raise ValueError(f"without: expected objects among {', '.join(names)}, got {strange[0]!r}")
        self.model, self.without = model, frozenset(without)
        self.enhancer = model.enhancer if quality == "standard" else None
        self._styles = styles.flatten(1)
        self._studio = Studio(model, styles, *size)
        # Dressed as a whole, then without the enhancer, which is run here, and without surfaces that are left out.
        self._studio.model = _pared(model, self.without)
        self._moving = [number for number, thing in enumerate(model.scene.objects) if thing.kind in ("player", "ball")]
        self._still: _Still | None = None

    @torch.no_grad()
    def moving(self, camera: Camera, states: States, *, inserted: Sequence[Insertion] = ()) -> Picture:
        """The picture of one frame's states by a camera that moves.

        Args:
            camera: For pictures of the filmer's size.
            states: Of one frame.
            inserted: Meshes, as of `Studio.picture`.

        Raises:
            ValueError: If the camera is missing, its lens has no ray for a pixel, or a mesh has no place.
        """
        seen = self._studio.picture(camera, self._kept(states), inserted)
        if self.enhancer is None:
            return replace(seen, rgb=seen.rgb.clamp(0.0, 1.0))
        return replace(seen, rgb=self.enhancer(seen.features[None], self._styles, _covered(seen))[0])

    @torch.no_grad()
    def still(self, camera: Camera, states: States, *, inserted: Sequence[Insertion] = ()) -> Picture:
        """The same, up to rounding, by a camera that stands still: enhanced only where something moves."""
        if self.enhancer is None:
            return self.moving(camera, states, inserted=inserted)
        layer = self._layer(camera)
        seen = self._studio.picture(camera, self._kept(states), inserted)
        features, covered = seen.features[None], _covered(seen)
        # Where nothing moves, rays that have samples differ from the layer's by rounding alone.
        moved = (seen.shares[self._moving] > 0).any(dim=0)
        if covered is not None:
            moved |= covered[0, 0] > 0
        changed = changed_pixels(layer, features) & moved
        return replace(seen, rgb=enhanced_where_changed(self.enhancer, layer, features, changed, covered)[0])

    def _layer(self, camera: Camera) -> StaticLayer:
        assert self.enhancer is not None
        if self._still is None or not same_camera(self._still.camera, camera):
            empty = self._studio.picture(camera, States(poses={}, balls=None))
            layer = static_layer(self.enhancer, empty.features[None], self._styles)
            self._still = _Still(camera=camera, layer=layer)
        return self._still.layer

    def _kept(self, states: States) -> States:
        """The states without what is left out, where the model is."""
        ball = next((thing.name for thing in self.model.scene.objects if thing.kind == "ball"), "")
        return States(
            poses={name: _moved(poses, self.model) for name, poses in states.poses.items() if name not in self.without},
            balls=None if ball in self.without or states.balls is None else _moved(states.balls, self.model),
        )


def _pared(model: SynthesisModel, without: Collection[str]) -> SynthesisModel:
    """The model without its enhancer, and without the fields of surfaces and static worlds that are left out."""
    pared = copy.deepcopy(model)
    pared.enhancer = None
    for name in without:
        for fields in (pared.fields.planes, pared.fields.skies, pared.fields.worlds):
            if isinstance(fields, nn.ModuleDict) and name in fields:
                del fields[name]
    return pared


def _moved(state: T, model: SynthesisModel) -> T:
    """Its tensors on the device of the model."""
    tensors = {name: value for name, value in vars(state).items() if isinstance(value, Tensor)}
    return replace(state, **{name: value.to(model.device) for name, value in tensors.items()})


def _covered(seen: Picture) -> Float[Tensor, "1 1 height width"] | None:
    """Shares of pixels that inserted meshes cover."""
    return None if seen.inserted is None else seen.inserted[None, None]


def as_bgr(picture: Picture) -> UInt8[np.ndarray, "height width 3"]:
    """Its colours as bytes: blue, green, red."""
    rgb = (picture.rgb.clamp(0.0, 1.0) * 255).round().to(torch.uint8)
    return np.ascontiguousarray(rgb.flip(0).permute(1, 2, 0).cpu().numpy())


def labels_of(picture: Picture) -> UInt8[np.ndarray, "height width"]:
    """1 + number of the object that each pixel shows most; 0 where it shows nothing most."""
    shares = picture.shares
    most, which = shares.max(dim=0)
    there = most >= 1 - shares.sum(dim=0)
    return torch.where(there, which + 1, 0).to(torch.uint8).cpu().numpy()


def depth_of(picture: Picture, camera: Camera) -> Float[np.ndarray, "height width"]:
    """Camera z of what each pixel shows, metres; inf where that is nothing."""
    height, width = picture.depth.shape
    directions = directions_of(camera, picture_pixels(width, height))
    forward = (directions @ camera.R_cam_from_world[2]).reshape(height, width)
    return picture.depth.cpu().numpy().astype(np.float64) * forward
