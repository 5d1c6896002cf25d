"""`pgm trade simulate`: what simulated worlds are like, against real shots and against physics, and what they cost."""

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_data.simulate.clip import simulate_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.tennis.caption_figures import CaptionFigures, figures_of
from pgm_data.stages.histograms import Pair, histograms_svg
from pgm_data.stages.shot_samples import distance, real_sample, simulated_sample
from pgm_data.stages.simulate_physics import PhysicsFigures, match_plays, measure_physics
from pgm_data.stages.simulate_sheet import write_sheet
from pgm_data.stages.simulate_speed import Run, timed_simulate

SIZES = {"tennis": (1280, 720), "blocks": (1024, 576)}
RATES = {"tennis": 25.0, "blocks": 20.0}
FEWEST = 30
"""Real values below which a quantity is not compared."""


@dataclass(frozen=True, kw_only=True)
class SimulateTradeOptions:
    """What is measured."""

    out: Path
    plays: int = 1000
    """Tennis plays for physics and shots."""
    bodies: int = 200
    """Of them, those in which bodies are posed and measured."""
    real: Path | None = None
    """Folder of real data with `ball/` in it."""
    minutes: float = 60.0
    """Length of the match without pictures that is timed, and of the captions that are counted."""
    seconds: float = 20.0
    """Length of each of the two videos that are timed per kind of pictures."""
    seed: int = 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Distance:
    """One quantity of real and of simulated shots."""

    name: str
    real: int
    """Values."""
    simulated: int
    real_median: float
    simulated_median: float
    moved: float
    """Wasserstein distance over the real standard deviation."""
    overlap: float
    """Of the histograms; 1 is the same."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulateFigures:
    """Everything that was measured."""

    physics: PhysicsFigures
    distances: tuple[Distance, ...]
    captions: dict[str, CaptionFigures]
    """By scene."""
    runs: tuple[Run, ...]


def run_simulate_trade(options: SimulateTradeOptions, said: Callable[[str], None]) -> SimulateFigures:
    """Measure, and write trade.md, trade.json, shots.svg and a contact sheet per scene into the folder.

    Raises:
        ValueError: If the real data cannot be read.
        RuntimeError: If `pgm simulate` fails.
    """
    tennis = load_scene("tennis")
    said("shots and physics")
    distances: tuple[Distance, ...] = ()
    if options.real is not None:
        distances = _compare(options, options.real)
    physics = measure_physics(tennis, options.seed, options.plays, bodies=options.bodies)
    said("captions")
    captions = {name: _captions(name, options) for name in SIZES}
    said("contact sheets")
    for name, size in SIZES.items():
        write_sheet(options.out / f"{name}.jpg", load_scene(name), options.seed, size=size, fps=RATES[name])
    said("speed")
    figures = SimulateFigures(physics=physics, distances=distances, captions=captions, runs=_runs(options))
    _write(options.out / "trade.md", report(figures))
    _write(options.out / "trade.json", json.dumps(asdict(figures), indent=2) + "\n")
    return figures


def _compare(options: SimulateTradeOptions, real: Path) -> tuple[Distance, ...]:
    """The shots' quantities, and their histograms as `shots.svg`."""
    try:
        truth = real_sample(real / "ball")
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{real / 'ball'}: expected shots and Hawk-Eye points, got: {error}") from error
    made = simulated_sample(play for _, play in match_plays(load_scene("tennis"), options.seed, options.plays))
    rows, pairs = [], []
    for name, values in truth.items():
        if len(values) < FEWEST or len(made.get(name, ())) < FEWEST:
            continue
        moved, overlap = distance(made[name], values)
        rows.append(
            Distance(
                name=name,
                real=len(values),
                simulated=len(made[name]),
                real_median=float(np.median(values)),
                simulated_median=float(np.median(made[name])),
                moved=moved,
                overlap=overlap,
            )
        )
        note = f"overlap {overlap:.2f}, moved {moved:.2f} sd"
        pairs.append(Pair(name=name, unit=_unit(name), note=note, real=values, simulated=made[name]))
    _write(options.out / "shots.svg", histograms_svg(pairs))
    return tuple(rows)


def _unit(name: str) -> str:
    units = {"speed": "m/s", "spin": "rpm", "interval": "s", "point": ""}
    return units.get(name.split()[-1], "m")


def _captions(scene: str, options: SimulateTradeOptions) -> CaptionFigures:
    """Of a match of so many minutes, without cuts away."""
    fps = RATES[scene]
    clip = ClipOptions(frames=round(60 * options.minutes * fps), width=64, height=36, fps=fps, motion="still")
    shots = simulate_shots(load_scene(scene), clip, options.seed)
    return figures_of(c for shot in shots if shot.states is not None for c in shot.states.captions)


def _runs(options: SimulateTradeOptions) -> tuple[Run, ...]:
    """Time and memory of whole commands; what they write is deleted."""
    runs = []

    def run(what: str, frames: int, *arguments: str) -> None:
        folder = options.out / "timed"
        shutil.rmtree(folder, ignore_errors=True)
        try:
            runs.append(timed_simulate(what, [*arguments, "--seed", str(options.seed)], frames, folder))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    # The first run compiles what the others find compiled.
    run("warm-up", 10, "--matches", "1", "--minutes", "0.01")
    runs.clear()
    for share in (0.25, 1.0):
        minutes = share * options.minutes
        frames = round(60 * minutes * RATES["tennis"])
        words = ("--no-closeups", "--pictures", "none", "--minutes", f"{minutes:.6f}")
        run(f"tennis, {minutes:g} min of states, one process", frames, "--matches", "1", "--jobs", "1", *words)
    half = options.minutes / 2
    frames = 2 * round(60 * half * RATES["tennis"])
    words = ("--no-closeups", "--pictures", "none", "--minutes", f"{half:.6f}")
    run(f"tennis, 2 x {half:g} min of states, two processes", frames, "--matches", "2", "--jobs", "2", *words)
    for scene, size in SIZES.items():
        for pictures in ("draft", "full"):
            frames = 2 * round(options.seconds * RATES[scene])
            words = ("--scene", scene, "--pictures", pictures, "--minutes", f"{options.seconds / 60:.6f}")
            what = f"{scene}, {pictures} pictures {size[0]}x{size[1]}, two processes"
            run(what, frames, "--matches", "2", "--jobs", "2", *words)
    return tuple(runs)


def report(figures: SimulateFigures) -> str:
    """Everything as Markdown."""
    p = figures.physics
    drops = ", ".join(f"{name} {100 * ratio:.1f} %" for name, ratio in p.drop_ratio.items())

    def spread(values: tuple[float, float, float]) -> str:
        low, middle, high = (100 * v for v in values)
        return f"{middle:.1f} % (5 to 95 % of them: {low:.1f} to {high:.1f} %)"

    lines = [
        "# What `pgm simulate` makes",
        "",
        f"## Physics of {p.plays} plays",
        "",
        "| law | figure |",
        "| --- | --- |",
        f"| flights | {p.flights} |",
        f"| largest gain of energy in a flight | {p.energy_gain:.1e} of it |",
        f"| rebound in the ITF's drop test (53 to 58 %) | {drops} |",
        f"| speed that first serves lose to the bounce | {spread(p.serve_loss)} |",
        f"| the same of forehand drives at 28 to 34 m/s | {spread(p.forehand_loss)} |",
        f"| slide of a planted foot, {p.stances} stances | largest {1000 * p.slide_m[1]:.2f} mm |",
        f"| deepest sole under the ground, {p.frames} frames | {1000 * p.penetration_m:.2f} mm |",
        f"| largest turn of a joint beyond human limits | {p.joint_excess_deg:.1f} degrees |",
        f"| ball to strings at {p.hits} hits | 99 % within {100 * p.racket_m[0]:.2f} cm, "
        f"largest {100 * p.racket_m[1]:.2f} cm |",
        "",
        "## Captions",
        "",
        "| scene | spans | different | different words | words a caption | seconds a span |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for scene, c in figures.captions.items():
        lines.append(
            f"| {scene} | {c.captions} | {c.distinct} | {c.words} | {c.average_words:.1f} | {c.average_span_s:.2f} |"
        )
    lines += ["", "## Cost", "", "| run | frames/s | wall s | cpu s | MB | load before |", "| - | - | - | - | - | - |"]
    for run in figures.runs:
        lines.append(
            f"| {run.what} | {run.frames_per_second:.1f} | {run.seconds:.1f} | {run.cpu_s:.1f} | {run.memory_mb:.0f} "
            f"| {run.load:.1f} |"
        )
    if figures.distances:
        lines += ["", "## Shots against real ones", "", "![histograms](shots.svg)", ""]
        lines += ["| quantity | real | simulated | real median | simulated | moved, sd | overlap |"]
        lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
        for d in figures.distances:
            lines.append(
                f"| {d.name} | {d.real} | {d.simulated} | {d.real_median:.2f} | {d.simulated_median:.2f} "
                f"| {d.moved:.2f} | {d.overlap:.2f} |"
            )
        overlaps = np.array([d.overlap for d in figures.distances])
        lines += ["", f"Median overlap {np.median(overlaps):.2f}, lowest {overlaps.min():.2f}."]
    return "\n".join(lines) + "\n"


def _write(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
