"""The skin of a person: arms, hands, legs, neck, and how each follows the joints. Frame and units as in `loft`."""

from dataclasses import replace

import numpy as np

from pgm_data.simulate.body.figure import smpl24
from pgm_data.simulate.pictures.loft import (
    JOINT,
    Part,
    Tube,
    Weigh,
    chain,
    follow,
    mirrored,
    plain,
    ring_keys,
    shaded,
    step,
    surface,
)
from pgm_data.simulate.pictures.looks import BodyLook, Build


def _rest_joints() -> np.ndarray:
    joints = np.array(smpl24().rest_translations)
    for joint, parent in enumerate(smpl24().parents):
        if parent >= 0:
            joints[joint] += joints[parent]
    return joints


REST = _rest_joints()
"""The joints at rest, soles at y = 0."""
BARE_ARMS = ("sleeveless", "tank")
INFINITE = -np.inf
ARM_LINKS = (
    ("L_Thorax", INFINITE, 0.0),
    ("L_Shoulder", 0.175, 0.045),
    ("L_Elbow", 0.45, 0.045),
    ("L_Wrist", 0.70, 0.022),
    ("L_Hand", 0.765, 0.012),
)
LEG_LINKS = (("Pelvis", INFINITE, 0.0), ("L_Hip", 0.86, 0.06), ("L_Knee", 0.46, 0.055), ("L_Ankle", 0.07, 0.03))
TRUNK_LINKS = (
    ("Pelvis", INFINITE, 0.0),
    ("Torso", 1.05, 0.06),
    ("Spine", 1.17, 0.06),
    ("Chest", 1.26, 0.05),
    ("Neck", 1.475, 0.03),
    ("Head", 1.565, 0.03),
)


def weigh_arm(points: np.ndarray) -> np.ndarray:
    """The left arm, from the collar bone to the hand; a twist of the hand reaches up the forearm."""
    weights = chain(0, ARM_LINKS)(points)
    forearm = weights[:, JOINT["L_Elbow"]]
    twist = 0.45 * forearm * step(0.53, 0.70, points[:, 0])
    weights[:, JOINT["L_Elbow"]] -= twist
    weights[:, JOINT["L_Wrist"]] += twist
    return weights


weigh_leg: Weigh = chain(1, LEG_LINKS, -1.0)


def weigh_trunk(points: np.ndarray) -> np.ndarray:
    """Back, chest and neck; the shoulders' corners follow the collar bones and, a little, the arms."""
    weights = chain(1, TRUNK_LINKS)(points)
    x, y = points[:, 0], points[:, 1]
    for side, sign in (("L_", 1.0), ("R_", -1.0)):
        out = step(0.05, 0.13, sign * x) * step(1.27, 1.37, y) * step(1.56, 1.48, y)
        arm = 0.55 * step(0.12, 0.19, sign * x) * step(1.24, 1.36, y)
        for name, share in ((side + "Thorax", out), (side + "Shoulder", arm)):
            weights *= 1.0 - share[:, None]
            weights[:, JOINT[name]] += share
        seat = 0.5 * step(0.0, 0.07, sign * x) * step(0.92, 0.80, y)
        weights *= 1.0 - seat[:, None]
        weights[:, JOINT[side + "Hip"]] += seat
    return weights


def arm_tube(build: Build, *, bare: bool = False) -> Tube:
    """The left arm from inside of the shoulder to the wrist; `bare` shoulders are rounder than a sleeve needs them."""
    f = 1.0 if build == "man" else 0.86
    rows = [
        (0.115, -0.012, 1.400, 0.040, 0.040, 0.034, 0.046),
        (0.150, -0.012, 1.400, 0.052, 0.052, 0.040, 0.052),
        (0.190, -0.010, 1.400, 0.058, 0.058, 0.046, 0.055),
        (0.230, -0.008, 1.400, 0.057, 0.054, 0.050, 0.050),
        (0.280, -0.006, 1.400, 0.053, 0.048, 0.047, 0.045),
        (0.330, -0.004, 1.400, 0.053, 0.046, 0.045, 0.044),
        (0.390, -0.002, 1.400, 0.047, 0.043, 0.041, 0.041),
        (0.440, 0.000, 1.400, 0.041, 0.043, 0.037, 0.037),
        (0.465, 0.000, 1.400, 0.043, 0.043, 0.038, 0.037),
        (0.510, 0.002, 1.400, 0.049, 0.042, 0.040, 0.038),
        (0.555, 0.002, 1.400, 0.046, 0.039, 0.038, 0.035),
        (0.610, 0.001, 1.400, 0.038, 0.034, 0.031, 0.029),
        (0.660, 0.000, 1.400, 0.031, 0.029, 0.024, 0.023),
        (0.695, 0.000, 1.400, 0.030, 0.028, 0.021, 0.021),
        (0.720, 0.000, 1.399, 0.032, 0.030, 0.019, 0.020),
    ]
    keys = ring_keys(rows)
    keys[:, 3:] *= f
    if bare:
        keys[:, 5] += 0.009 * np.exp(-(((keys[:, 0] - 0.16) / 0.04) ** 2))
    return Tube(axis=0, keys=keys, power=2.1)


def leg_tube(build: Build) -> Tube:
    """The left leg from inside of the hip to inside of the shoe."""
    rows = [
        (0.900, 0.088, -0.006, 0.074, 0.070, 0.080, 0.088),
        (0.840, 0.092, -0.004, 0.084, 0.080, 0.088, 0.092),
        (0.760, 0.096, 0.000, 0.081, 0.080, 0.087, 0.086),
        (0.670, 0.101, 0.002, 0.073, 0.072, 0.080, 0.074),
        (0.580, 0.106, 0.002, 0.064, 0.063, 0.069, 0.062),
        (0.515, 0.109, 0.001, 0.055, 0.057, 0.060, 0.054),
        (0.465, 0.110, 0.000, 0.052, 0.053, 0.059, 0.049),
        (0.425, 0.110, -0.003, 0.050, 0.050, 0.050, 0.051),
        (0.370, 0.111, -0.006, 0.053, 0.052, 0.044, 0.063),
        (0.320, 0.111, -0.009, 0.053, 0.052, 0.043, 0.066),
        (0.260, 0.111, -0.013, 0.046, 0.046, 0.041, 0.054),
        (0.190, 0.110, -0.017, 0.038, 0.038, 0.037, 0.042),
        (0.120, 0.110, -0.020, 0.032, 0.032, 0.035, 0.036),
        (0.080, 0.110, -0.020, 0.034, 0.034, 0.037, 0.037),
        (0.040, 0.110, -0.018, 0.032, 0.032, 0.036, 0.036),
    ]
    keys = ring_keys(rows)
    if build == "woman":
        keys[:, 3:] *= np.interp(keys[:, :1], [0.1, 0.5, 0.8], [0.88, 0.93, 1.02])
    return Tube(axis=1, keys=keys, power=2.0)


def skin_paint(look: BodyLook, warm: tuple[float, float] | None = None):
    """Skin, a little redder about a place along the limb (place, half width)."""

    def paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        colour = np.broadcast_to(look.skin, (*np.shape(s), 3)).copy()
        if warm is not None:
            colour *= 1.0 - np.exp(-(((s - warm[0]) / warm[1]) ** 2))[..., None] * np.array([0.12, 0.08, 0.03])
        return colour

    return paint


def shoulder_smooth(part: Part) -> Part:
    """A left sleeve or arm whose shading runs on into the trunk's: near the shoulder no surface looks inward."""
    normals = part.normals.copy()
    normals[:, 0] = np.maximum(
        normals[:, 0], 0.55 * step(0.26, 0.15, part.vertices[:, 0]) - 1.2 * (part.vertices[:, 0] > 0.26)
    )
    return replace(part, normals=normals / np.linalg.norm(normals, axis=1, keepdims=True))


def arms(look: BodyLook, fine: float, start: float) -> list[Part]:
    """Both arms without hands, from inside of a sleeve that ends beyond `start`."""
    tube = arm_tube(look.build, bare=start < 0.2)
    rings = max(5, round(20 * fine * (0.715 - start) / 0.6))
    bare = start < 0.2

    def shade(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        pit = 0.25 * step(0.26, 0.13, s) * step(0.1, -0.5, np.sin(angle))
        return (1.0 - pit) * (1.0 if bare else 1.0 - 0.25 * step(start + 0.10, start + 0.04, s))

    dark = shaded(skin_paint(look, (0.455, 0.03)), shade)
    left = surface(tube.at, (start, 0.715), (rings, max(7, round(14 * fine))), dark, weigh_arm)
    left = shoulder_smooth(left)
    return [left, mirrored(left)]


def legs(look: BodyLook, fine: float, start: float) -> list[Part]:
    """Both legs, from inside of a hem that ends below `start` down into the socks."""
    tube = leg_tube(look.build)
    grid = (max(5, round(22 * fine * (start - 0.05) / 0.85)), max(7, round(14 * fine)))
    paint = shaded(
        skin_paint(look, (0.455, 0.04)),
        lambda s, a: (
            (1.0 - 0.38 * step(start - 0.14, start - 0.03, s)) * (1.0 - 0.18 * step(0.5, 0.7, s) * (np.cos(a) < -0.3))
        ),
    )
    left = surface(tube.at, (start, 0.05), grid, paint, weigh_leg)
    return [left, mirrored(left)]


def _blob(centre, radii, grid, paint, weigh, power: float = 2.2, bend: float = 0.0) -> Part:
    """A round body; `bend` lets it droop towards its outer end."""

    def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        r = np.maximum(1.0 - np.abs(np.cos(s)) ** power, 0.0) ** (1.0 / power)
        c, d = np.cos(angle), np.sin(angle)
        u, v = np.sign(c) * np.abs(c) ** (2.0 / power), np.sign(d) * np.abs(d) ** (2.0 / power)
        x = -np.cos(s) * radii[0]
        return np.stack(
            [centre[0] + x, centre[1] + r * v * radii[1] - bend * (x + radii[0]) ** 2, centre[2] + r * u * radii[2]],
            axis=-1,
        )

    return surface(points, (0.0, np.pi), grid, paint, weigh)


def hands(look: BodyLook, fine: float, grip: str | None) -> list[Part]:
    """Both hands; the one that grips (left, right or None) closed round the racket's handle."""
    f = 1.0 if look.build == "man" else 0.9
    grid = (max(5, round(8 * fine)), max(6, round(10 * fine)))
    dark = plain(look.skin * [0.8, 0.86, 0.92])
    parts = []
    for side in ("left", "right"):
        if side == grip:
            found = [
                _blob((0.752, 1.402, 0.0), (0.062, 0.024 * f, 0.042 * f), grid, plain(look.skin), weigh_arm),
                _blob((0.800, 1.388, 0.002), (0.036, 0.033 * f, 0.046), grid, dark, follow("L_Hand"), 2.8),
                _blob((0.770, 1.376, 0.036), (0.034, 0.014, 0.016), grid, dark, follow("L_Hand")),
            ]
        else:
            found = [
                _blob((0.752, 1.399, 0.0), (0.064, 0.017 * f, 0.043 * f), grid, plain(look.skin), weigh_arm, 2.5),
                _blob((0.828, 1.398, -0.001), (0.052, 0.013 * f, 0.037 * f), grid, dark, follow("L_Hand"), 2.5, 2.2),
                _blob((0.765, 1.392, 0.046), (0.036, 0.012, 0.013), grid, dark, follow("L_Hand"), 2.0, 1.0),
            ]
        parts += [p if side == "left" else mirrored(p) for p in found]
    return parts


def neck(look: BodyLook, fine: float) -> Part:
    """From inside of the collar to under the jaw."""
    f = 1.0 if look.build == "man" else 0.85
    rows = [
        (1.400, 0.0, -0.022, 0.100 * f, 0.058),
        (1.440, 0.0, -0.022, 0.090 * f, 0.055),
        (1.470, 0.0, -0.018, 0.072 * f, 0.054 * f),
        (1.505, 0.0, -0.009, 0.063 * f, 0.061 * f),
        (1.560, 0.0, 0.004, 0.060 * f, 0.063 * f),
        (1.620, 0.0, 0.010, 0.059 * f, 0.063 * f),
    ]
    paint = shaded(plain(look.skin), lambda s, a: 1.0 - 0.35 * step(1.50, 1.57, s) * (0.5 + 0.5 * np.sin(a)))
    tube = Tube(axis=1, keys=ring_keys(rows))
    return surface(tube.at, (1.41, 1.62), (max(5, round(8 * fine)), max(8, round(14 * fine))), paint, weigh_trunk)


def trunk_keys(look: BodyLook) -> np.ndarray:
    """The trunk's outline under its shirt: place, centre, radii."""
    if look.build == "man":
        rows = [
            (0.780, 0.0, -0.008, 0.168, 0.168, 0.118, 0.130),
            (0.880, 0.0, -0.008, 0.168, 0.168, 0.116, 0.130),
            (0.960, 0.0, -0.006, 0.158, 0.158, 0.108, 0.112),
            (1.040, 0.0, -0.004, 0.151, 0.151, 0.106, 0.096),
            (1.120, 0.0, -0.004, 0.156, 0.156, 0.108, 0.098),
            (1.200, 0.0, -0.004, 0.168, 0.168, 0.118, 0.108),
            (1.270, 0.0, -0.006, 0.178, 0.178, 0.127, 0.116),
            (1.330, 0.0, -0.010, 0.184, 0.184, 0.122, 0.116),
            (1.380, 0.0, -0.014, 0.186, 0.186, 0.102, 0.108),
            (1.425, 0.0, -0.018, 0.178, 0.178, 0.080, 0.092),
            (1.452, 0.0, -0.020, 0.146, 0.146, 0.070, 0.078),
            (1.474, 0.0, -0.020, 0.108, 0.108, 0.065, 0.070),
            (1.494, 0.0, -0.017, 0.080, 0.080, 0.063, 0.066),
            (1.510, 0.0, -0.013, 0.068, 0.068, 0.062, 0.064),
        ]
    else:
        rows = [
            (0.780, 0.0, -0.008, 0.178, 0.178, 0.116, 0.136),
            (0.880, 0.0, -0.008, 0.174, 0.174, 0.112, 0.134),
            (0.960, 0.0, -0.006, 0.150, 0.150, 0.098, 0.110),
            (1.040, 0.0, -0.004, 0.130, 0.130, 0.092, 0.088),
            (1.120, 0.0, -0.004, 0.132, 0.132, 0.092, 0.086),
            (1.190, 0.0, -0.004, 0.144, 0.144, 0.104, 0.094),
            (1.255, 0.0, -0.006, 0.154, 0.154, 0.134, 0.102),
            (1.310, 0.0, -0.010, 0.160, 0.160, 0.122, 0.104),
            (1.370, 0.0, -0.014, 0.160, 0.160, 0.090, 0.098),
            (1.420, 0.0, -0.018, 0.160, 0.160, 0.070, 0.086),
            (1.448, 0.0, -0.020, 0.128, 0.128, 0.062, 0.074),
            (1.470, 0.0, -0.019, 0.092, 0.092, 0.057, 0.064),
            (1.490, 0.0, -0.016, 0.068, 0.068, 0.055, 0.060),
            (1.506, 0.0, -0.012, 0.057, 0.057, 0.054, 0.058),
        ]
    keys = ring_keys(rows)
    if look.top in BARE_ARMS:  # cut out for the arms
        keys[:, 3:5] *= np.interp(keys[:, :1], [1.30, 1.39, 1.46, 1.50], [1.0, 0.88, 0.92, 1.0])
    return keys
