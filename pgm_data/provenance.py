"""Which program, on which machine, made a result: the facts that `run.json` keeps."""

import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PurePath

import numpy as np

from pgm_data import __version__

PACKAGES = (
    "av",
    "casadi",
    "jsonschema",
    "numba",
    "numpy",
    "onnxruntime",
    "opencv-contrib-python-headless",
    "pandas",
    "pyarrow",
    "pycolmap",
    "safetensors",
    "scipy",
    "torch",
    "tyro",
)
"""Distributions that a result may depend on."""


def installed_version(distribution: str) -> str:
    """Version of an installed distribution, read without importing it; empty when it is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def versions(distributions: Sequence[str] = PACKAGES) -> dict[str, str]:
    """Versions of pgm, Python and those of the named distributions that are installed."""
    found = {name: installed_version(name) for name in distributions}
    return {"pgm": __version__, "python": platform.python_version()} | {k: v for k, v in found.items() if v}


def commit(source: Path | None = None) -> str:
    """Commit of the checkout that pgm runs from, `+changes` added when files differ; empty outside a checkout."""
    root = source or Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return ""
    head = _git(root, "rev-parse", "HEAD")
    return f"{head}+changes" if head and _git(root, "status", "--porcelain", "--untracked-files=no") else head


def _git(root: Path, *arguments: str) -> str:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=20, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def machine() -> dict[str, str | int]:
    """System, processor, usable cores and memory (bytes) of this machine."""
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def run_document(
    *, command: str, options: object, started: datetime, inputs: Sequence[Mapping[str, object]] = ()
) -> dict[str, object]:
    """The document `run.json` of a command that began at `started` (with its time zone) and has just ended.

    `inputs` hold path, state, reason, clips and seconds of each input.
    """
    return {
        "command": command,
        "options": plain(options),
        "versions": versions(),
        "commit": commit(),
        "started": started.astimezone(UTC).isoformat(timespec="seconds"),
        "seconds": (datetime.now(UTC) - started).total_seconds(),
        "machine": machine(),
        "inputs": plain(list(inputs)),
    }


def plain(value: object) -> object:
    """The value in JSON's types: dataclasses and mappings as objects, arrays as lists, paths as text.

    Raises:
        TypeError: for a type that has no such form.
        ValueError: for NaN or infinity, which JSON has not.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(plain(item) for item in value)  # type: ignore[type-var]
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, float) and not np.isfinite(value):
        raise ValueError(f"options: expected a finite number, got {value}")
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise TypeError(f"options: expected a value that JSON can hold, got {type(value).__name__}")
