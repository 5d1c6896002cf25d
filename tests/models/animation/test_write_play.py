"""Play that is written as a work folder holds to the contract, and a camera sees of it what a simulator's sees."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from pgm_data.dataset.check import check_paths, examine
from pgm_data.dataset.clip_ball import read_clip_ball
from pgm_data.dataset.clip_camera import ClipCamera, read_clip_camera
from pgm_data.dataset.clip_captions import read_clip_captions
from pgm_data.dataset.clip_players import ClipPlayers, read_clip_players
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import project
from pgm_data.provenance import run_document
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.viewer_scene import clip_scene
from pgm_models.animation.encode import decode, encode, encode_constants, standardise
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.layout import Layout
from pgm_models.animation.play_camera import PlayCamera, camera_of_file, usual_camera
from pgm_models.animation.prompt import Prompt, PromptText, prompt_of
from pgm_models.animation.write_play import ClipNames, ball_spread, write_play, write_play_shots


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth:
    """Some frames of a simulated clip, and the same decoded from the states of a model."""

    scene: Scene
    layout: Layout
    columns: dict[str, np.ndarray]
    """As decoded."""
    prompt: Prompt
    """Of its captions."""
    players: ClipPlayers
    camera: ClipCamera
    rows: slice
    """Its frames of the clip."""


def truth_of(dataset: Path) -> Truth:
    """The longest stretch of the simulated clips in which everything is there."""
    layout = fit_layout(dataset)
    scene = load_scene(layout.scene)
    best: tuple[int, Path, slice] = (0, dataset, slice(0))
    for folder in sorted(path.parent for path in (dataset.parent / "work").glob("*/clip.json")):
        valid = encode(layout, _columns(folder))[1].all(axis=1)
        edges = np.flatnonzero(np.diff(valid.astype(int), prepend=0, append=0)).reshape(-1, 2).tolist()
        best = max([best, *((end - start, folder, slice(start, end)) for start, end in edges)], key=lambda run: run[0])
    count, folder, rows = best
    columns = {name: values[rows] for name, values in _columns(folder).items()}
    tangent, _ = encode(layout, columns)
    bones = encode_constants(layout, {n: v[:1] for n, v in columns.items() if n.endswith("joint_translations")})[0]
    clip = read_clip_players(folder, scene)
    texts = (
        PromptText(player=0, start=2, end=9, text="the player runs"),
        PromptText(player=0, start=9, end=count, text="the player rests"),
    )
    rate = 1 / float(np.median(np.diff(clip.timestamp)))
    return Truth(
        scene=scene,
        layout=layout,
        columns=decode(layout, standardise(layout, tangent), bones),
        prompt=Prompt(scene=scene.name, frames=count, rate=rate, seed=4, texts=texts, values=()),
        players=clip,
        camera=read_clip_camera(folder),
        rows=rows,
    )


def _columns(folder: Path) -> dict[str, np.ndarray]:
    columns = read_table(folder / "players.parquet")
    if (folder / "ball.parquet").exists():
        columns |= read_table(folder / "ball.parquet")
    return columns


@pytest.fixture(scope="module")
def tennis(tennis_dataset: Path) -> Truth:
    return truth_of(tennis_dataset)


@pytest.fixture(scope="module")
def blocks(blocks_dataset: Path) -> Truth:
    return truth_of(blocks_dataset)


Written = Callable[..., Path]


@pytest.fixture
def written(tmp_path: Path) -> Written:
    """Writes a work folder with one clip, `play`; the folder."""

    def make(truth: Truth, view: PlayCamera | None = None, *, columns=None, known=None) -> Path:
        work, names = tmp_path / "work", ClipNames(clip_id="play", match_id="match")
        columns = truth.columns if columns is None else columns
        write_play(work / "play", names, truth.prompt, columns, known or {}, scene=truth.scene, view=view)
        write_play_shots(work, ["play"], scene=truth.scene)
        started = datetime.now(UTC)
        write_document(work / "run.json", "run", run_document(command="test", options={}, started=started))
        return work

    return make


def usual(truth: Truth) -> PlayCamera:
    view = usual_camera(truth.scene, np.arange(truth.prompt.frames) / truth.prompt.rate)
    assert view is not None
    return view


def findings(work: Path) -> list[str]:
    return [str(violation) for violation in check_paths([work])]


@pytest.mark.parametrize("filmed", [True, False])
@pytest.mark.parametrize("name", ["tennis", "blocks"])
def test_simulated_play_written_as_if_generated_checks_packs_and_shows(name, filmed, request, written, tmp_path):
    truth = request.getfixturevalue(name)
    work = written(truth, usual(truth) if filmed else None)
    assert findings(work) == []
    outcome = pack_work_folders([work], tmp_path / "dataset", PackOptions())
    assert outcome.problems == () and sum(outcome.clips.values()) == 1
    shown = clip_scene(work / "play")
    assert np.isfinite(shown.bones).all() and len(shown.capture_time) == truth.prompt.frames
    assert (shown.ball is None) == (truth.scene.ball is None)
    tables = {"camera", "players", "captions"} | ({"ball", "events", "ball_shots"} if truth.scene.ball else set())
    assert {path.stem for path in (work / "play").glob("*.parquet")} == tables


def test_nothing_claims_to_be_measured_and_captions_are_the_prompts(tennis, written):
    work = written(tennis, usual(tennis))
    clip = read_clip_players(work / "play", tennis.scene)
    assert all(set(track.status) == {"filled"} for track in clip.players)
    camera = read_clip_camera(work / "play")
    assert set(camera.status) == {"interpolated"} and all("generated" in reason for reason in camera.reason)
    assert set(read_clip_ball(work / "play", camera.capture_time).status) == {"filled"}
    captions = read_clip_captions(work / "play")
    assert captions.text.tolist() == ["the player runs", "the player rests"]
    assert captions.start_frame.tolist() == [2, 9] and captions.end_s[0] == pytest.approx(9 / tennis.prompt.rate)
    assert set(captions.source) == {"human"}
    document = read_document(work / "play" / "clip.json", "clip")
    assert (document["match_id"], document["bytes"], document["n_frames"]) == ("match", 0, tennis.prompt.frames)


def test_the_prompt_beside_the_tables_is_the_prompt(tennis, written):
    work = written(tennis)
    again = prompt_of(json.loads((work / "play" / "prompt.json").read_text()), tennis.layout)
    assert (again.seed, again.frames, again.texts) == (4, tennis.prompt.frames, again.texts)
    assert [text.text for text in again.texts] == ["the player runs", "the player rests"]


@pytest.mark.parametrize("name", ["tennis", "blocks"])
def test_a_camera_sees_what_the_simulators_sees(name, request, written):
    truth = request.getfixturevalue(name)
    rows = truth.rows
    view = PlayCamera(camera=truth.camera.camera[rows], size=(1280, 720), reason="of the simulator")
    work = written(truth, view)
    for made, true in zip(read_clip_players(work / "play", truth.scene).players, truth.players.players, strict=True):
        np.testing.assert_allclose(made.joints, true.joints[rows], atol=1e-4)
        apart = np.linalg.norm(made.keypoints_px - true.keypoints_px[rows], axis=-1)
        tall = np.nanmedian(true.box_px[rows, 3] - true.box_px[rows, 1])
        assert np.nanmedian(apart) < 0.01 * tall and np.nanmax(apart) < 0.1 * tall
        edges = np.abs(made.box_px - true.box_px[rows])
        assert np.nanmedian(edges) < 0.1 * tall


def test_events_and_flights_follow_from_the_ball(tennis, written):
    work = written(tennis, usual(tennis))
    ball = read_clip_ball(work / "play", np.arange(tennis.prompt.frames) / tennis.prompt.rate)
    kinds = set(ball.events.kind)
    assert {"hit", "first", "last"} <= kinds and len(ball.shots.start_event) >= 2
    hits = ball.events.kind == "hit"
    assert set(ball.events.player[hits]) <= {"player0", "player1"} and "" not in ball.events.player[hits]
    assert (ball.shots.start_speed > 0).all()


def test_what_the_prompt_fixed_of_the_ball_is_certain_and_the_rest_as_rough_as_it_is(tennis, written):
    rng = np.random.default_rng(0)
    columns = dict(tennis.columns)
    columns["ball.position"] = columns["ball.position"] + rng.normal(0, 0.1, columns["ball.position"].shape)
    times = np.arange(tennis.prompt.frames) / tennis.prompt.rate
    # Two positions go into each step.
    assert ball_spread(columns, times) == pytest.approx(0.1 * 2**0.5, rel=0.2)
    assert ball_spread(tennis.columns, times) < 0.03
    assert ball_spread({"ball.position": columns["ball.position"]}, times) == 0
    known = np.zeros(tennis.prompt.frames, dtype=bool)
    known[:3] = True
    ball = read_clip_ball(written(tennis, columns=columns, known={"ball.position": known}) / "play", times)
    assert (ball.position_cov[:3] == 0).all()
    assert (np.diagonal(ball.position_cov[3:], axis1=1, axis2=2) > 0.01).all()


def test_what_a_model_does_not_know_is_missing(tennis, written):
    roots = {name: values for name, values in tennis.columns.items() if name == "player0.root_position"}
    work = written(tennis, usual(tennis), columns=roots)
    assert findings(work) == []
    clip = read_clip_players(work / "play", tennis.scene)
    assert np.isnan(clip.players[0].joints).all() and set(clip.players[1].status) == {"none"}
    assert set(read_clip_ball(work / "play", np.arange(tennis.prompt.frames) / 25).status) == {"none"}


def test_one_frame_is_a_clip(tennis, written):
    one = replace(tennis.prompt, frames=1, texts=())
    columns = {name: values[:1] for name, values in tennis.columns.items()}
    truth = replace(tennis, prompt=one, columns=columns)
    assert findings(written(truth, usual(truth))) == []


def test_a_camera_file_is_used_or_refused(tmp_path):
    raw = {
        "width": 640,
        "height": 360,
        "K": [500, 0, 319.5, 0, 500, 179.5, 0, 0, 1],
        "distortion": [0] * 4,
        "R_cam_from_world": [1, 0, 0, 0, 0, -1, 0, 1, 0],
        "t_cam_from_world": [0, 5, 30],
    }
    (tmp_path / "camera.json").write_text(json.dumps(raw))
    view = camera_of_file(tmp_path / "camera.json", 4)
    assert view.size == (640, 360) and view.camera.K.shape == (4, 3, 3)
    with pytest.raises(ValueError, match="expected a fixed camera in a .json"):
        camera_of_file(tmp_path / "camera.parquet", 4)


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis"])
def test_the_usual_view_of_a_court_holds_the_court(scene):
    loaded = load_scene(scene)
    view = usual_camera(loaded, np.zeros(1))
    assert view is not None and loaded.court is not None
    pixels, seen = project(view.camera, loaded.court.points_world[None])
    assert seen.all()
    assert (pixels > 0).all() and (pixels < np.array(view.size)).all()


def test_what_does_not_fit_is_refused(tennis, tmp_path):
    names = ClipNames(clip_id="play", match_id="play")
    short = {"player0.root_position": np.zeros((2, 3))}
    with pytest.raises(ValueError, match=f"player0.root_position: expected {tennis.prompt.frames} rows, got 2"):
        write_play(tmp_path / "play", names, tennis.prompt, short, {}, scene=tennis.scene, view=None)
    with pytest.raises(ValueError, match="scene: expected tennis, got blocks"):
        write_play(tmp_path / "play", names, tennis.prompt, {}, {}, scene=load_scene("blocks"), view=None)


def test_three_players_without_a_ball_are_written(three_players, tmp_path):
    rng = np.random.default_rng(0)
    columns = {
        f"{player.name}.root_position": rng.normal(0, 0.01, (5, 3)) + np.mean(player.region_m, axis=0)
        for player in three_players.players
    }
    texts = (PromptText(player=2, start=0, end=5, text="the player waits"),)
    prompt = Prompt(scene="trio", frames=5, rate=25.0, seed=0, texts=texts, values=())
    names = ClipNames(clip_id="play", match_id="play")
    view = usual_camera(three_players, np.arange(5) / 25)
    write_play(tmp_path / "play", names, prompt, columns, {}, scene=three_players, view=view)
    assert examine([tmp_path / "play"], scene=three_players).violations == ()
    assert read_clip_captions(tmp_path / "play").player.tolist() == [2]
    assert not (tmp_path / "play" / "ball.parquet").exists()
