"""Normal equations whose unknowns are a row of numbers a frame, coupled to the next two frames, and a few shared ones.

The matrix is block-banded with a border: `diagonal` blocks of each frame, full blocks `next` towards the following
frame, `after` (a diagonal only) towards the one behind it, and `border` towards the shared unknowns.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_solve_banded, cholesky_banded, solve_triangular


@dataclass(eq=False, kw_only=True)
class Equations:
    """Symmetric matrix and right-hand side; a builder's scratch: terms add to it in place."""

    diagonal: Float[np.ndarray, "frames n n"]
    next: Float[np.ndarray, "frames n n"]
    """Rows of a frame, columns of the following one; the last is unused."""
    after: Float[np.ndarray, "frames n"]
    """Diagonal of the block of a frame and the one two later; the last two are unused."""
    border: Float[np.ndarray, "frames n shared"]
    corner: Float[np.ndarray, "shared shared"]
    right: Float[np.ndarray, "frames n"]
    """Right-hand side: minus the gradient."""
    right_shared: Float[np.ndarray, " shared"]


def empty_equations(frames: int, n: int, shared: int) -> Equations:
    """Equations without any term."""
    return Equations(
        diagonal=np.zeros((frames, n, n)),
        next=np.zeros((frames, n, n)),
        after=np.zeros((frames, n)),
        border=np.zeros((frames, n, shared)),
        corner=np.zeros((shared, shared)),
        right=np.zeros((frames, n)),
        right_shared=np.zeros(shared),
    )


def _band(equations: Equations, damping: float) -> Float[np.ndarray, "rows unknowns"]:
    """Lower banded form of all but the border, its diagonal grown by the share `damping`."""
    frames, n, _ = equations.diagonal.shape
    band = np.zeros((2 * n + 1, frames, n))
    rows, columns = np.tril_indices(n)
    band[rows - columns, :, columns] = equations.diagonal[:, rows, columns].T
    band[0] *= 1.0 + damping
    rows, columns = (index.ravel() for index in np.indices((n, n)))
    if frames > 1:
        band[n + rows - columns, :-1, columns] = equations.next[:-1, columns, rows].T
    if frames > 2:
        band[2 * n, :-2] = equations.after[:-2]
    return band.reshape(2 * n + 1, frames * n)


def solved(
    equations: Equations, *, damping: float
) -> tuple[Float[np.ndarray, "frames n"], Float[np.ndarray, " shared"]]:
    """Unknowns of the frames and the shared ones.

    Raises:
        LinAlgError: If the matrix is not positive definite.
    """
    frames, n, _ = equations.diagonal.shape
    shared = len(equations.corner)
    factor = cholesky_banded(_band(equations, damping), lower=True, overwrite_ab=True, check_finite=False)
    sides = np.concatenate([equations.right[..., None], equations.border], axis=-1).reshape(frames * n, 1 + shared)
    out = cho_solve_banded((factor, True), sides, check_finite=False)
    flat = equations.border.reshape(frames * n, shared)
    corner = equations.corner * (1.0 + damping * np.eye(shared)) - flat.T @ out[:, 1:]
    step_shared = np.linalg.solve(corner, equations.right_shared - flat.T @ out[:, 0])
    return (out[:, 0] - out[:, 1:] @ step_shared).reshape(frames, n), step_shared


def covariance_blocks(
    equations: Equations,
) -> tuple[Float[np.ndarray, "frames n n"], Float[np.ndarray, "frames n n"], Float[np.ndarray, "shared shared"]]:
    """Blocks of the inverse: of each frame with itself, with the following frame, and of the shared unknowns.

    Two frames are one block of a block-tridiagonal matrix, whose inverse is had by a pass forth and a pass back.

    Raises:
        LinAlgError: If the matrix is not positive definite.
    """
    frames, n, _ = equations.diagonal.shape
    shared = len(equations.corner)
    pairs = (frames + 1) // 2
    m = 2 * n
    main, off = _paired(equations, pairs)
    border = np.zeros((2 * pairs, n, shared))
    border[:frames] = equations.border
    border = border.reshape(pairs, m, shared)

    # Schur complements from the front: S_k = A_k - B_{k-1}' S_{k-1}^-1 B_{k-1}.
    inverse = np.empty_like(main)
    carried = np.empty_like(main)
    forth = np.empty_like(border)
    schur, side = main[0], border[0]
    for k in range(pairs):
        lower = np.linalg.cholesky(schur)
        half = solve_triangular(lower, np.eye(m), lower=True, check_finite=False)
        inverse[k] = half.T @ half
        forth[k] = inverse[k] @ side
        if k + 1 < pairs:
            carried[k] = inverse[k] @ off[k]
            schur = main[k + 1] - off[k].T @ carried[k]
            side = border[k + 1] - carried[k].T @ side
    # Back: C_kk = S_k^-1 + X C_{k+1,k+1} X', C_{k,k+1} = -X C_{k+1,k+1}, with X = S_k^-1 B_k.
    own = np.empty_like(main)
    across = np.zeros_like(main)
    back = np.empty_like(border)
    own[-1], back[-1] = inverse[-1], forth[-1]
    for k in range(pairs - 2, -1, -1):
        across[k] = -carried[k] @ own[k + 1]
        own[k] = inverse[k] - across[k] @ carried[k].T
        back[k] = forth[k] - carried[k] @ back[k + 1]
    # The shared unknowns' part.
    corner = np.linalg.inv(equations.corner - np.einsum("kms,kmr->sr", border, back))
    own += back @ corner @ np.swapaxes(back, 1, 2)
    across[:-1] += back[:-1] @ corner @ np.swapaxes(back[1:], 1, 2)
    cov = np.empty((2 * pairs, n, n))
    following = np.zeros((2 * pairs, n, n))
    cov[0::2], cov[1::2] = own[:, :n, :n], own[:, n:, n:]
    following[0::2], following[1::2] = own[:, :n, n:], across[:, n:, :n]
    return cov[:frames], following[:frames], corner


def _paired(equations: Equations, pairs: int) -> tuple[np.ndarray, np.ndarray]:
    """Blocks (pairs, 2n, 2n) of two frames with themselves and with the next two; an odd end is padded with ones."""
    frames, n, _ = equations.diagonal.shape
    diagonal = np.broadcast_to(np.eye(n), (2 * pairs, n, n)).copy()
    diagonal[:frames] = equations.diagonal
    following = np.zeros((2 * pairs, n, n))
    following[: frames - 1] = equations.next[: frames - 1]
    after = np.zeros((2 * pairs, n, n))
    if frames > 2:
        after[: frames - 2] = equations.after[: frames - 2, :, None] * np.eye(n)
    main = np.zeros((pairs, 2 * n, 2 * n))
    main[:, :n, :n], main[:, n:, n:] = diagonal[0::2], diagonal[1::2]
    main[:, :n, n:] = following[0::2]
    main[:, n:, :n] = np.swapaxes(following[0::2], 1, 2)
    off = np.zeros((pairs, 2 * n, 2 * n))
    off[:, :n, :n], off[:, n:, n:] = after[0::2], after[1::2]
    off[:, n:, :n] = following[1::2]
    return main, off
