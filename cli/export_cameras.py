"""`pgm export colmap` and `pgm export nerfstudio`: cameras."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import option_error
from .export_run import Export, Exported, run_export

if TYPE_CHECKING:
    from pgm_data.convert.exchange import ExportOptions, ExportOutcome


@dataclass(frozen=True, kw_only=True)
class PictureExport(Export):
    """A format that shows frames as pictures."""

    every: int = 30
    """Frames from one picture to the next; 1 takes every frame."""
    images: bool = False
    """Write the frames as pictures too, out of the source videos."""
    picture_format: Literal["jpg", "png"] = "jpg"
    """Format of those pictures."""
    videos: Path | None = None
    """Folder of the source videos, where they are no longer where they were."""


@dataclass(frozen=True, kw_only=True)
class ColmapExport(PictureExport):
    """A COLMAP model."""

    text: bool = False
    """Write the model as text rather than binary."""


def colmap(options: Annotated[ColmapExport, tyro.conf.arg(name="")]) -> int:
    """A COLMAP model without points: sparse/0, and images where asked. Frames without a camera are left out.

    Lost: what the cameras rest on and their doubt; players, ball, words. pgm.json beside it keeps times and frames for
    the way back.
    """
    chosen = checked(options)

    def call() -> Exported:
        from pgm_data.convert.exchange import export_colmap

        return _told(export_colmap(options.work, options.out, chosen, text=options.text))

    return run_export(options, call)


def nerfstudio(options: Annotated[PictureExport, tyro.conf.arg(name="")]) -> int:
    """A transforms.json for nerfstudio, and images where asked. Frames without a camera are left out.

    Lost: what the cameras rest on and their doubt; players, ball, words. Its key `pgm` keeps times and frames for the
    way back.
    """
    chosen = checked(options)

    def call() -> Exported:
        from pgm_data.convert.exchange import export_nerfstudio

        return _told(export_nerfstudio(options.work, options.out, chosen))

    return run_export(options, call)


def checked(options: PictureExport) -> "ExportOptions":
    """Which frames go out.

    Raises:
        UsageError: If an option is not what it must be.
    """
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


def _told(outcome: "ExportOutcome") -> Exported:
    left_out = outcome.timeline.left_out
    lines = [f"{frame.clip_id} frame {frame.frame_index}: {frame.reason}" for frame in left_out]
    head = [f"{len(lines)} frames without a camera left out (the time line lists them all):"] if lines else []
    return Exported(
        said=f"{outcome.pictures} pictures of {len(outcome.timeline.clips)} clips",
        details=(*head, *lines),
        problems=outcome.problems,
    )
