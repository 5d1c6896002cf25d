"""Time and memory of `pgm simulate`, as whole processes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# Runs in a process of its own: the largest memory of it and of its workers, and the processor time of all.
_MEASURED = """
import json, resource, sys
from pgm_cli.main import run
code = run(sys.argv[1:])
own, below = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
unit = 1 if sys.platform == "darwin" else 1024
peak = own.ru_maxrss
if sys.platform == "linux":  # Where a new program counts the memory of the one that started it as its own.
    with open("/proc/self/status") as status:
        peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
print("MEASURED", json.dumps({
    "code": code,
    "cpu_s": own.ru_utime + own.ru_stime + below.ru_utime + below.ru_stime,
    "memory_mb": max(peak, below.ru_maxrss) * unit / 1e6,
}))
"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """One run of the command."""

    what: str
    frames: int
    seconds: float
    """Wall time, start of Python and imports included."""
    cpu_s: float
    memory_mb: float
    """Of the largest process."""
    load: float
    """The machine's load average before it."""

    @property
    def frames_per_second(self) -> float:
        """Frames over wall time."""
        return self.frames / self.seconds


def timed_simulate(what: str, arguments: Sequence[str], frames: int, out: Path) -> Run:
    """`pgm simulate ARGUMENTS --out OUT`, measured.

    Raises:
        RuntimeError: If the command fails.
    """
    load = os.getloadavg()[0]
    begun = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _MEASURED, "simulate", "--out", str(out), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - begun
    told = [line for line in done.stdout.splitlines() if line.startswith("MEASURED ")]
    values = json.loads(told[-1].removeprefix("MEASURED ")) if told else {"code": done.returncode}
    if values["code"] != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"pgm simulate {' '.join(arguments)}: expected exit 0, got {values['code']}: {last}")
    return Run(
        what=what,
        frames=frames,
        seconds=seconds,
        cpu_s=values["cpu_s"],
        memory_mb=values["memory_mb"],
        load=load,
    )
