"""Play that does what the words say agrees with them, play that does not agrees by chance alone."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.stats import binomtest

from pgm_data.caption.claims import Claims, claims_of_text
from pgm_data.dataset.clip_ball import EventRows
from pgm_data.scene import load_scene
from pgm_models.animation.agreement import AgreementOptions, agreement, other_rows, upsample
from pgm_models.animation.agreement_result import (
    PARTS,
    AgreementResult,
    AgreementRow,
    agreement_table,
    agreement_to_json,
    chance_rows,
    commonest_rows,
    tallied,
)
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.hit_windows import HitWindowOptions, HitWindows, clip_handedness, hit_windows
from pgm_models.animation.store import StateStore, open_store
from pgm_models.animation.text_encoders import HashEncoder
from pgm_models.animation.text_features import TextFeatures, text_features
from pgm_models.animation.window_source import WindowPlaces, windows_at
from pgm_models.animation.windows import Windows

TENNIS = load_scene("tennis")
PLACED = HitWindowOptions(windows=16, factor=1)
OPTIONS = AgreementOptions()


@pytest.fixture(scope="module")
def store(tennis_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> StateStore:
    return open_store(tennis_dataset, fit_layout(tennis_dataset), tmp_path_factory.mktemp("store"))


@pytest.fixture(scope="module")
def features(store: StateStore, tmp_path_factory: pytest.TempPathFactory) -> TextFeatures:
    return text_features(store.texts, HashEncoder(), tmp_path_factory.mktemp("features"))


@pytest.fixture(scope="module")
def hands(tennis_dataset: Path) -> dict[str, tuple[str, ...]]:
    return clip_handedness(tennis_dataset, TENNIS)


@pytest.fixture(scope="module")
def windows(store: StateStore, hands: dict[str, tuple[str, ...]]) -> HitWindows:
    return hit_windows(store, TENNIS, PLACED, handedness=hands)


def real(windows: Windows, known, text_known, generator) -> torch.Tensor:
    """Fills in what really was there."""
    return windows.state


def straight(windows: Windows, known, text_known, generator) -> torch.Tensor:
    """Fills in straight lines between what is known."""
    state = windows.state.clone()
    for row in range(len(state)):
        there = np.flatnonzero(known[row].all(dim=-1).numpy())
        for channel in range(state.shape[-1]):
            line = np.interp(np.arange(state.shape[1]), there, windows.state[row, there, channel].numpy())
            state[row, :, channel] = torch.from_numpy(line)
    return state


def test_hit_windows_begin_shortly_before_a_hit_that_a_caption_tells_of(windows, store, hands):
    assert len(windows) == 16
    assert set(hands) == set(store.clips) and all(set(pair) <= {"left", "right"} for pair in hands.values())
    for row in range(len(windows)):
        place = windows.coarse.some(np.array([row]))
        rows = store.rows(
            int(place.segment[0]), int(place.start[0]), int(place.start[0]) + 15 * int(place.stride[0]) + 1
        )
        assert store.valid[rows].all()
        rate = store.segment_rate[place.segment[0]]
        near = range(int(0.3 * rate), int(0.6 * rate) + 2)
        captions = store.span[rows][list(near), windows.player[row]]
        assert any(claims_of_text(store.spans.texts_of(int(span))[0]) == windows.claims[row] for span in captions)
        assert windows.claims[row].hits
        assert (windows.past[row].time < 0).all()
    assert (windows.fine.stride * PLACED.factor == windows.coarse.stride).all()


def test_the_rates_of_both_stages_are_those_of_the_data(store):
    for factor in (2, 3):
        found = hit_windows(store, TENNIS, HitWindowOptions(windows=4, factor=factor))
        assert (found.fine.stride * factor == found.coarse.stride).all()
        assert found.span.shape[1] == 15 * factor + 1


def test_real_play_agrees_with_its_captions_whatever_words_are_given(store, features, windows):
    options = replace(OPTIONS, words=("right", "shuffled"))
    result = agreement(real, store, features, windows, options)
    assert result.rate == pytest.approx(25 / 3)
    for part in PARTS:
        ceiling = result.row("ceiling", part)
        assert ceiling.share >= 0.85
        for words in options.words:
            row = result.row(words, part)
            assert (row.agreed, row.read, row.windows) == (ceiling.agreed, ceiling.read, ceiling.windows)
    assert result.row("shuffled, as told", "target").share < 0.75
    assert result.row("chance", "target").share < 0.75
    assert result.hit["ceiling"] == result.hit["right"] >= 0.95
    json.dumps(agreement_to_json(result), allow_nan=False)
    assert agreement_table(result).count("\n") == 7


def test_play_that_follows_the_words_given_follows_shuffled_ones_too(store, features, windows):
    states = windows_at(store, windows.coarse, PLACED.frames, None).state
    answers = [states, states[torch.from_numpy(other_rows(windows, OPTIONS.seed))]]
    calls = iter(answers)
    options = replace(OPTIONS, words=("right", "shuffled"))
    result = agreement(lambda *asked: next(calls), store, features, windows, options)
    assert result.row("right", "target").share >= 0.85
    assert result.row("shuffled, as told", "shot").share >= 0.8
    assert result.row("shuffled, as told", "target").share > result.row("shuffled", "target").share + 0.2


def test_a_model_is_shown_the_first_frame_and_the_texts_alone(store, features, windows):
    asked: list[tuple[Windows, torch.Tensor, torch.Tensor]] = []

    windows = windows.some(np.arange(4))

    def spy(given, known, text_known, generator):
        asked.append((given, known, text_known))
        return given.state

    options = replace(OPTIONS, given=2, words=("right", "reworded", "none"))
    agreement(spy, store, features, windows, options)
    (right, known, told), (reworded, _, _), (_, _, silent) = asked
    assert known[:, :2].all() and not known[:, 2:].any()
    assert not silent.any()
    main = store.main_texts(windows.span)
    assert (told.numpy() == (main >= 0)).all()
    for given, number in ((right, 0), (reworded, 1)):
        for row, frame, player in ((0, 0, 0), (1, 7, 1), (3, 15, 0)):
            texts = store.spans.texts_of(int(windows.span[row, frame, player]))
            wanted = store.texts.index(texts[min(number, len(texts) - 1)])
            tokens, mask = features.rows(np.array([wanted]))
            text = given.text[row, frame, player]
            shown = given.tokens[text][given.token_mask[text]]
            torch.testing.assert_close(shown, torch.from_numpy(tokens[0][mask[0]]))


def test_two_stages_keep_keyframes_and_read_at_the_raised_rate(store, features, hands):
    def first_real_then_straight(given, known, text_known, generator):
        return given.state if known.float().mean() < 0.1 else straight(given, known, text_known, generator)

    fine = hit_windows(store, TENNIS, replace(PLACED, windows=4, factor=3), handedness=hands)
    result = agreement(first_real_then_straight, store, features, fine, replace(OPTIONS, words=("right",)))
    assert result.rate == pytest.approx(25.0)
    assert result.row("right", "shot").share >= 0.7


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_upsampling_keeps_keyframes_to_the_bit_and_fills_between_them(store, windows, factor):
    given = windows_at(store, windows.coarse.some(np.arange(3)), 16, None)
    if factor == 1:
        assert torch.equal(upsample(straight, given, 1, store.layout, torch.Generator()).state, given.state)
        return
    fine = upsample(straight, given, factor, store.layout, torch.Generator())
    count = 15 * factor + 1
    assert fine.state.shape == (3, count, given.state.shape[-1])
    assert torch.equal(fine.state[:, ::factor], given.state)
    torch.testing.assert_close(fine.rate, given.rate * factor)
    assert torch.equal(fine.text[:, factor - 1], given.text[:, 0])
    wanted = np.array(
        [
            [np.interp(np.arange(count) / factor, np.arange(16), channel) for channel in window.T.numpy()]
            for window in given.state
        ]
    ).transpose(0, 2, 1)
    np.testing.assert_allclose(fine.state.numpy(), wanted, atol=1e-4)


def test_what_is_not_finite_is_refused_by_name(store, features, windows):
    def broken(given, known, text_known, generator):
        state = given.state.clone()
        state[1, 4] = torch.nan
        return state

    with pytest.raises(ValueError, match=r"clip .*frame .*right words: expected finite"):
        agreement(broken, store, features, windows.some(np.arange(3)), OPTIONS)


def test_a_store_without_captions_of_hits_is_refused(store):
    silent = replace(store, span=np.full(store.span.shape, -1, dtype=store.span.dtype))
    with pytest.raises(ValueError, match="captions of hits"):
        hit_windows(silent, TENNIS, PLACED)


@pytest.mark.parametrize(("agreed", "windows"), [(0, 5), (5, 5), (13, 40), (200, 256)])
def test_intervals_are_those_of_wilson(agreed, windows):
    row = AgreementRow(words="right", part="shot", kind="all", windows=windows, agreed=float(agreed), read=windows)
    known = binomtest(agreed, windows).proportion_ci(0.95, method="wilson")
    assert row.interval == pytest.approx((known.low, known.high))
    nothing = AgreementRow(words="right", part="shot", kind="all", windows=0, agreed=0.0, read=0)
    assert np.isnan(nothing.share) and np.isnan(nothing.interval).all()


def invented(texts: list[str], players: list[int]) -> HitWindows:
    count = len(texts)
    places = WindowPlaces(segment=np.arange(count), start=np.arange(count), stride=np.ones(count, np.int64))
    empty = np.array([], dtype=object)
    past = EventRows(
        time=np.zeros(0),
        kind=empty,
        player=empty,
        probability=np.zeros(0),
        source=empty,
        position=np.zeros((0, 3)),
    )
    return HitWindows(
        options=HitWindowOptions(frames=2),
        coarse=places,
        fine=places,
        player=np.array(players),
        claims=tuple(claims_of_text(text) for text in texts),
        handedness=(("right", "right"),) * count,
        past=(past,) * count,
        span=np.zeros((count, 1, 2), np.int64),
    )


def read(claims: Claims, **changed: str) -> dict[str, str]:
    return {name: getattr(claims, name) for name in ("stroke", "side", "zone", "zone_side")} | changed


def row_of(rows: list[AgreementRow], part: str, kind: str = "all") -> AgreementRow:
    return next(row for row in rows if (row.part, row.kind) == (part, kind))


def test_chance_and_the_commonest_word_are_counted_over_hits_of_the_same_player():
    made = invented(
        [
            "the player hits a forehand to the left service box",
            "the player hits a forehand to the right service box",
            "the player hits a backhand to the left service box",
            "the player hits a backhand",
            "the player hits a serve to the left service box",
        ],
        [0, 0, 0, 1, 0],
    )
    reads = [read(claims) for claims in made.claims]
    chance = chance_rows(made, reads)
    # The first three have each other, the fourth is its player's only one, the fifth the only serve.
    assert row_of(chance, "side").windows == 3
    assert row_of(chance, "side").agreed == pytest.approx(0.5 + 0.5 + 0.0)
    assert row_of(chance, "zone_side").agreed == pytest.approx(0.5 + 0.0 + 0.5)
    assert row_of(chance, "target", "serves").windows == 0
    common = commonest_rows(made.claims)
    assert row_of(common, "side").agreed == 2 and row_of(common, "side").windows == 5
    assert row_of(common, "zone").agreed == 4 and row_of(common, "zone").windows == 4


def test_a_hit_that_does_not_come_or_is_not_clear_does_not_agree():
    texts = ["the player hits a forehand to the left service box"] * 4
    claims = tuple(claims_of_text(text) for text in texts)
    reads = (read(claims[0]), None, read(claims[0], zone=""), read(claims[0], zone_side="right"))
    rows = tallied("right", claims, reads)
    assert (row_of(rows, "zone").agreed, row_of(rows, "zone").read) == (2, 2)
    assert (row_of(rows, "target").agreed, row_of(rows, "target").read) == (1, 2)
    assert row_of(rows, "shot").share == 0.75
    assert row_of(rows, "shot", "serves").windows == 0


@pytest.mark.parametrize(
    ("options", "changed", "message"),
    [
        (HitWindowOptions, {"windows": 0}, "windows: expected at least 1"),
        (HitWindowOptions, {"rate": 0.0}, "rate: expected above 0"),
        (HitWindowOptions, {"lead_s": (0.5, 0.2)}, "lead_s"),
        (HitWindowOptions, {"factor": 0}, "factor: expected at least 1"),
        (AgreementOptions, {"given": 0}, "given: expected at least 1"),
        (AgreementOptions, {"batch": 0}, "batch: expected at least 1"),
    ],
)
def test_options_out_of_range_are_refused(options, changed, message):
    with pytest.raises(ValueError, match=message):
        options(**changed)


def test_to_show_everything_is_refused(store, features, windows):
    with pytest.raises(ValueError, match="given: expected less than the 16 frames"):
        agreement(real, store, features, windows, replace(OPTIONS, given=16))


def test_rows_that_were_not_measured_are_named():
    with pytest.raises(ValueError, match="got right, shot, rally"):
        AgreementResult(rows=(), windows=0, rate=25.0, hit={}).row("right", "shot", "rally")
