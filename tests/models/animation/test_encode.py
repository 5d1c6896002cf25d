"""Encoding loses nothing, rotations go on past pi, and joints stand where the data have them."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pgm_models.animation.encode import (
    continuous,
    continuous_known,
    decode,
    encode,
    encode_constants,
    encode_known,
    standardise,
    unstandardise,
)
from pgm_models.animation.fit_layout import fit_layout
from pgm_models.animation.layout import Constant, Layout, Property
from pgm_models.animation.tangents import mean_rotvec, nearest_equal, rotvec_from_tangent, tangent_from_rotvec

SEEDS = st.integers(0, 2**32 - 1)


def vector(column: str, player: int, rng: np.random.Generator) -> Property:
    return Property(
        column=column,
        player=player,
        kind="vector",
        first=0,
        width=3,
        reference=np.zeros((0, 3)),
        channels=np.arange(3),
        rest=np.zeros(3),
        mean=rng.normal(0, 5, 3),
        std=rng.uniform(0.1, 9, 3),
    )


def rotations(column: str, first: int, moving: list[int], count: int, rng: np.random.Generator) -> Property:
    channels = (3 * np.array(moving)[:, None] + np.arange(3)).ravel()
    return Property(
        column=column,
        player=0,
        kind="rotations",
        first=first,
        width=3 * count,
        reference=rng.normal(size=(count, 3)),
        channels=channels,
        rest=rng.normal(0, 0.3, 3 * count),
        mean=rng.normal(0, 0.3, len(channels)),
        std=rng.uniform(0.05, 1, len(channels)),
    )


def some_layout(rng: np.random.Generator) -> Layout:
    """The person of the blocks world, 13 joints, of which the first, the fourth and the last turn."""
    return Layout(
        scene="blocks",
        players=("player0",),
        properties=(
            vector("player0.root_position", 0, rng),
            rotations("player0.root_rotation", 0, [0], 1, rng),
            rotations("player0.joint_rotations", 3, [0, 3, 11], 12, rng),
        ),
        constants=(
            Constant(
                column="player0.joint_translations",
                player=0,
                first=3,
                width=36,
                channels=np.array([4, 30]),
                rest=rng.normal(0, 0.3, 36),
                mean=np.array([0.4, -0.2]),
                std=np.array([0.02, 0.01]),
            ),
        ),
    )


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Largest angle between rotations given by axis-angle vectors, radians."""
    turned = Rotation.from_rotvec(one.reshape(-1, 3)).inv() * Rotation.from_rotvec(other.reshape(-1, 3))
    return float(turned.magnitude().max())


def some_rotvecs(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Axis-angle vectors: some next to nothing, some of exactly pi, some just below, some anywhere."""
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = rng.choice([0.0, 1e-9, np.pi, np.pi - 1e-6, rng.uniform(0, np.pi)], size=shape)
    return axis * angle[..., None]


@given(SEEDS)
def test_decoding_what_was_encoded_gives_it_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    layout = some_layout(rng)
    rows = 7
    entry = layout.properties[2]
    joints = np.zeros((rows, 13, 3))
    joints[:, 0] = some_rotvecs(rng, (rows,))
    joints[:, 1:] = rotvec_from_tangent(np.tile(entry.rest.reshape(1, 12, 3), (rows, 1, 1)), entry.reference)
    joints[:, [1, 4, 12]] = some_rotvecs(rng, (rows, 3))
    bones = np.tile(np.concatenate([np.zeros(3), layout.constants[0].rest]), (rows, 1))
    bones[:, [7, 33]] = rng.normal(0, 0.1, 2)
    columns = {
        "player0.root_position": rng.normal(0, 9, (rows, 3)),
        "player0.root_rotation": joints[:, 0],
        "player0.joint_rotations": joints.reshape(rows, -1),
        "player0.joint_translations": bones,
    }
    tangent, valid = encode(layout, columns)
    assert valid.all() and tangent.dtype == np.float32
    constants = encode_constants(layout, columns)[0]
    wound = continuous(layout, tangent[None])
    for state in (tangent[None], wound):
        back = decode(layout, standardise(layout, state), constants[None])
        np.testing.assert_allclose(back["player0.root_position"][0], columns["player0.root_position"], atol=2e-5)
        assert apart(back["player0.root_rotation"], joints[:, 0]) < 1e-5
        assert apart(back["player0.joint_rotations"], joints) < 1e-5
        np.testing.assert_allclose(back["player0.joint_translations"][0][:, 3:], bones[:, 3:], atol=1e-6)
        np.testing.assert_array_equal(back["player0.joint_rotations"][..., :3], back["player0.root_rotation"])
        np.testing.assert_array_equal(back["player0.joint_translations"][..., :3], back["player0.root_position"])
        assert all(values.dtype == np.float64 for values in back.values())


def test_what_is_not_there_is_zero_and_not_valid() -> None:
    layout = some_layout(np.random.default_rng(0))
    columns = {
        "player0.root_position": np.ones((4, 3)),
        "player0.root_rotation": np.ones((4, 3)),
        "player0.joint_rotations": np.ones((4, 39)),
        "player0.status": np.array(["measured", "none", "filled", "measured"], dtype=object),
    }
    columns["player0.joint_rotations"][0, 38] = np.nan
    columns["player0.root_rotation"][3] = np.nan
    tangent, valid = encode(layout, columns)
    np.testing.assert_array_equal(
        valid, [[True, True, False], [False, False, False], [True, True, True], [True, False, True]]
    )
    assert not tangent[~valid[:, layout.property_of_channel]].any() and tangent[2].all()
    tangent, valid = encode(layout, {"player0.root_position": np.ones((4, 3))})
    np.testing.assert_array_equal(valid, np.tile([True, False, False], (4, 1)))


def test_columns_that_are_too_narrow_are_refused() -> None:
    layout = some_layout(np.random.default_rng(0))
    with pytest.raises(ValueError, match="player0.joint_rotations: expected 39 numbers a row, got 36"):
        encode(layout, {"player0.joint_rotations": np.ones((4, 36))})


def one_rotation(rng: np.random.Generator) -> Layout:
    return Layout(
        scene="blocks",
        players=("player0",),
        properties=(rotations("player0.root_rotation", 0, [0], 1, rng),),
        constants=(),
    )


@given(SEEDS, st.floats(-3.1, 3.1))
def test_a_spin_goes_on_past_pi(seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    layout = one_rotation(rng)
    axis = rng.normal(size=3)
    angle = rng.uniform(-1, 1) + step * np.arange(24)
    spin = axis / np.linalg.norm(axis) * angle[:, None]
    reference = Rotation.from_rotvec(layout.properties[0].reference[0].copy())
    column = (reference * Rotation.from_rotvec(spin)).as_rotvec()
    tangent, _ = encode(layout, {"player0.root_rotation": column})
    wound = continuous(layout, tangent[None].astype(np.float64))[0]
    expected = spin
    # Where a sample is next to nothing, its axis is lost in float32.
    clear = np.abs(np.angle(np.exp(1j * angle))) > 1e-3
    if clear.all():
        np.testing.assert_allclose(wound, expected, atol=1e-3)
    assert np.linalg.norm(wound[0]) <= np.pi + 1e-6
    back = decode(layout, standardise(layout, wound[None]), np.zeros((1, 0)))["player0.root_rotation"][0]
    assert apart(back, column) < 1e-5


def slow_continuous(tangent: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Frame by frame, the best of many turns."""
    result, last = tangent.copy(), None
    for frame in range(len(tangent)):
        if not valid[frame]:
            continue
        v = tangent[frame]
        if last is not None:
            length = np.linalg.norm(v)
            equals = [v * (1 + 2 * np.pi * turns / length) for turns in range(-9, 10)]
            v = min(equals, key=lambda equal: float(np.linalg.norm(equal - last)))
        result[frame] = last = v
    return result


@settings(max_examples=20)
@given(SEEDS)
def test_continuous_is_the_nearest_equal_of_the_last_valid_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    layout = some_layout(rng)
    tangent = np.zeros((3, 12, layout.channels))
    tangent[..., :3] = rng.normal(size=(3, 12, 3))
    vectors = rng.normal(size=(3, 12, 4, 3))
    vectors *= rng.uniform(2, np.pi, (3, 12, 4, 1)) / np.linalg.norm(vectors, axis=-1, keepdims=True)
    # About one axis they wind up.
    vectors[0] = np.abs(vectors[0]) * np.sign(rng.normal(size=(12, 4, 1)))
    tangent[..., 3:] = vectors.reshape(3, 12, 12)
    valid = rng.random((3, 12, 3)) < 0.7
    wound = continuous(layout, tangent, valid=valid)
    np.testing.assert_array_equal(wound[..., :3], tangent[..., :3])
    for window in range(3):
        for rotation in range(4):
            own = valid[window, :, 1 if rotation == 0 else 2]
            expected = slow_continuous(vectors[window, :, rotation], own)
            got = wound[window, :, 3 + 3 * rotation : 6 + 3 * rotation]
            np.testing.assert_allclose(got, expected, atol=1e-9)
    np.testing.assert_array_equal(continuous_known(layout, tangent, valid), wound)
    everywhere = continuous(layout, tangent, valid=np.ones_like(valid))
    np.testing.assert_array_equal(continuous(layout, tangent), everywhere)


def test_what_was_wound_already_may_come_in() -> None:
    layout = one_rotation(np.random.default_rng(1))
    spin = np.linspace(0.1, 30, 40)[None, :, None] * np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(continuous(layout, spin), spin, atol=1e-9)


@given(SEEDS)
def test_the_nearest_equal_is_the_same_rotation_and_none_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tangent, target = rng.normal(0, 4, (2, 20, 3))
    near = nearest_equal(tangent, target)
    assert apart(near, tangent) < 1e-6
    axis = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    for turns in (-1, 1):
        other = near + 2 * np.pi * turns * axis
        assert (np.linalg.norm(near - target, axis=1) <= np.linalg.norm(other - target, axis=1) + 1e-9).all()


def test_what_does_not_turn_goes_along_with_what_was_before() -> None:
    target = np.array([[0.0, 6.5, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    near = nearest_equal(np.zeros((3, 3)), target)
    np.testing.assert_allclose(near, [[0, 2 * np.pi, 0], [0, 0, 0], [0, 0, 0]], atol=1e-9)


@given(SEEDS)
def test_tangents_are_within_pi_and_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    reference = some_rotvecs(rng, (5,))
    rotvec = some_rotvecs(rng, (6, 5)) * rng.choice([1.0, 3.0], size=(6, 5, 1))
    tangent = tangent_from_rotvec(rotvec, reference)
    assert np.linalg.norm(tangent, axis=-1).max() <= np.pi + 1e-9
    assert apart(rotvec_from_tangent(tangent, reference), rotvec) < 1e-7
    slow = np.tile(Rotation.from_rotvec(reference).as_matrix().swapaxes(1, 2), (6, 1, 1, 1))
    slow = slow @ Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix().reshape(6, 5, 3, 3)
    assert apart(tangent, Rotation.from_matrix(slow.reshape(-1, 3, 3)).as_rotvec()) < 1e-7
    assert tangent_from_rotvec(rotvec[:0], reference).shape == (0, 5, 3)


def test_the_mean_rotation_is_scipys() -> None:
    rng = np.random.default_rng(4)
    turned = [Rotation.from_rotvec(rng.normal(0, 1, (30, 3))) for _ in range(3)]
    summed = np.stack([one.as_matrix().sum(axis=0) for one in turned])
    expected = np.stack([one.mean().as_rotvec() for one in turned])
    assert apart(mean_rotvec(summed), expected) < 1e-7


def read(dataset: Path) -> dict[str, np.ndarray]:
    (path,) = sorted((dataset / "data").glob("*/*.parquet"))
    table = pq.read_table(path)
    wide = [name for name in table.column_names if str(table.schema.field(name).type).startswith("fixed")]
    return {name: np.stack(table.column(name).to_numpy()).astype(np.float64) for name in wide}


def test_joints_stand_where_the_data_have_them(tennis_dataset: Path) -> None:
    layout, columns = fit_layout(tennis_dataset), read(tennis_dataset)
    rows = slice(0, 120)
    columns = {name: values[rows] for name, values in columns.items()}
    tangent, valid = encode(layout, columns)
    assert valid[:, :6].all()
    state = standardise(layout, tangent).reshape(4, 30, -1)
    constants = encode_constants(layout, columns).reshape(4, 30, -1)[:, 0]
    back = decode(layout, state, constants)
    for name in ("joints", "joint_rotations", "joint_translations", "root_position", "root_rotation"):
        for player in ("player0", "player1"):
            column = f"{player}.{name}"
            given_values, got = columns[column].reshape(4, 30, -1), back[column]
            assert got.shape == given_values.shape
            if "rotation" in name:
                assert apart(got, given_values) < 1e-4
            else:
                np.testing.assert_allclose(got, given_values, atol=2e-4)


def test_known_values_are_encoded_as_the_data_are(tennis_dataset: Path) -> None:
    layout, columns = fit_layout(tennis_dataset), read(tennis_dataset)
    columns = {name: values[:50] for name, values in columns.items()}
    tangent, _ = encode(layout, columns)
    for row in range(6):
        column = layout.properties[row].column
        known = encode_known(layout, column, columns[column])
        np.testing.assert_array_equal(known, tangent[:, layout.slice_of(row)])
    spoilt = columns["player0.joint_rotations"].copy()
    spoilt[3, 7] = np.nan
    with pytest.raises(
        ValueError, match="player0.joint_rotations: expected finite numbers, got nan in row 3, number 7"
    ):
        encode_known(layout, "player0.joint_rotations", spoilt)
    with pytest.raises(ValueError, match="column: expected one of .*ball.velocity, got 'player0.joints'"):
        encode_known(layout, "player0.joints", spoilt)


@given(SEEDS)
def test_standard_channels_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    layout = some_layout(rng)
    tangent = rng.normal(0, 3, (2, 5, layout.channels))
    np.testing.assert_allclose(unstandardise(layout, standardise(layout, tangent)), tangent, atol=1e-9)
    assert standardise(layout, tangent.astype(np.float32)).dtype == np.float32
    mean = np.concatenate([entry.mean for entry in layout.properties])
    assert not standardise(layout, mean).any()


def test_unknown_constants_are_average() -> None:
    layout = some_layout(np.random.default_rng(0))
    missing = np.full((2, 39), np.nan)
    assert not encode_constants(layout, {"player0.joint_translations": missing}).any()
    bones = decode(layout, np.zeros((1, layout.channels)), np.zeros(2))["player0.joint_translations"]
    np.testing.assert_allclose(bones[0, [7, 33]], [0.4, -0.2])
