"""Rotations of the simulator, written apart from the solvers': arrays of 3x3 matrices with any leading axes."""

import numpy as np
from jaxtyping import Float


def about(axis: int, angle: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "... 3 3"]:
    """Rotations about the x (0), y (1) or z (2) axis by an angle, radians."""
    angle = np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    R = np.zeros((*angle.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[..., axis, axis] = 1.0
    R[..., i, i] = R[..., j, j] = c
    R[..., j, i], R[..., i, j] = s, -s
    return R


def from_axis_angle(vector: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3 3"]:
    """Rotations by |vector| radians about the vector; exact to rounding at 0."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(np.asarray(vector, dtype=float), -1, 0)
    zero = np.zeros_like(x)
    W = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    # sin(a)/a and (1 - cos(a))/a^2 without loss near 0.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.eye(3) + first * W + second * (W @ W)


def to_axis_angle(R: Float[np.ndarray, "... 3 3"]) -> Float[np.ndarray, "... 3"]:
    """Axis times angle, radians, angle at most pi; by way of the unit quaternion, good at every angle."""
    m = np.asarray(R, dtype=float)
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = d.sum(axis=-1)
    # Four times the products of the quaternion's entries with its largest one.
    rows = np.empty((*trace.shape, 4, 4))
    rows[..., 0, 0] = 1.0 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[..., i + 1, i + 1] = 1.0 + 2.0 * d[..., i] - trace
        rows[..., 0, i + 1] = rows[..., i + 1, 0] = m[..., k, j] - m[..., j, k]
        rows[..., i + 1, j + 1] = rows[..., j + 1, i + 1] = m[..., j, i] + m[..., i, j]
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    q = np.where(q[..., :1] < 0, -q, q)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(length, q[..., :1])
    return q[..., 1:] * np.where(length > 1e-12, angle / np.maximum(length, 1e-300), 2.0)


def between(start: Float[np.ndarray, "... 3 3"], end: Float[np.ndarray, "... 3 3"], share) -> np.ndarray:
    """The rotation a share (0 to 1, broadcast over the leading axes) of the shortest way from start to end."""
    turn = to_axis_angle(np.swapaxes(start, -1, -2) @ end)
    return start @ from_axis_angle(turn * np.asarray(share, dtype=float)[..., None])


def facing(heading: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "... 3 3"]:
    """R_world_from_root of an upright root (x to its left, y up, z forward) that looks along a heading.

    Heading: radians about world z, 0 towards +y, counted anticlockwise from above (pi/2 looks along -x).
    """
    upright = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    return about(2, heading) @ upright
