"""People from motion: figures walk on a painted court before cameras that stand, turn, zoom or travel."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.detect.players.background import BackgroundOptions, bounds, learn_background, ranked
from pgm_data.detect.players.candidates import PersonCandidates, PersonFinder
from pgm_data.detect.players.canvas import small_view
from pgm_data.detect.players.emptied import emptied
from pgm_data.detect.players.ground_map import ground_map, standing_height
from pgm_data.detect.players.motion import MotionOptions, MotionPeople, foreground
from pgm_data.scene import load_scene
from tests.detect.players.filmed_people import SIZE, Filmed, camera_of, film, ground_picture, overlap

TENNIS = load_scene("tennis")
ROWS = 16


def walk(*ends: tuple[tuple[float, float], tuple[float, float]], rows: int = ROWS) -> np.ndarray:
    """Feet of figures that each walk from one place to another, frames x figures x 2."""
    share = np.linspace(0, 1, rows)[:, None, None]
    first, last = np.array([pair[0] for pair in ends]), np.array([pair[1] for pair in ends])
    return (1 - share) * first + share * last


def still_camera(rows: int = ROWS):
    return camera_of(np.zeros(rows), np.full(rows, 620.0), np.zeros(rows))


def people_of(filmed: Filmed) -> PersonCandidates:
    return MotionPeople().find(filmed.pictures, filmed.clip, size=SIZE, scene=TENNIS)


def best_overlaps(people: PersonCandidates, boxes: np.ndarray) -> np.ndarray:
    """For each frame and figure, the overlap of the candidate that fits best."""
    best = np.zeros(boxes.shape[:2])
    np.maximum.at(best, people.frame, overlap(people.boxes_px[:, None], boxes[people.frame]))
    return best


def test_motion_people_is_a_finder():
    assert isinstance(MotionPeople(), PersonFinder)


def test_two_who_walk_are_found_where_they_stand():
    feet = walk(((-3.0, -12.0), (3.0, -10.0)), ((2.0, 12.5), (-3.0, 13.0)))
    filmed = film(still_camera(), feet)
    people = people_of(filmed)
    assert (best_overlaps(people, filmed.boxes_px) > 0.6).all()
    right = overlap(people.boxes_px[:, None], filmed.boxes_px[people.frame]).max(axis=1) > 0.6
    assert people.person[right].min() > 0.5
    nearest = np.linalg.norm(people.ground_world[right][:, None] - feet[people.frame[right]], axis=2).min(axis=1)
    assert nearest.max() < 1.0


def test_a_camera_that_turns_and_zooms_sees_only_those_who_move():
    camera = camera_of(np.linspace(-0.05, 0.05, ROWS), np.linspace(600.0, 700.0, ROWS), np.zeros(ROWS))
    filmed = film(camera, walk(((-3.0, -9.0), (2.0, -10.0)), ((2.0, 11.0), (-3.0, 12.0))))
    people = people_of(filmed)
    assert (best_overlaps(people, filmed.boxes_px) > 0.5).mean() > 0.97
    wrong = overlap(people.boxes_px[:, None], filmed.boxes_px[people.frame]).max(axis=1) < 0.1
    assert (wrong & (people.person > 0.5)).sum() == 0


def test_who_never_moves_on_the_court_is_found_all_the_same():
    filmed = film(still_camera(), walk(((1.0, -12.5), (1.0, -12.5)), ((-2.0, 12.0), (2.0, 12.0))))
    assert (best_overlaps(people_of(filmed), filmed.boxes_px) > 0.5).all()


def test_the_background_shows_the_ground_where_somebody_stood_for_most_of_the_clip():
    feet = walk(((1.0, -11.0), (1.0, -11.0)))
    feet[int(0.65 * ROWS) :, 0] = [-4.0, -11.0]
    filmed = film(still_camera(), feet)
    view = small_view(filmed.clip.camera, SIZE, 640)
    background = learn_background(filmed.pictures, filmed.clip, view, BackgroundOptions())
    assert background is not None
    truth = ground_picture(filmed.clip.camera[0]).astype(int)
    x0, y0, x1, y1 = filmed.boxes_px[0, 0].round().astype(int)
    wrong = np.abs(background.middle.astype(int) - truth).max(axis=2)[y0:y1, x0:x1] > 25
    assert wrong.mean() < 0.05


def test_nobody_is_taken_out_of_an_empty_court():
    filmed = film(still_camera(8), np.full((8, 1, 2), np.nan))
    view = small_view(filmed.clip.camera, SIZE, 640)
    background = learn_background(filmed.pictures, filmed.clip, view, BackgroundOptions())
    assert background is not None
    np.testing.assert_array_equal(emptied(background, TENNIS).middle, background.middle)


def test_shadows_are_nothing_new_and_people_are():
    filmed = film(still_camera(8), np.full((8, 1, 2), np.nan))
    view = small_view(filmed.clip.camera, SIZE, 640)
    background = learn_background(filmed.pictures, filmed.clip, view, BackgroundOptions())
    assert background is not None
    seen = bounds(background, view.camera[0], view.size)
    shaded = ground_picture(filmed.clip.camera[0])
    shaded[200:260, 250:330] = (shaded[200:260, 250:330] * 0.7).round().astype(np.uint8)
    assert foreground(shaded, seen, MotionOptions()).mean() < 1e-3
    red = shaded.copy()
    red[200:260, 250:330] = (40, 40, 210)
    assert foreground(red, seen, MotionOptions())[200:260, 250:330].all()


def test_the_box_of_who_is_cut_by_the_lower_edge_reaches_below_it():
    filmed = film(still_camera(), walk(((-1.5, -14.3), (1.5, -14.3))))
    assert (filmed.boxes_px[:, 0, 3] > SIZE[1] + 5).all()
    people = people_of(filmed)
    assert (best_overlaps(people, filmed.boxes_px) > 0.5).mean() > 0.9


def test_who_stands_behind_another_is_found_too():
    feet = walk(((-3.0, -2.0), (3.0, -2.0)), ((3.0, 2.0), (-3.0, 2.0)))
    filmed = film(still_camera(), feet)
    assert (overlap(filmed.boxes_px[:, 0], filmed.boxes_px[:, 1]) > 0).any()
    best = best_overlaps(people_of(filmed), filmed.boxes_px)
    assert (best > 0.4).mean() > 0.9


def test_repeats_and_frames_without_a_camera_have_nobody():
    filmed = film(still_camera(), walk(((-3.0, -12.0), (3.0, -10.0))), duplicates=(5, 11), lost=(7, 8))
    people = people_of(filmed)
    assert not np.isin(people.frame, [5, 7, 8, 11]).any()
    assert np.isin([4, 6, 9, 10], people.frame).all()


@pytest.mark.parametrize("rows", [1, 2])
def test_too_few_pictures_have_nobody(rows: int):
    filmed = film(still_camera(rows), walk(((-3.0, -12.0), (3.0, -10.0)), rows=rows))
    assert len(people_of(filmed).frame) == 0


def test_a_camera_that_travels_has_nobody():
    camera = camera_of(np.zeros(6), np.full(6, 620.0), np.linspace(0, 3, 6))
    filmed = film(camera, walk(((-3.0, -12.0), (3.0, -10.0)), rows=6))
    assert len(people_of(filmed).frame) == 0


def test_a_scene_without_players_has_nobody():
    filmed = film(still_camera(6), walk(((-3.0, -12.0), (3.0, -10.0)), rows=6))
    nobody = load_scene("tennis").__class__(
        name="empty", camera_position="fixed", person_height_m=1.85, court=None, objects=(), ball=None
    )
    assert len(MotionPeople().find(filmed.pictures, filmed.clip, size=SIZE, scene=nobody).frame) == 0


def test_too_few_pictures_for_the_clip_are_an_error():
    filmed = film(still_camera(8), walk(((-3.0, -12.0), (3.0, -10.0)), rows=8))
    with pytest.raises(ValueError, match="expected at least 8, got 5"):
        MotionPeople().find(lambda: (p for _, p in zip(range(5), filmed.pictures(), strict=False)), filmed.clip,
                            size=SIZE, scene=TENNIS)  # fmt: skip


def test_places_are_on_the_ground_where_players_may_be():
    camera = still_camera(1)[0]
    places = ground_map(camera, SIZE, TENNIS, 0.0)
    from pgm_data.geometry.camera import meet_plane

    pixels = np.stack([places.x, places.y], axis=1).astype(float)
    ground = meet_plane(camera, pixels)[:, :2]
    assert (np.abs(ground) < [10.3, 20.3]).all()
    np.testing.assert_allclose(places.height, standing_height(camera, ground, TENNIS), rtol=0.03, atol=0.3)


@settings(max_examples=25)
@given(st.integers(1, 9), st.sampled_from([0.0, 0.35, 0.5, 1.0]), st.integers(0, 2**31))
def test_ranked_pictures_are_sorted_pixels(count: int, share: float, seed: int):
    pictures = list(np.random.default_rng(seed).integers(0, 256, (count, 4, 5), dtype=np.uint8))
    expected = np.sort(np.stack(pictures), axis=0)[min(int(count * share), count - 1)]
    np.testing.assert_array_equal(ranked(pictures, share), expected)
