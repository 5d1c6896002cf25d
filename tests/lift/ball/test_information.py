from dataclasses import replace

import numpy as np
import pytest

from pgm_data.geometry.camera import project
from pgm_data.lift.ball.information import Information, camera_errors, information
from pgm_data.lift.ball.rally_fit import RallyFit, fit, start_from
from pgm_data.lift.ball.rally_plan import Guess, Surroundings, contact_priors, plan_rally
from pgm_data.lift.ball.rally_plays import plays, rally_frames
from pgm_data.lift.ball.rally_problem import SolverOptions
from pgm_data.lift.ball.rally_start import first_course
from pgm_data.lift.camera_doubt import CameraDoubt, no_doubt
from tests.lift.ball.flown_worlds import WORLD, Seen, course, seen

SOLVER = SolverOptions(iterations=100, tolerance=1e-7)
DOUBT = CameraDoubt(position_cov=np.diag([0.01, 0.09, 0.01]), focal_std_share=0.006, pixel_std=0.0)


def fitted(case: Seen, fps: float = 25.0) -> RallyFit:
    frames = rally_frames(case.track, case.camera, no_doubt())
    assert frames is not None
    (play,) = plays(case.events)
    around = Surroundings(camera=case.camera, world=WORLD, players=None)
    priors = contact_priors(frames, play, around, serve=False)
    guess_course = first_course(frames, play, case.camera, priors, WORLD.drag_per_m.mean)
    assert guess_course is not None
    # A bend far out: the cost is then that of plain least squares.
    plan = plan_rally(frames, play, around, priors, Guess(times=play.times, speed=60.0), bend=1e3)
    return fit(plan, start_from(plan, guess_course, WORLD), camera=case.camera, world=WORLD, options=SOLVER)


def known(solved: RallyFit, case: Seen, doubt: CameraDoubt = DOUBT) -> Information:
    return information(solved, camera=case.camera, world=WORLD, doubt=doubt)


@pytest.fixture(scope="module")
def case() -> Seen:
    rng = np.random.default_rng(5)
    return seen(rng, course(rng, ["forehand"]), 25.0, marks=True)


@pytest.fixture(scope="module")
def solved(case: Seen) -> RallyFit:
    return fitted(case)


def test_the_fit_converges_to_a_stationary_point_on_the_constraints(solved):
    assert solved.converged
    x, p = solved.unknowns / solved.plan.data.scale, solved.plan.data.packed(solved.plan.layout.pattern)
    assert np.abs(np.array(solved.problem.constraints(x, p)[0])).max() < 1e-6


def test_condensed_covariances_are_those_of_the_whole_system(case, solved):
    # The reference: the top left block of the inverse of Hessian and constraints together.
    plan, layout = solved.plan, solved.plan.layout
    data = plan.data
    x, p = solved.unknowns / data.scale, data.packed(layout.pattern)
    upper = np.array(solved.problem.curvature(x, p))
    H = (upper + np.triu(upper, 1).T) / np.outer(data.scale, data.scale)
    A = np.array(solved.problem.constraints(x, p)[1]) / data.scale
    free = np.flatnonzero(~(plan.held & ((data.prior_precision == 0) | np.isin(np.arange(layout.size), layout.time))))
    size = np.sqrt(np.maximum(np.diag(H)[free], 1.0))
    H, A = H[np.ix_(free, free)] / np.outer(size, size), A[:, free] / size
    rows = np.linalg.norm(A, axis=1)
    whole = np.block([[H, (A / rows[:, None]).T], [A / rows[:, None], np.zeros((len(A), len(A)))]])
    reference = np.zeros((layout.size, layout.size))
    reference[np.ix_(free, free)] = np.linalg.inv(whole)[: len(free), : len(free)] / np.outer(size, size)
    info = known(solved, case, no_doubt())
    ours = info.spread @ info.spread.T
    std = np.sqrt(np.maximum(np.diag(reference), 1e-12))
    loose = np.flatnonzero(np.diag(reference) > 1e-9)
    off = (ours - reference)[np.ix_(loose, loose)] / np.outer(std[loose], std[loose])
    assert np.abs(off).max() < 1e-3


def test_the_stated_spread_is_that_of_many_tries(case, solved):
    # Marks, spin and drag scatter by their priors as little as the truth does, so pixels alone are drawn anew.
    info = known(solved, case, no_doubt())
    clean = case.track.pixels.copy()
    rows = case.track.measured
    rng = np.random.default_rng(8)
    tries = []
    for _ in range(24):
        noisy = replace(case.track, pixels=np.where(rows[:, None], clean + rng.normal(size=clean.shape), np.nan))
        again = fitted(replace(case, track=noisy))
        tries.append(again.states[:, :3])
    scatter = np.var(np.array(tries), axis=0).sum(axis=1)
    stated = np.trace(info.position_cov, axis1=1, axis2=2) / info.inflation
    # Pixels are one part of what makes the ball uncertain; priors and marks are the rest.
    assert (scatter < 1.5 * stated).all()
    assert np.median(scatter / stated) > 0.02


def test_what_is_held_keeps_its_prior_uncertainty(case, solved):
    layout, plan = solved.plan.layout, solved.plan
    lower, upper = plan.lower.copy(), plan.upper.copy()
    lower[layout.drag] = upper[layout.drag] = plan.data.prior_mean[layout.drag]
    held = fit(
        replace(plan, lower=lower, upper=upper), solved.unknowns, camera=case.camera, world=WORLD, options=SOLVER
    )
    assert held.unknowns[layout.drag] == pytest.approx(WORLD.drag_per_m.mean)
    info, before = known(held, case, no_doubt()), known(solved, case, no_doubt())
    ratio = np.trace(info.position_cov, axis1=1, axis2=2) / np.trace(before.position_cov, axis1=1, axis2=2)
    assert np.median(ratio) > 0.9
    assert info.std(np.array([layout.drag]))[0] > 0.3 * WORLD.drag_per_m.std


def test_larger_residuals_than_stated_inflate_and_smaller_do_not(case):
    loud = replace(case.track, sigma_px=case.track.sigma_px / 3)
    quiet = replace(case.track, sigma_px=case.track.sigma_px * 3)
    assert known(fitted(replace(case, track=loud)), case).inflation > 2
    assert known(fitted(replace(case, track=quiet)), case).inflation == 1.0


def test_an_exact_camera_adds_nothing(case, solved):
    assert camera_errors(case.camera, no_doubt(), WORLD) == []
    assert known(solved, case, no_doubt()).camera_spread.shape[1] == 0


def test_camera_errors_leave_the_ground_nearly_where_it_was(case):
    ground = np.array([[-5.0, -11.0, 0.0], [5.0, -11.0, 0.0], [0.0, 0.0, 0.0], [-5.0, 11.0, 0.0], [5.0, 11.0, 0.0]])
    high = ground + [0.0, 0.0, 5.0]
    errors = camera_errors(case.camera, DOUBT, WORLD)
    assert 3 <= len(errors) <= 4
    for off in errors:
        moved = np.linalg.norm(project(off[0], ground)[0] - project(case.camera[0], ground)[0], axis=1)
        above = np.linalg.norm(project(off[0], high)[0] - project(case.camera[0], high)[0], axis=1)
        assert moved.max() < 6
        assert np.isfinite(above).all()
    # The centre alone, moved by as much, would shift the ground by far more.
    straight = replace(case.camera, t_cam_from_world=case.camera.t_cam_from_world + [0.3, 0.0, 0.0])
    assert np.linalg.norm(project(straight[0], ground)[0] - project(case.camera[0], ground)[0], axis=1).min() > 8


def test_the_solution_moves_with_the_camera_as_was_said(case, solved):
    info = known(solved, case)
    errors = camera_errors(case.camera, DOUBT, WORLD)
    for e, off in enumerate(errors):
        again = fitted(replace(case, camera=off))
        moved = again.states[:, :3] - solved.states[:, :3]
        said = info.picture_camera_spread[:, :3, e]
        if np.abs(said).max() > 0.01:
            assert np.linalg.norm(moved - said) < 0.3 * np.linalg.norm(said)
