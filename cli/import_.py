"""`pgm import FORMAT FILE --out WORK`: cameras of other programs."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    fps: float = 30.0
    """Nominal frames per second of pictures that pgm did not export: such files hold no times."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    return tyro.extras.subcommand_cli_from_dict(
        {"colmap": _colmap, "nerfstudio": _nerfstudio},
        args=argv,
        prog="pgm import",
        description="Take the cameras of another program into a work folder.",
    )


def _colmap(options: Annotated[Import, tyro.conf.arg(name="")]) -> int:
    """Cameras of a COLMAP model, text or binary: its folder, or one with sparse/0 in it."""

    def call() -> "ImportOutcome":
        from pgm_data.convert.exchange import import_colmap

        return import_colmap(options.path, options.out, scene=options.scene, frames_per_second=options.fps)

    return _run("colmap", options, call)


def _nerfstudio(options: Annotated[Import, tyro.conf.arg(name="")]) -> int:
    """Cameras of a transforms.json, or of the folder it stands in."""

    def call() -> "ImportOutcome":
        from pgm_data.convert.exchange import import_nerfstudio

        return import_nerfstudio(options.path, options.out, scene=options.scene, frames_per_second=options.fps)

    return _run("nerfstudio", options, call)


def _run(form: str, options: Import, call: "Callable[[], ImportOutcome]") -> int:
    if not options.path.exists():
        raise option_error("PATH", expected="a file or folder", got=options.path)
    if not (math.isfinite(options.fps) and 0.001 <= options.fps <= 1e6):
        raise option_error("--fps", expected="frames per second above 0", got=options.fps)
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
        return _report(outcome, options)


def _report(outcome: "ImportOutcome", options: Import) -> int:
    print(f"{outcome.pictures} cameras in {len(outcome.clips)} clips to {options.out}")
    for clip_id in outcome.nominal_times:
        print(f"{clip_id}: times are nominal, at {options.fps:g} frames per second (--fps)")
    for problem in outcome.problems[:LINES_SHOWN]:
        print_error(str(problem))
    if len(outcome.problems) > LINES_SHOWN:
        print_error(f"and {len(outcome.problems) - LINES_SHOWN} more such places")
    if not outcome.clips:
        print_error(f"{options.path}: expected at least one picture with a camera, got none")
        return NOTHING_USABLE
    return SOME_INPUTS_FAILED if outcome.problems else 0
