"""Speeds of serves as a radar measured them, by which the drag of the ball can be had."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.convert.loose_csv import LooseTable, read_loose_csv
from pgm_data.geometry.arrays import frozen

UNITS = {"km/h": 1 / 3.6, "mph": 0.44704, "m/s": 1.0}
"""Metres a second in one of the unit."""
UNIT_WORDS = {
    "kmh": "km/h",
    "kph": "km/h",
    "kmph": "km/h",
    "mph": "mph",
    "milesperhour": "mph",
    "ms": "m/s",
    "mps": "m/s",
}
SPEED_TITLES = ("speed", "servespeed", "ballspeed", "velocity")
ALIASES = {
    "clip": ("clip", "clipid", "video", "file"),
    "frame": ("frame", "framenum", "framenumber", "frameindex"),
    "time": ("time", "timestamp", "seconds", "times", "t"),
    "speed": tuple(f"{title}{unit}" for title in SPEED_TITLES for unit in ("", *UNIT_WORDS)),
    "unit": ("unit", "units", "speedunit"),
}
PLAUSIBLE_M_S = (10.0, 80.0)
"""From a serve that a child taps over the net to beyond the fastest that was ever measured (263 km/h)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ServeSpeeds:
    """Serves, one row each, in the file's order."""

    path: Path
    clip: tuple[str, ...]
    """Clip or video; empty where the file names none."""
    frame: Float[np.ndarray, " serves"]
    """Frame of the video at the serve; NaN where the time is given instead."""
    time: Float[np.ndarray, " serves"]
    """Presentation time of the serve, s; NaN where the frame is given instead."""
    speed: Float[np.ndarray, " serves"]
    """Of the ball as it leaves the racket, m/s."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        for name in ("frame", "time", "speed"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def read_serve_speeds(path: Path, *, plausible_m_s: tuple[float, float] = PLAUSIBLE_M_S) -> ServeSpeeds:
    """The serves of a file with the columns speed, and frame or time, and perhaps clip.

    The unit (km/h, mph or m/s) stands in the speed's title, such as `speed_kmh`, or in a column `unit`.

    Raises:
        ValueError: If the file cannot be read, lacks a column or a unit, or a speed is none that a serve has. The
            message names file, line, field, what was expected and found.
    """
    table = read_loose_csv(path, ALIASES, required=("speed",))
    if not table.has("frame") and not table.has("time"):
        raise ValueError(f"{path}: line 1: frame: expected the column, or time, got {', '.join(table.titles)}")
    if not len(table):
        raise ValueError(f"{path}: expected a row for each serve, got none")
    none = np.full(len(table), np.nan)
    frame = table.numbers("frame", "a frame's number") if table.has("frame") else none
    time = table.numbers("time", "a time in seconds") if table.has("time") else none
    for name, values in (("frame", frame), ("time", time)):
        wrong = np.flatnonzero(values < 0)
        if len(wrong):
            raise table.fault(int(wrong[0]), name, "0 or more")
    bare = np.flatnonzero(np.isnan(frame) & np.isnan(time))
    if len(bare):
        raise table.fault(int(bare[0]), "frame" if table.has("frame") else "time", "where the serve is")
    units = _units(table)
    speed = table.numbers("speed", "a speed") * np.array([UNITS[unit] for unit in units])
    low, high = plausible_m_s
    wrong = np.flatnonzero(~((speed >= low) & (speed <= high)))
    if len(wrong):
        row = int(wrong[0])
        per = UNITS[units[row]]
        raise table.fault(row, "speed", f"a serve's speed of {low / per:.0f} to {high / per:.0f} {units[row]}")
    return ServeSpeeds(
        path=path,
        clip=table.texts("clip") if table.has("clip") else ("",) * len(table),
        frame=np.where(np.isnan(time), frame, np.nan) if table.has("time") else frame,
        time=time,
        speed=speed,
    )


def _units(table: LooseTable) -> list[str]:
    """The unit of each row's speed.

    Raises:
        ValueError: If there is none, it is unknown, or title and column name two.
    """
    title = re.sub("[^a-z]", "", table.titles[table.names.index("speed")].lower())
    ending = next((title.removeprefix(word) for word in SPEED_TITLES if title.startswith(word)), "")
    in_title = UNIT_WORDS.get(ending, "")
    if not table.has("unit"):
        if not in_title:
            known = ", ".join(UNITS)
            raise ValueError(
                f"{table.path}: line 1: unit: expected {known} in the title of the speeds, or in a column, got neither"
            )
        return [in_title] * len(table)
    units = []
    for row, text in enumerate(table.texts("unit")):
        unit = UNIT_WORDS.get(re.sub("[^a-z]", "", text.lower()), "" if text else in_title)
        if not unit or (in_title and unit != in_title):
            raise table.fault(row, "unit", in_title or " or ".join(UNITS))
        units.append(unit)
    return units
