"""`pgm-calibrate` on good, bad and odd input: the exit code, the table, and a work folder that `pgm check` passes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from pgm_cli import main

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import Camera
from pgm_data.scene import load_scene
from pgm_data.simulate.camera import CameraTrack
from pgm_data.simulate.clip import SimulatedClip, simulate_clip
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.video import open_video, write_video

COMMAND = "import sys; from pgm_cli.main import pgm_calibrate; sys.argv[0] = 'pgm-calibrate'; pgm_calibrate()"
BAR = 390
"""Height of the black bars that make a picture portrait."""


@pytest.fixture(scope="module")
def court() -> SimulatedClip:
    """Four frames of a court before a still camera."""
    return simulate_clip(load_scene("tennis"), ClipOptions(frames=4, width=640, height=360, motion="still"), seed=3)


@pytest.fixture(scope="module")
def pictures(court: SimulatedClip) -> list[np.ndarray]:
    return list(court.frames())


@pytest.fixture
def good(tmp_path: Path, pictures: list[np.ndarray]) -> Path:
    """A video of a court, alone in its folder."""
    (tmp_path / "videos").mkdir()
    write_video(tmp_path / "videos" / "good.mp4", pictures, fps=25)
    return tmp_path / "videos" / "good.mp4"


@pytest.fixture(autouse=True)
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the command sets in its own process ends with the test."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")


def crowd(frames: int) -> list[np.ndarray]:
    """Coarse noise that moves."""
    blocks = np.random.default_rng(0).integers(0, 255, (36, 64, 3), dtype=np.uint8)
    picture = cv2.resize(blocks, (640, 360))
    return [np.roll(picture, i, axis=1) for i in range(frames)]


def calibrate(*arguments: object, overlay: bool = False) -> int:
    words = [str(argument) for argument in arguments] + ([] if overlay else ["--no-overlay"])
    return main.run_verb("calibrate", words)


def cut_short(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])


@pytest.fixture(scope="module")
def odd_run(tmp_path_factory: pytest.TempPathFactory, pictures: list[np.ndarray]) -> tuple[int, dict[str, dict], Path]:
    """One run over a folder of every odd input: its exit code, what its JSON says of each file, its work folder."""
    root = tmp_path_factory.mktemp("odd")
    folder = root / "in" / "deeper"
    folder.mkdir(parents=True)
    write_video(folder / "good.mp4", pictures, fps=25)
    write_video(folder / "one.mp4", pictures[:1], fps=25)
    write_video(folder / "uneven.mp4", pictures, timestamps=[0.0, 0.04, 0.3, 0.31])
    cv2.imwrite(str(folder / "still.png"), pictures[0])
    bars = [cv2.copyMakeBorder(picture, BAR, BAR, 0, 0, cv2.BORDER_CONSTANT) for picture in pictures]
    write_video(folder / "portrait.mp4", bars, fps=25)
    large = cv2.resize(pictures[0], (3840, 2160), interpolation=cv2.INTER_CUBIC)
    write_video(folder / "large.mp4", [large], fps=25)
    write_video(folder / "crowd.mp4", crowd(4), fps=25)
    write_video(folder / "cut.mp4", pictures, fps=25, gop=1)
    cut_short(folder / "cut.mp4", 0.7)
    (folder / "text.mp4").write_text("a letter")
    (folder / "notes.txt").write_text("mine")
    words = [str(root / "in"), "--out", str(root / "work"), "--no-overlay", "--json", "--quiet", "--workers", "1"]
    done = subprocess.run([sys.executable, "-c", COMMAND, *words], stdout=subprocess.PIPE, text=True, check=False)
    document = json.loads(done.stdout)
    return done.returncode, {Path(row["path"]).name: row for row in document["videos"]}, root / "work"


def test_bad_and_odd_inputs_each_get_their_verdict_and_none_stops_the_others(
    odd_run: tuple[int, dict[str, dict], Path],
) -> None:
    code, rows, work = odd_run
    assert code == 3
    states = {name: (row["state"], row["frames"], row["measured"]) for name, row in rows.items()}
    cut = states.pop("cut.mp4")
    assert states == {
        "good.mp4": ("ok", 4, 4),
        "one.mp4": ("ok", 1, 1),
        "uneven.mp4": ("ok", 4, 4),
        "still.png": ("ok", 1, 1),
        "portrait.mp4": ("ok", 4, 4),
        "large.mp4": ("ok", 1, 1),
        "crowd.mp4": ("no court", 4, 0),
        "text.mp4": ("failed", 0, 0),
    }
    assert cut[0] == "degraded" and 1 <= cut[1] < 4 and cut[2] == cut[1]
    assert rows["text.mp4"]["reason"].startswith("expected a video, found 8 bytes")
    assert check_paths([work]) == []


def test_every_decoded_frame_of_every_video_stands_once_in_the_shots_with_its_reason(
    odd_run: tuple[int, dict[str, dict], Path],
) -> None:
    _, rows, work = odd_run
    shots = read_table(work / "shots.parquet")
    names = np.array([Path(video).name for video in shots["video"]])
    assert {name: int((names == name).sum()) for name in rows} == {name: row["frames"] for name, row in rows.items()}
    assert set(shots["reason"][names == "crowd.mp4"]) == {"no court found"}
    assert shots["timestamp"][names == "uneven.mp4"] == pytest.approx([0.0, 0.04, 0.3, 0.31], abs=1e-4)


def test_what_was_ignored_stands_in_the_run_and_in_the_report(odd_run: tuple[int, dict[str, dict], Path]) -> None:
    _, _, work = odd_run
    inputs = read_document(work / "run.json", "run")["inputs"]
    assert [entry for entry in inputs if entry["state"] == "ignored"] == [
        {
            "path": "../in/deeper/notes.txt",
            "state": "ignored",
            "reason": ".txt is not a video or a picture",
            "clips": [],
            "seconds": None,
        }
    ]
    report = (work / "report.html").read_text()
    assert "../in/deeper/notes.txt" in report and "../in/deeper/text.mp4" in report


@pytest.mark.parametrize(
    ("clip", "scale", "down", "size"),
    [("good", 1, 0, [640, 360]), ("portrait", 1, BAR, [640, 360 + 2 * BAR]), ("large", 6, 0, [3840, 2160])],
)
def test_cameras_are_the_true_ones_whatever_the_shape_of_the_picture(
    odd_run: tuple[int, dict[str, dict], Path], court: SimulatedClip, clip: str, scale: int, down: int, size: list[int]
) -> None:
    folder = odd_run[2] / clip
    document = read_document(folder / "clip.json", "clip")
    assert [document["width"], document["height"]] == size
    solved, true = read_clip_camera(folder).camera, court.track
    corners = np.array([[x, y, 0.0] for x in (-5.485, 5.485) for y in (-11.885, 11.885)])

    def seen(cameras: Camera | CameraTrack) -> np.ndarray:
        turn = cv2.Rodrigues(cameras.R_cam_from_world[0])[0]
        return cv2.projectPoints(corners, turn, cameras.t_cam_from_world[0], cameras.K[0], cameras.distortion[0])[0][
            :, 0
        ]

    expected = scale * (seen(true) + 0.5) - 0.5 + [0, down]
    assert np.linalg.norm(seen(solved) - expected, axis=1).max() < 0.4 * scale
    assert solved.K[0, 0, 0] == pytest.approx(scale * true.K[0, 0, 0], rel=0.03)


@pytest.mark.parametrize("name", ["empty", "text", "crowd"])
def test_nothing_usable_is_exit_4_with_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    folder, work = tmp_path / "in", tmp_path / "work"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    if name == "text":
        (folder / "text.mp4").write_text("a letter")
    if name == "crowd":
        write_video(folder / "crowd.mp4", crowd(2), fps=25)
    assert calibrate(folder, "--out", work, "--quiet") == 4
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and error.startswith("error: no video")
    if name == "empty":
        assert "1 other file" in error and not work.exists()
    else:
        assert check_paths([work]) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "VIDEO: expected at least one video or folder"),
        (["IN/missing.mp4"], "missing.mp4: expected a video, a picture or a folder, found nothing there"),
        (["IN", "--scene", "blocks"], "--scene: expected a scene with a court"),
        (["IN", "--scene", "chess"], "scene: expected one of"),
        (["IN", "--workers", "-1"], "--workers: expected 0 or more, got -1"),
        (["IN", "--keypoints", "none.csv"], "--keypoints: expected a CSV file"),
        (["IN", "--keypoints", "IN/marks.csv"], "marks.csv: video: expected one of the 1 inputs, got 'other.mp4'"),
        (["IN", "--network", "none.onnx"], "--network: expected an ONNX file"),
        (["IN", "--network", "IN/marks.csv"], "marks.csv: expected an ONNX file"),
        (["IN", "IN2"], "good.mp4; tell them apart with --clip-prefix"),
        (["IN", "--out", "IN/good.mp4"], "--out: expected a folder, got the file"),
        (["IN", "--out", "IN/good.mp4/work"], "--out: expected a folder that can be written"),
        (["IN", "--out", "IN"], "--out: expected a new or empty folder"),
        (["IN", "--resume", "--overwrite"], "--resume and --overwrite: expected one of them"),
        (["IN", "--cluster", "tcp://127.0.0.1:1"], "--cluster: expected a Dask scheduler that answers"),
    ],
)
def test_a_call_that_cannot_work_is_exit_2_and_one_clear_line(
    tmp_path: Path, good: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: list[str],
    message: str,
) -> None:  # fmt: skip
    monkeypatch.setattr("pgm_data.stages.cluster.CONNECT_S", 0.3)
    point = load_scene("tennis").court
    assert point is not None
    (good.parent / "marks.csv").write_text(f"video,frame,name,x,y\nother.mp4,0,{point.point_names[0]},1,2\n")
    again = tmp_path / "again"
    again.mkdir()
    shutil.copy(good, again)
    words = [word.replace("IN2", str(again)).replace("IN", str(good.parent)) for word in words]
    out = [] if "--out" in words else ["--out", str(tmp_path / "work")]
    assert calibrate(*words, *out) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("error: ") and message in error
    assert not (tmp_path / "work" / "run.json").exists()


def test_a_dry_run_says_what_would_be_done_and_writes_nothing(
    tmp_path: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(good.parent, "--out", tmp_path / "work", "--dry-run", "--json", "--clip-prefix", "{parent}") == 0
    assert json.loads(capsys.readouterr().out) == {
        "videos": [{"path": "../videos/good.mp4", "clip_id": "videos-good", "match_id": "videos-good"}],
        "ignored": [],
    }
    assert not (tmp_path / "work").exists()


def test_the_table_tells_of_a_run_with_overlays_and_another_quality_redoes_it(
    tmp_path: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    work = tmp_path / "work"
    assert calibrate(good, "--out", work, overlay=True) == 0
    header, _, row = capsys.readouterr().out.splitlines()[:3]
    assert header.split()[:4] == ["video", "state", "frames", "clips"]
    assert row.split()[:6] == ["../videos/good.mp4", "ok", "4", "1", "100", "%"]
    with open_video(work / "good" / "overlay.mp4") as reader:
        assert sum(1 for _ in reader) == 4
    assert {path.name for path in (work / "good").iterdir()} == {
        "camera.parquet", "clip.json", "key_frames", "overlay.mp4", "report.html",
    }  # fmt: skip
    assert calibrate(good, "--out", work, "--resume", "--quality", "draft") == 0
    assert read_document(work / "good" / "clip.json", "clip")["quality"] == "draft"
    assert not (work / "good" / "overlay.mp4").exists()
    assert check_paths([work]) == []


def wait_for(path: Path, text: str) -> None:
    for _ in range(1500):
        if path.exists() and text in path.read_text():
            return
        time.sleep(0.02)
    raise AssertionError(f"{path}: expected {text!r} in it within 30 s")


def test_ctrl_c_keeps_what_is_done_a_second_run_is_refused_meanwhile_and_resume_does_the_rest(
    tmp_path: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    work = tmp_path / "work"
    shutil.copy(good, good.parent / "zweite.mp4")
    words = [str(good.parent), "--out", str(work), "--no-overlay", "--workers", "1"]
    process = subprocess.Popen([sys.executable, "-c", COMMAND, *words], stderr=subprocess.PIPE, text=True)
    try:
        wait_for(work / ".pgm" / "jobs.jsonl", '"good"')
        assert calibrate(*words, "--resume") == 2
        assert f"in use by process {process.pid}" in capsys.readouterr().err
        # The other video takes a second at the least: its process has to start.
        process.send_signal(signal.SIGINT)
        error = process.communicate(timeout=60)[1]
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    assert "error: interrupted; what was finished is kept, --resume goes on from there" in error
    states = {entry["path"]: entry["state"] for entry in read_document(work / "run.json", "run")["inputs"]}
    assert states == {"../videos/good.mp4": "ok", "../videos/zweite.mp4": "unfinished"}
    assert check_paths([work]) == []
    made = (work / "good" / "camera.parquet").stat().st_mtime_ns
    assert calibrate(*words, "--resume", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["videos"]
    assert [(row["state"], row["resumed"]) for row in rows] == [("ok", True), ("ok", False)]
    assert (work / "good" / "camera.parquet").stat().st_mtime_ns == made
    assert check_paths([work]) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 2 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    call = [mount or "mount", "-t", "tmpfs", "-o", "size=2m", "none", str(disk)]
    if mount is None or subprocess.run(call, capture_output=True, check=False).returncode != 0:
        pytest.skip("NO FULL DISK TRIED: this user may not mount a tmpfs")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_full_disk_is_said_keeps_finished_clips_and_resume_goes_on_once_there_is_room(
    small_disk: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    work = small_disk / "work"
    shutil.copy(good, good.parent / "zweite.mp4")
    assert calibrate(good, "--out", work, "--quiet") == 0
    about = os.statvfs(small_disk)
    (small_disk / "filler").write_bytes(b"x" * (about.f_bavail * about.f_frsize - 40_000))
    assert calibrate(good.parent, "--out", work, "--resume") == 3
    said = capsys.readouterr()
    assert said.err.strip().splitlines()[-1].startswith("error: the disk is full")
    assert len(read_clip_camera(work / "good").status) == 4
    assert not (work / "zweite").exists() and not list((work / ".pgm").glob("clips/*"))
    (small_disk / "filler").unlink()
    assert calibrate(good.parent, "--out", work, "--resume", "--quiet") == 0
    assert check_paths([work]) == []


def test_a_disk_that_is_full_from_the_start_is_exit_4(
    small_disk: Path, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    about = os.statvfs(small_disk)
    (small_disk / "filler").write_bytes(b"x" * (about.f_bavail * about.f_frsize))
    assert calibrate(good, "--out", small_disk / "work") == 4
    assert capsys.readouterr().err.startswith("error: the disk is full")


def test_help_imports_nothing_heavy_and_shows_an_example() -> None:
    heavy = "cv2 numpy av pyarrow scipy numba onnxruntime casadi pycolmap torch pandas".split()
    call = (
        "import sys; from pgm_cli import main; code = main.run_verb('calibrate', ['--help'])\n"
        f"print('loaded:', sorted(set({heavy!r}) & set(sys.modules)), code)"
    )
    done = subprocess.run([sys.executable, "-c", call], stdout=subprocess.PIPE, text=True, check=True)
    assert "example: pgm-calibrate matches/ --out work" in done.stdout
    assert done.stdout.splitlines()[-1] == "loaded: [] 0"


def test_a_dask_cluster_does_the_same_jobs(tmp_path: Path, good: Path) -> None:
    distributed = pytest.importorskip("distributed")
    work = tmp_path / "work"
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", dashboard_address=None, silence_logs=50
    ) as cluster:
        code = calibrate(good, "--out", work, "--cluster", cluster.scheduler_address, "--quiet")
    assert code == 0
    assert check_paths([work]) == []
    assert set(read_table(work / "shots.parquet")["clip_id"]) == {"good"}


@pytest.mark.real
def test_every_frame_of_a_piece_of_a_real_match_is_measured(tmp_path: Path, real_data: Path) -> None:
    with open_video(real_data / "tennis" / "shanghai_1080p30.mp4") as reader:
        frames = [(frame.bgr(), frame.timestamp) for frame, _ in zip(reader, range(20), strict=False)]
    video = tmp_path / "shanghai.mp4"
    write_video(video, [bgr for bgr, _ in frames], timestamps=[time for _, time in frames], crf=12)
    del frames
    work = tmp_path / "work"
    assert calibrate(video, "--out", work, "--quiet") == 0
    track = read_clip_camera(work / "shanghai")
    assert track.status.tolist() == ["measured"] * 20
    assert np.median(track.reprojection_px) < 0.5
    assert check_paths([work]) == []
