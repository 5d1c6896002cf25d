"""`pgm evaluate RUN DATASET` for a synthesis run: how like real pictures those are that it renders."""

import json
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, option_error
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_models.synthesis.evaluate_run import SynthesisEvaluationOptions

PARTS = "parts"
"""Folder in the output: what is finished."""
OPTIONS = {
    "dataset": "DATASET",
    **{name: f"--{name}" for name in ("split", "device", "truth")},
}
"""How options of the evaluation are written on the command line."""
LARGEST_PX = 7680
"""Width and height of pictures, at most."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of networks that compare pictures; what is not given is n/a, and nothing stands in for it."""

    lpips: Path | None = None
    """AlexNet or VGG16 of ImageNet, for LPIPS."""
    heads: Path | None = None
    """The linear heads of LPIPS for it."""
    fid: Path | None = None
    """Inception v3 of 2015-12-05, for FID."""
    fvd: Path | None = None
    """I3D of Kinetics-400, for FVD."""


@dataclass(frozen=True, kw_only=True)
class EvaluateSynthesisCommand:
    """Score a synthesis model: its pictures beside real ones, from elsewhere, and what they take.

    PSNR, SSIM, MS-SSIM of the frame and of each object; ADD and MDR of players and ball, found in the final picture;
    steadiness; with the simulator's work folder also true masks and views from where no camera was; samples and time
    beside the paper's dense layout. Writes tables, CSV, JSON and a sheet of pictures.
    Example: pgm evaluate runs/synthesis sim/dataset --truth sim/work --out scores. Exit codes: 0 all well; 2 options
    that do not fit.
    """

    run: tyro.conf.Positional[Path]
    """Run of pgm-train synthesis, or a model file."""
    dataset: tyro.conf.Positional[Path]
    """Packed dataset with videos: the run's own, of which the frames are judged that it has not learned from, or
    others."""
    out: Path | None = None
    """Folder to write into, with each finished clip. Without it the tables are printed only."""
    truth: Path | None = None
    """Work folder of the dataset's clips from pgm simulate --masks; without it masks are the renderer's own, -alpha,
    and there are no novel views."""
    split: Literal["auto", "held-out", "all"] = "auto"
    """Frames that are judged: the ends of matches that the run left out, or all but the first tenth of each match, off
    which styles are read then. auto takes the first for the run's own dataset, else the second."""
    frames: int = 500
    """Frames at most, in stretches evenly spread; 0 for all."""
    resolution: str = ""
    """Of the judged pictures, at most, as WIDTHxHEIGHT; the model's unless given."""
    novel_frames: int = 4
    """Frames that are drawn again from three sides each; 0 for none."""
    efficiency_frames: int = 2
    """Frames whose samples and time are counted; 0 for none."""
    efficiency_resolution: str = "1024x576"
    """Of their pictures."""
    dense_share: int = 16
    """Dense rendering is run for one row of pixels in so many; 1 for all, which takes minutes a frame."""
    weights: Weights = field(default_factory=Weights)
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    threads: int = 2
    """CPU threads."""
    json: bool = False
    """Print one JSON document instead of the tables."""
    resume: bool = False
    """Go on in `out`: clips and parts that are finished there are not done again."""
    overwrite: bool = False
    """Delete what an earlier run wrote into `out`, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(EvaluateSynthesisCommand, args=argv, prog="pgm evaluate")
    options = _options(command)
    started = datetime.now(UTC)
    import torch

    from pgm_models.synthesis.evaluate_result import summary_to_json
    from pgm_models.synthesis.evaluate_run import evaluate_synthesis, open_judge
    from pgm_models.synthesis.evaluate_sheet import SHEET_NAME, write_sheet
    from pgm_models.synthesis.evaluate_tables import evaluation_text, write_synthesis_evaluation

    torch.set_num_threads(command.threads)
    with ExitStack() as stack:
        if command.out is not None:
            stack.enter_context(prepare_output(command.out, resume=command.resume, overwrite=command.overwrite))
        progress = Progress(total=1, unit="evaluation")
        stack.callback(progress.close)
        try:
            judge = open_judge(options)
            parts = None if command.out is None else command.out / PARTS
            result = evaluate_synthesis(judge, parts, partial(progress.update, "evaluation"))
            if command.out is not None:
                write_synthesis_evaluation(command.out, result)
                progress.update("evaluation", 0.98, SHEET_NAME)
                write_sheet(command.out, judge.store, judge.maker, result)
                _write_run(command, started, [clip.clip for clip in result.clips])
        except FileNotFoundError as error:
            raise UsageError(str(error)) from error
        except ValueError as error:
            name, _, said = str(error).partition(": ")
            raise UsageError(f"{OPTIONS.get(name, name)}: {said}" if said else str(error)) from error
        progress.close()
        print(json.dumps(summary_to_json(result), indent=1) if command.json else evaluation_text(result), end="")
    return 0


def _options(command: EvaluateSynthesisCommand) -> "SynthesisEvaluationOptions":
    """What is to be evaluated, its options checked."""
    if not (command.dataset / "meta" / "info.json").is_file():
        raise option_error("DATASET", expected="a folder that pgm pack wrote", got=command.dataset)
    if command.truth is not None and not (command.truth / "run.json").is_file():
        raise option_error("--truth", expected="a work folder, with run.json", got=command.truth)
    if command.out is None and (command.resume or command.overwrite):
        raise option_error("--out", expected="a folder, as --resume or --overwrite is given", got="none")
    for name in ("frames", "novel_frames", "efficiency_frames"):
        if getattr(command, name) < 0:
            raise option_error(f"--{name.replace('_', '-')}", expected="0 or more", got=getattr(command, name))
    for name in ("dense_share", "threads"):
        if getattr(command, name) < 1:
            raise option_error(f"--{name.replace('_', '-')}", expected="1 or more", got=getattr(command, name))
    size = _size("--resolution", command.resolution) if command.resolution else (0, 0)
    large = _size("--efficiency-resolution", command.efficiency_resolution)
    if command.dense_share > 2 * large[1]:
        raise option_error(
            "--dense-share", expected=f"at most {2 * large[1]}, for {large[1]} rows", got=command.dense_share
        )
    from pgm_models.synthesis.evaluate_efficiency import EfficiencyOptions
    from pgm_models.synthesis.evaluate_networks import WeightFiles
    from pgm_models.synthesis.evaluate_run import SynthesisEvaluationOptions
    from pgm_models.synthesis.novel_view import NovelOptions

    files = command.weights
    return SynthesisEvaluationOptions(
        run=command.run,
        dataset=command.dataset,
        truth=command.truth,
        split=command.split,
        frames=command.frames,
        size=size,
        novel=NovelOptions(frames=command.novel_frames),
        efficiency=EfficiencyOptions(size=large, share=command.dense_share),
        efficiency_frames=command.efficiency_frames,
        weights=WeightFiles(lpips=files.lpips, lpips_heads=files.heads, fid=files.fid, fvd=files.fvd),
        device=command.device,
    )


def _size(option: str, text: str) -> tuple[int, int]:
    words = text.lower().split("x")
    if len(words) != 2 or not all(word.isdigit() and 0 < int(word) <= LARGEST_PX for word in words):
        raise option_error(option, expected=f"WIDTHxHEIGHT such as 1024x576, sides to {LARGEST_PX}", got=repr(text))
    return int(words[0]), int(words[1])


def _write_run(command: EvaluateSynthesisCommand, started: datetime, clips: Sequence[str]) -> None:
    """Which program made the result, when, of what."""
    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import run_document

    assert command.out is not None
    seconds = (datetime.now(UTC) - started).total_seconds()
    inputs = [{"path": str(command.dataset), "state": "done", "reason": "", "clips": list(clips), "seconds": seconds}]
    document = run_document(command="pgm evaluate", options=command, started=started, inputs=inputs)
    write_document(command.out / "run.json", "run", document)
