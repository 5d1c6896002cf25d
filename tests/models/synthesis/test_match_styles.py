"""Styles of matches: means over pictures, and how they are kept with a model."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_models.model_file import MODEL_NAME
from pgm_models.synthesis.frames import frames_of_work
from pgm_models.synthesis.match_styles import match_styles, styles_of
from pgm_models.synthesis.model import load_model, model_digest, save_model
from tests.models.synthesis.drawn_matches import drawn_matches
from tests.models.synthesis.toy_models import PICTURE, toy_model, toy_run

FRAMES = 8


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Frames of two drawn matches, one a clip."""
    out = drawn_matches(tmp_path_factory.mktemp("drawn"), frames=FRAMES)
    return frames_of_work(out / "work", picture=PICTURE)


@pytest.fixture(scope="module")
def model():
    return toy_model()


def codes(model, store, row):
    """What the encoder reads off one frame."""
    boxes = torch.as_tensor(store.boxes_px[row : row + 1])
    return model.encoder(store.picture(row)[None], boxes)[0]


def test_styles_are_means_over_evenly_spaced_frames_that_show_each_object(store, model):
    boxes = store.boxes_px.copy()
    boxes[:5, 0] = np.nan  # player0 is not seen in the first five frames, player1 in none
    boxes[:, 1] = np.nan
    hidden = replace(store, boxes_px=boxes)
    rows = np.flatnonzero(store.clip == 0)
    each = torch.stack([codes(model, hidden, row) for row in rows.tolist()])
    found = styles_of(model, hidden, rows, pictures=100)
    assert found.shape == (1, len(store.scene.objects), model.options.fields.style)
    torch.testing.assert_close(found[0, 0], each[5:, 0].mean(dim=0))
    torch.testing.assert_close(found[0, 1], model.encoder.unseen[1])
    torch.testing.assert_close(found[0, 2:], each[:, 2:].mean(dim=0))
    few = styles_of(model, hidden, rows, pictures=2)
    torch.testing.assert_close(few[0, 3], each[[2, 6], 3].mean(dim=0))
    torch.testing.assert_close(few[0, 0], each[[5, 7], 0].mean(dim=0))
    assert not torch.allclose(few, found)


def test_no_rows_give_what_is_not_seen(store, model):
    found = styles_of(model, store, np.zeros(0, dtype=np.int64))
    assert torch.equal(found[0], model.encoder.unseen)


def test_players_who_change_ends_are_those_who_are_there_longest(store, model):
    rows = np.flatnonzero(store.clip == 0)
    identity = store.identity.copy()
    identity[rows[:3], 0] = identity[rows[0], 1]
    changed = replace(store, identity=identity)
    later = torch.stack([codes(model, store, row) for row in rows[3:].tolist()])
    found = styles_of(model, changed, rows, pictures=100)
    torch.testing.assert_close(found[0, 0], later[:, 0].mean(dim=0))
    unknown = replace(store, identity=np.full_like(identity, -1))
    assert not torch.allclose(styles_of(model, unknown, rows, pictures=100)[0, 0], found[0, 0])


def test_larger_pictures_are_read_at_the_size_that_was_learned(model, tmp_path):
    out = drawn_matches(tmp_path, matches=1, frames=2)
    small, large = (frames_of_work(out / "work", picture=size) for size in (PICTURE, (192, 108)))
    assert large.size == (192, 108)
    rows = np.arange(2)
    one, other = (styles_of(model, each, rows) for each in (small, large))
    assert float((one - other).abs().max()) < 0.05 * float(one.abs().max())


def test_matches_have_styles_of_their_own_which_a_model_file_keeps(store, model, tmp_path):
    found = match_styles(model, store)
    assert list(found) == ["match0", "match1"]
    for name, number in (("match0", 0), ("match1", 1)):
        assert torch.equal(found[name], styles_of(model, store, np.flatnonzero(store.clip == number))[0])
    assert not torch.allclose(found["match0"], found["match1"])
    assert list(match_styles(model, store[store.clip == 1])) == ["match1"]
    made = toy_model()
    before = model_digest(made)
    made.keep_styles(found)
    assert model_digest(made) != before
    loaded = load_model(toy_run(tmp_path / "run", made))
    assert list(loaded.match_styles) == ["match0", "match1"]
    for name, codes_ in found.items():
        assert torch.equal(loaded.match_styles[name], codes_)
    assert model_digest(loaded) == model_digest(made)


def test_a_model_without_styles_is_one_all_the_same(tmp_path):
    model = toy_model()
    model.keep_styles({})
    save_model(tmp_path / MODEL_NAME, model, {})
    loaded = load_model(tmp_path)
    assert loaded.match_styles == {}
    assert "_worn" not in loaded.state_dict()
