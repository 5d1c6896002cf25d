"""The ball found in a video's pictures: detectors fed frame by frame, candidates linked to one track a clip."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallTrack
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.ball.candidates import BallCandidates, CandidateFinder
from pgm_data.geometry.camera import Camera
from pgm_data.video import open_video

Detector = Literal["network", "motion", "both"]
STILL_PX = 0.5
"""A camera whose picture moves less than this between frames is taken to stand still."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DetectOptions:
    """How the ball is looked for."""

    detector: Detector = "both"
    """The network, the weight-free motion detector, or both."""
    network: str = ""
    """ONNX file of a ball network to use instead of the bundled one."""
    threads: int = 1
    """Of the network."""


def picture_moves(
    camera: Camera, has_camera: np.ndarray, size: tuple[int, int]
) -> list[Float[np.ndarray, "3 3"] | None]:
    """For each frame the homography that takes pixels of the frame before to its own; None where it stands still.

    The camera turns and zooms about its centre; frames without a camera on either side count as still.
    """
    moves: list[Float[np.ndarray, "3 3"] | None] = [None] * len(has_camera)
    both = np.flatnonzero(has_camera[1:] & has_camera[:-1]) + 1
    if not len(both):
        return moves
    turned = camera.R_cam_from_world[both] @ np.swapaxes(camera.R_cam_from_world[both - 1], -1, -2)
    maps = camera.K[both] @ turned @ np.linalg.inv(camera.K[both - 1])
    width, height = size
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]], dtype=float)
    there = corners @ np.swapaxes(maps, -1, -2)
    shift = np.linalg.norm(there[..., :2] / there[..., 2:] - corners[:, :2], axis=-1).max(axis=-1)
    for frame, one, moved in zip(both.tolist(), maps, (shift > STILL_PX).tolist(), strict=True):
        moves[frame] = one if moved else None
    return moves


def turns(moves: Sequence[Float[np.ndarray, "3 3"] | None]) -> Float[np.ndarray, "frames 3 3"] | None:
    """The moves with the identity where the camera stands still; None where it does throughout."""
    if all(move is None for move in moves):
        return None
    return np.stack([np.eye(3) if move is None else move for move in moves])


def made_finders(options: DetectOptions, *, fps: float) -> list[CandidateFinder]:
    """The detectors that the options ask for; `fps` are distinct pictures a second.

    Raises:
        FileNotFoundError, ValueError: If the network is not there or is none.
    """
    finders: list[CandidateFinder] = []
    if options.detector in ("network", "both"):
        from pgm_data.detect.ball.network import BallNetwork, NetworkFinder

        network = BallNetwork.load(Path(options.network) if options.network else None, threads=options.threads)
        finders.append(NetworkFinder(network))
    if options.detector in ("motion", "both"):
        from pgm_data.detect.ball.motion import MotionFinder

        finders.append(MotionFinder(fps=fps))
    return finders


def distinct_fps(clip: ClipCamera) -> float:
    """Distinct pictures a second of a clip; 25 where it has no two."""
    steps = np.diff(np.unique(clip.capture_time))
    return float(1 / np.median(steps)) if len(steps) else 25.0


def detect_clips(
    video: Path,
    clips: Sequence[ClipCamera],
    *,
    options: DetectOptions,
    fast_decode: bool = False,
    report: Callable[[int], None] = lambda frames: None,
) -> Iterator[tuple[ClipCamera, BallTrack, tuple[int, int]]]:
    """Each clip of the video with its ball's track and the picture's size; the video is decoded once.

    Args:
        video: The file.
        clips: Its clips, which share no frame; they come out in order of time.
        options: How the ball is looked for.
        fast_decode: Whether the decoder may skip its deblocking filter.
        report: Told now and then how many frames have been looked at.

    Raises:
        VideoError: If the file cannot be read.
        ValueError: If it does not hold the frames of a clip.
    """
    from pgm_data.detect.ball.link import LinkOptions, link_candidates

    done = 0
    with open_video(video, threads=options.threads, fast=fast_decode) as reader:
        size = (reader.info.width, reader.info.height)
        frames = iter(reader)
        for clip in sorted(clips, key=lambda clip: int(clip.video_frame[0])):
            finders = made_finders(options, fps=distinct_fps(clip))
            moves = picture_moves(clip.camera, clip.has_camera, size)
            for index, number in enumerate(clip.video_frame.tolist()):
                frame = next((frame for frame in frames if frame.video_frame >= number), None)
                if frame is None or frame.video_frame != number:
                    got = "its end" if frame is None else f"frame {frame.video_frame}"
                    raise ValueError(f"{video}: {clip.clip_id}: expected frame {number} of the video, got {got}")
                picture = frame.bgr()
                repeat = bool(clip.is_duplicate[index])
                for finder in finders:
                    finder.add(picture, is_duplicate=repeat, here_from_previous=moves[index])
                done += 1
                if done % 50 == 0:
                    report(done)
            track = link_candidates(
                merged([finder.finish() for finder in finders]),
                times=clip.capture_time,
                is_duplicate=clip.is_duplicate,
                size=size,
                here_from_previous=turns(moves),
                options=LinkOptions(),
            )
            yield clip, track, size


def merged(found: Sequence[BallCandidates]) -> BallCandidates:
    """The candidates of one detector, or of two together."""
    if len(found) == 1:
        return found[0]
    from pgm_data.detect.ball.link import merge_candidates

    return merge_candidates(found[0], found[1])
