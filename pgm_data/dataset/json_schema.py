"""Parts that the JSON Schemas (2020-12) of the contract are made of."""

from collections.abc import Mapping, Sequence
from typing import Any

Schema = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def text(meaning: str, pattern: str = "", one_of: Sequence[str] = (), least: int = 0) -> Schema:
    """Schema of a string."""
    schema: Schema = {"type": "string", "description": meaning}
    if pattern:
        schema["pattern"] = pattern
    if one_of:
        schema["enum"] = list(one_of)
    if least:
        schema["minLength"] = least
    return schema


def number(
    meaning: str, *, low: float | None = None, above: float | None = None, high: float | None = None, kind="number"
) -> Schema:
    """Schema of a number within bounds."""
    bounds = {"minimum": low, "exclusiveMinimum": above, "maximum": high}
    return {"type": kind, "description": meaning} | {k: v for k, v in bounds.items() if v is not None}


def integer(meaning: str, *, low: int | None = None, high: int | None = None) -> Schema:
    """Schema of an integer within bounds."""
    return number(meaning, low=low, high=high, kind="integer")


def array(meaning: str, items: Schema, length: int | None = None, least: int = 0) -> Schema:
    """Schema of an array of equal items, of exactly or at least so many."""
    schema: Schema = {"type": "array", "description": meaning, "items": items}
    if length is not None:
        schema |= {"minItems": length, "maxItems": length}
    elif least:
        schema["minItems"] = least
    return schema


def numbers(meaning: str, length: int) -> Schema:
    """Schema of an array of so many numbers."""
    return array(meaning, {"type": "number"}, length)


def record(meaning: str, required: Mapping[str, Schema], optional: Mapping[str, Schema] | None = None) -> Schema:
    """Schema of an object with these fields and no other."""
    return {
        "type": "object",
        "description": meaning,
        "properties": dict(required) | dict(optional or {}),
        "required": list(required),
        "additionalProperties": False,
    }


def mapping(meaning: str, values: Schema, names: str, least: int = 0) -> Schema:
    """Schema of an object of like values under free names that match the pattern."""
    schema: Schema = {
        "type": "object",
        "description": meaning,
        "propertyNames": {"pattern": names},
        "additionalProperties": values,
    }
    return schema | ({"minProperties": least} if least else {})


def nullable(schema: Schema) -> Schema:
    """The schema, or null where the value is unknown."""
    return schema | {"type": [schema["type"], "null"]}
