"""`pgm stats DATASET`: what a packed dataset holds, as a table, as JSON, and as pictures."""

import json
from dataclasses import dataclass
from pathlib import Path

import tyro

from .console import UsageError, option_error
from .output import prepare_output


@dataclass(frozen=True, kw_only=True)
class StatsOptions:
    """Count what a dataset holds: sequences, hours, frames, captions, words and their parts of speech, by split.

    The dataset's own card has the same table and histograms, as of when it was packed.
    """

    dataset: tyro.conf.Positional[Path]
    """Folder that pgm pack wrote."""
    json: bool = False
    """Print one JSON document, histograms included, instead of the table."""
    out: Path | None = None
    """Folder to write table, numbers and histograms into (stats.md, summary.json, *.svg); new, empty or overwritten."""
    overwrite: bool = False
    """Delete what an earlier run wrote into that folder."""


def main(argv: list[str]) -> int:
    """Run the command; its exit code."""
    options = tyro.cli(StatsOptions, args=argv, prog="pgm stats")
    if not (options.dataset / "meta" / "info.json").is_file():
        raise option_error("DATASET", expected="a folder that pgm pack wrote", got=options.dataset)
    from pgm_data.dataset.stats import dataset_stats
    from pgm_data.dataset.stats_table import stats_document, stats_table, write_stats

    try:
        stats = dataset_stats(options.dataset)
    except ValueError as error:
        raise UsageError(f"{error}; pgm check {options.dataset} says more") from error
    table = stats_table(stats)
    print(json.dumps(stats_document(stats), indent=2) if options.json else table)
    if options.out is not None:
        with prepare_output(options.out, resume=False, overwrite=options.overwrite):
            write_stats(options.out, stats)
            (options.out / "stats.md").write_text(table + "\n", encoding="utf-8")
    return 0
