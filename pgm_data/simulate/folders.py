"""Fills an output folder: videos in `videos/`, their truth as a work folder in `work/`."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pgm_data.dataset.tables import write_table
from pgm_data.scene import Scene
from pgm_data.simulate.mix import MixOptions, mix_pictures
from pgm_data.simulate.store import write_camera_truth, write_clip_truth
from pgm_data.simulate.views import View, track_of
from pgm_data.video import write_video

MIX_LENS = "every picture has its own lens"


def write_mix_video(out: Path, scene: Scene, options: MixOptions, seed: int, video: int) -> str:
    """Draw and write one video of the mix with its truth; returns its clip id. The truth is written last."""
    clip_id = f"mix_{seed}_{video:04d}"
    path = out / "videos" / f"{clip_id}.mp4"
    folder = out / "work" / clip_id
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
        clip_id=clip_id,
        match_id=clip_id,
        video=path,
        source_path=f"../videos/{path.name}",
        scene=scene,
        size=(options.width, options.height),
        first_video_frame=0,
        track=track,
        lens_reason=MIX_LENS,
    )
    times = np.arange(len(track)) / options.fps
    write_camera_truth(folder, clip_id=clip_id, scene=scene, track=track, timestamps=times)
    return clip_id
