"""Evaluations as tables laid out like the paper's, as CSV and as JSON.

Tables are Markdown whose columns are also aligned, so that they read as text.
"""

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import get_args

from pgm_data.dataset.files import whole_file
from pgm_models.animation.evaluation_result import EvaluationResult, Measure, mean_of, result_from_json, result_to_json
from pgm_models.animation.physics_score import FIGURES
from pgm_models.animation.task_scores import UNITS, PropertyName
from pgm_models.animation.tasks import TITLES, TaskName
from pgm_models.markdown_table import markdown_table

HEADS: Mapping[PropertyName, str] = {"position": "Position", "root_angle": "Root angle", "joints": "Joints 3D"}
JSON_NAME, CSV_NAME, TABLE_NAME = "evaluation.json", "scores.csv", "evaluation.md"
"""Files that `write_evaluation` writes."""
SEVERAL: Mapping[Measure, str] = {"l2": "L2", "l2_best": "best", "l2_mean": "mean", "energy": "energy"}
"""Columns of the table of several samples."""


def evaluation_text(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """All tables of some models, and what they mean; figures are averages over each model's results (seeds).

    Args:
        results: By the models' names; of each one or more results with other seeds.
    """
    every = [result for found in results.values() for result in found]
    if not every:
        raise ValueError("results: expected at least one, got none")
    parts = [_settings(every), main_table(results), _notes(every)]
    if any(result.several_windows for result in every):
        first = next(result for result in every if result.several_windows)
        parts += [
            f"Of {first.samples} samples of {first.several_windows} windows: the best chosen by the truth (an oracle), "
            "their mean (a regressor's fair opponent), and the energy score.",
            several_table(results),
        ]
    parts += [
        "Unbiased squared MMD, times 1000, with its bootstrap interval; real windows beside it.",
        mmd_table(results),
    ]
    parts += ["Physics, generated and of the real windows over the same steps.", physics_table(results)]
    return "\n\n".join(parts) + "\n"


def main_table(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """L2 and Frechet distances of each task and on average: the paper's table, with what it leaves out.

    `FD` is the distance as the paper takes it, `FD-chance` what the number of windows does not explain of it. The row
    `real` has the distance between real windows of these and of other matches.
    """
    header = ["task", "model"]
    for name in get_args(PropertyName):
        unit = UNITS[name]
        header += [f"{HEADS[name]} L2 [{unit}]", f"FD [{unit}^2]", "FD-chance"]
    rows = []
    every = [result for found in results.values() for result in found]
    for task in (*_tasks(every), None):
        title = "Average" if task is None else TITLES[task]
        for model, found in results.items():
            rows.append([title, model, *_cells(found, task, ("l2", "frechet", "excess"))])
        real = [_average(every, task, name, "floor") for name in get_args(PropertyName)]
        rows.append([title, "real", *(cell for value in real for cell in ("", value, ""))])
    return markdown_table(header, rows)


def several_table(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """Errors of one sample, of the best and of the mean of several, and the energy score."""
    header = ["task", "model"]
    for name in get_args(PropertyName):
        header += [f"{HEADS[name]} L2 [{UNITS[name]}]", *list(SEVERAL.values())[1:]]
    every = [result for found in results.values() for result in found]
    rows = [
        ["Average" if task is None else TITLES[task], model, *_cells(found, task, tuple(SEVERAL))]
        for task in (*_tasks(every), None)
        for model, found in results.items()
    ]
    return markdown_table(header, rows)


def mmd_table(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """MMD of each task, property and object, of each model's first result."""
    rows = []
    for model, found in results.items():
        for score in found[0].scores:
            made, real = score.discrepancy, score.discrepancy_floor
            if made is not None and real is not None:
                told = [f"{1e3 * d.value:.3f} ({1e3 * d.low:.3f} to {1e3 * d.high:.3f})" for d in (made, real)]
                rows.append([TITLES[score.task], model, HEADS[score.property], score.object, *told])
    return markdown_table(["task", "model", "property", "object", "MMD^2", "real"], rows)


def physics_table(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """Each physical figure, of each model's first result."""
    rows = [
        [
            *(TITLES[score.task], model, score.made.object, FIGURES[score.made.name]),
            "settled" if score.settled else "generated",
            f"{score.made.value:.4g}" if math.isfinite(score.made.value) else "-",
            f"{score.real.value:.4g}" if math.isfinite(score.real.value) else "-",
            *(score.ratio, score.made.unit, score.rate, score.made.count),
        ]
        for model, found in results.items()
        for score in found[0].physics
        if score.made.count or score.real.count
    ]
    header = ["task", "model", "object", "figure", "as it is", "made", "real", "ratio", "unit", "rate [1/s]", "count"]
    return markdown_table(header, rows)


def scores_csv(results: Mapping[str, Sequence[EvaluationResult]]) -> str:
    """Every score of every result as one row of a table of comma-separated values."""
    columns = ("task", "property", "object", "unit", "count", "l2", "several_count", "l2_best", "l2_mean", "energy")
    told = ("distance", "excess", "rows", "dimensions")
    spread = ("value", "low", "high", "bandwidth")
    pairs = {"frechet": told, "floor": told, "discrepancy": spread, "discrepancy_floor": spread}
    about = sorted({name for found in results.values() for result in found for name in result.about})
    settings = ("scene", "frames", "rate", "windows", "reference_windows", "several_windows", "samples", "seed")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    heads = [f"{name}_{part}" for name, parts in pairs.items() for part in parts]
    writer.writerow(["model", *columns, *heads, *settings, *about])
    for model, found in results.items():
        for result in found:
            for score in result.scores:
                values = [model, *(getattr(score, name) for name in columns)]
                for name, parts in pairs.items():
                    entry = getattr(score, name)
                    values += [None if entry is None else getattr(entry, part) for part in parts]
                values += [getattr(result, name) for name in settings]
                values += [result.about.get(name) for name in about]
                writer.writerow(["" if v is None or v != v else v for v in values])
    return text.getvalue()


def write_evaluation(folder: Path, model: str, result: EvaluationResult) -> None:
    """Write a result as JSON, CSV and tables into a folder that is there, each file whole or not at all."""
    results = {model: [result]}
    texts = {
        JSON_NAME: json.dumps(result_to_json(result), indent=1, allow_nan=False) + "\n",
        CSV_NAME: scores_csv(results),
        TABLE_NAME: evaluation_text(results),
    }
    for name, text in texts.items():
        with whole_file(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def read_evaluation(path: Path) -> EvaluationResult:
    """The result of a JSON file that `write_evaluation` wrote.

    Raises:
        ValueError: If it is not such a file.
    """
    try:
        return result_from_json(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from error


def _tasks(results: Sequence[EvaluationResult]) -> tuple[TaskName, ...]:
    return tuple(name for name in get_args(TaskName) if any(name in result.tasks for result in results))


def _average(results: Sequence[EvaluationResult], task: TaskName | None, name: PropertyName, measure: Measure) -> float:
    """Over results, and over tasks where none is named."""
    tasks = _tasks(results) if task is None else (task,)
    return mean_of([result.mean(each, name, measure) for each in tasks for result in results])


def _cells(results: Sequence[EvaluationResult], task: TaskName | None, measures: Sequence[Measure]) -> list[float]:
    return [_average(results, task, name, measure) for name in get_args(PropertyName) for measure in measures]


def _settings(results: Sequence[EvaluationResult]) -> str:
    """What was done, once; and what differs between results."""
    first = results[0]
    rate = f"{first.rate:g}" if math.isfinite(first.rate) else "several"
    seeds = ", ".join(sorted({str(result.seed) for result in results}))
    lines = [
        f"Scene {first.scene}; {first.windows} windows of {first.frames} frames, {rate} frames a second, against "
        f"{first.reference_windows} real ones of other matches; seed {seeds}."
    ]
    for name in sorted({name for result in results for name in result.about}):
        values = sorted({str(result.about.get(name, "-")) for result in results})
        lines.append(f"{name}: {', '.join(values)}.")
    lines.append(
        f"Largest change to a given value: {max(result.keyframe_error for result in results):g} (standardised)."
    )
    speeds = [f"{result.frames_per_second:.4g}" for result in results]
    lines.append(f"Frames filled in a second: {', '.join(speeds)}.")
    return "  \n".join(lines)


def _notes(results: Sequence[EvaluationResult]) -> str:
    scores = [score.frechet for result in results for score in result.scores if score.frechet is not None]
    rows, dimensions = [sorted({getattr(score, name) for score in scores}) for name in ("rows", "dimensions")]
    told = (
        f"FD is squared, between windows as completed and as they were, given values included; N = {_range(rows)} "
        f"windows of {_range(dimensions)} numbers (positions and root angles as they are up to that many, poses along "
        "the principal axes of the other matches' windows). FD-chance is its limit for ever more windows. Figures are "
        "means over objects: players and ball, of opponent modelling the hidden player alone. The row `real` is the "
        "distance from other matches at the same N; windows that share given values can lie below it."
    )
    few = sum(not score.reliable for score in scores)
    if few:
        told += f" TOO FEW WINDOWS for {few} of {len(scores)} Frechet distances: read them with care."
    return told


def _range(values: Sequence[int]) -> str:
    return "-" if not values else str(values[0]) if len(values) == 1 else f"{values[0]} to {values[-1]}"
