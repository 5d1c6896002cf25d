"""What the tables of one clip hold to among each other."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import FASTEST_M_S, Columns, as_text, rows_fault
from pgm_data.scene import Scene

SAME_S = 1e-6
"""Seconds by which a flight's start and the event that starts it may differ."""
NEAREST_S = 1e-3
"""Seconds by which another frame may lie nearer to an event than the one it names."""


def misaligned_faults(columns: Columns, camera: Columns) -> Iterator[Fault]:
    """Keys of a frame-aligned table that are not those of the camera table."""
    for name in ("frame_index", "video_frame", "timestamp"):
        ours, theirs = columns[name], camera[name]
        if len(ours) != len(theirs):
            yield Fault(field="", expected=f"{len(theirs)} rows, as in camera.parquet", found=f"{len(ours)} rows")
            return
        bad = np.flatnonzero(ours != theirs)
        if len(bad):
            expected = f"{as_text(theirs[bad[0]])} in row {bad[0]}, as in camera.parquet"
            yield Fault(field=name, expected=expected, found=as_text(ours[bad[0]]))


def unsolved_faults(solved_share: float, status: np.ndarray) -> Iterator[Fault]:
    """A share of solved frames that the camera table does not have."""
    share = float(np.mean(status != "none")) if len(status) else 0.0
    if abs(share - solved_share) > 1e-6:
        expected = f"{share:.9g}, the share of frames with a camera in camera.parquet"
        yield Fault(field="solved_share", expected=expected, found=f"{solved_share:.9g}")


def flight_event_faults(flights: Columns, events: Columns) -> Iterator[Fault]:
    """Flights whose events are not there, or not at the flight's times."""
    times = events.get("time", np.zeros(len(events.get("clip_id", ()))))
    for name, time in (("start_event", "start_time"), ("end_event", "end_time")):
        if name not in flights:
            continue
        named = flights[name]
        there = (named >= 0) & (named < len(times))
        yield from rows_fault(name, ~there, f"one of the {len(times)} events", named)
        if "time" in events and time in flights:
            if "start_event" in flights and "end_event" in flights:
                there = there & (flights["start_event"] < flights["end_event"])
            apart = np.zeros(len(named))
            apart[there] = np.abs(times[named[there]] - flights[time][there])
            yield from rows_fault(time, apart > SAME_S, f"the time of its {name}", flights[time])


def event_frame_faults(events: Columns, camera: Columns) -> Iterator[Fault]:
    """Events that name another frame than the one taken nearest to them."""
    if not all(name in events for name in ("time", "frame_index")) or "frame.capture_time" not in camera:
        return
    captured, time, frame = camera["frame.capture_time"], events["time"], events["frame_index"]
    inside = (frame >= 0) & (frame < len(captured))
    if not inside.any() or (np.diff(captured) < 0).any():
        return  # has been reported
    after = np.searchsorted(captured, time).clip(0, len(captured) - 1)
    least = np.minimum(np.abs(time - captured[after]), np.abs(time - captured[np.maximum(after - 1, 0)]))
    own = np.abs(time - captured[frame.clip(0, len(captured) - 1)])
    yield from rows_fault("frame_index", inside & (own > least + NEAREST_S), "the frame taken nearest to it", frame)


def ball_event_faults(ball: Columns, events: Columns) -> Iterator[Fault]:
    """Frames that show an event which is not in the table of events, and events that no frame shows."""
    if not all(name in ball for name in ("ball.event", "ball.status")):
        return
    if not all(name in events for name in ("kind", "frame_index")):
        return
    shown = ball["ball.event"]
    kinds: dict[int, set[str]] = {}
    for frame, kind in zip(events["frame_index"].tolist(), events["kind"], strict=True):
        kinds.setdefault(frame, set()).add(kind)
    stray = np.array([word != "none" and word not in kinds.get(i, ()) for i, word in enumerate(shown)], dtype=bool)
    yield from rows_fault("ball.event", stray, "none, or an event of that kind and frame in events.parquet", shown)
    if (ball["ball.status"] != "none").any():
        silent = np.array([word == "none" and i in kinds for i, word in enumerate(shown)], dtype=bool)
        yield from rows_fault("ball.event", silent, "the kind of the event of that frame in events.parquet", shown)


def player_speed_faults(players: Columns, camera: Columns, scene: Scene | None) -> Iterator[Fault]:
    """Roots that are reached faster than anything of a scene moves; gaps and repeated pictures are no fault."""
    for player in scene.players if scene is not None else ():
        name = f"{player.name}.root_position"
        if name in players and "frame.capture_time" in camera:
            yield from speed_faults(name, players[name], camera["frame.capture_time"])


def speed_faults(field: str, position: np.ndarray, time: np.ndarray) -> Iterator[Fault]:
    """Positions that are reached faster than anything of a scene moves; gaps and equal times are no fault."""
    if len(position) != len(time) or len(position) < 2:
        return
    step = np.diff(time)
    way = np.linalg.norm(np.diff(position.astype(np.float64), axis=0), axis=1)
    speed = way / np.where(step > 0, step, np.nan)
    fast = np.concatenate([[False], speed > FASTEST_M_S])
    yield from rows_fault(
        field, fast, f"at most {FASTEST_M_S:g} m/s since the row before", lambda row: f"{speed[row - 1]:.4g} m/s"
    )
