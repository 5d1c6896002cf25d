"""Asking for help loads nothing heavy, pgm_data needs no torch, and shapes are executed while tests run."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import TypeCheckError
from pgm_cli.main import VERBS

from pgm_data.geometry.rigid import rotation_from_rotvec, skew

HEAVY = {"av", "casadi", "cv2", "matplotlib", "numba", "onnxruntime", "pandas", "pyarrow", "pycolmap", "scipy", "torch"}

CALL = """
import sys
from pgm_cli.main import run
code = run(sys.argv[1:])
print("LOADED", *sorted(name for name in sys.modules if "." not in name))
sys.exit(code)
"""


def call(*argv: str) -> tuple[int, str, set[str]]:
    """Exit code, printed text and loaded top-level modules of a `pgm` command in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", CALL, *argv], capture_output=True, text=True, timeout=120, check=False
    )
    text, _, loaded = done.stdout.rpartition("LOADED ")
    return done.returncode, text + done.stderr, set(loaded.split())


@pytest.mark.parametrize("argv", [["--help"], ["--version"], *([name, "--help"] for name in VERBS)], ids=" ".join)
def test_help_works_shows_an_example_and_loads_nothing_heavy(argv: list[str]) -> None:
    code, text, loaded = call(*argv)
    assert code == 0, text
    assert "pgm_cli" in loaded
    assert not loaded & HEAVY
    if "--help" in argv:
        assert "example: pgm" in text.lower()


@pytest.mark.parametrize("name", VERBS)
def test_every_command_says_its_version(name: str) -> None:
    code, text, loaded = call(name, "--version")
    assert (code, text.split()[0]) == (0, "pgm")
    assert not loaded & HEAVY


NEEDED = dict.fromkeys(("ball3d", "view", "players", "caption", "pack", "stats"), ("work",)) | {
    "animate": ("run", "--prompt", "prompt.json", "--out", "work"),
    "evaluate": ("run", "dataset"),
    "render": ("run", "work", "--out", "video.mp4"),
    "play": ("run",),
}
"""Arguments that a verb does not go without."""


@pytest.mark.parametrize("name", VERBS)
def test_an_option_that_does_not_exist_is_a_usage_error_with_the_option_in_it(name: str) -> None:
    code, text, _ = call(name, *NEEDED.get(name, ()), "--no-such-option")
    assert code == 2
    assert "no-such-option" in text


def test_pgm_data_works_where_torch_is_not_installed(tmp_path: Path) -> None:
    """The arrows forbid torch in pgm_data's own text; this also finds one that a library would bring."""
    root = Path(__file__).resolve().parent.parent
    modules = sorted(
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        for path in (root / "pgm_data").rglob("*.py")
    )
    assert "pgm_data.scene" in modules
    block = (
        "import sys, importlib; sys.modules['torch'] = None\nfor name in sys.argv[1:]: importlib.import_module(name)"
    )
    done = subprocess.run(
        [sys.executable, "-c", block, *modules],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr


def test_annotated_shapes_are_executed_while_tests_run() -> None:
    assert skew(np.zeros((5, 3))).shape == (5, 3, 3)
    for wrong in (np.zeros(4), np.zeros(3, np.int64), [0.0, 0.0, 0.0]):
        with pytest.raises(TypeCheckError):
            rotation_from_rotvec(wrong)  # type: ignore[arg-type]
