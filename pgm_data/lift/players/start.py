"""Where a fit starts: each frame's place and heading of a body of known shape."""

import cv2
import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.players.contact import ContactLaw, contact_probability
from pgm_data.lift.players.linkage import Linkage, Posture, placed
from pgm_data.lift.players.relabel import exchanged
from pgm_data.lift.players.sight import Sight

_HEADINGS = 16
_UPRIGHT = rotation_from_rotvec(np.array([np.pi / 2, 0.0, 0.0]))
"""R_world_from_root of one who stands upright and looks along -y: x stays, y becomes z, z becomes -y."""
_TURN_RATE = 8.0
"""rad/s that headings change by readily."""
_LYING_COSTS = 8.0
_SWAPPED_COSTS = 8.0
_STANDING_M = 0.25
"""How far the template's soles may be off the ground."""
_POSED_M = (0.05, 0.10)
"""How far points are off the template: at the trunk, and more by each joint between."""
_FEWEST = 4
_SETTLES = 6
"""Reweighted solutions of the places."""


def candidate_rotations() -> tuple[Float[np.ndarray, "candidates 3 3"], Float[np.ndarray, " candidates"]]:
    """R_world_from_root of people who stand, and who lie, facing every way; and what each costs."""
    heading = np.arange(_HEADINGS) * (2 * np.pi / _HEADINGS)
    turns = rotation_from_rotvec(np.stack([0 * heading, 0 * heading, heading], axis=-1))
    standing = turns @ _UPRIGHT
    lying = [turns[::2] @ rotation_from_rotvec(np.array(tilt)) @ _UPRIGHT for tilt in _TILTS]
    rotations = np.concatenate([standing, *lying])
    costs = np.full(len(rotations), _LYING_COSTS)
    costs[: len(standing)] = 0.0
    return rotations, costs


_TILTS = ((np.pi / 2, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0), (0.0, np.pi / 2, 0.0), (0.0, -np.pi / 2, 0.0))


def started(
    linkage: Linkage, sight: Sight, pairs: Int[np.ndarray, "pairs 2"], log_scale: float
) -> tuple[Posture, Sight]:
    """A posture a frame to start a fit from, and the sight with left and right told apart in every frame.

    Every frame tries headings of the posture of reference, each at its best place; the headings that agree with the
    points and with each other in time are kept, and places are interpolated where points are too few.
    """
    count = sight.seen.sum(axis=1)
    own = count >= _FEWEST
    rotations, extra = candidate_rotations()
    place, unary = _placed_candidates(linkage, sight, rotations, log_scale)
    swapped = np.zeros(unary.shape, dtype=bool)
    if len(pairs):
        # A network may take left for right all over; the heading must not follow it.
        other = exchanged(sight, pairs, np.ones((len(own), len(pairs)), dtype=bool))
        place_other, unary_other = _placed_candidates(linkage, other, rotations, log_scale)
        swapped = unary_other + _SWAPPED_COSTS < unary
        place = np.where(swapped[..., None], place_other, place)
        unary = np.where(swapped, unary_other + _SWAPPED_COSTS, unary)
    unary = unary + extra
    posed, pose_rotation, pose_cost = _pose_candidates(linkage, sight, log_scale)
    rotations = np.concatenate(
        [np.broadcast_to(rotations, (len(own), *rotations.shape)), pose_rotation[:, None]], axis=1
    )
    unary = np.concatenate([unary, pose_cost[:, None]], axis=1)
    place = np.concatenate([place, posed[:, None]], axis=1)
    unary = np.where(own[:, None], unary, 0.0)
    best = _smoothest(rotations, unary, sight.times)
    rows = np.arange(len(own))
    position, rotation = place[rows, best], rotations[rows, best]
    if len(pairs):
        flipped = np.append(swapped, np.zeros((len(own), 1), dtype=bool), axis=1)[rows, best] & own
        sight = exchanged(sight, pairs, np.repeat(flipped[:, None], len(pairs), axis=1))
    position = _settled(linkage, sight, rotation, position, log_scale)
    known = np.flatnonzero(own)
    if len(known):
        for axis in range(3):
            position[:, axis] = np.interp(sight.times, sight.times[known], position[known, axis])
        nearest = known[np.abs(sight.times[:, None] - sight.times[known]).argmin(axis=1)]
        rotation = rotation[nearest]
    angles = np.zeros((len(own), linkage.basis.shape[-1]))
    return Posture(position=position, rotation=rotation, angles=angles, log_scale=log_scale), sight


def _template(linkage: Linkage, rotations: np.ndarray, log_scale: float) -> np.ndarray:
    """Points off the root of the posture of reference, turned."""
    count = len(rotations)
    still = Posture(
        position=np.zeros((count, 3)),
        rotation=rotations,
        angles=np.zeros((count, linkage.basis.shape[-1])),
        log_scale=log_scale,
    )
    return placed(linkage, still, slopes=False)[0]


def _placed_candidates(linkage, sight: Sight, rotations: np.ndarray, log_scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Best place (frames, candidates, 3) and cost of the template in each turn; linear in the place."""
    template = _template(linkage, rotations, log_scale)
    shape, floor = template[:, : linkage.seen], template[:, linkage.seen :, 2].min(axis=1)
    loose = _POSED_M[0] + _POSED_M[1] * linkage.chain[: linkage.seen]
    # Rows (x r3 - r1) X = t1 - x t3, and those of y.
    R, t, xy = sight.R_cam_from_world, sight.t_cam_from_world, sight.xy
    rows = xy[..., None] * R[:, None, 2:3] - R[:, None, :2]
    want = t[:, None, :2] - xy * t[:, None, 2:3]
    weight = np.where(sight.seen, loose**-2, 0.0)
    normal = np.einsum("fpci,fp,fpcj->fij", rows, weight, rows)
    off = want[:, None] - np.einsum("fpci,kpi->fkpc", rows, shape)
    side = np.einsum("fpci,fp,fkpc->fki", rows, weight, off)
    normal[:, 2, 2] += _STANDING_M**-2
    side[..., 2] += -floor * _STANDING_M**-2
    normal = normal + 1e-6 * np.eye(3)
    place = np.einsum("fij,fkj->fki", np.linalg.inv(normal), side)
    miss = np.einsum("fpci,fki->fkpc", rows, place) - off
    square = np.sum(miss**2, axis=-1) * weight[:, None]
    cost = 2.5 * np.sum(np.log1p(square / 3.0), axis=-1) + 0.5 * ((place[..., 2] + floor) / _STANDING_M) ** 2
    return place, cost


def _settled(linkage, sight: Sight, rotations: np.ndarray, place: np.ndarray, log_scale: float) -> np.ndarray:
    """Places of the template in one turn a frame, strays among the points counting less and less."""
    template = _template(linkage, rotations, log_scale)
    shape, floor = template[:, : linkage.seen], template[:, linkage.seen :, 2].min(axis=1)
    loose = _POSED_M[0] + _POSED_M[1] * linkage.chain[: linkage.seen]
    R, t, xy = sight.R_cam_from_world, sight.t_cam_from_world, sight.xy
    rows = xy[..., None] * R[:, None, 2:3] - R[:, None, :2]
    off = t[:, None, :2] - xy * t[:, None, 2:3] - np.einsum("fpci,fpi->fpc", rows, shape)
    for _ in range(_SETTLES):
        miss = np.einsum("fpci,fi->fpc", rows, place) - off
        square = np.sum(miss**2, axis=-1) / loose**2
        weight = np.where(sight.seen, loose**-2 * 5.0 / (3.0 + square), 0.0)
        normal = np.einsum("fpci,fp,fpcj->fij", rows, weight, rows) + 1e-6 * np.eye(3)
        normal[:, 2, 2] += _STANDING_M**-2
        side = np.einsum("fpci,fp,fpc->fi", rows, weight, off)
        side[:, 2] -= floor * _STANDING_M**-2
        place = np.linalg.solve(normal, side[..., None])[..., 0]
    return place


def _pose_candidates(linkage, sight: Sight, log_scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place, R_world_from_root and cost of each frame's own perspective pose of the template; dear where there is none.

    SQPNP takes any pose, one who lies or dives as well as one who stands.
    """
    frames = len(sight.times)
    shape = _template(linkage, np.eye(3)[None], log_scale)[0, : linkage.seen]
    loose = _POSED_M[0] + _POSED_M[1] * linkage.chain[: linkage.seen]
    place = np.zeros((frames, 3))
    rotation = np.broadcast_to(np.eye(3), (frames, 3, 3)).copy()
    cost = np.full(frames, 1e6)
    for frame in range(frames):
        use = sight.seen[frame]
        if use.sum() < 6:
            continue
        found = perspective_pose(shape[use], sight.xy[frame, use])
        if found is None:
            continue
        R_cam_from_root, t_cam_from_root = found
        R, t = sight.R_cam_from_world[frame], sight.t_cam_from_world[frame]
        rotation[frame] = R.T @ R_cam_from_root
        place[frame] = R.T @ (t_cam_from_root - t)
        cam = shape[use] @ R_cam_from_root.T + t_cam_from_root
        miss = cam[:, :2] - sight.xy[frame, use] * cam[:, 2:]
        square = np.sum(miss**2, axis=-1) / loose[use] ** 2
        cost[frame] = 2.5 * np.sum(np.log1p(square / 3.0)) + _LYING_COSTS
    return place, rotation, cost


def perspective_pose(
    shape: Float[np.ndarray, "points 3"], xy: Float[np.ndarray, "points 2"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]] | None:
    """R_cam_from_shape and t_cam_from_shape of a rigid shape seen at normalised image coordinates, by SQPNP.

    None where no pose is found in front of the camera.
    """
    try:
        fine, turn, move = cv2.solvePnP(
            np.ascontiguousarray(shape), np.ascontiguousarray(xy), np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:
        return None
    if not fine or not np.isfinite(turn).all() or not np.isfinite(move).all():
        return None
    R, t = rotation_from_rotvec(np.asarray(turn, dtype=np.float64)[:, 0]), np.asarray(move, dtype=np.float64)[:, 0]
    return (R, t) if np.all(shape @ R[2] + t[2] > 0) else None


def _smoothest(rotations: np.ndarray, unary: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The candidate of each frame that costs least together with the turns between frames, by dynamic programming."""
    frames, count = unary.shape
    best = unary[0]
    came = np.zeros((frames, count), dtype=np.int64)
    for frame in range(1, frames):
        trace = np.einsum("kab,lab->kl", rotations[frame - 1], rotations[frame])
        angle = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
        free = _TURN_RATE * (times[frame] - times[frame - 1]) + 0.15
        through = best[:, None] + np.minimum((angle / free) ** 2, 200.0)
        came[frame] = through.argmin(axis=0)
        best = through[came[frame], np.arange(count)] + unary[frame]
    out = np.empty(frames, dtype=np.int64)
    out[-1] = best.argmin()
    for frame in range(frames - 1, 0, -1):
        out[frame - 1] = came[frame, out[frame]]
    return out


def first_contact(linkage: Linkage, sight: Sight, law: ContactLaw) -> Float[np.ndarray, "frames 2"]:
    """Probability of each foot to be planted, by how its lowest seen point moves over the ground.

    Pixels are taken to lie on the ground at the height of rest; what leaves it seems to run.
    """
    frames = len(sight.times)
    out = np.full((frames, 2), law.planted)
    for foot, point in enumerate(linkage.ankles):
        if point < 0:
            continue
        place, cov = _on_ground(sight, point)
        step = np.diff(sight.times)
        velocity = np.diff(place, axis=0) / step[:, None]
        out[:, foot] = contact_probability(
            law,
            height=np.full(frames, np.nan),
            height_var=np.zeros(frames),
            velocity=velocity,
            velocity_cov=(cov[1:] + cov[:-1]) / step[:, None, None] ** 2,
            times=sight.times,
        )
    return out


def _on_ground(sight: Sight, point: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a point's ray meets the level 0.1 m above the ground, and its covariance; NaN where it does not."""
    R, t = sight.R_cam_from_world, sight.t_cam_from_world
    centre = -np.einsum("fba,fb->fa", R, t)

    def met(xy: np.ndarray) -> np.ndarray:
        ray = np.einsum("fba,fb->fa", R, np.concatenate([xy, np.ones((len(xy), 1))], axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (0.1 - centre[:, 2]) / ray[:, 2]
        return np.where(far[:, None] > 0, centre[:, :2] + far[:, None] * ray[:, :2], np.nan)

    xy, sigma = sight.xy[:, point], sight.sigma[:, point]
    place = np.where(sight.seen[:, point, None], met(xy), np.nan)
    small = 1e-5
    J = np.stack([(met(xy + small * np.eye(2)[i]) - place) / small for i in (0, 1)], axis=-1)
    return place, sigma[:, None, None] ** 2 * J @ np.swapaxes(J, 1, 2)
