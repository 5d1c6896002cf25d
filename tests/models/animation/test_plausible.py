"""Of several samples the one is kept whose ball turns at players, ground and net, whatever else is asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pgm_data.scene import load_scene
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.layout import Layout
from pgm_models.animation.plausible import best_of, implausibility
from pgm_models.animation.sample import SampleOptions, filler
from pgm_models.animation.store import open_store
from pgm_models.animation.window_source import all_windows
from pgm_models.animation.windows import Windows
from tests.models.animation.toy_models import toy_layout, toy_model, toy_windows

TENNIS = load_scene("tennis")


@pytest.fixture(scope="module")
def layout(tennis_dataset: Path) -> Layout:
    return fit_layout(tennis_dataset)


@pytest.fixture(scope="module")
def windows(tennis_dataset: Path, layout: Layout, tmp_path_factory: pytest.TempPathFactory) -> Windows:
    store = open_store(tennis_dataset, layout, tmp_path_factory.mktemp("store"))
    return next(iter(all_windows(store, 16, 12.5, 8)))


def turned(windows: Windows, layout: Layout, rows: list[int]) -> torch.Tensor:
    """Those windows with a ball that is on the court's other side for a while."""
    state = windows.state.clone()
    columns = [entry.column for entry in layout.properties]
    for name in ("ball.position", "ball.velocity"):
        row = columns.index(name)
        own, entry = layout.slice_of(row), layout.properties[row]
        values = state[rows][..., own] * torch.tensor(entry.std) + torch.tensor(entry.mean)
        values[:, 5:9, :2] *= -1
        state[torch.tensor(rows)[:, None], :, torch.arange(own.start, own.stop)] = (
            ((values - torch.tensor(entry.mean)) / torch.tensor(entry.std)).to(state).transpose(1, 2)
        )
    return state


def nothing_known(windows: Windows) -> torch.Tensor:
    return torch.zeros_like(windows.valid)


def test_real_play_is_more_plausible_than_a_ball_that_jumps(windows, layout):
    given = torch.zeros(*windows.valid.shape[:2], 2, dtype=torch.bool)
    real = implausibility(windows.state, windows, given, layout, TENNIS)
    every = list(range(len(real)))
    jumps = implausibility(turned(windows, layout, every), windows, given, layout, TENNIS)
    assert (real < 1).mean() >= 0.8 and (jumps >= 1).all() and (jumps > real).all()


def test_each_window_keeps_its_most_plausible_sample(windows, layout):
    count = len(windows.names)
    bad = [list(range(0, count, 2)), list(range(1, count, 2)), list(range(count))]
    asked = []

    def fill(windows, known, text_known, generator):
        asked.append(known)
        return turned(windows, layout, bad[len(asked) - 1])

    chosen = best_of(fill, 3, layout, TENNIS)
    known = nothing_known(windows)
    found = chosen(windows, known, known[..., :2], torch.Generator())
    assert len(asked) == 3 and all(one is known for one in asked)
    assert torch.equal(found, windows.state)


def test_windows_between_keyframes_are_filled_in_once(windows, layout):
    calls = []

    def fill(windows, known, text_known, generator):
        calls.append(known)
        return turned(windows, layout, [0])

    known = nothing_known(windows)
    known[:, ::3] = True
    found = best_of(fill, 3, layout, TENNIS)(windows, known, known[..., :2], torch.Generator())
    assert len(calls) == 1 and torch.equal(found, turned(windows, layout, [0]))


def test_what_is_known_stays_and_the_seed_decides(tennis_dataset, windows, layout):
    model = toy_model(layout)
    known = nothing_known(windows)
    known[:, 0] = True
    told = torch.zeros_like(windows.text, dtype=torch.bool)
    nothing = torch.zeros(0, 1, model.options.encoder_width)
    mask = torch.zeros(0, 1, dtype=torch.bool)
    silent = replace(windows, text=torch.full_like(windows.text, -1), tokens=nothing, token_mask=mask)

    def made(seed, tries):
        fill = filler(model, SampleOptions(steps=1, tries=tries))
        return fill(silent, known, told, torch.Generator().manual_seed(seed))

    one, same, other = made(0, 2), made(0, 2), made(1, 2)
    assert torch.equal(one, same) and not torch.equal(one, other)
    assert torch.equal(one[:, 0], windows.state[:, 0])
    given = known[..., :2]
    first, best = (implausibility(state, windows, given, layout, TENNIS) for state in (made(0, 1), one))
    assert (best <= first).all() and (best < first).any()


def test_without_a_ball_there_is_nothing_to_judge_by():
    layout = toy_layout(players=1)
    with pytest.raises(ValueError, match="tries: expected 1 in"):
        filler(toy_model(layout), SampleOptions(tries=2), load_scene("blocks"))
    with pytest.raises(ValueError, match="tries: expected 1 or more, got 0"):
        SampleOptions(tries=0)
    fill = filler(toy_model(layout), SampleOptions(steps=1))
    windows = toy_windows(layout)
    state = fill(windows, nothing_known(windows), torch.ones(windows.text.shape, dtype=torch.bool), torch.Generator())
    assert np.isfinite(state.numpy()).all()
