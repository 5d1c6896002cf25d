"""`pgm play`: the page is served with what the runs are, and what it says where something cannot be."""

import json
import re
import socket
import threading
import urllib.request
from dataclasses import replace
from pathlib import Path

import pytest
from pgm_cli.console import UsageError
from pgm_cli.play import main

from pgm_models.animation.model import save_model
from pgm_models.synthesis.play_server import Renderer
from tests.models.animation.toy_models import toy_layout, toy_model
from tests.models.synthesis.play_stages import draw_state


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with an untrained model that knows places alone."""
    folder = tmp_path_factory.mktemp("run")
    save_model(folder / "model.safetensors", toy_model(replace(toy_layout(), constants=())), {})
    return folder


def play(run: Path, *options: str, loader=None) -> int:
    return main([str(run), *options, "--no-open", "--device", "cpu", "--seconds", "0.5"], loader)


def stage_at(url: str, kept: list) -> None:
    with urllib.request.urlopen(url + "api/stage", timeout=20) as answer:
        kept.append(json.loads(answer.read()))


class Asked:
    """Standard output that asks the page's address as soon as it is printed."""

    def __init__(self) -> None:
        self.text, self.stages = "", []

    def write(self, text: str) -> int:
        self.text += text
        if found := re.search(r"http://127\.0\.0\.1:\d+/[\w-]+/(?=\s)", self.text):
            if not self.stages:
                asking = threading.Thread(target=stage_at, args=(found[0], self.stages))
                asking.start()
                asking.join()
        return len(text)

    def flush(self) -> None:
        """Nothing is kept back."""


def test_the_page_is_served_at_the_address_that_is_printed_until_the_time_is_over(run, monkeypatch):
    out = Asked()
    monkeypatch.setattr("sys.stdout", out)
    assert play(run) == 0
    (stage,) = out.stages
    assert stage["scene"] == "tennis" and stage["animation"] == run.name and not stage["renders"]
    assert "Ctrl-C ends it" in out.text


def test_a_synthesis_run_renders(run, monkeypatch):
    out, asked = Asked(), []

    def load(path: Path, device: str) -> Renderer:
        asked.append((path, device))
        return Renderer(render=draw_state, scene="tennis", picture=(128, 72))

    monkeypatch.setattr("sys.stdout", out)
    assert play(run, "runs/syn", loader=load) == 0
    (stage,) = out.stages
    assert stage["renders"] and stage["picture"] == [128, 72] and stage["synthesis"] == "syn"
    assert asked == [(Path("runs/syn"), "cpu")]


def test_runs_that_do_not_fit_are_refused(run):
    def other(path: Path, device: str) -> Renderer:
        return Renderer(render=draw_state, scene="blocks", picture=(128, 72))

    def none(path: Path, device: str) -> Renderer:
        raise ValueError(f"{path}: expected a run of pgm-train synthesis, got nothing there")

    with pytest.raises(UsageError, match="RUN_SYN: expected a model of tennis, as RUN_ANIM is, got blocks"):
        play(run, "syn", loader=other)
    with pytest.raises(UsageError, match="RUN_SYN: syn: expected a run of pgm-train synthesis"):
        play(run, "syn", loader=none)
    with pytest.raises(UsageError, match="RUN_ANIM: .*nothing there"):
        play(run / "none")
    with pytest.raises(UsageError, match="--scene: expected tennis, of the model, got blocks"):
        play(run, "--scene", "blocks")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--steps", "0"), "--steps: expected 1 to 1000, got 0"),
        (("--port", "70000"), "--port: expected 0 to 65535"),
        (("--threads", "-1"), "--threads: expected 0 to"),
        (("--guidance", "nan"), "--guidance: expected -100 to 100, got nan"),
    ],
)
def test_options_that_cannot_be_are_refused(run, options, said):
    with pytest.raises(UsageError, match=said):
        play(run, *options)


def test_a_port_that_is_taken_is_said(run):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(UsageError, match="--port: expected one that is free"):
            play(run, "--port", str(taken.getsockname()[1]))
