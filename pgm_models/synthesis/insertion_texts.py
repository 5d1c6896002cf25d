"""What a user writes to have a mesh inserted: a racket in a hand, or the mesh of a file on a joint or in the world."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pgm_data.scene import Scene
from pgm_data.skeleton import Skeleton
from pgm_models.synthesis.insertions import InsertedMesh, Insertion, inserted_mesh
from pgm_models.synthesis.mesh_files import read_mesh
from pgm_models.synthesis.meshes import distance_grid
from pgm_models.synthesis.rackets import Hand, RacketMeasures, held_by, inserted_racket

CELLS = 64
"""Of the grid of a file's mesh along its longest side."""
GREY = (0.5, 0.5, 0.5)
"""Colour of a file's mesh unless the text says another."""
SIDES: dict[str, Hand] = {"l": "left", "left": "left", "r": "right", "right": "right"}
"""By the first word of a joint's name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Place:
    """A place of a player's body."""

    player: str
    skeleton: Skeleton
    joint: int
    offset: Float[np.ndarray, " 3"]
    """From the joint, in its frame, metres."""


def inserted_of(text: str, scene: Scene) -> Insertion:
    """What a text says is inserted.

    - `player0=right_wrist`: a racket in the hand at the end of that arm;
    - `FILE@player0:right_wrist`: the mesh of an OBJ, STL or PLY file, in metres, its axes those of that joint;
    - `FILE@1.5,-3,0`: the same at that place of the world, in metres, its axes those of the world;
    - either of the last two with `#rrggbb` after it, for its colour.

    Places of a body are joints and points of the skeleton, in small letters or large.

    Raises:
        ValueError: If it says anything else, there is no such player or joint, or the mesh is not watertight; names the
            part of the text.
        OSError: If the file cannot be read.
    """
    if "@" in text:
        file, _, where = text.rpartition("@")
        return _of_file(Path(file), where, scene)
    player, found, name = text.partition("=")
    if not found:
        raise ValueError(f"{text}: expected PLAYER=JOINT for a racket, or FILE@PLAYER:JOINT or FILE@X,Y,Z for a mesh")
    place = _place(player, name, scene)
    word = place.skeleton.joint_names[place.joint].lower().split("_")[0]
    if word not in SIDES:
        raise ValueError(f"{text}: expected a joint of the left or of the right arm to hold a racket, got {name}")
    R, t = held_by(SIDES[word])
    return Insertion(meshes=_racket(), player=player, joint=_hand(place.skeleton, place.joint), R=R, t=t)


@lru_cache(maxsize=1)
def _racket() -> tuple[InsertedMesh, InsertedMesh]:
    """The one that all players hold: its grids take seconds."""
    return inserted_racket(RacketMeasures())


def _of_file(path: Path, where: str, scene: Scene) -> Insertion:
    where, _, colour = where.partition("#")
    player, found, name = where.partition(":")
    place = _place(player, name, scene) if found else None
    spot = _numbers(where) if place is None else place.offset
    mesh = read_mesh(path)
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    try:
        grid = distance_grid(mesh, longest / CELLS)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Insertion(
        meshes=(inserted_mesh(grid, colour=_colour(colour) if colour else GREY),),
        player="" if place is None else place.player,
        joint=0 if place is None else place.joint,
        R=np.eye(3),
        t=np.array(spot),
    )


def _place(player: str, name: str, scene: Scene) -> _Place:
    skeletons = {each.name: each.skeleton for each in scene.players}
    skeleton = skeletons.get(player)
    if skeleton is None:
        known = ", ".join(skeletons) or "none"
        raise ValueError(f"{player}:{name}: expected a player of the scene {scene.name} ({known}), got {player!r}")
    joints = {joint.lower(): (number, np.zeros(3)) for number, joint in enumerate(skeleton.joint_names)}
    points = zip(skeleton.point_names, skeleton.point_joints.tolist(), skeleton.point_offsets, strict=True)
    places = {point.lower(): (joint, offset) for point, joint, offset in points} | joints
    if name.lower() not in places:
        known = ", ".join([*skeleton.joint_names, *(p for p in skeleton.point_names if p.lower() not in joints)])
        raise ValueError(f"{player}:{name}: expected a joint of {skeleton.name} ({known}), got {name!r}")
    joint, offset = places[name.lower()]
    return _Place(player=player, skeleton=skeleton, joint=joint, offset=offset)


def _hand(skeleton: Skeleton, joint: int) -> int:
    """The last joint of the chain that a joint begins."""
    children = np.flatnonzero(skeleton.parents == joint)
    return joint if len(children) != 1 else _hand(skeleton, int(children[0]))


def _numbers(text: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise ValueError(f"{text}: expected PLAYER:JOINT, or X,Y,Z of the world in metres")
    return numbers


def _colour(text: str) -> tuple[float, float, float]:
    try:
        red, green, blue = bytes.fromhex(text)
    except ValueError as error:
        raise ValueError(f"#{text}: expected a colour such as #ff8000") from error
    return red / 255, green / 255, blue / 255
