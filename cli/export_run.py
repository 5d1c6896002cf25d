"""What the commands that export share: their folders, and how they say what went out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from .console import option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.convert.posed_pictures import Problem

SOME_INPUTS_FAILED, NOTHING_USABLE = 3, 4
LINES_SHOWN = 20


@dataclass(frozen=True, kw_only=True)
class Export:
    """What every format takes."""

    work: tyro.conf.Positional[Path]
    """Work folder whose clips are written."""
    out: Path
    """Folder to write into, new or empty."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Exported:
    """What went out."""

    said: str
    """One line: how much, of what."""
    details: "tuple[str, ...]" = ()
    """Lines of which the first are shown: what was left out, or changed on the way."""
    problems: "tuple[Problem, ...]" = ()


def run_export(options: Export, call: Callable[[], Exported]) -> int:
    """Carry out an export into the options' folder; the exit code.

    Raises:
        UsageError: If the work folder is none, or the output cannot be written.
    """
    if not options.work.is_dir():
        raise option_error("WORK", expected="a work folder", got=options.work)
    with prepare_output(options.out, resume=False, overwrite=options.overwrite):
        try:
            exported = call()
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
    print(f"{exported.said} to {options.out}")
    for line in exported.details[:LINES_SHOWN]:
        print(f"  {line}")
    if len(exported.details) > LINES_SHOWN:
        print(f"  and {len(exported.details) - LINES_SHOWN} more")
    for problem in exported.problems[:LINES_SHOWN]:
        print_error(str(problem))
    if len(exported.problems) > LINES_SHOWN:
        print_error(f"and {len(exported.problems) - LINES_SHOWN} more such places")
    return SOME_INPUTS_FAILED if exported.problems else 0
