"""The supervisor loses no job: whatever happens to one process is recorded, and the others go on."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest

from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.supervise import THREAD_VARIABLES, run_jobs
from pgm_data.stages.worker import stage_function

STAGES = """
    import json, os, signal, sys, time
    from pathlib import Path

    def double(arguments, report):
        report({"progress": 1, "total": 4})
        print("printed by a library")
        print("said to standard error", file=sys.stderr)
        return {"doubled": 2 * arguments["number"]}

    def fail(arguments, report):
        raise ValueError("no court in sight")

    def die(arguments, report):
        print("last words", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)

    def leave(arguments, report):
        os._exit(7)

    def hang(arguments, report):
        Path(arguments["started"]).write_text(str(os.getpid()))
        time.sleep(600)

    def report_and_hang(arguments, report):
        report({"pid": os.getpid()})
        time.sleep(600)

    def hang_deaf(arguments, report):
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        hang(arguments, report)

    def not_a_number(arguments, report):
        return {"error_px": float("nan")}

    def not_a_dict(arguments, report):
        return [1]

    def fail_once(arguments, report):
        mark = Path(arguments["mark"])
        if not mark.exists():
            mark.touch()
            raise OSError("not yet")
        return {}

    def count(arguments, report):
        with open(arguments["file"], "a") as file:
            file.write("x")
        return {}

    def wait_for(arguments, report):
        Path(arguments["started"] + f".{os.getpid()}").touch()
        while not Path(arguments["go"]).exists():
            time.sleep(0.05)
        return {}

    def environment(arguments, report):
        return dict(os.environ)
"""


@pytest.fixture(autouse=True)
def stages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stages of these tests, where the workers can import them."""
    folder = tmp_path / "modules"
    folder.mkdir()
    (folder / "stages_of_tests.py").write_text(textwrap.dedent(STAGES))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]))
    return folder


def job(function: str, name: str = "", *, retries: int = 0, **arguments: object) -> Job:
    return Job(
        name=name or function, stage="test", entry=f"stages_of_tests:{function}", arguments=arguments, retries=retries
    )


def test_outcomes_come_in_the_order_of_the_jobs_with_what_the_stage_returned(tmp_path: Path) -> None:
    jobs = [job("double", f"match {i}/clip", number=i) for i in range(4)]
    events: list[JobEvent] = []
    outcomes = run_jobs(jobs, state_dir=tmp_path / "state", workers=2, on_event=events.append)
    assert [(o.name, o.state, o.result) for o in outcomes] == [
        (f"match {i}/clip", "done", {"doubled": 2 * i}) for i in range(4)
    ]
    of_one = [event for event in events if event.name == "match 2/clip"]
    assert [event.kind for event in of_one] == ["started", "progress", "done"]
    assert of_one[1].share == 0.25
    logs = [path.read_text() for path in (tmp_path / "state" / "logs").iterdir()]
    assert len(logs) == 4
    assert all("printed by a library" in log and "said to standard error" in log for log in logs)


def test_every_way_to_fail_is_recorded_with_its_reason_and_the_others_go_on(tmp_path: Path) -> None:
    names = ["fail", "die", "leave", "not_a_number", "not_a_dict", "missing"]
    jobs = [*(job(name) for name in names), job("double", number=21)]
    outcomes = run_jobs(jobs, state_dir=tmp_path / "state", workers=4)
    reasons = {outcome.name: outcome.reason for outcome in outcomes if outcome.state == "failed"}
    assert set(reasons) == set(names)
    assert reasons["fail"] == "ValueError: no court in sight"
    assert reasons["die"] == "killed by SIGKILL: last words"
    assert reasons["leave"].startswith("ended with exit code 7, no result")
    assert reasons["not_a_number"].startswith("ValueError:")
    assert reasons["not_a_dict"] == "TypeError: result of stage test: expected a dict, got list"
    assert reasons["missing"].startswith("AttributeError:")
    assert outcomes[-1].result == {"doubled": 42}
    assert 'raise ValueError("no court in sight")' in (tmp_path / "state" / "logs" / "fail.log").read_text()


def test_a_process_that_takes_too_long_is_ended_even_if_it_ignores_being_asked_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pgm_data.stages.supervise.GRACE_S", 0.3)
    started = {name: tmp_path / name for name in ("hang", "hang_deaf")}
    jobs = [*(job(name, started=str(path)) for name, path in started.items()), job("double", number=21)]
    outcomes = run_jobs(jobs, state_dir=tmp_path / "state", workers=3, timeout_s=4.0)
    assert [outcome.reason for outcome in outcomes] == ["took longer than 4 s", "took longer than 4 s", ""]
    assert not any(lives(int(path.read_text())) for path in started.values())


def test_a_result_that_cannot_be_read_is_a_failure(tmp_path: Path, stages: Path) -> None:
    (stages / "stages_of_tests.py").write_text(
        "import os, sys\n"
        "def half(arguments, report):\n"
        "    open(sys.argv[2], 'w').write('{\"state\": \"do')\n"
        "    os._exit(0)\n"
    )
    (outcome,) = run_jobs([job("half")], state_dir=tmp_path / "state")
    assert outcome.state == "failed"
    assert outcome.reason.startswith("result cannot be read:")


def test_resume_skips_what_is_done_and_repeats_what_failed_or_changed(tmp_path: Path) -> None:
    counts = {name: tmp_path / name for name in ("kept", "changed")}
    jobs = [job("count", name, file=str(path)) for name, path in counts.items()]
    run_jobs([*jobs, job("fail", "third")], state_dir=tmp_path / "state")
    jobs[1] = job("count", "changed", file=str(counts["changed"]), more=1)
    events: list[JobEvent] = []
    outcomes = run_jobs(
        [*jobs, job("double", "third", number=1)], state_dir=tmp_path / "state", resume=True, on_event=events.append
    )
    assert [outcome.state for outcome in outcomes] == ["done"] * 3
    assert [outcome.resumed for outcome in outcomes] == [True, False, False]
    assert [event.name for event in events if event.kind == "skipped"] == ["kept"]
    assert counts["kept"].read_text() == "x"
    assert counts["changed"].read_text() == "xx"


def test_without_resume_everything_runs_again(tmp_path: Path) -> None:
    counted = job("count", file=str(tmp_path / "file"))
    for _ in range(2):
        run_jobs([counted], state_dir=tmp_path / "state")
    assert (tmp_path / "file").read_text() == "xx"


def test_a_job_is_tried_again_as_often_as_it_says(tmp_path: Path) -> None:
    events: list[JobEvent] = []
    jobs = [job("fail_once", mark=str(tmp_path / "mark"), retries=1), job("fail", retries=1)]
    outcomes = run_jobs(jobs, state_dir=tmp_path / "state", on_event=events.append)
    assert [outcome.state for outcome in outcomes] == ["done", "failed"]
    assert [(event.name, event.message) for event in events if event.kind == "retried"] == [
        ("fail_once", "OSError: not yet"),
        ("fail", "ValueError: no court in sight"),
    ]
    log = (tmp_path / "state" / "logs" / "fail.log").read_text()
    assert log.count("Traceback") == 2


def test_a_line_torn_by_a_killed_run_is_forgotten_and_any_other_damage_raises(tmp_path: Path) -> None:
    log = JobLog(tmp_path / "jobs.jsonl")
    first, second = job("double", "first", number=1), job("double", "second", number=2)
    done = JobOutcome(name="first", state="done", reason="", seconds=1.0, result={})
    log.append(first, done)
    whole = log.path.read_text()
    log.path.write_text(whole + whole[:-20])
    assert set(log.outcomes()) == {"first"}
    log.append(second, JobOutcome(name="second", state="failed", reason="why", seconds=2.0, result=None))
    states = {name: outcome.state for name, (_, outcome) in log.outcomes().items()}
    assert states == {"first": "done", "second": "failed"}
    log.path.write_text("{}\n" + whole)
    with pytest.raises(ValueError, match="line 1: expected the record of a job"):
        log.outcomes()


def test_workers_share_the_cores_and_keep_what_the_user_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in THREAD_VARIABLES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pgm_data.stages.supervise.usable_cores", lambda: 6)
    monkeypatch.setenv("MKL_NUM_THREADS", "5")
    (outcome,) = run_jobs([job("environment")], state_dir=tmp_path / "state", workers=2)
    assert outcome.result is not None
    assert {name: outcome.result[name] for name in THREAD_VARIABLES} == {
        **dict.fromkeys(THREAD_VARIABLES, "3"),
        "MKL_NUM_THREADS": "5",
    }


@pytest.mark.parametrize("entry", ["os", "os:", ":system", "os:path.join", "os:system('true')", "a b:c"])
def test_an_entry_that_is_not_a_function_of_a_module_is_refused(entry: str) -> None:
    with pytest.raises(ValueError, match="expected 'module:function'"):
        stage_function("test", entry)


def test_a_stage_that_is_not_in_the_table_is_refused() -> None:
    with pytest.raises(ValueError, match="expected one of .*calibrate, .*got 'calibrat'"):
        stage_function("calibrat", "")


@pytest.mark.parametrize(
    ("jobs", "options", "message"),
    [
        ([job("double", "a"), job("fail", "a")], {}, "unique"),
        ([job("double")], {"workers": 0}, "workers: expected 1 or more, got 0"),
        ([job("double")], {"timeout_s": 0.0}, "timeout_s: expected more than 0, got 0"),
        ([job("double", number=float("nan"))], {}, "JSON"),
    ],
)
def test_a_call_that_cannot_work_raises_before_anything_runs(
    tmp_path: Path, jobs: list[Job], options: dict, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        run_jobs(jobs, state_dir=tmp_path / "state", **options)
    assert not (tmp_path / "state").exists()


SUPERVISOR = """
import sys
from pathlib import Path
from pgm_data.stages.jobs import Job
from pgm_data.stages.supervise import run_jobs
folder = Path(sys.argv[1])
jobs = [
    Job(name="first", stage="t", entry="stages_of_tests:count", arguments={"file": str(folder / "counted")}),
    Job(name="second", stage="t", entry="stages_of_tests:hang", arguments={"started": str(folder / "hung")}),
]
try:
    run_jobs(jobs, state_dir=folder / "state")
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_a_supervisor_that_is_stopped_and_the_state_is_kept(
    tmp_path: Path, number: signal.Signals
) -> None:
    supervisor = subprocess.Popen([sys.executable, "-c", SUPERVISOR, str(tmp_path)])
    worker = int(wait_for_text(tmp_path / "hung"))
    supervisor.send_signal(number)
    assert supervisor.wait(20) == (130 if number == signal.SIGINT else -signal.SIGKILL)
    wait_until(lambda: not lives(worker))
    outcomes = JobLog(tmp_path / "state" / "jobs.jsonl").outcomes()
    assert {name: outcome.state for name, (_, outcome) in outcomes.items()} == {"first": "done"}


def test_a_full_disk_stops_the_run_and_every_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: JobLog, job: Job, outcome: JobOutcome) -> None:
        raise OSError(28, "No space left on device", str(self.path))

    hung = tmp_path / "hung"
    waiting = job("wait_for", started=str(tmp_path / "started"), go=str(hung))
    monkeypatch.setattr(JobLog, "append", full)
    with pytest.raises(OSError, match="No space left"):
        run_jobs([waiting, job("hang", started=str(hung))], state_dir=tmp_path / "state", workers=2)
    wait_until(lambda: not lives(int(hung.read_text())))


def test_a_dask_worker_killed_at_work_loses_no_job(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    go, started = tmp_path / "go", tmp_path / "started"
    jobs = [
        job("wait_for", "slow", started=str(started), go=str(go)),
        *(job("double", f"quick {i}", number=i) for i in range(3)),
        job("fail"),
    ]
    events: list[JobEvent] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:

        def kill_the_worker_at_work() -> None:
            first = wait_for_files(started, 1)[0]
            parent = int(Path(f"/proc/{first}/stat").read_text().rpartition(")")[2].split()[1])
            os.kill(parent, signal.SIGKILL)
            # The same job, taken up by another worker.
            wait_for_files(started, 2)
            go.touch()

        killer = threading.Thread(target=kill_the_worker_at_work)
        killer.start()
        outcomes = run_jobs(
            jobs, state_dir=tmp_path / "state", cluster=cluster.scheduler_address, on_event=events.append
        )
        killer.join()
    assert [outcome.state for outcome in outcomes] == ["done"] * 4 + ["failed"]
    assert outcomes[-1].reason == "ValueError: no court in sight"
    assert any(event.kind == "progress" and event.name == "quick 1" and event.share == 0.25 for event in events)
    lines = (tmp_path / "state" / "jobs.jsonl").read_text().splitlines()
    recorded = [json.loads(line)["outcome"]["name"] for line in lines]
    assert sorted(recorded) == sorted(each.name for each in jobs)


@pytest.mark.parametrize("where", ["here", "cluster"])
def test_ctrl_c_ends_the_processes_here_and_on_a_cluster(tmp_path: Path, where: str) -> None:
    pids: list[int] = []

    def press(event: JobEvent) -> None:
        if event.detail is not None:
            pids.append(int(str(event.detail["pid"])))
            raise KeyboardInterrupt

    jobs = [job("report_and_hang"), job("double", "never begun", number=1)]
    with contextlib.ExitStack() as stack:
        address = ""
        if where == "cluster":
            distributed = pytest.importorskip("distributed")
            cluster = distributed.LocalCluster(
                n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50
            )
            address = stack.enter_context(cluster).scheduler_address
        with pytest.raises(KeyboardInterrupt):
            run_jobs(jobs, state_dir=tmp_path / "state", cluster=address, on_event=press)
        wait_until(lambda: not lives(pids[0]))
    assert JobLog(tmp_path / "state" / "jobs.jsonl").outcomes() == {}


def test_no_scheduler_at_the_address_is_an_error_that_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("pgm_data.stages.cluster.CONNECT_S", 0.5)
    with pytest.raises(OSError, match="127.0.0.1:9"):
        run_jobs([job("double", number=1)], state_dir=tmp_path / "state", cluster="tcp://127.0.0.1:9")


def lives(pid: int) -> bool:
    """Whether a process is there and not merely waiting to be collected."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except FileNotFoundError:
        return False


def wait_until(true: object, seconds: float = 60.0) -> None:
    limit = time.monotonic() + seconds
    while not true():  # type: ignore[operator]
        assert time.monotonic() < limit, "did not happen in time"
        time.sleep(0.05)


def wait_for_text(path: Path) -> str:
    wait_until(lambda: path.exists() and path.read_text())
    return path.read_text()


def wait_for_files(stem: Path, number: int) -> list[int]:
    """Process numbers that left a file `stem.NUMBER`, once there are so many."""
    wait_until(lambda: len(list(stem.parent.glob(f"{stem.name}.*"))) >= number)
    found = sorted(stem.parent.glob(f"{stem.name}.*"), key=lambda path: path.stat().st_mtime)
    return [int(path.suffix[1:]) for path in found]
