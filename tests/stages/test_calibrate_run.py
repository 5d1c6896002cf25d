"""A run names its videos apart, redoes what changed and nothing else, and leaves a work folder that holds together."""

import errno
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table, write_table
from pgm_data.scene import load_scene
from pgm_data.simulate.clip import simulate_clip
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.stages import calibrate_run
from pgm_data.stages.calibrate import CalibrateOptions, run_job
from pgm_data.stages.calibrate_plan import OWN_OUTPUT, Choice, Plan, plan_run
from pgm_data.stages.calibrate_run import Manner, NameTaken, RunSummary, calibrate_work, jobs_of, write_run_document
from pgm_data.stages.jobs import Job, JobEvent, JobLog, JobOutcome
from pgm_data.stages.work_folder import (
    SHOTS,
    clip_folders,
    commit,
    key_of,
    merge_parts,
    part_path,
    parts_of,
    read_part,
    staging_folder,
    sweep,
)
from pgm_data.video import write_video
from pgm_data.video.reader import VideoError

TENNIS = load_scene("tennis")
OPTIONS = CalibrateOptions(overlay=False)


@pytest.fixture(scope="module")
def rally() -> list[np.ndarray]:
    """Three pictures of a court."""
    options = ClipOptions(frames=3, width=640, height=360, motion="still")
    return list(simulate_clip(TENNIS, options, seed=3).frames())


@pytest.fixture
def videos(tmp_path: Path, rally: list[np.ndarray]) -> Path:
    """A folder with two videos of a court, in folders of their own."""
    for name in ("a/first.mp4", "b/second.mp4"):
        path = tmp_path / "videos" / name
        path.parent.mkdir(parents=True)
        write_video(path, rally, fps=25)
    return tmp_path / "videos"


def empty_files(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def plan(*paths: Path, work: Path, options: CalibrateOptions = OPTIONS, **choice: object) -> Plan:
    return plan_run(paths, work=work, options=options, choice=Choice(**choice))


@pytest.mark.parametrize(
    ("given_path", "work", "expected"),
    [
        ("videos", "work", "../videos/a/first.mp4"),
        ("videos", "elsewhere/work", "a/first.mp4"),
        ("videos/a/first.mp4", "elsewhere/work", "first.mp4"),
        ("videos/a", "videos/work", "../a/first.mp4"),
    ],
)
def test_a_video_is_named_from_beside_the_work_folder_or_else_from_the_folder_given(
    tmp_path: Path, given_path: str, work: str, expected: str
) -> None:
    empty_files(tmp_path, "videos/a/first.mp4")
    (task,) = plan(tmp_path / given_path, work=tmp_path / work).tasks
    assert (task.source_path, task.stem, task.match_id) == (expected, "first", "first")


def test_videos_of_several_folders_elsewhere_keep_different_names(tmp_path: Path) -> None:
    empty_files(tmp_path, "in/a/rally.mp4", "in/b/rally.mp4")
    tasks = plan(tmp_path / "in/a", tmp_path / "in/b", work=tmp_path / "x/work", clip_prefix="{parent}").tasks
    assert [(task.source_path, task.stem) for task in tasks] == [
        ("a/rally.mp4", "a-rally"),
        ("b/rally.mp4", "b-rally"),
    ]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("a/rally.mp4", "b/rally.mp4"), r"a/rally.mp4 and .*b/rally.mp4;.*--clip-prefix"),
        (("rally.mp4", "rally.01.mp4"), r"rally.01.mp4 is called like a clip of .*rally.mp4"),
        (("Rally.mp4", "rally.01.mp4"), r"rally.01.mp4 is called like a clip of .*Rally.mp4"),
        (("run.json.mp4",), r"'run.json' of .* is the name of a file"),
    ],
)
def test_videos_whose_clips_could_get_one_name_are_refused(
    tmp_path: Path, names: tuple[str, ...], message: str
) -> None:
    empty_files(tmp_path / "in", *names)
    with pytest.raises(ValueError, match=message):
        plan(tmp_path / "in", work=tmp_path / "work")


def test_only_and_limit_choose_among_the_videos_and_two_of_one_name_apart(tmp_path: Path) -> None:
    folder = empty_files(tmp_path / "in", "a/rally.mp4", "b/rally.mp4", "b/final.mp4")
    assert [task.source_path for task in plan(folder, work=tmp_path / "w", only="*/b/*").tasks] == [
        "../in/b/final.mp4",
        "../in/b/rally.mp4",
    ]
    assert [task.stem for task in plan(folder, work=tmp_path / "w", only="final*").tasks] == ["final"]
    assert [task.stem for task in plan(folder, work=tmp_path / "w", limit=1).tasks] == ["rally"]


def test_what_runs_wrote_below_the_input_is_no_input(tmp_path: Path) -> None:
    folder = empty_files(tmp_path / "in", "rally.mp4", "work/run.json", "work/.pgm/x", "work/rally/overlay.mp4")
    found = plan(folder, work=folder / "work")
    assert [task.stem for task in found.tasks] == ["rally"]
    assert found.ignored == (("../work/rally/overlay.mp4", OWN_OUTPUT),)
    assert len(plan(folder / "work/rally/overlay.mp4", work=tmp_path / "other").tasks) == 1


def test_a_name_that_no_document_can_hold_is_ignored_with_the_reason(tmp_path: Path) -> None:
    folder = empty_files(tmp_path / "in", "good.mp4", "back\\slash.mp4")
    (folder / os.fsdecode(b"bytes\xff.mp4")).touch()
    found = plan(folder, work=tmp_path / "work")
    assert [task.stem for task in found.tasks] == ["good"]
    assert len(found.ignored) == 2 and all("no text" in reason for _, reason in found.ignored)


def test_a_scene_without_a_court_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--scene: expected a scene with a court to calibrate by, got blocks"):
        plan(tmp_path, work=tmp_path / "w", options=replace(OPTIONS, scene="blocks"))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["other.mp4,0,near_left,1,2", "third,0,near_left,1,2"], "got 'other.mp4'; .*got 'third'"),
        (["rally.mp4,0,near_left,1,2"], "expected one video, got 'rally.mp4', which .*a/rally.mp4 and .*b/rally.mp4"),
        (["a/rally.mp4,0,no_such_point,1,2"], "line 2: name: expected one of .*got 'no_such_point'"),
    ],
)
def test_marks_that_fit_no_single_input_are_refused_with_all_faults(
    tmp_path: Path, rows: list[str], message: str
) -> None:
    folder = empty_files(tmp_path / "in", "a/rally.mp4", "b/rally.mp4", "c/last.mp4")
    point = TENNIS.court.point_names[0] if TENNIS.court is not None else ""
    marks = tmp_path / "marks.csv"
    marks.write_text("\n".join(["video,frame,name,x,y", *rows]).replace("near_left", point))
    with pytest.raises(ValueError, match=message):
        plan(folder, work=tmp_path / "w", options=replace(OPTIONS, keypoints=str(marks)), clip_prefix="{parent}")


def test_a_job_changes_exactly_when_what_its_result_depends_on_does(tmp_path: Path) -> None:
    folder = empty_files(tmp_path / "in", "first.mp4", "second.mp4")
    assert TENNIS.court is not None
    point = TENNIS.court.point_names[0]
    marks, network = tmp_path / "marks.csv", tmp_path / "net.onnx"
    marks.write_text(f"video,frame,name,x,y\nsecond.mp4,0,{point},1,2\n")
    network.write_bytes(b"one")

    def digests(**changes: object) -> list[str]:
        options = replace(OPTIONS, keypoints=str(marks), network=str(network), **changes)
        found = plan(folder, work=tmp_path / "w", options=options)
        return [job.digest() for job in jobs_of(found, tmp_path / "w", options)]

    first, second = digests()
    assert [first, second] == digests()
    assert not {first, second} & set(digests(quality="best"))
    marks.write_text(f"video,frame,name,x,y\nsecond.mp4,0,{point},1,3\n")
    assert digests()[0] == first and digests()[1] != second
    second = digests()[1]
    os.utime(folder / "first.mp4", (1, 1))
    assert digests()[0] != first and digests()[1] == second
    network.write_bytes(b"two")
    assert digests()[1] != second


def rows_of(video: str, clips: Sequence[str]) -> dict:
    """Two frames a clip, and one without."""
    names = [clip for clip in clips for _ in range(2)] + [""]
    return {
        "video": [video] * len(names),
        "video_frame": np.arange(len(names)),
        "timestamp": np.arange(len(names)) / 25,
        "verdict": ["clip" if name else "other" for name in names],
        "reason": ["" if name else "no court found" for name in names],
        "clip_id": names,
    }


def put(work: Path, stem: str, clips: Sequence[str], video: str = "") -> None:
    """Commit clips that hold nothing but a document."""
    with staging_folder(work, stem) as staging:
        for clip in clips:
            (staging / clip).mkdir()
            (staging / clip / "clip.json").write_text(f"{stem} {len(clips)}")
        columns = rows_of(video or f"{stem}.mp4", clips)
        write_table(staging / SHOTS, table="shots", scene=TENNIS, columns=columns)
        commit(staging, work, stem, clips)


@settings(max_examples=25)
@given(
    counts=st.lists(
        st.tuples(st.sampled_from(["rally", "rally.final", "Élan 1"]), st.integers(0, 3)), min_size=1, max_size=5
    )
)
def test_after_any_commits_each_video_has_the_clips_of_its_last_one_and_nothing_else_is_touched(
    tmp_path_factory: pytest.TempPathFactory, counts: list[tuple[str, int]]
) -> None:
    work = tmp_path_factory.mktemp("work")
    empty_files(work, "rally.07/mine.txt", "notes.txt", "rally.final.later/clip.json")
    last: dict[str, list[str]] = {}
    for stem, count in counts:
        last[stem] = [stem] if count == 1 else [f"{stem}.{i:02d}" for i in range(count)]
        put(work, stem, last[stem])
    there = {path.name for path in work.iterdir()} - {".pgm", "rally.07", "notes.txt", "rally.final.later"}
    assert there == {clip for clips in last.values() for clip in clips}
    assert {part.video: list(part.clips) for part in parts_of(work)} == {f"{s}.mp4": c for s, c in last.items()}
    assert all((work / c / "clip.json").read_text() == f"{s} {len(last[s])}" for s in last for c in last[s])
    assert (work / "rally.07/mine.txt").exists() and not list((work / ".pgm" / "clips").iterdir())


def test_what_a_process_left_that_died_while_it_exchanged_clips_is_swept(tmp_path: Path) -> None:
    put(tmp_path, "torn", ["torn.00", "torn.01"])
    put(tmp_path, "whole", ["whole"])
    part_path(tmp_path, "torn").unlink()
    empty_files(tmp_path / ".pgm" / "clips", "torn/torn.02/camera.parquet")
    sweep(tmp_path, ["torn", "whole"])
    assert clip_folders(tmp_path, "torn") == [] and not (tmp_path / ".pgm" / "clips").exists()
    assert [path.name for path in clip_folders(tmp_path, "whole")] == ["whole"]


def test_merged_parts_are_the_rows_of_all_videos_in_the_order_given(tmp_path: Path) -> None:
    for stem in ("b", "a"):
        put(tmp_path, stem, [stem])
    parts = [part for part in map(read_part, (part_path(tmp_path, s) for s in ("b", "a"))) if part is not None]
    merge_parts(tmp_path, parts, scene=TENNIS)
    merged = read_table(tmp_path / SHOTS)
    expected = [rows_of("b.mp4", ["b"]), rows_of("a.mp4", ["a"])]
    for name in expected[0]:
        assert merged[name].tolist() == [value for rows in expected for value in list(rows[name])]
    merge_parts(tmp_path, [], scene=TENNIS)
    assert len(read_table(tmp_path / SHOTS)["video"]) == 0


@given(stem=st.text(min_size=1, max_size=120), other=st.text(min_size=1, max_size=120))
def test_keys_are_short_plain_names_and_differ_where_stems_do(stem: str, other: str) -> None:
    assert key_of(stem).isascii() and len(key_of(stem)) <= 80 and "/" not in key_of(stem)
    assert (key_of(stem) == key_of(other)) == (stem == other)


Before = Callable[[Job], None]


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Callable[[Before], None]:
    """Have jobs done in this process; something may happen before each."""

    def use(before: Before) -> None:
        def run_here(
            jobs: Sequence[Job], *, state_dir: Path, resume: bool, on_event: Callable[[JobEvent], None], **_: object
        ) -> None:
            state_dir.mkdir(parents=True, exist_ok=True)
            log = JobLog(state_dir / "jobs.jsonl")
            for job in jobs:
                digest, done = log.outcomes().get(job.name, ("", None))
                if resume and done is not None and done.state == "done" and digest == job.digest():
                    on_event(JobEvent(name=job.name, kind="skipped"))
                    continue
                before(job)
                try:
                    result, reason = run_job(dict(job.arguments), lambda _: None), ""
                except (VideoError, ValueError, OSError) as error:
                    result, reason = None, f"{type(error).__name__}: {error}"
                state = "failed" if result is None else "done"
                log.append(job, JobOutcome(name=job.name, state=state, reason=reason, seconds=1.0, result=result))
                on_event(JobEvent(name=job.name, kind=state, message=reason))

        monkeypatch.setattr(calibrate_run, "run_jobs", run_here)

    use(lambda job: None)
    return use


def calibrate(
    *paths: Path, work: Path, resume: bool = True, options: CalibrateOptions = OPTIONS, **choice: object
) -> RunSummary:
    found = plan(*paths, work=work, options=options, **choice)
    started = datetime.now(UTC)
    return calibrate_work(
        found, work, options=options, manner=Manner(resume=resume), tell=lambda event: None,
        write_run=lambda rows: write_run_document(
            work, found, rows, command="pgm-calibrate", options=options, started=started
        ),
    )  # fmt: skip


@pytest.mark.usefixtures("here")
def test_a_second_run_adds_a_video_and_the_folder_tells_of_both(tmp_path: Path, videos: Path) -> None:
    work = tmp_path / "work"
    (only,) = calibrate(videos / "a", work=work).videos
    assert (only.state, only.frames, only.measured, only.clips) == ("ok", 3, 3, ("first",))
    both = calibrate(videos, work=work).videos
    assert [(row.path, row.state, row.resumed) for row in both] == [
        ("../videos/a/first.mp4", "ok", True),
        ("../videos/b/second.mp4", "ok", False),
    ]
    calibrate(videos / "b", work=work)
    assert check_paths([work]) == []
    assert [entry["path"] for entry in read_document(work / "run.json", "run")["inputs"]] == [
        "../videos/b/second.mp4",
        "../videos/a/first.mp4",
    ]
    assert sorted(set(read_table(work / SHOTS)["clip_id"])) == ["first", "second"]


@pytest.mark.usefixtures("here")
def test_a_video_is_redone_when_its_files_are_gone_and_its_clips_move_with_its_name(
    tmp_path: Path, videos: Path
) -> None:
    work = tmp_path / "work"
    calibrate(videos / "a", work=work)
    (work / "first" / "camera.parquet").unlink()
    (row,) = calibrate(videos / "a", work=work).videos
    assert not row.resumed and (work / "first" / "camera.parquet").exists()
    (row,) = calibrate(videos / "a", work=work, clip_prefix="match").videos
    assert row.clips == ("match-first",) and not (work / "first").exists()
    assert check_paths([work]) == []


@pytest.mark.usefixtures("here")
def test_a_clip_name_of_another_video_is_not_taken_over(tmp_path: Path, videos: Path) -> None:
    work = tmp_path / "work"
    calibrate(videos / "a", work=work)
    os.rename(videos / "b/second.mp4", videos / "b/first.mp4")
    with pytest.raises(NameTaken, match="'first' of .*b/first.mp4 belongs to .*a/first.mp4"):
        calibrate(videos / "b", work=work)
    assert check_paths([work]) == []


def test_a_redo_that_fails_leaves_the_clips_of_before_and_says_so(
    tmp_path: Path, videos: Path, here: Callable[[Before], None]
) -> None:
    work = tmp_path / "work"
    calibrate(videos / "a", work=work)

    def spoil(job: Job) -> None:
        raise_for = Path(str(job.arguments["video"]))
        raise_for.write_text("no video any more")

    here(spoil)
    (row,) = calibrate(videos / "a", work=work, options=replace(OPTIONS, quality="draft")).videos
    assert (row.state, row.clips) == ("failed", ("first",))
    assert row.reason.endswith("the clips of an earlier run stay")
    assert check_paths([work]) == []


def test_a_full_disk_ends_the_run_and_keeps_what_is_done(
    tmp_path: Path, videos: Path, here: Callable[[Before], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def before(job: Job) -> None:
        begun.append(job.name)
        if job.name == "second":
            monkeypatch.setattr("pgm_data.stages.calibrate.commit", full)

    here(before)
    os.rename(videos / "b", videos / "c")
    (videos / "d").mkdir()
    write_video(videos / "d/third.mp4", [np.zeros((36, 64, 3), np.uint8)] * 2, fps=25)
    summary = calibrate(videos, work=tmp_path / "work")
    assert begun == ["first", "second"]
    assert summary.trouble == "the disk is full" and summary.any_clip and not summary.all_well
    assert [(row.state, row.reason) for row in summary.videos] == [
        ("ok", ""),
        ("failed", "the disk is full"),
        ("unfinished", "the run ended before it"),
    ]
    assert check_paths([tmp_path / "work"]) == []


def test_an_interrupted_run_writes_down_what_is_done_and_what_is_not(
    tmp_path: Path, videos: Path, here: Callable[[Before], None]
) -> None:
    def interrupt(job: Job) -> None:
        if job.name == "second":
            raise KeyboardInterrupt

    here(interrupt)
    work = tmp_path / "work"
    with pytest.raises(KeyboardInterrupt):
        calibrate(videos, work=work)
    inputs = read_document(work / "run.json", "run")["inputs"]
    assert [(entry["path"], entry["state"]) for entry in inputs] == [
        ("../videos/a/first.mp4", "ok"),
        ("../videos/b/second.mp4", "unfinished"),
    ]
    assert check_paths([work]) == []


@pytest.mark.usefixtures("here")
def test_marks_in_frames_that_the_video_does_not_have_are_named(tmp_path: Path, videos: Path) -> None:
    assert TENNIS.court is not None
    marks = tmp_path / "marks.csv"
    marks.write_text(f"video,frame,name,x,y\nfirst,40,{TENNIS.court.point_names[0]},1,2\n")
    options = replace(OPTIONS, keypoints=str(marks))
    row, other = calibrate(videos, work=tmp_path / "work", options=options).videos
    assert row.state == "degraded" and other.state == "ok"
    assert row.reason == "keypoints: expected frames of its shots (3 frames decoded), got 40"
