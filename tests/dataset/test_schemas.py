import json
import re
from pathlib import Path

import jsonschema
import pytest

from pgm_data.dataset.columns import arrow_schema, scene_tables
from pgm_data.dataset.document_schemas import document_kinds, document_schema
from pgm_data.dataset.schemas import main, schema_files, schema_text
from pgm_data.scene import load_scene, scene_names

FOLDER = Path(__file__).resolve().parents[2] / "schemas"


def test_the_folder_schemas_is_what_the_code_says():
    written = {path.relative_to(FOLDER).as_posix(): path.read_text("utf-8") for path in FOLDER.rglob("*.json")}
    generated = {name: schema_text(content) for name, content in schema_files().items()}
    assert set(written) == set(generated)
    stale = [name for name in generated if written[name] != generated[name]]
    assert not stale, f"run: python -m pgm_data.dataset.schemas --out schemas (stale: {stale})"


def test_writing_gives_exactly_these_files(tmp_path, capsys):
    assert main(["--out", str(tmp_path / "schemas")]) == 0
    written = {p.relative_to(tmp_path / "schemas").as_posix() for p in tmp_path.rglob("*.json")}
    assert written == set(schema_files())
    assert len(capsys.readouterr().out.splitlines()) == len(written)


@pytest.mark.parametrize("kind", document_kinds())
def test_documents_have_valid_schemas_of_2020_12(kind):
    schema = document_schema(kind)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    jsonschema.Draft202012Validator.check_schema(schema)


def objects_of(schema: dict):
    """Every schema of an object with named fields within the schema."""
    if isinstance(schema, dict):
        if "properties" in schema and schema.get("type") == "object":
            yield schema
        for value in schema.values():
            yield from objects_of(value)


@pytest.mark.parametrize("kind", document_kinds())
def test_named_fields_admit_no_others_and_say_what_they_mean(kind):
    for schema in objects_of(document_schema(kind)):
        foreign = kind == "dataset_info" and (
            "codebase_version" in schema["properties"] or "dtype" in schema["properties"]
        )
        assert foreign or schema["additionalProperties"] is False  # LeRobot may add keys to its own part
        assert set(schema["required"]) <= set(schema["properties"])


@pytest.mark.parametrize("scene", scene_names())
def test_table_files_describe_the_arrow_schemas_of_every_scene(scene):
    loaded = load_scene(scene)
    skeleton = loaded.players[0].skeleton
    assert skeleton is not None
    counts = {"K": len(skeleton.keypoint_names), "J": len(skeleton.joint_names)}
    files = schema_files()
    for table in scene_tables(loaded):
        described = files[f"tables/{table}.json"]["columns"]
        for field in arrow_schema(table, loaded):
            (column,) = [
                c for c in described if re.match(c.get("name_pattern", f"^{re.escape(c['name'])}$"), field.name)
            ]
            sizes = [
                int(length[:-1] or 1) * counts[length[-1]] if isinstance(length, str) else length
                for length in column["shape"]
            ]
            assert sizes == ([field.type.list_size] if sizes else [])
            scalar = str(field.type.value_type if sizes else field.type)
            assert column["arrow_type"].removeprefix("fixed_size_list<").split(">")[0] == scalar
            assert column["unit"].encode() == field.metadata[b"unit"]
            assert column["frame"].encode() == field.metadata[b"frame"]
            assert column["meaning"]
            assert column["when"]


def test_schema_files_are_plain_json():
    for content in schema_files().values():
        assert json.loads(schema_text(content)) == content
