"""Windows are pure functions of seed and index, say what the store says, and are drawn as evenly as promised."""

import pickle
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pgm_models.animation.encode import decode, encode
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.store import StateStore, open_store
from pgm_models.animation.window_source import (
    WindowOptions,
    WindowPlaces,
    WindowSource,
    all_windows,
    window_places,
    windows_at,
)
from pgm_models.animation.windows import Windows


@dataclass
class NumberedFeatures:
    """Features that tell which text they are of."""

    count: int

    def rows(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert ids.size == 0 or 0 <= ids.min() <= ids.max() < self.count
        tokens = np.zeros((len(ids), 3, 2), dtype=np.float32)
        tokens[:, 0, 0] = ids
        return tokens, np.tile([True, False, False], (len(ids), 1))


@pytest.fixture(scope="module")
def store(tennis_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> StateStore:
    return open_store(tennis_dataset, fit_layout(tennis_dataset), tmp_path_factory.mktemp("store"))


@pytest.fixture(scope="module")
def features(store: StateStore) -> NumberedFeatures:
    return NumberedFeatures(count=len(store.texts))


def same(one: Windows, other: Windows) -> bool:
    names = ("state", "valid", "rate", "constants", "text", "tokens", "token_mask")
    return one.names == other.names and all(torch.equal(getattr(one, n), getattr(other, n)) for n in names)


def cut(store: StateStore, lengths: list[int], rates: list[float]) -> StateStore:
    """The store's first frames as segments of those lengths and rates."""
    lengths_, count = np.array(lengths), len(lengths)
    return replace(
        store,
        segment_start=np.cumsum(lengths_) - lengths_,
        segment_length=lengths_,
        segment_clip=np.arange(count),
        segment_rate=np.array(rates),
        constants=store.constants[:1].repeat(count, axis=0),
    )


def test_a_batch_depends_on_seed_and_index_alone(store: StateStore, features: NumberedFeatures) -> None:
    options = WindowOptions(frames=8, batch=5, seed=3)
    source = WindowSource(store, options, features)
    later = source.batch(41)
    assert same(source.batch(41), later)
    assert same(pickle.loads(pickle.dumps(source)).batch(41), later)
    assert same(WindowSource(store, options, features).batch(41), later)
    assert not same(source.batch(42), later)
    assert not same(WindowSource(store, replace(options, seed=4), features).batch(41), later)


def test_windows_hold_the_frames_that_their_places_name(store: StateStore, features: NumberedFeatures) -> None:
    source = WindowSource(store, WindowOptions(frames=12, batch=20, seed=1), features)
    windows, places = source.batch(7), source.places(7)
    columns = decode(store.layout, windows.state.numpy(), windows.constants.numpy())
    for row in range(len(places)):
        segment, stride = int(places.segment[row]), int(places.stride[row])
        start = int(places.start[row])
        tangent, valid = store.states(segment, start, start + 11 * stride + 1, stride)
        assert len(tangent) == 12
        np.testing.assert_array_equal(windows.valid[row], valid)
        assert float(windows.rate[row]) == pytest.approx(25 / stride)
        frame = store.frame[store.segment_start[segment] + start]
        assert windows.names[row] == f"clip {store.clip_of(segment)}, frame {frame}, every {stride}"
        again, _ = encode(store.layout, {name: values[row] for name, values in columns.items()})
        told = valid[:, store.layout.property_of_channel]
        close = np.abs(again - tangent) < 1e-3
        # At pi both ends of an axis are the same rotation.
        assert (close | ~told).mean() > 0.99
        assert not windows.state[row][~torch.from_numpy(told)].any()
    assert not windows.valid.all() and windows.valid[..., :6].all()


def test_rotations_take_no_step_beyond_pi(store: StateStore) -> None:
    windows = WindowSource(store, WindowOptions(batch=200, rates=(12, 30)), None).batch(0)
    for row, entry in enumerate(store.layout.properties):
        if entry.kind == "rotations":
            numbers = windows.state[..., store.layout.slice_of(row)].numpy() * entry.std + entry.mean
            vectors = numbers.reshape(*numbers.shape[:2], -1, 3)
            assert np.linalg.norm(vectors[:, 0], axis=-1).max() <= np.pi + 1e-4
            # A nearer equal would be a whole turn away.
            axis = vectors[:, 1:] / np.linalg.norm(vectors[:, 1:], axis=-1, keepdims=True)
            steps = np.linalg.norm(np.diff(vectors, axis=1), axis=-1)
            for turns in (-1, 1):
                other = np.linalg.norm(vectors[:, 1:] + 2 * np.pi * turns * axis - vectors[:, :-1], axis=-1)
                assert (steps <= other + 1e-3).all()


def test_strides_are_drawn_evenly_among_those_that_fit(store: StateStore) -> None:
    segments = cut(store, [400, 46, 400], [25.0, 25.0, 50.0])
    source = WindowSource(segments, WindowOptions(frames=16, batch=4000, rates=(5.0, 30.0)), None)
    places = source.places(0)
    strides = {0: [1, 2, 3, 4, 5], 1: [1, 2, 3], 2: [2, 3, 4, 5, 6, 7, 8, 9, 10]}
    held = np.array([400 - 15, 46 - 15, 400 - 30])
    for segment, expected in strides.items():
        own = places.stride[places.segment == segment]
        assert sorted(set(own.tolist())) == expected
        counts = np.array([(own == stride).sum() for stride in expected])
        assert np.abs(counts / len(own) - 1 / len(expected)).max() < 5 * np.sqrt(0.25 / len(own))
        assert len(own) / 4000 == pytest.approx(held[segment] / held.sum(), abs=0.04)
    assert (places.start + 15 * places.stride < segments.segment_length[places.segment]).all()
    last = places.start + 15 * places.stride == segments.segment_length[places.segment] - 1
    assert last.any() and (places.start == 0).any()


def test_segments_that_no_rate_fits_are_taken_at_the_nearest(store: StateStore) -> None:
    source = WindowSource(cut(store, [100, 100], [2.0, 240.0]), WindowOptions(frames=4, rates=(100.0, 110.0)), None)
    places = source.places(0)
    assert set(places.stride[places.segment == 0].tolist()) == {1}
    assert set(places.stride[places.segment == 1].tolist()) == {2}


def test_short_segments_are_padded_where_nothing_else_exists(store: StateStore, features: NumberedFeatures) -> None:
    mixed = cut(store, [5, 40], [25.0, 25.0])
    assert set(WindowSource(mixed, WindowOptions(batch=64), features).places(0).segment.tolist()) == {1}
    windows = WindowSource(cut(store, [5, 3], [25.0, 25.0]), WindowOptions(batch=64), features).batch(0)
    lengths = windows.valid.any(dim=2).sum(dim=1)
    assert set(lengths.tolist()) == {5, 3}
    assert not windows.valid[:, 5:].any() and not windows.state[:, 5:].any() and (windows.text[:, 5:] == -1).all()
    assert (windows.rate == 25).all()


def test_a_text_of_its_span_is_drawn_once_a_window(store: StateStore, features: NumberedFeatures) -> None:
    source = WindowSource(store, WindowOptions(batch=200), features)
    windows, places = source.batch(0), source.places(0)
    offset = places.start[:, None] + places.stride[:, None] * np.arange(16)
    span = np.asarray(store.span)[store.segment_start[places.segment][:, None] + offset]
    text = windows.text.numpy()
    np.testing.assert_array_equal(text < 0, span < 0)
    ids = windows.tokens[:, 0, 0].numpy().astype(int)
    assert len(set(ids.tolist())) == len(ids) == text.max() + 1
    alternatives = 0
    for window in range(len(places)):
        for player in range(2):
            for one in set(span[window, :, player].tolist()) - {-1}:
                (row,) = set(text[window, span[window, :, player] == one, player].tolist())
                spoken = store.spans.texts_of(one)
                assert store.texts[ids[row]] in spoken
                alternatives += store.texts[ids[row]] != spoken[0]
    assert alternatives > 100


def test_main_texts_alone_are_drawn_where_asked_for(store: StateStore, features: NumberedFeatures) -> None:
    windows = WindowSource(store, WindowOptions(batch=50, alternatives=False), features).batch(0)
    main = set(store.spans.rows[store.spans.first[:-1]].tolist())
    assert set(windows.tokens[:, 0, 0].numpy().astype(int).tolist()) <= main


def test_without_features_there_is_no_text(store: StateStore) -> None:
    windows = WindowSource(store, WindowOptions(batch=3), None).batch(0)
    assert windows.tokens.shape == (0, 0, 0) and windows.token_mask.shape == (0, 0)
    assert (windows.text == -1).all() and windows.text.shape == (3, 16, 2)


@pytest.mark.parametrize("frames", [1, 2, 64])
def test_windows_of_any_length(store: StateStore, features: NumberedFeatures, frames: int) -> None:
    windows = WindowSource(store, WindowOptions(frames=frames, batch=4), features).batch(0)
    assert windows.state.shape == (4, frames, store.layout.channels)


def test_a_share_is_of_whole_matches_and_within_larger_ones(store: StateStore) -> None:
    def seen(share: float) -> set[int]:
        places = WindowSource(store, WindowOptions(frames=1, batch=9000, share=share), None).places(0)
        return set(places.segment.tolist())

    shares = [seen(share) for share in (0.001, 0.3, 0.7, 1.0)]
    assert shares[0] <= shares[1] < shares[2] < shares[3] and len(shares[0]) == 1
    assert len({store.matches[segment] for segment in shares[1]}) == 1
    assert len(shares[3]) == len(store.clips)
    for share, segments in zip((0.3, 0.7), shares[1:3], strict=True):
        lengths = store.segment_length[sorted(segments)]
        assert share <= lengths.sum() / store.frames < share + lengths.max() / store.frames


def test_windows_of_chosen_matches(store: StateStore) -> None:
    match = store.matches[-1]
    places = WindowSource(store, WindowOptions(batch=500, matches=(match,)), None).places(0)
    assert {store.matches[segment] for segment in places.segment} == {match}
    assert {store.matches[segment] for segment in window_places(store, 16, 5.0, matches=(match,)).segment} == {match}
    with pytest.raises(ValueError, match="matches: expected some of"):
        WindowSource(store, WindowOptions(matches=("nobody",)), None)


@pytest.mark.parametrize("whole", [True, False])
def test_evaluation_windows_do_not_overlap(store: StateStore, whole: bool) -> None:
    places = window_places(store, 10, 6.0, whole=whole)
    assert (places.stride == 4).all()
    taken = np.zeros(store.frames, dtype=int)
    for segment, start in zip(places.segment, places.start, strict=True):
        first = store.segment_start[segment] + start
        assert start + 37 <= store.segment_length[segment]
        taken[first : first + 37] += 1
        assert not whole or np.asarray(store.valid)[first : first + 37].all()
    assert taken.max() == 1
    if not whole:
        assert len(places) == sum(int(length) // 37 for length in store.segment_length)
    else:
        free = np.asarray(store.valid).all(axis=1) & (taken == 0)
        for start, length in zip(store.segment_start, store.segment_length, strict=True):
            # Nowhere is room for another one.
            runs = "".join("1" if good else "0" for good in free[start : start + length]).split("0")
            assert max(len(run) for run in runs) < 37


@pytest.mark.parametrize(("rate", "stride"), [(1.0, 25), (50.0, 1), (20.0, 1), (10.0, 3), (12.0, 2)])
def test_evaluation_strides_come_nearest_to_the_rate(store: StateStore, rate: float, stride: int) -> None:
    assert set(window_places(store, 4, rate).stride.tolist()) == {stride}


def test_fewer_evaluation_windows_are_spread_evenly(store: StateStore) -> None:
    everything, some = window_places(store, 8, 12.0), window_places(store, 8, 12.0, 10)
    assert len(some) == 10 < len(everything)
    keys = list(zip(everything.segment.tolist(), everything.start.tolist(), strict=True))
    chosen = [keys.index(key) for key in zip(some.segment.tolist(), some.start.tolist(), strict=True)]
    gaps = np.diff(chosen)
    assert gaps.max() - gaps.min() <= 1 and chosen[0] < gaps.max() and len(keys) - chosen[-1] <= gaps.max()


def test_evaluation_batches_hold_all_windows_in_order(store: StateStore, features: NumberedFeatures) -> None:
    places = window_places(store, 16, 5.0)
    batches = list(all_windows(store, 16, 5.0, features=features, batch=6))
    assert [len(batch.names) for batch in batches[:-1]] == [6] * (len(batches) - 1)
    whole = windows_at(store, places, 16, features)
    assert sum((batch.names for batch in batches), ()) == whole.names
    assert torch.equal(torch.cat([batch.state for batch in batches]), whole.state) and whole.valid.all()
    main = set(store.spans.rows[store.spans.first[:-1]].tolist())
    assert set(whole.tokens[:, 0, 0].numpy().astype(int).tolist()) <= main


def test_no_window_at_all_is_an_empty_batch(store: StateStore) -> None:
    assert list(all_windows(store, 5000, 25.0)) == []
    none = WindowPlaces(segment=np.zeros(0, np.int64), start=np.zeros(0, np.int64), stride=np.zeros(0, np.int64))
    assert windows_at(store, none, 16, None).state.shape == (0, 16, store.layout.channels)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"frames": 0}, "WindowOptions.frames: expected at least 1, got 0"),
        ({"rates": (5.0, 3.0)}, "WindowOptions.rates: expected 0 < lowest <= highest"),
        ({"share": 0.0}, "WindowOptions.share: expected above 0 to 1, got 0.0"),
    ],
)
def test_options_out_of_range_are_refused(options: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        WindowOptions(**options)
