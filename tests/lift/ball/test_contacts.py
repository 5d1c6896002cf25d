"""Contacts of rallies of a known world, from no events, from poor ones and with a person's marks; and extremes."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.ball import BallEvents, BallTrack, no_events
from pgm_data.geometry.camera import Camera, project
from pgm_data.lift.ball.contacts import ContactOptions, place_events
from pgm_data.lift.ball.solution import PlayersAt
from pgm_data.lift.ball.world import GRAVITY, ball_world
from pgm_data.scene import load_scene

TENNIS = ball_world(load_scene("tennis"))
TABLE = ball_world(load_scene("tabletennis"))
FEATHER = ball_world(load_scene("badminton"))
OPTIONS = ContactOptions()
FINE = 2e-3


def looking(centre, frames: int, focal: float) -> Camera:
    """A camera that looks at the middle of the court."""
    centre = np.array(centre, dtype=float)
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    K = np.array([[focal, 0, 640], [0, focal, 360], [0, 0, 1.0]])
    return Camera(
        K=np.repeat(K[None], frames, 0),
        distortion=np.zeros((frames, 4)),
        R_cam_from_world=np.repeat(R[None], frames, 0),
        t_cam_from_world=np.repeat((-R @ centre)[None], frames, 0),
    )


def flight(p, v, duration: float, world) -> np.ndarray:
    """States in fine steps until the ball is on the ground or the time is over."""
    states = [np.concatenate([p, v])]
    while len(states) * FINE < duration:
        p, v = states[-1][:3], states[-1][3:]
        pull = -world.drag_per_m.mean * np.linalg.norm(v) * v - np.array([0, 0, GRAVITY])
        half = v + 0.5 * FINE * pull
        states.append(np.concatenate([p + FINE * half, v + FINE * pull]))
        if states[-1][2] < world.radius_m and states[-1][5] < 0:
            break
    return np.array(states)


def rally(shots, world, e: float = 0.75):
    """Path of hits at given velocities, each flown to its bounce and for a while on: fine positions, contacts."""
    path, contacts, clock = [], [], 0.0
    p = np.array(shots[0][0], dtype=float)
    for _, velocity, after in shots:
        contacts.append((clock, "hit", p[1]))
        down = flight(p, np.array(velocity, dtype=float), 4.0, world)
        path.append(down[:-1, :3])
        clock += (len(down) - 1) * FINE
        contacts.append((clock, "bounce", down[-1, 1]))
        up = flight(down[-1, :3], down[-1, 3:] * np.array([0.75, 0.75, -e]), after, world)
        path.append(up[:-1, :3])
        clock += (len(up) - 1) * FINE
        p = up[-1, :3]
    return np.concatenate(path), contacts


def filmed(path: np.ndarray, centre, focal: float, fps: float, noise: float, seed: int):
    """A track of the path with noise, 8 % of its frames missing and one burst of three, and its camera."""
    rng = np.random.default_rng(seed)
    clock = np.arange(len(path)) * FINE
    times = np.arange(0.0, clock[-1], 1 / fps)
    points = np.stack([np.interp(times, clock, path[:, k]) for k in range(3)], axis=1)
    camera = looking(centre, len(times), focal)
    pixels = project(camera, points[:, None])[0][:, 0] + rng.normal(0, noise, (len(times), 2))
    lost = rng.random(len(times)) < 0.08
    lost[len(times) // 3 : len(times) // 3 + 3] = True
    pixels[lost] = np.nan
    return track_of(times, pixels, noise), camera


def track_of(times, pixels, sigma: float, duplicates=None) -> BallTrack:
    """A track of those pixels."""
    seen = np.isfinite(pixels).all(axis=1)
    return BallTrack(
        times=times,
        is_duplicate=np.zeros(len(times), bool) if duplicates is None else duplicates,
        pixels=pixels,
        sigma_px=np.where(seen, sigma, np.nan),
        score=np.where(seen, 0.9, np.nan),
        streak_px=np.full((len(times), 2), np.nan),
    )


def events_of(rows, source: str = "detected") -> BallEvents:
    """Events of time and kind."""
    rows = sorted(rows)
    n = len(rows)
    return BallEvents(
        times=np.array([t for t, _ in rows], dtype=float),
        kinds=np.array([k for _, k in rows], dtype=object),
        probability=np.full(n, 1.0 if source == "human" else 0.8),
        time_std=np.full(n, 0.03),
        sources=np.full(n, source, dtype=object),
        players=np.full(n, "", dtype=object),
        ground_px=np.full((n, 2), np.nan),
    )


SHOTS = [
    ((1.0, -12.0, 1.0), (-3.0, 27.0, 4.2), 0.40),
    (None, (2.5, -28.0, 4.5), 0.42),
    (None, (-1.0, 26.0, 4.6), 0.40),
    (None, (2.0, -27.0, 5.0), 0.45),
]
COURT = ((0.0, -31.0, 11.0), 2300.0)


@pytest.fixture(scope="module")
def court_rally():
    """A rally of four shots at 25 fps: track, camera, contacts."""
    path, contacts = rally(SHOTS, TENNIS)
    track, camera = filmed(path, *COURT, 25, 1.2, 1)
    return track, camera, contacts


def place(track, events, camera, world=TENNIS, players=None):
    """The contacts."""
    return place_events(track, events, camera, world=world, players=players, options=OPTIONS)


def found(events: BallEvents, contacts, within: float) -> int:
    """How many contacts have an event of their kind near enough."""
    return sum(bool((np.abs(events.times[events.kinds == kind] - t) < within).any()) for t, kind, _ in contacts)


@pytest.mark.parametrize("fps", [25, 30, 50])
def test_a_rally_is_told_from_its_track_alone(fps):
    path, contacts = rally(SHOTS, TENNIS)
    right = said = 0
    for seed in range(1):
        track, camera = filmed(path, *COURT, fps, 1.2, seed)
        events = place(track, no_events(), camera)
        right += found(events, contacts[1:], 2 / fps)
        said += int(np.isin(events.kinds, ("hit", "bounce", "net")).sum())
    wanted = len(contacts) - 1
    assert right >= wanted - 1
    assert said <= wanted + 2


def test_times_are_much_finer_than_a_frame_and_their_errors_stated(court_rally):
    track, camera, contacts = court_rally
    events = place(track, no_events(), camera)
    off, score = [], []
    for t, kind, _ in contacts[1:]:
        near = np.flatnonzero((events.kinds == kind) & (np.abs(events.times - t) < 0.08))
        off.append(events.times[near[0]] - t)
        score.append(off[-1] / events.time_std[near[0]])
    assert np.median(np.abs(off)) < 0.15 / 25
    assert np.abs(score).max() < 6


def test_hits_have_the_player_of_their_side(court_rally):
    track, camera, contacts = court_rally
    n = len(track.times)
    named = PlayersAt(
        names=("ann", "bea"), root_position=np.full((n, 2, 3), np.nan), hands=np.full((n, 2, 2, 3), np.nan)
    )
    for players, names in ((None, ("player0", "player1")), (named, ("ann", "bea"))):
        events = place(track, no_events(), camera, players=players)
        hits = np.flatnonzero(events.kinds == "hit")
        assert len(hits)
        for hit in hits:
            side = min((c for c in contacts if c[1] == "hit"), key=lambda c: abs(c[0] - events.times[hit]))[2]
            assert events.players[hit] == names[int(side > 0)]
        assert (events.players[events.kinds != "hit"] == "").all()


def test_poor_hints_do_no_harm(court_rally):
    track, camera, contacts = court_rally
    wrong = {"hit": "bounce", "bounce": "hit"}
    hints = [(t + 0.03, wrong[k] if i == 3 else k) for i, (t, k, _) in enumerate(contacts) if i not in (1, 5)]
    hints.append((contacts[2][0] + 0.4, "bounce"))
    events = place(track, events_of(hints), camera)
    assert found(events, contacts[1:], 0.08) >= len(contacts) - 2


def test_what_a_person_says_stays_and_is_alone(court_rally):
    track, camera, contacts = court_rally
    marks = events_of([(contacts[2][0] + 0.02, "hit"), (contacts[4][0] + 0.25, "net")], "human")
    events = place(track, marks, camera)
    kept = events.take(events.sources == "human")
    assert kept.kinds.tolist() == ["hit", "net"]
    assert (np.abs(kept.times - marks.times) <= 3 * 0.03 + 1e-9).all()
    assert abs(kept.times[0] - contacts[2][0]) < 0.02
    others = events.times[events.sources != "human"]
    assert (np.abs(others[:, None] - kept.times).min(axis=1) > 1.9 / 25).all()


def test_a_person_may_mark_what_nobody_sees(court_rally):
    track, camera, _ = court_rally
    marks = events_of([(-3.0, "hit"), (99.0, "last")], "human")
    events = place(track, marks, camera)
    assert events.times[0] == -3.0 and events.times[-1] == 99.0
    blind = replace(track, pixels=np.full_like(track.pixels, np.nan))
    assert place(blind, marks, camera).kinds.tolist() == ["hit", "last"]


def test_repeated_frames_are_no_measurements(court_rally):
    track, camera, contacts = court_rally
    twice = np.repeat(np.arange(len(track.times)), 2)
    duplicates = np.tile([False, True], len(track.times))
    repeated = track_of(track.times[twice], track.pixels[twice], 1.2, duplicates)
    events, plain = place(repeated, no_events(), camera[twice]), place(track, no_events(), camera)
    np.testing.assert_allclose(events.times, plain.times, atol=1e-6)
    assert events.kinds.tolist() == plain.kinds.tolist()


def test_strays_are_passed_over(court_rally):
    track, camera, contacts = court_rally
    pixels = track.pixels.copy()
    pixels[10::23] = [900.0, 200.0]
    events = place(track_of(track.times, pixels, 1.2), no_events(), camera)
    assert found(events, contacts[1:], 0.08) >= len(contacts) - 3


@pytest.mark.parametrize("view", [((4.5, 0.0, 1.6), 1300.0), ((-3.3, 2.3, 1.3), 1100.0), ((0.0, -24.8, 4.5), 5600.0)])
def test_a_bounce_on_a_table_is_found_from_no_events(view):
    path, contacts = rally([((0.2, -1.5, 0.35), (-0.3, 7.5, 0.6), 0.22)], TABLE, e=0.9)
    right = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        clock = np.arange(len(path)) * FINE
        times = np.arange(0.0, clock[-1], 1 / 25)
        points = np.stack([np.interp(times, clock, path[:, k]) for k in range(3)], axis=1)
        camera = looking(view[0], len(times), view[1])
        pixels = project(camera, points[:, None])[0][:, 0] + rng.normal(0, 2.0, (len(times), 2))
        events = place(track_of(times, pixels, 2.0), no_events(), camera, TABLE)
        bounces = events.times[events.kinds == "bounce"]
        right += len(bounces) == 1 and abs(bounces[0] - contacts[1][0]) < 0.04
    assert right >= 2


def test_a_ball_that_does_not_bounce_has_no_bounces(court_rally):
    track, camera, contacts = court_rally
    events = place(track, events_of([(t, k) for t, k, _ in contacts]), camera, FEATHER)
    assert "bounce" not in events.kinds.tolist()
    marked = place(track, events_of([(contacts[1][0], "bounce")], "human"), camera, FEATHER)
    assert marked.take(marked.kinds == "bounce").sources.tolist() == ["human"]


def no_camera(frames: int) -> Camera:
    """Frames without a camera."""
    return Camera(
        K=np.full((frames, 3, 3), np.nan),
        distortion=np.full((frames, 4), np.nan),
        R_cam_from_world=np.full((frames, 3, 3), np.nan),
        t_cam_from_world=np.full((frames, 3), np.nan),
    )


def test_without_a_camera_the_given_events_come_back(court_rally):
    track, _, contacts = court_rally
    given = events_of([(t, k) for t, k, _ in contacts])
    assert place(track, given, no_camera(len(track.times))) is given


def test_hard_tracks_give_little_and_never_raise(court_rally):
    track, camera, _ = court_rally
    n = len(track.times)
    rng = np.random.default_rng(0)
    turned = np.diag([-1.0, 1.0, -1.0])
    away = replace(
        camera,
        R_cam_from_world=turned @ camera.R_cam_from_world,
        t_cam_from_world=camera.t_cam_from_world @ turned,
    )
    blind = np.full((n, 2), np.nan)
    cases = {
        "unseen": (track_of(track.times, blind, 1.0), camera),
        "repeats": (track_of(track.times, track.pixels, 1.0, np.ones(n, bool)), camera),
        "noise": (track_of(track.times, rng.uniform(0, 700, (n, 2)), 1.0), camera),
        "far": (track_of(track.times, rng.uniform(-1e6, 1e6, (n, 2)), 1.0), camera),
        "still": (track_of(track.times, np.full((n, 2), 400.0), 1.0), camera),
        "behind": (track, away),
    }
    for name, (hard, view) in cases.items():
        events = place(hard, no_events(), view)
        assert np.isfinite(events.times).all() and np.isfinite(events.time_std).all(), name
        assert "hit" not in events.kinds.tolist() or name in ("noise", "far", "behind"), name
    for count in range(8):
        part = slice(20, 20 + count)
        place(track_of(track.times[part], track.pixels[part], 1.0), no_events(), camera[part])


def test_a_lob_of_thirty_seconds_does_no_harm():
    times = np.arange(0, 30, 0.04)
    camera = looking(*COURT[:1], len(times), COURT[1])
    points = np.stack([0 * times, -12 + 0.8 * times, 1 + 147.0 * times - 0.5 * GRAVITY * times**2], axis=1)
    pixels = project(camera, points[:, None])[0][:, 0]
    events = place(track_of(times, pixels, 1.0), no_events(), camera)
    assert (events.probability <= 1).all()
