"""Drawn things are looked for in the pictures and held against cv2.projectPoints and a ray by ray reference."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.blocks.figure import PART_BOXES_M, part_placements
from pgm_data.simulate.blocks.materials import MATERIALS, TEXTURES, texture
from pgm_data.simulate.blocks.mesh import world_rectangles
from pgm_data.simulate.blocks.shots import blocks_shots
from pgm_data.simulate.blocks.studio import Studio
from pgm_data.simulate.blocks.world import OPAQUE, BlockWorld, fill

SCENE = load_scene("blocks")


@pytest.fixture(scope="module")
def shot():
    return next(blocks_shots(SCENE, 3, frames=400, fps=20.0, size=(640, 360)))


def projected(shot, frame, points):
    track = shot.track
    turn = cv2.Rodrigues(track.R_cam_from_world[frame])[0]
    pixels, _ = cv2.projectPoints(
        np.asarray(points, dtype=float).reshape(-1, 1, 3),
        turn,
        track.t_cam_from_world[frame],
        track.K[frame],
        track.distortion[frame],
    )
    return pixels[:, 0]


def filled(polygons, size, factor=16):
    """Share of every pixel that convex polygons (pixels) cover, by fine sampling."""
    width, height = size
    fine = np.zeros((height * factor, width * factor), dtype=np.uint8)
    for polygon in polygons:
        # Pixel x lies at fine x * factor + (factor - 1) / 2.
        corners = (np.asarray(polygon) * factor + (factor - 1) / 2) * 16
        cv2.fillConvexPoly(fine, np.round(corners).astype(np.int32), 1, shift=4)
    return fine.reshape(height, factor, width, factor).mean(axis=(1, 3))


def test_the_figure_is_drawn_where_its_corners_project(shot):
    """The silhouette in the mask against the union of the hulls of the projected boxes."""
    checked = 0
    for frame in range(0, 400, 40):
        label, _ = shot.masks(frame)
        hull = shot.states.players[0].hull_centres[frame].reshape(6, 8, 3)
        polygons = [cv2.convexHull(projected(shot, frame, part).astype(np.float32))[:, 0] for part in hull]
        cover = filled(polygons, shot.size)
        drawn = label == 1
        if drawn.sum() < 0.97 * cover.sum():
            continue
        checked += 1
        ys, xs = np.mgrid[0 : shot.size[1], 0 : shot.size[0]]
        truth = np.array([(xs * cover).sum(), (ys * cover).sum()]) / cover.sum()
        found = np.array([xs[drawn].mean(), ys[drawn].mean()])
        assert np.abs(found - truth).max() < 0.25
    assert checked >= 3


@pytest.mark.parametrize("fine", [True, False])
def test_edges_of_blocks_lie_where_they_project(shot, fine):
    """One cube in an otherwise empty world, found as what differs from the picture without it."""
    cells = np.zeros(shot.world.cells.shape, dtype=np.uint8)
    cells[0, 0, 0] = 1
    empty = BlockWorld(cells=cells, elements=(), ladders=(), plants=(), posts=np.zeros((0, 2, 3)))
    corner = np.array([3.0, -4.0, 1.0])
    cells = cells.copy()
    fill(cells, (11, 4), 2, 4, "stone")
    one = BlockWorld(cells=cells, elements=(), ladders=(), plants=(), posts=np.zeros((0, 2, 3)))
    studios = [Studio(w, 5, fine=fine) for w in (empty, one)]
    checked = 0
    for frame in (0, 130, 260, 399):
        without, with_it = (s.picture(shot.track, shot.posture, frame, shot.size).astype(int) for s in studios)
        share = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        polygon = cv2.convexHull(projected(shot, frame, corner + share).astype(np.float32))[:, 0]
        cover = filled([polygon], shot.size)
        near = cv2.dilate(cover, np.ones((9, 9))) > 0
        if (studios[0].masks(shot.track, shot.posture, frame, shot.size)[0][near] != 0).any():
            continue
        changed = (np.abs(with_it - without).max(axis=2) > 1) & near
        checked += 1
        if fine:
            # Nine samples a pixel: what lies outside stays as it was, what is covered by a quarter has changed.
            assert not changed[cover == 0].any()
            assert changed[cover > 0.25].mean() > 0.99
        ys, xs = np.mgrid[0 : shot.size[1], 0 : shot.size[0]]
        weight = np.where(cover > 0.5, 1.0, 0.0) if not fine else (cover > 0.1).astype(float)
        truth = np.array([(xs * weight).sum(), (ys * weight).sum()]) / weight.sum()
        found = np.array([xs[changed].mean(), ys[changed].mean()])
        assert np.abs(found - truth).max() < 0.15
    assert checked >= 2


def reference_hit(shot, frame, pixel):
    """First hit of the ray through a pixel with all opaque cells and body parts: label, camera depth."""
    track = shot.track
    R, t, K = track.R_cam_from_world[frame], track.t_cam_from_world[frame], track.K[frame]
    ray = R.T @ np.linalg.solve(K, [*pixel, 1.0])
    centre = -R.T @ t
    best, label = np.inf, 0
    cells = np.argwhere(OPAQUE[shot.world.cells])
    low = cells * 0.5 + [-8.0, -8.0, -2.0]
    with np.errstate(divide="ignore"):
        a, b = (low - centre) / ray, (low + 0.5 - centre) / ray
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    hit = near < far
    if hit.any():
        best, label = near[hit].min(), 2
    for (R_part, t_part), box in zip(
        zip(*part_placements(shot.posture, frame), strict=True), PART_BOXES_M, strict=True
    ):
        o, d = R_part.T @ (centre - t_part), R_part.T @ ray
        a, b = (box[0] - o) / d, (box[1] - o) / d
        near, far = np.minimum(a, b).max(), np.maximum(a, b).min()
        if near < far and near < best:
            best, label = near, 1
    return label, best


def test_labels_and_depth_agree_with_rays_through_every_cell(shot):
    """Away from thin things (ladders, fences, plants, glass), which the reference leaves out."""
    rng = np.random.default_rng(0)
    frame = 60
    label, depth = shot.masks(frame)
    agree, total = 0, 0
    where = np.argwhere(cv2.dilate((label == 1).astype(np.uint8), np.ones((9, 9))) > 0)
    pixels = [(int(x), int(y)) for y, x in where[rng.permutation(len(where))[:150]]]
    pixels += [(int(x), int(y)) for x, y in zip(rng.integers(0, 640, 250), rng.integers(0, 360, 250), strict=True)]
    for x, y in pixels:
        want, far = reference_hit(shot, frame, (x, y))
        total += 1
        if want == label[y, x] and (want == 0 or abs(depth[y, x] - far) < 1e-3):
            agree += 1
        elif label[y, x] == 2:
            # Something thin in front of what the reference sees.
            assert depth[y, x] < far + 1e-3
            agree += 1
    assert agree == total


def test_the_world_is_covered_by_rectangles_once():
    shot = next(blocks_shots(SCENE, 3, frames=1, fps=20.0, size=(64, 36)))
    rectangles = world_rectangles(shot.world)
    cells = shot.world.cells
    tops = (cells > 0) & ~OPAQUE[np.concatenate([cells[:, :, 1:], np.zeros_like(cells[:, :, :1])], axis=2)]
    tops &= np.concatenate([cells[:, :, 1:], np.zeros_like(cells[:, :, :1])], axis=2) != cells
    area = 0.25 * tops.sum()
    grid = (rectangles.normal[:, 2] > 0.5) & (rectangles.counts % 8 == 0).all(axis=1)
    assert rectangles.counts[grid].prod(axis=1).sum() / 256 == pytest.approx(area)
    np.testing.assert_allclose((rectangles.along * rectangles.down).sum(axis=1), 0, atol=1e-12)
    outwards = np.cross(rectangles.down, rectangles.along)
    plain = ~rectangles.two_sided
    assert ((outwards * rectangles.normal).sum(axis=1)[plain] > 0).all()


def test_the_figure_throws_a_shadow_that_only_darkens():
    """The same frame with the figure's boxes drawn, and with them out of the way."""
    shot = next(blocks_shots(SCENE, 3, frames=400, fps=20.0, size=(640, 360)))
    frame = 60
    away = replace(shot.posture, joints=shot.posture.joints - [0.0, 0.0, 60.0])
    label = shot.masks(frame)[0]
    with_it = shot.draw(frame).astype(int)
    without = shot.studio.picture(shot.track, away, frame, shot.size).astype(int)
    hidden = shot.studio.masks(shot.track, away, frame, shot.size)[0]
    # Pixels at the figure's rim hold some of it.
    figure = cv2.dilate((label == 1).astype(np.uint8), np.ones((3, 3))) > 0
    ground = (label == 2) & (hidden == 2) & ~figure
    change = (with_it - without)[ground]
    assert (change.sum(axis=1) < -30).sum() > 30
    assert change.max() <= 0


def test_draft_and_full_pictures_show_the_same(shot):
    draft = next(blocks_shots(SCENE, 3, frames=400, fps=20.0, size=(640, 360), quality="draft"))
    a, b = shot.draw(10).astype(float), draft.draw(10).astype(float)
    assert not np.array_equal(a, b)
    assert np.abs(cv2.blur(a, (9, 9)) - cv2.blur(b, (9, 9))).mean() < 3.0
    np.testing.assert_array_equal(shot.masks(10)[0], draft.masks(10)[0])


def test_every_material_has_its_pictures():
    for material in MATERIALS[1:]:
        for name in (material.top, material.side):
            assert texture(name).shape == (16, 16, 4)
            assert (texture(name)[..., 3] == 255).all() or not material.opaque
    assert len({texture(n).tobytes() for n in TEXTURES}) == len(TEXTURES)
    with pytest.raises(ValueError, match="texture: expected one of"):
        texture("cheese")
