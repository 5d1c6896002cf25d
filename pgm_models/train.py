"""The training loop of every model: AdamW, warm-up and cosine, clipping, averaged weights, exact resume.

A schedule counts steps, or minutes of training: then the rate follows the clock and is fully annealed when the
time is up, however busy the machine was. A batch is a pure function of its step, so that a resumed run sees what
an unbroken one would have seen.
"""

import json
import math
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from pgm_models.checkpoint import (
    CHECKPOINT_NAME,
    Checkpoint,
    load_checkpoint,
    optimiser_tensors,
    restore_optimiser,
    save_checkpoint,
)

LOG_NAME = "log.jsonl"
"""File name of the log inside a run: one JSON object a line."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainOptions:
    """How a network is trained."""

    steps: int = 0
    """Optimiser steps; 0 where `minutes` counts instead."""
    minutes: float = 0.0
    """Minutes of training, all parts of a resumed run together; 0 where `steps` counts instead."""
    accumulate: int = 1
    """Batches whose gradients are averaged in one step."""
    learning_rate: float = 2e-3
    """Highest learning rate."""
    warmup: float = 0.03
    """Share of the schedule in which the rate rises from 0."""
    weight_decay: float = 0.01
    """AdamW's weight decay; biases and norms have none."""
    clip: float = 1.0
    """Largest norm of the gradient."""
    average: float = 0.999
    """Share the moving average keeps in a step; it starts lower, min(this, (1 + n) / (10 + n))."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the network's inner arithmetic."""
    checkpoint_minutes: float = 4.0
    """Minutes between checkpoints, each with a validation."""
    log_every: int = 20
    """Steps between lines of the log."""
    seed: int = 0
    """Of weights, batches and noise."""
    threads: int = 2
    """CPU threads."""

    def __post_init__(self) -> None:
        """Check that exactly one of the two schedules is set."""
        if (self.steps > 0) == (self.minutes > 0):
            raise ValueError(f"steps, minutes: expected exactly one above 0, got {self.steps} and {self.minutes}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Batch:
    """Tensors for one forward pass."""

    tensors: Mapping[str, Tensor]
    names: tuple[str, ...]
    """What each sample is, to name it when its loss is not finite."""


class Task(ABC):
    """What is learned from what."""

    @abstractmethod
    def batch(self, index: int) -> Batch:
        """Batch number `index` of the run: the same whenever it is asked for."""

    @abstractmethod
    def loss(self, network: nn.Module, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The batch's mean loss, and its terms for the log."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Figures of merit on held-out data."""

    @abstractmethod
    def describe(self) -> dict[str, object]:
        """Options and data as JSON values, kept in the checkpoint."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """How a run ended."""

    state: Literal["done", "interrupted"]
    network: nn.Module
    """With the averaged weights, in evaluation mode."""
    step: int
    """Optimiser steps done."""
    elapsed_s: float
    """Seconds of training."""


def train(
    network: nn.Module,
    task: Task,
    options: TrainOptions,
    run: Path,
    *,
    provenance: Mapping[str, object],
    clock: Callable[[], float] = time.monotonic,
    show: Callable[[str], None] = lambda line: None,
) -> Outcome:
    """Train, or go on from the run's checkpoint where there is one.

    Ctrl-C and SIGTERM finish the step, save, and return `interrupted`.

    Raises:
        FloatingPointError: If a loss or a gradient is not finite; the last checkpoint stays as it was.
        ValueError: If the run's checkpoint was made with other options.
    """
    torch.set_num_threads(options.threads)
    average = deepcopy(network).eval().requires_grad_(False)
    optimiser = torch.optim.AdamW(_parameter_groups(network, options), lr=0.0, betas=(0.9, 0.99))
    about = {"train": asdict(options), "task": task.describe()}
    step, before_s = 0, 0.0
    if (run / CHECKPOINT_NAME).exists():
        step, before_s = _restore(run, network, average, optimiser, about)
    start = clock()

    def elapsed() -> float:
        return before_s + clock() - start

    def progress() -> float:
        return step / options.steps if options.steps else elapsed() / (60 * options.minutes)

    def save() -> None:
        state = Checkpoint(
            step=step,
            elapsed_s=elapsed(),
            network=network.state_dict(),
            average=average.state_dict(),
            optimiser=optimiser_tensors(network, optimiser),
            options={**about, "task": task.describe()},  # the data may have grown
            provenance=provenance,
        )
        save_checkpoint(run / CHECKPOINT_NAME, state)

    network.train()
    saved = elapsed()
    with _log(run, step) as log, _interruptible() as interrupted, _batches(task, step * options.accumulate) as batches:
        while progress() < 1 and not interrupted.is_set():
            rate = learning_rate(progress(), options)
            terms = _step(network, task, optimiser, options, batches, step, rate)
            step += 1
            _follow(average, network, options, step)
            if step % options.log_every == 0 or progress() >= 1:
                log({"step": step, "elapsed_s": round(elapsed(), 3), "rate": rate, **terms})
                show(f"step {step}  {elapsed() / 60:.1f} min  loss {terms['loss']:.4f}")
            if elapsed() - saved >= 60 * options.checkpoint_minutes:
                save()
                figures = task.validate(average)
                log({"step": step, "elapsed_s": round(elapsed(), 3), "held_out": figures})
                show(f"step {step}  held out: " + "  ".join(f"{k} {v:.4g}" for k, v in figures.items()))
                saved = elapsed()
        save()
    state = "done" if progress() >= 1 else "interrupted"
    return Outcome(state=state, network=average, step=step, elapsed_s=elapsed())


def learning_rate(progress: float, options: TrainOptions) -> float:
    """The rate after that share of the schedule: a linear rise, then half a cosine down to 0."""
    if progress < options.warmup:
        return options.learning_rate * max(progress / options.warmup, 1e-3)
    share = min((progress - options.warmup) / (1 - options.warmup), 1.0)
    return options.learning_rate * 0.5 * (1 + math.cos(math.pi * share))


def _step(
    network: nn.Module,
    task: Task,
    optimiser: torch.optim.Optimizer,
    options: TrainOptions,
    batches: Callable[[int], Batch],
    step: int,
    rate: float,
) -> dict[str, float]:
    """One optimiser step; the mean terms of its batches."""
    torch.manual_seed(options.seed * 1_000_003 + step)
    for group in optimiser.param_groups:
        group["lr"] = rate
    optimiser.zero_grad(set_to_none=True)
    sums: dict[str, float] = {}
    names: list[str] = []
    for micro in range(options.accumulate):
        batch = batches(step * options.accumulate + micro)
        names.extend(batch.names)
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=options.precision == "bfloat16"):
            loss, terms = task.loss(network, batch)
        if not torch.isfinite(loss):
            raise FloatingPointError(
                f"step {step}: expected a finite loss, got {loss.item()} on the batch {', '.join(batch.names)}"
            )
        (loss / options.accumulate).backward()
        for name, value in {"loss": loss.detach(), **terms}.items():
            sums[name] = sums.get(name, 0.0) + float(value) / options.accumulate
    norm = float(nn.utils.clip_grad_norm_(network.parameters(), options.clip))
    if not math.isfinite(norm):
        raise FloatingPointError(f"step {step}: expected a finite gradient, got {norm} on the batch {', '.join(names)}")
    optimiser.step()
    return {**sums, "gradient": norm}


def _parameter_groups(network: nn.Module, options: TrainOptions) -> list[dict]:
    """Weights with decay; biases and norms, which have one axis, without."""
    parameters = list(network.parameters())
    return [
        {"params": [p for p in parameters if p.ndim > 1], "weight_decay": options.weight_decay},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]


@torch.no_grad()
def _follow(average: nn.Module, network: nn.Module, options: TrainOptions, step: int) -> None:
    """Move the averaged weights and buffers towards the network's."""
    keep = min(options.average, (1 + step) / (10 + step))
    for mean, value in zip(average.state_dict().values(), network.state_dict().values(), strict=True):
        if mean.is_floating_point():
            mean.lerp_(value, 1 - keep)
        else:
            mean.copy_(value)


def _restore(
    run: Path, network: nn.Module, average: nn.Module, optimiser: torch.optim.Optimizer, about: dict
) -> tuple[int, float]:
    """Put the run's checkpoint into place; its step and seconds."""
    found = load_checkpoint(run / CHECKPOINT_NAME)
    wanted = json.loads(json.dumps(about["train"]))
    had = found.options["train"]
    changed = [
        name
        for name in wanted
        if name not in ("minutes", "threads", "log_every", "checkpoint_minutes") and had.get(name) != wanted[name]
    ]
    if changed:
        raise ValueError(
            f"{run}: expected the options the run began with, got other values of "
            + ", ".join(f"{name} ({had.get(name)} then, {wanted[name]} now)" for name in changed)
        )
    network.load_state_dict(found.network)
    average.load_state_dict(found.average)
    restore_optimiser(network, optimiser, found.optimiser)
    return found.step, found.elapsed_s


@contextmanager
def _log(run: Path, step: int) -> Iterator[Callable[[dict], None]]:
    """A writer of log lines; lines past the resumed step are dropped first, so that the log has no step twice."""
    run.mkdir(parents=True, exist_ok=True)
    path = run / LOG_NAME
    kept = []
    if path.exists():
        kept = [line for line in path.read_text().splitlines() if json.loads(line)["step"] <= step]
    with path.open("w") as file:
        for line in kept:
            file.write(line + "\n")

        def write(entry: dict) -> None:
            file.write(json.dumps(entry) + "\n")
            file.flush()

        yield write


@contextmanager
def _interruptible() -> Iterator[threading.Event]:
    """An event that Ctrl-C or SIGTERM sets; a second Ctrl-C breaks off at once."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def ask(number: int, frame: object) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _batches(task: Task, first: int) -> Iterator[Callable[[int], Batch]]:
    """Batches in order, made two ahead in a thread beside the training."""
    with ThreadPoolExecutor(1) as pool:
        waiting = {index: pool.submit(task.batch, index) for index in (first, first + 1)}

        def take(index: int) -> Batch:
            waiting[index + 2] = pool.submit(task.batch, index + 2)
            return waiting.pop(index).result()

        try:
            yield take
        finally:
            for future in waiting.values():
                future.cancel()
