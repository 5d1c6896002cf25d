"""Captions of other programs and people as they are read, before they are matched with clips, and their faults."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.convert.loose_csv import MISSING_WORDS

Unit = Literal["seconds", "frames", "video frames"]
ALIASES = {
    "clip": ("clip", "clipid", "video", "videoid", "file", "filename", "videoname", "sequence", "sequenceid"),
    "player": ("player", "playerid", "playerindex", "object", "speaker", "voice", "actor", "who"),
    "start_frame": ("startframe", "framestart", "firstframe", "beginframe", "framebegin"),
    "end_frame": ("endframe", "frameend", "lastframeexcluded", "stopframe"),
    "start_video_frame": ("startvideoframe", "videostartframe", "videoframestart"),
    "end_video_frame": ("endvideoframe", "videoendframe", "videoframeend"),
    "start_s": ("starts", "start", "starttime", "startsec", "startseconds", "begin", "from", "tstart", "onset"),
    "end_s": ("ends", "end", "endtime", "endsec", "endseconds", "stop", "to", "tend", "offset"),
    "text": ("text", "caption", "captions", "description", "sentence", "label", "transcript", "action"),
    "source": ("source", "origin"),
    "alternative": ("alternative", "alt", "variant", "alternativeindex"),
}
"""Titles of columns in small letters and digits alone; end frames are the first ones after the span."""
PAIRS: tuple[tuple[Unit, str, str], ...] = (
    ("frames", "start_frame", "end_frame"),
    ("video frames", "start_video_frame", "end_video_frame"),
    ("seconds", "start_s", "end_s"),
)
"""Where both are given, the first that has both decides."""
CLOCK = re.compile(r"(?:(\d+):)?(\d{1,3}):(\d{1,2}(?:[.,]\d+)?)$")


@dataclass(frozen=True, kw_only=True)
class CaptionFinding:
    """One thing about a caption that a person should know."""

    file: str
    place: str
    """Where in the file, such as `line 3`; empty for the file itself."""
    field: str
    expected: str
    found: str
    level: Literal["error", "warning"] = "error"
    """A row with an error is left out."""

    def text(self) -> str:
        """One line."""
        where = ": ".join(part for part in (self.file, self.place, self.field) if part)
        return f"{where}: expected {self.expected}, got {self.found}"


@dataclass(frozen=True, kw_only=True)
class CaptionRow:
    """One text as its file states it."""

    place: str
    clip: str
    """Name of a clip or a video; empty where not said."""
    player: str
    """Object, number or person; empty where not said."""
    start: float
    end: float
    """Excluded."""
    unit: Unit
    """`frames` are the clip's, `video frames` and `seconds` the video's."""
    text: str
    source: str = ""
    alternative: int = -1
    """-1 where not said."""


@dataclass(kw_only=True)
class CaptionFile:
    """Rows and findings of one file as they are collected."""

    path: Path
    rows: list[CaptionRow] = field(default_factory=list)
    findings: list[CaptionFinding] = field(default_factory=list)

    def refuse(self, place: str, name: str, expected: str, found: object) -> None:
        """Note a row that is left out."""
        self.findings.append(
            CaptionFinding(file=str(self.path), place=place, field=name, expected=expected, found=shown(found))
        )

    def add(self, place: str, values: Mapping[str, object]) -> None:
        """Take in a row of named values, or say why not; names are those of `ALIASES`."""
        given = {name: "" if value is None else value for name, value in values.items()}
        pair = next((p for p in PAIRS if _said(given.get(p[1])) and _said(given.get(p[2]))), None)
        if pair is None:
            said = ", ".join(f"{name} {shown(given[name])}" for _, a, b in PAIRS for name in (a, b) if name in given)
            self.refuse(place, "start, end", "a start and an end, in frames or in seconds", said or "none")
            return
        unit, first, second = pair
        start, end = (_moment(given[name], unit) for name in (first, second))
        for name, value in ((first, start), (second, end)):
            if not math.isfinite(value):
                expected = "a time such as 12.5 or 0:12.5" if unit == "seconds" else "a whole number"
                self.refuse(place, name, expected, given[name])
                return
        number = given.get("alternative", "")
        alternative = _moment(number, "frames") if _said(number) else -1.0
        if not alternative >= -1 or (_said(number) and alternative < 0):
            self.refuse(place, "alternative", "0 or a whole number above", number)
            return
        text = given.get("text", "")
        if not isinstance(text, str):
            self.refuse(place, "text", "a text", text)
            return
        self.rows.append(
            CaptionRow(
                place=place,
                clip=_word(given.get("clip", "")),
                player=_word(given.get("player", "")),
                start=start,
                end=end,
                unit=unit,
                text=text,
                source=_word(given.get("source", "")).lower(),
                alternative=int(alternative),
            )
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptionClip:
    """A clip that captions may be about."""

    clip_id: str
    video: str
    """Name of its video's file."""
    first_video_frame: int
    capture_time: Float[np.ndarray, " frames"]
    """When each frame was taken, s; a repeat has its source's."""
    players: tuple[str, ...]
    """Player objects of the scene."""
    identities: tuple[str, ...]
    """The person that each of them is in the clip; empty where unknown."""

    @property
    def end_s(self) -> float:
        """Capture time at which the last frame ends, s."""
        times = np.unique(self.capture_time)
        return float(times[-1] + (np.median(np.diff(times)) if len(times) > 1 else 0.04)) if len(times) else 0.0


def shown(value: object) -> str:
    """A value in a message, cut short."""
    text = value if isinstance(value, str) else repr(value)
    return repr(text[:57] + "..." if len(text) > 60 else text) if isinstance(value, str) else text[:60]


def _said(value: object) -> bool:
    if isinstance(value, str):
        return value.strip().lower() not in MISSING_WORDS
    return value is not None and not (isinstance(value, float) and math.isnan(value))


def _word(value: object) -> str:
    if isinstance(value, float) and value == int(value):
        value = int(value)
    return str(value).strip()


def _moment(value: object, unit: Unit) -> float:
    """A time or a whole number; NaN where it is none."""
    if isinstance(value, bool):
        return math.nan
    if isinstance(value, str):
        text = value.strip()
        clock = CLOCK.match(text) if unit == "seconds" else None
        if clock:
            hours, minutes, seconds = clock.groups()
            return 3600.0 * int(hours or 0) + 60.0 * int(minutes) + float(seconds.replace(",", "."))
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            return math.nan
    if not isinstance(value, int | float) or not math.isfinite(value):
        return math.nan
    return float(value) if unit == "seconds" or float(value).is_integer() else math.nan
