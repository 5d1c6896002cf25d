import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from pgm_data.scene import load_scene
from pgm_data.simulate.blocks.shots import blocks_shots

SCENE = load_scene("blocks")
ROOT = Path(__file__).parents[3]


def digest(shot) -> str:
    player = shot.states.players[0]
    parts = [player.rotations, player.translations, player.joints, player.contact, player.hull_centres]
    parts += [shot.track.K, shot.track.R_cam_from_world, shot.track.t_cam_from_world, shot.timestamps]
    text = repr([(c.start_s, c.end_s, c.texts) for c in shot.states.captions]).encode()
    return hashlib.sha256(b"".join(p.tobytes() for p in parts) + text).hexdigest()


CODE = """
import hashlib, sys
sys.path.insert(0, {here!r})
from test_shots import SCENE, blocks_shots, digest
shot = next(blocks_shots(SCENE, 4, frames=40, fps=20.0, size=(160, 90)))
print(digest(shot), hashlib.sha256(shot.draw(7).tobytes()).hexdigest())
"""


def test_another_process_makes_the_same_bytes():
    code = CODE.format(here=str(Path(__file__).parent))
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "77", "PATH": "/usr/bin:/bin"},
    )
    shot = next(blocks_shots(SCENE, 4, frames=40, fps=20.0, size=(160, 90)))
    picture = hashlib.sha256(shot.draw(7).tobytes()).hexdigest()
    assert done.stdout.split() == [digest(shot), picture]


def test_frames_can_be_drawn_in_any_order():
    first = next(blocks_shots(SCENE, 4, frames=12, fps=20.0, size=(96, 54)))
    again = next(blocks_shots(SCENE, 4, frames=12, fps=20.0, size=(96, 54)))
    forward = [first.draw(i) for i in range(0, 12, 4)]
    for i in (8, 0, 4):
        label, depth = again.masks(i)
        np.testing.assert_array_equal(again.draw(i), forward[i // 4])
        assert label.shape == depth.shape == (54, 96)
    assert not np.array_equal(forward[0], forward[2])


def test_other_seeds_make_other_matches():
    a, b = (next(blocks_shots(SCENE, s, frames=30, fps=20.0, size=(96, 54))) for s in (4, 1))
    assert digest(a) != digest(b)
    assert not np.array_equal(a.world.cells, b.world.cells)


def test_matches_in_one_world_share_it_and_its_light_and_nothing_else():
    size = (128, 72)
    walks = [next(blocks_shots(SCENE, seed, frames=3, fps=20.0, size=size, world_seed=9)) for seed in (1, 2)]
    assert np.array_equal(walks[0].world.cells, walks[1].world.cells)
    assert digest(walks[0]) != digest(walks[1])
    one, other = (walk.studio for walk in walks)
    assert not np.array_equal(one.skin.faces["head", "front"], other.skin.faces["head", "front"])
    # Where both cameras are the same, all but the player looks the same.
    track, posture = walks[0].track, walks[0].posture
    pictures = [studio.picture(track, posture, 1, size) for studio in (one, other)]
    player = one.masks(track, posture, 1, size)[0] == 1
    far = np.logical_not(binary_dilation(player, iterations=3))
    assert np.array_equal(pictures[0][far], pictures[1][far]) and player.sum() > 20
    assert not np.array_equal(pictures[0][player], pictures[1][player])


def test_a_world_with_the_seed_of_a_match_is_that_of_the_match():
    plain = next(blocks_shots(SCENE, 4, frames=5, fps=20.0, size=(96, 54)))
    own = next(blocks_shots(SCENE, 4, frames=5, fps=20.0, size=(96, 54), world_seed=4))
    assert digest(plain) == digest(own)
    assert np.array_equal(plain.world.cells, own.world.cells)


def test_a_generator_serves_as_a_seed():
    a, b = (next(blocks_shots(SCENE, np.random.default_rng(5), frames=3, fps=20.0, size=(64, 36))) for _ in range(2))
    assert digest(a) == digest(b)


@pytest.fixture(scope="module")
def match():
    return list(blocks_shots(SCENE, 4, frames=240, fps=1.0, size=(1024, 576)))


def test_a_match_is_shots_of_30_to_80_seconds_in_one_world(match):
    lengths = [len(s) for s in match]
    assert sum(lengths) == 240
    assert len(match) >= 3
    assert all(29 <= n <= 80 for n in lengths[:-1])
    np.testing.assert_array_equal(np.concatenate([s.timestamps for s in match]), np.arange(240))
    for shot in match:
        assert shot.world is match[0].world
        assert shot.states.players[0].identity == match[0].states.players[0].identity
        assert shot.states.ball is None
        assert shot.states.events == shot.states.flights == ()
        assert shot.states.captions[0].start_s == 0.0
        assert shot.states.captions[-1].end_s == pytest.approx(len(shot))
        assert len(shot.track) == len(shot) == len(shot.states.players[0].joints)


def test_the_camera_goes_round_slowly_without_a_break(match):
    R = np.concatenate([s.track.R_cam_from_world for s in match])
    t = np.concatenate([s.track.t_cam_from_world for s in match])
    centre = -np.einsum("fji,fj->fi", R, t)
    bearing = np.unwrap(np.arctan2(centre[:, 1], centre[:, 0]))
    step = np.diff(bearing)
    assert (np.sign(step) == np.sign(step[0])).all()
    assert 0.005 < np.abs(step).mean() < 0.12
    assert np.linalg.norm(np.diff(centre, axis=0), axis=1).max() < 4.0
    assert (np.linalg.norm(centre[:, :2], axis=1) > 16).all()
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)


def test_the_player_stays_in_the_picture_and_in_its_region(match):
    low, high = SCENE.players[0].region_m
    for shot in match:
        hull = shot.states.players[0].hull_centres
        seen = np.einsum("fij,fpj->fpi", shot.track.R_cam_from_world, hull) + shot.track.t_cam_from_world[:, None]
        pixels = seen[..., :2] / seen[..., 2:] * shot.track.K[0, 0, 0] + shot.track.K[0, :2, 2]
        assert (pixels > -0.5).all()
        assert (pixels < np.array(shot.size) - 0.5).all()
        root = shot.states.players[0].joints[:, 0]
        assert (root > np.array(low)).all()
        assert (root < np.array(high)).all()


def test_frame_rate_and_size_look_at_the_same_match(match):
    slow = match[0]
    quick = next(blocks_shots(SCENE, 4, frames=2401, fps=240.0, size=(64, 36)))
    np.testing.assert_allclose(
        quick.states.players[0].joints[::240], slow.states.players[0].joints[:11], atol=1e-9, rtol=0
    )
    np.testing.assert_array_equal(quick.states.players[0].contact[::240], slow.states.players[0].contact[:11])
    np.testing.assert_allclose(quick.track.t_cam_from_world[::240][:, 2] > 0, True)
    same = [(a.start_s, a.texts) for a in slow.states.captions if a.end_s < 9]
    assert [(a.start_s, a.texts) for a in quick.states.captions if a.end_s < 9] == same


@pytest.mark.parametrize("fps", [1.0, 20.0, 240.0])
def test_one_frame_is_a_match(fps):
    (shot,) = blocks_shots(SCENE, 4, frames=1, fps=fps, size=(64, 36))
    assert len(shot) == 1
    assert shot.draw(0).shape == (36, 64, 3)
    assert [(c.start_s, c.end_s) for c in shot.states.captions][0][0] == 0.0
    assert shot.states.captions[-1].end_s == pytest.approx(1 / fps)
    assert all(c.texts for c in shot.states.captions)


@pytest.mark.parametrize(("width", "height"), [(16, 16), (64, 200), (401, 33)])
def test_odd_sizes_show_all_of_the_player(width, height):
    (shot,) = blocks_shots(SCENE, 4, frames=2, fps=1.0, size=(width, height))
    assert shot.draw(1).shape == (height, width, 3)
    label, depth = shot.masks(1)
    assert set(np.unique(label)) <= {0, 1, 2}
    assert np.isfinite(depth[label > 0]).all()
    assert np.isinf(depth[label == 0]).all()


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="frames >= 1"):
        blocks_shots(SCENE, 0, frames=0, fps=20.0, size=(64, 36))
    with pytest.raises(ValueError, match="0 < fps"):
        blocks_shots(SCENE, 0, frames=1, fps=0.0, size=(64, 36))
    with pytest.raises(ValueError, match="expected one player of skeleton blocks13"):
        blocks_shots(load_scene("tennis"), 0, frames=1, fps=20.0, size=(64, 36))
