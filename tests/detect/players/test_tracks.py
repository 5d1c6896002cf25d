"""Players followed through candidates: known paths with noise, gaps, passers-by, officials and cuts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.detect.players.candidates import PersonCandidates
from pgm_data.detect.players.finder import find_players
from pgm_data.detect.players.ground_map import standing_height
from pgm_data.detect.players.merged import merge_people, no_people
from pgm_data.detect.players.tracks import FollowOptions, best_path, follow_players, share_of_time_there
from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from tests.detect.players.filmed_people import SIZE, camera_of, clip_of, overlap

TENNIS = load_scene("tennis")
ROWS = 100


def still_clip(rows: int = ROWS, **options):
    return clip_of(camera_of(np.zeros(rows), np.full(rows, 620.0), np.zeros(rows)), **options)


CAMERA = camera_of(np.zeros(1), np.full(1, 620.0), np.zeros(1))[0]


def people_at(feet: np.ndarray, *, person: float = 0.9, player: float = np.nan, seed: int = 0) -> PersonCandidates:
    """One person in each frame, boxes with 3 % of noise; nobody where NaN."""
    frame = np.flatnonzero(np.isfinite(feet).all(axis=1))
    ground = feet[frame]
    pixels = project(CAMERA, np.concatenate([ground, np.zeros((len(ground), 1))], axis=1))[0]
    tall = standing_height(CAMERA, ground, TENNIS)
    boxes = np.stack([pixels[:, 0] - 0.2 * tall, pixels[:, 1] - tall, pixels[:, 0] + 0.2 * tall, pixels[:, 1]], axis=1)
    boxes = boxes + np.random.default_rng(seed).normal(0, 0.03, boxes.shape) * tall[:, None]
    count = len(frame)
    return PersonCandidates(
        frame=frame,
        boxes_px=boxes,
        ground_world=ground,
        person=np.full(count, person),
        player=np.full(count, player),
    )


def together(*groups: PersonCandidates) -> PersonCandidates:
    return PersonCandidates(
        **{
            name: np.concatenate([getattr(group, name) for group in groups])
            for name in ("frame", "boxes_px", "ground_world", "person", "player")
        }
    )


def swing(middle: tuple[float, float], reach: float, rows: int = ROWS) -> np.ndarray:
    """Feet that go to and fro across the court at up to 5 m/s."""
    time = np.arange(rows) / 25
    return np.stack([middle[0] + reach * np.sin(5 / max(reach, 1e-9) * time), np.full(rows, middle[1])], axis=1)


NEAR, FAR = swing((0.0, -12.5), 3.0), swing((0.5, 12.5), 2.5)


def follow(people: PersonCandidates, clip=None, scene=TENNIS):
    return follow_players(people, still_clip() if clip is None else clip, size=SIZE, scene=scene)


def test_both_players_are_followed_and_their_boxes_are_smoother_than_the_candidates():
    near, far = people_at(NEAR, seed=1), people_at(FAR, seed=2)
    boxes = follow(together(near, far))
    assert (boxes.status == "measured").all()
    assert (boxes.score > 0.8).all()
    for column, (group, feet) in enumerate(((near, NEAR), (far, FAR))):
        clean = people_at(feet).boxes_px  # The same boxes with other noise have the same mean.
        assert overlap(boxes.boxes_px[:, column], group.boxes_px).min() > 0.7
        assert np.linalg.norm(boxes.ground_world[:, column] - feet, axis=1).max() < 0.35
        tall = clean[:, 3] - clean[:, 1]
        jitter = [np.abs(np.diff(b[:, 1::2], 2, axis=0)).mean() for b in (boxes.boxes_px[:, column], group.boxes_px)]
        assert jitter[0] < 0.3 * jitter[1]
        assert jitter[0] < 0.03 * tall.mean()


def test_a_ball_kid_who_runs_past_is_not_taken_for_the_player():
    kid = np.full((ROWS, 2), np.nan)
    kid[30:75] = np.stack([np.linspace(-6, 6, 45), np.full(45, 13.0)], axis=1)
    boxes = follow(together(people_at(NEAR), people_at(FAR), people_at(kid, person=0.95)))
    assert np.linalg.norm(boxes.ground_world[:, 1] - FAR, axis=1).max() < 1.0


@pytest.mark.parametrize("place", [(-8.5, -18.5), (7.2, 0.3), (-7.0, 0.5), (8.8, 18.0), (9.5, 9.0)])
def test_officials_and_ball_kids_who_stand_outside_are_nobody(place):
    official = people_at(np.tile(place, (ROWS, 1)), person=0.97)
    assert (follow(official).status == "none").all()
    boxes = follow(together(people_at(NEAR), people_at(FAR), official))
    assert np.nanmax(np.abs(boxes.ground_world - np.stack([NEAR, FAR], axis=1))) < 1.0


def test_what_a_detector_says_of_who_plays_decides_between_two_at_one_place():
    other = NEAR[::-1] + [0.0, 1.0]
    boxes = follow(together(people_at(NEAR, player=0.9), people_at(other, player=0.1)))
    assert np.linalg.norm(boxes.ground_world[:, 0] - NEAR, axis=1).max() < 1.0


def test_short_gaps_are_bridged_and_long_ones_are_not():
    near, far = NEAR.copy(), FAR.copy()
    near[20:40], far[30:70] = np.nan, np.nan
    boxes = follow(together(people_at(near), people_at(far)))
    assert (boxes.status[20:40, 0] == "filled").all()
    assert (boxes.status[np.r_[0:20, 40:ROWS], 0] == "measured").all()
    assert (boxes.status[30:70, 1] == "none").all()
    assert np.isnan(boxes.boxes_px[30:70, 1]).all()
    assert (boxes.status[np.r_[0:30, 70:ROWS], 1] == "measured").all()
    assert boxes.score[20:40, 0].max() < boxes.score[:20, 0].min()


def test_a_cut_inside_the_clip_costs_nothing_but_itself():
    near = NEAR.copy()
    near[50:] = [-3.5, -4.0] + 0.5 * (NEAR[50:] - [0.0, -12.5])
    boxes = follow(people_at(near))
    assert (boxes.status[:, 0] == "measured").all()
    assert np.linalg.norm(boxes.ground_world[:, 0] - near, axis=1)[[10, 40, 60, 90]].max() < 0.5


def test_two_at_the_net_keep_their_own():
    near = np.stack([np.linspace(-2, 2, ROWS), np.full(ROWS, -2.0)], axis=1)
    far = np.stack([np.linspace(2, -2, ROWS), np.full(ROWS, 2.0)], axis=1)
    boxes = follow(together(people_at(near, seed=3), people_at(far, seed=4)))
    assert (boxes.status != "none").all()
    assert np.abs(boxes.ground_world - np.stack([near, far], axis=1)).max() < 1.0


def test_one_person_is_never_both_players():
    boxes = follow(people_at(np.tile([1.0, 0.2], (ROWS, 1)) + 0.5 * (NEAR - [0.0, -12.5])))
    assert not (boxes.status != "none").all(axis=1).any()


def test_repeats_show_what_their_source_shows_and_frames_without_a_camera_nothing():
    clip = still_clip(duplicates=(10, 20), lost=(30, 31))
    people = people_at(NEAR)
    boxes = follow(people, clip)
    np.testing.assert_array_equal(boxes.boxes_px[[10, 20]], boxes.boxes_px[[9, 19]])
    assert (boxes.status[[10, 20], 0] == boxes.status[[9, 19], 0]).all()
    assert (boxes.status[[30, 31]] == "none").all()


def test_a_camera_that_turns_does_no_harm():
    camera = camera_of(np.linspace(-0.08, 0.08, ROWS), np.linspace(550.0, 700.0, ROWS), np.zeros(ROWS))
    ground = np.concatenate([NEAR, np.zeros((ROWS, 1))], axis=1)[:, None]
    feet, head = project(camera, ground)[0][:, 0], project(camera, ground + [0.0, 0.0, 1.85])[0][:, 0]
    tall = feet[:, 1] - head[:, 1]
    truth = np.stack([feet[:, 0] - 0.2 * tall, head[:, 1], feet[:, 0] + 0.2 * tall, feet[:, 1]], axis=1)
    boxes = follow(replace(people_at(NEAR), boxes_px=truth), clip_of(camera))
    assert overlap(boxes.boxes_px[:, 0], truth).min() > 0.8


def test_a_clip_of_one_frame():
    boxes = follow(people_at(NEAR[:1]), still_clip(1))
    assert boxes.boxes_px.shape == (1, 2, 4)
    assert (boxes.status[:, 0] == "measured").all()


def test_nobody_found_is_nobody_followed():
    boxes = follow(no_people())
    assert (boxes.status == "none").all() and (boxes.score == 0).all()


def test_scenes_with_one_player_and_with_none():
    blocks = load_scene("blocks")
    one = follow_players(people_at(swing((0.0, 2.0), 2.0)), still_clip(), size=SIZE, scene=blocks)
    assert one.names == ("player0",)
    assert (one.status == "measured").all()
    none = follow(people_at(NEAR), scene=replace(blocks, objects=()))
    assert none.boxes_px.shape == (ROWS, 0, 4)


def test_people_in_frames_that_the_clip_does_not_have_are_an_error():
    with pytest.raises(ValueError, match="frame: expected 0 to 49, got 0 to 99"):
        follow(people_at(NEAR), still_clip(50))


@settings(max_examples=30)
@given(st.integers(0, 2**31))
def test_the_best_path_gains_as_much_as_the_best_of_all_paths(seed: int):
    random = np.random.default_rng(seed)
    rows = 5
    clip, options = still_clip(rows), FollowOptions(jump_cost=4.0)
    frame = np.sort(random.integers(0, rows, 7))
    places = np.concatenate([random.uniform(-2, 2, (7, 2)) + [0.0, -10.0], np.full((7, 1), 0.4)], axis=1)
    gains = random.uniform(0.1, 3.0, 7)

    def worth(path: tuple[int, ...]) -> float:
        total = float(gains[list(path)].sum())
        for a, b in zip(path[:-1], path[1:], strict=True):
            passed = (frame[b] - frame[a]) / 25
            view = places[b, :2] - clip.camera.position_world[0, :2]
            view = view / np.linalg.norm(view)
            move = places[b, :2] - places[a, :2]
            along, across = move @ view, move[0] * view[1] - move[1] * view[0]
            noise, reach = options.place_std_m * np.sqrt(2), options.speed_m_s * passed
            deep = noise / places[b, 2]
            cost = (max(abs(across) - reach, 0) / noise) ** 2 + (max(abs(along) - reach, 0) / deep) ** 2
            cost += 0.5 * ((across / (noise + 0.5 * reach)) ** 2 + (along / (deep + 0.5 * reach)) ** 2)
            total -= min(cost, options.jump_cost)
        return total

    def paths(start: tuple[int, ...]):
        yield start
        for person in range(7):
            if not start or frame[person] > frame[start[-1]]:
                yield from paths((*start, person))

    best = max(worth(path) for path in paths(()) if path)
    found = tuple(best_path(frame, places, gains, clip, options).tolist())
    assert worth(found) == pytest.approx(best)


def test_share_of_time_tells_who_stands_from_who_runs():
    stands, runs = people_at(np.tile([3.0, -12.0], (ROWS, 1))), people_at(NEAR)
    people = together(stands, runs)
    places = np.concatenate([people.ground_world, np.full((2 * ROWS, 1), 0.5)], axis=1)
    share = share_of_time_there(people, places)
    np.testing.assert_array_equal(share[:ROWS], 1.0)
    assert np.median(share[ROWS:]) < 0.5


def test_people_whom_two_detectors_found_are_one_and_others_stay():
    a = people_at(NEAR[:3], person=0.8, seed=5)
    b = together(people_at(NEAR[:2], person=0.6, player=0.9, seed=6), people_at(FAR[:2], person=0.7, player=0.2))
    both = merge_people(a, b)
    assert both.frame.tolist() == [0, 0, 1, 1, 2]
    near = both.ground_world[:, 1] < 0
    np.testing.assert_allclose(both.person[near], [0.92, 0.92, 0.8])
    np.testing.assert_array_equal(both.boxes_px[near], a.boxes_px)
    np.testing.assert_allclose(both.player[near], [0.9, 0.9, np.nan])
    np.testing.assert_allclose(both.player[~near], 0.2)


def test_merging_with_nobody_changes_nothing_and_order_does_not_matter():
    a, b = people_at(NEAR[:4], person=0.8, player=0.7), people_at(NEAR[:4], person=0.6, player=0.4, seed=9)
    alone, one, other = merge_people(a, no_people()), merge_people(a, b), merge_people(b, a)
    for name in ("frame", "boxes_px", "ground_world", "person", "player"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(a, name))
        np.testing.assert_allclose(getattr(one, name), getattr(other, name))


def test_players_are_found_by_several_finders_together():
    class Known:
        def __init__(self, people: PersonCandidates) -> None:
            self.people = people

        def find(self, pictures, clip, *, size, scene) -> PersonCandidates:
            return self.people

    gap = NEAR.copy()
    gap[30:80] = np.nan
    finders = [Known(people_at(gap)), Known(together(people_at(NEAR), people_at(FAR)))]
    boxes = find_players(finders, lambda: iter(()), still_clip(), size=SIZE, scene=TENNIS)
    assert (boxes.status == "measured").all()
    assert (find_players([], lambda: iter(()), still_clip(), size=SIZE, scene=TENNIS).status == "none").all()
