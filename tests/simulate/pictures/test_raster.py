"""Triangles land where OpenCV projects them, cover what they cover, and hide what is behind them."""

import hashlib
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.simulate.pictures.raster import (
    Frame,
    Mesh,
    Sprite,
    Texture,
    blurred,
    darken,
    draw_triangles,
    hidden_by,
    over,
    packed,
    shadow,
)
from pgm_data.simulate.pictures.triangles import NEAR_M, look
from pgm_data.simulate.views import View, framed_pose

SIZE = (200, 120)


def _view(k: float = 0.0, focal: float = 260.0, centre: tuple = (0.5, -12.0, 4.0), roll: float = 0.1) -> View:
    return framed_pose(
        centre_world=np.array(centre),
        aim_world=np.array([0.0, 0.0, 0.5]),
        aim_px=(100.0, 60.0),
        roll=roll,
        focal_px=focal,
        principal_px=(101.3, 57.9),
        k=k,
    ).view(SIZE)


def _level() -> View:
    """At the origin, looking along +y; a pixel is 1 cm at 1 m."""
    return View(
        K=np.array([[100.0, 0.0, 100.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]]),
        k1=0.0,
        R_cam_from_world=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
        centre_world=np.zeros(3),
    )


def _at_px(view: View, px: np.ndarray, depth: float) -> np.ndarray:
    """World points that a camera without distortion sees at these pixels and depth."""
    rays = np.concatenate([px, np.ones((len(px), 1))], axis=1) @ np.linalg.inv(view.K).T
    return depth * rays @ view.R_cam_from_world + view.centre_world


def _opencv(points: np.ndarray, view: View) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(view.R_cam_from_world)
    lens = np.array([view.k1, 0.0, 0.0, 0.0])
    return cv2.projectPoints(points, rotation, view.t_cam_from_world, view.K, lens)[0][:, 0]


def _mesh(vertices: np.ndarray, triangles: np.ndarray, colour=(10.0, 20.0, 30.0), **more) -> Mesh:
    colours = np.tile(np.array(colour, np.float32), (len(vertices), 1))
    return Mesh(vertices=vertices, triangles=np.asarray(triangles), colours=colours, **more)


def _fan(count: int) -> np.ndarray:
    return np.array([[0, i, i + 1] for i in range(1, count - 1)])


def _whole(sprite: Sprite | None) -> np.ndarray:
    image = np.zeros((SIZE[1], SIZE[0]))
    if sprite is not None:
        tall, wide = sprite.alpha.shape
        image[sprite.y0 : sprite.y0 + tall, sprite.x0 : sprite.x0 + wide] = sprite.alpha
    return image


def _centroid(image: np.ndarray) -> np.ndarray:
    y, x = np.indices(image.shape)
    return np.array([(image * x).sum(), (image * y).sum()]) / image.sum()


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6), k=st.sampled_from([0.0, 0.05, -0.03]))
def test_vertices_land_where_opencv_projects_them(seed: int, k: float) -> None:
    view = _view(k)
    points = np.random.default_rng(seed).uniform([-4, -5, 0], [4, 8, 3], (30, 3))
    cam, px = np.empty((30, 3)), np.empty((30, 2))
    look(points, packed(view), cam, px)
    assert np.abs(px - _opencv(points, view)).max() < 1e-6
    assert np.abs(cam - (points @ view.R_cam_from_world.T + view.t_cam_from_world)).max() < 1e-9


@pytest.mark.parametrize("k", [0.0, 0.05])
@pytest.mark.parametrize("samples", [1, 2, 3, 4])
def test_a_disc_is_centred_on_its_projection(k: float, samples: int) -> None:
    view = _view(k)
    turn = np.linspace(0, 2 * np.pi, 80)[:-1]
    for centre in ([-1.3, 0.4, 0.2], [0.0, 3.0, 1.0], [1.9, -2.0, 0.7]):
        ring = np.stack([np.cos(turn), 0 * turn, np.sin(turn)], axis=-1) * 0.35 + centre
        corners = _opencv(ring, view).astype(np.float64)
        x, y = corners.T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        expected = np.array([((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()]) / (
            3 * cross.sum()
        )
        drawn = _whole(draw_triangles(_mesh(ring, _fan(len(ring))), view, SIZE, samples))
        assert np.abs(_centroid(drawn) - expected).max() < (0.05 if samples > 1 else 0.15)
        assert drawn.sum() == pytest.approx(abs(0.5 * cross.sum()), rel=0.03)


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 8])
def test_alpha_is_the_share_of_samples_behind_an_edge(samples: int) -> None:
    """Pixels reach half a pixel to each side of integers, samples lie in the middle of their cells."""
    view = _level()
    for edge in (50.0, 50.3, 50.49, 50.51, 51.0, 51.77):
        corners = np.array([[edge, 20.0], [edge, 90.0], [150.0, 90.0], [150.0, 20.0]])
        sprite = draw_triangles(_mesh(_at_px(view, corners, 2.0), _fan(4)), view, SIZE, samples)
        fine = (np.arange(samples) + 0.5) / samples - 0.5
        row = _whole(sprite)[50]
        for column in range(48, 55):
            assert row[column] == pytest.approx((column + fine >= edge - 1e-9).mean(), abs=1e-6)


def test_neighbours_leave_no_gap_and_nothing_is_covered_twice_in_the_mean() -> None:
    rng = np.random.default_rng(5)
    view = _level()
    inner = rng.uniform([40, 30], [160, 90], (60, 2))
    corners = np.array([[30.0, 20.0], [170.0, 20.0], [170.0, 100.0], [30.0, 100.0]])
    px = np.concatenate([corners, inner])
    triangulation = cv2.Subdiv2D((0, 0, 200, 120))
    for x, y in px:
        triangulation.insert((float(x), float(y)))
    triangles = []
    px32 = px.astype(np.float32)
    for t in triangulation.getTriangleList().reshape(-1, 3, 2):
        found = [np.flatnonzero((px32 == p).all(axis=1)) for p in t]
        if all(len(f) for f in found):
            triangles.append([int(f[0]) for f in found])
    sprite = draw_triangles(_mesh(_at_px(view, px32.astype(float), 3.0), np.array(triangles)), view, SIZE, 3)
    image = _whole(sprite)
    assert (image[35:86, 45:156] == 1.0).all()
    assert sprite is not None
    inside = sprite.alpha > 0
    assert np.allclose(sprite.bgr[inside], [10.0, 20.0, 30.0], atol=1e-4)
    assert np.allclose(sprite.depth[inside], 3.0, atol=1e-5)


def test_what_is_nearer_hides_what_is_behind_it_whatever_the_order() -> None:
    view = _level()
    square = np.array([[60.0, 30.0], [60.0, 80.0], [110.0, 80.0], [110.0, 30.0]])
    near = _mesh(_at_px(view, square + [20, 0], 2.0), _fan(4), (0, 0, 255), labels=np.full(2, 7, np.int16))
    far = _mesh(_at_px(view, square, 4.0), _fan(4), (0, 255, 0), labels=np.full(2, 3, np.int16))
    first, second = draw_triangles([near, far], view, SIZE, 2), draw_triangles([far, near], view, SIZE, 2)
    assert first is not None and second is not None and first.label is not None and second.label is not None
    for name in ("bgr", "alpha", "depth", "label"):
        assert (getattr(first, name) == getattr(second, name)).all()
    at = (50 - first.y0, 95 - first.x0)
    assert first.label[at] == 7 and first.depth[at] == pytest.approx(2.0) and first.bgr[at][2] == 255
    at = (50 - first.y0, 65 - first.x0)
    assert first.label[at] == 3 and first.depth[at] == pytest.approx(4.0)
    assert first.label[first.alpha == 0].tolist() == [-1] * int((first.alpha == 0).sum())


def test_triangles_that_pierce_each_other_meet_where_their_planes_do() -> None:
    view = _level()
    flat = _mesh(
        np.array([[-1.0, 3.0, -0.5], [1.0, 3.0, -0.5], [1.0, 3.0, 0.5], [-1.0, 3.0, 0.5]]), _fan(4), (255, 0, 0)
    )
    slant = _mesh(
        np.array([[-1.0, 2.0, -0.4], [1.0, 4.0, -0.4], [1.0, 4.0, 0.4], [-1.0, 2.0, 0.4]]), _fan(4), (0, 255, 0)
    )
    sprite = draw_triangles([flat, slant], view, SIZE, 1)
    assert sprite is not None
    row = sprite.bgr[60 - sprite.y0]
    green = np.flatnonzero(row[:, 1] > 128) + sprite.x0
    assert green.max() in (99, 100)  # both are 3 m away at x = 0, which is column 100


def test_texture_is_right_in_perspective() -> None:
    """A floor's squares are found at their projections, not at equal steps in the picture."""
    view = _level()
    floor = np.array([[-2.0, 1.5, -0.5], [2.0, 1.5, -0.5], [2.0, 9.5, -0.5], [-2.0, 9.5, -0.5]])
    checks = np.array([[[255.0, 255, 255], [0, 0, 0]], [[0, 0, 0], [255, 255, 255]]], np.float32)[None]
    texture = Texture(texels=checks, layers=np.zeros(2, np.int16), uv=floor[:, :2] / 2.0)
    sprite = draw_triangles(
        Mesh(vertices=floor, triangles=_fan(4), colours=np.ones((4, 3), np.float32), texture=texture), view, SIZE, 1
    )
    assert sprite is not None
    for x, y in [(-0.5, 2.5), (0.5, 2.5), (0.5, 3.4), (-1.5, 4.5), (1.4, 6.5)]:
        px = _opencv(np.array([[x, y, -0.5]]), view)[0]
        white = (int(np.floor(x)) + int(np.floor(y))) % 2 == 0
        value = sprite.bgr[int(round(px[1])) - sprite.y0, int(round(px[0])) - sprite.x0, 0]
        assert (value > 128) == white, (x, y)


def test_textures_interpolate_repeat_have_layers_holes_and_take_the_light() -> None:
    view = _level()
    corners = np.array([[50.0, 20.0], [50.0, 84.0], [114.0, 84.0], [114.0, 20.0]]) - 0.5
    world = _at_px(view, corners, 2.0)
    uv = np.array([[0.0, 0.0], [0.0, 2.0], [2.0, 2.0], [2.0, 0.0]])
    texels = np.zeros((2, 4, 4, 4), np.float32)
    texels[0] = 99.0
    texels[1, ..., 0] = np.arange(4) * 10.0
    texels[1, ..., 3] = 255.0
    texels[1, 0, :, 3] = 0.0
    half = np.full((4, 3), 0.5, np.float32)

    def drawn(smooth: bool) -> Sprite:
        texture = Texture(texels=texels, layers=np.ones(2, np.int16), uv=uv, smooth=smooth)
        sprite = draw_triangles(Mesh(vertices=world, triangles=_fan(4), colours=half, texture=texture), view, SIZE, 1)
        assert sprite is not None
        return sprite

    plain = drawn(False)
    assert np.allclose(plain.bgr[20, :64, 0], np.tile(np.repeat([0.0, 5.0, 10.0, 15.0], 8), 2), atol=1e-3)
    alpha = plain.alpha[:, :64]
    assert (alpha[:8] == 0).all() and (alpha[8:32] == 1).all() and (alpha[32:40] == 0).all()
    smooth = drawn(True)
    # Between texel centres at 4 and 12 the value rises evenly; 0.5 of the light is left.
    assert np.allclose(smooth.bgr[20, 4:12, 0], 0.5 * (np.arange(8) + 0.5) / 8 * 10.0, atol=1e-3)
    with pytest.raises(ValueError, match="3 or 4 channels"):
        Texture(texels=texels[..., :2], layers=np.ones(2, np.int16), uv=uv)


def test_half_transparent_triangles_cover_their_share_of_every_pixel() -> None:
    view = _level()
    square = _at_px(view, np.array([[60.0, 30.0], [60.0, 80.0], [110.0, 80.0], [110.0, 30.0]]), 2.0)
    for share, samples in ((0.25, 4), (1 / 3, 3), (0.0, 3), (1.0, 3)):
        sprite = draw_triangles(_mesh(square, _fan(4), opacity=np.full(2, share)), view, SIZE, samples)
        image = _whole(sprite)
        assert np.allclose(image[40:70, 70:100], round(share * samples**2) / samples**2)


def test_a_floor_that_runs_under_the_camera_is_cut_and_not_lost() -> None:
    view = replace(_level(), centre_world=np.array([0.0, 0.0, 1.0]))
    floor = _mesh(np.array([[-50.0, -40.0, 0.0], [50.0, -40.0, 0.0], [50.0, 60.0, 0.0], [-50.0, 60.0, 0.0]]), _fan(4))
    image = _whole(draw_triangles(floor, view, SIZE, 2))
    assert (image[63:] == 1.0).all()
    assert (image[:61] == 0.0).all()


def test_meshes_that_show_nothing_give_nothing() -> None:
    view = _level()
    square = np.array([[-0.5, -3.0, -0.5], [0.5, -3.0, -0.5], [0.5, -3.0, 0.5], [-0.5, -3.0, 0.5]])
    assert draw_triangles(_mesh(square, _fan(4)), view, SIZE, 2) is None
    assert draw_triangles(_mesh(square + [90.0, 6.0, 0.0], _fan(4)), view, SIZE, 2) is None
    assert draw_triangles(_mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64)), view, SIZE, 2) is None
    assert draw_triangles([], view, SIZE, 2) is None
    at_eye = _mesh(np.array([[0.0, 0.0, 0.0], [0.0, NEAR_M / 2, 0.0], [0.01, 0.0, 0.0]]), np.array([[0, 1, 2]]))
    assert draw_triangles(at_eye, view, SIZE, 2) is None
    image = np.zeros((120, 200, 3), np.float32)
    over(image, None)
    darken(image, None, 0.5)
    assert blurred([None, None]) is None and not image.any()
    with pytest.raises(ValueError, match="expected 1 or more"):
        draw_triangles(at_eye, view, SIZE, 0)
    with pytest.raises(ValueError, match="expected a size"):
        Frame(0, 10, 1)


def test_meshes_that_cannot_be_drawn_are_refused() -> None:
    square = np.array([[0.0, 3.0, 0.0], [1.0, 3.0, 0.0], [1.0, 3.0, 1.0], [0.0, 3.0, 1.0]])
    good = _mesh(square, _fan(4))
    texture = Texture(
        texels=np.zeros((1, 2, 2, 3), np.float32), layers=np.full(2, 1, np.int16), uv=np.zeros((4, 2), np.float64)
    )
    for message, change in (
        ("finite", {"vertices": np.where(square == 3.0, np.nan, square)}),
        ("indices below 4", {"triangles": np.array([[0, 1, 4]])}),
        ("indices below 4", {"triangles": np.array([[0, 1, -1]])}),
        ("Mesh.texture.layers: expected below 1", {"texture": texture}),
    ):
        with pytest.raises(ValueError, match=message):
            replace(good, **change)


def test_degenerate_triangles_add_nothing() -> None:
    view = _level()
    square = np.array([[-0.5, 3.0, -0.5], [0.5, 3.0, -0.5], [0.5, 3.0, 0.5], [-0.5, 3.0, 0.5], [0.0, 3.0, 0.9]])
    clean = draw_triangles(_mesh(square, _fan(4)), view, SIZE, 2)
    extra = np.concatenate([_fan(4), [[0, 0, 1], [2, 2, 2], [0, 2, 0]]])
    messy = draw_triangles(_mesh(square, extra), view, SIZE, 2)
    assert clean is not None and messy is not None
    assert (_whole(clean) == _whole(messy)).all()


def test_a_mesh_partly_outside_of_the_picture_is_what_a_larger_picture_shows_there() -> None:
    view = _level()
    rng = np.random.default_rng(3)
    points = rng.uniform([-2.0, 1.0, -1.5], [2.0, 4.0, 1.5], (40, 3))
    triangles = rng.integers(0, 40, (60, 3))
    colours = rng.uniform(0, 255, (40, 3)).astype(np.float32)
    mesh = Mesh(vertices=points, triangles=triangles, colours=colours)
    small = draw_triangles(mesh, view, SIZE, 2)
    wide = replace(view, K=view.K + np.array([[0, 0, 150.0], [0, 0, 150.0], [0, 0, 0]]))
    large = draw_triangles(mesh, wide, (500, 420), 2)
    assert small is not None and large is not None
    picture, larger = np.zeros((120, 200, 3), np.float32), np.zeros((420, 500, 3), np.float32)
    over(picture, small)
    over(larger, large)
    assert np.abs(picture - larger[150:270, 150:350]).max() < 0.01


def test_one_sided_meshes_lose_only_their_inside() -> None:
    view = _level()
    cube = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (2.5, 3.5) for z in (-0.5, 0.5)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = []
    for face in faces:
        middle, normal = cube[face].mean(axis=0), np.cross(cube[face[1]] - cube[face[0]], cube[face[2]] - cube[face[0]])
        outward = normal @ (middle - [0.0, 3.0, 0.0]) > 0
        a, b, c, d = face if outward else face[::-1]
        triangles += [[a, b, c], [a, c, d]]
    both = _mesh(cube, np.array(triangles))
    one = replace(both, two_sided=False)
    turned = replace(one, triangles=both.triangles[:, ::-1])
    first, second, third = (draw_triangles(m, view, SIZE, 2) for m in (both, one, turned))
    assert first is not None and second is not None and third is not None
    assert (first.alpha == second.alpha).all() and (first.depth == second.depth).all()
    assert first.depth[20, 20] == pytest.approx(2.5) and third.depth[20, 20] == pytest.approx(3.5)


def test_a_frame_collects_meshes_and_forgets_them_when_cleared() -> None:
    view = _view()
    rng = np.random.default_rng(1)
    meshes = []
    for _ in range(3):
        points = rng.uniform([-2, -2, 0], [2, 2, 2], (12, 3))
        meshes.append(_mesh(points, rng.integers(0, 12, (20, 3)), rng.uniform(0, 255, 3)))
    frame = Frame(*SIZE, 2)
    for _ in range(2):
        frame.clear()
        for mesh in meshes:
            frame.draw(mesh, view)
        sprite = draw_triangles(meshes, view, SIZE, 2)
        assert sprite is not None
        assert (_whole(frame.sprite()) == _whole(sprite)).all()
    frame.clear()
    assert not frame.sprite().alpha.any()


def test_shadows_fall_where_the_light_throws_them_and_take_their_share() -> None:
    view = _view()
    square = np.array([[-0.4, -0.4, 1.0], [0.4, -0.4, 1.0], [0.4, 0.4, 1.0], [-0.4, 0.4, 1.0]])
    thrown = np.array([0.7, -0.4])
    sprite = shadow(square, _fan(4), thrown, 0.0, view, SIZE, 4)
    fallen = square + [0.7, -0.4, -1.0]
    direct = draw_triangles(_mesh(fallen, _fan(4)), view, SIZE, 4)
    assert (_whole(sprite) == _whole(direct)).all()
    image = np.full((120, 200, 3), 100.0, np.float32)
    darken(image, sprite, 0.4)
    assert np.allclose(image[..., 0], 100.0 - 40.0 * _whole(sprite), atol=1e-3)


def test_blur_is_the_mean_of_its_parts() -> None:
    view = _level()
    square = np.array([[60.0, 30.0], [60.0, 80.0], [80.0, 80.0], [80.0, 30.0]]) - 0.5
    parts = [draw_triangles(_mesh(_at_px(view, square + [5 * i, 0], 2.0), _fan(4)), view, SIZE, 1) for i in range(4)]
    mean = blurred([*parts, None])
    assert mean is not None
    expected = np.mean([*(_whole(p) for p in parts), np.zeros((120, 200))], axis=0)
    assert np.allclose(_whole(mean), expected)
    assert np.allclose(mean.bgr[mean.alpha > 0], [10.0, 20.0, 30.0], atol=1e-3)


def test_sprites_are_hidden_by_nearer_depth_and_laid_over_only_inside() -> None:
    view = _level()
    square = np.array([[60.0, 30.0], [60.0, 80.0], [110.0, 80.0], [110.0, 30.0]])
    sprite = draw_triangles(_mesh(_at_px(view, square, 2.0), _fan(4)), view, SIZE, 1)
    assert sprite is not None
    depth = np.full((120, 200), np.inf, np.float32)
    depth[:, :90] = 1.0
    image = _whole(hidden_by(sprite, depth))
    assert not image[:, :90].any() and (image[31:80, 91:110] == 1).all()
    for x0, y0 in ((-20, -10), (180, 100), (-500, 0), (0, 500)):
        canvas = np.zeros((120, 200, 3), np.float32)
        over(canvas, replace(sprite, x0=x0, y0=y0))
        padded = np.zeros((1200, 1200))
        padded[500 + y0 : 500 + y0 + sprite.alpha.shape[0], 500 + x0 : 500 + x0 + sprite.alpha.shape[1]] = sprite.alpha
        assert np.allclose(canvas[..., 2], 30.0 * padded[500:620, 500:700], atol=1e-4)


_SCENE = """
import hashlib, numpy as np
from pgm_data.simulate.pictures.raster import Mesh, draw_triangles
from pgm_data.simulate.views import View
view = View(K=np.array([[100.0, 0, 100], [0, 100.0, 60], [0, 0, 1]]), k1=0.02,
            R_cam_from_world=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), centre_world=np.zeros(3))
rng = np.random.default_rng(9)
mesh = Mesh(vertices=rng.uniform([-2, -0.5, -1], [2, 4, 1], (300, 3)), triangles=rng.integers(0, 300, (500, 3)),
            colours=rng.uniform(0, 255, (300, 3)).astype(np.float32), opacity=rng.uniform(0, 1, 500))
s = draw_triangles(mesh, view, (200, 120), 3)
print(hashlib.sha256(s.bgr.tobytes() + s.alpha.tobytes() + s.depth.tobytes() + s.label.tobytes()).hexdigest())
"""


def test_another_process_draws_the_same_bytes() -> None:
    def digest() -> str:
        scope: dict = {}
        lines: list[str] = []
        exec(_SCENE.replace("print(", "lines.append("), {"lines": lines, "hashlib": hashlib}, scope)
        return lines[0]

    other = subprocess.run([sys.executable, "-c", _SCENE], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == digest()
