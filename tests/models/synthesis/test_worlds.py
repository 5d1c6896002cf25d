from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import distance_transform_cdt, maximum_filter
from torch.nn import functional

from pgm_data.geometry.camera import Camera
from pgm_data.scene import SceneObject, load_scene
from pgm_models.synthesis.bodies import DENSITY_SCALE, density_of
from pgm_models.synthesis.grids import fetched, mixed
from pgm_models.synthesis.rays import Rays, camera_rays, joined_rays, picture_pixels
from pgm_models.synthesis.samples import summed, weights_of
from pgm_models.synthesis.worlds import (
    AIR,
    OWN,
    StaticVolume,
    WorldGrids,
    air_loss,
    faintness,
    room_of,
    world_box,
    world_cells,
    world_grids,
)

WORLD = next(thing for thing in load_scene("blocks").objects if thing.kind == "static")


def box(low, high, grid=(16, 16, 16)) -> SceneObject:
    size = tuple(b - a for a, b in zip(low, high, strict=True))
    return replace(WORLD, box_m=size, region_m=(tuple(low), tuple(high)), grid=grid)


def looking(eye, at, width=40, height=24, frame=0) -> Rays:
    eye, at = np.array(eye, float), np.array(at, float)
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0.1, 0.2, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[30.0, 0, (width - 1) / 2], [0, 30.0, (height - 1) / 2], [0, 0, 1]])
    camera = Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ eye)
    return camera_rays(camera, picture_pixels(width, height), frame=frame)


def volume(voxels=16, thing=WORLD) -> StaticVolume:
    return StaticVolume(thing, 4, voxels=voxels, width=4, seed=0)


def filled(made: StaticVolume, raw: torch.Tensor, features=5) -> WorldGrids:
    values = torch.rand(raw.numel(), features, generator=torch.Generator().manual_seed(9))
    return world_grids(raw.reshape(-1, 1), values, made.size)


def terraces(made: StaticVolume, seed=1) -> torch.Tensor:
    """Ground with blocks of chance heights, of density that differs from cell to cell, and some fog."""
    generator = torch.Generator().manual_seed(seed)
    x, y, z = made.size
    heights = torch.randint(1, z // 2, (x, y, 1), generator=generator)
    solid = torch.arange(z) <= torch.where(torch.rand(x, y, 1, generator=generator) < 0.2, heights, z // 5)
    fog = torch.rand(x, y, z, generator=generator) < 0.01
    held = 2 * torch.randn(x, y, z, generator=generator)
    return torch.where(solid, held, torch.where(fog, held - 5, torch.tensor(-25.0)))


def seen(marched, grids: WorldGrids, rays: Rays) -> torch.Tensor:
    weights = weights_of(marched.samples.ray, marched.optical)
    return summed(marched.samples.ray, weights[:, None] * mixed(grids.values, marched.rows, marched.shares), len(rays))


def test_cells_are_as_close_to_cubes_as_the_longest_side_allows() -> None:
    assert world_cells(WORLD, 64) == (64, 64, 40)
    for voxels in (2, 5, 16, 33, 128):
        size = world_cells(WORLD, voxels)
        assert size[0] == size[1] == voxels
        low, high = world_box(WORLD)
        edge = (high[0] - low[0]) / (voxels - 1)
        assert abs((size[2] - 1) * edge - (high[2] - low[2])) <= edge / 2


def test_a_world_has_no_more_cells_than_its_scene_asks_for() -> None:
    assert world_cells(WORLD, 1000) == (128, 128, 80)
    assert world_cells(replace(WORLD, grid=(40, 20, 6)), 64) == (40, 20, 6)
    assert world_cells(box((0, 0, 0), (4, 2, 0)), 9) == (9, 5, 1)


def test_a_world_may_be_grown_in_fewer_cells_than_it_holds() -> None:
    made = StaticVolume(WORLD, 4, voxels=13, width=4, seed=0, grown=5)
    assert made.size == (13, 13, 9) and made.grown.size == (5, 5, 3) and made.own.shape == (13 * 13 * 9, 5)
    own = 0.01 * torch.randn(made.own.shape, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        made.own.copy_(own)
        grids, coarse = made.grids(), made.grown()
    cells = torch.cartesian_prod(*[torch.linspace(0, 1, count) for count in made.size])
    expected = fetched(coarse, cells, made.grown.size) + OWN * own
    torch.testing.assert_close(torch.cat([grids.density, grids.values], dim=1), expected, atol=1e-5, rtol=0)
    alone = StaticVolume(WORLD, 4, voxels=5, width=4, seed=0, grown=9)
    assert alone.size == alone.grown.size == (5, 5, 3)


def test_worlds_that_say_no_box_or_no_cells_are_refused() -> None:
    with pytest.raises(ValueError, match="world.*lower corner first"):
        world_box(box((0, 0, 1), (1, 1, 0)))
    with pytest.raises(ValueError, match="cells along x, y and z"):
        world_cells(replace(WORLD, grid=(8, 8)), 4)
    with pytest.raises(ValueError, match="voxels: expected 2 or more, got 1"):
        world_cells(WORLD, 1)
    unmoved = world_box(replace(WORLD, region_m=(), box_m=(4.0, 6.0, 3.0)))
    np.testing.assert_allclose(unmoved, [[-2, -3, 0], [2, 3, 3]])


@pytest.mark.parametrize("size", [(9, 14, 20), (3, 2, 30), (1, 12, 7)])
def test_room_is_never_more_than_the_way_to_the_nearest_cube_that_holds_something(size) -> None:
    raw = torch.where(torch.rand(size, generator=torch.Generator().manual_seed(2)) < 0.004, 0.0, -30.0)
    raw[0, 0, 0] = 1.0
    room = room_of(raw.flatten(), size).reshape(size).numpy()
    # A cube holds something if one of its corners does; cubes begin at all cells but the last ones.
    cubes = maximum_filter(raw.numpy(), size=2, origin=-1, mode="constant", cval=-30.0) > -1
    cubes = cubes[tuple(slice(0, max(cells - 1, 1)) for cells in size)]
    away = distance_transform_cdt(~cubes, metric="chessboard")
    own = room[tuple(slice(0, max(cells - 1, 1)) for cells in size)]
    assert ((own < 0) == cubes).all()
    assert (own[~cubes] < away[~cubes]).all()
    assert (own[~cubes] >= (away[~cubes] - 1) / 2).all()


def test_a_world_of_air_has_room_everywhere() -> None:
    assert int(room_of(torch.full((60,), -40.0), (3, 4, 5)).min()) >= 5


@pytest.mark.parametrize(
    ("eye", "at"),
    [((14, -12, 9), (0, 0, 1)), ((0.5, 0.25, 6), (3, 2, 0)), ((-9, 1, -1), (8, 1, -1)), ((0, 0, 20), (0.1, 0, 0))],
)
@pytest.mark.parametrize("jittered", [False, True])
def test_what_is_seen_is_the_same_with_and_without_skipping(eye, at, jittered) -> None:
    made = volume(voxels=33)
    grids = filled(made, terraces(made))
    rays = looking(eye, at)
    jitter = torch.rand(len(rays), 40, generator=torch.Generator().manual_seed(3)) if jittered else None
    skipped = made.march(rays, grids, count=40, jitter=jitter)
    dense = made.march_densely(rays, grids, count=40, jitter=jitter)
    expected = seen(dense, grids, rays)
    assert float(expected.max()) > 0.5
    torch.testing.assert_close(seen(skipped, grids, rays), expected, rtol=0, atol=1e-5)
    assert skipped.looked_at < 0.6 * dense.looked_at


def test_through_thin_fog_the_samples_are_those_of_no_skipping() -> None:
    made = volume(voxels=20)
    raw = torch.where(terraces(made) > -20, torch.tensor(-9.0), torch.tensor(-25.0))
    grids, rays = filled(made, raw), looking((12, -9, 7), (0, 0, 0))
    skipped = made.march(rays, grids, count=31, jitter=None)
    dense = made.march_densely(rays, grids, count=31, jitter=None)
    assert len(dense.samples) > 1000
    for name in ("ray", "depth", "length"):
        torch.testing.assert_close(getattr(skipped.samples, name), getattr(dense.samples, name))
    torch.testing.assert_close(
        mixed(grids.values, skipped.rows, skipped.shares), mixed(grids.values, dense.rows, dense.shares)
    )
    torch.testing.assert_close(skipped.optical, dense.optical)


def test_worlds_learn_the_same_with_and_without_skipping() -> None:
    made = volume(voxels=12)
    raw = terraces(made)
    rays = looking((11, -12, 6), (0, 0, 0), width=16, height=12)
    changes = []
    for march in (made.march, made.march_densely):
        held = raw.clone().requires_grad_()
        grids = filled(made, held)
        seen(march(rays, grids, count=24, jitter=None), grids, rays).square().sum().backward()
        changes.append(held.grad)
    assert float(changes[1].abs().max()) > 1e-3
    torch.testing.assert_close(changes[0], changes[1], rtol=1e-4, atol=1e-6)


def test_an_even_fog_dims_by_its_density_and_the_way_through_it() -> None:
    thing = box((-1, -1, -1), (1, 1, 1))
    made = volume(thing=thing)
    raw = torch.full(made.size, -6.0)
    rays = looking((5, 0.1, 0.2), (0, 0, 0), width=8, height=6)
    spans = made.spans(rays)
    density = DENSITY_SCALE * functional.softplus(torch.tensor(-6.0))
    marched = made.march(rays, filled(made, raw), count=7, jitter=None)
    expected = density * (spans.far - spans.near)
    torch.testing.assert_close(summed(marched.samples.ray, marched.optical, len(rays)), expected)


def test_air_is_not_looked_at_and_what_is_hidden_hardly() -> None:
    made = volume(voxels=33)
    rays = looking((14, -12, 9), (0, 0, 1))
    assert made.march(rays, filled(made, torch.full(made.size, -25.0)), count=64, jitter=None).looked_at == 0
    solid = made.march(rays, filled(made, torch.full(made.size, 1e5)), count=64, jitter=None)
    # One sample is opaque; no more than one burst of a ray is looked at.
    assert 0 < solid.looked_at <= 4 * int(made.spans(rays).met.sum())


def test_a_cell_next_to_air_counts_however_faint_it_is() -> None:
    made = volume(thing=box((0, 0, 0), (1, 1, 1), grid=(5, 5, 5)), voxels=5)
    raw = torch.full(made.size, -40.0)
    raw[2, 2, 2] = -11.4  # just above what counts
    assert float(density_of(raw[2, 2, 2])) > 0
    grids = filled(made, raw)
    assert int((grids.room < 0).sum()) == 8
    ray = Rays(
        origin=torch.tensor([[-1.0, 0.5, 0.5]]),
        direction=torch.tensor([[1.0, 0.0, 0.0]]),
        across=torch.zeros(1, 3),
        down=torch.zeros(1, 3),
        frame=torch.zeros(1, dtype=torch.int64),
    )
    assert len(made.march(ray, grids, count=1, jitter=None).samples) == 1


def test_all_frames_see_the_same_world_and_order_is_kept() -> None:
    made = volume()
    grids = filled(made, terraces(made))
    one, other = looking((12, -12, 6), (0, 0, 0)), looking((-3, -12, 6), (0, 0, 0), frame=5)
    both = made.march(joined_rays([one, other]), grids, count=24, jitter=None)
    parts = [made.march(rays, grids, count=24, jitter=None) for rays in (one, other)]
    torch.testing.assert_close(both.optical, torch.cat([part.optical for part in parts]))
    key = both.samples.ray.double() * 1e3 + both.samples.depth
    assert (key[1:] > key[:-1]).all()


def test_boxes_without_volume_and_cameras_that_look_away_see_nothing() -> None:
    flat = volume(thing=box((0, 0, 0), (4, 4, 0)), voxels=8)
    assert flat.size == (8, 8, 1)
    assert not len(flat.march(looking((2, -3, 2), (2, 2, 0)), flat.grids(), count=8, jitter=None).samples)
    made = volume()
    away = made.march(looking((0, -20, 3), (0, -40, 3)), made.grids(), count=8, jitter=None)
    assert not len(away.samples) and not away.looked_at
    none = looking((0, -20, 3), (0, 0, 3))[torch.zeros(0, dtype=torch.int64)]
    assert not len(made.march(none, made.grids(), count=8, jitter=None).samples)
    with pytest.raises(ValueError, match="count: expected 1 or more samples a ray, got 0"):
        made.march(none, made.grids(), count=0, jitter=None)


def test_density_without_bound_and_axes_of_one_cell_make_no_nan() -> None:
    for thing in (WORLD, replace(WORLD, grid=(9, 1, 9))):
        made = volume(voxels=9, thing=thing)
        grids = filled(made, torch.full(made.size, 1e30))
        rays = looking((9, -12, 4), (0, 0, 0))
        assert torch.isfinite(seen(made.march(rays, grids, count=9, jitter=None), grids, rays)).all()
        thin = filled(made, torch.full(made.size, -25.0))
        assert not len(made.march(rays, thin, count=9, jitter=None).samples)


def test_a_fresh_world_is_seen_and_seen_through_and_learns() -> None:
    made = volume(voxels=8)
    grids, rays = made.grids(), looking((9, -12, 4), (0, 0, 0))
    marched = made.march(rays, grids, count=16, jitter=None)
    passed = torch.exp(-summed(marched.samples.ray, marched.optical, len(rays)))[made.spans(rays).met]
    assert 1e-6 < float(passed.detach().mean()) < 0.9
    seen(marched, grids, rays).sum().backward()
    assert all(float(each.grad.abs().sum()) > 0 for each in made.parameters())


def test_held_down_faintness_empties_air_and_leaves_what_is_solid() -> None:
    made = volume(voxels=6)
    raw = torch.tensor([-30.0, -11.0, -5.0, -4.0, 0.5, 20.0]).repeat(made.size[0] * made.size[1] * made.size[2] // 6)
    held = raw.clone().requires_grad_()
    assert float(faintness(filled(made, torch.full(made.size, -30.0)))) == 0
    for _ in range(200):
        held.grad = None
        faintness(filled(made, held)).backward()
        with torch.no_grad():
            held -= 100.0 * held.grad
    assert (density_of(held[raw < -3.95]) == 0).all()
    assert torch.equal(held[raw > 0], raw[raw > 0])


def test_the_loss_of_air_is_that_of_all_worlds_and_none_where_they_are_empty() -> None:
    made = volume(voxels=6)
    worlds = {
        name: filled(made, torch.full(made.size, raw)) for name, raw in (("fog", -5.0), ("solid", 3.0), ("air", -30.0))
    }
    assert float(air_loss({"fog": worlds["fog"]})) == pytest.approx(AIR * float(faintness(worlds["fog"])))
    assert 0 < float(air_loss({"fog": worlds["fog"]})) < AIR
    assert float(air_loss({"solid": worlds["solid"]})) == pytest.approx(AIR)
    assert float(air_loss({"air": worlds["air"]})) == 0
    both = air_loss({"fog": worlds["fog"], "solid": worlds["solid"]})
    assert float(both) == pytest.approx(float(air_loss({"fog": worlds["fog"]})) + AIR)


def test_cells_learn_what_is_their_own_and_those_that_nothing_asks_for_stay() -> None:
    torch.manual_seed(0)
    world = volume(voxels=8)
    before = world.grids()
    assert world.own.shape == (len(before.density), 5)
    optimiser = torch.optim.Adam([world.own], 1e-3)
    asked = torch.arange(0, len(world.own), 3)
    world.grids().density[asked].sum().backward()
    optimiser.step()
    change = (world.grids().density - before.density)[:, 0]
    torch.testing.assert_close(change[asked], torch.full((len(asked),), -1e-3 * OWN), atol=1e-5, rtol=0)
    change[asked] = 0
    assert not change.any()
    assert torch.equal(world.grids().values, before.values)
