"""Pictures of a video: what is left out, what wears what, and still views that are enhanced in part."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.geometry.camera import Camera
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.camera_paths import intrinsics, looking_at
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.render_layers import Filmer, as_bgr, depth_of, labels_of
from pgm_models.synthesis.studio import Studio
from tests.models.synthesis.test_inserted_pictures import rod
from tests.models.synthesis.toy_bodies import bent
from tests.models.synthesis.toy_models import toy_model

SIZE = (80, 45)


@pytest.fixture(scope="module")
def model():
    return toy_model()


@pytest.fixture(scope="module")
def styles(model):
    return model.match_styles["match0"][None]


def camera(x=0.0):
    R = looking_at(np.array([x, -9.0, 2.2]), np.array([0.2, 0.0, 0.9]))
    return Camera(
        K=intrinsics(30.0, SIZE),
        distortion=np.zeros(4),
        R_cam_from_world=R,
        t_cam_from_world=-R @ np.array([x, -9.0, 2.2]),
    )


def states(model, seed=0):
    """Two players beside each other and a ball between them."""
    poses = {}
    for number, player in enumerate(model.scene.players):
        own = bent(player.skeleton, 1, seed=seed + number)
        by = torch.tensor([2.4 * number - 1.2, 0.0, 0.0])
        poses[player.name] = replace(own, translation=own.translation - own.rotation @ by, joints=own.joints + by)
    ball = Balls(position=torch.tensor([[0.05, -0.5, 1.2]]), path=torch.zeros(1, 3), radius=0.1)
    return States(poses=poses, balls=ball)


def shares(model, picture):
    return {thing.name: share for thing, share in zip(model.scene.objects, picture.shares, strict=True)}


def test_pictures_are_those_of_the_studio(model, styles):
    studio = Studio(model, styles, *SIZE)
    expected = studio.picture(camera(), states(model))
    filmer = Filmer(model, styles, SIZE)
    for made in (filmer.moving(camera(), states(model)), filmer.still(camera(), states(model))):
        torch.testing.assert_close(made.rgb, expected.rgb, atol=1e-5, rtol=0)
        assert torch.equal(made.features, expected.features)
        assert torch.equal(made.depth, expected.depth)
    draft = Filmer(model, styles, SIZE, quality="draft").still(camera(), states(model))
    assert torch.equal(draft.rgb, expected.features[:3].clamp(0, 1))
    assert float((draft.rgb - expected.rgb).abs().max()) > 0.05


def test_a_still_view_is_that_of_a_moving_camera_and_a_new_view_is_another(model, styles):
    filmer, plain = Filmer(model, styles, SIZE), Filmer(model, styles, SIZE)
    for seed, x in ((0, 0.0), (1, 0.0), (2, 0.4), (3, 0.0)):
        made, expected = filmer.still(camera(x), states(model, seed)), plain.moving(camera(x), states(model, seed))
        torch.testing.assert_close(made.rgb, expected.rgb, atol=1e-5, rtol=0)
    nobody = States(poses={}, balls=None)
    assert torch.equal(filmer.still(camera(), nobody).rgb, plain.moving(camera(), nobody).rgb)


def test_a_still_view_of_a_world_is_that_of_a_moving_camera_and_the_world_can_be_left_out():
    model = toy_model("blocks")
    styles = model.match_styles["match0"][None]
    filmer, plain = Filmer(model, styles, SIZE), Filmer(model, styles, SIZE)
    own = States(poses=states(model).poses, balls=None)
    made, expected = filmer.still(camera(), own), plain.moving(camera(), own)
    torch.testing.assert_close(made.rgb, expected.rgb, atol=1e-5, rtol=0)
    (world,) = [thing.name for thing in model.scene.objects if thing.kind == "static"]
    assert float(shares(model, expected)[world].max()) > 0.1
    less = Filmer(model, styles, SIZE, without=[world]).moving(camera(), own)
    assert not shares(model, less)[world].any() and less.looked_at < expected.looked_at


def test_only_changed_parts_of_a_still_view_are_enhanced(styles):
    size, model = (320, 180), toy_model(widths=(4,))
    filmer = Filmer(model, styles, size)
    far = replace(camera(), K=intrinsics(30.0, size), t_cam_from_world=camera().t_cam_from_world + [0.0, 0.0, 30.0])
    filmer.still(far, states(model))
    pixels = []
    with model.enhancer.register_forward_hook(lambda module, inputs, output: pixels.append(output[0, 0].numel())):
        made = filmer.still(far, states(model, 1))
        assert 0 < sum(pixels) < size[0] * size[1] / 4
        pixels.clear()
        expected = filmer.moving(far, states(model, 1))
        assert pixels == [size[0] * size[1]]
    torch.testing.assert_close(made.rgb, expected.rgb, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", ["player0", "ball"])
def test_what_is_left_out_leaves_its_pixels_to_what_is_behind(model, styles, name):
    whole = Filmer(model, styles, SIZE).moving(camera(), states(model))
    less = Filmer(model, styles, SIZE, without=[name])
    made = less.moving(camera(), states(model))
    assert float(shares(model, whole)[name].max()) > 0.3
    assert not shares(model, made)[name].any()
    torch.testing.assert_close(made.shares.sum(dim=0), whole.shares.sum(dim=0), atol=1e-5, rtol=0)
    own = shares(model, whole)[name] > 0
    assert torch.equal(made.features[:, ~own], whole.features[:, ~own])
    only_behind = Filmer(model, styles, SIZE).moving(camera(), States(poses={}, balls=None))
    alone = own & (shares(model, made)["player1"] == 0) & (shares(model, made)["ball"] == 0)
    alone &= shares(model, made)["player0"] == 0
    assert alone.any()
    torch.testing.assert_close(made.features[:, alone], only_behind.features[:, alone], atol=1e-6, rtol=0)
    if name == "player0":
        assert made.looked_at < whole.looked_at


def test_surfaces_that_are_left_out_show_what_is_behind_them_or_nothing(model, styles):
    whole = Filmer(model, styles, SIZE).moving(camera(), States(poses={}, balls=None))
    made = Filmer(model, styles, SIZE, without=["backplate"]).moving(camera(), States(poses={}, balls=None))
    wall = shares(model, whole)["backplate"] > 0
    assert wall.any() and not wall.all()
    assert not shares(model, made)["backplate"].any()
    assert not made.features[:, wall].any()
    assert torch.isinf(made.depth[wall]).all()
    assert torch.equal(made.features[:, ~wall], whole.features[:, ~wall])
    empty = Filmer(model, styles, SIZE, without=[thing.name for thing in model.scene.objects])
    nothing = empty.moving(camera(), states(model))
    assert not nothing.features.any() and nothing.looked_at == 0
    assert "backplate" in model.fields.planes  # the model itself stays whole
    with pytest.raises(ValueError, match="without: expected objects among player0, .*got 'umpire'"):
        Filmer(model, styles, SIZE, without=["umpire"])


def test_another_style_of_one_object_changes_its_pixels_alone_before_the_enhancer(model, styles):
    other = styles.clone()
    other[:, 0] = model.match_styles["match1"][0]
    one, two = (Filmer(model, each, SIZE).moving(camera(), states(model)) for each in (styles, other))
    own = shares(model, one)["player0"] > 0
    assert torch.equal(one.features[:, ~own], two.features[:, ~own])
    assert float((one.features - two.features)[:, own].abs().max()) > 0.05
    assert torch.equal(one.shares, two.shares)


def test_inserted_meshes_are_in_still_views_as_in_moving_ones(model, styles):
    inserted = [rod("player0", 21)]
    filmer = Filmer(model, styles, SIZE)
    moving, still = (make(camera(), states(model), inserted=inserted) for make in (filmer.moving, filmer.still))
    assert moving.inserted is not None and float(moving.inserted.max()) > 0.3
    torch.testing.assert_close(still.rgb, moving.rgb, atol=1e-5, rtol=0)
    without = Filmer(model, styles, SIZE, without=["player0"]).moving(camera(), states(model), inserted=inserted)
    assert without.inserted is None


def test_bytes_labels_and_depth_are_those_of_the_simulator(model, styles):
    picture = Filmer(model, styles, SIZE).moving(camera(), states(model))
    bgr = as_bgr(picture)
    assert bgr.shape == (SIZE[1], SIZE[0], 3) and bgr.dtype == np.uint8
    expected = np.rint(picture.rgb.numpy() * 255)
    assert np.abs(bgr[..., ::-1].transpose(2, 0, 1) - expected).max() <= 1
    labels, names = labels_of(picture), [thing.name for thing in model.scene.objects]
    most = picture.shares.max(dim=0)
    sure = (most.values > 0.6).numpy()
    assert (labels[sure] == most.indices.numpy()[sure] + 1).all()
    assert names.index("player0") + 1 in labels
    nothing = replace(picture, shares=torch.full_like(picture.shares, 0.05))
    assert not labels_of(nothing).any()
    # The court is a plane: where it alone is seen, its depth along the camera's axis follows from its height 0.
    depth = depth_of(picture, camera())
    court = picture.shares[names.index("court")].numpy() == 1
    y, x = np.nonzero(court)
    K, R = camera().K, camera().R_cam_from_world
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(len(x))], axis=1) @ R
    np.testing.assert_allclose(depth[court], -2.2 / rays[:, 2], rtol=1e-4)
