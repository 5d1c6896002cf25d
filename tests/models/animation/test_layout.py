"""What a layout holds follows from the scene and the data, and unsound data are refused by name."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pgm_models.animation.fit_layout import DEAD, FLOOR, fit_layout
from pgm_models.animation.layout import layout_from_json, layout_to_json
from pgm_models.animation.shards import read_episodes, split_matches


def read(dataset: Path) -> dict[str, np.ndarray]:
    import pyarrow.parquet as pq

    (path,) = sorted((dataset / "data").glob("*/*.parquet"))
    table = pq.read_table(path)
    wide = [name for name in table.column_names if str(table.schema.field(name).type).startswith("fixed")]
    columns = {name: np.stack(table.column(name).to_numpy()).astype(np.float64) for name in wide}
    return columns | {
        name: table.column(name).to_numpy() for name in ("episode_index", "ball.status") if name in table.column_names
    }


def test_tennis_has_two_players_then_the_ball(tennis_dataset: Path) -> None:
    layout = fit_layout(tennis_dataset)
    body = ["root_position", "root_rotation", "joint_rotations"]
    names = [f"player{n}.{name}" for n in range(2) for name in body] + ["ball.position", "ball.velocity"]
    assert [entry.column for entry in layout.properties] == names
    assert [entry.player for entry in layout.properties] == [0, 0, 0, 1, 1, 1, -1, -1]
    assert [entry.column for entry in layout.constants] == [f"player{n}.joint_translations" for n in range(2)]
    assert layout.scene == "tennis" and layout.players == ("player0", "player1")
    assert layout.widths[:2] == (3, 3) and layout.widths[-2:] == (3, 3)


def test_blocks_have_one_player_whose_still_joints_are_left_out(blocks_dataset: Path) -> None:
    layout = fit_layout(blocks_dataset)
    assert [entry.column.partition(".")[2] for entry in layout.properties] == [
        "root_position",
        "root_rotation",
        "joint_rotations",
    ]
    joints = read(blocks_dataset)["player0.joint_rotations"].reshape(-1, 13, 3)
    moving = np.flatnonzero(joints[:, 1:].std(axis=0).max(axis=1) > DEAD)
    assert 0 < len(moving) < 12
    expected = (3 * moving[:, None] + np.arange(3)).ravel()
    np.testing.assert_array_equal(layout.properties[2].channels, expected)


def test_statistics_are_those_of_the_rows(tennis_dataset: Path) -> None:
    layout, rows = fit_layout(tennis_dataset), read(tennis_dataset)
    ball = layout.properties[layout.row_of("ball.velocity")]
    there = rows["ball.velocity"][rows["ball.status"] != "none"]
    np.testing.assert_allclose(ball.mean, there.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(ball.std, there.std(axis=0), rtol=1e-9)
    turned = layout.properties[layout.row_of("player1.joint_rotations")]
    joints = rows["player1.joint_rotations"].reshape(-1, 24, 3)[:, 1:]
    for joint in (0, 15, 22):
        mean = Rotation.from_rotvec(joints[:, joint]).mean()
        apart = (mean.inv() * Rotation.from_rotvec(turned.reference[joint].copy())).magnitude()
        assert apart < 1e-6
        tangents = (mean.inv() * Rotation.from_rotvec(joints[:, joint])).as_rotvec()
        np.testing.assert_allclose(turned.rest.reshape(-1, 3)[joint], tangents.mean(axis=0), atol=1e-6)
    places = rows["player0.joint_translations"][:, 3:]
    clips = np.stack([places[rows["episode_index"] == clip].mean(axis=0) for clip in np.unique(rows["episode_index"])])
    np.testing.assert_allclose(layout.constants[0].rest, clips.mean(axis=0), atol=1e-9)
    np.testing.assert_array_equal(layout.constants[0].channels, np.flatnonzero(clips.std(axis=0) >= DEAD))


def test_no_scale_is_next_to_nothing_beside_the_others(tennis_dataset: Path) -> None:
    for entry in (layout := fit_layout(tennis_dataset)).properties:
        assert entry.std.min() >= 0.99 * FLOOR * np.sqrt(np.mean(entry.std**2)) - 1e-12, entry.column
    # A knee turns about one axis alone: the others are at the floor.
    assert np.isclose(layout.properties[2].std.min(), layout.properties[2].std).sum() > 1


def test_the_whole_scale_of_what_varies_is_kept(tennis_dataset: Path) -> None:
    layout, rows = fit_layout(tennis_dataset), read(tennis_dataset)
    position = layout.properties[0]
    std = rows["player0.root_position"].std(axis=0)
    np.testing.assert_allclose(position.std, np.maximum(std, FLOOR * np.sqrt(np.mean(std**2))), rtol=1e-6)


def test_rows_of_other_matches_do_not_count(tennis_dataset: Path) -> None:
    episodes, rows = read_episodes(tennis_dataset), read(tennis_dataset)
    match = episodes.matches[0]
    own = np.isin(rows["episode_index"], episodes.of_matches([match]))
    assert 0 < own.sum() < len(own)
    layout = fit_layout(tennis_dataset, matches=[match])
    np.testing.assert_allclose(layout.properties[0].mean, rows["player0.root_position"][own].mean(axis=0), atol=1e-9)
    with pytest.raises(ValueError, match="matches: expected some of .*, got 'nobody'"):
        fit_layout(tennis_dataset, matches=["nobody"])
    assert split_matches(tennis_dataset, "train") == tuple(sorted(set(episodes.matches)))
    assert split_matches(tennis_dataset, "test") == ()


def test_layouts_come_back_from_json(tennis_dataset: Path) -> None:
    raw = layout_to_json(fit_layout(tennis_dataset))
    assert layout_to_json(layout_from_json(json.loads(json.dumps(raw)))) == raw


def test_the_row_groups_do_not_matter(tennis_dataset: Path, altered) -> None:
    split, whole = fit_layout(altered(tennis_dataset, row_group=97)), fit_layout(tennis_dataset)
    for one, other in zip(split.properties, whole.properties, strict=True):
        np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
        np.testing.assert_allclose(one.std, other.std, rtol=1e-6)


def test_bones_that_vary_within_a_clip_are_a_property(tennis_dataset: Path, altered) -> None:
    def bent(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        wave = np.sin(np.arange(len(columns["index"])))
        columns["player0.joint_translations"][:, 5] += 0.005 * wave.astype(np.float32)
        return columns

    layout = fit_layout(altered(tennis_dataset, bent))
    entry = layout.properties[layout.row_of("player0.joint_translations")]
    assert layout.properties.index(entry) == 3
    assert (entry.kind, entry.first, entry.width) == ("vector", 3, 69) and 2 in entry.channels
    assert [constant.player for constant in layout.constants] == [1]


def test_a_dataset_without_poses_has_places_alone(tennis_dataset: Path, altered) -> None:
    def posed_nowhere(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        for name in ("root_rotation", "joint_rotations", "joint_translations"):
            columns[f"player0.{name}"][:] = np.nan
            columns[f"player1.{name}"][:] = np.nan
        return columns

    layout = fit_layout(altered(tennis_dataset, posed_nowhere))
    names = ["player0.root_position", "player1.root_position", "ball.position", "ball.velocity"]
    assert [entry.column for entry in layout.properties] == names and layout.constants == ()


def test_three_players_without_a_ball(tennis_dataset: Path, altered, three_players) -> None:
    def joined(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        third = {f"player2.{n.partition('.')[2]}": v for n, v in columns.items() if n.startswith("player0.")}
        return {n: v for n, v in columns.items() if not n.startswith("ball.")} | third

    layout = fit_layout(altered(tennis_dataset, joined), scene=three_players)
    assert [entry.player for entry in layout.properties] == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    assert len(layout.constants) == 3 and layout.players == ("player0", "player1", "player2")


@pytest.mark.parametrize(
    ("column", "row", "number", "value"),
    [
        ("ball.position", None, 1, np.nan),
        ("player0.root_position", 5, 2, np.inf),
        ("player1.joint_rotations", 700, 40, np.nan),
        ("player1.root_rotation", 700, slice(None), np.nan),
        ("player0.joint_translations", 2, 3, -np.inf),
    ],
)
def test_what_is_not_finite_is_refused_by_its_place(
    tennis_dataset: Path, altered, column: str, row: int | None, number: int | slice, value: float
) -> None:
    where = {}

    def spoilt(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        chosen = int(np.flatnonzero(columns["ball.status"] == "measured")[300]) if row is None else row
        columns[column][chosen, number] = value
        where.update(clip=columns["clip_id"][chosen], frame=columns["frame_index"][chosen])
        return columns

    dataset = altered(tennis_dataset, spoilt)
    with pytest.raises(ValueError, match="expected a finite number") as raised:
        fit_layout(dataset)
    said = str(raised.value)
    first = 0 if isinstance(number, slice) else number
    assert "file-000.parquet" in said and f"{column}[{first}]" in said
    assert f"clip {where['clip']}, frame {where['frame']}:" in said


def test_what_is_no_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="info.json: expected the description of a packed dataset"):
        fit_layout(tmp_path)
