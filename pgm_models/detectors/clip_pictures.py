"""Clips with truth, their pictures kept as JPEG so that training reads any of them in any order."""

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from pgm_data.dataset.files import whole_file

JPEG_QUALITY = 95

Clip = TypeVar("Clip")


class NoFrames(ValueError):
    """A dataset without a single usable clip."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Pictures:
    """The pictures of one clip; they stay on disk."""

    jpegs: Path
    """All pictures one after the other."""
    offsets: Int[np.ndarray, " pictures_plus_one"]
    """Where each picture begins in the file, and the file's end."""

    def __len__(self) -> int:
        """Pictures of the clip."""
        return len(self.offsets) - 1

    def read(self, index: int) -> UInt8[np.ndarray, "height width 3"]:
        """That picture, BGR.

        Raises:
            ValueError: If the file does not hold it.
        """
        begin, end = int(self.offsets[index]), int(self.offsets[index + 1])
        with self.jpegs.open("rb") as file:
            file.seek(begin)
            data = np.frombuffer(file.read(end - begin), np.uint8)
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
        if bgr is None:
            raise ValueError(f"{self.jpegs}: picture {index}: expected a JPEG at bytes {begin} to {end}, found none")
        return np.asarray(bgr, dtype=np.uint8)


def keep_pictures(jpegs: Path, pictures: Iterable[np.ndarray]) -> np.ndarray:
    """Write the pictures into one file; where each begins, and the file's end.

    Raises:
        ValueError: If one of them cannot be encoded.
    """
    offsets = [0]
    jpegs.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(jpegs) as temporary, temporary.open("wb") as file:
        for bgr in pictures:
            encoded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            if not encoded:
                raise ValueError(f"{jpegs}: frame {len(offsets) - 1}: expected a picture, got {bgr.shape}")
            file.write(data.tobytes())
            offsets.append(offsets[-1] + len(data))
    return np.array(offsets)


def find_clips(dataset: Path, *tables: str) -> tuple[Path, ...]:
    """Clip folders under the dataset that hold a truth camera and those tables, in order of name."""
    needed = ("clip.json", *tables)
    return tuple(
        sorted(
            path.parent
            for path in dataset.rglob("camera.parquet")
            if all((path.parent / name).is_file() for name in needed)
        )
    )


def find_video(folder: Path, dataset: Path) -> Path:
    """The video of a clip: where its `clip.json` says, from the clip's folder, its work folder or the dataset.

    Raises:
        ValueError: If it lies in none of them.
    """
    said = Path(json.loads((folder / "clip.json").read_text())["source_path"])
    places = (
        [said] if said.is_absolute() else [folder / said, folder.parent / said, dataset / said, dataset / said.name]
    )
    for place in places:
        if place.is_file():
            return place
    raise ValueError(
        f"{folder / 'clip.json'}: source_path: expected a video, found none at {', '.join(map(str, places))}"
    )


def video_pictures(video: Path, video_frames: Int[np.ndarray, " frames"]) -> Iterator[np.ndarray]:
    """Those frames of the video, BGR, in order; as many as it has of them."""
    from pgm_data.video import open_video

    wanted = set(video_frames.tolist())
    with open_video(video) as reader:
        for frame in reader:
            if frame.video_frame in wanted:
                yield frame.bgr()


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameSet(Generic[Clip]):
    """Frames of several clips under one numbering, divided for training and for holding out."""

    clips: Sequence[Clip]
    training: Int[np.ndarray, "frames 2"]
    """Clip and frame."""
    held_out: Int[np.ndarray, "held 2"]
    """Clip and frame."""


class GrowingClips(Generic[Clip]):
    """All prepared clips; a thread beside the training prepares what appears later."""

    def __init__(
        self,
        datasets: Sequence[Path],
        tables: tuple[str, ...],
        prepare: Callable[[Path, Path], Clip],
        divide: Callable[[Sequence[Clip]], FrameSet[Clip]],
        *,
        growing: bool,
        show: Callable[[str], None],
    ) -> None:
        """Prepare what is there now; in a growing dataset, what is not whole yet waits for a later look.

        A clip's folder holds the `tables` beside its camera; `prepare` takes that folder and the clip's video.

        Raises:
            NoFrames: If there is no clip at all.
            ValueError: If a clip is not whole in a dataset that does not grow.
        """
        self._datasets, self._tables, self._prepare, self._divide = tuple(datasets), tables, prepare, divide
        self._growing, self._show = growing, show
        self._clips: dict[str, Clip] = {}
        self._stop = threading.Event()
        self.look()
        if not self._clips:
            wanted = ", ".join(("clip.json", "camera.parquet", *tables))
            places = ", ".join(map(str, datasets))
            raise NoFrames(f"{places}: expected clip folders with {wanted} and their video, got none")

    def __call__(self) -> FrameSet[Clip]:
        """The frames known now."""
        return self._frames

    def look(self) -> None:
        """Prepare clips that are new."""
        found = ((folder, dataset) for dataset in self._datasets for folder in find_clips(dataset, *self._tables))
        for folder, dataset in found:
            if folder.name in self._clips or self._stop.is_set():
                continue
            try:
                clip = self._prepare(folder, find_video(folder, dataset))
            except ValueError as error:
                if not self._growing:
                    raise
                self._show(f"not yet usable: {error}")
                continue
            self._clips[folder.name] = clip
            self._frames = self._divide(list(self._clips.values()))
            self._show(f"{folder.name}: {len(self._frames.training)} frames to train on")

    def keep_looking(self, every_s: float) -> Callable[[], None]:
        """Look again and again in a thread of its own until the returned function is called."""

        def work() -> None:
            while not self._stop.wait(every_s):
                self.look()

        thread = threading.Thread(target=work, daemon=True)
        thread.start()

        def stop() -> None:
            self._stop.set()
            thread.join()

        return stop
