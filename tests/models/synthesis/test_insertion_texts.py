"""What a user writes becomes a mesh where it says, and what it cannot mean is refused by name."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from pgm_data.scene import load_scene
from pgm_data.skeleton import load_skeleton
from pgm_models.synthesis.insertion_texts import inserted_of
from pgm_models.synthesis.insertions import placed_meshes
from pgm_models.synthesis.rackets import held_by
from tests.models.synthesis.toy_bodies import bent

TENNIS = load_scene("tennis")
SKELETON = load_skeleton("smpl24")
HAND = SKELETON.joint_names.index("R_Hand")
TETRAHEDRON = "v 0 0 0\nv 0.3 0 0\nv 0 0.3 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def mesh_file(tmp_path: Path) -> Path:
    path = tmp_path / "a b.obj"
    path.write_text(TETRAHEDRON, encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def coarse_grids(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Those that are fine enough for pictures take too long here."""
    from pgm_models.synthesis import insertion_texts
    from pgm_models.synthesis.rackets import RacketMeasures, inserted_racket

    insertion_texts._racket.cache_clear()
    monkeypatch.setattr(insertion_texts, "CELLS", 12)
    monkeypatch.setattr(
        insertion_texts, "inserted_racket", lambda measures: inserted_racket(RacketMeasures(rounds=8), cell=0.03)
    )
    yield
    insertion_texts._racket.cache_clear()


@pytest.mark.parametrize("name", ["right_wrist", "R_Hand", "r_elbow"])
def test_a_racket_is_in_the_hand_at_the_end_of_the_arm(name: str) -> None:
    racket = inserted_of(f"player1={name}", TENNIS)
    assert (racket.player, racket.joint, len(racket.meshes)) == ("player1", HAND, 2)
    R, t = held_by("right")
    np.testing.assert_array_equal(racket.R, R)
    np.testing.assert_array_equal(racket.t, t)


def test_a_mesh_of_a_file_moves_with_its_place_of_the_body(mesh_file: Path) -> None:
    made = inserted_of(f"{mesh_file}@player0:left_heel#ff8000", TENNIS)
    torch.testing.assert_close(made.meshes[0].colour, torch.tensor([[1.0, 128 / 255, 0.0]]))
    poses = bent(SKELETON, 2)
    (placed,) = placed_meshes([made], {"player0": poses}, 2)
    heel = SKELETON.point_names.index("left_heel")
    joint = int(SKELETON.point_joints[heel])
    turn = poses.rotation[:, joint].mT / poses.scale[:, None, None]
    at = poses.joints[:, joint] + turn @ torch.tensor(SKELETON.point_offsets[heel].tolist())
    origin = torch.einsum("fab,fb->fa", placed.placement.R_mesh_from_world, at) + placed.placement.t_mesh_from_world
    assert float(origin.abs().max()) < 1e-5
    assert placed_meshes([made], {"player1": poses}, 2) == []


def test_a_mesh_of_a_file_stands_still_where_it_is_put(mesh_file: Path) -> None:
    made = inserted_of(f"{mesh_file}@1.5,-3,0", TENNIS)
    (placed,) = placed_meshes([made], {}, 2)
    at = torch.tensor([1.5, -3.0, 0.0])
    origin = placed.placement.R_mesh_from_world @ at + placed.placement.t_mesh_from_world
    assert origin.shape == (2, 3) and float(origin.abs().max()) < 1e-6
    assert max(made.meshes[0].size) == 12 + 1 + 2 * 2
    boxes = placed.boxes()
    assert (boxes.low < at).all() and (boxes.high > at + 0.3).all() and (boxes.high < at + 0.4).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("racket", "expected PLAYER=JOINT for a racket, or FILE@"),
        ("player7=right_wrist", r"expected a player of the scene tennis \(player0, player1\), got 'player7'"),
        ("player0=right_paw", r"expected a joint of smpl24 \(Pelvis, .*, left_heel, .*\), got 'right_paw'"),
        ("player0=Head", "expected a joint of the left or of the right arm"),
        ("ball=right_wrist", "expected a player"),
        ("{file}@player0:", "expected a joint of smpl24"),
        ("{file}@1,2", "expected PLAYER:JOINT, or X,Y,Z"),
        ("{file}@1,2,nan", "expected PLAYER:JOINT, or X,Y,Z"),
        ("{file}@player0", "expected PLAYER:JOINT, or X,Y,Z"),
        ("{file}@0,0,0#red", "#red: expected a colour such as #ff8000"),
        ("{file}.txt@0,0,0", "expected a file named .obj, .stl or .ply"),
    ],
)
def test_what_it_cannot_mean_is_refused_by_name(text: str, said: str, mesh_file: Path) -> None:
    with pytest.raises(ValueError, match=said):
        inserted_of(text.format(file=mesh_file), TENNIS)


def test_a_mesh_that_is_not_watertight_is_refused_with_its_file(mesh_file: Path) -> None:
    mesh_file.write_text(TETRAHEDRON.removesuffix("f 2 3 4\n"), encoding="utf-8")
    with pytest.raises(ValueError, match="a b.obj: .*expected"):
        inserted_of(f"{mesh_file}@0,0,0", TENNIS)
    with pytest.raises(FileNotFoundError):
        inserted_of(f"{mesh_file.parent / 'none.obj'}@0,0,0", TENNIS)
