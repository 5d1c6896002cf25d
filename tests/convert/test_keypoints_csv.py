import numpy as np
import pytest

from pgm_data.convert.keypoints_csv import read_keypoints
from pgm_data.scene import load_scene

COURT = load_scene("tennis").court
GOOD = "near_left_doubles"


def marks(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "KEYPOINTS.csv"
    path.write_bytes(text.encode(encoding))
    return read_keypoints(path, COURT)


def test_marks_come_back_in_the_order_of_the_file(tmp_path):
    found = marks(tmp_path, f"video,frame,name,x,y\na b.mp4,7,{GOOD},10.5,-3\nc.mp4,0,net_centre_top,1e2,4\n")
    assert found.video == ("a b.mp4", "c.mp4")
    assert found.frame.tolist() == [7, 0]
    assert [COURT.all_names[i] for i in found.name_index] == [GOOD, "net_centre_top"]
    np.testing.assert_array_equal(found.pixels, [[10.5, -3.0], [100.0, 4.0]])


def test_columns_may_stand_in_any_order_behind_a_byte_order_mark_with_blank_lines(tmp_path):
    found = marks(tmp_path, f"y,x,name,frame,video\r\n\r\n2,1,{GOOD},3,v.mp4\r\n", "utf-8-sig")
    assert (found.video, found.frame.tolist(), found.pixels.tolist()) == (("v.mp4",), [3], [[1.0, 2.0]])


def test_a_file_without_rows_has_no_marks(tmp_path):
    found = marks(tmp_path, "video,frame,name,x,y\n")
    assert found.video == () and found.pixels.shape == (0, 2)


@pytest.mark.parametrize(
    ("row", "field", "found"),
    [
        (f"v.mp4,-1,{GOOD},1,2", "frame", "'-1'"),
        (f"v.mp4,1.5,{GOOD},1,2", "frame", "'1.5'"),
        (f"v.mp4,,{GOOD},1,2", "frame", "''"),
        ("v.mp4,1,left_corner,1,2", "name", "'left_corner'"),
        (f"v.mp4,1,{GOOD},nan,2", "x", "'nan'"),
        (f"v.mp4,1,{GOOD},1,inf", "y", "'inf'"),
        (f"v.mp4,1,{GOOD},1,", "y", "''"),
        (f"v.mp4,1,{GOOD},1_000,2", "x", "'1_000'"),
        (f"v.mp4,1,{GOOD},twelve,2", "x", "'twelve'"),
        (f",1,{GOOD},1,2", "video", "nothing"),
    ],
)
def test_a_bad_value_is_named_by_file_line_and_field(tmp_path, row, field, found):
    with pytest.raises(ValueError, match=f"KEYPOINTS.csv: line 3: {field}: expected .*, got {found}"):
        marks(tmp_path, f"video,frame,name,x,y\nv.mp4,0,{GOOD},1,2\n{row}\n")


def test_a_point_marked_twice_in_a_frame_is_refused_with_both_lines(tmp_path):
    rows = f"v.mp4,1,{GOOD},1,2\nv.mp4,2,{GOOD},1,2\nv.mp4,01,{GOOD},3,4\n"
    with pytest.raises(ValueError, match=r"line 4: name: expected each point once per frame, .* as in line 2"):
        marks(tmp_path, "video,frame,name,x,y\n" + rows)


@pytest.mark.parametrize(
    "header", ["video,frame,name,x", "video,frame,name,x,y,z", "video,frame,name,x,x", "1,2,3,4,5", ""]
)
def test_missing_unknown_and_repeated_columns_are_refused(tmp_path, header):
    with pytest.raises(ValueError, match="line 1: expected the columns video,frame,name,x,y"):
        marks(tmp_path, header + "\nv.mp4,0,a,1,2\n")


def test_all_faults_are_counted(tmp_path):
    with pytest.raises(ValueError, match=r"line 2: frame.*\(and 2 more\)"):
        marks(tmp_path, f"video,frame,name,x,y\nv.mp4,-1,{GOOD},nan,2\nv.mp4,1,{GOOD},1\n")


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b'video,frame,name,x,y\n"v.mp4'])
def test_what_is_no_csv_text_is_refused(tmp_path, content):
    (tmp_path / "k.csv").write_bytes(content)
    with pytest.raises(ValueError, match="k.csv: .*expected"):
        read_keypoints(tmp_path / "k.csv", COURT)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match="nothing.csv: expected a CSV file"):
        read_keypoints(tmp_path / "nothing.csv", COURT)
