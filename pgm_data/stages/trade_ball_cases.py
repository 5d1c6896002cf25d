"""A shot or rally as a detector and a person see it through a camera by lot, with its truth in every frame."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from pgm_data.scene import Scene
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.views import Pose, focal_for_span, framed_pose, points_in_picture, track_of
from pgm_data.stages.trade_ball_shots import SHOT_KINDS, TruePath, draw_rally, draw_shot

CASE_KINDS = (*SHOT_KINDS, "rally")
BEHIND_M = (17.0, 41.0)
"""Cameras behind the near baseline."""
UP_M = (8.0, 12.5)
FIELD_DEG = (21.0, 47.0)
"""Horizontal field of view."""
COURT_SHARE = (0.55, 0.95)
"""Share of the picture's width that the near baseline takes."""
PANNING = 0.3
"""Share of cameras that turn with the play."""
SEEN = 0.85
"""Share of frames in which the ball is within the picture, where such a camera is found."""
CAMERAS_TRIED = 40
LOWEST_AIM = 0.2
"""Share of the picture's height by which the last of them look higher, for lobs."""
LENS = 0.02
"""Half range of the lens's radial term over the picture's half diagonal."""
REPEAT_EVERY = 6
"""With repeats, the last of so many frames repeats the one before it."""
EXACT_S = 1e-3
"""Standard deviation of a time that a person gives as a fraction of a frame."""
MISSING_TOGETHER = 3
"""Frames that a burst of missing detections takes."""


@dataclass(frozen=True, kw_only=True)
class CaseOptions:
    """How a path is seen. The same seed draws the same path, camera and unit noise whatever stands here."""

    fps: float = 25.0
    noise_px: float = 1.0
    """Standard deviation of each coordinate of the track, pixels of the picture's own size."""
    mark_px: float = 3.0
    """The same of a person's ground marks; 0 for exact ones."""
    marks: bool = True
    """Whether ground marks are given at the first and the last contact; never of a rally."""
    missing: float = 0.08
    """Share of frames without a detection, besides one burst of three."""
    false_share: float = 0.0
    """Share of frames in which something else is taken for the ball."""
    event_times: Literal["whole", "fractional"] = "whole"
    """Of a person: the frame in which the ball is nearest to the contact, within the path; or the true time."""
    repeats: bool = False
    """Every sixth frame repeats the one before, as converted frame rates do."""
    size: tuple[int, int] = (1920, 1080)
    """Width and height of the picture, pixels."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallCase:
    """One path as it is given to a solver, and its truth. The rows at both ends lie outside the path, unseen."""

    kind: str
    """Of `CASE_KINDS`."""
    number: int
    options: CaseOptions
    track: BallTrack
    events: BallEvents
    """As a person marks them."""
    camera: Camera
    """Of every frame."""
    doubt: CameraDoubt
    inside: Bool[np.ndarray, " frames"]
    """Frames between the first and the last contact."""
    scored: Bool[np.ndarray, " frames"]
    """Those of them from the first hit on, each picture once: without a serve's toss."""
    position: Float[np.ndarray, "frames 3"]
    """True, world metres; NaN outside the path."""
    velocity: Float[np.ndarray, "frames 3"]
    """True, m/s."""
    spin: Float[np.ndarray, "frames 3"]
    """True, rad/s."""
    contacts: BallEvents
    """True contacts."""
    contact_position: Float[np.ndarray, "contacts 3"]
    """World metres."""
    start_s: float
    """Time of the path's start in the track's clock."""
    path: TruePath
    mark_frames: tuple[int, ...]
    """Frames in which the ground below the ball is marked."""
    false: Bool[np.ndarray, " frames"]
    """Frames whose detection is something else."""

    @property
    def name(self) -> str:
        """Kind and number."""
        return f"{self.kind} {self.number:03d}"


def draw_case(kind: str, number: int, seed: int, options: CaseOptions, scene: Scene) -> BallCase:
    """A case of one of `CASE_KINDS` by lot: path, camera, detections and marks depend on kind, number and seed alone.

    Raises:
        ValueError: If the kind is unknown or the scene has no court or ball.
    """
    if kind not in CASE_KINDS:
        raise ValueError(f"draw_case.kind: expected one of {', '.join(CASE_KINDS)}, got {kind!r}")
    if scene.court is None:
        raise ValueError(f"draw_case.scene: expected a court, got {scene.name}")
    kinds = CASE_KINDS.index(kind)
    path_rng, camera_rng, seen_rng = (np.random.default_rng([seed, kinds, number, part]) for part in range(3))
    path = draw_rally(path_rng, scene) if kind == "rally" else draw_shot(kind, path_rng, scene)
    times, is_duplicate = _frame_times(path.end_s, options, float(seen_rng.random()))
    # The clock starts at the first frame, which lies up to a frame before the path.
    start_s = -float(times[0])
    position, velocity = path.path.at(times)
    spin = path.spin_at(times)
    inside = np.asarray(np.isfinite(position).all(axis=1))
    poses = _draw_poses(camera_rng, scene, options.size, times, path)
    pixels = _seen_at(poses, options.size, position)
    false = _false_frames(seen_rng, options, inside & ~is_duplicate)
    track = _track(seen_rng, options, times + start_s, is_duplicate, pixels, false)
    contacts, contact_position = path.events()
    first_hit = contacts.times[contacts.kinds == "hit"][0]
    nearest = _nearest_frames(times, inside, contacts.times)
    whole = options.event_times == "whole"
    events = _human_events(options, contacts, times[nearest] if whole else contacts.times)
    mark_frames = (int(nearest[0]), int(nearest[-1])) if kind != "rally" and options.marks else ()
    if mark_frames:
        ends = [0, len(contacts) - 1]
        below = (position[nearest] if whole else contact_position)[ends] * np.array([1.0, 1.0, 0.0])
        ground = np.full((len(contacts), 2), np.nan)
        ground[ends] = _seen_at([poses[i] for i in mark_frames], options.size, below)
        ground[ends] += options.mark_px * seen_rng.normal(size=(2, 2))
        events = replace(events, ground_px=ground)
    return BallCase(
        kind=kind,
        number=number,
        options=options,
        track=track,
        events=_shifted(events, start_s),
        camera=_camera_of(poses, options.size),
        doubt=no_doubt(),
        inside=inside,
        scored=inside & (times >= first_hit) & ~is_duplicate,
        position=position,
        velocity=velocity,
        spin=spin,
        contacts=_shifted(contacts, start_s),
        contact_position=contact_position,
        start_s=start_s,
        path=path,
        mark_frames=mark_frames,
        false=false,
    )


def _frame_times(end_s: float, options: CaseOptions, phase: float) -> tuple[np.ndarray, np.ndarray]:
    """Capture times in the path's clock, from the frame before its start to the one after its end, and repeats."""
    shown = options.fps * (REPEAT_EVERY - 1) / REPEAT_EVERY if options.repeats else options.fps
    taken = np.arange(int(np.floor(end_s * shown - phase)) + 3)
    times = (taken - 1 + phase) / shown
    if not options.repeats:
        return times, np.zeros(len(times), dtype=bool)
    again = np.flatnonzero(np.arange(len(times)) % (REPEAT_EVERY - 1) == REPEAT_EVERY - 2)
    rows = np.sort(np.concatenate([np.arange(len(times)), again]))
    return times[rows], np.concatenate([[False], np.diff(rows) == 0])


def _draw_poses(
    rng: np.random.Generator, scene: Scene, size: tuple[int, int], times: np.ndarray, path: TruePath
) -> list[Pose]:
    """A camera for each frame that shows the court, and the ball in most frames where such a one is found."""
    ball, _ = path.path.at(np.arange(0.0, path.end_s, 0.04))
    turns = rng.random() < PANNING
    best: tuple[float, list[Pose]] | None = None
    for attempt in range(CAMERAS_TRIED):
        pose = _draw_pose(rng, scene, size, LOWEST_AIM * attempt / CAMERAS_TRIED)
        reach, period, phase = rng.uniform(0.3, 2.5), rng.uniform(3.0, 7.0), rng.uniform(0.0, 2 * np.pi)
        swing = np.radians(reach) * np.sin(2 * np.pi * times / period + phase) if turns else np.zeros(len(times))
        poses = [replace(pose, heading=pose.heading + float(angle)) for angle in swing]
        view = pose.view(size)
        pixels = pixels_of(ball, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
        seen = float(_within(pixels, size).mean())
        if best is None or seen > best[0]:
            best = seen, poses
        if seen >= SEEN:
            break
    assert best is not None
    return best[1]


def _draw_pose(rng: np.random.Generator, scene: Scene, size: tuple[int, int], lower: float) -> Pose:
    """A camera with the court in the picture, up to that share of its height lower than usual."""
    court = scene.court
    assert court is not None
    points = court.points_world
    baseline = float(points[:, 1].min())
    width, height = size
    while True:
        centre = np.array(
            [float(np.clip(rng.normal(0, 0.6), -1.5, 1.5)), baseline - rng.uniform(*BEHIND_M), rng.uniform(*UP_M)]
        )
        aim = np.array([rng.normal(0, 0.3), rng.uniform(-3.0, 1.0), 0.0])
        focal = focal_for_span(court, centre, aim, rng.uniform(*COURT_SHARE), width)
        field = 2 * np.degrees(np.arctan(0.5 * width / focal))
        pose = framed_pose(
            centre_world=centre,
            aim_world=aim,
            aim_px=(0.5 * (width - 1), (rng.uniform(0.5, 0.66) + lower) * height),
            roll=float(np.radians(np.clip(rng.normal(0, 0.3), -0.7, 0.7))),
            focal_px=focal,
            principal_px=(0.5 * (width - 1), 0.5 * (height - 1)),
            k=float(rng.uniform(-LENS, LENS)),
        )
        view = pose.view(size)
        if FIELD_DEG[0] < field < FIELD_DEG[1] and points_in_picture(court, view, size) == len(points):
            return pose


def _seen_at(poses: list[Pose], size: tuple[int, int], points_world: np.ndarray) -> np.ndarray:
    """Pixels of one point a frame through the drawing camera."""
    pixels = np.full((len(poses), 2), np.nan)
    for i, (pose, point) in enumerate(zip(poses, points_world, strict=True)):
        view = pose.view(size)
        pixels[i] = pixels_of(point, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)
    return pixels


def _within(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= -0.5) & (pixels < np.array(size) - 0.5)).all(axis=-1))


def _camera_of(poses: list[Pose], size: tuple[int, int]) -> Camera:
    track = track_of([pose.view(size) for pose in poses])
    return Camera(
        K=track.K,
        distortion=track.distortion,
        R_cam_from_world=track.R_cam_from_world,
        t_cam_from_world=track.t_cam_from_world,
    )


def _false_frames(rng: np.random.Generator, options: CaseOptions, may: np.ndarray) -> np.ndarray:
    return np.asarray(may & (rng.random(len(may)) < options.false_share))


def _track(
    rng: np.random.Generator,
    options: CaseOptions,
    times: np.ndarray,
    is_duplicate: np.ndarray,
    pixels: np.ndarray,
    false: np.ndarray,
) -> BallTrack:
    """The detections: noisy, some missing, some of other things; a repeat has its source's."""
    count = len(times)
    noise, lots = rng.normal(size=(count, 2)), rng.random(count)
    burst, elsewhere = rng.random(), rng.random((count, 2)) * np.array(options.size)
    pixels = pixels + options.noise_px * noise
    inner = np.flatnonzero(np.isfinite(pixels).all(axis=1))
    lost = (lots < options.missing) | ~_within(pixels, options.size)
    if options.missing > 0 and len(inner) > 3 * MISSING_TOGETHER:
        first = inner[1 + int(burst * (len(inner) - MISSING_TOGETHER - 2))]
        lost[first : first + MISSING_TOGETHER] = True
    pixels = np.where((lost & ~false)[:, None], np.nan, np.where(false[:, None], elsewhere, pixels))
    source = np.maximum.accumulate(np.where(is_duplicate, 0, np.arange(count)))
    pixels = pixels[source]
    found = np.isfinite(pixels).all(axis=1)
    return BallTrack(
        times=times,
        is_duplicate=is_duplicate,
        pixels=pixels,
        # Exact tracks, too, are read to some fraction of a pixel.
        sigma_px=np.where(found, max(options.noise_px, 0.01), np.nan),
        score=np.where(found, 1.0, np.nan),
        streak_px=np.full((count, 2), np.nan),
    )


def _nearest_frames(times: np.ndarray, inside: np.ndarray, contacts: np.ndarray) -> np.ndarray:
    """The frame inside the path that is nearest to each contact."""
    frames = np.flatnonzero(inside)
    return frames[np.abs(times[frames][None] - contacts[:, None]).argmin(axis=1)]


def _human_events(options: CaseOptions, contacts: BallEvents, times: np.ndarray) -> BallEvents:
    """The contacts as a person gives them, without marks."""
    count = len(contacts)
    std = 1.0 / np.sqrt(12) / options.fps if options.event_times == "whole" else EXACT_S
    return BallEvents(
        times=np.maximum.accumulate(times),
        kinds=contacts.kinds,
        probability=np.ones(count),
        time_std=np.full(count, std),
        sources=np.array(["human"] * count, dtype=object),
        players=np.array([""] * count, dtype=object),
        ground_px=np.full((count, 2), np.nan),
    )


def _shifted(events: BallEvents, by_s: float) -> BallEvents:
    return replace(events, times=events.times + by_s)
