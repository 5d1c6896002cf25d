"""`run.json` says which program ran, with what options, where."""

import json
import subprocess
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, timezone
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from pgm_data import __version__
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.provenance import commit, installed_version, machine, plain, run_document, versions


class Quality(Enum):
    DRAFT = "draft"


@dataclass(frozen=True)
class Inner:
    size: tuple[int, int] = (3, 4)


@dataclass(frozen=True)
class Options:
    out: Path = Path("work")
    quality: Quality = Quality.DRAFT
    inner: Inner = field(default_factory=Inner)
    limit: int | None = None
    weights: frozenset[str] = frozenset({"b", "a"})


def test_options_become_json_values() -> None:
    found = plain({"options": Options(), "K": np.eye(2), "n": np.int64(3), "s": np.float32(0.5)})
    assert found == json.loads(json.dumps(found))
    assert found == {
        "options": {
            "out": "work",
            "quality": "draft",
            "inner": {"size": [3, 4]},
            "limit": None,
            "weights": ["a", "b"],
        },
        "K": [[1.0, 0.0], [0.0, 1.0]],
        "n": 3,
        "s": 0.5,
    }


@pytest.mark.parametrize(
    ("value", "error"), [(float("nan"), ValueError), (np.array([np.inf]), ValueError), (len, TypeError)]
)
def test_what_json_has_not_is_refused(value: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="options: expected"):
        plain([value])


def test_the_run_document_holds_to_its_schema(tmp_path: Path) -> None:
    started = datetime.now(timezone(timedelta(hours=2))) - timedelta(seconds=90)
    inputs = [{"path": "a.mp4", "state": "ok", "reason": "", "clips": ["a"], "seconds": 1.5}]
    document = run_document(command="pgm-calibrate", options=Options(), started=started, inputs=inputs)
    write_document(tmp_path / "run.json", "run", document)
    read = read_document(tmp_path / "run.json", "run")
    assert read["inputs"] == inputs
    assert 90 <= read["seconds"] < 150
    assert datetime.fromisoformat(read["started"]) == started.replace(microsecond=0)
    assert read["started"].endswith("+00:00")


def test_versions_are_those_that_the_modules_say_of_themselves() -> None:
    found = versions()
    assert found["pgm"] == __version__
    assert found["numpy"] == np.__version__
    assert installed_version("a-distribution-that-nobody-made") == ""
    assert "" not in found.values()


def test_the_machine_has_cores_and_memory() -> None:
    found = machine()
    assert int(found["cores"]) >= 1
    assert int(found["memory_bytes"]) > 2**28


def test_the_commit_is_that_of_the_checkout_and_says_when_files_differ(tmp_path: Path) -> None:
    assert commit(tmp_path) == ""

    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "commit.gpgsign=false"]
        done = subprocess.run(
            ["git", "-C", str(tmp_path), *identity, *arguments], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    git("init", "--quiet")
    assert commit(tmp_path) == ""
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("commit", "--quiet", "-m", "one")
    head = git("rev-parse", "HEAD")
    (tmp_path / "work").touch()
    assert commit(tmp_path) == head
    (tmp_path / "file").write_text("two")
    assert commit(tmp_path) == f"{head}+changes"


def test_run_documents_of_naive_moments_are_refused() -> None:
    with pytest.raises(TypeError):
        run_document(command="x", options={}, started=datetime.now(UTC).replace(tzinfo=None))
