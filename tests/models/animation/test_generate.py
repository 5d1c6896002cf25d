"""Long sequences are made of windows, keyframes first, and what a prompt fixes comes back to the bit."""

import numpy as np
import pytest
import torch
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pgm_models.animation.encode import continuous, standardise, unstandardise
from pgm_models.animation.generate import (
    GenerateOptions,
    Words,
    fill_sequence,
    generate,
    given_spans,
    unheld_values,
    wound_in,
)
from pgm_models.animation.keyframes import chunk_pieces, keyframe_spacing, levels_of, plan_of, shifted_pieces
from pgm_models.animation.layout import Layout, Property
from pgm_models.animation.prompt import Given, given_by, prompt_of
from pgm_models.animation.sample import SampleOptions
from tests.models.animation.toy_models import toy_layout, toy_model, toy_property

RATES = (4.0, 25.0)
QUICK = GenerateOptions(sample=SampleOptions(steps=2))


def document(frames: int, rate: float = 25.0, **more) -> dict:
    return {"scene": "tennis", "n_frames": frames, "frames_per_second": rate} | more


def fixed(column: str, start: int, numbers) -> dict:
    rows = np.atleast_2d(numbers).tolist()
    return {"column": column, "start_frame": start, "end_frame": start + len(rows), "value": rows}


class Asked:
    """A fill that draws noise where nothing is known, and remembers what it was shown."""

    def __init__(self) -> None:
        self.windows, self.known = [], []

    def __call__(self, windows, known, text_known, generator):
        self.windows.append(windows)
        self.known.append(known)
        assert bool((text_known == (windows.text >= 0)).all())
        noise = torch.randn(windows.state.shape, generator=generator)
        return torch.where(known[..., torch.from_numpy(PROPERTY)], windows.state, noise)


LAYOUT = toy_layout()
PROPERTY = LAYOUT.property_of_channel.copy()


def between(windows, known, text_known, generator):
    """A fill that goes straight from each known value to the next one, and stays where there is none."""
    state = windows.state.clone()
    for row in range(len(state)):
        for channel, owner in enumerate(PROPERTY):
            there = torch.nonzero(known[row, :, owner])[:, 0].numpy()
            if len(there):
                line = np.interp(np.arange(state.shape[1]), there, windows.state[row, there, channel].numpy())
                state[row, :, channel] = torch.from_numpy(line)
    return state


def filled(raw: dict, fill, *, window: int = 8, seed: int = 0, **options) -> tuple[np.ndarray, Given]:
    given = given_by(prompt_of(raw, LAYOUT), LAYOUT)
    plan = plan_of(given.known, rate=raw["frames_per_second"], window=window, rates=RATES, **options)
    words = Words(tokens=torch.zeros(len(given.texts), 2, 4), mask=torch.ones(len(given.texts), 2, dtype=torch.bool))
    state = fill_sequence(fill, given, words, plan, LAYOUT, torch.Generator().manual_seed(seed))
    return state, given


@settings(max_examples=40)
@drawn(
    st.integers(1, 300),
    st.integers(3, 20),
    st.one_of(st.just(1.0), st.floats(2.0, 80.0)),
    st.sets(st.integers(0, 299), max_size=12),
    st.data(),
)
def test_every_frame_is_made_once_and_after_the_keyframes_around_it(frames, window, spacing, wanted, data):
    marks = np.isin(np.arange(frames), list(wanted))
    levels = levels_of(frames, spacing=spacing, window=window, wanted=marks)
    keep = data.draw(st.integers(1, window - 1))
    made = np.zeros(frames, int)
    for pieces in shifted_pieces(levels[0], window=window, keep=keep):
        shown = made[pieces.frames] > 0
        assert pieces.frames.shape == (1, min(window, len(levels[0])))
        assert (shown == ~pieces.made).all()
        assert not made.any() or shown.sum() >= keep
        np.add.at(made, pieces.frames[pieces.made], 1)
    for keyframes, level in zip(levels, levels[1:], strict=False):
        assert np.isin(keyframes, level).all()
        pieces = chunk_pieces(level, keyframes, window=window)
        for row in np.flatnonzero(pieces.made.any(axis=1)):
            new = np.flatnonzero(pieces.made[row])
            assert made[pieces.frames[row, [new[0] - 1, new[-1] + 1]]].all()
        np.add.at(made, pieces.frames[pieces.made], 1)
        assert (made[level] == 1).all()
    assert (made == 1).all()


def test_fixed_frames_are_keyframes_where_they_are_not_too_near_to_each_other():
    wanted = np.zeros(100, dtype=bool)
    wanted[[0, 17, 18, 55, 99]] = True
    first = levels_of(100, spacing=7.0, window=16, wanted=wanted)[0]
    assert {0, 17, 55, 99} <= set(first.tolist())
    assert 18 not in first
    assert np.diff(first).min() >= 5 and np.diff(first).max() <= 11


@pytest.mark.parametrize(
    ("frames", "rate", "asked", "expected"),
    [
        (16, 25.0, None, 1.0),  # one window
        (61, 25.0, None, 4.0),  # one window spans it
        (17, 25.0, None, 2.0),
        (600, 25.0, None, 6.25),  # no slower than what was trained with
        (600, 6.0, None, 1.0),  # a first stage would be slower than that
        (600, 1.0, None, 1.0),
        (600, 50.0, None, 12.5),
        (600, 25.0, 2.5, 10.0),
        (600, 25.0, 50.0, 1.0),
        (20, 25.0, 0.1, 19.0),
    ],
)
def test_keyframes_lie_as_far_apart_as_one_window_needs(frames, rate, asked, expected):
    spacing = keyframe_spacing(frames, rate, window=16, rates=RATES, keyframe_hz=asked)
    assert spacing == pytest.approx(expected)


@pytest.mark.parametrize("frames", [1, 2, 7, 8, 9, 64, 300])
@pytest.mark.parametrize("rate", [1.0, 25.0, 50.0])
def test_fixed_values_come_back_to_the_bit_whatever_the_length_and_rate(frames, rate):
    rng = np.random.default_rng(frames)
    places = np.unique(rng.integers(0, frames, 5))
    values = [fixed("ball.position", int(place), rng.normal(0, 9, 3)) for place in places]
    values.append(fixed("player1.root_position", 0, rng.normal(0, 9, (frames, 3))))
    asked = Asked()
    state, given = filled(document(frames, rate, values=values), asked)
    told = given.known[:, PROPERTY]
    assert (state[told] == given.state[told]).all()
    assert np.isfinite(state).all() and (state[~told] != 0).all()
    assert all(windows.state.shape[1] <= min(8, frames) for windows in asked.windows)


def test_a_full_prompt_comes_back_without_asking_and_an_empty_one_is_all_the_models():
    rng = np.random.default_rng(0)
    values = [fixed(entry.column, 0, rng.normal(0, 3, (40, 3))) for entry in LAYOUT.properties]
    asked = Asked()
    state, given = filled(document(40, values=values), asked)
    assert not asked.windows and (state == given.state).all()
    state, given = filled(document(40), asked)
    assert asked.windows[0].text.max() == -1 and not asked.known[0].any()
    assert len(np.unique(state)) == state.size


def test_windows_show_texts_at_their_frames_and_the_rate_of_their_frames():
    texts = [
        {"player": 1, "start_frame": 10, "end_frame": 30, "text": "a"},
        {"player": 0, "start_frame": 0, "end_frame": 64, "text": "b"},
    ]
    asked = Asked()
    _, given = filled(document(64, texts=texts), asked)
    plan = plan_of(given.known, rate=25.0, window=8, rates=RATES)
    order = list(plan.pieces())
    for windows, pieces in zip(asked.windows, order, strict=True):
        assert (windows.text.numpy() == given.text[pieces.frames]).all()
        span = pieces.frames[:, -1] - pieces.frames[:, 0]
        np.testing.assert_allclose(windows.rate.numpy(), 25.0 * 7 / span, rtol=1e-6)
    assert len({float(windows.rate[0]) for windows in asked.windows}) > 1


def test_shifted_windows_know_what_they_keep_and_chunks_know_the_keyframes():
    asked = Asked()
    state, given = filled(document(30, rate=5.0), asked, keep=3)
    assert [int(known[0, :, 0].sum()) for known in asked.known] == [0, 3, 3, 3, 3, 6]
    asked = Asked()
    state, given = filled(document(29), asked)
    plan = plan_of(given.known, rate=25.0, window=8, rates=RATES)
    chunks = list(plan.pieces())[-1]
    np.testing.assert_array_equal(asked.known[-1][..., 0].numpy(), np.isin(chunks.frames, plan.levels[0]))
    own = asked.known[-1][..., 0].numpy()
    np.testing.assert_array_equal(asked.windows[-1].state.numpy()[own], state[chunks.frames][own])


def test_from_start_to_goal_by_waypoints_nothing_jumps():
    values = [fixed("player0.root_position", frame, place) for frame, place in
              ((0, [0.0, -12, 1]), (37, [3.0, -6, 1]), (90, [-3.0, -12, 1]))]  # fmt: skip
    state, _ = filled(document(91, values=values), between, window=16)
    path = state[:, LAYOUT.slice_of(0)]
    straight = np.array(
        [np.interp(np.arange(91), [0, 37, 90], line) for line in ([0, 3, -3], [-12, -6, -12], [1, 1, 1])]
    )
    steps = np.abs(np.diff(path, axis=0)).max(axis=0)
    assert (steps <= 1.5 * np.abs(np.diff(straight.T, axis=0)).max(axis=0) + 1e-5).all()
    np.testing.assert_allclose(path, straight.T, atol=0.2)


def rotation_layout() -> Layout:
    rotation = Property(
        column="player0.root_rotation",
        player=0,
        kind="rotations",
        first=0,
        width=3,
        reference=np.array([[0.3, -0.2, 1.0]]),
        channels=np.arange(3),
        rest=np.zeros(3),
        mean=np.array([0.1, 0.2, -0.3]),
        std=np.array([0.5, 0.7, 1.3]),
    )
    parts = (rotation, toy_property("ball.position", -1, 3))
    return Layout(scene="tennis", players=("player0",), properties=parts, constants=())


def test_windows_show_rotations_as_training_does_however_far_the_body_turned_before():
    layout = rotation_layout()
    turn = np.column_stack([np.zeros(40), np.zeros(40), 5.0 + 0.4 * np.arange(40), np.zeros((40, 3))])
    state = standardise(layout, turn)[None]
    known = np.ones((1, 40, 2), dtype=bool)
    known[:, 5:9] = False
    shown = wound_in(layout, state, known)
    vectors = unstandardise(layout, shown)[0, :, :3]
    there = known[0, :, 0]
    assert np.linalg.norm(vectors[0]) <= np.pi
    assert (shown[0, ~there, :3] == 0).all()
    assert np.abs(np.diff(vectors[there][:5], axis=0)).max() < 0.5
    same = Rotation.from_rotvec(vectors[there]).inv() * Rotation.from_rotvec(turn[there, :3])
    assert same.magnitude().max() < 1e-5
    assert (shown[0, :, 3:][known[0, :, 1]] == state[0, :, 3:][known[0, :, 1]]).all()
    plain = standardise(layout, continuous(layout, turn[None, :5] - [0, 0, 5, 0, 0, 0])).astype(np.float32)
    assert (wound_in(layout, plain, np.ones((1, 5, 2), dtype=bool)) == plain).all()


def test_the_same_seed_gives_the_same_play_and_another_one_another():
    model = toy_model()
    raw = document(64, texts=[{"player": 0, "start_frame": 0, "end_frame": 64, "text": "the player runs"}])
    raw["values"] = [fixed("ball.position", 33, [1.0, 2.0, 3.0])]
    prompt = prompt_of(raw, model.layout)
    first, second = (generate(model, prompt, QUICK, seed=3) for _ in range(2))
    other = generate(model, prompt, QUICK)
    assert (first.state == second.state).all()
    assert (first.state != other.state)[~first.known[:, model.layout.property_of_channel]].mean() > 0.99
    assert not first.warnings
    assert given_spans(first, model.layout) == {"ball.position": [[33, 34]]}
    np.testing.assert_allclose(first.columns["ball.position"][33], [1, 2, 3], atol=1e-6)
    assert first.columns["player0.root_position"].shape == (64, 3)


def test_words_about_one_player_change_the_play():
    model = toy_model()
    said = [
        generate(model, prompt_of(document(8, texts=texts), model.layout), QUICK).state
        for texts in ([], [{"player": 1, "start_frame": 0, "end_frame": 8, "text": "the player serves"}])
    ]
    assert (said[0] != said[1]).any()


@pytest.mark.parametrize(("frames", "rate"), [(1, 25.0), (20, 1.0), (20, 50.0), (8, 2.0)])
def test_rates_beyond_the_training_are_made_and_told_of(frames, rate):
    model = toy_model()
    play = generate(model, prompt_of(document(frames, rate), model.layout), QUICK)
    assert np.isfinite(play.state).all() and play.state.shape == (frames, model.layout.channels)
    assert any("frames_per_second: expected 4 to 25" in said for said in play.warnings) == (rate != 25.0)


def test_values_that_the_model_cannot_hold_are_told_of():
    layout = LAYOUT
    prompt = prompt_of(document(4, values=[fixed("ball.position", 1, [[1, 2, 3], [4, 5, 6]])]), layout)
    columns = {"ball.position": np.array([[0, 0, 0], [1, 2, 3], [4, 5.5, 6], [0, 0, 0.0]])}
    said = unheld_values(prompt, columns)
    assert len(said) == 1 and "ball.position: frames 1 to 3" in said[0] and "0.5 m" in said[0]
    columns["ball.position"][2, 1] = 5
    assert unheld_values(prompt, columns) == ()


@pytest.mark.parametrize(
    ("options", "said"), [({"keep": 8}, "keep: expected 1 to 7"), ({"keyframe_hz": 0.0}, "above 0")]
)
def test_options_that_cannot_be_are_refused(options, said):
    with pytest.raises(ValueError, match=said):
        filled(document(300), Asked(), **options)


def test_a_rotation_is_held_by_whatever_vector_says_it():
    column = "player0.root_rotation"
    turn = np.array([[0.3, -0.4, 1.2]])
    longer = turn * (1 - 2 * np.pi / np.linalg.norm(turn))
    prompt = prompt_of(document(2, values=[fixed(column, 0, longer)]), rotation_layout())
    assert unheld_values(prompt, {column: np.concatenate([turn, turn])}) == ()
    # Half a turn about the same axis is that far off.
    half = turn * (1 + np.pi / np.linalg.norm(turn))
    assert "off by up to 3.14 rad" in unheld_values(prompt, {column: np.concatenate([half, half])})[0]
