"""The racket as a mesh that moves with the hand, placed by the axes of `body.racket`."""

import numpy as np

from pgm_data.simulate.body.figure import Hand
from pgm_data.simulate.body.racket import BUTT_M, FACE_NORMAL, HEAD_HALF_M, SWEET_SPOT_M, shaft_axis
from pgm_data.simulate.pictures.body_shape import REST
from pgm_data.simulate.pictures.loft import JOINT, RACKET, Part, follow, part_of, surface
from pgm_data.simulate.pictures.looks import BodyLook

TUBE_M = 0.011
"""Half the width of the frame's tube."""
STRING_OPACITY = 0.30


def racket(look: BodyLook, hand: Hand, fine: float) -> list[Part]:
    """Grip, shaft, frame and strings at rest in one hand."""
    frame, pattern, strings = look.racket
    joint = ("L_" if hand == "left" else "R_") + "Hand"
    origin, along = REST[JOINT[joint]], shaft_axis(hand)
    across = np.cross(along, FACE_NORMAL)
    weigh = follow(joint)

    def place(a: np.ndarray, c: np.ndarray, n: np.ndarray) -> np.ndarray:
        """World at rest of distances along the shaft, across it and off the face."""
        return origin + a[..., None] * along + c[..., None] * across + n[..., None] * FACE_NORMAL

    def hoop(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        r, t = TUBE_M * np.cos(angle), TUBE_M * 1.1 * np.sin(angle)
        half, wide = HEAD_HALF_M[0] + 0.006 + r, HEAD_HALF_M[1] + 0.006 + r
        return place(SWEET_SPOT_M + half * np.cos(s), wide * np.sin(s), t)

    def hoop_paint(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
        marked = np.abs(np.sin(s)) * np.where(np.cos(s) > 0, 1.0, 0.0) > 0.55
        return np.where(marked[..., None], pattern, frame) * np.ones((*np.shape(s), 3))

    def stick(start: tuple[float, float], end: tuple[float, float], width: tuple[float, float], colour) -> Part:
        """A bar between two places (along, across)."""

        def points(s: np.ndarray, angle: np.ndarray) -> np.ndarray:
            w = np.where((s <= 0) | (s >= 1), 0.0, width[0] + (width[1] - width[0]) * s)
            a = start[0] + s * (end[0] - start[0])
            c = start[1] + s * (end[1] - start[1]) + w * np.cos(angle)
            return place(a, c, w * 1.15 * np.sin(angle))

        caps = [1e-6, 1.0 - 1e-6]
        return surface(
            points,
            (0.0, 1.0),
            (6, 8),
            lambda s, a: np.broadcast_to(colour, (*np.shape(s), 3)),
            weigh,
            breaks=(caps, ()),
        )

    throat = SWEET_SPOT_M - HEAD_HALF_M[0] * 0.80
    joints = (0.155, 0.0)
    rounds = max(14, round(30 * fine))
    parts = [
        surface(hoop, (0.0, 2 * np.pi), (rounds, 6), hoop_paint, weigh),
        stick(
            (BUTT_M, 0.0),
            (0.115, 0.0),
            (0.0175, 0.0155),
            np.minimum(frame * 0.4 + 20.0, 90.0) if frame.mean() > 60 else np.full(3, 215.0),
        ),
        stick((0.11, 0.0), (0.165, 0.0), (0.0135, 0.0125), frame),
        stick((joints[0], 0.006), (throat, 0.066), (0.0105, 0.0105), frame),
        stick((joints[0], -0.006), (throat, -0.066), (0.0105, 0.0105), pattern),
    ]
    turn = np.linspace(0.0, 2 * np.pi, 25)[:-1]
    ring = place(SWEET_SPOT_M + HEAD_HALF_M[0] * np.cos(turn), HEAD_HALF_M[1] * np.sin(turn), np.zeros_like(turn))
    middle = place(np.array([SWEET_SPOT_M]), np.zeros(1), np.zeros(1))
    fan = np.array([[0, 1 + k, 1 + (k + 1) % 24] for k in range(24)])
    bed = part_of(np.concatenate([middle, ring]), fan, np.tile(strings, (25, 1)), weigh, flip=False)
    parts.append(bed)
    return [
        Part(
            vertices=p.vertices,
            normals=p.normals,
            triangles=p.triangles,
            colours=p.colours,
            weights=p.weights,
            label=RACKET,
            opacity=STRING_OPACITY if p is bed else 1.0,
        )
        for p in parts
    ]
