"""Pieces that the sections of a report are made of, as HTML; text that comes in is escaped here."""

from html import escape

import numpy as np

DASH = "–"


def table(head: tuple[str, ...], rows: list[str]) -> str:
    """A table that scrolls sideways on a narrow page; a head that ends in # stands over numbers."""
    if not rows:
        return '<p class="quiet">none</p>'
    cells = "".join(f"<th{' class=n' if h.endswith('#') else ''}>{escape(h.removesuffix('#'))}</th>" for h in head)
    return f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'


def tiles(values: list[tuple[str, str]]) -> str:
    """Large numbers with their names, side by side."""
    return (
        '<div class="tiles">'
        + "".join(
            f'<div class="tile"><b>{escape(value)}</b><span>{escape(name)}</span></div>' for value, name in values
        )
        + "</div>"
    )


def share(part: int, whole: int) -> str:
    """A share in percent."""
    if not whole:
        return DASH
    # 100 % only where it is all of them.
    percent = 100 * part / whole
    return f"{percent:.0f} %" if part in (0, whole) else f"{min(max(percent, 0.1), 99.9):.1f} %"


def number(value: float | None, places: int) -> str:
    """A number with so many places; a dash where there is none."""
    return DASH if value is None or not np.isfinite(value) else f"{value:.{places}f}"


def duration(seconds: float) -> str:
    """A duration in seconds, or in minutes where it is long."""
    return f"{seconds:.1f} s" if seconds < 120 else f"{seconds / 60:.1f} min"
