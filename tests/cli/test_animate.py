"""`pgm animate`: prompts in, a work folder out, and what it says where something cannot be."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pgm_cli.animate import main
from pgm_cli.console import UsageError

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_ball import read_clip_ball
from pgm_data.dataset.documents import read_document
from pgm_models.animation.model import save_model
from tests.models.animation.toy_models import toy_layout, toy_model

LENGTH = 12


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with an untrained model that knows places alone."""
    folder = tmp_path_factory.mktemp("run")
    save_model(folder / "model.safetensors", toy_model(replace(toy_layout(), constants=())), {})
    return folder


@pytest.fixture
def prompts(tmp_path: Path) -> dict[str, Path]:
    """A prompt of words and a place, one of nothing, one that is wrong."""
    plain = {"scene": "tennis", "n_frames": LENGTH, "frames_per_second": 25, "seed": 5}
    told = plain | {
        "texts": [{"player": 0, "start_frame": 0, "end_frame": LENGTH, "text": "the player serves"}],
        "values": [{"column": "ball.position", "start_frame": 3, "end_frame": 4, "value": [1.0, -2.0, 3.0]}],
    }
    wrong = plain | {"values": [{"column": "ball.spin", "start_frame": 0, "end_frame": 1, "value": [0, 0, 0]}]}
    paths = {}
    for name, raw in {"told": told, "plain": plain, "wrong": wrong}.items():
        paths[name] = tmp_path / f"{name}.json"
        paths[name].write_text(json.dumps(raw))
    return paths


def animate(run: Path, out: Path, *prompts: Path, options: tuple[str, ...] = ()) -> int:
    paths = [str(path) for path in prompts]
    return main([str(run), "--prompt", *paths, "--out", str(out), "--steps", "2", "--device", "cpu", *options])


def ball(folder: Path) -> np.ndarray:
    return read_clip_ball(folder, np.arange(LENGTH) / 25).position


def test_a_prompt_becomes_a_clip_of_a_work_folder(run, prompts, tmp_path, capsys):
    out = tmp_path / "work"
    assert animate(run, out, prompts["told"]) == 0
    assert {"told", "run.json", "shots.parquet"} <= {path.name for path in out.iterdir()}
    assert (out / "told" / "sheet.png").stat().st_size > 1000
    np.testing.assert_allclose(ball(out / "told")[3], [1, -2, 3], atol=1e-6)
    document = read_document(out / "run.json", "run")
    said = document["options"]["plays"]["told"]
    assert said["given"] == {"ball.position": [[3, 4]]} and said["seed"] == 5
    assert [entry["state"] for entry in document["inputs"]] == ["done"]
    assert json.loads((out / "told" / "prompt.json").read_text())["texts"][0]["text"] == "the player serves"
    # An untrained model keeps to the form, and to the laws of motion no more than by chance: that is said.
    laws = [str(violation) for violation in check_paths([out])]
    printed = capsys.readouterr().out
    assert all("expected at most" in law or "expected a" in law for law in laws)
    assert printed.count("warning: told:") == len(laws) == len(said["warnings"])


def test_one_prompt_that_is_wrong_stops_no_other(run, prompts, tmp_path, capsys):
    out = tmp_path / "work"
    assert animate(run, out, prompts["wrong"], prompts["plain"], tmp_path / "none.json") == 3
    assert {path.parent.name for path in out.glob("*/clip.json")} == {"plain"}
    assert not (out / "wrong").exists()
    states = [entry["state"] for entry in read_document(out / "run.json", "run")["inputs"]]
    assert states == ["failed", "done", "failed"]
    errors = capsys.readouterr().err
    assert "wrong.json: values[0].column: expected one of" in errors and "none.json: expected a JSON document" in errors


def test_where_all_are_wrong_nothing_is_there(run, prompts, tmp_path):
    assert animate(run, tmp_path / "work", prompts["wrong"]) == 4
    assert not list((tmp_path / "work").glob("*.parquet"))


def test_plays_of_one_prompt_differ_and_come_back_from_their_seeds(run, prompts, tmp_path):
    assert animate(run, tmp_path / "two", prompts["plain"], options=("--plays", "2")) == 0
    first, second = (tmp_path / "two" / f"plain.{number:02d}" for number in range(2))
    assert read_document(first / "clip.json", "clip")["match_id"] == "plain"
    assert (ball(first) != ball(second)).any(axis=1).all()
    assert animate(run, tmp_path / "one", prompts["plain"], options=("--seed", "6")) == 0
    np.testing.assert_array_equal(ball(tmp_path / "one" / "plain"), ball(second))
    assert animate(run, tmp_path / "again", second / "prompt.json") == 0
    np.testing.assert_array_equal(ball(tmp_path / "again" / "prompt"), ball(second))


def test_resuming_makes_what_is_not_there_or_has_changed(run, prompts, tmp_path, capsys):
    out = tmp_path / "work"
    assert animate(run, out, prompts["told"]) == 0
    with pytest.raises(UsageError, match="expected a new or empty folder"):
        animate(run, out, prompts["told"])
    before = (out / "told" / "clip.json").stat().st_mtime_ns
    both = (prompts["told"], prompts["plain"])
    assert animate(run, out, *both, options=("--resume",)) == 0
    assert (out / "told" / "clip.json").stat().st_mtime_ns == before and (out / "plain").is_dir()
    assert "done before" in capsys.readouterr().out
    assert animate(run, out, *both, options=("--resume", "--temperature", "0.5")) == 0
    assert (out / "told" / "clip.json").stat().st_mtime_ns > before
    with pytest.raises(UsageError, match="expected the prompts and plays of the earlier run, got none for told"):
        animate(run, out, prompts["plain"], options=("--resume", "--temperature", "0.5"))
    assert animate(run, out, prompts["plain"], options=("--overwrite",)) == 0
    assert not (out / "told").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--plays", "0"), "--plays: expected 1 to"),
        (("--steps", "0"), "--steps: expected 1 to"),
        (("--keep", "8"), "--keep: expected 1 to 7, of the model's 8 frames"),
        (("--keyframe-hz", "0"), "--keyframe-hz: expected"),
        (("--seed", "-1"), "--seed: expected 0 to"),
        (("--scene", "blocks"), "--scene: expected tennis, of the model, got blocks"),
        (("--camera", "nowhere.json"), "--camera: nowhere.json: expected a JSON document"),
        (("--device", "abacus"), "--device: expected auto, cpu, cuda"),
        (("--onnx", "--device", "cuda"), "--onnx: expected --device cpu"),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_is_written(options, said, run, prompts, tmp_path):
    with pytest.raises(UsageError, match=said):
        animate(run, tmp_path / "work", prompts["plain"], options=options)
    assert not (tmp_path / "work").exists()


def test_a_run_without_a_model_is_named(prompts, tmp_path):
    (tmp_path / "empty").mkdir()
    for run in (tmp_path / "empty", tmp_path / "nowhere"):
        with pytest.raises(UsageError, match=f"RUN: {run}: expected a run of pgm-train animation"):
            animate(run, tmp_path / "work", prompts["plain"])


def test_a_camera_of_ones_own(run, prompts, tmp_path):
    raw = {
        "width": 640,
        "height": 360,
        "K": [500, 0, 319.5, 0, 500, 179.5, 0, 0, 1],
        "distortion": [0] * 4,
        "R_cam_from_world": [1, 0, 0, 0, 0, -1, 0, 1, 0],
        "t_cam_from_world": [0, 5, 30],
    }
    (tmp_path / "camera.json").write_text(json.dumps(raw))
    options = ("--camera", str(tmp_path / "camera.json"))
    assert animate(run, tmp_path / "work", prompts["told"], options=options) == 0
    document = read_document(tmp_path / "work" / "told" / "clip.json", "clip")
    assert (document["width"], document["height"], document["lens_model"]["reason"]) == (640, 360, "as in camera.json")
    seen = read_clip_ball(tmp_path / "work" / "told", np.arange(LENGTH) / 25)
    np.testing.assert_allclose(seen.pixel[3], [319.5 + 500 * 1 / 28, 179.5 + 500 * 2 / 28], rtol=1e-6)


def test_onnxruntime_runs_transformers_alone(prompts, tmp_path):
    model = toy_model(replace(toy_layout(), constants=()), design="lstm")
    save_model(tmp_path / "model.safetensors", model, {})
    with pytest.raises(UsageError, match="--onnx: expected a model that is a transformer, got lstm"):
        animate(tmp_path / "model.safetensors", tmp_path / "work", prompts["told"], options=("--onnx",))


def test_an_interrupted_run_keeps_what_is_whole_and_goes_on(run, prompts, tmp_path, monkeypatch):
    import pgm_cli.animate

    def stop(progress, event):
        if (event.name, event.kind) == ("plain.01", "progress"):
            raise KeyboardInterrupt

    out, options = tmp_path / "work", ("--plays", "2")
    with monkeypatch.context() as patched:
        patched.setattr(pgm_cli.animate, "_tell", stop)
        with pytest.raises(KeyboardInterrupt):
            animate(run, out, prompts["plain"], options=options)
    assert {path.parent.name for path in out.glob("*/clip.json")} == {"plain.00"} and not (out / "plain.01").exists()
    assert [entry["state"] for entry in read_document(out / "run.json", "run")["inputs"]] == ["done", "unfinished"]
    made = (out / "plain.00" / "clip.json").stat().st_mtime_ns
    assert animate(run, out, prompts["plain"], options=(*options, "--resume")) == 0
    assert (out / "plain.01" / "clip.json").is_file()
    assert (out / "plain.00" / "clip.json").stat().st_mtime_ns == made
