"""Label Studio's JSON export: hits and bounces that people marked on a video's time line, as boxes or as key points.

Frames of its time line and of its boxes count from 1. It counts them by the rate that its project states (24 a second
unless set): an export that counts fewer frames than the clip has is refused. Coordinates are percent.
"""

import math
import re
from pathlib import Path
from typing import Any

from pgm_data.convert.event_labels import MarkList, label_kind
from pgm_data.convert.events_csv import EventMarks
from pgm_data.dataset.documents import parse_document

FILE_FRAME = re.compile(r"(\d{1,9})\.[A-Za-z]\w*$", re.ASCII)
LABEL_KEYS = ("timelinelabels", "labels", "videolabels", "keypointlabels", "rectanglelabels")


def read_label_studio_marks(path: Path, size: tuple[int, int] | None = None) -> EventMarks:
    """The marks of an export: of each task its annotations, but for cancelled ones; never its predictions.

    Args:
        path: The file.
        size: Width and height of the picture, px; needed for boxes of videos, which do not say it.

    Raises:
        ValueError: If the file is no such export, a region is not what it must be, there are several videos, or no
            label names an event. The message names file, place and field.
    """
    tasks = parse_document(path)
    found = MarkList(path=path)
    if isinstance(tasks, dict):
        tasks = [tasks]
    if not isinstance(tasks, list):
        raise ValueError(f"{path}: expected a list of Label Studio's tasks, got {type(tasks).__name__}")
    videos = set()
    for number, task in enumerate(tasks):
        place = f"[{number}]"
        data = _field(path, task, place, "data", dict)
        videos |= {str(value) for key, value in data.items() if key == "video"}
        if len(videos) > 1:
            raise ValueError(
                f"{path}: {place}.data.video: expected the tasks of one video, got {', '.join(sorted(videos))}"
            )
        for index, annotation in enumerate(_field(path, task, place, "annotations", list)):
            inner = f"{place}.annotations[{index}]"
            if not isinstance(annotation, dict) or annotation.get("was_cancelled"):
                continue
            for row, region in enumerate(_field(path, annotation, inner, "result", list)):
                _Region(path, f"{inner}.result[{row}]", region, data, size).mark(found)
    return found.marks()


class _Region:
    """One region of an annotation."""

    def __init__(self, path: Path, place: str, region: object, data: dict[str, Any], size: tuple[int, int] | None):
        self.path = path
        self.place = place
        self.region = {} if not isinstance(region, dict) else region
        self.data = data
        self.size = size
        self.value: dict[str, Any] = {}

    def mark(self, found: MarkList) -> None:
        """Add what the region marks; relations and other kinds of regions mark nothing."""
        kind = self.region.get("type")
        if kind not in ("timelinelabels", "videorectangle", "keypointlabels", "rectanglelabels"):
            return
        self.value = _field(self.path, self.region, self.place, "value", dict)
        labels = [
            label
            for key in LABEL_KEYS
            if isinstance(self.value.get(key), list)
            for label in self.value[key]
            if isinstance(label, str)
        ]
        for label in labels:
            if label_kind(label) is None:
                found.labels.add(label)
            elif kind == "timelinelabels":
                self._ranges(found, label)
            elif kind == "videorectangle":
                self._sequence(found, label)
            else:
                found.add(
                    label,
                    self.place,
                    frame=float(self._picture_frame()),
                    frames_wide=1.0,
                    corner_xy=self._corner(self.value, self.region, f"{self.place}.value"),
                )

    def _ranges(self, found: MarkList, label: str) -> None:
        for index, span in enumerate(_field(self.path, self.value, f"{self.place}.value", "ranges", list)):
            place = f"{self.place}.value.ranges[{index}]"
            start, end = (self._number(span, place, key) for key in ("start", "end"))
            if start < 1 or end < start:
                raise self._fault(place, "a start of 1 or more and no end before it", f"{start:g}, {end:g}")
            # Somewhere from the first frame to the last of the span.
            middle, wide = 0.5 * (start + end) - 1, end - start + 1
            found.add(label, place, frame=middle, frames_wide=wide, corner_xy=None)

    def _sequence(self, found: MarkList, label: str) -> None:
        """A box over time: each time it appears is an event, at its first key frame."""
        if "framesCount" in self.value:
            found.frames_counted = round(self._number(self.value, f"{self.place}.value", "framesCount"))
        drawn = False
        for index, key in enumerate(_field(self.path, self.value, f"{self.place}.value", "sequence", list)):
            place = f"{self.place}.value.sequence[{index}]"
            frame = self._number(key, place, "frame")
            if frame < 1 or frame != math.floor(frame):
                raise self._fault(f"{place}.frame", "a whole number of 1 or more", f"{frame:g}")
            if not drawn:
                corner = self._corner(key, self.region, place)
                found.add(label, place, frame=frame - 1, frames_wide=1.0, corner_xy=corner)
            drawn = bool(key.get("enabled", True))

    def _corner(self, box: dict[str, Any], region: dict[str, Any], place: str) -> tuple[float, float] | None:
        """A key point, or the middle of a box's lower edge, in pixels from the picture's corner."""
        x, y = self._number(box, place, "x"), self._number(box, place, "y")
        if region["type"] != "keypointlabels":
            x += 0.5 * self._number(box, place, "width")
            y += self._number(box, place, "height")
        width, height = region.get("original_width"), region.get("original_height")
        if isinstance(width, int | float) and isinstance(height, int | float) and width > 0 and height > 0:
            return x / 100 * width, y / 100 * height
        if self.size is None:
            raise self._fault(f"{self.place}.original_width", "the picture's size, there or given", "neither")
        return x / 100 * self.size[0], y / 100 * self.size[1]

    def _picture_frame(self) -> int:
        """Frame of a region of a still: its own (from 1), its item's, its task's, or that of its picture's name."""
        if "frame" in self.value:
            return round(self._number(self.value, f"{self.place}.value", "frame")) - 1
        if isinstance(self.region.get("item_index"), int):
            return self.region["item_index"]
        if isinstance(self.data.get("frame"), int):
            return self.data["frame"]
        names = [
            match for value in self.data.values() if isinstance(value, str) and (match := FILE_FRAME.search(value))
        ]
        if len(names) != 1:
            expected = "a frame: value.frame, item_index, data.frame, or a picture's name that ends in one"
            raise self._fault(self.place, expected, f"{len(names)} names")
        return int(names[0][1])

    def _number(self, values: object, place: str, key: str) -> float:
        value = values.get(key) if isinstance(values, dict) else None
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self._fault(f"{place}.{key}", "a number", repr(value)[:60])
        return float(value)

    def _fault(self, place: str, expected: str, got: str) -> ValueError:
        return ValueError(f"{self.path}: {place}: expected {expected}, got {got}")


def _field(path: Path, values: object, place: str, key: str, kind: type) -> Any:
    value = values.get(key) if isinstance(values, dict) else None
    if not isinstance(value, kind):
        raise ValueError(f"{path}: {place}.{key}: expected a {kind.__name__}, got {repr(value)[:60]}")
    return value
