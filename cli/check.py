"""`pgm check PATH...`: files, work folders and datasets against the contract."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from .console import option_error

if TYPE_CHECKING:
    from pgm_data.dataset.findings import Checked

INVALID = 5


@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Validate files, clip and work folders and datasets against the schemas, with their physics and references.

    Every violation is listed: path, field, what was expected, what was found. Exit code 5 when there is any.
    """

    paths: tyro.conf.Positional[tuple[Path, ...]]
    """Files (json, yaml, parquet), clip folders, work folders and datasets."""
    kind: str = ""
    """What single files are whose name does not tell, such as clip, scene or camera."""
    scene: str = ""
    """A scene's name or file, taken in place of the scene that the files name."""
    json: bool = False
    """Print one JSON document instead of lines."""


def main(argv: list[str]) -> int:
    """Check the paths; the exit code."""
    options = tyro.cli(CheckOptions, args=argv, prog="pgm check")
    if not options.paths:
        raise option_error("PATH", expected="at least one file or folder", got="none")
    for path in options.paths:
        if not path.exists():
            raise option_error("PATH", expected="a file or a folder", got=f"{path}, where there is nothing")
    checked = _examine(options)
    if options.json:
        print(json.dumps(_document(checked), indent=2))
    else:
        print(_text(checked))
    return INVALID if checked.violations else 0


def _examine(options: CheckOptions) -> "Checked":
    from pgm_data.dataset.check import examine, file_kinds
    from pgm_data.scene import load_scene

    if options.kind and options.kind not in file_kinds():
        raise option_error("--kind", expected=f"one of {', '.join(file_kinds())}", got=repr(options.kind))
    try:
        scene = load_scene(options.scene) if options.scene else None
    except ValueError as error:
        raise option_error("--scene", expected="a scene", got=str(error)) from error
    return examine(options.paths, kind=options.kind, scene=scene)


def _document(checked: "Checked") -> dict[str, object]:
    return {
        "files": [str(path) for path in checked.files],
        "violations": [
            {"path": str(v.path), "field": v.field, "expected": v.expected, "found": v.found}
            for v in checked.violations
        ],
    }


def _text(checked: "Checked") -> str:
    files = f"{len(checked.files)} file{'' if len(checked.files) == 1 else 's'} checked"
    if not checked.violations:
        return f"{files}: all well"
    count = len(checked.violations)
    lines = [str(violation) for violation in checked.violations]
    return "\n".join([*lines, f"{files}: {count} violation{'' if count == 1 else 's'}"])
