"""Matches in a world of blocks: a sequence of shots with exact truth, and their pictures on demand."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, UInt8

from pgm_data.scene import Scene
from pgm_data.simulate.blocks.agenda import draw_course
from pgm_data.simulate.blocks.building import build_world
from pgm_data.simulate.blocks.captions import draw_captions
from pgm_data.simulate.blocks.course import Course
from pgm_data.simulate.blocks.figure import Posture, gait_of, hull_points, posture_at
from pgm_data.simulate.blocks.navigation import Ways, spots_on, ways_of
from pgm_data.simulate.blocks.orbit import draw_orbit, orbit_track
from pgm_data.simulate.blocks.studio import Studio
from pgm_data.simulate.blocks.world import BlockWorld
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.states import PlayerStates, ShotStates

SHOT_S = (30.0, 80.0)
"""Shortest and longest shot; the last one ends with the match."""
LEAST_TARGETS = 7
"""Named things that a world must let one reach."""
Quality = Literal["draft", "full"]


@dataclass(frozen=True, eq=False, kw_only=True)
class BlocksShot:
    """One shot of a match."""

    scene: Scene
    size: tuple[int, int]
    """Width, height, pixels."""
    timestamps: Float[np.ndarray, " frames"]
    """Seconds from the start of the match."""
    track: CameraTrack
    states: ShotStates
    """Times in it count from the shot's first frame."""
    world: BlockWorld
    course: Course
    """The motion between the frames."""
    posture: Posture
    studio: Studio

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.timestamps)

    def draw(self, frame: int) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of a frame, BGR; the same whatever was drawn before."""
        return self.studio.picture(self.track, self.posture, frame, self.size)

    def masks(self, frame: int) -> tuple[UInt8[np.ndarray, "height width"], Float32[np.ndarray, "height width"]]:
        """What the centre of each pixel shows (0 sky, 1 player, 2 world), and its depth, m; infinite in the sky."""
        return self.studio.masks(self.track, self.posture, frame, self.size)


@lru_cache(maxsize=4)
def _place(seed: int) -> tuple[BlockWorld, Ways]:
    """The world of a match and its ways; drawn anew until enough of it can be reached."""
    for attempt in range(100):
        world = build_world(np.random.default_rng([seed, 0, attempt]))
        ways = ways_of(world)
        reachable = [e for e in world.elements if spots_on(ways, e)]
        if len(reachable) >= LEAST_TARGETS and len(ways.home) > 150 and world.ladders:
            return world, ways
    raise RuntimeError(f"blocks world: expected {LEAST_TARGETS} reachable things in 100 tries, seed {seed}")


def blocks_shots(
    scene: Scene,
    seed: int | np.random.Generator,
    *,
    frames: int,
    fps: float,
    size: tuple[int, int],
    quality: Quality = "full",
    world_seed: int | None = None,
) -> Iterator[BlocksShot]:
    """The shots of one match of so many frames; they depend on the arguments alone.

    Nothing is drawn until a picture is asked for. The motion, the captions and the world depend on the seed alone:
    other frame rates and sizes look at the same match. With a seed of its own the world, its light and its sky are
    the same in all matches that have it; who walks there, where to, and the camera's way are the match's.

    Raises:
        ValueError: If the scene has not one player of the skeleton `blocks13`, or a number is out of range.
    """
    if [o.skeleton.name for o in scene.players if o.skeleton is not None] != ["blocks13"]:
        raise ValueError(f"scene {scene.name}: expected one player of skeleton blocks13, got {len(scene.players)}")
    if frames < 1 or not 0 < fps <= 1000 or min(size) < 16:
        raise ValueError(f"blocks_shots: expected frames >= 1, 0 < fps <= 1000, sizes >= 16, got {frames, fps, size}")
    number = int(seed.integers(2**63)) if isinstance(seed, np.random.Generator) else int(seed)
    return _shots(scene, number, world_seed, frames=frames, fps=fps, size=size, fine=quality == "full")


def _shots(
    scene: Scene, seed: int, world_seed: int | None, *, frames: int, fps: float, size: tuple[int, int], fine: bool
) -> Iterator[BlocksShot]:
    world, ways = _place(seed if world_seed is None else world_seed)
    rng = np.random.default_rng([seed, 1])
    orbit = draw_orbit(rng, size)
    studio = Studio(world, int(rng.integers(2**31)), fine=fine, light_seed=world_seed)
    first, shot = 0, 0
    while first < frames:
        rng = np.random.default_rng([seed, 2, shot])
        length = float(rng.uniform(*SHOT_S))
        count = min(max(int(length * fps), 1), frames - first)
        course = draw_course(rng, world, ways, length)
        timestamps = (first + np.arange(count)) / fps
        posture = posture_at(course, gait_of(course), world, np.arange(count) / fps)
        yield BlocksShot(
            scene=scene,
            size=size,
            timestamps=timestamps,
            track=orbit_track(orbit, timestamps, size),
            states=_states(rng, course, world, posture, studio.identity, count / fps),
            world=world,
            course=course,
            posture=posture,
            studio=studio,
        )
        first, shot = first + count, shot + 1


def _states(
    rng: np.random.Generator, course: Course, world: BlockWorld, posture: Posture, identity: str, seconds: float
) -> ShotStates:
    hull = hull_points(posture)
    player = PlayerStates(
        identity=identity,
        handedness=None,
        rotations=posture.rotations,
        translations=posture.translations,
        joints=posture.joints,
        contact=posture.contact,
        keypoints=posture.joints,
        hull_centres=hull,
        hull_radii=np.zeros(hull.shape[1]),
    )
    captions = draw_captions(rng, course, world, min(seconds, course.end))
    return ShotStates(players=(player,), ball=None, events=(), flights=(), captions=captions)
