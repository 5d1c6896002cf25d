"""Runs every annotated shape and type while tests run, and leads to the real clips where there are any."""

import os
import re
import signal
import sys
from pathlib import Path

import hypothesis
import pytest

from tests import shape_checks

ROOT = Path(__file__).resolve().parent.parent


def modules_to_check() -> list[str]:
    """Every module of pgm_data and pgm_models but those that hand functions to numba, which compiles no wrapper."""
    names = []
    for package in ("pgm_data", "pgm_models"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if not re.search(r"^\s*(?:from|import) numba\b", path.read_text(encoding="utf-8"), re.MULTILINE):
                parts = path.relative_to(ROOT).with_suffix("").parts
                # A package's own name would take in its numba modules too.
                if parts[-1] != "__init__":
                    names.append(".".join(parts))
    return names


shape_checks.install(modules_to_check())

# Compiling what the hook and pytest rewrite takes each process a quarter of a minute: kept, whatever the shell says.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A shell that runs the tests in the background has Ctrl-C ignored, and so would the commands whose Ctrl-C is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

hypothesis.settings.register_profile(
    "pgm",
    deadline=None,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
    print_blob=True,
)
hypothesis.settings.load_profile("pgm")


def real_data_folder() -> Path:
    """Where the real clips lie: PGM_REAL_DATA, or shared/data beside the checkout."""
    return Path(os.environ.get("PGM_REAL_DATA") or ROOT.parent / "shared" / "data")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real clips; skips where there is none."""
    folder = real_data_folder()
    if not folder.is_dir():
        pytest.skip(f"NO REAL CLIPS in {folder}: set PGM_REAL_DATA")
    return folder


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say once, in capitals, when nothing was measured on real clips."""
    absent = [r for r in terminalreporter.stats.get("skipped", []) if "NO REAL CLIPS" in str(r.longrepr)]
    if absent:
        terminalreporter.write_line(f"{len(absent)} TESTS ON REAL CLIPS DID NOT RUN: no {real_data_folder()}", red=True)
