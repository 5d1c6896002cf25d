"""Whole pictures: what a studio keeps and leaves out changes nothing of what is seen."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.geometry.camera import Camera
from pgm_data.scene import Scene
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import Fields, States, Wardrobe
from pgm_models.synthesis.model import SynthesisModel
from pgm_models.synthesis.rays import camera_rays, picture_pixels
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.skinning import Poses
from pgm_models.synthesis.studio import Studio
from tests.models.synthesis.toy_bodies import bent, drawn, looking
from tests.models.synthesis.toy_models import toy_model

EYE, SIZE = [0.6, -9.0, 2.2], (32, 24)


def moved(poses: Poses, by: list[float]) -> Poses:
    offset = torch.tensor(by)
    return replace(poses, translation=poses.translation - poses.rotation @ offset, joints=poses.joints + offset)


def match(scene: Scene) -> States:
    skeleton = scene.players[0].skeleton
    assert skeleton is not None
    poses = bent(skeleton, 1)
    balls = None
    if scene.ball is not None:
        balls = Balls(position=torch.tensor([[0.4, -3.0, 1.3]]), path=torch.tensor([[0.2, 0.0, 0.1]]), radius=0.0335)
    players = {thing.name: moved(poses, [0.9 * number, 0.0, 0.0]) for number, thing in enumerate(scene.players)}
    return States(poses=players, balls=balls)


def styles_of(model: SynthesisModel) -> torch.Tensor:
    return drawn(1, len(model.scene.objects), model.options.fields.style, seed=3)


def from_every_ray(model: SynthesisModel, camera: Camera, states: States, size: tuple[int, int]) -> dict:
    """The picture of all rays, each asked about everything, dressed afresh."""
    grids, styles = model.fields.grids(), styles_of(model)
    rays = camera_rays(camera, picture_pixels(*size))
    seen = render(rays, model.fields, grids, states, Wardrobe(model.fields, grids, styles))
    features = seen.features.T.unflatten(1, size[::-1])
    return {"features": features, "rgb": model.enhanced(features[None], styles)[0], "depth": seen.depth}


@pytest.mark.parametrize("scene", ["tennis", "blocks"])
def test_a_studio_sees_what_every_ray_asked_about_everything_sees(scene: str) -> None:
    model = toy_model(scene)
    studio, states = Studio(model, styles_of(model), *SIZE), match(model.scene)
    for at in ([0.3, 0.0, 1.0], [1.5, 2.0, 0.5]):
        camera = looking(EYE, at, 60.0, SIZE)
        for _ in range(2):  # the second time from what is kept of the view
            picture = studio.picture(camera, states)
            expected = from_every_ray(model, camera, states, SIZE)
            torch.testing.assert_close(picture.features, expected["features"], atol=1e-5, rtol=0)
            torch.testing.assert_close(picture.rgb, expected["rgb"], atol=1e-5, rtol=0)
            torch.testing.assert_close(picture.depth.flatten(), expected["depth"], atol=1e-4, rtol=1e-4)
            assert picture.shares[0].any()


def test_a_picture_of_one_pixel_is_that_pixel_of_a_larger_one() -> None:
    model = toy_model()
    states, camera = match(model.scene), looking(EYE, [0.0, 0.0, 1.0], 90.0, (3, 3))
    alone = replace(camera, K=camera.K - np.array([[0, 0, 1.0], [0, 0, 1.0], [0, 0, 0]]))
    one = Studio(model, styles_of(model), 1, 1).picture(alone, states)
    nine = Studio(model, styles_of(model), 3, 3).picture(camera, states)
    assert one.rgb.shape == (3, 1, 1) and torch.isfinite(one.rgb).all()
    torch.testing.assert_close(one.features[:, 0, 0], nine.features[:, 1, 1], atol=1e-5, rtol=0)


def test_what_is_out_of_view_behind_or_missing_is_not_looked_for() -> None:
    model = toy_model()
    studio, states = Studio(model, styles_of(model), *SIZE), match(model.scene)
    for eye, at in (([0.0, -9.0, 2.0], [0.0, -30.0, 3.0]), (EYE, [30.0, -2.0, 1.0])):
        away = looking(eye, at, 60.0, SIZE)
        seen = studio.picture(away, states)
        assert seen.looked_at == 0 and not seen.shares[:3].any()
        assert torch.equal(seen.features, studio.picture(away, States(poses={}, balls=None)).features)


def test_a_camera_inside_a_player_sees_it_and_makes_no_nan() -> None:
    model = toy_model()
    states = match(model.scene)
    chest = states.poses["player0"].joints[0, 9].tolist()
    picture = Studio(model, styles_of(model), *SIZE).picture(looking(chest, EYE, 60.0, SIZE), states)
    assert torch.isfinite(picture.rgb).all() and float(picture.shares[0].max()) > 0.05


def test_ten_players_are_all_in_the_picture() -> None:
    model = toy_model()
    one, *rest = model.scene.objects
    crowd = tuple(replace(one, name=f"player{number}") for number in range(10))
    scene = replace(model.scene, objects=crowd + tuple(thing for thing in rest if thing.kind != "player"))
    torch.manual_seed(0)
    fields = Fields(scene, model.options.fields, seed=0).requires_grad_(False)
    skeleton = one.skeleton
    assert skeleton is not None
    poses = bent(skeleton, 1, bend=0.1)
    players = {f"player{n}": moved(poses, [1.6 * (n - 4.5), 6.0, 0.0]) for n in range(10)}
    grids = fields.grids()
    wardrobe = Wardrobe(fields, grids, drawn(1, len(scene.objects), model.options.fields.style))
    rays = camera_rays(looking([0.0, -9.0, 2.2], [0.0, 6.0, 1.0], 90.0, (96, 24)), picture_pixels(96, 24))
    seen = render(rays, fields, grids, States(poses=players, balls=None), wardrobe)
    torch.testing.assert_close(seen.shares.sum(dim=1), torch.isfinite(seen.depth).float(), atol=1e-4, rtol=0)
    columns = (seen.shares[:, :10] * rays.direction[:, :1]).sum(dim=0) / seen.shares[:, :10].sum(dim=0)
    assert (columns.diff() > 0).all()  # from left to right


def test_half_the_digits_give_nearly_the_same_picture() -> None:
    model = toy_model()
    states, camera = match(model.scene), looking(EYE, [0.3, 0.0, 1.0], 60.0, SIZE)
    whole = Studio(model, styles_of(model), *SIZE).picture(camera, states)
    with torch.autocast("cpu", torch.bfloat16):
        half = Studio(model, styles_of(model), *SIZE).picture(camera, states)
    assert torch.isfinite(half.rgb).all()
    assert float((half.rgb.float() - whole.rgb).abs().mean()) < 0.02
    torch.testing.assert_close(half.shares.float(), whole.shares, atol=0.05, rtol=0)


def test_pictures_of_no_pixel_and_missing_cameras_are_refused() -> None:
    model = toy_model()
    with pytest.raises(ValueError, match="picture: expected at least 1x1 pixels, got 0x3"):
        Studio(model, styles_of(model), 0, 3)
    shapes = {"K": (3, 3), "distortion": (4,), "R_cam_from_world": (3, 3), "t_cam_from_world": (3,)}
    missing = Camera(**{name: np.full(shape, np.nan) for name, shape in shapes.items()})
    with pytest.raises(ValueError, match="camera: expected one that is there"):
        Studio(model, styles_of(model), *SIZE).picture(missing, match(model.scene))
