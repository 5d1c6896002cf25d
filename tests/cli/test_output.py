"""An output folder is refused, resumed or overwritten as asked, and nothing that is not ours is ever deleted."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pgm_cli.console import UsageError
from pgm_cli.output import STATE, prepare_output


def earlier_run(out: Path) -> None:
    """Leave in `out` what a finished run would."""
    with prepare_output(out, resume=False, overwrite=False):
        (out / "clip").mkdir()
        (out / "clip" / "camera.parquet").write_text("rows")
        (out / "run.json").write_text("{}")
        (out / STATE / "jobs.jsonl").write_text("{}\n")


def files(out: Path) -> set[str]:
    return {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file() and STATE not in path.parts}


@pytest.mark.parametrize("depth", ["new", "new/deeper", "."])
def test_a_new_or_empty_folder_is_taken_and_made(tmp_path: Path, depth: str) -> None:
    with prepare_output(tmp_path / depth, resume=False, overwrite=False) as folder:
        assert folder.path.is_dir()
        assert folder.state_dir.is_dir()


@pytest.mark.parametrize("option", [{"resume": True}, {"overwrite": True}])
def test_resume_and_overwrite_may_also_begin(tmp_path: Path, option: dict[str, bool]) -> None:
    prepare_output(tmp_path / "new", **{"resume": False, "overwrite": False, **option}).release()
    assert (tmp_path / "new").is_dir()


def test_a_folder_with_something_in_it_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "holiday.mp4").write_text("mine")
    for options in ({"resume": False, "overwrite": False}, {"resume": True, "overwrite": False}):
        with pytest.raises(UsageError, match=r"expected a .*folder.*got"):
            prepare_output(tmp_path, **options)
    with pytest.raises(UsageError, match="without run.json, which is left alone"):
        prepare_output(tmp_path, resume=False, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["holiday.mp4"]


def test_the_refusal_of_an_earlier_run_names_both_ways_on(tmp_path: Path) -> None:
    earlier_run(tmp_path)
    with pytest.raises(
        UsageError, match="got .* with clip, run.json in it; --overwrite begins again, --resume, .* goes on"
    ):
        prepare_output(tmp_path, resume=False, overwrite=False)


def test_resume_keeps_everything(tmp_path: Path) -> None:
    earlier_run(tmp_path)
    with prepare_output(tmp_path, resume=True, overwrite=False) as folder:
        assert files(tmp_path) == {"clip/camera.parquet", "run.json"}
        assert (folder.state_dir / "jobs.jsonl").exists()


def test_overwrite_deletes_what_runs_wrote_and_their_state(tmp_path: Path) -> None:
    earlier_run(tmp_path)
    with prepare_output(tmp_path, resume=True, overwrite=False):
        (tmp_path / "more").write_text("of the second run")
    with prepare_output(tmp_path, resume=False, overwrite=True) as folder:
        assert files(tmp_path) == set()
        assert not (folder.state_dir / "jobs.jsonl").exists()


def test_overwrite_refuses_before_it_deletes_when_something_else_is_there(tmp_path: Path) -> None:
    earlier_run(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match="--overwrite: expected nothing in .* got also notes.txt"):
        prepare_output(tmp_path, resume=False, overwrite=True)
    assert files(tmp_path) == {"clip/camera.parquet", "run.json", "notes.txt"}
    # The refusal gives the folder back.
    prepare_output(tmp_path, resume=True, overwrite=False).release()


def test_what_a_link_leads_to_is_not_deleted(tmp_path: Path) -> None:
    videos, out = tmp_path / "videos", tmp_path / "out"
    videos.mkdir()
    (videos / "match.mp4").write_text("mine")
    with prepare_output(out, resume=False, overwrite=False):
        (out / "videos").symlink_to(videos)
    prepare_output(out, resume=False, overwrite=True).release()
    assert not (out / "videos").exists()
    assert (videos / "match.mp4").exists()


def test_both_options_at_once_and_a_file_as_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="expected one of them, got both"):
        prepare_output(tmp_path, resume=True, overwrite=True)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="--out: expected a folder, got the file"):
        prepare_output(tmp_path / "file", resume=False, overwrite=False)


def test_a_folder_that_cannot_be_made_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="--out: expected a folder that can be written, got .*: Not a directory"):
        prepare_output(tmp_path / "file" / "out", resume=False, overwrite=False)


def test_a_second_run_into_one_folder_is_refused_while_the_first_lives(tmp_path: Path) -> None:
    first = prepare_output(tmp_path, resume=False, overwrite=False)
    for options in ({"resume": False, "overwrite": False}, {"resume": False, "overwrite": True}):
        with pytest.raises(UsageError, match=f"in use by process {os.getpid()}"):
            prepare_output(tmp_path, **options)
    first.release()
    prepare_output(tmp_path, resume=False, overwrite=False).release()


HOLDER = """
import sys, time
from pathlib import Path
from pgm_cli.output import prepare_output
folder = prepare_output(Path(sys.argv[1]), resume=False, overwrite=False)
(folder.path / "half.mp4").write_text("half")
print("taken", flush=True)
time.sleep(600)
"""


def test_the_lock_of_a_killed_run_is_stale_and_its_files_are_known_as_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(out)], stdout=subprocess.PIPE)
    assert holder.stdout is not None
    holder.stdout.readline()
    with pytest.raises(UsageError, match=f"in use by process {holder.pid}"):
        prepare_output(out, resume=True, overwrite=False)
    holder.send_signal(signal.SIGKILL)
    holder.wait(20)
    holder.stdout.close()
    prepare_output(out, resume=True, overwrite=False).release()
    prepare_output(out, resume=False, overwrite=True).release()
    assert files(out) == set()


def lock_text(**other: object) -> str:
    return json.dumps({"pid": os.getpid(), "host": socket.gethostname(), "started": time.time(), "born": "", **other})


def test_a_number_that_the_system_gave_to_another_process_does_not_hold_the_folder(tmp_path: Path) -> None:
    (tmp_path / STATE).mkdir()
    (tmp_path / STATE / "lock.json").write_text(lock_text(born="another boot:1"))
    prepare_output(tmp_path, resume=False, overwrite=False).release()


def test_a_run_on_another_machine_holds_the_folder_whatever_its_number(tmp_path: Path) -> None:
    (tmp_path / STATE).mkdir()
    lock = tmp_path / STATE / "lock.json"
    lock.write_text(lock_text(host="elsewhere", pid=1))
    with pytest.raises(UsageError, match="in use by process 1 on elsewhere; delete .*lock.json if that run is no more"):
        prepare_output(tmp_path, resume=False, overwrite=False)
    assert lock.exists()


def test_a_lock_that_was_never_finished_is_stale_after_a_while(tmp_path: Path) -> None:
    (tmp_path / STATE).mkdir()
    lock = tmp_path / STATE / "lock.json"
    lock.write_text("")
    with pytest.raises(UsageError, match="is being taken by another run"):
        prepare_output(tmp_path, resume=False, overwrite=False)
    os.utime(lock, (time.time() - 60, time.time() - 60))
    prepare_output(tmp_path, resume=False, overwrite=False).release()


def test_of_many_runs_that_start_at_once_on_a_stale_lock_one_gets_the_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / STATE).mkdir(parents=True)
    (out / STATE / "lock.json").write_text(lock_text(born="another boot:1"))
    call = (
        "import sys; from pathlib import Path; from pgm_cli.output import prepare_output\n"
        "folder = prepare_output(Path(sys.argv[1]), resume=False, overwrite=False)\n"
        "print('taken', flush=True); sys.stdin.read()"
    )
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", call, str(out)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        for _ in range(4)
    ]
    limit = time.monotonic() + 60
    while sum(run.poll() is None for run in runs) > 1:
        assert time.monotonic() < limit, "more than one run holds the folder"
        time.sleep(0.05)
    said = [run.communicate(timeout=60)[0] for run in runs]
    assert sorted(said) == [b"", b"", b"", b"taken\n"]
