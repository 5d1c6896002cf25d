"""Labels of a clip that go to annotation programs and come back mended."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pgm_cli.main import run

from pgm_data.convert.clip_labels import ClipLabels, clip_labels, spans
from pgm_data.convert.corrected_labels import export_labels, import_labels
from pgm_data.convert.cvat_labels import read_cvat_labels, write_cvat_labels
from pgm_data.convert.label_studio_labels import read_label_studio_labels, write_label_studio_labels
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.scene import load_scene
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import MatchFiles, write_match

TENNIS = load_scene("tennis")
PLAYERS = tuple(player.name for player in TENNIS.players)
assert TENNIS.court is not None
POINTS = TENNIS.court.point_names
KINDS = ("point", "box", "ball", "event", "text")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A work folder with one clip of 150 frames that has every table."""
    out = tmp_path_factory.mktemp("labels")
    write_match(out, TENNIS, ClipOptions(frames=150), MatchFiles(pictures="none"), seed=5, match=0)
    (out / "work" / ".pgm").mkdir()
    return out / "work"


def only_clip(work: Path) -> Path:
    return next(path.parent for path in work.glob("*/clip.json"))


def as_annotations(path: Path) -> None:
    """What a person does who accepts all predictions."""
    tasks = json.loads(path.read_text())
    for task in tasks:
        task["annotations"] = task.pop("predictions")
    path.write_text(json.dumps(tasks))


def same(a: ClipLabels, b: ClipLabels, within_px: float) -> None:
    """Whether two structs say the same, in whatever order."""
    for kind, frame in (
        ("point", "point_frame"),
        ("box", "box_frame"),
        ("ball", "ball_frame"),
        ("event", "event_frame"),
    ):
        keys = []
        for labels in (a, b):
            name = getattr(labels, {"point": "point_name", "box": "box_name", "event": "event_kind"}.get(kind, frame))
            order = sorted(range(len(name)), key=lambda i: (str(name[i]), int(getattr(labels, frame)[i])))
            keys.append([(str(name[i]), int(getattr(labels, frame)[i])) for i in order])
            if kind != "event":
                keys.append(getattr(labels, f"{kind}_px")[order])
        half = len(keys) // 2
        assert keys[0] == keys[half]
        if kind != "event":
            np.testing.assert_allclose(keys[1], keys[half + 1], atol=within_px)
    texts = [
        sorted(zip(x.text_name.tolist(), x.text_start.tolist(), x.text_end.tolist(), x.text.tolist(), strict=True))
        for x in (a, b)
    ]
    assert texts[0] == texts[1]
    np.testing.assert_allclose(np.sort(a.ui_px, axis=0), np.sort(b.ui_px, axis=0), atol=within_px)


@pytest.mark.parametrize("form", ["cvat", "label-studio"])
def test_labels_that_go_out_come_back(simulated, tmp_path, form):
    """Lost: metres, times, scores, alternatives, events between frames of the ball (CVAT), parts of 0.01 px."""
    folder = only_clip(simulated)
    labels = replace(clip_labels(folder, TENNIS), ui_px=np.array([[10.0, 20.0, 200.5, 60.25], [1000, 600, 1200, 700]]))
    assert len(labels.point_name) > 10 and len(labels.box_name) == 300 and len(labels.ball_frame) > 30
    assert len(labels.event_frame) >= 2 and len(labels.text) >= 2
    path = tmp_path / "labels"
    if form == "cvat":
        write_cvat_labels(path, labels, PLAYERS)
        back, _ = read_cvat_labels(path, labels, PLAYERS, POINTS)
    else:
        write_label_studio_labels(path, labels, PLAYERS)
        as_annotations(path)
        back, _ = read_label_studio_labels(path, labels, PLAYERS, POINTS)
    same(back, labels, 0.011)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    frames=st.sets(st.integers(100, 140), min_size=1),
    x=st.floats(-50, 1300),
    words=st.sampled_from(["hits & runs", '"<late>"', "a\nb", "ö" * 500]),
)
def test_gaps_and_odd_words_survive_both_programs(tmp_path, frames, x, words):
    count = len(frames)
    labels = ClipLabels(
        video="../v.mp4", size=(1280, 720), first_frame=100, frames=41,
        point_name=np.zeros(0, object), point_frame=np.zeros(0, np.int64), point_px=np.zeros((0, 2)),
        box_name=np.full(count, "player1", dtype=object), box_frame=np.array(sorted(frames)),
        box_px=np.tile([x, 10.0, x + 30, 90.0], (count, 1)) + np.arange(count)[:, None] * 0.25,
        ball_frame=np.array(sorted(frames)), ball_px=np.tile([x, 33.0], (count, 1)),
        event_frame=np.zeros(0, np.int64), event_kind=np.zeros(0, object),
        text_name=np.array(["player1"], object), text_start=np.array([min(frames)]),
        text_end=np.array([min(frames) + 1]), text=np.array([words.strip()], object), ui_px=np.zeros((0, 4)),
    )  # fmt: skip
    write_cvat_labels(tmp_path / "a.xml", labels, PLAYERS)
    same(read_cvat_labels(tmp_path / "a.xml", labels, PLAYERS, POINTS)[0], labels, 0.011)
    write_label_studio_labels(tmp_path / "a.json", labels, PLAYERS)
    as_annotations(tmp_path / "a.json")
    same(read_label_studio_labels(tmp_path / "a.json", labels, PLAYERS, POINTS)[0], labels, 0.011)


def test_predictions_that_nobody_has_accepted_are_no_labels(simulated, tmp_path):
    labels = clip_labels(only_clip(simulated), TENNIS)
    write_label_studio_labels(tmp_path / "a.json", labels, PLAYERS)
    with pytest.raises(ValueError, match="annotations: expected a list"):
        read_label_studio_labels(tmp_path / "a.json", labels, PLAYERS, POINTS)


def test_spans_join_following_frames_of_the_same_words():
    frames = np.array([3, 1, 2, 5, 6, 7])
    words = np.array(["a", "a", "a", "a", "b", ""], dtype=object)
    assert spans(frames, words) == [(1, 4, "a"), (5, 6, "a"), (6, 7, "b")]


BAD = {
    "a name that is no court point": ('<attribute name="name">net</attribute>', "name: expected one of"),
    "two coordinates": ('points="5,6;7,8"', "points: expected one point"),
    "no number": ('points="5,x"', "a pixel coordinate"),
    "a frame below 0": ('frame="-3"', "frame: expected a frame"),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_shape_is_named_with_its_line(simulated, tmp_path, what):
    labels = clip_labels(only_clip(simulated), TENNIS)
    bad, message = BAD[what]
    whole = {
        "frame": 'frame="0"',
        "points": 'points="5,6"',
        "name": '<attribute name="name">near_service_T</attribute>',
    }
    key = "name" if "attribute" in bad else bad.split("=")[0]
    whole[key] = bad
    path = tmp_path / "a.xml"
    path.write_text(
        f'<annotations>\n<track label="court">\n<points {whole["frame"]} {whole["points"]}>'
        f"{whole['name']}</points></track></annotations>"
    )
    with pytest.raises(ValueError, match=message) as caught:
        read_cvat_labels(path, labels, PLAYERS, POINTS)
    assert "line 3" in str(caught.value)


def test_entities_that_grow_without_bound_are_refused(simulated, tmp_path):
    labels = clip_labels(only_clip(simulated), TENNIS)
    path = tmp_path / "a.xml"
    path.write_text('<!DOCTYPE a [<!ENTITY b "bbbbbbbb">]><annotations>&b;</annotations>')
    with pytest.raises(ValueError, match="document type"):
        read_cvat_labels(path, labels, PLAYERS, POINTS)


def test_corrections_become_files_that_the_stages_read(simulated, tmp_path, capsys):
    from pgm_data.convert.annotation_events import read_events
    from pgm_data.convert.keypoints_csv import read_keypoints
    from pgm_data.convert.mot_boxes import read_mot_boxes
    from pgm_data.convert.track_csv import read_track_csv
    from pgm_data.dataset.clip_camera import read_clip_camera

    folder = only_clip(simulated)
    document = read_document(folder / "clip.json", "clip")
    write_document(folder / "clip.json", "clip", document | {"ui_boxes_px": [[5.0, 5.0, 50.0, 25.0]]})
    out = tmp_path / "out"
    assert run(["export", "cvat", str(simulated), "--out", str(out)]) == 0
    path = out / f"{folder.name}.xml"
    path.write_text(path.read_text().replace(">hit<", ">bounce<", 1))
    assert run(["import", "cvat", str(path), "--work", str(simulated), "--clip", folder.name]) == 0
    said = capsys.readouterr().out
    labels, clip = clip_labels(folder, TENNIS), read_clip_camera(folder)
    corrected = folder / "corrected"
    assert f"--boxes {corrected / 'boxes.csv'}" in said
    assert read_document(folder / "clip.json", "clip")["ui_boxes_px"] == [[5.0, 5.0, 50.0, 25.0]]
    assert TENNIS.court is not None
    assert len(read_keypoints(corrected / "keypoints.csv", TENNIS.court).frame) == len(labels.point_name)
    boxes = read_mot_boxes(corrected / "boxes.csv", clip, TENNIS.players)
    np.testing.assert_allclose(boxes.boxes_px[:, 1], labels.box_px[labels.box_name == "player1"], atol=0.011)
    track = read_track_csv(corrected / "track.csv")
    np.testing.assert_allclose(track.pixels[track.visible], labels.ball_px, atol=0.011)
    events = read_events(corrected / "events.csv", clip.capture_time, first_frame=int(clip.video_frame[0]))
    changed = np.flatnonzero(labels.event_kind == "hit")[0]
    assert events.kinds[changed] == "bounce"
    assert (events.kinds[changed + 1 :] == labels.event_kind[changed + 1 :]).all()


def test_labels_of_another_clip_are_said_to_be_none(simulated, tmp_path):
    folder = only_clip(simulated)
    document = read_document(folder / "clip.json", "clip")
    write_document(folder / "clip.json", "clip", document | {"ui_boxes_px": []})
    out = tmp_path / "out"
    out.mkdir()
    export_labels(simulated, out, form="cvat")
    path = next(out.glob("*.xml"))
    path.write_text(path.read_text().replace(' frame="', ' frame="99'))
    with pytest.raises(ValueError, match="expected labels in frames 0 to 149"):
        import_labels(path, folder, form="cvat")


def test_a_misspelt_label_is_told_of(simulated, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["export", "cvat", str(simulated), "--out", str(out)]) == 0
    path = next(out.glob("*.xml"))
    path.write_text(path.read_text().replace('label="player0"', 'label="playerX"'))
    assert run(["import", "cvat", str(path), "--work", str(simulated)]) == 3
    assert (
        "expected one of court, player0, player1, ball, ui, got 'playerX (box)': 150 left out"
        in capsys.readouterr().err
    )
