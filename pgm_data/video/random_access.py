"""Any frame of a video, in any order, by its number or its time: decoded from the key frame before it.

A frame's number is that of sequential decode, its picture that of `open_video`, to the last bit. Where the packets of a
file say when each frame is shown, frames are SOUGHT: decoding starts at the last key frame not shown after the wanted
one, so that nothing is missing that the frame is predicted from. Where they do not (no times, times that go back),
frames are COUNTED from the start, which is exact as well, and slow backwards.
"""

import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.error import EOFError as EndOfFile
from av.error import FFmpegError
from av.stream import Disposition
from jaxtyping import Float, Int, UInt8

from pgm_data.inputs import STILL_SUFFIXES
from pgm_data.video.frames import CodecFrame, Converter, DecodedFrame, Display
from pgm_data.video.picture_cache import PictureCache, picture_key
from pgm_data.video.reader import CONTAINERS, SOUGHT_BEFORE_S, VideoError, VideoInfo, VideoReader, open_video

NEAR_S = 1e-3
"""How far a frame's time may lie from the one that was asked for, seconds."""
HIDING_CODECS = ("vp8",)
"""Codecs whose packets may hold a picture that is never shown, so that packets do not count frames."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameIndex:
    """Which frames a video has, by number."""

    time: Float[np.ndarray, " frames"]
    """Presentation times as sequential decode gives them, rising, seconds."""
    pts: Int[np.ndarray, " sought"]
    """The same in the stream's own unit; none where frames are counted."""
    keys: Int[np.ndarray, " keys"]
    """Times in that unit of the frames that decode alone, rising; none where frames are counted."""

    def __len__(self) -> int:
        """How many frames."""
        return len(self.time)

    @property
    def sought(self) -> bool:
        """Whether frames are found by seeking, and not by counting from the start."""
        return len(self.pts) > 0


def frame_index(path: Path) -> FrameIndex:
    """The frames of a video: by its packets, nothing decoded, where these tell; else by decoding all of it once.

    A packet that proves not to decode is a frame all the same, which sequential decode would not count: after such
    damage a frame is found by its time.

    Raises:
        VideoError: If it is no video that can be read.
    """
    index = None
    if path.suffix.lower() not in STILL_SUFFIXES and path.is_file():
        try:
            with _opened(path) as container:
                index = _index_of_packets(container)
        except (FFmpegError, OSError):
            index = None
    if index is not None:
        return index
    nothing = np.zeros(0, dtype=np.int64)
    with open_video(path, threads=1) as reader:
        return FrameIndex(time=np.array([frame.timestamp for frame in reader]), pts=nothing, keys=nothing)


def _index_of_packets(container: InputContainer) -> FrameIndex | None:
    """The frames that the packets announce; None where that is not certain."""
    stream = _stream(container)
    if stream is None or stream.time_base is None or stream.codec_context.name in HIDING_CODECS:
        return None
    if "avi" in container.format.name and stream.codec_context.has_b_frames:  # an AVI says when frames are decoded
        return None
    shown, keys = [], []
    order = -np.inf
    try:
        for packet in container.demux(stream):
            if not packet.size:
                continue
            decoded_at = packet.pts if packet.dts is None else packet.dts
            if packet.pts is None or decoded_at is None or decoded_at < order or packet.is_corrupt:
                return None
            order = decoded_at
            if packet.is_keyframe:
                keys.append(packet.pts)
            # An edit list cuts off frames that are only there to decode others.
            if not packet.is_discard:
                shown.append(packet.pts)
    except (FFmpegError, OSError):
        return None
    pts = np.unique(np.array(shown, dtype=np.int64))
    if not len(pts) or len(pts) != len(shown) or not keys or min(keys) > pts[0]:
        return None
    time = pts * stream.time_base.numerator / stream.time_base.denominator
    return FrameIndex(time=time, pts=pts, keys=np.unique(np.array(keys, dtype=np.int64)))


def _opened(path: Path) -> InputContainer:
    """The file, of which no other may be read."""
    options = {"protocol_whitelist": "file", "format_whitelist": CONTAINERS}
    return av.open(f"file:{path}", metadata_errors="replace", container_options=options)


def _stream(container: InputContainer) -> av.VideoStream | None:
    """The first real video stream."""
    real = (each for each in container.streams.video if not each.disposition & Disposition.attached_pic)
    return next((each for each in real if each.codec_context is not None), None)


class VideoFrames:
    """The pictures of one video by number, as they are displayed, in blue, green, red.

    Threads may share it, one decodes at a time; a forked or unpickled one opens the file anew.
    """

    def __init__(self, path: Path, *, index: FrameIndex | None = None, cache: PictureCache | None = None) -> None:
        """Open the video.

        Args:
            path: Video or still picture.
            index: Of `frame_index`, where it is at hand already.
            cache: Where its pictures are kept, which videos may share; one of its own without.

        Raises:
            VideoError: If it is no video that can be read.
        """
        self.path = path
        with open_video(path, threads=1) as reader:
            self.info: VideoInfo = reader.info
        self.index = frame_index(path) if index is None else index
        self.cache = PictureCache() if cache is None else cache
        self._process, self._lock = os.getpid(), threading.Lock()
        self._source: _Sought | _Counted | None = None

    def __len__(self) -> int:
        """Frames that it has."""
        return len(self.index)

    def __reduce__(self) -> tuple:
        return _again, (self.path, self.index, self.cache)

    def number_at(self, time: float, *, within: float = NEAR_S) -> int:
        """Number of the frame that is shown from that time on, seconds.

        Raises:
            VideoError: If no frame's time is so near.
        """
        after = int(np.searchsorted(self.index.time, time))
        near = [number for number in (after - 1, after) if 0 <= number < len(self)]
        best = min(near, key=lambda number: abs(self.index.time[number] - time), default=None)
        if best is None or not abs(self.index.time[best] - time) <= within:
            found = "none" if best is None else f"frame {best} at {self.index.time[best]:.6f} s as the nearest"
            raise VideoError(self.path, f"a frame at {time:.6f} s", found)
        return best

    def picture(self, number: int, size: tuple[int, int] | None = None) -> UInt8[np.ndarray, "height width 3"]:
        """That frame, read-only.

        Args:
            number: In sequential decode, from 0.
            size: Width and height to which it is scaled, its borders onto the new borders; as displayed without.

        Raises:
            VideoError: If there is no such frame, or it does not decode.
        """
        full = (self.info.width, self.info.height)
        size = full if size is None else size
        if min(size) < 1:
            raise ValueError(f"{self.path}: size: expected 1 pixel or more, got {size[0]}x{size[1]}")
        if not 0 <= number < len(self):
            raise VideoError(self.path, f"a frame {number}", f"{len(self)} frames")
        found = self.cache.find(picture_key(self.path, number, size))
        if found is not None:
            return found

        def keep(passed: DecodedFrame) -> None:
            nbytes = 3 * size[0] * size[1]
            key = picture_key(self.path, passed.video_frame, size)
            self.cache.keep_where_room(key, nbytes, lambda: _scaled(passed, full, size))

        if self._process != os.getpid():
            # The file's position is shared with the parent process, so that this one opens it for itself.
            self._process, self._lock, self._source = os.getpid(), threading.Lock(), None
        with self._lock:
            if self._source is None:
                self._source = (_Sought if self.index.sought else _Counted)(self.path, self.info, self.index)
            frame = self._source.frame(number, keep)
            picture = _scaled(frame, full, size)
        self.cache.keep(picture_key(self.path, number, size), picture)
        return picture

    def close(self) -> None:
        """Close the file; the next picture opens it again."""
        if self._process == os.getpid() and self._source is not None:
            with self._lock:
                self._source.close()
        self._source = None


def _again(path: Path, index: FrameIndex, cache: PictureCache) -> VideoFrames:
    return VideoFrames(path, index=index, cache=cache)


def _scaled(frame: DecodedFrame, full: tuple[int, int], size: tuple[int, int]) -> UInt8[np.ndarray, "height width 3"]:
    """A frame of size `full` in another size, read-only: averaged where it gets smaller."""
    width, height = full
    if size[0] < width and round(height * size[0] / width) == size[1]:
        picture = frame.small_bgr(size[0])
    else:
        picture = frame.bgr()
        if size != full:
            smaller = size[0] <= width and size[1] <= height
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
    picture = np.ascontiguousarray(picture)
    picture.flags.writeable = False
    return picture


class _Sought:
    """Frames found by seeking; what has been decoded last is gone on with where that is on the way."""

    def __init__(self, path: Path, info: VideoInfo, index: FrameIndex) -> None:
        self._path, self._info, self._index = path, info, index
        stretch = Fraction(info.sample_aspect)
        self._display = Display(
            scaled=None if stretch == 1 else (round(info.stored_width * stretch), info.stored_height),
            mirrored=info.mirrored,
            rotation=info.rotation,
        )
        self._converter = Converter()
        self._early = 0
        self._open()

    def _open(self) -> None:
        try:
            self._container = _opened(self._path)
        except (FFmpegError, OSError) as error:
            raise VideoError(self._path, "a video, as before", f"one no longer ({error})") from error
        stream = _stream(self._container)
        if stream is None or stream.time_base is None:
            raise VideoError(self._path, "a video stream, as before", "none any longer")
        self._stream = stream
        # One thread: it gives out a frame as soon as it can, and leaves nothing behind in a fork.
        self._stream.codec_context.thread_count = 1
        self._margin = int(SOUGHT_BEFORE_S / stream.time_base)
        self._frames: Iterator[av.VideoFrame] = iter(())
        self._at: int | None = None

    def close(self) -> None:
        self._container.close()

    def frame(self, number: int, passed: Callable[[DecodedFrame], None]) -> DecodedFrame:
        """That frame; those decoded on the way go to `passed`."""
        wanted = int(self._index.pts[number])
        at, keys = self._at, self._index.keys
        key = max(int(np.searchsorted(keys, wanted, side="right")) - 1, 0)
        found = self._forward(wanted, passed) if at is not None and keys[key] <= at < wanted else None
        if found is None:
            self._seek(int(keys[key]) - self._early, wanted)
            found = self._forward(wanted, passed)
        if found is None and not self._early:
            # Some containers land behind the key frame that they are asked for; those do it every time.
            self._seek(int(keys[key]) - self._margin, wanted)
            found = self._forward(wanted, passed)
            self._early = 0 if found is None else self._margin
        if found is None:
            # Not all frames after a key frame decode from there on.
            self._seek(int(keys[max(key - 1, 0)]) - self._margin, wanted)
            found = self._forward(wanted, passed)
        if found is None:
            self.close()
            self._open()
            self._frames = self._decoded(wanted)
            found = self._forward(wanted, passed)
        if found is None:
            raise VideoError(self._path, f"a frame {number} that decodes", "none in what the file holds of it")
        return found

    def _seek(self, key: int, wanted: int) -> None:
        self._at = None
        self._frames = iter(())
        try:
            self._container.seek(key, stream=self._stream)
            self._stream.codec_context.flush_buffers()
        except (FFmpegError, OSError):
            return
        self._frames = self._decoded(wanted)

    def _decoded(self, wanted: int) -> Iterator[av.VideoFrame]:
        """Frames from the first key frame on; none where that is shown after the wanted frame."""
        packets = self._container.demux(self._stream)
        begun = flushed = False
        while not flushed:
            try:
                packet = next(packets, None)
                flushed = packet is None or not packet.size and packet.dts is None
            except (FFmpegError, OSError):
                packet, flushed = None, True
            if not begun:
                if packet is None or flushed or not packet.is_keyframe or packet.pts is None:
                    continue
                if packet.pts > wanted:
                    return
                begun = True
            try:
                yield from self._stream.codec_context.decode(packet)
            except EndOfFile:
                return
            except (FFmpegError, OSError):
                continue

    def _forward(self, wanted: int, passed: Callable[[DecodedFrame], None]) -> DecodedFrame | None:
        """The wanted frame, of those that are decoded from here on; None where it is not among them."""
        for frame in self._frames:
            if frame.pts is None:
                continue
            self._at = frame.pts
            if frame.pts > wanted:
                return None
            number = int(np.searchsorted(self._index.pts, frame.pts))
            known = number < len(self._index) and self._index.pts[number] == frame.pts
            if known and (frame.width, frame.height) == (self._info.stored_width, self._info.stored_height):
                time = float(self._index.time[number])
                shown = CodecFrame(frame, self._display, self._converter, number, time)
                if frame.pts == wanted:
                    return shown
                passed(shown)
            elif frame.pts == wanted:
                found = f"{frame.width}x{frame.height}"
                expected = f"{self._info.stored_width}x{self._info.stored_height}"
                raise VideoError(self._path, f"frame {number} of {expected} as the first", found)
        return None


class _Counted:
    """Frames found by counting from the start; going back starts again."""

    def __init__(self, path: Path, info: VideoInfo, index: FrameIndex) -> None:
        self._path = path
        self._reader: VideoReader | None = None
        self._next = 0

    def close(self) -> None:
        if self._reader is not None:
            self._reader.__exit__(None, None, None)
        self._reader, self._next = None, 0

    def frame(self, number: int, passed: Callable[[DecodedFrame], None]) -> DecodedFrame:
        """That frame; those decoded on the way go to `passed`."""
        if self._reader is None or number < self._next:
            self.close()
            self._reader = open_video(self._path, threads=1)
        for frame in self._reader:
            self._next = frame.video_frame + 1
            if frame.video_frame == number:
                return frame
            passed(frame)
        raise VideoError(self._path, f"a frame {number}", f"its end after {self._next} frames")
