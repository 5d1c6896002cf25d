import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from pgm_data.convert.track_camera import read_track_camera
from pgm_data.dataset.clip_camera import ClipCamera, write_clip_camera
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene

K = [[1500.0, 0, 640], [0, 1500, 360], [0, 0, 1]]
R = [[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]
DOCUMENT = {
    "width": 1280,
    "height": 720,
    "K": np.ravel(K).tolist(),
    "distortion": [0.0] * 4,
    "R_cam_from_world": np.ravel(R).tolist(),
    "t_cam_from_world": [0.0, 5.0, 30.0],
}


def written(tmp_path, **changes):
    path = tmp_path / "CAMERA.json"
    path.write_text(json.dumps({**DOCUMENT, **changes}))
    return path


def clip_camera(folder, status=("measured", "interpolated", "none")):
    folder.mkdir()
    rows = len(status)
    has = np.array([word != "none" for word in status])

    def per_frame(values):
        return np.where(has.reshape(-1, *[1] * np.ndim(values)), np.array(values, dtype=float), np.nan)

    track = ClipCamera(
        clip_id=folder.name,
        video_frame=np.arange(40, 40 + rows),
        timestamp=np.arange(rows) / 30 + 1,
        is_duplicate=np.arange(rows) == 1,
        capture_time=np.array([1.0, 1.0, 1.08])[:rows],
        camera=Camera(
            K=per_frame(K),
            distortion=per_frame(np.zeros(4)),
            R_cam_from_world=per_frame(R),
            t_cam_from_world=per_frame([0, 5, 30]),
        ),
        status=np.array(status, dtype=object),
        reason=np.array([""] * rows, dtype=object),
        inliers=np.full(rows, 9),
        reprojection_px=np.full(rows, 0.5),
        position_cov=np.full((rows, 6), 0.01),
        focal_std_px=np.full(rows, 3.0),
    )
    write_clip_camera(folder, track, scene=load_scene("tennis"))
    return folder / "camera.parquet"


def test_a_fixed_camera_stands_in_every_frame(tmp_path):
    found = read_track_camera(written(tmp_path), 5)
    assert found.camera.K.shape == (5, 3, 3) and found.size == (1280, 720) and found.clock is None
    pixels, _ = project(found.camera, np.zeros((1, 3)))
    np.testing.assert_allclose(pixels, np.broadcast_to([640, 360 + 1500 * 5 / 30], (5, 1, 2)))
    assert set(found.status) == {"measured"} and np.isnan(found.position_cov).all()


def test_a_clip_gives_its_cameras_and_its_clock_whatever_its_folder_is_called(tmp_path):
    path = clip_camera(tmp_path / "rally.00")
    moved = tmp_path / "moved.parquet"
    moved.write_bytes(path.read_bytes())
    for where in (path, moved):
        found = read_track_camera(where, 99)
        assert np.isfinite(found.camera.K[:, 0, 0]).tolist() == [True, True, False]
        assert found.clock.video_frame.tolist() == [40, 41, 42] and found.clock.is_duplicate.tolist() == [0, 1, 0]
        assert found.clock.capture_time.tolist() == [1.0, 1.0, 1.08]
        assert found.focal_std_px.tolist() == [3.0] * 3 and found.size is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"K": [1.0] * 8}, "K: expected at least 9 items|K: expected 9 items"),
        ({"K": np.eye(3).ravel().tolist()[:8] + [2.0]}, "K: expected zeros below its diagonal"),
        ({"K": [-1500.0, *np.ravel(K).tolist()[1:]]}, "K: expected positive focal lengths"),
        ({"R_cam_from_world": np.diag([1.0, 1, -1]).ravel().tolist()}, "R_cam_from_world: expected rotations"),
        ({"R_cam_from_world": [1.0, 0, 0, 1e308, 1, 0, 0, 0, 1]}, "R_cam_from_world: expected rotations"),
        ({"width": 0}, "width: expected at least 1"),
        ({"height": "720"}, "height: expected integer"),
        ({"t_cam_from_world": None}, "t_cam_from_world: expected"),
        ({"extra": 1}, "extra: expected one of the fields"),
    ],
)
def test_a_bad_fixed_camera_is_refused_by_file_and_field(tmp_path, changes, said):
    with pytest.raises(ValueError, match=f"CAMERA.json: .*({said})"):
        read_track_camera(written(tmp_path, **changes), 5)


def test_a_camera_of_no_frame_no_file_or_no_known_kind_is_refused(tmp_path):
    with pytest.raises(ValueError, match="frames: expected at least one, got 0"):
        read_track_camera(written(tmp_path), 0)
    for name in ("absent.json", "absent.parquet", "camera.npz"):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            read_track_camera(tmp_path / name, 5)
    (tmp_path / "half.json").write_text(json.dumps(DOCUMENT)[:60])
    (tmp_path / "half.parquet").write_bytes(b"PAR1")
    for name in ("half.json", "half.parquet"):
        with pytest.raises(ValueError, match=f"{name}: expected"):
            read_track_camera(tmp_path / name, 5)


def test_a_table_without_its_columns_or_with_two_clips_is_refused(tmp_path):
    path = clip_camera(tmp_path / "rally")
    table = pq.read_table(path)
    renamed = table.rename_columns([name.replace("camera.K", "camera.k") for name in table.column_names])
    swapped = table.set_column(table.column_names.index("frame.capture_time"), "frame.capture_time", [[3.0, 2.0, 1.0]])
    named = table.set_column(0, "clip_id", [["a", "a", "b"]])
    for wrong, said in (
        (renamed, "camera.K: expected the column"),
        (swapped, "capture_time: expected finite times that never fall"),
        (named, "clip_id: expected the frames of one clip, got a, b"),
        (table.slice(0, 0), "clip_id: expected the frames of one clip, got none"),
    ):
        pq.write_table(wrong, tmp_path / "wrong.parquet")
        with pytest.raises(ValueError, match=f"wrong.parquet: {said}"):
            read_track_camera(tmp_path / "wrong.parquet", 3)
