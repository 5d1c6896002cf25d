"""What rendering only what is there saves: field samples and time, beside pictures that look at everything."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pgm_data.geometry.camera import Camera
from pgm_models.synthesis.evaluate_dense import dense_picture, dense_samples, paper_picture
from pgm_models.synthesis.fields import States, Wardrobe
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.object_boxes import scaled_K
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.studio import Picture, Studio

T = TypeVar("T")
GRIDS = ("voxels", "texels", "skinning", False)
"""The design whose samples are skipped: volumes, planes, deformation, and whether pictures are made of fewer rays."""
NUDGE = 1.0 + 1e-6
"""Factor on a focal length that makes a camera another one, and its picture the same to the eye."""


@dataclass(frozen=True, kw_only=True)
class EfficiencyOptions:
    """What is measured."""

    size: tuple[int, int] = (1024, 576)
    """Width and height of the pictures, px."""
    share: int = 16
    """The dense ways are run for one row of pixels in so many; 1 for all."""
    most_rays: int = 16384
    """Of the other rays that see a volume, at which pictures are compared as well."""
    repeats: int = 3
    """Of the quick way, of which the least time counts."""


@dataclass(frozen=True, kw_only=True)
class Taken:
    """How long something takes, the least of some times."""

    seconds: float
    """On the clock, which on a busy machine runs for others too."""
    cpu_seconds: float
    """Of the process, all its threads together."""

    def times(self, factor: float) -> "Taken":
        """As often."""
        return Taken(seconds=factor * self.seconds, cpu_seconds=factor * self.cpu_seconds)


@dataclass(frozen=True, kw_only=True)
class Efficiency:
    """What rendering one frame takes."""

    size: tuple[int, int]
    """Width and height of the picture, px."""
    place: str
    """Clip and frame."""
    looked_at: int
    """Samples of volumes and veils whose density was asked for."""
    surface_samples: int
    """Pixels for which a surface was looked up."""
    dense_samples: int
    """Samples of every object on every ray, one of a surface."""
    largest_difference: float
    """Of the features, colours 0 to 1 among them, from the dense picture of the same fields."""
    compared_rays: int
    """At which that was measured."""
    growing: Taken
    """Growing and dressing the fields, once for all frames in the same styles."""
    first: Taken
    """A frame whose camera is new, with the enhancer."""
    following: Taken
    """A frame whose camera stands still, with the enhancer."""
    enhancing: Taken
    """The enhancer's part of both."""
    dense: Taken
    """The paper's dense layout without the enhancer, by what it takes for `timed_rays`."""
    timed_rays: int
    device: str
    threads: int

    @property
    def samples_ratio(self) -> float:
        """Dense samples for each one that was looked at."""
        return self.dense_samples / (self.looked_at + self.surface_samples)

    @property
    def time_ratio(self) -> float:
        """How many times longer a frame takes in the dense layout: a new camera, and the enhancer in both."""
        return (self.dense.seconds + self.enhancing.seconds) / self.first.seconds

    @property
    def cpu_ratio(self) -> float:
        """The same in seconds of the processor; those of a GPU are not in it."""
        return (self.dense.cpu_seconds + self.enhancing.cpu_seconds) / self.first.cpu_seconds


def efficiency_from_json(raw: Mapping[str, Any]) -> Efficiency:
    """What `asdict` made of one.

    Raises:
        ValueError: If it is not such.
    """
    try:
        taken = {name: Taken(**raw[name]) for name in ("growing", "first", "following", "enhancing", "dense")}
        return Efficiency(**{**raw, **taken, "size": tuple(raw["size"])})
    except (KeyError, TypeError) as error:
        raise ValueError(f"efficiency: expected what asdict made of it, got {error!r}") from error


@torch.no_grad()
def efficiency_of(
    model: SynthesisModel,
    styles: Float[Tensor, "1 objects style"],
    camera: Camera,
    states: States,
    options: EfficiencyOptions,
    *,
    place: str = "",
) -> Efficiency:
    """What a frame takes.

    Args:
        model: Renders it.
        styles: What its objects wear.
        camera: For pictures of the options' size.
        states: Of one frame.
        options: What is measured.
        place: The frame, in words.

    Raises:
        ValueError: If the model is of a design that has no grids, or another deformation than by joints.
    """
    design = model.options.design
    if (design.volumes, design.planes, design.deformation, design.picture == "upsampled") != GRIDS:
        raise ValueError(f"efficiency: expected a model of grids that joints bend, got {design}")
    width, height = options.size
    device = model.device
    studio, growing = _timed(lambda: Studio(model, styles, width, height), device)
    other = replace(camera, K=camera.K * np.array([[NUDGE, 1, 1], [1, NUDGE, 1], [1, 1, 1]]))
    picture, firsts = studio.picture(camera, states), []
    for _ in range(options.repeats):
        # The studio remembers one camera.
        studio.picture(other, states)
        firsts.append(_timed(lambda: studio.picture(camera, states), device)[1])
    followings = [_timed(lambda: studio.picture(camera, states), device)[1] for _ in range(options.repeats)]
    features = picture.features[None]
    enhancings = [_timed(lambda: model.enhanced(features, styles), device)[1] for _ in range(options.repeats)]
    rows = np.arange(options.share // 2, height, options.share)
    across = torch.from_numpy((rows[:, None] * width + np.arange(width)).ravel()).to(device)
    rays = camera_rays(camera, picture_pixels(width, height), device=device)
    compared = _compared(model, picture, across, options.most_rays)
    wardrobe = Wardrobe(model.fields, studio.grids, styles)
    dense = dense_picture(rays[compared], model.fields, studio.grids, states, wardrobe)
    difference = (dense - picture.features.flatten(1).T[compared]).abs()
    own = rays[across]
    _, taken = _timed(lambda: paper_picture(own, model.fields, studio.grids, states, styles), device)
    surfaces = [number for number, thing in enumerate(model.scene.objects) if thing.is_backdrop]
    return Efficiency(
        size=options.size,
        place=place,
        looked_at=picture.looked_at,
        surface_samples=width * height if surfaces else 0,
        dense_samples=width * height * dense_samples(model.fields),
        largest_difference=float(difference.max()),
        compared_rays=len(compared),
        growing=growing,
        first=_least(firsts),
        following=_least(followings),
        enhancing=_least(enhancings),
        dense=taken.times(width * height / len(across)),
        timed_rays=len(across),
        device=device.type,
        threads=torch.get_num_threads(),
    )


def _compared(
    model: SynthesisModel, picture: Picture, across: Int[Tensor, " rays"], most: int
) -> Int[Tensor, " compared"]:
    """Pixels at which pictures are compared: rows of them, and of the others some that show a volume or a veil."""
    volumes = [number for number, thing in enumerate(model.scene.objects) if not thing.is_backdrop]
    holds = torch.nonzero(picture.shares[volumes].sum(dim=0).flatten() > 0)[:, 0]
    if len(holds) > most:
        holds = holds[torch.linspace(0, len(holds) - 1, most, device=holds.device).long()]
    return torch.unique(torch.cat([across, holds]))


def camera_at(camera: Camera, factor: Float[np.ndarray, " 2"]) -> Camera:
    """A camera for its pictures scaled by those factors in x and y."""
    return replace(camera, K=scaled_K(camera.K, factor))


def _least(times: Sequence[Taken]) -> Taken:
    return Taken(seconds=min(one.seconds for one in times), cpu_seconds=min(one.cpu_seconds for one in times))


def _timed(make: Callable[[], T], device: torch.device) -> tuple[T, Taken]:
    """What is made, and how long that takes."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    started, cpu = time.perf_counter(), time.process_time()
    made = make()
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return made, Taken(seconds=time.perf_counter() - started, cpu_seconds=time.process_time() - cpu)
