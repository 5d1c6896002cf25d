"""A player's skeleton registered to the calibrated camera, jointly over a clip."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pgm_data.geometry.camera import project
from pgm_data.geometry.rigid import rotvec_from_rotation
from pgm_data.lift.camera_doubt import CameraDoubt
from pgm_data.lift.players.banded import covariance_blocks
from pgm_data.lift.players.box_root import box_roots
from pgm_data.lift.players.camera_errors import build_cov, doubted_cov
from pgm_data.lift.players.fit import Case, descended, equations_of, judged_contact, with_contact
from pgm_data.lift.players.linkage import Linkage, Posture, linked, parameters, placed, rotvecs
from pgm_data.lift.players.options import RegisterOptions, register_options
from pgm_data.lift.players.relabel import relabelled
from pgm_data.lift.players.segments import Knots, knots_of
from pgm_data.lift.players.sight import Sight, limb_pairs, mirror_pairs, sight_of
from pgm_data.lift.players.solution import PlayerMotion
from pgm_data.lift.players.stance import REST_HEIGHT_M, bounds, strays, waiting
from pgm_data.lift.players.start import first_contact, started
from pgm_data.lift.players.terms import GroundLaw, Prior, reprojected
from pgm_data.lift.players.view import PlayerView
from pgm_data.skeleton import Skeleton

__all__ = ["RegisterOptions", "register_options", "register_player"]

_STRAY_STDS = 6.0
"""A point further off than this does not support its frame."""
_BUILD_STD_M = 0.018
"""How much higher or lower people stand on their feet than the skeleton in the same posture."""
_WIDE = 12.0
"""How much wider the ground's law is at first than at last."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fitted:
    """A fit of the knots."""

    posture: Posture
    contact: np.ndarray
    root_cov: np.ndarray
    scale_std: float
    supported: np.ndarray
    """Whether a knot's own points support it."""


def register_player(
    name: str,
    view: PlayerView,
    *,
    skeleton: Skeleton,
    height_m: float,
    doubt: CameraDoubt,
    options: RegisterOptions,
) -> PlayerMotion:
    """The player in the world: joints where points are seen, the root alone where no more than a box is known.

    Args:
        name: Player object of the scene.
        view: The player in the pictures.
        skeleton: Whose joints are wanted.
        height_m: How tall people of this sport are.
        doubt: How far the camera may be off.
        options: How to fit.

    Raises:
        ValueError: If the view has a point that the skeleton does not know.
    """
    linkage = linked(skeleton, view.point_names, waiting(skeleton))
    size = height_m / REST_HEIGHT_M
    motion = _from_boxes(name, view, skeleton, size, doubt, options)
    found = np.isfinite(view.points_px).all(axis=-1) & view.has_camera[:, None] & ~view.is_duplicate[:, None]
    anchors = found.sum(axis=1) >= options.fewest_points
    if not anchors.any():
        return motion
    knots = knots_of(view, anchors=anchors, longest_gap_s=options.longest_gap_s, finest_s=options.finest_s)
    sight = sight_of(view, knots.frames, pixel_std=doubt.pixel_std, limbs=limb_pairs(linkage, view.point_names))
    sight = replace(sight, times=knots.clock)
    pairs = np.array(mirror_pairs(view.point_names), dtype=np.int64).reshape(-1, 2)
    fitted = _fitted(linkage, sight, pairs, float(np.log(size)), options)
    return _written(motion, view, knots, linkage, fitted, doubt)


def _fitted(linkage: Linkage, sight: Sight, pairs: np.ndarray, log_scale: float, options: RegisterOptions) -> _Fitted:
    low, high = bounds(linkage)
    posture, sight = started(linkage, sight, pairs, log_scale)
    case = Case(
        linkage=linkage,
        sight=sight,
        prior=Prior(strays=strays(linkage), low=low, high=high, log_scale=log_scale),
        motion=options.motion,
        ground=_widened(options.ground, _WIDE),
        contact=first_contact(linkage, sight, options.contact),
    )
    posture = descended(case, posture, steps=options.first_steps, tolerance=options.tolerance)
    for turn in range(1, options.rounds + 1):
        points = placed(linkage, posture, slopes=False)[0]
        sight = relabelled(linkage, sight, points, pairs, freedom=options.motion.point_freedom)
        contact = judged_contact(case, posture, options.contact)
        case = replace(case, sight=sight)
        case = with_contact(case, contact, _widened(options.ground, _WIDE ** (1.0 - turn / options.rounds)))
        posture = descended(case, posture, steps=options.steps, tolerance=options.tolerance)
    equations, _ = equations_of(case, posture)
    cov, _, shared = covariance_blocks(equations)
    residual, _, count = reprojected(linkage, sight, placed(linkage, posture, slopes=False)[0])
    near = count & (np.linalg.norm(residual, axis=-1) < _STRAY_STDS)
    return _Fitted(
        posture=posture,
        contact=case.contact,
        root_cov=cov[:, :3, :3],
        scale_std=float(np.sqrt(shared[0, 0]) * np.exp(posture.log_scale)),
        supported=near.sum(axis=1) >= options.fewest_points,
    )


def _widened(ground: GroundLaw, by: float) -> GroundLaw:
    """A law that feet may break by so many times as much."""
    return replace(
        ground, height_m=by * ground.height_m, slide_m=by * ground.slide_m, flat_m=max(0.01 * by, ground.flat_m)
    )


def _from_boxes(
    name: str, view: PlayerView, skeleton: Skeleton, size: float, doubt: CameraDoubt, options: RegisterOptions
) -> PlayerMotion:
    """The root by the boxes alone."""
    frames, joints = len(view.times), len(skeleton.parents)
    height = float(size * skeleton.rest_translations[0, 1])
    root, cov = box_roots(view, pelvis_height_m=height, bottom_std_share=options.box_std_share)
    there = np.asarray(np.isfinite(root).all(axis=1))
    rows = np.flatnonzero(there)
    cov[rows] += doubted_cov(view.camera, doubt, root[rows], rows)
    status = np.where(there, np.where(view.is_duplicate, "filled", "measured"), "none").astype(object)
    unknown = np.full((frames, joints, 3), np.nan)
    return PlayerMotion(
        name=name,
        root_position=root,
        joints=unknown,
        joint_rotations=unknown,
        joint_translations=unknown,
        root_cov=cov,
        contact=np.full((frames, 2), np.nan),
        reprojection_px=np.full(frames, np.nan),
        status=status,
        scale=float("nan"),
        scale_std=float("nan"),
        said=_why_nothing(view, there),
    )


def _why_nothing(view: PlayerView, there: np.ndarray) -> str:
    """Why no skeleton was fitted, and where the root comes from."""
    if not view.has_camera.any():
        return "no frame has a camera"
    found = np.isfinite(view.points_px).all(axis=-1).any()
    if there.any():
        return "too few points in every frame: root by the boxes" if found else "no points: root by the boxes"
    return "too few points in every frame, and no boxes" if found else "neither points nor boxes"


def _between(posture: Posture, knots: Knots, frames: np.ndarray) -> Posture:
    """The posture at frames of the clip, interpolated between knots."""
    a = knots.source[frames]
    b = np.minimum(a + 1, len(knots.frames) - 1)
    b = np.where(knots.share[frames] > 0, b, a)
    part = knots.share[frames][:, None]
    turn = rotvec_from_rotation(posture.rotation[b] @ np.swapaxes(posture.rotation[a], 1, 2))
    return Posture(
        position=posture.position[a] + part * (posture.position[b] - posture.position[a]),
        rotation=Rotation.from_rotvec(part * turn).as_matrix() @ posture.rotation[a],
        angles=posture.angles[a] + part * (posture.angles[b] - posture.angles[a]),
        log_scale=posture.log_scale,
    )


def _written(
    motion: PlayerMotion, view: PlayerView, knots: Knots, linkage: Linkage, fitted: _Fitted, doubt: CameraDoubt
) -> PlayerMotion:
    """The motion with the fit in the frames that it reaches."""
    rows = np.flatnonzero(knots.source >= 0)
    posture = _between(fitted.posture, knots, rows)
    _, joints, translations = parameters(linkage, posture)
    rotations = rotvecs(linkage, posture)
    rotations[:, 0] = rotvec_from_rotation(posture.rotation)
    a = knots.source[rows]
    b = np.where(knots.share[rows] > 0, np.minimum(a + 1, len(knots.frames) - 1), a)
    part = knots.share[rows]
    contact = fitted.contact[a] + part[:, None] * (fitted.contact[b] - fitted.contact[a])
    cov = (
        np.maximum(fitted.root_cov[a], 0) * 0
        + fitted.root_cov[a]
        + part[:, None, None] * (fitted.root_cov[b] - fitted.root_cov[a])
    )
    seen_camera = rows[view.has_camera[rows]]
    inside = view.has_camera[rows]
    cov[inside] += doubted_cov(view.camera, doubt, posture.position[inside], seen_camera)
    cov[inside] += build_cov(view.camera, posture.position[inside], seen_camera, height_std=_BUILD_STD_M)
    points = placed(linkage, posture, slopes=False)[0][:, : linkage.seen]
    miss, close = _misses(view, rows, points)
    found = np.isfinite(miss)
    with np.errstate(invalid="ignore"):
        reprojection = np.sqrt(np.sum(np.where(found, miss, 0.0) ** 2, axis=1) / found.sum(axis=1))
    supported = close.sum(axis=1) >= 4
    supported &= ~view.is_duplicate[rows]
    status = np.where(supported, "measured", "filled")

    def put(old: np.ndarray, new: np.ndarray) -> np.ndarray:
        out = np.array(old)
        out[rows] = new
        return out

    return replace(
        motion,
        root_position=put(motion.root_position, posture.position),
        joints=put(motion.joints, joints),
        joint_rotations=put(motion.joint_rotations, rotations),
        joint_translations=put(motion.joint_translations, translations),
        root_cov=put(motion.root_cov, 0.5 * (cov + np.swapaxes(cov, 1, 2))),
        contact=put(motion.contact, contact),
        reprojection_px=put(motion.reprojection_px, reprojection),
        status=put(motion.status, status),
        scale=float(np.exp(fitted.posture.log_scale)),
        scale_std=fitted.scale_std,
        said="",
    )


def _misses(view: PlayerView, rows: np.ndarray, points_world: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances in pixels of the points found, NaN of others, and which are close enough to support their frame."""
    pixels, _ = project(view.camera[rows], points_world)
    miss = np.linalg.norm(pixels - view.points_px[rows], axis=-1)
    return miss, miss < _STRAY_STDS * np.sqrt(2.0) * np.where(np.isfinite(miss), view.sigma_px[rows], 1.0)
