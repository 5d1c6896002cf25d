"""Lines of other sports, drawn where there is no court of ours."""

from functools import cache

import cv2
import numpy as np
from jaxtyping import UInt8

from pgm_data.court import Court
from pgm_data.scene import load_scene
from pgm_models.detectors.court_frames import CourtFrame

OTHER_SCENES = ("badminton", "pickleball", "tabletennis")


@cache
def _courts(scenes: tuple[str, ...]) -> tuple[Court, ...]:
    found = (load_scene(scene).court for scene in scenes)
    return tuple(court for court in found if court is not None)


def draw_other_court(
    bgr: UInt8[np.ndarray, "height width 3"],
    seen: CourtFrame,
    rng: np.random.Generator,
    scenes: tuple[str, ...] = OTHER_SCENES,
) -> np.ndarray:
    """The picture with another sport's court drawn about where `seen` shows ours; as it was if `seen` shows none.

    The other court is stretched to the outline of ours, so that only the pattern of its lines tells them apart.
    """
    corners = outline(seen)
    if corners is None:
        return bgr
    court = _courts(scenes)[int(rng.integers(len(scenes)))]
    plan = court.points_world[:, :2]
    low, high = plan.min(axis=0), plan.max(axis=0)
    square = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    shaken = corners + rng.normal(0, 4, (4, 2))
    pixel_from_plan = cv2.getPerspectiveTransform(square.astype(np.float32), shaken.astype(np.float32))
    drawn = bgr.copy()
    if rng.random() < 0.6:
        cv2.fillConvexPoly(drawn, np.round(shaken).astype(np.int32), rng.uniform(0, 255, 3).tolist(), cv2.LINE_AA)
    colour = rng.uniform(170, 255) + rng.uniform(-40, 40, 3)
    thickness = int(rng.integers(1, 4))
    for ends in court.lines_world[:, :, :2]:
        pixels = cv2.perspectiveTransform(ends[None], pixel_from_plan)[0]
        if np.abs(pixels).max() < 4000:
            a, b = (tuple(np.round(p * 16).astype(int).tolist()) for p in pixels)
            cv2.line(drawn, a, b, colour.tolist(), thickness, cv2.LINE_AA, 4)
    return drawn


def outline(seen: CourtFrame) -> np.ndarray | None:
    """Pixels of the outer corners (near left, near right, far right, far left), or None where they are not seen."""
    ends = seen.lines_px[:, [0, -1]].reshape(-1, 2)
    if not np.isfinite(ends).all() or len(ends) < 4:
        return None
    x, y = ends[:, 0], ends[:, 1]
    corners = np.stack([ends[np.argmin(x - y)], ends[np.argmax(x + y)], ends[np.argmax(x - y)], ends[np.argmin(x + y)]])
    area = cv2.contourArea(corners.astype(np.float32))
    return corners if area > 400 and np.abs(corners).max() < 3000 else None
