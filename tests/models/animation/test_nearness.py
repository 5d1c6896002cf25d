"""Offsets between places: what a reader with a tape measure would write down, saturating far off."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_models.animation.nearness import NEAR_M, Nearness, offset_widths, places_of, velocity_of
from tests.models.animation.toy_models import toy_layout, toy_property

COURT = toy_layout()
RATE = 8.0


def spread(layout, seed):
    """The layout with means and spreads of its own."""
    rng = np.random.default_rng(seed)
    properties = [replace(entry, mean=rng.normal(0, 5, 3), std=rng.uniform(0.5, 8, 3)) for entry in layout.properties]
    return replace(layout, properties=tuple(properties))


def told(layout, *metres, valid=None):
    """What two players and a ball are told of each other: (place, other, now, ahead and behind, 3), NaN if untold."""
    state = torch.zeros(1, 1, layout.channels)
    for row, (entry, value) in enumerate(zip(layout.properties, metres, strict=True)):
        state[..., layout.slice_of(row)] = torch.as_tensor((np.asarray(value) - entry.mean) / entry.std).float()
    if valid is None:
        valid = torch.ones(1, 1, len(layout.properties), dtype=torch.bool)
    numbers = Nearness(layout)(state, valid, torch.tensor([RATE]))[0, 0].numpy().reshape(-1, 3)
    assert numbers.size == sum(offset_widths(layout))
    found = np.full((3, 2, 3, 3), np.nan)
    found[0, 0, :1], found[0, 1] = numbers[:1], numbers[1:4]
    found[1, 0, :1], found[1, 1] = numbers[4:5], numbers[5:8]
    found[2] = numbers[8:].reshape(2, 3, 3)
    return found


def saturated(metres):
    offset = np.asarray(metres) / NEAR_M
    return offset / np.sqrt(1 + (offset**2).sum(-1, keepdims=True))


def test_places_are_those_of_players_and_ball():
    assert places_of(COURT) == (0, 1, 2)
    assert [velocity_of(COURT, row) for row in places_of(COURT)] == [None, None, 3]
    assert offset_widths(COURT) == (12, 12, 18, 0)


def test_places_of_which_a_number_is_constant_are_left_out():
    flat = replace(COURT.properties[0], channels=np.array([0, 1]), mean=np.zeros(2), std=np.ones(2))
    layout = replace(COURT, properties=(flat, *COURT.properties[1:]))
    assert places_of(layout) == (1, 2)
    assert offset_widths(layout) == (0, 9, 9, 0)


@pytest.mark.parametrize("seed", range(5))
def test_near_by_they_are_metres(seed):
    rng = np.random.default_rng(seed)
    places = rng.normal(0, 10, 3) + rng.normal(0, 0.02, (3, 3))
    found = told(spread(COURT, seed), *places, np.zeros(3)) * NEAR_M
    for own, others in enumerate([(1, 2), (0, 2), (0, 1)]):
        for told_of, other in zip(found[own], others, strict=True):
            np.testing.assert_allclose(told_of[0], places[other] - places[own], rtol=3e-3, atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_far_off_they_are_directions(seed):
    places = np.random.default_rng(seed).normal(0, 1000, (3, 3))
    found = told(spread(COURT, seed), *places, np.zeros(3))
    away = places[2] - places[0]
    np.testing.assert_allclose(found[0, 1, 0], away / np.linalg.norm(away), atol=1e-3)
    assert (np.linalg.norm(found[np.isfinite(found)].reshape(-1, 3), axis=-1) <= 1 + 1e-6).all()
    np.testing.assert_allclose(found[0, 1], -found[2, 0], atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_ball_that_flies_is_closest_where_a_fine_search_finds_it(seed):
    rng = np.random.default_rng(seed)
    player, speed = rng.normal(0, 3, 3), rng.normal(0, 20, 3)
    ball = player + rng.normal(0, 0.8, 3) - speed * rng.uniform(-0.2, 0.2)
    found = told(spread(COURT, seed), player, np.full(3, 50.0), ball, speed)
    frame = 1 / RATE
    for at, times in ((1, np.linspace(0, frame, 20_001)), (2, np.linspace(-frame, 0, 20_001))):
        path = ball + times[:, None] * speed - player
        closest = path[np.linalg.norm(path, axis=1).argmin()]
        np.testing.assert_allclose(found[0, 1, at], saturated(closest), atol=2e-3)
        np.testing.assert_allclose(found[2, 0, at], -saturated(closest), atol=2e-3)


def test_a_ball_that_rests_is_as_near_ahead_and_behind_as_now():
    found = told(COURT, [0, 0, 0], [5, 5, 0], [1, 0, 0], [0, 0, 0])
    np.testing.assert_allclose(found[2], np.repeat(found[2][:, :1], 3, axis=1), atol=1e-6)


def test_a_place_that_is_not_there_tells_and_is_told_nothing():
    valid = torch.ones(1, 1, 4, dtype=torch.bool)
    valid[..., 2] = False
    found = told(COURT, [0, 0, 0], [1, 1, 1], [np.nan] * 3, [1, 1, 1], valid=valid)
    assert (found[2] == 0).all() and (found[:2, 1] == 0).all()
    assert (found[0, 0, 0] > 0).all()


def test_a_ball_without_a_velocity_is_told_nothing_that_is_not_a_number():
    valid = torch.ones(1, 1, 4, dtype=torch.bool)
    valid[..., 3] = False
    found = told(COURT, [0, 0, 0], [1, 1, 1], [2, 2, 2], [np.nan] * 3, valid=valid)
    assert (found[2] == 0).all()


def test_a_single_place_has_no_offsets():
    layout = toy_layout(players=1, ball=False)
    assert offset_widths(layout) == (0,)
    found = Nearness(layout)(torch.zeros(2, 3, 3), torch.ones(2, 3, 1, dtype=torch.bool), torch.full((2,), RATE))
    assert found.shape == (2, 3, 0)


def test_properties_that_are_no_places_are_left_alone():
    layout = replace(COURT, properties=(toy_property("player0.root_angle", 0, 3), *COURT.properties[1:]))
    assert offset_widths(layout) == (0, 9, 9, 0)
