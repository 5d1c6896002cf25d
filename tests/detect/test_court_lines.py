"""A court drawn through a known camera is found again from its lines; what is no court is not."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.court import Court
from pgm_data.detect.court_evidence import line_marks, marks_beyond_ends
from pgm_data.detect.court_hypotheses import camera_position, court_grid, focal_and_skewness, quadrangles
from pgm_data.detect.court_lines import LineGuessOptions, guess_homographies
from pgm_data.detect.line_segments import long_lines, straight_ridges
from pgm_data.scene import load_scene

OPTIONS = LineGuessOptions()


def court_of(scene: str) -> Court:
    court = load_scene(scene).court
    assert court is not None
    return court


def looking_at(position: np.ndarray, target: np.ndarray, roll: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """R_cam_from_world and t of a camera at `position` that looks at `target`."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    c, s = np.cos(roll), np.sin(roll)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R
    return R, -R @ position


def homography(focal: float, R: np.ndarray, t: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    K = np.array([[focal, 0.0, (size[0] - 1) / 2], [0.0, focal, (size[1] - 1) / 2], [0.0, 0.0, 1.0]])
    H = K @ np.column_stack([R[:, 0], R[:, 1], t])
    return H / H[2, 2]


def seen_at(H: np.ndarray, ground: np.ndarray) -> np.ndarray:
    p = np.column_stack([ground[:, :2], np.ones(len(ground))]) @ H.T
    return p[:, :2] / p[:, 2:]


def broadcast_view(rng: np.random.Generator, court: Court, size: tuple[int, int]) -> np.ndarray:
    """From behind the near end as television sees it, the near end spanning 55 to 90 % of the width."""
    half = np.abs(court.points_world[:, :2]).max(axis=0)
    position = np.array([rng.normal(0, 0.1), -half[1] * rng.uniform(2.5, 4.5), half[1] * rng.uniform(0.65, 1.1)])
    R, t = looking_at(position, np.array([rng.normal(0, 0.1) * half[0], rng.uniform(-0.15, 0.1) * half[1], 0.0]))
    near = seen_at(homography(1000.0, R, t, size), np.array([[-half[0], -half[1]], [half[0], -half[1]]]))
    return homography(1000.0 * rng.uniform(0.55, 0.9) * size[0] / np.ptp(near[:, 0]), R, t, size)


def ribbon(H: np.ndarray, start: np.ndarray, stop: np.ndarray, width: float) -> np.ndarray:
    along = (stop - start) / np.linalg.norm(stop - start)
    side = np.array([-along[1], along[0]]) * width / 2
    return seen_at(H, np.stack([start + side, stop + side, stop - side, start - side]))


def filled(picture: np.ndarray, polygon: np.ndarray, value: float) -> None:
    # At four times the size, so that a line a fraction of a pixel wide is as faint as it would be in a photograph.
    corners = np.rint((4 * polygon + 1.5) * 64).clip(-(2**24), 2**24).astype(np.int32)
    cv2.fillConvexPoly(picture, corners, float(value), cv2.LINE_AA, 6)


def drawn(rng: np.random.Generator, court: Court, H: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The court, a crowd, a banner, people, a caption and noise, as grey values."""
    width, height = size
    ground, paint = rng.uniform(60, 120), rng.uniform(170, 230)
    picture = np.full((4 * height, 4 * width), ground, np.float32)
    for (start, stop), line_width in zip(court.lines_world[:, :, :2], court.line_width, strict=True):
        filled(picture, ribbon(H, start, stop, line_width), paint)
    picture = np.rint(cv2.resize(picture, size, interpolation=cv2.INTER_AREA)).astype(np.uint8)
    top = int(max(0.05 * height, seen_at(H, court.points_world)[:, 1].min() - 0.06 * height))
    crowd = cv2.resize(rng.integers(20, 200, (top // 3 + 1, width // 3 + 1), dtype=np.uint8), (width, top))
    picture[:top] = crowd
    picture[int(0.8 * top) : top] = rng.uniform(30, 60)
    cv2.putText(picture, "SPONSOR  COURT", (width // 4, top - 2), cv2.FONT_HERSHEY_SIMPLEX, top / 150, 220, 2)
    for _ in range(4):
        x, y, tall = rng.integers(width), rng.integers(top, height), height // 12
        cv2.ellipse(picture, (int(x), int(y)), (tall // 3, tall), 0, 0, 360, float(rng.uniform(10, 250)), -1)
    cv2.rectangle(picture, (width // 20, height * 9 // 10), (width // 4, height * 19 // 20), 20, -1)
    blurred = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), rng.uniform(0.4, 0.9))
    picture = blurred + rng.normal(0, 3, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def worst_error(pixel_from_ground: np.ndarray, truth: np.ndarray, court: Court) -> float:
    """Largest distance between the best guess's court points and the true ones, pixels; infinite without a guess."""
    if len(pixel_from_ground) == 0:
        return np.inf
    apart = seen_at(pixel_from_ground[0], court.points_world) - seen_at(truth, court.points_world)
    return float(np.linalg.norm(apart, axis=1).max())


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball"])
def test_every_broadcast_view_is_found_within_three_pixels(scene: str) -> None:
    court, size = court_of(scene), (960, 540)
    rng = np.random.default_rng(7)
    errors = []
    for _ in range(4):
        truth = broadcast_view(rng, court, size)
        guesses = guess_homographies(drawn(rng, court, truth, size), court, OPTIONS)
        errors.append(worst_error(guesses.pixel_from_ground, truth, court))
    assert max(errors) < 3.0, errors


@pytest.mark.parametrize(
    ("size", "direction", "roll"),
    [((720, 1280), 0.0, 0.0), ((1280, 720), 0.9, 0.0), ((1280, 720), -0.7, 0.0), ((1280, 720), 0.2, 0.25)],
    ids=["portrait", "from the right", "from the left", "held askew"],
)
def test_unusual_views_are_found_within_three_pixels(size: tuple[int, int], direction: float, roll: float) -> None:
    court = court_of("tennis")
    position = 32.0 * np.array([np.sin(direction), -np.cos(direction), 0.0]) + np.array([0.0, 0.0, 14.0])
    R, t = looking_at(position, np.array([0.0, -1.0, 0.0]), roll)
    spread = np.ptp(seen_at(homography(1000.0, R, t, size), court.points_world), axis=0)
    truth = homography(1000.0 * 0.8 * (np.array(size) / spread).min(), R, t, size)
    guesses = guess_homographies(drawn(np.random.default_rng(1), court, truth, size), court, OPTIONS)
    assert worst_error(guesses.pixel_from_ground, truth, court) < 3.0


@pytest.fixture(scope="module")
def tennis_view() -> tuple[Court, np.ndarray, np.ndarray]:
    """A tennis court, the homography it is seen through, and the picture."""
    court, size = court_of("tennis"), (960, 540)
    rng = np.random.default_rng(3)
    truth = broadcast_view(rng, court, size)
    return court, truth, drawn(rng, court, truth, size)


def test_guesses_fall_in_score_and_are_of_cameras_on_the_near_side_above_the_ground(tennis_view) -> None:
    court, _, picture = tennis_view
    guesses = guess_homographies(picture, court, replace(OPTIONS, least_score=0.0))
    assert 1 < len(guesses.scores) <= OPTIONS.guesses
    assert np.all(np.diff(guesses.scores) <= 0) and np.all((guesses.scores >= 0) & (guesses.scores <= 1))
    centred = np.array([[1 / 960, 0, -479.5 / 960], [0, 1 / 960, -269.5 / 960], [0, 0, 1]]) @ guesses.pixel_from_ground
    focal, _ = focal_and_skewness(centred[:, :, 0], centred[:, :, 1])
    position = camera_position(centred, focal)
    assert np.all(position[:, 1] <= 0) and np.all(position[:, 2] > 0)


def test_the_right_guess_stands_well_above_the_next(tennis_view) -> None:
    court, _, picture = tennis_view
    scores = guess_homographies(picture, court, replace(OPTIONS, least_score=0.0)).scores
    assert scores[0] > 0.8 and scores[0] > scores[1] + 0.2


def test_a_picture_twice_as_large_gives_the_same_court_in_its_own_pixels(tennis_view) -> None:
    court, truth, picture = tennis_view
    large = cv2.resize(picture, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    guesses = guess_homographies(large, court, OPTIONS)
    # The corner of the top-left pixel stays where it is, so its centre goes from 0 to 0.5.
    twice = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]]) @ truth
    assert worst_error(guesses.pixel_from_ground, twice, court) < 4.0


def test_contrast_and_brightness_do_not_move_the_court(tennis_view) -> None:
    court, truth, picture = tennis_view
    faint = np.rint(100.0 + 0.25 * picture).astype(np.uint8)
    assert worst_error(guess_homographies(faint, court, OPTIONS).pixel_from_ground, truth, court) < 3.0


@pytest.mark.parametrize("other", ["badminton", "pickleball"])
def test_another_sports_court_gives_no_tennis_court(other: str) -> None:
    size = (1280, 720)
    rng = np.random.default_rng(11)
    court = court_of(other)
    picture = drawn(rng, court, broadcast_view(rng, court, size), size)
    assert len(guess_homographies(picture, court_of("tennis"), OPTIONS).scores) == 0


@pytest.mark.parametrize("kind", ["black", "white", "noise", "crowd", "stripes", "one line"])
@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis"])
def test_pictures_without_a_court_give_no_guess(kind: str, scene: str) -> None:
    rng = np.random.default_rng(5)
    picture = np.zeros((360, 640), np.uint8)
    if kind == "white":
        picture[:] = 255
    elif kind == "noise":
        picture[:] = rng.integers(0, 256, picture.shape)
    elif kind == "crowd":
        picture[:] = cv2.resize(rng.integers(0, 256, (90, 160), dtype=np.uint8), (640, 360))
    elif kind == "stripes":
        picture[::20] = 200
    elif kind == "one line":
        cv2.line(picture, (20, 300), (600, 250), 255, 3)
    assert len(guess_homographies(picture, court_of(scene), OPTIONS).scores) == 0


@settings(max_examples=15)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_tiny_pictures_give_an_answer(height: int, width: int, seed: int) -> None:
    picture = np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    guesses = guess_homographies(picture, court_of("tennis"), OPTIONS)
    assert guesses.pixel_from_ground.shape == (len(guesses.scores), 3, 3)


@pytest.mark.parametrize("shape", [(1, 2000), (2000, 1), (8, 8), (20, 3000)])
def test_slivers_give_no_guess(shape: tuple[int, int]) -> None:
    picture = np.full(shape, 90, np.uint8)
    assert len(guess_homographies(picture, court_of("tennis"), OPTIONS).scores) == 0


def test_a_court_with_lines_one_way_only_gives_no_guess(tennis_view) -> None:
    court, _, picture = tennis_view
    keep = [i for i, name in enumerate(court.line_names) if "side" in name]
    lines = tuple(court.line_names[i] for i in keep)
    rails = replace(court, line_names=lines, line_ends=court.line_ends[keep], line_width=court.line_width[keep])
    assert len(guess_homographies(picture, rails, OPTIONS).scores) == 0


@given(st.floats(0.5, 5.0), st.floats(-3.1, 3.1), st.floats(0.15, 1.3), st.floats(-0.5, 0.5), st.floats(10.0, 60.0))
def test_focal_length_and_place_come_back_from_a_homography(
    focal: float, turn: float, rise: float, roll: float, far: float
) -> None:
    position = far * np.array([np.cos(rise) * np.sin(turn), -np.cos(rise) * np.cos(turn), np.sin(rise)])
    R, t = looking_at(position, np.zeros(3), roll)
    H = np.diag([focal, focal, 1.0]) @ np.column_stack([R[:, 0], R[:, 1], t])
    found, left = focal_and_skewness(H[None, :, 0], H[None, :, 1])
    assert left[0] < 1e-6
    np.testing.assert_allclose(found, focal, rtol=1e-6)
    np.testing.assert_allclose(camera_position(H[None], found)[0], position, atol=1e-5 * far)


def test_quadrangles_map_the_unit_square_onto_the_crossings() -> None:
    across = np.array([[0.05, 1.0, -0.3], [-0.02, 1.0, 0.2], [0.0, 1.0, 0.05]])
    along = np.array([[1.0, 0.4, 0.3], [1.0, -0.3, -0.2]])
    Q, index = quadrangles(across, along)
    assert len(Q) == 3
    for homography_, (v0, v1, u0, u1) in zip(Q, index, strict=True):
        for (u, a), (v, b) in itertools.product(((0, u0), (1, u1)), ((0, v0), (1, v1))):
            crossing = np.cross(across[b], along[a])
            corner = homography_ @ np.array([u, v, 1.0])
            np.testing.assert_allclose(corner[:2] / corner[2], crossing[:2] / crossing[2], atol=1e-12)


@pytest.mark.parametrize("scene", ["tennis", "badminton", "pickleball", "tabletennis"])
def test_marks_beyond_the_ends_lie_on_no_line_of_their_direction(scene: str) -> None:
    court = court_of(scene)
    marks, beyond = line_marks(court, 400), marks_beyond_ends(court, 8)
    assert len(beyond.ground) > 0 and court_grid(court).turns_onto_itself
    same = np.abs(beyond.along @ marks.along.T) > 0.99
    apart = np.linalg.norm(beyond.ground[:, None, :2] - marks.ground[None, :, :2], axis=2)
    assert apart[same].min() > 0.3 * 0.05 * np.abs(court.points_world).max()


@given(st.floats(0.0, 180.0), st.floats(1.0, 8.0), st.floats(-3.0, 3.0))
def test_the_centre_of_a_line_is_found_whatever_its_width_and_direction(
    degrees: float, width: float, shift: float
) -> None:
    angle = np.deg2rad(degrees)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    y, x = np.mgrid[0:160, 0:160]
    distance = (np.stack([x, y], axis=-1) - 79.5) @ across - shift
    picture = np.rint(60 + 120 * np.clip((width + 1) / 2 - np.abs(distance), 0, 1)).astype(np.uint8)
    lines = long_lines(straight_ridges(picture, contrast=1.0, chain=12.0), shortest=60.0, most=5)
    offset = lines.line[0] @ np.array([*(79.5 + shift * across), 1.0])
    assert abs(offset) < 0.6
    assert abs(lines.direction[0] @ along) > np.cos(np.deg2rad(1.0))


def frame_of(path: Path, number: int) -> np.ndarray:
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        return next(itertools.islice(container.decode(video=0), number, None)).to_ndarray(format="gray")


@pytest.mark.parametrize(("clip", "frame"), [("paris_1080p30", 46), ("rome_1080p30", 15)])
def test_hand_read_points_of_a_broadcast_lie_within_six_pixels(real_data: Path, clip: str, frame: int) -> None:
    court = court_of("tennis")
    read = json.loads((real_data / "court_keypoints.json").read_text())["frames"][f"tennis/{clip}.mp4"][str(frame)]
    guesses = guess_homographies(frame_of(real_data / "tennis" / f"{clip}.mp4", frame), court, OPTIONS)
    expected = np.array([read[name] for name in court.point_names])
    found = seen_at(guesses.pixel_from_ground[0], court.points_world)
    assert np.linalg.norm(found - expected, axis=1).max() < 6.0


@pytest.mark.parametrize("clip", ["badminton_1080p50", "pickleball_720p30", "tabletennis_720p25_moving"])
def test_a_real_court_of_another_sport_gives_no_tennis_court(real_data: Path, clip: str) -> None:
    picture = frame_of(real_data / "other_sports" / f"{clip}.mp4", 5)
    assert len(guess_homographies(picture, court_of("tennis"), OPTIONS).scores) == 0
