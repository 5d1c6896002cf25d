import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.states import Caption
from pgm_data.simulate.tennis.caption_figures import figures_of, words_of
from pgm_data.simulate.tennis.caption_grammar import GRAMMAR
from pgm_data.simulate.tennis.captions import captions_of
from pgm_data.simulate.tennis.match import draw_match
from pgm_data.simulate.tennis.match import plays as match_plays
from pgm_data.simulate.tennis.phrases import Draw, inflect, parse_grammar, sentence
from pgm_data.simulate.tennis.play import Plan, Play
from tests.simulate.tennis.caption_plays import OUTCOMES, plays
from tests.simulate.tennis.caption_reader import contradictions


def captioned(play: Play, seed: int = 0) -> tuple[Caption, ...]:
    return captions_of(play, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def handmade() -> list[Play]:
    return plays(11, 48)


@pytest.fixture(scope="module")
def played() -> list[Play]:
    """The first serves of three matches."""
    found = []
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        course = match_plays(draw_match(rng, load_scene("tennis"), name="m"), rng)
        found += [next(course) for _ in range(5)]
    return found


@pytest.fixture(scope="module")
def captions(handmade: list[Play], played: list[Play]) -> list[tuple[Play, Caption]]:
    return [(play, caption) for play in handmade + played for caption in captioned(play, 5)]


def by_play(captions: list[tuple[Play, Caption]]) -> list[tuple[Play, list[Caption]]]:
    groups = [list(group) for _, group in itertools.groupby(captions, key=lambda pair: id(pair[0]))]
    return [(group[0][0], [caption for _, caption in group]) for group in groups]


def test_hand_made_plays_have_every_stroke_outcome_hand_and_end(handmade: list[Play]) -> None:
    strokes = [stroke for play in handmade for stroke in play.strokes]
    kinds = {"serve", "drive", "slice", "volley", "half_volley", "smash", "lob", "drop"}
    assert {(s.kind, s.player) for s in strokes} == {(kind, player) for kind in kinds for player in (0, 1)}
    assert {(p.outcome, p.server) for p in handmade} == {(outcome, end) for outcome in OUTCOMES for end in (0, 1)}
    assert {s.hands for s in strokes if s.side == "backhand"} == {1, 2}
    assert any(not s.hit for s in strokes)


def test_spans_of_each_player_tile_the_play(captions: list[tuple[Play, Caption]]) -> None:
    for play, found in by_play(captions):
        assert [c.player for c in found] == sorted(c.player for c in found)
        for player in (0, 1):
            ends = [(c.start_s, c.end_s) for c in found if c.player == player]
            assert ends[0][0] == 0.0 and ends[-1][1] == play.duration_s
            assert all(a[1] == b[0] for a, b in zip(ends[:-1], ends[1:], strict=True))
            assert all(0.6 - 1e-9 <= b - a <= 3.0 + 1e-9 for a, b in ends)


def test_every_stroke_has_a_caption_of_its_own(captions: list[tuple[Play, Caption]]) -> None:
    for play, caption in captions:
        own = [s for s in play.strokes if s.player == caption.player and caption.start_s <= s.time < caption.end_s]
        assert len(own) <= 1


def test_no_text_contradicts_its_play(captions: list[tuple[Play, Caption]]) -> None:
    wrong = [
        found
        for play, caption in captions
        for text in caption.texts
        for found in contradictions(play, caption.player, caption.start_s, caption.end_s, text)
    ]
    assert not wrong, wrong[:5]


EXCHANGES = [
    ("left", "right", 0.99),
    ("forehand", "backhand", 1.0),
    ("first", "second", 0.97),
    ("deuce", "ad", 1.0),
    ("towards the net", "away from the net", 0.95),
    ("walks", "runs", 0.9),
    ("two-handed", "one-handed", 1.0),
    ("into the net", "out of the field", 1.0),
    ("no man's land", "the service boxes", 0.95),
    ("won", "lost", 1.0),
    ("slice", "volley", 1.0),
    ("behind the baseline", "in the service box", 1.0),
    ("stays", "runs to the left", 1.0),
    ("hits the net", "sends the ball out", 1.0),
]


@pytest.mark.parametrize(("one", "other", "share"), EXCHANGES)
def test_the_reader_finds_the_lie_when_words_are_exchanged(
    captions: list[tuple[Play, Caption]], one: str, other: str, share: float
) -> None:
    changed, found = 0, 0
    for play, caption in captions:
        for text in caption.texts:
            lie = re.sub(rf"\b({one}|{other})\b", lambda m: other if m.group() == one else one, text)
            if lie != text:
                changed += 1
                found += bool(contradictions(play, caption.player, caption.start_s, caption.end_s, lie))
    assert changed >= 3
    assert found >= share * changed


def mirrored(play: Play) -> Play:
    """The same play with near and far exchanged, seen by each player as before."""
    return replace(
        play,
        athletes=play.athletes[::-1],
        identities=play.identities[::-1],
        server=1 - play.server,
        winner=1 - play.winner if play.winner >= 0 else -1,
        strokes=tuple(
            replace(s, player=1 - s.player, ball=s.ball * [-1, -1, 1], swing=s.swing * [-1, -1, 1])
            for s in play.strokes
        ),
        shots=tuple(replace(s, player=1 - s.player, aim=-s.aim, landing=-s.landing) for s in play.shots),
        plans=(turned(play.plans[1]), turned(play.plans[0])),
        ball=replace(
            play.ball,
            contacts=tuple(replace(c, position=c.position * [-1, -1, 1]) for c in play.ball.contacts),
            flights=tuple(
                replace(
                    f,
                    positions=f.positions * [-1, -1, 1],
                    velocities=f.velocities * [-1, -1, 1],
                    spins=f.spins * [-1, -1, 1],
                )
                for f in play.ball.flights
            ),
        ),
    )


def turned(plan: Plan) -> Plan:
    return replace(plan, path=-plan.path, heading=plan.heading + np.pi)


def test_a_text_is_as_true_of_a_play_turned_half_about(captions: list[tuple[Play, Caption]]) -> None:
    for play, caption in captions[:80]:
        other = mirrored(play)
        for text in caption.texts:
            assert not contradictions(other, 1 - caption.player, caption.start_s, caption.end_s, text)


def test_texts_are_three_different_lower_case_sentences_of_4_to_30_words(captions: list[tuple[Play, Caption]]) -> None:
    for _, caption in captions:
        assert len(set(caption.texts)) == 3
        for text in caption.texts:
            assert re.fullmatch(r"[a-z'-]+(,? [a-z'-]+)*", text), text
            assert 4 <= len(words_of(text)) <= 30
            assert not re.search(r"\ba [aeiou](?!ne)|\ban [^aeiou]|\b(\w+) \1\b", text), text


@pytest.mark.parametrize("duration", [0.05, 0.5, 1.19, 1.21])
def test_a_play_cut_short_is_still_told(handmade: list[Play], duration: float) -> None:
    play = handmade[2]
    knots = int(duration * 50) + 1
    plans = [replace(p, times=p.times[:knots], path=p.path[:knots], heading=p.heading[:knots]) for p in play.plans]
    found = captioned(replace(play, duration_s=duration, plans=(plans[0], plans[1])))
    assert sum(c.end_s - c.start_s for c in found) == pytest.approx(2 * duration)
    assert all(len(set(c.texts)) == 3 for c in found)


def test_the_same_seed_says_the_same(handmade: list[Play]) -> None:
    for play in handmade[:8]:
        again = captioned(play, 7)
        assert [(c.start_s, c.texts) for c in captioned(play, 7)] == [(c.start_s, c.texts) for c in again]
    assert [c.texts for c in captioned(handmade[0], 1)] != [c.texts for c in captioned(handmade[0], 2)]


def test_captions_are_as_varied_and_as_long_as_people_write_them(captions: list[tuple[Play, Caption]]) -> None:
    found = figures_of(caption for _, caption in captions)
    assert found.words >= 300
    assert found.distinct >= 0.9 * found.captions
    assert 12.0 <= found.average_words <= 16.5
    assert 1.0 <= found.average_span_s <= 1.6


def test_figures_count_what_they_say() -> None:
    made = [
        Caption(player=0, start_s=0.0, end_s=1.0, texts=("the player waits", "player waits, then runs")),
        Caption(player=1, start_s=0.0, end_s=2.0, texts=("the player waits", "the player runs")),
    ]
    found = figures_of(made)
    assert (found.captions, found.distinct, found.texts, found.distinct_texts) == (2, 1, 4, 3)
    assert (found.words, found.average_words, found.average_span_s) == (5, 3.0, 1.5)
    assert (found.fewest_words, found.most_words) == (3, 4)
    none = figures_of([])
    assert none.captions == 0 and none.words == 0 and np.isnan(none.average_words)


@pytest.mark.parametrize(
    ("verb", "s", "ing"),
    [
        ("run", "runs", "running"), ("hurry", "hurries", "hurrying"), ("rush", "rushes", "rushing"),
        ("go", "goes", "going"), ("be", "is", "being"), ("shuffle", "shuffles", "shuffling"),
        ("hit", "hits", "hitting"), ("play", "plays", "playing"),
        ("split-step", "split-steps", "split-stepping"), ("miss", "misses", "missing"), ("win", "wins", "winning"),
    ],
)  # fmt: skip
def test_verbs_are_inflected(verb: str, s: str, ing: str) -> None:
    assert (inflect(verb, "s"), inflect(verb, "ing"), inflect(verb, "inf")) == (s, ing, verb)


def test_every_symbol_that_the_grammar_refers_to_is_there_or_a_slot() -> None:
    slots = set(
        "side side2 at ts fb ofb dc nth m h w r o f hit gait pace way goal purpose motion first then effort again spot"
        " np adj hands fault to aim out onp after passive".split()
    )
    for name, options in GRAMMAR.items():
        for option in options:
            for reference in re.findall(r"\{(\w+)(?:\+\w+)?\}", option.text):
                assert reference in GRAMMAR or reference in slots, (name, reference)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_options_come_as_often_as_they_weigh(seed: int) -> None:
    grammar = parse_grammar("x: 3* A apple | A one-handed {y}\n | \ny: pear")
    draw = Draw(np.random.default_rng(seed))
    found = [sentence("{x}", {}, grammar, draw) for _ in range(400)]
    assert set(found) == {"an apple", "a one-handed pear", ""}
    assert 180 < found.count("an apple") < 300


def test_a_grammar_that_loops_or_leaves_a_verb_bare_is_refused() -> None:
    with pytest.raises(ValueError, match="one line a symbol"):
        parse_grammar("x: again {x}")
    with pytest.raises(ValueError, match="a form for every verb"):
        sentence("the player [run]", {}, {}, Draw(np.random.default_rng(0)))
    with pytest.raises(KeyError, match="nothing"):
        sentence("{nothing}", {}, {}, Draw(np.random.default_rng(0)))
