import json
import shutil

import cv2
import numpy as np
import pycolmap
import pytest
from pgm_cli import export, import_
from pgm_cli.console import UsageError

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from tests.convert.folders import SIZE, cameras, numbered_video, track, write_work
from tests.convert.test_colmap import assert_same, pictures

VIDEO_FRAMES = 30


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A work folder of two clips of one video; the second has frames without a camera and a name with a space."""
    root = tmp_path_factory.mktemp("exchange")
    numbered_video(root / "match.mp4", VIDEO_FRAMES)
    tracks = [
        track("match.00", cameras(8), interpolated=(3,), first=2),
        track("match 01", cameras(12, seed=1), none=(0, 4, 11), first=15),
    ]
    write_work(root / "work", tracks, root / "match.mp4", video_frames=VIDEO_FRAMES)
    return root


def run(command, *words) -> int:
    return command.main([str(word) for word in words])


FORMATS = ["colmap", "nerfstudio"]


@pytest.mark.parametrize("form", FORMATS)
def test_every_frame_goes_out_and_comes_back_into_its_place(made, tmp_path, form, capsys):
    assert run(export, form, made / "work", "--out", tmp_path / "out", "--every", 1) == 0
    said = capsys.readouterr().out
    assert "17 pictures" in said and "match 01 frame 4: residual 3.1 px above 1.5 px" in said
    assert run(import_, form, tmp_path / "out", "--out", tmp_path / "back") == 0
    for clip_id in ("match.00", "match 01"):
        before, after = read_clip_camera(made / "work" / clip_id), read_clip_camera(tmp_path / "back" / clip_id)
        for name in ("video_frame", "timestamp", "capture_time", "is_duplicate", "status", "reason"):
            np.testing.assert_array_equal(getattr(before, name), getattr(after, name), name)
        assert_same(before.camera[before.has_camera], after.camera[before.has_camera])
        assert np.isnan(after.camera.K[~before.has_camera]).all()
        document = read_document(tmp_path / "back" / clip_id / "clip.json", "clip")
        assert (document["quality"], document["lens_model"]["model"]) == ("imported", "k1")
    shots = {
        name: read_table(folder / "shots.parquet") for name, folder in (("a", made / "work"), ("b", tmp_path / "back"))
    }
    for name in shots["a"]:
        np.testing.assert_array_equal(shots["a"][name], shots["b"][name], name)
    assert read_document(tmp_path / "back" / "run.json", "run")["inputs"][0]["state"] == "ok"
    assert check_paths([tmp_path / "back"]) == []


@pytest.mark.parametrize("form", FORMATS)
def test_frames_that_did_not_go_out_come_back_as_none(made, tmp_path, form):
    assert run(export, form, made / "work", "--out", tmp_path / "out", "--every", 5) == 0
    assert run(import_, form, tmp_path / "out", "--out", tmp_path / "back") == 0
    after = read_clip_camera(tmp_path / "back" / "match 01")
    assert np.flatnonzero(after.has_camera).tolist() == [5, 10]
    assert len(after.status) == 12
    assert all(after.reason[~after.has_camera])


def test_the_time_line_lists_the_frames_that_were_left_out(made, tmp_path):
    run(export, "colmap", made / "work", "--out", tmp_path / "out", "--every", 2)
    left_out = json.loads((tmp_path / "out" / "pgm.json").read_text())["left_out"]
    assert [(frame["clip_id"], frame["frame_index"]) for frame in left_out] == [("match 01", 0), ("match 01", 4)]
    names = {image.name for image in pycolmap.Reconstruction(tmp_path / "out" / "sparse" / "0").images.values()}
    assert names == {f"match.00/{i:06d}.jpg" for i in (0, 2, 4, 6)} | {f"match_01/{i:06d}.jpg" for i in (2, 6, 8, 10)}


@pytest.mark.parametrize(("form", "suffix"), [("colmap", "jpg"), ("nerfstudio", "png")])
def test_pictures_are_the_frames_they_are_named_after(made, tmp_path, form, suffix):
    words = ("--every", 3, "--images", "--picture-format", suffix)
    assert run(export, form, made / "work", "--out", tmp_path / "out", *words) == 0
    files = sorted((tmp_path / "out" / "images").rglob(f"*.{suffix}"))
    assert [path.parent.name + path.stem for path in files] == [
        *(f"match.00{i:06d}" for i in (0, 3, 6)),
        *(f"match_01{i:06d}" for i in (3, 6, 9)),
    ]
    for path in files:
        first = 2 if path.parent.name == "match.00" else 15
        picture = cv2.imread(str(path))
        assert picture.shape == (SIZE[1], SIZE[0], 3)
        assert abs(picture.mean() - (40 + 5 * (first + int(path.stem)))) < 2.5


def test_every_file_path_of_a_transforms_file_is_there(made, tmp_path):
    run(export, "nerfstudio", made / "work", "--out", tmp_path / "out", "--every", 4, "--images")
    frames = json.loads((tmp_path / "out" / "transforms.json").read_text())["frames"]
    assert frames and all((tmp_path / "out" / frame["file_path"]).is_file() for frame in frames)


def test_a_missing_or_exchanged_video_leaves_the_cameras_and_says_so(made, tmp_path, capsys):
    shutil.copytree(made / "work", tmp_path / "work")
    assert run(export, "colmap", tmp_path / "work", "--out", tmp_path / "a", "--images") == 3
    assert "source_path: expected its video at" in capsys.readouterr().err
    assert (tmp_path / "a" / "sparse" / "0" / "images.bin").exists()
    (tmp_path / "match.mp4").write_bytes(b"another file")
    assert run(export, "colmap", tmp_path / "work", "--out", tmp_path / "b", "--images") == 3
    assert "sha256: expected" in capsys.readouterr().err
    assert run(export, "colmap", tmp_path / "work", "--out", tmp_path / "c", "--images", "--videos", made) == 0


def foreign_model(folder):
    """A COLMAP model without a time line: two folders of pictures, one of them in an order that text would spoil."""
    from dataclasses import replace

    from pgm_data.convert.colmap import write_colmap

    names = ("right/f10.jpg", "right/f9.jpg", "left/1.jpg", "left/2.jpg")
    write_colmap(folder / "sparse" / "0", replace(pictures(cameras(4)), names=names), text=True)


def test_foreign_pictures_become_a_clip_per_folder_at_the_stated_rate(tmp_path, capsys):
    foreign_model(tmp_path / "m")
    assert run(import_, "colmap", tmp_path / "m", "--out", tmp_path / "back", "--scene", "tennis", "--fps", 50) == 0
    assert "left: times are nominal, at 50 frames per second" in capsys.readouterr().out
    left, right = (read_clip_camera(tmp_path / "back" / name) for name in ("left", "right"))
    np.testing.assert_allclose(left.timestamp, [0.0, 0.02])
    np.testing.assert_allclose(right.timestamp, [0.04, 0.06])
    np.testing.assert_allclose(right.camera.K[:, 0, 0], cameras(4).K[[1, 0], 0, 0], rtol=1e-12)
    document = read_document(tmp_path / "back" / "right" / "clip.json", "clip")
    assert (document["first_video_frame"], document["time_base"]) == (2, "1/50")
    shots = read_table(tmp_path / "back" / "shots.parquet")
    assert shots["video"].tolist() == ["../m/sparse/0/images.txt"] * 4
    assert shots["clip_id"].tolist() == ["left", "left", "right", "right"]
    assert check_paths([tmp_path / "back"]) == []


def test_some_bad_pictures_give_exit_3_and_only_bad_ones_exit_4(tmp_path, capsys):
    foreign_model(tmp_path / "m")
    images = tmp_path / "m" / "sparse" / "0" / "images.txt"
    images.write_text(images.read_text().replace("left/1.jpg", "../left/1.jpg"))
    assert run(import_, "colmap", tmp_path / "m", "--out", tmp_path / "some") == 3
    assert "NAME: expected a relative path below the file's own folder, got '../left/1.jpg'" in capsys.readouterr().err
    assert len(read_clip_camera(tmp_path / "some" / "left").status) == 1
    images.write_text(images.read_text().replace("left/", "/left/").replace("right/", "../right/"))
    assert run(import_, "colmap", tmp_path / "m", "--out", tmp_path / "none") == 4
    assert not list((tmp_path / "none").glob("*/camera.parquet"))
    images.write_text("")
    assert run(import_, "colmap", tmp_path / "m", "--out", tmp_path / "empty") == 4


def test_pictures_of_another_size_than_their_clip_are_refused(tmp_path, capsys):
    foreign_model(tmp_path / "m")
    cameras_file = tmp_path / "m" / "sparse" / "0" / "cameras.txt"
    lines = cameras_file.read_text().splitlines()
    lines[-1] = lines[-1].replace(" 320 180 ", " 640 360 ")
    cameras_file.write_text("\n".join(lines))
    assert run(import_, "colmap", tmp_path / "m", "--out", tmp_path / "back") == 3
    assert "width, height: expected 320 x 180, as its clip has, got 640 x 360" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t["clips"]["match.00"]["timestamp"].pop(), "clips.match.00.timestamp: expected 8 values"),
        (lambda t: t["clips"]["match.00"]["clip"].update(clip_id="../x"), "clip_id: expected a time line"),
        (lambda t: t["clips"]["match.00"]["clip"].update(clip_id="other"), "clip.clip_id: expected 'match.00'"),
        (lambda t: t["clips"].update({"../../evil": t["clips"]["match.00"]}), "expected a time line"),
        (lambda t: t["pictures"]["match.00/000000.jpg"].update(frame_index=8), "expected a frame of a clip"),
        (lambda t: t["pictures"]["match.00/000000.jpg"].update(frame_index=1), "each shown once"),
        (lambda t: t["pictures"]["match.00/000000.jpg"].update(clip_id="nobody"), "expected a frame of a clip"),
        (lambda t: t["shots"]["../match.mp4"]["runs"].pop(), "runs: expected 30 frames"),
        (lambda t: t.pop("clips"), "expected a time line as pgm export writes it"),
    ],
)
def test_a_damaged_time_line_gives_exit_4_and_writes_nothing(made, tmp_path, change, words, capsys):
    run(export, "colmap", made / "work", "--out", tmp_path / "out", "--every", 1)
    path = tmp_path / "out" / "pgm.json"
    timeline = json.loads(path.read_text())
    change(timeline)
    path.write_text(json.dumps(timeline))
    assert run(import_, "colmap", tmp_path / "out", "--out", tmp_path / "back") == 4
    assert words in capsys.readouterr().err
    assert not list(tmp_path.rglob("back/*/clip.json"))


def test_a_clip_none_of_whose_pictures_came_back_is_named_in_the_shots(made, tmp_path):
    run(export, "nerfstudio", made / "work", "--out", tmp_path / "out", "--every", 1)
    path = tmp_path / "out" / "transforms.json"
    content = json.loads(path.read_text())
    content["frames"] = [frame for frame in content["frames"] if "match.00" in frame["file_path"]]
    path.write_text(json.dumps(content))
    assert run(import_, "nerfstudio", path, "--out", tmp_path / "back") == 0
    shots = read_table(tmp_path / "back" / "shots.parquet")
    assert set(shots["clip_id"]) == {"", "match.00"}
    assert "no camera in the file that was imported" in set(shots["reason"])


def test_an_empty_work_folder_and_one_without_cameras_give_exit_4(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert run(export, "colmap", tmp_path / "empty", "--out", tmp_path / "a") == 4
    assert "no clip.json" in capsys.readouterr().err
    (tmp_path / "v.mp4").write_bytes(b"x")
    write_work(tmp_path / "w", [track("c", cameras(3), none=(0, 1, 2))], tmp_path / "v.mp4", video_frames=3)
    assert run(export, "nerfstudio", tmp_path / "w", "--out", tmp_path / "b") == 4
    assert "expected frames with a camera, got none among the 1 chosen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "option"),
    [(("--every", 0), "--every"), (("--videos", "nowhere"), "--videos")],
)
def test_bad_export_options_are_named(made, tmp_path, words, option):
    with pytest.raises(UsageError, match=f"{option}: expected"):
        run(export, "colmap", made / "work", "--out", tmp_path / "out", *words)


@pytest.mark.parametrize(
    ("words", "option"),
    [(("--fps", 0), "--fps"), (("--fps", "nan"), "--fps"), (("--scene", "chess"), "--scene")],
)
def test_bad_import_options_are_named(made, tmp_path, words, option):
    with pytest.raises(UsageError, match=f"{option}: expected"):
        run(import_, "colmap", made, "--out", tmp_path / "out", *words)
