"""The histograms of a dataset, as numbers and as small SVG pictures that need no library and are always the same."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from pgm_data.dataset.stats import Tally
from pgm_data.dataset.stats_words import PARTS

WIDTH, HEIGHT = 420, 240
LEFT, TOP, BOTTOM, RIGHT = 56, 30, 44, 12
MOST_BINS = 30
COLOUR = "#0072b2"


@dataclass(frozen=True, eq=False, kw_only=True)
class Histogram:
    """One quantity of a dataset, counted."""

    name: str
    """Name of its file too."""
    title: str
    unit: str
    """Of the edges; empty where bars have labels."""
    counts: tuple[float, ...]
    edges: tuple[float, ...]
    """One more than counts; empty where bars have labels."""
    labels: tuple[str, ...] = ()


def histograms_of(tally: Tally) -> tuple[Histogram, ...]:
    """Lengths of sequences, words per caption, lengths of spans, parts of speech."""
    lengths = np.array(sorted(tally.lengths), dtype=float)
    times = np.array([tally.lengths[int(n)] for n in lengths], dtype=float)
    counted = max(sum(tally.parts.values()), 1)
    return (
        _binned("durations", "Duration of sequences", "s", np.array(tally.durations_s)),
        _binned("words", "Words per caption", "words", lengths, times, whole=True),
        _binned("spans", "Duration of caption spans", "s", tally.spans),
        Histogram(
            name="parts",
            title="Parts of speech",
            unit="",
            counts=tuple(tally.parts[part] / counted for part in PARTS),
            edges=(),
            labels=PARTS,
        ),
    )


def _binned(
    name: str, title: str, unit: str, values: np.ndarray, weights: np.ndarray | None = None, *, whole: bool = False
) -> Histogram:
    """Values in equal bins of a round width."""
    if not len(values):
        return Histogram(name=name, title=title, unit=unit, counts=(), edges=())
    low, high = float(values.min()), float(values.max())
    width = _round_width(max(high - low, 0.01 * max(abs(high), 1.0)) / MOST_BINS)
    if whole:
        width = max(1.0, float(np.ceil(width)))
    start = np.floor(low / width) * width
    count = min(int(np.floor((high - start) / width)) + 1, 10 * MOST_BINS)
    edges = start + width * np.arange(count + 1)
    counts, _ = np.histogram(values, edges, weights=weights)
    return Histogram(
        name=name, title=title, unit=unit, counts=tuple(counts.tolist()), edges=tuple(np.round(edges, 9).tolist())
    )


def _round_width(least: float) -> float:
    """The least of 1, 2 or 5 times a power of ten that is not below."""
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least * (1 - 1e-9)))


def histogram_svg(histogram: Histogram) -> str:
    """The histogram as an SVG file's text."""
    wide, tall = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    parts = [f'<text x="{LEFT}" y="18" font-size="13">{escape(histogram.title)}</text>']
    counts = np.array(histogram.counts, dtype=float)
    if not len(counts) or counts.max() <= 0:
        parts.append(f'<text x="{LEFT}" y="{TOP + tall / 2:.0f}" fill="#666">nothing to count</text>')
        return _svg(parts)
    top = float(counts.max())
    for share in (0.0, 0.5, 1.0):
        y = TOP + tall * (1.0 - share)
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{share * top:.3g}</text>')
    step = wide / len(counts)
    for place, count in enumerate(counts):
        height = tall * count / top
        x, y = LEFT + step * place, TOP + tall - height
        bar = f'width="{max(step - 1, 0.5):.1f}" height="{height:.1f}" fill="{COLOUR}"'
        parts.append(f'<rect x="{x + 0.5:.1f}" y="{y:.1f}" {bar}/>')
    parts += _labels(histogram, step) if histogram.labels else _ticks(histogram, step)
    return _svg(parts)


def _labels(histogram: Histogram, step: float) -> list[str]:
    base = HEIGHT - BOTTOM
    return [
        f'<text transform="translate({LEFT + step * (place + 0.5) + 3:.1f} {base + 6}) rotate(-35)" '
        f'text-anchor="end" font-size="9">{escape(label)}</text>'
        for place, label in enumerate(histogram.labels)
    ]


def _ticks(histogram: Histogram, step: float) -> list[str]:
    every = max(1, -(-len(histogram.edges) // 8))
    parts = [
        f'<text x="{LEFT + step * place:.1f}" y="{HEIGHT - BOTTOM + 15}" text-anchor="middle">{edge:.4g}</text>'
        for place, edge in enumerate(histogram.edges)
        if place % every == 0
    ]
    parts.append(f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 8}" text-anchor="end">{escape(histogram.unit)}</text>')
    return parts


def _svg(parts: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'font-family="sans-serif" font-size="10" fill="#222"><rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>'
        + "".join(parts)
        + "</svg>\n"
    )
