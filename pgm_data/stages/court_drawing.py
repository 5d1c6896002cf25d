"""A scene's court drawn into a picture through the frame's camera, for people to look at.

The lines drawn are the painted lines' centres, one pixel wide: the paint of a well-placed camera
shows on both sides of them.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.court import Court
from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera, K_with_centre_origin, K_with_corner_origin, project

STEPS_PER_LINE = 48
"""Straight pieces a line is drawn in; a lens bends a piece by far less than a pixel."""
SUBPIXEL_BITS = 4
"""Binary places of a pixel that are kept when drawing."""
FARTHEST_PX = 1e9
DASH = 2
"""Pieces per dash, and per gap, of interpolated lines."""

BGR = tuple[int, int, int]
LINE_COLOURS: dict[str, BGR] = {"measured": (90, 255, 60), "interpolated": (0, 170, 255)}
NET_COLOUR: BGR = (255, 90, 255)
TEXT_COLOURS: dict[str, BGR] = LINE_COLOURS | {"none": (80, 80, 255)}


@dataclass(frozen=True, eq=False, kw_only=True)
class CourtStrokes:
    """A court as short straight pieces, sampled once and drawn in every frame."""

    points_world: Float[np.ndarray, "points 3"]
    """Samples along the lines, `STEPS_PER_LINE` + 1 in a row for each, metres; the net's after the ground's."""
    net_points: int
    """How many of the last samples belong to the top of the net."""

    def __post_init__(self) -> None:
        """Keep a read-only copy."""
        object.__setattr__(self, "points_world", frozen(self.points_world))


def court_strokes(court: Court) -> CourtStrokes:
    """The court's painted lines and the top of its net, sampled densely."""
    ground = court.lines_world
    net = court.net_world
    tops = np.stack([net[:-1], net[1:]], axis=1) if len(net) > 1 else np.zeros((0, 2, 3))
    ends = np.concatenate([ground, tops])
    share = np.linspace(0.0, 1.0, STEPS_PER_LINE + 1)[:, None]
    samples = ends[:, None, 0] * (1 - share) + ends[:, None, 1] * share
    return CourtStrokes(points_world=samples.reshape(-1, 3), net_points=len(tops) * (STEPS_PER_LINE + 1))


def resized(camera: Camera, scale_xy: Float[np.ndarray, " 2"]) -> Camera:
    """The camera of the picture resized by the given factors, corner on corner, as `cv2.resize` does."""
    scale = np.diag([scale_xy[0], scale_xy[1], 1.0])
    return Camera(
        K=K_with_centre_origin(scale @ K_with_corner_origin(camera.K)),
        distortion=camera.distortion,
        R_cam_from_world=camera.R_cam_from_world,
        t_cam_from_world=camera.t_cam_from_world,
    )


def clipped(
    pieces_px: Float[np.ndarray, "pieces 2 2"], low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, "inside 2 2"]:
    """The parts of the pieces that lie between the two corners; pieces outside are left out.

    So are those with an end that is NaN or beyond `FARTHEST_PX`, which begin in the plane of the camera.

    Source: Liang and Barsky, A new concept and method for line clipping, 1984.
    """
    pieces_px = pieces_px[(np.abs(pieces_px) < FARTHEST_PX).all(axis=(1, 2))]
    start, step = pieces_px[:, 0], pieces_px[:, 1] - pieces_px[:, 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a, b = (low - start) / step, (high - start) / step
    within = (start >= low) & (start <= high)
    still = step == 0
    enter = np.where(still, np.where(within, 0.0, np.inf), np.minimum(a, b)).max(axis=1, initial=0.0)
    leave = np.where(still, np.inf, np.maximum(a, b)).min(axis=1, initial=1.0)
    keep = enter <= leave
    start, step, enter, leave = start[keep], step[keep], enter[keep], leave[keep]
    return np.stack([start + enter[:, None] * step, start + leave[:, None] * step], axis=1)


def draw_court(picture: UInt8[np.ndarray, "h w 3"], strokes: CourtStrokes, camera: Camera, status: str) -> None:
    """Draw the court into the BGR picture as the camera sees it; dashed and in another colour where interpolated.

    A camera of NaN draws nothing. The picture is changed in place.
    """
    pixels, _ = project(camera, strokes.points_world)
    runs = pixels.reshape(-1, STEPS_PER_LINE + 1, 2)
    pieces = np.stack([runs[:, :-1], runs[:, 1:]], axis=2)
    if status == "interpolated":
        pieces = pieces[:, np.arange(STEPS_PER_LINE) // DASH % 2 == 0]
    net_lines = strokes.net_points // (STEPS_PER_LINE + 1)
    ground, net = pieces[: len(pieces) - net_lines], pieces[len(pieces) - net_lines :]
    height, width = picture.shape[:2]
    low, high = np.array([-2.0, -2.0]), np.array([width + 1.0, height + 1.0])
    for part, colour in ((ground, LINE_COLOURS[status]), (net, NET_COLOUR)):
        inside = clipped(part.reshape(-1, 2, 2), low, high)
        fixed_point = np.round(inside * (1 << SUBPIXEL_BITS)).astype(np.int32)
        cv2.polylines(picture, list(fixed_point), False, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)


def draw_label(picture: UInt8[np.ndarray, "h w 3"], lines: tuple[str, ...], status: str) -> None:
    """Write the lines of text on a dark band at the picture's top left, in the colour of the status.

    Characters outside ASCII become question marks: the font has no others. The picture is changed in place.
    """
    height, width = picture.shape[:2]
    size = max(0.4, min(width, 2 * height) / 1600)
    row = round(38 * size)
    band_height = min(height, row * len(lines) + round(16 * size))
    font = cv2.FONT_HERSHEY_SIMPLEX
    texts = [line.encode("ascii", "replace").decode() for line in lines]
    widest = max((cv2.getTextSize(text, font, size, 1)[0][0] for text in texts), default=0)
    band = picture[:band_height, : min(width, widest + round(24 * size))]
    band[:] = band // 3
    for i, text in enumerate(texts):
        place = (round(12 * size), row * (i + 1))
        cv2.putText(picture, text, place, font, size, TEXT_COLOURS[status], 1, cv2.LINE_AA)
