"""`pgm import colmap`, `nerfstudio` and `playable`: cameras, and what comes with them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import option_error
from .import_run import Import, run_import

if TYPE_CHECKING:
    from pgm_data.convert.imported_work import ImportOutcome


@dataclass(frozen=True, kw_only=True)
class CameraImport(Import):
    """Pictures with cameras."""

    fps: float = 30.0
    """Nominal frames per second of pictures that pgm did not export: such files hold no times."""


@dataclass(frozen=True, kw_only=True)
class PlayableImport(CameraImport):
    """A Playable Environments dataset."""

    fps: float = 5.0
    """Nominal frames per second: the dataset holds no times, and the tennis set was cut at 5."""
    pictures: Literal["video", "none"] = "video"
    """Encode the pictures as one video a clip, or take none: clips then have cameras and boxes alone."""
    focal_size: tuple[int, int] | None = None
    """Width and height of the pictures that focal lengths are of, pixels; by default 996 560 for tennis, 1024 576 for
    blocks (Minecraft)."""
    keypoints: Literal["none", "coco"] = "none"
    """Take keypoints, as COCO's 17 in its order; the dataset itself does not say what they are."""


def colmap(options: Annotated[CameraImport, tyro.conf.arg(name="")]) -> int:
    """Cameras of a COLMAP model, text or binary: its folder, or one with sparse/0 in it.

    Lost: points, and how well each camera fits. Times are kept where pgm.json of an export lies beside it.
    """

    def call() -> "ImportOutcome":
        from pgm_data.convert.exchange import import_colmap

        return import_colmap(options.path, options.out, scene=options.scene, frames_per_second=options.fps)

    return _run("colmap", options, call)


def nerfstudio(options: Annotated[CameraImport, tyro.conf.arg(name="")]) -> int:
    """Cameras of a transforms.json, or of the folder it stands in.

    Lost: masks, depths, points. Times are kept where the file has the key `pgm` of an export.
    """

    def call() -> "ImportOutcome":
        from pgm_data.convert.exchange import import_nerfstudio

        return import_nerfstudio(options.path, options.out, scene=options.scene, frames_per_second=options.fps)

    return _run("nerfstudio", options, call)


def playable(options: Annotated[PlayableImport, tyro.conf.arg(name="")]) -> int:
    """Cameras, boxes and pictures of a Playable Environments dataset: its folder, or that of one split.

    Pickles are read as plain data; one that asks for anything else is refused. Lost: actions, rewards, metadata, object
    poses, optical flow, and which match a sequence is of (no clip is put into another split than the rest: all get one
    match_id). There is no export: its layout has no place for lens distortion, a ball, a skeleton, words or times.
    """
    if options.focal_size is not None and min(options.focal_size) < 1:
        raise option_error("--focal-size", expected="two sides of at least 1 pixel", got=options.focal_size)

    def call() -> "ImportOutcome":
        from pgm_data.convert.playable import PlayableOptions, import_playable
        from pgm_data.scene import load_scene

        chosen = PlayableOptions(
            fps=options.fps,
            focal_size=options.focal_size,
            pictures=options.pictures,
            keypoints=options.keypoints,
        )
        return import_playable(options.path, options.out, scene=load_scene(options.scene or "tennis"), options=chosen)

    return _run("playable", options, call)


def _run(form: str, options: CameraImport, call) -> int:
    if not (math.isfinite(options.fps) and 0.001 <= options.fps <= 1e6):
        raise option_error("--fps", expected="frames per second above 0", got=options.fps)
    rate = f", at {options.fps:g} frames per second (--fps)"
    return run_import(form, "cameras", options, call, rate=rate)
