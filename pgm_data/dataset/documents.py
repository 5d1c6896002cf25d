"""JSON and YAML documents of the contract, validated on the way out and on the way in."""

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import jsonschema
import yaml

from pgm_data.dataset.document_schemas import PATTERN_WORDS, document_schema
from pgm_data.dataset.files import whole_file

LARGEST_DOCUMENT = 64 * 2**20
"""Bytes above which a document is not read: ours are a few kilobytes."""

YAML_SUFFIXES = frozenset({".yaml", ".yml"})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One way in which a value misses its schema."""

    field: str
    """Where, such as `camera.position_world[2]`; empty for the document itself."""
    expected: str
    found: str


def write_document(path: Path, kind: str, value: dict) -> None:
    """Write the document as YAML or JSON by its suffix, whole or not at all.

    Raises:
        ValueError: If the value does not hold to the schema of its kind.
    """
    try:
        plain = json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: {kind}: expected JSON values (strings, finite numbers, lists), got: {error}"
        ) from error
    _refuse(path, kind, document_faults(kind, plain))
    if path.suffix in YAML_SUFFIXES:
        content = yaml.safe_dump(plain, sort_keys=False, allow_unicode=True)
    else:
        content = json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with whole_file(path) as temporary:
        temporary.write_text(content, encoding="utf-8")


def read_document(path: Path, kind: str) -> dict:
    """The document at the path.

    Raises:
        ValueError: If it cannot be parsed or does not hold to the schema of its kind.
    """
    value = parse_document(path)
    _refuse(path, kind, document_faults(kind, value))
    return value


def _refuse(path: Path, kind: str, faults: tuple[Fault, ...]) -> None:
    if faults:
        first = faults[0]
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ValueError(
            f"{path}: {kind}: {first.field or 'document'}: expected {first.expected}, got {first.found}{more}"
        )


def parse_document(path: Path) -> Any:
    """The value of a JSON or YAML file, by its suffix, unvalidated.

    Only plain data is built. Repeated keys, NaN, infinities and YAML aliases (which can grow without
    bound) are refused.

    Raises:
        ValueError: If the file is too large or not such a document.
    """
    try:
        if not path.is_file():
            raise ValueError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_DOCUMENT:
            raise ValueError(f"{path.stat().st_size} bytes, more than {LARGEST_DOCUMENT}")
        content = path.read_text(encoding="utf-8")
        return _parse_yaml(content) if path.suffix in YAML_SUFFIXES else _parse_json(content)
    except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
        form = "YAML" if path.suffix in YAML_SUFFIXES else "JSON"
        said = " ".join(str(error).split())
        raise ValueError(f"{path}: expected a {form} document, got: {said or type(error).__name__}") from error


def _parse_json(content: str) -> Any:
    def pairs(items: list[tuple[str, Any]]) -> dict:
        return _without_repeats(items)

    def constant(name: str) -> NoReturn:
        raise ValueError(f"{name}, which JSON does not have")

    return json.loads(content, object_pairs_hook=pairs, parse_constant=constant, parse_float=_finite)


def _finite(literal: str) -> float:
    value = float(literal)
    if not math.isfinite(value):
        raise ValueError(f"{literal}, which float64 cannot hold")
    return value


def _without_repeats(items: list[tuple[Any, Any]]) -> dict:
    result = {}
    for key, value in items:
        if not isinstance(key, str):
            raise ValueError(f"a key that is no string: {key!r}")
        if key in result:
            raise ValueError(f"the key {key!r} twice")
        result[key] = value
    return result


class _PlainLoader(yaml.SafeLoader):
    """Builds plain data only, and refuses aliases, repeated keys and numbers that are not finite."""

    def compose_node(self, parent, index):
        if self.check_event(yaml.events.AliasEvent):
            raise ValueError("an alias, which these documents may not hold")
        return super().compose_node(parent, index)

    def construct_mapping(self, node, deep=False):
        return _without_repeats(
            [(self.construct_object(k, deep=True), self.construct_object(v, deep=True)) for k, v in node.value]
        )

    def construct_plain_map(self, node):
        return self.construct_mapping(node, deep=True)

    def construct_finite(self, node):
        value = super().construct_yaml_float(node)
        if not math.isfinite(value):
            raise ValueError(f"{node.value}, which is no finite number")
        return value


_PlainLoader.add_constructor("tag:yaml.org,2002:map", _PlainLoader.construct_plain_map)
_PlainLoader.add_constructor("tag:yaml.org,2002:float", _PlainLoader.construct_finite)


def _parse_yaml(content: str) -> Any:
    return yaml.load(content, Loader=_PlainLoader)


@cache
def _validator(kind: str) -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(document_schema(kind))


def document_faults(kind: str, value: Any) -> tuple[Fault, ...]:
    """Every way in which the value misses the schema of its kind, in the order of its fields.

    Raises:
        ValueError: If there is no such kind.
    """
    errors = sorted(_validator(kind).iter_errors(value), key=lambda error: [str(part) for part in error.absolute_path])
    return tuple(fault for error in errors for fault in _faults(error))


def _faults(error: jsonschema.ValidationError) -> list[Fault]:
    rule = str(error.validator)
    value: Any = error.instance
    bound: Any = error.validator_value
    schema: Any = error.schema if isinstance(error.schema, dict) else {}
    path = list(error.absolute_path)
    if rule == "required":
        absent = [name for name in bound if name not in value and repr(name) in error.message]
        return [Fault(field=_field([*path, name]), expected="the field", found="none") for name in absent]
    if rule == "additionalProperties":
        known = f"one of the fields {', '.join(schema['properties'])}"
        extra = [name for name in value if name not in schema["properties"]]
        return [Fault(field=_field([*path, name]), expected=known, found=_shown(name)) for name in extra]
    expected = _expected(rule, bound, schema)
    meaning = f" ({schema['description']})" if "description" in schema else ""
    return [Fault(field=_field(path), expected=expected + meaning, found=_shown(value))]


def _expected(rule: str, bound: Any, schema: dict) -> str:
    words = {
        "type": lambda: " or ".join(bound) if isinstance(bound, list) else str(bound),
        "enum": lambda: "one of " + ", ".join("null" if word is None else str(word) for word in bound),
        "pattern": lambda: PATTERN_WORDS.get(bound, f"a text like {bound}"),
        "minimum": lambda: f"at least {bound}",
        "exclusiveMinimum": lambda: f"above {bound}",
        "maximum": lambda: f"at most {bound}",
        "minLength": lambda: f"at least {bound} characters",
        "minItems": lambda: f"{'' if 'maxItems' in schema else 'at least '}{bound} items",
        "maxItems": lambda: f"{bound} items",
        "minProperties": lambda: f"at least {bound} entries",
        "uniqueItems": lambda: "no item twice",
    }
    return words[rule]() if rule in words else "no such field here"


def _field(path: list) -> str:
    name = ""
    for part in path:
        name += f"[{part}]" if isinstance(part, int) else f".{part}" if name else str(part)
    return name


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"{len(value)} items: {repr(value)[:60]}" if len(repr(value)) > 60 else repr(value)
    return repr(value) if len(repr(value)) <= 80 else repr(value)[:77] + "..."
