"""Windows of a store: drawn at random for training, or side by side for evaluation."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, Int

from pgm_models.animation.encode import continuous, standardise
from pgm_models.animation.store import StateStore
from pgm_models.animation.windows import Windows

if TYPE_CHECKING:
    from pgm_models.animation.text_features import TextFeatures


@dataclass(frozen=True, kw_only=True)
class WindowOptions:
    """How training windows are drawn.

    Raises:
        ValueError: If a number is out of range.
    """

    frames: int = 16
    """Length of a window, T."""
    batch: int = 32
    """Windows of a batch."""
    rates: tuple[float, float] = (3.0, 30.0)
    """Lowest and highest framerate of windows, frames a second."""
    seed: int = 0
    share: float = 1.0
    """Of the frames that are drawn from, above 0 to 1: match after match in an order that is always the same."""
    alternatives: bool = True
    """Whether any text of a span is drawn, once a window; else its main one."""
    matches: tuple[str, ...] | None = None
    """Matches that are drawn from; all where None."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low in (("frames", 1), ("batch", 1), ("seed", 0)):
            if getattr(self, name) < low:
                raise ValueError(f"WindowOptions.{name}: expected at least {low}, got {getattr(self, name)}")
        if not 0 < self.rates[0] <= self.rates[1]:
            raise ValueError(f"WindowOptions.rates: expected 0 < lowest <= highest, got {self.rates}")
        if not 0 < self.share <= 1:
            raise ValueError(f"WindowOptions.share: expected above 0 to 1, got {self.share}")


@dataclass(frozen=True, eq=False, kw_only=True)
class WindowPlaces:
    """Where windows lie in a store."""

    segment: Int[np.ndarray, " windows"]
    start: Int[np.ndarray, " windows"]
    """First frame, counted in the segment."""
    stride: Int[np.ndarray, " windows"]
    """Frames of the segment from one of the window to the next."""

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.segment)

    def some(self, which: slice | Int[np.ndarray, " some"]) -> "WindowPlaces":
        """The chosen ones."""
        return WindowPlaces(segment=self.segment[which], start=self.start[which], stride=self.stride[which])


class WindowSource:
    """Batches of random windows; each is a pure function of seed and index, so workers and resumed runs agree."""

    def __init__(self, store: StateStore, options: WindowOptions, features: "TextFeatures | None") -> None:
        self.store, self.options, self.features = store, options, features
        chosen = _share_of(store, store.segments_of(options.matches), options.share)
        if not len(chosen):
            raise ValueError(f"{store.folder}: expected frames to draw windows from, got none")
        lowest, highest = _strides(store.segment_rate[chosen], options.rates)
        reach = options.frames - 1
        held = store.segment_length[chosen] - reach * lowest
        if not (held > 0).any():
            # Nothing holds a whole window: all are padded.
            highest, held = lowest, np.ones_like(held)
        kept = held > 0
        self._segment, self._lowest, held = chosen[kept], lowest[kept], held[kept]
        fits = (store.segment_length[self._segment] - 1) // reach if reach else highest[kept]
        self._highest = np.maximum(np.minimum(highest[kept], fits), self._lowest)
        self._cumulative = np.cumsum(held)

    @property
    def segments(self) -> Int[np.ndarray, " some"]:
        """Segments that windows are drawn from."""
        return self._segment

    @property
    def count(self) -> int:
        """Different windows at the highest framerate."""
        return int(self._cumulative[-1])

    def places(self, index: int) -> WindowPlaces:
        """Where the windows of the batch of that index lie."""
        return self._places(self._random(index))

    def batch(self, index: int) -> Windows:
        """The batch of that index, on the CPU."""
        random = self._random(index)
        places = self._places(random)
        shape = (len(places), self.options.frames, len(self.store.layout.players))
        draw = random.random(shape) if self.options.alternatives else None
        return windows_at(self.store, places, self.options.frames, self.features, draw=draw)

    def _random(self, index: int) -> np.random.Generator:
        return np.random.Generator(np.random.Philox(np.random.SeedSequence((self.options.seed, index))))

    def _places(self, random: np.random.Generator) -> WindowPlaces:
        size = self.options.batch
        row = np.searchsorted(self._cumulative, random.integers(self.count, size=size), side="right")
        stride = random.integers(self._lowest[row], self._highest[row] + 1)
        room = self.store.segment_length[self._segment[row]] - (self.options.frames - 1) * stride
        start = random.integers(0, np.maximum(room, 1))
        return WindowPlaces(segment=self._segment[row], start=start, stride=stride)


def _share_of(store: StateStore, segments: Int[np.ndarray, " all"], share: float) -> Int[np.ndarray, " some"]:
    """Segments that hold the share of the frames, whole matches first; in the order of the store."""
    if share >= 1 or not len(segments):
        return segments
    names = [store.matches[clip] for clip in store.segment_clip[segments]]
    rank = np.array([hashlib.sha256(name.encode()).hexdigest() for name in names])
    ordered = segments[np.argsort(rank, kind="stable")]
    before = np.cumsum(store.segment_length[ordered]) - store.segment_length[ordered]
    return np.sort(ordered[before < share * store.segment_length[segments].sum()])


def _strides(
    rate: Float[np.ndarray, " segments"], rates: tuple[float, float]
) -> tuple[Int[np.ndarray, " segments"], Int[np.ndarray, " segments"]]:
    """Lowest and highest stride at which segments of those rates are within the wanted ones.

    Where none is, the one nearest to them.
    """
    lowest = np.maximum(np.ceil(rate / rates[1] - 1e-6), 1)
    highest = np.maximum(np.floor(rate / rates[0] + 1e-6), 1)
    return np.minimum(lowest, highest).astype(np.int64), highest.astype(np.int64)


def windows_at(
    store: StateStore,
    places: WindowPlaces,
    frames: int,
    features: "TextFeatures | None",
    *,
    draw: Float[np.ndarray, "windows frames actions"] | None = None,
) -> Windows:
    """The windows at those places, on the CPU; frames beyond the end of a segment are not valid and have no text.

    Args:
        store: Where they lie.
        places: Which.
        frames: Length of each.
        features: Of the store's texts; without, there is no text.
        draw: Numbers from 0 to below 1 that choose a text of each span, that of the span's first frame in the window;
            main texts where None.
    """
    offset = places.start[:, None] + places.stride[:, None] * np.arange(frames)
    length = store.segment_length[places.segment][:, None]
    inside = offset < length
    rows = store.segment_start[places.segment][:, None] + np.minimum(offset, length - 1)
    valid = store.valid[rows] & inside[..., None]
    state = standardise(store.layout, continuous(store.layout, store.tangent[rows], valid=valid))
    state[~valid[..., store.layout.property_of_channel]] = 0
    if features is None:
        text, tokens, mask = _no_text((*rows.shape, len(store.layout.players)))
    else:
        span = np.where(inside[..., None], store.span[rows], -1)
        texts = store.main_texts(span) if draw is None else store.spans.text_of(span, _drawn_once(span, draw))
        ids, inverse = np.unique(texts, return_inverse=True)
        missing = int(len(ids) > 0 and ids[0] < 0)
        text = inverse.reshape(texts.shape) - missing
        tokens, mask = features.rows(ids[missing:])
    rate = store.segment_rate[places.segment] / places.stride
    return Windows(
        state=torch.from_numpy(state),
        valid=torch.from_numpy(valid),
        rate=torch.from_numpy(rate.astype(np.float32)),
        constants=torch.from_numpy(store.constants[places.segment]),
        text=torch.from_numpy(text.astype(np.int64)),
        tokens=torch.from_numpy(tokens),
        token_mask=torch.from_numpy(mask),
        names=_names(store, places),
    )


def _no_text(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.full(shape, -1), np.zeros((0, 0, 0), dtype=np.float32), np.zeros((0, 0), dtype=bool)


def _drawn_once(
    span: Int[np.ndarray, "windows frames actions"], draw: Float[np.ndarray, "windows frames actions"]
) -> Float[np.ndarray, "windows frames actions"]:
    """The number drawn for the first frame of each run of one span, for all of the run."""
    fresh = np.ones(span.shape, dtype=bool)
    fresh[:, 1:] = span[:, 1:] != span[:, :-1]
    first = np.maximum.accumulate(np.where(fresh, np.arange(span.shape[1])[:, None], 0), axis=1)
    return np.take_along_axis(draw, first, axis=1)


def _names(store: StateStore, places: WindowPlaces) -> tuple[str, ...]:
    frame = store.frame[store.segment_start[places.segment] + places.start]
    return tuple(
        f"clip {store.clips[clip]}, frame {first}, every {stride}"
        for clip, first, stride in zip(store.segment_clip[places.segment], frame, places.stride, strict=True)
    )


def window_places(
    store: StateStore,
    frames: int,
    rate_hz: float,
    limit: int | None = None,
    *,
    whole: bool = True,
    matches: tuple[str, ...] | None = None,
) -> WindowPlaces:
    """Places of windows that do not overlap, each at the stride that comes nearest to a framerate.

    Args:
        store: Where they lie.
        frames: Length of each.
        rate_hz: Frames a second.
        limit: At most so many, evenly spread over all there are; all where None.
        whole: Whether all properties must be valid in all frames, those between the window's too.
        matches: Of which; all where None.
    """
    segments = store.segments_of(matches)
    # The ratio counts: 25 is as far from 20 as 16 is.
    exact = np.maximum(store.segment_rate[segments] / rate_hz, 1)
    low, high = np.floor(exact), np.ceil(exact)
    stride = np.where(exact / low <= high / exact, low, high).astype(np.int64)
    owner, first, length = _runs(store, segments) if whole else _whole_segments(store, segments)
    # A window of one frame takes no step; others reach to their last frame.
    reach = (frames - 1) * stride[owner] + 1
    count = length // reach
    run = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count)
    start = first[run] + number * reach[run]
    places = WindowPlaces(segment=segments[owner[run]], start=start, stride=stride[owner[run]])
    if limit is not None and len(places) > limit:
        places = places.some(np.floor((np.arange(limit) + 0.5) * len(places) / limit).astype(np.int64))
    return places


def _whole_segments(
    store: StateStore, segments: Int[np.ndarray, " segments"]
) -> tuple[Int[np.ndarray, " runs"], Int[np.ndarray, " runs"], Int[np.ndarray, " runs"]]:
    return np.arange(len(segments)), np.zeros(len(segments), dtype=np.int64), store.segment_length[segments]


def _runs(
    store: StateStore, segments: Int[np.ndarray, " segments"]
) -> tuple[Int[np.ndarray, " runs"], Int[np.ndarray, " runs"], Int[np.ndarray, " runs"]]:
    """Runs of frames in which all properties are valid: row of their segment, first frame in it, length."""
    owners, firsts, lengths = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for row, segment in enumerate(segments):
        begin = int(store.segment_start[segment])
        good = store.valid[begin : begin + int(store.segment_length[segment])].all(axis=1)
        edges = np.diff(np.concatenate([[False], good, [False]]).astype(np.int8))
        first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        owners.append(np.full(len(first), row))
        firsts.append(first)
        lengths.append(last - first)
    return np.concatenate(owners), np.concatenate(firsts), np.concatenate(lengths)


def all_windows(
    store: StateStore,
    frames: int,
    rate_hz: float,
    limit: int | None = None,
    *,
    whole: bool = True,
    matches: tuple[str, ...] | None = None,
    features: "TextFeatures | None" = None,
    batch: int = 64,
) -> Iterator[Windows]:
    """Batches of the windows of `window_places`, in that order, with main texts."""
    places = window_places(store, frames, rate_hz, limit, whole=whole, matches=matches)
    for start in range(0, len(places), batch):
        yield windows_at(store, places.some(slice(start, start + batch)), frames, features)
