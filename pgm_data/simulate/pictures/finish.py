"""What camera, graphics desk and codec do to a picture: blur, sharpening, noise, colour, overlays, borders, JPEG."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.simulate.pictures.exposed import exposed
from pgm_data.simulate.pictures.textures import FONTS, random_word


@dataclass(frozen=True, eq=False, kw_only=True)
class Finish:
    """The flaws of one recording."""

    table: UInt8[np.ndarray, "1 256 3"]
    """Output value of every input value, by channel: gamma, contrast, brightness, colour cast."""
    grey: float
    """Share of colour taken away, 0 to 1."""
    blur_px: float
    """Standard deviation of the blur, pixels; 0 for none."""
    smear_px: int
    """Length of a sideways motion blur, odd, pixels; 0 for none."""
    shrink: float
    """The picture is shrunk by this and enlarged again; 1 for none."""
    sharpen: float
    """Strength of the edge enhancement that many broadcasts show."""
    noise: float
    """Standard deviation, grey values."""
    noise_kind: int
    """Which of the noise fields."""
    vignette: float
    """Darkening of the corners, 0 to 1."""
    jpeg: int
    """JPEG quality; 0 for none."""
    bars: tuple[int, int]
    """Height of black bars above and below, width of those at the sides, pixels."""
    overlay: tuple[UInt8[np.ndarray, "height width 3"], Float[np.ndarray, "height width 1"]] | None
    """Graphics on top and their opacity."""


def draw_finish(rng: np.random.Generator, width: int, height: int, *, hard: bool) -> Finish:
    """Flaws by lot; `hard` ones go beyond what a good broadcast shows."""
    unit = width / 640.0
    values = np.arange(256) / 255.0
    gamma = np.exp(rng.normal(0, 0.3 if hard else 0.12))
    contrast = rng.uniform(0.6, 1.25) if hard else rng.uniform(0.85, 1.1)
    lift = rng.uniform(-0.08, 0.15) if hard else rng.uniform(-0.02, 0.05)
    cast = 1.0 + rng.normal(0, 0.08 if hard else 0.03, 3)
    if hard and rng.random() < 0.06:  # night
        contrast, lift = 0.4 * contrast, 0.5 * lift
    curve = (values**gamma)[:, None] * contrast * cast + lift
    kind = rng.random()
    blur = abs(rng.normal(0, 0.45)) * unit if kind < 0.7 else (rng.uniform(0.5, 1.5) * unit if hard else 0.0)
    if not hard:  # no broadcaster sends a picture out of focus
        blur = min(blur, 0.42 * unit)
    finish = Finish(
        table=np.clip(255.0 * curve[None], 0, 255).astype(np.uint8),
        grey=float(rng.uniform(0, 1) ** 2) if rng.random() < (0.3 if hard else 0.1) else 0.0,
        blur_px=float(blur if blur > 0.25 else 0.0),
        smear_px=2 * int(rng.integers(1, 4)) + 1 if hard and rng.random() < 0.06 else 0,
        shrink=float(rng.uniform(1.2, 2.2)) if hard and rng.random() < 0.12 else 1.0,
        sharpen=float(rng.uniform(0.2, 1.3)) if rng.random() < 0.4 else 0.0,
        noise=float(1.0 + (11.0 if hard else 3.0) * rng.random() ** 2.5) if rng.random() < 0.45 else 0.0,
        noise_kind=int(rng.integers(0, 3)),
        vignette=float(rng.uniform(0.1, 0.6)) if rng.random() < 0.12 else 0.0,
        jpeg=int(rng.integers(25, 90)) if hard and rng.random() < 0.35 else 0,
        bars=(0, 0),
        overlay=draw_overlay(rng, width, height, hard=hard) if rng.random() < 0.75 else None,
    )
    if hard and rng.random() < 0.06:
        tall = rng.random() < 0.5
        bars = (int(height * rng.uniform(0.03, 0.13)), 0) if tall else (0, int(width * rng.uniform(0.03, 0.14)))
        finish = replace(finish, bars=bars)
    return finish


def draw_overlay(rng: np.random.Generator, width: int, height: int, *, hard: bool) -> tuple[np.ndarray, np.ndarray]:
    """Scoreboard, channel mark, clocks and captions, and where they are opaque."""
    paint = np.zeros((height, width, 3), np.uint8)
    mask = np.zeros((height, width), np.uint8)
    unit = width / 640.0

    def colour() -> list[float]:
        return (rng.uniform(0, 255, 3) if rng.random() < 0.5 else np.full(3, rng.choice([8.0, 30.0, 240.0]))).tolist()

    def write(word: str, x: float, y: float, scale: float, ink: list[float], thick: int = 1, opaque: int = 255) -> None:
        font = int(rng.choice(FONTS[:4]))
        for target, value in ((paint, ink), (mask, opaque)):
            at, wide = (int(x), int(y)), max(1, int(thick * unit))
            cv2.putText(target, word, at, font, scale * unit, value, wide, cv2.LINE_AA)

    def board(x: float, y: float) -> None:
        rows, tall, wide = int(rng.integers(1, 3)), rng.uniform(10, 18) * unit, rng.uniform(70, 150) * unit
        back = colour()
        ink = [245.0] * 3 if np.mean(back) < 128 else [15.0] * 3
        for target, value in ((paint, back), (mask, 255)):
            cv2.rectangle(target, (int(x), int(y)), (int(x + wide), int(y + rows * tall)), value, -1)
        if rng.random() < 0.7:
            at = x + wide * rng.uniform(0.6, 0.8)
            cv2.rectangle(paint, (int(at), int(y)), (int(at + 0.12 * wide), int(y + rows * tall)), colour(), -1)
        for row in range(rows):
            low = y + (row + 0.75) * tall
            write(random_word(rng, 4, 9), x + 4 * unit, low, tall / unit / 34, ink)
            write(str(int(rng.integers(0, 70))), x + 0.85 * wide, low, tall / unit / 34, ink)

    if rng.random() < 0.8:
        y = height * (rng.uniform(0.8, 0.9) if rng.random() < 0.7 else rng.uniform(0.03, 0.08))
        board(width * rng.uniform(0.02, 0.3), y)
    if rng.random() < 0.7:
        x = width * (rng.uniform(0.02, 0.06) if rng.random() < 0.5 else rng.uniform(0.75, 0.85))
        faded = int(rng.uniform(110, 255))
        write(random_word(rng, 3, 8), x, height * rng.uniform(0.06, 0.1), rng.uniform(0.4, 0.7), [250.0] * 3, 2, faded)
    for _ in range(int(rng.integers(0, 4)) if hard and rng.random() < 0.3 else 0):
        board(width * rng.uniform(0, 0.8), height * rng.uniform(0, 0.9))
    return paint, (mask.astype(np.float32) / 255.0)[..., None]


def finished(
    picture: Float[np.ndarray, "height width 3"],
    finish: Finish,
    grain: Float[np.ndarray, "tall wide 3"],
    shift: tuple[int, int],
) -> UInt8[np.ndarray, "height width 3"]:
    """The picture with its flaws; `grain` is larger than the picture by 64 and read from `shift` (down, right)."""
    height, width = picture.shape[:2]
    if finish.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), finish.blur_px)
    if finish.smear_px > 0:
        picture = cv2.blur(picture, (finish.smear_px, 1))
    if finish.shrink > 1.0:
        less = (int(width / finish.shrink), int(height / finish.shrink))
        small = cv2.resize(picture, less, interpolation=cv2.INTER_AREA)
        picture = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    picture = np.ascontiguousarray(picture, dtype=np.float32)
    image = np.empty((height, width, 3), np.uint8)
    exposed(picture, grain, shift[0], shift[1], finish.noise, finish.vignette, finish.table[0], image)
    if finish.sharpen > 0:
        image = cv2.addWeighted(image, 1.0 + finish.sharpen, cv2.GaussianBlur(image, (0, 0), 1.0), -finish.sharpen, 0.0)
    if finish.grey > 0:
        grey = cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
        image = cv2.addWeighted(image, 1.0 - finish.grey, grey, finish.grey, 0.0)
    if finish.overlay is not None:
        for part in _patches(finish.overlay[1]):
            paint, opacity = finish.overlay[0][part], finish.overlay[1][part]
            image[part] = (image[part] * (1.0 - opacity) + paint * opacity).astype(np.uint8)
    down, across = finish.bars
    if down:
        image[:down], image[-down:] = 0, 0
    if across:
        image[:, :across], image[:, -across:] = 0, 0
    return _compressed(image, finish.jpeg) if finish.jpeg else image


def _compressed(image: np.ndarray, quality: int) -> np.ndarray:
    """The picture after a JPEG file of this quality."""
    decoded = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    if decoded is None:
        raise RuntimeError("JPEG: expected OpenCV to read the picture that it wrote")
    return decoded


def _patches(opacity: np.ndarray) -> list[tuple[slice, slice]]:
    """Boxes that hold all that is opaque: bands of rows, and in each of them the columns in use."""
    patches = []
    for top, bottom in _runs(np.asarray(opacity.any(axis=(1, 2)))):
        for left, right in _runs(np.asarray(opacity[top:bottom].any(axis=(0, 2)))):
            patches.append(np.s_[top:bottom, left:right])
    return patches


def _runs(used: np.ndarray) -> list[tuple[int, int]]:
    """Start and end of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], used, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
