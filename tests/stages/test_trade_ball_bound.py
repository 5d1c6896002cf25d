"""The bound equals closed forms where there are some, and follows the noise."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.flight.contact import SURFACES
from pgm_data.stages.trade_ball_bound import (
    OWN,
    SHARED,
    bound_of,
    covariance_of,
    path_slopes,
    prior_std,
    shot_slopes,
)
from pgm_data.stages.trade_ball_cases import CaseOptions, draw_case
from pgm_data.stages.trade_ball_shots import WIDE, TrueShot, draw_world

TENNIS = load_scene("tennis")


def vacuum_shot(velocity: list[float], end_s: float) -> TrueShot:
    """A shot without air, on ground that keeps 0.75 of the vertical speed and rubs at nothing."""
    world = draw_world(np.random.default_rng(0), TENNIS)
    ground = replace(SURFACES["hard"], restitution=0.75, shallow_gain=0.0, speed_loss=0.0, friction=0.0)
    build = replace(world.build, drag_coefficient=0.0, lift_factor=0.0)
    return TrueShot(
        start_s=0.0,
        end_s=end_s,
        position=np.array([0.5, -10.0, 1.0]),
        velocity=np.array(velocity),
        spin=np.zeros(3),
        world=replace(world, net=None, bounds=WIDE, surface=ground, build=build),
        landing=np.full(3, np.nan),
    )


def test_the_covariance_is_that_of_a_straight_line_fitted_to_points():
    t, sigma = np.array([0.0, 1.0, 2.0, 5.0, 7.0]), 0.3
    slopes = np.stack([np.ones_like(t), t], axis=1)
    covariance = covariance_of(slopes, np.full(5, sigma), np.full(2, 1e6))
    spread = ((t - t.mean()) ** 2).sum()
    np.testing.assert_allclose(covariance[1, 1], sigma**2 / spread, rtol=1e-8)
    at = 4.0
    row = np.array([1.0, at])
    np.testing.assert_allclose(row @ covariance @ row, sigma**2 * (1 / 5 + (at - t.mean()) ** 2 / spread), rtol=1e-8)


def test_a_prior_adds_as_a_measurement_does():
    covariance = covariance_of(np.array([[1.0, 0.0]]), np.array([2.0]), np.array([1.0, 3.0]))
    np.testing.assert_allclose(covariance, np.diag([1 / (1 / 4 + 1), 9.0]))


def test_slopes_of_a_flight_without_air_are_those_of_a_parabola_and_its_rebound():
    shot = vacuum_shot([1.0, 20.0, 3.0], 2.0)
    g, radius, e = shot.world.air.gravity, shot.world.build.radius_m, 0.75
    landing = (3.0 + np.sqrt(9.0 + 2 * g * (1.0 - radius))) / g
    fall = g * landing - 3.0
    t = np.array([0.3, landing + 0.4])
    found = shot_slopes(shot, t)
    assert found.bounce_s == pytest.approx(landing, abs=1e-9)
    # How the landing depends on the start's height and upward speed.
    by_z, by_vz = 1 / fall, landing / fall
    np.testing.assert_allclose(found.bounce_slopes[[2, 5]], [by_z, by_vz], rtol=1e-5)
    np.testing.assert_allclose(found.slopes[:, 0, 0], 1.0, atol=1e-6)
    np.testing.assert_allclose(found.slopes[:, 1, 4], t, atol=1e-6)
    np.testing.assert_allclose(found.slopes[0, 2, :9], [0, 0, 1, 0, 0, 0.3, 0, 0, 0], atol=1e-5)
    # After it: z = radius + e fall s - g s^2 / 2 with s the time since, fall = g landing - vz.
    s, rise = 0.4, e * fall - g * 0.4
    np.testing.assert_allclose(found.slopes[1, 2, 2], e * g * by_z * s - rise * by_z, atol=1e-4)
    np.testing.assert_allclose(found.slopes[1, 2, 5], e * (g * by_vz - 1) * s - rise * by_vz, atol=1e-4)
    np.testing.assert_allclose(found.slopes[1, 2, 11], fall * s, atol=1e-4)


def test_a_rally_depends_on_its_start_without_a_jump_at_hits():
    case = draw_case("rally", 0, 0, CaseOptions(), TENNIS)
    shots = case.path.shots[:3]
    hit = shots[1].end_s
    before, after = path_slopes(shots, np.array([hit - 1e-6, hit + 1e-6]))[0]
    own = SHARED + OWN * 2
    np.testing.assert_allclose(before[:, :own], after[:, :own], atol=1e-3)
    # A later hit leaves the ball on its old way for longer.
    velocity = [shot_slopes(shot, np.array([hit])).velocities[0] for shot in shots[1:]]
    np.testing.assert_allclose(after[:, own + 6], velocity[0] - velocity[1], atol=1e-3)
    np.testing.assert_allclose(before[:, own:], 0.0, atol=1e-12)


def test_slopes_of_a_rally_are_those_of_its_flight_flown_anew():
    case = draw_case("rally", 1, 0, CaseOptions(), TENNIS)
    first, second = case.path.shots[1:3]
    h, at = 1e-3, np.array([second.start_s + 0.3])
    moved = replace(first, velocity=first.velocity + [0.0, h, 0.0])
    start = shot_slopes(moved, np.array([first.end_s])).positions[0]
    middle = shot_slopes(first, np.array([first.end_s])).positions[0]
    shifted = replace(second, position=second.position + start - middle)
    difference = (shot_slopes(shifted, at).positions - shot_slopes(second, at).positions)[0] / h
    found = path_slopes((first, second), at)[0][0, :, SHARED + 1]
    np.testing.assert_allclose(found, difference, rtol=2e-2, atol=2e-3)


@pytest.mark.parametrize("kind", ["serve", "rally"])
def test_the_bound_shrinks_with_the_noise_and_grows_without_marks(kind):
    rms = []
    for noise in (0.1, 1.0, 3.0):
        case = draw_case(kind, 1, 0, CaseOptions(noise_px=noise, mark_px=noise), TENNIS)
        bound = bound_of(case, TENNIS)
        rms.append(bound.rms_m)
        assert np.isfinite(bound.position_cov[case.inside]).all() and np.isnan(bound.position_cov[~case.inside]).all()
        assert (np.linalg.eigvalsh(bound.position_cov[case.inside]) > -1e-9).all()
    assert rms[0] < rms[1] < rms[2]
    assert 0.002 < rms[1] < 0.5
    if kind == "serve":
        unmarked = bound_of(draw_case(kind, 1, 0, CaseOptions(marks=False), TENNIS), TENNIS)
        assert unmarked.rms_m > 1.5 * rms[1]


def test_most_of_the_bound_lies_along_the_line_of_sight():
    case = draw_case("forehand_far", 0, 0, CaseOptions(), TENNIS)
    bound = bound_of(case, TENNIS)
    across, along, _ = np.sqrt(np.diagonal(bound.position_cov[case.inside], axis1=1, axis2=2).mean(axis=0))
    assert along > 3 * across


def test_priors_are_those_of_the_scene():
    assert TENNIS.ball is not None
    prior = prior_std(2, TENNIS.ball, 0.01)
    second = prior[SHARED + OWN :]
    np.testing.assert_allclose(prior[3:5], [0.002, 0.1])
    np.testing.assert_allclose(second[3:], [200.0, 200.0, 200.0, 0.01, 0.08, 0.1, 0.06])
    assert prior[SHARED + 6] < 1e-6


def test_a_scene_without_a_ball_is_refused():
    case = draw_case("serve", 0, 0, CaseOptions(), TENNIS)
    with pytest.raises(ValueError, match=r"bound_of.scene: expected a ball"):
        bound_of(case, replace(TENNIS, ball=None))
