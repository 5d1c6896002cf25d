"""`pgm pack WORK... --out DATASET`: work folders into one dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.dataset.pack import PackOutcome
    from pgm_data.scene import Scene

SOME_INPUTS_FAILED, NOTHING_USABLE = 3, 4
LINES_SHOWN = 20


@dataclass(frozen=True, kw_only=True)
class PackCommand:
    """Pack work folders into one dataset that pandas, DuckDB, Hugging Face datasets and LeRobot open.

    One row a frame, one episode a clip. No match is divided between the splits train, val and test.
    Exit codes: 0 all well; 3 a clip was left out, or packed without its video; 4 no clip could be packed.
    """

    works: tyro.conf.Positional[tuple[Path, ...]]
    """Work folders, or what pgm simulate wrote."""
    out: Path
    """Folder to write into; it must be new or empty, or --overwrite be given."""
    scene: str = ""
    """A scene's name or file, for a scene that does not ship with pgm."""
    videos: Literal["copy", "link", "encode", "none"] = "link"
    """What becomes of the videos: copied, linked to where they are, encoded anew as H.264, or left out."""
    video_folder: Path | None = None
    """Folder of the source videos, where they are no longer where they were."""
    height: int = 0
    """Height of encoded videos, pixels; 0 keeps each as it is. Columns in pixels stay those of the source."""
    crf: int = 20
    """Quality of encoded videos, the same for every picture: 0 is lossless, 51 the worst."""
    rate: float = 0.0
    """Frames per second of encoded videos, for readers that want a constant rate; 0 keeps the times of each frame."""
    val_share: float = 0.1
    """Share of the matches kept for validation: at least one of three or more matches, unless 0."""
    test_share: float = 0.1
    """Share of the matches kept for testing: at least one of three or more matches, unless 0."""
    file_mb: int = 100
    """Size at which a data file ends, MB."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(PackCommand, args=argv, prog="pgm pack")
    _check_folders(command)
    from pgm_data.dataset.pack import write_dataset
    from pgm_data.dataset.pack_plan import PackOptions, plan_pack
    from pgm_data.stages.encode_video import encode_video

    try:
        options = PackOptions(
            videos=command.videos,
            video_folder=command.video_folder,
            height=command.height,
            crf=command.crf,
            rate=command.rate,
            val_share=command.val_share,
            test_share=command.test_share,
            file_mb=command.file_mb,
        )
    except ValueError as error:
        name, _, said = str(error).partition(": ")
        raise UsageError(f"--{name.replace('_', '-').replace(' + ', ' + --')}: {said}") from error
    try:
        plan = plan_pack(command.works, options, scene=_scene(command.scene))
    except ValueError as error:
        raise UsageError(str(error)) from error
    with prepare_output(command.out, resume=False, overwrite=command.overwrite):
        progress = Progress(total=len(plan.clips), unit="clip")
        try:
            outcome = write_dataset(
                plan,
                command.out,
                options,
                encode=encode_video,
                said=lambda clip, problem: progress.finish(clip.clip_id),
            )
        finally:
            progress.close()
        return _report(outcome, command.out)


def _check_folders(command: PackCommand) -> None:
    if not command.works:
        raise option_error("WORK", expected="at least one work folder", got="none")
    for work in command.works:
        if not work.is_dir():
            raise option_error("WORK", expected="a work folder", got=work)
        if command.out.resolve() == work.resolve():
            raise option_error("--out", expected="another folder than the work folder", got=command.out)
    if command.video_folder is not None and not command.video_folder.is_dir():
        raise option_error("--video-folder", expected="a folder", got=command.video_folder)


def _scene(name: str) -> "Scene | None":
    from pgm_data.scene import load_scene

    try:
        return load_scene(name) if name else None
    except ValueError as error:
        raise option_error("--scene", expected="a scene", got=error) from error


def _report(outcome: "PackOutcome", out: Path) -> int:
    for problem in outcome.problems[:LINES_SHOWN]:
        print_error(str(problem))
    if len(outcome.problems) > LINES_SHOWN:
        print_error(f"and {len(outcome.problems) - LINES_SHOWN} more clips")
    if not outcome.clips:
        print_error("expected a clip that can be packed, got none; nothing was written")
        return NOTHING_USABLE
    splits = ", ".join(f"{split} {count}" for split, count in outcome.clips.items())
    rate = outcome.rate
    print(f"{sum(outcome.clips.values())} clips ({splits}), {outcome.frames} frames to {out}")
    print(f"rate {rate.frames_per_second:g} frames per second, {'constant' if rate.constant else 'nominal'}")
    return SOME_INPUTS_FAILED if outcome.problems else 0
