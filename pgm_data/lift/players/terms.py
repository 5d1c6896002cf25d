"""The terms of the fit: each gives its cost and, if asked, adds its share to the normal equations.

Residuals are in standard deviations; a robust term counts as Student's distribution does, and its weights are those
of iterated least squares. Unknowns of a frame: root position, root turn, angles; one is shared: the logarithm of the
scale.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.rigid import rotvec_from_rotation, skew
from pgm_data.lift.players.banded import Equations
from pgm_data.lift.players.linkage import ROOT, Linkage, Posture
from pgm_data.lift.players.sight import Sight

GRAVITY = 9.81


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionLaw:
    """What is believed of people before they are seen."""

    point_freedom: float = 5.0
    """Degrees of freedom of the Student distribution of a point in the picture."""
    limb_std: float = 0.3
    """Of each component of a limb's direction as a network guesses it, in unit vectors."""
    limit_std: float = 0.05
    """How far angles yield beyond their limits, radians."""
    lean_std: float = 0.35
    """Of the sine of the trunk's lean; with heavy tails, for people do fall."""
    balance_std: float = 0.1
    """How far the root is off the middle of the ankles, level, while both feet stand, metres; with heavy tails."""
    scale_std: float = 0.05
    root_acceleration: tuple[float, float, float] = (4.0, 4.0, 10.0)
    """Standard deviations along world x, y, z while a foot stands, m/s^2; nobody changes speed at will."""
    turn_acceleration: float = 25.0
    """Of the root, rad/s^2; with heavy tails, as the next."""
    angle_acceleration: float = 50.0
    """Of joints, rad/s^2."""
    acceleration_freedom: float = 3.0
    lasts_s: float = 0.04
    """How long an acceleration lasts: what shorter frame times count less."""
    flight_acceleration: float = 3.0
    """How far the root's acceleration is off gravity while both feet are off the ground, m/s^2."""
    root_speed: float = 8.0
    """m/s; keeps frames together where nothing else does, as the next."""
    turn_speed: float = 15.0
    """rad/s."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GroundLaw:
    """How feet meet the ground; wide at first, narrow at last."""

    below_m: float = 0.01
    """How far soles sink in."""
    height_m: float = 0.008
    """Of the lowest point of a planted sole."""
    flat_m: float = 0.04
    """Of its other points."""
    slide_m: float = 0.004
    """How far its lowest point slides between frames `MotionLaw.lasts_s` apart."""
    freedom: float = 2.0
    """Degrees of freedom of the Student distributions of height, flatness and slide.

    Their heavy tails let the pictures lift a foot that was thought planted.
    """
    lowest_m: float = 0.01
    """Within how much of each other several points are the lowest one."""


@dataclass(eq=False, kw_only=True)
class Prior:
    """The posture before anything is seen."""

    strays: Float[np.ndarray, " unknowns"]
    low: Float[np.ndarray, " unknowns"]
    high: Float[np.ndarray, " unknowns"]
    log_scale: float


def _student(square: np.ndarray, freedom: float | np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Cost and weight of residuals of so many components whose squares add up to the given ones."""
    cost = 0.5 * (freedom + size) * np.log1p(square / freedom)
    return cost, (freedom + size) / (freedom + square)


def _add(equations: Equations, residual, slopes, weight, by_scale=None) -> None:
    """Add rows (frames, rows) with slopes (frames, rows, n) and weights (frames, rows)."""
    weighted = slopes * weight[..., None]
    equations.diagonal += np.swapaxes(weighted, 1, 2) @ slopes
    equations.right -= np.einsum("frn,fr->fn", weighted, residual)
    if by_scale is not None:
        equations.border[..., 0] += np.einsum("frn,fr->fn", weighted, by_scale)
        equations.corner[0, 0] += np.sum(weight * by_scale**2)
        equations.right_shared[0] -= np.sum(weight * by_scale * residual)


def _add_diagonal(equations: Equations, at: slice, residual, weight) -> None:
    """Add rows that are unknowns themselves: residual = unknown / unit, weight in units^-2."""
    span = np.arange(equations.right.shape[1])[at]
    equations.diagonal[:, span, span] += weight
    equations.right[:, at] -= weight * residual


def reprojected(linkage: Linkage, sight: Sight, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (frames, points, 2) in standard deviations, depths, and which count."""
    mine = points[:, : linkage.seen]
    cam = mine @ np.swapaxes(sight.R_cam_from_world, 1, 2) + sight.t_cam_from_world[:, None]
    depth = np.maximum(cam[..., 2], 0.1)
    count = sight.seen & (cam[..., 2] > 0.1)
    residual = (cam[..., :2] / depth[..., None] - sight.xy) / sight.sigma[..., None]
    return np.where(count[..., None], residual, 0.0), cam, count


def picture_term(linkage, sight: Sight, points, by_scale, slopes, law: MotionLaw, equations: Equations | None) -> float:
    """Points in the pictures."""
    residual, cam, count = reprojected(linkage, sight, points)
    cost, weight = _student(np.sum(residual**2, axis=-1), law.point_freedom, 2)
    if equations is not None:
        depth = np.maximum(cam[..., 2], 0.1)
        toward = np.zeros((*depth.shape, 2, 3))
        toward[..., 0, 0] = toward[..., 1, 1] = 1.0 / depth
        toward[..., :, 2] = -cam[..., :2] / depth[..., None] ** 2
        toward = toward @ sight.R_cam_from_world[:, None] / sight.sigma[..., None, None]
        toward = np.where(count[..., None, None], toward, 0.0)
        frames, seen = depth.shape
        rows = (toward @ slopes[:, :seen]).reshape(frames, 2 * seen, -1)
        scale = (toward @ by_scale[:, :seen, :, None])[..., 0].reshape(frames, 2 * seen)
        _add(equations, residual.reshape(frames, -1), rows, np.repeat(weight, 2, axis=1), scale)
    return float(np.sum(np.where(count, cost, 0.0)))


def limb_term(sight: Sight, points, slopes, law: MotionLaw, equations: Equations | None) -> float:
    """Directions of limbs as a network guesses them."""
    if not sight.limb_known.any():
        return 0.0
    a, b = sight.limbs.T
    way = points[:, b] - points[:, a]
    length = np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-3)
    unit = way / length
    residual = np.where(sight.limb_known[..., None], unit - sight.limb_world, 0.0) / law.limb_std
    cost, weight = _student(np.sum(residual**2, axis=-1), 4.0, 3)
    weight = np.where(sight.limb_known, weight, 0.0)
    if equations is not None:
        turn = (np.eye(3) - unit[..., :, None] * unit[..., None, :]) / (length[..., None] * law.limb_std)
        rows = turn @ (slopes[:, b] - slopes[:, a])
        frames = len(points)
        _add(
            equations,
            residual.reshape(frames, -1),
            rows.reshape(frames, -1, slopes.shape[-1]),
            np.repeat(weight, 3, axis=1),
        )
    return float(np.sum(np.where(sight.limb_known, cost, 0.0)))


def posture_term(posture: Posture, prior: Prior, law: MotionLaw, equations: Equations | None) -> float:
    """Angles near the reference and within limits, the trunk rather upright, the scale near what is expected."""
    at = slice(ROOT, None)
    residual = posture.angles / prior.strays
    beyond = (
        np.maximum(posture.angles - prior.high, 0.0) + np.minimum(posture.angles - prior.low, 0.0)
    ) / law.limit_std
    cost = 0.5 * np.sum(residual**2) + 0.5 * np.sum(beyond**2)
    up = posture.rotation[:, :, 1]
    lean = up[:, :2] / law.lean_std
    lean_cost, lean_weight = _student(np.sum(lean**2, axis=1), 2.0, 2)
    scale = (posture.log_scale - prior.log_scale) / law.scale_std
    if equations is not None:
        _add_diagonal(equations, at, posture.angles, np.broadcast_to(prior.strays**-2, residual.shape))
        outside = (beyond != 0) * law.limit_std**-2
        _add_diagonal(equations, at, beyond * law.limit_std, outside)
        rows = np.zeros((len(up), 2, equations.right.shape[1]))
        rows[:, :, 3:ROOT] = -skew(up)[:, :2] / law.lean_std
        _add(equations, lean, rows, np.repeat(lean_weight[:, None], 2, axis=1))
        equations.corner[0, 0] += law.scale_std**-2
        equations.right_shared[0] -= scale / law.scale_std
    return float(cost + np.sum(lean_cost) + 0.5 * scale**2)


def _tied(equations: Equations, at: slice, factors, residual, weight) -> None:
    """Add residuals that are linear in one unknown of two or three following frames.

    `factors` are (rows,) for each of those frames; residual and weight (rows, unknowns).
    """
    span = np.arange(equations.right.shape[1])[at]
    rows = len(residual)
    for i, first in enumerate(factors):
        equations.right[i : i + rows, at] -= weight * residual * first[:, None]
        equations.diagonal[i : i + rows, span, span] += weight * first[:, None] ** 2
        for j in range(i + 1, len(factors)):
            value = weight * (first * factors[j])[:, None]
            if j - i == 1:
                equations.next[i : i + rows, span, span] += value
            else:
                equations.after[i : i + rows, at] += value


def motion_term(
    posture: Posture, times: np.ndarray, flight: np.ndarray, law: MotionLaw, equations: Equations | None
) -> float:
    """Smooth movement; while both feet are off the ground, that of a thrown body."""
    if len(times) < 2:
        return 0.0
    step = np.diff(times)
    turn = rotvec_from_rotation(posture.rotation[1:] @ np.swapaxes(posture.rotation[:-1], 1, 2))
    move = np.concatenate([np.diff(posture.position, axis=0), turn, np.diff(posture.angles, axis=0)], axis=1)
    rate = move / step[:, None]
    n = move.shape[1]
    speed = np.full(n, law.turn_speed)
    speed[:3] = law.root_speed
    share = (step / law.lasts_s * 0.1)[:, None] / speed**2
    cost = 0.5 * np.sum(share * rate**2)
    if equations is not None:
        _tied(equations, slice(None), (-1 / step, 1 / step), rate, share)
    if len(times) < 3:
        return float(cost)
    span = 0.5 * (step[1:] + step[:-1])
    c0, c2 = 1 / (span * step[:-1]), 1 / (span * step[1:])
    factors = (c0, -c0 - c2, c2)
    acceleration = np.diff(rate, axis=0) / span[:, None]
    unit = np.concatenate(
        [law.root_acceleration, np.full(3, law.turn_acceleration), np.full(n - ROOT, law.angle_acceleration)]
    )
    counts = (span / law.lasts_s)[:, None]
    aloft = flight[1:-1, None]
    part = np.broadcast_to(counts, acceleration.shape).copy()
    part[:, :3] *= 1.0 - aloft
    square = (acceleration / unit) ** 2
    each, weight = _student(square, law.acceleration_freedom, 1)
    each[:, :3], weight[:, :3] = 0.5 * square[:, :3], 1.0
    thrown = (acceleration[:, :3] + np.array([0.0, 0.0, GRAVITY])) / law.flight_acceleration
    cost += np.sum(part * each) + 0.5 * np.sum(counts * aloft * thrown**2)
    if equations is not None:
        _tied(equations, slice(None), factors, acceleration, part * weight / unit**2)
        thrown = thrown * law.flight_acceleration
        loose = np.broadcast_to(counts * aloft / law.flight_acceleration**2, thrown.shape)
        _tied(equations, slice(0, 3), factors, thrown, loose)
    return float(cost)


def balance_term(
    linkage: Linkage,
    root: np.ndarray,
    points: np.ndarray,
    slopes: np.ndarray | None,
    contact: np.ndarray,
    law: MotionLaw,
    equations: Equations | None,
) -> float:
    """The root over its feet while both stand."""
    left, right = linkage.ankles
    if left < 0 or right < 0:
        return 0.0
    both = contact[:, 0] * contact[:, 1]
    middle = 0.5 * (points[:, left] + points[:, right])[:, :2]
    residual = (middle - root[:, :2]) / law.balance_std
    cost, weight = _student(np.sum(residual**2, axis=1), 4.0, 2)
    if equations is not None and slopes is not None:
        rows = 0.5 * (slopes[:, left] + slopes[:, right])[:, :2] / law.balance_std
        rows[..., :3] = 0.0
        _add(equations, residual, rows, np.repeat((both * weight)[:, None], 2, axis=1))
    return float(np.sum(both * cost))


def lowest_shares(heights: np.ndarray, law: GroundLaw) -> np.ndarray:
    """How much each point of a sole (last axis) is its lowest one."""
    rise = (heights - heights.min(axis=-1, keepdims=True)) / law.lowest_m
    share = np.exp(-rise)
    return share / share.sum(axis=-1, keepdims=True)


def ground_term(
    linkage: Linkage,
    points: np.ndarray,
    by_scale: np.ndarray | None,
    slopes: np.ndarray | None,
    times: np.ndarray,
    contact: np.ndarray,
    law: GroundLaw,
    equations: Equations | None,
    *,
    lasts_s: float = 0.04,
) -> float:
    """Soles above the ground; planted ones on it and in one place."""
    cost = 0.0
    step = np.diff(times) / lasts_s
    for foot, sole in enumerate(linkage.soles):
        mine = points[:, sole]
        z = mine[..., 2]
        planted = contact[:, foot, None]
        share = lowest_shares(z, law)
        high_cost, high_weight = _student((z / law.height_m) ** 2, law.freedom, 1)
        flat_cost, flat_weight = _student((z / law.flat_m) ** 2, law.freedom, 1)
        stays = np.sqrt(share[1:] * share[:-1]) * planted[1:] * planted[:-1]
        slid = np.diff(mine[..., :2], axis=0)
        slide = law.slide_m**-2 / np.maximum(step, 0.25)[:, None]
        slide_cost, slide_weight = _student(slide * np.sum(slid**2, axis=-1), law.freedom, 2)
        parts = (
            (np.minimum(z, 0.0), (z < 0) / law.below_m**2),
            (z, share * planted * high_weight / law.height_m**2),
            (z, (1.0 - share) * planted * flat_weight / law.flat_m**2),
        )
        cost += 0.5 * np.sum(parts[0][1] * z**2) + np.sum((1.0 - share) * planted * flat_cost)
        cost += np.sum(share * planted * high_cost) + np.sum(stays * slide_cost)
        slide = (stays * slide * slide_weight)[..., None]
        if equations is None or slopes is None or by_scale is None:
            continue
        own, grow = slopes[:, sole], by_scale[:, sole]
        for value, weight in parts:
            _add(equations, value, own[:, :, 2], weight, grow[:, :, 2])
        if not len(slid):
            continue
        frames, count = z.shape
        rows = own[:, :, :2].reshape(frames, 2 * count, -1)
        early, late = -rows[:-1], rows[1:]
        weight = np.broadcast_to(slide, slid.shape).reshape(frames - 1, 2 * count)
        off = slid.reshape(frames - 1, 2 * count)
        by = np.diff(grow[..., :2], axis=0).reshape(frames - 1, 2 * count)
        for rows_here, at in ((early, slice(0, -1)), (late, slice(1, None))):
            weighted = rows_here * weight[..., None]
            equations.diagonal[at] += np.swapaxes(weighted, 1, 2) @ rows_here
            equations.right[at] -= np.einsum("frn,fr->fn", weighted, off)
            equations.border[at, :, 0] += np.einsum("frn,fr->fn", weighted, by)
        equations.next[:-1] += np.swapaxes(early * weight[..., None], 1, 2) @ late
        equations.corner[0, 0] += np.sum(weight * by**2)
        equations.right_shared[0] -= np.sum(weight * by * off)
    return float(cost)
