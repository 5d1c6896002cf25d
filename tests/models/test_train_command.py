import json

import numpy as np
import pytest
from pgm_cli.train import main

from pgm_data.dataset.tables import write_table
from pgm_data.detect.ball.network import BALL_NETWORK, BallNetwork, NetworkFinder
from pgm_data.detect.court_network import CourtNetwork
from pgm_data.scene import load_scene

COURT = load_scene("tennis").court


def test_a_short_run_leaves_a_network_that_the_reader_takes(dataset, tmp_path, capsys):
    run = tmp_path / "run"
    argv = [
        "court",
        str(dataset),
        "--out",
        str(run),
        "--preset",
        "nano",
        "--steps",
        "2",
        "--batch",
        "2",
        "--threads",
        "1",
    ]
    assert main(argv) == 0
    network = CourtNetwork.load(run / COURT.network, network_file="", names=COURT.all_names)
    assert network.detect(np.zeros((50, 90, 3), np.uint8)).scores.shape == (len(COURT.all_names),)
    last = json.loads((run / "log.jsonl").read_text().splitlines()[-1])
    assert last["step"] == 2
    assert "wrote" in capsys.readouterr().out
    assert main([*argv, "--resume"]) == 0  # nothing left to do
    with pytest.raises(ValueError, match=r"learning_rate \(0\.002 then, 0\.1 now\)"):
        main([*argv, "--resume", "--learning-rate", "0.1"])


def test_a_used_folder_is_refused_without_resume(dataset, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "notes.txt").write_text("mine")
    with pytest.raises(Exception, match="expected an empty or new folder, or --resume or --overwrite"):
        main(["court", str(dataset), "--out", str(tmp_path / "run")])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere", "--out", "run"], "DATASET: expected a folder, got nowhere"),
        ([".", "--out", "run", "--batch", "1"], "--batch: expected at least 2"),
        ([".", "--out", "run", "--minutes", "-3"], "--minutes: expected above 0"),
        ([".", "--out", "run", "--export-only"], "--export-only: expected a checkpoint in run, got none"),
    ],
)
def test_bad_options_are_named(words, said):
    with pytest.raises(Exception, match=said):
        main(["court", *words])


def test_an_empty_dataset_gives_exit_4(tmp_path, capsys):
    (tmp_path / "data").mkdir()
    assert main(["court", str(tmp_path / "data"), "--out", str(tmp_path / "run")]) == 4
    assert "expected clip folders" in capsys.readouterr().err


@pytest.fixture
def ball_dataset(dataset):
    """The dataset of the conftest with a ball that flies through its one clip."""
    folder = dataset / "work" / "mix"
    rows = 4
    columns = {
        "clip_id": ["mix"] * rows,
        "frame_index": np.arange(rows),
        "video_frame": np.arange(1, rows + 1),
        "timestamp": np.arange(1, rows + 1) / 25,
        "ball.pixel": np.zeros((rows, 2), np.float32),
        "ball.score": np.ones(rows, np.float32),
        "ball.position": np.array([-6.0, 0, 7]) + np.arange(rows)[:, None] * np.array([0.8, 0, 0]),
        "ball.velocity": np.tile([20.0, 0, 0], (rows, 1)),
        "ball.position_cov": np.zeros((rows, 6)),
        "ball.status": ["measured"] * rows,
        "ball.event": ["none"] * rows,
    }
    write_table(folder / "ball.parquet", table="ball", scene=load_scene("tennis"), columns=columns)
    return dataset


def test_a_short_ball_run_leaves_a_network_that_the_finder_takes(ball_dataset, tmp_path, capsys):
    run = tmp_path / "run"
    argv = ["ball", str(ball_dataset), "--out", str(run), "--preset", "nano", "--steps", "2"]
    argv += ["--batch", "2", "--threads", "1"]
    assert main(argv) == 0
    finder = NetworkFinder(BallNetwork.load(run / BALL_NETWORK, threads=1))
    finder.add(np.zeros((50, 90, 3), np.uint8), is_duplicate=False, here_from_previous=None)
    assert finder.finish().score.shape == (1, 4)
    assert json.loads((run / "log.jsonl").read_text().splitlines()[-1])["step"] == 2
    assert "ball.onnx" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere", "--out", "run"], "DATASET: expected a folder, got nowhere"),
        (["--out", "run"], "DATASET: expected a folder, got none"),
        ([".", "--out", "run", "--batch", "1"], "--batch: expected at least 2"),
        ([".", "--out", "run", "--part", "events", "--minutes", "0"], "--minutes: expected above 0"),
        (
            [".", "tests", "--out", "run", "--part", "events"],
            "DATASETS: expected one folder, with --part events, got 2",
        ),
    ],
)
def test_bad_options_of_ball_training_are_named(words, said):
    with pytest.raises(Exception, match=said):
        main(["ball", *words])


def test_a_dataset_without_a_ball_gives_exit_4(tmp_path, capsys):
    (tmp_path / "data").mkdir()
    assert main(["ball", str(tmp_path / "data"), "--out", str(tmp_path / "run")]) == 4
    assert "expected clip folders with clip.json, camera.parquet, ball.parquet" in capsys.readouterr().err
