"""Jobs on a Dask cluster: a Dask worker starts the same process for a job that the local supervisor would."""

import queue
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from pgm_data.stages.jobs import Job, JobEvent, JobOutcome
from pgm_data.stages.supervise import run_local

if TYPE_CHECKING:
    from distributed import Future

CONNECT_S = 30.0
"""How long to look for the scheduler."""


def run_on_cluster(
    jobs: Sequence[Job],
    *,
    address: str,
    state_dir: Path,
    timeout_s: float | None,
    keep: Callable[[Job, JobOutcome], None],
    tell: Callable[[JobEvent], None],
) -> None:
    """Run jobs on the cluster at `address` and hand each outcome to `keep` as it comes.

    A Dask worker that dies loses only what it was doing: the scheduler gives that job to another one, as often as its
    setting `allowed-failures` says, and then the job counts as failed.

    Raises:
        ModuleNotFoundError: without the extra `dask`.
        OSError: when no scheduler answers at `address`.
    """
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("a cluster needs the extra dask: pip install 'pgm[dask]'") from error

    by_name = {job.name: job for job in jobs}
    state = state_dir.resolve()
    # Dask cannot interrupt what its workers do: they look for this file instead.
    stop = state / "stop"
    stop.unlink(missing_ok=True)
    client = Client(address, timeout=CONNECT_S, set_as_default=False)
    news: queue.SimpleQueue[JobEvent | str] = queue.SimpleQueue()
    futures: dict[str, Future] = {}
    try:
        topic = f"pgm-jobs-{client.id}"
        client.subscribe_topic(topic, lambda stamped: news.put(JobEvent(**stamped[1]["event"])))
        for job in jobs:
            future = client.submit(
                _run_on_worker, job, str(state), timeout_s, topic, key=f"{job.name}-{client.id}", pure=False
            )
            future.add_done_callback(lambda _, name=job.name: news.put(name))
            futures[job.name] = future
        left = set(by_name)
        while left:
            new = news.get()
            if isinstance(new, str):
                left.remove(new)
                keep(by_name[new], _outcome(new, futures[new]))
            else:
                tell(new)
    except BaseException:
        stop.touch()
        client.cancel(list(futures.values()), force=True)
        raise
    finally:
        client.close()


def _run_on_worker(job: Job, state_dir: str, timeout_s: float | None, topic: str) -> dict:
    """Carry out one job on the machine of a Dask worker; the outcome's fields."""
    from distributed import get_worker

    worker = get_worker()
    outcomes: list[JobOutcome] = []
    stop = Path(state_dir) / "stop"
    run_local(
        [job],
        state_dir=Path(state_dir),
        workers=1,
        timeout_s=timeout_s,
        keep=lambda _, outcome: outcomes.append(outcome),
        tell=lambda event: worker.log_event(topic, {"event": asdict(event)}),
        stopped=stop.exists,
    )
    if not outcomes:
        raise InterruptedError("stopped")
    return asdict(outcomes[0])


def _outcome(name: str, future: "Future") -> JobOutcome:
    """What came of a future that has ended."""
    if future.status == "finished":
        return JobOutcome(**future.result())
    error = future.exception() if future.status == "error" else None
    reason = f"{type(error).__name__}: {error}" if error is not None else f"the cluster lost it ({future.status})"
    return JobOutcome(name=name, state="failed", reason=reason, seconds=0.0, result=None)
