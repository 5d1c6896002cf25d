"""Error against time as one SVG file: a dot per preset with its name, in panels side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from pgm_data.stages.report_plots import nice_ticks

WIDTH, HEIGHT, LEFT, TOP, BOTTOM, RIGHT = 420, 300, 62, 34, 48, 24
"""A panel and its margins, units of the SVG."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")


@dataclass(frozen=True, eq=False, kw_only=True)
class Dot:
    """One preset in a panel."""

    name: str
    time: float
    error: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """One kind of error."""

    title: str
    time_unit: str
    error_unit: str
    dots: tuple[Dot, ...]


def plot_svg(panels: Sequence[Panel]) -> str:
    """The panels side by side; both axes start at zero, and dots that are not finite are left out."""
    width = max(len(panels), 1) * WIDTH
    body = "".join(f'<g transform="translate({i * WIDTH} 0)">{_panel(p)}</g>' for i, p in enumerate(panels))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" width="{width}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="12" fill="#222"><rect width="{width}" height="{HEIGHT}" fill="#fff"/>'
        f"{body}</svg>\n"
    )


def _panel(panel: Panel) -> str:
    dots = [d for d in panel.dots if np.isfinite(d.time) and np.isfinite(d.error)]
    across = 1.25 * max((d.time for d in dots), default=1.0) or 1.0
    up = 1.25 * max((d.error for d in dots), default=1.0) or 1.0
    inner, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def x(time: float) -> float:
        return LEFT + inner * time / across

    def y(error: float) -> float:
        return TOP + tall * (1.0 - error / up)

    parts = [f'<text x="{LEFT}" y="20" font-size="14">{escape(panel.title)}</text>']
    for tick in nice_ticks(0.0, across):
        parts.append(f'<path d="M{x(tick):.1f} {TOP}V{TOP + tall}" stroke="#ddd"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{TOP + tall + 16}" text-anchor="middle">{tick:g}</text>')
    for tick in nice_ticks(0.0, up):
        parts.append(f'<path d="M{LEFT} {y(tick):.1f}H{LEFT + inner}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:.4g}</text>')
    parts.append(f'<path d="M{LEFT} {TOP}V{TOP + tall}H{LEFT + inner}" stroke="#444" fill="none"/>')
    middle = LEFT + inner / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 10}" text-anchor="middle">{escape(panel.time_unit)}</text>')
    turned = f"translate(14 {TOP + tall / 2}) rotate(-90)"
    parts.append(f'<text transform="{turned}" text-anchor="middle">{escape(panel.error_unit)}</text>')
    for i, dot in enumerate(dots):
        colour = COLOURS[i % len(COLOURS)]
        parts.append(f'<circle cx="{x(dot.time):.1f}" cy="{y(dot.error):.1f}" r="5" fill="{colour}"/>')
        parts.append(
            f'<text x="{x(dot.time) + 9:.1f}" y="{y(dot.error) - 7:.1f}" fill="{colour}">{escape(dot.name)}</text>'
        )
    if not dots:
        parts.append(f'<text x="{middle}" y="{TOP + tall / 2}" text-anchor="middle">no values</text>')
    return "".join(parts)
