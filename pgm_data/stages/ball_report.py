"""The ball's part of a clip's report.html: its flights, its events, and each rally seen from above and the side."""

from html import escape

import numpy as np

from pgm_data.court import Court
from pgm_data.dataset.clip_ball import ClipBall, nearest_frames
from pgm_data.scene import load_scene
from pgm_data.stages.ball_paths import SAMPLES, FlightPaths, flight_paths, spin_class
from pgm_data.stages.ball_plots import STYLE, rally_plots
from pgm_data.stages.report_parts import DASH, number, share, table, tiles

MOST_PLOTS = 40
"""Rallies that are drawn; of more, the first."""
KMH = 3.6
TURNS_A_MINUTE = 60 / (2 * np.pi)
COLUMNS = ("Ball#", "Shots#", "Fastest km/h#")
"""What a clip's row in the work folder's report says of its ball."""


def ball_cells(ball: ClipBall | None) -> tuple[str, ...]:
    """The values of `COLUMNS` for a clip, escaped; dashes for a clip without a ball."""
    if ball is None:
        return (DASH,) * len(COLUMNS)
    placed = int((ball.status != "none").sum())
    return share(placed, len(ball.status)), f"{len(_hit_speeds(ball))}", _fastest(ball)


def ball_section(ball: ClipBall, scene: str) -> str:
    """The ball's section of a clip's page, as HTML.

    Args:
        ball: The clip's ball.
        scene: Name of its scene; the court of one that does not ship with pgm is not drawn.
    """
    paths = flight_paths(ball)
    frames = len(ball.status)
    kinds = [int((ball.events.kind == kind).sum()) for kind in ("hit", "bounce", "net")]
    numbers = tiles(
        [
            *((share(int((ball.status == word).sum()), frames), word) for word in ("measured", "filled")),
            (share(int((ball.status == "none").sum()), frames), "no ball"),
            *((f"{count}", name) for count, name in zip(kinds, ("hits", "bounces", "net contacts"), strict=True)),
            (_fastest(ball), "fastest hit, km/h"),
            (number(_median(ball.shots.residual_px), 2), "reprojection, median px"),
        ]
    )
    return (
        f"<h2>Ball</h2>{numbers}<h2>Flights</h2>{_flights(ball, paths)}"
        f"<h2>Events</h2>{_events(ball)}<h2>Rallies</h2>{_rallies(ball, paths, scene)}"
    )


def _flights(ball: ClipBall, paths: FlightPaths) -> str:
    shots, events = ball.shots, ball.events
    rows = []
    for i in range(len(paths)):
        ends = f"{events.kind[shots.start_event[i]]} to {events.kind[shots.end_event[i]]}"
        spin, landing = shots.spin[i], shots.landing_position[i]
        kind = spin_class(spin, shots.spin_std[i], _start_velocity(paths, i))
        turns = f" {TURNS_A_MINUTE * np.linalg.norm(spin):.0f}/min" if kind and kind != "flat" else ""
        where = ", ".join(f"{value:.2f}" for value in landing[:2]) if np.isfinite(landing).all() else DASH
        cells = (
            f"{paths.rally[i] + 1}",
            f"{i}",
            number(float(paths.start_time[i]), 2),
            number(float(paths.end_time[i] - paths.start_time[i]), 2),
            number(KMH * float(shots.start_speed[i]), 0),
        )
        tail = (where, number(float(shots.in_probability[i]), 2), number(float(shots.residual_px[i]), 2))
        rows.append(
            "<tr>"
            + "".join(f'<td class="n">{cell}</td>' for cell in cells)
            + f"<td>{escape(ends)}</td><td>{escape(str(paths.hitter[i])) or DASH}</td>"
            + f"<td>{f'{kind}{turns}' if kind else DASH}</td>"
            + "".join(f'<td class="n">{cell}</td>' for cell in tail)
            + f"<td>{escape(str(shots.free_parameters[i])) or DASH}</td>"
            + f'<td class="why">{escape(str(shots.status[i]))}</td></tr>'
        )
    head = (
        *("Rally#", "Flight#", "Start s#", "Lasts s#", "Speed km/h#", "From, to", "Hit by", "Spin", "Lands at x, y m#"),
        *("In#", "px#", "Free in the fit", "Solver"),
    )
    return table(head, rows)


def _events(ball: ClipBall) -> str:
    events = ball.events
    frame = nearest_frames(events.time, ball.capture_time) if len(ball.capture_time) else events.time
    rows = [
        f'<tr><td class="n">{events.time[i]:.3f}</td><td class="n">{frame[i]}</td>'
        f"<td>{escape(str(events.kind[i]))}</td>"
        f"<td>{escape(str(events.player[i])) or DASH}</td>"
        f'<td class="n">{number(float(events.probability[i]), 2)}</td><td>{escape(str(events.source[i]))}</td>'
        f'<td class="n">{_place(events.position[i])}</td></tr>'
        for i in range(len(events.time))
    ]
    return table(("Time s#", "Frame#", "Kind", "Player", "Probability#", "Source", "Position m#"), rows)


def _rallies(ball: ClipBall, paths: FlightPaths, scene: str) -> str:
    count = int(paths.rally[-1]) + 1 if len(paths) else 0
    if not count:
        return '<p class="quiet">none</p>'
    court = _court(scene)
    parts = [STYLE]
    for rally in range(min(count, MOST_PLOTS)):
        flights = np.flatnonzero(paths.rally == rally)
        begin, end = paths.start_time[flights[0]], paths.end_time[flights[-1]]
        title = f"Rally {rally + 1}: {begin:.1f} to {end:.1f} s"
        parts.append(f'<div class="card"><h3>{title}</h3>{rally_plots(ball, paths, court, flights)}</div>')
    if count > MOST_PLOTS:
        parts.append(f'<p class="quiet">{MOST_PLOTS} of {count} rallies are drawn.</p>')
    return "".join(parts)


def _court(scene: str) -> Court | None:
    try:
        return load_scene(scene).court
    except ValueError:
        return None


def _start_velocity(paths: FlightPaths, flight: int) -> np.ndarray:
    """How the ball goes at a flight's beginning, m/s; NaN where it was not placed."""
    own = paths.samples(flight)
    ahead = paths.points_world[own][: SAMPLES + 1]
    times = paths.times[own][: SAMPLES + 1]
    return (ahead[-1] - ahead[0]) / max(times[-1] - times[0], 1e-9)


def _hit_speeds(ball: ClipBall) -> np.ndarray:
    """Speeds of the flights that begin with a hit, m/s."""
    speeds = ball.shots.start_speed[ball.events.kind[ball.shots.start_event] == "hit"]
    return speeds[np.isfinite(speeds)]


def _fastest(ball: ClipBall) -> str:
    speeds = _hit_speeds(ball)
    return number(KMH * float(speeds.max()), 0) if len(speeds) else DASH


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _place(position: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in position) if np.isfinite(position).all() else DASH
