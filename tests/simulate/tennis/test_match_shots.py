"""What simulated players do is spread as what professionals do: against real shots where there are any."""

from collections import Counter
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.tennis.match import draw_match, plays
from pgm_data.simulate.tennis.play import Play
from pgm_data.stages.shot_samples import distance, real_sample, simulated_sample

_POORER = {
    # Each real match has two servers, so that two peaks stand where a hundred bodies of ours spread.
    "serve 1 contact height": (1.4, 0.35),
    "serve 2 contact height": (1.4, 0.35),
    # Serves bounce to higher contacts than in the real matches, whose balls and ground are not ours.
    "return contact height": (0.6, 0.55),
}
"""Largest Wasserstein distance and least overlap of quantities that fit less well than the others."""
_LIMITS = (0.6, 0.65)


@pytest.fixture(scope="module")
def played() -> list[Play]:
    out: list[Play] = []
    for seed in range(6):
        match = draw_match(np.random.default_rng([seed, 77]), load_scene("tennis"), name="m", surface="hard")
        out += islice(plays(match, np.random.default_rng([seed, 78])), 45)
    return out


def test_outcomes_come_about_as_often_as_in_real_matches(played: list[Play]) -> None:
    came = Counter(play.outcome for play in played)
    first = [play for play in played if play.serve_number == 1 and play.outcome != "let"]
    second = [play for play in played if play.serve_number == 2 and play.outcome != "let"]
    points = len(played) - came["fault"] - came["let"]
    assert 0.52 < 1.0 - came["fault"] / len(first) < 0.76
    assert came["double_fault"] / len(second) < 0.25
    assert 0.01 < came["ace"] / points < 0.16
    assert 0.18 < came["winner"] / points < 0.5
    assert 0.35 < (came["forced_error"] + came["unforced_error"]) / points < 0.75
    assert 3.0 < np.mean([len(play.shots) for play in played if play.outcome not in ("fault", "let")]) < 7.5
    kinds = Counter(stroke.kind for play in played for stroke in play.strokes)
    assert set(kinds) >= {"serve", "drive", "slice", "volley", "smash", "lob", "drop"}
    errors = Counter(play.shots[-1].result for play in played if play.outcome.endswith("forced_error"))
    assert set(errors) == {"net", "out"} and min(errors.values()) > 0.12 * sum(errors.values())


def test_shots_are_spread_as_in_real_matches(played: list[Play], real_data: Path) -> None:
    real, simulated = real_sample(real_data / "ball"), simulated_sample(played)
    assert list(real) == list(simulated)
    apart = {name: distance(simulated[name], real[name]) for name in real}
    told = "\n".join(f"{name}: {moved:.2f} sd, overlap {same:.2f}" for name, (moved, same) in apart.items())
    for name, (moved, same) in apart.items():
        farthest, least = _POORER.get(name, _LIMITS)
        assert moved <= farthest and same >= least, f"{name}\n{told}"
    assert np.median([same for _, same in apart.values()]) > 0.8, told


@given(shift=st.floats(-3.0, 3.0), seed=st.integers(0, 1000))
def test_distances_of_equal_samples_are_none_and_grow_with_a_shift(shift: float, seed: int) -> None:
    sample = np.random.default_rng(seed).normal(size=400)
    assert distance(sample, sample) == pytest.approx((0.0, 1.0))
    moved, same = distance(sample + shift, sample)
    assert moved == pytest.approx(abs(shift) / sample.std(), rel=1e-6, abs=1e-9)
    assert same <= 1.0 + 1e-12
    if abs(shift) > 2.5:
        assert same < 0.45
