"""People in the pictures before anybody knows who they are: what every detector of people gives."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.scene import Scene

Pictures = Callable[[], Iterator[np.ndarray]]
"""A fresh pass over the pictures of a clip, BGR uint8 (height, width, 3), one a frame, in order."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PersonCandidates:
    """Perhaps people, in order of their frames."""

    frame: Int[np.ndarray, " people"]
    """Frame of the clip, from 0."""
    boxes_px: Float[np.ndarray, "people 4"]
    """x0, y0, x1, y1 around the body without its racket, px; may reach beyond the picture."""
    ground_world: Float[np.ndarray, "people 2"]
    """World x and y of the point between the feet, projected on the ground, metres."""
    person: Float[np.ndarray, " people"]
    """Probability that it is a person."""
    player: Float[np.ndarray, " people"]
    """Probability that it is one who plays, given that it is a person; NaN where the detector cannot tell."""


@runtime_checkable
class PersonFinder(Protocol):
    """A detector of people."""

    def find(self, pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], scene: Scene) -> PersonCandidates:
        """People in the frames of a clip that have a camera; `size` is width and height of the pictures, px."""
        ...
