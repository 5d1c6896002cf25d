"""Tables and plots of a trade of the synthesis model, of the summaries of its evaluations."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pgm_data.stages.trade_ball_tables import markdown
from pgm_models.animation.trade_plots import Curve, SpeedPanel

LEVELS = 255
"""Of a colour."""
FIGURES = ("psnr", "lowest_psnr", "ssim", "ms_ssim", "lpips")


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """Models that differ in their seed alone."""

    name: str
    results: Sequence[Mapping[str, Any]]
    """What evaluations found, as `summary_to_json` tells it."""
    trainings: Sequence[Mapping[str, Any]]
    """Steps, seconds and weights."""

    def places(self) -> list[str]:
        """What is judged: the frame, and objects."""
        return list(dict.fromkeys(each["where"] for result in self.results for each in result["likeness"]))

    def likeness(self, figure: str, where: str, stage: str = "final") -> float:
        """Mean over seeds of a figure; NaN where there is none."""
        return _mean(
            each[figure]
            for result in self.results
            for each in result["likeness"]
            if (each["where"], each["stage"]) == (where, stage)
        )

    def players(self) -> float:
        """Mean PSNR of the players, dB."""
        return _mean(self.likeness("psnr", where) for where in self.places() if where.startswith("player"))

    def found(self, figure: str, thing: str) -> float:
        """Mean over seeds of how an object is found in made pictures; NaN where there is none."""
        return _mean(
            each[figure]
            for result in self.results
            for each in result["objects"]
            if each["pictures"] == "made" and each["object"].startswith(thing)
        )

    def frames_per_second(self) -> float:
        """Mean over seeds."""
        return _mean(result["frames_per_second"] for result in self.results)


def _mean(values) -> float:
    there = [float(value) for value in values if value is not None and not math.isnan(float(value))]
    return float(np.mean(there)) if there else math.nan


def part_table(rows: Sequence[Row]) -> str:
    """Likeness to real pictures, what is found, speed and cost, a row a model."""
    places = list(dict.fromkeys(place for row in rows for place in row.places()))
    lines = []
    for row in rows:
        size = "x".join(str(side) for side in row.results[0]["size"])
        lines.append(
            [
                row.name,
                str(len(row.results)),
                size,
                *(f"{row.likeness('psnr', where):.2f}" for where in places),
                f"{row.likeness('psnr', 'frame', 'raw'):.2f}",
                f"{row.likeness('ssim', 'frame'):.4f}",
                f"{100 * row.found('near_share', 'ball'):.1f}",
                f"{100 * row.found('mdr', 'player'):.2f}",
                f"{row.frames_per_second():.2f}",
                f"{_mean(each['weights'] for each in row.trainings) / 1e6:.2f}",
                f"{_mean(each['steps'] for each in row.trainings):.0f}",
                f"{_mean(each['seconds'] for each in row.trainings) / 60:.1f}",
            ]
        )
    head = [
        "model", "seeds", "picture", *(f"PSNR {where}, dB" for where in places), "before the enhancer, dB",
        "SSIM frame", "ball near, %", "players missed, %", "frames a second", "million weights", "steps", "minutes",
    ]  # fmt: skip
    return markdown(head, [["n/a" if cell == "nan" else cell for cell in line] for line in lines])


def part_curves(name: str, rows: Sequence[Row]) -> tuple[Curve, Curve]:
    """A part as lines of two plots: the error of whole frames against speed, and that of players."""
    speeds, labels = tuple(row.frames_per_second() for row in rows), tuple(row.name for row in rows)
    return (
        Curve(
            name=name, labels=labels, speeds=speeds, errors=tuple(rms(row.likeness("psnr", "frame")) for row in rows)
        ),
        Curve(name=name, labels=labels, speeds=speeds, errors=tuple(rms(row.players()) for row in rows)),
    )


def rms(psnr: float) -> float:
    """Root mean square error of the colours, levels of 255, of a PSNR in dB: on a logarithmic axis dB lie evenly."""
    return LEVELS * 10 ** (-psnr / 20)


def speed_panels(curves: Sequence[tuple[Curve, Curve]]) -> list[SpeedPanel]:
    """The two plots of all parts."""
    titles = ("whole frame", "players")
    return [
        SpeedPanel(title=title, error_unit="root mean square error, levels of 255", curves=tuple(own))
        for title, own in zip(titles, zip(*curves, strict=True), strict=False)
    ]


def figures_csv(parts: Mapping[str, Sequence[Row]]) -> str:
    """All figures of likeness, one a line."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["part", "model", "seeds", "where", "stage", *FIGURES, "frames_per_second"])
    for part, rows in parts.items():
        for row in rows:
            for where in row.places():
                for stage in ("final", "raw"):
                    values = [row.likeness(figure, where, stage) for figure in FIGURES]
                    told = ["" if math.isnan(value) else f"{value:.6g}" for value in [*values, row.frames_per_second()]]
                    writer.writerow([part, row.name, len(row.results), where, stage, *told])
    return text.getvalue()
