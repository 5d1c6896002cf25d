"""Frames of datasets and work folders: their pictures, cameras, states and boxes belong together."""

import json
import pickle
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.dataset.pack import pack_work_folders
from pgm_data.dataset.pack_plan import PackOptions
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene
from pgm_data.stages.encode_video import encode_video
from pgm_data.video import write_video
from pgm_models.synthesis.frame_rows import Clip
from pgm_models.synthesis.frames import FrameStore, frames_of_work, held_out, read_frames
from pgm_models.synthesis.object_boxes import boxes_px, scaled_K, scaled_pixels, whole_picture
from pgm_models.synthesis.picture_shelf import OPEN_VIDEOS, PictureShelf, picture_size
from tests.models.synthesis.drawn_matches import (
    FRAMES,
    LATER,
    SHUTTER_S,
    SIZE,
    UI_BOXES,
    colours,
    draw_video,
    drawn,
    drawn_matches,
    packed,
)


@pytest.fixture(scope="module")
def tennis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = drawn_matches(tmp_path_factory.mktemp("tennis"))
    packed(out)
    return out


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_matches(tmp_path_factory.mktemp("blocks"), "blocks", matches=1, frames=12)


def table_of(folder: Path, name: str) -> dict[str, np.ndarray]:
    """Columns of a clip's table, read without the code under test."""
    table = pq.read_table(folder / f"{name}.parquet")
    return {key: np.array(table.column(key).to_pylist()) for key in table.column_names}


def change_rows(folder: Path, name: str, change) -> None:
    """Change a clip's table, row by row."""
    table = pq.read_table(folder / f"{name}.parquet")
    rows = table.to_pylist()
    for number, row in enumerate(rows):
        change(number, row)
    columns = {key: [row[key] for row in rows] for key in table.column_names}
    pq.write_table(type(table).from_pydict(columns, schema=table.schema), folder / f"{name}.parquet")


def one_match(tennis: Path, out: Path) -> Path:
    """A copy of the first match's work folder and video; the clip's folder."""
    shutil.copytree(tennis / "work" / "match0", out / "work" / "match0")
    (out / "videos").mkdir()
    shutil.copy(tennis / "videos" / "match0.mp4", out / "videos")
    return out / "work" / "match0"


def is_picture_of(store: FrameStore, row: int, number: int) -> bool:
    """Whether a frame's picture is that of the drawn frame with the number."""
    x, y = np.meshgrid(np.arange(store.size[0]), np.arange(store.size[1]))
    off = store.rgb(row) - colours(x, y, number, store.size)
    # Frames differ by 5 in green; conversion and coding by less.
    return bool(np.abs(off).max() < 9 and (np.abs(off.mean(axis=(0, 1))) < 2.4).all())


def test_every_frame_with_a_camera_has_its_own_picture(tennis: Path) -> None:
    store = read_frames(tennis / "dataset")
    assert len(store) == 2 * FRAMES and store.size == SIZE
    assert store.matches == ("match0", "match1")
    np.testing.assert_array_equal(store.frame, np.tile(np.arange(FRAMES), 2))
    np.testing.assert_array_equal(store.clip, np.repeat([0, 1], FRAMES))
    np.testing.assert_allclose(store.time, np.tile(np.arange(FRAMES) / 25, 2), atol=1e-9)
    for row in np.random.default_rng(0).permutation(2 * FRAMES)[:30].tolist():
        assert is_picture_of(store, row, int(store.video_frame[row]) + LATER * int(store.clip[row]))
    picture = store.picture(50)
    assert picture.shape == (3, SIZE[1], SIZE[0]) and picture.dtype == torch.float32
    np.testing.assert_allclose(picture.permute(1, 2, 0).numpy() * 255, store.rgb(50), atol=1e-4)
    store.check_videos()


def test_a_work_folder_gives_what_its_dataset_gives(tennis: Path) -> None:
    data, work = read_frames(tennis / "dataset"), frames_of_work(tennis / "work")
    for name in ("clip", "frame", "time", "video_frame", "identity", "ball_position", "ball_path", "boxes_px"):
        np.testing.assert_array_equal(getattr(data, name), getattr(work, name))
    np.testing.assert_allclose(data.video_time, work.video_time, atol=1e-6)
    for name in ("K", "distortion", "R_cam_from_world", "t_cam_from_world"):
        np.testing.assert_array_equal(getattr(data.cameras, name), getattr(work.cameras, name))
    for name in ("player0", "player1"):
        np.testing.assert_array_equal(data.rotations[name], work.rotations[name])
    assert (data.rgb(60) == work.rgb(60)).all()
    one = frames_of_work(tennis / "work" / "match1")
    assert one.matches == ("match1",) and len(one) == FRAMES


@pytest.mark.parametrize("limit", [(96, 500), (500, 54), (64, 64), (1000, 1000)])
def test_smaller_pictures_have_cameras_and_boxes_to_match(tennis: Path, limit: tuple[int, int]) -> None:
    full, small = read_frames(tennis / "dataset"), read_frames(tennis / "dataset", picture=limit)
    scale = min(limit[0] / SIZE[0], limit[1] / SIZE[1], 1.0)
    assert small.size == (round(SIZE[0] * scale), round(SIZE[1] * scale))
    factor = np.array(small.size) / SIZE
    points = np.random.default_rng(1).uniform([-5, -10, 0], [5, 10, 3], (30, 3))
    before, after = project(full.cameras[7], points)[0], project(small.cameras[7], points)[0]
    np.testing.assert_allclose(after, (before + 0.5) * factor - 0.5, atol=1e-9)
    expected = (full.boxes_px.reshape(-1, 2) + 0.5) * factor - 0.5
    np.testing.assert_allclose(small.boxes_px.reshape(-1, 2), expected, atol=1e-3)
    ui = full.ui_boxes_px(50)
    np.testing.assert_allclose(ui, UI_BOXES[1])
    np.testing.assert_allclose(small.ui_boxes_px(50), (ui + 0.5) * np.tile(factor, 2) - 0.5)
    assert is_picture_of(small, 13, 13)


def test_states_are_those_of_the_tables(tennis: Path) -> None:
    store = read_frames(tennis / "dataset")
    rows = [70, 2, 30]
    states = store.states(rows)
    folders = [tennis / "work" / clip.clip_id for clip in store.clips]
    players = [table_of(folder, "players") for folder in folders]
    balls = [table_of(folder, "ball") for folder in folders]
    for place, row in enumerate(rows):
        clip, frame = int(store.clip[row]), int(store.frame[row])
        for name in ("player0", "player1"):
            joints = players[clip][f"{name}.joints"][frame].reshape(-1, 3)
            np.testing.assert_allclose(states.poses[name].joints[place], joints, atol=1e-4)
            person = players[clip][f"{name}.identity"][frame]
            number = ["player0", "player1"].index(name)
            assert store.identities[store.identity[row, number]] == person
        assert states.balls is not None
        np.testing.assert_allclose(states.balls.position[place], balls[clip]["ball.position"][frame], atol=1e-5)
        velocity = balls[clip]["ball.velocity"][frame].astype(float)
        np.testing.assert_allclose(states.balls.path[place], SHUTTER_S * velocity, atol=1e-5)
    assert store.shutter_known.all() and states.balls.radius == pytest.approx(0.0335)


def test_boxes_lie_about_what_they_are_of(tennis: Path) -> None:
    folder = tennis / "work" / "match0"
    store = frames_of_work(folder)
    players, ball = table_of(folder, "players"), table_of(folder, "ball")
    names = [thing.name for thing in store.scene.objects]
    own = store.boxes_px[:, names.index("ball")]
    assert np.abs(0.5 * (own[:, :2] + own[:, 2:]) - ball["ball.pixel"]).max() < 0.2
    # As high as the ball and what it flies up meanwhile, as wide as the ball and what it flies aside.
    depth = (store.cameras.R_cam_from_world[:, 2] * store.ball_position).sum(axis=1) + store.cameras.t_cam_from_world[
        :, 2
    ]
    least = 330 * 2 * 0.0335 / depth
    assert (own[:, 2:] - own[:, :2] > 0.95 * least[:, None]).all()
    assert (own[:, 2:] - own[:, :2] < least[:, None] + 330 * SHUTTER_S * 20 / depth[:, None]).all()
    for name in ("player0", "player1"):
        own = store.boxes_px[:, names.index(name)]
        joints = players[f"{name}.joints"].reshape(FRAMES, -1, 3)
        pixels = np.stack([project(store.cameras[row], joints[row])[0] for row in range(FRAMES)])
        low, high = pixels.min(axis=1), pixels.max(axis=1)
        assert (own[:, :2] < low).all() and (own[:, 2:] > high).all()
        assert (own[:, 2:] - own[:, :2] < high - low + 330 * 1.2 / 20).all()
    corners = np.array(list(product(*np.array(store.scene.objects[names.index("net")].region_m).T)))
    pixels = np.stack([project(store.cameras[row], corners)[0] for row in range(FRAMES)])
    expected = np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)
    np.testing.assert_allclose(store.boxes_px[:, names.index("net")], expected, atol=1e-3)
    for name in ("court", "backplate"):
        np.testing.assert_array_equal(
            store.boxes_px[:, names.index(name)], np.tile(np.float32(whole_picture(SIZE)), (FRAMES, 1))
        )


def test_what_is_absent_is_nan(tennis: Path, tmp_path: Path) -> None:
    folder = one_match(tennis, tmp_path)

    def lose_player(number: int, row: dict) -> None:
        if number == 3:
            row["player1.status"] = "none"
            row["player1.identity"] = ""
            for name in ("joint_rotations", "joint_translations", "joints", "root_rotation", "root_position"):
                row[f"player1.{name}"] = [np.nan] * len(row[f"player1.{name}"])
        if number == 4:  # a person without a pose
            row["player0.joint_rotations"] = [np.nan] * 72
            row["player0.joint_translations"] = [np.nan] * 72
            row["player0.root_rotation"] = [np.nan] * 3

    def lose_ball(number: int, row: dict) -> None:
        if number == 5:
            row["ball.status"] = "none"
            row["ball.position"] = row["ball.velocity"] = [np.nan] * 3

    def lose_camera(number: int, row: dict) -> None:
        if number in (0, 9):
            row["camera.status"] = "none"
            for name, size in (("K", 9), ("distortion", 4), ("R_cam_from_world", 9), ("t_cam_from_world", 3)):
                row[f"camera.{name}"] = [np.nan] * size

    change_rows(folder, "players", lose_player)
    change_rows(folder, "ball", lose_ball)
    change_rows(folder, "camera", lose_camera)
    document = json.loads((folder / "clip.json").read_text()) | {"shutter_s": None, "ui_boxes_px": []}
    (folder / "clip.json").write_text(json.dumps(document))
    store = frames_of_work(tmp_path / "work")
    assert store.frame.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, *range(10, FRAMES)]
    assert is_picture_of(store, 10, 12)
    states = store.states([1, 2, 3, 4])
    assert states.poses["player1"].present.tolist() == [True, False, True, True]
    assert states.poses["player0"].present.tolist() == [True, True, False, True]
    assert states.balls is not None and states.balls.present.tolist()[3] is False
    seen = ~np.isnan(store.boxes_px[1:5, :3]).any(axis=2)
    assert seen[:, :2].tolist() == [[True, True], [True, False], [False, True], [True, True]] and not seen[3, 2]
    assert store.identity[2, 1] == -1 and store.identity[1, 1] >= 0
    assert not store.shutter_known.any() and (store.ball_path == 0).all()
    assert store.ui_boxes_px(0).shape == (0, 4)


def test_a_scene_without_a_ball_has_none(blocks: Path) -> None:
    store = frames_of_work(blocks / "work", picture=(96, 54))
    states = store.states(np.arange(3))
    assert states.balls is None and states.poses["player0"].present.all()
    assert [thing.name for thing in store.scene.objects] == ["player0", "world", "sky"]
    np.testing.assert_allclose(store.boxes_px[:, 2], np.tile(whole_picture((96, 54)), (len(store), 1)))
    assert np.isfinite(store.boxes_px[:, 1]).all() and np.isnan(store.ball_position).all()
    assert store.shutter_known.all() and (store.ball_path == 0).all()


def test_some_frames_are_a_store_too(tennis: Path) -> None:
    store = read_frames(tennis / "dataset")
    for rows in (np.array([70, 3, 44]), np.arange(2 * FRAMES) % 7 == 2, slice(30, 60)):
        some = store[rows]
        numbers = np.arange(2 * FRAMES)[rows]
        assert len(some) == len(numbers) and some.place(1) == store.place(int(numbers[1]))
        np.testing.assert_array_equal(some.cameras.K, store.cameras.K[rows])
        assert (some.rgb(1) == store.rgb(int(numbers[1]))).all()
    np.testing.assert_array_equal(store.clip_rows("match1"), np.arange(FRAMES, 2 * FRAMES))
    with pytest.raises(ValueError, match="clip: expected one with cameras among match0, match1, got 'x'"):
        store.clip_rows("x")


def test_pictures_are_kept_up_to_a_bound(tennis: Path) -> None:
    nbytes = 3 * SIZE[0] * SIZE[1]
    store = read_frames(tennis / "dataset", cache_bytes=10 * nbytes)
    for row in np.random.default_rng(2).integers(0, 2 * FRAMES, 25).tolist():
        store.rgb(row)
        assert store.shelf.cache.used_bytes <= 10 * nbytes
        assert store.kept(row)
    roomy = read_frames(tennis / "dataset")
    rows = np.array([50, 4, 60, 4, 9])
    roomy.prepare(rows)
    assert all(roomy.kept(int(row)) for row in rows)
    again = pickle.loads(pickle.dumps(roomy))
    assert again.shelf.cache.limit_bytes == roomy.shelf.cache.limit_bytes and not again.kept(50)
    assert (again.rgb(50) == roomy.rgb(50)).all()


def test_only_a_few_files_are_open_at_once(tmp_path: Path) -> None:
    shelf = PictureShelf()
    paths = [draw_video(tmp_path / f"{number}.mp4", 1, match=number) for number in range(OPEN_VIDEOS + 3)]
    videos = [shelf.video(path) for path in paths]
    assert len(shelf._open) == OPEN_VIDEOS and shelf.video(paths[-1]) is videos[-1]
    assert np.abs(videos[0].picture(0).astype(float) - drawn(0)).max() < 9


def test_a_video_that_is_not_there_is_named(tennis: Path, tmp_path: Path) -> None:
    shutil.copytree(tennis / "dataset", tmp_path / "dataset")
    video = next((tmp_path / "dataset" / "videos").rglob("file-001.mp4"))
    video.unlink()
    store = read_frames(tmp_path / "dataset")
    assert is_picture_of(store, 3, 3)
    for ask in (lambda: store.rgb(50), store.check_videos):
        with pytest.raises(ValueError, match=rf"clip match1, frame \d+: picture: expected the video {video}"):
            ask()
    video.write_bytes(b"no video at all")
    with pytest.raises(ValueError, match=r"clip match1, frame 14: .*file-001\.mp4: expected a video"):
        read_frames(tmp_path / "dataset").rgb(50)
    pack_work_folders([tennis / "work"], tmp_path / "bare", PackOptions(videos="none"))
    with pytest.raises(ValueError, match="clip match0, frame 0: picture: expected a video in the dataset"):
        read_frames(tmp_path / "bare").rgb(0)


def test_a_truncated_video_is_read_as_far_as_it_goes(tennis: Path, tmp_path: Path) -> None:
    folder = one_match(tennis, tmp_path)
    video = tmp_path / "videos" / "match0.mp4"
    data = video.read_bytes()
    video.write_bytes(data[: len(data) * 7 // 10])
    store = frames_of_work(folder.parent)
    assert is_picture_of(store, 8, 8)
    with pytest.raises(ValueError, match=r"clip match0, frame 35: .*mp4: expected a frame at 1\.4"):
        store.rgb(35)
    told: list[str] = []
    with pytest.raises(ValueError, match=r"clip match0, frame \d+: .*expected a frame at"):
        store.check_videos(told.append)
    assert told == []


def test_a_video_of_another_size_is_scaled_and_of_another_shape_refused(tennis: Path, tmp_path: Path) -> None:
    folder = one_match(tennis, tmp_path)
    video = tmp_path / "videos" / "match0.mp4"
    draw_video(video, FRAMES, size=(96, 54))
    store = frames_of_work(folder.parent)
    assert store.size == SIZE and is_picture_of(store, 20, 20)
    draw_video(video, FRAMES, size=(288, 162))
    assert is_picture_of(frames_of_work(folder.parent, picture=(128, 72)), 21, 21)
    draw_video(video, FRAMES, size=(160, 120))
    with pytest.raises(ValueError, match="frame 20: .*expected pictures of 192x108, or of that shape.*found 160x120"):
        frames_of_work(folder.parent).rgb(20)


def test_encoded_at_another_rate_and_size_frames_keep_their_pictures(tennis: Path, tmp_path: Path) -> None:
    options = PackOptions(videos="encode", height=54, rate=25.1, crf=4)
    outcome = pack_work_folders([tennis / "work"], tmp_path / "dataset", options, encode=encode_video)
    assert not outcome.problems
    store = read_frames(tmp_path / "dataset", picture=(96, 96))
    store.check_videos()
    assert store.size == (96, 54)
    source = read_frames(tennis / "dataset", picture=(96, 96))
    for row in (0, 17, 35):
        # Coding twice takes light away, yet less than the 5 that lie between two frames.
        off = store.rgb(row).astype(float) - source.rgb(row)
        assert np.abs(off).max() < 9 and -4.5 < off[..., 1].mean() < 0


def test_frames_of_a_variable_rate_and_behind_lost_ones_are_found_by_time(tennis: Path, tmp_path: Path) -> None:
    folder = one_match(tennis, tmp_path)
    times = np.cumsum(np.random.default_rng(3).uniform(0.01, 0.1, FRAMES))
    write_video(tmp_path / "videos" / "match0.mp4", map(drawn, range(FRAMES)), timestamps=times.tolist(), crf=4)
    change_rows(folder, "camera", lambda number, row: row.update(timestamp=float(times[number])))
    store = frames_of_work(folder.parent)
    shifted = replace(store, video_frame=np.maximum(store.video_frame - 1, 0))
    for row in (30, 2, 35):
        assert is_picture_of(store, row, row) and is_picture_of(shifted, row, row)
    with pytest.raises(ValueError, match="clip match0, frame 7: .*expected a frame at"):
        replace(store, video_time=store.video_time + 0.005).rgb(7)


def test_one_frame_is_a_store(tmp_path: Path) -> None:
    store = read_frames(packed(drawn_matches(tmp_path, matches=1, frames=1)))
    assert len(store) == 1 and is_picture_of(store, 0, 0)
    assert not held_out(store).any()


def test_what_holds_no_frames_is_refused(tennis: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"{tmp_path}: expected clips of one scene, got no clip"):
        frames_of_work(tmp_path)
    folder = one_match(tennis, tmp_path)

    def lose_camera(number: int, row: dict) -> None:
        row["camera.status"] = "none"
        for name, size in (("K", 9), ("distortion", 4), ("R_cam_from_world", 9), ("t_cam_from_world", 3)):
            row[f"camera.{name}"] = [np.nan] * size

    change_rows(folder, "ball", lambda number, row: row.update({"ball.position": [np.nan] * 3}))
    with pytest.raises(ValueError, match=r"clip match0, frame 0: ball.position\[0\]: expected a finite number"):
        frames_of_work(tmp_path / "work")
    (folder / "ball.parquet").unlink()
    assert np.isnan(frames_of_work(tmp_path / "work").ball_position).all()
    change_rows(folder, "camera", lose_camera)
    with pytest.raises(ValueError, match="expected frames with a camera, got none in 1 clips"):
        frames_of_work(tmp_path / "work")


BLOCKS = load_scene("blocks")
CLIPS = st.lists(st.tuples(st.integers(0, 2), st.integers(1, 30)), min_size=1, max_size=7)


@settings(max_examples=25)
@given(clips=CLIPS, share=st.floats(0.01, 1.0))
def test_the_end_of_every_match_is_held_out(clips: list[tuple[int, int]], share: float) -> None:
    store = clips_alone(clips)
    held = held_out(store, share=share)
    matches = np.array(store.matches)[store.clip]
    for match in np.unique(matches):
        rows = np.flatnonzero(matches == match)
        own = held[rows]
        assert not own[0], "something is left to train on"
        assert (np.diff(own.astype(int)) >= 0).all(), "and it comes before what is held out"
        several = len(np.unique(store.clip[rows])) > 1
        last = store.clip[rows] == store.clip[rows[-1]]
        assert own[last].all() if several else True
        wanted = min(np.ceil(share * len(rows)), len(rows) - 1)
        assert own.sum() == (max(wanted, last.sum()) if several else wanted)


def clips_alone(clips: list[tuple[int, int]]) -> FrameStore:
    """A store of clips (match, frames), of whose frames nothing but the number is known."""
    clips = sorted(clips, key=lambda clip: clip[0])
    count = sum(frames for _, frames in clips)
    made = tuple(
        Clip(
            clip_id=f"{match}.{number}", match_id=f"m{match}", video=Path(f"{match}.mp4"), no_video="", width=64,
            height=36, frames=frames, shutter_s=0.01, ui_boxes_px=np.zeros((0, 4)),
        )
        for number, (match, frames) in enumerate(clips)
    )  # fmt: skip
    started: dict[int, int] = {}
    video_frame = []
    for match, frames in clips:
        first = started.get(match, 0)
        video_frame.append(np.arange(first, first + frames))
        started[match] = first + frames
    nothing = np.full((count, 3), np.nan)
    return FrameStore(
        scene=BLOCKS, size=(64, 36), clips=made, identities=(), cameras=Camera(
            K=np.full((count, 3, 3), np.nan), distortion=np.full((count, 4), np.nan),
            R_cam_from_world=np.full((count, 3, 3), np.nan), t_cam_from_world=nothing,
        ),
        clip=np.repeat(np.arange(len(clips)), [frames for _, frames in clips]),
        frame=np.concatenate([np.arange(frames) for _, frames in clips]), time=np.arange(count) / 25,
        video_frame=np.concatenate(video_frame), video_time=np.arange(count) / 25,
        rotations={}, translations={},
        identity=np.full((count, 1), -1), ball_position=nothing, ball_path=nothing,
        boxes_px=np.full((count, 3, 4), np.nan), shelf=PictureShelf(0),
    )  # fmt: skip


def test_the_share_held_out_is_one() -> None:
    store = clips_alone([(0, 10)])
    assert not held_out(store, share=0.0).any() and held_out(store, share=1.0).sum() == 9
    with pytest.raises(ValueError, match="share: expected 0 to 1, got 1.5"):
        held_out(store, share=1.5)


def test_pictures_have_the_commonest_shape() -> None:
    assert picture_size([(1920, 1080, 10), (640, 480, 11), (1920, 1080, 2)], None) == (1920, 1080)
    assert picture_size([(1920, 1080, 10)], (512, 512)) == (512, 288)
    assert picture_size([(640, 480, 1)], (512, 288)) == (384, 288)
    assert picture_size([(100, 1, 1)], (10, 10)) == (10, 1)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), width=st.integers(1, 4000), factor=st.floats(0.05, 4.0))
def test_scaling_a_camera_moves_its_pixels_edges_onto_edges(seed: int, width: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    K = np.array([[900.0, 0.3, 300], [0, 950, 200], [0, 0, 1]])
    both = np.array([factor, factor * rng.uniform(0.5, 2)])
    points = rng.normal(size=(5, 3)) + [0, 0, 6]
    direct, scaled = (k @ points.T for k in (K, scaled_K(K, both)))
    np.testing.assert_allclose(scaled_pixels((direct[:2] / direct[2]).T, both), (scaled[:2] / scaled[2]).T, atol=1e-8)
    edges = np.array([[-0.5, -0.5], [width - 0.5, width - 0.5]])
    np.testing.assert_allclose(scaled_pixels(edges, both), [[-0.5, -0.5], both * width - 0.5], atol=1e-6)


def camera_at(position: np.ndarray) -> Camera:
    """One that looks along y."""
    R = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    return Camera(
        K=np.array([[[100.0, 0, 31.5], [0, 100, 23.5], [0, 0, 1]]]), distortion=np.zeros((1, 4)),
        R_cam_from_world=R[None], t_cam_from_world=-(R @ position)[None],
    )  # fmt: skip


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6))
def test_a_box_in_pixels_spans_what_is_in_the_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform([-3, 2, -2], [3, 9, 2])
    high = low + rng.uniform(0, 2, 3)
    camera = camera_at(np.zeros(3))
    points = np.concatenate(
        [low + rng.random((200, 3)) * (high - low), np.array(list(product(*zip(low, high, strict=True))))]
    )
    pixels, _ = project(camera[0], points)
    (found,) = boxes_px(camera, low[None], high[None], (64, 48))
    spanned = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    whole = whole_picture((64, 48))
    if (spanned[:2] < whole[2:]).all() and (spanned[2:] > whole[:2]).all():
        np.testing.assert_allclose(found, spanned, atol=1e-9)
    else:
        assert np.isnan(found).all()


@pytest.mark.parametrize(
    ("low", "high", "seen"),
    [
        ((-1, -1, -1), (1, 1, 1), "whole"),
        ((-1, -3, -1), (1, -2, 1), "none"),
        ((-1, -3, -1), (1, 3, 1), "whole"),
        ((50, 2, -1), (51, 3, 1), "none"),
        ((np.nan, 2, 2), (3, 3, 3), "none"),
        ((-0.1, 2, -0.1), (-0.1, 2, -0.1), "point"),
    ],
)
def test_boxes_at_the_edge_of_sight(low: tuple, high: tuple, seen: str) -> None:
    (found,) = boxes_px(camera_at(np.zeros(3)), np.array([low], float), np.array([high], float), (64, 48))
    if seen == "whole":
        np.testing.assert_array_equal(found, whole_picture((64, 48)))
    elif seen == "point":
        np.testing.assert_allclose(found, [26.5, 28.5, 26.5, 28.5])
    else:
        assert np.isnan(found).all()
