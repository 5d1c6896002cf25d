"""A clip rendered as a video: frame by frame into a folder of parts, so that none is done twice, then as one file."""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from pgm_data.dataset.files import whole_file
from pgm_data.geometry.camera import Camera
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.insertions import Insertion
from pgm_models.synthesis.render_layers import Filmer, as_bgr, depth_of, labels_of
from pgm_models.synthesis.render_source import RenderClip
from pgm_models.synthesis.studio import Picture

PLAN_NAME = "plan.json"
"""File of the folder of parts with what its frames depend on."""
STATE = ".pgm"
FAST_PNG = 1
"""Compression of frames that are kept for minutes alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderPlan:
    """What is rendered, and where to."""

    out: Path
    """The video."""
    parts: Path
    """Folder of finished frames, which the caller holds."""
    frames: range
    """Of the clip."""
    fps: float
    """Frames that the video shows in a second."""
    crf: int
    """x264's quality of the video, 0 (lossless) to 51."""
    depth: bool
    """Whether a video of depth is written beside it."""
    masks: bool
    """Whether a video of labels is."""

    def files(self) -> tuple[Path, ...]:
        """The videos that are written."""
        wanted = (("labels.mkv", self.masks), ("depth.mkv", self.depth))
        return (self.out, *(beside(self.out, what) for what, is_wanted in wanted if is_wanted))


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderOutcome:
    """What became of it."""

    written: tuple[Path, ...]
    rendered: int
    """Frames, without those that were there already and those that are black."""
    seconds: float
    """That took, without writing the videos."""
    samples: int
    """Of volumes whose density was asked for, in those frames."""


Told = Callable[[int, float], None]
"""Is told how many frames are done, and how many a second were rendered so far."""


class OtherFrames(ValueError):
    """The folder of parts holds frames of an earlier run that this one would not make."""


def beside(out: Path, what: str) -> Path:
    """The file of that kind beside a video: `rally.mp4` has `rally.depth.mkv`, `rally.labels.mkv`, `rally.run.json`."""
    return out.with_name(f"{out.stem}.{what}")


def begin_parts(parts: Path, asked: Mapping[str, object]) -> None:
    """Note in the folder of parts what its frames depend on.

    Raises:
        OtherFrames: If frames are there that depend on something else; names the first such thing.
    """
    path = parts / PLAN_NAME
    if path.is_file():
        found = json.loads(path.read_text(encoding="utf-8"))
        names = [name for name in {**found, **asked} if found.get(name) != asked.get(name)]
        if names:
            expected, got = found.get(names[0]), asked.get(names[0])
            raise OtherFrames(f"expected {names[0]} as of the frames in {parts}, {expected}, got {got}")
        return
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(asked, indent=1), encoding="utf-8")


def render_clip(
    clip: RenderClip, filmer: Filmer, plan: RenderPlan, told: Told, *, inserted: Sequence[Insertion] = ()
) -> RenderOutcome:
    """Render the frames that are not there yet, and write the videos.

    Frames without a camera are black. Nothing appears under the names of the videos before it is whole.

    Args:
        clip: That is rendered.
        filmer: For pictures of the clip's size.
        plan: Which frames, and where to.
        told: Is told of every frame.
        inserted: Meshes that are put into every frame.

    Raises:
        ValueError: If the lens of a camera has no ray for a pixel; names clip and frame.
        KeyboardInterrupt: After which the finished frames are there.
    """
    still = clip.still()
    rendered, samples, begun = 0, 0, time.monotonic()
    for done, number in enumerate(plan.frames, 1):
        if not all(path.is_file() for path in _files(plan, number)):
            make = filmer.still if still[number] else filmer.moving
            samples += _render(clip, partial(make, inserted=inserted), plan, number)
            rendered += int(clip.row[number] >= 0)
        told(done, rendered / max(time.monotonic() - begun, 1e-9))
    seconds = time.monotonic() - begun
    return RenderOutcome(written=_written(plan), rendered=rendered, seconds=seconds, samples=samples)


def _render(clip: RenderClip, make: Callable[[Camera, States], Picture], plan: RenderPlan, number: int) -> int:
    """Render and keep one frame; samples of volumes that it took."""
    width, height = clip.size
    bgr = np.zeros((height, width, 3), dtype=np.uint8)
    labels, depth = bgr[..., 0], np.full((height, width), np.inf)
    samples, row = 0, int(clip.row[number])
    if row >= 0:
        camera, states = clip.store.cameras[row], clip.store.states([row])
        try:
            picture = make(camera, states)
        except ValueError as error:
            raise ValueError(f"{clip.store.place(row)}: {error}") from error
        bgr, samples = as_bgr(picture), picture.looked_at
        if plan.depth or plan.masks:
            labels, depth = labels_of(picture), depth_of(picture, camera)
    _keep(plan, number, bgr, labels, depth)
    return samples


def _files(plan: RenderPlan, number: int) -> list[Path]:
    """Files of a finished frame: the picture, and labels and depth where they are wanted."""
    names = ["png", "labels.png", "depth.png"] if plan.depth or plan.masks else ["png"]
    return [plan.parts / f"{number:06d}.{name}" for name in names]


def _keep(
    plan: RenderPlan,
    number: int,
    bgr: UInt8[np.ndarray, "height width 3"],
    labels: UInt8[np.ndarray, "height width"],
    depth: np.ndarray,
) -> None:
    from pgm_data.simulate.mask_files import steps_of_depth

    for path, image in zip(_files(plan, number), (bgr, labels, steps_of_depth(depth)), strict=False):
        _write_png(path, image)


def _write_png(path: Path, image: np.ndarray) -> None:
    import cv2

    encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, FAST_PNG])[1]
    with whole_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())


def _read_png(path: Path) -> np.ndarray:
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{path}: expected a finished frame, got a file that cannot be read; delete it and go on")
    return image


def _written(plan: RenderPlan) -> tuple[Path, ...]:
    """Write the videos from the finished frames; the files."""
    from pgm_data.video import write_video

    written = []
    if plan.depth or plan.masks:
        written += _write_masks(plan)
    write_video(plan.out, (_read_png(_files(plan, number)[0]) for number in plan.frames), fps=plan.fps, crf=plan.crf)
    return (plan.out, *written)


def _write_masks(plan: RenderPlan) -> list[Path]:
    from pgm_data.simulate.mask_files import DEPTH, DEPTH_UNIT_M, LABELS, write_masks
    from pgm_data.simulate.shots import Masks

    def masks() -> Iterator[Masks]:
        for number in plan.frames:
            _, labels, depth = (_read_png(path) for path in _files(plan, number))
            metres = np.where(depth > 0, depth * np.float32(DEPTH_UNIT_M), np.float32(np.inf)).astype(np.float32)
            yield Masks(labels=labels, depth=metres)

    write_masks(plan.parts / STATE, masks(), fps=plan.fps)
    written = []
    for wanted, name, what in ((plan.masks, LABELS, "labels.mkv"), (plan.depth, DEPTH, "depth.mkv")):
        if wanted:
            os.replace(plan.parts / STATE / name, beside(plan.out, what))
            written.append(beside(plan.out, what))
    return written
