"""The smeared ball covers what a ball drawn many times during the exposure would."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from pgm_data.simulate.camera import pixels_of
from pgm_data.simulate.flight.path import BallPath, Contact, Flight
from pgm_data.simulate.pictures.ball_streak import ball_shadow, ball_streak, exposure
from pgm_data.simulate.pictures.body_mesh import SUNNY
from pgm_data.simulate.pictures.raster import Sprite
from pgm_data.simulate.views import View, framed_pose

SIZE = (320, 180)
RADIUS = 0.0335


def _view(k: float = 0.03, focal: float = 900.0) -> View:
    return framed_pose(
        centre_world=np.array([0.6, -30.0, 9.0]),
        aim_world=np.array([0.3, -2.0, 0.0]),
        aim_px=(160.0, 90.0),
        roll=0.01,
        focal_px=focal,
        principal_px=(159.5, 89.5),
        k=k,
    ).view(SIZE)


def _pixels(view: View, points: np.ndarray) -> np.ndarray:
    return pixels_of(points, view.K, view.k1, view.R_cam_from_world, view.t_cam_from_world)


def _whole(sprite: Sprite) -> np.ndarray:
    image = np.zeros((SIZE[1], SIZE[0]))
    tall, wide = sprite.alpha.shape
    image[sprite.y0 : sprite.y0 + tall, sprite.x0 : sprite.x0 + wide] = sprite.alpha
    return image


def _centroid(image: np.ndarray) -> np.ndarray:
    y, x = np.indices(image.shape)
    return np.array([(image * x).sum(), (image * y).sum()]) / image.sum()


def _radius_px(view: View, place: np.ndarray) -> float:
    """Half the width of a sphere, from the projections of its left, right, upper and lower ends."""
    sides = RADIUS * view.R_cam_from_world[:2]
    left, right = _pixels(view, np.stack([place - sides, place + sides]))
    return float(np.linalg.norm(right - left, axis=1).mean()) / 2.0


def _brute_force(view: View, centres: np.ndarray, samples: int = 8) -> np.ndarray:
    """Mean over many discs, each drawn by samples of every pixel near it."""
    px = _pixels(view, centres)
    image = np.zeros((SIZE[1], SIZE[0]))
    fine = (np.arange(samples) + 0.5) / samples - 0.5
    for (u, v), place in zip(px, centres, strict=True):
        r = _radius_px(view, place)
        x0, y0 = int(u - r) - 2, int(v - r) - 2
        x = x0 + np.arange(int(2 * r) + 6)[:, None] + fine
        y = y0 + np.arange(int(2 * r) + 6)[:, None] + fine
        inside = (x[None, :, None, :] - u) ** 2 + (y[:, None, :, None] - v) ** 2 <= r * r
        image[y0 : y0 + len(y), x0 : x0 + len(x)] += inside.mean(axis=(2, 3))
    return image / len(px)


@pytest.mark.parametrize(
    ("start", "end", "focal"),
    [
        ((0.0, 0.0, 1.0), (0.6, 0.2, 1.2), 900.0),
        ((-0.2, -3.0, 0.1), (-0.2, -2.5, 0.1), 2500.0),
        ((1.0, 3.0, 1.2), (1.3, 3.1, 0.9), 900.0),
        ((0.3, -2.0, 0.3), (0.31, -2.0, 0.3), 2500.0),
    ],
)
def test_a_straight_streak_agrees_with_many_discs(start: tuple, end: tuple, focal: float) -> None:
    view = _view(focal=focal)
    share = (np.arange(300) + 0.5)[:, None] / 300
    centres = np.array(start) + share * (np.array(end) - np.array(start))
    sprite = ball_streak(np.array([start, end]), np.ones(1), RADIUS, view, SIZE, SUNNY)
    assert sprite is not None
    mine, true = _whole(sprite), _brute_force(view, centres)
    assert np.abs(_centroid(mine) - _centroid(true)).max() < 0.02
    assert mine.sum() == pytest.approx(true.sum(), rel=0.01)
    assert np.abs(mine - true).max() < 0.05


@settings(max_examples=40)
@given(x=st.floats(-2, 2), y=st.floats(-5, 5), z=st.floats(0.03, 1.5), k=st.sampled_from([0.0, 0.05]))
def test_a_resting_ball_lies_at_its_projection_and_has_its_size(x: float, y: float, z: float, k: float) -> None:
    view, place = _view(k), np.array([[x, y, z]])
    px = _pixels(view, place)[0]
    assume((px > 10).all() and (px < np.array(SIZE) - 10).all())
    sprite = ball_streak(place, np.ones(0), RADIUS, view, SIZE, SUNNY)
    assert sprite is not None
    # Square pixels draw the centroid of a disc of 2 px towards their centres.
    assert np.abs(_centroid(_whole(sprite)) - _pixels(view, place)[0]).max() < 0.06
    depth = (place @ view.R_cam_from_world.T + view.t_cam_from_world)[0, 2]
    radius = _radius_px(view, place[0])
    assert sprite.alpha.sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    assert sprite.depth.min() == pytest.approx(depth - RADIUS, rel=1e-5)


def _bouncing() -> BallPath:
    def flight(t0: float, t1: float, p0: list[float], v0: list[float]) -> Flight:
        times = np.linspace(t0, t1, 20)
        lag = (times - t0)[:, None]
        fall = np.array([0.0, 0.0, -9.81])
        positions = np.array(p0) + lag * np.array(v0) + 0.5 * lag**2 * fall
        return Flight(
            times=times, positions=positions, velocities=v0 + lag * fall, spins=np.zeros((20, 3)), drag_per_m=0.0
        )

    ground = [0.0, 2.0, 0.0335]
    down = flight(0.0, 0.1, [0.0, 5.0, 1.0826], [0.0, -30.0, -10.0])
    up = flight(0.1, 0.3, ground, [0.0, -20.0, 8.0])
    kinds = ("first", "bounce", "last")
    ends = (down.positions[0], up.positions[0], up.positions[-1])
    contacts = tuple(
        Contact(time=t, kind=k, player=-1, position=p) for t, k, p in zip((0.0, 0.1, 0.3), kinds, ends, strict=True)
    )
    return BallPath(flights=(down, up), contacts=contacts)


def test_a_streak_through_a_bounce_agrees_with_many_discs() -> None:
    path, view = _bouncing(), _view()
    start, end = 0.093, 0.111
    sprite = ball_streak(*exposure(path, start, end), RADIUS, view, SIZE, SUNNY)
    assert sprite is not None
    times = start + (np.arange(400) + 0.5) / 400 * (end - start)
    true = _brute_force(view, path.at(times)[0])
    assert np.abs(_centroid(_whole(sprite)) - _centroid(true)).max() < 0.02
    assert np.abs(_whole(sprite) - true).max() < 0.05


def test_exposures_share_out_all_their_time_and_stop_at_contacts() -> None:
    positions, shares = exposure(_bouncing(), 0.093, 0.111)
    assert shares.sum() == pytest.approx(1.0)
    assert positions[:, 2].min() == pytest.approx(0.0335, abs=1e-3)
    positions, shares = exposure(_bouncing(), 0.05, 0.05)
    assert positions.shape == (1, 3) and shares.shape == (0,)
    with pytest.raises(ValueError, match="expected an end not before"):
        exposure(_bouncing(), 0.2, 0.1)


def test_a_ball_that_appears_halfway_is_half_as_opaque() -> None:
    path, view = _bouncing(), _view()
    whole = ball_streak(*exposure(path, 0.0, 0.02), RADIUS, view, SIZE, SUNNY)
    half = ball_streak(*exposure(path, -0.02, 0.02), RADIUS, view, SIZE, SUNNY)
    assert whole is not None and half is not None
    assert half.alpha.sum() == pytest.approx(0.5 * whole.alpha.sum(), rel=0.02)


@pytest.mark.parametrize("place", [(0.0, -60.0, 2.0), (500.0, 0.0, 1.0), (np.nan, 0.0, 1.0), (0.6, -30.0, 9.0)])
def test_balls_that_cannot_be_seen_give_nothing(place: tuple) -> None:
    assert ball_streak(np.array([place]), np.ones(0), RADIUS, _view(), SIZE, SUNNY) is None
    assert ball_streak(np.array([place, place]), np.ones(1), RADIUS, _view(), SIZE, SUNNY) is None


def test_a_ball_cut_by_the_picture_keeps_the_part_inside() -> None:
    view = _view(0.0, 2500.0)
    ray = np.linalg.solve(view.K @ view.R_cam_from_world, np.array([-0.5, 60.0, 1.0]))
    place = view.centre_world + 20.0 * ray / (view.R_cam_from_world @ ray)[2]
    sprite = ball_streak(place[None], np.ones(0), RADIUS, view, SIZE, SUNNY)
    assert sprite is not None and sprite.x0 == 0
    assert sprite.alpha.sum() == pytest.approx(0.5 * np.pi * (2500.0 * RADIUS / 20.0) ** 2, rel=0.02)


def test_the_shadow_lies_where_the_light_throws_it() -> None:
    view, thrown = _view(), np.array([0.8, 0.3])
    place = np.array([[0.0, -4.0, 1.5]])
    sprite = ball_shadow(place, 0.2, thrown, 0.0, view, SIZE)
    assert sprite is not None
    fallen = np.array([[0.8 * 1.5, -4.0 + 0.3 * 1.5, 0.0]])
    assert np.abs(_centroid(_whole(sprite)) - _pixels(view, fallen)[0]).max() < 0.1
    assert ball_shadow(np.full((1, 3), np.nan), 0.2, thrown, 0.0, view, SIZE) is None


def test_the_shadow_of_a_moving_ball_is_the_mean_of_shadows_on_its_way() -> None:
    view, thrown = _view(focal=2500.0), np.array([0.8, 0.3])
    start, end = np.array([-0.6, -2.4, 0.3]), np.array([-0.3, -2.0, 0.5])
    share = (np.arange(60) + 0.5)[:, None] / 60
    parts = [ball_shadow(p[None], 0.05, thrown, 0.0, view, SIZE) for p in start + share * (end - start)]
    moved = ball_shadow(np.stack([start, end]), 0.05, thrown, 0.0, view, SIZE)
    assert moved is not None and moved.alpha.max() < 0.9
    mean = np.mean([_whole(p) for p in parts if p is not None], axis=0)
    assert np.abs(_whole(moved) - mean).max() < 0.05
    assert _whole(moved).sum() == pytest.approx(mean.sum(), rel=0.02)
    rest = ball_shadow(start[None], 0.05, thrown, 0.0, view, SIZE)
    assert rest is not None and rest.alpha.max() == pytest.approx(1.0)


def test_a_shadow_seen_edge_on_is_nothing() -> None:
    view = framed_pose(
        centre_world=np.array([0.0, -20.0, 0.0]),
        aim_world=np.array([0.0, 0.0, 0.0]),
        aim_px=(160.0, 90.0),
        roll=0.0,
        focal_px=900.0,
        principal_px=(159.5, 89.5),
        k=0.0,
    ).view(SIZE)
    assert ball_shadow(np.array([[0.0, 0.0, 1.0]]), 0.05, np.zeros(2), 0.0, view, SIZE) is None
