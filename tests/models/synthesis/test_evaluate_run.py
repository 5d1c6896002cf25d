"""`pgm evaluate` of a synthesis run that has hardly learned, on drawn matches."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pgm_cli import evaluate as command
from pgm_cli.console import UsageError

from pgm_data.simulate.mask_files import write_masks
from pgm_data.simulate.shots import Masks
from pgm_models.image_networks import MetricUnavailable
from pgm_models.markdown_table import markdown_table
from pgm_models.model_file import MODEL_NAME
from pgm_models.synthesis.evaluate_about import about_run
from pgm_models.synthesis.evaluate_choice import STRETCH, chosen_frames, stretches
from pgm_models.synthesis.evaluate_maker import nobody, worn_in
from pgm_models.synthesis.evaluate_networks import Networks, WordTaker
from pgm_models.synthesis.frames import FrameStore, read_frames
from pgm_models.synthesis.model import SynthesisModel, save_model
from pgm_models.synthesis.run import SynthesisRunOptions, train_synthesis
from tests.models.synthesis.drawn_matches import FRAMES, drawn_matches, packed

HELD_OUT = 0.25


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two drawn matches and their labels."""
    out = drawn_matches(tmp_path_factory.mktemp("drawn"))
    packed(out)
    rng = np.random.default_rng(0)
    for number in range(2):
        labels = rng.integers(1, 6, (FRAMES, 6, 8)).astype(np.uint8).repeat(18, axis=1).repeat(24, axis=2)
        masks = (Masks(labels=one, depth=np.full(one.shape, 9.0, np.float32)) for one in labels)
        write_masks(out / "work" / f"match{number}", masks, fps=25.0)
    (out / "work" / "run.json").write_text(json.dumps({"command": "pgm calibrate", "options": {}}))
    return out


@pytest.fixture(scope="module")
def run(folder, tmp_path_factory) -> Path:
    """A run of three steps."""
    out = tmp_path_factory.mktemp("runs") / "run"
    values = {"preset": "nano", "steps": 3, "threads": 1, "device": "cpu", "held_out": HELD_OUT}
    train_synthesis(SynthesisRunOptions(dataset=folder / "dataset", run=out, **values), command=["x"])
    return out


@pytest.fixture(scope="module")
def store(folder) -> FrameStore:
    return read_frames(folder / "dataset")


def words(run: Path, folder: Path, *more: str) -> list[str]:
    few = ["--frames", "12", "--efficiency-resolution", "48x27", "--dense-share", "9", "--efficiency-frames", "1"]
    return [str(run), str(folder / "dataset"), *few, "--threads", "1", "--device", "cpu", *more]


def test_a_run_is_scored_on_frames_that_it_has_not_learned_and_goes_on_where_it_stopped(run, folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert command.main(words(run, folder, "--out", str(out))) == 0
    printed = capsys.readouterr().out
    for said in ("split: held-out", "judged frames: 12", "player0-alpha", "MS-SSIM (3 scales)", "n/a", "dense / ours"):
        assert said in printed, said
    assert "Novel views: n/a (the simulator's work folder was not given)" in printed
    assert (out / "evaluation.md").read_text() == printed
    found = json.loads((out / "evaluation.json").read_text())
    assert found["frames"] == 12 and found["size"] == [128, 72]
    assert found["efficiency"][0]["largest_difference"] < 1e-4
    assert {each["where"] for each in found["likeness"]} >= {"frame", "player0-alpha", "ball", "court-alpha"}
    assert all(np.isfinite(each["psnr"]) for each in found["likeness"] if each["where"] == "frame")
    assert found["frechet"] == {"FID": "n/a (FID: weights not given)", "FVD": "n/a (FVD: weights not given)"}
    rows = list(csv.DictReader((out / "frames.csv").read_text().splitlines()))
    assert {row["clip"] for row in rows} == {"match0", "match1"} and len(rows) == 12
    assert min(int(row["frame"]) for row in rows) >= FRAMES * (1 - HELD_OUT)
    assert json.loads((out / "run.json").read_text())["inputs"][0]["clips"] == ["match0", "match1"]
    assert (out / "pictures.png").read_bytes()[:4] == b"\x89PNG"
    with pytest.raises(UsageError, match="--resume"):
        command.main(words(run, folder, "--out", str(out)))
    parts = sorted((out / "parts").glob("*.json"))
    assert [path.name for path in parts] == ["clip-match0.json", "clip-match1.json", "efficiency.json"]
    (out / "parts" / "clip-match1.json").unlink()
    kept = parts[0].stat().st_mtime_ns
    assert command.main(words(run, folder, "--out", str(out), "--resume", "--json")) == 0
    again = json.loads(capsys.readouterr().out)
    assert parts[0].stat().st_mtime_ns == kept and again["likeness"] == found["likeness"]
    assert again["efficiency"] == found["efficiency"]
    with pytest.raises(UsageError, match=r"judged frames \(12 then, 8 now\)"):
        command.main([*words(run, folder, "--out", str(out), "--resume"), "--frames", "8"])


def test_true_masks_take_the_place_of_rendered_ones(run, folder, capsys):
    more = ("--truth", str(folder / "work"), "--split", "all", "--efficiency-frames", "0", "--json")
    assert command.main(words(run, folder, *more)) == 0
    found = json.loads(capsys.readouterr().out)
    places = {each["where"] for each in found["likeness"]}
    assert places == {"frame", "player0", "player1", "ball", "court", "backplate", "net"}
    assert found["about"]["split"] == "all" and found["about"]["masks"] == "true"
    assert set(found["silhouettes"]) == {"player0", "player1"}
    assert "expected pgm simulate, got pgm calibrate" in found["novel_view"]
    assert found["efficiency"] == "not asked for"


@pytest.mark.parametrize(
    "more, said",
    [
        (("--truth", "nowhere"), "--truth: expected a work folder, with run.json, got nowhere"),
        (("--resolution", "big"), "--resolution: expected WIDTHxHEIGHT"),
        (("--frames", "-1"), "--frames: expected 0 or more, got -1"),
        (("--dense-share", "0"), "--dense-share: expected 1 or more, got 0"),
        (("--dense-share", "99"), "--dense-share: expected at most 54"),
        (("--overwrite",), "--out: expected a folder, as --resume or --overwrite is given"),
        (("--device", "toaster"), "--device: expected auto, cpu"),
        (("--weights.fid", "nowhere.pth"), "no file nowhere.pth"),
    ],
)
def test_options_that_do_not_fit_are_refused(run, folder, more, said):
    with pytest.raises(UsageError, match=said):
        command.main([*words(run, folder), *more])


def test_a_run_is_told_by_what_its_files_say(run, tmp_path):
    about = about_run(run)
    assert about is not None and about["data"]["held_out"] == HELD_OUT and about["step"] == 3
    assert about_run(run / MODEL_NAME) == about
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "checkpoint.safetensors").write_bytes((run / "checkpoint.safetensors").read_bytes())
    unfinished = about_run(tmp_path / "run")
    assert unfinished is not None and unfinished["step"] == 3 and unfinished["data"] == about["data"]
    for content in (b"", b"short", b"\x05\0\0\0\0\0\0\0{]}", b"\x02\0\0\0\0\0\0\0[]", b"\xff" * 40):
        (tmp_path / "model.safetensors").write_bytes(content)
        assert about_run(tmp_path) is None, content
    assert about_run(tmp_path / "nothing") is None


def test_the_datasets_own_held_out_frames_are_judged_and_of_others_all_but_the_first_tenth(store):
    about = {"data": {"dataset": "own", "held_out": HELD_OUT, "frames": 2 * 27}}
    own = chosen_frames(store, about, "own", "auto", 0)
    assert own.split == "held-out" and len(own.judged) == 18 and np.array_equal(own.lent, own.learned)
    assert (store.frame[own.judged] >= 27).all() and (store.frame[own.lent] < 27).all()
    other = chosen_frames(store, about, "other", "auto", 0)
    assert other.split == "all" and len(other.learned) == 0 and len(other.lent) == 2 * 4
    assert (store.frame[other.lent] < 4).all() and (store.frame[other.judged] >= 4).all()
    fewer = {"data": {**about["data"], "frames": 50}}  # other frames of a dataset of the same name
    assert chosen_frames(store, fewer, "own", "auto", 0).split == "all"
    with pytest.raises(ValueError, match="expected frames that the run has not learned from"):
        chosen_frames(store, {"data": {"held_out": 0.0}}, "own", "held-out", 0)


@pytest.mark.parametrize("count, most", [(10, 0), (10, 20), (10, 4), (200, 60), (200, 49)])
def test_stretches_are_frames_that_follow_each_other(count, most):
    rows = np.arange(count) * 2
    found = stretches(rows, most)
    assert len(found) <= (most or count) and (np.diff(found) > 0).all() and np.isin(found, rows).all()
    if 0 < most < count:
        assert len(found) > 0.9 * most
        runs = np.split(found, np.flatnonzero(np.diff(found) != 2) + 1)
        assert max(len(each) for each in runs) <= STRETCH or len(runs) == 1
        assert found[0] == rows[0] and found[-1] == rows[-1] or len(runs) == 1


def test_styles_are_read_off_frames_where_the_same_people_stand(store):
    judged, lent = np.flatnonzero(store.frame >= 30), np.flatnonzero(store.frame < 30)
    identity = store.identity.copy()
    swapped = (store.clip == 0) & ((store.frame < 10) | (store.frame >= 33))
    identity[swapped] = identity[swapped][:, ::-1]
    changed = replace(store, identity=identity)
    worn = worn_in(changed, judged, lent)
    assert len(worn) == 3 and sorted(np.concatenate([each.rows for each in worn])) == judged.tolist()
    for each in worn:
        assert len(np.unique(changed.identity[np.concatenate([each.rows, each.read])], axis=0)) == 1
        assert len(np.unique(store.clip[np.concatenate([each.rows, each.read])])) == 1
    strangers = worn_in(changed, judged, lent[(store.clip[lent] == 1) | (store.frame[lent] >= 10)])
    assert all(len(each.read) for each in strangers)
    with pytest.raises(ValueError, match="match match0: expected frames that are not judged"):
        worn_in(store, judged, lent[store.clip[lent] == 1])


def test_nobody_is_there_where_all_have_left(store):
    gone = nobody(store.states([0, 1]))
    assert not any(poses.present.any() for poses in gone.poses.values())
    assert gone.balls is not None and not gone.balls.present.any()


def test_words_are_one_a_picture_and_one_a_clip_of_sixteen(monkeypatch):
    from pgm_models import image_inception
    from pgm_models.synthesis import evaluate_networks

    class Fid(evaluate_networks.FidNetwork):
        def __init__(self) -> None:
            torch.nn.Module.__init__(self)

        def forward(self, pictures: torch.Tensor) -> torch.Tensor:
            return pictures.mean(dim=(2, 3))

    class Fvd(evaluate_networks.FvdNetwork):
        def __init__(self) -> None:
            torch.nn.Module.__init__(self)

        def forward(self, clips: torch.Tensor) -> torch.Tensor:
            return clips.mean(dim=(1, 3, 4)) + 0 * clips.shape[1]

    def words_of(network, batches):
        return np.concatenate([network(batch).double().numpy() for batch in batches])

    monkeypatch.setattr(evaluate_networks, "words_of", words_of)
    assert image_inception.LEAST_FRAMES <= evaluate_networks.CLIP_FRAMES
    missing = MetricUnavailable("LPIPS: weights not given")
    networks = Networks(lpips=missing, fid=Fid(), fvd=Fvd(), device=torch.device("cpu"))
    made = np.random.default_rng(0).random((37, 3, 4, 5)).astype(np.float32)
    taker = WordTaker(networks)
    for start in range(0, 37, 7):
        taker(made[start : start + 7], 0.5 * made[start : start + 7])
    found = taker.words
    np.testing.assert_allclose(found["fid made"], made.mean(axis=(2, 3)), rtol=1e-5)
    clips = made[:32].reshape(2, 16, 3, 4, 5).mean(axis=(1, 3, 4))
    np.testing.assert_allclose(found["fvd made"], clips, rtol=1e-5)
    np.testing.assert_allclose(found["fvd real"], 0.5 * clips, rtol=1e-5)
    assert np.isnan(networks.distances(made, made)).all() and len(networks.distances(made, made)) == 37


def test_a_model_of_another_scene_and_a_folder_of_nothing_are_refused(run, folder, tmp_path):
    from pgm_models.synthesis.model import load_model

    blocks = replace(load_model(run).options, scene="blocks")
    save_model(tmp_path / "blocks" / MODEL_NAME, SynthesisModel(blocks), {})
    with pytest.raises(UsageError, match="DATASET: expected one of the scene blocks, got tennis"):
        command.main(words(tmp_path / "blocks", folder))
    with pytest.raises(UsageError, match="DATASET: expected a folder that pgm pack wrote"):
        command.main([str(run), str(tmp_path)])
    with pytest.raises(UsageError, match="expected a run of pgm-train animation"):
        command.main([str(tmp_path), str(folder / "dataset")])


def test_tables_are_aligned_and_show_what_is_not_there():
    text = markdown_table(["name", "value"], [["a", 1.23456], ["longer", float("nan")], ["b", float("inf")]])
    lines = text.splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[1].endswith(":|") or lines[1].endswith(": |")
    assert "1.235" in lines[2] and "- |" in lines[3] and "inf |" in lines[4]
