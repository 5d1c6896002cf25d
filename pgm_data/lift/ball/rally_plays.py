"""The frames that a rally's fit sees, and its contacts: the ball's plays as the solvers take them."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.camera_doubt import CameraDoubt

ContactKind = Literal["hit", "bounce", "net", "end"]
"""`end`: the first or last frame of a play, where nothing touches the ball."""
APART_S = 2e-3
"""Contacts closer than this are one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RallyFrames:
    """Distinct pictures of a clip, in order of time: repeats are left out."""

    index: Int[np.ndarray, " pictures"]
    """Frames of the track."""
    times: Float[np.ndarray, " pictures"]
    pixels: Float[np.ndarray, "pictures 2"]
    """0 where there is no measurement."""
    precision: Float[np.ndarray, " pictures"]
    """1/px^2, the camera's scatter in it; 0 where there is no measurement."""
    camera: Float[np.ndarray, "pictures 20"]
    """fx, fy, cx, cy, lens, rotation, translation; the nearest camera in time where a picture has none."""
    interval_s: float
    """Usual time from one picture to the next."""

    @property
    def measured(self) -> Bool[np.ndarray, " pictures"]:
        """Pictures in which the ball was measured."""
        return np.asarray(self.precision > 0)

    def without(self, outliers: Bool[np.ndarray, " pictures"]) -> "RallyFrames":
        """The same, those pictures being no measurements."""
        return replace(self, precision=np.where(outliers, 0.0, self.precision))


def rally_frames(track: BallTrack, camera: Camera, doubt: CameraDoubt) -> RallyFrames | None:
    """The pictures of a track; None where no frame has a camera, or all repeat another.

    Raises:
        ValueError: If the camera does not have one row a frame of the track.
    """
    rows = len(track.times)
    if camera.K.shape != (rows, 3, 3):
        raise ValueError(f"camera: expected one a frame, {rows}, got K of shape {camera.K.shape}")
    numbers = camera_numbers(camera)
    known = np.asarray(np.isfinite(numbers).all(axis=1))
    if not known.any():
        return None
    distinct = np.flatnonzero(~track.is_duplicate & np.append(True, np.diff(track.times) > 1e-6))
    if not len(distinct):
        return None
    there = np.flatnonzero(known)
    nearest = there[np.abs(track.times[distinct][:, None] - track.times[there][None]).argmin(axis=1)]
    measured = track.measured[distinct] & known[distinct]
    variance = np.where(measured, track.sigma_px[distinct] ** 2 + doubt.pixel_std**2, 1.0)
    times = track.times[distinct]
    return RallyFrames(
        index=distinct,
        times=times,
        pixels=np.where(measured[:, None], track.pixels[distinct], 0.0),
        precision=np.where(measured, 1 / variance, 0.0),
        camera=numbers[nearest],
        interval_s=float(np.median(np.diff(times))) if len(times) > 1 else 0.04,
    )


def camera_numbers(camera: Camera) -> Float[np.ndarray, "frames 20"]:
    """The cameras' numbers in the order of the solver's functions."""
    K = camera.K
    focal = np.stack([K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2]], axis=1)
    R = camera.R_cam_from_world.reshape(-1, 9)
    return np.concatenate([focal, camera.distortion, R, camera.t_cam_from_world], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Play:
    """Contacts of one play, two or more, in order of time."""

    event: Int[np.ndarray, " contacts"]
    """Index into the events."""
    kinds: tuple[ContactKind, ...]
    times: Float[np.ndarray, " contacts"]
    time_std: Float[np.ndarray, " contacts"]
    ground_px: Float[np.ndarray, "contacts 2"]
    players: tuple[str, ...]
    serve: int
    """The contact that may be a serve: the play's first hit, if nothing but its first frame is before it; or -1."""

    def __len__(self) -> int:
        """Number of contacts."""
        return len(self.event)

    def at(self, times: Float[np.ndarray, " contacts"]) -> "Play":
        """The same contacts at other times."""
        return replace(self, times=times)

    def part(self, start: int, stop: int) -> "Play":
        """Contacts from one to another, that one included."""
        window = slice(start, stop + 1)
        return Play(
            event=self.event[window],
            kinds=self.kinds[window],
            times=self.times[window],
            time_std=self.time_std[window],
            ground_px=self.ground_px[window],
            players=self.players[window],
            serve=self.serve - start if start <= self.serve <= stop else -1,
        )


def plays(events: BallEvents) -> list[Play]:
    """The plays of a clip: `first` starts one and `last` ends one, where nothing touches the ball at that time.

    Of contacts that are all but simultaneous one stays: a hit or bounce before `first` and `last`, then the likelier.
    """
    found: list[Play] = []
    current: list[int] = []

    def close() -> None:
        if len(current) > 1:
            found.append(_play(events, np.array(current)))
        current.clear()

    ended = False
    for i, (time, kind) in enumerate(zip(events.times, events.kinds, strict=True)):
        near = current and time - events.times[current[-1]] < APART_S
        if (ended or kind == "first") and not near:
            close()
        if near:
            if _rank(events, i) > _rank(events, current[-1]):
                current[-1] = i
        else:
            current.append(i)
        ended = kind == "last" or (ended and bool(near))
    close()
    return found


def _rank(events: BallEvents, i: int) -> tuple[bool, float]:
    return events.kinds[i] not in ("first", "last"), float(events.probability[i])


def _play(events: BallEvents, index: np.ndarray) -> Play:
    kinds: list[ContactKind] = []
    for kind in events.kinds[index]:
        kinds.append("hit" if kind == "hit" else "bounce" if kind == "bounce" else "net" if kind == "net" else "end")
    return Play(
        event=index,
        kinds=tuple(kinds),
        times=events.times[index],
        time_std=np.where(np.isfinite(events.time_std[index]), np.maximum(events.time_std[index], 0.0), 0.05),
        ground_px=events.ground_px[index],
        players=tuple(str(name) for name in events.players[index]),
        serve=0 if kinds[0] == "hit" else 1 if kinds[:2] == ["end", "hit"] else -1,
    )
