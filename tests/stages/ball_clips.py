"""A small clip with a ball that is known: a hit at the far end, a bounce near the camera, a hit back into the net."""

import numpy as np

from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows
from pgm_data.dataset.clip_camera import ClipCamera

GRAVITY = np.array([0.0, 0.0, -9.81])


def known_ball(track: ClipCamera, *, cov=None, **changes) -> ClipBall:
    """The ball of a clip: a hit in its second frame, a bounce in its middle, a hit two frames on, the net last."""
    times = track.capture_time
    frames = len(times)
    middle = frames // 2
    knots = np.array([times[1], times[middle], times[middle + 2], times[-1]])
    places = np.array([[1.0, 11.0, 1.2], [-2.0, -7.0, 0.0335], [-2.2, -9.0, 0.9], [0.5, 0.0, 0.6]])
    flight = np.searchsorted(knots, times, side="right") - 1
    flight = np.where(times == knots[-1], 2, flight)
    inside = (flight >= 0) & (times <= knots[-1])
    at = np.clip(flight, 0, 2)
    span, since = np.diff(knots)[at], times - knots[at]
    start = (places[at + 1] - places[at]) / span[:, None] - 0.5 * GRAVITY * span[:, None]
    position = places[at] + since[:, None] * start + 0.5 * since[:, None] ** 2 * GRAVITY
    velocity = start + since[:, None] * GRAVITY
    blank = ~inside

    def known(values):
        values = np.array(values, dtype=float)
        values[blank] = np.nan
        return values

    words = {"dtype": object}
    return ClipBall(
        clip_id=track.clip_id,
        video_frame=track.video_frame,
        timestamp=track.timestamp,
        capture_time=times,
        pixel=np.full((frames, 2), np.nan),
        score=np.full(frames, np.nan),
        position=known(position),
        velocity=known(velocity),
        position_cov=known(np.tile(np.diag([0.01, 0.09, 0.01]) if cov is None else cov, (frames, 1, 1))),
        status=np.where(blank, "none", np.where(np.arange(frames) % 4 == 2, "filled", "measured")).astype(object),
        events=EventRows(
            time=knots,
            kind=np.array(["hit", "bounce", "hit", "net"], **words),
            player=np.array(["player1", "", "", ""], **words),
            probability=np.array([1.0, 0.6, 0.9, 0.8]),
            source=np.array(["human", "detected", "detected", "detected"], **words),
            position=places,
        ),
        shots=ShotRows(
            start_event=np.array([0, 1, 2]),
            end_event=np.array([1, 2, 3]),
            player=np.array(["player1", "", ""], **words),
            start_speed=np.array([50.0, 20.0, 30.0]),
            spin=np.array([[300.0, 0.0, 10.0], [np.nan] * 3, [0.0, 0.0, 0.0]]),
            spin_std=np.array([[40.0] * 3, [np.nan] * 3, [200.0] * 3]),
            drag_per_m=np.full(3, 0.02),
            drag_std_per_m=np.full(3, 0.002),
            landing_position=np.array([[-2.0, -7.0, 0.0335], [np.nan] * 3, [3.0, 9.0, 0.0335]]),
            in_probability=np.array([0.97, np.nan, 0.04]),
            free_parameters=np.array(["velocity spin", "", "velocity"], **words),
            residual_px=np.array([0.8, 1.1, np.nan]),
            status=np.array(["solved", "fallback: <few> frames", "line"], **words),
        ),
        **changes,
    )
