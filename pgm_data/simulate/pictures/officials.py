"""Umpire, line judges and ball kids: bodies that stand, crouch or sit about the court."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import Figure, draw_figure, smpl24, world_from_joints
from pgm_data.simulate.pictures.body_mesh import SkinnedBody, build_body
from pgm_data.simulate.pictures.looks import draw_look
from pgm_data.simulate.rotations import about, facing

Role = Literal["umpire", "line_judge", "ball_kid"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Official:
    """Somebody who does not move."""

    body: SkinnedBody
    R_world: Float[np.ndarray, "24 3 3"]
    t_world: Float[np.ndarray, "24 3"]

    @property
    def stands(self) -> bool:
        """On the ground, not in the high chair."""
        return bool(self.t_world[0, 2] < 1.4)

    @property
    def place(self) -> np.ndarray:
        """World metres, of the pelvis."""
        return self.t_world[0]


def draw_officials(
    rng: np.random.Generator,
    half_size: tuple[float, float],
    walls: tuple[float, float],
    seat: Float[np.ndarray, " 3"] | None,
) -> tuple[Official, ...]:
    """A court's officials by lot: lines at the far wall and at both sides, kids at the net and in the corners.

    `half_size`: of the playing surface; `walls`: of the space between the hoardings, metres.
    """
    half_x, half_y = half_size
    wall_x, wall_y = walls
    line_judges, kids = bool(rng.random() < 0.5), bool(rng.random() < 0.9)
    places: list[tuple[Role, float, float]] = []
    aside = min(wall_x - 0.6, 0.75 * half_x)

    def place(role: Role, x: float, y: float) -> None:
        places.append((role, float(x), float(y)))

    if line_judges:
        for x in ((-4.1, 0.0, 4.1), (-5.5, 5.5), (-4.1, 4.1))[int(rng.integers(3))]:
            place("line_judge", x + rng.normal(0, 0.2), wall_y - rng.uniform(0.5, 0.9))
        for side in (-1.0, 1.0):
            place("line_judge", side * (wall_x - 0.6), rng.choice([-1.0, 1.0]) * rng.uniform(0.32, 0.65) * half_y)
    if kids:
        for side in (-1.0, 1.0):
            place("ball_kid", side * aside, wall_y - 0.7)
            place("ball_kid", side * aside, 0.7 - wall_y)
            # Not where the umpire's chair stands.
            if rng.random() < 0.7 and (seat is None or seat[0] * side < 0.0):
                place("ball_kid", side * min(wall_x - 0.6, 6.9), 0.25)
    looks = {role: draw_look(rng, role, white=False) for role in ("umpire", "line_judge", "ball_kid")}
    bodies: dict[Role, list[tuple[Figure, SkinnedBody]]] = {}
    people = []
    if seat is not None:
        figure = _shorter(draw_figure(rng, "right"), 0.97)
        body = build_body(figure, looks["umpire"], racket=False, detail="coarse")
        people.append(_sitting(rng, seat, figure, body))
    for role, x, y in places:
        # Three people a role, in one uniform, are enough: nobody sees more at this size.
        known = bodies.setdefault(role, [])
        if len(known) < 3:
            figure = _shorter(draw_figure(rng, "right"), rng.uniform(0.8, 0.9) if role == "ball_kid" else 0.97)
            person = draw_look(rng, role, white=False)
            look = replace(
                looks[role],
                build=person.build,
                skin=person.skin,
                hair=person.hair,
                hair_colour=person.hair_colour,
                beard=person.beard,
                headwear=person.headwear,
            )
            known.append((figure, build_body(figure, look, racket=False, detail="coarse")))
        people.append(
            _standing(rng, np.array([x, y, 0.0]), *known[-1 if len(known) < 3 else int(rng.integers(3))], role)
        )
    return tuple(people)


def _shorter(figure: Figure, factor: float) -> Figure:
    return Figure(
        translations=figure.translations * factor,
        height_m=figure.height_m * factor,
        girth=figure.girth,
        hand=figure.hand,
    )


def _towards_middle(place: np.ndarray) -> float:
    """The heading in which somebody at this place looks at the court's middle."""
    return float(np.arctan2(place[0], -place[1]))


def _standing(rng: np.random.Generator, place: np.ndarray, figure: Figure, body: SkinnedBody, role: Role) -> Official:
    R = _arms_down(rng)
    names = smpl24().joint_names
    drop = 0.0
    kind = rng.random()
    if role == "line_judge" and kind < 0.5:  # hands on the knees
        lean, bend = rng.uniform(0.55, 0.8), rng.uniform(0.35, 0.55)
        drop = _bend_knees(R, figure, bend)
        R[names.index("Torso")] = about(0, lean)
        for side, sign in (("L_", 1.0), ("R_", -1.0)):
            R[names.index(side + "Shoulder")] = about(0, -lean - 0.35) @ about(2, -sign * 1.25)
    elif kind < 0.8:  # hands together before the body
        for side, sign in (("L_", 1.0), ("R_", -1.0)):
            R[names.index(side + "Shoulder")] = about(0, -0.25) @ about(1, -sign * 0.3) @ about(2, -sign * 1.3)
            R[names.index(side + "Elbow")] = about(1, -sign * 0.75)
    height = float(figure.translations[0, 1]) - drop
    R[0] = facing(_towards_middle(place) + rng.normal(0, 0.15))
    return _placed(figure, body, R, place + np.array([0.0, 0.0, height]))


def _sitting(rng: np.random.Generator, seat: np.ndarray, figure: Figure, body: SkinnedBody) -> Official:
    R = _arms_down(rng)
    names = smpl24().joint_names
    for side, sign in (("L_", 1.0), ("R_", -1.0)):
        R[names.index(side + "Hip")] = about(0, -1.45)
        R[names.index(side + "Knee")] = about(0, 1.45)
        R[names.index(side + "Shoulder")] = about(0, -0.35) @ about(2, -sign * 1.35)
        R[names.index(side + "Elbow")] = about(1, -sign * 0.8)
    R[0] = facing(_towards_middle(np.array([seat[0], 0.0, 0.0])))
    return _placed(figure, body, R, seat + np.array([0.0, 0.0, 0.12]))


def _arms_down(rng: np.random.Generator) -> np.ndarray:
    R = np.tile(np.eye(3), (24, 1, 1))
    names = smpl24().joint_names
    for side, sign in (("L_", 1.0), ("R_", -1.0)):
        R[names.index(side + "Shoulder")] = about(2, -sign * rng.uniform(1.25, 1.4))
        R[names.index(side + "Elbow")] = about(1, -sign * rng.uniform(0.1, 0.4))
    return R


def _bend_knees(R: np.ndarray, figure: Figure, angle: float) -> float:
    """Bends hips, knees and ankles by so many radians, in place; how far the pelvis sinks, metres."""
    names = smpl24().joint_names
    for side in ("L_", "R_"):
        R[names.index(side + "Hip")] = about(0, -angle)
        R[names.index(side + "Knee")] = about(0, 2 * angle)
        R[names.index(side + "Ankle")] = about(0, -angle)
    legs = figure.translations[names.index("L_Knee"), 1] + figure.translations[names.index("L_Ankle"), 1]
    return float(-legs * (1.0 - np.cos(angle)))


def _placed(figure: Figure, body: SkinnedBody, rotations: np.ndarray, pelvis: np.ndarray) -> Official:
    R, t = world_from_joints(figure, pelvis[None], rotations[None])
    return Official(body=body, R_world=R[0], t_world=t[0])
