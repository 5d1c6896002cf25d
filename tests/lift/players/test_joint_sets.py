"""Joints of other programs at the places of ours."""

import numpy as np
import pytest

from pgm_data.lift.players.joint_sets import SETS, at_places, joint_set, joint_set_of, mapped
from pgm_data.skeleton import load_skeleton

SIZES = {"smpl24": 24, "3dcrowdnet30": 30, "coco17": 17, "blazepose33": 33, "h36m17": 17}
# Rows of BlazePose that are COCO's, as its documentation lists them.
COCO_IN_BLAZEPOSE = [0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28]


@pytest.mark.parametrize("name", SETS)
def test_every_joint_of_a_set_has_a_place_of_its_own(name):
    known = joint_set(name)
    assert len(known.joint_names) == len(set(known.joint_names)) == len(set(known.places)) == SIZES[name]
    assert joint_set_of(known.joint_names) == known
    values = np.random.default_rng(0).normal(size=(2, SIZES[name], 3))
    np.testing.assert_array_equal(mapped(values, source=name, target=name), values)


def test_cocos_joints_are_found_among_blazeposes():
    values = np.arange(33.0)[:, None] * [1.0, 2.0]
    np.testing.assert_array_equal(mapped(values, source="blazepose33", target="coco17")[:, 0], COCO_IN_BLAZEPOSE)
    back = mapped(mapped(values, source="blazepose33", target="coco17"), source="coco17", target="blazepose33")
    kept = np.isfinite(back[:, 0])
    assert np.flatnonzero(kept).tolist() == COCO_IN_BLAZEPOSE
    np.testing.assert_array_equal(back[kept], values[kept])


@pytest.mark.parametrize("source", SETS)
@pytest.mark.parametrize("target", SETS)
def test_left_stays_left_and_limbs_keep_their_order(source, target):
    values = np.arange(float(SIZES[source]))[:, None]
    found = mapped(values, source=source, target=target)
    for row, name in zip(found[:, 0], joint_set(target).places, strict=True):
        if np.isfinite(row):
            assert joint_set(source).places[int(row)] == name
    assert np.isfinite(found).sum() >= 12


def test_smpls_pelvis_and_neck_are_made_of_nothing():
    found = mapped(np.ones((17, 3)), source="coco17", target="smpl24")
    missing = {name for name, row in zip(SETS["smpl24"], found, strict=True) if np.isnan(row).all()}
    assert {"Pelvis", "Neck", "Head", "Chest"} <= missing and len(missing) == 12


def test_points_of_a_skeleton_are_filled_where_the_set_has_them():
    skeleton = load_skeleton("smpl24")
    found = at_places(np.ones((30, 3)), source="3dcrowdnet30", places=skeleton.point_names)
    missing = {name for name, row in zip(skeleton.point_names, found, strict=True) if np.isnan(row).all()}
    assert missing == {"left_heel", "right_heel", "left_big_toe", "right_big_toe"}


def test_what_is_unknown_names_what_is_known():
    with pytest.raises(ValueError, match="expected one of smpl24, 3dcrowdnet30, coco17"):
        joint_set("openpose25")
    with pytest.raises(ValueError, match="expected 17 joints, got 18"):
        mapped(np.ones((18, 3)), source="coco17", target="smpl24")
    with pytest.raises(ValueError, match="some of the places of coco17"):
        at_places(np.ones((17, 3)), source="coco17", places=("torso", "root"))
    with pytest.raises(ValueError, match="expected those of one of"):
        joint_set_of(("a", "b"))
