"""`pgm animate RUN --prompt PROMPT.json --out WORK`: play from prompts, as a work folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import tyro

from .console import Progress, UsageError, check_ranges, option_error, print_error, table_text
from .models import loaded
from .output import prepare_output

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_data.stages.jobs import JobEvent, JobOutcome
    from pgm_models.animation.model import AnimationModel
    from pgm_models.animation.play_run import AnimateWork

SOME_FAILED, NOTHING_USABLE = 3, 4
TRIES = 4
"""Samples of a window where a ball tells which is best."""
HEADER = ("clip", "state", "frames", "seed", "first stage Hz", "frames/s", "trouble")


@dataclass(frozen=True, kw_only=True)
class AnimateCommand:
    """Generate play that holds to prompts: values of any column at any time, and words about each player.

    A prompt (schema `prompt`) says length, rate, texts by player and span, and values by column and span; what it
    leaves out is the model's. Each play becomes a clip of the work folder, with its prompt and a picture to look at.
    Exit codes: 0 all well; 3 a prompt failed, and the others are there; 4 all failed.
    """

    run: tyro.conf.Positional[Path]
    """Run of pgm-train animation, a model file, or the name of a model that ships with pgm."""
    prompt: tuple[Path, ...]
    """Prompt files."""
    out: Path
    """Folder to write into; it must be new or empty, or one of --resume and --overwrite be given."""
    plays: int = 1
    """Plays of each prompt, each from the seed after that of the one before."""
    seed: int | None = None
    """Of the first play of each prompt; the prompt's own unless given."""
    sampler: Literal["ddpm", "ddim", "dpmpp_2m", "sde_2m"] = "sde_2m"
    """How noise is turned into states: DDPM's, DDIM's, DPM-Solver++ (2M), or its stochastic form."""
    steps: int = 16
    """Evaluations of the network for each window."""
    guidance: float = 1.0
    """How far to go beyond what the words say; others than 1 take two evaluations a step."""
    temperature: float = 1.0
    """Scale of the noise; 0 for none."""
    tries: int = 0
    """Samples of each window, of which the one is kept whose ball turns least in mid-air: several keep words better. 4
    unless given, 1 for scenes without a ball over a court."""
    keyframe_hz: float | None = None
    """Rate of the first stage of long sequences, frames a second; unless given, what lets one window span it all."""
    keep: int | None = None
    """Frames that a window keeps when it is shifted along a sequence; half a window unless given."""
    settle: bool = True
    """Bring feet and ball onto what they can do: standing feet rest, and the ball flies as gravity and air have it."""
    camera: Path | None = None
    """CAMERA.json of a fixed camera; unless given, the scene's usual view."""
    scene: str = ""
    """Scene file of a model whose scene does not ship with pgm."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    onnx: bool = False
    """Run the network by onnxruntime, on the CPU."""
    threads: int = 0
    """CPU threads; 0 for as many as PyTorch takes."""
    resume: bool = False
    """Plays that an earlier run finished stay unless what they depend on changed."""
    overwrite: bool = False
    """Delete what an earlier run wrote into the folder, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    command = tyro.cli(AnimateCommand, args=argv, prog="pgm animate")
    _check(command)
    import torch

    if command.threads:
        torch.set_num_threads(command.threads)
    from pgm_models.animation.model import load_model

    model = loaded(load_model, command.run, "cpu" if command.onnx else command.device)
    digest = _digest(model)
    scene = _scene(command, model)
    return _animate(command, model, scene, _work(command, model, scene, digest))


def _check(command: AnimateCommand) -> None:
    """Refuse options that cannot be, before anything is loaded."""
    if not command.prompt:
        raise option_error("--prompt", expected="at least one prompt file", got="none")
    check_ranges(
        ("--plays", command.plays, 1, 10_000),
        ("--seed", command.seed or 0, 0, 2**63 - 10_001),
        ("--steps", command.steps, 1, 100_000),
        ("--tries", command.tries, 0, 1000),
        ("--temperature", command.temperature, 0.0, 10.0),
        ("--guidance", command.guidance, -100.0, 100.0),
        ("--threads", command.threads, 0, 1024),
        ("--keep", 1 if command.keep is None else command.keep, 1, 10_000),
        ("--keyframe-hz", 1.0 if command.keyframe_hz is None else command.keyframe_hz, 1e-6, 1e6),
    )
    if command.onnx:
        if command.device not in ("auto", "cpu"):
            raise option_error("--onnx", expected="--device cpu, where onnxruntime runs", got=command.device)
        for module in ("onnx", "onnxscript"):
            if find_spec(module) is None:
                raise UsageError(f"--onnx: expected the package {module}, found none: install the extra 'export'")
    if command.camera is not None:
        from pgm_models.animation.play_camera import camera_of_file

        try:
            camera_of_file(command.camera, 1)
        except ValueError as error:
            raise UsageError(f"--camera: {error}") from error


def _digest(model: "AnimationModel") -> str:
    """SHA-256 of the model's weights and of what it is."""
    from pgm_models.animation.model import options_to_json
    from pgm_models.checkpoint import weights_digest

    return weights_digest(options_to_json(model.options), model.state_dict())


def _scene(command: AnimateCommand, model: "AnimationModel") -> "Scene":
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(command.scene or model.layout.scene)
    except ValueError as error:
        raise UsageError(f"--scene: {error}") from error
    if scene.name != model.layout.scene:
        raise option_error("--scene", expected=f"{model.layout.scene}, of the model", got=scene.name)
    return scene


def _work(command: AnimateCommand, model: "AnimationModel", scene: "Scene", digest: str) -> "AnimateWork":
    from pgm_models.animation.generate import GenerateOptions
    from pgm_models.animation.plausible import judges
    from pgm_models.animation.play_run import AnimateWork
    from pgm_models.animation.sample import SampleOptions

    if command.keep is not None and command.keep >= model.options.frames:
        expected = f"1 to {model.options.frames - 1}, of the model's {model.options.frames} frames"
        raise option_error("--keep", expected=expected, got=command.keep)
    sample = SampleOptions(
        sampler=command.sampler,
        steps=command.steps,
        guidance=command.guidance,
        temperature=command.temperature,
        tries=command.tries or (TRIES if judges(model.layout, scene) else 1),
    )
    return AnimateWork(
        out=command.out,
        prompts=command.prompt,
        plays=command.plays,
        seed=command.seed,
        options=GenerateOptions(
            sample=sample, keep=command.keep, keyframe_hz=command.keyframe_hz, settle=command.settle
        ),
        model_sha256=digest,
        camera=command.camera,
    )


def _animate(command: AnimateCommand, model: "AnimationModel", scene: "Scene", work: "AnimateWork") -> int:
    from datetime import UTC, datetime

    from pgm_data.provenance import plain, run_document
    from pgm_models.animation.play_run import OtherPlays, animate_work

    started = datetime.now(UTC)
    progress = Progress(total=len(work.prompts) * work.plays, unit="play", interval_s=5.0)

    def document(inputs: Sequence[Mapping[str, object]], plays: Mapping[str, object]) -> dict:
        options = {"animate": plain(command), "model_sha256": work.model_sha256, "plays": dict(plays)}
        return run_document(command="pgm animate", options=options, started=started, inputs=inputs)

    try:
        with prepare_output(command.out, resume=command.resume, overwrite=command.overwrite) as output:
            if command.onnx:
                _run_by_onnx(model, output.state_dir / "step.onnx", work.model_sha256, command.threads or 2)
            outcomes = animate_work(
                work,
                model,
                scene,
                resume=command.resume,
                tell=lambda event: _tell(progress, event),
                run_document=document,
            )
    except OtherPlays as error:
        raise UsageError(str(error)) from error
    finally:
        progress.close()
    return _report(outcomes)


def _run_by_onnx(model: "AnimationModel", path: Path, digest: str, threads: int) -> None:
    """Have onnxruntime run the model's network, from a file that is written unless it is there."""
    from pgm_models.animation.network import Denoiser
    from pgm_models.animation.step_export import export_step
    from pgm_models.animation.step_onnx import OnnxStep

    if not isinstance(model.denoiser, Denoiser):
        raise option_error("--onnx", expected="a model that is a transformer", got=model.options.design.network)
    if not path.is_file() or OnnxStep(path, threads).metadata.get("model_sha256") != digest:
        export_step(model.denoiser, path, metadata={"model_sha256": digest})
    model.step = OnnxStep(path, threads)


def _report(outcomes: "Sequence[JobOutcome]") -> int:
    """Print what became of the plays; the exit code."""
    print(table_text(HEADER, [_cells(outcome) for outcome in outcomes]))
    for outcome in outcomes:
        for warning in (outcome.result or {}).get("warnings", ()):
            print(f"warning: {outcome.name}: {warning}")
    failed = [outcome for outcome in outcomes if outcome.state == "failed"]
    for outcome in failed:
        print_error(f"{outcome.name}: {outcome.reason}")
    return 0 if not failed else SOME_FAILED if len(failed) < len(outcomes) else NOTHING_USABLE


def _cells(outcome: "JobOutcome") -> tuple[object, ...]:
    result = outcome.result
    if result is None:
        reason = outcome.reason if len(outcome.reason) <= 80 else outcome.reason[:77] + "..."
        return outcome.name, outcome.state, None, None, None, None, reason
    trouble = f"{len(result['warnings'])} warnings" if result["warnings"] else ""
    speed = result["frames"] / max(result["generation_s"], 1e-9)
    state = "done before" if outcome.resumed else outcome.state
    return outcome.name, state, result["frames"], result["seed"], result["first_stage_hz"], speed, trouble


def _tell(progress: Progress, event: "JobEvent") -> None:
    if event.kind == "progress" and event.detail is not None:
        progress.update(event.name, event.share, f"frame {event.detail['progress']} of {event.detail['total']}")
    elif event.kind == "done":
        progress.finish(event.name, f"{event.name}: done")
    elif event.kind == "skipped":
        progress.finish(event.name, f"{event.name}: done before")
    elif event.kind == "failed":
        progress.finish(event.name, f"{event.name}: failed")
