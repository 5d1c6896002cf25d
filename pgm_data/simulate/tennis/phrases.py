"""Sentences drawn from a small generative grammar, their verbs inflected and their articles set.

One symbol a line, its options separated by `|`; a line that starts with one goes on. An option may carry a weight
(`3*`, otherwise 1) and may be empty. `{name}` stands for a slot of the caption or another symbol; `{name+s}`,
`{name+ing}`, `{name+inf}` also inflect the verbs in it, which are written `[verb]`. `A` becomes "a" or "an".
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

_DOUBLED = frozenset(
    "hit stop get run step set sidestep split-step side-step drop chip jog net put begin cut trot win".split()
)  # verbs whose last letter doubles before -ing


class Draw:
    """Numbers from 0 to 1 by lot, drawn in blocks since one at a time is slow."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._numbers: Iterator[float] = iter(())

    def __call__(self) -> float:
        """The next number."""
        for number in self._numbers:
            return number
        self._numbers = iter(self._rng.random(256).tolist())
        return next(self._numbers)


def inflect(verb: str, form: str) -> str:
    """The verb's third person (`s`), -ing form (`ing`) or bare form (`inf`); of several words the last one's."""
    if form == "inf":
        return verb
    if form == "s":
        if verb in ("be", "have"):
            return "is" if verb == "be" else "has"
        if verb.endswith(("s", "sh", "ch", "x", "go", "do")):
            return verb + "es"
        return verb[:-1] + "ies" if verb.endswith("y") and verb[-2] not in "aeiou" else verb + "s"
    if verb in _DOUBLED:
        return verb + verb[-1] + "ing"
    return verb[:-1] + "ing" if verb.endswith("e") and not verb.endswith(("ee", "be")) else verb + "ing"


@dataclass(frozen=True, eq=False, kw_only=True)
class _Option:
    up_to: float
    """Share of the symbol's weight that this option and those before it have."""
    text: str


Grammar = Mapping[str, tuple[_Option, ...]]
_REFERENCE = re.compile(r"\{(\w+)(?:\+(\w+))?\}")
_VERB = re.compile(r"\[([^\]]+)\]")
_WEIGHT = re.compile(r"^(\d+)\*\s*")
_ARTICLE = re.compile(r"\bA (?=(\w+))")


def parse_grammar(text: str) -> Grammar:
    """The symbols and weighted options that a text states.

    Raises:
        ValueError: If a symbol is stated twice or an option refers to its own symbol.
    """
    grammar: dict[str, tuple[_Option, ...]] = {}
    for line in filter(None, (line.strip() for line in re.sub(r"\n\s*\|", " |", text).splitlines())):
        name, options = (part.strip() for part in line.split(":", 1))
        if name in grammar or f"{{{name}}}" in options:
            raise ValueError(f"grammar: expected one line a symbol, none that names itself, got {name}")
        parts = [option.strip() for option in options.split("|")]
        weights = [float(match.group(1)) if (match := _WEIGHT.match(part)) else 1.0 for part in parts]
        shares = (np.cumsum(weights) / sum(weights)).tolist()
        grammar[name] = tuple(
            _Option(up_to=share, text=_WEIGHT.sub("", part)) for share, part in zip(shares, parts, strict=True)
        )
    return grammar


@cache
def _pieces(text: str) -> tuple[tuple[str, str, str], ...]:
    """Literal text, symbol and form, in turn; the last symbol is empty."""
    pieces, at = [], 0
    for match in _REFERENCE.finditer(text):
        pieces.append((text[at : match.start()], match.group(1), match.group(2) or ""))
        at = match.end()
    return (*pieces, (text[at:], "", ""))


def expand(text: str, slots: Mapping[str, str], grammar: Grammar, draw: Draw) -> str:
    """The text with every reference replaced, by the slot of that name or an option of that symbol.

    Raises:
        KeyError: If neither has the name.
    """
    out: list[str] = []
    for literal, name, form in _pieces(text):
        out.append(literal)
        if not name:
            continue
        inner = slots.get(name)
        if inner is None:
            share = draw()
            inner = next((o.text for o in grammar[name] if share < o.up_to), grammar[name][-1].text)
        said = expand(inner, slots, grammar, draw) if "{" in inner else inner
        out.append(_VERB.sub(lambda verb, form=form: inflect(verb.group(1), form), said) if form else said)
    return "".join(out)


def sentence(text: str, slots: Mapping[str, str], grammar: Grammar, draw: Draw) -> str:
    """The text expanded, spaced and with its articles.

    Raises:
        ValueError: If a verb is left without a form.
    """
    said = expand(text, slots, grammar, draw)
    if "[" in said:
        raise ValueError(f"grammar: expected a form for every verb, got {said!r}")
    said = " ".join(said.split())
    said = _ARTICLE.sub(lambda match: "an " if _vowel(match.group(1)) else "a ", said)
    return said.replace(" ,", ",")


def _vowel(word: str) -> bool:
    return word[0] in "aeiou" and not word.startswith(("one", "uni"))
