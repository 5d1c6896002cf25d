import os
from dataclasses import replace

import av
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from pgm_data.stages.court_drawing import (
    LINE_COLOURS,
    NET_COLOUR,
    clipped,
    court_strokes,
    draw_court,
    draw_label,
    resized,
)
from pgm_data.stages.overlay import key_frame_indices, saved_key_frames, write_overlay, write_overlays
from pgm_data.video import open_video
from tests.convert.folders import FPS, cameras, numbered_video, track, write_work
from tests.geometry.strategies import cameras as any_camera

SCENE = load_scene("tennis")
STROKES = court_strokes(SCENE.court)
SIZE = (640, 360)


def court_picture(camera: Camera, status: str = "measured") -> np.ndarray:
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    draw_court(picture, STROKES, camera, status)
    return picture


def near(picture: np.ndarray, pixel: np.ndarray, colour: tuple[int, int, int]) -> bool:
    """Whether the colour stands, bright, within a pixel of the place."""
    x, y = (int(round(value)) for value in pixel)
    patch = picture[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].reshape(-1, 3).astype(int)
    return bool((np.abs(patch - colour).sum(axis=1) < 150).any())


def test_lines_run_where_opencv_projects_their_centres():
    camera = cameras(1, size=SIZE, distortion=(-0.2, 0.05, 1e-3, -1e-3))[0]
    picture = court_picture(camera)
    share = np.linspace(0.02, 0.98, 25)[:, None]
    for ends in SCENE.court.lines_world:
        points = ends[0] * (1 - share) + ends[1] * share
        rotation = cv2.Rodrigues(camera.R_cam_from_world)[0]
        pixels = cv2.projectPoints(points, rotation, camera.t_cam_from_world, camera.K, camera.distortion)[0][:, 0]
        inside = ((pixels > 2) & (pixels < np.array(SIZE) - 3)).all(axis=1)
        on_net = np.array([near(picture, pixel, NET_COLOUR) for pixel in pixels])
        assert all(near(picture, pixel, LINE_COLOURS["measured"]) for pixel in pixels[inside & ~on_net])
    assert near(picture, project(camera, SCENE.court.net_world)[0][1], NET_COLOUR)


def test_interpolated_courts_are_dashed_and_of_another_colour():
    camera = cameras(1, size=SIZE)[0]

    def share_of_net(status: str, colour) -> float:
        return float((np.abs(court_picture(camera, status).astype(int) - colour).sum(axis=2) < 100).mean())

    full = share_of_net("measured", LINE_COLOURS["measured"])
    dashed = share_of_net("interpolated", LINE_COLOURS["interpolated"])
    assert 0.3 * full < dashed < 0.7 * full
    assert share_of_net("interpolated", LINE_COLOURS["measured"]) == 0.0


def test_a_camera_of_nan_draws_nothing():
    nan = Camera(
        K=np.full((3, 3), np.nan),
        distortion=np.full(4, np.nan),
        R_cam_from_world=np.full((3, 3), np.nan),
        t_cam_from_world=np.full(3, np.nan),
    )
    assert not court_picture(nan).any()


def test_a_court_behind_the_camera_draws_nothing():
    camera = cameras(1, size=SIZE)[0]
    turned = np.diag([-1.0, 1.0, -1.0]) @ camera.R_cam_from_world
    behind = replace(camera, R_cam_from_world=turned, t_cam_from_world=-turned @ np.array([0.0, -60.0, 9.0]))
    assert not court_picture(behind).any()


@settings(max_examples=40)
@given(any_camera(tangential=True))
def test_no_camera_however_odd_breaks_the_drawing(camera):
    court_picture(camera)


@given(any_camera(), st.floats(0.1, 1.0), st.floats(0.1, 1.0))
@settings(max_examples=40)
def test_a_resized_camera_sees_each_pixel_where_the_resized_picture_has_it(camera, sx, sy):
    scale = np.array([sx, sy])
    pixels, seen = project(camera, STROKES.points_world)
    small, seen_small = project(resized(camera, scale), STROKES.points_world)
    # A point on the very fold of an odd lens is seen or not by its last bit.
    assert np.mean(seen == seen_small) > 0.99
    expected = (pixels + 0.5) * scale - 0.5
    both = seen & seen_small
    np.testing.assert_allclose(small[both], expected[both], rtol=1e-9, atol=1e-6)


@given(arrays(np.float64, (5, 2, 2), elements=st.floats(-300, 300)))
def test_clipping_keeps_what_lies_inside_and_nothing_else(pieces):
    low, high = np.array([-10.0, -20.0]), np.array([100.0, 50.0])
    share = np.linspace(0, 1, 301)[:, None]

    def samples(piece: np.ndarray) -> np.ndarray:
        return piece[0] * (1 - share) + piece[1] * share

    inside = clipped(pieces, low, high)
    assert ((inside >= low - 1e-9) & (inside <= high + 1e-9)).all()
    for piece in pieces:
        points = samples(piece)
        points = points[((points > low + 1) & (points < high - 1)).all(axis=1)]
        if len(points):
            near_some = [np.abs(samples(part)[:, None] - points).sum(axis=2).min(axis=0).max() for part in inside]
            assert min(near_some, default=np.inf) < 5.0


def test_pieces_with_a_nan_end_are_left_out_and_endless_ones_cut():
    low, high = np.zeros(2), np.full(2, 10.0)
    pieces = np.array([[[1.0, 1.0], [np.nan, 2.0]], [[5.0, -1e8], [5.0, 1e8]]])
    np.testing.assert_allclose(clipped(pieces, low, high), [[[5.0, 0.0], [5.0, 10.0]]], atol=1e-3)


def test_a_label_of_any_text_is_drawn_on_the_smallest_picture():
    for shape in ((1, 1, 3), (20, 10, 3), (360, 640, 3)):
        picture = np.full(shape, 200, np.uint8)
        draw_label(picture, ("frame 1 \u2028 \U0001f3be \x00", "x" * 500), "none")
        assert picture.min() < 200


def test_key_frames_show_the_worst_residual_a_missing_and_an_interpolated_camera_and_the_ends():
    status = np.full(100, "measured", dtype=object)
    residual = np.full(100, 0.4)
    residual[37], residual[60] = 1.2, np.nan
    status[50:53], status[71] = "interpolated", "none"
    residual[71] = np.nan
    assert key_frame_indices(status, residual).tolist() == [0, 37, 50, 51, 71, 99]


@pytest.mark.parametrize("frames", [1, 2, 5, 6, 7, 1000])
@pytest.mark.parametrize("word", ["measured", "interpolated", "none"])
def test_key_frames_are_frames_of_the_clip_however_short(frames, word):
    chosen = key_frame_indices(np.full(frames, word, dtype=object), np.full(frames, np.nan))
    assert 1 <= len(chosen) <= 6
    assert chosen.min() >= 0 and chosen.max() < frames
    assert (np.diff(chosen) > 0).all()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    root = tmp_path_factory.mktemp("overlay")
    numbered_video(root / "match.mp4", 30, SIZE)
    tracks = [
        track("b", cameras(12, size=SIZE, seed=1), none=(4, 11), interpolated=(2,), first=15),
        track("a", cameras(8, size=SIZE), first=2),
    ]
    write_work(root / "work", tracks, root / "match.mp4", size=SIZE, video_frames=30)
    return root


def test_an_overlay_keeps_frames_and_times_and_plays_in_browsers(made):
    key_frames = write_overlay(made / "work", "b", video=made / "match.mp4", scene=SCENE)
    path = made / "work" / "b" / "overlay.mp4"
    with open_video(path) as reader:
        frames = list(reader)
        assert reader.trouble == ""
    times = np.array([frame.timestamp for frame in frames])
    np.testing.assert_allclose(times, np.arange(12) / FPS, atol=2e-5)
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        assert (context.name, context.pix_fmt, context.width, context.height) == ("h264", "yuv420p", *SIZE)
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")
    assert [key_frame.frame_index for key_frame in key_frames] == [0, 2, 6, 10, 11]
    assert [key_frame.frame_index for key_frame in saved_key_frames(made / "work" / "b")] == [0, 2, 6, 10, 11]


def test_clips_of_one_video_are_written_in_one_pass_over_it(made, monkeypatch):
    from pgm_data.stages import overlay

    opened = []
    monkeypatch.setattr(overlay, "open_video", lambda path: opened.append(path) or open_video(path))
    key_frames = write_overlays(made / "work", ("b", "a"), video=made / "match.mp4", scene=SCENE)
    assert len(opened) == 1
    for clip_id, first in (("a", 2), ("b", 15)):
        for key_frame in key_frames[clip_id]:
            picture = cv2.imdecode(np.frombuffer(key_frame.jpeg, np.uint8), cv2.IMREAD_COLOR)
            assert abs(np.median(picture[-40:]) - (40 + 5 * (first + key_frame.frame_index))) < 3


def test_a_frame_without_a_camera_shows_no_court_but_says_why(made):
    write_overlay(made / "work", "b", video=made / "match.mp4", scene=SCENE)
    by_index = {key_frame.frame_index: key_frame for key_frame in saved_key_frames(made / "work" / "b")}

    def spread(index: int) -> tuple[float, float]:
        picture = cv2.imdecode(np.frombuffer(by_index[index].jpeg, np.uint8), cv2.IMREAD_COLOR)
        return float(picture[:60, :300].std()), float(picture[80:].std())

    label, court = spread(0)
    assert label > 10 and court > 5
    label, court = spread(11)
    assert label > 10 and court < 1


def test_a_wide_picture_is_made_smaller_and_an_odd_one_stays_whole(tmp_path):
    size = (641, 361)
    numbered_video(tmp_path / "v.mp4", 3, size)
    with open_video(tmp_path / "v.mp4") as reader:
        shown = (reader.info.width, reader.info.height)
    write_work(tmp_path / "w", [track("c", cameras(3, size=shown))], tmp_path / "v.mp4", size=shown, video_frames=3)
    for max_width, width, height in ((320, 320, 180), (1280, 642, 362)):
        write_overlay(tmp_path / "w", "c", video=tmp_path / "v.mp4", scene=SCENE, max_width=max_width)
        with open_video(tmp_path / "w" / "c" / "overlay.mp4") as reader:
            assert abs(reader.info.width - width) <= 1 and abs(reader.info.height - height) <= 2


def test_a_scene_without_a_court_gets_its_label_only(made):
    key_frames = write_overlay(made / "work", "a", video=made / "match.mp4", scene=load_scene("blocks"))
    picture = cv2.imdecode(np.frombuffer(key_frames[0].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture[80:].std() < 1 < picture[:60].std()


def test_a_video_that_ends_before_the_clip_leaves_no_overlay(made, tmp_path):
    numbered_video(tmp_path / "short.mp4", 20, SIZE)
    (made / "work" / "b" / "overlay.mp4").unlink(missing_ok=True)
    with pytest.raises(ValueError, match="short.mp4: b: expected frame 20 of the video, got its end"):
        write_overlay(made / "work", "b", video=tmp_path / "short.mp4", scene=SCENE)
    assert not [name for name in os.listdir(made / "work" / "b") if "overlay" in name]


def test_clips_that_share_frames_are_refused(tmp_path):
    numbered_video(tmp_path / "v.mp4", 6, SIZE)
    tracks = [track("c", cameras(4, size=SIZE)), track("d", cameras(3, size=SIZE), first=3)]
    write_work(tmp_path / "w", tracks, tmp_path / "v.mp4", size=SIZE, video_frames=8)
    with pytest.raises(ValueError, match="expected clips that share no frame, got c, d"):
        write_overlays(tmp_path / "w", ("c", "d"), video=tmp_path / "v.mp4", scene=SCENE)
