"""Frames of clips written as picture files, out of the videos they came from."""

from pathlib import Path
from typing import Any

import cv2

from pgm_data.convert.posed_pictures import FieldError, Problem
from pgm_data.convert.timeline import Timeline
from pgm_data.dataset.files import sha256_of, whole_file
from pgm_data.dataset.source_video import VideoNotFound, find_source_video
from pgm_data.video import VideoError, open_video

JPEG_QUALITY = 95


def source_video(work: Path, document: dict[str, Any], videos: Path | None) -> Path:
    """The video of a clip, looked for as `find_source_video` says, and the very file that the clip was made from.

    Raises:
        FieldError: If it is not there, or is another file.
    """
    try:
        path = find_source_video(work, document, videos)
    except VideoNotFound as error:
        raise FieldError(error.field, error.expected, error.found) from error
    found = sha256_of(path)
    if found != document["sha256"]:
        raise FieldError("sha256", f"{document['sha256']}, of the video it was made from", f"{found} in {path}")
    return path


def write_frame_pictures(work: Path, timeline: Timeline, folder: Path, *, videos: Path | None) -> tuple[Problem, ...]:
    """Write every picture of the time line below the folder under its name, and say which could not be.

    Each video is read once; one that is missing, or is another than its clip says, does not stop the rest.
    """
    problems: list[Problem] = []
    names: dict[Path, dict[int, str]] = {}
    source_of: dict[str, Path] = {}
    for clip_id in dict.fromkeys(frame.clip_id for frame in timeline.pictures.values()):
        try:
            source_of[clip_id] = source_video(work, timeline.clips[clip_id].document, videos)
        except FieldError as error:
            problems.append(error.at(clip_id))
    for name, frame in timeline.pictures.items():
        if frame.clip_id in source_of:
            video_frame = int(timeline.clips[frame.clip_id].video_frame[frame.frame_index])
            names.setdefault(source_of[frame.clip_id], {})[video_frame] = name
    for video, names_of_video in names.items():
        try:
            _write(video, names_of_video, folder)
        except FieldError as error:
            problems.append(error.at(str(video)))
        except VideoError as error:
            problems.append(Problem(place=str(video), field="video", expected=error.expected, found=error.found))
    return tuple(problems)


def _write(video: Path, names: dict[int, str], folder: Path) -> None:
    left = set(names)
    with open_video(video) as reader:
        for frame in reader:
            if frame.video_frame not in left:
                continue
            left.discard(frame.video_frame)
            path = folder / names[frame.video_frame]
            path.parent.mkdir(parents=True, exist_ok=True)
            parameters = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else []
            done, data = cv2.imencode(path.suffix, frame.bgr(), parameters)
            if not done:
                raise RuntimeError(f"{path}: expected a picture that can be encoded as {path.suffix}")
            with whole_file(path) as temporary:
                temporary.write_bytes(data.tobytes())
            if not left:
                return
    raise FieldError("frame", f"frame {min(left)} of the video", "its end before")
