"""Quality against speed as one SVG file: a line a sampler, a dot a number of steps, on logarithmic axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

WIDTH, HEIGHT, LEFT, TOP, BOTTOM, RIGHT = 520, 380, 70, 36, 50, 90
"""A panel and its margins, units of the SVG."""
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#444444")
ROUND = (1.0, 2.0, 5.0)
"""Where ticks stand in each power of ten."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One way to go from few steps to many."""

    name: str
    labels: tuple[str, ...]
    """Of the dots."""
    speeds: tuple[float, ...]
    """Frames a second."""
    errors: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class SpeedPanel:
    """One measure of quality, least is best."""

    title: str
    error_unit: str
    curves: tuple[Curve, ...]


def speed_svg(panels: Sequence[SpeedPanel]) -> str:
    """The panels side by side; dots that are not finite and above 0 are left out."""
    width = max(len(panels), 1) * WIDTH
    body = "".join(f'<g transform="translate({i * WIDTH} 0)">{_panel(p)}</g>' for i, p in enumerate(panels))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" width="{width}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="12" fill="#222"><rect width="{width}" height="{HEIGHT}" fill="#fff"/>'
        f"{body}</svg>\n"
    )


def _panel(panel: SpeedPanel) -> str:
    inner, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    kept = [_finite(curve) for curve in panel.curves]
    across = _Axis([speed for curve in kept for speed in curve.speeds], inner)
    up = _Axis([error for curve in kept for error in curve.errors], tall)

    def x(speed: float) -> float:
        return LEFT + across.place(speed)

    def y(error: float) -> float:
        return TOP + tall - up.place(error)

    parts = [f'<text x="{LEFT}" y="20" font-size="14">{escape(panel.title)}</text>']
    for tick in across.ticks:
        parts.append(f'<path d="M{x(tick):.1f} {TOP}V{TOP + tall}" stroke="#ddd"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{TOP + tall + 16}" text-anchor="middle">{tick:g}</text>')
    for tick in up.ticks:
        parts.append(f'<path d="M{LEFT} {y(tick):.1f}H{LEFT + inner}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    parts.append(f'<path d="M{LEFT} {TOP}V{TOP + tall}H{LEFT + inner}" stroke="#444" fill="none"/>')
    middle = LEFT + inner / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 10}" text-anchor="middle">frames a second</text>')
    turned = f"translate(14 {TOP + tall / 2}) rotate(-90)"
    parts.append(f'<text transform="{turned}" text-anchor="middle">{escape(panel.error_unit)}</text>')
    for place, curve in enumerate(kept):
        colour = COLOURS[place % len(COLOURS)]
        dots = [(x(speed), y(error)) for speed, error in zip(curve.speeds, curve.errors, strict=True)]
        if dots:
            line = "L".join(f"{at:.1f} {height:.1f}" for at, height in dots)
            parts.append(f'<path d="M{line}" stroke="{colour}" fill="none"/>')
        for (at, height), label in zip(dots, curve.labels, strict=True):
            parts.append(f'<circle cx="{at:.1f}" cy="{height:.1f}" r="4" fill="{colour}"/>')
            parts.append(
                f'<text x="{at + 6:.1f}" y="{height - 5:.1f}" font-size="10" fill="{colour}">{escape(label)}</text>'
            )
        parts.append(
            f'<text x="{LEFT + inner + 8}" y="{TOP + 14 + 16 * place}" fill="{colour}">{escape(curve.name)}</text>'
        )
    if not any(curve.labels for curve in kept):
        parts.append(f'<text x="{middle}" y="{TOP + tall / 2}" text-anchor="middle">no values</text>')
    return "".join(parts)


def _finite(curve: Curve) -> Curve:
    """The curve without dots that a logarithmic axis has no place for."""
    kept = [
        dot
        for dot in zip(curve.labels, curve.speeds, curve.errors, strict=True)
        if all(np.isfinite(value) and value > 0 for value in dot[1:])
    ]
    labels, speeds, errors = zip(*kept, strict=True) if kept else ((), (), ())
    return Curve(name=curve.name, labels=labels, speeds=speeds, errors=errors)


class _Axis:
    """A logarithmic axis around values."""

    def __init__(self, values: Sequence[float], length: float) -> None:
        self._length = length
        low, high = (min(values), max(values)) if values else (1.0, 10.0)
        self._low, self._high = np.log10(low) - 0.1, np.log10(high) + 0.1

    @property
    def ticks(self) -> list[float]:
        """Round numbers on it; of a long axis powers of ten alone."""
        powers = range(int(np.floor(self._low)), int(np.ceil(self._high)) + 1)
        factors = ROUND if self._high - self._low < 2 else ROUND[:1]
        numbers = [factor * 10.0**power for power in powers for factor in factors]
        return [number for number in numbers if self._low <= np.log10(number) <= self._high]

    def place(self, value: float) -> float:
        """Distance from its beginning, units of the SVG."""
        return float((np.log10(value) - self._low) / (self._high - self._low) * self._length)
