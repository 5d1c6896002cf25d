"""Learning where a ball is in the middle one of three frames, from clips whose ball is known."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import cast

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn
from torch.nn import functional as F

from pgm_data.detect.ball.network import STRIDE, picture_planes
from pgm_models.detectors.augment import AugmentOptions, random_look
from pgm_models.detectors.ball_drawing import draw_ball, draw_distractor
from pgm_models.detectors.ball_frames import LEAST_TRACE, SEEN, UNKNOWN, BallClip
from pgm_models.detectors.ball_net import BallNet, BallPreset
from pgm_models.detectors.ball_score import predict_frames, score_frames
from pgm_models.detectors.clip_pictures import FrameSet
from pgm_models.train import Batch, Task

IGNORED_PX = 14.0
"""Within this of an unknown ball's smeared disc nothing is asked for or punished, input pixels."""
OFFSET_CELLS = 1.6
"""How far from the ball's centre cells learn where it is."""
LOOKS = AugmentOptions(shade=0.0, occlude=0.0, colour=0.7, soften=0.35, noise=0.25, jpeg=0.35)
"""Changes of looks, the same for all three frames."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallTaskOptions:
    """What a ball network is shown and how its answers are weighed."""

    preset: BallPreset = "small"
    """Size of the network."""
    batch: int = 32
    """Crops per batch."""
    per_frame: int = 8
    """Crops from each frame that was read."""
    crop: int = 192
    """Width and height of a crop, input pixels; a multiple of 16."""
    zoom: tuple[float, float] = (0.42, 1.5)
    """Range of enlargement of pictures 1280 pixels wide."""
    drawn: float = 0.5
    """Share of crops into which balls are drawn; up to three."""
    distractors: float = 0.5
    """Share of crops into which things that are no ball in flight are drawn; up to four."""
    shake_px: float = 0.35
    """Standard deviation of small movements of the whole picture between frames, in the half of crops that has them."""
    place_weight: float = 0.15
    """Weight of the place beside whether there is a ball."""
    seed: int = 0
    """Of the order of frames and of all changes to them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """What the network should say of one crop."""

    heat: Float[np.ndarray, "rows columns"]
    """1 in the cell with a ball's centre, less around it, 0 elsewhere."""
    counted: Float[np.ndarray, "rows columns"]
    """1, and 0 where it is not known whether there is a ball."""
    place: Float[np.ndarray, "2 rows columns"]
    """Of the nearest ball from each cell's centre, cells."""


def truth_of(
    balls: list[tuple[np.ndarray, np.ndarray]], unknown: list[tuple[np.ndarray, np.ndarray, float]], cells: int
) -> Truth:
    """What the network should say of a crop with these balls (pixel, streak) and unknown ones (and their radius)."""
    rows, columns = np.indices((cells, cells)).astype(float)
    heat, place = np.zeros((cells, cells)), np.zeros((2, cells, cells))
    counted, nearest = np.ones((cells, cells)), np.full((cells, cells), np.inf)
    for pixel, way in balls:
        x, y = (pixel + 0.5) / STRIDE - 0.5
        along, length = way / max(float(np.hypot(*way)), 1e-9), float(np.hypot(*way)) / STRIDE
        dx, dy = x - columns, y - rows
        u, v = dx * along[0] + dy * along[1], dy * along[0] - dx * along[1]
        near = 0.5 * (u * u / (0.8**2 + (0.2 * length) ** 2) + v * v / 0.8**2)
        heat = np.maximum(heat, np.exp(-near))
        column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
        if 0 <= row < cells and 0 <= column < cells:
            heat[row, column] = 1.0
        closer = dx * dx + dy * dy < nearest
        nearest = np.where(closer, dx * dx + dy * dy, nearest)
        place = np.where(closer, np.stack([dx, dy]), place)
    for pixel, way, radius in unknown:
        x, y = (pixel + 0.5) / STRIDE - 0.5
        ends = np.stack([rows * 0 + 0.5 * t for t in (-1.0, 0.0, 1.0)])[:, None]
        far = np.hypot(columns - x - ends * way[0] / STRIDE, rows - y - ends * way[1] / STRIDE).min(axis=(0, 1))
        counted[far < (IGNORED_PX + radius) / STRIDE] = 0.0
    return Truth(heat=heat, counted=counted, place=place)


class BallTask(Task):
    """A ball's place, from clips that may become more while training goes on."""

    def __init__(
        self,
        frames: Callable[[], FrameSet[BallClip]],
        options: BallTaskOptions,
        looks: AugmentOptions = LOOKS,
        *,
        held_out: int = 60,
    ) -> None:
        """`frames` is asked for the frames before each batch; what is held out is taken from its first answer."""
        self.options, self.looks = options, looks
        self._frames = frames
        first = frames()
        chosen = np.linspace(0, len(first.held_out) - 1, min(held_out, len(first.held_out))).astype(int)
        self._held_out = [(first.clips[c], int(f)) for c, f in first.held_out[chosen]]

    def describe(self) -> dict[str, object]:
        """Options and data."""
        frames = self._frames()
        held = sorted({frames.clips[c].clip_id for c in np.unique(frames.held_out[:, 0])})
        return {
            "options": asdict(self.options),
            "looks": asdict(self.looks),
            "clips": {clip.clip_id: len(clip) for clip in frames.clips},
            "held_out": held,
            "training_frames": len(frames.training),
        }

    def batch(self, index: int) -> Batch:
        """Random crops of random frames, changed at random; all from the seed and the batch's number."""
        frames = self._frames()
        crops: list[tuple[np.ndarray, np.ndarray, Truth]] = []
        names: list[str] = []
        while len(crops) < self.options.batch:
            rng = np.random.default_rng([self.options.seed, index, len(crops)])
            c, f = frames.training[rng.integers(len(frames.training))]
            if frames.clips[c].state[f] != SEEN:  # frames with a ball come more often
                c, f = frames.training[rng.integers(len(frames.training))]
            triple = read_triple(frames.clips[c], int(f), rng)
            for _ in range(min(self.options.per_frame, self.options.batch - len(crops))):
                crops.append(self._crop(triple, rng))
                names.append(f"{frames.clips[c].clip_id}/{f}")
        grey, colour, truths = zip(*crops, strict=True)

        def stacked(name: str) -> Tensor:
            return torch.from_numpy(np.stack([getattr(t, name) for t in truths]).astype(np.float32))

        return Batch(
            tensors={
                "grey": torch.from_numpy(np.stack(grey)),
                "colour": torch.from_numpy(np.stack(colour)),
                **{name: stacked(name) for name in ("heat", "counted", "place")},
            },
            names=tuple(names),
        )

    def _crop(self, triple: "Triple", rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, Truth]:
        options = self.options
        size = options.crop
        affine = random_place(triple, rng, options)
        shifts = np.zeros((3, 2))
        if rng.random() < 0.5:
            shifts[[0, 2]] = rng.normal(0, options.shake_px * np.exp(rng.normal(0, 0.7)), (2, 2))
        frames = [seen_through(triple, k, affine, shifts[k], size) for k in range(3)]
        balls, unknown = [], []
        zoom = float(np.sqrt(abs(np.linalg.det(affine[:, :2]))))
        pixel = affine[:, :2] @ triple.pixel + affine[:, 2]
        way = affine[:, :2] @ triple.streak
        if triple.state == SEEN:
            balls.append((pixel, way))
        elif triple.state == UNKNOWN and np.isfinite(pixel).all():
            unknown.append((pixel, way, zoom * triple.radius))
        if rng.random() < options.distractors:
            for _ in range(int(rng.integers(1, 5))):
                draw_distractor(frames, shifts, rng)
        if rng.random() < options.drawn:
            for _ in range(int(rng.integers(1, 4))):
                ball = draw_ball(frames, rng, least_trace=LEAST_TRACE)
                if ball.seen:
                    balls.append((ball.pixel, ball.streak))
                else:
                    unknown.append((ball.pixel, ball.streak, 4.0))
        if rng.random() < 0.5:
            frames = frames[::-1]
        if rng.random() < 0.03:  # as in the first and the last frame of a clip
            frames[0] = frames[2]
        looked = random_look(np.ascontiguousarray(np.concatenate(frames, axis=1)), rng, self.looks)
        planes = [picture_planes(np.ascontiguousarray(looked[:, k * size : (k + 1) * size])) for k in range(3)]
        grey = np.stack([p.grey for p in planes])
        return grey, planes[1].colour, truth_of(balls, unknown, size // STRIDE)

    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Whether there is a ball in each cell, and where it is."""
        given = batch.tensors
        net = cast(BallNet, network)
        features = net.features(given["grey"], given["colour"])
        with torch.autocast("cpu", enabled=False):
            answers = net.head(features.float())
            balls = (given["heat"] == 1.0).float()
            count = balls.sum().clamp(min=1.0)
            ball = focal_loss(answers[:, 0], given["heat"], given["counted"]) / count
            weight = (given["place"].square().sum(dim=1) < OFFSET_CELLS**2).float() * given["heat"]
            total = weight.sum().clamp(min=1.0)
            place = (weight * place_loss(answers[:, 1:3], answers[:, 3], given["place"])).sum() / total
            loss = ball + self.options.place_weight * place
        return loss, {"ball": ball.detach(), "place": place.detach()}

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Recall, precision and error on whole held-out frames; nothing where no frame is held out."""
        if not self._held_out:
            return {}
        return score_frames(predict_frames(cast(BallNet, network), self._held_out))


def focal_loss(
    logits: Float[Tensor, "batch rows columns"],
    heat: Float[Tensor, "batch rows columns"],
    counted: Float[Tensor, "batch rows columns"],
) -> Tensor:
    """Sum of the cells' penalty-reduced focal losses. Source: Law and Deng, CornerNet (arXiv 1808.01244), eq. 1."""
    p = torch.sigmoid(logits)
    there = (heat == 1.0).float()
    found = there * (1 - p).square() * F.softplus(-logits)
    wrong = (1 - there) * (1 - heat).pow(4) * p.square() * F.softplus(logits)
    return (counted * (found + wrong)).sum()


def place_loss(
    place: Float[Tensor, "batch 2 rows columns"],
    log_sigma: Float[Tensor, "batch rows columns"],
    truth: Float[Tensor, "batch 2 rows columns"],
) -> Float[Tensor, "batch rows columns"]:
    """Laplace's negative log likelihood of each cell's place, both coordinates, up to a constant."""
    log_sigma = log_sigma.clamp(-4.0, 3.0)
    away = (place - truth).abs().sum(dim=1)
    return 2.0**0.5 * away * torch.exp(-log_sigma) + 2 * log_sigma


@dataclass(frozen=True, eq=False, kw_only=True)
class Triple:
    """A frame with two neighbours, and its ball."""

    frames: tuple[np.ndarray, np.ndarray, np.ndarray]
    """Before, now and after."""
    now_from: tuple[np.ndarray | None, None, np.ndarray | None]
    """Pixels of the neighbours to pixels of the frame; None where they are taken as they are."""
    pixel: Float[np.ndarray, " 2"]
    """NaN where there is no ball."""
    streak: Float[np.ndarray, " 2"]
    radius: float
    state: int
    boxes_px: Float[np.ndarray, "players 4"]


def read_triple(clip: BallClip, index: int, rng: np.random.Generator) -> Triple:
    """Frame `index` with neighbours one or, at times, two frames away."""
    far = 2 if rng.random() < 0.25 and 2 <= index < len(clip) - 2 else 1
    before, after = index - far, index + far
    maps = clip.here_from_previous
    forth, back = np.eye(3), np.eye(3)
    for k in range(before + 1, index + 1):
        forth = maps[k] @ forth
    for k in range(index + 1, after + 1):
        back = maps[k] @ back
    now_from: list[np.ndarray | None] = [forth, None, np.linalg.inv(back)]
    if rng.random() < 0.1:  # a turn that nobody noticed, where it is small
        high, wide = clip.pictures.read(index).shape[:2]
        middle = np.array([0.5 * wide, 0.5 * high, 1.0])
        moved = [np.hypot(*((m @ middle)[:2] / (m @ middle)[2] - middle[:2])) for m in (forth, back)]
        if max(moved) < 2.5:
            now_from = [None, None, None]
    return Triple(
        frames=(clip.pictures.read(before), clip.pictures.read(index), clip.pictures.read(after)),
        now_from=(now_from[0], None, now_from[2]),
        pixel=clip.ball_px[index],
        streak=clip.streak_px[index],
        radius=float(clip.radius_px[index]),
        state=int(clip.state[index]),
        boxes_px=clip.boxes_px[index],
    )


def random_place(triple: Triple, rng: np.random.Generator, options: BallTaskOptions) -> Float[np.ndarray, "2 3"]:
    """A map of picture pixels to crop pixels: near the ball, near a player, or anywhere."""
    high, wide = triple.frames[1].shape[:2]
    size = options.crop
    zoom = float(np.exp(rng.uniform(*np.log(options.zoom)))) * 1280 / wide
    angle = np.radians(rng.normal(0, 3))
    mirrored = -1.0 if rng.random() < 0.5 else 1.0
    stretch = np.exp(rng.normal(0, 0.05))
    linear = (
        zoom
        * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        @ np.diag([mirrored * stretch, 1 / stretch])
    )
    kind = rng.random()
    known = np.flatnonzero(np.isfinite(triple.boxes_px).all(axis=1))
    if kind < 0.45 and triple.state == SEEN:
        aim = triple.pixel
        to = rng.uniform(12, size - 12, 2)
    elif kind < 0.7 and len(known):
        box = triple.boxes_px[known[rng.integers(len(known))]]
        aim = rng.uniform(box[:2], np.maximum(box[2:], box[:2] + 1e-3))
        to = rng.uniform(20, size - 20, 2)
    else:
        aim = rng.uniform([0, 0], [wide, high])
        to = np.array([size / 2, size / 2])
    return np.concatenate([linear, (to - linear @ aim)[:, None]], axis=1)


def seen_through(
    triple: Triple, which: int, affine: Float[np.ndarray, "2 3"], shift: Float[np.ndarray, " 2"], size: int
) -> UInt8[np.ndarray, "size size 3"]:
    """One of the three frames as the crop shows it, moved by `shift` crop pixels."""
    bgr = triple.frames[which]
    linear, offset = affine[:, :2], affine[:, 2]
    turn = triple.now_from[which]
    if turn is not None:
        # In so small a piece the turn is affine: its value and slope at the piece's middle.
        middle = np.linalg.inv(turn) @ np.array([*np.linalg.solve(linear, np.full(2, 0.5 * size) - offset), 1.0])
        middle = middle / middle[2]
        x, y, w = turn @ middle
        slope = (turn[:2, :2] - np.outer([x / w, y / w], turn[2, :2])) / w
        offset = linear @ (np.array([x / w, y / w]) - slope @ middle[:2]) + offset
        linear = linear @ slope
    move = np.concatenate([linear, (offset + shift)[:, None]], axis=1)
    border = cv2.BORDER_REPLICATE
    if float(np.sqrt(abs(np.linalg.det(linear)))) >= 0.8:
        seen = cv2.warpAffine(bgr, move, (size, size), flags=cv2.INTER_LINEAR, borderMode=border)
        return np.asarray(seen, dtype=np.uint8)
    # Shrinking takes every pixel in, as the reader's does: twice as large first, then halved by area.
    twice = 2 * move + np.array([[0, 0, 0.5], [0, 0, 0.5]])
    large = cv2.warpAffine(bgr, twice, (2 * size, 2 * size), flags=cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(cv2.resize(large, (size, size), interpolation=cv2.INTER_AREA), dtype=np.uint8)
