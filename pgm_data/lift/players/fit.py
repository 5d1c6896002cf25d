"""The joint fit of a skeleton to one segment: damped Gauss-Newton between estimates of which feet stand."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import LinAlgError

from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.lift.players.banded import Equations, covariance_blocks, empty_equations, solved
from pgm_data.lift.players.contact import ContactLaw, contact_probability
from pgm_data.lift.players.linkage import ROOT, Linkage, Posture, placed
from pgm_data.lift.players.sight import Sight
from pgm_data.lift.players.terms import (
    GroundLaw,
    MotionLaw,
    Prior,
    balance_term,
    ground_term,
    limb_term,
    lowest_shares,
    motion_term,
    picture_term,
    posture_term,
)

_LONGEST_TURN, _LONGEST_MOVE = 0.6, 3.0
"""Of one step, radians and metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """What is fitted to what."""

    linkage: Linkage
    sight: Sight
    prior: Prior
    motion: MotionLaw
    ground: GroundLaw
    contact: Float[np.ndarray, "frames 2"]
    """Probability that the left, the right foot is planted."""


def cost_of(case: Case, posture: Posture, equations: Equations | None = None) -> float:
    """Cost of a posture; its normal equations are added to the given ones."""
    linkage, sight = case.linkage, case.sight
    points, by_scale, slopes = placed(linkage, posture, slopes=equations is not None)
    flight = (1.0 - case.contact[:, 0]) * (1.0 - case.contact[:, 1])
    return (
        picture_term(linkage, sight, points, by_scale, slopes, case.motion, equations)
        + limb_term(sight, points, slopes, case.motion, equations)
        + posture_term(posture, case.prior, case.motion, equations)
        + balance_term(linkage, posture.position, points, slopes, case.contact, case.motion, equations)
        + motion_term(posture, sight.times, flight, case.motion, equations)
        + ground_term(linkage, points, by_scale, slopes, sight.times, case.contact, case.ground, equations)
    )


def equations_of(case: Case, posture: Posture) -> tuple[Equations, float]:
    """Normal equations at a posture, and its cost."""
    equations = empty_equations(len(posture.position), ROOT + posture.angles.shape[1], 1)
    return equations, cost_of(case, posture, equations)


def _moved(posture: Posture, step: np.ndarray, shared: np.ndarray) -> Posture:
    turn = step[:, 3:ROOT]
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    turn = turn * np.minimum(1.0, _LONGEST_TURN / np.maximum(length, 1e-12))
    return Posture(
        position=posture.position + np.clip(step[:, :3], -_LONGEST_MOVE, _LONGEST_MOVE),
        rotation=rotation_from_rotvec(turn) @ posture.rotation,
        angles=posture.angles + np.clip(step[:, ROOT:], -_LONGEST_TURN, _LONGEST_TURN),
        log_scale=float(posture.log_scale + np.clip(shared[0], -0.1, 0.1)),
    )


def descended(case: Case, posture: Posture, *, steps: int, tolerance: float) -> Posture:
    """The posture after at most so many damped steps, fewer once a step betters the cost by a smaller share."""
    damping = 1e-4
    for _ in range(steps):
        equations, cost = equations_of(case, posture)
        gain = None
        for _attempt in range(6):
            try:
                trial = _moved(posture, *solved(equations, damping=damping))
            except LinAlgError:
                damping = max(10 * damping, 1e-3)
                continue
            after = cost_of(case, trial)
            if after <= cost:
                gain = (cost - after) / max(cost, 1e-9)
                posture = trial
                damping = max(0.2 * damping, 1e-7)
                break
            damping = max(10 * damping, 1e-3)
        if gain is None or gain < tolerance:
            break
    return posture


def judged_contact(case: Case, posture: Posture, law: ContactLaw) -> Float[np.ndarray, "frames 2"]:
    """Probability of each foot to be planted, by the fit's heights and speeds and their uncertainty."""
    points, _, slopes = placed(case.linkage, posture, slopes=True)
    assert slopes is not None
    equations, _ = equations_of(case, posture)
    cov, following, _ = covariance_blocks(equations)
    step = np.diff(case.sight.times)
    out = np.empty_like(case.contact)
    for foot, sole in enumerate(case.linkage.soles):
        mine, own = points[:, sole], slopes[:, sole]
        share = lowest_shares(mine[..., 2], case.ground)
        lowest = np.einsum("fp,fpan->fan", share, own)
        height = np.einsum("fp,fp->f", share, mine[..., 2])
        # A law that is wide as yet says no more of heights than it allows.
        height_var = case.ground.height_m**2 + np.einsum("fn,fnm,fm->f", lowest[:, 2], cov, lowest[:, 2])
        # Of the point that is lowest in both frames.
        both = np.sqrt(share[1:] * share[:-1])
        both = both / both.sum(axis=1, keepdims=True)
        velocity = np.einsum("fp,fpa->fa", both, np.diff(mine, axis=0)) / step[:, None]
        early = np.einsum("fp,fpan->fan", both, own[:-1])
        late = np.einsum("fp,fpan->fan", both, own[1:])
        across = np.einsum("fan,fnm,fbm->fab", early, following[:-1], late)
        velocity_cov = (
            np.einsum("fan,fnm,fbm->fab", early, cov[:-1], early)
            + np.einsum("fan,fnm,fbm->fab", late, cov[1:], late)
            - across
            - np.swapaxes(across, 1, 2)
        ) / step[:, None, None] ** 2 + (case.ground.slide_m / case.motion.lasts_s) ** 2 * np.eye(3)
        out[:, foot] = contact_probability(
            law,
            height=height,
            height_var=np.maximum(height_var, 0.0),
            velocity=velocity,
            velocity_cov=velocity_cov,
            times=case.sight.times,
        )
    return out


def with_contact(case: Case, contact: np.ndarray, ground: GroundLaw) -> Case:
    """The case with other planted feet and another law of the ground."""
    return replace(case, contact=contact, ground=ground)
