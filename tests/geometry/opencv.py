"""OpenCV's own undistortion, iterated to the end, in its version 4 and 5."""

import cv2
import numpy as np

TO_THE_END = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)


def undistorted(points: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """Normalised undistorted coordinates of the (N, 2) pixels."""
    if hasattr(cv2, "undistortPointsIter"):
        return cv2.undistortPointsIter(points[:, None], K, distortion, np.eye(3), np.eye(3), TO_THE_END)[:, 0]
    return cv2.undistortPoints(points[:, None], K, distortion, R=np.eye(3), P=np.eye(3), criteria=TO_THE_END)[:, 0]
