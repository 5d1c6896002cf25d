"""What is kept on disk is what the encoder says, made once for each list of texts and encoder."""

import json
import pickle
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from pgm_models.animation import text_features as module
from pgm_models.animation.text_encoders import HashEncoder, TextEncoder
from pgm_models.animation.text_features import text_features

TEXTS = tuple(f"the player runs {'very ' * (k % 7)}far {k}" for k in range(40))


class Counting(TextEncoder):
    """A hash encoder that counts what it is asked for, and may say numbers that are too large."""

    name = "counting"
    longest = 256

    def __init__(self, *, scale: float = 1.0) -> None:
        self.inner = HashEncoder(8)
        self.width, self.identity = 8, f"counting {scale}"
        self.scale = scale
        self.asked: list[str] = []

    def tokens(self, texts: Sequence[str], *, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor]:
        self.asked += texts
        features, mask = self.inner.tokens(texts, device=device)
        return features * self.scale, mask


@pytest.mark.parametrize("at_a_time", [1, 7, 256])
def test_rows_are_what_the_encoder_says_of_their_texts(
    at_a_time: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "TEXTS_AT_A_TIME", at_a_time)
    encoder = HashEncoder(8)
    features = text_features(TEXTS, encoder, tmp_path)
    ids = np.array([39, 0, 6, 6, 13])
    tokens, mask = features.rows(ids)
    expected, shown = encoder.tokens([TEXTS[k] for k in ids])
    assert tokens.dtype == np.float32
    np.testing.assert_array_equal(tokens, expected.half().float().numpy())
    np.testing.assert_array_equal(mask, shown.numpy())


def test_a_long_text_keeps_its_first_tokens_and_its_end_token(tmp_path: Path) -> None:
    encoder = HashEncoder(8)
    features = text_features(["a b c d e", "a", ""], encoder, tmp_path, longest=3)
    tokens, mask = features.rows(np.arange(3))
    whole = encoder.tokens(["a b c d e"])[0][0].half().float().numpy()
    assert mask.tolist() == [[True, True, True], [True, True, False], [True, False, False]]
    np.testing.assert_array_equal(tokens[0], whole[[0, 1, -1]])
    np.testing.assert_array_equal(tokens[1:, [1, 0]][[0, 1], [0, 1]], whole[[-1, -1]])


def test_a_limit_of_one_token_keeps_the_end_token(tmp_path: Path) -> None:
    features = text_features(["a b"], HashEncoder(8), tmp_path, longest=1)
    np.testing.assert_array_equal(
        features.rows(np.array([0]))[0], HashEncoder(8).tokens([""])[0].half().float().numpy()
    )
    with pytest.raises(ValueError, match="longest: expected at least 1, got 0"):
        text_features(["a"], HashEncoder(8), tmp_path, longest=0)


@settings(max_examples=25)
@given(lists=st.lists(st.lists(st.text(max_size=12), max_size=6), min_size=1, max_size=3))
def test_whatever_was_kept_before_a_list_gets_its_own_features(
    lists: list[list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, encoder = tmp_path_factory.mktemp("features"), HashEncoder(4)
    for texts in lists:
        features = text_features(texts, encoder, folder)
        tokens, mask = features.rows(np.arange(len(texts)))
        expected, shown = encoder.tokens(texts)
        np.testing.assert_array_equal(tokens, expected.half().float().numpy())
        np.testing.assert_array_equal(mask, shown.numpy())


def test_no_text_and_no_row_give_nothing_of_the_right_width(tmp_path: Path) -> None:
    for texts in ((), TEXTS):
        tokens, mask = text_features(texts, HashEncoder(8), tmp_path).rows(np.zeros(0, np.int64))
        assert tokens.shape == (0, 0, 8)
        assert tokens.dtype == np.float32
        assert mask.shape == (0, 0)
        assert mask.dtype == np.bool_


def test_the_same_texts_are_encoded_once(tmp_path: Path) -> None:
    encoder = Counting()
    first = text_features(TEXTS, encoder, tmp_path)
    assert sorted(encoder.asked) == sorted(TEXTS)
    again = text_features(list(TEXTS), encoder, tmp_path)
    assert len(encoder.asked) == len(TEXTS)
    assert again.folder == first.folder
    assert [path.name for path in tmp_path.iterdir()] == [first.folder.name]


def test_only_texts_that_are_new_are_encoded_where_a_list_grows(tmp_path: Path) -> None:
    encoder = Counting()
    text_features(TEXTS[:30], encoder, tmp_path)
    encoder.asked.clear()
    grown = (*TEXTS[35:], "new", *TEXTS[:30], "new")
    features = text_features(grown, encoder, tmp_path)
    assert sorted(encoder.asked) == sorted({"new", *TEXTS[35:]})
    tokens, mask = features.rows(np.arange(len(grown)))
    np.testing.assert_array_equal(tokens, encoder.tokens(grown)[0].half().float().numpy())
    assert mask.sum() == features.counts.sum()


def test_other_texts_another_order_another_encoder_and_another_limit_are_other_features(tmp_path: Path) -> None:
    made = [
        text_features(TEXTS, HashEncoder(8), tmp_path),
        text_features(TEXTS[::-1], HashEncoder(8), tmp_path),
        text_features(TEXTS[1:], HashEncoder(8), tmp_path),
        text_features(TEXTS, HashEncoder(9), tmp_path),
        text_features(TEXTS, HashEncoder(8), tmp_path, longest=5),
    ]
    assert len({features.folder for features in made}) == len(made)
    assert [features.rows(np.array([0]))[0].shape[1:] for features in made] == [(6, 8), (10, 8), (7, 8), (6, 9), (5, 8)]


def test_features_travel_to_another_process_without_their_numbers(tmp_path: Path) -> None:
    features = text_features(TEXTS, HashEncoder(256), tmp_path)
    expected = features.rows(np.arange(40))
    sent = pickle.dumps(features)
    assert len(sent) < 4000 < (features.folder / module.TOKENS_FILE).stat().st_size
    for got, wanted in zip(pickle.loads(sent).rows(np.arange(40)), expected, strict=True):
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize("bad", [-1, 40])
def test_a_row_that_is_not_there_is_refused(bad: int, tmp_path: Path) -> None:
    features = text_features(TEXTS, HashEncoder(8), tmp_path)
    with pytest.raises(ValueError, match=f"ids: expected rows of 40 texts, got {bad}"):
        features.rows(np.array([0, bad]))


def test_a_feature_that_float16_does_not_hold_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="text 'the player runs .*finite in float16"):
        text_features(TEXTS, Counting(scale=1e6), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_encoding_leaves_nothing_that_is_taken_for_whole(tmp_path: Path) -> None:
    class Interrupted(Counting):
        def tokens(self, texts: Sequence[str], *, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        text_features(TEXTS, Interrupted(), tmp_path)
    assert list(tmp_path.iterdir()) == []
    encoder = Counting()
    text_features(TEXTS, encoder, tmp_path)
    assert sorted(encoder.asked) == sorted(TEXTS)


def test_a_process_that_was_slower_takes_what_the_faster_one_made(tmp_path: Path) -> None:
    class Overtaken(Counting):
        def tokens(self, texts: Sequence[str], *, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor]:
            if not self.asked:
                # On disk, another process works under another name.
                monkeypatch = pytest.MonkeyPatch()
                monkeypatch.setattr(module.os, "getpid", lambda: 1)
                text_features(TEXTS, Counting(), tmp_path)
                monkeypatch.undo()
            return super().tokens(texts, device=device)

    features = text_features(TEXTS, Overtaken(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [features.folder.name]
    assert features.rows(np.arange(40))[0].shape == (40, 12, 8)


def test_progress_is_told_and_what_was_made_is_said_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TEXTS_AT_A_TIME", 16)
    said: list[str] = []
    features = text_features(TEXTS, HashEncoder(8), tmp_path, show=said.append)
    assert said == ["hash: 16 of 40 texts", "hash: 32 of 40 texts", "hash: 40 of 40 texts"]
    about = json.loads((features.folder / module.ABOUT_FILE).read_text())
    assert about == {
        "identity": "hash-1-8",
        "longest": 64,
        "width": 8,
        "texts": 40,
        "tokens": int(features.counts.sum()),
    }
