"""What an evaluation found: scores, their averages, ratios between models, and the same as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal, get_args

import numpy as np

from pgm_models.animation.physics_score import PhysicsFigure
from pgm_models.animation.task_scores import PropertyName
from pgm_models.animation.tasks import TaskName
from pgm_models.metrics import Discrepancy, FrechetScore

Measure = Literal["l2", "l2_best", "l2_mean", "energy", "frechet", "excess", "floor", "chance", "mmd", "mmd_floor"]
LEAST_SHARE = 0.1
"""Of what the number of windows alone brings between independent real ones: a Frechet distance beyond chance counts as
at least that in ratios. Of sequences filled in perfectly it scatters by 3 to 10 per cent of that at 2,048 windows of 48
numbers."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """How one property of one object was filled in, in one task. Unknown figures are NaN or None."""

    task: TaskName
    property: PropertyName
    object: str
    unit: str
    """Of all distances; that of Frechet distances is its square."""
    count: int
    """Unknown frames of all windows, of one sample each."""
    l2: float
    """Mean distance of one sample from the truth over unknown frames."""
    several_count: int
    """Unknown frames of the windows of which several samples were drawn."""
    l2_best: float
    """Of the best of several samples: an oracle."""
    l2_mean: float
    """Of the mean of several samples."""
    energy: float
    """Energy score of several samples."""
    frechet: FrechetScore | None
    """Between windows as completed and as they were, given values included; windows known to the data throughout."""
    floor: FrechetScore | None
    """Between those windows as they were and as many real ones of other matches."""
    discrepancy: Discrepancy | None
    """Unbiased MMD beside `frechet`."""
    discrepancy_floor: Discrepancy | None
    """Unbiased MMD beside `floor`."""

    def figure(self, measure: Measure) -> float:
        """One figure of it; NaN where it is unknown."""
        match measure:
            case "l2" | "l2_best" | "l2_mean" | "energy":
                return float(getattr(self, measure))
            case "frechet" | "excess":
                found = self.frechet
                return math.nan if found is None else found.distance if measure == "frechet" else found.excess
            case "floor":
                return math.nan if self.floor is None else self.floor.distance
            case "chance":
                return math.nan if self.floor is None else max(self.floor.distance - self.floor.excess, 0.0)
            case "mmd":
                return math.nan if self.discrepancy is None else self.discrepancy.value
            case "mmd_floor":
                return math.nan if self.discrepancy_floor is None else self.discrepancy_floor.value


@dataclass(frozen=True, kw_only=True)
class PhysicsScore:
    """One physical figure of generated motion, and the same of the real windows over the same steps."""

    task: TaskName
    rate: float
    """Frames a second."""
    made: PhysicsFigure
    real: PhysicsFigure
    settled: bool = False
    """Whether what was made was settled before it was judged (see `settle`), as `pgm animate` does."""

    @property
    def ratio(self) -> float:
        """Of the generated motion's figure to the real one's; NaN where either is unknown."""
        return self.made.value / self.real.value if self.real.value else math.nan


@dataclass(frozen=True, kw_only=True)
class EvaluationResult:
    """Everything that one evaluation found."""

    scene: str
    frames: int
    """Length of windows, T."""
    rate: float
    """Frames a second of the windows; NaN where they differ."""
    windows: int
    """Windows of which one sample was drawn, N."""
    reference_windows: int
    """Real windows of other matches."""
    several_windows: int
    """Windows of which several samples were drawn."""
    samples: int
    """How many, K."""
    dimensions: int
    """Numbers at most that distributions are compared in."""
    seed: int
    about: Mapping[str, str | int | float]
    """Of what: run, data, sampler, steps."""
    scores: tuple[Score, ...]
    physics: tuple[PhysicsScore, ...]
    keyframe_error: float
    """Largest difference of a given value in what was filled in, standardised: 0 where given values are kept."""
    frames_per_second: float
    """Frames filled in, of all tasks and samples, over the time that took."""

    @property
    def tasks(self) -> tuple[TaskName, ...]:
        """Tasks that were set, in order."""
        return tuple(name for name in get_args(TaskName) if any(score.task == name for score in self.scores))

    def mean(self, task: TaskName, name: PropertyName, measure: Measure) -> float:
        """A figure averaged over the objects of a property that have it; NaN where none has."""
        return mean_of([s.figure(measure) for s in self.scores if (s.task, s.property) == (task, name)])


def merged(parts: Sequence[EvaluationResult]) -> EvaluationResult:
    """One result of several that differ in their tasks alone.

    Raises:
        ValueError: If there is none, or they differ in anything else.
    """
    if not parts:
        raise ValueError("evaluations: expected at least one, got none")
    first = parts[0]
    for part in parts[1:]:
        for name in SETTINGS:
            if not _same(getattr(part, name), getattr(first, name)):
                raise ValueError(f"evaluations: {name}: expected {getattr(first, name)}, got {getattr(part, name)}")
    speeds = [part.frames_per_second for part in parts if part.frames_per_second > 0]
    return replace(
        first,
        scores=sum((part.scores for part in parts), ()),
        physics=sum((part.physics for part in parts), ()),
        keyframe_error=max(part.keyframe_error for part in parts),
        frames_per_second=len(speeds) / sum(1 / speed for speed in speeds) if speeds else math.nan,
    )


SETTINGS = (
    *("scene", "frames", "rate", "windows", "reference_windows", "several_windows", "samples", "dimensions", "seed"),
    "about",
)
"""Fields of a result that say of what it is."""


def _same(one: object, other: object) -> bool:
    return one == other or (one != one and other != other)


@dataclass(frozen=True, kw_only=True)
class Ratio:
    """How many times larger a figure of one model is than of another."""

    value: float
    """Geometric mean of `each`; NaN where there is none."""
    each: tuple[tuple[TaskName, PropertyName, float, float], ...]
    """Task, property, and the figure of the one and of the other, raised to the least value where below it."""
    raised: int
    """Figures that were raised."""


def floor_subtracted_ratio(these: Sequence[EvaluationResult], those: Sequence[EvaluationResult]) -> Ratio:
    """Geometric mean over tasks and properties of Frechet distances beyond chance: of these over those.

    Each figure is averaged over objects and results (seeds) first. `LEAST_SHARE` of what chance brings between real
    windows is the least that counts: else a figure at the floor would make any ratio.
    """
    each, raised = [], 0
    for task, name in _common(these, those):
        least = LEAST_SHARE * mean_of([result.mean(task, name, "chance") for result in (*these, *those)])
        pair = [mean_of([result.mean(task, name, "excess") for result in results]) for results in (these, those)]
        if all(math.isfinite(value) for value in (*pair, least)) and least > 0:
            raised += sum(value < least for value in pair)
            each.append((task, name, *(max(value, least) for value in pair)))
    return _ratio(each, raised)


def distance_ratio(
    these: Sequence[EvaluationResult],
    those: Sequence[EvaluationResult],
    measure: Literal["l2", "l2_best", "l2_mean", "energy"] = "l2",
) -> Ratio:
    """Geometric mean over tasks and properties of errors, averaged over objects and results: of these over those."""
    each = []
    for task, name in _common(these, those):
        pair = [mean_of([result.mean(task, name, measure) for result in results]) for results in (these, those)]
        if all(value > 0 for value in pair):
            each.append((task, name, *pair))
    return _ratio(each, 0)


def _common(
    these: Sequence[EvaluationResult], those: Sequence[EvaluationResult]
) -> list[tuple[TaskName, PropertyName]]:
    tasks = [t for t in get_args(TaskName) if all(t in result.tasks for result in (*these, *those))]
    return [(task, name) for task in tasks for name in get_args(PropertyName)]


def _ratio(each: list, raised: int) -> Ratio:
    value = math.exp(float(np.mean([math.log(one / other) for _, _, one, other in each]))) if each else math.nan
    return Ratio(value=value, each=tuple(each), raised=raised)


def mean_of(values: Sequence[float]) -> float:
    """Mean of the finite values; NaN where there is none."""
    there = [value for value in values if math.isfinite(value)]
    return float(np.mean(there)) if there else math.nan


def result_to_json(result: EvaluationResult) -> dict[str, object]:
    """The result as JSON values; null for NaN."""
    return {name: _plain(value) for name, value in asdict(result).items()}


def result_from_json(raw: Mapping) -> EvaluationResult:
    """The result that `result_to_json` gave.

    Raises:
        ValueError: If it is not such.
    """
    try:
        values = {**raw, "about": dict(raw["about"])}
        values["scores"] = tuple(_score(entry) for entry in raw["scores"])
        values["physics"] = tuple(
            PhysicsScore(
                task=entry["task"],
                rate=_number(entry["rate"]),
                made=PhysicsFigure(**{**entry["made"], "value": _number(entry["made"]["value"])}),
                real=PhysicsFigure(**{**entry["real"], "value": _number(entry["real"]["value"])}),
                settled=entry["settled"],
            )
            for entry in raw["physics"]
        )
        for name in ("rate", "keyframe_error", "frames_per_second"):
            values[name] = _number(raw[name])
        return EvaluationResult(**values)
    except (KeyError, TypeError) as error:
        raise ValueError(f"evaluation: expected what result_to_json writes, got {error!r}") from error


def _score(raw: Mapping) -> Score:
    kinds = {
        "frechet": FrechetScore,
        "floor": FrechetScore,
        "discrepancy": Discrepancy,
        "discrepancy_floor": Discrepancy,
    }
    values: dict = {name: _number(value) if name.startswith(("l2", "energy")) else value for name, value in raw.items()}
    for name, kind in kinds.items():
        if raw[name] is not None:
            values[name] = kind(**{key: _number(value) for key, value in raw[name].items()})
    return Score(**values)


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
