"""A clip's ball as one struct: what `ball.parquet`, `events.parquet` and `ball_shots.parquet` hold."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import Scene

SHOWN_FIRST = ("hit", "bounce", "net", "first", "last")
"""Which event a frame shows where it is nearest to several."""
BALL_TABLES = ("ball", "events", "ball_shots")


@dataclass(frozen=True, eq=False, kw_only=True)
class EventRows:
    """The table of events."""

    time: Float[np.ndarray, " events"]
    """Capture time, s."""
    kind: Shaped[np.ndarray, " events"]
    player: Shaped[np.ndarray, " events"]
    probability: Float[np.ndarray, " events"]
    source: Shaped[np.ndarray, " events"]
    position: Float[np.ndarray, "events 3"]
    """World metres; NaN where unknown."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotRows:
    """The table of flights."""

    start_event: Int[np.ndarray, " flights"]
    end_event: Int[np.ndarray, " flights"]
    player: Shaped[np.ndarray, " flights"]
    """Who hit it; empty where nobody did or nobody knows."""
    start_speed: Float[np.ndarray, " flights"]
    """m/s."""
    spin: Float[np.ndarray, "flights 3"]
    """World, rad/s; NaN where it was not free."""
    spin_std: Float[np.ndarray, "flights 3"]
    drag_per_m: Float[np.ndarray, " flights"]
    drag_std_per_m: Float[np.ndarray, " flights"]
    landing_position: Float[np.ndarray, "flights 3"]
    """World metres; NaN where it does not land."""
    in_probability: Float[np.ndarray, " flights"]
    """NaN where nothing lands or nothing counts."""
    free_parameters: Shaped[np.ndarray, " flights"]
    residual_px: Float[np.ndarray, " flights"]
    status: Shaped[np.ndarray, " flights"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipBall:
    """The ball of one clip: a row a decoded frame, the events, the flights."""

    clip_id: str
    video_frame: Int[np.ndarray, " frames"]
    timestamp: Float[np.ndarray, " frames"]
    """The video's own presentation time, s."""
    capture_time: Float[np.ndarray, " frames"]
    """When the picture was taken, s; a repeat has its source's."""
    pixel: Float[np.ndarray, "frames 2"]
    score: Float[np.ndarray, " frames"]
    position: Float[np.ndarray, "frames 3"]
    """World metres; NaN where the status is `none`."""
    velocity: Float[np.ndarray, "frames 3"]
    """m/s; at a contact, the one after it."""
    position_cov: Float[np.ndarray, "frames 3 3"]
    """m^2."""
    status: Shaped[np.ndarray, " frames"]
    events: EventRows
    shots: ShotRows


def nearest_frames(
    times: Float[np.ndarray, " times"], capture_times: Float[np.ndarray, " frames"]
) -> Int[np.ndarray, " times"]:
    """The frame taken nearest to each time; of a frame and its repeats, the first; of two as near, the earlier."""
    after = np.searchsorted(capture_times, times).clip(0, len(capture_times) - 1)
    before = np.maximum(after - 1, 0)
    earlier = np.abs(times - capture_times[before]) <= np.abs(times - capture_times[after])
    return np.searchsorted(capture_times, capture_times[np.where(earlier, before, after)])


def write_clip_ball(folder: Path, ball: ClipBall, *, scene: Scene) -> None:
    """Write the three tables into the folder, each whole or not at all; events lie within the clip's frames."""
    frames, events, shots = len(ball.video_frame), ball.events, ball.shots
    nearest = nearest_frames(events.time, ball.capture_time)
    shown = np.full(frames, "none", dtype=object)
    for kind in reversed(SHOWN_FIRST):
        shown[nearest[events.kind == kind]] = kind
    upper = np.triu_indices(3)
    columns = {
        "clip_id": [ball.clip_id] * frames,
        "frame_index": np.arange(frames),
        "video_frame": ball.video_frame,
        "timestamp": ball.timestamp,
        "ball.pixel": ball.pixel,
        "ball.score": ball.score,
        "ball.position": ball.position,
        "ball.velocity": ball.velocity,
        "ball.position_cov": ball.position_cov[:, upper[0], upper[1]],
        "ball.status": list(ball.status),
        "ball.event": list(shown),
    }
    write_table(folder / "ball.parquet", table="ball", scene=scene, columns=columns)
    columns = {
        "clip_id": [ball.clip_id] * len(events.time),
        "time": events.time,
        "frame_index": nearest,
        "kind": list(events.kind),
        "player": list(events.player),
        "probability": events.probability,
        "source": list(events.source),
        "position": events.position,
    }
    write_table(folder / "events.parquet", table="events", scene=scene, columns=columns)
    columns = {
        "clip_id": [ball.clip_id] * len(shots.start_event),
        "start_event": shots.start_event,
        "end_event": shots.end_event,
        "start_time": events.time[shots.start_event],
        "end_time": events.time[shots.end_event],
        "player": list(shots.player),
        "start_speed": shots.start_speed,
        "spin": shots.spin,
        "spin_std": shots.spin_std,
        "drag_per_m": shots.drag_per_m,
        "drag_std_per_m": shots.drag_std_per_m,
        "landing_position": shots.landing_position,
        "in_probability": shots.in_probability,
        "free_parameters": list(shots.free_parameters),
        "residual_px": shots.residual_px,
        "status": list(shots.status),
    }
    write_table(folder / "ball_shots.parquet", table="ball_shots", scene=scene, columns=columns)


def read_clip_ball(folder: Path, capture_time: Float[np.ndarray, " frames"]) -> ClipBall:
    """The ball of a clip from its folder; capture times are those of its camera table.

    Raises:
        ValueError: If a table is missing, lacks a column, or has another number of frames than the clip.
    """
    ball, events, shots = (_columns(folder / f"{name}.parquet") for name in BALL_TABLES)
    rows = len(ball["video_frame"])
    if rows != len(capture_time):
        raise ValueError(f"{folder / 'ball.parquet'}: expected {len(capture_time)} rows, as the clip has, got {rows}")
    full = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])
    return ClipBall(
        clip_id=folder.name,
        video_frame=ball["video_frame"],
        timestamp=ball["timestamp"],
        capture_time=capture_time,
        pixel=ball["ball.pixel"].astype(np.float64),
        score=ball["ball.score"].astype(np.float64),
        position=ball["ball.position"],
        velocity=ball["ball.velocity"],
        position_cov=ball["ball.position_cov"][:, full].reshape(-1, 3, 3),
        status=ball["ball.status"],
        events=EventRows(**{name: events[name] for name in EventRows.__dataclass_fields__}),
        shots=ShotRows(**{name: shots[name] for name in ShotRows.__dataclass_fields__}),
    )


class _Named(dict[str, np.ndarray]):
    """Columns of a file, which is named where one is missing."""

    def __init__(self, path: Path) -> None:
        super().__init__(read_table(path))
        self.path = path

    def __missing__(self, name: str) -> np.ndarray:
        raise ValueError(f"{self.path}: {name}: expected the column, got {', '.join(self)}")


def _columns(path: Path) -> _Named:
    return _Named(path)
