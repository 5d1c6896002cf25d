"""The dispatcher turns whatever a verb does into one line and the right exit code."""

import errno
import os
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path

import pytest
from pgm_cli import main
from pgm_cli.console import UsageError, option_error

Verb = Callable[[Callable[[list[str]], int]], None]


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch) -> Verb:
    """Put a function in the place of the verb `info`."""

    def put(call: Callable[[list[str]], int]) -> None:
        module = types.ModuleType("pgm_cli.info")
        module.main = call  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "pgm_cli.info", module)

    monkeypatch.delenv("PGM_DEBUG", raising=False)
    return put


def raising(error: BaseException) -> Callable[[list[str]], int]:
    def call(argv: list[str]) -> int:
        raise error

    return call


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (KeyboardInterrupt(), 130, "error: interrupted; what was finished is kept, --resume goes on from there"),
        (UsageError("--out: expected a folder, got x"), 2, "error: --out: expected a folder, got x"),
        (ValueError("depth is negative"), 1, "error: ValueError: depth is negative (--debug shows where)"),
        (
            OSError(errno.ENOSPC, "No space", "w/clip.json"),
            4,
            "error: the disk is full: w/clip.json (--debug shows where)",
        ),
        (OSError(errno.EACCES, "no", "w/x"), 2, "error: not permitted to read or write: w/x (--debug shows where)"),
        (SystemExit(2), 2, ""),
        (SystemExit(None), 0, ""),
        (SystemExit("said so"), 1, "error: said so"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_an_exception_becomes_an_exit_code_and_one_line(
    verb: Verb, capsys: pytest.CaptureFixture[str], error: BaseException, code: int, message: str
) -> None:
    verb(raising(error))
    assert main.run(["info"]) == code
    assert capsys.readouterr().err.strip() == message


@pytest.mark.parametrize("by", ["flag", "environment"])
def test_debug_shows_where_an_error_came_from_and_reaches_no_verb(
    verb: Verb, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, by: str
) -> None:
    seen: list[list[str]] = []

    def call(argv: list[str]) -> int:
        seen.append(argv)
        raise RuntimeError("broken")

    verb(call)
    monkeypatch.setenv("PGM_DEBUG", "1" if by == "environment" else "0")
    assert main.run(["info", *(["--debug"] if by == "flag" else []), "--limit", "3"]) == 1
    assert seen == [["--limit", "3"]]
    assert 'raise RuntimeError("broken")' in capsys.readouterr().err


def test_the_code_that_a_verb_returns_is_the_exit_code(verb: Verb) -> None:
    verb(lambda argv: 3)
    assert main.run(["info"]) == 3


def test_an_unknown_verb_is_a_usage_error_that_names_near_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["calibrat"]) == 2
    assert "got 'calibrat'; did you mean calibrate" in capsys.readouterr().err


def test_no_verb_at_all_prints_the_help_and_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([]) == 2
    text = capsys.readouterr().out
    assert all(name in text for name in main.VERBS)


def test_a_reader_that_leaves_early_is_no_error(tmp_path: Path) -> None:
    call = (
        "import sys, types; from pgm_cli import main\n"
        "module = types.ModuleType('pgm_cli.info')\n"
        "def verb(argv):\n"
        "    for i in range(100000): print(i)\n"
        "    return 0\n"
        "module.main = verb; sys.modules['pgm_cli.info'] = module\n"
        "sys.exit(main.run(['info']))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", call], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.readline()
    process.stdout.close()
    said = process.stderr.read()
    process.stderr.close()
    assert (process.wait(60), said) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_that_finds_the_disk_full_is_an_error_that_says_so() -> None:
    call = "import sys; from pgm_cli import main; sys.exit(main.run(['info', '--json']))"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", call], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 4
    assert "error: the disk is full" in done.stderr


def test_option_errors_name_option_expected_and_got() -> None:
    assert str(option_error("--fps", expected="more than 0", got=-1)) == "--fps: expected more than 0, got -1"


def test_an_error_writes_nothing_to_standard_output(verb: Verb, capsys: pytest.CaptureFixture[str]) -> None:
    verb(raising(ValueError("x")))
    main.run(["info"])
    assert capsys.readouterr().out == ""
    assert os.environ.get("PGM_DEBUG") is None
