"""A trade's jobs carried out part after part, its figures written anew after each and when it is interrupted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pgm_data.dataset.files import whole_file
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.supervise import run_jobs


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeRun:
    """What a trade comes to."""

    table: str
    """All tables in Markdown."""
    failed: tuple[JobOutcome, ...]
    """Jobs that came to nothing."""
    scored: int
    """Rows of figures."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TradeManner:
    """How the jobs are carried out; no figure but times depends on it."""

    state_dir: Path
    """Folder of the jobs' state and of temporary files."""
    workers: int
    resume: bool
    timeout_s: float
    """Of one job."""
    last_alone: bool = False
    """Whether the jobs of the last part run one at a time."""


def run_parts(
    parts: Sequence[Sequence[Job]],
    *,
    manner: TradeManner,
    write: Callable[[list[dict]], str],
    on_event: Callable[[JobEvent], None],
    on_jobs: Callable[[int], None],
) -> TradeRun:
    """Carry out the jobs of each part.

    Args:
        parts: Jobs, part by part; a part without any is passed over.
        manner: How.
        write: Writes the figures of all rows so far; gives all tables in Markdown.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part.
    """
    outcomes: list[JobOutcome] = []
    table = ""
    for place, jobs in enumerate(parts):
        alone = manner.last_alone and place == len(parts) - 1
        if not jobs:
            continue
        on_jobs(len(jobs))
        try:
            outcomes += run_jobs(
                jobs,
                state_dir=manner.state_dir,
                workers=1 if alone else manner.workers,
                resume=manner.resume,
                timeout_s=manner.timeout_s,
                on_event=on_event,
            )
        except KeyboardInterrupt:
            outcomes += ended_jobs(jobs, JobLog(manner.state_dir / "jobs.jsonl"))
            write(rows_of(outcomes))
            raise
        table = write(rows_of(outcomes))
    failed = tuple(outcome for outcome in outcomes if outcome.state == "failed")
    return TradeRun(table=table, failed=failed, scored=len(rows_of(outcomes)))


def ended_jobs(jobs: Sequence[Job], log: JobLog) -> list[JobOutcome]:
    """What came of those of the jobs that have ended."""
    logged = log.outcomes()
    found = [(job, *logged[job.name]) for job in jobs if job.name in logged]
    return [outcome for job, digest, outcome in found if digest == job.digest()]


def rows_of(outcomes: Sequence[JobOutcome]) -> list[dict]:
    """The rows of all jobs that came to something."""
    return [row for outcome in outcomes if outcome.result is not None for row in outcome.result["rows"]]


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
