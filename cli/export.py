"""`pgm export FORMAT WORK --out DIR`: cameras for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.convert.exchange import ExportOptions, ExportOutcome

SOME_INPUTS_FAILED, NOTHING_USABLE = 3, 4
LINES_SHOWN = 20


@dataclass(frozen=True, kw_only=True)
class Export:
    """What every format takes."""

    work: tyro.conf.Positional[Path]
    """Work folder whose cameras are written."""
    out: Path
    """Folder to write into, new or empty."""
    every: int = 30
    """Frames from one picture to the next; 1 takes every frame."""
    images: bool = False
    """Write the frames as pictures too, out of the source videos."""
    picture_format: Literal["jpg", "png"] = "jpg"
    """Format of those pictures."""
    videos: Path | None = None
    """Folder of the source videos, where they are no longer where they were."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


@dataclass(frozen=True, kw_only=True)
class ColmapExport(Export):
    """A COLMAP model without points: sparse/0, and images where asked. Frames without a camera are left out."""

    text: bool = False
    """Write the model as text rather than binary."""


@dataclass(frozen=True, kw_only=True)
class NerfstudioExport(Export):
    """A transforms.json for nerfstudio, and images where asked. Frames without a camera are left out."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    return tyro.extras.subcommand_cli_from_dict(
        {"colmap": _colmap, "nerfstudio": _nerfstudio},
        args=argv,
        prog="pgm export",
        description="Write the cameras of a work folder for another program.",
    )


def _colmap(options: Annotated[ColmapExport, tyro.conf.arg(name="")]) -> int:
    """A COLMAP model without points: sparse/0, and images where asked. Frames without a camera are left out."""
    chosen = _checked(options)
    from pgm_data.convert.exchange import export_colmap

    with prepare_output(options.out, resume=False, overwrite=options.overwrite):
        try:
            outcome = export_colmap(options.work, options.out, chosen, text=options.text)
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
        return _report(outcome, options.out)


def _nerfstudio(options: Annotated[NerfstudioExport, tyro.conf.arg(name="")]) -> int:
    """A transforms.json for nerfstudio, and images where asked. Frames without a camera are left out."""
    chosen = _checked(options)
    from pgm_data.convert.exchange import export_nerfstudio

    with prepare_output(options.out, resume=False, overwrite=options.overwrite):
        try:
            outcome = export_nerfstudio(options.work, options.out, chosen)
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
        return _report(outcome, options.out)


def _checked(options: Export) -> "ExportOptions":
    if not options.work.is_dir():
        raise option_error("WORK", expected="a work folder", got=options.work)
    if options.every < 1:
        raise option_error("--every", expected="at least 1", got=options.every)
    if options.videos is not None and not options.videos.is_dir():
        raise option_error("--videos", expected="a folder", got=options.videos)
    from pgm_data.convert.exchange import ExportOptions

    return ExportOptions(
        every=options.every, images=options.images, picture_format=options.picture_format, videos=options.videos
    )


def _report(outcome: "ExportOutcome", out: Path) -> int:
    left_out = outcome.timeline.left_out
    print(f"{outcome.pictures} pictures of {len(outcome.timeline.clips)} clips to {out}")
    if left_out:
        print(f"{len(left_out)} frames without a camera left out:")
        for frame in left_out[:LINES_SHOWN]:
            print(f"  {frame.clip_id} frame {frame.frame_index}: {frame.reason}")
        if len(left_out) > LINES_SHOWN:
            print(f"  and {len(left_out) - LINES_SHOWN} more, listed under left_out in the time line")
    for problem in outcome.problems:
        print_error(str(problem))
    return SOME_INPUTS_FAILED if outcome.problems else 0
