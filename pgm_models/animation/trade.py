"""`pgm trade animation`: designs, masks, shares of the data and samplers of the animation model, at one budget."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, get_args

import torch

from pgm_data.provenance import commit, machine, versions
from pgm_data.stages.jobs import Job, JobEvent
from pgm_data.stages.trade_run import TradeRun, write_text
from pgm_models.animation.evaluate_run import DIGITS
from pgm_models.animation.evaluate_tables import main_table, scores_csv, several_table
from pgm_models.animation.evaluation_result import (
    EvaluationResult,
    distance_ratio,
    floor_subtracted_ratio,
    result_from_json,
)
from pgm_models.animation.masks import MASKS
from pgm_models.animation.presets import DESIGNS
from pgm_models.animation.trade_plots import Curve, SpeedPanel, speed_svg
from pgm_models.animation.trade_runs import Evaluation, RunManner, Training, evaluation_job, training_job
from pgm_models.animation.trade_tables import (
    Results,
    error,
    physics_table,
    quality,
    ratio_document,
    ratio_lines,
    speed_table,
    task_ratio_lines,
)
from pgm_models.model_trade import known_rows, run_model_trade, trade_manner

Part = Literal["designs", "masks", "share", "steps"]
SHARES = (0.2, 0.5, 1.0)
SEVERAL_SEEDS = ("ours", "paper", "transformer")
"""Designs that are trained with all seeds; the others with the first."""
TITLES: Mapping[str, str] = {
    "ours": "ours",
    "velocity": "ours without prior, own guess and nearness",
    "paper": "the paper's design",
    "transformer": "reconstruction transformer",
    "lstm": "reconstruction LSTM",
    "playable": "LSTM an object, adversarial",
}
OURS = "ours, sde_2m, 16 steps"
"""Row that the others are compared with."""
SWEEPS: Mapping[str, tuple[int, ...]] = {
    "sde_2m": (1, 2, 4, 8, 16, 32, 64),
    "dpmpp_2m": (1, 2, 4, 8, 16, 32, 64),
    "ddim": (1, 2, 4, 8, 16, 32, 64),
    "ddpm": (4, 8, 16, 32, 64, 250),
}
"""Steps of each sampler that are compared."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AnimationTradeOptions:
    """What is compared, on what."""

    manner: RunManner
    """How everything is trained and evaluated."""
    state_dir: Path
    """Folder of the jobs' state."""
    parts: tuple[Part, ...] = get_args(Part)
    designs: tuple[str, ...] = ("ours", "velocity", "paper", "transformer", "lstm", "playable")
    """Of `DESIGNS`, for the part `designs`."""
    seeds: int = 3
    """Of ours, of the paper's design and of the reconstruction transformer."""
    windows: int = 2_048
    """Windows of an evaluation."""
    few_windows: int = 512
    """Of those with 250 and 1000 steps, and of the comparison of steps."""
    most_steps: int = 1_000
    """Comparisons of more steps are left out."""
    workers: int = 1
    """Jobs at a time; the comparison of steps is always one at a time, as its times count."""
    known: tuple[Path, ...] = ()
    """`rows.jsonl` of other trades under the same conditions; what they have is not done again."""
    resume: bool = False


def run_animation_trade(
    options: AnimationTradeOptions, *, on_event: Callable[[JobEvent], None], on_jobs: Callable[[int], None]
) -> TradeRun:
    """Train and evaluate; writes `trade.md`, `trade.svg`, `trade.csv`, `trade.json` and `rows.jsonl` after each part.

    Args:
        options: What is compared.
        on_event: Told what happens to jobs.
        on_jobs: Told how many jobs there are, before each part of the run.

    Raises:
        ValueError: If a row that is to be known is none, or was made under other conditions.
    """
    manner = options.manner
    known = known_rows(options.known, manner.conditions()) if options.known else []
    done = set(results_by_name(known))
    wanted: dict[Part, list[Evaluation]] = {
        name: [one for one in part if one.model is None or one.name not in done]
        for name, part in evaluations(options).items()
    }
    models = list(dict.fromkeys(one.model for one in all_of(wanted) if one.model is not None))
    before = [part for name, part in wanted.items() if name != "steps"]
    jobs: list[Sequence[Job]] = [[training_job(model, manner) for model in models]]
    timed = wanted.get("steps", [])
    # What is also timed is left to the last part, in which nothing else runs.
    done |= {one.name for one in timed}
    for part in before:
        new = [one for one in part if one.name not in done]
        done |= {one.name for one in new}
        jobs.append([evaluation_job(one, manner) for one in new])
    jobs.append([evaluation_job(one, manner) for one in timed])
    return run_model_trade(
        jobs,
        manner=trade_manner(options.state_dir, workers=options.workers, resume=options.resume),
        write=lambda rows: write_figures(options, rows),
        known=known,
        on_event=on_event,
        on_jobs=on_jobs,
    )


def evaluations(options: AnimationTradeOptions) -> dict[Part, list[Evaluation]]:
    """What is evaluated in each part that is asked for; parts share what they have in common."""
    whole = Evaluation(model=None, windows=options.windows)
    few = Evaluation(model=None, windows=options.few_windows, several=0, physics=False)
    found: dict[Part, list[Evaluation]] = {}
    if "designs" in options.parts:
        found["designs"] = _of_designs(options, whole, few)
    if "masks" in options.parts:
        found["masks"] = [replace(whole, model=Training(masks=group)) for group in MASKS]
    if "share" in options.parts:
        found["share"] = [replace(whole, model=Training(share=share)) for share in SHARES]
    if "steps" in options.parts:
        model = Training() if options.manner.given is None else None
        found["steps"] = [
            replace(few, model=model, sampler=sampler, steps=steps)
            for sampler, sweep in SWEEPS.items()
            for steps in sweep
            if steps <= options.most_steps
        ]
    return found


def _of_designs(options: AnimationTradeOptions, whole: Evaluation, few: Evaluation) -> list[Evaluation]:
    found = []
    for seed in range(options.seeds):
        for design in options.designs:
            if seed and design not in SEVERAL_SEEDS:
                continue
            own = replace(whole, model=Training(design=design, seed=seed))
            found.append(own if _diffusion(design) else replace(own, steps=1))
        if "paper" in options.designs and options.most_steps >= 250:
            found.append(replace(few, model=Training(seed=seed)))
            found.append(replace(few, model=Training(design="paper", seed=seed), sampler="ddpm", steps=250))
    if "paper" in options.designs and options.most_steps >= 1000:
        found.append(replace(few, model=Training(design="paper"), sampler="ddpm", steps=1000))
    return found


def _diffusion(design: str) -> bool:
    return DESIGNS[design].objective == "diffusion"


def all_of(parts: Mapping[Part, Sequence[Evaluation]]) -> list[Evaluation]:
    """The evaluations of all parts, in order, each once."""
    return list({one.name: one for part in parts.values() for one in part}.values())


def write_figures(options: AnimationTradeOptions, rows: Sequence[dict]) -> str:
    """Write the figures of those rows into the trade's folder; all tables in Markdown."""
    found = results_by_name(rows)
    wanted = evaluations(options)
    parts = ["# The animation model: what each choice brings"]
    document: dict[str, object] = {"ratios": {}}
    everything: dict[str, list[EvaluationResult]] = {}
    panels: list[SpeedPanel] = []
    lines: list[str] = []
    for part, own in wanted.items():
        there = list({one.name: one for one in own if one.name in found}.values())
        if not there:
            continue
        if part == "steps":
            panels = speed_panels(there, found)
        for windows in dict.fromkeys(one.windows for one in there):
            group: dict[str, list[EvaluationResult]] = {}
            for one in there:
                if one.windows == windows:
                    group.setdefault(_row_name(part, one), []).append(found[one.name])
            everything |= {f"{part}: {name}, {windows} windows": results for name, results in group.items()}
            parts.append(f"## {_HEADINGS[part]}, {windows} windows\n\n{speed_table(group)}")
            if part != "steps":
                parts.append(main_table(group))
                several = {name: own for name, own in group.items() if any(one.several_windows for one in own)}
                parts += [f"### Several samples of a window\n\n{several_table(several)}"] if several else []
                parts.append(physics_table(group))
            if part == "designs":
                lines += _design_lines(group, windows, document)
            elif part == "masks":
                lines += _mask_lines(group)
    parts += ["## Ratios", "\n".join(f"- {line}" for line in lines)] if lines else []
    made = _provenance(options)
    parts.append(_made_with(made, rows))
    table = "\n\n".join(part for part in parts if part)
    out = options.manner.out
    document |= {"made": made, "table": table, "trainings": _trainings(rows)}
    write_text(out / "rows.jsonl", "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
    write_text(out / "trade.csv", scores_csv(everything))
    write_text(out / "trade.json", json.dumps(document, indent=1, allow_nan=False) + "\n")
    write_text(out / "trade.md", table + "\n")
    write_text(out / "trade.svg", speed_svg(panels))
    return table


_HEADINGS: Mapping[Part, str] = {
    "designs": "Designs at one budget",
    "masks": "Groups of masking strategies",
    "share": "Shares of the data",
    "steps": "Steps of each sampler",
}


def results_by_name(rows: Sequence[dict]) -> dict[str, EvaluationResult]:
    """The result of each evaluation."""
    return {row["name"]: result_from_json(row["result"]) for row in rows if row["kind"] == "evaluation"}


def _row_name(part: Part, one: Evaluation) -> str:
    """Of the row in its part's tables; what differs in the seed alone shares one."""
    if part == "masks" and one.model is not None:
        return one.model.masks
    if part == "share" and one.model is not None:
        return f"{100 * one.model.share:g} %"
    ways = f"{one.sampler}, {one.steps} step{'s' if one.steps > 1 else ''}"
    if part == "steps" or one.model is None:
        return ways
    title = TITLES.get(one.model.design, one.model.design)
    return f"{title}, {ways}" if _diffusion(one.model.design) else title


def _design_lines(group: Results, windows: int, document: dict) -> list[str]:
    """What the designs' figures are to each other."""
    ours = group.get(OURS, ())
    others = {name: own for name, own in group.items() if name.endswith((" step", " steps")) and name != OURS}
    pairs = [
        (f"{TITLES[design]} over {name}", group.get(TITLES[design], ()), own, " (wanted: 3 or more)" * wanted)
        for design, wanted in (("transformer", True), ("lstm", True), ("playable", False))
        for name, own in {OURS: ours, **others}.items()
    ]
    pairs += [
        (f"{name} over {OURS}", own, ours, " (wanted: 2 or more)" * (TITLES["paper"] in name))
        for name, own in others.items()
    ]
    lines = []
    for what, these, those, wanted in pairs:
        lines += ratio_lines(f"{windows} windows: {what}", these, those, wanted)
        if these and those:
            document["ratios"][f"{windows} windows: {what}"] = {
                "frechet_beyond_chance": ratio_document(floor_subtracted_ratio(these, those)),
                "l2": ratio_document(distance_ratio(these, those)),
            }
    return lines


def _mask_lines(group: Results) -> list[str]:
    lines = []
    for name, own in group.items():
        if name != "all":
            lines += task_ratio_lines(f"masks {name} over all", own, group.get("all", ()))
    return lines


def speed_panels(there: Sequence[Evaluation], found: Mapping[str, EvaluationResult]) -> list[SpeedPanel]:
    """Quality against frames a second, a line a sampler."""
    panels = []
    for title, unit, measure in (
        ("Frechet distance beyond chance", "geometric mean over tasks and properties", quality),
        ("L2 of one sample", "geometric mean over tasks and properties", error),
    ):
        curves = []
        for sampler in dict.fromkeys(one.sampler for one in there):
            own = [one for one in there if one.sampler == sampler]
            curves.append(
                Curve(
                    name=sampler,
                    labels=tuple(str(one.steps) for one in own),
                    speeds=tuple(found[one.name].frames_per_second for one in own),
                    errors=tuple(measure([found[one.name]]) for one in own),
                )
            )
        panels.append(SpeedPanel(title=title, error_unit=unit, curves=tuple(curves)))
    return panels


def _trainings(rows: Sequence[dict]) -> list[dict]:
    return [row for row in rows if row["kind"] == "training"]


def _provenance(options: AnimationTradeOptions) -> dict[str, object]:
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
        "seeds": options.seeds,
        "device": manner.device,
        "threads": manner.threads,
        "jobs": options.workers,
        "rate": manner.rate,
        "training_rates": list(manner.rates),
        "encoder": manner.encoder,
        "dataset": str(manner.dataset),
        "test": str(manner.test),
    }


def _made_with(made: Mapping, rows: Sequence[dict]) -> str:
    """The same in words, and what training took."""
    where, used = made["machine"], made["versions"]
    trained = _trainings(rows)
    devices = ", ".join(sorted({row["device"] for row in trained})) or made["device"]
    steps = " and ".join(str(steps) for steps in sorted({row["steps"] for row in trained})) or made["steps"]
    hours = sum(row["seconds"] for row in trained) / 3600
    named = ", ".join(f"{name} {used[name]}" for name in ("pgm", "python", "torch", "numpy") if name in used)
    known = {(row["machine"], row["commit"][:DIGITS]) for row in rows if row.get("machine")}
    lines = [
        f"machine: {where['processor']}, {where['cores']} cores, load {made['load']}, {made['gpu'] or 'no GPU'}",
        f"models: preset {made['preset']}, {steps} steps, {made['seeds']} seeds of {', '.join(SEVERAL_SEEDS)}; trained "
        f"on {devices}, {len(trained)} models in {hours:.2f} hours together, {made['jobs']} at a time",
        f"windows at {made['rate']:g} frames a second; commit {made['commit'] or 'unknown'}",
        f"versions: {named}",
        *(f"rows made on {on}, commit {of or 'unknown'}" for on, of in sorted(known)),
    ]
    return "## Made with\n\n" + "\n".join(f"- {line}" for line in lines)
