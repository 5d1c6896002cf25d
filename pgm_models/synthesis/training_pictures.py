"""How far a training is, to look at: whole frames that it does not learn from, the real ones beside the rendered."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from pgm_data.dataset.files import whole_file
from pgm_models.animation.training_plots import write_loss_curves
from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.studio import Studio

SAMPLES_NAME = "samples"
"""Folder of a run with its pictures."""
FRAMES = 3
"""In a picture, one below the other, at most."""
GAP_PX = 4
"""White between pictures."""


def training_pictures(store: FrameStore, *, frames: int = FRAMES) -> Callable[[SynthesisModel, Path, int], None]:
    """What writes `samples/step_000123.png` and the run's losses so far, as `loss.csv` and `loss.png`.

    Args:
        store: Frames that may be shown; so many of them are, evenly spaced.
        frames: Of a picture, at most.
    """
    count = min(frames, len(store))
    rows = ((np.arange(count) + 0.5) * len(store) / max(count, 1)).astype(np.int64)

    def look(model: SynthesisModel, run: Path, step: int) -> None:
        if count:
            pairs = [(store.picture(row), rendered_frame(model, store, row)) for row in rows.tolist()]
            write_pairs(run / SAMPLES_NAME / f"step_{step:06d}.png", pairs)
        write_loss_curves(run)

    return look


@torch.no_grad()
def rendered_frame(model: SynthesisModel, store: FrameStore, row: int) -> Float[Tensor, "3 height width"]:
    """A frame as the model renders it in the styles that its own picture shows, at the store's size, RGB 0 to 1.

    Raises:
        ValueError: If its picture cannot be read; names clip and frame.
    """
    device = model.device
    boxes = torch.from_numpy(store.boxes_px[[row]].astype(np.float32)).to(device)
    styles = model.encoder(store.picture(row, device)[None], boxes)
    studio = Studio(model, styles, *store.size)
    return studio.picture(store.cameras[row], store.states([row], device)).rgb.cpu()


def write_pairs(
    path: Path, pairs: list[tuple[Float[Tensor, "3 height width"], Float[Tensor, "3 height width"]]]
) -> None:
    """Write pairs of pictures of one size, RGB 0 to 1, as one PNG file: a pair side by side, pairs below each other.

    Raises:
        ValueError: If the picture cannot be written.
    """
    rows = []
    for pair in pairs:
        left, right = (as_bgr(picture) for picture in pair)
        rows += [np.concatenate([left, np.full_like(left[:, :GAP_PX], 255), right], axis=1)]
        rows += [np.full_like(rows[-1][:GAP_PX], 255)]
    sheet = np.concatenate(rows[:-1])
    done, encoded = cv2.imencode(".png", sheet)
    if not done:
        raise ValueError(f"{path}: expected a picture that can be written, got one of shape {sheet.shape}")
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def as_bgr(picture: Float[Tensor, "3 height width"]) -> UInt8[np.ndarray, "height width 3"]:
    """A picture, RGB 0 to 1, as OpenCV has it."""
    levels = (picture.clamp(0.0, 1.0) * 255).round().to(torch.uint8)
    return np.ascontiguousarray(levels.flip(0).permute(1, 2, 0).cpu().numpy())
