"""Real windows with what is measured of them, and the same windows as something filled them in."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pgm_data.scene import Scene
from pgm_models.animation.encode import decode
from pgm_models.animation.layout import Layout
from pgm_models.animation.task_scores import measured, quantities
from pgm_models.animation.tasks import TaskName, task_masks
from pgm_models.animation.windows import Fill, Windows, chosen


@dataclass(frozen=True, kw_only=True)
class EvaluateOptions:
    """How much is filled in, and how it is compared.

    Raises:
        ValueError: If a number is out of range.
    """

    windows: int = 2_048
    """Windows at most of which one sample is drawn, evenly spread over those given."""
    several_windows: int = 256
    """Windows of those of which several samples are drawn; 0 for none."""
    samples: int = 8
    """How many samples that is."""
    tasks: tuple[TaskName, ...] = ()
    """Which; all that the scene has where empty."""
    dimensions: int = 48
    """Numbers at most in which distributions are compared: longer windows and poses go through principal axes."""
    bootstraps: int = 1_000
    """For the interval of the MMD."""
    batch: int = 64
    """Windows at most that are filled in at once."""
    device: str = "cpu"
    """Where windows are put before they are filled in."""
    seed: int = 0
    """Of the noise, which is the same for all that is scored, and of bootstraps."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        lowest = {"windows": 2, "several_windows": 0, "samples": 1, "dimensions": 1, "bootstraps": 0, "batch": 1}
        for name, low in lowest.items():
            if getattr(self, name) < low:
                raise ValueError(f"EvaluateOptions.{name}: expected at least {low}, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class RealWindows:
    """Real windows, as they are."""

    batches: tuple[Windows, ...]
    state: Float[np.ndarray, "N T C"]
    valid: Bool[np.ndarray, "N T P"]
    constants: Float[np.ndarray, "N K"]
    rate: Float[np.ndarray, " N"]
    values: Mapping[str, Float[np.ndarray, "N T points 3"]]
    """Of each quantity, by property and object."""
    columns: Mapping[str, Float[np.ndarray, "N T _"]]


@dataclass(frozen=True, eq=False, kw_only=True)
class FilledWindows:
    """Windows as something completed them: given values are the real ones."""

    state: Float[np.ndarray, "samples N T C"]
    known: Bool[np.ndarray, "N T P"]
    keyframe_error: float
    """Largest difference of a given value from the real one, standardised, before it was put in its place."""
    seconds: float
    """Spent on filling in."""

    @property
    def frames(self) -> int:
        """Frames of all samples and windows."""
        return int(np.prod(self.state.shape[:3]))


def real_windows(
    windows: Windows | Sequence[Windows], layout: Layout, options: EvaluateOptions, scene: Scene
) -> RealWindows:
    """The windows that are used, in batches small enough, and what is measured of them.

    Raises:
        ValueError: If there are none, or their lengths differ.
    """
    given = [windows] if isinstance(windows, Windows) else list(windows)
    counts = [len(batch.names) for batch in given]
    total = sum(counts)
    if total < 2:
        raise ValueError(f"windows: expected at least two, got {total}")
    lengths = sorted({batch.state.shape[1] for batch in given})
    if len(lengths) > 1:
        raise ValueError(f"windows: expected all of one length, got {lengths}")
    taken = np.floor((np.arange(min(total, options.windows)) + 0.5) * total / min(total, options.windows))
    return _measured_windows(tuple(_batches(given, taken.astype(np.int64), options.batch)), layout, scene)


def some_windows(real: RealWindows, options: EvaluateOptions) -> "RealWindows | None":
    """The windows of which several samples are drawn, evenly spread."""
    total = len(real.state)
    count = min(options.several_windows, total)
    if count == 0:
        return None
    taken = np.floor((np.arange(count) + 0.5) * total / count).astype(np.int64)
    return replace(
        real,
        batches=tuple(_batches(real.batches, taken, options.batch)),
        values={name: values[taken] for name, values in real.values.items()},
        columns={name: values[taken] for name, values in real.columns.items()},
        **{name: getattr(real, name)[taken] for name in ("state", "valid", "constants", "rate")},
    )


def _batches(given: Sequence[Windows], taken: np.ndarray, most: int) -> Iterator[Windows]:
    """The windows with those numbers, counted over all batches, in batches of at most so many."""
    first = 0
    for batch in given:
        own = taken[(taken >= first) & (taken < first + len(batch.names))] - first
        for start in range(0, len(own), most):
            rows = own[start : start + most]
            whole = len(rows) == len(batch.names)
            yield batch if whole else chosen(batch, torch.from_numpy(rows))
        first += len(batch.names)


def _measured_windows(batches: tuple[Windows, ...], layout: Layout, scene: Scene) -> RealWindows:
    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(batch, name).cpu().numpy() for batch in batches])

    state, constants = joined("state"), joined("constants")
    columns = decode(layout, state, constants, scene=scene)
    return RealWindows(
        batches=batches,
        state=state,
        valid=joined("valid"),
        constants=constants,
        rate=joined("rate").astype(np.float64),
        values={quantity.name: measured(quantity, columns) for quantity in quantities(layout)},
        columns=columns,
    )


def filled_windows(
    fill: Fill,
    name: TaskName,
    real: RealWindows,
    layout: Layout,
    options: EvaluateOptions,
    *,
    samples: int,
    show: Callable[[str], None],
) -> FilledWindows:
    """The task set to `fill`: several samples of all windows, each from noise of its own."""
    states, knowns = [], []
    kept, seconds = 0.0, 0.0
    owners = torch.as_tensor(layout.property_of_channel.copy(), device=options.device)
    order = get_args(TaskName).index(name)
    for number, batch in enumerate(real.batches):
        there = batch.to(options.device)
        known, text_known = task_masks(name, there, layout)
        given = known[..., owners]
        drawn = []
        for sample in range(samples):
            seed = np.random.SeedSequence([options.seed, order, samples, sample, number]).generate_state(1)[0]
            begun = time.perf_counter()
            made = fill(there, known, text_known, torch.Generator().manual_seed(int(seed)))
            off = (made - there.state)[given].abs()  # waits for what is still computed
            kept = max(kept, float(off.max()) if off.numel() else 0.0)
            seconds += time.perf_counter() - begun
            _check(made, there, name)
            drawn.append(torch.where(given, there.state, made).float().cpu().numpy())
        states.append(np.stack(drawn))
        knowns.append(known.cpu().numpy())
        show(f"{name}: {number + 1} of {len(real.batches)} batches, {samples} sample{'s' if samples > 1 else ''} each")
    return FilledWindows(
        state=np.concatenate(states, axis=1),
        known=np.concatenate(knowns),
        keyframe_error=kept,
        seconds=seconds,
    )


def _check(made: Tensor, windows: Windows, name: TaskName) -> None:
    if made.shape != windows.state.shape:
        raise ValueError(f"{name}: expected states of shape {tuple(windows.state.shape)}, got {tuple(made.shape)}")
    bad = (~torch.isfinite(made)).flatten(1).any(dim=1).nonzero().flatten().tolist()
    if bad:
        raise FloatingPointError(f"{name}: {windows.names[bad[0]]}: expected finite states, got NaN or infinity")
