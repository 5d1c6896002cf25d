"""What the tables of players, ball, events, flights and captions hold to."""

from collections.abc import Iterator

import numpy as np

from pgm_data.dataset.documents import Fault
from pgm_data.dataset.laws import (
    Columns,
    Context,
    clip_id_faults,
    covariance_faults,
    missing_faults,
    not_among,
    per_row,
    rows_fault,
    share_faults,
    time_faults,
)


def players_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the players table beyond its keys."""
    for player in context.scene.players if context.scene is not None else ():
        prefix = f"{player.name}."
        own = {name: values for name, values in columns.items() if name.startswith(prefix)}
        if f"{prefix}status" in own:
            # Who plays and how the person is built are known even where the person is not seen.
            kept = {f"{prefix}{name}" for name in ("identity", "status", "betas")}
            names = [name for name in own if name not in kept]
            yield from missing_faults(own, names, own[f"{prefix}status"], f"{prefix}status")
        if f"{prefix}box_px" in own:
            box = own[f"{prefix}box_px"]
            inside_out = (box[:, 2] <= box[:, 0]) | (box[:, 3] <= box[:, 1])
            yield from rows_fault(f"{prefix}box_px", inside_out, "x0 < x1 and y0 < y1", box)
        yield from share_faults(own, (f"{prefix}contact",))
        yield from covariance_faults(own, f"{prefix}root_cov")
        if f"{prefix}reprojection_px" in own:
            values = own[f"{prefix}reprojection_px"]
            yield from rows_fault(f"{prefix}reprojection_px", values < 0, "at least 0", values)


def ball_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the ball table beyond its keys."""
    if "ball.status" in columns:
        names = ("ball.position", "ball.velocity", "ball.position_cov")
        yield from missing_faults(columns, names, columns["ball.status"], "ball.status")
    yield from covariance_faults(columns, "ball.position_cov")


def events_faults(columns: Columns, context: Context) -> Iterator[Fault]:
    """Laws of the table of events."""
    yield from clip_id_faults(columns, context)
    if "time" in columns:
        yield from time_faults("time", columns["time"])
    yield from _frame_faults(columns, "frame_index", context, last=-1)
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
