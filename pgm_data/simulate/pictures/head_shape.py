"""Heads: face, ears, hair, caps and bands.

Shapes stand in the frame of the Head joint of a person 1.8 m tall: x left, y up, z forward, metres.
"""

from dataclasses import replace

import numpy as np

from pgm_data.simulate.pictures.body_shape import REST
from pgm_data.simulate.pictures.loft import (
    JOINT,
    Paint,
    Part,
    Tube,
    follow,
    mirrored,
    part_of,
    plain,
    ring_keys,
    step,
    surface,
)
from pgm_data.simulate.pictures.looks import BodyLook

ORIGIN = REST[JOINT["Head"]]
CROWN = 0.238
# Height, half width, front and back of the skull.
_SKULL = (
    (-0.010, 0.030, 0.062, -0.030),
    (-0.002, 0.044, 0.082, -0.040),
    (0.010, 0.052, 0.092, -0.052),
    (0.030, 0.060, 0.095, -0.064),
    (0.055, 0.065, 0.094, -0.076),
    (0.085, 0.070, 0.094, -0.087),
    (0.112, 0.0745, 0.093, -0.096),
    (0.128, 0.076, 0.091, -0.100),
    (0.146, 0.077, 0.098, -0.102),
    (0.175, 0.0765, 0.094, -0.101),
    (0.200, 0.069, 0.080, -0.092),
    (0.222, 0.050, 0.054, -0.068),
    (0.234, 0.025, 0.024, -0.034),
    (CROWN, 0.001, 0.001, -0.006),
)
_MIDDLE = 0.0


def _skull(build: str) -> Tube:
    rows = []
    for y, half, front, back in _SKULL:
        thin = 0.95 if build == "woman" and y < 0.1 else 1.0
        rows.append((y, 0.0, _MIDDLE, half * thin, half * thin, front - _MIDDLE, _MIDDLE - back))
    keys = ring_keys(rows)
    keys[:, 3:] *= 1.05
    return Tube(axis=1, keys=keys, power=2.25)


def _heights(s: np.ndarray) -> np.ndarray:
    """Ring heights from a share 0 to 1, closer together at chin and crown."""
    return -0.010 + (CROWN + 0.010) * (0.5 - 0.5 * np.cos(np.pi * s)) * 0.55 + (CROWN + 0.010) * s * 0.45


def head(look: BodyLook, fine: float) -> list[Part]:
    """Everything above the neck."""
    skull = _skull(look.build)
    rings, columns = max(8, round(20 * fine)), max(10, round(26 * fine))
    on_head = follow("Head")

    def skull_at(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        return ORIGIN + skull.at(_heights(s), angle)

    parts = [surface(skull_at, (0.0, 1.0), (rings, columns), _face_paint(look), on_head)]
    ear = _ellipsoid(
        ORIGIN + [0.080, 0.112, -0.008], (0.010, 0.030, 0.018), (5, 6), plain(look.skin * [0.86, 0.9, 0.95])
    )
    parts += [ear, mirrored(ear), _nose(look)]
    if fine > 0.7:
        parts += _features(look, skull)
    parts += _hair(look, skull, rings, columns)
    parts += _headwear(look, skull, columns)
    return parts


def _face_paint(look: BodyLook) -> Paint:
    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        y, front = _heights(s), np.sin(angle)
        colour = np.broadcast_to(look.skin, (*np.shape(y), 3)).copy()
        hollow = np.exp(-(((y - 0.126) / 0.012) ** 2)) * step(0.5, 0.85, front)
        cheek = np.exp(-(((y - 0.088) / 0.022) ** 2)) * np.exp(-(((front - 0.75) / 0.2) ** 2))
        colour *= 1.0 - 0.22 * hollow[..., None]
        colour *= 1.0 - cheek[..., None] * np.array([0.10, 0.09, 0.0])
        colour *= 1.0 - 0.25 * step(0.02, -0.01, y)[..., None]
        jaw = step(0.078, 0.055, y) * step(-0.15, 0.1, front) + step(0.12, 0.09, y) * step(0.35, 0.1, np.abs(front))
        share = 0.75 * look.beard * np.clip(jaw, 0.0, 1.0)[..., None]
        return colour + share * (look.hair_colour * 0.9 - colour)

    return paint


def _ellipsoid(centre, radii, grid, paint) -> Part:
    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        r = np.sin(s)
        return centre + np.stack(
            [r * np.cos(angle) * radii[0], -np.cos(s) * radii[1], r * np.sin(angle) * radii[2]], axis=-1
        )

    return surface(points, (0.0, np.pi), grid, paint, follow("Head"))


def _nose(look: BodyLook) -> Part:
    points = np.array(
        [
            [0.0, 0.138, 0.094], [0.007, 0.130, 0.090], [-0.007, 0.130, 0.090],
            [0.0, 0.108, 0.109], [0.0, 0.092, 0.119], [0.016, 0.086, 0.096],
            [-0.016, 0.086, 0.096], [0.0, 0.080, 0.110], [0.0, 0.070, 0.093],
        ]
    )  # fmt: skip
    triangles = np.array(
        [
            [0, 3, 1], [0, 2, 3], [3, 4, 5], [3, 6, 4], [1, 3, 5],
            [2, 6, 3], [4, 7, 5], [4, 6, 7], [7, 8, 5], [7, 6, 8],
        ]
    )[:, ::-1]  # fmt: skip
    points = points * [1.05, 1.0, 1.05]
    colours = np.tile(look.skin, (9, 1))
    colours[7:] *= [0.82, 0.84, 0.9]
    colours[[5, 6]] *= 0.88
    nose = part_of(ORIGIN + points, triangles, colours, follow("Head"), flip=False)
    # Rounder than its few triangles.
    normals = nose.normals + np.array([0.0, 0.25, 0.9])
    return replace(nose, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _features(look: BodyLook, skull: Tube) -> list[Part]:
    """Eyes, brows and mouth as thin patches on the face."""

    def face(x: np.ndarray, y: np.ndarray, lift: float) -> np.ndarray:
        keys = skull.at(y, np.full_like(y, 0.5 * np.pi))[..., 2]
        half = skull.at(y, np.zeros_like(y))[..., 0]
        share = np.clip(np.abs(x) / half, 0.0, 1.0)
        z = keys * (1.0 - share**skull.power) ** (1.0 / skull.power)
        return ORIGIN + np.stack([x, y, z + lift], axis=-1)

    def patch(x, y, half, tall, colour, lift, slant=0.0) -> Part:
        angle = np.linspace(0, 2 * np.pi, 11)[:-1]
        ring_x, ring_y = x + half * np.cos(angle), y + tall * np.sin(angle) + slant * half * np.cos(angle)
        points = np.concatenate([face(np.array([x]), np.array([y]), lift + 0.001), face(ring_x, ring_y, lift)])
        n = len(angle)
        triangles = np.array([[0, 1 + k, 1 + (k + 1) % n] for k in range(n)])
        return part_of(points, triangles, np.tile(colour, (n + 1, 1)), follow("Head"), flip=False)

    white, dark = np.array([205.0, 210.0, 214.0]), np.array([28.0, 30.0, 34.0])
    brow = 0.45 * look.hair_colour + 0.25 * look.skin * 0.5
    lips = look.skin * [0.62, 0.62, 0.82]
    parts = []
    for part in (
        patch(0.031, 0.1245, 0.0165, 0.0075, white * 0.9, 0.0025, 0.05),
        patch(0.031, 0.1250, 0.0075, 0.0072, dark, 0.0040),
        patch(0.031, 0.1310, 0.0180, 0.0030, dark, 0.0035, 0.05),
        patch(0.033, 0.1470, 0.0210, 0.0042, brow, 0.0025, -0.04),
        patch(0.0, 0.0500, 0.0230, 0.0055, lips, 0.0022),
    ):
        parts += [part, mirrored(part)] if abs(part.vertices[0, 0]) > 1e-6 else [part]
    parts.append(patch(0.0, 0.0505, 0.0190, 0.0012, lips * 0.5, 0.0036))
    return parts


def _shell(skull: Tube, line, thick, rings: int, columns: int, paint: Paint) -> Part:
    """A layer over the skull that dives under the skin below `line(angle)`; `thick(y, angle)` metres."""

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        # Rings run along the line, so that its edge is smooth.
        low = line(angle) - 0.008
        y = low + (CROWN - low) * (0.6 * s + 0.4 * (0.5 - 0.5 * np.cos(np.pi * s)))
        base = skull.at(y, angle)
        lift = np.maximum(np.minimum((y - line(angle)) * 0.9, thick(y, angle)), -0.006)
        out = base - np.array([0.0, 0.10, 0.0])
        out /= np.linalg.norm(out, axis=-1, keepdims=True)
        return ORIGIN + base + out * lift[..., None]

    return surface(points, (0.0, 1.0), (rings, columns), paint, follow("Head"))


def _hair(look: BodyLook, skull: Tube, rings: int, columns: int) -> list[Part]:
    style = look.hair
    if style == "bald":
        return []
    covered = look.headwear in ("cap", "cap_back", "hat")
    sleek = style in ("ponytail", "bun")
    top = {"buzz": 0.005, "short": 0.017, "thick": 0.034, "bob": 0.022}.get(style, 0.010)
    top = min(top, 0.008) if covered else top
    nape = {"bob": -0.03, "thick": 0.0, "buzz": 0.045}.get(style, 0.035)

    def line(angle: np.ndarray) -> np.ndarray:
        front = np.sin(angle)
        side = 0.118 if not sleek else 0.135
        if style == "bob":
            side = 0.03
        forehead = 0.186 - 0.012 * np.cos(4 * angle)
        return np.where(
            front > 0,
            side + (forehead - side) * step(0.12, 0.75, front),
            side + (nape - side) * step(0.0, 0.45, -front),
        )

    def thick(y: np.ndarray, angle: np.ndarray) -> np.ndarray:
        rough = 0.0 if sleek or style == "buzz" else 0.12
        waves = 1.0 + rough * (np.sin(7 * angle + 60 * y) + np.sin(11 * angle - 90 * y))
        # A band presses it down.
        pressed = 0.85 * np.exp(-(((y - 0.166) / 0.020) ** 2)) if look.headwear in ("headband", "visor") else 0.0
        return top * (0.55 + 0.45 * step(0.10, 0.2, y)) * waves * (1.0 - pressed)

    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        y = _heights(s)
        strands = 1.0 + 0.10 * np.sin(13 * angle + 8 * s) + 0.06 * np.sin(29 * angle)
        return look.hair_colour * (strands * (0.8 + 0.25 * step(0.05, 0.22, y)))[..., None]

    parts = [_shell(skull, line, thick, rings, columns, paint)]
    colour = plain(look.hair_colour * 0.92)
    if style == "ponytail":
        rows = [
            (0.205, 0.0, -0.098, 0.012), (0.195, 0.0, -0.118, 0.021), (0.16, 0.0, -0.142, 0.027),
            (0.10, 0.0, -0.148, 0.028), (0.03, 0.0, -0.146, 0.025), (-0.04, 0.0, -0.138, 0.017),
            (-0.075, 0.0, -0.130, 0.003),
        ]  # fmt: skip
        tube = Tube(axis=1, keys=ring_keys(rows))
        parts.append(
            surface(
                lambda s, a: ORIGIN + tube.at(s, a), (0.205, -0.075), (9, max(6, columns // 3)), colour, follow("Head")
            )
        )
    if style == "bun":
        parts.append(_ellipsoid(ORIGIN + [0.0, 0.19, -0.105], (0.036, 0.034, 0.032), (6, 9), colour))
    return parts


def _headwear(look: BodyLook, skull: Tube, columns: int) -> list[Part]:
    kind, colour = look.headwear, look.headwear_colour
    parts = []
    if kind in ("headband", "visor"):
        rows = []
        for y, lift in ((0.150, 0.0), (0.153, 0.010), (0.182, 0.011), (0.186, 0.0)):
            keys = [skull.at(np.array(y), np.array(a)) for a in (0.0, 0.5 * np.pi, 1.5 * np.pi)]
            half, front, back = keys[0][0] + lift, keys[1][2] + lift, lift - keys[2][2]
            rows.append((y, 0.0, _MIDDLE, half, half, front, back))
        tube = Tube(axis=1, keys=ring_keys(rows), power=2.25)
        # The band lies higher in front than at the back of the head.
        parts.append(
            surface(
                lambda s, a: ORIGIN + tube.at(s, a) + np.sin(a)[..., None] * [0.0, 0.006, 0.0],
                (0.150, 0.186),
                (4, columns),
                plain(colour),
                follow("Head"),
            )
        )
    if kind in ("cap", "cap_back", "hat"):

        def line(angle: np.ndarray) -> np.ndarray:
            return 0.150 + 0.012 * np.sin(angle) + np.zeros_like(angle)

        def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
            seams = 1.0 - 0.12 * (np.abs(np.sin(3 * angle)) < 0.12)
            return colour * seams[..., None]

        parts.append(_shell(skull, line, lambda y, a: 0.013 + 0 * y * a, 14, columns, paint))
    if kind in ("cap", "cap_back", "visor", "hat"):
        reach = (-1.15, 1.15) if kind != "hat" else (-np.pi, np.pi)
        turned = np.pi if kind == "cap_back" else 0.0
        long = 0.068 if kind != "hat" else 0.055

        def brim(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
            base = skull.at(np.full_like(angle, 0.160), 0.5 * np.pi + turned + angle)
            fade = np.cos(angle * 1.2).clip(0.0) ** 0.6 if kind != "hat" else np.ones_like(angle)
            direction = np.stack([-np.sin(angle + turned), np.zeros_like(angle), np.cos(angle + turned)], axis=-1)
            ahead = np.array([0.0, 0.0, np.cos(turned)]) if kind != "hat" else direction
            out = (0.006 + s * long * fade)[..., None] * ahead + 0.008 * direction
            droop = np.stack(
                [np.zeros_like(s), -0.012 * s - 0.25 * s * base[..., 0] ** 2 / 0.077, np.zeros_like(s)], axis=-1
            )
            return ORIGIN + base + out + droop

        parts.append(
            surface(brim, (0.0, 1.0), (4, max(8, columns // 2)), plain(colour * 0.9), follow("Head"), angles=reach)
        )
    return parts
