"""The pictures of one clip, pass after pass, out of its video."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.video import open_video


class ClipPictures:
    """A clip's pictures; each call is a fresh pass over them."""

    def __init__(
        self,
        video: Path,
        clip: ClipCamera,
        *,
        threads: int = 2,
        fast: bool = False,
        report: Callable[[int], None] = lambda frames: None,
    ) -> None:
        """Say where they are.

        Args:
            video: The file.
            clip: Its frames.
            threads: Of the decoder.
            fast: Whether the decoder may skip its deblocking filter.
            report: Told of every picture how many have been given out in all passes.
        """
        self._video, self._clip, self._threads, self._fast = video, clip, threads, fast
        self._report, self._given = report, 0
        with open_video(video) as reader:
            self.size = (reader.info.width, reader.info.height)

    def __call__(self) -> Iterator[np.ndarray]:
        """The pictures in order, BGR uint8, one a frame of the clip.

        Raises:
            VideoError: If the file cannot be read.
            ValueError: If it does not hold the clip's frames.
        """
        wanted = self._clip.video_frame.tolist()
        if not wanted:
            return
        start = (int(wanted[0]), float(self._clip.timestamp[0]))
        with open_video(self._video, threads=self._threads, fast=self._fast, start=start) as reader:
            frames = iter(reader)
            for number in wanted:
                frame = next((frame for frame in frames if frame.video_frame >= number), None)
                if frame is None or frame.video_frame != number:
                    got = "its end" if frame is None else f"frame {frame.video_frame}"
                    place = f"{self._video}: {self._clip.clip_id}"
                    raise ValueError(f"{place}: expected frame {number} of the video, got {got}")
                self._given += 1
                self._report(self._given)
                yield frame.bgr()
