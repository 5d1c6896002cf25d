"""What the trades that run jobs share: their progress, and what is told of them at the end."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from .clip_command import ONE_THREAD
from .console import Progress, option_error, print_error
from .output import OutputFolder, prepare_output

if TYPE_CHECKING:
    from pgm_data.stages.jobs import JobEvent, JobOutcome

SOME_INPUTS_FAILED, NOTHING_USABLE = 3, 4
FAILURES_SHOWN = 20


class TradeCommand(Protocol):
    """Options that all of them have."""

    @property
    def out(self) -> Path:
        """Folder to write into."""
        ...

    @property
    def resume(self) -> bool:
        """Go on."""
        ...

    @property
    def overwrite(self) -> bool:
        """Begin again."""
        ...


class TradeOutcome(Protocol):
    """What a trade comes to."""

    @property
    def table(self) -> str:
        """All tables in Markdown."""
        ...

    @property
    def failed(self) -> "Sequence[JobOutcome]":
        """Jobs that came to nothing."""
        ...

    @property
    def scored(self) -> int:
        """Rows of figures."""
        ...


def check_chosen(option: str, chosen: Sequence[str], known: Sequence[str]) -> None:
    """Refuse names that are not known, or none.

    Raises:
        UsageError: If there are such.
    """
    if not chosen or not set(chosen) <= set(known):
        raise option_error(option, expected=f"some of {', '.join(known)}", got=" ".join(chosen) or "none")


def check_parts(parts: Sequence[str]) -> None:
    """Refuse parts that are asked for twice, or none.

    Raises:
        UsageError: If it is so.
    """
    if not parts or len(set(parts)) < len(parts):
        raise option_error("--parts", expected="parts, each once", got=" ".join(parts) or "none")


def check_packed(option: str, dataset: Path | None) -> None:
    """Refuse what is no packed dataset, where one is given.

    Raises:
        UsageError: If it is none.
    """
    if dataset is not None and not (dataset / "meta" / "info.json").is_file():
        raise option_error(option, expected="a packed dataset, with meta/info.json", got=dataset)


def threads_of(threads: int, jobs: int) -> int:
    """CPU threads of each job: the usable cores shared out where none are given."""
    from pgm_data.stages.supervise import usable_cores

    return threads or max(1, usable_cores() // jobs)


class JobProgress:
    """Progress over the parts of a run."""

    def __init__(self) -> None:
        self._progress = Progress(total=0, unit="job")

    def begin(self, total: int) -> None:
        """Another part of so many jobs begins."""
        self._progress.close()
        self._progress = Progress(total=total, unit="job")

    def tell(self, event: "JobEvent") -> None:
        """Something happened to a job."""
        if event.kind == "progress":
            self._progress.update(event.name, event.share)
        elif event.kind in ("done", "skipped"):
            self._progress.finish(event.name)
        elif event.kind == "failed":
            self._progress.finish(event.name, f"{event.name}: {event.message}")

    def close(self) -> None:
        """Take the bar away."""
        self._progress.close()


def failed_inputs(failed: Sequence["JobOutcome"]) -> list[dict]:
    """Jobs that came to nothing, as the run's document names them."""
    return [
        {"path": job.name, "state": "failed", "reason": job.reason, "clips": [], "seconds": job.seconds}
        for job in failed
    ]


def carried_out(stage: str, options: TradeCommand, run: "Callable[[OutputFolder, JobProgress], TradeOutcome]") -> int:
    """Run a trade into its folder, with progress, and write the run's document; the exit code.

    Args:
        stage: What is traded.
        options: As given, for the document.
        run: The trade itself.
    """
    from datetime import UTC, datetime

    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import run_document

    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    started = datetime.now(UTC)
    with prepare_output(options.out, resume=options.resume, overwrite=options.overwrite) as folder:
        progress = JobProgress()
        try:
            outcome = run(folder, progress)
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
        finally:
            progress.close()
        inputs = failed_inputs(outcome.failed)
        document = run_document(command=f"pgm trade {stage}", options=options, started=started, inputs=inputs)
        write_document(options.out / "run.json", "run", document)
    return told(outcome.table, outcome.failed, outcome.scored, options.out)


def told(table: str, failed: Sequence["JobOutcome"], scored: int, out: Path) -> int:
    """Print the tables and what failed; the exit code."""
    print(table)
    print(f"\nwrote {out / 'trade.md'}, {out / 'trade.svg'}, {out / 'trade.json'}")
    for job in failed[:FAILURES_SHOWN]:
        print_error(f"{job.name}: {job.reason}")
    if len(failed) > FAILURES_SHOWN:
        print_error(f"and {len(failed) - FAILURES_SHOWN} more failed, see rows.jsonl")
    if not scored:
        return NOTHING_USABLE
    return SOME_INPUTS_FAILED if failed else 0
