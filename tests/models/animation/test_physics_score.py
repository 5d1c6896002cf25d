from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from pgm_data.scene import Ball, load_scene
from pgm_data.skeleton import Skeleton
from pgm_models.animation.physics_score import (
    FIGURES,
    Motion,
    fastest_speeds,
    flown,
    foot_slides,
    free_flight,
    physics_figures,
    sole_points,
    speeds,
    unexplained,
)

TENNIS = load_scene("tennis")
BALL = cast(Ball, TENNIS.ball)
C = BALL.drag_per_m.mean


def flight(start: list[float], velocity: list[float], times: np.ndarray, push: tuple[float, ...] = (0, 0, 0)):
    """Places and velocities of a ball under gravity, drag and a steady push, by scipy."""

    def law(t: float, s: np.ndarray) -> np.ndarray:
        v = s[3:]
        return np.concatenate([v, np.array([0, 0, -9.81]) - C * np.linalg.norm(v) * v + push])

    solved = solve_ivp(law, (times[0], times[-1]), [*start, *velocity], t_eval=times, rtol=1e-10, atol=1e-10)
    return solved.y[:3].T[None], solved.y[3:].T[None]


def test_flights_on_and_back_are_those_of_an_integrator():
    times = np.linspace(0, 0.8, 9)
    position, velocity = flight([0, -10, 1], [2, 35, 6], times)
    places, velocities = flown(position[0, 0], velocity[0, 0], np.array([0.8]), C)
    np.testing.assert_allclose(places, position[0], atol=1e-3)
    np.testing.assert_allclose(velocities, velocity[0], atol=3e-3)
    back, _ = flown(position[0, -1], velocity[0, -1], np.array([-0.8]), C)
    np.testing.assert_allclose(back[-1], position[0, 0], atol=2e-3)
    still, _ = flown(np.zeros(3), np.zeros(3), np.array([0.0]), C)
    assert not still.any()


@pytest.mark.parametrize("rate", [4.0, 25.0])
def test_true_flight_has_next_to_no_residual(rate):
    times = np.arange(5) / rate
    position, velocity = flight([0, -10, 1.5], [1, 25, 8], times)
    found = free_flight(position, velocity, np.full((1, 5, 1, 3), np.inf), np.array([1 / rate]), BALL)
    assert found.free.all()
    assert found.gap.max() < 2e-4 and found.push.max() < 2e-2
    assert unexplained(position, np.array([1 / rate]), BALL).max() < 0.15


def test_a_steady_push_shows_in_the_residual_and_hardly_in_the_gap():
    """As of spin, which the scene file gives no value of."""
    times = np.arange(5) / 4.0
    position, velocity = flight([0, -10, 2], [1, 20, 8], times, push=(0.0, 0.0, -3.0))
    found = free_flight(position, velocity, np.full((1, 5, 1, 3), np.inf), np.array([0.25]), BALL)
    np.testing.assert_allclose(found.push, 3.0, rtol=0.1)
    np.testing.assert_allclose(unexplained(position, np.array([0.25]), BALL), 3.0, rtol=0.1)
    assert found.gap.max() < 0.01


def test_velocities_that_do_not_fit_the_places_show_in_the_gap():
    times = np.arange(5) / 4.0
    position, velocity = flight([0, -10, 2], [1, 20, 8], times)
    wrong = free_flight(position, velocity + [0, 2.0, 0], np.full((1, 5, 1, 3), np.inf), np.array([0.25]), BALL)
    np.testing.assert_allclose(wrong.gap, 2 * 2.0 * 0.125, rtol=0.2)


def test_a_ball_that_hangs_in_the_air_misses_gravity():
    position = np.broadcast_to(np.array([0.0, 0.0, 5.0]), (1, 6, 3))
    np.testing.assert_allclose(unexplained(position, np.array([0.25]), BALL), 9.81, rtol=0.02)


def test_steps_with_a_bounce_or_in_reach_of_a_player_are_not_free():
    times = np.arange(4) / 4.0
    position, velocity = flight([0, -10, 2.0], [0, 20, 5], times)
    none = np.full((1, 4, 1, 3), np.inf)
    assert free_flight(position, velocity, none, np.array([0.25]), BALL).free.all()
    player = none.copy()
    player[0, :, 0] = [1.0, position[0, 1, 1], 1.0]
    assert free_flight(position, velocity, player, np.array([0.25]), BALL).free.tolist() == [[False, False, True]]
    down = velocity.copy()
    down[0, 2, 2] = -20.0
    assert not free_flight(position, down, none, np.array([0.25]), BALL).free[0, 2]


def test_absurd_speeds_give_finite_figures():
    rng = np.random.default_rng(0)
    position, velocity = 1e3 * rng.standard_normal((3, 6, 3)), 1e4 * rng.standard_normal((3, 6, 3))
    found = free_flight(position, velocity, np.full((3, 6, 1, 3), np.inf), np.ones(3), BALL)
    assert np.isfinite(found.gap).all() and np.isfinite(found.push).all()


SKELETON = cast(Skeleton, TENNIS.players[0].skeleton)
UPRIGHT = Rotation.from_matrix([[-1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]).as_rotvec()


def standing(frames: int, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Rotations and translations of a body in its rest pose on the ground."""
    rotations = np.zeros((1, frames, 24, 3))
    rotations[:, :, 0] = UPRIGHT
    translations = np.tile(size * SKELETON.rest_translations, (1, frames, 1, 1))
    translations[:, :, 0] = [2.0, -8.0, size * SKELETON.rest_translations[0, 1]]
    return rotations.reshape(1, frames, -1), translations.reshape(1, frames, -1)


@pytest.mark.parametrize("size", [0.8, 1.0, 1.2])
def test_soles_of_a_body_at_rest_touch_the_ground_whatever_its_size(size):
    soles = sole_points(SKELETON, *standing(2, size))
    assert soles.shape == (1, 2, 4, 3)
    np.testing.assert_allclose(soles[..., 2], 0.0, atol=1e-9)


def test_feet_that_are_dragged_slide_at_the_speed_of_the_body_and_lifted_ones_do_not_count():
    rotations, translations = standing(5)
    translations = translations.copy()
    translations[0, :, 0] += 0.1 * np.arange(5)
    soles = sole_points(SKELETON, rotations, translations)
    slide, down = foot_slides(soles, np.array([0.25]), 0.0)
    assert down.all()
    np.testing.assert_allclose(slide, 0.4, atol=1e-9)
    translations[0, 2, 2] += 0.05
    _, down = foot_slides(sole_points(SKELETON, rotations, translations), np.array([0.25]), 0.0)
    assert down.all(axis=-1).tolist() == [[True, False, False, True]]


def whole_motion(frames: int = 6) -> Motion:
    """A ball in flight, the near player dragged along, the far one standing; all generated but the first frame."""
    position, velocity = flight([0, -3, 3], [1, 5, 8], np.arange(frames) / 4.0)
    rotations, translations = standing(frames)
    columns = {"ball.position": position, "ball.velocity": velocity}
    for k, speed in enumerate((0.4, 0.0)):
        moved = translations.copy()
        moved[0, :, 0] += speed / 4 * np.arange(frames)
        moved[0, :, 1] += 20 * k
        name = f"player{k}"
        columns |= {f"{name}.joint_rotations": rotations, f"{name}.joint_translations": moved}
        columns |= {f"{name}.root_position": moved[..., :3], f"{name}.root_rotation": rotations[..., :3]}
    there = np.ones((1, frames), dtype=bool)
    made = there.copy()
    made[:, 0] = False
    names = [name for name in columns if not name.endswith("translations")]
    return Motion(
        columns=columns, valid=dict.fromkeys(names, there), made=dict.fromkeys(names, made), step_s=np.array([0.25])
    )


def test_figures_of_a_known_world():
    motion = whole_motion()
    found = {
        (f.object, f.name): f for f in physics_figures(motion, TENNIS, {"player0": 0.3, "player1": 1.0, "ball": 50.0})
    }
    assert found["player0", "foot_slide"].value == pytest.approx(0.4)
    assert found["player1", "foot_slide"].value == 0.0
    assert found["player0", "foot_down"].value == 1.0 and found["player0", "foot_down"].count == 5 * 4
    assert found["player0", "too_fast"].value == 1.0 and found["player1", "too_fast"].value == 0.0
    assert found["ball", "ball_gap"].value < 1e-3 and found["ball", "ball_residual"].value < 0.2
    assert 0 < found["ball", "ball_free"].value <= 1
    assert {name for _, name in found} == set(FIGURES)
    assert fastest_speeds(motion, TENNIS)["player0"] == pytest.approx(0.4)


def test_steps_that_are_given_or_missing_are_not_judged():
    motion = whole_motion()
    made = np.zeros((1, 6), dtype=bool)
    made[0, 3] = True
    valid = np.ones((1, 6), dtype=bool)
    valid[0, 4] = False
    one = Motion(
        columns=motion.columns,
        valid=dict.fromkeys(motion.valid, valid),
        made=dict.fromkeys(motion.made, made),
        step_s=motion.step_s,
    )
    assert one.steps("ball.position").tolist() == [[False, False, True, False, False]]
    assert len(speeds(one, "player0")) == 1
    nothing = Motion(
        columns=motion.columns,
        valid=dict.fromkeys(motion.valid, valid),
        made=dict.fromkeys(motion.made, np.zeros((1, 6), dtype=bool)),
        step_s=motion.step_s,
    )
    assert all(np.isnan(f.value) and f.count == 0 for f in physics_figures(nothing, TENNIS, {}))


def test_one_frame_has_no_steps_and_scenes_without_a_ball_no_figures_of_it():
    motion = whole_motion()
    one = Motion(
        columns={name: values[:, :1] for name, values in motion.columns.items()},
        valid={name: values[:, :1] for name, values in motion.valid.items()},
        made={name: values[:, :1] for name, values in motion.made.items()},
        step_s=motion.step_s,
    )
    assert all(f.count == 0 for f in physics_figures(one, TENNIS, {}))
    without = [name for name in motion.valid if not name.startswith("ball")]
    few = Motion(
        columns=motion.columns,
        valid={name: motion.valid[name] for name in without},
        made={name: motion.made[name] for name in without},
        step_s=motion.step_s,
    )
    assert {f.object for f in physics_figures(few, TENNIS, {})} == {"player0", "player1"}
