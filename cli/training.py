"""What all trainings of the command line share: the folder of the run, what is shown, and how they end."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .console import UsageError

if TYPE_CHECKING:
    from pgm_models.train import Outcome


def command_line() -> list[str]:
    """The words that began this run."""
    return ["pgm-train", *sys.argv[1:]]


def show(line: str) -> None:
    """Print a line at once."""
    print(line, flush=True)


def interrupted(outcome: "Outcome") -> int:
    """Say that a run stopped early, and how it goes on; the exit code."""
    print(f"interrupted after step {outcome.step}; --resume goes on from there")
    return 130


def make_way(out: Path, *, resume: bool, overwrite: bool) -> None:
    """Refuse a folder that holds something, unless a run in it is to go on; clear it where it is to be written over."""
    if not resume and not overwrite:
        if out.is_dir() and any(out.iterdir()):
            raise UsageError(f"--out: expected an empty or new folder, or --resume or --overwrite, got {out}")
    if overwrite:
        for name in ("checkpoint.safetensors", "log.jsonl", "model.safetensors"):
            (out / name).unlink(missing_ok=True)
