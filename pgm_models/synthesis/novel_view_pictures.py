"""The simulator's own picture of a state that it once drew, from any camera: a match is drawn again from its seed.

What `pgm simulate` leaves behind in `work/run.json` tells what it drew; the same version of the simulator draws it
again, clothes, court and light included. Cameras are compared with those of the clip's tables, so that another
version, or another match, is noticed.
"""

import json
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene, load_scene
from pgm_data.simulate.blocks.shots import BlocksShot, blocks_shots
from pgm_data.simulate.broadcast import Clock, Span, cuts, poses_of
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.clip import is_played
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import match_seed, world_seed
from pgm_data.simulate.tennis.film import CUTS, PLAYS, Recording, recording_of
from pgm_data.simulate.tennis.match import plays
from pgm_data.simulate.tennis.pictures import MatchPictures
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.views import View, track_of

BLOCKS_SIZE, COURT_SIZE = (1024, 576), (1280, 720)
"""Of pictures where the run was not told: as `pgm simulate` has it."""
BLOCKS_FPS, COURT_FPS = 20.0, 25.0


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedRun:
    """What a run of the simulator drew."""

    scene: Scene
    seed: int
    options: ClipOptions
    """Of a video, but for the seed of its world."""
    worlds: int = 0
    """Worlds of blocks that matches take turns in; 0 where each has its own."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DrawnView:
    """What the simulator draws of one frame for one camera."""

    rgb: UInt8[np.ndarray, "height width 3"]
    labels: UInt8[np.ndarray, "height width"]
    """1 + the object's place in the scene; 0 where none is."""


class ClipAgain(ABC):
    """A clip that can be drawn again."""

    @abstractmethod
    def camera(self, frame: int) -> Camera:
        """The camera with which the simulator drew a frame, by its number in the clip."""

    @abstractmethod
    def draw(self, frame: int, camera: Camera) -> DrawnView:
        """The state of a frame, by its number in the clip, as a camera for the simulator's pictures sees it."""


def simulated_run(work: Path) -> SimulatedRun:
    """What the run that wrote a work folder drew.

    Raises:
        ValueError: If `pgm simulate` did not write it, or drew a scene whose pictures cannot be drawn again.
    """
    path = work / "run.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["command"] != "pgm simulate":
            raise ValueError(f"{path}: command: expected pgm simulate, got {document['command']}")
        said = document["options"]
        scene = load_scene(said["scene"])
        if scene.court is not None and not is_played(scene):
            raise ValueError(f"{path}: scene: expected tennis or blocks, got {scene.name}")
        return SimulatedRun(
            scene=scene,
            seed=int(said["seed"]),
            options=_clip_options(scene, said),
            worlds=int(said.get("worlds", 0)),
        )
    except (OSError, KeyError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: expected the document of a run of pgm simulate, got {error!r}") from error


def _clip_options(scene: Scene, said: Mapping[str, Any]) -> ClipOptions:
    """What a video is like, of the options as a person gave them."""
    blocks = scene.court is None
    width, height = BLOCKS_SIZE if blocks else COURT_SIZE
    if said["resolution"]:
        width, height = (int(side) for side in said["resolution"].lower().split("x"))
    fps = said["fps"] or (BLOCKS_FPS if blocks else COURT_FPS)
    wind = said["wind"]
    return ClipOptions(
        frames=round(said["minutes"] * 60 * fps),
        width=width,
        height=height,
        fps=fps,
        motion=said["motion"],
        duplicates=said["duplicates"],
        closeups=said["closeups"],
        quality="draft" if said["pictures"] == "draft" else "full",
        shutter=said["shutter"],
        wind_ms=None if wind is None else (wind[0], wind[1]),
        surface=None if said["surface"] == "any" else said["surface"],
    )


def clips_again(run: SimulatedRun, wanted: list[str]) -> Iterator[tuple[str, ClipAgain]]:
    """The clips of those names, in the order in which the simulator comes to them, one in memory at a time.

    Raises:
        ValueError: If a name is none of the run's.
    """
    by_match: dict[int, dict[int, str]] = {}
    for name in wanted:
        found = re.fullmatch(rf"{re.escape(run.scene.name)}_{run.seed}_(\d+)(?:\.(\d+))?", name)
        if found is None:
            raise ValueError(f"clip {name}: expected one of the run of seed {run.seed} that drew {run.scene.name}")
        by_match.setdefault(int(found[1]), {})[int(found[2] or 0)] = name
    for match, clips in sorted(by_match.items()):
        missing = set(clips)
        draw = _blocks if run.scene.court is None else _tennis
        for number, again in enumerate(draw(run, match)):
            if number in clips:
                missing.discard(number)
                yield clips[number], again
            if not missing:
                break
        if missing:
            raise ValueError(f"clip {clips[min(missing)]}: expected the simulator to draw it again, got fewer clips")


@dataclass(frozen=True, eq=False)
class _BlocksAgain(ClipAgain):
    shot: BlocksShot

    def camera(self, frame: int) -> Camera:
        """The camera of a frame."""
        return Camera(**{name: value[frame] for name, value in vars(self.shot.track).items()})

    def draw(self, frame: int, camera: Camera) -> DrawnView:
        """The state of a frame as a camera sees it."""
        count = len(self.shot)
        track = CameraTrack(**{name: np.repeat(value[None], count, axis=0) for name, value in vars(camera).items()})
        shot = self.shot
        labels, _ = shot.studio.masks(track, shot.posture, frame, shot.size)
        return DrawnView(rgb=shot.studio.picture(track, shot.posture, frame, shot.size)[..., ::-1], labels=labels)


def _blocks(run: SimulatedRun, match: int) -> Iterator[ClipAgain]:
    options = run.options
    shots = blocks_shots(
        run.scene,
        match_seed(run.seed, match),
        frames=options.frames,
        fps=options.fps,
        size=(options.width, options.height),
        quality=options.quality,
        world_seed=world_seed(run.seed, match, run.worlds),
    )
    for shot in shots:
        yield _BlocksAgain(shot)


@dataclass(frozen=True, eq=False)
class _TennisAgain(ClipAgain):
    recording: Recording
    pictures: MatchPictures
    span: Span
    play: Play

    def camera(self, frame: int) -> Camera:
        """The camera of a frame."""
        start = float(self.span.capture_times[0])
        times = self.span.capture_times - start
        pose = poses_of(self.recording.operator, self.recording.base, self.play, times, start)[frame]
        return Camera(**{name: value[0] for name, value in vars(track_of([pose.view(self.recording.size)])).items()})

    def draw(self, frame: int, camera: Camera) -> DrawnView:
        """The state of a frame as a camera sees it; graphics lie where they lay."""
        view = View(
            K=camera.K,
            k1=float(camera.distortion[0]),
            R_cam_from_world=camera.R_cam_from_world,
            centre_world=camera.position_world,
        )
        one = slice(frame, frame + 1)
        times = (self.span.capture_times - self.span.capture_times[0])[one]
        span = Span(
            first=self.span.first + frame,
            timestamps=self.span.timestamps[one],
            capture_times=self.span.capture_times[one],
            is_duplicate=np.zeros(1, dtype=bool),
        )
        bgr = next(self.pictures.play(self.play, span, times, [view]))
        labels = next(self.pictures.masks(self.play, times, [view])).labels
        return DrawnView(rgb=bgr[..., ::-1], labels=labels)


def _tennis(run: SimulatedRun, match: int) -> Iterator[ClipAgain]:
    seed = match_seed(run.seed, match)
    recording = recording_of(run.scene, run.options, seed)
    clock = Clock(fps=run.options.fps, repeats=run.options.duplicates)
    pictures = MatchPictures(recording)
    played = plays(recording.match, np.random.default_rng([seed, PLAYS]))
    rng = np.random.default_rng([seed, CUTS])
    for span, play in cuts(rng, played, clock, run.options.frames, closeups=run.options.closeups):
        if play is not None:
            yield _TennisAgain(recording, pictures, span, play)
