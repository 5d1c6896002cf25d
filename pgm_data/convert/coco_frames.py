"""Which frame of a clip each image of a COCO file is.

Taken from the first of these that all images have: `frame_index` (frame of the clip; images with another `clip_id` are
another clip's), `video_frame` or `frame_id` (frame of the video in a sequential decode, from 0), the last number in
`file_name` (frame of the video), and at last the order, where there are as many images as frames. Images of other
frames are passed over.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from pgm_data.convert.imported_work import natural_order
from pgm_data.convert.track_csv import LAST_FRAME
from pgm_data.dataset.clip_camera import ClipCamera

OF_VIDEO = ("video_frame", "frame_id")
NUMBER_IN_NAME = re.compile(r"([0-9]+)[^0-9]*$", re.ASCII)


def frames_of_images(
    path: Path, images: list[dict[str, Any]], clip: ClipCamera, first_number: int | None
) -> Int[np.ndarray, " images"]:
    """The frame of the clip that each image is; -1 where it is none of it.

    Raises:
        ValueError: If it does not follow from the file, or two images are one frame.
    """
    own = np.array([image.get("clip_id", clip.clip_id) == clip.clip_id for image in images], dtype=bool)
    if not own.any():
        others = sorted({str(image["clip_id"])[:60] for image in images if "clip_id" in image})
        got = ", ".join(others[:5]) or "no image"
        raise ValueError(f"{path}: images: expected those of clip {clip.clip_id}, got {got}")
    mine = [image for image, is_own in zip(images, own, strict=True) if is_own]
    frame = np.full(len(images), -1)
    frame[own] = _frames(path, mine, clip, first_number)
    known = frame[frame >= 0]
    if not len(known):
        span = f"{clip.video_frame[0]} to {clip.video_frame[-1]}"
        raise ValueError(f"{path}: images: expected frames of the clip, {span} of the video, got none of them")
    values, counts = np.unique(known, return_counts=True)
    if (counts > 1).any():
        twice = values[counts > 1][0]
        raise ValueError(
            f"{path}: images: expected each frame once, got frame {twice} of the clip {counts.max()} times"
        )
    return frame


def _frames(
    path: Path, images: list[dict[str, Any]], clip: ClipCamera, first_number: int | None
) -> Int[np.ndarray, " images"]:
    count = len(clip.status)
    if all("frame_index" in image for image in images):
        numbers = _whole_numbers(path, "frame_index", [image["frame_index"] for image in images])
        if numbers.max() >= count:
            row = int(numbers.argmax())
            raise ValueError(f"{path}: images[{row}].frame_index: expected below {count}, got {numbers[row]}")
        return numbers
    for name in OF_VIDEO:
        if all(name in image for image in images):
            return in_clip(_whole_numbers(path, name, [image[name] for image in images]), clip)
    found = [NUMBER_IN_NAME.search(str(image.get("file_name", "")).rpartition(".")[0]) for image in images]
    if all(match is not None for match in found):
        texts = [match[1] for match in found if match is not None]
        numbers = _whole_numbers(path, "file_name", [int(text) if len(text) < 16 else LAST_FRAME + 1 for text in texts])
        return in_clip(numbers - numbered_from(path, "file_name", numbers, first_number), clip)
    names = [str(image.get("file_name", "")) for image in images]
    ids = [image["id"] for image in images]
    if len(images) == count and ids == sorted(ids) and names in (sorted(names, key=natural_order), [""] * count):
        return np.arange(count)
    raise ValueError(
        f"{path}: images: expected frame_index or video_frame, a number in each file_name, or the {count} frames of the"
        f" clip in order, got {len(images)} images such as {names[0][:60]!r}"
    )


def in_clip(video_frame: Int[np.ndarray, " rows"], clip: ClipCamera) -> Int[np.ndarray, " rows"]:
    """The frame of the clip that each frame of the video is; -1 where it is none."""
    at = np.searchsorted(clip.video_frame, video_frame).clip(0, len(clip.video_frame) - 1)
    return np.where(clip.video_frame[at] == video_frame, at, -1)


def numbered_from(path: Path, field: str, numbers: Int[np.ndarray, " rows"], first_number: int | None) -> int:
    """The number of the video's first frame: as said, else 0 unless the numbers may as well begin at 1.

    Raises:
        ValueError: If they are 1 to their count without a gap, as a program writes that begins at 1 (or one that
            found nothing in the first frame).
    """
    if first_number is not None:
        return first_number
    distinct = np.unique(numbers)
    if len(distinct) > 1 and distinct[0] == 1 and distinct[-1] == len(distinct):
        raise ValueError(
            f"{path}: {field}: expected numbers that say whether the video's first frame is 0 or 1, got 1 to"
            f" {distinct[-1]}: say it (first number 0 or 1)"
        )
    return 0


def _whole_numbers(path: Path, name: str, values: list) -> Int[np.ndarray, " images"]:
    for row, value in enumerate(values):
        number = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= LAST_FRAME
        if not number or value != int(value):
            expected = f"a frame's number from 0 to {LAST_FRAME}"
            raise ValueError(f"{path}: images[{row}].{name}: expected {expected}, got {value!r:.60}")
    return np.array(values, dtype=np.int64)
