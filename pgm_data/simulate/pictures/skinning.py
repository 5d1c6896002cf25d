"""Moves a body's vertices with its joints and finds which of them its own limbs keep from the sun.

Joints blend as dual quaternions, so that elbows and twisted arms keep their width.
"""

import numba
import numpy as np

_kernel = numba.njit(cache=True, nogil=True, error_model="numpy")


@_kernel
def _quaternion(R, q):
    """Fills w, x, y, z of a rotation; Shepperd's method."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace >= R[0, 0] and trace >= R[1, 1] and trace >= R[2, 2]:
        q[0], q[1], q[2], q[3] = 1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        q[0], q[1] = R[2, 1] - R[1, 2], 1.0 + 2.0 * R[0, 0] - trace
        q[2], q[3] = R[1, 0] + R[0, 1], R[2, 0] + R[0, 2]
    elif R[1, 1] >= R[2, 2]:
        q[0], q[2] = R[0, 2] - R[2, 0], 1.0 + 2.0 * R[1, 1] - trace
        q[1], q[3] = R[1, 0] + R[0, 1], R[2, 1] + R[1, 2]
    else:
        q[0], q[3] = R[1, 0] - R[0, 1], 1.0 + 2.0 * R[2, 2] - trace
        q[1], q[2] = R[2, 0] + R[0, 2], R[2, 1] + R[1, 2]
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        q[k] /= length


@_kernel
def move(rest, rest_normals, joints, weights, rest_joints, R, t, vertices, normals):
    """Fills vertices and normals (V, 3) of a body whose joints have world rotations R (J, 3, 3) and places t (J, 3)."""
    count = R.shape[0]
    dual = np.empty((count, 8))
    for j in range(count):
        q = dual[j]
        _quaternion(R[j], q[:4])
        # World place of the rest pose's origin under this joint, halved and multiplied by the rotation.
        x = t[j, 0] - (R[j, 0, 0] * rest_joints[j, 0] + R[j, 0, 1] * rest_joints[j, 1] + R[j, 0, 2] * rest_joints[j, 2])
        y = t[j, 1] - (R[j, 1, 0] * rest_joints[j, 0] + R[j, 1, 1] * rest_joints[j, 1] + R[j, 1, 2] * rest_joints[j, 2])
        z = t[j, 2] - (R[j, 2, 0] * rest_joints[j, 0] + R[j, 2, 1] * rest_joints[j, 1] + R[j, 2, 2] * rest_joints[j, 2])
        q[4] = -0.5 * (x * q[1] + y * q[2] + z * q[3])
        q[5] = 0.5 * (x * q[0] + y * q[3] - z * q[2])
        q[6] = 0.5 * (y * q[0] + z * q[1] - x * q[3])
        q[7] = 0.5 * (z * q[0] + x * q[2] - y * q[1])
    b = np.empty(8)
    for i in range(rest.shape[0]):
        first = joints[i, 0]
        for k in range(8):
            b[k] = weights[i, 0] * dual[first, k]
        for m in range(1, joints.shape[1]):
            weight = weights[i, m]
            if weight == 0.0:
                continue
            q = dual[joints[i, m]]
            # Of the two quaternions of a rotation, the one on the first joint's side.
            if q[0] * dual[first, 0] + q[1] * dual[first, 1] + q[2] * dual[first, 2] + q[3] * dual[first, 3] < 0.0:
                weight = -weight
            for k in range(8):
                b[k] += weight * q[k]
        scale = 1.0 / np.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2] + b[3] * b[3])
        for k in range(8):
            b[k] *= scale
        w, x, y, z = b[0], b[1], b[2], b[3]
        tx = 2.0 * (w * b[5] - x * b[4] + y * b[7] - z * b[6])
        ty = 2.0 * (w * b[6] - x * b[7] - y * b[4] + z * b[5])
        tz = 2.0 * (w * b[7] + x * b[6] - y * b[5] - z * b[4])
        r00, r01, r02 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        r10, r11, r12 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        r20, r21, r22 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        px, py, pz = rest[i, 0], rest[i, 1], rest[i, 2]
        vertices[i, 0] = r00 * px + r01 * py + r02 * pz + tx
        vertices[i, 1] = r10 * px + r11 * py + r12 * pz + ty
        vertices[i, 2] = r20 * px + r21 * py + r22 * pz + tz
        px, py, pz = rest_normals[i, 0], rest_normals[i, 1], rest_normals[i, 2]
        normals[i, 0] = r00 * px + r01 * py + r02 * pz
        normals[i, 1] = r10 * px + r11 * py + r12 * pz
        normals[i, 2] = r20 * px + r21 * py + r22 * pz


@_kernel
def sunlit(vertices, centres, radii, towards_sun, share):
    """Fills the share of the sun (V) that balls, which stand for the body, let through to each vertex."""
    for i in range(vertices.shape[0]):
        left = 1.0
        for k in range(centres.shape[0]):
            x, y, z = centres[k, 0] - vertices[i, 0], centres[k, 1] - vertices[i, 1], centres[k, 2] - vertices[i, 2]
            ahead = x * towards_sun[0] + y * towards_sun[1] + z * towards_sun[2]
            r = radii[k]
            if ahead <= 0.0:
                continue
            far2 = x * x + y * y + z * z
            # A ball that the vertex lies on or in is its own limb.
            if far2 < 1.7 * r * r:
                continue
            beside2 = far2 - ahead * ahead
            if beside2 >= 1.44 * r * r:
                continue
            # Soft at the edge, over 0.7 to 1.2 radii.
            inside = min(max((1.2 - np.sqrt(beside2) / r) / 0.5, 0.0), 1.0)
            left *= 1.0 - inside * inside * (3.0 - 2.0 * inside)
        share[i] = left


@_kernel
def brighten(normals, colours, sun_share, lamp, towards_camera, rim, out):
    """Fills BGR (V, 3) of vertices under a light; `lamp` (4, 3): direction to the sun, sun, sky and ground colours."""
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        sun = (x * lamp[0, 0] + y * lamp[0, 1] + z * lamp[0, 2] + 0.25) / 1.25
        sun = max(sun, 0.0) * sun_share[i]
        up = 0.5 + 0.5 * z
        edge = 1.0 - min(abs(x * towards_camera[0] + y * towards_camera[1] + z * towards_camera[2]), 1.0)
        edge = rim * edge * edge * edge
        for k in range(3):
            bright = sun * lamp[1, k] + (up + edge) * lamp[2, k] + (1.0 - up) * lamp[3, k]
            out[i, k] = min(colours[i, k] * bright, 255.0)
