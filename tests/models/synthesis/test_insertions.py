from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.simulate.body import racket as true_racket
from pgm_data.skeleton import load_skeleton, world_from_joints
from pgm_models.synthesis.balls import Balls, ball_shares, optical_of_share
from pgm_models.synthesis.boxes import Boxes, box_spans
from pgm_models.synthesis.grids import fetched
from pgm_models.synthesis.insertions import (
    InsertedMesh,
    fixed_in_world,
    fixed_to_joint,
    inserted_mesh,
    march_mesh,
)
from pgm_models.synthesis.meshes import DistanceGrid, solids_of
from pgm_models.synthesis.rackets import RacketMeasures, held_by, inserted_racket, racket_bed, racket_frame
from pgm_models.synthesis.rays import Rays, camera_rays, picture_pixels
from pgm_models.synthesis.samples import Samples, uniform_samples
from pgm_models.synthesis.skinning import Poses, poses_of

NOWHERE = (np.eye(3), np.zeros(3))
COARSE = RacketMeasures(rounds=16)


def front(eye=(0.0, -3.0, 0.0), focal=60.0, width=48, height=36, frame=0) -> Rays:
    """A camera that looks along y, x to the right and z up."""
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    camera = Camera(K=K, distortion=np.zeros(4), R_cam_from_world=R, t_cam_from_world=-R @ np.array(eye))
    return camera_rays(camera, picture_pixels(width, height), frame=frame)


def round_mesh(radius=0.4, cells=33, density=1e4) -> InsertedMesh:
    """A ball by its closed form."""
    axis = np.linspace(-1.2 * radius, 1.2 * radius, cells)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    grid = DistanceGrid(low=np.full(3, axis[0]), cell=axis[1] - axis[0], distance=np.sqrt(x**2 + y**2 + z**2) - radius)
    return inserted_mesh(grid, colour=(0.9, 0.1, 0.2), density=density)


def standing(skeleton="smpl24", frames=1, size=1.0, seed=None) -> Poses:
    made = load_skeleton(skeleton)
    joints = len(made.parents)
    turn = (
        np.zeros((frames, joints, 3))
        if seed is None
        else np.random.default_rng(seed).normal(0, 0.5, (frames, joints, 3))
    )
    offsets = np.broadcast_to(size * made.rest_translations, (frames, joints, 3)).copy()
    return poses_of(made, turn, offsets)


def shares_of(marched, rays: Rays) -> torch.Tensor:
    return torch.zeros(len(rays)).index_put((marched.samples.ray,), -torch.expm1(-marched.optical))


def test_a_ball_as_a_mesh_is_seen_where_the_ball_is() -> None:
    rays, mesh = front(), round_mesh()
    place = fixed_in_world(np.eye(3), np.array([0.2, 0.3, -0.1]), 1)
    marched = march_mesh(rays, mesh, place, count=64)
    got = shares_of(marched, rays)
    ball = Balls(position=torch.tensor([[0.2, 0.3, -0.1]]), path=torch.zeros(1, 3), radius=0.4)
    expected, _ = ball_shares(rays, ball)
    # The ball is a disc across the ray, and pixels see nine places of the mesh: its rim may differ.
    assert float((got - expected).abs().max()) < 0.35
    assert float((got - expected).abs().mean()) < 0.01
    assert float(got.sum()) == pytest.approx(float(expected.sum()), rel=0.01)
    assert float(got.max()) == pytest.approx(1.0)


def test_depth_is_that_of_the_side_towards_the_camera() -> None:
    rays, mesh = front(width=1, height=1), round_mesh()
    marched = march_mesh(rays, mesh, fixed_in_world(*NOWHERE, 1), count=256)
    # Rays through the pixel's other places meet it up to a millimetre further on.
    assert float(marched.samples.depth[0]) == pytest.approx(2.6, abs=5e-3)


def test_a_mesh_narrower_than_a_pixel_is_not_lost() -> None:
    for shift in (0.0, 0.01, 0.02, 0.03):
        rays = front(focal=12.0, width=16, height=12)
        marched = march_mesh(
            rays, round_mesh(radius=0.1), fixed_in_world(np.eye(3), np.array([shift, 0, 0]), 1), count=48
        )
        area = np.pi * (0.1 * 12 / 3) ** 2
        assert float(shares_of(marched, rays).sum()) == pytest.approx(area, rel=0.5)


def test_what_lets_light_through_dims_by_the_way_through_it() -> None:
    rays, mesh = front(width=1, height=1), round_mesh(density=1.5)
    marched = march_mesh(rays, mesh, fixed_in_world(*NOWHERE, 1), count=512)
    assert float(marched.optical[0]) == pytest.approx(1.5 * 0.8, rel=0.02)


def test_skipping_by_distance_sees_what_looking_everywhere_sees() -> None:
    x, y, z = np.meshgrid(*[np.linspace(-h, h, round(h / 0.02) + 1) for h in (0.5, 0.5, 0.14)], indexing="ij")
    ring = np.hypot(np.hypot(x, y) - 0.4, z) - 0.05
    grid = DistanceGrid(low=np.array([-0.5, -0.5, -0.14]), cell=0.04, distance=ring)
    mesh = inserted_mesh(grid, colour=(0.1, 0.1, 0.1), density=60.0)
    R = rotation_from_rotvec(np.array([0.9, 0.4, -0.5]))
    place = fixed_in_world(R, np.array([0.1, -1.5, -0.1]), 1)
    rays = front(focal=90.0)
    marched = march_mesh(rays, mesh, place, count=40)
    got = shares_of(marched, rays)
    assert float(got.max()) > 0.5
    total, looked_at = torch.zeros(len(rays)), 0
    places = [(k + 0.5) / 3 - 0.5 for k in range(3)]
    for x in places:
        for y in places:
            direction = rays.direction + x * rays.across + y * rays.down
            direction = direction / direction.norm(dim=1, keepdim=True)
            turned = replace(
                rays,
                origin=rays.origin @ place.R_mesh_from_world[0].T + place.t_mesh_from_world[0],
                direction=direction @ place.R_mesh_from_world[0].T,
            )
            samples = uniform_samples(box_spans(turned, Boxes(low=mesh.low[None], high=mesh.high[None])), 40)
            at = turned.origin[samples.ray] + samples.depth[:, None] * turned.direction[samples.ray]
            away = fetched(mesh.distance, (at - mesh.low) / (mesh.high - mesh.low), mesh.size)[:, 0]
            inside = torch.where(away < 0, 60.0 * samples.length, 0.0)
            total += -torch.expm1(-torch.zeros(len(rays)).index_add(0, samples.ray, inside))
            looked_at += len(samples)
    torch.testing.assert_close(got, total / 9, rtol=0, atol=2e-5)
    assert marched.looked_at < 0.4 * looked_at


def test_a_mesh_follows_its_joint_rigidly_at_its_own_size() -> None:
    skeleton = load_skeleton("smpl24")
    joint = skeleton.joint_names.index("R_Hand")
    R_joint_from_mesh, t_joint_from_mesh = held_by("right")
    rng = np.random.default_rng(1)
    turn = rng.normal(0, 0.6, (3, len(skeleton.parents), 3))
    for size in (1.0, 1.2):
        offsets = np.broadcast_to(size * skeleton.rest_translations, turn.shape).copy()
        offsets[:, 0] += [[3.0, -11, 0], [0, 0, 0], [-2, 4, 1]]
        place = fixed_to_joint(poses_of(skeleton, turn, offsets), joint, R_joint_from_mesh, t_joint_from_mesh)
        R, joints = world_from_joints(skeleton.parents, turn, offsets)
        points_mesh = rng.normal(size=(5, 3))
        points_world = joints[:, joint, None] + (points_mesh @ R_joint_from_mesh.T + t_joint_from_mesh) @ np.swapaxes(
            R[:, joint], 1, 2
        )
        back = torch.as_tensor(points_world, dtype=torch.float32) @ place.R_mesh_from_world.mT
        back = back + place.t_mesh_from_world[:, None]
        np.testing.assert_allclose(back.numpy(), np.broadcast_to(points_mesh, back.shape), atol=2e-5)


def test_each_frame_sees_the_mesh_where_its_body_is_and_none_without_one() -> None:
    poses = standing(frames=3, seed=2)
    gone = Poses(
        rotation=poses.rotation.index_fill(0, torch.tensor([1]), torch.nan),
        translation=poses.translation.index_fill(0, torch.tensor([1]), torch.nan),
        scale=poses.scale.index_fill(0, torch.tensor([1]), torch.nan),
        joints=poses.joints.index_fill(0, torch.tensor([1]), torch.nan),
    )
    place = fixed_to_joint(gone, 0, *NOWHERE)
    mesh = round_mesh(radius=0.2)
    seen = []
    for frame in range(3):
        rays = front(frame=frame, eye=(0, -3, 0))
        seen.append(float(shares_of(march_mesh(rays, mesh, place, count=24), rays).sum()))
    assert seen[0] > 5 and seen[2] > 5
    assert seen[1] == 0


def test_meshes_behind_or_round_the_camera_make_no_nan() -> None:
    mesh = round_mesh()
    behind = march_mesh(front(eye=(0, 3, 0)), mesh, fixed_in_world(*NOWHERE, 1), count=8)
    assert not len(behind.samples) and not behind.looked_at
    rays = front(eye=(0, 0, 0))
    inside = march_mesh(rays, mesh, fixed_in_world(*NOWHERE, 1), count=64)
    assert float(shares_of(inside, rays).min()) == pytest.approx(1.0)
    assert torch.isfinite(inside.samples.depth).all()
    none = march_mesh(rays[torch.zeros(0, dtype=torch.int64)], mesh, fixed_in_world(*NOWHERE, 1), count=8)
    assert not len(none.samples)


def test_a_mesh_has_one_look_for_all_its_samples() -> None:
    mesh = round_mesh()
    marched = march_mesh(front(), mesh, fixed_in_world(*NOWHERE, 1), count=32)
    torch.testing.assert_close(mesh.colour, torch.tensor([[0.9, 0.1, 0.2]]))
    assert isinstance(marched.samples, Samples)
    assert marched.rows.shape == marched.shares.shape == (len(marched.samples), 1)
    assert not marched.rows.any() and (marched.shares == 1).all()
    assert mesh.to("cpu").size == mesh.size


def test_what_cannot_be_inserted_is_refused() -> None:
    grid = DistanceGrid(low=np.zeros(3), cell=0.1, distance=np.ones((2, 2, 2)))
    with pytest.raises(ValueError, match="colour: expected RGB 0 to 1"):
        inserted_mesh(grid, colour=(0.0, 1.2, 0.0))
    with pytest.raises(ValueError, match="density: expected above 0"):
        inserted_mesh(grid, colour=(0.0, 1.0, 0.0), density=0.0)
    with pytest.raises(ValueError, match="joint: expected 0 to 23, got 24"):
        fixed_to_joint(standing(), 24, *NOWHERE)
    with pytest.raises(ValueError, match="count: expected 1 or more"):
        march_mesh(front(), round_mesh(), fixed_in_world(*NOWHERE, 1), count=0)


def test_a_racket_is_watertight_and_has_its_measures() -> None:
    measures = RacketMeasures()
    frame, bed = racket_frame(measures), racket_bed(measures)
    for solid in [*solids_of(frame), *solids_of(bed)]:
        assert solid.volume > 0
    assert len(solids_of(frame)) == 5
    low, high = frame.vertices.min(axis=0), frame.vertices.max(axis=0)
    np.testing.assert_allclose([low[1], high[1]], [0, 0.685], atol=1e-9)
    np.testing.assert_allclose([low[0], high[0]], [-0.131, 0.131], atol=1e-3)
    oval = np.pi * (0.17 - 0.0065) * (0.131 - 0.0065)
    assert bed.volume == pytest.approx(oval * measures.bed, rel=0.01)
    inner = np.abs(bed.vertices[:, 0]).max(), np.abs(bed.vertices[:, 1] - (0.685 - 0.17)).max()
    np.testing.assert_allclose(inner, [0.131 - 0.0065, 0.17 - 0.0065], atol=1e-3)


@pytest.mark.parametrize("change", [{"frame": (0.14, 0.02)}, {"length": 0.5}])
def test_rackets_without_strings_or_shaft_are_refused(change) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(change))}: expected"):
        racket_frame(replace(COARSE, **change))


@pytest.mark.parametrize("hand", ["left", "right"])
def test_a_hand_holds_a_racket_about_as_the_simulator_has_it(hand) -> None:
    R, t = held_by(hand)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    middle = R @ np.array([0, 0.685 - 0.17, 0]) + t
    true_middle, true_face = true_racket.sweet_spot(np.eye(3), np.zeros(3), hand)
    assert np.linalg.norm(middle - true_middle) < 0.04
    np.testing.assert_allclose(R[:, 2], true_face, atol=1e-12)


def test_strings_hide_what_they_are_said_to_and_the_frame_all() -> None:
    frame, bed = inserted_racket(replace(COARSE, bed=0.016, bed_opacity=0.3), cell=0.012)
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the face towards the camera, upright
    place = fixed_in_world(R, np.array([0.0, 0.0, -0.515]), 1)
    rays = front(focal=400.0, eye=(0, -3, 0), width=60, height=60)
    strings = shares_of(march_mesh(rays, bed, place, count=64), rays).reshape(60, 60)
    solid = shares_of(march_mesh(rays, frame, place, count=64), rays).reshape(60, 60)
    assert float(strings[30, 30]) == pytest.approx(0.3, abs=0.04)
    assert float(solid[30, 30]) == 0 and float(solid.max()) == 1
    assert float(optical_of_share(strings[30, 30])) > 0
