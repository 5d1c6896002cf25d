"""A body that follows strokes: the racket at the ball, human joints, the same at the same time however it is asked."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.simulate import rotations
from pgm_data.simulate.body import move, racket
from pgm_data.simulate.body.figure import Figure, draw_figure, smpl24, world_from_joints
from pgm_data.simulate.body.legs import LowerBody
from pgm_data.simulate.body.move import body_track, hand_position
from pgm_data.simulate.body.reach import pelvis_at_contact
from pgm_data.simulate.tennis.play import Plan, Stroke

NAMES = smpl24().joint_names
INDEX = {name: i for i, name in enumerate(NAMES)}
ARMS = [i for i, name in enumerate(NAMES) if name[2:] in ("Thorax", "Shoulder", "Elbow", "Wrist", "Hand")]
CORE = [INDEX[name] for name in ("Torso", "Spine", "Chest", "Neck", "Head")]
SHOTS = [
    *(("drive", "forehand", 1), ("drive", "backhand", 2), ("drive", "backhand", 1), ("slice", "forehand", 1)),
    *(("slice", "backhand", 1), ("volley", "forehand", 1), ("volley", "backhand", 1), ("half_volley", "forehand", 1)),
    *(("half_volley", "backhand", 1), ("lob", "forehand", 1), ("lob", "backhand", 2), ("lob", "backhand", 1)),
    *(("drop", "forehand", 1), ("drop", "backhand", 1), ("smash", "overhead", 1), ("serve", "overhead", 1)),
]
ELEVATION = {"drive": 0.2, "slice": -0.3, "volley": -0.2, "half_volley": 0.2, "lob": 0.8, "drop": -0.3, "smash": -0.25}
SPEEDS = {"serve": (27, 50), "drive": (15, 35), "volley": (5, 12), "smash": (22, 45)}
TIME = 2.5


def other_hand(figure):
    return INDEX["L_Hand" if figure.hand == "right" else "R_Hand"]


def racket_hand(figure):
    return INDEX["R_Hand" if figure.hand == "right" else "L_Hand"]


def shot(rng, figure: Figure, player: int, shot_kind, time=TIME, near=None):
    """A stroke inside of what `reach` promises, and where the pelvis is for it."""
    kind, side, hands = shot_kind
    tall = figure.height_m
    if side == "overhead":
        low, high, most = (1.45, 1.55, 0.0) if kind == "serve" else (1.34, 1.54, 0.5)
        z = tall * rng.uniform(low, high)
    else:
        z, most = rng.uniform(0.15, 0.6 if kind == "half_volley" else 1.03 * tall), 1.0 if hands == 1 else 0.45
    stretch = rng.uniform(0.0, most)
    net = 1.0 if player == 0 else -1.0
    place = np.array([rng.uniform(-4, 4), -net * rng.uniform(6, 13)]) if near is None else near
    pelvis = pelvis_at_contact(figure, player, place, side, hands, stretch)
    pelvis = pelvis + rng.uniform(-0.1, 0.1, 2) * (0.3 if kind == "serve" else 1.0)
    azimuth, elevation = rng.uniform(-0.35, 0.35), ELEVATION.get(kind, -0.12) + rng.uniform(-0.15, 0.15)
    flat = np.cos(elevation)
    toss = np.full(3, np.nan)
    if kind == "serve":
        right = 1.0 if figure.hand == "right" else -1.0
        toss = np.array([*(pelvis + net * np.array([-0.1 * right, 0.42]) * tall / 1.84), 0.97 * tall])
    stroke = Stroke(
        player=player,
        time=time,
        kind=kind,
        side=side,
        hands=hands,
        ball=np.array([*place, z]),
        swing=np.array([flat * np.sin(azimuth), net * flat * np.cos(azimuth), np.sin(elevation)]),
        hit=True,
        stretch=stretch,
        toss_time=time - 0.82 if kind == "serve" else np.nan,
        toss=toss,
    )
    return stroke, pelvis


def plan_through(stroke: Stroke, pelvis, heading=0.0, velocity=(0.0, 0.0), lasts=5.0):
    times = np.arange(int(lasts * 50) + 1) / 50
    base = 0.0 if stroke.player == 0 else np.pi
    return Plan(
        times=times,
        path=pelvis + np.outer(times - stroke.time, np.array(velocity)),
        heading=np.full(len(times), base + heading),
        splits=np.zeros(0),
    )


def drawn(seed, shot_kind=None, hand=None):
    rng = np.random.default_rng(seed)
    figure = draw_figure(rng, hand or ("right", "left")[int(rng.integers(2))])
    kind = shot_kind or SHOTS[int(rng.integers(len(SHOTS)))]
    stroke, pelvis = shot(rng, figure, int(rng.integers(2)), kind)
    runs = kind[0] != "serve"
    plan = plan_through(stroke, pelvis, rng.uniform(-0.6, 0.6) * runs, rng.uniform(-3, 3, 2) * runs)
    return figure, stroke, plan


def at_ball(stroke):
    return lambda times: np.repeat(stroke.ball[None], len(times), axis=0)


def passing(stroke):
    """A ball that comes from the net, is hit and goes back."""

    def watched(times):
        net = 1.0 if stroke.player == 0 else -1.0
        away = np.abs(times - stroke.time)[:, None] * np.array([0.2 * net, net, 0.1])
        return stroke.ball + np.where(times[:, None] < stroke.time, 16.0, 28.0) * away

    return watched


def nothing(times):
    return np.full((len(times), 3), np.nan)


def ball_met(figure, stroke, track):
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = racket_hand(figure)
    return racket.ball_at_contact(R[:, hand], t[:, hand], figure.hand, palm_side=stroke.side != "backhand")


def joint_rates(track, times):
    R = track.rotations
    turned = rotations.to_axis_angle(np.swapaxes(R[:-1], -1, -2) @ R[1:])
    return np.linalg.norm(turned, axis=-1) / np.diff(times)[:, None]


@settings(max_examples=45, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(SHOTS))
def test_racket_meets_the_ball_along_the_swing(seed, shot_kind):
    figure, stroke, plan = drawn(seed, shot_kind)
    times = stroke.time + np.array([-1e-3, 0.0, 1e-3])
    track = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    assert np.linalg.norm(ball_met(figure, stroke, track)[1] - stroke.ball) < 0.03
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = racket_hand(figure)
    middle, normal = racket.sweet_spot(R[:, hand], t[:, hand], figure.hand)
    velocity = (middle[2] - middle[0]) / 2e-3
    speed = np.linalg.norm(velocity)
    assert velocity @ stroke.swing > np.cos(np.deg2rad(35.0)) * speed
    low, high = SPEEDS.get(stroke.kind, (4, 25))
    assert low < speed < high
    face = normal[1] * (1.0 if stroke.side != "backhand" else -1.0)
    assert face @ stroke.swing > np.cos(np.deg2rad(45.0))


@pytest.mark.parametrize("shot_kind", SHOTS)
def test_contact_is_exact_for_a_ball_at_ease(shot_kind):
    rng = np.random.default_rng(7)
    figure = draw_figure(rng, "right")
    stroke, _ = shot(rng, figure, 0, shot_kind)
    height = stroke.ball[2] if stroke.side == "overhead" else 0.55 * figure.height_m
    stroke = replace(stroke, stretch=0.0, ball=np.array([*stroke.ball[:2], height]))
    pelvis = pelvis_at_contact(figure, 0, stroke.ball[:2], stroke.side, stroke.hands)
    track = body_track(figure, plan_through(stroke, pelvis), (stroke,), at_ball(stroke), np.array([stroke.time]))
    assert np.linalg.norm(ball_met(figure, stroke, track)[0] - stroke.ball) < 1e-3


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_joints_stay_human_and_no_faster_than_an_athletes(seed):
    figure, stroke, plan = drawn(seed)
    times = np.arange(stroke.time - 1.6, stroke.time + 1.3, 0.004)
    track = body_track(figure, plan, (stroke,), passing(stroke), times)
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    rates = joint_rates(track, times)
    assert rates[:, ARMS].max() < 60.0
    assert rates[:, CORE].max() < 20.0
    for side in ("L_", "R_"):
        upper = t[:, INDEX[side + "Elbow"]] - t[:, INDEX[side + "Shoulder"]]
        lower = t[:, INDEX[side + "Wrist"]] - t[:, INDEX[side + "Elbow"]]
        cosine = (upper * lower).sum(1) / np.linalg.norm(upper, axis=1) / np.linalg.norm(lower, axis=1)
        assert cosine.min() > np.cos(np.deg2rad(150.0)) - 1e-9
        # The forearm bends to one side only: about the upper arm's own axis, in its own sense.
        forearm = np.einsum("nji,nj->ni", R[:, INDEX[side + "Shoulder"]], lower)
        assert forearm[:, 2].min() > 0.0
        assert np.abs(forearm[:, 1]).max() < 1e-9
        wrist = np.einsum(
            "nji,nj->ni", R[:, INDEX[side + "Elbow"]], t[:, INDEX[side + "Hand"]] - t[:, INDEX[side + "Wrist"]]
        )
        bent = np.abs(wrist[:, 0]) / np.linalg.norm(wrist, axis=1)
        assert bent.min() > np.cos(np.deg2rad(80.0))
    trunk = rotations.to_axis_angle(np.swapaxes(R[:, 0], -1, -2) @ R[:, INDEX["Chest"]])
    assert np.abs(trunk[:, 1]).max() < np.deg2rad(60.0)
    face = np.einsum("nji,nj->ni", R[:, INDEX["Chest"]], R[:, INDEX["Head"], :, 2])
    assert np.abs(np.arctan2(face[:, 0], face[:, 2])).max() < np.deg2rad(80.0)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_racket_and_hands_keep_clear_of_trunk_and_head(seed):
    figure, stroke, plan = drawn(seed)
    times = np.arange(stroke.time - 1.2, stroke.time + 1.2, 0.005)
    track = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = racket_hand(figure)
    shaft = R[:, hand] @ racket.shaft_axis(figure.hand)
    along = np.linspace(racket.BUTT_M, racket.TIP_M, 20)
    points = t[:, hand, None] + along[None, :, None] * shaft[:, None]
    head = t[:, INDEX["Head"]] + R[:, INDEX["Head"]] @ np.array([0.0, 0.05, 0.01])
    assert np.linalg.norm(points - head[:, None], axis=-1).min() > 0.11
    base, axis = t[:, 0], t[:, INDEX["Neck"]] - t[:, 0]
    for p in (t[:, hand], t[:, other_hand(figure)], *np.moveaxis(points, 1, 0)):
        share = np.clip(((p - base) * axis).sum(1) / (axis * axis).sum(1), 0.0, 1.0)
        assert np.linalg.norm(p - base - share[:, None] * axis, axis=1).min() > 0.12


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_the_body_at_a_time_does_not_depend_on_the_other_times(seed):
    figure, stroke, plan = drawn(seed)
    rng = np.random.default_rng(seed)
    times = rng.uniform(0.0, 5.0, 60)
    track = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    some = rng.permutation(60)[:7]
    again = body_track(figure, plan, (stroke,), at_ball(stroke), times[some])
    np.testing.assert_allclose(again.rotations, track.rotations[some], atol=1e-9)
    np.testing.assert_allclose(again.root_position, track.root_position[some], atol=1e-9)
    one = body_track(figure, plan, (stroke,), at_ball(stroke), times[:1])
    np.testing.assert_allclose(one.rotations, track.rotations[:1], atol=1e-9)


def gliding(figure, plan, demand_of, times):
    """A pelvis over legs that do nothing, the same for both sides: real feet begin with one of them."""
    demand = demand_of(times)
    heading = np.interp(times, plan.times, plan.heading) + demand.turn
    place = [np.interp(times, plan.times, plan.path[:, k]) for k in (0, 1)]
    lean = rotations.about(0, demand.lean_forward) @ rotations.about(2, -demand.lean_left)
    return LowerBody(
        root_position=np.stack([*place, figure.translations[0, 1] - 0.04 - demand.drop + demand.hop], axis=-1),
        root_rotation=rotations.facing(heading) @ lean,
        leg_rotations=np.broadcast_to(np.eye(3), (len(times), 24, 3, 3)).copy(),
        contact=np.zeros((len(times), 2), bool),
        stride_phase=np.full(len(times), 0.5 * np.pi),
        speed=np.full(len(times), 1.0),
    )


@pytest.mark.parametrize("shot_kind", SHOTS)
def test_left_handers_are_the_mirror_image_of_right_handers(shot_kind, monkeypatch):
    monkeypatch.setattr(move, "lower_body", gliding)
    figure, stroke, plan = drawn(11, shot_kind, "right")
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = replace(stroke, ball=stroke.ball * flip, swing=stroke.swing * flip, toss=stroke.toss * flip)
    mirrored_plan = replace(plan, path=plan.path * flip[:2], heading=-plan.heading)
    times = np.arange(stroke.time - 1.2, stroke.time + 1.2, 0.05)
    right = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    left = body_track(replace(figure, hand="left"), mirrored_plan, (mirrored,), at_ball(mirrored), times)
    swap = [
        INDEX[{"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:]] if name[1] == "_" else INDEX[name]
        for name in NAMES
    ]
    upper = [0, *CORE, *ARMS]
    image = (left.rotations * np.outer(flip, flip))[:, swap]
    np.testing.assert_allclose(image[:, upper], right.rotations[:, upper], atol=1e-5)
    np.testing.assert_allclose(left.root_position * flip, right.root_position, atol=1e-5)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_a_server_lets_go_of_the_ball_where_the_toss_begins(seed):
    figure, stroke, plan = drawn(seed, ("serve", "overhead", 1))
    times = stroke.toss_time + np.array([-1e-3, 0.0, 1e-3, -0.85])
    track = body_track(figure, plan, (stroke,), nothing, times)
    held = hand_position(track, figure)
    assert np.linalg.norm(held[1] - stroke.toss) < 0.03
    assert (held[2] - held[0])[2] / 2e-3 > 1.0
    # Before, both hands are together in front.
    _, t = world_from_joints(figure, track.root_position, track.rotations)
    assert np.linalg.norm(t[3, racket_hand(figure)] - t[3, other_hand(figure)]) < 0.25


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_a_server_jumps_no_higher_than_people_do_with_toes_that_point_down(seed):
    figure, stroke, plan = drawn(seed, ("serve", "overhead", 1))
    times = np.array([stroke.time])
    track = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    for side in ("L_", "R_"):
        assert 0.05 < t[0, INDEX[side + "Toe"], 2] < 0.45
        assert R[0, INDEX[side + "Ankle"], 2, 2] < -0.2
    shoulders = [t[0, INDEX[side + "Shoulder"], 2] for side in ("L_", "R_")]
    assert (shoulders[1] - shoulders[0]) * (1.0 if figure.hand == "right" else -1.0) > 0.15


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10**6))
def test_both_hands_hold_the_grip_of_a_two_handed_drive(seed):
    figure, stroke, plan = drawn(seed, ("drive", "backhand", 2))
    times = np.arange(stroke.time - 0.3, stroke.time + 0.05, 0.01)
    track = body_track(figure, plan, (stroke,), at_ball(stroke), times)
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = racket_hand(figure)
    shaft = R[:, hand] @ racket.shaft_axis(figure.hand)
    apart = t[:, other_hand(figure)] - t[:, hand]
    along = (apart * shaft).sum(1)
    miss = np.linalg.norm(apart - along[:, None] * shaft, axis=1)
    # High, low and stretched balls pull the second hand off the grip for a moment; at contact it is there.
    assert np.median(miss) < 0.05
    assert miss.max() < 0.1
    assert miss[30] < 0.02
    assert np.abs(along - 0.1).max() < 0.1


def rally(hand="right", gap=1.6):
    rng = np.random.default_rng(3)
    figure = draw_figure(rng, hand)
    kinds = [("drive", "forehand", 1), ("drive", "backhand", 2), ("volley", "forehand", 1), ("smash", "overhead", 1)]
    near = np.array([0.0, -9.0])
    strokes = [shot(rng, figure, 0, kind, 1.5 + gap * i, near) for i, kind in enumerate(kinds)]
    times = np.arange(int(50 * (3.0 + gap * 4)) + 1) / 50
    knots = np.array([s.time for s, _ in strokes])
    # From one stance to the next, smoothly.
    share = np.clip((times[:, None] - knots[:-1]) / gap, 0.0, 1.0)
    path = strokes[0][1] + (share**2 * (3 - 2 * share)) @ np.diff([p for _, p in strokes], axis=0)
    plan = Plan(times=times, path=path, heading=np.zeros(len(times)), splits=knots - 0.7)
    return figure, tuple(s for s, _ in strokes), plan


@pytest.mark.parametrize("gap", [0.7, 1.6, 3.0])
def test_strokes_follow_each_other_without_jumps(gap):
    figure, strokes, plan = rally(gap=gap)
    step = 0.002
    times = np.arange(0.2, plan.times[-1] - 0.2, step)
    track = body_track(figure, plan, strokes, at_ball(strokes[0]), times)
    R = track.rotations[:, ARMS + CORE]
    rates = rotations.to_axis_angle(np.swapaxes(R[:-1], -1, -2) @ R[1:]) / step
    assert np.linalg.norm(rates, axis=-1).max() < (75.0 if gap > 1.0 else 110.0)
    # A jump of the rate itself would be as large at any step; a smooth one shrinks with it.
    assert np.linalg.norm(np.diff(rates, axis=0), axis=-1).max() < 20.0
    for stroke in strokes:
        then = body_track(figure, plan, strokes, nothing, np.array([stroke.time]))
        assert np.linalg.norm(ball_met(figure, stroke, then)[0] - stroke.ball) < 0.03


def test_a_player_without_strokes_walks_with_arms_that_hang_and_swing():
    figure = draw_figure(np.random.default_rng(1), "right")
    times = np.arange(201) / 50
    plan = Plan(
        times=times,
        path=np.stack([0.0 * times, 1.4 * times - 12], axis=1),
        heading=np.zeros(201),
        splits=np.zeros(0),
    )
    track = body_track(figure, plan, (), nothing, np.arange(0.5, 3.5, 0.02))
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    for side in ("L_", "R_"):
        hand = np.einsum("nji,nj->ni", R[:, 0], t[:, INDEX[side + "Hand"]] - t[:, 0])
        assert hand[:, 1].max() < 0.15
        assert np.ptp(hand[:, 2]) > 0.15
    feet = t[:, INDEX["L_Ankle"], 1] - t[:, INDEX["R_Ankle"], 1]
    arms = t[:, INDEX["L_Hand"], 1] - t[:, INDEX["R_Hand"], 1]
    assert np.corrcoef(feet, arms)[0, 1] < -0.3


def test_a_waiting_player_holds_the_racket_ready_with_both_hands():
    figure, strokes, plan = rally(gap=3.0)
    track = body_track(figure, plan, strokes, nothing, np.array([strokes[1].time - 1.2]))
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    hand = racket_hand(figure)
    throat = t[0, hand] + 0.25 * R[0, hand] @ racket.shaft_axis(figure.hand)
    assert np.linalg.norm(t[0, other_hand(figure)] - throat) < 0.03
    ahead = R[0, 0].T @ (t[0, hand] - t[0, 0])
    assert ahead[2] > 0.2


@settings(max_examples=20, deadline=None)
@given(st.floats(-1.2, 1.2), st.floats(3.0, 20.0), st.floats(0.0, 4.0))
def test_eyes_follow_a_ball_that_the_neck_can_reach(azimuth, far, height):
    figure = draw_figure(np.random.default_rng(2), "left")
    times = np.arange(101) / 50
    plan = Plan(times=times, path=np.zeros((101, 2)), heading=np.zeros(101), splits=np.zeros(0))
    ball = np.array([-far * np.sin(azimuth), far * np.cos(azimuth), height])
    track = body_track(figure, plan, (), lambda t: np.repeat(ball[None], len(t), axis=0), np.array([1.0]))
    R, t = world_from_joints(figure, track.root_position, track.rotations)
    wanted = ball - t[0, INDEX["Head"]]
    assert R[0, INDEX["Head"], :, 2] @ wanted > np.cos(np.deg2rad(18.0)) * np.linalg.norm(wanted)


def test_strokes_out_of_order_are_refused():
    figure, strokes, plan = rally()
    with pytest.raises(ValueError, match="rising times"):
        body_track(figure, plan, strokes[::-1], nothing, np.array([1.0]))
