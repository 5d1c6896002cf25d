"""The folder `schemas`: the contract for any language, written from what the code itself uses.

``python -m pgm_data.dataset.schemas --out schemas`` writes it; a test guards it against drift.
"""

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pgm_data.dataset.columns import PLAYER, SCHEMA_VERSION, TABLES, Column, Table
from pgm_data.dataset.dataset_columns import DATA
from pgm_data.dataset.document_schemas import document_kinds, document_schema
from pgm_data.dataset.files import whole_file

COUNT_SYMBOLS = {"": "", "keypoints": "K", "joints": "J"}
"""Letters for the counts that a skeleton fixes, as in 2K and 3J."""


def schema_files() -> dict[str, dict[str, Any]]:
    """Content of every schema file by its path below the folder, with forward slashes."""
    documents: dict[str, dict[str, Any]] = {f"{kind}.json": document_schema(kind) for kind in document_kinds()}
    tables = (*TABLES.values(), DATA)
    return documents | {f"tables/{table.name}.json": table_description(table) for table in tables}


def table_description(table: Table) -> dict[str, Any]:
    """The table and its columns in plain data; columns of player objects once, with a pattern for their names."""
    return {
        "table": table.name,
        "schema_version": SCHEMA_VERSION,
        "row": table.row,
        "frame_aligned": table.frame_aligned,
        "when": f"the scene declares {table.needs}" if table.needs else "always",
        "columns": [_column_description(column) for column in table.columns],
    }


def _column_description(column: Column) -> dict[str, Any]:
    length = f"{column.size}{COUNT_SYMBOLS[column.per]}".removeprefix("1" if column.per else "")
    described: dict[str, Any] = {
        "name": column.name,
        "arrow_type": f"fixed_size_list<{column.type}>[{length}]" if column.size else column.type,
        "shape": [length if column.per else column.size] if column.size else [],
        "unit": column.unit,
        "frame": column.frame,
        "meaning": column.meaning,
        "when": column.when,
    }
    if column.name.startswith(f"{PLAYER}."):
        own = column.name.removeprefix(PLAYER)
        described["name"] = f"<player object>{own}"
        described["name_pattern"] = f"^[a-z][a-z0-9_]*{re.escape(own)}$"
        symbols = "; K = keypoints and J = joints of its skeleton" if column.per else ""
        described["when"] = f"for each player object of the scene, {column.when}{symbols}"
    if column.allowed:
        described["allowed"] = list(column.allowed)
    if column.optional:
        described["optional"] = True
    return described


def schema_text(content: dict[str, Any]) -> str:
    """The content of one schema file as it is written."""
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def write_schemas(folder: Path) -> tuple[Path, ...]:
    """Write every schema file below the folder and return their paths; files that no schema has are left alone."""
    paths = []
    for name, content in schema_files().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as temporary:
            temporary.write_text(schema_text(content), encoding="utf-8")
        paths.append(path)
    return tuple(paths)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the schemas; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    for path in write_schemas(parser.parse_args(argv).out):
        print(path)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
