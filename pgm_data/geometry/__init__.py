"""Frames, axes, units and names, stated once for the whole project.

World
    Metres, right-handed. Origin on the ground at the court centre under the net (table tennis: at
    the centre of the table's surface). x to the right and y away as the main broadcast camera sees
    it, z up.
Camera
    OpenCV axes: x right, y down, z forward. ``x_cam = R_cam_from_world @ x_world + t_cam_from_world``.
Pixels
    The CENTRE of the top-left pixel is (0, 0), as in OpenCV. COLMAP and nerfstudio put it at
    (0.5, 0.5): `pgm_data.geometry.camera.K_with_corner_origin` and `K_with_centre_origin` are the only border.
Intrinsics
    ``K`` is 3x3 in pixels; ``distortion`` is OpenCV's (k1, k2, p1, p2), dimensionless, zero where
    the scene does not need it.
Time
    Seconds.
Rotation
    3x3 matrices, or axis-angle vectors in radians (`rigid.rotation_from_rotvec`).

A transform is named ``result_from_source`` so that products cancel; points end in their frame
(``_world``, ``_cam``) and image quantities in ``_px``. Everything is float64.
"""
