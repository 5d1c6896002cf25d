"""The losses of a training run so far, as a table and a picture."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.dataset.files import whole_file
from pgm_models.train import LOG_NAME

CURVES_NAME = "loss.csv"
PICTURE_NAME = "loss.png"
NOT_LOSSES = ("step", "elapsed_s", "rate", "held_out")
"""Fields of a log line that tell of the step itself."""
SMOOTHED = 0.05
"""Share of the lines over which the training loss is averaged in the picture."""


def write_loss_curves(run: Path) -> None:
    """Write the losses in the run's log to `loss.csv`, and to `loss.png` where matplotlib is installed.

    Raises:
        ValueError: If a line of the log is not one that the training writes.
    """
    trained, held_out = read_log(run / LOG_NAME)
    _write_csv(run / CURVES_NAME, trained, held_out)
    if find_spec("matplotlib") is not None and (trained or held_out):
        _write_picture(run / PICTURE_NAME, trained, held_out)


def read_log(path: Path) -> tuple[dict[str, Float[np.ndarray, " lines"]], dict[str, Float[np.ndarray, " looks"]]]:
    """Columns of the training lines and of the looks at held-out data, by name; NaN where a line lacks one.

    Both have `step`; each is empty where there is no such line.

    Raises:
        ValueError: If a line is not one that the training writes.
    """
    trained: list[Mapping[str, float]] = []
    held_out: list[Mapping[str, float]] = []
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            if "held_out" in entry:
                held_out.append({"step": entry["step"], "elapsed_s": entry["elapsed_s"], **entry["held_out"]})
            else:
                trained.append({"step": entry["step"], **entry})
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path}, line {number}: expected a line of a training's log, got {line[:80]!r}"
            ) from error
    return _columns(trained), _columns(held_out)


def _columns(lines: Sequence[Mapping[str, float]]) -> dict[str, Float[np.ndarray, " lines"]]:
    names = dict.fromkeys(name for line in lines for name in line)
    return {name: np.array([line.get(name, np.nan) for line in lines], dtype=np.float64) for name in names}


def _write_csv(path: Path, trained: Mapping[str, np.ndarray], held_out: Mapping[str, np.ndarray]) -> None:
    """One row a line of the log: where it was, of what data, and all figures."""
    names = [name for name in dict.fromkeys([*trained, *held_out]) if name not in ("step", "held_out")]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["step", "data", *names])
    for data, columns in (("training", trained), ("held out", held_out)):
        for row, step in enumerate(columns.get("step", ())):
            values = [columns[name][row] if name in columns else np.nan for name in names]
            writer.writerow([int(step), data, *("" if np.isnan(value) else f"{value:.6g}" for value in values)])
    with whole_file(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _write_picture(path: Path, trained: Mapping[str, np.ndarray], held_out: Mapping[str, np.ndarray]) -> None:
    """The loss on the left, its terms on the right, over steps."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 5), layout="constrained")
    FigureCanvasAgg(figure)
    whole, terms = figure.subplots(1, 2, squeeze=True)
    if "loss" in trained:
        whole.plot(trained["step"], trained["loss"], color="#b8cfe6", linewidth=0.6)
        whole.plot(*smoothed(trained["step"], trained["loss"]), color="#0072b2", label="training")
    if "loss" in held_out:
        whole.plot(held_out["step"], held_out["loss"], "o-", color="#d55e00", markersize=3, label="held out")
    whole.set_title("loss")
    names = [name for name in trained if name not in (*NOT_LOSSES, "loss", "gradient")]
    for place, name in enumerate(names):
        style = ("-", "--", ":", "-.")[place // 10 % 4]
        terms.plot(*smoothed(trained["step"], trained[name]), style, color=f"C{place % 10}", label=name)
    terms.set_title("its terms, averaged")
    for axes in (whole, terms):
        values = [line.get_ydata() for line in axes.get_lines()]
        if values and all(np.nanmin(np.asarray(value, dtype=np.float64), initial=np.inf) > 0 for value in values):
            axes.set_yscale("log")
        axes.set_xlabel("step")
        axes.grid(alpha=0.3)
        if values:
            axes.legend(fontsize=7, loc="upper right")
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=80)


def smoothed(
    steps: Float[np.ndarray, " lines"], values: Float[np.ndarray, " lines"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Means over a window of the lines, those with NaN passed over, and the steps in the windows' middles."""
    finite = np.isfinite(values)
    steps, values = steps[finite], values[finite]
    window = max(1, round(SMOOTHED * len(values)))
    if not len(values):
        return steps, values
    box = np.full(window, 1 / window)
    return np.convolve(steps, box, mode="valid"), np.convolve(values, box, mode="valid")
