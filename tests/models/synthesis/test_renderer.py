from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.scene import load_scene
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.bodies import Body
from pgm_models.synthesis.fields import Fields, Grids, States, Wardrobe
from pgm_models.synthesis.presets import FieldOptions
from pgm_models.synthesis.rays import Rays, camera_rays
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.stylists import Stylising
from pgm_models.synthesis.worlds import world_grids
from tests.models.synthesis.slow_renderer import slow_picture
from tests.models.synthesis.toy_bodies import bent, drawn, looking, lumpy_grids


def options(stylising: Stylising) -> FieldOptions:
    return FieldOptions(
        voxels=8,
        voxel_features=4,
        texels=8,
        texel_features=4,
        samples=6,
        width=4,
        features=6,
        style=3,
        stylising=stylising,
    )


def fields_of(scene: str, stylising: Stylising) -> tuple[Fields, Grids]:
    """Fields whose volumes hold something uneven, thick enough to hide some of what is behind and not all."""
    torch.manual_seed(0)
    fields = Fields(load_scene(scene), options(stylising), seed=0).requires_grad_(False)
    grids = fields.grids()
    bodies = {}
    for key, body in fields.bodies.items():
        assert isinstance(body, Body)
        bodies[key] = lumpy_grids(body, thick=0.2)
    worlds = {}
    for key, world in grids.worlds.items():
        raw = torch.where(drawn(len(world.density), 1, seed=5) > -0.3, -5.0, -12.0)
        worlds[key] = world_grids(raw, world.values, fields.worlds[key].size)  # type: ignore[union-attr]
    return fields, replace(grids, bodies=bodies, worlds=worlds)


def rays_at(targets: np.ndarray, frames: np.ndarray, position: list[float]) -> Rays:
    """Rays from a camera to points."""
    from pgm_data.geometry.camera import project
    from pgm_models.synthesis.rays import joined_rays

    camera = looking(position, targets.mean(axis=0).tolist(), focal=250.0)
    pixels, seen = project(camera, targets)
    assert seen.all()
    parts = [camera_rays(camera, pixels[number : number + 1], frame=int(frame)) for number, frame in enumerate(frames)]
    return joined_rays(parts)


def agree(rays: Rays, fields: Fields, grids: Grids, states: States, styles: torch.Tensor) -> np.ndarray:
    """Shares of the objects, found equal by both renderers."""
    found = render(rays, fields, grids, states, Wardrobe(fields, grids, styles))
    expected = slow_picture(rays, fields, grids, states, styles)
    # The slow one looks for the ball at so many places only.
    there = np.array([thing.kind == "ball" for thing in fields.scene.objects])
    beside = (expected.shares[:, there] == 0).all(axis=1)
    np.testing.assert_allclose(found.shares[beside], expected.shares[beside], atol=1e-4)
    np.testing.assert_allclose(found.features[beside], expected.features[beside], atol=1e-4)
    np.testing.assert_allclose(found.shares, expected.shares, atol=1e-3)
    np.testing.assert_allclose(found.features, expected.features, atol=2e-3)
    endless = np.isinf(expected.depth)
    assert (torch.isinf(found.depth).numpy() == endless).all()
    np.testing.assert_allclose(found.depth[~endless], expected.depth[~endless], rtol=1e-4)
    return expected.shares


@pytest.mark.parametrize("stylising", ["grid", "sample"])
def test_tennis_is_rendered_as_one_ray_one_object_and_one_sample_at_a_time_say(stylising: Stylising) -> None:
    fields, grids = fields_of("tennis", stylising)
    skeleton = fields.scene.players[0].skeleton
    assert skeleton is not None
    one, other = bent(skeleton, 2, seed=0), bent(skeleton, 2, seed=0, bend=0.2)
    moved = torch.tensor([0.0, 0.6, 0.0])  # close behind the first, so that their boxes overlap
    other = replace(other, translation=other.translation - other.rotation @ moved, joints=other.joints + moved)
    balls = Balls(
        position=torch.tensor([[0.4, -1.2, 1.3], [torch.nan] * 3]), path=torch.tensor([[0.1, 0.0, 0.05], [0.0] * 3]),
        radius=0.0335,
    )  # fmt: skip
    states = States(poses={"player0": one, "player1": other}, balls=balls)
    rng = np.random.default_rng(0)
    frames = np.arange(26) % 2
    targets = one.joints[frames, rng.integers(0, 24, 26)].numpy() + rng.normal(scale=0.1, size=(26, 3))
    targets[:4] = np.array([0.4, -1.2, 1.3]) + rng.normal(scale=0.03, size=(4, 3))
    targets[4:10] = [
        [-4.11, -6.0, 0.0],
        [0.0, -6.37, 0.0],
        [0.0, 20.0, 3.0],
        [-4.09, 2.0, 0.0],
        [5.0, 4.0, 9.0],
        [1.0, 0.0, 0.6],
    ]
    rays = rays_at(targets, frames, [0.6, -9.0, 2.2])
    shares = agree(rays, fields, grids, states, drawn(2, len(fields.scene.objects), 3, seed=3))
    assert ((shares > 0.05) & (shares < 0.95)).sum() > 10 and (shares[:4, 2] > 0.01).any()
    assert (shares[:, 0] > 0.1).any() and (shares[:, 1] > 0.1).any()
    assert ((shares[:, 5] > 0.1) & (shares[:, 3:5].sum(axis=1) > 0.1)).any()  # the net, and what is behind it
    assert (((shares[:, :2] > 0.02).sum(axis=1)) == 2).any()


def test_a_net_hides_what_is_behind_it_as_far_as_its_style_says_and_nothing_before_it() -> None:
    fields, grids = fields_of("tennis", "grid")
    names = [thing.name for thing in fields.scene.objects]
    net, ball, court = (names.index(name) for name in ("net", "ball", "court"))
    styles = drawn(1, len(names), 3)
    targets = np.array([[0.5, 4.0, 0.0], [1.5, 4.0, 0.0]])
    rays = rays_at(targets, np.zeros(2, dtype=int), [1.0, -9.0, 2.0])
    last = fields.stylist("net").second
    with torch.no_grad():
        last.gain[-1] = 0.0
        fields.stylist("net").shift.weight[-1] = 0.0
    for hides in (0.0, 0.3, 1.0):
        with torch.no_grad():
            last.bias[-1] = torch.logit(torch.tensor(hides, dtype=torch.float64), eps=1e-30)
        for depth, behind in ((-2.0, False), (2.0, True)):
            share = (depth + 9.0) / 13.0  # of the way to the first target
            at = torch.tensor([[1.0 - 0.5 * share, depth, 2.0 - 2.0 * share]], dtype=torch.float32)
            states = States(poses={}, balls=Balls(position=at, path=torch.zeros(1, 3), radius=0.2))
            seen = render(rays, fields, grids, states, Wardrobe(fields, grids, styles))
            expected = np.zeros((2, len(names)))
            expected[0, [net, ball]] = (hides, 1 - hides) if behind else (0.0, 1.0)
            expected[1, [net, court]] = (hides, 1 - hides)
            np.testing.assert_allclose(seen.shares.numpy(), expected, atol=1e-5)
            reached = rays.at(seen.depth).numpy()[1]
            np.testing.assert_allclose(reached[1], 4.0 * (1 - hides), atol=1e-3)  # the mean of net and court


def test_blocks_are_rendered_as_one_ray_one_object_and_one_sample_at_a_time_say() -> None:
    fields, grids = fields_of("blocks", "grid")
    skeleton = fields.scene.players[0].skeleton
    assert skeleton is not None
    poses = bent(skeleton, 1)
    rng = np.random.default_rng(1)
    targets = poses.joints[0, rng.integers(0, 13, 30)].numpy() + rng.normal(scale=0.15, size=(30, 3))
    targets[:3] = [[-2.0, 5.0, 9.0], [-1.0, 3.0, 7.0], [0.5, -1.0, 0.5]]
    rays = rays_at(targets, np.zeros(30, dtype=int), [3.0, -6.0, 3.0])
    states = States(poses={"player0": poses}, balls=None)
    shares = agree(rays, fields, grids, states, drawn(1, 3, 3, seed=3))
    assert (shares.max(axis=0) > 0.05).all(), shares.max(axis=0)


def test_an_empty_scene_shows_what_is_behind_and_nothing_where_there_is_nothing() -> None:
    fields, grids = fields_of("tennis", "grid")
    skeleton = fields.scene.players[0].skeleton
    assert skeleton is not None
    poses = bent(skeleton, 1)
    gone = replace(poses, **{name: torch.full_like(values, torch.nan) for name, values in vars(poses).items()})
    states = States(poses={"player0": gone, "player1": gone}, balls=None)
    targets = np.array([[0.0, 1.0, 0.0], [3.0, -2.0, 0.0], [0.0, -9.0, 12.0]])
    rays = rays_at(targets[:2], np.zeros(2, dtype=int), [0.0, -9.0, 4.0])
    styles = drawn(1, len(fields.scene.objects), 3)
    shares = agree(rays, fields, grids, states, styles)
    assert (shares.sum(axis=1) == 1).all()
    up = rays[torch.tensor([0])]
    up = replace(up, direction=torch.tensor([[0.0, 0.0, 1.0]]))
    seen = render(up, fields, grids, states, Wardrobe(fields, grids, styles))
    assert torch.isinf(seen.depth).all() and (seen.features == 0).all() and (seen.shares == 0).all()
