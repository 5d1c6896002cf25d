"""The clip that is rendered: what moves in each of its frames, and the camera that sees it."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.dataset.documents import parse_document
from pgm_data.dataset.pack_plan import clip_folders
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene
from pgm_models.animation.play_camera import PlayCamera
from pgm_models.animation.shards import EPISODE, FRAME, TIME
from pgm_models.synthesis.frame_rows import (
    CAMERA,
    SHOWN,
    Clip,
    Rows,
    dataset_clips,
    dataset_rows,
    frame_arrays,
    joined_arrays,
    work_clips,
    work_rows,
)
from pgm_models.synthesis.frames import FrameStore
from pgm_models.synthesis.object_boxes import scaled_K
from pgm_models.synthesis.picture_shelf import PictureShelf

GIVEN = "given"
"""Status of cameras that are not the clip's own."""
USUAL_HZ = 25.0
"""Frames a second of a clip whose frames have no rate."""
NAMED = 8
"""Clips that an error names."""

CameraAt = Callable[[Float[np.ndarray, " frames"]], PlayCamera]
"""Cameras at the times, seconds from the clip's first frame."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderSource:
    """A clip of a packed dataset or of a work folder, before it is known which camera sees it."""

    path: Path
    """Of the dataset or the work folder."""
    clip: Clip
    packed: bool
    """Whether it is in a packed dataset."""
    folder: Path
    """Of the clip where it is in a work folder, else of the dataset."""
    number: int
    """Of its episode in a dataset; 0 in a work folder."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderClip:
    """All that rendering needs of a clip, for pictures of one size."""

    name: str
    store: FrameStore
    """Those of its frames that have a camera."""
    row: Int[np.ndarray, " frames"]
    """Of each frame of the clip: its row in the store; -1 where it has no camera."""
    rate: float
    """Frames a second."""

    def __len__(self) -> int:
        """Frames, those without a camera included."""
        return len(self.row)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its pictures."""
        return self.store.size

    def still(self) -> Bool[np.ndarray, " frames"]:
        """Whether the camera of each frame is that of a frame beside it, to the last digit."""
        cameras, rows = self.store.cameras, self.row
        parts = [getattr(cameras, name).reshape(len(self.store), -1) for name in vars(cameras)]
        numbers = np.concatenate(parts, axis=1)[rows]
        same = (rows[1:] >= 0) & (rows[:-1] >= 0) & (numbers[1:] == numbers[:-1]).all(axis=1)
        return np.append(same, False) | np.append(False, same)

    def missing(self, frames: Sequence[int]) -> dict[str, int]:
        """In how many of those frames there is no `camera`, and with a camera none of each object that moves."""
        rows = self.row[np.asarray(frames, dtype=np.int64)]
        own = rows[rows >= 0]
        counts = {"camera": int((rows < 0).sum())}
        for name, values in self.store.rotations.items():
            counts[name] = int(np.isnan(values[own]).any(axis=(1, 2)).sum())
        for thing in self.store.scene.objects:
            if thing.kind == "ball":
                counts[thing.name] = int(np.isnan(self.store.ball_position[own]).any(axis=1).sum())
        return {name: count for name, count in counts.items() if count}

    def digest(self) -> str:
        """SHA-256 of all that its pictures depend on."""
        store = self.store
        found = hashlib.sha256(repr((self.name, self.size, len(self))).encode())
        arrays = [self.row, store.ball_position, store.ball_path, *vars(store.cameras).values()]
        for values in (*arrays, *store.rotations.values(), *store.translations.values()):
            found.update(np.ascontiguousarray(values).tobytes())
        return found.hexdigest()


def find_clip(path: Path, *, clip: str = "", video: str = "", videos: Path | None = None) -> RenderSource:
    """The clip of a packed dataset, of a work folder, or of a clip's own folder.

    Args:
        path: Of the folder.
        clip: Its id; may be left out where there is but one.
        video: Match that it belongs to, or name of its video, without its suffix.
        videos: Folder of a work folder's videos, where they are no longer where they were.

    Raises:
        ValueError: If there is none, or more than one; names those that there are.
    """
    packed = (path / "meta" / "info.json").is_file()
    if packed:
        folders = [path]
        clips = dataset_clips(path)
    else:
        folders = clip_folders(path)
        if not folders:
            raise ValueError(f"{path}: expected a packed dataset or a work folder, got no clip there")
        clips = work_clips(folders, videos)
    ids = [each.clip_id for each in clips]
    if clip and clip not in ids:
        raise ValueError(f"clip: expected one of {_some(ids)}, got {clip!r}")
    found = [number for number, each in enumerate(clips) if not clip or each.clip_id == clip]
    if video:
        of_video = [number for number in found if video in _videos(clips[number], packed=packed)]
        if not of_video:
            known = [name for number in found for name in _videos(clips[number], packed=packed)]
            raise ValueError(f"video: expected one of {_some(list(dict.fromkeys(known)))}, got {video!r}")
        found = of_video
    if len(found) != 1:
        raise ValueError(f"clip: expected one, to say which, of {_some([ids[number] for number in found])}, got none")
    number = found[0]
    folder = path if packed else folders[number]
    return RenderSource(path=path, clip=clips[number], packed=packed, folder=folder, number=number if packed else 0)


def _videos(clip: Clip, *, packed: bool) -> tuple[str, ...]:
    """Names by which the video of a clip goes; files of a dataset are numbered."""
    names = (clip.match_id,) if packed or clip.video is None else (clip.match_id, clip.video.stem)
    return tuple(dict.fromkeys(names))


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "")


def scene_name(source: RenderSource) -> str:
    """Name of the scene that a clip shows.

    Raises:
        ValueError: If no document says it.
    """
    path = source.folder / ("meta/info.json" if source.packed else "clip.json")
    document = parse_document(path)
    try:
        return str((document["pgm"] if source.packed else document)["scene"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: scene: expected the name of a scene, got {error!r}") from error


def read_clip(source: RenderSource, scene: Scene, size: tuple[int, int], cameras: CameraAt | None = None) -> RenderClip:
    """The clip for pictures of that size.

    Pictures of another shape than the camera's show as much from left to right, and less or more from top to bottom.

    Args:
        source: Of `find_clip`.
        scene: What it shows.
        size: Width and height of the pictures.
        cameras: Other cameras than its own.

    Raises:
        ValueError: If its tables are not sound, or no frame has a camera; names file, clip, frame and column.
    """
    rows = _rows(source, scene)
    seconds = rows[TIME] - rows[TIME][0]
    found, shape = _cameras_of(rows), (source.clip.width, source.clip.height)
    status = rows[CAMERA[0]]
    if cameras is not None:
        view = cameras(seconds)
        found, shape = view.camera, view.size
        status = np.full(len(seconds), GIVEN, dtype=object)
    rows = {
        **rows,
        **_columns_of(refitted(found, shape, size)),
        CAMERA[0]: status,
        EPISODE: np.zeros(len(seconds), int),
    }
    # Cameras are those of the wanted pictures already.
    clip = replace(source.clip, width=size[0], height=size[1])
    people: dict[str, int] = {}
    arrays = joined_arrays([frame_arrays(scene, rows, [clip], size, people)])
    if not arrays:
        raise ValueError(
            f"{source.path}: clip {clip.clip_id}: expected frames with a camera, got none in {len(seconds)}"
        )
    row = np.full(len(seconds), -1, dtype=np.int64)
    row[np.searchsorted(rows[FRAME], arrays["frame"])] = np.arange(len(arrays["frame"]))
    store = FrameStore(scene=scene, size=size, clips=(clip,), identities=tuple(people), shelf=PictureShelf(0), **arrays)
    return RenderClip(name=clip.clip_id, store=store, row=row, rate=_rate(rows[SHOWN]))


def refitted(camera: Camera, shape: tuple[int, int], size: tuple[int, int]) -> Camera:
    """Cameras for pictures of another size: as much from left to right, less or more from top to bottom.

    Args:
        camera: Of pictures of that shape.
        shape: Width and height of these.
        size: Those of the wanted pictures.
    """
    scale = size[0] / shape[0]
    K = scaled_K(camera.K, np.array([scale, scale]))
    K[..., 1, 2] += (size[1] - scale * shape[1]) / 2
    return replace(camera, K=K)


def picture_size(shape: tuple[int, int], limit: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the largest picture of that shape within the limit."""
    scale = min(limit[0] / shape[0], limit[1] / shape[1])
    return max(1, round(shape[0] * scale)), max(1, round(shape[1] * scale))


def _rows(source: RenderSource, scene: Scene) -> Rows:
    """All rows of the clip, in the order of its frames."""
    if source.packed:
        clips = dataset_clips(source.path)
        parts = [
            {name: values[rows[EPISODE] == source.number] for name, values in rows.items()}
            for rows in dataset_rows(source.path, scene, clips)
        ]
    else:
        parts = [dict(rows) for rows in work_rows([source.folder], [source.clip])]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(joined[FRAME], kind="stable")
    if not len(order):
        raise ValueError(f"{source.path}: clip {source.clip.clip_id}: expected frames, got none")
    return {name: values[order] for name, values in joined.items()}


def _cameras_of(rows: Rows) -> Camera:
    K, distortion, R, t = (rows[name] for name in CAMERA[1:])
    return Camera(
        K=K.reshape(-1, 3, 3), distortion=distortion, R_cam_from_world=R.reshape(-1, 3, 3), t_cam_from_world=t
    )


def _columns_of(camera: Camera) -> Rows:
    frames = len(camera.K)
    parts = (camera.K, camera.distortion, camera.R_cam_from_world, camera.t_cam_from_world)
    return {name: part.reshape(frames, -1) for name, part in zip(CAMERA[1:], parts, strict=True)}


def _rate(shown: Float[np.ndarray, " frames"]) -> float:
    """Frames a second at the usual step between frames, as a ratio that a video's header can hold."""
    steps = np.diff(shown)
    step = float(np.median(steps)) if len(steps) else 0.0
    return float(Fraction(1 / step).limit_denominator(1001)) if step > 0 else USUAL_HZ
