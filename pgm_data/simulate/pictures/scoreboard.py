"""The graphics of one broadcast: a scoreboard that shows the true score, and the station's mark."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.simulate.pictures.textures import FONTS, random_word

Box = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
class Overlay:
    """Graphics over the picture."""

    paint: UInt8[np.ndarray, "height width 3"]
    opacity: Float[np.ndarray, "height width 1"]
    boxes: tuple[Box, ...]
    """x0, y0, x1, y1 of each, pixels: the outer edges of the pixels they may touch."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BoardStyle:
    """How one station draws."""

    names: tuple[str, str]
    corner: tuple[float, float]
    """Upper left corner as shares of width and height."""
    row: float
    """Height of a row over the picture's height."""
    back: tuple[float, float, float]
    ink: tuple[float, float, float]
    accent: tuple[float, float, float]
    opacity: float
    font: int
    mark: str
    mark_corner: tuple[float, float]
    mark_opacity: float
    board: bool
    """Whether there is a scoreboard at all."""


@dataclass(frozen=True, kw_only=True)
class BoardLines:
    """What a scoreboard says."""

    sets: tuple[tuple[int, int], ...]
    points: tuple[str, str]
    serving: int
    """0 or 1: whose name has the mark."""


def draw_board_style(rng: np.random.Generator) -> BoardStyle:
    """A station's style by lot."""
    dark = rng.random() < 0.7
    back = rng.uniform(5, 90, 3) if dark else rng.uniform(200, 250, 3)
    low = rng.random() < 0.65
    return BoardStyle(
        names=(random_word(rng, 4, 9), random_word(rng, 4, 9)),
        corner=(float(rng.uniform(0.03, 0.06)), float(rng.uniform(0.83, 0.88) if low else rng.uniform(0.04, 0.07))),
        row=float(rng.uniform(0.032, 0.042)),
        back=_colour(back),
        ink=(240.0, 240.0, 240.0) if dark else (20.0, 20.0, 20.0),
        accent=_colour(rng.uniform(30, 255, 3)),
        opacity=float(rng.uniform(0.8, 1.0)),
        font=int(FONTS[int(rng.integers(2))]),
        mark=random_word(rng, 2, 6),
        mark_corner=(float(rng.uniform(0.84, 0.9)), float(rng.uniform(0.05, 0.08))),
        mark_opacity=float(rng.uniform(0.0, 0.9)) if rng.random() < 0.8 else 0.0,
        board=bool(rng.random() < 0.9),
    )


def _colour(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])


def draw_overlay_of(style: BoardStyle, lines: BoardLines, size: tuple[int, int]) -> Overlay:
    """The graphics of a play for pictures of this size (width, height)."""
    width, height = size
    paint = np.zeros((height, width, 3), np.uint8)
    opacity = np.zeros((height, width), np.float32)
    boxes: list[Box] = []
    if style.board:
        boxes.append(_board(paint, opacity, style, lines))
    if style.mark_opacity > 0.05:
        boxes.append(_mark(paint, opacity, style))
    return Overlay(paint=paint, opacity=opacity[..., None], boxes=tuple(b for b in boxes if b[2] > b[0]))


def _board(paint: np.ndarray, opacity: np.ndarray, style: BoardStyle, lines: BoardLines) -> Box:
    height, width = opacity.shape
    row = max(6, round(style.row * height))
    scale = row / 34.0
    thick = max(1, round(row / 22))
    x0, y0 = round(style.corner[0] * width), round(style.corner[1] * height)
    name = max(cv2.getTextSize(n, style.font, scale, thick)[0][0] for n in style.names) + row
    cell, last = round(0.85 * row), round(1.35 * row)
    x1, y1 = min(width, x0 + name + cell * len(lines.sets) + last), min(height, y0 + 2 * row)
    paint[y0:y1, x0:x1] = style.back
    opacity[y0:y1, x0:x1] = style.opacity
    paint[y0:y1, max(x0, x1 - last) : x1] = style.accent
    bright = sum(style.accent) > 380
    for player in (0, 1):
        base = y0 + player * row + round(0.74 * row)

        def write(word: str, x: int, ink, base: int = base) -> None:
            cv2.putText(paint, word, (x, base), style.font, scale, ink, thick, cv2.LINE_AA)

        write(style.names[player], x0 + round(0.6 * row), style.ink)
        if player == lines.serving:
            middle = (x0 + round(0.3 * row), y0 + player * row + row // 2)
            cv2.circle(paint, middle, max(1, row // 7), style.accent, -1, cv2.LINE_AA)
        for i, games in enumerate(lines.sets):
            write(str(games[player]), x0 + name + i * cell, style.ink)
        write(lines.points[player], x1 - last + round(0.2 * row), (15.0,) * 3 if bright else (245.0,) * 3)
    # Letters of tiny pictures may reach over the board's edge; there they stay invisible.
    return float(x0), float(y0), float(x1), float(y1)


def _mark(paint: np.ndarray, opacity: np.ndarray, style: BoardStyle) -> Box:
    height, width = opacity.shape
    scale, thick = 0.0016 * height, max(1, round(height / 300))
    wide, tall = cv2.getTextSize(style.mark, style.font, scale, thick)[0]
    x, y = round(style.mark_corner[0] * width), round(style.mark_corner[1] * height) + tall
    x = min(x, width - wide - 4)
    letters = np.zeros((height, width), np.uint8)
    cv2.putText(letters, style.mark, (x, y), style.font, scale, 255, thick, cv2.LINE_AA)
    where = letters > 0
    paint[where] = 245
    opacity[where] = np.maximum(opacity[where], style.mark_opacity * letters[where] / np.float32(255.0))
    rows, columns = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
    if not len(rows):
        return 0.0, 0.0, 0.0, 0.0
    return float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1)
