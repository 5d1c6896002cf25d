"""CVAT's XML 1.1, for videos and for images: hits and bounces that people marked there.

In a track one event lasts as long as it is drawn: a new one begins where the track was `outside`, or where its event
attribute took another value, in the frame before. Read as a stream; a document type or an entity is refused, since a
few of them can grow without bound.
"""

import math
import re
from pathlib import Path
from xml.parsers import expat

from pgm_data.ball import EVENT_KINDS
from pgm_data.convert.event_labels import MarkList, label_kind
from pgm_data.convert.events_csv import EventMarks

LARGEST_FILE = 512 * 2**20
DEEPEST = 32
SHAPES = ("points", "box", "ellipse", "polyline", "polygon", "cuboid", "mask", "skeleton")
EVENT_ATTRIBUTES = ("kind", "event", "action", "type", "status")
"""Names of attributes whose value may be an event."""
WHOLE = re.compile("[0-9]{1,9}", re.ASCII)


def read_cvat_marks(path: Path, size: tuple[int, int] | None = None) -> EventMarks:
    """The marks of an export; sizes are not needed, since its coordinates are pixels.

    Raises:
        ValueError: If the file cannot be read or is no such export, a shape is not what it must be, or no label names
            an event. The message names file, line and field.
    """
    del size
    reader = _Reader(path)
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise OSError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_FILE:
            raise OSError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        with path.open("rb") as file:
            reader.parser.ParseFile(file)
    except (OSError, expat.ExpatError) as error:
        raise ValueError(f"{path}: expected a CVAT export in XML, got: {error}") from error
    return reader.found.marks()


class _Reader:
    """What the parser calls, and what it has found so far."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.found = MarkList(path=path)
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refused
        self.parser.EntityDeclHandler = self._refused
        self.open: list[str] = []
        self.track_label = ""
        self.image_frame: int | None = None
        self.shape: dict[str, str] = {}
        self.attribute = ""
        self.words = ""
        self.last: tuple[int, str] | None = None
        """Frame and label of the track's shape before, where it was drawn."""

    def _refused(self, *_) -> None:
        raise self._fault("document type", "none, nor any entity", "one")

    def _fault(self, field: str, expected: str, got: object) -> ValueError:
        return ValueError(f"{self.path}: line {self.parser.CurrentLineNumber}: {field}: expected {expected}, got {got}")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if not self.open and name != "annotations":
            raise self._fault("root", "<annotations>, as of CVAT", f"<{name[:40]}>")
        self.open.append(name)
        if len(self.open) > DEEPEST:
            raise self._fault("elements", f"at most {DEEPEST} within each other", "more")
        if name == "track":
            self.track_label = self._of(attributes, "label")
            self.last = None
        elif name == "image":
            self.image_frame = self._frame(attributes, "id")
        elif name == "attribute":
            self.attribute, self.words = attributes.get("name", "").lower(), ""
        elif (name in SHAPES or name == "tag") and self.open[-2] != "skeleton":
            self.shape = dict(attributes)

    def _text(self, words: str) -> None:
        if self.attribute and len(self.words) < 200:
            self.words += words

    def _end(self, name: str) -> None:
        self.open.pop()
        if name == "attribute":
            if self.attribute in EVENT_ATTRIBUTES:
                self.shape["event"] = self.words.strip()
            self.attribute = ""
        elif name == "image":
            self.image_frame = None
        elif (name in SHAPES or name == "tag") and self.open[-1:] != ["skeleton"]:
            self._mark(name, self.shape)
            self.shape = {}

    def _mark(self, name: str, shape: dict[str, str]) -> None:
        in_track = self.open[-1:] == ["track"]
        label = self.track_label if in_track else self._of(shape, "label")
        if shape.get("event", "").lower() in EVENT_KINDS:
            label = shape["event"].lower()
        elif "event" in shape and label_kind(label) is None:
            # A ball whose attribute says that nothing happens.
            self.last = None
            self.found.labels.add(label)
            return
        frame = self.image_frame if self.image_frame is not None else self._frame(shape, "frame")
        if in_track:
            if shape.get("outside") == "1":
                self.last = None
                return
            goes_on = self.last is not None and self.last[1] == label
            self.last = (frame, label)
            if goes_on:
                return
        self.found.add(
            label,
            f"line {self.parser.CurrentLineNumber}",
            frame=float(frame),
            frames_wide=1.0,
            corner_xy=self._point(name, shape),
        )

    def _point(self, name: str, shape: dict[str, str]) -> tuple[float, float] | None:
        """Where a point is, or the middle of a box's lower edge; None of other shapes."""
        if name == "box":
            left, right, bottom = (self._number(shape, key) for key in ("xtl", "xbr", "ybr"))
            return 0.5 * (left + right), bottom
        if name == "points":
            points = self._of(shape, "points").split(";")
            pair = points[0].split(",")
            if len(points) != 1 or len(pair) != 2:
                raise self._fault("points", "one point x,y", repr(shape["points"][:60]))
            return self._number({"points": pair[0]}, "points"), self._number({"points": pair[1]}, "points")
        return None

    def _of(self, attributes: dict[str, str], key: str) -> str:
        if key not in attributes:
            raise self._fault(key, "the attribute", ", ".join(attributes) or "none")
        return attributes[key]

    def _frame(self, attributes: dict[str, str], key: str) -> int:
        text = self._of(attributes, key)
        if not WHOLE.fullmatch(text):
            raise self._fault(key, "a frame's number of 0 or more", repr(text[:40]))
        return int(text)

    def _number(self, attributes: dict[str, str], key: str) -> float:
        text = self._of(attributes, key)
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._fault(key, "a pixel coordinate", repr(text[:40]))
        return value
