"""Words of captions and their parts of speech, by a lexicon and by what stands around them: no model, no network."""

import re
from collections.abc import Sequence

from pgm_data.dataset.stats_lexicon import (
    ADJECTIVE_ENDINGS,
    ADJECTIVES,
    ADVERBS,
    AUXILIARIES,
    CONJUNCTIONS,
    DETERMINERS,
    NOUN_ENDINGS,
    NOUNS,
    NUMERALS,
    PARTICLES,
    PHRASAL,
    PREPOSITIONS,
    PRONOUNS,
    VERBS,
)

PARTS = (
    "nouns",
    "verbs",
    "adjectives",
    "adverbs",
    "pronouns",
    "articles",
    "prepositions",
    "conjunctions",
    "numerals",
    "particles",
    "punctuation",
    "others",
)
"""Parts of speech, as the paper's table names them; its articles are all determiners."""

TOKEN = re.compile(r"'s\b|(?<=s)'(?=\s|$)|[^\W\d_]+(?:[-'](?!s\b)[^\W\d_]+)*|\d+(?:[.,]\d+)*|[^\w\s]|_")
"""A word, a number or a mark; the 's of a possessive is a word of its own, as taggers have it."""
_AMBIGUOUS = (VERBS & NOUNS) | frozenset(
    """serve serves return returns slice slices volley volleys lob lobs smash smashes drive drives drop drops toss
    tosses block blocks swing swings stretch reach lunge approach pass walk jog sprint run runs move moves turn turns
    stop rest halt landing try attempt look return finish start play plays touch spin split punch chip chips charge
    retreat hit hits answer reply pace speed counter counters stroke step steps jump jumps fall net bounce bounces
    place end land head point circle cross change correct""".split()
)


def words_of(text: str) -> list[str]:
    """The words, numbers and marks of a text, in small letters."""
    return TOKEN.findall(text.lower())


def is_word(token: str) -> bool:
    """Whether a token counts as a word: letters or digits, and not the 's of a possessive."""
    return token[0].isalnum()


def parts_of(tokens: Sequence[str]) -> list[str]:
    """The part of speech of each token, one of `PARTS`."""
    parts: list[str] = []
    for place, token in enumerate(tokens):
        before = parts[-1] if parts else ""
        last = tokens[place - 1] if place else ""
        after = tokens[place + 1] if place + 1 < len(tokens) else ""
        parts.append(_part(token, before, last, after))
    return parts


def _part(token: str, before: str, last: str, after: str) -> str:
    """The part of one token, after the part and the word before it and before the word after it."""
    if not token[0].isalnum() and token not in PARTICLES:
        return "particles" if token == "'" and before == "nouns" else "punctuation"
    if token[0].isdigit() or token in NUMERALS:
        return "numerals"
    if token in PARTICLES:
        return "particles"
    if token in CONJUNCTIONS:
        return "conjunctions"
    if token == "that":
        return "articles" if before == "nouns" or _starts_noun(after) else "prepositions"
    if token in ("who", "whom"):
        return "pronouns"
    if token in ("her", "his") or token in DETERMINERS:
        return "articles"
    if token in PRONOUNS:
        return "pronouns"
    if token in PHRASAL and token != "back":
        return _direction(token, before, after)
    if token == "back":
        return "nouns" if before == "articles" or (before == "adjectives" and last != "far") else "adverbs"
    if token in ("left", "right") and (before == "articles" or last in ("to", "its")):
        return "adjectives" if _is_nominal(after) else "nouns"
    if token in ("left", "right"):
        return "adjectives" if _is_nominal(after) else "adverbs"
    if token in ("before", "after", "as", "until", "near", "past", "inside", "outside", "like", "about", "around"):
        return "prepositions" if after and after not in ",." else "adverbs"
    if token in _AMBIGUOUS:
        return _noun_or_verb(token, before, last, after)
    if token in PREPOSITIONS:
        return "prepositions"
    if token in VERBS and token not in ADJECTIVES:
        return _verb_or_adjective(token, before, after)
    return _open_class(token, before, after)


def _direction(token: str, before: str, after: str) -> str:
    """Small words of direction: before a noun they are prepositions, after a verb particles, else adverbs."""
    if token == "away":
        return "adverbs"
    if token in ("off", "over", "down") and (after in DETERMINERS or after in NOUNS):
        return "prepositions"
    if token == "out" and after == "of":
        return "prepositions"
    return "particles" if before == "verbs" else "adverbs"


def _starts_noun(word: str) -> bool:
    return word in NOUNS or word in ADJECTIVES


def _is_nominal(word: str) -> bool:
    """Whether a word can go on what an adjective began."""
    if word in DETERMINERS or word in PREPOSITIONS or word in CONJUNCTIONS or word in PARTICLES or not word:
        return False
    return word in NOUNS or word in ADJECTIVES or word in _AMBIGUOUS or word == "service"


def _noun_or_verb(token: str, before: str, last: str, after: str) -> str:
    """Words such as serve, return, slice: nouns inside of a phrase that a determiner opened, else verbs."""
    if last in ("to", "not", "that", "which", "who") or last in AUXILIARIES:
        return "verbs"
    if before in ("articles", "adjectives", "numerals") or last in ("'s", "'"):
        return "nouns"
    if before == "nouns":
        # `the player serves` is a sentence, `the service box` and `forehand volley` are names.
        if after in DETERMINERS or token in ("hits", "runs", "moves", "stops", "walks", "serves", "turns", "looks"):
            return "verbs"
        if last in ("player", "opponent", "rival", "ball", "he", "she", "it", "partner"):
            return "verbs"
        return "nouns"
    if before == "prepositions":
        clause = last in ("as", "while", "when", "because", "if", "before", "after", "until")
        return "verbs" if clause and after in DETERMINERS else "nouns"
    if before == "verbs" and last not in AUXILIARIES and not token.endswith(("s", "ed", "ing")):
        return "nouns"
    if before == "verbs" and token in NOUNS and token.endswith("s"):
        return "nouns"
    return "verbs"


def _verb_or_adjective(token: str, before: str, after: str) -> str:
    """Participles inside of a noun phrase are adjectives where they end as such, else verbs."""
    if token.endswith("ed") and before in ("articles", "adjectives") and _is_nominal(after):
        return "adjectives"
    if token in ("spinning", "passing", "landing") and before == "articles" and _is_nominal(after):
        return "verbs"
    if before == "articles" and not _is_nominal(after) and token in ("run", "landing"):
        return "nouns"
    return "verbs"


def _open_class(token: str, before: str, after: str) -> str:
    """Words of the open classes, by the lexicon, by what is around them, and by how they end."""
    if token in ADVERBS and token in ADJECTIVES:
        inside = before in ("articles", "adjectives", "prepositions") or after in NOUNS
        return "adjectives" if inside and _is_nominal(after) else "adverbs"
    if token in ADVERBS:
        return "adverbs"
    if token in ADJECTIVES:
        if token in VERBS and not _is_nominal(after) and before in ("nouns", "pronouns", "particles"):
            return "verbs"
        return "adjectives"
    if token in NOUNS:
        return "nouns"
    if token.endswith("ly"):
        return "adverbs"
    if "-" in token:
        return "adjectives" if _is_nominal(after) else "nouns"
    if token.endswith("ing"):
        return "verbs"
    if token.endswith("ed"):
        return "adjectives" if before == "articles" else "verbs"
    if token.endswith("s") and before in ("nouns", "pronouns") and not token.endswith("ss"):
        return "verbs"
    if before == "particles":
        return "verbs"
    if token.endswith(ADJECTIVE_ENDINGS) and not token.endswith(NOUN_ENDINGS):
        return "adjectives"
    return "nouns" if token.isalpha() or token.isalnum() else "others"
