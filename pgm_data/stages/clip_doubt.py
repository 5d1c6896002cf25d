"""What a clip says of its own calibration, as the solvers that build on it take it into account."""

from typing import Any

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.lift.camera_doubt import CameraDoubt


def camera_doubt(clip: ClipCamera, document: dict[str, Any]) -> CameraDoubt:
    """How far off the clip's cameras may be, by what its calibration says of itself."""
    has = clip.has_camera
    if not has.any():
        return CameraDoubt(position_cov=np.zeros((3, 3)), focal_std_share=0.0, pixel_std=0.0)
    cov = clip.position_cov[has]
    cov = np.nan_to_num(np.median(cov[np.isfinite(cov).all(axis=1)], axis=0)) if np.isfinite(cov).any() else np.zeros(6)
    focal = clip.focal_std_px[has] / clip.camera.K[has, 0, 0]
    jitter = (document.get("camera") or {}).get("jitter_px")
    return CameraDoubt(
        position_cov=cov[np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])],
        focal_std_share=float(np.median(focal[np.isfinite(focal)])) if np.isfinite(focal).any() else 0.0,
        pixel_std=float(jitter) if jitter is not None else 0.0,
    )
