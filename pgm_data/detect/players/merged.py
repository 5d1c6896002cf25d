"""The people that two detectors found, put together."""

import numpy as np
from jaxtyping import Float

from pgm_data.detect.players.candidates import PersonCandidates
from pgm_data.detect.players.tracks import overlap_of

SAME_OVERLAP = 0.3
"""Least share of two boxes in common for them to be of one person."""


def no_people() -> PersonCandidates:
    """Nobody."""
    return PersonCandidates(
        frame=np.zeros(0, np.int64),
        boxes_px=np.zeros((0, 4)),
        ground_world=np.zeros((0, 2)),
        person=np.zeros(0),
        player=np.zeros(0),
    )


def merge_people(a: PersonCandidates, b: PersonCandidates) -> PersonCandidates:
    """Everybody whom either detector found, each once, in order of their frames.

    Two boxes of one frame that overlap are one person if each is the other's best match: his box and place are those
    of the detector that is surer of him, a person is there unless both are wrong, and he plays as the one says that can
    tell, or as the mean of their log odds.
    """
    pair_a, pair_b = _pairs(a, b)
    surer = a.person[pair_a] >= b.person[pair_b]
    with np.errstate(divide="ignore"):
        doubt = np.exp(np.log1p(-a.person[pair_a]) + np.log1p(-b.person[pair_b]))
    alone_a = np.setdiff1d(np.arange(len(a.frame)), pair_a)
    alone_b = np.setdiff1d(np.arange(len(b.frame)), pair_b)

    def joined(name: str) -> np.ndarray:
        x, y = getattr(a, name), getattr(b, name)
        both = np.where(surer.reshape(-1, *[1] * (x.ndim - 1)), x[pair_a], y[pair_b])
        return np.concatenate([both, x[alone_a], y[alone_b]])

    frame = joined("frame")
    order = np.argsort(frame, kind="stable")
    person = np.concatenate([1 - doubt, a.person[alone_a], b.person[alone_b]])
    player = np.concatenate([_mean_odds(a.player[pair_a], b.player[pair_b]), a.player[alone_a], b.player[alone_b]])
    return PersonCandidates(
        frame=frame[order].astype(np.int64),
        boxes_px=joined("boxes_px")[order],
        ground_world=joined("ground_world")[order],
        person=person[order],
        player=player[order],
    )


def _mean_odds(a: Float[np.ndarray, " pairs"], b: Float[np.ndarray, " pairs"]) -> Float[np.ndarray, " pairs"]:
    """Probability of the mean log odds; that of the other one where one is NaN."""
    with np.errstate(divide="ignore", invalid="ignore"):
        odds = np.log(np.stack([a, b])) - np.log1p(-np.stack([a, b]))
        middle = 1 / (1 + np.exp(-odds.mean(axis=0)))
    return np.where(np.isnan(a), b, np.where(np.isnan(b), a, np.where(np.isnan(middle), 0.5, middle)))


def _pairs(a: PersonCandidates, b: PersonCandidates) -> tuple[np.ndarray, np.ndarray]:
    """Rows of a and b that are one person: in one frame, and each the other's best overlap."""
    order_b = np.argsort(b.frame, kind="stable")
    first = np.searchsorted(b.frame[order_b], a.frame, side="left")
    last = np.searchsorted(b.frame[order_b], a.frame, side="right")
    counts = last - first
    rows_a = np.repeat(np.arange(len(a.frame)), counts)
    within = np.arange(len(rows_a)) - np.repeat(np.cumsum(counts) - counts, counts)
    rows_b = order_b[np.repeat(first, counts) + within]
    overlap = overlap_of(a.boxes_px[rows_a], b.boxes_px[rows_b])
    best_a, best_b = np.zeros(len(a.frame)), np.zeros(len(b.frame))
    np.maximum.at(best_a, rows_a, overlap)
    np.maximum.at(best_b, rows_b, overlap)
    same = (overlap >= SAME_OVERLAP) & (overlap == best_a[rows_a]) & (overlap == best_b[rows_b])
    rows_a, rows_b = rows_a[same], rows_b[same]
    # Of equal overlaps the first one counts.
    _, keep = np.unique(rows_a, return_index=True)
    rows_a, rows_b = rows_a[keep], rows_b[keep]
    _, keep = np.unique(rows_b, return_index=True)
    return rows_a[keep], rows_b[keep]
