"""SHA-256 of every file of a dataset, written so that `sha256sum --check meta/sha256sums.txt` reads it too."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from pgm_data.dataset.dataset_columns import SUMS_PATH
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.findings import Findings

CARD = "README.md"
"""What people edit, and is left out."""
LINE = re.compile(r"^([0-9a-f]{64})  ([^\x00-\x1f\\]+)$")
LARGEST = 2**28
"""Bytes above which a list of checksums is not read."""
STATE_FOLDER = ".pgm"


def write_sums(folder: Path) -> None:
    """Write the checksums of the dataset's files into its `meta`."""
    lines = [f"{sha256_of(folder / name)}  {name}\n" for name in summed_files(folder)]
    (folder / SUMS_PATH).write_text("".join(lines), encoding="utf-8")


def summed_files(folder: Path) -> list[str]:
    """Files of a dataset that have a checksum, from its folder, in order: all but the card, links and hidden files."""
    return sorted(_files(folder, ""))


def _files(folder: Path, place: str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            name = f"{place}{entry.name}"
            if entry.name.startswith(".") or name in (CARD, SUMS_PATH):
                continue
            if entry.is_dir(follow_symlinks=False):
                yield from _files(folder / entry.name, f"{name}/")
            elif entry.is_file(follow_symlinks=False):
                yield name


def check_sums(folder: Path, findings: Findings) -> None:
    """Note every file that is not what its checksum says, has none, or is not there; links are not followed."""
    path = folder / SUMS_PATH
    if not findings.expect(path):
        return
    findings.files.append(path)
    if path.stat().st_size > LARGEST:
        findings.say(path, "", f"at most {LARGEST} bytes", f"{path.stat().st_size}")
        return
    wanted: dict[str, str] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines()):
        match = LINE.match(line)
        if match is None or match[2] in wanted:
            expected = "64 hexadecimal digits, two blanks and the path of a file, each once"
            findings.say(path, f"line {number + 1}", expected, repr(line[:100]))
            return
        wanted[match[2]] = match[1]
    # Only what lies in the folder is opened, whatever the list names.
    found = summed_files(folder)
    for name in found:
        if name not in wanted:
            findings.say(folder / name, "sha256", f"its checksum in {SUMS_PATH}", "none")
        elif (digest := sha256_of(folder / name)) != wanted[name]:
            findings.say(folder / name, "sha256", f"{wanted[name]}, as {SUMS_PATH} says", digest)
    for name in sorted(set(wanted) - set(found)):
        findings.say(path, name, "the file, since it has a checksum", "nothing there")
