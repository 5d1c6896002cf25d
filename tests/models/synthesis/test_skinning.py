import numpy as np
import pytest
import torch

from pgm_data.skeleton import Skeleton, load_skeleton, skeleton_names
from pgm_models.synthesis.bodies import body_boxes
from pgm_models.synthesis.boxes import box_spans
from pgm_models.synthesis.grids import fetched
from pgm_models.synthesis.rays import Rays
from pgm_models.synthesis.samples import Samples, uniform_samples
from pgm_models.synthesis.skinning import (
    MARGIN_M,
    STUB_M,
    Poses,
    Skinning,
    distance_to_limbs,
    grid_places,
    limbs_of,
    poses_of,
    rest_joints,
)
from tests.models.synthesis.slow_renderer import SlowBody, array
from tests.models.synthesis.toy_bodies import bent, rays_towards, uneven_weights

SKELETONS = ["smpl24", "blocks13"]


def skinning_of(name: str, cells: int = 12) -> Skinning:
    return Skinning(load_skeleton(name), (cells, cells, cells), width=4, seed=0).requires_grad_(False)


def single_bone(joints: int = 1) -> Skeleton:
    """A chain of bones of 0 m."""
    return Skeleton(
        name="dot",
        joint_names=tuple("abc"[:joints]),
        parents=np.arange(joints) - 1,
        rest_translations=np.zeros((joints, 3)),
        limits=np.array([[[-np.inf] * 3, [np.inf] * 3]] * joints),
        point_names=("a",),
        point_joints=np.array([0]),
        point_offsets=np.zeros((1, 3)),
        soles=((), ()),
        keypoint_names=("a",),
    )


def test_both_skeletons_are_tested() -> None:
    assert set(SKELETONS) == set(skeleton_names())


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("size", [1.0, 0.7, 1.15])
def test_each_joint_is_taken_to_its_own_place_in_the_rest_pose(name: str, size: float) -> None:
    skeleton = load_skeleton(name)
    poses = bent(skeleton, 5, size=size)
    at = torch.einsum("fjab,fjb->fja", poses.rotation, poses.joints) + poses.translation
    np.testing.assert_allclose(at, np.broadcast_to(rest_joints(skeleton), at.shape), atol=1e-5)
    np.testing.assert_allclose(poses.scale, 1 / size, rtol=1e-5)
    squares = poses.rotation @ poses.rotation.mT / poses.scale.square()[:, None, None, None]
    np.testing.assert_allclose(squares, np.broadcast_to(np.eye(3), squares.shape), atol=1e-5)
    assert poses.present.all()


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("size", [1.0, 1.2])
def test_where_limbs_are_rigid_the_inverse_of_blend_skinning_is_found(name: str, size: float) -> None:
    """Points that move with one joint only come back from wherever forward blend skinning puts them."""
    skeleton, skinning = load_skeleton(name), skinning_of(name)
    poses = bent(skeleton, 1, size=size, bend=0.3)
    rng = np.random.default_rng(0)
    rest = torch.tensor(rng.uniform(array(skinning.low), array(skinning.high), (600, 3))).float()
    cells = rng.integers(0, skinning.joints, len(skinning.support))
    weights = torch.nn.functional.one_hot(torch.tensor(cells), skinning.joints).float() * skinning.support
    for frame in range(1):
        at = fetched(weights, skinning.places(rest), skinning.size)
        rigid = (at > 0).sum(dim=1) == 1
        joint = at.argmax(dim=1)
        R, t = poses.rotation[frame, joint], poses.translation[frame, joint]
        world = torch.linalg.solve(R.double(), (rest - t).double()).float()
        kept, found, share = skinning.to_rest(world, poses, frame, weights)
        # No other joint takes the point to where it weighs.
        carried = torch.einsum("jab,pb->pja", poses.rotation[frame], world) + poses.translation[frame]
        inside = ((carried >= skinning.low) & (carried <= skinning.high)).all(dim=2)
        held = fetched(weights, skinning.places(carried.flatten(0, 1)), skinning.size).unflatten(
            0, (-1, skinning.joints)
        )
        others = (held.diagonal(dim1=1, dim2=2) * inside > 0).sum(dim=1)
        alone = torch.nonzero(rigid & (others == 1) & (at.amax(dim=1) > 1e-3))[:, 0]
        assert len(alone) > 5
        place = torch.full((len(rest),), -1).index_put((kept,), torch.arange(len(kept)))[alone]
        assert (place >= 0).all()
        torch.testing.assert_close(found[place], rest[alone], atol=2e-5, rtol=0)
        torch.testing.assert_close(share[place], at.amax(dim=1)[alone], atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("name", SKELETONS)
def test_points_go_to_rest_as_one_joint_after_the_other_takes_them(name: str) -> None:
    skinning = skinning_of(name)
    weights, poses = uneven_weights(skinning), bent(skinning.skeleton, 2, seed=3)
    slow = SlowBody(
        body=None,  # type: ignore[arg-type]  # the skinning alone is asked
        density=np.zeros(0),
        values=np.zeros(0),
        weights=array(weights).reshape(*skinning.size, -1),
        reach=array(skinning.reach),
        low=array(skinning.low),
        high=array(skinning.high),
    )
    rng = np.random.default_rng(1)
    for frame in range(2):
        near = poses.joints[frame, rng.integers(0, skinning.joints, 60)].numpy()
        points = torch.tensor(near + rng.normal(scale=0.15, size=near.shape)).float()
        kept, rest, share = skinning.to_rest(points, poses, frame, weights)
        found = {int(point): place for place, point in enumerate(kept)}
        for number, point in enumerate(array(points)):
            expected = slow.rest(point, poses, frame)
            assert (expected is None) == (number not in found)
            if expected is not None:
                np.testing.assert_allclose(rest[found[number]], expected[0], atol=5e-5)
                np.testing.assert_allclose(share[found[number]], expected[1], atol=1e-4)
        assert 10 < len(kept) < 60


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("jittered", [False, True])
@pytest.mark.parametrize("far", [3.0, 400.0])
def test_samples_of_rays_are_carried_like_points(name: str, jittered: bool, far: float) -> None:
    skinning = skinning_of(name)
    weights, poses = uneven_weights(skinning), bent(skinning.skeleton, 1, seed=5, size=1.1)
    rng = np.random.default_rng(2)
    targets = poses.joints[0, rng.integers(0, skinning.joints, 120)].numpy() + rng.normal(scale=0.2, size=(120, 3))
    towards = rng.normal(size=(120, 3))
    towards[:10] = np.eye(3)[0]  # along an axis of the world
    rays = rays_towards(targets + far * towards / np.linalg.norm(towards, axis=1, keepdims=True), targets)
    spans = box_spans(rays, body_boxes(poses, skinning))
    met = torch.nonzero(spans.met)[:, 0]
    jitter = torch.rand(120, 9, generator=torch.Generator().manual_seed(0)) if jittered else None
    samples = uniform_samples(spans, 9, jitter=jitter)
    own = type(spans)(near=spans.near[met], far=spans.far[met])
    renumbered = Samples(ray=samples.ray, depth=samples.depth, length=samples.length)
    looked_up = skinning.weights_of(weights)
    found = skinning.carried_samples(rays[met], own, renumbered, poses, 0, looked_up)
    exact = _exact_points(rays, samples)
    expected = skinning.carried(exact.float(), poses, 0, looked_up)
    pairs = [set(zip(each.point.tolist(), each.joint.tolist(), strict=True)) for each in (found, expected)]
    assert len(pairs[0]) == len(found.point) > 300
    # Rounding may put a point on the other side of where a weight begins.
    assert len(pairs[0] ^ pairs[1]) <= 0.01 * len(pairs[0])
    joint, point = found.joint, found.point
    R, t = poses.rotation[0].double()[joint], poses.translation[0].double()[joint]
    truth = torch.einsum("pab,pb->pa", R, exact[point]) + t
    assert float((found.at - truth).abs().max()) < (2e-6 if far < 10 else 5e-5)
    blended = [skinning.blended(each, len(samples), looked_up) for each in (found, expected)]
    total = [torch.zeros(len(samples)).index_put((kept,), share) for kept, _, share in blended]
    torch.testing.assert_close(total[0], total[1], atol=2e-3, rtol=0)


def _exact_points(rays: Rays, samples: Samples) -> torch.Tensor:
    return rays.origin.double()[samples.ray] + samples.depth.double()[:, None] * rays.direction.double()[samples.ray]


def test_gradients_reach_the_weights() -> None:
    skinning = skinning_of("blocks13", cells=5)
    poses = bent(skinning.skeleton, 1)
    poses = Poses(**{name: values.double() for name, values in vars(poses).items()})
    points = poses.joints[0] + 0.02
    skinning = skinning.double()
    weights = (uneven_weights(skinning).double() + 0.01).requires_grad_(True)

    def rest(weights: torch.Tensor) -> torch.Tensor:
        kept, found, _ = skinning.to_rest(points, poses, 0, weights)
        assert len(kept) > 8
        return found

    assert torch.autograd.gradcheck(rest, (weights,), atol=1e-5, fast_mode=True)


def test_weights_are_zero_beyond_their_support_and_leave_room_for_what_is_no_body() -> None:
    skinning = skinning_of("smpl24")
    weights = skinning()
    assert weights.shape == (12**3, 24) and (weights[~skinning.support] == 0).all()
    assert (weights[skinning.support] > 0).all() and (weights.sum(dim=1) <= 1).all()
    assert not skinning.support.all(dim=1).any() and (~skinning.support).all(dim=1).any()


@pytest.mark.parametrize("name", SKELETONS)
def test_the_prior_of_a_limb_is_highest_at_its_own_bone(name: str) -> None:
    skinning = skinning_of(name, cells=24)
    weights = skinning()
    owner, ends = limbs_of(skinning.skeleton)
    best = fetched(weights, skinning.places(torch.tensor(ends.mean(axis=1)).float()), skinning.size)
    own = best[torch.arange(len(owner)), torch.tensor(owner)]
    assert (own > 0.15).all()


def test_the_head_of_a_figure_of_blocks_is_within_reach() -> None:
    """Its corners are 0.32 m from the line that it moves about."""
    from pgm_data.simulate.blocks.figure import PART_BOXES_M, part_joints

    skinning = skinning_of("blocks13", cells=24)
    weights = skinning()
    rest = rest_joints(skinning.skeleton)
    corners = np.array(list(np.ndindex(2, 2, 2)))
    for box, joint in zip(PART_BOXES_M, part_joints(), strict=True):
        points = rest[joint] + np.where(corners, box[1], box[0])
        share = fetched(weights, skinning.places(torch.tensor(points).float()), skinning.size).sum(dim=1)
        assert (share > 0.1).all()


def test_joints_that_weigh_nowhere_take_no_point_and_have_no_box() -> None:
    skinning = skinning_of("blocks13")
    support = skinning.support.clone()
    support[:, 3] = False
    skinning.confine(support)
    poses = bent(skinning.skeleton, 2)
    weights = skinning.weights_of(skinning())
    points = poses.joints[0] + 0.01
    carried = skinning.carried(points, poses, 0, weights)
    assert len(carried.joint) and 3 not in carried.joint
    boxes = body_boxes(poses, skinning)
    assert torch.isfinite(boxes.low).all()
    skinning.confine(torch.zeros_like(support))
    nowhere = body_boxes(poses, skinning)
    rays = rays_towards(np.array([[0.0, -9.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))
    assert not box_spans(rays, nowhere).met.any()
    assert not len(skinning.to_rest(points, poses, 0, skinning())[0])


@pytest.mark.parametrize("name", SKELETONS)
def test_nothing_weighs_outside_the_grid_of_weights(name: str) -> None:
    """Not even in what it takes for a joint that lies at its border."""
    skinning = skinning_of(name)
    skinning.confine(torch.ones_like(skinning.support))
    weights = torch.full(skinning.support.shape, 0.5)
    still = skinning.skeleton.rest_translations[None] * np.ones((1, 1, 1))
    poses = poses_of(skinning.skeleton, np.zeros_like(still), still)  # the rest pose itself
    low, high = array(skinning.low), array(skinning.high)
    middle = (low + high) / 2
    for axis in range(3):
        for end, sign in ((low, -1), (high, 1)):
            at = np.stack([middle, middle])
            at[:, axis] = end[axis] + sign * np.array([-1e-3, 1e-3])
            kept = skinning.to_rest(torch.tensor(at).float(), poses, 0, weights)[0]
            assert kept.tolist() == [0]


def test_bodies_that_are_missing_or_without_bones_are_said_to_be() -> None:
    skeleton = load_skeleton("smpl24")
    rotations = np.zeros((3, 24, 3))
    translations = np.array(np.broadcast_to(skeleton.rest_translations, (3, 24, 3)))
    rotations[1, 4], translations[2, 7, 1] = np.nan, np.nan
    poses = poses_of(skeleton, rotations, translations)
    assert poses.present.tolist() == [True, False, False]
    boxes = body_boxes(poses, skinning_of("smpl24"))
    assert torch.isfinite(boxes.low[0]).all() and torch.isnan(boxes.low[1:]).all()
    for joints in (1, 2):
        dot = single_bone(joints)
        alone = poses_of(dot, np.zeros((1, joints, 3)), np.zeros((1, joints, 3)))
        assert alone.present.all() and alone.scale.tolist() == [1.0]
        assert Skinning(dot, (4, 4, 4), width=4, seed=0)().shape == (64, joints)


def test_a_full_turn_is_no_turn_and_half_a_turn_is_one() -> None:
    skeleton = load_skeleton("blocks13")
    translations = np.broadcast_to(skeleton.rest_translations, (4, 13, 3))
    rotations = np.zeros((4, 13, 3))
    rotations[1, :, 1], rotations[2, :, 1], rotations[3, :, 1] = 2 * np.pi, np.pi, -np.pi
    poses = poses_of(skeleton, rotations, translations)
    torch.testing.assert_close(poses.rotation[0], poses.rotation[1], atol=1e-5, rtol=0)
    torch.testing.assert_close(poses.rotation[2], poses.rotation[3], atol=1e-5, rtol=0)
    assert torch.isfinite(poses.rotation).all()


def test_limbs_run_from_joints_to_their_children_and_beyond_the_last_ones() -> None:
    skeleton = load_skeleton("smpl24")
    owner, ends = limbs_of(skeleton)
    rest = rest_joints(skeleton)
    children = {joint: list(np.flatnonzero(skeleton.parents == joint)) for joint in range(24)}
    assert len(owner) == 23 + sum(not each for each in children.values())
    for joint, (start, end) in zip(owner, ends, strict=True):
        np.testing.assert_allclose(start, rest[joint])
        if children[joint]:
            assert any(np.allclose(end, rest[child]) for child in children[joint])
        else:
            bone = rest[joint] - rest[skeleton.parents[joint]]
            assert np.linalg.norm(np.cross(end - start, bone)) < 1e-12
            assert 0 < np.linalg.norm(end - start) <= STUB_M + 1e-12


def test_distances_to_limbs_are_those_of_the_nearest_of_many_points_on_them() -> None:
    rng = np.random.default_rng(0)
    ends = rng.normal(size=(4, 2, 3))
    ends[3, 1] = ends[3, 0]  # a limb without length
    points = rng.normal(size=(30, 3))
    along = np.linspace(0, 1, 2001)[:, None]
    for limb, (start, end) in enumerate(ends):
        dense = start + along * (end - start)
        expected = np.linalg.norm(points[:, None] - dense, axis=2).min(axis=1)
        np.testing.assert_allclose(distance_to_limbs(points, ends)[:, limb], expected, atol=2e-3)


def test_the_grid_reaches_beyond_all_joints_to_its_border() -> None:
    skinning = skinning_of("smpl24", cells=3)
    places = grid_places(array(skinning.low), array(skinning.high), (3, 4, 5))
    rest = rest_joints(skinning.skeleton)
    np.testing.assert_allclose(places.min(axis=0), rest.min(axis=0) - MARGIN_M, atol=1e-6)
    np.testing.assert_allclose(places.max(axis=0), rest.max(axis=0) + MARGIN_M, atol=1e-6)
    np.testing.assert_allclose(
        skinning.places(torch.tensor(places).float())[[0, -1]], [[0.0] * 3, [1.0] * 3], atol=1e-6
    )
