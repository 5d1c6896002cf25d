"""Arms and trunk that bring the racket to the ball: the strokes' postures, met exactly at contact and toss."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body import arms, postures
from pgm_data.simulate.body.figure import Figure
from pgm_data.simulate.body.keys import Course, calm_rates
from pgm_data.simulate.body.racket import BALL_RADIUS_M, SWEET_SPOT_M
from pgm_data.simulate.body.schedule import STEP_S, Schedule, joined
from pgm_data.simulate.body.strokes import Swing, is_overhead

_MIRROR = np.array([-1.0, 1.0, 1.0])
_RATE_EASE = np.array([1.2, 3.0, 1.2, 1.5, 2.0, 8.0, 9.0, 11.0, 9.0, 10.0, 9.0, 6.0, 0.5, 0.5])
"""How readily each angle leaves its posture's way, so that the racket's head goes along the swing, rad/s."""
_STILL_HANDS = 2.5
"""m/s: how readily both hands on the racket move at contact; they are rather the pivot about which it turns."""
_FASTEST = np.array([8.0, 12.0, 8.0, 8.0, 8.0, 30.0, 30.0, 35.0, 32.0, 30.0, 32.0, 24.0, 3.0, 3.0])
_TOSS_SPEED = 3.2
"""Of the hand where it lets go of the ball, m/s upwards."""
_PALM_OUT = np.array([0.0, -0.05, 0.0])
_WEIGHTS = np.array([40.0, 1.6, 4.0, 0.0])
_TOSS_WEIGHTS = np.array([40.0, 0.0, 1.5, 0.0])
_TWO_HANDED_STEP_S = 0.03
_LETS_GO_M = 0.02
_TRUNK_GIVE = {1: np.deg2rad([26.0, 36.0, 26.0]), 2: np.deg2rad([22.0, 22.0, 18.0])}
"""How far the trunk may leave a posture to meet the ball with one or both hands, radians."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Arms:
    """Postures in time."""

    racket: Course
    """All channels of `postures.angles`."""
    other: Course
    """The channels of the other arm, which count instead."""

    def at(self, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, "times channels"]:
        """All channels at any times."""
        values = self.racket.at(times)
        values[:, postures.OTHER] = self.other.at(times)
        return values


def solved_course(
    figure: Figure,
    schedule: Schedule,
    root_position: Float[np.ndarray, "moments 3"],
    root_rotation: Float[np.ndarray, "moments 3 3"],
) -> "Arms | None":
    """The course of all postures through the contacts, a right-hander's; None without strokes.

    Args:
        figure: Whose.
        schedule: The strokes.
        root_position: World place of the pelvis at `schedule.special_times()`.
        root_rotation: R_world_from_root there.
    """
    if not schedule.swings:
        return None
    own = _MIRROR if figure.hand == "left" else np.ones(3)
    position = root_position.reshape(-1, 2, 3, 3)
    to_root = np.swapaxes(root_rotation, -1, -2).reshape(-1, 2, 3, 3, 3)
    bones = postures.side_bones(figure.translations, figure.hand)
    values, contacts = [], []
    for i, swing in enumerate(schedule.swings):
        value, drift = _met(swing, position[i, 0], to_root[i, 0], own, bones)
        values.append(value)
        contacts.append(drift)
    times, rows = joined(schedule.swings, values)
    other_bones = postures.side_bones(figure.translations, "left" if figure.hand == "right" else "right")
    _grasp(rows, bones, other_bones)
    rates = calm_rates(times, rows)
    for swing, (aim, velocity) in zip(schedule.swings, contacts, strict=True):
        k = int(np.searchsorted(times, swing.stroke.time - 1e-9))
        row = rows[k, postures.RACKET]
        rates[k, postures.RACKET] = _struck(swing.stroke.hands, row, rates[k, postures.RACKET], bones, aim, velocity)
    for i, swing in enumerate(schedule.swings):
        if swing.toss >= 0:
            k = int(np.searchsorted(times, swing.times[swing.toss] - 1e-9))
            _toss(swing, position[i, 1], to_root[i, 1], own, other_bones, rows, rates, k)
    racket = Course(times=times, values=rows, rates=rates)
    return Arms(racket=racket, other=_along_shaft(schedule, racket, bones, other_bones))


def _along_shaft(schedule: Schedule, course: Course, bones, other_bones) -> Course:
    """The other arm's course, with more steps where both hands hold the racket: there it follows the racket's arm."""
    times = [course.times]
    values, rates = [course.values[:, postures.OTHER]], [course.rates[:, postures.OTHER]]
    for swing in schedule.swings:
        k = int(np.searchsorted(course.times, swing.stroke.time - 1e-9))
        if swing.stroke.hands != 2 or course.values[k, postures.HOLD.start] < 1.0:
            continue
        begin, end = swing.times[1], swing.times[-2]
        inner = course.times[(course.times >= begin - 1e-9) & (course.times <= end + 1e-9)]
        count = int(np.ceil((end - begin) / _TWO_HANDED_STEP_S))
        between = np.linspace(begin, end, count, endpoint=False)[1:]
        near = np.abs(between[:, None] - inner).min(axis=1) < 0.2 * _TWO_HANDED_STEP_S
        extra = np.sort(np.concatenate([inner, between[~near]]))
        at = course.at(extra)
        points = postures.shaft_points(
            arms.within_limits(at[:, postures.RACKET]), at[:, postures.HOLD.start + 1], bones
        )
        q = at[:, postures.OTHER].copy()
        q[:, : arms.TRUNK] = arms.mirrored(at[:, postures.RACKET])[:, : arms.TRUNK]
        middle = int(np.searchsorted(extra, swing.stroke.time - 1e-9))
        # Step by step away from the contact, so that the elbow stays on its side.
        for j in (*range(middle + 1, len(extra)), *range(middle - 1, -1, -1)):
            q[j, arms.TRUNK :] = q[j - 1 if j > middle else j + 1, arms.TRUNK :]
            one = slice(j, j + 1)
            q[one] = arms.follow_points(q[one], *arms.inner_limits(), arms.EASE, other_bones, points[one], np.ones(1))
        times.append(extra)
        values.append(q)
        rates.append(np.gradient(q, extra, axis=0))
    # Of two steps at one time the later one counts.
    t, v, r = np.concatenate(times), np.concatenate(values), np.concatenate(rates)
    order = np.lexsort((np.arange(len(t)), t))
    keep = order[np.append(np.diff(t[order]) > 1e-9, True)]
    return Course(times=t[keep], values=v[keep], rates=r[keep])


def _grasp(rows, bones, other_bones) -> None:
    """Put the other hand onto the shaft in the steps where it holds it, in place."""
    racket, other = rows[:, postures.RACKET], rows[:, postures.OTHER]
    other[:, : arms.TRUNK] = arms.mirrored(racket)[:, : arms.TRUNK]
    hold, along = rows[:, postures.HOLD].T
    points = postures.shaft_points(arms.within_limits(racket), along, bones)
    for _ in range(4):
        other[:] = arms.follow_points(other, *arms.inner_limits(), arms.EASE, other_bones, points, hold)
    # What it cannot reach it lets go of.
    far = np.linalg.norm(arms.hands(other, other_bones)[1] - points, axis=1) > _LETS_GO_M
    rows[far, postures.HOLD.start] = 0.0


def _met(swing: Swing, position, to_root, own, bones):
    """The steps of a swing with the racket at the ball, and the point of the hand that meets it and its velocity."""
    stroke = swing.stroke
    sign = 1.0 if swing.palm_side else -1.0
    aim = SWEET_SPOT_M * arms.SHAFT + np.array([0.0, -sign * BALL_RADIUS_M, 0.0])
    moments = np.arange(-1, 2)[:, None] * STEP_S
    ahead = stroke.ball + moments * swing.speed * stroke.swing
    seen = np.einsum("nij,nj->ni", to_root, ahead - position) * own
    velocity = (seen[2] - seen[0]) / (2.0 * STEP_S)
    nominal = swing.values[swing.hit, postures.RACKET]
    low, high = arms.inner_limits()
    trunk = slice(0, arms.TRUNK)
    low[trunk] = np.maximum(low[trunk], nominal[trunk] - _TRUNK_GIVE[stroke.hands])
    high[trunk] = np.minimum(high[trunk], nominal[trunk] + _TRUNK_GIVE[stroke.hands])
    shaft, palm = _wanted(swing, to_root[1], seen[1], own)
    wants = np.stack([seen[1], shaft, palm, np.zeros(3)])
    solved = arms.reach_pose(nominal, low, high, arms.EASE, bones, aim, wants, _WEIGHTS)
    values = swing.values.copy()
    values[:, postures.RACKET] += swing.shares[:, None] * (solved - nominal)
    values[swing.hit, postures.RACKET] = solved
    return values, (aim, velocity)


def _wanted(swing: Swing, to_root, ball_root, own) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the shaft and of the palm at contact, in the root's frame."""
    stroke = swing.stroke
    sign = 1.0 if swing.palm_side else -1.0
    face = stroke.swing * np.array([1.0, 1.0, 1.0 if is_overhead(stroke) else 0.45])
    if stroke.kind in ("slice", "drop", "volley"):
        face = face + np.array([0.0, 0.0, 0.25])
    face = (to_root @ face) * own
    up = (to_root @ np.array([0.0, 0.0, 1.0])) * own
    # A posture knows its shaft at its own ball; a lower ball lets the head hang, a higher one lifts it.
    R, _ = arms.hands(swing.values[swing.hit : swing.hit + 1, postures.RACKET], _PLAIN)
    shaft = R[0] @ arms.SHAFT
    if not is_overhead(stroke):
        shaft = shaft + up * float(np.clip(0.9 * (ball_root @ up - 0.05), -0.7, 0.6))
    return shaft / np.linalg.norm(shaft), sign * face / np.linalg.norm(face)


_PLAIN = np.zeros((8, 3))


def _struck(held_by: int, q, calm, bones, aim, velocity) -> np.ndarray:
    """Rates of the chain with which the aim moves with the velocity, near the calm ones."""
    J = arms.point_rates(q, bones, aim)
    cost = np.diag(_RATE_EASE**-2)
    if held_by == 2:
        hand = arms.point_rates(q, bones, np.zeros(3)) / _STILL_HANDS
        cost = cost + hand.T @ hand
    rates = np.clip(calm, -_FASTEST, _FASTEST)
    free = np.ones(len(q), bool)
    # The angle that would be much too fast stays at its fastest and leaves the rest to the others.
    while True:
        W = np.zeros_like(cost)
        W[np.ix_(free, free)] = np.linalg.inv(cost[np.ix_(free, free)])
        change = W @ J.T @ np.linalg.solve(J @ W @ J.T + 1e-3 * np.eye(3), velocity - J @ rates)
        over = np.abs(rates + change) / _FASTEST
        worst = int(np.argmax(over))
        if over[worst] <= 1.0 + 1e-9 or free.sum() <= 3:
            return np.clip(rates + change, -_FASTEST, _FASTEST)
        rates[worst] = np.sign(rates[worst] + change[worst]) * _FASTEST[worst]
        free[worst] = False


def _toss(swing: Swing, position, to_root, own, bones, rows, rates, k: int) -> None:
    """Put the other hand under the ball where it lets go, in place."""
    stroke = swing.stroke
    moments = np.arange(-1, 2)[:, None] * STEP_S
    path = stroke.toss + moments * np.array([0.0, 0.0, _TOSS_SPEED])
    seen = np.einsum("nij,nj->ni", to_root, path - position) * own * _MIRROR
    up = (to_root[1] @ np.array([0.0, 0.0, 1.0])) * own * _MIRROR
    start = rows[k, postures.OTHER].copy()
    start[: arms.TRUNK] = arms.mirrored(rows[k, postures.RACKET])[: arms.TRUNK]
    low, high = arms.inner_limits()
    low[: arms.TRUNK] = high[: arms.TRUNK] = start[: arms.TRUNK]
    wants = np.stack([seen[1], np.zeros(3), up, np.zeros(3)])
    q = arms.reach_pose(start, low, high, arms.EASE, bones, _PALM_OUT, wants, _TOSS_WEIGHTS)
    rows[k, postures.OTHER] = q
    _move_arm(rows[k], rates[k], bones, _PALM_OUT, (seen[2] - seen[0]) / (2.0 * STEP_S))


def _move_arm(row, rate, bones, aim, velocity) -> None:
    """Let a point of the other hand move with a velocity in the frame of its chain, in place."""
    calm = rate[postures.OTHER]
    calm[: arms.TRUNK] = arms.mirrored(rate[postures.RACKET])[: arms.TRUNK]
    J = arms.point_rates(row[postures.OTHER], bones, aim)
    W = _RATE_EASE**2
    W[: arms.TRUNK] = 0.0
    change = W * (J.T @ np.linalg.solve(J @ (W[:, None] * J.T) + 1e-3 * np.eye(3), velocity - J @ calm))
    calm[arms.TRUNK :] = np.clip(calm + change, -_FASTEST, _FASTEST)[arms.TRUNK :]
