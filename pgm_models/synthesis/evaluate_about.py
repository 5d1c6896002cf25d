"""What a run's files say of it, read without loading anything: a command asks before it knows what it will need."""

import json
from pathlib import Path
from typing import Any

HEADER_BYTES = 8
"""Of the length of a safetensors file's header, little end first."""
MOST_BYTES = 100_000_000
"""Of a header; more is no such file."""


def about_run(run: Path) -> dict[str, Any] | None:
    """What a synthesis run's model file, or else its checkpoint, says of it; None where it is no synthesis run.

    Args:
        run: Folder of a run, or a model file.
    """
    # Of a finished run the model's file, whose name comes later, before the checkpoint.
    paths = [run] if run.is_file() else sorted(run.glob("*.safetensors"), reverse=True) if run.is_dir() else []
    for path in paths:
        told = _metadata(path)
        if "pgm_synthesis" in told:
            return _object(told.get("about", "{}"))
        task = _object(told.get("options", "{}")).get("task")
        if isinstance(task, dict) and "fields" in (task.get("model") or {}):
            return {"step": int(told["step"]), "elapsed_s": float(told["elapsed_s"]), **task}
    return None


def _metadata(path: Path) -> dict[str, str]:
    """Of a safetensors file; none of another one."""
    with path.open("rb") as file:
        length = int.from_bytes(file.read(HEADER_BYTES), "little")
        if not 0 < length < MOST_BYTES:
            return {}
        try:
            found = json.loads(file.read(length)).get("__metadata__", {})
        except (ValueError, AttributeError):
            return {}
    return found if isinstance(found, dict) else {}


def _object(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
