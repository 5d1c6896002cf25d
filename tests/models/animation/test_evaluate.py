"""A world of smooth motion whose distribution is known, filled in by things whose scores are known."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from pgm_data.scene import load_scene
from pgm_models.animation.encode import decode
from pgm_models.animation.evaluate import EvaluateOptions, evaluate, evaluate_physics
from pgm_models.animation.evaluate_tables import (
    evaluation_text,
    main_table,
    read_evaluation,
    scores_csv,
    write_evaluation,
)
from pgm_models.animation.evaluation_result import (
    LEAST_SHARE,
    EvaluationResult,
    Score,
    distance_ratio,
    floor_subtracted_ratio,
    merged,
    result_from_json,
    result_to_json,
)
from pgm_models.animation.layout import Constant, Layout, Property
from pgm_models.animation.task_scores import errors, features, measured, quantities, several_errors
from pgm_models.animation.windows import Fill, Windows
from pgm_models.metrics import frechet_distance

TENNIS = load_scene("tennis")
UPRIGHT = Rotation.from_matrix([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]).as_rotvec()
OPTIONS = EvaluateOptions(several_windows=8, samples=2, bootstraps=20, batch=32)


def tennis_layout() -> Layout:
    """Two players with roots and shoulders that move, and the ball; bones that are always the same."""
    skeleton = TENNIS.players[0].skeleton
    assert skeleton is not None
    properties, constants = [], []

    def add(column: str, player: int, first: int, std: float, channels: int, width: int = 3) -> None:
        rotations = width // 3 if "rotation" in column else 0
        mean = np.array([0, (-10, 10, 0)[player], 1.0]) if column.endswith("position") else np.zeros(channels)
        properties.append(
            Property(
                column=column,
                player=player,
                kind="rotations" if rotations else "vector",
                first=first,
                width=width,
                reference=np.tile(UPRIGHT if width == 3 else np.zeros(3), (rotations, 1)),
                channels=np.arange(channels) + (45 if width > 3 else 0),
                rest=np.zeros(width),
                mean=mean,
                std=np.full(channels, std),
            )
        )

    for k in range(2):
        add(f"player{k}.root_position", k, 0, 2.0, 3)
        add(f"player{k}.root_rotation", k, 0, 0.5, 3)
        add(f"player{k}.joint_rotations", k, 3, 0.3, 6, 69)
        rest = skeleton.rest_translations[1:].ravel()
        constants.append(
            Constant(
                column=f"player{k}.joint_translations",
                player=k,
                first=3,
                width=69,
                channels=np.array([1]),
                rest=rest,
                mean=rest[[1]],
                std=np.array([0.01]),
            )
        )
    add("ball.position", -1, 0, 5.0, 3)
    add("ball.velocity", -1, 0, 10.0, 3)
    return Layout(
        scene="tennis", players=("player0", "player1"), properties=tuple(properties), constants=tuple(constants)
    )


LAYOUT = tennis_layout()
OWNERS = torch.as_tensor(LAYOUT.property_of_channel.copy())
STAY = 0.9
"""Share of a channel that stays from frame to frame; the rest is drawn."""


def real_windows(seed: int, count: int = 64, frames: int = 8, batch: int = 24) -> list[Windows]:
    """Windows of independent channels that move as an autoregression."""
    noise = torch.randn(count, frames, LAYOUT.channels, generator=torch.Generator().manual_seed(seed))
    state = noise.clone()
    for frame in range(1, frames):
        state[:, frame] = STAY * state[:, frame - 1] + (1 - STAY**2) ** 0.5 * noise[:, frame]
    whole = Windows(
        state=state,
        valid=torch.ones(count, frames, len(LAYOUT.properties), dtype=torch.bool),
        rate=torch.full((count,), 4.0),
        constants=torch.zeros(count, 2),
        text=torch.zeros(count, frames, 2, dtype=torch.int64),
        tokens=torch.zeros(1, 2, 4),
        token_mask=torch.ones(1, 2, dtype=torch.bool),
        names=tuple(f"window {k}" for k in range(count)),
    )
    return [part(whole, slice(start, start + batch)) for start in range(0, count, batch)]


def part(windows: Windows, rows: slice) -> Windows:
    own = {name: getattr(windows, name)[rows] for name in ("state", "valid", "rate", "constants", "text")}
    return replace(windows, names=windows.names[rows], **own)


def truth(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
    return windows.state.clone()


def noise(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
    drawn = torch.randn(windows.state.shape, generator=generator)
    return torch.where(known[..., OWNERS], windows.state, drawn)


def mean(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
    return torch.where(known[..., OWNERS], windows.state, 0.0)


def predicted(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
    """Drawn from the true distribution given the first frame."""
    state = windows.state.clone()
    for frame in range(1, state.shape[1]):
        drawn = torch.randn(state[:, 0].shape, generator=generator)
        state[:, frame] = STAY * state[:, frame - 1] + (1 - STAY**2) ** 0.5 * drawn
    return state


def evaluated(
    fill: Fill,
    real: Windows | Sequence[Windows],
    other: Windows | Sequence[Windows],
    options: EvaluateOptions,
    about: Mapping[str, str | int | float] | None = None,
) -> EvaluationResult:
    return evaluate(fill, real, other, LAYOUT, options, scene=TENNIS, about=about)


@pytest.fixture(scope="module")
def results() -> dict[str, EvaluationResult]:
    """Scores of the truth, of noise, and of the mean."""
    real, other = real_windows(0), real_windows(1)
    fills = {"truth": truth, "noise": noise, "mean": mean}
    return {
        name: evaluated(fill, real, other, OPTIONS, about={"fill": name, "steps": 1}) for name, fill in fills.items()
    }


def test_every_task_is_scored_by_every_property_of_its_objects(results):
    found = {(s.task, s.property, s.object) for s in results["noise"].scores}
    things = {"position": ("player0", "player1", "ball"), "root_angle": ("player0", "player1")}
    things["joints"] = things["root_angle"]
    wanted = {
        (task, name, thing)
        for task in ("prediction", "unconditioned", "completion")
        for name, those in things.items()
        for thing in those
    }
    assert found == wanted | {("opponent", name, "player1") for name in things}
    assert {s.unit for s in results["noise"].scores if s.property == "root_angle"} == {"rad"}


def test_the_truth_makes_no_error_and_lies_at_no_distance(results):
    for score in results["truth"].scores:
        assert (score.l2, score.l2_best, score.energy) == pytest.approx((0, 0, 0), abs=1e-6)
        assert score.l2_mean == pytest.approx(0, abs=1e-5)
        assert score.frechet is not None and score.frechet.distance == pytest.approx(0, abs=1e-6)
        assert score.frechet.excess == pytest.approx(0, abs=1e-6)
        assert score.floor is not None and score.floor.distance > 0.01
        assert score.discrepancy is not None and score.discrepancy.value <= 0
    for score in results["truth"].physics:
        assert score.made == score.real or np.isnan(score.made.value)


def test_errors_of_the_mean_are_the_spread_of_the_data(results):
    """The channels' standard deviations are 2 m of players and 5 m of the ball."""
    length = 2 * np.sqrt(2 / np.pi)  # of a vector of three numbers of standard deviation 1
    for thing, std in (("player0", 2.0), ("ball", 5.0)):
        (score,) = _scores(results["mean"], "unconditioned", "position", thing)
        assert score.l2 == pytest.approx(std * length, rel=0.2)
        assert score.count == 64 * 7


def test_a_deterministic_filler_gains_nothing_by_several_samples(results):
    for score in results["mean"].scores:
        assert score.l2_best == pytest.approx(score.l2_mean, rel=1e-5)
        if score.property != "root_angle":
            assert score.energy == pytest.approx(score.l2_best, rel=1e-6)


@pytest.mark.parametrize("name", ["position ball", "root_angle player1", "joints player0"])
def test_errors_of_several_samples_are_those_of_the_slow_loops(name):
    (quantity,) = [q for q in quantities(LAYOUT) if q.name == name]
    states = [real_windows(seed, 5, 4)[0].state.numpy() for seed in range(4)]
    values = [measured(quantity, decode(LAYOUT, state, np.zeros((5, 2)))) for state in states]
    truth, samples = values[0], values[1:]
    judged = np.ones((5, 4), dtype=bool)
    judged[:, 0], judged[2] = False, False
    found = several_errors(quantity, np.stack(samples), truth, judged)

    def apart(one: np.ndarray, other: np.ndarray, chord: bool = False) -> float:
        if quantity.kind == "root_angle":
            angle = (Rotation.from_rotvec(one[0]).inv() * Rotation.from_rotvec(other[0])).magnitude()
            return 2 * np.sin(angle / 2) if chord else angle
        return float(np.mean([np.linalg.norm(x - y) for x, y in zip(one, other, strict=True)]))

    best, mean, energy = [], [], []
    for window in (0, 1, 3, 4):
        best.append(min(np.mean([apart(s[window, t], truth[window, t]) for t in (1, 2, 3)]) for s in samples))
        for t in (1, 2, 3):
            here, true = [s[window, t] for s in samples], truth[window, t]
            middle = np.mean(here, axis=0)
            if quantity.kind == "root_angle":
                middle = Rotation.from_rotvec(np.concatenate(here)).mean().as_rotvec()[None]
            mean.append(apart(middle, true))
            pairs = [apart(here[i], here[j], True) for i in range(3) for j in range(i)]
            energy.append(np.mean([apart(x, true, True) for x in here]) - np.mean(pairs) / 2)
    told = (found.best, found.mean, found.energy)
    assert told == pytest.approx((np.mean(best), np.mean(mean), np.mean(energy)), rel=1e-9)
    alone = several_errors(quantity, samples[0][None], truth, judged)
    assert alone.best == pytest.approx(alone.mean) and np.isnan(alone.energy)
    assert np.isnan(several_errors(quantity, np.stack(samples), truth, np.zeros((5, 4), dtype=bool)).best)


def test_noise_is_told_from_the_truth_by_every_distance(results):
    for score in results["noise"].scores:
        assert score.frechet is not None and score.floor is not None and score.discrepancy is not None
        assert score.frechet.excess > 0.3 * score.floor.distance
        assert score.frechet.rows == score.floor.rows == 64
        assert score.frechet.dimensions == (48 if score.property == "joints" else 24)


def test_samples_of_the_true_distribution_have_no_excess_where_noise_has():
    real, other = real_windows(2, 256), real_windows(3, 256)
    options = replace(OPTIONS, tasks=("prediction",), several_windows=0, bootstraps=0)
    right = evaluated(predicted, real, other, options)
    for name in ("position", "root_angle", "joints"):
        floor, excess = (right.mean("prediction", name, measure) for measure in ("floor", "excess"))
        assert abs(excess) < 0.4 * floor
        assert right.mean("prediction", name, "frechet") < floor
    assert right.several_windows == 0 and np.isnan(right.scores[0].energy)
    wrong = evaluated(noise, real, other, options)
    ratio = floor_subtracted_ratio([wrong], [right])
    assert ratio.value > 5 and len(ratio.each) == 3


def test_batches_do_not_matter_to_what_draws_nothing(results):
    options = replace(OPTIONS, batch=5, tasks=("completion",))
    one = evaluated(mean, _joined(real_windows(0)), real_windows(1), options)
    found = {(s.property, s.object): s for s in results["mean"].scores if s.task == "completion"}
    for score in one.scores:
        other = found[score.property, score.object]
        assert (score.l2, score.l2_best) == pytest.approx((other.l2, other.l2_best), rel=1e-9)


def _joined(batches: Sequence[Windows]) -> Windows:
    own = {
        name: torch.cat([getattr(batch, name) for batch in batches])
        for name in ("state", "valid", "rate", "constants", "text")
    }
    return replace(batches[0], names=sum((batch.names for batch in batches), ()), **own)


def test_changed_given_values_are_told_and_put_right():
    def careless(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
        return windows.state + 0.25

    options = replace(OPTIONS, tasks=("prediction",), several_windows=0, bootstraps=0)
    result = evaluated(careless, real_windows(0, 16), real_windows(1, 16), options)
    assert result.keyframe_error == pytest.approx(0.25, rel=1e-5)
    (score,) = _scores(result, "prediction", "position", "player0")
    assert score.l2 == pytest.approx(0.25 * 2.0 * np.sqrt(3), rel=1e-5)


def test_what_the_data_do_not_say_is_not_scored():
    real = real_windows(0, 24)
    for batch in real:
        batch.valid[:10, 3, LAYOUT.row_of("ball.position")] = False
    options = replace(OPTIONS, tasks=("prediction",), several_windows=0, bootstraps=0)
    result = evaluated(noise, real, real_windows(1, 24), options)
    (ball,) = _scores(result, "prediction", "position", "ball")
    assert ball.count == 24 * 7 - 10 and ball.frechet is not None and ball.frechet.rows == 14
    for batch in real:
        batch.valid[..., LAYOUT.row_of("ball.position")] = False
    (never,) = _scores(evaluated(noise, real, real_windows(1, 24), options), "prediction", "position", "ball")
    assert never.count == 0 and np.isnan(never.l2) and never.frechet is None and never.floor is None


@pytest.mark.parametrize("frames", [1, 2, 20])
def test_other_lengths_are_scored_too(frames):
    options = replace(OPTIONS, several_windows=0, bootstraps=0)
    result = evaluated(noise, real_windows(0, 12, frames), real_windows(1, 12, frames), options)
    assert result.frames == frames
    (score,) = _scores(result, "prediction", "position", "ball")
    assert score.count == 12 * (frames - 1) and np.isnan(score.l2) == (frames == 1)
    assert score.frechet is not None and score.frechet.dimensions == min(3 * frames, 48, 60 if frames < 20 else 11)
    assert "TOO FEW WINDOWS" in evaluation_text({"noise": [result]})


def test_numbers_that_are_not_finite_are_refused_with_their_place():
    def broken(windows: Windows, known: Tensor, text_known: Tensor, generator: torch.Generator) -> Tensor:
        state = windows.state.clone()
        state[5, 2, 0] = torch.nan
        return state

    with pytest.raises(FloatingPointError, match="prediction: window 5: expected finite"):
        evaluated(broken, real_windows(0, 12), real_windows(1, 12), OPTIONS)
    with pytest.raises(ValueError, match="windows: expected at least two, got 1"):
        evaluated(truth, real_windows(0, 1), real_windows(1, 12), OPTIONS)
    with pytest.raises(ValueError, match="of one length"):
        evaluated(truth, [*real_windows(0, 4, 8), *real_windows(0, 4, 9)], real_windows(1, 12), OPTIONS)
    with pytest.raises(ValueError, match="samples: expected at least 1"):
        EvaluateOptions(samples=0)


def test_physics_alone_is_judged_against_the_same_steps_of_the_real_windows():
    options = replace(OPTIONS, tasks=("completion",))
    scores = evaluate_physics(mean, real_windows(0, 24), LAYOUT, options, scene=TENNIS)
    found = {(s.made.object, s.made.name): s for s in scores if not s.settled}
    settled = {(s.made.object, s.made.name): s for s in scores if s.settled}
    assert settled.keys() == found.keys()
    fast = found["ball", "too_fast"]
    assert fast.task == "completion" and fast.rate == 4.0 and fast.real.value == 0.0
    assert fast.made.count == fast.real.count == 24 * 5
    assert found["ball", "ball_residual"].made.value == pytest.approx(9.81, rel=0.1)
    noisy = evaluate_physics(noise, real_windows(0, 24), LAYOUT, options, scene=TENNIS)
    raw, better = (
        next(s for s in noisy if (s.made.object, s.made.name, s.settled) == ("ball", "ball_residual", settled))
        for settled in (False, True)
    )
    assert better.made.value < raw.made.value / 3


def test_root_angles_do_not_jump_where_axis_angle_vectors_do():
    """The trap: a player who turns past pi. Errors stay small, and features stay continuous."""
    (angle,) = [q for q in quantities(LAYOUT) if q.name == "root_angle player0"]
    turn = np.linspace(2.6, 4.0, 8)
    upright = Rotation.from_rotvec(UPRIGHT)
    about = [(upright * Rotation.from_rotvec([0, a, 0])).as_rotvec() for a in turn]
    near = [(upright * Rotation.from_rotvec([0, a + 0.1, 0])).as_rotvec() for a in turn]
    one, other = (np.array(rotvecs)[None, :, None] for rotvecs in (about, near))
    np.testing.assert_allclose(errors(angle, one, other), 0.1, atol=1e-9)
    np.testing.assert_allclose(features(angle, one)[0].reshape(8, 3)[:, 1], turn, atol=1e-9)
    found = several_errors(angle, np.stack([one, other]), one, np.ones((1, 8), dtype=bool))
    assert found.mean == pytest.approx(0.05, abs=1e-6) and found.best == pytest.approx(0, abs=1e-7)


def test_joints_are_measured_apart_from_where_the_root_is_and_looks():
    state = real_windows(0, 2)[0].state.numpy().astype(np.float64)
    moved = state.copy()
    for column in ("player0.root_position", "player0.root_rotation"):
        moved[..., LAYOUT.slice_of(LAYOUT.row_of(column))] += 0.7
    (joints,) = [q for q in quantities(LAYOUT) if q.name == "joints player0"]
    one, other = (measured(joints, decode(LAYOUT, s, np.zeros((2, 2)))) for s in (state, moved))
    assert one.shape == (2, 8, 23, 3)
    np.testing.assert_allclose(one, other, atol=1e-9)
    skeleton = TENNIS.players[0].skeleton
    assert skeleton is not None
    still = measured(joints, decode(LAYOUT, np.zeros((2, 8, LAYOUT.channels)), np.zeros((2, 2))))
    np.testing.assert_allclose(still[0, 0, :3], skeleton.rest_translations[1:4], atol=1e-9)


def _plain(result: EvaluationResult) -> dict[str, object]:
    """Its values, which unlike NaN equal themselves; but for the time that it took."""
    return {**result_to_json(result), "frames_per_second": None}


def _scores(result: EvaluationResult, task: str, name: str, thing: str) -> list[Score]:
    return [s for s in result.scores if (s.task, s.property, s.object) == (task, name, thing)]


def test_ratios_are_geometric_means_that_a_figure_at_the_floor_does_not_blow_up(results):
    assert distance_ratio([results["noise"]], [results["noise"]]).value == pytest.approx(1.0)
    there = floor_subtracted_ratio([results["noise"]], [results["mean"]])
    back = floor_subtracted_ratio([results["mean"]], [results["noise"]])
    assert there.value * back.value == pytest.approx(1.0) and len(there.each) == 12
    perfect = floor_subtracted_ratio([results["noise"]], [results["truth"]])
    assert perfect.raised == 12 and np.isfinite(perfect.value)
    task, name, _, least = perfect.each[0]
    assert least == pytest.approx(LEAST_SHARE * results["truth"].mean(task, name, "chance"))
    assert np.isnan(floor_subtracted_ratio([replace(results["noise"], scores=())], [results["noise"]]).value)


def test_tasks_scored_one_by_one_are_those_scored_together_with_the_same_seed(results):
    real, other = real_windows(0), real_windows(1)
    about = {"fill": "noise", "steps": 1}
    parts = [
        evaluated(noise, real, other, replace(OPTIONS, tasks=(name,)), about=about) for name in results["noise"].tasks
    ]
    assert _plain(merged(parts)) == _plain(results["noise"])
    with pytest.raises(ValueError, match="seed: expected 0, got 1"):
        merged([parts[0], replace(parts[1], seed=1)])


def test_results_are_the_same_after_writing_and_reading(results, tmp_path: Path):
    result = evaluated(truth, real_windows(0, 5, 1), real_windows(1, 5, 1), OPTIONS)  # all figures unknown
    for each in (results["noise"], result):
        raw = json.loads(json.dumps(result_to_json(each), allow_nan=False))
        assert result_to_json(result_from_json(raw)) == result_to_json(each)
    write_evaluation(tmp_path, "noise", results["noise"])
    assert _plain(read_evaluation(tmp_path / "evaluation.json")) == _plain(results["noise"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["evaluation.json", "evaluation.md", "scores.csv"]
    (tmp_path / "evaluation.json").write_text("{}")
    with pytest.raises(ValueError, match="evaluation.json: evaluation: expected"):
        read_evaluation(tmp_path / "evaluation.json")


def test_tables_say_what_the_paper_says_and_what_it_leaves_out(results):
    text = evaluation_text({name: [result] for name, result in results.items()})
    for words in ("Opponent modelling", "Average", "64 windows of 8 frames", "4 frames a second", "seed 0", "steps: 1"):
        assert words in text
    rows = [line.split("|") for line in main_table({"noise": [results["noise"]]}).splitlines()[2:]]
    assert len(rows) == 2 * 5 and {len(row) for row in rows} == {13}
    first = [cell.strip() for cell in rows[0]]
    assert float(first[3]) == pytest.approx(results["noise"].mean("prediction", "position", "l2"), rel=1e-3)
    assert float(first[4]) == pytest.approx(results["noise"].mean("prediction", "position", "frechet"), rel=1e-3)
    average = float(rows[-2][3])
    each = [results["noise"].mean(task, "position", "l2") for task in results["noise"].tasks]
    assert average == pytest.approx(np.mean(each), rel=1e-3)
    lines = scores_csv({"noise": [results["noise"]]}).splitlines()
    assert len(lines) == 1 + len(results["noise"].scores)
    assert lines[0].startswith("model,task,property,object,unit,count,l2,")


def test_frechet_distances_are_those_of_whole_windows_with_what_was_given():
    """The slow way: decode, take the places of one object, and compare windows as completed with the real ones."""
    real, other = real_windows(0, 40), real_windows(1, 40)
    options = replace(OPTIONS, tasks=("completion",), several_windows=0, bootstraps=0)
    (score,) = _scores(evaluated(mean, real, other, options), "completion", "position", "ball")
    whole = _joined(real).state.numpy()
    filled = whole.copy()
    filled[:, 2:6] = 0
    rows = LAYOUT.slice_of(LAYOUT.row_of("ball.position"))
    slow = frechet_distance(*((5.0 * s[..., rows]).reshape(40, -1).astype(np.float64) for s in (filled, whole)))
    assert score.frechet is not None and score.frechet.distance == pytest.approx(slow, rel=1e-5)
