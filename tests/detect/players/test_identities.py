"""Persons are told apart by their looks over changes of ends, or not at all."""

from itertools import product

import numpy as np
import pytest

from pgm_data.detect.players.identities import (
    ClipIdentities,
    ClipLooks,
    IdentityOptions,
    _chain,
    match_identities,
    orientation,
)
from pgm_data.detect.players.looks import NUMBERS
from pgm_data.people import PlayerLooks

LIGHT = np.array([name.endswith(("_L", "_spread")) for name in NUMBERS])
NAMES = ("player0", "player1")


def clip(near: np.ndarray, far: np.ndarray, rng: np.random.Generator, *, frames: int = 40, cut: int = 0) -> ClipLooks:
    """A clip in which every fourth frame was looked at; from frame `cut` on, where above 0, ends are changed."""
    descriptors = np.full((frames, 2, len(NUMBERS)), np.nan)
    seen = np.arange(0, frames, 4)
    changed = (seen >= cut) & (cut > 0)
    both = np.stack([near, far])
    descriptors[seen] = np.where(changed[:, None, None], both[::-1], both)
    descriptors[seen] += rng.normal(0, 4.0, (len(seen), 2, len(NUMBERS)))
    looks = PlayerLooks(names=NAMES, descriptors=descriptors, weight=np.isfinite(descriptors[..., 0]) * 1.0)
    return ClipLooks(clip_id="clip", looks=looks, cut=(np.arange(frames) == cut) & (cut > 0))


def match(seed: int, ways: list[bool], *, apart: float, ends: float = 1.0) -> list[ClipLooks]:
    """Clips of one match: two persons so far apart, light and poses that differ by run, ends that add something."""
    rng = np.random.default_rng(seed)
    persons = rng.normal(0, 1, (2, len(NUMBERS))) * apart * np.where(LIGHT, 15.0, 10.0) + np.where(LIGHT, 50.0, 0.0)
    end = rng.normal(0, ends, (2, len(NUMBERS))) * np.where(LIGHT, 5.0, 3.0)
    clips = []
    for way in ways:
        near, far = persons if way else persons[::-1]
        light = rng.normal(0, 1, len(NUMBERS)) * np.where(LIGHT, 12.0, 2.0)
        own = rng.normal(0, 1, (2, len(NUMBERS))) * np.where(LIGHT, 4.0, 2.0)
        clips.append(clip(near + end[0] + light + own[0], far + end[1] + light + own[1], rng))
    return clips


def near_persons(found: tuple[ClipIdentities, ...]) -> list[str]:
    return [str(each.identity[0, 0])[-1:] for each in found]


WAYS = [True] * 3 + [False] * 6 + [True] * 5


@pytest.mark.parametrize("seed", range(8))
def test_no_person_is_swapped_over_changes_of_ends(seed: int) -> None:
    found = match_identities(match(seed, WAYS, apart=1.0), "m1")
    assert near_persons(found) == ["a" if way else "b" for way in WAYS]
    for each in found:
        assert set(each.identity.ravel()) == {"m1.a", "m1.b"}
        assert (each.identity[:, 0] != each.identity[:, 1]).all()
        assert (each.confidence >= 0.9).all() and (each.confidence <= 1).all()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("ways", [WAYS, [True] * 12, [True, False], [True, True]], ids=len)
def test_two_persons_in_the_same_clothes_are_nobody_rather_than_guessed(seed: int, ways: list[bool]) -> None:
    found = match_identities(match(seed, ways, apart=0.0), "m1")
    assert all((each.identity == "").all() for each in found)
    assert all((each.confidence >= 0.5).all() for each in found)


@pytest.mark.parametrize("seed", range(8))
def test_persons_who_hardly_differ_are_never_swapped(seed: int) -> None:
    for apart in (0.2, 0.4):
        named = near_persons(match_identities(match(seed, WAYS, apart=apart), "m1"))
        told = [(name == "a", way) for name, way in zip(named, WAYS, strict=True) if name]
        assert len({name == way for name, way in told}) <= 1


def test_without_a_change_of_ends_everybody_stays() -> None:
    assert near_persons(match_identities(match(5, [True] * 6, apart=1.6), "m1")) == ["a"] * 6


def test_a_change_of_ends_at_a_cut_inside_a_clip_and_one_clip_alone() -> None:
    rng = np.random.default_rng(1)
    near, far = rng.normal(0, 15, (2, len(NUMBERS)))
    (found,) = match_identities([clip(near, far, rng, cut=17)], "m")
    assert set(found.identity[:17, 0]) == {"m.a"} and set(found.identity[17:, 0]) == {"m.b"}
    same = clip(near, near, rng)
    from_cut = ClipLooks(clip_id="clip", looks=same.looks, cut=np.arange(40) == 0)
    (alone,) = match_identities([from_cut], "m")
    assert set(alone.identity[:, 0]) == {"m.a"} and set(alone.identity[:, 1]) == {"m.b"}


def test_a_run_in_which_nobody_was_seen_is_known_only_as_well_as_its_neighbours_tell() -> None:
    clips = match(3, [True, True, True, False, False], apart=1.0)
    blind = np.full_like(clips[2].looks.descriptors, np.nan)
    unseen = ClipLooks(
        clip_id="clip", cut=clips[2].cut, looks=PlayerLooks(names=NAMES, descriptors=blind, weight=np.zeros((40, 2)))
    )
    found = match_identities([*clips[:2], unseen, *clips[3:]], "m")
    assert near_persons(found) == ["a", "a", "", "b", "b"]
    np.testing.assert_allclose(found[2].confidence, 0.5, atol=1e-6)
    half = clips[2].looks.descriptors.copy()
    half[:, 1] = np.nan
    one = ClipLooks(
        clip_id="clip", cut=clips[2].cut, looks=PlayerLooks(names=NAMES, descriptors=half, weight=np.zeros((40, 2)))
    )
    assert near_persons(match_identities([*clips[:2], one, *clips[3:]], "m"))[2] in ("", "a")


def test_scenes_with_one_player_or_none_and_matches_without_clips() -> None:
    def alone(players: int) -> ClipLooks:
        looks = PlayerLooks(
            names=NAMES[:players],
            descriptors=np.full((4, players, len(NUMBERS)), np.nan),
            weight=np.zeros((4, players)),
        )
        return ClipLooks(clip_id="c", looks=looks, cut=np.zeros(4, bool))

    assert match_identities([], "m") == ()
    assert match_identities([alone(0)], "m")[0].identity.shape == (4, 0)
    (one, two) = match_identities([alone(1)] * 2, "m")
    assert set(one.identity.ravel()) == set(two.identity.ravel()) == {"m.a"}
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="players"):
        match_identities([alone(1), clip(np.zeros(17), np.zeros(17), rng)], "m")


def test_turning_the_first_run_round_turns_every_name_and_nothing_else() -> None:
    rng = np.random.default_rng(7)
    differences = np.where(np.array(WAYS)[:, None], 1.0, -1.0) * 3.0 + rng.normal(0, 1, (len(WAYS), len(NUMBERS)))
    options = IdentityOptions()
    np.testing.assert_allclose(orientation(-differences, options), orientation(differences, options), atol=1e-6)


def test_the_chain_agrees_with_going_through_all_ways() -> None:
    rng = np.random.default_rng(2)
    logs = rng.normal(0, 2, (6, 2))
    change = 0.2
    total, first = 0.0, np.zeros(6)
    for way in product((0, 1), repeat=6):
        turns = np.count_nonzero(np.diff(way))
        chance = 0.5 * change**turns * (1 - change) ** (5 - turns) * np.exp(logs[np.arange(6), list(way)].sum())
        total += chance
        first += chance * (np.array(way) == 0)
    likelihood, same = _chain(logs[:, 0], logs[:, 1], change)
    np.testing.assert_allclose([likelihood, *same], [np.log(total), *(first / total)], rtol=1e-10)


@pytest.mark.parametrize("wrong", [{"light_scatter": 0.0}, {"change_chance": 0.6}, {"least_confidence": 0.2}])
def test_options_out_of_range_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        IdentityOptions(**wrong)
