"""Fills an output folder: videos in `videos/`, their truth as a work folder in `work/`."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pgm_data.dataset.tables import write_table
from pgm_data.scene import Scene
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.clip import ClipOptions, SimulatedClip, simulate_clip
from pgm_data.simulate.mix import MixOptions, mix_pictures
from pgm_data.simulate.store import write_camera_truth, write_clip_truth
from pgm_data.simulate.views import View, track_of
from pgm_data.video import write_video

Pictures = Literal["none", "draft", "full"]
MIX_LENS = "every picture has its own lens"
CLIP_LENS = "the lens that drew the pictures: one radial term"
AWAY = "the shot does not show the court"


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


def match_seed(seed: int, match: int) -> int:
    """The seed of one match of a run."""
    return int(np.random.SeedSequence([seed, match]).generate_state(1)[0])


def write_match(
    out: Path, scene: Scene, options: ClipOptions, *, seed: int, match: int, pictures: Pictures, keep: bool = False
) -> Written:
    """Draw and write one match with its truth; with `keep`, what an earlier run finished stays as it is.

    Without pictures the tables are the same and the video is absent.
    """
    name = f"{scene.name}_{seed}_{match:03d}"
    clip = simulate_clip(scene, options, match_seed(seed, match))
    video = out / "videos" / f"{name}.mp4"
    shots = _shots(clip.track, name)
    written = Written(video=f"../videos/{video.name}", timestamps=clip.timestamps, clip_of=_clip_of(shots, len(clip)))
    done = all((out / "work" / c / "camera.parquet").exists() for c in written.clips)
    if keep and done and (video.exists() or pictures == "none"):
        return written
    if pictures != "none":
        video.parent.mkdir(parents=True, exist_ok=True)
        write_video(video, clip.frames(), fps=options.fps, crf=20)
    for clip_id, start, stop in shots:
        _write_truth(out, clip, name, clip_id, video, start, stop)
    return written


def _write_truth(out: Path, clip: SimulatedClip, match: str, clip_id: str, video: Path, start: int, stop: int) -> None:
    part = slice(start, stop)
    track = CameraTrack(
        K=clip.track.K[part],
        distortion=clip.track.distortion[part],
        R_cam_from_world=clip.track.R_cam_from_world[part],
        t_cam_from_world=clip.track.t_cam_from_world[part],
    )
    folder = out / "work" / clip_id
    folder.mkdir(parents=True, exist_ok=True)
    write_clip_truth(
        folder,
        clip_id=clip_id,
        match_id=match,
        video=video,
        source_path=f"../videos/{video.name}",
        scene=clip.scene,
        size=(clip.width, clip.height),
        first_video_frame=start,
        track=track,
        lens_reason=CLIP_LENS,
    )
    write_camera_truth(
        folder,
        clip_id=clip_id,
        scene=clip.scene,
        track=track,
        timestamps=clip.timestamps[part],
        first_video_frame=start,
        capture_times=clip.capture_times[part],
        is_duplicate=clip.is_duplicate[part],
    )


def _shots(track: CameraTrack, name: str) -> list[tuple[str, int, int]]:
    """(clip id, first frame, frame after the last) of every shot that shows the court."""
    steps = np.diff(np.concatenate([[0], track.shows_court.astype(int), [0]]))
    spans = list(zip(np.flatnonzero(steps == 1), np.flatnonzero(steps == -1), strict=True))
    names = [name] if len(spans) == 1 else [f"{name}.{i:02d}" for i in range(len(spans))]
    return [(n, int(a), int(b)) for n, (a, b) in zip(names, spans, strict=True)]


def _clip_of(shots: list[tuple[str, int, int]], frames: int) -> tuple[str, ...]:
    names = [""] * frames
    for clip_id, start, stop in shots:
        names[start:stop] = [clip_id] * (stop - start)
    return tuple(names)


def write_mix_video(
    out: Path, scene: Scene, options: MixOptions, *, seed: int, video: int, keep: bool = False
) -> Written:
    """Draw and write one video of the mix with its truth, the cameras last; with `keep`, a finished one stays."""
    name = f"mix_{seed}_{video:04d}"
    path = out / "videos" / f"{name}.mp4"
    folder = out / "work" / name
    count = options.pictures_of(video)
    times = np.arange(count) / options.fps
    written = Written(video=f"../videos/{path.name}", timestamps=times, clip_of=(name,) * count)
    if keep and path.exists() and (folder / "camera.parquet").exists():
        return written
    path.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    views: list[View | None] = []

    def pictures() -> Iterator[np.ndarray]:
        for picture, view in mix_pictures(scene, options, seed, video):
            views.append(view)
            yield picture

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
    return written


def write_shots(out: Path, scene: Scene, videos: Iterable[Written]) -> None:
    """`work/shots.parquet` of all videos."""
    written = list(videos)
    clips = [c for w in written for c in w.clip_of]
    (out / "work").mkdir(parents=True, exist_ok=True)
    write_table(
        out / "work" / "shots.parquet",
        table="shots",
        scene=scene,
        columns={
            "video": [w.video for w in written for _ in w.clip_of],
            "video_frame": np.concatenate([np.arange(len(w.clip_of), dtype=np.int64) for w in written]),
            "timestamp": np.concatenate([w.timestamps for w in written]),
            "verdict": ["clip" if c else "other" for c in clips],
            "reason": ["" if c else AWAY for c in clips],
            "clip_id": clips,
        },
    )
