"""`pgm export coco`, `mot`, `track` and `captions`: what was found in the pictures, and words."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .export_cameras import PictureExport, checked
from .export_run import Export, Exported, run_export

if TYPE_CHECKING:
    from pgm_data.convert.exchange_tables import TableOutcome


@dataclass(frozen=True, kw_only=True)
class CocoExport(PictureExport):
    """COCO keypoints."""

    every: int = 1
    """Frames from one image to the next."""


@dataclass(frozen=True, kw_only=True)
class TrackExport(Export):
    """The ball's track."""

    form: Literal["plain", "tracknet"] = "plain"
    """`plain`: frame,x,y,visible,timestamp; `tracknet`: Frame,Visibility,X,Y with whole pixels."""


@dataclass(frozen=True, kw_only=True)
class CaptionExport(Export):
    """Captions."""

    form: Literal["csv", "json", "vtt"] = "csv"
    """A table, JSON, or subtitles."""


def coco(options: Annotated[CocoExport, tyro.conf.arg(name="")]) -> int:
    """Players as COCO keypoints: CLIP.json with boxes and keypoints, and images where asked.

    Boxes count from the picture's corner, keypoints are numbers of pixels. Lost: everything in metres (skeletons, their
    rotations and doubt, contacts) and a box's status; `pgm players WORK --keypoints FOLDER` reads the rest back.
    """
    chosen = checked(options)

    def call() -> Exported:
        from pgm_data.convert.exchange_tables import export_coco

        return _told(export_coco(options.work, options.out, chosen), "boxes")

    return run_export(options, call)


def mot(options: Annotated[Export, tyro.conf.arg(name="")]) -> int:
    """Players' boxes as MOTChallenge text: CLIP.txt of frame,id,left,top,width,height,conf,-1,-1,-1; frames from 1.

    Lost: everything but boxes; an id is the player's place in the scene, from 1. `pgm players WORK --boxes FOLDER`
    reads them back.
    """

    def call() -> Exported:
        from pgm_data.convert.exchange_tables import export_mot

        return _told(export_mot(options.work, options.out), "boxes")

    return run_export(options, call)


def track(options: Annotated[TrackExport, tyro.conf.arg(name="")]) -> int:
    """The ball's pixels as a track: CLIP.csv with a row for every frame of the clip.

    Lost: scores, events, everything in metres; in the form tracknet also times and parts of a pixel. `pgm-ball3d`
    reads both back.
    """

    def call() -> Exported:
        from pgm_data.convert.exchange_tables import export_track

        return _told(export_track(options.work, options.out, form=options.form), "pixels of the ball")

    return run_export(options, call)


def captions(options: Annotated[CaptionExport, tyro.conf.arg(name="")]) -> int:
    """Captions as CLIP.csv, CLIP.json or subtitles, CLIP.vtt.

    Lost: in subtitles the frames (times are kept to a millisecond). `pgm caption WORK` reads all of them back.
    """

    def call() -> Exported:
        from pgm_data.convert.exchange_tables import export_captions

        return _told(export_captions(options.work, options.out, form=options.form), "captions")

    return run_export(options, call)


def _told(outcome: "TableOutcome", what: str) -> Exported:
    said = f"{outcome.rows} {what} of {len(outcome.files)} files"
    return Exported(said=said, problems=outcome.problems)
