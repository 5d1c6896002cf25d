"""Fills an output folder: videos in `videos/`, their truth as a work folder in `work/`."""

import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions
from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.clip import simulate_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.mask_files import write_masks
from pgm_data.simulate.mix import MixOptions, mix_pictures
from pgm_data.simulate.shots import Graphics, SimulatedShot
from pgm_data.simulate.store import content_of, write_camera_truth, write_clip_truth
from pgm_data.simulate.truth_tables import write_states
from pgm_data.simulate.views import View, track_of
from pgm_data.video import write_video

T = TypeVar("T")
Pictures = Literal["none", "draft", "full"]
MIX_LENS = "every picture has its own lens"
CLIP_LENS = "the lens that drew the pictures: one radial term"
AWAY = "the shot does not show the court"
PARTS = Path(".pgm") / "shots"
"""Where each finished video's rows of `shots.parquet` lie."""

Said = Callable[[int, int], None]
"""Told how many of a video's frames are done, now and then."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Written:
    """What became of every frame of one written video."""

    video: str
    """Path from the work folder, as `clip.json` and `shots.parquet` have it."""
    timestamps: np.ndarray
    """Presentation times, s."""
    clip_of: tuple[str, ...]
    """The clip of every frame; empty where its shot does not show the court."""

    @property
    def clips(self) -> tuple[str, ...]:
        """The video's clips, in order."""
        return tuple(dict.fromkeys(c for c in self.clip_of if c))


@dataclass(frozen=True, kw_only=True)
class MatchFiles:
    """What is written of a match."""

    pictures: Pictures = "full"
    """`none`: the tables alone."""
    masks: bool = False
    """Labels and depth of every frame beside the tables."""


def match_seed(seed: int, match: int) -> int:
    """The seed of one match of a run."""
    return int(np.random.SeedSequence([seed, match]).generate_state(1)[0])


def world_seed(seed: int, match: int, worlds: int) -> int | None:
    """The seed of the world of one match of a run whose matches take turns in so many; None where each has its own."""
    if not worlds:
        return None
    # Not the entropy of any match, which is two numbers long.
    return int(np.random.SeedSequence([seed, match % worlds, 1]).generate_state(1)[0])


def match_name(scene: Scene, seed: int, match: int) -> str:
    """What a match's video, and its clip if it has one only, are called."""
    return f"{scene.name}_{seed}_{match:03d}"


def mix_name(seed: int, video: int) -> str:
    """What a video of the mix and its clip are called."""
    return f"mix_{seed}_{video:04d}"


def video_of(file: str) -> str:
    """The name of the video to which a file or folder of that name belongs, whole or half written."""
    return re.sub(r"(\.\d\d+)?(\.(mp4|parquet))?(\.\d+\.(tmp|part\.mp4))?$", "", file).removeprefix(".")


def clear_video(out: Path, name: str) -> None:
    """Delete all there is of one video, whole or half written."""
    # The rows go first: without them the video counts as not written.
    for folder in (out / PARTS, out / "videos", out / "work"):
        for path in sorted(folder.iterdir()) if folder.is_dir() else ():
            if video_of(path.name) == name:
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def nothing_said(done: int, total: int) -> None:
    """For who does not ask."""


def write_match(
    out: Path,
    scene: Scene,
    options: ClipOptions,
    files: MatchFiles,
    *,
    seed: int,
    match: int,
    said: Said = nothing_said,
) -> Written:
    """Simulate and write one match with its truth, in place of what there is of it.

    Without pictures the tables are the same and the video is absent.
    """
    name = match_name(scene, seed, match)
    clear_video(out, name)
    video = out / "videos" / f"{name}.mp4"
    writer = _MatchWriter(out, scene, options, files, name, said)
    shots = simulate_shots(scene, options, match_seed(seed, match))
    if files.pictures == "none":
        for shot in writer.named(shots):
            writer.add(*shot)
    else:
        video.parent.mkdir(parents=True, exist_ok=True)
        preset = "veryfast" if files.pictures == "full" else "ultrafast"
        write_video(video, writer.pictures(shots), fps=options.fps, crf=20, preset=preset)
    writer.finish(video)
    written = Written(
        video=f"../videos/{video.name}",
        timestamps=np.concatenate(writer.timestamps),
        clip_of=tuple(writer.clip_of),
    )
    write_part(out, scene, written)
    return written


class _MatchWriter:
    """Takes a match's shots one by one."""

    def __init__(self, out: Path, scene: Scene, options: ClipOptions, files: MatchFiles, name: str, said: Said) -> None:
        self._out, self._scene, self._options, self._files, self._name = out, scene, options, files, name
        self._said = said
        # A frame is gone through once for its picture and once for its masks.
        self._passes = max((files.pictures != "none") + files.masks, 1)
        self._steps = 0
        self.timestamps: list[np.ndarray] = []
        self.clip_of: list[str] = []
        self._open: list[_Unfinished] = []

    def named(self, shots: Iterator[SimulatedShot]) -> Iterator[tuple[str, SimulatedShot]]:
        """The shots with their clips' names: the match's own if it has one clip only, else numbered."""
        waiting: list[SimulatedShot] = []
        count = 0
        for shot in shots:
            waiting.append(shot)
            if sum(s.kind == "clip" for s in waiting) + count < 2:
                continue
            for early in waiting:
                yield (f"{self._name}.{count:02d}" if early.kind == "clip" else ""), early
                count += early.kind == "clip"
            waiting = []
        for shot in waiting:
            yield (self._name if shot.kind == "clip" else ""), shot

    def pictures(self, shots: Iterator[SimulatedShot]) -> Iterator[np.ndarray]:
        """The pictures of all shots; the truth of each is written before its first."""
        for clip_id, shot in self.named(shots):
            self.add(clip_id, shot)
            yield from self._counted(shot.pictures())
            self._reach(shot)

    def _counted(self, frames: Iterator[T]) -> Iterator[T]:
        """The frames of one pass, told of one by one."""
        for frame in frames:
            yield frame
            self._steps += 1
            self._said(self._steps // self._passes, self._options.frames)

    def _reach(self, shot: SimulatedShot) -> None:
        """All passes through the shot are over."""
        frames = shot.first_frame + len(shot)
        self._steps = frames * self._passes
        self._said(frames, self._options.frames)

    def add(self, clip_id: str, shot: SimulatedShot) -> None:
        """Write the tables of one shot."""
        self.timestamps.append(shot.timestamps)
        self.clip_of += [clip_id] * len(shot)
        if clip_id:
            self._add_clip(clip_id, shot)
        if self._files.pictures == "none":
            self._reach(shot)

    def _add_clip(self, clip_id: str, shot: SimulatedShot) -> None:
        folder = self._out / "work" / clip_id
        size = (self._options.width, self._options.height)
        write_camera_truth(
            folder,
            clip_id=clip_id,
            scene=self._scene,
            track=shot.track,
            timestamps=shot.timestamps,
            first_video_frame=shot.first_frame,
            capture_times=shot.capture_times,
            is_duplicate=shot.is_duplicate,
        )
        if shot.states is not None:
            write_states(
                folder,
                clip_id=clip_id,
                scene=self._scene,
                states=shot.states,
                track=shot.track,
                timestamps=shot.timestamps,
                capture_times=shot.capture_times,
                first_video_frame=shot.first_frame,
                size=size,
            )
        if self._files.masks and shot.masks is not None:
            write_masks(folder, self._counted(shot.masks()), fps=self._options.fps)
        people = () if shot.states is None else shot.states.players
        self._open.append(
            _Unfinished(
                clip_id=clip_id,
                first_frame=shot.first_frame,
                graphics=shot.graphics,
                players={
                    player.name: {"identity": person.identity, "handedness": person.handedness}
                    for player, person in zip(self._scene.players, people, strict=False)
                },
            )
        )

    def finish(self, video: Path) -> None:
        """Write every clip's document, once the video that they name is whole."""
        content = content_of(video)
        for clip in self._open:
            folder = self._out / "work" / clip.clip_id
            # The cameras are read back: kept in memory they would grow with the match.
            table = read_table(folder / "camera.parquet")
            write_clip_truth(
                folder,
                clip_id=clip.clip_id,
                match_id=self._name,
                video=content,
                source_path=f"../videos/{video.name}",
                scene=self._scene,
                size=(self._options.width, self._options.height),
                first_video_frame=clip.first_frame,
                track=CameraTrack(
                    K=table["camera.K"].reshape(-1, 3, 3),
                    distortion=table["camera.distortion"],
                    R_cam_from_world=table["camera.R_cam_from_world"].reshape(-1, 3, 3),
                    t_cam_from_world=table["camera.t_cam_from_world"],
                ),
                lens_reason=CLIP_LENS,
                shutter_s=clip.graphics.shutter_s,
                ui_boxes_px=clip.graphics.ui_boxes_px,
                players=clip.players,
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Unfinished:
    """A clip whose document waits for its video."""

    clip_id: str
    first_frame: int
    graphics: Graphics
    players: dict[str, dict[str, str | None]]


def part_path(out: Path, name: str) -> Path:
    """Where the rows of a finished video are."""
    return out / PARTS / f"{name}.parquet"


def read_part(out: Path, name: str) -> Written:
    """What became of the frames of a video that was finished."""
    rows = read_table(part_path(out, name))
    return Written(video=rows["video"][0], timestamps=rows["timestamp"], clip_of=tuple(rows["clip_id"]))


def write_part(out: Path, scene: Scene, written: Written) -> None:
    """Note what became of a video's frames; after that it counts as finished."""
    path = part_path(out, Path(written.video).stem)
    path.parent.mkdir(parents=True, exist_ok=True)
    _write_rows(path, scene, written)


def _write_rows(path: Path, scene: Scene, *videos: Written) -> None:
    """The table of shots of some videos."""
    clips = [c for w in videos for c in w.clip_of]
    write_table(
        path,
        table="shots",
        scene=scene,
        columns={
            "video": [w.video for w in videos for _ in w.clip_of],
            "video_frame": np.concatenate([np.arange(len(w.clip_of), dtype=np.int64) for w in videos]),
            "timestamp": np.concatenate([w.timestamps for w in videos]),
            "verdict": ["clip" if c else "other" for c in clips],
            "reason": ["" if c else AWAY for c in clips],
            "clip_id": clips,
        },
    )


def write_mix_video(
    out: Path, scene: Scene, options: MixOptions, *, seed: int, video: int, said: Said = nothing_said
) -> Written:
    """Draw and write one video of the mix with its truth, in place of what there is of it."""
    name = mix_name(seed, video)
    clear_video(out, name)
    path = out / "videos" / f"{name}.mp4"
    folder = out / "work" / name
    count = options.pictures_of(video)
    times = np.arange(count) / options.fps
    path.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    views: list[View | None] = []

    def pictures() -> Iterator[np.ndarray]:
        for picture, view in mix_pictures(scene, options, seed, video):
            views.append(view)
            yield picture
            said(len(views), count)

    quality = int(np.random.default_rng([seed, video, 1]).integers(16, 31))
    write_video(path, pictures(), fps=options.fps, crf=quality, preset="superfast", gop=1)
    track = track_of(views)
    write_clip_truth(
        folder,
        clip_id=name,
        match_id=name,
        video=path,
        source_path=f"../videos/{path.name}",
        scene=scene,
        size=(options.width, options.height),
        first_video_frame=0,
        track=track,
        lens_reason=MIX_LENS,
    )
    write_camera_truth(folder, clip_id=name, scene=scene, track=track, timestamps=times)
    written = Written(video=f"../videos/{path.name}", timestamps=times, clip_of=(name,) * count)
    write_part(out, scene, written)
    return written


def pack_truth(out: Path, scene: Scene, *, videos: bool) -> None:
    """Pack `work/` into `dataset/`, in place of one that is there.

    Raises:
        RuntimeError: If a clip cannot be packed, which would be a fault of the simulator.
    """
    shutil.rmtree(out / "dataset", ignore_errors=True)
    (out / "dataset").mkdir()
    options = PackOptions(videos="link" if videos else "none")
    outcome = pack_work_folders([out / "work"], out / "dataset", options, scene=scene)
    if outcome.problems:
        raise RuntimeError(f"{outcome.problems[0]}, and {len(outcome.problems) - 1} more")


def write_shots(out: Path, scene: Scene, videos: Iterable[Written]) -> None:
    """`work/shots.parquet` of all videos."""
    (out / "work").mkdir(parents=True, exist_ok=True)
    _write_rows(out / "work" / "shots.parquet", scene, *videos)
