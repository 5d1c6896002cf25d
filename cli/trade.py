"""`pgm trade STAGE [DATA] --out DIR`: every preset of a stage on data with truth."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from .console import check_ranges, option_error, print_error
from .output import OutputFolder, prepare_output
from .simulate import picture_size
from .trade_animation import trade_animation
from .trade_ball import trade_ball3d
from .trade_jobs import NOTHING_USABLE, carried_out
from .trade_pipeline import trade_pipeline
from .trade_players import trade_players
from .trade_synthesis import trade_synthesis

if TYPE_CHECKING:
    from pgm_data.stages.trade_calibrate import TradeOptions


@dataclass(frozen=True, kw_only=True)
class CalibrateTrade:
    """Error, time, memory and false cameras of every preset of pgm-calibrate, on clips whose truth is known.

    Writes trade.md, trade.svg, trade.json and rows.jsonl. The drawn clips stay in OUT/simulated, which can be DATA of
    another run. Times are those of this machine with so many workers at once.
    """

    data: tyro.conf.Positional[Path | None] = None
    """Folder that `pgm simulate` wrote; clips are drawn unless given."""
    out: Path
    """Folder to write into, new or empty."""
    quality: tuple[Literal["draft", "standard", "best"], ...] = ("draft", "standard", "best")
    """Presets to run."""
    clips: int = 200
    """Clips to draw where DATA is not given; 0 for none."""
    frames: int = 100
    """Frames of each clip."""
    resolution: str = "1280x720"
    """Width x height of the drawn clips, pixels."""
    negatives: int = 500
    """Pictures without a court in which cameras are looked for; 0 for none."""
    real: Path | None = None
    """Folder of real clips with court_keypoints.json and net_center_top.json, scored but never learned from."""
    scene: str = "tennis"
    """Scene whose court is sought."""
    network: str = ""
    """ONNX file of a court network instead of the bundled one; `none` for lines alone."""
    seed: int = 0
    """What is drawn depends on this and the options alone."""
    workers: int = 1
    """Jobs at a time."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped; figures that it has are kept as they are."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    return tyro.extras.subcommand_cli_from_dict(
        {
            "calibrate": _calibrate,
            "simulate": _simulate,
            "players": trade_players,
            "ball3d": trade_ball3d,
            "pipeline": trade_pipeline,
            "animation": trade_animation,
            "synthesis": trade_synthesis,
        },
        args=argv,
        prog="pgm trade",
        description="Accuracy against time of every preset of a stage, on data with truth.",
    )


@dataclass(frozen=True, kw_only=True)
class SimulateTrade:
    """What simulated scenes are like: physics, captions, time and memory, and shots against real ones.

    Writes trade.md, trade.json, a contact sheet per scene, and shots.svg where real data are given.
    """

    out: Path
    """Folder to write into, new or empty."""
    plays: int = 1000
    """Tennis plays for physics and shots."""
    bodies: int = 200
    """Of them, those in which bodies are posed and measured."""
    minutes: float = 60.0
    """Length of the match without pictures that is timed."""
    seconds: float = 20.0
    """Length of each video that is timed."""
    real: Path | None = None
    """Folder of real data with `ball/` in it: shots to compare with, never learned from."""
    seed: int = 0
    """What is drawn depends on this and the options alone."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


def _simulate(options: Annotated[SimulateTrade, tyro.conf.arg(name="")]) -> int:
    """What simulated scenes are like: physics, captions, time and memory, and shots against real ones."""
    check_ranges(
        ("--plays", options.plays, 1, 1_000_000),
        ("--bodies", options.bodies, 0, options.plays),
        ("--minutes", options.minutes, 0.01, 600.0),
        ("--seconds", options.seconds, 0.1, 3600.0),
        ("--seed", options.seed, 0, 2**31),
    )
    if options.real is not None and not (options.real / "ball").is_dir():
        raise option_error("--real", expected="a folder with ball/ in it", got=options.real)
    from datetime import UTC, datetime

    from pgm_data.dataset.documents import write_document
    from pgm_data.provenance import run_document
    from pgm_data.stages.trade_simulate import SimulateTradeOptions, report, run_simulate_trade

    started = datetime.now(UTC)
    with prepare_output(options.out, resume=False, overwrite=options.overwrite):
        trade = SimulateTradeOptions(
            out=options.out,
            plays=options.plays,
            bodies=options.bodies,
            real=options.real,
            minutes=options.minutes,
            seconds=options.seconds,
            seed=options.seed,
        )
        try:
            figures = run_simulate_trade(trade, said=lambda part: print(part, flush=True))
        except ValueError as error:
            print_error(str(error))
            return NOTHING_USABLE
        document = run_document(command="pgm trade simulate", options=options, started=started, inputs=[])
        write_document(options.out / "run.json", "run", document)
    print(report(figures))
    return 0


def _calibrate(options: Annotated[CalibrateTrade, tyro.conf.arg(name="")]) -> int:
    """Error, time, memory and false cameras of every preset of pgm-calibrate, on clips whose truth is known."""
    _check(options)
    from pgm_data.stages.trade_calibrate import run_trade

    return carried_out(
        "calibrate",
        options,
        lambda folder, progress: run_trade(_trade(options, folder), on_event=progress.tell, on_jobs=progress.begin),
    )


def _check(options: CalibrateTrade) -> None:
    check_ranges(
        ("--clips", options.clips, 0, 100_000),
        ("--frames", options.frames, 5, 100_000),
        ("--negatives", options.negatives, 0, 1_000_000),
        ("--seed", options.seed, 0, 2**31),
        ("--workers", options.workers, 1, 1024),
    )
    if not options.quality or len(set(options.quality)) < len(options.quality):
        raise option_error("--quality", expected="presets, each once", got=" ".join(options.quality) or "none")
    for name, path in (("DATA", options.data), ("--real", options.real)):
        if path is not None and not path.is_dir():
            raise option_error(name, expected="a folder", got=path)
    if options.network not in ("", "none") and not Path(options.network).is_file():
        raise option_error("--network", expected="an ONNX file or none", got=options.network)
    picture_size(options.resolution, (1280, 720))
    from pgm_data.scene import load_scene

    try:
        scene = load_scene(options.scene)
    except ValueError as error:
        raise option_error("--scene", expected="a scene", got=error) from error
    if scene.court is None:
        raise option_error("--scene", expected="a scene with a court", got=options.scene)


def _trade(options: CalibrateTrade, folder: OutputFolder) -> "TradeOptions":
    from pgm_data.stages.trade_calibrate import TradeOptions

    network = options.network
    return TradeOptions(
        out=options.out,
        state_dir=folder.state_dir,
        scene=options.scene,
        qualities=options.quality,
        network=network if network in ("", "none") else str(Path(network).resolve()),
        data=options.data,
        clips=options.clips,
        frames=options.frames,
        negatives=options.negatives,
        real=options.real,
        size=picture_size(options.resolution, (1280, 720)),
        seed=options.seed,
        workers=options.workers,
        resume=options.resume,
    )
