"""The ball's three tables come back as they were written, and hold to the contract."""

import numpy as np
import pytest

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows, nearest_frames, read_clip_ball, write_clip_ball
from pgm_data.scene import load_scene

FRAMES = 12
TIMES = np.arange(FRAMES) / 25


def ball():
    rng = np.random.default_rng(0)
    root = rng.normal(0, 0.1, (FRAMES, 3, 3))
    placed = np.arange(FRAMES) >= 2
    position = np.where(placed[:, None], rng.uniform(0.5, 3, (FRAMES, 3)), np.nan)
    return ClipBall(
        clip_id="rally",
        video_frame=np.arange(FRAMES) + 100,
        timestamp=TIMES + 4,
        capture_time=TIMES + 4,
        pixel=np.where(placed[:, None], rng.uniform(0, 700, (FRAMES, 2)), np.nan),
        score=np.where(placed, 0.9, np.nan),
        position=position,
        velocity=position * 3,
        position_cov=np.where(placed[:, None, None], root @ np.swapaxes(root, 1, 2), np.nan),
        status=np.where(placed, "measured", "none").astype(object),
        events=EventRows(
            time=np.array([4.08, 4.08, 4.25, 4.44]),
            kind=np.array(["first", "hit", "bounce", "last"], dtype=object),
            player=np.array(["", "player0", "", ""], dtype=object),
            probability=np.array([1.0, 1.0, 0.8, 0.9]),
            source=np.array(["human", "human", "detected", "detected"], dtype=object),
            position=rng.uniform(0.1, 2, (4, 3)),
        ),
        shots=ShotRows(
            start_event=np.array([1, 2]),
            end_event=np.array([2, 3]),
            player=np.array(["player0", ""], dtype=object),
            start_speed=np.array([31.0, 20.0]),
            spin=np.array([[100.0, 0, 0], [np.nan] * 3]),
            spin_std=np.array([[50.0, 40, 60], [np.nan] * 3]),
            drag_per_m=np.full(2, 0.02),
            drag_std_per_m=np.full(2, 0.002),
            landing_position=np.array([[1.0, 5, 0.03], [np.nan] * 3]),
            in_probability=np.array([0.7, np.nan]),
            free_parameters=np.array(["position velocity spin", "position"], dtype=object),
            residual_px=np.array([0.8, np.nan]),
            status=np.array(["solved", "line: too few frames"], dtype=object),
        ),
    )


def test_what_is_written_is_read(tmp_path):
    folder = tmp_path / "rally"
    folder.mkdir()
    written = ball()
    write_clip_ball(folder, written, scene=load_scene("tennis"))
    read = read_clip_ball(folder, written.capture_time)
    assert read.clip_id == "rally"
    for name in ("video_frame", "timestamp", "position", "velocity", "position_cov"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    np.testing.assert_allclose(read.pixel, written.pixel, rtol=1e-6)
    assert list(read.status) == list(written.status)
    for part in ("events", "shots"):
        for name in type(getattr(read, part)).__dataclass_fields__:
            np.testing.assert_array_equal(getattr(getattr(read, part), name), getattr(getattr(written, part), name))


def test_the_three_tables_alone_hold_to_the_contract(tmp_path):
    write_clip_ball(tmp_path, ball(), scene=load_scene("tennis"))
    found = [str(v) for v in check_paths([tmp_path])]
    assert found and all("run.json" in line for line in found)


def test_a_table_of_another_length_than_the_clip_is_refused(tmp_path):
    write_clip_ball(tmp_path, ball(), scene=load_scene("tennis"))
    with pytest.raises(ValueError, match=r"ball\.parquet: expected 3 rows, as the clip has, got 12"):
        read_clip_ball(tmp_path, np.arange(3.0))


def test_the_nearest_frame_of_a_repeat_is_its_source():
    captured = np.array([0.0, 0.04, 0.04, 0.08])
    assert nearest_frames(np.array([-1.0, 0.05, 0.061, 9.0]), captured).tolist() == [0, 1, 3, 3]
