"""Sentences say the facts, in several ways, always the same ones of the same facts."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pgm_data.caption import words
from pgm_data.caption.facts import OWN_WAYS
from pgm_data.caption.grammar import GRAMMAR
from pgm_data.caption.measures import facts_of_clip
from pgm_data.caption.phrases import PIECE, grammar_of, inflected
from pgm_data.caption.words import words_of_facts
from tests.caption.rallies import BLOCKS, TENNIS, clip_ball, clip_players, person, standing, times_of
from tests.caption.test_strokes import RIGHT, TIMES, rally, serve

SLOTS = {
    *("side", "side2", "at", "ts", "fb", "ofb", "way", "gait", "again", "inner", "goal", "after_motion", "compass"),
    *("compass2", "sense", "spot", "np", "quality", "hands", "to", "out", "m", "h", "w", "o", "onp", "r", "since"),
}


def told(people, ball, times=TIMES, scene=TENNIS, handedness=RIGHT):
    return words_of_facts(facts_of_clip(people, ball, times, scene, handedness))


def test_every_symbol_of_the_grammar_is_stated_or_a_slot():
    named = {
        match[1] for options in GRAMMAR.values() for _, text in options for match in PIECE.finditer(text) if match[1]
    }
    inner = {name for options in GRAMMAR.values() for _, text in options for name in re.findall(r"\{(\w+)", text)}
    assert named <= inner <= set(GRAMMAR) | SLOTS
    source = Path(words.__file__).read_text(encoding="utf-8")
    used = set(re.findall(r'"\{(\w+)\}"', source)) | set(re.findall(r'"(say_\w+)"', source))
    assert used <= set(GRAMMAR) | SLOTS, used - set(GRAMMAR) - SLOTS


@pytest.mark.parametrize("way", OWN_WAYS)
@pytest.mark.parametrize("place", ["", "left", "right", "middle"])
def test_every_place_and_target_has_its_words(way, place):
    tail = {"": "", "middle": "_middle"}.get(place, "_side")
    for name in ("far", "behind", "baseline", "land", "line", "box", "net", "back"):
        assert {f"goal_{name}{tail}", f"spot_{name}{tail}"} <= set(GRAMMAR)
    for name in ("land", "deep", "far"):
        assert f"to_{name}{tail}" in GRAMMAR
    parts = way.split()
    assert {"left": "way_side", "right": "way_side"}.get(parts[0], f"way_{parts[0]}") in GRAMMAR
    assert len(parts) == 1 or f"way_side_{parts[1]}" in GRAMMAR


def test_a_grammar_states_each_symbol_once():
    with pytest.raises(ValueError, match="a new symbol"):
        grammar_of("a = b\na = c")
    with pytest.raises(ValueError, match="an equals sign"):
        grammar_of("no symbol here")
    assert [inflected("hit", form) for form in ("s", "ing", "to")] == ["hits", "hitting", "hit"]
    assert [inflected("be about", form) for form in ("s", "ing")] == ["is about", "being about"]
    assert inflected("hurry", "s") == "hurries" and inflected("take sidesteps", "ing") == "taking sidesteps"


def test_a_stroke_is_told_with_its_side_its_target_and_its_end():
    people, contacts = rally(to=(-3.0, 9.0))
    rows = told(people, clip_ball(contacts, TIMES))
    here = (rows.player == 0) & (rows.start_s <= 2.1) & (rows.end_s > 2.1) & (rows.alternative == 0)
    (hit,) = np.flatnonzero(here)
    text = rows.text[hit]
    assert "forehand" in text and "left" in text and "no man's land" in text
    assert re.search("winner|wins the point|win the point", text)
    other = rows.text[(rows.player == 1) & (rows.start_s <= 3.9) & (rows.end_s > 3.9)]
    assert all(re.search("reach|past|winner|wins", text) for text in other)


def test_outs_nets_and_serves_are_told():
    text = " ".join(told(*_built(rally(to=(1.0, 12.8), probability=0.0))).text)
    assert re.search(r"long|behind the baseline|beyond the baseline|over the baseline", text)
    serving = " ".join(told(*_built(serve(to=(-3.5, 5.0), probability=1.0))).text)
    assert "ace" in serving and "left service box" in serving.replace("service box on the left", "left service box")
    assert re.search("(prepar|ready|about|concentrat|gather)[a-z]* .*serve", serving)


def _built(made):
    people, contacts = made
    return people, clip_ball(contacts, TIMES)


def test_texts_of_a_span_differ_and_are_whole_sentences():
    rows = told(*_built(rally(x=2.5, to=(-2.8, 10.5))))
    spans = {}
    for k in range(len(rows)):
        spans.setdefault((rows.player[k], rows.start_frame[k]), []).append((rows.alternative[k], rows.text[k]))
    for texts in spans.values():
        assert [number for number, _ in texts] == list(range(len(texts)))
        assert len({text for _, text in texts}) == len(texts) >= 2
    for text in rows.text:
        assert not re.search(r"[{}<>()|\[\]]|  | ,|^\s|\s$", text)
        assert 3 <= len(text.split()) <= 32
        assert not re.search(r"\ba [aeiu]|\ban [bcdfghjklmnpqrstvwxyz]|\ban one", text)
    assert set(rows.source) == {"generated"}


def test_the_same_facts_have_the_same_words_and_other_clips_others():
    people, ball = _built(rally())
    one, two = told(people, ball), told(people, ball)
    assert list(one.text) == list(two.text)
    other = told(replace(people, clip_id="other"), ball)
    assert list(other.text) != list(one.text)


def test_a_handedness_that_nobody_knows_leaves_a_strike():
    people, contacts = rally(ball_side=0.02)
    rows = told(people, clip_ball(contacts, TIMES), handedness=())
    own = rows.text[(rows.player == 0) & (rows.start_s <= 2.1) & (rows.end_s > 2.1)]
    assert len(own) and not any(re.search("forehand|backhand", text) for text in own)
    assert all("ball" in text for text in own)


def test_spans_lie_where_there_are_states_and_nowhere_else():
    people, contacts = rally()
    status = people.players[0].status.copy()
    status[40:90] = "none"
    near = replace(people.players[0], status=status)
    rows = told(replace(people, players=(near, people.players[1])), clip_ball(contacts, TIMES))
    own = rows.player == 0
    covered = np.zeros(len(TIMES), dtype=bool)
    for start, end in zip(rows.start_frame[own], rows.end_frame[own], strict=True):
        covered[start:end] = True
    assert not covered[40:90].any() and covered[:40].all() and covered[90:].all()


def test_without_a_ball_movement_alone_is_told():
    xy = np.stack([2.0 * TIMES - 5.0, np.full_like(TIMES, -12.5)], -1)
    rows = told(clip_players(person(0, xy), standing(1, (0.0, 12.5), len(TIMES))), None)
    assert len(rows) and not any(re.search("hits|forehand|serve|ball", text) for text in rows.text)
    assert any("right" in text for text in rows.text[rows.player == 0])


def test_one_frame_and_no_frame_have_no_words():
    for count in (0, 1):
        times = TIMES[:count]
        rows = told(clip_players(standing(0, (0.0, -12.0), count), standing(1, (0.0, 12.0), count)), None, times)
        assert len(rows) == 0


def test_a_scene_of_one_player_without_a_net_is_told_by_the_compass():
    times = times_of(3.0)
    east = person(0, np.stack([1.5 * times - 2.0, 0 * times], -1), -np.pi / 2, scene=BLOCKS)
    rows = told(clip_players(east), None, times, BLOCKS, ())
    assert len(rows) and all("east" in text for text in rows.text)
    assert set(rows.player) == {0}
