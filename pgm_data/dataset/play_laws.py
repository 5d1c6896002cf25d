"""What the tables of ball, events, flights and captions hold to."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import (
    FASTEST_M_S,
    Columns,
    Context,
    clip_id_faults,
    covariance_faults,
    missing_faults,
    not_among,
    per_row,
    rows_fault,
    share_faults,
    there_faults,
    time_faults,
    torn_faults,
)

FASTEST_SPIN = 2000.0
"""rad/s; no ball of a racket sport turns faster."""
FARTHEST_M = 100.0
"""No ball in play is farther from the world's origin, metres."""
DEVIATIONS = 4.0
"""Standard deviations that a law leaves to an estimate."""
BELOW_GROUND_M = 0.02
"""How far an uncertain ball's centre may lie below the ground."""


def ball_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the ball table beyond its keys."""
    if "ball.status" in columns:
        names = ("ball.position", "ball.velocity", "ball.position_cov")
        yield from missing_faults(columns, names, columns["ball.status"], "ball.status")
        yield from there_faults(columns, names[:1], columns["ball.status"], "ball.status")
    yield from torn_faults(columns, ("ball.pixel", "ball.position", "ball.velocity"))
    if "ball.position" in columns:
        away = np.linalg.norm(columns["ball.position"], axis=1)
        yield from rows_fault("ball.position", away > FARTHEST_M, f"within {FARTHEST_M:g} m of the origin", away)
    yield from covariance_faults(columns, "ball.position_cov")
    yield from share_faults(columns, ("ball.score",))
    yield from _ground_faults(columns, "ball.position", context, "ball.position_cov")
    if "ball.velocity" in columns:
        speed = np.linalg.norm(columns["ball.velocity"], axis=1)
        yield from rows_fault("ball.velocity", speed > FASTEST_M_S, f"at most {FASTEST_M_S:g} m/s", speed)


def events_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the table of events."""
    yield from clip_id_faults(columns, context)
    if "time" in columns:
        time = columns["time"]
        yield from time_faults("time", time)
        back = np.concatenate([[False], np.diff(time) < 0])[: len(time)]
        yield from rows_fault(
            "time", back, "at least that of the row before", lambda row: f"{time[row]} after {time[row - 1]}"
        )
    yield from _frame_faults(columns, "frame_index", context, last=-1)
    yield from _ground_faults(columns, "position", context)
    yield from torn_faults(columns, ("position",))
    yield from share_faults(columns, ("probability",))
    yield from _player_faults(columns, context)


def ball_shots_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the table of flights."""
    yield from clip_id_faults(columns, context)
    if "start_event" in columns and "end_event" in columns:
        start, end = columns["start_event"], columns["end_event"]
        yield from rows_fault("start_event", start < 0, "at least 0", start)
        yield from rows_fault("end_event", end <= start, "an event after start_event", end)
    if "start_time" in columns and "end_time" in columns:
        start, end = columns["start_time"], columns["end_time"]
        for name in ("start_time", "end_time"):
            yield from time_faults(name, columns[name])
        yield from rows_fault("end_time", end <= start, "a time after start_time", end)
    for name in ("start_speed", "spin_std", "drag_per_m", "drag_std_per_m", "residual_px"):
        if name in columns:
            values = columns[name]
            yield from rows_fault(name, (per_row(values) < 0).any(axis=1), "at least 0", values)
    for name, limit, unit in (("start_speed", FASTEST_M_S, "m/s"), ("spin", FASTEST_SPIN, "rad/s")):
        if name in columns:
            size = np.linalg.norm(per_row(columns[name]), axis=1)
            yield from rows_fault(name, size > limit, f"at most {limit:g} {unit}", size)
    yield from _ground_faults(columns, "landing_position", context)
    yield from share_faults(columns, ("in_probability",))
    yield from _player_faults(columns, context)


def captions_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the table of captions."""
    yield from clip_id_faults(columns, context)
    if "player" in columns and context.scene is not None:
        player, count = columns["player"], len(context.scene.players)
        bad = (player < 0) | (player >= count)
        yield from rows_fault("player", bad, f"the index of one of {count} player objects", player)
    yield from _frame_faults(columns, "start_frame", context, last=-1)
    yield from _frame_faults(columns, "end_frame", context, last=0)
    if "start_frame" in columns and "end_frame" in columns:
        end = columns["end_frame"]
        yield from rows_fault("end_frame", end <= columns["start_frame"], "a frame after start_frame", end)
    for name in ("start_s", "end_s"):
        if name in columns:
            yield from time_faults(name, columns[name])
    if "start_s" in columns and "end_s" in columns:
        yield from rows_fault("end_s", columns["end_s"] < columns["start_s"], "at least start_s", columns["end_s"])
    if "text" in columns:
        blank = np.array([not text.strip() for text in columns["text"]], dtype=bool)
        yield from rows_fault("text", blank, "words", columns["text"])
    if "alternative" in columns:
        yield from rows_fault("alternative", columns["alternative"] < 0, "at least 0", columns["alternative"])
    yield from _orphan_faults(columns)


def _orphan_faults(columns: Columns) -> Iterator[Fault]:
    """Alternatives whose span has no main text, and spans that have one of a number twice."""
    span = ("player", "start_frame", "end_frame", "start_s", "end_s")
    if not all(name in columns for name in (*span, "alternative")):
        return
    rows = list(zip(*(columns[name].tolist() for name in (*span, "alternative")), strict=True))
    main = {row[:-1] for row in rows if row[-1] == 0}
    alone = np.array([row[:-1] not in main for row in rows], dtype=bool)
    yield from rows_fault("alternative", alone, "a main text (alternative 0) of the same player and span", rows)
    seen: set[tuple] = set()
    again = np.zeros(len(rows), dtype=bool)
    for number, row in enumerate(rows):
        again[number] = row in seen
        seen.add(row)
    yield from rows_fault("alternative", again, "each alternative of a player's span once", rows)


def _ground_faults(columns: Columns, name: str, context: Context, cov: str = "") -> Iterator[Fault]:
    """Balls below the ground that the scene's players may stand on, by more than their own uncertainty allows."""
    scene = context.scene
    floors = [player.region_m[0][2] for player in scene.players if player.region_m] if scene is not None else []
    if name in columns and floors:
        height = columns[name][:, 2]
        lowest = min(floors) - BELOW_GROUND_M
        slack = DEVIATIONS * np.sqrt(np.maximum(np.nan_to_num(columns[cov][:, 5]), 0.0)) if cov in columns else 0.0
        expected = f"a height of at least {lowest:g} m" + (f", but for {DEVIATIONS:g} deviations" if cov else "")
        yield from rows_fault(name, height < lowest - slack, expected, height)


def _frame_faults(columns: Columns, name: str, context: Context, last: int) -> Iterator[Fault]:
    """Frames outside of the clip; `last` 0 allows the frame after its end."""
    if name in columns:
        frame = columns[name]
        bad = frame < 0
        expected = "at least 0"
        if context.n_frames is not None:
            bad |= frame > context.n_frames + last
            expected = f"0 to {context.n_frames + last}"
        yield from rows_fault(name, bad, expected, frame)


def _player_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Names that no player object of the scene has."""
    if "player" in columns and context.scene is not None:
        names = [player.name for player in context.scene.players]
        bad = not_among(columns["player"], ["", *names])
        yield from rows_fault("player", bad, f"one of {', '.join(names)}, or nothing", columns["player"])
