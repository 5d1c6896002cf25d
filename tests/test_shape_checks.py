"""Wrong shapes and types are refused wherever they pass, by what tests/shape_checks.py puts around functions."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float, TypeCheckError

from tests.shape_checks import checked

Vectors = Float[np.ndarray, "n 3"]


def scaled(vectors: Vectors, by: Float[np.ndarray, " n"], *, power: float = 1.0) -> Vectors:
    return vectors * by[:, None] ** power


def cut(vectors: Vectors) -> tuple[Vectors, Float[np.ndarray, "n-1 3"]]:
    return vectors[:-1], vectors[:-1]


def rows(vectors: Vectors, *, first: int = 0) -> Iterator[Float[np.ndarray, "3"]]:
    yield from vectors[first:]


def forward(vectors: Vectors) -> Float[np.ndarray, "m 3"]:
    return checked(scaled)(vectors[:2], np.ones(2))


def drawn(path: "Path", times: int, on: "Unknown | None" = None) -> "list[int]":
    return [times] * len(path.times) if times else [path]


@dataclass(frozen=True, eq=False, kw_only=True)
class Path:
    places: Vectors
    times: Float[np.ndarray, " n"]
    names: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False, kw_only=True)
class Lap(Path):
    number: int = 0

    def half(self, at: int) -> "Lap":
        return Lap(places=self.places[:at], times=self.times[:at])


checked(Path)
checked(Lap)
FOUR, ONES = np.zeros((4, 3)), np.ones(4)


@pytest.mark.parametrize(
    "call",
    [
        lambda: checked(scaled)(FOUR, ONES, power=2),
        lambda: checked(scaled)(FOUR, by=ONES),
        lambda: checked(forward)(FOUR),
        lambda: list(checked(rows)(FOUR)),
        lambda: list(checked(rows)(vectors=FOUR, first=2)),
        lambda: checked(drawn)(Path(places=FOUR, times=ONES), 2, on="anything"),
        lambda: Path(places=FOUR, times=ONES),
        lambda: Lap(places=FOUR, times=ONES, names=["a"]).half(2),
    ],
)
def test_what_fits_passes(call: Callable[[], Any]) -> None:
    call()


@pytest.mark.parametrize(
    "call",
    [
        pytest.param(lambda: checked(scaled)(FOUR, ONES[:3]), id="two arguments disagree"),
        pytest.param(lambda: checked(scaled)(FOUR.astype(int), ONES), id="integers"),
        pytest.param(lambda: checked(scaled)(FOUR, ONES, power="2"), id="a word"),
        pytest.param(lambda: checked(scaled)(FOUR.tolist(), ONES), id="a list"),
        pytest.param(lambda: checked(cut)(FOUR), id="what is returned"),
        pytest.param(lambda: checked(rows)(FOUR[:, :2]), id="a generator, before its first step"),
        pytest.param(lambda: checked(rows)(FOUR, first="1"), id="a generator's option"),
        pytest.param(lambda: checked(drawn)(FOUR, 2), id="a type named in quotes"),
        pytest.param(lambda: checked(drawn)(Path(places=FOUR, times=ONES), 2.5, on=3), id="beside an unknown type"),
        pytest.param(lambda: checked(drawn)(Path(places=FOUR, times=ONES), 0), id="what is returned, in quotes"),
        pytest.param(lambda: Path(places=FOUR, times=ONES[:3]), id="fields disagree"),
        pytest.param(lambda: Path(places=FOUR, times=ONES, names="ab"), id="a field's type"),
        pytest.param(lambda: Lap(places=FOUR, times=ONES[:3]), id="inherited fields"),
        pytest.param(lambda: Lap(places=FOUR, times=ONES, number="1"), id="an own field"),
    ],
)
def test_what_does_not_fit_is_refused(call: Callable[[], Any]) -> None:
    with pytest.raises(TypeCheckError):
        call()


def test_a_dimension_is_free_again_at_the_next_call() -> None:
    stretched = checked(scaled)
    for n in (4, 2, 7):
        assert stretched(np.ones((n, 3)), np.full(n, 2.0)).shape == (n, 3)
    with pytest.raises(TypeCheckError):
        stretched(FOUR, ONES[:1])
    assert stretched(FOUR[:1], ONES[:1]).shape == (1, 3)


def test_the_hook_writes_the_checker_of_this_file() -> None:
    from pgm_data.geometry.rigid import rotation_from_rotvec

    code: Any = rotation_from_rotvec
    assert code.__wrapped__.__module__ == "pgm_data.geometry.rigid"
    assert code.__code__.co_filename.endswith("shape_checks.py")
