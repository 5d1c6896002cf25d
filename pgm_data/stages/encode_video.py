"""A video written anew as H.264, frame for frame, for datasets that carry their pictures with them."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from pgm_data.dataset.pack_plan import PackOptions
from pgm_data.dataset.pack_rate import common_rate
from pgm_data.video import VideoError, open_video, write_video


def encode_video(source: Path, target: Path, options: PackOptions) -> None:
    """Write every frame of the source as H.264 of constant quality, upright, with square pixels.

    Frames keep their number, and their time unless the options name a rate; then frame k is at k over that rate.

    Raises:
        ValueError: If the source cannot be decoded.
    """
    try:
        if options.rate:
            rate = Fraction(common_rate(options.rate)).limit_denominator(1001)
            write_video(target, _pictures(source, options.height), fps=rate, crf=options.crf)
        else:
            with open_video(source) as reader:
                times = [frame.timestamp for frame in reader]
            write_video(target, _pictures(source, options.height), timestamps=times, crf=options.crf)
    except VideoError as error:
        raise ValueError(str(error)) from error


def _pictures(source: Path, height: int) -> Iterator[np.ndarray]:
    with open_video(source) as reader:
        for frame in reader:
            picture = frame.bgr()
            if height and height != picture.shape[0]:
                width = max(2, 2 * round(picture.shape[1] * height / picture.shape[0] / 2))
                smaller = height < picture.shape[0]
                picture = cv2.resize(
                    picture, (width, height), interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC
                )
            yield picture
