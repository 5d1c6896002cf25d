import math

import pytest
import torch
from scipy.stats import binom, chisquare
from torch import Generator, Tensor

from pgm_models.animation.masks import (
    MASKS,
    draw_masks,
    drop_text,
    few_elements,
    half_elements,
    inside_block,
    last_frames,
    outside_block,
    some_properties,
)

BATCH, FRAMES, OBJECTS, ACTIONS = 4000, 9, (0, 0, 0, 1, 1, 1, -1, -1), 2
FRAMEWISE = (inside_block, outside_block, last_frames)


def seeded(seed: int = 0) -> Generator:
    return Generator().manual_seed(seed)


def likely(share: float, hits: int, trials: int) -> bool:
    """Whether that many hits are within what 1 in a million draws exceeds."""
    low, high = binom.interval(1 - 1e-6, trials, share)
    return low <= hits <= high


def framewise(strategy) -> Tensor:
    """(B, T) known of a strategy that treats all elements of a frame alike; asserts that it does."""
    known, text = strategy(BATCH, FRAMES, OBJECTS, ACTIONS, seeded())
    assert torch.equal(known, known[..., :1].expand_as(known))
    assert torch.equal(text, known[..., :1].expand_as(text))
    return known[..., 0]


@pytest.mark.parametrize(("strategy", "share"), [(few_elements, 0.25), (half_elements, 0.5)])
def test_random_elements_are_unknown_with_their_probability_and_apart(strategy, share):
    known, text = strategy(BATCH, FRAMES, OBJECTS, ACTIONS, seeded())
    unknown = ~torch.cat([known, text], dim=-1)
    assert all(likely(share, hits, BATCH) for hits in unknown.sum(0).flatten().tolist())
    flat = unknown.flatten(1).double()
    flat = flat - flat.mean(0)
    correlation = (flat.T @ flat) / BATCH / (share * (1 - share))
    apart = correlation - correlation.diag().diag()
    assert apart.abs().max() < 6 / math.sqrt(BATCH)


def test_a_block_is_consecutive_and_every_length_and_place_comes():
    unknown = ~framewise(inside_block)
    edges = torch.nn.functional.pad(unknown.int(), (1, 1)).diff(dim=1).abs().sum(1)
    assert (edges == 2).all()
    length = unknown.sum(1)
    assert chisquare(torch.bincount(length, minlength=FRAMES + 1)[1:].numpy()).pvalue > 1e-4
    start = unknown.int().argmax(1)[length == 4]
    assert chisquare(torch.bincount(start, minlength=FRAMES - 3).numpy()).pvalue > 1e-4


def test_outside_a_block_is_the_complement_of_blocks_that_leave_something_unknown():
    known = framewise(outside_block)
    edges = torch.nn.functional.pad(known.int(), (1, 1)).diff(dim=1).abs().sum(1)
    assert (edges == 2).all()
    assert chisquare(torch.bincount(known.sum(1), minlength=FRAMES)[1:].numpy()).pvalue > 1e-4
    blocks = {tuple(row) for row in (~framewise(inside_block)).int().tolist()}
    assert {tuple(row) for row in known.int().tolist()} == blocks - {(1,) * FRAMES}


def test_last_frames_are_unknown_from_any_frame_but_the_first_to_the_end():
    known = framewise(last_frames)
    assert known[:, 0].all() and not known[:, -1].any()
    assert (known.int().diff(dim=1) <= 0).all()
    assert chisquare(torch.bincount(known.sum(1), minlength=FRAMES)[1:].numpy()).pvalue > 1e-4


def test_unknown_properties_are_so_in_all_frames_and_never_none():
    known, text = some_properties(BATCH, FRAMES, OBJECTS, ACTIONS, seeded())
    assert torch.equal(known, known[:, :1].expand_as(known))
    assert torch.equal(text, text[:, :1].expand_as(text))
    assert (~known[:, 0]).any(1).all()


def is_whole(known: Tensor, text: Tensor) -> Tensor:
    """(B,) whether what is unknown is whole objects with their actions."""
    owner = torch.tensor(OBJECTS)
    same = torch.ones(len(known), dtype=torch.bool)
    for player in sorted(set(OBJECTS)):
        mine = known[:, 0, owner == player]
        same &= (mine == mine[:, :1]).all(1)
        if player >= 0:
            same &= text[:, 0, player] == mine[:, 0]
    return same


def test_half_of_the_unknown_sets_are_whole_objects():
    known, text = some_properties(BATCH, FRAMES, OBJECTS, ACTIONS, seeded())
    whole = is_whole(known, text)
    # Single properties look like whole objects where all eight are unknown (1 in 8), or the ball's two alone (1 in 28
    # of the sets of two), or three or more that happen to be a player's: rarer still.
    assert 0.5 < whole.double().mean() < 0.5 + 0.5 * (1 / 8 + 6 / 28)
    count = (~known[:, 0]).sum(1)
    assert ((~whole) & (count == 1)).sum() > BATCH / 2 / 8 * 0.7
    opponents = [(known[:, 0] == torch.tensor([owner != player for owner in OBJECTS])).all(1) for player in (0, 1, -1)]
    assert all(alone.sum() > BATCH / 2 / 9 * 0.7 for alone in opponents)
    everything = (~known[:, 0]).all(1)
    assert likely(0.5 / 3 + 0.5 / 8, int(everything.sum()), BATCH)


def test_single_properties_are_a_set_of_any_size_and_each_as_often():
    known, _ = some_properties(BATCH, 1, (0, 0, 0, 0), 0, seeded())
    unknown = ~known[:, 0]
    # One object: half of the windows know nothing; of the others all four sizes come as often.
    sizes = torch.bincount(unknown.sum(1), minlength=5).tolist()
    assert sizes[0] == 0
    assert all(likely(1 / 8, size, BATCH) for size in sizes[1:4])
    assert likely(5 / 8, sizes[4], BATCH)
    assert all(likely(0.5 + 0.5 * 2.5 / 4, hits, BATCH) for hits in unknown.sum(0).tolist())


def test_actions_of_single_property_sets_are_none_to_all():
    known, text = some_properties(BATCH, FRAMES, OBJECTS, ACTIONS, seeded())
    single = ~is_whole(known, text)
    count = torch.bincount((~text[single, 0]).sum(1), minlength=3)
    assert (count / count.sum() > 0.2).all()
    many = (~known[single, 0]).sum(1) >= 7
    assert not text[single, 0][many].any()


def test_an_action_of_a_player_without_properties_is_never_hidden_with_an_object():
    known, text = some_properties(BATCH, 2, (0, -1), 2, seeded())
    lone = (~known[:, 0]).sum(1) == 1
    assert text[lone & ~text[:, 0, 0], 0, 1].any()
    assert known.shape == (BATCH, 2, 2) and text.shape == (BATCH, 2, 2)


@pytest.mark.parametrize("group", MASKS)
def test_a_mixture_takes_each_of_its_strategies_as_often(group):
    strategies = MASKS[group]
    known, text = draw_masks(BATCH, FRAMES, OBJECTS, ACTIONS, seeded(), group=group)
    framed = (known == known[..., :1]).all(-1).all(-1)
    constant = (known == known[:, :1]).all(1).all(1)
    random = ~framed & ~constant
    assert likely(2 / len(strategies), int(random.sum()), BATCH)
    blocks = sum(strategy in FRAMEWISE for strategy in strategies)
    everything = 1 / FRAMES / len(strategies) if inside_block in strategies else 0
    whole = (0.5 / 3 + 0.5 / 8) / len(strategies) if some_properties in strategies else 0
    assert likely(blocks / len(strategies) - everything, int((framed & ~constant).sum()), BATCH)
    assert likely(everything + whole, int((~known).flatten(1).all(1).sum()), BATCH)
    assert (~known).flatten(1).any(1).all()
    given = text.flatten(1).all(1)
    assert given.double().mean() > 0.5 - 6 * 0.5 / math.sqrt(BATCH)
    of_random = given[random]
    assert likely(0.5 + 0.25 * 0.75 ** (FRAMES * ACTIONS), int(of_random.sum()), len(of_random))


def test_groups_are_those_of_the_papers_ablation():
    names = {group: {strategy.__name__ for strategy in strategies} for group, strategies in MASKS.items()}
    random = {"few_elements", "half_elements"}
    assert names == {
        "random": random,
        "random+block": random | {"inside_block", "outside_block"},
        "random+last": random | {"last_frames"},
        "random+opponent": random | {"some_properties"},
        "all": random | {"inside_block", "outside_block", "last_frames", "some_properties"},
    }


@pytest.mark.parametrize("group", MASKS)
def test_masks_come_from_the_generator_alone(group):
    first, again, other = (draw_masks(16, 8, OBJECTS, 2, seeded(seed), group=group) for seed in (5, 5, 6))
    assert torch.equal(first[0], again[0]) and torch.equal(first[1], again[1])
    assert not torch.equal(first[0], other[0])


@pytest.mark.parametrize("frames", [1, 2, 64])
@pytest.mark.parametrize("objects", [(0,), (-1,), (2, 1, 0, -1)])
@pytest.mark.parametrize("actions", [0, 1, 3])
def test_small_and_large_windows_have_masks(frames, objects, actions):
    for group in MASKS:
        known, text = draw_masks(200, frames, objects, actions, seeded(), group=group)
        assert known.shape == (200, frames, len(objects)) and known.dtype == torch.bool
        assert text.shape == (200, frames, actions) and text.dtype == torch.bool
    for strategy in (*FRAMEWISE, some_properties):
        known, _ = strategy(200, frames, objects, actions, seeded())
        assert (~known).flatten(1).any(1).all()


def test_of_a_single_frame_the_framewise_strategies_know_nothing():
    for strategy in FRAMEWISE:
        assert not strategy(50, 1, OBJECTS, ACTIONS, seeded())[0].any()


def test_impossible_masks_are_refused():
    with pytest.raises(ValueError, match="group: expected one of all, .* got 'last'"):
        draw_masks(4, 8, OBJECTS, 2, seeded(), group="last")
    with pytest.raises(ValueError, match="expected a property and a frame"):
        draw_masks(4, 8, (), 2, seeded())
    with pytest.raises(ValueError, match="expected a property and a frame"):
        draw_masks(4, 0, OBJECTS, 2, seeded())


def test_dropped_text_is_of_whole_windows():
    text = torch.rand(BATCH, 4, 2, generator=seeded(1)) < 0.9
    kept = drop_text(text, 0.1, seeded())
    gone = ~kept.flatten(1).any(1) & text.flatten(1).any(1)
    assert torch.equal(kept[~gone], text[~gone])
    assert likely(0.1, int(gone.sum()), BATCH)
    assert torch.equal(drop_text(text, 0.0, seeded()), text)
    assert not drop_text(text, 1.0, seeded()).any()
    assert drop_text(text[..., :0], 0.1, seeded()).shape == (BATCH, 4, 0)
