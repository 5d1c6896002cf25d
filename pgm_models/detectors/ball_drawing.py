"""Balls and what may be taken for one, drawn into three pictures that follow each other."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

FINE = 3
"""Samples of a pixel along each side."""
COLOURS = np.array([[70, 225, 205], [110, 240, 225], [60, 235, 245], [225, 240, 240], [120, 255, 190], [80, 190, 180]])
"""Of tennis balls in all kinds of light and video, BGR."""


def smear(
    centre: Float[np.ndarray, " 2"], streak: Float[np.ndarray, " 2"], radius: float, size: tuple[int, int]
) -> Float[np.ndarray, "height width"]:
    """The share of the exposure in which a disc that moves through `centre` by `streak` covers each pixel.

    `size` is (height, width); only pixels near the disc's way are worked on.
    """
    cover = np.zeros(size)
    window = way_window(centre, streak, radius, size)
    cover[window] = smear_in(window, centre, streak, radius)
    return cover


def way_window(centre: np.ndarray, streak: np.ndarray, radius: float, size: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns that a disc moving through `centre` by `streak` may cover, with room around; maybe none."""
    room = 0.5 * np.abs(streak) + radius + 3
    (x0, y0), (x1, y1) = np.floor(centre - room).astype(int), np.ceil(centre + room).astype(int) + 1
    height, width = size
    rows = slice(min(max(y0, 0), height), max(min(y1, height), 0))
    return rows, slice(min(max(x0, 0), width), max(min(x1, width), 0))


def smear_in(window: tuple[slice, slice], centre: np.ndarray, streak: np.ndarray, radius: float) -> np.ndarray:
    """`smear` in those rows and columns."""
    rows, columns = np.arange(window[0].start, window[0].stop), np.arange(window[1].start, window[1].stop)
    inside = (np.arange(FINE) + 0.5) / FINE - 0.5
    x = (columns[:, None] + inside).ravel() - centre[0]
    y = (rows[:, None] + inside).ravel()[:, None] - centre[1]
    length = float(np.hypot(*streak))
    along = streak / length if length > 1e-6 else np.array([1.0, 0.0])
    u, v = x * along[0] + y * along[1], y * along[0] - x * along[1]
    half = np.sqrt(np.maximum(radius * radius - v * v, 0.0))
    if length > 1e-3:
        share = np.minimum(u + half, 0.5 * length) - np.maximum(u - half, -0.5 * length)
        share = np.clip(share, 0.0, None) / length * (half > 0)
    else:
        share = ((np.abs(u) <= half) & (half > 0)).astype(float)
    return share.reshape(len(rows), FINE, len(columns), FINE).mean(axis=(1, 3))


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnBall:
    """A ball that was drawn into three frames: what is known of it in the middle one."""

    pixel: Float[np.ndarray, " 2"]
    streak: Float[np.ndarray, " 2"]
    seen: bool
    """Whether it stands out enough to be asked for."""


def draw_ball(
    frames: list[UInt8[np.ndarray, "height width 3"]], rng: np.random.Generator, *, least_trace: float
) -> DrawnBall:
    """Draw one ball in flight into the three frames, in place."""
    height, width = frames[1].shape[:2]
    centre = rng.uniform([6, 6], [width - 6, height - 6])
    radius = float(np.exp(rng.uniform(np.log(0.9), np.log(4.5))))
    angle = rng.uniform(0, 2 * np.pi)
    step = np.exp(rng.uniform(np.log(0.7), np.log(30.0))) * max(radius, 1.0) ** 0.5
    velocity = step * np.array([np.cos(angle), np.sin(angle)])
    turned = velocity
    if rng.random() < 0.12:  # at a bounce or a hit it comes in another way
        away = rng.uniform(0, 2 * np.pi)
        turned = step * rng.uniform(0.5, 1.5) * np.array([np.cos(away), np.sin(away)])
    open_share = rng.uniform(0.02, 0.7)
    bend = rng.normal(0, 0.3 + 0.03 * step, 2)
    colour = COLOURS[rng.integers(len(COLOURS))] * rng.uniform(0.55, 1.15) + rng.normal(0, 12, 3)
    if rng.random() < 0.5:  # codecs keep little of a small thing's colour
        colour = colour + rng.uniform(0.3, 1.0) * (colour.mean() - colour)
    soft = rng.uniform(0.0, 1.2)
    ghost = rng.uniform(0.25, 0.5) if rng.random() < 0.2 else 0.0  # a rate conversion blends two pictures
    places = (centre - turned + bend, centre, centre + velocity + bend)
    if rng.random() < 0.5:
        places = places[::-1]
    opacity = rng.uniform(0.75, 1.0) if rng.random() < 0.5 else rng.uniform(0.3, 0.8)
    contrast = 0.0
    for k, (frame, place, way) in enumerate(zip(frames, places, (turned, velocity, velocity), strict=True)):
        if k != 1 and rng.random() < 0.06:
            continue  # hidden behind something there
        disc = _Disc(centre=place, streak=open_share * way, radius=radius, opacity=opacity, soft=soft)
        found = _lay(frame, disc, colour)
        if ghost:
            _lay(frame, replace(disc, centre=place + way, opacity=ghost * opacity), colour)
        contrast = found if k == 1 else contrast
    return DrawnBall(pixel=centre, streak=open_share * velocity, seen=contrast >= least_trace)


def draw_distractor(
    frames: list[UInt8[np.ndarray, "height width 3"]], shifts: Float[np.ndarray, "3 2"], rng: np.random.Generator
) -> None:
    """Draw something that is no ball in flight, in place; `shifts` is where the standing world is in each frame."""
    kind = rng.random()
    if kind < 0.35:
        _standing_ball(frames, shifts, rng)
    elif kind < 0.75:
        _moving_piece(frames, rng)
    elif kind < 0.9:
        _shadow(frames, rng)
    else:
        _thin_line(frames, shifts, rng)


def _standing_ball(frames: list, shifts: np.ndarray, rng: np.random.Generator) -> None:
    height, width = frames[1].shape[:2]
    centre = rng.uniform([0, 0], [width, height])
    radius = float(np.exp(rng.uniform(np.log(0.9), np.log(6.0))))
    colour = COLOURS[rng.integers(len(COLOURS))] * rng.uniform(0.5, 1.15) + rng.normal(0, 25, 3)
    soft = rng.uniform(0.0, 0.9)
    way = rng.normal(0, 3, 2) if rng.random() < 0.2 else np.zeros(2)  # a small mark may be long
    for frame, shift in zip(frames, shifts, strict=True):
        _lay(frame, _Disc(centre=centre + shift, streak=way, radius=radius, soft=soft), colour)


def _moving_piece(frames: list, rng: np.random.Generator) -> None:
    """A piece of the picture itself, larger than a ball, that travels: a shoe, a hand, a bird."""
    height, width = frames[1].shape[:2]
    size = np.exp(rng.uniform(np.log(8.0), np.log(50.0))) * np.exp(rng.normal(0, 0.35, 2))
    wide, high = np.clip(size, 6, np.minimum(90, [width - 1, height - 1])).astype(int)
    x, y = int(rng.integers(0, width - wide)), int(rng.integers(0, height - high))
    piece = frames[1][y : y + high, x : x + wide].astype(np.float32)
    if rng.random() < 0.6:
        piece = np.clip(piece * rng.uniform(0.4, 1.3) + rng.uniform(-60, 90, 3), 0, 255).astype(np.float32)
    mask = np.zeros((high, wide), np.float32)
    axes = (max(wide // 2 - 1, 1), max(high // 2 - 1, 1))
    cv2.ellipse(mask, (wide // 2, high // 2), axes, 0.0, 0, 360, 1.0, -1, cv2.LINE_AA)
    centre = rng.uniform([0, 0], [width - wide, height - high])
    velocity = rng.normal(0, 1, 2) * np.exp(rng.uniform(np.log(0.4), np.log(14.0)))
    for k, frame in enumerate(frames):
        corner = centre + (k - 1) * velocity
        u, v = np.floor(corner).astype(int)
        move = np.array([[1.0, 0, corner[0] - u], [0, 1.0, corner[1] - v]])
        alpha = cv2.warpAffine(mask, move, (int(wide) + 1, int(high) + 1))[..., None]
        laid = cv2.warpAffine(piece, move, (int(wide) + 1, int(high) + 1), borderMode=cv2.BORDER_REPLICATE)
        left, top = max(u, 0), max(v, 0)
        under = frame[top : v + high + 1, left : u + wide + 1] if u + wide >= 0 and v + high >= 0 else frame[:0]
        if not under.size:
            continue
        part = (slice(top - v, top - v + under.shape[0]), slice(left - u, left - u + under.shape[1]))
        under[...] = np.clip(under * (1 - alpha[part]) + laid[part] * alpha[part] + 0.5, 0, 255).astype(np.uint8)


def _shadow(frames: list, rng: np.random.Generator) -> None:
    """A small dark blot that travels: a ball's shadow, a bird."""
    height, width = frames[1].shape[:2]
    centre = rng.uniform([0, 0], [width, height])
    radius = float(np.exp(rng.uniform(np.log(1.0), np.log(7.0))))
    velocity = rng.normal(0, 1, 2) * np.exp(rng.uniform(np.log(1.0), np.log(25.0)))
    long = rng.normal(0, 2, 2) + velocity * rng.uniform(0, 0.5)
    depth = rng.uniform(0.2, 0.7)
    for k, frame in enumerate(frames):
        place = centre + (k - 1) * velocity
        _lay(frame, _Disc(centre=place, streak=long, radius=radius, opacity=depth, soft=0.3), np.zeros(3))


def _thin_line(frames: list, shifts: np.ndarray, rng: np.random.Generator) -> None:
    """A bit of line that stands or sways: paint, a racket's rim, a cord."""
    height, width = frames[1].shape[:2]
    centre = rng.uniform([0, 0], [width, height])
    radius = float(np.exp(rng.uniform(np.log(0.4), np.log(2.0))))
    angle = rng.uniform(0, np.pi)
    length = rng.uniform(6, 60)
    sway = rng.normal(0, 1.5, 2) if rng.random() < 0.4 else np.zeros(2)
    swing = rng.normal(0, 0.15) if rng.random() < 0.3 else 0.0
    colour = rng.uniform(150, 255) + rng.normal(0, 15, 3)
    for k, frame in enumerate(frames):
        turned = angle + (k - 1) * swing
        way = length * np.array([np.cos(turned), np.sin(turned)])
        # A long disc's cover is thin: that of paint is full.
        thick = min(1.0, 2 * radius) * max(length / (2 * radius), 1.0)
        place = centre + shifts[k] + (k - 1) * sway
        _lay(frame, _Disc(centre=place, streak=way, radius=radius, opacity=thick, soft=0.4), colour)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Disc:
    """A disc that moves while the shutter is open."""

    centre: np.ndarray
    streak: np.ndarray
    radius: float
    opacity: float = 1.0
    soft: float = 0.0
    """Blur, pixels."""


def _lay(frame: np.ndarray, disc: _Disc, colour: np.ndarray) -> float:
    """Lay a disc of that colour over the frame, in place; grey values by which it stands out."""
    window = way_window(disc.centre, disc.streak, disc.radius, frame.shape[:2])
    under = frame[window]
    if not under.size:
        return 0.0
    cover = smear_in(window, disc.centre, disc.streak, disc.radius)
    alpha = np.minimum(disc.opacity * cover, 1.0).astype(np.float32)
    if disc.soft > 0.2:
        alpha = cv2.GaussianBlur(alpha, (0, 0), disc.soft)
    alpha = alpha[..., None]
    after = np.clip(under * (1 - alpha) + np.clip(colour, 0, 255).astype(np.float32) * alpha + 0.5, 0, 255)
    change = (alpha * (after - under)).sum(axis=(0, 1)) / max(float(alpha.sum()), 1e-6)
    frame[window] = after.astype(np.uint8)
    return float(np.abs(change).max())
