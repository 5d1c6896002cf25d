"""Tables of a trade of the animation model: speed and quality, physics, and ratios between models."""

import math
from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np

from pgm_data.stages.trade_ball_tables import markdown
from pgm_models.animation.evaluation_result import (
    LEAST_SHARE,
    EvaluationResult,
    Measure,
    Ratio,
    distance_ratio,
    floor_subtracted_ratio,
    mean_of,
)
from pgm_models.animation.task_scores import PropertyName
from pgm_models.animation.tasks import TITLES, TaskName

Results = Mapping[str, Sequence[EvaluationResult]]
"""Results of each row of a table, one a seed."""


def physics_table(rows: Results) -> str:
    """Physical figures of what was generated and of the real windows, averaged over tasks and seeds, by framerate."""
    figures = dict.fromkeys(
        (score.made.name, score.made.object, score.made.unit, round(score.rate, 3))
        for own in rows.values()
        for result in own
        for score in result.physics
    )
    lines = []
    for name, thing, unit, rate in figures:
        cells = []
        for own in rows.values():
            scores = [score for result in own for score in result.physics if round(score.rate, 3) == rate]
            found = [score for score in scores if (score.made.name, score.made.object) == (name, thing)]
            made = mean_of([score.made.value for score in found])
            real = mean_of([score.real.value for score in found])
            times = f", {_said(made / real)} times" if real else ""
            cells.append(f"{_said(made)} ({_said(real)}{times})")
        lines.append([name, thing, unit, f"{rate:g}", *cells])
    if not lines:
        return ""
    return f"### Physics: generated (real)\n\n{markdown(['figure', 'object', 'unit', 'rate', *rows], lines)}"


def speed_table(rows: Results) -> str:
    """Speed, and how exactly given values were kept before they were put in their place."""
    lines = [
        [
            said,
            str(len(own)),
            str(own[0].windows),
            _said(mean_of([result.frames_per_second for result in own])),
            _said(quality(own)),
            _said(error(own)),
            _said(max(result.keyframe_error for result in own)),
        ]
        for said, own in rows.items()
    ]
    head = [
        "model", "seeds", "windows", "frames a second", "Frechet beyond chance, geometric mean",
        "L2, geometric mean", "largest error of given values",
    ]  # fmt: skip
    return markdown(head, lines)


def quality(results: Sequence[EvaluationResult]) -> float:
    """Frechet distance beyond chance, the geometric mean over tasks and properties; at least what counts in ratios."""
    values = []
    for task, name in _places(results):
        chance, excess = (_mean(results, task, name, measure) for measure in ("chance", "excess"))
        if math.isfinite(excess) and chance > 0:
            values.append(max(excess, LEAST_SHARE * chance))
    return _geometric(values)


def error(results: Sequence[EvaluationResult]) -> float:
    """L2 of one sample, the geometric mean over tasks and properties."""
    return _geometric([_mean(results, task, name, "l2") for task, name in _places(results)])


def ratio_lines(
    what: str, these: Sequence[EvaluationResult], those: Sequence[EvaluationResult], wanted: str = ""
) -> list[str]:
    """How many times the Frechet distance beyond chance and L2 of these are those of those, in words.

    Over all seeds together, and seed by seed where both have as many. Nothing where one has no result.
    """
    if not these or not those:
        return []
    frechet, l2 = floor_subtracted_ratio(these, those), distance_ratio(these, those)
    said = f"{what}: Frechet beyond chance {_said(frechet.value)} times{wanted}, L2 {_said(l2.value)} times"
    if len(these) == len(those) > 1:
        each = [floor_subtracted_ratio([one], [other]).value for one, other in zip(these, those, strict=True)]
        said += f"; seed by seed {', '.join(_said(value) for value in each)}"
    if frechet.raised:
        said += f" ({frechet.raised} of {2 * len(frechet.each)} figures raised to {100 * LEAST_SHARE:g} % of chance)"
    return [said]


def task_ratio_lines(what: str, these: Sequence[EvaluationResult], those: Sequence[EvaluationResult]) -> list[str]:
    """The ratio of Frechet distances beyond chance task by task, in words."""
    if not these or not those:
        return []
    ratio = floor_subtracted_ratio(these, those)
    by_task = {task: _geometric([a / b for name, _, a, b in ratio.each if name == task]) for task in TITLES}
    told = ", ".join(f"{task} {_said(value)}" for task, value in by_task.items() if math.isfinite(value))
    return [f"{what}, task by task: {told}"]


def ratio_document(ratio: Ratio) -> dict[str, object]:
    """A ratio in JSON's types; None for NaN."""
    each = [[task, name, one, other] for task, name, one, other in ratio.each]
    return {"value": ratio.value if math.isfinite(ratio.value) else None, "each": each, "raised": ratio.raised}


def _mean(results: Sequence[EvaluationResult], task: TaskName, name: PropertyName, measure: Measure) -> float:
    return mean_of([result.mean(task, name, measure) for result in results if task in result.tasks])


def _places(results: Sequence[EvaluationResult]) -> list[tuple[TaskName, PropertyName]]:
    return [(task, name) for task in _tasks(results) for name in get_args(PropertyName)]


def _tasks(results: Sequence[EvaluationResult]) -> list[TaskName]:
    done = {task for result in results for task in result.tasks}
    return [task for task in TITLES if task in done]


def _geometric(values: Sequence[float]) -> float:
    there = [value for value in values if math.isfinite(value) and value > 0]
    return float(np.exp(np.mean(np.log(there)))) if there else math.nan


def _said(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"
