"""What is measured of filled-in windows: places, turns and poses of objects, their errors and their features.

As in the paper three properties are told apart, so that an error in one does not count in another:

- `position`: of each player's root and of the ball, world metres.
- `root_angle`: of each player's root in the world. Errors are angles |log(A^T B)|, radians; features the axis-angle
  vectors from the layout's reference, made continuous in time, so that nothing jumps at pi.
- `joints`: of each player, all but the root, metres, in the root's own frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_models.animation.layout import Layout
from pgm_models.animation.tangents import continuous_tangents, mean_rotvec, tangent_from_rotvec
from pgm_models.metrics import Projection, energy_score, geodesic_angle, principal_axes

PropertyName = Literal["position", "root_angle", "joints"]
UNITS: Mapping[PropertyName, str] = {"position": "m", "root_angle": "rad", "joints": "m"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Quantity:
    """One property of one object, as it is measured."""

    kind: PropertyName
    """The property."""
    object: str
    """`player0`, ..., `ball`."""
    player: int
    """Index of the player; -1 of the ball."""
    column: str
    """Of the contract, that it is taken from."""
    rows: tuple[int, ...]
    """Properties of the layout that it depends on: it is known where all of them are."""
    reference: Float[np.ndarray, "rotations 3"]
    """Of a root angle: the axis-angle that features are relative to; else none."""

    @property
    def name(self) -> str:
        """Property and object."""
        return f"{self.kind} {self.object}"


def quantities(layout: Layout) -> tuple[Quantity, ...]:
    """What can be measured of the layout's states, in the order of properties and objects."""
    columns = {entry.column: row for row, entry in enumerate(layout.properties)}
    none = np.zeros((0, 3))
    found: list[Quantity] = []

    def add(name: PropertyName, thing: str, player: int, parts: tuple[str, ...], column: str) -> None:
        rows = tuple(columns[f"{thing}.{part}"] for part in parts if f"{thing}.{part}" in columns)
        if rows and f"{thing}.{parts[0]}" in columns:
            reference = layout.properties[rows[0]].reference if name == "root_angle" else none
            found.append(
                Quantity(kind=name, object=thing, player=player, column=column, rows=rows, reference=reference)
            )

    for player, thing in enumerate(layout.players):
        add("position", thing, player, ("root_position",), f"{thing}.root_position")
    add("position", "ball", -1, ("position",), "ball.position")
    for player, thing in enumerate(layout.players):
        add("root_angle", thing, player, ("root_rotation",), f"{thing}.root_rotation")
    for player, thing in enumerate(layout.players):
        if {f"{thing}.root_position", f"{thing}.root_rotation"} <= set(columns):
            add("joints", thing, player, ("joint_rotations", "joint_translations"), f"{thing}.joints")
    return tuple(found)


def measured(
    quantity: Quantity, columns: Mapping[str, Float[np.ndarray, "*batch frames _"]]
) -> Float[np.ndarray, "*batch frames points 3"]:
    """The quantity of decoded columns: one point or axis-angle vector, or all joints but the root."""
    values = columns[quantity.column]
    values = values.reshape(*values.shape[:-1], -1, 3)
    if quantity.kind != "joints":
        return values
    R_world_from_root = rotation_from_rotvec(columns[f"{quantity.object}.root_rotation"])
    apart = values[..., 1:, :] - columns[f"{quantity.object}.root_position"][..., None, :]
    return apart @ R_world_from_root


def errors(
    quantity: Quantity,
    filled: Float[np.ndarray, "*batch frames points 3"],
    truth: Float[np.ndarray, "*#batch frames points 3"],
) -> Float[np.ndarray, "*batch frames"]:
    """Distance of each frame's points on average, or the angle, in the quantity's unit."""
    if quantity.kind == "root_angle":
        return geodesic_angle(filled[..., 0, :], np.broadcast_to(truth, filled.shape)[..., 0, :])
    return np.linalg.norm(filled - truth, axis=-1).mean(axis=-1)


@dataclass(frozen=True, kw_only=True)
class SeveralErrors:
    """Errors of several samples together, in the quantity's unit; NaN where nothing was unknown."""

    best: float
    """Of each window's best sample, chosen by the truth: an oracle."""
    mean: float
    """Of the samples' mean: what a regressor is to be compared with."""
    energy: float
    """Energy score: E|X - y| - E|X - X'| / 2; of angles with chords 2 sin(angle / 2) as distances."""


def several_errors(
    quantity: Quantity,
    samples: Float[np.ndarray, "samples windows frames points 3"],
    truth: Float[np.ndarray, "windows frames points 3"],
    judged: Bool[np.ndarray, "windows frames"],
) -> SeveralErrors:
    """Errors of samples of the same windows over the frames that are judged; one sample has no energy score."""
    single = errors(quantity, samples, truth)
    frames = judged.sum(axis=-1)
    there = frames > 0
    if not there.any():
        return SeveralErrors(best=float("nan"), mean=float("nan"), energy=float("nan"))
    sums = np.where(judged, single, 0.0).sum(axis=-1)
    if quantity.kind == "root_angle":
        R = rotation_from_rotvec(samples).sum(axis=0)
        middle = mean_rotvec(R.reshape(-1, 3, 3)).reshape(truth.shape)
        spread = rotation_from_rotvec(samples).reshape(*samples.shape[:-1], 9) / np.sqrt(2.0)
        told = rotation_from_rotvec(truth).reshape(*truth.shape[:-1], 9) / np.sqrt(2.0)
    else:
        middle, spread, told = samples.mean(axis=0), samples, truth
    energy = energy_score(spread, told).mean(axis=-1)[judged].mean() if len(samples) > 1 else np.nan
    return SeveralErrors(
        best=float(sums.min(axis=0).sum() / frames.sum()),
        mean=float(errors(quantity, middle, truth)[judged].mean()),
        energy=float(energy),
    )


def features(
    quantity: Quantity, values: Float[np.ndarray, "windows frames points 3"]
) -> Float[np.ndarray, "windows numbers"]:
    """All numbers of each window in a row, in the quantity's unit: what distributions are compared by."""
    if quantity.kind == "root_angle":
        tangent = tangent_from_rotvec(values.reshape(-1, 1, 3), quantity.reference).reshape(values.shape)
        values = continuous_tangents(tangent, np.ones(values.shape[:-1], dtype=bool))
    return values.reshape(len(values), -1)


def axes_of(rows: Float[np.ndarray, "windows numbers"], most: int) -> Projection | None:
    """The axes onto which features are projected: none where they have few enough numbers as they are."""
    return principal_axes(rows, most) if rows.shape[1] > most else None
