"""Captions as CSV: clip, player, start and end in frames or seconds, text; headers and order as they come."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path

from pgm_data.convert.captions_rows import ALIASES, CaptionFile
from pgm_data.convert.loose_csv import read_loose_csv
from pgm_data.dataset.clip_captions import CaptionRows

LONGEST_TEXT = 2**22
"""Characters of a cell: the csv module's own limit is less than long captions need."""
HEADER = ("clip", "player", "start_frame", "end_frame", "start_s", "end_s", "text", "source", "alternative")


def read_captions_csv(path: Path) -> CaptionFile:
    """The rows of a file.

    Raises:
        ValueError: If the file cannot be read or lacks the columns.
    """
    before = csv.field_size_limit(LONGEST_TEXT)
    try:
        table = read_loose_csv(path, ALIASES, required=("text",))
    finally:
        csv.field_size_limit(before)
    found = CaptionFile(path=path)
    columns = {name: table.texts(name) for name in table.names}
    for row, line in enumerate(table.lines):
        values: dict[str, object] = {name: cells[row] for name, cells in columns.items()}
        if table.decimal_comma:
            for name in ("start_s", "end_s"):
                values |= {name: str(values[name]).replace(",", ".")} if name in values else {}
        found.add(f"line {line}", values)
    return found


def captions_csv(captions: Mapping[str, CaptionRows], players: tuple[str, ...]) -> str:
    """The text of a file that holds the captions of clips; times to their last digit, nothing is lost."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADER)
    for clip_id, rows in captions.items():
        for k in range(len(rows)):
            writer.writerow(
                (
                    clip_id,
                    players[int(rows.player[k])],
                    int(rows.start_frame[k]),
                    int(rows.end_frame[k]),
                    repr(float(rows.start_s[k])),
                    repr(float(rows.end_s[k])),
                    str(rows.text[k]),
                    str(rows.source[k]),
                    int(rows.alternative[k]),
                )
            )
    return out.getvalue()
