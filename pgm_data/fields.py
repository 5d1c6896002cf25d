"""Fields of a hand-written file: each is what it must be, or an error says which is not."""

import math
from collections.abc import Sequence
from typing import Any


class FieldError(ValueError):
    """A field is not what it must be: field, expected, got."""


def fields(raw: object, place: str, required: Sequence[str] = (), optional: Sequence[str] = ()) -> dict[str, Any]:
    """The mapping itself, with all required fields and, where any are named, no others than these."""
    here = place or "file"
    if not isinstance(raw, dict) or not all(isinstance(name, str) for name in raw):
        raise FieldError(f"{here}: expected named fields, got {_shown(raw)}")
    for name in required:
        if name not in raw:
            raise FieldError(f"{_joined(place, name)}: expected the field, got none")
    if required or optional:
        for name in raw:
            if name not in required and name not in optional:
                raise FieldError(
                    f"{_joined(place, name)}: expected one of {', '.join((*required, *optional))}, got {name}"
                )
    return raw


def number(raw: object, place: str, above: float = -math.inf) -> float:
    """A finite number above the bound."""
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not math.isfinite(raw) or not raw > above:
        bound = f" above {above:g}" if above > -math.inf else ""
        raise FieldError(f"{place}: expected a finite number{bound}, got {_shown(raw)}")
    return float(raw)


def count(raw: object, place: str) -> int:
    """An integer of at least one."""
    if isinstance(raw, bool) or not isinstance(raw, int) or raw < 1:
        raise FieldError(f"{place}: expected a whole number of at least 1, got {_shown(raw)}")
    return raw


def sequence(raw: object, place: str) -> list:
    """A list of anything."""
    if not isinstance(raw, list):
        raise FieldError(f"{place}: expected a list, got {_shown(raw)}")
    return raw


def numbers(raw: object, place: str, length: int) -> tuple[float, ...]:
    """So many finite numbers."""
    values = sequence(raw, place)
    if len(values) != length:
        raise FieldError(f"{place}: expected {length} numbers, got {_shown(raw)}")
    return tuple(number(value, place) for value in values)


def word(raw: object, place: str, allowed: Sequence[str] = ()) -> Any:
    """A text, one of those allowed where any are named."""
    if not isinstance(raw, str) or (allowed and raw not in allowed):
        raise FieldError(
            f"{place}: expected {'one of ' + ', '.join(allowed) if allowed else 'a text'}, got {_shown(raw)}"
        )
    return raw


def names_of(raw: object, place: str, known: Sequence[str]) -> list[str]:
    """A list of names that are known."""
    names = sequence(raw, place)
    for name in names:
        if name not in known:
            raise FieldError(f"{place}: expected names among {', '.join(known)}, got {_shown(name)}")
    return names


def _joined(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


def _shown(raw: object) -> str:
    text = repr(raw)
    return text if len(text) <= 80 else text[:77] + "..."
