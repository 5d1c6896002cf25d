"""A small grammar: sentences from symbols, their verbs inflected and their articles set.

One symbol a line, `name = option | option`; a line that begins with `|` goes on; an option may be empty. An option may
begin with its weight (`3*`). `{name}` is a slot of the caption or another symbol, in the form that is asked for, which
`{name:ing}` changes. Verbs are written `<run>` and take the form: `s` (she runs), `ing` (running), `to` (run). `a(n)`
becomes one of both.
"""

import random
import re
from collections.abc import Mapping
from functools import cache

PIECE = re.compile(r"\{(\w+)(?::(s|ing|to))?\}|<([^>]+)>")
ARTICLE = re.compile(r"\ba\(n\) (\w+)")
DOUBLES = frozenset("hit stop run get set split chip drop jog net step sidestep".split())
"""Verbs that double their last letter before -ing."""

Grammar = dict[str, tuple[tuple[float, str], ...]]


def grammar_of(text: str) -> Grammar:
    """The symbols of a text, each with its options and their weights.

    Raises:
        ValueError: If a line states no symbol, or a symbol is stated twice.
    """
    grammar: Grammar = {}
    for line in re.sub(r"\n\s*\|", " |", text).splitlines():
        if not line.strip():
            continue
        name, equals, options = (part.strip() for part in line.partition("="))
        if not equals or name in grammar:
            raise ValueError(f"grammar: expected a new symbol, an equals sign and options, got {line.strip()[:60]!r}")
        grammar[name] = tuple(_weighted(option.strip()) for option in options.split("|"))
    return grammar


def _weighted(option: str) -> tuple[float, str]:
    match = re.match(r"(\d+)\*\s*", option)
    return (float(match[1]), option[match.end() :]) if match else (1.0, option)


@cache
def inflected(verb: str, form: str) -> str:
    """The verb in a form; of several words the first is the verb."""
    head, space, rest = verb.partition(" ")
    if form == "s":
        if head in ("be", "have"):
            head = {"be": "is", "have": "has"}[head]
        elif head.endswith(("s", "sh", "ch", "x", "z", "go", "do")):
            head += "es"
        elif head.endswith("y") and head[-2] not in "aeiou":
            head = head[:-1] + "ies"
        else:
            head += "s"
    elif form == "ing":
        if head in DOUBLES:
            head += head[-1] + "ing"
        elif head.endswith("e") and not head.endswith(("ee", "be")):
            head = head[:-1] + "ing"
        else:
            head += "ing"
    return head + space + rest


def expanded(symbol: str, form: str, slots: Mapping[str, str], grammar: Grammar, draw: random.Random) -> str:
    """A text of the symbol, options drawn by their weights.

    Raises:
        KeyError: If neither slots nor grammar have a symbol.
    """
    if symbol in slots:
        text = slots[symbol]
    else:
        options = grammar[symbol]
        text = options[0][1]
        if len(options) > 1:
            (text,) = draw.choices([option for _, option in options], weights=[weight for weight, _ in options])

    def put(match: re.Match[str]) -> str:
        name, own, verb = match.groups()
        if verb:
            return PIECE.sub(put, inflected(verb, form))
        return expanded(name, own or form, slots, grammar, draw)

    return PIECE.sub(put, text)


def sentence(symbol: str, slots: Mapping[str, str], grammar: Grammar, draw: random.Random) -> str:
    """A sentence of the symbol: single blanks, none before commas, articles set."""
    text = " ".join(expanded(symbol, "s", slots, grammar, draw).split()).replace(" ,", ",")
    return ARTICLE.sub(lambda match: f"{'an' if _vowel(match[1]) else 'a'} {match[1]}", text)


def _vowel(word: str) -> bool:
    """Whether a word sounds like a vowel first."""
    return word[0] in "aeiou" and not word.startswith("one")
