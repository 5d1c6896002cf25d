from dataclasses import replace

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.skeleton import world_joints
from pgm_models.animation.encode import decode
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.settle import settled, settled_windows
from pgm_models.animation.store import open_store
from pgm_models.animation.window_source import all_windows

TENNIS = load_scene("tennis")


@pytest.fixture(scope="module")
def real(tennis_dataset, tmp_path_factory):
    """Four real windows of 24 frames at 25 a second: their columns and rate."""
    store = open_store(tennis_dataset, fit_layout(tennis_dataset), tmp_path_factory.mktemp("store"))
    (windows,) = all_windows(store, 24, 25.0, 4)
    return decode(store.layout, windows.state.double().numpy(), windows.constants.double().numpy()), 25.0


def noisy(columns, seed=0):
    rng = np.random.default_rng(seed)
    made = {name: np.array(values) for name, values in columns.items()}
    made["ball.position"] += rng.normal(0, 0.1, made["ball.position"].shape)
    made["ball.velocity"] += rng.normal(0, 1.0, made["ball.velocity"].shape)
    for player in ("player0", "player1"):
        made[f"{player}.root_position"] += rng.normal(0, 0.02, made[f"{player}.root_position"].shape)
    return made


def test_play_that_is_real_stays_nearly_where_it_is(real):
    columns, rate = real
    found = settled_windows(columns, {}, np.full(4, rate), TENNIS)
    for name, most in (("ball.position", 0.05), ("player0.root_position", 0.02), ("player1.root_position", 0.02)):
        moved = np.linalg.norm(found[name] - columns[name], axis=-1)
        assert np.median(moved) < most, name


def test_what_is_known_stays_to_the_bit_and_the_rest_is_one_body(real):
    columns, rate = real
    made = {name: values[0] for name, values in noisy(columns).items()}
    known = np.zeros(24, dtype=bool)
    known[[0, 11]] = True
    found = settled(made, dict.fromkeys(made, known), np.arange(24) / rate, TENNIS)
    for name in ("ball.position", "ball.velocity", "player0.root_position", "player1.joint_rotations"):
        np.testing.assert_array_equal(found.columns[name][known], made[name][known], err_msg=name)
    for player in TENNIS.players:
        rotations, bones = (
            found.columns[f"{player.name}.{part}"].reshape(24, -1, 3)
            for part in ("joint_rotations", "joint_translations")
        )
        np.testing.assert_array_equal(rotations[:, 0], found.columns[f"{player.name}.root_rotation"])
        np.testing.assert_array_equal(bones[:, 0], found.columns[f"{player.name}.root_position"])
        joints = world_joints(player.skeleton.parents, rotations, bones).reshape(24, -1)
        np.testing.assert_allclose(found.columns[f"{player.name}.joints"], joints, atol=1e-9)
    assert len(found.notes) == 3 and found.notes[2].startswith("ball: moved")
    assert found.columns["ball.position"][:, 2].min() >= TENNIS.ball.radius_m - 1e-9


def test_noise_is_taken_from_the_ball(real):
    columns, rate = real
    made = noisy(columns)
    found = settled_windows(made, {}, np.full(4, rate), TENNIS)
    before, after = (
        np.linalg.norm(those["ball.position"] - columns["ball.position"], axis=-1).mean() for those in (made, found)
    )
    assert after < 0.8 * before


def test_a_scene_without_flat_ground_and_ball_is_left_alone(real):
    columns, rate = real
    one = {name: values[0] for name, values in noisy(columns).items() if name.startswith("player0")}
    found = settled(one, {}, np.arange(24) / rate, replace(TENNIS, court=None, ball=None))
    assert found.notes == ()
    for name, values in one.items():
        np.testing.assert_array_equal(found.columns[name], values)
