"""Physics and references that truth keeps and that a spoilt table breaks, one at a time."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_laws import speed_faults
from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import load_scene
from pgm_data.skeleton import world_joints
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
Change = Callable[[dict[str, np.ndarray]], object]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("truth") / "clip"
    write_truth_clip(folder, TENNIS, frames=30)
    return folder


def put(name: str, where, value) -> Change:
    return lambda columns: columns[name].__setitem__(where, value)


def add(name: str, where, value) -> Change:
    return lambda columns: columns[name].__setitem__(where, columns[name][where] + value)


def together(*changes: Change) -> Change:
    return lambda columns: [change(columns) for change in changes]


FAULTS: dict[str, tuple[str, Change, str, str]] = {
    "a joint 2 mm off": ("players", add("player0.joints", (3, 30), 2e-3), "player0.joints", "rotations"),
    "a joint turned": ("players", add("player1.joint_rotations", (3, 5), 0.3), "player1.joints", "rotations"),
    "a root elsewhere": ("players", add("player0.root_position", (4, 1), 0.5), "player0.joints", "entry 0"),
    "a root turned": ("players", add("player0.root_rotation", (4, 1), 0.5), "player0.joint_rotations", "entry 0"),
    "a player who jumps across the court": (
        "players",
        together(
            *(
                add(f"player1.{name}", (slice(9, None), slice(1, 72, 3) if name == "joints" else 1), -24.0)
                for name in ("joints", "root_position", "joint_translations")
            )
        ),
        "player1.root_position",
        "at most 120 m/s",
    ),
    "a ball faster than any": ("ball", put("ball.velocity", 3, [0, 121, 0]), "ball.velocity", "at most 120 m/s"),
    "a ball under the ground": ("ball", put("ball.position", (7, 2), -0.021), "ball.position", "at least -0.02"),
    "a score above 1": ("ball", put("ball.score", 7, 1.5), "ball.score", "probability"),
    "an event that is in no table": ("ball", put("ball.event", 3, "hit"), "ball.event", "events.parquet"),
    "an event that no frame shows": ("ball", put("ball.event", 0, "none"), "ball.event", "events.parquet"),
    "a bounce under the ground": ("events", put("position", (2, 2), -0.5), "position", "at least -0.02"),
    "events out of order": ("events", put("time", 4, 0.1), "time", "row before"),
    "a frame that is not the nearest": ("events", put("frame_index", 5, 27), "frame_index", "nearest"),
    "a flight that starts before its event": ("ball_shots", add("start_time", 2, -0.01), "start_time", "start_event"),
    "a flight whose event is not there": ("ball_shots", put("end_event", 4, 6), "end_event", "6 events"),
    "a serve of 130 m/s": ("ball_shots", put("start_speed", 0, 130.0), "start_speed", "at most 120"),
    "a spin beyond any": ("ball_shots", put("spin", (0, 1), 2100.0), "spin", "at most 2000"),
    "a landing under the ground": ("ball_shots", put("landing_position", (1, 2), -1.0), "landing_position", "-0.02"),
    "a caption after the clip": ("captions", put("end_frame", 0, 31), "end_frame", "0 to 30"),
    "an alternative to nothing": ("captions", put("player", 0, 1), "alternative", "a main text"),
    "a main text twice": ("captions", put("alternative", 1, 0), "alternative", "once"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_one_spoilt_value_is_found_where_it_is(sound: Path, tmp_path: Path, fault: str) -> None:
    table, change, field, expected = FAULTS[fault]
    folder = tmp_path / "clip"
    shutil.copytree(sound, folder)
    columns = read_table(folder / f"{table}.parquet")
    change(columns := {name: values.copy() for name, values in columns.items()})
    write_table(folder / f"{table}.parquet", table=table, scene=TENNIS, columns=columns)
    found = check_paths([folder])
    assert any(v.field == field and expected in v.expected for v in found), [str(v) for v in found]


def test_a_ball_lower_than_a_table_is_no_fault_where_the_floor_is_lower(tmp_path: Path) -> None:
    scene = load_scene("tabletennis")
    folder = tmp_path / "clip"
    write_truth_clip(folder, scene)
    columns = read_table(folder / "ball.parquet")
    for height, faults in ((-0.7, 0), (-0.79, 1)):
        columns["ball.position"] = columns["ball.position"].copy()
        columns["ball.position"][5:, 2] = height
        write_table(folder / "ball.parquet", table="ball", scene=scene, columns=columns)
        assert [v.field for v in check_paths([folder])] == ["ball.position"] * faults


@given(seed=st.integers(0, 1000), joints=st.integers(1, 8), frames=st.integers(0, 4))
def test_forward_kinematics_is_the_product_of_rigid_transforms(seed: int, joints: int, frames: int) -> None:
    rng = np.random.default_rng(seed)
    parents = np.array([-1, *(int(rng.integers(0, j)) for j in range(1, joints))])
    turns, shifts = rng.normal(size=(2, frames, joints, 3))
    found = world_joints(parents, turns, shifts)
    for i in range(frames):
        world: list[np.ndarray] = []
        for j, parent in enumerate(parents):
            own = np.eye(4)
            own[:3, :3], own[:3, 3] = Rotation.from_rotvec(turns[i, j]).as_matrix(), shifts[i, j]
            world.append(own if parent < 0 else world[parent] @ own)
        np.testing.assert_allclose(found[i], [matrix[:3, 3] for matrix in world], atol=1e-9)


def test_gaps_repeats_and_single_rows_have_no_speed() -> None:
    position = np.array([[0.0, 0, 0], [np.nan, 0, 0], [900.0, 0, 0], [0.0, 0, 0]])
    assert list(speed_faults("p", position, np.array([0.0, 1.0, 2.0, 2.0]))) == []
    assert list(speed_faults("p", position[:1], np.zeros(1))) == []
    assert len(list(speed_faults("p", position[[0, 2]], np.array([0.0, 7.4])))) == 1
    assert list(speed_faults("p", position[[0, 2]], np.array([0.0, 7.6]))) == []
