"""One video of a Playable Environments dataset: its pictures, cameras, boxes and keypoints, as its files hold them.

Read as willi-menapace/PlayableEnvironments writes and loads them (facts from its code; nothing of it is in here). Its
loader puts made-up values in the place of files that are missing, with no more than a printed warning; here a missing
file is an error. Made-up values that were saved all the same are told by themselves: a focal length of 0 or 1 px is no
camera, and a box that its validity calls false is a dummy, whatever stands in it.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from pgm_data.convert.plain_pickle import PickledArray, PickledPose, read_plain_pickle
from pgm_data.convert.posed_pictures import LARGEST_SIDE, FieldError
from pgm_data.geometry.camera import Camera

FRAME_NAME = re.compile(r"([0-9]{5})\.(png|jpg|jpeg|bmp)", re.ASCII)
MOST_OBJECTS = 64
NO_FOCAL_PX = 1.0
"""What the loader's made-up focal lengths (0 and 1) do not exceed."""
FURTHEST = 4.0
"""No box or keypoint lies further from the picture, as a share of its sides."""
LARGEST_M = 1e5
GL_FROM_CV = np.diag([1.0, -1.0, -1.0])
"""Their cameras look along -z with y up."""
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayableVideo:
    """One camera's video of a sequence, a row a frame."""

    folder: Path
    pictures: tuple[Path, ...]
    size: tuple[int, int]
    """Width and height of the pictures, px."""
    rotation: Float[np.ndarray, "frames 3"]
    """Angles about x, y, z, radians: world_from_camera = Ry @ Rx @ Rz."""
    translation: Float[np.ndarray, "frames 3"]
    """The camera's place in the world, metres."""
    focal: Float[np.ndarray, " frames"]
    """Of the picture size that it was solved at, px."""
    boxes: Float[np.ndarray, "frames objects 4"]
    """Left, top, right, bottom as shares of the sides; NaN where not valid."""
    keypoints: Float[np.ndarray, "frames objects points 3"] | None
    """x, y as shares of the sides, confidence; NaN where not valid; None without files."""

    @property
    def has_camera(self) -> Bool[np.ndarray, " frames"]:
        """Whether each frame has a camera, rather than what the loader makes up."""
        return np.asarray(self.focal > NO_FOCAL_PX)


def read_playable_video(folder: Path) -> PlayableVideo:
    """The video in the folder of one camera.

    Raises:
        FieldError: If a file is missing or damaged, lengths differ, or a value is not what it must be.
    """
    if (folder / "failure.txt").exists():
        raise FieldError("failure.txt", "a sequence that was solved", "the mark of one that was not")
    pictures = _pictures(folder)
    cameras = _list(folder, "cameras.pkl", len(pictures))
    for frame, pose in enumerate(cameras):
        if not isinstance(pose, PickledPose):
            raise FieldError(f"cameras.pkl[{frame}]", "a pose", type(pose).__name__)
    rotation = np.array([pose.rotation for pose in cameras])
    translation = np.array([pose.translation for pose in cameras])
    focal = _focals(folder, len(pictures))
    for name, values, most in (("rotation", rotation, 100.0), ("translation", translation, LARGEST_M)):
        wrong = np.flatnonzero(~(np.abs(values) <= most).all(axis=1))
        if len(wrong):
            raise FieldError(f"cameras.pkl[{wrong[0]}].{name}", f"at most {most:g}", values[wrong[0]])
    valid = _validity(folder, "bounding_box_validity.pkl", len(pictures))
    boxes = _arrays(folder, "bounding_boxes.pkl", len(pictures), (4, valid.shape[1]))
    valid &= not (folder / "boxes_failure.txt").exists()
    return PlayableVideo(
        folder=folder,
        pictures=pictures,
        size=_size(pictures[0]),
        rotation=rotation,
        translation=translation,
        focal=focal,
        boxes=_boxes(np.swapaxes(boxes, 1, 2), valid),
        keypoints=_keypoints(folder, len(pictures), valid.shape[1]),
    )


def playable_camera(video: PlayableVideo, focal_size: tuple[int, int], *, y_up: bool) -> Camera:
    """The video's cameras in our conventions, NaN where a frame has none.

    The principal point is (width / 2, height / 2), which is where its renderer has it; its solver had it half a pixel
    to the upper left. It keeps no distortion.

    Args:
        video: The video.
        focal_size: Width and height of the pictures that its focal lengths are of, px.
        y_up: Whether its world's second axis points up, not the third.
    """
    x, y, z = np.moveaxis(video.rotation, -1, 0)
    R_world_from_gl = _about(1, y) @ _about(0, x) @ _about(2, z)
    R_world = Z_UP_FROM_Y_UP if y_up else np.eye(3)
    R_cam_from_world = GL_FROM_CV @ np.swapaxes(R_world @ R_world_from_gl, -1, -2)
    position = video.translation @ R_world.T
    K = np.zeros((len(video.focal), 3, 3))
    K[:, 0, 0] = video.focal * video.size[0] / focal_size[0]
    K[:, 1, 1] = video.focal * video.size[1] / focal_size[1]
    K[:, :2, 2] = np.array(video.size) / 2
    K[:, 2, 2] = 1.0

    def known(values: np.ndarray) -> np.ndarray:
        return np.where(video.has_camera.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)

    return Camera(
        K=known(K),
        distortion=known(np.zeros((len(K), 4))),
        R_cam_from_world=known(R_cam_from_world),
        t_cam_from_world=known(-(R_cam_from_world @ position[..., None])[..., 0]),
    )


def _about(axis: int, angle: Float[np.ndarray, " frames"]) -> Float[np.ndarray, "frames 3 3"]:
    """Rotations about an axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((len(angle), 3, 3))
    R[:, axis, axis] = 1.0
    R[:, first, first] = R[:, second, second] = np.cos(angle)
    R[:, second, first] = np.sin(angle)
    R[:, first, second] = -np.sin(angle)
    return R


def _pictures(folder: Path) -> tuple[Path, ...]:
    """The frames, 0-based and without a gap."""
    found = sorted(path for path in folder.iterdir() if FRAME_NAME.fullmatch(path.name) and path.is_file())
    first = [path for path in found if path.stem == "00000"]
    if len(first) != 1:
        raise FieldError("00000.png", "one first picture", f"{len(first)}")
    pictures = tuple(path for path in found if path.suffix == first[0].suffix)
    gap = next((i for i, path in enumerate(pictures) if int(path.stem) != i), None)
    if gap is not None:
        raise FieldError(f"{gap:05d}{first[0].suffix}", "pictures without a gap", f"{pictures[gap].name} in its place")
    return pictures


def _size(picture: Path) -> tuple[int, int]:
    """Width and height of the first picture."""
    image = cv2.imread(str(picture), cv2.IMREAD_COLOR)
    if image is None or max(image.shape[:2]) > LARGEST_SIDE:
        raise FieldError(picture.name, "a picture that can be read", "another file")
    return image.shape[1], image.shape[0]


def _list(folder: Path, name: str, length: int) -> list[Any]:
    """The list in a pickle, one value a picture."""
    try:
        value = read_plain_pickle(folder / name)
    except FieldError as error:
        raise FieldError(f"{name}: {error.field}", error.expected, error.found) from error
    if not isinstance(value, list) or len(value) != length:
        got = f"{len(value)} values" if isinstance(value, list) else type(value).__name__
        raise FieldError(name, f"a list of {length} values, one a picture", got)
    return value


def _focals(folder: Path, length: int) -> Float[np.ndarray, " frames"]:
    values = _list(folder, "focals.pkl", length)
    focal = np.zeros(length)
    for frame, value in enumerate(values):
        plain = 0.0 if value is None else _alone(value)
        if isinstance(plain, bool) or not isinstance(plain, int | float) or not 0 <= plain <= 1e6:
            raise FieldError(f"focals.pkl[{frame}]", "a focal length of 0 to 1e6 px", type(value).__name__)
        focal[frame] = plain
    return focal


def _alone(value: Any) -> Any:
    """The number of an array that holds one alone."""
    if isinstance(value, PickledArray) and value.values is not None and value.values.size == 1:
        return value.values.reshape(-1)[0].item()
    return value


def _validity(folder: Path, name: str, length: int) -> Bool[np.ndarray, "frames objects"]:
    rows = _list(folder, name, length)
    first = rows[0].values if isinstance(rows[0], PickledArray) else None
    if first is None or first.ndim != 1 or not 1 <= len(first) <= MOST_OBJECTS:
        raise FieldError(f"{name}[0]", f"an array of 1 to {MOST_OBJECTS} objects", type(rows[0]).__name__)
    values = _stacked(name, rows, first.shape)
    if values.dtype.kind not in "bui" or not np.isin(values, (0, 1)).all():
        raise FieldError(name, "true and false", str(values.dtype))
    return values.astype(bool)


def _arrays(folder: Path, name: str, length: int, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers of a pickle, stacked over the pictures."""
    values = _stacked(name, _list(folder, name, length), shape)
    if values.dtype.kind not in "fiu":
        raise FieldError(name, "numbers", str(values.dtype))
    return values.astype(np.float64)


def _stacked(name: str, rows: list[Any], shape: tuple[int, ...]) -> np.ndarray:
    for frame, row in enumerate(rows):
        values = row.values if isinstance(row, PickledArray) else None
        if values is None or values.shape != shape:
            got = type(row).__name__ if values is None else f"shape {values.shape}"
            raise FieldError(f"{name}[{frame}]", f"an array of shape {shape}", got)
    return np.stack([row.values for row in rows])


def _boxes(
    boxes: Float[np.ndarray, "frames objects 4"], valid: Bool[np.ndarray, "frames objects"]
) -> Float[np.ndarray, "frames objects 4"]:
    right = (np.abs(boxes) <= FURTHEST).all(axis=-1) & (boxes[..., 2:] > boxes[..., :2]).all(axis=-1)
    wrong = np.argwhere(valid & ~right)
    if len(wrong):
        frame, thing = wrong[0]
        expected = "left < right, top < bottom, shares of the picture, as it is said to be valid"
        raise FieldError(f"bounding_boxes.pkl[{frame}]: object {thing}", expected, boxes[frame, thing])
    return np.where(valid[..., None], boxes, np.nan)


def _keypoints(folder: Path, length: int, objects: int) -> Float[np.ndarray, "frames objects points 3"] | None:
    name = "keypoints.pkl"
    if not (folder / name).exists():
        return None
    valid = _validity(folder, "keypoints_validity.pkl", length)
    rows = _list(folder, name, length)
    first = rows[0].values if isinstance(rows[0], PickledArray) else None
    if first is None or first.ndim != 3 or not 1 <= first.shape[0] <= 1000:
        raise FieldError(f"{name}[0]", "an array of points, 3 and objects", type(rows[0]).__name__)
    values = np.moveaxis(_arrays(folder, name, length, (first.shape[0], 3, objects)), 3, 1)
    if valid.shape[1] != objects:
        raise FieldError("keypoints_validity.pkl", f"{objects} objects, as boxes have", f"{valid.shape[1]}")
    wrong = np.argwhere(valid & ~(np.abs(values) <= FURTHEST).all(axis=(2, 3)))
    if len(wrong):
        raise FieldError(f"{name}[{wrong[0][0]}]", "shares of the picture, and confidences", "other numbers")
    # Height comes first there.
    return np.where(valid[..., None, None], values[..., [1, 0, 2]], np.nan)


def crop_is_whole(folder: Path) -> bool:
    """Whether the video has no crop region, or one that is the whole picture.

    Raises:
        FieldError: If it has one that is none.
    """
    name = "crop_region.pkl"
    if not (folder / name).exists():
        return True
    value = _list(folder, name, 4)
    sides = [_alone(side) for side in value]
    if not all(isinstance(side, int | float) and 0 <= side <= 1 for side in sides):
        raise FieldError(name, "left, top, right, bottom from 0 to 1", "others")
    if not (sides[0] < sides[2] and sides[1] < sides[3]):
        raise FieldError(name, "left < right and top < bottom", sides)
    return sides == [0, 0, 1, 1]
