"""Painted lines and nets have the scene file's measures."""

import numpy as np
import pytest

from pgm_data.court import Court
from pgm_data.scene import load_scene
from pgm_data.simulate.pictures.painter import paint_flat
from pgm_data.simulate.pictures.shapes import (
    NetLook,
    in_pieces,
    line_rectangles,
    net_polygons,
    polygons,
    rectangle,
    stacked,
)

SCENES = ["tennis", "badminton", "pickleball", "tabletennis"]


def _court(scene: str) -> Court:
    court = load_scene(scene).court
    assert court is not None
    return court


def _area(corners: np.ndarray) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))


def _from_above(shapes: list[np.ndarray], half_x: float, half_y: float, px_per_m: float) -> np.ndarray:
    """Summed coverage of these ground shapes in a picture from straight above."""
    width, height = int(2 * half_x * px_per_m), int(2 * half_y * px_per_m)
    image = np.zeros((height, width, 3), np.float32)
    total = np.zeros((height, width))
    view = np.zeros(17)
    view[:5] = px_per_m, px_per_m, (width - 1) / 2, (height - 1) / 2, 0.0
    view[5:14] = np.diag([1.0, -1.0, -1.0]).ravel()
    view[16] = 1.0
    limits = np.array([-half_x, half_x, -half_y, half_y]) * 1.1
    for corners in shapes:
        image[:] = 0.0
        group = polygons([(corners, np.ones(3), 1.0)])
        cover = np.zeros((height, width + 2), np.float32)
        none = np.zeros((0, 0), np.float32)
        paint_flat(image, cover, group.corners, group.starts, group.colours, group.alphas, view, limits, none)
        total += image[..., 0]
    return total


@pytest.mark.parametrize("scene", SCENES)
def test_painted_rectangles_never_overlap(scene: str) -> None:
    court = _court(scene)
    half_x, half_y = np.abs(court.points_world[:, :2]).max(axis=0) + 0.2
    scale = 30.0 if scene != "tabletennis" else 200.0
    total = _from_above([c for _, c in line_rectangles(court)], half_x, half_y, scale)
    assert total.max() <= 1.0 + 1e-4


def test_outer_edges_of_tennis_lines_meet_at_the_rule_book_lengths() -> None:
    court = _court("tennis")
    corners = np.concatenate([c for _, c in line_rectangles(court)])
    np.testing.assert_allclose(np.abs(corners).max(axis=0), [5.485, 11.885, 0.0], atol=1e-9)
    singles = court.line_names.index("left_singles_sideline")
    own = np.concatenate([c for i, c in line_rectangles(court) if i == singles])
    np.testing.assert_allclose([own[:, 0].min(), own[:, 0].max()], [-4.115, -4.065], atol=1e-9)


def test_painted_area_is_that_of_the_union_of_all_lines() -> None:
    """Counted by hand: lengths times widths, less what crossing lines share."""
    total = sum(_area(c) for _, c in line_rectangles(_court("tennis")))
    across = 2 * 0.10 * 10.97 + 2 * 0.05 * (8.18 + 0.05)
    doubles = 2 * 0.05 * (23.77 - 0.2)
    singles = 2 * 0.05 * (23.77 - 0.2 - 0.1)
    middle = 0.05 * (12.75 - 0.05)
    assert total == pytest.approx(across + doubles + singles + middle, abs=1e-9)


def test_an_oblique_line_is_refused() -> None:
    court = _court("tennis")
    points = court.points_world.copy()
    points[0, 0] += 1.0
    points[0, 1] -= 1.0
    bent = Court(**{name: getattr(court, name) for name in court.__dataclass_fields__} | {"points_world": points})
    with pytest.raises(ValueError, match="oblique"):
        line_rectangles(bent)


def test_pieces_cover_what_the_whole_covers() -> None:
    whole = polygons([(rectangle(-1, 1, -0.05, 0.05), np.ones(3), 0.7), (rectangle(0, 0.1, 2, 9), np.ones(3), 0.3)])
    cut = in_pieces(whole, 0.5)
    areas = [_area(cut.corners[a:b]) for a, b in zip(cut.starts[:-1], cut.starts[1:], strict=True)]
    assert sum(areas) == pytest.approx(0.2 + 0.7)
    assert len(cut.alphas) == 4 + 14
    assert set(cut.alphas) == {0.7, 0.3}


def test_stacking_keeps_order_and_corners() -> None:
    a = polygons([(rectangle(0, 1, 0, 1), np.zeros(3), 1.0)])
    b = polygons([(rectangle(2, 3, 0, 1)[:3], np.ones(3), 0.5), (rectangle(4, 5, 0, 1), np.ones(3), 0.2)])
    both = stacked([a, polygons([]), b])
    assert both.starts.tolist() == [0, 4, 7, 11]
    assert both.alphas.tolist() == [1.0, 0.5, 0.2]
    np.testing.assert_array_equal(both.corners[7:], b.corners[3:])


@pytest.mark.parametrize("scene", SCENES)
def test_the_tape_runs_along_the_net_top_of_the_scene_file(scene: str) -> None:
    court = _court(scene)
    look = NetLook(mesh=np.zeros(3), mesh_alpha=0.4, tape=np.full(3, 250.0), post=np.zeros(3), strap=True, band=False)
    net, tape = net_polygons(court, look, 0.0)
    top = court.net_world
    assert tape.corners[:, 2].max() == pytest.approx(top[:, 2].max())
    for x, _, z in top:
        here = tape.corners[np.isclose(tape.corners[:, 0], x)]
        assert here[:, 2].max() == pytest.approx(z)
        assert np.isclose(here[:, 2], z - court.tape_width).any()
    assert (net.corners[:, 2] >= -1e-9).all()
