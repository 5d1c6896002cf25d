"""`pgm view` refuses what it cannot show, and serves what it can until it is told to end."""

import re
import threading
import time
import urllib.request
from importlib.util import find_spec
from pathlib import Path

import pytest
from pgm_cli import view
from pgm_cli.main import run

from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("work")
    for name in ("a", "b"):
        write_truth_clip(folder / name, load_scene("tennis"), frames=8)
    return folder


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--clip", "c"], "--clip: expected one of a, b, got c"),
        (["--port", "0"], "--port: expected 1 to 65535, got 0"),
        (["--port", "99999"], "--port: expected 1 to 65535"),
        (["--seconds", "-1"], "--seconds: expected 0 or more"),
        (["--seconds", "nan"], "--seconds: expected 0 or more"),
        (["--videos", "/nowhere"], "--videos: expected a folder, got /nowhere"),
    ],
)
def test_options_that_cannot_be_are_refused(
    work: Path, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["view", str(work), *options]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_without_clips_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["view", str(tmp_path)]) == 2
    assert "expected clips with a camera.parquet" in capsys.readouterr().err
    assert run(["view", str(tmp_path / "nothing")]) == 2
    assert "nothing there" in capsys.readouterr().err


def test_without_the_viewer_the_extra_is_named(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(view, "find_spec", lambda name: None)
    assert run(["view", str(work)]) == 2
    assert "expected the package viser, found none: pip install 'pgm[viz]'" in capsys.readouterr().err


needs_viser = pytest.mark.skipif(find_spec("viser") is None, reason="the extra viz is not installed")


@needs_viser
def test_a_clip_that_cannot_be_read_ends_with_4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_truth_clip(tmp_path / "a", load_scene("tennis"), frames=8)
    (tmp_path / "a" / "camera.parquet").write_bytes(b"PAR1")
    assert run(["view", str(tmp_path), "--no-open", "--seconds", "1"]) == 4
    assert "camera.parquet" in capsys.readouterr().err


@needs_viser
def test_the_page_is_served_until_the_time_is_over(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    codes: list[int] = []
    options = ["--clip", "b", "--no-open", "--seconds", "3", "--port", "18191", "--pictures"]
    served = threading.Thread(target=lambda: codes.append(run(["view", str(work), *options])))
    served.start()
    page, said, complained = b"", "", ""
    for _ in range(100):
        time.sleep(0.05)
        told = capsys.readouterr()
        said, complained = said + told.out, complained + told.err
        found = re.search(r"http://127\.0\.0\.1:\d+", said)
        if found is not None:
            with urllib.request.urlopen(found[0], timeout=5) as answer:
                page = answer.read()
            break
    served.join(timeout=30)
    told = capsys.readouterr()
    said, complained = said + told.out, complained + told.err
    assert codes == [0] and b"<html" in page.lower() and "b, 8 frames" in said
    # The clip's video was never drawn.
    assert "b: no pictures: source_path: expected its video" in complained
