"""What the objects of a match look like: the mean of the style codes that some of its pictures give."""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.object_boxes import scaled_pixels
from pgm_models.synthesis.picture_shelf import as_picture
from pgm_models.synthesis.style_encoder import shown


def match_styles(model: SynthesisModel, store: FrameStore, *, pictures: int = 8) -> dict[str, Tensor]:
    """The styles of each match of a store, "objects style" each, in the order of its clips.

    Args:
        model: Reads styles.
        store: Of the model's scene, with videos; a match whose clips have no frame in it is left out.
        pictures: Frames that each object is looked at in, at most.

    Raises:
        ValueError: If a picture cannot be read; names clip and frame.
    """
    of_frame = np.array(store.matches, dtype=object)[store.clip]
    names = [name for name in dict.fromkeys(store.matches) if (of_frame == name).any()]
    return {name: styles_of(model, store, np.flatnonzero(of_frame == name), pictures=pictures)[0] for name in names}


@torch.no_grad()
def styles_of(
    model: SynthesisModel, store: FrameStore, rows: Int[np.ndarray, " some"], *, pictures: int = 8
) -> Float[Tensor, "1 objects style"]:
    """The mean code of each object over evenly spaced frames of those rows that show it.

    A player object that is one person and then another is the one who is there in more frames. An object that no frame
    shows has the encoder's code for what is not seen.

    Args:
        model: Reads styles.
        store: Of the model's scene, with videos.
        rows: Of the store.
        pictures: Frames that each object is looked at in, at most.

    Raises:
        ValueError: If a picture cannot be read; names clip and frame.
    """
    boxes = torch.from_numpy(store.boxes_px[rows].astype(np.float32))
    seen = shown(boxes, (store.size[1], store.size[0])).numpy()
    chosen = [_spread(rows[own], pictures) for own in (seen & _same_person(store, rows)).T]
    codes = model.encoder.unseen.detach().clone()
    sums, counts = torch.zeros_like(codes), [0] * len(codes)
    for row in np.unique(np.concatenate(chosen)).tolist():
        picture, box = _looked_at(store, row, model.options.picture[0])
        read = model.encoder(picture[None].to(model.device), box[None].to(model.device))[0]
        for thing, own in enumerate(chosen):
            if row in own:
                sums[thing] += read[thing]
                counts[thing] += 1
    for thing, count in enumerate(counts):
        if count:
            codes[thing] = sums[thing] / count
    return codes[None]


def _same_person(store: FrameStore, rows: Int[np.ndarray, " some"]) -> Bool[np.ndarray, "some objects"]:
    """Where each object is the person that it is most often; everywhere where nobody knows."""
    same = np.ones((len(rows), len(store.scene.objects)), dtype=bool)
    for number, player in enumerate(store.scene.players):
        identity = store.identity[rows, number]
        known = identity[identity >= 0]
        if len(known):
            same[:, store.scene.objects.index(player)] = identity == np.bincount(known).argmax()
    return same


def _spread(rows: Int[np.ndarray, " all"], count: int) -> Int[np.ndarray, " few"]:
    """So many of them at most, evenly spaced, each from the middle of its stretch."""
    count = min(count, len(rows))
    return rows[((np.arange(count) + 0.5) * len(rows) / max(count, 1)).astype(np.int64)]


def _looked_at(
    store: FrameStore, row: int, width: int
) -> tuple[Float[Tensor, "3 height width"], Float[Tensor, "objects 4"]]:
    """A frame's picture as wide as those that the encoder learned from, at most, and the objects' boxes in it."""
    image, boxes = store.rgb(row), store.boxes_px[row].astype(np.float64)
    if store.size[0] > width:
        import cv2

        size = (width, max(1, round(store.size[1] * width / store.size[0])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        factor = np.array([size[0] / store.size[0], size[1] / store.size[1]])
        boxes = scaled_pixels(boxes.reshape(-1, 2), factor).reshape(-1, 4)
    return as_picture(image), torch.from_numpy(boxes.astype(np.float32))
