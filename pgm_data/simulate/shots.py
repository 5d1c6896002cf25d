"""One shot of a simulated video: its times, its cameras, what is true in it, and the way to its pictures."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.states import ShotStates


@dataclass(frozen=True, eq=False, kw_only=True)
class Masks:
    """Which object each pixel shows, and how far away it is."""

    labels: UInt8[np.ndarray, "height width"]
    """1 + the object's place in the scene file; 0 where none is."""
    depth: Float32[np.ndarray, "height width"]
    """Camera z, metres; inf where nothing is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Graphics:
    """What a recording shows beside the scene."""

    shutter_s: float | None
    """Exposure; None where the pictures show none."""
    ui_boxes_px: tuple[tuple[float, float, float, float], ...]
    """x0, y0, x1, y1 of scoreboards and marks over the picture."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedShot:
    """Frames between two cuts."""

    kind: Literal["clip", "away"]
    """`away`: a close-up, a replay or a crowd, in which nothing is measured."""
    first_frame: int
    """Of the video."""
    timestamps: Float[np.ndarray, " frames"]
    """Presentation times of the video, s."""
    capture_times: Float[np.ndarray, " frames"]
    """When each picture was taken, s; a repeat has its source's."""
    is_duplicate: Bool[np.ndarray, " frames"]
    track: CameraTrack
    """The true cameras; NaN where `away`."""
    states: ShotStates | None
    """The truth in every frame, times on the clock of `capture_times`; None where only the camera is known."""
    graphics: Graphics
    drawn: Callable[[int], Iterator[UInt8[np.ndarray, "height width 3"]]]
    """Draws the pictures from a frame of the shot on, BGR, in order."""
    masks: Callable[[], Iterator[Masks]] | None
    """Draws the masks of the same frames; None where the scene has none."""

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.timestamps)

    def pictures(self, first: int = 0) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
        """The pictures from frame `first` of the shot on, BGR; every call draws the same ones anew."""
        return self.drawn(first)


def no_cameras(frames: int) -> CameraTrack:
    """The track of frames that show no court."""
    return CameraTrack(
        K=np.full((frames, 3, 3), np.nan),
        distortion=np.full((frames, 4), np.nan),
        R_cam_from_world=np.full((frames, 3, 3), np.nan),
        t_cam_from_world=np.full((frames, 3), np.nan),
    )


def joined(tracks: list[CameraTrack]) -> CameraTrack:
    """The tracks of shots that follow each other."""
    return CameraTrack(
        K=np.concatenate([t.K for t in tracks]),
        distortion=np.concatenate([t.distortion for t in tracks]),
        R_cam_from_world=np.concatenate([t.R_cam_from_world for t in tracks]),
        t_cam_from_world=np.concatenate([t.t_cam_from_world for t in tracks]),
    )


def later(states: ShotStates, seconds: float) -> ShotStates:
    """The states with their clock put forward."""
    return replace(
        states,
        events=tuple(replace(e, time=e.time + seconds) for e in states.events),
        captions=tuple(replace(c, start_s=c.start_s + seconds, end_s=c.end_s + seconds) for c in states.captions),
    )


def until(states: ShotStates, end_s: float) -> ShotStates:
    """The states without what happens after a moment: events, flights and captions that end later.

    A caption may tell of the last thing in its span, so one that is cut off is left out whole.
    """
    kept = sum(e.time <= end_s for e in states.events)
    return replace(
        states,
        events=states.events[:kept],
        flights=tuple(f for f in states.flights if f.end_event < kept),
        captions=tuple(c for c in states.captions if c.end_s <= end_s),
    )
