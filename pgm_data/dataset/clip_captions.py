"""The captions of one clip as one struct: what `captions.parquet` holds, read and written whole."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import Scene

SOURCES = ("human", "generated", "imported")


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptionRows:
    """Texts about spans of frames, one row a text.

    Raises:
        ValueError: If columns differ in length.
    """

    player: Int[np.ndarray, " texts"]
    """Index of the player object among the scene's players, from 0."""
    start_frame: Int[np.ndarray, " texts"]
    """First frame of the span."""
    end_frame: Int[np.ndarray, " texts"]
    """Frame after the last of the span."""
    start_s: Float[np.ndarray, " texts"]
    """Capture time, s."""
    end_s: Float[np.ndarray, " texts"]
    text: Shaped[np.ndarray, " texts"]
    source: Shaped[np.ndarray, " texts"]
    """Of `SOURCES`."""
    alternative: Int[np.ndarray, " texts"]
    """0 is the main text of the span, others say the same in other words."""

    def __post_init__(self) -> None:
        """Check the lengths."""
        for name in self.__dataclass_fields__:
            if len(getattr(self, name)) != len(self.text):
                raise ValueError(f"captions: {name}: expected {len(self.text)} rows, got {len(getattr(self, name))}")

    def __len__(self) -> int:
        """Number of texts."""
        return len(self.text)


def write_clip_captions(folder: Path, clip_id: str, captions: CaptionRows, *, scene: Scene) -> None:
    """Write the captions as `captions.parquet` into the clip's folder, whole or not at all."""
    columns = {name: getattr(captions, name) for name in captions.__dataclass_fields__}
    columns |= {name: list(columns[name]) for name in ("text", "source")}
    columns = {"clip_id": [clip_id] * len(captions)} | columns
    write_table(folder / "captions.parquet", table="captions", scene=scene, columns=columns)


def read_clip_captions(folder: Path) -> CaptionRows:
    """The captions of a clip from its folder.

    Raises:
        ValueError: If the table is missing or lacks a column.
    """
    path = folder / "captions.parquet"
    columns = read_table(path)
    names = tuple(CaptionRows.__dataclass_fields__)
    for name in names:
        if name not in columns:
            raise ValueError(f"{path}: {name}: expected the column, got {', '.join(columns)}")
    return CaptionRows(**{name: columns[name] for name in names})
