"""Which frames a synthesis model is judged on, and which ones tell it what people and places look like."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Int

from pgm_models.synthesis.frames import FrameStore, held_out

Split = Literal["auto", "held-out", "all"]
LENT_SHARE = 0.1
"""Of an unseen match, its beginning: what its styles are read off."""
STRETCH = 25
"""Frames that follow each other, at most, where not all are judged: changes from one to the next are judged too."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """Rows of a store."""

    judged: Int[np.ndarray, " judged"]
    lent: Int[np.ndarray, " lent"]
    """That styles may be read off; none of them is judged."""
    learned: Int[np.ndarray, " learned"]
    """That the model has learned from; none where it knows nothing of the matches."""
    split: Literal["held-out", "all"]


def chosen_frames(store: FrameStore, about: Mapping[str, Any], dataset: str, split: Split, most: int) -> Choice:
    """Frames that are judged, in stretches where there are more than wanted.

    `held-out` takes the ends of matches that the run has not learned from, and styles off what it has; `all` all but
    the first tenth of every match, and styles off that. `auto` takes the first where the dataset is the run's own.

    Args:
        store: All frames.
        about: Of the run, as its model file has it.
        dataset: Name of the dataset.
        split: Which.
        most: Frames at most; 0 for all.

    Raises:
        ValueError: If there is nothing to judge.
    """
    data = about.get("data", {})
    share = float(data.get("held_out", LENT_SHARE))
    apart = held_out(store, share=share)
    if split == "auto":
        own = data.get("dataset") == dataset and data.get("frames") == int((~apart).sum())
        split = "held-out" if own else "all"
    rows = np.arange(len(store))
    if split == "held-out":
        judged, lent = rows[apart], rows[~apart]
        if not len(judged):
            raise ValueError(
                f"split: expected frames that the run has not learned from, got a held-out share of {share}"
            )
    else:
        begins = _beginnings(store)
        judged, lent = rows[~begins], rows[begins]
        if not len(judged):
            raise ValueError("split: expected matches of two frames or more, got none")
    learned = lent if split == "held-out" else rows[:0]
    return Choice(judged=stretches(judged, most), lent=lent, learned=learned, split=split)


def _beginnings(store: FrameStore) -> np.ndarray:
    """Which frames are in the first tenth of their match."""
    matches = np.unique(np.array(store.matches), return_inverse=True)[1][store.clip]
    begins = np.zeros(len(store), dtype=bool)
    for match in np.unique(matches):
        own = np.flatnonzero(matches == match)
        own = own[np.lexsort((store.video_frame[own], store.clip[own]))]
        begins[own[: max(int(np.ceil(LENT_SHARE * len(own))), 1)]] = True
    return begins


def stretches(rows: Int[np.ndarray, " rows"], most: int) -> Int[np.ndarray, " some"]:
    """So many of the rows at most, in stretches that follow each other, evenly spread; all for 0."""
    if not 0 < most < len(rows):
        return rows
    count = -(-most // STRETCH)
    length = most // count
    starts = np.linspace(0, len(rows) - length, count).round().astype(np.int64)
    return rows[np.unique(starts[:, None] + np.arange(length))]
