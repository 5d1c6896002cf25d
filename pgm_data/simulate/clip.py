"""Videos of one event with exact truth, shot by shot or whole."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from jaxtyping import Bool, Float, UInt8

from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.shots import SimulatedShot, joined


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedClip:
    """One whole video's cameras, and the way to its pictures."""

    scene: Scene
    width: int
    height: int
    track: CameraTrack
    """The true cameras; NaN in shots that do not show the scene."""
    timestamps: Float[np.ndarray, " frames"]
    """Presentation times, s."""
    capture_times: Float[np.ndarray, " frames"]
    """When each picture was taken, s; a repeat has its source's."""
    is_duplicate: Bool[np.ndarray, " frames"]
    drawn: Callable[[], Iterator[UInt8[np.ndarray, "height width 3"]]]

    def frames(self) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
        """The pictures, BGR, in order; every call draws the same ones anew."""
        return self.drawn()

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.timestamps)


def simulate_shots(scene: Scene, options: ClipOptions, seed: int) -> Iterator[SimulatedShot]:
    """The shots of a video in order; they depend on the arguments alone, and one is in memory at a time.

    Tennis is played, blocks are walked about, courts of other sports are shown with stand-ins for their players.

    Raises:
        ValueError: If the scene has neither a court nor is the world of blocks.
    """
    if scene.court is None:
        from pgm_data.simulate.blocks.film import film_shots

        return film_shots(scene, options, seed)
    if is_played(scene):
        from pgm_data.simulate.tennis.film import tennis_shots

        return tennis_shots(scene, options, seed)
    from pgm_data.simulate.stand_ins import court_shots

    return court_shots(scene, options, seed)


def is_played(scene: Scene) -> bool:
    """Whether the scene is a game whose rules, players and ball the simulator knows: singles on a tennis court."""
    skeletons = [p.skeleton.name for p in scene.players if p.skeleton is not None]
    return scene.name == "tennis" and scene.ball is not None and skeletons == ["smpl24", "smpl24"]


def simulate_clip(scene: Scene, options: ClipOptions, seed: int) -> SimulatedClip:
    """A whole video of `simulate_shots`, its cameras in memory.

    Raises:
        ValueError: If the scene is not one that can be drawn.
    """
    shots = list(simulate_shots(scene, options, seed))
    return SimulatedClip(
        scene=scene,
        width=options.width,
        height=options.height,
        track=joined([shot.track for shot in shots]),
        timestamps=np.concatenate([shot.timestamps for shot in shots]),
        capture_times=np.concatenate([shot.capture_times for shot in shots]),
        is_duplicate=np.concatenate([shot.is_duplicate for shot in shots]),
        drawn=lambda: chain.from_iterable(shot.pictures() for shot in shots),
    )
