"""Clips to render: found, read, and seen by their own cameras or by others."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_models.synthesis.camera_paths import usual_orbit
from pgm_models.synthesis.frames import frames_of_work
from pgm_models.synthesis.match_styles import styles_of
from pgm_models.synthesis.render_cameras import dolly_cameras, orbit_cameras, path_cameras
from pgm_models.synthesis.render_source import find_clip, picture_size, read_clip, refitted, scene_name
from pgm_models.synthesis.render_styles import chosen_styles, style_words
from tests.models.synthesis.drawn_matches import SIZE, drawn_matches, packed
from tests.models.synthesis.toy_models import PICTURE, toy_model

FRAMES = 8
THINGS = ("player0", "player1", "ball", "court", "backplate", "net")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A folder with `videos`, `work` and `dataset` of two matches."""
    out = drawn_matches(tmp_path_factory.mktemp("drawn"), frames=FRAMES)
    packed(out)
    return out


@pytest.fixture(scope="module")
def scene():
    return load_scene("tennis")


def test_clips_are_found_in_datasets_in_work_folders_and_by_their_videos(drawn, tmp_path):
    for path in (drawn / "dataset", drawn / "work", drawn):
        source = find_clip(path, clip="match1")
        assert source.clip.clip_id == "match1" and source.packed == (path == drawn / "dataset")
        assert scene_name(source) == "tennis"
        assert find_clip(path, video="match0").clip.clip_id == "match0"
        with pytest.raises(ValueError, match="clip: expected one of match0, match1, got 'match7'"):
            find_clip(path, clip="match7")
        with pytest.raises(ValueError, match="clip: expected one, to say which, of match0, match1, got none"):
            find_clip(path)
        with pytest.raises(ValueError, match="video: expected one of match0, match1, got 'match'"):
            find_clip(path, video="match")
    assert find_clip(drawn / "work" / "match0").clip.clip_id == "match0"
    with pytest.raises(ValueError, match="expected a packed dataset or a work folder, got no clip"):
        find_clip(tmp_path)


def test_a_clip_of_a_dataset_is_that_of_its_work_folder(drawn, scene):
    one, other = (read_clip(find_clip(drawn / name, clip="match1"), scene, (96, 54)) for name in ("dataset", "work"))
    assert len(one) == len(other) == FRAMES and one.rate == other.rate == 25.0
    assert one.row.tolist() == list(range(FRAMES)) and not one.missing(range(FRAMES))
    for name, values in vars(one.store.cameras).items():
        np.testing.assert_allclose(values, getattr(other.store.cameras, name), atol=1e-9)
    assert one.digest() != read_clip(find_clip(drawn / "dataset", clip="match0"), scene, (96, 54)).digest()
    for player in one.store.rotations:
        np.testing.assert_array_equal(one.store.rotations[player], other.store.rotations[player])
    # Cameras are those that a store of that size has.
    store = frames_of_work(drawn / "work" / "match1", picture=(96, 54))
    np.testing.assert_allclose(one.store.cameras.K, store.cameras.K)


def test_frames_without_a_camera_or_a_state_are_counted(drawn, scene, monkeypatch):
    source = find_clip(drawn / "work", clip="match0")

    def rows(folders, clips):
        found = {name: np.array(values) for name, values in read_table(folders[0] / "camera.parquet").items()}
        for table in ("players", "ball"):
            found |= {name: np.array(values) for name, values in read_table(folders[0] / f"{table}.parquet").items()}
        for name in found:
            if name.startswith("camera.") and found[name].dtype.kind == "f":
                found[name][[2, 5]] = np.nan
            if name.startswith("player1.joint"):
                found[name][[1, 2]] = np.nan
            if name.startswith("ball.") and found[name].dtype.kind == "f":
                found[name][3] = np.nan
        found["camera.status"][[2, 5]] = "none"
        yield found | {"episode_index": np.zeros(FRAMES, dtype=int), "shown": found["timestamp"]}

    monkeypatch.setattr("pgm_models.synthesis.render_source.work_rows", rows)
    clip = read_clip(source, scene, PICTURE)
    assert clip.row.tolist() == [0, 1, -1, 2, 3, -1, 4, 5] and len(clip.store) == 6
    assert clip.missing(range(FRAMES)) == {"camera": 2, "player1": 1, "ball": 1}
    assert clip.missing(range(4, 6)) == {"camera": 1}
    # Another camera sees them all.
    other = read_clip(source, scene, PICTURE, orbit_cameras(scene, PICTURE))
    assert other.missing(range(FRAMES)) == {"player1": 2, "ball": 1}
    assert len(other.store) == FRAMES


def test_pictures_of_another_shape_see_as_much_from_left_to_right(drawn, scene):
    source = find_clip(drawn / "work", clip="match0")
    own = read_clip(source, scene, SIZE)
    for size in ((96, 54), (96, 96), (400, 20)):
        clip = read_clip(source, scene, size)
        point = np.array([[1.0, -8.0, 1.0]])
        (x, y), (u, v) = (project(each.store.cameras[0], point)[0][0] for each in (own, clip))
        scale = size[0] / SIZE[0]
        assert u + 0.5 == pytest.approx((x + 0.5) * scale)
        assert v + 0.5 - size[1] / 2 == pytest.approx((y + 0.5 - SIZE[1] / 2) * scale)
    assert picture_size((1280, 720), (512, 288)) == (512, 288)
    assert picture_size((640, 480), (512, 288)) == (384, 288)
    camera = own.store.cameras[0]
    np.testing.assert_allclose(refitted(camera, SIZE, SIZE).K, camera.K)


def test_still_frames_are_those_whose_camera_is_that_of_a_neighbour(drawn, scene):
    clip = read_clip(find_clip(drawn / "work", clip="match0"), scene, PICTURE)
    assert not clip.still().any()  # the drawn camera pans
    cameras = clip.store.cameras[np.array([0, 0, 1, 2, 3, 3])]
    store = replace(clip.store[np.arange(6)], cameras=cameras)
    same = replace(clip, store=store, row=np.arange(6))
    assert same.still().tolist() == [True, True, False, False, True, True]
    gap = replace(clip, store=store, row=np.array([0, -1, 1, 2, 3, -1, 4, 5]))
    assert gap.still().tolist() == [False, False, False, False, False, False, True, True]


def test_cameras_go_round_and_past_the_play_and_as_a_file_says(drawn, scene, tmp_path):
    source, times = find_clip(drawn / "work", clip="match0"), np.linspace(0, 4, 5)
    aim = np.array([usual_orbit(scene, PICTURE).aim_world])
    for cameras in (orbit_cameras(scene, PICTURE, turn_deg_s=30.0), dolly_cameras(scene, PICTURE, 4.0)):
        view = cameras(times)
        assert view.size == PICTURE
        for number in range(len(times)):
            pixel, seen = project(view.camera[number], aim)
            np.testing.assert_allclose(pixel[0], [(PICTURE[0] - 1) / 2, (PICTURE[1] - 1) / 2], atol=1e-6)
            assert seen.all()
        places = view.camera.position_world
        assert (np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.5).all()
    near = orbit_cameras(scene, PICTURE, radius_m=12.0, elevation_deg=30.0)(times).camera.position_world - aim
    np.testing.assert_allclose(np.linalg.norm(near, axis=1), 12.0)
    np.testing.assert_allclose(near[:, 2], 6.0)
    across = dolly_cameras(scene, PICTURE, 4.0)(times).camera.position_world
    np.testing.assert_allclose(across[0], across[-1] * [-1, 1, 1], atol=1e-9)
    path = tmp_path / "path.json"
    path.write_text('{"width": 64, "height": 36, "keys": [{"time": 0, "position": [9, -20, 5], "look_at": [0, 0, 1]}]}')
    cameras, size = path_cameras(path)
    clip = read_clip(source, scene, size, cameras)
    assert size == (64, 36) and clip.still().all()
    np.testing.assert_allclose(clip.store.cameras.position_world, np.tile([9.0, -20, 5], (FRAMES, 1)))


def test_styles_are_the_clips_own_the_models_or_those_of_another_clip(drawn, tmp_path):
    model, source = toy_model(), find_clip(drawn / "work", clip="match0")

    def of(name, path="work"):
        store = frames_of_work(drawn / path / name, picture=PICTURE)
        return styles_of(model, store, np.arange(len(store)))

    own = chosen_styles(model, source, ())
    assert torch.equal(own.codes, of("match0")) and "match0" in own.words[0]
    words = style_words(["match1", f"player0={drawn / 'dataset'}:match1", "ball=match0"], THINGS)
    found = chosen_styles(model, source, words)
    assert torch.equal(found.codes[0, 3:], model.match_styles["match1"][3:])
    assert torch.equal(found.codes[0, 2], model.match_styles["match0"][2])
    torch.testing.assert_close(found.codes[0, 0], of("match1")[0, 0], atol=0.2, rtol=0.05)  # the video was packed anew
    assert found.words[0] == "as in the match match1 that the model learned from"
    model.keep_styles({})
    found = chosen_styles(model, source, style_words(["match1"], THINGS))
    assert torch.equal(found.codes, of("match1"))  # now a clip of the source
    silent = replace(source, clip=replace(source.clip, video=None, no_video="made without"))
    with pytest.raises(ValueError, match="expected a clip to take styles from, as match0 has no video.*made without"):
        chosen_styles(model, silent, ())
    with pytest.raises(ValueError, match="expected a match of the model .none., a clip of .*got 'nowhere'"):
        chosen_styles(model, source, style_words(["nowhere"], THINGS))
    model.keep_styles({"match9": of("match1")[0]})
    said = chosen_styles(model, silent, ())
    assert torch.equal(said.codes, of("match1"))
    assert said.words == ("as in the match match9 that the model learned from, as match0 has no video",)


def test_words_about_styles_that_cannot_be_are_refused():
    assert [word.thing for word in style_words(["a", "player0=b"], THINGS)] == ["", "player0"]
    assert style_words(["some/fold=er:c"], THINGS)[0].origin == "some/fold=er:c"
    for words, said in (
        (["player7=a"], "expected an object among player0, .* before the =, got 'player7'"),
        (["a", "b"], "expected one style of all objects, got two"),
        (["ball=a", "ball=b"], "expected one style of ball, got two"),
        (["ball="], r"expected \[OBJECT=\]FROM, got 'ball='"),
    ):
        with pytest.raises(ValueError, match=said):
            style_words(words, THINGS)
