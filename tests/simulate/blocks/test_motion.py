import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.scene import load_scene
from pgm_data.simulate.blocks.agenda import draw_course
from pgm_data.simulate.blocks.building import build_world
from pgm_data.simulate.blocks.course import KINDS
from pgm_data.simulate.blocks.figure import (
    LEG_M,
    PART_BOXES_M,
    SOLE_HALF_M,
    angle_of,
    blocks13,
    gait_of,
    half_stride,
    hip_height,
    hull_points,
    posture_at,
)
from pgm_data.simulate.blocks.moves import GRAVITY, JUMP_M, SPRINT_SPEED, airborne_s, drop, hop, jump, travel_times
from pgm_data.simulate.blocks.navigation import ways_of
from pgm_data.simulate.blocks.world import SOLID
from pgm_data.simulate.rotations import facing

SECONDS = 80.0


class Walk:
    """One long course and the figure on it at 50 Hz."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.world = build_world(rng)
        self.course = draw_course(rng, self.world, ways_of(self.world), SECONDS)
        self.times = np.arange(0, SECONDS, 0.02)
        self.posture = posture_at(self.course, gait_of(self.course), self.world, self.times)
        self.feet = self.course.feet_at(self.times)
        self.kind = np.array(KINDS)[self.course.kind_at(self.times)]
        self.hull = hull_points(self.posture).reshape(len(self.times), 6, 8, 3)


@pytest.fixture(scope="module", params=[0, 1])
def walk(request):
    return Walk(request.param)


def solid_boxes(world):
    """Lower corners of all solid half-metre cells, found cell by cell."""
    return np.argwhere(SOLID[world.cells]) * 0.5 + [-8.0, -8.0, -2.0]


def test_the_body_passes_through_nothing(walk):
    low = solid_boxes(walk.world)
    deepest = 0.0
    for feet in walk.feet:
        near = low[(np.abs(low[:, :2] + 0.25 - feet[:2]) < 0.9).all(axis=1)]
        a = np.minimum(feet + [0.3, 0.3, 1.8], near + 0.5) - np.maximum(feet - [0.3, 0.3, 0.0], near)
        deepest = max(deepest, float(a.min(axis=1).max(initial=0.0)))
        for post_low, post_high in walk.world.posts:
            b = np.minimum(feet + [0.3, 0.3, 1.8], post_high) - np.maximum(feet - [0.3, 0.3, 0.0], post_low)
            deepest = max(deepest, float(b.min()))
    assert deepest < 0.01


def test_soles_enter_no_block(walk):
    """Corners of both soles: at most 1 cm inside of anything solid; 2 cm lower they would be."""
    # Of a leg's eight corners (x, y, z low to high) those with low y.
    soles = walk.hull[:, 4:][:, :, [0, 1, 4, 5]].reshape(-1, 3)
    assert depths(walk.world, soles).max() < 0.01
    assert (depths(walk.world, soles - [0.0, 0.0, 0.02]) > 0.015).mean() > 0.2


def depths(world, points):
    """How deep points lie inside of solid cells, metres."""
    cell = np.floor((points + [8.0, 8.0, 2.0]) / 0.5).astype(int)
    inside = ((cell >= 0) & (cell < SOLID[world.cells].shape)).all(axis=1)
    hit = np.zeros(len(points), dtype=bool)
    hit[inside] = SOLID[world.cells][tuple(cell[inside].T)]
    within = points - (cell * 0.5 + [-8.0, -8.0, -2.0])
    return np.where(hit, np.minimum(within, 0.5 - within).min(axis=1), 0.0)


def test_who_stands_stands_exactly_on_a_top(walk):
    grounded = walk.course.grounded_at(walk.times)
    tops = np.argwhere(SOLID[walk.world.cells]) * 0.5 + [-7.75, -7.75, -1.5]
    checked = 0
    for feet in walk.feet[grounded][::7]:
        under = tops[(np.abs(tops[:, :2] - feet[:2]) < 0.55 + 0.02).all(axis=1)]
        assert np.abs(under[:, 2] - feet[2]).min() < 1e-9
        checked += 1
    assert checked > 300
    lowest = walk.hull[:, 4:, :, 2].min(axis=(1, 2))
    np.testing.assert_allclose(lowest, walk.feet[:, 2], atol=1e-9)


def test_contact_is_flagged_where_a_sole_rests_on_something(walk):
    for side, leg in ((0, 4), (1, 5)):
        on = walk.posture.contact[:, side]
        assert 0.2 < on.mean() < 0.8
        sole = walk.hull[on, leg][:, [0, 1, 4, 5], 2].min(axis=1)
        assert np.abs(sole - walk.feet[on, 2]).max() < 0.011
        assert not np.isin(walk.kind[on], ["jump", "fall", "climb_up", "climb_down"]).any()


def test_planted_soles_hardly_slide_on_straight_ways(walk):
    fine = np.arange(0, SECONDS, 0.005)
    posture = posture_at(walk.course, gait_of(walk.course), walk.world, fine)
    hull = hull_points(posture).reshape(len(fine), 6, 8, 3)
    straight = np.abs(np.gradient(walk.course.heading_at(fine), 0.005)) < 0.05
    slides = []
    for side, leg in ((0, 4), (1, 5)):
        heel, toe = hull[:, leg][:, [0, 4]].mean(axis=1), hull[:, leg][:, [1, 5]].mean(axis=1)
        on_heel = heel[:, 2] < toe[:, 2]
        bears = np.where(on_heel[:, None], heel, toe)
        same = posture.contact[1:, side] & posture.contact[:-1, side] & (on_heel[1:] == on_heel[:-1]) & straight[1:]
        step = np.where(same, np.linalg.norm(np.diff(bears[:, :2], axis=0), axis=1), 0.0)
        for part in np.split(step, np.flatnonzero(~posture.contact[1:, side])):
            if (part > 0).sum() > 10:
                slides.append(part.sum())
    assert len(slides) > 60
    assert np.median(slides) < 0.01


def test_speeds_keep_to_the_game(walk):
    velocity = np.diff(walk.course.feet_at(np.arange(0, SECONDS, 0.01)), axis=0) / 0.01
    level = np.linalg.norm(velocity[:, :2], axis=1)
    kinds = np.array(KINDS)[walk.course.kind_at(np.arange(0, SECONDS, 0.01)[:-1])]

    after = np.array(KINDS)[walk.course.kind_at(np.arange(0, SECONDS, 0.01)[1:])]
    assert level[(kinds == "walk") & (after == "walk")].max() < 4.31
    assert level.max() < SPRINT_SPEED + 0.05
    assert np.percentile(level[kinds == "sprint"], 90) > 5.0
    assert {"walk", "sprint", "jump", "fall", "stand", "turn", "climb_up"} <= set(kinds)
    turn = np.abs(np.diff(walk.course.heading_at(walk.times))) / 0.02
    assert turn.max() < 16.0


def test_the_course_has_no_jumps_in_space(walk):
    fine = walk.course.feet_at(np.arange(0, SECONDS, 0.002))
    assert np.linalg.norm(np.diff(fine, axis=0), axis=1).max() < 16.0 * 0.002


def test_joints_follow_from_the_stored_rotations_and_translations(walk):
    posture = walk.posture
    for frame in (0, 100, 2345, len(walk.times) - 1):
        world = [np.eye(4) for _ in range(13)]
        for joint, parent in enumerate(blocks13().parents):
            own = np.eye(4)
            own[:3, :3], own[:3, 3] = posture.rotations[frame, joint], posture.translations[frame, joint]
            world[joint] = own if parent < 0 else world[parent] @ own
            np.testing.assert_allclose(world[joint][:3, 3], posture.joints[frame, joint], atol=1e-9)
            np.testing.assert_allclose(own[:3, :3] @ own[:3, :3].T, np.eye(3), atol=1e-12)


def test_six_joints_turn_and_the_six_at_the_ends_never_do(walk):
    names = blocks13().joint_names
    assert names[0] == "root"
    assert len(names) == 13
    ends = [n for n in names if n.endswith("_end")]
    assert len(ends) == 6
    for joint, name in enumerate(names):
        off = np.abs(walk.posture.rotations[:, joint] - np.eye(3)).max()
        assert (off == 0) == (name in ends), name
        if joint:
            np.testing.assert_array_equal(
                walk.posture.translations[:, joint], np.tile(blocks13().rest_translations[joint], (len(walk.times), 1))
            )
    for end in ends:
        parent = names[blocks13().parents[names.index(end)]]
        assert parent == end.removesuffix("_end")
        assert blocks13().parents[names.index(parent)] == 0


def test_the_root_looks_where_the_course_says(walk):
    np.testing.assert_allclose(walk.posture.rotations[:, 0], facing(walk.course.heading_at(walk.times)), atol=1e-12)


@given(
    rise=st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0]),
    far=st.sampled_from([2.0, 3.0]),
    share=st.floats(0, 1),
)
def test_jumps_follow_newton(rise, far, share):
    arc = jump(np.array([0.5, 0.5, 0.0]), np.array([0.5, 0.5 + far, rise]))
    # Small steps of the equation of motion, as slow and plain as can be.
    time = share * arc.duration
    steps = 4000
    height, speed = 0.0, float(np.sqrt(2 * GRAVITY * JUMP_M))
    for _ in range(steps):
        height += speed * time / steps - 0.5 * GRAVITY * (time / steps) ** 2
        speed -= GRAVITY * time / steps
    assert arc.at(np.array([time]))[0, 2] == pytest.approx(height, abs=1e-9)
    assert arc.at(np.array([arc.duration]))[0, 2] == pytest.approx(rise, abs=1e-9)
    energy = 0.5 * speed**2 + GRAVITY * height
    assert energy == pytest.approx(GRAVITY * JUMP_M, abs=1e-9)


def test_a_hop_is_as_high_and_long_as_the_game_has_it():
    arc = hop(np.zeros(3))
    times = np.linspace(0, arc.duration, 10001)
    assert arc.at(times)[:, 2].max() == pytest.approx(1.25, abs=1e-6)
    assert arc.duration == pytest.approx(2 * np.sqrt(2 * 1.25 / 28.0))


@given(depth=st.floats(0.5, 6.0))
def test_drops_take_the_time_of_free_fall(depth):
    arc = drop(np.array([0.0, 0.0, depth]), np.array([1.0, 0.0, 0.0]))
    assert arc.duration == pytest.approx(np.sqrt(2 * depth / 28.0))
    assert np.all(np.diff(arc.at(np.linspace(0, arc.duration, 50))[:, 2]) < 0)


def test_nobody_jumps_higher_than_the_jump():
    with pytest.raises(ValueError, match=r"rise: expected at most 1.250 m, got 1.3"):
        airborne_s(float(np.sqrt(2 * GRAVITY * JUMP_M)), 1.3)


@given(reach=st.floats(-0.5, 0.5))
def test_legs_put_the_bearing_edge_of_the_sole_where_it_is_wanted(reach):
    angle = float(angle_of(np.array(reach)))
    edge = -SOLE_HALF_M if angle > 0 else SOLE_HALF_M
    # Sole edge of a leg swung forward by the angle, the hip at the origin: y up, z forward.
    z = LEG_M * np.sin(angle) + edge * np.cos(angle)
    y = -LEG_M * np.cos(angle) + edge * np.sin(angle)
    assert z - edge == pytest.approx(reach, abs=1e-9)
    assert -y == pytest.approx(float(hip_height(np.array(angle))), abs=1e-9)
    if abs(angle) < 1.2:
        assert float(half_stride(np.array(abs(angle)))) == pytest.approx(abs(reach), abs=1e-9)


@given(length=st.floats(0.1, 20.0), first=st.floats(0, 5.6), last=st.floats(0, 5.6), most=st.floats(1.0, 5.6))
def test_runs_keep_their_limits_and_accelerations(length, first, last, most):
    points = np.column_stack([np.linspace(0, length, 400), np.zeros(400)])
    times = travel_times(points, np.full(400, most), first, last)
    assert times[0] == 0
    assert (np.diff(times) > 0).all()
    speed = np.diff(points[:, 0]) / np.diff(times)
    assert speed.max() < most + 1e-6
    assert times[-1] > length / most - 1e-9


def test_the_figure_is_as_tall_as_the_scene_says():
    rest = np.zeros((13, 3))
    for joint, parent in enumerate(blocks13().parents):
        rest[joint] = blocks13().rest_translations[joint] + (rest[parent] if parent >= 0 else 0)
    assert np.ptp(rest[:, 1]) == pytest.approx(load_scene("blocks").person_height_m)
    assert PART_BOXES_M.shape == (6, 2, 3)
