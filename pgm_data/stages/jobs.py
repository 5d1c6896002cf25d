"""Jobs of a stage, what came of each, and the file that remembers it across runs."""

import hashlib
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True, eq=False, kw_only=True)
class Job:
    """One call of a stage, to be made in a process of its own."""

    name: str
    """Unique among the jobs of a run."""
    stage: str
    """Name in the table of stages."""
    arguments: Mapping[str, object]
    """What the stage's function gets; JSON values."""
    entry: str = ""
    """"module:function" to call instead of the table's; empty for the table's."""
    retries: int = 0
    """How often it is tried again after it failed."""

    def digest(self) -> str:
        """Name of this call: equal where stage and arguments are."""
        call = json.dumps([self.stage, self.entry, dict(self.arguments)], sort_keys=True, allow_nan=False)
        return hashlib.sha256(call.encode()).hexdigest()[:24]


@dataclass(frozen=True, eq=False, kw_only=True)
class JobOutcome:
    """What came of a job."""

    name: str
    state: Literal["done", "failed"]
    reason: str
    """Why it failed; empty when it is done."""
    seconds: float
    """Wall-clock time of the last try, in the run that made it."""
    result: dict | None
    """What the stage's function returned; None when it failed."""
    resumed: bool = False
    """Whether an earlier run did it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JobEvent:
    """Something that happened to a job, told while the others go on."""

    name: str
    kind: Literal["started", "progress", "retried", "done", "failed", "skipped"]
    """`skipped`: an earlier run did it."""
    share: float = 0.0
    """Of a progress: how much is done, 0 to 1; NaN when the stage did not say."""
    detail: Mapping[str, object] | None = None
    """Of a progress: all that the stage reported."""
    message: str = ""
    """Of a failure or a retry: why."""


def check_jobs(jobs: Sequence[Job]) -> None:
    """Raise ValueError unless names are unique and arguments are JSON."""
    seen: set[str] = set()
    for job in jobs:
        if not job.name or job.name in seen:
            raise ValueError(f"job name: expected unique and not empty, got {job.name!r} twice or empty")
        seen.add(job.name)
        job.digest()


class JobLog:
    """`jobs.jsonl`: one line for every try of a job that ended, each on the disk before the next job counts as done."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def outcomes(self) -> dict[str, tuple[str, JobOutcome]]:
        """Digest and outcome of the last try of each job, by name."""
        try:
            lines = self.path.read_text(encoding="utf-8").split("\n")
        except FileNotFoundError:
            return {}
        last: dict[str, tuple[str, JobOutcome]] = {}
        # A run that was killed while writing leaves a last line without its end; that job counts as not done.
        for number, line in enumerate(lines[:-1], start=1):
            if not line:
                continue
            try:
                record = json.loads(line)
                outcome = JobOutcome(**record["outcome"])
                last[outcome.name] = (record["digest"], outcome)
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(
                    f"{self.path}, line {number}: expected the record of a job, got {line[:80]!r}"
                ) from error
        return last

    def append(self, job: Job, outcome: JobOutcome) -> None:
        """Remember what came of a job, on the disk when this returns."""
        record = {"digest": job.digest(), "ended": time.time(), "outcome": asdict(outcome)}
        line = json.dumps(record, allow_nan=False) + "\n"
        self._drop_torn_line()
        descriptor = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            data = line.encode()
            if os.write(descriptor, data) != len(data):
                raise OSError(28, "no space left on device", str(self.path))
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def _drop_torn_line(self) -> None:
        if not self.path.exists():
            return
        data = self.path.read_bytes()
        if data and not data.endswith(b"\n"):
            os.truncate(self.path, data.rfind(b"\n") + 1)
