"""`pgm stats` prints the table of a dataset, or its numbers, and writes both with the pictures."""

import json
import shutil
from pathlib import Path

import pytest
from pgm_cli.main import run

from pgm_data.dataset.pack import pack_work_folders
from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("counted")
    write_truth_clip(root / "work" / "walk", load_scene("blocks"), frames=8)
    pack_work_folders([root / "work"], root / "dataset")
    return root / "dataset"


def test_the_table_is_printed_and_written_with_its_pictures(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["stats", str(dataset), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "| Sequences" in said and "| Unique words" in said
    assert (tmp_path / "out" / "stats.md").read_text() == said
    names = {path.name for path in (tmp_path / "out").iterdir() if not path.name.startswith(".")}
    assert names == {"stats.md", "summary.json", "durations.svg", "words.svg", "spans.svg", "parts.svg"}
    assert run(["stats", str(dataset), "--out", str(tmp_path / "out")]) == 2
    assert run(["stats", str(dataset), "--out", str(tmp_path / "out"), "--overwrite"]) == 0


def test_numbers_are_printed_as_one_document(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["stats", str(dataset), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scene"] == "blocks" and found["splits"]["train"]["frames"] == 8
    assert set(found["histograms"]) == {"durations", "words", "spans", "parts"}


def test_what_is_no_dataset_is_refused_and_a_broken_one_named(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["stats", str(tmp_path)]) == 2
    assert "DATASET: expected a folder that pgm pack wrote" in capsys.readouterr().err
    shutil.copytree(dataset, tmp_path / "broken")
    next((tmp_path / "broken" / "captions").rglob("*.parquet")).write_bytes(b"no parquet")
    assert run(["stats", str(tmp_path / "broken")]) == 2
    assert "pgm check" in capsys.readouterr().err
