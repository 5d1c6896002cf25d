"""What the states of a dataset are made of: properties, references and scales, from its training rows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from pgm_data.scene import Scene
from pgm_models.animation.layout import Constant, Layout, Property
from pgm_models.animation.shards import (
    ABSENT,
    EPISODE,
    column_names,
    count_rows,
    read_episodes,
    scene_of,
    sound_rows,
    state_columns,
)
from pgm_models.animation.tangents import mean_rotvec, tangent_from_rotvec

MOST_ROWS = 200_000
"""Statistics are of at most so many rows, evenly spread."""
DEAD = 1e-4
"""Standard deviation below which a number does not vary; radians or metres."""
FLOOR = 0.05
"""Least scale of a channel, of the root mean square of its property's."""
BENDING_M = 1e-3
"""Standard deviation within a clip above which bones are a property and no constant, metres."""


@dataclass(eq=False, kw_only=True)
class _Moments:
    """Sums over rows."""

    count: int = 0
    total: np.ndarray = field(default_factory=lambda: np.zeros(0))
    squares: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """About `shift`, so that nothing is lost where the mean is large."""
    shift: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def add(self, values: Float[np.ndarray, "rows numbers"]) -> None:
        """Take in rows."""
        if not len(values):
            return
        if not self.count:
            self.shift, self.total, self.squares = values[0].copy(), values[0] * 0, values[0] * 0
        self.count += len(values)
        self.total += (values - self.shift).sum(axis=0)
        self.squares += ((values - self.shift) ** 2).sum(axis=0)

    @property
    def mean(self) -> np.ndarray:
        """Of the rows."""
        return self.shift + self.total / self.count

    @property
    def variance(self) -> np.ndarray:
        """Of the rows."""
        return np.maximum(self.squares / self.count - (self.total / self.count) ** 2, 0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Part:
    """A column that may become a property."""

    column: str
    player: int
    kind: Literal["vector", "rotations"]
    first: int

    @property
    def owner(self) -> str:
        """Name of the object whose it is."""
        return self.column.partition(".")[0]

    def numbers(self, rows: Mapping[str, np.ndarray]) -> Float[np.ndarray, "rows numbers"]:
        """Its numbers in the rows where it is there."""
        values, there = rows[self.column], self.there(rows)
        return values[there, self.first :].astype(np.float64)

    def there(self, rows: Mapping[str, np.ndarray]) -> np.ndarray:
        """The rows where it is."""
        there = np.asarray(np.isfinite(rows[self.column]).all(axis=1))
        if (status := rows.get(f"{self.owner}.status")) is not None:
            there[status == ABSENT] = False
        return there


def fit_layout(dataset: Path, *, matches: Sequence[str] | None = None, scene: Scene | None = None) -> Layout:
    """The layout of a packed dataset's states, with the statistics of its rows.

    Properties are, of each player, root position, root rotation, rotations of the other joints, and their
    translations where those vary within clips; then the ball's position and velocity. What the scene or the data
    do not have is not among them. Joints that do not turn at all are left out of the channels.

    Args:
        dataset: Folder of the packed dataset.
        matches: Whose rows count; all where None.
        scene: What the dataset shows, where its scene does not ship with the package.

    Raises:
        ValueError: If there is no such dataset, it has no states, or a number in it is infinite, or NaN though its
            status says otherwise; names file, clip, frame and column.
    """
    scene = scene_of(dataset) if scene is None else scene
    episodes = read_episodes(dataset)
    counted = np.isin(np.arange(len(episodes.clips)), episodes.of_matches(matches))
    names = state_columns(scene, column_names(dataset))
    every = max(1, -(-count_rows(dataset) // MOST_ROWS))

    def rows() -> Iterator[dict[str, np.ndarray]]:
        for group in sound_rows(dataset, names, episodes.clips, every=every):
            kept = counted[group[EPISODE]]
            yield group if kept.all() else {name: values[kept] for name, values in group.items()}

    parts = _parts(scene, names)
    sums, bones = _first_sums(parts, rows())
    parts = [part for part in parts if part.column in sums]
    if not parts:
        raise ValueError(f"{dataset}: expected places, poses or a ball of the scene {scene.name}, got none in any row")
    references = {
        part.column: mean_rotvec(sums[part.column].total.reshape(-1, 3, 3))
        for part in parts
        if part.kind == "rotations"
    }
    moments = {column: found for column, found in sums.items() if column not in references}
    moments |= _tangent_moments([part for part in parts if part.column in references], references, rows())
    bending = {column for column, found in bones.items() if found.within > BENDING_M}
    return Layout(
        scene=scene.name,
        players=tuple(player.name for player in scene.players),
        properties=tuple(
            _property(part, moments[part.column], references.get(part.column))
            for part in parts
            if part.column not in bones or part.column in bending
        ),
        constants=tuple(
            _constant(part, bones[part.column].means)
            for part in parts
            if part.column in bones and part.column not in bending
        ),
    )


def _parts(scene: Scene, names: Sequence[str]) -> list[_Part]:
    """Columns of the scene that are among the names and hold more than what others repeat."""
    parts = []
    for number, player in enumerate(scene.players):
        joints = 0 if player.skeleton is None else len(player.skeleton.parents)
        parts.append(_Part(column=f"{player.name}.root_position", player=number, kind="vector", first=0))
        parts.append(_Part(column=f"{player.name}.root_rotation", player=number, kind="rotations", first=0))
        if joints > 1:
            parts.append(_Part(column=f"{player.name}.joint_rotations", player=number, kind="rotations", first=3))
            parts.append(_Part(column=f"{player.name}.joint_translations", player=number, kind="vector", first=3))
    parts.append(_Part(column="ball.position", player=-1, kind="vector", first=0))
    parts.append(_Part(column="ball.velocity", player=-1, kind="vector", first=0))
    return [part for part in parts if part.column in names]


class _Bones:
    """Translations of joints, clip by clip; rows of a clip come one after another."""

    def __init__(self) -> None:
        self._clip = -1
        self._moments = _Moments()
        self._means = _Moments()
        self._within = 0.0

    def add(self, episode: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows numbers"]) -> None:
        """Take in rows."""
        for clip in np.unique(episode):
            if clip != self._clip:
                self._close()
                self._clip = int(clip)
            self._moments.add(values[episode == clip])

    def _close(self) -> None:
        if self._moments.count:
            self._means.add(self._moments.mean[None])
            self._within = max(self._within, float(np.sqrt(self._moments.variance.max())))
        self._moments = _Moments()

    @property
    def within(self) -> float:
        """Largest standard deviation of a number within a clip, metres."""
        self._close()
        return self._within

    @property
    def means(self) -> _Moments:
        """Of the clips' means."""
        self._close()
        return self._means


def _first_sums(
    parts: Sequence[_Part], groups: Iterator[dict[str, np.ndarray]]
) -> tuple[dict[str, _Moments], dict[str, _Bones]]:
    """Moments of vectors and sums of the matrices of rotations, of those that are there at all; and bones."""
    sums: dict[str, _Moments] = {}
    bones: dict[str, _Bones] = {}
    for group in groups:
        for part in parts:
            numbers = part.numbers(group)
            if not len(numbers):
                continue
            found = sums.setdefault(part.column, _Moments())
            if part.kind == "vector":
                found.add(numbers)
                if part.column.endswith(".joint_translations"):
                    bones.setdefault(part.column, _Bones()).add(group[EPISODE][part.there(group)], numbers)
            else:
                matrices = Rotation.from_rotvec(numbers.reshape(-1, 3)).as_matrix()
                total = matrices.reshape(len(numbers), numbers.shape[1] // 3, 9).sum(axis=0)
                found.total = total if not found.count else found.total + total
                found.count += len(numbers)
    return sums, bones


def _tangent_moments(
    parts: Sequence[_Part], references: Mapping[str, np.ndarray], groups: Iterator[dict[str, np.ndarray]]
) -> dict[str, _Moments]:
    """Moments of the tangent vectors of rotations."""
    moments = {part.column: _Moments() for part in parts}
    for group in groups if parts else ():
        for part in parts:
            numbers = part.numbers(group)
            vectors = numbers.reshape(len(numbers), numbers.shape[1] // 3, 3)
            tangent = tangent_from_rotvec(vectors, references[part.column])
            moments[part.column].add(tangent.reshape(numbers.shape))
    return moments


def _property(part: _Part, moments: _Moments, reference: np.ndarray | None) -> Property:
    std = np.sqrt(moments.variance)
    width = len(std)
    if part.kind == "rotations":
        moving = np.flatnonzero(np.max(std.reshape(-1, 3), axis=1) >= DEAD)
        # A property has at least one channel.
        kept = np.repeat(np.isin(np.arange(width // 3), moving if len(moving) else [0]), 3)
    elif part.first:
        kept = std >= DEAD
    else:
        kept = np.ones(width, dtype=bool)
    return Property(
        column=part.column,
        player=part.player,
        kind=part.kind,
        first=part.first,
        width=width,
        reference=np.zeros((0, 3)) if reference is None else reference,
        channels=np.flatnonzero(kept),
        rest=moments.mean,
        mean=moments.mean[kept],
        std=_floored(std[kept]),
    )


def _constant(part: _Part, means: _Moments) -> Constant:
    std = np.sqrt(means.variance)
    kept = std >= DEAD
    return Constant(
        column=part.column,
        player=part.player,
        first=part.first,
        width=len(std),
        channels=np.flatnonzero(kept),
        rest=means.mean,
        mean=means.mean[kept],
        std=_floored(std[kept]),
    )


def _floored(std: Float[np.ndarray, " channels"]) -> Float[np.ndarray, " channels"]:
    """Scales, none of which is next to nothing beside the others."""
    return np.maximum(std, max(FLOOR * float(np.sqrt(np.mean(std**2))), DEAD)) if len(std) else std
