"""Pictures made harder and more varied, with the map their pixels went through."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.detect.court_network import INPUT_SIZE, Letterbox

NOISE = np.random.default_rng(0).standard_normal((512, 1024, 3)).astype(np.float32)
"""A fixed field of noise from which windows are cut: drawing fresh noise would cost more than all the rest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AugmentOptions:
    """How often and how strongly a picture is changed; shares are probabilities."""

    flip: float = 0.5
    """Mirrored left to right."""
    zoom: tuple[float, float] = (0.8, 1.5)
    """Range of enlargement."""
    rotation_deg: float = 2.0
    """Standard deviation of roll."""
    aspect: float = 0.06
    """Standard deviation of the logarithm of the stretch along x."""
    shift: float = 0.08
    """Standard deviation of the shift, as a share of the picture's size."""
    bars: float = 0.08
    """Black bars at the sides or above and below, as round a portrait or wide picture."""
    colour: float = 0.6
    """Colours mixed, brightness, contrast and gamma changed per channel."""
    grey: float = 0.05
    """Grey picture."""
    soften: float = 0.3
    """Lower resolution, Gaussian blur or motion blur."""
    shade: float = 0.15
    """A half plane or band made darker or brighter."""
    occlude: float = 0.2
    """One to five patches or person-like figures laid over."""
    noise: float = 0.2
    """Noise up to a standard deviation of 18 grey values."""
    jpeg: float = 0.2
    """JPEG of quality 12 to 70."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Warp:
    """Where pixels of the source picture went in the network's input."""

    input_from_picture: Float[np.ndarray, "2 3"]
    """Affine map of pixels."""
    mirrored: bool
    """Whether left became right."""
    window: tuple[float, float, float, float]
    """What of the input shows the source picture's plane: x0, y0, x1, y1, pixels; black outside."""

    def points(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Input pixels of picture pixels."""
        return pixels @ self.input_from_picture[:, :2].T + self.input_from_picture[:, 2]


def random_warp(picture_size: tuple[int, int], rng: np.random.Generator, options: AugmentOptions) -> Warp:
    """A random crop, zoom, roll, stretch and mirroring of a picture of that width and height."""
    width, height = picture_size
    box = Letterbox(picture_size=picture_size)
    wide, high = INPUT_SIZE
    zoom = np.exp(rng.uniform(*np.log(options.zoom)))
    stretch = np.exp(rng.normal(0, options.aspect))
    angle = np.radians(rng.normal(0, options.rotation_deg))
    mirrored = bool(rng.random() < options.flip)
    scale = box.scale * zoom * np.array([stretch**0.5, stretch**-0.5])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = turn @ np.diag(scale * np.array([-1.0 if mirrored else 1.0, 1.0]))
    to = np.array([(wide - 1) / 2, (high - 1) / 2]) + rng.normal(0, options.shift, 2) * np.array([wide, high]) * min(
        zoom, 1.2
    )
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    affine = np.concatenate([linear, (to - linear @ centre)[:, None]], axis=1)
    bar_x = bar_y = 0.0
    if rng.random() < options.bars:
        above = rng.random() < 0.35
        share = rng.uniform(0.05, 0.34)
        bar_x, bar_y = (0.0, share * high) if above else (share * wide, 0.0)
    window = (bar_x - 0.5, bar_y - 0.5, wide - bar_x - 0.5, high - bar_y - 0.5)
    return Warp(input_from_picture=affine, mirrored=mirrored, window=window)


def plain_warp(picture_size: tuple[int, int]) -> Warp:
    """The letterbox that the reader applies."""
    box = Letterbox(picture_size=picture_size)
    (left, top), (width, height) = box.corner, box.inner_size
    offset = box.input_from_picture(np.zeros(2))
    return Warp(
        input_from_picture=np.concatenate([np.diag(box.scale), offset[:, None]], axis=1),
        mirrored=False,
        window=(left - 0.5, top - 0.5, left + width - 0.5, top + height - 0.5),
    )


def warp_picture(bgr: UInt8[np.ndarray, "height width 3"], warp: Warp, rng: np.random.Generator) -> np.ndarray:
    """The network's input seen through the warp; what lies outside the source is black or of one colour."""
    size = np.sqrt(abs(np.linalg.det(warp.input_from_picture[:, :2])))
    if size < 0.9:
        bgr = cv2.GaussianBlur(bgr, (0, 0), 0.35 / size)
    fill = (0.0, 0.0, 0.0) if rng.random() < 0.6 else tuple(rng.uniform(0, 255, 3))
    flags = cv2.INTER_LINEAR if rng.random() < 0.7 else cv2.INTER_CUBIC
    warped = cv2.warpAffine(
        bgr, warp.input_from_picture, INPUT_SIZE, flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=fill
    )
    x0, y0, x1, y1 = (round(edge + 0.5) for edge in warp.window)
    if (x0, y0, x1, y1) != (0, 0, *INPUT_SIZE):
        cut = np.zeros_like(warped)
        cut[y0:y1, x0:x1] = warped[y0:y1, x0:x1]
        return cut
    return warped


def random_look(
    bgr: UInt8[np.ndarray, "rows columns 3"], rng: np.random.Generator, options: AugmentOptions
) -> np.ndarray:
    """The picture with other colours, light, sharpness, noise and things in front of it; geometry unchanged."""
    if rng.random() < options.occlude:
        bgr = _occlude(bgr, rng)
    if rng.random() < options.shade:
        bgr = _shade(bgr, rng)
    if rng.random() < options.colour:
        bgr = _colour(bgr, rng)
    if rng.random() < options.grey:
        bgr = cv2.cvtColor(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    if rng.random() < options.soften:
        bgr = _soften(bgr, rng)
    if rng.random() < options.noise:
        bgr = _noise(bgr, rng)
    if rng.random() < options.jpeg:
        bgr = _squeeze(bgr, int(rng.integers(12, 71)))
    return bgr


def shuffled(bgr: UInt8[np.ndarray, "rows columns 3"], rng: np.random.Generator) -> np.ndarray:
    """The picture cut into tiles laid in another order: the same paint and people, and no court."""
    rows, columns = int(rng.integers(3, 6)), int(rng.integers(4, 8))
    high, wide = bgr.shape[0] // rows, bgr.shape[1] // columns
    tiles = [bgr[r * high : (r + 1) * high, c * wide : (c + 1) * wide] for r in range(rows) for c in range(columns)]
    # Moved by one at least, so that no tile stays in its place.
    order = np.roll(np.arange(len(tiles)), int(rng.integers(1, len(tiles))))
    mixed = [tiles[i] if rng.random() < 0.5 else tiles[i][:, ::-1] for i in order]
    return cv2.resize(
        np.concatenate([np.concatenate(mixed[r * columns : (r + 1) * columns], axis=1) for r in range(rows)], axis=0),
        (bgr.shape[1], bgr.shape[0]),
    )


def _colour(bgr: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    if rng.random() < 0.5:
        mix = np.eye(3) + rng.normal(0, 0.15, (3, 3))
        if rng.random() < 0.15:
            mix = mix[rng.permutation(3)]
        bgr = cv2.transform(bgr, mix / mix.sum(axis=1, keepdims=True))
    values = np.linspace(0, 1, 256)[:, None]
    gamma = np.exp(rng.normal(0, 0.3) + rng.normal(0, 0.1, 3))
    contrast = np.exp(rng.normal(0, 0.25))
    gain = np.exp(rng.normal(0, 0.15) + rng.normal(0, 0.08, 3))
    curve = ((values**gamma - 0.5) * contrast + 0.5) * gain + rng.normal(0, 0.06)
    return cv2.LUT(bgr, np.clip(255 * curve, 0, 255).round().astype(np.uint8)[:, None, :])


def _squeeze(bgr: np.ndarray, quality: int) -> np.ndarray:
    squeezed = cv2.imdecode(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
    assert squeezed is not None, "a picture just encoded can be decoded"
    return squeezed


def _soften(bgr: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    kind = rng.random()
    if kind < 0.45:
        share = rng.uniform(0.35, 0.9)
        small = cv2.resize(bgr, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        return cv2.resize(small, (bgr.shape[1], bgr.shape[0]), interpolation=cv2.INTER_LINEAR)
    if kind < 0.85:
        return cv2.GaussianBlur(bgr, (0, 0), rng.uniform(0.4, 1.6))
    length = int(rng.integers(3, 9))
    kernel = np.zeros((9, 9), np.float32)
    angle = rng.uniform(0, np.pi)
    arm = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    cv2.line(kernel, tuple(np.round(4 - arm).astype(int).tolist()), tuple(np.round(4 + arm).astype(int).tolist()), 1.0)
    return cv2.filter2D(bgr, -1, kernel / kernel.sum())


def _noise(bgr: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    row, column = (
        int(rng.integers(NOISE.shape[0] - bgr.shape[0] + 1)),
        int(rng.integers(NOISE.shape[1] - bgr.shape[1] + 1)),
    )
    field = NOISE[row : row + bgr.shape[0], column : column + bgr.shape[1]]
    return cv2.addWeighted(bgr, 1.0, field, float(rng.uniform(1, 18)), 0.0, dtype=cv2.CV_8U)


def _shade(bgr: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    rows, columns = bgr.shape[:2]
    through = rng.uniform(0, 1, 2) * np.array([columns, rows])
    angle = rng.uniform(0, 2 * np.pi)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    depth = rng.uniform(30, 900)
    far = 2.0 * columns
    corners = np.stack(
        [
            through - far * along,
            through + far * along,
            through + far * along + depth * across,
            through - far * along + depth * across,
        ]
    )
    light = np.full((rows, columns), 128, np.uint8)
    change = float(np.clip(128 * np.exp(rng.normal(-0.3, 0.35)), 30, 230))
    cv2.fillConvexPoly(light, np.round(corners).astype(np.int32), change)
    if rng.random() < 0.5:
        light = cv2.blur(light, (9, 9))
    return cv2.multiply(bgr, cv2.cvtColor(light, cv2.COLOR_GRAY2BGR), scale=1 / 128)


def _occlude(bgr: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    bgr = bgr.copy()
    rows, columns = bgr.shape[:2]
    for _ in range(int(rng.integers(1, 6))):
        colour = rng.uniform(0, 255, 3).tolist()
        x, y = rng.uniform(0, columns), rng.uniform(0, rows)
        if rng.random() < 0.6:
            tall = rng.uniform(12, 80)
            lean = rng.uniform(-15, 15)
            cv2.ellipse(bgr, ((x, y), (0.35 * tall, tall), lean), colour, -1)
            cv2.circle(
                bgr, (round(x), round(y - 0.6 * tall)), max(1, round(0.12 * tall)), rng.uniform(0, 255, 3).tolist(), -1
            )
            continue
        wide, high = round(rng.uniform(6, 110)), round(rng.uniform(6, 70))
        x0, y0 = int(min(x, columns - wide - 1)), int(min(y, rows - high - 1))
        if rng.random() < 0.5:
            u, v = int(rng.integers(columns - wide)), int(rng.integers(rows - high))
            bgr[y0 : y0 + high, x0 : x0 + wide] = bgr[v : v + high, u : u + wide].copy()
        else:
            cv2.rectangle(bgr, (x0, y0), (x0 + wide, y0 + high), colour, -1)
    return bgr
