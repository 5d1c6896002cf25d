import math

import numpy as np
import pytest
import torch

from pgm_data.scene import SceneObject, load_scene
from pgm_models.synthesis import surfaces
from pgm_models.synthesis.boxes import NEAREST_M
from pgm_models.synthesis.grids import mixed
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.surfaces import (
    KNOTS,
    Plane,
    Rectangle,
    Sky,
    covered,
    mapped,
    painted_rectangles,
    rectangle_of,
    share_below,
)
from tests.models.synthesis.slow_renderer import array, painted_share, single_rays
from tests.models.synthesis.toy_bodies import drawn, looking, rays_towards

GROUND = Rectangle(corner=np.array([-2.0, -3.0, 0.0]), right=np.array([4.0, 0, 0]), up=np.array([0, 6.0, 0]))


def plane_of(rectangle: Rectangle = GROUND, size: tuple[int, int] = (4, 5), court: bool = False) -> Plane:
    torch.manual_seed(0)
    lines = load_scene("tennis").court if court else None
    return Plane(rectangle, size, 2, width=4, seed=0, court=lines).requires_grad_(False)


def thing(box: tuple[float, ...], region: tuple[tuple[float, ...], ...] = ()) -> SceneObject:
    return SceneObject(
        name="wall", kind="plane", box_m=box, skeleton=None, region_m=region, representation="planes", grid=(4, 4),
        features=2, samples_per_ray=1,
    )  # fmt: skip


def test_planes_lie_in_their_region_or_about_the_origin_and_upright_ones_on_the_ground() -> None:
    ground = rectangle_of(thing((36.0, 56.0, 0.0)))
    assert ground.corner.tolist() == [-18.0, -28.0, 0.0]
    assert ground.right.tolist() == [36.0, 0.0, 0.0] and ground.up.tolist() == [0.0, 56.0, 0.0]
    wall = rectangle_of(thing((36.0, 0.0, 12.0)))
    assert wall.corner.tolist() == [-18.0, 0.0, 0.0] and wall.up.tolist() == [0.0, 0.0, 12.0]
    there = rectangle_of(thing((1.0, 1.0, 0.0), ((-1.0, 30.0, -2.0), (5.0, 30.0, 7.0))))
    assert there.corner.tolist() == [-1.0, 30.0, -2.0] and there.right.tolist() == [6.0, 0.0, 0.0]
    for box in ((1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
        with pytest.raises(ValueError, match="wall: expected a plane, with exactly one side of 0 m"):
            rectangle_of(thing(box))


def test_rays_meet_the_rectangle_where_they_cross_its_plane() -> None:
    plane, rng = plane_of(), np.random.default_rng(0)
    targets = np.concatenate([rng.uniform([-3, -4, 0], [3, 4, 0], (200, 3))])
    origins = targets + rng.normal(size=(200, 3)) + [0.0, 0.0, 2.0]
    found = plane.meet(rays_towards(origins, targets))
    inside = (np.abs(targets[:, 0]) < 2) & (np.abs(targets[:, 1]) < 3)
    assert (found.met.numpy() == inside).all() and 20 < inside.sum() < 180
    np.testing.assert_allclose(array(found.depth)[inside], np.linalg.norm(targets - origins, axis=1)[inside], rtol=1e-4)
    ramp = torch.tensor([[i / 3, j / 4] for i in range(4) for j in range(5)])
    place = array(mixed(ramp, found.rows, found.shares))[inside]
    np.testing.assert_allclose(place, (targets[inside, :2] + [2, 3]) / [4, 6], atol=1e-5)


def test_planes_are_seen_from_both_sides_and_not_from_behind_the_camera_nor_along_them() -> None:
    plane, up = plane_of(), np.array([[0.5, 0.5, 3.0]])
    for origin, target, met in (
        (up, [[0.5, 0.5, 0.0]], True),
        (-up, [[-0.5, -0.5, 0.0]], True),
        (up, [[0.5, 0.5, 4.0]], False),
        ([[0.5, 0.5, NEAREST_M / 2]], [[0.5, 0.5, -1.0]], False),
        ([[-9.0, 0.5, 0.0]], [[0.5, 0.5, 0.0]], False),  # within the plane
        ([[-9.0, 0.5, 1.0]], [[0.5, 0.5, 1.0]], False),  # beside it
    ):
        found = plane.meet(rays_towards(np.array(origin), np.array(target)))
        assert found.met.tolist() == [met]
        assert torch.isfinite(found.shares).all() and int(found.rows.max()) < 20


def test_rays_that_graze_a_plane_find_cells_that_exist() -> None:
    plane = plane_of(court=True)
    rays = rays_towards(np.array([[-9.0, 0.5, 1.0]] * 6), np.array([[0.5, 0.5, 1.0]] * 6))
    rays.direction[:, 2] = torch.tensor([-1e-44, -1e-38, -1e-30, -1e-12, 1e-38, -0.0])
    found = plane.meet(rays)
    assert not found.met.any()
    assert int(found.rows.min()) >= 0 and int(found.rows.max()) < 20 and torch.isfinite(found.shares).all()
    assert (found.paint == 0).all()


def test_places_that_pictures_show_most_get_most_cells() -> None:
    plane, seen = plane_of(), torch.zeros(2, 130)
    seen[0, 60:70], seen[1] = 1000.0, 3.0
    plane.fit_maps(seen)
    maps = plane.maps
    assert maps.shape == (2, KNOTS) and (maps.diff(dim=1) > 0).all()
    np.testing.assert_allclose(maps[:, [0, -1]], [[0, 1]] * 2, atol=1e-6)
    np.testing.assert_allclose(maps[1], np.linspace(0, 1, KNOTS), atol=1e-5)
    knots = np.linspace(0.0, 1.0, KNOTS)
    shown = np.interp(70 / 130, knots, maps[0]) - np.interp(60 / 130, knots, maps[0])
    assert shown > 0.7  # of the 0.8 that are not spread evenly, less what knots are too coarse for
    share = torch.rand(50, 2, generator=torch.Generator().manual_seed(0))
    expected = np.stack([np.interp(share[:, axis], knots, maps[axis]) for axis in range(2)], axis=1)
    np.testing.assert_allclose(mapped(maps, share), expected, atol=1e-5)
    ends = torch.tensor([[0.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(mapped(maps, ends), ends, atol=1e-6)


@pytest.mark.parametrize("count", [0.0, 1e-6, 0.3 / 40])
def test_maps_take_up_the_whole_grid_however_little_was_seen(count: float) -> None:
    plane = plane_of()
    plane.fit_maps(torch.full((2, 40), count))
    np.testing.assert_allclose(plane.maps, np.tile(np.linspace(0, 1, KNOTS), (2, 1)), atol=1e-5)


def test_painted_lines_are_as_long_and_wide_as_the_court_says() -> None:
    court = load_scene("tennis").court
    assert court is not None
    lines = painted_rectangles(court)
    for (middle, along), ends, width in zip(lines, court.lines_world, court.line_width, strict=True):
        np.testing.assert_allclose(middle[:2], ends.mean(axis=0)[:2])
        assert middle[2] == pytest.approx(0.5 * (np.linalg.norm(ends[1] - ends[0]) + width))
        assert along[2] == width / 2 and np.hypot(*along[:2]) == pytest.approx(1.0)


def test_coverage_by_lines_is_that_of_many_points_of_the_parallelogram() -> None:
    rng = np.random.default_rng(0)
    direction = rng.uniform(0, math.pi, 60)
    middle, half = rng.normal(scale=0.3, size=(60, 2)), np.stack([np.full(60, 9.0), rng.uniform(0.01, 0.3, 60)], 1)
    line = np.stack(
        [np.concatenate([middle, half[:, :1]], 1), np.stack([np.cos(direction), np.sin(direction), half[:, 1]], 1)], 1
    )
    steps = rng.normal(scale=0.3, size=(60, 2, 2))
    spots = (np.arange(200) + 0.5) / 200 - 0.5
    x, y = (part.ravel()[:, None] for part in np.meshgrid(spots, spots))
    for number in range(60):
        points = x * steps[number, 0] + y * steps[number, 1] - middle[number]
        aside = np.abs(points @ [-math.sin(direction[number]), math.cos(direction[number])])
        found = covered(
            torch.zeros(1, 2), torch.tensor(steps[number][None]).float(), torch.tensor(line[number][None]).float()
        )
        assert float(found) == pytest.approx((aside < half[number, 1]).mean(), abs=0.01)


def test_footprints_on_the_court_are_covered_as_looking_at_many_places_says() -> None:
    plane = plane_of(rectangle_of(load_scene("tennis").objects[3]), court=True)
    camera = looking([2.0, -22.0, 7.0], [0.0, -2.0, 0.0], focal=500.0, size=(512, 288), roll=0.05)
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [511, 287], (1500, 2))
    rays = camera_rays(camera, pixels)
    paint = plane.meet(rays).paint
    partly = torch.nonzero((paint > 0.02) & (paint < 0.98))[:, 0]
    assert len(partly) > 25 and float(paint.max()) > 0.9
    chosen = torch.cat([partly[:25], torch.nonzero(paint == 0)[:5, 0]])
    lines, corner, normal = array(plane.lines), array(plane.corner), array(plane.normal)
    expected = [painted_share(ray, corner, normal, lines) for ray in single_rays(rays[chosen])]
    np.testing.assert_allclose(paint[chosen], expected, atol=0.04)
    assert np.abs(array(paint[chosen]) - expected).mean() < 0.01


def test_paint_does_not_depend_on_how_many_rays_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    plane = plane_of(rectangle_of(load_scene("tennis").objects[3]), court=True)
    rays = camera_rays(looking([2.0, -22.0, 7.0], [0.0, -2.0, 0.0], focal=60.0), picture_pixels(64, 48))
    once = plane.meet(rays).paint
    monkeypatch.setattr(surfaces, "PAINTED_AT_ONCE", 100)
    torch.testing.assert_close(plane.meet(rays).paint, once)
    assert float(once.sum()) > 10


@pytest.mark.parametrize(("one", "other"), [(0.3, 0.1), (0.2, 0.2), (0.0, 0.5), (0.0, 0.0), (1e-7, 3.0)])
def test_shares_below_a_place_rise_from_none_to_all(one: float, other: float) -> None:
    places = torch.linspace(-3, 3, 601)
    sides = [torch.full_like(places, side) for side in (one, other)]
    found = share_below(places, *sides)
    assert (found.diff() >= -1e-6).all() and float(found[0]) == 0.0 and float(found[-1]) == 1.0
    np.testing.assert_allclose(found + share_below(-places, *sides), 1.0, atol=1e-6)
    rng = np.random.default_rng(0)
    sums = one * rng.uniform(-0.5, 0.5, 40_000) + other * rng.uniform(-0.5, 0.5, 40_000)
    if one + other > 0:
        np.testing.assert_allclose(found, [(sums < float(place)).mean() for place in places], atol=0.012)


def test_the_sky_is_met_by_every_ray_at_its_own_direction_and_closes_round_the_horizon() -> None:
    torch.manual_seed(0)
    sky = Sky((8, 5), 2, width=4, seed=0)
    turns, heights = np.meshgrid(
        np.arange(8) / 8 * 2 * math.pi, np.linspace(-math.pi / 2, math.pi / 2, 5), indexing="ij"
    )
    targets = np.stack([np.cos(heights) * np.cos(turns), np.cos(heights) * np.sin(turns), np.sin(heights)], -1)
    rays = rays_towards(np.zeros((40, 3)), targets.reshape(-1, 3))
    met = sky.meet(rays)
    table = drawn(40, 3)
    found = mixed(table, met.rows, met.shares).reshape(8, 5, 3)
    np.testing.assert_allclose(found[:, 1:-1], table.reshape(8, 5, 3)[:, 1:-1], atol=1e-4)  # poles have any turn
    assert met.met.all() and (met.depth == 1e6).all() and (met.paint == 0).all()
    np.testing.assert_allclose(met.shares.sum(dim=1), 1.0, atol=1e-6)
    seam = rays_towards(np.zeros((3, 3)), np.array([[1.0, -1e-9, 0.1], [1.0, 0.0, 0.1], [1.0, 1e-9, 0.1]]))
    at = sky.meet(seam)
    values = mixed(table, at.rows, at.shares)
    np.testing.assert_allclose(values, values[1].expand(3, 3), atol=1e-5)
    poles = sky.meet(rays_towards(np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])))
    assert torch.isfinite(poles.shares).all() and int(poles.rows.max()) < 40 and int(poles.rows.min()) >= 0
