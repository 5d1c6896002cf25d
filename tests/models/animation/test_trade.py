import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from pgm_data.stages.jobs import Job
from pgm_data.stages.worker import stage_function
from pgm_models import model_trade
from pgm_models.animation import trade, trade_runs, training_plots
from pgm_models.animation.evaluation_result import LEAST_SHARE, EvaluationResult, PhysicsScore, Score, result_to_json
from pgm_models.animation.layout import Layout
from pgm_models.animation.masks import MASKS
from pgm_models.animation.physics_score import PhysicsFigure
from pgm_models.animation.presets import DESIGNS
from pgm_models.animation.run import AnimationRunOptions
from pgm_models.animation.sample_pictures import sample_sheet, write_samples
from pgm_models.animation.trade import AnimationTradeOptions, evaluations, run_animation_trade
from pgm_models.animation.trade_plots import Curve, SpeedPanel, speed_svg
from pgm_models.animation.trade_runs import (
    Evaluation,
    RunManner,
    Training,
    evaluate_model,
    evaluation_job,
    train_model,
    training_job,
)
from pgm_models.animation.trade_tables import physics_table, quality, ratio_lines, task_ratio_lines
from pgm_models.animation.training_plots import read_log, smoothed, write_loss_curves
from pgm_models.metrics import FrechetScore
from pgm_models.model_trade import made_by
from tests.models.jobs_at_once import jobs_at_once

TASKS = ("prediction", "completion")


def frechet(distance, floor=0.0):
    blank = dict.fromkeys(FrechetScore.__dataclass_fields__, 0)
    return FrechetScore(**blank | {"distance": distance, "excess": distance - floor})


def result(distance=2.0, l2=1.0, *, tasks=TASKS, windows=64, fps=50.0):
    """A result with the same figures everywhere; the floor is 1."""
    scores = tuple(
        Score(
            task=task,
            property=name,
            object="player0",
            unit="m",
            count=100,
            l2=l2,
            several_count=0,
            l2_best=math.nan,
            l2_mean=math.nan,
            energy=math.nan,
            frechet=frechet(distance, 1.0),
            floor=frechet(1.0, 1.0),
            discrepancy=None,
            discrepancy_floor=None,
        )
        for task in tasks
        for name in ("position", "root_angle", "joints")
    )
    figure = PhysicsFigure(name="foot_slide", object="player0", unit="m/s", value=0.5, count=10)
    return EvaluationResult(
        scene="tennis",
        frames=16,
        rate=4.0,
        windows=windows,
        reference_windows=windows,
        several_windows=0,
        samples=8,
        dimensions=48,
        seed=0,
        about={},
        scores=scores,
        physics=(PhysicsScore(task=tasks[0], rate=4.0, made=figure, real=figure),),
        keyframe_error=0.0,
        frames_per_second=fps,
    )


DISTANCES = {"velocity": 3.0, "ours": 2.0, "paper": 4.0, "transformer": 8.0, "lstm": 11.0, "playable": 21.0}


def fake_training(arguments, report):
    """In the place of a training: what was asked for is noted in the run's folder."""
    run = Path(arguments["run"])
    run.mkdir(parents=True, exist_ok=True)
    with (run / "trained.txt").open("a") as file:
        file.write("once\n")
    row = {"kind": "training", "name": arguments["name"], "steps": 7, "seconds": 1.0, "weights": 5, "device": "cpu"}
    return {"rows": [{**row, **made_by(arguments["conditions"])}]}


def fake_evaluation(arguments, report):
    """In the place of an evaluation: the distances of `DISTANCES` by design."""
    design = Path(arguments["run"]).name.split("_")[0]
    if not (Path(arguments["run"]) / "trained.txt").exists():
        raise FileNotFoundError(arguments["run"])
    found = result(DISTANCES[design], windows=arguments["windows"], fps=100 / arguments["steps"])
    names = ("name", "sampler", "steps", "windows")
    row = {"kind": "evaluation", **{name: arguments[name] for name in names}, "result": result_to_json(found)}
    return {"rows": [{**row, **made_by(arguments["conditions"])}]}


@pytest.fixture
def options(tmp_path):
    dataset = tmp_path / "dataset"
    (dataset / "meta").mkdir(parents=True)
    (dataset / "meta" / "info.json").write_text(json.dumps({"pgm": {"scene": "tennis"}}))
    manner = RunManner(dataset=dataset, test=dataset, out=tmp_path / "out", preset="nano", steps=7)

    def make(**values):
        given = {"seeds": 2, "windows": 64, "few_windows": 32, "workers": 8}
        return AnimationTradeOptions(manner=manner, state_dir=manner.out / ".state", **given | values)

    return make


def faked(job, arguments):
    return (fake_training if job.stage == "animation_training" else fake_evaluation)(arguments, None)


@pytest.fixture
def run(monkeypatch):
    from pgm_data.stages import trade_run

    monkeypatch.setattr(trade_run, "run_jobs", jobs_at_once(faked))
    for module in (trade, model_trade):
        monkeypatch.setattr(module, "commit", lambda: "0123")

    def go(options):
        return run_animation_trade(options, on_event=lambda event: None, on_jobs=lambda count: None)

    return go


def test_ratios_are_those_of_distances_beyond_chance(options, run):
    told = run(options(parts=("designs",)))
    out = options().manner.out
    found = json.loads((out / "trade.json").read_text())["ratios"]

    def value(name):
        return found[name]["frechet_beyond_chance"]["value"]

    # Distances less the floor of 1: 1 of ours, 3, 7, 10, 20.
    assert value("64 windows: reconstruction transformer over ours, sde_2m, 16 steps") == pytest.approx(7)
    assert value("64 windows: reconstruction LSTM over ours, sde_2m, 16 steps") == pytest.approx(10)
    assert value("64 windows: LSTM an object, adversarial over ours, sde_2m, 16 steps") == pytest.approx(20)
    paper = "the paper's design"
    for ways in (
        "32 windows: {}, ddpm, 250 steps",
        "64 windows: {}, sde_2m, 16 steps",
        "32 windows: {}, ddpm, 1000 steps",
    ):
        assert value(ways.format(paper) + " over ours, sde_2m, 16 steps") == pytest.approx(3)
    assert found["64 windows: reconstruction LSTM over ours, sde_2m, 16 steps"]["l2"]["value"] == pytest.approx(1)
    assert told.failed == () and "Frechet beyond chance 7 times (wanted: 3 or more)" in told.table
    assert told.table == (out / "trade.md").read_text().rstrip("\n")


def test_all_parts_leave_their_tables_and_files(options, run):
    table = run(options(most_steps=8)).table
    for words in (
        "Designs at one budget, 64 windows",
        "Groups of masking strategies",
        "Shares of the data",
        "Steps of each sampler, 32 windows",
        "random+opponent",
        "| 20 % |",
        "| real ",
        "| foot_slide | player0 |",
        "2 seeds of ours, paper, transformer",
    ):
        assert words in table
    out = options().manner.out
    assert ElementTree.parse(out / "trade.svg").getroot().tag.endswith("svg")
    rows = list(csv.DictReader((out / "trade.csv").read_text().splitlines()))
    assert {row["task"] for row in rows} == set(TASKS)
    assert all(float(row["frechet_excess"]) == pytest.approx(float(row["frechet_distance"]) - 1) for row in rows)
    made = json.loads((out / "trade.json").read_text())["made"]
    assert (
        made["preset"] == "nano" and made["steps"] == 7 and made["machine"]["cores"] >= 1 and made["versions"]["torch"]
    )


def test_models_are_trained_once_for_all_parts_and_once_for_all_runs(options, run):
    run(options(parts=("designs", "masks"), most_steps=1))
    run(options(resume=True, most_steps=1))
    runs = sorted((options().manner.out / "runs").iterdir())
    wanted = {"ours_seed0", "ours_seed1", "paper_seed0", "paper_seed1", "transformer_seed0", "transformer_seed1"}
    wanted |= {"lstm_seed0", "playable_seed0", "velocity_seed0"}
    wanted |= {f"ours_{group}_seed0" for group in MASKS if group != "all"}
    wanted |= {f"ours_{share}percent_seed0" for share in (20, 50)}
    assert {path.name for path in runs} == wanted
    assert all((path / "trained.txt").read_text() == "once\n" for path in runs)


def test_without_resume_all_is_done_again(options, run):
    for _ in range(2):
        run(options(parts=("masks",)))
    assert (options().manner.out / "runs" / "ours_seed0" / "trained.txt").read_text() == "once\nonce\n"


@pytest.fixture
def elsewhere(options, run, tmp_path):
    """The rows of a trade of one seed into another folder."""
    first = options(parts=("designs",), seeds=1)
    run(replace(first, manner=replace(first.manner, out=tmp_path / "elsewhere"), state_dir=tmp_path / "state"))
    return tmp_path / "elsewhere" / "rows.jsonl"


def test_what_other_trades_have_is_not_done_again(options, run, elsewhere):
    told = run(options(parts=("designs",), known=(elsewhere,)))
    out = options().manner.out
    assert {path.name for path in (out / "runs").iterdir()} == {"ours_seed1", "paper_seed1", "transformer_seed1"}
    whole = run(options(parts=("designs",)))
    assert told.table.split("## Made with")[0] == whole.table.split("## Made with")[0]
    assert "rows made on " in told.table and "commit 0123" in told.table


def test_a_trade_of_which_all_is_known_has_its_figures_at_once(options, run, elsewhere):
    out = options().manner.out
    out.mkdir()
    told = run(options(parts=("designs",), seeds=1, known=(elsewhere,)))
    assert not (out / "runs").exists() and told.scored == 9
    assert sorted((out / "rows.jsonl").read_text().splitlines()) == sorted(elsewhere.read_text().splitlines())


def test_rows_of_other_conditions_are_refused(options, run, elsewhere):
    longer = options(parts=("designs",), known=(elsewhere,))
    with pytest.raises(ValueError, match=r"rows.jsonl, line 1: training_steps: expected 9, got 7"):
        run(replace(longer, manner=replace(longer.manner, steps=9)))
    (longer.manner.dataset / "meta" / "info.json").write_text('{"pgm": {"scene": "tennis"}, "more": 1}')
    with pytest.raises(ValueError, match=r"line 1: dataset: expected \w{12}, got \w{12}"):
        run(longer)


@pytest.mark.parametrize("line", ["", "{", "[]", '{"kind": "evaluation"}', '{"kind": 1, "name": "a", "conditions": 3}'])
def test_what_is_no_row_is_refused(options, run, tmp_path, line):
    (tmp_path / "rows.jsonl").write_text(line + "\n")
    with pytest.raises(ValueError, match=r"rows.jsonl, line 1: expected a row of a trade"):
        run(options(known=(tmp_path / "rows.jsonl",)))


def test_a_part_broken_off_leaves_the_figures_it_has(options, run, monkeypatch):
    calls, whole = [], fake_evaluation

    def break_off(arguments, report):
        calls.append(arguments["name"])
        if len(calls) == 4:
            raise KeyboardInterrupt
        return whole(arguments, report)

    monkeypatch.setitem(globals(), "fake_evaluation", break_off)
    with pytest.raises(KeyboardInterrupt):
        run(options(parts=("masks",)))
    out = options().manner.out
    kinds = [json.loads(line)["kind"] for line in (out / "rows.jsonl").read_text().splitlines()]
    assert kinds.count("training") == len(MASKS) and kinds.count("evaluation") == 3


def test_the_jobs_name_what_carries_them_out(options):
    manner = options().manner
    jobs = [training_job(Training(), manner), evaluation_job(Evaluation(model=Training()), manner)]
    assert [stage_function(job.stage, job.entry) for job in jobs] == [train_model, evaluate_model]
    low = {
        name: jobs[0].arguments[name] for name in AnimationRunOptions.__dataclass_fields__ if name in jobs[0].arguments
    }
    assert set(jobs[0].arguments) - set(low) == {"name", "conditions"}


def test_all_matches_of_another_dataset_are_evaluated_on(options, monkeypatch, tmp_path):
    asked = []

    def evaluate(options, parts, show):
        asked.append(options)
        return result()

    monkeypatch.setattr(trade_runs, "evaluate_run", evaluate)
    same = options().manner
    for manner in (same, replace(same, test=tmp_path / "others")):
        evaluate_model(evaluation_job(Evaluation(model=Training()), manner).arguments, lambda report: None)
    assert [one.split for one in asked] == ["", "all"]
    assert asked[1].dataset == tmp_path / "others" and asked[1].reference == same.dataset


def test_each_evaluation_keeps_its_tasks_apart(options):
    wanted = [one for part in evaluations(options()).values() for one in part]
    jobs = {one.name: evaluation_job(one, options().manner) for one in wanted}
    folders = {job.arguments["parts"] for job in jobs.values()}
    assert len(folders) == len(jobs) and all(isinstance(job, Job) for job in jobs.values())


def test_a_given_run_is_compared_without_training(options):
    manner = RunManner(dataset=Path("d"), test=Path("t"), out=Path("o"), given=Path("shipped"))
    chosen = AnimationTradeOptions(manner=manner, state_dir=Path("s"), parts=("steps",), most_steps=8)
    wanted = evaluations(chosen)["steps"]
    assert {one.model for one in wanted} == {None} and max(one.steps for one in wanted) == 8
    assert {one.sampler for one in wanted} == {"sde_2m", "dpmpp_2m", "ddim", "ddpm"}
    assert evaluation_job(wanted[0], manner).arguments["run"] == "shipped"
    with pytest.raises(ValueError, match="given: expected a run"):
        options().manner.folder(None)


def test_quality_is_a_geometric_mean_and_never_below_what_counts():
    assert quality([result(5.0)]) == pytest.approx(4.0)
    assert quality([result(3.0), result(7.0)]) == pytest.approx(4.0)
    assert quality([result(0.5)]) == pytest.approx(LEAST_SHARE)


def test_ratios_are_told_seed_by_seed_and_task_by_task():
    these, those = [result(5.0), result(9.0)], [result(2.0), result(3.0)]
    said = ratio_lines("a over b", these, those)[0]
    assert "4 times" in said and "seed by seed 4, 4" in said
    assert task_ratio_lines("a over b", these, those) == ["a over b, task by task: prediction 4, completion 4"]
    assert ratio_lines("a over b", [], those) == [] == task_ratio_lines("a over b", these, [])


def test_physics_is_told_by_framerate():
    slow, fast = result(), result()
    score = fast.physics[0]
    fast = replace(fast, physics=(replace(score, rate=25.0, made=replace(score.made, value=2.0)),))
    table = physics_table({"a": [slow, fast]})
    assert "| foot_slide | player0 | m/s | 4 | 0.5 (0.5, 1 times) |" in table
    assert "| foot_slide | player0 | m/s | 25 | 2 (0.5, 4 times) |" in table
    assert physics_table({"a": [replace(slow, physics=())]}) == ""


def test_dots_stand_where_speed_and_error_say():
    curve = Curve(name="s", labels=("1", "2", "3"), speeds=(10.0, 100.0, 1000.0), errors=(4.0, 2.0, 1.0))
    root = ElementTree.fromstring(speed_svg([SpeedPanel(title="t", error_unit="u", curves=(curve,))]))
    dots = [(float(at.get("cx")), float(at.get("cy"))) for at in root.iter() if at.tag.endswith("circle")]
    across, up = np.array(dots).T
    np.testing.assert_allclose(np.diff(across)[0], np.diff(across)[1], atol=0.2)
    np.testing.assert_allclose(np.diff(up)[0], np.diff(up)[1], atol=0.2)
    assert (np.diff(across) > 0).all() and (np.diff(up) > 0).all()  # pixels count downwards


def test_dots_without_a_place_are_left_out():
    curve = Curve(name="s", labels=("1", "2", "3"), speeds=(10.0, math.nan, 20.0), errors=(1.0, 1.0, 0.0))
    assert speed_svg([SpeedPanel(title="t", error_unit="u", curves=(curve,))]).count("<circle") == 1
    assert "no values" in speed_svg([SpeedPanel(title="t", error_unit="u", curves=())])


def log_lines(steps=40):
    lines = [
        {"step": s, "elapsed_s": s / 2, "rate": 1e-3, "loss": 2 / s, "ball.position": 1 / s} for s in range(1, steps)
    ]
    return [*lines, {"step": steps, "elapsed_s": 20.0, "held_out": {"loss": 0.5, "ball.position": 0.4}}]


def test_losses_are_written_as_table_and_picture(tmp_path):
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in log_lines()))
    write_loss_curves(tmp_path)
    rows = list(csv.DictReader((tmp_path / "loss.csv").read_text().splitlines()))
    assert len(rows) == 40 and rows[0]["data"] == "training" and rows[-1]["data"] == "held out"
    assert float(rows[9]["loss"]) == pytest.approx(0.2) and rows[-1]["rate"] == ""
    picture = cv2.imread(str(tmp_path / "loss.png"))
    assert picture is not None and (picture < 200).any(axis=-1).mean() > 0.002


def test_without_matplotlib_the_table_alone_is_written(tmp_path, monkeypatch):
    (tmp_path / "log.jsonl").write_text(json.dumps(log_lines()[0]) + "\n")
    monkeypatch.setattr(training_plots, "find_spec", lambda name: None)
    write_loss_curves(tmp_path)
    assert (tmp_path / "loss.csv").exists() and not (tmp_path / "loss.png").exists()


def test_a_run_that_just_began_has_no_losses(tmp_path):
    write_loss_curves(tmp_path)
    assert (tmp_path / "loss.csv").read_text().startswith("step,data")
    (tmp_path / "log.jsonl").write_text("torn")
    with pytest.raises(ValueError, match="line 1: expected a line of a training's log"):
        read_log(tmp_path / "log.jsonl")


def test_smoothing_keeps_a_straight_line_straight():
    steps = np.arange(100.0)
    values = 3 * steps + 1
    values[7] = np.nan
    found_steps, found = smoothed(steps, values)
    np.testing.assert_allclose(found, 3 * found_steps + 1)
    assert len(found) == 99 - 4


def sequences(players, joints, *, ball, count=2, frames=5):
    rng = np.random.default_rng(0)
    columns = {}
    for player in players:
        columns[f"{player}.root_position"] = rng.normal(0, 2, (count, frames, 3)).cumsum(axis=1) * 0.2
        columns[f"{player}.joints"] = rng.uniform(0, 1.7, (count, frames, 3 * joints))
    if ball:
        columns["ball.position"] = rng.uniform(0, 3, (count, frames, 3))
    return columns, np.broadcast_to(np.arange(frames) / 4, (count, frames))


@pytest.mark.parametrize(
    ("scene", "players", "joints", "ball"),
    [("tennis", ("player0", "player1"), 24, True), ("blocks", ("player0",), 13, False)],
)
def test_samples_are_drawn_with_and_without_court_and_ball(tmp_path, scene, players, joints, ball):
    columns, times = sequences(players, joints, ball=ball)
    layout = Layout(scene=scene, players=players, properties=(), constants=())
    path = write_samples(tmp_path, columns, times, layout, 123)
    assert path == tmp_path / "samples" / "step_000123.png"
    picture = cv2.imread(str(path))
    half = len(picture) // 2
    for own in (picture[:half], picture[half:]):
        assert (own.min(axis=-1) < 150).mean() > 0.005
    orange = (np.abs(picture.astype(int) - (0, 140, 255)) < 30).all(axis=-1).sum()
    assert (orange > 20) == ball


def test_what_is_not_known_is_not_drawn():
    columns, times = sequences(("player0", "player1"), 24, ball=True, frames=1)
    layout = Layout(scene="tennis", players=("player0", "player1"), properties=(), constants=())
    bare = sample_sheet({name: np.full_like(value, np.nan) for name, value in columns.items()}, times, layout)
    drawn = sample_sheet(columns, times, layout)
    assert bare.shape == drawn.shape and (bare.min(axis=-1) < 230).sum() < (drawn.min(axis=-1) < 230).sum()
    with pytest.raises(ValueError, match="expected positions of sequences"):
        sample_sheet({}, times, layout)


def test_a_point_further_right_and_away_is_further_right_and_up_on_the_sheet():
    layout = Layout(scene="tennis", players=("player0",), properties=(), constants=())
    found = []
    for place in (0.0, 5.0):
        position = np.full((1, 2, 3), place)
        sheet = sample_sheet({"player0.root_position": position}, np.array([[0.0, 0.25]]), layout)
        blue = (np.abs(sheet[:, :300].astype(int) - (178, 114, 0)) < 10).all(axis=-1)
        found.append(np.argwhere(blue).mean(axis=0))
    assert found[1][1] > found[0][1] + 20 and found[1][0] < found[0][0] - 20


def test_every_design_that_is_compared_has_a_title():
    assert set(AnimationTradeOptions.__dataclass_fields__["designs"].default) == set(trade.TITLES) <= set(DESIGNS)
