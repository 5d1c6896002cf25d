"""The solver's projection against the geometry package, OpenCV and automatic differentiation."""

import casadi
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.geometry import camera as geometry
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.court_camera import PARAMETERS, CourtCamera, project, project_with_jacobian, step


def looking_at_court(position, focal=2500.0, radial=0.03, pan=0.0, roll=0.0):
    """A camera at the position that looks at the court's centre, but for a pan and a roll (rad)."""
    forward = -np.asarray(position, float)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    R = rotation_from_rotvec(np.array([0.0, pan, roll])) @ R
    return CourtCamera(
        R_cam_from_world=R,
        focal_px=np.array(focal),
        position_world=np.asarray(position, float),
        radial=np.array(radial),
        principal_px=np.array([959.5, 539.5]),
        half_diagonal_px=float(np.hypot(1920, 1080) / 2),
    )


court_cameras = st.builds(
    looking_at_court,
    st.tuples(st.floats(-6, 6), st.floats(-53, -20), st.floats(4, 20)),
    st.floats(700, 9000),
    st.floats(-0.05, 0.08),
    st.floats(-0.15, 0.15),
    st.floats(-0.05, 0.05),
)
points = np.array([[-5.46, -11.8, 0], [5.46, 11.8, 0], [0, 0, 0.914], [-4.1, 6.4, 0], [4.1, -6.4, 0], [6.4, 0, 1.07]])


@given(court_cameras)
def test_projection_equals_the_geometry_package(camera):
    expected, seen = geometry.project(camera.as_camera(), points)
    found = project(camera, points)
    np.testing.assert_allclose(found[seen], expected[seen], atol=1e-7)


@given(court_cameras)
def test_projection_equals_opencv(camera):
    as_camera = camera.as_camera()
    expected, _ = cv2.projectPoints(
        points,
        cv2.Rodrigues(as_camera.R_cam_from_world)[0],
        as_camera.t_cam_from_world,
        as_camera.K,
        as_camera.distortion,
    )
    found = project(camera, points)
    seen = np.isfinite(found).all(axis=1)
    np.testing.assert_allclose(found[seen], expected[seen, 0], atol=1e-5)


def casadi_jacobian(camera, point):
    """The derivative of one pixel by the ten parameters, by CasADi's automatic differentiation."""
    d = casadi.SX.sym("d", PARAMETERS)
    w = d[:3]
    theta = casadi.sqrt(casadi.dot(w, w) + 1e-30)
    skew = casadi.skew(w)
    turn = casadi.SX.eye(3) + casadi.sin(theta) / theta * skew + (1 - casadi.cos(theta)) / theta**2 * skew @ skew
    R = turn @ casadi.SX(casadi.DM(camera.R_cam_from_world))
    cam = R @ (casadi.DM(point) - (casadi.DM(camera.position_world) + d[4:7]))
    f = float(camera.focal_px) * casadi.exp(d[3])
    k1 = (float(camera.radial) + d[7]) * (f / camera.half_diagonal_px) ** 2
    u, v = cam[0] / cam[2], cam[1] / cam[2]
    radial = 1 + k1 * (u**2 + v**2)
    pixel = casadi.vertcat(
        f * u * radial + float(camera.principal_px[0]) + d[8], f * v * radial + float(camera.principal_px[1]) + d[9]
    )
    return np.array(casadi.Function("J", [d], [casadi.jacobian(pixel, d)])(np.full(PARAMETERS, 1e-12)))


@pytest.mark.parametrize("pan", [0.0, 0.1])
def test_derivatives_equal_automatic_ones(pan):
    camera = looking_at_court((1.0, -35.0, 9.0), pan=pan, roll=0.02)
    _, J = project_with_jacobian(camera, points)
    for point, found in zip(points, J, strict=True):
        expected = casadi_jacobian(camera, point)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@given(court_cameras, st.integers(0, PARAMETERS - 1))
def test_a_step_moves_pixels_as_its_derivative_says(camera, column):
    delta = np.zeros(PARAMETERS)
    delta[column] = 1e-6
    pixels, J = project_with_jacobian(camera, points)
    moved = project(step(camera, delta), points) - project(step(camera, -delta), points)
    ok = np.isfinite(pixels).all(axis=1)
    np.testing.assert_allclose(moved[ok] / 2e-6, J[ok, :, column], rtol=1e-4, atol=1e-2)


def test_points_behind_the_camera_and_past_the_fold_are_nan():
    camera = looking_at_court((0.0, -30.0, 8.0), focal=800.0, radial=-0.15)
    assert np.isnan(project(camera, np.array([[0.0, -60.0, 0.0]]))).all()
    far_out = np.array([[-40.0, -25.0, 0.0]])
    assert np.isnan(project(camera, far_out)).all()
    assert np.isnan(geometry.project(camera.as_camera(), far_out)[0]).all()


def test_a_zoom_keeps_the_lens_term_over_the_half_diagonal():
    near, far = looking_at_court((0, -30.0, 8.0), focal=1500.0), looking_at_court((0, -30.0, 8.0), focal=3000.0)
    ratio = far.as_camera().distortion[0] / near.as_camera().distortion[0]
    assert ratio == pytest.approx(4.0)
