"""Fields that networks compute at each sample, and the network that deforms: against direct evaluations, and laws."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.scene import load_scene
from pgm_data.skeleton import load_skeleton
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.bodies import THIN, Body, body_boxes, density_of
from pgm_models.synthesis.boxes import Boxes, box_spans
from pgm_models.synthesis.deformations import PoseNetwork, joint_turns, limb_boxes
from pgm_models.synthesis.fields import BakedWardrobe, Fields, States, Wardrobe
from pgm_models.synthesis.place_networks import PlaceNetwork
from pgm_models.synthesis.presets import FieldOptions, SynthesisDesign
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.samples import uniform_samples
from pgm_models.synthesis.skinning import Poses, Skinning, poses_of, rest_joints
from pgm_models.synthesis.surfaces import Plane
from tests.models.synthesis.toy_bodies import UPRIGHT, bent, drawn, rays_towards

SKELETONS = ["smpl24", "blocks13"]
OPTIONS = FieldOptions(
    voxels=8, voxel_features=4, texels=8, texel_features=4, samples=6, width=4, features=6, style=3, world_samples=6
)
COMPUTED = SynthesisDesign(volumes="mlp", planes="mlp")


def fields_of(scene: str, design: SynthesisDesign) -> Fields:
    """Untrained, but thick enough to be seen, and uneven."""
    torch.manual_seed(0)
    fields = Fields(load_scene(scene), OPTIONS, seed=0, design=design).requires_grad_(False)
    for module in fields.modules():
        if isinstance(module, PlaceNetwork):
            module.out.weight.mul_(4.0)
    return fields


def standing(name: str, *, size: float = 1.0, turn: float = 0.0, at: tuple[float, float, float] = (0, 0, 1.0)) -> Poses:
    """One body in its rest pose, moved and turned as a whole."""
    skeleton = load_skeleton(name)
    rotations = np.zeros((1, len(skeleton.parents), 3))
    stand = rotation_from_rotvec(np.array([0.0, 0.0, turn])) @ rotation_from_rotvec(UPRIGHT)
    rotations[:, 0] = rotvec_from_rotation(stand)
    translations = skeleton.rest_translations[None] * size
    translations[:, 0] = at
    return poses_of(skeleton, rotations, translations)


def towards(poses: Poses, count: int, seed: int = 0) -> Rays:
    """Rays from one side towards the joints of the first frame."""
    rng = np.random.default_rng(seed)
    targets = poses.joints[0, rng.integers(0, poses.joints.shape[1], count)].numpy() + rng.normal(0, 0.1, (count, 3))
    return rays_towards(targets + np.array([0.5, -6.0, 1.0]) + rng.normal(0, 0.2, (count, 3)), targets)


def test_a_place_network_is_layers_of_waves_written_out() -> None:
    torch.manual_seed(0)
    network = PlaceNetwork(2, 3, width=2, waves=3, told=2)
    places, told = torch.rand(5, 2), torch.randn(2)
    with torch.no_grad():
        found = network(places, told).numpy()
    for place, values in zip(places.numpy().astype(np.float64), found, strict=True):
        waves = [2 * np.pi * 2**k * x for x in place for k in range(3)]
        here = np.array([*(2 * place - 1), *np.sin(waves), *np.cos(waves), *told.numpy()])
        for layer in network.layers:
            here = layer.weight.detach().numpy() @ here + layer.bias.detach().numpy()
            here = here / (1 + np.exp(-here))
        expected = network.out.weight.detach().numpy() @ here + network.out.bias.detach().numpy()
        np.testing.assert_allclose(values, expected, atol=1e-5)


@pytest.mark.parametrize("deformation", ["skinning", "mlp"])
def test_a_computed_body_is_its_network_at_every_sample_in_its_rest_pose(deformation) -> None:
    body = fields_of("blocks", replace(COMPUTED, deformation=deformation)).body("blocks13")
    if isinstance(body.skinning, PoseNetwork):
        body.skinning.offset.out.weight.copy_(0.1 * drawn(*body.skinning.offset.out.weight.shape))
    poses = bent(load_skeleton("blocks13"), 1)
    rays, grids = towards(poses, 30), body.grids()
    marched = body.march(rays, poses, grids, count=6, jitter=None)
    samples = uniform_samples(box_spans(rays, body_boxes(poses, body.skinning)), 6)
    found = {(ray, round(depth, 4)): k for k, (ray, depth) in enumerate(zip(*_told(marched.samples), strict=True))}
    seen = 0
    for ray, depth, length in zip(*_told(samples), samples.length.tolist(), strict=True):
        point = (rays.origin[ray] + depth * rays.direction[ray])[None]
        if isinstance(body.skinning, Skinning):
            kept, rest, share = body.skinning.to_rest(point, poses, 0, grids.weights)
        else:
            kept, rest = body.skinning.to_rest(point, poses, 0)
            share = torch.ones(len(kept))
        told = body.grown(body.skinning.places(rest))
        optical = density_of(told[:, 0]) * share * length
        if len(kept) and float(optical) > 2 * THIN * length:
            own = found.pop((ray, round(depth, 4)))
            torch.testing.assert_close(marched.optical[own], optical[0], rtol=1e-3, atol=1e-5)
            torch.testing.assert_close(marched.shares[own], told[0, 1:], rtol=1e-3, atol=1e-3)
            seen += 1
    assert seen > 30 and len(found) < 0.1 * seen


def _told(samples) -> tuple[list, list]:
    return samples.ray.tolist(), samples.depth.tolist()


def test_a_computed_world_is_its_network_at_every_sample_of_its_box() -> None:
    world = fields_of("blocks", COMPUTED).world("world")
    rng = np.random.default_rng(0)
    middle = ((world.low + world.high) / 2).numpy()
    rays = rays_towards(middle + rng.normal(0, 60, (40, 3)), middle + rng.normal(0, 5, (40, 3)))
    jitter = torch.rand(40, 5, generator=torch.Generator().manual_seed(0))
    marched = world.march(rays, world.grids(), count=5, jitter=jitter)
    spans = box_spans(rays, Boxes(low=world.low[None], high=world.high[None]))
    optical, values = torch.zeros(40), torch.zeros(40, 4)
    for ray in torch.nonzero(spans.met)[:, 0].tolist():
        length = float(spans.far[ray] - spans.near[ray]) / 5
        for place in range(5):
            depth = float(spans.near[ray]) + length * (place + float(jitter[ray, place]))
            point = rays.origin[ray] + depth * rays.direction[ray]
            told = world.network(((point - world.low) / (world.high - world.low))[None])[0]
            optical[ray] += density_of(told[0]) * length
            values[ray] += told[1:] * (density_of(told[0]) > 0)
    assert marched.looked_at == 5 * int(spans.met.sum()) > 0
    torch.testing.assert_close(
        optical, torch.zeros(40).index_add(0, marched.samples.ray, marched.optical), rtol=1e-3, atol=1e-4
    )
    torch.testing.assert_close(
        values, torch.zeros(40, 4).index_add(0, marched.samples.ray, marched.shares), rtol=1e-3, atol=1e-3
    )


def test_a_computed_plane_and_sky_are_their_networks_where_a_ray_meets_them() -> None:
    fields = fields_of("blocks", COMPUTED)
    rays = rays_towards(np.zeros((20, 3)) + [0, 0, 5.0], np.random.default_rng(0).normal(0, 9, (20, 3)))
    for name in fields.skies:
        met = fields.surface(name).meet(rays)
        torch.testing.assert_close(met.shares, fields.surface(name).grown(0.5 + 0.5 * rays.direction))
    court = fields_of("tennis", COMPUTED).surface("court")
    assert isinstance(court, Plane)
    rays = rays_towards(np.zeros((20, 3)) + [0, -20, 5.0], np.random.default_rng(0).normal(0, 4, (20, 3)) * [1, 1, 0])
    met = court.meet(rays)
    low, high = np.array(load_scene("tennis").objects[3].region_m)[:, :2]
    assert bool(met.met.all())
    for ray in range(20):
        depth = -float(rays.origin[ray, 2] / rays.direction[ray, 2])
        place = ((rays.origin[ray] + depth * rays.direction[ray]).numpy()[:2] - low) / (high - low)
        told = court.grown(torch.as_tensor(place, dtype=torch.float32)[None])[0]
        torch.testing.assert_close(met.shares[ray], told, rtol=1e-3, atol=1e-3)


def test_what_is_computed_is_dressed_as_it_is_by_the_stylist_baked_or_not() -> None:
    fields = fields_of("tennis", SynthesisDesign(volumes="mlp"))
    grids, styles = fields.grids(), drawn(1, len(fields.scene.objects), 3)
    values = drawn(7, 4, seed=1)
    rows, frame = torch.zeros(7, 4, dtype=torch.int64), torch.zeros(7, dtype=torch.int64)
    expected = fields.stylist("player0")(values, frame, styles[:, 0])
    for wardrobe in (Wardrobe, BakedWardrobe):
        torch.testing.assert_close(wardrobe(fields, grids, styles).wear(0, rows, values, frame), expected)
    unit = grids.values(fields.key_of["player0"])  # as a table is mixed
    torch.testing.assert_close(values @ unit, values)


def test_gradients_reach_every_network_of_what_is_computed() -> None:
    fields = fields_of("tennis", replace(COMPUTED, deformation="mlp")).requires_grad_(True)
    poses = bent(load_skeleton("smpl24"), 1)
    body = fields.body("smpl24")
    assert isinstance(body.skinning, PoseNetwork)
    with torch.no_grad():
        body.skinning.offset.out.weight.add_(0.01)
    styles = drawn(1, len(fields.scene.objects), 3).requires_grad_(True)
    balls = Balls(position=torch.full((1, 3), torch.nan), path=torch.zeros(1, 3), radius=0.03)
    grids = fields.grids()
    states = States(poses={"player0": poses, "player1": poses}, balls=balls)
    seen = render(towards(poses, 40), fields, grids, states, Wardrobe(fields, grids, styles))
    seen.features.square().sum().backward()
    for name, parameter in body.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name


def test_the_pose_network_moves_nothing_untrained_wherever_the_body_stands_and_however_large_it_is() -> None:
    torch.manual_seed(0)
    network = PoseNetwork(load_skeleton("smpl24"), width=4)
    places = torch.rand(50, 3, generator=torch.Generator().manual_seed(1)) * 0.9 + 0.05
    rest = network.low + places * (network.high - network.low)
    for poses in (standing("smpl24"), standing("smpl24", size=1.3, turn=2.0, at=(5.0, -9.0, 1.2))):
        R, t, scale = poses.rotation[0, 0], poses.translation[0, 0], poses.scale[0]
        world = (rest - t) @ R / scale**2
        kept, found = network.to_rest(world, poses, 0)
        assert len(kept) == 50
        torch.testing.assert_close(found, rest, atol=1e-4, rtol=0)
        # All joints go along with the root in this pose.
        torch.testing.assert_close(joint_turns(poses, 0), torch.zeros(24, 12), atol=1e-5, rtol=0)
    with torch.no_grad():
        beyond = (network.high + 0.1 - t) @ R / scale**2
        assert not len(network.to_rest(beyond[None], poses, 0)[0])


def test_the_code_of_a_pose_tells_limbs_and_neither_place_nor_direction_nor_size() -> None:
    skeleton = load_skeleton("blocks13")
    rng = np.random.default_rng(0)
    rotations = rng.normal(0, 0.5, (1, 13, 3))
    other = rotations.copy()
    other[:, 0] = rng.normal(size=3)
    translations = skeleton.rest_translations[None] * 1.0
    moved = 1.7 * translations
    moved[:, 0] = [30.0, -4.0, 2.0]
    one, same = poses_of(skeleton, rotations, translations), poses_of(skeleton, other, moved)
    torch.testing.assert_close(joint_turns(one, 0), joint_turns(same, 0), atol=1e-4, rtol=0)
    other[:, 5, 0] += 0.7
    changed = joint_turns(poses_of(skeleton, other, moved), 0) - joint_turns(one, 0)
    assert float(changed.abs().max()) > 0.1 and float(changed[0].abs().max()) < 1e-5


def test_gradients_of_where_points_go_reach_the_pose() -> None:
    torch.manual_seed(0)
    network = PoseNetwork(load_skeleton("blocks13"), width=4)
    with torch.no_grad():
        network.offset.out.weight.copy_(drawn(*network.offset.out.weight.shape))
    poses = bent(load_skeleton("blocks13"), 1)
    rotation = poses.rotation.clone().requires_grad_(True)
    _, rest = network.to_rest(poses.joints[0], replace(poses, rotation=rotation), 0)
    rest.sum().backward()
    assert rotation.grad is not None
    assert (rotation.grad[0].abs().amax(dim=(1, 2)) > 0).all()  # of every joint


@pytest.mark.parametrize("name", SKELETONS)
def test_limb_boxes_are_as_far_round_limbs_as_skinning_reaches(name: str) -> None:
    skeleton = load_skeleton(name)
    skinning = Skinning(skeleton, (24, 24, 24), width=4, seed=0)
    low, high = skinning.low.numpy(), skinning.high.numpy()
    boxes, step = limb_boxes(skeleton, low, high), (high - low) / 23
    assert (np.abs(boxes - skinning.reach.numpy()) <= 2 * step + 1e-6).all()
    assert (boxes[:, 0] <= rest_joints(skeleton)).all() and (boxes[:, 1] >= rest_joints(skeleton)).all()


def test_a_body_that_a_network_computes_needs_no_grid() -> None:
    body = Body(load_skeleton("blocks13"), (8, 8, 8), 4, width=4, seed=0, design=SynthesisDesign(volumes="mlp"))
    grids = body.grids()
    assert not (density_of(grids.density) > 0).any()
    assert grids.weights.shape == (512, 13)  # the weights are one
