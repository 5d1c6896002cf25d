"""Simulated clips: the same for the same seed, with truth that fits their pictures."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.clip import simulate_clip
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.mix import MIN_POINTS, MixOptions, mix_pictures
from pgm_data.simulate.pictures.negative import draw_negative, draw_props
from pgm_data.simulate.views import points_in_picture

SMALL = ClipOptions(frames=14, width=320, height=180)


@pytest.mark.parametrize("scene", ["tennis", "tabletennis"])
def test_the_same_seed_draws_the_same_clip_and_another_seed_another(scene: str) -> None:
    options = replace(SMALL, frames=2)
    first, again, other = (simulate_clip(load_scene(scene), options, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.track.K, again.track.K)
    for a, b, c in zip(first.frames(), again.frames(), other.frames(), strict=True):
        assert a.shape == (180, 320, 3) and a.dtype == np.uint8
        np.testing.assert_array_equal(a, b)
        assert (a != c).mean() > 0.5
    np.testing.assert_array_equal(next(first.frames()), next(first.frames()))


def test_pictures_do_not_change_the_truth() -> None:
    draft, full = (simulate_clip(load_scene("tennis"), replace(SMALL, quality=q), 3) for q in ("draft", "full"))
    np.testing.assert_array_equal(draft.track.R_cam_from_world, full.track.R_cam_from_world)


@pytest.mark.parametrize("motion", ["still", "drift", "follow"])
def test_the_centre_is_fixed_and_the_lens_keeps_its_bend_over_the_half_diagonal(motion: str) -> None:
    clip = simulate_clip(load_scene("tennis"), replace(SMALL, frames=200, motion=motion), 4)
    track = clip.track
    centres = -np.einsum("nji,nj->ni", track.R_cam_from_world, track.t_cam_from_world)
    assert np.ptp(centres, axis=0).max() < 1e-9
    k = track.distortion[:, 0] / track.K[:, 0, 0] ** 2
    np.testing.assert_allclose(k, k[0], rtol=1e-9)
    assert not track.distortion[:, 1:].any()
    moved = np.ptp(track.R_cam_from_world[:, 2], axis=0).max()
    assert (moved > 0) == (motion != "still")
    assert (np.ptp(track.K[:, 0, 0]) > 0) == (motion == "follow")
    step = np.abs(np.diff(track.R_cam_from_world[:, 2], axis=0)).max() * track.K[0, 0, 0]
    assert step < 0.02 * clip.width, "a camera moves smoothly"


def test_every_sixth_frame_repeats_its_predecessor_with_its_capture_time() -> None:
    clip = simulate_clip(load_scene("tennis"), replace(SMALL, duplicates=True, motion="follow"), 1)
    repeats = np.flatnonzero(clip.is_duplicate)
    assert repeats.tolist() == [5, 11]
    frames = list(clip.frames())
    for i in range(1, len(frames)):
        assert np.array_equal(frames[i], frames[i - 1]) == bool(clip.is_duplicate[i])
    np.testing.assert_array_equal(clip.track.K[repeats], clip.track.K[repeats - 1])
    np.testing.assert_array_equal(clip.capture_times[repeats], clip.capture_times[repeats - 1])
    distinct = clip.capture_times[~clip.is_duplicate]
    np.testing.assert_allclose(np.diff(distinct), 1.2 / 25.0)


def test_closeups_have_no_camera_and_look_different() -> None:
    options = replace(SMALL, frames=1200, closeups=True, fps=25.0)
    clip = simulate_clip(load_scene("tennis"), options, 2)
    shown = clip.track.shows_court
    assert shown[0] and not shown.all() and shown.mean() > 0.5
    cuts = np.flatnonzero(np.diff(shown.astype(int)))
    assert (np.diff(cuts) > 20).all()


@pytest.mark.parametrize(
    "wrong",
    [{"fps": -25.0}, {"frames": 0}, {"width": 10}, {"height": 100_000}, {"motion": "wild"}, {"quality": "best"}],
)
def test_options_out_of_range_are_refused_by_name(wrong: dict) -> None:
    with pytest.raises(Exception, match=next(iter(wrong))):
        ClipOptions(**wrong)


def test_a_scene_without_a_court_that_is_not_the_blocks_is_refused_with_the_reason() -> None:
    scene = replace(load_scene("blocks"), name="caves")
    with pytest.raises(ValueError, match="got no court"):
        simulate_clip(scene, SMALL, 0)


def test_the_mix_depends_on_seed_and_video_and_shows_the_court_in_most_pictures() -> None:
    scene = load_scene("tennis")
    assert scene.court is not None
    options = MixOptions(pictures=80, per_video=40, width=160, height=90)
    drawn = list(mix_pictures(scene, options, 1, 0))
    again = list(mix_pictures(scene, replace(options, pictures=3), 1, 0))
    other = next(mix_pictures(scene, options, 1, 1))
    for (a, _), (b, _) in zip(drawn, again, strict=False):
        np.testing.assert_array_equal(a, b)
    assert (drawn[0][0] != other[0]).mean() > 0.5
    views = [view for _, view in drawn]
    assert 1 <= sum(view is None for view in views) <= 14
    for view in views:
        assert view is None or points_in_picture(scene.court, view, (160, 90)) >= MIN_POINTS


def test_a_mix_is_cut_into_videos_of_the_given_length() -> None:
    options = MixOptions(pictures=2500, per_video=1000)
    assert [options.pictures_of(v) for v in range(options.videos)] == [1000, 1000, 500]


@pytest.mark.parametrize("wrong", [{"pictures": 0}, {"fps": 0.0}, {"width": 641}, {"no_court": 1.5}])
def test_mix_options_out_of_range_are_refused_by_name(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        MixOptions(**wrong)


def test_pictures_without_a_court_are_drawn_for_any_size_and_differ() -> None:
    rng = np.random.default_rng(0)
    pictures = [draw_negative(rng, 160, 90) for _ in range(12)]
    assert all(p.shape == (90, 160, 3) and p.dtype == np.uint8 for p in pictures)
    assert len({p.tobytes() for p in pictures}) == 12


def test_props_of_another_size_are_refused() -> None:
    props = draw_props(np.random.default_rng(0), load_scene("tennis"), 160, 90)
    with pytest.raises(ValueError, match="160x90"):
        draw_negative(np.random.default_rng(0), 320, 180, props)
