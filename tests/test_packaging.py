"""The wheel brings our names and files, and no general ones."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
FOLDERS = {"pgm_cli": "cli", "pgm_data.schemas": "schemas"}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty folder into which the wheel, built from a copy of the sources, was installed."""
    source = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE", "pgm_data", "pgm_models", "cli", "schemas"):
        if (ROOT / name).exists():
            # Links, so that the sources are not copied and the build leaves nothing among them.
            (source / name).symlink_to(ROOT / name)
    wheels = tmp_path_factory.mktemp("wheels")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    run([sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(wheels), str(source)])
    (wheel,) = wheels.glob("*.whl")
    target = tmp_path_factory.mktemp("site")
    run([*pip, "install", "--no-deps", "--no-index", "--no-compile", "--target", str(target), str(wheel)])
    return target


def run(command: list[str], **more: str) -> str:
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, **more},
        cwd=more.get("PWD"),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_site_packages_gets_our_names_alone(site: Path) -> None:
    names = {path.name for path in site.iterdir() if not path.name.endswith(".dist-info")} - {"bin"}
    assert names == {"pgm_cli", "pgm_data", "pgm_models"}
    assert {path.name for path in (site / "bin").iterdir()} == set(PROJECT["project"]["scripts"])


@pytest.mark.parametrize(
    ("folder", "pattern", "installed"),
    [
        ("cli", "*.py", "pgm_cli"),
        ("pgm_data", "*.py", "pgm_data"),
        ("pgm_models", "*.py", "pgm_models"),
        ("schemas", "*.json", "pgm_data/schemas"),
        ("pgm_data/scenes", "*.yaml", "pgm_data/scenes"),
        ("pgm_data/detect/weights", "*.onnx", "pgm_data/detect/weights"),
        ("pgm_models/synthesis/play_page", "*.*", "pgm_models/synthesis/play_page"),
    ],
)
def test_every_file_of_the_sources_is_installed(site: Path, folder: str, pattern: str, installed: str) -> None:
    expected = {str(path.relative_to(ROOT / folder)) for path in (ROOT / folder).rglob(pattern)}
    assert expected, f"nothing in {folder}"
    assert expected == {str(path.relative_to(site / installed)) for path in (site / installed).rglob(pattern)} - (
        {str(path.relative_to(site / "pgm_data")) for path in (site / "pgm_data" / "schemas").rglob(pattern)}
        if installed == "pgm_data"
        else set()
    )


def test_every_package_of_the_sources_is_declared() -> None:
    declared = set(PROJECT["tool"]["setuptools"]["packages"])
    found = set(FOLDERS)
    for package in ("pgm_data", "pgm_models"):
        found |= {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / package).rglob("__init__.py")}
    assert declared == found


def test_the_licence_is_in_the_wheel(site: Path) -> None:
    (information,) = site.glob("pgm-*.dist-info")
    assert "Apache License" in (information / "licenses" / "LICENSE").read_text(encoding="utf-8")
    assert "License-Expression: Apache-2.0" in (information / "METADATA").read_text(encoding="utf-8")


def test_the_installed_commands_run_without_the_checkout(site: Path, tmp_path: Path) -> None:
    """Run from elsewhere, with the dependencies of this environment behind the wheel's own folder."""
    where = "import pgm_cli.main, pgm_data; print(pgm_cli.main.__file__, pgm_data.__file__)"
    path = os.pathsep.join([str(site), *(p for p in sys.path if p.endswith("site-packages"))])
    for script in PROJECT["project"]["scripts"]:
        text = run([sys.executable, str(site / "bin" / script), "--help"], PYTHONPATH=path, PWD=str(tmp_path))
        assert "usage: pgm" in text
    files = run([sys.executable, "-c", where], PYTHONPATH=path, PWD=str(tmp_path)).split()
    assert all(Path(file).is_relative_to(site) for file in files)
    scenes = "from pgm_data.scene import load_scene; print(load_scene('tennis').name)"
    assert run([sys.executable, "-c", scenes], PYTHONPATH=path).strip() == "tennis"


def test_no_extra_can_bring_torchvision_and_the_constraints_hold_torch() -> None:
    wanted = [*PROJECT["project"]["dependencies"], *sum(PROJECT["project"]["optional-dependencies"].values(), [])]
    assert not [line for line in wanted if line.startswith("torchvision")]
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").split("\n")
    assert "torch==2.13.0" in pins


def test_the_constraints_name_a_version_of_every_dependency() -> None:
    pinned = {line.partition("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().split("\n")}
    for line in PROJECT["project"]["dependencies"] + PROJECT["project"]["optional-dependencies"]["test"]:
        name = line.partition(">")[0].partition("[")[0].partition("=")[0].lower()
        assert name in pinned, name


def test_continuous_integration_runs_make_test() -> None:
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert text.rstrip().endswith("make test")
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
