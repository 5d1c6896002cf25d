"""`pgm evaluate` on a small simulated dataset, with a network that has learned nothing."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from pgm_cli import evaluate as command
from pgm_cli.console import UsageError

from pgm_models.animation.evaluate_tables import read_evaluation
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.model import AnimationModel, ModelOptions, save_model
from pgm_models.animation.presets import DESIGNS, PRESETS
from pgm_models.animation.text_encoders import encoder_of
from pgm_models.model_file import MODEL_NAME


@pytest.fixture(scope="module")
def divided(tennis_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset with its second match in the split `test`."""
    copy = tmp_path_factory.mktemp("divided") / "dataset"
    shutil.copytree(tennis_dataset, copy, ignore=shutil.ignore_patterns("sha256sums.txt"))
    for path in (copy / "meta" / "episodes").glob("*/*.parquet"):
        table = pq.read_table(path)
        matches = table.column("match_id").to_pylist()
        splits = pa.array(["train" if match == min(matches) else "test" for match in matches])
        row = table.column_names.index("split")
        pq.write_table(table.set_column(row, table.schema.field(row), splits), path)
    return copy


@pytest.fixture(scope="module")
def run(divided: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose network is as it was made."""
    preset = PRESETS["nano"]
    torch.manual_seed(0)
    options = ModelOptions(
        layout=fit_layout(divided),
        network=preset.network,
        text=preset.text,
        design=DESIGNS["paper"],
        prior=None,
        encoder="hash",
        encoder_width=encoder_of("hash").width,
        frames=8,
        rates=(4.0, 25.0),
    )
    folder = tmp_path_factory.mktemp("run")
    save_model(folder / MODEL_NAME, AnimationModel(options), {})
    return folder


def words(run: Path, dataset: Path, *more: str) -> list[str]:
    few = ["--windows", "12", "--several-windows", "2", "--samples", "2", "--steps", "1", "--rate", "12.5"]
    few += ["--words", "2"]
    return [str(run), str(dataset), *few, "--threads", "1", "--device", "cpu", *more]


def test_a_run_is_scored_and_goes_on_where_it_stopped(run, divided, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    shared = ("--out", str(out), "--cache", str(tmp_path / "cache"), "--physics-rate", "25")
    assert command.main(words(run, divided, *shared, "--tasks", "prediction")) == 0
    printed = capsys.readouterr().out
    assert "12 windows of 8 frames, 12.5 frames a second" in printed and "sampler: sde_2m" in printed
    first = read_evaluation(out / "evaluation.json")
    assert first.tasks == ("prediction",) and first.keyframe_error == 0
    assert {score.rate for score in first.physics} == {12.5, 25.0}
    assert "| ceiling |" in printed and "| ceiling |" in (out / "words.md").read_text()
    assert json.loads((out / "tasks" / "words.json").read_text())["windows"] == 2
    with pytest.raises(UsageError, match="--resume"):
        command.main(words(run, divided, *shared))
    kept = (out / "tasks" / "prediction.json").stat().st_mtime_ns
    assert command.main(words(run, divided, *shared, "--resume", "--json", "--tasks", "prediction", "opponent")) == 0
    assert (out / "tasks" / "prediction.json").stat().st_mtime_ns == kept
    whole = read_evaluation(out / "evaluation.json")
    assert whole.tasks == ("prediction", "opponent")
    assert [s for s in whole.scores if s.task == "prediction"] == list(first.scores)
    assert len(json.loads(capsys.readouterr().out)["scores"]) == len(whole.scores)
    with pytest.raises(UsageError, match=r"steps \(1 then, 2 now\)"):
        command.main([*words(run, divided, *shared, "--resume", "--tasks", "prediction"), "--steps", "2"])


@pytest.mark.parametrize(
    "more, said",
    [
        (("--split", "val"), "--split: expected one of test, train, all, got 'val'"),
        (("--split", "all"), "--reference: expected a dataset with matches that are not scored"),
        (("--device", "toaster"), "--device: expected auto, cpu"),
        (("--resume",), "--out: expected a folder, as --resume"),
        (("--samples", "0"), "samples: expected at least 1, got 0"),
        (("--reference", "nowhere"), "--reference: expected a folder that pgm pack wrote"),
    ],
)
def test_options_that_do_not_fit_are_refused(run, divided, more, said):
    with pytest.raises(UsageError, match=said.replace("(", r"\(")):
        command.main([*words(run, divided), *more])


def test_a_scene_of_another_kind_and_a_run_of_nothing_are_refused(run, blocks_dataset, divided, tmp_path):
    with pytest.raises(UsageError, match="DATASET: expected one of the scene tennis, got blocks"):
        command.main(words(run, blocks_dataset))
    with pytest.raises(UsageError, match="expected a run of pgm-train animation"):
        command.main(words(tmp_path, divided))
    with pytest.raises(UsageError, match="DATASET: expected a folder that pgm pack wrote"):
        command.main(words(run, tmp_path))


def test_too_little_to_compare_is_nothing_usable(run, divided, tmp_path, capsys):
    shared = ("--cache", str(tmp_path / "cache"), "--frames", "2000")
    assert command.main(words(run, divided, *shared)) == 4
    assert "dataset: expected at least 2 windows, got 0" in capsys.readouterr().err
