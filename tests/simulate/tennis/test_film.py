"""A filmed match: its truth lies where its pictures show things, and its extremes are filmed too."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.pictures.stage import Moment
from pgm_data.simulate.shots import SimulatedShot
from pgm_data.simulate.tennis.film import recording_of, tennis_shots
from pgm_data.simulate.tennis.match import plays
from pgm_data.simulate.tennis.pictures import MatchPictures
from pgm_data.simulate.tennis.truth import ball_at, play_states
from pgm_data.simulate.views import View, framed_pose

TENNIS = load_scene("tennis")
SMALL = ClipOptions(frames=6, width=320, height=180, motion="still")


def _opencv(points: np.ndarray, view: View) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(view.R_cam_from_world)
    px, _ = cv2.projectPoints(points, rotation, view.t_cam_from_world, view.K, np.array([view.k1, 0.0, 0.0, 0.0]))
    return px.reshape(-1, 2)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_the_ball_is_drawn_where_opencv_projects_its_position(share: float) -> None:
    options = replace(SMALL, width=1280, height=720, clean=True, shutter=share, fps=50.0)
    recording = recording_of(TENNIS, options, 5)
    pictures = MatchPictures(recording)
    play = next(plays(recording.match, np.random.default_rng(3)))
    serve = play.strokes[0].time
    times = serve + np.array([0.03, 0.13, 0.21, 0.33])
    view = recording.base.view((1280, 720))
    truth = _opencv(ball_at(play, times)[0], view)
    moments = list(pictures.moments(play, times, recording.shutter_s))
    for moment, px in zip(moments, truth, strict=True):
        assert moment.ball is not None
        # The ball is bright and its shadow dark: what gets brighter is the ball.
        seen = pictures.stage.picture(view, Moment(actors=(), ball=moment.ball)).copy()
        bare = pictures.stage.picture(view, Moment(actors=(), ball=None))
        x0, y0 = (np.round(px) - 40).astype(int)
        change = np.clip(seen - bare, 0.0, None).sum(axis=2)[max(y0, 0) : y0 + 81, max(x0, 0) : x0 + 81]
        rows, columns = np.mgrid[: change.shape[0], : change.shape[1]]
        centroid = np.array([(columns * change).sum(), (rows * change).sum()]) / change.sum() + [max(x0, 0), max(y0, 0)]
        # Over a whole frame the streak bends and shrinks a little; its middle is not its centroid exactly.
        assert np.linalg.norm(centroid - px) < (0.25 if share == 0.0 else 2.0)


def test_players_are_drawn_inside_of_their_boxes_and_their_masks_hold_their_joints() -> None:
    options = replace(SMALL, width=1280, height=720, clean=True, frames=120)
    shot = next(iter(tennis_shots(TENNIS, options, 2)))
    assert shot.states is not None and shot.masks is not None
    masks = list(shot.masks())
    for frame in (0, 60, 119):
        view = View(
            K=shot.track.K[frame],
            k1=float(shot.track.distortion[frame, 0]),
            R_cam_from_world=shot.track.R_cam_from_world[frame],
            centre_world=-shot.track.R_cam_from_world[frame].T @ shot.track.t_cam_from_world[frame],
        )
        for player in (0, 1):
            px = np.rint(_opencv(shot.states.players[player].joints[frame], view)).astype(int)
            inside = (px >= 0).all(axis=1) & (px < [1280, 720]).all(axis=1)
            labels = masks[frame].labels[px[inside, 1], px[inside, 0]]
            # Hands and toes are thin: a joint at their edge may round to the pixel beside.
            assert (labels == 1 + player).mean() > 0.8
            depth = masks[frame].depth[masks[frame].labels == 1 + player]
            distance = (shot.states.players[player].joints[frame] @ view.R_cam_from_world.T + view.t_cam_from_world)[
                :, 2
            ]
            assert abs(np.median(depth) - np.median(distance)) < 0.5


def test_pictures_are_the_same_whenever_they_are_drawn() -> None:
    shots = list(tennis_shots(TENNIS, replace(SMALL, frames=3), 4))
    again = list(tennis_shots(TENNIS, replace(SMALL, frames=3), 4))
    for a, b in zip(shots, again, strict=True):
        for p, q, r in zip(a.pictures(), b.pictures(), a.pictures(), strict=True):
            np.testing.assert_array_equal(p, q)
            np.testing.assert_array_equal(p, r)


def test_truth_does_not_depend_on_pictures_or_their_size() -> None:
    def states(options: ClipOptions) -> SimulatedShot:
        return next(iter(tennis_shots(TENNIS, options, 6)))

    one, other = states(SMALL), states(replace(SMALL, width=1280, height=720, quality="draft"))
    assert one.states is not None and other.states is not None
    for a, b in zip(one.states.players, other.states.players, strict=True):
        np.testing.assert_array_equal(a.joints, b.joints)
    assert [c.texts for c in one.states.captions] == [c.texts for c in other.states.captions]


@pytest.mark.parametrize(
    "extreme",
    [
        {"fps": 1.0, "frames": 12, "shutter": 1.0},
        {"fps": 240.0, "frames": 12, "surface": "clay"},
        {"frames": 1, "width": 64, "height": 36},
        {"shutter": 0.0, "wind_ms": (0.0, 0.0)},
        {"wind_ms": (25.0, -25.0), "frames": 40},
        {"duplicates": True, "frames": 7},
    ],
)
def test_extremes_are_filmed(extreme: dict) -> None:
    options = replace(SMALL, **extreme)
    shots = list(tennis_shots(TENNIS, options, 1))
    assert sum(len(shot) for shot in shots) == options.frames
    for shot in shots:
        assert shot.states is not None and shot.states.ball is not None
        for player in shot.states.players:
            assert np.isfinite(player.joints).all()
            assert player.joints[..., 2].min() > -0.01
        pictures = list(shot.pictures())
        assert len(pictures) == len(shot)
        assert all(p.shape == (options.height, options.width, 3) and p.std() > 1.0 for p in pictures)


@pytest.mark.parametrize(
    ("centre", "aim"),
    [((0.0, -30.0, 0.05), (0.0, 0.0, 1.0)), ((0.0, 0.0, 45.0), (0.0, 0.0, 0.0)), ((0.0, -1.0, 30.0), (0.0, 0.0, 0.0))],
)
def test_a_camera_on_the_ground_and_one_straight_above_see_the_players(centre: tuple, aim: tuple) -> None:
    recording = recording_of(TENNIS, replace(SMALL, clean=True), 3)
    pictures = MatchPictures(recording)
    play = next(plays(recording.match, np.random.default_rng(3)))
    pose = framed_pose(
        centre_world=np.array(centre),
        aim_world=np.array(aim),
        aim_px=(160.0, 90.0),
        roll=0.0,
        focal_px=max(200.0 if centre[2] < 1.0 else 0.0, 5.0 * centre[2]),
        principal_px=(159.5, 89.5),
        k=0.0,
    )
    if centre[2] > 40.0:
        pose = replace(pose, heading=0.0, tilt=-0.5 * np.pi)
    view = pose.view((320, 180))
    times = np.array([1.0])
    moment = next(iter(pictures.moments(play, times, 0.0)))
    picture = pictures.stage.picture(view, moment)
    assert np.isfinite(picture).all()
    masks = pictures.stage.masks(view, moment)
    joints = play_states(play, times, np.random.default_rng(0)).players[0].joints[0]
    px = np.rint(_opencv(joints[:1], view)[0]).astype(int)
    assert masks.labels[px[1], px[0]] == 1
