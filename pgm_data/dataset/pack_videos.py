"""The videos of a dataset: copied, linked or encoded under LeRobot's names, each once however many clips it holds."""

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pgm_data.dataset.dataset_columns import FILE, FILES_PER_CHUNK, VIDEO_KEY
from pgm_data.dataset.files import sha256_of
from pgm_data.dataset.pack_plan import PackOptions, PlannedClip
from pgm_data.dataset.source_video import VideoNotFound, find_source_video

CHUNK = 2**20

Encode = Callable[[Path, Path, PackOptions], None]
"""Writes the video at the first path as H.264 at the second; ValueError or OSError where it cannot."""


@dataclass(frozen=True, kw_only=True)
class VideoPicture:
    """What a video's pictures are like."""

    width: int
    height: int
    codec: str
    pixel_format: str


@dataclass(frozen=True, kw_only=True)
class PlacedVideo:
    """One video of the dataset."""

    chunk_index: int
    file_index: int
    path: str
    """From the dataset's folder, with forward slashes."""
    picture: VideoPicture | None
    """None where it cannot be opened."""


class VideoShelf:
    """Places videos below a staging folder of a dataset."""

    def __init__(self, staging: Path, out: Path, options: PackOptions, encode: Encode | None) -> None:
        """Begin with no video; `encode` is needed where videos are encoded.

        Raises:
            ValueError: If videos are to be encoded and nothing does it.
        """
        if options.videos == "encode" and encode is None:
            raise ValueError("encode: expected what encodes videos, since videos is encode, got none")
        self._staging, self._out, self._options, self._encode = staging, out, options, encode
        self._taken = 0
        self._failed: dict[Path, str] = {}
        self.placed: dict[Path, PlacedVideo] = {}

    def place(self, clip: PlannedClip, document: Mapping[str, Any]) -> PlacedVideo | None:
        """The clip's video in the dataset; None where it has none or none are wanted.

        Raises:
            ValueError: If it is not where the clip says, is another file than the clip was made from, or cannot be
                encoded.
        """
        if self._options.videos == "none" or document["bytes"] == 0:  # a simulator that drew no pictures
            return None
        source = self._source(clip.work, document)
        if source in self._failed:
            raise ValueError(self._failed[source])
        if source not in self.placed:
            number = self._taken
            place = {"chunk_index": number // FILES_PER_CHUNK, "file_index": number % FILES_PER_CHUNK}
            suffix = ".mp4" if self._options.videos == "encode" else source.suffix.lower()
            name = f"videos/{VIDEO_KEY}/{FILE.format(**place)}{suffix}"
            try:
                self._put(source, name, document)
            except (ValueError, OSError) as error:
                (self._staging / name).unlink(missing_ok=True)
                self._failed[source] = str(error)
                raise
            self._taken += 1
            shown = source if self._options.videos == "link" else self._staging / name
            self.placed[source] = PlacedVideo(**place, path=name, picture=_picture(shown))
        return self.placed[source]

    def _source(self, work: Path, document: Mapping[str, Any]) -> Path:
        found = find_source_video(work, document, self._options.video_folder)
        if found.stat().st_size != document["bytes"]:
            expected = f"{document['bytes']}, of the video it was made from"
            raise VideoNotFound("bytes", expected, f"{found.stat().st_size} in {found}")
        return found.resolve()

    def _put(self, source: Path, name: str, document: Mapping[str, Any]) -> None:
        target = self._staging / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if self._options.videos == "link":
            target.symlink_to(os.path.relpath(source, (self._out / name).parent.resolve()))
        elif self._options.videos == "copy":
            _refuse_other(document, _copied(source, target), source)
        elif self._encode is not None:
            _refuse_other(document, sha256_of(source), source)
            self._encode(source, target, self._options)


def _copied(source: Path, target: Path) -> str:
    """SHA-256 of a file that has been copied."""
    digest = hashlib.sha256()
    with source.open("rb") as read, target.open("wb") as written:
        while part := read.read(CHUNK):
            digest.update(part)
            written.write(part)
    return digest.hexdigest()


def _refuse_other(document: Mapping[str, Any], found: str, source: Path) -> None:
    if found != document["sha256"]:
        raise VideoNotFound("sha256", f"{document['sha256']}, of the video it was made from", f"{found} in {source}")


def _picture(path: Path) -> VideoPicture | None:
    import av
    from av.error import FFmpegError

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            context = stream.codec_context
            return VideoPicture(
                width=context.width, height=context.height, codec=context.name, pixel_format=context.pix_fmt or ""
            )
    except (FFmpegError, IndexError, ValueError):
        return None
