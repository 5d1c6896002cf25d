"""`pgm import smpl` and `pgm import bvh`: skeletons."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import UsageError
from .import_run import Import, run_import

if TYPE_CHECKING:
    from pgm_data.convert.imported_work import ImportOutcome
    from pgm_data.convert.motion_work import MotionImport


@dataclass(frozen=True, kw_only=True)
class MotionCommand(Import):
    """Recorded motion."""

    up: Literal["y", "z", "format"] = "format"
    """Axis of the file that points up; `format`: z of SMPL (as AMASS has it), y of BVH."""
    player: str = ""
    """Player object of the scene that moves; empty for its first."""
    unit_m: float | None = None
    """Metres of the file's unit of length; by default 1 of SMPL, 0.01 of BVH."""
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the file's origin lies in the world, metres."""


@dataclass(frozen=True, kw_only=True)
class SmplCommand(MotionCommand):
    """SMPL arrays."""

    fps: float | None = None
    """Frames per second of files that do not say; such files are refused without."""
    size: float = 1.0
    """Size of the body over that of the skeleton's rest pose, where the file has no joints."""
    pelvis_m: tuple[float, float, float] | None = None
    """From `trans` to the pelvis in the file's axes, metres, which only the body model knows; by default what the file
    says, else 0."""


def smpl(options: Annotated[SmplCommand, tyro.conf.arg(name="")]) -> int:
    """Skeletons of SMPL or AMASS .npz files, one clip a file: poses, trans, betas, mocap_framerate.

    Lost: hands, face, soft tissue, and the body's own shape: bones are those of the skeleton, scaled by --size. Clips
    have no camera and no pictures.
    """
    from pgm_data.convert.motion_work import MotionImport

    def call() -> "ImportOutcome":
        from pgm_data.convert.motion_exchange import import_smpl

        return import_smpl(options.path, options.out, scene=options.scene, options=motion)

    motion = _checked(
        lambda: MotionImport(
            up=options.up,
            player=options.player,
            frames_per_second=options.fps,
            unit_m=options.unit_m,
            size=options.size,
            origin_m=options.origin_m,
            pelvis_m=options.pelvis_m,
        )
    )
    return run_import(
        "smpl", "poses", options, call, rate="" if options.fps is None else f", at {options.fps:g} a second"
    )


def bvh(options: Annotated[MotionCommand, tyro.conf.arg(name="")]) -> int:
    """Skeletons of BVH files, one clip a file; joints by the skeleton's own names or the common ones of bodies.

    Lost: joints that the skeleton has not. Clips have no camera and no pictures.
    """
    from pgm_data.convert.motion_work import MotionImport

    def call() -> "ImportOutcome":
        from pgm_data.convert.motion_exchange import import_bvh

        return import_bvh(options.path, options.out, scene=options.scene, options=motion)

    motion = _checked(
        lambda: MotionImport(up=options.up, player=options.player, unit_m=options.unit_m, origin_m=options.origin_m)
    )
    return run_import("bvh", "poses", options, call)


def _checked(made) -> "MotionImport":
    try:
        return made()
    except ValueError as error:
        raise UsageError(f"options: {error}") from error
