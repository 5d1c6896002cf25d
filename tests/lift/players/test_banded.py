"""Block-banded normal equations against their dense form."""

import numpy as np
import pytest

from pgm_data.lift.players.banded import covariance_blocks, empty_equations, solved


def random_equations(frames: int, n: int, shared: int, seed: int):
    """Positive definite equations and their dense matrix and right-hand side."""
    rng = np.random.default_rng(seed)
    e = empty_equations(frames, n, shared)
    size = frames * n
    dense = np.zeros((size + shared, size + shared))
    for f in range(frames):
        A = rng.normal(size=(n, n))
        e.diagonal[f] = A @ A.T + 20 * np.eye(n)
        e.next[f] = rng.normal(size=(n, n))
        e.after[f] = rng.normal(size=n)
        e.border[f] = rng.normal(size=(n, shared))
        at = slice(f * n, f * n + n)
        dense[at, at] = e.diagonal[f]
        dense[at, size:] = e.border[f]
        dense[size:, at] = e.border[f].T
        for step, block in ((1, e.next[f]), (2, np.diag(e.after[f]))):
            if f + step < frames:
                to = slice((f + step) * n, (f + step) * n + n)
                dense[at, to], dense[to, at] = block, block.T
    e.corner[:] = 100 * np.eye(shared)
    dense[size:, size:] = e.corner
    e.right[:] = rng.normal(size=e.right.shape)
    e.right_shared[:] = rng.normal(size=shared)
    return e, dense, np.concatenate([e.right.ravel(), e.right_shared])


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 7])
def test_solution_and_covariance_are_those_of_the_dense_matrix(frames: int) -> None:
    n, shared = 5, 2
    e, dense, right = random_equations(frames, n, shared, seed=frames)
    assert np.linalg.eigvalsh(dense).min() > 0
    step, step_shared = solved(e, damping=0.0)
    want = np.linalg.solve(dense, right)
    np.testing.assert_allclose(np.concatenate([step.ravel(), step_shared]), want, atol=1e-12)
    cov, following, corner = covariance_blocks(e)
    inverse = np.linalg.inv(dense)
    np.testing.assert_allclose(corner, inverse[frames * n :, frames * n :], atol=1e-12)
    for f in range(frames):
        at = slice(f * n, f * n + n)
        np.testing.assert_allclose(cov[f], inverse[at, at], atol=1e-12)
        if f + 1 < frames:
            np.testing.assert_allclose(following[f], inverse[at, f * n + n : f * n + 2 * n], atol=1e-12)
