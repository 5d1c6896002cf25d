"""`pgm render`: clips in, videos out, and what it says where something cannot be."""

import json
import shutil
import signal

import numpy as np
import pytest
from pgm_cli.console import UsageError
from pgm_cli.main import run_verb
from pgm_cli.render import main

from pgm_data.dataset.documents import read_document
from pgm_data.video import open_video
from pgm_models.animation.model import save_model
from tests.models.animation.toy_models import toy_layout
from tests.models.animation.toy_models import toy_model as toy_animation
from tests.models.synthesis.drawn_matches import drawn_matches
from tests.models.synthesis.toy_models import PICTURE, toy_model, toy_run

FRAMES = 5


@pytest.fixture(autouse=True)
def no_commit(monkeypatch):
    """Asking git takes longer than a video."""
    monkeypatch.setattr("pgm_data.provenance.commit", lambda: "")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a model as if it had been trained."""
    return toy_run(tmp_path_factory.mktemp("run"), toy_model())


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    """A work folder of two drawn matches, with videos."""
    return drawn_matches(tmp_path_factory.mktemp("drawn"), frames=FRAMES) / "work"


def render(run, source, out, *options):
    return main([str(run), str(source), "--out", str(out), "--device", "cpu", *map(str, options)])


def pictures(path):
    with open_video(path) as video:
        return [frame.bgr() for frame in video]


def test_a_clip_becomes_a_video_with_masks_and_a_word_about_its_making(run, work, tmp_path, capsys):
    out = tmp_path / "new" / "rally.mp4"
    assert render(run, work, out, "--clip", "match0", "--depth", "--masks", "--threads", "1") == 0
    names = ["rally.depth.mkv", "rally.labels.mkv", "rally.mp4", "rally.run.json"]
    assert sorted(path.name for path in out.parent.iterdir()) == names
    said = capsys.readouterr()
    assert f"{FRAMES} frames of {PICTURE[0]}x{PICTURE[1]}, 25 a second" in said.out
    assert "as in the pictures of match0" in said.out
    assert "frames/s" in said.err
    with open_video(out) as video:
        assert (video.info.width, video.info.height) == PICTURE
        assert len(list(video)) == FRAMES
    document = read_document(out.with_suffix(".run.json"), "run")
    assert document["command"] == "pgm render"
    assert document["options"]["video"] == {"frames": [0, FRAMES], "fps": 25.0, "crf": 18}
    assert len(document["options"]["asked"]["model_sha256"]) == 64
    assert document["inputs"][0]["clips"] == ["match0"]


def test_options_change_what_is_seen(run, work, tmp_path):
    path = tmp_path / "file.json"  # beside file.mp4, and left alone
    key = {"time": 0, "position": [3, -20, 5], "look_at": [0, -9, 1]}
    text = json.dumps({"width": 32, "height": 24, "keys": [key]})
    path.write_text(text)
    seen = {}
    for name, options in {
        "own": (),
        "file": ("--camera", path),
        "orbit": ("--orbit", "--turn-deg-s", "300", "--radius-m", "40"),
        "style": ("--style", "player0=match1", "court=match1"),
        "less": ("--without", "court", "--quality", "draft"),
        "wide": ("--resolution", "96x30", "--fps", "5"),
    }.items():
        out = tmp_path / f"{name}.mp4"
        style = () if "--style" in options else ("--style", "match0")
        assert render(run, work, out, "--clip", "match0", "--frames", "1:3", *style, *options) == 0
        seen[name] = pictures(out)
    assert {name: (len(each), each[0].shape[1::-1]) for name, each in seen.items()} == {
        **dict.fromkeys(seen, (2, PICTURE)),
        "file": (2, (48, 36)),  # a picture of that shape as large as those that were learned
        "wide": (2, (96, 30)),
    }
    assert path.read_text() == text
    for name in ("orbit", "style", "less"):
        assert np.abs(seen[name][0].astype(int) - seen["own"][0]).max() > 40, name
    assert np.abs(seen["orbit"][1].astype(int) - seen["orbit"][0]).max() > 40
    assert read_document(tmp_path / "wide.run.json", "run")["options"]["video"]["fps"] == 5.0


def test_an_interrupted_video_is_resumed(run, work, tmp_path, monkeypatch, capsys):
    from pgm_models.synthesis import render_run

    words = ["render", str(run), str(work), "--clip", "match1", "--device", "cpu", "--style", "match0", "--out"]
    assert run_verb("render", [*words[1:], str(tmp_path / "whole.mp4")]) == 0
    keep, kept = render_run._keep, []

    def interrupted(plan, number, *images):
        keep(plan, number, *images)
        kept.append(number)
        if kept == [0, 1]:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(render_run, "_keep", interrupted)
    out = tmp_path / "rally.mp4"
    assert run_verb("render", [*words[1:], str(out)]) == 130
    assert not out.exists() and (tmp_path / "rally.mp4.parts").is_dir()
    assert "--resume goes on" in capsys.readouterr().err
    assert run_verb("render", [*words[1:], str(out)]) == 2
    assert "rally.mp4.parts with" in capsys.readouterr().err
    assert run_verb("render", [*words[1:], str(out), "--resume", "--quality", "draft"]) == 2
    assert "--resume: expected quality as of the frames" in capsys.readouterr().err
    assert run_verb("render", [*words[1:], str(out), "--resume"]) == 0
    assert kept == list(range(FRAMES))
    assert out.read_bytes() == (tmp_path / "whole.mp4").read_bytes()
    assert not (tmp_path / "rally.mp4.parts").exists()
    capsys.readouterr()
    assert run_verb("render", [*words[1:], str(out), "--resume"]) == 0
    assert "done before" in capsys.readouterr().out
    assert run_verb("render", [*words[1:], str(out), "--resume", "--crf", "30"]) == 2
    assert "--out: expected a new file, or --overwrite" in capsys.readouterr().err
    assert run_verb("render", [*words[1:], str(out), "--overwrite", "--frames", "0:1"]) == 0
    assert len(pictures(out)) == 1


def test_generated_play_is_rendered_in_what_the_first_match_wore(run, tmp_path, capsys):
    from dataclasses import replace

    from pgm_cli.animate import main as animate

    save_model(tmp_path / "anim" / "model.safetensors", toy_animation(replace(toy_layout(), constants=())), {})
    prompt = {"scene": "tennis", "n_frames": 6, "frames_per_second": 25, "seed": 5}
    (tmp_path / "prompt.json").write_text(json.dumps(prompt))
    words = [str(tmp_path / "anim"), "--prompt", str(tmp_path / "prompt.json"), "--out", str(tmp_path / "made")]
    assert animate([*words, "--steps", "1", "--device", "cpu"]) == 0
    capsys.readouterr()
    assert render(run, tmp_path / "made", tmp_path / "made.mp4") == 0
    said = capsys.readouterr().out
    assert "as in the match match0 that the model learned from, as prompt has no video" in said
    # That model knows places alone, and no joints.
    assert "player0: none in 6 of 6 frames, which are without it" in said
    assert read_document(tmp_path / "made.run.json", "run")["options"]["missing"]["player0"] == 6
    assert len(pictures(tmp_path / "made.mp4")) == 6


def test_what_cannot_be_is_refused_in_words(run, work, tmp_path):
    out = tmp_path / "a.mp4"
    (tmp_path / "bad.json").write_text('{"width": 64, "height": 36, "keys": []}')
    (tmp_path / "none").mkdir()
    for options, said in (
        (("--clip", "match9"), "--clip: expected one of match0, match1, got 'match9'"),
        ((), "--clip: expected one, to say which, of match0, match1, got none"),
        (("--clip", "match0", "--camera", tmp_path / "bad.json"), "--camera: .*keys: expected one or more, got none"),
        (("--clip", "match0", "--camera", tmp_path / "no.json"), "--camera: .*nothing there"),
        (("--clip", "match0", "--resolution", "0x5"), "--resolution: expected WxH"),
        (("--clip", "match0", "--resolution", "wide"), "--resolution: expected WxH"),
        (("--clip", "match0", "--resolution", "99999x99999"), "--resolution: expected WxH, .* of at most"),
        (("--clip", "match0", "--frames", "3:9"), "--frames: expected A:B within 0:5 of match0, got 3:9"),
        (("--clip", "match0", "--frames", "3"), "--frames: expected A:B"),
        (("--clip", "match0", "--style", "match9"), "--style: expected a match of the model .match0, match1."),
        (("--clip", "match0", "--style", "umpire=match1"), "--style: expected an object among player0, .*got 'umpire'"),
        (("--clip", "match0", "--without", "umpire"), "--without: expected objects among player0, .*got umpire"),
        (("--clip", "match0", "--insert", "sword"), "--insert: sword: expected PLAYER=JOINT"),
        (("--clip", "match0", "--orbit", "--dolly"), "--orbit, --dolly: expected one of them, got 2"),
        (("--clip", "match0", "--crf", "99"), "--crf: expected 0 to 51, got 99"),
        (("--clip", "match0", "--elevation-deg", "90"), "--elevation-deg: expected -89 to 89, got 90"),
        (("--clip", "match0", "--device", "gpu9"), "--device: expected"),
    ):
        with pytest.raises(UsageError, match=said):
            render(run, work, out, *options)
    with pytest.raises(UsageError, match="RUN: .*expected a run of pgm-train synthesis, got nothing there"):
        render(tmp_path / "gone", work, out, "--clip", "match0")
    save_model(tmp_path / "other" / "model.safetensors", toy_animation(toy_layout()), {})
    with pytest.raises(UsageError, match="RUN: .*expected a model of pgm-train synthesis, got .* something else"):
        render(tmp_path / "other", work, out, "--clip", "match0")
    with pytest.raises(UsageError, match="SOURCE: .*expected a packed dataset or a work folder, got no clip"):
        render(run, tmp_path / "none", out)
    with pytest.raises(UsageError, match="SOURCE: expected a clip of blocks, as RUN is, got one of tennis"):
        render(toy_run(tmp_path / "blocks", toy_model("blocks")), work, out, "--clip", "match0")
    with pytest.raises(UsageError, match="--out: expected a file ending in .mp4"):
        render(run, work, tmp_path / "a.gif", "--clip", "match0")
    assert not out.exists() and not list(tmp_path.glob("*.parts"))
    for name in ("a.mp4", "a.run.json", "a.depth.mkv"):
        shutil.copy(__file__, tmp_path / name)
        with pytest.raises(
            UsageError, match=f"--out: expected a new file, or --overwrite, got .*{name}, which is there"
        ):
            render(run, work, out, "--clip", "match0", "--depth")
        (tmp_path / name).unlink()
