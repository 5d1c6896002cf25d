"""Rallies are made one at a time, told of, cancelled at any time, and kept."""

import time

import numpy as np
import pytest

from pgm_models.synthesis.play_rallies import KEPT, BusyError, Rally, RallyDesk, RallyError, UnknownRallyError
from tests.models.synthesis.play_stages import FRAMES, PROMPT, Maker, toy_stage

STAGE = toy_stage()


def until(desk, name, *states):
    ends = time.monotonic() + 30
    while (progress := desk.progress(name)).state not in states:
        assert time.monotonic() < ends, progress
        time.sleep(0.005)
    return progress


def test_a_rally_is_made_and_kept():
    desk = RallyDesk(Maker(STAGE))
    name = desk.order(PROMPT)
    progress = until(desk, name, "done")
    assert (progress.share, progress.words) == (1.0, "done")
    rally = desk.rally(name)
    assert rally.frames == FRAMES and rally.prompt == PROMPT
    np.testing.assert_allclose(rally.state(3)["player1.root_position"], [0.3, 8.0, 0.9])
    with pytest.raises(RallyError, match="frame: expected 0 to 19, got 20"):
        rally.state(20)
    assert desk.cancel(name).state == "done" and desk.rally(name) is rally


def test_progress_is_told_while_it_is_made_and_another_one_has_to_wait():
    maker = Maker(STAGE, held=True)
    desk = RallyDesk(maker)
    name = desk.order(PROMPT)
    progress = until(desk, name, "making")
    assert progress.words in ("reading the prompt", "step 1 of 4") and progress.share == 0
    with pytest.raises(BusyError, match="expected to wait for it, or to cancel it"):
        desk.order(PROMPT)
    with pytest.raises(RallyError, match=f"rally {name}: expected one that is done, got one that is making"):
        desk.rally(name)
    maker.go.set()
    until(desk, name, "done")
    assert desk.order(PROMPT) != name


def test_a_cancelled_rally_ends_and_the_next_one_begins():
    maker = Maker(STAGE, held=True)
    desk = RallyDesk(maker)
    first = desk.order(PROMPT)
    until(desk, first, "making")
    assert desk.cancel(first).state == "cancelled"
    second = desk.order(PROMPT | {"seed": 8})
    until(desk, second, "making")  # the first one has let go of the model
    maker.go.set()
    until(desk, second, "done")
    assert desk.progress(first).state == "cancelled" and [made["seed"] for made in maker.made] == [8]
    with pytest.raises(RallyError, match="got one that is cancelled"):
        desk.rally(first)


def test_a_rally_that_was_cancelled_in_its_last_step_is_not_handed_out():
    desk = None

    def make(document, say):
        desk.cancel("1")
        return Maker(STAGE, steps=0)(document, say)

    desk = RallyDesk(make)
    name = desk.order(PROMPT)
    second = None
    while second is None:
        try:
            second = desk.order(PROMPT)
        except BusyError:
            time.sleep(0.005)
    assert desk.progress(name).state == "cancelled"
    with pytest.raises(RallyError):
        desk.rally(name)


@pytest.mark.parametrize(
    ("seed", "said"), [(13, "prompt: seed: expected a lucky"), (14, "RuntimeError: out of memory")]
)
def test_what_cannot_be_made_fails_with_words_and_stops_nothing(seed, said):
    desk = RallyDesk(Maker(STAGE))
    name = desk.order(PROMPT | {"seed": seed})
    assert until(desk, name, "failed").words.startswith(said)
    until(desk, desk.order(PROMPT), "done")


def test_the_oldest_rallies_go():
    desk = RallyDesk(Maker(STAGE, steps=1))
    names = []
    for _ in range(KEPT + 2):
        names.append(desk.order(PROMPT))
        until(desk, names[-1], "done")
    for gone in names[:2]:
        with pytest.raises(UnknownRallyError, match=f"expected one of {names[2]}, "):
            desk.rally(gone)
    assert desk.rally(names[2]).frames == FRAMES


def test_closing_ends_what_is_being_made():
    maker = Maker(STAGE, held=True)
    desk = RallyDesk(maker)
    name = desk.order(PROMPT)
    until(desk, name, "making")
    desk.close()
    until(desk, name, "cancelled")
    assert not maker.made


def test_a_rally_has_frames_and_columns_of_one_length():
    some = {"prompt": {}, "rate": 1.0, "view": None, "notes": (), "warnings": ()}
    for columns in ({}, {"a": np.zeros((0, 3))}, {"a": np.zeros((2, 3)), "b": np.zeros((3, 1))}):
        with pytest.raises(ValueError, match="columns: expected one length"):
            Rally(columns=columns, **some)
