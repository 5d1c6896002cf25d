"""Rows of datasets and work folders that show something, turned into what rendering needs of each frame."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float, Int

from pgm_data.dataset.dataset_columns import VIDEO_KEY
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.source_video import VideoNotFound, find_source_video
from pgm_data.dataset.tables import numpy_column, read_table
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene, SceneObject
from pgm_data.skeleton import world_joints
from pgm_models.animation.shards import ABSENT, EPISODE, FRAME, ROWS, TIME, column_names, data_files, refuse_unsound
from pgm_models.synthesis.object_boxes import BODY_MARGIN_M, boxes_px, scaled_K, whole_picture
from pgm_models.synthesis.worlds import world_box

NUMBER, SHOWN = "video_frame", "shown"
"""Columns: a frame's number in its video, and when that shows it, seconds."""
CAMERA = ("camera.status", "camera.K", "camera.distortion", "camera.R_cam_from_world", "camera.t_cam_from_world")
PLAYER = ("status", "identity", "joint_rotations", "joint_translations")
BALL = ("ball.status", "ball.position", "ball.velocity")

Rows = Mapping[str, np.ndarray]
"""Columns of some frames by name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Clip:
    """One uninterrupted shot."""

    clip_id: str
    match_id: str
    video: Path | None
    """Its video; None where it has none."""
    no_video: str
    """Why it has none; empty where it has one."""
    width: int
    """Of the pictures that its tables speak of, pixels; the video's own may be scaled."""
    height: int
    frames: int
    """Of the clip, those without a camera included."""
    shutter_s: float
    """How long the shutter was open, seconds; NaN where nobody knows."""
    ui_boxes_px: Float[np.ndarray, "boxes 4"]
    """Graphics over the picture: x0, y0, x1, y1, in pixels of its tables."""

    def factor(self, size: tuple[int, int]) -> Float[np.ndarray, " 2"]:
        """How much its pictures are scaled in x and y to have that width and height."""
        return np.array([size[0] / self.width, size[1] / self.height])


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameArrays:
    """Some frames with cameras; fields as those of `FrameStore`."""

    clip: Int[np.ndarray, " frames"]
    frame: Int[np.ndarray, " frames"]
    time: Float[np.ndarray, " frames"]
    video_frame: Int[np.ndarray, " frames"]
    video_time: Float[np.ndarray, " frames"]
    cameras: Camera
    rotations: Mapping[str, Float[np.ndarray, "frames joints 3"]]
    translations: Mapping[str, Float[np.ndarray, "frames joints 3"]]
    identity: Int[np.ndarray, "frames players"]
    ball_position: Float[np.ndarray, "frames 3"]
    ball_path: Float[np.ndarray, "frames 3"]
    boxes_px: Float[np.ndarray, "frames objects 4"]


def dataset_clips(dataset: Path) -> tuple[Clip, ...]:
    """The clips of a packed dataset, in the order of their episodes.

    Raises:
        ValueError: If its table of episodes cannot be read.
    """
    return tuple(_dataset_clip(dataset, document) for document in _episodes(dataset))


def _episodes(dataset: Path) -> list[dict[str, Any]]:
    folder = dataset / "meta" / "episodes"
    try:
        tables = [pq.read_table(path) for path in sorted(folder.glob("chunk-*/file-*.parquet"))]
        return pa.concat_tables(tables).sort_by(EPISODE).to_pylist()
    except (pa.ArrowException, OSError) as error:
        raise ValueError(f"{folder}: expected a table of episodes, got {error}") from error


def _dataset_clip(dataset: Path, document: Mapping[str, Any]) -> Clip:
    name = document.get("video_path")
    no_video = "" if name else "picture: expected a video in the dataset, got a clip packed without"
    if name and not (dataset / name).is_file():
        no_video = f"picture: expected the video {dataset / name}, got nothing there"
    return _clip(document, document["length"], None if no_video else dataset / str(name), no_video)


def work_clips(folders: Sequence[Path], videos: Path | None) -> tuple[Clip, ...]:
    """The clips of clip folders; their videos are looked for below `videos` where that is given.

    Raises:
        ValueError: If a `clip.json` is not sound.
    """
    clips = []
    for folder in folders:
        document = read_document(folder / "clip.json", "clip")
        video, no_video = None, "picture: expected a video, got a clip that was made without"
        if document["bytes"]:
            try:
                video, no_video = find_source_video(folder.resolve().parent, document, videos), ""
            except VideoNotFound as error:
                no_video = str(error)
        clips.append(_clip(document, document["n_frames"], video, no_video))
    return tuple(clips)


def _clip(document: Mapping[str, Any], frames: int, video: Path | None, no_video: str) -> Clip:
    shutter = document["shutter_s"]
    return Clip(
        clip_id=document["clip_id"],
        match_id=document["match_id"],
        video=video,
        no_video=no_video,
        width=document["width"],
        height=document["height"],
        frames=frames,
        shutter_s=float("nan") if shutter is None else float(shutter),
        ui_boxes_px=np.array(document["ui_boxes_px"] or [], dtype=np.float64).reshape(-1, 4),
    )


def dataset_rows(dataset: Path, scene: Scene, clips: Sequence[Clip]) -> Iterator[Rows]:
    """Rows of a packed dataset, some at a time, with the time at which the videos show each.

    Raises:
        ValueError: If a column is not there, or a number is not sound; names file, clip, frame and column.
    """
    start = np.array([row.get(f"videos/{VIDEO_KEY}/from_timestamp") or 0.0 for row in _episodes(dataset)])
    available = column_names(dataset)
    names = [EPISODE, FRAME, TIME, NUMBER, "timestamp", *(name for name in _columns_of(scene) if name in available)]
    for path in data_files(dataset):
        try:
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(batch_size=ROWS, columns=names):
                    found = {name: numpy_column(pa.chunked_array([batch.column(name)]), name) for name in names}
                    # Float32 from the clip's start: coarse after hours, and still finer than frames are apart.
                    found[SHOWN] = start[found[EPISODE]] + found.pop("timestamp").astype(np.float64)
                    _refuse(found, clips)
                    yield found
        except (pa.ArrowException, OSError, KeyError) as error:
            raise ValueError(f"{path}: expected rows with {', '.join(names)}, got {error}") from error
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


def work_rows(folders: Sequence[Path], clips: Sequence[Clip]) -> Iterator[Rows]:
    """Rows of clip folders, one after the other; raises as `dataset_rows` does."""
    for number, folder in enumerate(folders):
        found = read_table(folder / "camera.parquet")
        for table in ("players", "ball"):
            path = folder / f"{table}.parquet"
            own = read_table(path) if path.is_file() else {}
            if own and not np.array_equal(own[NUMBER], found[NUMBER]):
                raise ValueError(f"{path}: {NUMBER}: expected the frames of camera.parquet, got others")
            found |= {name: values for name, values in own.items() if name not in found}
        found |= {EPISODE: np.full(len(found[NUMBER]), number), SHOWN: found["timestamp"]}
        try:
            _refuse(found, clips)
        except ValueError as error:
            raise ValueError(f"{folder}: {error}") from error
        yield found


def _columns_of(scene: Scene) -> list[str]:
    players = [f"{player.name}.{name}" for player in scene.players for name in PLAYER]
    return [*CAMERA, *players, *(BALL if scene.ball is not None else ())]


def _refuse(rows: Rows, clips: Sequence[Clip]) -> None:
    """Raise ValueError where a column is not there, or holds a number that its status does not allow."""
    missing = [name for name in (FRAME, TIME, NUMBER, *CAMERA) if name not in rows]
    if missing:
        raise ValueError(f"{missing[0]}: expected the column, got {', '.join(rows)}")
    poses = tuple(f".{name}" for name in (PLAYER[0], *PLAYER[2:]))
    wanted = [name for name in rows if name in (EPISODE, FRAME, TIME, *CAMERA, *BALL) or name.endswith(poses)]
    refuse_unsound({name: rows[name] for name in wanted}, [clip.clip_id for clip in clips])


def frame_arrays(
    scene: Scene, rows: Rows, clips: Sequence[Clip], size: tuple[int, int], people: dict[str, int]
) -> FrameArrays:
    """Those of the rows that have a camera.

    Args:
        scene: What they show.
        rows: Of `dataset_rows` or `work_rows`.
        clips: Of the same source.
        size: Width and height of the pictures that cameras and boxes are to be of.
        people: Number of each person by name; new ones are added.
    """
    kept = np.flatnonzero(rows[CAMERA[0]] != ABSENT)
    clip = rows[EPISODE][kept].astype(np.int64)
    factors = np.array([each.factor(size) for each in clips])[clip]
    shutters = np.array([each.shutter_s for each in clips])[clip]
    K, distortion, R, t = (rows[name][kept] for name in CAMERA[1:])
    cameras = Camera(
        K=scaled_K(K.reshape(-1, 3, 3), factors),
        distortion=distortion,
        R_cam_from_world=R.reshape(-1, 3, 3),
        t_cam_from_world=t,
    )
    rotations, translations = (
        {player.name: _joints(rows, kept, player, name) for player in scene.players} for name in PLAYER[2:]
    )
    position, velocity = (_vectors(rows, kept, name) for name in BALL[1:])
    path = np.where(np.isfinite(shutters)[:, None], velocity * shutters[:, None], 0.0)
    path = np.where(np.isfinite(position), path, 0.0)
    boxes = []
    for thing in scene.objects:
        if thing.is_backdrop:
            boxes.append(np.broadcast_to(whole_picture(size), (len(kept), 4)))
            continue
        low, high = _world_boxes(thing, scene, (rotations, translations), (position, path))
        boxes.append(boxes_px(cameras, low, high, size))
    return FrameArrays(
        clip=clip,
        frame=rows[FRAME][kept],
        time=rows[TIME][kept],
        video_frame=rows[NUMBER][kept],
        video_time=rows[SHOWN][kept],
        cameras=cameras,
        rotations=rotations,
        translations=translations,
        identity=_identity(rows, kept, scene, people),
        ball_position=position,
        ball_path=path,
        boxes_px=np.stack(boxes, axis=1).astype(np.float32),
    )


def _vectors(rows: Rows, kept: Int[np.ndarray, " kept"], name: str) -> Float[np.ndarray, "kept 3"]:
    return rows[name][kept].astype(np.float64) if name in rows else np.full((len(kept), 3), np.nan)


def _joints(
    rows: Rows, kept: Int[np.ndarray, " kept"], player: SceneObject, name: str
) -> Float[np.ndarray, "kept joints 3"]:
    """A column of a player's joints, float32 as tables have them; NaN as a whole where a part of it is."""
    assert player.skeleton is not None
    joints = len(player.skeleton.parents)
    if f"{player.name}.{name}" not in rows:
        return np.full((len(kept), joints, 3), np.nan, dtype=np.float32)
    values = rows[f"{player.name}.{name}"][kept].reshape(-1, joints, 3).astype(np.float32)
    whole = np.asarray(np.isfinite(values).all(axis=(1, 2)), dtype=bool)
    return np.where(whole[:, None, None], values, np.float32(np.nan))


def _identity(
    rows: Rows, kept: Int[np.ndarray, " kept"], scene: Scene, people: dict[str, int]
) -> Int[np.ndarray, "kept players"]:
    result = np.full((len(kept), len(scene.players)), -1, dtype=np.int64)
    for number, player in enumerate(scene.players):
        names = rows.get(f"{player.name}.identity")
        if names is not None:
            distinct, which = np.unique(names[kept].astype(str), return_inverse=True)
            known = [people.setdefault(name, len(people)) if name else -1 for name in distinct.tolist()]
            result[:, number] = np.array(known, dtype=np.int64)[which]
    return result


def _world_boxes(
    thing: SceneObject,
    scene: Scene,
    bodies: tuple[Mapping[str, np.ndarray], Mapping[str, np.ndarray]],
    ball: tuple[np.ndarray, np.ndarray],
) -> tuple[Float[np.ndarray, "frames 3"], Float[np.ndarray, "frames 3"]]:
    """Lowest and highest corners of a volume or a veil in each frame, metres; NaN where it is not there.

    Args:
        thing: A player, the ball, a static world or a veil.
        scene: Its scene.
        bodies: Rotations and translations of joints, by player.
        ball: Positions and paths.
    """
    if thing.skeleton is not None:
        rotations, translations = (values[thing.name].astype(np.float64) for values in bodies)
        joints = world_joints(thing.skeleton.parents, rotations, translations)
        return joints.min(axis=1) - BODY_MARGIN_M, joints.max(axis=1) + BODY_MARGIN_M
    position, path = ball
    if thing.kind == "ball":
        reach = 0.5 * np.abs(path) + (0.0 if scene.ball is None else scene.ball.radius_m)
        return position - reach, position + reach
    low, high = world_box(thing)
    return np.broadcast_to(low, position.shape), np.broadcast_to(high, position.shape)


def joined_arrays(parts: Iterable[FrameArrays]) -> dict[str, Any]:
    """The fields of all parts, each in one; none of no part."""
    parts = [part for part in parts if len(part.frame)]
    if not parts:
        return {}
    joined: dict[str, Any] = {}
    for name, first in vars(parts[0]).items():
        each = [getattr(part, name) for part in parts]
        if isinstance(first, Camera):
            joined[name] = Camera(**{key: np.concatenate([getattr(one, key) for one in each]) for key in vars(first)})
        elif isinstance(first, Mapping):
            joined[name] = {key: np.concatenate([one[key] for one in each]) for key in first}
        else:
            joined[name] = np.concatenate(each)
    return joined
