import numpy as np
import pytest

from pgm_models.synthesis.meshes import (
    DistanceGrid,
    Mesh,
    distance_grid,
    joined_meshes,
    signed_distances,
    solids_of,
    surface_distances,
    turned,
    welded,
    winding_numbers,
)

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SQUARES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def block(low, high) -> Mesh:
    triangles = [corner for a, b, c, d in SQUARES for corner in ((a, b, c), (a, c, d))]
    return Mesh(vertices=np.array(low) + CORNERS * np.subtract(high, low), triangles=np.array(triangles))


def ball(radius=1.0, halvings=3, middle=(0.0, 0.0, 0.0)) -> Mesh:
    """An octahedron whose triangles were cut in four, and pushed onto the sphere, that many times."""
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    corners = np.array(
        [[s * axes[0], t * axes[1], u * axes[2]][:: int(s * t * u)] for s in (1, -1) for t in (1, -1) for u in (1, -1)]
    )
    for _ in range(halvings):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = ((p + q) / np.linalg.norm(p + q, axis=1, keepdims=True) for p, q in ((a, b), (b, c), (c, a)))
        corners = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    mesh = welded(corners.reshape(-1, 3).round(14), np.arange(3 * len(corners)).reshape(-1, 3))
    return Mesh(vertices=radius * mesh.vertices + np.array(middle), triangles=mesh.triangles)


def ring(radius=1.0, tube=0.3, rounds=48, pieces=24) -> Mesh:
    u, v = (
        2 * np.pi * grid / count for grid, count in zip(np.indices((rounds, pieces)), (rounds, pieces), strict=True)
    )
    out = radius + tube * np.cos(v)
    vertices = np.stack([out * np.cos(u), out * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = (grid.ravel() for grid in np.indices((rounds, pieces)))
    a, b = i * pieces + j, ((i + 1) % rounds) * pieces + j
    c, d = ((i + 1) % rounds) * pieces + (j + 1) % pieces, i * pieces + (j + 1) % pieces
    return Mesh(vertices=vertices, triangles=np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def about(mesh: Mesh, count: int, seed=0, margin=0.5) -> np.ndarray:
    low, high = mesh.vertices.min(axis=0) - margin, mesh.vertices.max(axis=0) + margin
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def to_block(points, low, high) -> np.ndarray:
    """Signed distance to a box, in closed form."""
    beyond = np.maximum(np.array(low) - points, points - np.array(high))
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def nearest_on_triangle(p, a, b, c) -> np.ndarray:
    """The region of the triangle's plane that a point is in, one case after the other (Ericson 2004, section 5.1.5)."""
    ab, ac, ap, bp, cp = b - a, c - a, p - a, p - b, p - c
    d1, d2, d3, d4, d5, d6 = ab @ ap, ac @ ap, ab @ bp, ac @ bp, ab @ cp, ac @ cp
    if d1 <= 0 and d2 <= 0:
        return a
    if d3 >= 0 and d4 <= d3:
        return b
    vc = d1 * d4 - d3 * d2
    if vc <= 0 <= d1 and d3 <= 0:
        return a + ab * d1 / (d1 - d3)
    if d6 >= 0 and d5 <= d6:
        return c
    vb = d5 * d2 - d1 * d6
    if vb <= 0 <= d2 and d6 <= 0:
        return a + ac * d2 / (d2 - d6)
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        return b + (c - b) * (d4 - d3) / (d4 - d3 + d5 - d6)
    return a + ab * vb / (va + vb + vc) + ac * vc / (va + vb + vc)


def test_distance_to_a_box_is_that_of_its_closed_form() -> None:
    low, high = (-1.0, 0.2, 0.0), (0.5, 1.0, 3.0)
    points = about(block(low, high), 2000)
    np.testing.assert_allclose(signed_distances(block(low, high), points), to_block(points, low, high), atol=1e-12)


def test_distance_to_a_ball_is_off_by_no_more_than_its_faces_are_flat() -> None:
    mesh = ball(radius=2.0, halvings=2)
    sides = mesh.corners - np.roll(mesh.corners, 1, axis=1)
    sagitta = 2.0 - np.sqrt(4.0 - (np.linalg.norm(sides, axis=2).max() ** 2) / 3)
    points = about(mesh, 600)
    off = signed_distances(mesh, points) - (np.linalg.norm(points, axis=1) - 2.0)
    # A hull of points of the sphere lies within it: the distance is never too small.
    assert off.min() > -1e-9 and off.max() < 1.3 * sagitta


def test_distance_to_a_ring_is_that_of_its_closed_form_and_better_with_finer_ones() -> None:
    worst = []
    for fine in (1, 2):
        mesh = ring(rounds=16 * fine, pieces=8 * fine)
        points = about(mesh, 300)
        true = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.3
        worst.append(np.abs(signed_distances(mesh, points) - true).max())
    assert worst[0] < 0.06
    assert worst[1] < 0.3 * worst[0]


def test_distances_are_those_of_the_slow_loop_over_all_triangles() -> None:
    rng = np.random.default_rng(4)
    vertices = rng.normal(size=(12, 3))
    mesh = Mesh(vertices=vertices, triangles=np.array([rng.permutation(12)[:3] for _ in range(20)]))
    points = np.concatenate([about(mesh, 60, margin=3.0), vertices, mesh.corners.mean(axis=1), vertices[:2] * 100])
    expected = [
        min(float(np.linalg.norm(p - nearest_on_triangle(p, *corners))) for corners in mesh.corners) for p in points
    ]
    np.testing.assert_allclose(surface_distances(mesh, points), expected, atol=1e-12)


def test_distances_do_not_depend_on_which_points_are_asked_together() -> None:
    mesh = ring(rounds=16, pieces=8)
    points = about(mesh, 700, margin=2.0)
    together = surface_distances(mesh, points)
    np.testing.assert_allclose([surface_distances(mesh, p[None])[0] for p in points[::35]], together[::35], atol=1e-13)
    same = np.repeat(points[:1], 50, axis=0)
    np.testing.assert_allclose(surface_distances(mesh, same), together[0], atol=1e-13)
    assert surface_distances(mesh, points[:0]).shape == (0,)


def test_the_winding_number_counts_how_often_a_point_is_inside() -> None:
    mesh = joined_meshes([ball(2.0), ball(1.0, halvings=1)])
    points = np.array([[0, 0, 0], [1.5, 0, 0], [0, 0, 2.5], [1e3, 0, 0]])
    np.testing.assert_allclose(winding_numbers(mesh, points), [2, 1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(winding_numbers(turned(mesh), points), [-2, -1, 0, 0], atol=1e-9)


def test_solids_that_run_into_each_other_are_one() -> None:
    boxes = [((0, 0, 0), (2, 1, 1)), ((1.5, -1, 0.2), (1.8, 3, 0.7))]
    mesh = joined_meshes([block(*each) for each in boxes])
    points = about(mesh, 3000)
    expected = np.min([to_block(points, *each) for each in boxes], axis=0)
    np.testing.assert_allclose(signed_distances(mesh, points), expected, atol=1e-12)
    assert len(solids_of(mesh)) == 2


def test_a_cavity_is_outside_and_a_solid_in_it_inside() -> None:
    walls, hole, core = ((0, 0, 0), (4, 4, 4)), ((1, 1, 1), (3, 3, 3)), ((1.5, 1.5, 1.5), (2.5, 2.5, 2.5))
    mesh = joined_meshes([turned(block(*hole)), block(*core), block(*walls)])
    points = about(mesh, 3000)
    shell = np.maximum(to_block(points, *walls), -to_block(points, *hole))
    # Inside the walls the nearer of both surfaces counts.
    expected = np.minimum(shell, to_block(points, *core))
    got = signed_distances(mesh, points)
    np.testing.assert_allclose(got, expected, atol=1e-12)
    assert len(solids_of(mesh)) == 2
    assert float(signed_distances(mesh, np.array([[1.2, 2.0, 2.0]]))[0]) == pytest.approx(0.2)


@pytest.mark.parametrize("mesh", [ball(0.4, halvings=2), ring(0.5, 0.12, 16, 8), block((0, 0, 0), (0.3, 0.9, 0.02))])
def test_a_grid_holds_the_signed_distances_of_its_cells(mesh) -> None:
    grid = distance_grid(mesh, 0.09, margin=2)
    axes = [low + 0.09 * np.arange(cells) for low, cells in zip(grid.low, grid.distance.shape, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(grid.distance.ravel(), signed_distances(mesh, points), atol=1e-12)
    np.testing.assert_allclose(grid.high, points[-1])
    assert (grid.low <= mesh.vertices.min(axis=0) - 0.179).all() and (grid.high >= mesh.vertices.max(axis=0)).all()


def test_distances_of_neighbouring_cells_differ_by_no_more_than_their_distance() -> None:
    parts = [ring(0.5, 0.1, 20, 8), block((-0.6, -0.04, -0.04), (0.6, 0.04, 0.04))]
    grid = distance_grid(joined_meshes(parts), 0.05)
    for axis in range(3):
        assert np.abs(np.diff(grid.distance, axis=axis)).max() <= 0.05 * (1 + 1e-9)


def test_grids_of_no_size_or_too_many_cells_are_refused() -> None:
    with pytest.raises(ValueError, match="cell: expected above 0 m, got 0"):
        distance_grid(ball(), 0.0)
    with pytest.raises(ValueError, match="at most 1000 cells"):
        distance_grid(ball(), 0.1, most=1000)


def test_an_open_mesh_is_refused_and_its_edge_named() -> None:
    whole = block((0, 0, 0), (1, 1, 1))
    holed = Mesh(vertices=whole.vertices, triangles=whole.triangles[1:])
    with pytest.raises(
        ValueError, match=r"watertight.*1 triangle.*vertex 0 at \[0.0, 0.0, 0.0\] to vertex 1.*and 2 more"
    ):
        signed_distances(holed, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="watertight"):
        distance_grid(holed, 0.1)


def test_neighbours_that_do_not_agree_which_side_is_out_are_refused() -> None:
    whole = block((0, 0, 0), (1, 1, 1))
    triangles = np.array(whole.triangles)
    triangles[0] = triangles[0, ::-1]
    with pytest.raises(ValueError, match="opposite ways along the edge"):
        solids_of(Mesh(vertices=whole.vertices, triangles=triangles))


def test_a_mesh_that_is_inside_out_is_refused_and_may_be_turned() -> None:
    wrong = turned(ball())
    with pytest.raises(ValueError, match="inside out"):
        signed_distances(wrong, np.zeros((1, 3)))
    assert float(signed_distances(turned(wrong), np.zeros((1, 3)))[0]) < -0.9
    beside = joined_meshes([ball(), turned(ball(middle=(5.0, 0.0, 0.0)))])
    with pytest.raises(ValueError, match="inside out and in no other part"):
        solids_of(beside)


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        ([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]], r"vertices: expected finite ones.*vertex 2"),
        ([[0, 0, 0], [1, 0, 0], [0, np.inf, 0]], [[0, 1, 2]], r"vertices: expected finite ones"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], r"areas above 0.*triangle 0"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 1]], r"areas above 0.*triangle 1"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], r"expected vertices 0 to 2, got \[0, 1, 3\]"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, -1]], r"expected vertices 0 to 2"),
        ([[0.0, 0, 0]], np.zeros((0, 3), int), "expected 1 or more, got none"),
    ],
)
def test_triangles_that_are_none_are_refused(vertices, triangles, message) -> None:
    with pytest.raises(ValueError, match=message):
        Mesh(vertices=np.array(vertices, dtype=float), triangles=np.array(triangles))


def test_vertices_at_the_same_place_become_one() -> None:
    whole = block((0, 0, 0), (1, 1, 1))
    parted = whole.corners.reshape(-1, 3) * np.array([1.0, 1.0, -1.0]) * [1, 1, -1]
    mesh = welded(parted, np.arange(len(parted)).reshape(-1, 3))
    assert len(mesh.vertices) == 8
    assert len(solids_of(mesh)) == 1
    assert mesh.volume == pytest.approx(1.0)


def test_a_distance_grid_is_a_plain_table() -> None:
    grid = DistanceGrid(low=np.zeros(3), cell=0.5, distance=np.zeros((2, 3, 4)))
    np.testing.assert_allclose(grid.high, [0.5, 1.0, 1.5])
