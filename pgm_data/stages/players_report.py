"""The players' part of a clip's report.html: who, how well, where on the court, and what is said of them."""

from html import escape

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.dataset.clip_captions import CaptionRows
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.scene import load_scene
from pgm_data.stages.report_parts import DASH, number, share, table, tiles
from pgm_data.stages.report_plots import Curve, plot

PLAYER_COLUMNS = ("Players#", "Body px#")
"""What a clip's row in the work folder's report says of its players."""
CAPTION_COLUMNS = ("Captions#",)
MOST_CAPTIONS = 400
STYLES = ("c1", "c2", "c3")
COLOURS = ("#0969da", "#bf5700", "#8250df")
PLAN_SCALE = 9.0
"""Pixels of the plan for a metre."""
SPEED_OVER_S = 0.2
"""Speeds are taken over so long."""


def players_cells(players: ClipPlayers | None) -> tuple[str, ...]:
    """The values of `PLAYER_COLUMNS` for a clip, escaped; dashes for a clip without players."""
    if players is None or not players.players:
        return (DASH,) * len(PLAYER_COLUMNS)
    placed = [int((track.status != "none").sum()) for track in players.players]
    frames = len(players.video_frame)
    fit = np.concatenate([track.reprojection_px for track in players.players])
    return " / ".join(share(count, frames) for count in placed), number(_median(fit), 1)


def captions_cells(captions: CaptionRows | None) -> tuple[str, ...]:
    """The values of `CAPTION_COLUMNS` for a clip."""
    return (DASH,) if captions is None else (f"{int((captions.alternative == 0).sum())}",)


def players_section(players: ClipPlayers, times: Float[np.ndarray, " frames"], scene: str) -> str:
    """The players' section of a clip's page, as HTML.

    Args:
        players: The clip's players.
        times: Capture times, s.
        scene: Name of the scene; the court of one that does not ship with pgm is not drawn.
    """
    rows = [_row(track, times) for track in players.players]
    head = ("Player", "Who", "Measured#", "Filled#", "None#", "Body px#", "Place +-m#", "Distance m#", "Fastest m/s#")
    speeds = tuple(
        Curve(name=track.name, values=_speed(track, times), style=STYLES[i % len(STYLES)])
        for i, track in enumerate(players.players)
    )
    heights = tuple(
        Curve(name=track.name, values=track.root_position[:, 2], style=STYLES[i % len(STYLES)])
        for i, track in enumerate(players.players)
    )
    frames = len(times)
    numbers = tiles(
        [(share(int((track.status != "none").sum()), frames), f"{track.name} placed") for track in players.players]
    )
    return (
        f"<h2>Players</h2>{numbers}{table((*head, 'On the ground#'), rows)}"
        f'<div class="card">{_plan(players, scene)}<div class="plots">'
        + plot("Speed of the root on the ground", "m/s", times, speeds)
        + plot("Height of the root", "m", times, heights)
        + "</div></div>"
    )


def captions_section(captions: CaptionRows) -> str:
    """The captions of a clip's page, as HTML: main texts in order of time."""
    main = np.flatnonzero(captions.alternative == 0)
    main = main[np.lexsort((captions.player[main], captions.start_s[main]))]
    rows = [
        f'<tr><td class="n">{captions.start_s[i]:.2f}</td><td class="n">{captions.end_s[i]:.2f}</td>'
        f"<td>player{captions.player[i]}</td><td>{escape(str(captions.text[i]))}</td>"
        f"<td>{escape(str(captions.source[i]))}</td></tr>"
        for i in main[:MOST_CAPTIONS]
    ]
    more = f'<p class="quiet">{MOST_CAPTIONS} of {len(main)} captions.</p>' if len(main) > MOST_CAPTIONS else ""
    return "<h2>Captions</h2>" + table(("From s#", "To s#", "Player", "Text", "Source"), rows) + more


def _row(track: PlayerTrack, times: np.ndarray) -> str:
    frames = len(track.status)
    who = sorted({str(name) for name in track.identity if name})
    there = track.status != "none"
    std = np.sqrt(np.maximum(np.linalg.eigvalsh(np.nan_to_num(track.root_cov[there]))[:, -1], 0.0))
    speed = _speed(track, times)
    steps = np.diff(times)
    way = np.nansum(np.nan_to_num((speed[1:] + speed[:-1]) / 2) * steps)
    contact = track.contact[there].max(axis=1) if there.any() else np.zeros(0)
    contact = contact[np.isfinite(contact)]
    cells = (
        *(share(int((track.status == word).sum()), frames) for word in ("measured", "filled", "none")),
        number(_median(track.reprojection_px), 1),
        number(_median(std), 2),
        number(float(way), 0),
        number(float(np.nanmax(speed)) if np.isfinite(speed).any() else None, 1),
        share(int((contact >= 0.5).sum()), len(contact)),
    )
    return (
        f"<tr><td>{escape(track.name)}</td><td>{escape(', '.join(who)) or DASH}</td>"
        + "".join(f'<td class="n">{cell}</td>' for cell in cells)
        + "</tr>"
    )


def _speed(track: PlayerTrack, times: np.ndarray) -> np.ndarray:
    """Speed of the root over the ground, m/s, over about `SPEED_OVER_S`; NaN where not known."""
    speed = np.full(len(times), np.nan)
    if len(times) < 3:
        return speed
    step = float(np.median(np.diff(times)))
    reach = max(1, round(SPEED_OVER_S / 2 / step)) if step > 0 else 1
    if len(times) <= 2 * reach:
        return speed
    moved = np.linalg.norm(track.root_position[2 * reach :, :2] - track.root_position[: -2 * reach, :2], axis=1)
    took = times[2 * reach :] - times[: -2 * reach]
    speed[reach:-reach] = np.where(took > 0, moved / np.where(took > 0, took, 1.0), np.nan)
    return speed


def _plan(players: ClipPlayers, scene: str) -> str:
    """The players' ways over the court, seen from above, as SVG."""
    court = _court(scene)
    half = np.array(court.surface_half_size if court is not None else (9.0, 18.0)) + 1.0
    width, height = 2 * half[1] * PLAN_SCALE, 2 * half[0] * PLAN_SCALE

    def place(points: np.ndarray) -> np.ndarray:
        # The court lies on its side: y to the right, x downward.
        return np.stack([(points[..., 1] + half[1]) * PLAN_SCALE, (points[..., 0] + half[0]) * PLAN_SCALE], axis=-1)

    parts = []
    if court is not None:
        for ends in place(court.lines_world):
            (x0, y0), (x1, y1) = ends
            parts.append(
                f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="#8884" stroke-width="1.5"/>'
            )
    for i, track in enumerate(players.players):
        known = np.isfinite(track.root_position).all(axis=1)
        runs = np.split(np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1)
        for run in runs:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in place(track.root_position[run]))
            colour = COLOURS[i % len(COLOURS)]
            parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px;width:100%" role="img">'
        f"<title>ways over the court, near end on the left</title>{''.join(parts)}</svg>"
    )


def _court(scene: str) -> Court | None:
    try:
        return load_scene(scene).court
    except ValueError:
        return None


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None
