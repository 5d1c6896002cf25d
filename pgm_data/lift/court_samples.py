"""Where a camera expects the painted lines: sample points with their normals and painted widths in pixels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.court import Court
from pgm_data.lift.court_camera import CourtCamera, project

STRAP_WIDTH_M = 0.06
"""Width of the net's posts and of its centre strap, metres."""
SUPPORT = 161
"""Points per line at which the image of a line is first looked at, before samples are spread evenly in pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LineSamples:
    """Points on line centres that the camera should see."""

    line: Int[np.ndarray, " samples"]
    """Index of the court line."""
    points_world: Float[np.ndarray, "samples 3"]
    """On the line's centre, metres."""
    pixels: Float[np.ndarray, "samples 2"]
    """Where the camera puts them."""
    normals: Float[np.ndarray, "samples 2"]
    """Unit normals of the line's image."""
    widths_px: Float[np.ndarray, " samples"]
    """Painted width along the normal, pixels."""
    along: Float[np.ndarray, " samples"]
    """Place on the line, -1 at its first end and 1 at its last."""


def sample_lines(
    camera: CourtCamera, court: Court, *, size: tuple[int, int], spacing_px: float, most: int
) -> LineSamples:
    """Samples spread evenly in pixels over the visible parts of all lines, clear of the net's tape.

    Args:
        camera: One camera.
        court: The court.
        size: Picture width and height, pixels.
        spacing_px: Wanted distance between samples along a line.
        most: Upper bound on the number of samples; the spacing grows to keep it.
    """
    ends = court.lines_world
    share = np.linspace(0.004, 0.996, SUPPORT)
    world = ends[:, None, 0] + share[None, :, None] * (ends[:, None, 1] - ends[:, None, 0])
    across = np.cross(ends[:, 1] - ends[:, 0], [0.0, 0.0, 1.0])
    across = across / np.linalg.norm(across, axis=1, keepdims=True) * court.line_width[:, None] / 2
    lines, count = world.shape[:2]
    trio = project(camera, np.concatenate([world, world + across[:, None], world - across[:, None]]).reshape(-1, 3))
    pixels, plus, minus = trio.reshape(3, lines, count, 2)
    tangents = np.gradient(pixels, axis=1)
    length = np.linalg.norm(tangents, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        tangents = tangents / length[..., None]
    normals = np.stack([-tangents[..., 1], tangents[..., 0]], axis=-1)
    widths = np.abs(np.sum((plus - minus) * normals, axis=-1))
    margin = 2.0
    inside = (
        np.isfinite(pixels).all(axis=-1)
        & (pixels >= margin).all(axis=-1)
        & (pixels <= np.array(size) - 1 - margin).all(axis=-1)
        & (widths < 0.05 * size[0])  # Not so for NaN, nor for a point almost in the camera's own plane.
    )
    length = np.where(inside, length, 0.0)
    total = length.sum()
    spacing = max(spacing_px, total / max(most, 1))
    # Walk along each line's visible length and take a sample each time another spacing is full.
    filled = np.floor(np.cumsum(length, axis=1) / spacing + 0.5)
    chosen = inside & (np.diff(filled, axis=1, prepend=0) > 0)
    line, place = np.nonzero(chosen)
    clear = ~_beside_another_line(pixels, widths, line, place) & ~_on_net_tape(camera, court, pixels[line, place])
    line, place = line[clear], place[clear]
    return LineSamples(
        line=line,
        points_world=world[line, place],
        pixels=pixels[line, place],
        normals=normals[line, place],
        widths_px=widths[line, place],
        along=2 * share[place] - 1,
    )


def moved_samples(camera: CourtCamera, court: Court, samples: LineSamples, *, size: tuple[int, int]) -> LineSamples:
    """The same court points as seen by another camera; those that left the picture are dropped."""
    ends = court.lines_world[samples.line]
    direction = ends[:, 1] - ends[:, 0]
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    half = court.line_width[samples.line, None] / 2
    across = np.cross(direction, [0.0, 0.0, 1.0]) * half
    points = samples.points_world
    stacked = np.concatenate([points, points + 0.05 * direction, points + across])
    pixels, further, edge = project(camera, stacked).reshape(3, -1, 2)
    tangents = further - pixels
    with np.errstate(invalid="ignore", divide="ignore"):
        tangents = tangents / np.linalg.norm(tangents, axis=-1, keepdims=True)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=-1)
    widths = 2 * np.abs(np.sum((edge - pixels) * normals, axis=-1))
    inside = (pixels >= 2.0).all(axis=-1) & (pixels <= np.array(size) - 3.0).all(axis=-1) & (widths < 0.05 * size[0])
    return LineSamples(
        line=samples.line[inside],
        points_world=points[inside],
        pixels=pixels[inside],
        normals=normals[inside],
        widths_px=widths[inside],
        along=samples.along[inside],
    )


def _beside_another_line(
    pixels: np.ndarray, widths: np.ndarray, line: np.ndarray, place: np.ndarray, clear_px: float = 4.0
) -> np.ndarray:
    """Which samples lie so near another line that its paint enters their profiles.

    Args:
        pixels: Points of every line, (lines, points, 2).
        widths: Painted widths there, pixels, (lines, points).
        line: Line of each sample.
        place: Point of each sample on its line.
        clear_px: Room kept beyond half the other line's width, for blur and for averaging along the line.
    """
    coarse = slice(None, None, 8)
    a, b = pixels[:, coarse][:, :-1].reshape(-1, 2), pixels[:, coarse][:, 1:].reshape(-1, 2)
    owner = np.repeat(np.arange(len(pixels)), len(a) // len(pixels))
    reach = np.nan_to_num(widths[:, coarse][:, :-1].reshape(-1) / 2) + clear_px
    near = _distance(pixels[line, place], a, b, 0.05) < reach
    return (near & (owner != line[:, None])).any(axis=1)


def _distance(points: np.ndarray, a: np.ndarray, b: np.ndarray, overhang: float = 0.0) -> np.ndarray:
    """Distances (points, segments) of points from segments a-b; infinite where a segment has no image."""
    along = b - a
    norm2 = np.maximum((along**2).sum(-1), 1e-12)
    dx, dy = points[:, None, 0] - a[:, 0], points[:, None, 1] - a[:, 1]
    t = np.clip((dx * along[:, 0] + dy * along[:, 1]) / norm2, -overhang, 1 + overhang)
    return np.nan_to_num(np.hypot(dx - t * along[:, 0], dy - t * along[:, 1]), nan=np.inf)


def _on_net_tape(camera: CourtCamera, court: Court, pixels: np.ndarray) -> np.ndarray:
    """Which pixels lie on or beside the net's white band, its posts or its strap, which could pass for lines."""
    top = court.net_world
    if len(top) < 2:
        return np.zeros(pixels.shape[:-1], bool)
    share = np.linspace(0, 1, 6)
    middle = top - [0, 0, court.tape_width / 2]
    band = np.concatenate([a + share[:, None] * (b - a) for a, b in zip(middle[:-1], middle[1:], strict=True)])
    half = np.array([0, 0, court.tape_width / 2])
    foot = top * [1, 1, 0]
    seen = project(camera, np.concatenate([band, band + half, top, foot, foot + [STRAP_WIDTH_M / 2, 0, 0]]))
    centre, upper = seen[: len(band)], seen[len(band) : 2 * len(band)]
    head, base, side = seen[2 * len(band) :].reshape(3, -1, 2)
    reach = np.nanmax(np.linalg.norm(upper - centre, axis=1), initial=0.0) + 3.0
    strap = np.nan_to_num(np.linalg.norm(side - base, axis=1)) + 3.0
    tape = (_distance(pixels, centre[:-1], centre[1:]) < reach).any(axis=1)
    # Posts and the strap that holds the net's centre down stand in front of lines as well.
    return tape | (_distance(pixels, base, head) < strap).any(axis=1)
