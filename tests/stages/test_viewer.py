from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pgm_data.dataset.clip_ball import BALL_TABLES
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.scene import load_scene
from pgm_data.stages.ball_paths import flight_paths
from pgm_data.stages.viewer_scene import (
    HITTER_COLOURS,
    clip_scene,
    ellipsoid,
    flight_segments,
    frustum,
    hitter_colours,
    net_segments,
    quaternion,
    viewable_clips,
)
from tests.convert.folders import cameras, track
from tests.simulate.store_worlds import SIZE, write_truth_clip
from tests.stages.ball_clips import known_ball

TENNIS = load_scene("tennis")
BALL = known_ball(track("rally", cameras(24)))
PATHS = flight_paths(BALL)
ROTVECS = arrays(np.float64, 3, elements=st.floats(-3, 3))


def rotation_of(wxyz):
    """The rotation of a unit quaternion, by the textbook."""
    w, x, y, z = wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(ROTVECS)
def test_a_quaternion_turns_as_its_rotation_does(rotvec):
    R = rotation_from_rotvec(rotvec)
    np.testing.assert_allclose(rotation_of(quaternion(R)), R, atol=1e-12)


@given(arrays(np.float64, (3, 3), elements=st.floats(-1, 1)))
def test_an_ellipsoid_has_the_covariance_as_the_sum_of_its_half_axes_squared(root):
    cov = root @ root.T + 1e-4 * np.eye(3)
    wxyz, half = ellipsoid(cov, least_m=0.0)
    R = rotation_of(wxyz)
    np.testing.assert_allclose(R @ np.diag(half**2) @ R.T, cov, atol=1e-9)
    assert (ellipsoid(np.zeros((3, 3)), least_m=0.01)[1] == 0.01).all()


def test_the_flights_of_each_hitter_are_joined_within_flights_alone():
    colours = hitter_colours(PATHS)
    assert list(colours) == ["", "near end", "player1"] and list(colours.values()) == list(HITTER_COLOURS[:3])
    pieces = {name: flight_segments(PATHS, name) for name in colours}
    assert [len(own) for own in pieces.values()] == [0, PATHS.first[3] - PATHS.first[2] - 1, PATHS.first[2] - 2]
    lengths = np.linalg.norm(np.diff(np.concatenate(list(pieces.values())), axis=1)[:, 0], axis=1)
    assert lengths.max() < 2.0
    nowhere = replace(PATHS, points_world=np.full_like(PATHS.points_world, np.nan))
    assert not len(flight_segments(nowhere, "player1"))


def test_the_net_hangs_from_its_upper_edge_to_the_ground():
    pieces = net_segments(TENNIS.court)
    tops = TENNIS.court.net_world
    np.testing.assert_allclose(pieces[:2], np.stack([tops[:-1], tops[1:]], axis=1))
    cords = pieces[2:]
    assert (cords[:, 1, 2] == 0).all() and cords[:, 0, 2].min() == pytest.approx(0.914)
    np.testing.assert_array_equal(cords[:, 0, :2], cords[:, 1, :2])
    assert net_segments(replace(TENNIS.court, net_top=())).shape == (0, 2, 3)


def test_a_frustum_stands_where_the_camera_is_and_opens_as_wide():
    one = track("rally", cameras(3, distortion=(0.0, 0.0, 0.0, 0.0)))
    wxyz, position, fov = frustum(one, 1, (320, 180))
    np.testing.assert_allclose(rotation_of(wxyz).T, one.camera.R_cam_from_world[1], atol=1e-12)
    np.testing.assert_allclose(position, one.camera.position_world[1])
    assert np.tan(fov / 2) * one.camera.K[1, 1, 1] == pytest.approx(90)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    write_truth_clip(folder / "a", TENNIS)
    write_truth_clip(folder / "b", TENNIS, without=("ball", "players"), seed=1)
    return folder


def test_a_clip_shows_what_its_folder_holds(work):
    assert [folder.name for folder in viewable_clips(work)] == ["a", "b"]
    clip = clip_scene(work / "a")
    assert clip.size == SIZE and clip.ball is not None and len(clip.paths) == 5
    assert clip.bones.shape == (30, 2, 23, 2, 3) and np.isfinite(clip.bones).all()
    # Each bone begins where its parent ends, and keeps its length.
    lengths = np.linalg.norm(np.diff(clip.bones, axis=3)[..., 0, :], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(lengths[:1], lengths.shape), atol=1e-5)
    other = clip_scene(work / "b")
    assert other.ball is None and other.paths is None and other.bones.shape == (30, 0, 0, 2, 3)


def test_the_folder_of_a_track_is_a_clip_without_cameras(work, tmp_path):
    for name in BALL_TABLES:
        (tmp_path / f"{name}.parquet").write_bytes((work / "a" / f"{name}.parquet").read_bytes())
    assert viewable_clips(tmp_path) == (tmp_path,)
    clip = clip_scene(tmp_path)
    assert clip.camera is None and clip.size is None and clip.scene.name == "tennis" and len(clip.capture_time) == 30


def test_a_folder_without_clips_or_with_bad_ones_is_refused(work, tmp_path):
    (tmp_path / "empty").mkdir()
    for path, said in ((tmp_path, "expected clips"), (tmp_path / "nothing", "nothing there")):
        with pytest.raises(ValueError, match=said):
            viewable_clips(path)
    with pytest.raises(ValueError, match="scene"):
        clip_scene(work / "a", "polo")


class Until:
    """True when it has been asked so many times."""

    def __init__(self, times):
        self.left = times

    def __call__(self):
        self.left -= 1
        return self.left < 0


@pytest.fixture
def server():
    viser = pytest.importorskip("viser", reason="the extra viz is not installed")
    found = viser.ViserServer(host="127.0.0.1", port=18190, verbose=False)
    yield found
    found.stop()


def test_the_viewer_moves_ball_players_and_camera_to_a_frame(work, server):
    from pgm_data.stages.viewer import ClipViewer

    clip = clip_scene(work / "a")
    viewer = ClipViewer(server, clip)
    assert not viewer.ball.visible and "ball: none" in viewer.text.content  # it comes in the third frame
    viewer.slider.value = 10
    assert viewer.frame == 10 and viewer.ball.visible and viewer.bones[1].visible and viewer.frustum.visible
    np.testing.assert_allclose(viewer.ball.position, clip.ball.position[10])
    np.testing.assert_allclose(viewer.shadow.position, clip.ball.position[10] * [1, 1, 0])
    np.testing.assert_allclose(viewer.bones[0].points, clip.bones[10, 0], rtol=1e-6)
    np.testing.assert_allclose(viewer.frustum.position, clip.camera.camera.position_world[10])
    assert "frame 10, 0.400 s" in viewer.text.content
    viewer.show(10_000)
    assert viewer.frame == 29


def test_the_viewer_plays_by_the_clips_clock_and_begins_again(work, server):
    from pgm_data.stages.viewer import ClipViewer

    viewer = ClipViewer(server, clip_scene(work / "a"))
    viewer.advance(0.5)
    assert viewer.frame == 0
    viewer.play.value = True
    viewer.advance(0.05)
    assert viewer.frame == 1
    viewer.advance(0.05)  # what is left over of one step counts in the next
    assert viewer.frame == 2
    viewer.speed.value = 2.0
    viewer.advance(0.21)
    assert viewer.frame == 13 and viewer.slider.value == 13
    viewer.slider.value = 28
    viewer.advance(0.045)
    assert viewer.frame == 0


def test_another_clip_is_chosen_from_the_list(work, server):
    from pgm_data.stages.viewer import ClipViewer, run_viewer

    made = []

    def maker(name):
        def make():
            made.append(name)
            return ClipViewer(server, clip_scene(work / name))

        return make

    run_viewer(server, {name: maker(name) for name in "ab"}, first="b", until=Until(4))
    assert made == ["b"]
