"""A clip's shared centre and lens in known worlds: the simplest lens that the data support, and honest error bars."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.lift.clip_fit import ClipFitOptions
from pgm_data.lift.clip_pad import padded
from pgm_data.lift.clip_solve import LensOptions, between, key_frames, solve_frames, solve_shared
from pgm_data.lift.court_camera import CourtCamera, project, step
from pgm_data.lift.court_samples import sample_lines
from pgm_data.lift.line_consensus import on_course
from pgm_data.lift.line_fit import FREE_LENS, Sightings, fit_track
from pgm_data.lift.plausible import TrustOptions, camera_trust
from pgm_data.lift.views import group_views
from pgm_data.scene import load_scene
from tests.lift.test_court_camera import looking_at_court

court = load_scene("tennis").court
assert court is not None
UPSIDE_DOWN = np.diag([-1.0, -1.0, 1.0]) @ looking_at_court((0, -36.0, 9.5)).R_cam_from_world
SIZE, LINES = (1920, 1080), len(court.line_names)


def track_of(frames, *, radial, focal=2400.0, shift=(0.0, 0.0)):
    """A camera that pans and zooms about one centre."""
    cameras = []
    for share in np.linspace(-1, 1, frames):
        camera = looking_at_court((0.2, -36.0, 9.5), focal=focal * (1 + 0.05 * share), radial=radial, pan=0.03 * share)
        cameras.append(replace(camera, principal_px=camera.principal_px + np.array(shift)))
    names = ("R_cam_from_world", "focal_px", "position_world", "radial", "principal_px")
    stacked = {n: np.stack([np.asarray(getattr(c, n)) for c in cameras]) for n in names}
    return CourtCamera(**stacked, half_diagonal_px=cameras[0].half_diagonal_px)


def sighted(track, rng, *, noise=0.15, crooked=None):
    """What every frame measures: line centres with noise, and each line's own crookedness where given."""
    frames = []
    for index in range(len(track.focal_px)):
        s = sample_lines(track[index], court, size=SIZE, spacing_px=8.0, most=150)
        offset = rng.normal(size=len(s.line)) * noise
        if crooked is not None:
            offset += crooked[s.line, 0] + crooked[s.line, 1] * s.along
        frames.append(
            Sightings(
                points_world=s.points_world,
                measured_px=s.pixels + s.normals * offset[:, None],
                normals=s.normals,
                sigma_px=np.full(len(s.line), noise),
                line=s.line,
                along=s.along,
                bias_px=np.zeros(len(s.line)),
            )
        )
    return padded(frames, 1)


def solved(track, sightings, *, crooked_px=0.3):
    start = step(track, np.tile([0.001, -0.001, 0.0005, 0.01, 0.1, -0.3, 0.1, 0, 0, 0], (len(track.focal_px), 1)))
    start = replace(start, principal_px=np.broadcast_to([959.5, 539.5], start.principal_px.shape))
    options = ClipFitOptions(crooked_px=crooked_px)
    return solve_shared(start, sightings, court=court, size=SIZE, fit_options=options, lens=LensOptions())


def test_a_pinhole_camera_gets_no_lens_parameter():
    track = track_of(8, radial=0.0)
    solution = solved(track, sighted(track, np.random.default_rng(0)))
    assert solution.lens_model == "pinhole"
    assert 7 not in solution.clip_fit.shared
    assert (solution.clip_fit.fit.camera.radial == 0).all()
    assert "none fitted" in solution.evidence


def test_a_radial_lens_gets_one_term_and_its_value():
    track = track_of(8, radial=0.03)
    solution = solved(track, sighted(track, np.random.default_rng(1)))
    assert solution.lens_model == "radial"
    assert solution.clip_fit.fit.camera.radial[0] == pytest.approx(0.03, abs=0.002)


def test_a_cropped_recording_gets_its_principal_point():
    track = track_of(8, radial=0.03, shift=(60.0, -40.0))
    solution = solved(track, sighted(track, np.random.default_rng(2)))
    assert solution.lens_model == "radial and principal point"
    np.testing.assert_allclose(solution.clip_fit.fit.camera.principal_px[0], [1019.5, 499.5], atol=15)


def test_the_centre_is_found_within_its_error_bars_over_many_worlds():
    z = []
    for seed in range(24):
        track = track_of(6, radial=0.02)
        solution = solved(track, sighted(track, np.random.default_rng([7, seed])))
        error = solution.clip_fit.fit.camera.position_world[0] - [0.2, -36.0, 9.5]
        assert np.linalg.norm(error) < 0.2
        z.append(error / np.sqrt(np.diag(solution.clip_fit.position_covariance)))
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert (spread > 0.3).all()
    assert (spread < 1.7).all()


def test_a_crooked_court_widens_the_error_bars_instead_of_averaging_away():
    rng = np.random.default_rng(3)
    straight, bent = track_of(10, radial=0.02), rng.normal(size=(LINES, 2)) * 0.6
    exact = solved(straight, sighted(straight, rng, noise=0.1))
    worn = solved(straight, sighted(straight, rng, noise=0.1, crooked=bent))
    assert worn.clip_fit.crooked_px > 5 * exact.clip_fit.crooked_px
    assert np.trace(worn.clip_fit.position_covariance) > 10 * np.trace(exact.clip_fit.position_covariance)
    error = worn.clip_fit.fit.camera.position_world[0] - [0.2, -36.0, 9.5]
    assert (np.abs(error) < 4 * np.sqrt(np.diag(worn.clip_fit.position_covariance))).all()


def test_a_hundred_frames_of_a_still_camera_count_as_one_view():
    still = track_of(3, radial=0.0)[[1] * 100]
    (group,) = group_views(still, court.points_world, apart_px=8.0, most=24)
    assert len(group) == 100
    groups = group_views(track_of(40, radial=0.0), court.points_world, apart_px=8.0, most=6)
    assert 2 < len(groups) <= 6


def test_frames_keep_their_own_rotation_and_focal_length():
    track = track_of(8, radial=0.03)
    sightings = sighted(track, np.random.default_rng(4))
    solution = solved(track, sightings)
    frames = solve_frames(track, sightings, solution=solution, lines=LINES)
    np.testing.assert_allclose(frames.fit.camera.focal_px, track.focal_px, rtol=2e-3)
    error = np.abs(frames.fit.camera.focal_px - track.focal_px)
    assert (error < 5 * frames.focal_std_px).all()
    away = project(frames.fit.camera, np.broadcast_to(court.points_world, (8, 14, 3)))
    truth = project(track, np.broadcast_to(court.points_world, (8, 14, 3)))
    assert np.nanmax(np.abs(away - truth)) < 0.5


def test_a_fifth_of_wrong_measurements_changes_little():
    rng = np.random.default_rng(5)
    track = track_of(6, radial=0.02)
    clean = sighted(track, rng)
    wrong = np.isfinite(clean.sigma_px) & (rng.random(clean.sigma_px.shape) < 0.2)
    jumped = clean.measured_px + clean.normals * (wrong * rng.uniform(3, 10, wrong.shape))[..., None]
    solution = solved(track, replace(clean, measured_px=jumped))
    assert np.linalg.norm(solution.clip_fit.fit.camera.position_world[0] - [0.2, -36.0, 9.5]) < 0.25


def test_one_frame_is_fitted_from_afar():
    seen = sighted(track_of(1, radial=0.0), np.random.default_rng(6), noise=0.05)
    track = track_of(1, radial=0.0)
    start = step(track, np.array([[0.004, -0.006, 0.002, 0.08, 0.4, -2.0, 0.5, 0.01, 0, 0]]))
    fit = fit_track(start, seen, free=FREE_LENS, crooked_px=0.0, lines=LINES, steps=25)
    np.testing.assert_allclose(fit.camera.position_world[0], track.position_world[0], atol=0.2)


def test_cameras_between_two_turn_evenly():
    track = track_of(2, radial=0.02)
    middle = between(track[0], track[1], np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(middle.R_cam_from_world[0], track.R_cam_from_world[0], atol=1e-12)
    np.testing.assert_allclose(middle.R_cam_from_world[2], track.R_cam_from_world[1], atol=1e-12)
    assert middle.focal_px[1] == pytest.approx(np.sqrt(track.focal_px[0] * track.focal_px[1]))


def test_key_frames_cover_the_whole_pan():
    chosen = key_frames(track_of(300, radial=0.0), 20)
    assert len(chosen) <= 20
    assert chosen[0] == 0
    assert chosen[-1] == 299


def test_stray_measurements_do_not_follow_their_lines_course():
    along = np.linspace(-1, 1, 30)
    offset = 3.0 + 2.0 * along
    offset[::5] += 4.0
    keep = on_course(np.zeros(30, int), along, offset, tolerance_px=0.5)
    assert not keep[::5].any()
    assert keep.sum() == 24
    noise = np.random.default_rng(0).uniform(-10, 10, 30)
    assert on_course(np.zeros(30, int), along, noise, tolerance_px=0.3).sum() < 12


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"position_world": np.array([0.0, -36.0, 0.2])}, "height"),
        ({"position_world": np.array([0.0, -900.0, 40.0])}, "distance"),
        ({"focal_px": np.array(90000.0)}, "focal"),
        ({"radial": np.array(0.9)}, "radial"),
        (
            {"R_cam_from_world": np.diag([-1.0, -1.0, 1.0]) @ looking_at_court((0, -36.0, 9.5)).R_cam_from_world},
            "upside",
        ),
    ],
)
def test_impossible_cameras_are_not_believed(change, reason):
    good = looking_at_court((0.0, -36.0, 9.5))
    assert camera_trust(good, court, width=1920, options=TrustOptions()) == ""
    assert reason in camera_trust(replace(good, **change), court, width=1920, options=TrustOptions())
