"""Training pictures: every frame another world, camera, light and clutter, or no court at all."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import UInt8

from pgm_data.scene import Scene
from pgm_data.simulate.pictures.finish import draw_finish, finished
from pgm_data.simulate.pictures.negative import Props, draw_negative, draw_props
from pgm_data.simulate.pictures.picture import draw_picture
from pgm_data.simulate.pictures.shapes import polygons
from pgm_data.simulate.pictures.world import draw_world
from pgm_data.simulate.views import View, any_view, points_in_picture

MIN_POINTS = 4
"""Crossings that must lie inside a picture that counts as showing the court."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MixOptions:
    """How many training pictures, and what share shows no court. Raises ValueError for values out of range."""

    pictures: int = 1000
    per_video: int = 1000
    """Pictures per video; each video has a random stream of its own."""
    width: int = 640
    height: int = 360
    fps: float = 25.0
    no_court: float = 0.12
    """Share of pictures without a court of the scene."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low, high in (
            ("pictures", 1, 10_000_000),
            ("per_video", 1, 100_000),
            ("width", 64, 7680),
            ("height", 36, 4320),
            ("fps", 1.0, 240.0),
            ("no_court", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"MixOptions.{name}: expected {low} to {high}, got {value}")
        if self.width % 2 or self.height % 2:
            raise ValueError(f"MixOptions.width, height: expected even numbers, got {self.width}x{self.height}")

    @property
    def videos(self) -> int:
        """Number of videos."""
        return -(-self.pictures // self.per_video)

    def pictures_of(self, video: int) -> int:
        """Pictures of one video."""
        return min(self.per_video, self.pictures - video * self.per_video)


def mix_pictures(
    scene: Scene, options: MixOptions, seed: int, video: int
) -> Iterator[tuple[UInt8[np.ndarray, "height width 3"], View | None]]:
    """The pictures of one video of the mix and their cameras, None where no court is seen.

    A video's pictures depend on the seed and its number alone.
    """
    rng = np.random.default_rng([seed, video])
    props: Props | None = None
    for index in range(options.pictures_of(video)):
        if index % 250 == 0:
            props = draw_props(rng, scene, options.width, options.height)
        assert props is not None
        yield _one(rng, props, options)


def _one(rng: np.random.Generator, props: Props, options: MixOptions) -> tuple[np.ndarray, View | None]:
    size = (options.width, options.height)
    if rng.random() < options.no_court:
        return draw_negative(rng, *size, props), None
    court = props.scene.court
    assert court is not None
    view = any_view(rng, court, size)
    while points_in_picture(court, view, size) < MIN_POINTS:
        view = any_view(rng, court, size)
    others = [s.court for s in props.others if s.court is not None]
    world = draw_world(rng, props.scene, others, props.textures, props.cast, view.centre_world, hard=True)
    if rng.random() < 0.12:
        world = replace(world, front=polygons([]))
    picture = draw_picture(props.canvas, world, view, props.textures.noise)
    finish = draw_finish(rng, *size, hard=bool(rng.random() < 0.55))
    shift = (int(rng.integers(0, 64)), int(rng.integers(0, 64)))
    return finished(picture, finish, props.textures.grain[finish.noise_kind], shift), view
