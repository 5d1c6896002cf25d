import numpy as np
import pytest

from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from pgm_models.detectors.clip_pictures import GrowingClips, find_clips, find_video
from pgm_models.detectors.court_frames import court_pixels, divide, prepare_clip

SCENE = load_scene("tennis")


def test_a_clip_is_prepared_once_with_its_own_frames_and_its_courts_pixels(dataset, tmp_path):
    (folder,) = find_clips(dataset)
    video = find_video(folder, dataset)
    clip = prepare_clip(folder, video, tmp_path / "cache", SCENE.court)
    assert [round(float(clip.frame(k).bgr.mean()) / 20) for k in range(len(clip))] == [3, 4, 5, 6]
    assert [clip.frame(k).has_court for k in range(4)] == [True, True, True, False]
    camera = Camera(
        K=np.array([[150.0, 0, 79.5], [0, 150, 47.5], [0, 0, 1]]),
        distortion=np.array([0.01, 0, 0, 0]),
        R_cam_from_world=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
        t_cam_from_world=np.array([0.0, 6.0, 30.0]),
    )
    expected, _ = project(camera, SCENE.court.all_world)
    np.testing.assert_allclose(clip.frame(1).points_px, expected, atol=1e-3)
    video.unlink()
    again = prepare_clip(folder, video, tmp_path / "cache", SCENE.court)
    np.testing.assert_array_equal(again.frame(2).bgr, clip.frame(2).bgr)


def test_line_samples_run_from_end_to_end(dataset, tmp_path):
    (folder,) = find_clips(dataset)
    clip = prepare_clip(folder, find_video(folder, dataset), tmp_path / "cache", SCENE.court)
    frame = clip.frame(0)
    ends = frame.lines_px[:, [0, -1]]
    np.testing.assert_allclose(ends, frame.points_px[SCENE.court.line_ends], atol=1e-3)


def test_frames_without_camera_have_no_pixels():
    lost = Camera(
        K=np.full((2, 3, 3), np.nan),
        distortion=np.full((2, 4), np.nan),
        R_cam_from_world=np.full((2, 3, 3), np.nan),
        t_cam_from_world=np.full((2, 3), np.nan),
    )
    points, lines = court_pixels(SCENE.court, lost)
    assert np.isnan(points).all() and np.isnan(lines).all()
    assert points.shape == (2, 17, 2) and lines.shape[:2] == (2, 9)


def test_held_out_frames_are_never_trained_on(toy_frames):
    frames = divide([toy_frames(120).clips[0]] * 2)
    train, out = ({tuple(pair) for pair in pairs.tolist()} for pairs in (frames.training, frames.held_out))
    assert not train & out
    assert len(train | out) == 240
    assert len(out) == 4


def test_a_lost_video_is_named(dataset):
    (folder,) = find_clips(dataset)
    find_video(folder, dataset).unlink()
    with pytest.raises(ValueError, match=r"source_path: expected a video, found none at .*mix\.mp4"):
        find_video(folder, dataset)


def growing_clips(dataset, cache, *, growing, show):
    def prepare(folder, video):
        return prepare_clip(folder, video, cache, SCENE.court)

    return GrowingClips((dataset,), (), prepare, divide, growing=growing, show=show)


def test_a_growing_dataset_waits_for_what_is_not_whole_and_a_finished_one_does_not(dataset, tmp_path):
    said = []
    broken = dataset / "work" / "later"
    broken.mkdir()
    for name in ("clip.json", "camera.parquet"):
        (broken / name).write_bytes((dataset / "work" / "mix" / name).read_bytes())
    frames = growing_clips(dataset, tmp_path / "a", growing=True, show=said.append)
    assert len(frames().training) == 4
    assert any("not yet usable" in line and "later" in line for line in said)
    with pytest.raises(ValueError, match="later"):
        growing_clips(dataset, tmp_path / "b", growing=False, show=said.append)


def test_a_folder_without_clips_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected clip folders"):
        growing_clips(tmp_path, tmp_path / "cache", growing=False, show=print)
