"""Captions as JSON: a list of objects with the fields of the CSV's columns, or an object with it as `captions`."""

import json
import re
from collections.abc import Mapping
from pathlib import Path

from pgm_data.convert.captions_rows import ALIASES, CaptionFile
from pgm_data.dataset.clip_captions import CaptionRows

NAMES = {alias: name for name, aliases in ALIASES.items() for alias in aliases}


def read_captions_json(path: Path, document: object) -> CaptionFile:
    """The rows of a parsed file.

    Raises:
        ValueError: If it is no list of captions.
    """
    rows = document.get("captions") if isinstance(document, dict) else document
    if not isinstance(rows, list):
        expected = "a list of captions, or an object with one as `captions`"
        raise ValueError(f"{path}: expected {expected}, got {type(document).__name__}")
    found = CaptionFile(path=path)
    for number, row in enumerate(rows):
        place = f"[{number}]"
        if not isinstance(row, dict):
            found.refuse(place, "", "an object", row)
            continue
        values: dict[str, object] = {}
        twice = ""
        for title, value in row.items():
            name = NAMES.get(re.sub("[^a-z0-9]", "", str(title).lower()))
            twice = name if name is not None and name in values else twice
            if name is not None:
                values[name] = value
        if twice:
            found.refuse(place, twice, "one such field", ", ".join(row))
            continue
        texts = values.get("text")
        if isinstance(texts, list):
            for k, text in enumerate(texts):
                found.add(f"{place}.text[{k}]", values | {"text": text, "alternative": k})
        else:
            found.add(place, values)
    return found


def captions_json(captions: Mapping[str, CaptionRows], players: tuple[str, ...]) -> str:
    """The text of a file that holds the captions of clips; nothing is lost."""
    rows = [
        {
            "clip": clip_id,
            "player": players[int(table.player[k])],
            "start_frame": int(table.start_frame[k]),
            "end_frame": int(table.end_frame[k]),
            "start_s": float(table.start_s[k]),
            "end_s": float(table.end_s[k]),
            "text": str(table.text[k]),
            "source": str(table.source[k]),
            "alternative": int(table.alternative[k]),
        }
        for clip_id, table in captions.items()
        for k in range(len(table))
    ]
    return json.dumps({"captions": rows}, indent=1, ensure_ascii=False) + "\n"
