"""Players placed by the stage: tables that hold to the contract, errors against the truth, overlays and reports."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_players import PlayerTrack, read_clip_players, write_clip_players
from pgm_data.lift.camera_doubt import no_doubt
from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, write_match
from pgm_data.skeleton import world_joints
from pgm_data.stages.players_detect import confirmed, cuts, no_poses
from pgm_data.stages.players_lift import clip_players, placed_players
from pgm_data.stages.players_report import players_cells, players_section
from pgm_data.stages.trade_players_clips import noisy, overlaps
from pgm_data.stages.trade_players_score import plain_errors, player_errors, runs

TENNIS = load_scene("tennis")
FRAMES = 75


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip's folder with its truth, at 1080p."""
    out = tmp_path_factory.mktemp("players")
    options = ClipOptions(frames=FRAMES, width=1920, height=1080)
    write_match(out, TENNIS, options, MatchFiles(pictures="none"), seed=9, match=0)
    return next(path.parent for path in (out / "work").glob("*/clip.json"))


@pytest.fixture(scope="module")
def solved(simulated):
    clip, truth = read_clip_camera(simulated), read_clip_players(simulated, TENNIS)
    boxes, poses = noisy(truth, TENNIS, np.random.default_rng(0), 2.0)
    motions = placed_players(clip, boxes, poses, scene=TENNIS, quality="standard", doubt=no_doubt())
    return clip, truth, boxes, clip_players(clip, boxes, poses, motions, scene=TENNIS)


def errors_of(truth: PlayerTrack, track: PlayerTrack) -> dict:
    skeleton = TENNIS.players[0].skeleton
    assert skeleton is not None
    return plain_errors(player_errors(truth, track, skeleton=skeleton, counted=np.ones(FRAMES, dtype=bool)))


def test_players_are_placed_within_decimetres_and_their_table_holds_to_the_contract(solved, simulated, tmp_path):
    _, truth, _, found = solved
    for number, bar in ((0, 0.07), (1, 0.14)):
        errors = errors_of(truth.players[number], found.players[number])
        assert errors["placed"] == errors["there"] == FRAMES
        assert errors["wrong"] == 0
        assert errors["root_median_m"] < bar
        assert errors["root_rms_m"] < 0.4  # in the air a metre along the court is a pixel
        assert errors["stance_p95_m"] < 0.02
    shutil.copytree(simulated, tmp_path / simulated.name)
    write_clip_players(tmp_path / simulated.name, found, scene=TENNIS)
    assert check_paths([tmp_path / simulated.name / "players.parquet"]) == []
    back = read_clip_players(tmp_path / simulated.name, TENNIS)
    for one, other in zip(back.players, found.players, strict=True):
        np.testing.assert_allclose(one.joints, other.joints, atol=2e-6)
        np.testing.assert_array_equal(one.status, other.status)


def test_forward_kinematics_gives_the_joints_of_the_table(solved):
    skeleton = TENNIS.players[0].skeleton
    assert skeleton is not None
    for track in solved[3].players:
        led = world_joints(skeleton.parents, track.joint_rotations, track.joint_translations)
        np.testing.assert_allclose(led, track.joints, atol=1e-5)


def test_the_truth_itself_has_no_error(solved):
    truth = solved[1].players[0]
    errors = errors_of(truth, truth)
    assert errors["root_rms_m"] == errors["joints_m"] == errors["stance_rms_m"] == 0
    assert errors["contact_right"] == 1


def test_a_player_moved_aside_is_taken_for_somebody_else(solved):
    truth = solved[1].players[0]
    aside = replace(truth, root_position=truth.root_position + [2.0, 0.0, 0.0])
    assert errors_of(truth, aside)["wrong"] == FRAMES


def test_without_points_roots_stand_at_their_boxes_and_nothing_is_said_of_joints(solved, simulated, tmp_path):
    clip, truth, boxes, _ = solved
    poses = no_poses(boxes)
    motions = placed_players(clip, boxes, poses, scene=TENNIS, quality="standard", doubt=no_doubt())
    found = clip_players(clip, boxes, poses, motions, scene=TENNIS)
    for number, track in enumerate(found.players):
        placed = track.status != "none"
        assert placed.mean() > 0.9
        assert np.isnan(track.joints).all() and np.isnan(track.contact).all()
        off = np.linalg.norm((track.root_position - truth.players[number].root_position)[placed, :2], axis=1)
        assert np.median(off) < 1.0
    write_clip_players(tmp_path, found, scene=TENNIS)
    assert check_paths([tmp_path / "players.parquet"]) == []


def test_the_report_names_every_player(solved):
    clip, _, _, found = solved
    section = players_section(found, clip.capture_time, "tennis")
    assert "player0" in section and "player1" in section and "<svg" in section
    assert players_cells(None) == ("–", "–")
    assert players_cells(found)[0] == "100 % / 100 %"


def test_a_jump_of_both_players_is_a_cut_and_a_sprint_is_none(solved):
    clip, _, boxes, _ = solved
    ground = np.zeros((FRAMES, 2, 2))
    ground[:, 0, 0] = 8.0 * (clip.capture_time - clip.capture_time[0])
    ground[40:, 1] = [3.0, 9.0]
    assert np.flatnonzero(cuts(replace(boxes, ground_world=ground), clip.capture_time)).tolist() == [40]


def test_runs_and_overlaps():
    assert [run.tolist() for run in runs(np.array([1, 1, 0, 1, 1, 1], dtype=bool), 3)] == [[3, 4, 5]]
    a = np.array([[0.0, 0, 2, 2], [0, 0, 1, 1], [0, 0, 1, 1]])
    b = np.array([[1.0, 0, 3, 2], [np.nan] * 4, [5, 5, 6, 6]])
    np.testing.assert_allclose(overlaps(a, b), [1 / 3, 0, 0])


def test_boxes_in_which_no_network_sees_a_body_are_nobodys(solved):
    clip, truth, boxes, _ = solved
    _, poses = noisy(truth, TENNIS, np.random.default_rng(0), 2.0)
    points, sigma = poses.points_px.copy(), poses.sigma_px.copy()
    points[20:, 0], sigma[20:, 0] = np.nan, np.nan
    points[30:33, 1], sigma[30:33, 1] = np.nan, np.nan
    kept = confirmed(boxes, replace(poses, points_px=points, sigma_px=sigma), clip.capture_time)
    late = clip.capture_time > clip.capture_time[19] + 0.51
    assert (kept.status[late, 0] == "none").all() and np.isnan(kept.boxes_px[late, 0]).all()
    assert (kept.status[~late, 0] == "measured").all() and (kept.status[:, 1] == "measured").all()
