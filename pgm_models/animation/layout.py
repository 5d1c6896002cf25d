"""What a state vector of the animation model is made of: properties, channels, constants, and their statistics."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.arrays import frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class Property:
    """One column of the contract that is generated, and its place among the channels.

    The numbers of the column from `first` on, `width` of them, are the property. Rotations are turned into tangent
    vectors at a reference first: v = log(R_ref^T R), continuous over a window, so that nothing jumps at pi.

    Raises:
        ValueError: If sizes do not fit together, or a scale is not above 0.
    """

    column: str
    """Of the contract, such as `player0.root_position`."""
    player: int
    """Index of the player whose it is; -1 of the ball."""
    kind: Literal["vector", "rotations"]
    """Numbers as they are; or axis-angle vectors, three numbers each."""
    first: int
    """First number of the column that belongs to it; 3 of joint columns, whose entry 0 repeats the root."""
    width: int
    """Numbers of the column from there on."""
    reference: Float[np.ndarray, "rotations 3"]
    """Axis-angle of each rotation's reference, radians; none of vectors."""
    channels: Int[np.ndarray, " channels"]
    """Which of its numbers (of rotations: tangent numbers) are generated."""
    rest: Float[np.ndarray, " width"]
    """Its numbers (tangent ones of rotations) where they are not generated: they do not vary in the data."""
    mean: Float[np.ndarray, " channels"]
    """Of the generated numbers in the training data; the column's unit."""
    std: Float[np.ndarray, " channels"]
    """Scale of the generated numbers; the column's unit."""

    def __post_init__(self) -> None:
        """Keep read-only copies and check sizes."""
        object.__setattr__(self, "channels", frozen(self.channels, np.int64))
        for name in ("reference", "rest", "mean", "std"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        rotations = self.width // 3 if self.kind == "rotations" else 0
        if len(self.reference) != rotations or len(self.rest) != self.width:
            raise ValueError(f"{self.column}: expected {rotations} references and {self.width} numbers at rest")
        if not len(self.channels) == len(self.mean) == len(self.std):
            raise ValueError(f"{self.column}: expected as many means and scales as channels ({len(self.channels)})")
        if not (np.isfinite(self.mean).all() and (self.std > 0).all()):
            raise ValueError(f"{self.column}: expected finite means and scales above 0, got {self.mean}, {self.std}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Constant:
    """One column that does not change within a clip: given to the model, never generated."""

    column: str
    """Of the contract, such as `player0.joint_translations`."""
    player: int
    """Index of the player whose it is."""
    first: int
    """First number of the column that belongs to it."""
    width: int
    """Numbers of the column from there on."""
    channels: Int[np.ndarray, " channels"]
    """Which of its numbers differ between clips."""
    rest: Float[np.ndarray, " width"]
    """All its numbers, on average: what the others are in every clip."""
    mean: Float[np.ndarray, " channels"]
    std: Float[np.ndarray, " channels"]

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "channels", frozen(self.channels, np.int64))
        for name in ("rest", "mean", "std"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """Properties in the order of their tokens and channels."""

    scene: str
    """Name of the scene."""
    players: tuple[str, ...]
    """Player objects of the scene, in its order: the actions."""
    properties: tuple[Property, ...]
    constants: tuple[Constant, ...]
    """One a player, or none where bones vary and are a property, or there is no pose."""

    @property
    def widths(self) -> tuple[int, ...]:
        """Channels of each property."""
        return tuple(len(entry.channels) for entry in self.properties)

    @property
    def channels(self) -> int:
        """Number of channels, C."""
        return sum(self.widths)

    @property
    def constant_channels(self) -> int:
        """Numbers of all constants together."""
        return sum(len(entry.channels) for entry in self.constants)

    @cached_property
    def property_of_channel(self) -> Int[np.ndarray, " channels"]:
        """Row of the property that each channel belongs to."""
        return np.repeat(np.arange(len(self.properties)), self.widths)

    def slice_of(self, row: int) -> slice:
        """Where the channels of the property in that row lie."""
        start = sum(self.widths[:row])
        return slice(start, start + self.widths[row])

    def row_of(self, column: str) -> int:
        """Row of the property of that column.

        Raises:
            ValueError: If no property has it; names those there are.
        """
        names = [entry.column for entry in self.properties]
        if column not in names:
            raise ValueError(f"column: expected one of {', '.join(names)}, got {column!r}")
        return names.index(column)


def layout_to_json(layout: Layout) -> dict[str, object]:
    """The layout as JSON values, for checkpoints."""
    return {
        "scene": layout.scene,
        "players": list(layout.players),
        "properties": [_values(entry) for entry in layout.properties],
        "constants": [_values(entry) for entry in layout.constants],
    }


def layout_from_json(raw: Mapping) -> Layout:
    """The layout that `layout_to_json` wrote.

    Raises:
        ValueError: If a field is missing or of another kind.
    """
    try:
        return Layout(
            scene=raw["scene"],
            players=tuple(raw["players"]),
            properties=tuple(Property(**_arrays(entry)) for entry in raw["properties"]),
            constants=tuple(Constant(**_arrays(entry)) for entry in raw["constants"]),
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"layout: expected what layout_to_json writes, got {error!r}") from error


def _values(entry: Property | Constant) -> dict[str, object]:
    values = {name: getattr(entry, name) for name in entry.__dataclass_fields__}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def _arrays(raw: Mapping) -> dict:
    values = {name: np.asarray(value) if isinstance(value, list) else value for name, value in raw.items()}
    values["channels"] = np.asarray(raw["channels"], dtype=np.int64)
    for name in ("rest", "mean", "std"):
        values[name] = np.asarray(raw[name], dtype=np.float64)
    if "reference" in raw:
        values["reference"] = np.asarray(raw["reference"], dtype=np.float64).reshape(-1, 3)
    return values
