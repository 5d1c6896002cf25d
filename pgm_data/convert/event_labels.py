"""What the labels of annotation programs say of the ball, and marks collected one by one."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pgm_data.ball import EVENT_KINDS
from pgm_data.convert.events_csv import EventMarks

GROUND = "ground"
CORNER_ORIGIN = 0.5
"""These programs put (0, 0) into the top-left corner of the picture; with us that is (-0.5, -0.5)."""
SHOWN_LABELS = 8


def label_kind(label: str) -> str | None:
    """The event that a label names, None where it names none or several."""
    kinds = [word for word in re.split("[^a-z]+", label.lower()) if word in EVENT_KINDS]
    return kinds[0] if len(kinds) == 1 else None


def on_ground(label: str) -> bool:
    """Whether a point of that label is where the ball is over, on the ground."""
    return label_kind(label) == "bounce" or GROUND in re.split("[^a-z]+", label.lower())


@dataclass(kw_only=True)
class MarkList:
    """Marks of a file as they are read; `marks` gives them as one struct."""

    path: Path
    labels: set[str] = field(default_factory=set)
    """All labels seen, for the message where none names an event."""
    rows: list[tuple[str, float, float, str, float, float]] = field(default_factory=list)
    """Place, frame, frames wide, kind, ground pixel."""
    frames_counted: int | None = None
    """Frames that the program counted in the video."""

    def add(
        self, label: str, place: str, *, frame: float, frames_wide: float, corner_xy: tuple[float, float] | None
    ) -> None:
        """Take a mark in, if its label names an event; its point is in the program's pixels."""
        self.labels.add(label)
        kind = label_kind(label)
        if kind is None:
            return
        x, y = corner_xy if corner_xy is not None and on_ground(label) else (np.nan, np.nan)
        self.rows.append((place, frame, frames_wide, kind, x - CORNER_ORIGIN, y - CORNER_ORIGIN))

    def marks(self) -> EventMarks:
        """All marks.

        Raises:
            ValueError: If no label names an event.
        """
        if not self.rows:
            seen = sorted(self.labels)
            got = ", ".join(repr(label) for label in seen[:SHOWN_LABELS]) or "no label"
            more = f" and {len(seen) - SHOWN_LABELS} more" if len(seen) > SHOWN_LABELS else ""
            raise ValueError(f"{self.path}: labels: expected some of {', '.join(EVENT_KINDS)}, got {got}{more}")
        place, frame, wide, kind, x, y = zip(*self.rows, strict=True)
        return EventMarks(
            source=str(self.path),
            place=place,
            frame=np.array(frame, dtype=np.float64),
            frames_wide=np.array(wide, dtype=np.float64),
            kind=np.array(kind, dtype=object),
            ground_px=np.stack([np.array(x, dtype=np.float64), np.array(y, dtype=np.float64)], axis=1),
            player=np.full(len(place), "", dtype=object),
            frames_counted=self.frames_counted,
        )
