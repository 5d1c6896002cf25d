"""Cuts away from the play: a slow replay of the last stroke or a long lens on one player, or the crowd."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.court import Court
from pgm_data.simulate.camera import rotation_towards
from pgm_data.simulate.tennis.play import Play
from pgm_data.simulate.views import Pose, View, points_in_picture

MOST_CROSSINGS = 2
"""Crossings of the court that such a shot may show: with more in view the court could be placed in it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CutAway:
    """What a shot away from the play shows."""

    times: Float[np.ndarray, " frames"]
    """Moments of the play that its frames show, s; they need not pass at the play's own pace."""
    views: tuple[View, ...]
    haze: float
    """Blur of what is behind the focus, standard deviation as a share of the picture's width."""


def draw_cut_away(
    rng: np.random.Generator,
    play: Play,
    base: Pose,
    court: Court,
    size: tuple[int, int],
    seconds: Float[np.ndarray, " frames"],
) -> CutAway | None:
    """A replay or a close-up after a play, `seconds` (from 0) into the shot; None where the crowd is shown instead."""
    kind = rng.random()
    if kind > 0.85:
        return None
    player = int(rng.integers(2))
    length = float(seconds[-1]) if len(seconds) else 0.0
    if kind < 0.4:
        own = [s for s in play.strokes if s.player == player] or list(play.strokes)
        player = own[-1].player if own else player
        middle = own[-1].time if own else 0.5 * play.duration_s
        pace, tall = 0.4, float(rng.uniform(3.2, 5.0))
        start = middle - 0.55 * pace * length
    else:
        pace, tall = 1.0, float(rng.uniform(1.9, 3.2))
        start = play.duration_s - length
    start = float(np.clip(start, 0.0, max(play.duration_s - pace * length, 0.0)))
    times = np.clip(start + pace * seconds, 0.0, play.duration_s)
    plan = play.plans[player]
    smooth = np.stack([np.interp(times, plan.times, _eased(plan.path[:, i])) for i in (0, 1)], axis=-1)
    aim = np.concatenate([smooth, np.full((len(times), 1), 0.55 * tall if tall < 2.3 else 1.1)], axis=1)
    while True:
        views = tuple(_long_lens(base, point, tall, size) for point in aim)
        if max((points_in_picture(court, v, size) for v in views), default=0) <= MOST_CROSSINGS:
            return CutAway(times=times, views=views, haze=0.004 * min(1.0, 2.5 / tall))
        tall *= 0.8
        aim[:, 2] = min(1.25, 0.5 * tall + 0.6)


def _eased(course: np.ndarray) -> np.ndarray:
    """The course (50 knots a second) averaged over a second, as an operator's hand does."""
    wide = 51
    padded = np.concatenate([np.full(wide // 2, course[0]), course, np.full(wide // 2, course[-1])])
    total = np.cumsum(np.concatenate([[0.0], padded]))
    return (total[wide:] - total[:-wide]) / wide


def _long_lens(base: Pose, aim: np.ndarray, tall_m: float, size: tuple[int, int]) -> View:
    """The view from the main camera's place that shows `tall_m` metres from top to bottom about a point."""
    width, height = size
    towards = aim - base.centre_world
    focal = height * float(np.linalg.norm(towards)) / tall_m
    return View(
        K=np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]]),
        k1=0.0,
        R_cam_from_world=rotation_towards(towards, 0.0),
        centre_world=base.centre_world,
    )
