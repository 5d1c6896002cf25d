"""The training loop of every model: AdamW, warm-up and cosine, clipping, averaged weights, exact resume.

A schedule counts steps, or minutes of training: then the rate follows the clock and is fully annealed when the
time is up, however busy the machine was. A batch is a pure function of its number, so that a resumed run sees what
an unbroken one would have seen, and processes that `torchrun` started together see what one would have seen alone:
each takes its share of a step's batches.
"""

import json
import math
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, Literal

import torch
import torch.distributed
import torch.optim.swa_utils
import torch.utils.data
from torch import Tensor, nn

from pgm_models.checkpoint import (
    CHECKPOINT_NAME,
    Checkpoint,
    load_checkpoint,
    optimiser_tensors,
    restore_optimiser,
    save_checkpoint,
)
from pgm_models.processes import Processes, device_of, joined

CHANGEABLE = ("minutes", "threads", "log_every", "checkpoint_minutes", "device", "workers", "precision")
"""Options that another part of a run may have otherwise."""
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
    device: str = "cpu"
    """`cpu`, `cuda`, `cuda:N`, or `auto` for a GPU where there is one."""
    workers: int = 0
    """Processes that make batches; 0 for a thread beside the training."""

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

    def to(self, device: torch.device) -> "Batch":
        """The same batch on another device."""
        return replace(self, tensors={k: v.to(device, non_blocking=True) for k, v in self.tensors.items()})


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

    def look(self, network: nn.Module, run: Path, step: int) -> None:
        """Write pictures of how far it is into the run; none unless a task says so."""
        return


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
    device = device_of(options.device)
    with joined(device) as processes:
        if options.accumulate % processes.count:
            raise ValueError(
                f"accumulate: expected a multiple of the {processes.count} processes, got {options.accumulate}"
            )
        return _train(network.to(device), task, options, run, _Edges(provenance, clock, show, device, processes))


@dataclass(frozen=True, eq=False)
class _Edges:
    """What a training touches outside itself."""

    provenance: Mapping[str, object]
    clock: Callable[[], float]
    show: Callable[[str], None]
    device: torch.device
    processes: Processes


def _train(network: nn.Module, task: Task, options: TrainOptions, run: Path, edges: _Edges) -> Outcome:
    """The training of one process."""
    processes, show = edges.processes, edges.show
    average = deepcopy(network).eval().requires_grad_(False)
    optimiser = torch.optim.AdamW(_parameter_groups(network, options), lr=0.0, betas=(0.9, 0.99), fused=True)
    about = {"train": asdict(options), "task": task.describe()}
    step, before_s = 0, 0.0
    if (run / CHECKPOINT_NAME).exists():
        step, before_s = _restore(run, network, average, optimiser, about)
    follow = _follower(network, average)
    start = edges.clock()

    def elapsed() -> float:
        return before_s + edges.clock() - start

    def progress() -> float:
        return step / options.steps if options.steps else elapsed() / (60 * options.minutes)

    def save() -> None:
        if not processes.leads:
            return
        state = Checkpoint(
            step=step,
            elapsed_s=elapsed(),
            network=network.state_dict(),
            average=average.state_dict(),
            optimiser=optimiser_tensors(network, optimiser),
            options={**about, "task": task.describe()},  # the data may have grown
            provenance=edges.provenance,
        )
        save_checkpoint(run / CHECKPOINT_NAME, state)

    network.train()
    saved = elapsed()
    micros = range(processes.rank, options.accumulate, processes.count)
    writing = _log(run, step) if processes.leads else nullcontext(lambda entry: None)
    with (
        writing as log,
        _interruptible() as interrupted,
        _batches(task, options, step, micros) as batches,
    ):
        done, stopped = progress() >= 1, False
        while not done and not stopped:
            rate = learning_rate(progress(), options)
            terms = _step(
                network, optimiser, options, [next(batches) for _ in micros], _StepOf(task, step, rate, edges)
            )
            step += 1
            follow(min(options.average, (1 + step) / (10 + step)))
            due = elapsed() - saved >= 60 * options.checkpoint_minutes
            done, stopped, due = _agreed(processes, progress() >= 1, interrupted.is_set(), due)
            if processes.leads and (step % options.log_every == 0 or done):
                log({"step": step, "elapsed_s": round(elapsed(), 3), "rate": rate, **terms})
                show(f"step {step}  {elapsed() / 60:.1f} min  loss {terms['loss']:.4f}")
            if due and processes.leads:
                save()
                figures = task.validate(average)
                log({"step": step, "elapsed_s": round(elapsed(), 3), "held_out": figures})
                show(f"step {step}  held out: " + "  ".join(f"{k} {v:.4g}" for k, v in figures.items()))
                task.look(average, run, step)
            if due:
                processes.wait()
                saved = elapsed()
        save()
        processes.wait()
    return Outcome(state="done" if done else "interrupted", network=average, step=step, elapsed_s=elapsed())


def _agreed(processes: Processes, *flags: bool) -> tuple[bool, ...]:
    """Each flag, raised for all processes where one of them raises it."""
    if processes.count == 1:
        return flags
    votes = torch.tensor([float(flag) for flag in flags])
    if torch.distributed.get_backend() == "nccl":
        votes = votes.cuda()
    processes.add([votes])
    return tuple(bool(vote > 0) for vote in votes)


def learning_rate(progress: float, options: TrainOptions) -> float:
    """The rate after that share of the schedule: a linear rise, then half a cosine down to 0."""
    if progress < options.warmup:
        return options.learning_rate * max(progress / options.warmup, 1e-3)
    share = min((progress - options.warmup) / (1 - options.warmup), 1.0)
    return options.learning_rate * 0.5 * (1 + math.cos(math.pi * share))


@dataclass(frozen=True, eq=False)
class _StepOf:
    """Which step of what."""

    task: Task
    step: int
    rate: float
    edges: _Edges


def _step(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    options: TrainOptions,
    batches: list[tuple[int, Batch]],
    of: _StepOf,
) -> dict[str, float]:
    """One optimiser step; the mean terms of its batches."""
    device, processes = of.edges.device, of.edges.processes
    for group in optimiser.param_groups:
        group["lr"] = of.rate
    optimiser.zero_grad(set_to_none=True)
    terms: list[dict[str, Tensor]] = []
    for number, batch in batches:
        torch.manual_seed(options.seed * 1_000_003 + number)
        with torch.autocast(device.type, dtype=torch.bfloat16, enabled=options.precision == "bfloat16"):
            loss, parts = of.task.loss(network, batch.to(device))
        terms.append({"loss": loss.detach(), **parts})
        (loss / options.accumulate).backward()
    losses = torch.stack([part["loss"].float() for part in terms])
    sums = {name: torch.stack([part[name].float() for part in terms]).sum() / options.accumulate for name in terms[0]}
    if processes.count > 1:
        means = torch.stack(list(sums.values()))
        gradients = [p.grad if p.grad is not None else torch.zeros_like(p) for p in network.parameters()]
        for parameter, gradient in zip(network.parameters(), gradients, strict=True):
            parameter.grad = gradient
        processes.add([*gradients, means])
        sums = dict(zip(sums, means, strict=True))
    norm = nn.utils.clip_grad_norm_(network.parameters(), options.clip)
    # One transfer from the device for all that must be looked at.
    told = torch.cat([losses, torch.stack([norm.float(), *sums.values()])]).tolist()
    where = f"step {of.step}: expected a finite"
    for loss, (_, batch) in zip(told[: len(batches)], batches, strict=True):
        if not math.isfinite(loss):
            raise FloatingPointError(f"{where} loss, got {loss} on the batch {', '.join(batch.names)}")
    values = dict(zip(["gradient", *sums], told[len(batches) :], strict=True))
    if not math.isfinite(values["gradient"]):
        names = ", ".join(name for _, batch in batches for name in batch.names)
        raise FloatingPointError(f"{where} gradient, got {values['gradient']} on the batch {names}")
    optimiser.step()
    return {**{name: values[name] for name in sums}, "gradient": values["gradient"]}


def _parameter_groups(network: nn.Module, options: TrainOptions) -> list[dict]:
    """Weights with decay; biases and norms, which have one axis, without."""
    parameters = list(network.parameters())
    return [
        {"params": [p for p in parameters if p.ndim > 1], "weight_decay": options.weight_decay},
        {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
    ]


def _follower(network: nn.Module, average: nn.Module) -> Callable[[float], None]:
    """What moves the averaged weights and buffers towards the network's, of which it keeps the given share."""
    means, values = average.state_dict(), network.state_dict()
    moving = [name for name, value in values.items() if value.is_floating_point()]
    fixed = [name for name in values if name not in moving]
    lerp = torch.optim.swa_utils.get_ema_multi_avg_fn

    def follow(keep: float) -> None:
        lerp(keep)([means[name] for name in moving], [values[name] for name in moving], None)
        for name in fixed:
            means[name].copy_(values[name])

    return follow


def _restore(
    run: Path, network: nn.Module, average: nn.Module, optimiser: torch.optim.Optimizer, about: dict
) -> tuple[int, float]:
    """Put the run's checkpoint into place; its step and seconds."""
    found = load_checkpoint(run / CHECKPOINT_NAME)
    wanted = json.loads(json.dumps(about["train"]))
    had = found.options["train"]
    changed = [name for name in wanted if name not in CHANGEABLE and had.get(name) != wanted[name]]
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
def _batches(task: Task, options: TrainOptions, step: int, micros: range) -> Iterator[Iterator[tuple[int, Batch]]]:
    """Numbers and batches of this process in order, from that step on: made ahead by a thread or by processes."""
    if options.workers:
        loader = torch.utils.data.DataLoader(
            _Numbered(task),
            batch_size=None,
            sampler=_Numbers(step, options.accumulate, micros),
            num_workers=options.workers,
            collate_fn=_as_made,
            pin_memory=options.device != "cpu" and torch.cuda.is_available(),
        )
        yield iter(loader)
        return
    with ThreadPoolExecutor(1) as pool:
        numbers = iter(_Numbers(step, options.accumulate, micros))
        waiting = [(number, pool.submit(task.batch, number)) for number in (next(numbers), next(numbers))]

        def made() -> Iterator[tuple[int, Batch]]:
            while True:
                number, future = waiting.pop(0)
                following = next(numbers)
                waiting.append((following, pool.submit(task.batch, following)))
                yield number, future.result()

        try:
            yield made()
        finally:
            for _, future in waiting:
                future.cancel()


def _as_made(numbered: Any) -> Any:
    """A loader's batch, left as the task made it."""
    return numbered


@dataclass(frozen=True)
class _Numbers:
    """Numbers of a process's batches, without end."""

    step: int
    accumulate: int
    micros: range

    def __iter__(self) -> Iterator[int]:
        for step in count(self.step):
            yield from (step * self.accumulate + micro for micro in self.micros)


class _Numbered(torch.utils.data.Dataset):
    """A task's batches by number, for loaders in other processes."""

    def __init__(self, task: Task) -> None:
        self.task = task

    def __getitem__(self, number: int) -> tuple[int, Batch]:
        torch.set_num_threads(1)
        return number, self.task.batch(number)
