"""Videos written: h264 that plays everywhere, with exact times."""

import os
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av
import cv2
import numpy as np
from av.video.reformatter import ColorRange, Colorspace, ColorTrc, Interpolation
from jaxtyping import UInt8

TIME_BASE = Fraction(1, 90000)
"""Clock of a video written with explicit timestamps, seconds."""


def write_video(
    path: Path,
    frames: Iterable[UInt8[np.ndarray, "height width 3"]],
    *,
    fps: float | Fraction | None = None,
    timestamps: Sequence[float] | None = None,
    crf: int = 20,
    preset: str = "veryfast",
    gop: int | None = None,
) -> None:
    """Write BGR pictures as h264, yuv420p; an mp4 has its index at the front.

    An odd width or height is padded to even by repeating the last column or row, so the file is one pixel larger.
    Colours are written by BT.709, limited range, and marked so. The file appears under its name only when complete.

    Args:
        path: File to write; its ending names the container (`.mp4`, `.mkv`, `.mov`).
        frames: Pictures, all of one size.
        fps: Frames per second, evenly spaced from time 0; or else `timestamps`.
        timestamps: Presentation times in seconds, one a frame, rising; kept to 1/90000 s.
        crf: x264's quality, 0 (lossless) to 51.
        preset: x264's speed.
        gop: Frames between key frames; 1 makes every frame a key frame; x264's own choice if None.

    Raises:
        ValueError: If there is no frame, sizes differ, or the times do not fit the frames.
    """
    if (fps is None) == (timestamps is None):
        raise ValueError(f"write_video {path}: expected fps or timestamps, got {'none' if fps is None else 'both'}")
    if fps is not None and not fps > 0:
        raise ValueError(f"write_video {path}: fps: expected above 0, got {fps}")
    rate = None if fps is None else Fraction(fps).limit_denominator(1001)
    base = TIME_BASE if rate is None else 1 / rate
    ticks = None if timestamps is None else [round(Fraction(time) / base) for time in timestamps]
    if ticks is not None and any(after <= before for before, after in pairwise(ticks)):
        raise ValueError(f"write_video {path}: timestamps: expected rising by at least {float(base)} s, got otherwise")
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    # No frames between two others: with them x264 now and then encodes the same pictures to other bytes.
    options = {"crf": str(crf), "preset": preset, "bf": "0"} | ({} if gop is None else {"g": str(gop)})
    count = 0
    try:
        # The index goes to the front, where a cut download still finds it; the start is kept as finely as the steps.
        layout = {"movflags": "+faststart", "movie_timescale": str(TIME_BASE.denominator)}
        is_mp4 = path.suffix.lower() in (".mp4", ".mov", ".m4v")
        with av.open(f"file:{part}", "w", options=layout if is_mp4 else {}) as container:
            stream: av.VideoStream | None = None
            size = (0, 0)
            for count, picture in enumerate(frames, 1):
                if stream is None:
                    size = picture.shape[:2]
                    stream = container.add_stream("libx264", rate=rate or _usual_rate(ticks), options=options)
                    stream.height, stream.width = (side + side % 2 for side in size)
                    stream.pix_fmt = "yuv420p"
                    stream.codec_context.time_base = base
                    stream.codec_context.colorspace = stream.codec_context.color_primaries = Colorspace.ITU709
                    stream.codec_context.color_trc = ColorTrc.BT709
                    stream.codec_context.color_range = ColorRange.MPEG
                if picture.shape[:2] != size:
                    raise ValueError(f"write_video {path}: frame {count - 1}: expected {size}, got {picture.shape}")
                if ticks is not None and count > len(ticks):
                    raise ValueError(f"write_video {path}: timestamps: expected one a frame, got {len(ticks)}")
                frame = _encodable(picture)
                frame.pts, frame.time_base = (count - 1 if ticks is None else ticks[count - 1]), base
                container.mux(stream.encode(frame))
            if stream is None or (ticks is not None and count != len(ticks)):
                expected = "at least one" if ticks is None else len(ticks)
                raise ValueError(f"write_video {path}: frames: expected {expected}, got {count}")
            container.mux(stream.encode())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _encodable(bgr: UInt8[np.ndarray, "height width 3"]) -> av.VideoFrame:
    """The picture padded to even sides, as BT.709 yuv420p."""
    height, width = bgr.shape[:2]
    if height % 2 or width % 2:
        bgr = cv2.copyMakeBorder(bgr, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(bgr), format="bgr24")
    return frame.reformat(
        format="yuv420p",
        dst_colorspace=Colorspace.ITU709,
        dst_color_range=ColorRange.MPEG,
        interpolation=Interpolation.BILINEAR | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INP,
        threads=1,
    )


def _usual_rate(ticks: Sequence[int] | None) -> Fraction:
    """Frames per second at the median step, for the header of a video with its own timestamps."""
    steps = np.diff(ticks) if ticks is not None else np.array([])
    return Fraction(1) / (TIME_BASE * int(np.median(steps))) if len(steps) else Fraction(25)
