"""`pgm info` says what is installed, for a person and for a program."""

import hashlib
import json
from pathlib import Path

import pytest
import torch
from pgm_cli import info

import pgm_data
from pgm_data.scene import load_scene


def test_the_json_document_names_versions_devices_scenes_extras_and_weights(capsys: pytest.CaptureFixture[str]) -> None:
    assert info.main(["--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["versions"]["torch"] == torch.__version__
    assert found["devices"]["torch"][0] == "cpu"
    assert "CPUExecutionProvider" in found["devices"]["onnxruntime"]
    assert {"tennis", "blocks"} <= set(found["scenes"])
    assert all(load_scene(name).name == name for name in found["scenes"])
    assert set(found["extras"]) == {"text", "export", "dask", "viz", "pose", "hf"}
    folder = Path(pgm_data.__file__).parent / "detect" / "weights"
    assert {entry["name"] for entry in found["weights"]} == {path.name for path in folder.glob("*.onnx")}
    for entry in found["weights"]:
        data = (folder / entry["name"]).read_bytes()
        assert (entry["bytes"], entry["sha256"]) == (len(data), hashlib.sha256(data).hexdigest())


def test_the_tables_hold_what_the_document_holds(capsys: pytest.CaptureFixture[str]) -> None:
    assert info.main([]) == 0
    text = capsys.readouterr().out
    found = info.installation()
    for word in (*found.versions.values(), *found.scenes, *(entry.sha256 for entry in found.weights)):
        assert word in text


def test_the_extras_are_those_of_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(info, "find_spec", lambda name: None if name == "viser" else object())
    assert [name for name, there in info.installation().extras.items() if not there] == ["viz"]
