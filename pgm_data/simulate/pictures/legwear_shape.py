"""Shorts, trousers, tights, skirts, socks and shoes. Frame and units as in `loft`."""

import numpy as np

from pgm_data.simulate.pictures.body_shape import leg_tube, trunk_keys, weigh_leg
from pgm_data.simulate.pictures.loft import (
    JOINT,
    Part,
    Tube,
    bands,
    chain,
    crumpled,
    mirrored,
    plain,
    shaded,
    step,
    surface,
)
from pgm_data.simulate.pictures.looks import BodyLook


def shorts_end(look: BodyLook) -> float:
    """Height of the shorts' hem."""
    return 0.70 - 0.19 * look.hem


def bottoms(look: BodyLook, fine: float) -> list[Part]:
    """What is worn from the waist down to the socks."""
    if look.bottom in ("skirt", "dress"):
        return _skirt(look, fine)
    half = crumpled(_half_trousers(look, fine), 0.0 if look.bottom == "tights" else 0.16 + 0.16 * look.loose)
    return [half, mirrored(half)]


def _half_trousers(look: BodyLook, fine: float) -> Part:
    """The left half of shorts, tights or trousers: half the waist's ring above, a leg below the crotch."""
    cloth, stripe = look.bottom_colours
    keys = trunk_keys(look)[:5]
    keys[:, 3:] += 0.002 + 0.012 * look.loose * np.interp(keys[:, :1], [0.9, 1.02], [1.0, 0.2])
    seat = Tube(axis=1, keys=keys, power=2.3)
    tube = leg_tube(look.build)
    if look.bottom == "trousers":
        end, lift, hang = 0.075, 0.010 + 0.012 * look.loose, 0.35
    elif look.bottom == "tights":
        end, lift, hang = 0.20, 0.002, 0.0
    else:
        end, lift, hang = shorts_end(look), 0.008 + 0.018 * look.loose, 0.8
    folds = 0.0 if look.bottom == "tights" else 0.003 + 0.004 * look.loose
    widest = 0.78

    def leg(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        p = tube.at(np.clip(s, end, 0.88), angle)
        middle = np.stack(
            [np.interp(s, [0.06, 0.46, 0.86], [0.11, 0.11, 0.09]), p[..., 1], np.full_like(s, -0.003)], -1
        )
        out = p - middle
        length = np.linalg.norm(out, axis=-1, keepdims=True)
        # Shorts hang straight down from the widest place; trousers too, narrower.
        wide = np.linalg.norm((tube.at(np.full_like(s, widest), angle) - [0.095, widest, -0.003])[..., [0, 2]], axis=-1)
        straight = np.maximum(wide - length[..., 0], 0.0) * hang * step(0.84, 0.70, s)
        wave = folds * (np.sin(3 * angle + 17 * s) + 0.8 * np.sin(2 * angle - 29 * s)) * step(0.84, 0.72, s)
        grow = np.where(s < end, 0.001, lift + straight + wave)
        p = middle + out * (1.0 + grow[..., None] / length)
        p[..., 0] = np.maximum(p[..., 0], 0.004)  # the legs' insides touch
        return p

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        hip = seat.at(np.maximum(s, 0.80), angle)
        hip[..., 0] = np.maximum(hip[..., 0], 0.0)
        hip[..., 1] = s
        share = step(0.86, 0.70, s)[..., None]
        p = (1.0 - share) * hip + share * leg(s, angle)
        p[..., 1] = np.maximum(s, end)
        return p

    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        colour = np.broadcast_to(cloth, (*np.shape(s), 3)).copy()
        side = (angle < 0.09 * np.pi) | (angle > 1.91 * np.pi)
        if look.bottom != "trousers":
            colour[side & (look.pattern in ("side_panels", "sleeves", "halves"))] = stripe
        inner = 1.0 - 0.28 * step(0.62, 0.76, s) * step(0.0, -0.7, np.cos(angle)) * step(0.84, 0.78, s)
        inside = np.where(s < end, 0.3, 1.0)
        return colour * (inner * inside)[..., None]

    count = {"shorts": 12, "tights": 20, "trousers": 22}[look.bottom]
    grid = (max(7, round(count * fine)), max(10, round(20 * fine)))
    breaks = ([end], [0.09 * np.pi, 1.91 * np.pi] if look.bottom != "trousers" else [])
    part = surface(points, (1.035, end - 0.004), grid, paint, _weigh_legs_and_seat, breaks=breaks)
    seam = part.vertices[:, 0] < 1e-9
    part.normals[seam, 0] = 0.0
    part.normals[seam, 2] += np.where(part.vertices[seam, 2] > 0.0, 1e-6, -1e-6)
    part.normals[seam] /= np.linalg.norm(part.normals[seam], axis=1, keepdims=True)
    return part


def _weigh_legs_and_seat(points: np.ndarray) -> np.ndarray:
    """Left half: the pelvis above, the left leg below; less of the leg near the middle, so that both halves meet."""
    weights = weigh_leg(points)
    x, y = points[:, 0], points[:, 1]
    back = step(1.0, 1.08, y) * weights[:, JOINT["Pelvis"]]
    weights[:, JOINT["Pelvis"]] -= back
    weights[:, JOINT["Torso"]] += back
    right = 0.5 * step(0.05, 0.0, x) * step(0.74, 0.84, y) * weights[:, JOINT["L_Hip"]]
    weights[:, JOINT["L_Hip"]] -= right
    weights[:, JOINT["R_Hip"]] += right
    return weights


def _skirt(look: BodyLook, fine: float) -> list[Part]:
    cloth, trim = look.bottom_colours if look.bottom == "skirt" else (look.top_colours[0], look.top_colours[2])
    end = 0.74 - 0.12 * look.hem
    flare = 0.030 + 0.045 * look.loose
    keys = trunk_keys(look)[:5]
    tube = Tube(axis=1, keys=keys, power=2.2)
    pleats = 9

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        p = tube.at(np.maximum(s, 0.84), angle)
        down = np.clip((0.98 - s) / (0.98 - end), 0.0, 1.0)
        grow = 0.008 + flare * down**1.2 + 0.009 * down * np.sin(pleats * angle)
        grow = np.where(s < end, grow - 0.02, grow)
        out = np.stack([np.cos(angle), np.zeros_like(s), np.sin(angle)], axis=-1)
        p[..., 1] = np.maximum(s, end)
        return p + out * grow[..., None]

    def dark(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        down = np.clip((0.98 - s) / (0.98 - end), 0.0, 1.0)
        return np.where(s < end, 0.35, 1.0 - 0.10 * down * (1.0 - np.sin(pleats * angle)))

    rings = bands(
        cloth, [(end, end + 0.014, trim), (1.0, 1.03, trim)] if look.bottom == "skirt" else [(end, end + 0.014, trim)]
    )
    grid = (max(6, round(11 * fine)), 44 if fine > 0.7 else 20)
    skirt = surface(
        points, (1.03, end - 0.004), grid, shaded(rings, dark), _weigh_skirt, breaks=([1.0, end + 0.014, end], ())
    )
    # Short tights below it.
    legs = leg_tube(look.build)
    under = Tube(axis=1, keys=legs.keys + np.array([0, 0, 0, 1, 1, 1, 1]) * 0.003)
    short = surface(
        under.at, (0.90, 0.70), (max(4, round(5 * fine)), max(8, round(14 * fine))), plain(cloth * 0.7), weigh_leg
    )
    return [skirt, short, mirrored(short)]


def _weigh_skirt(points: np.ndarray) -> np.ndarray:
    """A skirt hangs from the pelvis; thighs push it."""
    weights = chain(1, (("Pelvis", -np.inf, 0.0), ("Torso", 1.05, 0.06)))(points)
    x, y = points[:, 0], points[:, 1]
    left = step(-0.12, 0.12, x)
    share = 0.62 * step(0.94, 0.74, y)
    weights *= (1.0 - share)[:, None]
    weights[:, JOINT["L_Hip"]] += share * left
    weights[:, JOINT["R_Hip"]] += share * (1.0 - left)
    return weights


def feet(look: BodyLook, fine: float) -> list[Part]:
    """Socks and shoes."""
    parts = []
    if look.bottom != "trousers":
        top = 0.115 + 0.2 * look.sock_height
        legs = leg_tube(look.build)
        keys = legs.keys.copy()
        keys[:, 3:] += 0.004
        tube = Tube(axis=1, keys=keys)
        ring = bands(look.socks, [(top - 0.03, top - 0.018, look.socks * 0.86)])
        sock = surface(
            tube.at,
            (top, 0.05),
            (max(4, round(7 * fine)), max(8, round(12 * fine))),
            ring,
            weigh_leg,
            breaks=([top - 0.03, top - 0.018], ()),
        )
        parts += [sock, mirrored(sock)]
    shoe = _shoe(look, fine)
    return [*parts, *shoe, *(mirrored(p) for p in shoe)]


def _weigh_foot(points: np.ndarray) -> np.ndarray:
    return chain(2, (("L_Ankle", -np.inf, 0.0), ("L_Toe", 0.105, 0.03)))(points)


def _shoe(look: BodyLook, fine: float) -> list[Part]:
    f = 1.0 if look.build == "man" else 0.93
    upper, sole = look.shoes
    # Along the foot: height of the upper, half width.
    z = np.array([-0.1025, -0.102, -0.094, -0.075, -0.04, 0.0, 0.04, 0.08, 0.12, 0.155, 0.178, 0.188, 0.1885])
    tall = np.array([0.026, 0.050, 0.088, 0.098, 0.104, 0.102, 0.084, 0.066, 0.054, 0.046, 0.036, 0.028, 0.026])
    half = np.array([0.0, 0.010, 0.026, 0.035, 0.037, 0.036, 0.039, 0.045, 0.048, 0.043, 0.030, 0.012, 0.0])
    line = np.array([0.106, 0.106, 0.106, 0.107, 0.108, 0.110, 0.113, 0.117, 0.121, 0.122, 0.121, 0.120, 0.120])

    def ring(s: np.ndarray, angle: np.ndarray, low: float, wide: float) -> np.ndarray:
        h, w, x0 = np.interp(s, z, tall), np.interp(s, z, half) * f + wide, np.interp(s, z, line)
        c, d = np.cos(angle), np.sin(angle)
        x = x0 + w * np.sign(c) * np.abs(c) ** 0.75
        # Flat below, arched above.
        y = np.where(d > 0, low + (h - low) * np.abs(d) ** 0.9, low * (1.0 + d * 0.999))
        lift = 0.012 * np.clip((s - 0.12) / 0.07, 0.0, 1.0) ** 2
        return np.stack([x, y + lift, s * f - 0.002], axis=-1)

    def colour(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        out = np.broadcast_to(upper, (*np.shape(s), 3)).copy()
        stripe = (s > 0.02) & (s < 0.05) & (np.sin(angle) < 0.6)
        out[stripe] = 0.5 * upper + 0.5 * sole
        out[(s < -0.07) & (np.sin(angle) < 0.75)] = sole * 0.9
        laces = (np.sin(angle) > 0.85) & (s > 0.02) & (s < 0.1)
        out[laces] = 0.3 * upper + 0.7 * np.full(3, 225.0)
        return out

    rings, columns = max(7, round(13 * fine)), max(8, round(14 * fine))
    body = surface(
        lambda s, a: ring(s, a, 0.024, 0.0),
        (-0.1025, 0.1885),
        (rings, columns),
        colour,
        _weigh_foot,
        breaks=([-0.101, -0.07, 0.02, 0.05, 0.1, 0.187] if fine > 0.7 else [], ()),
    )

    def slab(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        p = ring(s, angle, 0.024, 0.004)
        lift = 0.012 * np.clip((s - 0.12) / 0.07, 0.0, 1.0) ** 2
        p[..., 1] = np.minimum(p[..., 1], 0.026 + lift + 0.006 * step(-0.02, -0.09, s))
        return p

    return [body, surface(slab, (-0.1025, 0.1885), (rings, columns), plain(sole), _weigh_foot)]
