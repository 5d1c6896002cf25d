"""BVH: what goes out comes back to 1e-5 m, and files of other programs stand as their own numbers say."""

import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.bvh import BvhMotion, bvh_text, read_bvh
from pgm_data.convert.motion_exchange import MotionExport, export_bvh, import_bvh
from pgm_data.convert.motion_work import MotionImport
from pgm_data.dataset.check import check_paths
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.skeleton import world_joints
from tests.convert.motions import BLOCKS, TENNIS, first_player, motion, retimed, work_folder

NAMES = TENNIS.players[0].skeleton.joint_names
ARM = """HIERARCHY
ROOT rig:Hips
{
\tOFFSET 1 2 3
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT rig:Arm
\t{
\t\tOFFSET 10.0 0 0
\t\tCHANNELS 3 %s
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 5 0
\t\t}
\t}
}
MOTION
Frames:\t2
Frame Time:\t0.04
0 0 0 0 0 0 %s
100 0 0 90 0 0 %s
"""


def file(path, text):
    path.write_text(text, encoding="utf-8", newline="")
    return path


def places(bvh: BvhMotion) -> np.ndarray:
    return world_joints(bvh.parents, bvh.rotations, bvh.translations)


@pytest.mark.parametrize("ends", ["\n", "\r\n", "\r\n \t"])
def test_a_hand_written_file_stands_where_it_says(tmp_path, ends):
    bvh = read_bvh(
        file(tmp_path / "a.bvh", (ARM % ("Yrotation Xrotation Zrotation", "0 0 90", "0 90 0")).replace("\n", ends))
    )
    assert bvh.joint_names == ("Hips", "Arm", "Arm_End")
    assert bvh.frame_time == 0.04 and bvh.parents.tolist() == [-1, 0, 1]
    # Frame 0: the arm along x from the root's offset, its end turned from y to -x. Frame 1: all turned by 90 about z.
    expected = [[[1, 2, 3], [11, 2, 3], [6, 2, 3]], [[101, 2, 3], [101, 12, 3], [101, 12, 8]]]
    np.testing.assert_allclose(places(bvh), expected, atol=1e-9)


@settings(max_examples=12)
@given(st.permutations("XYZ"), st.tuples(*[st.floats(-360, 360)] * 3))
def test_channels_turn_in_the_order_in_which_they_stand(order, degrees):
    channels = " ".join(f"{axis}rotation" for axis in order)
    values = " ".join(f"{value:.9f}" for value in degrees)
    with TemporaryDirectory() as folder:
        bvh = read_bvh(file(Path(folder) / "a.bvh", ARM % (channels, values, values)))
    R = np.eye(3)
    for axis, value in zip(order, degrees, strict=True):
        c, s = np.cos(np.radians(value)), np.sin(np.radians(value))
        plain = {"X": [[1, 0, 0], [0, c, -s], [0, s, c]], "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
        R = R @ np.array(plain.get(axis, [[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    np.testing.assert_allclose(rotation_from_rotvec(bvh.rotations[0, 1]), R, atol=1e-7)


@pytest.mark.parametrize("order, unit, up", [("ZXY", 0.01, "y"), ("ZYX", 1.0, "z"), ("XYZ", 0.0254, "y")])
def test_a_player_comes_back_from_the_file_that_went_out(tmp_path, order, unit, up):
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", 20))
    outcome = export_bvh(work, tmp_path / "out", MotionExport(order=order, unit_m=unit, up=up))
    assert outcome.files == ("walk_player0.bvh",) and outcome.frames == 20 and not outcome.problems
    assert outcome.said == ("walk: player1 has no pose in any frame, so no file",)
    back = import_bvh(tmp_path / "out", tmp_path / "back", options=MotionImport(unit_m=unit, up=up))
    assert back.clips == ("walk_player0",) and back.pictures == 20 and not back.problems
    ours, theirs = first_player(work, "walk"), first_player(tmp_path / "back", "walk_player0")
    np.testing.assert_allclose(theirs.joints, ours.joints, atol=1e-5)
    R = [rotation_from_rotvec(track.joint_rotations) for track in (ours, theirs)]
    np.testing.assert_allclose(R[0], R[1], atol=2e-6)
    assert not [v for v in check_paths([tmp_path / "back"]) if "run.json" not in str(v)]


def test_another_skeleton_goes_out_and_comes_back(tmp_path):
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", 6, scene=BLOCKS), scene=BLOCKS)
    export_bvh(work, tmp_path / "out")
    import_bvh(tmp_path / "out", tmp_path / "back", scene="blocks")
    ours, theirs = (first_player(w, c, scene=BLOCKS) for w, c in ((work, "walk"), (tmp_path / "back", "walk_player0")))
    np.testing.assert_allclose(theirs.joints, ours.joints, atol=1e-5)
    outcome = import_bvh(tmp_path / "out", tmp_path / "tennis")
    assert not outcome.clips and outcome.problems[0].field == "joints"


def test_bones_that_change_their_length_keep_doing_so(tmp_path):
    walk = motion(tmp_path / "walk.npz", 10)
    translations = walk.translations.copy()
    translations[:, NAMES.index("L_Wrist"), 0] += np.linspace(0, 0.1, 10)
    work = work_folder(tmp_path, replace(walk, translations=translations))
    export_bvh(work, tmp_path / "out")
    text = (tmp_path / "out" / "walk_player0.bvh").read_text()
    assert len(re.findall("CHANNELS 6", text)) == 2 and len(re.findall("CHANNELS 3", text)) == 22
    import_bvh(tmp_path / "out", tmp_path / "back")
    ours, theirs = first_player(work, "walk"), first_player(tmp_path / "back", "walk_player0")
    np.testing.assert_allclose(theirs.joints, ours.joints, atol=1e-5)


def test_gaps_are_filled_and_told_of(tmp_path):
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", 30, missing=(0, 1, 9, 10, 29)))
    outcome = export_bvh(work, tmp_path / "out")
    assert outcome.frames == 27
    assert "walk_player0.bvh: 2 frames without a pose filled by interpolation" in outcome.said
    import_bvh(tmp_path / "out", tmp_path / "back")
    ours, theirs = first_player(work, "walk"), first_player(tmp_path / "back", "walk_player0")
    known = np.array([2, 8, 11, 28])
    np.testing.assert_allclose(theirs.joints[known - 2], ours.joints[known], atol=1e-5)
    truth = work_folder(_folder(tmp_path / "whole"), motion(tmp_path / "whole" / "walk.npz", 30))
    whole = first_player(truth, "walk")
    assert np.abs(theirs.joints[[7, 8]] - whole.joints[[9, 10]]).max() < 0.01


def _folder(path):
    path.mkdir()
    return path


def test_repeated_pictures_are_no_poses_of_their_own(tmp_path):
    # 30 pictures a second of a film of 25: every sixth repeats the one before, and times are those of the film.
    rate, frames = 25.0, 25
    film = motion(tmp_path / "film.npz", frames, rate=rate)
    shown = np.array([i for i in range(frames) for _ in range(2 if i % 5 == 4 else 1)])
    duplicate = np.concatenate([[False], np.diff(shown) == 0])
    work = work_folder(
        tmp_path,
        replace(film, rotations=film.rotations[shown], translations=film.translations[shown], frames_per_second=30.0),
    )
    retimed(work, "film", shown / rate, duplicate)
    outcome = export_bvh(work, tmp_path / "out")
    assert outcome.frames == frames and len(outcome.said) == 1 and "player1" in outcome.said[0]
    bvh = read_bvh(tmp_path / "out" / "film_player0.bvh")
    assert bvh.frame_time == pytest.approx(1 / rate)


def test_uneven_times_are_made_even_and_told_of(tmp_path):
    frames, rate = 40, 25.0
    work = work_folder(tmp_path, motion(tmp_path / "walk.npz", frames, rate=rate))
    times = np.arange(frames) / rate
    late = times + np.where(np.arange(frames) == 20, 0.3 / rate, 0.0)
    retimed(work, "walk", late, np.zeros(frames, dtype=bool))
    outcome = export_bvh(work, tmp_path / "out")
    assert any("40 pictures at uneven times made 40 poses at 25 per second" in word for word in outcome.said)


def test_one_frame_goes_out_and_comes_back(tmp_path):
    work = work_folder(tmp_path, motion(tmp_path / "one.npz", 1))
    export_bvh(work, tmp_path / "out")
    assert import_bvh(tmp_path / "out", tmp_path / "back").pictures == 1
    ours, theirs = first_player(work, "one"), first_player(tmp_path / "back", "one_player0")
    np.testing.assert_allclose(theirs.joints, ours.joints, atol=1e-5)


def test_rotations_at_pi_and_at_the_gimbals_lock_go_out_and_come_back(tmp_path):
    walk = motion(tmp_path / "walk.npz", 6)
    rotations = walk.rotations.copy()
    rotations[:, 1] = np.array(
        [[np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [np.pi / 2, 0, 0], [0, np.pi / 2, 0], [0] * 3]
    )
    work = work_folder(tmp_path, replace(walk, rotations=rotations))
    export_bvh(work, tmp_path / "out")
    import_bvh(tmp_path / "out", tmp_path / "back")
    ours, theirs = first_player(work, "walk"), first_player(tmp_path / "back", "walk_player0")
    np.testing.assert_allclose(theirs.joints, ours.joints, atol=1e-5)


def test_angles_run_on_rather_than_jump():
    skeleton = BLOCKS.players[0].skeleton
    rotations = np.zeros((50, 13, 3))
    rotations[:, 0, 1] = np.linspace(0, 9, 50)
    translations = np.broadcast_to(skeleton.rest_translations, rotations.shape)
    text = bvh_text(
        BvhMotion(
            joint_names=skeleton.joint_names,
            parents=skeleton.parents,
            offsets=skeleton.rest_translations,
            rotations=rotations,
            translations=translations,
            frame_time=0.04,
        )
    )
    rows = np.array([line.split() for line in text.split("Frame Time: 0.04\n")[1].splitlines()], dtype=float)
    assert np.abs(np.diff(rows[:, 3:6], axis=0)).max() < 15


@pytest.mark.parametrize(
    "change, words",
    [
        (("HIERARCHY", "SKELETON"), "no BVH file"),
        (("MOTION", "MOTIONS"), "no BVH file"),
        (("Frames:\t2", "Frames:\t3"), "expected 3 frames of 9 channels"),
        (("Frames:\t2", "Frames:\t0"), "expected one at least"),
        (("Frame Time:\t0.04", "Frame Time:\t-1"), "seconds above 0"),
        (("OFFSET 1 2 3", "OFFSET 1 2"), "expected 3 numbers"),
        (("OFFSET 1 2 3", ""), "expected OFFSET and CHANNELS"),
        (("CHANNELS 3", "CHANNELS 4"), "a count and as many"),
        (("Zrotation Xrotation Yrotation\n\tJOINT", "Wrotation Xrotation Yrotation\n\tJOINT"), "a count and as many"),
        (("}\nMOTION", "MOTION"), "1 open"),
        (("\tJOINT rig:Arm", "\tROOT rig:Arm"), "one ROOT"),
        (("100 0", "ten 0"), "expected numbers"),
        (("100 0", "nan 0"), "frame 1: expected finite"),
    ],
)
def test_a_broken_file_says_where(tmp_path, change, words):
    text = ARM % ("Zrotation Yrotation Xrotation", "0 0 0", "0 0 0")
    assert change[0] in text
    with pytest.raises(ValueError, match=re.escape(words)) as caught:
        read_bvh(file(tmp_path / "a.bvh", text.replace(*change, 1)))
    assert str(caught.value).startswith(str(tmp_path / "a.bvh"))


def test_a_file_that_is_no_body_and_a_wrong_unit_are_problems(tmp_path, real_like):
    file(tmp_path / "arm.bvh", ARM % ("Zrotation Yrotation Xrotation", "0 0 0", "0 0 0"))
    outcome = import_bvh(tmp_path / "arm.bvh", tmp_path / "work")
    assert not outcome.clips and outcome.problems[0].field == "joints"
    outcome = import_bvh(real_like, tmp_path / "work", options=MotionImport(unit_m=1.0))
    assert not outcome.clips and "give unit_m" in outcome.problems[0].expected + outcome.problems[0].found
    outcome = import_bvh(real_like, tmp_path / "work", options=MotionImport(up="z"))
    assert not outcome.clips and outcome.problems[0].field == "up"


@pytest.fixture
def real_like(tmp_path):
    """A body as a motion-capture program names it, arms down at rest, in centimetres."""
    bones = [
        ("Hips", None, (0, 95, 0)),
        *[
            (n, p, o)
            for n, p, o in (("Spine", "Hips", (0, 12, 0)), ("Neck", "Spine", (0, 40, 0)), ("Head", "Neck", (0, 12, 2)))
        ],
        *[
            (f"{side}{name}", parent.replace("*", side), (x * sign, y, z))
            for side, sign in (("Left", 1), ("Right", -1))
            for name, parent, (x, y, z) in (
                ("Arm", "Spine", (18, 35, 0)),
                ("ForeArm", "*Arm", (0, -27, 0)),
                ("Hand", "*ForeArm", (0, -25, 0)),
                ("UpLeg", "Hips", (9, -9, 0)),
                ("Leg", "*UpLeg", (0, -40, 0)),
                ("Foot", "*Leg", (0, -40, 0)),
            )
        ],
    ]
    names = tuple(name for name, _, _ in bones)
    frames = 3
    offsets = np.array([offset for _, _, offset in bones], dtype=float)
    rotations = np.zeros((frames, len(bones), 3))
    rotations[1, names.index("LeftArm")] = [0, 0, np.pi / 2]
    rotations[2, names.index("LeftForeArm")] = [-np.pi / 2, 0, 0]
    bvh = BvhMotion(
        joint_names=names,
        parents=np.array([names.index(parent) if parent else -1 for _, parent, _ in bones]),
        offsets=offsets,
        rotations=rotations,
        translations=np.broadcast_to(offsets, rotations.shape),
        frame_time=0.04,
    )
    return file(tmp_path / "body.bvh", bvh_text(bvh))


def test_a_body_of_other_names_and_another_rest_pose_stands_on_our_skeleton(tmp_path, real_like):
    assert import_bvh(real_like, tmp_path / "work").clips == ("body",)
    track = first_player(tmp_path / "work", "body")

    def at(frame, name):
        return track.joints[frame, NAMES.index(name)]

    # Arms hang in frame 0, and the left one is held out in frame 1: our rest pose, so no rotation there.
    np.testing.assert_allclose(at(0, "L_Wrist") - at(0, "L_Shoulder"), [0, 0, -0.52], atol=1e-6)
    np.testing.assert_allclose(at(1, "L_Wrist") - at(1, "L_Shoulder"), [0.52, 0, 0], atol=1e-6)
    np.testing.assert_allclose(track.joint_rotations[1, NAMES.index("L_Shoulder")], 0.0, atol=1e-6)
    # The forearm that swings forward bends our elbow the way elbows bend.
    np.testing.assert_allclose(at(2, "L_Wrist") - at(2, "L_Elbow"), [0, -0.25, 0], atol=1e-6)
    np.testing.assert_allclose(track.joint_rotations[2, NAMES.index("L_Elbow")], [0, -np.pi / 2, 0], atol=1e-5)
    np.testing.assert_allclose(at(0, "L_Ankle")[2], 0.06, atol=1e-6)
    led = world_joints(
        TENNIS.players[0].skeleton.parents, track.joint_rotations.astype(float), track.joint_translations.astype(float)
    )
    np.testing.assert_allclose(led, track.joints, atol=1e-5)


@pytest.mark.real
def test_real_files_stand_upright_on_the_ground(real_data, tmp_path):
    folder = real_data / "mocap"
    if not folder.is_dir():
        pytest.skip(f"NO REAL CLIPS in {folder}")
    outcome = import_bvh(folder, tmp_path / "work")
    assert set(outcome.clips) == {"test_freebvh", "test_mocapbank"} and not outcome.problems
    for clip, frames in (("test_freebvh", 69), ("test_mocapbank", 455)):
        track = first_player(tmp_path / "work", clip)
        assert track.joints.shape == (frames, 24, 3) and np.isfinite(track.joints).all()
        feet = track.joints[:, [NAMES.index("L_Ankle"), NAMES.index("R_Ankle")], 2]
        assert -0.05 < feet.min() < 0.15
        lengths = np.linalg.norm(track.joint_translations[:, 1:], axis=2)
        assert np.ptp(lengths, axis=0).max() < 1e-5
        bends = track.joint_rotations[:, NAMES.index("L_Knee"), 0]
        assert bends.min() > -0.2 and bends.max() > 0.3
        export_bvh(tmp_path / "work" / clip, tmp_path / "out")
        import_bvh(tmp_path / "out" / f"{clip}_player0.bvh", tmp_path / "back" / clip)
        back = first_player(tmp_path / "back" / clip, f"{clip}_player0")
        np.testing.assert_allclose(back.joints, track.joints, atol=1e-5)
