"""Which videos a command was given: folders searched, still pictures counted as videos of one frame, the rest named."""

import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .qt .mkv .webm .avi .ts .mts .m2ts .mpg .mpeg .m2v .vob .flv .f4v .wmv .asf .ogv .ogm .3gp .3g2"
    " .mxf .dv .y4m .gif .h264 .264 .hevc .h265 .265 .ivf".split()
)
"""File name endings taken for a video, lower case."""
STILL_SUFFIXES = frozenset(".jpg .jpeg .jpe .png .bmp .tif .tiff .webp .ppm .pgm .jp2".split())
"""File name endings taken for a still picture, which is a video of one frame."""

MAX_NAME_BYTES = 180
"""Longest clip name made from a file name, UTF-8 bytes: what file systems allow, less room for numbers."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Inputs:
    """What was found under the paths a person gave."""

    videos: tuple[Path, ...]
    """Videos and still pictures, each once, in the order given and sorted by name inside a folder."""
    ignored: tuple[tuple[Path, str], ...]
    """Files in the folders that are no video, each with the reason."""


def find_inputs(paths: Sequence[Path]) -> Inputs:
    """The videos at the paths: files as named, folders searched to the bottom by file name ending.

    Nothing is opened here. A file named by itself is taken whatever its ending, and fails later when it does not
    decode. Hidden files and folders inside a folder are passed over in silence, a folder reached twice is read once
    (links may lead in a circle), and a file reached twice counts once.

    Raises:
        FileNotFoundError: If a path does not exist.
        OSError: If a folder cannot be read.
    """
    videos: list[Path] = []
    ignored: list[tuple[Path, str]] = []
    seen_files: set[Path] = set()
    seen_folders: set[Path] = set()
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(f"{path}: expected a video, a picture or a folder, found nothing there")
        if path.is_dir():
            found = sorted(_files_under(path, seen_folders), key=lambda file: file.relative_to(path).parts)
        else:
            found = [path]
        for file in found:
            reason = "" if file == path else _why_ignored(file)
            if reason:
                ignored.append((file, reason))
            elif file.resolve() not in seen_files:
                seen_files.add(file.resolve())
                videos.append(file)
    return Inputs(videos=tuple(videos), ignored=tuple(ignored))


def clip_stems(videos: Sequence[Path], prefix: str = "") -> tuple[str, ...]:
    """The name each video's clips go by, safe as a folder name: the file's stem, cleaned.

    Args:
        videos: The files.
        prefix: Put before every stem with a `-`; `{parent}` in it stands for the name of the video's folder, so
            `--clip-prefix "{parent}"` tells `a/rally.mp4` and `b/rally.mp4` apart.

    Raises:
        ValueError: If two videos get one name (also when they differ only in upper and lower case, which some file
            systems do not tell apart), naming both.
    """
    stems: list[str] = []
    owner: dict[str, Path] = {}
    for video in videos:
        parent = video.absolute().parent.name
        before = prefix.replace("{parent}", parent)
        stem = clean_name(f"{before}-{video.stem}" if before else video.stem)
        key = stem.casefold()
        if key in owner:
            raise ValueError(
                f"clip_id: expected one video of each name, got {stem!r} from both {owner[key]} and {video};"
                ' tell them apart with --clip-prefix, for example --clip-prefix "{parent}"'
            )
        owner[key] = video
        stems.append(stem)
    return tuple(stems)


def clean_name(text: str) -> str:
    """The text as one safe folder name: letters and digits, `_`, `-`, `+`, inner dots; a run of others becomes a `_`.

    Letters of every script stay (in composed form). The name never starts with a dot or a dash, is never empty, never a
    name such as `..`, and has at most `MAX_NAME_BYTES` bytes.
    """
    text = unicodedata.normalize("NFC", text)
    kept = "".join(letter if unicodedata.category(letter)[0] in "LMN" or letter in "_-+." else "\0" for letter in text)
    kept = re.sub(r"\.{2,}|\0+", "_", kept).lstrip(".-")
    return kept.encode()[:MAX_NAME_BYTES].decode(errors="ignore").rstrip(".") or "clip"


def _why_ignored(file: Path) -> str:
    """Why a file found in a folder is no input, empty if it is one."""
    suffix = file.suffix.lower()
    if suffix in VIDEO_SUFFIXES or suffix in STILL_SUFFIXES:
        if not file.exists():
            return "link that leads nowhere"
        return "" if file.is_file() else "not a regular file"
    return f"{suffix} is not a video or a picture" if suffix else "no file name ending"


def _files_under(folder: Path, seen: set[Path]) -> list[Path]:
    """Every visible file below the folder, each real folder entered once."""
    real = folder.resolve()
    if real in seen:
        return []
    seen.add(real)
    files: list[Path] = []
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith("."):
                continue
            if entry.is_dir():
                files += _files_under(Path(entry.path), seen)
            else:
                files.append(Path(entry.path))
    return files
