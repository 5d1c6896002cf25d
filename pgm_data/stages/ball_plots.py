"""Rallies seen from above and from the side, as inline SVG: both with the court's length across the page.

Drawn in centimetres, so that `y` runs to the right in both; `x` runs down in the view from above (as z points at the
reader), z up in the view from the side. One-sigma ellipses of the frames' places form a band along each flight.
"""

from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Float, Int

from pgm_data.court import Court
from pgm_data.dataset.clip_ball import ClipBall
from pgm_data.stages.ball_paths import SAMPLES, FlightPaths

CM = 100.0
FAINTEST_CM = 1.0
"""One-sigma ellipses smaller than this are not drawn."""
LEAST_HEIGHT_M = 3.0
MARGIN_M = 0.5
FAR_BEYOND = 1.6
"""Times the surface's half size beyond which a ball is not shown."""
STYLE = """<style>
.rally svg{display:block;width:100%;height:auto}
.rally .court,.rally .net,.rally .flight{fill:none;stroke:var(--quiet);stroke-width:1}
.rally .net{stroke:var(--ink);stroke-width:2}
.rally .flight{stroke-width:1.8;stroke-linejoin:round}
.rally .h1{stroke:var(--c1)}.rally .h2{stroke:var(--c2)}.rally .h3{stroke:var(--c3)}.rally .h0{stroke:var(--quiet)}
.rally .b1{fill:var(--c1)}.rally .b2{fill:var(--c2)}.rally .b3{fill:var(--c3)}.rally .b0{fill:var(--quiet)}
.rally .band{fill-opacity:.13;stroke:none}
.rally .hit,.rally .bounce,.rally .touch{stroke:var(--card);stroke-width:4;fill:var(--ink)}
.rally .bounce{fill:var(--quiet)}.rally .touch{fill:var(--c3)}
.rally .in{fill:var(--ok)}.rally .out{fill:var(--bad)}.rally .perhaps{fill:var(--warn)}
.rally text{font-size:34px;fill:var(--ink)}
.rally .legend i.b1,.rally .legend i.b2,.rally .legend i.b3,.rally .legend i.b0{opacity:.9}
.rally .legend i.b1{background:var(--c1)}.rally .legend i.b2{background:var(--c2)}
.rally .legend i.b3{background:var(--c3)}.rally .legend i.b0{background:var(--quiet)}
</style>"""
COLOURS = 3
TITLES = {"hit": "hit", "bounce": "bounce", "net": "touch"}
"""Class of a contact's mark."""


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """One picture of a rally: two of the world's axes across and down, centimetres."""

    name: str
    axes: tuple[int, int]
    signs: tuple[int, int]
    low: Float[np.ndarray, " 2"]
    """Least coordinate shown, across and down."""
    high: Float[np.ndarray, " 2"]

    def places(self, points_world: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 2"]:
        """Where world points are in the picture."""
        return CM * points_world[:, list(self.axes)] * np.array(self.signs)

    def cov(self, cov_world: Float[np.ndarray, "points 3 3"]) -> Float[np.ndarray, "points 2 2"]:
        """Their covariances, cm^2."""
        signs = np.array(self.signs)
        axes = np.array(self.axes)
        return CM**2 * cov_world[:, axes[:, None], axes] * signs[:, None] * signs


def views_of(court: Court | None, paths: FlightPaths) -> tuple[View, View]:
    """The views from above and from the side, that hold the court and all flights but for stray ones."""
    half = np.array(court.surface_half_size if court is not None else (1.0, 1.0))
    points = paths.points_world[np.isfinite(paths.points_world).all(axis=1)]
    near = points[(np.abs(points[:, :2]) <= FAR_BEYOND * half).all(axis=1)] if court is not None else points
    corners = court.all_world if court is not None and len(court.all_world) else np.zeros((1, 3))
    both = np.concatenate([near, corners])
    low, high = both.min(axis=0) - MARGIN_M, both.max(axis=0) + MARGIN_M
    top = max(float(high[2]), LEAST_HEIGHT_M)
    above = View(name="from above", axes=(1, 0), signs=(1, 1), low=CM * low[[1, 0]], high=CM * high[[1, 0]])
    side = View(
        name="from the side",
        axes=(1, 2),
        signs=(1, -1),
        low=CM * np.array([low[1], -top]),
        high=CM * np.array([high[1], -min(float(low[2]), 0.0)]),
    )
    return above, side


def rally_plots(ball: ClipBall, paths: FlightPaths, court: Court | None, flights: Int[np.ndarray, " flights"]) -> str:
    """Both views of the flights of one rally, with a legend of who hit them; HTML."""
    colour = _colours(paths)
    drawn = [
        f'<div class="plot wide"><h4>{view.name.capitalize()}</h4>{_svg(view, ball, paths, court, flights)}</div>'
        for view in views_of(court, paths)
    ]
    names = list(dict.fromkeys(map(str, paths.hitter[flights])))
    legend = "".join(f'<i class="b{colour[name]}"></i>{escape(name) or "unknown"} ' for name in names)
    return f'<div class="rally"><p class="legend">hit by {legend}</p>{"".join(drawn)}</div>'


def _colours(paths: FlightPaths) -> dict[str, int]:
    """Number of each hitter's colour, the same in all of a clip's rallies; 0 of unknown ones."""
    names = sorted({str(name) for name in paths.hitter} - {""})
    return {"": 0} | {name: 1 + i % COLOURS for i, name in enumerate(names)}


def _svg(
    view: View, ball: ClipBall, paths: FlightPaths, court: Court | None, flights: Int[np.ndarray, " flights"]
) -> str:
    width, height = view.high - view.low
    box = f"{view.low[0]:.0f} {view.low[1]:.0f} {width:.0f} {height:.0f}"
    colour = _colours(paths)
    parts = [_court(view, court)]
    for flight in flights.tolist():
        own = paths.samples(flight)
        number = colour[str(paths.hitter[flight])]
        parts.append(f'<g class="b{number}">{_band(view, paths, own)}</g>')
        parts.append(f'<path class="flight h{number}" d="{_line(view.places(paths.points_world[own]))}"/>')
    parts.extend(_contacts(view, ball, flights))
    parts.extend(_landings(view, ball, flights))
    return f'<svg viewBox="{box}" role="img" aria-label="rally {view.name}">{"".join(parts)}</svg>'


def _court(view: View, court: Court | None) -> str:
    if court is None:
        return ""
    lines = "".join(_line(view.places(ends)) for ends in court.lines_world)
    net = court.net_world
    drawn = f'<path class="court" d="{lines}"/>'
    if len(net):
        if view.axes[1] == 2:
            # Edge on, the net is as high as in its middle.
            middle = net[np.abs(net[:, 0]).argmin()]
            net = np.stack([middle * [1, 1, 0], middle])
        drawn += f'<path class="net" d="{_line(view.places(net))}"/>'
    return drawn


def _band(view: View, paths: FlightPaths, own: slice) -> str:
    """One-sigma ellipses of each frame's place."""
    places, cov = view.places(paths.points_world[own])[::SAMPLES], view.cov(paths.cov[own])[::SAMPLES]
    known = np.isfinite(places).all(axis=1) & np.isfinite(cov).all(axis=(1, 2))
    values, axes = np.linalg.eigh(cov[known])
    half = np.sqrt(np.maximum(values, 0.0))
    turn = np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1]))
    return "".join(
        f'<ellipse class="band" rx="{long:.1f}" ry="{short:.1f}"'
        f' transform="translate({x:.0f} {y:.0f}) rotate({angle:.0f})"/>'
        for (x, y), (short, long), angle in zip(places[known], half, turn, strict=True)
        if long >= FAINTEST_CM
    )


def _line(places: Float[np.ndarray, "points 2"]) -> str:
    """An SVG path through the places, broken where one is NaN."""
    d, drawing = [], False
    for x, y in places:
        if np.isfinite(x) and np.isfinite(y):
            d.append(f"{'L' if drawing else 'M'}{x:.0f} {y:.0f}")
        drawing = bool(np.isfinite(x) and np.isfinite(y))
    return "".join(d)


def _contacts(view: View, ball: ClipBall, flights: Int[np.ndarray, " flights"]) -> list[str]:
    events = ball.events
    ends = np.unique([ball.shots.start_event[flights], ball.shots.end_event[flights]])
    return [
        f'<circle class="{TITLES[str(events.kind[i])]}" cx="{x:.0f}" cy="{y:.0f}" r="14">'
        f"<title>{escape(str(events.kind[i]))} {escape(str(events.player[i]))} at {events.time[i]:.2f} s, "
        f"probability {events.probability[i]:.2f}</title></circle>"
        for i in ends
        for x, y in view.places(events.position[[i]])
        if str(events.kind[i]) in TITLES and np.isfinite(x) and np.isfinite(y)
    ]


def _landings(view: View, ball: ClipBall, flights: Int[np.ndarray, " flights"]) -> list[str]:
    """Where shots land, coloured by whether that is in, and with its probability beside it from above."""
    marks = []
    for flight in flights.tolist():
        p = float(ball.shots.in_probability[flight])
        ((x, y),) = view.places(ball.shots.landing_position[[flight]])
        if not (np.isfinite(x) and np.isfinite(y) and np.isfinite(p)):
            continue
        word = "in" if p > 0.9 else "out" if p < 0.1 else "perhaps"
        title = f"<title>flight {flight}: in with probability {p:.2f}</title>"
        marks.append(f'<circle class="{word}" cx="{x:.0f}" cy="{y:.0f}" r="18">{title}</circle>')
        if view.axes[1] == 0:
            marks.append(f'<text x="{x + 24:.0f}" y="{y + 12:.0f}">{p:.2f}</text>')
    return marks
