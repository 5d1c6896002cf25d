"""SMPL's arrays: there and back, in every form that is about, and nothing unpickled."""

import io
import zipfile

import numpy as np
import pytest

from pgm_data.convert.motion_exchange import MotionExport, export_smpl, import_smpl
from pgm_data.convert.motion_work import MotionImport
from pgm_data.convert.smpl_npz import FACE, JOINTS, read_skeleton_shapes
from pgm_data.dataset.check import check_paths
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.players.joint_sets import SETS
from tests.convert.motions import BLOCKS, TENNIS, first_player, motion, work_folder

BETAS = np.linspace(-1, 1, 10)


class Malice:
    """Would leave a trace if it were unpickled."""

    def __reduce__(self):
        return (exec, ("raise SystemExit('unpickled')",))


def amass(frames=8, columns=156, up="z", **changed):
    """What a file of AMASS holds: a body that stands."""
    rng = np.random.default_rng(0)
    poses = rng.normal(scale=0.1, size=(frames, columns))
    poses[:, :3] = [np.pi / 2, 0, 0] if up == "z" else [0, 0.3, 0]
    trans = rng.normal(scale=0.01, size=(frames, 3)) + ([0, 0, 1.0] if up == "z" else [0, 1.0, 0])
    arrays = {"poses": poses, "trans": trans, "betas": np.arange(16.0), "gender": np.array("female")}
    return arrays | {"mocap_framerate": np.array(120.0), "dmpls": np.zeros((frames, 8))} | changed


def saved(path, arrays):
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def test_a_player_comes_back_from_the_file_that_went_out(tmp_path):
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", missing=(0, 5), betas=BETAS))
    outcome = export_smpl(work, tmp_path / "out", MotionExport(players=("player0",)))
    assert outcome.files == ("walk_player0.npz",) and outcome.frames == 10 and not outcome.problems
    back = import_smpl(tmp_path / "out", tmp_path / "back")
    assert back.clips == ("walk_player0",) and not back.problems and not back.nominal_times
    ours, theirs = first_player(work, "walk"), first_player(tmp_path / "back", "walk_player0")
    assert list(theirs.status) == list(ours.status)
    for name in ("joints", "joint_translations", "betas"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), atol=2e-5)
    R = [rotation_from_rotvec(track.joint_rotations) for track in (ours, theirs)]
    np.testing.assert_allclose(R[0], R[1], atol=2e-6)
    assert np.isnan(theirs.joints[[0, 5]]).all()
    # What is lost: who it is, boxes and keypoints, the doubt.
    assert np.isnan(theirs.root_cov).all() and np.isnan(theirs.box_px).all()


def test_a_file_that_is_named_after_a_player_moves_that_player(tmp_path):
    saved(tmp_path / "a_player1.npz", amass())
    import_smpl(tmp_path, tmp_path / "work")
    status = [first_player(tmp_path / "work", "a_player1", player=i).status[0] for i in (0, 1)]
    assert status == ["none", "measured"]
    import_smpl(tmp_path, tmp_path / "work2", options=MotionImport(player="player0"))
    assert first_player(tmp_path / "work2", "a_player1").status[0] == "measured"


def test_the_file_holds_what_readers_of_amass_look_for(tmp_path):
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", betas=BETAS))
    export_smpl(work, tmp_path / "out")
    with np.load(tmp_path / "out" / "walk_player0.npz", allow_pickle=False) as file:
        assert (
            file["poses"].shape == (12, 72) and file["trans"].shape == (12, 3) and file["joints"].shape == (12, 24, 3)
        )
        assert float(file["mocap_framerate"]) == pytest.approx(25.0)
        np.testing.assert_allclose(file["betas"], BETAS, atol=1e-6)
        np.testing.assert_allclose(file["trans"], file["joints"][:, 0])
        assert str(file["gender"]) == "neutral"
    without = work_folder(tmp_path / "b", motion(_folder(tmp_path / "b") / "plain.npz"))
    export_smpl(without, tmp_path / "out2")
    with np.load(tmp_path / "out2" / "plain_player0.npz") as file:
        assert "betas" not in file


def _folder(path):
    path.mkdir()
    return path


def test_rotations_by_more_than_a_turn_come_back_as_the_same_rotation_by_less(tmp_path):
    poses = amass(columns=72)["poses"]
    wound = poses.reshape(8, 24, 3).copy()
    angle = np.linalg.norm(wound, axis=-1, keepdims=True)
    wound *= (angle + 2 * np.pi) / angle
    for name, values in (("plain", poses), ("wound", wound.reshape(8, 72))):
        saved(tmp_path / f"{name}.npz", amass(columns=72, poses=values))
    import_smpl(tmp_path, tmp_path / "work")
    plain, turned = (first_player(tmp_path / "work", name) for name in ("plain", "wound"))
    np.testing.assert_allclose(turned.joint_rotations, plain.joint_rotations, atol=1e-5)
    assert np.linalg.norm(turned.joint_rotations, axis=-1).max() <= np.pi + 1e-6


@pytest.mark.parametrize("columns", [72, 156, 165])
def test_forms_of_amass_are_read_and_the_folder_passes_the_check(tmp_path, columns):
    arrays = amass(columns=columns)
    saved(tmp_path / "s.npz", arrays)
    outcome = import_smpl(tmp_path / "s.npz", tmp_path / "work")
    assert outcome.clips == ("s",) and outcome.pictures == 8
    track = first_player(tmp_path / "work", "s")
    np.testing.assert_allclose(track.joint_rotations[:, 1:22].reshape(8, -1), arrays["poses"][:, 3:66], atol=1e-6)
    hands = track.joint_rotations[:, 22:].reshape(8, -1)
    np.testing.assert_allclose(hands, arrays["poses"][:, 66:72] if columns == 72 else 0.0, atol=1e-6)
    np.testing.assert_allclose(track.root_position, arrays["trans"], atol=1e-6)
    np.testing.assert_allclose(track.betas[0], arrays["betas"][:10])
    heads = track.joints[:, JOINTS.index("Head"), 2] - track.joints[:, JOINTS.index("L_Ankle"), 2]
    assert (heads > 1.2).all()
    faults = [v for v in check_paths([tmp_path / "work"]) if "run.json" not in str(v)]
    assert not faults
    assert (first_player(tmp_path / "work", "s", player=1).status == "none").all()


def test_axes_the_place_and_the_pelvis_are_the_users_word(tmp_path):
    saved(tmp_path / "y.npz", amass(up="y", mocap_framerate=None))
    options = MotionImport(
        up="y", frames_per_second=30.0, origin_m=(0, -11, 0), pelvis_m=(0, -0.2, 0), player="player1"
    )
    outcome = import_smpl(tmp_path / "y.npz", tmp_path / "work", options=options)
    assert outcome.nominal_times == ("y",)
    track = first_player(tmp_path / "work", "y", player=1)
    np.testing.assert_allclose(track.root_position, [[0, -11, 0.8]] * 8, atol=0.05)
    assert (track.joints[:, JOINTS.index("Head"), 2] > 1.2).all()


@pytest.mark.parametrize("stated, meant", [("z", "y"), ("y", "z")])
def test_a_body_that_stands_along_another_axis_is_refused(tmp_path, stated, meant):
    saved(tmp_path / "s.npz", amass(up=meant))
    outcome = import_smpl(tmp_path / "s.npz", tmp_path / "work", options=MotionImport(up=stated))
    assert not outcome.clips and "up" in str(outcome.problems[0])


def test_a_body_that_lies_down_is_let_pass(tmp_path):
    arrays = amass()
    arrays["poses"][:, :3] = [0, 0, np.pi / 2]
    saved(tmp_path / "s.npz", arrays)
    assert import_smpl(tmp_path / "s.npz", tmp_path / "work").clips == ("s",)


@pytest.mark.parametrize(
    "changed, words",
    [
        ({"poses": None}, "poses: expected the array"),
        ({"poses": np.zeros((8, 71))}, "poses: expected"),
        ({"poses": np.zeros((0, 72))}, "poses: expected"),
        ({"poses": np.array(["a"] * 8)}, "expected numbers"),
        ({"poses": np.full((8, 72), np.inf)}, "infinity"),
        ({"trans": np.zeros((7, 3))}, "trans: expected"),
        ({"trans": None}, "trans: expected the array, or joints"),
        ({"mocap_framerate": None}, "mocap_framerate: expected it"),
        ({"mocap_framerate": np.array(0.0)}, "above 0"),
        ({"betas": np.zeros(3)}, "betas: expected 10"),
        ({"joints": np.zeros((8, 17, 3))}, "joints: expected"),
        ({"poses": np.array([Malice()], dtype=object)}, "pickled objects, which are never loaded"),
    ],
)
def test_a_file_that_is_not_what_it_must_be_says_so(tmp_path, changed, words):
    saved(tmp_path / "s.npz", amass(columns=72) | changed)
    outcome = import_smpl(tmp_path / "s.npz", tmp_path / "work")
    assert not outcome.clips
    assert words in str(outcome.problems[0]).replace("file: expected motion in a .npz file, got ", "")


def test_objects_that_nobody_asked_for_are_left_alone(tmp_path):
    saved(tmp_path / "s.npz", amass(extra=np.array([Malice()], dtype=object)))
    assert import_smpl(tmp_path / "s.npz", tmp_path / "work").clips == ("s",)


def test_what_is_no_npz_is_refused(tmp_path):
    bomb = io.BytesIO()
    np.lib.format.write_array_header_1_0(bomb, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 72)})
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w") as file:
        file.writestr("poses.npy", bomb.getvalue())
    with zipfile.ZipFile(tmp_path / "zeros.npz", "w", zipfile.ZIP_DEFLATED) as file:
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": (4000, 72)})
        file.writestr("poses.npy", header.getvalue() + b"\0" * 100)
    (tmp_path / "text.npz").write_text("poses")
    (tmp_path / "cut.npz").write_bytes(saved(tmp_path / "s.npz", amass()).read_bytes()[:-400])
    (tmp_path / "s.npz").unlink()
    outcome = import_smpl(tmp_path, tmp_path / "work")
    assert not outcome.clips and len(outcome.problems) == 4
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="expected files that end in .npz"):
        import_smpl(tmp_path / "empty", tmp_path / "work")


def test_more_than_memory_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("pgm_data.convert.npz_arrays.LARGEST_BYTES", 1000)
    saved(tmp_path / "s.npz", amass())
    with pytest.raises(ValueError, match="at most 1000 bytes"):
        read_skeleton_shapes(tmp_path / "s.npz")


def test_a_skeleton_that_is_not_smpls_is_refused(tmp_path):
    with pytest.raises(ValueError, match="skeleton smpl24, got blocks13"):
        import_smpl(tmp_path, tmp_path / "work", scene="blocks")
    work = work_folder(tmp_path, motion(tmp_path / "walk.bin", scene=BLOCKS), scene=BLOCKS)
    outcome = export_smpl(work, tmp_path / "out")
    assert not outcome.files and outcome.problems[0].field == "skeleton"
    with pytest.raises(ValueError, match="player9"):
        export_smpl(work, tmp_path / "out", MotionExport(players=("player9",)))
    with pytest.raises(ValueError, match="expected one of player0, player1"):
        import_smpl(tmp_path, tmp_path / "work", options=MotionImport(player="ball"))


def test_shapes_of_24_and_of_30_joints_are_named_as_the_joint_sets_are(tmp_path):
    track = motion(tmp_path / "x", 5)
    from pgm_data.skeleton import world_joints

    joints = world_joints(TENNIS.players[0].skeleton.parents, track.rotations, track.translations)
    full = np.concatenate([joints, joints[:, :6]], axis=1)
    full[2] = np.nan
    path = saved(tmp_path / "n.npz", {"joints": full, "frame_index": np.array([0, 2, 4, 6, 9])})
    shapes = read_skeleton_shapes(path)
    assert shapes.joint_set == "3dcrowdnet30" and shapes.joint_names == SETS["3dcrowdnet30"] == (*JOINTS, *FACE)
    assert shapes.frame.tolist() == [0, 2, 4, 6, 9] and shapes.players == ("",)
    np.testing.assert_array_equal(shapes.joints_cam[:, 0], full)
    both = {"joints3d": np.stack([joints, joints], axis=1) * 1000, "players": np.array(["player0", "player1"])}
    shapes = read_skeleton_shapes(saved(tmp_path / "two.npz", both), unit_m=0.001)
    assert shapes.players == ("player0", "player1") and shapes.joint_names == SETS["smpl24"]
    np.testing.assert_allclose(shapes.joints_cam[:, 1], joints)
    with pytest.raises(ValueError, match="give unit_m"):
        read_skeleton_shapes(tmp_path / "two.npz")
    with pytest.raises(ValueError, match="that rise"):
        read_skeleton_shapes(saved(tmp_path / "f.npz", {"joints": joints, "frames": np.array([0, 2, 2, 3, 4])}))
    with pytest.raises(ValueError, match="names of 2 players"):
        read_skeleton_shapes(saved(tmp_path / "p.npz", {"joints": np.stack([joints, joints], axis=1)}))
    with pytest.raises(ValueError, match="expected one of the arrays"):
        read_skeleton_shapes(saved(tmp_path / "e.npz", {"verts": joints}))


def test_poses_alone_give_shapes_too(tmp_path):
    shapes = read_skeleton_shapes(saved(tmp_path / "n.npz", amass(columns=72)))
    assert shapes.joints_cam.shape == (8, 1, 24, 3)
    np.testing.assert_array_equal(shapes.joints_cam[:, :, 0], 0.0)
    thigh = shapes.joints_cam[0, 0, JOINTS.index("L_Knee")] - shapes.joints_cam[0, 0, JOINTS.index("L_Hip")]
    assert np.linalg.norm(thigh) == pytest.approx(0.4, abs=0.01)
