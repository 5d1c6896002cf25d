import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.convert.annotation_events import read_events

TIMES = np.arange(300) / 25
META = (
    "<version>1.1</version><meta><task><size>300</size><original_size><width>1280</width></original_size></task></meta>"
)


def cvat(tmp_path, body, head='<?xml version="1.0" encoding="utf-8"?>', **more):
    path = tmp_path / "annotations.xml"
    path.write_text(f"{head}<annotations>{META}{body}</annotations>", encoding="utf-8")
    return read_events(path, TIMES, **more)


def track(label, *shapes):
    return f'<track id="0" label="{label}" source="manual">{"".join(shapes)}</track>'


def point(frame, points="10.50,20.50", outside=0, inner="", keyframe=1):
    return (
        f'<points frame="{frame}" keyframe="{keyframe}" outside="{outside}" occluded="0" points="{points}" z_order="0">'
        f"{inner}</points>"
    )


def box(frame, outside=0):
    return f'<box frame="{frame}" keyframe="1" outside="{outside}" xtl="10" ytl="20" xbr="20" ybr="40"></box>'


def frames_of(events):
    return (events.times * 25).round(6).tolist()


def test_tracks_of_cvat_are_events_from_their_first_frame_until_outside(tmp_path):
    shapes = (point(50), point(51, keyframe=0), point(52, outside=1), point(90), point(91, outside=1))
    events = cvat(
        tmp_path, track("Ball Hit", *shapes) + track("bounce", box(70), box(71, outside=1)) + track("player", box(0))
    )
    assert frames_of(events) == [50, 70, 90] and events.kinds.tolist() == ["hit", "bounce", "hit"]
    assert set(events.sources) == {"human"}
    # The middle of the box's lower edge, from the corner of the picture to the centre of its first pixel.
    np.testing.assert_array_equal(events.ground_px, [[np.nan, np.nan], [14.5, 39.5], [np.nan, np.nan]])
    np.testing.assert_allclose(events.time_std * 25, 12**-0.5)


def test_a_label_with_the_word_ground_places_a_hit_and_a_plain_bounce_too(tmp_path):
    events = cvat(tmp_path, track("hit_ground", point(5), point(6, outside=1)) + track("bounce", point(9)))
    np.testing.assert_array_equal(events.ground_px, [[10, 20], [10, 20]])


def test_attributes_and_tags_of_cvat_are_events(tmp_path):
    def said(kind):
        return f'<attribute name="event">{kind}</attribute>'

    ball = track(
        "ball", *(point(f, inner=said(kind)) for f, kind in enumerate(["none", "hit", "hit", "none", "bounce"]))
    )
    tags = '<tag label="net" frame="20" source="manual"></tag>'
    images = '<image id="33" name="frame_33"><tag label="last"/><points label="ball" points="1,2"/></image>'
    events = cvat(tmp_path, ball + tags + images)
    assert list(zip(frames_of(events), events.kinds, strict=True)) == [
        (1, "hit"),
        (4, "bounce"),
        (20, "net"),
        (33, "last"),
    ]


def test_an_attribute_that_tells_something_else_leaves_the_label(tmp_path):
    soft = point(8, inner='<attribute name="type">soft</attribute>')
    assert cvat(tmp_path, track("bounce", soft)).kinds.tolist() == ["bounce"]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (track("ball", point(1)), "labels: expected some of hit, bounce, .* got 'ball'"),
        ("", "labels: expected some of .* got no label"),
        (track("hit", point(-1)), "line 1: frame: expected a frame's number of 0 or more, got '-1'"),
        (track("hit", point("x")), "line 1: frame: expected .* got 'x'"),
        (track("hit", point(300)), "frame: expected one of the clip's, 0 to 299, got 300"),
        (track("bounce", point(3, "1,2;3,4")), "points: expected one point x,y"),
        (track("bounce", point(3, "1,nan")), "points: expected a pixel coordinate, got 'nan'"),
        (track("bounce", point(3, "5000,5000")), "x: expected a pixel near a picture of 1280 x 720"),
        ('<track id="0"><points frame="1" points="1,2"/></track>', "label: expected the attribute, got id"),
        (track("hit", "<points points='1,2'/>"), "frame: expected the attribute, got points"),
        (track("hit", "<box frame='1' xtl='1'/>"), "xbr: expected the attribute"),
        ("<a>" * 40 + "</a>" * 40, "elements: expected at most 32 within each other"),
        ("<track label='hit'>", "expected a CVAT export in XML, got"),
    ],
)
def test_a_bad_cvat_export_is_refused_by_place_and_field(tmp_path, body, said):
    with pytest.raises(ValueError, match=f"annotations.xml.*{said}"):
        cvat(tmp_path, body, size=(1280, 720))


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;&b;&b;&b;">]>',
        '<!DOCTYPE a SYSTEM "file:///etc/passwd">',
        '<!DOCTYPE a [<!ENTITY % p SYSTEM "http://localhost/">%p;]>',
    ],
)
def test_document_types_and_entities_are_refused(tmp_path, head):
    with pytest.raises(ValueError, match="line 1: document type: expected none"):
        cvat(tmp_path, track("hit", point(1, inner="&c;")), head=head)


def test_other_xml_and_other_files_are_refused(tmp_path):
    (tmp_path / "page.xml").write_text("<html></html>")
    with pytest.raises(ValueError, match="page.xml: line 1: root: expected <annotations>, .* got <html>"):
        read_events(tmp_path / "page.xml", TIMES)
    (tmp_path / "empty.xml").write_text("")
    for name, said in (
        ("empty.xml", "no element found"),
        ("absent.xml", "nothing there"),
        ("marks.xlsx", "got .xlsx"),
        ("marks", "no suffix"),
    ):
        with pytest.raises(ValueError, match=f"{name}: expected .*{said}"):
            read_events(tmp_path / name, TIMES)


def label_studio(tmp_path, *results, data=None, **more):
    task = {"id": 1, "data": data or {"video": "/data/upload/rally.mp4"}, "annotations": [{"result": list(results)}]}
    task["predictions"] = [{"result": [timeline(200, 200, "hit")]}]
    path = tmp_path / "export.json"
    path.write_text(json.dumps([task]))
    return read_events(path, TIMES, **more)


def timeline(start, end, label):
    value = {"ranges": [{"start": start, "end": end}], "timelinelabels": [label]}
    return {"id": "a", "type": "timelinelabels", "from_name": "t", "to_name": "video", "value": value}


def rectangle(*keys, label="bounce", **value):
    sequence = [
        {"frame": frame, "enabled": on, "x": 50, "y": 25, "width": 10, "height": 5, "rotation": 0, "time": frame / 25}
        for frame, on in keys
    ]
    return {"type": "videorectangle", "value": {"sequence": sequence, "labels": [label], **value}}


def test_spans_of_label_studio_count_frames_from_1_and_are_as_uncertain_as_they_are_long(tmp_path):
    events = label_studio(tmp_path, timeline(11, 11, "Hit"), timeline(21, 24, "net contact"), timeline(1, 9, "walking"))
    np.testing.assert_allclose(events.times * 25, [10, 21.5])
    np.testing.assert_allclose(events.time_std * 25, [12**-0.5, 4 * 12**-0.5])
    assert events.kinds.tolist() == ["hit", "net"] and np.isnan(events.ground_px).all()


def test_boxes_and_key_points_of_label_studio_are_events_with_percent_as_pixels(tmp_path):
    shape = {"original_width": 1000, "original_height": 400}
    still = {"type": "keypointlabels", **shape, "value": {"x": 10, "y": 50, "width": 0.3, "keypointlabels": ["bounce"]}}
    boxes = rectangle((31, False), (61, True), (62, False), framesCount=300)
    events = label_studio(tmp_path, boxes, size=(200, 100))
    assert frames_of(events) == [30, 60]
    np.testing.assert_allclose(events.ground_px, [[109.5, 29.5]] * 2)
    for data in ({"image": "/data/upload/8ab2-frame_000077.jpg"}, {"image": "x.jpg", "frame": 77}):
        events = label_studio(tmp_path, still, data=data)
        assert frames_of(events) == [77]
        np.testing.assert_allclose(events.ground_px, [[99.5, 199.5]])


@pytest.mark.parametrize(
    ("results", "said"),
    [
        ([], "labels: expected some of hit, .* got no label"),
        ([timeline(3, 3, "serve")], "labels: .* got 'serve'"),
        ([timeline(0, 3, "hit")], r"\[0\].annotations\[0\].result\[0\].value.ranges\[0\]: expected a start of 1"),
        ([timeline(5, 3, "hit")], "no end before it, got 5, 3"),
        ([timeline("a", 3, "hit")], "ranges\\[0\\].start: expected a number, got 'a'"),
        ([timeline(400, 400, "hit")], "frame: expected one of the clip's, 0 to 299, got 399"),
        ([{"type": "timelinelabels"}], "result\\[0\\].value: expected a dict, got None"),
        ([rectangle((3, True))], "original_width: expected the picture's size, there or given, got neither"),
        ([rectangle((2.5, True))], "frame: expected a whole number of 1 or more, got 2.5"),
        ([rectangle((3, False), label="hit", framesCount=288)], "got neither|frames: expected the video's 300 frames"),
    ],
)
def test_a_bad_label_studio_export_is_refused_by_place_and_field(tmp_path, results, said):
    with pytest.raises(ValueError, match=f"export.json: .*{said}"):
        label_studio(tmp_path, *results)


def test_a_label_studio_project_of_another_frame_rate_is_refused(tmp_path):
    boxes = rectangle((3, False), label="hit", framesCount=288)
    with pytest.raises(ValueError, match="frames: expected the video's 300 frames at least, got 288"):
        label_studio(tmp_path, boxes, size=(200, 100))


@pytest.mark.parametrize("text", ["", "{", "3", '[{"data": {}}]', '[{"annotations": []}]', "[NaN]", '["task"]'])
def test_what_is_no_label_studio_export_is_refused(tmp_path, text):
    (tmp_path / "export.json").write_text(text)
    with pytest.raises(ValueError, match="export.json: "):
        read_events(tmp_path / "export.json", TIMES)


def test_tasks_of_several_videos_are_refused(tmp_path):
    tasks = [{"data": {"video": name}, "annotations": []} for name in ("a.mp4", "b.mp4")]
    (tmp_path / "export.json").write_text(json.dumps(tasks))
    with pytest.raises(ValueError, match="video: expected the tasks of one video, got a.mp4, b.mp4"):
        read_events(tmp_path / "export.json", TIMES)


def test_a_csv_is_read_as_one(tmp_path):
    (tmp_path / "EVENTS.csv").write_text("frame,kind,x,y\n9,hit,,\n")
    assert frames_of(read_events(tmp_path / "EVENTS.csv", TIMES)) == [9]


SOUND = {
    "marks.csv": "frame,kind,x,y\n1,hit,3,4\n2.5,bounce,,\n",
    "marks.xml": (
        '<annotations><track id="0" label="hit"><points frame="1" outside="0" points="1,2">'
        '<attribute name="event">bounce</attribute></points></track><tag label="net" frame="4"/></annotations>'
    ),
    "marks.json": json.dumps(
        [{"data": {"video": "a"}, "annotations": [{"result": [timeline(3, 4, "hit"), rectangle((5, True))]}]}]
    ),
}
PIECES = ["", "nan", "-1", "1e400", '"', "<", ">", "&", "null", "[]", "{}", "\x00", "\u0661", "\n", "hit", "9" * 11]
CHANGES = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), st.sampled_from(PIECES)), min_size=1, max_size=3)


@pytest.mark.parametrize("name", SOUND)
@given(changes=CHANGES)
def test_a_damaged_file_is_read_or_refused_by_its_name(tmp_path_factory, name, changes):
    text = SOUND[name]
    for share, length, piece in changes:
        at = int(share * len(text))
        text = text[:at] + piece + text[at + length :]
    path = tmp_path_factory.mktemp("damaged") / name
    path.write_text(text, encoding="utf-8")
    try:
        read_events(path, TIMES, size=(1280, 720))
    except ValueError as error:
        assert str(path) in str(error) and "expected" in str(error)
