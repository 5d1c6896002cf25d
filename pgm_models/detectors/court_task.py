"""Learning where a court's points are, from frames whose camera is known."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import cast

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional as F

from pgm_data.court import Court
from pgm_data.detect.court_network import (
    INPUT_SIZE,
    STRIDE,
    Letterbox,
    cell_from_input,
    input_from_cell,
    input_planes,
    read_peaks,
)
from pgm_models.detectors.augment import (
    AugmentOptions,
    Warp,
    plain_warp,
    random_look,
    random_warp,
    shuffled,
    warp_picture,
)
from pgm_models.detectors.clip_pictures import FrameSet
from pgm_models.detectors.court_frames import ClipFrames, CourtFrame
from pgm_models.detectors.distractors import draw_other_court
from pgm_models.detectors.heatmap_net import HeatmapNet, Preset
from pgm_models.train import Batch, Task

GRID = (INPUT_SIZE[1] // STRIDE, INPUT_SIZE[0] // STRIDE)
"""Rows and columns of the heat maps."""
IGNORED_PX = 6.0
"""A point up to this far outside the picture, input pixels, is neither asked for nor punished."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtTaskOptions:
    """What a court network is shown and how its answers are weighed."""

    preset: Preset = "small"
    """Size of the network."""
    batch: int = 16
    """Pictures per batch."""
    sigma: float = 1.0
    """Standard deviation of a point's target, cells."""
    line_weight: float = 4.0
    """Weight of the painted-line map beside the points."""
    tiles: float = 0.03
    """Share of pictures cut into tiles and mixed, which then show no court."""
    other_courts: float = 0.25
    """Share of pictures without a court that get another sport's lines drawn in."""
    seed: int = 0
    """Of the order of frames and of all changes to them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What the network should say of one input."""

    cells: Float[np.ndarray, "points 2"]
    """Cell coordinates of the points; 0 where absent."""
    present: Bool[np.ndarray, " points"]
    """Whether the point is in the picture."""
    counted: Bool[np.ndarray, " points"]
    """Whether the point counts: not those just outside the picture."""
    line: Float[np.ndarray, "rows columns"]
    """Share of each cell that is painted line, in 0..1."""


def mirror_order(names: tuple[str, ...]) -> np.ndarray:
    """For each name, the index of the one with left and right exchanged.

    Raises:
        ValueError: If a name's mirror image is not among them.
    """
    swapped = [n.replace("left", "\0").replace("right", "left").replace("\0", "right") for n in names]
    stray = [n for n in swapped if n not in names]
    if stray:
        raise ValueError(f"court points: expected the mirror image of each name, got none called {stray[0]!r}")
    return np.array([names.index(n) for n in swapped])


def truth_of(frame: CourtFrame, warp: Warp, order: np.ndarray) -> Truth:
    """What the network should say of the frame seen through the warp."""
    size = np.array([frame.bgr.shape[1], frame.bgr.shape[0]])
    source = frame.points_px[order] if warp.mirrored else frame.points_px
    seen = warp.points(source)
    inside = np.minimum(source + 0.5, size - 0.5 - source).min(axis=1) * warp_scale(warp)
    low, high = np.array(warp.window[:2]), np.array(warp.window[2:])
    depth = np.minimum(inside, np.minimum(seen - low, high - seen).min(axis=1))
    present = depth >= 0  # NaN compares false: no such point
    line = _line_map(frame, warp, size)
    return Truth(
        cells=np.where(present[:, None], cell_from_input(seen), 0.0),
        present=present,
        counted=present | ~(depth > -IGNORED_PX),
        line=line,
    )


def warp_scale(warp: Warp) -> float:
    """Mean enlargement of a warp: input pixels per picture pixel."""
    return float(np.sqrt(abs(np.linalg.det(warp.input_from_picture[:, :2]))))


def _line_map(frame: CourtFrame, warp: Warp, size: np.ndarray) -> np.ndarray:
    canvas = np.zeros(GRID, np.uint8)
    cells = cell_from_input(warp.points(frame.lines_px))
    inside = np.all(np.minimum(frame.lines_px + 0.5, size - 0.5 - frame.lines_px) >= 0, axis=-1)
    for samples, shown in zip(cells, inside, strict=True):
        for k in range(len(samples) - 1):
            if shown[k] and shown[k + 1] and np.abs(samples[k : k + 2]).max() < 1000:
                ends = np.round(samples[k : k + 2] * 16).astype(int)
                cv2.line(canvas, tuple(ends[0].tolist()), tuple(ends[1].tolist()), 255, 1, cv2.LINE_AA, 4)
    left, top, right, bottom = (round((edge + 0.5) / STRIDE) for edge in warp.window)
    cut = np.zeros_like(canvas)
    cut[top:bottom, left:right] = canvas[top:bottom, left:right]
    return cut / 255.0


class CourtTask(Task):
    """Points and lines of one court, from a set of frames that may grow while training goes on."""

    def __init__(
        self,
        court: Court,
        frames: Callable[[], FrameSet[ClipFrames]],
        options: CourtTaskOptions,
        augment: AugmentOptions,
        *,
        held_out: int = 320,
    ) -> None:
        """`frames` is asked for the frames before each batch; what is held out is taken from its first answer."""
        self.court = court
        self.options = options
        self.augment = augment
        self._frames = frames
        self._order = mirror_order(court.all_names)
        first = frames()
        chosen = np.linspace(0, len(first.held_out) - 1, min(held_out, len(first.held_out))).astype(int)
        self._held_out = [(first.clips[c], int(f)) for c, f in first.held_out[chosen]]

    def describe(self) -> dict[str, object]:
        """Options, point names and data."""
        frames = self._frames()
        return {
            "points": list(self.court.all_names),
            "options": asdict(self.options),
            "augment": asdict(self.augment),
            "clips": {clip.clip_id: len(clip) for clip in frames.clips},
            "training_frames": len(frames.training),
        }

    def batch(self, index: int) -> Batch:
        """Random frames, changed at random; all from the seed and the batch's number."""
        frames = self._frames()
        samples = [
            self._sample(frames, np.random.default_rng([self.options.seed, index, k]))
            for k in range(self.options.batch)
        ]
        pictures, truths, names = zip(*samples, strict=True)
        return _tensors(pictures, truths, names)

    def _sample(self, frames: FrameSet[ClipFrames], rng: np.random.Generator) -> tuple[np.ndarray, Truth, str]:
        clip, number = frames.training[rng.integers(len(frames.training))]
        frame = frames.clips[clip].frame(int(number))
        if not frame.has_court and rng.random() < self.options.other_courts:
            other_clip, other = frames.training[rng.integers(len(frames.training))]
            frame = replace(frame, bgr=draw_other_court(frame.bgr, frames.clips[other_clip].frame(int(other)), rng))
        warp = random_warp((frame.bgr.shape[1], frame.bgr.shape[0]), rng, self.augment)
        picture = warp_picture(frame.bgr, warp, rng)
        truth = truth_of(frame, warp, self._order)
        if rng.random() < self.options.tiles:
            picture, truth = shuffled(picture, rng), nothing(len(truth.present))
        return random_look(picture, rng, self.augment), truth, frame.name

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Cross entropy of each point's place or absence, and of the line map."""
        given = batch.tensors
        net = cast(HeatmapNet, network)
        features, whole = net.features(given["picture"])
        with torch.autocast("cpu", enabled=False):  # bfloat16 logits would be too coarse for sub-cell peaks
            maps, absent, line = net.read(features.float(), whole.float())
            points = point_loss(maps, absent, given["cells"], given["present"], given["counted"], self.options.sigma)
            painted = F.binary_cross_entropy_with_logits(line, given["line"], pos_weight=torch.tensor(3.0))
            loss = points + self.options.line_weight * painted
        return loss, {"points": points.detach(), "line": painted.detach()}

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Errors in pixels of the held-out pictures and how scores mislead; nothing where no picture is held out."""
        if not self._held_out:
            return {}
        return figures_of(predict(network, [clip.frame(f) for clip, f in self._held_out], self._order))


def nothing(points: int) -> Truth:
    """The truth of a picture without a court."""
    return Truth(
        cells=np.zeros((points, 2)), present=np.zeros(points, bool), counted=np.ones(points, bool), line=np.zeros(GRID)
    )


def _tensors(pictures: tuple, truths: tuple, names: tuple) -> Batch:
    return Batch(
        tensors={
            "picture": torch.from_numpy(input_planes(np.stack(pictures))).contiguous(memory_format=torch.channels_last),
            "cells": torch.from_numpy(np.stack([t.cells for t in truths]).astype(np.float32)),
            "present": torch.from_numpy(np.stack([t.present for t in truths])),
            "counted": torch.from_numpy(np.stack([t.counted for t in truths])),
            "line": torch.from_numpy(np.stack([t.line for t in truths]).astype(np.float32)),
        },
        names=tuple(names),
    )


def point_loss(
    maps: Float[Tensor, "batch points rows columns"],
    absent: Float[Tensor, "batch points"],
    cells: Float[Tensor, "batch points 2"],
    present: Tensor,
    counted: Tensor,
    sigma: float,
) -> Tensor:
    """Divergence of the predicted places from a Gaussian at the true cell or from absence; mean of counted points."""
    rows, columns = maps.shape[2:]
    x = torch.softmax(-0.5 * ((torch.arange(columns) - cells[..., :1]) / sigma) ** 2, dim=-1)
    y = torch.softmax(-0.5 * ((torch.arange(rows) - cells[..., 1:]) / sigma) ** 2, dim=-1)
    expected = torch.einsum("bny,bnx,bnyx->bn", y, x, maps)
    # The least value that a perfect answer reaches: the entropy of the target.
    entropy = -(torch.xlogy(x, x).sum(-1) + torch.xlogy(y, y).sum(-1))
    whole = torch.logsumexp(torch.cat([maps.flatten(2), absent[..., None]], dim=-1), dim=-1)
    each = whole - torch.where(present, expected + entropy, absent)
    return (each * counted).sum() / counted.sum().clamp(min=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Predictions:
    """What a network said of some pictures, beside the truth."""

    error_px: Float[np.ndarray, "pictures points"]
    """Distance from the truth, picture pixels; NaN where the point is absent."""
    scores: Float[np.ndarray, "pictures points"]
    present: Bool[np.ndarray, "pictures points"]
    counted: Bool[np.ndarray, "pictures points"]
    has_court: Bool[np.ndarray, " pictures"]


@torch.no_grad()
def predict(network: nn.Module, frames: list[CourtFrame], order: np.ndarray) -> Predictions:
    """The network's answers to unchanged pictures, read as the reader reads them."""
    network.eval()
    errors, scores, present, counted = [], [], [], []
    for frame in frames:
        size = (frame.bgr.shape[1], frame.bgr.shape[0])
        box = Letterbox(picture_size=size)
        truth = truth_of(frame, plain_warp(size), order)
        picture = torch.from_numpy(input_planes(box.fill(frame.bgr)))[None].contiguous(
            memory_format=torch.channels_last
        )
        maps, absent, _ = network(picture)
        cells, score = read_peaks(maps[0].numpy().astype(float), absent[0].numpy().astype(float))
        pixels = box.picture_from_input(input_from_cell(cells))
        errors.append(np.where(truth.present, np.linalg.norm(pixels - frame.points_px, axis=1), np.nan))
        scores.append(score)
        present.append(truth.present)
        counted.append(truth.counted)
    return Predictions(
        error_px=np.stack(errors),
        scores=np.stack(scores),
        present=np.stack(present),
        counted=np.stack(counted),
        has_court=np.array([frame.has_court for frame in frames]),
    )


def figures_of(said: Predictions) -> dict[str, float]:
    """Median, 90 % and 99 % error of points scored at 0.5 or better, and how often scores mislead."""
    sure = said.present & (said.scores >= 0.5)
    error = said.error_px[sure] if sure.any() else np.array([np.nan])
    absent = ~said.present & said.counted
    bare = said.scores[~said.has_court].max(axis=1) if (~said.has_court).any() else np.array([np.nan])
    return {
        "median_px": float(np.median(error)),
        "p90_px": float(np.quantile(error, 0.9)),
        "p99_px": float(np.quantile(error, 0.99)),
        "under_5px": float((error < 5).mean()),
        "found": float(sure.sum() / max(said.present.sum(), 1)),
        "false_points": float((said.scores[absent] >= 0.5).mean()) if absent.any() else float("nan"),
        "no_court_top_score_p95": float(np.quantile(bare, 0.95)),
    }
