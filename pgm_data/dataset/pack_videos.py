"""The videos of a dataset: copied or linked under LeRobot's names, each once however many clips it holds."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pgm_data.dataset.dataset_columns import FILE, FILES_PER_CHUNK, VIDEO_KEY
from pgm_data.dataset.pack_plan import PackOptions, PlannedClip

CHUNK = 2**20


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

    def __init__(self, staging: Path, out: Path, options: PackOptions) -> None:
        self._staging, self._out, self._options = staging, out, options
        self.placed: dict[Path, PlacedVideo] = {}

    def place(self, clip: PlannedClip, document: Mapping[str, Any]) -> PlacedVideo | None:
        """The clip's video in the dataset; None where it has none or none are wanted.

        Raises:
            ValueError: If it is not where the clip says, or is another file than the clip was made from.
        """
        if self._options.videos == "none" or document["bytes"] == 0:  # a simulator that drew no pictures
            return None
        source = self._source(clip.work, document)
        if source not in self.placed:
            number = len(self.placed)
            place = {"chunk_index": number // FILES_PER_CHUNK, "file_index": number % FILES_PER_CHUNK}
            name = f"videos/{VIDEO_KEY}/{FILE.format(**place)}{source.suffix.lower()}"
            self._put(source, name, document)
            self.placed[source] = PlacedVideo(**place, path=name, picture=_picture(source))
        return self.placed[source]

    def _source(self, work: Path, document: Mapping[str, Any]) -> Path:
        path = Path(document["source_path"])
        below = Path(*(part for part in path.parts if part != ".."))
        folder = self._options.video_folder
        places = [work / path, work.parent / below] if folder is None else [folder / below, folder / path.name]
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            raise ValueError(f"source_path: expected its video at {' or '.join(map(str, places))}, got nothing there")
        if found.stat().st_size != document["bytes"]:
            raise ValueError(
                f"bytes: expected {document['bytes']}, of the video it was made from, "
                f"got {found.stat().st_size} in {found}"
            )
        return found.resolve()

    def _put(self, source: Path, name: str, document: Mapping[str, Any]) -> None:
        target = self._staging / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if self._options.videos == "link":
            target.symlink_to(os.path.relpath(source, (self._out / name).parent.resolve()))
            return
        digest = hashlib.sha256()
        with source.open("rb") as read, target.open("wb") as written:
            while part := read.read(CHUNK):
                digest.update(part)
                written.write(part)
        if digest.hexdigest() != document["sha256"]:
            target.unlink()
            raise ValueError(
                f"sha256: expected {document['sha256']}, of the video it was made from, "
                f"got {digest.hexdigest()} in {source}"
            )


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
