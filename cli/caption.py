"""`pgm caption`: words about what each player of a work folder's clips does."""

import json
import shlex
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import Progress, UsageError, option_error, print_error, table_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pgm_data.stages.caption_run import CaptionManner, CaptionRun

SOME_FAILED, NOTHING_USABLE = 3, 4


@dataclass(frozen=True, kw_only=True)
class CaptionCommand:
    """Captions of what each player does, span by span: movement, stroke, direction, target, outcome.

    pgm caption WORK makes them from players and ball and writes captions.parquet beside them, a main text and two in
    other words. With --from FILE_OR_FOLDER they are read instead: CSV (clip, player, start and end in frames or
    seconds, text), JSON, WebVTT (<v player0>) or an export of Label Studio. What people wrote stays, and generated
    captions are put where it leaves room. Exit codes: 0 all well; 3 a clip failed or a row was refused; 4 no caption.
    """

    work: tyro.conf.Positional[Path]
    """Work folder."""
    from_: Annotated[str, tyro.conf.arg(name="from")] = ""
    """File or folder of captions to read; without it they are generated."""
    source: Literal["", "human", "imported"] = ""
    """Of captions that are read: who wrote them; what the file says, else imported."""
    player: str = ""
    """Of captions that are read and name no player: the one they are about."""
    clip: tuple[str, ...] = ()
    """Only these clips."""
    export: str = ""
    """File to write all captions of the clips to, as they are afterwards: .csv, .json, or .vtt (of one clip)."""
    resume: bool = False
    """Clips that an earlier run captioned stay unless what they depend on changed."""
    overwrite: bool = False
    """Replace what is there, whoever wrote it."""
    quiet: bool = False
    """Say nothing but errors."""
    json: bool = False
    """Print one JSON document instead of a table."""


def main(argv: list[str]) -> int:
    """Caption the clips; the exit code."""
    command = tyro.cli(CaptionCommand, args=argv, prog="pgm caption")
    line = shlex.join(["pgm", "caption", *argv])
    if command.resume and command.overwrite:
        raise UsageError("--resume and --overwrite: expected one of them, got both")
    if not command.work.is_dir():
        raise option_error("WORK", expected="a work folder", got=f"{command.work}, which is none")
    if command.from_ and not Path(command.from_).exists():
        raise option_error("--from", expected="a file or a folder", got=f"{command.from_}, which is not there")
    if not command.from_ and (command.source or command.player):
        name = "--source" if command.source else "--player"
        raise UsageError(f"{name}: is for captions that are read with --from")
    if command.from_ and command.resume:
        raise UsageError("--resume: is for captions that are generated, and --from reads them")
    return _caption(command, line)


def _caption(command: CaptionCommand, line: str) -> int:
    from pgm_data.stages.caption_run import CaptionManner, clip_names, write_caption_run

    from .output import hold_work

    names = _clips(command, clip_names(command.work))
    if not names:
        print_error(f"no clip in {command.work}: expected a work folder that pgm-calibrate wrote")
        return NOTHING_USABLE
    _check_export(command, names)
    manner = CaptionManner(resume=command.resume, overwrite=command.overwrite)
    started = datetime.now(UTC)
    with hold_work(command.work):
        run = _imported(command, names, manner) if command.from_ else _generated(command, names, manner)
        write_caption_run(command.work, run, command=line, options=command, started=started)
        lost = _export(command, names) if command.export else ""
    return _tell(command, run, lost)


def _check_export(command: CaptionCommand, names: "Sequence[str]") -> None:
    """Refuse a file that the captions could not be written to, before anything is done."""
    if not command.export:
        return
    from pgm_data.convert.captions_files import WRITTEN_SUFFIXES

    suffix = Path(command.export).suffix.lower()
    if suffix not in WRITTEN_SUFFIXES:
        raise option_error(
            "--export", expected=f"a file that ends in {', '.join(WRITTEN_SUFFIXES)}", got=command.export
        )
    if suffix == ".vtt" and len(names) > 1:
        raise option_error("--export", expected="one clip, as WebVTT holds one video, or --clip", got=f"{len(names)}")


def _clips(command: CaptionCommand, there: "Sequence[str]") -> "Sequence[str]":
    stray = [name for name in command.clip if name not in there]
    if stray:
        raise option_error("--clip", expected=f"clips of {command.work} ({', '.join(there) or 'none'})", got=stray[0])
    return [name for name in there if name in command.clip] if command.clip else there


def _generated(command: CaptionCommand, names: "Sequence[str]", manner: "CaptionManner") -> "CaptionRun":
    from pgm_data.stages.caption_run import generate_captions, has_generated

    if not (manner.resume or manner.overwrite):
        there = next((name for name in names if _tried(has_generated, command.work, name)), None)
        if there is not None:
            hint = "--resume goes on, --overwrite begins again"
            raise UsageError(f"{command.work}: expected clips without captions, got {there} that has some; {hint}")
    progress = Progress(total=len(names), unit="clip", quiet=command.quiet)
    try:
        return generate_captions(command.work, names, manner, lambda name: progress.finish(name))
    finally:
        progress.close()


def _tried(has, work: Path, name: str) -> bool:
    """Whether there are any, as far as the table can be read; a broken one is told of when its clip's turn comes."""
    try:
        return has(work, name)
    except ValueError:
        return False


def _imported(command: CaptionCommand, names: "Sequence[str]", manner: "CaptionManner") -> "CaptionRun":
    from pgm_data.convert.captions_files import read_captions
    from pgm_data.convert.captions_match import ReadOptions
    from pgm_data.stages.caption_run import CaptionOutcome, import_captions, read_clip

    clips, broken = {}, []
    for name in names:
        try:
            clips[name] = read_clip(command.work / name)
        except ValueError as error:
            broken.append(CaptionOutcome(clip_id=name, state="failed", reason=str(error)))
    options = ReadOptions(
        source=command.source, player=command.player, clip=command.clip[0] if len(command.clip) == 1 else ""
    )
    try:
        read = read_captions(Path(command.from_), {name: clip.clip for name, clip in clips.items()}, options)
    except ValueError as error:
        raise UsageError(f"--from: {error}") from error
    run = import_captions(command.work, clips, read, manner)
    run.outcomes += broken
    return run


def _export(command: CaptionCommand, names: "Sequence[str]") -> str:
    """Write the captions of the clips to a file; why not, where that is so."""
    from pgm_data.convert.captions_files import write_captions
    from pgm_data.dataset.clip_captions import read_clip_captions
    from pgm_data.stages.caption_run import CAPTIONS, read_clip

    captions, players = {}, ()
    try:
        for name in names:
            if (command.work / name / CAPTIONS).is_file():
                captions[name] = read_clip_captions(command.work / name)
                players = read_clip(command.work / name).clip.players
        write_captions(Path(command.export), captions, players)
    except ValueError as error:
        return str(error)
    return ""


def _tell(command: CaptionCommand, run: "CaptionRun", lost: str) -> int:
    """Print what became of the run; its exit code."""
    errors = [finding for finding in run.findings if finding.level == "error"]
    states = [outcome.state for outcome in run.outcomes]
    troubled = "failed" in states or bool(errors) or bool(lost)
    code = NOTHING_USABLE if "ok" not in states else SOME_FAILED if troubled else 0
    if command.json:
        from pgm_data.provenance import plain

        document = {
            "work": str(command.work),
            "exit_code": code,
            "clips": plain(run.outcomes),
            "findings": plain(run.findings),
        }
        print(json.dumps(document, indent=2))
    elif not command.quiet:
        print(table_text(HEADER, [_cells(outcome) for outcome in run.outcomes]))
        for finding in run.findings:
            if finding.level == "warning":
                print(f"warning: {finding.text()}")
    for outcome in run.outcomes:
        if outcome.state == "failed":
            print_error(f"{outcome.clip_id}: {outcome.reason.removeprefix(outcome.clip_id + ': ')}")
    for finding in errors:
        print_error(finding.text())
    if lost:
        print_error(f"--export: {lost}")
    if code == NOTHING_USABLE:
        print_error("no clip got a caption")
    return code


HEADER = ("clip", "state", "generated", "human", "imported", "words", "span s", "covered", "trouble")


def _cells(outcome) -> tuple[object, ...]:
    reason = outcome.reason if len(outcome.reason) <= 80 else outcome.reason[:77] + "..."
    counts = (outcome.generated, outcome.human, outcome.imported)
    return outcome.clip_id, outcome.state, *counts, outcome.words, outcome.span_s, outcome.covered, reason
