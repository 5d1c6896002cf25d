"""The numbers of a dataset as a table that a card and a terminal show alike, as plain data, and as files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pgm_data.dataset.files import whole_file
from pgm_data.dataset.stats import ALL, DatasetStats, tally_document
from pgm_data.dataset.stats_histograms import histogram_svg, histograms_of
from pgm_data.dataset.stats_words import PARTS

ROWS: tuple[tuple[str, Callable[[Mapping[str, Any]], str]], ...] = (
    ("Matches", lambda own: _whole(own["matches"])),
    ("Sequences", lambda own: _whole(own["sequences"])),
    ("Duration", lambda own: _duration(own["hours"])),
    ("Frames", lambda own: _whole(own["frames"])),
    ("Annotated frames", lambda own: _whole(own["annotated_frames"])),
    ("Resolution", lambda own: _among([f"{e['size'][0]}x{e['size'][1]}px" for e in own["resolutions"]])),
    ("Framerate", lambda own: _among([f"{e['frames_per_second']:g}fps" for e in own["rates"]])),
    ("Captions", lambda own: _whole(own["captions"])),
    ("of which unique", lambda own: _whole(own["unique_captions"])),
    ("of which main", lambda own: _whole(own["main_captions"])),
    ("Unique words", lambda own: _whole(own["unique_words"])),
    ("Avg. words", lambda own: _number(own["words_per_caption"])),
    ("Avg. span", lambda own: _number(own["span_s"], "s")),
)


def stats_table(stats: DatasetStats) -> str:
    """A table in Markdown: a row a number, a column a split."""
    documents = {name: tally_document(tally) for name, tally in stats.splits.items()}
    rows = [(title, [show(own) for own in documents.values()]) for title, show in ROWS]
    rows += [
        (part.capitalize(), [_share(own["parts_of_speech"][part]) for own in documents.values()]) for part in PARTS
    ]
    lines = [["", *(name if name != ALL else stats.scene for name in documents)]]
    lines += [[title, *values] for title, values in rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    text = [_line(line, widths) for line in lines]
    return "\n".join([text[0], _line(["-" * width for width in widths], widths), *text[1:]])


def stats_document(stats: DatasetStats) -> dict[str, Any]:
    """All numbers in plain data, with the histograms of the whole."""
    return {
        "scene": stats.scene,
        "splits": {name: tally_document(tally) for name, tally in stats.splits.items()},
        "histograms": {
            histogram.name: {
                "unit": histogram.unit,
                "edges": list(histogram.edges),
                "counts": list(histogram.counts),
                "labels": list(histogram.labels),
            }
            for histogram in histograms_of(stats.whole)
        },
    }


def write_stats(folder: Path, stats: DatasetStats, *, summary: str = "summary.json") -> tuple[Path, ...]:
    """Write the numbers as JSON and each histogram as an SVG picture into the folder; the pictures' paths."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(stats_document(stats), indent=2, allow_nan=False) + "\n"
    paths = [folder / f"{histogram.name}.svg" for histogram in histograms_of(stats.whole)]
    pictures = [histogram_svg(histogram) for histogram in histograms_of(stats.whole)]
    for path, content in zip([folder / summary, *paths], [text, *pictures], strict=True):
        with whole_file(path) as temporary:
            temporary.write_text(content, encoding="utf-8")
    return tuple(paths)


def _line(cells: list[str], widths: list[int]) -> str:
    aligned = [f"{cells[0]:<{widths[0]}}"] + [f"{c:>{w}}" for c, w in zip(cells[1:], widths[1:], strict=True)]
    return f"| {' | '.join(aligned)} |"


def _whole(count: int) -> str:
    return f"{count:,}"


def _duration(hours: float) -> str:
    return f"{hours:.3g}h" if hours >= 0.1 else f"{3600 * hours:.3g}s"


def _number(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:.3g}{unit}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.2f}%"


def _among(names: list[str]) -> str:
    return "-" if not names else names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
