"""A first camera from a handful of rough points, or from a homography of the ground."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.lift.court_camera import CourtCamera


@dataclass(frozen=True, kw_only=True)
class FirstOptions:
    """Limits of a first camera."""

    inlier_px_per_width: float = 0.008
    """How far a point may lie off, as a share of the picture's longer side."""
    least_points: int = 5
    """Fewest points that may carry a camera."""
    focal_per_width: tuple[float, float] = (0.35, 12.0)
    """Least and greatest focal length over the picture's width."""


def focal_of_homography(
    pixel_from_ground: Float[np.ndarray, "*batch 3 3"], principal_px: Float[np.ndarray, " 2"]
) -> Float[np.ndarray, "*batch"]:
    """Focal length of the square-pixel camera behind a homography of the ground; NaN where there is none.

    Both of its constraints are linear in w = 1 / f^2: equal norms of the two ground axes (well posed for a camera on
    the court's long axis) and their orthogonality (well posed for skewed views). Least squares weighs them by how
    much they say.
    """
    shift = np.eye(3)
    shift[:2, 2] = -principal_px
    H = shift @ pixel_from_ground
    H = H / np.linalg.norm(H, axis=(-2, -1))[..., None, None]
    h1, h2 = H[..., 0], H[..., 1]
    a = np.stack([(h1[..., :2] ** 2).sum(-1) - (h2[..., :2] ** 2).sum(-1), 2 * (h1[..., :2] * h2[..., :2]).sum(-1)], -1)
    b = np.stack([h2[..., 2] ** 2 - h1[..., 2] ** 2, -2 * h1[..., 2] * h2[..., 2]], -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = (a * b).sum(-1) / (a * a).sum(-1)
        return np.where(w > 0, 1 / np.sqrt(np.where(w > 0, w, np.nan)), np.nan)


def pose_of_homography(
    pixel_from_ground: Float[np.ndarray, "3 3"], focal_px: float, principal_px: Float[np.ndarray, " 2"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Rotation cam_from_world and camera centre of a homography of the ground under a given focal length."""
    K_inverse = np.array(
        [[1 / focal_px, 0, -principal_px[0] / focal_px], [0, 1 / focal_px, -principal_px[1] / focal_px], [0, 0, 1]]
    )
    G = K_inverse @ pixel_from_ground
    G = G / np.sqrt(np.linalg.norm(G[:, 0]) * np.linalg.norm(G[:, 1]))
    if G[2, 2] < 0:  # The court's centre must lie in front of the camera.
        G = -G
    U, _, Vt = np.linalg.svd(np.column_stack([G[:, 0], G[:, 1], np.cross(G[:, 0], G[:, 1])]))
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return R, -R.T @ G[:, 2]


def camera_of_homography(
    pixel_from_ground: Float[np.ndarray, "3 3"], *, size: tuple[int, int], options: FirstOptions
) -> CourtCamera | None:
    """The square-pixel camera behind a homography of the ground; None where no plausible one exists."""
    principal = (np.array(size, dtype=float) - 1) / 2
    focal = float(focal_of_homography(pixel_from_ground, principal))
    low, high = (share * size[0] for share in options.focal_per_width)
    if not low < focal < high:
        return None
    R, position = pose_of_homography(pixel_from_ground, focal, principal)
    if not np.isfinite(position).all() or position[2] <= 0:
        return None
    return _court_camera(R, position, focal, size)


def camera_of_points(
    points_world: Float[np.ndarray, "points 3"],
    pixels: Float[np.ndarray, "points 2"],
    *,
    size: tuple[int, int],
    options: FirstOptions,
) -> tuple[CourtCamera, Bool[np.ndarray, " points"]] | None:
    """A camera that agrees with most of the points, and which points those are; None where none does.

    Coplanar points leave a robust pose with an unknown focal length degenerate (pycolmap's own estimate then fails or,
    worse, returns a wrong camera), so the focal length comes in closed form from a robust homography of the ground
    points; pycolmap then finds the pose of all points, net posts included, and refines the focal length.
    """
    import cv2
    import pycolmap

    seen = np.isfinite(pixels).all(axis=1)
    if seen.sum() < options.least_points:
        return None
    threshold = options.inlier_px_per_width * max(size)
    ground = seen & (points_world[:, 2] == 0)
    if ground.sum() < 4:
        return None
    principal = (np.array(size, dtype=float) - 1) / 2
    H, _ = cv2.findHomography(
        points_world[ground, :2], pixels[ground], cv2.RANSAC, threshold, maxIters=2000, confidence=0.999
    )
    if H is None:
        return None
    low, high = (share * size[0] for share in options.focal_per_width)
    closed = float(focal_of_homography(H, principal))
    guesses = [closed] if low < closed < high else []
    guesses += [g * size[0] for g in (1.2, 2.0, 3.2)]
    best: tuple[int, float, CourtCamera, np.ndarray] | None = None
    for guess in guesses:
        model = pycolmap.Camera(
            model="SIMPLE_PINHOLE",
            width=size[0],
            height=size[1],
            params=[guess, principal[0] + 0.5, principal[1] + 0.5],
        )
        estimation = pycolmap.AbsolutePoseEstimationOptions()
        estimation.estimate_focal_length = False
        estimation.ransac.max_error = threshold
        estimation.ransac.random_seed = 0
        refinement = pycolmap.AbsolutePoseRefinementOptions()
        refinement.refine_focal_length = True
        answer = pycolmap.estimate_and_refine_absolute_pose(
            pixels[seen] + 0.5, points_world[seen], model, estimation, refinement
        )
        if answer is None or not low < model.params[0] < high:
            continue
        pose = answer["cam_from_world"]
        R, t = pose.rotation.matrix(), pose.translation
        camera = _court_camera(R, -R.T @ t, float(model.params[0]), size)
        if camera.position_world[2] <= 0:
            continue
        from pgm_data.lift.court_camera import project

        error = np.linalg.norm(project(camera, points_world) - pixels, axis=1)
        inlier = seen & (np.nan_to_num(error, nan=np.inf) < threshold)
        score = (int(inlier.sum()), -float(np.sqrt(np.mean(error[inlier] ** 2))) if inlier.any() else -np.inf)
        if best is None or score > best[:2]:
            best = (*score, camera, inlier)
        if guess == closed and inlier.sum() >= 0.8 * seen.sum():
            break
    if best is None or best[0] < options.least_points:
        return None
    return best[2], best[3]


def _court_camera(R: np.ndarray, position: np.ndarray, focal: float, size: tuple[int, int]) -> CourtCamera:
    return CourtCamera(
        R_cam_from_world=R,
        focal_px=np.array(focal),
        position_world=position,
        radial=np.array(0.0),
        principal_px=(np.array(size, dtype=float) - 1) / 2,
        half_diagonal_px=float(np.hypot(*size) / 2),
    )
