"""Cameras moved to where none was, and the simulator's own pictures drawn again."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from pgm_data.simulate.clip import simulate_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, match_seed, pack_truth, write_match, write_shots
from pgm_models.model_file import MODEL_NAME
from pgm_models.synthesis.evaluate_run import SynthesisEvaluationOptions, evaluate_synthesis, open_judge
from pgm_models.synthesis.evaluate_tables import evaluation_text
from pgm_models.synthesis.model import ModelOptions, SynthesisModel, save_model
from pgm_models.synthesis.novel_view import (
    DIRECTIONS,
    NovelOptions,
    NovelView,
    aim_of,
    moved_camera,
    novel_drops,
    turned_about,
)
from pgm_models.synthesis.novel_view_pictures import clips_again, simulated_run
from pgm_models.synthesis.presets import PRESETS
from tests.models.synthesis.toy_bodies import looking

SAID = {
    "scene": "blocks",
    "seed": 7,
    "minutes": 0.005,
    "fps": 20.0,
    "resolution": "64x36",
    "motion": "any",
    "duplicates": False,
    "closeups": True,
    "shutter": None,
    "wind": None,
    "surface": "any",
    "pictures": "draft",
}
FRAMES = 12
angle = st.floats(-1.2, 1.2)


def cameras(one: Camera, count: int) -> Camera:
    return Camera(**{name: np.repeat(value[None], count, axis=0) for name, value in vars(one).items()})


@settings(deadline=None, max_examples=30)
@given(angle, st.floats(0.05, 1.0), st.floats(5.0, 60.0), st.sampled_from(DIRECTIONS), st.floats(1.0, 40.0))
def test_a_turned_camera_keeps_what_it_aims_at_in_its_place_and_distance(bearing, height, reach, direction, degrees):
    aim = np.array([0.5, -1.0, 0.8])
    place = aim + reach * np.array([np.cos(bearing) * np.cos(height), np.sin(bearing) * np.cos(height), np.sin(height)])
    camera = looking(place.tolist(), aim.tolist())
    moved = turned_about(camera, aim, direction, degrees)
    before, after = (project(one, aim[None])[0][0] for one in (camera, moved))
    np.testing.assert_allclose(after, before, atol=1e-6)
    arms = [one.position_world - aim for one in (camera, moved)]
    assert np.linalg.norm(arms[0]) == pytest.approx(np.linalg.norm(arms[1]))
    cosine = arms[0] @ arms[1] / (arms[0] @ arms[0])
    shares = {"up": 1.0}.get(direction, np.cos(height))
    turn = np.degrees(2 * np.arcsin(np.clip(np.sin(np.radians(degrees) / 2) * shares, 0, 1)))
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) == pytest.approx(turn, abs=1e-3)
    np.testing.assert_allclose(moved.R_cam_from_world @ moved.R_cam_from_world.T, np.eye(3), atol=1e-9)


def test_each_direction_is_where_its_name_says():
    aim, camera = np.zeros(3), looking([0.0, -20.0, 5.0], [0.0, 0.0, 0.0])
    x, y, z = np.eye(3)
    places = {name: turned_about(camera, aim, name, 12.0).position_world for name in DIRECTIONS}
    assert places["left"] @ x < -2 and places["right"] @ x > 2 and places["up"] @ z > 8
    assert abs(places["up"] @ x) < 1e-9 and places["left"] @ z == pytest.approx(5.0)


def test_a_novel_camera_is_far_from_every_one_that_was_seen():
    options = NovelOptions()
    aim, camera = np.zeros(3), looking([0.0, -20.0, 5.0], [0.0, 0.0, 0.0])
    seen = [turned_about(camera, aim, "right", float(degrees)) for degrees in np.arange(0.0, 20.0)]
    track = Camera(**{name: np.stack([getattr(one, name) for one in seen]) for name in vars(camera)})
    found = {name: moved_camera(camera, aim, name, track, options) for name in DIRECTIONS}
    assert found["left"] is not None and found["left"][1] == 11.0  # 10 degrees about the vertical are a hair fewer
    assert found["right"] is not None and found["right"][1] == 30.0
    assert found["up"] is not None and 10.0 <= found["up"][1] <= 12.0
    for moved in found.values():
        assert moved is not None
        away = moved[0].position_world - track.position_world
        assert np.linalg.norm(away, axis=1).min() >= 3.0
    near = cameras(looking([0.0, -4.0, 2.0], [0.0, 0.0, 0.0]), 1)
    close = moved_camera(near[0], aim, "right", near, options)
    assert close is not None and np.linalg.norm(close[0].position_world - near.position_world[0]) >= 3.0
    assert moved_camera(camera, aim, "right", track, NovelOptions(most_deg=25.0)) is None


def test_a_camera_is_not_turned_until_it_looks_straight_down():
    aim, camera = np.zeros(3), looking([0.0, -3.0, 20.0], [0.0, 0.0, 0.0])
    assert moved_camera(camera, aim, "up", cameras(camera, 1), NovelOptions()) is None


def test_the_aim_is_the_nearest_point_of_the_axis():
    camera = looking([0.0, -20.0, 5.0], [1.0, 3.0, 0.0])
    middle = np.array([2.0, 1.0, 1.0])
    aim = aim_of(camera, middle)
    forward = camera.R_cam_from_world[2]
    assert abs(float((middle - aim) @ forward)) < 1e-9
    np.testing.assert_allclose(np.cross(aim - camera.position_world, forward), 0, atol=1e-9)


def test_what_is_lost_is_told_by_seen_and_novel_means():
    views = [
        NovelView(place="a", direction=way, moved_m=0.0, turned_deg=0.0, psnr={"frame": value, "player0": float("nan")})
        for way, value in (("seen", 30.0), ("left", 26.0), ("up", 28.0))
    ]
    drops = novel_drops(views)
    assert drops["frame"] == (30.0, 27.0) and np.isnan(drops["player0"]).all()


def written(folder: Path, **changes: object) -> Path:
    folder.mkdir()
    (folder / "run.json").write_text(json.dumps({"command": "pgm simulate", "options": SAID | changes}))
    return folder


@pytest.mark.parametrize("scene, size, frame", [("blocks", (64, 36), 3), ("tennis", (96, 54), 1)])
def test_the_simulator_draws_the_same_picture_and_mask_again(scene, size, frame, tmp_path):
    fps = 20.0
    said = {"scene": scene, "resolution": f"{size[0]}x{size[1]}", "closeups": False, "minutes": 6 / 60 / fps}
    run = simulated_run(written(tmp_path / "work", **said))
    assert run.options.frames == 6
    options = ClipOptions(frames=6, width=size[0], height=size[1], fps=fps, quality="draft")
    shot = next(simulate_shots(load_scene(scene), options, match_seed(7, 0)))
    (name, again), *others = clips_again(run, [f"{scene}_7_000"])
    assert name == f"{scene}_7_000" and not others
    camera = again.camera(frame)
    np.testing.assert_allclose(camera.K, shot.track.K[frame])
    np.testing.assert_allclose(camera.t_cam_from_world, shot.track.t_cam_from_world[frame], atol=1e-12)
    drawn = again.draw(frame, camera)
    np.testing.assert_array_equal(drawn.rgb[..., ::-1], list(shot.pictures())[frame])
    assert shot.masks is not None
    np.testing.assert_array_equal(drawn.labels, list(shot.masks())[frame].labels)
    moved = turned_about(camera, np.zeros(3), "up", 10.0)
    assert (again.draw(frame, moved).labels != drawn.labels).mean() > 0.01


def walked(folder: Path) -> Path:
    """One short walk among blocks: videos, tables, labels, a packed dataset."""
    scene = load_scene("blocks")
    options = ClipOptions(frames=FRAMES, width=64, height=36, fps=20.0, quality="draft")
    written_match = write_match(folder, scene, options, MatchFiles(pictures="draft", masks=True), seed=7, match=0)
    write_shots(folder, scene, [written_match])
    pack_truth(folder, scene, videos=True)
    told = {"command": "pgm simulate", "options": SAID | {"minutes": FRAMES / 60 / 20.0}}
    (folder / "work" / "run.json").write_text(json.dumps(told))
    return folder


def test_a_model_is_judged_from_where_no_camera_was(tmp_path):
    folder = walked(tmp_path / "sim")
    preset = PRESETS["nano"]
    made = ModelOptions(
        scene="blocks", fields=preset.fields, enhancer=preset.enhancer, style=preset.style, picture=(64, 36), seed=0
    )
    save_model(tmp_path / "run" / MODEL_NAME, SynthesisModel(made), {})
    options = SynthesisEvaluationOptions(
        run=tmp_path / "run",
        dataset=folder / "dataset",
        truth=folder / "work",
        frames=4,
        novel=NovelOptions(frames=1),
        efficiency_frames=0,
        device="cpu",
    )
    result = evaluate_synthesis(open_judge(options), tmp_path / "parts")
    assert not isinstance(result.novel, str), result.novel
    assert [view.direction for view in result.novel] == ["seen", *DIRECTIONS]
    assert result.novel[0].moved_m == 0 and min(view.moved_m for view in result.novel[1:]) >= 3.0
    assert all(np.isfinite(view.psnr[name]) for view in result.novel for name in ("frame", "world", "sky"))
    assert (tmp_path / "parts" / "novel.png").is_file()
    assert "novel PSNR [dB]" in evaluation_text(result)
    # What was written is read back, and the frames are the ones that were asked for.
    again = evaluate_synthesis(open_judge(options), tmp_path / "parts")
    assert not isinstance(again.novel, str)
    for one, other in zip(again.novel, result.novel, strict=True):
        assert (one.place, one.direction, one.moved_m) == (other.place, other.direction, other.moved_m)
        np.testing.assert_array_equal([*one.psnr.values()], [*other.psnr.values()])
    # Told of another lens than it drew with, the simulator is not believed.
    told = json.loads((folder / "work" / "run.json").read_text())
    told["options"]["resolution"] = "96x54"
    (folder / "work" / "run.json").write_text(json.dumps(told))
    refused = evaluate_synthesis(open_judge(options), None).novel
    assert isinstance(refused, str) and "another version of it drew these pictures" in refused


def test_folders_that_the_simulator_did_not_write_are_refused(tmp_path):
    with pytest.raises(ValueError, match="expected the document of a run of pgm simulate"):
        simulated_run(tmp_path)
    work = written(tmp_path / "work")
    run = simulated_run(work)
    with pytest.raises(ValueError, match="clip other_7_000: expected one of the run of seed 7"):
        list(clips_again(run, ["other_7_000"]))
    with pytest.raises(ValueError, match="blocks_7_000.09: expected the simulator to draw it again"):
        list(clips_again(run, ["blocks_7_000.09"]))
    (work / "run.json").write_text(json.dumps({"command": "pgm pack", "options": {}}))
    with pytest.raises(ValueError, match="expected pgm simulate, got pgm pack"):
        simulated_run(work)
    with pytest.raises(ValueError, match="scene: expected tennis or blocks, got badminton"):
        simulated_run(written(tmp_path / "other", scene="badminton"))
