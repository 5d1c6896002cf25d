"""Figures of a drawn world whose players are boxes and whose ball is a bright spot, made by hand in known ways."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pgm_data.geometry.camera import project
from pgm_data.simulate.mask_files import write_masks
from pgm_data.simulate.shots import Masks
from pgm_models.synthesis.evaluate_frames import (
    BLOCK,
    ClipFigures,
    ClipJob,
    Made,
    clip_figures,
    colours,
    real_background,
)
from pgm_models.synthesis.evaluate_objects import FindOptions, near_share, places_of, score_of
from pgm_models.synthesis.evaluate_result import figures_from_json, figures_to_json
from pgm_models.synthesis.evaluate_truth import TruePixels, true_pixels
from pgm_models.synthesis.frames import FrameStore, read_frames
from tests.models.synthesis.drawn_matches import drawn_matches, packed

FRAMES = BLOCK + 3
FIND = FindOptions(player_radius_px=24.0)


class Painted(FrameStore):
    """Frames in which each player fills his box, and the ball is a spot."""

    def rgb(self, row: int) -> np.ndarray:
        return painted(self, row, players=(0, 1), ball=True)


def painted(store: FrameStore, row: int, *, players: tuple[int, ...], ball: bool) -> np.ndarray:
    """A picture of a frame with some of its objects."""
    image = np.array(FrameStore.rgb(store, row))
    for player in players:
        x0, y0, x1, y1 = np.clip(store.boxes_px[row, player].round().astype(int), 0, None)
        image[y0 : y1 + 1, x0 : x1 + 1] = (20, 200, 60) if player else (210, 30, 20)
    place = project(store.cameras[row], store.ball_position[row][None])[0][0]
    if ball and (place > 3).all() and (place < np.array(store.size) - 4).all():
        rows, columns = np.mgrid[: store.size[1], : store.size[0]]
        spot = np.exp(-0.5 * ((columns - place[0]) ** 2 + (rows - place[1]) ** 2))[..., None]
        image = (image * (1 - spot) + 255 * spot).round().astype(np.uint8)
    return image


@pytest.fixture(scope="module")
def store(tmp_path_factory) -> FrameStore:
    found = read_frames(packed(drawn_matches(tmp_path_factory.mktemp("drawn"), matches=1, frames=FRAMES)))
    return Painted(**vars(found))


def made_of(store: FrameStore, row: int, change: Callable[[np.ndarray], np.ndarray], **shown) -> Made:
    """A picture of a frame, changed, as if a renderer had made it."""
    shown = {"players": (0, 1), "ball": True, **shown}
    pictures = [
        change(painted(store, row, **each).transpose(2, 0, 1).astype(np.float32) / 255)
        for each in (shown, {"players": (), "ball": False})
    ]
    shares = np.zeros((len(store.scene.objects), store.size[1], store.size[0]), dtype=np.float32)
    for player in shown["players"]:
        x0, y0, x1, y1 = np.clip(store.boxes_px[row, player].round().astype(int), 0, None)
        shares[player, y0 : y1 + 1, x0 : x1 + 1] = 1.0
    shares[3] = 1.0 - shares.sum(axis=0)
    return Made(final=pictures[0], raw=0.5 * pictures[0], without=pictures[1], shares=shares, seconds=0.25)


def figures(store: FrameStore, change=lambda picture: picture, rows=None, **shown) -> ClipFigures:
    rows = np.arange(len(store)) if rows is None else rows
    job = ClipJob(store=store, rows=rows, standing=rows[:0], truth=None, find=FIND)
    return clip_figures(job, lambda row: made_of(store, row, change, **shown))


def test_the_truth_as_rendered_is_perfect(store):
    found = figures(store)
    columns = found.columns
    assert found.frames.tolist() == list(range(FRAMES)) and found.seconds == 0.25 * FRAMES
    for where in ("frame", "player0-alpha", "player1-alpha", "court-alpha", "ball"):
        assert np.isposinf(columns[f"psnr final {where}"]).all(), where
        np.testing.assert_allclose(columns[f"ssim final {where}"], 1.0, atol=1e-9)
        assert (columns[f"psnr raw {where}"] < 20).all(), where
    np.testing.assert_allclose(columns["ms_ssim final frame"], 1.0, atol=1e-9)
    assert np.isnan(columns["psnr final backplate-alpha"]).all()
    for name in ("player0", "player1"):
        score = score_of(columns[f"distance made {name}"], 4.5, store.size)
        assert score.mdr == 0 and score.valid == FRAMES and score.add_px < 1.0
        alpha = score_of(columns[f"distance alpha {name}"], 4.5, store.size, alpha=True)
        assert alpha.add_px < 0.6 and alpha.names == ("ADD-alpha", "MDR-alpha")
    assert near_share(columns["distance made ball"], 1.0) == 1.0
    assert np.isnan(columns["change_psnr final frame"][0])
    assert np.isposinf(columns["change_psnr final frame"][1:]).all()


def test_a_picture_three_pixels_aside_has_its_objects_three_pixels_off(store):
    straight, aside = figures(store).columns, figures(store, lambda picture: np.roll(picture, 3, axis=2)).columns
    for name in ("player0", "player1"):
        distances = aside[f"distance made {name}"]
        assert np.isfinite(distances).all(), name
        assert (np.abs(distances - 3.0) < 1.0).mean() > 0.9  # in one frame the ball is before a player
        assert abs(np.median(distances) - 3.0) < 0.4
        assert (distances > straight[f"distance made {name}"] + 1.5).all()
    assert (aside["psnr final player0-alpha"] < 40).all()
    # Three pixels of these pictures are more than a ball may be off.
    assert np.isposinf(aside["distance made ball"]).all()
    nearer = figures(store, lambda picture: np.roll(picture, 1, axis=2)).columns["distance made ball"]
    assert abs(np.median(nearer) - 1.0) < 0.4 and near_share(nearer, 2.0) == 1.0


def test_who_is_not_made_is_missing_and_the_others_are_not(store):
    columns = figures(store, players=(1,), ball=False).columns
    assert score_of(columns["distance made player0"], 4.5, store.size).mdr == 1
    assert score_of(columns["distance made player1"], 4.5, store.size).mdr == 0
    assert score_of(columns["distance made ball"], 2.3, store.size).mdr == 1
    assert np.isposinf(columns["distance alpha player0"]).all()


def test_graphics_over_the_picture_are_not_judged(store):
    x0, y0, x1, y1 = store.ui_boxes_px(0)[0].astype(int)

    def scribbled(picture: np.ndarray) -> np.ndarray:
        picture = picture.copy()
        picture[:, y0 : y1 + 1, x0 : x1 + 1] = 1.0
        return picture

    columns = figures(store, scribbled).columns
    assert np.isposinf(columns["psnr final frame"]).all()
    np.testing.assert_allclose(columns["ms_ssim final frame"], 1.0, atol=1e-9)
    bare = replace(store, clips=tuple(replace(clip, ui_boxes_px=np.zeros((0, 4))) for clip in store.clips))
    assert (figures(bare, scribbled).columns["psnr final frame"] < 40).all()


def test_blocks_of_frames_do_not_show_in_the_figures(store):
    whole = figures(store, lambda picture: np.clip(picture * 0.9, 0, 1)).columns
    late = figures(store, lambda picture: np.clip(picture * 0.9, 0, 1), rows=np.arange(BLOCK - 2, FRAMES)).columns
    for name, values in whole.items():
        if name.startswith(("psnr", "ssim", "distance made", "change_psnr")):
            first = 1 if name.startswith("change") else 0
            np.testing.assert_allclose(late[name][first:], values[BLOCK - 2 :][first:], rtol=1e-12, err_msg=name)


def test_a_repeated_frame_and_a_gap_have_no_change(store):
    time = np.array(store.time)
    time[4] = time[3]
    repeated = replace(store, time=time)
    changes = figures(repeated, rows=np.array([2, 3, 4, 5, 7])).columns["change_psnr final frame"]
    assert np.isnan(changes).tolist() == [True, False, True, False, True]


def test_figures_come_back_from_json(store):
    found = figures(store, rows=np.arange(3))
    again = figures_from_json(figures_to_json(found))
    assert (again.clip, again.match, again.seconds) == (found.clip, found.match, found.seconds)
    for name, values in found.columns.items():
        np.testing.assert_array_equal(again.columns[name], values)
    with pytest.raises(ValueError, match="expected what figures_to_json writes"):
        figures_from_json({"clip": "a"})


def test_the_real_background_shows_nobody_and_needs_frames_enough(store):
    assert real_background(store, np.arange(3)) is None
    rows = np.resize(np.arange(FRAMES), 20)
    behind = real_background(store, rows)
    assert behind is not None and behind.shape == colours(store, 0).shape


def test_a_ball_behind_a_player_is_not_to_be_seen(store):
    camera, position = store.cameras[0], store.ball_position[0]
    column, row = project(camera, position[None])[0][0].round().astype(int)
    away = float(camera.R_cam_from_world[2] @ position + camera.t_cam_from_world[2])
    shape = (store.size[1], store.size[0])
    for label, depth, seen in ((1, away - 2.0, False), (1, away + 2.0, True), (4, away - 2.0, True)):
        labels, depths = np.full(shape, 4, np.uint8), np.full(shape, np.inf)
        labels[row, column], depths[row, column] = label, depth
        truth = TruePixels(labels=labels, depth=depths)
        places = places_of(store.scene, store.size, camera, store.boxes_px[0], position, truth)
        assert np.isfinite(places.ball_px).all() == seen, (label, depth)
        assert not places.boxes  # one pixel is no box


def test_true_pixels_are_those_that_were_written(tmp_path):
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 4, (5, 36, 64)).astype(np.uint8)
    depth = rng.uniform(1, 60, (5, 36, 64)).astype(np.float32)
    depth[:, :3] = np.inf
    write_masks(tmp_path, (Masks(labels=a, depth=b) for a, b in zip(labels, depth, strict=True)), fps=25.0)
    found = list(true_pixels(tmp_path, [1, 2, 4]))
    for one, number in zip(found, [1, 2, 4], strict=True):
        np.testing.assert_array_equal(one.labels, labels[number])
        np.testing.assert_allclose(one.depth, depth[number], atol=0.001)
        np.testing.assert_array_equal(one.mask(2, (64, 36)), labels[number] == 3)
        halves = (labels[number] == 3).reshape(18, 2, 32, 2).mean(axis=(1, 3)) >= 0.5
        np.testing.assert_array_equal(one.mask(2, (32, 18)), halves)
    with pytest.raises(ValueError, match="expected frame 9"):
        list(true_pixels(tmp_path, [1, 9]))
    with pytest.raises(ValueError, match="numbers that rise"):
        list(true_pixels(tmp_path, [2, 1]))
    with pytest.raises(ValueError, match="got nothing there"):
        list(true_pixels(tmp_path / "none", [0]))
