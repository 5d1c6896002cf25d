"""A clip's ball drawn into its pictures through the frame's camera, for people to look at.

The flight that the ball is in: thick where it has been, thin where it goes. A disc is the ball as placed (filled where
its own pixel took part), a ring what the detector saw. The ball's vertical projection on the ground has a dot and, by
its one-sigma ellipse on the ground, how well the place is known.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from pgm_data.dataset.clip_ball import ClipBall
from pgm_data.geometry.camera import Camera, project
from pgm_data.stages.ball_paths import FlightPaths, flight_paths
from pgm_data.stages.court_drawing import BGR
from pgm_data.stages.overlay_marks import draw_circle, draw_path, draw_words, lies_near

PAST, TO_COME, DETECTED = (60, 230, 255), (50, 180, 200), (255, 255, 90)
SHADOW, DOUBT, WORDS = (30, 30, 30), (160, 160, 160), (255, 255, 255)
EVENT_COLOURS: dict[str, BGR] = {"hit": (80, 80, 255), "bounce": (255, 200, 60), "net": (255, 90, 255)}
SHOWN_S = 0.8
"""How long an event stays in the picture, s."""
SPEED_SHOWN_S = 1.2
BOUNCE_RADIUS_M = 0.25
SURE = 0.95
"""Probability from which an event is drawn without it."""
CIRCLE = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 33)), np.sin(a)], axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class BallStrokes:
    """A clip's ball, sampled once and drawn in every frame."""

    ball: ClipBall
    paths: FlightPaths
    ground_half_size: tuple[float, float]
    """Half extent of the plane z = 0; beyond it the ground is lower."""
    floor_z: float
    """Height of the ground around it: 0, or that of the floor under a table."""

    def ground_z(self, point_world: Float[np.ndarray, " 3"]) -> float:
        """Height of the ground under a point."""
        return 0.0 if (np.abs(point_world[:2]) <= self.ground_half_size).all() else self.floor_z


def ball_strokes(ball: ClipBall, *, ground_half_size: tuple[float, float], floor_z: float) -> BallStrokes:
    """The ball of a clip, ready to be drawn."""
    return BallStrokes(ball=ball, paths=flight_paths(ball), ground_half_size=ground_half_size, floor_z=floor_z)


def draw_ball(
    picture: UInt8[np.ndarray, "h w 3"],
    strokes: BallStrokes,
    camera: Camera,
    index: int,
    scale_xy: Float[np.ndarray, " 2"],
) -> None:
    """Draw the ball of frame `index` into the BGR picture, which is changed in place.

    Args:
        picture: The frame, perhaps made smaller.
        strokes: The clip's ball.
        camera: Of the picture as it is; NaN where the frame has none: then only the detected pixel is drawn.
        index: Frame of the clip.
        scale_xy: Size of the picture over that of the video's.
    """
    if np.isfinite(camera.K).all():
        time = float(strokes.ball.capture_time[index])
        _draw_flight(picture, strokes, camera, time)
        _draw_events(picture, strokes, camera, time)
        _draw_place(picture, strokes, camera, index)
    seen = (strokes.ball.pixel[index] + 0.5) * scale_xy - 0.5
    if np.isfinite(seen).all():
        draw_circle(picture, seen, 7.0, DETECTED, 1)


def ball_label(strokes: BallStrokes, index: int) -> str:
    """A line about the ball in a frame: its height, speed and how well its place is known."""
    ball = strokes.ball
    if ball.status[index] == "none":
        return "ball: none"
    height, speed = ball.position[index, 2], np.linalg.norm(ball.velocity[index])
    std = np.sqrt(max(float(np.linalg.eigvalsh(ball.position_cov[index])[-1]), 0.0))
    return f"ball: {ball.status[index]}   {height:.2f} m high   {3.6 * speed:.0f} km/h   +-{std:.2f} m"


def _draw_flight(picture: np.ndarray, strokes: BallStrokes, camera: Camera, time: float) -> None:
    paths = strokes.paths
    flight = paths.at(time)
    if flight is None:
        return
    own = paths.samples(flight)
    pixels, _ = project(camera, paths.points_world[own])
    # The piece that the ball is in counts to what is to come.
    been = int(np.searchsorted(paths.times[own], time, side="right"))
    draw_path(picture, pixels[max(been - 1, 0) :], TO_COME, 1)
    draw_path(picture, pixels[:been], PAST, 2)


def _draw_events(picture: np.ndarray, strokes: BallStrokes, camera: Camera, time: float) -> None:
    events, shots = strokes.ball.events, strokes.ball.shots
    age = time - events.time
    for i in np.flatnonzero((age >= 0) & (age <= SPEED_SHOWN_S) & np.isfinite(events.position).all(axis=1)):
        kind = str(events.kind[i])
        if kind not in EVENT_COLOURS:
            continue
        place = events.position[i]
        (pixel,), _ = project(camera, place[None])
        if not np.isfinite(pixel).all():
            continue
        if kind == "hit":
            speeds = shots.start_speed[shots.start_event == i]
            if len(speeds) and np.isfinite(speeds[0]):
                draw_words(picture, pixel + [10, -10], f"{3.6 * speeds[0]:.0f} km/h", WORDS)
        if age[i] > SHOWN_S:
            continue
        if kind == "bounce":
            ring = np.column_stack(
                [place[:2] + BOUNCE_RADIUS_M * CIRCLE, np.full(len(CIRCLE), strokes.ground_z(place))]
            )
            draw_path(picture, project(camera, ring)[0], EVENT_COLOURS[kind], 2)
        else:
            marker = cv2.MARKER_STAR if kind == "hit" else cv2.MARKER_TILTED_CROSS
            if lies_near(picture, pixel):
                x, y = (round(float(value)) for value in pixel)
                cv2.drawMarker(picture, (x, y), EVENT_COLOURS[kind], marker, 14, 2, cv2.LINE_AA)
        if events.probability[i] < SURE:
            draw_words(picture, pixel + [10, 12], f"{kind} {events.probability[i]:.2f}", WORDS)


def _draw_place(picture: np.ndarray, strokes: BallStrokes, camera: Camera, index: int) -> None:
    ball = strokes.ball
    if ball.status[index] == "none":
        return
    place = ball.position[index]
    below = np.array([place[0], place[1], strokes.ground_z(place)])
    # The root of the covariance on the ground: its columns are the ellipse's half axes.
    values, axes = np.linalg.eigh(ball.position_cov[index, :2, :2])
    around = CIRCLE * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    ellipse = np.column_stack([below[:2] + around, np.full(len(CIRCLE), below[2])])
    pixels, _ = project(camera, np.concatenate([place[None], below[None], ellipse]))
    draw_path(picture, pixels[2:], DOUBT, 1)
    draw_path(picture, pixels[:2], DOUBT, 1)
    if np.isfinite(pixels[1]).all():
        draw_circle(picture, pixels[1], 3.0, SHADOW, cv2.FILLED)
    if np.isfinite(pixels[0]).all():
        draw_circle(picture, pixels[0], 4.0, PAST, cv2.FILLED if ball.status[index] == "measured" else 1)
