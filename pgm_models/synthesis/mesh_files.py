"""Meshes out of Wavefront OBJ, STL and PLY files, read as numbers and nothing else.

Coordinates are taken as metres. Vertices at the same place become one, as STL knows no others and other programs part
them at seams. Polygons are cut into the triangles that share their first corner, which is right for convex ones.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_models.synthesis.meshes import Mesh, welded

MOST_BYTES = 64 << 20
"""A larger file is refused."""
MOST_TRIANGLES = 500_000
"""The same of one with more."""
MOST_CORNERS = 1024
"""Of a polygon."""
OBJ_SILENT = frozenset("# vt vn vp g o s usemtl mtllib l p".split())
"""Words of an OBJ file that say nothing about triangles."""
STL_HEADER, STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
PLY_NUMBERS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"},
    **{"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"},
}


def read_mesh(path: Path) -> Mesh:
    """The mesh that a file holds; its name's end says which kind it is.

    Raises:
        ValueError: If it is no OBJ, STL or PLY file, is too large, or does not hold what it must; names file and place.
            Whether the mesh is watertight is asked by what needs to know.
        OSError: If it cannot be read.
    """
    readers = {".obj": _obj, ".stl": _stl, ".ply": _ply}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{path}: expected a file named .obj, .stl or .ply")
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path}: expected at most {MOST_BYTES >> 20} MiB, got more")
    try:
        vertices, triangles = reader(data)
        if len(triangles) > MOST_TRIANGLES:
            raise ValueError(f"triangles: expected at most {MOST_TRIANGLES}, got {len(triangles)}")
        return welded(vertices, triangles)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"expected text, got byte {data[error.start]} at {error.start}") from error


def _cut(polygons: list[list[int]]) -> np.ndarray:
    """Triangles of polygons of three corners or more."""
    fans = [(corners[0], b, c) for corners in polygons for b, c in zip(corners[1:-1], corners[2:], strict=True)]
    return np.array(fans, dtype=np.int64).reshape(-1, 3)


def _obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for number, line in enumerate(_text(data).replace("\\\n", " ").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if not words or words[0] in OBJ_SILENT:
            continue
        if words[0] == "v" and len(words) >= 4:
            vertices.append([_number(word, f"line {number}") for word in words[1:4]])
        elif words[0] == "f" and len(words) >= 4:
            polygons.append([_obj_corner(word, len(vertices), f"line {number}") for word in words[1:]])
        else:
            raise ValueError(
                f"line {number}: expected a vertex (v x y z) or a face (f a b c ...), got {line.strip()!r}"
            )
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), _cut(polygons)


def _obj_corner(word: str, known: int, place: str) -> int:
    """Row of a corner: counted from 1, or back from the last vertex with -1."""
    try:
        index = int(word.split("/")[0])
    except ValueError as error:
        raise ValueError(f"{place}: expected a corner such as 3 or 3/1/2, got {word!r}") from error
    row = index - 1 if index > 0 else known + index
    if index == 0 or not 0 <= row < known:
        raise ValueError(f"{place}: expected a vertex of the {known} before it, got {index}")
    return row


def _number(word: str, place: str) -> float:
    try:
        return float(word)
    except ValueError as error:
        raise ValueError(f"{place}: expected a number, got {word!r}") from error


def _stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    # Binary files may begin with the word of text ones: their length decides.
    count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little") if len(data) >= STL_HEADER else -1
    if count >= 0 and len(data) == STL_HEADER + count * STL_FACET.itemsize:
        corners = np.frombuffer(data, dtype=STL_FACET, offset=STL_HEADER)["corners"].reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _stl_text(_text(data))
    else:
        raise ValueError(f"expected text that begins with solid, or {count} binary facets, got {len(data)} bytes")
    return corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3)


def _stl_text(text: str) -> np.ndarray:
    corners: list[list[float]] = []
    inside = 0
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if words[0] == "vertex":
            if len(words) != 4:
                raise ValueError(f"line {number}: expected vertex x y z, got {line.strip()!r}")
            corners.append([_number(word, f"line {number}") for word in words[1:]])
            inside += 1
        elif words[0] == "endloop":
            if inside != 3:
                raise ValueError(f"line {number}: expected a facet of 3 corners, got {inside}")
            inside = 0
        elif words[0] not in ("solid", "facet", "outer", "endfacet", "endsolid"):
            raise ValueError(f"line {number}: expected a facet, got {line.strip()!r}")
    if inside:
        raise ValueError(f"expected the last facet to end, got a file that stops after {inside} of its corners")
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Element:
    """A kind of row of a PLY file."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]
    """Name, kind of number, and of lists the kind of number that says how many follow."""


def _ply(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    head, mark, rest = data.partition(b"end_header")
    if not head.startswith(b"ply") or not mark:
        raise ValueError("expected a header from ply to end_header, got none")
    form, elements = _ply_header(_text(head))
    _, _, body = rest.partition(b"\n")
    source = _PlyText(body) if form == "ascii" else _PlyBytes(body, "<" if form == "binary_little_endian" else ">")
    names = [element.name for element in elements]
    if not {"vertex", "face"} <= set(names):
        raise ValueError(f"expected elements vertex and face, got {', '.join(names) or 'none'}")
    found = {}
    for element in elements[: max(names.index("vertex"), names.index("face")) + 1]:
        found[element.name] = _ply_faces(element, source) if element.name == "face" else _ply_rows(element, source)
    vertex = elements[names.index("vertex")]
    own = [name for name, *_ in vertex.properties]
    if not {"x", "y", "z"} <= set(own):
        raise ValueError(f"vertex: expected properties x, y and z, got {', '.join(own) or 'none'}")
    vertices = found["vertex"][:, [own.index(axis) for axis in "xyz"]]
    stray = [
        row for row in (found["face"].min(initial=0), found["face"].max(initial=0)) if not 0 <= row < len(vertices)
    ]
    if stray:
        raise ValueError(f"face: expected vertices 0 to {len(vertices) - 1}, got {stray[0]}")
    return vertices, found["face"]


def _ply_header(head: str) -> tuple[str, list[_Element]]:
    form, elements = "", []
    for number, line in enumerate(head.splitlines(), start=1):
        match line.split():
            case ["ply"] | [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", "ascii" | "binary_little_endian" | "binary_big_endian" as form, "1.0"]:
                pass
            case ["element", name, count] if count.isdecimal():
                elements.append(_Element(name=name, count=int(count), properties=[]))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= set(PLY_NUMBERS):
                elements[-1].properties.append((name, PLY_NUMBERS[kind], PLY_NUMBERS[length]))
            case ["property", kind, name] if elements and kind in PLY_NUMBERS:
                elements[-1].properties.append((name, PLY_NUMBERS[kind], None))
            case _:
                raise ValueError(f"line {number}: expected a line of a PLY header, got {line.strip()!r}")
    if not form:
        raise ValueError("expected a format of ascii, binary_little_endian or binary_big_endian 1.0, got none")
    return form, elements


class _PlyBytes:
    """Numbers of the body of a binary file, in order."""

    def __init__(self, body: bytes, order: str) -> None:
        self.body, self.order, self.at = body, order, 0

    def rows(self, kinds: list[str], count: int) -> np.ndarray:
        """The next rows of numbers of those kinds."""
        row = np.dtype([(f"{place}", self.order + kind) for place, kind in enumerate(kinds)])
        if self.at + count * row.itemsize > len(self.body):
            raise ValueError(f"expected {count} rows of {row.itemsize} bytes, got {len(self.body) - self.at} bytes")
        table = np.frombuffer(self.body, dtype=row, count=count, offset=self.at)
        self.at += count * row.itemsize
        return np.stack([table[name].astype(np.float64) for name in row.names or ()], axis=1)


class _PlyText:
    """Numbers of the body of a text file, in order."""

    def __init__(self, body: bytes) -> None:
        self.words, self.at = _text(body).split(), 0

    def rows(self, kinds: list[str], count: int) -> np.ndarray:
        """The next rows of numbers."""
        wanted = count * len(kinds)
        if self.at + wanted > len(self.words):
            raise ValueError(f"expected {wanted} more numbers, got {len(self.words) - self.at}")
        words = self.words[self.at : self.at + wanted]
        self.at += wanted
        try:
            return np.array(words, dtype=np.float64).reshape(count, len(kinds))
        except ValueError as error:
            raise ValueError(f"expected numbers, got {words[:4]}") from error


def _ply_rows(element: _Element, source: _PlyBytes | _PlyText) -> np.ndarray:
    """Rows of an element without lists; one with lists is passed over."""
    if not element.properties:
        raise ValueError(f"{element.name}: expected properties, got none")
    if all(length is None for *_, length in element.properties):
        return source.rows([kind for _, kind, _ in element.properties], element.count)
    for _ in range(element.count):
        for _, kind, length in element.properties:
            _ply_list(source, kind, length)
    return np.zeros((0, len(element.properties)))


def _ply_list(source: _PlyBytes | _PlyText, kind: str, length: str | None) -> np.ndarray:
    """The next property of a row."""
    if length is None:
        return source.rows([kind], 1)[0]
    count = source.rows([length], 1)[0, 0]
    if not (0 <= count <= MOST_CORNERS and count == int(count)):
        raise ValueError(f"expected a list of 0 to {MOST_CORNERS} numbers, got one of {count:g}")
    return source.rows([kind], int(count))[:, 0] if count else np.zeros(0)


def _ply_faces(element: _Element, source: _PlyBytes | _PlyText) -> np.ndarray:
    """Triangles of the faces."""
    names = [name for name, *_ in element.properties]
    place = next((names.index(name) for name in ("vertex_indices", "vertex_index") if name in names), None)
    if place is None or element.properties[place][2] is None:
        raise ValueError(f"face: expected a list vertex_indices or vertex_index, got {', '.join(names) or 'none'}")
    polygons = []
    for number in range(element.count):
        corners = [_ply_list(source, kind, length) for _, kind, length in element.properties][place]
        if len(corners) < 3:
            raise ValueError(f"face {number}: expected 3 corners or more, got {len(corners)}")
        if not (np.isfinite(corners).all() and (corners == np.rint(corners)).all()):
            raise ValueError(f"face {number}: expected numbers of vertices, got {corners.tolist()}")
        polygons.append([int(corner) for corner in corners])
    return _cut(polygons)
