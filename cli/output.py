"""The folder a command writes into: refused when something is in it, and held by one run at a time."""

import atexit
import errno
import json
import os
import shutil
import socket
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from pgm_data.dataset.files import whole_file

from .console import UsageError, option_error

STATE = ".pgm"
"""Folder inside every output that holds the lock, the list of what was written, and the jobs' state."""


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Where results go, and what becomes of what is there."""

    out: Path
    """Folder to write into; it must be new or empty, or one of --resume and --overwrite be given."""
    resume: bool = False
    """Go on where an earlier run into this folder stopped."""
    overwrite: bool = False
    """Delete what an earlier run wrote into this folder, and begin again."""


class OutputFolder:
    """An output folder that this process holds until it is released, or until the process ends."""

    def __init__(self, path: Path, lock: "_Lock") -> None:
        self.path = path
        self._lock: _Lock | None = lock
        atexit.register(self.release)

    @property
    def state_dir(self) -> Path:
        """Where the state of this output's jobs is kept."""
        return self.path / STATE

    def release(self) -> None:
        """Note what was written, and let other runs have the folder."""
        if self._lock is not None:
            lock, self._lock = self._lock, None
            try:
                _note_entries(self.path, _entries(self.path))
            finally:
                lock.release()
                atexit.unregister(self.release)

    def __enter__(self) -> "OutputFolder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


def prepare_output(out: Path, *, resume: bool, overwrite: bool) -> OutputFolder:
    """The folder `out`, ready to be written into and locked against other runs.

    With `overwrite`, what earlier runs wrote is deleted, and nothing else ever is: a folder that holds anything that
    no run of ours wrote is refused before a file is touched.

    Raises:
        UsageError: when the folder is in use, cannot be written, or holds what the options do not allow for.
    """
    if resume and overwrite:
        raise UsageError("--resume and --overwrite: expected one of them, got both")
    if out.exists() and not out.is_dir():
        raise option_error("--out", expected="a folder", got=f"the file {out}")
    _refuse_entries(out, resume=resume, overwrite=overwrite)
    try:
        (out / STATE).mkdir(parents=True, exist_ok=True)
        lock, died = _take_lock(out / STATE / "lock.json")
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise option_error("--out", expected="a folder that can be written", got=f"{out}: {error.strerror}") from error
    try:
        if died is not None:
            # That run could not note what it wrote: whatever was changed since it began is taken as its work.
            # File times come from a clock that lags by some milliseconds.
            later = {name for name in _entries(out) if (out / name).lstat().st_mtime >= died - 0.1}
            _note_entries(out, _noted_entries(out) | later)
        if overwrite:
            _delete_earlier(out)
    except BaseException:
        lock.release()
        raise
    return OutputFolder(out, lock)


def hold_work(work: Path) -> OutputFolder:
    """A work folder that an earlier command made, locked against other runs, for a stage that writes into its clips.

    Raises:
        UsageError: when it is in use, cannot be written, or no command of ours made it.
    """
    if not ((work / "run.json").is_file() or (work / STATE).is_dir()):
        raise option_error("WORK", expected="a work folder, with run.json", got=f"{work} without it")
    try:
        (work / STATE).mkdir(exist_ok=True)
        lock, _ = _take_lock(work / STATE / "lock.json")
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise option_error("WORK", expected="a folder that can be written", got=f"{work}: {error.strerror}") from error
    return OutputFolder(work, lock)


def _refuse_entries(out: Path, *, resume: bool, overwrite: bool) -> None:
    entries = _entries(out) if out.exists() else set()
    if not entries:
        return
    ours = (out / "run.json").is_file() or (out / STATE).is_dir()
    if (resume or overwrite) and not ours:
        option = "--resume" if resume else "--overwrite"
        raise option_error(
            option, expected="a folder that an earlier run wrote", got=f"{out} without run.json, which is left alone"
        )
    if not (resume or overwrite):
        hint = "; --overwrite begins again, --resume, where the command has it, goes on" if ours else ""
        raise option_error("--out", expected="a new or empty folder", got=f"{out} with {_some(entries)} in it{hint}")


def _delete_earlier(out: Path) -> None:
    entries, noted = _entries(out), _noted_entries(out)
    foreign = entries - noted - {"run.json"}
    if foreign:
        raise option_error(
            "--overwrite", expected=f"nothing in {out} but what runs of pgm wrote", got=f"also {_some(foreign)}"
        )
    for name in sorted(entries):
        _delete(out / name)
    for path in (out / STATE).iterdir():
        if path.name != "lock.json":
            _delete(path)


def _delete(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _entries(out: Path) -> set[str]:
    return {path.name for path in out.iterdir() if path.name != STATE}


def _noted_entries(out: Path) -> set[str]:
    path = out / STATE / "written.json"
    return set(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else set()


def _note_entries(out: Path, names: Iterable[str]) -> None:
    with whole_file(out / STATE / "written.json") as temporary:
        temporary.write_text(json.dumps(sorted(names)), encoding="utf-8")


def _some(names: set[str]) -> str:
    first = sorted(names)[:3]
    return ", ".join(first) + (f" and {len(names) - len(first)} more" if len(names) > len(first) else "")


@dataclass(frozen=True, kw_only=True)
class _Lock:
    """A lock file of this process."""

    path: Path

    def release(self) -> None:
        self.path.unlink(missing_ok=True)


def _take_lock(path: Path) -> tuple[_Lock, float | None]:
    """The lock, and when the run began that died holding it before us, if one did (seconds since the epoch)."""
    died: float | None = None
    holder = {"pid": os.getpid(), "host": socket.gethostname(), "started": time.time(), "born": _born(os.getpid())}
    while True:
        try:
            descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
        except FileExistsError:
            died = _remove_stale(path)
            continue
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump(holder, file)
        return _Lock(path=path), died


def _remove_stale(path: Path) -> float | None:
    """Remove the lock of a run that is no more; when that run began.

    Raises:
        UsageError: when the run lives, or is on another machine, where nobody here can tell.
    """
    try:
        text = path.read_text(encoding="utf-8")
        made = path.stat().st_mtime
    except FileNotFoundError:
        return None
    try:
        holder = json.loads(text)
    except ValueError:
        # It is being written this moment, or its writer was killed doing it.
        if time.time() - made < 5.0:
            raise UsageError(f"--out: {path.parent.parent} is being taken by another run") from None
        path.unlink(missing_ok=True)
        return made
    if holder["host"] != socket.gethostname():
        raise UsageError(
            f"--out: {path.parent.parent} is in use by process {holder['pid']} on {holder['host']}; "
            f"delete {path} if that run is no more"
        )
    if _lives(holder["pid"], holder["born"]):
        raise UsageError(f"--out: {path.parent.parent} is in use by process {holder['pid']}")
    # Of two runs that find the same stale lock, one moves it away and the other finds a lock that is new.
    aside = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        os.replace(path, aside)
    except FileNotFoundError:
        return None
    moved = aside.read_text(encoding="utf-8")
    if moved != text:
        os.replace(aside, path)
        return None
    aside.unlink()
    return float(holder["started"])


def _lives(pid: int, born: str) -> bool:
    """Whether the process that was `born` then under this number is still there."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not born or not _born(pid) or _born(pid) == born


def _born(pid: int) -> str:
    """When a process began, in the kernel's ticks since the machine's start; empty where that cannot be read."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="utf-8").strip()
    except OSError:
        return ""
    # The name, in brackets, may hold spaces.
    return f"{boot}:{stat.rpartition(')')[2].split()[19]}"
