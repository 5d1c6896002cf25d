"""Videos read one frame after the other, with the times the file gives and the damage it has."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from types import TracebackType

import av
import cv2
import numpy as np
from av.container import InputContainer
from av.error import EOFError as EndOfFile
from av.error import FFmpegError
from av.stream import Disposition

from pgm_data.inputs import STILL_SUFFIXES
from pgm_data.video.frames import CodecFrame, Converter, DecodedFrame, Display, PictureFrame, is_full_range

SOUGHT_BEFORE_S = 0.5
"""How long before a frame it is looked for: its key frame may be listed a little late."""
SAME_TIME_S = 1e-6
CLOCK_RESTART_S = 1.0
"""A step back in time larger than this is read as a clock that starts again, seconds."""
MISSING_END_S = 0.5
"""A Matroska file that ends this much before its own stated duration is called cut off, seconds."""
CONTAINERS = (
    "mov,mp4,matroska,webm,avi,mpegts,mpeg,mpegvideo,m4v,flv,asf,ogg,mxf,dv,yuv4mpegpipe,gif,h264,hevc,ivf,av1,obu,nut"
)
"""Kinds of file that are read. None of them is a list of other files or a text that is drawn as a picture."""


class VideoError(Exception):
    """A file that is not a readable video: says which, what was expected and what was found."""

    def __init__(self, path: Path, expected: str, found: str) -> None:
        """Compose the one line that a person reads."""
        super().__init__(f"{path}: expected {expected}, found {found}")
        self.path, self.expected, self.found = path, expected, found


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoInfo:
    """What a video is, by its first decoded frame; the `claimed` fields are the header's word and may be wrong."""

    path: Path
    """The file."""
    width: int
    """Displayed width, pixels."""
    height: int
    """Displayed height, pixels."""
    stored_width: int
    """Width of the coded picture, pixels."""
    stored_height: int
    """Height of the coded picture, pixels."""
    rotation: int
    """Clockwise turn applied for display, degrees: 0, 90, 180 or 270."""
    mirrored: bool
    """Whether left and right are swapped for display, before the turn."""
    sample_aspect: str
    """Width to height of one stored pixel, such as `1/1` or `64/45`."""
    time_base: str
    """The unit of the file's clock in seconds, such as `1/90000`; `1/1` for a still picture."""
    codec: str
    """Name of the codec, `still` for a picture file."""
    pixel_format: str
    """Name of the stored pixel format."""
    full_range: bool
    """Whether luma runs from 0 to 255 rather than from 16 to 235."""
    claimed_frames: int
    """Frames by the header, 0 where it does not say."""
    claimed_fps: float
    """Frames per second by the header, 0 where it does not say."""


class VideoReader:
    """The frames of one video in order, once; `trouble` says afterwards what went wrong on the way."""

    def __init__(
        self,
        info: VideoInfo,
        frames: Iterator[DecodedFrame],
        notes: "_Notes",
        container: InputContainer | None,
    ) -> None:
        """Use `open_video`."""
        self.info = info
        self._frames, self._notes, self._container = frames, notes, container

    @property
    def trouble(self) -> str:
        """What went wrong so far, empty if nothing did: complete once all frames have been read."""
        return self._notes.text()

    def __enter__(self) -> "VideoReader":
        """The reader itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        if self._container is not None:
            self._container.close()

    def __iter__(self) -> Iterator[DecodedFrame]:
        """The frames not yet read."""
        return self._frames


def open_video(
    path: Path, *, threads: int = 2, fast: bool = False, start: tuple[int, float] | None = None
) -> VideoReader:
    """A reader of the video or still picture, its first frame already decoded.

    What a damaged file still yields is read, and `reader.trouble` then says what is missing. Times are the file's own
    (they need not start at 0). Where the file gives none, or they fail to go up, they are made up as follows, and
    `trouble` says so: a missing time follows the one before by one frame's duration; a time at or a little before the
    last one is put a tenth of a frame after it; a clock that restarts is carried on. The reader stops, and says so,
    where the picture size changes.

    Args:
        path: Video, or still picture by its ending (EXIF rotation applied).
        threads: Decoding threads; they work while the caller does. 0 = as many as cores.
        fast: Leave out the decoder's deblocking filter and allow its shortcuts: for browsing. Luma then differs a
            little at block borders, and differences add up until the next key frame.
        start: Number and presentation time of the frame to begin with, as an earlier reading of this file gave them;
            it is sought where the file allows, else what lies before it is decoded and passed over.

    Raises:
        VideoError: If nothing can be decoded, or the file asks for a turn that is no multiple of 90 degrees.
    """
    if not path.is_file():
        raise VideoError(path, "a video file", "no such file" if not path.exists() else "a folder or a device")
    if path.suffix.lower() in STILL_SUFFIXES:
        return _open_still(path)
    try:
        # Only this one file may be read: a playlist or a script under a video's name must not open others.
        options = {"protocol_whitelist": "file", "format_whitelist": CONTAINERS}
        container = av.open(f"file:{path}", metadata_errors="replace", container_options=options)
    except (FFmpegError, OSError) as error:
        found = f"{path.stat().st_size} bytes that are none ({_cause(error)})"
        raise VideoError(path, "a video", found) from error
    try:
        if start is not None and start[0] > 0:
            return _read_from(path, container, threads, fast, start)
        return _read_container(path, container, threads, fast)
    except BaseException:
        container.close()
        raise


class _Notes:
    """What went wrong, each kind told once with how often it came."""

    def __init__(self) -> None:
        self._notes: dict[str, tuple[str, int]] = {}

    def add(self, kind: str, message: str) -> None:
        """Keep the first message of a kind and count the rest."""
        first, count = self._notes.get(kind, (message, 0))
        self._notes[kind] = (first, count + 1)

    def text(self) -> str:
        """All of it in one line."""
        return "; ".join(
            f"{text} (and {count - 1} more)" if count > 1 else text for text, count in self._notes.values()
        )


class _Clock:
    """Presentation times in seconds that go up, whatever the file says."""

    def __init__(self, stream: av.VideoStream, notes: _Notes) -> None:
        self._base = stream.time_base or Fraction(1, 1)
        self._notes = notes
        self._previous: float | None = None
        rate = stream.average_rate or stream.base_rate
        self._step = float(1 / rate) if rate else 0.0
        self._offset = 0.0

    def time(self, frame: av.VideoFrame, number: int) -> float:
        """The frame's time; every departure from the file's own is noted."""
        own = None if frame.pts is None else float(frame.pts * self._base) + self._offset
        previous, step = self._previous, self._step or float((frame.duration or 0) * self._base) or 1 / 25
        if own is None:
            self._notes.add("untimed", f"frame {number}: no time in the file, taken {step:.6g} s after the last")
            time = 0.0 if previous is None else previous + step
        elif previous is None or own > previous:
            time = own
            if previous is not None and own - previous < CLOCK_RESTART_S:
                self._step = own - previous
        elif previous - own > CLOCK_RESTART_S:
            self._notes.add("restart", f"frame {number}: the clock goes back {previous - own:.3f} s, carried on")
            time = previous + step
            self._offset += time - own
        else:
            self._notes.add("order", f"frame {number}: time {own:.6f} s is not after {previous:.6f} s, moved after it")
            time = previous + step / 10
        self._previous = time
        return time


def _read_container(path: Path, container: InputContainer, threads: int, fast: bool) -> VideoReader:
    """A reader of the first real video stream."""
    stream, notes = _stream(path, container, threads, fast), _Notes()
    decoded = _decode(container, stream, notes)
    first = next(decoded, None)
    if first is None:
        raise VideoError(path, "at least one frame that decodes", notes.text() or "none")
    display = _display_of(path, stream, first)
    frames = _shown(chain([first], decoded), display, _Clock(stream, notes), notes)
    return VideoReader(_info_of(path, stream, first, display), frames, notes, container)


def _read_from(
    path: Path, container: InputContainer, threads: int, fast: bool, start: tuple[int, float]
) -> VideoReader:
    """A reader of the first real video stream that begins with the frame of that number and time."""
    number, time = start
    stream, notes = _stream(path, container, threads, fast), _Notes()
    base = stream.time_base
    if base is not None:
        try:
            container.seek(int((time - SOUGHT_BEFORE_S) / base), stream=stream)
            stream.codec_context.flush_buffers()
            decoded = _decode(container, stream, notes)
            before = True
            for frame in decoded:
                own = None if frame.pts is None else float(frame.pts * base)
                before &= own is not None and own < time - SAME_TIME_S
                if own is not None and abs(own - time) <= SAME_TIME_S:
                    display = _display_of(path, stream, frame)
                    frames = _shown(chain([frame], decoded), display, _Clock(stream, notes), notes, number)
                    return VideoReader(_info_of(path, stream, frame, display), frames, notes, container)
                if not before:
                    break
        except (FFmpegError, OSError):
            pass
    container.close()
    reader = open_video(path, threads=threads, fast=fast)
    for skipped in range(number):
        if next(iter(reader), None) is None:
            raise VideoError(path, f"a frame {number}", f"its end after {skipped} frames")
    return reader


def _stream(path: Path, container: InputContainer, threads: int, fast: bool) -> av.VideoStream:
    """The first real video stream, set up for decoding."""
    stream = next((each for each in container.streams.video if not each.disposition & Disposition.attached_pic), None)
    if stream is None or stream.codec_context is None:
        raise VideoError(path, "a video stream that can be decoded", f"none in a file of kind {container.format.name}")
    stream.thread_type = "AUTO"
    stream.codec_context.thread_count = threads
    if fast:
        stream.codec_context.options = {"skip_loop_filter": "all", "flags2": "+fast"}
    return stream


def _open_still(path: Path) -> VideoReader:
    """A reader of one picture, at time 0."""
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise VideoError(path, "a picture", f"{path.stat().st_size} bytes that do not decode")
    notes = _Notes()
    data = path.read_bytes()
    if data.startswith(b"\xff\xd8") and data.rfind(b"\xff\xd9") < data.rfind(b"\xff\xda"):
        # A JPEG without its end marker: what is missing below was filled with grey.
        notes.add("cut", "frame 0: the picture file ends early, part of the picture is missing")
    height, width = bgr.shape[:2]
    info = VideoInfo(
        path=path, width=width, height=height, stored_width=width, stored_height=height, rotation=0, mirrored=False,
        sample_aspect="1/1", time_base="1/1", codec="still", pixel_format="bgr24", full_range=True, claimed_frames=1,
        claimed_fps=0.0,
    )  # fmt: skip
    return VideoReader(info, iter([PictureFrame(bgr)]), notes, None)


def _decode(container: InputContainer, stream: av.VideoStream, notes: _Notes) -> Iterator[av.VideoFrame]:
    """Every frame that decodes; a packet that does not is noted and passed over."""
    packets = container.demux(stream)
    frames = read = 0
    end: float | None = None
    packet: av.Packet | None = None
    flushed = False
    while not flushed:
        try:
            # The last packet is an empty one, which makes the decoder give out what it still holds.
            packet = next(packets, None)
            flushed = packet is None or packet.size == 0 and packet.dts is None
        except (FFmpegError, OSError) as error:
            notes.add("reading", f"reading failed after {frames} frames: {_cause(error)}")
            packet, flushed = None, True
        if packet is not None:
            read += packet.size > 0
            if packet.is_corrupt:
                notes.add("packet", f"frame {frames} or soon after: damaged data in the file")
        try:
            decoded = stream.codec_context.decode(packet)
        except EndOfFile:
            break
        except (FFmpegError, OSError) as error:
            notes.add("decoding", f"after {frames} frames: a piece of the video does not decode: {_cause(error)}")
            continue
        for frame in decoded:
            if frame.is_corrupt:
                notes.add("frame", f"frame {frames}: decoded with errors")
            if frame.time is not None:
                end = max(end or 0.0, frame.time)
            yield frame
            frames += 1
    listed = len(stream.index_entries) if "mov" in container.format.name else 0
    if read < listed:
        notes.add("cut", f"the file ends early: {frames} frames decoded, {read} of {listed} pictures present")
    stated = container.duration / 1e6 if "matroska" in container.format.name and container.duration else 0.0
    if end is not None and len(container.streams) == 1 and end + MISSING_END_S < stated:
        notes.add("cut", f"the file ends early: {frames} frames decoded, the last at {end:.3f} s of {stated:.3f} s")


def _shown(
    frames: Iterable[av.VideoFrame], display: Display, clock: _Clock, notes: _Notes, first: int = 0
) -> Iterator[DecodedFrame]:
    """Decoded frames as displayed, numbered from `first`, up to a change of size."""
    converter = Converter()
    size: tuple[int, int] | None = None
    for number, frame in enumerate(frames, first):
        size = size or (frame.width, frame.height)
        if (frame.width, frame.height) != size:
            found = f"{frame.width}x{frame.height}"
            notes.add("size", f"frame {number}: expected {size[0]}x{size[1]} as before, got {found}; stopped there")
            return
        yield CodecFrame(frame, display, converter, number, clock.time(frame, number))


def _display_of(path: Path, stream: av.VideoStream, frame: av.VideoFrame) -> Display:
    """How the stream's pictures are shown."""
    aspect = stream.sample_aspect_ratio or stream.codec_context.sample_aspect_ratio or Fraction(1)
    scaled = (max(1, round(frame.width * aspect)), frame.height) if aspect > 0 and aspect != 1 else None
    matrix = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return Display(scaled=scaled, mirrored=False, rotation=0)
    # x_shown = a x + c y, y_shown = b x + d y, in 16.16 fixed point.
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5] / 65536.0
    mirrored = bool(a * d - b * c < 0)
    angle = np.degrees(np.arctan2(-b, -a) if mirrored else np.arctan2(b, a)) % 360
    rotation = round(angle / 90) * 90
    if not np.hypot(a, b) > 0 or abs(angle - rotation) > 1:
        raise VideoError(path, "a display turn by a multiple of 90 degrees", f"{angle:.1f} degrees")
    return Display(scaled=scaled, mirrored=mirrored, rotation=rotation % 360)


def _info_of(path: Path, stream: av.VideoStream, frame: av.VideoFrame, display: Display) -> VideoInfo:
    """What the first frame and the header say."""
    width, height = display.size(frame.width, frame.height)
    aspect = Fraction(display.scaled[0], frame.width) if display.scaled else Fraction(1)
    return VideoInfo(
        path=path,
        width=width,
        height=height,
        stored_width=frame.width,
        stored_height=frame.height,
        rotation=display.rotation,
        mirrored=display.mirrored,
        sample_aspect=f"{aspect.numerator}/{aspect.denominator}",
        time_base=f"{stream.time_base.numerator}/{stream.time_base.denominator}" if stream.time_base else "1/1",
        codec=stream.codec_context.name,
        pixel_format=frame.format.name,
        full_range=is_full_range(frame),
        claimed_frames=stream.frames,
        claimed_fps=float(stream.average_rate or 0),
    )


def _cause(error: Exception) -> str:
    """The words of a decoder's error, without its number."""
    return getattr(error, "strerror", None) or str(error)
