"""How a match is shown: which play when, cuts away in between, and a camera that follows the ball with some delay."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.court import Court
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.play import Motion, waves
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.views import Pose, broadcast_pose

REPEAT_EVERY = 6
"""With repeats, the last of so many frames repeats the one before it."""
KNOT_S = 0.02
TIGHT = 0.12
"""Share of matches whose picture may cut a player off."""
ROOM_M = 2.0
ATTEMPTS = 60


@dataclass(frozen=True, eq=False, kw_only=True)
class Span:
    """The frames of one shot."""

    first: int
    """Frame of the video."""
    timestamps: Float[np.ndarray, " frames"]
    capture_times: Float[np.ndarray, " frames"]
    is_duplicate: Bool[np.ndarray, " frames"]

    def after(self, first: int) -> "Span":
        """Without its first frames."""
        return Span(
            first=self.first + first,
            timestamps=self.timestamps[first:],
            capture_times=self.capture_times[first:],
            is_duplicate=self.is_duplicate[first:],
        )


@dataclass(frozen=True, kw_only=True)
class Clock:
    """The frames of a video and when each was taken."""

    fps: float
    """As presented."""
    repeats: bool
    """Every sixth frame repeats the one before: fewer pictures were taken than are shown."""

    @property
    def pictures_per_s(self) -> float:
        """Distinct pictures taken in a second."""
        return self.fps * (REPEAT_EVERY - 1) / REPEAT_EVERY if self.repeats else self.fps

    def frames_of(self, seconds: float) -> int:
        """Frames that a shot of this length takes, one or more; whole groups of repeats, so that cuts part pictures."""
        frames = max(1, int(seconds * self.fps))
        return -(-frames // REPEAT_EVERY) * REPEAT_EVERY if self.repeats else frames

    def span(self, first: int, frames: int) -> Span:
        """Times of these frames."""
        index = np.arange(first, first + frames)
        repeat = (index % REPEAT_EVERY == REPEAT_EVERY - 1) if self.repeats else np.zeros(frames, bool)
        taken = index - index // REPEAT_EVERY - repeat if self.repeats else index
        return Span(
            first=first,
            timestamps=index / self.fps,
            capture_times=taken / self.pictures_per_s,
            is_duplicate=repeat,
        )


def cuts(
    rng: np.random.Generator, plays: Iterator[Play], clock: Clock, frames: int, *, closeups: bool
) -> Iterator[tuple[Span, Play | None]]:
    """The video's shots in order: every play as long as it lasts and, with `closeups`, cuts away (None) after most."""
    first = 0
    while first < frames:
        play = next(plays)
        count = min(clock.frames_of(play.duration_s), frames - first)
        yield clock.span(first, count), play
        first += count
        away = clock.frames_of(float(rng.uniform(1.5, 5.0)))
        if closeups and first < frames:
            count = min(away, frames - first)
            yield clock.span(first, count), None
            first += count


@dataclass(frozen=True, eq=False, kw_only=True)
class Operator:
    """One person's way to turn a camera after play. The camera's centre is fixed."""

    motion: Motion
    pan_share: float
    """Of the angle between the court's middle and the play, how much the camera turns."""
    zoom_share: float
    """Change of focal length, as a share, from play far from the net to play near it."""
    lag_s: float
    """Time after which the camera has followed."""
    drift: tuple[float, float]
    """Slow drift across and up, pixels."""
    shake_px: float
    seed: int


def main_pose(rng: np.random.Generator, court: Court, size: tuple[int, int], *, cropped: bool) -> Pose:
    """The main camera of a match, which mostly leaves room for both players behind their baselines."""
    tight = rng.random() < TIGHT
    length = float(np.abs(court.points_world[:, 1]).max())
    ends = np.array([[0.0, -length - ROOM_M, 0.0], [0.0, length + ROOM_M, 2.2]])
    pose = broadcast_pose(rng, court, size, cropped=cropped)
    for _ in range(0 if tight else ATTEMPTS):
        view = pose.view(size)
        feet, head = pixels_of(ends, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)[:, 1]
        if feet < size[1] - 1 and head > 0:
            break
        pose = broadcast_pose(rng, court, size, cropped=cropped)
    return pose


def draw_operator(rng: np.random.Generator, motion: Motion, width: int) -> Operator:
    """An operator by lot; `any` stands still, drifts or follows."""
    if motion == "any":
        motion = ("still", "drift", "follow")[int(rng.choice(3, p=[0.35, 0.15, 0.5]))]
    unit = width / 1280
    return Operator(
        motion=motion,
        pan_share=float(rng.uniform(0.15, 0.6)),
        zoom_share=float(rng.uniform(0.0, 0.08)),
        lag_s=float(rng.uniform(0.35, 0.9)),
        drift=(float(rng.uniform(1.0, 10.0)) * unit, float(rng.uniform(0.5, 4.0)) * unit),
        shake_px=float(rng.uniform(0.0, 0.3)) * unit,
        seed=int(rng.integers(2**31)),
    )


def poses_of(
    operator: Operator, base: Pose, play: Play, times: Float[np.ndarray, " frames"], video_s: float
) -> list[Pose]:
    """The camera at these times of a play that begins `video_s` into the video."""
    pan, tilt, zoom = np.zeros_like(times), np.zeros_like(times), np.zeros_like(times)
    if operator.motion == "drift":
        rng = np.random.default_rng(operator.seed)
        across, up = operator.drift
        at = times + video_s
        pan = waves(rng, across, 40.0, 12.0)(at) + operator.shake_px * waves(rng, 1.0, 1.0, 0.3, 6)(at)
        tilt = waves(rng, up, 40.0, 12.0)(at) + operator.shake_px * waves(rng, 1.0, 1.0, 0.3, 6)(at)
        pan, tilt = np.arctan(pan / base.focal_px), np.arctan(tilt / base.focal_px)
    if operator.motion == "follow":
        knots, x, y = _attention(play)
        x, y = _lagging(x, operator.lag_s), _lagging(y, 1.5 * operator.lag_s)
        x, y = np.interp(times, knots, x), np.interp(times, knots, y)
        reach = np.hypot(base.centre_world[1], base.centre_world[2])
        pan = operator.pan_share * np.arctan(x / reach)
        tilt = 0.12 * operator.pan_share * np.arctan(y / reach)
        zoom = operator.zoom_share * np.tanh(y / 10.0)
    return [
        replace(
            base,
            heading=base.heading + float(p),
            tilt=base.tilt + float(t),
            focal_px=base.focal_px * float(np.exp(z)),
        )
        for p, t, z in zip(pan, tilt, zoom, strict=True)
    ]


def _attention(play: Play) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where an operator looks: between the ball and the two players, world x and y, on evenly spaced knots."""
    knots = np.arange(0.0, play.duration_s + KNOT_S, KNOT_S)
    near, far = (
        np.stack([np.interp(knots, plan.times, plan.path[:, i]) for i in (0, 1)], axis=-1) for plan in play.plans
    )
    people = 0.5 * (near + far)
    ball = play.ball.at(knots)[0][:, :2]
    ball = np.where(np.isfinite(ball), np.clip(ball, -12.0, 12.0), people)
    aim = 0.5 * ball + 0.5 * people
    return knots, aim[:, 0], aim[:, 1]


def _lagging(course: np.ndarray, lag_s: float) -> np.ndarray:
    """The course as a critically damped follower with this lag takes it, from rest at its first value."""
    rate = 2.0 / lag_s
    followed = np.empty_like(course)
    value, speed = float(course[0]), 0.0
    for i, aim in enumerate(course):
        followed[i] = value
        speed += KNOT_S * (rate * rate * (float(aim) - value) - 2.0 * rate * speed)
        value += KNOT_S * speed
    return followed
