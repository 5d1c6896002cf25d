"""What the tables of one clip hold to among each other."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import FASTEST_M_S, Columns, as_text, rows_fault
from pgm_data.dataset.play_laws import DEVIATIONS
from pgm_data.scene import Scene

SAME_S = 1e-6
"""Seconds by which a flight's start and the event that starts it may differ."""
NET_STEP_S = 0.1
"""Longest time between the frames before and after the net in which a ball is taken to fly straight."""
THROUGH_NET_M = 0.25
"""How far below the net's top a ball may seem to pass, beside its own uncertainty, metres."""
NET_EVENT_S = 0.1
"""Seconds by which a net event may miss the frames between which the ball is at the net."""
FASTEST_RUN_M_S = 12.5
"""Nobody runs faster."""
RUN_S = 0.5
"""Seconds over which that is measured, so that the noise of single frames does not count."""
RUN_NOISE_M = 0.5
"""Metres that are left to noise besides, since a body sways about its root."""
SPAN_S = 0.25
"""Seconds by which a span's times may differ from those of its frames, beside one frame."""
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


def net_faults(ball: Columns, events: Columns, camera: Columns, scene: Scene | None) -> Iterator[Fault]:
    """Balls that go through the net, well below its top, where no event says that they met it."""
    net = scene.court.net_world if scene is not None and scene.court is not None else np.zeros((0, 3))
    if not len(net) or not all(name in events for name in ("kind", "time")):
        return
    if "ball.position" not in ball or "frame.capture_time" not in camera:
        return
    position, time = ball["ball.position"].astype(np.float64), camera["frame.capture_time"]
    if len(position) != len(time) or len(time) < 2:
        return
    before, after = position[:-1], position[1:]
    # Over longer, a straight line says nothing about a flight.
    crossing = (before[:, 1] * after[:, 1] < 0) & (np.diff(time) <= NET_STEP_S)
    if not crossing.any():
        return
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(crossing, before[:, 1] / (before[:, 1] - after[:, 1]), np.nan)
        x, z = (before + share[:, None] * (after - before))[:, [0, 2]].T
    top = np.interp(x, net[:, 0], net[:, 2], left=-np.inf, right=-np.inf)
    spread = np.zeros(len(position))
    if "ball.position_cov" in ball:
        spread = np.sqrt(np.nan_to_num(ball["ball.position_cov"][:, 5]).clip(0.0))
    low = crossing & (z < top - THROUGH_NET_M - DEVIATIONS * np.maximum(spread[:-1], spread[1:]))
    met = events["time"][events["kind"] == "net"]
    for row in np.flatnonzero(low):
        near = (met >= time[row] - NET_EVENT_S) & (met <= time[row + 1] + NET_EVENT_S)
        low[row] = not near.any()

    def shown(row: int) -> str:
        return f"{z[row - 1]:.3g} m where the net is {top[row - 1]:.3g} m high"

    expected = "a ball that passes over the net or beside it, or a net event"
    yield from rows_fault("ball.position", np.concatenate([[False], low]), expected, shown)


def player_speed_faults(players: Columns, camera: Columns, scene: Scene | None) -> Iterator[Fault]:
    """Roots that nobody could have reached so soon; gaps and repeated pictures are no fault."""
    if "frame.capture_time" not in camera:
        return
    time = camera["frame.capture_time"]
    for player in scene.players if scene is not None else ():
        name = f"{player.name}.root_position"
        if name in players:
            yield from speed_faults(name, players[name], time)
            cov = players.get(f"{player.name}.root_cov")
            person = players.get(f"{player.name}.identity")
            yield from _run_faults(name, players[name], cov, person, time)


def _run_faults(
    field: str, position: np.ndarray, cov: np.ndarray | None, person: np.ndarray | None, time: np.ndarray
) -> Iterator[Fault]:
    """Ways along the ground that nobody runs in half a second, where the estimate's own doubt does not explain them."""
    if len(position) != len(time) or len(time) < 2 or (np.diff(time) < 0).any():
        return
    later = np.searchsorted(time, time + RUN_S - 1e-9)
    row = np.flatnonzero(later < len(time))
    row = row[time[later[row]] - time[row] <= 2 * RUN_S]
    end = later[row]
    if person is not None:
        same = person[row] == person[end]
        row, end = row[same], end[same]
    place = position[:, :2].astype(np.float64)
    spread = np.zeros(len(place))
    if cov is not None:
        spread = np.sqrt(np.nan_to_num(cov[:, [0, 3]].astype(np.float64)).clip(0.0).sum(axis=1))
    way, step = np.linalg.norm(place[end] - place[row], axis=1), time[end] - time[row]
    far = np.zeros(len(time), dtype=bool)
    far[row] = way > FASTEST_RUN_M_S * step + RUN_NOISE_M + DEVIATIONS * (spread[row] + spread[end])
    speed = np.full(len(time), np.nan)
    speed[row] = way / step
    expected = f"at most {FASTEST_RUN_M_S:g} m/s along the ground over {RUN_S:g} s"
    yield from rows_fault(field, far, expected, lambda first: f"{speed[first]:.4g} m/s")


def caption_time_faults(captions: Columns, camera: Columns) -> Iterator[Fault]:
    """Spans whose times are not those of their frames; what a clip cuts off may begin earlier and end later."""
    if "frame.capture_time" not in camera or not len(camera["frame.capture_time"]):
        return
    time = camera["frame.capture_time"]
    # The frame after the last is taken one step later.
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    time, last = np.append(time, time[-1] + step), len(time)
    for name, frame, border, sign in (("start_s", "start_frame", 0, -1.0), ("end_s", "end_frame", last, 1.0)):
        if name in captions and frame in captions:
            at = captions[frame]
            apart = captions[name] - time[at.clip(0, last)]
            bad = (np.abs(apart) > SPAN_S + step) & (at >= 0) & (at <= last)
            bad &= ~((at == border) & (sign * apart > 0))
            yield from rows_fault(name, bad, f"a time within {SPAN_S:g} s of its {frame}'s", captions[name])


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
