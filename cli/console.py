"""What a command says: progress, tables and errors. On a terminal a bar, elsewhere plain lines."""

import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TextIO


class UsageError(Exception):
    """A command was called in a way it cannot work with: exit 2, one line."""


def option_error(option: str, *, expected: str, got: object) -> UsageError:
    """The error for a bad option, in the one form all commands use."""
    return UsageError(f"{option}: expected {expected}, got {got}")


def check_ranges(*ranges: tuple[str, float, float, float]) -> None:
    """Refuse numbers out of range: of each option its name, its value, and the least and the most it may be.

    Raises:
        UsageError: If one is; names it.
    """
    for name, value, low, high in ranges:
        if not low <= value <= high:
            raise option_error(name, expected=f"{_plain(low)} to {_plain(high)}", got=value)


def _plain(number: float) -> str:
    return f"{number:g}" if isinstance(number, float) else str(number)


def print_error(message: str) -> None:
    """Write one line of trouble to standard error."""
    print(f"error: {message}", file=sys.stderr, flush=True)


def table_text(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table as text: numbers to the right, words to the left, NaN and None as a dash."""
    cells = [[cell_text(value) for value in row] for row in rows]
    for row in cells:
        if len(row) != len(header):
            raise ValueError(f"table row: expected {len(header)} cells, got {len(row)}: {row}")
    widths = [max(len(name), *(len(row[i]) for row in cells), 1) for i, name in enumerate(header)]
    to_right = [bool(rows) and all(isinstance(row[i], int | float) for row in rows) for i in range(len(header))]

    def line(texts: Sequence[str]) -> str:
        return "  ".join(
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(texts, widths, to_right, strict=True)
        ).rstrip()

    return "\n".join([line(header), line(["-" * width for width in widths]), *(line(row) for row in cells)])


def cell_text(value: object) -> str:
    """One cell: three significant figures, a dash for what is not there."""
    if value is None or (isinstance(value, float) and value != value):
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)


@dataclass(kw_only=True)
class Progress:
    """How far several jobs are, shown as one bar on a terminal and as a line now and then elsewhere."""

    total: int
    """Jobs in all."""
    unit: str = "video"
    """What one job is."""
    quiet: bool = False
    stream: TextIO = field(default_factory=lambda: sys.stderr)
    interval_s: float = 10.0
    """Least time between plain lines; a terminal is redrawn ten times a second at most."""
    _finished: int = 0
    _shares: dict[str, float] = field(default_factory=dict)
    _drawn_at: float = -1e9
    _drawn: bool = False

    def update(self, name: str, share: float, detail: str = "") -> None:
        """Say that the job `name` is done to `share` of 0 to 1, or NaN where nobody knows."""
        self._shares[name] = min(max(share, 0.0), 1.0) if share == share else 0.0
        self._draw(f"{name} {detail}".rstrip(), now=False)

    def finish(self, name: str, message: str = "") -> None:
        """Say that the job `name` has ended; `message` stays on the screen."""
        self._shares.pop(name, None)
        self._finished += 1
        if message:
            self.say(message)
        self._draw(name, now=self._finished == self.total)

    def say(self, message: str) -> None:
        """Write a line that stays, above the bar."""
        if self.quiet:
            return
        self._clear()
        print(message, file=self.stream, flush=True)

    def close(self) -> None:
        """Take the bar away."""
        self._clear()

    def _clear(self) -> None:
        if self._drawn:
            self.stream.write("\r\x1b[K")
            self.stream.flush()
            self._drawn = False

    def _draw(self, name: str, *, now: bool) -> None:
        if self.quiet or self.total == 0:
            return
        terminal = self.stream.isatty()
        clock = time.monotonic()
        if not now and clock - self._drawn_at < (0.1 if terminal else self.interval_s):
            return
        self._drawn_at = clock
        share = (self._finished + sum(self._shares.values())) / self.total
        counts = f"{share:4.0%}  {self._finished} of {self.total} {self.unit}{'s' if self.total != 1 else ''}"
        if not terminal:
            print(f"{counts}, at {name}", file=self.stream, flush=True)
            return
        columns = shutil.get_terminal_size().columns
        width = max(min(columns - len(counts) - 5, 30), 5)
        bar = "#" * round(width * share)
        text = f"[{bar:<{width}}] {counts}  {name}"
        self.stream.write("\r\x1b[K" + text[: columns - 1])
        self.stream.flush()
        self._drawn = True
