"""What the commands that import share: their folders, run.json, and how they say what came in."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from .console import option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.convert.imported_work import ImportOutcome

SOME_INPUTS_FAILED, NOTHING_USABLE = 3, 4
LINES_SHOWN = 50


@dataclass(frozen=True, kw_only=True)
class Import:
    """What every format takes."""

    path: tyro.conf.Positional[Path]
    """The foreign file or folder."""
    out: Path
    """Work folder to write, new or empty."""
    scene: str | None = None
    """Name of the scene or its .yaml file; by default that of the exported clips, else tennis."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


def run_import(form: str, what: str, options: Import, call: "Callable[[], ImportOutcome]", *, rate: str = "") -> int:
    """Carry out an import into the options' folder; the exit code.

    Args:
        form: The format's name.
        what: What is counted.
        options: The command's own.
        call: Does it.
        rate: How times were made where the format has none, for the message.

    Raises:
        UsageError: If the foreign file or the scene is none, or the output cannot be written.
    """
    if not options.path.exists():
        raise option_error("PATH", expected="a file or folder", got=options.path)
    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import run_document
    from pgm_data.scene import load_scene

    if options.scene is not None:
        try:
            load_scene(options.scene)
        except ValueError as error:
            raise option_error("--scene", expected="a scene", got=error) from error
    started = datetime.now(UTC)
    with prepare_output(options.out, resume=False, overwrite=options.overwrite):
        try:
            outcome = call()
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
        state = "failed" if not outcome.clips else "degraded" if outcome.problems else "ok"
        entry = {
            "path": str(options.path),
            "state": state,
            "reason": str(outcome.problems[0]) if outcome.problems else "",
            "clips": list(outcome.clips),
            "seconds": (datetime.now(UTC) - started).total_seconds(),
        }
        document = run_document(command=f"pgm import {form}", options=options, started=started, inputs=[entry])
        write_document(options.out / "run.json", "run", document)
    return _report(outcome, what, options, rate)


def _report(outcome: "ImportOutcome", what: str, options: Import, rate: str) -> int:
    print(f"{outcome.pictures} {what} in {len(outcome.clips)} clips to {options.out}")
    for clip_id in outcome.nominal_times[:LINES_SHOWN]:
        print(f"{clip_id}: times are nominal{rate}")
    if len(outcome.nominal_times) > LINES_SHOWN:
        print(f"and those of {len(outcome.nominal_times) - LINES_SHOWN} more clips")
    for problem in outcome.problems[:LINES_SHOWN]:
        print_error(str(problem))
    if len(outcome.problems) > LINES_SHOWN:
        print_error(f"and {len(outcome.problems) - LINES_SHOWN} more such places")
    if not outcome.clips:
        print_error(f"{options.path}: expected at least one clip that can be taken over, got none")
        return NOTHING_USABLE
    return SOME_INPUTS_FAILED if outcome.problems else 0
