import numpy as np
import pytest
import torch

from pgm_data.skeleton import load_skeleton
from pgm_models.synthesis import bodies
from pgm_models.synthesis.bodies import DENSITY_SCALE, THIN, Body, BodyGrids, Marched, body_boxes, density_of
from pgm_models.synthesis.boxes import box_spans
from pgm_models.synthesis.grids import fetched
from pgm_models.synthesis.rays import Rays, camera_rays, joined_rays, picture_pixels
from pgm_models.synthesis.samples import uniform_samples
from pgm_models.synthesis.skinning import Poses, poses_of
from tests.models.synthesis.slow_renderer import Dress, array, body_seen, single_rays
from tests.models.synthesis.toy_bodies import bent, drawn, looking, lumpy_grids, rays_towards, small_body

SKELETONS = ["smpl24", "blocks13"]


class Undressed(Dress):
    """The first corner's values, which shows which cells a sample is between."""

    def features(self, cells: list[tuple[float, np.ndarray]]) -> np.ndarray:
        """Values between cells."""
        return np.sum([weight * value for weight, value in cells], axis=0)


def dense_march(body: Body, rays: Rays, poses: Poses, grids: BodyGrids, count: int, jitter=None) -> torch.Tensor:
    """Optical depth of every sample in the boxes (rays, count), nothing skipped; 0 where a ray misses."""
    samples = uniform_samples(box_spans(rays, body_boxes(poses, body.skinning)), count, jitter=jitter)
    points = rays.origin[samples.ray] + samples.depth[:, None] * rays.direction[samples.ray]
    optical = torch.zeros(len(samples))
    for frame in range(len(poses.scale)):
        own = torch.nonzero(rays.frame[samples.ray] == frame)[:, 0]
        near, rest, share = body.skinning.to_rest(points[own], poses, frame, grids.weights)
        density = density_of(fetched(grids.density, body.skinning.places(rest), body.size)[:, 0]) * share
        optical[own[near]] = torch.where(density > THIN, density, 0.0) * samples.length[own[near]]
    met = torch.nonzero(box_spans(rays, body_boxes(poses, body.skinning)).met)[:, 0]
    return torch.zeros(len(rays), count).index_put((met,), optical.reshape(-1, count))


def by_place(marched: Marched, body: Body, rays: Rays, poses: Poses, count: int) -> torch.Tensor:
    """Optical depths (rays, count) of what was marched without jitter."""
    spans = box_spans(rays, body_boxes(poses, body.skinning))
    ray = marched.samples.ray
    place = ((marched.samples.depth - spans.near[ray]) / marched.samples.length).floor().long()
    return torch.zeros(len(rays), count).index_put((ray, place), marched.optical)


def around(poses: Poses, frames: int, count: int, seed: int = 0) -> Rays:
    """Rays from all sides towards bodies, each frame's in turn."""
    rng = np.random.default_rng(seed)
    frame = np.arange(count) % frames
    targets = poses.joints[frame, rng.integers(0, poses.joints.shape[1], count)].numpy()
    targets = targets + rng.normal(scale=0.15, size=(count, 3))
    return rays_towards(targets + 6 * rng.normal(size=(count, 3)), targets, frame)


@pytest.mark.parametrize("name", SKELETONS)
def test_samples_are_those_of_one_ray_and_one_sample_at_a_time(name: str) -> None:
    body = small_body(name, cells=8)
    grids, poses = lumpy_grids(body, thick=0.2), bent(load_skeleton(name), 2, size=1.1)
    rays = around(poses, 2, 16)
    marched = body.march(rays, poses, grids, count=9, jitter=None)
    values = torch.einsum("sc,scv->sv", marched.shares, grids.values[marched.rows])
    dress = Undressed(stylist=None, style=np.zeros(0), per_cell=True)  # type: ignore[arg-type]  # nothing is dressed
    found = 0
    for number, ray in enumerate(single_rays(rays)):
        own = torch.nonzero(marched.samples.ray == number)[:, 0]
        expected = body_seen(ray, body, grids, poses, dress, 9, 0)
        assert len(own) == len(expected)
        found += len(own)
        for place, seen in zip(own.tolist(), expected, strict=True):
            assert float(marched.samples.depth[place]) == pytest.approx(seen.depth, abs=1e-4)
            assert float(-torch.expm1(-marched.optical[place])) == pytest.approx(seen.hidden, abs=1e-3)
            np.testing.assert_allclose(values[place], seen.features, atol=1e-3)
    assert found > 15 and marched.looked_at < 16 * 9


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("jittered", [False, True])
def test_skipping_empty_space_and_cutting_into_pieces_change_nothing(
    name: str, jittered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = small_body(name, cells=12)
    grids, poses = lumpy_grids(body), bent(load_skeleton(name), 3, seed=2)
    rays = around(poses, 3, 120)
    jitter = torch.rand(120, 16, generator=torch.Generator().manual_seed(0)) if jittered else None
    expected = dense_march(body, rays, poses, grids, 16, jitter)
    marched = body.march(rays, poses, grids, count=16, jitter=jitter)
    rows = marched.samples.ray
    total = torch.zeros(120).index_add(0, rows, marched.optical)
    np.testing.assert_allclose(total, expected.sum(dim=1), atol=2e-3, rtol=1e-3)
    assert int((expected > 0).sum()) - len(rows) in range(-5, 6)  # rounding, at the very edge of a cell
    if not jittered:
        np.testing.assert_allclose(by_place(marched, body, rays, poses, 16), expected, atol=2e-3)
    assert len(rows) <= marched.looked_at < 0.6 * int((expected >= 0).sum())
    monkeypatch.setattr(bodies, "SAMPLES_AT_ONCE", 16 * 50)
    pieces = body.march(rays, poses, grids, count=16, jitter=jitter)
    order, other = torch.argsort(rows, stable=True), torch.argsort(pieces.samples.ray, stable=True)
    for one, two in (
        (marched.samples.ray, pieces.samples.ray),
        (marched.samples.depth, pieces.samples.depth),
        (marched.optical, pieces.optical),
        (marched.rows, pieces.rows),
        (marched.shares, pieces.shares),
    ):
        torch.testing.assert_close(one[order], two[other], atol=2e-4, rtol=1e-3)


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("size", [1.0, 1.25])
def test_no_density_lies_outside_the_boxes_of_bodies(name: str, size: float) -> None:
    body = small_body(name)
    grids, poses = body.grids(), bent(load_skeleton(name), 3, seed=4, size=size, bend=0.9)
    boxes = body_boxes(poses, body.skinning)
    rng = np.random.default_rng(0)
    for frame in range(3):
        low, high = boxes.low[frame].numpy(), boxes.high[frame].numpy()
        points = torch.tensor(rng.uniform(low - 0.6, high + 0.6, (2500, 3))).float()
        kept, _, share = body.skinning.to_rest(points, poses, frame, grids.weights)
        held = points[kept[share > 1e-4]]
        assert len(held) > 80
        assert ((held >= boxes.low[frame]) & (held <= boxes.high[frame])).all()
        # Nor are they much larger than what they hold.
        assert float((held.amin(dim=0) - boxes.low[frame]).amax()) < 0.8


def test_rays_of_several_frames_meet_only_their_own_body() -> None:
    body = small_body("blocks13")
    grids, poses = lumpy_grids(body), bent(load_skeleton("blocks13"), 3)
    shifted = [Poses(**{name: values[n : n + 1] for name, values in vars(poses).items()}) for n in range(3)]
    rays = around(poses, 3, 90)
    order = torch.randperm(90, generator=torch.Generator().manual_seed(0))
    together = body.march(rays[order], poses, grids, count=8, jitter=None)
    total = torch.zeros(90).index_add(0, order[together.samples.ray], together.optical)
    for frame, alone in enumerate(shifted):
        own = torch.nonzero(rays.frame == frame)[:, 0]
        one = rays[own]
        one = Rays(**{**vars(one), "frame": torch.zeros_like(one.frame)})
        marched = body.march(one, alone, grids, count=8, jitter=None)
        expected = torch.zeros(len(own)).index_add(0, marched.samples.ray, marched.optical)
        torch.testing.assert_close(total[own], expected, atol=1e-3, rtol=1e-3)
        assert float(expected.sum()) > 0


def test_ten_players_are_marched_each_in_its_own_place() -> None:
    body, skeleton = small_body("smpl24"), load_skeleton("smpl24")
    grids = lumpy_grids(body)
    rotations = np.zeros((1, 24, 3))
    rotations[0, 0] = [np.pi / 2, 0, 0]
    camera = looking([0.0, -14.0, 1.0], [0.0, 0.0, 1.0], focal=60.0, size=(96, 24))
    rays = camera_rays(camera, picture_pixels(96, 24))
    middles = []
    for number in range(10):
        translations = np.array(skeleton.rest_translations[None])
        translations[0, 0] = [-9.0 + 2.0 * number, 0.0, 0.95]
        marched = body.march(rays, poses_of(skeleton, rotations, translations), grids, count=12, jitter=None)
        points = rays[marched.samples.ray].at(marched.samples.depth)
        assert len(points) > 3 and float((points[:, 0] - translations[0, 0, 0]).abs().max()) < 1.2
        middles.append(float(points[:, 0].mean()))
    assert np.all(np.diff(middles) > 1.0)


def test_missing_bodies_bodies_out_of_view_and_no_rays_give_nothing() -> None:
    body, skeleton = small_body("smpl24"), load_skeleton("smpl24")
    grids = body.grids()
    camera = looking([0.0, -8.0, 1.0], [0.0, 0.0, 1.0])
    rays = camera_rays(camera, picture_pixels(16, 12, left=24, top=18))
    away = camera_rays(looking([0.0, -8.0, 1.0], [0.0, -20.0, 1.0]), picture_pixels(16, 12))
    poses = bent(skeleton, 1)
    assert len(body.march(rays, poses, grids, count=4, jitter=None).samples)
    missing = poses_of(skeleton, np.full((1, 24, 3), np.nan), np.full((1, 24, 3), np.nan))
    for found in (
        body.march(rays, missing, grids, count=4, jitter=None),
        body.march(away, poses, grids, count=4, jitter=None),
        body.march(rays[torch.zeros(0, dtype=torch.int64)], poses, grids, count=4, jitter=None),
        body.march(rays, poses, BodyGrids(**{**vars(grids), "density": grids.density - 99}), count=4, jitter=None),
    ):
        assert len(found.samples) == len(found.optical) == 0 and found.rows.shape == found.shares.shape == (0, 8)
        assert found.looked_at == 0


def test_a_body_missing_in_some_frames_is_marched_in_the_others() -> None:
    body = small_body("blocks13")
    grids, poses = body.grids(), bent(load_skeleton("blocks13"), 2)
    gone = Poses(**{name: values.clone() for name, values in vars(poses).items()})
    for values in vars(gone).values():
        values[0] = torch.nan
    rays = around(poses, 2, 40)
    marched = body.march(rays, gone, grids, count=6, jitter=None)
    assert set(rays.frame[marched.samples.ray].tolist()) == {1}


def test_a_camera_inside_a_body_sees_it() -> None:
    body, poses = small_body("smpl24"), bent(load_skeleton("smpl24"), 1)
    camera = looking(poses.joints[0, 0].tolist(), (poses.joints[0, 0] + torch.tensor([0.0, 1.0, 0.2])).tolist())
    rays = camera_rays(camera, picture_pixels(8, 6, left=28, top=21))
    marched = body.march(rays, poses, body.grids(), count=12, jitter=None)
    assert set(marched.samples.ray.tolist()) == set(range(48))
    assert torch.isfinite(marched.optical).all() and float(marched.samples.depth.min()) < 0.2


def test_density_beyond_all_bounds_is_opaque_and_finite_density_is_what_the_scale_says() -> None:
    body, poses = small_body("blocks13"), bent(load_skeleton("blocks13"), 1)
    grids = body.grids()
    solid = BodyGrids(**{**vars(grids), "density": torch.full_like(grids.density, 3e38)})
    marched = body.march(around(poses, 1, 30), poses, solid, count=6, jitter=None)
    assert len(marched.samples) and (marched.optical > 1e30).all()
    np.testing.assert_allclose(
        density_of(torch.tensor([1.0, 20.0])), DENSITY_SCALE * np.log1p(np.exp([1.0, 20.0])), rtol=1e-5
    )
    assert density_of(torch.tensor([-20.0, -torch.inf])).tolist() == [0.0, 0.0]
    assert float(density_of(torch.tensor(torch.inf))) == np.inf


def test_gradients_reach_all_networks_of_a_body() -> None:
    torch.manual_seed(0)
    body = Body(load_skeleton("blocks13"), (8, 8, 8), 3, width=8, seed=0)
    grids, poses = body.grids(), bent(load_skeleton("blocks13"), 2)
    marched = body.march(around(poses, 2, 60), poses, grids, count=8, jitter=None)
    (marched.optical.sum() + (marched.shares[:, :, None] * grids.values[marched.rows]).sum()).backward()
    for name, parameter in body.named_parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all(), name
        assert float(parameter.grad.abs().sum()) > 0 or "skinning" in name, name
    bias = body.skinning.grown.out.bias
    assert bias is not None and bias.grad is not None and float(bias.grad.abs().sum()) > 0


def test_gradients_of_optical_depth_are_those_of_differences() -> None:
    body = small_body("blocks13", cells=6).double()
    grids, poses = lumpy_grids(body, thick=0.25), bent(load_skeleton("blocks13"), 1)
    wide = Poses(**{name: values.double() for name, values in vars(poses).items()})
    rays = around(poses, 1, 12)
    rays = Rays(**{name: v.double() if v.is_floating_point() else v for name, v in vars(rays).items()})
    density = grids.density.double().requires_grad_(True)
    weights = grids.weights.double().requires_grad_(True)
    values = grids.values.double()

    def optical(density: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        own = BodyGrids(density=density, values=values, weights=weights * body.skinning.support)
        return body.march(rays, wide, own, count=8, jitter=None).optical

    assert len(optical(density, weights)) > 20
    assert torch.autograd.gradcheck(optical, (density, weights), fast_mode=True, atol=1e-4)


def test_bodies_survive_being_saved_and_loaded() -> None:
    body, other = small_body("smpl24", seed=0), small_body("smpl24", seed=1)
    support = body.skinning.support.clone()
    support[:, 5] = False
    body.skinning.confine(support)
    other.load_state_dict(body.state_dict())
    poses = bent(load_skeleton("smpl24"), 1)
    rays = around(poses, 1, 40)
    one, two = (each.march(rays, poses, each.grids(), count=6, jitter=None) for each in (body, other))
    torch.testing.assert_close(one.optical, two.optical)
    assert (other.skinning.support == support).all() and len(one.optical)


def test_pictures_of_4k_take_little_memory_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """No step is given more samples than it should be, whatever the size of the picture."""
    body, poses = small_body("blocks13"), bent(load_skeleton("blocks13"), 1)
    camera = looking([0.0, -6.0, 1.0], poses.joints[0, 0].tolist(), focal=3000.0, size=(3840, 2160))
    rows = [camera_rays(camera, picture_pixels(240, 1, left=1800, top=top)) for top in range(900, 1300, 40)]
    rays = joined_rays(rows)
    seen = []
    original = bodies.uniform_samples

    def counted(spans, count, *, jitter=None):
        seen.append(len(spans.near) * count)
        return original(spans, count, jitter=jitter)

    monkeypatch.setattr(bodies, "uniform_samples", counted)
    monkeypatch.setattr(bodies, "SAMPLES_AT_ONCE", 1 << 12)
    marched = body.march(rays, poses, lumpy_grids(body), count=24, jitter=None)
    assert len(rays) * 24 > 7 * (1 << 12) and len(seen) > 4
    assert max(seen) <= 1 << 12 and len(marched.samples) > 500


def test_drawn_numbers_are_the_same_each_time() -> None:
    torch.testing.assert_close(drawn(3, seed=4), drawn(3, seed=4))
    assert array(drawn(2)).dtype == np.float64
