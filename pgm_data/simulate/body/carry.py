"""How a player carries racket and arms between strokes: ready, running, walking."""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body import postures
from pgm_data.simulate.body.keys import rise
from pgm_data.simulate.body.legs import LowerBody

_WALKS, _RUNS = 2.2, 4.2
"""m/s: below the first nobody pumps the arms, above the second everybody does."""
_STROLLS = 1.3
_STAYS_ALERT_S, _RELAXES_S = 1.4, 1.2


def alertness(last_s: float, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
    """1 while the point may go on, 0 from some time after the last stroke or split step."""
    return 1.0 - rise((times - last_s - _STAYS_ALERT_S) / _RELAXES_S)


def carried(
    lower: LowerBody, alert: Float[np.ndarray, " times"], *, left_handed: bool
) -> Float[np.ndarray, "times channels"]:
    """Postures, as `postures.angles`, of a player who only moves; arms swing against the legs."""
    ready, walk, ahead, back = (postures.angles(n) for n in ("ready", "walk", "walk_ahead", "walk_back"))
    run_ahead, run_back = postures.angles("run_ahead"), postures.angles("run_back")
    # The racket's arm goes ahead with the other side's leg.
    swing = (np.cos(lower.stride_phase) * (-1.0 if left_handed else 1.0))[:, None]
    stroll = rise(lower.speed / _STROLLS)[:, None]
    relaxed = walk + stroll * (0.5 * (ahead + back) - walk + 0.5 * swing * (ahead - back))
    run = 0.5 * (run_ahead + run_back) + 0.5 * swing * (run_ahead - run_back)
    still = relaxed + alert[:, None] * (ready - relaxed)
    return still + rise((lower.speed - _WALKS) / (_RUNS - _WALKS))[:, None] * (run - still)
