"""COCO files that are damaged or made to harm are refused, with the place named."""

import copy
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.coco_people import read_coco_people
from tests.convert.coco_files import FRAMES, TENNIS, changed, exported_text, small_clip, without_frames


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return small_clip(tmp_path_factory.mktemp("coco"))


@pytest.fixture(scope="module")
def text(made, tmp_path_factory):
    return exported_text(made[0], tmp_path_factory.mktemp("exported"))


@pytest.fixture
def exported(text, tmp_path):
    (tmp_path / "rally.json").write_text(text)
    return tmp_path / "rally.json"


def annotation(**fields):
    return lambda c: c["annotations"][1].update(fields)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            annotation(bbox=[1, 2, -3, 4]),
            r"annotations\[1\]: bbox: expected a width and a height above 0, got 1, 2, -3, 4",
        ),
        (annotation(bbox=[1, 2, 3]), r"annotations\[1\]: bbox: expected 4 numbers"),
        (annotation(bbox=[1, 2, 3, "4"]), r"annotations\[1\]: bbox: expected numbers"),
        (annotation(bbox=[1e300, 2, 3, 4]), r"annotations\[1\]: bbox: expected numbers of at most 1e\+06 px"),
        (annotation(bbox={"x": 1}), r"annotations\[1\]: bbox: expected 4 numbers"),
        (annotation(keypoints=[1.0] * 50), "keypoints: expected x, y, v"),
        (annotation(keypoints=[1.0] * 30), "keypoints: expected 3 numbers for each of 17 named points, got 30 numbers"),
        (annotation(keypoints="nose"), "keypoints: expected x, y, v of at most 1000 points, got str"),
        (
            annotation(keypoints=[0.0] * 300_000),
            "keypoints: expected x, y, v of at most 1000 points, got 300000 numbers",
        ),
        (annotation(keypoints=[1.0, 2.0, 3] * 17), "keypoints: expected v of 0, 1, 2, or throughout scores of 0 to 1"),
        (annotation(keypoints=[1.0, None, 2] * 17), "keypoints: expected numbers"),
        (annotation(score=1.5), "score: expected a number from 0 to 1, got 1.5"),
        (annotation(image_id=99), "image_id: expected the id of an image of the file, got 99"),
        (annotation(image_id=[1]), "image_id: expected the id of an image"),
        (annotation(category_id=7), "category_id: expected the id of a category"),
        (annotation(track_id=[1]), "track_id: expected a number or a text"),
        (annotation(id=1), r"annotations\[1\]: id: expected each id once, got 1 again"),
        (annotation(image_id=1, id=50, **{"player": "player0"}), "frame 0: player0: expected one such person, got 2"),
        (lambda c: c["images"][1].update(id=1), r"images\[1\]: id: expected each id once"),
        (lambda c: c["images"][1].update(id=None), r"images\[1\]: id: expected a number or a text, got nothing"),
        (lambda c: c["images"][1].update(frame_index=0), "images: expected each frame once, got frame 0"),
        (lambda c: c["images"][1].update(frame_index=FRAMES), r"images\[1\].frame_index: expected below 6, got 6"),
        (lambda c: c["images"][1].update(frame_index=-1), "frame_index: expected a frame's number from 0"),
        (lambda c: c["images"][1].update(frame_index=1e30), "frame_index: expected a frame's number from 0"),
        (lambda c: c["images"][1].update(frame_index=True), "frame_index: expected a frame's number from 0"),
        (lambda c: [i.update(clip_id="other") for i in c["images"]], "images: expected those of clip rally, got other"),
        (lambda c: c.update(images=[]), "images: expected"),
        (lambda c: c.pop("images"), "images: expected a COCO file with the list, got info, annotations, categories"),
        (lambda c: c.update(annotations={}), "annotations: expected a list of objects"),
        (lambda c: c.update(annotations=[1]), "annotations: expected a list of objects"),
        (
            lambda c: c.update(categories=[{"id": 1, "name": "ball"}]),
            "categories: expected one of people, got 1 others",
        ),
        (lambda c: c["categories"][0].update(keypoints=["nose"] * 17), "keypoints: expected each name once"),
        (
            lambda c: without_frames(c, ["b.jpg", "a.jpg", "c.jpg", "d.jpg", "e.jpg", "f.jpg"]),
            "images: expected frame_index",
        ),
        (lambda c: without_frames(c, ["0.jpg", "../../0.png", "2.jpg", "3.jpg", "4.jpg", "5.jpg"]), "each frame once"),
        (
            lambda c: without_frames(c, [f"{10**18 + i}.jpg" for i in range(FRAMES)]),
            "file_name: expected a frame's number",
        ),
        (
            lambda c: without_frames(c, [f"{500 + i}.jpg" for i in range(FRAMES)]),
            "0 to 5 of the video, got none of them",
        ),
    ],
)
def test_a_damaged_file_is_refused_with_its_place(made, exported, change, words):
    with pytest.raises(ValueError, match=words) as caught:
        read_coco_people(changed(exported, change), made[1], TENNIS.players)
    assert str(exported) in str(caught.value) and len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "expected a JSON file"),
        ('{"images": [', "expected a JSON file"),
        ('{"images": [], "annotations": [{"bbox": [NaN, 1, 2, 3]}]}', "NaN, which is no number of JSON"),
        ("[" * 100_000, "expected a JSON file"),
        ("[]", "expected at least one result, got none"),
        ("3", "annotations: expected a COCO file with the list, got int"),
    ],
)
def test_what_is_no_coco_file_is_refused(made, tmp_path, content, words):
    path = tmp_path / "people.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=words):
        read_coco_people(path, made[1], TENNIS.players)


def test_a_scene_without_players_takes_no_people(made, exported):
    with pytest.raises(ValueError, match="players: expected a scene with player objects"):
        read_coco_people(exported, made[1], ())


@settings(max_examples=60)
@given(st.data())
def test_any_change_of_a_value_gives_people_or_an_error(made, text, data):
    work, camera, _ = made
    target = work.parent / "any.json"
    content = json.loads(text)
    place = data.draw(st.sampled_from(list(paths(content))))
    value = data.draw(st.sampled_from([None, -1, 0, 1e308, "x", [], {}, True, [[1]], 2**70]))
    inner = content
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = copy.deepcopy(value)
    target.write_text(json.dumps(content))
    try:
        read_coco_people(target, camera, TENNIS.players)
    except ValueError as error:
        assert str(target) in str(error)


def paths(value, place=()):
    """Places of all values, a few of each list."""
    inner = value.items() if isinstance(value, dict) else list(enumerate(value))[:4] if isinstance(value, list) else ()
    for key, child in inner:
        yield (*place, key)
        yield from paths(child, (*place, key))
