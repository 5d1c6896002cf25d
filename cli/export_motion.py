"""`pgm export smpl` and `pgm export bvh`: skeletons."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import option_error
from .export_run import Export, Exported, run_export

if TYPE_CHECKING:
    from pgm_data.convert.motion_exchange import MotionExport, MotionExportOutcome


@dataclass(frozen=True, kw_only=True)
class SmplExport(Export):
    """SMPL arrays."""

    player: tuple[str, ...] = ()
    """Only these player objects."""


@dataclass(frozen=True, kw_only=True)
class BvhExport(SmplExport):
    """BVH."""

    order: Literal["ZXY", "ZYX", "XYZ", "XZY", "YXZ", "YZX"] = "ZXY"
    """Order of the rotation channels."""
    unit_m: float = 0.01
    """Metres of the file's unit of length; 0.01 is a centimetre."""
    up: Literal["y", "z"] = "y"
    """Axis that points up."""


def smpl(options: Annotated[SmplExport, tyro.conf.arg(name="")]) -> int:
    """Skeletons as SMPL arrays: CLIP_PLAYER.npz with poses, trans, betas and mocap_framerate, as AMASS has them.

    Arrays only: no body model comes with them. Lost: boxes, keypoints, contacts, doubts.
    """

    def call() -> Exported:
        from pgm_data.convert.motion_exchange import MotionExport, export_smpl

        return _told(export_smpl(options.work, options.out, MotionExport(players=options.player)))

    return run_export(options, call)


def bvh(options: Annotated[BvhExport, tyro.conf.arg(name="")]) -> int:
    """Skeletons as BVH: CLIP_PLAYER.bvh, from the first pose to the last.

    Lost: gaps (filled by interpolation), uneven times (made even), betas, boxes, keypoints, contacts, doubts.
    """
    motion = _options(options)

    def call() -> Exported:
        from pgm_data.convert.motion_exchange import export_bvh

        return _told(export_bvh(options.work, options.out, motion))

    return run_export(options, call)


def _options(options: BvhExport) -> "MotionExport":
    from pgm_data.convert.motion_exchange import MotionExport

    try:
        return MotionExport(players=options.player, order=options.order, unit_m=options.unit_m, up=options.up)
    except ValueError as error:
        raise option_error("--unit-m", expected="above 0", got=options.unit_m) from error


def _told(outcome: "MotionExportOutcome") -> Exported:
    said = f"{outcome.frames} poses in {len(outcome.files)} files"
    return Exported(said=said, details=outcome.said, problems=outcome.problems)
