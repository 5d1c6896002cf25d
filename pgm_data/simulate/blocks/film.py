"""Walks in the world of blocks as shots of a video."""

from collections.abc import Iterator

import numpy as np

from pgm_data.scene import Scene
from pgm_data.simulate.blocks.shots import BlocksShot, blocks_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.shots import Graphics, Masks, SimulatedShot, later


def film_shots(scene: Scene, options: ClipOptions, seed: int) -> Iterator[SimulatedShot]:
    """The shots of a video in order; they depend on the arguments alone.

    Raises:
        ValueError: If the scene is not the world of blocks.
    """
    if scene.name != "blocks":
        raise ValueError(f"scene {scene.name}: expected blocks or a scene with a court to draw, got no court")
    size = (options.width, options.height)
    first = 0
    for shot in blocks_shots(
        scene,
        seed,
        frames=options.frames,
        fps=options.fps,
        size=size,
        quality=options.quality,
        world_seed=options.world_seed,
    ):
        yield _filmed(shot, first)
        first += len(shot.timestamps)


def _filmed(shot: BlocksShot, first: int) -> SimulatedShot:
    count = len(shot.timestamps)

    def pictures(first: int) -> Iterator[np.ndarray]:
        for frame in range(first, count):
            yield shot.draw(frame)

    def masks() -> Iterator[Masks]:
        for frame in range(count):
            labels, depth = shot.masks(frame)
            yield Masks(labels=labels, depth=depth)

    return SimulatedShot(
        kind="clip",
        first_frame=first,
        timestamps=shot.timestamps,
        capture_times=shot.timestamps,
        is_duplicate=np.zeros(count, bool),
        track=shot.track,
        states=later(shot.states, float(shot.timestamps[0])),
        graphics=Graphics(shutter_s=None, ui_boxes_px=()),
        drawn=pictures,
        masks=masks,
    )
