"""Body points of the players of a clip: crops around their boxes, shown to a network, frame by frame."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.players.candidates import Pictures
from pgm_data.detect.pose.crops import cut, windows_around
from pgm_data.detect.pose.model import PoseModel, mirrored
from pgm_data.detect.pose.sides import swapped_points
from pgm_data.people import PlayerBoxes, PlayerPoses

TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
SAME_BODY = 0.05
"""Two looks at one crop agree where half of the points lie closer than this share of its height."""
BESIDE = 0.2
"""How far out of its box, in sizes of the box, the middle of a person's trunk may lie."""
SMALL = 0.6
"""A body smaller than this share of its box is cut out once more, closer."""
FACE_TO_TOE = 0.9
"""A body's points, as a share of its size."""
SURE_ENOUGH = 0.05
"""A closer look counts unless the network is less sure of it by this."""
LEAST_SIGMA_PX = 0.6
"""Scatter in pixels of the picture that comes on top however small the body is: what bodies of 20 and 40 px add."""


@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """How often and how hard to look.

    Raises:
        ValueError: If a value is out of its range.
    """

    every: int = 1
    """Look at every so many frames; repeated frames do not count."""
    looks: int = 1
    """1: each crop as it is; 2: mirrored too, and the two averaged."""
    least_presence: float = 0.5
    """Points are left out where the network thinks a person less probable than this."""
    unsure: float = 0.9
    """Under this probability a person is looked for once more, in a wider crop around the last pose."""
    wider: float = 1.4
    """How much wider that crop is."""
    swap_chance: float = 0.03
    """Probability that the network starts to take left for right in a frame; 0 believes it always."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name, good, expected in (
            ("every", self.every >= 1, "at least 1"),
            ("looks", self.looks in (1, 2), "1 or 2"),
            ("least_presence", 0 <= self.least_presence <= 1, "0 to 1"),
            ("unsure", 0 <= self.unsure <= 1, "0 to 1"),
            ("wider", self.wider >= 1, "at least 1"),
            ("swap_chance", 0 <= self.swap_chance < 0.5, "0 to below 0.5"),
        ):
            if not good:
                raise ValueError(f"pose options: {name}: expected {expected}, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class PicturePose:
    """One person's points in one picture."""

    points_px: Float[np.ndarray, "points 2"]
    score: Float[np.ndarray, " points"]
    sigma_px: Float[np.ndarray, " points"]
    points_ray: Float[np.ndarray, "points 3"]
    presence: float


def estimate_poses(
    model: PoseModel,
    pictures: Pictures,
    boxes: PlayerBoxes,
    clip: ClipCamera,
    *,
    options: PoseOptions | None = None,
) -> PlayerPoses:
    """The players' body points in every frame that was asked for; NaN elsewhere, and outside of the picture.

    A frame that repeats an earlier one is not looked at: it would count the same picture twice.

    Raises:
        ValueError: If boxes, clip and pictures differ in their number of frames.
    """
    options = options or PoseOptions()
    frames, players = boxes.status.shape
    if len(clip.is_duplicate) != frames:
        raise ValueError(f"{clip.clip_id}: player boxes: expected {len(clip.is_duplicate)} frames, got {frames}")
    asked = asked_frames(boxes, clip.is_duplicate, every=options.every)
    shape = (frames, players, len(model.point_names))
    points_px, points_ray = np.full((*shape, 2), np.nan), np.full((*shape, 3), np.nan)
    score, sigma_px = np.full(shape, np.nan), np.full(shape, np.nan)
    before: list[PicturePose | None] = [None] * players
    count = 0
    for frame, picture in enumerate(pictures()):
        count += 1
        if frame >= frames:
            raise ValueError(f"{clip.clip_id}: pictures: expected {frames}, got more")
        for player in np.flatnonzero(asked[frame]):
            box = boxes.boxes_px[frame, player]
            pose = look_at(model, picture, box, before[player], options=options)
            before[player] = pose
            if pose is None:
                continue
            points_px[frame, player], points_ray[frame, player] = pose.points_px, pose.points_ray
            score[frame, player], sigma_px[frame, player] = pose.score, pose.sigma_px
    if count != frames:
        raise ValueError(f"{clip.clip_id}: pictures: expected {frames}, got {count}")
    partner = mirrored(model.point_names)
    for player in range(players):
        height = boxes.boxes_px[:, player, 3] - boxes.boxes_px[:, player, 1]
        wrong = swapped_points(
            points_px[:, player], height, clip.capture_time, model.point_names, chance=options.swap_chance
        )
        for values in (points_px, points_ray, score, sigma_px):
            frame, point = np.nonzero(wrong)
            values[frame, player, point] = values[frame, player, partner[point]]
    return PlayerPoses(
        names=boxes.names,
        point_names=model.point_names,
        points_px=points_px,
        score=score,
        sigma_px=sigma_px,
        points_ray=points_ray,
    )


def asked_frames(
    boxes: PlayerBoxes, is_duplicate: Bool[np.ndarray, " frames"], *, every: int
) -> Bool[np.ndarray, "frames players"]:
    """Where to look: every so many of the frames that repeat no other, at players with a box."""
    own = ~is_duplicate
    turn = own & ((np.cumsum(own) - 1) % every == 0)
    return np.asarray(turn[:, None] & (boxes.status != "none"))


def look_at(
    model: PoseModel,
    picture: UInt8[np.ndarray, "height width 3"],
    box_px: Float[np.ndarray, " 4"],
    before: PicturePose | None,
    *,
    options: PoseOptions,
) -> PicturePose | None:
    """One person's points in the picture, NaN beyond its edge; None where nobody is seen, or somebody else.

    Args:
        model: The network.
        picture: BGR.
        box_px: Where the person is.
        before: The person's pose a moment ago.
        options: How hard to look.
    """
    pose = pose_in(model, picture, box_px, body_share=model.body_share, looks=options.looks)
    again = _second_box(pose, box_px, before, options)
    if again is not None:
        second = pose_in(model, picture, again, body_share=model.body_share, looks=options.looks)
        slack = 0.0 if pose.presence < options.unsure else SURE_ENOUGH
        pose = second if second.presence > pose.presence - slack else pose
    if pose.presence < options.least_presence or not _in_box(pose.points_px, model.point_names, box_px):
        return None
    high, wide_px = picture.shape[:2]
    beyond = np.any((pose.points_px < -0.5) | (pose.points_px > np.array([wide_px, high]) - 0.5), axis=-1)
    return replace(
        pose,
        points_px=np.where(beyond[:, None], np.nan, pose.points_px),
        points_ray=np.where(beyond[:, None], np.nan, pose.points_ray),
        score=np.where(beyond, np.nan, pose.score),
        sigma_px=np.where(beyond, np.nan, pose.sigma_px),
    )


def pose_in(
    model: PoseModel,
    picture: UInt8[np.ndarray, "height width 3"],
    box_px: Float[np.ndarray, " 4"],
    *,
    body_share: float,
    looks: int,
) -> PicturePose:
    """The points that the network sees in a crop around the box, in the picture."""
    windows = windows_around(box_px[None], model.input_size, body_share=body_share)
    crop = cut(picture, windows)
    poses = model(crop if looks == 1 else np.concatenate([crop, crop[:, :, ::-1]]))
    points, score, sigma, ray = poses.points_px[0], poses.score[0], poses.sigma_px[0], poses.points_ray[0]
    presence = float(poses.presence[0])
    if looks == 2:
        partner = mirrored(model.point_names)
        other = poses.points_px[1][partner] * [-1.0, 1.0] + [model.input_size[0] - 1.0, 0.0]
        # Where a mirror changes what the network takes for left, a mean would be a body that is folded flat.
        if np.median(np.linalg.norm(other - points, axis=-1)) < SAME_BODY * model.input_size[1]:
            points = 0.5 * (points + other)
            score = 0.5 * (score + poses.score[1][partner])
            sigma = 0.5 * (sigma + poses.sigma_px[1][partner])
            ray = 0.5 * (ray + poses.points_ray[1][partner] * [-1.0, 1.0, 1.0])
            presence = 0.5 * (presence + float(poses.presence[1]))
    return PicturePose(
        points_px=windows.picture_from_crop(points[None])[0],
        score=score,
        sigma_px=np.hypot(sigma / windows.scale[0], LEAST_SIGMA_PX),
        points_ray=ray,
        presence=presence,
    )


def _second_box(
    pose: PicturePose, box_px: Float[np.ndarray, " 4"], before: PicturePose | None, options: PoseOptions
) -> Float[np.ndarray, " 4"] | None:
    """Where a second look is worth its time; None where it is not."""
    size = float((box_px[2:] - box_px[:2]).max())
    if pose.presence < options.unsure:
        # The body was somewhere a moment ago, so it is not far from there.
        seen = None if before is None else _extent(before.points_px)
        around = box_px if seen is None else seen
        middle = 0.5 * (around[:2] + around[2:])
        reach = 0.5 * options.wider * size
        return np.concatenate([middle - reach, middle + reach])
    seen = _extent(pose.points_px)
    if seen is None or float((seen[2:] - seen[:2]).max()) >= SMALL * size:
        return None
    reach = 0.5 * (1 / FACE_TO_TOE - 1) * float((seen[2:] - seen[:2]).max())
    return seen + reach * np.array([-1.0, -1.0, 1.0, 1.0])


def _extent(points_px: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, " 4"] | None:
    """The box of the points that were found; None where there are none or they lie on one line or on each other."""
    found = points_px[np.isfinite(points_px).all(axis=-1)]
    if len(found) == 0 or not np.all(np.ptp(found, axis=0) > 0):
        return None
    return np.concatenate([found.min(axis=0), found.max(axis=0)])


def _in_box(points_px: Float[np.ndarray, "points 2"], names: tuple[str, ...], box_px: Float[np.ndarray, " 4"]) -> bool:
    """Whether the middle of the trunk lies in the box: a body in front of this one has its own elsewhere."""
    trunk = points_px[[names.index(name) for name in TRUNK]].mean(axis=0)
    slack = BESIDE * (box_px[2:] - box_px[:2])
    return bool(((trunk >= box_px[:2] - slack) & (trunk <= box_px[2:] + slack)).all())
