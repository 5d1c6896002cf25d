"""Candidates linked into the ball's track: known paths among clutter made here."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.ball import BallTrack
from pgm_data.detect.ball.candidates import BallCandidates
from pgm_data.detect.ball.link import LinkOptions, link_candidates, merge_candidates
from pgm_data.detect.ball.link_chain import ChainModel, Meetings, best_chain

SIZE = (1280, 720)


def flight(frames: int, fps: float, *, bounce: bool = True) -> np.ndarray:
    """A ball that falls, rebounds from the lower part of the picture and returns from its sides."""
    place, velocity, out = np.array([300.0, 200.0]), np.array([420.0, 60.0]), []
    for _ in range(frames):
        out.append(place.copy())
        velocity[1] += 700.0 / fps
        place = place + velocity / fps
        if bounce and place[1] > 600 and velocity[1] > 0:
            velocity[1] *= -0.9
        if not 40 < place[0] < 1240 and (place[0] - 640) * velocity[0] > 0:
            velocity[0] *= -1
    return np.array(out)


def candidates(
    places: np.ndarray, *, score: float | np.ndarray = 0.9, others: int = 4, seed: int = 0, noise: float = 0.4,
    streaks: np.ndarray | None = None,
) -> BallCandidates:  # fmt: skip
    """The ball where it is known, and other places anywhere, the order by chance."""
    rng = np.random.default_rng(seed)
    frames = len(places)
    pixels = rng.uniform((0, 0), SIZE, (frames, others + 1, 2))
    pixels[:, 0] = places + rng.normal(0, noise, places.shape)
    scores = rng.uniform(0.01, 0.3, (frames, others + 1))
    scores[:, 0] = np.where(np.isnan(places[:, 0]), np.nan, score)
    streak = np.full(pixels.shape, np.nan)
    if streaks is not None:
        streak[:, 0] = streaks
    order = rng.permuted(np.tile(np.arange(others + 1), (frames, 1)), axis=1)
    rows = np.arange(frames)[:, None]
    sigma = np.where(np.isnan(scores), np.nan, 0.5)
    return BallCandidates(
        pixels=pixels[rows, order],
        sigma_px=sigma[rows, order],
        score=scores[rows, order],
        streak_px=streak[rows, order],
    )


def link(found: BallCandidates, fps: float = 50.0, *, repeats=None, turns=None, times=None, **how) -> BallTrack:
    """The track of a clip of even rate."""
    frames = len(found.score)
    return link_candidates(
        found,
        times=np.arange(frames) / fps if times is None else times,
        is_duplicate=np.zeros(frames, dtype=bool) if repeats is None else repeats,
        size=SIZE,
        here_from_previous=turns,
        options=LinkOptions(**how),
    )


def share_right(track: BallTrack, places: np.ndarray) -> tuple[float, float]:
    """Recall over the frames with a place, and precision over the rows given."""
    right = np.hypot(*(track.pixels - places).T) < 3
    return float(right[np.isfinite(places[:, 0])].mean()), float(right[track.measured].mean())


@pytest.mark.parametrize("fps", [10.0, 25.0, 50.0, 240.0])
def test_ball_is_followed_among_clutter(fps: float) -> None:
    places = flight(round(4 * fps), fps)
    recall, precision = share_right(link(candidates(places), fps), places)
    assert recall > (0.85 if fps == 10 else 0.95)
    assert precision > 0.97


def test_frames_without_the_ball_stay_empty() -> None:
    places = flight(200, 50)
    hidden = np.zeros(200, dtype=bool)
    hidden[40:58] = hidden[100:103] = hidden[np.arange(5, 200, 11)] = True
    seen = np.where(hidden[:, None], np.nan, places)
    track = link(candidates(seen))
    assert not np.isfinite(track.pixels[40:58]).any()
    right = np.hypot(*(track.pixels - places).T) < 3
    assert right[~hidden].mean() > 0.93
    assert np.isfinite(track.pixels[hidden]).all(axis=1).mean() < 0.05


def test_row_is_one_of_the_candidates_of_its_frame() -> None:
    found = candidates(flight(100, 50), streaks=np.full((100, 2), 3.0))
    track = link(found)
    rows = np.flatnonzero(track.measured)
    same = (found.pixels[rows] == track.pixels[rows][:, None]).all(axis=2)
    assert (same.sum(axis=1) == 1).all()
    slot = same.argmax(axis=1)
    np.testing.assert_array_equal(track.streak_px[rows], found.streak_px[rows, slot])
    assert (track.sigma_px[rows] >= found.sigma_px[rows, slot]).all()
    assert ((track.score[rows] >= 0.5) & (track.score[rows] <= 1)).all()


def test_what_stands_still_loses_however_well_it_scores() -> None:
    places = flight(150, 50)
    found = candidates(places, score=0.6)
    rng = np.random.default_rng(5)
    logo = np.array([640.0, 330.0]) + rng.normal(0, 0.3, (150, 2))
    with_logo = BallCandidates(
        pixels=np.concatenate([found.pixels, logo[:, None]], axis=1),
        sigma_px=np.concatenate([found.sigma_px, np.full((150, 1), 0.5)], axis=1),
        score=np.concatenate([found.score, np.full((150, 1), 0.9)], axis=1),
        streak_px=np.concatenate([found.streak_px, np.full((150, 1, 2), np.nan)], axis=1),
    )
    recall, precision = share_right(link(with_logo), places)
    assert recall > 0.9
    assert precision > 0.95
    alone = candidates(np.tile([640.0, 330.0], (150, 1)), score=0.5)
    assert link(alone).measured.mean() < 0.05


def test_slower_second_ball_that_scores_less_loses() -> None:
    places = flight(150, 50)
    found = candidates(places, score=0.85)
    rolling = np.array([100.0, 650.0]) + np.arange(150)[:, None] * np.array([1.5, 0.0])
    both = BallCandidates(
        pixels=np.concatenate([found.pixels, rolling[:, None]], axis=1),
        sigma_px=np.concatenate([found.sigma_px, np.full((150, 1), 0.5)], axis=1),
        score=np.concatenate([found.score, np.full((150, 1), 0.5)], axis=1),
        streak_px=np.concatenate([found.streak_px, np.full((150, 1, 2), np.nan)], axis=1),
    )
    recall, precision = share_right(link(both), places)
    assert recall > 0.93
    assert precision > 0.97


def test_streak_across_the_motion_tells_a_false_one() -> None:
    places = flight(60, 50, bounce=False)
    step = np.gradient(places, axis=0)
    found = candidates(places, score=0.5, others=0, streaks=0.5 * step)
    crossed = np.stack([-step[:, 1], step[:, 0]], axis=1)
    wrong = candidates(places, score=0.5, others=0, streaks=2.0 * crossed)
    assert np.nansum(link(found).score) > np.nansum(link(wrong).score)


def test_repeats_are_no_measurement_and_do_not_disturb() -> None:
    places = flight(120, 25)
    found = candidates(places)
    once = link(found, 25)
    rows = np.sort(np.concatenate([np.arange(120), np.arange(0, 120, 5)]))
    repeats = np.append(False, np.diff(rows) == 0)
    shown = BallCandidates(
        pixels=found.pixels[rows],
        sigma_px=found.sigma_px[rows],
        score=found.score[rows],
        streak_px=found.streak_px[rows],
    )
    track = link(shown, repeats=repeats, times=rows / 25)
    assert np.isnan(track.pixels[repeats]).all()
    np.testing.assert_array_equal(track.pixels[~repeats], once.pixels)
    np.testing.assert_array_equal(track.times, rows / 25)


def test_turning_camera_is_taken_out() -> None:
    frames = 150
    places = flight(frames, 50)
    turns = np.tile(np.eye(3), (frames, 1, 1))
    shift = 14 * np.sin(np.arange(frames) / 3)
    turns[1:, 0, 2] = np.diff(shift)
    turns[1:, 2, 0] = 1e-6
    here = places.copy()
    for frame in range(frames):  # The slow reference: carried from frame to frame.
        for step in turns[1 : frame + 1]:
            point = step @ np.append(here[frame], 1.0)
            here[frame] = point[:2] / point[2]
    recall, precision = share_right(link(candidates(here), turns=turns), here)
    assert recall > 0.95
    assert precision > 0.97


def test_two_plays_with_a_pause_are_both_followed() -> None:
    first, second = flight(80, 50), flight(80, 50)[:, ::-1] * [1.0, 0.5]
    places = np.concatenate([first, np.full((90, 2), np.nan), second])
    track = link(candidates(places))
    recall, precision = share_right(track, places)
    assert recall > 0.9
    assert precision > 0.95


def test_clutter_alone_is_no_ball() -> None:
    track = link(candidates(np.full((200, 2), np.nan), others=6))
    assert track.measured.sum() < 10


def test_scores_of_rows_far_from_the_fit_come_with_wide_deviations() -> None:
    places = flight(80, 50, bounce=False)
    places[40] += 3.0
    found = candidates(places, noise=0.05, others=0)
    track = link(found, furthest=50.0)
    if track.measured[40]:
        assert track.sigma_px[40] > 1.2
    assert np.median(track.sigma_px[track.measured]) < 0.6


@pytest.mark.parametrize("frames", [0, 1, 2, 3])
@pytest.mark.parametrize("slots", [0, 1, 3])
def test_hardly_any_frames_or_candidates(frames: int, slots: int) -> None:
    found = candidates(flight(max(frames, 1), 50)[:frames].reshape(frames, 2), others=max(slots - 1, 0))
    found = BallCandidates(
        pixels=found.pixels[:, :slots], sigma_px=found.sigma_px[:, :slots], score=found.score[:, :slots],
        streak_px=found.streak_px[:, :slots],
    )  # fmt: skip
    assert len(link(found).times) == frames


def test_nothing_found_and_nothing_but_repeats() -> None:
    nothing = BallCandidates(
        pixels=np.full((30, 4, 2), np.nan), sigma_px=np.full((30, 4), np.nan), score=np.full((30, 4), np.nan),
        streak_px=np.full((30, 4, 2), np.nan),
    )  # fmt: skip
    assert not link(nothing).measured.any()
    found = candidates(flight(30, 50))
    repeated = link(found, repeats=np.ones(30, dtype=bool))
    assert not np.isfinite(repeated.pixels).any()
    assert not link(found, times=np.zeros(30)).measured.any()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), frames=st.integers(1, 25), slots=st.integers(1, 4))
def test_hard_numbers_raise_nothing(seed: int, frames: int, slots: int) -> None:
    rng = np.random.default_rng(seed)
    hard = np.array([0.0, 1e-300, 1.0, 5.0, 1e9, -1e9, np.nan, np.inf])
    pixels = np.where(rng.random((frames, slots, 1)) < 0.3, np.nan, rng.choice(hard, (frames, slots, 2)))
    found = BallCandidates(
        pixels=pixels,
        sigma_px=rng.choice(hard, (frames, slots)),
        score=rng.choice([0.0, 0.5, 1.0, np.nan], (frames, slots)),
        streak_px=rng.choice(hard, (frames, slots, 2)),
    )
    turns = rng.choice(hard, (frames, 3, 3)) if seed % 2 else None
    times = np.sort(rng.choice([0.0, 0.1, 0.2, 7.0], frames))
    track = link(found, turns=turns, times=times)
    assert len(track.times) == frames


def test_same_answer_each_time_and_inputs_unchanged() -> None:
    found = candidates(flight(60, 50))
    kept = found.pixels.copy()
    one, two = link(found), link(found)
    np.testing.assert_array_equal(one.pixels, two.pixels)
    np.testing.assert_array_equal(found.pixels, kept)


def test_best_chain_is_that_of_all_chains() -> None:
    rng = np.random.default_rng(0)
    model = ChainModel(gap_s=0.4, start=1.0)
    for _ in range(40):
        count = 6
        gain = rng.normal(0.5, 2, count)
        begin = rng.choice(np.arange(30), count, replace=False) / 10.0
        end = begin + rng.integers(1, 10, count) / 10.0 + 0.05
        gap = begin[None, :] - end[:, None]
        earlier, later = np.nonzero((gap <= model.gap_s) & (gap > 0))
        meet = Meetings(earlier=earlier, later=later, worth=rng.uniform(-1, 3, len(earlier)))
        follows = np.where(gap > model.gap_s, -model.start, -np.inf)
        follows[earlier, later] = meet.worth
        chosen, together = best_chain(gain, begin, end, meet, model)
        order = np.argsort(begin)
        worth = {}
        for code in range(1, 2**count):
            members = [int(n) for n in order if code >> n & 1]
            links = [follows[a, b] for a, b in zip(members[:-1], members[1:], strict=True)]
            worth[tuple(members)] = float(gain[members].sum() + sum(links))
        best = max(worth, key=lambda members: worth[members])
        assert tuple(chosen.tolist()) == (best if worth[best] > 0 else ())
        if worth[best] > 0:
            np.testing.assert_allclose(together.sum(), worth[best])


def test_merging_keeps_each_place_once_with_the_better_of_both() -> None:
    def one(pixels, scores, sigma) -> BallCandidates:
        return BallCandidates(
            pixels=np.array([pixels]), sigma_px=np.array([sigma]), score=np.array([scores]),
            streak_px=np.full((1, len(scores), 2), np.nan),
        )  # fmt: skip

    a = one([[10.0, 10.0], [50.0, 50.0], [np.nan, np.nan]], [0.3, 0.6, np.nan], [0.2, 0.5, np.nan])
    b = one([[11.0, 10.0], [90.0, 90.0]], [0.8, 0.1], [1.0, 1.0])
    both = merge_candidates(a, b)
    np.testing.assert_array_equal(both.score[0], [0.8, 0.6, 0.1, np.nan, np.nan])
    np.testing.assert_array_equal(both.pixels[0, :3], [[10, 10], [50, 50], [90, 90]])
    np.testing.assert_array_equal(both.sigma_px[0, :3], [0.2, 0.5, 1.0])
    with pytest.raises(ValueError, match="one clip"):
        merge_candidates(a, candidates(flight(3, 50)))


def test_wrong_lengths_and_times_are_refused() -> None:
    found = candidates(flight(10, 50))
    with pytest.raises(ValueError, match="is_duplicate"):
        link(found, repeats=np.zeros(9, dtype=bool))
    with pytest.raises(ValueError, match="here_from_previous"):
        link(found, turns=np.tile(np.eye(3), (9, 1, 1)))
    with pytest.raises(ValueError, match="never fall"):
        link(found, times=np.arange(10)[::-1] / 50.0)
