"""Skeletons registered to a known camera against known movements."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.geometry.camera import Camera, project
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from pgm_data.lift.players.linkage import placed
from pgm_data.lift.players.register import RegisterOptions, register_options, register_player
from pgm_data.lift.players.sight import mirror_pairs, world_from_ray
from pgm_data.lift.players.solution import PlayerMotion
from pgm_data.lift.players.view import PlayerView
from pgm_data.skeleton import world_joints
from tests.lift.players.moving_worlds import MovingWorld, jumping_world, viewed


def registered(
    world: MovingWorld, view: PlayerView, *, doubt: CameraDoubt | None = None, options: RegisterOptions | None = None
) -> PlayerMotion:
    return register_player(
        "player0",
        view,
        skeleton=world.linkage.skeleton,
        height_m=1.85,
        doubt=doubt or no_doubt(),
        options=options or register_options("standard"),
    )


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.sum(error**2, axis=-1))))


@pytest.fixture(scope="module")
def near() -> tuple[MovingWorld, PlayerView, PlayerMotion]:
    world = jumping_world()
    view = viewed(world)
    return world, view, registered(world, view)


def test_a_jump_is_followed_with_feet_on_the_ground_before_and_after(near) -> None:
    world, _, motion = near
    assert np.all(motion.status == "measured")
    assert rms(motion.root_position - world.posture.position) < 0.12
    assert rms((motion.joints - world.joints).reshape(-1, 3)) < 0.15
    apex = world.posture.position[:, 2].max()
    assert abs(motion.root_position[:, 2].max() - apex) < 0.06
    toes = [world.linkage.skeleton.joint_names.index(name) for name in ("L_Toe", "R_Toe")]
    standing = motion.joints[:, toes, 2][world.planted] - world.joints[:, toes, 2][world.planted]
    assert np.abs(standing).max() < 0.02
    before = motion.joints[:15, toes, :2]
    assert np.ptp(before, axis=0).max() < 0.02
    middle = np.argmax(world.posture.position[:, 2])
    assert np.all(motion.contact[:15] > 0.9) and np.all(motion.contact[middle] < 0.1)
    assert abs(motion.scale - np.exp(world.posture.log_scale)) < 0.05


def test_rotations_and_translations_lead_to_the_joints(near) -> None:
    world, _, motion = near
    joints = world_joints(world.linkage.skeleton.parents, motion.joint_rotations, motion.joint_translations)
    np.testing.assert_allclose(joints, motion.joints, atol=1e-9)
    np.testing.assert_array_equal(motion.joints[:, 0], motion.root_position)


def test_covariance_is_of_the_errors_size(near) -> None:
    world, _, motion = near
    error = motion.root_position - world.posture.position
    std = np.sqrt(np.einsum("fii->fi", motion.root_cov))
    assert 0.3 < np.sqrt(np.mean((error / std) ** 2)) < 1.8
    doubted = registered(
        world,
        viewed(world),
        doubt=CameraDoubt(position_cov=0.25 * np.eye(3), focal_std_share=0.01, pixel_std=0.5),
        options=register_options("draft"),
    )
    assert np.all(np.linalg.eigvalsh(doubted.root_cov - 0.9 * motion.root_cov)[:, -1] > 0)


def test_strays_swaps_and_gaps_are_lived_with(near) -> None:
    world, view, _ = near
    rng = np.random.default_rng(5)
    points = np.array(view.points_px)
    stray = rng.random(points.shape[:2]) < 0.05
    points[stray] += 80.0 * rng.normal(size=(stray.sum(), 2))
    mirrored = np.arange(len(view.point_names))
    for left, right in mirror_pairs(view.point_names):
        mirrored[[left, right]] = right, left
    points[[7, 40]] = points[[7, 40]][:, mirrored]
    points[25:33] = np.nan
    sigma = np.where(np.isfinite(points[..., 0]), 2.0, np.nan)
    motion = registered(world, replace(view, points_px=points, sigma_px=sigma))
    assert np.all(motion.status[25:33] == "filled")
    assert np.isnan(motion.reprojection_px[25:33]).all()
    seen = np.r_[0:25, 33 : len(points)]
    assert rms(motion.root_position[seen] - world.posture.position[seen]) < 0.15
    assert rms((motion.joints[seen] - world.joints[seen]).reshape(-1, 3)) < 0.2


def test_a_long_gap_is_left_open_and_places_by_boxes_fill_it(near) -> None:
    world, view, _ = near
    points, sigma = np.array(view.points_px), np.array(view.sigma_px)
    points[20:45], sigma[20:45] = np.nan, np.nan
    motion = registered(world, replace(view, points_px=points, sigma_px=sigma), options=register_options("draft"))
    assert np.isnan(motion.joints[20:45]).all() and np.isfinite(motion.root_position).all()
    bare = replace(view, points_px=points, sigma_px=sigma, boxes_px=np.full_like(view.boxes_px, np.nan))
    motion = registered(world, bare, options=register_options("draft"))
    assert np.all(motion.status[20:45] == "none") and np.isnan(motion.root_position[20:45]).all()
    assert np.all(motion.status[:20] != "none")


def test_boxes_alone_give_the_root_with_its_doubt() -> None:
    world = jumping_world(frames=12, jump_s=(9.0, 9.5))
    motion = registered(world, viewed(world, points=False))
    assert np.all(motion.status == "measured") and "box" in motion.said
    assert np.isnan(motion.joints).all() and np.isnan(motion.contact).all()
    error = motion.root_position - world.posture.position
    whitened = np.einsum("fa,fab,fb->f", error, np.linalg.inv(motion.root_cov), error)
    assert np.all(whitened < 16.0)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_the_shortest_clips(frames: int) -> None:
    world = jumping_world(frames=frames, jump_s=(9.0, 9.5))
    motion = registered(world, viewed(world))
    assert np.all(motion.status == "measured")
    assert rms(motion.root_position - world.posture.position) < 0.6
    assert np.isfinite(motion.root_cov).all()


def test_repeats_show_what_their_source_shows_and_measure_nothing() -> None:
    world = jumping_world(frames=24, jump_s=(9.0, 9.5))
    view = viewed(world)
    repeat = np.zeros(24, dtype=bool)
    repeat[[6, 12, 23]] = True
    times = np.array(view.times)
    times[repeat] = times[np.flatnonzero(repeat) - 1]
    motion = registered(world, replace(view, times=times, is_duplicate=repeat), options=register_options("draft"))
    at = np.flatnonzero(repeat)
    np.testing.assert_allclose(motion.joints[at], motion.joints[at - 1], atol=1e-9)
    assert np.all(motion.status[at] == "filled")


@pytest.mark.parametrize(
    ("found", "said"), [(0, "neither points nor boxes"), (2, "too few points in every frame, and no boxes")]
)
def test_too_little_gives_none_and_says_why(found: int, said: str) -> None:
    world = jumping_world(frames=5, jump_s=(9.0, 9.5))
    view = viewed(world)
    points, sigma = np.array(view.points_px), np.array(view.sigma_px)
    points[:, found:], sigma[:, found:] = np.nan, np.nan
    motion = registered(
        world, replace(view, points_px=points, sigma_px=sigma, boxes_px=np.full_like(view.boxes_px, np.nan))
    )
    assert np.all(motion.status == "none") and motion.said == said and np.isnan(motion.root_position).all()


def test_no_camera_gives_none() -> None:
    world = jumping_world(frames=4, jump_s=(9.0, 9.5))
    view = viewed(world)
    nan = Camera(
        K=np.full((4, 3, 3), np.nan),
        distortion=np.full((4, 4), np.nan),
        R_cam_from_world=np.full((4, 3, 3), np.nan),
        t_cam_from_world=np.full((4, 3), np.nan),
    )
    motion = registered(world, replace(view, camera=nan, has_camera=np.zeros(4, dtype=bool)))
    assert np.all(motion.status == "none") and motion.said == "no frame has a camera"


def test_frames_without_a_camera_between_others_are_filled() -> None:
    world = jumping_world(frames=16, jump_s=(9.0, 9.5))
    view = viewed(world)
    lost = np.zeros(16, dtype=bool)
    lost[6:9] = True
    names = ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
    arrays = {name: np.array(getattr(view.camera, name)) for name in names}
    for values in arrays.values():
        values[lost] = np.nan
    motion = registered(world, replace(view, camera=Camera(**arrays), has_camera=~lost))
    assert np.all(motion.status[lost] == "filled") and np.all(motion.status[~lost] == "measured")
    assert rms(motion.root_position - world.posture.position) < 0.15


def test_half_a_body_and_a_tiny_one() -> None:
    world = jumping_world(frames=12, jump_s=(9.0, 9.5))
    view = viewed(world)
    low = np.array(view.point_names)
    legs = np.array([("knee" in name) or ("ankle" in name) or ("hip" in name) for name in low])
    points, sigma = np.array(view.points_px), np.array(view.sigma_px)
    points[:, legs], sigma[:, legs] = np.nan, np.nan
    motion = registered(world, replace(view, points_px=points, sigma_px=sigma))
    error = motion.root_position - world.posture.position
    assert np.all(motion.status == "measured") and rms(error) < 1.5
    camera = Camera(
        K=world.camera.K * np.array([[0.08, 1, 1], [1, 0.08, 1], [1, 1, 1]]),
        distortion=world.camera.distortion,
        R_cam_from_world=world.camera.R_cam_from_world,
        t_cam_from_world=world.camera.t_cam_from_world,
    )
    middle = world.camera.K[:, None, :2, 2]
    tiny = replace(world, camera=camera, pixels=middle + 0.08 * (world.pixels - middle))
    assert np.ptp(tiny.pixels[0, :, 1]) < 20
    motion = registered(tiny, viewed(tiny, noise_px=0.5))
    assert np.all(motion.status == "measured")
    assert rms(motion.root_position - world.posture.position) < 1.0


def test_one_who_lies_is_found_lying() -> None:
    world = jumping_world(frames=10, jump_s=(9.0, 9.5))
    tilt = rotation_from_rotvec(np.array([0.0, np.pi / 2, 0.0]))
    posture = replace(world.posture, rotation=tilt @ world.posture.rotation)
    points = placed(world.linkage, posture, slopes=False)[0]
    posture.position[:, 2] -= points[..., 2].min() - 0.05
    points = placed(world.linkage, posture, slopes=False)[0]
    lying = replace(world, posture=posture, pixels=project(world.camera, points[:, : world.linkage.seen])[0])
    motion = registered(lying, viewed(lying))
    assert np.all(motion.status == "measured")
    up = rotation_from_rotvec(motion.joint_rotations[:, 0])[:, 2, 1]
    assert np.all(np.abs(up) < 0.5)
    assert np.nanmean(motion.reprojection_px) < 6.0


def test_blocks_are_registered_too() -> None:
    world = jumping_world(skeleton="blocks13", place=(0.0, -6.0), frames=30, jump_s=(0.4, 0.8), scale=1.0)
    motion = registered(world, viewed(world))
    assert np.all(motion.status == "measured")
    assert rms(motion.root_position - world.posture.position) < 0.12


def test_a_guessed_shape_tells_a_limb_that_points_away_from_one_that_points_here() -> None:
    world = jumping_world(frames=3, jump_s=(9.0, 9.5))
    view = viewed(world)
    rows = np.arange(3)
    points = placed(world.linkage, world.posture, slopes=False)[0][:, : world.linkage.seen]
    shape = (points - points.mean(axis=1, keepdims=True)) @ world_from_ray(view, rows)
    plain = registered(world, view)
    known = registered(world, replace(view, points_ray=0.7 * shape))

    def relative(motion: PlayerMotion) -> float:
        off = (motion.joints - motion.joints[:, :1]) - (world.joints - world.joints[:, :1])
        return rms(off.reshape(-1, 3))

    assert relative(known) < min(0.07, relative(plain))


def test_presets_cost_more_as_they_promise_more() -> None:
    draft, standard, best = (register_options(quality) for quality in ("draft", "standard", "best"))
    assert draft.rounds < standard.rounds < best.rounds and draft.finest_s > standard.finest_s == 0


def test_a_view_says_what_is_wrong_with_it() -> None:
    view = viewed(jumping_world(frames=4, jump_s=(9.0, 9.5)))
    sigma = np.array(view.sigma_px)
    sigma[2, 3] = 0.0
    with pytest.raises(ValueError, match="sigma_px: frame 2: left_ear: expected above 0, got 0.0"):
        replace(view, sigma_px=sigma)
    with pytest.raises(ValueError, match="times: frame 1: expected finite and rising"):
        replace(view, times=np.array([0.0, -1.0, 2.0, 3.0]))
