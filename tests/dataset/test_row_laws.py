"""Two hundred random values that break a stated rule are each found in their column; noise breaks none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pgm_data.dataset.clip_laws import net_faults, player_speed_faults
from pgm_data.dataset.dataset_columns import data_columns, row_tables
from pgm_data.dataset.laws import Context
from pgm_data.dataset.player_laws import players_faults
from pgm_data.dataset.rows_check import EpisodeRows, episode_faults
from pgm_data.dataset.tables import read_table
from pgm_data.scene import load_scene

TENNIS = load_scene("tennis")
MUTATIONS = 200
Columns = dict[str, np.ndarray]
Rule = tuple[str, str, Callable[[Columns, int, np.random.Generator], None]]
"""Table and column that a change spoils, and the change of one row."""


@pytest.fixture(scope="module")
def sound(small_dataset: Path) -> EpisodeRows:
    """The first clip of the dataset, 30 frames long."""
    tables = {name: read_table(small_dataset / name / "chunk-000" / "file-000.parquet") for name in row_tables(TENNIS)}
    data = read_table(small_dataset / "data" / "chunk-000" / "file-000.parquet")
    own = {name: {key: v[t["episode_index"] == 0] for key, v in t.items()} for name, t in tables.items()}
    rows = data["episode_index"] == 0
    context = Context(
        scene=TENNIS, clip_id="a.00", n_frames=30, first_video_frame=0, size=(1280, 720), quality="standard"
    )
    data = {name: values[rows].copy() for name, values in data.items()}
    data["camera.inliers"][:] = 9  # as our own solver has it, whose cameras owe their support
    return EpisodeRows(data=data, own=own, first_index=0, rate=25.0, context=context)


def put(value: object) -> Callable[[Columns, str, int, np.random.Generator], None]:
    def change(columns: Columns, name: str, row: int, rng: np.random.Generator) -> None:
        columns[name][row] = value(rng) if callable(value) else value

    return change


def add(amount: Callable[[np.random.Generator], object]) -> Callable[[Columns, str, int, np.random.Generator], None]:
    def change(columns: Columns, name: str, row: int, rng: np.random.Generator) -> None:
        columns[name][row] = columns[name][row] + amount(rng)

    return change


def entry(made: Callable[[np.random.Generator], object]) -> Callable[[Columns, str, int, np.random.Generator], None]:
    """One random number of a vector."""

    def change(columns: Columns, name: str, row: int, rng: np.random.Generator) -> None:
        columns[name][row, rng.integers(columns[name].shape[1])] = made(rng)

    return change


def shift(
    amount: Callable[[np.random.Generator], np.ndarray],
) -> Callable[[Columns, str, int, np.random.Generator], None]:
    """The whole body of a frame elsewhere, its columns in accord."""

    def change(columns: Columns, name: str, row: int, rng: np.random.Generator) -> None:
        player, by = name.split(".")[0], amount(rng)
        columns[f"{player}.joints"][row] += np.tile(by, 24).astype(np.float32)
        columns[f"{player}.root_position"][row] += by.astype(np.float32)
        columns[f"{player}.joint_translations"][row, :3] += by.astype(np.float32)

    return change


def absent(columns: Columns, name: str, row: int, rng: np.random.Generator) -> None:
    """A status that says there is nothing, beside values."""
    columns[f"{name.split('.')[0]}.status"][row] = "none"


def negative(rng: np.random.Generator) -> float:
    return -rng.uniform(0.01, 100.0)


def beyond_one(rng: np.random.Generator) -> float:
    return rng.choice([-1.0, 1.0]) * rng.uniform(1.001, 10.0)


def not_psd(rng: np.random.Generator) -> np.ndarray:
    return np.array([1.0, rng.uniform(1.5, 9.0), 0, 1.0, 0, 1.0])


NAN = float("nan")
DATA_RULES = [
    ("frame_index", add(lambda rng: rng.integers(1, 9))),
    ("video_frame", add(lambda rng: -rng.integers(1, 4))),
    ("source_timestamp", add(lambda rng: -rng.uniform(0.04, 0.5))),
    ("source_timestamp", put(NAN)),
    ("timestamp", add(lambda rng: rng.uniform(0.01, 1.0))),
    ("index", add(lambda rng: rng.integers(1, 9))),
    ("task_index", put(lambda rng: rng.integers(1, 9))),
    ("clip_id", put("somebody else's")),
    ("frame.capture_time", add(lambda rng: -rng.uniform(0.05, 0.5))),
    ("frame.capture_time", put(lambda rng: 1e8)),
    ("camera.status", put("perhaps")),
    ("camera.K", put(lambda rng: np.array([rng.uniform(1, 40), 0, 640, 0, 1500, 360, 0, 0, 1]))),
    ("camera.K", entry(lambda rng: NAN)),
    ("camera.K", lambda c, n, r, rng: c[n][r].__setitem__(1, rng.uniform(1, 9))),
    ("camera.K", lambda c, n, r, rng: c[n][r].__setitem__(2, rng.uniform(4000, 9000))),
    ("camera.R_cam_from_world", lambda c, n, r, rng: c[n][r].__imul__(rng.uniform(1.0001, 2))),
    ("camera.R_cam_from_world", lambda c, n, r, rng: c[n][r].__imul__(-1.0)),
    ("camera.R_cam_from_world", entry(lambda rng: rng.uniform(1.1, 3.0))),
    ("camera.t_cam_from_world", lambda c, n, r, rng: c[n][r].__imul__(-1.0)),
    ("camera.t_cam_from_world", put(lambda rng: rng.uniform(1e4, 1e5, 3))),
    ("camera.t_cam_from_world", entry(lambda rng: np.inf)),
    ("camera.distortion", entry(lambda rng: 1e13)),
    ("camera.inliers", put(lambda rng: -rng.integers(1, 9))),
    ("camera.inliers", put(0)),
    ("camera.reprojection_px", put(negative)),
    ("camera.focal_std_px", put(NAN)),
    ("camera.position_cov", put(not_psd)),
    ("camera.K", absent),
    ("player0.identity", None),
    ("player0.status", put("maybe")),
    ("player0.joints", absent),
    ("player1.root_cov", absent),
    ("player1.box_px", lambda c, n, r, rng: c[n].__setitem__(r, c[n][r][[2, 1, 0, 3]])),
    ("player0.box_px", entry(lambda rng: NAN)),
    ("player0.keypoints_px", lambda c, n, r, rng: c[n][r].__setitem__(2 * rng.integers(9), NAN)),
    ("player1.contact", entry(beyond_one)),
    ("player1.root_cov", put(not_psd)),
    ("player0.reprojection_px", put(negative)),
    ("player0.root_position", put(NAN)),
    ("player0.joints", lambda c, n, r, rng: c[n][r].__setitem__(rng.integers(3, 72), 90.0)),
    ("player0.joints", entry(lambda rng: np.inf)),
    ("player1.joints", lambda c, n, r, rng: c["player1.joint_rotations"][r, 3:6].__iadd__(rng.uniform(0.3, 0.5))),
    ("player0.joints", lambda c, n, r, rng: c["player0.root_position"][r].__iadd__(rng.uniform(0.01, 0.5))),
    ("player1.joint_rotations", lambda c, n, r, rng: c["player1.root_rotation"][r].__iadd__(rng.uniform(0.01, 0.5))),
    ("player1.joint_translations", lambda c, n, r, rng: c[n][r, 3:].__imul__(rng.uniform(1.5, 3.0))),
    ("player0.joints", shift(lambda rng: np.array([0, 0, -rng.uniform(1.6, 4.0)]))),
    ("player1.root_position", shift(lambda rng: np.array([rng.choice([-1, 1]) * rng.uniform(18.0, 40.0), 0, 0]))),
    ("player0.root_position", shift(lambda rng: np.array([0, rng.uniform(7.0, 9.0), 0]))),
    ("ball.velocity", put(lambda rng: np.array([0, rng.uniform(121, 500), 0]))),
    ("ball.velocity", entry(lambda rng: NAN)),
    ("ball.pixel", entry(lambda rng: NAN)),
    ("ball.position", lambda c, n, r, rng: c[n][r].__setitem__(2, -rng.uniform(0.1, 5.0))),
    ("ball.position", put(lambda rng: np.array([rng.uniform(150, 900), 0, 1]))),
    ("ball.position", put(NAN)),
    ("ball.position", absent),
    ("ball.position_cov", put(not_psd)),
    ("ball.score", put(beyond_one)),
    ("ball.event", put("kick")),
    ("ball.status", put("gone")),
    ("player0.caption", put(lambda rng: f"flies {rng.integers(99)} times")),
]  # fmt: skip
OWN_RULES = {
    "events": [
        ("clip_id", put("elsewhere")),
        ("time", put(NAN)),
        ("time", add(lambda rng: -rng.uniform(5.0, 9.0))),
        ("frame_index", put(lambda rng: rng.integers(30, 99))),
        ("frame_index", put(lambda rng: -rng.integers(1, 9))),
        ("kind", put("kick")),
        ("player", put("player7")),
        ("probability", put(beyond_one)),
        ("source", put("rumour")),
        ("position", put(lambda rng: np.array([0, 0, -rng.uniform(0.1, 3.0)]))),
        ("position", entry(lambda rng: NAN)),
    ],
    "ball_shots": [
        ("start_event", put(lambda rng: -rng.integers(1, 9))),
        ("end_event", put(lambda rng: rng.integers(6, 99))),
        ("end_event", put(0)),
        ("start_time", add(lambda rng: -rng.uniform(0.01, 1.0))),
        ("end_time", put(NAN)),
        ("player", put("umpire")),
        ("start_speed", put(lambda rng: rng.uniform(121, 999))),
        ("start_speed", put(negative)),
        ("spin", put(lambda rng: rng.uniform(2000, 9000, 3))),
        ("spin_std", entry(negative)),
        ("drag_per_m", put(negative)),
        ("landing_position", put(lambda rng: np.array([0, 5, -rng.uniform(0.1, 3.0)]))),
        ("in_probability", put(beyond_one)),
        ("residual_px", put(negative)),
    ],
    "captions": [
        ("player", put(lambda rng: rng.integers(2, 9))),
        ("player", put(-1)),
        ("start_frame", put(lambda rng: -rng.integers(1, 9))),
        ("end_frame", put(lambda rng: rng.integers(31, 99))),
        ("end_frame", lambda c, n, r, rng: c[n].__setitem__(r, c["start_frame"][r])),
        ("start_s", put(NAN)),
        ("start_s", add(lambda rng: rng.uniform(0.4, 3.0))),
        ("end_s", add(lambda rng: -rng.uniform(2.0, 3.0))),
        ("text", put("  \t")),
        ("source", put("hearsay")),
        ("alternative", put(lambda rng: -rng.integers(1, 9))),
    ],
}  # fmt: skip
RULES = [("data", *rule) for rule in DATA_RULES if rule[1] is not None]
RULES += [(table, *rule) for table, rules in OWN_RULES.items() for rule in rules]


def mutated(rows: EpisodeRows, number: int) -> tuple[EpisodeRows, str, str]:
    """The rows with one value spoilt, and its table and column: a rule after the other, seeded by the number."""
    rng = np.random.default_rng(number)
    table, name, change = RULES[number % len(RULES)]
    data = {key: values.copy() for key, values in rows.data.items()}
    own = {key: {n: values.copy() for n, values in columns.items()} for key, columns in rows.own.items()}
    columns = data if table == "data" else own[table]
    # Where there is a ball, and a row before and after.
    row = int(rng.integers(4, 26)) if table == "data" else int(rng.integers(1, len(columns["clip_id"])))
    change(columns, name, row, rng)
    return replace(rows, data=data, own=own), table, name


def test_what_is_sound_has_no_fault(sound: EpisodeRows) -> None:
    assert list(episode_faults(sound, data_columns(TENNIS))) == []


def test_two_hundred_values_that_break_a_rule_are_all_found(sound: EpisodeRows) -> None:
    columns = data_columns(TENNIS)
    assert MUTATIONS > 2 * len(RULES)
    missed = []
    for number in range(MUTATIONS):
        rows, table, name = mutated(sound, number)
        found = {(of, fault.field) for of, fault in episode_faults(rows, columns)}
        if (table, name) not in found:
            missed.append((number, table, name, found))
    assert missed == []


def body(rows: int, step_m: float) -> Columns:
    """A root that walks along x, a frame every 40 ms."""
    position = np.zeros((rows, 3), np.float32)
    position[:, 0], position[:, 1], position[:, 2] = step_m * np.arange(rows), -12.0, 1.0
    return {"player0.root_position": position, "player0.identity": np.full(rows, "a", dtype=object)}


def test_nobody_runs_faster_than_people_do_but_an_uncertain_place_is_no_run() -> None:
    time = {"frame.capture_time": np.arange(40) / 25}
    assert list(player_speed_faults(body(40, 0.36), time, TENNIS)) == []  # 9 m/s
    (fault,) = player_speed_faults(body(40, 0.8), time, TENNIS)
    assert fault.field == "player0.root_position" and "20" in fault.found
    doubtful = body(40, 0.8) | {"player0.root_cov": np.tile([0.5, 0, 0, 0.5, 0, 0.1], (40, 1))}
    assert list(player_speed_faults(doubtful, time, TENNIS)) == []
    changed = body(40, 0.0)
    changed["player0.root_position"][20:, 0] = 8.0
    slow = {"frame.capture_time": np.arange(40) / 10}
    assert len(list(player_speed_faults(changed, slow, TENNIS))) == 1
    changed["player0.identity"][20:] = "b"
    assert list(player_speed_faults(changed, slow, TENNIS)) == []


@pytest.mark.parametrize(
    ("height", "x", "event", "deviation", "faults"),
    [
        (1.2, 0.0, "", 0.0, 0),
        (0.3, 0.0, "", 0.0, 1),
        (0.3, 0.0, "net", 0.0, 0),
        (0.3, 0.0, "bounce", 0.0, 1),
        (0.3, 0.0, "", 0.2, 0),
        (0.3, 7.5, "", 0.0, 0),
        (0.75, 0.0, "", 0.0, 0),
        (0.75, 6.2, "", 0.0, 1),
    ],
)
def test_a_ball_goes_over_the_net_or_beside_it_or_there_is_an_event(
    height: float, x: float, event: str, deviation: float, faults: int
) -> None:
    time = np.arange(6) / 25
    position = np.stack([np.full(6, x), np.linspace(-2.4, 2.6, 6), np.full(6, height)], axis=1)
    cov = np.tile([0.0, 0, 0, 0, 0, deviation**2], (6, 1))
    events = {
        "kind": np.array([event] if event else [], dtype=object),
        "time": np.full(len([event]) if event else 0, 0.09),
    }
    ball = {"ball.position": position, "ball.position_cov": cov}
    found = list(net_faults(ball, events, {"frame.capture_time": time}, TENNIS))
    assert [fault.field for fault in found] == ["ball.position"] * faults
    gap = ball | {"ball.position": np.where(np.arange(6)[:, None] == 2, np.nan, position)}
    assert list(net_faults(gap, events, {"frame.capture_time": time}, TENNIS)) == []


def test_bones_of_each_person_keep_their_own_length_and_a_missing_pose_is_no_fault() -> None:
    skeleton = TENNIS.players[0].skeleton
    assert skeleton is not None
    rest = skeleton.rest_translations.reshape(-1)
    translations = np.tile(rest, (20, 1))
    translations[10:] *= 1.3
    translations[5] = np.nan
    columns = {
        "player0.joint_translations": translations.astype(np.float32),
        "player0.identity": np.repeat(np.array(["a", "b"], dtype=object), 10),
    }
    assert list(players_faults(columns, Context(scene=TENNIS))) == []
    columns["player0.identity"] = np.full(20, "a", dtype=object)
    (fault,) = players_faults(columns, Context(scene=TENNIS))
    assert fault.field == "player0.joint_translations" and "bones within" in fault.expected
