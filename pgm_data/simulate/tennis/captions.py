"""Captions of tennis plays: what each player does, span by span, in words that are true.

Every caption is decided first and worded afterwards: `caption_content` collects what holds in the span (from the path
of the pelvis, the strokes, the shots, the contacts of the ball and the outcome), and three sentences are drawn that say
it. What is not clear by the thresholds of `areas` and `caption_motion` is not said. LEFT and RIGHT are the player's
own, facing the net, for areas across the net as well (see `areas`). A caption may name the reason of what its span
shows, and a hit's caption says where the ball goes, which flies on after the span.
"""

from dataclasses import replace

import numpy as np

from pgm_data.simulate.states import Caption
from pgm_data.simulate.tennis.caption_content import Content, content_of
from pgm_data.simulate.tennis.caption_course import course_of, cuts_of
from pgm_data.simulate.tennis.caption_grammar import GRAMMAR
from pgm_data.simulate.tennis.caption_spans import spans
from pgm_data.simulate.tennis.phrases import Draw, sentence
from pgm_data.simulate.tennis.play import Play

TEXTS = 3
"""A main text and two others."""
WORDS = (4, 30)
"""Fewest and most words of a text."""
_TRIES = 80
_OPTIONAL = ("pace", "goal", "purpose", "adj", "hands", "first", "then", "effort")
"""Slots that a sentence can do without."""


def captions_of(play: Play, rng: np.random.Generator) -> tuple[Caption, ...]:
    """Captions of player 0, then of player 1, each in order of time; their spans tile the play without gaps.

    Sides are the captioned player's own, facing the net, for areas across the net as well.
    """
    course = course_of(play)
    draw = Draw(rng)
    captions: list[Caption] = []
    for player in (0, 1):
        strokes = [stroke.time for stroke in play.strokes if stroke.player == player]
        for start, end in spans(play.duration_s, cuts_of(course, player, rng), strokes):
            texts = texts_of(content_of(course, player, start, end, draw), draw)
            captions.append(Caption(player=player, start_s=start, end_s=end, texts=texts))
    return tuple(captions)


def texts_of(content: Content, draw: Draw) -> tuple[str, ...]:
    """Three different sentences that say the content, each as unlike those before as the better of two draws.

    Raises:
        RuntimeError: If the grammar has too few sentences for the content.
    """
    texts: list[str] = []
    for tries in range(_TRIES):
        if tries == _TRIES // 4:  # It says more than fits into the longest text.
            content = replace(content, slots=content.slots | dict.fromkeys(_OPTIONAL, ""))
        text = min((_draw_text(content, draw) for _ in range(2 if texts else 1)), key=lambda t: _likeness(t, texts))
        if text not in texts and WORDS[0] <= len(text.split()) <= WORDS[1]:
            texts.append(text)
            if len(texts) == TEXTS:
                return tuple(texts)
    raise RuntimeError(f"captions: expected {TEXTS} sentences, got {texts} from {content.frames}, {content.slots}")


def _draw_text(content: Content, draw: Draw) -> str:
    frame = content.frames[int(draw() * len(content.frames))]
    return sentence(f"{{{frame}}}", content.slots, GRAMMAR, draw)


def _likeness(text: str, others: list[str]) -> float:
    """Share of the text's pairs of words that the most similar of the others has too."""
    words = text.split()
    pairs = set(zip(words[:-1], words[1:], strict=True))
    return max((sum(p in pairs for p in zip(o.split()[:-1], o.split()[1:], strict=True)) for o in others), default=0)
