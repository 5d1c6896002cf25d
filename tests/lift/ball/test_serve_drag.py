from dataclasses import replace

import numpy as np
import pytest

from pgm_data.lift.ball.drag_line import drag_of, travelled
from pgm_data.lift.ball.serve_drag import Serves, drag_from_serves
from pgm_data.scene import Prior

PRIOR = Prior(mean=0.0203, std=0.002)


def measured(rng: np.random.Generator, drag: float, count: int, share: float = 1.0) -> Serves:
    speed, time = rng.uniform(40, 58, count), rng.uniform(0.4, 0.5, count)
    one = np.ones(count)
    return Serves(
        length_m=travelled(time, share * speed, drag) + 0.1 * rng.normal(size=count),
        length_std_m=0.1 * one,
        time_s=time + 0.008 * rng.normal(size=count),
        time_std_s=0.008 * one,
        speed=speed * (1 + 0.01 * rng.normal(size=count)),
        speed_std=0.01 * speed,
        share=share * one,
        share_std=0.002 * one,
    )


def test_many_serves_give_the_drag_that_they_flew_with_and_stated_errors_are_true():
    rng = np.random.default_rng(1)
    off = []
    for _ in range(150):
        drag = PRIOR.mean + PRIOR.std * rng.normal()
        found = drag_from_serves(measured(rng, drag, 20), PRIOR)
        assert found.count == 20 and found.posterior.std < 0.35 * PRIOR.std
        off.append((found.posterior.mean - drag) / found.posterior.std)
    assert abs(np.mean(off)) < 0.35
    assert 0.55 < np.mean(np.abs(off) < 1) < 0.8


def test_no_serve_leaves_the_prior():
    none = Serves(**{name: np.zeros(0) for name in Serves.__dataclass_fields__})
    found = drag_from_serves(none, PRIOR)
    assert (found.posterior.mean, found.posterior.std, found.count) == (PRIOR.mean, PRIOR.std, 0)


def test_one_serve_hardly_moves_the_prior_and_never_widens_it():
    serve = measured(np.random.default_rng(2), 0.03, 1)
    found = drag_from_serves(serve, PRIOR)
    assert PRIOR.mean < found.posterior.mean < 0.023
    assert 0.8 * PRIOR.std < found.posterior.std <= PRIOR.std


def test_the_speed_along_the_ground_counts():
    serves = measured(np.random.default_rng(3), 0.0203, 40, share=0.98)
    right = drag_from_serves(serves, PRIOR)
    wrong = drag_from_serves(replace(serves, share=np.ones(40)), PRIOR)
    assert right.posterior.mean == pytest.approx(0.0203, abs=2.5 * right.posterior.std)
    assert wrong.posterior.mean > right.posterior.mean + 2 * right.posterior.std


def test_a_gross_error_among_serves_pulls_no_harder_than_its_like():
    serves = measured(np.random.default_rng(4), 0.0203, 20)
    length = serves.length_m.copy()
    length[0] -= 2.5
    good, bad = drag_from_serves(serves, PRIOR), drag_from_serves(replace(serves, length_m=length), PRIOR)
    assert abs(bad.posterior.mean - good.posterior.mean) < 1.5 * good.posterior.std


def test_those_left_out_say_why_and_change_nothing():
    rng = np.random.default_rng(5)
    serves = measured(rng, 0.0203, 8)
    length, time, speed, share = (getattr(serves, n).copy() for n in ("length_m", "time_s", "speed", "share"))
    length[0] = 1.4 * speed[0] * time[0]
    length[1], time[2], speed[3], share[4], length[5] = np.nan, 0.0, 8.0, -0.2, 1.0
    found = drag_from_serves(replace(serves, length_m=length, time_s=time, speed=speed, share=share), PRIOR)
    assert found.used.tolist() == [False] * 6 + [True] * 2
    for said, word in zip(
        found.said, ("not slowed", "missing", "no serve", "too slow", "no serve", "more than"), strict=False
    ):
        assert word in said
    assert found.said[6] == ""
    rest = Serves(**{n: getattr(serves, n)[6:] for n in Serves.__dataclass_fields__})
    assert found.posterior.mean == pytest.approx(drag_from_serves(rest, PRIOR).posterior.mean)


def test_serves_a_little_too_long_for_any_drag_still_count_so_that_the_mean_is_not_biased():
    """Without them, only those that err towards much drag would be left."""
    rng = np.random.default_rng(6)
    serves = replace(measured(rng, 0.004, 400), time_std_s=np.full(400, 0.02))
    serves = replace(serves, time_s=serves.time_s + 0.018 * rng.normal(size=400))
    found = drag_from_serves(serves, Prior(mean=0.006, std=0.004))
    assert (found.drag_per_m == 0).sum() > 60 and found.used[found.drag_per_m == 0].mean() > 0.9
    assert found.posterior.mean == pytest.approx(0.004, abs=3 * found.posterior.std)


def test_each_serve_alone_is_the_equation_inverted_with_its_error():
    serves = measured(np.random.default_rng(7), 0.0203, 5)
    found = drag_from_serves(serves, PRIOR)
    np.testing.assert_allclose(found.drag_per_m, drag_of(serves.length_m, serves.speed, serves.time_s))
    assert ((found.drag_std_per_m > 0.05 * 0.0203) & (found.drag_std_per_m < 0.5 * 0.0203)).all()


def test_wrong_deviations_and_priors_are_refused():
    serves = measured(np.random.default_rng(8), 0.0203, 3)
    with pytest.raises(ValueError, match="serves: speed_std"):
        replace(serves, speed_std=-np.ones(3))
    with pytest.raises(ValueError, match="prior"):
        drag_from_serves(serves, Prior(mean=0.0203, std=0.0))
