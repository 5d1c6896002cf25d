from functools import cache
from itertools import islice

import numpy as np
import pytest

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonFinder
from pgm_data.detect.players.person_network import (
    APART,
    CHANNELS,
    STRIDE,
    PersonCalibration,
    PersonNetwork,
    StripPeople,
    StripPeopleOptions,
    read_peaks,
)
from pgm_data.detect.players.person_strips import PERSON_PX
from pgm_data.geometry.camera import Camera
from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.tennis.film import tennis_shots

TENNIS = load_scene("tennis")
SIZE = (1280, 720)


@cache
def filmed():
    """A simulated match at two pictures a second: its clip's cameras, pictures, and the truth of its players."""
    seed, frames = 11, 3
    options = ClipOptions(frames=frames, fps=2.0, width=SIZE[0], height=SIZE[1], quality="draft", motion="follow")
    shot = next(iter(tennis_shots(TENNIS, options, seed)))
    track, rows = shot.track, len(shot)
    clip = ClipCamera(
        clip_id="sim",
        video_frame=np.arange(rows),
        timestamp=shot.timestamps,
        is_duplicate=shot.is_duplicate,
        capture_time=shot.capture_times,
        camera=Camera(
            K=track.K,
            distortion=track.distortion,
            R_cam_from_world=track.R_cam_from_world,
            t_cam_from_world=track.t_cam_from_world,
        ),
        status=np.full(rows, "measured", dtype=object),
        reason=np.full(rows, "", dtype=object),
        inliers=np.zeros(rows, np.int64),
        reprojection_px=np.zeros(rows),
        position_cov=np.zeros((rows, 6)),
        focal_std_px=np.zeros(rows),
    )
    return clip, [p.copy() for p in islice(shot.pictures(), rows)], shot.states.players


@cache
def shipped() -> StripPeople:
    """The finder with the network that ships."""
    return StripPeople.load()


def without_cameras(clip: ClipCamera, lost: np.ndarray, repeated: np.ndarray) -> ClipCamera:
    """The clip with no camera in some frames, and some that repeat others."""
    nan = np.where(lost, np.nan, 1.0)
    camera = clip.camera
    return ClipCamera(
        clip_id=clip.clip_id,
        video_frame=clip.video_frame,
        timestamp=clip.timestamp,
        is_duplicate=repeated,
        capture_time=clip.capture_time,
        camera=Camera(
            K=camera.K * nan[:, None, None],
            distortion=camera.distortion * nan[:, None],
            R_cam_from_world=camera.R_cam_from_world * nan[:, None, None],
            t_cam_from_world=camera.t_cam_from_world * nan[:, None],
        ),
        status=np.where(lost, "none", "measured").astype(object),
        reason=clip.reason,
        inliers=clip.inliers,
        reprojection_px=clip.reprojection_px,
        position_cov=clip.position_cov,
        focal_std_px=clip.focal_std_px,
    )


def test_both_players_of_a_simulated_match_are_found_where_they_stand():
    clip, pictures, players = filmed()
    finder = shipped()
    assert isinstance(finder, PersonFinder)
    people = finder.find(lambda: iter(pictures), clip, size=SIZE, scene=TENNIS)
    assert (np.diff(people.frame) >= 0).all()
    ankles = [TENNIS.players[0].skeleton.joint_names.index(name) for name in ("L_Ankle", "R_Ankle")]
    found = 0
    for frame in range(len(pictures)):
        here = np.flatnonzero(people.frame == frame)
        for player in players:
            feet = player.joints[frame, ankles, :2].mean(axis=0)
            away = np.abs(people.ground_world[here] - feet)
            near = here[(away[:, 0] < 0.5) & (away[:, 1] < 1.5)]
            found += bool((people.person[near] > 0.5).any())
    assert found >= 2 * len(pictures) - 1
    assert ((people.person >= 0) & (people.person <= 1) & (people.player >= 0) & (people.player <= 1)).all()
    assert (people.boxes_px[:, 2:] > people.boxes_px[:, :2]).all()


def test_frames_without_a_camera_and_repeats_are_not_looked_at():
    clip, pictures, _ = filmed()
    lost, repeated = np.array([False, True, False]), np.array([False, False, True])
    people = shipped().find(lambda: iter(pictures), without_cameras(clip, lost, repeated), size=SIZE, scene=TENNIS)
    assert set(people.frame.tolist()) == {0}


def test_every_second_frame_is_every_second_one():
    clip, pictures, _ = filmed()
    everywhere = shipped().find(lambda: iter(pictures), clip, size=SIZE, scene=TENNIS)
    people = StripPeople.load(every=2).find(lambda: iter(pictures), clip, size=SIZE, scene=TENNIS)
    assert set(people.frame.tolist()) == {0, 2}
    kept = np.isin(everywhere.frame, [0, 2])
    np.testing.assert_allclose(people.boxes_px, everywhere.boxes_px[kept], atol=1e-3)
    with pytest.raises(ValueError, match="every: expected 1 or more, got 0"):
        StripPeople.load(every=0)


def test_an_empty_picture_shows_nobody_and_a_clip_without_cameras_no_rows():
    clip, pictures, _ = filmed()
    grey = [np.full_like(p, 90) for p in pictures]
    people = shipped().find(lambda: iter(grey), clip, size=SIZE, scene=TENNIS)
    assert (people.person < 0.5).all()
    lost = np.ones(len(pictures), bool)
    none = shipped().find(lambda: iter(grey), without_cameras(clip, lost, ~lost), size=SIZE, scene=TENNIS)
    assert none.boxes_px.shape == (0, 4) and none.ground_world.shape == (0, 2) and none.frame.dtype == np.int64


def test_pictures_that_do_not_belong_to_the_clip_are_refused():
    clip, pictures, _ = filmed()
    with pytest.raises(ValueError, match="sim: expected 3 pictures, got 2"):
        shipped().find(lambda: iter(pictures[:2]), clip, size=SIZE, scene=TENNIS)
    with pytest.raises(ValueError, match="frame 0: expected a picture of 640x360, got 1280x720"):
        shipped().find(lambda: iter(pictures), clip, size=(640, 360), scene=TENNIS)


def test_files_that_hold_no_person_network_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="person network"):
        PersonNetwork.load(tmp_path / "none.onnx")
    (tmp_path / "no.onnx").write_text("no network")
    with pytest.raises(ValueError, match="expected an ONNX file"):
        PersonNetwork.load(tmp_path / "no.onnx")


def test_fewer_are_kept_when_more_is_asked_of_them():
    clip, pictures, _ = filmed()
    counts = []
    for least, most in ((0.05, 50), (0.5, 50), (0.05, 2)):
        options = StripPeopleOptions(least_person=least, most=most)
        people = StripPeople.load(options=options).look(pictures[0], clip.camera[0], scene=TENNIS)
        assert (people.person >= least - 1e-6).all()
        counts.append(len(people.person))
    assert counts[0] > counts[1] and counts[2] == 2


def test_peaks_are_those_of_the_slow_search():
    answers = np.random.default_rng(0).normal(0, 2, (3, len(CHANNELS), 6, 9)).astype(np.float32)
    peaks = read_peaks(answers, least=1.0)
    expected = []
    for strip in range(3):
        for row in range(6):
            for column in range(9):
                said = answers[strip, :, row, column]
                r, c = max(row - APART, 0), max(column - APART, 0)
                around = answers[strip, 0, r : row + APART + 1, c : column + APART + 1]
                if said[0] >= 1.0 and said[0] >= around.max():
                    x, y = (column + 0.5) * STRIDE - 0.5, (row + 0.5) * STRIDE - 0.5
                    left, top, right, down, feet_x, feet_y = PERSON_PX * said[2:].astype(float)
                    box = (x - left, y - top, x + right, y + down)
                    expected.append((strip, x + feet_x, y + feet_y, *box, float(said[0]), float(said[1])))
    expected = np.array(sorted(expected, key=lambda row: -row[-2]))
    found = np.column_stack([peaks.strip, peaks.feet, peaks.box, peaks.person, peaks.player])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert len(expected) > 5


def test_calibration_is_a_logistic_curve():
    said = PersonCalibration(person_slope=2.0, person_shift=1.0, player_slope=0.5, player_shift=0.0)
    np.testing.assert_allclose(said.person(np.array([-0.5, 0.0])), [0.5, 1 / (1 + np.exp(-1.0))])
    np.testing.assert_allclose(said.player(np.array([0.0, 1e9, -1e9])), [0.5, 1.0, 0.0], atol=1e-12)
