"""Shirts, blazers and bands, a little off the body, with loose hems; and all clothes together.

Frame and units as in `loft`.
"""

import numpy as np

from pgm_data.simulate.pictures.body_shape import (
    BARE_ARMS,
    arm_tube,
    shoulder_smooth,
    trunk_keys,
    weigh_arm,
    weigh_trunk,
)
from pgm_data.simulate.pictures.legwear_shape import bottoms, feet, shorts_end
from pgm_data.simulate.pictures.loft import (
    Paint,
    Part,
    Tube,
    bands,
    crumpled,
    mirrored,
    plain,
    shaded,
    step,
    surface,
)
from pgm_data.simulate.pictures.looks import BodyLook

NECK_Y = 1.508


def clothes(look: BodyLook, fine: float) -> list[Part]:
    """All that is worn below the head."""
    parts = [
        crumpled(_trunk(look, fine), 0.12 + 0.22 * look.loose),
        *_collar(look, fine),
        *bottoms(look, fine),
        *feet(look, fine),
    ]
    if look.top not in BARE_ARMS:
        parts += _sleeves(look, fine)
    for side, worn in zip(("left", "right"), look.wristbands, strict=True):
        if worn and fine > 0.7:
            band = _over_arm(look, (0.635, 0.688), 0.004, plain(look.band_colour), 5, fine, 0.0)
            parts.append(band if side == "left" else mirrored(band))
    return parts


def skin_starts(look: BodyLook) -> tuple[float, float | None]:
    """Where along the arms and legs skin comes out of the clothes, a little inside of them; None where it does not."""
    arm = 0.115 if look.top in BARE_ARMS else sleeve_end(look) - 0.035
    leg = {"shorts": shorts_end(look) + 0.03, "tights": 0.22, "trousers": None}.get(look.bottom, 0.72)
    return arm, leg


def sleeve_end(look: BodyLook) -> float:
    """How far out along x sleeves reach."""
    return 0.69 if look.top in ("long", "blazer") else 0.255 + 0.105 * look.sleeve


def _hem_y(look: BodyLook) -> float:
    if look.bottom in ("skirt", "dress", "tights") and look.build == "woman":
        return 0.955
    return 0.80 if look.top == "blazer" else 0.885


def _neckline(look: BodyLook, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """How far down the neck of a shirt is pulled in front, metres."""
    deep = {"polo": 0.040, "blazer": 0.050}.get(look.top, 0.030 if look.build == "man" else 0.040)
    return deep * np.clip(np.sin(angle), 0.0, None) ** 2 * step(1.42, 1.50, s)


def _trunk(look: BodyLook, fine: float) -> Part:
    hem = _hem_y(look)
    keys = trunk_keys(look)
    slack = 0.006 + 0.016 * look.loose
    if look.bottom in ("skirt", "dress"):
        slack *= np.interp(keys[:, :1], [1.05, 1.16], [0.0, 1.0])
    # Loose below the chest, lying on shoulders and chest.
    keys[:, 3:] += slack * np.interp(keys[:, :1], [0.8, 1.0, 1.25, 1.36, 1.42], [1.1, 1.0, 0.55, 0.3, 0.15])
    tube = Tube(axis=1, keys=keys, power=2.35)
    folds = 0.012 * (0.35 + look.loose)

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        p = tube.at(np.maximum(s, hem) - _neckline(look, s, angle), angle)
        wave = np.sin(3 * angle + 9 * s + 0.7) + 0.8 * np.sin(5 * angle - 14 * s) + 0.6 * np.sin(2 * angle + 31 * s)
        grow = 1.0 + folds * wave * step(1.30, 1.02, s) / (1.0 + 0.4 * np.abs(np.cos(angle)))
        grow = np.where(s < hem, 0.9, grow)  # the hem turns inward
        p[..., 0] *= grow
        p[..., 2] *= grow
        if look.build == "woman":  # two breasts, not a shelf
            front = np.clip(np.sin(angle), 0.0, None)
            valley = np.exp(-((np.cos(angle) / 0.25) ** 2)) * np.exp(-(((s - 1.255) / 0.05) ** 2))
            p[..., 2] -= 0.010 * valley * front
        return p

    low = {"tank": 1.415, "sleeveless": 1.462}.get(look.top, NECK_Y)
    breaks = [hem] + _trunk_breaks(look)
    front = [0.3 * np.pi, 0.7 * np.pi] if look.pattern == "side_panels" else []
    back = [1.3 * np.pi, 1.7 * np.pi] if look.pattern == "side_panels" else []
    halves = [0.5 * np.pi, 1.5 * np.pi] if look.pattern == "halves" else []
    v_neck = [0.42 * np.pi, 0.5 * np.pi, 0.58 * np.pi] if look.top == "blazer" else []
    grid = (max(9, round(20 * fine)), max(10, round(26 * fine)))
    return surface(
        points,
        (hem - 0.012, low),
        grid,
        shaded(_trunk_paint(look), lambda s, a: _trunk_shade(look, s, a)),
        weigh_trunk,
        breaks=(breaks, sorted(front + back + halves + v_neck)),
    )


def _trunk_shade(look: BodyLook, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    sides = np.exp(-((np.sin(angle) / 0.45) ** 2))
    armpit = 1.0 - 0.30 * sides * np.exp(-(((s - 1.27) / 0.07) ** 2))
    spine = 1.0 - 0.10 * np.exp(-((np.cos(angle) / 0.14) ** 2)) * (np.sin(angle) < 0) * step(1.40, 1.25, s)
    return np.where(s < _hem_y(look), 0.35, armpit * spine)


def _trunk_breaks(look: BodyLook) -> list[float]:
    if look.pattern == "yoke":
        return [1.325]
    if look.pattern == "chest_band":
        return [1.20, 1.275]
    if look.pattern == "hoops":
        return list(np.arange(0.92, 1.42, 0.07))
    return [1.15] if look.top == "blazer" else []


def _trunk_paint(look: BodyLook) -> Paint:
    cloth, other, trim = look.top_colours

    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        colour = np.broadcast_to(cloth, (*np.shape(s), 3)).copy()
        if look.pattern == "yoke":
            colour[s > 1.325] = other
        elif look.pattern == "chest_band":
            colour[(s > 1.20) & (s < 1.275)] = other
        elif look.pattern == "hoops":
            colour[np.floor((s - 0.92) / 0.07).astype(int) % 2 == 0] = other
        elif look.pattern == "side_panels":
            colour[np.abs(np.cos(angle)) > np.cos(0.3 * np.pi)] = other
        elif look.pattern == "halves":
            colour[np.cos(angle) > 0] = other
        if look.top == "blazer":
            open_ = (np.abs(angle - 0.5 * np.pi) < 0.08 * np.pi) & (s > 1.15)
            colour[open_] = [240.0, 240.0, 240.0]
        return colour

    return paint


def _collar(look: BodyLook, fine: float) -> list[Part]:
    if fine < 0.7:
        return []
    if look.top in BARE_ARMS:
        return _straps(look, fine)
    high = 0.024 if look.top in ("polo", "blazer") else 0.005
    tube = Tube(axis=1, keys=trunk_keys(look), power=2.35)
    profile = np.array([[0.004, -0.012], [0.008, -0.004], [0.005, high], [-0.008, high]])

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        edge = np.full_like(s, NECK_Y)
        p = tube.at(edge - _neckline(look, edge, angle), angle)
        out = np.stack([np.cos(angle), np.zeros_like(s), np.sin(angle)], axis=-1)
        along = np.interp(s, np.arange(4.0), profile[:, 0])
        p = p + out * along[..., None]
        p[..., 1] += np.interp(s, np.arange(4.0), profile[:, 1])
        return p

    return [surface(points, (0.0, 3.0), (3, 20), plain(look.top_colours[2]), weigh_trunk)]


def _straps(look: BodyLook, fine: float) -> list[Part]:
    """Bare shoulders under a vest: the trunk's own skin above its edge, and two straps for a tank top."""
    inset = np.array([0, 0, 0, 1, 1, 1, 1]) * 0.005
    tube = Tube(axis=1, keys=trunk_keys(look) - inset, power=2.35)
    skin = surface(tube.at, (1.33, NECK_Y), (9, 24), plain(look.skin), weigh_trunk)
    parts = [skin]
    if look.top == "tank":
        lifted = Tube(axis=1, keys=trunk_keys(look) + 0.4 * inset, power=2.35)
        for start, end in ((0.25, 0.36), (1.64, 1.75)):
            strap = surface(
                lifted.at,
                (1.38, 1.474),
                (6, 4),
                plain(look.top_colours[0]),
                weigh_trunk,
                angles=(start * np.pi, end * np.pi),
            )
            parts += [strap, mirrored(strap)]
    return parts


def _over_arm(look: BodyLook, span, lift: float, paint: Paint, rings: int, fine: float, folds: float, trim=()) -> Part:
    """A sleeve or band round the left arm, its outer end turned inward."""
    tube = arm_tube(look.build)
    start, end = span

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        p = tube.at(np.clip(s, start, end), angle)
        middle = np.stack([p[..., 0], np.full_like(s, 1.4), np.zeros_like(s)], axis=-1)
        out = p - middle
        length = np.linalg.norm(out, axis=-1, keepdims=True)
        wave = folds * (np.sin(3 * angle + 40 * s) + np.sin(2 * angle - 55 * s + 1.0))
        # Cloth lies on the shoulder and hangs below the arm.
        above = np.clip(np.sin(angle) + 0.3, 0.0, 1.0)
        grow = lift * (1.0 - 0.75 * above * step(0.34, 0.20, s)) + wave * step(0.17, 0.26, s)
        grow = grow + lift * 0.9 * np.clip(-np.sin(angle), 0.0, None)
        grow = np.where((s > end) | (s < start), 0.0005, grow)
        return middle + out * (1.0 + grow[..., None] / length)

    columns = max(8, round(14 * fine))
    low = start if lift > 0.008 else start - 0.002
    return surface(points, (low, end + 0.003), (rings, columns), paint, weigh_arm, breaks=([start, end, *trim], ()))


def _sleeves(look: BodyLook, fine: float) -> list[Part]:
    cloth, other, trim = look.top_colours
    base = other if look.pattern in ("sleeves", "yoke") else cloth
    long = look.top in ("long", "blazer")
    end = sleeve_end(look)
    lift = 0.005 + 0.006 * look.loose if look.top == "long" else 0.008 + 0.014 * look.loose
    if look.top == "blazer":
        lift = 0.012
    rings = bands(base, [] if look.top == "tee" else [(end - 0.014, end, trim)])
    edge = () if look.top == "tee" else (end - 0.014,)

    def dark(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        inside = np.where(s > end, 0.35, 1.0)
        return inside * (1.0 - 0.3 * step(0.27, 0.16, s) * step(0.1, -0.7, np.sin(angle)))

    count = max(6, round((16 if long else 9) * fine))
    left = _over_arm(look, (0.125, end), lift, shaded(rings, dark), count, fine, 0.0012 + 0.0018 * look.loose, edge)
    left = crumpled(shoulder_smooth(left), 0.25 + 0.2 * look.loose)
    return [left, mirrored(left)]
