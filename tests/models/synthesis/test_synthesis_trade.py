"""The trade of the synthesis model: what it compares, what it writes, and that it goes on where it stopped."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from pgm_cli.trade import main

from pgm_data.stages.worker import stage_function
from pgm_models.synthesis import run as training_run
from pgm_models.synthesis import trade
from pgm_models.synthesis.presets import PRESETS, SYNTHESIS_DESIGNS, PresetChanges, changed_preset
from pgm_models.synthesis.trade import HEADINGS, TITLES, SynthesisTradeOptions, run_synthesis_trade, sweep, trainings
from pgm_models.synthesis.trade_runs import (
    RunManner,
    Training,
    evaluate_model,
    evaluation_job,
    train_model,
    training_job,
)
from pgm_models.synthesis.trade_tables import Row, figures_csv, part_curves, part_table, rms, speed_panels
from tests.models.jobs_at_once import jobs_at_once
from tests.models.synthesis.drawn_matches import drawn_matches, packed

CHANGES = ("samples", "voxels", "enhancer", "stylising", "resolution")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """One drawn match of tennis, packed."""
    return packed(drawn_matches(tmp_path_factory.mktemp("drawn"), matches=1, frames=8))


@pytest.fixture
def options(dataset, tmp_path):
    manner = RunManner(
        dataset=dataset,
        test=None,
        truth=None,
        out=tmp_path / "out",
        preset="nano",
        steps=1,
        held_out=0.3,
        device="cpu",
        frames=1,
    )

    def make(**values) -> SynthesisTradeOptions:
        return SynthesisTradeOptions(manner=manner, state_dir=manner.out / ".state", **values)

    return make


def summary(psnr: float, fps: float) -> dict:
    """What an evaluation finds: PSNR of the frame, 6 dB less of the players, and no label of the court."""
    places = {"frame": psnr, "player0-alpha": psnr - 6, "player1-alpha": psnr - 6, "court-alpha": None}
    blank = {"frames": 3, "lowest_psnr": 1.0, "ssim": 0.5, "ms_ssim": None, "lpips": None}
    return {
        "size": [128, 72],
        "frames": 3,
        "frames_per_second": fps,
        "likeness": [
            {"where": where, "stage": stage, "psnr": value and value - less, **blank}
            for where, value in places.items()
            for stage, less in (("final", 0), ("raw", 1))
        ],
        "objects": [{"object": "ball", "pictures": "made", "near_share": 0.5, "mdr": 0.25}],
    }


def training(name: str) -> dict:
    return {"kind": "training", "name": name, "steps": 3, "seconds": 60.0, "weights": 2_000_000, "device": "cpu"}


@pytest.fixture
def jobs_done(monkeypatch):
    """Jobs in this process, through the supervisor's log; the list of those that were carried out."""
    from pgm_data.stages import trade_run

    done = []

    def work(job, arguments):
        return stage_function(job.stage, job.entry)(arguments, lambda progress: None)

    monkeypatch.setattr(trade_run, "run_jobs", jobs_at_once(work, done.append))
    monkeypatch.setattr(trade, "commit", lambda: "0123")
    monkeypatch.setattr(training_run, "HELD_OUT_BATCHES", 1)
    return done


def run(options: SynthesisTradeOptions):
    return run_synthesis_trade(options, on_event=lambda event: None, on_jobs=lambda count: None)


def test_models_are_trained_judged_and_told_and_a_resumed_trade_goes_on(options, jobs_done):
    first = options(parts=("designs",), designs=("no_enhancer",))
    assert run(first).scored == 1
    assert jobs_done == ["train no_enhancer_seed0", "evaluate no_enhancer_seed0"]
    both = options(parts=("designs",), designs=("no_enhancer", "playable"), resume=True)
    told = run(both)
    assert jobs_done[2:] == ["train playable_seed0", "evaluate playable_seed0"]
    assert told.scored == 2 and not told.failed
    out = first.manner.out
    assert "Designs at one budget" in told.table and "PSNR frame, dB" in told.table and "judged: 1 frames" in told.table
    assert told.table == (out / "trade.md").read_text().rstrip("\n")
    assert ElementTree.parse(out / "trade.svg").getroot().tag.endswith("svg")
    rows = list(csv.DictReader((out / "trade.csv").read_text().splitlines()))
    frames = {row["model"]: row for row in rows if (row["where"], row["stage"]) == ("frame", "final")}
    assert set(frames) == {TITLES["no_enhancer"], TITLES["playable"]}
    assert all(5 < float(row["psnr"]) < 50 and float(row["frames_per_second"]) > 0 for row in frames.values())
    made = json.loads((out / "trade.json").read_text())["made"]
    assert made["preset"] == "nano" and made["commit"] == "0123" and made["machine"]["cores"] >= 1
    kinds = [json.loads(line)["kind"] for line in (out / "rows.jsonl").read_text().splitlines()]
    assert sorted(kinds) == ["evaluation", "evaluation", "training", "training"]


def test_each_part_changes_one_thing_and_shares_what_is_the_presets_own(options):
    wanted = trainings(options())
    assert list(wanted) == list(HEADINGS)
    assert set(wanted["designs"]) == set(TITLES.values()) and set(TITLES) == set(SYNTHESIS_DESIGNS)
    for part in CHANGES:
        models = wanted[part]
        assert sum(model == Training() for model in models.values()) == 1, part  # ours as it is
        assert len({model.name for model in models.values()}) == len(models) > 1
        for name, changes in sweep(part, PRESETS["nano"]).items():
            changed = changed_preset(PRESETS["nano"], changes)
            assert changed_preset(PRESETS["nano"], models[name].changes) == changed
    nano = PRESETS["nano"].fields
    assert list(wanted["samples"]) == [str(round(nano.samples * share)) for share in (0.125, 0.25, 0.5, 1)]
    assert wanted["enhancer"]["none"].changes.enhancer == ()
    with pytest.raises(ValueError, match="got designs"):
        sweep("designs", PRESETS["nano"])


def test_jobs_name_what_carries_them_out_and_carry_all_changes(options):
    changes = PresetChanges(samples=3, enhancer=(4, 8), stylising="sample", height=36)
    model = Training(design="playable", changes=changes, seed=2)
    manner = options().manner
    jobs = [training_job(model, manner), evaluation_job(model, manner)]
    assert [stage_function(job.stage, job.entry) for job in jobs] == [train_model, evaluate_model]
    assert model.name == "playable_samples3_height36_enhancer4-8_sample_seed2"
    assert json.loads(json.dumps(jobs[0].arguments))["changes"] == {
        "samples": 3, "enhancer": [4, 8], "stylising": "sample", "height": 36,
    }  # fmt: skip
    assert jobs[1].arguments["split"] == "held-out"
    other = replace(manner, test=Path("other"))
    assert evaluation_job(model, other).arguments["split"] == "all"
    assert evaluation_job(model, other).arguments["dataset"] == "other"
    assert Training(changes=PresetChanges(enhancer=())).name == "ours_enhancernone_seed0"


def test_seeds_of_a_model_are_one_row_with_their_means():
    row = Row(name="a", results=[summary(20.0, 4.0), summary(24.0, 6.0)], trainings=[training("a"), training("a")])
    assert row.likeness("psnr", "frame") == 22 and row.likeness("psnr", "frame", "raw") == 21
    assert row.players() == 16 and row.frames_per_second() == 5
    assert math.isnan(row.likeness("psnr", "court-alpha")) and math.isnan(row.found("mdr", "player"))
    head, _, line = ([cell.strip() for cell in each.split("|")[1:-1]] for each in part_table([row]).splitlines())
    told = dict(zip(head, line, strict=True))
    assert told["PSNR frame, dB"] == "22.00" and told["PSNR court-alpha, dB"] == "n/a"
    assert told["ball near, %"] == "50.0" and told["players missed, %"] == "n/a"
    assert told["frames a second"] == "5.00" and told["million weights"] == "2.00" and told["minutes"] == "1.0"
    lines = list(csv.DictReader(figures_csv({"designs": [row]}).splitlines()))
    assert len(lines) == 8 and lines[0]["psnr"] == "22" and lines[-1]["psnr"] == ""


def test_plots_have_the_error_of_the_colours_against_speed():
    assert rms(20 * math.log10(255)) == pytest.approx(1.0)
    rows = [Row(name=str(n), results=[summary(20.0 + n, 10.0**n)], trainings=[training("a")]) for n in (0, 1)]
    frame, players = (panel.curves[0] for panel in speed_panels([part_curves("samples", rows)]))
    assert frame.speeds == (1.0, 10.0) and frame.labels == ("0", "1")
    assert frame.errors == pytest.approx((25.5, 25.5 * 10 ** (-1 / 20)))
    assert players.errors == pytest.approx(tuple(each * 10 ** (6 / 20) for each in frame.errors))


def test_what_cannot_be_compared_is_refused(dataset, tmp_path):
    for words, message in (
        (["--parts", "designs", "designs"], "--parts"),
        (["--designs", "cubes"], "some of ours, no_enhancer"),
        (["--held-out", "0"], "--held-out"),
        (["--seeds", "0"], "--seeds"),
        (["--truth", str(tmp_path / "none")], "--truth"),
    ):
        with pytest.raises(Exception, match=message):
            main(["synthesis", str(dataset), "--out", str(tmp_path / "o"), *words])
    with pytest.raises(Exception, match="packed dataset"):
        main(["synthesis", str(tmp_path), "--out", str(tmp_path / "o")])
    assert not (tmp_path / "o").exists()
