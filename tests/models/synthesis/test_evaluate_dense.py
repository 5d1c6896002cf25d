"""The dense way against the renderer, and against the slow one."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.bodies import Body
from pgm_models.synthesis.evaluate_dense import SampleWardrobe, dense_picture, dense_samples, paper_picture
from pgm_models.synthesis.evaluate_efficiency import (
    Efficiency,
    EfficiencyOptions,
    Taken,
    camera_at,
    efficiency_from_json,
    efficiency_of,
)
from pgm_models.synthesis.fields import Fields, Grids, States, Wardrobe
from pgm_models.synthesis.model import ModelOptions, SynthesisModel
from pgm_models.synthesis.presets import PRESETS, EnhancerOptions, FieldOptions, StyleOptions, design_named
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.stylists import Stylising
from pgm_models.synthesis.worlds import StaticVolume, world_grids
from tests.models.synthesis.slow_renderer import slow_picture
from tests.models.synthesis.toy_bodies import bent, drawn, looking, lumpy_grids

SIZE = (16, 12)


def options(stylising: Stylising) -> FieldOptions:
    sizes = {"voxels": 8, "voxel_features": 4, "texels": 8, "texel_features": 4, "samples": 6, "width": 4}
    return FieldOptions(**sizes, features=6, style=3, stylising=stylising, world_samples=8)


def fields_of(scene: str, stylising: Stylising) -> tuple[Fields, Grids]:
    """Fields whose volumes hold something uneven."""
    torch.manual_seed(0)
    fields = Fields(load_scene(scene), options(stylising), seed=0).requires_grad_(False)
    grids = fields.grids()
    bodies, worlds = {}, {}
    for key, body in fields.bodies.items():
        assert isinstance(body, Body)
        bodies[key] = lumpy_grids(body, thick=0.2)
    for key, grid in grids.worlds.items():
        world = fields.world(key)
        assert isinstance(world, StaticVolume)
        raw = torch.where(drawn(len(grid.density), 1, seed=5) > 0.3, -4.0, -12.0)
        worlds[key] = world_grids(raw, grid.values, world.size)
    return fields, replace(grids, bodies=bodies, worlds=worlds)


def seen_by(scene: str, fields: Fields):
    """A camera close to a body, its rays, and one frame's states with a fast ball beside it."""
    skeletons = {player.name: player.skeleton for player in fields.scene.players}
    poses = {name: bent(skeleton, 1, seed=n) for n, (name, skeleton) in enumerate(skeletons.items()) if skeleton}
    target = next(iter(poses.values())).joints[0, 0].double().numpy()
    camera = looking((target + [1.0, -9.0, 1.5]).tolist(), target.tolist(), focal=60.0, size=SIZE)
    balls = None
    if fields.scene.ball is not None:
        at = torch.as_tensor(target + [0.4, -0.3, 0.2], dtype=torch.float32)[None]
        balls = Balls(position=at, path=torch.tensor([[0.3, 0.2, 0.1]]), radius=0.2)
        assert project(camera, at.double().numpy())[1].all()
    return camera, camera_rays(camera, picture_pixels(*SIZE)), States(poses=poses, balls=balls)


@pytest.mark.parametrize("scene, stylising", [("tennis", "grid"), ("tennis", "sample"), ("blocks", "grid")])
def test_the_dense_picture_is_the_renderers(scene, stylising):
    fields, grids = fields_of(scene, stylising)
    _, rays, states = seen_by(scene, fields)
    styles = drawn(1, len(fields.scene.objects), 3, seed=3)
    wardrobe = Wardrobe(fields, grids, styles)
    seen = render(rays, fields, grids, states, wardrobe)
    dense = dense_picture(rays, fields, grids, states, wardrobe)
    assert seen.shares[:, 0].max() > 0.3
    torch.testing.assert_close(dense, seen.features, atol=1e-4, rtol=0)
    holds = torch.nonzero(seen.shares[:, 0] > 0.05)[:8, 0]
    slow = slow_picture(rays[holds], fields, grids, states, styles)
    np.testing.assert_allclose(dense[holds].numpy(), slow.features, atol=1e-3)


def test_the_papers_layout_differs_only_in_the_ball_where_fields_are_dressed_by_sample():
    fields, grids = fields_of("tennis", "sample")
    _, rays, states = seen_by("tennis", fields)
    styles = drawn(1, len(fields.scene.objects), 3, seed=3)
    alone = replace(states, balls=None)
    wardrobe = Wardrobe(fields, grids, styles)
    torch.testing.assert_close(
        paper_picture(rays, fields, grids, alone, styles),
        dense_picture(rays, fields, grids, alone, wardrobe),
        atol=1e-4,
        rtol=0,
    )
    without = dense_picture(rays, fields, grids, alone, wardrobe)
    both = dense_picture(rays, fields, grids, states, wardrobe), paper_picture(rays, fields, grids, states, styles)
    marks = [(picture - without).abs().sum(dim=1) for picture in both]
    assert all(mark.max() > 0.05 for mark in marks)
    # Samples are few and hide more than a blurred ball does, but they do so where it is.
    pixels = torch.from_numpy(picture_pixels(*SIZE)).float()
    one, other = ((mark[:, None] * pixels).sum(dim=0) / mark.sum() for mark in marks)
    torch.testing.assert_close(one, other, atol=0.7, rtol=0)


def test_dressing_by_sample_dresses_what_is_between_cells():
    fields, grids = fields_of("tennis", "grid")
    styles = drawn(1, len(fields.scene.objects), 3, seed=3)
    rows, shares = torch.tensor([[0, 1]]), torch.tensor([[0.5, 0.5]])
    frame = torch.zeros(1, dtype=torch.int64)
    values = grids.values(fields.key_of["court"])[:2].mean(dim=0, keepdim=True)
    court = [thing.name for thing in fields.scene.objects].index("court")
    found = SampleWardrobe(fields, grids, styles).wear(court, rows, shares, frame)
    torch.testing.assert_close(found, fields.stylist("court")(values, frame, styles[:, court]))


def test_dense_samples_are_those_of_every_object():
    fields, _ = fields_of("tennis", "grid")
    assert dense_samples(fields) == 6 + 6 + 6 + 1 + 1 + 1
    fields, _ = fields_of("blocks", "grid")
    assert dense_samples(fields) == 6 + 8 + 1


def model_of(design: str) -> SynthesisModel:
    torch.manual_seed(0)
    made = ModelOptions(
        scene="tennis",
        fields=options("grid"),
        enhancer=EnhancerOptions(widths=(4,)),
        style=StyleOptions(widths=(4,), crop=4),
        picture=SIZE,
        seed=0,
        design=design_named(design),
    )
    return SynthesisModel(made).eval().requires_grad_(False)


def test_what_a_frame_takes_is_counted_and_its_picture_compared():
    model = model_of("ours")
    camera, _, states = seen_by("tennis", model.fields)
    asked = EfficiencyOptions(size=(32, 24), share=2, most_rays=8, repeats=1)
    styles = drawn(1, len(model.scene.objects), 3, seed=3)
    found = efficiency_of(model, styles, camera_at(camera, np.array([2.0, 2.0])), states, asked, place="there")
    assert found.dense_samples == 21 * 32 * 24 and found.surface_samples == 32 * 24
    assert 0 < found.looked_at < 12 * 32 * 24 and found.timed_rays == 12 * 32
    assert found.timed_rays <= found.compared_rays <= found.timed_rays + 8
    assert found.largest_difference < 1e-4
    assert found.samples_ratio == found.dense_samples / (found.looked_at + 32 * 24)
    for each in (found.growing, found.first, found.following, found.enhancing, found.dense):
        assert each.seconds > 0
    from dataclasses import asdict

    assert efficiency_from_json(asdict(found)) == found
    with pytest.raises(ValueError, match="expected what asdict made of it"):
        efficiency_from_json({"size": [1, 2]})


def test_ratios_are_of_whole_frames():
    quick, slow = Taken(seconds=2.0, cpu_seconds=1.0), Taken(seconds=30.0, cpu_seconds=9.0)
    found = Efficiency(
        size=(2, 1), place="", looked_at=3, surface_samples=2, dense_samples=50, largest_difference=0.0,
        compared_rays=2, growing=quick, first=quick, following=quick, enhancing=Taken(seconds=1.0, cpu_seconds=0.5),
        dense=slow.times(2.0), timed_rays=1, device="cpu", threads=1,
    )  # fmt: skip
    assert (found.samples_ratio, found.time_ratio, found.cpu_ratio) == (10.0, 30.5, 18.5)


def test_a_model_without_grids_has_nothing_to_skip():
    model = model_of("no_voxels")
    camera, _, states = seen_by("tennis", model.fields)
    styles = drawn(1, len(model.scene.objects), 3, seed=3)
    with pytest.raises(ValueError, match="expected a model of grids"):
        efficiency_of(model, styles, camera, states, EfficiencyOptions(size=SIZE))
    assert PRESETS["nano"].fields.stylising == "grid"
