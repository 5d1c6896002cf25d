"""Scoring whatever fills in windows: the paper's tasks on real windows that it has not learned from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.scene import Scene, load_scene
from pgm_models.animation.encode import decode
from pgm_models.animation.evaluation_result import EvaluationResult, PhysicsScore, Score
from pgm_models.animation.filled_windows import (
    EvaluateOptions,
    FilledWindows,
    RealWindows,
    filled_windows,
    real_windows,
    some_windows,
)
from pgm_models.animation.layout import Layout
from pgm_models.animation.physics_score import Motion, fastest_speeds, physics_figures
from pgm_models.animation.settle import settled_windows
from pgm_models.animation.task_scores import (
    UNITS,
    Quantity,
    axes_of,
    errors,
    features,
    measured,
    quantities,
    several_errors,
)
from pgm_models.animation.tasks import TaskName, scored_players, task_names
from pgm_models.animation.windows import Fill, Windows
from pgm_models.metrics import (
    Discrepancy,
    FrechetScore,
    Projection,
    discrepancy,
    frechet_score,
    median_distance,
)

FASTER = 1.1
"""Times the highest speed of the real windows: what is faster is too fast."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Yardstick:
    """What distributions of a quantity are compared with, the same for every model and task."""

    rows: Bool[np.ndarray, " N"]
    """Windows that the data know throughout."""
    real: Float[np.ndarray, "rows numbers"]
    axes: Projection | None
    bandwidth: float
    floor: FrechetScore
    discrepancy_floor: Discrepancy


def evaluate(
    fill: Fill,
    windows: Windows | Sequence[Windows],
    reference: Windows | Sequence[Windows],
    layout: Layout,
    options: EvaluateOptions,
    *,
    scene: Scene | None = None,
    about: Mapping[str, str | int | float] | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> EvaluationResult:
    """Scores of what `fill` makes of the windows in each task.

    Frechet distances and MMD are taken between windows as completed, given values included as in the paper, and the
    same windows as they were, object by object, over whole windows; of each distance it is told how much chance alone
    does not explain (`metrics.frechet_score`). The real-to-real floor is the distance of the windows from the
    reference.

    Args:
        fill: What fills in windows.
        windows: Real ones that it has not learned from, all of one length.
        reference: Real ones of other matches, best as many: principal axes are fixed on them.
        layout: Of the states.
        options: How much.
        scene: What the layout is of, where it does not ship with the package.
        about: What is scored, kept in the result.
        show: Is told how far it is.

    Raises:
        ValueError: If there are fewer than two windows, lengths differ, or a task is not the scene's.
        FloatingPointError: If something was filled in that is not finite; names task and window.
    """
    names = options.tasks or task_names(layout)
    scene = load_scene(layout.scene) if scene is None else scene
    real = real_windows(windows, layout, options, scene)
    other = real_windows(reference, layout, options, scene)
    some = some_windows(real, options)
    found = quantities(layout)
    sticks = {quantity.name: _yardstick(quantity, real, other, layout, options) for quantity in found}
    limits = _limits(layout, real, other, scene)
    scores: list[Score] = []
    physics: list[PhysicsScore] = []
    kept, frames, seconds = 0.0, 0, 0.0
    for name in names:
        filled = filled_windows(fill, name, real, layout, options, samples=1, show=show)
        columns = decode(layout, filled.state[0], real.constants, scene=scene)
        here = [
            _score(name, quantity, real, filled, columns, sticks[quantity.name], options)
            for quantity in found
            if quantity.player in scored_players(name, layout)
        ]
        parts = [filled]
        if some is not None:
            parts.append(filled_windows(fill, name, some, layout, options, samples=options.samples, show=show))
            here = _with_several(here, found, some, parts[1], layout, scene)
        scores += here
        physics += _physics(name, real, filled.known, columns, layout, scene, limits)
        kept = max(kept, *(part.keyframe_error for part in parts))
        frames += sum(part.frames for part in parts)
        seconds += sum(part.seconds for part in parts)
        show(f"{name}: scored")
    return EvaluationResult(
        scene=layout.scene,
        frames=real.state.shape[1],
        rate=_one_rate(real.rate),
        windows=len(real.state),
        reference_windows=len(other.state),
        several_windows=0 if some is None else len(some.state),
        samples=options.samples,
        dimensions=options.dimensions,
        seed=options.seed,
        about=dict(about or {}),
        scores=tuple(scores),
        physics=tuple(physics),
        keyframe_error=kept,
        frames_per_second=frames / seconds if seconds > 0 else float("nan"),
    )


def evaluate_physics(
    fill: Fill,
    windows: Windows | Sequence[Windows],
    layout: Layout,
    options: EvaluateOptions,
    *,
    scene: Scene | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> tuple[PhysicsScore, ...]:
    """The physical figures alone: for windows at a finer rate, where feet that slide show best.

    Of what was filled in as it is, and settled.

    Arguments and errors as of `evaluate`.
    """
    scene = load_scene(layout.scene) if scene is None else scene
    real = real_windows(windows, layout, options, scene)
    limits = _limits(layout, real, real, scene)
    found: list[PhysicsScore] = []
    for name in options.tasks or task_names(layout):
        filled = filled_windows(fill, name, real, layout, options, samples=1, show=show)
        columns = decode(layout, filled.state[0], real.constants, scene=scene)
        found += _physics(name, real, filled.known, columns, layout, scene, limits)
        show(f"{name}: settling {len(real.rate)} windows")
        known = {entry.column: filled.known[..., row] for row, entry in enumerate(layout.properties)}
        better = settled_windows(columns, known, real.rate, scene)
        found += [
            replace(score, settled=True) for score in _physics(name, real, filled.known, better, layout, scene, limits)
        ]
    return tuple(found)


def _one_rate(rate: np.ndarray) -> float:
    return float(rate[0]) if np.allclose(rate, rate[0]) else float("nan")


def _judged(quantity: Quantity, real: RealWindows, known: Bool[np.ndarray, "N T P"]) -> Bool[np.ndarray, "N T"]:
    """Frames in which the quantity is generated and the data know it."""
    rows = list(quantity.rows)
    return np.asarray(real.valid[..., rows].all(axis=-1) & ~known[..., rows].all(axis=-1))


def _yardstick(
    quantity: Quantity, real: RealWindows, other: RealWindows, layout: Layout, options: EvaluateOptions
) -> _Yardstick | None:
    """None where fewer than two windows of a side are known throughout."""
    rows = list(quantity.rows)
    here, there = (np.asarray(windows.valid[..., rows].all(axis=(1, 2))) for windows in (real, other))
    if min(here.sum(), there.sum()) < 2:
        return None
    reference = features(quantity, other.values[quantity.name][there])
    own = features(quantity, real.values[quantity.name][here])
    axes = axes_of(reference, options.dimensions)
    reference, own = _along(axes, reference), _along(axes, own)
    count = min(len(reference), len(own))
    bandwidth = median_distance(own)
    few = np.linspace(0, len(own) - 1, count).astype(np.int64)
    others = np.linspace(0, len(reference) - 1, count).astype(np.int64)
    return _Yardstick(
        rows=here,
        real=own,
        axes=axes,
        bandwidth=bandwidth,
        floor=frechet_score(own[few], reference[others], np.random.default_rng(options.seed)),
        discrepancy_floor=_mmd(reference[others], own[few], bandwidth, options),
    )


def _along(axes: Projection | None, rows: np.ndarray) -> np.ndarray:
    return rows if axes is None else axes.project(rows)


def _mmd(a: np.ndarray, b: np.ndarray, bandwidth: float, options: EvaluateOptions) -> Discrepancy:
    rng = np.random.default_rng(options.seed)
    return discrepancy(a, b, bandwidth=bandwidth, rng=rng, bootstraps=options.bootstraps)


def _score(
    name: TaskName,
    quantity: Quantity,
    real: RealWindows,
    filled: FilledWindows,
    columns: Mapping[str, np.ndarray],
    stick: _Yardstick | None,
    options: EvaluateOptions,
) -> Score:
    values = measured(quantity, columns)
    judged = _judged(quantity, real, filled.known)
    off = errors(quantity, values, real.values[quantity.name])[judged]
    frechet = mmd = None
    if stick is not None:
        made = _along(stick.axes, features(quantity, values[stick.rows]))
        frechet = frechet_score(made, stick.real, np.random.default_rng(options.seed))
        mmd = _mmd(made, stick.real, stick.bandwidth, options)
    return Score(
        task=name,
        property=quantity.kind,
        object=quantity.object,
        unit=UNITS[quantity.kind],
        count=int(judged.sum()),
        l2=float(off.mean()) if off.size else float("nan"),
        several_count=0,
        l2_best=float("nan"),
        l2_mean=float("nan"),
        energy=float("nan"),
        frechet=frechet,
        floor=None if stick is None else stick.floor,
        discrepancy=mmd,
        discrepancy_floor=None if stick is None else stick.discrepancy_floor,
    )


def _with_several(
    scores: Sequence[Score],
    found: Sequence[Quantity],
    some: RealWindows,
    several: FilledWindows,
    layout: Layout,
    scene: Scene,
) -> list[Score]:
    """The scores with errors of several samples."""
    constants = np.broadcast_to(some.constants, (len(several.state), *some.constants.shape))
    columns = decode(layout, several.state, constants, scene=scene)
    by_name = {quantity.name: quantity for quantity in found}
    result = []
    for score in scores:
        quantity = by_name[f"{score.property} {score.object}"]
        judged = _judged(quantity, some, several.known)
        off = several_errors(quantity, measured(quantity, columns), some.values[quantity.name], judged)
        result.append(
            replace(score, several_count=int(judged.sum()), l2_best=off.best, l2_mean=off.mean, energy=off.energy)
        )
    return result


def _motion(
    layout: Layout, real: RealWindows, columns: Mapping[str, np.ndarray], made: Bool[np.ndarray, "N T P"]
) -> Motion:
    names = [entry.column for entry in layout.properties]
    return Motion(
        columns=columns,
        valid={column: real.valid[..., row] for row, column in enumerate(names)},
        made={column: made[..., row] for row, column in enumerate(names)},
        step_s=1.0 / real.rate,
    )


def _limits(layout: Layout, real: RealWindows, other: RealWindows, scene: Scene) -> dict[str, float]:
    """The speed of each object beyond which it is too fast, m/s."""
    found: dict[str, float] = {}
    for windows in (real, other):
        motion = _motion(layout, windows, windows.columns, windows.valid)
        for name, speed in fastest_speeds(motion, scene).items():
            found[name] = max(found.get(name, 0.0), FASTER * speed)
    return found


def _physics(
    name: TaskName,
    real: RealWindows,
    known: Bool[np.ndarray, "N T P"],
    columns: Mapping[str, np.ndarray],
    layout: Layout,
    scene: Scene,
    limits: Mapping[str, float],
) -> list[PhysicsScore]:
    """Figures of what was generated, and of the real windows over the same steps."""
    made, true = (
        physics_figures(_motion(layout, real, each, ~known), scene, limits) for each in (columns, real.columns)
    )
    rate = _one_rate(real.rate)
    return [PhysicsScore(task=name, rate=rate, made=one, real=two) for one, two in zip(made, true, strict=True)]
