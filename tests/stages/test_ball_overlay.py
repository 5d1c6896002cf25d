from dataclasses import replace

import numpy as np
import pytest

from pgm_data.dataset.clip_ball import write_clip_ball
from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_data.stages.ball_overlay import (
    DETECTED,
    EVENT_COLOURS,
    PAST,
    TO_COME,
    ball_label,
    ball_strokes,
    draw_ball,
)
from pgm_data.stages.ball_paths import SAMPLES, flight_paths, spin_class
from pgm_data.stages.overlay import write_overlays
from pgm_data.video import open_video
from tests.convert.folders import cameras, numbered_video, track, write_work
from tests.stages.ball_clips import GRAVITY, known_ball

SIZE = (640, 360)
TRACK = track("rally", cameras(24, size=SIZE, zoom=False))
BALL = known_ball(TRACK)
STROKES = ball_strokes(BALL, ground_half_size=(9.15, 18.3), floor_z=0.0)
ONE = np.ones(2)


def picture_of(index, *, strokes=STROKES, camera=None, scale=ONE):
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    draw_ball(picture, strokes, TRACK.camera[index] if camera is None else camera, index, scale)
    return picture


def pixel_of(point, index):
    return project(TRACK.camera[index], np.asarray(point, dtype=float)[None])[0][0]


def near(picture, pixel, colour, within=1):
    """Whether the colour stands within some pixels of the place."""
    x, y = (round(float(value)) for value in pixel)
    patch = picture[max(y - within, 0) : y + within + 1, max(x - within, 0) : x + within + 1].reshape(-1, 3).astype(int)
    return bool((np.abs(patch - colour).sum(axis=1) < 100).any())


def test_flights_run_through_frames_and_events_as_the_ball_flew():
    paths = flight_paths(BALL)
    assert len(paths) == 3 and paths.rally.tolist() == [0, 0, 0]
    assert paths.hitter.tolist() == ["player1", "player1", "near end"]
    for flight in range(3):
        own = paths.samples(flight)
        times, points = paths.times[own], paths.points_world[own]
        start, end = BALL.events.position[[flight, flight + 1]]
        span = times[-1] - times[0]
        since = (times - times[0])[:, None]
        chord = (end - start) / span - 0.5 * GRAVITY * span
        np.testing.assert_allclose(points, start + since * chord + 0.5 * since**2 * GRAVITY, atol=1e-9)
        assert (np.diff(times) > 0).all() and len(times) % SAMPLES == 1


def test_a_ball_not_placed_in_a_frame_breaks_its_path_there_alone():
    position = np.array(BALL.position)
    position[5] = np.nan
    paths = flight_paths(replace(BALL, position=position))
    gone = np.isnan(paths.points_world[:, 0])
    near_gap = np.abs(paths.times - BALL.capture_time[5]) < np.diff(BALL.capture_time).max() - 1e-9
    np.testing.assert_array_equal(gone, near_gap)


def test_two_plays_are_two_rallies():
    kinds = np.array(["hit", "last", "first", "net"], dtype=object)
    shots = replace(BALL.shots, **{name: getattr(BALL.shots, name)[[0, 2]] for name in BALL.shots.__dataclass_fields__})
    paths = flight_paths(replace(BALL, events=replace(BALL.events, kind=kinds), shots=shots))
    assert paths.rally.tolist() == [0, 1] and paths.hitter.tolist() == ["player1", ""]


def test_a_clip_without_flights_has_no_paths():
    shots = replace(BALL.shots, **{name: getattr(BALL.shots, name)[:0] for name in BALL.shots.__dataclass_fields__})
    paths = flight_paths(replace(BALL, shots=shots))
    assert len(paths) == 0 and paths.at(BALL.capture_time[3]) is None and paths.points_world.shape == (0, 3)


def test_the_flight_is_thick_where_the_ball_has_been_and_thin_where_it_goes():
    index = 7
    picture = picture_of(index)
    flown, coming = BALL.position[4], BALL.position[10]
    assert near(picture, pixel_of(flown, index), PAST) and near(picture, pixel_of(coming, index), TO_COME)
    assert not near(picture, pixel_of(coming, index), PAST)
    # The flight back is not this one.
    assert not near(picture, pixel_of(BALL.position[-3], index), TO_COME, within=0)


def test_contacts_show_after_they_happen_and_fade():
    bounce = len(TRACK.capture_time) // 2
    ring = BALL.events.position[1] * [1, 1, 0] + [0.25, 0, 0]
    colour = EVENT_COLOURS["bounce"]
    assert not near(picture_of(bounce - 1), pixel_of(ring, bounce - 1), colour)
    assert near(picture_of(bounce), pixel_of(ring, bounce), colour)
    assert near(picture_of(2), pixel_of(BALL.events.position[0], 2), EVENT_COLOURS["hit"], within=8)


def test_what_the_detector_saw_is_ringed_at_its_place_in_the_smaller_picture():
    pixel = np.array(BALL.pixel)
    pixel[0] = [400.0, 200.0]
    strokes = ball_strokes(replace(BALL, pixel=pixel), ground_half_size=(9.15, 18.3), floor_z=0.0)
    nowhere = track("none", cameras(1, size=SIZE), none=(0,)).camera[0]
    picture = picture_of(0, strokes=strokes, camera=nowhere, scale=np.array([0.5, 0.5]))
    ring = np.argwhere(picture.any(axis=2))[:, ::-1]
    np.testing.assert_allclose(ring.mean(axis=0), [199.75, 99.75], atol=0.5)
    assert (np.abs(np.linalg.norm(ring - [199.75, 99.75], axis=1) - 7) < 2).all()
    assert (picture.reshape(-1, 3).max(axis=0) > 0.5 * np.array(DETECTED)).all()
    # Without a camera, and with no pixel, there is nothing to draw.
    assert not picture_of(0, camera=nowhere).any()


def test_the_ground_is_lower_beside_a_table():
    strokes = ball_strokes(BALL, ground_half_size=(0.76, 1.37), floor_z=-0.76)
    assert strokes.ground_z(np.array([0.7, -1.3, 0.2])) == 0.0
    assert strokes.ground_z(np.array([0.7, -1.4, 0.2])) == -0.76


def test_the_label_tells_height_speed_and_the_longest_axis_of_doubt():
    assert ball_label(STROKES, 0) == "ball: none"
    said = ball_label(STROKES, 3)
    assert f"{BALL.position[3, 2]:.2f} m high" in said and "+-0.30 m" in said
    assert f"{3.6 * np.linalg.norm(BALL.velocity[3]):.0f} km/h" in said


def test_no_ball_far_outside_or_behind_the_camera_breaks_the_drawing():
    for shift in ([0, -60.0, 0], [1e5, 0, 0], [0, 1e7, 0]):
        moved = replace(BALL, position=BALL.position + shift)
        moved = replace(moved, events=replace(BALL.events, position=BALL.events.position + shift))
        picture_of(6, strokes=ball_strokes(moved, ground_half_size=(9.15, 18.3), floor_z=0.0))


@pytest.mark.parametrize(
    ("spin", "std", "velocity", "expected"),
    [
        ([-300, 0, 0], 40, [0, 30, 0], "topspin"),
        ([300, 0, 0], 40, [0, -30, 1], "topspin"),
        ([300, 0, 0], 40, [0, 30, 0], "backspin"),
        ([0, 300, 0], 40, [30, 0, 0], "topspin"),
        ([0, 0, -200], 40, [0, 30, 0], "sidespin"),
        ([10, 0, 5], 20, [0, 30, 0], "flat"),
        ([-300, 0, 0], 200, [0, 30, 0], ""),
        ([0, 0, 0], 200, [0, 30, 0], ""),
        ([np.nan] * 3, np.nan, [0, 30, 0], ""),
        ([-300, 0, 0], 40, [0, 0, 9], ""),
    ],
)
def test_spin_has_a_name_where_it_is_known_well_enough(spin, std, velocity, expected):
    # A ball that turns so that its upper side goes ahead has topspin: spin x up points along the velocity.
    if expected == "topspin":
        assert np.cross(spin, [0, 0, 1]) @ velocity > 0
    assert spin_class(np.array(spin, dtype=float), np.full(3, float(std)), np.array(velocity, dtype=float)) == expected


def test_the_overlay_of_a_clip_shows_its_ball_where_it_has_tables_of_one(tmp_path):
    numbered_video(tmp_path / "match.mp4", 24, size=SIZE)
    work = tmp_path / "work"
    write_work(work, [TRACK], tmp_path / "match.mp4", size=SIZE, video_frames=24)
    scene = load_scene("tennis")
    pictures = []
    for has_ball in (False, True):
        if has_ball:
            write_clip_ball(work / "rally", BALL, scene=scene)
        write_overlays(work, ("rally",), video=tmp_path / "match.mp4", scene=scene)
        with open_video(work / "rally" / "overlay.mp4") as reader:
            pictures.append([np.array(frame.small_bgr(SIZE[0])) for frame in reader])
    assert len(pictures[0]) == len(pictures[1]) == 24
    pixel = pixel_of(BALL.position[7], 7)
    assert not near(pictures[0][7], pixel, PAST, within=3) and near(pictures[1][7], pixel, PAST, within=3)
