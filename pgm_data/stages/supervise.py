"""Many jobs, one process each: a job that is killed, hangs or raises is recorded, and the others go on.

On one machine the supervisor starts the processes itself; on a Dask cluster each Dask worker does, through the same
code. Jobs leave their results in files: only the small dict that a stage returns comes back.
"""

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO
from urllib.parse import quote

from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome, check_jobs
from pgm_data.stages.worker import write_json

GRACE_S = 5.0
"""From asking a process to end until it is killed."""

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


def run_jobs(
    jobs: Sequence[Job],
    *,
    state_dir: Path,
    workers: int = 1,
    resume: bool = False,
    timeout_s: float | None = None,
    cluster: str = "",
    on_event: Callable[[JobEvent], None] | None = None,
) -> list[JobOutcome]:
    """What came of each job, in the order of `jobs`, once all have ended.

    `state_dir` gets `jobs.jsonl`, and a log of each job under `logs/`. With `resume`, jobs that stand there as done
    with the same arguments are not run again. `timeout_s` holds for each try of a job. `cluster` is the address of a
    Dask scheduler whose workers see the same files; `workers` then counts for nothing.

    Raises:
        KeyboardInterrupt: after every process has ended; jobs that had ended are remembered.
        OSError: when the state cannot be written, likewise.
    """
    check_jobs(jobs)
    if workers < 1:
        raise ValueError(f"workers: expected 1 or more, got {workers}")
    if timeout_s is not None and not timeout_s > 0:
        raise ValueError(f"timeout_s: expected more than 0, got {timeout_s}")
    tell = on_event or (lambda event: None)
    for folder in ("logs", "jobs"):
        (state_dir / folder).mkdir(parents=True, exist_ok=True)
    log = JobLog(state_dir / "jobs.jsonl")
    before = log.outcomes() if resume else {}
    ended: dict[str, JobOutcome] = {}
    waiting: list[Job] = []
    for job in jobs:
        digest, outcome = before.get(job.name, ("", None))
        if outcome is not None and outcome.state == "done" and digest == job.digest():
            ended[job.name] = replace(outcome, resumed=True)
            tell(JobEvent(name=job.name, kind="skipped"))
        else:
            waiting.append(job)

    def keep(job: Job, outcome: JobOutcome) -> None:
        log.append(job, outcome)
        ended[job.name] = outcome
        tell(JobEvent(name=job.name, kind=outcome.state, message=outcome.reason))

    if waiting and cluster:
        from pgm_data.stages.cluster import run_on_cluster

        run_on_cluster(waiting, address=cluster, state_dir=state_dir, timeout_s=timeout_s, keep=keep, tell=tell)
    elif waiting:
        run_local(waiting, state_dir=state_dir, workers=workers, timeout_s=timeout_s, keep=keep, tell=tell)
    return [ended[job.name] for job in jobs]


def run_local(
    jobs: Sequence[Job],
    *,
    state_dir: Path,
    workers: int,
    timeout_s: float | None,
    keep: Callable[[Job, JobOutcome], None],
    tell: Callable[[JobEvent], None],
    stopped: Callable[[], bool] | None = None,
) -> None:
    """Run jobs in processes of this machine, `workers` at a time, and hand each outcome to `keep` as it comes.

    With `stopped`, which is asked about once a second, the processes are ended as soon as it says so, and the jobs
    that have not ended are not handed on.
    """
    threads = max(1, usable_cores() // workers)
    queue: deque[tuple[Job, int]] = deque((job, 0) for job in jobs)
    running: list[_Running] = []
    selector = selectors.DefaultSelector()
    try:
        while queue or running:
            while queue and len(running) < workers:
                job, attempt = queue.popleft()
                process = _start(job, attempt=attempt, state_dir=state_dir, threads=threads, timeout_s=timeout_s)
                running.append(process)
                selector.register(process.reports, selectors.EVENT_READ, process)
                tell(JobEvent(name=job.name, kind="started"))
            if stopped is not None and stopped():
                return
            wait = min(process.deadline for process in running) - time.monotonic()
            ready = selector.select(timeout=min(max(wait, 0.0), 1.0 if stopped else 60.0))
            over = [key.data for key, _ in ready if not key.data.read_reports(tell)]
            late = [p for p in running if p not in over and time.monotonic() >= p.deadline]
            for process in over + late:
                selector.unregister(process.reports)
                running.remove(process)
                outcome = process.end(late=process in late)
                if outcome.state == "failed" and process.attempt < process.job.retries:
                    tell(JobEvent(name=process.job.name, kind="retried", message=outcome.reason))
                    queue.appendleft((process.job, process.attempt + 1))
                else:
                    keep(process.job, outcome)
    finally:
        _stop(running)
        selector.close()


def usable_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(eq=False, kw_only=True)
class _Running:
    """A process at work on a job."""

    job: Job
    attempt: int
    process: subprocess.Popen[bytes]
    reports: IO[bytes]
    result_path: Path
    log_path: Path
    started: float
    deadline: float
    timeout_s: float | None
    _rest: bytes = b""

    def read_reports(self, tell: Callable[[JobEvent], None]) -> bool:
        """Hand on the reports that have come; False once there will be no more."""
        data = os.read(self.reports.fileno(), 65536)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            detail = json.loads(line)
            done, total = detail.get("progress"), detail.get("total")
            share = done / total if done is not None and total else float("nan")
            tell(JobEvent(name=self.job.name, kind="progress", share=share, detail=detail))
        return bool(data)

    def end(self, *, late: bool) -> JobOutcome:
        """The outcome, once the process is over, or ended because it was `late`."""
        if late:
            _stop([self])
        try:
            self.process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            # It closed its reports and stays: a thread that does not end.
            _stop([self])
        _close(self)
        seconds = time.monotonic() - self.started
        reason, result = (f"took longer than {self.timeout_s:g} s", None) if late else self._read_result()
        self.result_path.unlink(missing_ok=True)
        return JobOutcome(
            name=self.job.name,
            state="done" if result is not None else "failed",
            reason=reason,
            seconds=seconds,
            result=result,
        )

    def _read_result(self) -> tuple[str, dict | None]:
        code = self.process.returncode
        try:
            # A result is written whole, so it counts even if the process then broke while it was ending.
            written = json.loads(self.result_path.read_text(encoding="utf-8"))
            if written["state"] == "done":
                return "", dict(written["result"])
            return str(written["reason"]), None
        except FileNotFoundError:
            how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}, no result"
            return how + _log_tail(self.log_path), None
        except (ValueError, KeyError, TypeError) as error:
            return f"result cannot be read: {error}{_log_tail(self.log_path)}", None


def _start(job: Job, *, attempt: int, state_dir: Path, threads: int, timeout_s: float | None) -> _Running:
    name = quote(job.name, safe=" ")
    job_path = state_dir / "jobs" / f"{name}.json"
    result_path = state_dir / "jobs" / f"{name}.result.json"
    log_path = state_dir / "logs" / f"{name}.log"
    result_path.unlink(missing_ok=True)
    write_json(job_path, {"stage": job.stage, "entry": job.entry, "arguments": dict(job.arguments)})
    environment = {name: str(threads) for name in THREAD_VARIABLES} | dict(os.environ)
    with log_path.open("ab" if attempt else "wb") as log:
        if attempt:
            log.write(f"--- try {attempt + 1}\n".encode())
            log.flush()
        process = subprocess.Popen(
            [sys.executable, "-X", "faulthandler", "-m", "pgm_data.stages.worker", str(job_path), str(result_path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            env=environment,
            # Ctrl-C on the terminal reaches the supervisor alone, which then ends the others.
            start_new_session=True,
        )
    assert process.stdout is not None
    started = time.monotonic()
    return _Running(
        job=job,
        attempt=attempt,
        process=process,
        reports=process.stdout,
        result_path=result_path,
        log_path=log_path,
        started=started,
        deadline=started + (timeout_s if timeout_s is not None else float("inf")),
        timeout_s=timeout_s,
    )


def _stop(running: Sequence[_Running]) -> None:
    """End processes and whatever they started: asked first, killed after `GRACE_S`."""
    for process in running:
        _signal_group(process.process, signal.SIGTERM)
    limit = time.monotonic() + GRACE_S
    for process in running:
        try:
            process.process.wait(max(limit - time.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            _signal_group(process.process, signal.SIGKILL)
            process.process.wait()
        _close(process)


def _signal_group(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    if process.poll() is None:
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            return


def _close(running: _Running) -> None:
    for pipe in (running.process.stdin, running.process.stdout):
        if pipe is not None:
            pipe.close()


def _log_tail(path: Path, lines: int = 5) -> str:
    """The last lines of a log, as the end of a reason."""
    with path.open("rb") as log:
        log.seek(max(0, path.stat().st_size - 4000))
        text = log.read().decode(errors="replace").strip().splitlines()[-lines:]
    return ": " + " | ".join(line.strip() for line in text) if text else ""
