"""The demo runs end to end, replaces its own folder, leaves others alone, and says what it went without."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pgm_cli import demo_models, simulate
from pgm_cli.console import UsageError
from pgm_cli.demo import OURS, main
from pgm_cli.demo_models import DemoModels, play_rally, render_videos, train_renderer
from pgm_cli.demo_steps import DemoSteps

from pgm_data.dataset.documents import read_document
from pgm_data.stages.demo_report import MARK
from pgm_data.video import open_video
from pgm_models.animation.model import save_model
from tests.models.animation.toy_models import toy_layout
from tests.models.animation.toy_models import toy_model as toy_animation
from tests.models.synthesis.drawn_matches import drawn_matches
from tests.models.synthesis.toy_models import toy_model, toy_run

LENGTH = 6
"""Frames of the rally."""


@pytest.fixture(autouse=True)
def no_commit(monkeypatch):
    """Asking git takes longer than a video."""
    monkeypatch.setattr("pgm_data.provenance.commit", lambda: "")


@pytest.fixture
def animation(tmp_path: Path) -> Path:
    """An untrained animation model, which reads without fetched weights."""
    path = tmp_path / "animation" / "model.safetensors"
    save_model(path, toy_animation(replace(toy_layout(), constants=())), {})
    return path


@pytest.fixture
def prompt(tmp_path: Path) -> Path:
    path = tmp_path / "few_words.json"
    texts = [{"player": 0, "start_frame": 0, "end_frame": LENGTH, "text": "the player serves"}]
    told = {"scene": "tennis", "n_frames": LENGTH, "frames_per_second": 25, "seed": 5, "texts": texts}
    path.write_text(json.dumps(told))
    return path


def frames(path: Path) -> int:
    with open_video(path) as video:
        return sum(1 for _ in video)


def test_it_goes_from_a_drawn_match_to_a_rendered_rally_on_one_page_and_the_next_one_replaces_it(
    tmp_path, animation, prompt, capsys, monkeypatch
):
    out = tmp_path / "demo"
    argv = ["--out", str(out), "--seconds", "1", "--seed", "3", "--animation", str(animation), "--prompt", str(prompt)]
    argv += ["--synthesis-preset", "nano", "--synthesis-minutes", "0.01", "--threads", "1"]
    assert main(argv) == 0
    told = capsys.readouterr().out
    assert "error of the camera's position" in told
    assert told.strip().splitlines()[-1].endswith(str(out / "report.html"))
    assert (out / "work" / "report.html").is_file()
    assert list((out / "work").glob("*/overlay.mp4"))
    assert {path.name for path in out.iterdir()} == {*OURS, "report.html"}
    # The rally is seen from where the match was, in pictures of its size.
    camera = read_document(out / "prompt" / "camera.json", "camera")
    clip = read_document(next((out / "work").glob("*/clip.json")), "clip")
    assert (camera["width"], camera["height"]) == (clip["width"], clip["height"])
    videos = sorted((out / "rendered").glob("*.mp4"))
    assert [(path.name, frames(path)) for path in videos] == [("rally.mp4", LENGTH), ("rally_orbit.mp4", LENGTH)]
    page = (out / "report.html").read_text()
    assert "rendered/rally.mp4" in page and "the player serves" in page and "error of the camera" in page
    assert "pgm-train synthesis" in page and "data:image/png" in page
    # The next one ends where it would draw, and what it would draw into is empty by then.
    monkeypatch.setattr(
        simulate, "main", lambda argv: 7 + sum((out / name).exists() for name in (*OURS, "report.html"))
    )
    assert main(argv) == 7


@pytest.fixture
def models(tmp_path: Path) -> DemoModels:
    """A demo's models, of which the one that plays is not there."""
    out = tmp_path / "demo"
    none = tmp_path / "none"
    return DemoModels(out=out, scene="tennis", animation=none, prompt=None, preset="nano", minutes=0.0, threads=1)


def test_without_a_model_that_plays_the_match_itself_is_rendered(models, monkeypatch):
    steps = DemoSteps()
    went = play_rally(models, steps)
    assert went.code == 0 and "no rally is played" in went.why and "none" in went.why
    drawn_matches(models.out, frames=4)
    toy_run(models.run, toy_model())
    monkeypatch.setattr(demo_models, "CLIP_SECONDS", 0.08)
    went, videos = render_videos(models, steps)
    assert went.code == 0 and not went.why
    assert [(video.path.name, frames(video.path)) for video in videos] == [("clip.mp4", 2), ("clip_orbit.mp4", 2)]
    assert all("for want of a rally" in video.caption for video in videos)


def test_weights_that_did_not_ship_are_missed_in_words(models, monkeypatch):
    monkeypatch.setattr("pgm_models.animation.model.SHIPPED", ("tennis_unshipped",))
    went = play_rally(replace(models, animation=Path("tennis_unshipped")), DemoSteps())
    assert went.code == 0 and "weights of tennis_unshipped are not in this copy" in went.why


def test_a_model_of_another_scene_plays_no_rally(models, animation):
    went = play_rally(replace(models, animation=animation, scene="blocks"), DemoSteps())
    assert went.code == 0 and "plays tennis, and the video shows blocks" in went.why


def test_no_minutes_train_nothing(models):
    went, trained = train_renderer(models, DemoSteps())
    assert went.code == 0 and trained is None and "no minutes" in went.why


def test_steps_remember_their_commands_as_a_shell_takes_them(capsys):
    steps = DemoSteps()
    with steps.step(4, "throwing"):
        assert steps.run("pgm throw", len, ["a ball", Path("out")]) == 2
    assert [(step.number, step.title, step.commands) for step in steps.done] == [
        (4, "throwing", ("pgm throw 'a ball' out",))
    ]
    assert capsys.readouterr().out.splitlines()[0] == "4. throwing"


def test_a_folder_of_the_same_name_that_no_demo_wrote_is_left_alone(tmp_path):
    (tmp_path / "work").mkdir()
    precious = tmp_path / "work" / "thesis.txt"
    precious.write_text("mine")
    with pytest.raises(UsageError, match="work"):
        main(["--out", str(tmp_path)])
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("name", ["thesis.txt", "report.html"])
def test_a_folder_with_something_else_in_it_is_left_alone(name, tmp_path):
    precious = tmp_path / name
    precious.write_text("mine")
    with pytest.raises(UsageError, match=name):
        main(["--out", str(tmp_path)])
    assert precious.read_text() == "mine"


def test_the_page_of_an_earlier_demo_is_no_stranger(tmp_path, monkeypatch):
    (tmp_path / "report.html").write_text(MARK)
    monkeypatch.setattr(simulate, "main", lambda argv: 7 + (tmp_path / "report.html").exists())
    assert main(["--out", str(tmp_path)]) == 7


@pytest.mark.parametrize(
    "arguments",
    [
        ["--video", "absent.mp4"],
        ["--prompt", "absent.json"],
        ["--seconds", "0"],
        ["--synthesis-minutes", "-1"],
        ["--threads", "0"],
    ],
)
def test_bad_options_are_refused(arguments, tmp_path):
    with pytest.raises(UsageError):
        main([*arguments, "--out", str(tmp_path / "new")])
