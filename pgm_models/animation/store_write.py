"""Writing the frames of a store, some rows of the dataset at a time, and cutting them into segments."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Int

from pgm_data.scene import Scene
from pgm_models.animation.encode import encode, encode_constants
from pgm_models.animation.layout import Layout
from pgm_models.animation.shards import (
    EPISODE,
    FRAME,
    TIME,
    Episodes,
    column_names,
    read_episodes,
    scene_of,
    sound_rows,
    state_columns,
)

FRAME_ARRAYS: Mapping[str, type] = MappingProxyType(
    {"tangent": np.float32, "valid": np.bool_, "frame": np.int64, "time": np.float64, "span": np.int32}
)
"""What is kept of each frame, and as what."""
UNEVEN = 0.5
"""Share of the usual time step by which a step within a segment may differ from it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WrittenFrames:
    """Frames that were written, clip after clip."""

    frames: int
    """How many."""
    episodes: Episodes
    first: Int[np.ndarray, " bounds"]
    """Row at which each clip's frames begin; and the number of frames."""
    constants: Float[np.ndarray, "clips constants"]
    """Standardised, the average over the clip; 0 where unknown."""
    folder: Path

    def rows_of(self, clip: int, name: str) -> np.ndarray:
        """One number a frame of a clip, from its file."""
        dtype = np.dtype(FRAME_ARRAYS[name])
        start, stop = int(self.first[clip]), int(self.first[clip + 1])
        return np.fromfile(self.folder / f"{name}.bin", dtype=dtype, count=stop - start, offset=start * dtype.itemsize)


@dataclass(frozen=True, eq=False, kw_only=True)
class Segments:
    """Runs of frames of one clip with even time steps."""

    start: Int[np.ndarray, " segments"]
    length: Int[np.ndarray, " segments"]
    clip: Int[np.ndarray, " segments"]
    rate: Float[np.ndarray, " segments"]
    """Frames a second."""


def write_frames(dataset: Path, layout: Layout, folder: Path, *, scene: Scene | None) -> WrittenFrames:
    """What was written: channels, validity, number and time of each frame, in files of the folder.

    Raises:
        ValueError: If the dataset is not sound or shows another scene; names where.
    """
    scene = scene_of(dataset) if scene is None else scene
    if scene.name != layout.scene:
        raise ValueError(f"{dataset}: scene: expected {layout.scene}, as the layout has it, got {scene.name}")
    episodes = read_episodes(dataset)
    names = state_columns(scene, column_names(dataset))
    sums = np.zeros((len(episodes.clips), layout.constant_channels))
    counts = np.zeros((len(episodes.clips), layout.constant_channels), dtype=np.int64)
    lengths = np.zeros(len(episodes.clips), dtype=np.int64)
    latest = -1
    with ExitStack() as stack:
        files = {
            name: stack.enter_context((folder / f"{name}.bin").open("wb")) for name in FRAME_ARRAYS if name != "span"
        }
        for rows in sound_rows(dataset, names, episodes.clips):
            episode = rows[EPISODE]
            if not len(episode):
                continue
            if episode[0] < latest or (np.diff(episode) < 0).any():
                raise ValueError(f"{dataset}: {EPISODE}: expected rows in the order of their episodes, got others")
            latest = int(episode[-1])
            tangent, valid = encode(layout, rows)
            content = {"tangent": tangent, "valid": valid, "frame": rows[FRAME], "time": rows[TIME]}
            for name, file in files.items():
                file.write(np.ascontiguousarray(content[name], dtype=FRAME_ARRAYS[name]).tobytes())
            lengths += np.bincount(episode, minlength=len(lengths))
            _add_constants(layout, rows, sums, counts)
    first = np.concatenate([[0], np.cumsum(lengths)])
    return WrittenFrames(
        frames=int(first[-1]),
        episodes=episodes,
        first=first,
        constants=(sums / np.maximum(counts, 1)).astype(np.float32),
        folder=folder,
    )


def _add_constants(
    layout: Layout,
    rows: Mapping[str, np.ndarray],
    sums: Float[np.ndarray, "clips constants"],
    counts: Int[np.ndarray, "clips constants"],
) -> None:
    """Add the constants of rows to the sums of their clips, in place."""
    episode = rows[EPISODE]
    values = encode_constants(layout, rows)
    start = 0
    for entry in layout.constants:
        stop = start + len(entry.channels)
        if entry.column in rows:
            there = np.isfinite(rows[entry.column]).all(axis=1)
            np.add.at(sums[:, start:stop], episode[there], values[there, start:stop])
            np.add.at(counts[:, start:stop], episode[there], 1)
        start = stop


def cut_segments(written: WrittenFrames) -> Segments:
    """Runs of the clips' frames, ending where a time step is not the usual one of its clip."""
    starts, lengths, clips, rates = [], [], [], []
    for clip in range(len(written.episodes.clips)):
        time = written.rows_of(clip, "time")
        if not len(time):
            continue
        steps = np.diff(time)
        usual = float(np.median(steps)) if len(steps) else np.nan
        uneven = ~(np.abs(steps - usual) <= UNEVEN * usual)
        edges = np.concatenate([[0], np.flatnonzero(uneven) + 1, [len(time)]])
        starts.append(written.first[clip] + edges[:-1])
        lengths.append(np.diff(edges))
        clips.append(np.full(len(edges) - 1, clip))
        rates.append([_rate(time[a:b], usual) for a, b in zip(edges[:-1], edges[1:], strict=True)])
    return Segments(
        start=np.concatenate([np.zeros(0, np.int64), *starts]),
        length=np.concatenate([np.zeros(0, np.int64), *lengths]),
        clip=np.concatenate([np.zeros(0, np.int64), *clips]),
        rate=np.concatenate([np.zeros(0), *rates]),
    )


def _rate(time: Float[np.ndarray, " frames"], usual: float) -> float:
    """Frames a second of a segment; of its clip where it has one frame, and 1 where that has none but this."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else usual
    return 1.0 / step if np.isfinite(step) and step > 0 else 1.0
