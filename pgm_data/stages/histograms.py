"""Pairs of histograms side by side as one SVG file."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float

WIDTH, HEIGHT, COLUMNS = 300, 190, 4
LEFT, TOP, BOTTOM, RIGHT = 12, 40, 26, 12
REAL, SIMULATED = "#999999", "#0072b2"


@dataclass(frozen=True, eq=False, kw_only=True)
class Pair:
    """One quantity in two samples."""

    name: str
    unit: str
    note: str
    """Their distance, in words."""
    real: Float[np.ndarray, " reals"]
    simulated: Float[np.ndarray, " simulations"]


def histograms_svg(pairs: Sequence[Pair]) -> str:
    """Every pair in a panel of its own: the real sample filled, the simulated one as a line."""
    rows = -(-max(len(pairs), 1) // COLUMNS)
    width, height = COLUMNS * WIDTH, rows * HEIGHT
    body = "".join(
        f'<g transform="translate({(i % COLUMNS) * WIDTH} {(i // COLUMNS) * HEIGHT})">{_panel(pair)}</g>'
        for i, pair in enumerate(pairs)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="11" fill="#222"><rect width="{width}" height="{height}" fill="#fff"/>'
        f"{body}</svg>\n"
    )


def _panel(pair: Pair) -> str:
    both = np.concatenate([pair.real, pair.simulated])
    low, high = np.quantile(both, [0.005, 0.995])
    edges = np.linspace(low, max(high, low + 1e-6), 25)
    shares = [np.histogram(sample, edges)[0] / max(len(sample), 1) for sample in (pair.real, pair.simulated)]
    top = max(float(max(s.max() for s in shares)), 1e-9)
    wide, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    x = LEFT + wide * (edges - edges[0]) / (edges[-1] - edges[0])
    parts = [
        f'<text x="{LEFT}" y="16" font-size="12">{escape(pair.name)}</text>',
        f'<text x="{LEFT}" y="31" fill="#666">{escape(pair.note)}</text>',
    ]
    for sample, colour, filled in ((shares[0], REAL, True), (shares[1], SIMULATED, False)):
        y = TOP + tall * (1.0 - sample / top)
        path = f"M{x[0]:.1f} {TOP + tall}" + "".join(
            f"L{x[i]:.1f} {y[i]:.1f}L{x[i + 1]:.1f} {y[i]:.1f}" for i in range(len(y))
        )
        style = f'fill="{colour}" fill-opacity="0.45"' if filled else f'fill="none" stroke="{colour}" stroke-width="2"'
        parts.append(f'<path d="{path}L{x[-1]:.1f} {TOP + tall}" {style}/>')
    parts.append(f'<text x="{LEFT}" y="{HEIGHT - 8}">{edges[0]:.3g}</text>')
    unit = escape(pair.unit)
    parts.append(f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 8}" text-anchor="end">{edges[-1]:.3g} {unit}</text>')
    return "".join(parts)
