"""`pgm play RUN_ANIM RUN_SYN`: a page where a person moves players and ball, says what happens, and sees it played."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from .console import UsageError, check_ranges, option_error
from .models import loaded

if TYPE_CHECKING:
    from pgm_data.scene import Scene
    from pgm_models.animation.model import AnimationModel
    from pgm_models.synthesis.play_server import Renderer

    LoadRenderer = Callable[[Path, str], Renderer]


@dataclass(frozen=True, kw_only=True)
class PlayCommand:
    """Play with trained models in the browser: put players and ball on a top view, say what they do, see it played.

    The page is served to this machine alone until Ctrl-C, at an address with a secret in it. Prompts made there are
    those of pgm animate, and can be saved for it.
    """

    run_anim: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN_ANIM")]
    """Run of pgm-train animation, a model file, or the name of a model that ships with pgm."""
    run_syn: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[RUN_SYN]")] = None
    """Run of pgm-train synthesis, which renders the play; without one it is drawn as figures."""
    scene: str = ""
    """Scene file of models whose scene does not ship with pgm."""
    steps: int = 16
    """Evaluations of the animation network for each window."""
    tries: int = 1
    """Samples of each window, of which the one is kept whose ball turns least in mid-air: several keep words better."""
    guidance: float = 1.0
    """How far to go beyond what the words say; others than 1 take two evaluations a step."""
    settle: bool = True
    """Bring feet and ball onto what they can do: standing feet rest, and the ball flies as gravity and air have it."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""
    threads: int = 0
    """CPU threads; 0 for as many as PyTorch takes."""
    port: int = 0
    """Port to serve on; 0 for a free one."""
    open: bool = True
    """Open the page in the browser."""
    seconds: float = 0.0
    """End by itself after so long; 0 to serve until Ctrl-C."""


def main(argv: list[str], load_renderer: "LoadRenderer | None" = None) -> int:
    """Run the command; its exit code.

    Args:
        argv: Words of the command line.
        load_renderer: Reads a synthesis run for a device, as the option names it, in place of what reads those of
            pgm-train; raises ValueError where it is none.
    """
    command = tyro.cli(PlayCommand, args=argv, prog="pgm play")
    _check(command)
    import torch

    if command.threads:
        torch.set_num_threads(command.threads)
    from pgm_models.animation.model import load_model

    model = loaded(load_model, command.run_anim, command.device, place="RUN_ANIM")
    scene = _scene(command, model)
    renderer = None
    if command.run_syn is not None:
        if load_renderer is None:
            from pgm_models.synthesis.render_play import load_renderer
        renderer = _renderer(command, command.run_syn, scene, load_renderer)
    return _serve(command, model, scene, renderer)


def _check(command: PlayCommand) -> None:
    """Refuse options that cannot be, before anything is loaded."""
    check_ranges(
        ("--steps", command.steps, 1, 1000),
        ("--tries", command.tries, 1, 1000),
        ("--guidance", command.guidance, -100.0, 100.0),
        ("--threads", command.threads, 0, 1024),
        ("--port", command.port, 0, 65535),
        ("--seconds", command.seconds, 0.0, 1e9),
    )


def _scene(command: PlayCommand, model: "AnimationModel") -> "Scene":
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(command.scene or model.layout.scene)
    except ValueError as error:
        raise UsageError(f"--scene: {error}") from error
    if scene.name != model.layout.scene:
        raise option_error("--scene", expected=f"{model.layout.scene}, of the model", got=scene.name)
    return scene


def _renderer(command: PlayCommand, run: Path, scene: "Scene", load: "LoadRenderer") -> "Renderer":
    try:
        renderer = load(run, command.device)
    except ValueError as error:
        raise UsageError(f"RUN_SYN: {error}") from error
    if renderer.scene != scene.name:
        raise option_error("RUN_SYN", expected=f"a model of {scene.name}, as RUN_ANIM is", got=renderer.scene)
    return renderer


def _serve(command: PlayCommand, model: "AnimationModel", scene: "Scene", renderer: "Renderer | None") -> int:
    from pgm_models.animation.generate import GenerateOptions
    from pgm_models.animation.sample import SampleOptions
    from pgm_models.synthesis.play_maker import rally_maker
    from pgm_models.synthesis.play_server import PlayServer
    from pgm_models.synthesis.play_stage import Stage

    sample = SampleOptions(steps=command.steps, guidance=command.guidance, tries=command.tries)
    make = rally_maker(model, scene, GenerateOptions(sample=sample, settle=command.settle))
    stage = Stage(
        scene=scene,
        layout=model.layout,
        rates=model.options.rates,
        animation=command.run_anim.name,
        synthesis="" if command.run_syn is None else command.run_syn.name,
        picture=(512, 288) if renderer is None else renderer.picture,
    )
    try:
        server = PlayServer(stage, make, None if renderer is None else renderer.render, port=command.port)
    except OSError as error:
        raise option_error("--port", expected="one that is free", got=f"{command.port}: {error.strerror}") from error
    with server:
        print(f"{server.url}   {scene.name}; Ctrl-C ends it", flush=True)
        if command.open:
            import webbrowser

            webbrowser.open(server.url)
        _wait(command.seconds)
    return 0


def _wait(seconds: float) -> None:
    """Until Ctrl-C, or for so long where that is above 0."""
    ends = time.monotonic() + seconds if seconds else float("inf")
    try:
        while (left := ends - time.monotonic()) > 0:
            time.sleep(min(left, 0.2))
    except KeyboardInterrupt:
        pass  # the way to end it
