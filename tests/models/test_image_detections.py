"""ADD and MDR: matching against brute force, what counts and what does not, boxes of masks."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_models.image_detections import (
    DetectionScore,
    boxes_about,
    boxes_of_masks,
    centres_of,
    centroids_of_masks,
    detect,
    detection_score,
    mask_iou,
    match_centres,
    pooled_score,
    seen_reference,
)

SIZE = (512, 288)
MISSING = np.full((1, 1, 4), np.nan)


def at(*points: tuple[float, float]) -> np.ndarray:
    """Boxes about points."""
    return boxes_about(np.array(points, float).reshape(-1, 2), 3.0)


def best_by_hand(reference: np.ndarray, found: np.ndarray, radius: float) -> tuple[int, float]:
    """Most matches, and the least sum of distances of that many, by trying all ways."""
    few, many = (reference, found) if len(reference) <= len(found) else (found, reference)
    best = (0, 0.0)
    for order in permutations(range(len(many)), len(few)):
        distance = np.array([np.hypot(*(few[i] - many[j])) for i, j in enumerate(order)])
        kept = distance[distance <= radius]
        if len(kept) > best[0] or (len(kept) == best[0] and kept.sum() < best[1]):
            best = (len(kept), float(kept.sum()))
    return best


@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 10_000), st.floats(0.5, 12.0))
def test_matching_is_the_best_of_all_ways(objects, found, seed, radius):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(0, 12, (objects, 2)), rng.uniform(0, 12, (found, 2))
    rows, columns, distances = match_centres(a, b, radius)
    count, total = best_by_hand(a, b, radius)
    assert len(rows) == len(set(rows.tolist())) == len(set(columns.tolist())) == count
    assert distances.sum() == pytest.approx(total)
    assert (distances <= radius).all()


def test_the_radius_is_a_plain_distance():
    reference = at((100.0, 100.0))[None]
    for apart, matched in ((4.99, 1), (5.01, 0)):
        score = detection_score(reference, [at((100.0 + apart, 100.0))], radius_px=5.0, size=SIZE)
        assert (score.matched, score.valid) == (matched, 1)


def test_missing_reference_boxes_count_for_nothing():
    reference = np.concatenate([at((10.0, 10.0))[None], MISSING, at((30.0, 30.0))[None]])
    found = [at((11.0, 10.0)), at((10.0, 10.0)), np.zeros((0, 4))]
    score = detection_score(reference, found, radius_px=4.0, size=SIZE)
    assert (score.valid, score.matched) == (2, 1)
    assert score.add_px == pytest.approx(1.0)
    assert score.mdr == pytest.approx(0.5)
    assert score.add_of_diagonal == pytest.approx(1.0 / np.hypot(*SIZE))
    assert score.add_px_at(1024) == pytest.approx(2.0)


def test_without_anything_the_figures_are_unknown_and_not_perfect():
    score = detection_score(MISSING, [at((1.0, 1.0))], radius_px=4.0, size=SIZE)
    assert np.isnan(score.add_px)
    assert np.isnan(score.mdr)


def test_one_box_matches_only_once():
    reference = at((10.0, 10.0), (12.0, 10.0))[None]
    score = detection_score(reference, [at((11.0, 10.0))], radius_px=5.0, size=SIZE)
    assert (score.valid, score.matched) == (2, 1)


def test_clips_of_odd_lengths_add_up_to_all_frames():
    rng = np.random.default_rng(3)
    centres = rng.uniform(0, 200, (11, 2, 2))
    reference = boxes_about(centres, 5.0)
    reference[rng.random((11, 2)) < 0.3] = np.nan
    found = [boxes_about(c[rng.random(2) < 0.8] + rng.normal(0, 3, 2), 4.0) for c in centres]
    whole = detection_score(reference, found, radius_px=6.0, size=SIZE)
    parts = [
        detection_score(reference[a:b], found[a:b], radius_px=6.0, size=SIZE) for a, b in ((0, 3), (3, 10), (10, 11))
    ]
    pooled = pooled_score(parts)
    assert pooled.add_px == pytest.approx(whole.add_px)
    assert (pooled.valid, pooled.matched, pooled.mdr) == (whole.valid, whole.matched, whole.mdr)


def test_scores_of_two_radii_are_not_pooled():
    def score(radius: float) -> DetectionScore:
        return detection_score(MISSING, [np.zeros((0, 4))], radius_px=radius, size=SIZE)

    with pytest.raises(ValueError, match="expected one radius, size and way"):
        pooled_score([score(2.0), score(3.0)])


def test_figures_say_all_they_depend_on():
    reference = at((10.0, 10.0))[None]
    score = detection_score(reference, [at((12.0, 10.0))], radius_px=5.0, size=SIZE, found_by="alpha")
    assert str(score) == "ADD-alpha 2.00 px at 512x288, MDR-alpha 0.0000 (share): 1 of 1 matched within 5 px"
    assert detection_score(reference, [at()], radius_px=5.0, size=SIZE).names == ("ADD", "MDR")


def test_wrong_counts_and_radii_are_refused():
    with pytest.raises(ValueError, match="expected those of 1 frames, got 2"):
        detection_score(MISSING, [at(), at()], radius_px=1.0, size=SIZE)
    with pytest.raises(ValueError, match="radius: expected above 0"):
        detection_score(MISSING, [at()], radius_px=float("nan"), size=SIZE)


def test_a_detector_is_shown_colours_from_zero_to_one_and_gives_boxes():
    picture = np.full((3, 4, 6), 0.5, np.float32)

    def middle(picture: np.ndarray) -> np.ndarray:
        return np.array([[0.0, 0.0, picture.shape[2] - 1.0, picture.shape[1] - 1.0]])

    np.testing.assert_allclose(centres_of(detect(middle, [picture, picture])[1]), [[2.5, 1.5]])
    with pytest.raises(ValueError, match="made: frame 1: expected colours from 0 to 1, got -1"):
        detect(middle, [picture, picture * 4 - 3], "made")
    with pytest.raises(ValueError, match="frame 0: detector: expected boxes"):
        detect(lambda _: np.full((1, 4), np.nan), [picture])


def test_reference_boxes_that_no_detector_sees_in_real_pictures_are_left_out():
    reference = np.stack([at((10.0, 10.0), (50.0, 50.0)), at((20.0, 20.0), (60.0, 60.0))])
    kept = seen_reference(reference, [at((51.0, 50.0)), at((20.0, 20.0), (90.0, 60.0))], radius_px=3.0)
    np.testing.assert_array_equal(np.isfinite(kept).all(axis=2), [[False, True], [True, False]])
    np.testing.assert_array_equal(kept[0, 1], reference[0, 1])


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 1_000))
def test_boxes_and_centroids_of_masks_are_those_of_their_pixels(height, width, seed):
    masks = np.random.default_rng(seed).random((3, 2, height, width)) < 0.15
    boxes, centroids = boxes_of_masks(masks), centroids_of_masks(masks)
    for index in np.ndindex(3, 2):
        rows, columns = np.nonzero(masks[index])
        if len(rows):
            np.testing.assert_array_equal(boxes[index], [columns.min(), rows.min(), columns.max(), rows.max()])
            np.testing.assert_allclose(centroids[index], [columns.mean(), rows.mean()])
        else:
            assert np.isnan(boxes[index]).all()
            assert np.isnan(centroids[index]).all()


def test_masks_of_too_few_pixels_have_no_box():
    mask = np.zeros((4, 4), bool)
    mask[1, 1:3] = True
    assert np.isnan(boxes_of_masks(mask, least_pixels=3)).all()
    np.testing.assert_array_equal(boxes_of_masks(mask, least_pixels=2), [1, 1, 2, 1])


def test_boxes_of_rendered_masks_are_scored_under_a_name_of_their_own():
    real, made = np.zeros((2, 1, 20, 30), bool), np.zeros((2, 1, 20, 30), bool)
    real[:, 0, 5:9, 6:10] = True
    made[0, 0, 5:9, 8:12] = True
    score = detection_score(
        boxes_of_masks(real), list(boxes_of_masks(made)), radius_px=4.0, size=(30, 20), found_by="alpha"
    )
    assert (score.valid, score.matched, score.add_px) == (2, 1, 2.0)
    assert score.names == ("ADD-alpha", "MDR-alpha")


def test_silhouettes_overlap_by_their_share():
    a, b = np.zeros((2, 4, 4), bool), np.zeros((2, 4, 4), bool)
    a[0, :2], b[0, 1:3] = True, True
    np.testing.assert_allclose(mask_iou(a, b), [1 / 3, np.nan])
    np.testing.assert_allclose(mask_iou(a, a), [1.0, np.nan])
