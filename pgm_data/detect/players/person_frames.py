"""Frames at which people are looked for."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import PersonCandidates, Pictures


def frames_to_look_at(
    pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], every: int
) -> Iterator[tuple[int, UInt8[np.ndarray, "height width 3"]]]:
    """Every so manyth frame that has a camera and repeats no other one, with its picture, BGR.

    Raises:
        ValueError: If a picture has another size (width, height), or there are fewer pictures than frames.
    """
    shown = pictures()
    since = every
    for frame in range(len(clip.has_camera)):
        bgr = next(shown, None)
        if bgr is None:
            raise ValueError(f"{clip.clip_id}: expected {len(clip.has_camera)} pictures, got {frame}")
        if (bgr.shape[1], bgr.shape[0]) != size:
            raise ValueError(
                f"{clip.clip_id}: frame {frame}: expected a picture of {size[0]}x{size[1]}, got "
                f"{bgr.shape[1]}x{bgr.shape[0]}"
            )
        if not clip.has_camera[frame] or clip.is_duplicate[frame]:
            continue
        since += 1
        if since >= every:
            since = 0
            yield frame, bgr


def people_of(
    boxes_px: Float[np.ndarray, "people 4"],
    ground_world: Float[np.ndarray, "people 2"],
    person: Float[np.ndarray, " people"],
    player: Float[np.ndarray, " people"],
) -> PersonCandidates:
    """People of one picture, as of frame 0: those that have a box and a place on the ground."""
    good = np.isfinite(boxes_px).all(axis=1) & np.isfinite(ground_world).all(axis=1)
    good &= (boxes_px[:, 2:] > boxes_px[:, :2]).all(axis=1)
    return PersonCandidates(
        frame=np.zeros(int(good.sum()), np.int64),
        boxes_px=boxes_px[good],
        ground_world=ground_world[good],
        person=person[good],
        player=player[good],
    )


def nobody() -> PersonCandidates:
    """No people."""
    return people_of(np.zeros((0, 4)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def joined(seen: list[tuple[int, PersonCandidates]]) -> PersonCandidates:
    """The people of several frames, given with the frame of each, in order."""
    frames = [np.full(len(people.person), frame, np.int64) for frame, people in seen]
    parts = [people for _, people in seen] or [nobody()]
    return PersonCandidates(
        frame=np.concatenate([np.zeros(0, np.int64), *frames]),
        boxes_px=np.concatenate([p.boxes_px for p in parts]),
        ground_world=np.concatenate([p.ground_world for p in parts]),
        person=np.concatenate([p.person for p in parts]),
        player=np.concatenate([p.player for p in parts]),
    )
