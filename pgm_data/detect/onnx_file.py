"""Networks in ONNX files: those that ship with the package and any other."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from onnxruntime import InferenceSession


@contextmanager
def network_file(path: Path | None, *, shipped: str, what: str) -> Iterator[Path]:
    """The file at that path, or the one of that name that ships with the package where the path is None.

    `what` says in errors which network is meant.

    Raises:
        FileNotFoundError: If there is no such file.
    """
    if path is not None:
        if not path.is_file():
            raise FileNotFoundError(f"{what}: expected a file at {path}, found none")
        yield path
        return
    inside = files("pgm_data.detect").joinpath("weights", shipped)
    if not shipped or not inside.is_file():
        raise FileNotFoundError(f"{what}: expected the file {shipped!r} in the package's folder {inside}, found none")
    with as_file(inside) as file:
        yield file


def open_network(path: Path, *, threads: int, what: str) -> "InferenceSession":
    """A session that runs the network in that file.

    Raises:
        ValueError: If it is no ONNX file, or a broken one.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(os.fspath(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises classes of its own that share no base but this one.
        raise ValueError(f"{what} {path}: expected an ONNX file, found what onnxruntime refuses: {error}") from error
