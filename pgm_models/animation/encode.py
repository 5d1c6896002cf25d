"""Columns of the contract as channels of a state, and back."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Shaped

from pgm_data.scene import Scene, load_scene
from pgm_data.skeleton import world_joints
from pgm_models.animation.layout import Constant, Layout, Property
from pgm_models.animation.shards import ABSENT
from pgm_models.animation.tangents import continuous_tangents, rotvec_from_tangent, tangent_from_rotvec


def encode(
    layout: Layout, columns: Mapping[str, Shaped[np.ndarray, "rows ..."]]
) -> tuple[Float[np.ndarray, "rows channels"], Bool[np.ndarray, "rows properties"]]:
    """Channels of rows, NOT standardised, rotations within pi of their references; and what is valid.

    Valid is what is finite and not `none` by its status, where that is among the columns. What is not has zeros.

    Args:
        layout: Properties and their channels.
        columns: By their names in the contract. Properties whose column is not among them are nowhere valid.

    Raises:
        ValueError: If a column has too few numbers.
    """
    rows = len(next(iter(columns.values()))) if columns else 0
    tangent = np.zeros((rows, layout.channels), dtype=np.float32)
    valid = np.zeros((rows, len(layout.properties)), dtype=bool)
    for row, entry in enumerate(layout.properties):
        if entry.column in columns:
            values = _own_numbers(entry, columns[entry.column])
            there = np.isfinite(values).all(axis=1)
            status = columns.get(f"{entry.column.partition('.')[0]}.status")
            if status is not None:
                there &= status != ABSENT
            tangent[there, layout.slice_of(row)] = _channels_of(entry, values[there])
            valid[:, row] = there
    return tangent, valid


def encode_known(
    layout: Layout, column: str, values: Float[np.ndarray, "rows numbers"]
) -> Float[np.ndarray, "rows channels"]:
    """Channels of one property from rows of its whole column, NOT standardised, rotations within pi.

    Raises:
        ValueError: If the layout has no such property, a number is missing or not finite; names row and number.
    """
    entry = layout.properties[layout.row_of(column)]
    numbers = _own_numbers(entry, values)
    bad = np.argwhere(~np.isfinite(numbers))
    if len(bad):
        row, number = bad[0]
        raise ValueError(
            f"{column}: expected finite numbers, got {numbers[row, number]} in row {row}, number {entry.first + number}"
        )
    return _channels_of(entry, numbers).astype(np.float32)


def encode_constants(
    layout: Layout, columns: Mapping[str, Shaped[np.ndarray, "rows ..."]]
) -> Float[np.ndarray, "rows constants"]:
    """Standardised constants of rows; 0, the average, where unknown."""
    rows = len(next(iter(columns.values()))) if columns else 0
    parts = [np.zeros((rows, 0))]
    for entry in layout.constants:
        if entry.column in columns:
            numbers = _own_numbers(entry, columns[entry.column])[:, entry.channels]
            parts.append(np.nan_to_num((numbers - entry.mean) / entry.std))
        else:
            parts.append(np.zeros((rows, len(entry.channels))))
    return np.concatenate(parts, axis=1).astype(np.float32)


def _own_numbers(entry: Property | Constant, column: np.ndarray) -> Float[np.ndarray, "rows width"]:
    values = np.asarray(column, dtype=np.float64).reshape(len(column), -1)
    if values.shape[1] < entry.first + entry.width:
        expected = entry.first + entry.width
        raise ValueError(f"{entry.column}: expected {expected} numbers a row, got {values.shape[1]}")
    return values[:, entry.first : entry.first + entry.width]


def _channels_of(entry: Property, values: Float[np.ndarray, "rows width"]) -> Float[np.ndarray, "rows channels"]:
    if entry.kind == "rotations":
        values = tangent_from_rotvec(values.reshape(len(values), -1, 3), entry.reference).reshape(values.shape)
    return values[:, entry.channels]


def _values_of(entry: Property, numbers: Float[np.ndarray, "rows channels"]) -> Float[np.ndarray, "rows width"]:
    values = np.tile(entry.rest, (len(numbers), 1))
    values[:, entry.channels] = numbers
    if entry.kind == "rotations":
        values = rotvec_from_tangent(values.reshape(len(values), -1, 3), entry.reference).reshape(values.shape)
    return values


def continuous(
    layout: Layout,
    tangent: Float[np.ndarray, "windows frames channels"],
    *,
    valid: Bool[np.ndarray, "windows frames properties"] | None = None,
) -> Float[np.ndarray, "windows frames channels"]:
    """The same rotations, each by the tangent vector nearest to that of the last valid frame before it.

    Each window starts within pi. What is not valid stays as it is.

    Args:
        layout: Properties and their channels.
        tangent: Channels as of `encode`.
        valid: What is; all where None.
    """
    places = [
        (row, np.arange(layout.channels)[layout.slice_of(row)])
        for row, entry in enumerate(layout.properties)
        if entry.kind == "rotations"
    ]
    if not places or not tangent.size:
        return tangent.copy()
    channels = np.concatenate([channels for _, channels in places])
    owners = np.concatenate([np.full(len(channels) // 3, row) for row, channels in places])
    there = np.ones((*tangent.shape[:2], len(owners)), dtype=bool) if valid is None else valid[..., owners]
    result = tangent.copy()
    vectors = tangent[..., channels].reshape(*tangent.shape[:2], -1, 3)
    result[..., channels] = continuous_tangents(vectors, there).reshape(*tangent.shape[:2], -1)
    return result


def continuous_known(
    layout: Layout,
    tangent: Float[np.ndarray, "windows frames channels"],
    known: Bool[np.ndarray, "windows frames properties"],
) -> Float[np.ndarray, "windows frames channels"]:
    """Sparse wanted values made continuous: each rotation by the vector nearest to the last known one before it."""
    return continuous(layout, tangent, valid=known)


def standardise(layout: Layout, tangent: Float[np.ndarray, "*batch channels"]) -> Float[np.ndarray, "*batch channels"]:
    """Channels less their mean over their scale, in the type that they come in."""
    mean, std = _statistics(layout.properties)
    return ((tangent - mean) / std).astype(tangent.dtype)


def unstandardise(layout: Layout, state: Float[np.ndarray, "*batch channels"]) -> Float[np.ndarray, "*batch channels"]:
    """Channels as of `encode` from standardised ones, float64."""
    mean, std = _statistics(layout.properties)
    return np.asarray(state, dtype=np.float64) * std + mean


def _statistics(entries: Sequence[Property] | Sequence[Constant]) -> tuple[np.ndarray, np.ndarray]:
    parts = [(np.zeros(0), np.zeros(0)), *((entry.mean, entry.std) for entry in entries)]
    return np.concatenate([mean for mean, _ in parts]), np.concatenate([std for _, std in parts])


def decode(
    layout: Layout,
    state: Float[np.ndarray, "*batch frames channels"],
    constants: Float[np.ndarray, "*batch constants"],
    *,
    scene: Scene | None = None,
) -> dict[str, Float[np.ndarray, "*batch frames _"]]:
    """Columns of the contract from states: what the layout holds, and joints by forward kinematics.

    Args:
        layout: Properties and their channels.
        state: Standardised.
        constants: Standardised.
        scene: What the layout is of, where it does not ship with the package.

    Returns:
        Columns (..., T, n), float64, with their units; entry 0 of joint columns repeats the root.
    """
    batch = state.shape[:-1]
    numbers = unstandardise(layout, state).reshape(-1, layout.channels)
    own: dict[str, np.ndarray] = {}
    for row, entry in enumerate(layout.properties):
        own[entry.column] = _values_of(entry, numbers[:, layout.slice_of(row)])
    mean, std = _statistics(layout.constants)
    fixed = np.asarray(constants, dtype=np.float64) * std + mean
    start = 0
    for entry in layout.constants:
        stop = start + len(entry.channels)
        values = np.tile(entry.rest, (*batch, 1))
        values[..., entry.channels] = fixed[..., None, start:stop]
        own[entry.column] = values.reshape(-1, entry.width)
        start = stop
    for number, player in enumerate(layout.players):
        _complete_pose(own, player, _parents(layout.scene, number) if scene is None else _parents_of(scene, number))
    return {name: values.reshape(*batch, values.shape[1]) for name, values in own.items()}


def _complete_pose(own: dict[str, np.ndarray], player: str, parents: np.ndarray) -> None:
    """Put the root before the joints of a player's columns, and add its joints where all that takes is there."""
    rotations, translations = f"{player}.joint_rotations", f"{player}.joint_translations"
    for column, root in ((rotations, f"{player}.root_rotation"), (translations, f"{player}.root_position")):
        if column in own and root in own:
            own[column] = np.concatenate([own[root], own[column]], axis=1)
        else:
            own.pop(column, None)
    if rotations in own and translations in own:
        shape = (len(own[rotations]), -1, 3)
        joints = world_joints(parents, own[rotations].reshape(shape), own[translations].reshape(shape))
        own[f"{player}.joints"] = joints.reshape(len(joints), -1)


@lru_cache(maxsize=16)
def _parents(scene: str, player: int) -> np.ndarray:
    return _parents_of(load_scene(scene), player)


def _parents_of(scene: Scene, player: int) -> np.ndarray:
    skeleton = scene.players[player].skeleton
    if skeleton is None:
        raise ValueError(f"{scene.name}: {scene.players[player].name}: expected a skeleton, got none")
    return skeleton.parents
