"""A racket as a mesh, from its measures, and how a hand holds it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_models.synthesis.insertions import InsertedMesh, inserted_mesh
from pgm_models.synthesis.meshes import Mesh, distance_grid, joined_meshes

Hand = Literal["left", "right"]


@dataclass(frozen=True, kw_only=True)
class RacketMeasures:
    """Of a racket as ITF rules allow it and players use it; all in metres unless said."""

    length: float = 0.685
    """Butt to tip."""
    head: tuple[float, float] = (0.340, 0.262)
    """Length and width of the head, the frame included."""
    frame: tuple[float, float] = (0.013, 0.024)
    """The frame's tube: width in the plane of the strings, and depth off it."""
    grip: tuple[float, float] = (0.190, 0.033)
    """Length and thickness."""
    shaft: float = 0.022
    """Thickness above the grip."""
    bed: float = 0.008
    """Thickness of what stands for the strings."""
    bed_opacity: float = 0.3
    """Share of what is behind them that strings hide, seen face on, 0 to 1."""
    rounds: int = 48
    """Pieces of the frame along the head."""

    @property
    def bed_density(self) -> float:
        """What gives the bed its opacity, 1/m."""
        return float(-np.log1p(-self.bed_opacity) / self.bed)


def racket_frame(measures: RacketMeasures) -> Mesh:
    """Frame, throat, shaft and grip: y from the butt at 0 to the tip, x across the head, z off the face.

    Raises:
        ValueError: If the measures leave no strings, or no shaft.
    """
    strung, middle = _strung(measures)
    tube = np.array(measures.frame) / 2
    s = 2 * np.pi * np.arange(measures.rounds) / measures.rounds
    radii = np.stack([strung[1] + tube[0], strung[0] + tube[0]])
    centres = np.stack([radii[0] * np.sin(s), middle + radii[1] * np.cos(s), np.zeros_like(s)], axis=1)
    outward = np.stack([radii[1] * np.sin(s), radii[0] * np.cos(s), np.zeros_like(s)], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    hoop = _ring(centres, outward, tube)
    fork = middle - radii[1]  # where the head begins
    throat = min(fork - 0.4 * (fork - measures.grip[0]), fork - 0.02)
    grip = _bar((0.0, 0.0), (0.0, measures.grip[0]), (measures.grip[1] / 2, measures.grip[1] / 2))
    shaft = _bar((0.0, 0.9 * measures.grip[0]), (0.0, throat), (measures.shaft / 2, measures.shaft / 2))
    turn = np.radians(145.0)  # where the arms of the throat reach the head, from its tip
    reach = (float(radii[0] * np.sin(turn)), float(middle + radii[1] * np.cos(turn)))
    foot = throat - measures.shaft / 2
    arms = [_bar((side * 0.004, foot), (side * reach[0], reach[1]), (0.009, float(tube[0]))) for side in (-1, 1)]
    return joined_meshes([hoop, grip, shaft, *arms])


def racket_bed(measures: RacketMeasures) -> Mesh:
    """What stands for the strings: a thin plate in the frame, axes as of `racket_frame`.

    Raises:
        ValueError: As `racket_frame`.
    """
    strung, middle = _strung(measures)
    s = 2 * np.pi * np.arange(measures.rounds) / measures.rounds
    tube = measures.frame[0] / 2
    rim = np.stack([(strung[1] + tube) * np.sin(s), middle + (strung[0] + tube) * np.cos(s)], axis=1)
    half = measures.bed / 2
    rings = [np.column_stack([rim, np.full(len(s), z)]) for z in (half, -half)]
    return _closed(rings, np.array([[0.0, middle, half], [0.0, middle, -half]]))


def inserted_racket(
    measures: RacketMeasures,
    *,
    frame: tuple[float, float, float] = (0.12, 0.12, 0.14),
    bed: tuple[float, float, float] = (0.75, 0.75, 0.7),
    cell: float = 0.005,
) -> tuple[InsertedMesh, InsertedMesh]:
    """Frame and strings, to be rendered where `held_by` says; they hide what is behind them as measures say.

    Args:
        measures: Of the racket.
        frame: Colour, RGB 0 to 1.
        bed: Colour of the strings.
        cell: Of the frame's grid, metres; that of the strings is half as thick as they are.
    """
    solid = distance_grid(racket_frame(measures), cell)
    strings = distance_grid(racket_bed(measures), measures.bed / 2)
    return (
        inserted_mesh(solid, colour=frame),
        inserted_mesh(strings, colour=bed, density=measures.bed_density),
    )


def held_by(
    hand: Hand, *, held: float = 0.075, out: float = 0.3
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Rotation and translation of joint_from_mesh for a racket in the hand of a skeleton with arms out at rest.

    The shaft runs forward (z), past the thumb, and `out` of it along the fingers; the face looks where the palm does
    (-y).

    Args:
        hand: Which.
        held: From the butt to the joint of the hand, metres.
        out: Metres along the fingers for a metre forward.
    """
    along = np.array([out if hand == "left" else -out, 0.0, 1.0])
    along /= np.linalg.norm(along)
    face = np.array([0.0, -1.0, 0.0])
    R_joint_from_mesh = np.stack([np.cross(along, face), along, face], axis=1)
    return R_joint_from_mesh, -held * along


def _strung(measures: RacketMeasures) -> tuple[Float[np.ndarray, " 2"], float]:
    """Half length and half width of the strings, and how far their middle is from the butt."""
    strung = np.array(measures.head) / 2 - measures.frame[0]
    middle = measures.length - measures.head[0] / 2
    if not (strung > 0).all():
        raise ValueError(
            f"frame: expected one that leaves strings in a head of {measures.head} m, got {measures.frame}"
        )
    if not middle - measures.head[0] / 2 > measures.grip[0]:
        raise ValueError(
            f"length: expected room for a shaft above the grip of {measures.grip[0]} m, got {measures.length}"
        )
    return strung, middle


def _ring(
    centres: Float[np.ndarray, "rounds 3"],
    outward: Float[np.ndarray, "rounds 3"],
    half: Float[np.ndarray, " 2"],
    pieces: int = 8,
) -> Mesh:
    """A tube along a closed line in the plane z = 0, run clockwise seen from +z."""
    turn = 2 * np.pi * np.arange(pieces) / pieces
    up = np.array([0.0, 0.0, 1.0])
    points = (
        centres[:, None] + half[0] * np.cos(turn)[:, None] * outward[:, None] + half[1] * np.sin(turn)[:, None] * up
    )
    triangles = _quads(len(centres), pieces, closed=True)
    return Mesh(vertices=points.reshape(-1, 3), triangles=triangles)


def _bar(start: tuple[float, float], end: tuple[float, float], half: tuple[float, float], pieces: int = 8) -> Mesh:
    """A round bar between two places of the plane z = 0, as thick as said at either end."""
    ends = np.array([[*start, 0.0], [*end, 0.0]])
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    aside = np.array([-along[1], along[0], 0.0])
    turn = 2 * np.pi * np.arange(pieces) / pieces
    round_ = np.cos(turn)[:, None] * aside + np.sin(turn)[:, None] * np.cross(along, aside)
    return _closed([place + width * round_ for place, width in zip(ends, half, strict=True)], ends)


def _closed(rings: list[np.ndarray], ends: Float[np.ndarray, "2 3"]) -> Mesh:
    """A tube through two rings of points, closed at its ends; the rings turn left seen along the tube."""
    pieces = len(rings[0])
    first, last = 2 * pieces, 2 * pieces + 1
    here, next_ = np.arange(pieces), (np.arange(pieces) + 1) % pieces
    caps = [
        np.stack([np.full(pieces, first), next_, here], axis=1),
        np.stack([np.full(pieces, last), pieces + here, pieces + next_], axis=1),
    ]
    triangles = np.concatenate([_quads(2, pieces, closed=False), *caps])
    return Mesh(vertices=np.concatenate([*rings, ends]), triangles=triangles)


def _quads(rounds: int, pieces: int, *, closed: bool) -> np.ndarray:
    """Two triangles for each four neighbours of a tube's points, round by round."""
    i, j = (grid.ravel() for grid in np.indices((rounds if closed else rounds - 1, pieces)))
    here, on = i, (i + 1) % rounds
    left = (j + 1) % pieces
    a, b, c, d = here * pieces + j, on * pieces + j, on * pieces + left, here * pieces + left
    return np.concatenate([np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)])
