import struct

import numpy as np
import pytest

from pgm_models.synthesis import mesh_files
from pgm_models.synthesis.mesh_files import read_mesh
from pgm_models.synthesis.meshes import Mesh, solids_of

VERTICES = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 0.5]], dtype=float)
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def as_obj() -> bytes:
    lines = ["# a tetrahedron", "mtllib none.mtl", "o tetra", *(f"v {x} {y} {z}" for x, y, z in VERTICES), "vn 0 0 1"]
    lines += [f"f {a + 1}/1/1 {b + 1}//1 {c - 4}" for a, b, c in TRIANGLES]
    return "\n".join(lines).encode()


def as_text_stl() -> bytes:
    lines = ["solid tetra"]
    for triangle in TRIANGLES:
        corners = [f"vertex {x:e} {y:e} {z:e}" for x, y, z in VERTICES[triangle]]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid tetra"]).encode()


def as_binary_stl() -> bytes:
    facets = [struct.pack("<12fH", 0, 0, 0, *VERTICES[triangle].ravel(), 0) for triangle in TRIANGLES]
    return b"solid said wrongly".ljust(80, b"\0") + struct.pack("<I", len(facets)) + b"".join(facets)


def ply_header(form: str) -> str:
    return (
        f"ply\nformat {form} 1.0\ncomment made here\nelement vertex 4\nproperty float x\nproperty uchar red\n"
        "property float y\nproperty float z\nelement face 4\nproperty int flag\n"
        "property list uchar int vertex_indices\nelement edge 1\nproperty int vertex1\nend_header\n"
    )


def as_text_ply() -> bytes:
    rows = [f"{x} 200 {y} {z}" for x, y, z in VERTICES] + [f"7 3 {a} {b} {c}" for a, b, c in TRIANGLES]
    return (ply_header("ascii") + "\n".join([*rows, "0"])).encode()


def as_binary_ply(order: str) -> bytes:
    form = "binary_little_endian" if order == "<" else "binary_big_endian"
    body = b"".join(struct.pack(f"{order}fBff", x, 200, y, z) for x, y, z in VERTICES)
    body += b"".join(struct.pack(f"{order}iB3i", 7, 3, *triangle) for triangle in TRIANGLES)
    return ply_header(form).encode() + body + struct.pack(f"{order}i", 0)


FILES = {
    "a.obj": as_obj(),
    "text.stl": as_text_stl(),
    "binary.STL": as_binary_stl(),
    "text.ply": as_text_ply(),
    "little.ply": as_binary_ply("<"),
    "big.ply": as_binary_ply(">"),
    "windows.ply": as_text_ply().replace(b"\n", b"\r\n"),
    "windows.obj": as_obj().replace(b"\n", b"\r\n"),
}


def read(tmp_path, name: str, data: bytes) -> Mesh:
    (tmp_path / name).write_bytes(data)
    return read_mesh(tmp_path / name)


@pytest.mark.parametrize("name", FILES)
def test_every_format_gives_the_same_solid(tmp_path, name) -> None:
    mesh = read(tmp_path, name, FILES[name])
    expected = sorted(map(tuple, VERTICES[TRIANGLES].reshape(-1, 9)))
    assert len(mesh.vertices) == 4
    np.testing.assert_allclose(sorted(map(tuple, mesh.corners.reshape(-1, 9))), expected)
    assert len(solids_of(mesh)) == 1
    assert mesh.volume == pytest.approx(2 * 3 * 0.5 / 6)


def test_polygons_are_cut_into_triangles(tmp_path) -> None:
    square = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\n3 4\n"
    mesh = read(tmp_path, "square.obj", square)
    assert len(mesh.triangles) == 2
    assert np.linalg.norm(np.cross(*np.diff(mesh.corners, axis=1).transpose(1, 0, 2)), axis=1).sum() == pytest.approx(2)
    pentagon = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    pentagon += "element face 1\nproperty list uchar int vertex_index\nend_header\n"
    pentagon += "0 0 0\n2 0 0\n3 1 0\n1 2 0\n-1 1 0\n5 0 1 2 3 4\n"
    assert len(read(tmp_path, "pentagon.ply", pentagon.encode()).triangles) == 3


TEXT_PLY = as_text_ply().decode()
BROKEN = {
    "no number": ("a.obj", b"v 0 0 zero\n", r"line 1: expected a number, got 'zero'"),
    "no vertex": ("a.obj", b"v 0 0 0\nf 1 2 3\n", r"line 2: expected a vertex of the 1 before it, got 2"),
    "no row 0": ("a.obj", b"v 0 0 0\nf 0 1 1\n", r"line 2: .*got 0"),
    "no corner": ("a.obj", b"v 0 0 0\nf a b c\n", r"line 2: expected a corner such as 3"),
    "no word": ("a.obj", b"v 0 0 0\ncurv 1 2\n", r"line 2: expected a vertex .*got 'curv 1 2'"),
    "two corners": ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2\n", r"line 3: expected a vertex"),
    "no text": ("a.obj", b"v 0 0 \xff\n", r"expected text, got byte 255 at 6"),
    "empty": ("a.obj", b"", r"expected 1 or more, got none"),
    "nan": ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"finite"),
    "flat": ("a.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", r"areas above 0"),
    "short stl": ("a.stl", as_binary_stl()[:-1].replace(b"solid", b"saved"), r"4 binary facets, got 283 bytes"),
    "no stl": ("a.stl", b"nothing", r"expected text that begins with solid"),
    "stl word": ("a.stl", b"solid a\ncone 3\n", r"line 2: expected a facet, got 'cone 3'"),
    "stl corners": ("a.stl", b"solid a\nvertex 0 0 0\nendloop\n", r"line 3: expected a facet of 3 corners, got 1"),
    "stl vertex": ("a.stl", b"solid a\nvertex 0 0\n", r"line 2: expected vertex x y z"),
    "stl end": ("a.stl", b"solid a\nvertex 0 0 0\n", r"stops after 1 of its corners"),
    "no ply": ("a.ply", b"plywood", r"expected a header from ply to end_header"),
    "ply format": ("a.ply", TEXT_PLY.replace("ascii 1.0", "ascii 2.0").encode(), r"line 2: .*'format ascii 2.0'"),
    "ply no format": ("a.ply", TEXT_PLY.replace("format ascii 1.0", "comment").encode(), r"expected a format of"),
    "ply kind": ("a.ply", TEXT_PLY.replace("float x", "quad x").encode(), r"line 5: .*'property quad x'"),
    "ply count": ("a.ply", TEXT_PLY.replace("vertex 4", "vertex -4").encode(), r"line 4: .*'element vertex -4'"),
    "ply axes": ("a.ply", TEXT_PLY.replace("float x", "float w").encode(), r"vertex: expected properties x, y and z"),
    "ply no face": ("a.ply", TEXT_PLY.replace("face", "loop").encode(), r"elements vertex and face, got vertex, loop"),
    "ply no list": ("a.ply", TEXT_PLY.replace("vertex_indices", "v").encode(), r"face: expected a list vertex_indices"),
    "ply far": ("a.ply", TEXT_PLY.replace("7 3 0 2 1", "7 3 0 2 9").encode(), r"face: expected vertices 0 to 3, got 9"),
    "ply two": (
        "a.ply",
        TEXT_PLY.replace("7 3 0 2 1", "7 2 0 2").encode(),
        r"face 0: expected 3 corners or more, got 2",
    ),
    "ply long": ("a.ply", TEXT_PLY.replace("7 3 0 2 1", "7 9999").encode(), r"expected a list of 0 to 1024 numbers"),
    "ply part": (
        "a.ply",
        TEXT_PLY.replace("7 3 0 2 1", "7 3 0 2 0.5").encode(),
        r"face 0: expected numbers of vertices",
    ),
    "ply endless": ("a.ply", TEXT_PLY.replace("7 3 0 2 1", "7 3 0 2 inf").encode(), r"face 0: expected numbers"),
    "ply short": ("a.ply", as_binary_ply("<")[:-60], r"face|rows"),
    "ply huge": ("a.ply", TEXT_PLY.replace("vertex 4", "vertex 4000000000").encode(), r"more numbers, got"),
    "ply huge bytes": (
        "a.ply",
        as_binary_ply("<").replace(b"vertex 4", b"vertex 999999999"),
        r"expected 999999999 rows",
    ),
    "unknown": ("a.fbx", b"", r"expected a file named .obj, .stl or .ply"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_are_refused_by_name_and_place(tmp_path, case) -> None:
    name, data, message = BROKEN[case]
    with pytest.raises(ValueError, match=rf"{name}.*{message}"):
        read(tmp_path, name, data)


@pytest.mark.parametrize("name", FILES)
def test_files_cut_anywhere_are_read_or_refused_and_nothing_else(tmp_path, name) -> None:
    for end in range(0, len(FILES[name]), 29):
        try:
            read(tmp_path, name, FILES[name][:end])
        except ValueError as error:
            assert name in str(error)


def test_files_that_are_too_large_are_refused(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(mesh_files, "MOST_TRIANGLES", 3)
    with pytest.raises(ValueError, match="at most 3, got 4"):
        read(tmp_path, "a.obj", as_obj())
    monkeypatch.setattr(mesh_files, "MOST_BYTES", 100)
    with pytest.raises(ValueError, match="at most 0 MiB, got more"):
        read(tmp_path, "a.obj", as_obj())
    with pytest.raises(FileNotFoundError):
        read_mesh(tmp_path / "none.obj")
