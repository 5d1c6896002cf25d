import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.linalg import sqrtm
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from pgm_models.metrics import (
    discrepancy,
    energy_score,
    frechet_distance,
    frechet_of_gaussians,
    frechet_score,
    geodesic_angle,
    median_distance,
    principal_axes,
)


def covariance(rng: np.random.Generator, size: int) -> np.ndarray:
    A = rng.standard_normal((size, size + 3))
    return A @ A.T


@given(seed=st.integers(0, 10_000), size=st.integers(1, 12))
@settings(max_examples=30)
def test_frechet_of_gaussians_is_the_textbook_formula(seed, size):
    rng = np.random.default_rng(seed)
    A, B, shift = covariance(rng, size), covariance(rng, size), rng.standard_normal(size)
    textbook = shift @ shift + np.trace(A + B - 2 * np.real(sqrtm(A @ B)))
    assert frechet_of_gaussians(shift, A, np.zeros(size), B) == pytest.approx(textbook, abs=1e-6)


def test_frechet_of_one_dimensional_gaussians_is_known_in_closed_form():
    found = frechet_of_gaussians(np.array([1.0]), np.array([[4.0]]), np.array([-2.0]), np.array([[0.25]]))
    assert found == pytest.approx(3.0**2 + (2.0 - 0.5) ** 2, abs=1e-9)


def test_frechet_of_samples_is_that_of_their_moments():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((200, 5)), 1 + 2 * rng.standard_normal((300, 5)) @ rng.standard_normal((5, 5))
    of_moments = frechet_of_gaussians(a.mean(0), np.cov(a.T), b.mean(0), np.cov(b.T))
    assert frechet_distance(a, b) == pytest.approx(of_moments, abs=1e-6)
    assert frechet_distance(a, b) == pytest.approx(frechet_distance(b, a), abs=1e-9)


@pytest.mark.parametrize("rows, size", [(2, 48), (30, 48), (400, 48)])
def test_identical_samples_are_no_distance_apart_even_where_rows_are_few(rows, size):
    a = 100 * np.random.default_rng(1).standard_normal((rows, size))
    assert frechet_distance(a, a) < 1e-9 * (a**2).sum()
    assert frechet_distance(a, a + 1.0) == pytest.approx(size, rel=1e-6)
    assert frechet_distance(a, -a) >= 0


def test_a_sample_without_spread_is_its_mean():
    a, b = np.zeros((5, 3)), np.random.default_rng(2).standard_normal((1000, 3))
    assert frechet_distance(a, b) == pytest.approx((b.mean(0) ** 2).sum() + np.cov(b.T).trace(), rel=1e-12)


def test_frechet_is_not_thrown_by_units():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((100, 4)), rng.standard_normal((100, 4)) + 1
    assert frechet_distance(1e-6 * a, 1e-6 * b) == pytest.approx(1e-12 * frechet_distance(a, b), rel=1e-6)


@pytest.mark.parametrize(
    "a, b, said",
    [
        (np.zeros((1, 3)), np.zeros((5, 3)), "at least two rows"),
        (np.full((5, 3), np.nan), np.zeros((5, 3)), "first sample: expected finite"),
        (np.zeros((5, 3)), np.full((5, 3), np.inf), "second sample: expected finite"),
    ],
)
def test_samples_that_cannot_be_compared_are_refused(a, b, said):
    with pytest.raises(ValueError, match=said):
        frechet_distance(a, b)
    with pytest.raises(ValueError, match=said):
        discrepancy(a, b, bandwidth=1.0, rng=np.random.default_rng(0))


def filled_in(rng: np.random.Generator, rows: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Real sequences, and the same with all but the first quarter drawn anew with that scale of the noise."""
    given, rest = rng.standard_normal((2, rows, 16))
    real = np.concatenate([given, 0.9 * given + 0.4 * rest, 0.5 * given + rest], axis=1)
    other = rng.standard_normal((rows, 16))
    made = np.concatenate([given, 0.9 * given + 0.4 * scale * other, 0.5 * given + scale * other], axis=1)
    return made, real


def test_the_excess_of_perfectly_filled_in_sequences_is_nothing_and_their_distance_far_below_the_floor():
    rng = np.random.default_rng(4)
    made, real = filled_in(rng, 2048, 1.0)
    floor = frechet_distance(filled_in(rng, 2048, 1.0)[1], real)
    score = frechet_score(made, real, rng)
    assert score.distance < 0.75 * floor
    assert abs(score.excess) < 0.1 * floor
    assert score.reliable and score.rows == 2048 and score.dimensions == 48


def test_the_excess_is_what_many_more_rows_say():
    rng = np.random.default_rng(5)
    score = frechet_score(*filled_in(rng, 1024, 0.7), rng)
    many = frechet_distance(*filled_in(rng, 20_000, 0.7))
    assert score.excess == pytest.approx(many, rel=0.1)
    assert score.distance > 1.1 * many


def test_the_excess_of_a_sample_from_itself_is_nothing_and_of_too_few_rows_unknown():
    rng = np.random.default_rng(6)
    a = rng.standard_normal((64, 4))
    same = frechet_score(a, a, rng)
    assert same.distance == pytest.approx(0, abs=1e-9) and same.excess == pytest.approx(0, abs=1e-9)
    few = frechet_score(a[:7], a[7:14], rng)
    assert np.isnan(few.excess) and not few.reliable and few.distance > 0
    with pytest.raises(ValueError, match="as many rows"):
        frechet_score(a, a[:10], rng)


def slow_mmd(a: np.ndarray, b: np.ndarray, bandwidth: float) -> float:
    def kernel(x: np.ndarray, y: np.ndarray) -> float:
        return float(np.exp(-((x - y) ** 2).sum() / (2 * bandwidth**2)))

    within = [
        sum(kernel(s[i], s[j]) for i in range(len(s)) for j in range(len(s)) if i != j) / (len(s) * (len(s) - 1))
        for s in (a, b)
    ]
    return sum(within) - 2 * sum(kernel(x, y) for x in a for y in b) / (len(a) * len(b))


def test_discrepancy_is_the_slow_sum_over_pairs():
    rng = np.random.default_rng(7)
    a, b = rng.standard_normal((23, 3)), rng.standard_normal((31, 3)) + 0.5
    found = discrepancy(a, b, bandwidth=1.3, rng=rng, bootstraps=50)
    assert found.value == pytest.approx(slow_mmd(a, b, 1.3), abs=1e-12)
    assert found.low < found.value < found.high and found.bandwidth == 1.3


def test_discrepancy_does_not_depend_on_the_block(monkeypatch):
    rng = np.random.default_rng(8)
    a, b = rng.standard_normal((50, 3)), rng.standard_normal((40, 3))
    whole = discrepancy(a, b, bandwidth=1.0, rng=np.random.default_rng(0), bootstraps=20)
    monkeypatch.setattr("pgm_models.metrics.BLOCK", 7)
    parts = discrepancy(a, b, bandwidth=1.0, rng=np.random.default_rng(0), bootstraps=20)
    assert (parts.value, parts.low, parts.high) == pytest.approx((whole.value, whole.low, whole.high), abs=1e-12)


def test_discrepancy_is_unbiased_and_its_interval_tells_samples_apart():
    rng = np.random.default_rng(9)
    alike = [
        discrepancy(*rng.standard_normal((2, 60, 3)), bandwidth=2.0, rng=rng, bootstraps=0).value for _ in range(200)
    ]
    assert abs(np.mean(alike)) < 4 * np.std(alike) / np.sqrt(200)
    same = discrepancy(*rng.standard_normal((2, 300, 3)), bandwidth=2.0, rng=rng, bootstraps=200)
    apart = discrepancy(
        rng.standard_normal((300, 3)), rng.standard_normal((300, 3)) + 0.5, bandwidth=2.0, rng=rng, bootstraps=200
    )
    assert same.low < 0 < same.high < apart.low


def test_the_usual_bandwidth_is_the_median_distance_of_pairs():
    rows = np.random.default_rng(10).standard_normal((40, 3))
    distances = cdist(rows, rows)[np.triu_indices(40, 1)]
    assert median_distance(rows) == pytest.approx(float(np.median(distances)), rel=1e-9)
    assert median_distance(np.ones((5, 2))) == 1.0
    assert median_distance(rng_rows := np.random.default_rng(11).standard_normal((1500, 2))) == pytest.approx(
        float(np.median(cdist(rng_rows, rng_rows))), rel=0.05
    )


def test_the_energy_score_of_one_number_is_the_crps():
    rng = np.random.default_rng(12)
    x = rng.standard_normal((4000, 1))
    for y in (0.0, 1.5):
        crps = y * (2 * norm.cdf(y) - 1) + 2 * norm.pdf(y) - 1 / np.sqrt(np.pi)
        assert energy_score(x, np.array([y])) == pytest.approx(crps, abs=0.03)


def test_the_energy_score_is_the_slow_sum_and_does_not_depend_on_the_count_on_average():
    rng = np.random.default_rng(13)
    x, y = rng.standard_normal((5, 7, 3)), rng.standard_normal((7, 3))
    pairs = [np.linalg.norm(x[i] - x[j], axis=-1) for i in range(5) for j in range(5) if i != j]
    slow = np.linalg.norm(x - y, axis=-1).mean(0) - np.mean(pairs, axis=0) / 2
    np.testing.assert_allclose(energy_score(x, y), slow, atol=1e-12)
    draws = rng.standard_normal((8, 4000, 3))
    truth = rng.standard_normal((4000, 3))
    two, eight = energy_score(draws[:2], truth).mean(), energy_score(draws, truth).mean()
    assert two == pytest.approx(eight, abs=0.05)


def test_the_energy_score_is_lowest_for_the_true_distribution():
    rng = np.random.default_rng(14)
    truth = rng.standard_normal((3000, 2))
    scores = {scale: energy_score(scale * rng.standard_normal((8, 3000, 2)), truth).mean() for scale in (0.0, 1.0, 2.0)}
    assert scores[1.0] < min(scores[0.0], scores[2.0])
    with pytest.raises(ValueError, match="at least two"):
        energy_score(truth[None], truth)


@given(seed=st.integers(0, 10_000), angle=st.floats(0, np.pi))
@settings(max_examples=50)
def test_the_angle_between_rotations_is_that_of_the_turn_between_them(seed, angle):
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    first = Rotation.from_quat(rng.standard_normal(4))
    second = first * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    found = geodesic_angle(first.as_rotvec(), second.as_rotvec())
    assert found == pytest.approx(angle, abs=1e-7)


def test_axis_angle_vectors_of_one_rotation_are_no_angle_apart():
    """The trap: across pi the vectors jump by two pi, the rotation does not."""
    axis = np.array([0.0, 0.6, 0.8])
    assert geodesic_angle(3.1 * axis, (3.1 - 2 * np.pi) * axis) == pytest.approx(0, abs=1e-9)
    assert geodesic_angle((np.pi - 0.01) * axis, -(np.pi - 0.01) * axis) == pytest.approx(0.02, abs=1e-9)
    assert geodesic_angle(1e-9 * axis, np.zeros(3)) == pytest.approx(1e-9, rel=1e-3)


def test_principal_axes_are_those_of_the_covariance_and_keep_lengths():
    rng = np.random.default_rng(15)
    rows = rng.standard_normal((300, 6)) @ rng.standard_normal((6, 6)) + 5
    axes = principal_axes(rows, 4)
    values = np.linalg.eigvalsh(np.cov(rows.T))[::-1]
    np.testing.assert_allclose(np.cov(axes.project(rows).T), np.diag(values[:4]), atol=1e-9)
    np.testing.assert_allclose(axes.axes @ axes.axes.T, np.eye(4), atol=1e-12)
    assert axes.share == pytest.approx(values[:4].sum() / values.sum())
    whole = principal_axes(rows, 100)
    np.testing.assert_allclose(cdist(whole.project(rows), whole.project(rows)), cdist(rows, rows), atol=1e-6)


def test_principal_axes_of_few_rows_are_fewer():
    rows = np.random.default_rng(16).standard_normal((5, 100))
    assert principal_axes(rows, 48).axes.shape == (4, 100)
    assert principal_axes(np.ones((5, 3)), 2).share == 1.0
    with pytest.raises(ValueError, match="at least two"):
        principal_axes(rows[:1], 2)
