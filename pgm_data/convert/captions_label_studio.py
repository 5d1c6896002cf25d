"""Captions from Label Studio's JSON export: texts that people wrote about spans of a video.

A region is a span of the time line (`timelinelabels`, frames from 1, the last one included), of the sound (`labels`
with `start` and `end` in seconds), or of a dialogue (`paragraphs`, whose lines have times in the task's data). Its text
is that of the `textarea` of the same region, several entries being alternatives; its player is a label, a choice or the
dialogue's author. Predictions and cancelled annotations count for nothing.
"""

from pathlib import Path, PurePosixPath
from typing import Any

from pgm_data.convert.captions_rows import CaptionFile

SPAN_TYPES = ("timelinelabels", "labels", "paragraphlabels", "paragraphs", "textarea", "choices")
LABEL_KEYS = ("timelinelabels", "labels", "paragraphlabels", "choices")
LINE_START, LINE_END = ("start", "start_time", "begin"), ("end", "end_time", "stop")


def is_label_studio(document: Any) -> bool:
    """Whether a parsed JSON file is such an export."""
    tasks = document if isinstance(document, list) else [document]
    return bool(tasks) and all(isinstance(task, dict) and "annotations" in task and "data" in task for task in tasks)


def read_captions_label_studio(path: Path, document: Any) -> CaptionFile:
    """The regions of a parsed export that have a text."""
    found = CaptionFile(path=path)
    tasks = document if isinstance(document, list) else [document]
    for number, task in enumerate(tasks):
        data = task["data"] if isinstance(task.get("data"), dict) else {}
        annotations = task["annotations"] if isinstance(task.get("annotations"), list) else []
        for index, annotation in enumerate(annotations):
            if isinstance(annotation, dict) and not annotation.get("was_cancelled"):
                place = f"[{number}].annotations[{index}]"
                _annotation(found, place, annotation.get("result"), data, _video(task, data))
    return found


def _video(task: dict[str, Any], data: dict[str, Any]) -> str:
    """Name of the task's video, without the folder and the eight digits that an upload puts before it."""
    for key in ("video", "audio", "url", "file"):
        if isinstance(data.get(key), str):
            name = PurePosixPath(data[key].split("?")[0].replace("\\", "/")).name
            head, dash, rest = name.partition("-")
            return rest if dash and len(head) == 8 and all(c in "0123456789abcdef" for c in head) else name
    return str(data.get("clip", ""))


def _annotation(found: CaptionFile, place: str, result: object, data: dict[str, Any], video: str) -> None:
    """Regions of one annotation, put together by their ids."""
    if not isinstance(result, list):
        found.refuse(f"{place}.result", "", "a list", result)
        return
    regions: dict[str, dict[str, Any]] = {}
    for row, part in enumerate(result):
        if not isinstance(part, dict) or part.get("type") not in SPAN_TYPES or not isinstance(part.get("value"), dict):
            continue
        key = str(part.get("id") or f"row {row}")
        region = regions.setdefault(key, {"place": f"{place}.result[{row}]", "texts": [], "names": []})
        value = part["value"]
        if part["type"] == "textarea":
            texts = value.get("text")
            region["texts"] += [texts] if isinstance(texts, str) else texts if isinstance(texts, list) else []
        for name in LABEL_KEYS:
            region["names"] += value[name] if isinstance(value.get(name), list) else []
        for name in ("ranges", "start", "end"):
            if name in value and name not in region:
                region[name] = value[name]
        if part["type"] in ("paragraphlabels", "paragraphs"):
            region["lines"] = next((lines for lines in data.values() if isinstance(lines, list)), [])
    for region in regions.values():
        if region["texts"]:
            _region(found, region, video)


def _region(found: CaptionFile, region: dict[str, Any], video: str) -> None:
    place = region["place"]
    names = [name for name in region["names"] if isinstance(name, str)]
    author, spans = "", []
    if isinstance(region.get("ranges"), list):
        for span in region["ranges"]:
            start, end = (span.get(name) if isinstance(span, dict) else None for name in ("start", "end"))
            first = start - 1 if isinstance(start, int | float) and not isinstance(start, bool) else start
            spans.append({"start_video_frame": first, "end_video_frame": end})
    elif "lines" in region:
        one, two = _line(region, "start"), _line(region, "end")
        if one is None or two is None:
            got = f"{region.get('start')}, {region.get('end')}"
            found.refuse(f"{place}.value", "start, end", "lines of the dialogue", got)
            return
        author = str(one.get("author", one.get("speaker", "")))
        spans = [{"start_s": _first(one, LINE_START), "end_s": _first(two, LINE_END)}]
    else:
        spans = [{"start_s": region.get("start"), "end_s": region.get("end")}]
    for span in spans:
        for k, text in enumerate(region["texts"]):
            said = {"clip": video, "player": names[0] if names else author, "text": text, "alternative": k}
            found.add(place, span | said)


def _line(region: dict[str, Any], name: str) -> dict[str, Any] | None:
    """The line of a dialogue that a region's start or end names by its number."""
    number = region.get(name)
    if not str(number).isdigit() or int(str(number)) >= len(region["lines"]):
        return None
    line = region["lines"][int(str(number))]
    return line if isinstance(line, dict) else None


def _first(line: dict[str, Any], names: tuple[str, ...]) -> object:
    return next((line[name] for name in names if name in line), None)
