"""A sheet of judged frames: what is true, what was made of it, and where they differ; the worst ones among them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.files import whole_file
from pgm_models.image_metrics import mean_in, psnr_of_error, squared_errors
from pgm_models.synthesis.evaluate_frames import Maker, colours, judged_pixels
from pgm_models.synthesis.evaluate_result import SynthesisEvaluation
from pgm_models.synthesis.frames import FrameStore

SHEET_NAME, NOVEL_NAME = "pictures.png", "novel.png"
GAIN = 4.0
"""By which differences are shown."""
LEAST_WIDTH = 480
"""Of a picture on the sheet, px: smaller ones are shown larger."""
TITLE_PX = 18
"""Height of the line above each row."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A frame on the sheet."""

    row: int
    """Of the store."""
    why: str
    """What it is an example of."""


def shown_frames(result: SynthesisEvaluation, store: FrameStore, *, usual: int = 2) -> tuple[Shown, ...]:
    """Some usual frames, and the worst: of the whole frame, within each player, and of the ball."""
    rows = np.concatenate(
        [
            store.clip_rows(clip.clip)[np.searchsorted(store.frame[store.clip_rows(clip.clip)], clip.frames)]
            for clip in result.clips
        ]
    )
    columns = result.columns()
    even = ((np.arange(usual) + 0.5) / usual * len(rows)).astype(np.int64)
    reasons: dict[int, list[str]] = {int(rows[place]): ["one of many"] for place in np.unique(even)}
    players = {player.name for player in store.scene.players}
    for name, values in columns.items():
        figure, kind, where = name.split(" ", 2)
        worst, why = None, ""
        if figure == "psnr" and kind == "final" and where.removesuffix("-alpha") in players | {"frame"}:
            worst, why = -values, f"lowest PSNR, {where}"
        elif (figure, kind, where) == ("distance", "made", "ball"):
            worst, why = values, "ball farthest from its place, or not found"
        if worst is not None and not np.isnan(worst).all():
            reasons.setdefault(int(rows[int(np.nanargmax(worst))]), []).append(why)
    return tuple(Shown(row=row, why=", ".join(why)) for row, why in reasons.items())


def sheet(store: FrameStore, maker: Maker, frames: Sequence[Shown]) -> UInt8[np.ndarray, "height width 3"]:
    """Rows of truth, made picture and difference, BGR, each with a line that says which frame it is and why."""
    strips = []
    for each in frames:
        real, made = colours(store, each.row), np.clip(maker(each.row).final, 0.0, 1.0)
        error = mean_in(squared_errors(made[None], real[None]), judged_pixels(store, each.row)[None])
        psnr = float(psnr_of_error(error)[0])
        strips.append(strip(f"{store.place(each.row)}: {each.why}; {psnr:.1f} dB", real, made))
    return np.concatenate(strips)


def strip(
    title: str, real: Float[np.ndarray, "3 height width"], made: Float[np.ndarray, "3 height width"]
) -> UInt8[np.ndarray, "_ _ 3"]:
    """A line of words, and below it truth, made picture and difference, BGR."""
    import cv2

    tiles = [_tile(picture) for picture in (real, made, np.clip(GAIN * np.abs(made - real), 0.0, 1.0))]
    line = np.full((TITLE_PX, 3 * tiles[0].shape[1], 3), 255, np.uint8)
    text = f"{title}; truth | made | difference x{GAIN:g}"
    cv2.putText(line, text, (4, TITLE_PX - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([line, np.concatenate(tiles, axis=1)])


def write_sheet(folder: Path, store: FrameStore, maker: Maker, result: SynthesisEvaluation) -> None:
    """Write the sheet into a folder that is there.

    Raises:
        ValueError: If the picture cannot be written.
    """
    write_strips(folder / SHEET_NAME, [sheet(store, maker, shown_frames(result, store))])


def write_strips(path: Path, strips: Sequence[UInt8[np.ndarray, "_ _ 3"]]) -> None:
    """Write strips one below the other as a PNG.

    Raises:
        ValueError: If there is none, or they cannot be written.
    """
    import cv2

    if not strips:
        raise ValueError(f"{path}: expected strips, got none")
    done, content = cv2.imencode(".png", np.concatenate(strips))
    if not done:
        raise ValueError(f"{path}: expected a picture that PNG can hold, got {len(strips)} strips")
    with whole_file(path) as temporary:
        temporary.write_bytes(content.tobytes())


def _tile(picture: Float[np.ndarray, "3 height width"]) -> UInt8[np.ndarray, "larger wider 3"]:
    """As bytes, BGR, larger by a whole number where it is small."""
    factor = max(1, -(-LEAST_WIDTH // picture.shape[2]))
    image = (255 * picture.transpose(1, 2, 0)[..., ::-1] + 0.5).astype(np.uint8)
    return image.repeat(factor, axis=0).repeat(factor, axis=1)
