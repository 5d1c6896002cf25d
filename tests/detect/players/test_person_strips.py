from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.detect.players.person_strips import (
    FEET_ROW,
    NODE_PX,
    PERSON_PX,
    REACH_PX,
    ROWS,
    between_nodes,
    cut_strips,
    plan_strips,
    searched_ground,
    strip_maps,
)
from pgm_data.geometry.camera import Camera, meet_plane, project
from pgm_data.scene import load_scene

TENNIS = load_scene("tennis")
SIZE = (1280, 720)


def camera_at(centre, aim, focal=1500.0, k1=0.0) -> Camera:
    """A camera at a place that looks at another."""
    centre, aim = np.array(centre, dtype=float), np.array(aim, dtype=float)
    forward = (aim - centre) / np.linalg.norm(aim - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    return Camera(
        K=np.array([[focal, 0, 639.5], [0, focal, 359.5], [0, 0, 1.0]]),
        distortion=np.array([k1, 0.0, 0.0, 0.0]),
        R_cam_from_world=R,
        t_cam_from_world=-R @ centre,
    )


BROADCAST = camera_at([0.3, -38.0, 9.0], [0.0, -1.0, 0.0], focal=2100.0)
broadcasts = st.builds(
    lambda x, y, z, pan, focal, k1: camera_at([x, -y, z], [pan, -1.0, 0.0], focal, k1),
    st.floats(-6, 6),
    st.floats(26, 60),
    st.floats(4, 16),
    st.floats(-6, 6),
    st.floats(1000, 3000),
    st.floats(-0.1, 0.2),
)


@settings(max_examples=25)
@given(broadcasts, st.floats(-9.5, 9.5), st.floats(-19.5, 19.5))
def test_whoever_stands_in_the_picture_stands_near_the_ground_line_of_a_strip(camera, x, y):
    plan = plan_strips(camera, size=SIZE, scene=TENNIS)
    feet, head = project(camera, np.array([[x, y, 0.0], [x, y, 1.85]]))[0]
    if not (0 < feet[0] < SIZE[0] - 1 and 0 < feet[1] < SIZE[1] - 1 and head[1] > 0):
        return
    places = np.array([plan.place(np.array([x, y]), strip) for strip in range(len(plan.depths))])
    off = np.abs(places[:, 1] - FEET_ROW)
    nearest = int(off.argmin())
    half = plan.view.height * (np.sqrt(plan.depths[1] / plan.depths[0]) - 1.0) * plan.px_per_m
    assert off[nearest] < 1.01 * half  # half a step of depths
    assert half < 1.2 * REACH_PX
    assert -0.5 < places[nearest, 0] < plan.columns - 0.5


@settings(max_examples=25)
@given(broadcasts, st.floats(-9, 9), st.floats(-18, 18))
def test_a_place_on_the_ground_comes_back_from_its_pixel_in_any_strip(camera, x, y):
    plan = plan_strips(camera, size=SIZE, scene=TENNIS)
    for strip in (0, len(plan.depths) - 1):
        pixel = np.array([plan.place(np.array([x, y]), strip)])
        np.testing.assert_allclose(plan.ground(np.array([strip]), pixel), [[x, y]], atol=1e-6)


@settings(max_examples=25)
@given(broadcasts, st.floats(0, 1), st.floats(0, 1))
def test_the_ground_of_a_strips_pixel_is_what_the_camera_sees_there(camera, across, down):
    plan = plan_strips(camera, size=SIZE, scene=TENNIS)
    strip = np.array([len(plan.depths) // 2])
    pixel = np.array([[across * (plan.columns - 1), 40 + down * 39]])
    seen = project(camera, plan.world(strip, pixel))[0]
    np.testing.assert_allclose(meet_plane(camera, seen)[:, :2], plan.ground(strip, pixel), atol=1e-5)


def test_a_person_is_equally_tall_in_every_strip():
    plan = plan_strips(BROADCAST, size=SIZE, scene=TENNIS)
    for strip in range(len(plan.depths)):
        column = np.array([40.0, 40.0])
        _, up = plan.plane(np.array([strip, strip]), np.stack([column, [FEET_ROW, FEET_ROW - PERSON_PX]], axis=1))
        np.testing.assert_allclose(up, [0.0, TENNIS.person_height_m], atol=1e-12)


@settings(max_examples=25)
@given(broadcasts)
def test_maps_lead_to_where_the_camera_sees_the_plane(camera):
    plan = plan_strips(camera, size=SIZE, scene=TENNIS)
    maps = strip_maps(plan, camera)
    assert maps.shape == (len(plan.depths), ROWS, plan.columns, 2)
    rng = np.random.default_rng(0)
    strips = rng.integers(len(plan.depths), size=200)
    pixels = np.stack([rng.integers(plan.columns, size=200), rng.integers(ROWS, size=200)], axis=1).astype(float)
    exact = project(camera, plan.world(strips, pixels))[0]
    inside = ((exact > 0) & (exact < np.array(SIZE))).all(axis=1)
    found = maps[strips, pixels[:, 1].astype(int), pixels[:, 0].astype(int)]
    assert np.abs(found - exact)[inside].max(initial=0.0) < 0.3


def test_between_nodes_values_are_bilinear():
    nodes = np.random.default_rng(0).normal(size=(2, 4, 6, 2)) * 500
    found = between_nodes(nodes)
    for row, column in ((0, 0), (3, 11), (17, 39), (23, 5)):
        r, c = row / NODE_PX, column / NODE_PX
        i, j = int(r), int(c)
        part = nodes[:, i : i + 2, j : j + 2]
        rows = part[:, 0] * (1 - (r - i)) + part[:, 1] * (r - i)
        np.testing.assert_allclose(found[:, row, column], rows[:, 0] * (1 - (c - j)) + rows[:, 1] * (c - j), atol=1e-3)


def test_strips_show_the_picture_and_black_where_there_is_none():
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    picture = np.stack([40 + x / 8, 40 + y / 5, np.full(x.shape, 90)], axis=-1).astype(np.uint8)
    maps = strip_maps(plan_strips(BROADCAST, size=SIZE, scene=TENNIS), BROADCAST)
    strips = cut_strips(picture, maps)
    expected = np.stack([40 + maps[..., 0] / 8, 40 + maps[..., 1] / 5, np.full(maps.shape[:3], 90)], axis=-1)
    deep = ((maps > 8) & (maps < np.array(SIZE) - 9)).all(axis=-1)
    assert np.abs(strips[deep] - expected[deep]).max() < 2.5
    outside = ((maps < -9) | (maps > np.array(SIZE) + 9)).any(axis=-1)
    assert outside.any() and not strips[outside].any()


def test_a_strip_far_larger_in_the_picture_is_shrunk_without_stripes():
    camera = camera_at([0.0, -38.0, 9.0], [0.0, -8.0, 0.0], focal=9000.0)
    plan = plan_strips(camera, size=SIZE, scene=TENNIS)
    maps = strip_maps(plan, camera)
    checks = (np.indices((SIZE[1], SIZE[0])).sum(axis=0) % 2 * 255).astype(np.uint8)
    strips = cut_strips(np.repeat(checks[..., None], 3, axis=2), maps)
    deep = ((maps > 16) & (maps < np.array(SIZE) - 17)).all(axis=-1)
    assert deep.any() and np.abs(strips[deep].astype(float) - 127.5).max() < 20


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis", "blocks"])
def test_every_scene_says_where_people_are_looked_for(scene):
    low, high = searched_ground(load_scene(scene))
    assert (low < high).all()


def test_a_scene_that_does_not_say_where_people_may_be_is_refused():
    nowhere = replace(TENNIS, objects=(), court=None)
    with pytest.raises(ValueError, match="expected players with region_m, or a court"):
        plan_strips(BROADCAST, size=SIZE, scene=nowhere)


def test_cameras_that_go_round_have_strips_and_cameras_that_see_no_ground_none():
    blocks = load_scene("blocks")
    for angle in np.linspace(0, 2 * np.pi, 7):
        camera = camera_at([14 * np.cos(angle), 14 * np.sin(angle), 5.0], [0.0, 0.0, 0.5], focal=900.0)
        plan = plan_strips(camera, size=SIZE, scene=blocks)
        assert len(plan.depths) >= 3
        column, row = plan.place(np.array([0.0, 0.0]), int(np.abs(plan.depths - 14).argmin()))
        assert 0 < column < plan.columns and abs(row - FEET_ROW) < 2 * REACH_PX
    down = camera_at([0.0, -0.01, 30.0], [0.0, 0.0, 0.0])
    away = camera_at([0.0, -40.0, 9.0], [0.0, -80.0, 0.0])
    sky = camera_at([0.0, -40.0, 9.0], [0.0, -30.0, 30.0])
    for camera in (down, away, sky):
        assert plan_strips(camera, size=SIZE, scene=TENNIS) is None


def test_turned_pictures_are_upright_in_the_strips():
    # A camera that rolls by five degrees sees the same plane upright again.
    roll = np.radians(5.0)
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])
    rolled = replace(
        BROADCAST,
        R_cam_from_world=turn @ BROADCAST.R_cam_from_world,
        t_cam_from_world=turn @ BROADCAST.t_cam_from_world,
    )
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    ends = project(rolled, np.array([[2.0, 5.0, 0.0], [2.0, 5.0, 1.85]]))[0]
    cv2.line(picture, *(tuple(int(round(v)) for v in end) for end in ends), (255, 255, 255), 5)
    plan = plan_strips(rolled, size=SIZE, scene=TENNIS)
    strip = int(np.abs([plan.place(np.array([2.0, 5.0]), k)[1] - FEET_ROW for k in range(len(plan.depths))]).argmin())
    column, row = plan.place(np.array([2.0, 5.0]), strip)
    lit = cut_strips(picture, strip_maps(plan, rolled))[strip, :, :, 0] > 100
    columns = np.nonzero(lit)[1]
    assert abs(columns.mean() - column) < 1.0 and np.ptp(columns) <= 5
    rows = np.flatnonzero(lit.any(axis=1))
    assert abs(rows.max() - row) < 2.5 and abs(rows.min() - (row - PERSON_PX)) < 3.5
