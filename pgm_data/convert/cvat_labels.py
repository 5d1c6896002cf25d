"""Labels of a clip as CVAT's XML for video 1.1, and back from what a person made of them there.

Tracks: `court` with the attribute `name` (points), one a player object with the attribute `caption` (boxes), `ball`
with the attribute `event` (points), `ui` (boxes). CVAT fills in between key frames when it exports; of the court, whose
points go out in some frames only, key frames alone come back. Pixels count from the picture's corner: half a pixel is
added on the way out and taken away on the way in. Lost: everything that is not a mark in the picture, times, scores,
alternatives of captions, events' players, and parts of a pixel below 0.01.
"""

import math
from collections import Counter
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from pgm_data.ball import EVENT_KINDS
from pgm_data.convert.clip_labels import ClipLabels, spans
from pgm_data.convert.cvat_events import DEEPEST, LARGEST_FILE, WHOLE
from pgm_data.convert.event_labels import CORNER_ORIGIN
from pgm_data.dataset.files import whole_file

COURT, BALL, UI = "court", "ball", "ui"
NOTHING = "none"
"""Value of an attribute that says nothing."""
LONGEST_TEXT = 200_000
"""Characters of an attribute."""


def write_cvat_labels(path: Path, labels: ClipLabels, players: tuple[str, ...]) -> None:
    """Write the labels as one XML file."""
    tracks: list[str] = []

    def track(label: str, shapes: list[str]) -> None:
        if shapes:
            tracks.append(f'  <track id="{len(tracks)}" label={quoteattr(label)}>\n{"".join(shapes)}  </track>\n')

    for name in dict.fromkeys(labels.point_name.tolist()):
        rows = np.flatnonzero(labels.point_name == name)
        track(COURT, [_points(labels.point_frame[i], labels.point_px[i], {"name": str(name)}) for i in rows])
    for player in players:
        rows = np.flatnonzero(labels.box_name == player)
        said = _said(labels, player, labels.box_frame[rows])
        shapes = [
            _box(labels.box_frame[row], labels.box_px[row], {"caption": words})
            for row, words in zip(rows, said, strict=True)
        ]
        track(player, _ended(shapes, labels.box_frame[rows], labels))
    event = {int(frame): str(kind) for frame, kind in zip(labels.event_frame, labels.event_kind, strict=True)}
    shapes = [
        _points(frame, pixel, {"event": event.get(int(frame), NOTHING)})
        for frame, pixel in zip(labels.ball_frame, labels.ball_px, strict=True)
    ]
    track(BALL, _ended(shapes, labels.ball_frame, labels))
    for box in labels.ui_px:
        track(UI, [_box(np.int64(labels.first_frame), box, {})])
    names = (COURT, *players, BALL, UI)
    declared = "".join(f"<label><name>{escape(name)}</name></label>" for name in names)
    text = (
        '<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n  <version>1.1</version>\n'
        f"  <meta><task><size>{labels.first_frame + labels.frames}</size><mode>interpolation</mode>"
        f"<labels>{declared}</labels></task>"
        f"<original_size><width>{labels.size[0]}</width><height>{labels.size[1]}</height></original_size></meta>\n"
        f"{''.join(tracks)}</annotations>\n"
    )
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _said(labels: ClipLabels, player: str, frames: np.ndarray) -> list[str]:
    """What is said of the player in each of the frames."""
    words = [""] * len(frames)
    for row in np.flatnonzero(labels.text_name == player):
        for place in np.flatnonzero((frames >= labels.text_start[row]) & (frames < labels.text_end[row])):
            words[place] = str(labels.text[row])
    return words


def _attributes(attributes: dict[str, str]) -> str:
    return "".join(
        f"<attribute name={quoteattr(name)}>{escape(value)}</attribute>" for name, value in attributes.items()
    )


def _shape(kind: str, frame: np.int64, place: str, attributes: dict[str, str], *, outside: bool = False) -> str:
    head = f'frame="{int(frame)}" outside="{int(outside)}" occluded="0" keyframe="1" z_order="0"'
    return f"    <{kind} {head} {place}>{_attributes(attributes)}</{kind}>\n"


def _points(frame: np.int64, pixel: np.ndarray, attributes: dict[str, str]) -> str:
    x, y = pixel + CORNER_ORIGIN
    return _shape("points", frame, f'points="{x:.2f},{y:.2f}"', attributes)


def _box(frame: np.int64, box: np.ndarray, attributes: dict[str, str]) -> str:
    sides = zip(("xtl", "ytl", "xbr", "ybr"), box + CORNER_ORIGIN, strict=True)
    return _shape("box", frame, " ".join(f'{name}="{value:.2f}"' for name, value in sides), attributes)


def _ended(shapes: list[str], frames: np.ndarray, labels: ClipLabels) -> list[str]:
    """The shapes, each run of frames ended by one that is outside: else CVAT would draw on through the gap."""
    ends = set(np.flatnonzero(np.diff(frames) > 1).tolist())
    if len(frames) and frames[-1] < labels.first_frame + labels.frames - 1:
        ends.add(len(frames) - 1)
    whole = []
    for place, shape in enumerate(shapes):
        whole.append(shape)
        if place in ends:
            gone = shape.replace(
                f'frame="{int(frames[place])}" outside="0"', f'frame="{int(frames[place]) + 1}" outside="1"'
            )
            whole.append(gone)
    return whole


def read_cvat_labels(
    path: Path, about: ClipLabels, players: tuple[str, ...], points: tuple[str, ...]
) -> tuple[ClipLabels, tuple[str, ...]]:
    """The labels of an export, as far as they lie in the clip, and what was left out because of its label.

    Args:
        path: The file.
        about: The clip's own labels, for its video, size and frames.
        players: Player objects of the scene.
        points: Points of its court.

    Raises:
        ValueError: If the file cannot be read or is no such export, or a shape is not what it must be. The message
            names file, line and field.
    """
    reader = _Reader(path, players, points)
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise OSError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_FILE:
            raise OSError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        with path.open("rb") as file:
            reader.parser.ParseFile(file)
    except (OSError, expat.ExpatError) as error:
        raise ValueError(f"{path}: expected a CVAT export in XML, got: {error}") from error
    return labels_of(reader.found, about), left_out(reader.found, path, (COURT, *players, BALL, UI))


class Found:
    """Labels as they are read, one by one."""

    def __init__(self) -> None:
        self.points: list[tuple[str, int, float, float]] = []
        self.boxes: list[tuple[str, int, float, float, float, float]] = []
        self.balls: list[tuple[int, float, float]] = []
        self.events: list[tuple[int, str]] = []
        self.words: list[tuple[str, int, str]] = []
        self.texts: list[tuple[str, int, int, str]] = []
        self.ui: list[tuple[float, float, float, float]] = []
        self.strange: Counter[str] = Counter()
        """Labels that are none of ours, and how many shapes have each."""


def left_out(found: Found, path: Path, known: tuple[str, ...]) -> tuple[str, ...]:
    """A line for each label that is none of ours."""
    return tuple(
        f"{path}: label: expected one of {', '.join(known)}, got {label[:60]!r}: {count} left out"
        for label, count in found.strange.items()
    )


def labels_of(found: Found, about: ClipLabels) -> ClipLabels:
    """The labels that were read, as far as they lie in the clip; captions from the words of single frames."""
    first, last = about.first_frame, about.first_frame + about.frames

    def inside(rows: list, place: int) -> list:
        return sorted(row for row in rows if first <= row[place] < last)

    points, boxes = inside(found.points, 1), inside(found.boxes, 1)
    balls, events = inside(found.balls, 0), inside(found.events, 0)
    texts = list(found.texts)
    for name in sorted({row[0] for row in found.words}):
        own = [row for row in found.words if row[0] == name]
        frames, said = np.array([row[1] for row in own]), np.array([row[2] for row in own], dtype=object)
        texts += [(name, start, end, text) for start, end, text in spans(frames, said)]
    texts = sorted((n, max(s, first), min(e, last), t) for n, s, e, t in texts if s < last and e > first)

    def column(rows: list, place: int, dtype: type) -> np.ndarray:
        return np.array([row[place] for row in rows], dtype=dtype)

    def pixels(rows: list, place: int, size: int) -> np.ndarray:
        return np.array([row[place : place + size] for row in rows], dtype=float).reshape(-1, size) - CORNER_ORIGIN

    return ClipLabels(
        video=about.video,
        size=about.size,
        first_frame=first,
        frames=about.frames,
        point_name=column(points, 0, object),
        point_frame=column(points, 1, np.int64),
        point_px=pixels(points, 2, 2),
        box_name=column(boxes, 0, object),
        box_frame=column(boxes, 1, np.int64),
        box_px=pixels(boxes, 2, 4),
        ball_frame=column(balls, 0, np.int64),
        ball_px=pixels(balls, 1, 2),
        event_frame=column(events, 0, np.int64),
        event_kind=column(events, 1, object),
        text_name=column(texts, 0, object),
        text_start=column(texts, 1, np.int64),
        text_end=column(texts, 2, np.int64),
        text=column(texts, 3, object),
        ui_px=pixels(sorted(set(found.ui)), 0, 4),
    )


class _Reader:
    """What the parser calls, and what it has found so far."""

    def __init__(self, path: Path, players: tuple[str, ...], points: tuple[str, ...]) -> None:
        self.path, self.players, self.point_names = path, players, points
        self.found = Found()
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.StartDoctypeDeclHandler = self._refused
        self.parser.EntityDeclHandler = self._refused
        self.open: list[str] = []
        self.label = ""
        self.shape: dict[str, str] = {}
        self.values: dict[str, str] = {}
        self.attribute: str | None = None
        self.words: list[str] = []
        self.length = 0

    def _fault(self, field: str, expected: str, got: object) -> ValueError:
        return ValueError(f"{self.path}: line {self.parser.CurrentLineNumber}: {field}: expected {expected}, got {got}")

    def _refused(self, *_) -> None:
        raise self._fault("document type", "none, nor any entity", "one")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if not self.open and name != "annotations":
            raise self._fault("root", "<annotations>, as of CVAT", f"<{name[:40]}>")
        self.open.append(name)
        if len(self.open) > DEEPEST:
            raise self._fault("elements", f"at most {DEEPEST} within each other", "more")
        if name == "track":
            self.label = attributes.get("label", "")
        elif name in ("points", "box") and self.open[-2:-1] == ["track"]:
            self.shape, self.values = dict(attributes), {}
        elif name == "attribute" and self.shape:
            self.attribute, self.words, self.length = attributes.get("name", "").lower(), [], 0

    def _text(self, words: str) -> None:
        if self.attribute is not None:
            self.length += len(words)
            if self.length > LONGEST_TEXT:
                raise self._fault(self.attribute, f"at most {LONGEST_TEXT} characters", "more")
            self.words.append(words)

    def _end(self, name: str) -> None:
        self.open.pop()
        if name == "attribute" and self.attribute is not None:
            self.values[self.attribute] = "".join(self.words).strip()
            self.attribute = None
        elif name in ("points", "box") and self.shape:
            if self.shape.get("outside") != "1":
                self._mark(name)
            self.shape = {}

    def _mark(self, kind: str) -> None:
        frame_text = self.shape.get("frame", "")
        if not WHOLE.fullmatch(frame_text):
            raise self._fault("frame", "a frame's number of 0 or more", repr(frame_text[:40]))
        frame = int(frame_text)
        if self.label == COURT and kind == "points":
            name = self.values.get("name", "")
            if name not in self.point_names:
                raise self._fault("name", f"one of {', '.join(self.point_names)}", repr(name[:40]))
            if self.shape.get("keyframe", "1") == "1":
                self.found.points.append((name, frame, *self._xy()))
        elif self.label in self.players and kind == "box":
            self.found.boxes.append((self.label, frame, *self._corners()))
            words = self.values.get("caption", "")
            self.found.words.append((self.label, frame, "" if words == NOTHING else words))
        elif self.label == BALL and kind == "points":
            self.found.balls.append((frame, *self._xy()))
            event = self.values.get("event", NOTHING)
            if event in EVENT_KINDS:
                self.found.events.append((frame, event))
            elif event not in ("", NOTHING):
                raise self._fault("event", f"one of {', '.join(EVENT_KINDS)} or {NOTHING}", repr(event[:40]))
        elif self.label == UI and kind == "box":
            self.found.ui.append(self._corners())
        else:
            self.found.strange[f"{self.label} ({kind})"] += 1

    def _xy(self) -> tuple[float, float]:
        text = self.shape.get("points", "")
        pair = text.split(",")
        if ";" in text or len(pair) != 2:
            raise self._fault("points", "one point x,y", repr(text[:60]))
        return self._number("points", pair[0]), self._number("points", pair[1])

    def _corners(self) -> tuple[float, float, float, float]:
        left, top, right, bottom = (self._number(n, self.shape.get(n, "")) for n in ("xtl", "ytl", "xbr", "ybr"))
        if right <= left or bottom <= top:
            raise self._fault("box", "xtl < xbr and ytl < ybr", f"{left}, {top}, {right}, {bottom}")
        return left, top, right, bottom

    def _number(self, field: str, text: str) -> float:
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._fault(field, "a pixel coordinate", repr(text[:40]))
        return value
