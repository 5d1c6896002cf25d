"""The tables of truth say what the states say, seen by the camera that draws."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.scene import load_scene
from pgm_data.simulate.camera import CameraTrack, rotation_towards
from pgm_data.simulate.rotations import from_axis_angle
from pgm_data.simulate.states import BallEvent, BallStates, Caption, ShotStates
from pgm_data.simulate.truth_tables import (
    ball_columns,
    boxes,
    caption_columns,
    inside,
    nearest_frames,
    player_columns,
    seen,
    shown_events,
    write_states,
)
from tests.simulate.store_worlds import SIZE, broadcast_track, player_states, shot_states, write_truth_clip

TENNIS = load_scene("tennis")
NOTHING = ShotStates(players=(), ball=None, events=(), flights=(), captions=())


def turning_track(frames: int) -> CameraTrack:
    """Another camera in every frame: place, direction, focal length and lens."""
    rng = np.random.default_rng(frames)
    R = np.stack([rotation_towards(rng.normal(size=3), rng.normal()) for _ in range(frames)])
    K = np.zeros((frames, 3, 3))
    K[:, 0, 0], K[:, 1, 1] = rng.uniform(400, 3000, (2, frames))
    K[:, 0, 2], K[:, 1, 2], K[:, 2, 2] = rng.uniform(100, 900, frames), rng.uniform(100, 900, frames), 1.0
    distortion = np.zeros((frames, 4))
    distortion[:, 0] = rng.uniform(-0.1, 0.2, frames)
    return CameraTrack(K=K, distortion=distortion, R_cam_from_world=R, t_cam_from_world=rng.normal(size=(frames, 3)))


def test_pixels_are_those_of_opencv_with_each_frame_s_own_camera() -> None:
    track = turning_track(40)
    points = np.random.default_rng(1).normal(size=(40, 25, 3)) * 5
    pixels, depth = seen(points, track)
    assert (depth > 0).any() and (depth < 0).any()
    for i in range(40):
        front = depth[i] > 0
        assert np.isnan(pixels[i, ~front]).all()
        cam = points[i] @ track.R_cam_from_world[i].T + track.t_cam_from_world[i]
        radius2 = np.sum((cam[:, :2] / cam[:, 2:]) ** 2, axis=1)
        usable = front & (1 + 3 * track.distortion[i, 0] * radius2 > 0)
        assert np.isnan(pixels[i, front & ~usable]).all()
        if usable.any():
            rvec = cv2.Rodrigues(track.R_cam_from_world[i])[0]
            wanted = cv2.projectPoints(
                points[i, usable], rvec, track.t_cam_from_world[i], track.K[i], track.distortion[i]
            )[0]
            np.testing.assert_allclose(pixels[i, usable], wanted[:, 0], atol=1e-6, rtol=1e-9)


def test_a_point_far_outside_does_not_come_back_through_a_barrel_lens() -> None:
    track = broadcast_track(1, k1=-0.4)
    cam = np.array([1.6, 0.0, 1.0])  # k1 r^2 = -1.02: the formula gives a pixel left of the middle
    point = (cam - track.t_cam_from_world[0]) @ track.R_cam_from_world[0]
    assert np.isnan(seen(point[None, None], track)[0]).all()


@pytest.mark.parametrize("scene", ["tennis", "badminton", "blocks"])
@pytest.mark.parametrize("frames", [1, 2, 60])
def test_a_clip_of_truth_keeps_every_law(tmp_path: Path, scene: str, frames: int) -> None:
    write_truth_clip(tmp_path / "clip", load_scene(scene), frames=frames)
    assert [str(v) for v in check_paths([tmp_path / "clip"])] == []


def test_tables_give_back_the_states(tmp_path: Path) -> None:
    states = write_truth_clip(tmp_path / "clip", TENNIS, frames=40)
    players = read_table(tmp_path / "clip" / "players.parquet")
    for name, truth in zip(("player0", "player1"), states.players, strict=True):
        assert set(players[f"{name}.identity"]) == {truth.identity}
        assert set(players[f"{name}.status"]) == {"measured"}
        np.testing.assert_array_equal(players[f"{name}.joints"], truth.joints.reshape(40, -1).astype(np.float32))
        turns = players[f"{name}.joint_rotations"].reshape(40, -1, 3)
        np.testing.assert_allclose(from_axis_angle(turns), truth.rotations, atol=1e-6)
        np.testing.assert_array_equal(players[f"{name}.contact"], truth.contact)
        assert not players[f"{name}.root_cov"].any() and not players[f"{name}.reprojection_px"].any()
    ball = read_table(tmp_path / "clip" / "ball.parquet")
    assert states.ball is not None
    np.testing.assert_array_equal(ball["ball.position"], states.ball.position)
    np.testing.assert_array_equal(ball["ball.velocity"], states.ball.velocity)
    flights = read_table(tmp_path / "clip" / "ball_shots.parquet")
    np.testing.assert_array_equal(flights["in_probability"], [1.0, 0.0, np.nan, 1.0, 0.0])
    np.testing.assert_array_equal(flights["start_time"], [event.time for event in states.events[:-1]])
    np.testing.assert_array_equal(flights["spin"], [flight.spin for flight in states.flights])
    events = read_table(tmp_path / "clip" / "events.parquet")
    assert list(events["kind"]) == [event.kind for event in states.events]
    assert set(events["source"]) == {"simulated"} and set(events["probability"]) == {1.0}


def test_frames_without_a_player_or_a_ball_have_status_none_and_no_number(tmp_path: Path) -> None:
    times = np.arange(6) / 25
    states = shot_states(TENNIS, times, np.random.default_rng(0))
    gone = states.players[0]
    for values in (gone.rotations, gone.translations, gone.joints, gone.keypoints, gone.hull_centres):
        values[2:4] = np.nan
    assert states.ball is not None
    states.ball.position[4:] = np.nan
    states.ball.velocity[4:] = np.nan
    track = broadcast_track(6)
    player = player_columns("player0", gone, track, SIZE)
    assert player["player0.status"] == ["measured"] * 2 + ["none"] * 2 + ["measured"] * 2
    for name, values in player.items():
        if name not in ("player0.status", "player0.identity"):
            missing = np.isnan(np.asarray(values, dtype=float).reshape(6, -1))
            assert missing[2:4].all() and not missing[[0, 1, 4, 5]].any(), name
    ball = ball_columns(states.ball, track, SIZE)
    assert ball["ball.status"] == ["measured"] * 4 + ["none"] * 2
    assert all(np.isnan(np.asarray(ball[n])[4:]).all() for n in ball if n != "ball.status")
    folder = tmp_path / "clip"
    write_truth_clip(folder, TENNIS, frames=6)
    write_states(
        folder,
        clip_id="clip",
        scene=TENNIS,
        states=states,
        track=track,
        timestamps=times,
        capture_times=times,
        first_video_frame=0,
        size=SIZE,
    )
    assert [str(v) for v in check_paths([folder])] == []


def test_scores_say_what_lies_inside_of_the_picture() -> None:
    pixels = np.array([[-0.5, 0.0], [-0.6, 0.0], [1279.4, 719.4], [1279.5, 0.0], [5.0, 719.5], [np.nan, np.nan]])
    assert inside(pixels, SIZE).tolist() == [True, False, True, False, False, False]
    track = broadcast_track(3)
    position = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 60.0], [0.0, -60.0, 1.0]])  # in it, above it, behind the camera
    ball = ball_columns(BallStates(position=position, velocity=np.zeros((3, 3))), track, SIZE)
    np.testing.assert_array_equal(ball["ball.score"], [1.0, 0.0, 0.0])
    assert np.isnan(ball["ball.pixel"]).any(axis=1).tolist() == [False, True, True]


def test_boxes_hold_all_balls_of_the_hull_and_no_more() -> None:
    truth = player_states(TENNIS, 1, np.arange(5) / 25, np.random.default_rng(0))
    track = broadcast_track(5, k1=0.0)
    found = boxes(truth, track)
    for i in range(5):
        cam = truth.hull_centres[i] @ track.R_cam_from_world[i].T + track.t_cam_from_world[i]
        middle = cam[:, :2] / cam[:, 2:] * track.K[i, 0, 0] + track.K[i, :2, 2]
        reach = (truth.hull_radii / cam[:, 2] * track.K[i, 0, 0])[:, None]
        np.testing.assert_allclose(found[i], [*(middle - reach).min(axis=0), *(middle + reach).max(axis=0)])
    truth.hull_centres[2, 7] = [0.0, -40.0, 9.0]
    assert np.isnan(boxes(truth, track)[2]).all() and np.isfinite(boxes(truth, track)[[0, 1, 3, 4]]).all()


steps = st.lists(st.sampled_from([0.0, 0.04, 0.05]), min_size=0, max_size=30)


@given(steps=steps, times=st.lists(st.floats(-0.5, 2.0), max_size=10))
def test_an_event_s_frame_is_the_first_of_those_nearest_to_it(steps: list[float], times: list[float]) -> None:
    captured = np.cumsum([0.0, *steps])  # steps of 0 are repeats
    found = nearest_frames(np.array(times, dtype=float), captured)
    assert found.tolist() == [int(np.argmin(np.abs(captured - time))) for time in times]


@given(steps=steps, start=st.floats(-0.5, 2.0), length=st.floats(0.0, 1.0))
def test_a_caption_holds_the_frames_taken_within_its_span(steps: list[float], start: float, length: float) -> None:
    captured = np.cumsum([0.0, *steps])
    caption = Caption(player=1, start_s=start, end_s=start + length, texts=("waits", "stands"))
    columns = caption_columns("clip", [caption], captured)
    within = np.flatnonzero((captured >= start) & (captured < start + length))
    if not len(within):
        assert not any(len(values) for values in columns.values())
        return
    assert list(columns["text"]) == ["waits", "stands"] and list(columns["alternative"]) == [0, 1]
    assert list(columns["start_frame"]) == [within[0]] * 2 and list(columns["end_frame"]) == [within[-1] + 1] * 2


def test_a_hit_wins_over_a_bounce_in_the_same_frame() -> None:
    here = np.zeros(3)
    events = [
        BallEvent(time=0.1, kind=kind, player="", position=here) for kind in ("bounce", "hit", "first", "net", "last")
    ]
    assert shown_events(events, np.array([1, 1, 1, 2, 2]), 4) == ["none", "hit", "net", "none"]


def test_a_scene_without_a_ball_and_states_without_anybody_write_nothing_of_them(tmp_path: Path) -> None:
    write_truth_clip(tmp_path / "blocks", load_scene("blocks"))
    assert sorted(p.stem for p in (tmp_path / "blocks").iterdir()) == ["camera", "captions", "clip", "players"]
    times = np.arange(3) / 25
    write_states(
        tmp_path / "court",
        clip_id="court",
        scene=TENNIS,
        states=NOTHING,
        track=broadcast_track(3),
        timestamps=times,
        capture_times=times,
        first_video_frame=0,
        size=SIZE,
    )
    assert list((tmp_path / "court").iterdir()) == []


@pytest.mark.parametrize(
    ("scene", "frames", "changes", "named"),
    [
        ("blocks", 3, {"ball": BallStates(position=np.zeros((3, 3)), velocity=np.zeros((3, 3)))}, "states.ball"),
        ("tennis", 4, {}, "expected 4 rows"),
        ("tennis", 3, {"players": ()}, "states.captions"),
        ("tennis", 3, {"ball": None}, "states.events"),
    ],
)
def test_states_that_do_not_fit_the_scene_or_the_track_are_refused(
    tmp_path: Path, scene: str, frames: int, changes: dict, named: str
) -> None:
    times = np.arange(3) / 25
    states = shot_states(load_scene(scene), times, np.random.default_rng(0))
    fields = {name: getattr(states, name) for name in ("players", "ball", "events", "flights", "captions")}
    with pytest.raises(ValueError, match=named):
        write_states(
            tmp_path / "clip",
            clip_id="clip",
            scene=load_scene(scene),
            states=ShotStates(**(fields | changes)),
            track=broadcast_track(frames),
            timestamps=np.arange(frames) / 25,
            capture_times=np.arange(frames) / 25,
            first_video_frame=0,
            size=SIZE,
        )
    assert not (tmp_path / "clip").exists()


def test_the_clip_s_document_names_players_graphics_and_shutter(tmp_path: Path) -> None:
    write_truth_clip(tmp_path / "clip", TENNIS)
    document = read_document(tmp_path / "clip" / "clip.json", "clip")
    assert document["players"]["player1"] == {"identity": "person 1", "handedness": "left"}
    assert document["ui_boxes_px"] == [[10.0, 10.0, 200.0, 60.0]]
    assert document["shutter_s"] == 0.01 and document["bytes"] == 0
    assert json.loads((tmp_path / "clip" / "clip.json").read_text())["quality"] == "truth"


def test_the_same_states_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_truth_clip(tmp_path / name / "clip", TENNIS, frames=50)
    for path in sorted((tmp_path / "a" / "clip").iterdir()):
        assert path.read_bytes() == (tmp_path / "b" / "clip" / path.name).read_bytes(), path.name
