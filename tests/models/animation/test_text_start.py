import numpy as np
import pytest
import torch

from pgm_models.animation.aggregator import Aggregator
from pgm_models.animation.encode import standardise
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.presets import TextOptions
from pgm_models.animation.store import open_store
from pgm_models.animation.text_encoders import HashEncoder
from pgm_models.animation.text_features import TextFeatures, text_features
from pgm_models.animation.text_start import TextStartOptions, span_rows, teach_texts, whitening


@pytest.fixture(scope="module")
def told(tennis_dataset, tmp_path_factory):
    """A store of real play and the features of its texts."""
    folder = tmp_path_factory.mktemp("texts")
    store = open_store(tennis_dataset, fit_layout(tennis_dataset), folder)
    return store, text_features(store.texts, HashEncoder(), folder)


def fresh(width: int) -> Aggregator:
    torch.manual_seed(0)
    return Aggregator(width, TextOptions(width=32, layers=1, heads=2))


def test_whitened_tokens_are_uncorrelated_and_those_that_differ_have_unit_variance(told) -> None:
    _, features = told
    white = whitening(features)
    tokens, mask = features.rows(np.arange(len(features.starts)))
    found = (torch.as_tensor(tokens[mask]) - white.mean) @ white.map
    covariance = np.cov(found.double().numpy().T)
    off = covariance - np.diag(np.diag(covariance))
    assert np.abs(off).max() < 0.05
    assert 0.7 < np.diag(covariance).max() <= 1.0 + 1e-3


def test_features_of_another_scale_and_offset_are_whitened_to_the_same(told) -> None:
    _, features = told

    class Scaled(TextFeatures):
        def rows(self, ids):
            tokens, mask = super().rows(ids)
            return (100 * tokens + 7) * mask[..., None], mask

    fields = {name: getattr(features, name) for name in features.__dataclass_fields__}
    tokens, mask = features.rows(np.arange(20))
    one, other = whitening(features), whitening(Scaled(**fields))
    mapped = (torch.as_tensor(tokens[mask]) - one.mean) @ one.map
    again = (torch.as_tensor(100 * tokens[mask] + 7) - other.mean) @ other.map
    torch.testing.assert_close(again.abs(), mapped.abs(), atol=2e-2, rtol=2e-2)  # axes may point the other way


def test_spans_are_found_with_their_frames_as_a_loop_finds_them(told) -> None:
    store, _ = told
    options = TextStartOptions(steps=1, moments=3, shortest=5)
    found = span_rows(store, np.arange(len(store.segment_start)), options)
    expected = []
    for first, length in zip(store.segment_start, store.segment_length, strict=True):
        for player in range(2):
            run: list[int] = []
            for row in [*range(first, first + length), None]:
                if row is not None and run and store.span[row, player] == store.span[run[-1], player]:
                    run.append(row)
                    continue
                if len(run) >= 5 and store.span[run[0], player] >= 0:
                    middle = first + int(np.rint((run[0] + run[-1]) / 2 - first))
                    expected.append((int(store.span[run[0], player]), player, run[0], middle, run[-1]))
                run = [] if row is None else [row]
    given = zip(found.span, found.player, found.rows, strict=True)
    assert sorted((int(s), int(p), *map(int, rows)) for s, p, rows in given) == sorted(expected)
    assert len(expected) > 20


def test_what_is_learned_of_texts_tells_states_better_than_their_mean_and_is_the_same_each_time(told) -> None:
    store, features = told
    options = TextStartOptions(steps=60, batch=64)
    spans = span_rows(store, np.arange(len(store.segment_start)), options)
    white = whitening(features)
    shares, weights = [], []
    for _ in range(2):
        aggregator = fresh(features.width)
        aggregator.whiten(white.mean, white.map)
        shares.append(teach_texts(aggregator, store, features, spans, options))
        weights.append(torch.cat([value.flatten() for value in aggregator.state_dict().values()]))
    assert shares[0] == shares[1] and torch.equal(weights[0], weights[1])
    assert shares[0] > 0.15
    few = TextStartOptions(steps=6, batch=64)
    assert teach_texts(fresh(features.width), store, features, spans, few) < shares[0]


def test_texts_that_go_with_nothing_teach_nothing(told) -> None:
    store, features = told
    spans = span_rows(store, np.zeros(0, dtype=np.int64), TextStartOptions(steps=5))
    aggregator = fresh(features.width)
    before = [value.clone() for value in aggregator.state_dict().values()]
    assert len(spans) == 0
    assert teach_texts(aggregator, store, features, spans, TextStartOptions(steps=5)) == 0.0
    assert all(torch.equal(a, b) for a, b in zip(before, aggregator.state_dict().values(), strict=True))


def test_states_that_the_data_do_not_know_count_nothing(told) -> None:
    store, features = told
    options = TextStartOptions(steps=3, batch=16)
    spans = span_rows(store, np.arange(len(store.segment_start)), options)
    unknown = ~np.asarray(store.valid)[spans.rows].all(axis=(1, 2))
    assert unknown.any()  # a ball that is not in play
    share = teach_texts(fresh(features.width), store, features, spans, options)
    assert np.isfinite(share)
    assert np.isfinite(standardise(store.layout, np.asarray(store.tangent)[spans.rows].astype(np.float64))).all()
