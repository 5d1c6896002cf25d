"""Labels of a clip as tasks of Label Studio with predictions, and back from its JSON export.

Boxes (`videorectangle`): player objects, `ui`, the ball and the court's points (`court NAME`) as small ones about the
point, since its free edition has no points in videos; events and captions as spans of the time line (`timelinelabels`),
a caption's words as a `textarea` of the same region. Frames count from 1, coordinates are percent of the picture,
between key frames boxes go straight. Lost: as with CVAT; of boxes, parts below a millionth of the picture.
"""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pgm_data import __version__
from pgm_data.ball import EVENT_KINDS
from pgm_data.convert.clip_labels import ClipLabels
from pgm_data.convert.cvat_labels import BALL, UI, Found, labels_of, left_out
from pgm_data.convert.event_labels import CORNER_ORIGIN
from pgm_data.dataset.documents import parse_document
from pgm_data.dataset.files import whole_file

POINT_SIZE_PX = 12.0
"""Side of the box about a point."""
COURT_WORD = "court "
LAST_FRAME = 10_000_000


def write_label_studio_labels(path: Path, labels: ClipLabels, players: tuple[str, ...]) -> None:
    """Write the labels as one task with one prediction."""
    result: list[dict[str, Any]] = []

    def boxes(label: str, frames: np.ndarray, boxes_px: np.ndarray) -> None:
        if len(frames):
            sequence = [_key(labels, int(frame), box) for frame, box in zip(frames, boxes_px, strict=True)]
            for place, (one, two) in enumerate(pairwise(frames.tolist())):
                sequence[place]["enabled"] = two == one + 1 or label.startswith(COURT_WORD)
            sequence[-1]["enabled"] = label == UI
            value = {"framesCount": labels.first_frame + labels.frames, "sequence": sequence, "labels": [label]}
            result.append(_region(len(result), "box", "videorectangle", value))

    for name in dict.fromkeys(labels.point_name.tolist()):
        rows = np.flatnonzero(labels.point_name == name)
        boxes(f"{COURT_WORD}{name}", labels.point_frame[rows], _about(labels.point_px[rows]))
    for player in players:
        rows = np.flatnonzero(labels.box_name == player)
        boxes(player, labels.box_frame[rows], labels.box_px[rows])
    boxes(BALL, labels.ball_frame, _about(labels.ball_px))
    for box in labels.ui_px:
        boxes(UI, np.array([labels.first_frame]), box[None])
    for frame, kind in zip(labels.event_frame.tolist(), labels.event_kind, strict=True):
        value = {"ranges": [{"start": frame + 1, "end": frame + 1}], "timelinelabels": [str(kind)]}
        result.append(_region(len(result), "event", "timelinelabels", value))
    for name, start, end, text in zip(
        labels.text_name, labels.text_start.tolist(), labels.text_end.tolist(), labels.text, strict=True
    ):
        span = {"ranges": [{"start": start + 1, "end": end}]}
        number = len(result)
        result.append(_region(number, "caption", "timelinelabels", span | {"timelinelabels": [str(name)]}))
        result.append(_region(number, "words", "textarea", span | {"text": [str(text)]}))
    task = {
        "data": {"video": labels.video},
        "predictions": [{"model_version": f"pgm {__version__}", "result": result}],
    }
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps([task], allow_nan=False), encoding="utf-8")


def _region(number: int, source: str, kind: str, value: dict[str, Any]) -> dict[str, Any]:
    return {"id": f"pgm{number}", "from_name": source, "to_name": "video", "type": kind, "value": value}


def _about(points_px: np.ndarray) -> np.ndarray:
    return np.concatenate([points_px - POINT_SIZE_PX / 2, points_px + POINT_SIZE_PX / 2], axis=1)


def _key(labels: ClipLabels, frame: int, box: np.ndarray) -> dict[str, Any]:
    x0, y0, x1, y1 = box + CORNER_ORIGIN
    wide, high = labels.size
    place = {"x": x0 / wide, "y": y0 / high, "width": (x1 - x0) / wide, "height": (y1 - y0) / high}
    return {"frame": frame + 1, "enabled": True, "rotation": 0} | {n: round(100 * v, 6) for n, v in place.items()}


def read_label_studio_labels(
    path: Path, about: ClipLabels, players: tuple[str, ...], points: tuple[str, ...]
) -> tuple[ClipLabels, tuple[str, ...]]:
    """The labels of an export's annotations, as far as they lie in the clip, and what was left out by its label.

    Predictions count for nothing.

    Args:
        path: The file.
        about: The clip's own labels, for its video, size and frames.
        players: Player objects of the scene.
        points: Points of its court.

    Raises:
        ValueError: If the file is no such export or a region is not what it must be; names file, place and field.
    """
    tasks = parse_document(path)
    tasks = [tasks] if isinstance(tasks, dict) else tasks
    if not isinstance(tasks, list):
        raise ValueError(f"{path}: expected a list of Label Studio's tasks, got {type(tasks).__name__}")
    found = Found()
    for number, task in enumerate(tasks):
        annotations = task.get("annotations") if isinstance(task, dict) else None
        if not isinstance(annotations, list):
            raise ValueError(f"{path}: [{number}].annotations: expected a list, got {type(annotations).__name__}")
        for index, annotation in enumerate(annotations):
            if isinstance(annotation, dict) and not annotation.get("was_cancelled"):
                place = f"[{number}].annotations[{index}].result"
                _Reader(path, found, about, players, points).read(annotation.get("result"), place)
    return labels_of(found, about), left_out(found, path, (f"{COURT_WORD}NAME", *players, BALL, UI, *EVENT_KINDS))


class _Reader:
    """Takes the regions of one annotation in."""

    def __init__(
        self, path: Path, found: Found, about: ClipLabels, players: tuple[str, ...], points: tuple[str, ...]
    ) -> None:
        self.path, self.found, self.about, self.players, self.points = path, found, about, players, points

    def _fault(self, place: str, expected: str, got: object) -> ValueError:
        return ValueError(f"{self.path}: {place}: expected {expected}, got {str(got)[:80]!r}")

    def read(self, result: object, place: str) -> None:
        """Take the regions in."""
        if not isinstance(result, list):
            raise self._fault(place, "a list", type(result).__name__)
        spans: dict[str, tuple[str, int, int]] = {}
        words: dict[str, str] = {}
        for row, region in enumerate(result):
            value = region.get("value") if isinstance(region, dict) else None
            if not isinstance(region, dict) or not isinstance(value, dict):
                raise self._fault(f"{place}[{row}].value", "fields", type(value).__name__)
            at, kind, key = f"{place}[{row}].value", region.get("type"), str(region.get("id") or f"row {row}")
            if kind == "videorectangle":
                self._boxes(value, at)
            elif kind == "timelinelabels":
                label, start, end = self._span(value, at)
                if label in EVENT_KINDS:
                    self.found.events.append((start, label))
                elif label in self.players:
                    spans[key] = (label, start, end)
                else:
                    self.found.strange[label] += 1
            elif kind == "textarea":
                text = value.get("text")
                text = text[0] if isinstance(text, list) and text else text
                if not isinstance(text, str):
                    raise self._fault(f"{at}.text", "a text", text)
                words[key] = text.strip()
        self.found.texts += [(*spans[key], text) for key, text in words.items() if key in spans and text]

    def _label(self, value: dict[str, Any], names: tuple[str, ...], at: str) -> str:
        labels = next((value[name] for name in names if isinstance(value.get(name), list)), [])
        if len(labels) != 1 or not isinstance(labels[0], str):
            raise self._fault(f"{at}.{names[0]}", "one label", labels)
        return labels[0]

    def _span(self, value: dict[str, Any], at: str) -> tuple[str, int, int]:
        label = self._label(value, ("timelinelabels", "labels"), at)
        ranges = value.get("ranges")
        if not isinstance(ranges, list) or len(ranges) != 1 or not isinstance(ranges[0], dict):
            raise self._fault(f"{at}.ranges", "one range", ranges)
        start, end = (self._frame(ranges[0].get(name), f"{at}.ranges[0].{name}") for name in ("start", "end"))
        if end < start:
            raise self._fault(f"{at}.ranges[0].end", f"at least {start + 1}", end + 1)
        return label, start, end + 1

    def _boxes(self, value: dict[str, Any], at: str) -> None:
        label = self._label(value, ("labels", "videolabels", "rectanglelabels"), at)
        sequence = value.get("sequence")
        if not isinstance(sequence, list):
            raise self._fault(f"{at}.sequence", "a list", type(sequence).__name__)
        keys = [self._key_box(key, f"{at}.sequence[{i}]") for i, key in enumerate(sequence)]
        keys.sort(key=lambda key: key[0])
        if label == UI:
            self.found.ui += [box for _, box, _ in keys[:1]]
            return
        if label.startswith(COURT_WORD):
            name = label[len(COURT_WORD) :]
            if name not in self.points:
                raise self._fault(f"{at}.labels", f"court and one of {', '.join(self.points)}", label)
            self.found.points += [(name, frame, *_middle(box)) for frame, box, _ in keys]
        elif label not in self.players and label != BALL:
            self.found.strange[label] += len(keys)
        else:
            for frame, box in _between(keys):
                if label == BALL:
                    self.found.balls.append((frame, *_middle(box)))
                else:
                    self.found.boxes.append((label, frame, *box))

    def _key_box(self, key: object, at: str) -> tuple[int, tuple[float, float, float, float], bool]:
        if not isinstance(key, dict):
            raise self._fault(at, "fields", type(key).__name__)
        numbers = []
        for name in ("x", "y", "width", "height"):
            value = key.get(name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
                raise self._fault(f"{at}.{name}", "percent of the picture", value)
            numbers.append(float(value) / 100)
        x, y, w, h = numbers
        if w <= 0 or h <= 0:
            raise self._fault(f"{at}.width, height", "above 0", f"{100 * w:g}, {100 * h:g}")
        wide, high = self.about.size
        box = (x * wide, y * high, (x + w) * wide, (y + h) * high)
        return self._frame(key.get("frame"), f"{at}.frame"), box, bool(key.get("enabled", True))

    def _frame(self, value: object, at: str) -> int:
        """A frame of the video, from 0."""
        if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= LAST_FRAME:
            raise self._fault(at, "a frame's number from 1", value)
        return value - 1


def _middle(box: tuple[float, float, float, float]) -> tuple[float, float]:
    return (box[0] + box[2]) / 2, (box[1] + box[3]) / 2


def _between(
    keys: list[tuple[int, tuple[float, float, float, float], bool]],
) -> list[tuple[int, tuple[float, float, float, float]]]:
    """The boxes of all frames that a sequence covers: straight from a key to the next where it is enabled."""
    found = []
    for (frame, box, enabled), (following, other, _) in pairwise(keys):
        last = following if enabled else frame + 1
        for at in range(frame, last):
            share = (at - frame) / (following - frame)
            a, b, c, d = (one + share * (two - one) for one, two in zip(box, other, strict=True))
            found.append((at, (a, b, c, d)))
    return found + [(frame, box) for frame, box, _ in keys[-1:]]
