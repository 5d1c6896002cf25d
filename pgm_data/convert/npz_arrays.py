"""Arrays of somebody else's .npz file: read only after their headers were found to be plain numbers of a fair size."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

LARGEST_BYTES = 2**30
"""Of the arrays that are read, together, unpacked."""
MOST_ARRAYS = 256
KINDS = "fiubUS"
"""Numpy's letters for numbers, truth values and texts: everything else could hold objects."""


@dataclass(frozen=True, kw_only=True)
class ArrayHeader:
    """What an array of the file says of itself."""

    dtype: np.dtype
    shape: tuple[int, ...]

    @property
    def bytes(self) -> int:
        """Size unpacked."""
        size = self.dtype.itemsize
        for side in self.shape:
            size *= side
        return size


def read_npz(path: Path, wanted: frozenset[str]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Those of the wanted arrays that the file has, and the names of all of its arrays.

    No object is ever unpickled; arrays that are not wanted are not read.

    Raises:
        ValueError: If it is no .npz file, a wanted array holds objects or is no array, or they are too large. Says what
            was expected and found.
    """
    try:
        with zipfile.ZipFile(path) as file:
            members = file.infolist()
            if len(members) > MOST_ARRAYS:
                raise ValueError(f"expected at most {MOST_ARRAYS} arrays, got {len(members)}")
            names = [member.filename.removesuffix(".npy") for member in members]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"expected each array once, got {twice!r} again")
            headers = {n: _header(file, m, n) for n, m in zip(names, members, strict=True) if n in wanted}
            total = sum(header.bytes for header in headers.values())
            if total > LARGEST_BYTES:
                raise ValueError(f"expected at most {LARGEST_BYTES} bytes of arrays, got {total}")
            return {name: _array(file, name) for name in headers}, tuple(names)
    except (zipfile.BadZipFile, OSError, EOFError, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"{path}: expected an .npz file, got: {error}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _header(file: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> ArrayHeader:
    with file.open(member) as stream:
        try:
            version = np.lib.format.read_magic(stream)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(stream)
            before = stream.tell()
        except ValueError as error:
            raise ValueError(f"{name}: expected an array, got: {str(error)[:100]}") from error
    header = ArrayHeader(dtype=dtype, shape=shape)
    if dtype.kind not in KINDS:
        what = "pickled objects, which are never loaded" if dtype.hasobject else f"values of type {dtype}"
        raise ValueError(f"{name}: expected numbers or text, got {what}")
    if member.file_size - before != header.bytes:
        got = f"{member.file_size - before} bytes for a shape of {shape} of {dtype}"
        raise ValueError(f"{name}: expected {header.bytes} bytes, got {got}")
    return header


def _array(file: zipfile.ZipFile, name: str) -> np.ndarray:
    member = f"{name}.npy" if f"{name}.npy" in file.namelist() else name
    with file.open(member) as stream:
        return np.lib.format.read_array(stream, allow_pickle=False)


def floats(place: str, value: np.ndarray) -> np.ndarray:
    """The array as float64.

    Raises:
        ValueError: If it holds texts or truth values, or infinities.
    """
    if value.dtype.kind not in "fiu":
        raise ValueError(f"{place}: expected numbers, got {value.dtype}")
    result = value.astype(np.float64)
    if np.isinf(result).any():
        raise ValueError(f"{place}: expected finite numbers or NaN, got infinity")
    return result


def texts(value: np.ndarray) -> tuple[str, ...]:
    """The array's texts, flat; bytes as UTF-8."""
    return tuple(v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in value.ravel().tolist())
