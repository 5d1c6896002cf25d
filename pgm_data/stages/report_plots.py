"""Plots for a page as inline SVG: curves stretched to the page's width, with labels that keep their size.

Every function returns HTML. Text that comes in is escaped here.
"""

from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float, Shaped

COLUMNS = 600
"""Most steps of a curve or a strip across the page; more would not be seen."""
STRIP_ORDER = ("measured", "interpolated", "none")
"""Statuses from best to worst; a step of a strip that holds several shows the worst."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One curve of a plot."""

    name: str
    values: Float[np.ndarray, " frames"]
    """NaN breaks the curve."""
    style: str
    """Name of a colour of the page: `c1`, `c2`, `c3`."""


def nice_ticks(low: float, high: float, most: int = 5) -> Float[np.ndarray, " ticks"]:
    """Round numbers from `low` to `high`, one to `most` of them: multiples of 1, 2 or 5 times a power of ten."""
    span = max(high - low, 1e-9 * max(abs(low), abs(high)), 1e-12)
    power = 10.0 ** np.floor(np.log10(span / max(most, 1)))
    for step in power * np.array([1.0, 2.0, 5.0, 10.0, 20.0, 50.0]):
        ticks = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
        if len(ticks) <= most:
            return ticks if len(ticks) else np.array([0.5 * (low + high)])
    return np.array([0.5 * (low + high)])


def thinned(
    times: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"]
) -> tuple[Float[np.ndarray, " kept"], Float[np.ndarray, " kept"]]:
    """A curve of at most about 2 `COLUMNS` points that looks the same: least and greatest of each step, gaps kept."""
    if len(times) <= 2 * COLUMNS:
        return times, values
    kept: list[int] = []
    for part in np.array_split(np.arange(len(times)), COLUMNS):
        finite = part[np.isfinite(values[part])]
        if len(finite) == 0:
            kept.append(int(part[0]))
            continue
        ends = {int(finite[values[finite].argmin()]), int(finite[values[finite].argmax()])}
        gaps = part[~np.isfinite(values[part])]
        kept.extend(sorted(ends | ({int(gaps[0])} if len(gaps) else set())))
    return times[kept], values[kept]


def plot(title: str, unit: str, times: Float[np.ndarray, " frames"], curves: tuple[Curve, ...]) -> str:
    """A plot of curves over time in seconds, with its legend where there is more than one."""
    finite = [curve.values[np.isfinite(curve.values)] for curve in curves]
    values = np.concatenate(finite) if finite else np.zeros(0)
    heading = f"<h4>{escape(title)} <small>{escape(unit)}</small>{_legend(curves)}</h4>"
    if not len(values):
        return f'<div class="plot">{heading}<p class="quiet">no values</p></div>'
    low, high = float(values.min()), float(values.max())
    margin = 0.08 * (high - low) or max(1e-3 * abs(high), 1e-3)
    low, high = low - margin, high + margin
    start, end = _time_span(times)
    y_ticks = nice_ticks(low, high, 4)
    lines = "".join(f'<path class="grid" d="M0 {_y(y, low, high):.2f}H1000"/>' for y in y_ticks)
    paths = "".join(_path(curve, times, (start, end), (low, high)) for curve in curves)
    labels = "".join(
        f'<span class="yt" style="top:{_y(y, low, high) / 2:.2f}%">{_number(y, y_ticks)}</span>' for y in y_ticks
    )
    svg = f'<svg viewBox="0 0 1000 200" preserveAspectRatio="none" aria-hidden="true">{lines}{paths}</svg>'
    return f'<div class="plot">{heading}<div class="area">{svg}{labels}</div>{_time_axis(start, end)}</div>'


def strip(times: Float[np.ndarray, " frames"], status: Shaped[np.ndarray, " frames"], *, axis: bool) -> str:
    """A band over time in the colours of the frames' statuses."""
    rank = np.array([STRIP_ORDER.index(word) for word in status], dtype=int)
    if not len(rank):
        return ""
    parts = np.array_split(rank, min(COLUMNS, len(rank)))
    worst = np.array([part.max() for part in parts])
    edges = np.flatnonzero(np.diff(worst, prepend=-1, append=-1))
    bands = "".join(
        f'<rect class="s-{STRIP_ORDER[worst[a]]}" x="{1000 * a / len(worst):.2f}" y="0"'
        f' width="{1000 * (b - a) / len(worst):.2f}" height="10"/>'
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    )
    svg = f'<svg class="strip" viewBox="0 0 1000 10" preserveAspectRatio="none" aria-hidden="true">{bands}</svg>'
    if not axis:
        return svg
    start, end = _time_span(times)
    legend = "".join(f'<i class="s-{word}"></i>{word} ' for word in STRIP_ORDER)
    heading = f'<h4>Status <span class="legend">{legend}</span></h4>'
    return f'<div class="plot wide">{heading}<div class="area low">{svg}</div>{_time_axis(start, end)}</div>'


def _time_span(times: Float[np.ndarray, " frames"]) -> tuple[float, float]:
    finite = times[np.isfinite(times)]
    if not len(finite):
        return 0.0, 1.0
    start, end = float(finite.min()), float(finite.max())
    return (start, end) if end > start else (start, start + 1.0)


def _y(value: float, low: float, high: float) -> float:
    return 200 * (high - value) / (high - low)


def _path(
    curve: Curve, times: Float[np.ndarray, " frames"], span: tuple[float, float], limits: tuple[float, float]
) -> str:
    t, values = thinned(times, curve.values)
    x = 1000 * (t - span[0]) / (span[1] - span[0])
    y = 200 * (limits[1] - values) / (limits[1] - limits[0])
    d, drawing = [], False
    for i, (px, py) in enumerate(zip(x, y, strict=True)):
        if not (np.isfinite(px) and np.isfinite(py)):
            drawing = False
            continue
        alone = not drawing and (i + 1 == len(x) or not np.isfinite(y[i + 1]))
        # A point between gaps is drawn as a line of no length, which round ends make visible.
        d.append(f"M{px:.1f} {py:.1f}h0" if alone else f"{'L' if drawing else 'M'}{px:.1f} {py:.1f}")
        drawing = True
    return f'<path class="curve {escape(curve.style)}" d="{"".join(d)}"/>'


def _legend(curves: tuple[Curve, ...]) -> str:
    if len(curves) < 2:
        return ""
    keys = "".join(f'<i class="k-{escape(curve.style)}"></i>{escape(curve.name)} ' for curve in curves)
    return f'<span class="legend">{keys}</span>'


def _time_axis(start: float, end: float) -> str:
    ticks = nice_ticks(start, end, 6)
    labels = "".join(
        f'<span style="left:{100 * (t - start) / (end - start):.2f}%">{_number(t, ticks)}</span>' for t in ticks
    )
    return f'<div class="xt">{labels}<b>s</b></div>'


def _number(value: float, ticks: Float[np.ndarray, " ticks"]) -> str:
    step = float(np.diff(ticks).min()) if len(ticks) > 1 else abs(value) or 1.0
    places = int(max(0, -np.floor(np.log10(step) + 1e-9))) if step > 0 else 0
    text = f"{value:.{min(places, 6)}f}"
    return text.removeprefix("-") if float(text) == 0 else text
