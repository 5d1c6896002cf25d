"""What moves in a clip: the camera after an imaginary ball, and two figures near the ends of the court."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.pictures.bystanders import muted
from pgm_data.simulate.pictures.people import Cast, Silhouette, blob_shadow, placed
from pgm_data.simulate.pictures.shapes import Polygons, polygons
from pgm_data.simulate.views import Pose

Motion = Literal["any", "still", "drift", "follow"]
POSE_S = 0.35
"""Seconds from one posture to the next."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Waves:
    """A smooth random course of time: a sum of sines."""

    amplitudes: Float[np.ndarray, " waves"]
    rates: Float[np.ndarray, " waves"]
    """Radians per second."""
    phases: Float[np.ndarray, " waves"]

    def __call__(self, times: Float[np.ndarray, " times"]) -> np.ndarray:
        """The values at these times, s."""
        return np.sin(np.multiply.outer(times, self.rates) + self.phases) @ self.amplitudes


def waves(rng: np.random.Generator, reach: float, slowest_s: float, quickest_s: float, count: int = 4) -> Waves:
    """Waves that stay within about +-reach, with periods between the two."""
    weights = rng.uniform(0.3, 1.0, count)
    return Waves(
        amplitudes=reach * weights / weights.sum(),
        rates=2 * np.pi / np.exp(rng.uniform(np.log(quickest_s), np.log(slowest_s), count)),
        phases=rng.uniform(0, 2 * np.pi, count),
    )


def camera_course(
    rng: np.random.Generator, base: Pose, motion: Motion, times: Float[np.ndarray, " frames"], width: int
) -> list[Pose]:
    """The camera at these times: fixed centre; pans, tilts and zooms as `motion` says."""
    if motion == "any":
        motion = ("still", "drift", "follow")[int(rng.choice(3, p=[0.35, 0.15, 0.5]))]
    pan, tilt, zoom = np.zeros_like(times), np.zeros_like(times), np.zeros_like(times)
    if motion == "drift":
        pan = waves(rng, rng.uniform(1.0, 10.0) * width / 1280, 40.0, 12.0)(times)
        tilt = waves(rng, rng.uniform(0.5, 4.0) * width / 1280, 40.0, 12.0)(times)
        shake = rng.uniform(0.0, 0.3) * width / 1280
        pan = pan + shake * waves(rng, 1.0, 1.0, 0.3, 6)(times)
        tilt = tilt + shake * waves(rng, 1.0, 1.0, 0.3, 6)(times)
    if motion == "follow":
        pan = waves(rng, rng.uniform(0.01, 0.08) * width, 9.0, 2.5)(times)
        tilt = waves(rng, rng.uniform(0.0, 0.012) * width, 9.0, 3.0)(times)
        zoom = waves(rng, rng.uniform(0.0, 0.1), 14.0, 4.0)(times)
    focal = base.focal_px * np.exp(zoom)
    return [
        replace(
            base,
            heading=base.heading + float(np.arctan(p / base.focal_px)),
            tilt=base.tilt + float(np.arctan(t / base.focal_px)),
            focal_px=float(f),
        )
        for p, t, f in zip(pan, tilt, focal, strict=True)
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class Mover:
    """A figure that runs about one end of the court; the pictures' stand-in for a player."""

    postures: tuple[Silhouette, ...]
    x: Waves
    y: Waves
    middle: Float[np.ndarray, " 3"]
    """World metres."""
    clothes: Float[np.ndarray, "3 3"]
    height_m: float

    def foot(self, time: float) -> np.ndarray:
        """Where it stands, world metres."""
        at = np.array([time])
        return self.middle + np.array([self.x(at)[0], self.y(at)[0], 0.0])

    def shapes(self, time: float, centre_world: np.ndarray) -> Polygons:
        """Its shapes at a time, between two postures."""
        phase = time / POSE_S
        step, share = int(np.floor(phase)), phase - np.floor(phase)
        before = self.postures[step % len(self.postures)]
        after = self.postures[(step + 1) % len(self.postures)]
        between = replace(before, corners=(1.0 - share) * before.corners + share * after.corners)
        return placed(between, self.foot(time), centre_world, self.clothes, height_m=self.height_m)

    def shadow(self, time: float, thrown: np.ndarray, strength: float) -> Polygons:
        """Its shadow on the ground."""
        return polygons(blob_shadow(self.foot(time), self.height_m, thrown, strength))


def draw_movers(rng: np.random.Generator, cast: Cast, half_x: float, half_y: float, floor_z: float) -> Sequence[Mover]:
    """One figure at the near end and one at the far end."""
    movers = []
    for end in (-1.0, 1.0):
        chosen = rng.choice(len(cast.playing), 6, replace=False)
        skin = np.array([115.0, 150.0, 200.0]) * rng.uniform(0.3, 1.15)
        movers.append(
            Mover(
                postures=tuple(cast.playing[int(i)] for i in chosen),
                x=waves(rng, 0.5 * half_x, 8.0, 2.5),
                y=waves(rng, 0.08 * half_y, 9.0, 3.0),
                middle=np.array([0.0, end * 0.62 * half_y, floor_z]),
                clothes=np.stack([muted(rng), 0.6 * muted(rng), skin]),
                height_m=float(rng.uniform(1.65, 1.98)),
            )
        )
    return movers
