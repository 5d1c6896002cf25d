"""Pictures of videos on demand: a few files open at once, as many pictures kept as a bound in bytes allows."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

if TYPE_CHECKING:
    from pgm_data.video.random_access import FrameIndex, VideoFrames

CACHE_BYTES = 256 * 2**20
"""Of pictures kept in memory, unless told otherwise."""
OPEN_VIDEOS = 8
"""Files that are open at once."""


class PictureShelf:
    """Pictures of videos by frame: a few files open at once, pictures kept up to a bound in bytes.

    Threads may share it; another process begins with an empty one.
    """

    def __init__(self, limit_bytes: int = CACHE_BYTES) -> None:
        """Nothing open, nothing kept yet."""
        from pgm_data.video.picture_cache import PictureCache

        self.cache = PictureCache(limit_bytes)
        self._lock = threading.Lock()
        self._indices: dict[Path, FrameIndex] = {}
        self._open: OrderedDict[Path, VideoFrames] = OrderedDict()

    def video(self, path: Path) -> "VideoFrames":
        """The video, opened where it is not.

        Raises:
            ValueError: If it is no video that can be read.
        """
        from pgm_data.video import VideoError
        from pgm_data.video.random_access import VideoFrames

        with self._lock:
            found = self._open.get(path)
            if found is None:
                try:
                    found = VideoFrames(path, index=self._indices.get(path), cache=self.cache)
                except VideoError as error:
                    raise ValueError(str(error)) from error
                self._indices[path] = found.index
                self._open[path] = found
            self._open.move_to_end(path)
            if len(self._open) > OPEN_VIDEOS:
                self._open.popitem(last=False)[1].close()
            return found

    def keeps(self, path: Path, number: int, size: tuple[int, int]) -> bool:
        """Whether a video's frame is kept in that size."""
        from pgm_data.video.picture_cache import picture_key

        return self.cache.find(picture_key(path, number, size)) is not None

    def __reduce__(self) -> tuple:
        return PictureShelf, (self.cache.limit_bytes,)


def as_picture(rgb: UInt8[np.ndarray, "height width 3"]) -> Float[Tensor, "3 height width"]:
    """Bytes as RGB 0 to 1, channels first."""
    return torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1))).float() / 255


def picture_size(clips: Sequence[tuple[int, int, int]], limit: tuple[int, int] | None) -> tuple[int, int]:
    """Width and height that pictures of those clips are given: the commonest shape, no larger than the limit.

    Args:
        clips: Width, height and number of frames of each.
        limit: Width and height that pictures may have; that of the commonest clip without.
    """
    frames: dict[tuple[int, int], int] = {}
    for width, height, count in clips:
        frames[width, height] = frames.get((width, height), 0) + count
    width, height = max(frames, key=lambda size: (frames[size], size))
    scale = 1.0 if limit is None else min(limit[0] / width, limit[1] / height, 1.0)
    return max(1, round(width * scale)), max(1, round(height * scale))
