"""People by lot to put into pictures: players in the postures of play, and all who do not play."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Scene
from pgm_data.simulate.body.figure import Figure, draw_figure, smpl24, world_from_joints
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.pictures.body_mesh import SkinnedBody, build_body, drawn_body
from pgm_data.simulate.pictures.looks import draw_look
from pgm_data.simulate.pictures.officials import Official, draw_officials
from pgm_data.simulate.pictures.raster import draw_triangles, shadow
from pgm_data.simulate.rotations import facing
from pgm_data.simulate.tennis.film import PLAYS, recording_of
from pgm_data.simulate.tennis.match import plays
from pgm_data.simulate.tennis.truth import body_of
from pgm_models.detectors.person_backdrops import SIZE, Backdrop

Part = Literal["plays", "official", "seated"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Dressed:
    """A body and its build."""

    figure: Figure
    body: SkinnedBody


@dataclass(frozen=True, eq=False, kw_only=True)
class Posture:
    """One moment of a body in play."""

    rotations: Float[np.ndarray, "24 3 3"]
    """R_parent_from_joint; entry 0 is R_world_from_root."""
    height: float
    """Of the root over the ground, as a share of the figure's when it stands."""
    near: bool
    """Seen at the near end, from behind."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Cast:
    """All who may be put into a picture."""

    players: tuple[Dressed, ...]
    others: tuple[Dressed, ...]
    """In the clothes of officials and ball kids, who may be in any posture; without a racket."""
    postures: tuple[Posture, ...]
    officials: tuple[tuple[Official, ...], ...]
    """Sets as they stand about a court."""


def draw_cast(seed: int, scene: Scene, *, players: int, others: int, officials: int, matches: int) -> Cast:
    """People by lot: so many bodies, sets of officials, and matches of which postures are taken.

    Raises:
        ValueError: If the scene has no court.
    """
    if scene.court is None:
        raise ValueError(f"scene {scene.name}: expected a court, got none")
    rng = np.random.default_rng([seed, 0])
    half_size = scene.court.surface_half_size

    def dressed(role: Literal["player", "umpire", "line_judge", "ball_kid"]) -> Dressed:
        figure = draw_figure(rng, "left" if rng.random() < 0.15 else "right")
        look = draw_look(rng, role, white=bool(rng.random() < 0.15))
        return Dressed(figure=figure, body=build_body(figure, look, racket=role == "player", detail="coarse"))

    return Cast(
        players=tuple(dressed("player") for _ in range(players)),
        others=tuple(dressed(("line_judge", "ball_kid", "umpire")[k % 3]) for k in range(others)),
        postures=tuple(p for match in range(matches) for p in _postures(scene, seed, match)),
        officials=tuple(draw_officials(rng, half_size, half_size, np.array([7.5, 0.0, 1.9])) for _ in range(officials)),
    )


def _postures(scene: Scene, seed: int, match: int, each: int = 60) -> list[Posture]:
    """Postures of both players of the first plays of a match."""
    number = int(np.random.SeedSequence([seed, 1, match]).generate_state(1)[0])
    recording = recording_of(scene, ClipOptions(quality="draft"), number)
    found: list[Posture] = []
    rng = np.random.default_rng([number, 2])
    for count, play in enumerate(plays(recording.match, np.random.default_rng([number, PLAYS]))):
        times = np.sort(rng.uniform(0.0, play.duration_s, each))
        for player in (0, 1):
            track = body_of(play, player, times)
            standing = play.athletes[player].figure.translations[0, 1]
            found += [
                Posture(
                    rotations=track.rotations[i],
                    height=float(track.root_position[i, 2] / standing),
                    near=bool(track.root_position[i, 1] < 0.0),
                )
                for i in range(each)
            ]
        if count == 2:
            break
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Standing:
    """One person in a picture."""

    part: Part
    ground: Float[np.ndarray, " 2"]
    """World x and y of the middle between the ankles, metres."""
    vertices: Float[np.ndarray, "vertices 3"]
    """World places of the body's surface, without the racket's, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """One person about to be drawn."""

    part: Part
    body: SkinnedBody
    R_world: Float[np.ndarray, "24 3 3"]
    t_world: Float[np.ndarray, "24 3"]


def place_people(rng: np.random.Generator, cast: Cast, backdrop: Backdrop) -> list[Body]:
    """People by lot on an empty court."""
    people = [_player(rng, cast, end) for end in (-1.0, 1.0)]
    people += [_player(rng, cast, 0.0) for _ in range(int(rng.integers(0, 3)))]
    people += [_wanderer(rng, cast) for _ in range(int(rng.integers(0, 2)))]
    if rng.random() < 0.9:
        chosen = cast.officials[int(rng.integers(len(cast.officials)))]
        for official in chosen:
            if official.stands or backdrop.seat is not None:
                people.append(_official(rng, official, backdrop))
    return people


def _player(rng: np.random.Generator, cast: Cast, end: float) -> Body:
    """A player at that end, or anywhere where it is 0."""
    dressed = cast.players[int(rng.integers(len(cast.players)))]
    posture = cast.postures[int(rng.integers(len(cast.postures)))]
    if end and rng.random() < 0.8:
        while posture.near != (end < 0.0):
            posture = cast.postures[int(rng.integers(len(cast.postures)))]
    place = np.array([rng.normal(0, 3.5), end * rng.uniform(1.0, 18.0)])
    if end and rng.random() < 0.6:
        place[1] = end * rng.normal(12.8, 1.2)
    if not end:
        place = rng.uniform([-10.0, -18.0], [10.0, 19.0])
    return _posed(rng, "plays", dressed, posture, place, turned=bool(rng.random() < (0.3 if end else 0.8)))


def _wanderer(rng: np.random.Generator, cast: Cast) -> Body:
    dressed = cast.others[int(rng.integers(len(cast.others)))]
    posture = cast.postures[int(rng.integers(len(cast.postures)))]
    place = rng.uniform([-10.0, -18.0], [10.0, 19.0])
    return _posed(rng, "official", dressed, posture, place, turned=True)


def _posed(
    rng: np.random.Generator, part: Part, dressed: Dressed, posture: Posture, place: np.ndarray, *, turned: bool
) -> Body:
    rotations = posture.rotations.copy()
    if turned:
        rotations[0] = _upright(rng.uniform(-np.pi, np.pi)) @ rotations[0]
    height = posture.height * dressed.figure.translations[0, 1]
    R, t = world_from_joints(dressed.figure, np.array([[*place, height]]), rotations[None])
    return Body(part=part, body=dressed.body, R_world=R[0], t_world=t[0])


def _upright(angle: float) -> np.ndarray:
    """A turn about the world's vertical."""
    return facing(angle) @ facing(0.0).T


def _official(rng: np.random.Generator, official: Official, backdrop: Backdrop) -> Body:
    """An official as it stands at this court's walls, or anywhere and turned."""
    R, t = official.R_world, official.t_world
    if not official.stands:
        assert backdrop.seat is not None
        side = np.sign(backdrop.seat[0]) * np.sign(official.place[0])
        if side < 0:
            turn = _upright(np.pi)
            R, t = turn @ R, (t - official.place) @ turn.T + official.place
        return Body(part="seated", body=official.body, R_world=R, t_world=t - t[0] + backdrop.seat + [0.0, 0.0, 0.12])
    place = official.place[:2] * np.array(backdrop.walls) / np.array([9.15, 18.3])
    if rng.random() < 0.2:
        place = rng.uniform([-10.0, -18.0], [10.0, 19.0])
        turn = _upright(rng.uniform(-np.pi, np.pi))
        R, t = turn @ R, (t - official.place) @ turn.T + official.place
    return Body(part="official", body=official.body, R_world=R, t_world=t + [*(place - official.place[:2]), 0.0])


ANKLES = tuple(smpl24().joint_names.index(name) for name in ("L_Ankle", "R_Ankle"))


def draw_people(
    picture: np.ndarray, people: Sequence[Body], backdrop: Backdrop, rng: np.random.Generator
) -> list[Standing]:
    """Who is drawn into the picture, BGR uint8, which is changed; the furthest first."""
    view = backdrop.view
    away = [np.linalg.norm(person.t_world[0] - view.centre_world) for person in people]
    order = np.argsort(away)[::-1]
    ahead = view.R_cam_from_world[2]
    shaded = rng.random() < 0.75
    drawn: list[Standing] = []
    for k in order:
        person = people[k]
        if (person.t_world[0] - view.centre_world) @ ahead < 2.0:
            continue
        mesh = drawn_body(person.body, person.R_world, person.t_world, backdrop.light, view.centre_world)
        if shaded:
            solid = person.body.triangles[person.body.opacity > 0.5]
            for thrown, strength in backdrop.thrown:
                _blend(picture, shadow(mesh.vertices, solid, thrown, 0.0, view, SIZE, 1), strength, dark=True)
        sprite = draw_triangles(mesh, view, SIZE, 2)
        if sprite is None:
            continue
        _blend(picture, sprite, 1.0, dark=False)
        racket = np.zeros(len(mesh.vertices), bool)
        racket[person.body.triangles[person.body.labels == 1].ravel()] = True
        drawn.append(
            Standing(
                part=person.part,
                ground=person.t_world[list(ANKLES), :2].mean(axis=0),
                vertices=np.asarray(mesh.vertices[~racket], dtype=float),
            )
        )
    return drawn


def _blend(picture: np.ndarray, sprite, strength: float, *, dark: bool) -> None:
    """Lay a sprite, or a shadow, over a picture of bytes, in place."""
    if sprite is None:
        return
    high, wide = sprite.alpha.shape
    x0, y0 = max(sprite.x0, 0), max(sprite.y0, 0)
    x1, y1 = min(sprite.x0 + wide, picture.shape[1]), min(sprite.y0 + high, picture.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    part = np.s_[y0 - sprite.y0 : y1 - sprite.y0, x0 - sprite.x0 : x1 - sprite.x0]
    alpha = strength * sprite.alpha[part][..., None]
    under = picture[y0:y1, x0:x1].astype(np.float32)
    paint = under * (1.0 - alpha) if dark else under + alpha * (sprite.bgr[part] - under)
    picture[y0:y1, x0:x1] = np.clip(paint, 0, 255).astype(np.uint8)
