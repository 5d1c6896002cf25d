"""Trunk and arm of the racket's side as a chain of angles within human limits, and the angles that reach a pose.

Everything here is a right-hander's, in the frame of the pelvis (x left, y up, z forward; metres, radians); a
left-hander is the mirror image. A chain is three angles of the trunk and eleven of an arm, named by `CHAIN`: trunk
`lean` forward, `turn` to the left, `side` to the right, shared alike by Torso, Spine and Chest; collar bone `raise`,
`protract`; shoulder `elevate`, `across` (both from an arm held out, forward, a little down), `twist` inward; `elbow`;
forearm `pronate`; wrist `flex` to the palm, `deviate` to the thumb; the racket in the hand `grip` about its shaft and
`fingers`, the shaft towards the palm. The other arm is the same chain in the mirror.
"""

import numba
import numpy as np

CHAIN = (
    *("lean", "turn", "side"),
    *("raise", "protract", "elevate", "across", "twist", "elbow", "pronate", "flex", "deviate", "grip", "fingers"),
)
TRUNK, ARM = 3, 11
_DEGREES = np.array(
    [
        *[(-28.0, 45.0), (-55.0, 55.0), (-32.0, 32.0)],
        *[(-10.0, 35.0), (-28.0, 32.0), (-98.0, 132.0), (-75.0, 118.0), (-115.0, 95.0), (3.0, 148.0), (-88.0, 88.0)],
        *[(-70.0, 65.0), (-45.0, 30.0), (-38.0, 38.0), (-30.0, 5.0)],
    ]
)
LOWEST, HIGHEST = np.deg2rad(_DEGREES).T
"""Limits of the chain's angles."""
MARGIN = 0.07
"""Angles within this share of their range of a limit are eased into it; solutions keep out of there."""
EASE = np.deg2rad([14, 22, 12, 12, 14, 45, 45, 40, 45, 50, 35, 22, 22, 14.0])
"""How readily each angle leaves its reference."""
SHAFT = np.array([-0.3, 0.0, 1.0]) / np.sqrt(1.09)
"""The racket's shaft in the right hand, as `racket.shaft_axis`."""
_AHEAD, _DOWN = np.deg2rad(35.0), np.deg2rad(20.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _spin(R, axis, angle):
    """R := R @ (rotation about x, y or z)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    for k in range(3):
        a, b = R[k, i], R[k, j]
        R[k, i] = c * a + s * b
        R[k, j] = c * b - s * a


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _spin_about(R, x, y, z):
    """R := R @ exp(x, y, z)."""
    square = x * x + y * y + z * z
    if square < 1e-16:
        first, second = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        angle = np.sqrt(square)
        first, second = np.sin(angle) / angle, (1.0 - np.cos(angle)) / square
    e00, e11, e22 = 1.0 - second * (y * y + z * z), 1.0 - second * (x * x + z * z), 1.0 - second * (x * x + y * y)
    e01, e10 = second * x * y - first * z, second * x * y + first * z
    e02, e20 = second * x * z + first * y, second * x * z - first * y
    e12, e21 = second * y * z - first * x, second * y * z + first * x
    for k in range(3):
        a, b, c = R[k, 0], R[k, 1], R[k, 2]
        R[k, 0] = a * e00 + b * e10 + c * e20
        R[k, 1] = a * e01 + b * e11 + c * e21
        R[k, 2] = a * e02 + b * e12 + c * e22


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _turn_joint(R, joint, q):
    """R := R @ R_parent_from_joint; joint 0 to 2 of the trunk, 3 to 7 from collar bone to hand."""
    if joint < 3:
        _spin_about(R, q[0] / 3.0, q[1] / 3.0, q[2] / 3.0)
    elif joint == 3:
        _spin(R, 2, -q[3])
        _spin(R, 1, q[4])
    elif joint == 4:
        _spin(R, 1, _AHEAD)
        _spin(R, 2, _DOWN)
        _spin_about(R, 0.0, q[6], -q[5])
        _spin(R, 0, q[7])
    elif joint == 5:
        # Half of the forearm's turn at either end of it, as skin does.
        _spin(R, 1, q[8])
        _spin(R, 0, 0.5 * q[9])
    elif joint == 6:
        _spin(R, 0, 0.5 * q[9])
        _spin(R, 2, q[10])
        _spin(R, 1, q[11])
    else:
        _spin(R, 1, q[13])
        _spin_about(R, q[12] * SHAFT[0], 0.0, q[12] * SHAFT[2])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _pose(q, bones, R, p, elbow):
    """Fill rotation and position of the hand and the position of the elbow."""
    for i in range(3):
        p[i] = 0.0
        for j in range(3):
            R[i, j] = 1.0 if i == j else 0.0
    for joint in range(8):
        for i in range(3):
            p[i] += R[i, 0] * bones[joint, 0] + R[i, 1] * bones[joint, 1] + R[i, 2] * bones[joint, 2]
        if joint == 5:
            elbow[:] = p
        _turn_joint(R, joint, q)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _misses(q, bones, aim, wants, weights, R, p, out):
    """Weighted misses (12) of a point of the hand, of shaft, palm and elbow; out holds them after."""
    _pose(q, bones, R, p, out[9:12])
    for i in range(3):
        point = p[i] + R[i, 0] * aim[0] + R[i, 1] * aim[1] + R[i, 2] * aim[2]
        out[i] = weights[0] * (point - wants[0, i])
        out[3 + i] = weights[1] * (R[i, 0] * SHAFT[0] + R[i, 2] * SHAFT[2] - wants[1, i])
        out[6 + i] = weights[2] * (-R[i, 1] - wants[2, i])
        out[9 + i] = weights[3] * (out[9 + i] - wants[3, i])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _descend(q, reference, low, high, ease, bones, aim, wants, weights, steps, drift):
    """Damped least squares from q, in place; where `drift`, each step is as short as can be and no reference pulls."""
    n = len(q)
    R, p = np.empty((3, 3)), np.empty(3)
    miss, other = np.empty(12), np.empty(12)
    J, A, g = np.zeros((12, n)), np.empty((n, n)), np.empty(n)
    trial = np.empty(n)
    damping = 1e-3 if not drift else 1e-4
    _misses(q, bones, aim, wants, weights, R, p, miss)
    for _ in range(steps):
        for j in range(n):
            if high[j] > low[j]:
                keep = q[j]
                q[j] = keep + 1e-6
                _misses(q, bones, aim, wants, weights, R, p, other)
                q[j] = keep
                for i in range(12):
                    J[i, j] = (other[i] - miss[i]) * 1e6
        before = 0.0
        for i in range(12):
            before += miss[i] * miss[i]
        for j in range(n):
            pull = 0.0 if drift else (q[j] - reference[j]) / (ease[j] * ease[j])
            before += 0.0 if drift else pull * (q[j] - reference[j])
            g[j] = pull
            for i in range(12):
                g[j] += J[i, j] * miss[i]
        better = False
        for _attempt in range(8):
            for j in range(n):
                for k in range(n):
                    A[j, k] = 0.0
                    for i in range(12):
                        A[j, k] += J[i, j] * J[i, k]
                A[j, j] += (damping if drift else 1.0 + damping) / (ease[j] * ease[j])
            for j in range(n):
                stuck = (q[j] <= low[j] and g[j] > 0) or (q[j] >= high[j] and g[j] < 0) or high[j] <= low[j]
                if stuck:
                    for k in range(n):
                        A[j, k] = A[k, j] = 0.0
                    A[j, j] = 1.0
            step = np.linalg.solve(A, g)
            for j in range(n):
                stuck = (q[j] <= low[j] and g[j] > 0) or (q[j] >= high[j] and g[j] < 0) or high[j] <= low[j]
                trial[j] = q[j] if stuck else min(max(q[j] - min(max(step[j], -0.6), 0.6), low[j]), high[j])
            _misses(trial, bones, aim, wants, weights, R, p, other)
            after = 0.0
            for i in range(12):
                after += other[i] * other[i]
            if not drift:
                for j in range(n):
                    after += ((trial[j] - reference[j]) / ease[j]) ** 2
            if after <= before:
                q[:] = trial
                miss[:] = other
                damping = max(0.3 * damping, 1e-7)
                better = True
                break
            damping *= 8.0
        if not better:
            break


@numba.njit(cache=True, nogil=True, error_model="numpy")
def reach_pose(reference, low, high, ease, bones, aim, wants, weights):
    """Angles (14) near a reference that bring a point of the hand to a place and turn shaft, palm and elbow.

    Args:
        reference: (14,) angles from which the solution strays as little as it can.
        low: (14,) Limits; an angle with low = high stays.
        high: (14,)
        ease: (14,) Radians that each angle may stray at the cost of 1.
        bones: (8, 3) From the pelvis to Torso, Spine, Chest, Thorax, Shoulder, Elbow, Wrist, Hand, at rest.
        aim: (3,) The point in the hand's frame.
        wants: (4, 3) Place of the point, direction of the shaft, of the palm, place of the elbow.
        weights: (4,) Of the four, per metre or per unit; with a weight of the place above 0 it is then met exactly
            where the limits allow.
    """
    q = np.minimum(np.maximum(reference, low), high)
    _descend(q, reference, low, high, ease, bones, aim, wants, weights, 60, False)
    sharp = np.zeros(4)
    sharp[0] = 1000.0
    _descend(q, reference, low, high, ease, bones, aim, wants, sharp, 25, True)
    return q


@numba.njit(cache=True, nogil=True, error_model="numpy")
def settle_pose(reference, low, high, ease, bones, aim, wants, weights):
    """As `reach_pose`, but the place, too, is met only as well as the rest allows."""
    q = np.minimum(np.maximum(reference, low), high)
    _descend(q, reference, low, high, ease, bones, aim, wants, weights, 80, False)
    return q


@numba.njit(cache=True, nogil=True, error_model="numpy")
def follow_points(angles, low, high, ease, bones, points, shares):
    """Angles (n, 14) changed so that the hand goes a share of the way to a point; trunk angles stay.

    A fixed number of shortest steps, so that the result is as smooth as its arguments.
    """
    out = angles.copy()
    n = angles.shape[1]
    R, p, elbow, other = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    J, C = np.zeros((3, n)), np.empty((3, 3))
    for f in range(len(angles)):
        if shares[f] <= 0.0:
            continue
        q = out[f]
        _pose(q, bones, R, p, elbow)
        target = p + shares[f] * (points[f] - p)
        for _ in range(6):
            for j in range(TRUNK, n):
                keep = q[j]
                q[j] = keep + 1e-6
                _pose(q, bones, R, other, elbow)
                q[j] = keep
                for i in range(3):
                    J[i, j] = (other[i] - p[i]) * 1e6
            for a in range(3):
                for b in range(3):
                    C[a, b] = 2e-3 if a == b else 0.0
                    for j in range(TRUNK, n):
                        C[a, b] += J[a, j] * J[b, j] * ease[j] ** 2
            v = np.linalg.solve(C, target - p)
            for j in range(TRUNK, n):
                move = ease[j] ** 2 * (J[0, j] * v[0] + J[1, j] * v[1] + J[2, j] * v[2])
                q[j] = min(max(q[j] + min(max(move, -0.5), 0.5), low[j]), high[j])
            _pose(q, bones, R, p, elbow)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def point_rates(q, bones, aim):
    """(3, 14): how a point of the hand moves with each angle."""
    n = len(q)
    R, p, elbow = np.empty((3, 3)), np.empty(3), np.empty(3)
    J = np.empty((3, n))
    q = q.copy()
    for j in range(n):
        keep = q[j]
        q[j] = keep + 1e-6
        _pose(q, bones, R, p, elbow)
        for i in range(3):
            J[i, j] = p[i] + R[i, 0] * aim[0] + R[i, 1] * aim[1] + R[i, 2] * aim[2]
        q[j] = keep - 1e-6
        _pose(q, bones, R, p, elbow)
        for i in range(3):
            J[i, j] = (J[i, j] - (p[i] + R[i, 0] * aim[0] + R[i, 1] * aim[1] + R[i, 2] * aim[2])) * 5e5
        q[j] = keep
    return J


@numba.njit(cache=True, nogil=True, error_model="numpy")
def hands(angles, bones):
    """Rotation (n, 3, 3) and position (n, 3) of the hand in the pelvis' frame."""
    R, p, elbow = np.empty((len(angles), 3, 3)), np.empty((len(angles), 3)), np.empty(3)
    for f in range(len(angles)):
        _pose(angles[f], bones, R[f], p[f], elbow)
    return R, p


@numba.njit(cache=True, nogil=True, error_model="numpy")
def joint_rotations(angles):
    """R_parent_from_joint (n, 8, 3, 3) of the chain's joints."""
    R = np.zeros((len(angles), 8, 3, 3))
    for f in range(len(angles)):
        for joint in range(8):
            for i in range(3):
                R[f, joint, i, i] = 1.0
            _turn_joint(R[f, joint], joint, angles[f])
    return R


def inner_limits() -> tuple[np.ndarray, np.ndarray]:
    """Limits that leave the margin free."""
    span = MARGIN * (HIGHEST - LOWEST)
    return LOWEST + span, HIGHEST - span


def within_limits(angles: np.ndarray) -> np.ndarray:
    """Angles (..., 14) eased into the limits: unchanged inside of the margin, never beyond it, smooth between."""
    low, high = inner_limits()
    room = HIGHEST - high
    over = np.maximum(angles - high, 0.0) - np.maximum(low - angles, 0.0)
    return np.clip(angles, low, high) + room * np.tanh(over / room)


def mirrored(angles: np.ndarray) -> np.ndarray:
    """The same arm's angles (..., 14) seen with the trunk of the mirror image."""
    return angles * np.array([1.0, -1.0, -1.0, *np.ones(ARM)])
