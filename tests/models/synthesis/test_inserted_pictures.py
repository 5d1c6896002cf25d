"""Meshes in rendered pictures: composed with everything else by depth, and kept from the enhancer."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_models.synthesis import renderer
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import States, Wardrobe
from pgm_models.synthesis.insertions import Insertion, Placed, fixed_in_world, inserted_mesh, placed_meshes
from pgm_models.synthesis.meshes import DistanceGrid
from pgm_models.synthesis.model import ModelOptions, SynthesisModel
from pgm_models.synthesis.presets import EnhancerOptions, StyleOptions
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.skinning import Poses
from pgm_models.synthesis.studio import Studio
from tests.models.synthesis.slow_renderer import slow_picture
from tests.models.synthesis.test_renderer import fields_of, options, rays_at
from tests.models.synthesis.toy_bodies import bent, drawn, looking

CAMERA = [0.6, -9.0, 2.2]


def rod(player: str = "", joint: int = 0, t=(0.0, 0.0, 0.0), *, density: float = 1e4) -> Insertion:
    """A round bar 0.8 m long and 12 cm thick along x, by its closed form."""
    axes = [np.linspace(-half, half, round(2 * half / 0.04) + 1) for half in (0.48, 0.12, 0.12)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    distance = np.maximum(np.hypot(y, z) - 0.06, np.abs(x) - 0.4)
    grid = DistanceGrid(low=np.array([axis[0] for axis in axes]), cell=0.04, distance=distance)
    mesh = inserted_mesh(grid, colour=(0.9, 0.1, 0.2), density=density)
    return Insertion(meshes=(mesh,), player=player, joint=joint, R=np.eye(3), t=np.array(t))


def apart(poses: Poses, by: list[float]) -> Poses:
    moved = torch.tensor(by)
    return replace(poses, translation=poses.translation - poses.rotation @ moved, joints=poses.joints + moved)


def tennis() -> tuple:
    fields, grids = fields_of("tennis", "grid")
    skeleton = fields.scene.players[0].skeleton
    assert skeleton is not None
    poses = bent(skeleton, 2, seed=0)
    balls = Balls(position=torch.full((2, 3), torch.nan), path=torch.zeros(2, 3), radius=0.0335)
    states = States(poses={"player0": poses, "player1": apart(poses, [0.3, 0.8, 0.0])}, balls=balls)
    return fields, grids, states, drawn(2, len(fields.scene.objects), 3, seed=3)


def test_meshes_are_composed_as_one_ray_one_object_and_one_sample_at_a_time_say() -> None:
    fields, grids, states, styles = tennis()
    inserted = [rod("player0", 21, density=20.0), rod(t=(0.0, 1.5, 1.0))]
    placed = placed_meshes(inserted, states.poses, 2)
    rng = np.random.default_rng(0)
    frames = np.arange(24) % 2
    hands = states.poses["player0"].joints[frames, 21].numpy()
    targets = hands + rng.normal(scale=0.12, size=(24, 3))
    targets[16:] = rng.uniform([-0.4, 1.5, 0.9], [0.4, 1.5, 1.1], size=(8, 3))
    rays = rays_at(targets, frames, CAMERA)
    found = render(rays, fields, grids, states, Wardrobe(fields, grids, styles), inserted=placed)
    expected = slow_picture(rays, fields, grids, states, styles, placed)
    assert found.inserted is not None
    np.testing.assert_allclose(found.inserted, expected.inserted, atol=1e-4)
    np.testing.assert_allclose(found.features, expected.features, atol=1e-4)
    np.testing.assert_allclose(found.shares, expected.shares, atol=1e-4)
    np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-4)
    both = (expected.inserted > 0.02) & (expected.shares[:, :2].max(axis=1) > 0.02)
    assert both.any() and ((expected.inserted > 0.02) & (expected.inserted < 0.98)).sum() > 5
    some = torch.arange(5, 20)
    near = [replace(each, near=some) for each in placed]
    fewer = render(rays, fields, grids, states, Wardrobe(fields, grids, styles), inserted=near)
    assert fewer.inserted is not None
    assert torch.equal(fewer.inserted[some], found.inserted[some]) and not fewer.inserted[:5].any()


def test_a_mesh_behind_a_player_is_hidden_and_one_in_front_hides() -> None:
    fields, grids, states, styles = tennis()
    thick = {key: replace(each, density=each.density.clamp(min=-30) + 30) for key, each in grids.bodies.items()}
    grids = replace(grids, bodies=thick)
    chest = states.poses["player0"].joints[:1, 9].numpy()
    rays = rays_at(chest, np.zeros(1, dtype=int), CAMERA)
    alone = render(rays, fields, grids, states, Wardrobe(fields, grids, styles))
    assert alone.inserted is None and float(alone.shares[0, 0]) > 0.99
    away = (chest[0] - CAMERA) / np.linalg.norm(chest[0] - CAMERA)
    for metres, seen in ((2.0, 0.0), (-2.0, 1.0)):
        placed = placed_meshes([rod(t=tuple(chest[0] + metres * away))], states.poses, 2)
        found = render(rays, fields, grids, states, Wardrobe(fields, grids, styles), inserted=placed)
        assert found.inserted is not None and float(found.inserted[0]) == pytest.approx(seen, abs=1e-4)
    assert float(found.shares[0, 0]) < 1e-4
    torch.testing.assert_close(found.features[0, :3], torch.tensor([0.9, 0.1, 0.2]))


def test_nothing_is_computed_when_none_is_inserted(monkeypatch: pytest.MonkeyPatch) -> None:
    model, states, camera = small_model()
    studio = Studio(model, drawn(1, len(model.scene.objects), 3), 40, 30)
    rgb = studio.picture(camera, states).rgb

    def never(*args: object, **keywords: object) -> None:
        raise AssertionError("a mesh was looked for")

    monkeypatch.setattr(renderer, "march_mesh", never)
    monkeypatch.setattr("pgm_models.synthesis.studio.with_kept", never)
    again = studio.picture(camera, states)
    assert again.inserted is None and torch.equal(again.rgb, rgb)
    gone = studio.picture(camera, States(poses={}, balls=None), [rod("player0", 21)])
    assert gone.inserted is None


def small_model() -> tuple:
    torch.manual_seed(0)
    made = ModelOptions(
        scene="tennis",
        fields=options("grid"),
        enhancer=EnhancerOptions(widths=(4, 8)),
        style=StyleOptions(widths=(4, 8), crop=8),
        picture=(40, 30),
        seed=0,
    )
    model = SynthesisModel(made).requires_grad_(False)
    assert model.enhancer is not None
    model.enhancer.outward.weight.normal_(std=0.3)
    skeleton = model.scene.players[0].skeleton
    assert skeleton is not None
    poses = bent(skeleton, 1, seed=0)
    return model, States(poses={"player0": poses}, balls=None), looking(CAMERA, [0.0, 0.0, 1.0], 150.0, (40, 30))


def test_in_a_picture_the_mesh_keeps_its_colour_and_the_rest_is_as_without_it() -> None:
    model, states, camera = small_model()
    studio = Studio(model, drawn(1, len(model.scene.objects), 3), 40, 30)
    free = studio.picture(camera, states)
    found = studio.picture(camera, states, [rod(t=(0.0, -3.0, 1.0))])
    assert found.inserted is not None
    whole = found.inserted > 0.999
    assert 5 < int(whole.sum()) < 200
    torch.testing.assert_close(found.rgb[:, whole], torch.tensor([[0.9], [0.1], [0.2]]).expand(3, int(whole.sum())))
    torch.testing.assert_close(found.shares.sum(dim=0) + found.inserted, free.shares.sum(dim=0))
    # The enhancer reads about the mesh: pixels beyond its reach are the same.
    far = torch.nn.functional.max_pool2d(found.inserted[None], 2 * model.enhancer.reach + 1, 1, model.enhancer.reach)[0]
    assert torch.equal(found.rgb[:, far == 0], free.rgb[:, far == 0]) and bool((far == 0).any())
    from_all = render(
        camera_rays(camera, picture_pixels(40, 30)), model.fields, studio.grids, states, studio.wardrobe,
        inserted=placed_meshes([rod(t=(0.0, -3.0, 1.0))], states.poses, 1),
    )  # fmt: skip
    assert from_all.inserted is not None
    assert torch.equal(from_all.inserted.reshape(30, 40), found.inserted)


def test_a_box_about_a_mesh_holds_all_of_it_in_every_frame() -> None:
    from pgm_data.geometry.rigid import rotation_from_rotvec

    turn = rotation_from_rotvec(np.array([0.4, -0.9, 1.3]))
    placement = fixed_in_world(turn, np.array([1.0, -2.0, 0.5]), 2)
    (mesh,) = rod().meshes
    boxes = Placed(mesh=mesh, placement=placement).boxes()
    ends = np.stack([mesh.low.numpy(), mesh.high.numpy()])
    corners = np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)]) @ turn.T
    corners += [1.0, -2.0, 0.5]
    np.testing.assert_allclose(boxes.low, np.tile(corners.min(axis=0), (2, 1)), atol=1e-5)
    np.testing.assert_allclose(boxes.high, np.tile(corners.max(axis=0), (2, 1)), atol=1e-5)
