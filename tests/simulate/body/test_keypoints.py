"""Keypoints sit on the drawn body, and the hull's box is the drawn body's box."""

import numpy as np
import pytest

from pgm_data.simulate.body.figure import Figure, draw_figure, smpl24, world_from_joints
from pgm_data.simulate.body.keypoints import hull, keypoints17
from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.pictures.body_mesh import SUNNY, build_body, drawn_body, posed
from pgm_data.simulate.pictures.loft import BODY
from pgm_data.simulate.pictures.looks import draw_look
from pgm_data.simulate.pictures.raster import Mesh, draw_triangles
from pgm_data.simulate.rotations import about, facing, from_axis_angle
from pgm_data.simulate.views import View, framed_pose

NAMES = smpl24().joint_names
SIZE = (700, 700)


def _posture(rng: np.random.Generator, figure: Figure, width: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """World rotations and places of a posture by lot: limbs swung, knees and elbows bent the way they bend."""
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    R[0, 0] = facing(rng.uniform(-np.pi, np.pi))
    for side, sign in (("L_", 1.0), ("R_", -1.0)):
        R[0, NAMES.index(side + "Hip")] = about(0, width * rng.uniform(-1.3, 0.5)) @ about(
            2, sign * rng.uniform(0, 0.4)
        )
        R[0, NAMES.index(side + "Knee")] = about(0, width * rng.uniform(0.0, 1.7))
        R[0, NAMES.index(side + "Shoulder")] = about(1, width * sign * rng.uniform(-1.2, 0.4)) @ about(
            2, width * sign * rng.uniform(-1.3, 1.2)
        )
        R[0, NAMES.index(side + "Elbow")] = about(1, -sign * width * rng.uniform(0.0, 2.2))
        R[0, NAMES.index(side + "Wrist")] = from_axis_angle(width * rng.uniform(-0.4, 0.4, 3))
    for name in ("Torso", "Spine", "Neck", "Head"):
        R[0, NAMES.index(name)] = from_axis_angle(width * rng.uniform(-0.25, 0.25, 3))
    return world_from_joints(figure, np.array([[0.0, 0.0, figure.translations[0, 1]]]), R)


def _view(height: float) -> View:
    return framed_pose(
        centre_world=np.array([0.5, -14.0, height]),
        aim_world=np.array([0.0, 0.0, 1.0]),
        aim_px=(350.0, 350.0),
        roll=0.0,
        focal_px=3000.0,
        principal_px=(349.5, 349.5),
        k=0.0,
    ).view(SIZE)


def _pixels(view: View, points: np.ndarray) -> np.ndarray:
    return pixels_of(points, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)


@pytest.mark.parametrize("seed", range(10))
def test_the_hulls_box_is_the_drawn_bodys(seed: int) -> None:
    rng = np.random.default_rng(seed)
    figure = draw_figure(rng, "left" if seed % 2 else "right")
    body = build_body(figure, draw_look(rng, "player", white=False), racket=True)
    R, t = _posture(rng, figure)
    view = _view(float(rng.uniform(2.0, 10.0)))
    whole = drawn_body(body, R[0], t[0], SUNNY, view.centre_world)
    person = Mesh(vertices=whole.vertices, triangles=whole.triangles[body.labels == BODY], colours=whole.colours)
    sprite = draw_triangles(person, view, SIZE, 1)
    assert sprite is not None
    rows, columns = np.flatnonzero(sprite.alpha.any(axis=1)), np.flatnonzero(sprite.alpha.any(axis=0))
    low = np.array([sprite.x0 + columns[0], sprite.y0 + rows[0]]) - 0.5
    high = np.array([sprite.x0 + columns[-1], sprite.y0 + rows[-1]]) + 0.5
    centres, radii = hull(figure, R, t)
    depth = (centres[0] @ view.R_cam_from_world.T + view.t_cam_from_world)[:, 2]
    px, reach = _pixels(view, centres[0]), (view.K[0, 0] * radii / depth)[:, None]
    allowed = 0.03 * (high[1] - low[1])
    assert np.abs((px - reach).min(axis=0) - low).max() < allowed
    assert np.abs((px + reach).max(axis=0) - high).max() < allowed


@pytest.mark.parametrize("seed", range(6))
def test_keypoints_of_the_face_lie_on_the_drawn_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    figure = draw_figure(rng, "right")
    body = build_body(figure, draw_look(rng, "player", white=False), racket=False)
    R, t = _posture(rng, figure)
    vertices, _ = posed(body, R[0], t[0])
    points = keypoints17(figure, R, t)[0]
    for point in points[:5]:
        assert np.linalg.norm(vertices - point, axis=1).min() < 0.015
    head = NAMES.index("Head")
    local = (points[:5] - t[0, head]) @ R[0, head]
    assert local[0, 2] > local[1, 2] > local[3, 2]
    assert local[1, 0] > 0 > local[2, 0] and local[3, 0] > 0 > local[4, 0]


def test_keypoints_of_the_limbs_are_their_joints_in_cocos_order() -> None:
    rng = np.random.default_rng(2)
    figure = draw_figure(rng, "right")
    R, t = (np.concatenate([a, a + 0.0]) for a in _posture(rng, figure))
    t[1] += [1.0, 2.0, 0.0]
    points = keypoints17(figure, R, t)
    assert points.shape == (2, 17, 3)
    assert np.allclose(points[1] - points[0], [1.0, 2.0, 0.0])
    expected = {
        "left_shoulder": "L_Shoulder",
        "right_elbow": "R_Elbow",
        "left_wrist": "L_Wrist",
        "right_ankle": "R_Ankle",
    }
    for name, joint in expected.items():
        assert np.allclose(points[:, smpl24().keypoint_names.index(name)], t[:, NAMES.index(joint)])


def test_the_hull_follows_the_body_rigidly() -> None:
    rng = np.random.default_rng(4)
    figure = draw_figure(rng, "left")
    R, t = _posture(rng, figure)
    turn, shift = facing(0.7) @ from_axis_angle(np.array([0.2, 0.1, -0.4])), np.array([3.0, -2.0, 0.5])
    centres, radii = hull(figure, R, t)
    moved, same = hull(figure, turn @ R, t @ turn.T + shift)
    assert np.allclose(moved, centres @ turn.T + shift)
    assert (radii == same).all() and (radii > 0.02).all()
