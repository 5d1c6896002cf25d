"""Figures of made pictures beside the real ones, frame after frame of a clip.

A COLUMN holds one number a frame and is called `FIGURE STAGE WHERE`: `psnr final frame`, `ssim raw player0`. Stages
are `final`, after the enhancer, and `raw`, before it; where is `frame`, or an object, whose mask is the true one, or
`OBJECT-alpha`, whose mask is the renderer's own. Distances of found objects (`evaluate_objects`) are called
`distance made ball`: made, real, alpha or chance. A number that there is not is NaN. Graphics over the picture are not
judged: their pixels are left out of means over pixels, and are the real ones' elsewhere.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_models.image_detections import mask_iou
from pgm_models.image_differences import median_background
from pgm_models.image_metrics import (
    WINDOW,
    mean_in,
    most_scales,
    ms_ssim,
    psnr_of_error,
    squared_errors,
    ssim_map,
    steadiness,
)
from pgm_models.synthesis.evaluate_objects import (
    FindOptions,
    alpha_distances,
    chance_distance,
    found_distances,
    places_of,
)
from pgm_models.synthesis.evaluate_truth import TruePixels, true_pixels
from pgm_models.synthesis.frames import FrameStore

BLOCK = 8
"""Frames whose pictures are in memory together."""
OWN = 0.5
"""Share of a pixel from which on the renderer's mask holds it."""
BALL_MARGIN_PX = 1.0
"""About the box of the ball, whose pixels are judged together: it covers few of them wholly."""
UI_MARGIN_PX = 1.0
"""About graphics, whose edges are blurred."""
BACKGROUND_FRAMES = 31
"""Of a match whose camera stands still, of which the real background is the median."""
LEAST_BACKGROUND = 12
"""With fewer there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Made:
    """A made picture, RGB 0 to 1."""

    final: Float[np.ndarray, "3 height width"]
    """After the enhancer."""
    raw: Float[np.ndarray, "3 height width"]
    """Before it."""
    without: Float[np.ndarray, "3 height width"]
    """The final picture of the same without players and ball."""
    shares: Float[np.ndarray, "objects height width"]
    """How much of each pixel each object is."""
    seconds: float
    """Of making the final picture."""


Maker = Callable[[int], Made]
"""Makes the picture of a frame, by its row in the store."""
Words = Callable[[Float[np.ndarray, "frames 3 height width"], Float[np.ndarray, "frames 3 height width"]], None]
"""Is told made and real pictures of a block of frames that follow each other."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipFigures:
    """What was found in the judged frames of one clip."""

    clip: str
    match: str
    frames: Int[np.ndarray, " frames"]
    """Their numbers in the clip."""
    columns: Mapping[str, Float[np.ndarray, " frames"]]
    """By name."""
    seconds: float
    """Of making their pictures."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipJob:
    """Frames of one clip that are judged."""

    store: FrameStore
    rows: Int[np.ndarray, " frames"]
    """Of the store, in order."""
    standing: Int[np.ndarray, " standing"]
    """Rows of the match whose camera is the clip's: what the real background is taken from. None where it moves."""
    truth: Path | None
    """Folder with the clip's labels; the renderer's own masks are taken without."""
    find: FindOptions


def clip_figures(
    job: ClipJob,
    maker: Maker,
    *,
    lpips: Callable[[np.ndarray, np.ndarray], Float[np.ndarray, " frames"]] | None = None,
    words: Words | None = None,
    tell: Callable[[int], None] = lambda done: None,
) -> ClipFigures:
    """Figures of each frame; memory does not grow with their number.

    Args:
        job: Which frames.
        maker: Makes their pictures.
        lpips: Compares made and real pictures, where its network is at hand.
        words: Is told the pictures.
        tell: Is told how many frames are done.

    Raises:
        ValueError: If a picture or the truth of a frame cannot be read.
    """
    store, rows = job.store, job.rows
    behind = real_background(store, job.standing)
    truths: Iterator[TruePixels | None] = iter(lambda: None, 0)
    if job.truth is not None:
        truths = true_pixels(job.truth, store.frame[rows].tolist())
    parts: list[dict[str, np.ndarray]] = []
    before: tuple[np.ndarray, np.ndarray, int] | None = None
    seconds = 0.0
    for start in range(0, len(rows), BLOCK):
        block = rows[start : start + BLOCK]
        made = [maker(int(row)) for row in block]
        seconds += sum(one.seconds for one in made)
        real = np.stack([colours(store, int(row)) for row in block])
        seen = np.stack([judged_pixels(store, int(row)) for row in block])
        final, raw = (_filled(np.stack([getattr(one, name) for one in made]), real, seen) for name in ("final", "raw"))
        block_truth = [next(truths) for _ in block]
        masks = _masks(job, block, made, block_truth)
        columns = {
            **_likeness("final", final, real, seen, masks),
            **_likeness("raw", raw, real, seen, masks),
            **_objects(job, block, made, real, behind, block_truth),
            **_changes(store, block, final, real, before),
        }
        if lpips is not None:
            columns["lpips final frame"] = lpips(final, real)
        if words is not None:
            words(final, real)
        before = (final[-1:], real[-1:], int(block[-1]))
        parts.append(columns)
        tell(min(start + BLOCK, len(rows)))
    first = store.clips[int(store.clip[rows[0]])]
    return ClipFigures(
        clip=first.clip_id,
        match=first.match_id,
        frames=store.frame[rows],
        columns=joined_columns(parts, [len(rows[start : start + BLOCK]) for start in range(0, len(rows), BLOCK)]),
        seconds=seconds,
    )


def joined_columns(parts: Sequence[Mapping[str, np.ndarray]], counts: Sequence[int]) -> dict[str, np.ndarray]:
    """The columns of parts one after the other, so many frames each; NaN where a part has none of that name."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate(
            [part.get(name, np.full(count, np.nan)) for part, count in zip(parts, counts, strict=True)]
        )
        for name in names
    }


def colours(store: FrameStore, row: int) -> Float[np.ndarray, "3 height width"]:
    """The real picture of a frame."""
    return np.ascontiguousarray(store.rgb(row).transpose(2, 0, 1)).astype(np.float32) / np.float32(255)


def judged_pixels(store: FrameStore, row: int) -> Bool[np.ndarray, "height width"]:
    """Pixels of a frame that no graphics cover."""
    width, height = store.size
    seen = np.ones((height, width), dtype=bool)
    for x0, y0, x1, y1 in store.ui_boxes_px(row):
        seen[_span(y0 - UI_MARGIN_PX, y1 + UI_MARGIN_PX), _span(x0 - UI_MARGIN_PX, x1 + UI_MARGIN_PX)] = False
    return seen


def _span(low: float, high: float) -> slice:
    """The pixels that reach from one place to another, their halves beside their middles included."""
    return slice(max(int(np.floor(low + 0.5)), 0), max(int(np.ceil(high + 0.5)), 0))


def _filled(made: np.ndarray, real: np.ndarray, seen: np.ndarray) -> np.ndarray:
    return np.where(seen[:, None], np.clip(made, 0.0, 1.0), real)


def real_background(
    store: FrameStore, standing: Int[np.ndarray, " standing"]
) -> Float[np.ndarray, "3 height width"] | None:
    """The median picture of frames of one camera; None of too few."""
    if len(standing) < LEAST_BACKGROUND:
        return None
    chosen = standing[np.unique(np.linspace(0, len(standing) - 1, BACKGROUND_FRAMES).round().astype(np.int64))]
    return median_background([colours(store, int(row)) for row in chosen])


def _masks(
    job: ClipJob, block: np.ndarray, made: Sequence[Made], truths: Sequence[TruePixels | None]
) -> dict[str, Bool[np.ndarray, "frames height width"]]:
    """Pixels of each object by the name under which they are judged."""
    store = job.store
    width, height = store.size
    masks = {}
    for number, thing in enumerate(store.scene.objects):
        if thing.kind == "ball":
            masks[thing.name] = np.stack([_ball_box(store, int(row), number, (width, height)) for row in block])
            continue
        own = []
        for one, truth in zip(made, truths, strict=True):
            if truth is None:
                own.append(one.shares[number] >= OWN)
            else:
                # What is infinitely far has no label.
                own.append(truth.mask(-1 if thing.kind == "skybox" else number, store.size))
        masks[thing.name if job.truth is not None else f"{thing.name}-alpha"] = np.stack(own)
    return masks


def _ball_box(store: FrameStore, row: int, thing: int, size: tuple[int, int]) -> Bool[np.ndarray, "height width"]:
    mask = np.zeros((size[1], size[0]), dtype=bool)
    x0, y0, x1, y1 = store.boxes_px[row, thing].astype(np.float64)
    if np.isfinite(x0 + y0 + x1 + y1):
        margin = BALL_MARGIN_PX
        mask[_span(y0 - margin, y1 + margin), _span(x0 - margin, x1 + margin)] = True
    return mask


def _likeness(
    stage: str,
    made: np.ndarray,
    real: np.ndarray,
    seen: Bool[np.ndarray, "frames height width"],
    masks: Mapping[str, Bool[np.ndarray, "frames height width"]],
) -> dict[str, np.ndarray]:
    errors = squared_errors(made, real)
    scales = most_scales(*made.shape[2:])
    likeness = ssim_map(made, real) if scales else None
    columns = {}
    for where, mask in {"frame": np.ones_like(seen), **masks}.items():
        columns[f"psnr {stage} {where}"] = psnr_of_error(mean_in(errors, mask & seen))
        if likeness is not None:
            inner = mask & seen
            if where == "frame":
                inner = inner & _inner(mask.shape)
            columns[f"ssim {stage} {where}"] = mean_in(likeness, inner)
    if scales:
        columns[f"ms_ssim {stage} frame"] = ms_ssim(made, real, scales)
    return columns


def _inner(shape: tuple[int, ...]) -> Bool[np.ndarray, "..."]:
    """Pixels whose window lies in the picture, as SSIM is defined."""
    edge = WINDOW // 2
    inner = np.zeros(shape, dtype=bool)
    inner[:, edge : shape[1] - edge, edge : shape[2] - edge] = True
    return inner


def _objects(
    job: ClipJob,
    block: np.ndarray,
    made: Sequence[Made],
    real: np.ndarray,
    behind: np.ndarray | None,
    truths: Sequence[TruePixels | None],
) -> dict[str, np.ndarray]:
    store = job.store
    rows: list[dict[str, float]] = []
    for row, one, picture, truth in zip(block.tolist(), made, real, truths, strict=True):
        position = store.ball_position[row] if store.scene.ball is not None else np.full(3, np.nan)
        places = places_of(store.scene, store.size, store.cameras[row], store.boxes_px[row], position, truth)
        shown, without = np.clip(one.final, 0.0, 1.0), np.clip(one.without, 0.0, 1.0)
        radius = job.find.radius_of("player", store.size[1])
        masks = {thing.name: one.shares[n] >= OWN for n, thing in enumerate(store.scene.objects)}
        found = {
            "made": found_distances(places, shown, without, job.find),
            "alpha": alpha_distances(places, masks, radius),
        }
        if store.scene.ball is not None:
            chance = chance_distance(places, shown, without, job.find, np.random.default_rng(row))
            found["chance"] = {"ball": chance}
        if behind is not None:
            found["real"] = found_distances(places, picture, behind, job.find)
        named = {f"distance {kind} {name}": value for kind, each in found.items() for name, value in each.items()}
        if truth is not None:
            for number, thing in enumerate(store.scene.objects):
                if thing.kind == "player":
                    named[f"iou alpha {thing.name}"] = float(
                        mask_iou(masks[thing.name], truth.mask(number, store.size))
                    )
        rows.append(named)
    names = dict.fromkeys(name for named in rows for name in named)
    return {name: np.array([named.get(name, np.nan) for named in rows], dtype=np.float64) for name in names}


def _changes(
    store: FrameStore,
    block: np.ndarray,
    made: np.ndarray,
    real: np.ndarray,
    before: tuple[np.ndarray, np.ndarray, int] | None,
) -> dict[str, np.ndarray]:
    """How pictures change from the frame before; NaN where that was not judged, or is the same picture again."""
    rows = block
    if before is not None:
        made, real = np.concatenate([before[0], made]), np.concatenate([before[1], real])
        rows = np.concatenate([[before[2]], block])
    lost = np.full(len(block), np.nan)
    names = ("change_psnr final frame", "flicker final frame", "flicker real frame", "still real frame")
    columns = {name: lost.copy() for name in names}
    if len(rows) < 2:
        return columns
    changes = steadiness(made, real)
    follows = (np.diff(store.frame[rows]) == 1) & (np.diff(store.time[rows]) > 0)
    values = (changes.change_psnr, changes.flicker, changes.real_flicker, changes.still_share)
    for name, each in zip(names, values, strict=True):
        columns[name][len(block) - len(follows) :] = np.where(follows, each, np.nan)
    return columns
