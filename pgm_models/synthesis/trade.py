"""`pgm trade synthesis`: designs and sizes of the synthesis model, trained at one budget: likeness against speed."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

import torch

from pgm_data.provenance import commit, machine, versions
from pgm_data.stages.jobs import JobEvent
from pgm_data.stages.trade_run import TradeRun, write_text
from pgm_models.animation.trade_plots import speed_svg
from pgm_models.model_trade import run_model_trade, trade_manner
from pgm_models.synthesis.presets import PRESETS, SYNTHESIS_DESIGNS, Preset, PresetChanges
from pgm_models.synthesis.trade_runs import RunManner, Training, evaluation_job, training_job
from pgm_models.synthesis.trade_tables import Row, figures_csv, part_curves, part_table, speed_panels

Part = Literal["designs", "samples", "voxels", "enhancer", "stylising", "resolution"]
SHARES_OF_SAMPLES = (0.125, 0.25, 0.5, 1.0)
"""Of the preset's, that are compared; more than it has a scene may not allow."""
SHARES_OF_VOXELS = (0.25, 0.5, 1.0)
SHARES_OF_WIDTH = (0.0, 0.5, 1.0, 2.0)
"""Of the enhancer's channels; 0 for no enhancer."""
SHARES_OF_HEIGHT = (0.25, 0.5, 0.75, 1.0)
TITLES: Mapping[str, str] = {
    "ours": "ours",
    "no_enhancer": "without the enhancer",
    "no_deformation": "without skinning",
    "no_planes": "without planes",
    "no_voxels": "without voxels",
    "no_style_encoder": "without the shared style encoder",
    "playable": "as Playable Environments",
}
HEADINGS: Mapping[Part, str] = {
    "designs": "Designs at one budget",
    "samples": "Samples of a ray in players and worlds",
    "voxels": "Voxels along the longest axis",
    "enhancer": "Channels of the enhancer, the finest scale first",
    "stylising": "What is dressed in a style",
    "resolution": "Height of the pictures, which are learned, rendered and judged at that size",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class SynthesisTradeOptions:
    """What is compared, on what."""

    manner: RunManner
    """How everything is trained and evaluated."""
    state_dir: Path
    """Folder of the jobs' state."""
    parts: tuple[Part, ...] = get_args(Part)
    designs: tuple[str, ...] = tuple(SYNTHESIS_DESIGNS)
    """For the part `designs`."""
    seeds: int = 1
    """Trainings of each model."""
    workers: int = 1
    """Trainings at a time; evaluations are one at a time, as their times count."""
    resume: bool = False


def run_synthesis_trade(
    options: SynthesisTradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeRun:
    """Train and evaluate; writes `trade.md`, `trade.svg`, `trade.csv`, `trade.json` and `rows.jsonl` as it goes.

    Args:
        options: What is compared.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part of the run.
    """
    models = list({model.name: model for part in trainings(options).values() for model in part.values()}.values())
    seeded = [replace(model, seed=seed) for model in models for seed in range(options.seeds)]
    return run_model_trade(
        [[job(model, options.manner) for model in seeded] for job in (training_job, evaluation_job)],
        manner=trade_manner(options.state_dir, workers=options.workers, resume=options.resume),
        write=lambda rows: write_figures(options, rows),
        on_event=on_event,
        on_jobs=on_jobs,
    )


def trainings(options: SynthesisTradeOptions) -> dict[Part, dict[str, Training]]:
    """What is trained for each part that is asked for, by the name of its row; parts share what is the preset's own."""
    preset = PRESETS[options.manner.preset]
    wanted: dict[Part, dict[str, Training]] = {}
    for part in options.parts:
        if part == "designs":
            wanted[part] = {TITLES[design]: Training(design=design) for design in options.designs}
        else:
            changes = {name: _without_own(each, preset) for name, each in sweep(part, preset).items()}
            wanted[part] = {name: Training(changes=each) for name, each in changes.items()}
    return wanted


def sweep(part: Part, preset: Preset) -> dict[str, PresetChanges]:
    """What a part compares, by the name of its row, in the order of its plot."""
    match part:
        case "samples":
            counts = _shares(preset.fields.samples, SHARES_OF_SAMPLES, least=1)
            return {str(count): PresetChanges(samples=count) for count in counts}
        case "voxels":
            counts = _shares(preset.fields.voxels, SHARES_OF_VOXELS, least=2)
            return {str(count): PresetChanges(voxels=count) for count in counts}
        case "enhancer":
            own = preset.enhancer.widths
            several = [tuple(max(1, round(share * width)) for width in own) * (share > 0) for share in SHARES_OF_WIDTH]
            return {"-".join(map(str, widths)) or "none": PresetChanges(enhancer=widths) for widths in several}
        case "stylising":
            return {"grid": PresetChanges(stylising="grid"), "sample": PresetChanges(stylising="sample")}
        case "resolution":
            heights = _shares(preset.picture[1], SHARES_OF_HEIGHT, least=8)
            return {str(height): PresetChanges(height=height) for height in heights}
        case "designs":
            raise ValueError("part: expected one that changes numbers of a preset, got designs")


def _shares(count: int, shares: Sequence[float], *, least: int) -> list[int]:
    return list(dict.fromkeys(max(least, round(share * count)) for share in shares))


def _without_own(changes: PresetChanges, preset: Preset) -> PresetChanges:
    """The changes less what the preset has already: a model has one name."""
    own = {
        "samples": preset.fields.samples,
        "voxels": preset.fields.voxels,
        "enhancer": preset.enhancer.widths,
        "stylising": preset.fields.stylising,
        "height": preset.picture[1],
    }
    return PresetChanges(**{name: value for name, value in vars(changes).items() if value not in (0, None, own[name])})


def write_figures(options: SynthesisTradeOptions, rows: Sequence[dict]) -> str:
    """Write the figures of those rows into the trade's folder; all tables in Markdown."""
    found: dict[Part, list[Row]] = {}
    for part, models in trainings(options).items():
        own = [_row(name, model, options.seeds, rows) for name, model in models.items()]
        there = [row for row in own if row.results]
        if there:
            found[part] = there
    texts = ["# The synthesis model: what each choice brings"]
    texts += [f"## {HEADINGS[part]}\n\n{part_table(own)}" for part, own in found.items()]
    made = _provenance(options)
    texts.append(_made_with(made, rows))
    table = "\n\n".join(texts)
    out = options.manner.out
    document = {"made": made, "table": table, "trainings": [row for row in rows if row["kind"] == "training"]}
    write_text(out / "rows.jsonl", "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
    write_text(out / "trade.csv", figures_csv({str(part): own for part, own in found.items()}))
    write_text(out / "trade.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
    write_text(out / "trade.md", table + "\n")
    write_text(out / "trade.svg", speed_svg(speed_panels([part_curves(part, own) for part, own in found.items()])))
    return table


def _row(name: str, model: Training, seeds: int, rows: Sequence[dict]) -> Row:
    names = {replace(model, seed=seed).name for seed in range(seeds)}
    own = [row for row in rows if row["name"] in names]
    return Row(
        name=name,
        results=[row["result"] for row in own if row["kind"] == "evaluation"],
        trainings=[row for row in own if row["kind"] == "training"],
    )


def _provenance(options: SynthesisTradeOptions) -> dict[str, object]:
    """With what, where and how the figures were made."""
    manner = options.manner
    return {
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else "",
        "load": [round(value, 2) for value in os.getloadavg()] if hasattr(os, "getloadavg") else [],
        "versions": versions(),
        "commit": commit(),
        "preset": manner.preset,
        "steps": manner.steps,
        "minutes": manner.minutes,
        "seeds": options.seeds,
        "frames": manner.frames,
        "held_out": manner.held_out,
        "perceptual": manner.perceptual is not None,
        "device": manner.device,
        "threads": manner.threads,
        "jobs": options.workers,
        "dataset": str(manner.dataset),
        "test": "held-out ends of the dataset's matches" if manner.test is None else str(manner.test),
        "masks": "the renderer's own" if manner.truth is None else "true ones",
    }


def _made_with(made: Mapping, rows: Sequence[dict]) -> str:
    """The same in words, and what training took."""
    where, used = made["machine"], made["versions"]
    trained = [row for row in rows if row["kind"] == "training"]
    devices = ", ".join(sorted({row["device"] for row in trained})) or made["device"]
    hours = sum(row["seconds"] for row in trained) / 3600
    judged = sorted({row["result"]["frames"] for row in rows if row["kind"] == "evaluation"})
    named = ", ".join(f"{name} {used[name]}" for name in ("pgm", "python", "torch", "numpy") if name in used)
    lines = [
        f"machine: {where['processor']}, {where['cores']} cores, load {made['load']}, {made['gpu'] or 'no GPU'}; "
        f"{made['threads']} threads a job; times are those of pictures, fields grown and dressed before",
        f"models: preset {made['preset']}, {made['seeds']} seeds; trained on {devices}, {len(trained)} models in "
        f"{hours:.2f} hours together, {made['jobs']} at a time",
        f"judged: {' or '.join(map(str, judged)) or 'no'} frames of {made['test']}, masks {made['masks']}",
        f"commit {made['commit'] or 'unknown'}; versions: {named}",
    ]
    return "## Made with\n\n" + "\n".join(f"- {line}" for line in lines)
