"""The twist of bones that joints leave free: smallest, within the joints' limits, steady from frame to frame.

Every joint k that aims at one target alone may turn by tau_k about the line to it without moving anything observed. The
rotation of k to its parent p then depends on tau_p and tau_k alone, so a coarse search over all bones of a frame is
exact by dynamic programming along the tree; damped Gauss-Newton steps over all frames refine it.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation, skew
from pgm_data.lift.players.ik_start import Aimed

GRID = 16
"""Twists tried for each bone."""
OUTSIDE = 1e3
"""Weight of the square of what lies beyond a limit, against that of a rotation."""
MARGIN = np.radians(1.0)
"""How far inside of a limit its weight begins, as it gives way a little."""
FAR = 2.6
"""Rotations larger than this (rad) are not compared from frame to frame, as their vectors may flip."""
AT_ONCE = 512
"""Frames in one table of the search."""
STEPS = 20


def untwisted(
    parents: Int[np.ndarray, " joints"],
    limits: Float[np.ndarray, "joints 2 3"],
    start: Aimed,
    *,
    steadiness: float,
) -> Float[np.ndarray, "frames joints 3 3"]:
    """World rotations of the joints after the free twists were chosen.

    Args:
        parents: Index of each joint's parent.
        limits: Lowest and highest axis-angle vectors, radians.
        start: Rotations, and the axes of twist.
        steadiness: Weight of a rotation's change from frame to frame against its size.
    """
    inner = _inside(limits)
    free = np.asarray(start.axis.any(axis=-1))
    if not free.any():
        return start.R_world_from_joint
    chunks = range(0, len(free), AT_ONCE)
    tau = np.concatenate([_searched(parents, inner, start, slice(i, i + AT_ONCE)) for i in chunks])
    tau = _refined(parents, inner, start, np.where(free, tau, 0.0), steadiness)
    return _twisted(start, tau, parents)


def _inside(limits: Float[np.ndarray, "joints 2 3"]) -> Float[np.ndarray, "joints 2 3"]:
    with np.errstate(invalid="ignore"):
        width = limits[:, 1] - limits[:, 0]
        margin = np.minimum(MARGIN, width / 4)
        return np.stack([limits[:, 0] + margin, limits[:, 1] - margin], axis=1)


def _twisted(
    start: Aimed, tau: Float[np.ndarray, "frames joints"], parents: Int[np.ndarray, " joints"]
) -> Float[np.ndarray, "frames joints 3 3"]:
    """World rotations after twists; joints that nothing turns go with their parents."""
    before = start.R_world_from_joint
    R = before @ rotation_from_rotvec(start.axis * tau[..., None])
    for joint, parent in enumerate(parents):
        loose = start.loose[:, joint]
        if parent >= 0 and loose.any():
            own = np.swapaxes(before[loose, parent], -1, -2) @ before[loose, joint]
            R[loose, joint] = R[loose, parent] @ own
    return R


def beyond(
    rotations: Float[np.ndarray, "frames joints 3"], limits: Float[np.ndarray, "joints 2 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """How far each axis-angle component lies above (positive) or below its limits, radians."""
    return np.maximum(rotations - limits[:, 1], 0.0) + np.minimum(rotations - limits[:, 0], 0.0)


def _searched(
    parents: Int[np.ndarray, " joints"], limits: Float[np.ndarray, "joints 2 3"], start: Aimed, rows: slice
) -> Float[np.ndarray, "frames joints"]:
    """The best twists of a coarse grid, each frame by itself."""
    R, axis, loose = start.R_world_from_joint[rows], start.axis[rows], start.loose[rows]
    grid = 2 * np.pi * np.arange(GRID) / GRID
    grid = np.where(grid > np.pi, grid - 2 * np.pi, grid)
    frames, count = loose.shape
    free = np.asarray(axis.any(axis=-1))
    worth = np.zeros((frames, count, GRID))
    worth[:, 0] += 1e-3 * grid**2
    chosen = np.zeros((frames, count, GRID), dtype=np.int64)
    for joint in range(count - 1, 0, -1):
        parent = parents[joint]
        if not (free[:, joint] | free[:, parent]).any():
            continue
        relative = _quaternion(np.swapaxes(R[:, parent], -1, -2) @ R[:, joint])
        cost = _grid_cost(relative, axis[:, parent], axis[:, joint], limits[joint], grid)
        cost = np.where(loose[:, joint, None, None], 0.0, cost) + worth[:, joint, None, :]
        chosen[:, joint] = np.argmin(cost, axis=2)
        worth[:, parent] += np.min(cost, axis=2)
    best = np.zeros((frames, count), dtype=np.int64)
    best[:, 0] = np.argmin(worth[:, 0], axis=1)
    for joint in range(1, count):
        best[:, joint] = chosen[np.arange(frames), joint, best[:, parents[joint]]]
    return grid[best]


def _quaternion(R: Float[np.ndarray, "frames 3 3"]) -> Float[np.ndarray, "frames 4"]:
    """Unit quaternions, the real part first."""
    half = rotvec_from_rotation(R) / 2
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1)


def _product(a: Float[np.ndarray, "n 4"], b: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    real = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=-1, keepdims=True)
    other = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.concatenate([real, other], axis=-1)


def _grid_cost(
    relative: Float[np.ndarray, "frames 4"],
    parent_axis: Float[np.ndarray, "frames 3"],
    own_axis: Float[np.ndarray, "frames 3"],
    limits: Float[np.ndarray, "2 3"],
    grid: Float[np.ndarray, " grid"],
) -> Float[np.ndarray, "frames grid grid"]:
    """Size of a joint's rotation and what lies beyond its limits, by the twist of its parent and its own."""
    zero = np.zeros((len(relative), 1))
    still = (~parent_axis.any(axis=1), ~own_axis.any(axis=1))
    before = _product(np.concatenate([zero, -parent_axis], axis=1), relative)
    after = np.concatenate([zero, own_axis], axis=1)
    parts = np.stack([relative, _product(relative, after), before, _product(before, after)], axis=2)
    cosine, sine = np.cos(grid / 2), np.sin(grid / 2)
    basis = np.stack([np.outer(p, k).ravel() for p in (cosine, sine) for k in (cosine, sine)])
    q = (parts.astype(np.float32) @ basis.astype(np.float32)).reshape(len(relative), 4, len(grid), len(grid))
    # A joint that does not twist is the same all over the grid.
    q[still[0]] = q[still[0], :, :1]
    q[still[1]] = q[still[1], :, :, :1]
    half = np.arccos(np.minimum(np.abs(q[:, 0]), 1.0))
    cost = (2 * half) ** 2
    if np.isfinite(limits).any():
        length = np.copysign(2 / np.maximum(np.sinc(half / np.pi), 1e-3), q[:, 0])
        for i in range(3):
            rotation = q[:, i + 1] * length
            outside = rotation - np.clip(rotation, np.float32(limits[0, i]), np.float32(limits[1, i]))
            cost += OUTSIDE * outside**2
    return cost


def inverse_right_jacobian(rotvec: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """How an axis-angle vector changes where its rotation is turned a little further in its own frame.

    Source: Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, eq. 10.86.
    """
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < 1e-3
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1 / 12 + angle**2 / 720, 1 / safe**2 - 1 / (2 * safe * np.tan(safe / 2)))
    k = skew(rotvec)
    return np.eye(3) + k / 2 + factor * (k @ k)


def _edges(
    parents: Int[np.ndarray, " joints"], R: Float[np.ndarray, "frames joints 3 3"]
) -> Float[np.ndarray, "frames joints 3"]:
    """Axis-angle vectors to the parents; 0 of the root."""
    to_parent = np.swapaxes(R[:, parents[1:]], -1, -2) @ R[:, 1:]
    return np.concatenate([np.zeros((len(R), 1, 3)), rotvec_from_rotation(to_parent)], axis=1)


def _refined(
    parents: Int[np.ndarray, " joints"],
    limits: Float[np.ndarray, "joints 2 3"],
    start: Aimed,
    tau: Float[np.ndarray, "frames joints"],
    steadiness: float,
) -> Float[np.ndarray, "frames joints"]:
    """Twists at the nearest minimum of sizes, limits and changes from frame to frame of all rotations."""
    damping = 1e-3
    rotations = _edges(parents, _twisted(start, tau, parents))
    pairs = _pairs(rotations, start.loose)
    value = _value(rotations, limits, start.loose, pairs, steadiness)
    for _ in range(STEPS):
        step = _step(parents, limits, start, rotations, pairs, steadiness, damping)
        moved = tau + step
        ahead = _edges(parents, _twisted(start, moved, parents))
        then = _value(ahead, limits, start.loose, pairs, steadiness)
        if then < value:
            done = value - then < 1e-5 * value + 1e-12
            tau, rotations, value, damping = moved, ahead, then, damping / 5
            if done:
                break
        else:
            damping *= 10
            if damping > 1e6:
                break
    return tau


def _pairs(
    rotations: Float[np.ndarray, "frames joints 3"], loose: Bool[np.ndarray, "frames joints"]
) -> Bool[np.ndarray, "pairs joints"]:
    """Joints whose rotations in one frame and the next are compared."""
    calm = (np.linalg.norm(rotations, axis=-1) < FAR) & ~loose
    return calm[1:] & calm[:-1]


def _value(
    rotations: Float[np.ndarray, "frames joints 3"],
    limits: Float[np.ndarray, "joints 2 3"],
    loose: Bool[np.ndarray, "frames joints"],
    pairs: Bool[np.ndarray, "pairs joints"],
    steadiness: float,
) -> float:
    kept = ~loose[..., None]
    change = np.diff(rotations, axis=0) * pairs[..., None]
    outside = np.nan_to_num(beyond(rotations, limits))
    return float((kept * (rotations**2 + OUTSIDE * outside**2)).sum() + steadiness * (change**2).sum())


def _step(
    parents: Int[np.ndarray, " joints"],
    limits: Float[np.ndarray, "joints 2 3"],
    start: Aimed,
    rotations: Float[np.ndarray, "frames joints 3"],
    pairs: Bool[np.ndarray, "pairs joints"],
    steadiness: float,
    damping: float,
) -> Float[np.ndarray, "frames joints"]:
    """One damped Gauss-Newton step of all twists."""
    from scipy.linalg import solveh_banded

    frames, count = start.loose.shape
    free = np.asarray(start.axis.any(axis=-1))
    variables = np.flatnonzero(free.any(axis=0))
    place = np.full(count, -1)
    place[variables] = np.arange(len(variables))
    size = len(variables)
    kept = (~start.loose).astype(np.float64)
    kept[:, 0] = 0.0
    outside = beyond(rotations, limits)
    bent = 1.0 + OUTSIDE * (outside != 0)
    change = np.diff(rotations, axis=0) * pairs[..., None]
    pull = kept[..., None] * (rotations + OUTSIDE * outside)
    pull[1:] += steadiness * change
    pull[:-1] -= steadiness * change
    both = np.zeros((frames, count))
    both[1:] += pairs
    both[:-1] += pairs
    weight = kept[..., None] * bent + steadiness * both[..., None]
    own_turn = (inverse_right_jacobian(rotations) @ start.axis[..., None])[..., 0]
    up = np.where(parents >= 0, parents, 0)
    parent_turn = -(inverse_right_jacobian(-rotations) @ start.axis[:, up, :, None])[..., 0]
    H = np.zeros((frames, 2 * size, size))
    gradient = np.zeros((frames, size))
    for joint in range(1, count):
        turns = [(place[joint], own_turn[:, joint]), (place[parents[joint]], parent_turn[:, joint])]
        turns = [(at, turn) for at, turn in turns if at >= 0]
        for at, turn in turns:
            gradient[:, at] += (turn * pull[:, joint]).sum(axis=1)
            for other, second in turns:
                H[:, other, at] += (turn * weight[:, joint] * second).sum(axis=1)
                coupled = steadiness * pairs[:, joint] * (turn[:-1] * second[1:]).sum(axis=1)
                H[:-1, size + other, at] -= coupled
    diagonal = np.arange(size)
    H[:, diagonal, diagonal] += damping * (1.0 + H[:, diagonal, diagonal]) + 1e-9
    off, column = np.arange(2 * size)[:, None], diagonal[None, :]
    row = off + column
    band = np.where(row < 2 * size, H[:, np.minimum(row, 2 * size - 1), column], 0.0)
    band = np.moveaxis(band, 0, 1).reshape(2 * size, frames * size)[: frames * size]
    step = -solveh_banded(band, gradient.reshape(-1), lower=True).reshape(frames, size)
    result = np.zeros((frames, count))
    result[:, variables] = np.clip(step, -0.5, 0.5)
    return np.where(free, result, 0.0)
