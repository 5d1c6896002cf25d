"""What is kept of every frame while a shot goes on: small things in memory, measurements on disk."""

import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Int

from pgm_data.lift.court_camera import CourtCamera
from pgm_data.lift.line_fit import Sightings

COLUMNS = 11
"""Numbers spooled per sighting: world point 3, pixel 2, normal 2, sigma, line, place on the line, shared error."""


class Spool:
    """Sightings of a shot's frames kept on disk, so that memory does not grow with its length."""

    def __init__(self, rows: int, folder: Path | None) -> None:
        self.rows = rows
        self.file = tempfile.TemporaryFile(dir=folder, prefix=".sightings-")
        self.count = 0

    def append(self, sightings: Sightings) -> int:
        """Keep one frame's sightings (the first `rows` of them); returns their place."""
        parts = [
            sightings.points_world,
            sightings.measured_px,
            sightings.normals,
            sightings.sigma_px[:, None],
            sightings.line[:, None],
            sightings.along[:, None],
            sightings.bias_px[:, None],
        ]
        table = np.full((self.rows, COLUMNS), np.nan, np.float32)
        values = np.concatenate(parts, axis=1)[: self.rows]
        table[: len(values)] = values
        self.file.seek(self.count * table.nbytes)
        self.file.write(table.tobytes())
        self.count += 1
        return self.count - 1

    def read(self, places: Iterable[int] | Int[np.ndarray, " places"]) -> Sightings:
        """The frames' sightings as one padded track."""
        size = self.rows * COLUMNS * 4
        tables = []
        for place in places:
            self.file.seek(place * size)
            tables.append(np.frombuffer(self.file.read(size), np.float32).reshape(self.rows, COLUMNS))
        table = np.stack(tables).astype(np.float64)
        real = np.isfinite(table[..., 7])
        table = np.where(real[..., None], table, 0.0)
        return Sightings(
            points_world=table[..., :3],
            measured_px=table[..., 3:5],
            normals=table[..., 5:7],
            sigma_px=np.where(real, table[..., 7], np.inf),
            line=np.where(real, table[..., 8], -1).astype(np.int64),
            along=table[..., 9],
            bias_px=table[..., 10],
        )

    def close(self) -> None:
        """Give the disk space back."""
        self.file.close()


def packed(camera: CourtCamera) -> np.ndarray:
    """One camera as 16 numbers: a long shot keeps one per frame."""
    return np.concatenate(
        [camera.R_cam_from_world.ravel(), camera.position_world, camera.principal_px, [camera.focal_px, camera.radial]]
    )


def unpacked(rows: list[np.ndarray], size: tuple[int, int]) -> CourtCamera:
    """The track of packed cameras."""
    table = np.stack(rows)
    return CourtCamera(
        R_cam_from_world=table[:, :9].reshape(-1, 3, 3),
        position_world=table[:, 9:12],
        principal_px=table[:, 12:14],
        focal_px=table[:, 14],
        radial=table[:, 15],
        half_diagonal_px=float(np.hypot(*size) / 2),
    )
