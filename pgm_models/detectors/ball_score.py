"""What a ball network is worth: recall, precision and error on whole frames, and what its own words are worth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from pgm_data.detect.ball.network import BallInput, Calibration, aligned, read_peaks
from pgm_data.detect.ball.streaks import streaks_at
from pgm_models.detectors.ball_frames import SEEN, UNKNOWN, BallClip
from pgm_models.detectors.ball_net import BallNet

RIGHT_PX = 5.0
"""A candidate counts as right within this of the ball's centre, or within a third of its streak, input pixels."""
UNKNOWN_PX = 30.0
"""A candidate within this of an unknown ball counts neither as right nor as wrong, input pixels."""
MOST = 4
"""Candidates read from each frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Predictions:
    """Candidates in frames with known balls; input pixels."""

    logits: Float[np.ndarray, "frames most"]
    """NaN where a frame has fewer candidates."""
    error_px: Float[np.ndarray, "frames most"]
    """From the ball's centre; infinite where there is no ball."""
    sigma_px: Float[np.ndarray, "frames most"]
    right: Bool[np.ndarray, "frames most"]
    unknown: Bool[np.ndarray, "frames most"]
    """Whether nobody can tell."""
    seen: Bool[np.ndarray, " frames"]
    """Whether the frame's ball is to be found."""
    diameter_px: Float[np.ndarray, " frames"]
    """The ball's width."""
    streak_px: Float[np.ndarray, " frames"]
    """The ball's streak."""
    streak_error_px: Float[np.ndarray, "frames most"]
    """Of the streak, the better of its two signs; NaN where it was not seen."""


@torch.no_grad()
def predict_frames(network: BallNet, frames: Sequence[tuple[BallClip, int]], widest: int = 1280) -> Predictions:
    """What the network finds in whole frames, each with the neighbours that it has."""
    rows = [_predict(network, clip, index, widest) for clip, index in frames]
    return Predictions(
        **{name: np.stack([row[name] for row in rows]) for name in rows[0]},
    )


def _predict(network: BallNet, clip: BallClip, index: int, widest: int) -> dict[str, np.ndarray]:
    bgr = clip.pictures.read(index)
    box = BallInput(picture_size=(bgr.shape[1], bgr.shape[0]), widest=widest)
    now = box.planes(bgr)
    neighbours = []
    for other in (index - 1, index + 1):
        if not 0 <= other < len(clip):
            continue
        turn = box.carried(clip.here_from_previous[max(index, other)])
        turn = turn if other < index else np.linalg.inv(turn)
        neighbours.append(aligned(box.planes(clip.pictures.read(other)).grey, turn, now.grey))
    grey = torch.from_numpy(np.stack([neighbours[0], now.grey, neighbours[-1]])[None])
    answers = network(grey, torch.from_numpy(np.ascontiguousarray(now.colour)[None]))
    peaks = read_peaks(answers[0].numpy(), MOST)
    ways = streaks_at(grey[0].numpy(), peaks.pixels)
    scale = float(box.scale.mean())
    ball = box.input_from_picture(clip.ball_px[index])
    streak = clip.streak_px[index] * scale
    length = float(np.hypot(*streak))
    away = np.hypot(*(peaks.pixels - ball).T)
    state = clip.state[index]
    known = np.isfinite(ball).all()
    sign = np.minimum(np.hypot(*(ways - streak).T), np.hypot(*(ways + streak).T))
    return {
        "logits": peaks.logits,
        "error_px": np.where(np.isfinite(away), away, np.inf),
        "sigma_px": peaks.sigma_px,
        "right": np.asarray((state == SEEN) & (away < max(RIGHT_PX, length / 3))),
        "unknown": np.asarray((state == UNKNOWN) & known & (away < UNKNOWN_PX)),
        "seen": np.asarray(state == SEEN),
        "diameter_px": np.asarray(2 * scale * clip.radius_px[index]),
        "streak_px": np.asarray(length),
        "streak_error_px": sign,
    }


def score_frames(said: Predictions) -> dict[str, float]:
    """Of the best candidate: recall at precision 0.9, average precision, recall, errors; and all candidates' recall."""
    best = np.nan_to_num(said.logits[:, 0], nan=-np.inf)
    right, unknown = said.right[:, 0], said.unknown[:, 0]
    balls = max(int(said.seen.sum()), 1)
    order = np.argsort(-best, kind="stable")
    hits = np.cumsum(right[order])
    claims = np.cumsum(~unknown[order])
    precision = hits / np.maximum(claims, 1)
    recall = hits / balls
    sure = precision >= 0.9
    found = said.right[:, 0] & said.seen
    return {
        "recall_at_90": float(recall[sure].max()) if sure.any() else 0.0,
        "average_precision": float(np.sum(np.diff(recall, prepend=0.0) * precision)),
        "recall_of_best": float(found.sum() / balls),
        "recall_of_all": float((said.right.any(axis=1) & said.seen).sum() / balls),
        "median_px": float(np.median(said.error_px[found, 0])) if found.any() else float("nan"),
        "p90_px": float(np.quantile(said.error_px[found, 0], 0.9)) if found.any() else float("nan"),
        "streak_px": _median(said.streak_error_px[found, 0]),
    }


def _median(values: Float[np.ndarray, " values"]) -> float:
    """Of those that are numbers; NaN where none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def calibrate(predictions: Sequence[Predictions]) -> Calibration:
    """What the network's logits and standard deviations are worth: a logistic fit, and the errors' spread.

    A slight pull towards the network's own words keeps few frames from claiming too much.
    """
    use = [np.isfinite(said.logits) & ~said.unknown for said in predictions]
    x = np.concatenate([said.logits[kept] for said, kept in zip(predictions, use, strict=True)])
    y = np.concatenate([said.right[kept].astype(float) for said, kept in zip(predictions, use, strict=True)])
    slope, shift = 1.0, 0.0
    for _ in range(50):
        p = 1 / (1 + np.exp(-np.clip(slope * x + shift, -60, 60)))
        w = np.maximum(p * (1 - p), 1e-9)
        gradient = np.array([((p - y) * x).sum() + (slope - 1.0), (p - y).sum() + 0.1 * shift])
        hessian = np.array([[(w * x * x).sum() + 1.0, (w * x).sum()], [(w * x).sum(), w.sum() + 0.1]])
        step = np.linalg.solve(hessian, gradient)
        slope, shift = slope - step[0], shift - step[1]
        if np.abs(step).max() < 1e-9:
            break
    ratio = np.concatenate([(said.error_px / said.sigma_px)[said.right] for said in predictions])
    # Of a two-dimensional Gaussian half of all distances lie within 1.177 standard deviations of a coordinate.
    sigma = float(np.median(ratio) / 1.17741) if len(ratio) >= 20 else 1.0
    return Calibration(slope=float(max(slope, 0.05)), shift=float(shift), sigma=sigma)
