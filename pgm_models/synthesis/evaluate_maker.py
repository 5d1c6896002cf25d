"""What a trained model makes of judged frames: each in the styles of its match, with its objects and without them."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from pgm_data.geometry.camera import Camera, same_camera
from pgm_models.synthesis.evaluate_frames import Made
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.match_styles import styles_of
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.studio import Picture, Studio


@dataclass(frozen=True, eq=False, kw_only=True)
class Worn:
    """What the objects of some judged frames wear."""

    rows: Int[np.ndarray, " frames"]
    """Of the store: the judged frames."""
    read: Int[np.ndarray, " others"]
    """Frames of the same match from which it is read, none of them judged."""


def worn_in(store: FrameStore, judged: Int[np.ndarray, " judged"], lent: Int[np.ndarray, " lent"]) -> tuple[Worn, ...]:
    """For each match and each way its people stand, what judged frames wear: read off frames where they stand so too.

    Where no such frame can lend, all of the match that can do.

    Args:
        store: All frames.
        judged: Rows that are judged.
        lent: Rows that styles may be read off.

    Raises:
        ValueError: If a match has no frame that can lend; names it.
    """
    match = np.unique(np.array(store.matches), return_inverse=True)[1][store.clip]
    keys = np.concatenate([match[:, None], store.identity], axis=1)
    found = []
    for key in np.unique(keys[judged], axis=0):
        rows = judged[(keys[judged] == key).all(axis=1)]
        read = lent[(keys[lent] == key).all(axis=1)]
        if not len(read):
            read = lent[match[lent] == key[0]]
        if not len(read):
            name = store.matches[int(store.clip[rows[0]])]
            raise ValueError(f"match {name}: expected frames that are not judged, to read styles off, got none")
        found.append(Worn(rows=rows, read=read))
    return tuple(found)


class RunMaker:
    """Makes judged frames; what is grown for one way of dress is kept until another is asked for."""

    def __init__(self, model: SynthesisModel, store: FrameStore, worn: Sequence[Worn], *, pictures: int = 8) -> None:
        """For a model and the frames of a store, at the store's size; styles are the means over so many pictures."""
        self.model, self.store, self.worn, self.pictures = model, store, tuple(worn), pictures
        self._of_row = {int(row): number for number, each in enumerate(worn) for row in each.rows}
        self._styles: dict[int, Tensor] = {}
        self._studio: tuple[int, Studio] | None = None
        self._without: tuple[Camera, Studio, np.ndarray] | None = None

    def __call__(self, row: int) -> Made:
        """The picture of a frame.

        Raises:
            ValueError: If the styles of its match cannot be read; names clip and frame.
        """
        studio = self.studio(row)
        states = self.store.states([row], self.model.device)
        started = time.perf_counter()
        picture = studio.picture(self.store.cameras[row], states)
        final, raw, shares = _arrays(picture)
        seconds = time.perf_counter() - started
        without = self._empty(studio, self.store.cameras[row], states)
        return Made(final=final, raw=raw, shares=shares, without=without, seconds=seconds)

    def studio(self, row: int) -> Studio:
        """Where the frame is rendered."""
        number = self._of_row[row]
        if self._studio is None or self._studio[0] != number:
            self._studio = None
            self._without = None
            self._studio = (number, Studio(self.model, self.styles(row), *self.store.size))
        return self._studio[1]

    def styles(self, row: int) -> Float[Tensor, "1 objects style"]:
        """What the objects of a frame wear."""
        number = self._of_row[row]
        if number not in self._styles:
            worn = self.worn[number]
            self._styles[number] = styles_of(self.model, self.store, worn.read, pictures=self.pictures)
        return self._styles[number]

    def _empty(self, studio: Studio, camera: Camera, states: States) -> np.ndarray:
        kept = self._without
        if kept is None or kept[1] is not studio or not same_camera(kept[0], camera):
            self._without = kept = (camera, studio, _arrays(studio.picture(camera, nobody(states)))[0])
        return kept[2]


def nobody(states: States) -> States:
    """The same frames without players and ball."""

    def gone(values: Tensor) -> Tensor:
        return torch.full_like(values, torch.nan)

    poses = {
        name: replace(each, **{field: gone(value) for field, value in vars(each).items()})
        for name, each in states.poses.items()
    }
    balls = states.balls
    if balls is not None:
        balls = replace(balls, position=gone(balls.position), path=torch.zeros_like(balls.path))
    return States(poses=poses, balls=balls)


def _arrays(picture: Picture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Final and raw colours, 0 to 1, and shares."""
    final, raw = (each.clamp(0.0, 1.0).cpu().numpy() for each in (picture.rgb, picture.features[:3]))
    return final, raw, picture.shares.cpu().numpy()
