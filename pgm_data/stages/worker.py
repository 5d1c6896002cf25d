"""The process that carries out one job: `python -m pgm_data.stages.worker JOB.json RESULT.json`.

It reads the job, calls the stage's function, tells its progress in lines of JSON on standard output, and leaves one
file with what came of it. Whatever else the stage prints goes to standard error, which the supervisor keeps as log.
"""

import json
import os
import sys
import threading
import traceback
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TextIO

from pgm_data.dataset.files import whole_file

STAGES: dict[str, tuple[str, str]] = {
    "ball3d": ("pgm_data.stages.ball_clips", "run_job"),
    "calibrate": ("pgm_data.stages.calibrate", "run_job"),
    "players": ("pgm_data.stages.players_clips", "run_job"),
}
"""Module and function of each stage; the function takes the job's arguments and a report of progress."""

StageFunction = Callable[[dict, Callable[[dict], None]], dict]


def stage_function(stage: str, entry: str) -> StageFunction:
    """The function of a stage: from the table, or from `entry` ("module:function") when that is given."""
    if entry:
        module, colon, function = entry.partition(":")
        if not (colon and function.isidentifier() and all(part.isidentifier() for part in module.split("."))):
            raise ValueError(f"job entry: expected 'module:function', got {entry!r}")
    elif stage in STAGES:
        module, function = STAGES[stage]
    else:
        raise ValueError(f"job stage: expected one of {', '.join(STAGES)}, got {stage!r}")
    return getattr(import_module(module), function)


def write_json(path: Path, value: object) -> None:
    """Write a JSON file at once and whole: a reader sees the old file or the new one. NaN is refused."""
    text = json.dumps(value, allow_nan=False)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def end_with_supervisor() -> None:
    """End this process when the supervisor that holds the other end of standard input is gone, however it went."""

    def wait() -> None:
        while os.read(0, 4096):
            pass
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def run_job_file(job_path: Path, result_path: Path, reports: TextIO) -> bool:
    """Carry out the job in `job_path`, write `result_path`; whether it went well."""

    def report(progress: dict) -> None:
        if not isinstance(progress, dict):
            raise TypeError(f"report of progress: expected a dict, got {type(progress).__name__}")
        reports.write(json.dumps(progress) + "\n")
        reports.flush()

    try:
        job = json.loads(job_path.read_text(encoding="utf-8"))
        result = stage_function(job["stage"], job["entry"])(job["arguments"], report)
        if not isinstance(result, dict):
            raise TypeError(f"result of stage {job['stage']}: expected a dict, got {type(result).__name__}")
        write_json(result_path, {"state": "done", "result": result})
        return True
    except Exception as error:
        traceback.print_exc()
        write_json(result_path, {"state": "failed", "reason": f"{type(error).__name__}: {error}"})
        return False


def main(argv: list[str]) -> int:
    """Carry out the job named on the command line; the exit code."""
    if len(argv) != 2:
        print("usage: python -m pgm_data.stages.worker JOB.json RESULT.json", file=sys.stderr)
        return 2
    # Libraries print to descriptor 1 as they like; the reports keep a descriptor of their own.
    reports = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    if not sys.stdin.isatty():
        end_with_supervisor()
    return 0 if run_job_file(Path(argv[0]), Path(argv[1]), reports) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
