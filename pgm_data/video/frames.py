"""One picture of a video as displayed: luma without a copy, colour and small versions on demand.

The STORED picture is what the codec yields; the DISPLAYED picture has the sample aspect ratio and the rotation of the
file applied. LUMA is the brightness plane as the codec keeps it: in most video 16 is black and 235 white.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Interpolation, VideoReformatter
from jaxtyping import UInt8


class DecodedFrame(ABC):
    """One picture of a video as displayed, with its number and time.

    Small pictures map by their outer borders: `x_full = (x_small + 0.5) * full_width / width - 0.5`, and likewise in y
    with the two heights, whose ratio can differ a little from that of the widths because the height is rounded.
    """

    video_frame: int
    """Number in sequential decode of the file, from 0."""
    timestamp: float
    """Presentation time, seconds."""

    @property
    @abstractmethod
    def luma(self) -> UInt8[np.ndarray, "height width"]:
        """Brightness, read-only; rows may lie further apart than their width (a view of the decoder's memory)."""

    @abstractmethod
    def bgr(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture in colour, converted anew at each call."""

    @abstractmethod
    def small_bgr(self, width: int) -> UInt8[np.ndarray, "small_height width 3"]:
        """The picture in colour, averaged down to the width; the height follows, rounded."""

    @abstractmethod
    def small_luma(self, width: int) -> UInt8[np.ndarray, "small_height width"]:
        """Luma averaged down to the width; the height follows, rounded."""


class PictureFrame(DecodedFrame):
    """A frame made of a picture in memory: a still, or a drawn one."""

    def __init__(
        self, bgr: UInt8[np.ndarray, "height width 3"], *, video_frame: int = 0, timestamp: float = 0.0
    ) -> None:
        """Keep the picture, which must not be changed afterwards."""
        self.video_frame, self.timestamp = video_frame, timestamp
        self._bgr = bgr
        self._luma: np.ndarray | None = None

    @property
    def luma(self) -> UInt8[np.ndarray, "height width"]:
        """OpenCV's grey, full range."""
        if self._luma is None:
            self._luma = _read_only(cv2.cvtColor(self._bgr, cv2.COLOR_BGR2GRAY))
        return self._luma

    def bgr(self) -> UInt8[np.ndarray, "height width 3"]:
        """A copy of the picture."""
        return self._bgr.copy()

    def small_bgr(self, width: int) -> UInt8[np.ndarray, "small_height width 3"]:
        """The picture averaged down."""
        return cv2.resize(self._bgr, _small_size(self._bgr.shape, width), interpolation=cv2.INTER_AREA)

    def small_luma(self, width: int) -> UInt8[np.ndarray, "small_height width"]:
        """The grey picture averaged down."""
        return cv2.resize(self.luma, _small_size(self._bgr.shape, width), interpolation=cv2.INTER_AREA)


@dataclass(frozen=True, eq=False, kw_only=True)
class Display:
    """How a stored picture is shown: scaled, mirrored, then turned."""

    scaled: tuple[int, int] | None
    """Width and height after the sample aspect ratio, None where pixels are square."""
    mirrored: bool
    rotation: int

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Displayed width and height of a stored picture."""
        width, height = self.scaled or (width, height)
        return (height, width) if self.rotation in (90, 270) else (width, height)

    def turned(self, picture: np.ndarray) -> np.ndarray:
        """The picture mirrored and turned, in one block of memory; the same object if neither is asked."""
        if self.mirrored:
            picture = cv2.flip(picture, 1)
        if self.rotation:
            turns = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
            picture = cv2.rotate(picture, turns[self.rotation])
        return picture


class Converter:
    """Colour conversion and scaling, with swscale's tables kept from frame to frame."""

    def __init__(self) -> None:
        self._reformatters: dict[tuple[int, int, str], VideoReformatter] = {}

    def to_array(self, frame: av.VideoFrame, width: int, height: int, pixel_format: str) -> np.ndarray:
        """The stored picture in that size and format; the first plane only where luma is asked by a planar format."""
        reformatter = self._reformatters.setdefault((width, height, pixel_format), VideoReformatter())
        scaling = Interpolation.AREA
        if (width, height) != (frame.width, frame.height):
            # Otherwise two neighbouring pixels of the small picture share one colour.
            scaling |= Interpolation.FULL_CHR_H_INT
        converted = reformatter.reformat(
            frame, width=width, height=height, format=pixel_format, interpolation=scaling, threads=1
        )
        return converted.to_ndarray() if pixel_format == "bgr24" else _first_plane(converted)


class CodecFrame(DecodedFrame):
    """A frame out of a decoder. It holds the decoder's memory: drop it once it has been used."""

    def __init__(
        self, frame: av.VideoFrame, display: Display, converter: Converter, video_frame: int, timestamp: float
    ) -> None:
        """Wrap a decoded picture; nothing is converted yet."""
        self.video_frame, self.timestamp = video_frame, timestamp
        self._frame, self._display, self._converter = frame, display, converter
        self._luma: np.ndarray | None = None

    @property
    def luma(self) -> UInt8[np.ndarray, "height width"]:
        """The decoder's own brightness plane where it is 8 bits and shown unturned; else a converted copy."""
        if self._luma is None:
            width, height = self._display.scaled or (self._frame.width, self._frame.height)
            self._luma = _read_only(self._display.turned(self._stored_luma(width, height)))
        return self._luma

    def bgr(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture in colour."""
        width, height = self._display.scaled or (self._frame.width, self._frame.height)
        return self._display.turned(self._converter.to_array(self._frame, width, height, "bgr24"))

    def small_bgr(self, width: int) -> UInt8[np.ndarray, "small_height width 3"]:
        """The picture in colour, scaled and converted in one step."""
        return self._display.turned(self._converter.to_array(self._frame, *self._small_stored(width), "bgr24"))

    def small_luma(self, width: int) -> UInt8[np.ndarray, "small_height width"]:
        """Luma scaled without a full-size copy."""
        return self._display.turned(self._stored_luma(*self._small_stored(width)))

    def _small_stored(self, width: int) -> tuple[int, int]:
        """Width and height, before turning, of the picture that is `width` wide once turned."""
        full_width, full_height = self._display.size(self._frame.width, self._frame.height)
        size = _small_size((full_height, full_width), width)
        return (size[1], size[0]) if self._display.rotation in (90, 270) else size

    def _stored_luma(self, width: int, height: int) -> np.ndarray:
        """Luma, before turning, at that size."""
        frame = self._frame
        pixels = frame.format
        first = pixels.components[0]
        alone = first.is_luma and first.bits == 8 and not pixels.has_palette
        alone = alone and sum(component.plane == first.plane for component in pixels.components) == 1
        if alone and (width, height) == (frame.width, frame.height) and frame.planes[0].line_size >= width:
            return _first_plane(frame)
        if pixels.is_rgb or pixels.has_palette or not first.is_luma:
            return cv2.cvtColor(self._converter.to_array(frame, width, height, "bgr24"), cv2.COLOR_BGR2GRAY)
        # Formats of one family and range: swscale then leaves the brightness scale alone.
        target = pixels.name if alone else "yuvj420p" if is_full_range(frame) else "yuv420p"
        return self._converter.to_array(frame, width, height, target)


def is_full_range(frame: av.VideoFrame) -> bool:
    """Whether luma runs from 0 to 255; grey and RGB formats are taken to, as swscale takes them."""
    full = frame.format.is_rgb or frame.format.name.startswith(("yuvj", "gray"))
    return full or frame.color_range == ColorRange.JPEG


def _first_plane(frame: av.VideoFrame) -> UInt8[np.ndarray, "height width"]:
    """A view of plane 0, its rows a line size apart."""
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8)[: plane.line_size * frame.height].reshape(
        frame.height, plane.line_size
    )
    return rows[:, : frame.width]


def _small_size(shape: tuple[int, ...], width: int) -> tuple[int, int]:
    """Width and rounded height of a picture of that shape scaled to the width."""
    if width < 1:
        raise ValueError(f"width: expected at least 1 pixel, got {width}")
    return width, max(1, round(shape[0] * width / shape[1]))


def _read_only(picture: np.ndarray) -> np.ndarray:
    """A view that refuses writing: the decoder still predicts later frames from this memory."""
    view = picture.view()
    view.flags.writeable = False
    return view
