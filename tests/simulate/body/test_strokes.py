"""Postures and their timing."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.simulate import rotations
from pgm_data.simulate.body import arms, postures
from pgm_data.simulate.body.figure import draw_figure, smpl24
from pgm_data.simulate.body.reach import MIDDLE_HEIGHT_M
from pgm_data.simulate.body.strokes import is_overhead, swing_of
from pgm_data.simulate.tennis.play import Stroke

KINDS = ["drive", "slice", "volley", "half_volley", "lob", "drop"]


def stroke(kind="drive", side="forehand", hands=1, height=1.0, stretch=0.0):
    serve = kind == "serve"
    return Stroke(
        player=0,
        time=3.0,
        kind=kind,
        side=side,
        hands=hands,
        ball=np.array([0.7, -10.6, height]),
        swing=np.array([0.0, 1.0, 0.0]),
        hit=True,
        stretch=stretch,
        toss_time=2.2 if serve else np.nan,
        toss=np.array([0.0, -10.6, 1.8]) if serve else np.full(3, np.nan),
    )


def swing(of, since=9.0, until=9.0, seed=0):
    return swing_of(draw_figure(np.random.default_rng(seed), "right"), of, np.array([0.0, -11.0]), since, until)


@pytest.mark.parametrize("name", list(postures.POSTURES))
def test_a_posture_puts_hand_and_racket_where_it_says(name):
    posture, channels = postures.POSTURES[name], postures.angles(name)
    bones = postures.side_bones(np.array(smpl24().rest_translations) * (MIDDLE_HEIGHT_M / 1.8), "right")
    R, p = arms.hands(channels[None, postures.RACKET], bones)
    net_from_root = rotations.about(1, np.deg2rad(posture.turn)) * np.array([-1.0, 1.0, 1.0])[:, None]
    assert np.linalg.norm(net_from_root @ p[0] - posture.hand) < 0.03
    shaft = np.array(posture.shaft) / np.linalg.norm(posture.shaft)
    assert (net_from_root @ R[0] @ arms.SHAFT) @ shaft > np.cos(np.deg2rad(30.0))
    if isinstance(posture.other, float):
        other = arms.hands(channels[None, postures.OTHER], bones)[1][0] * [-1.0, 1.0, 1.0]
        assert np.linalg.norm(other - p[0] - posture.other * R[0] @ arms.SHAFT) < 0.02
    for part in (postures.RACKET, postures.OTHER):
        low, high = arms.inner_limits()
        assert (channels[part] >= low - 1e-9).all() and (channels[part] <= high + 1e-9).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("side", "hands"), [("forehand", 1), ("backhand", 1), ("backhand", 2)])
def test_every_stroke_has_a_backswing_a_contact_and_an_end(kind, side, hands):
    s = swing(stroke(kind, side, hands))
    assert (np.diff(s.times) > 0).all()
    assert 2 <= s.hit <= len(s.times) - 3
    assert s.times[s.hit] == 3.0
    assert s.palm_side == (side == "forehand")
    assert -1.0 < s.times[0] - 3.0 < -0.4
    assert 0.4 < s.times[-1] - 3.0 < 1.0
    assert s.shares[s.hit] == 1.0 and s.shares[0] == s.shares[-1] == 0.0


def test_a_hurried_stroke_keeps_its_order_and_its_contact():
    s = swing(stroke(), since=0.3, until=0.2)
    assert (np.diff(s.times) > 0).all()
    assert s.times[0] == pytest.approx(2.7) and s.times[-1] == pytest.approx(3.2) and s.times[s.hit] == 3.0


def test_knees_bend_for_low_balls_and_a_server_jumps():
    easy, low = swing(stroke()), swing(stroke(height=0.25))
    assert low.values[low.hit, postures.HIPS][1] > easy.values[easy.hit, postures.HIPS][1] + 0.15
    serve = swing(stroke("serve", "overhead", height=2.9))
    assert is_overhead(serve.stroke) and serve.hop > 0.2 and easy.hop == 0.0
    assert serve.times[serve.toss] == pytest.approx(2.2)


def test_strokes_vary_with_their_contents_alone():
    first, again, later = swing(stroke()), swing(stroke()), swing(replace(stroke(), time=4.0))
    np.testing.assert_array_equal(first.values, again.values)
    assert not np.array_equal(first.values, later.values)
    assert first.speed != later.speed


def test_a_toss_after_the_contact_is_refused():
    with pytest.raises(ValueError, match="toss_time"):
        swing(replace(stroke("serve", "overhead"), toss_time=3.1))
