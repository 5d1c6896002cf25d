"""Frames of a dataset or a work folder: who is where, seen by which camera, and the picture of it on demand.

All pictures of a store have one SIZE. Clips of another shape are stretched to it, and their cameras and boxes with
them, so that rays stay exact. Numbers of frames are in memory, pictures are not: they are decoded when they are asked
for, and as many are kept as a bound in bytes allows.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from pgm_data.dataset.documents import read_document
from pgm_data.dataset.pack_plan import clip_folders
from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene, load_scene
from pgm_models.animation.shards import scene_of
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.frame_rows import (
    Clip,
    Rows,
    dataset_clips,
    dataset_rows,
    frame_arrays,
    joined_arrays,
    work_clips,
    work_rows,
)
from pgm_models.synthesis.object_boxes import scaled_pixels
from pgm_models.synthesis.picture_shelf import CACHE_BYTES, PictureShelf, as_picture, picture_size
from pgm_models.synthesis.skinning import Poses, poses_of

SHAPE_PX = 2.0
"""How much wider or narrower than its clip says a video may be, of its own pixels: encoders round."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameStore:
    """Every frame that has a camera, clip after clip, in order."""

    scene: Scene
    size: tuple[int, int]
    """Width and height of all pictures."""
    clips: tuple[Clip, ...]
    """Those of the source, in its order."""
    identities: tuple[str, ...]
    """The people."""
    clip: Int[np.ndarray, " frames"]
    """Clip of each frame."""
    frame: Int[np.ndarray, " frames"]
    """Its number in the clip."""
    time: Float[np.ndarray, " frames"]
    """When it was taken, seconds of the clip's clock."""
    video_frame: Int[np.ndarray, " frames"]
    """Its number in the video."""
    video_time: Float[np.ndarray, " frames"]
    """When the video shows it, seconds."""
    cameras: Camera
    """One a frame, of pictures of the store's size."""
    rotations: Mapping[str, Float[np.ndarray, "frames joints 3"]]
    """Of each player object: axis-angles of parent_from_joint, the root's in the world; NaN where it is not there."""
    translations: Mapping[str, Float[np.ndarray, "frames joints 3"]]
    """Of parent_from_joint, metres."""
    identity: Int[np.ndarray, "frames players"]
    """Who each player object is, a row of `identities`; -1 where nobody knows."""
    ball_position: Float[np.ndarray, "frames 3"]
    """World metres; NaN where there is none."""
    ball_path: Float[np.ndarray, "frames 3"]
    """What it flew while the shutter was open, metres; 0 where nobody knows how long that was (`shutter_known`)."""
    boxes_px: Float[np.ndarray, "frames objects 4"]
    """Where each object of the scene is seen: x0, y0, x1, y1, not cut at the picture's border; NaN where it is not."""
    shelf: PictureShelf
    """Pictures."""

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.frame)

    def __getitem__(self, rows: np.ndarray | slice) -> "FrameStore":
        """Some of the frames; clips, people and pictures are shared."""
        arrays = ("clip", "frame", "time", "video_frame", "video_time", "identity")
        arrays += ("ball_position", "ball_path", "boxes_px")
        return replace(
            self,
            cameras=self.cameras[rows],
            rotations={name: values[rows] for name, values in self.rotations.items()},
            translations={name: values[rows] for name, values in self.translations.items()},
            **{name: getattr(self, name)[rows] for name in arrays},
        )

    @property
    def matches(self) -> tuple[str, ...]:
        """Match of each clip."""
        return tuple(clip.match_id for clip in self.clips)

    def ui_boxes_px(self, row: int) -> Float[np.ndarray, "boxes 4"]:
        """Graphics over the picture of a frame: x0, y0, x1, y1."""
        clip = self.clips[int(self.clip[row])]
        return scaled_pixels(clip.ui_boxes_px.reshape(-1, 2), clip.factor(self.size)).reshape(-1, 4)

    @property
    def shutter_known(self) -> Bool[np.ndarray, " frames"]:
        """Whether the ball of each frame is blurred as it was; where not, it is drawn as if it stood still."""
        known = np.array([np.isfinite(clip.shutter_s) for clip in self.clips], dtype=bool)
        return known[self.clip]

    def place(self, row: int) -> str:
        """The frame in words."""
        return f"clip {self.clips[int(self.clip[row])].clip_id}, frame {self.frame[row]}"

    def clip_rows(self, clip_id: str) -> Int[np.ndarray, " rows"]:
        """Rows of a clip's frames, in order.

        Raises:
            ValueError: If there is no such clip, or no frame of it has a camera.
        """
        ids = [clip.clip_id for clip in self.clips]
        rows = np.flatnonzero(self.clip == ids.index(clip_id)) if clip_id in ids else np.zeros(0, dtype=np.int64)
        if not len(rows):
            expected = ", ".join(ids[number] for number in np.unique(self.clip))
            raise ValueError(f"clip: expected one with cameras among {expected}, got {clip_id!r}")
        return rows

    def states(self, rows: Sequence[int] | np.ndarray, device: torch.device | str = "cpu") -> States:
        """What moves in those frames, in that order."""
        rows = np.asarray(rows, dtype=np.int64)
        poses = {}
        for player in self.scene.players:
            assert player.skeleton is not None
            own = [values[player.name][rows].astype(np.float64) for values in (self.rotations, self.translations)]
            found = poses_of(player.skeleton, own[0], own[1])
            poses[player.name] = Poses(**{name: value.to(device) for name, value in vars(found).items()})
        if self.scene.ball is None:
            return States(poses=poses, balls=None)
        ball = [torch.as_tensor(values[rows], dtype=torch.float32) for values in (self.ball_position, self.ball_path)]
        balls = Balls(position=ball[0].to(device), path=ball[1].to(device), radius=self.scene.ball.radius_m)
        return States(poses=poses, balls=balls)

    def rgb(self, row: int) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of a frame: red, green, blue; read-only.

        Raises:
            ValueError: If its clip has no video, or that does not hold the frame; names clip and frame.
        """
        from pgm_data.video import VideoError

        number = self._number_in_video(row)
        clip = self.clips[int(self.clip[row])]
        assert clip.video is not None
        try:
            return self.shelf.video(clip.video).picture(number, self.size)[:, :, ::-1]
        except VideoError as error:
            raise ValueError(f"{self.place(row)}: {error}") from error

    def kept(self, row: int) -> bool:
        """Whether the picture of a frame is in memory, and need not be decoded."""
        clip = self.clips[int(self.clip[row])]
        return clip.video is not None and self.shelf.keeps(clip.video, int(self.video_frame[row]), self.size)

    def prepare(self, rows: Sequence[int] | np.ndarray) -> None:
        """Decode those frames in the order of their videos, so that each stretch of a video is decoded once.

        Raises as `rgb` does. They are kept as long as memory for them reaches.
        """
        distinct = np.unique(np.asarray(rows, dtype=np.int64))
        videos = np.array([str(clip.video) for clip in self.clips])[self.clip[distinct]]
        for row in distinct[np.lexsort((self.video_frame[distinct], videos))].tolist():
            self.rgb(row)

    def picture(self, row: int, device: torch.device | str = "cpu") -> Float[Tensor, "3 height width"]:
        """The picture of a frame, RGB 0 to 1; raises as `rgb` does."""
        return as_picture(self.rgb(row)).to(device)

    def _number_in_video(self, row: int) -> int:
        """The frame's number in its video, by its time where damage has shifted the numbers."""
        from pgm_data.video import VideoError
        from pgm_data.video.random_access import NEAR_S

        clip = self.clips[int(self.clip[row])]
        if clip.video is None:
            raise ValueError(f"{self.place(row)}: {clip.no_video}")
        try:
            video = self.shelf.video(clip.video)
            number, time = int(self.video_frame[row]), float(self.video_time[row])
            if abs(video.info.width - clip.width * video.info.height / clip.height) > SHAPE_PX:
                expected = f"pictures of {clip.width}x{clip.height}, or of that shape, as its tables say"
                raise VideoError(clip.video, expected, f"{video.info.width}x{video.info.height}")
            if number < len(video) and abs(video.index.time[number] - time) <= NEAR_S:
                return number
            return video.number_at(time)
        except (VideoError, ValueError) as error:
            raise ValueError(f"{self.place(row)}: {error}") from error

    def check_videos(self, report: Callable[[str], None] = lambda clip_id: None) -> None:
        """Open every video and find every frame in it, without decoding.

        Args:
            report: Is told each clip once it has been looked at.

        Raises:
            ValueError: At the first frame that is not there; names clip and frame.
        """
        for number in np.unique(self.clip):
            for row in np.flatnonzero(self.clip == number):
                self._number_in_video(int(row))
            report(self.clips[int(number)].clip_id)


def held_out(store: FrameStore, *, share: float = 0.1) -> Bool[np.ndarray, " frames"]:
    """The end of every match, not to be trained on.

    The last frames that make up the share, and at least the whole last clip where a match has several. A match of one
    frame is trained on.

    Raises:
        ValueError: If the share is not 0 to 1.
    """
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"share: expected 0 to 1, got {share}")
    held = np.zeros(len(store), dtype=bool)
    if share == 0.0:
        return held
    matches = np.array(store.matches, dtype=object)[store.clip]
    videos = [str(clip.video) for clip in store.clips]
    of_video = np.unique(np.array(videos), return_inverse=True)[1] if videos else np.zeros(0, dtype=np.int64)
    for match in dict.fromkeys(matches):
        rows = np.flatnonzero(matches == match)
        rows = rows[np.lexsort((store.video_frame[rows], of_video[store.clip[rows]]))]
        count = min(int(np.ceil(share * len(rows))), len(rows) - 1)
        last = store.clip[rows] == store.clip[rows[-1]]
        if not last.all():
            count = max(count, int(last.sum()))
        held[rows[len(rows) - count :]] = True
    return held


def read_frames(
    dataset: Path,
    *,
    picture: tuple[int, int] | None = None,
    scene: Scene | None = None,
    cache_bytes: int = CACHE_BYTES,
) -> FrameStore:
    """The frames of a packed dataset.

    Args:
        dataset: Its folder.
        picture: Width and height that pictures may have; as large as they are without.
        scene: What it shows, where its scene does not ship with the package.
        cache_bytes: Of pictures kept in memory.

    Raises:
        ValueError: If it is not sound, or no frame has a camera; names file, clip, frame and column.
    """
    scene = scene_of(dataset) if scene is None else scene
    clips = dataset_clips(dataset)
    return _store(dataset, scene, clips, dataset_rows(dataset, scene, clips), picture, PictureShelf(cache_bytes))


def frames_of_work(
    work: Path,
    *,
    picture: tuple[int, int] | None = None,
    scene: Scene | None = None,
    videos: Path | None = None,
    cache_bytes: int = CACHE_BYTES,
) -> FrameStore:
    """The frames of a work folder, or of one clip's folder.

    Args:
        work: The folder.
        picture: Width and height that pictures may have; as large as they are without.
        scene: What it shows, where its scene does not ship with the package.
        videos: Folder of the videos, where they are no longer where they were.
        cache_bytes: Of pictures kept in memory.

    Raises:
        ValueError: If it is not sound, or no frame has a camera; names file, clip, frame and column.
    """
    folders = clip_folders(work)
    if scene is None:
        names = sorted({read_document(folder / "clip.json", "clip")["scene"] for folder in folders})
        if len(names) != 1:
            raise ValueError(f"{work}: expected clips of one scene, got {', '.join(names) or 'no clip'}")
        scene = load_scene(names[0])
    clips = work_clips(folders, videos)
    return _store(work, scene, clips, work_rows(folders, clips), picture, PictureShelf(cache_bytes))


def _store(
    source: Path,
    scene: Scene,
    clips: tuple[Clip, ...],
    rows: Iterable[Rows],
    picture: tuple[int, int] | None,
    shelf: PictureShelf,
) -> FrameStore:
    """The store of those clips and rows."""
    if not clips:
        raise ValueError(f"{source}: expected clips, got none")
    size = picture_size([(clip.width, clip.height, clip.frames) for clip in clips], picture)
    people: dict[str, int] = {}
    arrays = joined_arrays(frame_arrays(scene, each, clips, size, people) for each in rows)
    if not arrays:
        raise ValueError(f"{source}: expected frames with a camera, got none in {len(clips)} clips")
    # By name: the order in which rows were read must not tell.
    names = sorted(people)
    number = np.array([-1, *(names.index(name) for name in people)], dtype=np.int64)
    arrays["identity"] = number[arrays["identity"] + 1]
    return FrameStore(scene=scene, size=size, clips=clips, identities=tuple(names), shelf=shelf, **arrays)
