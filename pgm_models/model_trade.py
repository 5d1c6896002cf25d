"""What the trades of trained models share: trainings as jobs, and their parts one after the other."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pgm_data.provenance import commit, machine
from pgm_data.stages.jobs import Job, JobEvent
from pgm_data.stages.trade_run import TradeManner, TradeRun, run_parts
from pgm_models.train import Outcome

TIMEOUT_S = 7 * 86400.0
"""Of one job."""


def trade_manner(state_dir: Path, *, workers: int, resume: bool) -> TradeManner:
    """So many jobs at a time, but one at a time in the last part, as its times count."""
    return TradeManner(state_dir=state_dir, workers=workers, resume=resume, timeout_s=TIMEOUT_S, last_alone=True)


def run_model_trade(
    parts: Sequence[Sequence[Job]],
    *,
    manner: TradeManner,
    write: Callable[[list[dict]], str],
    on_event: Callable[[JobEvent], None],
    on_jobs: Callable[[int], None],
    known: Sequence[dict] = (),
) -> TradeRun:
    """Carry out trainings and evaluations as `run_parts` does; what it scored are the evaluations.

    Rows that are `known` are written before those of the jobs, unless a job makes them anew.
    """
    evaluated = 0

    def written(rows: list[dict]) -> str:
        nonlocal evaluated
        new = {(row["kind"], row["name"]) for row in rows}
        rows = [*(row for row in known if (row["kind"], row["name"]) not in new), *rows]
        evaluated = sum(row["kind"] == "evaluation" for row in rows)
        return write(rows)

    if not any(parts):
        return TradeRun(table=written([]), failed=(), scored=evaluated)
    run = run_parts(parts, manner=manner, write=written, on_event=on_event, on_jobs=on_jobs)
    return replace(run, scored=evaluated)


def trained(
    name: str,
    train: Callable[[Callable[[str], None]], Outcome],
    total: int,
    report: Callable[[dict], None],
    *,
    conditions: Mapping[str, object] | None = None,
) -> dict:
    """Carry out a training as a job; one row of figures.

    Args:
        name: Of the model.
        train: Trains, and says in lines how far it is.
        total: Optimiser steps in all; 0 where time ends it.
        report: Told of progress.
        conditions: What its figures depend on besides its name, where other trades are to know them.

    Raises:
        InterruptedError: If it was asked to stop; what it had learned is kept.
    """

    def show(line: str) -> None:
        found = re.match(r"step (\d+)", line)
        if found:
            report({"progress": int(found[1]), "total": total} if total else {"done": int(found[1])})

    outcome = train(show)
    if outcome.state != "done":
        raise InterruptedError(f"interrupted after step {outcome.step}" + (f" of {total}" if total else ""))
    row = {
        "kind": "training",
        "name": name,
        "steps": outcome.step,
        "seconds": outcome.elapsed_s,
        "weights": sum(parameter.numel() for parameter in outcome.network.parameters()),
        "device": str(next(outcome.network.parameters()).device),
    }
    return {"rows": [row if conditions is None else {**row, **made_by(conditions)}]}


def made_by(conditions: Mapping[str, object]) -> dict[str, object]:
    """What a row says of how it was made, so that other trades may take it as known."""
    where = machine()
    return {
        "conditions": dict(conditions),
        "commit": commit(),
        "machine": f"{where['processor']}, {where['cores']} cores",
    }


def known_rows(paths: Sequence[Path], conditions: Mapping[str, object]) -> list[dict]:
    """Rows that other trades left, on this machine or another; of several with one name the last.

    Args:
        paths: Their `rows.jsonl`.
        conditions: What the rows must have been made under.

    Raises:
        ValueError: If a line is no such row, or was made under other conditions; names file, line and field.
    """
    found: dict[tuple[str, str], dict] = {}
    for path in paths:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                row = json.loads(line)
                kind, name, had = row["kind"], row["name"], row["conditions"]
                if kind == "evaluation" and "result" not in row:
                    raise KeyError("result")
                for field, value in conditions.items():
                    if had[field] != value:
                        raise ValueError(f"{path}, line {number}: {field}: expected {value}, got {had[field]}")
            except (json.JSONDecodeError, KeyError, TypeError) as error:
                raise ValueError(
                    f"{path}, line {number}: expected a row of a trade, with kind, name and conditions, "
                    f"got {line[:80]!r} ({error!r})"
                ) from error
            found[kind, name] = row
    return list(found.values())


def training_command(kind: str, arguments: Mapping, options: Sequence[str]) -> list[str]:
    """The command that trains the same model: those of the job's arguments that are options and not the default."""
    said = ["pgm-train", kind, arguments["dataset"], "--out", arguments["run"]]
    for name in options:
        if arguments[name] not in ("", 0) or name == "seed":
            said += [f"--{name.replace('_', '-')}", str(arguments[name])]
    return said
