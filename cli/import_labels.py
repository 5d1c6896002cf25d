"""`pgm import cvat` and `label-studio`: a person's corrections of clips that are there."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from .console import option_error, print_error
from .output import hold_work

if TYPE_CHECKING:
    from pgm_data.convert.corrected_labels import Form

SOME_FAILED, NOTHING_USABLE = 3, 4


@dataclass(frozen=True, kw_only=True)
class LabelImport:
    """Where corrections go."""

    path: tyro.conf.Positional[Path]
    """The program's export, of one clip."""
    work: Path
    """Work folder that holds the clip."""
    clip: str = ""
    """The clip; by default the one that the file is named after, or the only one."""


def cvat(options: Annotated[LabelImport, tyro.conf.arg(name="")]) -> int:
    """Corrections made in CVAT (CVAT for video 1.1) to what `pgm export cvat` wrote.

    They become files in WORK/CLIP/corrected that the stages take, and graphics go into clip.json; the commands that
    take the files in are printed. Lost: labels of other names, who hit the ball, times between frames.
    """
    return _labels(options, "cvat")


def label_studio(options: Annotated[LabelImport, tyro.conf.arg(name="")]) -> int:
    """Corrections made in Label Studio to what `pgm export label-studio` wrote.

    They become files in WORK/CLIP/corrected that the stages take, and graphics go into clip.json; the commands that
    take the files in are printed. Lost: labels of other names, who hit the ball, times between frames.
    """
    return _labels(options, "label-studio")


def _labels(options: LabelImport, form: "Form") -> int:
    if not options.path.is_file():
        raise option_error("PATH", expected="a file", got=f"{options.path}, which is none")
    if not options.work.is_dir():
        raise option_error("--work", expected="a work folder", got=options.work)
    from pgm_data.convert.corrected_labels import import_labels
    from pgm_data.stages.clip_run import clip_ids

    there = clip_ids(options.work)
    clip = options.clip or (there[0] if len(there) == 1 else options.path.stem)
    if clip not in there:
        raise option_error("--clip", expected=f"one of {', '.join(there) or 'no clip'}", got=clip)
    with hold_work(options.work):
        try:
            found = import_labels(options.path, options.work / clip, form=form)
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
    if found.ui_boxes:
        print(f"{found.ui_boxes} graphics in {options.work / clip / 'clip.json'}")
    for path in found.files:
        print(f"wrote {path}")
    if found.commands:
        print("\nto take them in:")
        print("\n".join(f"  {command}" for command in found.commands))
    for line in found.left_out:
        print_error(line)
    return SOME_FAILED if found.left_out else 0
