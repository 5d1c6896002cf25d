import json

import pytest
from pgm_cli.main import run

from pgm_data.scene import scene_text
from tests.dataset.work_folders import write_work


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return write_work(tmp_path_factory.mktemp("check") / "work")


def test_a_sound_folder_is_exit_0(work, capsys):
    assert run(["check", str(work)]) == 0
    assert capsys.readouterr().out == "16 files checked: all well\n"


def test_violations_are_exit_5_and_all_listed(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text(scene_text("tennis").replace("position: fixed", f"position: {name}"))
    assert run(["check", str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml")]) == 5
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    for name, line in zip("ab", lines, strict=False):
        assert line.startswith(f"{tmp_path}/{name}.yaml: camera.position: expected one of fixed, moving")
        assert line.endswith(f"got '{name}'")
    assert lines[2] == "2 files checked: 2 violations"


def test_json_says_the_same(tmp_path, work, capsys):
    assert run(["check", str(work), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["violations"] == []
    path = tmp_path / "clip.json"
    path.write_text("{}")
    assert run(["check", str(path), "--json"]) == 5
    said = json.loads(capsys.readouterr().out)
    assert said["files"] == [str(path)]
    assert {"path": str(path), "field": "n_frames", "expected": "the field", "found": "none"} in said["violations"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "PATH"),
        (["nowhere"], "PATH"),
        (["--kind", "thing", "."], "--kind"),
        (["--scene", "curling", "."], "--scene"),
        (["--colour", "."], "--colour"),
    ],
)
def test_wrong_use_is_exit_2_and_names_the_option(arguments, named, capsys):
    assert run(["check", *arguments]) == 2
    captured = capsys.readouterr()
    assert named in captured.err + captured.out


def test_a_scene_file_of_ones_own_is_taken(tmp_path, work, capsys):
    mine = tmp_path / "mine.yaml"
    mine.write_text(scene_text("tennis"))
    assert run(["check", "--scene", str(mine), str(work)]) == 0
    assert run(["check", "--kind", "scene", str(mine)]) == 0
    capsys.readouterr()
